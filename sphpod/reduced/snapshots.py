"""When snapshots are taken, and taking them out of a full SPH solution."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from sphpod.numerics.error import FIELDS
from sphpod.scene.scene import Scene, whole_steps


def sampling_steps(scene: Scene, sampling: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Time steps at which a sampling takes velocity and density snapshots.

    Uniform samplings divide their range into as many parts as there are snapshots, the right end
    excluded; a seed makes them distinct random steps of the range instead. Times are rounded to
    the nearest step; an end of the range that is a whole number of steps but for rounding is one.

    Parameters
    ----------
    scene : Scene
    sampling : dict
        ``range`` and ``count``, with a ``seed`` for random steps; or ``velocity_times`` and
        ``density_times``.

    Returns
    -------
    velocity_steps, density_steps : int64 arrays, ascending
    """
    dt = scene.time_step
    if "velocity_times" in sampling:
        velocity_steps, density_steps = (
            np.sort(np.rint(np.array(sampling[f"{field}_times"], float) / dt)).astype(np.int64)
            for field in FIELDS
        )
        return velocity_steps, density_steps
    start, end = (whole_steps(time, dt) for time in sampling["range"])
    count = sampling["count"]
    if "seed" in sampling:
        first, last = int(np.ceil(start)), int(np.floor(end))
        choice = np.random.default_rng(sampling["seed"]).choice(last - first, count, replace=False)
        steps = np.sort(first + choice)
    else:
        steps = np.rint(start + np.arange(count) * (end - start) / count).astype(np.int64)
    return steps, steps


def output_steps(scene: Scene, samplings: Iterable[Mapping[str, Any]]) -> np.ndarray:
    """Time steps that a full solution must keep: the error integral's and every sampling's.

    Returns
    -------
    int64 array, ascending, each step once
    """
    wanted = [scene.error_steps]
    for sampling in samplings:
        wanted.extend(sampling_steps(scene, sampling))
    return np.unique(np.concatenate(wanted))


def extract(
    scene: Scene, sampling: Mapping[str, Any], solution: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Take the snapshots of a sampling out of a full solution.

    Parameters
    ----------
    scene : Scene
    sampling : dict
        As in ``sampling_steps``.
    solution : dict
        t (times,) [s], x (N,) [m], velocity and density (times, N).

    Returns
    -------
    dict
        x (N,), velocity_time (n,), velocity_snapshots (n, N), density_time (m,),
        density_snapshots (m, N).

    Raises
    ------
    ValueError
        The solution was not kept at one of the sampling's steps.
    """
    kept = np.rint(solution["t"] / scene.time_step).astype(np.int64)
    arrays = {"x": solution["x"]}
    for field, steps in zip(FIELDS, sampling_steps(scene, sampling), strict=True):
        rows = np.searchsorted(kept, steps)
        if np.any(rows == kept.size) or np.any(kept[rows] != steps):
            raise ValueError(f"scene {scene.name}: full SPH was not kept at every {field} snapshot")
        arrays[f"{field}_time"] = solution["t"][rows]
        arrays[f"{field}_snapshots"] = solution[field][rows]
    return arrays
