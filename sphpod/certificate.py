"""How far a lifted reduced model is from its full model, told without the full model.

Both are exact in time, with S the own modes of the reduced operator as scaled fields, so that the
reduced solution is S z(t), z' = M z + h f. The error ε = x - S z obeys

    ε' = 𝓐 ε + r,    r = (𝓐 S - S M) z + (F - S h) f,

and as the full operator 𝓐 lets no energy grow, its energy norm is bounded by

    |ε(t)| ≤ |ε(0)| + ∫ |r| ds.

Integrated so, a residual that merely oscillates counts as if it pushed one way all the time. But
for any corrections X of the modes, ε - X z obeys the same equation with the residual

    r_X = (𝓐 (S + X) - (S + X) M) z + (F - (S + X) h) f,

so that also

    |ε(t)| ≤ |X z(t)| + |ε(0) - X z(0)| + ∫ |r_X| ds.

X is chosen to make the sum small: a wave that the residual drives off its own frequency goes into
X, one that it drives in resonance, whose error does grow with time, stays in r_X. Whatever X is,
the bound holds. All norms are of QR factors of the size of the reduced model; a Gram matrix would
lose half their digits.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from sphpod import lifted, lifted_rom
from sphpod.error import blocks
from sphpod.lifted_rom import LiftedModel, Prepared
from sphpod.scene import Scene
from sphpod.stability import Breakdown

SUBDIVISIONS = 16
"""Parts of an output interval at whose ends the force is looked at, for its rates of change."""

CRITICAL = 1e6
"""Condition number of a block's eigenvectors from which its modes are left uncorrected."""


def certify(
    scene: Scene,
    mode_counts: Iterable[int],
    modes: Mapping[str, np.ndarray],
    full: Mapping[str, np.ndarray],
    reference: Mapping[str, np.ndarray],
) -> dict[str, np.ndarray]:
    """Errors of ``lifted_exact`` beside their bounds; its coordinates for a single mode count.

    Parameters
    ----------
    scene : Scene
    mode_counts : ints
        Velocity modes, or all there are.
    modes : dict
        As from `lifted_rom.decompose`.
    full : dict
        velocity and strain (times, N) of the lifted full model, exact in time.
    reference : dict
        velocity and density (times, N).

    Returns
    -------
    dict
        mode_count; velocity_error_reference, density_error_reference; against the lifted full
        model velocity_error_lifted, strain_error_lifted, relative in the norms of kinetic and of
        elastic energy over all times; and of the largest energy norm over time: the largest error
        energy_error_lifted, its bound energy_error_bound, the bound residual_bound without
        corrected modes, and difference_from_best, how far the model is from the one with all modes
        of the snapshots, and bound_slack, the smallest difference of bound and error over time;
        breakdown_time; modes_resolved, as from `lifted_rom.modes_resolved`. For a single count also
        t, scaled_velocity_coordinates, scaled_strain_coordinates and error_bound (times,).

    Raises
    ------
    Breakdown
        The model for a single mode count broke down; in a sweep, its errors are infinite.
    """
    counts = list(mode_counts)
    arrays = lifted_rom.no_errors(counts, "reference")
    names = (
        "velocity_error_lifted", "strain_error_lifted", "energy_error_lifted", "energy_error_bound",
        "residual_bound", "difference_from_best",
    )  # fmt: skip
    arrays |= {name: np.full(len(counts), np.inf) for name in names}
    arrays["bound_slack"] = np.full(len(counts), np.nan)
    arrays["modes_resolved"] = lifted_rom.modes_resolved(modes, counts)
    scales = lifted.energy_weights(scene)
    velocity, strain = (
        Seen.of(full[field], scale, modes[f"scaled_{field}_modes"][: max(counts)])
        for field, scale in zip(("velocity", "strain"), scales, strict=True)
    )
    norms = np.sqrt(velocity.total + strain.total)
    best = Best.of(scene, modes)
    for n, count in enumerate(counts):
        model = lifted_rom.build(scene, modes, count)
        prepared = model.prepare("lifted_exact")
        try:
            state = prepared.solve()
        except Breakdown as breakdown:
            if len(counts) == 1:
                raise
            arrays["breakdown_time"][n] = breakdown.time
            continue
        for field, error in lifted_rom.field_errors(prepared, state, reference).items():
            arrays[f"{field}_error_reference"][n] = error
        a, b = model.coordinates(state)
        squares = velocity.squares(a), strain.squares(b)
        for name, seen, square in zip(names, (velocity, strain), squares, strict=False):
            arrays[name][n] = np.sqrt(square.sum() / seen.total.sum())
        error = np.sqrt(squares[0] + squares[1])
        bound, plain = error_bounds(prepared, state)
        arrays["energy_error_lifted"][n] = error.max() / norms.max()
        arrays["energy_error_bound"][n] = bound.max() / norms.max()
        arrays["residual_bound"][n] = plain.max() / norms.max()
        arrays["difference_from_best"][n] = best.difference(a, b)
        arrays["bound_slack"][n] = (bound - error).min() / norms.max()
        if len(counts) == 1:
            arrays |= prepared.stored(state) | {"error_bound": bound}
    return arrays


