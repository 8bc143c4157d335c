"""Bounds of how far a lifted reduced model is from its full model, told without the full model.

Both are exact in time, of the same piecewise polynomial force p. With S the own modes of the
reduced operator as scaled fields, the reduced solution is S z(t), z' = M z + h p. For any change X
of the modes, the remainder ε = x - (S + X) z obeys

    ε' = 𝓐 ε + r,    r = (𝓐 (S + X) - (S + X) M) z + (F - (S + X) h) p,                       (1)

and the error is at most |X z| + |ε|. X is chosen to make the sum small: a wave that the residual
drives off its own frequency goes into X, one that it drives in resonance, whose error does grow
with time, stays in r.

**From the residual to the remainder.** The full operator 𝓐 takes energy by damping alone:
⟨𝓐 ε, ε⟩ = -Σ d ε_v². For any part of the velocities with d > 0, let a be what r is there, and b the
rest of r, with that of the strain. As -d ε_v² + a ε_v ≤ a²/(4d),

    (|ε|²/2)' ≤ q + |b| |ε|,    q = Σ a²/(4d),

so that, from any time s on,

    |ε(t)| ≤ √(|ε(s)|² + 2 ∫q) + ∫|b|,                                                        (2)

for the right side w has w w' = q w/√… + |b| w ≥ q + |b| w, and begins where |ε| does. Without any
such part it reads |ε(t)| ≤ |ε(s)| + ∫|r|. Both grow with |ε(s)|; so, from one time to the next, the
smaller of the two may be taken, each from the bound before. A decay of ε by exp(-d t) is not to be
had: damping acts on the velocity alone, and a wave that is slow beside it keeps its strain.

**Enrichment.** If x⁺ is the solution of any other model, |x - S z| ≤ |x⁺ - S z| + |x - x⁺|. One with
the modes of this model, their changes X, the start, the force and its response knows most of the
error, and its own bound is so much the smaller. Its modes contain the others, so |x⁺ - S z| is the
length of a difference of coordinates.

**Integrals.** Times are a grid of the bound's own, as fine as the motion needs, whatever the
outputs are. With y the values at the ends of a step δ, and within it

- |r''| at most β from the blocks' sizes, none of which grows but for what the force adds, and from
  p, p' and p'', which sums of Chebyshev coefficients bound,
- jumps of p by J and of p' by K, where one piece of the force ends: what they add to a function
  without jumps is at most κ = |g J| + δ |(G h) J + g K|, for r = G z + g p,

|r| is at most what lies linearly between its ends' norms, as a norm is convex, + β s(δ - s)/2 + 2κ:
κ itself, and as the function without jumps is off by κ at the end. Hence, and by Minkowski,

    ∫|r| ≤ δ (y₀ + y₁)/2 + β δ³/12 + 2κδ,
    √∫|r|² ≤ √(δ (y₀² + y₀y₁ + y₁²)/3) + β √(δ⁵/120) + 2κ√δ.

The grid is refined until β and κ matter little. Where f is not p, ∫|f - p| times |F| is added.

All norms are of QR factors of the size of the reduced model; a Gram matrix would lose half their
digits.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import chebyshev

from sphpod import lifted, propagator
from sphpod.course import Course, course
from sphpod.lifted_rom import LiftedModel, Prepared
from sphpod.scene import Scene

COARSEST, FINEST = 2**7, 2**16
"""Steps of the grid of integration."""

EXCESS = 0.05
"""Part of a bound that may be due to what is not known within the steps of the grid."""

ROUNDING = 1e-13
"""Part of the solution's size below which nothing is worth refining, and columns are rounding."""

WEAKEST = 1e-8
"""Size of an enriching mode, of the largest of its kind, from which it is taken."""


