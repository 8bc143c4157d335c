"""Figures show what they promise, nothing overlaps, and the same data give the same bytes."""

import os
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest
from figure_checks import check_layout, curves, on_top_edge, texts, visible_texts, x_of, y_of
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import AsinhNorm
from matplotlib.figure import Figure

from sphpod.figures import benchmark_plots, plotting
from sphpod.reduced.pod import ROUNDING_LEVEL

Arrays = dict[str, np.ndarray]
Settings = dict[str, Any]

SPREAD = np.array([1, 1.02, 0.97, 1.05, 0.99])
"""Repeats of a timing, relative to their median."""


def solution(damping: float = 0.0, particles: int = 80, samples: int = 401) -> Arrays:
    """A standing wave that fades, its density following."""
    t, x = np.linspace(0, 10, samples), np.arange(particles) / particles
    fading, phase = np.exp(-damping * t)[:, None], 2 * np.pi * np.sqrt(0.1) * t[:, None]
    return {
        "t": t,
        "x": x,
        "velocity": 3e-3 * fading * np.cos(phase) * np.sin(2 * np.pi * x),
        "density": 1 - 2e-2 * fading * np.sin(phase) * np.cos(2 * np.pi * x),
    }


def pod(velocity_modes: int = 30, density_modes: int = 30, particles: int = 80) -> Arrays:
    """Orthonormal modes whose singular values fall by four orders of magnitude a mode.

    Rounding turns those from the fifth on.
    """
    shapes = np.linalg.qr(np.random.default_rng(1).normal(size=(particles, particles)))[0]
    return {
        "x": np.arange(particles) / particles,
        "velocity_modes": shapes[:velocity_modes],
        "density_modes": shapes[:density_modes],
        "velocity_singular_values": 0.03 * 1e-4 ** np.arange(velocity_modes),
        "density_singular_values": 90 * 1e-4 ** np.arange(density_modes),
        "velocity_mode_rounding": np.where(np.arange(velocity_modes) < 4, 1e-3, 0.1),
        "density_mode_rounding": np.where(np.arange(density_modes) < 4, 1e-3, 0.1),
        "velocity_span_rounding": np.where(np.arange(velocity_modes) < 4, 1e-3, 0.1),
        "density_span_rounding": np.where(np.arange(density_modes) < 4, 1e-3, 0.1),
    }


def sweep(count: int = 20) -> Arrays:
    falling = 10.0 ** -np.linspace(-1, 9, count)
    return {
        "mode_count": np.arange(1, count + 1),
        "modes_resolved": np.ones(count, np.int8),
        "velocity_error_sph": falling,
        "density_error_sph": 1e-2 * falling,
        "velocity_error_reference": falling + 0.06,
        "density_error_reference": 1e-2 * falling + 4e-4,
    }


def errors() -> Arrays:
    return {
        "solution": np.array(["sph", "fd"]),
        "reference": np.array(["exact", "fd"]),
        "velocity_error": np.array([[0.07, 0.06], [0.01, np.nan]]),
        "density_error": np.array([[3e-4, 4e-4], [3e-4, np.nan]]),
    }


def study(counts: tuple[int, ...] = (8, 12), seconds: float = 0.1) -> tuple[Arrays, Arrays]:
    """Errors and CPU times of an acceleration study."""
    steps = {"original": 0, "linearized": 0, "frozen1": 1, "frozen2": 2, "frozen5": 5}
    steps["frozen10"] = 10
    rows = [("sph_neighbour_lists", 0, 0, 1.0), ("sph_stencil", 0, 0, 0.3)]
    for count in counts:
        for name, n in steps.items():
            rows.append((name, count, n, (0.05 + 0.6 / n if n else 0.9) * (1 + count / 50)))
    names, mode_counts, freezes, cost = zip(*rows, strict=True)
    velocity = np.array([[0.03 * 8 / count for count in counts]] * len(steps))
    acceleration = {
        "contender": np.array(list(steps)),
        "mode_count": np.array(counts),
        "acceleration_velocity_error": velocity,
        "acceleration_density_error": velocity / 500,
    }
    cpu_time = {
        "contender": np.array(names),
        "contender_mode_count": np.array(mode_counts),
        "n_freeze": np.array(freezes),
        "cpu_seconds": seconds * np.array(cost)[:, None] * SPREAD,
    }
    return acceleration, cpu_time


