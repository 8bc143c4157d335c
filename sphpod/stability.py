"""What theory says of a time step before a run, and the error of a run that broke down.

Explicit Euler multiplies a wave of angular frequency ω by 1 + iΔtω a step, so that its energy grows
by 1 + Δt²ω²; with damping d its rates λ are the roots of λ² + dλ + ω² = 0, and a step multiplies it
by 1 + Δtλ. How much the fastest wave grows over a run needs a bound of its frequency alone, how
much the energy of the initial velocity does only how it is spread over frequencies: neither takes a
spectrum.
"""

import logging

import numpy as np

from sphpod.error import blocks
from sphpod.kernel import stencil_weights

MOMENTS = 16
"""Nodes of the quadrature over the frequencies of the initial velocity."""

REPORTED_GROWTH = 1.01
"""Growth of the solution's own energy from which the log tells of it."""


RESOLVED = 0.25
"""Angle [rad] of the fastest wave that outputs may be apart to show a fold of the line.

Between them a strain differs from what they show by less than a hundredth of its amplitude.
"""


class Breakdown(ArithmeticError):
    """A solution became non-finite, or its Jacobian J = ρ0/ρ stopped being positive."""

    def __init__(self, scene_name, model, time, particle):
        super().__init__(
            f"scene {scene_name}: {model} broke down by t = {time:.6g} s at particle {particle}: "
            "its velocity or density is not finite, or its Jacobian rho0/rho is not positive"
        )
        self.time = time
        self.particle = particle


def first_broken(limit, coordinates, modes, rows):
    """Where a reduced field is first not finite or not above a limit, where a cheap test is unsure.

    Parameters
    ----------
    limit : float
    coordinates : array, shape (times, k)
    modes : array, shape (k, N)
    rows : int array
        Ascending rows of the coordinates, the only ones whose field is reconstructed.

    Returns
    -------
    row, particle : ints
        The first such row and the particle that is furthest below; -1 and -1 without one.
    """
    for some in blocks(rows.size):
        with np.errstate(over="ignore", invalid="ignore"):
            fields = coordinates[rows[some]] @ modes
        fields = np.where(fields < np.inf, fields, -np.inf)
        broken = fields.min(axis=1) <= limit
        if broken.any():
            first = int(broken.argmax())
            return int(rows[some][first]), int(fields[first].argmin())
    return -1, -1


def fastest_wave(scene):
    """Upper bound of the angular frequency of the fastest wave that the particles carry.

    The frequencies of waves are the singular values of A = diag(V/ρ0)^(1/2) G diag(c/V)^(1/2) with
    the SPH derivative G. Its 2-norm is at most the root of its largest row sum times its largest
    column sum of |A|; of evenly spaced particles it is also at most the largest value of the
    stencil's symbol times the largest √c and 1/√ρ0, and the smaller is taken.

    Returns
    -------
    float
        Angular frequency [1/s].
    """
    root_c = np.sqrt(scene.modulus())
    root_inertia = 1 / np.sqrt(scene.density0())
    if not scene.is_even:
        first, neighbours, gradients = scene.neighbour_lists()
        particle = np.repeat(np.arange(root_c.size), np.diff(first.astype(np.int64)))
        other, root_volume = neighbours.astype(np.int64), np.sqrt(scene.volumes)
        entries = root_inertia[particle] * root_volume[particle] * np.abs(gradients)
        entries *= root_c[other] / root_volume[other]
        sums = (np.bincount(at, entries, root_c.size).max() for at in (particle, other))
        return float(np.sqrt(np.prod(list(sums))))
    weights = stencil_weights(scene.spacing, scene.smoothing_ratio)
    angles = np.linspace(0, np.pi, 721)
    k = np.arange(1, weights.size + 1)
    # Between two angles the symbol is above both by at most its curvature times their distance²/8.
    missed = np.sum(2 * k**2 * np.abs(weights)) * angles[1] ** 2 / 8
    symbol = np.max(np.abs(2 * np.sin(np.outer(angles, k)) @ weights)) + missed
    by_symbol = symbol * root_c.max() * root_inertia.max()

    def widest_sum(a, b):
        rows = sum(w * (np.roll(b, -n) + np.roll(b, n)) for n, w in zip(k, weights, strict=True))
        return np.max(a * rows)

    by_sums = np.sqrt(widest_sum(root_inertia, root_c) * widest_sum(root_c, root_inertia))
    return float(min(by_symbol, by_sums))


