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
All this is of the size of the particles.
"""

from dataclasses import dataclass
from typing import Any

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

    def rate(self, velocity: np.ndarray, strain: np.ndarray) -> np.ndarray:
        """Rate of change of the velocity, of columns (N, m)."""
        return -(self.stretch.T @ strain) - (self.damping * velocity.T).T


def corrected_bound(
    query: Any, line: Line, velocity: np.ndarray, displacement: np.ndarray, shift: float
) -> np.ndarray:
    """Bound of the energy norm of the error at the outputs, (times,).

    Parameters
    ----------
    query : Query
    line : Line
        Its full model.
    velocity, displacement : arrays, shape (N, coordinates)
        Its own modes, scaled.
    shift : float
        One of `SHIFTS`.
    """
    own, push, z = query.own, query.push, query.own_start

    def left(velocity, strain):
        return line.rate(velocity, strain) - own.times_operator(velocity)

    strain = line.stretch @ displacement
    residual = left(velocity, strain)
    change = _change(query, line, shift, residual)
    moved, strained = own.times_operator(change), line.stretch @ change
    residual, velocity = residual + left(moved, strained), velocity + moved
    beside = float(np.linalg.norm([line.start - velocity @ z, (strain + strained) @ z]))
    size = float(np.linalg.norm(line.start))
    if query.uniform is not None and not query.courses:
        state, count = query.solve(), len(own.blocks)
        added = np.hypot(
            *(
                np.linalg.norm(np.linalg.qr(columns[:, part], mode="r") @ state[part], axis=0)
                for columns, part in ((moved, slice(count)), (strained, slice(count, None)))
            )
        )
        return oscillating_bound(query, residual, beside, size) + added
    # The force moves the changed displacement at once, and no velocity does.
    jumps = np.linalg.qr(strained @ push, mode="r")
    rows = np.block(
        [[residual, line.force - velocity @ push], [np.zeros((len(jumps), z.size)), jumps]]
    )
    damping = np.append(np.broadcast_to(line.damping, len(residual)), np.zeros(len(jumps)))
    sizes = size, float(np.linalg.norm(line.force))
    return driven_bound(query, rows, damping, beside, sizes, np.concatenate([moved, strained]))


def _change(query, line, shift, residual):
    """X of the residual R, (N, coordinates)."""
    own, change = query.own, np.zeros_like(residual)
    if own.blocks.shape[-1] > 2:
        return change
    count = len(own.blocks)
    pairs = count - own.singles
    longest = 1 / query.scene.duration
    if own.apart:
        frequency, decay = own.blocks[:pairs, 0, 1], (query.uniform or 0.0) / 2
        if decay:
            slow = np.minimum(frequency, decay)
            decay = slow * (slow / decay)
        value = frequency + 1j * LEAST_SQUARES * shift * np.maximum(longest, decay)
        change[:, count:] = _solved(line, residual[:, count:], -(value**2)[:, None]).real
        return change
    value = own.blocks[:, 0, 0] - 1j * own.blocks[:, 0, 1]
    # Along the imaginary axis a mode that is real is shifted away from others that are.
    away = np.where(np.arange(count) < pairs, 1, 1j)
    value = (value + shift * away * np.maximum(longest, -value.real))[:, None]
    driven = residual[:, :count] - 1j * np.pad(residual[:, count:], ((0, 0), (0, own.singles)))
    found = _solved(line, driven, value * (value + line.damping))
    change[:, :count], change[:, count:] = found.real, -found[:, :pairs].imag
    return change


def _solved(line, right, shifts):
    """(A Aᵀ + shifts)⁻¹ of columns; zero where that fails."""
    shifts = np.ascontiguousarray(np.broadcast_to(shifts, right.shape[::-1]))
    solved = np.array(right.T, complex, order="C")
    solve_shifted(*folded(line.stretch.T @ line.stretch), shifts, solved)
    return np.where(np.isfinite(solved).all(axis=1)[:, None], solved, 0).T


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
