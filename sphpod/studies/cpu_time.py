"""CPU time of full SPH and of the paper's reduced models, at the times of the error integral."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from sphpod.full import sph
from sphpod.numerics import timing
from sphpod.reduced.rom import acceleration_contenders, freeze_steps, galerkin
from sphpod.scene.run import Run
from sphpod.scene.scene import Scene
from sphpod.studies.study import Dataset, Study, accelerated

BASELINES = ("sph_neighbour_lists", "sph_stencil")
"""Full SPH that savings are relative to: as an SPH code does it, and for even spacing alone."""


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
    prepared: list[tuple[str, int, Callable[..., Run]]] = [
        ("sph_neighbour_lists", 0, lambda steps: sph.prepare(scene, steps, "lists")),
        ("sph_stencil", 0, lambda steps: sph.prepare(scene, steps, "stencil")),
    ]
    for count in mode_counts:
        for method in acceleration_contenders(n_freeze):
            prepared.append((method, count, galerkin(scene, method, modes, count).prepare))
    buffers, runs = timing.Buffers(), []
    for _, _, prepare in prepared:
        prepare(steps[:2]).run()
        runs.append(buffers.shared(prepare(steps)).run)
    names = [name for name, _, _ in prepared]
    return {
        "contender": np.array(names),
        "contender_mode_count": np.array([count for _, count, _ in prepared]),
        "n_freeze": np.array(
            [0 if name.startswith("sph") else freeze_steps(name) for name in names]
        ),
        "cpu_seconds": timing.measure(runs, repeats),
    }


def rows(
    place: Mapping[str, str], measured: Mapping[str, np.ndarray], settings: Mapping[str, Any]
) -> dict[str, Any]:
    """Median CPU time of each contender, its spread, and what it saves against each baseline.

    Returns
    -------
    dict
        The columns: place, contender, mode_count, n_freeze, cpu_seconds_median,
        cpu_seconds_interquartile_range [s], repeats, machine, and
        saving_against_sph_neighbour_lists, saving_against_sph_stencil: the part of the baseline's
        time that the contender does not take, negative if it takes more; each (contenders,).
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
