"""Scenes, their samplings, what is compared in CPU time, and what is drawn."""

from collections.abc import Iterable, Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Discriminator, Field, Tag

from sphpod.config.fields import (
    BY_SHAPE,
    LARGEST_SEED,
    Expression,
    FigureName,
    ModeCount,
    Name,
    ParameterName,
    Section,
    Unique,
    left_out,
)
from sphpod.config.start_section import Start
from sphpod.scene.scene import is_whole

INTERVALS = 10000
"""Intervals over which errors are summed, where a scene says nothing else."""

MOST_TIME_STEPS = 10**9
"""Time steps of a scene, so that a slip of the pen does not fill the memory."""

MOST_FORCES = 100
"""Terms of a force, each of which is followed by itself."""


class Force(Section):
    """A term of a force: a course in time times a profile in space."""

    time: Expression = Field(
        description="course of the force in time [m/s2], an expression in t, L and T"
    )
    profile: Expression = Field(
        description="dimensionless profile in space, an expression in x, L and T"
    )


class Parameter(Section):
    """A named number in expressions of the scene, and the range that surveys take it from."""

    nominal: float = Field(description="its value wherever the scene itself runs, in SI units")
    range: list[float] = left_out(
        min_length=2,
        max_length=2,
        description="least and largest value of a survey, in SI units; if left out, the support of "
        "the distribution, where that is bounded",
    )
    distribution: dict[str, dict[str, float]] = left_out(
        min_length=1,
        max_length=1,
        description="a continuous distribution of scipy.stats, by name with its own parameters; "
        "cut at the ends of the range; if left out, values are spread by the scale",
    )
    scale: Literal["linear", "logarithmic"] = Field(
        "linear",
        description="whether values are spread evenly, or their logarithms; default linear",
    )


class Positions(Section):
    """Where particles rest that are not evenly spaced."""

    jitter: float = Field(
        ge=0,
        description=(
            "largest shift of a particle from its place in an evenly spaced row, in particle "
            "spacings (dimensionless), from 0 to below 0.5; the row begins where the first "
            "particle is at 0"
        ),
    )
    seed: int = left_out(ge=0, le=LARGEST_SEED, description="seed of the random shifts, default 0")


ForceTerm = Annotated[
    Annotated[Expression, Tag("<scalar>")] | Annotated[Force, Tag("<mapping>")],
    BY_SHAPE,
    Field(description="an expression in x, t, L and T [m/s2], or time (in t) and profile (in x)"),
]

End = Literal["fixed", "free"]

ReferenceKind = Literal["fd", "centred", "chain", "exact", "modified"]

Time = Annotated[float, Field(ge=0, description="time [s]")]
Times = Annotated[
    list[Time],
    Field(
        min_length=1,
        description="snapshot times [s], within 0 and T, each rounded to the nearest time step",
    ),
]


class Sampling(Section):
    """What all samplings have."""

    mode_counts: int | str = left_out(
        description="mode counts of the sweep, such as 12 or 1-20; default 1 to 20 or to all modes "
        "there are"
    )


class SampledRange(Sampling):
    """Snapshot times by their number."""

    range: list[Time] = Field(
        min_length=2,
        max_length=2,
        description="first time and end of the sampled time [s], within 0 and T",
    )
    count: int = Field(ge=1, description="number of velocity snapshots and of density snapshots")
    seed: int = left_out(ge=0, le=LARGEST_SEED, description="seed of the random times")


class SampledTimes(Sampling):
    """Snapshot times one by one."""

    velocity_times: Times
    density_times: Times


class SampledFile(Sampling):
    """Snapshots of one's own."""

    from_: str = Field(
        alias="from",
        description="NetCDF file of snapshots of one's own, of the scene's particles: "
        "velocity_snapshots at velocity_time and density_snapshots at density_time, or velocity "
        "and density at t",
    )


class SourceSamplings(Section):
    """Whose snapshots modes are of."""

    from_: Annotated[list[str], Unique()] = Field(
        alias="from",
        min_length=1,
        description="samplings of any scenes with the same particles, each as scene/sampling",
    )


class BorrowedModes(Sampling):
    """Modes of the snapshots of other samplings together."""

    modes: SourceSamplings = Field(
        description="from: samplings whose snapshots together give the modes, each as "
        "scene/sampling"
    )


def _way_to_sample(keys):
    if not isinstance(keys, dict):
        return None
    if "from" in keys:
        return "<file>"
    if "modes" in keys:
        return "<modes>"
    return "<times>" if {"velocity_times", "density_times"} & set(keys) else "<range>"


AnySampling = Annotated[
    Annotated[SampledRange, Tag("<range>")]
    | Annotated[SampledTimes, Tag("<times>")]
    | Annotated[SampledFile, Tag("<file>")]
    | Annotated[BorrowedModes, Tag("<modes>")],
    Discriminator(_way_to_sample),
    Field(
        description="given by range and count, by velocity_times and density_times, by from (a "
        "file) or by modes (of other samplings); times of a range are evenly spaced, its end "
        "excluded, or with a seed distinct steps drawn at random"
    ),
]


