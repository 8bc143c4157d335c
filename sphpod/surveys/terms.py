"""Expressions as sums of products: what depends on parameters times what depends on x.

A coefficient c(x; μ) = Σ g_i(μ) h_i(x) of few terms lets an operator be projected once a term,
after which a query needs numbers g_i alone. An expression falls apart where the parameters stand
outside of functions that x stands in: ``stiffness*(1 + contrast*sin(x))`` does, ``exp(-x/width)``
does not.
"""

import ast
from collections.abc import Collection

from sphpod.numerics.expressions import reads

Terms = list[tuple[str, str]]
"""Of each term, the text of its factor of parameters and that of its factor of x."""

ONE = "1.0"

VARIABLES = frozenset({"x", "t"})
"""What parameters are told apart from: an expression here is of one of them."""


def separate(text: str, parameters: Collection[str]) -> Terms | None:
    """Terms of an expression in x, or likewise in t, or None if it does not fall apart."""
    return _terms(ast.parse(text.strip(), mode="eval").body, frozenset(parameters))


def _terms(node, parameters):
    found = reads(node)
    if not found & parameters:
        return [(ONE, ast.unparse(node))]
    if not found & VARIABLES:
        return [(ast.unparse(node), ONE)]
    match node:
        case ast.BinOp(op=ast.Add(), left=left, right=right):
            return _joined(_terms(left, parameters), _terms(right, parameters))
        case ast.BinOp(op=ast.Sub(), left=left, right=right):
            return _joined(_terms(left, parameters), _times("-1.0", _terms(right, parameters)))
        case ast.BinOp(op=ast.Mult(), left=left, right=right):
            return _product(_terms(left, parameters), _terms(right, parameters))
        case ast.BinOp(op=ast.Div(), left=left, right=right):
            return _product(_terms(left, parameters), _inverse(_terms(right, parameters)))
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return _times("-1.0", _terms(operand, parameters))
        case ast.UnaryOp(op=ast.UAdd(), operand=operand):
            return _terms(operand, parameters)
        case ast.Call(func=ast.Name(id="sum"), args=[series]):
            return _series(series, parameters)
        case ast.Call(func=ast.Name(id="where"), args=[where, one, other]):
            return _cases(where, one, other, parameters)
    return None


def _joined(one, other):
    return None if one is None or other is None else one + other


def _times(factor, terms):
    return None if terms is None else [(f"({factor})*({g})", h) for g, h in terms]


def _product(one, other):
    if one is None or other is None:
        return None
    return [(f"({g})*({k})", f"({h})*({m})") for g, h in one for k, m in other]


def _inverse(terms):
    """Of one term only."""
    if terms is None or len(terms) > 1:
        return None
    ((g, h),) = terms
    return [(f"1/({g})", f"1/({h})")]


def _series(series, parameters):
    """Terms of a sum, whose index stands in one factor of each."""
    match series:
        case ast.Tuple(elts=items) | ast.List(elts=items):
            found: Terms | None = []
            for item in items:
                found = _joined(found, _terms(item, parameters))
            return found
        case (
            ast.GeneratorExp(elt=item, generators=loops) | ast.ListComp(elt=item, generators=loops)
        ):
            within = _terms(item, parameters)
            over = " ".join(ast.unparse(loop) for loop in loops)
            indices = frozenset().union(*(reads(loop.target) for loop in loops))
            bounds = frozenset().union(*(reads(loop.iter) for loop in loops))
            if within is None or (bounds & (parameters | VARIABLES)):
                return None
            summed = []
            for g, h in within:
                in_g, in_h = (bool(reads(ast.parse(part)) & indices) for part in (g, h))
                if in_g and in_h:
                    return None
                summed.append((g, f"sum({h} {over})") if in_h else (f"sum({g} {over})", h))
            return summed
    return None


def _cases(where, one, other, parameters):
    """Terms of what is one thing at some places and another elsewhere."""
    if reads(where) & parameters:
        return None
    place = ast.unparse(where)
    first, second = _terms(one, parameters), _terms(other, parameters)
    if first is None or second is None:
        return None
    return [(g, f"where({place}, {h}, 0)") for g, h in first] + [
        (g, f"where({place}, 0, {h})") for g, h in second
    ]
