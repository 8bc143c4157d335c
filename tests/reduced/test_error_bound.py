"""Error bounds of lifted reduced models, against solutions by matrix exponentials."""

from dataclasses import replace

import numpy as np
import pytest
from examples import examples
from hypothesis import assume, given
from hypothesis import strategies as st
from scenes import VARIED, WAVE, scene
from scipy.linalg import expm

from sphpod.full import lifted
from sphpod.reduced import error_bound, lifted_rom
from sphpod.reduced.error_bound import FullModel, Map, Motion
from sphpod.reduced.lifted_rom import LiftedModel

ROUNDING = 1e-12
"""Of the largest norm of the solution."""

KINDS = ("uniform", "uneven", "half", "spot", "none")


def damping(kind, rate):
    """Damping of each kind, from none at all to far beyond critical."""
    return {
        "uniform": rate,
        "uneven": f"{rate}*(1 + sin(2*pi*x/L))",
        "half": f"where(x/L < 0.5, {rate}, 0)",
        "spot": f"{rate}*exp(-50*(x/L - 0.5)**2)",
        "none": 0,
    }[kind]


def solved(case, wave=None, outputs=None):
    """Scaled fields (times, 2N) under a force amplitude * cos(rate * t), by matrix exponentials."""
    matrix, (mass, _) = lifted.operator(case).toarray(), lifted.energy_weights(case)
    count, outputs = len(matrix), outputs or case.error_times.size - 1
    state = np.concatenate([mass * case.velocity0(), 0 * mass])
    if wave:
        (amplitude, rate), (_, (profile,)) = wave, case.force_values(np.zeros(1))
        bigger = np.zeros((count + 2, count + 2))
        bigger[:count, :count] = matrix
        bigger[: mass.size, count] = amplitude * mass * profile
        bigger[count:, count:] = [[0, -rate], [rate, 0]]
        matrix, state = bigger, np.append(state, [1, 0])
    jump, states = expm(matrix * (case.duration / outputs)), [state]
    for _ in range(outputs):
        states.append(jump @ states[-1])
    return np.array(states)[:, :count]


def bounds(model):
    """Coordinates and fields of a model at the outputs, and its bounds."""
    run = model.prepare("lifted_exact").run()
    fields = run.state[0].T @ error_bound.own_modes(model).T
    return fields, *error_bound.error_bounds(run)


def modes_of(case, states):
    mass, stiffness = lifted.energy_weights(case)
    count = mass.size
    taken = {
        "velocity_snapshots": states[:, :count] / mass,
        "strain_snapshots": states[:, count:] / stiffness,
    }
    return lifted_rom.decompose(case, taken)


