"""Bounds of an expression over whole intervals of its variable, proved by its tree.

Nothing is sampled: each node of the tree turns bounds of its operands into bounds of its value, for
many intervals at once. Two kinds of bounds are carried,

- of the real values over the interval, which decide comparisons, signs and floors there;
- of the complex values over a disc `REACH` half widths around the interval's middle. Where all
  those decisions are made, the expression is one analytic function in the disc, and a polynomial
  of degree n misses no more of it on the interval than its size in the disc times `remainder(n)`.

All bounds are widened by more than the rounding of the operation that made them.
"""

import ast
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np

from sphpod.numerics.expressions import CALLED, FUNCTIONS, Expression, nth, numbers

REACH = 4.0
"""Half widths of an interval that its disc reaches from its middle."""

ROUNDING = 2.0**-51
"""Relative widening of bounds, four times what rounding does to a sum, product or quotient."""

FUNCTION_ROUNDING = 8
"""So much more widening does a function of numpy's or a power need."""

AT_ONCE = 2**13
"""Intervals that are bounded together; few enough for the processor's cache."""

OPERATORS: dict[type[ast.AST], Callable[..., Any]] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.USub: np.negative,
    ast.UAdd: np.positive,
    **CALLED,
}


@dataclass(frozen=True)
class Enclosure:
    """Bounds of an expression's values over intervals, arrays of shape (intervals,) or ().

    Attributes
    ----------
    low, high : arrays
        The real values over the interval lie between; infinite where no bound is known.
    centre, radius : arrays
        The complex values in the interval's disc lie in this disc about a real number; the radius
        is infinite, and the centre anything, where it may not be one analytic function.
    variable : bool
        Whether it is the variable itself, which takes each value once.
    """

    low: np.ndarray
    high: np.ndarray
    centre: np.ndarray
    radius: np.ndarray
    variable: bool = False


def remainder(degree: int) -> float:
    """Largest distance of f from its best polynomial on [-1, 1], of |f| on the disc of `REACH`.

    The disc holds the ellipse with foci ±1 whose half axes add up to ρ = R + √(R² - 1), on which
    the Chebyshev series leaves at most 2 ρ^-n/(ρ - 1).
    """
    rho = REACH + np.sqrt(REACH**2 - 1)
    return float(2 * rho**-degree / (rho - 1))


def enclose(
    expression: Expression, low: np.ndarray, high: np.ndarray, places: np.ndarray | None = None
) -> Enclosure:
    """Bounds of an expression of one variable, or of t at places, over intervals.

    Parameters
    ----------
    expression : Expression
        In one variable, or in x and t.
    low, high : arrays, shape (intervals,)
        Ends of the intervals; equal for the value at a point, rounding included.
    places : array, shape (intervals,), optional
        x of each.
    """
    if low.size > AT_ONCE:
        rows = [slice(first, first + AT_ONCE) for first in range(0, low.size, AT_ONCE)]
        some = [
            enclose(expression, low[part], high[part], None if places is None else places[part])
            for part in rows
        ]
        names = "low", "high", "centre", "radius"
        low, high, centre, radius = (
            np.concatenate([getattr(part, name) for part in some]) for name in names
        )
        return Enclosure(low, high, centre, radius)
    if places is not None:
        variables = {"x": _interval(places, places), "t": _interval(low, high, variable=True)}
        return _enclosed(expression, variables, low.shape)
    (name,) = expression.variables
    return _enclosed(expression, {name: _interval(low, high, variable=True)}, low.shape)


