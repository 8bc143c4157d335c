"""Reduced models: Galerkin projection of the SPH equations on POD modes (sections 2.3 and 2.4).

With v = Uv a and ρ = Uρ b (Uv, Uρ with orthonormal columns), and G the SPH derivative:

    da/dt = P (1 - ρ0/ρ) - Uvᵀ D Uv a + Uvᵀ f,    P = -Uvᵀ diag(1/ρ0) G diag(c)
    db/dt = -Uρᵀ (ρ²/ρ0 ∘ Q a),                   Q = G Uv

original
    these equations, explicit Euler.
linearized
    with ρ/ρ0 - 1 in place of 1 - ρ0/ρ (section 2.4), still evaluated on the particles.
frozen1, frozen2, …
    the linearized velocity equation in reduced coordinates; the coefficients ρ² and Uvᵀ f, and c
    and d where they change with time, are refreshed every n_freeze steps only. frozen1 is the
    linearized model in another form.

Long, as the kernels of all forms of the model stand beside each other.
"""

import logging
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, islice
from typing import Any, Self

import numpy as np

from sphpod.full.sph import SOUND, UNCHANGING, Changes, change
from sphpod.numerics.compiled import compiled, compiled_sums
from sphpod.numerics.error import FIELDS, Arrays, blocks, project_solution
from sphpod.reduced.pod import resolved
from sphpod.reduced.sweep import ReducedRun, failed, report_level
from sphpod.reduced.sweep import sweep as repeat
from sphpod.scene.breakdown import RESOLVED, Breakdown, first_broken
from sphpod.scene.scene import Scene

logger = logging.getLogger(__name__)

GROUP = 4
"""Modes, and models, that a kernel takes at once, so that it passes over memory less often."""


def freeze_steps(method: str) -> int:
    """n_freeze of a method's name; 0 for the methods that freeze nothing.

    Raises
    ------
    ValueError
        There is no such method.
    """
    if method in ("original", "linearized"):
        return 0
    match = re.fullmatch(r"frozen([1-9]\d{0,14})", method)
    if match is None:
        raise ValueError(
            f"method = {method}: allowed are original, linearized and frozen1, frozen2, …"
        )
    return int(match[1])


def check_ends(scene: Scene) -> None:
    """Refuse free ends, whose strain is odd, but not the density that these models step.

    Raises
    ------
    ValueError
    """
    if scene.ends and scene.ends.is_free:
        raise ValueError(
            f"scene {scene.name}: boundary = {scene.ends}: the original, linearized and frozen "
            "models step the density, of which a free end is no symmetry; allowed are fixed ends, "
            "or the methods lifted_euler and lifted_exact"
        )


