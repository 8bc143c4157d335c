"""Figures of stability show predictions beside measurements, and hide nothing of either."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from figure_checks import check_layout, curves, on_top_edge, texts, visible_texts, x_of, y_of
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from sphpod.figures import plotting, stability_plots
from sphpod.figures.stability_plots import SCENE_LOOKS, Place
from sphpod.scene import kernel

Arrays = dict[str, np.ndarray]

UNDAMPED = (
    "three_harmonics",
    "ten_harmonics",
    "gaussian",
    "gaussian_coarse",
    "high_frequency",
    "two_moduli",
)
SCENES = (*UNDAMPED, "damped", "damped_forced", "mildly_damped_forced")


# --- What there is to draw ------------------------------------------------------------------------


def damping_map(size: int = 25, fastest: float = 60.0) -> Arrays:
    """Waves of ω = 1 to `fastest` under explicit Euler, the fastest under leapfrog."""
    damping, steps = np.geomspace(1, 300, size), np.geomspace(1e-4, 0.3, size)
    frequency = np.linspace(1, fastest, 60).astype(complex)
    root = np.sqrt(damping[:, None] ** 2 / 4 - frequency**2)
    rates = np.stack([-damping[:, None] / 2 + root, -damping[:, None] / 2 - root])
    euler = np.log(np.abs(1 + steps * rates[..., None])).max(axis=(0, 2))
    decay = np.exp(-damping[:, None] * steps)
    half_trace = (1 - (fastest * steps) ** 2 / 2) * (1 + decay) / 2
    split = np.sqrt((half_trace**2 - decay).astype(complex))
    leapfrog = np.log(np.abs([half_trace + split, half_trace - split]).max(axis=0))
    real = np.abs(rates.real)
    limits = np.min(2 * real / np.abs(rates) ** 2, axis=(0, 2))
    return {
        "map_integrator": np.array(["explicit_euler", "leapfrog"]),
        "map_damping": damping,
        "map_time_step": steps,
        "map_growth": np.stack([euler, leapfrog]),
        "map_limit": np.stack([limits, np.full(size, 2 / fastest)]),
    }


def mode_map(damping: float = 10.0, most: int = 20, size: int = 25) -> Arrays:
    """Underdamped waves of ω from 6 on, and no limit without damping."""
    counts, steps = np.arange(1, most + 1), np.geomspace(1e-4, 0.3, size)
    frequency = 4 + 2 * counts
    rate = -damping / 2 + np.sqrt((damping**2 / 4 - frequency**2).astype(complex))
    growth = np.log(np.abs(1 + steps * rate[:, None]))
    limit = damping / frequency**2 if damping else np.full(most, np.nan)
    return {
        "contender": np.array(["original", "lifted_euler"]),
        "mode_count": counts,
        "map_time_step": steps,
        "mode_growth": np.stack([growth, growth]),
        "mode_limit": np.stack([limit, limit]),
    }


def grown(breaking: str = "ten_harmonics") -> dict[Place, Arrays]:
    """Gains of energy from 1e-3 to 60; one scene breaks down at t = 34 s, predicted 33 s."""
    scenes: dict[Place, Arrays] = {}
    for gain, name in zip(np.geomspace(1e-3, 0.5, len(UNDAMPED)), UNDAMPED, strict=True):
        broken = np.array([False, name == breaking])
        predicted = 1 + gain * np.array([1, 120])
        scenes[name,] = {
            "horizon": np.array([10.0, 100.0]),
            "predicted_energy_growth": np.where(broken, 1e40, predicted),
            "measured_energy_growth": np.where(broken, np.nan, 1 + 1.01 * (predicted - 1)),
            "predicted_breakdown_time": np.where(broken, 33.0, np.nan),
            "measured_breakdown_time": np.where(broken, 34.0, np.nan),
            "conserving": np.array(["symplectic_euler", "leapfrog", "exact"]),
            "energy_drift": gain * np.array([1e-12, 3e-12, 1e-13]),
            "energy_horizon": np.array(1000.0),
        }
    return scenes


def reduced_operators() -> dict[str, dict[Place, Arrays]]:
    """Operators that grow here and there in ρ and never in e, and random ones."""
    tables: dict[str, dict[Place, Arrays]] = {"samplings": {}, "random": {}, "runs": {}}
    rng = np.random.default_rng(1)
    samplings = [("three_harmonics", f"random100_{seed}", 20) for seed in range(8)]
    samplings += [("ten_harmonics", f"half_period_{count}", count) for count in range(12, 21)]
    samplings += [("damped", "uniform12", 12), ("mildly_damped_forced", "uniform20", 20)]
    for scene, sampling, most in samplings:
        counts = np.arange(1, most + 1)
        damped = 0.1 * counts if "damped" in scene else 0
        growing = np.where(counts % 3 == 0, 10.0 ** rng.uniform(-4, 0, most), 1e-16)
        tables["samplings"][scene, sampling] = {
            "mode_count": counts,
            "euclidean_growth_rate": growing - damped,
            "euclidean_rounding": np.full(most, 1e-3),
            "frozen_growth_rate": 2 * growing - damped,
            "frozen_rounding": np.full(most, 1e-15),
            "energy_growth_rate": rng.normal(size=most) * 1e-15 - damped,
            "operator_size": 3.0 * counts,
        }
    for scene in SCENES:
        size = 10 ** rng.uniform(0, 2, 1112)
        growing = rng.exponential(0.05, 1112) * rng.choice([0, 1], 1112)
        tables["random"][scene,] = {
            "random_euclidean_growth_rate": size * growing,
            "random_energy_growth_rate": size * rng.normal(size=1112) * 3e-16,
            "random_operator_size": size,
        }
    time = np.linspace(0, 10, 301)
    places: list[Place] = [("two_moduli",), ("three_harmonics", "uniform100")]
    for place in places:
        tables["runs"][place] = {
            "t": time,
            "paper_energy": 1e-6 * np.exp(0.9 * time),
            "lifted_energy": 1e-6 * np.exp(-0.02 * time),
        }
    return tables


def smoothed() -> dict[Place, Arrays]:
    ratios = np.unique(np.append(1 + np.geomspace(0.01, 2, 40), (1.04, 1.06, 1.2)))
    beta = np.array([kernel.derivative_coefficient(ratio) for ratio in ratios])
    dispersion = np.array([kernel.dispersion_coefficient(ratio) for ratio in ratios])
    scenes: dict[Place, Arrays] = {}
    for number, name in enumerate(SCENES, start=1):
        errors = np.abs(beta - 1) + 1e-3 * number * dispersion
        scenes[name,] = {
            "smoothing_ratio": ratios,
            "scene_smoothing_ratio": np.array((1.04, 1.06, 1.2)[number % 3]),
            "derivative_coefficient": beta,
            "dispersion_coefficient": dispersion,
            "neighbour_count": np.array([kernel.neighbour_count(ratio) for ratio in ratios]),
            "stable_time_step": number * ratios,
            "smoothing_velocity_error": errors,
            "smoothing_density_error": errors / 200,
        }
    return scenes


def scaled() -> Arrays:
    """Up to 0.99 of the factor at which full SPH folds, and beyond it."""
    factors = np.append(np.geomspace(1, 42, 11), 53.0)
    errors = np.array([[2e-3], [2e-3], [3e-3], [1e-4], [1e-10]]) * factors ** [
        [0.3],
        [1.6],
        [1.3],
        [1.0],
        [0.1],
    ]
    errors[1, 8:] = np.inf
    errors = np.concatenate([np.full((2, 12), np.nan), errors])
    errors[:, -1] = np.nan
    return {
        "amplitude": factors,
        "smallest_jacobian": np.append(1 - factors[:-1] / 42.5, -0.3),
        "folding_amplitude": np.array(42.5),
        "contender": np.array(["sph", "lifted_full", *stability_plots.AMPLITUDE_RUNS]),
        "scaled_velocity_error": errors,
        "scaled_density_error": errors / 100,
    }


REFUSALS = {
    "not a number": "velocity_snapshots: snapshot 50 is nan at particle 200: all values must be "
    "finite",
    "density not positive": "density_snapshots: snapshot 50 is -0.991234 at particle 200: all "
    "values must be finite and above 0",
    "no snapshots": "velocity_snapshots: there are 0 snapshots: at least 1 is needed",
}


def poor_snapshots() -> Arrays:
    noise = 10.0 ** np.arange(-8, 0)
    error = np.hypot(1e-6, 0.3 * noise)
    defects = ["none", "too few", "too early", "single precision", "more modes than particles"]
    found = np.array([1e-6, 0.02, 0.5, 3e-3, 1e-9, *[np.nan] * len(REFUSALS)])
    outcomes = ["within its bound"] * 5
    outcomes += [f"scene ten_harmonics: {reason}" for reason in REFUSALS.values()]
    return {
        "noise": noise,
        "noise_error": error,
        "noise_bound": 8 * error,
        "noise_original_error": np.hypot(4e-3, 12 * noise),
        "defect": np.array([*defects, *REFUSALS]),
        "defect_mode_count": np.array([8, 8, 8, 8, 401, 8, 8, 8]),
        "defect_rank": np.array([100, 2, 8, 100, 100, 0, 0, 0]),
        "defect_error": found,
        "defect_bound": 12 * found,
        "defect_outcome": np.array(outcomes),
    }


def compared() -> dict[Place, Arrays]:
    """Full models of all scenes and reduced ones of some; measurements off by 1e-6 to 6e-3."""
    integrators = ["explicit_euler", "symplectic_euler", "leapfrog", "rk45", "dop853", "exact"]
    full = [("sph", "explicit_euler"), *(("lifted_full", name) for name in integrators)]
    reduced = [(name, "explicit_euler") for name in ("original", "frozen10", "lifted_euler")]
    reduced.append(("lifted_exact", "exact"))
    rng = np.random.default_rng(2)
    tables = {}
    places: list[Place] = [(name,) for name in SCENES]
    places += [("ten_harmonics", "uniform20"), ("damped", "uniform12"), ("damped", "uniform20")]
    for place in places:
        runs = 3 * reduced if len(place) > 1 else full
        models, steppers = np.array(runs).T
        limited = (steppers != "explicit_euler") | ("damped" in place[0])
        predicted = np.where(steppers == "exact", np.inf, 10 ** rng.uniform(-3, -1, len(runs)))
        off = 1 + 10 ** rng.uniform(-6, -2.2, len(runs))
        tables[place] = {
            "contender": models,
            "integrator": steppers,
            "predicted_time_step": np.where(limited, predicted, np.nan),
            "measured_time_step": np.where(limited, predicted * off, np.nan),
            "predicted_growth_rate": np.where(limited, np.nan, predicted),
            "measured_growth_rate": np.where(limited, np.nan, predicted * off),
        }
    return tables


def undecided_limits() -> Figure:
    """A run whose growth no one predicted, and one that does not grow as predicted."""
    tables = compared()
    tables["damped",]["measured_time_step"][2] = np.nan
    tables["gaussian",]["measured_growth_rate"][0] = np.nan
    return stability_plots.time_steps(tables)


def broken_noise() -> Figure:
    snapshots = poor_snapshots()
    snapshots["noise_original_error"][-1] = np.inf
    snapshots["defect_bound"][2] = np.inf
    return stability_plots.poor_snapshots(snapshots)


def broken_smoothing() -> Figure:
    scenes = smoothed()
    scenes["damped",]["smoothing_velocity_error"][-2:] = 1e4, np.inf
    return stability_plots.smoothing(scenes)


def broken_operators() -> Figure:
    tables = reduced_operators()
    tables["samplings"]["damped", "uniform12"]["frozen_growth_rate"][3] = np.nan
    tables["runs"]["two_moduli",]["paper_energy"][200:] = np.inf
    return stability_plots.operators(**tables)


def quiet_growth() -> Figure:
    return stability_plots.growth(grown(breaking=""))


def samplings_alone() -> Figure:
    return stability_plots.operators(reduced_operators()["samplings"], {}, {})


FIGURES: dict[str, Callable[[], Figure]] = {
    "stability_map": lambda: stability_plots.stability_map(damping_map(), mode_map()),
    "stability_map, no damping": lambda: stability_plots.stability_map(damping_map(), mode_map(0)),
    "growth": lambda: stability_plots.growth(grown()),
    "growth, no breakdown": quiet_growth,
    "operators": lambda: stability_plots.operators(**reduced_operators()),
    "operators, samplings alone": samplings_alone,
    "operators, not finite": broken_operators,
    "smoothing": lambda: stability_plots.smoothing(smoothed()),
    "smoothing, breakdown": broken_smoothing,
    "amplitude": lambda: stability_plots.amplitude(scaled()),
    "noise": lambda: stability_plots.poor_snapshots(poor_snapshots()),
    "noise, breakdown": broken_noise,
    "limits": lambda: stability_plots.time_steps(compared()),
    "limits, undecided": undecided_limits,
}


@pytest.mark.slow
@pytest.mark.parametrize("name", FIGURES)
def test_nothing_overlaps_and_text_has_print_size(name: str) -> None:
    figure = FIGURES[name]()
    check_layout(figure)
    assert figure.get_figwidth() == plotting.COLUMN_WIDTH
    assert figure.get_figheight() < 9
    assert {text.get_fontsize() for text in visible_texts(figure)} <= {6, 7}


@pytest.mark.slow
def test_same_figure_same_bytes(tmp_path) -> None:
    """The map's pictures too, which are drawn in pixels."""
    contents = set()
    for run in "ab":
        paths = tmp_path / f"{run}.pdf", tmp_path / f"{run}.png"
        plotting.save(FIGURES["stability_map"](), *paths)
        contents.add(tuple(path.read_bytes() for path in paths))
    assert len(contents) == 1
    assert len(paths[0].read_bytes()) < 300_000


