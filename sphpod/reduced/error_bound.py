"""Bounds of how far a lifted reduced model is from its full model, computed without the full model.

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

**Enrichment.** If x⁺ is the solution of any other model, |x - S z| ≤ |x⁺ - S z| + |x - x⁺|. One
with the modes of this model, their changes X, the start, the force and its response knows most of
the error, and its own bound is so much the smaller. Its modes contain the others, so |x⁺ - S z| is
the length of a difference of coordinates. Where that is not sharp, the richer model is enriched in
turn.

**Integrals.** Times are a grid of the bound's own, as fine as the motion needs, whatever the
outputs are. Within a step δ be

- p̄ the force p if it is one polynomial there, and else its value at the beginning or at the end,
  whichever is nearer to p in the mean,
- I = ∫|p - p̄| over the step, and J² = ∫|p - p̄|²,
- r̄ what r would be from its beginning on with p̄, and |r̄''| at most β,
- κ = Σ |G| |h| I over blocks, for r = G z + g p: as no block grows, |r - r̄| ≤ κ + |g| |p - p̄|,

and y the norms of r at its ends, of z as it is but of p̄. Then r̄ is at most what lies linearly
between y₀ and y₁ + κ, as a norm is convex, + β s(δ - s)/2. Hence, and by Minkowski,

    ∫|r| ≤ δ (y₀ + y₁)/2 + β δ³/12 + 2κδ + |g| I,
    √∫|r|² ≤ √(δ (y₀² + y₀y₁ + y₁²)/3) + β √(δ⁵/120) + 2κ√δ + |g| J.

So a pulse counts by what it does, however short it is beside a step.

β is the smallest of Taylor's bounds, of any order q ≥ 2:

    β = Σ |r̄⁽ⁿ⁾| δⁿ⁻²/(n - 2)!, n = 2 … q - 1,  + sup |r̄⁽ᑫ⁾| δᑫ⁻²/(q - 2)!.

As (z⁽ⁿ⁾)' = M z⁽ⁿ⁾ + h p̄⁽ⁿ⁾ and no block of M lets its length grow, each block of z⁽ᑫ⁾ is within
the step at most as long as at its beginning, and by what the force adds. Sums of Chebyshev
coefficients bound p̄⁽ⁿ⁾ and how far p strays. The grid is refined until β and κ matter little. Where
f is not p, ∫|f - p| times |F| is added.

All norms are of QR factors of the size of the reduced model; a Gram matrix would lose half their
digits.

Long, as the proofs stand beside what they prove.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from math import factorial
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev

from sphpod.full import lifted
from sphpod.numerics import propagator
from sphpod.numerics.compiled import compiled
from sphpod.numerics.course import Course
from sphpod.numerics.error import share
from sphpod.reduced import reduced_in_time
from sphpod.reduced.lifted_rom import LiftedModel, LiftedRun
from sphpod.scene.scene import Scene

COARSEST, FINEST = 2**7, 2**14
"""Steps of the grid of integration."""

ORDER = 4
"""Derivatives by which what happens within a step is bounded."""

EXCESS = 0.05
"""Part of a bound that may be due to what is not known within the steps of the grid."""

ROUNDING = 1e-13
"""Part of the solution's size below which nothing is worth refining, and columns are rounding."""

LEVELS, SHARP = 3, 3.0
"""Enrichments, one of the other, until the bound is at most so many times what is known."""

WEAKEST = 1e-8
"""Size of an enriching mode, of the largest of its kind, from which it is taken."""


