"""What theory says of a time step before a run.

Explicit Euler multiplies a wave of angular frequency ω by 1 + iΔtω a step, so that its energy grows
by 1 + Δt²ω²; with damping d its rates λ are the roots of λ² + dλ + ω² = 0, and a step multiplies it
by 1 + Δtλ. What bounds the growth of all waves over a run is mostly a bound of their frequencies
alone; by how much the energy grows, where nothing damps or pushes, needs to be known of the initial
velocity only how it is spread over frequencies: neither takes a spectrum.
"""

import logging
from functools import lru_cache

import numpy as np

from sphpod.scene.kernel import stencil_weights
from sphpod.scene.scene import derivative_matrix

MOMENTS = 24
"""Nodes of the quadrature over the frequencies of the initial velocity."""

REPORTED_GROWTH = 1.01
"""Growth of the energy from which the log reports it."""

GROWTH_LIMIT = 1e6
"""Largest growth of a wave over T with which a run is worth starting."""

MOST_DENSE, MOST_STEPS = 400, 1e9
"""Particles and steps up to which powers of the step are taken, as dense matrices."""


@lru_cache(maxsize=8)
def fastest_wave(scene):
    """Upper bound of the angular frequency of the fastest wave that the particles carry.

    The frequencies of waves, of the largest modulus if it changes with time, are the singular
    values of A = diag(V/ρ0)^(1/2) G diag(c/V)^(1/2) with the SPH derivative G. Its 2-norm is at
    most the root of its largest row sum times its largest column sum of |A|; of evenly spaced
    particles it is also at most the largest value of the stencil's symbol times the largest √c and
    1/√ρ0, and the smaller is taken.

    Returns
    -------
    float
        Angular frequency [1/s].
    """
    return _fastest(scene, scene.largest_modulus())


def _fastest(scene, modulus):
    """Bound of `fastest_wave` with a modulus of each particle [Pa]."""
    root_c = np.sqrt(modulus)
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


def growth_factor(scene, time_step=None, limit=GROWTH_LIMIT):
    """Upper bound of the growth of every wave under explicit Euler over the duration.

    A wave of rate λ is u with |u| = 1 and λ² u + λ D u + A Aᵀ u = 0. With δ = u*Du and κ = |Aᵀu|²
    its rate is a root of λ² + δλ + κ = 0. A step multiplies the wave by 1 + Δt λ, of which

        |1 + Δt λ|² = 1 + Δt (Δt κ - δ)                 if λ is not real, and
        |1 + Δt λ| ≤ max(1, Δt d - 1), d the largest,   if it is, as then -δ ≤ λ ≤ 0.

    The largest Δt κ - δ is at most Δt ω² - d with the bound ω of `fastest_wave` and the smallest d;
    closer, where c and d do not change with time, it is at most the largest eigenvalue of
    Δt A Aᵀ - D, which where d is uniform the fastest wave attains. Where d varies, a wave that soon
    leaves the places that let it grow may grow by far less. The last resort is the largest growth
    of energy's root itself, for up to `MOST_DENSE` particles. It is no bound: some disturbance
    grows as much. It counts the growth that waves, as they are not orthogonal, have together before
    each decays.

    Parameters
    ----------
    scene : Scene
    time_step : float, optional
        Δt [s]; the scene's own if not given.
    limit : float
        A closer bound is only computed if one is above this.

    Returns
    -------
    float
        Growth of the amplitude over T, at least 1; infinite when it is beyond floating point.
    """
    step = scene.time_step if time_step is None else time_step
    smallest, largest = _damping_range(scene)
    fastest = fastest_wave(scene)
    excess = step * fastest * fastest - smallest
    growth = _growth_with(scene, step, excess, largest)
    if not scene.is_steady:
        return growth
    if growth > limit and excess < np.inf:
        growth = _growth_with(scene, step, _largest_excess(scene, step, excess), largest)
    uneven = smallest < largest and scene.particle_count <= MOST_DENSE
    if growth > limit and uneven and scene.duration / step < MOST_STEPS:
        growth = min(growth, max(1.0, _norm_of_powers(scene, step)))
    return growth


