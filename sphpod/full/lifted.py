"""Full-order model in velocity and strain, in which SPH is linear.

With the strain e_i = ρ_i(0)/ρ_i - 1 and the SPH derivative G, (2.10) and (2.11) become, with no
approximation in the equations,

    de/dt = G v,    dv/dt = (1/ρ0) G (c e) - d v + f.

The energy E = Σ m v²/2 + Σ V c e²/2 changes by damping and force alone, as V_i G_ij is
antisymmetric. In the scaled fields √m v and √(V c) e, whose squares it sums, the model is

    u' = -D u + A p + √m f,    p' = -Aᵀ u,    A = diag(ρ0)^(-1/2) G diag(c)^(1/2).

Explicit Euler takes both rates from the old state, as the paper's full SPH does; symplectic Euler
drifts the strain before it kicks the velocity with it; leapfrog drifts half before and half after,
and keeps second order. Kicks take damping exactly, for the force of a step that stands still.

Long: steps of one length, adaptive ones and those exact in time share state, operator and the watch
for folds.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from numbers import Real

import numpy as np

from sphpod.full.coefficients_in_time import Stepped
from sphpod.full.sph import (
    SOUND,
    State,
    change,
    changing,
    fastest_change,
    largest_force,
    sound_steps,
    wrap,
)
from sphpod.numerics.compiled import compiled
from sphpod.numerics.course import POINTS, WEIGHTS, spans
from sphpod.numerics.error import blocks
from sphpod.numerics.propagator import TURN
from sphpod.numerics.propagator import prepare as prepare_jumps
from sphpod.scene.breakdown import RESOLVED
from sphpod.scene.kernel import stencil_weights
from sphpod.scene.run import ALL, FullRun, Run
from sphpod.scene.scene import ABSENT, NO_FORCE, Scene, derivative_matrix, step_times
from sphpod.scene.waves import fastest_wave, warn_of_step

FIXED_STEP = ("explicit_euler", "symplectic_euler", "leapfrog")
ADAPTIVE = ("rk45", "dop853")
INTEGRATORS = (*FIXED_STEP, *ADAPTIVE, "exact")
"""How the model is stepped; the adaptive ones are scipy's Runge-Kutta pairs."""

TIGHTEST = 3e-14
"""Relative tolerance of an adaptive integrator that rounding still meets."""

VALUES_AT_ONCE = 2**18
"""Values of a field between outputs that are looked at together, which bounds the memory."""

FIELDS_AT_ONCE = 64
"""Fields that are transformed together; few enough for the processor's cache."""


def strain(scene: Scene, density: np.ndarray) -> np.ndarray:
    """Strain e = ρ0/ρ - 1 of densities (…, N)."""
    return scene.density0() / density - 1


def density(scene: Scene, strain: np.ndarray) -> np.ndarray:
    """Density ρ = ρ0/(1 + e) of strains (…, N) [kg/m³]."""
    return scene.density0() / (1 + strain)


def with_density(run: Run, rows: slice = ALL) -> dict[str, np.ndarray]:
    """Velocity [m/s] and density [kg/m³] of outputs of a run, in strain or not, (rows, N)."""
    fields = run.fields(rows)
    if "strain" in fields:
        fields["density"] = density(run.scene, fields.pop("strain"))
    return fields


