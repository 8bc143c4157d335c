"""The energy of the lifted model, and what each integrator keeps in its place.

In the scaled fields u = √m v and p = √(V c) e of `sphpod.full.lifted` twice the energy is |u|² +
|p|². Nothing but damping and force changes it, and exact steps keep it.

Without damping, symplectic Euler, p⁺ = p - Δt Aᵀu and then u⁺ = u + Δt A p⁺, keeps
|u|² + |p|² - Δt p·Aᵀu: in the singular vectors of A each wave α + iβ of angular frequency ω goes by
itself, with h = ω Δt to β⁺ = β - h α, α⁺ = α + h β⁺, and

    α⁺² + β⁺² - h α⁺ β⁺ = α² + β⁺² + h α β⁺ = α² + β² - h α β,

the first by α⁺ = α + h β⁺, the second by β⁺ = β - h α. Leapfrog, drift-kick-drift, keeps
|u|² + |p|² - (Δt²/4) |Aᵀu|²: with b = β - h α/2 in the middle, α⁺ = α + h b, β⁺ = b - h α⁺/2, and

    α⁺² (1 - h²/4) + β⁺² - α² (1 - h²/4) - β² = (α⁺ - α - h b) (α⁺ + α) = 0.

Both are positive, and so bound the energy, below ω Δt = 2.

With damping, and w_i = x coth x, x = d_i Δt/2 (1 without damping), they are

    H = Σ w u² + |p|² - Δt p·Aᵀu    and    H = Σ w u² + |p|² - (Δt²/4) |Aᵀu|²,

of which the first is the second at half a drift's distance. A step with the force f changes them by

    H' - H = -Σ tanh(x) w (u' + u)² + Δt f (u' + u)·√m,

so that they never grow with damping alone, however it varies and however stiff it is.
"""

import numpy as np

from sphpod.full import lifted
from sphpod.numerics.error import blocks
from sphpod.scene.scene import Scene


def kept(
    scene: Scene, integrator: str, time_step: float, velocity: np.ndarray, strain: np.ndarray
) -> np.ndarray:
    """What an integrator keeps of an unforced, undamped scene, and damping lowers [J/m²].

    Parameters
    ----------
    integrator : {"exact", "leapfrog", "symplectic_euler"}
        Of exact steps it is the energy itself.
    time_step : float
        Δt [s]; exact steps do not ask for it.
    velocity, strain : arrays, shape (times, N)
        In m/s and dimensionless.

    Returns
    -------
    array, shape (times,)
    """
    mass, stiffness = lifted.energy_weights(scene)
    damping = scene.damping_values()
    weights = np.ones_like(mass)
    if damping.size and integrator != "exact":
        half = damping * time_step / 2
        weights = np.where(half > 0, half / np.tanh(np.where(half > 0, half, 1)), 1)
    result = np.empty(len(velocity))
    for part in blocks(len(result), size=max(1, 1_000_000 // mass.size)):
        u, p = mass * velocity[part], stiffness * strain[part]
        result[part] = np.einsum("tx,tx,x->t", u, u, weights) + np.einsum("tx,tx->t", p, p)
        if integrator == "leapfrog":
            result[part] -= time_step**2 / 4 * np.sum(lifted.stretch(scene, u) ** 2, axis=1)
        elif integrator == "symplectic_euler":
            result[part] += time_step * np.sum(p * lifted.stretch(scene, u), axis=1)
    return result / 2


def total(scene: Scene, velocity: np.ndarray, strain: np.ndarray) -> np.ndarray:
    """Energy Σ m v²/2 + Σ V c e²/2 of fields (times, N) [J/m²], shape (times,)."""
    return kept(scene, "exact", np.nan, velocity, strain)
