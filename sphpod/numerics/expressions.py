"""Safe evaluation of the short formulas a configuration describes a scene with.

An expression is a number or a text such as ``1e-3*sum(l*sin(2*pi*l*x/L) for l in range(1, 4))``.
It is parsed once, checked node by node against a short list of what is allowed, and compiled into
a function that acts elementwise on arrays. Nothing else of Python is within its reach. All numbers
are float64, whole ones too, so that none wraps round.
"""

import ast
import math
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import lru_cache, partial, reduce
from operator import call
from types import CodeType
from typing import Any

import numpy as np


def numbers(*bounds: float) -> Iterator[float]:
    """The numbers of a range whose bounds are whole."""
    if not all(float(bound).is_integer() for bound in bounds):
        raise ValueError("a bound of a range is not a whole number")
    return map(float, range(*map(int, bounds)))


def nth(values: tuple[float, ...], number: Any) -> Any:
    """The value with a number, rounded down; behind the last one they begin anew."""
    whole = np.floor(np.asarray(number, np.float64))
    index = np.where(np.isfinite(whole), whole, 0) % len(values)
    return np.where(np.isfinite(whole), np.array(values, float)[index.astype(np.int64)], np.nan)


FUNCTIONS: dict[str, Callable[..., Any]] = {
    "where": np.where,
    "sin": np.sin,
    "cos": np.cos,
    "exp": np.exp,
    "sqrt": np.sqrt,
    "abs": np.abs,
    "sum": partial(sum, start=0.0),
    "range": numbers,
    "nth": nth,
}
# A second argument of sin would be the array numpy writes its result to.
ARGUMENT_COUNTS = {"where": 3, "sin": 1, "cos": 1, "exp": 1, "sqrt": 1, "abs": 1}
LONGEST_SUM = 10000


def _power(base: Any, exponent: Any) -> Any:
    """A power that does not turn complex (it gives nan instead)."""
    result = np.asarray(base, dtype=np.float64) ** exponent
    constant = isinstance(base, float) and isinstance(exponent, float)
    if constant and base and math.isfinite(base) and np.isinf(result):
        raise OverflowError("a power is too large")
    return result


def _compare(relations: tuple[Callable[..., Any], ...], *operands: Any) -> Any:
    """``a < b < c``, each operand evaluated once."""
    return reduce(np.logical_and, map(call, relations, operands, operands[1:])) * 1.0


def _steps() -> Iterator[int]:
    """What the loops of all sums in an expression may take together."""
    yield from range(LONGEST_SUM)
    raise OverflowError(f"its sums run over more than {LONGEST_SUM} values")


def _taken(steps: Iterator[int]) -> int:
    """How many steps have been taken, at least one."""
    try:
        return max(next(steps), 1)
    except OverflowError:
        return LONGEST_SUM


# What becomes a call, and of what. Comparisons and logic give the numbers 1 and 0, so that they may
# enter arithmetic. Other operators do with arrays what they do with numbers.
CALLED: dict[type[ast.AST], Callable[..., Any]] = {
    ast.Div: np.true_divide,
    ast.FloorDiv: np.floor_divide,
    ast.Mod: np.remainder,
    ast.Pow: _power,
    ast.Compare: _compare,
    ast.Lt: np.less,
    ast.LtE: np.less_equal,
    ast.Gt: np.greater,
    ast.GtE: np.greater_equal,
    ast.Eq: np.equal,
    ast.NotEq: np.not_equal,
    ast.And: lambda *operands: reduce(np.logical_and, operands) * 1.0,
    ast.Or: lambda *operands: reduce(np.logical_or, operands) * 1.0,
    ast.Not: lambda operand: np.logical_not(operand) * 1.0,
    ast.comprehension: zip,
}
PLAIN = (ast.Add, ast.Sub, ast.Mult, ast.USub, ast.UAdd)


class _Elementwise(ast.NodeTransformer):
    """Turn what Python would not do elementwise, or do without limit, into calls."""

    def visit(self, node: ast.AST) -> Any:
        self.generic_visit(node)
        match node:
            case ast.Constant(value=int() | float() as value):
                node.value = float(value)
            case ast.BinOp(op=operator, left=left, right=right) if type(operator) in CALLED:
                return _call(operator, left, right)
            case ast.UnaryOp(op=ast.Not() as operator, operand=operand):
                return _call(operator, operand)
            case ast.BoolOp(op=operator, values=operands):
                return _call(operator, *operands)
            case ast.Compare(left=left, ops=operators, comparators=others):
                relations = ast.Tuple([_function(operator) for operator in operators], ast.Load())
                return _call(node, relations, left, *others)
            case ast.comprehension(target=index, iter=values):
                node.target = ast.Tuple([index, ast.Name("_", ast.Store())], ast.Store())
                node.iter = _call(node, values, ast.Name("_steps", ast.Load()))
        return node


def _function(node: ast.AST) -> ast.Name:
    # No name that an expression may hold begins with an underscore.
    return ast.Name(f"_{type(node).__name__}", ast.Load())


