"""Responses of quantities along one parameter, and over two, the others being nominal."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from sphpod.numerics.error import Arrays
from sphpod.pipeline.dataset import meanings
from sphpod.surveys import samples, unbounded
from sphpod.surveys.answers import answer_all, of_settings

ALONG = 41
"""Values of a parameter along which quantities are given."""

ACROSS = 15
"""Values of each of two parameters over which they are."""

VARIABLES = meanings(
    "surface (quantity_index) [1] int32: block of queries that the surface of a quantity is"
)


def sections(
    name: str, settings: Mapping[str, Any], survey: Mapping[str, Any], model: Arrays
) -> dict[str, np.ndarray]:
    """Quantities of a survey along each of its parameters.

    They are those that are numbers, from end to end of a range.

    Returns
    -------
    dict
        As from `answers.answer_all`, of ``ALONG`` queries for each parameter in turn.
    """
    ranges = settings["parameters"]
    points = [_points(ranges, {word: ALONG}) for word in ranges]
    reduced, asked = _asked(name, settings, survey, model)
    return answer_all(reduced, asked, np.concatenate(points), survey["tolerance"])


def surfaces(
    name: str,
    settings: Mapping[str, Any],
    survey: Mapping[str, Any],
    model: Arrays,
    sections: Arrays,
) -> dict[str, np.ndarray]:
    """Quantities of a survey over two of its parameters.

    They are those along which a quantity changes most.

    Returns
    -------
    dict
        As from `unbounded.answer_all`, of blocks of ``ACROSS``² queries; quantity, and surface, the
        block of each, (quantities,).
    """
    ranges, words = settings["parameters"], list(settings["parameters"])
    scalars = [word for word in survey["quantities"] if word in sections]
    pairs = [_strongest(sections[word].reshape(len(ranges), ALONG)) for word in scalars]
    blocks = list(dict.fromkeys(pairs))
    points = [_points(ranges, {words[n]: ACROSS for n in pair}) for pair in blocks]
    reduced, asked = _asked(name, settings, survey, model)
    return unbounded.answer_all(reduced, asked, np.concatenate(points)) | {
        "quantity": np.array(scalars, object),
        "surface": np.array([blocks.index(pair) for pair in pairs], np.int32),
    }


def _points(ranges, counts):
    """A grid from end to end of some ranges, in even steps however likely these are."""
    even = {
        word: {key: value for key, value in given.items() if key != "distribution"}
        for word, given in ranges.items()
    }
    return samples.points(even, {"grid": counts})


def _asked(name, settings, survey, model):
    """The survey, and its questions whose answers are numbers."""
    reduced, asked = of_settings(name, settings, survey, model)
    return reduced, {word: question for word, question in asked.items() if not question.is_curve}


def _strongest(sections):
    """Numbers of the two parameters along which the values (parameters, ALONG) differ most."""
    known = np.isfinite(sections)
    high = np.where(known, sections, -np.inf).max(axis=1)
    low = np.where(known, sections, np.inf).min(axis=1)
    first, second = np.argsort(-np.where(high > low, high - low, 0), kind="stable")[:2]
    return min(first, second), max(first, second)
