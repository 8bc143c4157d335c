"""One query of a survey: its reduced model, solved exactly in time, and the bound of its error.

The coordinates are those of energy: with M = C Cᵀ they are Cᵀ a and Cᵀ q, in which the model is

    a' = -K q - D a + F f(t),    q' = a,

and ½ (|a|² + qᵀ K q) the energy, which damping and force alone change, whatever the modes and the
parameters are. Leading modes have leading coordinates, so a model of fewer modes is a part of one
of more, and the difference of the two is that of their coordinates. The bound is that of the
residual (`sphpod.reduced.error_bound`), of factors as small as the model.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from sphpod.numerics import propagator
from sphpod.numerics.course import Course
from sphpod.numerics.expressions import Expression
from sphpod.reduced.lifted_rom import OwnModes, eigenmodes, oscillators
from sphpod.scene.scene import Scene
from sphpod.surveys.corrected import SHIFTS, Line, corrected_bound
from sphpod.surveys.corrections import Span
from sphpod.surveys.parts import Operators, Values
from sphpod.surveys.terms import separate

SLOWEST = 1e-8
"""Part of the largest frequency that every other one has at least.

What is below is rounding, as of a mode that strains nothing: its displacement grows as it should.
"""


@dataclass(frozen=True)
class Query:
    """A reduced model at some values of the parameters, in coordinates of energy.

    A field at a particle is its coordinates times ``velocity_modes`` times the column of the shared
    modes there: those of velocity, or their strains of the displacement.

    Attributes
    ----------
    scene : Scene
        At nominal values: of it only times and particles are used.
    times : array, shape (times,)
        Those of the outputs [s].
    velocity_modes : array, shape (k, k)
        C⁻¹: coordinates of energy to those in the shared modes, a = C⁻ᵀ â and q = C⁻ᵀ q̂.
    stiffness, damping : arrays, shape (k, k)
        K [1/s²] and D [1/s].
    force : array, shape (k, forces)
        Of the force's profile, if there is one.
    start : array, shape (k,)
        Of the initial velocity.
    uniform : float or None
        Damping [1/s] if it is the same everywhere.
    translation : int
        1 if the first mode is the constant velocity, whose displacement strains nothing and is left
        out; else 0.
    courses : tuple of Courses
        f of the force.
    """

    scene: Scene
    times: np.ndarray
    velocity_modes: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    force: np.ndarray
    start: np.ndarray
    uniform: float | None
    translation: int
    courses: tuple[Course, ...]

    @cached_property
    def waves(self) -> tuple[np.ndarray, np.ndarray]:
        """Frequencies ω [1/s] and shapes U, one a column, of K U = U ω² without translation."""
        waves = slice(self.translation, None)
        squares, shapes = np.linalg.eigh(self.stiffness[waves, waves])
        least = SLOWEST**2 * squares.max(initial=1e-100)
        return np.sqrt(np.maximum(squares, least)), shapes

    @cached_property
    def own(self) -> OwnModes:
        """The model in the modes of its operator, of velocity and b = -ω Uᵀ q."""
        frequencies, shapes = self.waves
        count, rigid = frequencies.size, self.translation
        if self.uniform is not None:
            return oscillators(shapes, frequencies, np.eye(count), rigid, self.uniform)
        coupling = np.pad(shapes * frequencies, ((rigid, 0), (0, 0)))
        none = np.zeros((count, count))
        return eigenmodes(np.block([[-self.damping, coupling], [-coupling.T, none]]))

    @cached_property
    def fields(self) -> tuple[np.ndarray, np.ndarray]:
        """Velocity and displacement by own coordinates, (k, coordinates) each."""
        (frequencies, shapes), kv = self.waves, len(self.start)
        strained = (-shapes / frequencies) @ self.own.to_modes[kv:]
        return self.own.to_modes[:kv], np.pad(strained, ((self.translation, 0), (0, 0)))

    def leading(self, count: int) -> "Query":
        """The model of the first modes."""
        return replace(
            self,
            velocity_modes=self.velocity_modes[:count, :count],
            stiffness=self.stiffness[:count, :count],
            damping=self.damping[:count, :count],
            force=self.force[:count],
            start=self.start[:count],
        )

    @cached_property
    def own_start(self) -> np.ndarray:
        """Own coordinates at t = 0."""
        return self.own.from_modes[:, : len(self.start)] @ self.start

    @property
    def push(self) -> np.ndarray:
        """The force on the own coordinates, shape (coordinates, forces)."""
        return self.own.from_modes[:, : len(self.force)] @ self.force

    @cached_property
    def state(self) -> np.ndarray:
        """Own coordinates at the times of the error integral, (coordinates, times)."""
        own, scene = self.own, self.scene
        jumps = propagator.prepare(
            own.blocks,
            own.singles,
            own.forces_in_blocks(self.push),
            scene.error_interval,
            self.times.size,
            self.courses,
        )
        state = np.zeros((len(self.own_start), self.times.size))
        state[:, 0] = self.own_start
        jumps.run(state)
        return state

    @property
    def coordinates(self) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates of energy of velocity and displacement, (times, k) each.

        Raises
        ------
        ValueError
            The solution is not finite, as of a force that has no value at some time.
        """
        if not np.isfinite(self.state).all():
            raise ValueError("the solution is not finite, as damping, start or force are not")
        velocity, displacement = self.fields
        return self.state.T @ velocity.T, self.state.T @ displacement.T

    def norms(self, velocity: np.ndarray, displacement: np.ndarray) -> np.ndarray:
        """Energy norms of coordinates (times, k) each, (times,)."""
        strained = np.einsum("tk,tk->t", displacement @ self.stiffness, displacement)
        return np.sqrt(np.einsum("tk,tk->t", velocity, velocity) + np.maximum(strained, 0))


