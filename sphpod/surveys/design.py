"""The best values of a survey's parameters: sought with the reduced model, checked by full runs.

What is sought is the least or the largest value of a quantity or a parameter, or a value to be
reached, where others keep to their levels. The search needs no derivatives (COBYLA), as a largest
magnitude over time has kinks; it starts from the best queries, and ends where no step within the
ranges betters it: at an optimum among its neighbours. There the scene is solved in full. Where that
breaks a level, its run joins the training runs, and the search goes on with the modes of all,
corrected by what the model is still off by at that point, and a tenth of it for safety.

What is better, and by how much, says `sphpod.surveys.goal`.
"""

import logging
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sphpod.pipeline.dataset import Variable, meanings
from sphpod.scene.breakdown import Breakdown
from sphpod.surveys import samples, training, unbounded, validation
from sphpod.surveys.answers import answer_all, of_settings
from sphpod.surveys.goal import SLACK, Arrays, Goal, scales
from sphpod.surveys.questions import Question

logger = logging.getLogger(__name__)

STARTS = 3
"""Queries that the search starts from."""

CANDIDATES = 64
"""Queries of which these are taken where some parameters are given, at those values."""

FIRST_STEP, LAST_STEP = 0.1, 1e-7
"""Of the search, as parts of the ranges."""

MOST_EVALUATIONS = 200
"""From one start."""

MARGIN = 0.1
"""Part of what a model is off by at the last optimum, by which it then keeps away from a level."""

VARIABLES = meanings(
    """
    round (query) [1] int32: times that the model had been trained once more
    holds (query) [1] int8: 1 where the full run keeps to all levels of the design
    verdict (query): what the full run says of the optimum
    designed (designed_index): what is sought, and then what keeps to levels
    evaluation_round (evaluation) [1] int32: round of a query of the search
    evaluation_point (evaluation, parameter_index) []: values of its parameters, in SI units
    evaluation_value (evaluation, designed_index) []: values of what is designed, in SI units
    evaluation_excess (evaluation) [1]: largest excess over a level, of the spread over the queries
    """
)


def full_variables(asked: Mapping[str, Question]) -> dict[str, Variable]:
    """What the quantities of full runs mean."""
    found = {f"{name}_full": question.variable for name, question in asked.items()}
    return {
        name: each._replace(long_name=f"of the full run: {each.long_name}")
        for name, each in found.items()
    }


