"""Full SPH."""

import numpy as np
import pytest
from scenes import VARIED, scene

from sphpod.full import sph
from sphpod.numerics.error import relative_error
from sphpod.reference import exact
from sphpod.scene.breakdown import Breakdown
from sphpod.scene.kernel import derivative, stencil_weights

SETTINGS = {
    "plain": {},
    "damped": {"damping": 3},
    "forced": {"force": "1e-3*cos(9*t)"},
    "varied": VARIED,
    "one neighbour": {"smoothing_ratio": 0.9},
    "three neighbours": {"smoothing_ratio": 1.7},
    "four neighbours": {"smoothing_ratio": 2.3},
    "six neighbours": {"smoothing_ratio": 3.3},
    "interface": {"youngs_modulus": "where(x < L/2, 0.1, 0.2)", "interface": "mean"},
}


@pytest.mark.parametrize("changes", SETTINGS.values(), ids=SETTINGS)
def test_compiled_steps_are_explicit_euler(changes):
    case = scene(**changes)
    steps = np.array([0, 1, 7, 50])
    result = sph.solve(case, steps)
    weights = stencil_weights(case.spacing, case.smoothing_ratio)
    v, density0, modulus = case.velocity0(), case.density0(), case.modulus()
    rho, dt = density0.copy(), case.time_step
    damping = case.damping_values() if case.damping else 0.0
    amplitudes, profiles = case.force_values(np.arange(50) * dt)
    for step in range(50):
        for row in np.flatnonzero(steps == step):
            np.testing.assert_allclose(result["velocity"][row], v, rtol=1e-11, atol=1e-16)
            np.testing.assert_allclose(result["density"][row], rho, rtol=1e-13)
        force = amplitudes[:, step] @ profiles if amplitudes.size else 0.0
        pull = derivative(modulus * (1 - density0 / rho), weights) / density0
        stretching = derivative(v, weights)
        v, rho = v + dt * (force - pull - damping * v), rho - dt * rho**2 / density0 * stretching
    np.testing.assert_allclose(result["velocity"][-1], v, rtol=1e-10, atol=1e-16)
    np.testing.assert_allclose(result["density"][-1], rho, rtol=1e-12)


@pytest.mark.parametrize("changes", SETTINGS.values(), ids=SETTINGS)
def test_neighbour_lists_give_the_stencils_solution(changes):
    case = scene(**changes)
    stencil = sph.solve(case, case.error_steps, "stencil")
    lists = sph.solve(case, case.error_steps, "lists")
    for field in ("velocity", "density"):
        np.testing.assert_allclose(stencil[field], lists[field], rtol=1e-10, atol=1e-14)


@pytest.mark.parametrize("changes", SETTINGS.values(), ids=SETTINGS)
def test_only_damping_and_force_change_the_momentum(changes):
    case = scene(**changes)
    result = sph.solve(case, np.arange(0, case.step_count + 1))
    mass = case.density0() * case.spacing
    momentum = result["velocity"] @ mass
    damping = case.damping_values() if case.damping else np.zeros(case.particle_count)
    amplitudes, profiles = case.force_values(result["t"])
    force = amplitudes.T @ profiles if amplitudes.size else 0.0
    change = case.time_step * ((force - damping * result["velocity"]) @ mass)[:-1]
    np.testing.assert_allclose(np.diff(momentum), change, atol=1e-16)


def test_stretching_and_squeezing_balance():
    case = scene(**VARIED)
    result = sph.solve(case, case.error_steps)
    strain = case.density0() / result["density"] - 1
    # Σ V_i J_i is the domain's length; explicit Euler in rho keeps it to the order of the step.
    assert np.abs(strain.mean(axis=1)).max() < 1e-3 * np.abs(strain).max()


def test_converges_to_the_exact_solution_with_particles_and_steps():
    """With α = 1, β is 1: second order in space, and the step is refined as its square."""
    errors = []
    for count in (20, 40, 80):
        case = scene(
            initial_velocity="1e-5*sin(2*pi*x/L)",
            smoothing_ratio=1.0,
            particle_count=count,
            time_step=4e-3 * (20 / count) ** 2,
            error_interval=0.02,
        )
        result, truth = sph.solve(case, case.error_steps), exact.solve(case)
        errors.append(relative_error(result["velocity"], truth["velocity"]))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 2, atol=0.1)


def test_first_order_in_the_time_step():
    final = []
    for halving in range(4):
        case = scene(time_step=1e-3 / 2**halving)
        final.append(sph.solve(case, np.array([case.step_count]))["velocity"][0])
    differences = np.linalg.norm(np.diff(final, axis=0), axis=1)
    np.testing.assert_allclose(np.log2(differences[:-1] / differences[1:]), 1, atol=0.1)


@pytest.mark.parametrize("neighbours", ["stencil", "lists"])
def test_breakdown_names_scene_time_and_particle(neighbours):
    case = scene("crash", initial_velocity="5*sin(2*pi*x/L)")
    with pytest.raises(Breakdown, match=r"^scene crash: full SPH broke down by t = 0\.\d+ s") as e:
        sph.solve(case, case.error_steps, neighbours)
    kept = sph.solve(case, case.error_steps[case.error_steps * 1e-3 < e.value.time - 1e-9])
    assert kept["density"].min() > 0
    assert 0 <= e.value.particle < case.particle_count
