"""Figures of the study of stability, one function a kind, in the style of `figures.plotting`.

They show a prediction of theory and a measurement of a run side by side: what is predicted is
hollow or a line, what is measured is filled. Each shows arrays of the study that it is named as, in
whose module `STUDY` describes them (`sphpod.studies`).

Long: each study has its functions under a heading of its own, and all of them share marks and
legends.
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import cycle
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import YAxis
from matplotlib.collections import QuadMesh
from matplotlib.colors import AsinhNorm
from matplotlib.figure import Figure, SubFigure
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, MaxNLocator, NullLocator

from sphpod.figures.benchmark_plots import FROZEN_LOOKS, LIFTED_RUNS, PAPER_RUNS
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
    VERMILLION,
    WORST_ERROR,
    Arrays,
    Look,
    add_legend,
    mark_breakdown,
    scale_log,
    shortened,
    styled,
)

INTEGRATORS = {
    "explicit_euler": "explicit Euler",
    "symplectic_euler": "symplectic Euler",
    "leapfrog": "leapfrog",
    "rk45": "RK45",
    "dop853": "DOP853",
    "exact": "exact in time",
}

MODELS = {
    "sph": "SPH",
    "lifted_full": "SPH, lifted",
    "original": NAMES["original"],
    "linearized": NAMES["linearized"],
    "lifted_euler": "lifted POD",
    "lifted_exact": "lifted POD",
}

ROUNDING = 1e-13
"""A growth rate below this fraction of the norm of its operator is rounding noise."""

CONSERVED = 1e-10
"""Largest relative change of an energy that counts as kept."""

CLOSE = 1e-2
"""Largest relative difference of a measured limit from the predicted one that counts as equal."""

SCENE_LOOKS: tuple[Look, ...] = (
    {"color": BLUE, "marker": "o"},
    {"color": VERMILLION, "marker": "s"},
    {"color": GREEN, "marker": "^"},
    {"color": PURPLE, "marker": "D"},
    {"color": ORANGE, "marker": "v"},
    {"color": SKY, "marker": "P"},
    {"color": BLACK, "marker": "X"},
    {"color": BROWN, "marker": "<"},
    {"color": NAVY, "marker": ">"},
)
"""Looks of scenes, in the order in which they are given."""

Place = tuple[str, ...]
"""Where a table comes from: a scene, or a scene and a sampling of it."""

PREDICTED: Look = {"markersize": 6.5, "fillstyle": "none"}
MEASURED: Look = {"markersize": 3}


def scene_looks(places: Iterable[Place]) -> dict[str, Look]:
    """The look of each scene, in their order."""
    scenes = dict.fromkeys(scene for scene, *_ in places)
    return {
        scene: {"linewidth": 0.7, "markersize": 3, **look}
        for scene, look in zip(scenes, cycle(SCENE_LOOKS))
    }


def _words(name: str) -> str:
    return name.replace("_", " ")


def _model(name: str) -> str:
    """Label of a model.

    Raises
    ------
    ValueError
        It is of no known kind.
    """
    if name.startswith("frozen"):
        return f"frozen for {name.removeprefix('frozen')} steps"
    if name not in MODELS:
        raise ValueError(f"there is no label for the model {name}")
    return MODELS[name]


def _integrator(name: str) -> str:
    if name not in INTEGRATORS:
        raise ValueError(f"there is no label for the integrator {name}")
    return INTEGRATORS[name]


def _given(tables: Mapping[Place, Arrays], kind: str) -> None:
    if not tables:
        raise ValueError(f"a figure of {kind} needs at least one scene")


def _draw_rows(axes: Axes, values: np.ndarray, heights: np.ndarray, look: Look) -> None:
    """Draw positive values on a logarithmic x axis; others on its left edge, infinite on its right.

    A value that is NaN counts as infinite.
    """
    look = {**look, "linestyle": ""}
    finite = np.isfinite(values)
    shown = finite & (values > 0)
    axes.plot(values[shown], heights[shown], **look)
    for outside, edge in ((finite & ~shown, 0), (~finite, 1)):
        if outside.any():
            places = np.full(np.count_nonzero(outside), edge)
            side = axes.get_yaxis_transform()
            axes.plot(places, heights[outside], transform=side, clip_on=False, zorder=3, **look)


def _label_rows(axes: Axes, names: Sequence[str]) -> None:
    """Label the rows 0, 1, ... from above."""
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0, pad=6)
    axes.grid()


def _write_beside(axes: Axes, text: str, ends: Sequence[float], height: float) -> None:
    """Write a text beside the points from the first to the last of `ends`, where there is room."""
    left, right = axes.transAxes.inverted().transform(
        axes.transData.transform([(min(ends), 0), (max(ends), 0)])
    )[:, 0]
    side, end = (1, max(ends)) if left + right < 1 else (-1, min(ends))
    axes.annotate(
        text,
        (end, height),
        xytext=(6 * side, 0),
        textcoords="offset points",
        ha="left" if side > 0 else "right",
        va="center_baseline",
        **NOTE,
    )


def _percent(predicted: float, measured: float) -> str:
    difference = abs(measured / predicted - 1)
    return f"{shortened(100 * difference)} %" if difference else "0 %"


# --- Map ------------------------------------------------------------------------------------------


DRIFT_NOTE = "original POD: faint growth below the limit\nis drift of its density, not instability"


@styled
def stability_map(damping: Arrays, modes: Arrays) -> Figure:
    """Draw growth in a step of runs over time step and damping, and over time step and modes.

    Red grows, blue decays; the line is the limit that the spectrum predicts, where there is one.
    What could not be measured is grey.

    Parameters
    ----------
    damping
        Dampings and time steps are ascending.
    modes
        By contender, mode count and time step.

    Raises
    ------
    ValueError
        A damping is not positive, or an integrator or a model is of no known kind.
    """
    if not np.all(damping["map_damping"] > 0):
        raise ValueError("a map over the logarithm of damping cannot show a damping of zero")
    norm = _growth_norm(np.append(damping["map_growth"], modes["mode_growth"]))
    counts = len(damping["map_integrator"]), len(modes["contender"])
    figure = Figure(figsize=(COLUMN_WIDTH, 1.0 + 1.75 * max(counts)), layout="constrained")
    panels = figure.subplots(max(counts), 2, squeeze=False)
    for column, count in enumerate(counts):
        for axes in panels[count:, column]:
            axes.remove()
    full, reduced = panels[: counts[0], 0], panels[: counts[1], 1]
    for place, (axes, name) in enumerate(zip(full, damping["map_integrator"], strict=True)):
        edges = _edges(damping["map_damping"], logarithmic=True)
        growth, limit = damping["map_growth"][place], damping["map_limit"][place]
        mesh = _draw_map(axes, edges, damping["map_time_step"], growth, norm)
        _draw_limit(axes, damping["map_damping"], limit, damping["map_time_step"])
        scale_log(axes.xaxis, damping["map_damping"])
        axes.set(xlim=edges[[0, -1]], xlabel="damping d [1/s]")
        axes.set_title(f"full model,\n{_integrator(name)}", loc="left")
    for place, (axes, name) in enumerate(zip(reduced, modes["contender"], strict=True)):
        edges = _edges(modes["mode_count"])
        growth, limit = modes["mode_growth"][place], modes["mode_limit"][place]
        mesh = _draw_map(axes, edges, modes["map_time_step"], growth, norm)
        steps = np.ravel((edges[:-1], edges[1:]), "F")
        _draw_limit(axes, steps, np.repeat(limit, 2), modes["map_time_step"])
        axes.set(xlim=edges[[0, -1]], xlabel="number of modes k")
        axes.xaxis.set_major_locator(MaxNLocator(6, integer=True, steps=(1, 2, 5, 10)))
        axes.set_title(f"{_model(name)},\nexplicit Euler", loc="left")
    for axes in full:
        axes.set_ylabel("time step Δt [s]")
    _add_growth_bar(figure, mesh, norm)
    add_legend(figure, full, title=DRIFT_NOTE if "original" in modes["contender"] else None)
    return figure


def _growth_norm(growth: np.ndarray) -> AsinhNorm:
    """Scale of colours about zero, which shows the sign of all but the smallest of the values."""
    sizes = np.abs(growth[np.isfinite(growth) & (growth != 0)])
    if not sizes.size:
        return AsinhNorm(0.1, -1, 1)
    limit = sizes.max()
    return AsinhNorm(max(np.quantile(sizes, 0.02), 1e-7 * limit), -limit, limit)


def _edges(centres: np.ndarray, logarithmic: bool = False) -> np.ndarray:
    """Edges between ascending values, and beyond the first and the last."""
    values = np.log(centres) if logarithmic else np.asarray(centres, float)
    gaps = np.diff(values) if len(values) > 1 else np.ones(1)
    edges = np.concatenate(
        [[values[0] - gaps[0] / 2], values[:-1] + np.diff(values) / 2, [values[-1] + gaps[-1] / 2]]
    )
    return np.exp(edges) if logarithmic else edges


def _draw_map(
    axes: Axes, edges: np.ndarray, time_steps: np.ndarray, growth: np.ndarray, norm: AsinhNorm
) -> QuadMesh:
    """Draw growth of shape (x, time step) as a field over x and time steps."""
    axes.set_facecolor(GREY)
    heights = _edges(time_steps, logarithmic=True)
    # As a vector picture it would have thousands of seams.
    mesh = axes.pcolormesh(
        edges, heights, np.ma.masked_invalid(growth.T), norm=norm, rasterized=True
    )
    scale_log(axes.yaxis, time_steps, few_below=300)
    axes.set_ylim(heights[0], heights[-1])
    return mesh


def _draw_limit(axes: Axes, x: np.ndarray, limit: np.ndarray, time_steps: np.ndarray) -> None:
    """Draw the predicted limit, with a white rim so that it shows on dark colours."""
    axes.plot(x, limit, color="white", linewidth=2.4, solid_capstyle="butt")
    axes.plot(x, limit, color=BLACK, linewidth=1.1, label="predicted limit")
    if not np.any(limit >= time_steps[0]):
        axes.text(0.5, 0.05, "no step is stable", transform=axes.transAxes, ha="center", **NOTE)


def _add_growth_bar(figure: Figure, mesh: QuadMesh, norm: AsinhNorm) -> None:
    label = "logarithm of the amplitude's growth in a step"
    bar = figure.colorbar(mesh, ax=figure.axes, label=label, pad=0.02, aspect=36, location="bottom")
    bar.outline.set_linewidth(0.6)
    lowest, highest = np.log10(norm.linear_width), np.log10(norm.inverse(1))
    powers = np.arange(np.floor(highest), np.ceil(lowest + 0.5) - 1, -1).astype(int)
    # Room for three on either side of zero.
    powers = powers[:: -(-len(powers) // 3) or 1][::-1]
    ticks = [*(-(10.0**power) for power in powers[::-1]), 0, *(10.0**power for power in powers)]
    bar.set_ticks(ticks, labels=[_signed(tick) for tick in ticks])
    bar.minorticks_off()


def _signed(value: float) -> str:
    """A power of ten of either sign, or zero."""
    return "0" if value == 0 else ("−" if value < 0 else "") + shortened(abs(value))


# --- Growth ---------------------------------------------------------------------------------------


HORIZON_LOOKS = SCENE_LOOKS[:3]
BREAKDOWN_LOOK: Look = {"color": BLACK, "marker": "D"}
CONSERVING_LOOKS: dict[str, Look] = {
    "symplectic_euler": {"color": PURPLE, "marker": "v", "markersize": 4},
    "leapfrog": {"color": ORANGE, "marker": "D", "markersize": 3.5},
    "exact": {"color": GREEN, "marker": "o", "markersize": 4},
}


@styled
def growth(scenes: Mapping[Place, Arrays]) -> Figure:
    """Draw energy growth of explicit Euler, breakdown times, and changes of energies that are kept.

    A row a scene. Above, how much energy each run has gained at its end; in the middle, where the
    longest run of a scene breaks down or should, the time at which it does. Hollow markers are
    predicted, filled ones measured; beside them stands their relative difference. An energy that
    does not grow stands on the left edge. Below, how far
    the energy that an integrator keeps moves. Values on the right edge are not finite, on the left
    edge zero.

    Parameters
    ----------
    scenes
        By scene.

    Raises
    ------
    ValueError
        There is no scene, or an integrator is of no known kind.
    """
    _given(scenes, "growth")
    names = [_words(scene) for (scene,) in scenes]
    breaks = {name: _breakdown(scene) for name, scene in scenes.items()}
    several = any(np.isfinite(pair).any() for pair in breaks.values())
    number = len(scenes)
    gains, others = 0.5 + 0.3 * number, 0.5 + 0.2 * number
    ratios = (gains, others, others) if several else (gains, others)
    figure = Figure(figsize=(COLUMN_WIDTH, 0.5 + sum(ratios)), layout="constrained")
    panels = figure.subplots(len(ratios), 1, height_ratios=ratios)
    for axes in panels:
        _label_rows(axes, names)
    _draw_gains(panels[0], scenes)
    if several:
        _draw_breakdowns(panels[1], breaks, max(s["horizon"].max() for s in scenes.values()))
    for kind, size in zip(PAIR, (PREDICTED, MEASURED), strict=True):
        panels[0].plot([], [], "o", color=DIM, label=kind, **size)
    _draw_drifts(panels[-1], scenes)
    add_legend(figure, panels, 3)
    return figure


def _breakdown(scene: Arrays) -> np.ndarray:
    """Predicted and measured time at which the longest run broke down, NaN if it did not."""
    longest = scene["horizon"].argmax()
    times = np.array([scene[f"{kind}_breakdown_time"][longest] for kind in PAIR])
    return np.where(times <= scene["horizon"][longest], times, np.nan)


PAIR = ("predicted", "measured")


def _draw_pair(axes: Axes, pair: np.ndarray, height: float, look: Look, label: str | None) -> None:
    """Draw a predicted and a measured value, joined, and their relative difference beside them."""
    axes.plot(pair, (height, height), color=look["color"], linewidth=0.7)
    for value, kind, size in zip(pair, PAIR, (PREDICTED, MEASURED), strict=True):
        named = label if kind == "measured" else None
        axes.plot(value, height, label=named, **{**look, "linestyle": "", **size})
    if np.isnan(pair).any():
        text = f"only {PAIR[int(np.isnan(pair[0]))]}"
    else:
        text = _percent(*pair) if pair.min() > axes.get_xlim()[0] else "none"
    _write_beside(axes, text, pair[np.isfinite(pair)], height)


def _draw_gains(axes: Axes, scenes: Mapping[Place, Arrays]) -> None:
    horizons = np.unique(np.concatenate([scene["horizon"] for scene in scenes.values()]))
    gains = {
        name: np.array([scene[f"{kind}_energy_growth"] for kind in PAIR]) - 1
        for name, scene in scenes.items()
    }
    whole = {name: np.isfinite(gain[1]) for name, gain in gains.items()}
    values = np.concatenate([gains[name][:, whole[name]].ravel() for name in scenes])
    # A gain below the rounding of an energy is none.
    scale_log(axes.xaxis, values[values > 1e-14], room=0.12)
    axes.set_xlabel("gain of energy, E(T)/E(0) − 1")
    axes.set_title("explicit Euler", loc="left")
    low, middle = axes.get_xlim()[0], np.sqrt(np.prod(axes.get_xlim()))
    labelled: set[float] = set()
    for row, (name, scene) in enumerate(scenes.items()):
        for run, horizon in enumerate(scene["horizon"]):
            place = int(np.searchsorted(horizons, horizon))
            height = row + 0.4 * (place - (len(horizons) - 1) / 2)
            if not whole[name][run]:
                text = f"breaks down before T = {horizon:g} s"
                axes.text(middle, height, text, ha="center", va="center_baseline", **NOTE)
                continue
            look = HORIZON_LOOKS[place % len(HORIZON_LOOKS)]
            label = None if horizon in labelled else f"T = {horizon:g} s"
            labelled.add(horizon)
            _draw_pair(axes, np.maximum(gains[name][:, run], low), height, look, label)


def _draw_breakdowns(axes: Axes, breaks: Mapping[Place, np.ndarray], longest: float) -> None:
    axes.set(xlim=(0, longest), xlabel="time of breakdown [s]")
    axes.set_title("explicit Euler", loc="left")
    label: str | None = "longest run"
    for row, pair in enumerate(breaks.values()):
        if np.isfinite(pair).any():
            _draw_pair(axes, pair, row, BREAKDOWN_LOOK, label)
            label = None
        else:
            axes.text(longest / 2, row, "none", ha="center", va="center_baseline", **NOTE)


def _draw_drifts(axes: Axes, scenes: Mapping[Place, Arrays]) -> None:
    present = set(np.concatenate([scene["conserving"] for scene in scenes.values()]).tolist())
    if unknown := sorted(present - set(CONSERVING_LOOKS)):
        raise ValueError(f"there is no look for energies kept by {unknown[0]}")
    drifts = np.concatenate([scene["energy_drift"] for scene in scenes.values()])
    scale_log(axes.xaxis, np.append(drifts[np.isfinite(drifts)], CONSERVED), room=0.08)
    axes.axvline(CONSERVED, color=DIM, linewidth=0.8, linestyle="--")
    kinds = [name for name in CONSERVING_LOOKS if name in present]
    for place, name in enumerate(kinds):
        offset = 0.26 * (place - (len(kinds) - 1) / 2)
        rows = [
            (float(drift), row + offset)
            for row, scene in enumerate(scenes.values())
            for drift in scene["energy_drift"][scene["conserving"] == name]
        ]
        values, heights = np.array(rows).T
        _draw_rows(axes, values, heights, CONSERVING_LOOKS[name])
        axes.plot([], [], linestyle="", label=INTEGRATORS[name], **CONSERVING_LOOKS[name])
    horizons = np.unique([scene["energy_horizon"] for scene in scenes.values()])
    axes.set_xlabel("largest relative change")
    axes.set_title(f"energies kept, T = {_span(horizons)} s", loc="left")


def _span(values: np.ndarray) -> str:
    """One value, or the smallest and the largest."""
    return " to ".join(f"{value:g}" for value in dict.fromkeys((values.min(), values.max())))


# --- Operators ------------------------------------------------------------------------------------


OPERATORS = {
    "euclidean": "Euclidean modes, at rest",
    "frozen": "Euclidean modes, frozen densities",
    "energy": "energy modes",
}
EXAMPLE: dict[str, tuple[str, Look]] = {
    "paper_energy": ("the paper's form", {"color": VERMILLION}),
    "lifted_energy": ("the lifted form", {"color": GREEN, "linestyle": "--"}),
}


@styled
def operators(
    samplings: Mapping[Place, Arrays], random: Mapping[Place, Arrays], runs: Mapping[Place, Arrays]
) -> Figure:
    """Draw the largest real parts of reduced operators, and a run of one that grows.

    Above, against the number of modes, a line a sampling, in the colour of its scene; the axis is
    logarithmic away from the grey band of rounding. Hollow markers stand at rates that rounding may
    have moved from zero, as it moves eigenvalues of ill-conditioned operators far. Below, the share
    of random bases whose operator grows faster than the abscissa, relative to its norm; and
    energies of a run.

    Parameters
    ----------
    samplings
        Of POD modes, by scene and sampling.
    random
        Of random bases, by scene, any number of them.
    runs
        By scene of random modes, by scene and sampling of POD modes, any number of them.

    Raises
    ------
    ValueError
        There is no sampling.
    """
    _given(samplings, "operators")
    looks = scene_looks([*samplings, *random])
    heights = (4.6, *([1.9] if random else []), *([0.3 + 1.05 * len(runs)] if runs else []))
    figure = Figure(figsize=(COLUMN_WIDTH, sum(heights)), layout="constrained")
    parts = iter(figure.subfigures(len(heights), 1, squeeze=False, height_ratios=heights)[:, 0])
    upper = next(parts)
    panels = upper.subplots(len(OPERATORS), 1, sharex=True, sharey=True)
    broken = _draw_growth_rates(panels, samplings, looks)
    for scene, look in looks.items():
        panels[0].plot([], [], label=_words(scene), **look)
    add_legend(upper, panels, 2, "top edge: not finite" if broken else None)
    if random:
        _draw_random(next(parts), random, looks)
    if runs:
        _draw_runs(next(parts), runs)
    return figure


def _draw_growth_rates(
    panels: Sequence[Axes], samplings: Mapping[Place, Arrays], looks: Mapping[str, Look]
) -> bool:
    """Draw growth rates over mode counts, and return whether any stands on the top edge."""
    band = ROUNDING * max(table["operator_size"].max() for table in samplings.values())
    every = np.concatenate(
        [table[f"{kind}_growth_rate"] for table in samplings.values() for kind in OPERATORS]
    )
    finite = np.isfinite(every)
    _scale_symlog(panels[0].yaxis, every[finite], band)
    for axes, (kind, title) in zip(panels, OPERATORS.items(), strict=True):
        axes.axhspan(-band, band, color=PALE, linewidth=0, label="rounding")
        for (scene, _), table in samplings.items():
            look, rates = looks[scene], table[f"{kind}_growth_rate"]
            counts, known = table["mode_count"], np.isfinite(rates)
            shown = np.where(known, rates, np.nan)
            # Lifted operators are as well-conditioned as the band shows.
            rounding = table.get(f"{kind}_rounding", np.zeros(len(rates)))
            clear = ~(np.abs(rates) <= rounding)
            axes.plot(counts, shown, color=look["color"], linewidth=0.3)
            for chosen, filling in ((clear, "full"), (~clear, "none")):
                some = {**look, "linestyle": "", "fillstyle": filling}
                axes.plot(counts[chosen], shown[chosen], **some)
            mark_breakdown(axes, counts[~known], look)
        axes.set_title(title, loc="left")
        axes.xaxis.set_major_locator(MaxNLocator(5, integer=True, steps=(1, 2, 5, 10)))
    panels[-1].set_xlabel("number of modes k")
    panels[len(panels) // 2].set_ylabel("largest real part [1/s]")
    return not finite.all()


def _scale_symlog(axis: YAxis, values: np.ndarray, band: float) -> None:
    """Make an axis logarithmic in both directions beyond a band about zero."""
    low, high = min(values.min(), -band), max(values.max(), band)
    low, high = 10 * low, 10 * high
    powers = 10.0 ** np.arange(-12, 13, 4)
    powers = powers[powers >= 10 * band]
    ticks = [tick for tick in (*-powers[::-1], 0, *powers) if low <= tick <= high]
    axis.axes.set_yscale("symlog", linthresh=band, linscale=1)
    axis.axes.set_ylim(low, high)
    axis.set_major_locator(FixedLocator(ticks))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: _signed(value)))


def _draw_random(
    figure: SubFigure, random: Mapping[Place, Arrays], looks: Mapping[str, Look]
) -> None:
    """Draw the share of random bases that grow faster than a rate, against that rate."""
    axes = figure.subplots()
    relative = {
        (scene, kind): table[f"random_{kind}_growth_rate"] / table["random_operator_size"]
        for (scene,), table in random.items()
        for kind in ("euclidean", "energy")
    }
    fastest = max(rates.max() for rates in relative.values())
    scale_log(axes.xaxis, np.array([ROUNDING / 1e4, max(fastest, 1)]), room=0)
    low, high = axes.get_xlim()
    axes.axvspan(low, ROUNDING, color=PALE, linewidth=0)
    for (scene, kind), rates in relative.items():
        ascending = np.sort(rates)
        above = 1 - np.arange(1, len(rates) + 1) / len(rates)
        start = np.searchsorted(ascending, low)
        x = np.concatenate([[low], ascending[start:], [high]])
        y = np.concatenate([[1 - start / len(rates)], above[start:], [0]])
        # Few of them grow at all: the lines lie on the axis, and must not be cut by it.
        style: Look = {"linestyle": "-" if kind == "euclidean" else ":", "clip_on": False}
        axes.plot(x, y, drawstyle="steps-post", color=looks[scene]["color"], **style)
    count = sum(len(table["random_operator_size"]) for table in random.values())
    axes.set(
        ylim=(0, 1),
        xlabel="largest real part / norm of the operator",
        ylabel="share that grows faster",
    )
    axes.set_title(f"{count} random bases", loc="left")
    for label, line in (("Euclidean modes", "-"), ("energy modes", ":")):
        axes.plot([], [], color=DIM, linestyle=line, label=label)
    add_legend(figure, [axes])


def _draw_runs(figure: SubFigure, runs: Mapping[Place, Arrays]) -> None:
    """Energies of runs, a panel each."""
    panels = figure.subplots(len(runs), 1, squeeze=False)[:, 0]
    broken = False
    for axes, (place, run) in zip(panels, runs.items(), strict=True):
        time = run["t"]
        drawn = []
        for name, (label, look) in EXAMPLE.items():
            energy = run[name] / run[name][0]
            finite = np.isfinite(energy)
            axes.plot(time, np.where(finite, energy, np.nan), label=label, **look)
            mark_breakdown(axes, time[~finite][:1], {**look, "marker": "X"})
            drawn.append(energy[finite])
            broken |= not finite.all()
        scale_log(axes.yaxis, np.concatenate(drawn))
        if np.divide(*axes.get_ylim()[::-1]) > 1e3:
            # The panel is low.
            axes.yaxis.set_major_locator(LogLocator(numticks=5))
        axes.set(xlim=time[[0, -1]], ylabel="E(t)/E(0)")
        scene, *sampling = place
        kind = f"POD modes of {sampling[0]}" if sampling else "random modes"
        axes.set_title(f"{_words(scene)}, {kind}: energy", loc="left")
    panels[-1].set_xlabel("time t [s]")
    add_legend(figure, panels[:1], 2, "top edge: broken down" if broken else None)


# --- Smoothing ------------------------------------------------------------------------------------


@styled
def smoothing(scenes: Mapping[Place, Arrays]) -> Figure:
    """Draw what the smoothing length does to derivative, time step, neighbours and errors.

    The scenes' own smoothing ratios are marked, on their curves of errors too. Above, what belongs
    to the kernel alone; the stable time steps of all scenes lie on each other where their materials
    are even. Below, errors of full SPH; those that are not finite, or above 10³, stand on the top
    edge. Ratios are spread by the
    logarithm of their distance from one, which parts those of the paper.

    Parameters
    ----------
    scenes
        By scene; `smoothing_ratio` is above 1 and alike for all.

    Raises
    ------
    ValueError
        There is no scene, or a ratio is not above 1.
    """
    _given(scenes, "smoothing lengths")
    for (name,), scene in scenes.items():
        if not np.all(scene["smoothing_ratio"] > 1):
            raise ValueError(f"{name} has smoothing ratios that are not above 1")
    figure = Figure(figsize=(COLUMN_WIDTH, 7.2), layout="constrained")
    panels = figure.subplots(4, 1, sharex=True)
    first = next(iter(scenes.values()))
    ratios = first["smoothing_ratio"]
    own = sorted({float(scene["scene_smoothing_ratio"]) for scene in scenes.values()})
    usual = np.abs(ratios - own[0]).argmin()
    beta, stable = panels[:2]
    beta.axhline(1, color=GREY, linewidth=0.6)
    beta.plot(ratios, first["derivative_coefficient"], color=BLUE)
    _name_axis(beta, "derivative coefficient β (solid)", BLUE)
    dispersion = beta.twinx()
    dispersion.plot(ratios, first["dispersion_coefficient"], color=VERMILLION, linestyle="--")
    _name_axis(dispersion, "dispersion coefficient (dashed)", VERMILLION)
    for scene in scenes.values():
        step = scene["stable_time_step"]
        stable.plot(scene["smoothing_ratio"], step / step[usual], color=BLUE)
    _name_axis(stable, f"stable time step,\nof that at {ratios[usual]:g} (solid)", BLUE)
    neighbours = stable.twinx()
    neighbours.plot(
        ratios, first["neighbour_count"], color=VERMILLION, linestyle="--", drawstyle="steps-post"
    )
    _name_axis(neighbours, "neighbours per side (dashed)", VERMILLION)
    neighbours.yaxis.set_major_locator(MaxNLocator(integer=True))
    looks = scene_looks(scenes)
    broken = [_draw_smoothing_errors(axes, scenes, looks, field)
              for axes, field in zip(panels[2:], FIELDS, strict=True)]  # fmt: skip
    for axes in panels:
        _scale_ratios(axes, np.append(ratios, own), own)
    panels[-1].set_xlabel("smoothing ratio α = h/Δx")
    add_legend(figure, panels[2:], 2, BREAKDOWN_NOTE if any(broken) else None)
    return figure


def _name_axis(axes: Axes, name: str, colour: str) -> None:
    axes.set_ylabel(name, color=colour)
    axes.tick_params(axis="y", colors=colour)


def _draw_smoothing_errors(
    axes: Axes, scenes: Mapping[Place, Arrays], looks: Mapping[str, Look], field: str
) -> bool:
    """Draw errors of a field, and return whether any stands on the top edge."""
    drawn = []
    broken = False
    for (name,), scene in scenes.items():
        values = scene[f"smoothing_{field}_error"]
        bad = values > WORST_ERROR
        axes.plot(scene["smoothing_ratio"], np.where(bad, np.nan, values),
                  label=_words(name), **{**looks[name], "markersize": 2.5})  # fmt: skip
        mark_breakdown(axes, scene["smoothing_ratio"][bad], looks[name])
        drawn.append(values[values <= WORST_ERROR])
        broken |= bool(bad.any())
    for (name,), scene in scenes.items():
        ratios, values = scene["smoothing_ratio"], scene[f"smoothing_{field}_error"]
        own = np.isclose(ratios, scene["scene_smoothing_ratio"]) & (values <= WORST_ERROR)
        look = {"marker": "o", "fillstyle": "none", "markersize": 7, "linestyle": ""}
        axes.plot(ratios[own], values[own], **{**look, "color": looks[name]["color"]})
    scale_log(axes.yaxis, np.concatenate(drawn))
    axes.set_ylabel(f"relative L² error of {field}")
    return broken


def _spread(ratios: np.ndarray) -> np.ndarray:
    # Axes try values at which they never draw.
    return np.log10(np.maximum(ratios - 1, 1e-9))


def _scale_ratios(axes: Axes, ratios: np.ndarray, own: Sequence[float]) -> None:
    """Spread smoothing ratios by their distance from one, and mark those that scenes have."""
    low, high = 1 + (ratios.min() - 1) / 1.15, 1 + (ratios.max() - 1) * 1.15
    axes.set_xscale("function", functions=(_spread, lambda place: 1 + 10**place))
    axes.set_xlim(low, high)
    ticks = [tick for tick in (1.01, 1.02, 1.05, 1.1, 1.2, 1.5, 2, 3) if low <= tick <= high]
    axes.xaxis.set_major_locator(FixedLocator(ticks))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
    places = (_spread(np.array(own)) - _spread(low)) / (_spread(high) - _spread(low))
    labelled = -1.0
    for n, (ratio, place) in enumerate(zip(own, places, strict=True)):
        # Two that are close stand on either side of their lines.
        near_next = n + 1 < len(own) and places[n + 1] - place < 0.12
        near_last = n > 0 and place - places[n - 1] < 0.12
        side = "left" if near_last else "right" if near_next else "center"
        axes.axvline(ratio, color=DIM, linewidth=0.6, linestyle=":")
        start = place - {"left": 0, "center": 0.05, "right": 0.1}[side]
        if start < labelled:
            continue
        labelled = start + 0.1
        axes.annotate(f"{ratio:g}", (ratio, 1), xycoords=axes.get_xaxis_transform(),
                      xytext=(0, 2), textcoords="offset points", ha=side, **NOTE)  # fmt: skip


# --- Amplitude ------------------------------------------------------------------------------------


FULL_MODELS = ("sph", "lifted_full")
AMPLITUDE_RUNS: dict[str, tuple[str, Look]] = {
    **PAPER_RUNS,
    # Around the marker of the linearized model, which it hardly differs from.
    "frozen10": (
        "frozen for 10 steps",
        {**FROZEN_LOOKS[0], "markerfacecolor": "none", "markersize": 7},
    ),
    **LIFTED_RUNS,
}


@styled
def amplitude(amplitude: Arrays) -> Figure:
    """Draw errors of reduced models against the largest compression, 1 - J, that full SPH reaches.

    The upper axis shows by what factor the initial velocity is scaled. Where full SPH breaks down,
    no error can be given. An error that is infinite, or above 10³, stands on the top edge.

    Parameters
    ----------
    amplitude
        Amplitudes are ascending; full models are not shown.

    Raises
    ------
    ValueError
        A contender is of no known kind, or full SPH stands at no amplitude.
    """
    if unknown := sorted(set(amplitude["contender"].tolist()) - {*FULL_MODELS, *AMPLITUDE_RUNS}):
        raise ValueError(f"there is no look for runs of {unknown[0]}")
    compression = 1 - amplitude["smallest_jacobian"]
    whole = (compression > 0) & (compression < 1)
    if not whole.any():
        raise ValueError("full SPH breaks down, or strains nothing, at every amplitude")
    figure = Figure(figsize=(COLUMN_WIDTH, 5.2), layout="constrained")
    panels = figure.subplots(2, 1)
    broken = False
    for axes, field, symbol in zip(panels, FIELDS, "vρ", strict=True):
        drawn = []
        for name, (label, look) in AMPLITUDE_RUNS.items():
            look = {"markersize": 3.5, "linewidth": 0.7, **look}
            for errors in amplitude[f"scaled_{field}_error"][amplitude["contender"] == name]:
                values = errors[whole]
                bad = values > WORST_ERROR
                axes.plot(compression[whole], np.where(bad, np.nan, values), label=label, **look)
                mark_breakdown(axes, compression[whole][bad], look)
                drawn.append(values[~bad])
                broken |= bool(bad.any())
        scale_log(axes.xaxis, np.append(compression[whole], 1), few_below=300)
        scale_log(axes.yaxis, np.concatenate(drawn))
        axes.axvspan(1, axes.get_xlim()[1], color=PALE, linewidth=0)
        axes.set(
            xlabel="largest compression 1 − min J", ylabel=f"relative L² error of {field} {symbol}"
        )
        _add_factors(axes, compression[whole], amplitude["amplitude"][whole])
    title = "errors against full SPH;\nof the model exact in time, against lifted SPH"
    folding = float(amplitude["folding_amplitude"])
    if np.isfinite(folding):
        title += f"\nshaded: J ≤ 0 in full SPH, from {shortened(folding)} v₀"
    if broken:
        title += f"\n{BREAKDOWN_NOTE}"
    add_legend(figure, panels, 2, title)
    return figure


def _add_factors(axes: Axes, compression: np.ndarray, factors: np.ndarray) -> None:
    """Tell along the upper edge by what factor v0 is scaled where full SPH is compressed so far."""
    decades = np.arange(np.floor(np.log10(factors.min())), np.log10(factors.max()) + 1)
    few = factors.max() / factors.min() < 300
    nice = np.outer(10.0**decades, (1, 2, 5) if few else (1,)).ravel()
    nice = nice[(nice >= factors.min()) & (nice <= factors.max())]
    places = np.exp(np.interp(np.log(nice), np.log(factors), np.log(compression)))
    upper = axes.secondary_xaxis("top")
    upper.set_xlabel("factor of the initial velocity")
    upper.xaxis.set_major_locator(FixedLocator(places))
    upper.xaxis.set_minor_locator(NullLocator())
    upper.set_xticks(places, [f"{factor:g}" for factor in nice])


# --- Snapshots ------------------------------------------------------------------------------------


NOISE_CURVES: dict[str, tuple[str, Look]] = {
    "noise_original_error": (
        "original POD, error",
        {**PAPER_RUNS["original"][1], "linestyle": "-."},
    ),
    "noise_bound": (
        "lifted POD, bound",
        {"color": GREEN, "marker": "s", "markersize": 5, "fillstyle": "none", "linestyle": "--"},
    ),
    "noise_error": ("lifted POD, error", {"color": GREEN, "marker": "o", "markersize": 3}),
}


@styled
def poor_snapshots(snapshots: Arrays) -> Figure:
    """Draw errors and bounds against the noise of snapshots, and for other defects of them.

    Bounds are hollow, errors filled. Of a model that is refused, or breaks down, neither is finite:
    why is said in words. A single value that is not finite, or above 10³, stands on the edge.

    Raises
    ------
    ValueError
        A noise is not positive.
    """
    if not np.all(snapshots["noise"] > 0):
        raise ValueError("a logarithmic axis cannot show snapshots without noise")
    outcomes = [
        fill(_without_scene(text), 34) if np.isinf(smallest) else ""
        for text, smallest in zip(
            snapshots["defect_outcome"], _defects(snapshots).min(axis=1), strict=True
        )
    ]
    # Two lines at least: a name, and its numbers of modes.
    lines = np.array([max(2, 1 + text.count("\n")) for text in outcomes])
    rows = 0.5 + 0.09 + 0.11 * (lines + 0.5).sum()
    figure = Figure(figsize=(COLUMN_WIDTH, 2.4 + rows), layout="constrained")
    upper, lower = figure.subfigures(2, 1, squeeze=False, height_ratios=(2.4, rows))[:, 0]
    panels = upper.subplots(), lower.subplots()
    broken = _draw_noise(panels[0], snapshots)
    broken |= _draw_defects(panels[1], snapshots, outcomes, lines)
    note = "top or right edge: above 10³ or not finite" if broken else None
    add_legend(upper, panels, 2, note)
    return figure


def _without_scene(text: str) -> str:
    """A message without the name of the scene that it begins with."""
    return text.partition(": ")[2] if text.startswith("scene ") else text


def _defects(snapshots: Arrays) -> np.ndarray:
    """Error and bound of each defect, shape (defects, 2), infinite where they are of no use."""
    pairs = np.column_stack([snapshots["defect_error"], snapshots["defect_bound"]])
    return np.where(pairs <= WORST_ERROR, pairs, np.inf)


def _draw_noise(axes: Axes, snapshots: Arrays) -> bool:
    """Draw errors and bounds against noise, and return whether any stands on the top edge."""
    drawn = []
    broken = False
    for name, (label, look) in NOISE_CURVES.items():
        values = snapshots[name]
        bad = values > WORST_ERROR
        look = {"linewidth": 0.8, **look}
        axes.plot(snapshots["noise"], np.where(bad, np.nan, values), label=label, **look)
        mark_breakdown(axes, snapshots["noise"][bad], look)
        drawn.append(values[values <= WORST_ERROR])
        broken |= bool(bad.any())
    scale_log(axes.xaxis, snapshots["noise"])
    scale_log(axes.yaxis, np.concatenate(drawn))
    axes.set(xlabel="relative noise of the snapshots", ylabel="relative error, and its bound")
    return broken


def _draw_defects(
    axes: Axes, snapshots: Arrays, outcomes: Sequence[str], lines: np.ndarray
) -> bool:
    """Draw a row for each defect, and return whether any value stands on the right edge.

    Rows are as high as the lines of their outcomes; the latter are empty where there are values.
    """
    pairs = _defects(snapshots)
    ends = np.cumsum(lines + 0.5)
    heights = ends - (lines + 0.5) / 2
    scale_log(axes.xaxis, pairs[np.isfinite(pairs)], room=0.08)
    names = [
        f"{_words(defect)},\nk = {count}" + f", rank {rank}" * bool(rank)
        for defect, count, rank in zip(
            *(snapshots[f"defect{part}"] for part in ("", "_mode_count", "_rank")), strict=True
        )
    ]
    axes.set_yticks(heights, names)
    axes.set_ylim(ends[-1], 0)
    axes.tick_params(axis="y", length=0, pad=6)
    axes.grid()
    axes.set_xlabel("relative error, and its bound")
    middle = np.sqrt(np.prod(axes.get_xlim()))
    look: Look
    for height, pair, text in zip(heights, pairs, outcomes, strict=True):
        if text:
            axes.text(middle, height, text, ha="center", va="center", **NOTE)
            continue
        span = np.minimum(pair, axes.get_xlim()[1])
        axes.plot(span, (height, height), color=GREEN, linewidth=0.8)
        for value, name in zip(pair, ("noise_error", "noise_bound"), strict=True):
            look = NOISE_CURVES[name][1]
            _draw_rows(axes, np.array([value]), np.array([height]), look)
    return bool((np.isinf(pairs).sum(axis=1) == 1).any())


# --- Limits ---------------------------------------------------------------------------------------


QUANTITIES: dict[str, tuple[str, Look]] = {
    "time_step": ("limit of the time step", {"markersize": 3}),
    "growth_rate": (
        "growth rate",
        {"markersize": 3.5, "fillstyle": "none", "markeredgewidth": 0.6},
    ),
}


@styled
def time_steps(tables: Mapping[Place, Arrays]) -> Figure:
    """Draw how far measured stability is from the predicted, by model and integrator.

    Filled markers compare limits of the time step, hollow ones growth rates where no step is
    stable; scenes lie below each other in a row. Where only one of prediction and measurement
    speaks of a limit, or of growth, the marker stands on the right edge; on the left edge, both are
    equal, as where neither limits the time step.

    Parameters
    ----------
    tables
        By scene, or by scene and sampling, one entry a model.

    Raises
    ------
    ValueError
        There is no table, or a model or an integrator is of no known kind.
    """
    _given(tables, "limits")
    looks = scene_looks(tables)
    labels = {
        (model, integrator): f"{_model(model)},\n{_integrator(integrator)}"
        for table in tables.values()
        for model, integrator in zip(
            table["contender"].tolist(), table["integrator"].tolist(), strict=True
        )
    }
    places = {pair: row for row, pair in enumerate(sorted(labels, key=_model_order))}
    figure = Figure(figsize=(COLUMN_WIDTH, 1.9 + 0.3 * len(labels)), layout="constrained")
    axes = figure.subplots()
    offsets = dict(zip(looks, np.linspace(-0.32, 0.32, len(looks) + 2)[1:-1], strict=True))
    drawn = []
    for (scene, *_), table in tables.items():
        rows = np.array([
            places[pair] for pair in zip(
                table["contender"].tolist(), table["integrator"].tolist(), strict=True)
        ])  # fmt: skip
        for quantity, (_, size) in QUANTITIES.items():
            predicted, measured = (table[f"{kind}_{quantity}"] for kind in PAIR)
            known = ~(np.isnan(predicted) & np.isnan(measured))
            difference = _difference(predicted, measured)[known]
            heights = rows[known] + offsets[scene]
            drawn.append((difference, heights, {**looks[scene], **size}))
    finite = np.concatenate([difference for difference, _, _ in drawn])
    scale_log(axes.xaxis, np.append(finite[np.isfinite(finite)], CLOSE))
    for difference, heights, look in drawn:
        _draw_rows(axes, difference, heights, look)
    _label_rows(axes, [labels[pair] for pair in places])
    axes.set_xlabel("relative difference of measured from predicted")
    notes = [
        (not finite.all(), "left edge: equal, or neither has a limit"),
        (not np.isfinite(finite).all(), "right edge: only one of them has a limit"),
    ]
    axes.set_title("\n".join(note for holds, note in notes if holds), loc="right")
    for scene, scene_look in looks.items():
        axes.plot([], [], linestyle="", label=_words(scene), **scene_look)
    for label, size in QUANTITIES.values():
        axes.plot([], [], "o", color=DIM, label=label, **size)
    axes.axvline(CLOSE, color=DIM, linewidth=0.8, linestyle="--", label="1 %")
    add_legend(figure, [axes], 2)
    return figure


def _difference(predicted: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """Relative difference of measurements; 0 where both are infinite, infinite where only one."""
    both = np.isfinite(predicted) & np.isfinite(measured)
    ratio = np.divide(measured, predicted, out=np.full(len(both), np.inf), where=both)
    return np.where(predicted == measured, 0, np.abs(ratio - 1))


def _model_order(pair: tuple[str, str]) -> tuple[int, int, int]:
    """Full models first, then reduced ones; frozen ones by the steps they are frozen for."""
    model, integrator = pair
    frozen = model.startswith("frozen")
    place = list(MODELS).index("linearized" if frozen else model)
    return (
        place,
        int(model.removeprefix("frozen")) if frozen else 0,
        list(INTEGRATORS).index(integrator),
    )
