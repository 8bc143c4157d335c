"""Staggered finite-difference reference on twice as many nodes as particles, compiled.

With nodes x_j = j Δx_r, Δx_r = Δx/2, and the stress s = c (ρ0/ρ - 1):

    dρ_j/dt = -(ρ_j²/ρ0_j) (v_j - v_{j-1})/Δx_r
    dv_j/dt = (s_{j+1} - s_j)/(ρ0_j Δx_r) - d_j v_j + f_j

in time the midpoint rule with Δt/2 (section 3: "first-order finite difference method in space",
"second-order Runge-Kutta scheme in time").

Nodes are evenly spaced always. At particles that are not, the solution is read by cubics through
the nodes about them, of which the error falls as Δx⁴ where the solution is smooth.

Modulus and damping that change with time are sums of products, of which the means of cells are
taken once; of the modulus it is the compliance 1/c that is such a sum.

Long, as both references, their means of cells and the estimate of their error share the scheme.
"""

import logging
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from sphpod.full.sph import SOUND, UNCHANGING, Changes, change, largest_force, sound_steps
from sphpod.numerics.compiled import compiled
from sphpod.numerics.course import POINTS, WEIGHTS
from sphpod.numerics.error import FIELDS
from sphpod.numerics.separation import Products, Separated
from sphpod.scene.breakdown import Breakdown
from sphpod.scene.scene import ABSENT, NO_FORCE, Scene

logger = logging.getLogger(__name__)

SAFETY = 1.65
"""Factor of safety of an estimated error, as Roache's grid convergence index has one."""

ORDERS = 0.15, 2.5
"""Orders that errors may show: from 1/3, of a jump of the velocity, to 2, and some way beyond."""

PARALLEL = 0.12
"""Least 1 - c by which errors on successive grids turn, for each order that they miss of 2."""

COSINE_TOLERANCE = 0.05
"""How far a cosine may lie beyond what it should be, as no three grids are quite regular."""