def edge(axes: Axes, side: float) -> list[Line2D]:
    """Lines on the left (0) or right (1) edge."""
    lines = [line for line in axes.lines if line.get_transform() == axes.get_yaxis_transform()]
    return [line for line in lines if len(x_of(line)) and set(x_of(line)) == {side}]


def rows(axes: Axes) -> list[str]:
    return [label.get_text() for label in axes.get_yticklabels()]


def points(axes: Axes, look: plotting.Look, **more: object) -> np.ndarray:
    """Points of the lines of a look, shape (points, 2)."""
    wanted = {**look, **more}
    lines = [
        line
        for line in axes.lines
        if line.get_transform() == axes.transData
        and all(getattr(line, f"get_{name}")() == value for name, value in wanted.items())
    ]
    return np.concatenate([np.reshape(line.get_xydata(), (-1, 2)) for line in lines])


# --- Map ------------------------------------------------------------------------------------------


def test_maps_show_growth_red_and_decay_blue_with_the_limit_between() -> None:
    damping, modes = damping_map(), mode_map()
    figure = stability_plots.stability_map(damping, modes)
    *panels, bar = figure.axes
    titles = [axes.get_title(loc="left") for axes in panels]
    assert titles == [
        "full model,\nexplicit Euler",
        "original POD,\nexplicit Euler",
        "full model,\nleapfrog",
        "lifted POD,\nexplicit Euler",
    ]
    assert "growth" in bar.get_xlabel()
    # Full models stand left, reduced ones right.
    panels = panels[::2] + panels[1::2]
    fields = [*damping["map_growth"], *modes["mode_growth"]]
    for axes, growth, x in zip(
        panels, fields, [damping["map_damping"]] * 2 + [modes["mode_count"]] * 2, strict=True
    ):
        (mesh,) = (found for found in axes.collections if isinstance(found, QuadMesh))
        np.testing.assert_array_equal(mesh.get_array(), growth.T)
        low, high = mesh.get_clim()
        assert low == -high
        decaying, growing = np.asarray(mesh.to_rgba(np.array([low, high])))
        assert decaying[0] < decaying[2]
        assert growing[0] > growing[2]
        # Cells lie about their values.
        assert axes.get_yscale() == "log"
        edges = np.asarray(mesh.get_coordinates())[0, :, 0]
        assert np.all((edges[:-1] < x) & (x < edges[1:]))
    assert {mesh.get_clim() for axes in panels for mesh in axes.collections} == {
        panels[0].collections[0].get_clim()
    }
    np.testing.assert_array_equal(y_of(panels[0].lines[-1]), damping["map_limit"][0])
    # Over mode counts the limit has steps, as the cells.
    np.testing.assert_array_equal(y_of(panels[2].lines[-1])[::2], modes["mode_limit"][0])
    np.testing.assert_array_equal(x_of(panels[2].lines[-1])[:4], [0.5, 1.5, 1.5, 2.5])


