"""Figures of the benchmarks, one function a kind, in the style of `sphpod.figures.plotting`.

They are apart from the paper's figures, which an edit here leaves as they are.

Long, as labels are placed here that no other figure has.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import cycle, pairwise, product
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox, ScaledTranslation

from sphpod.figures.plotting import (
    BLACK,
    BLUE,
    BREAKDOWN_NOTE,
    BROWN,
    COLUMN_WIDTH,
    DIM,
    FIELDS,
    GREEN,
    GREY,
    NAMES,
    NAVY,
    NOTE,
    ORANGE,
    PALE,
    PURPLE,
    SKY,
    SMALL,
    VERMILLION,
    WORST_ERROR,
    Arrays,
    Look,
    add_legend,
    draw_bars,
    mark_breakdown,
    scale_log,
    shortened,
    styled,
    time_quartiles,
)

# --- Work and precision ---------------------------------------------------------------------------


AS_ACCURATE = 1.1
"""Times both errors of full SPH up to which a run counts as accurate as full SPH."""

FULL_RUNS: dict[str, tuple[str, Look]] = {
    "sph_neighbour_lists": (
        NAMES["sph_neighbour_lists"],
        {"color": BLACK, "marker": "*", "markerfacecolor": "white", "markersize": 5},
    ),
    "sph_stencil": (NAMES["sph_stencil"], {"color": BLACK, "marker": "*", "markersize": 5}),
    "explicit_euler": ("lifted, explicit Euler", {"color": NAVY, "marker": "^"}),
    "symplectic_euler": ("lifted, symplectic Euler", {"color": BLUE, "marker": "v"}),
    "leapfrog": ("lifted, leapfrog", {"color": SKY, "marker": "D", "markersize": 3}),
    "rk45": ("lifted, RK45", {"color": PURPLE, "marker": "s", "markerfacecolor": "white"}),
    "dop853": ("lifted, DOP853", {"color": PURPLE, "marker": "s"}),
    "exact": ("lifted, exact in time", {"color": BLUE, "marker": "h", "markerfacecolor": "white"}),
}
"""Label and look of full models: of SPH by contender, of its lifted form by integrator."""

PAPER_RUNS: dict[str, tuple[str, Look]] = {
    # One about the other, where they hardly differ.
    "original": (
        NAMES["original"],
        {"color": BROWN, "marker": "s", "fillstyle": "none", "markersize": 3.5},
    ),
    "linearized": (
        NAMES["linearized"],
        {"color": BROWN, "marker": "D", "fillstyle": "none", "markersize": 5, "linestyle": ":"},
    ),
}
FROZEN_LOOKS: tuple[Look, ...] = (
    {"color": VERMILLION, "marker": ">", "linestyle": "--"},
    {"color": ORANGE, "marker": ">", "linestyle": "--", "markerfacecolor": "white"},
    {"color": VERMILLION, "marker": "<", "linestyle": "--", "markerfacecolor": "white"},
    {"color": ORANGE, "marker": "<", "linestyle": "--"},
)
"""Looks of frozen models, that with the most frozen steps first."""

LIFTED_RUNS: dict[str, tuple[str, Look]] = {
    "lifted_euler": (
        "lifted POD, as Euler",
        {
            "color": GREEN,
            "marker": "o",
            "markerfacecolor": "white",
            "markersize": 4.5,
            "linestyle": "--",
        },
    ),
    "lifted_exact": ("lifted POD, exact in time", {"color": GREEN, "marker": "o", "markersize": 3}),
}


class Kind(NamedTuple):
    """Runs of one method, and of one integrator if the method is the lifted full model."""

    name: str
    label: str
    look: Look
    rows: np.ndarray


class Label(NamedTuple):
    """A text, and the points that it may stand beside."""

    text: str
    colour: str
    points: Sequence[tuple[float, float]]


@styled
def work_precision(benchmark: Arrays) -> Figure:
    """Draw error against CPU time of all runs of a benchmark, and the fastest that match full SPH.

    Above, velocity first and density next, a point stands at the median CPU time, its bar spans the
    quartiles. Lines join runs of one kind that differ in time step, tolerance or mode count; dotted
    ones lead to other particle counts. The wide line is the Pareto front: below it there is no run.
    Beside the large star, full SPH as the scene sets it, lies the line of its error.

    Below, which is the legend too, stands of each kind the fastest run whose errors of velocity and
    density are both at most `AS_ACCURATE` times those of that SPH.

    Time lies along the longer side: errors in time hardly show beside those in space, so that
    points crowd at one error.

    Parameters
    ----------
    benchmark
        As from `studies.benchmark`, one entry a contender. Full SPH as the scene sets it is the
        first `sph_stencil`.

    Raises
    ------
    ValueError
        A contender or an integrator is of no known kind.
    """
    lifted = np.char.startswith(benchmark["contender"], "lifted_full_")
    kinds = _kinds(np.where(lifted, benchmark["integrator"], benchmark["contender"]), FULL_RUNS)
    groups: dict[str, list[Kind]] = {}
    for kind in kinds:
        title = "full models" if kind.name in FULL_RUNS else "reduced models"
        groups.setdefault(title, []).append(kind)
    rows = [0.5 + 0.13 * len(group) for group in groups.values()]
    above, below = 4.4, 0.3 + sum(rows)
    figure = Figure(figsize=(COLUMN_WIDTH, above + below), layout="constrained")
    halves = figure.subfigures(2, 1, squeeze=False, height_ratios=(above, below))
    upper, lower = halves[:, 0]
    panels = upper.subplots(2, 1)
    for axes, field, symbol in zip(panels, FIELDS, "vρ", strict=True):
        _draw_work_precision(axes, benchmark, kinds, benchmark[f"{field}_error_exact"])
        axes.set_ylabel(f"relative L² error of {field} {symbol}")
    lower.suptitle(
        f"fastest run with both errors at most {AS_ACCURATE} times those of SPH", fontsize=7
    )
    rankings = lower.subplots(len(groups), 1, squeeze=False, height_ratios=rows)[:, 0]
    for axes, (title, group) in zip(rankings, groups.items(), strict=True):
        _draw_fastest(axes, benchmark, group)
        axes.set_title(title, loc="left")
    # Where labels find room is known once the layout is.
    figure.draw_without_rendering()
    for axes, field in zip(panels, FIELDS, strict=True):
        _write_where_free(axes, _run_labels(axes, benchmark, kinds, f"{field}_error_exact"))
    return figure


def _kinds(names: np.ndarray, full: Mapping[str, tuple[str, Look]]) -> list[Kind]:
    """Kinds of runs in the order of the legend.

    Parameters
    ----------
    names
        Name of the kind of each run.
    full
        Label and look of full models, by name.

    Raises
    ------
    ValueError
        A name is neither in `full` nor that of a reduced model.
    """
    present = set(names.tolist())
    steps = sorted(_freeze_steps(name) for name in present if name.startswith("frozen"))
    frozen = {
        f"frozen{n}": (f"frozen for {n} step{'s' if n > 1 else ''}", look)
        for n, look in zip(reversed(steps), cycle(FROZEN_LOOKS))
    }
    looks = {**full, **PAPER_RUNS, **dict(reversed(frozen.items())), **LIFTED_RUNS}
    if unknown := sorted(present - set(looks)):
        raise ValueError(f"there is no look for runs of {unknown[0]}")
    return [
        Kind(name, label, {"markersize": 3.5, "linewidth": 0.7, **look}, np.flatnonzero(rows))
        for name, (label, look) in looks.items()
        if (rows := names == name).any()
    ]


def _freeze_steps(name: str) -> int:
    return int(name.removeprefix("frozen"))


def _own(benchmark: Arrays) -> int:
    """Row of full SPH as the scene sets it."""
    return int(np.flatnonzero(benchmark["contender"] == "sph_stencil")[0])


def _draw_work_precision(
    axes: Axes, benchmark: Arrays, kinds: Sequence[Kind], values: np.ndarray
) -> None:
    """Draw the errors `values`, one a contender, against CPU time."""
    quartiles = time_quartiles(benchmark["cpu_seconds"])
    median, own = quartiles[1], _own(benchmark)
    finite = values <= WORST_ERROR
    shown = np.where(finite, values, np.nan)
    scale_log(axes.xaxis, quartiles[::2].ravel())
    scale_log(axes.yaxis, values[finite], room=0.1, few_below=300)
    axes.set_xlabel("CPU time [s]")
    times, best = _pareto_front(median, values)
    right, top = axes.get_xlim()[1], axes.get_ylim()[1]
    corners = np.repeat([*times, right], 2)[:-1], np.repeat([top, *best], 2)[1:]
    axes.plot(*corners, color=PALE, linewidth=3, zorder=1)
    axes.axhline(shown[own], color=DIM, linewidth=0.6, linestyle=(0, (5, 2)))
    for kind in kinds:
        rows, look = kind.rows, kind.look
        draw_bars(axes, quartiles[:, rows], shown[rows], look["color"], elinewidth=0.4)
        same, over = _joined(benchmark, kind)
        axes.plot(median[over], shown[over], **{**look, "linestyle": ":"})
        axes.plot(median[same], shown[same], **look)
        mark_breakdown(axes, median[rows[~finite[rows]]], look)
    # In front of the crowd.
    axes.plot(median[own], shown[own], "*", color=BLACK, markersize=7.5, zorder=3)
    if not finite.all():
        axes.set_title(BREAKDOWN_NOTE, loc="right")


def _pareto_front(times: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times and finite values, ascending and descending, of what nothing beats in both."""
    order = np.lexsort((values, times))
    order = order[values[order] <= WORST_ERROR]
    times, values = times[order], values[order]
    best = values < np.minimum.accumulate(np.append(np.inf, values))[:-1]
    return times[best], values[best]


