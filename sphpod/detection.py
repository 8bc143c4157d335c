"""What it costs full models to watch for a breakdown at every output.

Each is run twice in turns, watching and not, otherwise by the same code; the median of the ratios
turn by turn is what watching costs, as a drift of the machine's speed meets both of a turn alike.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from sphpod import lifted, sph, timing
from sphpod.scene import Scene

ALLOWED = 0.02
"""Part of a full model's time that watching may take."""

SHORTEST = 0.02
"""Seconds that a timed run lasts at least."""

OUTPUTS = 1000
"""Outputs of a run at most: what watching takes is the same part of a longer one."""

TURNS = 5
"""How many turns are taken for one repeat: what watching takes is a small part of a run."""


def measure(scene: Scene, repeats: int) -> dict[str, np.ndarray]:
    """CPU time of full models, watching for a breakdown and not.

    Parameters
    ----------
    scene : Scene
        Of evenly spaced particles.
    repeats : int

    Returns
    -------
    dict
        contender, integrator (contenders,); cpu_seconds and unwatched_seconds
        (contenders, turns) [s].
    """
    outputs = min(OUTPUTS, scene.error_times.size - 1)
    scene = replace(scene, duration=outputs * scene.error_interval)
    kept = np.zeros((2, scene.error_times.size, scene.particle_count))
    models = [("sph_neighbour_lists", "explicit_euler"), ("sph_stencil", "explicit_euler")]
    models += [("lifted_full", integrator) for integrator in _integrators(scene)]
    runs = []
    for name, integrator in models:
        for watch in (True, False):
            if name == "lifted_full":
                run = lifted.prepare(scene, integrator, watch=watch)
            else:
                neighbours = "lists" if name == "sph_neighbour_lists" else "stencil"
                run = sph.prepare(scene, scene.error_steps, neighbours, watch=watch)
            runs.append(lambda run=run: run(*kept))
    numbers = [timing.warm_up(run, SHORTEST) for run in runs]
    # Both of a pair are run equally often.
    numbers = [max(pair) for pair in zip(numbers[::2], numbers[1::2], strict=True) for _ in pair]
    seconds = timing.measure(runs, TURNS * repeats, numbers)
    return {
        "contender": np.array([name for name, _ in models]),
        "integrator": np.array([integrator for _, integrator in models]),
        "cpu_seconds": seconds[::2],
        "unwatched_seconds": seconds[1::2],
    }


def _integrators(scene):
    """Those that compiled loops or fast transforms step; scipy's take far longer than watching."""
    return [*lifted.FIXED_STEP, *(["exact"] if lifted.is_uniform(scene) else [])]


def rows(place: Mapping[str, Any], measured: Mapping[str, np.ndarray]) -> Iterator[dict[str, Any]]:
    """Part of each model's time that watching takes, median and quartiles, a row a model.

    Parameters
    ----------
    place : dict
        scene, and what else is the same in all rows.
    measured : dict
        As from `measure`.
    """
    for n, name in enumerate(measured["contender"]):
        watched, unwatched = measured["cpu_seconds"][n], measured["unwatched_seconds"][n]
        lower, median, upper = np.quantile(watched / unwatched - 1, (0.25, 0.5, 0.75))
        yield {
            **place,
            "model": str(name),
            "integrator": str(measured["integrator"][n]),
            "cpu_seconds": float(np.median(watched)),
            "part_for_watching": float(median),
            "interquartile_range": float(upper - lower),
            "allowed": ALLOWED,
        }
