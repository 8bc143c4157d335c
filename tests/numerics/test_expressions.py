"""Expressions: what they give, and what they refuse."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sphpod.numerics.expressions import Expression

CONSTANTS = {"L": 2.0, "T": 10.0}
X = np.linspace(0, 2, 9)


def evaluate(text, x=X):
    return Expression(text, ("x",), CONSTANTS)(x=x)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (0.1, np.full(9, 0.1)),
        (3, np.full(9, 3.0)),
        ("2e-4", np.full(9, 2e-4)),
        ("x", X),
        ("-x**2", -(X**2)),
        ("1/2 + 7//2 + 7 % 4", np.full(9, 6.5)),
        ("1 - 2 - 3", np.full(9, -4.0)),
        ("2**-1", np.full(9, 0.5)),
        ("2**x", 2**X),
        ("sin(2*pi*x/L)", np.sin(np.pi * X)),
        ("exp(-x) + sqrt(x) + abs(x - T) + cos(x)", np.exp(-X) + np.sqrt(X) + 10 - X + np.cos(X)),
        (
            "1e-3*sum(l*sin(2*pi*l*x/L) for l in range(1, 4))",
            1e-3 * sum(n * np.sin(np.pi * n * X) for n in (1, 2, 3)),
        ),
        ("sum(cos(l*x - l**3) for l in (1, 3, 10))", sum(np.cos(n * X - n**3) for n in (1, 3, 10))),
        ("sum([x, 2*x, 1])", 3 * X + 1),
        ("sum(l*m*x for l in range(3) for m in range(l))", 2 * X),
        ("sum(sum(l*m*x for l in range(3)) for m in range(3))", 9 * X),
        ("sum(Div/2 for Div in [1, 2, 3]) + sum(1 for l in range(2**3))", np.full(9, 11.0)),
        ("where(0 < x/L <= 1/2, 0.1, 0.2)", np.where((X > 0) & (X <= 1), 0.1, 0.2)),
        ("x < 1 and x > 0.5 or x == 2", (X < 1) & (X > 0.5) | (X == 2)),
        ("not x < 1", X >= 1),
        ("(x >= 1) - (x != 2)", (X >= 1) * 1.0 - (X != 2)),
    ],
)
def test_value(text, expected):
    value = evaluate(text)
    assert value.dtype == np.float64
    np.testing.assert_array_equal(value, expected)


@settings(deadline=None)
@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_number_is_an_expression(number):
    np.testing.assert_array_equal(evaluate(number), np.full(9, number))


@settings(deadline=None)
@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(-3, 3))
def test_chained_comparison_is_the_conjunction(a, b, c):
    chained = evaluate(f"({a}) < x <= ({b}) != ({c})")
    np.testing.assert_array_equal(chained, (a < X) & (b >= X) & np.full(9, b != c))


def test_arguments_broadcast_and_are_left_alone():
    product = Expression("x*t", ("x", "t"))
    x, t = np.arange(3.0), np.arange(4.0)[:, None]
    assert product(x=x, t=t).shape == (4, 3)
    value = evaluate("x", x)
    value[:] = 7
    np.testing.assert_array_equal(x, np.arange(3.0))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("where(x < L/2, 2000000000, 2000000000)*10000000000", 2e19),
        ("abs(10**18)*100", 1e20),
        ("abs(-9223372036854775807)*2", 2.0**64),
        ("9223372036854775807 + 9223372036854775807", 2.0**64),
        ("where(x < 9, 2**62, 1)*4 - 2**64", 0),
        ("10**20//7 - 10**20/7", 0),
        ("-10**20 % 7 - (-1e20) % 7.0", 0),
        ("(-2**63 - 2**63)//2**32", -(2.0**32)),
        ("2**70 - 2.0**70", 0),
        ("sum(l**30 for l in (10, 20)) - sum(l**30 for l in (10.0, 20.0))", 0),
        ("sum(l for l in range(2**40, 2**40 + 3))*2**30", 3 * 2.0**70 + 3 * 2.0**30),
        ("sum(10**18 for l in range(1, 100))", 99e18),
        ("(x < 9)*10**18*100", 1e20),
        ("(1 and 2) + (0 or 3) + (not 0) + 10**30*0", 3),
        ("sum(1 for l in range(10/2))", 5),
        ("sum([]) + sum(l for l in range(0))", 0),
    ],
)
def test_whole_numbers_do_not_wrap(text, expected):
    value = evaluate(text)
    assert value.dtype == np.float64
    np.testing.assert_allclose(value, expected, rtol=2e-16)


@pytest.mark.parametrize(
    "text",
    [
        "1/0", "1//0", "1 % 0", "abs(1)//abs(0)", "sum([])//0", "0**-1", "sqrt(x - 3)",
        "(-8)**(1/3)", "(-x - 1)**0.5", "exp(1e4)",
    ],
)  # fmt: skip
def test_not_finite_without_fault_or_warning(text):
    assert not np.isfinite(evaluate(text)).any()


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "not an expression"),
        ("x +", "not an expression"),
        ("where(x < 1", "as a bracket stays open"),
        ("sin(x)) + 1", "as a bracket is not opened"),
        ("x = 1", "not an expression"),
        ("x; x", "not an expression"),
        ("import os", "not an expression"),
        ("2e-4 m", "not an expression"),
        ("t", "the name 't' is not known"),
        ("sin", "the name 'sin' is not known"),
        ("nan", "the name 'nan' is not known"),
        ("l + sum(l for l in (1, 2))", "the name 'l' is not known"),
        ("tan(x)", "the function 'tan' is not known"),
        ("__import__('os')", "the function '__import__' is not known"),
        ("x.size", "'x.size' is not allowed"),
        ("x[0]", "'x[0]' is not allowed"),
        ("lambda: x", "'lambda: x' is not allowed"),
        ("(y := x)", "'(y := x)' is not allowed"),
        ("x if 1 else 2", "'x if 1 else 2' is not allowed"),
        ("[x, x]", "'[x, x]' is not allowed"),
        ("sin(x=x)", "'sin(x=x)' is not allowed"),
        ("'x'", "'x' is not a real number"),
        ("1j", "1j is not a real number"),
        (True, "True is not a real number"),
        ("x^2", "a power is written '**'"),
        ("x & 1", "the operator BitAnd is not allowed"),
        ("x in (1, 2)", "the operator In is not allowed"),
        ("sin(x, x)", "sin takes 1 argument"),
        ("where(x)", "where takes 3 argument"),
        ("range(3)", "only allowed behind 'in'"),
        ("sum(range(3))", "sum takes one series"),
        ("sum(x for x in range(3))", "'x' cannot be the index"),
        ("sum(L for L in range(3))", "'L' cannot be the index"),
        ("sum(l for l in range(3) if l)", "is not of the form"),
        ("sum(l for l in x)", "neither a range nor"),
        ("sum(l for l in range(1.5))", "cannot be evaluated"),
        ("sum(l for l in range(1/0))", "cannot be evaluated (a bound of a range is not a whole"),
        ("1" + "0" * 400, "a number is too large"),
        ("x*1e999", "a number is too large"),
        ("sum(1 for l in range(10**9))", "(its sums run over more than 10000 values)"),
        ("sum(1 for l in range(101) for m in range(99))", "more than 10000 values"),
        ("sum(sum(1 for m in range(99)) for l in range(101))", "more than 10000 values"),
        ("sum([sum(1 for l in range(9**4)), sum(1 for l in range(9**4))])", "more than 10000"),
        ("9**9**9", "cannot be evaluated (a power is too large)"),
        ("4000000**4000000", "cannot be evaluated (a power is too large)"),
        ("(" * 500 + "x" + ")" * 500, "not an expression"),
        ("+".join(["x"] * 10000), "nested too deeply"),
    ],
)
def test_refused_in_one_sentence_that_says_what_is_allowed(text, reason):
    with pytest.raises(ValueError, match="is refused because") as caught:
        Expression(text, ("x",), CONSTANTS)
    message = str(caught.value)
    assert reason in message
    assert str(text)[:30].strip() in message
    assert "allowed are numbers, x, pi, L, T, where" in message
    assert "\n" not in message
    assert len(message) < 500


@pytest.mark.parametrize(
    "text",
    [
        "x.__class__",
        "(1).__class__.__mro__",
        "sin.__globals__",
        "sum(l.real for l in (1, 2))",
        "sum(l for l in ().__class__.__subclasses__())",
        "__builtins__",
        "__debug__",
        "_Pow(10, 10**9)",
        "sum(_steps for l in (1, 2))",
        "sum(_ for l in (1, 2))",
        "sum(_ for _ in (1, 2))",
        "sum(sin for sin in (1, 2))",
        "sum(l for l, m in ((1, 2), (3, 4)))",
        "sum(l for x[0] in (1, 2))",
        "sum(l for l in (1, 2) if x.size)",
        "sum(l async for l in (1, 2))",
        "sum((y := l) for l in (1, 2))",
        "sum(l for l in range(y := 3))",
        "sum({l for l in (1, 2)})",
        "sum({l: x for l in (1, 2)})",
        "sum(*[x, x])",
        "sum(l for l in (*x, 1))",
        "[l for l in (1, 2)]",
        "(l for l in (1, 2))",
        "(lambda: x)()",
        "sin(*x)",
        "sin(**x)",
        "(sin)(x)(x)",
        "sum(lambda: x for l in (1, 2))",
        "(yield x)",
        "await x",
        "f'{x}'",
        "x if x else x",
        "x @ x",
        "1 << 9",
        "x is x",
        "...",
        "None",
    ],
)
def test_nothing_else_of_python_comes_to_evaluation(text):
    with pytest.raises(ValueError, match=r"is refused because (?!it cannot be evaluated)"):
        Expression(text, ("x",), CONSTANTS)


def test_an_operand_between_two_comparisons_is_evaluated_once():
    nested = "x"
    for _ in range(40):
        nested = f"(0 <= {nested} <= 1)"
    np.testing.assert_array_equal(evaluate(nested), np.ones(9))


def test_a_copy_by_pickle_is_the_same_function():
    expression = Expression("x**2/L + pi", ("x",), CONSTANTS)
    copy = pickle.loads(pickle.dumps(expression))
    assert repr(copy) == repr(expression)
    np.testing.assert_array_equal(copy(x=X), expression(x=X))


@settings(deadline=None)
@given(st.text(alphabet="xLTpi01259.e+-*/%<>=!&|^~()[]{},:;'\"\\ \nsumforinrange", max_size=40))
def test_any_text_gives_real_numbers_or_one_sentence(text):
    try:
        value = evaluate(text)
    except ValueError as error:
        message = str(error)
    else:
        assert value.shape == X.shape
        return
    assert "is refused because" in message
    assert "\n" not in message


@pytest.mark.parametrize(
    "text",
    ["3", "t", "sin(2*t)**2 - t", "sum(l*cos(l*t) for l in range(1, 4))", "where(t < 1, 1, t)"],
)
def test_a_shifted_expression_gives_what_follows(text):
    expression, times = Expression(text, ("t",), {"T": 2.0}), np.linspace(0, 2, 9)
    np.testing.assert_array_equal(expression.shifted(0.5)(t=times), expression(t=times + 0.5))
