"""Ends of a bar, fixed or free: beyond them a periodic line goes on with the bar's mirror images.

About a fixed end velocity v and force f are odd, about a free end the strain e is; all else is
even. So v = 0 at a fixed end and c e = 0 at a free one, and what solves a model on the line solves
it on the bar. The line is of period 2 L, or 4 L where the ends are not alike:

    0 to L the bar | L to 2 L about its right end | then both about the left end

Particles stand at x_i = i Δx with L = M Δx, those on ends with half their cell in the bar. The
models see the line, files and figures the bar (`sphpod.bar`).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sphpod.numerics.expressions import Expression
from sphpod.numerics.separation import Everywhere, Folded, Interpolated, Products

KINDS = ("fixed", "free")
"""What an end may be."""

VELOCITY, STRAIN, MATERIAL = "fixed", "free", ""
"""Kind of end about which these are odd; a force is as a velocity."""

PARTS = 8
"""Parts of a spacing, at whose ends a place is the same number as its mirror image."""

NEAR = 1e-9
"""Distance in such parts below which a place is at the end of one but for rounding."""


@dataclass(frozen=True)
class Ends:
    """Both ends of a bar.

    Attributes
    ----------
    left, right : "fixed" or "free"
        The end at x = 0, and that at x = L.
    length : float
        L [m].
    """

    left: str
    right: str
    length: float

    @classmethod
    def of(cls, settings: Mapping[str, Any]) -> "Ends | None":
        """Ends that the settings of a scene give; None of a periodic line."""
        boundary = settings.get("boundary", "periodic")
        if boundary == "periodic":
            return None
        left, right = boundary
        return cls(left, right, float(settings["domain_length"]))

    def __str__(self) -> str:
        return f"[{self.left}, {self.right}]"

    @property
    def copies(self) -> int:
        """Number of bars, the one itself among them, that a period holds."""
        return 2 if self.left == self.right else 4

    @property
    def is_fixed(self) -> bool:
        """Whether an end is fixed, by which the bar cannot be translated."""
        return "fixed" in (self.left, self.right)

    @property
    def is_free(self) -> bool:
        """Whether an end is free."""
        return "free" in (self.left, self.right)

    def signs(self, odd: str) -> np.ndarray:
        """Sign in each bar of a period of what is odd about ends of a kind, shape (copies,)."""
        left, right = (-1.0 if end == odd else 1.0 for end in (self.left, self.right))
        return np.array([1.0, right, right * left, left])[: self.copies]

    def folded(self, x: np.ndarray, spacing: float, odd: str) -> tuple[np.ndarray, np.ndarray]:
        """Places in the bar that those on the line are images of, and the sign of what is there.

        The image of a particle is at the very number that the particle is at, so that a material
        which jumps there jumps at both.

        Parameters
        ----------
        x : array
            Places on the line [m].
        spacing : float
            Δx [m].
        odd : str
            Kind of end about which the field is odd.

        Returns
        -------
        places, signs : arrays of the shape of x
            In [0, L] [m]; 1, -1, or 0 at the ends themselves about which the field is odd.
        """
        bar = x / self.length
        places = _exact(self.length - np.abs(self.length - x % (2 * self.length)), spacing / PARTS)
        signs = self.signs(odd)[np.floor(bar).astype(np.int64) % self.copies]
        wall = np.rint(bar).astype(np.int64)
        on_wall = np.abs(bar - wall) * self.length < NEAR * spacing
        for number, end in enumerate((self.left, self.right)):
            if end == odd:
                signs[on_wall & (wall % 2 == number)] = 0.0
        return places, signs

    def images(self, count: int, odd: str) -> tuple[np.ndarray, np.ndarray]:
        """Of each of ``count`` particles of a period, the one it is an image of, and its sign.

        Returns
        -------
        sources : int64 array, shape (count,)
            Numbers of particles of the bar, which are the first ``count/copies + 1``.
        signs : array, shape (count,)
            As from `folded`.
        """
        intervals = count // self.copies
        number = np.arange(count)
        signs = self.signs(odd)[number // intervals % self.copies]
        for start, end in ((0, self.left), (intervals, self.right)):
            if end == odd:
                signs[start :: 2 * intervals] = 0.0
        return intervals - np.abs(intervals - number % (2 * intervals)), signs


class Mirrored(Expression):
    """An expression in x, or in x and t, of a bar, on all of the line.

    Parameters
    ----------
    spacing : float
        Δx [m].
    odd : str
        Kind of end about which it is odd.
    """

    def __init__(self, expression: Expression, ends: Ends, spacing: float, odd: str = MATERIAL):
        self.expression, self.ends, self.spacing, self.odd = expression, ends, spacing, odd
        super().__init__(expression.text, expression.variables, expression.constants)

    def __reduce__(self) -> tuple:
        return Mirrored, (self.expression, self.ends, self.spacing, self.odd)

    def fold(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places in the bar that those on the line are images of, and signs (`Ends.folded`)."""
        return self.ends.folded(x, self.spacing, self.odd)

    def __call__(self, **arrays: np.ndarray) -> np.ndarray:
        """As that of the bar at the places that these are images of, times their signs."""
        places, signs = self.fold(np.asarray(arrays["x"], np.float64))
        with np.errstate(invalid="ignore"):  # what is not finite stays so
            return super().__call__(**{**arrays, "x": places}) * signs

    def of_line(self, parts: Products | Interpolated | Everywhere) -> Products | Folded:
        """On all of the line, a sum of products that this expression in x and t is in the bar."""
        if not isinstance(parts, Products):
            return Folded(parts, self.fold)
        one = Expression(1, ("x",))
        shapes = (
            Mirrored(shape or one, self.ends, self.spacing, self.odd) for shape in parts.shapes
        )
        return Products(parts.factors, tuple(shapes))

    def shifted(self, by: float) -> "Mirrored":
        """That of the bar which gives at t what this one gives at t + ``by``."""
        return Mirrored(self.expression.shifted(by), self.ends, self.spacing, self.odd)

    def rewritten(self, text: str) -> "Mirrored":
        """Another expression of the same bar."""
        return Mirrored(self.expression.rewritten(text), self.ends, self.spacing, self.odd)


def _exact(places, part):
    """Places that are a whole number of parts but for rounding, without that rounding."""
    numbers = places / part
    whole = np.rint(numbers)
    return np.where(np.abs(numbers - whole) < NEAR, whole * part, places)