def bounds_in(
    expression: Expression, **ends: tuple[np.ndarray, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest value that an expression may have in boxes, by their ends in each variable.

    Parameters
    ----------
    ends : pairs of arrays, of shapes that broadcast together
        Low and high ends, one pair for each variable.

    Returns
    -------
    low, high : arrays of the common shape
    """
    variables = {name: _interval(*ends[name]) for name in expression.variables}
    shape = np.broadcast_shapes(*(one.low.shape for one in variables.values()))
    value = _enclosed(expression, variables, shape)
    return value.low, value.high


def _interval(low, high, variable=False):
    middle = (low + high) / 2
    # The half width as seen from a rounded middle.
    half = np.maximum(high - middle, middle - low) * (1 + ROUNDING)
    return Enclosure(low, high, middle, REACH * half, variable)


def _enclosed(expression, variables, shape):
    tree = ast.parse(expression.text.strip(), mode="eval").body
    with np.errstate(all="ignore"):
        value = _lifted(_value(tree, {**expression.constants, **variables}))
    parts = (value.low, value.high, value.centre, value.radius)
    low, high, centre, radius = (np.broadcast_to(part, shape) for part in parts)
    return Enclosure(low, high, centre, radius)


def _value(node: ast.AST, names: dict[str, Any]) -> Any:
    """A float where the variable is not met, else an Enclosure."""
    match node:
        case ast.Constant(value=int() | float() as value):
            return float(value)
        case ast.Name(id=name):
            return names[name]
        case ast.BinOp(op=operator, left=left, right=right):
            return _applied(type(operator), _value(left, names), _value(right, names))
        case ast.UnaryOp(op=operator, operand=operand):
            return _applied(type(operator), _value(operand, names))
        case ast.BoolOp(op=operator, values=operands):
            return _applied(type(operator), *(_value(operand, names) for operand in operands))
        case ast.Compare(left=left, ops=operators, comparators=others):
            operands = [_value(operand, names) for operand in (left, *others)]
            compared = zip(operators, operands, operands[1:], strict=False)
            return _applied(ast.And, *(_applied(type(op), a, b) for op, a, b in compared))
        case ast.Call(func=ast.Name(id="sum"), args=[ast.Tuple(elts=terms) | ast.List(elts=terms)]):
            return reduce(_sum, (_value(term, names) for term in terms), 0.0)
        case ast.Call(
            args=[
                ast.GeneratorExp(elt=term, generators=loops)
                | ast.ListComp(elt=term, generators=loops)
            ]
        ):
            return reduce(_sum, (_value(term, inner) for inner in _looped(loops, names)), 0.0)
        case ast.Call(func=ast.Name(id="nth"), args=[ast.Tuple(elts=values), number]):
            choices = tuple(_value(one, names) for one in values)
            at = _value(number, names)
            if isinstance(at, Enclosure):
                return _any_of(choices, at)
            return float(nth(choices, at))
        case ast.Call(func=ast.Name(id=name), args=arguments):
            return _applied(name, *(_value(argument, names) for argument in arguments))
    raise ValueError(f"{ast.unparse(node)} has no bounds")


def _looped(loops: list[ast.comprehension], names: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Names and values for each turn of nested loops."""
    if not loops:
        yield names
        return
    loop, *inner = loops
    match loop.iter:
        case ast.Call(args=bounds):
            values: Any = numbers(*(_value(bound, names) for bound in bounds))
        case ast.Tuple(elts=elements) | ast.List(elts=elements):
            values = (_value(element, names) for element in elements)
    for value in values:
        yield from _looped(inner, {**names, ast.unparse(loop.target): value})


def _applied(what: type[ast.AST] | str, *operands: Any) -> Any:
    if any(isinstance(operand, Enclosure) for operand in operands):
        return BOUNDS[what](*map(_lifted, operands))
    function = FUNCTIONS[what] if isinstance(what, str) else OPERATORS[what]
    return float(function(*operands))


def _lifted(value: Any) -> Enclosure:
    if isinstance(value, Enclosure):
        return value
    point: Any = np.float64(value)
    if np.isfinite(point):
        return Enclosure(point, point, point, np.zeros(()))
    return _bounded(point, point, point, np.inf)


def _bounded(low, high, centre, radius) -> Enclosure:
    """Bounds of which those that are not a number are none."""
    return Enclosure(
        np.fmax(low, -np.inf), np.fmin(high, np.inf), centre, np.where(radius >= 0, radius, np.inf)
    )


def _rounded(low, high, centre, radius, factor=1) -> Enclosure:
    """Bounds that hold what rounding did to them."""
    share = factor * ROUNDING
    return _bounded(
        low - share * np.abs(low),
        high + share * np.abs(high),
        centre,
        radius * (1 + share) + share * np.abs(centre),
    )


def _between(*values):
    return reduce(np.minimum, values), reduce(np.maximum, values)


# --- Arithmetic -----------------------------------------------------------------------------------


def _any_of(values, number):
    """Bounds of all that there is to choose from, wherever the number is known to be one."""
    known = np.isfinite(number.low) & np.isfinite(number.high)
    low, high = np.where(known, min(values), -np.inf), np.where(known, max(values), np.inf)
    return Enclosure(low, high, 0.0 * low, np.full(known.shape, np.inf))


def _sum(a, b):
    return _applied(ast.Add, a, b)


def _add(a, b):
    return _rounded(a.low + b.low, a.high + b.high, a.centre + b.centre, a.radius + b.radius)


def _negative(a):
    return Enclosure(-a.high, -a.low, -a.centre, a.radius)


def _subtract(a, b):
    return _add(a, _negative(b))


def _multiply(a, b):
    ends = a.low * b.low, a.low * b.high, a.high * b.low, a.high * b.high
    radius = np.abs(a.centre) * b.radius + np.abs(b.centre) * a.radius + a.radius * b.radius
    low, high = _between(*ends)
    return _rounded(low, high, a.centre * b.centre, radius)


def _reciprocal(a):
    size = np.abs(a.centre)
    radius = np.where(size > a.radius, a.radius / (size * (size - a.radius)), np.inf)
    apart = (a.low > 0) | (a.high < 0)
    low, high = np.where(apart, 1 / a.high, -np.inf), np.where(apart, 1 / a.low, np.inf)
    return _rounded(low, high, 1 / a.centre, radius)


def _divide(a, b):
    return _multiply(a, _reciprocal(b))


def _floor(a):
    """The floor, which is known where no whole number is within the bounds."""
    low, high = np.floor(a.low), np.floor(a.high)
    return _bounded(low, high, low, np.where(low == high, 0.0, np.inf))


def _floor_divide(a, b):
    return _floor(_divide(a, b))


def _remainder(a, b):
    result = _subtract(a, _multiply(b, _floor_divide(a, b)))
    low, high = np.minimum(b.low, 0), np.maximum(b.high, 0)
    return _bounded(
        np.maximum(result.low, low), np.minimum(result.high, high), result.centre, result.radius
    )


def _power(a, b):
    """A constant whole exponent, or exp(b log a) where a is positive."""
    exponent = b.low if b.low.ndim == 0 and b.low == b.high else None
    if exponent is not None and exponent == np.floor(exponent):
        return _whole_power(a, exponent)
    positive = _exponential(_multiply(b, _logarithm(a)))
    if exponent is None or exponent < 0:
        return positive
    # A base that falls to zero: what is real of its power does so too.
    falls = (a.low <= 0) & (a.high >= 0)
    top = np.maximum(a.high, 0) ** exponent * (1 + FUNCTION_ROUNDING * ROUNDING)
    return _bounded(
        np.where(falls, 0.0, positive.low),
        np.where(falls, top, positive.high),
        positive.centre,
        positive.radius,
    )


def _whole_power(a, exponent):
    if exponent < 0:
        return _reciprocal(_whole_power(a, -exponent))
    low, high = _between(a.low**exponent, a.high**exponent)
    if exponent % 2 == 0:
        low = np.where((a.low <= 0) & (a.high >= 0), 0.0, low)
    size = np.abs(a.centre)
    outer = (size + a.radius) ** exponent
    # The difference of two powers, each with its own rounding.
    radius = outer - size**exponent
    radius = np.where(a.radius > 0, radius + 2 * FUNCTION_ROUNDING * ROUNDING * outer, 0.0)
    return _rounded(low, high, a.centre**exponent, radius, FUNCTION_ROUNDING)


# --- Functions ------------------------------------------------------------------------------------


def _wave(a, function, crest):
    """sin or cos, whose largest values are at ``crest`` + 2πk and its smallest halfway between."""

    def within(place):
        turns = [(end - place) / (2 * np.pi) for end in (a.low, a.high)]
        slack = [4 * ROUNDING * (1 + np.abs(turn)) for turn in turns]
        return ~(np.ceil(turns[0] - slack[0]) > np.floor(turns[1] + slack[1]))

    low, high = _between(function(a.low), function(a.high))
    other = np.cos if function is np.sin else np.sin
    centre, slope = function(a.centre), np.abs(other(a.centre))
    radius = np.abs(centre) * 2 * np.sinh(a.radius / 2) ** 2 + slope * np.sinh(a.radius)
    radius = np.where(a.radius > 0, radius, 0)
    result = _rounded(low, high, centre, radius, FUNCTION_ROUNDING)
    return Enclosure(
        np.where(within(crest + np.pi), -1.0, np.maximum(-1, result.low)),
        np.where(within(crest), 1.0, np.minimum(1, result.high)),
        result.centre,
        result.radius,
    )


def _sine(a):
    return _wave(a, np.sin, np.pi / 2)


def _cosine(a):
    return _wave(a, np.cos, 0.0)


def _exponential(a):
    low, high, centre = np.exp(a.low), np.exp(a.high), np.exp(a.centre)
    # Far from the centre its share is small, and the product of the other two may not be known.
    outer = np.exp(a.centre + a.radius + ROUNDING * (np.abs(a.centre) + a.radius))
    radius = np.where(a.radius > 1, outer, centre * np.expm1(a.radius))
    return _rounded(low, high, centre, radius, FUNCTION_ROUNDING)


def _logarithm(a):
    share = a.radius / a.centre * (1 + ROUNDING)
    radius = np.where(a.centre > a.radius, -np.log1p(-share), np.inf)
    low, high = (np.where(a.low > 0, np.log(end), np.nan) for end in (a.low, a.high))
    return _rounded(low, high, np.log(a.centre), radius, FUNCTION_ROUNDING)


def _root(a):
    """Where the bounds reach zero, what is real of the root does so too."""
    least = np.sqrt(np.maximum(a.centre - a.radius, 0))
    centre = np.sqrt(a.centre)
    radius = np.where(least > 0, a.radius / (centre + least), np.inf)
    real = a.high >= 0
    low = np.where(real, np.sqrt(np.maximum(a.low, 0)), np.nan)
    return _rounded(low, np.where(real, np.sqrt(np.maximum(a.high, 0)), np.nan), centre, radius)


def _absolute(a):
    low = np.where(a.low >= 0, a.low, np.where(a.high <= 0, -a.high, 0.0))
    one_sign = (a.low >= 0) | (a.high <= 0)
    high = np.maximum(np.abs(a.low), np.abs(a.high))
    return _bounded(low, high, np.abs(a.centre), np.where(one_sign, a.radius, np.inf))


# --- Decisions ------------------------------------------------------------------------------------


def _verdict(true, false):
    """1 where true, 0 where false, either where neither is known."""
    return Enclosure(
        np.where(true, 1.0, 0.0),
        np.where(false, 0.0, 1.0),
        np.where(true, 1.0, 0.0),
        np.where(true | false, 0.0, np.inf),
    )


def _truth(a):
    return (a.low > 0) | (a.high < 0), (a.low == 0) & (a.high == 0)


def _less(a, b):
    true, false = a.high < b.low, a.low >= b.high
    return _verdict(true | (_meet_once(a, b) & (a.high <= b.low)), false)


def _less_equal(a, b):
    true, false = a.high <= b.low, a.low > b.high
    return _verdict(true, false | (_meet_once(a, b) & (a.low >= b.high)))


def _meet_once(a, b):
    """The variable equals a number at one moment alone, which no integral sees."""
    constant = b if a.variable else a
    return (a.variable or b.variable) & (constant.low == constant.high)


def _equal(a, b):
    same = (a.low == a.high) & (a.low == b.low) & (b.low == b.high)
    apart = (a.high < b.low) | (a.low > b.high)
    touching = (a.high <= b.low) | (a.low >= b.high)
    return _verdict(same & ~_meet_once(a, b), apart | (_meet_once(a, b) & touching))


def _not(a):
    true, false = _truth(a)
    return _verdict(false, true)


def _and(*operands):
    truths = [_truth(operand) for operand in operands]
    return _verdict(reduce(np.logical_and, [t for t, _ in truths]),
                    reduce(np.logical_or, [f for _, f in truths]))  # fmt: skip


def _or(*operands):
    return _not(_and(*map(_not, operands)))


def _where(condition, a, b):
    true, false = _truth(condition)
    low, high = np.minimum(a.low, b.low), np.maximum(a.high, b.high)
    low, high, centre, radius = (
        np.where(true, x, np.where(false, y, z))
        for x, y, z in (
            (a.low, b.low, low),
            (a.high, b.high, high),
            (a.centre, b.centre, 0.0),
            (a.radius, b.radius, np.inf),
        )
    )
    return Enclosure(low, high, centre, radius)


BOUNDS: dict[type[ast.AST] | str, Callable[..., Enclosure]] = {
    ast.Add: _add,
    ast.Sub: _subtract,
    ast.Mult: _multiply,
    ast.Div: _divide,
    ast.FloorDiv: _floor_divide,
    ast.Mod: _remainder,
    ast.Pow: _power,
    ast.USub: _negative,
    ast.UAdd: lambda a: a,
    ast.Lt: _less,
    ast.LtE: _less_equal,
    ast.Gt: lambda a, b: _less(b, a),
    ast.GtE: lambda a, b: _less_equal(b, a),
    ast.Eq: _equal,
    ast.NotEq: lambda a, b: _not(_equal(a, b)),
    ast.And: _and,
    ast.Or: _or,
    ast.Not: _not,
    "where": _where,
    "sin": _sine,
    "cos": _cosine,
    "exp": _exponential,
    "sqrt": _root,
    "abs": _absolute,
}
"""Bounds of each operation, from those of its operands."""
