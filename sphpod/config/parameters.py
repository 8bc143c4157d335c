"""Parameters of a scene: their ranges and distributions, checked before any job."""

import ast
import contextlib
import difflib
import time
import warnings
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from sphpod.config.reading import ConfigError, refusal
from sphpod.config.scene_section import Parameter
from sphpod.numerics.expressions import reads
from sphpod.scene import checks
from sphpod.scene.scene import PROFILES, parameter_values
from sphpod.surveys import distributions, samples

CHECKED = 64
"""Points within the ranges at which the scene is checked, beside their corners."""

TERMS = 2**16
"""Terms of sums of all these scenes together, or only some of the corners are checked."""

POINTS, FEWEST = 1088, 8
"""Points at which all scenes together are checked, and each at least."""

SHARES = 4
"""Work on all these scenes, in that on one."""

LEAST_PROBABILITY = 1e-6
"""What the range of a parameter holds of its distribution at least."""

LONGEST = 0.5
"""Seconds that a few values of a distribution may take."""


def resolved_parameters(name: str, settings: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Parameters of a scene with their defaults, each with a range.

    Raises
    ------
    ConfigError
        A value, a range or a distribution is not valid, or the range of a sum holds a parameter.
    """
    parameters = {
        word: Parameter.default_keys() | _ranged(name, f"parameters.{word}", given)
        for word, given in settings["parameters"].items()
    }
    for word, given in parameters.items():
        key, (low, high) = f"parameters.{word}", given["range"]
        if given["scale"] == "logarithmic" and low <= 0:
            allowed = "it must be positive where the scale is logarithmic"
            raise refusal(name, f"{key}.range", given["range"], allowed)
        for place, value in (("nominal", given["nominal"]), ("range", low), ("range", high)):
            least, most = checks.MOVING
            if value and not least <= abs(value) <= most:
                allowed = f"a size must be 0, or from {least:g} to {most:g}"
                raise refusal(name, f"{key}.{place}", given[place], allowed)
        if not low <= given["nominal"] <= high:
            allowed = f"it must lie in the range {checks.number(low)} to {checks.number(high)}"
            raise refusal(name, f"{key}.nominal", given["nominal"], allowed)
        for of, text, formula in _formulas(settings):
            if word in _counted_to(formula):
                allowed = (
                    f"the range of a sum holds the parameter {word}, which is any number from "
                    f"{checks.number(low)} to {checks.number(high)}; it must be of whole numbers"
                )
                raise refusal(name, of, text, allowed)
    return parameters


def _ranged(scene, key, given):
    """A parameter with a range, which that of a distribution of bounded support is if left out."""
    low, high = given.get("range", (0, 1))
    if not low < high:
        raise refusal(scene, f"{key}.range", given["range"], "it must rise")
    if "distribution" not in given:
        if "range" not in given:
            allowed = "it must be given (least and largest value of a survey, in SI units)"
            raise refusal(scene, f"{key}.range", "(missing)", allowed)
        return given
    if "scale" in given:
        allowed = "a distribution says itself how values are spread"
        raise refusal(scene, f"{key}.scale", given["scale"], allowed)
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        try:
            return _distributed(scene, key, given)
        except ConfigError:
            raise
        except Exception as error:  # whatever scipy makes of strange parameters
            reason = " ".join(str(error).split()).rstrip(".")
            allowed = f"its values cannot be found ({reason})"
            raise refusal(scene, f"{key}.distribution", given["distribution"], allowed) from None


def _distributed(scene, key, given):
    ((word, values),) = given["distribution"].items()
    if word not in (known := distributions.names()):
        near = difflib.get_close_matches(word, known, n=1)
        meant = f", did you mean {near[0]}?" if near else ""
        allowed = f"no continuous distribution of scipy.stats that surveys know{meant}"
        raise refusal(scene, f"{key}.distribution", word, allowed)
    key_of, (needed, optional) = f"{key}.distribution.{word}", distributions.keys(word)
    for one in values:
        if one not in (*needed, *optional):
            allowed = f"unknown key; allowed are {', '.join([*needed, *optional])}"
            raise refusal(scene, f"{key_of}.{one}", values[one], allowed)
    for one in needed:
        if one not in values:
            allowed = f"it must be given, as a parameter of the distribution {word}"
            raise refusal(scene, f"{key_of}.{one}", "(missing)", allowed)
    least, largest = map(float, distributions.frozen(given["distribution"]).support())
    if not least < largest:
        raise refusal(scene, key_of, values, "the distribution does not have such parameters")
    support = f"the support of the distribution, {checks.number(least)} to {checks.number(largest)}"
    if "range" not in given:
        if not np.isfinite([least, largest]).all():
            allowed = f"it must be given, as {support}, has no ends"
            raise refusal(scene, f"{key}.range", "(missing)", allowed)
        given = given | {"range": [least, largest]}
    low, high = given["range"]
    slack = 1e-9 * (high - low)
    if not (least - slack <= low and high <= largest + slack):
        raise refusal(scene, f"{key}.range", given["range"], f"it must lie in {support}")
    if not (share := distributions.held(given)) >= LEAST_PROBABILITY:
        allowed = (
            f"the distribution has a probability of {share:.3g} in it; at least "
            f"{LEAST_PROBABILITY:g} is needed"
        )
        raise refusal(scene, f"{key}.range", given["range"], allowed)
    started = time.process_time()
    for share in np.linspace(0, 1, 9):
        if not np.isfinite(distributions.spread(given, np.array([share]))).all():
            raise refusal(scene, key_of, values, "the distribution has no finite quantiles")
        if time.process_time() - started > LONGEST:
            allowed = "its values take longer to find than queries to answer"
            raise refusal(scene, key_of, values, allowed)
    return given


def check_within(name: str, settings: Mapping[str, Any], alike: int = 1) -> None:
    """Refuse a parameter that nothing holds, and ranges in which the scene is not valid.

    Of many scenes that are checked ``alike``, at fewer points within their ranges.

    Raises
    ------
    ConfigError
    """
    parameters: samples.Ranges = settings["parameters"]
    used = {word for *_, formula in _formulas(settings) for word in reads(formula)}
    for word, given in parameters.items():
        if word not in used:
            allowed = f"no expression of the scene holds it; it may stand in {', '.join(PROFILES)}"
            raise refusal(name, f"parameters.{word}", given, allowed)
    inner = samples.points(parameters, {"count": CHECKED, "sampling": "halton"})
    every = np.concatenate([samples.corners(parameters), inner])
    nominal = samples.scene_at(name, settings, parameter_values(settings))
    most = min(max(CHECKED, TERMS // checks.terms(nominal)), POINTS) // alike
    every = every[:: -(-len(every) // max(most, FEWEST))]
    for values in every:
        point = dict(zip(parameters, map(float, values), strict=True))
        try:
            scene = samples.scene_at(name, settings, point)
            share = min(1.0, SHARES / (alike * len(every)))
            checks.check_setting(scene, share, followed=False)
        except ValueError as error:
            told = str(error).removeprefix(f"scene {name}: ")
            where = ", ".join(f"{word} = {value:g}" for word, value in point.items())
            ranges = {word: given["range"] for word, given in parameters.items()}
            raise refusal(name, "parameters", ranges, f"at {where}, {told}") from None


def _formulas(settings: Mapping[str, Any]) -> Iterator[tuple[str, str, ast.AST]]:
    """Key, text and tree of each expression of a scene; one that has no tree is refused later."""
    for key in filter(settings.__contains__, PROFILES):
        given = settings[key]
        terms = dict(enumerate(given)) if isinstance(given, list) else {"": given}
        for number, term in terms.items():
            of = f"{key}.{number}".rstrip(".")
            parts = term if isinstance(term, Mapping) else {"": term}
            for part, text in parts.items():
                with contextlib.suppress(SyntaxError, ValueError, MemoryError, RecursionError):
                    tree = ast.parse(str(text).strip(), mode="eval").body
                    yield f"{of}.{part}".rstrip("."), str(text), tree


def _counted_to(formula: ast.AST) -> set[str]:
    """Names in the ranges of sums, but within functions: what nth chooses may be whole."""
    ranges = [
        node.iter
        for node in ast.walk(formula)
        if isinstance(node, ast.comprehension) and isinstance(node.iter, ast.Call)
    ]
    parts: list[ast.AST] = [part for each in ranges for part in each.args]
    for part in parts:
        if not isinstance(part, ast.Call):
            parts += ast.iter_child_nodes(part)
    return {part.id for part in parts if isinstance(part, ast.Name)}
