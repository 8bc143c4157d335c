"""CPU time of full SPH and of the paper's reduced models, at the times of the error integral."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sphpod.full import sph
from sphpod.numerics import timing
from sphpod.numerics.error import Arrays
from sphpod.reduced.rom import acceleration_contenders, freeze_steps, galerkin
from sphpod.scene.scene import Scene
from sphpod.studies.study import Dataset, Study, accelerated

BASELINES = {"sph_neighbour_lists": "lists", "sph_stencil": "stencil"}
"""Full SPH that savings are relative to, as an SPH code does it and for even spacing alone, with
the neighbours that it takes."""


PLACES = 2
"""How often a process places the arrays of each contender, and runs it there."""


def compare(
    scene: Scene, modes: Arrays, mode_counts: Sequence[int], n_freeze: Sequence[int], repeats: int
) -> dict[str, np.ndarray]:
    """CPU time of full SPH, with neighbour lists and with one stencil, and of the reduced models.

    Parameters
    ----------
    modes : dict
        velocity_modes, density_modes (one a row).
    mode_counts, n_freeze : ints
        Modes for velocity and density each, or all there are; numbers of frozen steps.
    repeats : int
        Processes that time all of it.

    Returns
    -------
    dict
        contender, contender_mode_count, n_freeze and cpu_seconds, as `dataset.VARIABLES` describes
        them; each turn with arrays in other places.
    """
    contenders = [(baseline, 0) for baseline in BASELINES]
    contenders += [(name, k) for k in mode_counts for name in acceleration_contenders(n_freeze)]
    bases = {name: modes[name] for name in ("velocity_modes", "density_modes")}
    processes = [(scene, bases, contenders, process) for process in range(repeats)]
    names, counts = zip(*contenders, strict=True)
    return {
        "contender": np.array(names),
        "contender_mode_count": np.array(counts),
        "n_freeze": np.array([0 if name in BASELINES else freeze_steps(name) for name in names]),
        "cpu_seconds": np.hstack(timing.elsewhere(turns, processes)),
    }


def turns(
    scene: Scene, modes: Arrays, contenders: Sequence[tuple[str, int]], process: int
) -> np.ndarray:
    """CPU time [s] of contenders (name, mode count) in one process, (contenders, `PLACES`)."""

    def prepare(name, count, steps):
        if name in BASELINES:
            return sph.prepare(scene, steps, BASELINES[name])
        return galerkin(scene, name, modes, count).prepare(steps)

    steps = scene.error_steps
    for name, count in contenders:
        prepare(name, count, steps[:2]).run()
    buffers, seconds = timing.Buffers(), []
    for place in range(PLACES):
        held = timing.displaced(process * PLACES + place)
        runs = [buffers.shared(prepare(name, count, steps)).run for name, count in contenders]
        seconds.append(timing.measure(runs, repeats=1))
        del held
    return np.hstack(seconds)


def rows(place: Mapping[str, str], measured: Arrays, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Median CPU time of each contender, its spread, and what it saves against each baseline.

    That is the part of the baseline's time that it does not take, negative if it takes more.
    """
    lower, median, upper = np.quantile(measured["cpu_seconds"], (0.25, 0.5, 0.75), axis=1)
    names = list(measured["contender"])
    return {
        **place,
        "contender": measured["contender"],
        "mode_count": measured["contender_mode_count"],
        "n_freeze": measured["n_freeze"],
        "cpu_seconds_median": median,
        "cpu_seconds_interquartile_range": upper - lower,
        "repeats": measured["cpu_seconds"].shape[1],
        **{f"saving_against_{base}": 1 - median / median[names.index(base)] for base in BASELINES},
        "machine": settings["machine"]["processor"],
    }


STUDY = Study(
    target="all",
    datasets={
        "cpu_time": Dataset(
            compute="studies.cpu_time.compare",
            message="{scene}: CPU times, snapshots {sampling}",
            of_sampling=True,
            reads={"modes": "pod.nc"},
            arguments={
                "n_freeze": "acceleration.n_freeze",
                "mode_counts": "acceleration.mode_counts",
                "repeats": "benchmark.repeats",
            },
            alone=True,
            places=accelerated,
        )
    },
    tables={"cpu_time": ("studies.cpu_time.rows", "cpu_time")},
)
