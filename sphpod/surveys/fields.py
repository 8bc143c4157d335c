"""A profile of a scene for any values of its parameters."""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

import numpy as np

from sphpod.numerics.error import Arrays
from sphpod.numerics.expressions import Expression
from sphpod.surveys.terms import separate

Values = Mapping[str, float] | Arrays
"""Parameters of a query, or of many, (queries,) each."""

Sample = Callable[[Callable[..., np.ndarray]], np.ndarray]
"""Values of a function of x as the particles have them."""


def at_particles(positions: np.ndarray) -> Sample:
    """A function at the particles."""
    return lambda function: function(x=positions)


def at_half_cells(positions: np.ndarray, quarter: float, length: float) -> Sample:
    """A function as the mean of the two half cells of each particle."""
    sides = (positions - quarter) % length, (positions + quarter) % length
    return lambda function: (function(x=sides[0]) + function(x=sides[1])) / 2


class ParametricField:
    """h(x; μ) = Σ g_i(μ) h_i(x) at the particles; or, where it does not fall apart, as it stands.

    Parameters
    ----------
    parameters : names of the μ
    constants : further names and their values

    Attributes
    ----------
    profiles : array, shape (terms, N), or None
        h_i, None where the expression does not fall apart.
    """

    def __init__(
        self, text: str, parameters: Sequence[str], constants: Mapping[str, float], sample: Sample
    ) -> None:
        self.text, self.constants, self.sample = text, dict(constants), sample
        names = tuple(parameters)
        self.profiles: np.ndarray | None = None
        terms = separate(text, parameters)
        if terms is not None:
            self._factors = [Expression(g, names, constants) for g, _ in terms]
            self.profiles = np.array([sample(Expression(h, ("x",), constants)) for _, h in terms])
        try:
            self._whole: Expression | None = Expression(text, ("x", *names), constants)
        except ValueError:  # a parameter where only a number may be, as in a range
            self._whole = None

    @property
    def is_one_term(self) -> bool:
        """Whether the parameters only scale it."""
        return self.profiles is not None and len(self.profiles) == 1

    @property
    def is_elementwise(self) -> bool:
        """Whether parameters may be arrays in it."""
        return self._whole is not None

    def least(self, values: Mapping[str, float]) -> float:
        """The least value of the particles; of several terms, if positive, one that is below it."""
        if self.profiles is not None:
            least = float(self.floor(values))
            if self.is_one_term or least > 0:
                return least
            return float((self.factors(values) @ self._distinct).min())
        return float(self.at(values).min())

    def floor(self, values: Values) -> np.ndarray:
        """What the sum of the terms is nowhere below: the sum of their least values."""
        return (self.factors(values)[..., None, :] * self._ends).min(axis=-2).sum(axis=-1)

    @cached_property
    def _ends(self):
        """Least and largest value of each term, (2, terms)."""
        assert self.profiles is not None
        return np.array([self.profiles.min(axis=1), self.profiles.max(axis=1)])

    @cached_property
    def _distinct(self):
        """What the terms are together at the particles, once each: of layers a column a layer."""
        assert self.profiles is not None
        return np.unique(self.profiles, axis=1)

    @property
    def is_even(self) -> bool:
        """Whether it is the same everywhere, for all parameters."""
        return self.profiles is not None and not np.ptp(self.profiles, axis=1).any()

    def factors(self, values: Values) -> np.ndarray:
        """g_i, shape (terms,), or (queries, terms)."""
        arrays = _arrays(values)
        shape = np.broadcast_shapes(*(array.shape for array in arrays.values()))
        found = [np.broadcast_to(factor(**arrays), shape) for factor in self._factors]
        return np.stack(found, axis=-1).astype(float)

    def each(self, values: Values, particles: np.ndarray) -> np.ndarray:
        """The field of some of the particles in many queries, (queries, particles)."""
        if self.profiles is not None:
            return combined(self.factors(values), self.profiles[:, particles])
        points = zip(*values.values(), strict=True)
        return np.array([self.some(dict(zip(values, p, strict=True)), particles) for p in points])

    def some(self, values: Mapping[str, float], particles: np.ndarray) -> np.ndarray:
        """The field of some of the particles."""
        if self.profiles is not None:
            return self.factors(values) @ self.profiles[:, particles]
        return self.at(values)[particles]

    def at(self, values: Mapping[str, float]) -> np.ndarray:
        """The field of the particles, shape (N,)."""
        if self.profiles is not None:
            return self.factors(values) @ self.profiles
        if self._whole is None:
            return self.sample(Expression(self.text, ("x",), {**self.constants, **values}))
        whole = self._whole
        return self.sample(lambda x: whole(x=x, **_arrays(values)))


def combined(factors: np.ndarray, terms: np.ndarray) -> np.ndarray:
    """Σ_i g_i h_i, (queries, …), whose digits do not depend on the other queries.

    Parameters
    ----------
    factors : array, shape (queries, terms)
    terms : array, shape (terms, …)
    """
    found = np.zeros((len(factors), *terms.shape[1:]))
    for factor, term in zip(factors.T, terms, strict=True):
        found += np.multiply.outer(factor, term)
    return found


def _arrays(values):
    return {name: np.asarray(value) for name, value in values.items()}
