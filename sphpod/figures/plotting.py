"""Figures, one function a kind; each takes arrays named as in `pipeline.dataset`, returns a Figure.

Every figure is drawn at its final size with one style sheet, so its text has the size it will have
in print. Labels are plain Unicode in one font; only the schematic typesets mathematics. That keeps
drawing cheap and the files small. Captions belong to the configuration, not to the pictures.

Long: one function for each kind of figure, and the scales and marks that all of them share.
"""

import os
from collections.abc import Iterable, Mapping, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import XAxis, YAxis
from matplotlib.colors import (
    AsinhNorm,
    Colormap,
    LinearSegmentedColormap,
    ListedColormap,
    Normalize,
)
from matplotlib.figure import Figure, SubFigure
from matplotlib.gridspec import GridSpec
from matplotlib.patches import Circle
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from sphpod.numerics.error import FIELDS, Arrays
from sphpod.pipeline import dataset

Look = Mapping[str, Any]  # keyword arguments of Axes.plot

STYLE = Path(__file__).with_name("style.mplstyle")
styled = matplotlib.style.context(["default", STYLE])

COLUMN_WIDTH = 3.3  # inches: one column of a two-column page; panels stand below each other
SMALL = 6  # points: the smallest text
PANEL_POINTS = 190  # width of a panel, about
PANEL_HEIGHT = 115  # and its height in a figure of acceleration

# Okabe and Ito's palette and two darker shades: blues for the velocity, reds for the density.
BLACK, DIM, GREY, PALE = "#000000", "#666666", "#A6A6A6", "#D9D9D9"
BLUE, SKY, NAVY = "#0072B2", "#56B4E9", "#00324F"
VERMILLION, ORANGE, BROWN = "#D55E00", "#E69F00", "#7A3500"
GREEN, PURPLE = "#009E73", "#CC79A7"

ROUNDING = 1e-12
"""A Fourier amplitude below this fraction of the largest is rounding noise."""

TURNED = 1e-2
"""A mode, or a span of modes, that rounding turns by more than `pod.ROUNDING_LEVEL` is grey."""

ONE_SIDED = 0.02
"""A field whose values of one sign stay below this part of the others' has half of the colours."""

MOST_VALUES = 30
"""Singular values that are drawn large; all of more stand in an inset."""

SIGNED = LinearSegmentedColormap.from_list(
    "signed", ("#00324F", "#0072B2", "#8C8C8C", "#E69F00", "#FFF6D6")
)
"""Ever lighter from the lowest value to the highest, so that the sign shows without colours too."""

Layers = Sequence[tuple[float, str]]
"""Start [m] and name of each layer of a material."""

WORST_ERROR = 1e3
"""A relative error above this, or none at all, only says that the model broke down."""

BREAKDOWN_NOTE = "top edge: error above 10³, or broken down"

UNRESOLVED_LABEL = "modes near rounding"

WHITE_BOX = {"facecolor": "white", "edgecolor": "none", "pad": 0.5}
NOTE: Look = {"color": DIM, "fontsize": SMALL, "zorder": 2, "bbox": WHITE_BOX}
"""Look of a text beside what is drawn."""

SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")


@styled
def save(
    figure: Figure, pdf_path: str | os.PathLike[str], png_path: str | os.PathLike[str]
) -> None:
    """Write a figure as vector PDF and as 300 dpi PNG, each whole or not at all.

    No date and no program name goes into the files: the same figure gives the same bytes.
    """
    with dataset.whole(pdf_path) as partial:
        figure.savefig(partial, format="pdf", metadata={"CreationDate": None})
    # The layout found for the first file serves both: finding it costs as much as drawing.
    figure.set_layout_engine("none")
    with dataset.whole(png_path) as partial:
        figure.savefig(partial, format="png", metadata={"Software": None})


# --- Schematic ------------------------------------------------------------------------------------


@styled
def spring() -> Figure:
    """Draw mass points, springs and dampers of section 2.1, joined periodically (figure 2.1)."""
    figure = Figure(figsize=(COLUMN_WIDTH, 1.04))
    axes = figure.add_axes((0, 0, 1, 1), xlim=(-0.4, 7.4), ylim=(-1.27, 1.19), aspect="equal")
    axes.axis("off")
    names = ("N−1", "0", "···", "n", "n+1", "···", "N−1", "0")
    radius = 0.31
    # A spring of unit length.
    along = np.concatenate(([0, 0.14], np.linspace(0.18, 0.82, 9), [0.86, 1]))
    across = np.concatenate(([0, 0], 0.13 * np.array([1, -1] * 4 + [1]), [0, 0]))
    for place, name in enumerate(names):
        if place:
            start, gap = place - 1 + radius, 1 - 2 * radius
            axes.plot(start + gap * along, across, color=ORANGE, linewidth=1.1)
        if name == "···":
            axes.text(place, 0, name, fontsize=12, ha="center", va="center")
            continue
        # Beyond the periodic boundary stand images of the points at the other end: hollow.
        image = place in (0, len(names) - 1)
        face, ink = ("white", BLUE) if image else (BLUE, "white")
        axes.add_patch(Circle((place, 0), radius, facecolor=face, edgecolor=BLUE))
        axes.text(place, 0, name, color=ink, fontsize=SMALL, ha="center", va="center_baseline")
        if not image:
            _draw_damper(axes, place, -radius)
    for at, height, label in (
        (2.47, -0.45, "$k_{n-1/2}$"),
        (3, 0.42, "$m_n$"),
        (3.53, -0.45, "$k_{n+1/2}$"),
        (4, 0.42, "$m_{n+1}$"),
        (3.35, -0.95, "$d_n$"),
        (4.48, -0.95, "$d_{n+1}$"),
    ):
        axes.text(at, height, label, ha="center")
    for edge in (0.5, 6.5):
        axes.plot((edge, edge), (-0.45, 1.05), color=GREY, linestyle=":")
    axes.annotate(
        "",
        (0.5, 0.98),
        (6.5, 0.98),
        arrowprops={"arrowstyle": "<->", "linewidth": 0.6, "shrinkA": 0, "shrinkB": 0},
    )
    axes.text(3.5, 0.98, "one period, $L$", ha="center", va="center", backgroundcolor="white")
    return figure


