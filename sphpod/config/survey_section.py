"""Surveys of parameters: their keys, and what these mean together."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from sphpod.config.design_section import Design, resolved_design
from sphpod.config.fields import (
    BY_SHAPE,
    LARGEST_SEED,
    ModeCount,
    Name,
    ParameterName,
    Section,
    Unique,
    left_out,
)
from sphpod.config.parameters import check_within
from sphpod.config.reading import refusal
from sphpod.config.scene_section import Time
from sphpod.config.sizes import check_sizes, survey_sizes
from sphpod.numerics.expressions import Expression
from sphpod.scene import checks
from sphpod.scene.scene import Scene, is_whole
from sphpod.surveys import samples

LARGEST_COUNT = 10**15
"""Queries that can be counted; the memory that their answers take is checked."""

MOST_JOBS = 10000
"""Chunks of a survey, each of which is a job and a file."""

MOST_PLACES = 1000
"""Places of one quantity, beyond which all particles are asked for."""

OUTPUTS = 100
"""Intervals between the outputs of a survey that says nothing else."""

TAKEN = (
    *("t", "relative_bound", "relative_estimate", "certified", "reason", "query"),
    *("true_error", "effectivity", "inside", "quantity", "parameter", "surface"),
    *(f"{kind}_index{end}" for kind in ("first", "total") for end in ("", "_low", "_high")),
    *("velocity_modes", "correction_modes", "translation", "mode_count"),
    "training_points",
    *("contender", "integrator", "contender_mode_count", "contender_time_step", "query_error"),
    *("query_seconds", "training_seconds", "break_even", "break_even_unbounded"),
    *("round", "holds", "verdict", "designed"),
    *(f"evaluation{end}" for end in ("", "_round", "_point", "_value", "_excess")),
)
"""Names in the results of a survey."""

TAKEN_FROM_PARAMETERS = (*TAKEN, "velocity", "strain", "point", "extrapolate", "bounds")
"""Names that no parameter of a survey has: those, of its training runs, and of calls to it."""

ENDS = "_low", "_high", "_full"
"""What is added to the name of a quantity for its interval, and for its value of a full run."""


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


class Sensed(Quantity):
    """What quantities of a field have."""

    field: SurveyField = Field("velocity", description=f"{FIELD_ASKED}, default velocity")
    width: float = left_out(
        gt=0, description="width of a sensor [m], which takes the mean; one particle if left out"
    )


class Placed(Sensed):
    """What quantities of a field at one place have."""

    place: float = Field(ge=0, description=PLACE_ASKED)


class History(Placed):
    """A field at a place over time."""

    kind: Literal["history"] = Field(description=WHAT_IS_ASKED)


class Value(Placed):
    """A field at a place and a time."""

    kind: Literal["value"] = Field(description=WHAT_IS_ASKED)
    time: Time = left_out(description=f"{TIME_ASKED}, default T")


AnyPlaces = Annotated[
    Annotated[Literal["all"], Tag("<scalar>")]
    | Annotated[
        list[Annotated[float, Field(ge=0, description=PLACE_ASKED)]],
        Unique(),
        Field(min_length=1, max_length=MOST_PLACES),
        Tag("<list>"),
    ],
    BY_SHAPE,
]


class Maximum(Sensed):
    """The largest magnitude of a field over time, at a place or over several."""

    kind: Literal["maximum"] = Field(description=WHAT_IS_ASKED)
    place: float = left_out(ge=0, description=PLACE_ASKED)
    places: AnyPlaces = left_out(
        description="in the place of one, a list of places [m], or all, which are the particles"
    )


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
        le=1,
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
        description="base samples of the Sobol indices, a power of two from 2 on, each a query "
        "for each parameter and two more; 0 for none, default 256",
    )
    cost_repeats: int = Field(
        0,
        ge=0,
        le=10000,
        description="turns in which the costs of queries and of the training are timed, by full "
        "and reduced models; 0 for none, default 0",
    )
    design: Design = left_out(
        description="the best values of the parameters: what is to be minimised, maximised or "
        "reached, and within which levels"
    )


def resolved_surveys(
    surveys: Mapping[str, Any], scenes: Mapping[str, Any], memory: float
) -> dict[str, dict[str, Any]]:
    """Check surveys and the ranges of parameters of all scenes, and fill in defaults of surveys.

    Parameters
    ----------
    surveys, scenes : dict
    memory : float
        That a job may take [GB].

    Raises
    ------
    ConfigError
    """
    varied = {name: scene for name, scene in scenes.items() if "parameters" in scene}
    for name, scene in varied.items():
        check_within(name, scene, len(varied))
    return {name: _resolved(name, survey, scenes, memory) for name, survey in surveys.items()}


def _resolved(name, survey, scenes, memory):
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
    if (base := resolved["sobol_samples"]) == 1 or base & (base - 1):
        allowed = "it must be a power of two from 2 on, or 0"
        raise refusal(None, f"{key}.sobol_samples", resolved["sobol_samples"], allowed)
    for word, given in settings["parameters"].items():
        if word in TAKEN_FROM_PARAMETERS:
            others = ", ".join(TAKEN_FROM_PARAMETERS)
            allowed = (
                f"this name is taken in the results of {key}; allowed are others than {others}"
            )
            raise refusal(survey["scene"], f"parameters.{word}", given, allowed)
    queries = _count_queries(key, resolved["queries"], settings["parameters"])
    scene = Scene.from_settings(survey["scene"], settings)
    _check_scene(scene, settings)
    resolved["output_interval"] = _output_interval(key, survey, scene)
    scene = replace(scene, error_interval=resolved["output_interval"])
    of_survey = survey_sizes(key, scene, resolved, len(settings["parameters"]), queries)
    check_sizes(None, of_survey, memory)
    if (jobs := -(-queries // resolved["chunk_size"])) > MOST_JOBS:
        allowed = f"that makes {jobs} jobs of {queries} queries; at most {MOST_JOBS} are allowed"
        raise refusal(None, f"{key}.chunk_size", resolved["chunk_size"], allowed)
    for word, quantity in survey["quantities"].items():
        _check_name(f"{key}.quantities", word, settings["parameters"], survey["quantities"])
        _check_quantity(f"{key}.quantities.{word}", quantity, scene)
    most = scene.particle_count
    if resolved.get("mode_count", 1) > most:
        allowed = f"at most the {most} particles of the scene"
        raise refusal(None, f"{key}.mode_count", resolved["mode_count"], allowed)
    energies = ("energy", "energy_loss")
    resolved["quantities"] = {
        word: (Quantity if quantity["kind"] in energies else Sensed).default_keys() | quantity
        for word, quantity in survey["quantities"].items()
    }
    if "design" in survey:
        resolved["design"] = resolved_design(
            f"{key}.design", survey["design"], survey, settings["parameters"]
        )
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
        if scene.varies(key):
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


def _count_queries(key, queries, parameters):
    """How many queries there are, once they are known to be some."""
    for name in queries.get("grid", ()):
        if name not in parameters:
            allowed = f"no such parameter; allowed are {', '.join(parameters)}"
            raise refusal(None, f"{key}.queries.grid", name, allowed)
    try:
        return samples.count(parameters, queries)
    except ValueError as error:
        told = str(error).removeprefix(f"{queries['from']}: ")
        raise refusal(None, f"{key}.queries.from", queries["from"], told) from None


def _check_name(key, word, parameters, others):
    """Refuse a quantity whose name another variable of the results has."""
    ends = [word.removesuffix(end) for end in ENDS if word.endswith(end)]
    made = [f"{word}{end}" for end in ENDS]
    if word in (*TAKEN, *parameters) or {*ends} & {*others} or {*made} & {*parameters}:
        allowed = (
            f"this name is taken in the results; allowed are others than {', '.join(TAKEN)}, "
            f"parameters, and those of another with {', '.join(ENDS)} at the end"
        )
        raise refusal(None, key, word, allowed)


def _check_quantity(key, quantity, scene):
    length = scene.domain_length
    if quantity["kind"] == "maximum" and ("place" in quantity) == ("places" in quantity):
        allowed = "a maximum has either a place, or places: a list of them, or all"
        raise refusal(None, key, quantity, allowed)
    if quantity.get("places") == "all" and "width" in quantity:
        allowed = "a maximum over all places is that of single particles"
        raise refusal(None, f"{key}.width", quantity["width"], allowed)
    for word in ("place", "places"):
        found = quantity.get(word, 0)
        for place in found if isinstance(found, list) else [found]:
            if place != "all" and place >= length:
                allowed = f"it must be at least 0 and below L = {checks.number(length)}"
                raise refusal(None, f"{key}.{word}", place, allowed)
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
