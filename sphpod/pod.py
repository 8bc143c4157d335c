"""Proper orthogonal decomposition: the modes that represent snapshots best (section 2.3)."""

from collections.abc import Mapping

import numpy as np

ROUNDING_LEVEL = 1e-12
"""Modes below this fraction of the first singular value hold rounding errors alone."""


def modes(snapshots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Orthonormal modes of snapshots by singular value decomposition, no mean subtracted.

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
    """
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
    """
    arrays = {"x": snapshots["x"]}
    for field in ("velocity", "density"):
        rows, values = modes(snapshots[f"{field}_snapshots"])
        arrays |= {f"{field}_modes": rows, f"{field}_singular_values": values}
    return arrays
