"""Design by optimisation in a survey: its keys, and what these mean together."""

from collections.abc import Mapping
from typing import Any

from pydantic import Field

from sphpod.config.fields import ParameterName, Section, left_out
from sphpod.config.reading import refusal
from sphpod.scene import checks

GOALS = "minimise", "maximise", "reach"


class Level(Section):
    """What a quantity must be at most, at least, or both."""

    at_most: float = left_out(description="largest value allowed, in its unit")
    at_least: float = left_out(description="least value allowed, in its unit")


class Design(Section):
    """The best values of a survey's parameters."""

    minimise: str = left_out(description="quantity or parameter that is to be as small as can be")
    maximise: str = left_out(description="quantity or parameter that is to be as large as can be")
    reach: dict[str, float] = left_out(
        min_length=1, max_length=1, description="a quantity, and the value that it is to have"
    )
    where: dict[str, Level] = left_out(
        description="quantities or parameters, each with a level that it must keep to"
    )
    given: dict[ParameterName, float] = left_out(
        description="parameters that are not chosen, each with its value"
    )
    rounds: int = Field(
        3,
        ge=0,
        le=100,
        description="how often, at most, the model is trained once more where a full run finds a "
        "level broken, default 3",
    )


def resolved_design(
    key: str, design: Mapping[str, Any], survey: Mapping[str, Any], parameters: Mapping[str, Any]
) -> dict[str, Any]:
    """Check a design, and fill in its defaults.

    Parameters
    ----------
    key : str
        Where in the configuration it is.
    design, survey, parameters : dict
        Of the survey its quantities are used.

    Raises
    ------
    ConfigError
    """
    goals = [goal for goal in GOALS if goal in design]
    if len(goals) != 1:
        raise refusal(None, key, design, f"it needs one of {', '.join(GOALS)}, and only one")
    goal = design[goals[0]]
    numbers = [
        name for name, asked in survey["quantities"].items() if asked["kind"] != "history"
    ] + list(parameters)
    of_goal = list(goal) if isinstance(goal, dict) else [goal]
    for place, names in ((goals[0], of_goal), ("where", design.get("where", {}))):
        for name in names:
            _check_number(f"{key}.{place}", name, survey["quantities"], numbers)
    for name, level in design.get("where", {}).items():
        if not level:
            raise refusal(None, f"{key}.where.{name}", level, "it needs at_most, at_least or both")
        if level.get("at_least", -float("inf")) > level.get("at_most", float("inf")):
            allowed = "at_least must not be above at_most"
            raise refusal(None, f"{key}.where.{name}", level, allowed)
    _check_given(f"{key}.given", design.get("given", {}), of_goal[0], parameters)
    return Design.default_keys() | {"where": {}, "given": {}} | dict(design)


def _check_number(key, name, quantities, numbers):
    if name in numbers:
        return
    allowed = f"it is neither a quantity nor a parameter; allowed are {', '.join(numbers)}"
    if name in quantities:
        allowed = f"it is a history, and no single number; allowed are {', '.join(numbers)}"
    raise refusal(None, key, name, allowed)


def _check_given(key, given, goal, parameters):
    for name, value in given.items():
        if name not in parameters:
            allowed = f"no such parameter; allowed are {', '.join(parameters)}"
            raise refusal(None, key, name, allowed)
        low, high = parameters[name]["range"]
        if not low <= value <= high:
            allowed = f"it must lie in the range {checks.number(low)} to {checks.number(high)}"
            raise refusal(None, f"{key}.{name}", value, allowed)
        if name == goal:
            allowed = "it is what the design looks for, and cannot be given"
            raise refusal(None, f"{key}.{name}", value, allowed)
    if len(given) == len(parameters):
        raise refusal(None, key, given, "a parameter must be left to choose")