@dataclass(frozen=True)
class ReducedModel:
    """A scene projected on modes, ready to run.

    Attributes
    ----------
    method : str
        original, linearized, frozen1, frozen2, …
    velocity_modes, density_modes : arrays, shapes (kv, N) and (kρ, N)
        Orthonormal modes, one a row.
    """

    scene: Scene
    method: str
    velocity_modes: np.ndarray
    density_modes: np.ndarray

    def prepare(
        self, steps: np.ndarray, start: tuple[np.ndarray, np.ndarray] | None = None
    ) -> "GalerkinRun":
        """Project the equations: all that precedes the time loop.

        Parameters
        ----------
        steps : int array, shape (times,)
            Ascending numbers of time steps after which the coordinates are kept.
        start : (velocity_coordinates, density_coordinates), shapes (kv,) and (kρ,), optional
            Coordinates at step 0; those of the scene's initial state if not given.
        """
        kernel, start_a, start_b, *arguments = self._project(steps)
        if start is not None:
            start_a, start_b = map(_padded, start)

        def march(kept):
            kernel((start_a.copy(), start_b.copy()), *arguments, steps, kept)

        state = tuple(np.empty((steps.size, len(modes))) for modes in self.modes)
        return self._run(steps, state, march, start)

    def _run(self, steps, state, march, start=None):
        name, times = f"the {self.method} model with {len(self.modes[0])} modes", self.scene.times
        return GalerkinRun(self.scene, name, times(steps), state, self, steps, march, start)

    @property
    def modes(self) -> tuple[np.ndarray, np.ndarray]:
        """Of velocity and of density."""
        return self.velocity_modes, self.density_modes

    def _project(self, steps):
        """Kernel, initial coordinates, and the operators and forces that the kernel takes."""
        scene, n_freeze = self.scene, freeze_steps(self.method)
        velocity_modes, density_modes = self.velocity_modes, self.density_modes
        density0, dt = scene.density0(), scene.time_step
        # Σ_i Φ_i (1/ρ0_i) (G s)_i is Σ_j s_j times this, as V_i G_ij is antisymmetric.
        shares = velocity_modes / (density0 * scene.volumes)
        of_stress = dt * scene.derivative(shares) * scene.volumes
        pull = of_stress * scene.modulus()
        stiffening, slowing = self._changes("youngs_modulus", steps), self._slowing(steps)
        stretch = -dt * scene.derivative(velocity_modes) / density0
        first = velocity_modes @ scene.velocity0(), density_modes @ scene.starting_density()
        start = _padded(first[0]), _padded(first[1])
        decay, damping, amplitudes, push = self._project_forces(dt, steps[-1])
        forces = decay, _padded(damping.T, both=True), amplitudes, _padded(push.T).T.copy()
        on_particles = _padded(stretch), _padded(density_modes)
        operators: tuple[Any, ...]
        if n_freeze == 0:
            if stiffening[0].size:
                pull = of_stress
            operators = _padded(pull), *on_particles, density0, self.method == "linearized"
            return march_particles, *start, operators, forces, (stiffening, slowing)
        force = _padded(density_modes @ (pull / density0).T, both=True)
        constant = _padded(-pull.sum(axis=1))
        if stiffening[0].size:
            # Of each term of c: the force, and the constant behind it.
            factors, profiles = stiffening
            parts = [
                np.append(
                    _padded(density_modes @ (of_stress * c / density0).T, both=True),
                    _padded(-(of_stress * c).sum(axis=1)),
                )
                for c in profiles
            ]
            stiffening = factors, np.array(parts)
        changes = stiffening, slowing
        kv, kr = len(velocity_modes), len(density_modes)
        tensor = nothing = np.zeros((0, 0))
        if tensor_is_cheaper(kv, kr, density0.size, n_freeze):
            tensor, on_particles = _quadratic_tensor(*on_particles, kr), (nothing, nothing)
        operators = force, constant, tensor, *on_particles, n_freeze
        return march_frozen, *start, operators, forces, changes

    def _changes(self, key, steps) -> Changes:
        changing = self.scene.changing(key)
        if changing is None:
            return UNCHANGING
        factors = changing.factors_at(self.scene.times(np.arange(steps[-1])))
        return np.ascontiguousarray(factors.T), changing.profiles

    def _slowing(self, steps) -> Changes:
        """Factors of -Δt Uvᵀ D Uv where d changes with time, and the matrix of each, flat."""
        factors, profiles = self._changes("damping", steps)
        modes, dt = self.velocity_modes, self.scene.time_step
        matrices = [_padded(-dt * (modes * d) @ modes.T, both=True).ravel() for d in profiles]
        return (factors, np.array(matrices)) if matrices else UNCHANGING

    def operator(self, density: np.ndarray | None = None) -> np.ndarray:
        """The model linearized about a density at rest, [[-D, A], [-Cᵀ, 0]] of (2.21) to (2.24).

        Parameters
        ----------
        density : array, shape (N,), optional
            Density ρ [kg/m³] of which the coefficients are taken: that of the last refresh for a
            frozen model; the initial one, projected on the density modes, if not given.

        Returns
        -------
        array, shape (kv + kρ, kv + kρ)
            Of velocity and density coordinates [1/s times ratios of their units].
        """
        scene, v_modes, rho_modes = self.scene, self.velocity_modes, self.density_modes
        density0 = scene.density0()
        if density is None:
            density = rho_modes.T @ (rho_modes @ density0)
        # d(1 - ρ0/ρ)/dρ is ρ0/ρ²; with linearized density it is 1/ρ0.
        slope = density0 / density**2 if self.method == "original" else 1 / density0
        shares = v_modes / (density0 * scene.volumes)
        pull = scene.derivative(shares) * scene.volumes * scene.modulus()
        stretch = -(density**2) / density0 * scene.derivative(v_modes)
        damping = scene.damping_values()
        decay = -(v_modes * damping) @ v_modes.T if damping.size else np.zeros((len(v_modes),) * 2)
        return np.block(
            [
                [decay, (pull * slope) @ rho_modes.T],
                [rho_modes @ stretch.T, np.zeros((len(rho_modes),) * 2)],
            ]
        )

    def system(self) -> dict[str, np.ndarray]:
        """The model linearized at rest, x' = A x + b + F f(t), of the coordinates x of both fields.

        Returns
        -------
        dict
            reduced_operator A (states, states) as `operator`, reduced_constant b (states,) and
            reduced_force F (states, terms), f the courses of the force's terms in time, one of
            nothing without a force; velocity_output and density_output (states, N), of which the
            fields are xᵀ times these. Empty where A would change with time.
        """
        if not self.scene.is_steady:
            return {}
        scene, v_modes, rho_modes = self.scene, self.velocity_modes, self.density_modes
        kv, kr = len(v_modes), len(rho_modes)
        density0, operator = scene.density0(), self.operator()
        start = rho_modes @ density0
        density = start @ rho_modes
        strained = 1 - density0 / density if self.method == "original" else density / density0 - 1
        pull = scene.derivative(v_modes / (density0 * scene.volumes)) * scene.volumes
        constant = -operator[:, kv:] @ start
        constant[:kv] += (pull * scene.modulus()) @ strained
        _, profiles = scene.force_values(np.zeros(1))
        force = v_modes @ profiles.T if profiles.size else np.zeros((kv, 1))
        return {
            "reduced_operator": operator,
            "reduced_constant": constant,
            "reduced_force": np.pad(force, ((0, kr), (0, 0))),
            "velocity_output": np.pad(v_modes, ((0, kr), (0, 0))),
            "density_output": np.pad(rho_modes, ((kv, 0), (0, 0))),
        }

    def _project_forces(self, dt, step_count):
        """Damping and force of a step: 1 - Δt d where d is the same everywhere, else 1 and the
        matrix -Δt Uvᵀ D Uv; amplitudes of the force in every step, and Δt times its projections
        (terms, kv)."""
        scene, modes = self.scene, self.velocity_modes
        d = scene.damping_values()
        decay, damping = 1.0, np.zeros((0, 0))
        steady = scene.changing("damping") is None
        if steady and d.size and d.min() == d.max():
            decay = 1 - dt * float(d[0])
        elif d.size:
            damping = -dt * (modes * d) @ modes.T
        amplitudes, profiles = scene.force_of_steps(step_count)
        push = dt * profiles @ modes.T if amplitudes.size else np.zeros((0, len(modes)))
        return decay, damping, amplitudes, push


