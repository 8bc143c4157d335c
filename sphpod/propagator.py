"""Linear models with constant coefficients, carried from output to output in one jump each.

A model falls apart into pairs of coordinates and single ones,

    α' = m11 α + m12 β + g f(t),    β' = m21 α + m22 β + h f(t),

such as damped oscillators with α' = -d α + σ β, β' = -σ α, the normal modes of a lifted model. All
pairs share the output interval, so a jump is a 2×2 matrix a pair, made once: by the exponential,
which is exact in time, or as the power that repeats explicit Euler steps. A model that does not
fall apart well is one block of all its coordinates.

What a force adds from one output to the next is linear in the force. Its values at a few nodes of a
panel of many outputs determine it there to rounding, so vectors made once turn them into all the
panel's increments by one matrix product, and the force is evaluated nowhere else.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.polynomial import legendre

from sphpod.compiled import compiled

PANEL_NODES = 24
"""Values of the force that determine it on a panel; more outputs share a panel of a slow force."""

PANEL_ACCURACY = 1e-12
"""Largest part of a force that its polynomial on a panel may miss; its own rounding is not far."""

BLOCK = 512
"""Outputs of a pair that are carried together; few enough for the processor's nearest cache."""

Amplitude = Callable[[np.ndarray], np.ndarray]


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
    nodes : array, shape (panels, nodes)
        Times at which the force is evaluated [s].
    responses : array, shape (forced coordinates, nodes, outputs of a panel)
        What the force at each node adds to each forced coordinate from output to output.
    """

    powers: np.ndarray
    singles: int
    forced: np.ndarray
    nodes: np.ndarray
    responses: np.ndarray

    def run(self, state: np.ndarray, amplitude: Amplitude | None = None) -> None:
        """Fill the outputs.

        Parameters
        ----------
        state : array, shape (coordinates, outputs)
            All α, those of pairs first, then all β; or those of the one block. The first column is
            the start.
        amplitude : callable, optional
            Force f at times [s]; needed where a coordinate is forced.
        """
        increments = np.zeros((0, 0))
        if self.nodes.size:
            values = amplitude(self.nodes.ravel()).reshape(self.nodes.shape)  # type: ignore[misc]
            increments = (values @ self.responses).reshape(len(self.responses), -1)
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
    amplitude: Amplitude | None = None,
    euler_steps: int = 0,
) -> Jumps:
    """Make the jumps of a model, and the responses to its force.

    Parameters
    ----------
    blocks : array, shape (n, 2, 2), or (1, s, s) of one block
        Matrix of each pair [1/s]; of the last ones, which are single coordinates, [0, 0] counts.
    singles : int
        How many of the n are single.
    force : array, shape (n, 2) or (1, s)
        g and h; zero where a coordinate is not forced.
    interval : float
        Time from output to output [s].
    outputs : int
        Number of outputs, the start included.
    amplitude : callable, optional
        Force f at times [s], None without one. It decides how many outputs share a panel.
    euler_steps : int
        Explicit Euler steps from output to output that a jump repeats; 0 for jumps exact in time.
    """
    blocks = blocks.copy()
    for single in range(len(blocks) - singles, len(blocks)):
        blocks[single] = np.diag([blocks[single, 0, 0], 0])
    powers = [_jump(blocks, interval, euler_steps)]
    while 2 ** len(powers) < min(outputs, BLOCK):
        powers.append(powers[-1] @ powers[-1])
    forced = np.full(force.shape, -1)
    nodes, responses = np.zeros((0, 0)), np.zeros((0, 0, 0))
    if amplitude is not None and np.any(force):
        # Within an interval the force on one coordinate of a block reaches the others too.
        felt = np.repeat(force.any(axis=1, keepdims=True), force.shape[1], axis=1)
        felt[len(felt) - singles :, 1] = False
        forced[felt] = np.arange(np.count_nonzero(felt))
        panel, inside = _panels(amplitude, interval, outputs - 1, euler_steps)
        panels = np.arange((outputs - 1) // panel) * (panel * interval)
        nodes = panels[:, None] + inside
        responses = _responses(blocks, force, felt, interval, panel, inside, euler_steps)
    return Jumps(np.array(powers), singles, forced, nodes, responses)


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


def _panels(amplitude, interval, intervals, euler_steps):
    """Outputs of the longest panel on which a polynomial is the force, and its nodes.

    Where the force is too rough for any panel, the nodes are the times of the Euler steps between
    two outputs, which lose nothing, or Gauss points of that interval.
    """
    points, _ = legendre.leggauss(PANEL_NODES)
    checks = (points[:-1] + points[1:]) / 2
    interpolation = _interpolation(points, checks)
    for panel in sorted((n for n in range(1, intervals + 1) if intervals % n == 0), reverse=True):
        length = panel * interval
        starts = np.arange(intervals // panel)[:, None] * length
        values = amplitude((starts + length * (points + 1) / 2).ravel()).reshape(-1, PANEL_NODES)
        between = amplitude((starts + length * (checks + 1) / 2).ravel()).reshape(-1, checks.size)
        missed = np.abs(values @ interpolation.T - between).max()
        if missed <= PANEL_ACCURACY * np.abs(values).max():
            return panel, length * (points + 1) / 2
    if euler_steps:
        return 1, _euler_times(interval, euler_steps)
    return 1, interval * (points + 1) / 2


def _interpolation(nodes, times):
    """Matrix (times, nodes) from a polynomial's values at the nodes to those at other times."""
    from scipy.interpolate import BarycentricInterpolator

    # The seed is that of the order in which it multiplies, which rounding depends on.
    return BarycentricInterpolator(nodes, np.eye(nodes.size), rng=0)(times)


def _responses(blocks, force, felt, interval, panel, nodes, euler_steps):
    """What the force at each node adds to each forced coordinate over each interval of a panel."""
    if euler_steps:
        fractions = _euler_times(1, euler_steps)
        weights = np.full(euler_steps, interval / euler_steps)
        remaining = [_jump_steps(blocks, interval, euler_steps, s) for s in range(euler_steps)]
    else:
        points, weights = legendre.leggauss(PANEL_NODES)
        fractions, weights = (points + 1) / 2, interval / 2 * weights
        remaining = [_jump(blocks, interval * (1 - c), 0) for c in fractions]
    # What a force at each of these times within an interval has become at its end.
    parts = [w * (r @ force[:, :, None])[..., 0] for w, r in zip(weights, remaining, strict=True)]
    times = interval * (np.arange(panel)[:, None] + fractions)
    if np.array_equal(nodes, times.ravel()):
        # No polynomial through many times that are evenly spaced, which magnifies rounding.
        to_times = np.eye(nodes.size)
    else:
        scale = 2 / (panel * interval)
        to_times = _interpolation(scale * nodes - 1, (scale * times - 1).ravel())
    shape = panel, fractions.size, nodes.size
    return np.einsum("pcq,cf->fqp", to_times.reshape(shape), np.array(parts)[:, felt])


def _euler_times(interval, euler_steps):
    """Times at which the explicit Euler steps of an interval begin."""
    return interval * (np.arange(euler_steps) / euler_steps)


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
