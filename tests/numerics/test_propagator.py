"""Linear models carried from output to output."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from sphpod.numerics import propagator
from sphpod.numerics.course import NODES, Course
from sphpod.numerics.expressions import Expression

OSCILLATORS = {
    "undamped": (7, 0),
    "underdamped": (7, 1.5),
    "critically damped": (7, 14),
    "overdamped": (7, 40),
    "damped alone": (0, 3),
    "free": (0, 0),
}
"""Frequency and damping [1/s]."""

FORCES = {
    "constant": Expression("0.7", ("t",)),
    "slow": Expression("cos(0.3*t)*exp(-t)", ("t",)),
    "fast": Expression("cos(90*t + 1)", ("t",)),
    "jump": Expression("where(t < 0.4321, 1, -2)", ("t",)),
}


def wave(frequency):
    return Expression(f"cos({frequency}*t)", ("t",))


def oscillators(*pairs):
    return np.array([[[-damping, wave], [-wave, 0]] for wave, damping in pairs], dtype=float)


def whole(blocks, singles):
    """Matrix of all coordinates as they stand in the state: every α, then the β of the pairs."""
    if blocks.shape[-1] > 2:
        return blocks[0]
    count = len(blocks)
    matrix = np.zeros((2 * count - singles,) * 2)
    for m, block in enumerate(blocks):
        rows = [m, count + m] if m < count - singles else [m]
        matrix[np.ix_(rows, rows)] = block[: len(rows), : len(rows)]
    return matrix


def push(blocks, singles, force):
    """Force on all coordinates as they stand in the state."""
    return force[0] if blocks.shape[-1] > 2 else force.T.ravel()[: 2 * len(blocks) - singles]


def run(blocks, singles, force, start, interval, outputs, amplitude=None, euler_steps=0):
    """All outputs, shape (outputs, coordinates)."""
    courses = follow(interval, outputs, amplitude)
    jumps = propagator.prepare(
        blocks, singles, force[None], interval, outputs, courses, euler_steps=euler_steps
    )
    state = np.full((start.size, outputs), np.nan)
    state[:, 0] = start
    jumps.run(state)
    return state.T


def follow(interval, outputs, amplitude):
    """The course of a force, if there is one."""
    return (Course.of(amplitude, max(outputs - 1, 1) * interval),) if amplitude else ()


def step_by_step(matrix, force, start, interval, outputs, amplitude, euler_steps):
    """Explicit Euler, one step at a time."""
    states, dt = [start], interval / euler_steps
    for output in range(outputs - 1):
        state = states[-1]
        for step in range(euler_steps):
            rate = matrix @ state
            if amplitude is not None:
                time = np.array([output * interval + step * dt])
                rate = rate + force * amplitude(t=time)
            state = state + dt * rate
        states.append(state)
    return np.array(states)


@st.composite
def models(draw):
    """Pairs and singles, or a block of all coordinates; the force on them; where they start."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    if draw(st.booleans()):
        size = draw(st.integers(3, 8))
        coupling = rng.uniform(-9, 9, (size, size))
        loss = rng.uniform(0, 1, (size, size))
        blocks, singles = (coupling - coupling.T - loss @ loss.T)[None], 0
    else:
        pairs, singles = draw(st.integers(0, 4)), draw(st.integers(0, 3))
        rates = zip(rng.uniform(0, 20, pairs), rng.choice([0, 1, 10, 50], pairs), strict=True)
        blocks = np.concatenate([oscillators(*rates).reshape(-1, 2, 2), np.zeros((singles, 2, 2))])
        # Nothing but the first entry of a single coordinate counts.
        blocks[pairs:] = rng.uniform(-5, 0, (singles, 2, 2))
        if not pairs + singles:
            blocks, singles = oscillators((1, 1)), 0
    shape = (1, len(blocks[0])) if blocks.shape[-1] > 2 else (len(blocks), 2)
    force = rng.standard_normal(shape) * rng.choice([0, 1], shape)
    start = rng.standard_normal(len(whole(blocks, singles)))
    return blocks, singles, force, start


