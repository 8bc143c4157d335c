"""The course of a force in time, as polynomials on pieces of it that are proved to be the force.

A force's time factor is an expression, whose tree `sphpod.numerics.enclosure` bounds over whole
intervals. Where that shows one analytic function, few enough changes to an interval, the polynomial
through its values at Chebyshev points is the function to rounding. Elsewhere the interval is
halved, until it is so short that whatever happens within cannot matter: a jump ends between two
neighbouring floating-point numbers. No sample decides, so that no pulse is too short to be seen.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial import chebyshev, legendre

from sphpod.numerics.enclosure import enclose, remainder
from sphpod.numerics.expressions import Expression

NODES = 24
"""Coefficients of each polynomial, and points of the rules that integrate with it."""

TOLERANCE = 1e-12
"""Part of ∫|f| dt that the polynomials may miss where f is smooth."""

BREAKS = 1e-11
"""Part of ∫|f| dt that may fall into breaks."""

LIMIT = 2**21
"""Intervals looked at, beyond which a force is not followed further and not proved."""

OPEN_LIMIT = 2**15
"""Pieces that may be undecided at once."""

LEBESGUE = 8.0
"""No interpolation through Chebyshev or Gauss points magnifies rounding at the nodes by more."""

MISSED = remainder(NODES - 1) * (1 + LEBESGUE)
"""Largest deviation of an interpolation on an interval, of the size of f in the interval's disc."""

POINTS, WEIGHTS = legendre.leggauss(NODES)
"""Gauss-Legendre points in [-1, 1] and their weights."""

PLACES = np.cos(np.pi * (np.arange(NODES)[::-1] + 0.5) / NODES)
"""Chebyshev points in [-1, 1]."""

_TO_COEFFICIENTS = chebyshev.chebvander(PLACES, NODES - 1) * (2 / NODES)
_TO_COEFFICIENTS[:, 0] /= 2
# Mean of |ℓ| over [-1, 1] of each Lagrange polynomial of the places: what rounding there does.
_INFLUENCES = (
    np.abs(chebyshev.chebval(np.linspace(-1, 1, 1001), _TO_COEFFICIENTS.T)).mean(axis=1) * 1.01
)
_SEEN = (1 + np.cos(np.pi * (np.arange(3) + 0.5) / 3)) / 2
# Values at Gauss points times their weights, to Legendre coefficients.
_LEGENDRE = legendre.legvander(POINTS, NODES - 1) * (np.arange(NODES) + 0.5)
_TO_POINTS = chebyshev.chebvander(POINTS, NODES - 1).T