def benchmark(counts: tuple[int, ...] = (4, 8, 12)) -> Arrays:
    """All kinds of runs; errors of the spacing, and besides those of few modes or a tolerance."""
    rows: list[tuple[float, float, Settings]] = [(0.08, 1, {})]
    euler: Settings
    lifted: Settings
    frozen: Settings
    for step in (2e-4, 5e-4, 1e-4):
        euler = {"contender": "sph_stencil", "contender_time_step": step}
        rows.append((5e-6 / step, 1 + 50 * step, euler))
        for integrator in ("explicit_euler", "symplectic_euler", "leapfrog"):
            lifted = euler | {"contender": "lifted_full_stencil", "integrator": integrator}
            rows.append((2e-6 / step, 1 + 10 * step, lifted))
    for integrator, seconds in (("rk45", 0.07), ("dop853", 0.13)):
        for factor, tolerance in ((1.9, 1e-3), (1, 1e-5)):
            lifted = {"contender": "lifted_full_stencil", "integrator": integrator}
            lifted |= {"contender_tolerance": tolerance, "contender_time_step": np.nan}
            rows.append((seconds / factor, factor, lifted))
    lifted = {
        "contender": "lifted_full_stencil",
        "integrator": "exact",
        "contender_time_step": np.nan,
    }
    rows.append((0.05, 1, lifted))
    for ratio in (0.25, 0.5, 2):
        count: Settings = {"contender_particle_count": int(100 * ratio)}
        euler = {"contender": "sph_stencil", "contender_time_step": 2e-4 / ratio}
        rows.append((0.025 * ratio**2, ratio**-2, euler | count))
        rows.append((0.05 * ratio, ratio**-2, lifted | count))
    for k in counts:
        modes: Settings = {"contender_mode_count": k}
        error = 1 + 40 * 2.0**-k
        rows.append((0.004 * k, error, modes | {"contender": "original"}))
        rows.append((0.004 * k, error, modes | {"contender": "linearized"}))
        for n in (1, 2, 5, 10):
            frozen = {"contender": f"frozen{n}", "n_freeze": n}
            rows.append((0.004 * k / (1 + n / 4), error, modes | frozen))
        repeats: Settings = {"contender": "lifted_euler", "integrator": "repeats explicit_euler"}
        rows.append((2e-5 * k, error - 0.3, modes | repeats))
        rows.append((2.2e-5 * k, error - 0.3, modes | lifted | {"contender": "lifted_exact"}))
    usual: Settings = {
        "contender": "sph_neighbour_lists",
        "integrator": "explicit_euler",
        "contender_mode_count": 0,
        "n_freeze": 0,
        "contender_particle_count": 100,
        "contender_time_step": 2e-4,
        "contender_tolerance": np.nan,
    }
    times, errors = (np.array([row[place] for row in rows]) for place in (0, 1))
    return {
        name: np.array([row[2].get(name, value) for row in rows]) for name, value in usual.items()
    } | {
        "cpu_seconds": times[:, None] * SPREAD,
        "velocity_error_exact": 7e-3 * errors,
        "density_error_exact": 3e-5 * errors,
    }


def broken_benchmark() -> Figure:
    runs = benchmark()
    broken = (runs["contender"] == "original") & (runs["contender_mode_count"] == 8)
    runs["velocity_error_exact"][broken] = np.nan
    return benchmark_plots.work_precision(runs)


def scaling_study(most: int = 6) -> Arrays:
    """Times and memory up to 10^most particles, and over modes with 10^4 of them."""
    sizes = [10**exponent for exponent in range(2, most + 1)]
    rows = []
    for n in sizes:
        rows.append(("sph_neighbour_lists", n, 0, 2e-8 * n + 1e-7, 300 * n))
        rows.append(("sph_stencil", n, 0, 3e-9 * n + 1e-7, 40 * n))
        rows.append(("lifted_full_stencil", n, 0, 1.5e-9 * n + 8e-8, 32 * n))
    for n, k in [*((n, 12) for n in sizes), *((10_000, k) for k in (4, 6, 8, 16, 24, 32))]:
        tensor = k**2 + k**3 * (k + 1) / 20
        rows.append(("original", n, k, 1e-9 * k * n + 1e-7, 24 * k * n))
        rows.append(("frozen10", n, k, 3e-10 * tensor + 3e-8, 4 * k**4))
        rows.append(("lifted_exact", n, k, 2e-10 * k + 2e-9, 1600 * k))
    contender, particles, modes, seconds, memory = zip(*rows, strict=True)
    return {
        "contender": np.array(contender),
        "contender_particle_count": np.array(particles),
        "contender_mode_count": np.array(modes),
        "step_seconds": np.array(seconds)[:, None] * SPREAD,
        "memory_bytes": np.array(memory, np.int64),
    }


def broken_error() -> Figure:
    broken = sweep()
    for values in (broken["velocity_error_sph"], broken["density_error_reference"]):
        # Not a number is an error without a size, which is no breakdown.
        values[[1, 2, 6]] = 1e4, np.inf, np.nan
    broken["velocity_error_sph"][4] = 1e80
    return plotting.error(pod(), broken, errors(), "fd")


