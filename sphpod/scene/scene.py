"""What is simulated: domain, initial state, material, damping, force, and discretisation.

Long, as all that models ask of a scene is here.
"""

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from typing import Any

import numpy as np

from sphpod.numerics.course import Course
from sphpod.numerics.error import blocks
from sphpod.numerics.expressions import Expression
from sphpod.numerics.separation import (
    INSTANTS,
    MOST_PLACES,
    WITNESSES,
    Products,
    Separated,
    changes,
    product_count,
    separate,
)
from sphpod.scene.ends import MATERIAL, VELOCITY, Ends, Mirrored
from sphpod.scene.kernel import derivative, neighbour_lists, stencil_weights
from sphpod.scene.start import Start
from sphpod.scene.values import check_products, check_values

logger = logging.getLogger(__name__)

PHYSICS_KEYS = (
    "domain_length", "boundary", "duration", "initial_velocity", "start", "initial_density",
    "youngs_modulus", "damping", "force", "particle_count", "smoothing_ratio", "time_step",
    "error_interval", "interface", "positions", "parameters",
)  # fmt: skip
"""The settings of a scene that its solutions depend on; samplings, figures and the like do not."""

PROFILES = ("initial_velocity", "initial_density", "youngs_modulus", "damping", "force")
"""The settings that are expressions, in which parameters may stand."""

MOMENTUM = 1e-12
"""Part of Σ m |v0| from which the total momentum Σ m v0 is not taken for rounding."""

IN_X, IN_T, IN_X_AND_T = ("x",), ("t",), ("x", "t")
"""Variables of formulas."""

MOST_STEPS = 10**15
"""Time steps up to which a time is a whole number of them."""

EVALUATIONS, FEWEST_TIMES = 2**24, 16
"""Values, times the terms of sums, at which extremes in time are looked for; times at least."""

BLOCK = 2**20
"""Values that are looked at together, which bounds the memory."""

MOST_JUMPED = 8
"""Terms of a force up to which models that are exact in time jump from output to output."""

ABSENT = np.zeros(0)
"""Stands for a damping that a scene does not have."""

NO_FORCE = np.zeros((0, 0))
"""Stands for the factors in time, or the profiles, of a force that a scene does not have."""

NO_LISTS = np.zeros(0, np.uint64), np.zeros(0, np.uint64), ABSENT
"""Stands for the neighbour lists that evenly spaced particles do not need."""


