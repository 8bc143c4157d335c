"""Particles that jitter about their even places."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import WAVE, scene

from sphpod.full import energy, lifted, sph
from sphpod.numerics.error import relative_error
from sphpod.reduced import lifted_rom
from sphpod.reduced.rom import ReducedModel
from sphpod.scene import waves
from sphpod.scene.scene import derivative_matrix

GRADED = "1 + 0.9*sin(2*pi*x/L)"
EULER = {"time_step": 1e-3, "duration": 0.5, "error_interval": 0.05}
"""What explicit Euler can run all of these scenes with."""
INTEGRATORS = ("exact", "leapfrog", "symplectic_euler")


def kept(case, integrator):
    """What an integrator keeps of its own run, at all outputs."""
    found = lifted.solve(case, integrator)
    return energy.kept(case, integrator, case.time_step, found["velocity"], found["strain"])


def changes(draw, damped):
    """Settings of a jittered scene: its particles, kernel and material."""
    depth = st.floats(0, 0.8)
    found = {
        "domain_length": draw(st.sampled_from([1, 0.3, 7])),
        "particle_count": draw(st.integers(9, 50)),
        "smoothing_ratio": draw(st.sampled_from([0.8, 1.04, 1.2, 1.7, 2.1])),
        "positions": {"jitter": draw(st.floats(1e-3, 0.49)), "seed": draw(st.integers(0, 2**31))},
        "initial_density": f"1.5*(1 + {draw(depth)}*sin(2*pi*x/L))",
        "youngs_modulus": f"0.1*(1 + {draw(depth)}*cos(4*pi*x/L))",
    }
    if damped:
        found["damping"] = draw(st.sampled_from([f"30*({GRADED})", "0.5", f"2*({GRADED})"]))
    return found


@st.composite
def jittered(draw, damped=False):
    """A jittered scene, whose time step is half of what leapfrog can take, and 40 steps long."""
    found = changes(draw, damped)
    size = {"time_step": 1, "duration": 100, "error_interval": 1}
    dt = 1 / waves.fastest_wave(scene(**found | size))
    return scene(**found | {"time_step": dt, "duration": 40 * dt, "error_interval": 2 * dt})


each = given(jittered())
few = settings(deadline=None, max_examples=30)


@few
@each
def test_particles_keep_their_order_and_volumes_fill_the_domain(case):
    x, volumes, length = case.positions, case.volumes, case.domain_length
    assert x[0] == 0
    assert x[-1] < length
    assert np.diff(x).min() > 0
    shifts = (x / case.spacing - np.arange(x.size)) / case.jitter
    # From an evenly spaced row, somewhere; from i Δx up to twice as far.
    assert np.ptp(shifts) <= 2 + 1e-9
    assert np.abs(shifts).max() <= 2 + 1e-9
    assert np.ptp(np.diff(x)) > 0
    assert volumes.min() > 0
    assert volumes.sum() == pytest.approx(length, rel=1e-13)


def test_shifts_reach_twice_the_jitter():
    furthest, spread = 0.0, 0.0
    for seed in range(20):
        case = scene(particle_count=200, positions={"jitter": 0.25, "seed": seed})
        shifts = case.positions / case.spacing - np.arange(200)
        furthest, spread = max(furthest, np.abs(shifts).max()), max(spread, np.ptp(shifts))
    assert 1.8 * 0.25 < furthest <= 2 * 0.25
    assert 1.9 * 0.25 < spread <= 2 * 0.25


@few
@each
def test_the_weighted_derivative_is_antisymmetric(case):
    weighted = case.volumes[:, None] * derivative_matrix(case).toarray()
    rounding = 1e-15 * case.particle_count * np.abs(weighted).max()
    np.testing.assert_allclose(weighted, -weighted.T, rtol=0, atol=8 * rounding)


@few
@each
def test_translation_strains_but_stretches_nothing_in_all(case):
    strained = case.derivative(np.ones(case.particle_count))
    assert np.abs(strained).max() * case.spacing > 1e-6 * case.jitter
    weighted = case.volumes[:, None] * derivative_matrix(case).toarray()
    assert abs(case.volumes @ strained) < 1e-15 * np.abs(weighted).sum()
    assert not case.translates


@few
@each
def test_the_derivative_acts_on_every_row_of_fields(case):
    fields = np.random.default_rng(0).standard_normal((3, case.particle_count))
    together = case.derivative(fields)
    for field, found in zip(fields, together, strict=True):
        np.testing.assert_allclose(found, derivative_matrix(case) @ field, rtol=1e-13)


@few
@each
def test_the_fastest_wave_is_a_bound(case):
    frequencies = np.linalg.eigvals(lifted.operator(case).toarray()).imag
    assert frequencies.max() <= waves.fastest_wave(case) * (1 + 1e-12)


@few
@each
def test_undamped_each_integrator_keeps_its_energy(case):
    for integrator in INTEGRATORS:
        values = kept(case, integrator)
        np.testing.assert_allclose(values, values[0], rtol=1e-11)


@few
@given(jittered(damped=True))
def test_damped_each_integrator_loses_energy_in_every_step(case):
    for integrator in INTEGRATORS:
        values = kept(case, integrator)
        assert np.diff(values).max() <= 1e-14 * values[0]
        assert values[-1] < values[0]


@settings(deadline=None, max_examples=20)
@given(st.data(), st.booleans())
def test_density_and_strain_differ_by_the_step_times_the_strain_squared(data, damped):
    given_case = changes(data.draw, damped)

    def differences(amplitude, dt):
        wave = f"{amplitude}*({WAVE})"
        case = scene(**given_case | EULER | {"initial_velocity": wave, "time_step": dt})
        full = sph.solve(case, case.error_steps)
        found = lifted.solve(case, "explicit_euler")
        strain = lifted.strain(case, full["density"])
        return np.array(
            [
                np.linalg.norm(full["velocity"] - found["velocity"]),
                np.linalg.norm(strain - found["strain"]),
            ]
        )

    # Amplitudes so small that no higher power of the strain is seen, so large that rounding is not.
    both = differences(1, 1e-3)
    np.testing.assert_allclose(both / differences(1, 5e-4), 2, atol=0.4)
    np.testing.assert_allclose(both / differences(0.5, 1e-3), 4, atol=0.4)


@settings(deadline=None, max_examples=20)
@given(st.data(), st.booleans())
def test_with_all_modes_reduced_models_are_full_models(data, damped):
    case = scene(**changes(data.draw, damped) | EULER)
    every = np.eye(case.particle_count)
    model = lifted_rom.LiftedModel(case, every, every, translation=0)
    mass, stiffness = lifted.energy_weights(case)
    for method, integrator in (("lifted_exact", "exact"), ("lifted_euler", "explicit_euler")):
        full = lifted.solve(case, integrator)
        velocity, strain = model.prepare(method).solve().coordinates()
        assert relative_error(velocity / mass, full["velocity"]) < 1e-9
        assert relative_error(strain / stiffness, full["strain"]) < 1e-9
    full = sph.solve(case, case.error_steps)
    run = ReducedModel(case, "original", every, every).prepare(case.error_steps)
    velocity, density = run.solve().state
    assert relative_error(velocity, full["velocity"]) < 1e-10
    assert relative_error(density, full["density"]) < 1e-12


@settings(deadline=None, max_examples=20)
@given(jittered(damped=True))
def test_the_lifted_model_is_its_operator(case):
    """Whose exponential is the exact solution, and which rk45 follows to its tolerance."""
    mass, stiffness = lifted.energy_weights(case)
    exact = lifted.solve(case, "exact")
    states = np.concatenate([exact["velocity"] * mass, exact["strain"] * stiffness], axis=1)
    from scipy.linalg import expm

    jump = expm(case.error_interval * lifted.operator(case).toarray())
    np.testing.assert_allclose(
        states[1:], states[:-1] @ jump.T, rtol=0, atol=1e-12 * np.abs(states).max()
    )
    found = lifted.solve(case, "rk45", tolerance=1e-8)
    assert relative_error(found["velocity"], exact["velocity"]) < 1e-6


@pytest.mark.parametrize("seed", [0, 1])
def test_without_jitter_the_scene_is_the_even_one(seed):
    still = scene(positions={"jitter": 0, "seed": seed})
    even = scene()
    assert still.is_even
    np.testing.assert_array_equal(still.positions, even.positions)
    np.testing.assert_array_equal(still.volumes, even.volumes)
    for solve in (lambda c: sph.solve(c, c.error_steps), lambda c: lifted.solve(c, "leapfrog")):
        for name, values in solve(still).items():
            np.testing.assert_array_equal(values, solve(even)[name])


def test_a_jitter_that_vanishes_leads_to_the_even_scene():
    def difference(jitter):
        solutions = [
            lifted.solve(scene(positions={"jitter": size, "seed": 1}), "exact")
            for size in (jitter, 0)
        ]
        return relative_error(solutions[0]["velocity"], solutions[1]["velocity"])

    assert difference(1e-6) / difference(1e-7) == pytest.approx(10, rel=0.01)
    assert difference(1e-7) < 1e-5


def test_seeds_draw_places_and_repeat_them():
    def places(seed):
        return scene(positions={"jitter": 0.3, "seed": seed}).positions

    np.testing.assert_array_equal(places(1), places(1))
    assert np.abs(places(1) - places(2)).max() > 1e-3


def test_a_stencil_for_jittered_particles_is_refused():
    case = scene(positions={"jitter": 0.3, "seed": 1})
    with pytest.raises(ValueError, match="scene test: neighbours = stencil: jittered particles"):
        sph.solve(case, case.error_steps, "stencil")