def unresolved_error() -> Figure:
    noisy = sweep()
    noisy["modes_resolved"][[4, *range(9, 20)]] = 0
    noisy["velocity_error_sph"][12] = np.inf
    return plotting.error(pod(), noisy, errors(), "fd")


def phase() -> Figure:
    exact, sph = solution(), solution(samples=801)
    return plotting.phase(sph, exact, exact, position=0.3, beta=1.0224)


def spectrum() -> Figure:
    x = np.arange(200) / 200
    return plotting.initial_spectrum({"velocity": 1e-3 * np.exp(-200 * (x - 0.5) ** 2)[None]})


FIGURES: dict[str, Callable[[], Figure]] = {
    "spring": plotting.spring,
    "profile": lambda: plotting.profile(solution()),
    "profile, fading": lambda: plotting.profile(solution(2.0), ["velocity", "density_change"]),
    "modes": lambda: plotting.modes(pod()),
    "modes, few": lambda: plotting.modes(pod(3, 4)),
    "modes, five": lambda: plotting.modes(pod(5, 5)),
    "error": lambda: plotting.error(pod(), sweep(), errors(), "fd"),
    "error, few modes": lambda: plotting.error(pod(3, 4), sweep(4), errors(), "exact"),
    "error, breakdown": broken_error,
    "error, near rounding": unresolved_error,
    "acceleration": lambda: plotting.acceleration(*study(), errors(), "fd"),
    "acceleration, one mode count": lambda: plotting.acceleration(*study((12,)), errors(), "fd"),
    "acceleration, quick": lambda: plotting.acceleration(*study(seconds=1e-4), errors(), "fd"),
    "work_precision": lambda: benchmark_plots.work_precision(benchmark()),
    "work_precision, breakdown": broken_benchmark,
    "work_precision, full models": lambda: benchmark_plots.work_precision(benchmark(())),
    "scaling": lambda: benchmark_plots.scaling(scaling_study()),
    "scaling, fewer particles": lambda: benchmark_plots.scaling(scaling_study(5)),
    "initial_spectrum": spectrum,
    "phase": phase,
}


@cache
def figure_of(name: str) -> Figure:
    return FIGURES[name]()


def pixels(axes: Axes) -> np.ndarray:
    return np.asarray(axes.images[0].get_array())


@pytest.mark.slow
@pytest.mark.parametrize("name", FIGURES)
def test_nothing_overlaps_and_no_panel_is_empty(name: str) -> None:
    check_layout(figure_of(name))


@pytest.mark.parametrize("name", FIGURES)
def test_text_has_print_size(name: str) -> None:
    figure = figure_of(name)
    assert figure.get_figwidth() == plotting.COLUMN_WIDTH
    assert figure.get_figheight() < 9
    assert {text.get_fontsize() for text in visible_texts(figure)} <= {6, 7, 8, 12}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["profile", "error", "work_precision"])
def test_same_figure_same_bytes(name: str, tmp_path: Path) -> None:
    for run in "ab":
        plotting.save(FIGURES[name](), tmp_path / f"{run}.pdf", tmp_path / f"{run}.png")
    for form in ("pdf", "png"):
        assert (tmp_path / f"a.{form}").read_bytes() == (tmp_path / f"b.{form}").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.pdf", "a.png", "b.pdf", "b.png"]
    pdf = (tmp_path / "a.pdf").read_bytes()
    assert b"CreationDate" not in pdf
    assert b"/CIDFontType2" in pdf  # fonttype 42: text stays text
    assert len(pdf) < 300_000


@pytest.mark.workflow
def test_another_process_writes_the_same_bytes(tmp_path: Path) -> None:
    """Neither the order of sets nor the user's own settings for matplotlib get into the files."""
    (tmp_path / "matplotlibrc").write_text("font.size: 20\nlines.linewidth: 7\n")
    script = (
        "import sys; from sphpod.figures import plotting;"
        "plotting.save(plotting.spring(), *sys.argv[1:])"
    )
    contents = set()
    for seed, folder in (("1", tmp_path), ("2", tmp_path / "absent")):
        paths = tmp_path / f"{seed}.pdf", tmp_path / f"{seed}.png"
        environment = {
            **os.environ,
            "PYTHONHASHSEED": seed,
            "SOURCE_DATE_EPOCH": seed,
            "MATPLOTLIBRC": str(folder),
            "PYTHONPATH": str(Path(plotting.__file__).parents[1]),
        }
        subprocess.run([sys.executable, "-c", script, *paths], check=True, env=environment)
        contents.add(tuple(path.read_bytes() for path in paths))
    assert len(contents) == 1


def test_style_stays_inside() -> None:
    before = dict(matplotlib.rcParams)
    plotting.spring()
    assert dict(matplotlib.rcParams) == before


