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
"""Numbers of the histories, or of the moduli, that are made together."""


def answer_all(
    survey: Survey, asked: Mapping[str, Question], points: np.ndarray
) -> dict[str, np.ndarray]:
    """As `answers.answer_all`, of the parameters, the quantities and the reasons alone.

    Parameters
    ----------
    asked : dict
    points : array, shape (queries, parameters)

    Returns
    -------
    dict
        (queries,) or (queries, times) each; t.
    """
    operators, count = survey.operators, len(points)
    times, particles = operators.nominal.error_times, operators.volumes.size
    quantities = {
        name: np.full((count, times.size) if question.is_curve else count, np.nan)
        for name, question in asked.items()
    }
    reasons, is_left = np.full(count, "", object), np.ones(count, bool)
    sensors = sum(question.sensor_count for question in asked.values())
    if operators.oscillates and sensors <= survey.count:
        each = max(times.size * (1 + sensors), 0 if operators.is_affine else particles)
        together = max(1, NUMBERS // each)
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


@np.errstate(all="ignore")
def _fill(survey, asked, points, found):
    """Write what oscillators answer, and say which queries are left, (queries,)."""
    operators, count = survey.operators, survey.count
    values = dict(zip(operators.parameters, np.ascontiguousarray(points.T), strict=True))
    scale, decay = np.abs(operators.density.factors(values)[:, 0]), np.zeros(len(points))
    if operators.damping is not None:
        decay = operators.damping.each(values, np.zeros(1, int))[:, 0]
    if operators.is_affine:
        modulus = operators.modulus.factors(values)
        least = operators.modulus.floor(values)
    else:
        modulus = operators.modulus.each(values, np.arange(operators.volumes.size))
        least = modulus.min(axis=1)
    started = operators.start.factors(values)
    begun = scale / 2 * (combined(started, operators.start_factor.T) ** 2).sum(axis=1)
    folds_not = 2 * begun < FAR**2 * operators.volumes.min() * least
    is_answered = (operators.density.floor(values) > 0) & (decay >= 0) & folds_not
    is_answered &= np.isfinite(points).all(axis=1)
    rows = np.flatnonzero(is_answered)
    starts = combined(started, operators.unit_inertia.start[:, :count])
    vectors, is_velocity = _vectors(asked, values, starts)
    solved = np.empty((rows.size, vectors.shape[1], operators.nominal.error_times.size))
    moduli = modulus[rows] / scale[rows, None]
    _solve(operators, moduli, decay[rows], vectors[rows], is_velocity, solved)
    energies = scale[rows, None] * solved[:, 0]
    first = 1
    for name, question in asked.items():
        last = first + question.sensor_count
        if question.sensor_count:
            field = np.swapaxes(solved[:, first:last], 1, 2)
            found[name][rows] = question.of_sensors(field)
        else:
            found[name][rows] = question.of_energy(energies, begun[rows])
        first = last
    return ~is_answered


def _vectors(asked, values, starts):
    """Start and sensors of each query (queries, 1 + sensors, k), and which are of velocity."""
    sensing = [question for question in asked.values() if question.sensor_count]
    counts = [question.sensor_count for question in sensing]
    is_velocity = [question.asked["field"] == "velocity" for question in sensing]
    vectors = np.empty((len(starts), 1 + sum(counts), starts.shape[1]))
    vectors[:, 0], first = starts, 1
    for question, count in zip(sensing, counts, strict=True):
        vectors[:, first : first + count] = question.sensors(values)[:, :, : starts.shape[1]]
        first += count
    return vectors, np.repeat(np.array(is_velocity, bool), counts)


def _solve(operators, moduli, decays, vectors, is_velocity, solved):
    """Solve queries, from their moduli: by terms, or by particles."""
    interval, count = operators.nominal.error_interval, vectors.shape[2]
    if operators.is_affine:
        terms = np.ascontiguousarray(operators.stiffnesses[:, :count, :count])
        oscillators.solve_each(terms, moduli, decays, vectors, is_velocity, interval, solved)
        return
    strains, once = operators.shapes[1][:count], np.ones((1, 1))
    for n, modulus in enumerate(moduli):
        stiffness = (strains * (operators.volumes * modulus)) @ strains.T
        own = decays[n : n + 1], vectors[n : n + 1], is_velocity, interval, solved[n : n + 1]
        oscillators.solve_each(stiffness[None], once, *own)
