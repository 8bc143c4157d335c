"""Proper orthogonal decomposition: the modes that represent snapshots best (section 2.3)."""

from collections.abc import Mapping

import numpy as np
from threadpoolctl import threadpool_limits

from sphpod.error import FIELDS

ROUNDING_LEVEL = 1e-12
"""Modes below this fraction of the first singular value hold rounding errors alone."""


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


def modes(snapshots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Orthonormal modes of snapshots by singular value decomposition, no mean subtracted.

    In double precision, and the same to the last bit for any number of BLAS threads.

    Parameters
    ----------
    snapshots : array, shape (n, N)
        One snapshot a row.

    Returns
    -------
    modes : array, shape (min(n, N), N)
        One mode a row, by falling singular value. The first of a mode's largest entries is
        positive, which fixes its sign.
    singular_values : array, shape (min(n, N),)
        In the unit of the snapshots.

    Raises
    ------
    ValueError
        There is no snapshot, or a value is not finite.
    """
    snapshots = checked("snapshots", snapshots)
    # Threads share sums among them, and modes of small singular values magnify how those are
    # rounded.
    with threadpool_limits(1, "blas"):
        _, singular_values, rows = np.linalg.svd(snapshots, full_matrices=False)
    size = np.abs(rows)
    # Entries of a mode that are equal but for rounding are ties, whichever rounding makes larger.
    largest = np.argmax(size >= (1 - 1e-8) * size.max(axis=1, keepdims=True), axis=1)
    signs = np.sign(rows[np.arange(len(rows)), largest])
    return rows * signs[:, None], singular_values


def decompose(snapshots: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Modes and singular values of velocity and of density snapshots.

    Parameters
    ----------
    snapshots : dict
        x (N,), velocity_snapshots (n, N), density_snapshots (m, N).

    Returns
    -------
    dict
        x (N,), velocity_modes, velocity_singular_values, density_modes, density_singular_values.

    Raises
    ------
    ValueError
        There is no snapshot, a value is not finite, or a density not positive.
    """
    arrays = {"x": snapshots["x"]}
    for field, above in zip(FIELDS, (-np.inf, 0), strict=True):
        name = f"{field}_snapshots"
        rows, values = modes(checked(name, snapshots[name], above))
        arrays |= {f"{field}_modes": rows, f"{field}_singular_values": values}
    return arrays