@pytest.mark.parametrize("outputs", [1, 2, 3, 100, 511, 512, 513, 1301])
def test_oscillators_swing_as_their_equations_say(outputs):
    """Pairs, singles and one block, at every output of any number of them."""
    blocks = np.concatenate([oscillators(*OSCILLATORS.values()), np.zeros((2, 2, 2))])
    blocks[-2:, 0, 0] = -2, 0
    matrix, interval = whole(blocks, 2), 0.01
    start = np.random.default_rng(0).standard_normal(len(matrix))
    found = run(blocks, 2, np.zeros((8, 2)), start, interval, outputs)
    block = run(matrix[None], 0, np.zeros((1, 14)), start, interval, outputs)
    for row in range(outputs):
        expected = expm(row * interval * matrix) @ start
        np.testing.assert_allclose(found[row], expected, rtol=0, atol=1e-12)
        np.testing.assert_allclose(block[row], expected, rtol=0, atol=1e-12)


@settings(deadline=None, max_examples=60)
@given(models(), st.floats(1e-3, 0.1), st.integers(1, 700), st.data())
def test_jumps_are_the_exponential_at_any_time(model, interval, outputs, data):
    blocks, singles, force, start = model
    found = run(blocks, singles, force, start, interval, outputs)
    row = data.draw(st.integers(0, outputs - 1))
    expected = expm(row * interval * whole(blocks, singles)) @ start
    np.testing.assert_allclose(found[row], expected, rtol=0, atol=1e-11)


@settings(deadline=None, max_examples=60)
@given(models(), st.floats(0.1, 200), st.floats(2e-3, 0.05), st.integers(1, 200))
def test_a_smooth_force_is_answered_exactly(model, frequency, interval, outputs):
    """The force cos(νt) is a coordinate of a larger system without a force."""
    blocks, singles, force, start = model
    found = run(blocks, singles, force, start, interval, outputs, wave(frequency))
    size = start.size
    larger = np.zeros((size + 2, size + 2))
    larger[:size, :size] = whole(blocks, singles)
    larger[:size, size] = push(blocks, singles, force)
    larger[size, size + 1], larger[size + 1, size] = -frequency, frequency
    state, jump = np.concatenate([start, [1, 0]]), expm(interval * larger)
    expected = [state]
    for _ in range(outputs - 1):
        expected.append(jump @ expected[-1])
    np.testing.assert_allclose(found, np.array(expected)[:, :size], rtol=0, atol=1e-11)


@pytest.mark.parametrize("name", ["constant", "slow", "fast"])
def test_a_force_on_oscillators_acts_as_scipy_integrates_it(name):
    blocks, amplitude = oscillators(*OSCILLATORS.values()), FORCES[name]
    force = np.array([[1, 0], [0, 1], [1, 2], [1, 0], [3, 0], [0, 0]], dtype=float)
    matrix, vector = whole(blocks, 0), push(blocks, 0, force)
    start = np.linspace(-1, 1, 12)
    found = run(blocks, 0, force, start, 0.05, 21, amplitude)
    truth = solve_ivp(
        lambda t, y: matrix @ y + vector * amplitude(t=np.array([t])),
        (0, 1),
        start,
        method="DOP853",
        t_eval=np.arange(21) * 0.05,
        rtol=1e-12,
        atol=1e-13,
    )
    np.testing.assert_allclose(found, truth.y.T, rtol=0, atol=1e-10)
    block = run(matrix[None], 0, vector[None], start, 0.05, 21, amplitude)
    np.testing.assert_allclose(block, found, rtol=0, atol=1e-13)


@pytest.mark.parametrize("frequency", range(5, 200, 5))
def test_no_panel_is_too_long_for_its_force(frequency):
    block, interval, outputs = np.zeros((1, 2, 2)), 0.02, 61
    found = run(
        block, 1, np.array([[1.0, 0]]), np.zeros(1), interval, outputs,
        wave(frequency),
    )  # fmt: skip
    expected = np.sin(frequency * interval * np.arange(outputs)) / frequency
    np.testing.assert_allclose(found[:, 0], expected, rtol=0, atol=1e-13)


def test_a_force_is_evaluated_at_few_times():
    """And nowhere in a run where it jumps."""
    blocks, force = oscillators((7, 1)), np.array([[[1.0, 0]]])
    for name, euler_steps, panels, rough in (
        ("constant", 0, 1, []),
        ("slow", 5, 1, []),
        ("jump", 0, 10, range(40, 50)),
        ("jump", 5, 10, range(40, 50)),
    ):
        courses = follow(0.01, 101, FORCES[name])
        jumps = propagator.prepare(blocks, 0, force, 0.01, 101, courses, euler_steps)
        assert jumps.nodes.shape == (panels, NODES)
        np.testing.assert_array_equal(jumps.rough, rough)


