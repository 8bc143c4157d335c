"""Staggered finite-difference reference on twice as many nodes as particles, compiled.

With nodes x_j = j Δx_r, Δx_r = Δx/2, and the stress s = c (ρ0/ρ - 1):

    dρ_j/dt = -(ρ_j²/ρ0_j) (v_j - v_{j-1})/Δx_r
    dv_j/dt = (s_{j+1} - s_j)/(ρ0_j Δx_r) - d_j v_j + f_j

in time the midpoint rule with Δt/2 (section 3: "first-order finite difference method in space",
"second-order Runge-Kutta scheme in time").

Nodes are evenly spaced always. To particles that are not, velocity and strain are brought by cubic
splines, of which the error falls as Δx⁴ where the solution is smooth.
"""

from dataclasses import replace

import numpy as np

from sphpod.compiled import compiled
from sphpod.error import FIELDS, relative_error
from sphpod.scene import Scene
from sphpod.stability import Breakdown


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
    if not scene.is_even:
        even = replace(scene, jitter=0.0)
        return _to_particles(scene, even, _solve(even, refinement, shift))
    spacing, dt = scene.spacing / refinement, scene.time_step / refinement
    nodes = np.arange(refinement * scene.particle_count) * spacing
    between = (nodes - shift * spacing) % scene.domain_length
    steps = refinement * scene.error_steps
    # The midpoint rule samples the force at the start and in the middle of a step.
    amplitude, profile = scene.force_of_steps(2 * steps[-1], 2 * refinement, nodes)
    density0 = scene.initial_density(x=between)
    velocity = np.empty((steps.size, scene.particle_count))
    density = np.empty_like(velocity)
    inertia = scene.initial_density(x=nodes)
    material = (
        scene.youngs_modulus(x=between),
        density0,
        1 / (density0 * spacing),
        1 / (inertia * spacing),
    )
    forces = scene.damping_values(nodes), amplitude, profile
    state = np.zeros((7, nodes.size + 1))
    state[0, 1:] = scene.initial_velocity(x=nodes)
    state[0, 0] = state[0, -1]
    state[1, :-1] = density0
    left_weight = 1.0 if shift == 0 else 0.5
    failed = march(
        state, material, forces, scene.density0(), left_weight, dt, steps, velocity, density
    )
    if failed >= 0:
        row, particle = divmod(failed, scene.particle_count)
        raise Breakdown(
            scene.name, "the finite-difference reference", scene.error_times[row], particle
        )
    return {"t": scene.error_times, "x": scene.positions, "velocity": velocity, "density": density}


def _to_particles(scene, even, solution):
    """A solution at the particles of a scene, from one at evenly spaced ones."""
    from scipy.interpolate import CubicSpline

    places = np.append(even.positions, even.domain_length)
    strain = even.density0() / solution["density"] - 1
    velocity, strain = (
        CubicSpline(places, np.column_stack([f, f[:, 0]]), axis=1, bc_type="periodic")(
            scene.positions
        )
        for f in (solution["velocity"], strain)
    )
    density = scene.density0() / (1 + strain)
    return {"t": solution["t"], "x": scene.positions, "velocity": velocity, "density": density}


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
def march(state, material, forces, particle_density0, left_weight, dt, steps, velocity, density):
    """Midpoint rule; keeps velocity and averaged density at the particles.

    ``state`` holds velocity and density, old, in the middle of a step and new, and the stress.
    """
    old, middle, new = (state[0], state[1]), (state[2], state[3]), (state[4], state[5])
    stress, density0 = state[6], material[1]
    count = velocity.shape[1]
    refinement = density0.size // count
    done = 0
    for row in range(steps.size):
        for step in range(done, steps[row]):
            stage(old, old, middle, stress, material, forces, 2 * step, dt / 2)
            stage(middle, old, new, stress, material, forces, 2 * step + 1, dt)
            old, new = new, old
        done = steps[row]
        v, rho = old
        for i in range(count):
            j = refinement * i
            left, right = density0[j] / rho[j], density0[j + 1] / rho[j + 1]
            jacobian = left_weight * left + (1.0 - left_weight) * right
            velocity[row, i] = v[j + 1]
            density[row, i] = particle_density0[i] / jacobian
            if not (left > 0 and right > 0 and abs(v[j + 1]) < np.inf and jacobian < np.inf):
                return row * count + i
    return -1
