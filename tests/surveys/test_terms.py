"""Expressions that fall apart into factors of parameters and of x."""

import numpy as np
import pytest

from sphpod.surveys.fields import ParametricField, at_particles
from sphpod.surveys.terms import separate

PLACES = np.arange(20) / 20


def field(text):
    return ParametricField(text, ("a", "b"), {"L": 1.0, "T": 1.0}, at_particles(PLACES))


@pytest.mark.parametrize(
    ("text", "terms"),
    [
        ("a", 1),
        ("a*sin(2*pi*x)", 1),
        ("a*(1 + b*sin(2*pi*x/L))", 2),
        ("(a + x)*(b - x)", 4),
        ("sum(a*sin(l*x) for l in range(1, 4))", 1),
        ("sum(a*l + x for l in (1, 2))", 2),
        ("where(x < L/2, a, b)", 2),
        ("x/(a*(1 + x))", 1),
        ("-(a*x)", 1),
        ("sum((a, b*x))", 2),
    ],
)
def test_the_terms_add_up_to_the_expression(text, terms) -> None:
    found = field(text)
    assert found.profiles is not None
    assert len(found.profiles) == terms
    for a, b in ((0.3, 1.7), (2.0, -0.4)):
        whole = found._whole(x=PLACES, a=a, b=b)
        np.testing.assert_allclose(found.at({"a": a, "b": b}), whole, rtol=1e-13)


@pytest.mark.parametrize(
    "text",
    ["exp(-a*x)", "where(x < a, 1, 2)", "1/(a + x)", "sum(sin(a*l*x) for l in (1, 2))", "x**a"],
)
def test_what_does_not_fall_apart_is_evaluated_as_it_stands(text) -> None:
    assert separate(text, ("a", "b")) is None
    assert field(text).at({"a": 0.5, "b": 1.0}).shape == PLACES.shape


def test_a_parameter_may_be_the_bound_of_a_range() -> None:
    found = field("sum(sin(l*x) for l in range(1, a))")
    expected = np.sin(PLACES) + np.sin(2 * PLACES)
    np.testing.assert_allclose(found.at({"a": 3.0, "b": 0.0}), expected, atol=1e-15)
