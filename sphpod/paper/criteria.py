"""Criteria that decide on a claim, each a small function with its thresholds as arguments.

A criterion looks at one or more places, each a scene with a sampling, and sees there the datasets
it asks for. What it finds is either a number, compared with the paper's, or a yes or no with the
measured values that led to it. The configuration names criteria by the names of the functions; the
text that a function is registered with says what it decides.

As in the paper, the POD error is that of a reduced model (the original one, unless it is named)
against full SPH, and the SPH error that of full SPH against the scene's first reference.
"""

import functools
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from sphpod.numerics.error import FIELDS, Arrays
from sphpod.scene import kernel
from sphpod.studies import comparison

Place = Mapping[str, Arrays]
"""Datasets of one scene and sampling, by the names in `FILES`."""

FILES = {
    "errors": "{scene}/errors.nc",
    "exact": "{scene}/reference_exact.nc",
    "sph": "{scene}/sph.nc",
    "modified": "{scene}/reference_modified.nc",
    "variants": "{scene}/variants.nc",
    "snapshots": "{scene}/{sampling}/snapshots.nc",
    "pod": "{scene}/{sampling}/pod.nc",
    "sweep": "{scene}/{sampling}/original/k{mode_counts}.nc",
    "acceleration": "{scene}/{sampling}/acceleration.nc",
    "cpu_time": "{scene}/{sampling}/cpu_time.nc",
}
"""Datasets that criteria look at; the sweep is that of the sampling's mode counts."""

BASELINES = {"sph_neighbour_lists": "neighbour lists", "sph_stencil": "the stencil"}
"""Full SPH as CPU times name it; savings are compared with the paper's against the first."""


class Finding(NamedTuple):
    """What a criterion found: a number or matrix like the paper's, or what was measured, in words.

    ``difference`` is the relative difference from what the paper says, NaN where there is none.
    """

    holds: bool
    measured: Any
    difference: float = math.nan


class Criterion(NamedTuple):
    """How it is reported, what it looks at, what the paper says, who decides, of how many."""

    text: str
    files: tuple[str, ...]
    paper: str
    decide: Callable[..., Finding]
    least: int
    most: float


CRITERIA: dict[str, Criterion] = {}
"""By the name that the configuration calls them."""


def criterion(text: str, *files: str, paper: str = "yes", places: tuple[int, float] = (1, 1)):
    """Register a criterion: ``decide(places, claim, **thresholds)``, thresholds as configured.

    ``paper`` is what claims decided by it quote: yes, a number, a matrix or a percentage;
    ``places`` are the least and the most that it looks at; if it is one, it is given as such.
    """

    def register(decide):
        @functools.wraps(decide)
        def of_one(places, claim, **thresholds):
            return decide(*places, claim, **thresholds)

        deciding = of_one if files and places == (1, 1) else decide
        CRITERIA[decide.__name__] = Criterion(text, files, paper, deciding, *places)
        return decide

    return register


# Numbers that the paper prints --------------------------------------------------------------------


def compared(value: float, claim: Mapping[str, Any]) -> Finding:
    """A number beside the paper's, within the claim's tolerance or not."""
    difference = value / claim["paper"] - 1
    return Finding(abs(difference) <= claim.get("tolerance", 0), value, difference)


def compared_matrix(columns: np.ndarray, claim: Mapping[str, Any]) -> Finding:
    """A matrix beside the paper's, its columns with the signs of the paper's."""
    paper = np.array(claim["paper"])
    columns = columns * np.sign((columns * paper).sum(axis=0))
    difference = float(np.abs(columns - paper).max() / np.abs(paper).max())
    return Finding(difference <= claim.get("tolerance", 0), columns.round(4).tolist(), difference)


@criterion(
    "relative L2 error of full SPH in {field} against {reference}: within {tolerance} of the "
    "paper's",
    "errors",
    paper="a number",
)
def sph_error(place, claim, *, field, reference):
    column = list(place["errors"]["reference"]).index(reference)
    return compared(float(place["errors"][f"{field}_error"][0, column]), claim)


@criterion(
    "coefficient of f' at α = {smoothing_ratio}: within {tolerance} of the paper's",
    paper="a number",
)
def derivative_coefficient(places, claim, *, smoothing_ratio):
    """β of appendix B."""
    return compared(kernel.derivative_coefficient(smoothing_ratio), claim)


@criterion(
    "coefficient of f''' Δx² at α = {smoothing_ratio}: within {tolerance} of the paper's",
    paper="a number",
)
def dispersion_coefficient(places, claim, *, smoothing_ratio):
    """Second coefficient of appendix B."""
    return compared(kernel.dispersion_coefficient(smoothing_ratio), claim)