def test_profile_panels() -> None:
    line, picture, bar = plotting.profile(solution()).axes
    assert line.get_ylabel() == "initial velocity v₀ [10⁻³ m/s]"
    assert picture.get_ylabel() == "time t [s]"
    assert bar.get_ylabel() == "velocity v [10⁻³ m/s]"
    for axes in (line, picture):
        assert axes.get_xlabel() == "position x [m]"
        assert axes.get_xlim() == (0, 1)
    # The line closes the period.
    (curve,) = curves(line, plotting.BLUE)
    assert (x_of(curve)[0], x_of(curve)[-1]) == (0, 1)
    assert y_of(curve)[0] == y_of(curve)[-1]
    low, high = picture.images[0].get_clim()
    assert low is not None
    assert high == -low == np.abs(pixels(picture)).max()


def test_profile_of_a_bar_ends_at_its_last_particle() -> None:
    drawn = solution()
    drawn["x"] = np.linspace(0, 1, drawn["x"].size)
    line, picture, _ = plotting.profile(drawn, length=1.0).axes
    (curve,) = curves(line, plotting.BLUE)
    assert np.array_equal(x_of(curve), drawn["x"])
    assert pixels(picture).shape[1] == drawn["x"].size
    half = 0.5 / (drawn["x"].size - 1)
    assert np.allclose(picture.images[0].get_extent()[:2], (-half, 1 + half))


def test_profile_of_a_fading_field_has_a_compressed_scale() -> None:
    velocity, density, *bars = plotting.profile(solution(2.0), ["velocity", "density_change"]).axes
    assert [bar.get_ylabel() for bar in bars] == [
        "velocity v [10⁻³ m/s]",
        "density ρ − ρ₀ [10⁻³ kg/m³]",
    ]
    for axes in (velocity, density):
        assert isinstance(axes.images[0].norm, AsinhNorm)
        assert len(pixels(axes)) <= 601
    assert np.ptp(pixels(density)[0]) == 0


def test_profile_of_an_unknown_field() -> None:
    with pytest.raises(ValueError, match="not 'pressure'"):
        plotting.profile(solution(), ["pressure"])


@pytest.mark.parametrize(("counts", "shown"), [((30, 30), (12, 12)), ((3, 4), (3, 4))])
def test_modes_panels(counts: tuple[int, int], shown: tuple[int, int]) -> None:
    figure = plotting.modes(pod(*counts))
    titles = [axes.get_title().splitlines() for axes in figure.axes]
    expected = [f"velocity mode {number + 1}" for number in range(shown[0])]
    expected += [f"density mode {number + 1}" for number in range(shown[1])]
    assert [title[0] for title in titles] == expected
    assert titles[1][1] == "σ₂/σ₁ = 10⁻⁴"
    for block in (figure.axes[: shown[0]], figure.axes[shown[0] :]):
        assert len({axes.get_ylim() for axes in block}) == 1


def test_modes_that_rounding_turns_are_grey() -> None:
    # One level for figures and datasets, though neither's code depends on the other's.
    assert plotting.TURNED == ROUNDING_LEVEL
    figure = plotting.modes(pod())
    colours = [axes.lines[-1].get_color() for axes in figure.axes]
    assert colours[:4] == [plotting.BLUE] * 4
    assert colours[4:12] == [plotting.GREY] * 8
    assert colours[12:16] == [plotting.VERMILLION] * 4
    assert colours[16:] == [plotting.GREY] * 8


def test_error_panels() -> None:
    left, right = plotting.error(pod(), sweep(), errors(), "fd").axes
    assert left.get_yscale() == right.get_yscale() == "log"
    assert (left.get_xlabel(), right.get_xlabel()) == ("mode number", "number of modes k")
    assert right.get_ylabel() == "relative L² error"
    assert len(x_of(curves(left, plotting.BLUE)[0])) == 4
    assert [len(x_of(line)) for line in curves(left, plotting.GREY)] == [
        26,
        26,
        0,
    ]  # and of the legend
    labels = right.get_legend_handles_labels()[1]
    assert labels == [
        f"{symbol}, {comparison}"
        for symbol in "vρ"
        for comparison in ("POD against SPH", "POD against reference", "SPH against reference")
    ] + ["k = 6: POD error below SPH's"]
    assert left.get_xticks().tolist() == [1, 10, 20, 30]
    assert right.get_xticks().tolist() == [1, 5, 10, 15, 20]
    # SPH against the reference asked for, as a level line.
    assert list(y_of(curves(right, plotting.NAVY)[0])) == [0.06, 0.06]
    assert list(y_of(curves(right, plotting.BROWN)[0])) == [4e-4, 4e-4]
    looks = [(line.get_color(), line.get_linestyle(), line.get_marker()) for line in right.lines]
    assert len({colour for colour, _, _ in looks}) == len(looks) == 7
    assert len({marker for _, _, marker in looks} - {"None", ""}) == 4
    assert len({line for _, line, _ in looks[:-1]}) == 4