def _call(node: ast.AST, *arguments: ast.expr) -> ast.Call:
    return ast.Call(_function(node), list(arguments), [])


@lru_cache(maxsize=256)
def _read(text: str, variables: tuple[str, ...], constants: frozenset[str]) -> CodeType | str:
    """A function of the steps of sums and of the variables, or what of the text is not allowed.

    The same of all values that constants have, which many scenes differ in.
    """
    tree = ast.parse(text.strip(), mode="eval").body
    if refusal := _refusal(tree, constants.union(variables)):
        return refusal
    names = [ast.arg(name) for name in ("_steps", *variables)]
    arguments = ast.arguments([], names, kwonlyargs=[], kw_defaults=[], defaults=[])
    function = ast.Expression(ast.Lambda(arguments, _Elementwise().visit(tree)))
    return compile(ast.fix_missing_locations(function), "<expression>", "eval")


def _named(code: CodeType, constants: Mapping[str, float]) -> Callable[..., Any]:
    """The function of a code, in which names have values."""
    called = {f"_{node.__name__}": function for node, function in CALLED.items()}
    return eval(code, {"__builtins__": {}, **FUNCTIONS, **called, **constants})


def _refusal(node: ast.AST, names: frozenset[str]) -> str | None:
    """Say what of `node` is not allowed where `names` are known, or None if all of it is."""
    match node:
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
            return "a number is too large" if abs(value) > sys.float_info.max else None
        case ast.Constant(value=value):
            return f"{value!r} is not a real number"
        case ast.Name(id=name):
            return None if name in names else f"the name {name!r} is not known"
        case ast.BinOp(op=operator, left=left, right=right):
            return _refused_operator(operator) or _first_refusal((left, right), names)
        case ast.UnaryOp(op=operator, operand=operand):
            return _refused_operator(operator) or _refusal(operand, names)
        case ast.BoolOp(values=values):
            return _first_refusal(values, names)
        case ast.Compare(left=left, ops=operators, comparators=others):
            refusals = map(_refused_operator, operators)
            return next(filter(None, refusals), None) or _first_refusal((left, *others), names)
        case ast.Call(func=ast.Name(id="range")):
            return "a range is only allowed behind 'in'"
        case ast.Call(func=ast.Name(id="sum"), args=[argument], keywords=[]):
            return _refused_sum(argument, names)
        case ast.Call(
            func=ast.Name(id="nth"), args=[ast.Tuple(elts=values), number], keywords=[]
        ) if values:
            if len(values) > LONGEST_SUM:
                return f"nth takes {LONGEST_SUM} numbers at most, not {len(values)}"
            if "t" in reads(number) or any(reads(value) for value in values):
                return "nth counts numbers by x, as in nth((1, 3, 10), 3*x/L)"
            return _first_refusal((*values, number), names)
        case ast.Call(func=ast.Name(id="nth")):
            return "nth takes numbers and one of them, as in nth((1, 3, 10), 3*x/L)"
        case ast.Call(func=ast.Name(id="sum")):
            return "sum takes one series, as in sum(l*x for l in range(1, 4))"
        case ast.Call(func=ast.Name(id=name)) if name not in FUNCTIONS:
            return f"the function {name!r} is not known"
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]):
            if len(arguments) != ARGUMENT_COUNTS[name]:
                return f"{name} takes {ARGUMENT_COUNTS[name]} argument(s), not {len(arguments)}"
            return _first_refusal(arguments, names)
        case _:
            return f"{_quoted(node)} is not allowed"


def _quoted(node: ast.AST) -> str:
    return repr(_shortened(ast.unparse(node)))


def _shortened(text: str) -> str:
    """The text on one line, and not too long to be quoted in a message."""
    text = " ".join(text.split())
    return text if len(text) <= 100 else text[:97] + "..."


def _first_refusal(nodes: Iterable[ast.AST], names: frozenset[str]) -> str | None:
    return next(filter(None, (_refusal(node, names) for node in nodes)), None)


def _refused_operator(operator: ast.AST) -> str | None:
    if isinstance(operator, (*PLAIN, *CALLED)):
        return None
    if isinstance(operator, ast.BitXor):
        return "'^' is not allowed (a power is written '**')"
    return f"the operator {type(operator).__name__} is not allowed"


def _refused_sum(series: ast.AST, names: frozenset[str]) -> str | None:
    """Check the series of a sum: numbers in brackets, or a term for each value of an index."""
    match series:
        case ast.Tuple(elts=terms) | ast.List(elts=terms):
            return _first_refusal(terms, names)
        case (
            ast.GeneratorExp(elt=term, generators=loops) | ast.ListComp(elt=term, generators=loops)
        ):
            for loop in loops:
                if not isinstance(loop.target, ast.Name) or loop.ifs or loop.is_async:
                    return f"{_quoted(loop)} is not of the form 'for l in range(1, 4)'"
                index = loop.target.id
                if index in names or index in FUNCTIONS or index.startswith("_"):
                    return f"{index!r} cannot be the index of a sum"
                match loop.iter:
                    case ast.Call(func=ast.Name(id="range"), args=bounds, keywords=[]):
                        refusal = _first_refusal(bounds, names)
                    case ast.Tuple(elts=values) | ast.List(elts=values):
                        refusal = _first_refusal(values, names)
                    case _:
                        refusal = f"{_quoted(loop.iter)} is neither a range nor (1, 3, 10)"
                if refusal:
                    return refusal
                names |= {index}
            return _refusal(term, names)
        case _:
            return "sum takes one series, as in sum(l*x for l in range(1, 4))"


