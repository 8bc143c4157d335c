"""Exact solutions of the mass-spring-damper line, where one is known.

In the strain e = ρ0/ρ - 1 the model of section 2.1 is linear,

    ∂e/∂t = ∂v/∂x,    ρ0 ∂v/∂t = ∂(c e)/∂x - ρ0 d v + ρ0 f,    e(x, 0) = 0,  v(x, 0) = v0(x),

and periodic in x. Three kinds of scene have a solution in closed form:

``dalembert``
    Uniform ρ0 and c, no damping, uniform force or none: two travelling waves.
``fourier``
    Uniform ρ0, c and d, any force, and evenly spaced particles, to which Fourier series are
    summed fast: every Fourier mode is a damped oscillator. The wave fronts are
    carried as two decaying travelling waves; what remains is smoother than v0 by one derivative,
    and only that is a Fourier series, cut where `TRUNCATION` allows.
``two_layer``
    ρ0 and c constant in each of two layers, no damping, uniform force or none: waves that are
    reflected and transmitted at the two interfaces.

Travelling waves, reflected or not, are exact to 1e-12 of the largest v0 at any distance, with kinks
and jumps of v0 where they belong. A uniform force adds the same velocity everywhere. What it and
the force of a mode do is integrated by `sphpod.numerics.propagator`, wherever in time the force
jumps.

Long: the three kinds of solution share forces and the search for folds.
"""

from dataclasses import replace
from functools import partial

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.polynomial import chebyshev

from sphpod.numerics import propagator
from sphpod.numerics.expressions import Expression
from sphpod.scene.breakdown import Breakdown
from sphpod.scene.kernel import derivative_coefficient
from sphpod.scene.resolution import jumps
from sphpod.scene.scene import Scene

BLOCK = 2**15
"""Values of a field computed at once: many for the cost of a call, few for the processor cache."""

TRUNCATION = 1e-8
"""L2 norm of what a Fourier series leaves out at any time, relative to all of it at t = 0."""

MODE_LIMIT = 4096
"""Largest number of Fourier modes; only profiles that jump would need more."""

MODES_AT_ONCE = 256
"""Forced modes that are carried together, which bounds the memory."""

LARGEST_ROUNDING = 1e-6
"""Rounding error of strains up to which the solution of two layers is taken for exact."""

SHORTEST = 6e-6
"""Distance in spacings at which a mean slope is as wrong by rounding as by v0's third derivative.

Either is 4e-11 of what v0 and its third derivative are over a spacing.
"""

FOLD_POINTS = 2048
"""Points of the line, and times of its motion, at which folding is looked for without a proof."""


FEW = 64
"""Places that show of most materials that they are neither uniform nor two layers."""