def _joined(benchmark: Arrays, kind: Kind) -> tuple[np.ndarray, np.ndarray]:
    """Rows with the scene's particle count, in order of what they differ in; rows over the counts.

    The latter are none if there is only that count, and have its time step at that count.
    """
    counts, steps = benchmark["contender_particle_count"], benchmark["contender_time_step"]
    keys = (benchmark["contender_tolerance"], steps, benchmark["contender_mode_count"])
    rows = kind.rows[np.lexsort([key[kind.rows] for key in keys])]
    own = _own(benchmark)
    same = counts[rows] == counts[own]
    if same.all():
        return rows, rows[:0]
    # A time step of no fixed length is NaN.
    over = rows[~same | (steps[rows] == steps[own]) | np.isnan(steps[rows])]
    return rows[same], over[np.argsort(counts[over], kind="stable")]


def _draw_fastest(axes: Axes, benchmark: Arrays, kinds: Sequence[Kind]) -> None:
    """Draw a row for each kind: its label, its marker, and its fastest run as good as full SPH."""
    quartiles, good = time_quartiles(benchmark["cpu_seconds"]), _as_accurate(benchmark)
    scale_log(axes.xaxis, quartiles[::2].ravel())
    middle = np.sqrt(np.prod(axes.get_xlim()))
    key = axes.get_yaxis_transform() + ScaledTranslation(-7 / 72, 0, axes.figure.dpi_scale_trans)
    text: Look = {"va": "center_baseline", **NOTE}
    for height, kind in enumerate(kinds):
        look = {**kind.look, "linestyle": ""}
        axes.plot(0, height, transform=key, clip_on=False, **look)
        rows = kind.rows[good[kind.rows]]
        if not len(rows):
            axes.text(middle, height, "none", ha="center", **text)
            continue
        fastest = rows[quartiles[1, rows].argmin()]
        lower, median, upper = quartiles[:, fastest]
        draw_bars(axes, quartiles[:, [fastest]], np.array([height]), look["color"], elinewidth=0.6)
        axes.plot(median, height, **look)
        # Towards the middle there is room.
        side, end = (1, upper) if median < middle else (-1, lower)
        axes.annotate(
            _settings(benchmark, fastest),
            (end, height),
            xytext=(5 * side, 0),
            textcoords="offset points",
            ha="left" if side > 0 else "right",
            **text,
        )
    axes.set_yticks(range(len(kinds)), [kind.label for kind in kinds])
    axes.set(ylim=(len(kinds) - 0.4, -0.6), xlabel="CPU time [s]")
    axes.tick_params(axis="y", length=0, pad=13)
    axes.grid()


