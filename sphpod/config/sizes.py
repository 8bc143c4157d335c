"""What a scene holds in memory and on disk, and how long full SPH takes, before anything runs."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

from sphpod.config.mode_counts import mode_limit
from sphpod.config.reading import refusal
from sphpod.config.scene_section import MOST_TIME_STEPS
from sphpod.reduced.snapshots import is_of_run
from sphpod.scene import checks
from sphpod.scene.scene import Scene

NUMBER = 8
"""Bytes of a number."""

FIELDS_TOGETHER = 5
"""Fields of solutions that the largest job holds: those of two, and what it makes of them."""

SNAPSHOTS_TOGETHER = 6
"""Sets of snapshots that a decomposition holds, with its factors and what it measures of them."""

RUN_FIELDS_TOGETHER = 8
"""Fields of all training runs of a survey that their modes are made with."""

ROWS_TOGETHER = 2
"""Times that the job of all queries holds them."""

IN_ROW = 5
"""Numbers of a query beside its parameters and quantities."""

FORCE_OF_STEP = 24, 192
"""Bytes that a step with a force takes in full SPH, and on the four times finer grid beside it."""

PRODUCT_OF_STEP = 8, 116
"""The same of each further product of a function of t and one of x in it, or in a coefficient."""

STEP = 1.6e-9
"""Time that full SPH takes for a step of a particle, about [s]."""


LARGEST_COUNTS = {"time_step": MOST_TIME_STEPS, "error_interval": 10**6}
"""How often a key may fit in the duration."""


class Size(NamedTuple):
    """Memory that a key asks for [bytes], and of what."""

    key: str
    value: Any
    memory: float
    what: str


def check_counts(name: str, settings: Mapping[str, Any]) -> None:
    """Refuse a duration that is no measure, and what fits in it not once, or too often.

    Parameters
    ----------
    settings : dict
        Block of a scene in the configuration.

    Raises
    ------
    ConfigError
    """
    duration = settings["duration"]
    low, high = checks.MEASURES
    if not low <= duration <= high:
        allowed = f"it must be a positive number from {low:g} to {high:g}"
        raise refusal(name, "duration", duration, allowed)
    for key, largest in LARGEST_COUNTS.items():
        if settings[key] > duration:
            allowed = f"it must be at most the duration, T = {checks.number(duration)}"
            raise refusal(name, key, settings[key], allowed)
        if duration / settings[key] > largest:
            allowed = (
                f"at least T/{largest:g} = {duration / largest:g} is needed with the duration "
                f"T = {checks.number(duration)}"
            )
            raise refusal(name, key, settings[key], allowed)


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
    refined = settings.get("references") != ["exact"]
    steps, first, further = scene.step_count, FORCE_OF_STEP[refined], PRODUCT_OF_STEP[refined]
    for what, functions in scene.in_time.items():
        products = sum(scene.product_count(function) for function in functions)
        of_step = float(first + further * (products - 1))
        of = f", of {products} functions of t," if products > 1 else ""
        held = f"the {what}{of} in {steps} time steps"
        yield Size("time_step", scene.time_step, of_step * steps, held)
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


def answers(survey: Mapping[str, Any], parameters: int, queries: int, outputs: int) -> float:
    """Bytes of the answers of a survey: each quantity with both ends of its interval."""
    kinds = [quantity["kind"] for quantity in survey["quantities"].values()]
    curves = kinds.count("history")
    numbers = parameters + IN_ROW + 3 * (len(kinds) - curves + outputs * curves)
    return float(NUMBER) * queries * numbers


def survey_sizes(
    key: str, scene: Scene, survey: Mapping[str, Any], parameters: int, queries: int
) -> Iterator[Size]:
    """What grows with the numbers of a survey.

    Parameters
    ----------
    key : str
        Of its block of the configuration.
    scene : Scene
        With outputs where those of the survey are.
    survey : dict
    parameters, queries : int
        How many there are.
    """
    outputs, count = output_count(scene), scene.particle_count
    run = float(outputs) * count * NUMBER
    yield Size(
        f"{key}.output_interval",
        scene.error_interval,
        FIELDS_TOGETHER * run,
        f"{outputs} outputs of {count} particles",
    )
    runs = survey["training"]["count"]
    yield Size(
        f"{key}.training.count", runs, RUN_FIELDS_TOGETHER * runs * run, f"{runs} training runs"
    )
    kinds = [quantity["kind"] for quantity in survey["quantities"].values()]
    scalars = len(kinds) - kinds.count("history")
    yield Size(
        f"{key}.queries",
        survey["queries"],
        ROWS_TOGETHER * answers(survey, parameters, queries, outputs),
        f"the answers of {queries} queries",
    )
    sampled = survey["sobol_samples"] * (parameters + 2)
    yield Size(
        f"{key}.sobol_samples",
        survey["sobol_samples"],
        float(ROWS_TOGETHER) * sampled * NUMBER * (parameters + IN_ROW + 3 * scalars),
        f"the {sampled} queries of Sobol indices",
    )


def check_sizes(scene: str | None, sizes: Iterable[Size], memory: float) -> None:
    """Refuse what a job would need more memory for than is allowed.

    Parameters
    ----------
    scene : str or None
        In whose block of the configuration the keys are, if in one.
    sizes : iterable of Size
    memory : float
        In GB, as the configuration has it.

    Raises
    ------
    ConfigError
    """
    for size in sizes:
        if size.memory > memory * 1e9:
            raise refusal(
                scene,
                size.key,
                size.value,
                f"{size.what} take {size.memory / 1e9:.3g} GB; at most {memory:g} GB are allowed, "
                "which the key memory can change",
            )
