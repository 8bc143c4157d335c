"""The bound of a query's error where nothing pushes and damping is the same everywhere.

The bound is (2) of `sphpod.reduced.error_bound`. The residual is of velocity, and under uniform
damping of displacements β alone, as Φᵀ a' + d Φᵀ a = -Φᵀ M⁻¹ K q.

Within a step δ of the grid the residual's second derivative is at most β = Σ |r_j| |z_j''|, over
the oscillators j with columns r_j, where |z_j''| is what it is at most from the step's beginning
on. With norms y at the ends of a step,

    ∫|r| ≤ δ (y₀ + y₁)/2 + β δ³/12,    √∫|r|² ≤ √(δ (y₀² + y₀y₁ + y₁²)/3) + β √(δ⁵/120).

The grid is refined until β matters little.
"""

from typing import Any

import numpy as np

from sphpod.numerics import propagator
from sphpod.reduced.error_bound import COARSEST, EXCESS, FINEST, ROUNDING, follow


def oscillating_bound(query: Any, residual: np.ndarray, beside: float, size: float) -> np.ndarray:
    """Bound of the energy norm of the error at the outputs, (times,).

    Parameters
    ----------
    query : Query
        Without a force, and of uniform damping.
    residual : array, shape (rows, pairs)
        By own coordinates of displacements.
    beside : float
        Energy norm of the initial state that the modes do not hold.
    size : float
        Energy norm at t = 0, below a part of which nothing is worth refining.
    """
    factor = np.asarray(np.linalg.qr(residual, mode="r"))
    duration, steps = query.scene.duration, COARSEST
    while True:
        bound, straight = _on_grid(query, factor, beside, steps)
        missing = (bound - straight).max() / (EXCESS * straight.max() + ROUNDING * size + 1e-300)
        if not missing > 1 or steps >= FINEST:
            break
        # What is not known falls as the square of the step.
        steps = min(FINEST, steps * 2 ** int(np.ceil(np.log2(np.clip(missing, 4, 1024)) / 2)))
    times = query.times
    # Within a step the bound is that of its end.
    place = np.minimum(np.ceil(times * (steps / duration) * (1 - 1e-15)).astype(int), steps)
    return bound[place]


def _on_grid(query, factor, beside, steps):
    """The bound at the times of a grid, and it if the residual were linear within the steps."""
    own, step, count = query.own, query.scene.duration / steps, len(query.own.blocks)
    state = np.zeros((len(query.own_start), steps + 1))
    state[:, 0] = query.own_start
    still = np.zeros((1, count, 2))
    propagator.prepare(own.blocks, own.singles, still, step, steps + 1).run(state)
    moved = factor @ state[count:]
    norms = np.sqrt(np.einsum("ij,ij->j", moved, moved))
    fading, lasting = np.linalg.norm(factor, axis=0) @ most_bends(query)
    bends = lasting + fading * np.exp(-(query.uniform or 0) / 2 * step * np.arange(steps))
    lasts = (query.uniform or 0) * query.scene.duration >= 1

    def bounded(bends):
        squares = np.full(steps, np.inf)
        if lasts:
            squares = _square(step, norms, bends) / (4 * query.uniform)
        bound = np.empty(steps + 1)
        follow(beside, _integral(step, norms, bends), squares, np.zeros(steps), bound)
        return bound

    return bounded(bends), bounded(np.zeros(steps))


def most_bends(query):
    """What |z''| of each oscillator is at most: the first times exp(-d t/2), and the second.

    z'' moves as z does: it fades as exp(-d t/2) where it swings, and grows nowhere.

    Returns
    -------
    array, shape (pairs, 2)
    """
    own, start = query.own, query.own_start
    pairs = len(start) - len(own.blocks)
    decay, frequency = (query.uniform or 0) / 2, own.blocks[:pairs, 0, 1]
    rate = -frequency * start[:pairs]
    bend = -2 * decay * rate - frequency**2 * start[len(own.blocks) :]
    turn = -2 * decay * bend - frequency**2 * rate
    swings = frequency > 2 * decay
    swing = np.sqrt(np.where(swings, frequency**2 - decay**2, 1))
    size = np.hypot(bend, np.where(swings, (turn + decay * bend) / swing, turn / frequency))
    return np.stack([size * swings, size * ~swings], axis=1)


def _integral(step, norms, bends):
    return step / 2 * (norms[:-1] + norms[1:]) + step**3 / 12 * bends


def _square(step, norms, bends):
    first, last = norms[:-1], norms[1:]
    even = np.sqrt(step / 3 * (first**2 + first * last + last**2))
    return (even + np.sqrt(step**5 / 120) * bends) ** 2
