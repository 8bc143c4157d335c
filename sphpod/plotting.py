"""Figures, one function a kind; each takes arrays named as in `sphpod.dataset`, returns a Figure.

Every figure is drawn at its final size with one style sheet, so its text has the size it will have
in print. Labels are plain Unicode in one font; only the schematic typesets mathematics. That keeps
drawing cheap and the files small. Captions belong to the configuration, not to the pictures.
"""

import os
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import cycle, pairwise, product
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import XAxis, YAxis
from matplotlib.colors import AsinhNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from matplotlib.patches import Circle
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter
from matplotlib.transforms import Bbox, ScaledTranslation

from sphpod import dataset

Arrays = Mapping[str, np.ndarray]
Look = Mapping[str, Any]  # keyword arguments of Axes.plot

STYLE = Path(__file__).with_name("style.mplstyle")
styled = matplotlib.style.context(["default", STYLE])

PAGE_WIDTH = 5.9  # inches: the text width of a one-column journal
HALF_WIDTH = 3.3
PANEL_POINTS = 165  # width of one of two panels beside each other, about

# Okabe and Ito's palette and two darker shades: blues for the velocity, reds for the density.
BLACK, DIM, GREY, PALE = "#000000", "#666666", "#A6A6A6", "#D9D9D9"
BLUE, SKY, NAVY = "#0072B2", "#56B4E9", "#00324F"
VERMILLION, ORANGE, BROWN = "#D55E00", "#E69F00", "#7A3500"
GREEN, PURPLE = "#009E73", "#CC79A7"

ROUNDING = 1e-12
"""A singular value below this fraction of the first is rounding noise."""

WORST_ERROR = 1e3
"""A relative error above this, or none at all, only says that the model broke down."""

BREAKDOWN_NOTE = "top edge: error above 10³ or not finite"

FIELDS = ("velocity", "density")

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
    figure = Figure(figsize=(PAGE_WIDTH, 1.5))
    axes = figure.add_axes((0, 0, 1, 1), xlim=(-0.5, 8.5), ylim=(-1.3, 0.99), aspect="equal")
    axes.axis("off")
    names = ("N − 1", "0", "1", "···", "n", "n + 1", "···", "N − 1", "0")
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
        axes.text(place, 0, name, color=ink, fontsize=7, ha="center", va="center_baseline")
        if not image:
            _draw_damper(axes, place, -radius)
    for at, height, label in (
        (3.5, -0.42, "$k_{n-1/2}$"),
        (4, 0.42, "$m_n$"),
        (4.5, -0.42, "$k_{n+1/2}$"),
        (5, 0.42, "$m_{n+1}$"),
        (4.3, -0.85, "$d_n$"),
        (5.4, -0.85, "$d_{n+1}$"),
    ):
        axes.text(at, height, label, ha="center")
    for edge in (0.5, 7.5):
        axes.plot((edge, edge), (-0.45, 0.9), color=GREY, linestyle=":")
    axes.annotate(
        "",
        (0.5, 0.82),
        (7.5, 0.82),
        arrowprops={"arrowstyle": "<->", "linewidth": 0.6, "shrinkA": 0, "shrinkB": 0},
    )
    axes.text(4, 0.82, "one period, $L$", ha="center", va="center", backgroundcolor="white")
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
def profile(solution: Arrays, fields: Sequence[str] = ("initial_velocity", "velocity")) -> Figure:
    """Draw the initial velocity and space-time pictures of a solution (figures 3.1, 3.18, ...).

    Parameters
    ----------
    solution
        `t` [s], evenly spaced from 0, `x` [m], `velocity` [m/s] and, for a picture of it,
        `density` [kg/m³], both of shape (t, x).
    fields
        A panel each, from left to right: `initial_velocity`, `velocity` or `density_change`.

    Raises
    ------
    ValueError
        A field is none of the three.
    """
    shown = _shown(len(solution["t"]))
    figure = Figure(figsize=(PAGE_WIDTH, 2.25), layout="constrained")
    for axes, field in zip(figure.subplots(1, len(fields), squeeze=False)[0], fields, strict=True):
        if field == "initial_velocity":
            _draw_profile(axes, solution["x"], solution["velocity"][0])
        elif field == "velocity":
            _draw_picture(axes, solution, solution["velocity"][shown], "velocity v", "m/s")
        elif field == "density_change":
            change = solution["density"][shown] - solution["density"][0]
            _draw_picture(axes, solution, change, "density ρ − ρ₀", "kg/m³")
        else:
            raise ValueError(
                f"a profile shows initial_velocity, velocity or density_change, not {field!r}"
            )
        axes.set(xlim=(0, _length(solution["x"])), xlabel="position x [m]")
    return figure


