"""What it costs full models to watch for a breakdown.

Each is run twice in turns, watching and not, otherwise by the same code on the same arrays; the
median of the ratios turn by turn is what watching costs, as a drift of the machine's speed meets
both of a turn alike. Where arrays lie in memory is felt more than watching, and in some places by
one of the two alone; so the turns are spread over several places.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from sphpod.full import lifted, sph
from sphpod.numerics import timing
from sphpod.numerics.error import Arrays
from sphpod.pipeline.dataset import meanings
from sphpod.scene.scene import Scene
from sphpod.studies.study import EVEN, Dataset, Study, scenes

ALLOWED = 0.02
"""Part of a full model's time that watching may take."""

OUTPUTS = 1000
"""Outputs of a run at most: what watching takes is the same part of a longer one."""

PLACES = 8
"""Places in memory that models are prepared in, each for as many turns as there are repeats."""


def measure(scene: Scene, repeats: int) -> dict[str, np.ndarray]:
    """CPU time of full models, watching for a breakdown and not.

    Parameters
    ----------
    scene : Scene
        Of evenly spaced particles.

    Returns
    -------
    dict
        contender, integrator (contenders,); cpu_seconds and unwatched_seconds
        (contenders, turns) [s].
    """
    outputs = min(OUTPUTS, scene.error_times.size - 1)
    scene = replace(scene, duration=outputs * scene.error_interval)
    models = [("sph_neighbour_lists", "explicit_euler"), ("sph_stencil", "explicit_euler")]
    models += [("lifted_full", integrator) for integrator in _integrators(scene)]
    shape = 2, scene.error_times.size, scene.particle_count
    store, spacers, measured = np.zeros(np.prod(shape) + 512 * PLACES), [], []
    for place in range(PLACES):
        # 37 doubles are no multiple of a cache line.
        first = 37 * place
        kept = store[first : first + np.prod(shape)].reshape(shape)
        runs = []
        for name, integrator in models:
            spacers.append(np.zeros(first + 1))
            march = _prepare(scene, name, integrator).march
            runs += [partial(march, *kept, watch) for watch in _order(place)]
        numbers = [timing.warm_up(run) for run in runs]
        # Both of a pair are run equally often.
        pairs = zip(numbers[::2], numbers[1::2], strict=True)
        numbers = [max(pair) for pair in pairs for _ in pair]
        seconds = timing.measure(runs, repeats, numbers).reshape(len(models), 2, repeats)
        measured.append(seconds if _order(place)[0] else seconds[:, ::-1])
    watched, unwatched = np.concatenate(measured, axis=2).transpose(1, 0, 2)
    return {
        "contender": np.array([name for name, _ in models]),
        "integrator": np.array([integrator for _, integrator in models]),
        "cpu_seconds": watched,
        "unwatched_seconds": unwatched,
    }


def _order(place):
    """Who of a pair comes first, and finds the cache filled by another model."""
    return (True, False) if place % 2 == 0 else (False, True)


def _prepare(scene, name, integrator):
    if name == "lifted_full":
        return lifted.prepare(scene, integrator)
    neighbours = "lists" if name == "sph_neighbour_lists" else "stencil"
    return sph.prepare(scene, scene.error_steps, neighbours)


def _integrators(scene):
    """Those that compiled loops or fast transforms step; scipy's take far longer than watching."""
    return [*lifted.FIXED_STEP, *(["exact"] if lifted.is_uniform(scene) else [])]


def rows(place: Mapping[str, Any], measured: Arrays) -> Iterator[dict[str, Any]]:
    """Part of each model's time that watching takes, median and quartiles, a row a model."""
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
            "verdict": "within" if median <= ALLOWED else "above",
        }


STUDY = Study(
    datasets={
        "detection": Dataset(
            compute="studies.detection.measure",
            message="{scene}: what it costs to watch for a breakdown",
            arguments={"repeats": "benchmark.repeats"},
            needs=EVEN,
            alone=True,
            places=partial(scenes, needs=EVEN),
        )
    },
    tables={"detection": ("studies.detection.rows", "detection")},
    variables=meanings(
        """
        unwatched_seconds (contender_index, repeat) [s]: CPU time of a model that looks for no
            breakdown
        """
    ),
)
