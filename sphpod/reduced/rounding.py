"""What rounding makes of snapshots, measured by a twin run.

Processors round differently: some fuse a multiplication with an addition, and each sums a scalar
product in an order of its own. Full SPH carries such differences on from step to step. How far is
seen in a run that starts one unit in the last place beside: its snapshots differ by what those of
another processor differ by, within a small factor (docs/reproducing-the-paper.md).
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from sphpod.full import sph
from sphpod.numerics.error import FIELDS, Arrays
from sphpod.reduced.snapshots import extract, sampling_steps
from sphpod.scene.scene import Scene


def sampled(scene: Scene, sampling: Mapping[str, Any], solution: Arrays) -> dict[str, np.ndarray]:
    """Snapshots of full SPH, and the same of a run that starts one unit in the last place beside.

    Parameters and arrays are those of `snapshots.extract`, with a solution at all its times, and
    of `twins`.
    """
    return extract(scene, sampling, solution) | twins(scene, sampling)


def twins(scene: Scene, sampling: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Snapshots of full SPH that starts one unit in the last place beside.

    Parameters
    ----------
    sampling : dict
        As in `snapshots.sampling_steps`.

    Returns
    -------
    dict
        velocity_twins (n, N) [m/s], density_twins (m, N) [kg/m³].

    Raises
    ------
    Breakdown
        The twin broke down.
    """
    steps = np.unique(np.concatenate([[0], *sampling_steps(scene, sampling)]))
    taken = extract(scene, sampling, sph.solve(scene, steps, start=beside(scene)))
    return {f"{field}_twins": taken[f"{field}_snapshots"] for field in FIELDS}


def beside(scene: Scene) -> sph.State:
    """Initial velocity (N,) [m/s] and density (N,) [kg/m³], one of them off by its last place."""
    velocity, density = scene.velocity0(), scene.starting_density()
    # Errors in the density at the start are larger than those that steps from it make, so it is
    # left alone unless there is no velocity to change.
    if velocity.any():
        return in_last_place(velocity), density
    return velocity, in_last_place(density)


def in_last_place(values: np.ndarray) -> np.ndarray:
    """Values changed by one unit in the last place, up or down at random; always the same way."""
    signs = np.random.default_rng(0).choice((-1, 1), np.shape(values))
    return np.nextafter(values, np.where(values == 0, 0, signs * np.inf))
