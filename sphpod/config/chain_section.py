"""A chain of one's own: masses and springs as lists, in the place of density and modulus.

Mass n stands at x_n = n Δx and has the density m_n/Δx about it; spring n joins it with the next,
and has the modulus k_n Δx between them (section 2.1 and appendix A).
"""

from collections.abc import Mapping
from typing import Any

from sphpod.config.reading import refusal
from sphpod.numerics.expressions import LONGEST_SUM

INSTEAD = {"masses": "initial_density", "springs": "youngs_modulus"}
"""Keys, and those that they stand for."""

LEAST = 1e-100
"""Least mass, spring or length, and the inverse of the largest."""


def spread_chain(name: str, scene: Mapping[str, Any]) -> dict[str, Any]:
    """The scene with density and modulus as expressions, if it gives masses and springs.

    SPH takes the modulus of a mass to be the mean of its two springs', and its errors are quoted
    against the chain itself, unless the scene says otherwise.

    Raises
    ------
    ConfigError
        One of both keys is missing, is no list of a positive number for each particle, or stands
        beside what it is in the place of.
    """
    if not any(key in scene for key in INSTEAD):
        return dict(scene)
    count, length = scene.get("particle_count"), scene.get("domain_length")
    for key, instead in INSTEAD.items():
        value = scene.get(key)
        if value is None:
            raise refusal(name, key, "(missing)", "masses and springs belong together")
        if instead in scene:
            allowed = f"{key} stand in the place of {instead}; one of both is allowed"
            raise refusal(name, instead, scene[instead], allowed)
        if isinstance(value, list) and len(value) > LONGEST_SUM:
            allowed = f"a chain has at most {LONGEST_SUM} of them, and these are {len(value)}"
            raise refusal(name, key, value[:3], allowed)
        if not isinstance(value, list):
            raise refusal(name, key, value, "it must be a list of positive numbers")
        for number, one in enumerate(value):
            if not _is_positive(one):
                allowed = f"it must be a positive number from {LEAST:g} to {1 / LEAST:g}"
                raise refusal(name, f"{key}.{number}", one, allowed)
        if isinstance(count, int) and count > 1 and len(value) != count:
            allowed = f"it must have one for each of {count} particles, and has {len(value)}"
            raise refusal(name, key, value, allowed)
    for key in ("positions", "boundary"):
        if scene.get(key, "periodic") != "periodic":
            allowed = "a chain of masses and springs is periodic and evenly spaced"
            raise refusal(name, key, scene[key], allowed)
    kept = {key: value for key, value in scene.items() if key not in INSTEAD}
    if length is None or not _is_positive(length) or not isinstance(count, int) or count < 1:
        # What is wrong with these is said where they are checked.
        return kept | dict.fromkeys(INSTEAD.values(), 1)
    spacing = float(length) / count
    masses, springs = (", ".join(repr(float(one)) for one in scene[key]) + "," for key in INSTEAD)
    usual = {"interface": "mean", "references": ["chain"]}
    return usual | kept | {
        "initial_density": f"nth(({masses}), x*{count}/L + 0.5)/{spacing!r}",
        # A place on a mass is in the spring behind it, however it is rounded.
        "youngs_modulus": f"nth(({springs}), x*{count}/L + 1e-9)*{spacing!r}",
    }  # fmt: skip


def _is_positive(value):
    return (
        isinstance(value, int | float)
        and not isinstance(value, bool)
        and LEAST <= value <= 1 / LEAST
    )