def _shown(count: int, most: int = 601) -> np.ndarray:
    """Indices of `count` times, thinned to `most` of them, first and last included."""
    return np.linspace(0, count - 1, min(count, most)).round().astype(int)


def _length(x: np.ndarray) -> float:
    """Length of the periodic domain with particles at x [m]."""
    return float(x[-1] + x[1] - 2 * x[0])


def _unit(values: np.ndarray, unit: str) -> tuple[float, str]:
    """Power of 1000 that brings the largest value between 0.1 and 100, and the unit it leaves."""
    largest = np.abs(values).max()
    exponent = 3 * int(np.floor((np.log10(largest) + 1) / 3)) if largest > 0 else 0
    return 10.0**-exponent, unit if exponent == 0 else f"{_power_of_ten(exponent)} {unit}"


def _power_of_ten(exponent: int) -> str:
    return "10" + str(exponent).translate(SUPERSCRIPTS)


def _short(value: float) -> str:
    """Two digits, with a power of ten where needed: 0.12, 1.2×10⁻³, 10⁻⁴."""
    if 0.001 <= value < 100:
        return f"{value:.2g}"
    mantissa, exponent = f"{value:.1e}".split("e")
    power = _power_of_ten(int(exponent))
    return power if mantissa == "1.0" else f"{mantissa.removesuffix('.0')}×{power}"


def _tick(value: float, short: bool) -> str:
    return _short(value) if short else _power_of_ten(round(np.log10(value)))


def _draw_profile(axes: Axes, x: np.ndarray, velocity: np.ndarray) -> None:
    factor, unit = _unit(velocity, "m/s")
    axes.axhline(0, color=GREY, linewidth=0.6)
    # The point at L is the one at 0.
    axes.plot(np.append(x, _length(x)), factor * np.append(velocity, velocity[0]), color=BLUE)
    axes.set_ylabel(f"initial velocity v₀ [{unit}]")
    axes.yaxis.set_major_locator(MaxNLocator(6, steps=(1, 2, 5, 10)))


def _draw_picture(axes: Axes, solution: Arrays, values: np.ndarray, name: str, unit: str) -> None:
    factor, unit = _unit(values, unit)
    values = factor * np.column_stack((values, values[:, 0]))
    amplitude = np.abs(values).max(axis=1)
    limit = amplitude.max() or 1.0
    # A field that soon dies away would leave a blank picture on an even colour scale.
    typical = np.median(amplitude)
    fading = typical < 0.1 * limit
    linear = max(typical / 2, limit / 1000)
    norm = AsinhNorm(linear, -limit, limit) if fading else Normalize(-limit, limit)
    half_cell = (solution["x"][1] - solution["x"][0]) / 2
    duration = solution["t"][-1]
    half_step = duration / (len(values) - 1) / 2
    picture = axes.imshow(
        values,
        norm=norm,
        origin="lower",
        interpolation_stage="data",  # at most 256 colours: a third of the bytes
        extent=(
            -half_cell,
            _length(solution["x"]) + half_cell,
            -half_step,
            duration + half_step,
        ),
    )
    axes.set(ylim=(0, duration), ylabel="time t [s]")
    bar = axes.figure.colorbar(picture, ax=axes, label=f"{name} [{unit}]", pad=0.03, aspect=18)
    bar.outline.set_linewidth(0.6)
    if fading:
        powers = 10.0 ** np.arange(np.ceil(np.log10(linear)), np.floor(np.log10(limit)) + 1)
        ticks = [*-powers[::-1], 0, *powers]
        bar.set_ticks(ticks, labels=[f"{tick:g}".replace("-", "−") for tick in ticks])
        bar.minorticks_off()
    else:
        bar.locator = MaxNLocator(6, steps=(1, 2, 5, 10))


