"""A sharper bound of a query's error: that of its modes after they are corrected.

With displacements scaled to u = √(Vρ0) times theirs, velocity v = u' and strain s = √(Vc) e, the
line is v' = A s - d v + f, s = -Aᵀ u. Own modes of a reduced model with the operator M are U of the
displacement and W = U M of the velocity, if translation is left out, and leave in the velocity

    R = -A Aᵀ U - d W - W M.

Changed by X, and so W by X M, they leave R - A Aᵀ X - d X M - X M². The error is at most the energy
norm of that change and what is left adds up to (`sphpod.reduced.error_bound`, (1)). A wave of the
line that a mode drives off the wave's own frequency should go into X, and one that it drives in
resonance should be left. A shift by ρ tells them apart, where 1/ρ is how long the mode lasts.

**Even damping.** Of an oscillator q' = p, p' = -ω² q - d p the change X of q leaves R - (A Aᵀ - ω²)
X, whatever d is. The squares of that and of 2ρω X together are smallest for the real part of

    (A Aᵀ - λ²) X = R,    λ = ω + iρ,    but for ρ².

**Uneven damping.** For a complex mode of eigenvalue λ,

    (A Aᵀ + λ (λ + d)) X = R,    λ + ρ being written λ.

What is left is computed of X as it comes out, so that the bound holds however well that is solved.
Both are of the size of the particles (`Line`), or within what a few shared modes span, as large as
the model (`sphpod.surveys.corrections`).
"""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from sphpod.numerics.compiled import compiled_sums
from sphpod.surveys.driven import driven_bound
from sphpod.surveys.oscillating import oscillating_bound

SHIFTS = 1.0, 4.0
"""ρ of complex modes that are tried, of the rate at which a mode decays, or else of 1/T.

The larger one is the better where modes of nearly one frequency are not told apart.
"""

LEAST_SQUARES = 3.0
"""ρ of oscillators, of that of complex modes: its square is left, instead of itself."""