@dataclass(frozen=True)
class FullModel:
    """The lifted full model of a scene as its reduced models are held against it.

    Attributes
    ----------
    scene : Scene
    operator : scipy.sparse array, shape (2N, 2N)
        𝓐 [1/s].
    start : array, shape (2N,)
        Scaled initial fields.
    courses : list of Course
        p of each force.
    forces : array, shape (2N, forces)
        F: the scaled profiles.
    """

    scene: Scene
    operator: object
    start: np.ndarray
    courses: Sequence[Course]
    forces: np.ndarray

    @classmethod
    def of(cls, scene: Scene) -> "FullModel":
        mass, _ = lifted.energy_weights(scene)
        none = np.zeros(mass.size)
        courses, columns = [], np.zeros((2 * mass.size, 0))
        if scene.force_time is not None:
            time = scene.force_time
            courses = [course(lambda t: time(t=t), scene.duration)]
            _, profile = scene.force_values(np.zeros(1))
            columns = np.concatenate([mass * profile, none])[:, None]
        start = np.concatenate([mass * scene.velocity0(), none])
        return cls(scene, lifted.operator(scene), start, courses, columns)

    @property
    def missed(self) -> float:
        """Energy norm of what forces beside p can add to the solution over T."""
        sizes = np.linalg.norm(self.forces, axis=0)
        return float(sum(s * c.missed for s, c in zip(sizes, self.courses, strict=True) if s))

    @cached_property
    def lasting(self) -> np.ndarray:
        """Velocities that are damped within T, shape (2N,), and their 2√d."""
        values = self.scene.damping_values()
        if not values.size:
            return np.zeros(2 * self.scene.particle_count)
        damped = np.where(values * self.scene.duration >= 1, 2 * np.sqrt(values), 0)
        return np.concatenate([damped, np.zeros(values.size)])

    @cached_property
    def _bands(self):
        """𝓐ᵀ𝓐, 𝓐 + 𝓐ᵀ and 𝓐ᵀ - 𝓐 as lower bands in an order that makes them narrow."""
        from scipy.sparse.csgraph import reverse_cuthill_mckee

        full = self.operator
        square = (full.T @ full).tocsr()
        parts = [square, (full + full.T).tocsr(), (full.T - full).tocsr()]
        pattern = sum(abs(part) for part in parts).tocsr()
        order = reverse_cuthill_mckee(pattern, symmetric_mode=True)
        place = np.empty_like(order)
        place[order] = np.arange(order.size)
        pattern = pattern.tocoo()
        width = int(np.abs(place[pattern.row] - place[pattern.col]).max(initial=0))
        bands = np.zeros((3, width + 1, order.size))
        for band, part in zip(bands, parts, strict=True):
            entries = part.tocoo()
            row, column = place[entries.row], place[entries.col]
            lower = row >= column
            band[(row - column)[lower], column[lower]] = entries.data[lower]
        return bands, order

    def least_squares(self, shift: complex, rest: float, right: np.ndarray) -> np.ndarray:
        """x with the smallest |(𝓐 - shift) x - right|² + rest² |x|², shape (2N,)."""
        from scipy.linalg import solveh_banded

        (square, twice, turn), order = self._bands
        normal = square - shift.real * twice - 1j * shift.imag * turn
        normal[0] += abs(shift) ** 2 + rest**2
        pulled = self.operator.T @ right - np.conj(shift) * right
        solved = np.empty(right.size, complex)
        solved[order] = solveh_banded(
            normal, pulled[order], overwrite_ab=True, lower=True, check_finite=False
        )
        return solved


@dataclass(frozen=True)
class Motion:
    """A reduced solution on a grid of times, and what is known of it within the steps.

    Attributes
    ----------
    step : float
        δ [s].
    values : array, shape (coordinates + forces, steps + 1)
        z, and p of each force below.
    reach : array, shape (blocks, steps)
        Length of each block within a step, at most.
    sizes : array, shape (forces, 3, steps)
        |p|, |p'| and |p''| within a step, at most.
    jumps : array, shape (forces, 2, steps)
        Jumps of p and of p' within a step, their sizes added up.
    """

    step: float
    values: np.ndarray
    reach: np.ndarray
    sizes: np.ndarray
    jumps: np.ndarray

    @classmethod
    def of(cls, full: FullModel, model: LiftedModel, start: np.ndarray, steps: int) -> "Motion":
        own, step = model.own, full.scene.duration / steps
        push = forces_on(full, model)
        amplitude = full.courses[0] if full.courses else None
        jumps = propagator.prepare(
            own.blocks, own.singles, own.in_blocks(push.sum(axis=1)), step, steps + 1, amplitude
        )
        state = np.zeros((start.size, steps + 1))
        state[:, 0] = start
        jumps.run(state, amplitude)
        times = np.arange(steps + 1) * step
        sizes = np.zeros((len(full.courses), 3, steps))
        breaks = np.zeros((len(full.courses), 2, steps))
        for n, one in enumerate(full.courses):
            sizes[n], breaks[n] = _within(one, times)
        # What a block begins a step with does not grow, but for what the force adds.
        reach = np.stack(
            [
                np.linalg.norm(state[block, :-1], axis=0)
                + step * np.linalg.norm(push[block], axis=0) @ sizes[:, 0]
                for block in own.members
            ]
        )
        values = np.concatenate([state, *(one(times)[None] for one in full.courses)])
        return cls(step, values, reach, sizes, breaks)


