"""Modulus, damping and force that change with time, in every model, against other hands."""

import itertools
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scenes import scene
from scipy.integrate import solve_ivp

from sphpod.full import coefficients_in_time, lifted, sph
from sphpod.reduced import certificate, lifted_rom, pod, reduced_in_time, rom, snapshots
from sphpod.reference import chain, exact, reference
from sphpod.scene import checks, waves

GRADED = {
    "initial_velocity": "0.01*sin(2*pi*x/L) + 0.004*cos(6*pi*x/L) + 0.002",
    "initial_density": "1 + 0.1*cos(2*pi*x/L)",
    "youngs_modulus": "0.1*(1 + 0.2*sin(4*t))*(1 + 0.3*sin(2*pi*x/L)) + 0.01*cos(t)",
    "damping": "0.5*(1 + sin(2*pi*x/L)*cos(3*t))",
    "force": [
        "0.01*sin(2*pi*(x - t)/L)",
        {"time": "0.003*sin(t)", "profile": "cos(2*pi*x/L)"},
        "0.01*t",
    ],
    "duration": 1,
    "particle_count": 40,
    "time_step": 1e-3,
    "error_interval": 0.02,
}
CASES = {
    "pulsating": {"youngs_modulus": "0.1*(1 + 0.3*sin(5*t))"},
    "damper switched on": {"damping": "where(t < 0.413, 0, 4)"},
    "travelling force": {"force": "0.02*exp(-((x - 0.5*t - 0.25)/0.06)**2)"},
    "travelling front": {"force": "where(abs(x - 0.3*t - 0.2) < 0.1, 0.02, 0)"},
    "all": GRADED,
    "all, jittered": GRADED | {"positions": {"jitter": 0.2, "seed": 1}},
    "six neighbours": GRADED | {"smoothing_ratio": 1.7},
}
BASE = {
    key: GRADED[key]
    for key in ("initial_velocity", "duration", "particle_count", "time_step", "error_interval")
}
TRUTHS: dict[str, list[np.ndarray]] = {}
each = pytest.mark.parametrize("changes", CASES.values(), ids=CASES)


def made(changes, **more):
    return scene(**(BASE | changes | more))


def truth(case):
    """Velocity and strain by scipy, of dense matrices and of the formulas themselves."""
    if repr(case) not in TRUTHS:
        TRUTHS[repr(case)] = integrated(case)
    return TRUTHS[repr(case)]


def integrated(case):
    x, count = case.positions, case.particle_count
    g = case.derivative(np.eye(count)).T
    density0 = case.density0()

    def value(expression, t):
        if expression is None:
            return np.zeros(count)
        given = {"x": x, "t": np.array([t])}
        return expression(**{name: given[name] for name in expression.variables}) * np.ones(count)

    def force(t):
        total = np.zeros(count)
        for term in case.forces:
            if hasattr(term, "factors"):
                for factor, shape in zip(term.factors, term.shapes, strict=True):
                    total += value(factor, t) * (1 if shape is None else shape(x=x))
            else:
                total += value(term, t)
        return total

    def rate(t, state):
        v, e = np.split(state, 2)
        pull = g @ (value(case.youngs_modulus, t) * e) / density0
        return np.concatenate([pull - value(case.damping, t) * v + force(t), g @ v])

    state = np.concatenate([case.velocity0(), np.zeros(count)])
    fields, edges = [state], np.unique(np.append(case.error_times, 0.413))
    for begin, end in itertools.pairwise(edges):
        step = solve_ivp(
            rate, (np.nextafter(begin, 1), np.nextafter(end, 0)), fields[-1], "DOP853",
            rtol=1e-11, atol=1e-14, max_step=2e-3,
        )  # fmt: skip
        fields.append(step.y[:, -1])
    kept = np.array(fields)[np.isin(edges, case.error_times)]
    return np.split(kept, 2, axis=1)


def distance(found, expected):
    return np.abs(found - expected).max() / np.abs(expected).max()


