"""Figures of surveys of parameters, one function a kind, in the style of the other figures."""

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, NullLocator

from sphpod.figures.plotting import (
    BLACK,
    BLUE,
    COLUMN_WIDTH,
    GREEN,
    GREY,
    ORANGE,
    SKY,
    VERMILLION,
    Arrays,
    styled,
)

PANEL = 1.5
"""Height of a panel [inches]."""

MOST_COLUMNS = 3
"""Panels beside each other."""

ACROSS, UP = 48, 22
"""Letters of a label that stand across a figure, and along the height of a panel."""

MARGIN = 0.05
"""Part of a range that is shown beyond its ends."""

VARIES = 1e-6
"""Part of a quantity's size from which on it is not drawn as if it were constant."""

MOST_DOTS = 2000
"""Queries that a panel shows, evenly picked: more would only be a stain."""

Ranges = Mapping[str, Mapping[str, Any]]


@styled
def responses(answers: Arrays, parameters: Ranges, quantities: Mapping[str, str]) -> Figure:
    """Each quantity against each parameter, certified queries in colour.

    Parameters
    ----------
    answers : dict
        Parameters and quantities (queries,), and certified.
    parameters : dict
        Of each its range and scale.
    quantities : dict
        Label of each quantity that is shown.
    """
    figure, panels = _panels(parameters, quantities)
    shown = np.unique(np.linspace(0, answers["certified"].size - 1, MOST_DOTS).astype(int))
    certified = answers["certified"][shown] == 1
    for (name, parameter), axes in panels.items():
        x, y = answers[parameter][shown], answers[name][shown]
        for which, color, label in (
            (~certified, GREY, "not certified"),
            (certified, BLUE, "certified"),
        ):
            axes.plot(
                x[which], y[which], ".", color=color, markersize=2, rasterized=True, label=label
            )
        _fit(axes, x, y)
    _explain(figure, panels, markerscale=3)
    return figure


@styled
def sections(sections: Arrays, parameters: Ranges, quantities: Mapping[str, str]) -> Figure:
    """Each quantity along each parameter, the others being nominal, within its bound.

    The band of a passage that may never come ends at the top.

    Parameters
    ----------
    sections : dict
        Parameters, and quantities with _low and _high (queries,), as many queries for each
        parameter in turn.
    parameters, quantities
        As in `responses`; of parameters their nominal values too.
    """
    figure, panels = _panels(parameters, quantities)
    for (name, parameter), axes in panels.items():
        part = _part(sections[name].size, list(parameters).index(parameter), len(parameters))
        x = sections[parameter][part]
        low, value, high = (sections[f"{name}{end}"][part] for end in ("_low", "", "_high"))
        top = np.nanmax(np.append(sections[f"{name}_high"], [*sections[name], 0.0]))
        high = np.where(np.isnan(high) & ~np.isnan(low), top, high)
        axes.fill_between(x, low, high, color=SKY, alpha=0.5, linewidth=0, label="within the bound")
        axes.plot(x, value, color=BLUE, linewidth=0.8, label="value")
        _fit(axes, x, low, value, high)
        nominal = parameters[parameter]["nominal"]
        axes.axvline(nominal, color=GREY, linestyle="--", linewidth=0.6, label="nominal")
    _explain(figure, panels)
    return figure


