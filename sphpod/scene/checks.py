"""What of a scene cannot be simulated, refused before any work starts."""

import numpy as np

from sphpod.numerics.enclosure import bounds_in
from sphpod.numerics.expressions import Expression
from sphpod.numerics.separation import changes, check_places
from sphpod.scene.ends import VELOCITY
from sphpod.scene.kernel import derivative_coefficient, neighbour_count
from sphpod.scene.scene import EVALUATIONS, IN_X, Scene, force_keys, is_whole, profile_of
from sphpod.scene.values import check_values
from sphpod.scene.waves import (
    GROWTH_LIMIT,
    growth_factor,
    largest_time_step,
    loose_growth_factor,
)

MOVING = (1e-140, 1e140)
"""Sizes in SI units of what moves a scene, so that sums of squares neither overflow nor vanish."""

MEASURES = (1e-100, 1e100)
"""Sizes in SI units of lengths and times, so that no square or cube of them is lost."""

LEAST_DERIVATIVE = 0.01
"""Least derivative coefficient: below it particles hardly see each other."""

POINTS = 8, 400_000
"""Points that a profile is checked at, for each particle, but not more than so many in all."""

LOOKED_AT = 4096, 512
"""Places and times at which a function of both is checked, at most."""

VALUES = 5
"""Values of a function of place and time, or of time, that are as many as a point of a profile."""

BOXES = 16, 64
"""Parts of the domain and of the duration in which bounds of a function are looked at."""

MOST_PAIRS = {True: 100_000_000, False: 5_000_000}
"""Neighbours on one side of all particles together: evenly spaced ones, and others."""

AT_REST = 1e-9
"""Part of the largest velocity that one at a fixed end may be, as formulas round."""

MOST_TERMS = 25_000_000
"""Terms of the sums of a profile at all particles together, or of a force at all times."""

LOOKED_THROUGH = MOST_TERMS // 4
"""Values, times the terms of sums, of each of the profiles of a scene that are looked at."""

GROWTH_WORK = 2**27
"""Values, times the terms of sums, of which the growth of waves is found in a check."""

MOST_FOLLOWED = 100
"""Terms of the sums of a function of place and time, which is followed at several places."""


def check(scene: Scene, share: float = 1.0) -> None:
    """Refuse a scene that cannot be simulated by explicit Euler, before any work starts.

    Of many scenes each may take a ``share`` of the work of one: then it is looked at in fewer
    places and times, and growth is left to the run of a scene of which it would cost more.

    Raises
    ------
    ValueError
        One sentence that names the scene, the key, its value and what is allowed.
    """
    check_setting(scene, share)
    terms = sum(
        one.terms for one in (scene.initial_density, scene.youngs_modulus, scene.damping) if one
    )
    followed = 0 if scene.is_steady else EVALUATIONS
    if share == 1 or scene.particle_count * terms + followed <= GROWTH_WORK * share:
        check_step(scene)


def check_step(scene: Scene) -> None:
    """Refuse a time step with which explicit Euler lets waves grow too much; raises as `check`."""
    if not scene.is_steady:
        (_, stiffest), damping = (_bounds_of(scene, key) for key in ("youngs_modulus", "damping"))
        known = np.isfinite([stiffest, *damping]).all()
        if known and loose_growth_factor(scene, stiffest, damping) <= GROWTH_LIMIT:
            return
    growth = growth_factor(scene)
    if not growth <= GROWTH_LIMIT:
        factor = f"up to {growth:.3g}" if np.isfinite(growth) else "1e308 or more"
        step = 0.995 * largest_time_step(scene, GROWTH_LIMIT)  # not rounded beyond it
        raise ValueError(
            f"scene {scene.name}: time_step = {number(scene.time_step)}: "
            f"explicit Euler would let waves grow by {factor} over the duration; "
            f"at most {GROWTH_LIMIT:g} is allowed, which a time step of {step:.3g} or less keeps"
        )


def check_setting(scene: Scene, share: float = 1.0, followed: bool = True) -> None:
    """Refuse a scene that no integrator can simulate; raises as `check`.

    Unless they are ``followed``, functions of time are not looked at where they change.
    """

    def refuse(key, value, allowed):
        raise ValueError(f"scene {scene.name}: {key} = {value}: {allowed}")

    _check_times(scene, refuse)
    _check_particles(scene, refuse)
    _check_ends(scene, refuse)
    _check_work(scene, refuse)
    budget = share, followed
    _check_profiles(scene, budget, refuse)
    _check_force(scene, budget, refuse)


