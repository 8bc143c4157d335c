"""This project: full SPH, the paper's reduced models, and the lifted models."""

from collections.abc import Iterator

import numpy as np

from benchmarks.peers.contender import CONVERGED, EULER, LIFTED_EULER, Check, Contender, Model
from benchmarks.peers.problem import MODES, Problem
from sphpod.full import lifted, sph
from sphpod.reduced import lifted_rom, pod
from sphpod.reduced.rom import galerkin


def contenders(problem: Problem) -> Iterator[Contender]:
    """Full models in density and in strain, and reduced ones of 12 modes.

    Those in strain always run over all of T.
    """
    euler = f"explicit Euler, Δt = {problem.scene.time_step:g} s"

    def full(name, neighbours):
        return Contender("sphpod", name, euler, lambda: _full(problem, neighbours), check=EULER)

    yield full("full SPH, one stencil", "stencil")
    yield full("full SPH, neighbour lists", "lists")
    for method, name in (("original", "POD-Galerkin"), ("frozen10", "POD-Galerkin, frozen10")):
        yield Contender(
            "sphpod", name, euler, lambda method=method: _reduced(problem, method), MODES
        )

    def lifted_full(name, integrator, check, **settings):
        return Contender(
            "sphpod",
            "full SPH in strain",
            name,
            lambda: _lifted_full(problem, integrator, **settings),
            check=check,
        )

    interval = problem.scene.error_interval
    yield lifted_full(euler, "explicit_euler", LIFTED_EULER)
    yield lifted_full(f"leapfrog, Δt = {interval:g} s", "leapfrog", CONVERGED, time_step=interval)
    yield lifted_full("DOP853, tolerance 1e-6", "dop853", CONVERGED, tolerance=1e-6)
    yield lifted_full("exact, Fourier modes", "exact", Check("exact_in_time", 1e-10))
    for method, name in (("lifted_euler", euler), ("lifted_exact", "exact")):
        yield Contender(
            "sphpod",
            f"energy POD-Galerkin in strain, {method}",
            f"{name}, one jump to each output",
            lambda method=method: _lifted_reduced(problem, method),
            MODES,
        )


def _touched(run):
    """The run, its arrays written to, so that it is not the first to do so."""
    for array in run.state:
        array[:] = np.nan
    return run


def _full(problem, neighbours):
    scene = problem.scene

    def prepare(intervals):
        run = _touched(sph.prepare(scene, scene.error_steps[: intervals + 1], neighbours))
        return lambda: run.run().state[0]

    return Model(prepare, np.asarray, scene.step_count)


def _reduced(problem, method):
    modes = pod.decompose(problem.snapshots("half a period"))
    model = galerkin(problem.scene, method, modes, MODES)
    steps = problem.scene.error_steps

    def prepare(intervals):
        run = _touched(model.prepare(steps[: intervals + 1]))
        return lambda: run.run().state[0]

    return Model(prepare, lambda states: states @ model.velocity_modes, problem.scene.step_count)


def _lifted_full(problem, integrator, **settings):
    scene = problem.scene
    run = _touched(lifted.prepare(scene, integrator, **settings))
    step = settings.get("time_step", scene.time_step)
    stepped = integrator in lifted.FIXED_STEP
    return Model(
        lambda intervals: lambda: run.run().state[0],
        np.asarray,
        round(scene.duration / step) if stepped else None,
    )


def _lifted_reduced(problem, method):
    scene = problem.scene
    modes = lifted_rom.decompose(scene, problem.snapshots("half a period"))
    run = lifted_rom.build(scene, modes, MODES).prepare(method)
    return Model(lambda intervals: run.run, lambda run: run.fields()["velocity"])
