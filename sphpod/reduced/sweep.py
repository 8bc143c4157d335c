"""Errors of a reduced model for several mode counts, whichever model it is."""

import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TypeVar

import numpy as np

from sphpod.scene.breakdown import Breakdown

Solution = TypeVar("Solution")


def sweep(
    mode_counts: Iterable[int],
    solutions: Iterable[Solution | Breakdown],
    measure: Callable[[Solution], Mapping[str, float]],
    columns: Mapping[str, float],
    kept: Callable[[Solution], Mapping[str, np.ndarray]],
) -> dict[str, np.ndarray]:
    """Measure the solution for each mode count, and keep that of a single one.

    Parameters
    ----------
    mode_counts : ints
    solutions : iterable
        One for each count, or how its model broke down.
    measure : callable
        Numbers by name, of a solution.
    columns : dict
        Names of these numbers, each with what stands for it where a model broke down.
    kept : callable
        Arrays by name, of a solution.

    Returns
    -------
    dict
        mode_count, each column, and breakdown_time [s] (NaN where none), of shape (counts,); and
        for a single count what is kept of its solution.

    Raises
    ------
    Breakdown
        The model for a single mode count broke down.
    """
    counts = list(mode_counts)
    arrays = {name: np.full(len(counts), value) for name, value in columns.items()}
    arrays["breakdown_time"] = np.full(len(counts), np.nan)
    for n, solution in enumerate(solutions):
        if isinstance(solution, Breakdown):
            if len(counts) == 1:
                raise solution
            arrays["breakdown_time"][n] = solution.time
            continue
        for name, value in measure(solution).items():
            arrays[name][n] = value
        if len(counts) == 1:
            arrays |= kept(solution)
    return {"mode_count": np.array(counts), **arrays}


def failed(fields: Iterable[str], *against: str) -> dict[str, float]:
    """Columns of errors of fields against solutions, infinite where a model broke down."""
    return {f"{field}_error_{one}": np.inf for one in against for field in fields}


def report_level(mode_counts: Sequence[int]) -> int:
    """Level at which too few modes are reported: who asks for one count is warned, a sweep not."""
    return logging.WARNING if len(mode_counts) == 1 else logging.INFO