def loose_growth_factor(scene, largest_modulus, damping):
    """The bound of `growth_factor` from bounds alone, by which nothing needs to be looked at.

    Parameters
    ----------
    scene : Scene
    largest_modulus : float
        No particle ever has more [Pa].
    damping : (float, float)
        No particle ever has less than the first, nor more than the second [1/s].
    """
    fastest = _fastest(scene, np.full(scene.particle_count, largest_modulus))
    step = scene.time_step
    return _growth_with(scene, step, step * fastest * fastest - damping[0], damping[1])


def _growth_with(scene, step, excess, damping):
    """Growth over T with the largest Δt κ - δ and the largest damping [1/s], as `growth_factor`."""
    stiff = max(step * damping - 1, 1)
    rate = max(np.log1p(step * max(excess, 0)) / 2, np.log(stiff)) / step
    with np.errstate(over="ignore"):
        return float(np.exp(rate * scene.duration))


def energy_growth(scene):
    """Factor by which explicit Euler lets the energy grow that the exact solution keeps.

    With the shares p_j of the waves in the energy of the initial velocity it is
    Σ p_j (1 + Δt²ω_j²)ⁿ: an integral over a measure of which a few steps of Lanczos' method give
    the Gauss quadrature, exact for polynomials of ω² up to degree 2 `MOMENTS` - 1 (Golub and
    Meurant). Under damping the two rates of a wave are not orthogonal, and a force feeds waves at
    all times: then no such sum is the energy.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    float
        Energy after T, of that at the start. NaN if the scene is damped or forced, or so nearly at
        rest that more than a thousandth of it may come from rounding
        (`sphpod.studies.growth.Waves`), or starts strained.
    """
    if not scene.is_conservative or scene.start:
        return np.nan
    velocity = scene.velocity0()
    weights = scene.density0() * scene.volumes
    peak = np.abs(velocity).max()
    if peak == 0:
        return np.nan
    # Of a density in a step, of its own spacing in floating point.
    variance = np.finfo(float).eps ** 2 / 12
    rounding = np.sum(scene.volumes * scene.modulus()) * variance * scene.step_count
    rounding *= growth_factor(scene) ** 2
    velocity /= peak
    with np.errstate(over="ignore"):
        if not rounding / peak / peak <= 1e-3 * np.sum(weights * velocity**2):
            return np.nan
    squares, shares = _frequencies_of(scene, velocity)
    return float(shares @ np.exp(np.log1p(scene.time_step**2 * squares) * scene.step_count))


def translation_strain(scene):
    """Strain rate of a translation, of that of the longest wave with the same mean square velocity.

    It is zero for evenly spaced particles. For others Σ_j V_j ∇W_ij is not, and as the gradient of
    the kernel is of the order 1/Δx² it grows with the number of particles.
    """
    still = scene.derivative(np.ones(scene.particle_count))
    # A wave √2 sin(2πx/L) moves as much as translation by 1, and its gradient is 2π/L in the mean.
    rms = np.sqrt(np.sum(scene.volumes * still**2) / scene.domain_length)
    return float(rms / (2 * np.pi / scene.domain_length))