def _as_accurate(benchmark: Arrays) -> np.ndarray:
    """Whether both errors of each run are about those of full SPH, or below."""
    errors = np.array([benchmark[f"{field}_error_exact"] for field in FIELDS])
    return np.all(errors <= AS_ACCURATE * errors[:, [_own(benchmark)]], axis=0)


def _settings(benchmark: Arrays, row: int) -> str:
    """What sets a run apart from others of its kind."""
    count, modes, tolerance, step = (
        benchmark[f"contender_{name}"][row]
        for name in ("particle_count", "mode_count", "tolerance", "time_step")
    )
    usual = count == benchmark["contender_particle_count"][_own(benchmark)]
    parts = [] if usual else [f"N = {count}"]
    if modes:
        parts.append(f"k = {modes}")
    elif np.isfinite(tolerance):
        parts.append(f"tolerance {shortened(tolerance)}")
    elif np.isfinite(step):
        parts.append(f"Δt = {shortened(step)} s")
    return ", ".join(parts)


def _run_labels(axes: Axes, benchmark: Arrays, kinds: Sequence[Kind], error: str) -> list[Label]:
    """Labels of the error of full SPH, the Pareto front, particle counts and mode counts."""
    median, values = np.median(benchmark["cpu_seconds"], axis=1), benchmark[error]
    counts, modes = benchmark["contender_particle_count"], benchmark["contender_mode_count"]
    own = _own(benchmark)
    across = np.geomspace(*axes.get_xlim(), 61)[1:-1]
    labels = [Label(f"SPH, N = {counts[own]}", DIM, [(time, values[own]) for time in across])]
    for kind in kinds:
        rows = kind.rows[(counts[kind.rows] != counts[own]) & (values[kind.rows] <= WORST_ERROR)]
        labels += [
            Label(f"N = {counts[row]}", kind.look["color"], [(median[row], values[row])])
            for row in rows
        ]
    # Reduced models of the paper share their errors, and so do lifted ones.
    for kind in (kind for kind in kinds if kind.name in ("original", "lifted_exact")):
        rows = _joined(benchmark, kind)[0]
        rows = rows[values[rows] <= WORST_ERROR]
        # The ends first, then what lies between.
        labels += [
            Label(f"k = {modes[row]}", kind.look["color"], [(median[row], values[row])])
            for row in sorted(rows, key=lambda row: row not in (rows[0], rows[-1]))
        ]
    times, best = _pareto_front(median, values)
    beyond = across[across > times[0]]
    levels = best[np.searchsorted(times, beyond) - 1]
    return [*labels, Label("Pareto front", DIM, list(zip(beyond, levels, strict=True)))]


