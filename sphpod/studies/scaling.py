"""How the cost of a step grows with the particles and with the modes.

A scene is run with more and more particles, its time step shrinking with the spacing, and reduced
on waves instead of POD modes, which would take snapshots of every size: what a step costs does not
depend on which modes they are. For a lifted model a step is a jump from output to output.
"""

import tracemalloc
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from sphpod.full import lifted, sph
from sphpod.numerics import timing
from sphpod.numerics.error import Arrays
from sphpod.reduced import lifted_rom
from sphpod.reduced.rom import ReducedModel
from sphpod.reference import exact
from sphpod.scene.scene import Scene
from sphpod.studies.study import Dataset, Drawing, Study, step_scene

WORK = 2e7
"""Products that a timed run takes, about, which decides how many steps it has."""

JUMPS = 10_000
"""Outputs of a lifted model in a timed run."""

MODE_COUNT = 12
"""k of the reduced models of which N is varied."""

CONTENDERS = ("sph_neighbour_lists", "sph_stencil", "lifted_full_stencil")
REDUCED = ("original", "frozen10", "lifted_exact")

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Run = Callable[[], object]


def measure(
    scene: Scene, particle_counts: Sequence[int], mode_counts: Sequence[int], repeats: int
) -> dict[str, np.ndarray]:
    """Time and memory of a step, of full and reduced models.

    Parameters
    ----------
    particle_counts : ints
        N of full models, and of reduced ones with `MODE_COUNT` modes.
    mode_counts : ints
        k of reduced models of the scene's own particles.

    Returns
    -------
    dict
        One entry a model: contender, contender_particle_count, contender_mode_count (0 for full
        models), memory_bytes that the prepared time loop holds [B]; step_seconds
        (contenders, repeats) [s].
    """
    places = [(name, count, 0) for count in particle_counts for name in CONTENDERS]
    places += [(name, count, MODE_COUNT) for count in particle_counts for name in REDUCED]
    others = (k for k in mode_counts if k != MODE_COUNT or scene.particle_count not in
              particle_counts)  # fmt: skip
    places += [(name, scene.particle_count, k) for k in others for name in REDUCED]
    runs, steps, memory = [], [], []
    for name, count, modes in places:
        sized = _with_particles(scene, count)
        # Values that are kept of the scene, whoever prepares it, are not the loop's.
        _prepare(sized, name, modes)
        tracemalloc.start()
        run, step_count = _prepare(sized, name, modes)
        memory.append(tracemalloc.get_traced_memory()[0])
        tracemalloc.stop()
        run()
        runs.append(run)
        steps.append([step_count])
    return {
        "contender": np.array([name for name, _, _ in places]),
        "contender_particle_count": np.array([count for _, count, _ in places]),
        "contender_mode_count": np.array([modes for _, _, modes in places]),
        "memory_bytes": np.array(memory),
        "step_seconds": timing.measure(runs, repeats) / np.array(steps),
    }


def _with_particles(scene, count):
    return replace(
        scene, particle_count=count, time_step=scene.time_step * scene.particle_count / count
    )


def _for_steps(scene, steps):
    """The scene, so short that it has so many steps and keeps its last state alone."""
    duration = steps * scene.time_step
    return replace(scene, duration=duration, error_interval=duration)


def _prepare(scene: Scene, name: str, modes: int) -> tuple[Run, int]:
    """A run of a model, and its number of steps; nothing is held but what the run needs."""
    count = scene.particle_count
    if name == "lifted_exact":
        return _jumps(scene, modes), JUMPS
    if modes:
        work = 4 * modes * count if name == "original" else 4 * modes**2 + 4 * modes**4 / 10
        steps = 10 * max(1, int(WORK / work / 10))
        rows = waves(count, modes)
        run = ReducedModel(scene, name, rows, rows).prepare(np.array([0, steps]))
        return partial(run.march, run.state), steps
    steps = max(2, int(WORK / 10 / count))
    if name == "lifted_full_stencil":
        full = lifted.prepare(_for_steps(scene, steps), "explicit_euler")
    else:
        kind = "lists" if name == "sph_neighbour_lists" else "stencil"
        full = sph.prepare(scene, np.array([0, steps]), kind)
    return partial(full.march, *full.state, True), steps


def _jumps(scene, modes):
    scene = replace(scene, duration=1.0, error_interval=1.0 / JUMPS, time_step=1.0 / JUMPS)
    rows = waves(scene.particle_count, modes)
    run = lifted_rom.LiftedModel(scene, rows, rows[1:], 1).prepare("lifted_exact")
    (state,) = run.state
    state[:, 0] = run.begun
    return partial(run.jumps.run, state)


def waves(particle_count: int, mode_count: int) -> np.ndarray:
    """The constant, then sines and cosines of rising harmonics, orthonormal, one a row."""
    return np.array(list(_waves(particle_count, mode_count)))


def _waves(count: int, modes: int) -> Iterator[np.ndarray]:
    x = 2 * np.pi * np.arange(count) / count
    for mode in range(modes):
        harmonic = (mode + 1) // 2
        row = np.sin(harmonic * x) if mode % 2 else np.cos(harmonic * x)
        yield row / np.linalg.norm(row)


def draw(scalings: Mapping[tuple[str, ...], Arrays]) -> "Figure":
    """Draw what `measure` gives of the one place, the scene whose steps are timed."""
    from sphpod.figures import benchmark_plots

    (scaling,) = scalings.values()
    return benchmark_plots.scaling(scaling)


def is_plain(scene: Scene) -> bool:
    """Whether a scene lacks all that a scene may lack: damping, force, and material that varies."""
    return exact.kind(scene) == "dalembert" and not scene.forces


PLAIN = is_plain, "without damping, force or layers"
"""What a scene may lack is left out of one that lacks it all."""

STUDY = Study(
    target="benchmarks",
    datasets={
        "scaling": Dataset(
            compute="studies.scaling.measure",
            message="{scene}: time and memory of a step against particles and modes",
            arguments={
                "particle_counts": "benchmark.particle_counts",
                "mode_counts": "benchmark.mode_counts",
                "repeats": "benchmark.repeats",
            },
            needs=PLAIN,
            alone=True,
            places=step_scene,
        )
    },
    drawing=Drawing(
        draw="studies.scaling.draw",
        caption="Time and memory of a step against particles and modes, full and reduced models.",
        reads={"scalings": ("scaling",)},
    ),
)