def test_the_threshold_is_marked_where_both_errors_are_below_those_of_sph() -> None:
    found = sweep()
    works = (found["velocity_error_sph"] < 0.06) & (found["density_error_sph"] < 4e-4)
    k = found["mode_count"][works][0]
    right = plotting.error(pod(), found, errors(), "fd").axes[1]
    assert x_of(curves(right, plotting.GREEN)[0])[0] == k
    none = {**found, "density_error_sph": np.ones(20)}
    assert not curves(plotting.error(pod(), none, errors(), "fd").axes[1], plotting.GREEN)


def test_singular_values_beyond_the_thirtieth_stand_in_an_inset() -> None:
    many = pod(80, 60) | {
        "velocity_singular_values": 0.8 ** np.arange(80),
        "density_singular_values": 0.7 ** np.arange(60),
    }
    left = plotting.error(many, sweep(), errors(), "fd").axes[0]
    (inset,) = left.child_axes
    assert left.get_xlim()[1] < 32 < 80 < inset.get_xlim()[1]
    assert sum(len(x_of(line)) for line in inset.lines) == 140
    assert not plotting.error(pod(), sweep(), errors(), "fd").axes[0].child_axes


def test_the_last_singular_value_is_grey_where_those_before_it_are() -> None:
    """The span of all snapshots is what rounding never turns, which says nothing of the last."""
    turned = np.where(np.arange(80) < 30, 1e-3, 0.1)
    turned[-1] = 1e-14
    many = pod(80, 80)
    for field in plotting.FIELDS:
        many |= {f"{field}_span_rounding": turned, f"{field}_singular_values": 0.8 ** np.arange(80)}
    left = plotting.error(many, sweep(), errors(), "fd").axes[0]
    (inset,) = left.child_axes
    assert isinstance(inset, Axes)
    for colour in (plotting.BLUE, plotting.VERMILLION):
        assert x_of(curves(inset, colour)[0])[-1] == 30
    assert [x_of(line)[-1] for line in curves(inset, plotting.GREY)] == [80, 80]
    # Where all are known, so is the last.
    few = pod(3, 4)
    blue, red = (
        curves(plotting.error(few, sweep(4), errors(), "fd").axes[0], colour)[0]
        for colour in (plotting.BLUE, plotting.VERMILLION)
    )
    assert (len(x_of(blue)), len(x_of(red))) == (3, 4)


def test_colours_show_the_sign_in_grey_and_the_ends_have_labels() -> None:
    grey = plotting.SIGNED(np.linspace(0, 1, 50))[:, :3] @ (0.299, 0.587, 0.114)
    assert np.all(np.diff(grey) > 0)
    _, picture, bar = plotting.profile(solution()).axes
    low, high = picture.images[0].get_clim()
    assert (bar.get_yticks()[0], bar.get_yticks()[-1]) == (low, high)
    positive = solution() | {"velocity": np.abs(solution()["velocity"])}
    picture = plotting.profile(positive).axes[1]
    low, high = picture.images[0].get_clim()
    assert low == 0
    assert high == np.abs(pixels(picture)).max()
    # Zero has the colour that it has beside negative values.
    np.testing.assert_allclose(picture.images[0].cmap(0.0), plotting.SIGNED(0.5), atol=0.01)


def test_layers_are_marked_and_named() -> None:
    layers = [(0.25, "c = 1 Pa"), (0.6, "c = 2 Pa")]
    line, picture, _ = plotting.profile(solution(), layers=layers).axes
    for axes in (line, picture):
        assert [text.get_text() for text in axes.texts] == ["c = 1 Pa", "c = 2 Pa"]
        marks = [x_of(mark)[0] for mark in curves(axes, plotting.BLACK)]
        assert marks == [0.25, 0.6]


def test_a_profile_ends_where_it_is_asked_to() -> None:
    times = solution()["t"]
    picture = plotting.profile(solution(), end_time=times[-1] / 4).axes[1]
    assert picture.get_ylim()[1] == pytest.approx(times[-1] / 4, rel=0.02)


def test_errors_of_modes_near_rounding_are_grey() -> None:
    figure = unresolved_error()
    right = figure.axes[1]
    assert plotting.UNRESOLVED_LABEL in right.get_legend_handles_labels()[1]
    known = np.setdiff1d(np.arange(20), [4, *range(9, 20)])
    for colour, marker in (
        (plotting.BLUE, "o"),
        (plotting.SKY, "^"),
        (plotting.VERMILLION, "s"),
        (plotting.ORANGE, "D"),
    ):
        coloured = next(line for line in curves(right, colour) if len(x_of(line)) == 20)
        np.testing.assert_array_equal(np.flatnonzero(np.isfinite(y_of(coloured))), known)
        (grey,) = (
            line
            for line in curves(right, plotting.GREY)
            if line.get_marker() == marker and len(x_of(line)) == 20
        )
        assert grey.get_zorder() < coloured.get_zorder()
        # Grey lines lead to the coloured ones, beneath them, and have gaps where models broke down.
        there = [3, 4, 5, 8, *range(9, 20)]
        if colour == plotting.BLUE:
            there.remove(12)
        np.testing.assert_array_equal(np.flatnonzero(np.isfinite(y_of(grey))), there)
    assert not [
        line for line in FIGURES["error"]().axes[1].lines if line.get_color() == plotting.GREY
    ]


