"""The worked survey of parameters by this project and pyMOR, ``-m benchmarks.peers.survey``.

Reduced models of the same training runs answer the same queries. Errors are those of
`sphpod.surveys.validation`: the largest energy norm over time of the difference to the lifted full
model at the same parameters, exact in time, over the largest energy norm of that.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from importlib.metadata import version
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.peers import table
from sphpod.config.config import load
from sphpod.full import lifted
from sphpod.numerics.timing import machine, measure, warm_up
from sphpod.surveys import samples, training, unbounded
from sphpod.surveys.answers import answer_all
from sphpod.surveys.parts import Operators, Values
from sphpod.surveys.query import Survey
from sphpod.surveys.questions import questions
from sphpod.surveys.validation import SEED, relative_error

CONFIG, NAME = "config/surveys.yaml", "graded_bar"

MODE_COUNTS = (20, 30, 40, 50, 60)
"""k of each field; of PSD bases half the vectors."""

NOMINAL_COUNTS = (8, 12, 16, 20, 24, 32)
"""The same at the nominal parameters, where the run has fewer modes."""

TESTED = 16
"""Random queries whose true errors are taken."""

AT_ONCE = 250
"""Queries without bounds that are answered together."""

TIMED = 4
"""Queries that are answered in a turn."""

REPEATS, SHORTEST = 5, 0.02

SLOW = 0.2
"""Seconds of a query from which it alone is a turn."""

Fields = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Surveyed:
    """A reduced model of all parameters, prepared.

    Attributes
    ----------
    fields : callable
        Velocity and strain (times, N) at some parameters.
    answer : callable
        What is timed: from parameters to the quantities of the survey.
    at_once : int
        Queries at these parameters that it answers, as many do that have no use for one alone.
    growth : callable, optional
        Largest real part of its operator at some parameters [1/s]; None where it is proved that
        there is none above 0.
    """

    fields: Callable[[Values], Fields]
    answer: Callable[[Values], object]
    growth: Callable[[Values], float] | None = None
    at_once: int = 1


@dataclass(frozen=True)
class Method:
    """Rows of a table, one for each mode count.

    Attributes
    ----------
    tool, model, integrator : str
    build : callable
        Makes the model of k modes, of bases that are made at its first call for all k.
    counts : sequence of ints
        Mode counts that it is run with.
    """

    tool: str
    model: str
    integrator: str
    build: Callable[[int], Surveyed] = field(repr=False)
    counts: Sequence[int] = MODE_COUNTS


@dataclass(frozen=True)
class Task:
    """The survey: its settings, the training runs of all reduced models, and what is tested.

    Attributes
    ----------
    settings, survey : dict
        Of the scene and of the survey, as the configuration has them.
    runs : sequence of dicts
    tested : sequence of dicts
        Parameters at which true errors are taken.
    """

    settings: Mapping[str, Any]
    survey: Mapping[str, Any]
    runs: Sequence[Mapping[str, np.ndarray]]
    tested: Sequence[Values]

    @classmethod
    def load(cls) -> "Task":
        """Read the configuration, and run the lifted full model at all training points."""
        config = load([CONFIG])
        survey = config["surveys"][NAME]
        settings = samples.survey_settings(config["scenes"][survey["scene"]], survey)
        ranges = settings["parameters"]
        drawn = samples.points(ranges, {"count": TESTED, "sampling": "uniform", "seed": SEED})
        count = survey["training"]["count"]
        return cls(
            settings,
            survey,
            [training.run(NAME, settings, survey, n) for n in range(count)],
            [dict(zip(ranges, map(float, point), strict=True)) for point in drawn],
        )

    def nominal(self) -> "Task":
        """The same of the run at the nominal parameters alone."""
        ranges = self.settings["parameters"]
        values = {name: float(given["nominal"]) for name, given in ranges.items()}
        run = lifted.solve(samples.scene_at(NAME, self.settings, values), "exact")
        return replace(self, runs=[run | {"point": np.array([*values.values()])}], tested=[values])

    @cached_property
    def operators(self) -> Operators:
        """Of no modes: profiles of the coefficients."""
        count = self.settings["particle_count"]
        none = {"velocity_modes": np.zeros((1, count)), "translation": 0}
        return Operators(NAME, self.settings, none)

    @cached_property
    def questions(self) -> Mapping[str, Any]:
        """What is asked, by name."""
        return questions(self.operators, self.survey["quantities"])

    @cached_property
    def solved(self) -> list[tuple[Any, Mapping[str, np.ndarray]]]:
        """Scene and run of the lifted full model, exact in time, at all that is tested."""
        scenes = [samples.scene_at(NAME, self.settings, values) for values in self.tested]
        return [(scene, lifted.solve(scene, "exact")) for scene in scenes]

    def errors(self, model: Surveyed) -> np.ndarray:
        """True errors at all that is tested, infinite where the model blew up."""
        found = [
            relative_error(scene, full, *model.fields(values))
            for (scene, full), values in zip(self.solved, self.tested, strict=True)
        ]
        return np.where(np.isfinite(found), found, np.inf)

    def growth(self, model: Surveyed) -> float | None:
        """Largest growth rate at 50 random parameters, with the least damping [1/s]."""
        if model.growth is None:
            return None
        ranges = self.settings["parameters"]
        points = samples.points(ranges, {"count": 50, "sampling": "uniform", "seed": SEED + 1})
        if len(self.tested) == 1:
            points = points[:0]
        values = [dict(zip(ranges, map(float, point), strict=True)) for point in points]
        least = {"decay": ranges["decay"]["range"][0]}
        return max((model.growth(point | least) for point in values), default=None)


def ours(task: Task, counts: Sequence[int] = MODE_COUNTS) -> Iterator[Method]:
    """Queries of this project, without and with their bounds."""

    def trained(count):
        return training.train(NAME, task.settings, {**task.survey, "mode_count": count}, task.runs)

    # As the survey does, once for all mode counts where nothing is bounded.
    every = cache(partial(trained, 2 * max(counts)))

    def build(bounded, count):
        if bounded:
            shared = trained(count)
        else:
            shared = {**every(), "velocity_modes": every()["velocity_modes"][:count]}
        survey = Survey(Operators(NAME, task.settings, shared), count)
        asked = questions(survey.operators, task.survey["quantities"])

        def plain(values):
            points = np.tile([*values.values()], (AT_ONCE, 1))
            return unbounded.answer_all(survey, asked, points)

        def with_bounds(values):
            point = np.array([[*values.values()]])
            return answer_all(survey, asked, point, task.survey["tolerance"])

        def fields(values):
            return survey.solve(values).fields(survey.operators)

        if bounded:
            return Surveyed(fields, with_bounds)
        return Surveyed(fields, plain, at_once=AT_ONCE)

    one = partial(Method, "sphpod", integrator="exact, one jump to each output", counts=counts)
    yield one("displacement", build=partial(build, False))
    yield one("displacement, with bounds and estimate", build=partial(build, True))


@threadpool_limits.wrap(limits=1)
def compare(task: Task, methods: Sequence[Method]) -> list[dict[str, Any]]:
    """Rows of a table: errors, times of a query in turns, and what each took to build."""
    entries, runs, numbers, parts = [], [], [], []
    for method in methods:
        # The first call makes the bases.
        offline = measure([partial(method.build, max(method.counts))], 1).item()
        for count in method.counts:
            model = method.build(count)
            errors = task.errors(model)
            points = [task.tested[n % len(task.tested)] for n in range(TIMED)]
            once = measure([partial(model.answer, points[0])] * 2, 1)[1].item()
            points = points[: 1 if once > SLOW else TIMED]
            run = partial(_answer_all, model, points)
            entries.append((method, count, errors, offline, task.growth(model)))
            runs.append(run)
            numbers.append(warm_up(run, SHORTEST))
            parts.append(len(points) * model.at_once)
            print(f"{method.tool}: {method.model}, k = {count}: {errors.max():.2e}", flush=True)
    seconds = measure(runs, REPEATS, numbers) / np.array(parts)[:, None]
    return [_row(*entry, times) for entry, times in zip(entries, seconds, strict=True)]


def _answer_all(model, points):
    for values in points:
        model.answer(values)


def _row(method, count, errors, offline, growth, times):
    lower, median, upper = np.quantile(times, (0.25, 0.5, 0.75))
    return {
        "tool": method.tool,
        "version": version(method.tool),
        "model": method.model,
        "integrator": method.integrator,
        "modes": count,
        "error_largest": errors.max(),
        "error_median": np.median(errors),
        "query_seconds": median,
        "query_seconds_interquartile_range": upper - lower,
        "repeats": times.size,
        "offline_seconds": offline,
        "growth_rate": growth,
        "machine": machine()["processor"],
    }


def main() -> None:
    """Write results/peers_survey.csv and .md, and the same of the nominal parameters."""
    from benchmarks.peers import pymor_survey

    task = Task.load()
    found = compare(task, [*ours(task), *pymor_survey.methods(task)])
    table.write_survey("results/peers_survey", found, f"the largest of {TESTED} random queries")
    nominal = task.nominal()
    plain, _ = ours(nominal, NOMINAL_COUNTS)
    found = compare(nominal, [plain, *pymor_survey.symplectic(nominal, NOMINAL_COUNTS)])
    table.write_survey("results/peers_nominal", found, "of the query at the nominal parameters")
    print("Written: results/peers_survey, results/peers_nominal (.csv, .md)")


if __name__ == "__main__":
    main()
