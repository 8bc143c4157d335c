"""Full runs of a survey's scene, and the modes that its queries share."""

import logging
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sphpod.full import lifted
from sphpod.pipeline.dataset import Variable
from sphpod.scene.breakdown import Breakdown
from sphpod.surveys import samples
from sphpod.surveys.corrections import correction_modes
from sphpod.surveys.folds import check_folds
from sphpod.surveys.modes import shared_modes
from sphpod.surveys.parts import Operators
from sphpod.surveys.query import Survey

logger = logging.getLogger(__name__)

MOST_MODES = 80
"""Velocity modes that are kept, of which those of the queries are the first."""

RICHER = 2
"""How many times the modes of the queries serve the estimate of their errors."""

CANDIDATES = 64
"""Points of which greedy training takes the next run."""

RUN_VARIABLES = {
    "parameter": Variable(("parameter_index",), "", "parameter", str),
    "point": Variable(("parameter_index",), "", "values of the parameters, in SI units"),
    "strain": Variable(("t", "x"), "1", "strain of the particles"),
}

MODEL_VARIABLES = {
    "velocity_modes": Variable(
        ("velocity_mode", "x"), "1", "modes of velocity and displacement, orthonormal by volume"
    ),
    "correction_modes": Variable(
        ("correction_mode", "x"), "", "modes by which those of the queries are corrected in bounds"
    ),
    "mode_count": Variable((), "1", "velocity modes of the queries", np.int32),
    "training_points": Variable(
        ("run", "parameter_index"), "", "values of the parameters of the training runs, in SI units"
    ),
}


def training_points(survey: Mapping[str, Any], ranges: samples.Ranges) -> np.ndarray:
    """Values of the parameters of the training runs, (runs, parameters)."""
    return samples.points(ranges, survey["training"])


def run_at(name: str, settings: Mapping[str, Any], point: np.ndarray) -> dict[str, np.ndarray]:
    """As `run`, at a point (parameters,) of one's own."""
    values = _values(settings, point)
    try:
        found = lifted.solve(samples.scene_at(name, settings, values), "exact")
    except Breakdown as error:
        where = ", ".join(f"{word} = {value:g}" for word, value in values.items())
        raise ValueError(
            f"{error}, at {where}; narrow the ranges of the parameters until no training run does"
        ) from None
    return found | {"point": point} | _named(settings)


def run(
    name: str, settings: Mapping[str, Any], survey: Mapping[str, Any], number: int
) -> dict[str, np.ndarray]:
    """One training run: the lifted full model, exact in time, at one point of the parameters.

    Returns
    -------
    dict
        t, x, velocity and strain (times, N), and parameter and point (parameters,).
    """
    return run_at(name, settings, training_points(survey, settings["parameters"])[number])


def _named(settings):
    """Parameters in the order of all arrays that have an axis of them."""
    return {"parameter": np.array(list(settings["parameters"]), object)}


def _values(settings, point):
    return dict(zip(settings["parameters"], map(float, point), strict=True))


def train(
    name: str,
    settings: Mapping[str, Any],
    survey: Mapping[str, Any],
    runs: Sequence[Mapping[str, np.ndarray]],
) -> dict[str, np.ndarray]:
    """The modes of all training runs together, and how many of them queries have.

    Returns
    -------
    dict
        velocity_modes (modes, N), correction_modes (m, N), translation, mode_count, parameter,
        training_points.
    """
    scenes = [samples.scene_at(name, settings, _values(settings, run["point"])) for run in runs]
    shared = shared_modes(zip(scenes, runs, strict=True))
    most = len(shared["velocity_modes"])
    points = np.array([run["point"] for run in runs])
    each = [_values(settings, point) for point in points]
    operators = Operators(name, settings, _first(shared, MOST_MODES))

    def surveyed(count, **corrections):
        """Queries of the first modes, which are all where these are corrected by shared ones."""
        kept = count if operators.is_affine else MOST_MODES
        of_first = Operators(name, settings, _first(shared, kept) | corrections)
        return Survey(of_first, count, survey["tolerance"])

    if "mode_count" in survey:
        count = min(int(survey["mode_count"]), most)
        if count < survey["mode_count"]:
            logger.warning(
                "%d modes asked for, the training runs hold %d", survey["mode_count"], most
            )
    else:
        ends = operators.rigid, len(operators.velocity_modes)
        count = _fewest(surveyed, *ends, each)
    corrections = np.zeros((0, operators.volumes.size))
    if operators.is_affine:
        corrections = correction_modes(surveyed, count, each)
    kept = min(most, RICHER * count, max(MOST_MODES, count))
    return {
        **_first(shared, kept),
        **_named(settings),
        "correction_modes": corrections,
        "mode_count": np.array(count),
        "training_points": points,
    }


def train_greedily(
    name: str, settings: Mapping[str, Any], survey: Mapping[str, Any]
) -> dict[str, np.ndarray]:
    """The same of runs that follow from one another: each where the bound is largest so far.

    The first is at the nominal values. It ends when the bound is within the tolerance at all
    candidates, a Sobol set of the ranges, or after ``training.count`` runs.
    """
    ranges, keys = settings["parameters"], survey["training"]
    drawn = {"count": CANDIDATES, "seed": keys["seed"]}
    candidates = samples.points(ranges, drawn)
    runs, point = [], np.array([float(given["nominal"]) for given in ranges.values()])
    while True:
        runs.append(run_at(name, settings, point))
        found = train(name, settings, survey, runs)
        if len(runs) == keys["count"] or not len(candidates):
            return found
        operators = Operators(name, settings, found)
        reduced = Survey(operators, int(found["mode_count"]), survey["tolerance"])
        bounds = np.array([_bound_at(reduced, _values(settings, each)) for each in candidates])
        worst = int(bounds.argmax())
        logger.info("%d training runs: bounds up to %.3g", len(runs), bounds[worst])
        if bounds[worst] <= survey["tolerance"]:
            return found
        point, candidates = candidates[worst], np.delete(candidates, worst, axis=0)


def _bound_at(reduced, values):
    """Bound of a query, below all others where it fails: no training run is made there."""
    try:
        answer = reduced.answer(values)
        check_folds(reduced.operators, answer, values)
    except ValueError as error:
        logger.warning("no training run at %s: %s", values, error)
        return -np.inf
    return answer.relative_bound


def _first(shared, count):
    return {**shared, "velocity_modes": shared["velocity_modes"][:count]}


def _fewest(surveyed, low, high, points):
    """Modes from which bounds are within the tolerance at all training runs, by bisection."""

    def suffices(count):
        survey = surveyed(count)
        return all(survey.answer(point).relative_bound <= survey.tolerance for point in points)

    if not suffices(high):
        logger.warning("%d modes do not meet the tolerance at the training runs", high)
        return high
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if suffices(middle) else (middle, high)
    return high
