"""Many queries, one row each: whatever the others are, and in whatever order they come."""

import logging
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from sphpod.numerics.error import Arrays
from sphpod.pipeline.dataset import Variable, meanings
from sphpod.surveys import samples
from sphpod.surveys.folds import check_folds
from sphpod.surveys.parts import Operators
from sphpod.surveys.query import Survey
from sphpod.surveys.questions import Question, questions

logger = logging.getLogger(__name__)

REPORTED = 1000
"""Queries after which the log reports again."""

ENDS = {"": "", "_low": "least that the bound allows: ", "_high": "largest that the bound allows: "}
"""What is added to the name of a quantity and to its meaning, for value and interval."""

OF_QUERY = meanings(
    """
    relative_bound (query) [1]: bound of the largest energy norm of the error, of the largest norm
    relative_estimate (query) [1]: difference from the model of all modes, of the largest norm
    certified (query) [1] int8: 1 where the bound is within the tolerance
    reason (query): why there is no answer, empty where there is one
    """
)


def variables(asked: Mapping[str, Question], parameters: Mapping[str, Any]) -> dict[str, Variable]:
    """What the arrays of answers mean."""
    found = dict(OF_QUERY)
    for name in parameters:
        found[name] = Variable(("query",), "", f"parameter {name}, in SI units")
    for name, question in asked.items():
        dims, units, meaning, *_ = question.variable
        found |= {
            f"{name}{end}": Variable(dims, units, words + meaning) for end, words in ENDS.items()
        }
    return found


def answer_all(
    survey: Survey, asked: Mapping[str, Question], points: np.ndarray, tolerance: float
) -> dict[str, np.ndarray]:
    """Answers of queries, one a row.

    Parameters
    ----------
    asked : dict
    points : array, shape (queries, parameters)
    tolerance : float
        Largest relative bound of a query that is certified.

    Returns
    -------
    dict
        Parameters, quantities and what `variables` lists, (queries,) or (queries, times); t. A
        query that fails has NaN, and its reason.
    """
    parameters, count = survey.operators.parameters, len(points)
    times = survey.operators.nominal.error_times
    found: dict[str, np.ndarray] = {
        "t": times,
        **{name: points[:, n] for n, name in enumerate(parameters)},
        "relative_bound": np.full(count, np.nan),
        "relative_estimate": np.full(count, np.nan),
        "certified": np.zeros(count, np.int8),
        "reason": np.full(count, "", object),
    }
    for name, question in asked.items():
        shape = (count, times.size) if question.is_curve else (count,)
        found |= {f"{name}{end}": np.full(shape, np.nan) for end in ENDS}
    for n, point in enumerate(points):
        values = dict(zip(parameters, map(float, point), strict=True))
        try:
            answer = survey.answer(values)
            check_folds(survey.operators, answer, values)
        except ValueError as error:
            found["reason"][n] = str(error)
            logger.warning("query %d: %s", n, error)
            continue
        found["relative_bound"][n] = answer.relative_bound
        found["relative_estimate"][n] = answer.estimate
        found["certified"][n] = answer.relative_bound <= tolerance
        for name, question in asked.items():
            for end, value in zip(ENDS, question.answer(answer, values), strict=True):
                found[f"{name}{end}"][n] = value
        if (n + 1) % REPORTED == 0:
            logger.info("%d of %d queries", n + 1, count)
    return found


def of_settings(
    name: str, settings: Mapping[str, Any], survey: Mapping[str, Any], model: Mapping[str, Any]
) -> tuple[Survey, dict[str, Question]]:
    """A survey and its questions, of the settings of its scene and of a trained model."""
    operators = Operators(name, settings, model)
    if not operators.is_affine:
        logger.info(
            "scene %s: its parameters change the shape of a coefficient, which each query "
            "evaluates at all particles",
            name,
        )
    reduced = Survey(operators, int(model["mode_count"]), survey["tolerance"])
    return reduced, questions(operators, survey["quantities"])


def chunk_points(survey: Mapping[str, Any], ranges: samples.Ranges, chunk: int) -> np.ndarray:
    """Values of the parameters of the queries of a chunk, (queries, parameters)."""
    first = chunk * survey["chunk_size"]
    return samples.points(ranges, survey["queries"], first, first + survey["chunk_size"])


def joined(
    survey: Mapping[str, Any], ranges: samples.Ranges, chunks: Iterable[Arrays]
) -> dict[str, np.ndarray]:
    """All chunks together, of which one alone is held beside what is joined."""
    every: dict[str, np.ndarray] = {}
    first, count = 0, samples.count(ranges, survey["queries"])
    for chunk in chunks:
        last = first + len(chunk["reason"])
        for name, values in chunk.items():
            if name == "t":
                every[name] = values
                continue
            if name not in every:
                kind = object if values.dtype.kind == "U" else values.dtype
                every[name] = np.empty((count, *values.shape[1:]), kind)
            every[name][first:last] = values
        first = last
    return every
