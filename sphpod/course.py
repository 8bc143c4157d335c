"""The course of a force over time: piecewise polynomials."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

NODES = 24
"""Chebyshev coefficients on each piece."""

ACCURACY = 1e-12
"""Part of the largest force that the last coefficients may be."""

LARGEST = 2**12
"""Most pieces that are tried."""


@dataclass(frozen=True)
class Course:
    """A force over time as a polynomial on each of several pieces.

    Attributes
    ----------
    edges : array, shape (pieces + 1,)
        Ends of the pieces [s], from 0 to T.
    coefficients : array, shape (pieces, n)
        Chebyshev coefficients of each piece.
    missed : float
        Integral of how far the force is from the polynomials, at most; inf if it is not known.
    """

    edges: np.ndarray
    coefficients: np.ndarray
    missed: float

    def __call__(self, t: np.ndarray) -> np.ndarray:
        """The polynomials at times [s]."""
        t = np.asarray(t, float)
        piece = np.clip(np.searchsorted(self.edges, t, "right") - 1, 0, len(self.coefficients) - 1)
        left, right = self.edges[piece], self.edges[piece + 1]
        place = (2 * t - left - right) / (right - left)
        return chebyshev.chebval(place, self.coefficients[piece].T, tensor=False)


def course(force: Callable[[np.ndarray], np.ndarray], duration: float) -> Course:
    """The course of a smooth force from its values."""
    points = chebyshev.chebpts1(NODES)
    pieces = 1
    while pieces <= LARGEST:
        edges = np.linspace(0, duration, pieces + 1)
        middle, half = (edges[1:] + edges[:-1]) / 2, duration / pieces / 2
        values = force((middle[:, None] + half * points).ravel()).reshape(pieces, NODES)
        coefficients = chebyshev.chebfit(points, values.T, NODES - 1).T
        if np.abs(coefficients[:, -4:]).max() <= ACCURACY * np.abs(values).max():
            return Course(edges, coefficients, 0.0)
        pieces *= 2
    return Course(edges, coefficients, np.inf)
