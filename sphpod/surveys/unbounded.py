"""Queries without bounds, many at once.

Where damping is even, nothing pushes and parameters only scale the density, a query is damped
oscillators (`sphpod.numerics.oscillators`) of a stiffness that is a sum of matrices made once, or
one that is made in the query where the modulus does not fall apart. Sensors are vectors in the
model's coordinates, whatever is asked of them, and the energy comes beside. Other queries, and
those that may have no answer, are solved one by one.
"""

import logging
from collections.abc import Mapping

import numpy as np

from sphpod.numerics import oscillators
from sphpod.surveys.fields import combined
from sphpod.surveys.folds import FAR, check_folds
from sphpod.surveys.query import Survey
from sphpod.surveys.questions import Question

logger = logging.getLogger(__name__)

NUMBERS = 2**18
"""Numbers of the histories that are made together."""


def answer_all(
    survey: Survey, asked: Mapping[str, Question], points: np.ndarray
) -> dict[str, np.ndarray]:
    """As `answers.answer_all`, of the parameters, the quantities and the reasons alone.

    Parameters
    ----------
    survey : Survey
    asked : dict
    points : array, shape (queries, parameters)

    Returns
    -------
    dict
        (queries,) or (queries, times) each; t.
    """
    operators, count = survey.operators, len(points)
    times = operators.nominal.error_times
    quantities = {
        name: np.full((count, times.size) if question.is_curve else count, np.nan)
        for name, question in asked.items()
    }
    reasons, is_left = np.full(count, "", object), np.ones(count, bool)
    sensors = sum(question.sensor_count for question in asked.values())
    if operators.oscillates and sensors <= survey.count:
        together = max(1, NUMBERS // (times.size * max(1, sensors))) if operators.is_affine else 1
        for first in range(0, count, together):
            rows = slice(first, first + together)
            part = {name: values[rows] for name, values in quantities.items()}
            is_left[rows] = _fill(survey, asked, points[rows], part)
    for n in np.flatnonzero(is_left):
        values = dict(zip(operators.parameters, map(float, points[n]), strict=True))
        try:
            answer = survey.solve(values)
            check_folds(operators, answer, values)
        except ValueError as error:
            reasons[n] = str(error)
            logger.warning("query %d: %s", n, error)
            continue
        for name, question in asked.items():
            quantities[name][n] = question.answer(answer, values)[0]
    parameters = {name: points[:, n] for n, name in enumerate(operators.parameters)}
    return {"t": times, **parameters, "reason": reasons, **quantities}


def _fill(survey, asked, points, found):
    """Write what oscillators answer, and say which queries are left, (queries,)."""
    operators, count = survey.operators, survey.count
    values = dict(zip(operators.parameters, np.ascontiguousarray(points.T), strict=True))
    density, decay = operators.density.factors(values)[:, 0], np.zeros(len(points))
    if operators.damping is not None:
        decay = operators.damping.each(values, np.zeros(1, int))[:, 0]
    started = operators.start.factors(values)
    scale = np.abs(density)
    begun = scale / 2 * (combined(started, operators.start_factor.T) ** 2).sum(axis=1)
    terms, factors, least = _stiffnesses(operators, values, count)
    fastest = FAR**2 * operators.volumes.min() * least
    answered = (operators.density.floor(values) > 0) & (decay >= 0) & (2 * begun < fastest)
    rows = np.flatnonzero(answered)
    if not rows.size:
        return ~answered
    sensing = {name: question for name, question in asked.items() if question.sensor_count}
    each = [question.sensors(values)[:, :, :count] for question in sensing.values()]
    sensors = [np.broadcast_to(part, (len(points), *part.shape[1:])) for part in each]
    energies = np.empty((rows.size, operators.nominal.error_times.size))
    histories = np.empty((rows.size, sum(part.shape[1] for part in sensors), energies.shape[1]))
    oscillators.solve_each(
        terms,
        factors[rows] / scale[rows, None],
        decay[rows],
        combined(started[rows], operators.unit_inertia.start[:, :count]),
        np.concatenate([np.zeros((len(points), 0, count)), *sensors], axis=1)[rows],
        np.repeat(
            [question.asked["field"] == "velocity" for question in sensing.values()],
            [question.sensor_count for question in sensing.values()],
        ).astype(bool),
        operators.nominal.error_interval,
        histories,
        energies,
    )
    energies *= scale[rows, None]
    first = 0
    for name, question in asked.items():
        last = first + question.sensor_count
        if question.sensor_count:
            field = np.swapaxes(histories[:, first:last], 1, 2)
            found[name][rows] = question.of_sensors(field)
        else:
            found[name][rows] = question.of_energy(energies, begun[rows])
        first = last
    return ~answered


def _stiffnesses(operators, values, count):
    """Stiffness matrices, their factors (queries, terms), and what the modulus is not below."""
    if operators.is_affine:
        terms = np.ascontiguousarray(operators.stiffnesses[:, :count, :count])
        return terms, operators.modulus.factors(values), operators.modulus.floor(values)
    modulus = operators.modulus.each(values, np.arange(operators.volumes.size))
    strains = operators.shapes[1][:count]
    terms = (strains * (operators.volumes * modulus[0])) @ strains.T
    return terms[None], np.ones((1, 1)), modulus.min(axis=1)