TIME_PARTS, PART_TIMES = 4, 4
"""Parts of the time in each of which errors must fall, and the least number of times in one."""

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

    There are four nodes per particle and steps of Δt/4. Density comes from the stress about a
    particle, which is continuous wherever the material jumps, and material, damping and force are
    means of cells. Solutions with two nodes and one node per particle show the order that errors
    fall with, and estimate the error (`richardson`).

    Parameters
    ----------
    estimate_error : bool
        Whether to solve on the two coarser grids too, and to estimate the error.

    Returns
    -------
    dict
        As ``solve_paper``; and if asked for velocity_error_estimate, density_error_estimate
        (relative L2 norms, `SAFETY` included), velocity_observed_order, density_observed_order, and
        asymptotic: 1, or 0 if the three grids are not in the asymptotic range, the estimates then
        being NaN, as the log reports; scalars.

    Raises
    ------
    Breakdown
        The solution became non-finite or its density stopped being positive.
    """
    fine = _solve(scene, 4, 0.5)
    if not estimate_error:
        return fine
    try:
        coarser = [_solve(scene, refinement, 0.5) for refinement in (2, 1)]
        found = [richardson(fine[field], *(c[field] for c in coarser)) for field in FIELDS]
    except Breakdown:
        found = [(np.nan, np.nan)] * len(FIELDS)
    # Grids that are too coarse for one field are so for the other.
    asymptotic = not any(np.isnan(estimate) for estimate, _ in found)
    for field, (estimate, order) in zip(FIELDS, found, strict=True):
        fine[f"{field}_error_estimate"] = np.array(estimate if asymptotic else np.nan)
        fine[f"{field}_observed_order"] = np.array(order)
    fine["asymptotic"] = np.array(asymptotic, np.int8)
    if not asymptotic:
        logger.warning(
            "scene %s: reference centred: its error is not estimated, as the errors of velocity and"
            " density with one, two and four nodes per particle do not fall regularly (observed"
            " orders %.2g and %.2g): more particles are needed",
            scene.name, *(order for _, order in found),
        )  # fmt: skip
    return fine


def richardson(fine: np.ndarray, middle: np.ndarray, coarse: np.ndarray) -> tuple[float, float]:
    """Estimate an error from solutions on three grids, each twice as fine as the next.

    If the errors are a, ra and r²a in size, successive solutions differ by d and rd, which shows
    r = 2^p and so the order p. Of parallel errors d is (r - 1)a, as Richardson has it; but ripples
    behind a front or kink have other wavelengths on every grid. With the cosine c between the
    errors on successive grids, and c² over two levels, the squares of the differences are

        d² = a² (1 + r² - 2cr),    d₁₃² = a² (1 + r⁴ - 2c²r²),

    of which the ratio gives c, and then a. Orders are taken to be 2 at most.

    A wave that runs out of phase by more than a radian on the coarser grids differs by as much on
    both, and no more than by twice itself. As phases drift with time, the order there falls below
    that of any jump; of waves together it falls so for the shortest first, and may hide in the sum
    over all times. So the order is observed in each part of the time that has its share of the
    differences.

    Parameters
    ----------
    fine, middle, coarse : arrays, shape (times, N)

    Returns
    -------
    estimate : float
        `SAFETY` times a, relative to the fine solution; NaN if the grids are not in the asymptotic
        range: errors that do not fall, in all or in a part of the time, or fall faster than the
        scheme can; that swing from side to side (c < 0); or that are parallel without falling as
        smooth errors do. 0 if nothing differs.
    order : float
        Observed order p; NaN if nothing differs.
    """
    size = np.abs(fine).max()
    first, second, over_both = (
        float(np.linalg.norm((one - other) / (size or 1.0)))
        for one, other in ((middle, fine), (coarse, middle), (coarse, fine))
    )
    if first == second == 0:
        return 0.0, np.nan
    with np.errstate(divide="ignore", invalid="ignore"):
        order = float(np.log2(np.float64(second) / first))
    if not ORDERS[0] <= order <= ORDERS[1] or _least_order(fine, middle, coarse) < ORDERS[0]:
        return np.nan, order
    r = second / first
    q = (over_both / first) ** 2
    root = (q * r) ** 2 - 2 * r**2 * (q * (1 + r**2) - 1 - r**4)
    cosine = (q * r - np.sqrt(max(root, 0.0))) / (2 * r**2)
    if not 0 <= cosine <= 1 - PARALLEL * max(2 - order, 0.0) + COSINE_TOLERANCE:
        return np.nan, order
    r, cosine = min(r, 4.0), min(cosine, 1.0)
    error = first / np.sqrt(1 + r**2 - 2 * cosine * r)
    return SAFETY * error / float(np.linalg.norm(fine / size)), order


def _least_order(fine, middle, coarse):
    """Least order observed in parts of the time, of those that hold their share of differences."""
    parts = np.array_split(np.arange(len(fine)), max(min(TIME_PARTS, len(fine) // PART_TIMES), 1))
    first, second = (
        np.array([np.linalg.norm((one - other)[part]) for part in parts])
        for one, other in ((middle, fine), (coarse, middle))
    )
    weighs = first**2 * len(parts) >= (first**2).sum()
    return float(np.log2(second[weighs] / first[weighs]).min())


def _solve(scene, refinement, shift):
    """``refinement`` nodes per particle; strain and its material at x_j - ``shift`` Δx_r."""
    spacing, dt = scene.spacing / refinement, scene.time_step / refinement
    nodes = np.arange(refinement * scene.particle_count) * spacing
    between = (nodes - shift * spacing) % scene.domain_length
    steps = refinement * scene.error_steps
    # The midpoint rule samples the force at the start and in the middle of a step.
    samples, amplitudes, profiles = ABSENT, NO_FORCE, NO_FORCE
    if scene.forces or not scene.is_steady:
        samples = scene.times(np.arange(2 * steps[-1] + 1), 2 * refinement)
        amplitudes, profiles = scene.force_values(samples[:-1], nodes)
        for key in ("youngs_modulus", "damping"):
            if (changing := scene.changing(key)) is not None:
                changing.factors_at(samples)  # refused where they are not valid
    density0 = scene.values_at("initial_density", between)
    if shift:
        _weigh_breaks(scene, refinement, amplitudes)
        inertia, compliances, dampings, profiles, readers = _cell_means(scene, nodes.size)
        softness = _terms(_compliance(scene), lambda p: _at_particles(scene, p))
    else:
        inertia = scene.values_at("initial_density", nodes)
        compliances = _terms(_compliance(scene), lambda p: p(between))
        dampings = _terms(_damping(scene), lambda p: p(nodes))
        softness = NO_FORCE
        reader = _reader(scene.positions / spacing, np.arange(nodes.size), nodes.size)
        readers = *reader, *reader
    compliance, softening = _of_time(_compliance(scene), compliances, samples)
    # As it stands, where nothing is made of it: a quotient of a quotient may differ by rounding.
    as_it_stands = not shift and scene.changing("youngs_modulus") is None
    modulus = scene.values_at("youngs_modulus", between) if as_it_stands else 1 / compliance
    damping, slowing = _of_time(_damping(scene), dampings, samples)
    compliance, reading = _of_time(_compliance(scene), softness, samples)
    velocity = np.empty((steps.size, scene.particle_count))
    density = np.empty_like(velocity)
    material = modulus, density0, 1 / (density0 * spacing), 1 / (inertia * spacing)
    forces = damping, amplitudes, profiles
    state = np.zeros((7, nodes.size + 1))
    state[0, 1:] = scene.values_at("initial_velocity", nodes)
    state[0, 0] = state[0, -1]
    strain = scene.start.strain(x=between) if scene.start else 0.0
    state[1, :-1] = density0 / (1 + strain)
    stiffest = scene.largest_modulus().max() if softening[0].size else modulus.max()
    most_damped = scene.damping_range()[1] if slowing[0].size else damping.max(initial=0.0)
    pace = _fastest_change(stiffest, inertia, (most_damped, *forces[1:]), spacing, dt)
    at_particles = readers, scene.density0(), compliance
    changes, schedule = (softening, slowing, reading), (dt, steps, pace)
    failed = march(state, material, forces, changes, at_particles, schedule, (velocity, density))
    if failed >= 0:
        row, particle = divmod(failed, scene.particle_count)
        raise Breakdown(
            scene.name,
            "the finite-difference reference",
            scene.error_times[row],
            scene.bar_particle(particle),
        )
    return {"t": scene.error_times, "x": scene.positions, "velocity": velocity, "density": density}


Coefficient = Callable[[np.ndarray], np.ndarray] | Separated | None
"""A function of places, a sum of products where it changes with time, or none."""


def _damping(scene) -> Coefficient:
    if scene.damping is None or scene.changing("damping") is None:
        return scene.damping and (lambda x: scene.values_at("damping", x))
    return scene.separated(scene.damping)


def _compliance(scene) -> Coefficient:
    """1/c [1/Pa]."""
    if scene.changing("youngs_modulus") is None:
        return lambda x: 1 / scene.values_at("youngs_modulus", x)
    modulus = scene.youngs_modulus
    return scene.separated(modulus.rewritten(f"1/({modulus.text})"))


def _terms(coefficient, seen):
    """Profiles of a coefficient as ``seen`` has them, which makes (n,) of a function of places.

    Returns
    -------
    array, shape (terms, n)
    """
    if coefficient is None:
        return NO_FORCE
    if isinstance(coefficient, Separated):
        return _each(coefficient.profiles, len(coefficient.factors), seen)
    return seen(coefficient)[None]


def _each(profiles, count, seen):
    """As `_terms`, of a function that gives all profiles at places, (count, places)."""
    last: list[Any] = [None, None]

    def profile(x, r):
        if last[0] is not x:
            last[:] = x, profiles(x)
        return last[1][r]

    return np.stack([seen(lambda x, r=r: profile(x, r)) for r in range(count)])


def _of_time(coefficient, profiles, times) -> tuple[np.ndarray, Changes]:
    """A coefficient at the start from its profiles, and how it changes over times."""
    if not len(profiles) or not isinstance(coefficient, Separated):
        return (profiles[0] if np.any(profiles) else ABSENT), UNCHANGING
    factors = np.stack([factor(t=times) for factor in coefficient.factors], axis=1)
    return factors[0] @ profiles, (factors, profiles)


def _weigh_breaks(scene, refinement, amplitudes):
    """Give the steps within which the force breaks what it does in them, in place of samples.

    Sampled at a moment, a jump would move by up to half a step, and a pulse could be missed. The
    first stage stands for the displacement of a step, the second for its change of velocity.
    """
    for course, amplitude in zip(scene.courses(), amplitudes, strict=True):
        ends = scene.times(np.arange(amplitude.size // 2 + 1), refinement)
        within = np.unique(np.searchsorted(ends, np.setdiff1d(course.edges, ends)) - 1)
        within = within[(within >= 0) & (within < ends.size - 1)]
        if within.size:
            force = course.projected(ends[within], ends[within + 1]) * (WEIGHTS / 2)
            amplitude[2 * within] = force @ (1 - POINTS)
            amplitude[2 * within + 1] = force.sum(axis=1)


def _cell_means(scene, count):
    """Density, modulus, damping and force of cells: what each has in all, wherever it jumps.

    Sampled at a point, a jump would move by up to half a cell, on every grid otherwise, and no
    error would fall regularly with the spacing. Masses and compliances add up, and so do the
    momenta that damping and force take and give: of cells about the nodes, but the modulus of
    those to the left of them.

    Velocity has a kink where the modulus jumps, and stress where the density does; against the
    compliance and against the mass up to a place they have none, and are read at the particles by
    cubics in these.
    """
    x = (np.arange(count * CELL_PARTS) + 0.5) * (scene.domain_length / count / CELL_PARTS)

    def parts(function):
        return _means(function, x, scene.domain_length)

    def parts_of_terms(function):
        return _means(function, x, scene.domain_length, alone=True)

    def about_nodes(values):
        return np.roll(values, CELL_PARTS // 2).reshape(count, CELL_PARTS).mean(axis=1)

    def per_mass(values, places):
        return scene.values_at("initial_density", places) * values

    def weighed(function, means=parts):
        return about_nodes(means(lambda at: per_mass(function(at), at))) / inertia

    masses = parts(lambda places: scene.values_at("initial_density", places))
    inertia = about_nodes(masses)
    steady = scene.changing("youngs_modulus") is None
    softness = _terms(_compliance(scene), parts if steady else parts_of_terms)
    means = softness.reshape(len(softness), count, CELL_PARTS).mean(axis=2)
    dampings = _terms(_damping(scene), weighed)
    profiles = NO_FORCE
    if scene.forces:
        profiles = np.concatenate(
            [
                _each(
                    term.profiles,
                    len(term.factors),
                    weighed
                    if isinstance(term, Products)
                    else partial(weighed, means=parts_of_terms),
                )
                for term in scene.force_terms
            ]
        )
    # Of a modulus that changes with time, the compliances at the start stand for all.
    compliances, _ = _of_time(_compliance(scene), softness, np.zeros(1))
    velocity_reader, stress_reader = (
        _reader_across(scene, values, shift)
        for values, shift in ((compliances, 0), (masses, CELL_PARTS // 2))
    )
    at_left = np.ascontiguousarray(np.roll(means, 1, axis=1))
    return inertia, at_left, dampings, profiles, (*velocity_reader, *stress_reader)


def _means(function, x, length, alone=False):
    """Means of a periodic function over parts of its period, of which x are the midpoints.

    The midpoint rule; what changes much from one midpoint to the next is taken to jump, at a place
    that is found by bisection; or what also changes ten times more there than on either side.
    """
    width = length / x.size
    values = function(x)
    after = np.roll(values, -1)
    # Part of the way to the next midpoint that has the value of this one.
    share = np.full(x.size, 0.5)
    change = np.abs(after - values)
    steep = change > JUMP * np.abs(values).max()
    if alone:
        steep &= change > 10 * np.maximum(np.roll(change, 1), np.roll(change, -1))
    steep = np.flatnonzero(steep)
    if steep.size:
        low, high = np.zeros(steep.size), np.ones(steep.size)
        for _ in range(30):
            middle = (low + high) / 2
            there = function((x[steep] + width * middle) % length)
            here = np.abs(there - values[steep]) < np.abs(there - after[steep])
            low, high = np.where(here, middle, low), np.where(here, high, middle)
        share[steep] = low
    first = values * np.minimum(share, 0.5) + after * np.maximum(0.5 - share, 0)
    second = values * np.maximum(share - 0.5, 0) + after * np.minimum(1 - share, 0.5)
    return first + np.roll(second, 1)


def _reader_across(scene, values, shift):
    """`_reader` in the sum of values of parts up to a place, of cells' places ``shift`` parts left.

    Sums are in units of the values' mean over a part.
    """
    sums = np.append(0.0, np.cumsum(values / values.mean()))
    ends = np.arange(-shift, values.size - shift, CELL_PARTS)
    at = sums[ends % values.size] - values.size * (ends < 0)
    width = scene.domain_length / values.size
    return _reader(np.interp(scene.positions / width, np.arange(sums.size), sums), at, values.size)


def _reader(places, at, period):
    """Indices and weights (N, 4) of the cubic through what is known at the four nearest of ``at``.

    Whatever is known at a place itself has all the weight there.
    """
    near = 1e-9 * period / at.size
    first = np.searchsorted(at, places + near, side="right") - 1
    index = first[:, None] + np.arange(-1, 3)
    known = at[index % at.size] + period * (index // at.size)
    places = np.where(np.abs(places - known[:, 1]) <= near, known[:, 1], places)
    weights = np.ones(index.shape)
    for n in range(4):
        for m in range(4):
            if m != n:
                weights[:, n] *= (places - known[:, m]) / (known[:, n] - known[:, m])
    return index % at.size, weights


def _at_particles(scene, function):
    """A function of places at the particles; the mean of both sides where it jumps at one."""
    aside = 1e-9 * scene.spacing
    left, right = (
        function((scene.positions + way) % scene.domain_length) for way in (-aside, aside)
    )
    return (left + right) / 2


@compiled
def stage(states, stress, material, forces, sample, dt):
    """new = base + dt rate(old), each the velocity with a ghost on its left, and the density.

    The new arrays must be none of the others: loops that may write what they read stay scalar.
    """
    (v, rho), (base_v, base_rho), (new_v, new_rho) = states
    modulus, density0, stretch, inertia = material
    damping, amplitudes, profiles = forces
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
    for r in range(amplitudes.shape[0]):
        push = dt * amplitudes[r, sample]
        for j in range(count):
            new_v[j + 1] += push * profiles[r, j]
    new_v[0] = new_v[count]


@compiled
def coefficients_at(modulus, damping, softening, slowing, sample):
    """Modulus and damping of the nodes at a sample, where they change with time."""
    if softening[0].size:
        change(modulus, softening, sample)
        for j in range(modulus.size):
            modulus[j] = 1 / modulus[j]
    if slowing[0].size:
        change(damping, slowing, sample)


def _fastest_change(stiffest, inertia, forces, spacing, dt):
    """How fast strains and velocities of the nodes can grow, as `sph.fastest_change` has it.

    The midpoint rule changes the Jacobian J to J' by J J'/M² Δt s, M that in the middle of a step:
    by 9 Δt |s| at most while all strains are below one half.
    """
    most_damped, amplitudes, profiles = forces
    speed = np.sqrt(stiffest) / np.sqrt(inertia.min())
    push = largest_force(amplitudes, profiles)
    z, scale = 6 * speed / spacing * dt, 3 / speed
    known = z <= 1 and dt * most_damped <= 2 and dt * scale * push < np.inf
    return float(z + z**2) if known else np.inf, float(scale), float(dt * scale * push)


@compiled
def look(v, rho, density0, pace):
    """First node without finite state and positive J, or -1; and steps not to look again in."""
    strained, fast, doubts = 0.0, 0.0, 0
    for j in range(density0.size):
        strain, speed = abs(density0[j] / rho[j] - 1.0), abs(v[j])
        strained, fast = max(strained, strain), max(fast, speed)
        doubts += not strain + 0.0 * speed < SOUND
    if doubts:
        for j in range(density0.size):
            if not (rho[j] > 0 and rho[j] < np.inf and abs(v[j]) < np.inf):
                return j, 1
        return -1, 1
    return -1, sound_steps(max(strained, pace[1] * fast), pace)


@compiled
def march(state, material, forces, changes, at_particles, schedule, kept):
    """Midpoint rule; keeps velocity and density at the particles.

    ``changes`` are those of the nodes' compliance and damping with time, from sample to sample, two
    in a step, and of the compliance at the particles.

    ``state`` holds velocity and density, old, in the middle of a step and new, and the stress;
    ``schedule`` the step, those after which fields are kept, and `_fastest_change`.
    What is read of the strain is the stress, which no jump of the material interrupts, times the
    compliance at the particle; without compliances it is the density of the nodes.
    """
    old, middle, new = (state[0], state[1]), (state[2], state[3]), (state[4], state[5])
    stress, modulus, density0 = state[6], material[0], material[1]
    (nodes, node_weights, cells, cell_weights), particle_density0, compliance = at_particles
    softening, slowing, reading = changes
    changed = softening[0].size > 0 or slowing[0].size > 0
    dt, steps, pace = schedule
    velocity, density = kept
    count = velocity.shape[1]
    refinement = density0.size // count
    next_look, done = 1, 0
    for row in range(steps.size):
        for step in range(done, steps[row]):
            if changed:
                coefficients_at(modulus, forces[0], softening, slowing, 2 * step)
            stage((old, old, middle), stress, material, forces, 2 * step, dt / 2)
            if changed:
                coefficients_at(modulus, forces[0], softening, slowing, 2 * step + 1)
            stage((middle, old, new), stress, material, forces, 2 * step + 1, dt)
            old, new = new, old
            if step + 1 >= next_look:
                node, sound = look(old[0][1:], old[1], density0, pace)
                if node >= 0:
                    return row * count + node // refinement
                next_look = step + 1 + sound
        done = steps[row]
        v, rho = old
        if reading[0].size:
            coefficients_at(modulus, forces[0], softening, slowing, 2 * done)
            change(compliance, reading, 2 * done)
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
