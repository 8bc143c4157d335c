"""Lifted reduced models: SPH in velocity and strain, projected on modes of its energy.

Snapshots are scaled to √m v and √(V c) e, so that orthonormal modes are orthonormal in the energy.
Galerkin projection gives, for any modes Φ and Ψ and any number of them,

    a' = -D a + B b + g f(t),    b' = -Bᵀ a,    B = Φᵀ A Ψ,    D = Φᵀ diag(d) Φ ⪰ 0,

whose energy |a|² + |b|² nothing but damping and force changes: no choice of modes makes it grow.

Translation carries the total momentum and strains nothing, but modes of plain snapshots mix it into
waves, which a force then excites. It is a mode of its own wherever it takes part, the first.

Nothing is stepped. Under uniform damping the singular values of B are the frequencies of normal
modes, each a damped oscillator; otherwise the eigenvectors of the operator give such pairs, or, if
they are ill-conditioned, the model is one block. `sphpod.numerics.propagator` carries them from
output to output, exactly in time (``lifted_exact``) or as explicit Euler would go
(``lifted_euler``).

Where modulus or damping change with time, models are stepped (`sphpod.reduced.reduced_in_time`).

Long: modes, model and its run share the model's own modes.
"""

import logging
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from sphpod.full import lifted
from sphpod.numerics import propagator
from sphpod.numerics.error import FIELDS, Arrays, blocks, share
from sphpod.numerics.propagator import Jumps
from sphpod.reduced import reduced_in_time
from sphpod.reduced.pod import Modes, checked, named, resolved
from sphpod.reduced.pod import modes as proper_modes
from sphpod.reduced.reduced_in_time import Steps
from sphpod.reduced.sweep import ReducedRun, failed, report_level, sweep
from sphpod.scene.breakdown import RESOLVED, Breakdown, first_broken
from sphpod.scene.run import Run
from sphpod.scene.scene import Scene

logger = logging.getLogger(__name__)

METHODS = ("lifted_euler", "lifted_exact")

ILL_CONDITIONED = 1e6
"""Condition number of eigenvectors from which a model is carried as one block."""


def decompose(scene: Scene, snapshots: Arrays) -> dict[str, np.ndarray]:
    """Energy-orthonormal modes of velocity and strain snapshots.

    Parameters
    ----------
    snapshots : dict
        velocity_snapshots (n, N) [m/s]; density_snapshots (m, N) [kg/m³] or strain_snapshots; and
        velocity_twins, density_twins or strain_twins of the same shapes, where there are
        (`rounding.twins`).

    Returns
    -------
    dict
        x (N,); scaled_velocity_modes, scaled_strain_modes (modes, N), of singular values that are
        not zero; scaled_velocity_singular_values, scaled_strain_singular_values; how far rounding
        turns them, scaled_velocity_mode_rounding, scaled_velocity_span_rounding and those of the
        strain, as in `pod.Modes`; translation, 1 if the first velocity mode is the rigid
        translation, else 0.

    Raises
    ------
    ValueError
        There is no snapshot, a value is not finite, a density not positive or a strain not above
        -1; or nothing moves in the snapshots, of a scene that moves from the start.
    """

    def given(name, above):
        return checked(f"scene {scene.name}: {name}", snapshots[name], above)

    mass, stiffness = lifted.energy_weights(scene)
    velocity = mass * given("velocity_snapshots", -np.inf)
    if "strain_snapshots" in snapshots:
        strain = given("strain_snapshots", -1)
    else:
        strain = lifted.strain(scene, given("density_snapshots", 0))
    rigid = (mass / np.linalg.norm(mass))[None] if scene.translates else np.zeros((0, mass.size))
    velocity_twins, strain_twins = None, None
    if "velocity_twins" in snapshots:
        velocity_twins = mass * given("velocity_twins", -np.inf)
        velocity_twins = velocity_twins - velocity_twins @ rigid.T @ rigid
    if "strain_twins" in snapshots:
        strain_twins = stiffness * given("strain_twins", -1)
    elif "density_twins" in snapshots:
        strain_twins = stiffness * lifted.strain(scene, given("density_twins", 0))
    shares = velocity @ rigid.T
    found = _modes(velocity - shares @ rigid, velocity_twins, np.linalg.norm(shares))
    strain_found = _modes(stiffness * strain, strain_twins)
    if not len(rigid) and not len(found.modes) and not np.any(scene.velocity0()):
        # Any mode does for a scene at rest; this one does not strain evenly spaced particles.
        found = Modes((mass / np.linalg.norm(mass))[None], *np.zeros((3, 1)))
    velocity_modes = np.concatenate([rigid, found.modes])
    if not len(velocity_modes):
        raise ValueError(
            f"scene {scene.name}: velocity_snapshots: all values are 0 and no translation takes "
            "part: a model needs at least one velocity mode"
        )
    # Subtracted translation is orthogonal but for rounding, which modes of small values magnify.
    if len(rigid):
        columns, shares_left = np.linalg.qr(velocity_modes.T)
        velocity_modes = (columns * np.sign(np.diag(shares_left))).T
    # Nothing turns the translation, which is no mode of snapshots.
    still = np.zeros(len(rigid))
    velocity_found = Modes(
        velocity_modes,
        np.concatenate([np.linalg.norm(shares, axis=0), found.singular_values]),
        np.concatenate([still, found.rounding]),
        np.concatenate([still, found.span_rounding]),
    )
    return {
        "x": scene.positions,
        **named("scaled_velocity", velocity_found),
        **named("scaled_strain", strain_found),
        "translation": np.array(len(rigid)),
    }


