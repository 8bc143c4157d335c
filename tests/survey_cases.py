"""A small scene with parameters, and a survey of it."""

import copy
from typing import Any

SCENE: dict[str, Any] = {
    "domain_length": 1,
    "duration": 1,
    "initial_velocity": "1e-3*sin(2*pi*x/L) + 5e-4*cos(4*pi*x/L)",
    "initial_density": 1,
    "youngs_modulus": "stiffness*(1 + contrast*sin(2*pi*x/L))",
    "damping": "decay",
    "parameters": {
        "stiffness": {"nominal": 0.1, "range": [0.05, 0.2], "scale": "logarithmic"},
        "contrast": {"nominal": 0.3, "range": [0, 0.6]},
        "decay": {"nominal": 0.5, "range": [0, 1]},
    },
    "particle_count": 30,
    "smoothing_ratio": 1.04,
    "time_step": 2e-3,
    "error_interval": 0.01,
}

SURVEY: dict[str, Any] = {
    "scene": "bar",
    "training": {"count": 8},
    "mode_count": 8,
    "queries": {"count": 16},
    "chunk_size": 8,
    "validation": 3,
    "sobol_samples": 16,
    "quantities": {
        "sensor": {"kind": "history", "place": 0.3},
        "peak": {"kind": "maximum", "field": "strain", "place": 0.3, "width": 0.1},
        "last": {"kind": "energy"},
    },
}


def settings(of_scene=None, **survey):
    """Settings of a configuration with one scene and one survey, with changes of both."""
    return copy.deepcopy(
        {"scenes": {"bar": SCENE | (of_scene or {})}, "surveys": {"graded": SURVEY | survey}}
    )