def choose(
    scene: Scene, tolerance: float, modes: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """The smallest ``lifted_exact`` model within a tolerance of the best that the snapshots give.

    Both are held against the largest energy norm of the best model over time. Where the bound,
    which knows of the full model too, is within the tolerance as well, the model is certified.

    Parameters
    ----------
    scene : Scene
    tolerance : float
        Relative.
    modes : dict
        As from `lifted_rom.decompose`.

    Returns
    -------
    dict
        tolerance; mode_count, modes_resolved and best_mode_count; difference_from_best,
        energy_error_bound, residual_bound, each relative; certified, 1 or 0; t,
        scaled_velocity_coordinates, scaled_strain_coordinates, error_bound (times,).

    Raises
    ------
    Breakdown
        The best model broke down.
    """
    best = Best.of(scene, modes)
    for count in range(1, best.count + 1):
        prepared = lifted_rom.build(scene, modes, count).prepare("lifted_exact")
        try:
            state = prepared.solve()
        except Breakdown:
            continue
        difference = best.difference(*prepared.model.coordinates(state))
        if difference <= tolerance:
            break
    bound, plain = error_bounds(prepared, state)
    relative = bound.max() / best.norm
    return {
        "tolerance": np.array(tolerance),
        "mode_count": np.array([count]),
        "modes_resolved": lifted_rom.modes_resolved(modes, [count]),
        "best_mode_count": np.array(best.count),
        "difference_from_best": np.array([difference]),
        "energy_error_bound": np.array([relative]),
        "residual_bound": np.array([plain.max() / best.norm]),
        "certified": np.array(int(relative <= tolerance)),
        **prepared.stored(state),
        "error_bound": bound,
    }


def verdict(chosen: Mapping[str, np.ndarray]) -> str:
    """What `choose` found, in words."""
    bound, tolerance = chosen["energy_error_bound"][0], chosen["tolerance"]
    relation = "within" if chosen["certified"] else "not within"
    word = "certified" if chosen["certified"] else "not certified"
    return (
        f"{chosen['mode_count'][0]} modes are within {chosen['difference_from_best'][0]:.1e} of "
        f"the best model; {word}: the bound {bound:.1e} is {relation} {tolerance:g}"
    )


@dataclass(frozen=True)
class Best:
    """The model with all modes that the snapshots give.

    Attributes
    ----------
    velocity, strain : arrays, shapes (times, modes)
        Its coordinates.
    norm : float
        Its largest energy norm over time.
    """

    velocity: np.ndarray
    strain: np.ndarray
    norm: float

    @classmethod
    def of(cls, scene: Scene, modes: Mapping[str, np.ndarray]) -> "Best":
        model = lifted_rom.build(scene, modes)
        state = model.prepare("lifted_exact").solve()
        velocity, strain = model.coordinates(state)
        squares = np.einsum("tm,tm->t", velocity, velocity) + np.einsum("tm,tm->t", strain, strain)
        return cls(velocity, strain, float(np.sqrt(squares.max())))

    @property
    def count(self) -> int:
        """Its velocity modes."""
        return self.velocity.shape[1]

    def difference(self, velocity: np.ndarray, strain: np.ndarray) -> float:
        """Largest energy norm over time of what a smaller model lacks, of the largest norm."""
        squares = np.zeros(len(velocity))
        for mine, theirs in ((self.velocity, velocity), (self.strain, strain)):
            rest = mine.copy()
            rest[:, : theirs.shape[1]] -= theirs
            squares += np.einsum("tm,tm->t", rest, rest)
        return float(np.sqrt(squares.max()) / self.norm)


@dataclass(frozen=True)
class Seen:
    """A scaled field of the full model, seen from modes, at each time.

    Attributes
    ----------
    coordinates : array, shape (times, modes)
    outside, total : arrays, shape (times,)
        Squares of what the modes leave of it, and of all of it.
    """

    coordinates: np.ndarray
    outside: np.ndarray
    total: np.ndarray

    @classmethod
    def of(cls, field: np.ndarray, scale: np.ndarray, modes: np.ndarray) -> "Seen":
        coordinates = np.empty((len(field), len(modes)))
        outside, total = np.empty((2, len(field)))
        for rows in blocks(len(field)):
            scaled = scale * field[rows]
            coordinates[rows] = scaled @ modes.T
            rest = scaled - coordinates[rows] @ modes
            outside[rows] = np.einsum("tx,tx->t", rest, rest)
            total[rows] = np.einsum("tx,tx->t", scaled, scaled)
        return cls(coordinates, outside, total)

    def squares(self, reduced: np.ndarray) -> np.ndarray:
        """Squares of the error of reduced coordinates (times, k) in the first modes, (times,)."""
        rest = self.coordinates.copy()
        rest[:, : reduced.shape[1]] -= reduced
        return np.einsum("tm,tm->t", rest, rest) + self.outside


@dataclass(frozen=True)
class Bound:
    """An error bound, ready for any solution of its model.

    Attributes
    ----------
    model : LiftedModel
    corrections : array, shape (coordinates, coordinates)
        QR factor of X.
    residual : array, shape (coordinates + 1, coordinates + 1)
        QR factor of the residual's operator; the last column is that of the force.
    start : array, shape (2N, coordinates)
        S + X, from which the error of the start is taken.
    """

    model: LiftedModel
    corrections: np.ndarray
    residual: np.ndarray
    start: np.ndarray

    def __call__(self, state: np.ndarray) -> np.ndarray:
        """Bound of the error's energy norm at the times of the error integral.

        Parameters
        ----------
        state : array, shape (coordinates, times)
            The model's own coordinates, exact in time.

        Returns
        -------
        array, shape (times,)
        """
        scene = self.model.scene
        mass, _ = lifted.energy_weights(scene)
        initial = np.concatenate([mass * scene.velocity0(), np.zeros(mass.size)])
        error0 = np.linalg.norm(initial - self.start @ state[:, 0])
        return (
            np.linalg.norm(self.corrections @ state, axis=0)
            + error0
            + np.concatenate([[0], np.cumsum(self._residual_integrals(state))])
        )

    def _residual_integrals(self, state):
        """Bounds of ∫ |r| from output to output.

        The norm of what lies linearly between two outputs is convex, so the trapezoidal rule is
        above its integral; what r deviates from that is below Δ²/8 times its second derivative.
        """
        scene, operator = self.model.scene, self.model.own.operator
        interval, times = scene.error_interval, scene.error_times
        push = own_force(self.model)
        amplitude, largest = np.zeros(times.size), np.zeros((3, times.size - 1))
        if push.any() or self.residual[:, -1].any():
            amplitude, largest = scene.force_values(times)[0], _largest_force(scene)
        factor, last = self.residual[:, :-1], self.residual[:, -1:]
        norms = np.linalg.norm(factor @ state + last * amplitude, axis=0)
        second = factor @ operator @ operator
        bends = np.zeros(times.size - 1)
        # What a block begins an interval with does not grow, but for what the force adds.
        for coordinates in self.model.own.members:
            added = interval * np.linalg.norm(push[coordinates]) * largest[0]
            lengths = np.linalg.norm(state[coordinates, :-1], axis=0) + added
            bends += np.linalg.norm(second[:, coordinates], 2) * lengths
        parts = factor @ operator @ push, factor @ push, last[:, 0]
        bends += np.array([np.linalg.norm(part) for part in parts]) @ largest
        return interval / 2 * (norms[:-1] + norms[1:]) + interval**3 / 12 * bends


def _largest_force(scene):
    """Largest |f|, |f'| and |f''| within each interval of the outputs, shape (3, intervals)."""
    step = scene.error_interval / SUBDIVISIONS
    values, _ = scene.force_values(
        np.arange((scene.error_times.size - 1) * SUBDIVISIONS + 1) * step
    )
    slope = np.diff(values) / step
    inside = np.diff(slope) / step
    ends = 2 * inside[[0, -1]] - inside[[1, -2]]
    curvature = np.concatenate([ends[:1], inside, ends[1:]])
    within, at_ends = slope.reshape(-1, SUBDIVISIONS), slice(SUBDIVISIONS, None, SUBDIVISIONS)
    value, bend = (
        np.maximum(np.abs(points[:-1]).reshape(within.shape).max(axis=1), np.abs(points[at_ends]))
        for points in (values, curvature)
    )
    return np.stack([value, np.abs(within).max(axis=1), bend])


def bounds(model: LiftedModel) -> tuple[Bound, Bound]:
    """The plain bound, and the one with corrected modes.

    Parameters
    ----------
    model : LiftedModel

    Returns
    -------
    plain, corrected : Bound
        Both hold; the smaller may be taken at each time.
    """
    full = lifted.operator(model.scene)
    modes = own_modes(model)
    residual = full @ modes - modes @ model.own.operator
    corrections = _corrections(model, full, residual)
    return (
        _bound(model, modes, np.zeros_like(modes), residual),
        _bound(
            model,
            modes,
            corrections,
            residual + full @ corrections - corrections @ model.own.operator,
        ),
    )


def error_bounds(prepared: Prepared, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The smaller of both bounds at each time, and the plain one, shape (times,) each."""
    plain, corrected = (bound(state) for bound in bounds(prepared.model))
    return np.minimum(plain, corrected), plain


def own_modes(model: LiftedModel) -> np.ndarray:
    """S: own modes of the model as scaled velocity and strain, shape (2N, coordinates)."""
    kv = len(model.velocity_modes)
    to_modes = model.own.to_modes
    return np.concatenate(
        [model.velocity_modes.T @ to_modes[:kv], model.strain_modes.T @ to_modes[kv:]]
    )


def own_force(model: LiftedModel) -> np.ndarray:
    """h: the force on the own coordinates, shape (coordinates,)."""
    return model.own.from_modes[:, : len(model.velocity_modes)] @ model.force


def _bound(model, modes, corrections, residual):
    _, profile = model.scene.force_values(np.zeros(1))
    mass, _ = lifted.energy_weights(model.scene)
    column = np.zeros(2 * mass.size)
    if profile.size:
        column[: mass.size] = mass * profile
        size = np.linalg.norm(column)
        column -= (modes + corrections) @ own_force(model)
        # A uniform force moves the translation alone, of which nothing is left but rounding.
        column[:] = np.where(np.linalg.norm(column) > 1e-13 * size, column, 0)
    return Bound(
        model,
        _factor(corrections),
        _factor(np.column_stack([residual, column])),
        modes + corrections,
    )


def _factor(matrix):
    """R of a QR factorisation: |R z| is the norm of the matrix's product with z."""
    return np.linalg.qr(matrix, mode="r")


def _corrections(model, full, residual):
    """X that makes τ |𝓐 X - X M + R| + 2 |X| small, block by block, in the least-squares sense.

    τ is how long the block lasts: T, or the time in which it decays.
    """
    from scipy.sparse import eye_array
    from scipy.sparse.linalg import splu

    corrections = np.zeros_like(residual)
    identity = eye_array(full.shape[0], format="csc")
    for coordinates in model.own.members:
        block = model.own.operator[np.ix_(coordinates, coordinates)]
        values, vectors = np.linalg.eig(block)
        if np.linalg.cond(vectors) > CRITICAL:
            continue
        driven = residual[:, coordinates] @ vectors
        if np.linalg.norm(driven) <= 1e-13 * np.linalg.norm(block):
            continue
        solved = np.zeros(driven.shape, complex)
        for n, value in enumerate(values):
            if value.imag < 0:
                solved[:, n] = solved[:, n - 1].conj()
                continue
            shifted = (full - value * identity).tocsc()
            rest = 2 * max(1 / model.scene.duration, -value.real)
            normal = shifted.conj().T @ shifted + rest**2 * identity
            solved[:, n] = splu(normal.tocsc()).solve(-(shifted.conj().T @ driven[:, n]))
        corrections[:, coordinates] = (solved @ np.linalg.inv(vectors)).real
    return corrections
