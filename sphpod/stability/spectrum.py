"""What the spectrum says of a model: its waves, and the largest time step that keeps each.

A linear model y' = M y with eigenvalues λ is stepped by a matrix whose eigenvalues μ follow from
them, and its solutions stay bounded if no |μ| is above 1. In the scaled fields of
`sphpod.full.lifted`,

    M = [[-D, A], [-Aᵀ, 0]],

the singular values of A are the angular frequencies ω of waves. Under uniform damping d each wave
stands alone, and its two rates obey λ² + d λ + ω² = 0; otherwise M is one block.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg

from sphpod.full import lifted
from sphpod.scene.scene import Scene

ROUNDING = 1e-10
"""Part of the largest eigenvalue below which another, or a real part, is taken for rounding."""

SPLITTINGS = ("symplectic_euler", "leapfrog")
"""Integrators that drift the strain and kick the velocity in turn."""


def frequencies(scene: Scene) -> np.ndarray:
    """Angular frequencies of the full model's waves [1/s], descending, shape (N,)."""
    return scipy.linalg.svdvals(coupling(scene))


def coupling(scene: Scene) -> np.ndarray:
    """A of the scaled fields [1/s], dense, shape (N, N)."""
    return lifted.operator(scene)[: scene.particle_count, scene.particle_count :].toarray()


def wave_rates(frequency: np.ndarray, damping: float) -> np.ndarray:
    """Both roots of λ² + d λ + ω² = 0 for each frequency (n,), shape (2, n) [1/s].

    The smaller of two real roots is ω² over the larger, which loses no digits; of an undamped wave
    the real parts are zero.
    """
    root = np.sqrt((damping**2 / 4 - frequency**2).astype(complex))
    fast = -damping / 2 - root
    slow = np.divide(frequency**2, fast, out=np.zeros_like(fast), where=fast != 0)
    return np.stack([fast, np.where(root.imag == 0, slow, fast.conj())])


# --- Largest steps --------------------------------------------------------------------------------


def neutral(rates: np.ndarray, blur: float = 0.0) -> np.ndarray:
    """Which eigenvalues are zero as far as they are known: theirs neither decays nor moves.

    Parameters
    ----------
    rates : complex array
        λ [1/s].
    blur : float
        How well they are known, beside rounding [1/s].
    """
    size = np.abs(rates)
    return size <= max(blur, ROUNDING * size.max(initial=0))


def euler_limits(rates: np.ndarray, blur: float = 0.0) -> np.ndarray:
    """Largest stable step of explicit Euler for each eigenvalue [s].

    |1 + Δt λ| ≤ 1 is Δt ≤ -2 Re λ/|λ|²: d/ω² for an underdamped wave, 2/|λ| for a real rate. A
    `neutral` eigenvalue sets no limit (infinity); one whose real part is not negative allows no
    step (0), however small.
    """
    still, size = neutral(rates, blur), np.abs(rates)
    decays = rates.real < -ROUNDING * size.max(initial=0)
    limits = -2 * rates.real / np.where(still, 1, size) ** 2
    return np.where(still, np.inf, np.where(decays, limits, 0))


def euler_growth_rates(rates: np.ndarray, time_step: float) -> np.ndarray:
    """ln |1 + Δt λ|/Δt [1/s]: of an undamped wave ln(1 + ω² Δt²)/(2 Δt), about ω² Δt/2."""
    step = time_step * rates
    # |1 + z|² - 1, of which nothing cancels where z is small.
    return np.log1p(2 * step.real + np.abs(step) ** 2) / (2 * time_step)


def splitting_limit(frequency: float, damping: float) -> float:
    """Largest stable step of symplectic Euler and leapfrog for a wave under uniform damping [s].

    It is where (Δt ω²/d) tanh(d Δt/2) = 2, which without damping is ω Δt = 2.

    Proof. With K = exp(-d Δt), a step of symplectic Euler drifts and kicks,

        p₁ = p - Δt ω u,    u₁ = K u + (1 - K) (ω/d) p₁.

    Its matrix has the determinant K, as drift and kick have 1 and K, and the trace

        τ = 1 + K - (Δt ω²/d) (1 - K).

    Leapfrog's half drift, kick, half drift is similar to it (move one half drift to the other
    side), so both numbers are the same. By Jury's conditions no root of μ² - τ μ + K is outside the
    unit circle if |K| ≤ 1 and |τ| ≤ 1 + K. The first holds for d ≥ 0, and so does τ ≤ 1 + K; what
    is left is -τ ≤ 1 + K, that is (Δt ω²/d) (1 - K) ≤ 2 (1 + K), and (1 - K)/(1 + K) is
    tanh(d Δt/2). As d goes to 0 the left side goes to Δt² ω²/2. Its left side grows with Δt, so
    that all smaller steps are stable too, and with ω, so that the fastest wave decides; it falls
    with d, so that damping only helps. At the limit itself an undamped wave has the double root -1,
    and grows linearly.  ∎
    """
    if damping == 0:
        return 2 / frequency

    def grows(time_step):
        return time_step * frequency**2 / damping * np.tanh(damping * time_step / 2) > 2

    return crossing(grows, 2 / frequency)


