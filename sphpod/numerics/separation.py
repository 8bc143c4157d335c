"""Functions of position and time as sums of products, Σ_r g_r(t) p_r(x).

Whatever is linear in a force or a coefficient needs its profiles once, and only their factors at a
time. Where the formula is a sum of products, or becomes one by the sums of angles and exponents,
so that sin(k x - ω t) is two of them, its own parts are taken. Else it is interpolated,

    f(x, t) ≈ Σ_r f(x_r, t) p_r(x),    p_r(x) = Σ_s f(x, t_s) [f(x_q, t_p)]⁻¹_sr,

at places x_r and instants t_s, each pair of them where what is left is largest (empirical
interpolation). Of a function that breaks at places that travel, such as a load with a sharp front,
no sum of few products is near: then the x_r are all particles, and p_r is 1 at its own and falls
linearly to 0 at its neighbours.
"""

import ast
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from sphpod.numerics.course import Course, pieces_seen
from sphpod.numerics.expressions import Expression, reads

ACCURACY = 1e-13
"""Part of the largest value that an interpolation may miss at any place and instant looked at."""

WITNESSES = 16
"""Places whose course in time shows where instants are looked at."""

INSTANTS = 4096
"""Instants that are looked at, at most."""

VALUES = 2**22
"""Values that are looked at together, which bounds the memory."""

POINTS = 33
"""Instants that are looked at on each polynomial of a course."""

MOST_PIECES = 10_000
"""Polynomials of a course within which instants are looked at, about."""

PRODUCTS = 64
"""Products that a formula is written as, at most."""

LOOKED_AT = 64
"""Places and times at which parts of a formula are compared with it."""

ROUGHLY = 1e-6
"""Part of the largest value by which they may differ, as large arguments of sines are rounded."""

MOST_TERMS = 256
"""Terms of an interpolation, at most; what needs more breaks somewhere."""

MOST_PLACES = 4096
"""Places at all of which a function may be followed."""

FEW = 128
"""Places and times at which their number is estimated."""

SAMPLED = 512
"""Places and times of many at which it is found out that too many terms are needed."""

SEEN = 2**18
"""Intervals of time that are looked at before a function is followed, times the terms of sums."""

TOO_MANY = (
    "it is no sum of few products of a function of t and one of x, nor are there few enough "
    f"particles to follow it at each: {MOST_PLACES} at most"
)
"""What is wrong with a function that breaks at more places."""


@dataclass(frozen=True)
class Products:
    """Parts of a formula.

    Attributes
    ----------
    factors : tuple of Expressions in t
        g_r.
    shapes : tuple of Expressions in x, or None for 1
        p_r.
    """

    factors: tuple[Expression, ...]
    shapes: tuple[Expression | None, ...]

    def profiles(self, x: np.ndarray) -> np.ndarray:
        """p_r at places [m], shape (r, places)."""
        ones = np.ones_like(x)
        return np.array([ones if shape is None else shape(x=x) for shape in self.shapes])


@dataclass(frozen=True)
class Interpolated:
    """An interpolation.

    Attributes
    ----------
    expression : Expression in x and t
        f.
    places, instants : arrays, shape (r,)
        x_r [m] and t_s [s].
    factors : tuple of Expressions in t
        f(x_r, t).
    """

    expression: Expression
    places: np.ndarray
    instants: np.ndarray
    factors: tuple[Expression, ...]

    def profiles(self, x: np.ndarray) -> np.ndarray:
        """p_r at places [m], shape (r, places)."""
        known = self.expression(x=self.places[:, None], t=self.instants)
        values = self.expression(x=np.asarray(x)[:, None], t=self.instants)
        return np.linalg.solve(known.T, values.T)