def energy_weights(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """√m and √(V c), shapes (N,): velocity and strain times these are the scaled fields."""
    return np.sqrt(scene.density0() * scene.volumes), np.sqrt(scene.volumes * scene.modulus())


def pull(scene: Scene, strain_rows: np.ndarray) -> np.ndarray:
    """A p of scaled strains (…, N): the scaled velocity's rate of change [1/s times theirs]."""
    mass, stiffness = energy_weights(scene)
    return scene.derivative(strain_rows * (scene.modulus() / stiffness)) * mass / scene.density0()


def stretch(scene: Scene, velocity_rows: np.ndarray) -> np.ndarray:
    """-Aᵀ u of scaled velocities (…, N): the scaled strain's rate of change."""
    mass, stiffness = energy_weights(scene)
    return scene.derivative(velocity_rows / mass) * stiffness


def operator(scene: Scene):
    """[[-D, A], [-Aᵀ, 0]] of the scaled fields [1/s], a scipy.sparse matrix (2N, 2N)."""
    from scipy.sparse import block_array, diags_array

    mass, stiffness = energy_weights(scene)
    gradient = derivative_matrix(scene)
    damping = scene.damping_values()
    decay = diags_array(-damping if damping.size else np.zeros(scene.particle_count))
    pulls = (
        diags_array(mass / scene.density0()) @ gradient @ diags_array(scene.modulus() / stiffness)
    )
    stretches = diags_array(stiffness) @ gradient @ diags_array(1 / mass)
    return block_array([[decay, pulls], [stretches, None]]).tocsr()


def solve(
    scene: Scene,
    integrator: str,
    time_step: float | None = None,
    tolerance: float = 1e-8,
    start: State | None = None,
) -> dict[str, np.ndarray]:
    """Run the lifted full model and keep its fields at the times of the error integral.

    Parameters
    ----------
    integrator : {"explicit_euler", "symplectic_euler", "leapfrog", "rk45", "dop853", "exact"}
    time_step : float, optional
        Δt [s] of the first three, of which the error interval is a whole multiple; the scene's own
        if not given.
    tolerance : float
        Relative tolerance of the adaptive ones.
    start : (velocity, strain), optional
        State at t = 0; the scene's own if not given.

    Returns
    -------
    dict
        t (times,) [s], x (N,) [m], velocity (times, N) [m/s], strain (times, N); of ``exact`` where
        coefficients change with time also time_error_estimate (`coefficients_in_time`).

    Raises
    ------
    ValueError
        There is no such integrator, or the error interval is no multiple of the time step.
    Breakdown
        The solution became non-finite, or its Jacobian 1 + e stopped being positive.
    """
    if integrator in ("symplectic_euler", "leapfrog"):
        warn_of_step(scene, integrator, _own_step(scene, time_step))
    run = prepare(scene, integrator, time_step, tolerance, start).solve()
    solution = run.stored()
    if isinstance(run.march, Stepped):
        solution["time_error_estimate"] = np.array(run.march.time_error)
    return solution


def prepare(
    scene: Scene,
    integrator: str,
    time_step: float | None = None,
    tolerance: float = 1e-8,
    start: State | None = None,
) -> FullRun:
    """Everything that precedes the time loop.

    Parameters are those of `solve`. Between outputs fixed steps are looked at as often as
    `sph.fastest_change` asks for (leapfrog's strain in the middle of its steps), and what is exact
    or adaptive at times a `RESOLVED` part of the fastest wave's radian apart, unless energy
    excludes a fold.
    """
    begin = start or (scene.velocity0(), scene.starting_strain())
    if integrator in FIXED_STEP:
        march = _fixed_step(scene, integrator, _own_step(scene, time_step), begin)
    elif integrator in ADAPTIVE:
        if not (_is_number(tolerance) and TIGHTEST <= tolerance < 1):
            allowed = f"it must be a number from {TIGHTEST:g} to below 1"
            raise ValueError(f"scene {scene.name}: tolerance = {tolerance!r}: {allowed}")
        march = _adaptive(scene, integrator, tolerance, begin)
        if scene.is_steady:
            march = _resolved(scene, integrator, tolerance, march)
    elif integrator != "exact":
        raise ValueError(f"integrator = {integrator}: allowed are {', '.join(INTEGRATORS)}")
    elif not np.isfinite(begin).all():
        march = _filling(partial(_show_start, begin))
    elif scene.is_stepped:
        march = Stepped(scene, begin)
    else:
        march = (_fourier if is_uniform(scene) else _exponential)(scene, begin)
        march = _resolved(scene, integrator, tolerance, march)
    name = f"the lifted full model ({integrator})"
    return FullRun.of(scene, name, scene.error_times, "strain", march)


def is_uniform(scene: Scene) -> bool:
    """Whether spacing, density, modulus and damping are the same at all particles and times."""
    fields = scene.density0(), scene.modulus(), scene.damping_values()
    even = scene.is_even and scene.is_steady
    return even and all(field.size == 0 or field.min() == field.max() for field in fields)


# --- Fixed steps ----------------------------------------------------------------------------------


def _is_number(value):
    return isinstance(value, Real) and not isinstance(value, bool)


def _own_step(scene, time_step):
    """The time step that is given, or the scene's [s]."""
    if time_step is None:
        return scene.time_step
    if not (_is_number(time_step) and 0 < time_step < np.inf):
        allowed = f"it must be a positive number, as the scene's {scene.time_step:g}"
        raise ValueError(f"scene {scene.name}: time_step = {time_step!r}: {allowed}")
    return float(time_step)


def _fixed_step(scene, integrator, dt, begin):
    stride = round(scene.error_interval / dt)
    if stride < 1 or abs(stride * dt - scene.error_interval) > 1e-9 * scene.error_interval:
        raise ValueError(
            f"scene {scene.name}: time_step = {dt:g}: the error interval "
            f"{scene.error_interval:g} must be a whole number of them"
        )
    steps = np.arange(scene.error_times.size) * stride
    explicit = integrator == "explicit_euler"
    half = integrator == "leapfrog"
    density0 = scene.density0()
    modulus, damping, stiffening, slowing = _coefficients(scene, dt, steps[-1], half)
    amplitudes, profiles = _kicks(scene, integrator, dt, steps[-1])
    pace = fastest_change(scene, dt, largest_force(amplitudes, profiles))
    # The stress c e is stepped, not the strain: a product less for each neighbour.
    stiffness = dt * modulus
    keep, gain = np.ones_like(density0), np.full_like(density0, dt)
    if damping.size:
        keep = 1 - dt * damping if explicit else np.exp(-dt * damping)
        gain = gain if explicit else kick_time(damping, dt)
    inertia, push = gain / density0, gain * profiles if profiles.size else NO_FORCE
    weights, geometry = scene.neighbours()
    uniform = is_uniform(scene) and weights.size <= 2
    even_push = push.size > 0 and bool((push.min(axis=1) == push.max(axis=1)).all())
    if uniform:
        # One coefficient for all particles goes into the weights, the force into one number.
        weights = np.pad(weights, (0, 2 - weights.size))
        drift, kick = stiffness[0] * weights, inertia[0] * weights
        if even_push:
            amplitudes, push = push[:, :1].T @ amplitudes, NO_FORCE
        coefficients = keep[:1], ABSENT, ABSENT
    else:
        drift = kick = weights
        coefficients = (keep if damping.size else keep[:1]), stiffness, inertia
    compliance = 1 / modulus
    velocity0, stress0 = (
        np.pad(field, weights.size, mode="wrap") for field in (begin[0], modulus * begin[1])
    )
    calm = strain_bound(scene, integrator, dt, begin) < 0.99

    def run(velocity, strain, watch):
        state = np.zeros((4, velocity0.size))
        state[0], state[2] = velocity0, stress0
        # What changes with time is written over from step to step.
        own = tuple(part.copy() for part in coefficients)
        operators = drift, kick, geometry, own, compliance.copy()
        schedule = explicit, half, steps, watch and not calm, pace
        changes = stiffening, slowing, (profiles, density0, dt)
        force = amplitudes, push.copy()
        return march(state, operators, force, changes, schedule, (velocity, strain))

    return run


def _coefficients(scene, dt, count, half):
    """Modulus and damping at the start, and how they change in so many steps."""
    scene = replace(scene, time_step=dt)
    modulus, stiffening = changing(scene, "youngs_modulus", count + 1)
    damping, slowing = changing(scene, "damping", count)
    # Leapfrog has its strain, and its kicks, in the middle of steps.
    if half and stiffening[0].size:
        _, (factors, profiles) = changing(scene, "youngs_modulus", 2 * count, parts=2)
        stiffening = np.concatenate([factors[:1], factors[1::2]]), profiles
    if half and slowing[0].size:
        _, (factors, profiles) = changing(scene, "damping", 2 * count, parts=2)
        slowing = np.ascontiguousarray(factors[1::2]), profiles
    return modulus, damping, stiffening, slowing


def _kicks(scene, integrator, dt, steps):
    """Force of each step as `Scene.force_values`; leapfrog kicks in the middle of its steps."""
    if not scene.forces:
        return NO_FORCE, NO_FORCE
    halves = 2 * np.arange(steps) + (integrator == "leapfrog")
    return scene.force_values(step_times(dt, halves, 2))


def strain_bound(scene: Scene, integrator: str, time_step: float, begin: State) -> float:
    """What no strain exceeds at any step of a run, by its energy; infinite if that bounds nothing.

    In the norm |(u, p)| of the scaled fields a step of explicit Euler without a force is at most
    √(1 + z² + zδ) with z = Δt ω of the fastest wave and δ = Δt d ≤ 2 of the largest damping.
    Symplectic Euler and leapfrog keep or lose the energies H of `sphpod.full.energy`, which with
    ρ = z/2 < 1 lie between (1 - ρ) |(u, p)|² and (1 + ρ) w |(u, p)|², w the largest x coth x. A
    force adds at most Δt |f| |√m| to the norm in a step, and (1 - ρ²)^(-1/2) times that to √H. A
    strain is at most |p| over the smallest √(V c). Of coefficients that change with time this says
    nothing.

    Parameters
    ----------
    integrator : {"explicit_euler", "symplectic_euler", "leapfrog"}
    time_step : float
        Δt [s].
    begin : (velocity, strain)
        State at t = 0.
    """
    if not scene.is_steady:
        return np.inf
    mass, stiffness = energy_weights(scene)
    steps = round(scene.duration / time_step)
    z = time_step * fastest_wave(scene)
    amplitudes, profiles = _kicks(scene, integrator, time_step, steps)
    damping = scene.damping_values().max(initial=0.0) * time_step
    with np.errstate(invalid="ignore", over="ignore"):
        size = np.sqrt(np.sum((mass * begin[0]) ** 2) + np.sum((stiffness * begin[1]) ** 2))
        reach = np.linalg.norm(mass * profiles, axis=1) if profiles.size else np.zeros(0)
        push = time_step * np.abs(amplitudes).sum(axis=1) @ reach
        if integrator == "explicit_euler":
            growth = (1 + z**2 + z * damping) ** (steps / 2) if damping <= 2 else np.inf
            norm = growth * (size + push)
        elif z < 2:
            rho, half = z / 2, damping / 2
            weight = half / np.tanh(half) if half > 0 else 1.0
            root = np.sqrt((1 + rho) * weight) * size + push / np.sqrt(1 - rho**2)
            norm = root / np.sqrt(1 - rho)
        else:
            norm = np.inf
        bound = norm / stiffness.min()
    return float(bound) if bound < np.inf else np.inf


def kick_time(damping, dt):
    """(1 - exp(-d Δt))/d, the time that a constant force acts through while it is damped [s]."""
    return np.where(damping > 0, -np.expm1(-damping * dt) / np.where(damping > 0, damping, 1), dt)


@compiled
def advance_uniform(old, field, weights, keep, push, new):
    """new = keep old + push + G field, for one coefficient and two neighbours on each side."""
    w1, w2 = weights[0], weights[1]
    for i in range(old.size - 4):
        rate = w1 * (field[i + 3] - field[i + 1]) + w2 * (field[i + 4] - field[i])
        new[i + 2] = keep * old[i + 2] + push + rate


@compiled
def advance_two(old, field, weights, factor, new):
    """new = old + factor G field, for two neighbours on each side."""
    w1, w2 = weights[0], weights[1]
    for i in range(old.size - 4):
        rate = w1 * (field[i + 3] - field[i + 1]) + w2 * (field[i + 4] - field[i])
        new[i + 2] = old[i + 2] + factor[i] * rate


@compiled
def advance_any(old, field, weights, factor, new):
    """As advance_two, for any number of neighbours, whose loop is outside that of particles."""
    width = weights.size
    for i in range(factor.size):
        new[i + width] = 0.0
    for k in range(width):
        for i in range(factor.size):
            right, left = i + width + k + 1, i + width - k - 1
            new[i + width] += weights[k] * (field[right] - field[left])
    for i in range(factor.size):
        new[i + width] = old[i + width] + factor[i] * new[i + width]


@compiled
def advance_lists(old, field, geometry, factor, new):
    """As advance_two, for particles that each have their own list of neighbours."""
    first, neighbours, gradients = geometry
    for i in range(factor.size):
        rate = 0.0
        for n in range(first[i], first[i + 1]):
            rate += gradients[n] * field[neighbours[n]]
        new[i] = old[i] + factor[i] * rate


@compiled
def act(v, new_v, keep, push, amplitudes, step):
    """Damping and force of one step where they vary in space; fields are without ghosts."""
    if keep.size > 1:
        for i in range(keep.size):
            new_v[i] -= (1 - keep[i]) * v[i]
    for r in range(push.shape[0]):
        now = amplitudes[r, step]
        for i in range(push.shape[1]):
            new_v[i] += now * push[r, i]


@compiled
def restress(stress, stiffness, compliance, stiffening, dt, step):
    """Δt c and 1/c where c changes with time, and the stress of the strain that is there."""
    change(stiffness, stiffening, step)
    for i in range(compliance.size):
        stress[i] *= stiffness[i] * compliance[i]
        compliance[i] = 1 / stiffness[i]
        stiffness[i] *= dt


@compiled
def slow(coefficients, push, slowing, base, explicit, step):
    """What damping that changes with time leaves of a velocity and of a kick in a step."""
    keep, _, inertia = coefficients
    profiles, density0, dt = base
    change(keep, slowing, step)
    for i in range(keep.size):
        d, gain = keep[i], dt
        keep[i] = 1 - dt * d
        if not explicit:
            keep[i] = np.exp(-dt * d)
            gain = -np.expm1(-dt * d) / d if d > 0 else dt
        inertia[i] = gain / density0[i]
        for r in range(push.shape[0]):
            push[r, i] = gain * profiles[r, i]


@compiled
def show(v, stress, compliance, watch, velocity, strain):
    """Copy fields without ghosts into a row of what is kept; first broken value, or -1.

    A strain between -1 and 1 is sound: one comparison a particle, which is usually enough. Zero
    times a velocity that is not finite is not finite either.
    """
    if not watch:
        for i in range(compliance.size):
            velocity[i] = v[i]
            strain[i] = compliance[i] * stress[i]
        return -1
    doubts = 0
    for i in range(compliance.size):
        e = compliance[i] * stress[i]
        velocity[i] = v[i]
        strain[i] = e
        doubts += not abs(e + 0.0 * v[i]) < 1
    return first_broken(velocity, strain) if doubts else -1


@compiled
def look(v, stress, compliance, pace):
    """Steps in which no strain reaches one, as from `sound_steps`; 0 if the state is broken."""
    strained, fast, doubts = 0.0, 0.0, 0
    for i in range(compliance.size):
        size, speed = abs(compliance[i] * stress[i]), abs(v[i])
        strained, fast = max(strained, size), max(fast, speed)
        doubts += not size + 0.0 * speed < SOUND
    if doubts:
        for i in range(compliance.size):
            e = compliance[i] * stress[i]
            if not (e > -1 and e < np.inf and abs(v[i]) < np.inf):
                return 0
        return 1
    return sound_steps(max(strained, pace[1] * fast), pace)


@compiled
def first_broken(velocity, strain):
    """First value without finite state and positive 1 + e, or -1; of flat fields."""
    for i in range(strain.size):
        if not (strain[i] > -1 and strain[i] < np.inf and abs(velocity[i]) < np.inf):
            return i
    return -1


@compiled
def doubtful(velocity, strain):
    """How many values of flat fields fail the test of `show`, which all broken ones do."""
    count = 0
    for i in range(strain.size):
        count += not abs(strain[i] + 0.0 * velocity[i]) < 1
    return count


@compiled
def march(state, operators, force, changes, schedule, kept):
    """``state`` holds velocity and stress, old and new, with ghosts; ``changes`` those of modulus
    and damping, and of what their kicks are made; ``schedule`` whether steps are explicit, whether
    they begin with half a drift, those after which fields are kept, whether these are looked at,
    and `fastest_change`.

    Longer than a function should be: the kernels are chosen here, at every call, as in a function
    of its own they would be compiled without vectors, three times slower.
    """
    v, new_v, stress, new_stress = state[0], state[1], state[2], state[3]
    drift, kick, geometry, (keep, stiffness, inertia), compliance = operators
    amplitudes, push = force
    stiffening, slowing, base = changes
    explicit, half, steps, watch, pace = schedule
    velocity, strain = kept
    width = drift.size
    inner = slice(width, width + compliance.size)
    uniform = stiffness.size == 0
    even_keep, even_push = (keep[0] if uniform else 1.0), 0.0
    next_look = 1 if watch else np.iinfo(np.int64).max
    done = 0
    for row in range(steps.size):
        for step in range(done, steps[row]):
            if uniform:
                advance_uniform(stress, v, drift, 1.0, 0.0, new_stress)
            elif width == 2:
                advance_two(stress, v, drift, stiffness, new_stress)
            elif width:
                advance_any(stress, v, drift, stiffness, new_stress)
            else:
                advance_lists(stress, v, geometry, stiffness, new_stress)
            wrap(new_stress, width)
            if half and step == 0:
                # Leapfrog begins with half a drift; all later ones are whole.
                for i in range(stress.size):
                    new_stress[i] = 0.5 * (stress[i] + new_stress[i])
            if stiffening[0].size:
                restress(new_stress[inner], stiffness, compliance, stiffening, base[2], step + 1)
                wrap(new_stress, width)
            if slowing[0].size:
                slow((keep, stiffness, inertia), push, slowing, base, explicit, step)
            pulling = stress if explicit else new_stress
            if uniform:
                if amplitudes.size and not push.size:
                    even_push = amplitudes[0, step]
                advance_uniform(v, pulling, kick, even_keep, even_push, new_v)
            elif width == 2:
                advance_two(v, pulling, kick, inertia, new_v)
            elif width:
                advance_any(v, pulling, kick, inertia, new_v)
            else:
                advance_lists(v, pulling, geometry, inertia, new_v)
            if keep.size > 1 or push.size:
                act(v[inner], new_v[inner], keep, push, amplitudes, step)
            wrap(new_v, width)
            v, new_v = new_v, v
            stress, new_stress = new_stress, stress
            if step + 1 >= next_look:
                sound = look(v[inner], stress[inner], compliance, pace)
                if not sound:
                    failed = show(
                        v[inner], stress[inner], compliance, watch, velocity[row], strain[row]
                    )
                    return row * compliance.size + failed
                next_look = step + 1 + sound
        done = steps[row]
        shown = stress
        if half and done:
            # The strain is half a drift behind, which half of the next one shows.
            if uniform:
                advance_uniform(stress, v, drift, 1.0, 0.0, new_stress)
            elif width == 2:
                advance_two(stress, v, drift, stiffness, new_stress)
            elif width:
                advance_any(stress, v, drift, stiffness, new_stress)
            else:
                advance_lists(stress, v, geometry, stiffness, new_stress)
            for i in range(stress.size):
                new_stress[i] = 0.5 * (stress[i] + new_stress[i])
            shown = new_stress
        failed = show(v[inner], shown[inner], compliance, watch, velocity[row], strain[row])
        if failed >= 0:
            return row * compliance.size + failed
    return -1


def _watched(velocity, strain):
    """Flat index of the first broken value of rows that lie behind one another, or -1."""
    flat = velocity.reshape(-1), strain.reshape(-1)
    return first_broken(*flat) if doubtful(*flat) else -1


def _filling(fill):
    """A march that fills both fields before it looks at them."""

    def run(velocity, strain, watch):
        fill(velocity, strain)
        return _watched(velocity, strain) if watch else -1

    return run


def _show_start(begin, velocity, strain):
    """The start alone: where nothing follows from it, it shows what particle is broken."""
    velocity[:], strain[:] = np.nan, np.nan
    velocity[0], strain[0] = begin


def _resolved(scene, integrator, tolerance, march):
    """A march that looks for a fold between outputs too, where they do not resolve the waves.

    Intervals between outputs are solved anew, with outputs within them, unless energy excludes a
    fold: nothing but a force raises it, and a strain is at most its norm over the least √(V c).
    """
    count, interval = scene.particle_count, scene.error_interval
    parts = int(np.ceil(fastest_wave(scene) * interval / RESOLVED))
    if parts <= 1:
        return march
    most = _most_strain(scene)
    at_once = max(1, VALUES_AT_ONCE // (parts * count))
    # Of an interval that is long beside the waves, parts are solved a few at a time.
    parts_at_once = min(at_once * parts, max(1, VALUES_AT_ONCE // count))

    def look_within(row, end, state):
        """First part from a row to another in which a particle is broken, and its fields there."""
        for first in range(0, (end - row) * parts, parts_at_once):
            steps = min(parts_at_once, (end - row) * parts - first)
            begun = scene.error_times[row] + first * interval / parts
            within = replace(
                scene.later(begun),
                duration=steps * interval / parts,
                error_interval=interval / parts,
                time_step=interval / parts,
            )
            run = prepare(within, integrator, tolerance=tolerance, start=state).run()
            part, particle = divmod(run.failed, count)
            # The end is an output, in which the run itself sees what is broken.
            if run.failed >= 0 and first + part < (end - row) * parts:
                return first + part, particle, [field[part] for field in run.state]
            state = tuple(field[-1] for field in run.state)
        return None

    def march_and_look(velocity, strain, watch):
        failed = march(velocity, strain, watch)
        if not watch:
            return failed
        row, last = 0, len(velocity) - 1 if failed < 0 else failed // count
        while row < last:
            rows = slice(row, min(row + at_once, last))
            doubts = most(velocity[rows], strain[rows], rows) >= 0.99
            if not doubts.any():
                row += doubts.size
                continue
            row, end = row + int(doubts.argmax()), row + doubts.size
            broken = look_within(row, end, (velocity[row], strain[row]))
            if broken is not None:
                part, particle, fields = broken
                row += -(-part // parts)
                velocity[row], strain[row] = fields
                return row * count + particle
            row = end
        return failed

    return march_and_look


def _most_strain(scene):
    """What no strain exceeds until the next output: ``most(velocity, strain, rows)``, (rows,).

    Nothing but a force raises the energy, and a strain is at most its norm over the least √(V c).
    On a uniform line the energy of every wave is kept apart, and the strain is at most the sum of
    the waves' amplitudes; a translation strains nothing.
    """
    mass, stiffness = energy_weights(scene)
    _, profiles = scene.force_values(np.zeros(1))
    pushed, reach = np.zeros(scene.error_times.size - 1), np.zeros(0)
    if is_uniform(scene):
        speed = np.sqrt(scene.modulus()[0] / scene.density0()[0])
        if profiles.size:
            reach = _amplitudes(profiles)[:, 1:].sum(axis=1) / speed

        def most(velocity, strain, rows):
            moving = _amplitudes(velocity) / speed
            moving[:, 0] = 0
            return np.hypot(moving, _amplitudes(strain)).sum(axis=1) + pushed[rows]
    else:
        if profiles.size:
            reach = np.linalg.norm(mass * profiles, axis=1) / stiffness.min()

        def most(velocity, strain, rows):
            squares = np.sum((mass * velocity) ** 2, axis=1)
            squares += np.sum((stiffness * strain) ** 2, axis=1)
            return np.sqrt(squares) / stiffness.min() + pushed[rows]

    for course, far in zip(scene.courses(), reach, strict=True):
        if far > 0:
            pushed += np.diff(course.impulse(scene.error_times)) * far
    return most


def _amplitudes(fields):
    """Amplitudes of the waves of fields (…, N), the mean and those from long to short."""
    count = fields.shape[-1]
    sizes = np.abs(np.fft.rfft(fields)) * (2 / count)
    sizes[..., 0] /= 2
    if count % 2 == 0:
        sizes[..., -1] /= 2
    return sizes


# --- Adaptive steps -------------------------------------------------------------------------------


def rates(scene: Scene) -> Callable[[float, np.ndarray], np.ndarray]:
    """Right-hand side of the model as scipy's solvers take it.

    Returns
    -------
    callable
        ``rate(t, state)``: rates of change of velocity and strain, one behind the other, (2N,).
    """
    count = scene.particle_count
    inertia, modulus = 1 / scene.density0(), scene.modulus()
    damping = scene.damping_values()
    stiffening, slowing = scene.changing("youngs_modulus"), scene.changing("damping")
    factors = [factor for term in scene.force_terms for factor in term.factors]
    _, profiles = scene.force_values(np.zeros(1))
    weights, _ = scene.neighbours()
    fields = np.empty((2, count + 2 * weights.size))
    if not scene.is_even:
        gradient = derivative_matrix(scene)

    def rate(t, state):
        now, c, d = np.array([t]), modulus, damping
        push = ABSENT
        if factors:
            push = sum(g(t=now)[0] * profile for g, profile in zip(factors, profiles, strict=True))
        if stiffening is not None:
            c = stiffening.at(now)[0]
        if slowing is not None:
            d = slowing.at(now)[0]
        if not scene.is_even:
            velocity, strain = np.split(state, 2)
            acceleration = inertia * (gradient @ (c * strain))
            acceleration[: d.size] -= d * velocity[: d.size]
            acceleration[: push.size] += push
            return np.concatenate([acceleration, gradient @ velocity])
        result = np.empty_like(state)
        rates_of(state, fields, weights, (inertia, c), (d, push), result)
        return result

    return rate


def _adaptive(scene, integrator, tolerance, begin):
    from scipy.integrate import solve_ivp

    count, times = scene.particle_count, scene.error_times
    start = np.concatenate(begin)
    # Strain and velocity over the speed of sound are alike in size.
    speed = np.sqrt(scene.modulus() / scene.density0())
    courses, (_, profiles) = scene.courses(), scene.force_values(times[:1])
    pushed = sum(
        course.total * np.abs(profile).max()
        for course, profile in zip(courses, profiles, strict=True)
    )
    size = np.abs(start * np.concatenate([np.ones(count), speed])).max() + pushed or 1.0
    absolute = tolerance * size * np.concatenate([np.ones(count), 1 / speed])
    rate = rates(scene)
    for one in (scene.changing("youngs_modulus"), scene.changing("damping")):
        courses += () if one is None else one.courses
    # No step is longer than a force is a polynomial, so that none steps over a pulse.
    parts = spans(courses, times[-1])
    options = {"method": integrator.upper(), "rtol": tolerance, "atol": absolute}

    def fill(velocity, strain):
        _show_start(begin, velocity, strain)
        if not np.isfinite(rate(0.0, start)).all():
            # From here scipy would look for a first step without end.
            return
        state = start
        for part in parts:
            if not np.isfinite(rate(part.inner[0], state)).all():
                break
            rows = np.flatnonzero((times > part.first) & (times <= part.last))
            result = solve_ivp(
                partial(_within, rate, part.inner) if courses else rate,
                (part.first, part.last),
                state,
                t_eval=np.union1d(times[rows], part.last),
                max_step=part.shortest,
                **options,
            )
            # Of a span that fails at once scipy returns an empty list.
            states = np.reshape(result.y, (start.size, -1)).T
            rows = rows[: len(states)]
            velocity[rows], strain[rows] = np.split(states[: rows.size], 2, axis=1)
            if not result.success:
                break
            state = states[-1].copy()

    return _filling(fill)


def _within(rate, inner, t, state):
    """The rate at the nearest time at which the force is that of the whole span."""
    return rate(min(max(t, inner[0]), inner[1]), state)


@compiled
def rates_of(state, fields, weights, material, forces, rates):
    """Rates of change of velocity and strain, one behind the other in ``state``."""
    inertia, modulus = material
    damping, push = forces
    width, count = weights.size, inertia.size
    v, stress = fields[0], fields[1]
    for i in range(count):
        v[i + width] = state[i]
        stress[i + width] = modulus[i] * state[i + count]
    wrap(v, width)
    wrap(stress, width)
    rates[:] = 0.0
    for k in range(width):
        for i in range(count):
            right, left = i + width + k + 1, i + width - k - 1
            rates[i] += weights[k] * (stress[right] - stress[left])
            rates[i + count] += weights[k] * (v[right] - v[left])
    for i in range(count):
        rates[i] *= inertia[i]
    for i in range(damping.size):
        rates[i] -= damping[i] * state[i]
    for i in range(push.size):
        rates[i] += push[i]


# --- Exact in time --------------------------------------------------------------------------------


def _fourier(scene, begin):
    """Every Fourier mode of a uniform line is a damped oscillator, carried by jumps."""
    count, times = scene.particle_count, scene.error_times
    density0, modulus, damping = scene.density0(), scene.modulus(), scene.damping_values()
    weights = stencil_weights(scene.spacing, scene.smoothing_ratio)
    modes = count // 2 + 1
    angle = 2 * np.pi * np.arange(modes) / count
    # Of the derivative of a wave exp(iθx/Δx), i times this; 0 for the sawtooth, up to rounding.
    symbol = 2 * np.sin(np.outer(angle, np.arange(1, weights.size + 1))) @ weights
    if count % 2 == 0:
        symbol[-1] = 0.0
    speed = np.sqrt(modulus[0] / density0[0])
    pairs = np.zeros((2 * modes, 2, 2))
    # v̂ and q̂ = i (c/ρ0)^(1/2) ê: v̂' = -d v̂ + ω q̂, q̂' = -ω v̂, real and imaginary parts alike.
    pairs[:, 0, 1] = np.repeat(speed * symbol, 2)
    pairs[:, 1, 0] = -pairs[:, 0, 1]
    pairs[:, 0, 0] = -damping[0] if damping.size else 0.0
    _, profiles = scene.force_values(times[:1])
    force = np.zeros((len(profiles), 2 * modes, 2))
    for profile, fed in zip(profiles, force, strict=True):
        spectrum = np.fft.rfft(profile)
        spectrum[np.abs(spectrum) <= 1e-15 * np.abs(spectrum).max()] = 0
        fed[:, 0] = spectrum.view(float)

    jumps = prepare_jumps(pairs, 0, force, scene.error_interval, times.size, scene.courses())
    start = [np.fft.rfft(field).view(float) for field in (begin[0], begin[1])]
    # q̂ = i s ê, s the speed of waves.
    strained = speed * np.stack([-start[1][1::2], start[1][::2]], axis=1).ravel()
    # All the energy that waves without a force will ever have bounds every strain; mean velocity
    # strains nothing.
    waves = 2 * (np.sum(start[0][2:] ** 2) + np.sum(strained**2)) / count
    calm = waves < 0.99 * speed**2 and not force[:, 2:].any()
    state = np.zeros((4 * modes, times.size))
    first, second = state[: 2 * modes], state[2 * modes :]

    def run(velocity, strain, watch):
        first[:, 0], second[:, 0] = start[0], strained
        jumps.run(state)
        watched = watch and not (calm and np.isfinite(first[0]).all())
        for rows in blocks(times.size, FIELDS_AT_ONCE):
            velocity[rows] = np.fft.irfft(first[::2, rows].T + 1j * first[1::2, rows].T, count)
            shown = (second[1::2, rows].T - 1j * second[::2, rows].T) / speed
            strain[rows] = np.fft.irfft(shown, count)
            failed = _watched(velocity[rows], strain[rows]) if watched else -1
            if failed >= 0:
                return rows.start * count + failed
        return -1

    return run


def _exponential(scene, begin):
    """Products with the exponential of the sparse operator, from output to output."""
    from scipy.sparse.linalg import expm_multiply

    count, interval, times = scene.particle_count, scene.error_interval, scene.error_times
    matrix, scales = operator(scene), np.concatenate(energy_weights(scene))
    start = scales * np.concatenate(begin)
    courses, (_, profiles) = scene.courses(), scene.force_values(times[:1])
    trace = float(matrix.trace())
    # Parts of an interval short enough for the response to be a polynomial on each.
    cells = max(1, int(np.ceil(abs(matrix).sum(axis=0).max() * interval / TURN)))
    short = interval / cells
    if courses:
        shapes = scales[:, None] * np.concatenate([profiles, np.zeros_like(profiles)], axis=1).T
        # What each term at each point has become at the end, (points, 2N, terms).
        responses = np.stack(
            [
                short / 2 * w * expm_multiply(matrix * (short * (1 - c) / 2), shapes)
                for c, w in zip(POINTS, WEIGHTS, strict=True)
            ]
        )
        first = np.arange(cells * (times.size - 1))
        values = np.stack([one.projected(first * short, (first + 1) * short) for one in courses])
        values = values.reshape(len(courses), times.size - 1, cells, POINTS.size)

    def pushed_in(cell):
        return sum(
            at_points @ responses[..., term] for term, at_points in enumerate(values[:, :, cell])
        )

    def pushes():
        """What the force adds from output to output, (outputs - 1, 2N)."""
        added = pushed_in(0)
        for cell in range(1, cells):
            carried = expm_multiply(matrix * short, added.T, traceA=trace * short)
            added = carried.T + pushed_in(cell)
        return added

    def fill(velocity, strain):
        if not courses:
            states = expm_multiply(matrix, start, 0, times[-1], times.size, True, trace) / scales
            velocity[:], strain[:] = states[:, :count], states[:, count:]
            return
        state, jump, added = start, matrix * interval, pushes()
        for row in range(times.size):
            velocity[row], strain[row] = np.split(state / scales, 2)
            if row < len(added):
                state = expm_multiply(jump, state, traceA=trace * interval) + added[row]

    return _filling(fill)