def stability_polynomial(integrator: str) -> np.ndarray:
    """Coefficients of R, constant first: a Runge-Kutta step multiplies a wave by R(Δt λ).

    R(z) = 1 + z bᵀ (1 - z A)⁻¹ 1 = 1 + Σ z^(j+1) bᵀ Aʲ 1 with A and b of scipy's tableaus.
    """
    method = _solver(integrator)
    stages = method.n_stages
    # The pair that takes its last stage for the next first one stores no column for it.
    tableau = np.zeros((stages, stages))
    tableau[:, : method.A.shape[1]] = method.A
    coefficients, powers = [1.0], np.ones(stages)
    for _ in range(stages):
        coefficients.append(method.B @ powers)
        powers = tableau @ powers
    return np.array(coefficients)


def _solver(integrator):
    from scipy import integrate

    return getattr(integrate, integrator.upper())


def runge_kutta_limits(rates: np.ndarray, integrator: str) -> np.ndarray:
    """Largest step of rk45 or dop853 up to which |R(Δt λ)| ≤ 1, for each eigenvalue [s].

    It is the first crossing on the ray of λ, found on a grid and then by bisection. On it |R| may
    be above 1 by rounding only, which its order makes it next to 1 near zero.
    """
    coefficients = stability_polynomial(integrator)
    rays = np.unique(np.round(np.angle(rates) % (2 * np.pi), 13))

    def grows(radius, angle):
        return np.abs(np.polyval(coefficients[::-1], radius * np.exp(1j * angle))) > 1 + 1e-12

    grid = np.linspace(0, 2 * coefficients.size, 4001)
    reach = {}
    for angle in rays:
        beyond = np.flatnonzero(grows(grid, angle))
        if not beyond.size:
            reach[angle] = np.inf
            continue
        low, high = grid[max(beyond[0] - 1, 0)], grid[beyond[0]]
        while high - low > 1e-13 * high:
            middle = (low + high) / 2
            if not low < middle < high:
                break
            low, high = (low, middle) if grows(middle, angle) else (middle, high)
        reach[angle] = low
    radii = np.array([reach[a] for a in np.round(np.angle(rates) % (2 * np.pi), 13).flat])
    size = np.where(neutral(rates), 1, np.abs(rates))
    return np.where(neutral(rates), np.inf, radii.reshape(rates.shape) / size)


def crossing(grows: Callable[[float], bool], guess: float, accuracy: float = 1e-13) -> float:
    """Step from which ``grows`` is true, by bisection to a relative accuracy.

    The search begins within a factor of two of the guess and widens to a million of it: 0 if even
    the smallest grows, infinity if the largest does not.
    """
    low, high = guess / 2, guess * 2
    while grows(low):
        low, high = low / 2, low
        if low < 1e-6 * guess:
            return 0.0
    while not grows(high):
        low, high = high, high * 2
        if high > 1e6 * guess:
            return np.inf
    while high - low > accuracy * high:
        middle = (low + high) / 2
        low, high = (low, middle) if grows(middle) else (middle, high)
    return (low + high) / 2


