"""What a query costs by full and by reduced models, and from how many on training has paid.

All answer the same queries, some of the survey's own, with all its quantities. A full model keeps
its fields at all outputs; of its cost the preparation is left out, which could be as fast as that
of a reduced model, whose cost is a query's whole one. Without bounds that answers each of them
many times at once, as it does many queries. A full model with steps is run with the
largest whose error, over all these queries, is at most that of the reduced model: the largest
energy norm of the difference to the lifted full model exact in time, of the largest norm of that.
"""

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from sphpod.full import lifted, sph
from sphpod.numerics import timing
from sphpod.numerics.error import Arrays
from sphpod.pipeline.dataset import meanings
from sphpod.scene import waves
from sphpod.scene.scene import Scene
from sphpod.surveys import even, samples, training, unbounded
from sphpod.surveys.answers import answer_all, of_settings
from sphpod.surveys.parts import Operators, Values
from sphpod.surveys.questions import Question
from sphpod.surveys.validation import relative_error

logger = logging.getLogger(__name__)

QUERIES = 8
"""Queries that every contender answers in a turn."""

AT_ONCE = 1000
"""Queries that the reduced model without bounds answers in a run, at least."""

VARIABLES = meanings(
    """
    query_error (contender_index) [1]: largest relative error of the queries, as true_error
    query_seconds (contender_index, repeat) [s]: CPU time of a query
    training_seconds (repeat) [s]: CPU time of all training runs and modes
    break_even (contender_index) [1]: queries from which the reduced model with bounds costs less
    break_even_unbounded (contender_index) [1]: the same of the reduced model without bounds
    """
)

Fields = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Contender:
    """A model that answers all queries of a turn.

    Attributes
    ----------
    answer : callable
        Answers all queries, from values of parameters or from prepared models to quantities.
    modes : int
        0 of a full model.
    time_step : float
        Δt [s], NaN where there is none.
    rounds : int
        How often it answers them.
    """

    name: str
    integrator: str
    answer: Callable[[], object]
    error: float
    modes: int = 0
    time_step: float = np.nan
    rounds: int = 1


class Task:
    """The queries of a turn, and what is known of each.

    Parameters
    ----------
    asked : dict
    points : sequence of dicts
        Parameters of the queries.
    """

    def __init__(
        self, operators: Operators, asked: Mapping[str, Question], points: Sequence[Values]
    ) -> None:
        self.asked, self.points = asked, points
        settings = operators.settings
        self.scenes = [samples.scene_at(operators.name, settings, point) for point in points]
        self.exact = [lifted.solve(scene, "exact") for scene in self.scenes]
        of_energy = [q.output for q in asked.values() if "energy" in q.asked["kind"]]
        self.outputs = np.unique([0, *of_energy])
        shape = operators.nominal.error_times.size, operators.nominal.particle_count
        # Written to before any run.
        self.kept = np.full(shape, 0.0), np.full(shape, 0.0)

    def error(self, fields: Callable[[int], Fields | None]) -> float:
        """Largest error of all queries, infinite where one broke down; of fields by query."""
        worst = 0.0
        for n, (scene, full) in enumerate(zip(self.scenes, self.exact, strict=True)):
            found = fields(n)
            worst = max(worst, np.inf if found is None else relative_error(scene, full, *found))
        return worst

    def quantities(self, scene: Scene, fields: Fields, energy: np.ndarray) -> list[Any]:
        """All that is asked; energies are of `outputs` alone."""
        over_time = np.zeros(len(fields[0]))
        over_time[self.outputs] = energy
        named = {"velocity": fields[0], "strain": fields[1]}
        return [q.of_fields(scene, named, over_time) for q in self.asked.values()]


