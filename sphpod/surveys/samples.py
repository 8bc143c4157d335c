"""Values of parameters: drawn from their ranges, on a grid, or from a table of one's own."""

import itertools
import math
import warnings
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sphpod.scene.scene import Scene, physical_settings
from sphpod.surveys import distributions

Ranges = Mapping[str, Mapping[str, Any]]
"""Of each parameter its nominal value, range, and scale or distribution, as the configuration has
them."""


LARGEST_TABLE = 2 * 10**8
"""Bytes of a table of queries that is read."""


def scene_at(name: str, settings: Mapping[str, Any], values: Mapping[str, float]) -> Scene:
    """The scene of some settings with other values of its parameters."""
    return Scene.from_settings(name, {**settings, "parameters": dict(values)})


def survey_settings(settings: Mapping[str, Any], survey: Mapping[str, Any]) -> dict[str, Any]:
    """What of a scene's settings a survey depends on: those of its motion, with all ranges."""
    ranges = {"parameters": settings["parameters"], "error_interval": survey["output_interval"]}
    return physical_settings(settings) | ranges


def points(
    ranges: Ranges, queries: Mapping[str, Any], first: int = 0, stop: int | None = None
) -> np.ndarray:
    """Values of all parameters, as a block ``queries`` or ``training`` asks for them.

    Parameters
    ----------
    ranges : dict
    queries : dict
        count, sampling and seed; or grid, the number of values of each parameter (one that is not
        there has its nominal value); or from, a CSV with a column for each parameter.
    first, stop : int
        Which of them, all by default; the others are not made where they need not be.

    Returns
    -------
    array, shape (queries, parameters)

    Raises
    ------
    ValueError
        A CSV cannot be read, lacks a parameter, or has values outside a range.
    """
    if "from" in queries:
        return _table(ranges, queries["from"])[first:stop]
    every = count(ranges, queries)
    last = every if stop is None else min(stop, every)
    if "grid" in queries:
        return _grid(ranges, queries["grid"], first, last)
    return spread(ranges, _unit(len(ranges), queries, first, last))


def count(ranges: Ranges, queries: Mapping[str, Any]) -> int:
    """How many queries a block asks for."""
    if "from" in queries:
        return len(_table(ranges, queries["from"]))
    return math.prod(queries["grid"].values()) if "grid" in queries else queries["count"]


def _unit(dimensions, queries, first, last):
    """Points in the unit cube, (last - first, dimensions)."""
    from scipy.stats import qmc

    seed, kind = queries.get("seed", 0), queries.get("sampling", "sobol")
    if kind == "uniform":
        random = np.random.PCG64(seed)
        random.advance(first * dimensions)
        return np.random.Generator(random).uniform(size=(last - first, dimensions))
    if kind == "latin_hypercube":
        return qmc.LatinHypercube(dimensions, rng=seed).random(queries["count"])[first:last]
    drawn = (qmc.Sobol if kind == "sobol" else qmc.Halton)(dimensions, rng=seed)
    if first:
        drawn.fast_forward(first)
    with warnings.catch_warnings():
        # A count that is no power of two is less balanced, and what was asked for.
        warnings.simplefilter("ignore", UserWarning)
        return drawn.random(last - first)


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


def _grid(ranges, counts, first, last):
    sizes = [counts.get(name, 1) for name in ranges]
    places = np.unravel_index(np.arange(first, last), sizes)
    columns = [
        spread({name: given}, place[:, None] / max(size - 1, 1))[:, 0]
        if name in counts
        else np.full(last - first, float(given["nominal"]))
        for (name, given), size, place in zip(ranges.items(), sizes, places, strict=True)
    ]
    return np.stack(columns, axis=1)


def _table(ranges, path):
    import pandas as pd

    try:
        if not Path(path).is_file():
            raise ValueError("there is no such file")
        if (size := Path(path).stat().st_size) > LARGEST_TABLE:
            raise ValueError(f"it holds {size} bytes, more than {LARGEST_TABLE}")
        table = pd.read_csv(path, skipinitialspace=True)
    except (OSError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise ValueError(f"{path}: it cannot be read as a table ({reason})") from None
    if not isinstance(table.index, pd.RangeIndex):
        raise ValueError(f"{path}: its rows have more entries than there are names of columns")
    twice = [name for name, held in Counter(_names(path)).items() if held > 1]
    if twice:
        raise ValueError(f"{path}: two of its columns are named {twice[0]}")
    if missing := [name for name in ranges if name not in table]:
        held = ", ".join(map(str, table))
        raise ValueError(f"{path}: it has no column {missing[0]}; its columns are {held}")
    try:
        found = table[list(ranges)].to_numpy(float)
    except (ValueError, OverflowError):
        raise ValueError(f"{path}: its columns must hold numbers only") from None
    if not len(found):
        raise ValueError(f"{path}: it has no rows, each of which is a query")
    low, high = np.array([given["range"] for given in ranges.values()]).T
    wrong = np.flatnonzero(~((low <= found) & (found <= high)).all(axis=1))  # no number is, too
    if wrong.size:
        told = outside(ranges, dict(zip(ranges, map(float, found[wrong[0]]), strict=True)))
        raise ValueError(f"{path}: row {wrong[0] + 1}: {told}")
    return found


def _names(path):
    """Names of the columns of a table, as they stand."""
    import pandas as pd

    return pd.read_csv(path, header=None, nrows=1, dtype=str).iloc[0].str.strip()


def corners(ranges: Ranges) -> np.ndarray:
    """All corners of the ranges, or if there are more than 1024, of a Sobol set among them."""
    if len(ranges) <= 10:
        unit = np.array(list(itertools.product((0.0, 1.0), repeat=len(ranges))))
    else:
        unit = np.round(_unit(len(ranges), {}, 0, 1024))
    return spread(ranges, unit)


def outside(ranges: Ranges, values: Mapping[str, float]) -> str | None:
    """What of some values lies outside its range, in words; None if nothing does."""
    for name, given in ranges.items():
        low, high = given["range"]
        if not low <= values[name] <= high:
            return f"{name} = {values[name]:g} is outside its range {low:g} to {high:g}"
    return None