@styled
def surfaces(surfaces: Arrays, parameters: Ranges, quantities: Mapping[str, str]) -> Figure:
    """Each quantity over the two parameters that it depends on most, the others being nominal.

    Parameters
    ----------
    surfaces : dict
        Parameters and quantities (queries,), of as many queries for each block; surface, the block
        of each quantity, (quantities,).
    parameters, quantities
        As in `responses`.
    """
    figure = Figure(figsize=(COLUMN_WIDTH, 0.1 + PANEL * len(quantities)), layout="constrained")
    panels = figure.subplots(len(quantities), 1, squeeze=False)[:, 0]
    blocks = int(surfaces["surface"].max()) + 1
    for n, (axes, (name, label)) in enumerate(zip(panels, quantities.items(), strict=True)):
        part = _part(surfaces[name].size, int(surfaces["surface"][n]), blocks)
        first, second = (word for word in parameters if np.ptp(surfaces[word][part]) > 0)
        x, y = (np.unique(surfaces[word][part]) for word in (first, second))
        values = surfaces[name][part].reshape(x.size, y.size).T
        low, high = _ends(values)
        drawn = axes.pcolormesh(x, y, values, cmap="viridis", vmin=low, vmax=high, rasterized=True)
        _say_if_none(axes, values)
        bar = figure.colorbar(drawn, ax=axes, label=_wrapped(label, UP))
        _numbered(bar.ax, "y")
        _scaled(axes, "x", _wrapped(first, ACROSS), parameters[first])
        _scaled(axes, "y", _wrapped(second, UP), parameters[second])
    return figure


def _part(size, number, parts):
    """Which of all queries are those of a part."""
    count = size // parts
    return slice(number * count, (number + 1) * count)