def _check_times(scene, refuse):
    """Refuse lengths and times that are not positive, or no whole numbers of each other."""
    for key in ("domain_length", "duration", "time_step", "error_interval"):
        value = getattr(scene, key)
        low, high = MEASURES
        if not low <= value <= high:
            refuse(key, number(value), f"it must be a positive number from {low:g} to {high:g}")
    for key, value in (("duration", scene.duration), ("error_interval", scene.error_interval)):
        if not is_whole(value, scene.time_step):
            refuse(
                key,
                number(value),
                f"it must be a whole number of time steps of {number(scene.time_step)}",
            )
    if scene.step_count % scene.error_stride:
        refuse(
            "error_interval",
            number(scene.error_interval),
            f"the duration {number(scene.duration)} must be a whole number of error intervals",
        )


def _check_particles(scene, refuse):
    """Refuse particles that see none, or too many, of each other."""
    count = scene.particle_count
    if count < 5:
        refuse("particle_count", count, "at least 5 particles are needed")
    if not scene.smoothing_ratio > 0:
        refuse("smoothing_ratio", number(scene.smoothing_ratio), "it must be a positive number")
    if neighbour_count(scene.smoothing_ratio) < 1:
        refuse(
            "smoothing_ratio",
            number(scene.smoothing_ratio),
            "it must be above 0.5, or a particle has no neighbour within 2h",
        )
    if 2 * neighbour_count(scene.smoothing_ratio) + 1 > count:
        refuse(
            "smoothing_ratio",
            number(scene.smoothing_ratio),
            f"the kernel's support of 4h wraps round the domain of {count} particles; "
            f"at most {((count - 1) // 2 + 1) / 2:g} is possible",
        )
    neighbours, most = neighbour_count(scene.smoothing_ratio), MOST_PAIRS[scene.is_even] // count
    if neighbours > most:
        refuse(
            "smoothing_ratio",
            number(scene.smoothing_ratio),
            f"each of {count} particles would have {neighbours} neighbours on each side; at most "
            f"{most} are allowed",
        )
    coefficient = derivative_coefficient(scene.smoothing_ratio)
    if coefficient < LEAST_DERIVATIVE:
        refuse(
            "smoothing_ratio",
            number(scene.smoothing_ratio),
            f"particles would hardly see each other, as the SPH derivative is {coefficient:.2g} of "
            "the true one; from 0.52 on it is large enough",
        )
    if not 0 <= scene.jitter < 0.5:
        refuse("positions.jitter", number(scene.jitter), "it must be from 0 to below 0.5 spacings")
    if not scene.is_even and 4 * scene.smoothing_ratio > count:
        refuse(
            "smoothing_ratio",
            number(scene.smoothing_ratio),
            f"of jittered particles the kernel's support of 4h must fit into the domain; "
            f"at most {count / 4:g} is possible",
        )


def _check_ends(scene, refuse):
    """Refuse ends that are fixed and move at the start, and particles that have no images."""
    if scene.ends is None:
        return
    if not scene.is_even:
        refuse("boundary", scene.ends, "a bar with ends has evenly spaced particles only")
    if scene.start:
        return  # What it has at the ends has been looked at where it was read.
    velocity = scene.initial_velocity.expression
    x = scene.positions[: scene.bar_count]
    walls = zip(
        (scene.ends.left, scene.ends.right), velocity(x=x[[0, -1]]), x[[0, -1]], strict=True
    )
    largest = np.abs(velocity(x=x)).max()
    for end, there, place in walls:
        if end == VELOCITY and abs(there) > AT_REST * largest:
            refuse(
                "initial_velocity",
                velocity.text,
                f"it is {there:g} at x = {place:g}, an end that is fixed (boundary = "
                f"{scene.ends}); it must be 0 there",
            )


def _check_profiles(scene, budget, refuse):
    """Refuse values that are not finite, or of a sign that nothing has."""
    velocity = scene.initial_velocity
    _check_function(scene, "initial_velocity", velocity, budget, refuse)
    for key in ("initial_density", "youngs_modulus", "damping"):
        expression = getattr(scene, key)
        if expression is None:
            continue
        least = 0.0 if key == "damping" else MOVING[0]
        for points in _looked_at(scene, key, expression, budget, refuse, least):
            values = expression(**points)
            check_values(scene.name, key, expression.text, values, points)
            _check_size(key, expression, values, refuse)


def _check_function(scene, key, expression, budget, refuse, parts=1):
    """Refuse what moves a scene where it is not finite, too large or too small."""
    largest = 0.0
    for points in _looked_at(scene, key, expression, budget, refuse, -MOVING[1], parts):
        values = expression(**points)
        check_values(scene.name, key, expression.text, values, points)
        largest = max(largest, float(np.abs(values).max()))
    _check_moving(key, expression.text, largest, refuse)


