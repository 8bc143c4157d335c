"""What of a scene the particles cannot resolve, reported before a run.

Waves of two spacings or less look to the particles like longer ones: harmonic l of N particles
like harmonic N - l, and harmonic N/2 like nothing or like a sawtooth that no stencil sees. How much
of the energy of the initial velocity and of the force is in such waves shows a Fourier transform on
a grid far finer than the particles.

A kink costs little: beyond harmonic l it has a part of about 1/l³ of the energy. A jump has 1/l, no
number of particles resolves it, and errors fall as N^(-1/3) only; so jumps are reported for
themselves. Layers of material are meant to jump, and particles see each of them; material is
reported only where most of its variation escapes them.
"""

import logging
from collections.abc import Callable

import numpy as np

from sphpod.numerics.course import Course
from sphpod.scene.scene import Scene, force_keys

logger = logging.getLogger(__name__)

FINE = 2**15
"""Least number of points of the fine grid."""

PER_SPACING = 4
"""Least number of points of the fine grid in a spacing."""

REPORTED_ENERGY = 1e-4
"""Unresolved part of an energy that is reported: a hundredth in the waves' amplitude.

Explicit Euler's growth is reported from a hundredth on as well. Profiles that have kinks are far
below it with fifty particles (1e-6), those that particles alias far above.
"""

REPORTED_JUMP = 1e-2
"""Jump of the initial velocity that is reported, of the largest velocity."""

REPORTED_MATERIAL = 0.5
"""Unresolved part of the energy of material's variation that is reported."""

MOST_PARTICLES = 100_000
"""Number of particles above which none is recommended."""

REPORTED_IMPULSE = 0.05
"""Impulse of a force that its time steps miss and that is reported, of that of its magnitude."""

Profile = Callable[[np.ndarray], np.ndarray]


def jumps(profile: Profile, length: float, points: int, least: float) -> list[tuple[float, float]]:
    """Where a periodic function jumps.

    Of two neighbouring points that differ by more than ``least`` the half that differs more is
    taken, again and again: a continuous function soon differs by less.

    Parameters
    ----------
    profile : callable
        Function of x [m].
    length : float
        Its period [m].
    points : int
        Points of the grid on which jumps are looked for.
    least : float
        Size of the smallest jump that is found.

    Returns
    -------
    list of (x, jump)
        Places in [0, length) and what the function rises by there, in the order of the places.
    """
    spacing = length / points
    low = _grid(length, points)
    at_low = profile(low)
    at_high = np.roll(at_low, -1)
    steep = np.flatnonzero(np.abs(at_high - at_low) > least)
    low, at_low, at_high = low[steep], at_low[steep], at_high[steep]
    while low.size and spacing > 1e-13 * length:
        spacing /= 2
        middle = low + spacing
        at_middle = profile(middle % length)
        right = np.abs(at_high - at_middle) > np.abs(at_middle - at_low)
        low = np.where(right, middle, low)
        at_low, at_high = np.where(right, at_middle, at_low), np.where(right, at_high, at_middle)
        steep = np.flatnonzero(np.abs(at_high - at_low) > least)
        low, at_low, at_high = low[steep], at_low[steep], at_high[steep]
    places = length * np.round((low + spacing) / length, 12) % length
    order = np.argsort(places)
    return list(zip(places[order].tolist(), (at_high - at_low)[order].tolist(), strict=True))


