"""Figures of surveys of parameters, one function a kind, in the style of the other figures."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from sphpod.figures.plotting import (
    BLACK,
    BLUE,
    COLUMN_WIDTH,
    GREEN,
    GREY,
    SKY,
    VERMILLION,
    Arrays,
    styled,
)

PANEL = 1.5
"""Height of a panel [inches]."""

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
    rows, columns = len(quantities), len(parameters)
    figure = Figure(figsize=(COLUMN_WIDTH, 0.5 + PANEL * rows), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False, sharex="col", sharey="row")
    shown = np.unique(np.linspace(0, answers["certified"].size - 1, MOST_DOTS).astype(int))
    for row, (name, label) in zip(panels, quantities.items(), strict=True):
        for axes, (parameter, given) in zip(row, parameters.items(), strict=True):
            x, y = answers[parameter][shown], answers[name][shown]
            certified = answers["certified"][shown] == 1
            for which, color, label in (
                (~certified, GREY, "not certified"),
                (certified, BLUE, "certified"),
            ):
                axes.plot(
                    x[which], y[which], ".", color=color, markersize=2, rasterized=True, label=label
                )
            if given.get("scale") == "logarithmic":
                axes.set_xscale("log")
                ends = given["range"]
                axes.set_xticks(ends, labels=[f"{end:g}" for end in ends])
                axes.minorticks_off()
        row[0].set_ylabel(label)
    for axes, parameter in zip(panels[-1], parameters, strict=True):
        axes.set_xlabel(parameter)
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=2, markerscale=3)
    return figure


@styled
def histograms(answers: Arrays, quantities: Mapping[str, str]) -> Figure:
    """How each quantity is distributed over the queries, with the 5, 50 and 95 % quantiles."""
    figure = Figure(figsize=(COLUMN_WIDTH, 0.3 + PANEL * len(quantities)), layout="constrained")
    panels = np.atleast_1d(figure.subplots(len(quantities), 1))
    for axes, (name, label) in zip(panels, quantities.items(), strict=True):
        known = answers[name][np.isfinite(answers[name])]
        axes.hist(known, bins=min(50, max(5, known.size // 10)), color=SKY)
        for share in (0.05, 0.5, 0.95) if known.size else ():
            axes.axvline(np.quantile(known, share), color=BLACK, linestyle="--", linewidth=0.6)
        axes.set_xlabel(label)
        axes.set_ylabel("queries")
    return figure


@styled
def indices(indices: Arrays) -> Figure:
    """First and total Sobol indices of each quantity, with their 95 % intervals."""
    names, parameters = indices["quantity"], indices["parameter"]
    figure = Figure(figsize=(COLUMN_WIDTH, 0.5 + PANEL), layout="constrained")
    panels = np.atleast_1d(figure.subplots(1, len(names), sharey=True))
    places = np.arange(len(parameters))
    for n, (axes, name) in enumerate(zip(panels, names, strict=True)):
        for kind, color, shift in (("first", BLUE, -0.2), ("total", VERMILLION, 0.2)):
            middle = indices[f"{kind}_index"][n]
            ends = indices[f"{kind}_index_low"][n], indices[f"{kind}_index_high"][n]
            off = np.clip([middle - ends[0], ends[1] - middle], 0, None)
            axes.bar(places + shift, middle, 0.4, color=color, label=kind)
            axes.errorbar(places + shift, middle, off, fmt="none", ecolor=BLACK, linewidth=0.6)
        axes.set_xticks(places, list(parameters), rotation=30, ha="right")
        axes.set_title(str(name))
    panels[0].set_ylabel("Sobol index")
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
        axes.set_ylabel(labels.get(name, name))
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
    axes.set_xlabel("random query, by rising true error")
    axes.set_ylabel("energy norm of the error")
    figure.legend(loc="outside upper center", ncols=2)
    return figure
