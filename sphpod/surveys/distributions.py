"""Distributions of parameters: continuous ones of scipy.stats, cut at the ends of the range.

With the distribution function F and a range from a to b, the value at a share u of the probability
that the range holds is F⁻¹(F(a) + u (F(b) - F(a))).
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

UNFIT = ("studentized_range", "irwinhall", "ksone", "kstwo")
"""Distributions whose values take seconds, or any memory, to find."""


def names() -> list[str]:
    """Distributions that there are."""
    from scipy import stats

    known = [name for name in dir(stats) if isinstance(getattr(stats, name), stats.rv_continuous)]
    return [name for name in known if name not in UNFIT]


def keys(name: str) -> tuple[list[str], list[str]]:
    """Parameters that a distribution needs, and those that it may have."""
    from scipy import stats

    needed = getattr(stats, name).shapes
    return [word.strip() for word in needed.split(",")] if needed else [], ["loc", "scale"]


def frozen(given: Mapping[str, Any]) -> Any:
    """The distribution of a block ``{name: {parameter: value}}``, as scipy.stats has it."""
    from scipy import stats

    ((name, values),) = given.items()
    return getattr(stats, name)(**values)


def held(given: Mapping[str, Any]) -> float:
    """Probability of the range of a parameter that has a distribution."""
    first, last, _ = _ends(given)
    return float(abs(last - first))


def spread(given: Mapping[str, Any], shares: np.ndarray) -> np.ndarray:
    """Values of a parameter that has a distribution at shares of the probability of its range."""
    low, high = given["range"]
    first, last, inverse = _ends(given)
    inner = inverse(first + shares * (last - first))
    return np.where(shares <= 0, low, np.where(shares >= 1, high, inner))


def _ends(given):
    """Probabilities at the ends of the range, and what their values are found by."""
    distribution = frozen(given["distribution"])
    low, high = map(float, given["range"])
    # In the upper tail the probability of what is smaller is 1 but for rounding.
    if distribution.cdf(low) > 0.5:
        return distribution.sf(low), distribution.sf(high), distribution.isf
    return distribution.cdf(low), distribution.cdf(high), distribution.ppf
