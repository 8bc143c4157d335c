"""Modes by which the modes of all queries of a survey are corrected, as few as the model has.

The change X that sharpens a query's bound (`sphpod.surveys.corrected`) solves a system of the size
of the particles for each of its modes. Over the parameters these changes span little: the proper
modes Ψ of those of the training runs hold them. Within Ψ the systems are

    (Ψᵀ K Ψ - λ²) Y = Ψᵀ R,    X = Ψ Y,

and what X leaves is a sum of columns that a QR factor was made of once. So a query whose
coefficients all fall apart does nothing of the size of the particles.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from sphpod.surveys.corrected import SHIFTS, correction

EPS = np.finfo(float).eps

MOST = 4
"""Times as many as modes of the queries there are at most."""

LOOSER = 1.25
"""Times a training run's bound of corrections at the particles, that of few modes is at most."""


@dataclass(frozen=True)
class Span:
    """The full model as columns of modes and correction modes see it, the latter behind.

    Attributes
    ----------
    modes : array, shape (k + m or fewer, k + m)
        Columns, as far down as they are not zero.
    pull : array, shape (rows, k + m)
        Rate of change of the velocity, of displacements.
    damped : array, shape (rows, k + m), or None
        -d times velocities, where damping is not the same everywhere.
    stiffness : array, shape (m, m)
        Ψᵀ K Ψ [1/s²].
    damping : float
        That which is the same everywhere, else 0 [1/s].
    start, force : arrays, shapes (rows,) and (rows, forces)
    """

    modes: np.ndarray
    pull: np.ndarray
    damped: np.ndarray | None
    stiffness: np.ndarray
    damping: float
    start: np.ndarray
    force: np.ndarray

    @property
    def _own(self):
        return slice(self.modes.shape[1] - len(self.stiffness), None)

    @cached_property
    def _waves(self):
        return np.linalg.eigh(self.stiffness)

    def rows(self, columns: np.ndarray) -> np.ndarray:
        """Columns (k + m, c) as rows of the factor, (rows, c)."""
        return np.pad(self.modes @ columns, ((0, len(self.pull) - len(self.modes)), (0, 0)))

    def rate(self, velocity: np.ndarray, displacement: np.ndarray) -> np.ndarray:
        """Rate of change of the velocity, (rows, c)."""
        rate = self.pull @ displacement
        if self.damped is not None:
            return rate + self.damped @ velocity
        if self.damping:
            rate[: len(self.modes)] -= self.damping * (self.modes @ velocity)
        return rate

    def solved(self, right: np.ndarray, squares: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """As the line's, within the correction modes, (k + m, c)."""
        own = self.modes[:, self._own]
        driven = own.T @ right[: len(own)]
        if rates.any():
            damping = self.damping * np.eye(len(self.stiffness))
            if self.damped is not None:
                damping = -own.T @ self.damped[: len(own), self._own]
            shifts = squares[:, None, None] * np.eye(len(self.stiffness))
            systems = self.stiffness + shifts + rates[:, None, None] * damping
            found = np.linalg.solve(systems, driven.T[:, :, None])[:, :, 0].T
        else:
            values, shapes = self._waves
            found = shapes @ ((shapes.T @ driven) / (values[:, None] + squares))
        return np.pad(found, ((self._own.start, 0), (0, 0)))

    def change(self, moved: np.ndarray, change: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Columns of velocity and strain, in coordinates in which these are lengths."""
        values, shapes = self._waves
        strained = shapes.T @ change[self._own]
        return moved[self._own], np.sqrt(np.maximum(values, 0))[:, None] * strained


def correction_modes(
    surveyed: Callable[..., Any], count: int, points: Sequence[Mapping[str, float]]
) -> np.ndarray:
    """As few modes of the changes at some points as have bounds like those at the particles.

    Parameters
    ----------
    surveyed : callable
        The survey of a number of modes and, by that name, of correction modes.
    count : int
        Modes of the queries.
    points : sequence of dicts
        Values of the parameters of the training runs.

    Returns
    -------
    array, shape (m, N)
        None at all, m = 0, where bounds that nothing corrects are within the tolerance.
    """
    at_particles = surveyed(count)

    def bounds(survey):
        return np.array([survey.answer(point).relative_bound for point in points])

    def of(modes):
        return bounds(surveyed(count, correction_modes=modes))

    none = np.zeros((0, at_particles.operators.volumes.size))
    if np.all(of(none) <= at_particles.tolerance):
        return none
    modes = _modes(at_particles, points)
    most = LOOSER * bounds(at_particles)
    low, high = 0, min(len(modes), MOST * count)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if np.all(of(modes[:middle]) <= most) else (middle, high)
    return modes[:high]


def _modes(survey, points):
    """Proper modes of the changes at some points, best for their strains, (modes, N)."""
    changes, operators = [np.zeros((survey.operators.volumes.size, 0))], survey.operators
    for point in points:
        query, line, velocity, displacement = survey.at_particles(point)
        if query.own.blocks.shape[-1] == 2:
            residual = line.rate(velocity, displacement) - query.own.times_operator(velocity)
            change = correction(query, line, SHIFTS[0], residual)
            changes.append(change * np.abs(query.state).max(axis=1) / line.mass[:, None])
    columns = np.concatenate(changes, axis=1)
    strains = np.sqrt(operators.volumes) * operators.nominal.derivative(columns.T)
    _, sizes, shares = np.linalg.svd(strains.T, full_matrices=False)
    rank = np.count_nonzero(sizes > max(strains.shape) * EPS * sizes.max(initial=0))
    return shares[:rank] @ columns.T