class Search:
    """The search for the best queries of a reduced model.

    Parameters
    ----------
    ranges : dict
    keys : dict
        The design in the configuration.

    Attributes
    ----------
    tried : list
        Round and answers of all queries, a pair for each start.
    """

    def __init__(self, ranges: samples.Ranges, keys: Mapping[str, Any], goal: Goal) -> None:
        self.ranges, self.goal = ranges, goal
        self._given = np.array([keys["given"].get(name, np.nan) for name in ranges])
        self._chosen = np.isnan(self._given)
        self._is_logarithmic = np.array(
            [given["scale"] == "logarithmic" for given in ranges.values()]
        )
        self._ends = np.array([given["range"] for given in ranges.values()], float).T
        self.tried: list[tuple[int, dict[str, np.ndarray]]] = []
        self.round = 0

    def at_given(self, points: np.ndarray) -> np.ndarray:
        """Points (n, parameters) at the values of the parameters that are given."""
        return np.where(self._chosen, points, self._given)

    def _scaled(self, points):
        return np.log(points, out=np.array(points), where=self._is_logarithmic)

    def _unit(self, point):
        """Places of the chosen parameters within their ranges, or those of the logarithms."""
        low, high = self._scaled(self._ends)
        return np.clip((self._scaled(point) - low) / (high - low), 0, 1)[self._chosen]

    def _point(self, unit):
        low, high = self._scaled(self._ends)
        place = np.zeros(len(self.ranges))
        place[self._chosen] = unit
        scaled = low + place * (high - low)
        values = np.exp(scaled, out=scaled, where=self._is_logarithmic)
        return self.at_given(np.clip(values, *self._ends))

    def best(self, ask: Any, starts: np.ndarray, margin: np.ndarray) -> np.ndarray:
        """The best points (starts, parameters), one from each start, the best of all first.

        Parameters
        ----------
        ask : callable
            Answers of points.
        starts : array, shape (starts, parameters)
        margin : array, shape (levels,)
            What is added to the excess over each level, in spreads.
        """
        ends = [self._from(ask, start, margin) for start in starts]
        self.round += 1
        order = self.goal.order(
            np.array([objective for _, objective, _ in ends]),
            np.array([excess for _, _, excess in ends]),
        )
        return np.array([ends[n][0] for n in order])

    def _from(self, ask, start, margin):
        from scipy.optimize import Bounds, NonlinearConstraint, minimize

        points, answers, known = [], [], {}

        def asked(unit):
            unit = np.clip(unit, 0, 1)  # a step may end beyond a bound
            key = unit.tobytes()
            if key not in known:
                points.append(self._point(unit))
                answers.append(ask(points[-1][None]))
                found = answers[-1]
                known[key] = self.goal.objective(found)[0], self.goal.excess(found)[0] + margin
            return known[key]

        count = np.count_nonzero(self._chosen)
        minimize(
            lambda unit: asked(unit)[0],
            self._unit(start),
            method="COBYLA",
            bounds=Bounds(np.zeros(count), np.ones(count)),
            constraints=[NonlinearConstraint(lambda unit: asked(unit)[1], -np.inf, 0)],
            options={"rhobeg": FIRST_STEP, "maxiter": MOST_EVALUATIONS, "catol": SLACK / 10},
            tol=LAST_STEP,
        )
        self.tried.append((self.round, _joined(answers)))
        objective, excess = map(np.array, zip(*known.values(), strict=True))
        first = self.goal.order(objective, excess)[0]
        return points[first], objective[first], excess[first]


@dataclass(frozen=True)
class Check:
    """An optimum, by the reduced model and in full, one query each.

    Attributes
    ----------
    reduced, full : dict
        Parameters, quantities and reason, (1,) or (1, times) each.
    is_feasible : bool
        Whether the reduced model, corrected, keeps to all levels.
    run : dict
        The full run, to train with; empty where it breaks down.
    true_error : float
        As of a query that is validated.
    """

    reduced: dict[str, np.ndarray]
    is_feasible: bool
    full: dict[str, np.ndarray]
    run: dict[str, np.ndarray]
    true_error: float

    def verdict(self, goal: Goal) -> tuple[str, bool]:
        """What comes of it, in words, and whether training with it may change that."""
        broken = goal.broken(self.full)
        if not broken:
            return "the full run holds", False
        begins = "the full run does not hold" if self.is_feasible else "nothing is feasible"
        return f"{begins}: {'; '.join(broken)}", self.is_feasible and bool(self.run)


def design(
    name: str,
    settings: Mapping[str, Any],
    survey: Mapping[str, Any],
    model: Arrays,
    answers: Arrays,
    runs: Iterable[Arrays] = (),
) -> dict[str, np.ndarray]:
    """Optima of a survey, and their full runs.

    There is one of each round, by the reduced model and in full; the last one is the answer.

    Parameters
    ----------
    name, settings, survey, model
        As of any query.
    answers : dict
        Of the queries, the best of which the search starts from.
    runs : iterable of dicts
        The training runs, read where they are needed; made again then, if there are none.

    Returns
    -------
    dict
        Parameters, quantities and bounds of the optima, (rounds,) or (rounds, times) each; the
        quantities of full runs with ``_full``; true_error, and what `VARIABLES` lists.
    """
    keys, tolerance = survey["design"], survey["tolerance"]
    reduced, asked = of_settings(name, settings, survey, model)
    last, end = reduced.operators.nominal.error_times[-2:]
    spreads = scales(settings["parameters"], answers)
    goal = Goal(keys, spreads, float(2 * end - last), tolerance)
    search = Search(settings["parameters"], keys, goal)

    def ask(points: np.ndarray) -> dict[str, np.ndarray]:
        return unbounded.answer_all(reduced, asked, points)

    starts, margin = _starts(search, answers, ask), np.zeros(len(goal.levels))
    checks: list[Check] = []
    trained: list[Arrays] = []
    while True:
        starts = search.best(ask, starts, margin)
        found = answer_all(reduced, asked, starts[:1], tolerance)
        is_feasible = not goal.broken(found, margin)
        check = Check(found, is_feasible, *_in_full(name, settings, reduced, asked, starts[0]))
        verdict, is_open = check.verdict(goal)
        logger.info("round %d: %s", len(checks), verdict)
        checks.append(check)
        if not is_open or len(checks) > keys["rounds"]:
            return _arrays(checks, search)
        trained = [*(trained or list(runs) or _again(name, settings, model)), check.run]
        model = training.train(name, settings, survey, trained)
        reduced, asked = of_settings(name, settings, survey, model)
        (off,) = goal.excess(check.full) - goal.excess(ask(starts[:1]))
        margin = off + MARGIN * np.abs(off)