@dataclass(frozen=True)
class Course:
    """Polynomials that are a force.

    Attributes
    ----------
    expression : Expression
        f(t) [m/s²].
    edges : array, shape (pieces + 1,)
        Ascending from 0 to T [s].
    coefficients : array, shape (pieces, NODES)
        Chebyshev coefficients on each piece [m/s²].
    missed : float
        Bound of ∫|f - p| dt over all pieces [m/s]; infinite where it could not be proved.
    total : float
        ∫|p| dt by Gauss-Legendre quadrature [m/s].
    smooth : bool array, shape (pieces,)
        Whether f is proved to be an analytic function on the piece, which the polynomial goes
        through; on others, where f breaks or is next to nothing, it is the middle of f's bounds.
    breaks : array
        Those edges across which f is not known to be one analytic function [s].
    singular : float
        A time at which f was found not to be finite [s], nan if none was.
    """

    expression: Expression
    edges: np.ndarray
    coefficients: np.ndarray
    missed: float
    total: float
    smooth: np.ndarray
    breaks: np.ndarray
    singular: float

    @classmethod
    def of(cls, expression: Expression, duration: float) -> "Course":
        """The course of an expression in t over [0, duration], made once in a process."""
        constants = tuple(sorted(expression.constants.items()))
        return _course(expression.text, expression.variables, constants, float(duration))

    def __call__(self, times: np.ndarray) -> np.ndarray:
        """The polynomials at times [s]."""
        times = np.asarray(times, dtype=np.float64)
        piece = np.searchsorted(self.edges, times, side="right") - 1
        piece = np.clip(piece, 0, len(self.coefficients) - 1)
        low, high = self.edges[piece], self.edges[piece + 1]
        place = np.clip(((times - low) - (high - times)) / (high - low), -1, 1)
        coefficients = np.moveaxis(self.coefficients[piece], -1, 0)
        return chebyshev.chebval(place, coefficients, tensor=False)

    def slopes(self, times: np.ndarray) -> np.ndarray:
        """Derivatives of the polynomials at times [s], in f's unit per second."""
        piece = np.searchsorted(self.edges, times, side="right") - 1
        piece = np.clip(piece, 0, len(self.coefficients) - 1)
        low, high = self.edges[piece], self.edges[piece + 1]
        place = np.clip(((times - low) - (high - times)) / (high - low), -1, 1)
        slopes = chebyshev.chebder(self.coefficients[piece], axis=1)
        return chebyshev.chebval(place, slopes.T, tensor=False) * (2 / (high - low))

    def departures(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Bounds of |p - q| on intervals, q the polynomial through f at their Gauss points.

        The difference is a polynomial on each part of a piece, and below the sum of its Chebyshev
        coefficients.

        Parameters
        ----------
        low, high : arrays, shape (intervals,)
            Ends of ascending intervals that do not overlap [s].

        Returns
        -------
        array, shape (intervals,)
        """
        values = _values(self.expression, _points(low, high, POINTS))
        coefficients = values * WEIGHTS @ _LEGENDRE
        start, end, interval, piece = self._parts(low, high)
        times = _points(start, end, PLACES)
        places = 2 * (times - low[interval, None]) / (high - low)[interval, None] - 1
        known = np.moveaxis(coefficients[interval], 1, 0)[..., None]
        difference = self._on(piece, times) - legendre.legval(places, known, tensor=False)
        result = np.zeros(low.size)
        np.maximum.at(result, interval, np.abs(difference @ _TO_COEFFICIENTS).sum(axis=1))
        return result

    def projected(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Polynomials nearest to f in the mean on intervals, at the intervals' Gauss points.

        What a force does through any response that is a polynomial of degree below `NODES`, it does
        through these values too.

        Parameters are those of `departures`.

        Returns
        -------
        array, shape (intervals, NODES)
            Not finite from where the force was found not to be.
        """
        start, end, interval, piece = self._parts(low, high)
        times = _points(start, end, POINTS)
        values = self._on(piece, times)
        result = np.zeros((low.size, NODES))
        whole = np.bincount(interval, minlength=low.size) == 1
        result[interval[whole[interval]]] = values[whole[interval]]
        # Moments with Legendre polynomials: exact, as both factors are polynomials on each part.
        part = ~whole[interval]
        interval, width = interval[part], (high - low)[interval[part], None]
        places = 2 * (times[part] - low[interval, None]) / width - 1
        shares = values[part] * WEIGHTS * ((end - start)[part, None] / width)
        moments = np.zeros_like(result)
        for first in range(0, interval.size, 512):
            some = slice(first, first + 512)
            polynomials = legendre.legvander(np.clip(places[some], -1, 1), NODES - 1)
            terms = np.einsum("iq,iqk->ik", shares[some], polynomials)
            np.add.at(moments, interval[some], terms)
        result[~whole] = moments[~whole] @ _LEGENDRE.T
        # Nothing is known any more of what a force does that was found not to be finite.
        result[high > self.singular] = np.nan
        return result

    @property
    def integrals(self) -> np.ndarray:
        """∫f dt from the start to the end of each piece [m/s], of the polynomials."""
        even = np.arange(0, self.coefficients.shape[1], 2)
        means = self.coefficients[:, even] @ (1 / (1.0 - even**2))
        return np.cumsum(means * np.diff(self.edges))

    def impulse(self, times: np.ndarray) -> np.ndarray:
        """Upper bounds of ∫|f| dt from the start to each of ascending times [m/s]."""
        cuts = np.union1d(times, self.edges)
        bounds = enclose(self.expression, cuts[:-1], cuts[1:])
        sizes = np.maximum(np.abs(bounds.low), np.abs(bounds.high)) * np.diff(cuts)
        return np.concatenate([[0.0], np.cumsum(sizes)])[np.searchsorted(cuts, times)]

    def _parts(self, low, high):
        """Parts of intervals that lie in one piece each: start, end, interval and piece."""
        cuts = np.unique(np.concatenate([low, high, self.edges]))
        cuts = cuts[(cuts >= low[0]) & (cuts <= high[-1])]
        start, end = cuts[:-1], cuts[1:]
        interval = np.searchsorted(low, start, side="right") - 1
        inside = start < high[interval]
        start, end, interval = start[inside], end[inside], interval[inside]
        piece = np.searchsorted(self.edges, start, side="right") - 1
        return start, end, interval, np.clip(piece, 0, len(self.coefficients) - 1)

    def _on(self, piece, times):
        """Values of pieces (n,) at times (n, points) in them."""
        low, high = self.edges[piece, None], self.edges[piece + 1, None]
        places = np.clip(((times - low) - (high - times)) / (high - low), -1, 1)
        coefficients = np.moveaxis(self.coefficients[piece], 1, 0)[..., None]
        return chebyshev.chebval(places, coefficients, tensor=False)


@dataclass(frozen=True)
class Span:
    """A time between breaks of a force, with what it breaks in before it.

    Attributes
    ----------
    first, last : float
        Start and end [s]; the spans of a force follow one another without a gap.
    inner : (float, float)
        First and last time at which the force is that between the breaks [s].
    shortest : float
        Shortest piece on which it is a polynomial [s].
    """

    first: float
    last: float
    inner: tuple[float, float]
    shortest: float


def spans(courses: tuple[Course, ...], duration: float) -> list[Span]:
    """Spans of a force that is a sum of terms, one at least.

    Terms that could not be followed are only parted where they were found not to be finite.
    """
    proved = [course for course in courses if np.isfinite(course.missed)]
    cuts = [[0.0, duration], *(course.breaks for course in proved)]
    ends = np.unique(np.concatenate([*cuts, [c.singular for c in courses if c.singular > 0]]))
    begins, ends = ends[:-1], ends[1:]
    wide = ends - begins > BREAKS * duration
    # What breaks at the very end is met there, by the span before it.
    begins, ends = begins[wide], ends[wide]
    ends[-1] = duration
    shortest = np.full(ends.size, np.inf)
    for course in proved:
        edges = np.unique(np.concatenate([course.edges, begins, ends]))
        within = np.searchsorted(edges, np.stack([begins, ends], axis=1).ravel())
        widths = np.diff(edges)
        widths[widths <= BREAKS * duration] = np.inf
        least = np.minimum.reduceat(np.append(widths, np.inf), within)[::2]
        shortest = np.minimum(shortest, least)
    return [
        Span(float(before), float(end), (float(low), float(high)), float(width))
        for before, end, low, high, width in zip(
            np.append(0.0, ends[:-1]), ends, np.nextafter(begins, ends),
            np.nextafter(ends, begins), shortest, strict=True,
        )
    ]  # fmt: skip


@lru_cache(maxsize=64)
def _course(text, variables, constants, duration):
    expression = Expression(text, variables, dict(constants))
    _, low, high, decided, radius, sums = _pieces(expression, duration)
    ends = low
    if decided.all():
        low, high, radius = _merged(expression, low, high, radius, sums)
    edges, width, smooth = np.append(low, duration), high - low, np.isfinite(radius)
    times = _points(low, high, PLACES)
    values = _values(expression, times)
    seen = np.concatenate([ends, [duration], times.ravel()])
    sound = np.isfinite(_values(expression, seen))
    missed = np.full(low.size, np.inf)
    if decided.all():
        doubt = _rounding(expression, times[smooth], low[smooth, None], high[smooth, None])
        missed[smooth] = MISSED * radius[smooth] + doubt @ _INFLUENCES
        # Where bounds say more, as of what may break, the polynomial is their middle.
        bounds = enclose(expression, low, high)
        with np.errstate(invalid="ignore"):
            middle, reach = (bounds.low + bounds.high) / 2, (bounds.high - bounds.low) / 2
        flat = reach < missed
        values[flat], missed[flat] = middle[flat, None], reach[flat]
        smooth &= ~flat
    values[~np.isfinite(values)] = 0
    coefficients = values @ _TO_COEFFICIENTS
    total = np.sum(width / 2 * (np.abs(coefficients @ _TO_POINTS) @ WEIGHTS))
    breaks = edges[1:-1][~np.isfinite(enclose(expression, low[:-1], high[1:]).radius)]
    for array in (edges, coefficients, smooth, breaks):
        array.setflags(write=False)
    return Course(
        expression,
        edges,
        coefficients,
        float(missed @ width),
        float(total),
        smooth,
        breaks,
        float(np.min(seen[~sound], initial=np.inf)) if not sound.all() else np.nan,
    )


def _rounding(expression, times, low, high):
    """Largest effect of rounding, of the times too, on values at times (pieces, points)."""
    before, after = np.nextafter(times, -np.inf), np.nextafter(times, np.inf)
    ends = np.maximum(before, low).ravel(), np.minimum(after, high).ravel()
    points = enclose(expression, *ends)
    return (points.high - points.low).reshape(times.shape)


def _swing(expression, low, high):
    """Bounds of what f may change by on intervals, times their lengths."""
    bounds = enclose(expression, low, high)
    return (bounds.high - bounds.low) * (high - low)


def _points(low, high, places):
    """Places in [-1, 1] as times in each interval, (intervals, places)."""
    return low[:, None] + (high - low)[:, None] * ((1 + places) / 2)


def _values(expression, times, places=None):
    if places is not None:
        return expression(x=places, t=times)
    (name,) = expression.variables
    return expression(**{name: times})


def pieces_seen(
    expression: Expression, duration: float, limit: int, places: np.ndarray | None = None
) -> list[np.ndarray]:
    """Ends of pieces of [0, duration], as a `Course` has them, made of about ``limit`` at most.

    Where that is too few for the function they are short somewhere, and no piece is more than a
    sixteenth long. Of an expression in x and t, at each of some places.
    """
    at, low, *_ = _pieces(expression, duration, limit, places)
    return [np.append(one, duration) for one in np.split(low, np.flatnonzero(np.diff(at)) + 1)]


def _pieces(expression, duration, limit=LIMIT, places=None):
    """Place, ends of pieces, whether each is decided, the radius of its disc, and ∫|f| over it."""
    many = 1 if places is None else places.size
    edges = np.linspace(0, duration, 17)
    low, high = np.tile(edges[:-1], many), np.tile(edges[1:], many)
    at = np.repeat(np.arange(many), 16)
    done = []
    known, count = np.zeros(many), np.zeros(many)
    while low.size:
        width, middle = high - low, (low + high) / 2
        x = None if places is None else places[at]
        bounds = enclose(expression, low, high, x)
        error, sizes = MISSED * bounds.radius, np.zeros(low.size)
        analytic = np.isfinite(error)
        with np.errstate(invalid="ignore", over="ignore"):
            times = (low[:, None] + width[:, None] * _SEEN)[analytic]
            there = None if x is None else x[analytic, None]
            sizes[analytic] = np.abs(_values(expression, times, there)).mean(axis=1)
            smooth = error <= TOLERANCE * sizes
            sound = smooth & np.isfinite(sizes)
            known += np.bincount(at[sound], (width * sizes)[sound], many)
            smooth |= error <= TOLERANCE * known[at] / duration
            # What is left undecided matters too little, or lies between two neighbouring numbers.
            undecided = np.bincount(at, minlength=many)
            ended = (bounds.high - bounds.low) * width <= BREAKS * known[at] / undecided[at]
        decided = smooth | ended | (middle <= low) | (middle >= high)
        count += undecided
        over = (count > limit) | (np.bincount(at[~decided], minlength=many) > OPEN_LIMIT)
        taken = decided | over[at]
        parts = at, low, high, decided, bounds.radius, sizes * width
        done.append([part[taken] for part in parts])
        at, low, middle, high = (part[~taken] for part in (at, low, middle, high))
        low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
        at = np.concatenate([at, at])
    pieces = [np.concatenate(part) for part in zip(*done, strict=True)]
    order = np.lexsort((pieces[1], pieces[0]))
    return [part[order] for part in pieces]


def _merged(expression, low, high, radius, sums):
    """Neighbours that one polynomial fits as well, or that one break fills, made one piece."""
    broken = ~np.isfinite(radius)
    first = ~(broken & np.roll(broken, 1))
    first[0] = True
    run, last = np.cumsum(first) - 1, np.append(low[first][1:], high[-1])
    swing = np.zeros(low.size)
    swing[broken] = _swing(expression, low[broken], high[broken])
    apart, together = np.bincount(run, swing), np.zeros(last.size)
    joint = broken[first]
    together[joint] = _swing(expression, low[first][joint], last[joint])
    first |= (together > 1.01 * apart)[run]
    high = np.append(low[first][1:], high[-1])
    low, radius, sums = (part[first] for part in (low, radius, sums))
    mean = np.nansum(sums) / (high[-1] - low[0])
    # Whether a piece may be joined with the next one, and has not been seen not to.
    untried = np.isfinite(radius)
    while untried[:-1].any():
        for first in (0, 1):
            left = np.arange(first, low.size - 1, 2)
            left = left[untried[left]]
            left, apart = left[np.isfinite(radius[left + 1])], left
            untried[apart] = False
            joint = enclose(expression, low[left], high[left + 1]).radius
            with np.errstate(invalid="ignore", over="ignore"):
                own = (sums[left] + sums[left + 1]) / (high[left + 1] - low[left])
                fit = MISSED * joint <= TOLERANCE * np.fmax(own, mean)
            joined = left[fit]
            radius[joined], high[joined] = joint[fit], high[joined + 1]
            sums[joined] += sums[joined + 1]
            before = np.maximum(joined - 1, 0)
            untried[joined], untried[before] = True, np.isfinite(radius[before])
            keep = np.ones(low.size, bool)
            keep[joined + 1] = False
            low, high, radius, sums, untried = (
                part[keep] for part in (low, high, radius, sums, untried)
            )
    return low, high, radius