def _modes(snapshots, twins, removed=0.0):
    """Modes of singular values that are not zero, as a matrix's numerical rank counts them.

    What was removed from the snapshots, of that size, has left its rounding errors in them.
    """
    found = proper_modes(snapshots, twins)
    largest = found.singular_values[0]
    zero = max(snapshots.shape) * np.finfo(float).eps * np.hypot(largest, removed)
    rank = np.count_nonzero(found.singular_values > zero)
    return Modes(*(array[:rank] for array in found))


def modes_resolved(modes: Arrays, counts: Iterable[int]) -> np.ndarray:
    """Whether models with so many modes depend on them to more than rounding (`pod.resolved`).

    Parameters are those of `build`; array, shape (counts,).
    """
    velocity = np.minimum(list(counts), len(modes["scaled_velocity_modes"]))
    strain = velocity - int(modes["translation"])
    return resolved(velocity, modes["scaled_velocity_span_rounding"]) & resolved(
        strain, modes["scaled_strain_span_rounding"]
    )


def build(
    scene: Scene, modes: Arrays, count: int | None = None, level: int = logging.WARNING
) -> "LiftedModel":
    """Model with so many velocity modes, and a strain mode for each wave.

    Where the snapshots hold fewer, the model has all there are, and the log reports it.

    Parameters
    ----------
    modes : dict
        As from `decompose`.
    count : int, optional
        Velocity modes; all there are if not given.
    level : int
        At what level of logging fewer are reported.
    """
    velocity_modes = modes["scaled_velocity_modes"][:count]
    rigid = int(modes["translation"])
    strain_modes = modes["scaled_strain_modes"][: len(velocity_modes) - rigid]
    if count is not None and min(len(velocity_modes), len(strain_modes) + rigid) < count:
        logger.log(
            level,
            "scene %s: %d modes asked for, the snapshots hold %d of velocity and %d of strain",
            scene.name, count, len(modes["scaled_velocity_modes"]),
            len(modes["scaled_strain_modes"]),
        )  # fmt: skip
    return LiftedModel(scene, velocity_modes, strain_modes, rigid)