def test_breakdown_is_marked_on_the_top_edge() -> None:
    right = broken_error().axes[1]
    marks = {line.get_color(): line for line in on_top_edge(right)}
    assert set(marks) == {plotting.BLUE, plotting.ORANGE}
    np.testing.assert_array_equal(np.round(x_of(marks[plotting.BLUE])), [2, 3, 5])
    np.testing.assert_array_equal(np.round(x_of(marks[plotting.ORANGE])), [2, 3])
    for mark in marks.values():
        assert not mark.get_clip_on()
        assert set(y_of(mark)) == {1}
    assert right.get_title(loc="right") == plotting.BREAKDOWN_NOTE
    # The curve has gaps there, and the limits keep to the finite errors.
    curve = y_of(curves(right, plotting.BLUE)[0])
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(curve)), [1, 2, 4, 6])
    assert right.get_ylim()[1] < plotting.WORST_ERROR


def test_no_breakdown_no_note() -> None:
    for name in ("error", "acceleration"):
        for axes in FIGURES[name]().axes:
            assert axes.get_title(loc="right") == ""
            assert not on_top_edge(axes)


def test_acceleration_panels() -> None:
    figure = plotting.acceleration(*study(), errors(), "fd")
    for axes, quantity in zip(figure.axes, ("velocity v", "density ρ"), strict=True):
        assert axes.get_xscale() == axes.get_yscale() == "log"
        assert axes.get_xlabel() == "CPU time [s]"
        assert axes.get_ylabel() == f"relative L² error of {quantity}"
        lines = dict(zip(*axes.get_legend_handles_labels()[::-1], strict=True))
        assert list(lines) == [
            f"k = {count}, {name}"
            for count in (8, 12)
            for name in ("original POD", "linearized density", "frozen for n steps")
        ] + ["SPH, neighbour lists", "SPH, even spacing", "error of SPH"]
        markers = [lines[label].get_marker() for label in list(lines)[2:-1]]
        assert markers == ["o", "s", "D", "o", "*", "*"]
        frozen = lines["k = 12, frozen for n steps"]
        assert frozen.get_linestyle() == "--"
        # The median of n = 1, 2, 5, 10.
        np.testing.assert_allclose(
            x_of(frozen), 0.1 * 1.24 * (0.05 + 0.6 / np.array([1, 2, 5, 10]))
        )
        dots = ", ".join(text.get_text() for text in axes.texts).split(", ")
        assert sorted(dots, key=int) == ["1", "1", "2", "2", "5", "5", "10", "10"]
    star, level = figure.axes[0].get_legend_handles_labels()[0][-2:]
    assert y_of(star) == [0.06]
    assert list(y_of(level)) == [0.06, 0.06]
    doubled = plotting.acceleration(*study(), errors(), "fd", multiples=[1, 2]).axes[0]
    lines = dict(zip(*doubled.get_legend_handles_labels()[::-1], strict=True))
    assert list(y_of(lines["2 times the error of SPH"])) == [0.12, 0.12]


def test_acceleration_that_breaks_down() -> None:
    acceleration, cpu_time = study((12,))
    acceleration["acceleration_velocity_error"][3] = np.inf
    velocity, density = plotting.acceleration(acceleration, cpu_time, errors(), "fd").axes
    (mark,) = on_top_edge(velocity)
    np.testing.assert_allclose(x_of(mark), [0.1 * 1.24 * (0.05 + 0.6 / 2)])
    assert velocity.get_title(loc="right") == plotting.BREAKDOWN_NOTE
    assert not on_top_edge(density)


def drawn(axes: Axes, look: plotting.Look) -> list[list[float]]:
    """Abscissae of the lines with a colour and a marker."""
    lines = [line for line in curves(axes, look["color"]) if line.get_marker() == look["marker"]]
    return [list(np.round(x_of(line), 9)) for line in lines if len(x_of(line))]


