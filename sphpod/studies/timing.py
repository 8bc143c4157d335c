"""CPU time of full and reduced models, measured so that they can be compared.

All contenders run in one process that has the machine to itself, with one BLAS thread. Each is
compiled and warmed up by a few steps first, then they take turns, so that a drift of the machine's
speed meets all of them alike. The time is the process's own, of the time loop with its outputs
alone: what precedes it (projection, neighbours, compilation) is not in it.
"""

import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from sphpod.full import sph
from sphpod.numerics.error import FIELDS
from sphpod.reduced.rom import ReducedModel, acceleration_contenders, freeze_steps
from sphpod.scene.scene import Scene, derivative_matrix

BASELINES = ("sph_neighbour_lists", "sph_stencil")
"""Full SPH that savings are relative to: as an SPH code does it, and for even spacing alone."""

Run = Callable[[np.ndarray, np.ndarray], object]


def compare(
    scene: Scene,
    modes: Mapping[str, np.ndarray],
    mode_counts: Sequence[int],
    n_freeze: Sequence[int],
    repeats: int,
) -> dict[str, np.ndarray]:
    """CPU time of full SPH, with neighbour lists and with one stencil, and of the reduced models.

    Parameters
    ----------
    scene : Scene
    modes : dict
        velocity_modes, density_modes (one a row).
    mode_counts, n_freeze : ints
        Modes for velocity and density each, or all there are; numbers of frozen steps.
    repeats : int

    Returns
    -------
    dict
        contender, contender_mode_count (0 for full models), n_freeze (0 where nothing is frozen),
        each of shape (contenders,); cpu_seconds (contenders, repeats) [s].
    """
    steps = scene.error_steps
    prepared: list[tuple[str, int, Callable[[np.ndarray], Run]]] = [
        ("sph_neighbour_lists", 0, lambda steps: sph.prepare(scene, steps, "lists")),
        ("sph_stencil", 0, lambda steps: sph.prepare(scene, steps, "stencil")),
    ]
    shapes = {0: (scene.particle_count, scene.particle_count)}
    for count in mode_counts:
        chosen = modes["velocity_modes"][:count], modes["density_modes"][:count]
        shapes[count] = len(chosen[0]), len(chosen[1])
        for method in acceleration_contenders(n_freeze):
            prepared.append((method, count, ReducedModel(scene, method, *chosen).prepare))
    # Filled, so that no run is the first to touch its memory.
    kept = {
        count: tuple(np.full((steps.size, size), np.nan) for size in pair)
        for count, pair in shapes.items()
    }
    for _, count, prepare in prepared:
        prepare(steps[:2])(*(fields[:2] for fields in kept[count]))
    names = [name for name, _, _ in prepared]
    return {
        "contender": np.array(names),
        "contender_mode_count": np.array([count for _, count, _ in prepared]),
        "n_freeze": np.array(
            [0 if name.startswith("sph") else freeze_steps(name) for name in names]
        ),
        "cpu_seconds": measure(
            [_call(prepare(steps), *kept[count]) for _, count, prepare in prepared], repeats
        ),
    }