@criterion(
    "left singular vectors of C, the first {harmonics} sine coefficients of the exact velocity at "
    "the snapshot times: largest difference of an entry within {tolerance} of the largest entry",
    "exact",
    "snapshots",
    paper="a matrix",
)
def mixing_matrix(place, claim, *, harmonics):
    """Matrix U of section 3.1.2, its columns with the signs of the paper's."""
    x, t = place["exact"]["x"], place["exact"]["t"]
    rows = [int(np.argmin(np.abs(t - time))) for time in place["snapshots"]["velocity_time"]]
    velocity = place["exact"]["velocity"][rows]
    waves = np.sin(2 * np.pi * np.outer(np.arange(1, harmonics + 1), x / (x[1] * x.size)))
    mixing = np.linalg.svd(waves @ velocity.T)[0]
    return compared_matrix(mixing, claim)


# Mode counts with which POD works -----------------------------------------------------------------


def ratios(place: Place) -> np.ndarray:
    """POD error over SPH error, the larger of velocity's and density's, for each mode count."""
    return comparison.ratios(place["sweep"], place["errors"])


def counted(value: int | None, claim: Mapping[str, Any]) -> Finding:
    """A count beside the paper's; None if nothing works."""
    return Finding(False, "none") if value is None else compared(value, claim)


@criterion(
    "smallest k such that, there and for every larger k, POD error < SPH error in v and ρ",
    "errors",
    "sweep",
    paper="a number",
    places=(1, math.inf),
)
def works_from(places, claim):
    """All places must agree with the paper; what is found at each is reported if it differs."""
    counts = [comparison.works_from(place["sweep"], place["errors"]) for place in places]
    findings = [counted(count, claim) for count in counts]
    worst = max(findings, key=lambda finding: (not finding.holds, abs(finding.difference)))
    if len(set(counts)) == 1:
        return worst
    return worst._replace(measured=", ".join(str(finding.measured) for finding in findings))


@criterion(
    "smallest number of snapshots with POD error < SPH error in v and ρ for some k",
    "errors",
    "sweep",
    "snapshots",
    paper="a number",
    places=(1, math.inf),
)
def smallest_working_count(places, claim):
    """The places are samplings of one scene with more and more snapshots."""
    working = [
        place["snapshots"]["velocity_time"].size for place in places if (ratios(place) < 1).any()
    ]
    return counted(min(working, default=None), claim)


def least_ratio(place: Place) -> str:
    ratio = ratios(place)
    best = int(np.argmin(ratio))
    modes = place["sweep"]["mode_count"][best]
    return f"least POD error {ratio[best]:.3g} of the SPH error, at k = {modes}"


@criterion("POD error < SPH error in v and ρ for some k", "errors", "sweep")
def works_for_some(place, claim):
    return Finding(bool((ratios(place) < 1).any()), least_ratio(place))


@criterion("POD error < SPH error in v and ρ for no k", "errors", "sweep")
def works_for_none(place, claim):
    return Finding(not (ratios(place) < 1).any(), least_ratio(place))


@criterion(
    "{velocity_modes} velocity and {density_modes} density modes are all there are, and give "
    "POD error < SPH error in v and ρ",
    "errors",
    "sweep",
    "pod",
)
def works_with_all(place, claim, *, velocity_modes, density_modes):
    there = tuple(place["pod"][f"{field}_singular_values"].size for field in FIELDS)
    ratio = ratios(place)[np.argmax(place["sweep"]["mode_count"])]
    return Finding(
        bool(ratio < 1) and there == (velocity_modes, density_modes),
        f"POD error {ratio:.3g} of the SPH error with {there[0]} and {there[1]} modes",
    )


@criterion(
    "POD error in v and ρ for every k ≥ {begin}: at most 1/{factor} of that for k = {after}",
    "sweep",
)
def error_drop(place, claim, *, after, begin, factor):
    modes = place["sweep"]["mode_count"]
    drop = min(
        float(
            place["sweep"][f"{field}_error_sph"][modes == after][0]
            / place["sweep"][f"{field}_error_sph"][modes >= begin].max()
        )
        for field in FIELDS
    )
    return Finding(drop >= factor, f"smaller by a factor of {drop:.3g}")


# Singular values and modes ------------------------------------------------------------------------


