"""One query of a survey: its reduced model, solved exactly in time, and the bound of its error.

The coordinates are those of energy: with Cholesky factors M = C Cᵀ and S = E Eᵀ they are Cᵀ a and
Eᵀ b, in which the model is the lifted one of `sphpod.reduced.lifted_rom`: ½ of their squared length
is the energy, which damping and force alone change, whatever the modes and the parameters are.
Leading modes have leading coordinates, so a model of fewer modes is a part of one of more, and the
difference of the two is that of their coordinates. The bound is that of the residual
(`sphpod.reduced.error_bound`), of factors as small as the model.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from scipy.linalg import solve_triangular

from sphpod.numerics import propagator
from sphpod.numerics.course import Course
from sphpod.numerics.expressions import Expression
from sphpod.reduced.lifted_rom import OwnModes, eigenmodes, normal_modes
from sphpod.scene.scene import Scene
from sphpod.surveys.corrected import SHIFTS, corrected_bound
from sphpod.surveys.driven import driven_bound
from sphpod.surveys.oscillating import oscillating_bound
from sphpod.surveys.parts import Operators, Values
from sphpod.surveys.terms import separate

DEPENDENT = 1e-12
"""Part of a mode that those before leave over, from which it is one of its own."""


@dataclass(frozen=True)
class Query:
    """A reduced model at some values of the parameters, in coordinates of energy.

    Attributes
    ----------
    scene : Scene
        At nominal values: of it only times and particles are used.
    times : array, shape (times,)
        Those of the outputs [s].
    velocity_modes, stress_modes : arrays, shapes (kv, kv) and (ke, ke)
        C⁻¹ and E⁻¹: coordinates of energy to those in the shared modes, a = C⁻ᵀ â.
    coupling, damping : arrays, shapes (kv, ke) and (kv, kv)
        B and D of `lifted_rom`.
    force : array, shape (kv, forces)
        Of the force's profile, if there is one.
    start : array, shape (kv,)
        Of the initial velocity.
    uniform : float or None
        Damping [1/s] if it is the same everywhere.
    translation : int
    courses : tuple of Courses
        f of the force.
    """

    scene: Scene
    times: np.ndarray
    velocity_modes: np.ndarray
    stress_modes: np.ndarray
    coupling: np.ndarray
    damping: np.ndarray
    force: np.ndarray
    start: np.ndarray
    uniform: float | None
    translation: int
    courses: tuple[Course, ...]

    @cached_property
    def own(self) -> OwnModes:
        """The model in the modes of its operator."""
        if self.uniform is not None:
            return normal_modes(self.coupling, self.translation, self.uniform)
        none = np.zeros((len(self.stress_modes),) * 2)
        return eigenmodes(np.block([[-self.damping, self.coupling], [-self.coupling.T, none]]))

    def leading(self, count: int) -> "Query":
        """The model of the first velocity modes, and a stress mode for each wave."""
        kv = min(count, len(self.velocity_modes))
        ke = min(kv - self.translation, len(self.stress_modes))
        return replace(
            self,
            velocity_modes=self.velocity_modes[:kv, :kv],
            stress_modes=self.stress_modes[:ke, :ke],
            coupling=self.coupling[:kv, :ke],
            damping=self.damping[:kv, :kv],
            force=self.force[:kv],
            start=self.start[:kv],
        )

    @cached_property
    def own_start(self) -> np.ndarray:
        """Own coordinates at t = 0."""
        return self.own.from_modes[:, : len(self.start)] @ self.start

    @property
    def push(self) -> np.ndarray:
        """The force on the own coordinates, shape (coordinates, forces)."""
        return self.own.from_modes[:, : len(self.force)] @ self.force

    def solve(self) -> np.ndarray:
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

    def coordinates(self, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates of energy of velocity and stress, (times, kv) and (times, ke)."""
        kv = len(self.velocity_modes)
        both = state.T @ self.own.to_modes.T
        return both[:, :kv], both[:, kv:]


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
            Density or modulus is not positive somewhere, or the modes are linearly dependent.
        """
        operators = self.operators
        velocity, scale, (damped, loaded, started) = operators.velocity_part(values)
        courses, strength = self.courses(values)
        loaded = strength * loaded
        compliance, stiff = operators.compliance(values)
        lower = _cholesky(scale * velocity.mass)
        soft = _cholesky(compliance / stiff)

        def within(matrix):
            return solve_triangular(lower, matrix, lower=True, check_finite=False)

        damping = scale * np.tensordot(damped, velocity.damping, 1)
        coupling = -within(solve_triangular(soft, operators.coupling, lower=True).T)
        uniform = None
        if operators.damping_is_even:
            field = operators.damping
            uniform = 0.0 if field is None else float(field.factors(values) @ field.profiles[:, 0])
        force = within(scale * loaded @ velocity.load)[:, None][:, : len(courses)]
        # A uniform force moves the translation alone; on the rest it is rounding.
        force = np.where(np.abs(force) > 1e-13 * np.linalg.norm(force), force, 0)
        query = Query(
            operators.nominal,
            self._times,
            within(np.eye(len(lower))),
            solve_triangular(soft, np.eye(len(soft)), lower=True),
            coupling,
            within(within(damping).T),
            force,
            within(scale * started @ velocity.start),
            uniform,
            operators.rigid,
            courses,
        )
        return query, (scale, stiff, damped, loaded, started, strength)

    def answer(self, values: Values) -> "Answer":
        """Solve a query and bound its error, at the times of the outputs.

        Raises
        ------
        ValueError
            As `model`.
        """
        whole, factors = self.model(values)
        query = whole.leading(self.count)
        coordinates = query.coordinates(query.solve())
        # A model that is compared with itself is told nothing of its error.
        difference = np.full(self._times.size, np.nan)
        if len(whole.start) > len(query.start):
            difference = _difference(coordinates, whole.coordinates(whole.solve()))
        sharper: list[Any] = [partial(self._corrected, shift=shift) for shift in SHIFTS]
        bounds = [self._bound, *sharper] if all(self.operators.is_affine) else sharper

        def least(found, model, known):
            """The smallest of all bounds, each dearer than the one before, until one suffices."""
            for bound_of in bounds:
                if found is None or not found.relative_bound <= self.tolerance:
                    bound, *norms = bound_of(model, factors, values)
                    now = Answer(query, coordinates, known + bound, difference, *norms)
                    if found is None or now.relative_bound < found.relative_bound:
                        found = now
            return found

        answer = least(None, query, 0.0)
        # The error is at most the difference to the model of all modes, and the error of that.
        if difference.max() <= self.tolerance * answer.norms.max():
            answer = least(answer, whole, difference)
        return answer

    def _bound(self, query, factors, _):
        """Bound of the error at the outputs, of arrays of the size of the model.

        Returns
        -------
        bound : array, shape (times,)
        start_norm, force_norm : floats
            Energy norms of the initial velocity and of the force's profile.
        """
        scale, stiff, damped, loaded, started, _ = factors
        operators, own, push = self.operators, query.own, query.push
        kv, ke = len(query.velocity_modes), len(query.stress_modes)
        most, counts = len(operators.velocity_modes), (len(loaded), len(started))
        a = query.velocity_modes.T @ own.to_modes[:kv]
        b = query.stress_modes.T @ own.to_modes[kv:]
        ends = np.cumsum([len(operators.stress_modes), *[most] * len(damped), *counts])
        pull, *damping, load, start, modes = np.split(operators.velocity_factor, ends, axis=1)
        modes = modes[:, :kv]
        columns = pull[:, :ke] @ b / scale - modes @ (a @ own.operator)
        for factor, each in zip(damped, damping, strict=True):
            columns = columns - factor * each[:, :kv] @ a
        left = (load @ loaded)[:, None][:, : push.shape[1]] - modes @ (a @ push)
        velocity = np.sqrt(scale) * np.concatenate([columns, left], axis=1)
        stretch, soft = np.split(operators.stress_factor, [most], axis=1)
        rate = b @ np.concatenate([own.operator, push], axis=1)
        stress = -soft[:, :ke] @ rate / np.sqrt(stiff)
        stress[:, : len(own.operator)] += np.sqrt(stiff) * stretch[:, :kv] @ a
        begun = start @ started
        beside, size, pushed = (
            float(np.sqrt(scale) * np.linalg.norm(each))
            for each in (begun - modes @ (a @ query.own_start), begun, load @ loaded)
        )
        if query.uniform is not None and not query.courses:
            return oscillating_bound(query, velocity, stress, beside, size), size, pushed
        decay = query.uniform or 0.0
        bound = driven_bound(query, velocity, stress, decay, beside, (size, pushed))
        return bound, size, pushed

    def _corrected(self, query, factors, values, shift):
        """The same of corrected modes, of arrays of the size of the particles."""
        operators, own = self.operators, query.own
        kv, ke = len(query.velocity_modes), len(query.stress_modes)
        line = operators.line(values, factors[-1])
        velocity = operators.velocity_modes[:kv].T @ (query.velocity_modes.T @ own.to_modes[:kv])
        stress = operators.stress_modes[:ke].T @ (query.stress_modes.T @ own.to_modes[kv:])
        bound = corrected_bound(
            query,
            line,
            line.mass[:, None] * velocity,
            line.softness[:, None] * stress,
            shift,
        )
        return bound, float(np.linalg.norm(line.start)), float(np.linalg.norm(line.force))


@dataclass(frozen=True)
class Answer:
    """A query that is solved.

    Attributes
    ----------
    query : Query
    coordinates : (times, kv) and (times, ke)
        In coordinates of energy.
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
        velocity, stress = self.coordinates
        return np.sqrt(np.sum(velocity**2, axis=1) + np.sum(stress**2, axis=1))

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


def _cholesky(matrix):
    try:
        lower = np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        raise ValueError("the shared modes are linearly dependent") from None
    if np.any(np.diag(lower) <= DEPENDENT * np.sqrt(np.diag(matrix))):
        raise ValueError("the shared modes are linearly dependent")
    return lower


def _difference(some, more):
    squares = 0.0
    for few, all_ in zip(some, more, strict=True):
        rest = all_.copy()
        rest[:, : few.shape[1]] -= few
        squares = squares + np.sum(rest**2, axis=1)
    return np.sqrt(squares)