@dataclass
class GalerkinRun(ReducedRun):
    """A run of a projected model: its state are the coordinates, (times, kv) and (times, kρ).

    Attributes
    ----------
    steps : int array, shape (times,)
    march : callable
        Fills a state.
    start : (velocity_coordinates, density_coordinates), optional
        As `ReducedModel.prepare` was given.
    """

    reduced: ReducedModel
    steps: np.ndarray
    march: Callable[[tuple[np.ndarray, ...]], None]
    start: tuple[np.ndarray, np.ndarray] | None

    def run(self) -> Self:
        self.march(self.state)
        return self

    def expansions(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        return dict(zip(FIELDS, zip(self.state, self.reduced.modes, strict=True), strict=True))

    def stored(self) -> dict[str, np.ndarray]:
        velocity, density = self.state
        return {
            "t": self.times, "velocity_coordinates": velocity, "density_coordinates": density,
        }  # fmt: skip

    def breakdown(self) -> Breakdown | None:
        """Of the outputs, or of more between them that resolve the fastest wave (`RESOLVED`).

        Where outputs do not resolve that of the model at rest, it runs again and keeps steps that
        do; where strains of one half are met, it keeps every step.
        """
        row, particle = self._broken()
        if row >= 0:
            return self.broken_at(row, particle)
        kv, widest = len(self.reduced.velocity_modes), np.diff(self.steps, prepend=0).max(initial=0)
        if widest <= 1:
            return None
        operator = self.reduced.operator()
        sides = operator[:kv, kv:], operator[kv:, :kv]
        stiffer = np.max(self.scene.largest_modulus() / self.scene.modulus())
        rate = np.sqrt(np.prod([np.linalg.norm(side) for side in sides]) * stiffer)
        rate *= self.scene.time_step
        every = max(1, int(min(RESOLVED / rate, widest))) if rate > 0 else widest
        looked: GalerkinRun = self
        if every < widest:
            looked = self._finer(every)
            row, particle = looked._broken()
        if row < 0 and every > 1 and looked._strained():
            looked = self._finer(1)
            row, particle = looked._broken()
        return looked.broken_at(row, particle) if row >= 0 else None

    def _finer(self, every):
        """The same run with more outputs."""
        steps = np.union1d(self.steps, np.arange(0, self.steps[-1] + 1, every)).astype(np.int64)
        return self.reduced.prepare(steps, self.start).run()

    def _strained(self):
        """Whether a strain from the first row on is `SOUND` or more; sees no particle if it can."""
        modes, (_, rows) = self.reduced.density_modes, self.state
        first = rows[0] @ modes
        moved = np.linalg.norm(rows - rows[0], axis=1)
        reach = np.linalg.norm(modes, axis=0)
        doubts = np.flatnonzero(moved * np.max(reach / first) >= SOUND / (1 + SOUND))
        return any(
            np.abs(first / (rows[doubts[some]] @ modes) - 1).max() >= SOUND
            for some in blocks(doubts.size)
        )

    def _broken(self):
        """First row and particle without finite state and positive Jacobian J, or (-1, -1).

        J = ρ0/ρ is positive where ρ is, and |ρ_i(t) - ρ_i(0)| is at most the length of what the
        coordinates moved times that of the particle's entries in the modes: a test that is usually
        enough, and sees no particle but once. ρ is reconstructed only where the test fails.
        """
        velocity, density = self.state
        finite = np.isfinite(velocity).all(1) & np.isfinite(density).all(1)
        bad = -1 if finite.all() else int(np.argmin(finite))
        rows, modes = density[: bad if bad >= 0 else None], self.reduced.density_modes
        if len(rows):
            reach = np.linalg.norm(modes, axis=0)
            first = rows[0] @ modes
            if first.min() > 0:
                with np.errstate(over="ignore"):
                    moved = np.linalg.norm(rows - rows[0], axis=1)
                    suspects = np.flatnonzero(moved * np.max(reach / first) >= 1)
            else:
                suspects = np.arange(len(rows))
            found = first_broken(0, rows, modes, suspects)
            if found[0] >= 0:
                return found
        return bad, 0 if bad >= 0 else -1


def sweep(
    scene: Scene,
    method: str,
    mode_counts: Iterable[int],
    modes: Arrays,
    sph: Arrays,
    reference: Arrays,
    level: int | None = None,
) -> dict[str, np.ndarray]:
    """Errors of a reduced model for several mode counts; its coordinates, if it is only one.

    Parameters
    ----------
    mode_counts : ints
        Modes for velocity and density each, or all there are.
    modes : dict
        velocity_modes, density_modes (one a row), velocity_span_rounding, density_span_rounding.
    sph, reference : dict
        velocity and density (times, N).
    level : int, optional
        At which too few modes are reported; that of `sweep.report_level` if it is not given.

    Returns
    -------
    dict
        As from `sweep.sweep`: velocity_error_sph, density_error_sph, velocity_error_reference,
        density_error_reference, infinite where a model broke down; modes_resolved, as from
        `modes_resolved`; and for a single count t, velocity_coordinates, density_coordinates and
        `ReducedModel.system`.

    Raises
    ------
    Breakdown
        The model for a single mode count broke down.
    """
    counts = list(mode_counts)
    solutions = {
        name: project_solution(fields, modes, max(counts))
        for name, fields in (("sph", sph), ("reference", reference))
    }

    def measure(run):
        return {
            f"{field}_error_{name}": projected[field].relative_error(coordinates)
            for name, projected in solutions.items()
            for field, coordinates in zip(FIELDS, run.state, strict=True)
        }

    level = report_level(counts) if level is None else level
    models = [model(scene, method, modes, count, level) for count in counts]
    runs = prepare_each(models, scene.error_steps)
    arrays = repeat(counts, runs, measure, failed(FIELDS, *solutions))
    return arrays | {"modes_resolved": modes_resolved(modes, counts)}


def sweep_pair(
    scene: Scene,
    method: str,
    mode_counts: Sequence[int],
    modes: Arrays,
    sph: Arrays,
    reference: Arrays,
) -> dict[str, np.ndarray]:
    """Errors and coordinates of a reduced model with other numbers of modes for v than for ρ.

    Parameters are those of `sweep`, with the number of velocity modes and that of density modes.

    Returns
    -------
    dict
        As from `sweep` for a single count, the larger of the two; velocity_mode_count and
        density_mode_count.

    Raises
    ------
    Breakdown
        The model broke down.
    """
    few = {
        f"{field}_{name}": modes[f"{field}_{name}"][:count]
        for field, count in zip(FIELDS, mode_counts, strict=True)
        for name in ("modes", "span_rounding")
    }
    larger = [max(mode_counts)]
    found = sweep(scene, method, larger, few, sph, reference, level=logging.DEBUG)
    return found | {
        f"{field}_mode_count": np.array(count)
        for field, count in zip(FIELDS, mode_counts, strict=True)
    }


def prepare_each(models: Iterable[ReducedModel], steps: np.ndarray) -> Iterator[GalerkinRun]:
    """Runs of models of one scene and method, of which each has the modes of the one before.

    Where the particles are seen in every step, up to four models of about the same size run
    together already here, which passes over the modes once for all of them.
    """

    def size(model):
        return (
            -(-len(model.velocity_modes) // GROUP),
            -(-len(model.density_modes) // GROUP),
            freeze_steps(model.method) == 0,
        )

    for (_, _, together), same in groupby(models, size):
        while group := list(islice(same, GROUP)):
            if together and len(group) > 1:
                yield from _four(group, steps)
            else:
                yield from (model.prepare(steps) for model in group)


def _four(models, steps):
    """Runs of two to four models that have run; of fewer than four, the last runs twice."""
    _, start_a, start_b, *arguments = models[-1]._project(steps)
    four = [*models, *[models[-1]] * (GROUP - len(models))]
    mask_a = np.array([np.arange(start_a.size) < len(m.velocity_modes) for m in four], float)
    mask_b = np.array([np.arange(start_b.size) < len(m.density_modes) for m in four], float)
    a, b = mask_a * start_a, mask_b * start_b
    velocity = np.empty((steps.size, *a.shape))
    density = np.empty((steps.size, *b.shape))
    march_four((a, b, mask_a, mask_b), *arguments, steps, (velocity, density))
    for n, model in enumerate(models):
        state = (
            np.ascontiguousarray(velocity[:, n, : len(model.velocity_modes)]),
            np.ascontiguousarray(density[:, n, : len(model.density_modes)]),
        )
        # Nothing is left to run.
        yield model._run(steps, state, lambda state: None)


def acceleration_contenders(n_freeze: Iterable[int]) -> list[str]:
    """Methods of an acceleration study (section 2.4), by falling number of operations."""
    return ["original", "linearized", *(f"frozen{n}" for n in n_freeze)]


def accelerate(
    scene: Scene, n_freeze: Iterable[int], mode_counts: Iterable[int], modes: Arrays, sph: Arrays
) -> dict[str, np.ndarray]:
    """Errors of an acceleration study: original, linearized and frozen models against full SPH.

    Parameters
    ----------
    n_freeze, mode_counts : ints
    modes, sph : dict
        As in ``sweep``.

    Returns
    -------
    dict
        contender and n_freeze (contenders,), mode_count and modes_resolved (counts,),
        acceleration_velocity_error and acceleration_density_error (contenders, counts); infinite
        where a model broke down.
    """
    contenders, counts = acceleration_contenders(n_freeze), list(mode_counts)
    projected = project_solution(sph, modes, max(counts))
    errors = {field: np.full((len(contenders), len(counts)), np.inf) for field in FIELDS}
    for row, method in enumerate(contenders):
        for column, count in enumerate(counts):
            run = model(scene, method, modes, count).prepare(scene.error_steps).run()
            if run.breakdown() is None:
                for field, coordinates in zip(FIELDS, run.state, strict=True):
                    errors[field][row, column] = projected[field].relative_error(coordinates)
    return {
        "contender": np.array(contenders),
        "n_freeze": np.array([freeze_steps(method) for method in contenders]),
        "mode_count": np.array(counts),
        "modes_resolved": modes_resolved(modes, counts),
    } | {f"acceleration_{field}_error": errors[field] for field in FIELDS}


def modes_resolved(modes: Arrays, counts: Iterable[int]) -> np.ndarray:
    """Whether models with so many modes depend on them to more than rounding (`pod.resolved`).

    Parameters
    ----------
    modes : dict
        velocity_span_rounding, density_span_rounding.
    counts : ints
        Modes for velocity and density each, or all there are.

    Returns
    -------
    bool array, shape (counts,)
    """
    counts = list(counts)
    velocity, density = (resolved(counts, modes[f"{field}_span_rounding"]) for field in FIELDS)
    return velocity & density


def model(
    scene: Scene, method: str, modes: Arrays, count: int, level: int = logging.WARNING
) -> ReducedModel:
    """Model with so many modes for velocity and density each, or all, as the log reports."""
    check_ends(scene)
    velocity_modes, density_modes = (modes[f"{field}_modes"] for field in FIELDS)
    if min(len(velocity_modes), len(density_modes)) < count:
        logger.log(
            level,
            "scene %s: %d modes asked for, the snapshots hold %d of velocity and %d of density",
            scene.name, count, len(velocity_modes), len(density_modes),
        )  # fmt: skip
    return galerkin(scene, method, modes, count)


def galerkin(scene: Scene, method: str, modes: Arrays, count: int) -> ReducedModel:
    """The same, of which nothing is reported."""
    return ReducedModel(scene, method, *(modes[f"{field}_modes"][:count] for field in FIELDS))


NEAREST_CACHE = 32768
"""Bytes that are read about as fast as they are computed with."""


def tensor_is_cheaper(kv: int, kr: int, particle_count: int, n_freeze: int) -> bool:
    """Whether frozen coefficients take less time a step without the particles, by operations.

    With the tensor a step costs kv kρ, and a refresh kv kρ for each of the kρ(kρ+1)/2 products of
    density coordinates, or twice as much if the nearest cache does not hold the tensor; on the
    particles a step costs N (kv + kρ), and a refresh N kρ.
    """
    refresh = kv * kr * kr * (kr + 1) / 2
    far = 2 if 8 * refresh > NEAREST_CACHE else 1
    with_tensor = kv * kr + far * refresh / n_freeze
    on_particles = particle_count * (kv + kr) + particle_count * kr / n_freeze
    return with_tensor < on_particles


def _quadratic_tensor(stretch, density_modes, kr):
    """T[q ≤ r, (m, p)]: as ρ² is quadratic in b, -Δt Cᵀ is Σ T b_q b_r (padded modes given)."""
    pairs = [(q, r) for q in range(kr) for r in range(q, kr)]
    twice = np.array([1 if q == r else 2 for q, r in pairs])
    products = np.array([density_modes[q] * density_modes[r] for q, r in pairs])
    matrices = stretch[:, None, :] * density_modes[None, :, :]
    return _padded((twice[:, None] * products) @ matrices.reshape(-1, stretch.shape[1]).T)


def _padded(array, both=False):
    """Zeros appended to the modes (first axis, or both) until whole groups of them are there."""
    if array.size == 0:
        return array
    missing = -np.array(array.shape) % GROUP
    widths = [(0, m if axis == 0 or both else 0) for axis, m in enumerate(missing)]
    return np.ascontiguousarray(np.pad(array, widths))


@compiled
def add_expansion(coordinates, modes, field):
    """field += Σ_m coordinates[m] modes[m], four modes at once."""
    for m in range(0, coordinates.size, 4):
        c0, c1, c2, c3 = coordinates[m], coordinates[m + 1], coordinates[m + 2], coordinates[m + 3]
        for i in range(field.size):
            # From left to right: one fused multiply-add a mode.
            field[i] = (
                field[i]
                + c0 * modes[m, i]
                + c1 * modes[m + 1, i]
                + c2 * modes[m + 2, i]
                + c3 * modes[m + 3, i]
            )


@compiled
def expand(coordinates, modes, field):
    """field = Σ_m coordinates[m] modes[m]."""
    for i in range(field.size):
        field[i] = 0.0
    add_expansion(coordinates, modes, field)


@compiled_sums
def add_projection(field, modes, coordinates):
    """coordinates[m] += Σ_i modes[m, i] field[i], four modes at once."""
    for m in range(0, coordinates.size, 4):
        s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
        for i in range(field.size):
            s0 += modes[m, i] * field[i]
            s1 += modes[m + 1, i] * field[i]
            s2 += modes[m + 2, i] * field[i]
            s3 += modes[m + 3, i] * field[i]
        coordinates[m] += s0
        coordinates[m + 1] += s1
        coordinates[m + 2] += s2
        coordinates[m + 3] += s3


@compiled
def add_push(push, amplitudes, step, result):
    """result += amplitudes of the force in this step times their projections."""
    for r in range(push.shape[0]):
        for m in range(push.shape[1]):
            result[m] += amplitudes[r, step] * push[r, m]


@compiled
def keep(coordinates, row):
    """Copy coordinates, without zeros behind them, into a row of what is kept."""
    for m in range(row.size):
        row[m] = coordinates[m]


@compiled
def change_frozen(force, constant, parts, changes, step):
    """The force of frozen coefficients where c changes with time; ``parts`` is room for both."""
    change(parts, changes, step)
    for n in range(force.shape[0]):
        for m in range(force.shape[1]):
            force[n, m] = parts[n * force.shape[1] + m]
    for m in range(constant.size):
        constant[m] = parts[force.size + m]


@compiled
def march_particles(state, operators, forces, changes, steps, kept):
    """Original and linearized model: the nonlinearity is evaluated on the particles.

    Of all kernels here, ``state`` holds the coordinates of velocity and density, ``changes`` those
    of modulus and damping with time, ``kept`` where coordinates are copied to after the given
    numbers of steps.
    """
    a, b = state
    pull, stretch, density_modes, density0, linear = operators
    decay, damping, amplitudes, push = forces
    stiffening, slowing = changes
    modulus = np.empty(density0.size)
    velocity_coordinates, density_coordinates = kept
    rho, rate = np.empty(density0.size), np.empty(density0.size)
    old_a = a.copy()
    done = 0
    for row in range(steps.size):
        for step in range(done, steps[row]):
            for m in range(a.size):
                old_a[m] = a[m]
                a[m] *= decay
            expand(b, density_modes, rho)
            expand(old_a, stretch, rate)
            for i in range(rho.size):
                rate[i] *= rho[i] * rho[i]
            if linear:
                for i in range(rho.size):
                    rho[i] = rho[i] / density0[i] - 1.0
            else:
                for i in range(rho.size):
                    rho[i] = 1.0 - density0[i] / rho[i]
            if stiffening[0].size:
                change(modulus, stiffening, step)
                for i in range(rho.size):
                    rho[i] *= modulus[i]
            if slowing[0].size:
                change(damping.reshape(-1), slowing, step)
            add_projection(rate, density_modes, b)
            add_projection(rho, pull, a)
            if damping.size:
                add_expansion(old_a, damping, a)
            if amplitudes.size:
                add_push(push, amplitudes, step, a)
        done = steps[row]
        keep(a, velocity_coordinates[row])
        keep(b, density_coordinates[row])


@compiled
def expand_four(coordinates, modes, fields):
    """fields[g] = Σ_m coordinates[g, m] modes[m] of four models, four modes at once."""
    for g in range(4):
        for i in range(fields.shape[1]):
            fields[g, i] = 0.0
    for m in range(0, coordinates.shape[1], 4):
        a0, a1 = coordinates[0, m], coordinates[0, m + 1]
        a2, a3 = coordinates[0, m + 2], coordinates[0, m + 3]
        b0, b1 = coordinates[1, m], coordinates[1, m + 1]
        b2, b3 = coordinates[1, m + 2], coordinates[1, m + 3]
        c0, c1 = coordinates[2, m], coordinates[2, m + 1]
        c2, c3 = coordinates[2, m + 2], coordinates[2, m + 3]
        d0, d1 = coordinates[3, m], coordinates[3, m + 1]
        d2, d3 = coordinates[3, m + 2], coordinates[3, m + 3]
        for i in range(fields.shape[1]):
            u0, u1, u2, u3 = modes[m, i], modes[m + 1, i], modes[m + 2, i], modes[m + 3, i]
            fields[0, i] = fields[0, i] + a0 * u0 + a1 * u1 + a2 * u2 + a3 * u3
            fields[1, i] = fields[1, i] + b0 * u0 + b1 * u1 + b2 * u2 + b3 * u3
            fields[2, i] = fields[2, i] + c0 * u0 + c1 * u1 + c2 * u2 + c3 * u3
            fields[3, i] = fields[3, i] + d0 * u0 + d1 * u1 + d2 * u2 + d3 * u3


@compiled_sums
def add_projection_four(fields, modes, mask, coordinates):
    """coordinates[g, m] += mask[g, m] Σ_i modes[m, i] fields[g, i] of four models."""
    for m in range(0, coordinates.shape[1], 4):
        a0 = a1 = a2 = a3 = b0 = b1 = b2 = b3 = 0.0
        c0 = c1 = c2 = c3 = d0 = d1 = d2 = d3 = 0.0
        for i in range(fields.shape[1]):
            u0, u1, u2, u3 = modes[m, i], modes[m + 1, i], modes[m + 2, i], modes[m + 3, i]
            a, b, c, d = fields[0, i], fields[1, i], fields[2, i], fields[3, i]
            a0, a1, a2, a3 = a0 + u0 * a, a1 + u1 * a, a2 + u2 * a, a3 + u3 * a
            b0, b1, b2, b3 = b0 + u0 * b, b1 + u1 * b, b2 + u2 * b, b3 + u3 * b
            c0, c1, c2, c3 = c0 + u0 * c, c1 + u1 * c, c2 + u2 * c, c3 + u3 * c
            d0, d1, d2, d3 = d0 + u0 * d, d1 + u1 * d, d2 + u2 * d, d3 + u3 * d
        sums = ((a0, a1, a2, a3), (b0, b1, b2, b3), (c0, c1, c2, c3), (d0, d1, d2, d3))
        for g in range(4):
            for n in range(4):
                coordinates[g, m + n] += mask[g, m + n] * sums[g][n]


@compiled
def march_four(state, operators, forces, changes, steps, kept):
    """As march_particles, for four models whose modes are the first of the same modes.

    The state holds masks too, which are zero at the modes that a model does not have.
    """
    a, b, mask_a, mask_b = state
    pull, stretch, density_modes, density0, linear = operators
    decay, damping, amplitudes, push = forces
    stiffening, slowing = changes
    modulus = np.empty(density0.size)
    velocity_coordinates, density_coordinates = kept
    rho, rate = np.empty((4, density0.size)), np.empty((4, density0.size))
    old_a = a.copy()
    done = 0
    for row in range(steps.size):
        for step in range(done, steps[row]):
            for g in range(4):
                for m in range(a.shape[1]):
                    old_a[g, m] = a[g, m]
                    a[g, m] *= decay
            expand_four(b, density_modes, rho)
            expand_four(old_a, stretch, rate)
            for g in range(4):
                if linear:
                    for i in range(density0.size):
                        rate[g, i] *= rho[g, i] * rho[g, i]
                        rho[g, i] = rho[g, i] / density0[i] - 1.0
                else:
                    for i in range(density0.size):
                        rate[g, i] *= rho[g, i] * rho[g, i]
                        rho[g, i] = 1.0 - density0[i] / rho[g, i]
            if stiffening[0].size:
                change(modulus, stiffening, step)
                for g in range(4):
                    for i in range(density0.size):
                        rho[g, i] *= modulus[i]
            if slowing[0].size:
                change(damping.reshape(-1), slowing, step)
            add_projection_four(rate, density_modes, mask_b, b)
            add_projection_four(rho, pull, mask_a, a)
            if damping.size:
                for g in range(4):
                    for n in range(damping.shape[0]):
                        for m in range(damping.shape[0]):
                            a[g, m] += mask_a[g, m] * damping[n, m] * old_a[g, n]
            for r in range(push.shape[0]):
                for g in range(4):
                    for m in range(push.shape[1]):
                        a[g, m] += mask_a[g, m] * push[r, m] * amplitudes[r, step]
        done = steps[row]
        for g in range(4):
            for m in range(a.shape[1]):
                velocity_coordinates[row, g, m] = a[g, m]
            for m in range(b.shape[1]):
                density_coordinates[row, g, m] = b[g, m]


@compiled
def refresh(b, kr, products, tensor, matrix):
    """-Δt Cᵀ = Σ_{q ≤ r} T[q, r] b_q b_r, flattened."""
    pair = 0
    for q in range(kr):
        for r in range(q, kr):
            products[pair] = b[q] * b[r]
            pair += 1
    expand(products, tensor, matrix)


@compiled
def march_frozen(state, operators, forces, changes, steps, kept):
    """Frozen coefficients: wholly in reduced coordinates if there is a tensor; else with ρ² kept on
    the particles between refreshes."""
    a, b = state
    force, constant, tensor, stretch, density_modes, n_freeze = operators
    decay, damping, amplitudes, push = forces
    stiffening, slowing = changes
    parts = np.empty(force.size + constant.size)
    velocity_coordinates, density_coordinates = kept
    squares, rate = np.empty(density_modes.shape[1]), np.empty(density_modes.shape[1])
    products, flat = np.zeros(tensor.shape[0]), np.empty(a.size * b.size)
    matrix = flat.reshape(a.size, b.size)
    old_a = a.copy()
    done = 0
    for row in range(steps.size):
        for step in range(done, steps[row]):
            if step % n_freeze == 0:
                if tensor.size:
                    refresh(b, density_coordinates.shape[1], products, tensor, flat)
                else:
                    expand(b, density_modes, squares)
                    for i in range(squares.size):
                        squares[i] *= squares[i]
                if stiffening[0].size:
                    change_frozen(force, constant, parts, stiffening, step)
                if slowing[0].size:
                    change(damping.reshape(-1), slowing, step)
            for m in range(a.size):
                old_a[m] = a[m]
                a[m] = decay * a[m] + constant[m]
            add_expansion(b, force, a)
            if damping.size:
                add_expansion(old_a, damping, a)
            if amplitudes.size:
                add_push(push, amplitudes, step - step % n_freeze, a)
            if tensor.size:
                add_expansion(old_a, matrix, b)
            else:
                expand(old_a, stretch, rate)
                for i in range(rate.size):
                    rate[i] *= squares[i]
                add_projection(rate, density_modes, b)
        done = steps[row]
        keep(a, velocity_coordinates[row])
        keep(b, density_coordinates[row])