def _panels(parameters, quantities):
    """A figure with a panel for each parameter of each quantity, by their names."""
    across = min(len(parameters), MOST_COLUMNS)
    rows = -(-len(parameters) // across)
    wrapped = rows > 1
    height = 0.5 + (PANEL + 0.2 * wrapped) * rows * len(quantities)
    figure = Figure(figsize=(COLUMN_WIDTH, height), layout="constrained")
    grid = figure.add_gridspec(rows * len(quantities), across)
    panels: dict[tuple[str, str], Axes] = {}
    for m, (name, label) in enumerate(quantities.items()):
        shared = None
        for n, (parameter, given) in enumerate(parameters.items()):
            row, column = m * rows + n // across, n % across
            shared = axes = figure.add_subplot(grid[row, column], sharey=shared)
            panels[name, parameter] = axes
            last = wrapped or m == len(quantities) - 1
            _scaled(axes, "x", _wrapped(parameter, ACROSS // across) if last else "", given)
            axes.tick_params(labelleft=column == 0, labelbottom=last)
            _numbered(axes, "y")
            if column == 0:
                axes.set_ylabel(_wrapped(label, UP))
    return figure, panels


def _scaled(axes, side, label, given):
    """Label, scale and ends of the axis of a parameter, x or y."""
    axis, ends = getattr(axes, f"{side}axis"), np.array(given["range"], float)
    axis.set_label_text(label)
    if given.get("scale") == "logarithmic":
        axes.set(**{f"{side}scale": "log"})
        axis.set_ticks(ends, labels=[f"{end:g}" for end in ends])
        axis.set_minor_locator(NullLocator())
        beyond = ends * (ends / ends[::-1]) ** MARGIN
    else:
        axis.set_major_locator(MaxNLocator(3, steps=[1, 2, 5, 10]))
        axis.set_major_formatter("{x:g}")
        beyond = ends + MARGIN * (ends - ends[::-1])
    axes.set(**{f"{side}lim": beyond})


def _ends(*values):
    """Least and largest of arrays, far apart where nothing but rounding is between them."""
    known = np.concatenate([each[np.isfinite(each)] for each in values])
    low, high = (known.min(), known.max()) if known.size else (0.0, 1.0)
    size = max(abs(low), abs(high))
    return (low, high) if high - low > VARIES * size else (low - size / 2, high + size / 2)


def _fit(axes, x, *values):
    """Ends of the axis of a quantity that is drawn over x."""
    axes.update_datalim([(x[0], end) for end in _ends(*values)])
    axes.autoscale_view()
    _say_if_none(axes, *values)


def _say_if_none(axes, *values):
    """Say that a panel has nothing to show, as of a passage that never comes."""
    if not any(np.isfinite(each).any() for each in values):
        where = {"transform": axes.transAxes, "ha": "center", "va": "center"}
        axes.text(0.5, 0.5, "no values", color=GREY, **where)


def _wrapped(label, width):
    """A label in lines of so many letters, which end behind underscores where they can."""
    return "\n".join(textwrap.wrap(label.replace("_", "-"), width)).replace("-", "_")


def _numbered(axes, side):
    """Few numbers on the axis of a quantity, and short ones."""
    getattr(axes, f"{side}axis").set_major_locator(MaxNLocator(5))
    axes.ticklabel_format(axis=side, scilimits=(-2, 4))


def _explain(figure, panels, **look):
    handles, labels = next(iter(panels.values())).get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), **look)


@styled
def histograms(answers: Arrays, quantities: Mapping[str, str]) -> Figure:
    """How each quantity is distributed over the queries, with the 5, 50 and 95 % quantiles."""
    figure = Figure(figsize=(COLUMN_WIDTH, 0.3 + PANEL * len(quantities)), layout="constrained")
    panels = np.atleast_1d(figure.subplots(len(quantities), 1))
    for axes, (name, label) in zip(panels, quantities.items(), strict=True):
        known = answers[name][np.isfinite(answers[name])]
        axes.hist(known, bins=min(50, max(5, known.size // 10)), range=_ends(known), color=SKY)
        _say_if_none(axes, known)
        for share in (0.05, 0.5, 0.95) if known.size else ():
            axes.axvline(np.quantile(known, share), color=BLACK, linestyle="--", linewidth=0.6)
        axes.set_xlabel(_wrapped(label, ACROSS))
        axes.set_ylabel("queries")
        _numbered(axes, "x")
    return figure


@styled
def indices(indices: Arrays) -> Figure:
    """First and total Sobol indices of each quantity, with their 95 % intervals."""
    names, parameters = indices["quantity"], indices["parameter"]
    rows = -(-len(names) // MOST_COLUMNS)
    columns = -(-len(names) // rows)
    height = 0.5 + PANEL * (rows + max(map(len, parameters)) / UP)
    figure = Figure(figsize=(COLUMN_WIDTH, height), layout="constrained")
    panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    places = np.arange(len(parameters))
    for axes in panels[len(names) :]:
        axes.remove()
    for n, (axes, name) in enumerate(zip(panels, names, strict=False)):
        for kind, color, shift in (("first", BLUE, -0.2), ("total", VERMILLION, 0.2)):
            middle = indices[f"{kind}_index"][n]
            ends = indices[f"{kind}_index_low"][n], indices[f"{kind}_index_high"][n]
            off = np.clip([middle - ends[0], ends[1] - middle], 0, None)
            axes.bar(places + shift, middle, 0.4, color=color, label=kind)
            axes.errorbar(places + shift, middle, off, fmt="none", ecolor=BLACK, linewidth=0.6)
        _say_if_none(axes, indices["total_index"][n])
        axes.set_xlim(-0.6, len(parameters) - 0.4)
        axes.set_xticks(places, list(parameters), rotation=90)
        axes.tick_params(labelbottom=n + columns >= len(names))
        axes.set_title(_wrapped(str(name), ACROSS // columns))
        if n % columns == 0:
            axes.set_ylabel("Sobol index")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return figure


@styled
def design(design: Arrays, keys: Mapping[str, Any], labels: Mapping[str, str]) -> Figure:
    """What is sought and what keeps to levels along the search, with full runs at the optima.

    Parameters
    ----------
    design : dict
    keys : dict
        The design in the configuration.
    labels : dict
        Label of each quantity; a parameter has its name.
    """
    names = design["designed"]
    figure = Figure(figsize=(COLUMN_WIDTH, 0.6 + PANEL * len(names)), layout="constrained")
    panels = np.atleast_1d(figure.subplots(len(names), 1, sharex=True))
    number = np.arange(1, design["evaluation_excess"].size + 1)
    within = design["evaluation_excess"] <= 1e-6
    ends = number[np.flatnonzero(np.diff(design["evaluation_round"], append=np.inf))]
    levels = {
        **keys["where"],
        **{name: {"": value} for name, value in keys.get("reach", {}).items()},
    }
    for axes, name, values in zip(panels, names, design["evaluation_value"].T, strict=True):
        for which, color, label in ((~within, GREY, "beyond a level"), (within, BLUE, "within")):
            axes.plot(number[which], values[which], ".", color=color, markersize=3, label=label)
        in_full = design.get(f"{name}_full", design.get(name))
        axes.plot(ends, in_full, "o", color=BLACK, markerfacecolor="none", label="full run")
        for level in levels.get(name, {}).values():
            axes.axhline(level, color=VERMILLION, linestyle="--", linewidth=0.8, label="level")
        axes.set_ylabel(_wrapped(labels.get(name, name), UP))
        _numbered(axes, "y")
    panels[-1].set_xlabel("query of the search")
    shown = {label: handle for axes in panels for handle, label in
             zip(*axes.get_legend_handles_labels(), strict=True)}  # fmt: skip
    figure.legend(shown.values(), shown.keys(), loc="outside upper center", ncols=4, markerscale=2)
    return figure


@styled
def errors(validation: Arrays, tolerance: float) -> Figure:
    """True error, estimate and bound of queries that were solved in full, by rising error."""
    order = np.argsort(validation["true_error"])
    number = np.arange(1, order.size + 1)
    figure = Figure(figsize=(COLUMN_WIDTH, 2.4), layout="constrained")
    axes = figure.subplots()
    kinds: Sequence[tuple[str, str, str, str]] = (
        ("true_error", "true error", BLACK, "o"),
        ("relative_estimate", "estimate", GREEN, "x"),
        ("relative_bound", "bound", VERMILLION, "v"),
    )
    for name, label, color, marker in kinds:
        values = validation[name][order]
        axes.plot(number, values, marker, color=color, label=label, markersize=4)
    axes.axhline(tolerance, color=GREY, linestyle="--", linewidth=0.8, label="tolerance")
    axes.set_yscale("log")
    axes.set_xlim(0.5, order.size + 0.5)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    axes.set_xlabel("random query, by rising true error")
    axes.set_ylabel("energy norm of the error")
    figure.legend(loc="outside upper center", ncols=2)
    return figure


@styled
def cost(cost: Arrays) -> Figure:
    """Time of many queries by full and reduced models, with the training, and where it has paid.

    Of lifted full models, all as accurate as the reduced one, the fastest is shown.
    """
    seconds = np.median(cost["query_seconds"], axis=1)
    trained = float(np.median(cost["training_seconds"]))
    rows = {name: np.flatnonzero(cost["contender"] == name) for name in set(cost["contender"])}
    best = rows["lifted_full"][np.argmin(seconds[rows["lifted_full"]])]
    lines = [
        ("full SPH", rows["sph"][0], BLACK, "-"),
        (f"lifted full, {str(cost['integrator'][best]).replace('_', ' ')}", best, BLUE, "-"),
        *(("by Fourier modes", row, ORANGE, "-") for row in rows.get("fourier", ())),
        ("reduced", rows["reduced"][0], GREEN, "--"),
        ("reduced, with bounds", rows["reduced_bounded"][0], VERMILLION, "--"),
    ]
    figure = Figure(figsize=(COLUMN_WIDTH, 2.8), layout="constrained")
    axes = figure.subplots()
    queries = np.logspace(0, 5, 201)
    for label, row, color, style in lines:
        before = 0.0 if style == "-" else trained
        times = before + queries * seconds[row]
        axes.plot(queries, times, style, color=color, label=label, linewidth=1)
    shown = [row for _, row, _, style in lines if style == "-"]
    for name, color in (("break_even_unbounded", GREEN), ("break_even", VERMILLION)):
        even = np.array([(cost[name][row], cost[name][row] * seconds[row]) for row in shown])
        even = even[even[:, 0] <= queries[-1]]
        axes.plot(*even.T, "o", color=color, markerfacecolor="white", markersize=4, zorder=3)
    axes.plot([], [], "o", color=GREY, markerfacecolor="white", markersize=4, label="break-even")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("queries")
    axes.set_ylabel("CPU time with training [s]")
    figure.legend(loc="outside upper center", ncols=2)
    return figure
