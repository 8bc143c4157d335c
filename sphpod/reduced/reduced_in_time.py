"""Lifted reduced models where modulus or damping change with time, and their bound.

The scaled strain p = √(V c₀) e has the modulus at t = 0 in it; with R(t) = diag(c/c₀) the full
model reads

    u' = -D u + A R p + √m f,    p' = -Aᵀ u,

and its energy (|u|² + pᵀ R p)/2 changes by damping, force and ½ pᵀ R' p, what the modulus itself
does. Galerkin projection in the energy of the time keeps just that,

    a' = -Φᵀ D Φ a + B b + g f,    S b' = -Bᵀ a,    B = Φᵀ A R Ψ,    S = Ψᵀ R Ψ,

for any modes. It is stepped as the full model is (`sphpod.full.coefficients_in_time`), or as
explicit Euler would go. R and D are sums of factors in time times profiles, so that no step sees
the particles.

**Bound.** With r the residual and the norm |·| of the time, (|ε|²/2)' ≤ |r| |ε| + γ |ε|² with
γ = ½ max (∂c/∂t)⁺/c, so that

    |ε(t)| ≤ e^{g(t)} |ε(0)| + ∫ e^{g(t) - g(s)} |r(s)| ds,    g(t) = ∫ γ ds.

A modulus that jumps upwards has no such g. The integral is a sum over a grid that resolves the
waves of the model and whatever changes in a coefficient or the force, however short; how much it
differs from that over every other time is added.
"""

import logging
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from sphpod.full import coefficients_in_time as in_time
from sphpod.full import lifted
from sphpod.numerics.compiled import compiled
from sphpod.numerics.error import blocks
from sphpod.numerics.separation import instants
from sphpod.scene.scene import Scene

logger = logging.getLogger(__name__)

MATRIX_VALUES = 2**22
"""Values of the matrices of steps that are made together, which bounds the memory."""

GRID = 0.25
"""Angle [rad] of the model's fastest wave that times of the bound's grid are apart."""

MOST_TIMES = 2**16
"""Times of the bound's grid, at most."""

JUMP = 1e-9
"""Change of the modulus at a break, of itself, from which it is taken for a jump."""

HALVINGS = 64
"""How often a piece is halved in which the modulus may jump, until its ends are neighbours."""


@dataclass(frozen=True)
class Terms:
    """A reduced model as sums of functions of time times matrices.

    Attributes
    ----------
    coupling, metric : arrays, shapes (terms, kv, ke) and (terms, ke, ke)
        Of B and S, by the terms of the modulus.
    damping : array, shape (terms, kv, kv)
        Of Φᵀ D Φ, by those of the damping.
    force : array, shape (kv, forces)
        g.
    """

    scene: Scene
    coupling: np.ndarray
    metric: np.ndarray
    damping: np.ndarray
    force: np.ndarray

    @classmethod
    def of(cls, model: Any) -> "Terms":
        """Those of a `lifted_rom.LiftedModel`."""
        scene, velocity, strain = model.scene, model.velocity_modes, model.strain_modes
        _, moduli = in_time.coefficient_terms(scene, "youngs_modulus", scene.modulus())
        _, dampings = in_time.coefficient_terms(scene, "damping", scene.damping_values())
        parts = [c / scene.modulus() for c in moduli]
        kv, ke = len(velocity), len(strain)

        def stacked(matrices, rows, columns):
            found = list(matrices)
            return np.array(found).reshape(len(found), rows, columns)

        return cls(
            scene,
            stacked((velocity @ lifted.pull(scene, strain * part).T for part in parts), kv, ke),
            stacked(((strain * part) @ strain.T for part in parts), ke, ke),
            stacked(((velocity * d) @ velocity.T for d in dampings), kv, kv),
            model.force,
        )

    @cached_property
    def _factors(self):
        scene = self.scene
        return (
            in_time.coefficient_terms(scene, "youngs_modulus", scene.modulus())[0],
            in_time.coefficient_terms(scene, "damping", scene.damping_values())[0],
        )

    def metrics(self, times: np.ndarray) -> np.ndarray:
        """S at times [s], shape (times, ke, ke)."""
        return np.tensordot(self._factors[0](times).T, self.metric, axes=1)

    def operators(self, times: np.ndarray) -> np.ndarray:
        """Rates of the coordinates of velocity and strain by them [1/s], (times, s, s)."""
        stiffening, slowing = (factors(times).T for factors in self._factors)
        coupling = np.tensordot(stiffening, self.coupling, axes=1)
        count, kv, ke = coupling.shape
        result = np.zeros((count, kv + ke, kv + ke))
        result[:, :kv, kv:] = coupling
        if self.scene.changing("youngs_modulus") is None:
            # The modes are orthonormal in this very energy.
            result[:, kv:, :kv] = -coupling.transpose(0, 2, 1)
        elif ke:
            metric = np.tensordot(stiffening, self.metric, axes=1)
            result[:, kv:, :kv] = -np.linalg.solve(metric, coupling.transpose(0, 2, 1))
        if len(self.damping):
            result[:, :kv, :kv] = -np.tensordot(slowing, self.damping, axes=1)
        return result

    def pushes(self, times: np.ndarray) -> np.ndarray:
        """Rates of the coordinates by the force, (times, s)."""
        amplitudes, _ = self.scene.force_values(times)
        result = np.zeros((times.size, len(self.force) + self.coupling.shape[2]))
        if amplitudes.size:
            result[:, : len(self.force)] = (self.force @ amplitudes).T
        return result

    @cached_property
    def fastest(self) -> float:
        """Largest norm of the operator over time [1/s], where it is looked at."""
        courses = in_time.courses_of(self.scene)
        operators = self.operators(instants(list(courses), 256))
        found = np.linalg.norm(operators, 2, axis=(1, 2)).max()
        # A damper may be switched on between two of these.
        return float(max(found, self.scene.damping_range()[1]))