@pytest.mark.slow
@each
def test_the_lifted_model_is_that_of_the_formulas(changes):
    """Exact but for an error of its steps, which it states; fronts travel too fast for scipy."""
    case = made(changes)
    checks.check(case)
    velocity, strain = truth(case)
    rough = 1e-4 if "where(abs" in str(changes.get("force")) else 2e-9
    for integrator, allowed in (("exact", rough), ("dop853", rough), ("leapfrog", 1e-3)):
        found = lifted.solve(case, integrator, tolerance=1e-11)
        assert distance(found["velocity"], velocity) <= allowed
        assert distance(found["strain"], strain) <= allowed
        if integrator == "exact" and not case.is_steady:
            assert 0 <= found["time_error_estimate"] <= coefficients_in_time.TIME_ERROR


@pytest.mark.slow
@each
@pytest.mark.parametrize(
    ("integrator", "order"), [("explicit_euler", 1), ("symplectic_euler", 1), ("leapfrog", 2)]
)
def test_fixed_steps_have_their_order(changes, integrator, order):
    case = made(changes)
    if changes is CASES["damper switched on"] or changes is CASES["travelling front"]:
        # What breaks within a step costs an order there.
        order = 1
    expected, errors = lifted.solve(case, "exact"), []
    for dt in (2e-3, 1e-3, 5e-4, 2.5e-4):
        found = lifted.solve(case, integrator, dt)
        wrong = [found[field] - expected[field] for field in ("velocity", "strain")]
        errors.append(np.linalg.norm(wrong))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert rates.mean() >= order - 0.15


@pytest.mark.parametrize("name", ["pulsating", "all", "all, jittered"])
def test_steps_of_the_exact_model_have_order_four(name):
    case = made(CASES[name], error_interval=0.5)
    run = coefficients_in_time.Stepped(case, (case.velocity0(), np.zeros(case.particle_count)))
    shape = case.error_times.size, case.particle_count
    solutions = []
    for halving in range(4):
        fields = np.empty((2, *shape))
        assert run._run(fields[0], fields[1], halving, True) == -1
        solutions.append(fields[:, -1])
    gaps = [np.linalg.norm(a - b) for a, b in itertools.pairwise(solutions)]
    assert np.log2(gaps[1] / gaps[2]) == pytest.approx(4, abs=0.3)


@pytest.mark.slow
@each
def test_full_sph_and_the_original_model_of_all_modes_are_the_same(changes):
    """And both repeat explicit Euler of the formulas, whatever the neighbours are found by."""
    case = made(changes)
    full = sph.solve(case, case.error_steps)
    lists = sph.solve(case, case.error_steps, "lists")
    every = np.eye(case.particle_count)
    run = rom.ReducedModel(case, "original", every, every).prepare(case.error_steps).run()
    for found in ((lists["velocity"], lists["density"]), run.state):
        np.testing.assert_allclose(found[0], full["velocity"], atol=1e-13)
        np.testing.assert_allclose(found[1], full["density"], rtol=1e-11)
    expected = truth(case)[0]
    errors = [distance(full["velocity"], expected)]
    finer = replace(case, time_step=case.time_step / 2)
    errors.append(distance(sph.solve(finer, finer.error_steps)["velocity"], expected))
    assert errors[0] / errors[1] == pytest.approx(2, rel=0.25)