class Survey:
    """Models of the operators for any parameters.

    Parameters
    ----------
    operators : Operators
    count : int
        Velocity modes of the queries; all there are serve the estimate of their errors.
    tolerance : float
        Relative bound from which on a bound is sharpened: by corrected modes, and by the model of
        all modes.
    """

    def __init__(self, operators: Operators, count: int, tolerance: float = 0.0) -> None:
        self.operators, self.tolerance = operators, tolerance
        self.count = min(count, len(operators.velocity_modes))
        self._times = operators.nominal.error_times
        scene = operators.nominal
        self._constants = {"L": scene.domain_length, "T": scene.duration}
        self._push: tuple[Expression, Course] | None = None
        force = operators.settings.get("force")
        if force is None:
            return
        self._text = str(force["time"] if isinstance(force, Mapping) else force)
        terms = separate(self._text, operators.parameters)
        if terms is not None and len(terms) == 1:
            ((factor, alone),) = terms
            self._push = (
                Expression(factor, operators.parameters, self._constants),
                Course.of(Expression(alone, ("t",), self._constants), self._times[-1]),
            )

    def courses(self, values: Values) -> tuple[tuple[Course, ...], float]:
        """Course of the force in time, and what it is scaled by.

        The course is made once where the parameters only scale it.
        """
        if "force" not in self.operators.settings:
            return (), 1.0
        if self._push is not None:
            factor, course = self._push
            return (course,), float(factor(**{k: np.asarray(v) for k, v in values.items()}))
        alone = Expression(self._text, ("t",), {**self._constants, **values})
        return (Course.of(alone, self._times[-1]),), 1.0

    def model(self, values: Values) -> tuple[Query, Any]:
        """The model of all modes, and the factors that its residual is of.

        Raises
        ------
        ValueError
            A parameter is not finite, density or modulus is not positive somewhere, or the modes
            are linearly dependent.
        """
        for name, value in values.items():
            if not np.isfinite(value):
                raise ValueError(f"{name} = {value:g} is not finite")
        operators = self.operators
        inertia, scale, (damped, loaded, started) = operators.inertia(values)
        courses, strength = self.courses(values)
        loaded, root = strength * loaded, np.sqrt(scale)
        uniform = None
        if operators.damping_is_even:
            field = operators.damping
            uniform = 0.0 if field is None else float(field.factors(values) @ field.profiles[:, 0])
        force = root * (loaded @ inertia.load)[:, None][:, : len(courses)]
        # A uniform force moves the translation alone; on the rest it is rounding.
        force = np.where(np.abs(force) > 1e-13 * np.linalg.norm(force), force, 0)
        query = Query(
            operators.nominal,
            self._times,
            inertia.modes / root,
            operators.stiffness(values, inertia.modes) / scale,
            np.tensordot(damped, inertia.damping, 1),
            force,
            root * started @ inertia.start,
            uniform,
            operators.rigid,
            courses,
        )
        return query, (scale, damped, loaded, started, strength)

    def solve(self, values: Values) -> "Answer":
        """Solve a query, with a bound of zero in the place of one.

        Raises
        ------
        ValueError
            As `model`.
        """
        whole, factors = self.model(values)
        query, none = whole.leading(self.count), np.zeros(self._times.size)
        norms = self.operators.norms(values, factors[-1])
        return Answer(query, query.coordinates, none, none, *norms)

    def answer(self, values: Values) -> "Answer":
        """Solve a query and bound its error, at the times of the outputs.

        Raises
        ------
        ValueError
            As `model`.
        """
        whole, factors = self.model(values)
        query = whole.leading(self.count)
        coordinates = query.coordinates
        # A model that is compared with itself is told nothing of its error.
        difference = np.full(self._times.size, np.nan)
        if len(whole.start) > len(query.start):
            every, count = whole.coordinates, len(query.start)
            for some, more in zip(coordinates, every, strict=True):
                more[:, :count] -= some
            difference = whole.norms(*every)
        full_of: Any = self._line
        shifts: Sequence[float | None] = SHIFTS
        shared = self.operators.correction_modes if self.operators.is_affine else None
        if shared is not None:
            full_of = self._span
            shifts = (*SHIFTS, None) if len(shared) else (None,)

        def least(found, model, known):
            """The smallest of the bounds until one suffices."""
            full, velocity, displacement = full_of(model, factors, values)
            norms = float(np.linalg.norm(full.start)), float(np.linalg.norm(full.force))
            for shift in shifts:
                if found is None or not found.relative_bound <= self.tolerance:
                    bound = known + corrected_bound(model, full, velocity, displacement, shift)
                    now = Answer(query, coordinates, bound, difference, *norms)
                    if found is None or now.relative_bound < found.relative_bound:
                        found = now
            return found

        answer = least(None, query, 0.0)
        # The error is at most the difference to the model of all modes, and the error of that; no
        # correction modes are made for its modes.
        alone = shared is not None and len(shared) > 0
        if not alone and difference.max() <= self.tolerance * answer.norms.max():
            answer = least(answer, whole, difference)
        return answer

    def _span(self, query, factors, values):
        """The full model within the shared modes, and the query's modes there."""
        scale, damped, loaded, started, _ = factors
        operators, kv, root = self.operators, len(query.start), np.sqrt(factors[0])
        residual = operators.residual(kv)
        modulus = operators.modulus.factors(values)
        span = Span(
            residual.modes,
            np.tensordot(modulus, residual.pull, 1) / scale,
            -np.tensordot(damped, residual.damping, 1) if query.uniform is None else None,
            np.tensordot(modulus, residual.stiffness, 1) / scale,
            query.uniform or 0.0,
            root * residual.start @ started,
            root * (residual.load @ loaded)[:, None][:, : len(query.courses)],
        )
        behind = (0, residual.modes.shape[1] - kv), (0, 0)
        return span, *(np.pad(each, behind) for each in query.fields)

    def _line(self, query, factors, values):
        """The same of the full model at the particles."""
        operators, kv = self.operators, len(query.start)
        line = operators.line(values, factors[-1])
        modes = line.mass[:, None] * (query.velocity_modes @ operators.velocity_modes[:kv]).T
        return line, *(modes @ each for each in query.fields)

    def at_particles(self, values: Values) -> tuple[Query, Line, np.ndarray, np.ndarray]:
        """A query, its full model, and its modes of velocity and displacement, scaled, (N, c)."""
        whole, factors = self.model(values)
        query = whole.leading(self.count)
        return query, *self._line(query, factors, values)