def test_maps_say_where_no_step_is_stable_and_leave_what_is_unknown_grey() -> None:
    damping = damping_map()
    damping["map_growth"][0, 3, 4] = np.nan
    damping["map_growth"][0, 5, 6] = np.inf
    panels = stability_plots.stability_map(damping, mode_map(0)).axes
    notes = [texts(axes) for axes in panels[:4]]
    assert notes == [[], ["no step is stable"], [], ["no step is stable"]]
    field = panels[0].collections[0].get_array()
    assert field is not None
    hidden = np.argwhere(np.ma.getmaskarray(field))
    assert hidden.tolist() == [[4, 3], [6, 5]]


def test_maps_refuse_what_they_cannot_show() -> None:
    damping = damping_map()
    damping["map_damping"][0] = 0
    with pytest.raises(ValueError, match="damping of zero"):
        stability_plots.stability_map(damping, mode_map())
    modes = mode_map() | {"contender": np.array(["original", "quadratic"])}
    with pytest.raises(ValueError, match="no label for the model quadratic"):
        stability_plots.stability_map(damping_map(), modes)


# --- Growth ---------------------------------------------------------------------------------------


def test_growth_pairs_predictions_with_measurements() -> None:
    scenes = grown()
    gains, breakdowns, drifts = stability_plots.growth(scenes).axes
    assert rows(gains) == [name.replace("_", " ") for name in UNDAMPED]
    for run, look in enumerate(stability_plots.HORIZON_LOOKS[:2]):
        for kind, style in (("predicted", "none"), ("measured", "full")):
            expected = np.array([
                scene[f"{kind}_energy_growth"][run] - 1
                for (name,), scene in scenes.items()
                if not (run and name == "ten_harmonics")
            ])  # fmt: skip
            drawn = points(gains, look, fillstyle=style)[:, 0]
            # The last of them labels the legend.
            np.testing.assert_allclose(drawn[: len(expected)], expected)
    told = texts(gains)
    assert told.count("breaks down before T = 100 s") == 1
    assert told.count("1 %") == 2 * len(UNDAMPED) - 1
    pair = points(breakdowns, {"marker": "D"})
    np.testing.assert_allclose(pair, [[33, 1], [34, 1]])
    assert texts(breakdowns).count("none") == len(UNDAMPED) - 1
    assert "3 %" in texts(breakdowns)
    # Energies kept, and the line they must stay left of.
    assert drifts.get_title(loc="left") == "energies kept, T = 1000 s"
    assert [1e-10, 1e-10] in [list(x_of(line)) for line in drifts.lines]
    for place, look in enumerate(stability_plots.CONSERVING_LOOKS.values()):
        kept = [scene["energy_drift"][place] for scene in scenes.values()]
        np.testing.assert_allclose(points(drifts, look)[:, 0], kept)


