"""How much of a quantity's variance each parameter makes: first and total Sobol indices."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np

from sphpod.numerics.error import Arrays
from sphpod.pipeline.dataset import Variable
from sphpod.surveys import samples, unbounded
from sphpod.surveys.answers import of_settings
from sphpod.surveys.questions import VARIES

SEED = 7
"""Of the draw of samples and of the bootstrap."""

CONFIDENCE = 0.95

_DIMS = ("quantity_index", "parameter_index")
VARIABLES = {
    "quantity": Variable(("quantity_index",), "", "quantity of the survey", str),
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
    name: str, settings: Mapping[str, Any], survey: Mapping[str, Any], model: Arrays
) -> dict[str, np.ndarray]:
    """Sobol indices of the quantities of a survey.

    They are those of all quantities that are numbers, with bootstrapped intervals. Parameters have
    their distributions, or else are evenly distributed over their ranges, or their logarithms over
    those.

    Returns
    -------
    dict
        quantity, parameter, and first_index, total_index with _low and _high, (quantities,
        parameters); NaN where a query has no value of a quantity or that varies by rounding alone.
    """
    from scipy.stats import sobol_indices, uniform

    reduced, asked = of_settings(name, settings, survey, model)
    ranges = settings["parameters"]
    scalars = [word for word, question in asked.items() if not question.is_curve]
    kept = {word: asked[word] for word in scalars}
    responses = []

    def respond(unit):
        points = samples.spread(ranges, unit.reshape(len(ranges), -1).T)
        found = unbounded.answer_all(reduced, kept, points)
        responses.append(np.array([found[word] for word in scalars]))
        return responses[-1].copy()  # SciPy takes the mean from it, in place

    found = sobol_indices(
        func=respond, n=survey["sobol_samples"], dists=[uniform()] * len(ranges), rng=SEED
    )
    # SciPy resamples by numpy's own random state, and takes no other here.
    with _seeded(SEED):
        spread = found.bootstrap(confidence_level=CONFIDENCE)
    shape = len(scalars), len(ranges)
    # SciPy gives zeros of what does not vary, as if no parameter mattered, and shares out rounding.
    every = np.concatenate(responses, axis=1)
    unknown = ~(np.ptp(every, axis=1) > VARIES * np.abs(every).max(axis=1))
    arrays: dict[str, np.ndarray] = {
        "quantity": np.array(scalars, object),
        "parameter": np.array(list(ranges), object),
    }
    for kind in ("first", "total"):
        interval = getattr(spread, f"{kind}_order").confidence_interval
        values = getattr(found, f"{kind}_order"), interval.low, interval.high
        for end, value in zip(("", "_low", "_high"), values, strict=True):
            shares = np.array(value, float).reshape(shape)
            shares[unknown] = np.nan
            arrays[f"{kind}_index{end}"] = shares
    return arrays


@contextmanager
def _seeded(seed: int) -> Iterator[None]:
    """Numpy's own random state from a seed on, and afterwards as it was."""
    state = np.random.get_state()  # noqa: NPY002
    np.random.seed(seed)  # noqa: NPY002
    try:
        yield
    finally:
        np.random.set_state(state)  # noqa: NPY002
