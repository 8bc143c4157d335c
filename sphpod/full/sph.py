"""Full-order model: Lagrangian SPH with explicit Euler steps, compiled.

Both rates are taken from the old state (section 2.2):

    dρ_i/dt = -(ρ_i²/ρ0_i) Σ_j V_j v_j ∇W_ij
    dv_i/dt = -(1/ρ0_i) Σ_j V_j c_j (1 - ρ0_j/ρ_j) ∇W_ij - d_i v_i + f_i

A damping or force that a scene lacks is an empty array, and costs nothing; of a modulus or damping
that does not change with time there are no factors.

About a free end the strain is odd, but what a step in ρ adds to it is not: of J = ρ0/ρ at the rate
s it makes J + Δt s + Δt² s²/(J - Δt s). So beyond free ends the stress is set after every step to
what the bar's own says, and at them to zero.

Long, as kernels for all arrangements of particles stand beside each other.
"""

import numpy as np

from sphpod.numerics.compiled import compiled
from sphpod.scene.ends import STRAIN
from sphpod.scene.kernel import stencil_weights
from sphpod.scene.run import FullRun
from sphpod.scene.scene import ABSENT, Scene

SOUND = 0.5
"""Size of strains that is far enough from folding for a bound of what follows."""

State = tuple[np.ndarray, np.ndarray]
"""Two fields (N,): velocity [m/s], and density [kg/m³] or, in the lifted model, strain."""


def solve(
    scene: Scene, steps: np.ndarray, neighbours: str | None = None, start: State | None = None
) -> dict[str, np.ndarray]:
    """Run full SPH and keep the fields after the given numbers of steps.

    Parameters
    ----------
    steps : int array, shape (times,)
        Ascending numbers of time steps after which the state is kept.
    neighbours : {"stencil", "lists"}, optional
        Evenly spaced fixed particles share one stencil; lists hold the neighbours of each particle,
        as an SPH code for any arrangement does, and as jittered particles need. Both give the same
        solution to rounding; the stencil is taken where it can be.
    start : (velocity, density), optional
        State after ``steps[0]`` steps, to go on from; the scene's initial one at step 0 if not
        given.

    Returns
    -------
    dict
        t (times,) [s], x (N,) [m], velocity (times, N) [m/s], density (times, N) [kg/m³].

    Raises
    ------
    Breakdown
        The solution became non-finite or its density stopped being positive.
    """
    return prepare(scene, steps, neighbours, start).solve().stored()


def prepare(
    scene: Scene, steps: np.ndarray, neighbours: str | None = None, start: State | None = None
) -> FullRun:
    """Everything that precedes the time loop.

    Parameters are those of `solve`. States are looked at as often as `fastest_change` asks for, if
    need be after every step.

    Raises
    ------
    ValueError
        A stencil is asked for, but the particles are not evenly spaced.
    """
    if neighbours is None:
        neighbours = "stencil" if scene.is_even else "lists"
    elif neighbours == "stencil" and not scene.is_even:
        raise ValueError(f"scene {scene.name}: neighbours = stencil: jittered particles need lists")
    # Of one type whatever was given: the kernel is compiled for that alone.
    steps = np.ascontiguousarray(steps, np.int64)
    first_step = 0 if start is None else int(steps[0])
    velocity_now, density_now = start or (scene.velocity0(), scene.starting_density())
    amplitudes, profiles = scene.force_of_steps(steps[-1])
    density0, dt = scene.density0(), scene.time_step
    modulus, stiffening = changing(scene, "youngs_modulus", steps[-1] + 1, first_step)
    damping, slowing = changing(scene, "damping", steps[-1], first_step)
    material = dt / density0, modulus, modulus * density0
    forces = dt * damping, dt * amplitudes, profiles
    changes = stiffening, density0, (slowing[0], dt * slowing[1])
    weights, lists = (
        scene.neighbours() if neighbours == "stencil" else (ABSENT, scene.neighbour_lists())
    )
    # Two and four neighbours have kernels of their own, which serve fewer with weights of zero.
    ghosts = next((width for width in (0, 2, 4) if weights.size <= width), weights.size)
    weights = np.pad(weights, (0, ghosts - weights.size))
    geometry = weights, lists, _images(scene)
    pace = fastest_change(scene, dt, largest_force(amplitudes, profiles), factor=2)
    velocity0 = np.pad(velocity_now, ghosts, mode="wrap")
    stress0 = np.pad(modulus * (1 - density0 / density_now), ghosts, mode="wrap")

    def run(velocity, density, watch):
        state = np.zeros((4, velocity0.size))
        state[0], state[2] = velocity0, stress0
        rho = density_now.copy()
        schedule = first_step, steps, watch, pace
        kept = velocity, density
        # A modulus that changes is written over from step to step.
        own = tuple(part.copy() for part in material) if stiffening[0].size else material
        return march((state, rho), own, forces, changes, geometry, schedule, kept)

    return FullRun.of(scene, "full SPH", scene.times(steps), "density", run)


