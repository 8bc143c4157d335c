"""What a scene holds in memory and on disk, and how long full SPH takes, before anything runs."""

from collections.abc import Iterator, Mapping
from math import prod
from typing import Any, NamedTuple

from sphpod.config.mode_counts import mode_limit
from sphpod.config.reading import refusal
from sphpod.reduced.snapshots import is_of_run
from sphpod.scene.scene import Scene
from sphpod.surveys.samples import points

NUMBER = 8
"""Bytes of a number."""

FIELDS_TOGETHER = 5
"""Fields of solutions that the largest job holds: those of two, and what it makes of them."""

SNAPSHOTS_TOGETHER = 6
"""Sets of snapshots that a decomposition holds, with its factors and what it measures of them."""

FORCE_OF_STEP = 24, 192
"""Bytes that a step with a force takes in full SPH, and on the four times finer grid beside it."""

OF_QUERY = 4
"""Numbers of a query beside its parameters and quantities, about."""

COPIES = 2
"""How often the job that puts the answers of chunks together holds them."""

STEP = 1.6e-9
"""Time that full SPH takes for a step of a particle, about [s]."""


class Size(NamedTuple):
    """Memory that a key asks for [bytes], and of what."""

    key: str
    value: Any
    memory: float
    what: str


def output_count(scene: Scene) -> int:
    """Times at which solutions of a scene are kept, but for those of snapshots alone."""
    return scene.step_count // max(scene.error_stride, 1) + 1


def disk(scene: Scene, solutions: int) -> float:
    """Bytes of so many solutions on disk, uncompressed."""
    return 2.0 * solutions * output_count(scene) * scene.bar_count * NUMBER


def run_time(scene: Scene) -> float:
    """About how long full SPH takes [s]."""
    return STEP * scene.step_count * scene.particle_count


def sizes(scene: Scene, settings: Mapping[str, Any]) -> Iterator[Size]:
    """What grows with the numbers of a scene.

    Parameters
    ----------
    scene : Scene
    settings : dict
        Its block of the configuration.
    """
    count, outputs = scene.particle_count, output_count(scene)
    yield Size(
        "error_interval",
        scene.error_interval,
        float(FIELDS_TOGETHER) * outputs * count * NUMBER,
        f"{outputs} outputs of {count} particles",
    )
    if scene.forces:
        steps = scene.step_count
        refined = settings.get("references") != ["exact"]
        yield Size(
            "time_step",
            scene.time_step,
            float(FORCE_OF_STEP[refined]) * steps,
            f"the force in {steps} time steps",
        )
    for name, sampling in settings.get("samplings", {}).items():
        if not is_of_run(sampling):
            continue
        taken = mode_limit({**settings, "particle_count": scene.step_count + 1}, name)
        yield Size(
            f"samplings.{name}",
            {key: value for key, value in sampling.items() if key in ("range", "count")},
            float(SNAPSHOTS_TOGETHER) * taken * count * NUMBER,
            f"{taken} snapshots of {count} particles",
        )


def answers(survey: Mapping[str, Any], scene: Mapping[str, Any]) -> float:
    """Bytes of the answers of a survey, uncompressed: each quantity with both ends of its interval.

    Parameters
    ----------
    survey, scene : dict
        Their resolved blocks of the configuration.
    """
    queries, ranges = survey["queries"], scene["parameters"]
    if "count" in queries:
        count = float(queries["count"])
    else:
        count = prod(map(float, queries.get("grid", {}).values()))
        count = float(len(points(ranges, queries))) if "from" in queries else count
    outputs = round(scene["duration"] / survey["output_interval"]) + 1
    numbers = [
        3 * outputs if one["kind"] == "history" else 3 for one in survey["quantities"].values()
    ]
    return NUMBER * count * (len(ranges) + OF_QUERY + sum(numbers))


def check_answers(
    name: str, survey: Mapping[str, Any], scene: Mapping[str, Any], memory: float
) -> None:
    """Refuse a survey whose answers together would take more memory than is allowed.

    Raises
    ------
    ConfigError
    """
    taken = COPIES * answers(survey, scene) / 1e9
    if taken > memory:
        raise refusal(
            None,
            f"surveys.{name}.queries",
            survey["queries"],
            f"their answers take {taken:.3g} GB; at most {memory:g} GB are allowed, which the key "
            "memory can change; fewer queries or histories, or a longer output_interval, take less",
        )


def check_sizes(scene: Scene, settings: Mapping[str, Any], memory: float) -> None:
    """Refuse a scene of which a job would take more memory than is allowed.

    Parameters
    ----------
    scene, settings
        As in `sizes`.
    memory : float
        In GB, as the configuration has it.

    Raises
    ------
    ConfigError
    """
    for size in sizes(scene, settings):
        if size.memory > memory * 1e9:
            raise refusal(
                scene.name,
                size.key,
                size.value,
                f"{size.what} take {size.memory / 1e9:.3g} GB; at most {memory:g} GB are allowed, "
                "which the key memory can change",
            )