@pytest.mark.slow
@each
def test_frozen_models_tend_to_the_linearized_one(changes):
    """Refreshed in every step they are it; and tensor and particles give the same."""
    case = made(changes)
    taken = snapshots.extract(
        case, {"range": [0, 1], "count": 12}, sph.solve(case, np.arange(1001))
    )
    modes = pod.decompose(taken)
    linear, _ = rom.model(case, "linearized", modes, 6).prepare(case.error_steps).run().state
    frozen, _ = rom.model(case, "frozen1", modes, 6).prepare(case.error_steps).run().state
    np.testing.assert_allclose(frozen, linear, atol=1e-11 * np.abs(linear).max())
    gaps = []
    for n in (4, 8):
        now, _ = rom.model(case, f"frozen{n}", modes, 6).prepare(case.error_steps).run().state
        gaps.append(np.abs(now - linear).max())
    # A damper is switched on at the next refresh, whichever comes then.
    assert changes is CASES["damper switched on"] or gaps[1] / gaps[0] == pytest.approx(
        7 / 3, rel=0.3
    )
    together = rom.prepare_each(
        [rom.model(case, "original", modes, k) for k in (5, 6, 7)], case.error_steps
    )
    for count, several in zip((5, 6, 7), together, strict=True):
        alone, _ = rom.model(case, "original", modes, count).prepare(case.error_steps).run().state
        np.testing.assert_allclose(several.state[0], alone, atol=1e-12 * np.abs(alone).max())


def every_mode(case):
    count = case.particle_count
    return {
        "scaled_velocity_modes": np.eye(count),
        "scaled_strain_modes": np.eye(count),
        "translation": np.array(0),
    }


@pytest.mark.slow
def test_damping_that_is_faster_than_waves_shortens_the_steps():
    """All over the bar it leaves e⁻¹⁰⁰⁰ᵗ of what moves alike, and no wave beside it."""
    case = made({"damping": "1000*where(t < 0.5, 0, t)", "initial_velocity": 0.01, "duration": 0.6})
    times = case.error_times
    expected = 0.01 * np.exp(-500 * np.maximum(times**2 - 0.25, 0))
    reduced = lifted_rom.build(case, every_mode(case)).prepare("lifted_exact").solve().fields()
    for velocity in (lifted.solve(case, "exact")["velocity"], reduced["velocity"]):
        np.testing.assert_allclose(velocity, expected[:, None] + 0 * velocity, atol=1e-11)


@pytest.mark.slow
@each
@pytest.mark.parametrize(
    ("method", "integrator"), [("lifted_exact", "exact"), ("lifted_euler", "explicit_euler")]
)
def test_lifted_models_of_all_modes_are_the_full_model(changes, method, integrator):
    case = made(changes)
    full = lifted.solve(case, integrator)
    run = lifted_rom.build(case, every_mode(case)).prepare(method).solve()
    for name, found in run.fields().items():
        np.testing.assert_allclose(found, full[name], atol=3e-10 * np.abs(full[name]).max())


@pytest.mark.parametrize("name", ["pulsating", "damper switched on", "all", "all, jittered"])
def test_the_bound_is_above_the_error_at_every_output(name):
    case = made(CASES[name])
    full = lifted.solve(case, "exact")
    taken = {f"{field}_snapshots": full[field][::4] for field in ("velocity", "strain")}
    modes = lifted_rom.decompose(case, taken)
    against = {"velocity": full["velocity"], "density": lifted.density(case, full["strain"])}
    found = certificate.certify(case, [1, 2, 4, 8, 12], modes, full, against)
    rounding = 10 * coefficients_in_time.TIME_ERROR
    assert np.all(found["bound_slack"] >= -rounding)
    large = found["energy_error_lifted"] > 1e-6
    assert np.all((found["energy_error_bound"] / found["energy_error_lifted"])[large] < 60)
    assert found["energy_error_lifted"][-1] < 0.1 * found["energy_error_lifted"][0]


def test_the_bound_sees_a_pulse_that_is_over_between_two_outputs():
    """It pushes a wave that no snapshot has, for a hundredth of the time between two outputs."""
    force = [
        "0.02*sin(2*pi*x/L)*sin(3*t)",
        {"time": "100*exp(-((t - 0.7051)/1e-5)**2)", "profile": "cos(6*pi*x/L)"},
    ]
    modulus = "0.1*(1 + 0.1*sin(t))"
    case = made({"youngs_modulus": modulus, "initial_velocity": 0, "force": force})
    full = lifted.solve(case, "exact")
    taken = {f"{field}_snapshots": full[field][:30:3] for field in ("velocity", "strain")}
    modes = lifted_rom.decompose(case, taken)
    against = {"velocity": full["velocity"], "density": lifted.density(case, full["strain"])}
    found = certificate.certify(case, [2, 4], modes, full, against)
    assert np.all(found["energy_error_lifted"] > 1e-3)
    assert np.all(found["bound_slack"] >= -10 * coefficients_in_time.TIME_ERROR)


