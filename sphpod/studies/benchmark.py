"""Run time against error: full and reduced models by every method, in one run of one process.

Every contender computes the same: the state at all times of the error integral, a full model as
fields, a reduced model in its own coordinates; what fields cost on top is given apart. They are
prepared first; what they share, such as modes, is not timed with any of them but reported as
offline time. The force at every step is prepared too, where a model steps; a lifted reduced model
evaluates it as it runs where it is smooth. Errors are those of the very runs that are timed.
"""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from sphpod.full import lifted, sph
from sphpod.numerics import timing
from sphpod.numerics.error import FIELDS, Arrays, relative_error
from sphpod.numerics.timing import SHORTEST
from sphpod.reduced import lifted_rom, pod, snapshots
from sphpod.reduced.rom import acceleration_contenders, freeze_steps, galerkin, modes_resolved
from sphpod.reduced.sweep import ReducedRun
from sphpod.reference import exact, reference
from sphpod.scene import waves
from sphpod.scene.run import Run
from sphpod.scene.scene import Scene
from sphpod.studies.cpu_time import BASELINES
from sphpod.studies.study import Dataset, Drawing, Study, accelerated

MODE_COUNTS = (4, 8, 12, 16, 20)
"""Mode counts that every reduced model is run with, as far as the snapshots give them."""

SPACINGS = (4, 2, 0.5)
"""Multiples of the scene's spacing, and of its time step, with which full models are run too."""

EULER_STEPS = (2, 0.5, 0.25)
"""Multiples of the scene's time step with which explicit Euler is run too."""

TOLERANCES = {"rk45": (1e-3, 1e-5, 1e-7), "dop853": (1e-4, 1e-6, 1e-8)}
"""Relative tolerances of adaptive integrators."""


@dataclass(frozen=True)
class Contender:
    """A model ready to run.

    Attributes
    ----------
    modes, n_freeze : int
        0 where there are none.
    tolerance : float
        Of an adaptive integrator, else NaN.
    projection_seconds : float
        CPU time of the preparation [s].
    resolved : bool
        Whether rounding leaves the span of its modes, if it has any, as it is (`pod.resolved`).
    """

    method: str
    integrator: str
    run: Run
    modes: int = 0
    n_freeze: int = 0
    tolerance: float = np.nan
    projection_seconds: float = 0.0
    resolved: bool = True

    @property
    def scene(self) -> Scene:
        """With its own particle count and time step."""
        return self.run.scene

    @property
    def time_step(self) -> float:
        """Δt [s] of a model that steps evenly, else NaN."""
        fixed = self.integrator in (*lifted.FIXED_STEP, "repeats explicit_euler")
        return self.scene.time_step if fixed else np.nan


@threadpool_limits.wrap(limits=1)
def compare(
    scene: Scene,
    sampling: Mapping[str, Any],
    study: Mapping[str, Sequence[int]],
    taken: Arrays,
    full: Arrays,
    repeats: int,
) -> dict[str, np.ndarray]:
    """CPU times and errors of all contenders of a study.

    Parameters
    ----------
    sampling : dict
        As in `snapshots.sampling_steps`.
    study : dict
        mode_counts and n_freeze.
    taken : dict
        velocity_snapshots, density_snapshots of the sampling.
    full : dict
        velocity and density (times, N) of full SPH.

    Returns
    -------
    dict
        One entry a contender, as `dataset.VARIABLES` describes it: contender, contender_…,
        integrator, n_freeze, cpu_seconds, reconstruction_seconds, {field}_error_full,
        {field}_error_exact and offline_seconds.
    """
    buffers = timing.Buffers()
    offline = _offline(scene, sampling, taken, repeats)
    contenders = [*_full_models(scene), *_reduced_models(scene, study, taken)]
    for contender in contenders:
        buffers.shared(contender.run)
    reconstructed = np.zeros((2, scene.error_times.size, scene.particle_count))
    references: dict[int, Arrays] = {}
    errors = np.full((2, 2, len(contenders)), np.nan)
    numbers = []
    for n, contender in enumerate(contenders):
        numbers.append(timing.warm_up(contender.run.run, SHORTEST))
        count = contender.scene.particle_count
        if count not in references:
            references[count] = _reference(contender.scene)
        for f, (field, values) in enumerate(lifted.with_density(contender.run).items()):
            if count == scene.particle_count:
                errors[0, f, n] = relative_error(values, full[field])
            errors[1, f, n] = relative_error(values, references[count][field])
    runs = [contender.run.run for contender in contenders]
    reconstructions = [partial(_reconstruct, c.run, reconstructed) for c in contenders]
    return {
        "contender": np.array([c.method for c in contenders]),
        "integrator": np.array([c.integrator for c in contenders]),
        "contender_mode_count": np.array([c.modes for c in contenders]),
        "contender_modes_resolved": np.array([c.resolved for c in contenders]),
        "n_freeze": np.array([c.n_freeze for c in contenders]),
        "contender_particle_count": np.array([c.scene.particle_count for c in contenders]),
        "contender_time_step": np.array([c.time_step for c in contenders]),
        "contender_tolerance": np.array([c.tolerance for c in contenders]),
        "cpu_seconds": timing.measure(runs, repeats, numbers),
        "reconstruction_seconds": timing.measure(reconstructions, repeats),
        **{
            f"{field}_error_{against}": errors[a, f]
            for a, against in enumerate(("full", "exact"))
            for f, field in enumerate(FIELDS)
        },
        "offline_seconds": np.array(
            [
                [*(offline(c.method) if c.modes else (0, 0)), c.projection_seconds]
                for c in contenders
            ]
        ),
    }


