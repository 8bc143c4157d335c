"""Claims, and the criteria that decide on them."""

from typing import Annotated, Literal

from pydantic import Field, Tag

from sphpod.config.fields import BY_SHAPE, Count, ModeCount, SamplingName, Section, Unique, left_out

FieldName = Literal["velocity", "density"]
Threshold = Annotated[float, Field(gt=0)]
Part = Annotated[
    list[Annotated[float, Field(ge=0, le=1, description="place in domain lengths")]],
    Field(min_length=2, max_length=2),
]


class Criterion(Section):
    """One of the functions that decide on claims, with its thresholds.

    Which of these keys a kind has follows from the arguments of its function
    (`sphpod.paper.criteria`).
    """

    kind: Literal[
        "aligned_only_there", "alike_at_every_k", "better_on_average", "both_drop", "calmer_half",
        "cpu_time_alike", "cpu_time_falls", "cpu_time_rises_little", "cpu_time_saved",
        "decays_faster", "density_error_smaller", "density_groups", "derivative_coefficient",
        "dispersion_coefficient", "dominant_harmonics", "doubled", "error_above", "error_below",
        "error_drop", "error_grows", "error_step", "errors_fall", "fails_with", "follows_modified",
        "freezing_adds_more", "freezing_effect", "freezing_negligible", "frozen_is_cheaper",
        "high_harmonics_decay", "linearized_improves", "mixing_matrix", "modes_are_mixed",
        "modes_miss_harmonics", "more_modes_help", "nearly_diagonal", "need_more_modes",
        "periodic_in_time", "pure_modes", "singular_value_drop", "singular_value_groups",
        "smallest_working_count", "some_variant_better", "sph_error", "sph_errors_larger",
        "uniform_mode", "variant_errors", "works_for_none", "works_for_some", "works_from",
        "works_with_all",
    ] = Field(description="name of the criterion")  # fmt: skip
    samplings: Annotated[list[SamplingName], Unique()] = left_out(
        min_length=1, description="samplings looked at instead of the claim's"
    )
    studies: dict[str, SamplingName] = left_out(
        min_length=1,
        description="acceleration studies looked at instead of the claim's, scene to sampling",
    )
    places: Annotated[list[str], Unique()] = left_out(
        min_length=1,
        description="places looked at instead of the claim's, each a scene or scene/sampling",
    )
    variants: list[str] = left_out(
        min_length=2,
        max_length=2,
        description="variants of a scene (studies.variants) that are compared, own for itself",
    )
    start: float = left_out(ge=0, description="first time looked at [s]")
    end: float = left_out(gt=0, description="last time looked at [s]")
    period: float = left_out(gt=0, description="period of the motion [s]")
    periods: Count = left_out(description="number of periods looked at")
    field: FieldName = left_out(description="field looked at")
    rising: FieldName = left_out(description="field whose error is to rise")
    steady: FieldName = left_out(description="field whose error is to stay")
    reference: str = left_out(description="reference that the error is taken against")
    smoothing_ratio: float = left_out(
        gt=0.5, description="smoothing length in particle spacings (dimensionless), above 1/2"
    )
    method: str = left_out(description="reduced model looked at")
    methods: Annotated[
        list[Annotated[str, Field(description="name of a reduced model")]], Unique()
    ] = left_out(min_length=1, description="reduced models looked at")
    mode_counts: Annotated[list[ModeCount], Unique()] = left_out(
        min_length=1, description="mode counts looked at"
    )
    velocity_modes: Count = left_out(description="number of velocity modes that there are")
    density_modes: Count = left_out(description="number of density modes that there are")
    harmonics: Count = left_out(description="number of sine waves that the velocity is made of")
    modes: Count = left_out(description="number of leading modes looked at")
    after: Count = left_out(description="mode count or singular value behind which something falls")
    begin: Count = left_out(description="mode count from which on errors are small")
    among: Count = left_out(
        description="number of leading singular values of which the steepest step is sought"
    )
    size: Count = left_out(description="number of singular values in a group")
    groups: Count = left_out(description="number of groups of singular values")
    within: Threshold = left_out(description="largest ratio of two singular values of one group")
    between: Threshold = left_out(
        description="least ratio of the last singular value of a group to the next"
    )
    similar: Threshold = left_out(
        description="largest ratio of two singular values of similar size"
    )
    drop: Threshold = left_out(
        description="least ratio of two successive singular values that counts as a drop"
    )
    dominance: Threshold = left_out(
        description="least ratio of a dominant singular value to the next"
    )
    spread: Threshold = left_out(
        description="largest relative range of values that are about equal"
    )
    rise: Threshold = left_out(description="least relative rise")
    factor: Threshold = left_out(
        description="ratio that bounds errors or times, or by which errors fall"
    )
    amplitude: Threshold = left_out(description="largest ratio of root mean squares")
    crossings: Threshold = left_out(description="largest ratio of numbers of zero crossings")
    first: Part = left_out(description="part of the domain compared with")
    second: Part = left_out(description="part of the domain that is to be calmer")


Entry = Annotated[float, Field(description="entry of a matrix")]
Row = Annotated[list[Entry], Field(description="row of a matrix")]


class Claim(Section):
    """One statement of the paper."""

    id: str = Field(pattern=r"^[A-Z][0-9]{2}$", description="short unique name, such as E01")
    section: str = left_out(description="section of the paper, as text (in quotes)")
    scene: str = left_out(description="scene the claim is about")
    sampling: str = left_out(description="sampling the claim is about")
    claim: str = Field(description="what is claimed, in words")
    paper: Annotated[
        Annotated[float | str, Tag("<scalar>")] | Annotated[list[Row], Tag("<list>")], BY_SHAPE
    ] = Field(
        description="what the paper says; a number, a matrix, a percentage of CPU time saved, or "
        "yes"
    )
    tolerance: float = left_out(
        ge=0,
        description="largest relative difference that counts as reproduced (dimensionless), "
        "default 0",
    )
    erratum: int = left_out(
        ge=1, description="number of the erratum without which the paper's number is not reproduced"
    )
    criterion: Annotated[
        Annotated[Criterion, Tag("<mapping>")]
        | Annotated[list[Criterion], Field(min_length=1), Tag("<list>")],
        BY_SHAPE,
    ] = Field(description="how the claim is decided; several criteria must all hold")
