"""Linear models with constant coefficients, carried from output to output in one jump each.

A model falls apart into pairs of coordinates and single ones,

    α' = m11 α + m12 β + g f(t),    β' = m21 α + m22 β + h f(t),

such as damped oscillators with α' = -d α + σ β, β' = -σ α, the normal modes of a lifted model. All
pairs share the output interval, so a jump is a 2×2 matrix a pair, made once: by the exponential,
which is exact in time, or as the power that repeats explicit Euler steps. A model that does not
fall apart well is one block of all its coordinates.

What a force adds from one output to the next is linear in the force. Where it is proved to be a
polynomial on a panel of many outputs (`sphpod.numerics.course`), its values at a few nodes
determine it, so vectors made once turn them into all the panel's increments by one matrix product,
and the force is evaluated nowhere else. Where it is not, as where it jumps, only its part that is a
polynomial on an interval does anything, as the response of the model is one; explicit Euler takes
its own times.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from sphpod.numerics.compiled import compiled
from sphpod.numerics.course import NODES, POINTS, WEIGHTS, Course
from sphpod.numerics.expressions import Expression

PANEL_ACCURACY = 1e-12
"""Largest part of a force's mean that its polynomial on a panel may miss."""

ROUGH = 0.1
"""Largest part of the outputs that may lie in panels on which the force is no polynomial."""

TURN = 8.0
"""Largest size of a model's operator times an interval on which its response is a polynomial."""

VALUES = 2**22
"""Increments made at once, where the force is rough."""

BESIDE = 1e-9
"""Part of the largest force by which one is another at the start of an interval."""

BLOCK = 512
"""Outputs of a pair that are carried together; few enough for the processor's nearest cache."""


@dataclass(frozen=True)
class Jumps:
    """From output to output of one model, prepared.

    Attributes
    ----------
    powers : array, shape (doublings, n, 2, 2), or (doublings, 1, s, s) of one block
        Matrices of each pair that carry it by 1, 2, 4, … outputs; of a single coordinate, which
        are the last, only [0, 0] counts.
    singles : int
        How many of the n are single coordinates.
    forced : int array, shape (n, 2) or (1, s)
        Row of the increments for each coordinate, -1 where it does not feel the force.
    amplitudes : tuple of Expressions
        Time factor of each term of the force.
    nodes : array, shape (panels, nodes)
        Times at which the force is evaluated [s].
    responses : array, shape (forced coordinates, terms × nodes, outputs of a panel)
        What each term at each node adds to each forced coordinate from output to output.
    rough : int array, shape (intervals,)
        Intervals between outputs whose increments do not come from the panels.
    increments : array, shape (forced coordinates, intervals)
        What the force adds over each of those.
    """

    powers: np.ndarray
    singles: int
    forced: np.ndarray
    amplitudes: tuple[Expression, ...]
    nodes: np.ndarray
    responses: np.ndarray
    rough: np.ndarray
    increments: np.ndarray

    def run(self, state: np.ndarray) -> None:
        """Fill the outputs.

        Parameters
        ----------
        state : array, shape (coordinates, outputs)
            All α, those of pairs first, then all β; or those of the one block. The first column is
            the start.
        """
        increments = self.increments
        if self.nodes.size:
            times = self.nodes.ravel()
            values = [f(t=times).reshape(self.nodes.shape) for f in self.amplitudes]
            by_panel = np.concatenate(values, axis=1) @ self.responses
            increments = by_panel.reshape(len(self.responses), -1)
            increments[:, self.rough] = self.increments
        if self.powers.shape[-1] > 2:
            march_dense(self.powers[0, 0], increments, state)
        else:
            count = len(self.forced)
            march_pairs(self.powers, self.forced, increments, state[:count], state[count:])


