"""When snapshots are taken, and taking them out of a full SPH solution."""

import os
import zlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sphpod.numerics.error import FIELDS, Arrays
from sphpod.scene.scene import Scene, whole_steps


def sampling_steps(scene: Scene, sampling: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Time steps at which a sampling takes velocity and density snapshots.

    Uniform samplings divide their range into as many parts as there are snapshots, the right end
    excluded; a seed makes them distinct random steps of the range instead. Times are rounded to
    the nearest step; an end of the range that is a whole number of steps but for rounding is one.

    Parameters
    ----------
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


def is_of_run(sampling: Mapping[str, Any]) -> bool:
    """Whether a sampling takes snapshots of its scene's run; else they are a file's or others'."""
    return not {"from", "modes"} & set(sampling)


def output_steps(scene: Scene, samplings: Iterable[Mapping[str, Any]]) -> np.ndarray:
    """Time steps that a full solution must keep: the error integral's and every sampling's.

    Returns
    -------
    int64 array, ascending, each step once
    """
    wanted = [scene.error_steps]
    for sampling in samplings:
        if is_of_run(sampling):
            wanted.extend(sampling_steps(scene, sampling))
    return np.unique(np.concatenate(wanted))


def extract(scene: Scene, sampling: Mapping[str, Any], solution: Arrays) -> dict[str, np.ndarray]:
    """Take the snapshots of a sampling out of a full solution.

    Parameters
    ----------
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


def described(scene: Scene, path: str) -> dict[str, Any]:
    """What is kept of a file of snapshots of one's own: how many, and a checksum of all its bytes.

    Raises
    ------
    ValueError
        As `own`.
    """
    found = own(scene, {"from": path})
    return {
        "counts": [len(found[f"{field}_snapshots"]) for field in FIELDS],
        "checksum": f"{zlib.crc32(Path(path).read_bytes()):08x}",
    }


def own(scene: Scene, sampling: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Snapshots of a NetCDF file of one's own, taken in place of those of full SPH.

    Parameters
    ----------
    sampling : dict
        ``from``, the file: velocity_snapshots (n, N) [m/s] and density_snapshots (m, N) [kg/m³]
        with velocity_time (n,) and density_time (m,) [s]; or velocity and density (n, N) with t.

    Returns
    -------
    dict
        As from `extract`.

    Raises
    ------
    ValueError
        There is no such file, it lacks one of these, or holds others: of other particles, not
        finite, or of a density that is not positive; the message is the end of a sentence.
    """
    import netCDF4

    path = sampling["from"]
    if not os.path.isfile(path):
        raise ValueError("there is no such file")
    try:
        file = netCDF4.Dataset(path)
    except OSError:
        raise ValueError("there is no NetCDF file") from None
    arrays = {"x": scene.positions}
    with file:
        for field in FIELDS:
            names = (f"{field}_snapshots", f"{field}_time")
            if names[0] not in file.variables:
                names = (field, "t")
            if missing := [name for name in names if name not in file.variables]:
                raise ValueError(f"it holds {', '.join(file.variables)}, but not {missing[0]}")
            values, times = (np.ma.filled(file[name][...].astype(float), np.nan) for name in names)
            if values.shape != (times.size, scene.bar_count) or not times.size:
                raise ValueError(
                    f"{names[0]} is of shape {values.shape}; needed is one row for each of the "
                    f"{times.size} values of {names[1]} and a column for each of the "
                    f"{scene.bar_count} particles"
                )
            if not np.isfinite(values).all() or (field == "density" and values.min() <= 0):
                kind = "finite and positive" if field == "density" else "finite"
                raise ValueError(f"{names[0]} must be {kind} everywhere")
            arrays |= {f"{field}_time": times, f"{field}_snapshots": values}
    return arrays
