"""Staggered finite-difference reference on twice as many nodes as particles, compiled.

With nodes x_j = j Δx_r, Δx_r = Δx/2, and the stress s = c (ρ0/ρ - 1):

    dρ_j/dt = -(ρ_j²/ρ0_j) (v_j - v_{j-1})/Δx_r
    dv_j/dt = (s_{j+1} - s_j)/(ρ0_j Δx_r) - d_j v_j + f_j

in time the midpoint rule with Δt/2 (section 3: "first-order finite difference method in space",
"second-order Runge-Kutta scheme in time").

Nodes are evenly spaced always. To particles that are not, velocity and strain are brought by cubic
splines, of which the error falls as Δx⁴ where the solution is smooth.
"""

import numpy as np

from sphpod.compiled import compiled
from sphpod.error import FIELDS, relative_error
from sphpod.scene import ABSENT, Scene
from sphpod.stability import Breakdown

CELL_PARTS = 8
"""Parts of a cell whose midpoints give its mean; a jump between two of them is located."""

JUMP = 1e-3
"""Change from one midpoint to the next, of the largest value, from which it is taken for a jump."""


def solve_paper(scene: Scene) -> dict[str, np.ndarray]:
    """Reference as the paper has it: density compared where the velocity is.

    Backward differences make ρ_j live at x_j - Δx_r/2; the paper takes it, and the material it
    sees, to be at x_j.

    Returns
    -------
    dict
        t (times,) [s], x (N,) [m], velocity (times, N) [m/s], density (times, N) [kg/m³] at the
        times of the error integral.

    Raises
    ------
    Breakdown
        The solution became non-finite or its density stopped being positive.
    """
    return _solve(scene, 2, 0.0)


def solve_centred(scene: Scene, estimate_error: bool = True) -> dict[str, np.ndarray]:
    """Second-order reference: the strain between the nodes sees the material there.

    The Jacobians on either side of a particle are averaged to give its density. There are four
    nodes per particle and steps of Δt/4. A third of the difference from the solution with two nodes
    and Δt/2 estimates the error (Richardson); a scene with an exact solution does not need that.

    Parameters
    ----------
    scene : Scene
    estimate_error : bool
        Whether to solve with two nodes per particle too, and to estimate the error.

    Returns
    -------
    dict
        As ``solve_paper``, and velocity_error_estimate, density_error_estimate (scalars, relative
        L2 norms) if asked for.

    Raises
    ------
    Breakdown
        The solution became non-finite or its density stopped being positive.
    """
    fine = _solve(scene, 4, 0.5)
    if estimate_error:
        coarse = _solve(scene, 2, 0.5)
        for field in FIELDS:
            estimate = relative_error(coarse[field], fine[field]) / 3
            fine[f"{field}_error_estimate"] = np.array(estimate)
    return fine


def _solve(scene, refinement, shift):
    """``refinement`` nodes per particle; strain and its material at x_j - ``shift`` Δx_r."""
    spacing, dt = scene.spacing / refinement, scene.time_step / refinement
    nodes = np.arange(refinement * scene.particle_count) * spacing
    between = (nodes - shift * spacing) % scene.domain_length
    steps = refinement * scene.error_steps
    # The midpoint rule samples the force at the start and in the middle of a step.
    amplitude, profile = scene.force_values(np.arange(2 * steps[-1]) * (dt / 2), nodes)
    damping, inertia = scene.damping_values(nodes), scene.initial_density(x=nodes)
    modulus, density0 = scene.youngs_modulus(x=between), scene.initial_density(x=between)
    compliance = ABSENT
    if shift:
        inertia, modulus, damping, profile = _cell_means(scene, nodes.size)
        compliance = _compliance(scene)
    velocity = np.empty((steps.size, scene.particle_count))
    density = np.empty_like(velocity)
    material = modulus, density0, 1 / (density0 * spacing), 1 / (inertia * spacing)
    forces = damping, amplitude, profile
    state = np.zeros((7, nodes.size + 1))
    state[0, 1:] = scene.initial_velocity(x=nodes)
    state[0, 0] = state[0, -1]
    state[1, :-1] = density0
    places = scene.positions / spacing
    readers = *_reader(places, nodes.size), *_reader(places + shift, nodes.size)
    failed = march(
        state, material, forces, readers, scene.density0(), compliance, dt, steps, velocity, density
    )
    if failed >= 0:
        row, particle = divmod(failed, scene.particle_count)
        raise Breakdown(
            scene.name, "the finite-difference reference", scene.error_times[row], particle
        )
    return {"t": scene.error_times, "x": scene.positions, "velocity": velocity, "density": density}


def _cell_means(scene, count):
    """Density, modulus, damping and force of cells: what each has in all, wherever it jumps.

    Sampled at a point, a jump would move by up to half a cell, on every grid otherwise, and no
    error would fall regularly with the spacing. Masses and compliances add up, and so do the
    momenta that damping and force take and give: of cells about the nodes, but the modulus of
    those to the left of them.
    """

    def per_mass(values, x):
        return scene.initial_density(x=x) * values

    inertia = _means(lambda x: scene.initial_density(x=x), scene, count)
    modulus = 1 / _means(lambda x: 1 / scene.youngs_modulus(x=x), scene, count, to_the_left=True)
    damping, profile = ABSENT, ABSENT
    if scene.damping_values(_subcells(scene, count)).size:
        damping = _means(lambda x: per_mass(scene.damping(x=x), x), scene, count) / inertia
    if scene.force_time is not None:
        none = np.zeros(1)
        profile = _means(lambda x: per_mass(scene.force_values(none, x)[1], x), scene, count)
        profile /= inertia
    return inertia, modulus, damping, profile