def predict(scene):
    """What explicit Euler will do to the waves of a scene, to be stored beside its solution.

    Energy that grows by more than a hundredth is reported in the log, with what would avoid it.

    Returns
    -------
    dict
        wave_growth_bound, as from `growth_factor`; predicted_energy_growth, as from
        `energy_growth`, where that is a number; and of particles that are not evenly spaced
        translation_strain, as from `translation_strain`.
    """
    predicted = {"wave_growth_bound": growth_factor(scene)}
    energy = energy_growth(scene)
    if not np.isnan(energy):
        predicted["predicted_energy_growth"] = energy
    if not scene.is_even:
        predicted["translation_strain"] = translation_strain(scene)
        logging.getLogger(__name__).warning(
            "scene %s: positions.jitter = %g: a translation strains these particles %.2g times as "
            "much as the longest wave does, so that the solution does not tend to that of the "
            "line, however many particles there are",
            scene.name,
            scene.jitter,
            predicted["translation_strain"],
        )
    if energy > REPORTED_GROWTH:
        logging.getLogger(__name__).warning(
            "scene %s: time_step = %g: explicit Euler lets the energy, which the exact solution "
            "keeps, grow by %.2g %% over %g s, and waves to up to %.3g times their amplitude; "
            "leapfrog and symplectic Euler in strain let no wave grow with steps up to "
            "%.3g s",
            scene.name,
            scene.time_step,
            100 * (energy - 1),
            scene.duration,
            predicted["wave_growth_bound"],
            1.99 / fastest_wave(scene),  # not rounded beyond the limit of 2
        )
    return predicted


def warn_of_step(scene, integrator, time_step):
    """Report in the log a step of symplectic Euler or leapfrog that may let the fastest wave grow.

    With the smallest damping d both are stable for (Δt ω²/d) tanh(d Δt/2) < 2, under which the
    energies of `sphpod.full.energy` are norms. As tanh x is below x and 1, that is so for Δt ω < 2
    and for Δt ω² < 2 d; the bound of ω is taken.
    """
    fastest = fastest_wave(scene)
    largest = max(2 / fastest, 2 * scene.damping_range()[0] / fastest**2)
    if time_step > largest:
        logging.getLogger(__name__).warning(
            "scene %s: time_step = %g: %s may let the fastest wave grow without end; up to %.3g s "
            "it does not",
            scene.name,
            time_step,
            integrator,
            0.995 * largest,  # not rounded beyond it
        )


def largest_time_step(scene, growth):
    """Explicit Euler step [s] that keeps `growth_factor` within ``growth``, T at most.

    There is no larger one, but for 0.5 % of the step or a third of the growth.
    """

    def excess(step):
        # Finite, or there would be nothing to interpolate.
        return min(np.log(growth_factor(scene, step, growth / 1.5) / growth), 1e3)

    low, high = 0.0, scene.time_step
    below, above = -np.log(growth), excess(high)
    while above <= 0:
        if high >= scene.duration:
            return scene.duration
        low, below = high, above
        high = min(2 * high, scene.duration)
        above = excess(high)
    part = 0.5
    while high - low > 5e-3 * high and (low == 0 or below < -0.4):
        # The logarithm is nearly proportional to the step, but where it is still zero or jumps:
        # every other part is a half.
        part = 0.5 if part != 0.5 else min(max((-0.2 - below) / (above - below), 0.05), 0.95)
        if low == 0 and above == 1e3:
            part = 1e-3
        middle = low + (high - low) * part
        found = excess(middle)
        if found <= 0:
            low, below = middle, found
        else:
            high, above = middle, found
    return low


@lru_cache(maxsize=8)
def _damping_range(scene):
    return scene.damping_range()


@lru_cache(maxsize=2)
def _coupling(scene):
    """A of the scaled fields of `sphpod.full.lifted` [1/s], a scipy.sparse matrix (N, N)."""
    from scipy.sparse import diags_array

    stiffness = np.sqrt(scene.modulus() / scene.volumes)
    inertia = np.sqrt(scene.volumes / scene.density0())
    return (diags_array(inertia) @ derivative_matrix(scene) @ diags_array(stiffness)).tocsr()