def test_work_precision_panels() -> None:
    runs = benchmark()
    velocity, density, full, reduced = benchmark_plots.work_precision(runs).axes
    for axes, quantity in ((velocity, "velocity v"), (density, "density ρ")):
        assert axes.get_xscale() == axes.get_yscale() == "log"
        assert axes.get_xlabel() == "CPU time [s]"
        assert axes.get_ylabel() == f"relative L² error of {quantity}"
        assert {"SPH, N = 100", "N = 25", "Pareto front", "k = 4", "k = 12"} <= set(texts(axes))
        # Every run stands at its median.
        places = np.concatenate([line.get_xydata() for line in axes.lines])
        errors = runs[f"{quantity.split()[0]}_error_exact"]
        for place in zip(runs["cpu_seconds"][:, 0], errors, strict=True):
            assert np.isclose(places, place, rtol=1e-9).all(axis=1).any()
    full_rows, reduced_rows = (
        [label.get_text() for label in axes.get_yticklabels()] for axes in (full, reduced)
    )
    assert full_rows[:3] == ["SPH, neighbour lists", "SPH, even spacing", "lifted, explicit Euler"]
    frozen = ["frozen for 1 step", *(f"frozen for {n} steps" for n in (2, 5, 10))]
    assert reduced_rows[:6] == ["original POD", "linearized density", *frozen]
    assert (len(full_rows), len(reduced_rows)) == (8, 8)
    assert full.get_xlim() == reduced.get_xlim() == velocity.get_xlim()


def test_work_precision_joins_runs_of_a_kind() -> None:
    velocity = benchmark_plots.work_precision(benchmark()).axes[0]
    stars = drawn(velocity, benchmark_plots.FULL_RUNS["sph_stencil"][1])
    assert [0.08] in stars  # neighbour lists
    assert [0.0015625, 0.00625, 0.025, 0.1] in stars  # N = 25, 50, 100, 200
    assert [0.05, 0.025, 0.01] in stars  # ascending time steps
    lifted = drawn(velocity, benchmark_plots.LIFTED_RUNS["lifted_exact"][1])
    assert [8.8e-5, 1.76e-4, 2.64e-4] in lifted  # k = 4, 8, 12
    assert drawn(velocity, benchmark_plots.FULL_RUNS["rk45"][1])[0] == [0.07, 0.036842105]


def test_labels_of_runs_cover_no_marker() -> None:
    figure = benchmark_plots.work_precision(benchmark())
    renderer = FigureCanvasAgg(figure).get_renderer()
    figure.draw_without_rendering()
    for axes in figure.axes[:2]:
        lines = [line for line in axes.lines if line.get_marker() != "None"]
        markers = axes.transData.transform(np.concatenate([line.get_xydata() for line in lines]))
        for text in axes.texts:
            box = text.get_window_extent(renderer)
            inside = np.all((markers > box.min) & (markers < box.max), axis=1)
            assert not inside.any(), text.get_text()


def test_pareto_front_is_what_nothing_beats() -> None:
    runs = benchmark()
    times, errors = runs["cpu_seconds"][:, 0], runs["velocity_error_exact"]
    (front,) = curves(benchmark_plots.work_precision(runs).axes[0], plotting.PALE)
    x, y = x_of(front), y_of(front)
    unbeaten = [
        place
        for place in zip(times, errors, strict=True)
        if not np.any((times <= place[0]) & (errors < place[1]))
        and not np.any((times < place[0]) & (errors <= place[1]))
    ]
    np.testing.assert_allclose(np.column_stack((x[1:-1:2], y[1:-1:2])), sorted(set(unbeaten)))
    assert np.all((np.diff(x) == 0) | (np.diff(y) == 0))


def test_fastest_runs_are_as_accurate_as_full_sph() -> None:
    runs = benchmark()
    # Frozen models lose their best in one field, which is enough; k = 8 is not.
    few = (runs["contender_mode_count"] == 12) & (runs["contender"] != "lifted_exact")
    runs["density_error_exact"][few] *= 2
    full, reduced = benchmark_plots.work_precision(runs).axes[2:]
    euler, adaptive = ["Δt = 5×10⁻⁴ s"] * 4, ["tolerance 10⁻⁵"] * 2
    assert texts(full) == ["Δt = 2×10⁻⁴ s", *euler, *adaptive, ""]
    assert texts(reduced) == [*["none"] * 6, "k = 8", "k = 8"]
    assert [0.01] in drawn(full, benchmark_plots.FULL_RUNS["sph_stencil"][1])


def test_work_precision_that_breaks_down() -> None:
    velocity, density, _, _ = broken_benchmark().axes
    (mark,) = on_top_edge(velocity)
    assert list(x_of(mark)) == [0.032]
    assert velocity.get_title(loc="right") == plotting.BREAKDOWN_NOTE
    assert not on_top_edge(density)


def test_work_precision_of_an_unknown_kind() -> None:
    runs = benchmark()
    runs["integrator"][runs["integrator"] == "rk45"] = "rk23"
    with pytest.raises(ValueError, match="no look for runs of rk23"):
        benchmark_plots.work_precision(runs)