def growth_factor(scene, time_step=None):
    """Factor by which explicit Euler lets the fastest-growing wave grow over the duration.

    A wave of angular frequency ω under damping d has the rates λ with λ² + dλ + ω² = 0, and a step
    multiplies it by |1 + Δt λ|. Where the damping varies, an eigenvector (u, p) of rate λ with
    |u| = 1 obeys λ² + λ u*Du + |Aᵀu|² = 0: its own d and ω lie between the scene's extremes.

    Parameters
    ----------
    scene : Scene
    time_step : float, optional
        Δt [s]; the scene's own if not given.

    Returns
    -------
    float
        Largest growth over T, at least 1; infinite when it is beyond floating point.
    """
    step = scene.time_step if time_step is None else time_step
    rate = _growth_rate(np.linspace(0, fastest_wave(scene), 201), step, _dampings(scene)).max()
    with np.errstate(over="ignore"):
        return float(np.exp(rate * scene.duration))


def energy_growth(scene):
    """Factor by which explicit Euler changes the energy of the initial velocity over the duration.

    With the shares p_j of the waves in that energy it is Σ p_j g(ω_j)², g as in `growth_factor`: an
    integral over a measure of which a few steps of Lanczos' method give the Gauss quadrature, exact
    for polynomials of ω² up to degree 2 `MOMENTS` - 1 (Golub and Meurant). Undamped it is the
    energy of the linear solution, to rounding. Under damping it is an estimate, of which only the
    side of one is meant: the two rates of a wave are not orthogonal, and of a damping that varies
    the smallest value is taken. The profile of a force is looked at in the same way, and the larger
    growth told.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    float
        Energy at the end, of that at the start; 1 where nothing moves.
    """
    damping = scene.damping_values()
    smallest = {float(damping.min(initial=np.inf))} if damping.size else {0.0}
    _, profile = scene.force_values(np.zeros(1))
    growth = []
    for velocity in (scene.velocity0(), profile):
        if np.any(velocity):
            squares, shares = _frequencies_of(scene, velocity)
            rates = _growth_rate(np.sqrt(squares), scene.time_step, smallest)
            with np.errstate(over="ignore"):
                growth.append(float(shares @ np.exp(2 * rates * scene.duration)))
    return max(growth, default=1.0)


def translation_strain(scene):
    """Strain rate of a translation, of that of the longest wave with the same mean square velocity.

    It is zero for evenly spaced particles. For others Σ_j V_j ∇W_ij is not, and as the gradient of
    the kernel is of the order 1/Δx² it grows with the number of particles.
    """
    still = scene.derivative(np.ones(scene.particle_count))
    # A wave √2 sin(2πx/L) moves as much as translation by 1, and its gradient is 2π/L in the mean.
    rms = np.sqrt(np.sum(scene.volumes * still**2) / scene.domain_length)
    return float(rms / (2 * np.pi / scene.domain_length))