def _within(course, times):
    """Largest |p|, |p'| and |p''|, and summed jumps of p and p', between neighbouring times."""
    edges, steps = course.edges, times.size - 1
    scale = 2 / np.diff(edges)[:, None]
    slopes = chebyshev.chebder(course.coefficients, axis=1) * scale
    bends = chebyshev.chebder(course.coefficients, 2, axis=1) * scale**2
    pieces = np.array([np.abs(part).sum(axis=1) for part in (course.coefficients, slopes, bends)])
    first = np.clip(np.searchsorted(edges, times[:-1], "right") - 1, 0, len(scale) - 1)
    last = np.clip(np.searchsorted(edges, times[1:], "left") - 1, first, len(scale) - 1)
    ends = np.stack([first, last + 1], axis=1).ravel()
    padded = np.pad(pieces, ((0, 0), (0, 1)))
    largest = np.maximum.reduceat(padded, ends, axis=1)[:, ::2]
    jumps = [
        np.abs(chebyshev.chebval(-1, part[1:].T) - chebyshev.chebval(1, part[:-1].T))
        for part in (course.coefficients, slopes)
    ]
    step = np.clip(np.searchsorted(times, edges[1:-1], "left") - 1, 0, steps - 1)
    return largest, np.array([np.bincount(step, jump, steps) for jump in jumps])


@dataclass(frozen=True)
class Map:
    """G z + g p on a motion, by its norms.

    Attributes
    ----------
    factor : array, shape (rows, coordinates + forces)
        QR factor of G and g.
    bends, turns : arrays, shapes (blocks,) and (forces, 3)
        What |G z + g p|'' is at most, of the blocks' lengths and of |p|, |p'| and |p''|.
    kinks : array, shape (forces, 3)
        What jumps of p add to its value, to its slope, and those of p' to its slope, at most.
    """

    factor: np.ndarray
    bends: np.ndarray
    turns: np.ndarray
    kinks: np.ndarray

    @classmethod
    def of(cls, model: LiftedModel, push: np.ndarray, columns: np.ndarray) -> "Map":
        count = len(model.own.operator)
        factor = np.linalg.qr(columns, mode="r")
        maps, direct = factor[:, :count], factor[:, count:]
        once = maps @ model.own.operator
        twice = once @ model.own.operator

        def sizes(*parts):
            return np.stack([np.linalg.norm(part, axis=0) for part in parts], axis=1)

        return cls(
            factor,
            np.array([np.linalg.norm(twice[:, block], 2) for block in model.own.members]),
            sizes(once @ push, maps @ push, direct),
            sizes(direct, maps @ push, direct),
        )

    def on(self, motion: Motion) -> "Norms":
        step = motion.step
        ends = np.linalg.norm(self.factor @ motion.values, axis=0)
        bends = self.bends @ motion.reach + np.einsum("fn,fns->s", self.turns, motion.sizes)
        jumps, slopes = motion.jumps[:, 0], motion.jumps[:, 1]
        kinks = self.kinks[:, 0] @ jumps + step * (
            self.kinks[:, 1] @ jumps + self.kinks[:, 2] @ slopes
        )
        return Norms(step, ends[:-1], ends[1:], bends, 2 * kinks)


@dataclass(frozen=True)
class Norms:
    """Norms at the ends of each step, and what may be added within: β and 2κ."""

    step: float
    first: np.ndarray
    last: np.ndarray
    bends: np.ndarray
    kinks: np.ndarray

    @property
    def linear(self) -> np.ndarray:
        return self.step / 2 * (self.first + self.last)

    @property
    def integral(self) -> np.ndarray:
        return self.linear + self.step**3 / 12 * self.bends + self.step * self.kinks

    @property
    def square(self) -> np.ndarray:
        """Integral of the square."""
        even = self.step / 3 * (self.first**2 + self.first * self.last + self.last**2)
        added = np.sqrt(self.step**5 / 120) * self.bends + np.sqrt(self.step) * self.kinks
        return (np.sqrt(even) + added) ** 2

    @property
    def largest(self) -> np.ndarray:
        return np.maximum(self.first, self.last) + self.step**2 / 8 * self.bends + self.kinks


