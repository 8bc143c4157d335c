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
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import solve_triangular

from sphpod.numerics import propagator
from sphpod.numerics.course import Course
from sphpod.numerics.expressions import Expression
from sphpod.reduced.error_bound import Bound, Map, over_time
from sphpod.reduced.lifted_rom import OwnModes, eigenmodes, normal_modes
from sphpod.scene.scene import Scene
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


@dataclass(frozen=True)
class _Norms:
    """What `over_time` asks of a full model, as norms alone."""

    scene: Scene
    start: np.ndarray
    courses: tuple[Course, ...]
    forces: np.ndarray

    @property
    def missed(self) -> float:
        return float(sum(self.forces[0, n] * one.missed for n, one in enumerate(self.courses)))


class Survey:
    """Models of the operators for any parameters.

    Parameters
    ----------
    operators : Operators
    count : int
        Velocity modes of the queries; all there are serve the estimate of their errors.
    tolerance : float
        Relative bound from which on a bound is sharpened by the model of all modes: the error is at
        most the difference from that, which is known, and the error of that.
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

    def model(self, values: Values) -> tuple[Query, Any, Any]:
        """The model of all modes, and the parts and factors that its residual is of.

        Raises
        ------
        ValueError
            Density or modulus is not positive somewhere, or the modes are linearly dependent.
        """
        operators = self.operators
        velocity, scale, (damped, loaded, started) = operators.velocity_part(values)
        courses, strength = self.courses(values)
        loaded = strength * loaded
        stress, stiff = stress_found = operators.stress_part(values)
        lower = _cholesky(scale * velocity.mass)
        soft = _cholesky(stress.compliance / stiff)

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
        return query, (velocity, scale, (damped, loaded, started)), stress_found

    def residual(self, query: Query, velocity_found: Any, stress_found: Any):
        """Columns of the residual by own coordinates and force, and what starts beside the modes.

        Returns
        -------
        velocity, stress : arrays, shape (rows, coordinates + forces)
            Of the same norms as the residuals of all particles, scaled by their energies.
        beside : float
            Energy norm of the initial velocity that the modes do not hold.
        start_norm, force_norm : float
            Energy norms of the initial velocity and of the force's profile.
        """
        part, scale, (damped, loaded, started) = velocity_found
        stress_part, stiff = stress_found
        own, kv, ke = query.own, len(query.velocity_modes), len(query.stress_modes)
        a = query.velocity_modes.T @ own.to_modes[:kv]
        b = query.stress_modes.T @ own.to_modes[kv:]
        push = query.push
        ends = np.cumsum(
            [len(self.operators.stress_modes)]
            + [len(part.mass)] * len(damped)
            + [len(loaded), len(started)]
        )
        pull, *damping, load, start, modes = np.split(part.factor, ends, axis=1)
        modes = modes[:, :kv]
        root = np.sqrt(scale)
        columns = pull[:, :ke] @ b / scale - modes @ (a @ own.operator)
        for factor, each in zip(damped, damping, strict=True):
            columns = columns - factor * each[:, :kv] @ a
        left = (load @ loaded)[:, None][:, : push.shape[1]] - modes @ (a @ push)
        velocity = root * np.concatenate([columns, left], axis=1)
        stretch, soft = np.split(stress_part.factor, [len(part.mass)], axis=1)
        soft = soft[:, :ke]
        strained = np.sqrt(stiff) * stretch[:, :kv] @ a - soft @ (b @ own.operator) / np.sqrt(stiff)
        stress = np.concatenate([strained, -soft @ (b @ push) / np.sqrt(stiff)], axis=1)
        begun = start @ started
        beside = root * np.linalg.norm(begun - modes @ (a @ query.own_start))
        return (
            velocity,
            stress,
            beside,
            root * np.linalg.norm(begun),
            root * np.linalg.norm(load @ loaded),
        )

    def answer(self, values: Values) -> "Answer":
        """Solve a query and bound its error, at the times of the outputs.

        Raises
        ------
        ValueError
            As `model`.
        """
        whole, *parts = self.model(values)
        query = whole.leading(self.count)
        coordinates = query.coordinates(query.solve())
        # A model that is compared with itself is told nothing of its error.
        difference = np.full(self._times.size, np.nan)
        if len(whole.start) > len(query.start):
            difference = _difference(coordinates, whole.coordinates(whole.solve()))
        bound, start_norm, force_norm = self._bound(query, parts)
        found = Answer(query, coordinates, bound, start_norm, difference, force_norm)
        if found.relative_bound <= self.tolerance or len(whole.start) == len(query.start):
            return found
        beyond, *_ = self._bound(whole, parts)
        return replace(found, bound=np.minimum(bound, difference + beyond))

    def _bound(self, query, parts):
        """Bound of a model's error at the outputs, and norms of the start and of the force."""
        velocity, stress, beside, *norms = self.residual(query, *parts)
        if query.uniform is not None and not query.courses:
            return oscillating_bound(query, velocity, stress, float(beside), norms[0]), *norms
        return _driven_bound(query, velocity, stress, float(beside), norms), *norms


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
    start_norm : float
        Energy norm at t = 0.
    difference : array, shape (times,)
        Energy norm of the difference to the model of all modes, which estimates the error; NaN
        where there are no further modes.
    force_norm : float
        Energy norm of the force's profile.
    """

    query: Query
    coordinates: tuple[np.ndarray, np.ndarray]
    bound: np.ndarray
    start_norm: float
    difference: np.ndarray
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


def _driven_bound(query: Any, velocity, stress, beside, norms):
    """Bound of the energy norm of the error at the outputs, with a force or uneven damping."""
    push = query.push
    full = _Norms(
        query.scene, np.array([norms[0]]), query.courses, np.full((1, len(query.courses)), norms[1])
    )
    residual = Map.of(query, push, np.concatenate([velocity, stress]))
    bound = Bound(beside, None, residual, *_damped(query, push, velocity, stress))
    (over,) = over_time(full, query, query.own_start, [bound], 0.0)
    return over + full.missed


def _damped(query, push, velocity, stress):
    """Maps of the residual of velocity, which damping takes up, and of that of stress."""
    damping = query.uniform
    if not damping or damping * query.scene.duration < 1:
        return None, None
    return (
        Map.of(query, push, velocity / (2 * np.sqrt(damping))),
        Map.of(query, push, stress),
    )


def _difference(some, more):
    squares = 0.0
    for few, all_ in zip(some, more, strict=True):
        rest = all_.copy()
        rest[:, : few.shape[1]] -= few
        squares = squares + np.sum(rest**2, axis=1)
    return np.sqrt(squares)
