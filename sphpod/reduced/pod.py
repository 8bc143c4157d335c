"""Proper orthogonal decomposition: the modes that represent snapshots best (section 2.3).

Rounding turns modes of small singular values, and any modes whose singular values are about equal:
within the span of equal ones they rotate freely. How far is measured, by a second decomposition of
snapshots that are rounded differently, with rows and columns in the reverse order.
"""

from collections.abc import Iterable
from functools import cache
from typing import NamedTuple

import numpy as np
from threadpoolctl import ThreadpoolController

from sphpod.numerics.error import FIELDS, Arrays

ROUNDING_LEVEL = 1e-2
"""Modes or spans of modes that rounding turns by more than this (a sine) are not resolved."""

TIES = 5
"""Entries of a mode are equal, as its sign goes, within so many times what rounding turns it by."""


def checked(what: str, snapshots: np.ndarray, above: float = -np.inf) -> np.ndarray:
    """Snapshots in double precision, whatever they were given in.

    Parameters
    ----------
    what : str
        How a refusal names them.
    snapshots : array, shape (n, N)
    above : float
        What all their values must exceed.

    Raises
    ------
    ValueError
        There is no snapshot, or a value that is not finite or not above what it must exceed.
    """
    snapshots = np.asarray(snapshots, dtype=float)
    if not len(snapshots):
        raise ValueError(f"{what}: there are 0 snapshots: at least 1 is needed")
    allowed = np.isfinite(snapshots) & (snapshots > above)
    if not allowed.all():
        row, particle = np.argwhere(~allowed)[0]
        limit = f" and above {above:g}" if np.isfinite(above) else ""
        raise ValueError(
            f"{what}: snapshot {row} is {snapshots[row, particle]:g} at particle {particle}: "
            f"all values must be finite{limit}"
        )
    return snapshots


class Modes(NamedTuple):
    """Modes of snapshots, and how far rounding turns them.

    Attributes
    ----------
    modes : array, shape (modes, N)
        Orthonormal, one a row, by falling singular value.
    singular_values : array, shape (modes,)
        In the unit of the snapshots.
    rounding : array, shape (modes,)
        How far rounding turns each mode: norm of its change, at most √2.
    span_rounding : array, shape (modes,)
        How far it turns the span of each mode and those before it: root of the sum of the squared
        sines of the angles between both spans. Models with so many modes depend on the span alone.
    """

    modes: np.ndarray
    singular_values: np.ndarray
    rounding: np.ndarray
    span_rounding: np.ndarray


def modes(snapshots: np.ndarray, twins: np.ndarray | None = None) -> Modes:
    """Orthonormal modes of snapshots by singular value decomposition, no mean subtracted.

    In double precision, and the same to the last bit for any number of BLAS threads.

    Parameters
    ----------
    snapshots : array, shape (n, N)
        One snapshot a row.
    twins : array, shape (n, N), optional
        The same snapshots rounded differently (`rounding.twins`). If not given, those of the
        decomposition are the only rounding errors.

    Returns
    -------
    Modes
        min(n, N) of them. The first of a mode's largest entries is positive, which fixes its sign;
        entries that differ by no more than rounding makes of the mode are equal.

    Raises
    ------
    ValueError
        There is no snapshot, or a value is not finite.
    """
    snapshots = checked("snapshots", snapshots)
    twins = snapshots if twins is None else checked("twins of the snapshots", twins)
    # Threads share sums among them, and modes of small singular values magnify how those are
    # rounded.
    with _libraries().limit(limits=1, user_api="blas"):
        _, singular_values, rows = np.linalg.svd(snapshots, full_matrices=False)
        _, _, others = np.linalg.svd(twins[::-1, ::-1], full_matrices=False)
        rounding, span_rounding = _turned(rows, others[:, ::-1])
    size = np.abs(rows)
    ties = np.clip(TIES * rounding, 1e-8, 0.5)[:, None]
    largest = np.argmax(size >= (1 - ties) * size.max(axis=1, keepdims=True), axis=1)
    signs = np.sign(rows[np.arange(len(rows)), largest])
    return Modes(rows * signs[:, None], singular_values, rounding, span_rounding)


@cache
def _libraries() -> ThreadpoolController:
    """Those that have threads: to look for them takes longer than to decompose a few snapshots."""
    return ThreadpoolController()


def _turned(rows, others):
    """How far other modes are turned against some: each mode, and the span of the first ones."""
    shares = others @ rows.T
    outside = others - shares @ rows
    same = np.where(np.diag(shares) < 0, -1.0, 1.0)
    rounding = np.linalg.norm(others * same[:, None] - rows, axis=1)
    # Of the first k other modes, what lies in modes behind the k-th, and outside all of them.
    behind = np.triu(np.cumsum(shares**2, axis=0), 1).sum(axis=1)
    return rounding, np.sqrt(behind + np.cumsum(np.sum(outside**2, axis=1)))


def resolved(counts: Iterable[int], span_rounding: np.ndarray) -> np.ndarray:
    """Whether the first modes of a field span the same whichever way numbers are rounded.

    Parameters
    ----------
    counts : ints
        Numbers of modes, or all there are.
    span_rounding : array, shape (modes,)
        As in `Modes`.

    Returns
    -------
    bool array, shape (counts,)
    """
    kept = np.minimum(np.array(list(counts), int), span_rounding.size)
    # No modes span nothing, which nothing turns.
    return np.concatenate([[0.0], span_rounding])[np.maximum(kept, 0)] <= ROUNDING_LEVEL


def decompose(snapshots: Arrays) -> dict[str, np.ndarray]:
    """Modes and singular values of velocity and of density snapshots.

    Parameters
    ----------
    snapshots : dict
        x (N,), velocity_snapshots (n, N), density_snapshots (m, N); and velocity_twins,
        density_twins of the same shapes, where there are (`rounding.twins`).

    Returns
    -------
    dict
        x (N,), velocity_modes, velocity_singular_values, density_modes, density_singular_values;
        velocity_mode_rounding, velocity_span_rounding, density_mode_rounding and
        density_span_rounding, as in `Modes`.

    Raises
    ------
    ValueError
        There is no snapshot, a value is not finite, or a density not positive.
    """
    arrays = {"x": snapshots["x"]}
    for field, above in zip(FIELDS, (-np.inf, 0), strict=True):
        name = f"{field}_snapshots"
        taken = checked(name, snapshots[name], above)
        arrays |= named(field, modes(taken, snapshots.get(f"{field}_twins")))
    return arrays


def named(field: str, found: Modes) -> dict[str, np.ndarray]:
    """Arrays of `Modes` by their names in a dataset."""
    names = "modes", "singular_values", "mode_rounding", "span_rounding"
    return {f"{field}_{name}": array for name, array in zip(names, found, strict=True)}
