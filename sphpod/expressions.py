"""Safe evaluation of the short formulas a configuration describes a scene with.

An expression is a number or a text such as ``1e-3*sum(l*sin(2*pi*l*x/L) for l in range(1, 4))``.
It is parsed once, checked against a short list of what is allowed, and evaluated elementwise on
arrays by simpleeval. Nothing else of Python is within its reach.
"""

import ast
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
from simpleeval import EvalWithCompoundTypes

FUNCTIONS: dict[str, Callable[..., Any]] = {
    "where": np.where,
    "sin": np.sin,
    "cos": np.cos,
    "exp": np.exp,
    "sqrt": np.sqrt,
    "abs": np.abs,
    "sum": sum,
    "range": range,
}
# A second argument of sin would be the array numpy writes its result to.
ARGUMENT_COUNTS = {"where": 3, "sin": 1, "cos": 1, "exp": 1, "sqrt": 1, "abs": 1}


def _power(base: Any, exponent: Any) -> Any:
    """A power that neither builds astronomic integers nor turns complex (it gives nan instead)."""
    power = np.asarray(base, dtype=np.float64) ** exponent
    if isinstance(base, int) and isinstance(exponent, int) and exponent >= 0:
        if not np.isfinite(power):
            raise OverflowError("a power is too large")
        return base**exponent  # exact, so that it may bound a range
    return power


def _truth(compare: Callable[..., Any]) -> Callable[..., Any]:
    """Comparisons give the numbers 1 and 0, so that they may enter arithmetic."""
    return lambda *operands: compare(*operands) * 1.0


# simpleeval's own operators guard against long strings and lists by testing the truth of
# comparisons, which arrays do not have.
OPERATORS: dict[type[ast.AST], Callable[..., Any]] = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: np.true_divide,
    ast.FloorDiv: lambda a, b: a // b,
    ast.Mod: lambda a, b: a % b,
    ast.Pow: _power,
    ast.USub: lambda a: -a,
    ast.UAdd: lambda a: +a,
    ast.Lt: _truth(np.less),
    ast.LtE: _truth(np.less_equal),
    ast.Gt: _truth(np.greater),
    ast.GtE: _truth(np.greater_equal),
    ast.Eq: _truth(np.equal),
    ast.NotEq: _truth(np.not_equal),
    ast.BitAnd: _truth(np.logical_and),
    ast.BitOr: _truth(np.logical_or),
    ast.Invert: _truth(np.logical_not),
}
WRITTEN_OPERATORS = (*OPERATORS.keys() - {ast.BitAnd, ast.BitOr, ast.Invert}, ast.Not)


class _Elementwise(ast.NodeTransformer):
    """Rewrite ``a < b < c``, ``and``, ``or`` and ``not`` into operators that act elementwise."""

    def visit_Compare(self, node: ast.Compare) -> ast.expr:
        self.generic_visit(node)
        operands = [node.left, *node.comparators]
        pairs: list[ast.expr] = [
            ast.Compare(left, [operator], [right])
            for left, operator, right in zip(operands, node.ops, operands[1:], strict=False)
        ]
        return _chain(ast.BitAnd(), pairs)

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.expr:
        self.generic_visit(node)
        return _chain(ast.BitAnd() if isinstance(node.op, ast.And) else ast.BitOr(), node.values)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.expr:
        self.generic_visit(node)
        return ast.UnaryOp(ast.Invert(), node.operand) if isinstance(node.op, ast.Not) else node


def _chain(operator: ast.operator, operands: list[ast.expr]) -> ast.expr:
    chained = operands[0]
    for operand in operands[1:]:
        chained = ast.BinOp(chained, operator, operand)
    return chained


def _refusal(node: ast.AST, names: frozenset[str]) -> str | None:
    """Say what of `node` is not allowed where `names` are known, or None if all of it is."""
    match node:
        case ast.Constant(value=value):
            # A bool is an int to Python, a complex number is not real.
            return None if type(value) in (int, float) else f"{value!r} is not a real number"
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
    if isinstance(operator, WRITTEN_OPERATORS):
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


class Expression:
    """A function of position, time or both, given as a number or a text.

    Parameters
    ----------
    text : number or text of the expression
    variables : names of its arguments, such as ``("x",)``
    constants : further names and their values, such as ``{"L": 1.0, "T": 10.0}``; pi is known

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
        try:
            tree = ast.parse(self.text.strip(), mode="eval").body
            refusal = _refusal(tree, frozenset(variables) | set(self.constants))
            if not refusal:
                self._tree = ast.fix_missing_locations(_Elementwise().visit(tree))
        except SyntaxError:
            refusal = "it is not an expression"
        except (ValueError, MemoryError, RecursionError):
            refusal = "it is too long, or nested too deeply"
        if refusal:
            raise self._error(refusal)
        # Faults that only evaluation shows, such as sin(1, 2, 3), are to appear here too.
        self(**{name: np.ones(2) for name in variables})

    def __repr__(self) -> str:
        return f"Expression({self.text!r}, {self.variables!r})"

    def __call__(self, **arrays: np.ndarray) -> np.ndarray:
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
        values = {name: np.asarray(arrays[name], dtype=np.float64) for name in self.variables}
        shape = np.broadcast_shapes(*(value.shape for value in values.values()))
        evaluator = EvalWithCompoundTypes(
            operators=OPERATORS, functions=FUNCTIONS.copy(), names=self.constants | values
        )
        try:
            with np.errstate(all="ignore"):
                result = evaluator.eval(self.text, previously_parsed=self._tree)
                return np.array(np.broadcast_to(result, shape), dtype=np.float64)
        except Exception as error:  # whatever numpy or simpleeval make of a strange expression
            reason = " ".join(str(error).split()).rstrip(".")
            raise self._error(f"it cannot be evaluated ({reason})") from error

    def _error(self, reason: str) -> ValueError:
        names = ", ".join((*self.variables, *self.constants, *FUNCTIONS))
        return ValueError(
            f"{_shortened(self.text)!r} is refused because {reason}; allowed are numbers, {names}, "
            "arithmetic (+ - * / // % **) and comparisons (also and, or, not)"
        )
