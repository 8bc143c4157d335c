"""Figures of surveys: drawn, and nothing in them overlaps."""

import numpy as np
import pytest
from figure_checks import check_layout, visible_texts, x_of

from sphpod.figures import survey_plots
from sphpod.surveys import samples

PARAMETERS = {
    "stiffness": {"nominal": 0.1, "range": [0.05, 0.2], "scale": "logarithmic"},
    "decay": {"nominal": 1, "range": [0, 2], "scale": "linear"},
}
MANY = PARAMETERS | {word: {"nominal": 0.5, "range": [0, 1]} for word in ("a", "b", "c", "d", "e")}
LABELS = {"peak": "peak", "energy": "energy [J/m²]"}


def answers():
    random = np.random.default_rng(0)
    return {
        "stiffness": np.exp(random.uniform(np.log(0.05), np.log(0.2), 50)),
        "decay": random.uniform(0, 2, 50),
        "peak": np.where(np.arange(50) == 3, np.nan, random.uniform(1, 2, 50)),
        "energy": random.uniform(0, 1e-6, 50),
        "certified": (random.uniform(size=50) > 0.3).astype(np.int8),
    }


def test_responses() -> None:
    check_layout(survey_plots.responses(answers(), PARAMETERS, LABELS))


@pytest.mark.parametrize("parameters", [PARAMETERS, MANY])
def test_sections(parameters) -> None:
    points = samples.spread(parameters, np.tile(np.linspace(0, 1, 9)[:, None], len(parameters)))
    found = {word: np.tile(points[:, n], len(parameters)) for n, word in enumerate(parameters)}
    for name in LABELS:
        values = np.where(found["decay"] == 2, np.nan, found["stiffness"] * found["decay"])
        found |= {name: values, f"{name}_low": values - 0.01, f"{name}_high": values + 0.01}
    figure = survey_plots.sections(found, parameters, LABELS)
    check_layout(figure)
    assert len(figure.axes) == 2 * len(parameters)
    # The section of the second parameter is drawn in its panel.
    assert x_of(figure.axes[1].lines[0]).max() == 2


def test_surfaces() -> None:
    grid = samples.points(PARAMETERS, {"grid": {"stiffness": 5, "decay": 4}})
    found = {word: grid[:, n] for n, word in enumerate(PARAMETERS)}
    found |= {"peak": grid[:, 0], "energy": grid[:, 1], "surface": np.zeros(2, np.int32)}
    figure = survey_plots.surfaces(found, PARAMETERS, LABELS)
    check_layout(figure)
    peak, energy = (np.asarray(axes.collections[0].get_array()) for axes in figure.axes[:2])
    # Stiffness runs to the right, damping upwards.
    assert np.ptp(peak, axis=0).max() == 0
    assert np.ptp(energy, axis=1).max() == 0


def test_histograms() -> None:
    check_layout(survey_plots.histograms(answers(), LABELS))


def test_indices() -> None:
    values = {f"{kind}_index{end}": np.full((2, 2), 0.4) for kind in ("first", "total")
              for end in ("", "_low", "_high")}  # fmt: skip
    names = {"quantity": np.array(["peak", "energy"]), "parameter": np.array(list(PARAMETERS))}
    check_layout(survey_plots.indices(values | names))