def measure(
    name: str, settings: Mapping[str, Any], survey: Mapping[str, Any], model: Arrays
) -> dict[str, np.ndarray]:
    """What a query of a survey costs, by full and by reduced models.

    Each contender answers, and the training is done, in turns.

    Parameters
    ----------
    name, settings : name and settings of the scene
    survey : dict
        Its settings, of which cost_repeats are the turns.
    model : dict
        As from `training.train`.

    Returns
    -------
    dict
        One entry a contender: contender, integrator, contender_mode_count, contender_time_step [s],
        query_error, break_even, break_even_unbounded (infinite where there is none, NaN of the
        reduced models); query_seconds (contenders, repeats), training_seconds (repeats,) [s].

    Raises
    ------
    ValueError
        None of the queries has an answer.
    """
    bounded, asked = of_settings(name, settings, survey, model)
    points = picked(bounded, asked, survey)
    of_points = [dict(zip(settings["parameters"], map(float, p), strict=True)) for p in points]
    task = Task(bounded.operators, asked, of_points)
    reduced = _reduced(task, bounded, points)
    contenders = [
        _sph(task),
        *_lifted(task, reduced.error),
        *_fourier(task, bounded),
        reduced,
        replace(
            reduced,
            name="reduced_bounded",
            answer=partial(answer_all, bounded, asked, points, survey["tolerance"]),
            rounds=1,
        ),
    ]
    runs = [contender.answer for contender in contenders]
    numbers = [timing.warm_up(run) for run in runs]
    train = partial(_train, name, settings, survey)
    seconds = timing.measure([*runs, train], survey["cost_repeats"], [*numbers, 1])
    rounds = np.array([contender.rounds for contender in contenders])
    each, once = seconds[:-1] / (rounds[:, None] * len(points)), seconds[-1]
    middle = np.median(each, axis=1)
    full = np.array([contender.modes == 0 for contender in contenders])
    return {
        "contender": np.array([c.name for c in contenders]),
        "integrator": np.array([c.integrator for c in contenders]),
        "contender_mode_count": np.array([c.modes for c in contenders]),
        "contender_time_step": np.array([c.time_step for c in contenders]),
        "query_error": np.array([c.error for c in contenders]),
        "query_seconds": each,
        "training_seconds": once,
        "break_even": np.where(full, break_even(middle, middle[-1], np.median(once)), np.nan),
        "break_even_unbounded": np.where(
            full, break_even(middle, middle[-2], np.median(once)), np.nan
        ),
    }


def break_even(full: np.ndarray, reduced: float, trained: float) -> np.ndarray:
    """Queries from which those of the reduced model, and its training, cost less than the others.

    Parameters
    ----------
    full : array
        Of a query [s].
    reduced : float
        Of a query [s].
    trained : float
        Of the training [s].

    Returns
    -------
    array
        Infinite where a query costs no less.
    """
    saved = np.asarray(full - reduced, float)
    return np.divide(trained, saved, out=np.full_like(saved, np.inf), where=saved > 0)


def picked(survey, asked, keys):
    """Parameters of queries, evenly picked from those of the survey that have an answer."""
    ranges = survey.operators.settings["parameters"]
    drawn = samples.points(ranges, keys["queries"])
    picked = drawn[np.unique(np.linspace(0, len(drawn) - 1, QUERIES).astype(int))]
    reasons = answer_all(survey, asked, picked, keys["tolerance"])["reason"]
    if all(reasons):
        raise ValueError(f"none of the queries whose cost is measured has an answer: {reasons[0]}")
    return picked[~reasons.astype(bool)]


def _train(name, settings, survey):
    """All that precedes the first query."""
    if survey["training"]["method"] == "greedy":
        model = training.train_greedily(name, settings, survey)
    else:
        count = survey["training"]["count"]
        runs = [training.run(name, settings, survey, n) for n in range(count)]
        model = training.train(name, settings, survey, runs)
    return of_settings(name, settings, survey, model)


# --- Reduced models -------------------------------------------------------------------------------