# --- Steps ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Block:
    """Part of a scaled full model that meets no other: u' = -d∘u + B p, p' = -Bᵀ u.

    Attributes
    ----------
    coupling : array, shape (n, n)
        B [1/s].
    damping : array, shape (n,)
        d [1/s].
    velocity_shapes, strain_shapes : arrays, shapes (N, n)
        Scaled fields of u and p.
    """

    coupling: np.ndarray
    damping: np.ndarray
    velocity_shapes: np.ndarray
    strain_shapes: np.ndarray

    @property
    def operator(self) -> np.ndarray:
        """[[-diag(d), B], [-Bᵀ, 0]], shape (2n, 2n)."""
        none = np.zeros_like(self.coupling)
        return np.block([[-np.diag(self.damping), self.coupling], [-self.coupling.T, none]])

    def step(self, integrator: str, time_step: float) -> np.ndarray:
        """Matrix of one step of any integrator of `sphpod.full.lifted`, shape (2n, 2n)."""
        operator, identity = time_step * self.operator, np.eye(2 * len(self.damping))
        if integrator == "explicit_euler":
            return identity + operator
        if integrator == "exact":
            return scipy.linalg.expm(operator)
        if integrator not in SPLITTINGS:
            result = np.zeros_like(operator)
            for coefficient in stability_polynomial(integrator)[::-1]:
                result = result @ operator + coefficient * identity
            return result
        n = len(self.damping)
        kick, drift, half = identity.copy(), identity.copy(), identity.copy()
        kick[:n, :n] = np.diag(np.exp(-time_step * self.damping))
        kick[:n, n:] = lifted.kick_time(self.damping, time_step)[:, None] * self.coupling
        drift[n:, :n] = -time_step * self.coupling.T
        half[n:, :n] = drift[n:, :n] / 2
        return half @ kick @ half if integrator == "leapfrog" else kick @ drift

    def fastest_growing(self, integrator: str, time_step: float) -> np.ndarray:
        """Eigenvector of the step's largest eigenvalue as scaled fields, complex, shape (2N,).

        After n steps the energies of its real and its imaginary part add up to |μ|^(2n) times those
        at the start: both phases together show no oscillation.
        """
        values, vectors = np.linalg.eig(self.step(integrator, time_step))
        u, p = np.split(vectors[:, np.argmax(np.abs(values))], 2)
        return np.concatenate([self.velocity_shapes @ u, self.strain_shapes @ p])


@dataclass(frozen=True)
class FullSpectrum:
    """Spectrum of a scene's full model at rest, which full SPH and the lifted model share."""

    scene: Scene

    @cached_property
    def damping(self) -> np.ndarray:
        """d at the particles, zero without damping [1/s], shape (N,)."""
        values = self.scene.damping_values()
        return values if values.size else np.zeros(self.scene.particle_count)

    @property
    def uniform(self) -> bool:
        """Whether the damping is the same everywhere, so that each wave stands alone."""
        return bool(self.damping.min() == self.damping.max())

    @cached_property
    def waves(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Shapes of velocity (N, N), frequencies [1/s] (N,), shapes of strain (N, N)."""
        velocity, frequency, strain = scipy.linalg.svd(coupling(self.scene))
        return velocity, frequency, strain.T

    @cached_property
    def rates(self) -> np.ndarray:
        """Eigenvalues [1/s], shape (2, N): of one wave in each column under uniform damping."""
        if self.uniform:
            return wave_rates(self.waves[1], self.damping[0])
        return np.linalg.eigvals(self.whole.operator).reshape(2, -1)

    @property
    def whole(self) -> Block:
        """The model as one block."""
        identity = np.eye(self.scene.particle_count)
        return Block(coupling(self.scene), self.damping, identity, identity)

    def limits(self, integrator: str) -> np.ndarray:
        """Largest stable step for each eigenvalue [s], shape (2, N); not of a splitting."""
        if integrator == "exact":
            return np.full(self.rates.shape, np.inf)
        if integrator == "explicit_euler":
            return euler_limits(self.rates)
        return runge_kutta_limits(self.rates, integrator)

    def limit(self, integrator: str) -> float:
        """Largest stable step [s]: infinite if there is none, 0 if no step is stable.

        The exact solution's energy never grows, whatever the step. Splittings under a damping that
        varies have no closed form; their spectral radius is bisected, to where rounding blurs it.
        """
        if integrator not in SPLITTINGS:
            return float(self.limits(integrator).min())
        fastest = self.waves[1][0]
        if self.uniform:
            return splitting_limit(fastest, self.damping[0])
        whole = self.whole

        def grows(time_step):
            return np.abs(np.linalg.eigvals(whole.step(integrator, time_step))).max() > 1 + 1e-9

        return crossing(grows, 2 / fastest, 1e-6)

    def growth_rate(self, time_step: float) -> float:
        """Largest growth rate of explicit Euler [1/s]."""
        return float(euler_growth_rates(self.rates, time_step).max())

    def critical(self, integrator: str) -> Block:
        """The wave that limits the step, or grows fastest if all do; else the whole model."""
        if not self.uniform:
            return self.whole
        velocity, frequency, strain = self.waves
        # The fastest wave is the first one.
        wave = 0
        if integrator not in SPLITTINGS:
            wave = int(np.lexsort((-frequency, self.limits(integrator).min(axis=0)))[0])
        one = slice(wave, wave + 1)
        return Block(np.diag(frequency[one]), self.damping[one], velocity[:, one], strain[:, one])
