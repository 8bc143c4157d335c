"""Criteria on what the paper says beside its numbers: of errors, modes, motion and run time.

They are registered with those of `sphpod.paper.criteria` and follow the same rules. Places are
given as scene/sampling, in the order in which a criterion compares them.

Long: one short function for each kind of statement.
"""

import itertools
import math

import numpy as np

from sphpod.paper.criteria import (
    FIELDS,
    Arrays,
    Finding,
    Place,
    compared_matrix,
    criterion,
    frozen,
    median_times,
    pod_error,
    ratios,
    singular_value_groups,
)
from sphpod.studies import comparison

SYMBOLS = dict(zip(FIELDS, "vρ", strict=True))


def sines(x: np.ndarray, count: int) -> np.ndarray:
    """Sine waves of the first harmonics (count, N), of unit norm."""
    waves = np.sin(2 * np.pi * np.outer(np.arange(1, count + 1), x / (x[1] * x.size)))
    return waves / np.linalg.norm(waves, axis=1, keepdims=True)


def shares(rows: np.ndarray) -> np.ndarray:
    """Share of each row's square sum that each harmonic has, (rows, N/2 + 1)."""
    squares = np.abs(np.fft.rfft(rows, axis=1)) ** 2
    squares[:, 1 : (rows.shape[1] + 1) // 2] *= 2
    return squares / squares.sum(axis=1, keepdims=True)


# Errors of full SPH -------------------------------------------------------------------------------


@criterion(
    "error of SPH in v and in ρ: each larger at the first place than at the second",
    "errors",
    places=(2, 2),
)
def sph_errors_larger(places, claim):
    larger, smaller = (
        [float(place["errors"][f"{field}_error"][0, 0]) for field in FIELDS] for place in places
    )
    parts = (
        f"{symbol} {one:.3e} against {other:.3e}"
        for symbol, one, other in zip("vρ", larger, smaller, strict=True)
    )
    return Finding(all(a > b for a, b in zip(larger, smaller, strict=True)), ", ".join(parts))


@criterion("error of SPH in ρ: at most 1/{factor} of that in v", "errors")
def density_error_smaller(place, claim, *, factor):
    velocity, density = (float(place["errors"][f"{field}_error"][0, 0]) for field in FIELDS)
    return Finding(velocity >= factor * density, f"{velocity / density:.3g} times smaller")


@criterion(
    "error of SPH in {field} against the exact solution, {variants}: the first at least {factor} "
    "times the second",
    "variants",
    places=(1, 2),
)
def variant_errors(places, claim, *, field, variants, factor):
    first, second = (
        _variant(place, name, field)
        for place, name in zip(places * (3 - len(places)), variants, strict=True)
    )
    return Finding(first >= factor * second, f"{first:.3e} and {second:.3e}, {first / second:.3g}")


@criterion(
    "error of SPH in {field} against the exact solution: below the scene's own in some variant",
    "variants",
)
def some_variant_better(place, claim, *, field):
    names = [str(name) for name in place["variants"]["variant"]]
    errors = place["variants"][f"variant_{field}_error"]
    best = 1 + int(np.argmin(errors[1:]))
    return Finding(
        bool(errors[best] < errors[0]),
        f"own {errors[0]:.3e}, least of the others {errors[best]:.3e} ({names[best]})",
    )


def _variant(place: Place, name: str, field: str) -> float:
    row = list(place["variants"]["variant"]).index(name)
    return float(place["variants"][f"variant_{field}_error"][row])


@criterion(
    "error of SPH in v over the first {periods} periods of {period} s: against the modified "
    "solution at most 1/{factor} of that against the exact one",
    "sph",
    "exact",
    "modified",
)
def follows_modified(place, claim, *, periods, period, factor):
    errors = []
    for name in ("modified", "exact"):
        found, known = _together(place["sph"], place[name])
        early = place[name]["t"][: len(known)] <= periods * period
        difference = np.linalg.norm(found[early] - known[early])
        errors.append(float(difference / np.linalg.norm(known[early])))
    return Finding(
        errors[1] >= factor * errors[0],
        f"{errors[0]:.3g} against the modified, {errors[1]:.3g} against the exact solution",
    )


@criterion(
    "root mean square of SPH's error in v against the modified solution in the last second: at "
    "least {factor} times that in the second one",
    "sph",
    "modified",
)
def error_grows(place, claim, *, factor):
    found, known = _together(place["sph"], place["modified"])
    t = place["modified"]["t"][: len(known)]
    size = np.sqrt(((found - known) ** 2).mean(axis=1))
    last, second = size[t > t[-1] - 1].mean(), size[(t > 1) & (t <= 2)].mean()
    return Finding(bool(last >= factor * second), f"{last / second:.3g} times")


def _together(full: Arrays, known: Arrays) -> tuple[np.ndarray, np.ndarray]:
    """Velocities at the times of the known solution, of which the full one has more."""
    rows = np.searchsorted(full["t"], known["t"] - 1e-9)
    return full["velocity"][rows], known["velocity"]


# Motion -------------------------------------------------------------------------------------------


def velocity_in_time(solution):
    """The velocity at any time, through those that a solution holds."""
    # Whoever asks what claims need, and decides on none, does without it.
    from scipy.interpolate import CubicSpline

    return CubicSpline(solution["t"], solution["velocity"])


@criterion(
    "exact solution: v a period of {period} s later, and mirrored in time about half of it, "
    "differs by at most {tolerance} of its norm",
    "exact",
)
def periodic_in_time(place, claim, *, period):
    t, course = place["exact"]["t"], velocity_in_time(place["exact"])
    first = t[t <= period]
    start = course(first)
    off = [
        float(np.linalg.norm(course(other) - start) / np.linalg.norm(start))
        for other in (first + period, period - first)
    ]
    return Finding(
        max(off) <= claim.get("tolerance", 0), f"{off[0]:.2g} later, {off[1]:.2g} mirrored"
    )


@criterion(
    "v0: more than {groups} harmonics have at least {rise} of the largest amplitude", "exact"
)
def dominant_harmonics(place, claim, *, groups, rise):
    amplitude = np.abs(np.fft.rfft(place["exact"]["velocity"][0]))
    amplitude[1:] *= 2
    counts = {
        level: int(np.count_nonzero(amplitude >= level * amplitude.max())) for level in (rise, 0.01)
    }
    return Finding(
        counts[rise] > groups, ", ".join(f"{n} at {level:g}" for level, n in counts.items())
    )


@criterion(
    "amplitudes in v from {start} to {end} s, relative to those at the start: of each harmonic "
    "from {among} on below those of all before",
    "exact",
)
def high_harmonics_decay(place, claim, *, start, end, among):
    t, velocity = place["exact"]["t"], place["exact"]["velocity"]
    size = np.abs(np.fft.rfft(velocity[(t >= start) & (t <= end)], axis=1)).max(axis=0)
    initial = np.abs(np.fft.rfft(velocity[0]))
    there = np.flatnonzero(initial > 1e-9 * initial.max())
    left = {int(n): float(size[n] / initial[n]) for n in there}
    low = min(value for n, value in left.items() if 0 < n < among)
    high = max(value for n, value in left.items() if n >= among)
    return Finding(high < low, f"at most {high:.2%} from {among} on, at least {low:.2%} before")


# Samplings and modes ------------------------------------------------------------------------------


@criterion(
    "number of snapshots and range of time: each twice that of the second place",
    "snapshots",
    places=(2, 2),
)
def doubled(places, claim):
    counts, ranges = [], []
    for place in places:
        times = place["snapshots"]["velocity_time"]
        counts.append(times.size)
        ranges.append(float(times.size * (times[1] - times[0])))
    holds = counts[0] == 2 * counts[1] and abs(ranges[0] / ranges[1] - 2) < 1e-6
    parts = (f"{n} over {span:.3g} s" for n, span in zip(counts, ranges, strict=True))
    return Finding(holds, " against ".join(parts))


@criterion(
    "largest angle between the spans of the first {harmonics} velocity modes and of as many sine "
    "waves: above {rise}",
    "pod",
)
def modes_miss_harmonics(place, claim, *, harmonics, rise):
    waves = sines(place["pod"]["x"], harmonics)
    cosines = np.linalg.svd(waves @ place["pod"]["velocity_modes"][:harmonics].T)[1]
    angle = float(np.arcsin(np.sqrt(max(0.0, 1 - cosines.min() ** 2))))
    return Finding(angle > rise, f"angle {angle:.2g}")


@criterion(
    "share of one harmonic in a velocity mode: at least {similar} in the first {modes}, below it "
    "in most of those up to number {among}",
    "pod",
)
def pure_modes(place, claim, *, modes, similar, among):
    largest = shares(place["pod"]["velocity_modes"][:among]).max(axis=1)
    later = largest[modes:]
    holds = largest[:modes].min() >= similar and np.count_nonzero(later < similar) > later.size / 2
    return Finding(
        bool(holds),
        f"at least {largest[:modes].min():.4g} in the first, {later.min():.2g} to "
        f"{later.max():.2g} later",
    )


@criterion(
    "density singular values behind the first: within each of the first {groups} groups of {size} "
    "they fall by at most {within} times, behind each by at least {between} times",
    "pod",
)
def density_groups(place, claim, *, size, groups, within, between):
    """Whether density singular values fall in groups, behind the first, the mean density."""
    behind = {"density_singular_values": place["pod"]["density_singular_values"][1:]}
    return singular_value_groups(
        {"pod": behind}, claim, field="density", size=size, groups=groups, within=within,
        between=between,
    )  # fmt: skip


@criterion("POD error ≥ SPH error in v or ρ at k = {modes}", "errors", "sweep")
def fails_with(place, claim, *, modes):
    ratio = float(ratios(place)[place["sweep"]["mode_count"] == modes][0])
    return Finding(ratio >= 1, f"{ratio:.3g} times the SPH error")


@criterion(
    "overlap of each of the first {harmonics} velocity modes with its nearest sine wave: at least "
    "{similar} at the second place, below it for all at the first",
    "pod",
    places=(2, 2),
)
def aligned_only_there(places, claim, *, harmonics, similar):
    first, second = (
        np.abs(
            sines(place["pod"]["x"], harmonics) @ place["pod"]["velocity_modes"][:harmonics].T
        ).max(axis=0)
        for place in places
    )
    return Finding(
        bool(first.max() < similar <= second.min()),
        f"{first.min():.3g} to {first.max():.3g}, against {second.min():.4g}",
    )


@criterion(
    "overlaps of the velocity modes with the first {harmonics} sine waves: largest difference of "
    "an entry from the printed U within {tolerance} of the largest entry",
    "pod",
    paper="a matrix",
)
def modes_are_mixed(place, claim, *, harmonics):
    """Matrix U of section 3.1.2 from the POD modes of full SPH themselves."""
    rows = place["pod"]["velocity_modes"][:harmonics]
    return compared_matrix(sines(place["pod"]["x"], harmonics) @ rows.T, claim)


@criterion(
    "sine coefficients C of the exact velocity at the snapshots: largest cosine between two of the "
    "first {harmonics} rows, and largest off-diagonal entry of U, at most {spread}",
    "exact",
    "snapshots",
)
def nearly_diagonal(place, claim, *, harmonics, spread):
    velocity = velocity_in_time(place["exact"])(place["snapshots"]["velocity_time"])
    rows = sines(place["exact"]["x"], harmonics) @ velocity.T
    unit = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    cosine = float(np.abs(unit @ unit.T - np.eye(harmonics)).max())
    mixing = np.abs(np.linalg.svd(rows)[0])
    # Columns come by falling singular value, each near a harmonic of its own.
    order = np.argmax(mixing, axis=0)
    off = float(np.delete(mixing[order], np.arange(harmonics) * (harmonics + 1)).max())
    return Finding(max(cosine, off) <= spread, f"cosine {cosine:.2g}, entry {off:.2g}")


@criterion(
    "σ of velocity mode {modes} relative to the first: at most 1/{factor} of that at the second "
    "place; POD error in v at k = {mode_counts} larger",
    "pod",
    "sweep",
    places=(2, 2),
)
def decays_faster(places, claim, *, modes, factor, mode_counts):
    parts, errors = [], []
    for place in places:
        values = place["pod"]["velocity_singular_values"]
        parts.append(float(values[modes - 1] / values[0]))
        at = place["sweep"]["mode_count"] == mode_counts[0]
        errors.append(float(place["sweep"]["velocity_error_sph"][at][0]))
    return Finding(
        factor * parts[0] <= parts[1] and errors[0] > errors[1],
        f"{parts[0]:.2g} against {parts[1]:.2g}; errors {errors[0]:.2g} against {errors[1]:.2g}",
    )


@criterion(
    "singular values of velocity, and of density behind their first: the first at most {similar} "
    "times number {after}; the step to the next is at least {drop} there, the largest of all such "
    "steps among the first {among}",
    "pod",
)
def both_drop(place, claim, *, after, similar, drop, among):
    holds, parts = True, []
    for field in FIELDS:
        # The first of the density is its mean.
        values = place["pod"][f"{field}_singular_values"][int(field == "density") :][: among + 1]
        steps = values[:-1] / values[1:]
        together, steepest = float(values[0] / values[after - 1]), int(np.argmax(steps)) + 1
        step = float(steps[after - 1])
        holds &= together <= similar and steepest == after and step >= drop
        parts.append(
            f"{field}: first {together:.3g} times number {after}, step there {step:.3g}, steepest "
            f"behind number {steepest}"
        )
    return Finding(bool(holds), "; ".join(parts))


# Errors of reduced models -------------------------------------------------------------------------


@criterion(
    "POD error in v and ρ: at each k with resolved modes at most that at k - 1",
    "sweep",
    places=(1, math.inf),
)
def errors_fall(places, claim):
    rises = 0
    worst, checked = 1.0, 0
    for place in places:
        resolved = place["sweep"]["modes_resolved"].astype(bool)
        for field in FIELDS:
            error = place["sweep"][f"{field}_error_sph"][resolved]
            with np.errstate(invalid="ignore"):
                steps = error[1:] / error[:-1]
            steps = steps[~np.isnan(steps)]
            checked += steps.size
            rises += int(np.count_nonzero(steps > 1))
            worst = max(worst, float(steps.max(initial=1.0)))
    return Finding(rises == 0, f"rises at {rises} of {checked} steps, at most {worst:.3g} times")


@criterion(
    "POD error in v and ρ: the largest ratio of successive errors from k = 2 to {among} stands "
    "between {after} and the next",
    "sweep",
)
def error_step(place, claim, *, after, among):
    counts = place["sweep"]["mode_count"]
    parts, holds = [], True
    for field in FIELDS:
        error = place["sweep"][f"{field}_error_sph"]
        steps = error[:-1] / error[1:]
        steps = np.where(counts[1:] <= among, steps, 0)
        steepest = int(counts[np.argmax(steps)])
        there = float(steps[list(counts).index(after)])
        holds &= steepest == after
        parts.append(
            f"{SYMBOLS[field]}: {steps.max():.3g} between {steepest} and {steepest + 1}, "
            f"{there:.3g} behind {after}"
        )
    return Finding(holds, "; ".join(parts))


@criterion(
    "geometric mean over k ≥ {begin} of POD error relative to that of the last place: below 1 at "
    "each other place",
    "sweep",
    places=(2, math.inf),
)
def better_on_average(places, claim, *, begin):
    *others, base = places
    means = []
    for place in others:
        parts = [np.log(_from(place, field, begin) / _from(base, field, begin)) for field in FIELDS]
        means.append(float(np.exp(np.mean(parts))))
    return Finding(max(means) < 1, ", ".join(f"{mean:.2f}" for mean in means))


@criterion(
    "POD error at every k, relative to that of the last place: from 1/{factor} to {factor} at each "
    "other place",
    "sweep",
    places=(2, math.inf),
)
def alike_at_every_k(places, claim, *, factor):
    *others, base = places
    parts = np.concatenate(
        [_from(place, field, 1) / _from(base, field, 1) for place in others for field in FIELDS]
    )
    low, high = float(parts.min()), float(parts.max())
    return Finding(1 / factor <= low and high <= factor, f"{low:.2g} to {high:.2g}")


def _from(place: Place, field: str, begin: int) -> np.ndarray:
    sweep = place["sweep"]
    return sweep[f"{field}_error_sph"][sweep["mode_count"] >= begin]


@criterion(
    "smallest k from which POD error stays below SPH error: rising from place to place",
    "errors",
    "sweep",
    places=(2, math.inf),
)
def need_more_modes(places, claim):
    counts = [comparison.works_from(place["sweep"], place["errors"]) for place in places]
    holds = all(a and b and a < b for a, b in itertools.pairwise(counts))
    return Finding(holds, ", ".join(str(count or "none") for count in counts))


@criterion(
    "error of linearized over original model in v at k = {modes}: from place to place nearer to 1",
    "acceleration",
    places=(2, math.inf),
)
def linearized_improves(places, claim, *, modes):
    found = [
        pod_error(place, "velocity", "linearized", modes)
        / pod_error(place, "velocity", "original", modes)
        for place in places
    ]
    off = [abs(ratio - 1) for ratio in found]
    return Finding(
        all(a > b for a, b in itertools.pairwise(off)), ", ".join(f"{r:.4g}" for r in found)
    )


@criterion(
    "error of the model frozen longest over that of the one frozen shortest, less 1: at most "
    "{spread} for each k, v and ρ",
    "acceleration",
    places=(1, math.inf),
)
def freezing_negligible(places, claim, *, spread):
    worst, where = -np.inf, ""
    for place in places:
        study = place["acceleration"]
        shortest, *_, longest = frozen(study)
        for field in FIELDS:
            for count in study["mode_count"]:
                added = pod_error(place, field, longest, count) / pod_error(
                    place, field, shortest, count
                )
                if added - 1 > worst:
                    worst, where = added - 1, f"{SYMBOLS[field]} at k = {count}"
    return Finding(worst <= spread, f"at most {worst:.2g}, {where}")


@criterion(
    "error of the model frozen longest over that of the one frozen shortest in v at k = {modes}, "
    "less 1: at the second place at least {factor} times that at the first",
    "acceleration",
    places=(2, 2),
)
def freezing_adds_more(places, claim, *, modes, factor):
    added = []
    for place in places:
        shortest, *_, longest = frozen(place["acceleration"])
        errors = (pod_error(place, "velocity", name, modes) for name in (longest, shortest))
        added.append(next(errors) / next(errors) - 1)
    return Finding(
        added[1] > 0 and added[1] >= factor * added[0], f"{added[0]:.2g}, {added[1]:.2g}"
    )


@criterion(
    "POD error of every model: smaller at the larger of two mode counts, v and ρ",
    "acceleration",
    places=(1, math.inf),
)
def more_modes_help(places, claim):
    least = np.inf
    for place in places:
        study = place["acceleration"]
        few, many = study["mode_count"].min(), study["mode_count"].max()
        for name, field in itertools.product(study["contender"], FIELDS):
            gain = pod_error(place, field, name, few) / pod_error(place, field, name, many)
            least = min(least, gain)
    return Finding(least > 1, f"at least {least:.3g} times smaller")


# CPU times ----------------------------------------------------------------------------------------


@criterion(
    "CPU time of every reduced model at the larger of two mode counts: at most {factor} times that "
    "at the smaller",
    "cpu_time",
    places=(1, math.inf),
)
def cpu_time_rises_little(places, claim, *, factor):
    rises: dict[str, list[float]] = {}
    for times in map(median_times, places):
        counts = sorted({count for _, count in times if count})
        for name in {name for name, count in times if count}:
            rises.setdefault(name, []).append(times[name, counts[-1]] / times[name, counts[0]])
    parts = (f"{name} {min(r):.2f} to {max(r):.2f}" for name, r in sorted(rises.items()))
    return Finding(max(map(max, rises.values())) <= factor, ", ".join(parts))


@criterion(
    "CPU time of frozen1: below {factor} times that of original, for every k",
    "cpu_time",
    places=(1, math.inf),
)
def frozen_is_cheaper(places, claim, *, factor):
    found = [
        times["frozen1", count] / times["original", count]
        for times in map(median_times, places)
        for count in {count for _, count in times if count}
    ]
    return Finding(max(found) < factor, f"{min(found):.2f} to {max(found):.2f} times")
