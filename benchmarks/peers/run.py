"""The comparison: check every full model, take errors, take times in turns."""

import shutil
import sysconfig
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from importlib.util import find_spec
from math import ceil, inf
from typing import Any

import numpy as np

from benchmarks.peers import opinf_models, ours, pymor_models, scipy_models
from benchmarks.peers.contender import Contender, Model
from benchmarks.peers.problem import MODES, Problem
from sphpod.numerics.error import relative_error
from sphpod.numerics.timing import machine, measure

REPEATS = 5

SHORTEST_TURN = 0.05
"""Process time [s] below which a turn is made of several runs."""

SOLUTIONS = ("sph", "exact_in_time", "exact")
"""What velocities are compared with: full SPH, the same exact in time, and the exact solution."""


class Disagreement(Exception):
    """A full model does not give the solution that it should; the message is one sentence."""


@dataclass(frozen=True)
class Entry:
    """A contender that may be compared.

    Attributes
    ----------
    contender : Contender
    model : Model
    offline_seconds : float or None
        Process time [s] of building a reduced model.
    run_seconds : float
        Process time [s] of a run over the part of T that is timed.
    errors : dict
        Relative L2 error in velocity against each of `SOLUTIONS`.
    """

    contender: Contender
    model: Model
    offline_seconds: float | None
    run_seconds: float
    errors: dict[str, float]


def contenders(problem: Problem) -> Iterator[Contender]:
    """All rows of the table, tool by tool."""
    for tool in (ours, scipy_models, pymor_models, opinf_models):
        yield from tool.contenders(problem)
    if pysph_obstacle() is None:
        from benchmarks.peers import pysph_models

        yield from pysph_models.contenders(problem)


def pysph_obstacle() -> str | None:
    """What keeps PySPH from running here, in one sentence; None if nothing does."""
    if find_spec("pysph") is None:
        return "PySPH is left out: it could not be installed here, for which it needs a compiler."
    compiler = (sysconfig.get_config_var("CXX") or "c++").split()[0]
    if shutil.which(compiler) is None:
        return f"PySPH is left out: it needs the compiler {compiler}, which is not here."
    return None


def enter(problem: Problem, contender: Contender) -> Entry:
    """Build a model, run it over all of T, and take its errors.

    Raises
    ------
    Disagreement
        It is a full model, and not that of SPH.
    """
    model = contender.build()
    errors = velocity_errors(problem, model, model.prepare(problem.intervals)())
    check = contender.check
    if check is not None and not errors[check.against] <= check.within:
        raise Disagreement(
            f"{contender} is not compared: it differs from full SPH ({check.against}) by "
            f"{errors[check.against]:.1e}, more than {check.within:g}."
        )
    # Now that all is compiled and warm.
    offline_seconds = None if contender.modes is None else measure([contender.build], 1).item()
    run = model.prepare(problem.intervals // contender.part)
    run_seconds = measure([run], 1).item()
    return Entry(contender, model, offline_seconds, run_seconds, errors)


def velocity_errors(problem: Problem, model: Model, states: Any) -> dict[str, float]:
    """Relative L2 errors over the outputs of T; infinite if the model broke off or blew up."""
    velocity = model.velocity(states)
    solutions = problem.solution["velocity"], problem.exact_in_time, problem.exact
    errors = {}
    for name, solution in zip(SOLUTIONS, solutions, strict=True):
        expected = solution[:: model.stride]
        whole = velocity.shape == expected.shape and np.isfinite(velocity).all()
        errors[name] = relative_error(velocity, expected) if whole else inf
    return errors


def take_times(problem: Problem, entries: Sequence[Entry], repeats: int) -> np.ndarray:
    """Process time [s] over T of each model, which take turns; shape (entries, repeats)."""
    seconds = np.empty((len(entries), repeats))
    for repeat in range(repeats):
        for n, entry in enumerate(entries):
            part = entry.contender.part
            loops = ceil(SHORTEST_TURN / max(entry.run_seconds, 1e-5))
            run = entry.model.prepare(problem.intervals // part)
            seconds[n, repeat] = measure([_loop(run, loops)], 1).item() * part / loops
    return seconds


def field_seconds(problem: Problem) -> float:
    """Median time [s] of making velocities (times, N) from the coordinates of 12 modes."""
    coordinates = np.ones((problem.intervals + 1, MODES))
    modes, fields = np.ones((MODES, problem.count)), np.empty_like(problem.exact)
    return float(np.median(measure([lambda: np.matmul(coordinates, modes, out=fields)], REPEATS)))


def _loop(run, count):
    def turn():
        for _ in range(count):
            run()

    return turn


def rows(entries: Sequence[Entry], seconds: np.ndarray) -> Iterator[dict[str, Any]]:
    """Rows of the table, by column; what a contender does not have is None."""
    processor = machine()["processor"]
    for entry, times in zip(entries, seconds, strict=True):
        contender, model = entry.contender, entry.model
        lower, median, upper = np.quantile(times, (0.25, 0.5, 0.75))
        remarks = [contender.note] if contender.note else []
        if contender.part > 1:
            remarks.append(f"timed over T/{contender.part}, extrapolated per step")
        if model.stride > 1:
            remarks.append(f"one output in {model.stride}")
        if not entry.errors["sph"] < 0.5:
            remarks.append("unusable")
        yield {
            "tool": contender.tool,
            "version": version(contender.tool),
            "model": contender.model,
            "integrator": contender.integrator,
            "modes": contender.modes,
            "step_seconds": None if model.steps is None else median / model.steps,
            "cpu_seconds": median,
            "cpu_seconds_interquartile_range": upper - lower,
            "repeats": times.size,
            "offline_seconds": entry.offline_seconds,
            **{f"error_velocity_{name}": error for name, error in entry.errors.items()},
            "full_model_difference": (
                None if contender.check is None else entry.errors[contender.check.against]
            ),
            "note": "; ".join(remarks),
            "machine": processor,
        }