# --- Modes ----------------------------------------------------------------------------------------


@styled
def modes(pod: Arrays, count: int = 12) -> Figure:
    """Draw the first modes of velocity and of density as small multiples (figures 3.2, 3.4, ...).

    Above each panel stand its number and its singular value relative to the first; modes at
    rounding level are grey.

    Parameters
    ----------
    pod
        `x` [m]; `velocity_modes`, `density_modes` of shape (mode, x) and unit Euclidean norm;
        `velocity_singular_values`, `density_singular_values`.
    count
        Number of modes shown of each, or all there are.
    """
    counts = [min(count, len(pod[f"{field}_modes"])) for field in FIELDS]
    columns = max(counts) if max(counts) <= 5 else 4
    rows = [-(-number // columns) for number in counts]
    # Inches: heights of a panel with its title, of what stands below a block, margins of a block.
    panel, below, left, right, top = 0.85, 0.46, 0.6, 0.06, 0.03
    height = top + sum(rows) * panel + 2 * below
    figure = Figure(figsize=(PAGE_WIDTH, height))
    ceiling = height - top
    for field, number, row_count in zip(FIELDS, counts, rows, strict=True):
        floor = ceiling - row_count * panel
        grid = figure.add_gridspec(
            row_count,
            columns,
            left=left / PAGE_WIDTH,
            right=1 - right / PAGE_WIDTH,
            bottom=floor / height,
            top=(ceiling - 0.28) / height,
            wspace=0.08,
            hspace=0.55,
        )
        _draw_modes(figure, grid, pod, field, number)
        middle = (left + PAGE_WIDTH - right) / 2 / PAGE_WIDTH
        figure.text(middle, (floor - 0.33) / height, "position x [m]", ha="center")
        level = (floor + ceiling - 0.28) / 2 / height
        figure.text(0.06 / PAGE_WIDTH, level, "mode (unit norm)", rotation=90, va="center")
        ceiling = floor - below
    return figure


def _draw_modes(figure: Figure, grid: GridSpec, pod: Arrays, field: str, number: int) -> None:
    x, shapes = pod["x"], pod[f"{field}_modes"][:number]
    relative = pod[f"{field}_singular_values"][:number] / pod[f"{field}_singular_values"][0]
    # Noise may stick out, so that it does not flatten the modes that matter.
    limit = 1.12 * min(np.abs(shapes).max(), 1.5 * np.abs(shapes[relative >= ROUNDING]).max())
    colour = {"velocity": BLUE, "density": VERMILLION}[field]
    length = _length(x)
    for index, (shape, weight) in enumerate(zip(shapes, relative, strict=True)):
        row, column = divmod(index, grid.ncols)
        axes = figure.add_subplot(grid[row, column], xlim=(0, length), ylim=(-limit, limit))
        axes.axhline(0, color=GREY, linewidth=0.4)
        axes.plot(
            np.append(x, length),
            np.append(shape, shape[0]),
            color=colour if weight >= ROUNDING else GREY,
        )
        ratio = f"σ{str(index + 1).translate(SUBSCRIPTS)}/σ₁ = {_short(weight)}"
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

    An error that is not finite, or above 10³, stands as a marker on the top edge.

    Parameters
    ----------
    pod
        `velocity_singular_values`, `density_singular_values`.
    sweep
        `mode_count` and, at each, `velocity_error_sph`, `density_error_sph`,
        `velocity_error_reference`, `density_error_reference` of the original reduced model.
    errors
        `solution`, `reference`, `velocity_error`, `density_error` of shape (solution, reference).
    reference
        The reference of the scene, as named in `errors`.
    """
    figure = Figure(figsize=(PAGE_WIDTH, 2.9), layout="constrained")
    left, right = figure.subplots(1, 2)
    _draw_singular_values(left, pod)
    _draw_errors(right, sweep, errors, reference)
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower left")
    figure.legend(*right.get_legend_handles_labels(), loc="outside lower right", ncols=2)
    return figure


def _draw_singular_values(axes: Axes, pod: Arrays) -> None:
    noise = None
    for field, symbol, colour, marker in zip(FIELDS, "vρ", (BLUE, VERMILLION), "os", strict=True):
        values = pod[f"{field}_singular_values"]
        number = np.arange(1, len(values) + 1)
        kept = values >= ROUNDING * values[0]
        look: Look = {"linestyle": "", "marker": marker, "markersize": 2.5}
        label = f"{symbol}, singular value"
        axes.plot(number[kept], values[kept], color=colour, label=label, **look)
        if not kept.all():
            (noise,) = axes.plot(number[~kept], values[~kept], color=GREY, **look)
    if noise:
        noise.set_label("below 10⁻¹² of the first")
    axes.set(xlabel="mode number", ylabel="singular value of v [m/s], ρ [kg/m³]")
    axes.xaxis.set_major_locator(MaxNLocator(5, integer=True, steps=(1, 2, 5, 10)))
    _scale_log(axes.yaxis, np.concatenate([pod[f"{field}_singular_values"] for field in FIELDS]))


def _draw_errors(axes: Axes, sweep: Arrays, errors: Arrays, reference: str) -> None:
    counts = sweep["mode_count"]
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
            finite = values <= WORST_ERROR
            # The line has a gap where the model broke down.
            axes.plot(counts, np.where(finite, values, np.nan), label=label, **look)
            drawn.append(values[finite])
            # Side by side, for a model breaks down in everything at once.
            aside = 0.22 * (2 * place + number - 1.5)
            _mark_breakdown(axes, counts[~finite] + aside, look)
            broken_anywhere |= not finite.all()
    if broken_anywhere:
        axes.set_title(BREAKDOWN_NOTE, loc="right")
    axes.set(xlabel="number of modes k", ylabel="relative L² error")
    axes.xaxis.set_major_locator(MaxNLocator(5, integer=True, steps=(1, 2, 5, 10)))
    _scale_log(axes.yaxis, np.concatenate(drawn))


def _mark_breakdown(axes: Axes, places: np.ndarray, look: Look) -> None:
    """Put markers on the top edge, where there is no finite error to draw."""
    if len(places):
        edge = axes.get_xaxis_transform()
        look = {**look, "linestyle": "", "clip_on": False, "zorder": 3}
        axes.plot(places, np.ones(len(places)), transform=edge, **look)


def _scale_log(
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
        axis.axes.set(xscale="log", xlim=(low, high))
    else:
        axis.axes.set(yscale="log", ylim=(low, high))
    axis.set_major_locator(LogLocator(subs=(1, 2, 5) if few else (1,), numticks=9))
    axis.set_major_formatter(FuncFormatter(lambda value, _: _tick(value, few)))
    axis.set_minor_formatter(NullFormatter())


# --- Acceleration ---------------------------------------------------------------------------------


FULL_MODELS = {"sph_neighbour_lists": "none", "sph_stencil": "full"}
REDUCED_MODELS = {"original": "+", "linearized": "x"}
NAMES = {
    "sph_neighbour_lists": "SPH, neighbour lists",
    "sph_stencil": "SPH, even spacing",
    "original": "original POD",
    "linearized": "linearized density",
}
MODE_COUNT_COLOURS = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY)


@styled
def acceleration(acceleration: Arrays, cpu_time: Arrays, errors: Arrays, reference: str) -> Figure:
    """Draw error against CPU time, velocity left, density right (figures 3.17, 3.21, ...).

    Full SPH is compared with the reference, reduced models with full SPH. A point stands at the
    median CPU time, its bar spans the quartiles.

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
    """
    figure = Figure(figsize=(PAGE_WIDTH, 2.9), layout="constrained")
    panels = figure.subplots(1, 2)
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
        _draw_acceleration(axes, cpu_time, np.array(values))
        axes.set_ylabel(f"relative L² error of {field} {symbol}")
    handles, labels = panels[0].get_legend_handles_labels()
    title = "SPH: error against the reference; POD: error against SPH; numbers at the dots: n"
    figure.legend(
        handles, labels, loc="outside lower center", ncols=min(3, -(-len(labels) // 3)), title=title
    )
    return figure


def _draw_acceleration(axes: Axes, cpu_time: Arrays, values: np.ndarray) -> None:
    """Draw the errors `values`, one a contender, against CPU time."""
    names, counts, steps = (
        cpu_time[name] for name in ("contender", "contender_mode_count", "n_freeze")
    )
    quartiles = _quartiles(cpu_time["cpu_seconds"])
    median = quartiles[1]
    finite = values <= WORST_ERROR
    shown = np.where(finite, values, np.nan)
    _scale_log(axes.xaxis, quartiles[::2].ravel())
    _scale_log(axes.yaxis, values[finite], room=0.12)

    def draw(chosen: np.ndarray, label: str, look: Look) -> None:
        if len(chosen):
            times = median[chosen]
            bars: Look = {"elinewidth": 0.6, "capsize": 1.5, "capthick": 0.6}
            _draw_bars(axes, quartiles[:, chosen], shown[chosen], look["color"], **bars)
            axes.plot(times, shown[chosen], label=label, **look)
            _mark_breakdown(axes, times[~finite[chosen]], look)

    mode_counts = np.unique(counts[counts > 0])
    for place, (count, colour) in enumerate(zip(mode_counts, cycle(MODE_COUNT_COLOURS))):
        for name, marker in REDUCED_MODELS.items():
            look = {"color": colour, "marker": marker, "markersize": 6, "linestyle": ""}
            draw(
                np.flatnonzero((names == name) & (counts == count)),
                f"k = {count}, {NAMES[name]}",
                look,
            )
        chosen = np.flatnonzero((steps > 0) & (counts == count))
        chosen = chosen[np.argsort(steps[chosen])]
        look = {"color": colour, "marker": "o", "linestyle": "--"}
        draw(chosen, f"k = {count}, frozen for n steps", look)
        # Few modes, large errors, labels above; more modes, smaller errors, labels below.
        _label_steps(axes, median[chosen], values[chosen], steps[chosen], colour, above=place == 0)
    for name, filling in FULL_MODELS.items():
        look = {"color": BLACK, "marker": "*", "fillstyle": filling, "markersize": 7}
        draw(np.flatnonzero(names == name), NAMES[name], {**look, "linestyle": ""})
    if not finite.all():
        axes.set_title(BREAKDOWN_NOTE, loc="right")
    axes.set_xlabel("CPU time [s]")


def _quartiles(seconds: np.ndarray) -> np.ndarray:
    """Lower quartile, median and upper quartile, shape (3, contenders), over the repeats."""
    return np.quantile(seconds, (0.25, 0.5, 0.75), axis=1)


def _draw_bars(
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
    axes: Axes,
    times: np.ndarray,
    values: np.ndarray,
    steps: np.ndarray,
    colour: str,
    above: bool,
) -> None:
    """Write the numbers of frozen steps at their dots, together where dots stand close."""
    left, right = axes.get_xlim()
    points = PANEL_POINTS * np.log(times / left) / np.log(right / left)
    finite = values <= WORST_ERROR
    groups: list[list[int]] = []
    for dot in np.lexsort((points, finite)).tolist():
        if groups and finite[groups[-1][0]] == finite[dot]:
            # A figure is some 4 pt wide.
            needed = 2 * len(_listed(steps[groups[-1]])) + 2 * len(str(steps[dot])) + 4
            if points[dot] - points[groups[-1]].mean() < needed:
                groups[-1].append(dot)
                continue
        groups.append([dot])
    for group in groups:
        # Errors grow with n, so to the right above the line and to the left below it is room.
        side = 1 if above and finite[group[0]] else -1
        height = side * (side * values[group]).max() if finite[group[0]] else 1
        axes.annotate(
            _listed(steps[group]),
            (np.exp(np.log(times[group]).mean()), height),
            xycoords="data" if finite[group[0]] else axes.get_xaxis_transform(),
            xytext=(2 * side, 4 * side),
            textcoords="offset points",
            ha="center",
            va="bottom" if side > 0 else "top",
            color=colour,
            fontsize=7,
        )


def _listed(numbers: np.ndarray) -> str:
    return ", ".join(str(number) for number in numbers)


def _sph_error(errors: Arrays, field: str, reference: str) -> float:
    """Error of full SPH against a reference."""
    solution = list(errors["solution"]).index("sph")
    return float(errors[f"{field}_error"][solution, list(errors["reference"]).index(reference)])


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
    "original": (NAMES["original"], {"color": BROWN, "marker": "+", "markersize": 5}),
    "linearized": (NAMES["linearized"], {"color": BROWN, "marker": "x", "linestyle": ":"}),
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
    "lifted_exact": (
        "lifted POD, exact in time",
        {"color": GREEN, "marker": "o", "markersize": 3},
    ),
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

    Above, velocity left and density right, a point stands at the median CPU time, its bar spans the
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
        One entry a contender: `contender`, `integrator`, `contender_mode_count` (0 of a full
        model), `contender_particle_count`, `contender_time_step` [s] and `contender_tolerance` (NaN
        where they do not apply), `velocity_error_exact`, `density_error_exact`, and `cpu_seconds`
        of shape (contender, repeat). Full SPH as the scene sets it is the first `sph_stencil`.

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
    below = 0.8 + 0.14 * max(map(len, groups.values()))
    figure = Figure(figsize=(PAGE_WIDTH, 2.7 + below), layout="constrained")
    halves = figure.subfigures(2, 1, squeeze=False, height_ratios=(2.7, below))
    upper, lower = halves[:, 0]
    panels = upper.subplots(1, 2)
    for axes, field, symbol in zip(panels, FIELDS, "vρ", strict=True):
        _draw_work_precision(axes, benchmark, kinds, benchmark[f"{field}_error_exact"])
        axes.set_ylabel(f"relative L² error of {field} {symbol}")
    lower.suptitle(
        f"Fastest run with errors of v and ρ at most {AS_ACCURATE} times those of SPH", fontsize=8
    )
    rankings = lower.subplots(1, len(groups), squeeze=False)[0]
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
    quartiles = _quartiles(benchmark["cpu_seconds"])
    median, own = quartiles[1], _own(benchmark)
    finite = values <= WORST_ERROR
    shown = np.where(finite, values, np.nan)
    _scale_log(axes.xaxis, quartiles[::2].ravel())
    _scale_log(axes.yaxis, values[finite], room=0.1, few_below=300)
    axes.set_xlabel("CPU time [s]")
    times, best = _pareto_front(median, values)
    right, top = axes.get_xlim()[1], axes.get_ylim()[1]
    corners = np.repeat([*times, right], 2)[:-1], np.repeat([top, *best], 2)[1:]
    axes.plot(*corners, color=PALE, linewidth=3, zorder=1)
    axes.axhline(shown[own], color=DIM, linewidth=0.6, linestyle=(0, (5, 2)))
    for kind in kinds:
        rows, look = kind.rows, kind.look
        _draw_bars(axes, quartiles[:, rows], shown[rows], look["color"], elinewidth=0.4)
        same, over = _joined(benchmark, kind)
        axes.plot(median[over], shown[over], **{**look, "linestyle": ":"})
        axes.plot(median[same], shown[same], **look)
        _mark_breakdown(axes, median[rows[~finite[rows]]], look)
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
    quartiles, good = _quartiles(benchmark["cpu_seconds"]), _as_accurate(benchmark)
    _scale_log(axes.xaxis, quartiles[::2].ravel())
    middle = np.sqrt(np.prod(axes.get_xlim()))
    key = axes.get_yaxis_transform() + ScaledTranslation(-7 / 72, 0, axes.figure.dpi_scale_trans)
    box = {"facecolor": "white", "edgecolor": "none", "pad": 0.5}
    text: Look = {"va": "center_baseline", "color": DIM, "fontsize": 7, "zorder": 2, "bbox": box}
    for height, kind in enumerate(kinds):
        look = {**kind.look, "linestyle": ""}
        axes.plot(0, height, transform=key, clip_on=False, **look)
        rows = kind.rows[good[kind.rows]]
        if not len(rows):
            axes.text(middle, height, "none", ha="center", **text)
            continue
        fastest = rows[quartiles[1, rows].argmin()]
        lower, median, upper = quartiles[:, fastest]
        _draw_bars(axes, quartiles[:, [fastest]], np.array([height]), look["color"], elinewidth=0.6)
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
        parts.append(f"tolerance {_short(tolerance)}")
    elif np.isfinite(step):
        parts.append(f"Δt = {_short(step)} s")
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
        text = axes.text(0, 0, label.text, color=label.colour, fontsize=7, in_layout=False)
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
    operations in `sphpod.rom` and `sphpod.lifted_rom` let expect; that of frozen models holds where
    their tensor takes fewer operations than the particles.

    Parameters
    ----------
    scaling
        One entry a measurement: `contender`, `contender_particle_count`, `contender_mode_count` (0
        of a full model), `step_seconds` of shape (contender, repeat), `memory_bytes`. Reduced
        models stand against particles at the mode count that most entries have, and against modes
        at the particle count that most entries have, if there with several.

    Raises
    ------
    ValueError
        A contender is of no known kind.
    """
    counts, modes = scaling["contender_particle_count"], scaling["contender_mode_count"]
    reduced = modes > 0
    usual = {"N": _most_frequent(counts[reduced]), "k": _most_frequent(modes[reduced])}
    kinds = _kinds(scaling["contender"], SCALED_RUNS)
    seconds = _quartiles(scaling["step_seconds"])
    memory = np.broadcast_to(scaling["memory_bytes"], seconds.shape)
    over_particles = ~reduced | (modes == usual["k"])
    over_modes = reduced & (counts == usual["N"])
    figure = Figure(figsize=(PAGE_WIDTH, 2.7), layout="constrained")
    panels = []
    for name, values in (("time a step [s]", seconds), ("memory [B]", memory)):
        curves = _curves(kinds, over_particles, counts, values)
        panels.append((name, "number of particles N", curves, _particle_guides(curves)))
    curves = _curves(kinds, over_modes, modes, seconds)
    curves = [curve for curve in curves if len(set(curve.x)) > 1]
    guides = _mode_guides(curves, usual["N"])
    panels.append(("time a step [s]", "number of modes k", curves, guides))
    every = figure.subplots(1, len(panels))
    for axes, (name, over, curves, guides) in zip(every, panels, strict=True):
        _draw_curves(axes, curves, guides)
        axes.set(xlabel=over, ylabel=name)
        fixed = "N" if over.endswith("k") else "k"
        axes.set_title(f"reduced models: {fixed} = {usual[fixed]}", loc="right")
    handles = {
        label: handle
        for axes in figure.axes
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=3)
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
    """Operations a step of a frozen model by its tensor (`sphpod.rom`), to leading orders."""
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
        _draw_bars(axes, quartiles, x, kind.look["color"], along="y", elinewidth=0.6)
        axes.plot(x, quartiles[1], label=kind.label, **kind.look)
    _scale_log(axes.xaxis, np.concatenate([curve.x for curve in curves]))
    heights = [curve.quartiles.ravel() for curve in curves] + [guide.y for guide in guides]
    _scale_log(axes.yaxis, np.concatenate(heights), room=0.12, few_below=300)


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


# --- Initial velocity -----------------------------------------------------------------------------


@styled
def initial_spectrum(solution: Arrays) -> Figure:
    """Draw the amplitudes of the discrete Fourier modes of an initial velocity (figure C.2).

    Those below 1e-12 of the largest are rounding noise and grey.

    Parameters
    ----------
    solution
        `velocity` [m/s] of shape (t, x), its first time 0.
    """
    velocity = solution["velocity"][0]
    count = len(velocity)
    amplitude = np.abs(np.fft.rfft(velocity)) * 2 / count
    amplitude[0] /= 2
    if count % 2 == 0:
        amplitude[-1] /= 2
    harmonic = np.arange(len(amplitude))
    figure = Figure(figsize=(HALF_WIDTH, 2.25), layout="constrained")
    axes = figure.subplots()
    _scale_log(axes.yaxis, amplitude)
    noise = amplitude < ROUNDING * amplitude.max()
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
    return figure


# --- Phase ----------------------------------------------------------------------------------------


@styled
def phase(sph: Arrays, exact: Arrays, modified: Arrays, position: float, beta: float) -> Figure:
    """Draw the velocity of one particle in time, in two rows (figure C.6).

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
    figure = Figure(figsize=(PAGE_WIDTH, 2.9), layout="constrained")
    rows = figure.subplots(2, 1, sharey=True)
    duration = exact["t"][-1]
    for row, axes in enumerate(rows):
        start, end = row * duration / 2, (row + 1) * duration / 2
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
    rows[1].set_xlabel("time t [s]")
    figure.supylabel(f"velocity v at x = {x[particle]:g} m [{unit}]", fontsize=8)
    figure.legend(*rows[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure
