"""Surveys of parameters: their keys, and what these mean together."""

import ast
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag

from sphpod.config.fields import LARGEST_SEED, ModeCount, Name, ParameterName, Section, left_out
from sphpod.config.reading import refusal
from sphpod.config.scene_section import Parameter, Time
from sphpod.numerics.expressions import Expression, reads
from sphpod.scene import checks
from sphpod.scene.scene import PROFILES, Scene, is_whole
from sphpod.surveys import samples

LARGEST_COUNT = 10**7
"""Queries that a survey may have, so that a slip of the pen does not fill the disk."""

OUTPUTS = 100
"""Intervals between the outputs of a survey that says nothing else."""

TAKEN = (
    *("t", "relative_bound", "relative_estimate", "certified", "reason", "query"),
    *("true_error", "effectivity", "inside", "quantity", "parameter"),
    *(f"{kind}_index{end}" for kind in ("first", "total") for end in ("", "_low", "_high")),
    *("velocity_modes", "stress_modes", "translation", "mode_count", "training_points"),
)
"""Names in the results of a survey."""

TAKEN_FROM_PARAMETERS = (*TAKEN, "velocity", "strain", "point", "extrapolate")
"""Names that no parameter of a survey has: those, of its training runs, and of calls to it."""

CHECKED = 64
"""Points within the ranges at which the scene is checked, beside their corners."""


class Training(Section):
    """Runs of the full model that the modes of a survey are made of."""

    count: int = Field(16, ge=1, le=10000, description="number of runs, default 16")
    method: Literal["sobol", "greedy"] = Field(
        "sobol",
        description="where they are: at a Sobol set of the ranges, or greedy: each at the largest "
        "bound of those before, until the bound meets the tolerance; default sobol",
    )
    seed: int = Field(0, ge=0, le=LARGEST_SEED, description="seed of the Sobol set, default 0")


class DrawnQueries(Section):
    """Queries drawn from the ranges."""

    count: int = Field(ge=1, le=LARGEST_COUNT, description="number of queries")
    sampling: Literal["sobol", "halton", "latin_hypercube", "uniform"] = Field(
        "sobol", description="how they are drawn, default sobol"
    )
    seed: int = Field(0, ge=0, le=LARGEST_SEED, description="seed of the draw, default 0")


class GridQueries(Section):
    """Queries on a grid of the ranges."""

    grid: dict[ParameterName, Annotated[int, Field(ge=1, le=LARGEST_COUNT)]] = Field(
        min_length=1,
        description="number of values of each parameter, ends included; what is not there has its "
        "nominal value",
    )


class TableQueries(Section):
    """Queries of one's own."""

    from_: str = Field(alias="from", description="CSV with a column for each parameter")


def _way_to_query(keys):
    if not isinstance(keys, dict):
        return None
    return next((f"<{key}>" for key in ("grid", "from") if key in keys), "<count>")


AnyQueries = Annotated[
    Annotated[DrawnQueries, Tag("<count>")]
    | Annotated[GridQueries, Tag("<grid>")]
    | Annotated[TableQueries, Tag("<from>")],
    Discriminator(_way_to_query),
    Field(
        description="given by count (with sampling and seed), by grid or by from (a CSV of one's "
        "own)"
    ),
]

SurveyField = Literal["velocity", "strain", "stress"]
WHAT_IS_ASKED = (
    "what is asked: history (a field at a place at all outputs), value (at one "
    "time), maximum (of the field's magnitude over time), energy, energy_loss (since the start), "
    "passage (first time at which the field's magnitude reaches a level)"
)
FIELD_ASKED = "field that is asked for"
PLACE_ASKED = "where, from 0 to below L [m]; the nearest particle"
TIME_ASKED = "when [s], a whole number of output intervals"


class Quantity(Section):
    """What all quantities have."""


class Placed(Quantity):
    """What quantities of a field have."""

    field: SurveyField = Field("velocity", description=f"{FIELD_ASKED}, default velocity")
    place: float = Field(ge=0, description=PLACE_ASKED)
    width: float = left_out(
        gt=0, description="width of a sensor [m], which takes the mean; one particle if left out"
    )


class History(Placed):
    """A field at a place over time."""

    kind: Literal["history"] = Field(description=WHAT_IS_ASKED)


class Value(Placed):
    """A field at a place and a time."""

    kind: Literal["value"] = Field(description=WHAT_IS_ASKED)
    time: Time = left_out(description=f"{TIME_ASKED}, default T")


class Maximum(Placed):
    """The largest magnitude of a field at a place over time."""

    kind: Literal["maximum"] = Field(description=WHAT_IS_ASKED)


class Passage(Placed):
    """The first time at which the magnitude of a field at a place reaches a level."""

    kind: Literal["passage"] = Field(description=WHAT_IS_ASKED)
    level: float = Field(gt=0, description="the level, in the unit of the field")


class Energy(Quantity):
    """The energy at a time."""

    kind: Literal["energy"] = Field(description=WHAT_IS_ASKED)
    time: Time = left_out(description=f"{TIME_ASKED}, default T")


