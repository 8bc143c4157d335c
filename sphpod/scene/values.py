"""Values that nothing can be simulated with, refused in one sentence wherever they are met.

What is looked at before a run are few places and times of a scene, so a run looks at all it uses.
"""

from collections.abc import Mapping

import numpy as np

from sphpod.numerics.error import blocks

POSITIVE = "initial_density", "youngs_modulus"
"""Keys whose values are positive."""

ROUNDING = 1e-9
"""Part of the largest damping by which one that is zero may be negative as a sum of products."""


def check_values(
    name: str, key: str, text: str, values: np.ndarray, points: Mapping[str, np.ndarray]
) -> None:
    """Refuse values of a profile that are not finite, or of a sign that nothing has.

    Parameters
    ----------
    name : str
        Scene.
    key, text : str
        Key of the profile in the configuration, and its formula.
    values : array
    points : dict
        Places [m] and times [s] of the values, by x and t, of shapes that broadcast to theirs.

    Raises
    ------
    ValueError
        One sentence that names scene, key, formula, value and where it is met.
    """
    finite = np.isfinite(values)
    if not finite.all():
        where = place(points, int(np.argmin(finite)))
        raise ValueError(f"scene {name}: {key} = {text}: it is not finite at {where}")
    if key in POSITIVE:
        allowed, must = values > 0, "be positive everywhere"
    elif key == "damping":
        allowed, must = values >= 0, "not be negative"
    else:
        return
    if not allowed.all():
        worst = int(np.where(allowed, np.inf, values).argmin())
        raise ValueError(
            f"scene {name}: {key} = {text}: it is {values.flat[worst]:g} at "
            f"{place(points, worst)} and must {must}"
        )


def check_products(
    name: str,
    key: str,
    text: str,
    factors: np.ndarray,
    profiles: np.ndarray,
    points: tuple[np.ndarray, np.ndarray],
) -> None:
    """Refuse a coefficient, a sum of products, at times and places; raises as `check_values`.

    Parameters
    ----------
    name, key, text
        As of `check_values`.
    factors, profiles : arrays, shapes (r, times) and (r, N)
    points : (array, array), shapes (N,) and (times,)
        Places [m] and times [s].
    """
    if not factors.size or not profiles.size:
        return
    x, times = points
    ends = factors.min(axis=1), factors.max(axis=1)
    # What the least of each factor leaves positive needs no look at each time.
    with np.errstate(invalid="ignore"):
        least = sum(
            np.minimum(low * p, high * p) for low, high, p in zip(*ends, profiles, strict=True)
        )
    if np.isfinite(factors).all() and least.min() > 0:
        return
    slack = ROUNDING * np.abs(profiles.T @ np.abs(factors).max(axis=1)).max()
    for rows in blocks(times.size, max(1, 2**20 // x.size)):
        with np.errstate(invalid="ignore"):
            values = factors[:, rows].T @ profiles
        if key == "damping":
            values[(values < 0) & (values >= -slack)] = 0
        check_values(name, key, text, values, {"x": x, "t": times[rows, None]})


def place(points: Mapping[str, np.ndarray], index: int) -> str:
    """The point with an index into the flat values at points that broadcast together."""
    arrays = np.broadcast_arrays(*points.values())
    at = zip(points, (array.flat[index] for array in arrays), strict=True)
    return ", ".join(f"{name} = {value:g}" for name, value in at)
