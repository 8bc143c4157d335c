"""Figures of surveys: drawn, and nothing in them overlaps."""

import numpy as np
from figure_checks import check_layout

from sphpod.figures import survey_plots

PARAMETERS = {
    "stiffness": {"range": [0.05, 0.2], "scale": "logarithmic"},
    "decay": {"range": [0, 2], "scale": "linear"},
}
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


def test_histograms() -> None:
    check_layout(survey_plots.histograms(answers(), LABELS))


def test_indices() -> None:
    values = {f"{kind}_index{end}": np.full((2, 2), 0.4) for kind in ("first", "total")
              for end in ("", "_low", "_high")}  # fmt: skip
    names = {"quantity": np.array(["peak", "energy"]), "parameter": np.array(list(PARAMETERS))}
    check_layout(survey_plots.indices(values | names))


def test_errors() -> None:
    true = np.array([1e-3, 4e-4, 2e-3])
    found = {"true_error": true, "relative_estimate": true, "relative_bound": 12 * true}
    check_layout(survey_plots.errors(found, 1e-2))


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
