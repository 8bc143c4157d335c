"""Functions of x and t are the sums of products that are made of them."""

import numpy as np
import pytest

from sphpod.numerics import separation
from sphpod.numerics.course import Course
from sphpod.numerics.expressions import Expression
from sphpod.numerics.separation import Everywhere, Interpolated, Products, product_count, separate

CONSTANTS = {"L": 2.0, "T": 5.0}
PLACES = np.arange(60) / 30
OTHERS = np.random.default_rng(0).uniform(0, 2, 40)
TIMES = np.random.default_rng(1).uniform(0, 5, 200)

# What is made of a function: its kind, its products, and the largest error, of the largest value.
FUNCTIONS = {
    "2*t": (Products, 1, 1e-15),
    "sin(x)": (Products, 1, 1e-15),
    "t*x": (Products, 1, 1e-15),
    "sin(2*pi*(x - t)/L)": (Products, 2, 1e-14),
    "-cos(3*t - 2*pi*x + 1) + x": (Products, 3, 1e-14),
    "exp(x - 2*t)/(1 + x)": (Products, 1, 1e-14),
    "(1 + 0.1*sin(3*t))*(2 + x) - t": (Products, 2, 1e-14),
    "exp(-((t - 2)/1e-4)**2)*sin(pi*x)": (Products, 1, 1e-14),
    "sum(sin(l*pi*(x - t)) for l in range(1, 5))": (Interpolated, 8, 1e-11),
    "exp(-((x - 0.4*t)/0.3)**2)": (Interpolated, None, 1e-11),
    "exp(900*x - 900*t - 1800)": (Interpolated, 1, 1e-11),
    "1/(1 + t*x)": (Interpolated, None, 1e-11),
}


def made(text):
    expression = Expression(text, ("x", "t"), CONSTANTS)
    return expression, separate(expression, 5.0, PLACES)


def values(found, x, times):
    return found.profiles(x).T @ np.array([factor(t=times) for factor in found.factors])


@pytest.mark.parametrize(("text", "known"), FUNCTIONS.items(), ids=FUNCTIONS)
def test_products_add_up_to_the_function_at_any_place_and_time(text, known):
    kind, count, allowed = known
    expression, found = made(text)
    assert isinstance(found, kind)
    assert count is None or len(found.factors) == count
    for x in (PLACES, OTHERS):
        expected = expression(x=x[:, None], t=TIMES)
        error = np.abs(values(found, x, TIMES) - expected).max()
        assert error <= allowed * np.abs(expected).max()


@pytest.mark.parametrize(
    "text", [*FUNCTIONS, "where(cos(pi*x - 3*t) > 0, 1, 0.5)", "where(x > t, 1, 0)"]
)
def test_the_number_of_products_is_known_about_before(text) -> None:
    expression, found = made(text)
    count = product_count(expression, 5.0, PLACES)
    if isinstance(found, Products):
        assert count == len(found.factors)
    else:
        assert 0.5 <= count / len(found.factors) <= 2


def test_a_pulse_that_is_seen_at_few_places_is_not_missed():
    """It crosses each place within a thousandth of T, at a time of its own."""
    _expression, found = made("exp(-((x - 0.4*t)/2e-3)**2)")
    at = PLACES[7] / 0.4
    assert values(found, PLACES, np.array([at]))[7] == pytest.approx(1)
    assert values(found, PLACES, np.array([at + 0.05]))[7] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("text", ["where(abs(x - 0.4*t) < 0.1, 1, 0)", "abs(x - 0.4*t)"])
def test_what_breaks_at_places_that_travel_is_followed_at_every_particle(text):
    expression, found = made(text)
    assert isinstance(found, Everywhere)
    np.testing.assert_array_equal(
        values(found, PLACES, TIMES), expression(x=PLACES[:, None], t=TIMES)
    )
    between = PLACES + 1 / 60
    halves = (values(found, PLACES, TIMES) + np.roll(values(found, PLACES, TIMES), -1, axis=0)) / 2
    np.testing.assert_allclose(values(found, between, TIMES), halves, atol=1e-12)


def test_what_is_nothing_before_the_end_is_nothing():
    _, found = made("where(t < 6, 0, where(x < 1, 2, 0))")
    assert not values(found, PLACES, TIMES).any()


def test_too_many_places_for_that_are_refused():
    many = np.arange(5000) / 2500
    with pytest.raises(ValueError, match=r"^it is no sum of few products .* 4096 at most$"):
        separate(Expression("where(x < 0.4*t, 1, 0)", ("x", "t"), CONSTANTS), 5.0, many)


def test_instants_leave_no_gap_where_there_are_many_pieces(monkeypatch) -> None:
    monkeypatch.setattr(separation, "MOST_PIECES", 2)
    steps = " + ".join(f"where(t > {n / 7}, 1, 0)" for n in range(1, 7))
    course = Course.of(Expression(steps, ("t",), {}), 1.0)
    assert course.edges.size > 5
    assert np.diff(separation.instants([course])).max() < 0.05