def reads(node: ast.AST) -> set[str]:
    """Names that a formula holds, those of functions too."""
    return {part.id for part in ast.walk(node) if isinstance(part, ast.Name)}


class _Replaced(ast.NodeTransformer):
    """Put something in the place of a variable wherever it stands."""

    def __init__(self, name: str, by: ast.AST):
        self.name, self.by = name, by

    def visit_Name(self, node: ast.Name) -> ast.AST:
        return self.by if node.id == self.name else node


class Expression:
    """A function of position, time or both, given as a number or a text.

    Parameters
    ----------
    text : number or text of the expression
    variables : names of its arguments, such as ``("x",)``
    constants : further names and their values, such as ``{"L": 1.0, "T": 10.0}``; pi is known

    Attributes
    ----------
    terms : int
        How many terms all its sums have together, or 1.

    Raises
    ------
    ValueError
        The text is no expression, or holds a name or a construct that is not allowed. The message
        is one sentence that quotes the text and says what is allowed.
    """

    def __init__(
        self,
        text: str | float,
        variables: tuple[str, ...],
        constants: Mapping[str, float] | None = None,
    ):
        self.text = str(text)
        self.variables = variables
        self.constants = {"pi": np.pi, **(constants or {})}
        refusal = ""
        try:
            found = _read(self.text, variables, frozenset(self.constants))
            if isinstance(found, str):
                refusal = found
            else:
                self._function = _named(found, self.constants)
        except SyntaxError:
            unpaired = self.text.count("(") - self.text.count(")")
            brackets = {0: "", 1: ", as a bracket stays open", -1: ", as a bracket is not opened"}
            refusal = f"it is not an expression{brackets[int(np.sign(unpaired))]}"
        except (ValueError, MemoryError, RecursionError):
            refusal = "it is too long, or nested too deeply"
        if "\0" in self.text:
            refusal = "it holds a NUL"
        if refusal:
            raise self._error(refusal)
        # Faults that only evaluation shows, such as sin(1, 2, 3), are to appear here too.
        left = _steps()
        self._evaluated(left, [np.ones(2) for _ in variables])
        self.terms = _taken(left)

    def __repr__(self) -> str:
        return f"Expression({self.text!r}, {self.variables!r})"

    def __reduce__(self) -> tuple:
        return Expression, (self.text, self.variables, self.constants)

    def __call__(self, /, **arrays: np.ndarray) -> np.ndarray:
        """Evaluate elementwise.

        Parameters
        ----------
        arrays : one array of real numbers for each variable, of shapes that broadcast together

        Returns
        -------
        float64 array of the arrays' common shape; nan or infinite where the expression is

        Raises
        ------
        ValueError
            The expression cannot be evaluated.
        """
        values = [np.asarray(arrays[name], dtype=np.float64) for name in self.variables]
        return self._evaluated(_steps(), values)

    def _evaluated(self, steps, values):
        result = np.empty(np.broadcast(*values).shape)
        try:
            with np.errstate(all="ignore"):
                # A value without an axis would be taken for a constant.
                result[...] = self._function(steps, *map(np.atleast_1d, values))
        except Exception as error:  # whatever Python and numpy make of a strange expression
            reason = " ".join(str(error).split()).rstrip(".")
            raise self._error(f"it cannot be evaluated ({reason})") from error
        return result

    def rewritten(self, text: str) -> "Expression":
        """Another expression in the same names."""
        return Expression(text, self.variables, self.constants)

    def shifted(self, by: float) -> "Expression":
        """The expression that gives at t what this one gives at t + ``by``."""
        later = ast.BinOp(ast.Name("t", ast.Load()), ast.Add(), ast.Constant(float(by)))
        return self._with("t", later, self.variables)

    def at(self, name: str, value: float) -> "Expression":
        """The expression of the other variables, with a number in the place of one."""
        left = tuple(variable for variable in self.variables if variable != name)
        return self._with(name, ast.Constant(float(value)), left)

    def _with(self, name, by, variables):
        tree = ast.parse(self.text.strip(), mode="eval").body
        return Expression(ast.unparse(_Replaced(name, by).visit(tree)), variables, self.constants)

    def _error(self, reason: str) -> ValueError:
        names = ", ".join((*self.variables, *self.constants, *FUNCTIONS))
        return ValueError(
            f"{_shortened(self.text)!r} is refused because {reason}; allowed are numbers, {names}, "
            "arithmetic (+ - * / // % **) and comparisons (also and, or, not)"
        )