@st.composite
def random_models(draw):
    """Any material, damping, force and outputs, and POD modes or any at all of any number."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    count = draw(st.integers(7, 20))

    def profile(value, share):
        return f"{value}*(1 + {share}*sin(2*pi*x/L + {rng.uniform(0, 6)}))"

    duration, outputs = draw(st.sampled_from([1, 4, 40])), draw(st.sampled_from([1, 3, 30]))
    changes = {
        "particle_count": count,
        "smoothing_ratio": draw(st.sampled_from([0.9, 1.04, 1.7])),
        "duration": duration,
        "time_step": duration / outputs,
        "error_interval": duration / outputs,
        "initial_density": profile(1, draw(st.sampled_from([0, 0.5]))),
        "youngs_modulus": profile(0.1, draw(st.sampled_from([0, 0.9]))),
        "damping": damping(draw(st.sampled_from(KINDS)), 10 ** rng.uniform(-2, 3)),
        "initial_velocity": profile(1e-3, 3),
    }
    wave = None
    if draw(st.booleans()):
        wave = 10 ** rng.uniform(-4, -2), draw(st.sampled_from([0, 2, 30]))
        shape = draw(st.sampled_from(["1", "x*(L - x)", "where(x/L < 0.3, 1, 0)"]))
        changes["force"] = {"time": f"{wave[0]}*cos({wave[1]}*t)", "profile": shape}
    case = scene(**changes)
    if draw(st.booleans()):
        modes = modes_of(case, solved(case, wave, 60)[: draw(st.integers(2, 60))])
        assume(modes["scaled_strain_modes"].size)
        return lifted_rom.build(case, modes, draw(st.integers(1, count))), wave
    first, second = (np.linalg.qr(rng.standard_normal((count, count)))[0] for _ in range(2))
    k = draw(st.integers(1, count))
    return LiftedModel(case, first[:k], second[: max(1, k - 1)], 0), wave


@examples(20)
@given(random_models(), st.booleans())
def test_bounds_are_never_below_the_error(drawn, whole):
    """Whatever the scene, its outputs, the modes and their number."""
    model, wave = drawn
    with pytest.MonkeyPatch.context() as patch:
        if whole and len(model.operator) > 1:
            patch.setattr(lifted_rom, "ILL_CONDITIONED", 0)
        fields, bound, plain = bounds(model)
    full = solved(model.scene, wave)
    error = np.linalg.norm(full - fields, axis=1)
    size = np.linalg.norm(full, axis=1).max()
    assert (bound - error).min() >= -ROUNDING * size
    assert np.all(plain >= bound)
    assert bound.max() <= 20 * error.max() + 1e-10 * size


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("worst", ["along the error", "against the damping", "both in turn"])
def test_the_worst_residual_is_within_the_bound(kind, worst):
    """Of residuals that see the remainder and push it as hard as they can."""
    case = scene(particle_count=8, duration=4, damping=damping(kind, 6))
    full, step, count = FullModel.of(case), 1e-3, 8
    matrix, values = full.operator.toarray(), case.damping_values()
    values = np.concatenate([values if values.size else np.zeros(count), np.zeros(count)])
    damped = full.lasting > 0
    # Over a step in which the residual stands still.
    both = expm(step * np.block([[matrix, np.eye(2 * count)], [np.zeros_like(matrix)] * 2]))
    jump, response = np.split(both[: 2 * count], 2, axis=1)
    state = 1e-3 * np.random.default_rng(3).standard_normal(2 * count)
    lengths, whole, squares, rests = [np.linalg.norm(state)], [], [], []
    for n in range(4000):
        along = 0.5 * state
        against = np.where(damped, 2 * values * state, 0)
        turn = {"along the error": 0, "against the damping": 1}.get(worst, n // 100 % 2)
        push = (along, against)[turn]
        state = jump @ state + response @ push
        lengths.append(np.linalg.norm(state))
        whole.append(step * np.linalg.norm(push))
        squares.append(step * np.sum((push[damped] / full.lasting[damped]) ** 2))
        rests.append(step * np.linalg.norm(push[~damped]))
    bound = np.empty(len(lengths))
    error_bound.follow(lengths[0], np.array(whole), np.array(squares), np.array(rests), bound)
    assert np.all(bound >= np.array(lengths) * (1 - 1e-12))


def test_the_energy_identity_is_as_sharp_as_can_be():
    """Of particles that move without strain, where a = 2 d ε makes -d ε² + a ε its largest."""
    rate, step, steps = 6.0, 1e-4, 2000
    # ε' = -d ε + a, of a that stands still within the steps.
    length, bound = 1.0, np.empty(steps + 1)
    squares = np.empty(steps)
    for n in range(steps):
        push = 2 * rate * length
        squares[n] = step * push**2 / (4 * rate)
        length = push / rate + (length - push / rate) * np.exp(-rate * step)
    none = np.zeros(steps)
    error_bound.follow(1.0, none + np.inf, squares, none, bound)
    assert length <= bound[-1] <= 1.002 * length


@pytest.mark.slow
@pytest.mark.parametrize(
    "course",
    ["0", "cos(3*t)", "sin(60*t)", "where(0.303 < t < 0.3041, 40, 0)", "abs(t - 0.37)", "sqrt(t)"],
)
@pytest.mark.parametrize("kind", ["none", "uneven"])
@pytest.mark.parametrize("steps", [4, 256])
def test_integrals_of_norms_are_bounded_and_close(course, kind, steps):
    """Of any map of a solution and its force, however coarse the grid; against many points."""
    case = scene(
        particle_count=12,
        damping=damping(kind, 3),
        force={"time": course, "profile": "x*(L - x)"},
    )
    full = FullModel.of(case)
    rng = np.random.default_rng(steps)
    rows = np.linalg.qr(rng.standard_normal((12, 4)))[0].T
    model = LiftedModel(case, rows, rows[:3], 0)
    start = rng.standard_normal(7)
    push = error_bound.forces_on(full, model)
    columns, motion = rng.standard_normal((9, 8)), Motion.of(full, model, start, steps)
    some = Map.of(model, push, columns)
    norms = some.on(motion)
    fine = 2**13
    found = Motion.of(full, model, start, fine).values
    values = np.linalg.norm(some.factor @ found, axis=0)
    pieces = values[:-1].reshape(steps, -1), values[1:].reshape(steps, -1)
    # The trapezoidal rule is off by its own error, where the force jumps by that of one point.
    slack = 1e-3 * values.max() / steps + 50 * some.direct.sum() / fine
    integral = (pieces[0] + pieces[1]).sum(axis=1) / 2 / fine
    square = (pieces[0] ** 2 + pieces[1] ** 2).sum(axis=1) / 2 / fine
    assert np.all(norms.integral >= integral - slack)
    assert np.all(norms.square >= square - slack * values.max())
    columns[:, -1] = 0
    indirect = Map.of(model, push, columns)
    values = np.linalg.norm(indirect.factor @ found, axis=0)[:-1].reshape(steps, -1)
    assert np.all(indirect.on(motion).largest >= values.max(axis=1) - 1e-12 * values.max())
    if steps == 256 and "where" not in course:
        assert norms.integral.sum() <= 1.05 * integral.sum()


@pytest.mark.parametrize("interval", [0.005, 0.5, 5])
@pytest.mark.parametrize(
    "rate",
    [0, 1, 10, "5*(1 + sin(2*pi*x/L))", "50*(1 + sin(2*pi*x/L))", "where(x/L < 0.5, 10, 0)"],
)
def test_bounds_are_sharp_whatever_the_outputs_and_the_damping(interval, rate):
    case = scene(
        duration=5,
        damping=rate,
        initial_velocity="1e-3*sum(cos(l**2)*sin(2*pi*l*x/L + l) for l in range(1, 9))",
        time_step=interval,
        error_interval=interval,
    )
    modes = modes_of(case, solved(case, outputs=50)[:20:2])
    full = solved(case)
    for count in (2, 4, 6):
        fields, bound, _ = bounds(lifted_rom.build(case, modes, count))
        error = np.linalg.norm(full - fields, axis=1)
        assert 1 - 1e-9 <= bound.max() / error.max() <= 5


PULSES = [f"where(0.303 < t < 0.303 + {width}, {1e-3 / width}, 0)" for width in (1e-3, 1e-6, 1e-9)]


@pytest.mark.slow
@pytest.mark.parametrize("course", [*PULSES, "sin(70*t)", "abs(cos(9*t))"])
@pytest.mark.parametrize("rate", [0, VARIED["damping"], "where(x/L < 0.35, 0, 8)"])
def test_what_happens_between_outputs_is_in_the_bound(course, rate):
    """Of a force that ends, turns or breaks between two outputs."""
    case = scene(
        force={"time": course, "profile": "x*(L - x)"},
        damping=rate,
        time_step=0.25,
        error_interval=0.25,
    )
    full = lifted.solve(case, "exact")
    scaled = np.concatenate(
        [
            weights * full[field]
            for field, weights in zip(
                ("velocity", "strain"), lifted.energy_weights(case), strict=True
            )
        ],
        axis=1,
    )
    modes = modes_of(case, solved(scene()))
    fields, bound, plain = bounds(lifted_rom.build(case, modes, 2))
    error = np.linalg.norm(scaled - fields, axis=1)
    assert np.all(bound >= error * (1 - 1e-12))
    assert np.all(plain >= bound)
    assert bound.max() <= 5 * error.max()


@pytest.mark.parametrize("missed", [0.5, np.inf])
def test_what_is_missed_of_a_force_is_added(missed):
    case = scene(force={"time": "cos(3*t)", "profile": "x*(L - x)"})
    model = lifted_rom.build(case, modes_of(case, solved(case, (1, 3))), 2)
    run, full = model.prepare("lifted_exact").solve(), FullModel.of(case)
    less = replace(full, courses=(replace(full.courses[0], missed=missed),))
    mass, _ = lifted.energy_weights(case)
    size = np.linalg.norm(mass * case.force_values(np.zeros(1))[1])
    for some, more in zip(
        error_bound.error_bounds(run, full),
        error_bound.error_bounds(run, less),
        strict=True,
    ):
        np.testing.assert_allclose(more, some + size * (missed - full.courses[0].missed))


@pytest.mark.parametrize("changes", [{}, {"damping": 3}, VARIED], ids=["plain", "damped", "varied"])
@pytest.mark.parametrize("whole", [False, True])
def test_with_all_modes_the_bound_is_rounding(changes, whole, monkeypatch):
    if whole:
        monkeypatch.setattr(lifted_rom, "ILL_CONDITIONED", 0)
    case = scene(**changes, initial_velocity=WAVE)
    every = np.eye(case.particle_count)
    mass, _ = lifted.energy_weights(case)
    _, bound, plain = bounds(LiftedModel(case, every, every, 0))
    assert plain.max() < 1e-9 * np.linalg.norm(mass * case.velocity0())
    assert np.all(bound <= plain)


def test_enrichment_keeps_the_modes_and_adds_the_start():
    case = scene(damping=10)
    full, mass = FullModel.of(case), lifted.energy_weights(case)[0]
    model = lifted_rom.build(case, modes_of(case, solved(case)[5:50:5]), 2)
    change = error_bound.corrections(full, model, error_bound.own_modes(model))
    richer = error_bound.enriched(full, model, change)
    for some, more in (
        (model.velocity_modes, richer.velocity_modes),
        (model.strain_modes, richer.strain_modes),
    ):
        np.testing.assert_array_equal(more[: len(some)], some)
        np.testing.assert_allclose(more @ more.T, np.eye(len(more)), atol=1e-12)
    start = mass * case.velocity0()
    rest = start - richer.velocity_modes.T @ (richer.velocity_modes @ start)
    assert np.linalg.norm(rest) < 1e-6 * np.linalg.norm(start)