def _draw_damper(axes: Axes, place: float, top: float) -> None:
    """Hang a dashpot under a mass point, from `top` down to hatched ground."""
    look: Look = {"color": BLACK, "linewidth": 0.7, "solid_capstyle": "butt"}
    half, ground = 0.11, top - 0.78
    axes.plot((place, place), (top, top - 0.34), **look)
    axes.plot((place - 0.8 * half, place + 0.8 * half), (top - 0.34, top - 0.34), **look)
    walls = (place - half, place - half, place + half, place + half)
    axes.plot(walls, (top - 0.22, top - 0.52, top - 0.52, top - 0.22), **look)
    axes.plot((place, place), (top - 0.52, ground), **look)
    axes.plot((place - 0.22, place + 0.22), (ground, ground), **look)
    for stroke in np.linspace(-0.18, 0.22, 5):
        axes.plot((place + stroke, place + stroke - 0.08), (ground, ground - 0.08), **look)


# --- Profiles -------------------------------------------------------------------------------------


@styled
def profile(
    solution: Arrays,
    fields: Sequence[str] = ("initial_velocity", "velocity"),
    length: float | None = None,
    end_time: float | None = None,
    layers: Layers = (),
) -> Figure:
    """Draw the initial velocity and space-time pictures of a solution (figures 3.1, 3.18, ...).

    Parameters
    ----------
    solution
        `t` [s], evenly spaced from 0, `x` [m], `velocity` [m/s] and, for a picture of it,
        `density` [kg/m³], both of shape (t, x).
    fields
        A panel each, from above: `initial_velocity`, `velocity` or `density_change`.
    length
        Length of the periodic domain [m], or of a bar with ends; needed of such a bar, and where
        particles are not evenly spaced.
    end_time
        Latest time that is shown [s]; all of them if it is not given.
    layers
        Of a material that jumps.

    Raises
    ------
    ValueError
        A field is none of the three.
    """
    end = solution["t"][-1] if end_time is None else end_time * (1 + 1e-9)
    shown = _shown(int(np.count_nonzero(solution["t"] <= end)))
    length = length or _length(solution["x"])
    figure = Figure(figsize=(COLUMN_WIDTH, 1.95 * len(fields)), layout="constrained")
    panels = figure.subplots(len(fields), 1, squeeze=False)[:, 0]
    for axes, field in zip(panels, fields, strict=True):
        if field == "initial_velocity":
            _draw_profile(axes, solution["x"], solution["velocity"][0], length)
        elif field == "velocity":
            velocity = solution["velocity"][shown]
            _draw_picture(axes, solution, shown, velocity, "velocity v", "m/s", length)
        elif field == "density_change":
            change = solution["density"][shown] - solution["density"][0]
            _draw_picture(axes, solution, shown, change, "density ρ − ρ₀", "kg/m³", length)
        else:
            raise ValueError(
                f"a profile shows initial_velocity, velocity or density_change, not {field!r}"
            )
        axes.set(xlim=(0, length), xlabel="position x [m]")
        _mark_layers(axes, layers, length, named=True)
    return figure


def _mark_layers(axes: Axes, layers: Layers, length: float, named: bool) -> None:
    """Lines where a material jumps, and above the axes what lies between them."""
    ends = [start for start, _ in layers[1:]] + [start + length for start, _ in layers[:1]]
    for (start, name), end in zip(layers, ends, strict=True):
        if 0 < start < length:
            axes.axvline(start, color=BLACK, linewidth=0.6, linestyle=(0, (4, 2)))
        if named:
            inside = min(end, length)
            place = axes.get_xaxis_transform()
            look: Look = {"ha": "center", "va": "bottom", "fontsize": SMALL, "transform": place}
            axes.text((start + inside) / 2, 1.02, name, **look)


def _shown(count: int, most: int = 601) -> np.ndarray:
    """Indices of `count` times, thinned to `most` of them, first and last included."""
    return np.linspace(0, count - 1, min(count, most)).round().astype(int)


def _length(x: np.ndarray) -> float:
    """Length of the periodic domain with evenly spaced particles at x [m]."""
    return float(x[-1] + x[1] - 2 * x[0])


