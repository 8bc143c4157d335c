"""CPU time of a step of full SPH, compiled and as a plain loop over sparse products."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from sphpod.full import sph
from sphpod.numerics import timing
from sphpod.numerics.error import Arrays
from sphpod.scene.scene import Scene, derivative_matrix
from sphpod.studies.study import Dataset, Study, step_scene


def compare(scene: Scene, repeats: int, step_count: int = 2000) -> dict[str, np.ndarray]:
    """CPU time of one explicit Euler step of full SPH, compiled and as a scipy.sparse loop.

    Returns
    -------
    dict
        contender (sph_sparse_loop, sph_neighbour_lists, sph_stencil); step_seconds
        (contenders, repeats), CPU time of a step [s], from runs of ``step_count`` steps.
    """
    steps = np.array([0, step_count])
    runs: dict[str, Callable[[], object]] = {
        "sph_sparse_loop": lambda: sparse_loop(scene, step_count),
        "sph_neighbour_lists": sph.prepare(scene, steps, "lists").run,
        "sph_stencil": sph.prepare(scene, steps, "stencil").run,
    }
    for run in runs.values():
        run()
    return {
        "contender": np.array(list(runs)),
        "step_seconds": timing.measure(list(runs.values()), repeats) / step_count,
    }


def rows(place: Mapping[str, str], measured: Arrays, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Median time of a step [s], its spread, and how many times as fast as a sparse loop it is."""
    lower, median, upper = np.quantile(measured["step_seconds"], (0.25, 0.5, 0.75), axis=1)
    loop = median[list(measured["contender"]).index("sph_sparse_loop")]
    return {
        "scene": place["scene"],
        "particle_count": settings["particle_count"],
        "contender": measured["contender"],
        "step_seconds_median": median,
        "step_seconds_interquartile_range": upper - lower,
        "repeats": measured["step_seconds"].shape[1],
        "speedup_against_sph_sparse_loop": loop / median,
        "machine": settings["machine"]["processor"],
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
    amplitudes, profiles = scene.force_of_steps(step_count)
    for step in range(step_count):
        rate = -(gradient @ (modulus * (1 - density0 / density))) / density0
        if damping.size:
            rate -= damping * velocity
        if amplitudes.size:
            rate += amplitudes[:, step] @ profiles
        density = density - dt * density**2 / density0 * (gradient @ velocity)
        velocity = velocity + dt * rate
    return velocity, density


STUDY = Study(
    target="all",
    datasets={
        "step_time": Dataset(
            compute="studies.step_time.compare",
            message="{scene}: CPU time of a step of full SPH",
            arguments={"repeats": "benchmark.repeats"},
            alone=True,
            places=step_scene,
        )
    },
    tables={"step_time": ("studies.step_time.rows", "step_time")},
)