@dataclass(frozen=True)
class Everywhere:
    """A function followed at all places.

    Attributes
    ----------
    places : array, shape (r,)
        x_r [m], ascending from 0, in a bar with ends up to L.
    length : float
        Period [m].
    factors : tuple of Expressions in t
        f(x_r, t).
    """

    places: np.ndarray
    length: float
    factors: tuple[Expression, ...]

    def profiles(self, x: np.ndarray) -> np.ndarray:
        """p_r at places [m], shape (r, places)."""
        count = self.places.size
        # The last place of a bar is L but for rounding.
        closed = self.places[-1] > (1 - 1e-12) * self.length
        nodes = self.places if closed else np.append(self.places, self.length)
        at = np.interp(x, nodes, np.arange(nodes.size))
        below = np.floor(at).astype(int)
        result = np.zeros((count + 1, at.size))
        result[below % count, np.arange(at.size)] = 1 - (at - below)
        result[np.where(at > below, (below + 1) % count, count), np.arange(at.size)] = at - below
        return result[:count]


@dataclass(frozen=True)
class Folded:
    """A sum of products of places in a bar, on a line of its images.

    Attributes
    ----------
    parts : Products, Interpolated or Everywhere
        Of the bar.
    fold : callable
        Of places on the line, the places in the bar that these are images of, and the sign there.
    """

    parts: Products | Interpolated | Everywhere
    fold: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]

    @property
    def factors(self) -> tuple[Expression, ...]:
        """g_r, those of the bar."""
        return self.parts.factors

    def profiles(self, x: np.ndarray) -> np.ndarray:
        """p_r at places [m], shape (r, places)."""
        places, signs = self.fold(x)
        return self.parts.profiles(places) * signs


Separated = Products | Interpolated | Everywhere | Folded


def separate(
    expression: Expression, duration: float, places: np.ndarray
) -> Products | Interpolated | Everywhere:
    """A function of x and t as a sum of products, made once in a process.

    Parameters
    ----------
    expression : Expression in x and t
    duration : float
        T [s].
    places : array, shape (N,)
        Where the function is looked at, ascending from 0 [m].

    Raises
    ------
    ValueError
        It is no sum of few products, and there are more than `MOST_PLACES` places.
    """
    constants = tuple(sorted(expression.constants.items()))
    return _separate(expression.text, constants, duration, np.asarray(places, float).tobytes())


@lru_cache
def _separate(text, constants, duration, places):
    expression, places = Expression(text, ("x", "t"), dict(constants)), np.frombuffer(places)
    found = _products(expression, duration, places)
    if found is None:
        check_places(expression, duration, places)
        found = _interpolated(expression, duration, places)
    return found


def _products(expression, duration, places):
    """The formula as a sum of products, if it is one."""
    parts = _parts(ast.parse(expression.text.strip(), mode="eval").body)
    if parts is None:
        return None
    known = expression.constants
    found = Products(
        tuple(Expression(_text(g), ("t",), known) for g, _ in parts),
        tuple(None if p is None else Expression(_text(p), ("x",), known) for _, p in parts),
    )
    return found if _add_up(found, expression, duration, places) else None


