"""Relative L2 errors over space and time (section 3.1, with the square root it leaves out)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

FIELDS = ("velocity", "density")

Arrays = Mapping[str, np.ndarray]
"""Arrays by name, as a dataset has them in memory."""


def share(part: float, whole: float) -> float:
    """Part of a norm: 0 of nothing where there is no part, NaN where there is one.

    What moves nowhere has no size that an error could be relative to; infinite are the errors of
    what broke down.
    """
    if whole > 0:
        return float(part / whole)
    return 0.0 if part == 0 else float("nan")


def relative_error(solution: np.ndarray, reference: np.ndarray) -> float:
    """sqrt(Σ_n Σ_i (a - b)² / Σ_n Σ_i b²) over all times and particles, equally weighted.

    Parameters
    ----------
    solution, reference : arrays, shape (times, N)

    Returns
    -------
    float
        Relative error (dimensionless); as `share` where the reference is zero.
    """
    wrong = right = 0.0
    for rows in blocks(len(reference)):
        difference = solution[rows] - reference[rows]
        wrong += np.vdot(difference, difference)
        right += np.vdot(reference[rows], reference[rows])
    return share(np.sqrt(wrong), np.sqrt(right))


def table(sph: Arrays, references: Sequence[Arrays], kinds: Sequence[str]) -> dict[str, np.ndarray]:
    """Errors of full SPH and of references, in velocity and density (section 3.1).

    Parameters
    ----------
    sph : dict
        velocity and density (times, N).
    references : dicts
        The same of each reference.
    kinds : names
        Of the references.

    Returns
    -------
    dict
        solution (1 + references,) and reference (references,), names; velocity_error and
        density_error (solution, reference), as from `compare`.
    """
    solutions = dict(zip(["sph", *kinds], [sph, *references], strict=True))
    arrays = {"solution": np.array(list(solutions)), "reference": np.array(list(kinds))}
    for field in FIELDS:
        fields = {name: solution[field] for name, solution in solutions.items()}
        arrays[f"{field}_error"] = compare(fields, kinds)
    return arrays


def compare(solutions: Arrays, references: Sequence[str]) -> np.ndarray:
    """Errors of full SPH against each reference, and of each reference against the exact solution.

    Parameters
    ----------
    solutions : dict
        One field (times, N) of full SPH, named sph, and of every reference.
    references : names
        References in ``solutions``; the exact solution, if it is known, is named exact.

    Returns
    -------
    array, shape (solutions, references)
        Relative L2 errors; NaN where none is asked for.
    """
    table = np.full((len(solutions), len(references)), np.nan)
    for row, (name, field) in enumerate(solutions.items()):
        for column, reference in enumerate(references):
            if name == "sph" or (reference == "exact" and name != "exact"):
                table[row, column] = relative_error(field, solutions[reference])
    return table


@dataclass(frozen=True)
class Projection:
    """A field seen from a set of orthonormal modes, to compare reduced coordinates with.

    Attributes
    ----------
    coordinates : array, shape (times, modes)
        Coordinates of the field's projection on each mode.
    squares : array, shape (modes,)
        Σ_n of the squares of each coordinate.
    outside : float
        Σ_n Σ_i of the squares of what all modes together leave of the field.
    total : float
        Σ_n Σ_i of the squares of the field.
    """

    coordinates: np.ndarray
    squares: np.ndarray
    outside: float
    total: float

    def relative_error(self, reduced: np.ndarray) -> float:
        """Relative error of the field that reduced coordinates in the first modes stand for.

        The error within the modes and the part of the field outside them are orthogonal, so their
        squares add: nothing the size of the particles is needed, and nothing cancels.

        Parameters
        ----------
        reduced : array, shape (times, k)

        Returns
        -------
        float
            Relative L2 error; infinite if the coordinates are not finite, and as `share` where
            the field is zero.
        """
        k = reduced.shape[1]
        with np.errstate(over="ignore", invalid="ignore"):
            inside = reduced - self.coordinates[:, :k]
            squares = np.vdot(inside, inside) + self.squares[k:].sum() + self.outside
        if not np.isfinite(squares):
            return float("inf")
        return share(np.sqrt(squares), np.sqrt(self.total))


def project(field: np.ndarray, modes: np.ndarray) -> Projection:
    """Project a field (times, N) on orthonormal modes (modes, N)."""
    coordinates = np.empty((len(field), len(modes)))
    outside = total = 0.0
    for rows in blocks(len(field)):
        coordinates[rows] = field[rows] @ modes.T
        rest = field[rows] - coordinates[rows] @ modes
        outside += np.vdot(rest, rest)
        total += np.vdot(field[rows], field[rows])
    squares = np.einsum("tm,tm->m", coordinates, coordinates)
    return Projection(coordinates, squares, float(outside), float(total))


def project_solution(solution: Arrays, modes: Arrays, count: int) -> dict[str, Projection]:
    """Project velocity and density (times, N) of a solution on the first modes of each."""
    return {field: project(solution[field], modes[f"{field}_modes"][:count]) for field in FIELDS}


def blocks(count, size=512):
    """Slices of a few rows: what a field is compared with must not double its memory."""
    return (slice(start, start + size) for start in range(0, count, size))