@dataclass(frozen=True)
class LiftedModel:
    """A scene projected on modes of its energy.

    Attributes
    ----------
    velocity_modes, strain_modes : arrays, shapes (kv, N) and (ke, N)
        Orthonormal modes of the scaled fields, one a row.
    translation : int
        1 if the first velocity mode is the rigid translation, else 0.
    """

    scene: Scene
    velocity_modes: np.ndarray
    strain_modes: np.ndarray
    translation: int

    @cached_property
    def coupling(self) -> np.ndarray:
        """B = Φᵀ A Ψ [1/s], shape (kv, ke)."""
        return self.velocity_modes @ lifted.pull(self.scene, self.strain_modes).T

    @cached_property
    def damping(self) -> np.ndarray:
        """D = Φᵀ diag(d) Φ [1/s], shape (kv, kv)."""
        values = self.scene.damping_values()
        if not values.size:
            return np.zeros((len(self.velocity_modes),) * 2)
        return (self.velocity_modes * values) @ self.velocity_modes.T

    @cached_property
    def force(self) -> np.ndarray:
        """g = Φᵀ √m times the profiles of the force, shape (kv, terms)."""
        _, profiles = self.scene.force_values(np.zeros(1))
        if not profiles.size:
            return np.zeros((len(self.velocity_modes), 0))
        mass, _ = lifted.energy_weights(self.scene)
        force = self.velocity_modes @ (mass * profiles).T
        # A uniform force moves the translation alone; on the rest it is rounding.
        sizes = np.linalg.norm(mass * profiles, axis=1)
        return np.where(np.abs(force) > 1e-13 * sizes, force, 0)

    @property
    def operator(self) -> np.ndarray:
        """[[-D, B], [-Bᵀ, 0]] [1/s], shape (kv + ke, kv + ke)."""
        none = np.zeros((len(self.strain_modes),) * 2)
        return np.block([[-self.damping, self.coupling], [-self.coupling.T, none]])

    def system(self) -> dict[str, np.ndarray]:
        """The model as a linear system x' = A x + F f(t), of the coordinates x of both fields.

        Returns
        -------
        dict
            As from `rom.ReducedModel.system`, with strain_output in the place of density_output
            and no reduced_constant.
        """
        if not self.scene.is_steady:
            return {}
        force = self.force if self.force.size else np.zeros((len(self.force), 1))
        mass, stiffness = lifted.energy_weights(self.scene)
        kv, ke = len(self.velocity_modes), len(self.strain_modes)
        return {
            "reduced_operator": self.operator,
            "reduced_force": np.pad(force, ((0, ke), (0, 0))),
            "velocity_output": np.pad(self.velocity_modes / mass, ((0, ke), (0, 0))),
            "strain_output": np.pad(self.strain_modes / stiffness, ((kv, 0), (0, 0))),
        }

    @cached_property
    def own(self) -> "OwnModes":
        """The model in the modes of its operator; in its own where that changes with time."""
        if self.scene.is_stepped:
            return OwnModes(self.operator[None], 0, np.eye(len(self.operator)), True, True)
        damping = self.scene.damping_values()
        if damping.size and damping.min() < damping.max():
            return eigenmodes(self.operator)
        uniform = float(damping[0]) if damping.size else 0.0
        return normal_modes(self.coupling, self.translation, uniform)

    def prepare(
        self, method: str, start: tuple[np.ndarray, np.ndarray] | None = None
    ) -> "LiftedRun":
        """All that precedes a run: own modes, jumps, and what the force adds.

        Parameters
        ----------
        method : {"lifted_euler", "lifted_exact"}
        start : (velocity_coordinates, strain_coordinates), shapes (kv,) and (ke,), optional
            Coordinates at t = 0; those of the scene's initial state if not given.
        """
        scene, own = self.scene, self.own
        euler_steps = {"lifted_euler": scene.error_stride, "lifted_exact": 0}[method]
        kv = len(self.velocity_modes)
        back = own.from_modes
        mass, stiffness = lifted.energy_weights(scene)
        from_fields = back[:, :kv] @ (self.velocity_modes * mass)
        if scene.start:
            from_strain = back[:, kv:] @ (self.strain_modes * stiffness)
            from_fields = np.hstack([from_fields, from_strain])
        begun = from_fields @ scene.starting_state()
        if start is not None:
            begun = back @ np.concatenate(start)
        jumps: Jumps | Steps
        if scene.is_stepped:
            jumps = Steps(reduced_in_time.Terms.of(self), euler_steps > 0)
        else:
            jumps = propagator.prepare(
                own.blocks,
                own.singles,
                own.forces_in_blocks(back[:, :kv] @ self.force),
                scene.error_interval,
                scene.error_times.size,
                scene.courses(),
                euler_steps,
            )
        name, times = f"the lifted model with {kv} modes", scene.error_times
        state = (np.zeros((begun.size, times.size)),)
        return LiftedRun(scene, name, times, state, self, method, jumps, begun)

    def lengths(self, velocity: np.ndarray, strain: np.ndarray) -> np.ndarray:
        """Energy norms of coordinates (times, kv) and (times, ke) at the outputs, (times,)."""
        squares = np.einsum("tm,tm->t", velocity, velocity)
        if self.scene.changing("youngs_modulus") is None:
            return np.sqrt(squares + np.einsum("tm,tm->t", strain, strain))
        metrics = reduced_in_time.Terms.of(self).metrics
        times = self.scene.error_times
        for rows in blocks(times.size):
            some = strain[rows]
            squares[rows] += np.einsum("tm,tmn,tn->t", some, metrics(times[rows]), some)
        return np.sqrt(squares)