def _reduced(task, survey, points):
    """The reduced model without bounds and estimates."""
    rounds = -(-AT_ONCE // len(points))

    def fields(n):
        return survey.solve(task.points[n]).fields(survey.operators)

    answer = partial(unbounded.answer_all, survey, task.asked, np.tile(points, (rounds, 1)))
    error = task.error(fields)
    return Contender("reduced", "exact", answer, error, survey.count, rounds=rounds)


# --- Full models ----------------------------------------------------------------------------------


def _sph(task):
    """Full SPH with the explicit Euler steps of the scene."""
    scene = task.scenes[0]
    neighbours = "stencil" if scene.is_even else "lists"
    runs = [sph.prepare(scene, scene.error_steps, neighbours) for scene in task.scenes]

    def shown(scene):
        return task.kept[0], lifted.strain(scene, task.kept[1])

    return _run(task, "sph", "explicit_euler", runs, shown, scene.time_step)


def _lifted(task, target):
    """The lifted full model: with the largest steps that are accurate enough, and exact in time."""
    for integrator in ("leapfrog", "symplectic_euler"):
        found = coarsest(task, integrator, target)
        if found is None:
            logger.info("%s: no step up to the scene's own has an error of %g", integrator, target)
        else:
            yield found
    runs = [lifted.prepare(scene, "exact") for scene in task.scenes]
    yield _run(task, "lifted_full", "exact", runs, lambda scene: task.kept)


def coarsest(task, integrator, target):
    """The model with the fewest steps between outputs whose error is at most the target.

    None if it would take shorter steps than the scene's own.
    """

    def stepped(count):
        step = scene.error_interval / count
        runs = [lifted.prepare(each, integrator, step) for each in task.scenes]
        return _run(task, "lifted_full", integrator, runs, lambda scene: task.kept, step)

    scene = task.scenes[0]
    fastest = max(map(waves.fastest_wave, task.scenes))
    low, high = 0, 1 + int(scene.error_interval * fastest / 2)
    finest = max(high, scene.error_stride)
    while (found := stepped(high)).error > target:
        if high == finest:
            return None
        low, high = high, min(2 * high, finest)
    while high - low > 1 and low:
        middle = (low + high) // 2
        other = stepped(middle)
        if other.error > target:
            low = middle
        else:
            high, found = middle, other
    return found


def _run(task, name, integrator, runs, shown, time_step=np.nan):
    """A full model of prepared runs, one a query, whose fields are as `shown` makes them."""
    roots = [lifted.energy_weights(scene) for scene in task.scenes]
    for run in runs:
        run.state = task.kept

    def fields(n):
        return shown(task.scenes[n]) if runs[n].run().breakdown() is None else None

    def answer():
        for scene, run, (mass, stiffness) in zip(task.scenes, runs, roots, strict=True):
            run.run()
            velocity, strain = shown(scene)
            squares = (mass * velocity[task.outputs]) ** 2 + (stiffness * strain[task.outputs]) ** 2
            task.quantities(scene, (velocity, strain), squares.sum(axis=1) / 2)

    return Contender(name, integrator, answer, task.error(fields), time_step=time_step)


def _fourier(task, survey):
    """The lifted full model by its Fourier modes, where the scene has such for all parameters."""
    if not even.is_even(survey.operators):
        return
    sensed = [q.particles for q in task.asked.values() if "place" in q.asked]
    particles = np.unique(np.concatenate([np.zeros(0, int), *sensed]))
    asked = even.Waves(survey, particles, task.outputs)
    every = even.Waves(survey, np.arange(survey.operators.volumes.size), task.outputs)

    def answer():
        for scene, values in zip(task.scenes, task.points, strict=True):
            velocity, strain, energy = asked.solve(values)
            for kept, columns in zip(task.kept, (velocity, strain), strict=True):
                kept[:, particles] = columns
            task.quantities(scene, task.kept, energy)

    error = task.error(lambda n: every.solve(task.points[n])[:2])
    yield Contender("fourier", "exact", answer, error)
