"""The lifted full model where modulus or damping change with time, by steps of fourth order.

With the state x of velocity and strain the model is x' = A(t) x + f(t). A step of length h is two
of half the length, each exact for coefficients and a force that stand still at weighted means of
those at the Gauss points t₁ and t₂ of the step,

    x ← exp[h (a₂ A(t₁) + a₁ A(t₂))] exp[h (a₁ A(t₁) + a₂ A(t₂))] x,    a = 1/4 ± √3/6,

a commutator-free Magnus method of order four (Blanes and Moan, 2006). Each exponential is a Taylor
series to rounding, as h is short beside the fastest wave and damping. Steps end where a coefficient
or the force breaks. They are halved until the solution with half as many differs by little, which
by the order estimates the error that is left.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import factorial

import numpy as np

from sphpod.full.sph import State, change, wrap
from sphpod.numerics.compiled import compiled
from sphpod.numerics.course import Course, spans
from sphpod.scene.scene import Scene
from sphpod.scene.waves import fastest_wave

ORDER = 4

TIME_ERROR = 1e-10
"""Largest estimated error of the steps, of the solution's largest energy norm."""

HALVINGS = 8
"""How often steps are halved at most, the first being a radian of the fastest wave long, or less
where damping is faster."""

WITNESSES = 512
"""Outputs at which solutions with long and short steps are compared."""

EDGES = 2**16
"""Ends of polynomials of coefficients and force at which steps end, if they are not more."""

GAUSS = np.array([0.5 - np.sqrt(3) / 6, 0.5 + np.sqrt(3) / 6])
"""Gauss points of a step."""

MEANS = np.array([[0.25 + np.sqrt(3) / 6, 0.25 - np.sqrt(3) / 6]])
MEANS = np.concatenate([MEANS, MEANS[:, ::-1]])
"""Weights of the Gauss points in both halves of a step."""


def courses_of(scene: Scene) -> tuple[Course, ...]:
    """Courses of modulus, damping and force, as far as they change with time."""
    found = list(scene.courses())
    for key in ("youngs_modulus", "damping"):
        one = scene.changing(key)
        found += [] if one is None else one.courses
    return tuple(found)


def coefficient_terms(scene: Scene, key: str, steady: np.ndarray):
    """Factors of modulus or damping as a function of times, (r, times), and profiles (r, N).

    Of one that does not change with time the factor is 1.
    """
    one = scene.changing(key)
    if one is not None:
        return one.factors_at, one.profiles
    profiles = steady[None] if steady.size else np.zeros((0, 0))
    return (lambda times: np.ones((len(profiles), times.size))), profiles


