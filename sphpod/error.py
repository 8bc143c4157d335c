"""Relative L2 errors over space and time (section 3.1, with the square root it leaves out)."""

import numpy as np


def relative_error(solution: np.ndarray, reference: np.ndarray) -> float:
    """sqrt(Σ_n Σ_i (a - b)² / Σ_n Σ_i b²) over all times and particles, equally weighted.

    Parameters
    ----------
    solution, reference : arrays, shape (times, N)

    Returns
    -------
    float
        Relative error (dimensionless).
    """
    return float(np.sqrt(_squares(solution, reference).sum() / _squares(reference, None).sum()))


def _squares(a, b):
    """Sum of (a - b)² over particles, row by row, without an array of the size of the fields."""
    rows = range(0, len(a), 512)
    blocks = (a[r : r + 512] if b is None else a[r : r + 512] - b[r : r + 512] for r in rows)
    return np.concatenate([np.einsum("ti,ti->t", block, block) for block in blocks])
