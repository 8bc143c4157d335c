"""A whole configuration, with its benchmarks, studies and illustrations."""

from functools import cache
from typing import Annotated, Any, Literal

from pydantic import Field, create_model

from sphpod.config.claim_section import Claim
from sphpod.config.fields import FigureName, SceneName, Section, Unique, left_out
from sphpod.config.scene_section import Scene
from sphpod.config.stability_section import Stability
from sphpod.config.survey_section import Survey
from sphpod.studies.study import studies


class Illustration(Section):
    """One figure that shows no result."""

    kind: Literal["spring"] = Field(description="spring (mass points joined by springs)")
    name: FigureName = Field(description="file name without ending")
    section: str = Field("", description="section of the paper, as text (in quotes)")
    caption: str = Field("", description="caption in the report")


class Benchmark(Section):
    """How CPU times are measured."""

    repeats: int = Field(
        5,
        ge=1,
        le=10000,
        description="interleaved repetitions of every contender, each in a process of its own for "
        "`cpu_time`, default 5",
    )
    step_scene: str = left_out(
        description="scene of which a step of full SPH is compared with a loop of sparse products, "
        "and whose cost is given against particles and modes"
    )
    particle_counts: Annotated[list[Annotated[int, Field(ge=13, le=100000000)]], Unique()] = Field(
        [100, 400, 1000, 4000, 10_000, 40_000, 100_000, 400_000, 1_000_000],
        min_length=2,
        description="numbers of particles that the cost of a step is measured for",
    )
    mode_counts: Annotated[list[Annotated[int, Field(ge=2)]], Unique()] = Field(
        [2, 4, 8, 12, 16, 24, 32],
        min_length=2,
        description="numbers of modes that the cost of a step is measured for",
    )


class Configuration(Section):
    """Scenes, samplings, studies, figures and claims."""

    output: str = Field(
        "",
        pattern=r"^(?!.*?(.+?)\1{18})(?!-)(/?(?!\.\.?(/|$))[A-Za-z0-9_.-]{1,200})+$(?!\n)",
        max_length=1000,
        description="a folder of letters, digits, dots, hyphens and underscores, none of them . or "
        ".., put before results/ and figures/",
    )
    memory: float = Field(
        8, gt=0, description="memory that a job may take [GB]; what would take more is refused"
    )
    scenes: dict[SceneName, Scene] = Field(min_length=1, description="what is simulated, by name")
    illustrations: list[Illustration] = Field([], description="figures that show no result")
    claims: list[Claim] = Field(
        [], description="statements of the paper, each with the criterion that decides on it"
    )
    surveys: dict[SceneName, Survey] = Field(
        {}, description="queries of a scene at many values of its parameters, by name"
    )
    benchmark: Benchmark = left_out(description="how CPU times are measured")
    stability: Stability = left_out(description="how stability is studied")


@cache
def study_sections() -> dict[str, type[Section]]:
    """The model of the keys of each study that declares some, ``studies.<word>``."""
    sections: dict[str, type[Section]] = {}
    for word, study in studies().items():
        keys: dict[str, Any] = {
            key: (setting.kind, Field(setting.default, **setting.about))
            for key, setting in study.settings.items()
        }
        if keys:
            about = f"Keys of the study {word}."
            sections[word] = create_model(word, __base__=Section, __doc__=about, **keys)
    return sections


def _any_of_scene() -> type[Section]:
    """The model of keys of a scene of which none need be there."""
    keys: dict[str, Any] = {}
    for key, field in Scene.model_fields.items():
        kind: Any = field.annotation
        for limit in field.metadata:
            kind = Annotated[kind, limit]
        keys[key] = kind, left_out(description=field.description)
    about = "Keys of scenes that do not say them themselves."
    return create_model("Defaults", __base__=Section, __doc__=about, **keys)


@cache
def configuration() -> type[Configuration]:
    """The model of a configuration, with the keys that studies declare in ``studies``."""
    declared: dict[str, Any] = {
        word: (section, left_out(description=f"keys of the study {word}"))
        for word, section in study_sections().items()
    }
    keys = create_model("Studies", __base__=Section, __doc__="Keys of studies.", **declared)
    return create_model(
        "Configuration",
        __base__=Configuration,
        __doc__=Configuration.__doc__,
        defaults=(
            _any_of_scene(),
            left_out(description="keys of scenes, for all that do not say them themselves"),
        ),
        studies=(keys, left_out(description="keys of studies, by name")),
    )


@cache
def schema() -> dict[str, Any]:
    """The JSON schema of a configuration, made of the models, which nobody changes."""
    return configuration().model_json_schema()