@dataclass(frozen=True)
class Changing:
    """A coefficient that changes with time, as Σ_r g_r(t) p_r(x).

    Attributes
    ----------
    of : (str, str, str)
        Names of scene and key, and the formula.
    factors : tuple of Expressions in t
        g_r, in the coefficient's unit.
    profiles : array, shape (r, N)
        p_r at the particles.
    positions : array, shape (N,)
        Of the particles [m].
    duration : float
        T [s].
    """

    of: tuple[str, str, str]
    factors: tuple[Expression, ...]
    profiles: np.ndarray
    positions: np.ndarray
    duration: float

    def factors_at(self, times: np.ndarray) -> np.ndarray:
        """g_r at times [s], shape (r, times); refused where the coefficient is not valid."""
        times = np.asarray(times, np.float64)
        factors = np.array([factor(t=times) for factor in self.factors])
        check_products(*self.of, factors, self.profiles, (self.positions, times))
        return factors

    def at(self, times: np.ndarray) -> np.ndarray:
        """The coefficient at times [s], shape (times, N)."""
        return self.factors_at(times).T @ self.profiles

    @property
    def courses(self) -> tuple[Course, ...]:
        """Course of each factor."""
        return tuple(Course.of(factor, self.duration) for factor in self.factors)


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
    initial_velocity, initial_density : Expression in x
        v0 [m/s], ρ0 [kg/m³].
    youngs_modulus, damping : Expression in x, or in x and t
        c [Pa] and d [1/s]; without damping None.
    forces : tuple of Products, or Expressions in x and t
        Terms of the external force per mass f(x, t) [m/s²].
    jitter, seed : float and int
        Largest distance, in spacings, of a particle at rest from its place in an evenly spaced row,
        drawn at random from this seed; the row as a whole is shifted for the first particle to be
        at 0. Zero if the particles are evenly spaced.
    ends : Ends or None
        Those of a bar, of which the chain then is the bar and its mirror images, all of a period:
        domain_length, particle_count and the expressions are those of the line. None of what is
        periodic itself.
    start : Start or None
        The kept state of which initial_velocity is the velocity; None of a scene that starts
        unstrained.
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
    forces: tuple[Products | Expression, ...] = ()
    jitter: float = 0.0
    seed: int = 0
    ends: Ends | None = None
    start: Start | None = None

    @classmethod
    def from_settings(cls, name: str, settings: dict[str, Any]) -> "Scene":
        """Build a scene from its block of the configuration (keys beyond PHYSICS_KEYS are ignored).

        Raises
        ------
        ValueError
            An expression is not one, or uses an unknown name; or a kept state is not one.
        """
        step = float(settings["time_step"])
        duration = whole_time(float(settings["duration"]), step)
        interval = whole_time(float(settings["error_interval"]), step)
        constants = {
            "L": float(settings["domain_length"]),
            "T": duration,
            **parameter_values(settings),
        }
        length, count = constants["L"], settings["particle_count"]
        ends = Ends.of(settings)
        if ends:
            length, count = ends.copies * length, ends.copies * (count - 1)

        def expression(key, text, *allowed):
            """The formula in the first set of variables that has all its own."""
            for variables in allowed:
                try:
                    found = Expression(text, variables, constants)
                    break
                except ValueError as error:
                    refusal = error
            else:
                raise ValueError(f"scene {name}: {key}: {refusal}") from None
            if ends is None or "x" not in found.variables:
                return found
            odd = VELOCITY if key.startswith(("initial_velocity", "force")) else MATERIAL
            return Mirrored(found, ends, length / count, odd)

        def profile(key, *allowed):
            return expression(key, settings[key], *allowed) if key in settings else None

        # What is alike all over a bar is not so all over its images beyond a fixed end.
        alike = expression("force", 1, IN_X) if ends and ends.is_fixed else None
        given = settings.get("force", [])
        if isinstance(given, list):
            forces = [_term(f"force.{n}", term, expression, alike) for n, term in enumerate(given)]
        else:
            forces = [_term("force", given, expression, alike)]
        places = settings.get("positions", {})
        scene = cls(
            name=name,
            domain_length=length,
            duration=duration,
            particle_count=count,
            smoothing_ratio=float(settings["smoothing_ratio"]),
            time_step=step,
            error_interval=interval,
            interface=settings.get("interface"),
            initial_velocity=profile("initial_velocity", IN_X) or expression("start", 0, IN_X),
            initial_density=profile("initial_density", IN_X),
            youngs_modulus=profile("youngs_modulus", IN_X, IN_X_AND_T),
            damping=profile("damping", IN_X, IN_X_AND_T),
            forces=tuple(forces),
            jitter=float(places.get("jitter", 0.0)),
            seed=places.get("seed", 0),
            ends=ends,
        )
        return scene._started(settings["start"]) if "start" in settings else scene

    def _started(self, given):
        """The scene, from the state that ``given`` names."""
        places, density0 = self.positions, self.density0()
        try:
            start = Start.read(given, places, self.domain_length, density0, self.ends)
        except ValueError as error:
            raise ValueError(f"scene {self.name}: {error}") from None
        return replace(self, initial_velocity=start.velocity, start=start)

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
    def bar_count(self) -> int:
        """Number of particles of the bar itself, which are the first; all of a periodic line."""
        if self.ends is None:
            return self.particle_count
        return self.particle_count // self.ends.copies + 1

    def line_count(self, bar_count: int) -> int:
        """Number of particles of the line where the bar has so many."""
        return bar_count if self.ends is None else self.ends.copies * (bar_count - 1)

    def bar_particle(self, particle: int) -> int:
        """Number of the particle of the bar that one of the line is the image of."""
        if self.ends is None:
            return particle
        return int(self.ends.images(self.particle_count, MATERIAL)[0][particle])

    @property
    def bar_length(self) -> float:
        """Length L of the bar itself [m]; the period of a periodic line."""
        return self.domain_length if self.ends is None else self.ends.length

    @property
    def is_even(self) -> bool:
        """Whether the particles are evenly spaced, so that all see the same neighbourhood."""
        return self.jitter == 0

    @property
    def is_conservative(self) -> bool:
        """Whether nothing damps or pushes the waves, so that they keep their energy."""
        return self.is_steady and not self.forces and not self.damping_values().size

    @property
    def is_stepped(self) -> bool:
        """Whether models that are exact in time are stepped: none jumps from output to output.

        So it is where coefficients change with time, and where the force has so many terms that
        what each does from output to output costs more than the steps.
        """
        terms = sum(len(term.factors) for term in self.force_terms)
        return not self.is_steady or terms > MOST_JUMPED

    @property
    def is_steady(self) -> bool:
        """Whether modulus and damping do not change with time."""
        return not self.varies("youngs_modulus") and not self.varies("damping")

    @property
    def translates(self) -> bool:
        """Whether translation takes part: there is momentum, a force, or a damping that varies.

        Only evenly spaced particles can be translated without being strained: of others translation
        is a motion like any other, as Σ_j V_j ∇W_ij is not zero. What is fixed is not translated.
        """
        if not self.is_even or (self.ends and self.ends.is_fixed):
            return False
        if self.forces or self.varies("damping"):
            return True
        damping = self.damping_values()
        if damping.size and damping.min() < damping.max():
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
        return _at_rest(self, "initial_velocity").copy()

    def values_at(self, key: str, x: np.ndarray) -> np.ndarray:
        """A profile at places [m], of one that changes with time at t = 0; refused if not valid."""
        expression = getattr(self, key)
        values = at_start(expression, x)
        check_values(self.name, key, expression.text, values, {"x": x})
        return values

    def density0(self) -> np.ndarray:
        """Density ρ0 of the particles unstrained [kg/m³], shape (N,)."""
        return _at_rest(self, "initial_density").copy()

    def starting_density(self) -> np.ndarray:
        """Density of the particles at t = 0 [kg/m³], shape (N,): ρ0, but of a kept state."""
        return self.density0() if self.start is None else self.start.density

    def starting_strain(self) -> np.ndarray:
        """Strain of the particles at t = 0, shape (N,): zero, but of a kept state."""
        if self.start is None:
            return np.zeros(self.particle_count)
        return self.start.strain(x=self.positions)

    def starting_state(self) -> np.ndarray:
        """Velocity [m/s] at t = 0, and of a kept state its strain behind it, (N,) or (2 N,)."""
        velocity = self.velocity0()
        return velocity if self.start is None else np.append(velocity, self.starting_strain())

    def varies(self, key: str) -> bool:
        """Whether ``youngs_modulus`` or ``damping`` changes with time."""
        expression = getattr(self, key)
        return expression is not None and expression.variables == IN_X_AND_T

    def changing(self, key: str) -> Changing | None:
        """``youngs_modulus`` or ``damping`` at the particles where it changes with time."""
        if not self.varies(key):
            return None
        _extremes(self, key)
        parts = self.separated(getattr(self, key))
        if key == "damping" or self.interface is None:
            profiles = parts.profiles(self.positions)
        else:
            profiles = np.mean([parts.profiles(x) for x in self._half_cells()], axis=0)
        of = self.name, key, getattr(self, key).text
        profiles = np.ascontiguousarray(profiles)
        return Changing(of, parts.factors, profiles, self.positions, self.duration)

    def separated(self, expression: Expression, beside: float = 0.0) -> Separated:
        """A function of x and t as a sum of products, at the particles or ``beside`` them [m]."""
        own, places = self.in_bar(expression, beside)
        found = separate(own, self.duration, places)
        return expression.of_line(found) if isinstance(expression, Mirrored) else found

    @property
    def in_time(self) -> dict[str, tuple[Products | Expression, ...]]:
        """What is looked up at each step: the terms of the force, and what changes with time."""
        found = {"force": self.forces} if self.forces else {}
        for key, what in (("youngs_modulus", "modulus"), ("damping", "damping")):
            if self.varies(key):
                found[what] = (getattr(self, key),)
        return found

    def product_count(self, function: Products | Expression) -> int:
        """About how many products of a function of t and one of x it is kept as."""
        if not isinstance(function, Expression):
            return len(function.factors)
        own, places = self.in_bar(function, 0.0)
        return product_count(own, self.duration, places)

    def in_bar(self, expression: Expression, beside: float = 0.0) -> tuple[Expression, np.ndarray]:
        """A function without its images, and the particles that are none, or places beside [m]."""
        places = self.positions + beside
        if isinstance(expression, Mirrored):
            return expression.expression, places[: self.bar_count - (beside > 0)]
        return expression, places

    def modulus(self) -> np.ndarray:
        """Young's modulus of the particles in SPH [Pa], shape (N,); of one that changes, at t = 0.

        The scaled strain √(V c) e of a modulus that changes has this one in it, too.
        """
        return _at_rest(self, "youngs_modulus").copy()

    def _half_cells(self):
        """Middles of the half cells to the left and to the right of particles [m]."""
        return [(self.positions + way * self.spacing / 4) % self.domain_length for way in (-1, 1)]

    def damping_values(self, positions: np.ndarray | None = None) -> np.ndarray:
        """Damping coefficient [1/s] at the particles or ``positions``; empty if there is none.

        Of one that changes, that at t = 0, even if it is zero then.
        """
        if self.damping is None:
            return ABSENT
        if positions is None:
            values = _at_rest(self, "damping").copy()
        else:
            values = self.values_at("damping", positions)
        return values if np.any(values) or self.damping.variables == IN_X_AND_T else ABSENT

    def largest_modulus(self) -> np.ndarray:
        """Largest modulus over T of each particle [Pa], shape (N,), where it is looked at."""
        varies = self.varies("youngs_modulus")
        return _extremes(self, "youngs_modulus")[1] if varies else self.modulus()

    def damping_range(self) -> tuple[float, float]:
        """Smallest and largest damping coefficient of any particle over T [1/s]."""
        if self.varies("damping"):
            low, high = _extremes(self, "damping")
            return float(low.min()), float(high.max())
        values = self.damping_values()
        return (float(values.min()), float(values.max())) if values.size else (0.0, 0.0)

    @property
    def force_terms(self) -> list[Separated]:
        """The force as sums of products of a function of t and one of x."""
        return _separated_forces(self)

    def force_values(self, times: np.ndarray, positions: np.ndarray | None = None):
        """Force per mass as f(x, t) = Σ_r amplitude_r(t) profile_r(x).

        Returns
        -------
        amplitudes, profiles : arrays, shapes (terms, times) and (terms, N)
            Amplitudes [m/s²] and profiles (dimensionless); both empty if there is no force.
        """
        if not self.forces:
            return NO_FORCE, NO_FORCE
        x, terms = self.positions if positions is None else positions, self.force_terms
        amplitudes = [factor(t=times) for term in terms for factor in term.factors]
        profiles = [term.profiles(x) for term in terms]
        for key, given, values in zip(force_keys(self), self.forces, profiles, strict=True):
            if shape := profile_of(given):
                check_values(self.name, f"{key}.profile", shape.text, values, {"x": x})
        return np.array(amplitudes), np.ascontiguousarray(np.concatenate(profiles))

    def courses(self) -> tuple[Course, ...]:
        """Course of each term of the force over the times of the error integral.

        The log reports where it could not be proved.
        """
        found = []
        for term in self.force_terms:
            for factor in term.factors:
                found.append(Course.of(factor, self.error_times[-1]))
                if not np.isfinite(found[-1].missed):
                    _warn_of_force(self.name, factor.text)
        return tuple(found)

    def later(self, by: float) -> "Scene":
        """The scene with what changes with time shifted [s]: its t = 0 is t = ``by`` here."""

        def shifted(function):
            if isinstance(function, Products):
                return replace(function, factors=tuple(g.shifted(by) for g in function.factors))
            if function is None or "t" not in function.variables:
                return function
            return function.shifted(by)

        return replace(
            self,
            youngs_modulus=shifted(self.youngs_modulus),
            damping=shifted(self.damping),
            forces=tuple(shifted(term) for term in self.forces),
        )

    def force_of_steps(self, count: int, parts: int = 1, positions: np.ndarray | None = None):
        """Force as from `force_values`, at the first ``count`` steps or so many parts of one."""
        if not self.forces:
            return NO_FORCE, NO_FORCE
        return self.force_values(self.times(np.arange(count), parts), positions)

    def neighbour_lists(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Neighbours of each particle and their weights, as `kernel.neighbour_lists` gives them."""
        return neighbour_lists(
            self.positions, self.volumes, self.smoothing_length, self.domain_length
        )

    def neighbours(self) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Weights of evenly spaced neighbours, and the lists of others; one of the two is empty."""
        if self.is_even:
            return stencil_weights(self.spacing, self.smoothing_ratio), NO_LISTS
        return ABSENT, self.neighbour_lists()

    def derivative(self, fields: np.ndarray) -> np.ndarray:
        """SPH derivative G of fields (…, N) along their last axis [1/m times theirs] (2.9)."""
        if self.is_even:
            return derivative(fields, stencil_weights(self.spacing, self.smoothing_ratio))
        return (derivative_matrix(self) @ fields.T).T


def _term(key, given, expression, alike):
    """Term of a force as a key of the configuration gives it; ``alike`` is the profile 1."""
    if isinstance(given, dict):
        factor = expression(f"{key}.time", given["time"], IN_T)
        return Products((factor,), (expression(f"{key}.profile", given["profile"], IN_X),))
    found = expression(key, given, IN_T, IN_X_AND_T)
    return found if found.variables == IN_X_AND_T else Products((found,), (alike,))


def force_keys(scene: Scene) -> list[str]:
    """Keys of the force's terms in the configuration."""
    if len(scene.forces) == 1:
        return ["force"]
    return [f"force.{n}" for n in range(len(scene.forces))]


def profile_of(term: Products | Expression) -> Expression | None:
    """Profile in space of a term of a force that was given with one."""
    shape = term.shapes[0] if isinstance(term, Products) else None
    return None if shape is None or shape.text == "1" else shape


def at_start(expression: Expression, x: np.ndarray) -> np.ndarray:
    """A coefficient at places [m], of one that changes with time at t = 0."""
    if expression.variables == IN_X_AND_T:
        return expression(x=x, t=np.zeros(1))
    return expression(x=x)


@lru_cache(maxsize=16)
def _at_rest(scene, key):
    """A profile at the particles (N,), of one that changes at t = 0; refused if not valid."""
    return np.mean([scene.values_at(key, x) for x in _cells(scene, key)], axis=0)


def _cells(scene, key):
    """Places [m] over which a profile of the particles is the mean."""
    averaged = key == "youngs_modulus" and scene.interface is not None
    return scene._half_cells() if averaged else [scene.positions]


@lru_cache(maxsize=8)
def _extremes(scene, key):
    """Smallest and largest value of each particle over the duration where looked at, (N,) each."""
    low, high = np.full((2, scene.particle_count), [[np.inf], [-np.inf]])
    for values in _seen(scene, key, getattr(scene, key), _cells(scene, key)):
        low, high = np.minimum(low, values.min(axis=1)), np.maximum(high, values.max(axis=1))
    return low, high


def _seen(scene, key, expression, cells):
    """Means over places of a function of x and t, wherever it changes; refused if not valid.

    Arrays (N, times), of blocks of times.
    """
    count = scene.particle_count
    most = max(FEWEST_TIMES, EVALUATIONS // (count * expression.terms))
    own, places = scene.in_bar(expression)
    witnesses = places.size if places.size <= MOST_PLACES else WITNESSES
    times = changes(own, scene.duration, places, min(INSTANTS, most), witnesses=witnesses)
    for rows in blocks(times.size, max(1, BLOCK // count)):
        found = []
        for x in cells:
            points = {"x": x[:, None], "t": times[rows]}
            found.append(expression(**points))
            check_values(scene.name, key, expression.text, found[-1], points)
        yield np.mean(found, axis=0)


@lru_cache(maxsize=8)
def _separated_forces(scene):
    """Terms of the force as sums of products; a term that is not finite somewhere is refused."""
    found = []
    for key, term in zip(force_keys(scene), scene.forces, strict=True):
        if isinstance(term, Expression):
            for _ in _seen(scene, key, term, [scene.positions]):
                pass
            term = scene.separated(term)
        found.append(term)
    return found


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