def test_growth_without_breakdown_has_no_panel_for_it() -> None:
    assert [axes.get_title(loc="left") for axes in quiet_growth().axes] == [
        "explicit Euler",
        "energies kept, T = 1000 s",
    ]


def test_growth_tells_of_a_breakdown_that_only_theory_or_only_the_run_sees() -> None:
    for kind, missing in (("predicted", "measured"), ("measured", "predicted")):
        scenes = grown()
        scenes["ten_harmonics",][f"{missing}_breakdown_time"][:] = np.nan
        assert f"only {kind}" in texts(stability_plots.growth(scenes).axes[1])
    # What would break down after the end is no breakdown.
    scenes = grown(breaking="")
    scenes["gaussian",]["predicted_breakdown_time"][:] = 340
    assert len(stability_plots.growth(scenes).axes) == 2


def test_growth_puts_energies_without_a_logarithm_on_the_edges() -> None:
    scenes = grown()
    scenes["gaussian",]["energy_drift"][:2] = 0, np.inf
    drifts = stability_plots.growth(scenes).axes[2]
    (left,), (right,) = edge(drifts, 0), edge(drifts, 1)
    assert left.get_marker() == stability_plots.CONSERVING_LOOKS["symplectic_euler"]["marker"]
    assert right.get_marker() == stability_plots.CONSERVING_LOOKS["leapfrog"]["marker"]
    for mark in (left, right):
        assert not mark.get_clip_on()
        assert round(y_of(mark)[0]) == 2