DIRECTIONS = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1))


def _write_where_free(axes: Axes, labels: Sequence[Label], away: float = 4) -> None:
    """Write each label `away` points off one of its points, where it covers nothing.

    No marker may be nearer, but for one that all but coincides with the point. A label that no
    place is free for stays away. The layout must be final.
    """
    scale = axes.figure.dpi / 72
    paths = [line.get_transform().transform(line.get_xydata()) for line in axes.lines]
    drawn = np.concatenate([_along(path) for path in paths])
    marked = (line.get_marker() not in ("", "None") for line in axes.lines)
    markers = np.concatenate([path for path, mark in zip(paths, marked, strict=True) if mark])
    taken: list[Bbox] = []
    for label in labels:
        text = axes.text(0, 0, label.text, color=label.colour, fontsize=SMALL, in_layout=False)
        text.set(horizontalalignment="center", verticalalignment="center")
        size = np.array(text.get_window_extent().size)
        for point, direction in product(axes.transData.transform(label.points), DIRECTIONS):
            centre = point + np.array(direction) * (size / 2 + away * scale)
            box = Bbox([centre - size / 2, centre + size / 2])
            wide = box.padded(2 * scale)
            if (
                np.all(wide.min > axes.bbox.min)
                and np.all(wide.max < axes.bbox.max)
                and not wide.count_overlaps(taken)
                and _distance(box, drawn) > 2 * scale
                and _distance(box, markers) > _distance(box, point) - scale
            ):
                x, y = axes.transData.inverted().transform(centre)
                text.set_position((x, y))
                taken.append(box)
                break
        else:
            text.remove()