@pytest.mark.slow
@pytest.mark.parametrize("change", [1e-9, 3e-6, 1e-4, 0, np.nan])
def test_what_hardly_varies_or_is_not_there_has_its_panel(change) -> None:
    hardly = 3.3221314e-13 * (1 + change * np.linspace(0, 1, 50))
    grid = samples.points(PARAMETERS, {"grid": {"stiffness": 5, "decay": 10}})
    found = answers() | {word: grid[:, n] for n, word in enumerate(PARAMETERS)}
    found |= {f"peak{end}": hardly for end in ("", "_low", "_high")}
    found |= {f"energy{end}": found["energy"] for end in ("_low", "_high")}
    found["surface"] = np.zeros(2, np.int32)
    indices = {f"{kind}_index{end}": np.array([[change, change], [0.4, 0.5]]) - change
               for kind in ("first", "total") for end in ("", "_low", "_high")}  # fmt: skip
    names = {"quantity": np.array(["peak", "energy"]), "parameter": np.array(list(PARAMETERS))}
    for figure in (
        survey_plots.responses(found, PARAMETERS, LABELS),
        survey_plots.sections(found, PARAMETERS, LABELS),
        survey_plots.surfaces(found, PARAMETERS, LABELS),
        survey_plots.histograms(found, LABELS),
        survey_plots.indices(indices | names),
    ):
        check_layout(figure)
        said = [text for text in visible_texts(figure) if text.get_text() == "no values"]
        assert bool(said) == bool(np.isnan(change))


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 4])
def test_long_names_and_narrow_ranges_have_their_place(count) -> None:
    random = np.random.default_rng(0)
    ranges = {"at_one": [1.0, 1.00002], "tiny": [-3e-7, 1e-7], "damping_of_the_middle": [0.0, 1.0]}
    layers = [f"stiffness_of_the_{side}_layer" for side in ("first", "second", "third")]
    ranges |= {word: [0.0, 1.0] for word in layers}
    parameters = {word: {"nominal": ends[0], "range": ends} for word, ends in ranges.items()}
    labels = {
        f"velocity_in_the_middle_{n}": f"velocity_in_the_middle_{n} [m/s]" for n in range(count)
    }
    size = 9 * len(ranges)
    found = {
        word: np.tile(np.linspace(ends[0], ends[1], 9), len(ranges))
        for word, ends in ranges.items()
    }
    found |= {
        f"{q}{end}": random.uniform(size=size) for q in labels for end in ("", "_low", "_high")
    }
    found["certified"] = np.ones(size, np.int8)
    names = {"quantity": np.array(list(labels)), "parameter": np.array(list(ranges))}
    values = {f"{kind}_index{end}": np.full((count, len(ranges)), 0.4)
              for kind in ("first", "total") for end in ("", "_low", "_high")}  # fmt: skip
    check_layout(survey_plots.responses(found, parameters, labels))
    check_layout(survey_plots.sections(found, parameters, labels))
    check_layout(survey_plots.histograms(found, labels))
    check_layout(survey_plots.indices(values | names))


def test_errors() -> None:
    true = np.array([1e-3, 4e-4, 2e-3])
    found = {"true_error": true, "relative_estimate": true, "relative_bound": 12 * true}
    for count in (1, 3):
        figure = survey_plots.errors({name: values[:count] for name, values in found.items()}, 1e-2)
        check_layout(figure)
        assert set(figure.axes[0].get_xticks()) >= {1}
        assert all(tick.is_integer() for tick in figure.axes[0].get_xticks())


def test_cost() -> None:
    names = ["sph", "lifted_full", "lifted_full", "fourier", "reduced", "reduced_bounded"]
    seconds = np.array([8e-2, 2e-3, 0.1, 1e-3, 1.5e-3, 1e-2])
    found = {
        "contender": np.array(names),
        "integrator": np.array(["explicit_euler", "symplectic_euler", *["exact"] * 4]),
        "query_seconds": seconds[:, None] * np.array([1, 1.1, 0.9]),
        "training_seconds": np.array([6.0, 7.0, 8.0]),
        "break_even": np.array([100, np.inf, 78, np.inf, np.nan, np.nan]),
        "break_even_unbounded": np.array([89, 14000, 71, np.inf, np.nan, np.nan]),
    }
    figure = survey_plots.cost(found)
    check_layout(figure)
    marks = [line for line in figure.axes[0].lines if line.get_marker() == "o"]
    assert [np.size(line.get_xdata()) for line in marks] == [2, 1, 0]


def test_design() -> None:
    found = {
        "designed": np.array(["decay", "peak"]),
        "decay": np.array([0.7, 0.8]),
        "peak_full": np.array([2.1e-2, 2e-2]),
        "evaluation_round": np.repeat([0, 1], [20, 10]),
        "evaluation_excess": np.where(np.arange(30) % 3, 0, 0.1),
        "evaluation_value": np.stack([np.linspace(0, 1, 30), np.linspace(4e-2, 2e-2, 30)], axis=1),
    }
    keys = {"minimise": "decay", "where": {"peak": {"at_most": 2e-2}}}
    check_layout(survey_plots.design(found, keys, LABELS))
    alone = {
        **found,
        "designed": np.array(["peak"]),
        "evaluation_value": found["evaluation_value"][:, 1:],
    }
    check_layout(survey_plots.design(alone, {"reach": {"peak": 2e-2}, "where": {}}, LABELS))
