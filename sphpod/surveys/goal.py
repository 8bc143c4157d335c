"""What a design looks for: the best of a number, within the levels that others keep to.

All is measured by spreads: of a quantity over the queries, of a parameter its range. A passage that
never comes counts as one after the last output.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from sphpod.numerics.error import Arrays
from sphpod.surveys.questions import VARIES
from sphpod.surveys.samples import Ranges

SLACK = 1e-6
"""Part of a spread by which a level may be passed: no search ends upon it exactly."""

REFUSED = 10 / VARIES
"""What a query without an answer counts as, in spreads: more than any that has one."""


@dataclass(frozen=True)
class Goal:
    """What is sought and within which levels, of numbers by name.

    Attributes
    ----------
    keys : dict
        The design in the configuration.
    scales : dict
        Spread of each quantity and parameter.
    late : float
        What a passage that never comes counts as [s].
    tolerance : float
        Part of the spread within which a value is reached.
    """

    keys: Mapping[str, Any]
    scales: Mapping[str, float]
    late: float
    tolerance: float

    @cached_property
    def levels(self) -> list[tuple[str, float, float]]:
        """Of each level its name, 1 if it is the largest and -1 if the least, and its value."""
        signs = {"at_most": 1.0, "at_least": -1.0}
        return [
            (name, signs[side], value)
            for name, sides in self.keys["where"].items()
            for side, value in sides.items()
        ]

    @cached_property
    def sought(self) -> tuple[str, float, float | None]:
        """Name, sign of what is to be as small as can be, and the value to be reached."""
        if "reach" in self.keys:
            ((name, value),) = self.keys["reach"].items()
            return name, 1.0, value
        minimised = "minimise" in self.keys
        return self.keys["minimise" if minimised else "maximise"], 1.0 if minimised else -1.0, None

    @property
    def names(self) -> list[str]:
        """What is sought, and then what has levels."""
        return list(dict.fromkeys([self.sought[0], *(name for name, *_ in self.levels)]))

    def values(self, found: Arrays, name: str) -> np.ndarray:
        """Values of answers (queries,), NaN where there is none."""
        given = np.asarray(found[name], float)
        failed = np.asarray(found["reason"]).astype(bool)
        return np.where(failed, np.nan, np.where(np.isnan(given), self.late, given))

    def objective(self, found: Arrays) -> np.ndarray:
        """What is to be as small as can be, in spreads, (queries,)."""
        name, sign, target = self.sought
        value = self.values(found, name) / self.scales[name]
        if target is not None:
            value = np.abs(value - target / self.scales[name])
        return np.where(np.isnan(value), REFUSED, sign * value)

    def excess(self, found: Arrays) -> np.ndarray:
        """By how much each level is passed, in spreads, (queries, levels); negative within."""
        count = len(found["reason"])
        columns = [
            sign * (self.values(found, name) - level) / self.scales[name]
            for name, sign, level in self.levels
        ]
        rows = np.stack(columns, axis=1) if columns else np.zeros((count, 0))
        return np.where(np.isnan(rows), REFUSED, rows)

    def broken(self, found: Arrays, margin: float | np.ndarray = 0.0) -> list[str]:
        """Why one answer is none, or what of it passes a level or misses its value, in words.

        The margin (levels,) is added to the excess over each level.
        """
        if found["reason"][0]:
            return [str(found["reason"][0])]
        told = []
        excess = self.excess(found)[0] + margin
        for (name, sign, level), over in zip(self.levels, excess, strict=True):
            if over > SLACK:
                side = "at most" if sign > 0 else "at least"
                told.append(f"{name} = {found[name][0]:.8g}, to be {side} {level:g}")
        name, _, target = self.sought
        if target is not None and not self.objective(found)[0] <= self.tolerance:
            told.append(f"{name} = {found[name][0]:.8g}, to be {target:g}")
        return told

    def order(self, objective: np.ndarray, excess: np.ndarray) -> np.ndarray:
        """Indices from the best on: what is within all levels, and then what is least beyond."""
        worst = excess.max(axis=1, initial=0.0)
        beyond = np.where(worst > SLACK, worst, 0.0)
        return np.lexsort([objective, beyond])


def scales(ranges: Ranges, found: Arrays) -> dict[str, float]:
    """Spread of all numbers: of a parameter its range, of a quantity that over the queries.

    Of what no parameter changes but by rounding it is the size.
    """
    spread = {name: given["range"][1] - given["range"][0] for name, given in ranges.items()}
    for name in found:
        if name not in spread and np.ndim(found[name]) == 1 and f"{name}_low" in found:
            known = found[name][np.isfinite(found[name])]
            largest = np.abs(known).max(initial=0.0)
            varies = known.size and np.ptp(known) > VARIES * largest
            spread[name] = float(np.ptp(known) if varies else largest or 1.0)
    return spread
