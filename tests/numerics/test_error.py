"""Relative errors, of fields and of reduced coordinates."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sphpod.numerics import error


def test_definition_over_more_rows_than_a_block():
    rng = np.random.default_rng(0)
    a, b = rng.standard_normal((2, 1300, 7))
    expected = np.sqrt(((a - b) ** 2).sum() / (b**2).sum())
    assert error.relative_error(a, b) == pytest.approx(expected, rel=1e-14)


@given(st.integers(1, 6), st.integers(1, 6), st.integers(0, 2**32 - 1), st.integers(0, 12))
def test_reduced_coordinates_have_the_error_of_their_field(k, more, seed, digits):
    """However small the error is: nothing cancels."""
    rng = np.random.default_rng(seed)
    modes = np.linalg.qr(rng.standard_normal((20, k + more)))[0].T
    coordinates = rng.standard_normal((600, k))
    size = 10.0**-digits
    field = coordinates @ modes[:k] + size * rng.standard_normal((600, 20))
    reduced = coordinates + size * rng.standard_normal((600, k))
    direct = error.relative_error(reduced @ modes[:k], field)
    projected = error.project(field, modes).relative_error(reduced)
    assert projected == pytest.approx(direct, rel=1e-3 if digits > 10 else 1e-6)


@given(st.floats(1e-140, 1e140), st.integers(0, 2))
def test_errors_of_a_field_of_zero_are_zero_or_undefined(size, place):
    """Never infinite, which is what the error of a breakdown is; whatever the field is small to."""
    zero, wrong = np.zeros((3, 4)), np.zeros((3, 4))
    modes = np.eye(4)[:2]
    wrong[place, 1] = size
    for found, expected in (
        (error.relative_error(zero, zero), 0),
        (error.project(zero, modes).relative_error(zero[:, :2]), 0),
        (error.relative_error(zero, wrong), 1),
        (error.project(wrong, modes).relative_error(zero[:, :2]), 1),
        (error.relative_error(wrong, zero), np.nan),
        (error.project(zero, modes).relative_error(wrong[:, :2]), np.nan),
    ):
        np.testing.assert_equal(found, expected)


def test_what_is_not_finite_has_an_infinite_error():
    projection = error.project(np.ones((3, 4)), np.eye(4)[:2])
    for value in (np.nan, np.inf, 1e300):
        assert projection.relative_error(np.full((3, 1), value)) == np.inf