@pytest.mark.parametrize(
    "modulus",
    ["0.1*(1 + where(t < 0.5, 0, 1))", "where(t < 0.333, 0.1, 0.2)", "0.1 + 0.1*(x < 0.1 + t)"],
)
def test_a_modulus_that_jumps_has_no_bound(modulus, caplog):
    case = made({"youngs_modulus": modulus})
    prepared = lifted_rom.build(case, every_mode(case), 4).prepare("lifted_exact")
    assert np.isinf(reduced_in_time.error_bounds(prepared)).all()
    assert f"youngs_modulus = {modulus}: it jumps in time" in caplog.text


@pytest.mark.parametrize(
    "changes",
    [{"youngs_modulus": "where(sin(1e9*t) > 0, 0.1, 0.2)"}, {"damping": "1 + sin(1e9*t)"}],
)
def test_what_cannot_be_followed_has_no_bound(changes, caplog):
    prepared = lifted_rom.build(made(changes), every_mode(made(changes)), 4).prepare("lifted_exact")
    assert np.isinf(reduced_in_time.error_bounds(prepared)).all()
    (key, text), *_ = changes.items()
    assert f"{key} = {text}: it changes more often in time than can be followed" in caplog.text


def test_a_modulus_with_a_kink_has_a_bound():
    case = made({"youngs_modulus": "0.1 + 0.1*abs(t - 0.333)"})
    prepared = lifted_rom.build(case, every_mode(case), 4).prepare("lifted_exact")
    assert np.isfinite(reduced_in_time.error_bounds(prepared)).all()


def test_energy_changes_by_what_the_modulus_does_alone():
    """Of any modes: (|a|² + bᵀ S b)/2 gains ½ bᵀ S' b, and nothing else."""
    case = made({"youngs_modulus": "0.1*(1 + 0.3*sin(5*t)*cos(2*pi*x/L))", "initial_velocity": "x"})
    modes = np.linalg.qr(np.random.default_rng(2).standard_normal((40, 7)))[0].T
    strains = np.linalg.qr(np.random.default_rng(3).standard_normal((40, 5)))[0].T
    case = replace(case, error_interval=1e-3)
    model = lifted_rom.LiftedModel(case, modes, strains, 0)
    velocity, strain = model.prepare("lifted_exact").run().coordinates()
    energy = model.lengths(velocity, strain) ** 2 / 2
    metrics = reduced_in_time.Terms.of(model).metrics(case.error_times)
    slopes = np.gradient(metrics, case.error_times, axis=0)
    gained = np.einsum("tm,tmn,tn->t", strain, slopes, strain) / 2
    expected = np.concatenate([[0], np.cumsum((gained[1:] + gained[:-1]) / 2 * 1e-3)])
    np.testing.assert_allclose(energy - energy[0], expected, atol=2e-5 * energy.max())