@dataclass
class Steps:
    """From output to output, in steps.

    Attributes
    ----------
    euler : bool
        Whether steps are those of explicit Euler.
    time_error : float
        Of the last run that is none of explicit Euler: its estimated error, of the largest length
        of the coordinates.
    """

    terms: Terms
    euler: bool
    time_error: float = field(default=np.nan, init=False)

    def run(self, state: np.ndarray, times: np.ndarray | None = None) -> None:
        """Fill the outputs of a state (coordinates, times), of which the first column is given.

        Outputs are those of the scene, or at ascending ``times`` from 0 [s].
        """
        if self.euler:
            scene = self.terms.scene
            starts, done = scene.times(np.arange(scene.step_count)), scene.error_steps
            self._march(state, starts, np.full(starts.size, scene.time_step), done, 0)
            return
        scene, coarse = self.terms.scene, None
        times = scene.error_times if times is None else times
        longest = 1 / max(self.terms.fastest, 1 / scene.duration)
        courses = in_time.courses_of(scene)
        for halving in range(in_time.HALVINGS + 1):
            starts, lengths, done = in_time.step_grid(times, courses, longest, halving)
            size = 0.6 * lengths.max() * self.terms.fastest
            self._march(state, starts, lengths, done, in_time.series_terms(size))
            if coarse is not None:
                largest = np.linalg.norm(state, axis=0).max() or 1.0
                difference = np.linalg.norm(state - coarse, axis=0).max() / largest
                self.time_error = float(difference / (2**in_time.ORDER - 1))
                if not self.time_error > in_time.TIME_ERROR:
                    return
            coarse = state.copy()

    def _march(self, state, starts, lengths, done, terms):
        now, first = np.ascontiguousarray(state[:, 0]), 0
        # Outputs before the first step, such as one that is no later than 0 but for rounding.
        row = np.count_nonzero(done == 0)
        state[:, :row] = now[:, None]
        at_once = max(1, MATRIX_VALUES // (2 * now.size**2))
        while first < starts.size:
            some = slice(first, first + at_once)
            if self.euler:
                weights = lengths[some, None, None]
                matrices = self.terms.operators(starts[some]) * weights
                pushes = self.terms.pushes(starts[some]) * weights[:, 0]
            else:
                matrices = self._operators(starts[some], lengths[some])
                pushes = self._means(self.terms.pushes, starts[some], lengths[some])
            halves = 1 if self.euler else 2
            row = march(now, matrices, pushes, (first, halves, terms), done, row, state)
            first = some.stop

    def _operators(self, starts, lengths):
        if not self.terms.scene.is_steady:
            return self._means(self.terms.operators, starts, lengths)
        return np.repeat(lengths / 2, 2)[:, None, None] * self.terms.operators(starts[:1])

    def _means(self, functions, starts, lengths):
        def flat(times):
            return functions(times).reshape(times.size, -1).T

        shape = functions(starts[:1]).shape[1:]
        return in_time.means(flat, starts, lengths).reshape(-1, *shape)


@compiled
def march(now, matrices, pushes, schedule, done, row, state):
    """Steps from the first of these matrices on; the row of the next output that is left.

    ``schedule`` holds the first step, half steps in a step, and terms of the exponential's series;
    none of explicit Euler.
    """
    first, halves, terms = schedule
    term, new = np.empty(now.size), np.empty(now.size)
    for half in range(matrices.shape[0]):
        for n in range(now.size):
            term[n] = now[n]
        for order in range(1, max(terms, 2)):
            for n in range(now.size):
                rate = 0.0
                for m in range(now.size):
                    rate += matrices[half, n, m] * term[m]
                new[n] = rate
            for n in range(now.size):
                if order == 1:
                    new[n] += pushes[half, n]
                term[n] = new[n] / order
                now[n] += term[n]
        if (half + 1) % halves == 0:
            step = first + (half + 1) // halves
            while row < done.size and done[row] == step:
                for n in range(now.size):
                    state[n, row] = now[n]
                row += 1
    return row


# --- Bound ----------------------------------------------------------------------------------------


def unfollowed(scene: Scene) -> bool:
    """Whether modulus or damping break more often than can be followed, as the log reports."""
    found = False
    for key in ("youngs_modulus", "damping"):
        changing = scene.changing(key)
        if changing and not all(np.isfinite(course.missed) for course in changing.courses):
            found = True
            logger.warning(
                "scene %s: %s = %s: it changes more often in time than can be followed: what it "
                "does between steps is an estimate, and no error of a reduced model is bounded",
                scene.name, key, getattr(scene, key).text,
            )  # fmt: skip
    return found


def jumps_upwards(scene: Scene) -> bool:
    """Whether the modulus jumps in time anywhere, so that no bound of the energy holds across."""
    changing = scene.changing("youngs_modulus")
    if changing is None:
        return False
    courses = changing.courses
    # A break is an edge, or a piece as short as it could be found in.
    low, high = (
        np.concatenate([np.append(one.breaks, one.edges[part][~one.smooth]) for one in courses])
        for part in (slice(None, -1), slice(1, None))
    )
    within = (low > 0) & (high < scene.duration)
    low, high = (np.nextafter(time[within], way) for time, way in ((low, -np.inf), (high, np.inf)))
    # What is left of a kink between neighbouring numbers is nothing, of a jump all.
    for _ in range(HALVINGS):
        before, after = changing.at(low), changing.at(high)
        jumps = (np.abs(after - before) > JUMP * np.abs(before)).any(axis=1)
        low, high, before, after = low[jumps], high[jumps], before[jumps], after[jumps]
        middle = low + (high - low) / 2
        there = changing.at(middle)
        left = np.abs(there - before).max(axis=1) > np.abs(after - there).max(axis=1)
        low, high = np.where(left, low, middle), np.where(left, middle, high)
    return bool(low.size)


def pumping(scene: Scene, times: np.ndarray) -> np.ndarray:
    """g(t) = ½ ∫ max (∂c/∂t)⁺/c ds at ascending times from 0, shape (times,).

    Between two times the larger of both ends is taken, and their difference added; or what the
    modulus itself gains, which the slope at a kink may not show.
    """
    changing = scene.changing("youngs_modulus")
    if changing is None:
        return np.zeros(times.size)
    slopes = np.stack([course.slopes(times) for course in changing.courses], axis=1)
    rates, gains = np.empty(times.size), np.zeros(times.size)
    before = changing.at(times[:1])
    for rows in blocks(times.size):
        moduli = changing.at(times[rows])
        shares = (slopes[rows] @ changing.profiles) / moduli
        rates[rows] = np.maximum(shares.max(axis=1), 0) / 2
        gains[rows] = np.log(moduli / np.concatenate([before, moduli[:-1]])).max(axis=1) / 2
        before = moduli[-1:]
    largest = np.maximum(rates[1:], rates[:-1]) + np.abs(np.diff(rates))
    grown = np.maximum(largest * np.diff(times), gains[1:])
    return np.concatenate([[0.0], np.cumsum(grown)])


def error_bounds(run: Any) -> np.ndarray:
    """Bounds of the energy norm of the error, in norms of the time, at the outputs, (times,).

    Infinite, as the log reports, where the modulus jumps in time, or a coefficient changes more
    often than can be followed.

    Parameters
    ----------
    run : lifted_rom.LiftedRun
        Of a model exact in time.
    """
    model, scene = run.reduced, run.scene
    if unfollowed(scene):
        return np.full(scene.error_times.size, np.inf)
    if jumps_upwards(scene):
        logger.warning(
            "scene %s: youngs_modulus = %s: it jumps in time, and no error of a reduced model is "
            "bounded across",
            scene.name, scene.youngs_modulus.text,
        )  # fmt: skip
        return np.full(scene.error_times.size, np.inf)
    times = bound_times(run.jumps.terms)
    state = np.zeros((run.begun.size, times.size))
    state[:, 0] = run.begun
    steps = Steps(run.jumps.terms, euler=False)
    steps.run(state, times)
    sizes = _residual_sizes(model, steps.terms, state, times)
    grown = pumping(scene, times)
    mass, stiffness = lifted.energy_weights(scene)
    kv = len(model.velocity_modes)
    begun = np.hypot(
        np.linalg.norm(mass * scene.velocity0() - state[:kv, 0] @ model.velocity_modes),
        np.linalg.norm(stiffness * scene.starting_strain() - state[kv:, 0] @ model.strain_modes),
    )
    fine, coarse = (
        np.exp(grown[::n]) * (begun + _sum_of(sizes[::n], grown[::n], times[::n])) for n in (1, 2)
    )
    fine, grown = fine[::2], grown[::2]
    # What the steps of this model miss, and what the force's polynomials do.
    largest = np.linalg.norm(state, axis=0).max()
    _, profiles = scene.force_values(np.zeros(1))
    left = steps.time_error * largest + sum(
        course.missed * np.linalg.norm(mass * profile)
        for course, profile in zip(scene.courses(), profiles, strict=True)
    )
    bound = fine + np.abs(fine - coarse) + np.exp(grown) * left
    # It never falls: of an output between two times of the grid it is that of the later one.
    later = np.searchsorted(times[::2], scene.error_times)
    return np.maximum.accumulate(bound)[np.minimum(later, bound.size - 1)]


def bound_times(terms: Terms) -> np.ndarray:
    """Times of the bound's grid [s]: every other one is between its neighbours."""
    end = terms.scene.error_times[-1]
    count = int(min(np.ceil(max(terms.fastest * end / GRID, 1)), MOST_TIMES))
    # What is over between two of these, such as a pulse, is seen where the courses have it.
    seen = instants(list(in_time.courses_of(terms.scene)))
    every = np.union1d(np.linspace(0, end, count + 1), seen[seen <= end])
    times = np.empty(2 * every.size - 1)
    times[::2], times[1::2] = every, (every[1:] + every[:-1]) / 2
    return times


def _sum_of(sizes, grown, times):
    """∫ e^{-g} |r| ds up to each time by trapezia."""
    values = sizes * np.exp(-grown)
    return np.concatenate([[0.0], np.cumsum((values[1:] + values[:-1]) / 2 * np.diff(times))])


def _residual_sizes(model, terms, state, times):
    """|r| in the norms of the times, shape (times,)."""
    scene, kv = model.scene, len(model.velocity_modes)
    mass, _ = lifted.energy_weights(scene)
    stiff, moduli = in_time.coefficient_terms(scene, "youngs_modulus", scene.modulus())
    slow, dampings = in_time.coefficient_terms(scene, "damping", scene.damping_values())
    amplitudes, profiles = scene.force_values(times)
    sizes = np.empty(times.size)
    for rows in blocks(times.size):
        at, now = times[rows], state[:, rows].T
        rates = np.einsum("tsm,tm->ts", terms.operators(at), now) + terms.pushes(at)
        velocity, strain = now[:, :kv] @ model.velocity_modes, now[:, kv:] @ model.strain_modes
        parts = (stiff(at).T @ moduli) / scene.modulus()
        moved = lifted.pull(scene, parts * strain) - rates[:, :kv] @ model.velocity_modes
        if len(dampings):
            moved -= (slow(at).T @ dampings) * velocity
        if profiles.size:
            moved += amplitudes[:, rows].T @ (mass * profiles)
        strained = lifted.stretch(scene, velocity) - rates[:, kv:] @ model.strain_modes
        sizes[rows] = np.sqrt((moved**2).sum(axis=1) + (parts * strained**2).sum(axis=1))
    return sizes