def step_grid(
    times: np.ndarray, courses: tuple[Course, ...], longest: float, halvings: int = 0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Steps that end at outputs and wherever a coefficient or the force breaks.

    Parameters
    ----------
    times : array, shape (outputs,)
        Ascending from 0 [s].
    courses : tuple of Courses
    longest : float
        Longest step before it is halved [s].

    Returns
    -------
    starts, lengths : arrays, shape (steps,)
        [s].
    done : int array, shape (outputs,)
        Steps done at each output.
    """
    ends = [times, *(np.array([part.first, part.last]) for part in spans(courses, times[-1]))]
    edges = [course.edges for course in courses if np.isfinite(course.missed)]
    if sum(one.size for one in edges) <= EDGES:
        ends += edges
    cuts = np.unique(np.concatenate(ends))
    cuts = cuts[cuts <= times[-1]]
    widths = np.diff(cuts)
    parts = np.maximum(np.ceil(widths / longest * (1 - 1e-12)), 1).astype(np.int64) << halvings
    lengths = np.repeat(widths / parts, parts)
    first = np.concatenate([[0], np.cumsum(parts)])
    starts = np.repeat(cuts[:-1], parts)
    starts = starts + lengths * (np.arange(lengths.size) - np.repeat(first[:-1], parts))
    return starts, lengths, first[np.searchsorted(cuts, times)]


def means(
    functions: Callable[[np.ndarray], np.ndarray], starts: np.ndarray, lengths: np.ndarray
) -> np.ndarray:
    """Functions of time as both halves of each step see them, times its length.

    Parameters
    ----------
    functions : callable
        Of times (n,), shape (functions, n).
    starts, lengths : arrays, shape (steps,)
        [s].

    Returns
    -------
    array, shape (2 steps, functions)
    """
    nodes = starts[:, None] + lengths[:, None] * GAUSS
    values = functions(nodes.ravel())
    values = values.reshape(len(values), *nodes.shape)
    weighted = np.einsum("fsq,hq->shf", values, MEANS) * lengths[:, None, None]
    return np.ascontiguousarray(weighted.reshape(2 * starts.size, len(values)))


def series_terms(size: float) -> int:
    """Terms of the exponential's series that a matrix of this norm needs to rounding."""
    return next(n for n in range(2, 60) if size**n / factorial(n) < 1e-17)


@dataclass
class Stepped:
    """A march (`run.FullRun`) that steps, and what it says of its own error.

    Attributes
    ----------
    begin : (velocity, strain)
    time_error : float
        Of the last run, estimated: largest energy norm of the error over that of the solution.
    """

    scene: Scene
    begin: State
    time_error: float = field(default=np.nan, init=False)

    def __call__(self, velocity: np.ndarray, strain: np.ndarray, watch: bool) -> int:
        scene = self.scene
        mass = np.sqrt(scene.density0() * scene.volumes)
        stiffness = np.sqrt(scene.volumes * scene.largest_modulus())
        every = max(1, -(-len(velocity) // WITNESSES))
        coarse = None
        for halving in range(HALVINGS + 1):
            failed = self._run(velocity, strain, halving, watch)
            if failed >= 0:
                return failed
            fine = np.concatenate([velocity[::every] * mass, strain[::every] * stiffness], axis=1)
            if coarse is not None:
                size = np.linalg.norm(fine, axis=1).max() or 1.0
                difference = np.linalg.norm(fine - coarse, axis=1).max() / size
                self.time_error = float(difference / (2**ORDER - 1))
                if self.time_error <= TIME_ERROR:
                    break
            coarse = fine
        return -1

    def _run(self, velocity, strain, halving, watch):
        scene = self.scene
        fastest = max(fastest_wave(scene), scene.damping_range()[1])
        longest = 1 / max(fastest, 1 / scene.duration)
        starts, lengths, done = step_grid(scene.error_times, courses_of(scene), longest, halving)
        given = [
            coefficient_terms(scene, "youngs_modulus", scene.modulus()),
            coefficient_terms(scene, "damping", scene.damping_values()),
            (lambda times: scene.force_values(times)[0], scene.force_values(np.zeros(1))[1]),
        ]
        functions = tuple((means(f, starts, lengths), profiles) for f, profiles in given)
        return self._march(velocity, strain, functions, (lengths, done), watch)

    def _march(self, velocity, strain, functions, steps, watch):
        scene = self.scene
        weights, geometry = scene.neighbours()
        # Means may lie a little beyond the coefficients themselves.
        largest = 1.2 * fastest_wave(scene) + scene.damping_range()[1]
        terms = series_terms(0.55 * steps[0].max() * largest)
        state = np.stack(self.begin)
        grid = (*steps, terms, watch)
        space = weights, geometry, 1 / scene.density0()
        return march(state, space, functions, grid, (velocity, strain))


@compiled
def differentiate(given, weights, geometry, padded, result):
    """G field: of evenly spaced particles by the stencil, else by lists of neighbours."""
    width, count = weights.size, given.size
    if width == 0:
        first, neighbours, gradients = geometry
        for i in range(count):
            rate = 0.0
            for n in range(first[i], first[i + 1]):
                rate += gradients[n] * given[neighbours[n]]
            result[i] = rate
        return
    for i in range(count):
        padded[i + width] = given[i]
        result[i] = 0.0
    wrap(padded, width)
    for k in range(width):
        for i in range(count):
            result[i] += weights[k] * (padded[i + width + k + 1] - padded[i + width - k - 1])


@compiled
def march(state, space, functions, grid, kept):
    """``functions`` hold the means of modulus, damping and force in half steps, with profiles."""
    v, e = state[0], state[1]
    weights, geometry, inertia = space
    stiffening, slowing, forcing = functions
    lengths, done, terms, watch = grid
    velocity, strain = kept
    count = v.size
    modulus, damping, push = np.empty(count), np.empty(count), np.zeros(count)
    dv, de, stress = np.empty(count), np.empty(count), np.empty(count)
    pulled, stretched = np.empty(count), np.empty(count)
    padded = np.zeros(count + 2 * weights.size)
    damped, forced = slowing[0].shape[1] > 0, forcing[0].shape[1] > 0
    step = 0
    for row in range(done.size):
        while step < done[row]:
            for half in range(2 * step, 2 * step + 2):
                change(modulus, stiffening, half)
                if damped:
                    change(damping, slowing, half)
                if forced:
                    change(push, forcing, half)
                for i in range(count):
                    dv[i], de[i] = v[i], e[i]
                for term in range(1, terms):
                    for i in range(count):
                        stress[i] = modulus[i] * de[i]
                    differentiate(stress, weights, geometry, padded, pulled)
                    differentiate(dv, weights, geometry, padded, stretched)
                    for i in range(count):
                        pulled[i] *= inertia[i]
                        stretched[i] *= lengths[step] / 2
                    if damped:
                        for i in range(count):
                            pulled[i] -= damping[i] * dv[i]
                    if forced and term == 1:
                        for i in range(count):
                            pulled[i] += push[i]
                    for i in range(count):
                        dv[i], de[i] = pulled[i] / term, stretched[i] / term
                        v[i] += dv[i]
                        e[i] += de[i]
            step += 1
            if watch:
                for i in range(count):
                    if not (e[i] > -1 and e[i] < np.inf and abs(v[i]) < np.inf):
                        for j in range(count):
                            velocity[row, j], strain[row, j] = v[j], e[j]
                        return row * count + i
        for i in range(count):
            velocity[row, i], strain[row, i] = v[i], e[i]
    return -1