@dataclass(frozen=True)
class Bound:
    """The bound that one change X of a model's modes gives.

    Attributes
    ----------
    start : float
        |ε(0)|.
    change : Map or None
        X z.
    residual : Map
        r.
    damped, rest : Map or None
        a/(2√d), whose square is q, and b; None where nothing is damped.
    """

    start: float
    change: Map | None
    residual: Map
    damped: Map | None
    rest: Map | None

    @classmethod
    def of(
        cls,
        full: FullModel,
        model: LiftedModel,
        start: np.ndarray,
        modes: np.ndarray,
        change: np.ndarray | None = None,
    ) -> "Bound":
        changed = modes if change is None else modes + change
        push = forces_on(full, model)
        left = full.forces - changed @ push
        # A uniform force moves the translation alone, of which nothing is left but rounding.
        left[:, np.linalg.norm(left, axis=0) <= ROUNDING * np.linalg.norm(full.forces, axis=0)] = 0
        columns = np.concatenate(
            [full.operator @ changed - changed @ model.own.operator, left], axis=1
        )
        damped = full.lasting > 0

        def mapped(rows):
            return Map.of(model, push, rows)

        return cls(
            float(np.linalg.norm(full.start - changed @ start)),
            None
            if change is None
            else mapped(np.concatenate([change, np.zeros_like(left)], axis=1)),
            mapped(columns),
            mapped(columns[damped] / full.lasting[damped, None]) if damped.any() else None,
            mapped(columns[~damped]) if damped.any() else None,
        )

    def on(self, motion: Motion) -> tuple[np.ndarray, float]:
        """The bound at the start and within each step, (steps + 1,), and the excess in it."""
        residual = self.residual.on(motion)
        whole = residual.integral
        excess = whole.sum() - residual.linear.sum()
        if self.damped is None:
            remainder = self.start + np.concatenate([[0], np.cumsum(whole)])
        else:
            rest = self.rest.on(motion)
            remainder = _remainder(
                self.start, whole, self.damped.on(motion).square, rest.integral
            )
        changes = np.zeros(remainder.size)
        if self.change is not None:
            change = self.change.on(motion)
            changes[0] = change.first[0]
            changes[1:] = change.largest
            excess += change.largest.max() - change.first.max(initial=change.last[-1])
        return remainder + changes, excess


def _remainder(start, whole, squares, rests):
    """The smaller of both bounds (2) from step to step."""
    bound = np.empty(whole.size + 1)
    bound[0] = now = start
    steps = zip(whole.tolist(), squares.tolist(), rests.tolist(), strict=True)
    for n, (push, square, rest) in enumerate(steps, 1):
        now = min(now + push, (now * now + 2 * square) ** 0.5 + rest)
        bound[n] = now
    return bound