@dataclass(frozen=True)
class FullModel:
    """The lifted full model of a scene as its reduced models are held against it.

    Attributes
    ----------
    operator : scipy.sparse array, shape (2N, 2N)
        𝓐 [1/s].
    start : array, shape (2N,)
        Scaled initial fields.
    courses : tuple of Courses
        p of each force.
    forces : array, shape (2N, forces)
        F: the scaled profiles.
    """

    scene: Scene
    operator: Any
    start: np.ndarray
    courses: tuple[Course, ...]
    forces: np.ndarray

    @classmethod
    def of(cls, scene: Scene) -> "FullModel":
        mass, stiffness = lifted.energy_weights(scene)
        courses, columns = scene.courses(), np.zeros((2 * mass.size, 0))
        if courses:
            _, profiles = scene.force_values(np.zeros(1))
            columns = np.concatenate([mass * profiles, np.zeros_like(profiles)], axis=1).T
        start = np.append(mass * scene.velocity0(), stiffness * scene.starting_strain())
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
    def _adjoint(self):
        return self.operator.T.tocsr()

    @cached_property
    def _bands(self):
        """𝓐ᵀ𝓐, 𝓐 + 𝓐ᵀ and 𝓐ᵀ - 𝓐 as lower bands in an order that makes them narrow."""
        from scipy.sparse.csgraph import reverse_cuthill_mckee

        full, adjoint = self.operator, self._adjoint
        parts = [(adjoint @ full).tocsr(), (full + adjoint).tocsr(), (adjoint - full).tocsr()]
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
        normal = np.empty(square.shape, complex)
        normal.real, normal.imag = square - shift.real * twice, -shift.imag * turn
        normal[0] += abs(shift) ** 2 + rest**2
        pulled = self._adjoint @ right - np.conj(shift) * right
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
    rates : array, shape (ORDER, coordinates + forces, steps)
        Their derivatives at the beginning of each step, if p̄ follows.
    reach : array, shape (ORDER, blocks, steps)
        Length of each block of them within a step, at most.
    sizes : array, shape (ORDER, forces, steps)
        Derivatives of p̄ within a step, at most.
    strays : array, shape (2, forces, steps)
        I and J of each step, at most.
    levels : array, shape (2, forces, steps)
        p̄ at the beginning and at the end of each step.
    """

    step: float
    values: np.ndarray
    rates: np.ndarray
    reach: np.ndarray
    sizes: np.ndarray
    strays: np.ndarray
    levels: np.ndarray

    @classmethod
    def of(cls, full: FullModel, model: LiftedModel, start: np.ndarray, steps: int) -> "Motion":
        own, step, count = model.own, full.scene.duration / steps, start.size
        push = forces_on(full, model)
        prepared = propagator.prepare(
            own.blocks, own.singles, own.forces_in_blocks(push), step, steps + 1, full.courses
        )
        values = np.zeros((count + push.shape[1], steps + 1))
        values[:count, 0] = start
        prepared.run(values[:count])
        times = np.arange(steps + 1) * step
        rates = np.zeros((ORDER, len(values), steps))
        sizes = np.zeros((ORDER, push.shape[1], steps))
        strays, levels = np.zeros((2, push.shape[1], steps)), np.zeros((2, push.shape[1], steps))
        for n, one in enumerate(full.courses):
            values[count + n], rates[:, count + n], sizes[:, n], strays[:, n], levels[:, n] = (
                _within(one, times)
            )
        reach = np.empty((ORDER, len(own.members), steps))
        before = np.concatenate([values[:count, :-1], levels[0]])
        for order, now in enumerate(rates):
            now[:count] = own.operator @ before[:count] + push @ before[count:]
            before = now
            for m, block in enumerate(own.members):
                reach[order, m] = np.linalg.norm(now[block], axis=0)
                reach[order, m] += step * np.linalg.norm(push[block], axis=0) @ sizes[order]
        return cls(step, values, rates, reach, sizes, strays, levels)


def _within(course, times):
    """p at times, and in each step between them what the docstring of the module calls p̄.

    Returns
    -------
    values : array, shape (steps + 1,)
    rates, sizes : arrays, shape (ORDER, steps)
        Derivatives of p̄, at the beginning and at most.
    strays, levels : arrays, shape (2, steps)
        I and J, at most; p̄ at the beginning and at the end.
    """
    edges, coefficients = course.edges, course.coefficients
    last = len(coefficients) - 1
    scale = 2 / np.diff(edges)
    first = np.clip(np.searchsorted(edges, times, "right") - 1, 0, last)
    place = np.clip(scale[first] * (times - edges[first]) - 1, -1, 1)
    values = chebyshev.chebval(place, coefficients[first].T, tensor=False)
    piece, until = first[:-1], first[1:]
    alone = piece == until
    levels = np.stack([values[:-1], values[1:]])
    strays = np.zeros((2, alone.size))
    # Where more than one piece lies in a step, how far p may be from either level on each part.
    cuts = np.union1d(times, edges)
    cuts = cuts[(cuts >= times[0]) & (cuts <= times[-1])]
    start, width = cuts[:-1], np.diff(cuts)
    of = np.clip(np.searchsorted(times, start, "right") - 1, 0, alone.size - 1)
    start, width, of = start[~alone[of]], width[~alone[of]], of[~alone[of]]
    on = np.clip(np.searchsorted(edges, start, "right") - 1, 0, last)
    slopes = np.abs(chebyshev.chebder(coefficients, axis=1)).sum(axis=1) * scale
    swing = np.minimum(2 * np.abs(coefficients[on, 1:]).sum(axis=1), slopes[on] * width)
    begun = chebyshev.chebval(
        np.clip(scale[on] * (start - edges[on]) - 1, -1, 1), coefficients[on].T, tensor=False
    )
    far = np.abs(begun - levels[:, of]) + swing
    sums = np.array([np.bincount(of, one * width, alone.size) for one in far])
    squares = np.array([np.bincount(of, one**2 * width, alone.size) for one in far])
    taken = np.argmin(sums, axis=0), np.arange(alone.size)
    strays[0], strays[1] = sums[taken], np.sqrt(squares[taken])
    levels[:, ~alone] = levels[taken][~alone]
    rates, sizes = np.zeros((2, ORDER, alone.size))
    piece, place, scale = piece[alone], place[:-1][alone], scale[piece[alone]]
    part = coefficients[piece].T
    for order in range(ORDER):
        part = chebyshev.chebder(part) * scale
        rates[order, alone] = chebyshev.chebval(place, part, tensor=False)
        sizes[order, alone] = np.abs(part).sum(axis=0)
    return values, rates, sizes, strays, levels


@dataclass(frozen=True)
class Map:
    """G z + g p on a motion, by its norms.

    Attributes
    ----------
    factor : array, shape (rows, coordinates + forces)
        QR factor of G and g.
    blocks : array, shape (blocks,)
        Norms of G on each block.
    direct, pushed : arrays, shape (forces,)
        |g|, and the sum over the blocks of the norms of G times those of h.
    """

    factor: np.ndarray
    blocks: np.ndarray
    direct: np.ndarray
    pushed: np.ndarray

    @classmethod
    def of(cls, model: LiftedModel, push: np.ndarray, columns: np.ndarray) -> "Map":
        factor, members = np.asarray(np.linalg.qr(columns, mode="r")), model.own.members
        blocks = np.array([np.linalg.norm(factor[:, block], 2) for block in members])
        lengths = np.array([np.linalg.norm(push[block], axis=0) for block in members])
        direct = np.linalg.norm(factor[:, len(push) :], axis=0)
        return cls(factor, blocks, direct, blocks @ lengths)

    def on(self, motion: Motion) -> "Norms":
        step = motion.step
        count = motion.values.shape[0] - motion.strays.shape[1]
        first, last = (
            np.linalg.norm(
                self.factor @ np.concatenate([motion.values[:count, part], level]), axis=0
            )
            for part, level in zip((slice(None, -1), slice(1, None)), motion.levels, strict=True)
        )
        bends, known = np.full((2, motion.values.shape[1] - 1), [[np.inf], [0]])
        for order in range(1, ORDER):
            weight = step ** (order - 1) / factorial(order - 1)
            within = self.blocks @ motion.reach[order] + self.direct @ motion.sizes[order]
            bends = np.minimum(bends, known + weight * within)
            known = known + weight * np.linalg.norm(self.factor @ motion.rates[order], axis=0)
        moved = 2 * self.pushed @ motion.strays[0]
        return Norms(
            step, first, last, bends, moved, *np.tensordot(self.direct, motion.strays, (0, 1))
        )


@dataclass(frozen=True)
class Norms:
    """Norms at the ends of each step, and what may be added within: β, 2κ, |g| I and |g| J."""

    step: float
    first: np.ndarray
    last: np.ndarray
    bends: np.ndarray
    moved: np.ndarray
    direct: np.ndarray
    direct_root: np.ndarray

    @property
    def straight(self) -> "Norms":
        """As if all were linear within the steps."""
        return replace(
            self,
            bends=0 * self.bends,
            moved=0 * self.moved,
            direct=0 * self.direct,
            direct_root=0 * self.direct_root,
        )

    @property
    def integral(self) -> np.ndarray:
        even = self.step / 2 * (self.first + self.last)
        return even + self.step**3 / 12 * self.bends + self.step * self.moved + self.direct

    @property
    def square(self) -> np.ndarray:
        """Integral of the square."""
        even = self.step / 3 * (self.first**2 + self.first * self.last + self.last**2)
        added = (
            np.sqrt(self.step**5 / 120) * self.bends
            + np.sqrt(self.step) * self.moved
            + self.direct_root
        )
        return (np.sqrt(even) + added) ** 2

    @property
    def largest(self) -> np.ndarray:
        """Largest norm within each step, of a map that the force reaches through z alone."""
        return np.maximum(self.first, self.last) + self.step**2 / 8 * self.bends + self.moved


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

    def on(self, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
        """The bound at the start and within each step, and it if all were linear within them.

        Returns
        -------
        bound, straight : arrays, shape (steps + 1,)
        """
        maps = self.residual, self.change, self.damped, self.rest
        norms = [None if one is None else one.on(motion) for one in maps]
        straight = [None if one is None else one.straight for one in norms]
        return self._from(*norms), self._from(*straight)

    def _from(self, residual, change, damped, rest):
        whole = residual.integral
        bound = np.empty(whole.size + 1)
        squares, rests = np.full((2, whole.size), np.inf)
        if damped is not None:
            squares, rests = damped.square, rest.integral
        follow(self.start, whole, squares, rests, bound)
        if change is not None:
            bound += np.concatenate([change.first[:1], change.largest])
        return bound


@compiled
def follow(start, whole, squares, rests, bound):
    """The smaller of both bounds (2) from step to step."""
    bound[0] = start
    for n in range(whole.size):
        damped = np.sqrt(bound[n] ** 2 + 2 * squares[n]) + rests[n]
        bound[n + 1] = min(bound[n] + whole[n], damped)


def error_bounds(run: LiftedRun, full: FullModel | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of the energy norm of the error at the times of the error integral.

    Parameters
    ----------
    run : LiftedRun
        Of a model exact in time, that has run.
    full : FullModel, optional
        That of its scene, if it is at hand.

    Returns
    -------
    bound, plain : arrays, shape (times,)
        The smallest of all bounds at each time, and the one of the residual alone, without changed
        modes or enrichment. Where models are stepped both are that of `reduced_in_time`.
    """
    model, (state,) = run.reduced, run.state
    if model.scene.is_stepped:
        in_time = reduced_in_time.error_bounds(run)
        return in_time, in_time
    full = full or FullModel.of(model.scene)
    start, modes = state[:, 0], own_modes(model)
    change = corrections(full, model, modes)
    plain, corrected = over_time(
        full,
        model,
        start,
        [Bound.of(full, model, start, modes), Bound.of(full, model, start, modes, change)],
        0.0,
    )
    best, richer, richer_state = np.minimum(plain, corrected), model, state
    for _ in range(LEVELS):
        richer = enriched(full, richer, change * np.abs(richer_state).max(axis=1))
        richly = richer.prepare("lifted_exact").run()
        (richer_state,) = richly.state
        known = _difference(run.coordinates(), richly.coordinates())
        start, modes = richer_state[:, 0], own_modes(richer)
        change = corrections(full, richer, modes)
        bound = Bound.of(full, richer, start, modes, change)
        (beyond,) = over_time(full, richer, start, [bound], known.max())
        best = np.minimum(best, known + beyond)
        if best.max() <= SHARP * known.max():
            break
    return best + full.missed, plain + full.missed