@dataclass(frozen=True)
class Answer:
    """A query that is solved.

    Attributes
    ----------
    query : Query
    coordinates : (times, k) and (times, k)
        Coordinates of energy of velocity and displacement.
    bound : array, shape (times,)
        Of the energy norm of the difference to the lifted full model at the same parameters.
    difference : array, shape (times,)
        Energy norm of the difference to the model of all modes, which estimates the error; NaN
        where there are no further modes.
    start_norm : float
        Energy norm at t = 0.
    force_norm : float
        Energy norm of the force's profile.
    """

    query: Query
    coordinates: tuple[np.ndarray, np.ndarray]
    bound: np.ndarray
    difference: np.ndarray
    start_norm: float
    force_norm: float

    @cached_property
    def norms(self) -> np.ndarray:
        """Energy norm of the solution, (times,)."""
        return self.query.norms(*self.coordinates)

    def fields(self, operators: Operators) -> tuple[np.ndarray, np.ndarray]:
        """Velocity and strain at all particles, (times, N) each."""
        inverse = self.query.velocity_modes
        velocity, strain = (
            coordinates @ inverse @ modes[: len(inverse)]
            for coordinates, modes in zip(
                self.coordinates, (operators.velocity_modes, operators.strain_modes), strict=True
            )
        )
        return velocity, strain

    @property
    def largest_norm(self) -> float:
        """What the largest energy norm of the full model is at least."""
        return float(max(self.start_norm, np.max(self.norms - self.bound)))

    @property
    def relative_bound(self) -> float:
        """Bound of the largest error over time, of the largest norm of the full model.

        Infinite where the full model may be at rest for all that is known.
        """
        largest, bound = self.largest_norm, float(self.bound.max())
        if largest > 0:
            return bound / largest
        return np.inf if bound > 0 else 0.0

    @property
    def estimate(self) -> float:
        """The same of the difference to the model of all modes."""
        largest = max(self.start_norm, float(self.norms.max()))
        return float(self.difference.max() / largest) if largest > 0 else 0.0