def foretell(scene):
    """What explicit Euler will do to the waves of a scene, to be stored beside its solution.

    Growth of the solution's own energy by more than a hundredth is told in the log, with what would
    avoid it.

    Returns
    -------
    dict
        energy_growth, as from `energy_growth`, fastest_wave_growth, as from `growth_factor`, and
        of particles that are not evenly spaced translation_strain, as from `translation_strain`.
    """
    told = {"energy_growth": energy_growth(scene), "fastest_wave_growth": growth_factor(scene)}
    if not scene.is_even:
        told["translation_strain"] = translation_strain(scene)
        logging.getLogger(__name__).warning(
            "scene %s: positions.jitter = %g: a translation strains these particles %.2g times as "
            "much as the longest wave does, so that the solution does not tend to that of the "
            "line, however many particles there are",
            scene.name,
            scene.jitter,
            told["translation_strain"],
        )
    if told["energy_growth"] > REPORTED_GROWTH:
        logging.getLogger(__name__).warning(
            "scene %s: time_step = %g: explicit Euler lets the energy of the solution grow by "
            "%.2g %% over %g s, and the fastest wave to %.3g times its amplitude; leapfrog and "
            "symplectic Euler in strain keep both with steps up to %.3g s",
            scene.name,
            scene.time_step,
            100 * (told["energy_growth"] - 1),
            scene.duration,
            told["fastest_wave_growth"],
            1.99 / fastest_wave(scene),  # not rounded beyond the limit of 2
        )
    return told


def warn_of_step(scene, integrator, time_step):
    """Tell in the log of a step of symplectic Euler or leapfrog that may let the fastest wave grow.

    Both are stable for Δt ω ≤ 2, and damping only helps; the bound of ω is taken.
    """
    largest = 2 / fastest_wave(scene)
    if time_step > largest:
        logging.getLogger(__name__).warning(
            "scene %s: time_step = %g: %s may let the fastest wave grow without end; up to %.3g s "
            "it does not",
            scene.name,
            time_step,
            integrator,
            0.995 * largest,  # not rounded beyond it
        )


def _dampings(scene):
    """Smallest and largest damping coefficient [1/s]."""
    damping = scene.damping_values()
    return {float(damping.min()), float(damping.max())} if damping.size else {0.0}


def _growth_rate(frequency, step, dampings):
    """Largest growth rate [1/s] of waves of angular frequencies under any of the dampings."""
    frequency = np.asarray(frequency, complex)
    rates = []
    for d in dampings:
        root = np.sqrt(d**2 / 4 - frequency**2)
        for wave in (-d / 2 + root, -d / 2 - root):
            with np.errstate(divide="ignore"):
                rates.append(np.log(np.abs(1 + step * wave)) / step)
    return np.max(rates, axis=0)


def _frequencies_of(scene, velocity):
    """Squares of angular frequencies [1/s²], and the shares of a velocity's energy in them.

    Lanczos' method for v -> -(1/ρ0) G (c G v), symmetric in the inner product Σ m v w.
    """
    density0, modulus = scene.density0(), scene.modulus()
    mass = density0 * scene.volumes
    rows = np.zeros((MOMENTS, velocity.size))
    diagonal, beside = np.zeros(MOMENTS), np.zeros(MOMENTS)
    row = velocity / np.sqrt(np.sum(mass * velocity**2))
    for n in range(MOMENTS):
        rows[n] = row
        rest = -scene.derivative(modulus * scene.derivative(row)) / density0
        diagonal[n] = np.sum(mass * row * rest)
        # Twice, or rounding lets directions come back.
        for _ in range(2):
            rest -= (rows[: n + 1] @ (mass * rest)) @ rows[: n + 1]
        beside[n] = np.sqrt(np.sum(mass * rest**2))
        if beside[n] <= 1e-12 * (np.abs(diagonal).max() + beside.max()) or n == MOMENTS - 1:
            break
        row = rest / beside[n]
    matrix = np.diag(diagonal[: n + 1]) + np.diag(beside[:n], 1) + np.diag(beside[:n], -1)
    squares, vectors = np.linalg.eigh(matrix)
    return np.maximum(squares, 0), vectors[0] ** 2


def largest_time_step(scene, growth):
    """Largest explicit Euler step [s] under which no wave grows by more than ``growth`` over T."""
    low, high = 0.0, scene.time_step
    while growth_factor(scene, high) <= growth:
        if high >= scene.duration:
            return scene.duration
        low, high = high, min(2 * high, scene.duration)
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if growth_factor(scene, middle) <= growth else (low, middle)
    return low