def test_a_force_of_thousands_of_periods_is_smooth_to_what_its_times_allow():
    """Rounding of t alone changes it by more than 1e-12; that makes no interval rough."""
    outputs, interval, frequency = 5001, 1e-3, 3000
    courses = follow(interval, outputs, wave(frequency))
    block, force = np.zeros((1, 2, 2)), np.array([[[1.0, 0]]])
    jumps = propagator.prepare(block, 1, force, interval, outputs, courses)
    assert jumps.rough.size == 0
    state = np.zeros((1, outputs))
    jumps.run(state)
    expected = np.sin(frequency * interval * np.arange(outputs)) / frequency
    np.testing.assert_allclose(state[0], expected, rtol=0, atol=1e-10)


@settings(deadline=None, max_examples=60)
@given(
    models(), st.sampled_from([None, *FORCES]), st.floats(1e-3, 0.03), st.integers(1, 40),
    st.integers(1, 12),
)  # fmt: skip
def test_a_jump_repeats_explicit_euler(model, name, interval, outputs, euler_steps):
    """Whatever the force, even one that jumps."""
    blocks, singles, force, start = model
    amplitude = FORCES[name] if name else None
    found = run(blocks, singles, force, start, interval, outputs, amplitude, euler_steps)
    expected = step_by_step(
        whole(blocks, singles), push(blocks, singles, force), start, interval, outputs,
        amplitude, euler_steps,
    )  # fmt: skip
    size = max(1, np.abs(expected).max())
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * size)


@pytest.mark.parametrize("outputs", [2, 300, 1000, 1301])
@pytest.mark.parametrize("name", [None, *FORCES])
def test_many_jumps_repeat_explicit_euler(name, outputs):
    blocks = np.concatenate([oscillators(*OSCILLATORS.values()), np.zeros((1, 2, 2))])
    blocks[-1, 0, 0] = -2
    force = np.zeros((7, 2))
    force[[0, 3, 6], 0], force[1, 1] = (1, 2, 3), 4
    amplitude, start = FORCES[name] if name else None, np.linspace(1, 2, 13)
    found = run(blocks, 1, force, start, 0.005, outputs, amplitude, 5)
    matrix, vector = whole(blocks, 1), push(blocks, 1, force)
    expected = step_by_step(matrix, vector, start, 0.005, outputs, amplitude, 5)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    block = run(matrix[None], 0, vector[None], start, 0.005, outputs, amplitude, 5)
    np.testing.assert_allclose(block, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("euler_steps", [24, 60, 1000])
def test_a_jump_of_many_steps_repeats_them_under_a_rough_force(euler_steps):
    blocks, force, start = oscillators((7, 1.5)), np.array([[1.0, 0]]), np.ones(2)
    found = run(blocks, 0, force, start, 0.05, 15, FORCES["jump"], euler_steps)
    expected = step_by_step(blocks[0], force[0], start, 0.05, 15, FORCES["jump"], euler_steps)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def test_jumps_can_be_run_again():
    blocks, force = oscillators((7, 1), (3, 0)), np.array([[1.0, 0], [0, 0]])
    courses = follow(0.01, 101, FORCES["slow"])
    jumps = propagator.prepare(blocks, 0, force[None], 0.01, 101, courses)
    states = np.zeros((2, 4, 101))
    states[:, :, 0] = 1
    for state in states:
        jumps.run(state)
    np.testing.assert_array_equal(*states)


def test_the_closed_exponential_is_that_of_matrices():
    rng = np.random.default_rng(3)
    pairs = rng.standard_normal((60, 2, 2))
    # Oscillators below, at and above critical damping, at rest, and single coordinates.
    for n, (omega, damping) in enumerate([(2, 0), (2, 3), (2, 4), (2, 5), (1e-9, 0), (0, 0)]):
        pairs[n] = [[-damping, omega], [-omega, 0]]
    pairs[10:20, 0, 1] = pairs[10:20, 1, 0] = pairs[10:20, 1, 1] = 0
    for duration in (1e-3, 0.7, 5):
        expected = expm(duration * pairs)
        size = np.abs(expected).max(axis=(1, 2), keepdims=True)
        found = propagator._exponential(pairs, duration)
        np.testing.assert_allclose(found / size, expected / size, atol=2e-13)


def test_an_oscillation_keeps_its_length_through_many_turns():
    block = np.array([[[0.0, 131.7], [-131.7, 0.0]]])
    jump = propagator._exponential(block, 1.0)[0]
    assert np.linalg.norm(np.linalg.matrix_power(jump, 1000) @ [1, 0]) == pytest.approx(
        1, abs=5e-13
    )