Changes = tuple[np.ndarray, np.ndarray]
"""Factors of a coefficient that changes with time, (steps, r), and their profiles (r, N)."""

UNCHANGING: Changes = np.zeros((0, 0)), np.zeros((0, 0))
"""Those of a coefficient that does not."""


def changing(scene: Scene, key: str, count: int, first: int = 0, parts: int = 1):
    """Modulus or damping of the particles at a step, and how it changes from step to step.

    Parameters
    ----------
    key : {"youngs_modulus", "damping"}
    count : int
        Number of steps, or of so many parts of one.
    first : int
        Step of which the values are.

    Returns
    -------
    values : array, shape (N,), empty without damping
        In an array of their own.
    changes : Changes
    """
    changing = scene.changing(key)
    if changing is None:
        values = scene.modulus() if key == "youngs_modulus" else scene.damping_values()
        return values, UNCHANGING
    factors = np.ascontiguousarray(changing.factors_at(scene.times(np.arange(count), parts)).T)
    return factors[min(first, len(factors) - 1)] @ changing.profiles, (factors, changing.profiles)


def largest_force(amplitudes: np.ndarray, profiles: np.ndarray) -> float:
    """Upper bound of the size of a force at any of the times of its amplitudes (terms, times)."""
    if not amplitudes.size:
        return 0.0
    with np.errstate(over="ignore", invalid="ignore"):
        return float((np.abs(amplitudes).T @ np.abs(profiles).max(axis=1)).max())


def _images(scene):
    """Particles beyond free ends, those that they are images of, and the signs of strains there.

    None where a study takes a number of particles that leaves none on an end.
    """
    ends = scene.ends
    if ends is None or not ends.is_free or scene.particle_count % ends.copies:
        return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0)
    sources, signs = ends.images(scene.particle_count, STRAIN)
    others = np.flatnonzero((sources != np.arange(sources.size)) | (signs == 0))
    return others, sources[others], signs[others]


def fastest_change(
    scene: Scene, time_step: float, force: float, factor: float = 1
) -> tuple[float, float, float]:
    """How fast strains and velocities can grow from step to step.

    With W, the largest row sum of |G|, a step changes strains by at most a factor times Δt W max|v|
    and velocities by Δt (W max c/min ρ0 max|e| + |f|); damping of d Δt ≤ 2 lowers them. So with
    ω² = factor W² max c/min ρ0 the larger of max|e| and (factor W/ω) max|v|, if it is q now, is at
    most exp(n z) (q + n Δt (factor W/ω) |f|) after n steps, z = ω Δt, or z + z² where a step takes
    rates from within itself. Of strains the factor is one. Of densities it is J/(J - Δt s) with the
    rate s of J: two at most while J ≥ 1/2 and Δt |s| ≤ 1/4, which hold as long as q < 1/2, z ≤ 1.

    Parameters
    ----------
    time_step : float
        Δt [s].
    force : float
        Largest size of the force [m/s²].

    Returns
    -------
    growth, scale, push : floats
        z + z², infinite if nothing is known; factor W/ω [s/m]; Δt (factor W/ω) |f|.
    """
    if scene.is_even:
        widest = 2 * np.abs(stencil_weights(scene.spacing, scene.smoothing_ratio)).sum()
    else:
        first, _, gradients = scene.neighbour_lists()
        widest = np.add.reduceat(np.abs(gradients), first[:-1].astype(np.int64)).max()
    speed = np.sqrt(factor * scene.largest_modulus().max()) / np.sqrt(scene.density0().min())
    z = widest * speed * time_step
    push = time_step * factor / speed * force
    known = z <= 1 and time_step * scene.damping_range()[1] <= 2 and push < np.inf
    return float(z + z**2) if known else np.inf, float(factor / speed), float(push)


@compiled
def keep(v, rho, velocity, density):
    """Copy the state, without ghosts, into a row of what is kept."""
    for i in range(rho.size):
        velocity[i] = v[i]
        density[i] = rho[i]


