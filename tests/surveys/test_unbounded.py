"""Queries without bounds: the answers of those with bounds, whatever is asked beside them."""

from typing import Any

import numpy as np
import pytest
from survey_cases import settings

from sphpod.config.config import load
from sphpod.numerics import oscillators
from sphpod.surveys import answers, training, unbounded
from sphpod.surveys.loaded import LoadedSurvey
from sphpod.surveys.query import Survey

QUANTITIES = {
    "history": {"kind": "history", "place": 0.3, "field": "velocity"},
    "stress": {"kind": "history", "place": 0.3, "field": "stress", "width": 0.2},
    "early": {"kind": "value", "place": 0.6, "field": "strain", "time": 0.5},
    "peak": {"kind": "maximum", "places": [0.2, 0.7], "field": "strain"},
    "energy": {"kind": "energy", "time": 0.8},
    "loss": {"kind": "energy_loss"},
    "passage": {"kind": "passage", "place": 0.3, "field": "velocity", "level": 7e-4},
    "never": {"kind": "passage", "place": 0.3, "field": "velocity", "level": 1.0},
}
EVERYWHERE = {"anywhere": {"kind": "maximum", "field": "strain", "places": "all"}}
CASES: dict[str, dict[str, Any]] = {
    "graded": {},
    "undamped": {"damping": None},
    "creeping": {"damping": "100*decay"},
    "translating": {"initial_velocity": "1e-3*(1 + contrast*sin(2*pi*x/L) + cos(4*pi*x/L))"},
    "dense": {"initial_density": "(1 + contrast)*(2 + sin(2*pi*x/L))"},
    "inclusion": {"youngs_modulus": "stiffness*(1 - 0.5*exp(-((x - L/2 - contrast/4)/0.1)**2))"},
}
ONE_BY_ONE: dict[str, dict[str, Any]] = {
    "damped_here_and_there": {"damping": "decay*(1 + 0.5*sin(2*pi*x/L))"},
    "forced": {"force": {"time": "1e-3*cos(20*t)", "profile": "1 + x"}},
    "density": {"initial_density": "1 + contrast*x*(L - x)"},
    "counted": {
        "youngs_modulus": "sum(stiffness + 0*x for l in range(0, nth((1.0, 2.0), 3*contrast)))"
    },
}


def made(of_scene=None, quantities=QUANTITIES):
    """A survey and its questions, and points of its queries."""
    changes = {key: value for key, value in (of_scene or {}).items() if value is not None}
    given = settings(changes, quantities=quantities)
    for key, value in (of_scene or {}).items():
        if value is None:
            del given["scenes"]["bar"][key], given["scenes"]["bar"]["parameters"]["decay"]
    resolved = load([], given)
    physics, keys = resolved["scenes"]["bar"], resolved["surveys"]["graded"]
    runs = [training.run("bar", physics, keys, n) for n in range(4)]
    model = training.train("bar", physics, keys, runs)
    points = answers.chunk_points({**keys, "chunk_size": 12}, physics["parameters"], 0)
    return physics, keys, model, points


@pytest.fixture(scope="module")
def graded():
    physics, keys, model, points = made()
    return *answers.of_settings("bar", physics, keys, model), points


def assert_same(found, bounded, quantities) -> None:
    assert list(found["reason"]) == list(bounded["reason"])
    for name in quantities:
        of_size = "energy" if name == "loss" else name  # without damping rounding alone is lost
        values = np.asarray(bounded[of_size])
        size = np.abs(values[np.isfinite(values)]).max(initial=0)
        np.testing.assert_allclose(found[name], bounded[name], rtol=1e-10, atol=1e-10 * size)


