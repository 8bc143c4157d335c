"""Mode counts and tolerances that are asked for, and how many modes a sampling gives."""

import re
from collections.abc import Mapping
from typing import Any

from sphpod.config.reading import refusal

LARGEST_USUAL = 20
"""Up to where a sweep goes that nothing else is said of."""


def parse_modes(text: str) -> list[int]:
    """Mode counts of a text such as ``12`` or ``1-20``, both ends included.

    Raises
    ------
    ValueError
        The text is neither a mode count nor a rising range of them.
    """
    match = re.fullmatch(r"([1-9]\d{0,4})(?:-([1-9]\d{0,4}))?", text)
    if match and match[2] is None:
        return [int(match[1])]
    if match and int(match[1]) < int(match[2]):
        return list(range(int(match[1]), int(match[2]) + 1))
    raise ValueError(f"{text!r} is neither a mode count from 1 on, nor a rising range such as 1-20")


def parse_pair(text: str) -> list[int] | None:
    """Numbers of velocity and of density modes of a text such as ``3+8``; None if it is no pair."""
    match = re.fullmatch(r"([1-9]\d{0,4})\+([1-9]\d{0,4})", text)
    return [int(match[1]), int(match[2])] if match else None


def parse_tolerance(text: str) -> float:
    """Relative tolerance of a text such as ``1e-2`` or ``0.05``.

    Raises
    ------
    ValueError
        The text is no number between 0 and 1.
    """
    if re.fullmatch(r"[1-9](\.\d+)?e-\d{1,2}|0\.\d+", text) and 0 < float(text) < 1:
        return float(text)
    raise ValueError("it must be a number above 0 and below 1, such as 1e-2 or 0.05")


def field_limits(scene: Mapping[str, Any], sampling: str) -> list[int]:
    """The most modes that a sampling gives for velocity and for density: as many as there are
    snapshots, but no more than there are particles."""
    times = scene["samplings"][sampling]
    if "counts" in times:
        counts = times["counts"]
    elif "count" in times:
        counts = [times["count"]] * 2
    else:
        counts = [len(times["velocity_times"]), len(times["density_times"])]
    return [min(count, scene["particle_count"]) for count in counts]


def mode_limit(scene: Mapping[str, Any], sampling: str) -> int:
    """The most modes that a sampling gives for either field."""
    return max(field_limits(scene, sampling))


def usual_sweep(scene: Mapping[str, Any], sampling: str) -> str:
    """All mode counts of a sampling up to the usual largest, as text such as ``1-20``."""
    limit = min(LARGEST_USUAL, mode_limit(scene, sampling))
    return f"1-{limit}" if limit > 1 else "1"


def check_count(
    name: str, sampling: str, scene: Any, key: str, modes: str, translation: int = 0
) -> None:
    """Refuse more modes than there are snapshots, but for one of translation."""
    try:
        most = max(parse_modes(modes))
    except ValueError as error:
        raise refusal(name, key, modes, f"{error} (sampling {sampling})") from None
    limit = min(mode_limit(scene, sampling) + translation, scene["particle_count"])
    if most > limit:
        allowed = (
            f"more modes than the larger snapshot set of sampling {sampling} holds; "
            f"allowed are 1 to {limit}"
        )
        raise refusal(name, key, modes, allowed)