def _along(path: np.ndarray, spacing: float = 2) -> np.ndarray:
    """Points on the straight lines through the points of `path`, `spacing` pixels apart."""
    pieces = [
        np.linspace(start, end, 2 + int(np.hypot(*(end - start)) / spacing))
        for start, end in pairwise(path)
        if np.isfinite((start, end)).all()
    ]
    return np.concatenate([path, *pieces])


def _distance(box: Bbox, points: np.ndarray) -> float:
    """Distance from a box to the nearest of points, 0 if the box holds one."""
    beyond = np.maximum(np.maximum(box.min - points, points - box.max), 0)
    return float(np.nanmin(np.hypot(beyond[..., 0], beyond[..., 1])))


# --- Scaling --------------------------------------------------------------------------------------


SCALED_RUNS: dict[str, tuple[str, Look]] = {
    "sph_neighbour_lists": FULL_RUNS["sph_neighbour_lists"],
    "sph_stencil": FULL_RUNS["sph_stencil"],
    "lifted_full_stencil": ("SPH, lifted", FULL_RUNS["explicit_euler"][1]),
}


class Curve(NamedTuple):
    """Lower quartiles, medians and upper quartiles, shape (3, n), of one kind over `x`."""

    kind: Kind
    x: np.ndarray
    quartiles: np.ndarray


@styled
def scaling(scaling: Arrays) -> Figure:
    """Draw time a step and memory against particles, and time a step against modes.

    Points stand at medians, bars span the quartiles. Grey lines have the slopes that the numbers of
    operations in `sphpod.reduced.rom` and `sphpod.reduced.lifted_rom` let expect; that of frozen
    models holds where their tensor takes fewer operations than the particles.

    Parameters
    ----------
    scaling
        As from `studies.scaling`, one entry a measurement. Reduced models stand against particles
        at the mode count that most entries have, and against modes at the particle count that most
        entries have, if there with several.

    Raises
    ------
    ValueError
        A contender is of no known kind.
    """
    counts, modes = scaling["contender_particle_count"], scaling["contender_mode_count"]
    reduced = modes > 0
    usual = {"N": _most_frequent(counts[reduced]), "k": _most_frequent(modes[reduced])}
    kinds = _kinds(scaling["contender"], SCALED_RUNS)
    seconds = time_quartiles(scaling["step_seconds"])
    memory = np.broadcast_to(scaling["memory_bytes"], seconds.shape)
    over_particles = ~reduced | (modes == usual["k"])
    over_modes = reduced & (counts == usual["N"])
    figure = Figure(figsize=(COLUMN_WIDTH, 6.8), layout="constrained")
    panels = []
    for name, values in (("time a step [s]", seconds), ("memory [B]", memory)):
        curves = _curves(kinds, over_particles, counts, values)
        panels.append((name, "number of particles N", curves, _particle_guides(curves)))
    curves = _curves(kinds, over_modes, modes, seconds)
    curves = [curve for curve in curves if len(set(curve.x)) > 1]
    guides = _mode_guides(curves, usual["N"])
    panels.append(("time a step [s]", "number of modes k", curves, guides))
    every = figure.subplots(len(panels), 1)
    for axes, (name, over, curves, guides) in zip(every, panels, strict=True):
        _draw_curves(axes, curves, guides)
        axes.set(xlabel=over, ylabel=name)
        fixed = "N" if over.endswith("k") else "k"
        axes.set_title(f"reduced models: {fixed} = {usual[fixed]}", loc="right")
    add_legend(figure, figure.axes)
    figure.draw_without_rendering()
    for axes, (_, _, _, guides) in zip(every, panels, strict=True):
        _label_guides(axes, guides)
    return figure


