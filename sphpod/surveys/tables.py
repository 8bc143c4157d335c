"""What a survey found, as rows of tables."""

from typing import Any

import numpy as np

from sphpod.numerics.error import Arrays

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)

Rows = dict[str, Any]


def answers(found: Arrays) -> Rows:
    """One row a query, of all that are numbers: histories are in the NetCDF file alone."""
    return {name: values for name, values in found.items() if name != "t" and values.ndim == 1}


def quantiles(found: Arrays) -> Rows:
    """One row a quantity: quantiles over the queries that have an answer, and how many have."""
    names = scalars(found)
    rows: dict[str, list[Any]] = {"quantity": names, "queries": [], "answered": []}
    rows |= {f"{100 * share:g} %": [] for share in QUANTILES}
    for name in names:
        known = found[name][np.isfinite(found[name])]
        rows["queries"].append(found[name].size)
        rows["answered"].append(known.size)
        for share in QUANTILES:
            value = np.quantile(known, share) if known.size else np.nan
            rows[f"{100 * share:g} %"].append(value)
    return rows


def scalars(found: Arrays) -> list[str]:
    """Quantities that are numbers, which have intervals; and the bound of the error."""
    names = [name for name in found if f"{name}_low" in found and found[name].ndim == 1]
    return [*names, "relative_bound"]


def indices(found: Arrays) -> Rows:
    """One row for each parameter of each quantity."""
    shape = count, parameters = found["first_index"].shape
    rows: Rows = {
        "quantity": np.repeat(found["quantity"], parameters),
        "parameter": np.tile(found["parameter"], count),
    }
    return rows | {name: values.ravel() for name, values in found.items() if values.shape == shape}


def design(found: Arrays) -> Rows:
    """One row a round, of all that are numbers."""
    rounds = found["round"].size
    others = "t", "parameter", "designed"  # of which there may be as many
    return {
        name: values
        for name, values in found.items()
        if values.shape == (rounds,) and name not in others and not name.startswith("evaluation_")
    }


def validation(found: Arrays) -> Rows:
    """One row a query that was solved in full."""
    return dict(found)


def cost(found: Arrays) -> Rows:
    """One row a contender, and one of the training, which answers no query."""
    lower, middle, upper = np.quantile(
        np.vstack([found["query_seconds"], found["training_seconds"]]), (0.25, 0.5, 0.75), axis=1
    )
    return {
        "contender": [*found["contender"], "training"],
        "integrator": [*found["integrator"], ""],
        "modes": [*found["contender_mode_count"], found["contender_mode_count"][-1]],
        "time_step": [*found["contender_time_step"], np.nan],
        "error": [*found["query_error"], np.nan],
        "cpu_seconds": middle,
        "cpu_seconds_interquartile_range": upper - lower,
        "repeats": found["training_seconds"].size,
        "break_even": [*found["break_even"], np.nan],
        "break_even_unbounded": [*found["break_even_unbounded"], np.nan],
    }