@compiled
def sound_steps(size, pace):
    """Steps in which velocities and strains of this size leave every strain below one.

    See `fastest_change`, of which ``pace`` is. At least one, which says nothing of that step.
    """
    growth, _, push = pace
    if not size < SOUND:
        return 1
    size = max(size, SOUND / 100)
    steps = np.log(SOUND / size) / (growth + push / size)
    return max(1, int(min(steps, 1e9)))


@compiled
def look(v, rho, stress, modulus, pace):
    """First particle without finite state and positive J, or -1; and steps not to look again in.

    Fields are without ghosts. Zero times a velocity that is not finite is not finite either.
    """
    strained, fast, doubts = 0.0, 0.0, 0
    for i in range(rho.size):
        strain, speed = abs(stress[i] / modulus[i]), abs(v[i])
        strained, fast = max(strained, strain), max(fast, speed)
        doubts += not strain + 0.0 * speed < SOUND
    if doubts:
        for i in range(rho.size):
            if not (rho[i] > 0 and rho[i] < np.inf and abs(v[i]) < np.inf):
                return i, 1
        return -1, 1
    return -1, sound_steps(max(strained, pace[1] * fast), pace)


@compiled
def wrap(field, width):
    """Fill the ``width`` ghosts on either side of a periodic field."""
    count = field.size - 2 * width
    for k in range(width):
        field[k] = field[count + k]
        field[count + width + k] = field[width + k]


@compiled
def act(new_v, v, forces, step):
    """Add the damping and the force of one step; each is skipped where the scene lacks it.

    Fields are without ghosts.
    """
    damping, amplitudes, profiles = forces
    if damping.size:
        for i in range(damping.size):
            new_v[i] -= damping[i] * v[i]
    for r in range(amplitudes.shape[0]):
        push = amplitudes[r, step]
        for i in range(profiles.shape[1]):
            new_v[i] += push * profiles[r, i]


@compiled
def change(values, changes, step):
    """A coefficient at a step, if it changes with time."""
    factors, profiles = changes
    for i in range(values.size):
        values[i] = 0.0
    for r in range(factors.shape[1]):
        factor = factors[step, r]
        for i in range(values.size):
            values[i] += factor * profiles[r, i]


@compiled
def restress(stress, rho, modulus, load, density0, changes, step):
    """Modulus of a step, where it changes with time, and the stress of the strain that is there.

    Fields are without ghosts.
    """
    change(modulus, changes, step)
    for i in range(rho.size):
        load[i] = modulus[i] * density0[i]
        stress[i] = modulus[i] - load[i] / rho[i]


@compiled
def reflect(stress, rho, material, images):
    """Stress and density of mirror images, and of free ends, from the bar's stress, no ghosts."""
    _, modulus, load = material
    others, sources, signs = images
    for n in range(others.size):
        i = others[n]
        stress[i] = signs[n] * stress[sources[n]]
        rho[i] = load[i] / (modulus[i] - stress[i])


@compiled
def advance_two(v, new_v, stress, new_stress, rho, material, weights):
    """One step for two neighbours on each side: all reads of the old state, one division."""
    inertia, modulus, load = material
    w1, w2 = weights[0], weights[1]
    for i in range(rho.size):
        stretching = w1 * (v[i + 3] - v[i + 1]) + w2 * (v[i + 4] - v[i])
        new_rho = rho[i] - inertia[i] * rho[i] * rho[i] * stretching
        rho[i] = new_rho
        new_stress[i + 2] = modulus[i] - load[i] / new_rho
        pull = w1 * (stress[i + 3] - stress[i + 1]) + w2 * (stress[i + 4] - stress[i])
        new_v[i + 2] = v[i + 2] - inertia[i] * pull


@compiled
def advance_four(v, new_v, stress, new_stress, rho, material, weights):
    """One step for four neighbours on each side."""
    inertia, modulus, load = material
    w1, w2, w3, w4 = weights[0], weights[1], weights[2], weights[3]
    for i in range(rho.size):
        near = w1 * (v[i + 5] - v[i + 3]) + w2 * (v[i + 6] - v[i + 2])
        stretching = near + w3 * (v[i + 7] - v[i + 1]) + w4 * (v[i + 8] - v[i])
        new_rho = rho[i] - inertia[i] * rho[i] * rho[i] * stretching
        rho[i] = new_rho
        new_stress[i + 4] = modulus[i] - load[i] / new_rho
        near = w1 * (stress[i + 5] - stress[i + 3]) + w2 * (stress[i + 6] - stress[i + 2])
        pull = near + w3 * (stress[i + 7] - stress[i + 1]) + w4 * (stress[i + 8] - stress[i])
        new_v[i + 4] = v[i + 4] - inertia[i] * pull