@criterion(
    "{field} singular values: within each of the first {groups} groups of {size} they fall by at "
    "most {within} times, behind each by at least {between} times",
    "pod",
)
def singular_value_groups(place, claim, *, field, size, groups, within, between):
    values = place["pod"][f"{field}_singular_values"][: size * groups + 1]
    inside = max(values[size * g] / values[size * (g + 1) - 1] for g in range(groups))
    behind = min(values[size * (g + 1) - 1] / values[size * (g + 1)] for g in range(groups))
    return Finding(
        bool(inside <= within and behind >= between),
        f"within a group at most {inside:.3g} times, behind it at least {behind:.3g} times",
    )


@criterion(
    "first {field} mode: range of its entries at most {spread} of their mean, singular value at "
    "least {dominance} times the second",
    "pod",
)
def uniform_mode(place, claim, *, field, spread, dominance):
    mode, values = place["pod"][f"{field}_modes"][0], place["pod"][f"{field}_singular_values"]
    variation, ratio = float(np.ptp(mode) / abs(mode.mean())), float(values[0] / values[1])
    return Finding(
        variation <= spread and ratio >= dominance,
        f"range {variation:.3g} of the mean, {ratio:.3g} times the second",
    )


@criterion(
    "{field} singular values: the first at most {similar} times number {after}, which is at least "
    "{drop} times the next, the largest of all such steps among the first {among}",
    "pod",
)
def singular_value_drop(place, claim, *, field, after, similar, drop, among):
    values = place["pod"][f"{field}_singular_values"][: max(among, after) + 1]
    steps = values[:-1] / values[1:]
    together, fall = float(values[0] / values[after - 1]), float(steps[after - 1])
    return Finding(
        together <= similar and fall >= drop and int(np.argmax(steps)) == after - 1,
        f"first {together:.3g} times number {after}, step of {fall:.3g} there, steepest step "
        f"behind number {int(np.argmax(steps)) + 1}",
    )


@criterion(
    "first {modes} {field} modes, x/L between {second} compared with x/L between {first}: median "
    "ratios of the root mean square (about the mode's mean) and of the number of zero crossings at "
    "most {amplitude} and {crossings}",
    "pod",
)
def calmer_half(place, claim, *, field, modes, first, second, amplitude, crossings):
    """A mode without a crossing in the first part has no ratio of crossings, and does not count."""
    x, rows = place["pod"]["x"], place["pod"][f"{field}_modes"][:modes]
    x = x / (x[1] * x.size)
    parts = [rows[:, (x > start) & (x < end)] for start, end in (first, second)]
    mean = rows.mean(axis=1, keepdims=True)
    sizes = [np.sqrt(((part - mean) ** 2).mean(axis=1)) for part in parts]
    counts = [np.count_nonzero(part[:, :-1] * part[:, 1:] < 0, axis=1) for part in parts]
    some = counts[0] > 0
    size = float(np.median(sizes[1] / sizes[0]))
    count = float(np.median(counts[1][some] / counts[0][some])) if some.any() else math.inf
    return Finding(
        size <= amplitude and count <= crossings,
        f"{field} {size:.3g} of the root mean square and {count:.3g} of the crossings",
    )


# Acceleration -------------------------------------------------------------------------------------


def pod_error(place: Place, field: str, method: str, count: int) -> float:
    """Error of a reduced model of the acceleration study against full SPH."""
    study = place["acceleration"]
    row, column = list(study["contender"]).index(method), list(study["mode_count"]).index(count)
    return float(study[f"acceleration_{field}_error"][row, column])


def error_ratios(place: Place, method: str, mode_counts: Sequence[int]) -> dict[str, list[float]]:
    """POD error over SPH error by field, for the mode counts."""
    return {
        field: [
            pod_error(place, field, method, count) / float(place["errors"][f"{field}_error"][0, 0])
            for count in mode_counts
        ]
        for field in FIELDS
    }


def worded(ratio: Mapping[str, Sequence[float]], mode_counts: Sequence[int]) -> str:
    parts = (
        f"{v:.3g} (v) and {rho:.3g} (ρ) at k = {k}"
        for v, rho, k in zip(*(ratio[field] for field in FIELDS), mode_counts, strict=True)
    )
    return "; ".join(parts)


@criterion(
    "{method}, k = {mode_counts}: POD error < {factor} × SPH error in v and ρ",
    "errors",
    "acceleration",
)
def error_below(place, claim, *, method, mode_counts, factor):
    ratio = error_ratios(place, method, mode_counts)
    return Finding(max(map(max, ratio.values())) < factor, f"{method} {worded(ratio, mode_counts)}")


@criterion(
    "{method}, k = {mode_counts}: POD error > {factor} × SPH error in v and ρ",
    "errors",
    "acceleration",
)
def error_above(place, claim, *, method, mode_counts, factor):
    ratio = error_ratios(place, method, mode_counts)
    return Finding(min(map(min, ratio.values())) > factor, f"{method} {worded(ratio, mode_counts)}")