class Acceleration(Section):
    """Reduced models compared with full SPH in error and CPU time."""

    mode_counts: Annotated[list[ModeCount], Unique()] = Field(
        min_length=1, description="mode counts k of the compared models"
    )
    n_freeze: Annotated[
        list[Annotated[int, Field(ge=1, le=LARGEST_SEED, description="number of time steps")]],
        Unique(),
    ] = Field(min_length=1, description="numbers of steps for which coefficients are kept frozen")


WHAT_IS_DRAWN = (
    "what is drawn: profile (initial state, reference in space and time), modes (POD modes), error "
    "(singular values; errors against mode count), acceleration (errors against CPU time), "
    "initial_spectrum (Fourier coefficients of v0), phase (velocity at one position against time)"
)
SAMPLING_SHOWN = "name of the sampling shown (modes, error and acceleration only)"


class Figure(Section):
    """What all figures of a scene have."""

    shows: ClassVar[str]
    """How its caption begins, unless it has one of its own."""

    name: FigureName = left_out(
        description="file name without ending, default {scene}_{sampling}_{kind} or {scene}_{kind}"
    )
    caption: str = left_out(description="caption in the report")


class ProfileFigure(Figure):
    """The initial state, and the reference in space and time."""

    shows: ClassVar[str] = "Initial state and reference solution"
    kind: Literal["profile"] = Field(description=WHAT_IS_DRAWN)
    fields: Annotated[list[Literal["initial_velocity", "velocity", "density_change"]], Unique()] = (
        Field(
            ["initial_velocity", "velocity"],
            min_length=1,
            description="panels of a profile, default initial_velocity and velocity",
        )
    )
    end_time: float = left_out(gt=0, description="latest time that a profile shows [s], default T")


class ModesFigure(Figure):
    """POD modes."""

    shows: ClassVar[str] = "Leading POD modes of velocity and density"
    kind: Literal["modes"] = Field(description=WHAT_IS_DRAWN)
    sampling: str = Field(description=SAMPLING_SHOWN)


class ErrorFigure(Figure):
    """Singular values, and errors against the number of modes."""

    shows: ClassVar[str] = "Singular values, and errors against the number of POD modes"
    kind: Literal["error"] = Field(description=WHAT_IS_DRAWN)
    sampling: str = Field(description=SAMPLING_SHOWN)


class AccelerationFigure(Figure):
    """Errors against CPU time."""

    shows: ClassVar[str] = "Errors of the reduced models against CPU time"
    kind: Literal["acceleration"] = Field(description=WHAT_IS_DRAWN)
    sampling: str = Field(description=SAMPLING_SHOWN)
    multiples: Annotated[list[Annotated[float, Field(gt=0)]], Unique()] = Field(
        [1.0],
        min_length=1,
        description="multiples of the error of SPH at which an acceleration figure has lines, "
        "default 1",
    )


class InitialSpectrumFigure(Figure):
    """Fourier coefficients of the initial velocity."""

    shows: ClassVar[str] = "Fourier coefficients of the initial velocity"
    kind: Literal["initial_spectrum"] = Field(description=WHAT_IS_DRAWN)
    last_harmonic: int = left_out(
        ge=1, description="last harmonic that an initial spectrum shows, default all"
    )


class PhaseFigure(Figure):
    """The velocity at one position."""

    shows: ClassVar[str] = "Velocity at one position against time"
    kind: Literal["phase"] = Field(description=WHAT_IS_DRAWN)
    position: float = Field(
        ge=0, description="where the velocity of a phase figure is taken [m], from 0 to below L"
    )


AnyFigure = Annotated[
    ProfileFigure
    | ModesFigure
    | ErrorFigure
    | AccelerationFigure
    | InitialSpectrumFigure
    | PhaseFigure,
    Field(discriminator="kind", description="one figure of a scene"),
]

FIGURES: dict[str, type[Figure]] = {
    "profile": ProfileFigure,
    "modes": ModesFigure,
    "error": ErrorFigure,
    "acceleration": AccelerationFigure,
    "initial_spectrum": InitialSpectrumFigure,
    "phase": PhaseFigure,
}