@pytest.mark.slow
@pytest.mark.parametrize("case", sorted(CASES))
def test_oscillators_answer_as_queries_with_bounds_do(case, monkeypatch) -> None:
    physics, keys, model, points = made(CASES[case])
    survey, asked = answers.of_settings("bar", physics, keys, model)
    bounded = answers.answer_all(survey, asked, points, 1e-2)
    monkeypatch.setattr(Survey, "solve", None)
    found = unbounded.answer_all(survey, asked, points)
    assert not any(found["reason"])
    assert_same(found, bounded, QUANTITIES)


@pytest.mark.slow
@pytest.mark.parametrize("case", sorted(ONE_BY_ONE))
def test_so_do_those_that_are_no_oscillators(case) -> None:
    physics, keys, model, points = made(ONE_BY_ONE[case])
    survey, asked = answers.of_settings("bar", physics, keys, model)
    assert not survey.operators.oscillates
    assert_same(
        unbounded.answer_all(survey, asked, points),
        answers.answer_all(survey, asked, points, 1e-2),
        QUANTITIES,
    )


def test_so_do_more_sensors_than_modes() -> None:
    physics, keys, model, points = made(quantities=EVERYWHERE)
    survey, asked = answers.of_settings("bar", physics, keys, model)
    assert_same(
        unbounded.answer_all(survey, asked, points),
        answers.answer_all(survey, asked, points, 1e-2),
        EVERYWHERE,
    )


def test_answers_do_not_depend_on_the_others_nor_on_their_number(graded, monkeypatch) -> None:
    survey, asked, points = graded
    whole = unbounded.answer_all(survey, asked, points)
    for order in ([3], [11, 0], [5, 3, 2, 2], list(range(12))[::-1]):
        for numbers in (1, 2**18):
            monkeypatch.setattr(unbounded, "NUMBERS", numbers)
            part = unbounded.answer_all(survey, asked, points[order])
            for name in QUANTITIES:
                assert part[name].tobytes() == whole[name][order].tobytes(), name
    assert len(oscillators.solve_each.signatures) == 1


def test_a_query_that_fails_is_a_row_with_its_reason(graded) -> None:
    survey, asked, points = graded
    wrong = points[:4].copy()
    wrong[1, 1] = 1.5  # contrast, with which the modulus is negative somewhere
    wrong[2, 2] = -1.0  # decay
    wrong[3, 0] = np.nan
    found = unbounded.answer_all(survey, asked, wrong)
    assert_same(found, answers.answer_all(survey, asked, wrong, 1e-2), QUANTITIES)
    assert [bool(reason) for reason in found["reason"]] == [False, True, True, True]
    assert np.isnan(found["energy"][1:]).all()


def test_a_line_that_may_fold_is_looked_at() -> None:
    physics, keys, model, points = made()
    fast = {**physics, "initial_velocity": "0.3*sin(2*pi*x/L)"}
    survey, asked = answers.of_settings("bar", fast, keys, model)
    points[:, 0] = np.geomspace(1e-2, 10, len(points))
    found = unbounded.answer_all(survey, asked, points)
    folds = np.array([reason.startswith("the line may fold") for reason in found["reason"]])
    assert folds[0]
    assert not folds[-1]
    for n, point in enumerate(points):
        values = dict(zip(physics["parameters"], point, strict=True))
        least = survey.solve(values).fields(survey.operators)[1].min()
        assert folds[n] == (least <= -1)


def test_a_loaded_survey_answers_without_bounds_on_request() -> None:
    physics, keys, model, _ = made()
    survey = LoadedSurvey({"scene": "bar", "physics": physics, "survey": keys}, model)
    stiffness = np.linspace(0.05, 0.2, 5)
    found, bounded = survey(bounds=False, stiffness=stiffness), survey(stiffness=stiffness)
    assert set(found.data_vars) == {*QUANTITIES, "reason"}
    assert_same(found, bounded, QUANTITIES)
    assert found["history"].attrs == bounded["history"].attrs
    assert survey(bounds=False, decay=0.2)["energy"].dims == ()
    with pytest.raises(ValueError, match="outside its range"):
        survey(bounds=False, stiffness=3)
