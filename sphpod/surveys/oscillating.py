"""The bound of a query's error where nothing pushes and damping is the same everywhere.

The bound is (2) of `sphpod.reduced.error_bound`, of the plain residual. Under uniform damping d the
residual of velocity is of stress alone, as Φᵀ a' + d Φᵀ a = -Φᵀ M⁻¹ Lᵀ b, and that of stress of
velocity alone: two factors of a quarter of the size of the whole one's. What both should not
depend on is rounding, and is added as it is.

Within a step δ of the grid the residual's second derivative is at most β = Σ |r_j| |z_j''|, over
the oscillators j with columns r_j, as no |z_j''| grows. With norms y at the ends of a step,

    ∫|r| ≤ δ (y₀ + y₁)/2 + β δ³/12,    √∫|r|² ≤ √(δ (y₀² + y₀y₁ + y₁²)/3) + β √(δ⁵/120).

The grid is refined until β matters little.
"""

from typing import Any

import numpy as np

from sphpod.numerics import propagator
from sphpod.reduced.error_bound import COARSEST, EXCESS, FINEST, ROUNDING, follow


def oscillating_bound(
    query: Any, velocity: np.ndarray, stress: np.ndarray, beside: float, size: float
) -> np.ndarray:
    """Bound of the energy norm of the error at the outputs, (times,).

    Parameters
    ----------
    query : Query
        Without a force, and of uniform damping.
    velocity, stress : arrays, shape (rows, coordinates)
        Residuals by own coordinates.
    beside : float
        Energy norm of the initial velocity that the modes do not hold.
    size : float
        Energy norm at t = 0, below a part of which nothing is worth refining.
    """
    count = len(query.own.blocks)
    rounding = np.linalg.norm(velocity[:, :count]) + np.linalg.norm(stress[:, count:])
    factors = [
        np.asarray(np.linalg.qr(columns, mode="r"))
        for columns in (velocity[:, count:], stress[:, :count])
    ]
    duration, steps = query.scene.duration, COARSEST
    while True:
        bound, straight = _on_grid(query, factors, beside, steps)
        missing = (bound - straight).max() / (EXCESS * straight.max() + ROUNDING * size + 1e-300)
        if not missing > 1 or steps >= FINEST:
            break
        # What is not known falls as the square of the step.
        steps = min(FINEST, steps * 2 ** int(np.ceil(np.log2(np.clip(missing, 4, 1024)) / 2)))
    times = query.times
    # Within a step the bound is that of its end.
    place = np.minimum(np.ceil(times * (steps / duration) * (1 - 1e-15)).astype(int), steps)
    return bound[place] + rounding * np.linalg.norm(query.own_start) * times


def _on_grid(query, factors, beside, steps):
    """The bound at the times of a grid, and it if the residual were linear within the steps."""
    own, step, count = query.own, query.scene.duration / steps, len(query.own.blocks)
    state = np.zeros((len(query.own_start), steps + 1))
    state[:, 0] = query.own_start
    still = np.zeros((1, count, 2))
    propagator.prepare(own.blocks, own.singles, still, step, steps + 1).run(state)
    first, second = state[:count], state[count:]
    norms = [
        np.sqrt(np.einsum("ij,ij->j", moved, moved))
        for moved in (factors[0] @ second, factors[1] @ first)
    ]
    bends = [size[:-1] @ columns for size, columns in _bends(own, first, second, factors)]
    whole = np.hypot(*norms)
    damping = query.uniform if (query.uniform or 0) * query.scene.duration >= 1 else None

    def bounded(velocity_bend, stress_bend):
        integral = _integral(step, whole, np.hypot(velocity_bend, stress_bend))
        squares, rests = np.full((2, steps), np.inf)
        if damping:
            squares = _square(step, norms[0], velocity_bend) / (4 * damping)
            rests = _integral(step, norms[1], stress_bend)
        bound = np.empty(steps + 1)
        follow(beside, integral, squares, rests, bound)
        return bound

    straight = np.zeros(steps)
    return bounded(*bends), bounded(straight, straight)


def _bends(own, first, second, factors):
    """Of each oscillator |z''| at the times of the grid (steps + 1, n), and its columns' norms."""
    pairs, blocks = len(second), own.blocks
    once = blocks @ blocks
    length = np.abs(once[:, 0, 0, None] * first)
    alpha = once[:pairs, 0, 0, None] * first[:pairs] + once[:pairs, 0, 1, None] * second
    beta = once[:pairs, 1, 0, None] * first[:pairs] + once[:pairs, 1, 1, None] * second
    length[:pairs] = np.hypot(alpha, beta)
    columns = [np.linalg.norm(factor, axis=0) for factor in factors]
    return (length[:pairs].T, columns[0]), (length.T, columns[1])


def _integral(step, norms, bends):
    return step / 2 * (norms[:-1] + norms[1:]) + step**3 / 12 * bends


def _square(step, norms, bends):
    first, last = norms[:-1], norms[1:]
    even = np.sqrt(step / 3 * (first**2 + first * last + last**2))
    return (even + np.sqrt(step**5 / 120) * bends) ** 2