def _closed(x: np.ndarray, values: np.ndarray, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Places and values (..., x) up to the length: the point there is the one at 0, or is there."""
    if np.isclose(x[-1], length):
        return x, values
    return np.append(x, length), np.concatenate((values, values[..., :1]), axis=-1)


def _unit(values: np.ndarray, unit: str) -> tuple[float, str]:
    """Power of 1000 that brings the largest value between 0.1 and 100, and the unit it leaves."""
    largest = np.abs(values).max()
    exponent = 3 * int(np.floor((np.log10(largest) + 1) / 3)) if largest > 0 else 0
    return 10.0**-exponent, unit if exponent == 0 else f"{_power_of_ten(exponent)} {unit}"


def _power_of_ten(exponent: int) -> str:
    return "10" + str(exponent).translate(SUPERSCRIPTS)


def shortened(value: float) -> str:
    """Two digits, with a power of ten where needed: 0.12, 1.2×10⁻³, 10⁻⁴."""
    if 0.001 <= value < 100:
        return f"{value:.2g}"
    mantissa, exponent = f"{value:.1e}".split("e")
    power = _power_of_ten(int(exponent))
    return power if mantissa == "1.0" else f"{mantissa.removesuffix('.0')}×{power}"


def _tick(value: float, short: bool) -> str:
    return shortened(value) if short else _power_of_ten(round(np.log10(value)))


def _draw_profile(axes: Axes, x: np.ndarray, velocity: np.ndarray, length: float) -> None:
    factor, unit = _unit(velocity, "m/s")
    axes.axhline(0, color=GREY, linewidth=0.6)
    places, velocity = _closed(x, velocity, length)
    axes.plot(places, factor * velocity, color=BLUE)
    axes.set_ylabel(f"initial velocity v₀ [{unit}]")
    axes.yaxis.set_major_locator(MaxNLocator(6, steps=(1, 2, 5, 10)))


def _draw_picture(
    axes: Axes,
    solution: Arrays,
    shown: np.ndarray,
    values: np.ndarray,
    name: str,
    unit: str,
    length: float,
) -> None:
    factor, unit = _unit(values, unit)
    x = solution["x"]
    intervals = len(x) - bool(np.isclose(x[-1], length))
    even = np.arange(len(x)) * (length / intervals)
    if not np.allclose(x, even, rtol=0, atol=1e-9 * length):
        values = np.array([np.interp(even, x, row, period=length) for row in values])
    values = factor * _closed(x, values, length)[1]
    norm, colours = _colours(values)
    half_cell = length / intervals / 2
    duration = solution["t"][shown[-1]]
    half_step = duration / (len(values) - 1) / 2
    picture = axes.imshow(
        values,
        norm=norm,
        cmap=colours,
        origin="lower",
        interpolation_stage="data",  # at most 256 colours: a third of the bytes
        extent=(-half_cell, length + half_cell, -half_step, duration + half_step),
    )
    axes.set(ylim=(0, duration), ylabel="time t [s]")
    bar = axes.figure.colorbar(picture, ax=axes, label=f"{name} [{unit}]", pad=0.03, aspect=18)
    bar.outline.set_linewidth(0.6)
    if isinstance(norm, AsinhNorm):
        bar.ax.set_title("asinh scale", pad=7)
    ticks = _ends_and_between(norm)
    bar.set_ticks(ticks, labels=[f"{tick:.3g}".replace("-", "−") for tick in ticks])
    bar.minorticks_off()


def _colours(values: np.ndarray) -> tuple[Normalize, Colormap]:
    """Scale and colours of a field over time (t, x): the same for both signs, if it has both."""
    amplitude = np.abs(values).max(axis=1)
    limit = float(amplitude.max()) or 1.0
    has_low, has_high = -values.min() >= ONE_SIDED * limit, values.max() >= ONE_SIDED * limit
    if not has_low and not has_high:
        has_low = has_high = True
    low, high = -limit * has_low, limit * has_high
    # From what stands for zero on.
    half = SIGNED(np.linspace(0 if has_low else 0.5, 1 if has_high else 0.5, 256))
    # A field that soon dies away would leave a blank picture on an even colour scale.
    typical = float(np.median(amplitude[amplitude > 0])) if amplitude.any() else limit
    if typical >= 0.1 * limit:
        return Normalize(low, high), ListedColormap(half)
    return AsinhNorm(max(typical / 2, limit / 1000), low, high), ListedColormap(half)


def _ends_and_between(norm: Normalize) -> list[float]:
    """Values to label: both ends of a scale, zero, and round ones at a distance from the ends."""
    low, high = float(norm.vmin or 0), float(norm.vmax or 0)
    limit = max(-low, high)
    if isinstance(norm, AsinhNorm):
        powers = np.arange(np.ceil(np.log10(norm.linear_width)), np.floor(np.log10(limit)) + 1)
        round_ones = 10.0**powers
    else:
        round_ones = np.array(MaxNLocator(3, steps=(1, 2, 5, 10)).tick_values(0, limit))
    zero, one, other = (float(norm(value)) for value in (0.0, low, high))
    places = np.array([float(norm(value)) for value in (round_ones if high else -round_ones)])
    free = np.abs(places - zero) < 0.85 * max(zero - one, other - zero)
    between = round_ones[free & (round_ones > 0)]
    below = [low, *-between[::-1]] if low else []
    above = [*between, high] if high else []
    return [float(value) for value in (*below, 0.0, *above)]


# --- Modes ----------------------------------------------------------------------------------------


@styled
def modes(pod: Arrays, count: int = 12, length: float | None = None, layers: Layers = ()) -> Figure:
    """Draw the first modes of velocity and of density as small multiples (figures 3.2, 3.4, ...).

    Above each panel stand its number and its singular value, relative to the first. Modes that
    rounding turns by more than `TURNED` are grey: those of small singular values, and
    those of equal ones, which rotate freely.

    Parameters
    ----------
    pod
        `x` [m]; `velocity_modes`, `density_modes` of shape (mode, x) and unit Euclidean norm;
        `velocity_singular_values`, `density_singular_values`; `velocity_mode_rounding`,
        `density_mode_rounding`.
    count
        Number of modes shown of each, or all there are.
    length
        Length of the periodic domain [m], or of a bar with ends; needed of such a bar, and where
        particles are not evenly spaced.
    layers
        Of a material that jumps.
    """
    counts = [min(count, len(pod[f"{field}_modes"])) for field in FIELDS]
    columns = min(max(counts), 3)
    rows = [-(-number // columns) for number in counts]
    # Inches: heights of a panel with its title, of what stands below a block, margins of a block.
    panel, below, left, right, top = 0.78, 0.42, 0.5, 0.06, 0.03
    roundings = (pod[f"{f}_mode_rounding"][:n] for f, n in zip(FIELDS, counts, strict=True))
    turned = any((rounding > TURNED).any() for rounding in roundings)
    notes = [f"grey: {UNRESOLVED_LABEL}"] * turned
    if layers:
        parts = (f"{name} from x = {start:g} m" for start, name in layers)
        notes += ["dashed: the material jumps", ", ".join(parts)]
    foot = 0.05 * bool(notes) + 0.12 * len(notes)
    height = top + sum(rows) * panel + 2 * below + foot
    figure = Figure(figsize=(COLUMN_WIDTH, height))
    ceiling = height - top
    for field, number, row_count in zip(FIELDS, counts, rows, strict=True):
        floor = ceiling - row_count * panel
        grid = figure.add_gridspec(
            row_count,
            columns,
            left=left / COLUMN_WIDTH,
            right=1 - right / COLUMN_WIDTH,
            bottom=floor / height,
            top=(ceiling - 0.26) / height,
            wspace=0.08,
            hspace=0.55,
        )
        _draw_modes(figure, grid, pod, field, number, length or _length(pod["x"]), layers)
        middle = (left + COLUMN_WIDTH - right) / 2 / COLUMN_WIDTH
        figure.text(middle, (floor - 0.3) / height, "position x [m]", ha="center")
        level = (floor + ceiling - 0.26) / 2 / height
        figure.text(0.04 / COLUMN_WIDTH, level, "mode (unit norm)", rotation=90, va="center")
        ceiling = floor - below
    if notes:
        figure.text(0.5, 0.05 / height, "\n".join(notes), ha="center", fontsize=SMALL)
    return figure


def _draw_modes(
    figure: Figure,
    grid: GridSpec,
    pod: Arrays,
    field: str,
    number: int,
    length: float,
    layers: Layers,
) -> None:
    x, shapes = pod["x"], pod[f"{field}_modes"][:number]
    values = pod[f"{field}_singular_values"][:number]
    # Of snapshots that are zero all modes are noise, with nothing that they are a part of.
    relative = values / values[0] if values[0] else np.zeros(number)
    resolved = pod[f"{field}_mode_rounding"][:number] <= TURNED
    # Noise may stick out, so that it does not flatten the modes that matter.
    known = shapes[resolved] if resolved.any() else shapes
    limit = 1.12 * min(np.abs(shapes).max(), 1.5 * np.abs(known).max())
    colour = {"velocity": BLUE, "density": VERMILLION}[field]
    panels = zip(shapes, relative, resolved, strict=True)
    for index, (shape, weight, is_known) in enumerate(panels):
        row, column = divmod(index, grid.ncols)
        axes = figure.add_subplot(grid[row, column], xlim=(0, length), ylim=(-limit, limit))
        axes.axhline(0, color=GREY, linewidth=0.4)
        _mark_layers(axes, layers, length, named=False)
        axes.plot(*_closed(x, shape, length), color=colour if is_known else GREY)
        ratio = f"σ{str(index + 1).translate(SUBSCRIPTS)}/σ₁ = {shortened(weight)}"
        if not index or not values[0]:
            unit = {"velocity": "m/s", "density": "kg/m³"}[field]
            ratio = f"σ₁ = {shortened(values[0])} {unit}" if values[0] else "σ₁ = 0"
        axes.set_title(f"{field} mode {index + 1}\n{ratio}", y=1, pad=2.5, linespacing=1.05)
        # Shared axes: ticks, the costly part of a panel, only along the edges of the block.
        if column == 0:
            axes.yaxis.set_major_locator(MaxNLocator(3, symmetric=True))
        else:
            axes.yaxis.set_visible(False)
        if index + grid.ncols >= number:
            axes.set_xticks((0, length / 2, length), [f"{at:g}" for at in (0, length / 2, length)])
            for label, side in zip(
                axes.get_xticklabels(), ("left", "center", "right"), strict=True
            ):
                label.set(horizontalalignment=side)
        else:
            axes.xaxis.set_visible(False)


# --- Errors ---------------------------------------------------------------------------------------


# What is compared, its suffix in a sweep, and the looks of its curves for velocity and density.
COMPARISONS: tuple[tuple[str, str, Look, Look], ...] = (
    (
        "POD against SPH",
        "sph",
        {"color": BLUE, "linestyle": "-", "marker": "o", "markersize": 2.5},
        {"color": VERMILLION, "linestyle": "-", "marker": "s", "markersize": 2.5},
    ),
    (
        "POD against reference",
        "reference",
        {"color": SKY, "linestyle": "--", "marker": "^", "markersize": 5, "fillstyle": "none"},
        {"color": ORANGE, "linestyle": "--", "marker": "D", "markersize": 4.5, "fillstyle": "none"},
    ),
    (
        "SPH against reference",
        "",
        {"color": NAVY, "linestyle": "-."},
        {"color": BROWN, "linestyle": ":"},
    ),
)


@styled
def error(pod: Arrays, sweep: Arrays, errors: Arrays, reference: str) -> Figure:
    """Draw singular values, and errors against the number of modes (figures 3.3, 3.5, ...).

    An error that is not finite, or above 10³, stands as a marker on the top edge. Errors of models
    whose modes are not resolved are grey: they may change with the processor. A line stands at the
    smallest mode count whose errors of velocity and density are both below those of SPH.

    Parameters
    ----------
    pod
        `velocity_singular_values`, `density_singular_values`; `velocity_span_rounding`,
        `density_span_rounding`.
    sweep
        `mode_count` and, at each, `modes_resolved`, `velocity_error_sph`, `density_error_sph`,
        `velocity_error_reference`, `density_error_reference` of the original reduced model.
    errors
        `solution`, `reference`, `velocity_error`, `density_error` of shape (solution, reference).
    reference
        The reference of the scene, as named in `errors`.
    """
    figure = Figure(figsize=(COLUMN_WIDTH, 4.9), layout="constrained")
    upper, lower = figure.subfigures(2, 1, squeeze=False, height_ratios=(2.1, 2.8))[:, 0]
    _draw_singular_values(upper.subplots(), pod)
    _draw_errors(lower.subplots(), sweep, errors, reference)
    upper.legend(loc="outside lower center", ncols=3, handlelength=1)
    lower.legend(loc="outside lower center", ncols=2)
    return figure


def _draw_singular_values(axes: Axes, pod: Arrays) -> None:
    most = max(len(pod[f"{field}_singular_values"]) for field in FIELDS)
    shown = min(most, MOST_VALUES)
    whole = [axes]
    if most > shown:
        # Singular values fall, so that the upper right is free.
        inset = axes.inset_axes((0.6, 0.6, 0.38, 0.38))
        inset.tick_params(labelsize=SMALL)
        whole.append(inset)
    turned = False
    for panel, last in zip(whole, (shown, most), strict=False):
        values_shown = []
        for field, symbol, colour, marker in zip(
            FIELDS, "vρ", (BLUE, VERMILLION), "os", strict=True
        ):
            values = pod[f"{field}_singular_values"][:last]
            number = np.arange(1, len(values) + 1)
            kept = pod[f"{field}_span_rounding"] <= TURNED
            # Rounding cannot turn the span of all modes, whatever the last of them is.
            kept[1:][-1:] &= kept[:-1][-1:]
            kept = kept[:last]
            size = 2.5 if panel is axes else 1.0
            look: Look = {"linestyle": "", "marker": marker, "markersize": size}
            panel.plot(
                number[kept], values[kept], color=colour, label=f"{symbol}, singular value", **look
            )
            if not kept.all():
                panel.plot(number[~kept], values[~kept], color=GREY, **look)
                turned = True
            values_shown.append(values)
        scale_log(panel.yaxis, np.concatenate(values_shown))
        number_axis(panel.xaxis, last, 5 if panel is axes else 2)
        if panel is not axes:
            panel.yaxis.set_major_locator(LogLocator(numticks=4))
    if turned:
        # After both fields.
        axes.plot([], [], "o", color=GREY, markersize=2.5, label=UNRESOLVED_LABEL)
    axes.set(xlabel="mode number", ylabel="singular value [m/s, kg/m³]")


def number_axis(axis: XAxis, last: int, most: int = 6) -> None:
    """Ticks at whole numbers from 1 to the last, the first and multiples of one step."""
    step = next(n for e in range(9) for n in (10**e, 2 * 10**e, 5 * 10**e) if last <= most * n)
    ticks = [1, *(n for n in range(step, last + 1, step) if n > 1)]
    axis.axes.set_xlim(1 - 0.03 * last, last + 0.03 * last)
    axis.set_ticks(ticks, labels=[str(n) for n in ticks])


def _draw_errors(axes: Axes, sweep: Arrays, errors: Arrays, reference: str) -> None:
    counts, resolved = sweep["mode_count"], sweep["modes_resolved"].astype(bool)
    # A grey line begins and ends where the coloured one does.
    beside = np.convolve(~resolved, (True, True, True), "same").astype(bool)
    drawn = []
    broken_anywhere = False
    for place, (field, symbol) in enumerate(zip(FIELDS, "vρ", strict=True)):
        for number, (comparison, suffix, *looks) in enumerate(COMPARISONS):
            look = looks[place]
            label = f"{symbol}, {comparison}"
            if not suffix:
                level = _sph_error(errors, field, reference)
                axes.axhline(level, label=label, **look)
                drawn.append(np.array([level]))
                continue
            values = sweep[f"{field}_error_{suffix}"]
            broken = values > WORST_ERROR
            # The line has a gap where the model broke down, or where the field is zero.
            shown = np.where(broken, np.nan, values)
            axes.plot(counts, np.where(resolved, shown, np.nan), label=label, **look)
            if not resolved.all():
                grey = {**look, "color": GREY, "zorder": 1.9}
                axes.plot(counts, np.where(beside, shown, np.nan), **grey)
            drawn.append(values[values <= WORST_ERROR])
            # Side by side, for a model breaks down in everything at once.
            aside = 0.22 * (2 * place + number - 1.5)
            mark_breakdown(axes, counts[broken] + aside, look)
            broken_anywhere |= bool(broken.any())
    if not resolved.all():
        axes.plot([], [], color=GREY, marker="o", markersize=2.5, label=UNRESOLVED_LABEL)
    if broken_anywhere:
        axes.set_title(BREAKDOWN_NOTE, loc="right")
    axes.set(xlabel="number of modes k", ylabel="relative L² error")
    number_axis(axes.xaxis, int(counts[-1]), 5)
    scale_log(axes.yaxis, np.concatenate(drawn))
    works = np.logical_and.reduce(
        [
            sweep[f"{field}_error_sph"] < _sph_error(errors, field, reference)
            for field in FIELDS
            if _sph_error(errors, field, reference) > 0
        ]
    )
    if np.any(works):
        k = counts[np.argmax(works)]
        # No grey: the modes near rounding, which it may cross, are.
        dots: Look = {"color": GREEN, "linewidth": 1.2, "linestyle": (0, (1, 0.7))}
        axes.axvline(k, label=f"k = {k}: POD error below SPH's", zorder=0.5, **dots)


def add_legend(
    figure: Figure | SubFigure, panels: Iterable[Axes], columns: int = 2, title: str | None = None
) -> None:
    """Put one legend below, of what the panels label, each once."""
    # A scene may have the name of something else, but not its colour.
    labelled = {
        (label, str(artist.properties().get("color", artist.properties().get("facecolor")))): artist
        for axes in panels
        for artist, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    columns = min(columns, len(labelled))
    labels = [label for label, _ in labelled]
    figure.legend(labelled.values(), labels, loc="outside lower center", ncols=columns, title=title)


def mark_breakdown(axes: Axes, places: np.ndarray, look: Look) -> None:
    """Put markers on the top edge, where there is no finite error to draw."""
    if len(places):
        edge = axes.get_xaxis_transform()
        look = {**look, "linestyle": "", "clip_on": False, "zorder": 3}
        axes.plot(places, np.ones(len(places)), transform=edge, **look)


def scale_log(
    axis: XAxis | YAxis, values: np.ndarray, room: float = 0.05, few_below: float = 80
) -> None:
    """Make an axis logarithmic, with room on both sides of the values: a share of their range.

    Below a ratio `few_below` of its ends, powers of ten would be too few labels.
    """
    values = values[values > 0]
    low, high = (values.min(), values.max()) if len(values) else (0.1, 10)
    # A factor of 6.3 or more holds at least two of 1, 2, 5, 10, ...
    margin = max(1.3, (high / low) ** room, np.sqrt(6.3 * low / high))
    low, high = low / margin, high * margin
    few = high / low < few_below
    if axis.axis_name == "x":
        axis.axes.set(xlim=(low, high), xscale="log")
    else:
        axis.axes.set(ylim=(low, high), yscale="log")
    axis.set_major_locator(LogLocator(subs=(1, 2, 5) if few else (1,), numticks=9))
    axis.set_major_formatter(FuncFormatter(lambda value, _: _tick(value, few)))
    axis.set_minor_formatter(NullFormatter())


# --- Acceleration ---------------------------------------------------------------------------------


FULL_MODELS = {"sph_neighbour_lists": "none", "sph_stencil": "full"}
REDUCED_MODELS = {"original": "s", "linearized": "D"}
NAMES = {
    "sph_neighbour_lists": "SPH, neighbour lists",
    "sph_stencil": "SPH, even spacing",
    "original": "original POD",
    "linearized": "linearized density",
}
MODE_COUNT_COLOURS = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY)


@styled
def acceleration(
    acceleration: Arrays,
    cpu_time: Arrays,
    errors: Arrays,
    reference: str,
    multiples: Sequence[float] = (1,),
) -> Figure:
    """Draw error against CPU time, velocity above, density below (figures 3.17, 3.21, ...).

    Full SPH is compared with the reference, reduced models with full SPH. A point stands at the
    median CPU time, its bar spans the quartiles. Lines stand at the error of SPH.

    Parameters
    ----------
    acceleration
        `contender`, `mode_count` and `acceleration_velocity_error`, `acceleration_density_error`
        of shape (contender, mode_count), against full SPH.
    cpu_time
        `contender`, `contender_mode_count` and `n_freeze` (0 where they do not apply), and
        `cpu_seconds` of shape (contender, repeat).
    errors
        `solution`, `reference`, `velocity_error`, `density_error` of shape (solution, reference).
    reference
        The reference of the scene, as named in `errors`.
    multiples
        Of the error of SPH, at which lines stand.
    """
    figure = Figure(figsize=(COLUMN_WIDTH, 5.4), layout="constrained")
    panels = figure.subplots(2, 1)
    for axes, field, symbol in zip(panels, FIELDS, "vρ", strict=True):
        of_sph = _sph_error(errors, field, reference)
        reduced = {
            (name, count): value
            for name, row in zip(
                acceleration["contender"], acceleration[f"acceleration_{field}_error"], strict=True
            )
            for count, value in zip(acceleration["mode_count"], row, strict=True)
        }
        values = [
            reduced[name, count] if count else of_sph
            for name, count in zip(
                cpu_time["contender"], cpu_time["contender_mode_count"], strict=True
            )
        ]
        levels = {factor: factor * of_sph for factor in multiples}
        _draw_acceleration(axes, cpu_time, np.array(values), levels)
        axes.set_ylabel(f"relative L² error of {field} {symbol}")
    handles, labels = panels[0].get_legend_handles_labels()
    title = (
        "stars: SPH, error against the reference;\n"
        "other markers: POD, error against SPH;\n"
        "bars: quartiles of the repeated runs; numbers at the dots: n"
    )
    figure.legend(handles, labels, loc="outside lower center", ncols=2, title=title)
    return figure


def _draw_acceleration(
    axes: Axes, cpu_time: Arrays, values: np.ndarray, levels: Mapping[float, float]
) -> None:
    """Draw the errors `values`, one a contender, against CPU time, and levels of multiples."""
    names, counts, steps = (
        cpu_time[name] for name in ("contender", "contender_mode_count", "n_freeze")
    )
    quartiles = time_quartiles(cpu_time["cpu_seconds"])
    median = quartiles[1]
    broken = values > WORST_ERROR
    shown = np.where(broken, np.nan, values)
    scale_log(axes.xaxis, quartiles[::2].ravel())
    known = np.append(values[values <= WORST_ERROR], list(levels.values()))
    scale_log(axes.yaxis, known, room=0.12)

    def draw(chosen: np.ndarray, label: str, look: Look) -> None:
        if len(chosen):
            times = median[chosen]
            bars: Look = {"elinewidth": 0.6, "capsize": 1.5, "capthick": 0.6}
            draw_bars(axes, quartiles[:, chosen], shown[chosen], look["color"], **bars)
            axes.plot(times, shown[chosen], label=label, **look)
            mark_breakdown(axes, times[broken[chosen]], look)

    mode_counts = np.unique(counts[counts > 0])
    for place, (count, colour) in enumerate(zip(mode_counts, cycle(MODE_COUNT_COLOURS))):
        for name, marker in REDUCED_MODELS.items():
            look = {"color": colour, "marker": marker, "markersize": 5, "linestyle": ""}
            look |= {"fillstyle": "none"}
            draw(
                np.flatnonzero((names == name) & (counts == count)),
                f"k = {count}, {NAMES[name]}",
                look,
            )
        chosen = np.flatnonzero((steps > 0) & (counts == count))
        chosen = chosen[np.argsort(steps[chosen])]
        look = {"color": colour, "marker": "o", "linestyle": "--"}
        draw(chosen, f"k = {count}, frozen for n steps", look)
        chosen = chosen[values[chosen] > 0]
        # Few modes, large errors, labels above; more modes, smaller errors, labels below.
        _label_steps(axes, median[chosen], values[chosen], steps[chosen], colour, above=place == 0)
    for name, filling in FULL_MODELS.items():
        look = {"color": BLACK, "marker": "*", "fillstyle": filling, "markersize": 7}
        draw(np.flatnonzero(names == name), NAMES[name], {**look, "linestyle": ""})
    for (factor, level), dashes in zip(levels.items(), cycle(((4, 2), (1, 1))), strict=False):
        name = "error of SPH" if factor == 1 else f"{factor:g} times the error of SPH"
        axes.axhline(level, color=DIM, linewidth=0.8, linestyle=(0, dashes), label=name, zorder=0.5)
    if broken.any():
        axes.set_title(BREAKDOWN_NOTE, loc="right")
    axes.set_xlabel("CPU time [s]")


def time_quartiles(seconds: np.ndarray) -> np.ndarray:
    """Lower quartile, median and upper quartile, shape (3, contenders), over the repeats."""
    return np.quantile(seconds, (0.25, 0.5, 0.75), axis=1)


def draw_bars(
    axes: Axes,
    quartiles: np.ndarray,
    others: np.ndarray,
    colour: str,
    along: str = "x",
    **look: Any,
) -> None:
    """Draw bars from the lower to the upper quartile along an axis, at `others` on the other."""
    lower, median, upper = quartiles
    bars: dict[str, Any] = {"x": others, "y": others}
    bars |= {along: median, f"{along}err": (median - lower, upper - median)}
    axes.errorbar(**bars, fmt="none", ecolor=colour, **look)


def _label_steps(
    axes: Axes, times: np.ndarray, values: np.ndarray, steps: np.ndarray, colour: str, above: bool
) -> None:
    """Write the numbers of frozen steps at their dots, together where dots stand close."""
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    points = PANEL_POINTS * np.log(times / left) / np.log(right / left)
    finite = values <= WORST_ERROR
    heights = np.log(np.where(finite, values, top) / bottom) / np.log(top / bottom) * PANEL_HEIGHT

    def close(one: int, other: int) -> bool:
        """Whether labels of two dots would cover each other, being a line some 9 pt high."""
        apart = abs(points[one] - points[other])
        same = finite[one] == finite[other]
        level = abs(heights[one] - heights[other])
        return same and apart < (widths[[one, other]].sum() + 3) / 2 and level < 9

    # A figure is some 4 pt wide.
    widths = np.array([4 * len(str(number)) for number in steps])
    groups: list[list[int]] = []
    for dot in np.argsort(points).tolist():
        if groups and close(groups[-1][-1], dot):
            groups[-1].append(dot)
        else:
            groups.append([dot])
    # Lists are wider than their dots: what stands beside them gives way.
    places = [points[group].mean() for group in groups]
    shifts = np.zeros(len(groups))
    for n in range(1, len(groups)):
        one, other = groups[n - 1 : n + 1]
        if finite[one[0]] == finite[other[0]] and np.ptp(heights[[*one, *other]]) < 9:
            wide = 2 * len(_listed(steps[one])) + 2 * len(_listed(steps[other])) + 4
            before = places[n - 1] + shifts[n - 1]
            shifts[n] = max(0.0, before + wide - places[n])
    # Those that gave way do so together with those they gave way to, by half to either side.
    for cluster in np.split(np.arange(len(groups)), np.flatnonzero(shifts == 0)[1:]):
        shifts[cluster] -= shifts[cluster].max(initial=0) / 2
    for group, shift in zip(groups, shifts, strict=True):
        # Errors grow with n, so to the right above the line and to the left below it is room.
        side = 1 if above and finite[group[0]] else -1
        height = side * (side * values[group]).max() if finite[group[0]] else 1
        axes.annotate(
            _listed(steps[group]),
            (np.exp(np.log(times[group]).mean()), height),
            xycoords="data" if finite[group[0]] else axes.get_xaxis_transform(),
            xytext=(2 * side + shift, 4 * side),
            textcoords="offset points",
            ha="center",
            va="bottom" if side > 0 else "top",
            color=colour,
            fontsize=SMALL,
        )


def _listed(numbers: np.ndarray) -> str:
    return ", ".join(str(number) for number in numbers)


def _sph_error(errors: Arrays, field: str, reference: str) -> float:
    """Error of full SPH against a reference."""
    solution = list(errors["solution"]).index("sph")
    return float(errors[f"{field}_error"][solution, list(errors["reference"]).index(reference)])


# --- Initial velocity -----------------------------------------------------------------------------


@styled
def initial_spectrum(solution: Arrays, last_harmonic: int | None = None) -> Figure:
    """Draw the amplitudes of the discrete Fourier modes of an initial velocity (figure C.2).

    Those below 1e-12 of the largest are rounding noise and grey. Lines stand at 10 % and 1 % of the
    largest.

    Parameters
    ----------
    solution
        `velocity` [m/s] of shape (t, x), its first time 0.
    last_harmonic
        The last harmonic that is shown; all of them if it is not given.
    """
    velocity = solution["velocity"][0]
    count = len(velocity)
    amplitude = np.abs(np.fft.rfft(velocity)) * 2 / count
    amplitude[0] /= 2
    if count % 2 == 0:
        amplitude[-1] /= 2
    largest = amplitude.max()
    amplitude = amplitude[: last_harmonic + 1 if last_harmonic else None]
    harmonic = np.arange(len(amplitude))
    figure = Figure(figsize=(COLUMN_WIDTH, 2.4), layout="constrained")
    axes = figure.subplots()
    scale_log(axes.yaxis, amplitude)
    for part, dashes in ((0.1, (4, 2)), (0.01, (1, 1))):
        look: Look = {"color": DIM, "linewidth": 0.8, "linestyle": (0, dashes), "zorder": 0.5}
        axes.axhline(part * largest, label=f"{100 * part:g} % of the largest", **look)
    noise = amplitude < ROUNDING * largest
    for chosen, colour, label in (
        (~noise, BLUE, "discrete Fourier mode"),
        (noise, GREY, "below 10⁻¹² of the largest"),
    ):
        if chosen.any():
            shown = amplitude[chosen]
            axes.vlines(harmonic[chosen], axes.get_ylim()[0], shown, colour, linewidth=0.6)
            axes.plot(harmonic[chosen], shown, "o", color=colour, markersize=2, label=label)
    figure.legend(loc="outside lower center", ncols=2)
    axes.set(xlabel="harmonic number", ylabel="amplitude in v₀ [m/s]")
    axes.xaxis.set_major_locator(MaxNLocator(6, integer=True, steps=(1, 2, 5, 10)))
    return figure


# --- Phase ----------------------------------------------------------------------------------------


@styled
def phase(sph: Arrays, exact: Arrays, modified: Arrays, position: float, beta: float) -> Figure:
    """Draw the velocity of one particle in time, in four rows (figure C.6).

    Parameters
    ----------
    sph, exact, modified
        `t` [s], `x` [m] and `velocity` [m/s] of shape (t, x): full SPH, the exact solution, and
        the exact solution of a medium whose waves travel `beta` times as fast.
    position
        Where to look [m]: at the nearest particle.
    beta
        Leading coefficient of the SPH derivative (appendix B).
    """
    x = exact["x"]
    particle = int(np.abs(x - position).argmin())
    factor, unit = _unit(exact["velocity"][:, particle], "m/s")
    figure = Figure(figsize=(COLUMN_WIDTH, 4.4), layout="constrained")
    rows = figure.subplots(4, 1, sharey=True)
    duration = exact["t"][-1]
    for row, axes in enumerate(rows):
        start, end = row * duration / 4, (row + 1) * duration / 4
        for solution, label, look in (
            (exact, "exact solution", {"color": GREY, "linewidth": 1.6}),
            (modified, f"exact, waves β = {beta:.4f} times as fast", {"color": BLUE}),
            (sph, "SPH", {"color": VERMILLION, "linestyle": (0, (3, 1.5))}),
        ):
            during = np.flatnonzero((solution["t"] >= start) & (solution["t"] <= end))
            during = during[_shown(len(during), 1001)]
            velocity = factor * solution["velocity"][during, particle]
            axes.plot(solution["t"][during], velocity, label=label, **look)
        axes.set(xlim=(start, end))
    rows[-1].set_xlabel("time t [s]")
    figure.supylabel(f"velocity v at x = {x[particle]:g} m [{unit}]", fontsize=7)
    figure.legend(*rows[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure
