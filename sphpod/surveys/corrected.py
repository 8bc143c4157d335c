"""A sharper bound of a query's error: that of its modes after they are corrected.

With scaled fields √(Vρ0) v and √(V/c) σ the line is v' = A s - d v + f, s' = -Aᵀ v. Let J be the
matrix of both. Own modes S of a reduced model with the operator M leave the residual R = J S - S M;
changed by X, they leave R + J X - X M. The error is at most |X z| and what is left adds up to
(`sphpod.reduced.error_bound`, (1)). A wave of the line that a mode drives off the wave's own
frequency should go into X, and one that it drives in resonance should be left. A shift by ρ tells
them apart, where 1/ρ is how long the mode lasts.

**Even damping.** An oscillator is v' = -d v + ω s, s' = -ω v. Of its modes U and W are left

    P = A W - ω U, times s, in the velocity,    and    Q = ω W - Aᵀ U, times v, in the stress;

with U + α and W + β, P + A β - ω α and Q + ω β - Aᵀ α, whatever d is. The squares of these and of
ρ α and ρ β together are smallest for the real parts of the solution, with λ = ω + iρ, of

    (A Aᵀ - λ²) α = A Q - λ P,    λ β = Aᵀ α - Q.

**Uneven damping.** For a complex mode of eigenvalue λ, X = (λ + ρ - J)⁻¹ R leaves ρ X:

    (A Aᵀ + λ (λ + d)) X_v = λ R_v + A R_s,    λ X_s = R_s - Aᵀ X_v,    λ + ρ being written λ.

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
    gradient : array, shape (N, width)
        A [1/s] in bands.
    mass, softness : arrays, shape (N,)
        √(Vρ0) and √(V/c).
    damping : array, shape (N,), or float
        d [1/s].
    start : array, shape (N,)
        Scaled initial velocity.
    force : array, shape (N, forces)
        Scaled profiles.
    """

    gradient: np.ndarray
    mass: np.ndarray
    softness: np.ndarray
    damping: np.ndarray | float
    start: np.ndarray
    force: np.ndarray

    def pull(self, stress: np.ndarray) -> np.ndarray:
        """A of columns, (N, m)."""
        return product(self.gradient, np.ascontiguousarray(stress))

    def stretch(self, velocity: np.ndarray) -> np.ndarray:
        """Aᵀ of columns, (N, m)."""
        return transposed(self.gradient, np.ascontiguousarray(velocity))

    def rates(self, velocity: np.ndarray, stress: np.ndarray) -> list[np.ndarray]:
        """J of columns, (N, m) each."""
        return [self.pull(stress) - (self.damping * velocity.T).T, -self.stretch(velocity)]


def corrected_bound(
    query: Any, line: Line, velocity: np.ndarray, stress: np.ndarray, shift: float
) -> np.ndarray:
    """Bound of the energy norm of the error at the outputs, (times,).

    Parameters
    ----------
    query : Query
    line : Line
        Its full model.
    velocity, stress : arrays, shape (N, coordinates)
        Its own modes, scaled.
    shift : float
        One of `SHIFTS`.
    """
    own, push, z = query.own, query.push, query.own_start
    modes = [velocity, stress]
    left = [
        rate - own.times_operator(mode)
        for rate, mode in zip(line.rates(*modes), modes, strict=True)
    ]
    changes = _changes(query, line, shift, *left)
    for n, (rate, change) in enumerate(zip(line.rates(*changes), changes, strict=True)):
        left[n] = left[n] + rate - own.times_operator(change)
        modes[n] = modes[n] + change
    beside = float(np.linalg.norm([line.start - modes[0] @ z, modes[1] @ z]))
    size = float(np.linalg.norm(line.start))
    change = np.concatenate(changes)
    if query.uniform is not None and not query.courses:
        bound = oscillating_bound(query, left[0], left[1], beside, size)
        moved = np.linalg.qr(change, mode="r") @ query.solve()
        return bound + np.linalg.norm(moved, axis=0)
    forced = [line.force - modes[0] @ push, -modes[1] @ push]
    pulled, stretched = (np.concatenate(pair, axis=1) for pair in zip(left, forced, strict=True))
    sizes = size, float(np.linalg.norm(line.force))
    return driven_bound(query, pulled, stretched, line.damping, beside, sizes, change)


def _changes(query, line, shift, velocity, stress):
    """X of the residual R, (N, coordinates) each."""
    own, changes = query.own, [np.zeros_like(velocity), np.zeros_like(stress)]
    if own.blocks.shape[-1] > 2:
        return changes
    count = len(own.blocks)
    pairs = count - own.singles
    longest = 1 / query.scene.duration
    if own.apart:
        frequency, decay = own.blocks[:pairs, 0, 1], (query.uniform or 0.0) / 2
        if decay:
            slow = np.minimum(frequency, decay)
            decay = slow * (slow / decay)
        rate = LEAST_SQUARES * shift * np.maximum(longest, decay)
        value = frequency + 1j * rate
        pushed, pulled = velocity[:, count:], stress[:, :pairs]
        right = line.pull(pulled) - value * pushed
        alpha = _solved(line, right, -(value**2)[:, None])
        changes[0][:, :pairs] = alpha.real
        changes[1][:, count:] = ((_stretched(line, alpha) - pulled) / value).real
        return changes
    value = own.blocks[:, 0, 0] - 1j * own.blocks[:, 0, 1]
    # Along the imaginary axis a mode that is real is shifted away from others that are.
    away = np.where(np.arange(count) < pairs, 1, 1j)
    value = value + shift * away * np.maximum(longest, -value.real)
    pushed, pulled = (
        part[:, :count] - 1j * np.pad(part[:, count:], ((0, 0), (0, own.singles)))
        for part in (velocity, stress)
    )
    turned = line.pull(pulled.real) + 1j * line.pull(pulled.imag)
    shifts = value[:, None] * (value[:, None] + np.broadcast_to(line.damping, len(velocity)))
    alpha = _solved(line, value * pushed + turned, shifts)
    beta = (pulled - _stretched(line, alpha)) / value
    for change, found in zip(changes, (alpha, beta), strict=True):
        change[:, :count], change[:, count:] = found.real, -found[:, :pairs].imag
    return changes


def _solved(line, right, shifts):
    """(A Aᵀ + shifts)⁻¹ of complex columns; zero where that fails."""
    shifts = np.ascontiguousarray(np.broadcast_to(shifts, right.shape[::-1]))
    solved = np.ascontiguousarray(right.T)
    solve_shifted(*folded_square(line.gradient), shifts, solved)
    return np.where(np.isfinite(solved).all(axis=1)[:, None], solved, 0).T


def _stretched(line, columns):
    return line.stretch(columns.real) + 1j * line.stretch(columns.imag)


def bands(matrix: Any) -> np.ndarray:
    """A sparse matrix of neighbours on a ring as rows of what is beside the diagonal.

    Returns
    -------
    array, shape (N, 2 reach + 1)
        Entry [i, reach + n] stands at row i and column i + n modulo N.
    """
    entries, size = matrix.tocoo(), matrix.shape[0]
    beside = (entries.col - entries.row + size // 2) % size - size // 2
    reach = int(np.abs(beside).max(initial=0))
    found = np.zeros((size, 2 * reach + 1))
    np.add.at(found, (entries.row, beside + reach), entries.data)
    return found


def scaled(banded: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Bands of diag(rows) A diag(columns)."""
    size, width = banded.shape
    beside = (np.arange(size)[:, None] + np.arange(width) - width // 2) % size
    return rows[:, None] * banded * columns[beside]


@compiled_sums
def product(banded, columns):
    """A times columns (N, m)."""
    size, width = banded.shape
    reach = width // 2
    found = np.zeros_like(columns)
    for i in range(size):
        for n in range(width):
            weight = banded[i, n]
            if weight != 0:
                row = columns[(i + n - reach) % size]
                for m in range(row.size):
                    found[i, m] += weight * row[m]
    return found


@compiled_sums
def transposed(banded, columns):
    """Aᵀ times columns (N, m)."""
    size, width = banded.shape
    reach = width // 2
    found = np.zeros_like(columns)
    for i in range(size):
        row = columns[i]
        for n in range(width):
            weight = banded[i, n]
            if weight != 0:
                target = found[(i + n - reach) % size]
                for m in range(row.size):
                    target[m] += weight * row[m]
    return found


@compiled_sums
def folded_square(banded):
    """A Aᵀ in lower bands, of a ring that is folded: places 0, N - 1, 1, N - 2 and so on."""
    size, width = banded.shape
    reach = width // 2
    place = np.empty(size, np.int64)
    for i in range(size):
        place[i] = 2 * i if 2 * i < size else 2 * (size - 1 - i) + 1
    lower = np.zeros((size, min(4 * reach, size - 1) + 1))
    for i in range(size):
        for far in range(-2 * reach, 2 * reach + 1):
            j = (i + far) % size
            row, column = place[i], place[j]
            if row < column:
                continue
            total = 0.0
            for n in range(width):
                other = n - far
                if 0 <= other < width:
                    total += banded[i, n] * banded[j, other]
            lower[row, row - column] += total
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