def _looked_at(scene, key, expression, budget, refuse, least, parts=1):
    """Points at which a function is checked, of one of x at and between the particles.

    One of time is looked at all over it, and then where it changes, unless its bounds show that it
    is nowhere less than ``least`` nor too large.
    """
    share, followed = budget
    count = max(int(POINTS[1] * share), 1)
    x = _fine(scene, expression, share)
    if expression.variables == IN_X:
        yield {"x": x}
        return
    own, places = scene.in_bar(expression)
    in_x, most = "x" in expression.variables, VALUES * count // (expression.terms * parts)
    if in_x:
        try:
            if followed:
                check_places(own, scene.duration, places)
        except ValueError as error:
            refuse(key, expression.text, str(error))
        usual = np.linspace(0, scene.duration, LOOKED_AT[1])
        x = x[:: max(1, -(-x.size // min(max(most // usual.size, 16), LOOKED_AT[0])))]
    else:
        steps = scene.error_steps
        usual = scene.times(steps[:: max(1, -(-steps.size // max(most, LOOKED_AT[1])))])
    yield {"x": x[:, None], "t": usual} if in_x else {"t": usual}
    low, high = _bounds(scene, own) if followed else (least, least)
    if followed and not (low >= least and high <= MOVING[1]):
        times = changes(
            own, scene.duration, places, LOOKED_AT[1] if in_x else count, int(parts / share)
        )
        yield {"x": x[:, None], "t": times} if in_x else {"t": times}


def _fine(scene, expression, share):
    """Places at and between the particles, as many as there is time for; usually all particles."""
    cost = scene.particle_count * expression.terms
    parts = min(max(int(POINTS[1] * share) // cost, 1), POINTS[0])
    every = max(int(cost / (LOOKED_THROUGH * share)), 1)
    places = parts * (scene.bar_count - 1) + 1 if scene.ends else parts * scene.particle_count
    return np.arange(0, places, every) * (scene.spacing / parts)


def _bounds_of(scene, key):
    """Bounds of modulus or damping everywhere and always, and 0 and 0 of no damping."""
    expression = getattr(scene, key)
    return (0.0, 0.0) if expression is None else _bounds(scene, scene.in_bar(expression)[0])


def _bounds(scene, expression):
    """Bounds of a function of a bar everywhere and always, those in few boxes."""
    x, t = (np.linspace(0, end, parts + 1) for end, parts in zip(
        (scene.bar_length, scene.duration), BOXES, strict=True
    ))  # fmt: skip
    low, high = bounds_in(expression, x=(x[:-1, None], x[1:, None]), t=(t[:-1], t[1:]))
    return float(low.min()), float(high.max())


def _check_force(scene, budget, refuse):
    """Refuse a force that is not finite at some time or place."""
    for key, function in _force_functions(scene):
        _check_function(scene, key, function, budget, refuse, len(scene.forces))


def _force_functions(scene):
    """Key and expression of every part of the force."""
    for key, term in zip(force_keys(scene), scene.forces, strict=True):
        if isinstance(term, Expression):
            yield key, term
            continue
        # As the configuration gives it, a term is one product.
        shape = profile_of(term)
        yield (f"{key}.time" if shape else key), term.factors[0]
        if shape:
            yield f"{key}.profile", shape


def number(value: float) -> str:
    """A number in short, but with all digits that tell it from others."""
    short = f"{value:g}"
    return short if float(short) == value else repr(value)


def _functions(scene):
    """Key and formula of all that is given of a scene by formulas, each of so many terms."""
    for key in ("initial_velocity", "initial_density", "youngs_modulus", "damping"):
        if (expression := getattr(scene, key)) is not None:
            yield key, expression, 1
    for key, expression in _force_functions(scene):
        yield key, expression, len(scene.forces)


def terms(scene: Scene) -> int:
    """Terms that the sums of all formulas of a scene have together."""
    return sum(expression.terms for _, expression, _ in _functions(scene))


def _check_work(scene, refuse):
    """Refuse sums of so many terms that to check them alone would take long."""
    for key, expression, parts in _functions(scene):
        points, what, most = scene.particle_count, "particles", MOST_TERMS
        if "x" not in expression.variables:
            points, what, parts = scene.error_steps.size, "times", 1
        elif "t" in expression.variables:
            points, what, most = LOOKED_AT[1], "times and some places", MOST_FOLLOWED * LOOKED_AT[1]
        if expression.terms * points * parts > most:
            most = max(1, most // (points * parts))
            refuse(
                key,
                expression.text,
                f"its sums have {expression.terms} terms; at {points} {what}, {most} are allowed",
            )


def _check_size(key, expression, values, refuse):
    """Refuse material whose square is beyond double precision; a damping may rise from zero."""
    (low, high), largest = MOVING, values.max()
    least = largest if key == "damping" else values[values > 0].min(initial=high)
    if not (low <= least and largest <= high) and largest > 0:
        allowed = f"0, or from {low:g}" if key == "damping" else f"from {low:g}"
        extreme = largest if largest > high else least
        refuse(key, expression.text, f"it is {extreme:g}, and must be {allowed} to {high:g}")


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