def prepare(
    blocks: np.ndarray,
    singles: int,
    force: np.ndarray,
    interval: float,
    outputs: int,
    courses: tuple[Course, ...] = (),
    euler_steps: int = 0,
) -> Jumps:
    """Make the jumps of a model, and the responses to its force.

    Parameters
    ----------
    blocks : array, shape (n, 2, 2), or (1, s, s) of one block
        Matrix of each pair [1/s]; of the last ones, which are single coordinates, [0, 0] counts.
    singles : int
        How many of the n are single.
    force : array, shape (terms, n, 2) or (terms, 1, s)
        g and h of each term; zero where a coordinate is not forced.
    interval : float
        Time from output to output [s].
    outputs : int
        Number of outputs, the start included.
    courses : tuple of Courses
        Time factor f of each term; none without a force.
    euler_steps : int
        Explicit Euler steps from output to output that a jump repeats; 0 for jumps exact in time.
    """
    blocks = blocks.copy()
    for single in range(len(blocks) - singles, len(blocks)):
        blocks[single] = np.diag([blocks[single, 0, 0], 0])
    powers = [_jump(blocks, interval, euler_steps)]
    while 2 ** len(powers) < min(outputs, BLOCK):
        powers.append(powers[-1] @ powers[-1])
    forced = np.full(force.shape[1:], -1)
    nodes, responses = np.zeros((0, 0)), np.zeros((0, 0, 0))
    rough, increments = np.zeros(0, np.int64), np.zeros((0, 0))
    if courses and outputs > 1 and np.any(force):
        # Within an interval the force on one coordinate of a block reaches the others too.
        felt = np.repeat(np.any(force, axis=(0, 2), keepdims=True)[0], force.shape[2], axis=1)
        felt[len(felt) - singles :, 1] = False
        forced[felt] = np.arange(np.count_nonzero(felt))
        moved = felt[:, 0]
        blocks, force, felt = blocks[moved], force[:, moved], felt[moved]
        panel, starts, rough = _panels(courses, interval, outputs - 1)
        if euler_steps:
            rough = np.union1d(rough, _breaking(courses, interval * np.arange(outputs - 1)))
        if rough.size < outputs - 1:
            nodes = starts[:, None] + panel * interval * ((POINTS + 1) / 2)
            responses = _responses(blocks, force, felt, interval, panel, euler_steps)
        increments = _increments(blocks, force, courses, rough, interval, euler_steps)[:, felt].T
    amplitudes = tuple(course.expression for course in courses)
    return Jumps(np.array(powers), singles, forced, amplitudes, nodes, responses, rough, increments)


def _jump(blocks, duration, euler_steps):
    """Exponential of each block, or the power that repeats so many explicit Euler steps."""
    if euler_steps:
        step = np.eye(blocks.shape[-1]) + duration / euler_steps * blocks
        return np.linalg.matrix_power(step, euler_steps)
    if blocks.shape[-1] > 2:
        return scipy.linalg.expm(duration * blocks)
    return _exponential(blocks, duration)


def _exponential(pairs, duration):
    """exp(tM) of 2×2 matrices in closed form, (n, 2, 2).

    With the mean μ of the eigenvalues and q = μ² - det M it is e^(μt) (C + S (M - μ)), where C and
    S are cosh and sinh/√q of √q t; cos and sin/√-q if q is negative. The length of an oscillation
    so keeps to the last digit through any number of turns, which scaling and squaring would not.
    """
    mean = (pairs[:, 0, 0] + pairs[:, 1, 1]) / 2
    deviation = pairs.copy()
    deviation[:, 0, 0] -= mean
    deviation[:, 1, 1] -= mean
    # q = μ² - det M, of which nothing cancels in M - μ.
    q = deviation[:, 0, 0] ** 2 + pairs[:, 0, 1] * pairs[:, 1, 0]
    root = np.sqrt(np.abs(q))
    angle = root * duration
    real = q > 0
    # Of cosh and sinh the growing half, by the slower of the two rates; e^(μt) alone if they turn.
    size = np.exp((mean + np.where(real, root, 0)) * duration)
    fall = np.where(real, np.expm1(-2 * angle), 0)
    even = np.where(real, 1 + fall / 2, np.cos(angle))
    small = angle < 1e-8
    odd = np.where(real, -fall / 2, np.sin(angle)) / np.where(small, 1, root)
    odd = np.where(small, duration, odd)
    result = size[:, None, None] * (
        even[:, None, None] * np.eye(2) + odd[:, None, None] * deviation
    )
    # Coordinates that do not meet keep all digits of their decay.
    apart = np.flatnonzero((pairs[:, 0, 1] == 0) & (pairs[:, 1, 0] == 0))
    for n in (0, 1):
        result[apart, n, n] = np.exp(duration * pairs[apart, n, n])
    return result