def _subcells(scene, count):
    """Midpoints of the parts of ``count`` cells [m]."""
    parts = count * CELL_PARTS
    return (np.arange(parts) + 0.5) * (scene.domain_length / parts)


def _means(function, scene, count, to_the_left=False):
    """Means of a function over cells about the nodes, or over those to the left of them.

    The midpoint rule on parts of the cells; what changes much from one midpoint to the next is
    taken to jump, at a place that is found by bisection.
    """
    x = _subcells(scene, count)
    width = scene.domain_length / x.size
    values = function(x)
    after = np.roll(values, -1)
    # Part of the way to the next midpoint that has the value of this one.
    part = np.full(x.size, 0.5)
    steep = np.flatnonzero(np.abs(after - values) > JUMP * np.abs(values).max())
    if steep.size:
        low, high = np.zeros(steep.size), np.ones(steep.size)
        for _ in range(30):
            middle = (low + high) / 2
            there = function((x[steep] + width * middle) % scene.domain_length)
            here = np.abs(there - values[steep]) < np.abs(there - after[steep])
            low, high = np.where(here, middle, low), np.where(here, high, middle)
        part[steep] = low
    first = values * np.minimum(part, 0.5) + after * np.maximum(0.5 - part, 0)
    second = values * np.maximum(part - 0.5, 0) + after * np.minimum(1 - part, 0.5)
    of_parts = first + np.roll(second, 1)
    shift = CELL_PARTS if to_the_left else CELL_PARTS // 2
    return np.roll(of_parts, shift).reshape(count, CELL_PARTS).mean(axis=1)


def _compliance(scene):
    """1/c at the particles [1/Pa]; the mean of both sides where the modulus jumps at one."""
    aside = 1e-9 * scene.spacing
    left, right = (
        1 / scene.youngs_modulus(x=(scene.positions + way) % scene.domain_length)
        for way in (-aside, aside)
    )
    return (left + right) / 2


def _reader(places, count):
    """Indices and weights (N, 4) of the cubic through the four nodes about each place.

    A place that is a node has that node's weight alone.
    """
    first = np.floor(places + 1e-9).astype(np.int64)
    t = places - first
    t = np.where(np.abs(t) < 1e-8, 0.0, t)
    weights = np.stack(
        [
            -t * (t - 1) * (t - 2) / 6,
            (t + 1) * (t - 1) * (t - 2) / 2,
            -(t + 1) * t * (t - 2) / 2,
            (t + 1) * t * (t - 1) / 6,
        ],
        axis=1,
    )
    return (first[:, None] + np.arange(-1, 3)) % count, weights


@compiled
def stage(old, base, new, stress, material, forces, sample, dt):
    """new = base + dt rate(old), each the velocity with a ghost on its left, and the density.

    The new arrays must be none of the others: loops that may write what they read stay scalar.
    """
    (v, rho), (base_v, base_rho), (new_v, new_rho) = old, base, new
    modulus, density0, stretch, inertia = material
    damping, amplitude, profile = forces
    count = density0.size
    for j in range(count):
        stress[j] = modulus[j] * (density0[j] / rho[j] - 1.0)
    stress[count] = stress[0]
    for j in range(count):
        stretching = stretch[j] * (v[j + 1] - v[j])
        new_rho[j] = base_rho[j] - dt * rho[j] * rho[j] * stretching
        new_v[j + 1] = base_v[j + 1] + dt * inertia[j] * (stress[j + 1] - stress[j])
    if damping.size:
        for j in range(count):
            new_v[j + 1] -= dt * damping[j] * v[j + 1]
    if amplitude.size:
        push = dt * amplitude[sample]
        for j in range(count):
            new_v[j + 1] += push * profile[j]
    new_v[0] = new_v[count]


@compiled
def march(
    state, material, forces, readers, particle_density0, compliance, dt, steps, velocity, density
):  # fmt: skip
    """Midpoint rule; keeps velocity and density at the particles.

    ``state`` holds velocity and density, old, in the middle of a step and new, and the stress.
    What is read of the strain is the stress, which no jump of the material interrupts, times the
    compliance at the particle; without compliances it is the density of the nodes.
    """
    old, middle, new = (state[0], state[1]), (state[2], state[3]), (state[4], state[5])
    stress, modulus, density0 = state[6], material[0], material[1]
    nodes, node_weights, cells, cell_weights = readers
    count = velocity.shape[1]
    done = 0
    for row in range(steps.size):
        for step in range(done, steps[row]):
            stage(old, old, middle, stress, material, forces, 2 * step, dt / 2)
            stage(middle, old, new, stress, material, forces, 2 * step + 1, dt)
            old, new = new, old
        done = steps[row]
        v, rho = old
        for i in range(count):
            speed, jacobian, sound = 0.0, 0.0, True
            for n in range(4):
                j = cells[i, n]
                here = density0[j] / rho[j]
                speed += node_weights[i, n] * v[nodes[i, n] + 1]
                weight = cell_weights[i, n]
                sound = sound and (weight == 0 or here > 0)
                if compliance.size:
                    jacobian += weight * compliance[i] * modulus[j] * (here - 1.0)
                else:
                    jacobian += weight * here
            if compliance.size:
                jacobian += 1.0
            velocity[row, i] = speed
            density[row, i] = particle_density0[i] / jacobian
            if not (sound and jacobian > 0 and abs(speed) < np.inf and jacobian < np.inf):
                return row * count + i
    return -1