def savings(measured: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Median CPU time of each contender, its spread, and what it saves against each baseline.

    Parameters
    ----------
    measured : dict
        As from ``compare``.

    Returns
    -------
    dict
        cpu_seconds_median, cpu_seconds_interquartile_range [s], repeats, and
        saving_against_sph_neighbour_lists, saving_against_sph_stencil: the part of the baseline's
        time that the contender does not take, negative if it takes more; each (contenders,).
    """
    lower, median, upper = np.quantile(measured["cpu_seconds"], (0.25, 0.5, 0.75), axis=1)
    names = list(measured["contender"])
    return {
        "cpu_seconds_median": median,
        "cpu_seconds_interquartile_range": upper - lower,
        "repeats": np.full(len(names), measured["cpu_seconds"].shape[1]),
    } | {f"saving_against_{base}": 1 - median / median[names.index(base)] for base in BASELINES}


def benchmark_columns(measured: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """Columns of the benchmark's table, a row a contender.

    Speed-ups are ratios of medians: against full SPH with neighbour lists and with one stencil;
    against the fastest explicit Euler full model with the scene's particles and time step, in
    density or strain; and against the fastest full model of all whose errors against the exact
    solution are not above those of full SPH.

    Parameters
    ----------
    measured : dict
        As from `benchmark.compare`.
    """
    lower, median, upper = np.quantile(measured["cpu_seconds"], (0.25, 0.5, 0.75), axis=1)
    both = measured["cpu_seconds"] + measured["reconstruction_seconds"]
    offline = measured["offline_seconds"]
    baselines = {name: median[row] for name, row in _baselines(measured, median).items()}
    return {
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


def skipping_columns(measured: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """Median times without and with what a scene may lack, their spread, and the median ratio.

    The ratio is taken turn by turn, so that it does not drift with the machine's speed.

    Parameters
    ----------
    measured : dict
        As from `skipping.measure`.
    """
    columns: dict[str, Any] = {
        "skipped": measured["skipped"],
        "model": measured["skipping_model"],
    }
    for name in ("skipping_seconds", "general_seconds"):
        lower, median, upper = np.quantile(measured[name], (0.25, 0.5, 0.75), axis=1)
        columns |= {name: median, f"{name}_interquartile_range": upper - lower}
    ratio = measured["general_seconds"] / measured["skipping_seconds"]
    return columns | {"general_over_skipping": np.median(ratio, axis=1)}


def compare_steps(scene: Scene, repeats: int, step_count: int = 2000) -> dict[str, np.ndarray]:
    """CPU time of one explicit Euler step of full SPH, compiled and as a scipy.sparse loop.

    Returns
    -------
    dict
        contender (sph_sparse_loop, sph_neighbour_lists, sph_stencil); step_seconds
        (contenders, repeats), CPU time of a step [s], from runs of ``step_count`` steps.
    """
    steps = np.array([0, step_count])
    kept = np.empty((2, 2, scene.particle_count))
    runs: dict[str, Callable[[], object]] = {
        "sph_sparse_loop": lambda: sparse_loop(scene, step_count),
        "sph_neighbour_lists": _call(sph.prepare(scene, steps, "lists"), *kept),
        "sph_stencil": _call(sph.prepare(scene, steps, "stencil"), *kept),
    }
    for run in runs.values():
        run()
    return {
        "contender": np.array(list(runs)),
        "step_seconds": measure(list(runs.values()), repeats) / step_count,
    }


def speedups(measured: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Median time of a step [s], its spread, and how many times faster than the sparse loop it is.

    Parameters
    ----------
    measured : dict
        As from ``compare_steps``.

    Returns
    -------
    dict
        step_seconds_median, step_seconds_interquartile_range, repeats,
        speedup_against_sph_sparse_loop; each (contenders,).
    """
    lower, median, upper = np.quantile(measured["step_seconds"], (0.25, 0.5, 0.75), axis=1)
    loop = median[list(measured["contender"]).index("sph_sparse_loop")]
    return {
        "step_seconds_median": median,
        "step_seconds_interquartile_range": upper - lower,
        "repeats": np.full(median.size, measured["step_seconds"].shape[1]),
        "speedup_against_sph_sparse_loop": loop / median,
    }


def sparse_loop(scene: Scene, step_count: int) -> tuple[np.ndarray, np.ndarray]:
    """Explicit Euler of full SPH as a plain loop over scipy.sparse products, to compare with.

    Returns
    -------
    velocity, density : arrays, shape (N,)
        After ``step_count`` steps.
    """
    gradient = derivative_matrix(scene)
    velocity, density = scene.velocity0(), scene.density0()
    density0, modulus, dt = density.copy(), scene.modulus(), scene.time_step
    damping = scene.damping_values()
    amplitude, profile = scene.force_of_steps(step_count)
    for step in range(step_count):
        rate = -(gradient @ (modulus * (1 - density0 / density))) / density0
        if damping.size:
            rate -= damping * velocity
        if amplitude.size:
            rate += amplitude[step] * profile
        density = density - dt * density**2 / density0 * (gradient @ velocity)
        velocity = velocity + dt * rate
    return velocity, density


def warm_up(run: Callable[[], object], shortest: float) -> int:
    """Warm a run, and say how often it is to be run for a time of ``shortest`` seconds."""
    for _ in range(2):
        start = time.process_time()
        run()
        seconds = time.process_time() - start
        if seconds > 10 * shortest:
            break
    return 1 + int(shortest / max(seconds, 1e-6))


def measure(
    runs: Sequence[Callable[[], object]], repeats: int, numbers: Sequence[int] = ()
) -> np.ndarray:
    """Process time [s] of each run, taken in turns; they are to be warm.

    Parameters
    ----------
    runs : callables
    repeats : int
    numbers : ints, optional
        How often each is run for one time, of which the mean is taken; once if not given.

    Returns
    -------
    array, shape (runs, repeats)
    """
    seconds = np.empty((len(runs), repeats))
    with threadpool_limits(limits=1):
        for repeat in range(repeats):
            for n, (run, number) in enumerate(zip(runs, numbers or [1] * len(runs), strict=True)):
                start = time.process_time()
                for _ in range(number):
                    run()
                seconds[n, repeat] = (time.process_time() - start) / number
    return seconds


def machine() -> dict[str, Any]:
    """What the times were measured on: processor, cores, system, and versions of what computes."""
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "numpy": version("numpy"),
        "numba": version("numba"),
        "blas_threads": 1,
    }


def _processor() -> str:
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            names = [line.partition(":")[2].strip() for line in file if "model name" in line]
        return names[0]
    except (OSError, IndexError):
        return platform.processor() or "unknown"


def _call(run: Run, velocity: np.ndarray, density: np.ndarray) -> Callable[[], object]:
    return lambda: run(velocity, density)