def over_time(full, model, start, bounds, known):
    """Each bound at the outputs, from a grid so fine that they and what is known gain little."""
    scale = np.linalg.norm(full.start) + sum(
        np.linalg.norm(column) * np.abs(one.coefficients).sum(axis=1) @ np.diff(one.edges)
        for column, one in zip(full.forces.T, full.courses, strict=True)
    )
    steps = COARSEST
    while True:
        motion = Motion.of(full, model, start, steps)
        found = [bound.on(motion) for bound in bounds]
        missing = max(
            float(share(gap, EXCESS * (straight.max() + known) + ROUNDING * scale))
            for gap, straight in (((bound - line).max(), line) for bound, line in found)
        )
        if not missing > 1 or steps == FINEST:
            break
        # What is not known falls as the square of the step.
        steps = min(FINEST, steps * 2 ** int(np.ceil(np.log2(np.clip(missing, 4, 64)) / 2)))
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
    return model.own.from_modes[:, : len(model.velocity_modes)] @ model.force


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
        driven, solved = (
            residual[:, block] @ unitary,
            np.zeros((len(residual), block.size), complex),
        )
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
    half, coefficients = np.diff(course.edges) / 2, course.coefficients
    power = half @ np.sum(coefficients**2, axis=1)
    if not power > 0:
        return np.zeros((force.size, 0))
    slopes = chebyshev.chebder(coefficients[course.smooth], axis=1)
    turn = np.sqrt(np.sum(slopes**2, axis=1) @ (1 / half[course.smooth]) / power)
    rest = _shortest(full, 0)
    still = full.least_squares(0j, rest, -force)
    moved = full.least_squares(1j * turn, rest, -force)
    size = np.abs(coefficients).sum(axis=1).max()
    return size * np.stack(
        [force * full.scene.duration, still.real, moved.real, moved.imag], axis=1
    )


def _more(modes, columns):
    """Orthonormal modes, and behind them those of what columns have beside them, largest first."""
    rest = columns.T - (columns.T @ modes.T) @ modes
    _, values, rows = np.linalg.svd(rest, full_matrices=False)
    rows = rows[values > WEAKEST * np.linalg.norm(columns, axis=0).max(initial=0)]
    if not len(rows):
        return modes
    rows = rows - (rows @ modes.T) @ modes
    return np.concatenate([modes, np.linalg.qr(rows.T)[0].T])