def _panels(courses, interval, intervals):
    """The longest panels, in outputs, on which the force is a polynomial but for few of them.

    Returns
    -------
    panel : int
    starts : array, shape (panels,)
        [s].
    rough : int array
        Intervals between outputs in the panels on which it is not.
    """
    for panel in sorted((n for n in range(1, intervals + 1) if intervals % n == 0), reverse=True):
        edges = np.arange(intervals // panel + 1) * (panel * interval)
        smooth = np.ones(intervals // panel, bool)
        for course in courses:
            smooth[np.clip(np.searchsorted(edges, course.breaks) - 1, 0, smooth.size - 1)] = False
        if panel > 1 and np.count_nonzero(~smooth) > ROUGH * smooth.size:
            continue
        for course in courses:
            # Nearer than the course itself is known, as its times are rounded, nothing can be.
            known = course.missed if np.isfinite(course.missed) else 0
            limit = max(PANEL_ACCURACY * course.total, known) / (intervals * interval)
            smooth &= course.departures(edges[:-1], edges[1:]) <= limit
            if panel > 1 and np.count_nonzero(~smooth) > ROUGH * smooth.size:
                break
        if np.count_nonzero(~smooth) <= ROUGH * smooth.size:
            break
    return panel, edges[:-1], np.flatnonzero(np.repeat(~smooth, panel))


def _breaking(courses, starts):
    """Intervals at whose very start the force is not what it is within, as a step there sees it."""
    unlike = np.zeros(starts.size, bool)
    for course in courses:
        values = course.expression(t=starts)
        unlike |= np.abs(course(starts) - values) > BESIDE * np.abs(values).max()
    return np.flatnonzero(unlike)


def _interpolation(nodes, times):
    """Matrix (times, nodes) from a polynomial's values at the nodes to those at other times."""
    from scipy.interpolate import BarycentricInterpolator

    # The seed is that of the order in which it multiplies, which rounding depends on.
    return BarycentricInterpolator(nodes, np.eye(nodes.size), rng=0)(times)


def _responses(blocks, force, felt, interval, panel, euler_steps):
    """What the force at each node adds to each forced coordinate over each interval of a panel."""
    fractions, parts = _parts(blocks, force, interval, euler_steps)
    if panel == 1 and not euler_steps:
        to_times = np.eye(NODES)
    else:
        times = (np.arange(panel)[:, None] + fractions) / panel
        to_times = _interpolation(POINTS, 2 * times.ravel() - 1)
    shape = panel, fractions.size, NODES
    shares = np.einsum("pcq,kcf->fkqp", to_times.reshape(shape), parts[:, :, felt])
    return shares.reshape(len(shares), -1, panel)


def _parts(blocks, force, interval, euler_steps):
    """What a force at some times within an interval has become at its end.

    Returns
    -------
    fractions : array, shape (times,)
        The times, in intervals.
    parts : array, shape (terms, times, n, 2) or (terms, times, 1, s)
    """
    if euler_steps:
        weight = interval / euler_steps
        remaining = [_jump_steps(blocks, interval, euler_steps, s) for s in range(euler_steps)]
        pushes = [weight * (r @ force[..., None])[..., 0] for r in remaining]
        return np.arange(euler_steps) / euler_steps, np.stack(pushes, axis=1)
    halvings = _halvings(blocks, interval)
    short, fractions = interval / 2**halvings, (POINTS + 1) / 2
    parts = np.stack(
        [
            short / 2 * w * (_jump(blocks, short * (1 - c), 0) @ force[..., None])[..., 0]
            for c, w in zip(fractions, WEIGHTS, strict=True)
        ],
        axis=1,
    )
    # Of twice the interval the first half is carried on through the second.
    first, second = (_interpolation(POINTS, (POINTS + end) / 2) for end in (-1, 1))
    for doubling in range(halvings):
        jump = _jump(blocks, short * 2**doubling, 0)
        carried = (jump @ parts[..., None])[..., 0]
        parts = sum(
            np.einsum("kc...,cq->kq...", part, to_half)
            for part, to_half in ((carried, first), (parts, second))
        )
    return fractions, parts


def _halvings(blocks, interval):
    """Of an interval, until the response of each block is a polynomial on it."""
    size = np.linalg.norm(blocks, 2, axis=(1, 2)).max() * interval
    return max(0, int(np.ceil(np.log2(max(size, TURN) / TURN))))


def _increments(blocks, force, courses, rough, interval, euler_steps):
    """What a rough force adds over intervals, shape (intervals, n, 2) or (intervals, 1, s)."""
    result = np.zeros((rough.size, *force.shape[1:]))
    halvings = 0 if euler_steps else _halvings(blocks, interval)
    short = interval / 2**halvings
    fractions, parts = _parts(blocks, force, short, euler_steps)
    jumps = [_jump(blocks, short * 2**doubling, 0) for doubling in range(halvings)]
    points = max(fractions.size, force[0].size) * 2**halvings
    chunk = max(1, VALUES // points)
    for first in range(0, rough.size, chunk):
        cells = rough[first : first + chunk, None] * 2**halvings + np.arange(2**halvings)
        cells = cells.ravel()
        added = np.zeros((cells.size, *force.shape[1:]))
        for course, part in zip(courses, parts, strict=True):
            if euler_steps:
                values = course.expression(t=interval * (cells[:, None] + fractions))
            else:
                values = course.projected(cells * short, (cells + 1) * short)
            added += np.tensordot(values, part, axes=1)
        for jump in jumps:
            earlier, later = added[::2], added[1::2]
            added = (jump @ earlier[..., None])[..., 0] + later
        result[first : first + chunk] = added
    return result


def _jump_steps(blocks, interval, euler_steps, done):
    """Explicit Euler from the step after ``done`` others to the end of the interval."""
    step = np.eye(blocks.shape[-1]) + interval / euler_steps * blocks
    return np.linalg.matrix_power(step, euler_steps - 1 - done)


@compiled
def carry(jump, a, b, new_a, new_b):
    """Jump with all outputs of a pair at once."""
    m11, m12, m21, m22 = jump[0, 0], jump[0, 1], jump[1, 0], jump[1, 1]
    for i in range(new_a.size):
        old_a, old_b = a[i], b[i]
        new_a[i] = m11 * old_a + m12 * old_b
        new_b[i] = m21 * old_a + m22 * old_b


@compiled
def carry_forced(jump, forced, increments, a, b):
    """Jump from output to output of a pair that feels the force."""
    for i in range(a.size - 1):
        a[i + 1] = jump[0, 0] * a[i] + jump[0, 1] * b[i]
        b[i + 1] = jump[1, 0] * a[i] + jump[1, 1] * b[i]
        if forced[0] >= 0:
            a[i + 1] += increments[forced[0], i]
        if forced[1] >= 0:
            b[i + 1] += increments[forced[1], i]


@compiled
def carry_single(factor, forced, increments, a):
    """Jump from output to output of a single coordinate."""
    if forced[0] >= 0:
        for i in range(a.size - 1):
            a[i + 1] = factor * a[i] + increments[forced[0], i]
    else:
        for i in range(a.size - 1):
            a[i + 1] = factor * a[i]


@compiled
def march_pairs(powers, forced, increments, first, second):
    """Fill the outputs of each pair; what it costs does not depend on the number of particles.

    Without a force, a pair's known outputs are carried behind themselves by one matrix, which
    doubles them up to a block that the next ones follow from: many outputs at once, with few
    roundings on the way to each.
    """
    pairs, outputs = second.shape
    for m in range(pairs, first.shape[0]):
        carry_single(powers[0, m, 0, 0], forced[m], increments, first[m])
    for m in range(pairs):
        a, b = first[m], second[m]
        if forced[m, 0] >= 0 or forced[m, 1] >= 0:
            carry_forced(powers[0, m], forced[m], increments, a, b)
            continue
        known = 1
        for doubling in range(powers.shape[0]):
            jump = powers[doubling, m]
            carry(jump, a[:known], b[:known], a[known : 2 * known], b[known : 2 * known])
            known *= 2
        block = known // 2
        while known < outputs:
            start, end = known - block, known + block
            carry(powers[-1, m], a[start:known], b[start:known], a[known:end], b[known:end])
            known = end


@compiled
def march_dense(jump, increments, state):
    """Jump from output to output of a model that is one block."""
    new, old = np.empty(state.shape[0]), state[:, 0].copy()
    for output in range(state.shape[1] - 1):
        for m in range(new.size):
            new[m] = increments[m, output] if increments.size else 0.0
        for n in range(new.size):
            for m in range(new.size):
                new[m] += jump[m, n] * old[n]
        for m in range(new.size):
            state[m, output + 1] = new[m]
            old[m] = new[m]