def test_growth_refuses_what_it_cannot_show() -> None:
    with pytest.raises(ValueError, match="at least one scene"):
        stability_plots.growth({})
    scenes = grown()
    scenes["gaussian",]["conserving"] = np.array(["verlet", "leapfrog", "exact"])
    with pytest.raises(ValueError, match="energies kept by verlet"):
        stability_plots.growth(scenes)


def test_energies_that_do_not_grow_stand_on_the_left_edge_and_leave_the_scale_alone() -> None:
    scenes = grown()
    usual = stability_plots.growth(scenes).axes[0]
    still: Arrays = {**scenes["two_moduli",], **{
        f"{kind}_energy_growth": np.full(2, 1 + gain) for kind, gain in
        (("predicted", 0.0), ("measured", -2e-16))}}  # fmt: skip
    figure = stability_plots.growth({**scenes, ("still",): still})
    check_layout(figure)
    gains = figure.axes[0]
    assert gains.get_xlim() == pytest.approx(usual.get_xlim())
    last = len(scenes) - 0.5
    ends = [
        x for line in gains.lines for x, y in zip(x_of(line), y_of(line), strict=True) if y > last
    ]
    assert set(ends) == {gains.get_xlim()[0]}
    assert texts(gains).count("none") == 2
    alone = stability_plots.growth({("still",): still})
    check_layout(alone)


# --- Operators ------------------------------------------------------------------------------------


def test_operators_show_every_sampling_in_the_colour_of_its_scene() -> None:
    tables = reduced_operators()
    panels = stability_plots.operators(**tables).axes
    colours = dict(zip(("three_harmonics", "ten_harmonics", "damped"), SCENE_LOOKS, strict=False))
    for axes, kind in zip(panels[:3], stability_plots.OPERATORS, strict=True):
        assert axes.get_yscale() == "symlog"
        for scene, look in colours.items():
            own = [table for (name, _), table in tables["samplings"].items() if name == scene]
            rates, counts = (
                np.concatenate([table[name] for table in own])
                for name in (f"{kind}_growth_rate", "mode_count")
            )
            # What rounding may have moved from zero is hollow.
            hollow = np.abs(rates) <= {"euclidean": 1e-3, "frozen": 1e-15}.get(kind, 0)
            for chosen, filling in ((hollow, "none"), (~hollow, "full")):
                drawn = points(axes, look, fillstyle=filling)
                expected = np.column_stack([counts, rates])[chosen]
                assert sorted(drawn.tolist()) == sorted(expected.tolist())
        # Rounding is what lies within the band, in proportion to the largest operator.
        (band,) = axes.patches
        assert isinstance(band, Rectangle)
        np.testing.assert_allclose((band.get_y(), band.get_height()), (-6e-12, 1.2e-11))


