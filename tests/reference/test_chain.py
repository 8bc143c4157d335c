"""The chain of masses and springs of section 2.1, and what appendix A says of it."""

import numpy as np
import pytest
from scenes import VARIED, scene
from scipy.integrate import solve_ivp

from sphpod.numerics.error import relative_error
from sphpod.reference import chain, exact
from sphpod.scene.breakdown import Breakdown

WAVE = {"initial_velocity": "1e-2*sin(2*pi*x/L)", "duration": 2, "error_interval": 0.1}


DRIVEN = {"damping": 0.7, "force": {"time": "1e-2*cos(3*t)", "profile": "cos(2*pi*x/L)"}}


@pytest.mark.parametrize("changes", [{}, DRIVEN])
def test_the_chain_comes_to_the_exact_solution_at_second_order(changes):
    errors = []
    for count in (25, 50, 100):
        case = scene(**WAVE | changes | {"particle_count": count, "time_step": 0.05 / count})
        found, known = chain.solve(case), exact.solve(case)
        errors.append([relative_error(found[f], known[f]) for f in ("velocity", "density")])
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 2, atol=0.15)


def test_the_chain_moves_as_newton_has_it():
    """Masses, springs, dampers and forces of (2.1), integrated by another hand."""
    case = scene(**VARIED, particle_count=12, time_step=2e-4, error_interval=0.1)
    x, spacing = case.positions, case.spacing
    mass = case.initial_density(x=x) * spacing
    stiffness = case.youngs_modulus(x=x + spacing / 2) / spacing

    def rate(t, state):
        y, v = np.split(state, 2)
        pull = stiffness * (np.roll(y, -1) - y)
        amplitudes, profiles = case.force_values(np.array([t]), x)
        push = amplitudes[:, 0] @ profiles
        return np.concatenate([v, (pull - np.roll(pull, 1)) / mass - case.damping(x=x) * v + push])

    start = np.concatenate([np.zeros(12), case.initial_velocity(x=x)])
    truth = solve_ivp(rate, (0, 1), start, "DOP853", case.error_times, rtol=1e-11, atol=1e-14)
    found = chain.solve(case)["velocity"]
    np.testing.assert_allclose(found, truth.y[12:].T, atol=1e-6 * np.abs(found).max())


def test_a_pulse_within_a_step_counts_by_its_impulse():
    pulse = {"initial_velocity": 0, "force": "where(0.50005 < t < 0.50055, 1, 0)"}
    case = scene(**pulse, time_step=1e-2, error_interval=0.1)
    np.testing.assert_allclose(chain.solve(case)["velocity"][-1], 5e-4, rtol=1e-9)


def test_positions_follow_velocities_and_densities_follow_positions():
    """Appendix A: ∂z/∂t = v and ρ ∂z/∂x = ρ0 give the same density as ∂ρ/∂t = -ρ²/ρ0 ∂v/∂x."""
    case = scene(**WAVE | {"initial_velocity": "3e-2*sin(2*pi*x/L)", "error_interval": 1e-3,
                           "particle_count": 200, "time_step": 1e-3})  # fmt: skip
    known = exact.solve(case)
    t, velocity, density = known["t"], known["velocity"], known["density"]
    steps = (velocity[1:] + velocity[:-1]) / 2 * np.diff(t)[:, None]
    displacement = np.concatenate([np.zeros((1, 200)), np.cumsum(steps, axis=0)])
    wave = 2j * np.pi * np.fft.rfftfreq(200, case.spacing)
    strain = np.fft.irfft(wave * np.fft.rfft(displacement), 200)
    at_rest = np.broadcast_to(case.density0(), density.shape)
    np.testing.assert_allclose(density * (1 + strain), at_rest, rtol=1e-6)
    slope = np.fft.irfft(wave * np.fft.rfft(velocity), 200)
    rate = np.gradient(density, t, axis=0)[1:-1]
    expected = (-(density**2) / case.density0() * slope)[1:-1]
    np.testing.assert_allclose(rate, expected, atol=1e-4 * np.abs(rate).max())


def test_the_models_of_positions_and_of_densities_are_equal():
    """Appendix A: the chain by positions, and the same by velocities and densities."""
    case = scene(**WAVE | {"particle_count": 40, "time_step": 1e-4})
    x, spacing = case.positions, case.spacing
    speed, density0 = case.youngs_modulus(x=x), case.initial_density(x=x)

    def rate(_, state):
        v, rho = np.split(state, 2)  # density between a mass and the next
        stress = speed * (density0 / rho - 1)
        stretch = (np.roll(v, -1) - v) / spacing
        return np.concatenate([
            (stress - np.roll(stress, 1)) / (density0 * spacing), -(rho**2) / density0 * stretch,
        ])  # fmt: skip

    start = np.concatenate([case.initial_velocity(x=x), density0])
    truth = solve_ivp(rate, (0, 2), start, "DOP853", case.error_times, rtol=1e-11, atol=1e-14)
    found = chain.solve(case)
    np.testing.assert_allclose(found["velocity"], truth.y[:40].T, atol=1e-8)
    strain = density0 / truth.y[40:].T - 1
    about = (strain + np.roll(strain, 1, axis=1)) / 2
    np.testing.assert_allclose(density0 / found["density"] - 1, about, atol=1e-8)


def test_a_spring_that_is_pressed_to_nothing_ends_it():
    case = scene(initial_velocity="2*sin(2*pi*x/L)")
    with pytest.raises(Breakdown, match="the chain broke down"):
        chain.solve(case)


def test_a_chain_has_even_masses():
    with pytest.raises(ValueError, match="evenly spaced masses only"):
        chain.solve(scene(positions={"jitter": 0.2}))