class EnergyLoss(Quantity):
    """The energy lost since the start."""

    kind: Literal["energy_loss"] = Field(description=WHAT_IS_ASKED)
    time: Time = left_out(description=f"{TIME_ASKED}, default T")


AnyQuantity = Annotated[
    History | Value | Maximum | Passage | Energy | EnergyLoss,
    Field(discriminator="kind", description="one quantity of a survey"),
]


class Survey(Section):
    """Queries of one scene at many values of its parameters."""

    scene: str = Field(description="name of a scene that has parameters")
    training: Training = left_out(description="runs of the full model that modes are made of")
    mode_count: ModeCount = left_out(
        description="velocity modes; if left out, as few as meet the tolerance at the training runs"
    )
    tolerance: float = Field(
        1e-2,
        gt=0,
        description="largest relative error (energy norm, largest over time) that a query may have "
        "to be certified, default 1e-2",
    )
    queries: AnyQueries
    quantities: dict[Name, AnyQuantity] = Field(
        min_length=1, description="what is asked of each query, by name"
    )
    output_interval: float = left_out(
        gt=0,
        description="distance of the times at which training runs are kept and quantities given "
        "[s], a whole number of time steps, default T/100 or else the error interval",
    )
    chunk_size: int = Field(
        10_000, ge=1, le=LARGEST_COUNT, description="queries of one job, default 10000"
    )
    validation: int = Field(
        8, ge=0, le=10000, description="queries that are also solved in full, default 8"
    )
    sobol_samples: int = Field(
        256,
        ge=0,
        le=2**20,
        description="base samples of the Sobol indices, a power of two, each of which is a query "
        "for each parameter and two more; 0 for none, default 256",
    )


def resolved_surveys(
    surveys: Mapping[str, Any], scenes: Mapping[str, Any]
) -> dict[str, dict[str, Any]]:
    """Check surveys and the parameters of all scenes, and fill in the defaults of both.

    Raises
    ------
    ConfigError
    """
    for name, scene in scenes.items():
        if "parameters" in scene:
            scene["parameters"] = {
                parameter: Parameter.default_keys() | given
                for parameter, given in scene["parameters"].items()
            }
            _check_parameters(name, scene)
    return {name: _resolved(name, survey, scenes) for name, survey in surveys.items()}


def _resolved(name, survey, scenes):
    key = f"surveys.{name}"
    if survey["scene"] not in scenes:
        allowed = f"there is no such scene; allowed are {', '.join(scenes)}"
        raise refusal(None, f"{key}.scene", survey["scene"], allowed)
    settings = scenes[survey["scene"]]
    if "parameters" not in settings:
        having = ", ".join(one for one, scene in scenes.items() if "parameters" in scene)
        others = f"those that have are {having}" if having else "no scene has any"
        allowed = f"it has no parameters; {others}"
        raise refusal(None, f"{key}.scene", survey["scene"], allowed)
    resolved = {
        **Survey.default_keys(),
        **survey,
        "training": Training.default_keys() | survey.get("training", {}),
    }
    if "count" in survey["queries"]:
        resolved["queries"] = DrawnQueries.default_keys() | survey["queries"]
    if resolved["sobol_samples"] & (resolved["sobol_samples"] - 1):
        allowed = "it must be a power of two, or 0"
        raise refusal(None, f"{key}.sobol_samples", resolved["sobol_samples"], allowed)
    for word, given in settings["parameters"].items():
        if word in TAKEN_FROM_PARAMETERS:
            others = ", ".join(TAKEN_FROM_PARAMETERS)
            allowed = (
                f"this name is taken in the results of {key}; allowed are others than {others}"
            )
            raise refusal(survey["scene"], f"parameters.{word}", given, allowed)
    _check_queries(key, resolved["queries"], settings["parameters"])
    scene = Scene.from_settings(survey["scene"], settings)
    _check_scene(scene, settings)
    resolved["output_interval"] = _output_interval(key, survey, scene)
    scene = replace(scene, error_interval=resolved["output_interval"])
    for word, quantity in survey["quantities"].items():
        _check_name(f"{key}.quantities", word, settings["parameters"], survey["quantities"])
        _check_quantity(f"{key}.quantities.{word}", quantity, scene)
    most = scene.particle_count
    if resolved.get("mode_count", 1) > most:
        allowed = f"at most the {most} particles of the scene"
        raise refusal(None, f"{key}.mode_count", resolved["mode_count"], allowed)
    defaults = {"history": Placed, "value": Placed, "maximum": Placed, "passage": Placed}
    resolved["quantities"] = {
        word: defaults.get(quantity["kind"], Quantity).default_keys() | quantity
        for word, quantity in survey["quantities"].items()
    }
    return resolved