def unresolved(
    profile: Profile, length: float, count: int, smoothed: int = 0, allowed: float = REPORTED_ENERGY
) -> tuple[float, int]:
    """Part of a profile's energy, without its mean, in waves that evenly spaced points miss.

    Parameters
    ----------
    profile : callable
        Function of x [m], periodic.
    length : float
        Its period [m].
    count : int
        Number of the points; they carry the harmonics below half of it.
    smoothed : int
        How often the profile is integrated before it moves anything: 0 for the initial velocity, 1
        for a force.
    allowed : float
        Part that may be missed.

    Returns
    -------
    part : float
        From 0 to 1; 0 of a profile that does not vary.
    enough : int
        Least number of points that miss at most what is allowed, as far as the fine grid shows.
    """
    points = _fine_points(count)
    values = profile(_grid(length, points))
    scale = np.abs(values).max()
    if not 0 < scale < np.inf:
        return 0.0, count
    spectrum = np.abs(np.fft.rfft(values / scale)) / points
    # What rounding has put into harmonics is none of the profile.
    energy = np.where(spectrum > 1e-14, spectrum, 0.0)[1:] ** 2
    energy /= np.arange(1, energy.size + 1.0) ** (2 * smoothed)
    beyond = np.append(np.cumsum(energy[::-1])[::-1], 0.0)  # [l - 1] of harmonics l and above
    if not beyond[0] > 0:
        return 0.0, count
    beyond /= beyond[0]
    missed = float(beyond[(count - 1) // 2])
    return missed, count if missed <= allowed else 2 * int(np.argmax(beyond <= allowed)) + 1


def predict(scene: Scene) -> dict[str, float]:
    """What the particles do not resolve, to be stored beside a solution, and reported in the log.

    Returns
    -------
    dict
        unresolved_energy, the part of the energy of the waves of v0 that is in unresolved ones, and
        velocity_jump, the largest jump of v0 [m/s], 0 if none is above `REPORTED_JUMP`.
    """
    length, count = scene.domain_length, scene.particle_count
    points = _fine_points(count)
    largest = float(np.abs(scene.initial_velocity(x=_grid(length, points))).max())
    found = []
    if largest > 0:
        found = jumps(
            lambda x: scene.initial_velocity(x=x) / largest, length, points, REPORTED_JUMP
        )
    found = [(place, jump) for place, jump in found if place <= scene.bar_length]
    place, jump = max(found, key=lambda each: abs(each[1]), default=(0.0, 0.0))
    if found:
        part, _ = unresolved(lambda x: scene.initial_velocity(x=x), length, count)
        logger.warning(
            "scene %s: initial_velocity = %s: it jumps by %.3g m/s at x = %.6g m%s: no number of "
            "particles resolves that, and errors fall as N^(-1/3) only; of the energy of its waves "
            "%.2g %% are in waves of two spacings or less",
            scene.name, scene.initial_velocity.text, jump * largest, place,
            f" (the largest of {len(found)} jumps)" if len(found) > 1 else "", 100 * part,
        )  # fmt: skip
    else:
        part = _told(scene, "initial_velocity", scene.initial_velocity)
    for key, profile in _shapes_of_force(scene):
        _told(scene, key, profile, smoothed=1)
    _tell_of_pulses(scene)
    for key in ("initial_density", "youngs_modulus", "damping"):
        profile = getattr(scene, key)
        # What changes with time is looked at by the solutions that step it.
        if profile is not None and profile.variables == ("x",):
            values = profile(x=_grid(length, points))
            if np.ptp(values) > REPORTED_JUMP * np.abs(values).max():
                _told(scene, key, profile, allowed=REPORTED_MATERIAL)
    return {"unresolved_energy": part, "velocity_jump": jump * largest}


def _tell_of_pulses(scene):
    """Report in the log what explicit Euler, which looks at its steps alone, misses of a force."""
    for key, term in zip(force_keys(scene), scene.forces, strict=True):
        for factor in getattr(term, "factors", ()):
            course = Course.of(factor, scene.duration)
            done, edges = course.integrals, course.edges[1:]
            if not (np.isfinite(done).all() and course.total > 0):
                continue
            times = np.arange(scene.step_count) * scene.time_step
            taken = np.concatenate([[0.0], np.cumsum(factor(t=times))]) * scene.time_step
            missed = np.abs(done - taken[np.searchsorted(times, edges)]).max()
            if missed > REPORTED_IMPULSE * course.total:
                logger.warning(
                    "scene %s: %s = %s: explicit Euler, which looks at it every %g s, is wrong by "
                    "up to %.2g %% of its impulse",
                    scene.name, key, factor.text, scene.time_step, 100 * missed / course.total,
                )  # fmt: skip


def _shapes_of_force(scene):
    """Key and profile of each term of the force that has one in the configuration."""
    for key, term in zip(force_keys(scene), scene.forces, strict=True):
        shape = getattr(term, "shapes", [None])[0]
        if shape is not None:
            yield f"{key}.profile", shape


def _told(scene, key, expression, smoothed=0, allowed=REPORTED_ENERGY):
    """Unresolved part of a profile, reported in the log if it is more than what is allowed."""

    def missed_by(count):
        return unresolved(lambda x: expression(x=x), scene.domain_length, count, smoothed, allowed)

    part, enough = missed_by(scene.particle_count)
    if part <= allowed:
        return part
    # The fine grid may itself have taken short waves for others, which two more of them show.
    checked = 0
    while checked < enough < MOST_PARTICLES:
        checked = enough
        for count in (checked, checked * 4 // 3):
            missed, more = missed_by(count)
            enough = max(enough, more if missed > allowed else 0)
    if scene.ends:
        enough = -(-enough // scene.ends.copies) + 1
    advice = (
        f"at least {enough} particles are needed"
        if enough < MOST_PARTICLES
        else f"more than {MOST_PARTICLES} particles are needed"
    )
    logger.warning(
        "scene %s: %s = %s: of the energy of its waves %.3g %% are in waves of two spacings or "
        "less, which %d particles take for others: %s",
        scene.name, key, expression.text, 100 * part, scene.bar_count, advice,
    )  # fmt: skip
    return part


def _fine_points(count):
    """Points of the fine grid: odd, so that few harmonics of formulas fall on multiples of it."""
    least = max(FINE, PER_SPACING * count)
    return min(n for n in (3**a * 5**b for a in range(20) for b in range(12)) if n >= least)


def _grid(length, points):
    """Evenly spaced, with no point at a fraction of the length that formulas have in them."""
    return (np.arange(points) + np.sqrt(5) / 2 % 1) * (length / points)