def check_places(expression: Expression, duration: float, places: np.ndarray) -> None:
    """Refuse what is no sum of few products at some of many places, and so not at all of them.

    Raises
    ------
    ValueError
        As of `separate`.
    """
    if places.size <= MOST_PLACES or _products(expression, duration, places) is not None:
        return
    some = places[:: places.size // SAMPLED]
    times = duration * (np.arange(1.0, SAMPLED) * (np.sqrt(5) - 1) / 2 % 1)
    values = expression(x=some[:, None], t=times)
    if _crosses(np.where(np.isfinite(values), values, 0.0))[0].size > MOST_TERMS:
        raise ValueError(TOO_MANY)


def product_count(expression: Expression, duration: float, places: np.ndarray) -> int:
    """About how many products a function of x and t is separated into, without separating it."""
    found = _products(expression, duration, places)
    if found is not None:
        return len(found.factors)
    some = places[:: max(1, places.size // FEW)]
    times = duration * (np.arange(1.0, FEW) * (np.sqrt(5) - 1) / 2 % 1)
    values = expression(x=some[:, None], t=times)
    count = _crosses(np.where(np.isfinite(values), values, 0.0))[0].size
    return count if 2 * count < min(some.size, FEW) else places.size


def _add_up(found, expression, duration, places):
    """Whether no part is beyond double precision where the formula is not, as exponents may be."""
    x, times = places[:: max(1, places.size // LOOKED_AT)], np.linspace(0, duration, LOOKED_AT)
    x = np.append(x, places[-1])
    expected = expression(x=x[:, None], t=times)
    with np.errstate(all="ignore"):
        sums = found.profiles(x).T @ np.array([factor(t=times) for factor in found.factors])
        known = np.isfinite(expected)
        allowed = ROUGHLY * np.abs(expected[known]).max(initial=0)
        return bool((np.abs(sums - expected)[known] <= allowed).all())


# --- Parts of a formula ---------------------------------------------------------------------------


def _text(node):
    return "1" if node is None else ast.unparse(node)


def _parts(node):
    """Pairs of a part in t and one in x, each None for 1, whose products add up; None if not so."""
    names = reads(node)
    if "x" not in names:
        return [(node, None)]
    if "t" not in names:
        return [(None, node)]
    found = None
    match node:
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            found = _times(_parts(operand), [(ast.Constant(-1.0), None)])
        case ast.UnaryOp(op=ast.UAdd(), operand=operand):
            found = _parts(operand)
        case ast.BinOp(op=ast.Add(), left=left, right=right):
            found = _plus(_parts(left), _parts(right))
        case ast.BinOp(op=ast.Sub(), left=left, right=right):
            found = _plus(_parts(left), _parts(ast.UnaryOp(ast.USub(), right)))
        case ast.BinOp(op=ast.Mult(), left=left, right=right):
            found = _times(_parts(left), _parts(right))
        case ast.BinOp(op=ast.Div(), left=left, right=right) if len(reads(right) & {"x", "t"}) < 2:
            below = ast.BinOp(ast.Constant(1.0), ast.Div(), right)
            found = _times(_parts(left), _parts(below))
        case ast.Call(func=ast.Name(id="sin" | "cos" | "exp" as name), args=[argument]):
            found = _of_sum(name, argument)
    return found if found is None or len(found) <= PRODUCTS else None


def _plus(some, more):
    return None if some is None or more is None else some + more


def _times(some, more):
    if some is None or more is None or len(some) * len(more) > PRODUCTS:
        return None
    return [(_product(g, h), _product(p, q)) for g, p in some for h, q in more]


def _product(left, right):
    if left is None or right is None:
        return right if left is None else left
    return ast.BinOp(left, ast.Mult(), right)


def _of_sum(name, argument):
    """sin, cos or exp of a(t) + b(x)."""
    parts = _parts(argument)
    if parts is None or any(g is not None and p is not None for g, p in _merged(parts)):
        return None
    a = [g for g, p in _merged(parts) if p is None]
    b = [p for g, p in _merged(parts) if g is None]
    a, b = _sum_of(a), _sum_of(b)

    def of(function, part):
        return ast.Call(ast.Name(function, ast.Load()), [part], [])

    if name == "exp":
        return [(of("exp", a), of("exp", b))]
    even, odd = (of("cos", a), of("cos", b)), (of("sin", a), of("sin", b))
    if name == "cos":
        return [even, (ast.BinOp(ast.Constant(-1.0), ast.Mult(), odd[0]), odd[1])]
    return [(odd[0], even[1]), (even[0], odd[1])]


def _merged(parts):
    """Parts in which a number times a function of x alone is a function of x alone."""
    return [
        (None, _product(g, p))
        if p is not None and g is not None and not reads(g) & {"t"}
        else (g, p)
        for g, p in parts
    ]


def _sum_of(nodes):
    total = nodes[0]
    for node in nodes[1:]:
        total = ast.BinOp(total, ast.Add(), node)
    return total


# --- Interpolation --------------------------------------------------------------------------------


def instants(courses: list[Course], most: int = INSTANTS) -> np.ndarray:
    """Times at which functions of time are looked at, dense wherever any of them changes [s].

    Both sides of every edge between polynomials, and `POINTS` within each.
    """
    return _dense([course.edges for course in courses], most)


def changes(
    expression: Expression,
    duration: float,
    places: np.ndarray,
    most: int = INSTANTS,
    parts: int = 1,
    witnesses: int = WITNESSES,
) -> np.ndarray:
    """Times at which a function of time, or of x and t, is looked at before it is followed [s].

    As `instants`, of its factors or, where it is no sum of products, of it at about so many
    ``witnesses``; at a cost that neither places nor breaks raise, divided by ``parts``.
    """
    found = None
    if "x" in expression.variables:
        found = _products(expression, duration, places)
        if found is None:
            some = places[:: max(1, places.size // witnesses)]
            limit = max(64, SEEN // (some.size * expression.terms * parts))
            return _dense(pieces_seen(expression, duration, limit, some), most)
    followed = [expression] if found is None else found.factors
    limit = max(64, SEEN // (len(followed) * expression.terms * parts))
    return _dense([one for f in followed for one in pieces_seen(f, duration, limit)], most)


def _dense(found_edges, most):
    found = []
    for ends in found_edges:
        every = max(1, ends.size // MOST_PIECES)
        edges = np.append(ends[:-1:every], ends[-1])
        low, high = edges[:-1], edges[1:]
        within = (
            low[:, None] + (high - low)[:, None] * (1 - np.cos(np.linspace(0, np.pi, POINTS))) / 2
        )
        inner = np.stack([np.nextafter(low, high), np.nextafter(high, low)])
        found += [ends, within.ravel(), inner.ravel()]
    times = np.unique(np.concatenate(found))
    every = max(1, -(-times.size // most))
    return np.unique(np.append(times[::every], times[[0, -1]]))


def _interpolated(expression, duration, places):
    witnesses = places[:: max(1, places.size // WITNESSES)]
    courses = [Course.of(expression.at("x", float(place)), duration) for place in witnesses]
    most = min(INSTANTS, max(64, VALUES // places.size))
    times = instants(courses, most)
    if places.size <= MOST_PLACES:
        # What happens at a single place is seen at no other.
        everywhere = changes(expression, duration, places, most, witnesses=places.size)
        times = np.union1d(times, everywhere)
    # Those that judge are in no step with those that are looked at.
    judged_at = duration * (np.arange(1.0, times.size) * (np.sqrt(5) - 1) / 2 % 1)
    for looked_at in (times, np.union1d(times, (times[1:] + times[:-1]) / 2)):
        values = expression(x=places[:, None], t=looked_at)
        # What is not finite is refused by the checks of a scene, which name where it is so.
        values = np.where(np.isfinite(values), values, 0.0)
        rows, columns = _crosses(values)
        if not rows.size:
            # Zero at all places and times, such as what is switched on after the end.
            return Products((Expression(0, ("t",), expression.constants),), (None,))
        found = Interpolated(
            expression,
            places[rows],
            looked_at[columns],
            tuple(expression.at("x", float(place)) for place in places[rows]),
        )
        allowed = 100 * ACCURACY * np.abs(values).max(initial=0)
        if rows.size > MOST_TERMS:
            break  # More instants ask for no fewer.
        if rows.size < places.size and _missed(found, places, judged_at) <= allowed:
            return found
    if places.size > MOST_PLACES:
        raise ValueError(TOO_MANY)
    factors = tuple(expression.at("x", float(place)) for place in places)
    return Everywhere(places, expression.constants["L"], factors)


def _missed(found, places, times):
    factors = np.array([g(t=times) for g in found.factors]).reshape(-1, times.size)
    known = found.profiles(places).T @ factors if len(factors) else 0.0
    left = found.expression(x=places[:, None], t=times) - known
    return np.abs(left[np.isfinite(left)]).max(initial=0)


def _crosses(values):
    """Rows and columns through which values (places, instants) are interpolated to rounding."""
    left = values.copy()
    rows: list[int] = []
    columns: list[int] = []
    limit = ACCURACY * np.abs(values).max(initial=0)
    while len(rows) < min(*values.shape, MOST_TERMS + 1):
        row, column = np.unravel_index(np.argmax(np.abs(left)), left.shape)
        if np.abs(left[row, column]) <= limit:
            break
        rows.append(int(row))
        columns.append(int(column))
        left -= np.outer(left[:, column], left[row] / left[row, column])
    return np.array(rows, np.int64), np.array(columns, np.int64)
