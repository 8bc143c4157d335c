"""Runs of reduced models, and their errors for several mode counts, whichever model it is."""

import logging
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from sphpod.scene.run import ALL, Run


@dataclass
class ReducedRun(Run):
    """A reduced model: its fields are coordinates times modes.

    Attributes
    ----------
    reduced : ReducedModel or LiftedModel
    """

    reduced: Any

    @abstractmethod
    def expansions(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Of each field its coordinates (outputs, modes) and its modes (modes, N)."""

    def fields(self, rows: slice = ALL) -> dict[str, np.ndarray]:
        return {
            name: coordinates[rows] @ modes
            for name, (coordinates, modes) in self.expansions().items()
        }


Each = TypeVar("Each", bound=ReducedRun)


def sweep(
    mode_counts: Iterable[int],
    runs: Iterable[Each],
    measure: Callable[[Each], Mapping[str, float]],
    columns: Mapping[str, float],
) -> dict[str, np.ndarray]:
    """Run the model for each mode count and measure it; keep the solution of a single one.

    Parameters
    ----------
    mode_counts : ints
    runs : iterable
        One for each count.
    measure : callable
        Numbers by name, of a run.
    columns : dict
        Names of these numbers, each with what stands for it where a model broke down.

    Returns
    -------
    dict
        mode_count, each column, and breakdown_time [s] (NaN where none), of shape (counts,); and
        for a single count what is stored of its run and the system of its model.

    Raises
    ------
    Breakdown
        The model for a single mode count broke down.
    """
    counts = list(mode_counts)
    arrays = {name: np.full(len(counts), value) for name, value in columns.items()}
    arrays["breakdown_time"] = np.full(len(counts), np.nan)
    for n, run in enumerate(runs):
        broken = run.run().breakdown()
        if broken is not None:
            if len(counts) == 1:
                raise broken
            arrays["breakdown_time"][n] = broken.time
            continue
        for name, value in measure(run).items():
            arrays[name][n] = value
        if len(counts) == 1:
            arrays |= run.stored() | run.reduced.system()
    return {"mode_count": np.array(counts), **arrays}


def failed(fields: Iterable[str], *against: str) -> dict[str, float]:
    """Columns of errors of fields against solutions, infinite where a model broke down."""
    return {f"{field}_error_{one}": np.inf for one in against for field in fields}


def report_level(mode_counts: Sequence[int]) -> int:
    """Level at which too few modes are reported: who asks for one count is warned, a sweep not."""
    return logging.WARNING if len(mode_counts) == 1 else logging.INFO