def test_scaling_panels() -> None:
    seconds, memory, modes = benchmark_plots.scaling(scaling_study()).axes
    sizes = [100, 1000, 10_000, 100_000, 1_000_000]
    for axes, name in ((seconds, "time a step [s]"), (memory, "memory [B]")):
        assert (axes.get_xlabel(), axes.get_ylabel()) == ("number of particles N", name)
        assert axes.get_title(loc="right") == "reduced models: k = 12"
        lines, names = axes.get_legend_handles_labels()
        assert names == [
            "SPH, neighbour lists",
            "SPH, even spacing",
            "SPH, lifted",
            "original POD",
            "frozen for 10 steps",
            "lifted POD, exact in time",
        ]
        for line in lines:
            np.testing.assert_array_equal(x_of(line), sizes)
        assert texts(axes) == ["∝ N", "∝ N⁰"]
    assert modes.get_xlabel() == "number of modes k"
    assert modes.get_title(loc="right") == "reduced models: N = 10000"
    lines, names = modes.get_legend_handles_labels()
    assert names == ["original POD", "frozen for 10 steps", "lifted POD, exact in time"]
    for line in lines:
        np.testing.assert_array_equal(x_of(line), [4, 6, 8, 12, 16, 24, 32])
    assert sorted(texts(modes)) == ["∝ k", "∝ k", "∝ k² + k⁴/20"]
    np.testing.assert_allclose(y_of(memory.get_legend_handles_labels()[0][0])[0], 300 * 100)


def test_scaling_guides_have_the_slopes_they_name() -> None:
    seconds, _, modes = benchmark_plots.scaling(scaling_study()).axes

    def slopes(axes: Axes) -> list[float]:
        ends = [(x_of(line)[[0, -1]], y_of(line)[[0, -1]]) for line in curves(axes, plotting.GREY)]
        return [float(np.log(y[1] / y[0]) / np.log(x[1] / x[0])) for x, y in ends]

    np.testing.assert_allclose(slopes(seconds), [1, 0], atol=1e-12)
    tensor = np.log((32**2 + 32**4 / 20) / (4**2 + 4**4 / 20)) / np.log(32 / 4)
    np.testing.assert_allclose(slopes(modes), [1, 1, tensor])


def test_scaling_leaves_out_models_of_one_mode_count() -> None:
    study = scaling_study()
    lifted = study["contender"] == "lifted_exact"
    kept = ~lifted | (study["contender_mode_count"] == 12)
    modes = benchmark_plots.scaling({name: values[kept] for name, values in study.items()}).axes[2]
    assert modes.get_legend_handles_labels()[1] == ["original POD", "frozen for 10 steps"]


def test_initial_spectrum() -> None:
    x = np.arange(64) / 64
    velocity = 0.5 + 3 * np.sin(2 * np.pi * x) + 0.25 * np.cos(2 * np.pi * 5 * x)
    (axes,) = plotting.initial_spectrum({"velocity": velocity[None]}).axes
    assert axes.get_yscale() == "log"
    (shown,) = curves(axes, plotting.BLUE)
    np.testing.assert_array_equal(x_of(shown), [0, 1, 5])
    np.testing.assert_allclose(y_of(shown), [0.5, 3, 0.25])


def test_phase_looks_at_the_nearest_particle_over_the_whole_duration() -> None:
    exact = solution()
    figure = plotting.phase(solution(samples=801), exact, exact, position=0.299, beta=1.0224)
    upper, *_, lower = figure.axes
    assert len(figure.axes) == 4
    assert (upper.get_xlim(), lower.get_xlim()) == ((0, 2.5), (7.5, 10))
    assert upper.get_legend_handles_labels()[1] == [
        "exact solution",
        "exact, waves β = 1.0224 times as fast",
        "SPH",
    ]
    np.testing.assert_allclose(y_of(upper.lines[0]), 1e3 * exact["velocity"][:101, 24], rtol=1e-12)
    assert any("x = 0.3 m [10⁻³ m/s]" in text.get_text() for text in visible_texts(figure))


def test_numbers_of_frozen_steps_are_listed_only_where_dots_are_close() -> None:
    """A list is wider than its dots, but does not take in what stands apart from all of them."""
    figure = Figure()
    axes = figure.subplots()
    axes.set(xscale="log", yscale="log", xlim=(1, 10), ylim=(1, 10))
    across = np.array([80.0, 83.0, 88.0, 104.0])  # of some 165 pt
    times, steps = 10 ** (across / plotting.PANEL_POINTS), np.array([10, 5, 2, 1])
    plotting._label_steps(axes, times, np.full(4, 2.0), steps, "black", above=True)
    assert [text.get_text() for text in axes.texts] == ["10, 5, 2", "1"]
    left, right = (text.get_position()[0] for text in axes.texts)
    assert left < 2 < right