@criterion(
    "k = {mode_counts}: the {rising} POD error rises with every step of n_freeze, by {rise} "
    "or more in all; the {steady} POD error stays within {spread} of its smallest value",
    "acceleration",
)
def freezing_effect(place, claim, *, mode_counts, rising, steady, rise, spread):
    methods = frozen(place["acceleration"])
    holds, parts = True, []
    for count in mode_counts:
        up = np.array([pod_error(place, rising, method, count) for method in methods])
        flat = np.array([pod_error(place, steady, method, count) for method in methods])
        gain, span = float(up[-1] / up[0] - 1), float(flat.max() / flat.min() - 1)
        holds &= bool(np.all(np.diff(up) > 0)) and gain >= rise and span <= spread
        parts.append(f"{rising} {gain:+.3g}, {steady} within {span:.2g} at k = {count}")
    return Finding(holds, "; ".join(parts))


def frozen(study: Arrays) -> list[str]:
    """Frozen models of a study, by rising number of frozen steps."""
    steps = dict(zip(study["contender"], study["n_freeze"], strict=True))
    return sorted((name for name, n in steps.items() if n > 0), key=lambda name: steps[name])


# CPU times ----------------------------------------------------------------------------------------


def median_times(place: Place) -> dict[tuple[str, int], float]:
    """Median CPU time [s] by contender and mode count (0 for full SPH)."""
    times = place["cpu_time"]
    keys = zip(times["contender"], times["contender_mode_count"], strict=True)
    medians = np.median(times["cpu_seconds"], axis=1)
    return {
        (str(name), int(count)): float(s) for (name, count), s in zip(keys, medians, strict=True)
    }


@criterion(
    "k = {mode_counts}: part of the CPU time of full SPH with neighbour lists that {method} saves, "
    "with the fewest modes: within {spread} of the paper's",
    "cpu_time",
    paper="a percentage",
)
def cpu_time_saved(place, claim, *, method, mode_counts, spread):
    """Saving against neighbour lists, as an SPH code has them; that against the stencil is said."""
    times = median_times(place)
    savings = {
        baseline: [1 - times[method, count] / times[baseline, 0] for count in sorted(mode_counts)]
        for baseline in BASELINES
    }
    parts = [
        f"{' and '.join(f'{saving:.0%}' for saving in savings[baseline])} against {name}"
        for baseline, name in BASELINES.items()
    ]
    saving = savings[next(iter(BASELINES))][0]
    paper = float(claim["paper"].rstrip("%")) / 100
    return Finding(abs(saving - paper) <= spread, ", ".join(parts), saving / paper - 1)


@criterion(
    "k = {mode_counts}: no model frozen for longer is slower, beyond the quartiles of both, than "
    "one frozen for fewer steps, and the one frozen longest is faster than that frozen shortest",
    "cpu_time",
)
def cpu_time_falls(place, claim, *, mode_counts):
    times, methods = place["cpu_time"], frozen(place["cpu_time"])
    keys = zip(times["contender"], times["contender_mode_count"], strict=True)
    quartiles = dict(
        zip(keys, np.quantile(times["cpu_seconds"], (0.25, 0.5, 0.75), axis=1).T, strict=True)
    )
    slower = sum(
        bool(quartiles[longer, count][0] > quartiles[shorter, count][2])
        for count in mode_counts
        for shorter, longer in itertools.pairwise(methods)
    )
    gains = [
        float(quartiles[methods[0], count][1] / quartiles[methods[-1], count][1])
        for count in mode_counts
    ]
    return Finding(
        slower == 0 and min(gains) > 1,
        f"{slower} slower; {methods[-1]} {' and '.join(f'{gain:.2g}' for gain in gains)} times as "
        f"fast as {methods[0]}",
    )


@criterion(
    "CPU times of {methods} for every k: between 1/{factor} and {factor} times those of full "
    "SPH with neighbour lists and with the stencil",
    "cpu_time",
    places=(1, math.inf),
)
def cpu_time_alike(places, claim, *, methods, factor):
    parts, holds = [], True
    for baseline, name in BASELINES.items():
        ratio = [
            seconds / times[baseline, 0]
            for times in map(median_times, places)
            for (contender, _), seconds in times.items()
            if contender in methods
        ]
        holds &= 1 / factor <= min(ratio) and max(ratio) <= factor
        parts.append(f"{min(ratio):.2g} to {max(ratio):.2g} times {name}")
    return Finding(holds, ", ".join(parts))