class Full(Protocol):
    """A full model, or as much as is known of it, in which the modes of a query are corrected.

    Attributes
    ----------
    start : array, shape (rows,)
        Scaled initial velocity.
    force : array, shape (rows, forces)
        Scaled profiles.
    damping : array, shape (rows,), or float
        d [1/s], as far as it is known by row; else 0.
    """

    start: np.ndarray
    force: np.ndarray
    damping: Any

    def rows(self, columns: np.ndarray) -> np.ndarray:
        """Columns of the velocity as those of the start are given, (rows, m)."""

    def rate(self, velocity: np.ndarray, displacement: np.ndarray) -> np.ndarray:
        """Rate of change of the velocity, (rows, m)."""

    def solved(self, right: np.ndarray, squares: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """X of (A Aᵀ + squares + rates d) X = right, of its own squares and rates a column."""

    def change(self, moved: np.ndarray, change: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Columns of velocity and strain, as long as these are, of what modes are changed by."""


@dataclass(frozen=True)
class Line:
    """The lifted full model at some values of the parameters, in scaled fields.

    Attributes
    ----------
    stretch : scipy.sparse array, shape (N, N)
        -Aᵀ [1/s].
    mass : array, shape (N,)
        √(Vρ0).
    damping : array, shape (N,), or float
        d [1/s].
    start : array, shape (N,)
        Scaled initial velocity.
    force : array, shape (N, forces)
        Scaled profiles.
    """

    stretch: Any
    mass: np.ndarray
    damping: np.ndarray | float
    start: np.ndarray
    force: np.ndarray

    def rows(self, columns: np.ndarray) -> np.ndarray:
        """Those of the particles."""
        return columns

    def rate(self, velocity: np.ndarray, displacement: np.ndarray) -> np.ndarray:
        """Rate of change of the velocity, of columns (N, m)."""
        pulled = self.stretch.T @ (self.stretch @ displacement)
        return -pulled - (self.damping * velocity.T).T

    def solved(self, right: np.ndarray, squares: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """X of (A Aᵀ + squares + rates d) X = right, (N, m); zero where that fails."""
        shifts = np.empty(right.shape[::-1], complex)
        shifts[:] = squares[:, None] + rates[:, None] * self.damping
        solved = np.array(right.T, complex, order="C")
        solve_shifted(*folded(self.stretch.T @ self.stretch), shifts, solved)
        return np.where(np.isfinite(solved).all(axis=1)[:, None], solved, 0).T

    def change(self, moved: np.ndarray, change: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Columns of velocity and strain of the particles."""
        return moved, self.stretch @ change


def corrected_bound(
    query: Any, full: Full, velocity: np.ndarray, displacement: np.ndarray, shift: float | None
) -> np.ndarray:
    """Bound of the energy norm of the error at the outputs, (times,).

    Parameters
    ----------
    query : Query
    full : Full
        Its full model.
    velocity, displacement : arrays, shape (columns, coordinates)
        Its own modes, scaled.
    shift : float or None
        One of `SHIFTS`; nothing is corrected without one.
    """
    own, push, z = query.own, query.push, query.own_start
    oscillates, count = query.uniform is not None and not query.courses, len(own.blocks)
    # The residual of oscillators is of displacements alone.
    left_in = slice(count if oscillates else 0, None)

    def left(velocity, displacement):
        turned = own.times_operator(velocity)[:, left_in]
        return full.rate(velocity[:, left_in], displacement[:, left_in]) - full.rows(turned)

    residual = left(velocity, displacement)
    changed: list[np.ndarray] = []
    beside = 0.0
    if shift is not None and own.blocks.shape[-1] == 2:
        change = correction(query, full, shift, residual)
        moved = own.times_operator(change)
        after, both = residual + left(moved, change), list(full.change(moved, change))
        if _promised(query, after, *both) < _promised(query, residual):
            residual, velocity, changed = after, velocity + moved, both
            beside = _norm(both[1] @ z)
    beside = float(np.hypot(beside, _norm(full.start - full.rows(velocity @ z[:, None])[:, 0])))
    size = _norm(full.start)
    if oscillates:
        state = query.state
        # Of oscillators velocity and strain are coordinates apart.
        parts = slice(count), slice(count, None)
        added = [
            np.linalg.norm(np.linalg.qr(columns[:, part], mode="r") @ state[part], axis=0)
            for columns, part in zip(changed, parts, strict=False)
        ]
        return oscillating_bound(query, residual, beside, size) + np.sqrt(
            sum(norms**2 for norms in added)
        )
    left_over = full.force - full.rows(velocity @ push)
    rows, damping = np.concatenate([residual, left_over], axis=1), full.damping
    sizes, whole = (size, _norm(full.force)), None
    if changed:
        whole = np.concatenate(changed)
        # The force moves the changed displacement at once, and no velocity does.
        jumps = np.linalg.qr(changed[1] @ push, mode="r")
        rows = np.concatenate([rows, np.pad(jumps, ((0, 0), (z.size, 0)))])
        damping = np.append(np.broadcast_to(damping, len(residual)), np.zeros(len(jumps)))
    return driven_bound(query, rows, damping, beside, sizes, whole)


def _promised(query, residual, *changes):
    """What a bound is about, of the sizes of coordinates alone."""
    sizes = np.abs(query.state)
    each = query.scene.duration * sizes.mean(axis=1)[-residual.shape[1] :]
    return _norm(residual * each) + sum(_norm(change * sizes.max(axis=1)) for change in changes)


def _norm(array):
    return float(np.linalg.norm(array))


def correction(query: Any, full: Full, shift: float, residual: np.ndarray) -> np.ndarray:
    """X of the residual R (rows, coordinates) of a query in pairs, (columns, coordinates).

    Of oscillators R is that of the displacements alone, or ends with it.
    """
    own, count = query.own, len(query.own.blocks)
    pairs = count - own.singles
    longest = 1 / query.scene.duration
    if own.apart:
        frequency, decay = own.blocks[:pairs, 0, 1], (query.uniform or 0.0) / 2
        if decay:
            slow = np.minimum(frequency, decay)
            decay = slow * (slow / decay)
        value = frequency + 1j * LEAST_SQUARES * shift * np.maximum(longest, decay)
        driven = residual[:, residual.shape[1] - pairs :]
        found = full.solved(driven, -(value**2), np.zeros(pairs)).real
        return np.pad(found, ((0, 0), (count, 0)))
    value = own.blocks[:, 0, 0] - 1j * own.blocks[:, 0, 1]
    # Along the imaginary axis a mode that is real is shifted away from others that are.
    away = np.where(np.arange(count) < pairs, 1, 1j)
    value = value + shift * away * np.maximum(longest, -value.real)
    driven = residual[:, :count] - 1j * np.pad(residual[:, count:], ((0, 0), (0, own.singles)))
    found = full.solved(driven, value**2, value)
    return np.concatenate([found.real, -found[:, :pairs].imag], axis=1)


def folded(matrix: Any) -> tuple[np.ndarray, np.ndarray]:
    """A symmetric sparse matrix of neighbours on a ring, as the lower bands of the folded ring.

    Returns
    -------
    place : int array, shape (N,)
        Where each entry of the ring goes: 0, N - 1, 1, N - 2 and so on are the first ones.
    lower : array, shape (N, width)
        Entry [i, n] stands at row i and column i - n.
    """
    entries, size = matrix.tocoo(), matrix.shape[0]
    along = np.arange(size)
    place = np.minimum(2 * along, 2 * (size - along) - 1)
    row, column = place[entries.row], place[entries.col]
    below = row >= column
    row, column = row[below], column[below]
    lower = np.zeros((size, int((row - column).max(initial=0)) + 1))
    lower[row, row - column] = entries.data[below]
    return place, lower


@compiled_sums
def solve_shifted(place, lower, shifts, columns):
    """(A Aᵀ + shift)⁻¹ of each column, with a shift for each of its entries, in place, (m, N)."""
    size, width = lower.shape
    factor = np.zeros((size, width), np.complex128)
    solved = np.empty(size, np.complex128)
    shift = np.empty(size, np.complex128)
    for m in range(len(columns)):
        for i in range(size):
            solved[place[i]] = columns[m, i]
            shift[place[i]] = shifts[m, i]
        for i in range(size):
            first = max(0, i - width + 1)
            for j in range(first, i):
                total = complex(lower[i, i - j], 0.0)
                for k in range(max(first, j - width + 1), j):
                    total -= factor[i, i - k] * factor[j, j - k]
                # Not divided by its pivot before all of the row are known.
                factor[i, i - j] = total
            pivot = lower[i, 0] + shift[i]
            for j in range(first, i):
                scaled = factor[i, i - j] / factor[j, 0]
                pivot -= scaled * factor[i, i - j]
                factor[i, i - j] = scaled
                solved[i] -= scaled * solved[j]
            factor[i, 0] = pivot
        for i in range(size - 1, -1, -1):
            rest = solved[i] / factor[i, 0]
            for j in range(i + 1, min(size, i + width)):
                rest -= factor[j, j - i] * solved[j]
            solved[i] = rest
        for i in range(size):
            columns[m, i] = solved[place[i]]
