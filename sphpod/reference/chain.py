"""The chain of masses, springs and dampers itself, of which SPH is a discretisation (section 2.1).

With displacements y_n of masses m_n = ρ0(x_n) L/N at x_n = n L/N and springs of stiffness
k_{n+1/2} = c(x_{n+1/2}) N/L, (2.1) and appendix A,

    m_n y_n'' = k_{n+1/2} (y_{n+1} - y_n) - k_{n-1/2} (y_n - y_{n-1}) - m_n d_n y_n' + m_n f_n,

stepped by velocity Verlet, damping by its exponential in the halves of a step and the force by its
mean over the step. Both are of second order, and so is the chain as N grows. The position of a mass
is z_n = x_n + y_n, and its density that of ρ ∂z/∂x = ρ0 between its neighbours.
"""

import numpy as np

from sphpod.numerics.compiled import compiled
from sphpod.numerics.course import WEIGHTS
from sphpod.scene.breakdown import Breakdown
from sphpod.scene.scene import ABSENT, Scene


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
    springs = scene.youngs_modulus(x=x + spacing / 2) / spacing
    masses = density0 * spacing
    damping = scene.damping_values()
    decay = np.exp(-damping * dt / 2) if damping.size else ABSENT
    impulses, profile = _impulses(scene, int(steps[-1]))
    kept = np.empty((2, steps.size, x.size))
    state = np.stack([scene.initial_velocity(x=x), np.zeros(x.size)])
    chain = springs / masses, np.roll(springs, 1) / masses, decay, impulses, profile
    failed = march(state, chain, (dt, spacing, steps), kept)
    if failed >= 0:
        row, mass = divmod(failed, x.size)
        raise Breakdown(scene.name, "the chain", scene.error_times[row], scene.bar_particle(mass))
    velocity, stretch = kept
    density = density0 / (1 + stretch)
    return {"t": scene.error_times, "x": x, "velocity": velocity, "density": density}


def _impulses(scene, count):
    """Impulse of the force in each step, of its time factor (steps,) [m/s]; its profile (N,)."""
    courses = scene.courses()
    if not courses:
        return ABSENT, ABSENT
    ends = scene.times(np.arange(count + 1))
    means = sum(course.projected(ends[:-1], ends[1:]) @ WEIGHTS / 2 for course in courses)
    _, profile = scene.force_values(np.zeros(1))
    return means * np.diff(ends), profile


@compiled
def march(state, chain, schedule, kept):
    """Velocity Verlet; velocities and strains at masses in ``kept``, or where a spring gave way."""
    velocity, displacement = state[0], state[1]
    right, left, decay, impulses, profile = chain
    dt, spacing, steps = schedule
    count = velocity.size
    done = 0
    for row in range(steps.size):
        for step in range(done, steps[row]):
            for half in range(2):
                if half == 0 and decay.size:
                    for n in range(count):
                        velocity[n] *= decay[n]
                for n in range(count):
                    after = displacement[n + 1 if n + 1 < count else 0] - displacement[n]
                    before = displacement[n] - displacement[n - 1]
                    velocity[n] += dt / 2 * (right[n] * after - left[n] * before)
                if impulses.size:
                    for n in range(count):
                        velocity[n] += impulses[step] / 2 * profile[n]
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