@dataclass(frozen=True)
class OwnModes:
    """A reduced operator that has fallen apart into blocks.

    Attributes
    ----------
    blocks : array, shape (n, 2, 2) or (1, s, s)
        As in `propagator.prepare` [1/s].
    to_modes : array, shape (kv + ke, coordinates)
        Own coordinates to those in the modes of velocity and strain.
    orthogonal : bool
        Whether ``to_modes`` is, so that lengths are kept.
    apart : bool
        Whether the α are coordinates of the velocity alone and the β of the strain.
    """

    blocks: np.ndarray
    singles: int
    to_modes: np.ndarray
    orthogonal: bool
    apart: bool

    @cached_property
    def from_modes(self) -> np.ndarray:
        """The inverse of ``to_modes``."""
        return self.to_modes.T if self.orthogonal else np.linalg.inv(self.to_modes)

    @cached_property
    def members(self) -> list[np.ndarray]:
        """Own coordinates of each block."""
        if self.blocks.shape[-1] > 2:
            return [np.arange(self.blocks.shape[-1])]
        count = len(self.blocks)
        pairs = [np.array([n, count + n]) for n in range(count - self.singles)]
        return [*pairs, *(np.array([n]) for n in range(count - self.singles, count))]

    @cached_property
    def operator(self) -> np.ndarray:
        """The reduced operator of the own coordinates [1/s], (coordinates, coordinates)."""
        return self.times_operator(np.eye(len(self.to_modes)))

    def times_operator(self, columns: np.ndarray) -> np.ndarray:
        """Columns (…, coordinates) times the operator, block by block."""
        if self.blocks.shape[-1] > 2:
            return columns @ self.blocks[0]
        count, pairs = len(self.blocks), len(self.to_modes) - len(self.blocks)
        first, second = columns[..., :count], columns[..., count:]
        result = np.empty_like(columns)
        result[..., :count] = first * self.blocks[:, 0, 0]
        result[..., :pairs] += second * self.blocks[:pairs, 1, 0]
        result[..., count:] = first[..., :pairs] * self.blocks[:pairs, 0, 1]
        result[..., count:] += second * self.blocks[:pairs, 1, 1]
        return result

    def forces_in_blocks(self, forces: np.ndarray) -> np.ndarray:
        """Forces on own coordinates (coordinates, terms) as `propagator.prepare` takes them."""
        forces = forces.T
        if self.blocks.shape[-1] > 2:
            return forces[:, None]
        count = len(self.blocks)
        second = np.pad(forces[:, count:], ((0, 0), (0, self.singles)))
        return np.stack([forces[:, :count], second], axis=2)


def normal_modes(coupling: np.ndarray, rigid: int, damping: float) -> OwnModes:
    """Under uniform damping: singular vectors of B pair velocity with strain."""
    left, frequencies, right = np.linalg.svd(coupling[rigid:])
    return oscillators(left, frequencies, right.T, rigid, damping)


def oscillators(
    velocity: np.ndarray, frequencies: np.ndarray, strain: np.ndarray, rigid: int, damping: float
) -> OwnModes:
    """Pairs of velocity and strain, one a column, that turn into each other, and translations."""
    kv, ke = len(velocity) + rigid, len(strain)
    blocks = np.zeros((kv, 2, 2))
    blocks[:, 0, 0] = -damping
    pairs = np.arange(frequencies.size)
    blocks[pairs, 0, 1], blocks[pairs, 1, 0] = frequencies, -frequencies
    to_modes = np.zeros((kv + ke, kv + ke))
    # Waves first, those without a strain of their own behind; the translation, a single, is last.
    to_modes[rigid:kv, : kv - rigid] = velocity
    to_modes[:rigid, kv - rigid : kv] = np.eye(rigid)
    to_modes[kv:, kv:] = strain
    return OwnModes(blocks, kv - ke, to_modes, orthogonal=True, apart=True)


