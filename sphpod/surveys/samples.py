"""Values of parameters: drawn from their ranges, on a grid, or from a table of one's own."""

import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np

from sphpod.scene.scene import Scene, physical_settings
from sphpod.surveys import distributions

Ranges = Mapping[str, Mapping[str, Any]]
"""Of each parameter its nominal value, range, and scale or distribution, as the configuration has
them."""


def scene_at(name: str, settings: Mapping[str, Any], values: Mapping[str, float]) -> Scene:
    """The scene of some settings with other values of its parameters."""
    return Scene.from_settings(name, {**settings, "parameters": dict(values)})


def survey_settings(settings: Mapping[str, Any], survey: Mapping[str, Any]) -> dict[str, Any]:
    """What of a scene's settings a survey depends on: those of its motion, with all ranges."""
    ranges = {"parameters": settings["parameters"], "error_interval": survey["output_interval"]}
    return physical_settings(settings) | ranges


def points(ranges: Ranges, queries: Mapping[str, Any]) -> np.ndarray:
    """Values of all parameters, as a block ``queries`` or ``training`` asks for them.

    Parameters
    ----------
    ranges : dict
    queries : dict
        count, sampling and seed; or grid, the number of values of each parameter (one that is not
        there has its nominal value); or from, a CSV with a column for each parameter.

    Returns
    -------
    array, shape (queries, parameters)

    Raises
    ------
    ValueError
        A CSV cannot be read, lacks a parameter, or has values outside a range.
    """
    if "grid" in queries:
        return _grid(ranges, queries["grid"])
    if "from" in queries:
        return _table(ranges, queries["from"])
    return spread(ranges, _unit(len(ranges), queries))


def _unit(dimensions, queries):
    """Points in the unit cube, (count, dimensions)."""
    from scipy.stats import qmc

    count, seed = queries["count"], queries.get("seed", 0)
    kind = queries.get("sampling", "sobol")
    if kind == "uniform":
        return np.random.default_rng(seed).uniform(size=(count, dimensions))
    designs = {"sobol": qmc.Sobol, "halton": qmc.Halton, "latin_hypercube": qmc.LatinHypercube}
    drawn = designs[kind](dimensions, rng=seed)
    if kind == "sobol":
        # A whole power of two is balanced; the first points of it are what is asked for.
        return drawn.random_base2(int(np.ceil(np.log2(max(count, 1)))))[:count]
    return drawn.random(count)


def spread(ranges: Ranges, unit: np.ndarray) -> np.ndarray:
    """Points (n, parameters) of the unit cube as values within the ranges.

    A share of an edge is that of the range, of its logarithms, or of the probability in it.
    """
    columns = []
    for share, given in zip(unit.T, ranges.values(), strict=True):
        low, high = given["range"]
        if "distribution" in given:
            column = distributions.spread(given, share)
        elif given.get("scale") == "logarithmic":
            column = np.exp(np.log(low) + share * (np.log(high) - np.log(low)))
        else:
            column = low + share * (high - low)
        columns.append(np.clip(column, low, high))
    return np.stack(columns, axis=1)


def _grid(ranges, counts):
    axes = [
        spread({name: given}, np.linspace(0, 1, counts[name])[:, None])[:, 0]
        if name in counts
        else [given["nominal"]]
        for name, given in ranges.items()
    ]
    return np.array(list(itertools.product(*axes)), float)


def _table(ranges, path):
    import pandas as pd

    try:
        table = pd.read_csv(path)
    except (OSError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise ValueError(f"{path}: it cannot be read as a table ({reason})") from None
    if missing := [name for name in ranges if name not in table]:
        held = ", ".join(map(str, table))
        raise ValueError(f"{path}: it has no column {missing[0]}; its columns are {held}")
    try:
        found = table[list(ranges)].to_numpy(float)
    except ValueError:
        raise ValueError(f"{path}: its columns must hold numbers only") from None
    if not len(found):
        raise ValueError(f"{path}: it has no rows, each of which is a query")
    low, high = np.array([given["range"] for given in ranges.values()]).T
    wrong = np.flatnonzero(~((low <= found) & (found <= high)).all(axis=1))  # no number is, too
    if wrong.size:
        told = outside(ranges, dict(zip(ranges, map(float, found[wrong[0]]), strict=True)))
        raise ValueError(f"{path}: row {wrong[0] + 1}: {told}")
    return found


def corners(ranges: Ranges) -> np.ndarray:
    """All corners of the ranges, or if there are more than 1024, of a Sobol set among them."""
    count = len(ranges)
    if count <= 10:
        unit = np.array(list(itertools.product((0.0, 1.0), repeat=count)))
    else:
        unit = np.round(_unit(count, {"count": 1024}))
    return spread(ranges, unit)


def outside(ranges: Ranges, values: Mapping[str, float]) -> str | None:
    """What of some values lies outside its range, in words; None if nothing does."""
    for name, given in ranges.items():
        low, high = given["range"]
        if not low <= values[name] <= high:
            return f"{name} = {values[name]:g} is outside its range {low:g} to {high:g}"
    return None
