"""What of a scene cannot be simulated, refused before any work starts."""

import numpy as np

from sphpod.numerics.enclosure import enclose
from sphpod.scene.kernel import neighbour_count
from sphpod.scene.scene import Scene, is_whole
from sphpod.scene.waves import GROWTH_LIMIT, growth_factor, largest_time_step

MOVING = (1e-140, 1e140)
"""Sizes in SI units of what moves a scene, so that sums of squares neither overflow nor vanish."""


def check(scene: Scene) -> None:
    """Refuse a scene that cannot be simulated by explicit Euler, before any work starts.

    Raises
    ------
    ValueError
        One sentence that names the scene, the key, its value and what is allowed.
    """
    check_setting(scene)
    check_step(scene)


def check_step(scene: Scene) -> None:
    """Refuse a time step with which explicit Euler lets waves grow too much; raises as `check`."""
    growth = growth_factor(scene)
    if not growth <= GROWTH_LIMIT:
        factor = f"up to {growth:.3g}" if np.isfinite(growth) else "1e308 or more"
        step = 0.995 * largest_time_step(scene, GROWTH_LIMIT)  # not rounded beyond it
        raise ValueError(
            f"scene {scene.name}: time_step = {scene.time_step:g}: "
            f"explicit Euler would let waves grow by {factor} over the duration; "
            f"at most {GROWTH_LIMIT:g} is allowed, which a time step of {step:.3g} or less keeps"
        )


def check_setting(scene: Scene) -> None:
    """Refuse a scene that no integrator can simulate; raises as `check`."""

    def refuse(key, value, allowed):
        raise ValueError(f"scene {scene.name}: {key} = {value}: {allowed}")

    for key in ("domain_length", "duration", "time_step", "error_interval", "smoothing_ratio"):
        value = getattr(scene, key)
        if not (np.isfinite(value) and value > 0):
            refuse(key, f"{value:g}", "it must be a positive number")
    count = scene.particle_count
    if count < 5:
        refuse("particle_count", count, "at least 5 particles are needed")
    for key, value in (("duration", scene.duration), ("error_interval", scene.error_interval)):
        if not is_whole(value, scene.time_step):
            refuse(
                key, f"{value:g}", f"it must be a whole number of time steps of {scene.time_step:g}"
            )
    if scene.step_count % scene.error_stride:
        refuse(
            "error_interval",
            f"{scene.error_interval:g}",
            f"the duration {scene.duration:g} must be a whole number of error intervals",
        )
    if neighbour_count(scene.smoothing_ratio) < 1:
        refuse(
            "smoothing_ratio",
            f"{scene.smoothing_ratio:g}",
            "it must be above 0.5, or a particle has no neighbour within 2h",
        )
    if 2 * neighbour_count(scene.smoothing_ratio) + 1 > count:
        refuse(
            "smoothing_ratio",
            f"{scene.smoothing_ratio:g}",
            f"the kernel's support of 4h wraps round the domain of {count} particles; "
            f"at most {((count - 1) // 2 + 1) / 2:g} is possible",
        )
    if not 0 <= scene.jitter < 0.5:
        refuse("positions.jitter", f"{scene.jitter:g}", "it must be from 0 to below 0.5 spacings")
    if not scene.is_even and 4 * scene.smoothing_ratio > count:
        refuse(
            "smoothing_ratio",
            f"{scene.smoothing_ratio:g}",
            f"of jittered particles the kernel's support of 4h must fit into the domain; "
            f"at most {count / 4:g} is possible",
        )
    fine = np.arange(8 * count) * (scene.spacing / 8)
    velocity = scene.initial_velocity(x=fine)
    _check_values(scene, "initial_velocity", velocity, fine, refuse)
    _check_moving("initial_velocity", scene.initial_velocity.text, velocity, refuse)
    for key in ("initial_density", "youngs_modulus"):
        values = getattr(scene, key)(x=fine)
        _check_values(scene, key, values, fine, refuse)
        if values.min() <= 0:
            worst = int(values.argmin())
            refuse(
                key,
                getattr(scene, key).text,
                f"it is {values[worst]:g} at x = {fine[worst]:g} and must be positive everywhere",
            )
    if scene.damping is not None:
        values = scene.damping(x=fine)
        _check_values(scene, "damping", values, fine, refuse)
        if values.min() < 0:
            worst = int(values.argmin())
            refuse(
                "damping",
                scene.damping.text,
                f"it is {values[worst]:g} at x = {fine[worst]:g} and must not be negative",
            )
    if scene.force_time is not None:
        times = scene.error_times
        force = scene.force_time(t=times)
        _check_values(scene, "force", force, times, refuse, "t")
        _check_moving("force", scene.force_time.text, force, refuse)
        if not _is_bounded(scene.force_time, scene.duration):
            for course in scene.courses():
                if not np.isnan(course.singular):
                    _check_values(scene, "force", [np.nan], [course.singular], refuse, "t")
        if scene.force_profile is not None:
            profile = scene.force_profile(x=fine)
            _check_values(scene, "force.profile", profile, fine, refuse)
            _check_moving("force.profile", scene.force_profile.text, profile, refuse)


def _check_moving(key, text, values, refuse):
    largest = np.abs(values).max()
    low, high = MOVING
    if largest and not low <= largest <= high:
        refuse(
            key,
            text,
            f"its largest size is {largest:g}, which must be 0 or from {low:g} to {high:g}, or its "
            "square is beyond double precision",
        )


def _is_bounded(force, duration):
    """Whether bounds on few intervals show that a force is finite, without following its course."""
    edges = np.linspace(0, duration, 17)
    bounds = enclose(force, edges[:-1], edges[1:])
    return bool(np.isfinite([bounds.low, bounds.high]).all())


def _check_values(scene, key, values, points, refuse, variable="x"):
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        refuse(
            key,
            getattr(
                scene, {"force": "force_time", "force.profile": "force_profile"}.get(key, key)
            ).text,
            f"it is not finite at {variable} = {points[bad[0]]:g}",
        )