class Scene(Section):
    """One simulated system, its discretisation, and what is studied and drawn of it."""

    section: str = Field("", description="section of the paper, as text (in quotes)")
    domain_length: float = Field(
        gt=0, description="length L of the periodic domain, or of a bar with ends [m]"
    )
    boundary: Annotated[
        Annotated[Literal["periodic"], Tag("<scalar>")]
        | Annotated[
            list[Annotated[End, Field(description="an end")]],
            Field(min_length=2, max_length=2),
            Tag("<list>"),
        ],
        BY_SHAPE,
    ] = left_out(
        description="periodic, or a list of the ends of a bar, at x = 0 and at x = L, each fixed "
        "or free; default periodic"
    )
    duration: float = Field(gt=0, description="simulated time T [s], a whole number of time steps")
    initial_velocity: Expression = left_out(
        description="v0(x) [m/s], a number or an expression in x, L and T; required, or a start"
    )
    start: Start = left_out(
        description="a state that a file of a run holds, in the place of "
        "initial_velocity; its time is t = 0 of the scene"
    )
    initial_density: Expression = Field(
        description="rho0(x) [kg/m3], positive, a number or an expression in x, L and T"
    )
    youngs_modulus: Expression = Field(
        description="c(x, t) [Pa], positive, a number or an expression in x, t, L and T"
    )
    masses: list[Annotated[float, Field(gt=0)]] = left_out(
        min_length=1,
        description="masses [kg/m2] of a chain, one for each particle, in the place of "
        "initial_density",
    )
    springs: list[Annotated[float, Field(gt=0)]] = left_out(
        min_length=1,
        description="stiffnesses [N/m3] of the springs of a chain, each behind its mass, in the "
        "place of youngs_modulus",
    )
    damping: Expression = left_out(
        description="damping coefficient d(x, t) [1/s], not negative, a number or an expression in "
        "x, t, L and T; left out if there is none"
    )
    force: Annotated[
        Annotated[Expression, Tag("<scalar>")]
        | Annotated[Force, Tag("<mapping>")]
        | Annotated[
            Annotated[list[ForceTerm], Field(min_length=1, max_length=MOST_FORCES)], Tag("<list>")
        ],
        BY_SHAPE,
    ] = left_out(
        description="external force per mass [m/s2], an expression in x, t, L and T, or time (in "
        "t) and profile (in x), or a list of such terms, which add up; left out if there is none"
    )
    interface: Literal["mean"] = left_out(
        description="how SPH sees a modulus that jumps: with mean, a particle has the mean of its "
        "two half cells; left out, c(x) as it stands"
    )
    parameters: dict[ParameterName, Parameter] = left_out(
        min_length=1,
        description="named numbers that the scene's expressions hold, each with its nominal value, "
        "at which the scene runs, and its range, which surveys take it from",
    )
    positions: Positions = left_out(
        description="where particles rest: shifted at random from their even places; evenly spaced "
        "if left out"
    )
    particle_count: int = Field(
        ge=5,
        le=100000,
        description="number N of particles, L/N apart, or L/(N - 1) in a bar with ends, on each of "
        "which one stands",
    )
    smoothing_ratio: float = Field(
        gt=0, description="smoothing length in particle spacings, alpha = h/dx (dimensionless)"
    )
    time_step: float = Field(gt=0, description="time step dt of the explicit Euler scheme [s]")
    error_interval: float = left_out(
        gt=0,
        description="distance of the times over which errors are summed [s], a whole number of "
        "time steps, default T/10000 or, where that is none, the next longer one that divides T",
    )
    references: Annotated[list[ReferenceKind], Unique()] = left_out(
        min_length=1,
        description="solutions that SPH is compared with, the first being the one errors are "
        "quoted against: exact, modified (exact, waves speeded up by beta), fd (staggered finite "
        "differences compared as in the paper), centred (the same with density brought back to "
        "the particles) and chain (the masses and springs of section 2.1); default exact where "
        "such a solution is known, otherwise centred",
    )
    samplings: dict[Name, AnySampling] = Field({}, description="when snapshots are taken, by name")
    acceleration: dict[str, Acceleration] = Field(
        {}, description="by name of the sampling, what is compared in error and CPU time"
    )
    figures: list[AnyFigure] = left_out(
        description="what is drawn, default one figure of each kind that the scene has data for"
    )


def error_interval(settings: Mapping[str, Any]) -> float:
    """Error interval [s] of a scene that gives none.

    It is T/10000, or the next longer one, up to ten times that, of a whole number of time steps
    that divides T. Where there is none it is T/10000, which is refused.
    """
    duration, step = float(settings["duration"]), float(settings["time_step"])
    usual = duration / INTERVALS
    if not is_whole(duration, step) or duration / step > MOST_TIME_STEPS:
        return usual
    steps = round(duration / step)
    least = -(-steps // INTERVALS)
    strides = (stride for stride in range(least, 10 * least) if steps % stride == 0)
    return duration / next((steps // stride for stride in strides), INTERVALS)


def known_names(what: str, names: Iterable[str]) -> str:
    """What is allowed where a scene lacks a sampling or the like that is asked for."""
    allowed = ", ".join(names)
    return f"the scene has no such {what}; {f'allowed are {allowed}' if allowed else 'it has none'}"