def test_a_modulus_at_twice_a_waves_frequency_pumps_it():
    """Mathieu's equation y'' + ω² (1 - a sin 2ωt) y = 0 grows by exp(a ω t/4), within a²."""
    depth, count = 0.1, 40
    still = scene(particle_count=count, initial_velocity="1e-6*sin(2*pi*x/L)", youngs_modulus=0.1)
    wave = np.sin(2 * np.pi * still.positions)
    omega = float(np.sqrt(0.1) * np.abs(still.derivative(wave)).max())
    pumped = made(
        {"initial_velocity": "1e-6*sin(2*pi*x/L)"}, duration=10, error_interval=0.05,
        youngs_modulus=f"0.1*(1 - {depth}*sin({2 * omega!r}*t))",
    )  # fmt: skip

    # With the amplitudes v of the velocity and e/s of the strain, s the speed of waves.
    def rate(t, y):
        v, e = y
        return -omega * (1 - depth * np.sin(2 * omega * t)) * e, omega * v

    times = pumped.error_times
    expected = solve_ivp(rate, (0, 10), (1e-6, 0), "DOP853", times, rtol=1e-12, atol=1e-20).y[0]
    found = lifted.solve(pumped, "exact")["velocity"]
    amplitude = 2 / count * found @ np.sin(2 * np.pi * pumped.positions)
    np.testing.assert_allclose(amplitude, expected, atol=1e-9 * np.abs(expected).max())
    late = np.abs(expected[times > 10 - 2 * np.pi / omega]).max() / 1e-6
    assert late == pytest.approx(np.exp(depth * omega * 10 / 4), rel=0.1)
    # No reduced model does otherwise.
    taken = {
        "velocity_snapshots": found[::20],
        "strain_snapshots": lifted.solve(pumped, "exact")["strain"][::20],
    }
    model = lifted_rom.build(pumped, lifted_rom.decompose(pumped, taken), 1)
    reduced = model.prepare("lifted_exact").solve().fields()["velocity"]
    np.testing.assert_allclose(reduced, found, atol=1e-7 * np.abs(found).max())


@cache
def on_grid(solve, name, count):
    case = made(CASES[name], particle_count=count, time_step=0.02 / count, error_interval=0.1)
    return solve(case)["velocity"][:, :: count // 40]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["pulsating", "damper switched on", "travelling force", "all"])
@pytest.mark.parametrize(
    ("solve", "order"),
    [
        (reference.solve_paper, 1),
        (lambda case: reference.solve_centred(case, estimate_error=False), 2),
        (chain.solve, 2),
    ],
    ids=["fd", "centred", "chain"],
)
def test_references_tend_to_one_solution(name, solve, order):
    """That of the chain on a far finer grid, with the order that each has."""

    fine = (4 * on_grid(chain.solve, name, 640) - on_grid(chain.solve, name, 320)) / 3
    errors = [distance(on_grid(solve, name, count), fine) for count in (40, 80)]
    assert np.log2(errors[0] / errors[1]) >= order - 0.35


def test_no_exact_reference_is_known():
    case = made(CASES["pulsating"])
    assert exact.kind(case) is None
    with pytest.raises(ValueError, match="change with time"):
        exact.solve(case)


def test_a_travelling_force_has_an_exact_solution_on_a_uniform_line():
    case = made({"force": "0.02*sin(2*pi*(x - t)/L)"})
    assert exact.kind(case) == "fourier"
    found = exact.solve(case)["velocity"]
    against = reference.solve_centred(
        made({"force": "0.02*sin(2*pi*(x - t)/L)"}, particle_count=160, time_step=2.5e-4),
        estimate_error=False,
    )
    assert distance(against["velocity"][:, ::4], found) < 2e-3


def test_the_largest_modulus_decides_what_step_is_allowed():
    """A modulus that rises a thousandfold, however short."""
    case = made({"youngs_modulus": "0.1*(1 + 1e3*exp(-((t - 0.5)/1e-3)**2))"})
    stiff = made({"youngs_modulus": 100.1})
    assert waves.fastest_wave(case) == pytest.approx(waves.fastest_wave(stiff), rel=1e-3)


def test_what_does_not_change_costs_nothing():
    """A list of one term, and a product of one, are the force that one expression is."""
    one = made({"force": "0.01*cos(9*t)"})
    for same in (["0.01*cos(9*t)"], {"time": "0.01*cos(9*t)", "profile": 1}):
        other = made({"force": same})
        np.testing.assert_array_equal(
            sph.solve(one, one.error_steps)["velocity"],
            sph.solve(other, other.error_steps)["velocity"],
        )
    plain = made({})
    assert plain.changing("youngs_modulus") is None
    assert plain.is_steady
    assert sph.changing(plain, "youngs_modulus", 5)[1][0].size == 0
