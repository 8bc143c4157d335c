"""What is computed must not depend on the machine: on its BLAS threads or its processor cores.

The same computation runs in processes of their own, which start with other numbers of threads and
on other cores, as both are settled when numpy is loaded. Full models are compiled, and sum in one
order. Threads of BLAS share out a singular value decomposition and so round it differently, by a
part of the first singular value: that is what a mode of a small one would differ by, many times
over.
"""

import multiprocessing
import os
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from sphpod.full import lifted, sph
from sphpod.numerics.error import FIELDS, Arrays
from sphpod.pipeline.dataset import meanings
from sphpod.reduced import lifted_rom, pod
from sphpod.scene.scene import Scene
from sphpod.studies.study import Dataset, Study, has_snapshots

LIMIT = 1e-12
"""Largest relative difference that is allowed between machines."""

SMALLEST = 1e-10
"""Singular value, of the first, from which on a mode is compared."""

INTERVALS = 10
"""Outputs after the start, at most, at which fields are compared."""

Result = TypeVar("Result")

THREAD_SETTINGS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def compare(scene: Scene, taken: Arrays) -> dict[str, np.ndarray]:
    """Differences between one BLAS thread and as many as cores, and between one core and all.

    Parameters
    ----------
    taken : dict
        x (N,), velocity_snapshots (n, N), density_snapshots (m, N).

    Returns
    -------
    dict
        quantity, thread_difference, core_difference, each (quantities,): the largest difference of
        any value, of the largest value. Without a way to choose cores, that of cores is NaN.
    """
    cores = available_cores()
    threads = max(2, len(cores))
    work = compute, scene, dict(taken)
    many, single = run_on(threads, cores, *work), run_on(1, cores, *work)
    lonely = run_on(threads, cores[:1], *work) if cores else None
    return {
        "quantity": np.array(list(many)),
        "thread_difference": np.array([_difference(many[name], single[name]) for name in many]),
        "core_difference": np.array(
            [_difference(many[name], lonely[name]) if lonely else np.nan for name in many]
        ),
    }


def rows(place: Mapping[str, Any], arrays: Arrays) -> Iterator[dict[str, Any]]:
    """The quantities of a scene, a row each, with a verdict."""
    names = ("quantity", "thread_difference", "core_difference")
    for quantity, threads, cores in zip(*(arrays[name] for name in names), strict=True):
        depends = threads > LIMIT or cores > LIMIT
        yield {
            **place,
            "quantity": str(quantity),
            "thread_difference": float(threads),
            "core_difference": float(cores),
            "limit": LIMIT,
            "verdict": "depends on the machine" if depends else "independent",
        }


def compute(scene: Scene, taken: Arrays) -> dict[str, list[np.ndarray]]:
    """Fields of every full model at a few outputs, and modes of the snapshots.

    Parameters are those of `compare`.
    """
    scene = seldom_shown(scene, INTERVALS)
    runs = {
        f"full SPH, {neighbours}": sph.prepare(scene, scene.error_steps, neighbours)
        for neighbours in ("stencil", "lists")
        if scene.is_even or neighbours == "lists"
    } | {
        f"lifted full, {integrator}": lifted.prepare(scene, integrator)
        for integrator in lifted.INTEGRATORS
    }
    results = {}
    for name, run in runs.items():
        # A model that breaks down does so on every machine, and leaves zeros behind.
        for field in run.state:
            field[:] = 0
        results[name] = list(run.run().state)
    modes = pod.decompose(taken) | lifted_rom.decompose(scene, taken)
    for name in (*FIELDS, "scaled_velocity", "scaled_strain"):
        values = modes[f"{name}_singular_values"]
        kept = values >= SMALLEST * values.max(initial=0)
        results[f"{name.replace('_', ' ')} modes"] = [modes[f"{name}_modes"][kept]]
    return results


def run_on(threads: int, cores: list[int], function: Callable[..., Result], *given: Any) -> Result:
    """A function's result in a process with so many BLAS threads, on these cores if any are."""
    with _settings(threads, cores):
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(1, context) as pool:
            return pool.submit(function, *given).result()


def available_cores() -> list[int]:
    """Cores that this process may run on; none where the platform does not let it choose."""
    return sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_setaffinity") else []


@contextmanager
def _settings(threads, cores):
    """Threads and cores that a process started here is born with."""
    before = {name: os.environ.get(name) for name in THREAD_SETTINGS}
    mine = available_cores()
    os.environ.update(dict.fromkeys(THREAD_SETTINGS, str(threads)))
    if cores:
        os.sched_setaffinity(0, cores)
    try:
        yield
    finally:
        if cores:
            os.sched_setaffinity(0, mine)
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value


def seldom_shown(scene: Scene, most: int) -> Scene:
    """The scene with so many outputs after the start, at most."""
    intervals = scene.error_times.size - 1
    kept = next(n for n in range(min(most, intervals), 0, -1) if intervals % n == 0)
    return replace(scene, error_interval=scene.duration / kept)


def _difference(first, second):
    """Largest difference of any array's values, of its largest; infinite if shapes differ."""
    largest = 0.0
    for one, other in zip(first, second, strict=True):
        if one.shape != other.shape:
            return np.inf
        size = np.abs(one).max(initial=0) or 1.0
        largest = max(largest, np.abs(one - other).max(initial=0) / size)
    return largest


STUDY = Study(
    datasets={
        "machine": Dataset(
            compute="studies.machine.compare",
            message="{scene}: the same on one thread and core as on more, snapshots {sampling}",
            of_sampling=True,
            reads={"taken": "snapshots.nc"},
            alone=True,
            places=lambda config: dict.fromkeys(
                place
                for study in ("poor_snapshots", "amplitude", "stability_map")
                for place in config["stability"][study].items()
                if has_snapshots(config, place)
            ),
        )
    },
    tables={"machine": ("studies.machine.rows", "machine")},
    variables=meanings(
        """
        quantity (quantity_index): what is computed on different machines
        thread_difference (quantity_index) [1]: largest difference between one BLAS thread and more,
            relative
        core_difference (quantity_index) [1]: largest difference between one core and more, relative
        """
    ),
)