def _largest_excess(scene, step, bound):
    """Largest eigenvalue of Δt A Aᵀ - D, never from below [1/s].

    Bisected from a bound, as σ is above it where σ I + D - Δt A Aᵀ has a Cholesky factor.
    """
    from scipy.linalg import LinAlgError, cholesky_banded
    from scipy.sparse import coo_array, diags_array

    coupling = _coupling(scene)
    matrix = step * (coupling @ coupling.T)
    damping = scene.damping_values()
    if damping.size:
        matrix = matrix - diags_array(damping)
    # Both sides of the ring in turn, so that neighbours stay near one another in one row.
    count = scene.particle_count
    place = np.minimum(2 * np.arange(count), 2 * (count - np.arange(count)) - 1)
    matrix = coo_array(matrix)
    row, column = place[matrix.row], place[matrix.col]
    lower = row >= column
    banded = np.zeros((int((row - column).max()) + 1, count))
    banded[(row - column)[lower], column[lower]] = -matrix.data[lower]
    low, high = float(-banded[0].min()), float(bound)
    # So close, growth over T is known to a hundredth.
    while high - low > max(0.02 / scene.duration, 1e-4 * abs(high)):
        middle = (low + high) / 2
        shifted = banded.copy()
        shifted[0] += middle
        try:
            cholesky_banded(shifted, overwrite_ab=True, lower=True, check_finite=False)
            high = middle
        except LinAlgError:
            low = middle
    return high


def _norm_of_powers(scene, step):
    """Norm, in which energies are summed, of the power of the step over T, or of a larger one.

    With J = diag(1, -1) a step S = I + Δt M obeys Sᵀ = J S J, so that J times a power is symmetric,
    [[a, b], [bᵀ, c]], and its eigenvalue of largest size is the norm. Powers are squared, and
    multiplied by S; the one among them that is largest, by its squares, is looked at too.
    """
    from scipy.sparse import diags_array, eye_array

    count = scene.particle_count
    kept = diags_array(1 - step * scene.damping_values()).tocsr()
    one = kept, step * _coupling(scene), -eye_array(count).tocsr()

    def product(left, right):
        # A matrix times its own transpose takes half the products; a and c are their own.
        (a, b, c), (other_a, other_b, other_c) = left, right
        return (
            a @ other_a.T - b @ other_b.T,
            a @ other_b - b @ other_c,
            b.T @ other_b - c @ other_c.T,
        )

    def norm(power):
        a, b, c = (x if isinstance(x, np.ndarray) else x.toarray() for x in power)
        return float(np.abs(np.linalg.eigvalsh(np.block([[a, b], [b.T, c]]))).max())

    power, largest, size = one, one, 0.0
    with np.errstate(over="ignore", invalid="ignore"):
        for digit in f"{int(np.ceil(scene.duration / step * (1 - 1e-9))):b}"[1:]:
            power = product(power, power)
            if digit == "1":
                power = product(power, one)
            if not isinstance(power[1], np.ndarray):
                if power[1].nnz < count**2 / 4:
                    continue
                power = tuple(x.toarray() for x in power)
            if not (found := float(sum(np.linalg.norm(x) for x in power))) < np.inf:
                return np.inf
            if found >= size:
                size, largest = found, power
        return norm(power) if largest is power else max(norm(power), norm(largest))


def _frequencies_of(scene, velocity):
    """Squares of angular frequencies [1/s²], and the shares of a velocity's energy in them.

    Lanczos' method for v -> -(1/ρ0) G (c G v), symmetric in the inner product Σ m v w.
    """
    density0, modulus = scene.density0(), scene.modulus()
    mass = density0 * scene.volumes
    # Of uneven particles the derivative is a matrix, to be made once.
    derivative = scene.derivative if scene.is_even else derivative_matrix(scene).__matmul__
    rows = np.zeros((MOMENTS, velocity.size))
    diagonal, beside = np.zeros(MOMENTS), np.zeros(MOMENTS)
    row = velocity / np.sqrt(np.sum(mass * velocity**2))
    for n in range(MOMENTS):
        rows[n] = row
        rest = -derivative(modulus * derivative(row)) / density0
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