@compiled
def advance_any(v, new_v, stress, new_stress, rho, material, weights):
    """One step for any number of neighbours; the neighbour loop is outside the particle loop."""
    inertia, modulus, load = material
    width = weights.size
    for i in range(rho.size):
        new_v[i + width] = 0.0
        new_stress[i + width] = 0.0
    for k in range(width):
        for i in range(rho.size):
            right, left = i + width + k + 1, i + width - k - 1
            new_v[i + width] += weights[k] * (stress[right] - stress[left])
            new_stress[i + width] += weights[k] * (v[right] - v[left])
    for i in range(rho.size):
        new_rho = rho[i] - inertia[i] * rho[i] * rho[i] * new_stress[i + width]
        rho[i] = new_rho
        new_stress[i + width] = modulus[i] - load[i] / new_rho
        new_v[i + width] = v[i + width] - inertia[i] * new_v[i + width]


@compiled
def advance_lists(v, new_v, stress, new_stress, rho, material, lists):
    """One step for particles that each have their own list of neighbours.

    Indices are unsigned: with signed ones numba also handles negative indices, three times slower.
    """
    inertia, modulus, load = material
    first, neighbours, gradients = lists
    for i in range(rho.size):
        stretching, pull = 0.0, 0.0
        for n in range(first[i], first[i + 1]):
            j = neighbours[n]
            stretching += gradients[n] * v[j]
            pull += gradients[n] * stress[j]
        new_rho = rho[i] - inertia[i] * rho[i] * rho[i] * stretching
        rho[i] = new_rho
        new_stress[i] = modulus[i] - load[i] / new_rho
        new_v[i] = v[i] - inertia[i] * pull


@compiled
def march(state, material, forces, changes, geometry, schedule, kept):
    """``state`` holds velocity and stress, old and new, with ghosts, and the density; ``changes``
    those of the modulus, ρ0, and those of the damping; ``geometry`` the weights of neighbours of
    evenly spaced particles, else their lists, and particles that are set as `reflect` does;
    ``schedule`` the first step, those after which the state is kept, whether it is looked at, and
    `fastest_change`.
    """
    fields, rho = state
    v, new_v, stress, new_stress = fields[0], fields[1], fields[2], fields[3]
    modulus, load, damping = material[1], material[2], forces[0]
    stiffening, density0, slowing = changes
    weights, lists, images = geometry
    first_step, steps, watch, pace = schedule
    velocity, density = kept
    width = weights.size
    inner = slice(width, width + rho.size)
    acted = forces[0].size > 0 or forces[1].size > 0
    next_look = np.iinfo(np.int64).max
    if watch:
        failed, sound = look(v[inner], rho, stress[inner], modulus, pace)
        if failed >= 0:
            keep(v[inner], rho, velocity[0], density[0])
            return failed
        next_look = first_step + sound
    done = first_step
    for row in range(steps.size):
        for step in range(done, steps[row]):
            if width == 2:
                advance_two(v, new_v, stress, new_stress, rho, material, weights)
            elif width == 4:
                advance_four(v, new_v, stress, new_stress, rho, material, weights)
            elif width:
                advance_any(v, new_v, stress, new_stress, rho, material, weights)
            else:
                advance_lists(v, new_v, stress, new_stress, rho, material, lists)
            if slowing[0].size:
                change(damping, slowing, step)
            if acted:
                act(new_v[inner], v[inner], forces, step)
            if stiffening[0].size:
                restress(new_stress[inner], rho, modulus, load, density0, stiffening, step + 1)
            if images[0].size:
                reflect(new_stress[inner], rho, material, images)
            wrap(new_v, width)
            wrap(new_stress, width)
            v, new_v = new_v, v
            stress, new_stress = new_stress, stress
            if step + 1 >= next_look:
                failed, sound = look(v[inner], rho, stress[inner], modulus, pace)
                if failed >= 0:
                    keep(v[inner], rho, velocity[row], density[row])
                    return row * rho.size + failed
                next_look = step + 1 + sound
        done = steps[row]
        keep(v[inner], rho, velocity[row], density[row])
    return -1