def error_bounds(
    prepared: Prepared, state: np.ndarray, full: FullModel | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of the energy norm of the error at the times of the error integral.

    Parameters
    ----------
    prepared : Prepared
        A model exact in time.
    state : array, shape (coordinates, times)
        Its solution, in own coordinates.
    full : FullModel, optional
        That of its scene, if it is at hand.

    Returns
    -------
    bound, plain : arrays, shape (times,)
        The smallest of all bounds at each time, and the one of the residual alone, without changed
        modes or enrichment.
    """
    model = prepared.model
    full = full or FullModel.of(model.scene)
    start, modes = state[:, 0], own_modes(model)
    change = corrections(full, model, modes)
    plain, corrected = _over_time(
        full,
        model,
        start,
        [Bound.of(full, model, start, modes), Bound.of(full, model, start, modes, change)],
    )
    richer = enriched(full, model, change * np.abs(state).max(axis=1))
    richly = richer.prepare("lifted_exact")
    richer_state = richly.new_state()
    richly.run(model.scene.velocity0(), richer_state)
    known = _difference(model.coordinates(state), richer.coordinates(richer_state))
    start, modes = richer_state[:, 0], own_modes(richer)
    change = corrections(full, richer, modes)
    (beyond,) = _over_time(
        full, richer, start, [Bound.of(full, richer, start, modes, change)]
    )
    best = np.minimum(np.minimum(plain, corrected), known + beyond)
    return best + full.missed, plain + full.missed


def _over_time(full, model, start, bounds):
    """Each bound at the outputs, from a grid that is fine enough for all."""
    scale = np.linalg.norm(full.start) + sum(
        np.linalg.norm(column) * np.abs(one.coefficients).sum(axis=1) @ np.diff(one.edges)
        for column, one in zip(full.forces.T, full.courses, strict=True)
    )
    steps = COARSEST
    while True:
        motion = Motion.of(full, model, start, steps)
        found = [bound.on(motion) for bound in bounds]
        excess = max(
            extra / max(EXCESS * (bound.max() - extra), ROUNDING * scale) for bound, extra in found
        )
        if excess <= 1 or steps >= FINEST:
            break
        steps = min(FINEST, 2 * steps * int(np.ceil(np.sqrt(min(excess, FINEST)) / 2)))
    # Within a step the bound is that of its end.
    place = np.ceil(model.scene.error_times / motion.step * (1 - 1e-15)).astype(int)
    return [bound[np.minimum(place, steps)] for bound, _ in found]


def _difference(coordinates, richer):
    """Energy norm between two solutions whose modes are those of one and more, (times,)."""
    squares = 0.0
    for some, more in zip(coordinates, richer, strict=True):
        rest = more.copy()
        rest[:, : some.shape[1]] -= some
        squares = squares + np.einsum("tm,tm->t", rest, rest)
    return np.sqrt(squares)


def own_modes(model: LiftedModel) -> np.ndarray:
    """S: own modes of the model as scaled velocity and strain, shape (2N, coordinates)."""
    kv = len(model.velocity_modes)
    to_modes = model.own.to_modes
    return np.concatenate(
        [model.velocity_modes.T @ to_modes[:kv], model.strain_modes.T @ to_modes[kv:]]
    )


def forces_on(full: FullModel, model: LiftedModel) -> np.ndarray:
    """h: each force on the own coordinates, shape (coordinates, forces)."""
    push = model.own.from_modes[:, : len(model.velocity_modes)] @ model.force
    return push[:, None] if full.courses else np.zeros((push.size, 0))


def corrections(full: FullModel, model: LiftedModel, modes: np.ndarray) -> np.ndarray:
    """X that makes τ |𝓐 X - X M + R| + 2 |X| small, in the least-squares sense.

    R = 𝓐 S - S M, and τ is how long a mode lasts: T, or the time in which it decays. Columns follow
    from one another in the Schur form of each block.

    Returns
    -------
    array, shape (2N, coordinates)
    """
    from scipy.linalg import schur

    residual = full.operator @ modes - modes @ model.own.operator
    found = np.zeros_like(residual)
    for block in model.own.members:
        operator = model.own.operator[np.ix_(block, block)]
        if np.linalg.norm(residual[:, block]) <= ROUNDING * np.linalg.norm(operator):
            continue
        triangle, unitary = schur(operator, "complex")
        driven, solved = residual[:, block] @ unitary, np.zeros((len(residual), block.size), complex)
        for n in range(block.size):
            value = triangle[n, n]
            right = solved[:, :n] @ triangle[:n, n] - driven[:, n]
            solved[:, n] = full.least_squares(value, _shortest(full, value), right)
        found[:, block] = (solved @ unitary.conj().T).real
    return found


def _shortest(full, value):
    return 2 * max(1 / full.scene.duration, -value.real)


def enriched(full: FullModel, model: LiftedModel, change: np.ndarray) -> LiftedModel:
    """The model with more modes, of what its error is likely to be made.

    Parameters
    ----------
    change : array, shape (2N, coordinates)
        X, each column as large as it becomes.
    """
    columns = [change, full.start[:, None]]
    for force, one in zip(full.forces.T, full.courses, strict=True):
        columns.append(_responses(full, force, one))
    both = np.concatenate(columns, axis=1)
    velocity, strain = np.split(both, 2)
    velocity_modes = _more(model.velocity_modes, velocity)
    # Each strain mode has a wave of velocity.
    strain_modes = _more(model.strain_modes, strain)[: len(velocity_modes) - model.translation]
    return LiftedModel(model.scene, velocity_modes, strain_modes, model.translation)


def _responses(full, force, course):
    """A force's profile, and what it does while it stands still and as it turns, (2N, 4)."""
    half = np.diff(course.edges) / 2
    slopes = chebyshev.chebder(course.coefficients, axis=1) / half[:, None]
    turn = np.sqrt(half @ np.sum(slopes**2, axis=1) / (half @ np.sum(course.coefficients**2, axis=1)))
    rest = _shortest(full, 0)
    still = full.least_squares(0j, rest, -force)
    moved = full.least_squares(1j * turn, rest, -force)
    size = np.abs(course.coefficients).sum(axis=1).max()
    return size * np.stack([force * full.scene.duration, still.real, moved.real, moved.imag], axis=1)


def _more(modes, columns):
    """Orthonormal modes, and behind them those of what columns have beside them, largest first."""
    rest = columns.T - (columns.T @ modes.T) @ modes
    _, values, rows = np.linalg.svd(rest, full_matrices=False)
    rows = rows[values > WEAKEST * np.linalg.norm(columns, axis=0).max(initial=0)]
    if not len(rows):
        return modes
    rows = rows - (rows @ modes.T) @ modes
    return np.concatenate([modes, np.linalg.qr(rows.T)[0].T])
