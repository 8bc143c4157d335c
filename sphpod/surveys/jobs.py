"""What each rule of a survey computes: arrays by name, of its settings and of what it reads.

Functions are given the name and settings of the scene and the settings of the survey, and what they
read as arrays, by the names of the rule's inputs.
"""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from sphpod.numerics.error import Arrays
from sphpod.pipeline.dataset import Variable
from sphpod.surveys import cost, design, responses, samples, sensitivity, training, validation
from sphpod.surveys.answers import (
    OF_QUERY,
    answer_all,
    chunk_points,
    joined,
    of_settings,
    variables,
)
from sphpod.surveys.parts import Operators
from sphpod.surveys.questions import questions

Settings = Mapping[str, Any]


def training_run(name: str, settings: Settings, survey: Settings, number: int) -> dict:
    """Training run of a survey."""
    return training.run(name, settings, survey, number)


def model(name: str, settings: Settings, survey: Settings, runs: Iterable[Arrays] = ()) -> dict:
    """Modes that the queries of a survey share."""
    if survey["training"]["method"] == "greedy":
        return training.train_greedily(name, settings, survey)
    return training.train(name, settings, survey, list(runs))


def queries(name: str, settings: Settings, survey: Settings, model: Arrays, chunk: int) -> dict:
    """Queries of a survey, a chunk of them."""
    reduced, asked = of_settings(name, settings, survey, model)
    points = chunk_points(survey, settings["parameters"], chunk)
    return answer_all(reduced, asked, points, survey["tolerance"])


def answers(name: str, settings: Settings, survey: Settings, chunks: Iterable[Arrays]) -> dict:
    """All queries of a survey."""
    del name
    return joined(survey, settings["parameters"], chunks)


validated = validation.validate
designed = design.design
shared_out = sensitivity.share_out
timed = cost.measure
sections, surfaces = responses.sections, responses.surfaces


def meanings(name: str, settings: Settings, survey: Settings) -> dict[str, Variable]:
    """What the names mean of the arrays of all these."""
    none = np.zeros((1, settings["particle_count"]))
    of_scene = Operators(name, settings, {"velocity_modes": none, "translation": 0})
    asked = questions(of_scene, survey.get("quantities", {}))
    return {
        **training.RUN_VARIABLES,
        **training.MODEL_VARIABLES,
        **validation.VARIABLES,
        **sensitivity.VARIABLES,
        **cost.VARIABLES,
        **responses.VARIABLES,
        **design.VARIABLES,
        **design.full_variables(asked),
        **OF_QUERY,
        **variables(asked, settings["parameters"]),
    }


def chunk_count(settings: Settings, survey: Settings) -> int:
    """Jobs that the queries of a survey are split into."""
    count = samples.count(settings["parameters"], survey["queries"])
    return -(-count // survey["chunk_size"])