def _reconstruct(run, fields):
    """The fields of a reduced model; a full one keeps them."""
    if isinstance(run, ReducedRun):
        for (coordinates, modes), field in zip(run.expansions().values(), fields, strict=True):
            np.matmul(coordinates, modes, out=field)


def _reference(scene):
    """The exact solution, or, where none is known, centred differences done properly."""
    if exact.kind(scene) is not None:
        return exact.solve(scene)
    return reference.solve_centred(scene, estimate_error=False)


def _offline(scene, sampling, taken, repeats):
    """CPU times [s] of the snapshots, and of their modes for a method."""
    steps = np.union1d(*snapshots.sampling_steps(scene, sampling))
    run = sph.prepare(scene, steps, "stencil").run()
    seconds = timing.measure(
        [run.run, lambda: pod.decompose(taken), lambda: lifted_rom.decompose(scene, taken)], repeats
    )
    of_snapshots, euclidean, energy = np.median(seconds, axis=1)
    return lambda method: (of_snapshots, energy if method.startswith("lifted") else euclidean)


def _timed(prepare, *arguments):
    """What a preparation gives, and its CPU time [s]; it has run before."""
    prepare(*arguments)
    start = time.process_time()
    result = prepare(*arguments)
    return result, time.process_time() - start


# --- Full models ----------------------------------------------------------------------------------


def _full_models(scene: Scene) -> Iterator[Contender]:
    """The scene's own discretisation first, then others."""
    yield _sph(scene, "lists")
    for factor in (1, *EULER_STEPS):
        if finer := _with(scene, 1, factor):
            yield _sph(finer, "stencil")
            yield _lifted_full(finer, "explicit_euler")
    intervals = [scene.error_interval / n for n in (1, 2, 5, 10)]
    largest = 2 / waves.fastest_wave(scene)
    for integrator in ("symplectic_euler", "leapfrog"):
        for step in {*intervals, scene.time_step}:
            if step < largest:
                yield _lifted_full(replace(scene, time_step=step), integrator)
    for integrator, tolerances in TOLERANCES.items():
        for tolerance in tolerances:
            yield _lifted_full(scene, integrator, tolerance)
    yield _lifted_full(scene, "exact")
    for factor in SPACINGS:
        if other := _with(scene, factor, factor):
            yield _sph(other, "stencil")
            yield _lifted_full(other, "leapfrog")


def _with(scene, spacing, step):
    """The scene with other multiples of its spacing and time step; None if it cannot be run."""
    count = round(scene.particle_count / spacing)
    stride = max(1, round(scene.error_stride / step))
    other = replace(scene, particle_count=count, time_step=scene.error_interval / stride)
    if step > 1 and other.time_step <= scene.time_step:
        return None
    usable = count >= 5 and waves.growth_factor(other) <= waves.GROWTH_LIMIT
    return other if usable else None


def _sph(scene, neighbours):
    run = sph.prepare(scene, scene.error_steps, neighbours)
    name = {"lists": "sph_neighbour_lists", "stencil": "sph_stencil"}[neighbours]
    return Contender(name, "explicit_euler", run)


def _lifted_full(scene, integrator, tolerance=np.nan):
    run = lifted.prepare(scene, integrator, tolerance=tolerance)
    kind = "exact" if integrator == "exact" else "stencil"
    return Contender(f"lifted_full_{kind}", integrator, run, tolerance=tolerance)


# --- Reduced models -------------------------------------------------------------------------------


def _reduced_models(scene, study, taken) -> Iterator[Contender]:
    modes = pod.decompose(taken)
    available = max(len(modes["velocity_modes"]), len(modes["density_modes"]))
    counts = sorted({*study["mode_counts"], *(k for k in MODE_COUNTS if k <= available)})
    for method in acceleration_contenders(study["n_freeze"]):
        for count in counts:
            yield _paper_model(scene, method, count, modes)
    energy_modes = lifted_rom.decompose(scene, taken)
    for method in lifted_rom.METHODS:
        for count in counts:
            yield _lifted_model(scene, method, count, energy_modes)