def _check_scene(scene, settings):
    """Refuse what no operators are prepared for."""
    if scene.ends is not None:
        allowed = "surveys are of periodic scenes"
        raise refusal(scene.name, "boundary", settings["boundary"], allowed)
    if scene.start:
        allowed = "the scene of a survey starts from an initial_velocity"
        raise refusal(scene.name, "start", settings["start"], allowed)
    for key in ("youngs_modulus", "damping"):
        if scene.changing(key) is not None:
            allowed = "it must not name t in a scene of a survey"
            raise refusal(scene.name, key, settings[key], allowed)
    if len(scene.forces) > 1 or any(isinstance(term, Expression) for term in scene.forces):
        allowed = "in a scene of a survey it must be an expression in t, or one time and profile"
        raise refusal(scene.name, "force", settings["force"], allowed)


def _output_interval(key, survey, scene):
    """What is given, if outputs at that distance end at T; else the default."""

    def ends(interval):
        steps = interval / scene.time_step
        return is_whole(interval, scene.time_step) and scene.step_count % round(steps) == 0

    usual = scene.duration / OUTPUTS
    interval = survey.get("output_interval", usual if ends(usual) else scene.error_interval)
    if not ends(interval):
        allowed = (
            f"it must be a whole number of time steps of {checks.number(scene.time_step)}, and "
            f"T = {checks.number(scene.duration)} a whole number of it"
        )
        raise refusal(None, f"{key}.output_interval", interval, allowed)
    return interval


def _check_queries(key, queries, parameters):
    for name in queries.get("grid", ()):
        if name not in parameters:
            allowed = f"no such parameter; allowed are {', '.join(parameters)}"
            raise refusal(None, f"{key}.queries.grid", name, allowed)
    if "grid" in queries and np.prod([float(n) for n in queries["grid"].values()]) > LARGEST_COUNT:
        allowed = f"the grid may have at most {LARGEST_COUNT} points"
        raise refusal(None, f"{key}.queries.grid", queries["grid"], allowed)
    if "from" in queries:
        try:
            samples.points(parameters, queries)
        except ValueError as error:
            raise refusal(None, f"{key}.queries.from", queries["from"], str(error)) from None


def _check_name(key, word, parameters, others):
    """Refuse a quantity whose name another variable of the results has."""
    ends = [word.removesuffix(end) for end in ("_low", "_high") if word.endswith(end)]
    if word in (*TAKEN, *parameters) or any(one in others for one in ends):
        allowed = (
            f"this name is taken in the results; allowed are others than {', '.join(TAKEN)}, "
            "parameters, and those of intervals, which end with _low or _high"
        )
        raise refusal(None, key, word, allowed)


def _check_quantity(key, quantity, scene):
    place, length = quantity.get("place", 0), scene.domain_length
    if place >= length:
        allowed = f"it must be at least 0 and below L = {checks.number(length)}"
        raise refusal(None, f"{key}.place", place, allowed)
    if quantity.get("width", 0) > length:
        allowed = f"it must be at most L = {checks.number(length)}"
        raise refusal(None, f"{key}.width", quantity["width"], allowed)
    time = quantity.get("time", scene.duration)
    on_grid = time == 0 or is_whole(time, scene.error_interval)
    if not on_grid or time > scene.duration * (1 + 1e-9):
        allowed = (
            "it must be a whole number of output intervals, "
            f"{checks.number(scene.error_interval)}, up to T = {checks.number(scene.duration)}"
        )
        raise refusal(None, f"{key}.time", time, allowed)


def _check_parameters(name: str, settings: Mapping[str, Any]) -> None:
    """Refuse ranges that are none, or in which the scene is none, and parameters nothing holds."""
    parameters = settings["parameters"]
    used = {word for text in _expressions(settings) for word in _names(text)}
    for word, given in parameters.items():
        key, (low, high) = f"parameters.{word}", given["range"]
        if not low < high:
            raise refusal(name, f"{key}.range", given["range"], "it must rise")
        if given["scale"] == "logarithmic" and low <= 0:
            allowed = "it must be positive where the scale is logarithmic"
            raise refusal(name, f"{key}.range", given["range"], allowed)
        if not low <= given["nominal"] <= high:
            allowed = f"it must lie in the range {checks.number(low)} to {checks.number(high)}"
            raise refusal(name, f"{key}.nominal", given["nominal"], allowed)
        if word not in used:
            allowed = f"no expression of the scene holds it; it may stand in {', '.join(PROFILES)}"
            raise refusal(name, key, given, allowed)
    inner = samples.points(parameters, {"count": CHECKED, "sampling": "halton"})
    for values in np.concatenate([samples.corners(parameters), inner]):
        point = dict(zip(parameters, map(float, values), strict=True))
        try:
            checks.check_setting(samples.scene_at(name, settings, point))
        except ValueError as error:
            told = str(error).removeprefix(f"scene {name}: ")
            where = ", ".join(f"{word} = {value:g}" for word, value in point.items())
            ranges = {word: given["range"] for word, given in parameters.items()}
            raise refusal(name, "parameters", ranges, f"at {where}, {told}") from None


def _expressions(settings: Mapping[str, Any]) -> Iterator[str]:
    for key in PROFILES:
        given = settings.get(key, ())
        for term in given if isinstance(given, list) else [given]:
            yield from map(str, term.values() if isinstance(term, Mapping) else [term])


def _names(text):
    return reads(ast.parse(text.strip()))
