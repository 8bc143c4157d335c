"""What theory says of a time step before a run, and the error of a run that broke down."""

import numpy as np

from sphpod.error import blocks
from sphpod.kernel import stencil_weights


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

    The waves are the singular values of K = diag(ρ0)^(-1/2) G diag(c)^(1/2) with the SPH
    derivative G; two bounds of its 2-norm are taken, the smaller is returned.

    Returns
    -------
    float
        Angular frequency [1/s].
    """
    weights = stencil_weights(scene.spacing, scene.smoothing_ratio)
    root_c = np.sqrt(scene.modulus())
    root_inertia = 1 / np.sqrt(scene.density0())
    angles = np.linspace(0, np.pi, 721)
    k = np.arange(1, weights.size + 1)
    symbol = np.max(np.abs(2 * np.sin(np.outer(angles, k)) @ weights))
    by_symbol = symbol * root_c.max() * root_inertia.max()

    def widest_sum(a, b):
        rows = sum(w * (np.roll(b, -n) + np.roll(b, n)) for n, w in zip(k, weights, strict=True))
        return np.max(a * rows)

    by_sums = np.sqrt(widest_sum(root_inertia, root_c) * widest_sum(root_c, root_inertia))
    return float(min(by_symbol, by_sums))


def growth_factor(scene, time_step=None):
    """Factor by which explicit Euler lets the fastest-growing wave grow over the duration.

    A wave of angular frequency ω under damping d has the rates λ with λ² + dλ + ω² = 0, and a step
    multiplies it by |1 + Δt λ|.

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
    damping = scene.damping_values()
    extremes = {float(damping.min()), float(damping.max())} if damping.size else {0.0}
    frequency = np.linspace(0, fastest_wave(scene), 201).astype(complex)
    rate = 0.0
    for d in extremes:
        root = np.sqrt(d**2 / 4 - frequency**2)
        for wave in (-d / 2 + root, -d / 2 - root):
            rate = max(rate, float(np.log(np.abs(1 + step * wave)).max()))
    with np.errstate(over="ignore"):
        return float(np.exp(rate * scene.duration / step))


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
