"""Samplings whose modes are those of the snapshots of others, of scenes of the same particles."""

from typing import Any

import numpy as np

from sphpod.config.mode_counts import check_count, usual_sweep
from sphpod.config.reading import refusal, shown
from sphpod.numerics.error import FIELDS
from sphpod.scene.scene import Scene

ALIKE = 1e-12
"""Part of a length, or a density, by which two are the same but for rounding."""


def borrow(name: str, known: dict[str, Any]) -> None:
    """Complete the samplings of a scene whose modes are those of others' snapshots.

    Raises
    ------
    ConfigError
        A sampling has no snapshots to lend, or of other particles.
    """
    scene = known[name]
    for sampling, settings in scene["samplings"].items():
        if "modes" not in settings:
            continue
        key, sources = f"samplings.{sampling}", settings["modes"]["from"]
        counts = np.array([_lent(name, f"{key}.modes.from", one, known) for one in sources])
        settings["counts"] = counts.sum(axis=0).tolist()
        modes = str(settings.get("mode_counts", usual_sweep(scene, sampling)))
        check_count(name, sampling, scene, f"{key}.mode_counts", modes)
        settings["mode_counts"] = modes


def _lent(name: str, key: str, source: str, known: dict[str, Any]) -> list[int]:
    """Numbers of velocity and density snapshots of a sampling that lends them to a scene."""
    lender, _, sampling = source.partition("/")
    lendable = [
        f"{one}/{taken}"
        for one, scene in known.items()
        for taken, settings in scene["samplings"].items()
        if "modes" not in settings
    ]
    if source not in lendable:
        allowed = f"allowed are {', '.join(lendable)}" if lendable else "there is none"
        raise refusal(name, key, source, f"no such sampling with snapshots of its own; {allowed}")
    own, other = (Scene.from_settings(one, known[one]) for one in (name, lender))
    if differs := _unlike(own, other):
        unsaid = {"positions": "evenly spaced", "boundary": "periodic"}
        theirs = shown(known[lender].get(differs, unsaid.get(differs)))
        allowed = f"modes are of the same particles only, and {differs} of {lender} is {theirs}"
        raise refusal(name, key, source, allowed)
    settings = known[lender]["samplings"][sampling]
    if "counts" in settings:
        return settings["counts"]
    if "count" in settings:
        return [settings["count"]] * 2
    return [len(settings[f"{field}_times"]) for field in FIELDS]


def _unlike(one: Scene, other: Scene) -> str:
    """The key by which the particles of two scenes differ, however it is written; or none."""
    if str(one.ends) != str(other.ends):
        return "boundary"
    if one.particle_count != other.particle_count:
        return "particle_count"
    if not np.isclose(one.domain_length, other.domain_length, rtol=ALIKE, atol=0):
        return "domain_length"
    if not np.allclose(one.positions, other.positions, rtol=0, atol=ALIKE * one.domain_length):
        return "positions"
    # That of strains at images, which are odd.
    free = one.ends is not None and one.ends.is_free
    if free and not np.allclose(one.density0(), other.density0(), rtol=ALIKE, atol=0):
        return "initial_density"
    return ""