def eigenmodes(operator: np.ndarray) -> OwnModes:
    """Otherwise: eigenvectors, real and imaginary part of each conjugate pair."""
    values, vectors = np.linalg.eig(operator)
    whole = np.flatnonzero(values.imag == 0)
    upper = np.flatnonzero(values.imag > 0)
    to_modes = np.concatenate(
        [vectors[:, upper].real, vectors[:, whole].real, vectors[:, upper].imag], axis=1
    )
    if np.linalg.cond(to_modes) > ILL_CONDITIONED:
        return OwnModes(operator[None], 0, np.eye(len(operator)), orthogonal=True, apart=False)
    blocks = np.zeros((upper.size + whole.size, 2, 2))
    pairs = blocks[: upper.size]
    pairs[:, 0, 0] = pairs[:, 1, 1] = values[upper].real
    pairs[:, 1, 0] = -values[upper].imag
    pairs[:, 0, 1] = values[upper].imag
    blocks[upper.size :, 0, 0] = values[whole].real
    return OwnModes(blocks, whole.size, to_modes, orthogonal=False, apart=False)


@dataclass
class LiftedRun(ReducedRun):
    """A run of a lifted model: its state are the own coordinates, (coordinates, times).

    Attributes
    ----------
    jumps : Jumps, or Steps where coefficients change with time
    begun : array, shape (coordinates,)
        Own coordinates at t = 0.
    """

    reduced: LiftedModel
    method: str
    jumps: Jumps | Steps
    begun: np.ndarray

    def run(self) -> Self:
        (state,) = self.state
        state[:, 0] = self.begun
        self.jumps.run(state)
        return self

    def coordinates(self) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates in the modes of velocity and strain, (times, kv) and (times, ke)."""
        kv = len(self.reduced.velocity_modes)
        both = self.state[0].T @ self.reduced.own.to_modes.T
        return np.ascontiguousarray(both[:, :kv]), np.ascontiguousarray(both[:, kv:])

    def breakdown(self) -> Breakdown | None:
        return self.breakdown_at_outputs() or self._breakdown_between()

    def breakdown_at_outputs(self) -> Breakdown | None:
        """Where it is not finite, or a Jacobian 1 + e not positive.

        |e_i| is at most the length of the coordinates times that of the particle's entries in the
        modes: a test that is usually enough, and sees no particle but once. J is reconstructed only
        at the times at which the test fails.
        """
        velocity, strain = self.coordinates()
        finite = np.isfinite(velocity).all(axis=1) & np.isfinite(strain).all(axis=1)
        last = len(finite) if finite.all() else int(np.argmin(finite))
        _, stiffness = lifted.energy_weights(self.scene)
        shapes = self.reduced.strain_modes / stiffness
        reach = np.linalg.norm(shapes, axis=0).max(initial=0)
        with np.errstate(over="ignore"):
            lengths = np.linalg.norm(strain[:last], axis=1)
        row, particle = first_broken(-1, strain, shapes, np.flatnonzero(lengths * reach >= 1))
        if row >= 0:
            return self.broken_at(row, particle)
        return None if finite.all() else self.broken_at(last, 0)

    def _breakdown_between(self):
        """How what is sound at its outputs broke down between them.

        If they do not resolve the fastest wave, the model runs again with more of them; unless
        energy excludes a fold: |e_i| is at most the length of all coordinates times that of the
        particle's entries in the modes, and that length grows by the force alone, in explicit
        Euler also by √(1 + Δt² ω² + Δt² ω d) a step.
        """
        scene, model, interval = self.scene, self.reduced, self.scene.error_interval
        if not model.coupling.size:
            return None
        fastest = float(np.linalg.norm(model.coupling, 2))
        if not scene.is_steady:
            fastest *= np.sqrt(np.max(scene.largest_modulus() / scene.modulus()))
        parts = int(np.ceil(fastest * interval / RESOLVED))
        if parts <= 1 or (self.method == "lifted_euler" and scene.error_stride == 1):
            return None
        growth, step = 1.0, interval / parts
        if self.method == "lifted_euler":
            stride, step = scene.error_stride, scene.time_step
            parts = next(n for n in range(min(parts, stride), stride + 1) if stride % n == 0)
            damping = float(scene.damping_values().max(initial=0.0)) * step
            z = fastest * step
            growth = (1 + z**2 + z * damping) ** (stride / 2) if damping <= 2 else np.inf
        velocity, strain = self.coordinates()
        lengths = np.hypot(np.linalg.norm(velocity, axis=1), np.linalg.norm(strain, axis=1))
        for force, course in zip(model.force.T, scene.courses(), strict=True):
            lengths[:-1] += np.linalg.norm(force) * np.diff(course.impulse(scene.error_times))
        _, stiffness = lifted.energy_weights(scene)
        reach = np.linalg.norm(model.strain_modes / stiffness, axis=0).max()
        if scene.is_steady and (growth * lengths[:-1] * reach < 0.99).all():
            return None
        finer = replace(scene, error_interval=interval / parts, time_step=step)
        run = replace(model, scene=finer).prepare(self.method)
        return replace(run, begun=self.begun).run().breakdown_at_outputs()

    def stored(self) -> dict[str, np.ndarray]:
        """The coordinates; where models are stepped also `reduced_in_time.Steps.time_error`."""
        velocity, strain = self.coordinates()
        found = {
            "t": self.times,
            "scaled_velocity_coordinates": velocity,
            "scaled_strain_coordinates": strain,
        }
        if isinstance(self.jumps, Steps) and not self.jumps.euler:
            found["time_error_estimate"] = np.array(self.jumps.time_error)
        return found

    @cached_property
    def shapes(self) -> tuple[np.ndarray, np.ndarray]:
        """Own modes as velocity [m/s] and as strain, shapes (coordinates, N) each."""
        model, own = self.reduced, self.reduced.own
        mass, stiffness = lifted.energy_weights(model.scene)
        kv = len(model.velocity_modes)
        velocity = own.to_modes[:kv].T @ (model.velocity_modes / mass)
        strain = own.to_modes[kv:].T @ (model.strain_modes / stiffness)
        return (velocity[:kv], strain[kv:]) if own.apart else (velocity, strain)

    def expansions(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        kv, both = len(self.reduced.velocity_modes), self.state[0].T
        parts = (both[:, :kv], both[:, kv:]) if self.reduced.own.apart else (both, both)
        return dict(zip(("velocity", "strain"), zip(parts, self.shapes, strict=True), strict=True))


def repeat_sph(
    scene: Scene, mode_counts: Iterable[int], modes: Arrays, full: Arrays, reference: Arrays
) -> dict[str, np.ndarray]:
    """Errors of ``lifted_euler`` for several mode counts; its coordinates, if it is only one.

    Parameters, returns and errors are those of `rom.sweep`, with modes as from `decompose`, and
    with scaled_velocity_coordinates and scaled_strain_coordinates.
    """
    counts = list(mode_counts)
    solutions = {"sph": full, "reference": reference}

    def measure(run):
        return {
            f"{field}_error_{name}": error
            for name, fields in solutions.items()
            for field, error in field_errors(run, fields).items()
        }

    runs = prepare_each(scene, counts, modes, "lifted_euler")
    arrays = sweep(counts, runs, measure, failed(FIELDS, *solutions))
    return arrays | {"modes_resolved": modes_resolved(modes, counts)}


def prepare_each(
    scene: Scene, mode_counts: Sequence[int], modes: Arrays, method: str
) -> Iterator[LiftedRun]:
    """A run for each mode count."""
    for count in mode_counts:
        yield build(scene, modes, count, report_level(mode_counts)).prepare(method)


def field_errors(run: Run, solution: Arrays) -> dict[str, float]:
    """Relative errors of velocity and density (section 3.1) against a solution (times, N).

    The fields are reconstructed a few outputs at a time.
    """
    wrong, right = dict.fromkeys(FIELDS, 0.0), dict.fromkeys(FIELDS, 0.0)
    for rows in blocks(run.times.size):
        for field, values in lifted.with_density(run, rows).items():
            expected = solution[field][rows]
            difference = values - expected
            wrong[field] += np.vdot(difference, difference)
            right[field] += np.vdot(expected, expected)
    return {field: share(np.sqrt(wrong[field]), np.sqrt(right[field])) for field in FIELDS}