def _paper_model(scene, method, count, modes):
    run, seconds = _timed(galerkin(scene, method, modes, count).prepare, scene.error_steps)
    return Contender(
        method,
        "explicit_euler",
        run,
        count,
        freeze_steps(method),
        projection_seconds=seconds,
        resolved=bool(modes_resolved(modes, [count])[0]),
    )


def _lifted_model(scene, method, count, modes):
    run, seconds = _timed(lambda: lifted_rom.build(scene, modes, count).prepare(method))
    return Contender(
        method,
        {"lifted_euler": "repeats explicit_euler", "lifted_exact": "exact"}[method],
        run,
        count,
        projection_seconds=seconds,
        resolved=bool(lifted_rom.modes_resolved(modes, [count])[0]),
    )


def rows(place: Mapping[str, str], measured: Arrays, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Columns of the benchmark's table, a row a contender.

    Speed-ups are ratios of medians: against full SPH with neighbour lists and with one stencil;
    against the fastest explicit Euler full model with the scene's particles and time step, in
    density or strain; and against the fastest full model of all whose errors against the exact
    solution are not above those of full SPH.
    """
    lower, median, upper = np.quantile(measured["cpu_seconds"], (0.25, 0.5, 0.75), axis=1)
    both = measured["cpu_seconds"] + measured["reconstruction_seconds"]
    offline = measured["offline_seconds"]
    baselines = {name: median[row] for name, row in _baselines(measured, median).items()}
    return {
        **place,
        "method": measured["contender"],
        "modes": measured["contender_mode_count"],
        "modes_resolved": measured["contender_modes_resolved"].astype(bool),
        "n_freeze": measured["n_freeze"],
        "integrator": measured["integrator"],
        "particle_count": measured["contender_particle_count"],
        "time_step": measured["contender_time_step"],
        "tolerance": measured["contender_tolerance"],
        "error_velocity": measured["velocity_error_full"],
        "error_density": measured["density_error_full"],
        "error_velocity_exact": measured["velocity_error_exact"],
        "error_density_exact": measured["density_error_exact"],
        "cpu_seconds": median,
        "cpu_seconds_interquartile_range": upper - lower,
        "cpu_seconds_with_fields": np.median(both, axis=1),
        "repeats": measured["cpu_seconds"].shape[1],
        "offline_snapshots_seconds": offline[:, 0],
        "offline_modes_seconds": offline[:, 1],
        "offline_projection_seconds": offline[:, 2],
        **{f"speedup_against_{name}": base / median for name, base in baselines.items()},
        "machine": settings["machine"]["processor"],
    }


def _baselines(measured, median):
    """Rows of the models that speed-ups are relative to."""
    methods, integrators = measured["contender"], measured["integrator"]
    own = {name: int(np.flatnonzero(methods == name)[0]) for name in BASELINES}
    first = own["sph_stencil"]
    alike = (
        (integrators == "explicit_euler")
        & (measured["contender_mode_count"] == 0)
        & (measured["contender_particle_count"] == measured["contender_particle_count"][first])
        & (measured["contender_time_step"] == measured["contender_time_step"][first])
    )
    accurate = measured["contender_mode_count"] == 0
    for field in FIELDS:
        errors = measured[f"{field}_error_exact"]
        # Neighbour lists and stencil, density and strain differ by less than this.
        accurate &= errors <= 1.001 * errors[first]
    return own | {
        "fastest_explicit_euler": int(np.argmin(np.where(alike, median, np.inf))),
        "fastest_full_model": int(np.argmin(np.where(accurate, median, np.inf))),
    }


STUDY = Study(
    target="benchmarks",
    datasets={
        "benchmark": Dataset(
            compute="studies.benchmark.compare",
            message="{scene}: run time against error of every method, snapshots {sampling}",
            of_sampling=True,
            reads={"taken": "snapshots.nc", "full": "../sph.nc"},
            arguments={
                "sampling": "sampling",
                "study": "acceleration",
                "repeats": "benchmark.repeats",
            },
            alone=True,
            places=accelerated,
        )
    },
    tables={"benchmark": ("studies.benchmark.rows", "benchmark")},
    drawing=Drawing(
        draw="figures.benchmark_plots.work_precision",
        caption="CPU time against error, all methods, mode counts and integrators: {scene},"
        " snapshots {sampling}.",
        reads={"benchmark": ("benchmark",)},
        places=accelerated,
    ),
)
