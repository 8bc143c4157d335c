"""The chain of masses, springs and dampers itself, of which SPH is a discretisation (section 2.1).

With displacements y_n of masses m_n = ρ0(x_n) L/N at x_n = n L/N and springs of stiffness
k_{n+1/2} = c(x_{n+1/2}) N/L, (2.1) and appendix A,

    m_n y_n'' = k_{n+1/2} (y_{n+1} - y_n) - k_{n-1/2} (y_n - y_{n-1}) - m_n d_n y_n' + m_n f_n,

stepped by velocity Verlet, damping by its exponential in the halves of a step and the force by its
mean over the step. Both are of second order, and so is the chain as N grows. The position of a mass
is z_n = x_n + y_n, and its density that of ρ ∂z/∂x = ρ0 between its neighbours.
"""

import numpy as np

from sphpod.full.sph import UNCHANGING, change
from sphpod.numerics.compiled import compiled
from sphpod.numerics.course import WEIGHTS
from sphpod.scene.breakdown import Breakdown
from sphpod.scene.scene import ABSENT, NO_FORCE, Scene


def solve(scene: Scene) -> dict[str, np.ndarray]:
    """The chain of as many masses as there are particles, at the times of the error integral.

    Parameters
    ----------
    scene : Scene
        With evenly spaced particles.

    Returns
    -------
    dict
        t (times,) [s], x (N,) [m], velocity (times, N) [m/s], density (times, N) [kg/m³].

    Raises
    ------
    ValueError
        The particles are not evenly spaced.
    Breakdown
        A spring was pressed to no length, or the motion became non-finite.
    """
    if not scene.is_even:
        raise ValueError(f"scene {scene.name}: a chain has evenly spaced masses only")
    x, spacing, dt = scene.positions, scene.spacing, scene.time_step
    density0, steps = scene.density0(), scene.error_steps
    springs = scene.values_at("youngs_modulus", x + spacing / 2) / spacing
    masses = density0 * spacing
    damping = scene.damping_values()
    decay = np.exp(-damping * dt / 2) if damping.size else ABSENT
    impulses, profiles = _impulses(scene, int(steps[-1]))
    times = scene.times(np.arange(steps[-1] + 1))
    stiffening, slowing = UNCHANGING, UNCHANGING
    if (one := scene.changing("youngs_modulus")) is not None:
        one.factors_at(times)  # refused where it is not valid
        parts = scene.separated(scene.youngs_modulus, spacing / 2)
        factors = np.stack([g(t=times) for g in parts.factors], axis=1)
        stiffening = factors, parts.profiles(x + spacing / 2) / spacing
    if (one := scene.changing("damping")) is not None:
        slowing = np.ascontiguousarray(one.factors_at(times).T), one.profiles * dt / 2
    kept = np.empty((2, steps.size, x.size))
    state = np.stack([scene.velocity0(), np.zeros(x.size)])
    chain = springs / masses, np.roll(springs, 1) / masses, decay, impulses, profiles
    changes = stiffening, slowing, masses
    failed = march(state, chain, changes, (dt, spacing, steps), kept)
    if failed >= 0:
        row, mass = divmod(failed, x.size)
        raise Breakdown(scene.name, "the chain", scene.error_times[row], scene.bar_particle(mass))
    velocity, stretch = kept
    density = density0 / (1 + stretch)
    return {"t": scene.error_times, "x": x, "velocity": velocity, "density": density}


def _impulses(scene, count):
    """Impulses of the force's factors in each step (terms, steps) [m/s]; profiles (terms, N)."""
    courses = scene.courses()
    if not courses:
        return NO_FORCE, NO_FORCE
    ends = scene.times(np.arange(count + 1))
    means = np.stack([one.projected(ends[:-1], ends[1:]) @ WEIGHTS / 2 for one in courses])
    _, profiles = scene.force_values(np.zeros(1))
    return means * np.diff(ends), profiles


@compiled
def change_chain(chain, changes, step):
    """Springs by masses, and decay in half a step, where they change with time."""
    right, left, decay, _, _ = chain
    stiffening, slowing, masses = changes
    if stiffening[0].size:
        change(right, stiffening, step)
        for n in range(right.size):
            left[n] = right[n - 1] / masses[n]
        for n in range(right.size):
            right[n] /= masses[n]
    if slowing[0].size:
        change(decay, slowing, step)
        for n in range(decay.size):
            decay[n] = np.exp(-decay[n])


@compiled
def march(state, chain, changes, schedule, kept):
    """Velocity Verlet; velocities and strains at masses in ``kept``, or where a spring gave way."""
    velocity, displacement = state[0], state[1]
    right, left, decay, impulses, profiles = chain
    dt, spacing, steps = schedule
    count = velocity.size
    done = 0
    for row in range(steps.size):
        for step in range(done, steps[row]):
            for half in range(2):
                change_chain(chain, changes, step + half)
                if half == 0 and decay.size:
                    for n in range(count):
                        velocity[n] *= decay[n]
                for n in range(count):
                    after = displacement[n + 1 if n + 1 < count else 0] - displacement[n]
                    before = displacement[n] - displacement[n - 1]
                    velocity[n] += dt / 2 * (right[n] * after - left[n] * before)
                for r in range(impulses.shape[0]):
                    for n in range(count):
                        velocity[n] += impulses[r, step] / 2 * profiles[r, n]
                if half == 0:
                    for n in range(count):
                        displacement[n] += dt * velocity[n]
                elif decay.size:
                    for n in range(count):
                        velocity[n] *= decay[n]
            for n in range(count):
                gap = displacement[n + 1 if n + 1 < count else 0] - displacement[n]
                # Not so where it is no number, too.
                if not spacing + gap > 0.0:
                    return row * count + n
        done = steps[row]
        for n in range(count):
            after = displacement[n + 1 if n + 1 < count else 0] - displacement[n - 1]
            kept[0, row, n] = velocity[n]
            kept[1, row, n] = after / (2 * spacing)
    return -1
