"""How much of a quantity's variance each parameter makes: first and total Sobol indices."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from sphpod.pipeline.dataset import Variable
from sphpod.surveys import samples
from sphpod.surveys.answers import answer_all, of_settings

SEED = 7
"""Of the draw of samples and of the bootstrap."""

CONFIDENCE = 0.95

_DIMS = ("quantity_index", "parameter_index")
VARIABLES = {
    "quantity": Variable(("quantity_index",), "", "quantity whose variance is shared out", str),
    "parameter": Variable(("parameter_index",), "", "parameter", str),
} | {
    f"{kind}_index{end}": Variable(_DIMS, "1", f"{words}{kind} Sobol index")
    for kind in ("first", "total")
    for end, words in (
        ("", ""),
        ("_low", "least of the 95 % interval of the "),
        ("_high", "largest of the 95 % interval of the "),
    )
}


def share_out(
    name: str,
    settings: Mapping[str, Any],
    survey: Mapping[str, Any],
    model: Mapping[str, np.ndarray],
) -> dict[str, np.ndarray]:
    """Sobol indices of all quantities that are numbers, with bootstrapped intervals.

    Parameters have their distributions, or else are evenly distributed over their ranges, or their
    logarithms over those.

    Returns
    -------
    dict
        quantity, parameter, and first_index, total_index with _low and _high, (quantities,
        parameters); NaN where a query has no value of a quantity or that does not vary.
    """
    from scipy.stats import bootstrap, sobol_indices, uniform

    reduced, asked = of_settings(name, settings, survey, model)
    ranges = settings["parameters"]
    scalars = [word for word, question in asked.items() if not question.is_curve]
    kept = {word: asked[word] for word in scalars}
    responses = []

    def respond(unit):
        points = samples.spread(ranges, unit.reshape(len(ranges), -1).T)
        found = answer_all(reduced, kept, points, survey["tolerance"])
        responses.append(np.array([found[word] for word in scalars]))
        return responses[-1]

    sampled = []

    def estimated(f_A, f_B, f_AB):
        sampled.extend([f_A, f_B, f_AB])
        return _estimated(f_A, f_B, f_AB)

    count = survey["sobol_samples"]
    found = sobol_indices(
        func=respond, n=count, dists=[uniform()] * len(ranges), method=estimated, rng=SEED
    )

    # SciPy's own bootstrap of indices is drawn anew each time.
    def redrawn(chosen):
        return np.stack(_estimated(*(f[..., chosen] for f in sampled)))

    spread = bootstrap(
        [np.arange(count)], redrawn, method="BCa", confidence_level=CONFIDENCE, rng=SEED
    ).confidence_interval
    shape = len(scalars), len(ranges)
    # SciPy gives zeros of what has no variance, as if no parameter mattered.
    every = np.concatenate(responses, axis=1)
    unknown = ~(np.ptp(every, axis=1) > 0)
    arrays: dict[str, np.ndarray] = {
        "quantity": np.array(scalars, object),
        "parameter": np.array(list(ranges), object),
    }
    for n, kind in enumerate(("first", "total")):
        values = getattr(found, f"{kind}_order"), spread.low[n], spread.high[n]
        for end, value in zip(("", "_low", "_high"), values, strict=True):
            shares = np.array(value, float).reshape(shape)
            shares[unknown] = np.nan
            arrays[f"{kind}_index{end}"] = shares
    return arrays


def _estimated(f_A, f_B, f_AB):
    """First and total indices by the estimators of Saltelli and others (2010), table 2 (b) and (f).

    Parameters
    ----------
    f_A, f_B, f_AB : arrays, shapes (quantities, samples) and (parameters, quantities, samples)
        Responses to samples A and B, and to A with one parameter of B.

    Returns
    -------
    first, total : arrays, shape (quantities, parameters)
    """
    variance = np.var([f_A, f_B], axis=(0, -1))
    with np.errstate(divide="ignore", invalid="ignore"):
        first = np.mean(f_B * (f_AB - f_A), axis=-1) / variance
        total = np.mean((f_A - f_AB) ** 2, axis=-1) / 2 / variance
    return first.T, total.T
