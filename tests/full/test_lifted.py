"""Full SPH in velocity and strain."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import VARIED, scene
from scipy.linalg import expm

from sphpod.full import lifted, sph
from sphpod.numerics.error import relative_error
from sphpod.scene import waves
from sphpod.scene.breakdown import Breakdown
from sphpod.scene.kernel import derivative, stencil_weights

UNEVEN = {key: VARIED[key] for key in ("initial_density", "youngs_modulus")}
PUSHED = {"time": "1e-3*cos(20*t)", "profile": "1 + x*(L - x)"}
UNIFORM: dict[str, dict] = {
    "plain": {},
    "odd": {"particle_count": 41, "damping": 1},
    "damped": {"damping": 3},
    "overdamped": {"damping": 30},
    "forced": {"force": "1e-3*cos(9*t)"},
    "damped and forced": {"damping": 3, "force": PUSHED},
    "one neighbour": {"smoothing_ratio": 0.9},
    "three neighbours": {"smoothing_ratio": 1.7, "damping": 3, "force": "1e-3*cos(9*t)"},
    "six neighbours": {"smoothing_ratio": 3.3},
}
SETTINGS: dict[str, dict] = {
    **UNIFORM,
    "uneven": UNEVEN,
    "unevenly damped": UNEVEN | {"damping": VARIED["damping"]},
    "unevenly damped, six neighbours": {"damping": VARIED["damping"], "smoothing_ratio": 3.3},
    "varied": VARIED,
    "varied, three neighbours": VARIED | {"smoothing_ratio": 1.7},
    "varied, six neighbours": VARIED | {"smoothing_ratio": 3.3},
    "interface": {"youngs_modulus": "where(x < L/2, 0.1, 0.2)", "interface": "mean"},
}
each = pytest.mark.parametrize("changes", SETTINGS.values(), ids=SETTINGS)
each_uniform = pytest.mark.parametrize("changes", UNIFORM.values(), ids=UNIFORM)
UNFORCED = {name: changes for name, changes in SETTINGS.items() if "force" not in changes}
each_unforced = pytest.mark.parametrize("changes", UNFORCED.values(), ids=UNFORCED)
each_conserving = pytest.mark.parametrize(
    "changes",
    [{}, {"smoothing_ratio": 1.7}, {"smoothing_ratio": 3.3}, UNEVEN],
    ids=["uniform", "three neighbours", "six neighbours", "uneven"],
)


def gradient(case):
    """The SPH derivative G as a matrix."""
    weights = stencil_weights(case.spacing, case.smoothing_ratio)
    return derivative(np.eye(case.particle_count), weights).T


def scaled(case, result):
    """√m v and √(V c) e."""
    mass, stiffness = lifted.energy_weights(case)
    return mass * result["velocity"], stiffness * result["strain"]


def energy(case, result):
    u, p = scaled(case, result)
    return np.sum(u**2, axis=1) + np.sum(p**2, axis=1)


@pytest.mark.slow
@each
def test_compiled_steps_are_those_of_their_integrators(changes):
    case, steps = scene(**changes, duration=0.05, error_interval=1e-3), 50
    g, dt = gradient(case), case.time_step
    density0, modulus = case.density0(), case.modulus()
    damping = case.damping_values() if case.damping else np.zeros(case.particle_count)
    keep = np.exp(-dt * damping)
    through = np.where(damping > 0, -np.expm1(-dt * damping) / np.maximum(damping, 1e-30), dt)

    def force(time):
        amplitudes, profiles = case.force_values(np.array([time]))
        return amplitudes[:, 0] @ profiles if amplitudes.size else 0.0

    def pull(e):
        return g @ (modulus * e) / density0

    def explicit_euler(t, v, e):
        return v + dt * (pull(e) - damping * v + force(t)), e + dt * g @ v

    def symplectic_euler(t, v, e):
        e = e + dt * g @ v
        return keep * v + through * (pull(e) + force(t)), e

    def leapfrog(t, v, e):
        e = e + dt / 2 * g @ v
        v = keep * v + through * (pull(e) + force(t + dt / 2))
        return v, e + dt / 2 * g @ v

    for step in (explicit_euler, symplectic_euler, leapfrog):
        result = lifted.solve(case, step.__name__)
        v, e = case.velocity0(), np.zeros(case.particle_count)
        for n in range(steps + 1):
            np.testing.assert_allclose(result["velocity"][n], v, rtol=1e-10, atol=1e-16)
            np.testing.assert_allclose(result["strain"][n], e, rtol=1e-10, atol=1e-16)
            v, e = step(n * dt, v, e)


@each
@pytest.mark.parametrize(
    ("integrator", "order"), [("explicit_euler", 1), ("symplectic_euler", 1), ("leapfrog", 2)]
)
def test_fixed_steps_have_their_order(changes, integrator, order):
    """Of both fields: undamped, symplectic Euler has second order in the strain alone."""
    case = scene(**changes)
    exact, errors = lifted.solve(case, "exact"), []
    for dt in (1e-3, 5e-4, 2.5e-4, 1.25e-4):
        found = lifted.solve(case, integrator, dt)
        wrong = {field: found[field] - exact[field] for field in ("velocity", "strain")}
        errors.append(np.sqrt(energy(case, wrong).sum()))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(rates, order, atol=0.1)


@each
@pytest.mark.parametrize("integrator", lifted.ADAPTIVE)
def test_adaptive_steps_meet_their_tolerance(changes, integrator):
    case = scene(**changes)
    exact = lifted.solve(case, "exact")
    for tolerance in (1e-4, 1e-7, 1e-10):
        found = lifted.solve(case, integrator, tolerance=tolerance)
        for field in ("velocity", "strain"):
            # The tolerance is that of a step; many add up.
            assert relative_error(found[field], exact[field]) < 100 * tolerance


@each
def test_exact_is_the_exponential_of_the_operator(changes):
    """With a force a cos(ωt), which is a coordinate of a larger system without one."""
    case = scene(**changes)
    count, damping = case.particle_count, case.damping_values()
    amplitudes, profiles = case.force_values(np.zeros(1))
    operator = np.zeros((2 * count + 2, 2 * count + 2))
    operator[:count, count:-2] = gradient(case) * case.modulus() / case.density0()[:, None]
    operator[count:-2, :count] = gradient(case)
    if damping.size:
        operator[:count, :count] = -np.diag(damping)
    if profiles.size:
        frequency = 9 if case.forces[0].shapes == (None,) else 20
        operator[:count, -2] = amplitudes[:, 0] @ profiles
        operator[-2, -1], operator[-1, -2] = -frequency, frequency
    start = np.concatenate([case.velocity0(), np.zeros(count), [1, 0]])
    found = lifted.solve(case, "exact")
    np.testing.assert_array_equal(found["t"], case.error_times)
    np.testing.assert_array_equal(found["x"], case.positions)
    for row in (0, 1, 37, 100):
        state = expm(found["t"][row] * operator) @ start
        size = np.abs(case.velocity0()).max()
        np.testing.assert_allclose(found["velocity"][row], state[:count], atol=1e-12 * size)
        np.testing.assert_allclose(found["strain"][row], state[count:-2], atol=1e-11 * size)


@each_uniform
def test_the_fourier_solution_is_that_of_the_exponential(changes):
    case = scene(**changes)
    assert lifted.is_uniform(case)
    fourier = lifted.solve(case, "exact")
    velocity, strain = np.empty((2, case.error_times.size, case.particle_count))
    begin = case.velocity0(), np.zeros(case.particle_count)
    lifted._exponential(case, begin)(velocity, strain, True)
    assert relative_error(fourier["velocity"], velocity) < 1e-12
    assert relative_error(fourier["strain"], strain) < 1e-12


def test_uniform_scenes_are_reported_from_others():
    assert lifted.is_uniform(scene(damping=3, force=PUSHED))
    for key in ("initial_density", "youngs_modulus", "damping"):
        assert not lifted.is_uniform(scene(**{key: VARIED[key]}))


@settings(deadline=None, max_examples=50)
@given(st.sampled_from(list(SETTINGS)), st.integers(0, 2**32 - 1))
def test_pull_and_stretch_are_negative_transposes(name, seed):
    """So that what the strain gives to the velocity, it loses."""
    case = scene(**SETTINGS[name])
    rng = np.random.default_rng(seed)
    u, p = rng.standard_normal((2, 3, case.particle_count))
    gained, lost = u @ lifted.pull(case, p).T, lifted.stretch(case, u) @ p.T
    np.testing.assert_allclose(gained, -lost, rtol=0, atol=1e-11 * np.abs(gained).max())


@each
def test_pull_and_stretch_are_the_rates_of_the_scaled_fields(changes):
    case = scene(**changes)
    g, (mass, stiffness) = gradient(case), lifted.energy_weights(case)
    rng = np.random.default_rng(0)
    v, e = rng.standard_normal((2, case.particle_count))
    rate = g @ (case.modulus() * e) / case.density0()
    np.testing.assert_allclose(lifted.pull(case, stiffness * e), mass * rate, atol=1e-11)
    np.testing.assert_allclose(lifted.stretch(case, mass * v), stiffness * (g @ v), atol=1e-11)


@each_conserving
@pytest.mark.parametrize(("dt", "duration"), [(1e-3, 200), (0.04, 4000)])
def test_symplectic_steps_keep_their_modified_energy(changes, dt, duration):
    """Over 100000 steps and more, also with steps not far below the largest stable one."""
    case = scene(**changes, duration=duration, error_interval=0.4)
    symplectic = lifted.solve(case, "symplectic_euler", dt)
    u, p = scaled(case, symplectic)
    modified = energy(case, symplectic) + dt * np.sum(p * lifted.stretch(case, u), axis=1)
    np.testing.assert_allclose(modified, modified[0], rtol=1e-10)
    leapfrog = lifted.solve(case, "leapfrog", dt)
    u, _ = scaled(case, leapfrog)
    modified = energy(case, leapfrog) - dt**2 / 4 * np.sum(lifted.stretch(case, u) ** 2, axis=1)
    np.testing.assert_allclose(modified, modified[0], rtol=1e-10)
    # Their energy itself swings, the more the longer the steps.
    swing = np.ptp(energy(case, symplectic)) / energy(case, symplectic)[0]
    assert dt < swing < 20 * dt


@each_conserving
def test_exact_keeps_the_energy(changes):
    case = scene(**changes, duration=20, error_interval=0.1)
    values = energy(case, lifted.solve(case, "exact"))
    np.testing.assert_allclose(values, values[0], rtol=1e-12)


@each_unforced
def test_unforced_the_energy_never_grows(changes):
    case = scene(**changes, duration=5)
    values = energy(case, lifted.solve(case, "exact"))
    assert np.diff(values).max() <= 1e-12 * values[0]
    if case.damping:
        assert values[-1] < 0.2 * values[0]


@each_unforced
def test_explicit_euler_in_density_differs_by_the_step_times_the_strain_squared(changes):
    def differences(amplitude, dt):
        wave = f"{amplitude}*({scene().initial_velocity.text})"
        case = scene(**changes, initial_velocity=wave, time_step=dt)
        full, found = sph.solve(case, case.error_steps), lifted.solve(case, "explicit_euler")
        strain = lifted.strain(case, full["density"])
        fields = (full["velocity"], found["velocity"]), (strain, found["strain"])
        return np.array([np.linalg.norm(a - b) for a, b in fields])

    both = differences(1, 1e-3)
    np.testing.assert_allclose(both / differences(1, 5e-4), 2, atol=0.1)
    np.testing.assert_allclose(both / differences(0.5, 1e-3), 4, atol=0.1)


@each
def test_density_and_strain_are_two_ways_to_say_the_same(changes):
    case = scene(**changes)
    strains = np.random.default_rng(0).uniform(-0.5, 2, (3, case.particle_count))
    density = lifted.density(case, strains)
    np.testing.assert_allclose(lifted.strain(case, density), strains, atol=1e-14)
    np.testing.assert_array_equal(lifted.strain(case, case.density0()), 0)


@each
@pytest.mark.parametrize("integrator", lifted.INTEGRATORS)
def test_what_is_prepared_can_be_run_again(changes, integrator):
    case = scene(**changes, duration=0.1)
    run = lifted.prepare(case, integrator)
    fields = np.full((2, 2, case.error_times.size, case.particle_count), np.nan)
    for again in fields:
        run.state = tuple(again)
        run.run()
    np.testing.assert_array_equal(*fields)
    np.testing.assert_allclose(fields[0, 0, 0], case.velocity0(), atol=1e-17)
    np.testing.assert_allclose(fields[0, 1, 0], 0, atol=1e-17)


@pytest.mark.parametrize("integrator", lifted.INTEGRATORS)
@pytest.mark.parametrize("changes", [{}, UNEVEN], ids=["uniform", "uneven"])
def test_breakdown_names_scene_model_time_and_particle(changes, integrator):
    case = scene("crash", **changes, initial_velocity="0.4*sin(2*pi*x/L)")
    message = rf"^scene crash: the lifted full model \({integrator}\) broke down by t = 0\.\d+ s"
    with pytest.raises(Breakdown, match=message) as caught:
        lifted.solve(case, integrator)
    _, strain = lifted.prepare(case, integrator).run().state
    row = np.flatnonzero(case.error_times == caught.value.time)[0]
    assert strain[:row].min() > -1
    assert strain[row, caught.value.particle] <= -1


def test_a_solution_that_is_not_finite_is_refused():
    case = scene("crash", duration=2000, error_interval=1000)
    with pytest.raises(Breakdown, match=r"\(leapfrog\) broke down by t = 1000 s"):
        lifted.solve(case, "leapfrog", time_step=0.2)


@pytest.mark.parametrize("dt", [3e-3, 0.02, 0.0101])
def test_time_steps_that_do_not_divide_the_error_interval_are_refused(dt):
    with pytest.raises(ValueError, match=rf"scene test: time_step = {dt:g}: the error interval"):
        lifted.solve(scene(), "leapfrog", time_step=dt)


@pytest.mark.parametrize("step", [0, -0.1, np.inf, np.nan, "0.1", "", [], True])
def test_a_time_step_that_is_none_is_refused(step):
    with pytest.raises(ValueError, match=r"scene test: time_step = .*: it must be a positive numb"):
        lifted.solve(scene(), "leapfrog", time_step=step)


@pytest.mark.parametrize("tolerance", [0, -1e-8, 1e-300, 1, np.nan, "1e-8", None])
def test_a_tolerance_that_nothing_meets_is_refused(tolerance):
    told = r"scene test: tolerance = .*: it must be a number from 3e-14 to below 1"
    with pytest.raises(ValueError, match=told):
        lifted.solve(scene(), "dop853", tolerance=tolerance)


def test_unknown_integrators_are_refused():
    with pytest.raises(ValueError, match="integrator = euler: allowed are explicit_euler, "):
        lifted.solve(scene(), "euler")


@pytest.mark.parametrize("integrator", ["symplectic_euler", "leapfrog"])
def test_a_step_beyond_the_limit_is_reported_of(integrator, caplog):
    """Even where the run is too short to show it."""
    case = scene("waves", duration=0.5, error_interval=0.1)
    limit = 2 / waves.fastest_wave(case)
    assert 0.1 < limit < 0.25
    lifted.solve(case, integrator, 0.1)
    assert not caplog.records
    lifted.solve(scene("waves", duration=0.5, error_interval=0.25), integrator, 0.25)
    (record,) = caplog.records
    assert record.getMessage().startswith(f"scene waves: time_step = 0.25: {integrator} may let")
    assert float(record.getMessage().split(" up to ")[1].split()[0]) <= limit
