"""Lifted models beside the paper's, in tables."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sphpod.studies import comparison

PLACE = {"scene": "waves", "sampling": "uniform10"}
ERRORS = {
    # Of the second reference, and of a reference, nothing may be taken.
    "velocity_error": np.array([[0.1, 9.0], [7.0, 8.0]]),
    "density_error": np.array([[0.01, 9.0], [7.0, 8.0]]),
}


def sweep(velocity, density, first=1):
    return {
        "mode_count": np.arange(first, first + len(velocity)),
        "velocity_error_sph": np.array(velocity),
        "density_error_sph": np.array(density),
    }


def certified(differences, bounds):
    bounds = np.array(bounds)
    return {
        "mode_count": 2 * np.arange(1, bounds.size + 1),
        "modes_resolved": (np.arange(bounds.size) < 2).astype(np.int8),
        "difference_from_best": np.array(differences),
        "energy_error_bound": bounds,
        "energy_error_lifted": bounds / 4,
        "residual_bound": 2 * bounds,
        "bound_slack": bounds / 10,
    }


def test_the_worse_field_counts():
    found = comparison.ratios(sweep([0.2, 0.05, np.inf], [0.001, 0.02, 0.001]), ERRORS)
    np.testing.assert_allclose(found, [2, 2, np.inf])


@pytest.mark.parametrize(
    ("velocity", "threshold", "works_from"),
    [
        ([0.2, 0.09, 0.05], 2, 2),
        ([0.05, 0.2, 0.05], 1, 3),
        ([0.05, 0.05, 0.2], 1, None),
        ([0.05, np.inf, 0.05, 0.05], 1, 3),
        ([0.05, 0.05], 1, 1),
        ([0.1, 0.2], None, None),
    ],
)
def test_thresholds(velocity, threshold, works_from):
    table = sweep(velocity, [1e-3] * len(velocity))
    assert comparison.threshold(table, ERRORS) == threshold
    assert comparison.works_from(table, ERRORS) == works_from


def test_mode_counts_need_not_begin_at_one():
    table = sweep([0.2, 0.05], [1e-3, 1e-3], first=5)
    assert (comparison.threshold(table, ERRORS), comparison.works_from(table, ERRORS)) == (6, 6)


@settings(deadline=None)
@given(st.lists(st.tuples(st.floats(0, 0.3), st.floats(0, 0.03)), min_size=1, max_size=8))
def test_from_where_a_model_works_it_goes_on_to(pairs):
    table = sweep(*zip(*pairs, strict=True))
    threshold, works_from = (
        f(table, ERRORS) for f in (comparison.threshold, comparison.works_from)
    )
    works = [v < 0.1 and rho < 0.01 for v, rho in pairs]
    assert threshold == (works.index(True) + 1 if any(works) else None)
    if works_from is None:
        assert not works[-1]
    else:
        assert threshold is not None
        assert threshold <= works_from
        assert all(works[works_from - 1 :])
        assert works_from == 1 or not works[works_from - 2]


@pytest.mark.parametrize(
    ("resolved", "told"),
    [
        ([1, 1, 1, 1, 1], ""),
        ([1, 1, 1, 0, 0], "7-8"),
        ([1, 0, 1, 0, 0], "5, 7-8"),
        ([0, 0, 1, 1, 0], "4-5, 8"),
    ],
)
def test_mode_counts_near_rounding_are_reported(resolved, told):
    flags = np.array(resolved, np.int8)
    table: dict[str, np.ndarray] = {"mode_count": np.arange(4, 9), "modes_resolved": flags}
    assert comparison.near_rounding(table) == told


def test_effectivity_is_bound_over_error():
    rows = list(comparison.effectivity(PLACE, certified([0.1, 0], [0.4, 0.02])))
    assert rows[1] == PLACE | {
        "modes": 4,
        "modes_resolved": True,
        "energy_error_lifted": 0.005,
        "energy_error_bound": 0.02,
        "effectivity": pytest.approx(4),
        "residual_bound": 0.04,
        "residual_effectivity": pytest.approx(8),
        "bound_slack": pytest.approx(0.002),
    }
    assert [row["modes"] for row in rows] == [2, 4]


def test_certificates_are_those_of_the_smallest_model_that_meets_a_tolerance():
    table = certified([np.inf, 0.05, 0.004, 0], [np.inf, 0.3, 0.008, 0.009])
    rows = list(comparison.certificates(PLACE, table, [1e-1, 1e-2, 1e-3]))
    assert [(row["tolerance"], row["modes"], row["verdict"]) for row in rows] == [
        (1e-1, 4, "not certified"),
        (1e-2, 6, "certified"),
        (1e-3, 8, "not certified"),
        (0.008, 6, "smallest tolerance certified"),
    ]
    assert rows[1] == PLACE | {
        "tolerance": 1e-2,
        "modes": 6,
        "modes_resolved": False,
        "difference_from_best": 0.004,
        "energy_error_bound": 0.008,
        "verdict": "certified",
    }


def test_a_tolerance_that_no_model_meets_is_reported():
    rows = list(comparison.certificates(PLACE, certified([0.5, 0.05], [0.6, 0.06])))
    assert len(rows) == len(comparison.TOLERANCES) + 1
    assert rows[0]["verdict"] == "certified"
    assert rows[1] == PLACE | {"tolerance": 1e-2, "verdict": "not met by k = 4"}
