"""Some queries of a survey solved in full: the true error beside its estimate and its bound."""

import logging
from collections.abc import Mapping
from typing import Any

import numpy as np

from sphpod.full import lifted
from sphpod.numerics.error import Arrays
from sphpod.pipeline.dataset import meanings
from sphpod.scene.breakdown import Breakdown
from sphpod.scene.scene import Scene
from sphpod.surveys import samples
from sphpod.surveys.answers import of_settings
from sphpod.surveys.folds import check_folds
from sphpod.surveys.parts import Values

logger = logging.getLogger(__name__)

SEED = 20
"""Of the draw of queries."""

VARIABLES = meanings(
    """
    true_error (query) [1]: largest energy norm of the error over time, of the largest norm
    effectivity (query) [1]: bound by true error
    inside (query) [1] int8: 1 where all quantities of the full run lie in their intervals
    """
)


def validate(
    name: str, settings: Mapping[str, Any], survey: Mapping[str, Any], model: Arrays
) -> dict[str, np.ndarray]:
    """Random queries of a survey, solved in full too.

    The true error is that of the difference to the lifted full model at the same parameters, exact
    in time, over the largest energy norm of that; errors of the discretisation are not in it.

    Returns
    -------
    dict
        Parameters, true_error, relative_estimate, relative_bound, effectivity, inside and reason,
        all (queries,). A query that fails, or whose full run folds, has NaN, and its reason.
    """
    reduced, asked = of_settings(name, settings, survey, model)
    ranges = settings["parameters"]
    drawn = {"count": survey["validation"], "sampling": "uniform", "seed": SEED}
    points = samples.points(ranges, drawn)
    rows, reasons = [], []
    for point in points:
        try:
            rows.append(_row(name, settings, reduced, asked, point))
            reasons.append("")
        except (ValueError, Breakdown) as error:
            logger.warning("random query %s: %s", point, error)
            rows.append((np.nan, np.nan, np.nan, 0))
            reasons.append(str(error))
    errors, estimate, bound, inside = np.array(rows, float).reshape(-1, 4).T
    with np.errstate(divide="ignore", invalid="ignore"):
        effectivity = bound / errors
    return {
        **{parameter: points[:, n] for n, parameter in enumerate(ranges)},
        "true_error": errors,
        "relative_estimate": estimate,
        "relative_bound": bound,
        "effectivity": effectivity,
        "inside": inside.astype(np.int8),
        "reason": np.array(reasons, object),
    }


def _row(name, settings, reduced, asked, point):
    """True error, estimate, bound, and whether all intervals hold, of one query."""
    values = dict(zip(settings["parameters"], map(float, point), strict=True))
    answer = reduced.answer(values)
    check_folds(reduced.operators, answer, values)
    scene, full, norms = in_full(name, settings, values)
    true = relative_error(scene, full, *answer.fields(reduced.operators))
    held = all(
        _holds(question, question.answer(answer, values), scene, full, norms)
        for question in asked.values()
    )
    return true, answer.estimate, answer.relative_bound, held


def in_full(
    name: str, settings: Mapping[str, Any], values: Values
) -> tuple[Scene, dict[str, np.ndarray], np.ndarray]:
    """Scene, fields (times, N) and energy norms (times,) of the lifted full model, exact in time.

    Raises
    ------
    Breakdown
    """
    scene = samples.scene_at(name, settings, values)
    full = lifted.solve(scene, "exact")
    return scene, full, _norms(scene, full["velocity"], full["strain"])


def relative_error(scene: Scene, full: Arrays, velocity: np.ndarray, strain: np.ndarray) -> float:
    """Largest energy norm over time of the difference to a full run, of the run's largest norm."""
    largest = _norms(scene, full["velocity"], full["strain"]).max()
    wrong = _norms(scene, full["velocity"] - velocity, full["strain"] - strain)
    return float(wrong.max() / largest) if largest else 0.0


def _norms(scene, velocity, strain):
    mass, stiffness = lifted.energy_weights(scene)
    return np.sqrt(np.sum((mass * velocity) ** 2 + (stiffness * strain) ** 2, axis=1))


def _holds(question, interval, scene, full, norms):
    """Whether the quantity of a full run lies in its interval but for rounding."""
    true = question.of_fields(scene, full, norms**2 / 2)
    _, low, high = interval
    if question.asked["kind"] == "passage":
        # What may never be reached may come at any time.
        late = np.inf if np.isnan(high) else high
        reached = np.inf if np.isnan(true) else true
        early = np.inf if np.isnan(low) else low
        return bool(early <= reached <= late)
    slack = 1e-10 * np.max(np.abs(true))
    return bool(np.all(low - slack <= true) and np.all(true <= high + slack))