def test_share_of_random_bases_that_grow_faster() -> None:
    tables = reduced_operators()
    axes = stability_plots.operators(**tables).axes[3]
    assert axes.get_title(loc="left") == f"{1112 * len(SCENES)} random bases"
    lines = [line for line in axes.lines if len(x_of(line))]
    expected = [
        (table, kind) for table in tables["random"].values() for kind in ("euclidean", "energy")
    ]
    for line, (table, kind) in zip(lines, expected, strict=True):
        assert line.get_linestyle() == {"euclidean": "-", "energy": ":"}[kind]
        rates = table[f"random_{kind}_growth_rate"] / table["random_operator_size"]
        for level in (1e-15, 1e-6, 1e-2, 0.1):
            shown = y_of(line)[np.searchsorted(x_of(line), level, "right") - 1]
            assert shown == pytest.approx(np.mean(rates > level))


def test_runs_are_drawn_where_there_are_any() -> None:
    runs = stability_plots.operators(**reduced_operators()).axes[4:]
    assert [axes.get_title(loc="left") for axes in runs] == [
        "two moduli, random modes: energy",
        "three harmonics, POD modes of uniform100: energy",
    ]
    for axes in runs:
        assert axes.get_yscale() == "log"
        paper, lifted = axes.lines
        assert y_of(paper)[0] == y_of(lifted)[0] == 1
        assert y_of(paper)[-1] == pytest.approx(np.exp(9))
    assert len(samplings_alone().axes) == 3
    without = stability_plots.operators(**reduced_operators() | {"runs": {}})
    assert len(without.axes) == 4


def test_operators_mark_what_is_not_finite() -> None:
    figure = broken_operators()
    panels = figure.axes
    assert "top edge: not finite" in [text.get_text() for text in visible_texts(figure)]
    assert "top edge: broken down" in [text.get_text() for text in visible_texts(figure)]
    (rate,), (energy,) = on_top_edge(panels[1])[-1:], on_top_edge(panels[4])
    assert list(x_of(rate)) == [4]
    np.testing.assert_allclose(x_of(energy), [200 / 30])


def test_operators_need_a_sampling() -> None:
    with pytest.raises(ValueError, match="at least one scene"):
        stability_plots.operators(**reduced_operators() | {"samplings": {}})


def test_no_key_is_made_of_two_names() -> None:
    """Scenes and samplings whose names would be the same when joined, and a scene ``random``."""
    tables = reduced_operators()
    table, *_ = tables["samplings"].values()
    pairs: list[Place] = [
        ("a_b", "c"),
        ("a", "b_c"),
        ("a__b", "c"),
        ("a", "b__c"),
        ("rounding", "a"),
        ("random", "a"),
    ]
    rates = {pair: {**table, "energy_growth_rate": table["energy_growth_rate"] - n}
             for n, pair in enumerate(pairs, 1)}  # fmt: skip
    random: dict[Place, Arrays] = {
        (scene,): next(iter(tables["random"].values())) for scene, _ in pairs
    }
    figure = stability_plots.operators(
        rates, random, {("run", "run"): tables["runs"]["two_moduli",]}
    )
    labels = [text.get_text() for text in figure.subfigs[0].legends[0].get_texts()]
    assert labels == ["rounding", "a b", "a", "a  b", "rounding", "random"]
    drawn = [y for line in figure.axes[2].lines if line.get_marker() != "None" for y in y_of(line)]
    for table in rates.values():
        assert set(table["energy_growth_rate"].tolist()) <= set(drawn)
    assert figure.axes[-1].get_title(loc="left") == "run, POD modes of run: energy"


# --- Smoothing ------------------------------------------------------------------------------------


