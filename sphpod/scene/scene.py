"""What is simulated: domain, initial state, material, damping, force, and discretisation."""

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Any

import numpy as np

from sphpod.numerics.course import Course
from sphpod.numerics.expressions import Expression
from sphpod.scene.kernel import derivative, neighbour_lists, stencil_weights

logger = logging.getLogger(__name__)

PHYSICS_KEYS = (
    "domain_length",
    "duration",
    "initial_velocity",
    "initial_density",
    "youngs_modulus",
    "damping",
    "force",
    "particle_count",
    "smoothing_ratio",
    "time_step",
    "error_interval",
    "interface",
    "positions",
    "parameters",
)
"""The settings of a scene that its solutions depend on; samplings, figures and the like do not."""

PROFILES = ("initial_velocity", "initial_density", "youngs_modulus", "damping", "force")
"""The settings that are expressions, in which parameters may stand."""

MOMENTUM = 1e-12
"""Part of Σ m |v0| from which the total momentum Σ m v0 is not taken for rounding."""

MOST_STEPS = 10**15
"""Time steps up to which a time is a whole number of them."""

ABSENT = np.zeros(0)
"""Stands for a damping or force that a scene does not have."""


@dataclass(frozen=True)
class Scene:
    """A mass-spring-damper chain on the periodic domain [0, L) (section 2).

    Attributes
    ----------
    domain_length, duration : float
        L [m] and T [s].
    particle_count : int
        N.
    smoothing_ratio : float
        α = h/Δx.
    time_step, error_interval : float
        Δt [s], and the distance of the times over which errors are summed [s].
    interface : "mean" or None
        With "mean", SPH takes the modulus of a particle as the mean of its two half cells.
    initial_velocity, initial_density, youngs_modulus : Expression in x
        v0 [m/s], ρ0 [kg/m³], c [Pa].
    damping : Expression in x, or None
        d [1/s].
    force_time, force_profile : Expression in t and in x, or None
        External force per mass f(x, t) = force_profile(x) force_time(t) [m/s²]; a force without
        profile is uniform.
    jitter, seed : float and int
        Largest distance, in spacings, of a particle at rest from its place in an evenly spaced row,
        drawn at random from this seed; the row as a whole is shifted for the first particle to be
        at 0. Zero if the particles are evenly spaced.
    """

    name: str
    domain_length: float
    duration: float
    particle_count: int
    smoothing_ratio: float
    time_step: float
    error_interval: float
    interface: str | None
    initial_velocity: Expression
    initial_density: Expression
    youngs_modulus: Expression
    damping: Expression | None
    force_time: Expression | None
    force_profile: Expression | None
    jitter: float = 0.0
    seed: int = 0

    @classmethod
    def from_settings(cls, name: str, settings: dict[str, Any]) -> "Scene":
        """Build a scene from its block of the configuration (keys beyond PHYSICS_KEYS are ignored).

        Raises
        ------
        ValueError
            An expression is not one, or uses an unknown name.
        """
        step = float(settings["time_step"])
        duration = whole_time(float(settings["duration"]), step)
        interval = whole_time(float(settings.get("error_interval", duration / 10000)), step)
        constants = {
            "L": float(settings["domain_length"]),
            "T": duration,
            **parameter_values(settings),
        }

        def expression(key, text, variable):
            try:
                return Expression(text, (variable,), constants)
            except ValueError as error:
                raise ValueError(f"scene {name}: {key}: {error}") from None

        def profile(key):
            return expression(key, settings[key], "x") if key in settings else None

        force = settings.get("force")
        parts = {f"force.{k}": v for k, v in force.items()} if isinstance(force, dict) else {}
        time = parts.get("force.time", None if parts else force)
        shape = parts.get("force.profile")
        places = settings.get("positions", {})
        return cls(
            name=name,
            domain_length=float(settings["domain_length"]),
            duration=duration,
            particle_count=settings["particle_count"],
            smoothing_ratio=float(settings["smoothing_ratio"]),
            time_step=step,
            error_interval=interval,
            interface=settings.get("interface"),
            initial_velocity=profile("initial_velocity"),
            initial_density=profile("initial_density"),
            youngs_modulus=profile("youngs_modulus"),
            damping=profile("damping"),
            force_time=(
                None if time is None else expression("force.time" if parts else "force", time, "t")
            ),
            force_profile=None if shape is None else expression("force.profile", shape, "x"),
            jitter=float(places.get("jitter", 0.0)),
            seed=places.get("seed", 0),
        )

    @property
    def spacing(self) -> float:
        """Distance Δx = L/N between particles [m]."""
        return self.domain_length / self.particle_count

    @property
    def smoothing_length(self) -> float:
        """h = α Δx [m]."""
        return self.smoothing_ratio * self.spacing

    @property
    def positions(self) -> np.ndarray:
        """Particle positions at rest [m], ascending, shape (N,): x_i = i Δx, unless they jitter."""
        even = np.arange(self.particle_count) * self.spacing
        if self.is_even:
            return even
        offsets = np.random.default_rng(self.seed).uniform(-1, 1, self.particle_count)
        # All are shifted alike to begin at 0, by which none leaves the domain; at most twice the
        # jitter is then between a particle and i Δx, and between a gap and Δx.
        return even + self.jitter * self.spacing * (offsets - offsets[0])

    @property
    def is_even(self) -> bool:
        """Whether the particles are evenly spaced, so that all see the same neighbourhood."""
        return self.jitter == 0

    @property
    def is_conservative(self) -> bool:
        """Whether nothing damps or pushes the waves, so that they keep their energy."""
        return self.force_time is None and not self.damping_values().size

    @property
    def translates(self) -> bool:
        """Whether translation takes part: there is momentum, a force, or a damping that varies.

        Only evenly spaced particles can be translated without being strained: of others translation
        is a motion like any other, as Σ_j V_j ∇W_ij is not zero.
        """
        if not self.is_even:
            return False
        damping = self.damping_values()
        if self.force_time is not None or (damping.size and damping.min() < damping.max()):
            return True
        momentum = self.density0() * self.velocity0()
        return bool(abs(momentum.sum()) > MOMENTUM * np.abs(momentum).sum())

    @property
    def volumes(self) -> np.ndarray:
        """Particle volumes V_i [m], shape (N,): Δx, or half the distance between the neighbours."""
        if self.is_even:
            return np.full(self.particle_count, self.spacing)
        gaps = np.diff(self.positions, append=self.domain_length)
        return (gaps + np.roll(gaps, 1)) / 2

    @property
    def step_count(self) -> int:
        """Number of time steps in T."""
        return round(self.duration / self.time_step)

    @property
    def error_stride(self) -> int:
        """Number of time steps from one sample of the error integral to the next."""
        return round(self.error_interval / self.time_step)

    @property
    def error_steps(self) -> np.ndarray:
        """Time steps of the error integral, both ends included, shape (samples,)."""
        return np.arange(0, self.step_count + 1, self.error_stride)

    @property
    def error_times(self) -> np.ndarray:
        """Times of the error integral [s], shape (samples,)."""
        return self.times(self.error_steps)

    def times(self, steps: np.ndarray, parts: int = 1) -> np.ndarray:
        """Times [s] after numbers of time steps, or of so many parts of one, as `step_times`."""
        return step_times(self.time_step, steps, parts)

    def velocity0(self) -> np.ndarray:
        """Initial velocity of the particles [m/s], shape (N,)."""
        return self.initial_velocity(x=self.positions)

    def density0(self) -> np.ndarray:
        """Initial density of the particles [kg/m³], shape (N,)."""
        return self.initial_density(x=self.positions)

    def modulus(self) -> np.ndarray:
        """Young's modulus of the particles in SPH [Pa], shape (N,)."""
        if self.interface is None:
            return self.youngs_modulus(x=self.positions)
        quarter = self.spacing / 4
        left, right = (
            self.youngs_modulus(x=(self.positions + way * quarter) % self.domain_length)
            for way in (-1, 1)
        )
        return (left + right) / 2

    def damping_values(self, positions: np.ndarray | None = None) -> np.ndarray:
        """Damping coefficient [1/s] at the particles or ``positions``; empty if there is none."""
        if self.damping is None:
            return ABSENT
        values = self.damping(x=self.positions if positions is None else positions)
        return values if np.any(values) else ABSENT

    def force_values(self, times: np.ndarray, positions: np.ndarray | None = None):
        """Force per mass as f(x, t) = profile(x) amplitude(t).

        Returns
        -------
        amplitude, profile : arrays, shapes (times,) and (N,)
            Amplitude [m/s²] and profile (dimensionless); both empty if there is no force.
        """
        if self.force_time is None:
            return ABSENT, ABSENT
        x = self.positions if positions is None else positions
        shape = np.ones_like(x) if self.force_profile is None else self.force_profile(x=x)
        return self.force_time(t=times), shape

    def courses(self) -> tuple[Course, ...]:
        """Course of each term of the force over the times of the error integral.

        The log reports where it could not be proved.
        """
        if self.force_time is None:
            return ()
        course = Course.of(self.force_time, self.error_times[-1])
        if not np.isfinite(course.missed):
            _warn_of_force(self.name, self.force_time.text)
        return (course,)

    def force_of_steps(self, count: int, parts: int = 1, positions: np.ndarray | None = None):
        """Force as from `force_values`, at the first ``count`` steps or so many parts of one."""
        if self.force_time is None:
            return ABSENT, ABSENT
        return self.force_values(self.times(np.arange(count), parts), positions)

    def neighbour_lists(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Neighbours of each particle and their weights, as `kernel.neighbour_lists` gives them."""
        return neighbour_lists(
            self.positions, self.volumes, self.smoothing_length, self.domain_length
        )

    def derivative(self, fields: np.ndarray) -> np.ndarray:
        """SPH derivative G of fields (…, N) along their last axis [1/m times theirs] (2.9)."""
        if self.is_even:
            return derivative(fields, stencil_weights(self.spacing, self.smoothing_ratio))
        return (derivative_matrix(self) @ fields.T).T


def parameter_values(settings: Mapping[str, Any]) -> dict[str, float]:
    """Values of a scene's named parameters: the nominal ones where a range is given with them."""
    return {
        name: float(given["nominal"] if isinstance(given, Mapping) else given)
        for name, given in settings.get("parameters", {}).items()
    }


def physical_settings(settings: Mapping[str, Any]) -> dict[str, Any]:
    """What of a scene's settings its solutions depend on: of parameters their values alone."""
    kept = {key: settings[key] for key in PHYSICS_KEYS if key in settings}
    return kept | ({"parameters": parameter_values(settings)} if "parameters" in settings else {})


@lru_cache
def _warn_of_force(name, text):
    logger.warning(
        "scene %s: force = %s: it may not be finite somewhere, or breaks more often than can be "
        "followed: what it does from output to output is an estimate, and no error is certified",
        name, text,
    )  # fmt: skip


def step_times(time_step: float, steps: np.ndarray, parts: int = 1) -> np.ndarray:
    """Times n Δt/parts [s], each the double nearest to it, so that 0.3 is 0.3 after any steps.

    Δt is the number that its double stands for: the fraction of a small denominator that the double
    is but for rounding, such as 3/10 of 0.30000000000000004, or its shortest decimal.

    Parameters
    ----------
    time_step : float
        Δt [s].
    steps : int array
        Numbers n of time steps, or of so many parts of one.
    parts : int
    """
    decimal = Fraction(repr(float(time_step)))
    simple = decimal.limit_denominator(10**6)
    exact = simple if abs(simple - decimal) <= decimal * Fraction(1, 2**51) else decimal
    top, bottom = (exact / parts).as_integer_ratio()
    steps = np.asarray(steps, np.int64)
    if max(int(steps.max(initial=0)) * top, bottom) < 2**53:
        # Both are exact in double precision, so that only the quotient is rounded.
        return steps * top / bottom
    return np.array([n * top / bottom for n in steps.tolist()], float)


def whole_steps(time: float, time_step: float) -> float:
    """Number of time steps in a time, a whole one where it is whole to a part in 1e9."""
    ratio = time / time_step
    return round(ratio) if is_whole(time, time_step) else ratio


def whole_time(time: float, time_step: float) -> float:
    """The time [s] of a whole number of steps that a time is to a part in 1e9, else the time."""
    if not is_whole(time, time_step) or time / time_step > MOST_STEPS:
        return time
    return float(step_times(time_step, np.array([round(time / time_step)]))[0])


def is_whole(time: float, time_step: float) -> bool:
    """Whether a time is a whole number of steps, at least one, to a part in 1e9."""
    ratio = time / time_step if time_step > 0 else 0.0
    return np.isfinite(ratio) and abs(ratio - max(1, round(ratio))) <= 1e-9 * ratio


def derivative_matrix(scene: Scene):
    """The SPH derivative G [1/m], a scipy.sparse matrix (N, N), V_i G_ij antisymmetric."""
    from scipy.sparse import csr_array

    first, neighbours, gradients = scene.neighbour_lists()
    index = neighbours.astype(np.int32), first.astype(np.int32)
    return csr_array((gradients, *index), shape=(scene.particle_count,) * 2)