def _most_frequent(numbers: np.ndarray) -> int:
    values, frequencies = np.unique(numbers, return_counts=True)
    return int(values[frequencies.argmax()])


def _curves(
    kinds: Sequence[Kind], chosen: np.ndarray, x: np.ndarray, values: np.ndarray
) -> list[Curve]:
    """Chosen entries of each kind that has any, by ascending `x`."""
    curves = []
    for kind in kinds:
        rows = kind.rows[chosen[kind.rows]]
        rows = rows[np.argsort(x[rows], kind="stable")]
        if len(rows):
            curves.append(Curve(kind, x[rows], values[:, rows]))
    return curves


class Guide(NamedTuple):
    """A line with the slope expected of curves, and what names it."""

    label: str
    x: np.ndarray
    y: np.ndarray


def _particle_guides(curves: Sequence[Curve]) -> list[Guide]:
    """Slopes over particles: frozen and lifted reduced models see none of them."""
    seeing = {**SCALED_RUNS, **PAPER_RUNS}
    return [
        *_guides("∝ N", lambda n: n, [c for c in curves if c.kind.name in seeing], 1),
        *_guides("∝ N⁰", np.ones_like, [c for c in curves if c.kind.name not in seeing], -1),
    ]


def _mode_guides(curves: Sequence[Curve], particle_count: int) -> list[Guide]:
    """Slopes over modes; of frozen models that of the tensor, where it is the cheaper way."""
    guides = [
        *_guides("∝ k", lambda k: k, [c for c in curves if c.kind.name in PAPER_RUNS], 1),
        *_guides("∝ k", lambda k: k, [c for c in curves if c.kind.name in LIFTED_RUNS], -1),
    ]
    for kind, k, quartiles in curves:
        if kind.name.startswith("frozen"):
            n = _freeze_steps(kind.name)
            tensor = partial(_tensor_operations, n_freeze=n)
            cheaper = tensor(k) < particle_count * (2 + 1 / n) * k
            part = Curve(kind, k[cheaper], quartiles[:, cheaper])
            guides += _guides(f"∝ k² + k⁴/{2 * n}", tensor, [part], -1)
    return guides


def _tensor_operations(modes: np.ndarray, n_freeze: int) -> np.ndarray:
    """Operations a step of a frozen model by its tensor (`reduced.rom`), to leading orders."""
    return modes**2 + modes**4 / (2 * n_freeze)


def _guides(
    label: str, law: Callable[[np.ndarray], np.ndarray], curves: Sequence[Curve], side: int
) -> list[Guide]:
    """A line that follows `law` a little above (1) or below (-1) all of the curves, if any."""
    if not sum(len(curve.x) for curve in curves):
        return []
    x = np.concatenate([curve.x for curve in curves]).astype(float)
    ratios = np.concatenate([curve.quartiles[1] for curve in curves]) / law(x)
    level = 1.8 * ratios.max() if side > 0 else ratios.min() / 1.8
    line = np.geomspace(x.min(), x.max(), 41)
    return [Guide(label, line, level * law(line))]


def _draw_curves(axes: Axes, curves: Sequence[Curve], guides: Sequence[Guide]) -> None:
    for _, x, y in guides:
        axes.plot(x, y, color=GREY, linewidth=0.6, zorder=1)
    for kind, x, quartiles in curves:
        draw_bars(axes, quartiles, x, kind.look["color"], along="y", elinewidth=0.6)
        axes.plot(x, quartiles[1], label=kind.label, **kind.look)
    scale_log(axes.xaxis, np.concatenate([curve.x for curve in curves]))
    heights = [curve.quartiles.ravel() for curve in curves] + [guide.y for guide in guides]
    scale_log(axes.yaxis, np.concatenate(heights), room=0.12, few_below=300)


def _label_guides(axes: Axes, guides: Sequence[Guide]) -> None:
    """Write the slopes beside their lines, in the middle if there is room."""
    middle_first = np.argsort(np.abs(np.arange(41) - 20), kind="stable")
    _write_where_free(
        axes,
        [
            Label(label, DIM, list(zip(x[middle_first], y[middle_first], strict=True)))
            for label, x, y in guides
        ],
        away=2.5,
    )
