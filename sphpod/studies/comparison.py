"""Lifted models beside the paper's: from which mode count each works, and what bounds certify."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from sphpod.numerics.error import FIELDS, Arrays

TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4)
"""Relative tolerances that are tried on every sampling."""


def ratios(sweep: Arrays, errors: Arrays) -> np.ndarray:
    """POD error over SPH error, the larger of velocity's and density's, for each mode count.

    Parameters
    ----------
    sweep : dict
        velocity_error_sph, density_error_sph (counts,).
    errors : dict
        velocity_error, density_error (solution, reference); those of full SPH against the first
        reference are the first.
    """
    # No error is below one of zero, and none is a part of it.
    return np.maximum(
        *(
            sweep[f"{field}_error_sph"] / (errors[f"{field}_error"][0, 0] or np.nan)
            for field in FIELDS
        )
    )


def threshold(sweep: Arrays, errors: Arrays) -> int | None:
    """The smallest k at which the POD error is below the SPH error; None without one."""
    return _first(sweep, ratios(sweep, errors) < 1)


def works_from(sweep: Arrays, errors: Arrays) -> int | None:
    """The smallest k from which on the POD error stays below the SPH error; None without one."""
    works = ratios(sweep, errors) < 1
    return _first(sweep, np.flip(np.logical_and.accumulate(np.flip(works))))


def near_rounding(sweep: Arrays) -> str:
    """Mode counts whose modes are not resolved, such as ``8-20``; empty if all are.

    Parameters
    ----------
    sweep : dict
        mode_count, ascending, and modes_resolved (counts,).
    """
    counts = sweep["mode_count"][~sweep["modes_resolved"].astype(bool)]
    runs = np.split(counts, np.flatnonzero(np.diff(counts) > 1) + 1)
    texts = [f"{run[0]}-{run[-1]}" if run.size > 1 else f"{run[0]}" for run in runs if run.size]
    return ", ".join(texts)


def _first(sweep, chosen):
    counts = sweep["mode_count"][chosen]
    return int(counts[0]) if counts.size else None


def effectivity(place: Mapping[str, Any], sweep: Arrays) -> Iterator[dict[str, Any]]:
    """How far the bounds of a sweep of ``lifted_exact`` are above its errors, a row a mode count.

    An effectivity is NaN where there is no error.

    Parameters
    ----------
    place : dict
        scene and sampling.
    sweep : dict
        As from `certificate.certify`.
    """
    for n, count in enumerate(sweep["mode_count"]):
        error, bound, plain = (
            float(sweep[name][n])
            for name in ("energy_error_lifted", "energy_error_bound", "residual_bound")
        )
        size = error or np.nan
        yield {
            **place,
            "modes": int(count),
            "modes_resolved": bool(sweep["modes_resolved"][n]),
            "energy_error_lifted": error,
            "energy_error_bound": bound,
            "effectivity": bound / size,
            "residual_bound": plain,
            "residual_effectivity": plain / size,
            "bound_slack": float(sweep["bound_slack"][n]),
        }


def certificates(
    place: Mapping[str, Any], sweep: Arrays, tolerances: Iterable[float] = TOLERANCES
) -> Iterator[dict[str, Any]]:
    """Which k of a sweep meets each tolerance, and whether its bound certifies it, in a word.

    Parameters are those of `effectivity`; the last row gives the smallest tolerance that any k of
    the sweep certifies.
    """
    counts, bounds = sweep["mode_count"], sweep["energy_error_bound"]

    def row(tolerance, n, word):
        return {
            **place,
            "tolerance": tolerance,
            "modes": int(counts[n]),
            "modes_resolved": bool(sweep["modes_resolved"][n]),
            "difference_from_best": float(sweep["difference_from_best"][n]),
            "energy_error_bound": float(bounds[n]),
            "verdict": word,
        }

    for tolerance in tolerances:
        meets = np.flatnonzero(sweep["difference_from_best"] <= tolerance)
        if not meets.size:
            yield {**place, "tolerance": tolerance, "verdict": f"not met by k = {counts[-1]}"}
        else:
            certified = bounds[meets[0]] <= tolerance
            yield row(tolerance, meets[0], "certified" if certified else "not certified")
    if np.isnan(bounds).all():
        yield {**place, "verdict": "no tolerance certified"}
    else:
        smallest = int(np.nanargmin(bounds))
        yield row(float(bounds[smallest]), smallest, "smallest tolerance certified")