def kind(scene: Scene) -> str | None:
    """Which exact solution a scene has.

    Returns
    -------
    "dalembert", "fourier", "two_layer" or None
        See the module; None if no exact solution is known.
    """
    if not scene.is_steady or scene.start:
        return None
    x = _fine_grid(scene)
    few = x[:: x.size // FEW]
    if any(_several(one(x=few)) for one in (scene.initial_density, scene.youngs_modulus)):
        return None
    density, modulus = scene.initial_density(x=x), scene.youngs_modulus(x=x)
    damping = scene.damping_values(x)
    simple = not damping.size and _evenly_forced(scene)
    if _uniform(density) and _uniform(modulus):
        if simple:
            return "dalembert"
        uniform = not damping.size or _uniform(damping)
        return "fourier" if uniform and scene.is_even else None
    if not simple or _jumps(density, modulus) is None:
        return None
    # Signals that differ by rounding would be taken for strains where waves are so slow.
    slowest = np.min(np.sqrt(modulus) / np.sqrt(density))
    rounding = np.finfo(float).eps * np.abs(scene.initial_velocity(x=x)).max()
    return "two_layer" if rounding <= LARGEST_ROUNDING * slowest else None


def layers(scene: Scene) -> list[tuple[float, str]]:
    """Start [m] and name, by what differs, of the layers of a scene that has two; else none."""
    if kind(scene) != "two_layer":
        return []
    left, width, *_ = _layers(scene)
    centre = (left + width / 2) % scene.domain_length
    modulus, density = scene.youngs_modulus(x=centre), scene.initial_density(x=centre)
    differing = [
        [f"{symbol} = {value:g} {unit}" for value in values]
        for symbol, values, unit in (("c", modulus, "Pa"), ("ρ₀", density, "kg/m³"))
        if not _uniform(values)
    ]
    names = [", ".join(parts) for parts in zip(*differing, strict=True)]
    found = sorted(zip((left % scene.domain_length).tolist(), names, strict=True))
    if scene.ends is None:
        return found
    within = [(start, name) for start, name in found if start < scene.bar_length]
    return [(0.0, found[-1][1]), *within]


def solve(scene: Scene) -> dict[str, np.ndarray]:
    """Exact solution at the particles and the times of the error integral.

    Returns
    -------
    dict
        t (times,) [s], x (N,) [m], velocity (times, N) [m/s], density (times, N) [kg/m³].

    Raises
    ------
    ValueError
        No exact solution of the scene is known.
    Breakdown
        The line folds over itself: the Jacobian ρ0/ρ is not positive somewhere, at any x and time
        up to T, between particles and outputs too (see `_first_fold`).
    """
    solution = {"dalembert": _travelling_waves, "fourier": _modes, "two_layer": _scattered_waves}
    found = kind(scene)
    if found is None:
        raise ValueError(
            f"scene {scene.name}: no exact solution is known; one needs uniform density, modulus "
            "and damping, or two layers without damping and with a uniform force at most, and none "
            "of modulus and damping may change with time"
        )
    return _evaluate(scene, solution[found], _first_fold(scene, found), "the exact solution")


def solve_modified(scene: Scene) -> dict[str, np.ndarray]:
    """Exact solution of the equations that SPH is consistent with (appendix C.2).

    The SPH derivative tends to β ∂/∂x (appendix B), so that SPH tends to waves of speed β √(c/ρ0)
    with ∂e/∂t = β ∂v/∂x.

    Parameters and returns are those of `solve`.

    Raises
    ------
    ValueError
        The scene is not of the kind ``dalembert``.
    Breakdown
        The line folds over itself.
    """
    if kind(scene) != "dalembert":
        raise ValueError(
            f"scene {scene.name}: the modified reference needs uniform density and modulus, "
            "no damping and a uniform force at most"
        )
    beta = derivative_coefficient(scene.smoothing_ratio)
    return _evaluate(
        scene,
        lambda scene, blocks: _travelling_waves(scene, blocks, beta),
        _fold_of_waves(scene, beta),
        "the modified reference",
    )


def _evaluate(scene, solution, fold, name):
    """Fill velocity and density, and add the velocity of a uniform force.

    ``solution(scene, blocks)`` yields velocity and strain, (times, N), for each block of times;
    ``fold`` is the time and place at which the line first folds, or None.
    """
    times, x, density0 = scene.error_times, scene.positions, scene.density0()
    if fold is not None:
        at, place = fold
        beside = np.abs(x - place)
        particle = np.minimum(beside, scene.domain_length - beside).argmin()
        raise Breakdown(scene.name, name, at, scene.bar_particle(int(particle)))
    velocity = np.empty((times.size, x.size))
    density = np.empty_like(velocity)
    rows = max(1, min(256, BLOCK // x.size))
    blocks = [slice(first, first + rows) for first in range(0, times.size, rows)]
    rigid = _rigid_velocity(scene)
    for block, (block_velocity, strain) in zip(blocks, solution(scene, blocks), strict=True):
        if rigid is not None:
            block_velocity = block_velocity + rigid[block, None]
        broken = _broken(block_velocity, strain)
        if broken.any():
            row, particle = np.argwhere(broken)[0]
            raise Breakdown(scene.name, name, times[block][row], scene.bar_particle(particle))
        velocity[block] = block_velocity
        density[block] = density0 / (1 + strain)
    return {"t": times, "x": x, "velocity": velocity, "density": density}


def _broken(velocity, strain):
    return ~(np.isfinite(velocity) & (strain > -1) & (strain < np.inf))


# --- What kind of scene it is ---------------------------------------------------------------------


def _fine_grid(scene):
    """Midpoints of fine cells: a single point with a value of its own has no weight there."""
    count = max(8192, 4 * scene.particle_count)
    return (np.arange(count) + 0.5) * (scene.domain_length / count)


def _bulk(scene, profile):
    """Value of a profile that is uniform, or uniform but for single points."""
    return float(profile(x=_fine_grid(scene)[:1])[0])


def _uniform(values):
    return bool(np.ptp(values) <= 1e-12 * np.max(np.abs(values)))


def _several(values):
    """Whether there are more than two values: neither uniform material nor two layers."""
    steps = np.diff(np.sort(values))
    return np.count_nonzero(steps > 1e-12 * np.max(np.abs(values))) > 1


def _force_profiles(scene, x):
    """Profiles of the force's terms at places, (terms, places)."""
    return scene.force_values(np.zeros(1), x)[1]


def _evenly_forced(scene):
    """Whether the force is alike at all places; one that names x is not, without a look at it."""
    if any(isinstance(term, Expression) for term in scene.forces):
        return False
    return all(_uniform(profile) for profile in _force_profiles(scene, _fine_grid(scene)))


def _jumps(density, modulus):
    """Samples just before the two places where the material jumps; None if it is not two layers."""
    material = np.stack([density, modulus])
    change = np.abs(np.roll(material, -1, axis=1) - material) > 1e-12 * material
    jumps = np.flatnonzero(change.any(axis=0))
    if jumps.size != 2:
        return None
    layers = np.roll(material, -jumps[0] - 1, axis=1)
    first = jumps[1] - jumps[0]
    for layer in (layers[:, :first], layers[:, first:]):
        if not all(_uniform(values) for values in layer):
            return None
    return jumps


# --- Uniform material: travelling waves ---------------------------------------------------------


def _wave_speed(scene):
    """Speed s = √(c/ρ0) of waves in uniform material [m/s]."""
    # The quotient of the roots is a number where that of extreme c and ρ0 is none.
    return np.sqrt(_bulk(scene, scene.youngs_modulus)) / np.sqrt(
        _bulk(scene, scene.initial_density)
    )


def _uniform_damping(scene):
    """Damping coefficient d [1/s], zero if there is none."""
    return 0.0 if scene.damping is None else _bulk(scene, scene.damping)


def _travelling_waves(scene, blocks, beta=1.0):
    """d'Alembert: v = [v0(x - st) + v0(x + st)]/2, e = [v0(x + st) - v0(x - st)]/2s.

    With β the waves travel at βs while the strain keeps its 1/2s. It is β t times the mean slope of
    v0 over 2βst; where this is so short that only rounding would be left of the difference, the
    mean slope over 2 `SHORTEST` spacings is taken, from which it differs as little.
    """
    speed = _wave_speed(scene)
    shifted = _shifted_profile(scene)
    shortest = SHORTEST * scene.spacing
    around = np.array([shortest])
    slope = (shifted(around) - shifted(-around)) / (2 * shortest)
    for block in blocks:
        times = scene.error_times[block]
        distance = beta * speed * times
        ahead, behind = shifted(distance), shifted(-distance)
        short = (distance < shortest)[:, None]
        with np.errstate(over="ignore"):
            strain = np.where(short, beta * times[:, None] * slope, (ahead - behind) / (2 * speed))
        yield (behind + ahead) / 2, strain


def _shifted_profile(scene):
    """Make a function of shifts (times,) that gives v0 at all x_i + shift, (times, N).

    One shift moves each of evenly spaced particles into its own cell of width Δx at the same place
    of the cell.
    """
    if not scene.is_even:
        x, length = scene.positions, scene.domain_length
        return lambda shift: scene.initial_velocity(x=(x + shift[:, None]) % length)
    count, width = scene.particle_count, scene.spacing
    profile = _cellwise(lambda x: scene.initial_velocity(x=x), width, count, order=16)

    def shifted(shift):
        cells, offset = np.divmod(shift, width)
        twice = np.tile(profile(offset), 2)
        return sliding_window_view(twice, count, axis=1)[
            np.arange(shift.size), cells.astype(np.int64) % count
        ]

    return shifted


def _cellwise(function, width, count, order):
    """Tabulate a function on adjoining cells for evaluation at one offset in all of them.

    In each cell the function is a Chebyshev polynomial, checked against the function between its
    nodes and next to the ends of the cell. Where it is not the function to 1e-12 of the largest
    value (a kink or jump in the cell, or too fast a change) the function itself is used.

    Returns
    -------
    callable
        ``evaluate(offset)`` gives function(n width + offset) for n = 0 … count - 1, from offsets of
        shape (k,) in [0, width) to shape (k, count).
    """
    starts = np.arange(count) * width

    def basis(offset):
        return chebyshev.chebvander(2 * offset / width - 1, order - 1)

    nodes = width * (1 + np.cos(np.pi * (np.arange(order) + 0.5) / order)) / 2
    coefficients = 2 / order * basis(nodes).T @ function(starts + nodes[:, None])
    coefficients[0] /= 2
    tests = width * np.concatenate([[0, 1e-9], np.linspace(0.03, 0.96, order // 2), [1 - 1e-9]])
    expected = function(starts + tests[:, None])
    misfit = np.abs(basis(tests) @ coefficients - expected).max(axis=0)
    rough = np.flatnonzero(~(misfit <= 1e-12 * np.abs(expected).max()))

    def evaluate(offset):
        values = basis(offset) @ coefficients
        if rough.size:
            values[:, rough] = function(starts[rough] + offset[:, None])
        return values

    return evaluate


# --- Uniform material with damping or an uneven force: Fourier modes ------------------------------


def _oscillator(t, omega, damping):
    """Response of modes to a unit initial velocity: x' and x of x'' + d x' + ω² x = 0.

    Parameters
    ----------
    t : array, shape (times,)
    omega : ascending array, shape (modes,)
    damping : float

    Returns
    -------
    velocity, displacement : arrays, shape (times, modes)
    """
    t = t[:, None]
    half = damping / 2
    root = np.sqrt(np.abs(half**2 - omega**2))
    over = np.searchsorted(omega, half)
    cosine, sine = np.empty((2, t.size, omega.size))
    # Over-damped: e^(-γt) cosh and e^(-γt) sinh by the slow rate, which does not cancel.
    slow = omega[:over] ** 2 / (half + root[:over])
    decay = np.exp(-slow * t)
    fall = np.expm1(-2 * root[:over] * t)
    cosine[:, :over] = decay * (1 + fall / 2)
    sine[:, :over] = -decay * fall / (2 * root[:over])
    # Under-damped, and critical in the limit of no frequency.
    decay = np.exp(-half * t)
    phase = root[over:] * t
    cosine[:, over:] = decay * np.cos(phase)
    with np.errstate(invalid="ignore"):
        sine[:, over:] = decay * np.where(phase == 0, t, np.sin(phase) / root[over:])
    return cosine - half * sine, sine


def _later(state, step, omega, damping):
    """State of oscillators a step later: velocity and displacement of one run after the other."""
    velocity, displacement = state
    step_velocity, step_displacement = step
    return (
        step_velocity * velocity - omega**2 * step_displacement * displacement,
        step_displacement * velocity + (step_velocity + damping * step_displacement) * displacement,
    )


def _modes(scene, blocks):
    """Damped Fourier modes: decaying travelling waves, the smoother rest, and the uneven force.

    Mode l with wave number k and ω = k √(c/ρ0) starts from the amplitude v_l of v0 and is
    v = v_l x', e = ik v_l x with the oscillator x of `_oscillator`. With its first approximation
    for fast modes, e^(-dt/2) times the undamped oscillator, the modes sum up to e^(-dt/2) times
    d'Alembert's waves. The rest is smaller by (1 + dt/4) d/2ω and fades as e^(-dt/2), so few modes
    are left to be added at late times.
    """
    d = _uniform_damping(scene)
    count, times = scene.particle_count, scene.error_times
    forced = _forced_modes(scene, blocks, d) if not _evenly_forced(scene) else None
    amplitude, k, omega = _spectrum(scene, scene.initial_velocity)
    tail = _tail(amplitude * np.minimum(1, d / 2 / np.maximum(omega, omega[1])))
    creeping = np.searchsorted(omega, d / 2)
    # The first block's responses give those of any later block, composed with its start.
    needed = max(creeping, np.count_nonzero(tail > TRUNCATION)) if d else 0
    steps = [_oscillator(times[blocks[0]], omega[:needed], rate) for rate in (d, 0.0)]
    for block, (velocity, strain) in zip(blocks, _travelling_waves(scene, blocks), strict=True):
        fade = np.exp(-d / 2 * times[block])[:, None]
        velocity, strain = fade * velocity, fade * strain
        start = times[block][:1]
        present = tail * np.exp(-d / 2 * start) * (1 + d / 4 * start) > TRUNCATION
        modes = slice(min(needed, max(creeping, np.count_nonzero(present))))
        if modes.stop:
            damped, undamped = (
                _later(
                    _oscillator(start, omega[modes], rate),
                    [response[: velocity.shape[0], modes] for response in step],
                    omega[modes],
                    rate,
                )
                for step, rate in zip(steps, (d, 0.0), strict=True)
            )
            rest = [x - fade * y for x, y in zip(damped, undamped, strict=True)]
            velocity += _synthesis(rest[0] * amplitude[modes], count)
            strain += _synthesis(rest[1] * (1j * k * amplitude)[modes], count)
        if forced is not None:
            forced_velocity, forced_strain = next(forced)
            velocity += forced_velocity
            strain += forced_strain
        yield velocity, strain


def _spectrum(scene, profile):
    """Fourier modes of a profile.

    Returns
    -------
    amplitude, k, omega : arrays, shape (modes,)
        Complex amplitudes of exp(ikx) for k ≥ 0, wave numbers [1/m], angular frequencies [1/s].
    """
    samples = 32 * MODE_LIMIT
    x = np.arange(samples) * (scene.domain_length / samples)
    amplitude = np.fft.rfft(profile(x=x))[: MODE_LIMIT + 1] / samples
    k = 2 * np.pi / scene.domain_length * np.arange(MODE_LIMIT + 1)
    return amplitude, k, _wave_speed(scene) * k


def _tail(amplitude):
    """L2 norm of each mode and those above it, relative to that of all waves (the mean is none)."""
    squares = np.cumsum(np.abs(amplitude[::-1]) ** 2)[::-1]
    rounding = 1e-24 * squares[0] + np.finfo(float).tiny
    return np.sqrt(squares / max(squares[1], rounding))


def _synthesis(amplitude, count):
    """Real field at ``count`` even points from modes k ≥ 0, (times, modes) to (times, count).

    Modes that the points cannot tell apart are added first.
    """
    times, modes = amplitude.shape
    folded = np.zeros((times, -(-modes // count) * count), dtype=complex)
    folded[:, :modes] = amplitude
    folded[:, 0] /= 2
    folded = folded.reshape(times, -1, count).sum(axis=1)
    return 2 * count * np.fft.ifft(folded, axis=1).real


# --- Folding --------------------------------------------------------------------------------------


def _first_fold(scene, found):
    """Time and place at which the line first folds, e ≤ -1, between outputs and particles too.

    Strain is the difference of two travelling signals. Of undamped waves they are known functions,
    and all pairs that meet by T are looked through, on a grid as fine as `_fine_grid`.

    With damping d and an uneven force f(t) F(x) the signals v ∓ se obey r' = -d (r + l)/2 + fF,
    l' alike, along their paths, so that the larger of |r| and |l| grows by |f| |F| at most; and
    velocities that are everywhere the same strain nothing. So

        |e| ≤ (max v0 - min v0 + (max F - min F) ∫|f| dt)/2s,

    below one of which nothing folds any more, from any time on. Until then the solution is looked
    at on `FOLD_POINTS` points of the line or more, at times between which waves pass from one to
    the next at most.

    Returns
    -------
    (time, x) or None
    """
    if found == "dalembert":
        return _fold_of_waves(scene)
    if found == "two_layer":
        return _fold_of_layers(scene)
    x, speed, impulse = _fine_grid(scene), _wave_speed(scene), np.zeros(1)
    if not _evenly_forced(scene):
        ranges = np.ptp(_force_profiles(scene, x), axis=1)
        impulse = sum(
            course.impulse(scene.error_times) * part
            for course, part in zip(scene.courses(), ranges, strict=True)
        )

    def is_calm(signals, time):
        given = np.interp(time, np.arange(impulse.size) * scene.error_interval, impulse)
        with np.errstate(over="ignore", invalid="ignore"):
            return np.ptp(signals) + impulse[-1] - given < 0.99 * 2 * speed

    if is_calm(scene.initial_velocity(x=x), 0.0):
        return None
    fine = _finer(scene)
    times = fine.error_times
    rows = max(1, BLOCK // fine.particle_count)
    blocks = [slice(first, first + rows) for first in range(0, times.size, rows)]
    for block, (velocity, strain) in zip(blocks, _modes(fine, blocks), strict=True):
        broken = _broken(velocity, strain)
        if broken.any():
            row, point = np.argwhere(broken)[0]
            return times[block][row], fine.positions[point]
        signals = [velocity[-1] + speed * strain[-1], velocity[-1] - speed * strain[-1]]
        if is_calm(signals, times[block][-1]):
            return None
    return None


def _finer(scene):
    """The scene with points and outputs between its own, at which folding is looked for."""
    points = -(-FOLD_POINTS // scene.particle_count) * scene.particle_count
    longest = min(scene.domain_length / points / _wave_speed(scene), scene.duration / FOLD_POINTS)
    interval = scene.error_interval / np.ceil(scene.error_interval / longest)
    return replace(scene, particle_count=points, time_step=interval, error_interval=interval)


def _fold_of_waves(scene, beta=1.0):
    """First fold of d'Alembert's waves: of v0 at two places, as far apart as waves go in 2t.

    Between the points of the grid v0 is taken to be linear. Where it jumps down by 2s or more, the
    line folds at once.
    """
    x = _fine_grid(scene)
    v0, spacing, speed = scene.initial_velocity(x=x), x[1] - x[0], _wave_speed(scene)
    with np.errstate(over="ignore"):
        if not np.isfinite(v0).all() or np.ptp(v0) < 0.99 * 2 * speed:
            return None
    largest = np.abs(v0).max()
    found = jumps(
        lambda x: scene.initial_velocity(x=x) / largest,
        scene.domain_length,
        x.size,
        max(2 * speed / largest, 1e-9),
    )
    for place, jump in found:
        if jump < 0:
            return 0.0, place
    lowest = _range_minima(np.tile(v0, 2))
    here = np.arange(x.size)

    def deepest(time):
        """Least strain up to a time, and where it is."""
        reach = 2 * beta * speed * time / spacing
        whole = int(min(reach, x.size))
        part = min(reach, x.size) - whole
        far, next_far = v0[(here + whole) % x.size], v0[(here + whole + 1) % x.size]
        near = v0[(here + 1) % x.size]
        # Pairs of points, and points with the places that waves have just reached.
        differences = np.stack(
            [
                lowest(here, here + whole) - v0,
                part * (next_far - far) + (far - v0),
                (next_far - near) + part * (near - v0),
            ]
        )
        least = divmod(int(differences.argmin()), x.size)
        with np.errstate(over="ignore"):
            return differences[least] / (2 * speed), x[least[1]] + beta * speed * time

    return _bisect_fold(deepest, scene)


def _fold_of_layers(scene):
    """First fold between two layers: of the two signals of a layer that meet in it.

    With those that arrive at its ends at the times p and q, e = Z (l(q) - r(p))/2c at the time
    (p + q - τ)/2; both are looked up as finely as waves pass the points of `_fine_grid`.
    """
    left, width, speed, impedance, modulus = _layers(scene)
    arriving = _arriving_signals(scene, left, width, speed, impedance)
    grid = _fine_grid(scene).size
    folds = []
    for j in (0, 1):
        crossing = width[j] / speed[j]
        count = int(np.ceil(grid * (scene.duration + crossing) * speed[j] / scene.domain_length))
        step = (scene.duration + crossing) / count
        times = (np.arange(count) + 0.5) * step
        right, leftward = (arriving(times, layer=j, sense=sense) for sense in (0, 1))
        factor = impedance[j] / (2 * modulus[j])
        if (leftward.min() - right.max()) * factor > -0.99:
            continue
        lowest = _range_minima(leftward)

        def deepest(time, j=j, times=times, step=step, right=right, lowest=lowest, factor=factor):
            crossing = width[j] / speed[j]
            low = np.maximum(times - crossing, crossing - times)
            high = np.minimum(times + crossing, 2 * time + crossing - times)
            first = np.clip(np.ceil(low / step - 0.5), 0, times.size - 1).astype(int)
            last = np.minimum(np.floor(high / step - 0.5), times.size - 1).astype(int)
            met = np.flatnonzero(last >= first)
            if not met.size:
                return 0.0, left[j]
            strains = factor * (lowest(first[met], last[met]) - right[met])
            least = int(strains.argmin())
            # The right-going signal has (p - t) speed still to go to the layer's end.
            to_go = np.clip((times[met[least]] - time) * speed[j], 0, width[j])
            return strains[least], left[j] + width[j] - to_go

        folds.append(_bisect_fold(deepest, scene))
    return min((fold for fold in folds if fold is not None), default=None)


def _bisect_fold(deepest, scene):
    """First time at which the least strain so far is -1, and its place; None if it is not by T."""
    low, high = 0.0, scene.duration
    strain, place = deepest(high)
    if not strain <= -1:
        return None
    for _ in range(50):
        middle = (low + high) / 2
        strain, where = deepest(middle)
        low, high, place = (low, middle, where) if strain <= -1 else (middle, high, place)
    return high, float(place % scene.domain_length)


def _range_minima(values):
    """Make a function of first and last indices that gives the least value of each range."""
    tables = [values]
    while 2 ** len(tables) <= values.size:
        half = 2 ** (len(tables) - 1)
        tables.append(np.minimum(tables[-1][:-half], tables[-1][half:]))

    def lowest(first, last):
        levels = np.log2(np.maximum(last - first + 1, 1)).astype(int)
        result = np.empty(len(first))
        for level in np.unique(levels):
            of = levels == level
            table = tables[level]
            result[of] = np.minimum(table[first[of]], table[last[of] + 1 - 2**level])
        return result

    return lowest


# --- Forces -------------------------------------------------------------------------------------


def _rigid_velocity(scene):
    """Velocity that a uniform force gives the whole line, (times,); None if there is none."""
    if not scene.forces or not _evenly_forced(scene):
        return None
    factors = _force_profiles(scene, _fine_grid(scene)[:1])
    block, force = np.zeros((1, 2, 2)), np.zeros((len(factors), 1, 2))
    force[:, 0, :1] = factors
    block[0, 0, 0] = -_uniform_damping(scene)
    velocity = np.zeros((1, scene.error_times.size))
    propagator.prepare(
        block, 1, force, scene.error_interval, scene.error_times.size, scene.courses()
    ).run(velocity)
    return velocity[0]


def _forced_modes(scene, blocks, damping):
    """Velocity and strain that an uneven force gives, mode by mode.

    The oscillator x of a mode is carried as the pair x' and ω x.
    """
    count, outputs = scene.particle_count, scene.error_times.size
    fields = np.zeros((2, outputs, count), complex)
    for term, course in enumerate(scene.courses()):
        amplitude, _, omega = _spectrum(scene, lambda x, r=term: _force_profiles(scene, x)[r])
        tail = _tail(amplitude / np.maximum(omega, omega[1]))
        needed = max(1, int(np.count_nonzero(tail > TRUNCATION)))
        amplitude[0] /= 2
        size = min(count, MODES_AT_ONCE)
        for first in range(0, needed, size):
            modes = np.arange(first, min(first + size, needed))
            pairs, force = np.zeros((modes.size, 2, 2)), np.zeros((1, modes.size, 2))
            pairs[:, 0, 0], pairs[:, 0, 1], pairs[:, 1, 0] = -damping, -omega[modes], omega[modes]
            force[..., 0] = 1
            state = np.zeros((2 * modes.size, outputs))
            propagator.prepare(pairs, 0, force, scene.error_interval, outputs, (course,)).run(state)
            # Modes that the points cannot tell apart are added.
            velocity, displacement = state[: modes.size].T, state[modes.size :].T
            fields[0][:, modes % count] += velocity * amplitude[modes]
            fields[1][:, modes % count] += displacement * (
                1j / _wave_speed(scene) * amplitude[modes]
            )
    for block in blocks:
        velocity, strain = 2 * count * np.fft.ifft(fields[:, block], axis=2).real
        yield velocity, strain


# --- Two layers -----------------------------------------------------------------------------------


def _interface(scene, before, after):
    """Place between two points, one in each layer, where the material jumps (bisection)."""

    def material(x):
        point = np.array([x % scene.domain_length])
        return scene.initial_density(x=point)[0], scene.youngs_modulus(x=point)[0]

    layer = material(before)
    while before < (middle := (before + after) / 2) < after:
        if np.allclose(material(middle), layer, rtol=1e-12, atol=0):
            before = middle
        else:
            after = middle
    return before


def _layers(scene):
    """Left end, width [m], wave speed [m/s], impedance and modulus of each layer, (2,) each."""
    x = _fine_grid(scene)
    jumps = _jumps(scene.initial_density(x=x), scene.youngs_modulus(x=x))
    left = np.array([_interface(scene, x[jump], x[jump] + x[1] - x[0]) for jump in jumps])
    width = np.diff(left, append=left[0] + scene.domain_length)
    centre = (left + width / 2) % scene.domain_length
    modulus, density = scene.youngs_modulus(x=centre), scene.initial_density(x=centre)
    speed, impedance = np.sqrt(modulus / density), np.sqrt(modulus * density)
    return left, width, speed, impedance, modulus


def _scattered_waves(scene, blocks):
    """Waves between two layers: each path from a particle back to t = 0 carries a piece of v0.

    In layer j with speed s = √(c/ρ0) and impedance Z = √(c ρ0) the signals v - ce/Z and v + ce/Z
    travel right and left, both from v0. Wherever a signal is read, it is the one that reaches the
    layer's far end a delay later; so four functions of time give the whole solution. A particle on
    an interface fills half a cell of either layer, so its strain is the mean of the two.
    """
    left, width, speed, impedance, modulus = _layers(scene)
    arriving = _arriving_signals(scene, left, width, speed, impedance)

    times, interval = scene.error_times, scene.error_interval
    velocity, strain = np.empty((2, times.size, scene.particle_count))
    place = (scene.positions - left[:, None]) % scene.domain_length
    near = 1e-9 * scene.spacing
    place[place > scene.domain_length - near] = 0
    # On an interface velocity and stress are the same from either layer, the strain is not.
    on_interface = (place < near).any(axis=0)
    for j in (0, 1):
        particles = np.flatnonzero((place[0] < width[0]) == (j == 0))
        if not particles.size:
            continue
        cells = times.size + int(width[j] / speed[j] / interval) + 1
        signals = [
            _cellwise(partial(arriving, layer=j, sense=sense), interval, cells, order=8)
            for sense in (0, 1)
        ]
        for first in range(0, particles.size, 32):
            group = particles[first : first + 32]
            delays = np.stack([width[j] - place[j, group], place[j, group]]) / speed[j]
            right, leftward = (
                _delayed(signal, delay, interval, times.size)
                for signal, delay in zip(signals, delays, strict=True)
            )
            velocity[:, group] = (right + leftward).T / 2
            compliance = np.where(on_interface[group], np.mean(1 / modulus), 1 / modulus[j])
            strain[:, group] = impedance[j] / 2 * compliance * (leftward - right).T
    for block in blocks:
        yield velocity[block], strain[block]


def _delayed(signal, delay, interval, count):
    """A cellwise signal at ``count`` times n interval + delay, from (k,) delays to (k, count)."""
    cells, offset = np.divmod(delay, interval)
    return sliding_window_view(signal(offset), count, axis=1)[
        np.arange(delay.size), cells.astype(np.int64)
    ]


def _arriving_signals(scene, left, width, speed, impedance):
    """Make a function of time t, layer j and sense (0 rightward, 1 leftward).

    It gives the signal that arrives at the end of layer j at time t: the sum over all paths to v0.
    At an interface the share 1 + g of a signal passes from layer 0 to 1 and -g is thrown back; from
    layer 1 to 0 they are 1 - g and g, with g = (Z0 - Z1)/(Z0 + Z1). All paths that cross the layers
    n0 and n1 times take n0 τ0 + n1 τ1, so their shares add up to one number; and as many interfaces
    were met, of which an even number was passed if the path ends in the layer where it starts. So
    their senses agree too.
    """
    crossing = width / speed
    counts = [int((scene.duration + crossing.max()) / tau) + 2 for tau in crossing]
    shares = _path_shares((impedance[0] - impedance[1]) / impedance.sum(), *counts)
    arrival = np.add.outer(*(tau * np.arange(n) for tau, n in zip(crossing, counts, strict=True)))

    def arriving(t, layer, sense):
        total = np.zeros_like(t)
        for m in (0, 1):
            # Paths that start in layer m and cross the other one a given number of times.
            for other in range(counts[1 - m]):
                share, since = (
                    (shares[layer, 0, :, other], arrival[:, other])
                    if m == 0
                    else (shares[layer, 1, other], arrival[other])
                )
                felt = np.flatnonzero(np.abs(share) > 1e-17)
                if not felt.size:
                    continue
                until = since[felt[-1] + 1] if felt[-1] + 1 < since.size else np.inf
                during = (t >= since[felt[0]]) & (t < until)
                crossings = np.searchsorted(since, t[during], side="right") - 1
                travelled = speed[m] * (t[during] - since[crossings])
                leftward = (sense + other + crossings + (layer != m)) % 2
                start = np.where(leftward, travelled, width[m] - travelled) + left[m]
                start -= scene.domain_length * (start >= scene.domain_length)
                total[during] += share[crossings] * scene.initial_velocity(x=start)
        return total

    return arriving


def _path_shares(g, count0, count1):
    """Shares of the paths that cross the layers n0 and n1 times, from layer m to layer j.

    Returns
    -------
    array, shape (2, 2, count0, count1)
        Share [j, m, n0, n1].
    """
    shares = np.zeros((2, 2, count0, count1))
    shares[:, :, 0, 0] = np.eye(2)
    for n0 in range(count0):
        for n1 in range(count1):
            if n0:
                one, two = shares[:, :, n0 - 1, n1]
                shares[0, :, n0, n1] += g * one + (1 - g) * two
            if n1:
                one, two = shares[:, :, n0, n1 - 1]
                shares[1, :, n0, n1] += (1 + g) * one - g * two
    return shares