def test_smoothing_panels() -> None:
    scenes = smoothed()
    beta, stable, velocity, density, dispersion, neighbours = stability_plots.smoothing(scenes).axes
    first = scenes["three_harmonics",]
    for axes, name in (
        (beta, "derivative_coefficient"),
        (dispersion, "dispersion_coefficient"),
        (neighbours, "neighbour_count"),
    ):
        shown = [y_of(line) for line in axes.lines]
        assert any(np.array_equal(values, first[name]) for values in shown), name
    # Of all scenes, relative to that at 1.04: the same.
    for line in stable.lines[: len(scenes)]:
        np.testing.assert_allclose(y_of(line), x_of(line) / 1.04)
    for axes, field in ((velocity, "velocity"), (density, "density")):
        assert axes.get_yscale() == "log"
        for line, scene in zip(axes.lines, scenes.values(), strict=False):
            np.testing.assert_array_equal(y_of(line), scene[f"smoothing_{field}_error"])
    for axes in (beta, stable, velocity, density):
        assert texts(axes) == ["1.04", "1.06", "1.2"]
        marked = [x_of(line)[0] for line in curves(axes, plotting.DIM)]
        assert marked == [1.04, 1.06, 1.2]
        # The paper's ratios stand apart.
        places = axes.transData.transform([(ratio, 1) for ratio in marked])[:, 0]
        assert np.diff(places).min() > 0.05 * axes.bbox.width


def test_smoothing_compares_time_steps_with_that_of_the_ratio_nearest_the_scenes_own() -> None:
    damped = smoothed()["damped",].items()
    scenes: Any = {("wave",): {name: values[-9:] for name, values in damped if np.ndim(values)}}
    ratios = scenes["wave",]["smoothing_ratio"]
    scenes["wave",]["scene_smoothing_ratio"] = ratios[3]
    figure = stability_plots.smoothing(scenes)
    stable = figure.axes[1]
    assert f"of that at {ratios[3]:g}" in stable.get_ylabel()
    assert y_of(stable.get_lines()[0])[3] == 1
    assert texts(figure.axes[0]) == [f"{ratios[3]:g}"]
    (own,) = (line for line in figure.axes[2].lines if line.get_markersize() == 7)
    assert x_of(own) == [ratios[3]]


def test_smoothing_marks_breakdown() -> None:
    velocity, density = broken_smoothing().axes[2:4]
    ratios = smoothed()["damped",]["smoothing_ratio"]
    marks = [line for line in on_top_edge(velocity) if line.get_marker() != "None"]
    assert [x_of(line).tolist() for line in marks] == [ratios[-2:].tolist()]
    assert not [line for line in on_top_edge(density) if line.get_marker() != "None"]


def test_smoothing_refuses_what_it_cannot_show() -> None:
    scenes = smoothed()
    scenes["gaussian",]["smoothing_ratio"] = scenes["gaussian",]["smoothing_ratio"] - 0.01
    with pytest.raises(ValueError, match="not above 1"):
        stability_plots.smoothing(scenes)


# --- Amplitude ------------------------------------------------------------------------------------


def test_amplitude_panels() -> None:
    runs = scaled()
    figure = stability_plots.amplitude(runs)
    compression = 1 - runs["smallest_jacobian"][:-1]
    for axes, field in zip(figure.axes, plotting.FIELDS, strict=True):
        assert axes.get_xscale() == axes.get_yscale() == "log"
        lines, labels = axes.get_legend_handles_labels()
        assert labels == [label for label, _ in stability_plots.AMPLITUDE_RUNS.values()]
        errors = runs[f"scaled_{field}_error"][2:, :-1]
        for line, values in zip(lines, errors, strict=True):
            assert isinstance(line, Line2D)
            np.testing.assert_array_equal(x_of(line), compression)
            np.testing.assert_array_equal(y_of(line), np.where(np.isinf(values), np.nan, values))
        (mark,) = on_top_edge(axes)[:1]
        assert mark.get_marker() == stability_plots.PAPER_RUNS["linearized"][1]["marker"]
        np.testing.assert_array_equal(x_of(mark), compression[8:])
        # Upper axis: the compression is proportional to the factor here.
        (upper,) = axes.child_axes
        told = [float(label.get_text()) for label in upper.get_xticklabels()]
        assert told == [1, 2, 5, 10, 20]
        np.testing.assert_allclose(upper.get_xticks(), np.array(told) / 42.5)
    title = figure.legends[0].get_title().get_text()
    assert "from 42 v₀" in title
    assert plotting.BREAKDOWN_NOTE in title


def test_amplitude_says_nothing_of_breakdown_where_there_is_nothing_to_compare_with() -> None:
    runs = scaled()
    runs["scaled_velocity_error"][3, 8:] = np.nan
    runs["scaled_density_error"][3, 8:] = np.nan
    figure = stability_plots.amplitude(runs)
    assert plotting.BREAKDOWN_NOTE not in figure.legends[0].get_title().get_text()
    for axes in figure.axes:
        assert not [line for line in on_top_edge(axes) if line.get_marker() != "None"]


