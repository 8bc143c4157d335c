"""Correction modes that queries share: as sharp as those of each query, of no particles."""

import numpy as np
import pytest
from survey_cases import SCENE
from test_query import CASES, made, point_of

from sphpod.surveys import samples
from sphpod.surveys.corrections import LOOSER, correction_modes
from sphpod.surveys.parts import Operators
from sphpod.surveys.query import Survey

AFFINE = sorted(set(CASES) - {"density", "inclusion"})


@pytest.fixture(scope="module")
def surveys():
    return {case: made(case) for case in AFFINE}


def bounds(survey, points):
    return np.array([survey.answer(point).relative_bound for point in points])


def points_of(resolved, count, **keys):
    drawn = samples.points(resolved["parameters"], {"count": count, **keys})
    return [point_of(resolved, one) for one in drawn]


def surveyed(survey, count, tolerance=0.0, **corrections):
    operators = survey.operators
    shared = {"velocity_modes": operators.velocity_modes, "translation": operators.rigid}
    own = Operators("bar", operators.settings, shared | corrections)
    return Survey(own, count, tolerance)


@pytest.mark.slow
@pytest.mark.parametrize("case", AFFINE)
def test_modes_of_all_particles_correct_as_the_particles_do(surveys, case) -> None:
    resolved, survey = surveys[case]
    particles = surveyed(survey, 8)
    whole = surveyed(survey, 8, correction_modes=np.eye(24))
    points = points_of(resolved, 3, sampling="uniform")
    # Only at the particles is an uneven damping known by row.
    most = 1.2 if case == "uneven_damping" else 1 + 1e-6
    plain = surveyed(survey, 8, correction_modes=np.zeros((0, 24)))
    ratios = bounds(whole, points) / np.minimum(bounds(particles, points), bounds(plain, points))
    assert np.all((ratios >= 1 - 1e-6) & (ratios <= most))


@pytest.mark.slow
@pytest.mark.parametrize("case", AFFINE)
def test_few_modes_do_at_the_training_runs_and_no_query_asks_for_particles(
    surveys, case, monkeypatch
) -> None:
    resolved, survey = surveys[case]
    points = points_of(resolved, 4)
    sharpest = bounds(surveyed(survey, 8), points)
    monkeypatch.delattr(Operators, "line")
    monkeypatch.setattr("sphpod.surveys.fields.ParametricField.at", None)
    survey.solve(points[0])
    assert np.all(bounds(survey, points) <= LOOSER * sharpest)
    plain = surveyed(survey, 8, correction_modes=np.zeros((0, 24)))
    assert np.all(bounds(survey, points) <= bounds(plain, points) * (1 + 1e-6))


def test_there_are_none_where_none_is_needed() -> None:
    changes = {**SCENE, "initial_velocity": "1e-3*sin(2*pi*x/L)"}
    resolved, survey = made(changes, count=12)
    points = points_of(resolved, 2)

    def of(tolerance):
        def survey_of(count, **corrections):
            return surveyed(survey, count, tolerance, **corrections)

        return len(correction_modes(survey_of, 12, points))

    assert of(10.0) == 0 < of(0.0)