def _starts(search, answers, ask):
    """Points of the best queries, at the values of the parameters that are given."""
    points = np.stack([answers[name] for name in search.ranges], axis=1)
    moved = search.at_given(points)
    if not np.array_equal(points, moved):
        points = moved[:CANDIDATES]
        answers = ask(points)
    goal = search.goal
    return points[goal.order(goal.objective(answers), goal.excess(answers))[:STARTS]]


def _in_full(name, settings, reduced, asked, point):
    """Quantities of the full run at a point, its fields, and the true error of the query there."""
    values = dict(zip(settings["parameters"], map(float, point), strict=True))
    full = {parameter: np.array([value]) for parameter, value in values.items()}
    try:
        scene, fields, norms = validation.in_full(name, settings, values)
    except Breakdown as error:
        times = reduced.operators.nominal.error_times
        unknown = {
            word: np.full((1, times.size) if question.is_curve else 1, np.nan)
            for word, question in asked.items()
        }
        return {**full, **unknown, "reason": np.array([str(error)], object)}, {}, np.nan
    for word, question in asked.items():
        full[word] = np.array([question.of_fields(scene, fields, norms**2 / 2)], float)
    try:
        answer = reduced.answer(values)
        reduced_fields = answer.fields(reduced.operators)
        true_error = validation.relative_error(scene, fields, *reduced_fields)
    except ValueError:  # a query that fails has its reason beside it
        true_error = np.nan
    full["reason"] = np.array([""], object)
    return full, fields | {"point": point}, true_error


def _again(name, settings, model):
    return [training.run_at(name, settings, point) for point in model["training_points"]]


def _arrays(checks, search):
    """What is written of all rounds, and of all queries of the search."""
    goal, names = search.goal, list(search.ranges)
    found = {
        "round": np.arange(len(checks)),
        "t": checks[0].reduced["t"],
        **_joined([check.reduced for check in checks]),
        "true_error": np.array([check.true_error for check in checks]),
        "holds": np.array([not goal.broken(check.full) for check in checks]),
        "verdict": np.array([check.verdict(goal)[0] for check in checks], object),
    }
    full = _joined([check.full for check in checks])
    found |= {f"{word}_full": full[word] for word in full if word not in (*names, "reason")}
    tried = _joined([answers for _, answers in search.tried])
    numbers = [number for number, _ in search.tried]
    sizes = [len(answers["reason"]) for _, answers in search.tried]
    return found | {
        "designed": np.array(goal.names, object),
        "evaluation_round": np.repeat(numbers, sizes),
        "parameter": np.array(names, object),
        "evaluation_point": np.stack([tried[word] for word in names], axis=1),
        "evaluation_value": np.stack([goal.values(tried, word) for word in goal.names], axis=1),
        "evaluation_excess": goal.excess(tried).max(axis=1, initial=0.0),
    }


def _joined(rows):
    return {name: np.concatenate([row[name] for row in rows]) for name in rows[0] if name != "t"}