def test_amplitude_refuses_what_it_cannot_show() -> None:
    runs = scaled()
    runs["smallest_jacobian"][:] = -1
    with pytest.raises(ValueError, match="at every amplitude"):
        stability_plots.amplitude(runs)
    runs = scaled()
    runs["contender"][3] = "quadratic"
    with pytest.raises(ValueError, match="no look for runs of quadratic"):
        stability_plots.amplitude(runs)


# --- Snapshots ------------------------------------------------------------------------------------


def test_noise_panels() -> None:
    snapshots = poor_snapshots()
    noise, defects = stability_plots.poor_snapshots(snapshots).axes
    assert noise.get_xscale() == noise.get_yscale() == defects.get_xscale() == "log"
    for name, (label, _) in stability_plots.NOISE_CURVES.items():
        (line,) = (line for line in noise.lines if line.get_label() == label)
        np.testing.assert_array_equal(x_of(line), snapshots["noise"])
        np.testing.assert_array_equal(y_of(line), snapshots[name])
    assert rows(defects)[:2] == ["none,\nk = 8, rank 100", "too few,\nk = 8, rank 2"]
    assert rows(defects)[-1] == "no snapshots,\nk = 8"
    heights = defects.get_yticks()
    for name, column in (("noise_error", "defect_error"), ("noise_bound", "defect_bound")):
        marker = stability_plots.NOISE_CURVES[name][1]["marker"]
        pairs = points(defects, {"marker": marker})
        np.testing.assert_array_equal(pairs, np.column_stack([snapshots[column], heights])[:5])
    # What was refused is told in words, without what all of them begin with.
    assert [text.replace("\n", " ") for text in texts(defects)] == list(REFUSALS.values())
    for text, height in zip(defects.texts, heights[5:], strict=True):
        assert text.get_position()[1] == height


def test_noise_marks_single_values_that_are_not_finite() -> None:
    noise, defects = broken_noise().axes
    (mark,) = on_top_edge(noise)
    assert list(x_of(mark)) == [0.1]
    (bound,) = edge(defects, 1)
    assert bound.get_marker() == stability_plots.NOISE_CURVES["noise_bound"][1]["marker"]
    assert y_of(bound)[0] == defects.get_yticks()[2]


def test_noise_refuses_snapshots_without_noise() -> None:
    snapshots = poor_snapshots()
    snapshots["noise"][0] = 0
    with pytest.raises(ValueError, match="without noise"):
        stability_plots.poor_snapshots(snapshots)


# --- Limits ---------------------------------------------------------------------------------------


def test_limits_compare_every_model() -> None:
    tables = compared()
    (axes,) = stability_plots.time_steps(tables).axes
    assert rows(axes) == [
        "SPH,\nexplicit Euler",
        *(
            f"SPH, lifted,\n{name}"
            for name in ("explicit Euler", "symplectic Euler", "leapfrog", "RK45", "DOP853")
        ),
        "SPH, lifted,\nexact in time",
        "original POD,\nexplicit Euler",
        "frozen for 10 steps,\nexplicit Euler",
        "lifted POD,\nexplicit Euler",
        "lifted POD,\nexact in time",
    ]
    shown = np.concatenate([
        points(axes, look, fillstyle=style)[:, 0]
        for look in SCENE_LOOKS
        for style in ("full", "none")
    ])  # fmt: skip
    predicted, measured = (
        np.concatenate([
            table[f"{kind}_{name}"]
            for table in tables.values()
            for name in ("time_step", "growth_rate")
        ])
        for kind in ("predicted", "measured")
    )  # fmt: skip
    told = np.isfinite(predicted)
    expected = np.abs(measured[told] / predicted[told] - 1)
    np.testing.assert_allclose(np.sort(shown), np.sort(expected))
    assert [0.01, 0.01] in [list(x_of(line)) for line in axes.lines]
    # Exact jumps have no limit, as predicted.
    exact = {y for line in edge(axes, 0) for y in np.round(y_of(line))}
    assert exact == {6, 10}
    assert not edge(axes, 1)


def test_limits_put_what_only_one_of_theory_and_run_tells_on_the_right_edge() -> None:
    (axes,) = undecided_limits().axes
    found = {(line.get_marker(), round(y_of(line)[0])) for line in edge(axes, 1)}
    damped, gaussian = (SCENE_LOOKS[SCENES.index(name)] for name in ("damped", "gaussian"))
    assert found == {(damped["marker"], 2), (gaussian["marker"], 0)}
    assert "right edge" in axes.get_title(loc="right")


def test_limits_refuse_what_they_do_not_know() -> None:
    with pytest.raises(ValueError, match="at least one scene"):
        stability_plots.time_steps({})
    tables = compared()
    tables["damped",]["integrator"][1] = "midpoint"
    with pytest.raises(ValueError, match="no label for the integrator midpoint"):
        stability_plots.time_steps(tables)
