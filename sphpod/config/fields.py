"""What the models of a configuration's sections are made of."""

import copy
import keyword
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Discriminator, Field
from pydantic_core import PydanticCustomError, core_schema

from sphpod.numerics.expressions import FUNCTIONS

LARGEST_SEED = 10**15 - 1


def _described(schema, section):
    """What a section is: the first line of its docstring, in the middle of a sentence."""
    line = section.__doc__.partition("\n")[0].rstrip(".")
    schema["description"] = line[0].lower() + line[1:]


SETTINGS = ConfigDict(strict=True, allow_inf_nan=False, regex_engine="python-re")
"""Nothing is taken for what it is not; patterns are those of Python."""


class Section(BaseModel):
    """A block of keys, of which unknown ones are errors."""

    model_config = SETTINGS | ConfigDict(
        extra="forbid", json_schema_extra=_described, protected_namespaces=()
    )

    @classmethod
    def default_keys(cls) -> dict[str, Any]:
        """Keys that have a default, with it."""
        fields = cls.model_fields.items()
        return {name: copy.deepcopy(field.default) for name, field in fields if _has_default(field)}


def _has_default(field):
    return not field.is_required() and field.default is not None


def left_out(**about: Any) -> Any:
    """A key that may be left out, and then is not there or depends on others."""
    return Field(None, json_schema_extra=_without_default, **about)


def _without_default(schema):
    del schema["default"]


@dataclass(frozen=True)
class Unique:
    """Marks a list in which no entry may stand twice."""

    def __get_pydantic_core_schema__(self, source, handler):
        return core_schema.no_info_after_validator_function(_check_unique, handler(source))

    def __get_pydantic_json_schema__(self, schema, handler):
        return handler(schema) | {"uniqueItems": True}


def _check_unique(values):
    if any(value in values[:n] for n, value in enumerate(values)):
        raise PydanticCustomError("unique_items", "no entry may stand twice")
    return values


def shape(value: Any) -> str | None:
    """Tag of the branch that a value belongs to, where a key takes keys and values, or less.

    Tags are in brackets, so that none is a key.
    """
    if isinstance(value, dict):
        return "<mapping>"
    if isinstance(value, list):
        return "<list>"
    scalar = isinstance(value, str | int | float) and not isinstance(value, bool)
    return "<scalar>" if scalar else None


BY_SHAPE = Discriminator(shape)

# Snakemake takes what stands twenty times in a row for a rule that feeds on itself; a name may be a
# part of the name of a file, which may have 255 letters.
_CALM = r"(?!.*?(.+?)\1{18})"
_TAKEN = [*keyword.kwlist, *["x", "t", "L", "T", "N", "pi", "alpha", "dt"], *FUNCTIONS]
_LENGTHS = "up to 60 of them, nothing 19 times in a row"
NAMES = {
    rf"^{_CALM}[a-z][a-z0-9_]{{0,59}}$(?!\n)": (
        f"lower-case letters, digits and underscores, a letter first, {_LENGTHS}"
    ),
    rf"^{_CALM}(?!(logs|figures|surveys)$)[a-z][a-z0-9_]{{0,59}}$(?!\n)": (
        f"lower-case letters, digits and underscores, a letter first, {_LENGTHS}, "
        "but not logs, figures or surveys, which are folders of their own"
    ),
    rf"^{_CALM}[A-Za-z0-9][A-Za-z0-9_.-]{{0,199}}$(?!\n)": (
        "letters, digits, dots, hyphens and underscores (the name of a file), up to 200 of them, "
        "nothing 19 times in a row"
    ),
    rf"^(?!({'|'.join(_TAKEN)})$)[A-Za-z][A-Za-z0-9_]{{0,59}}$(?!\n)": (
        "letters, digits and underscores, a letter first, up to 60 of them, but no word of Python "
        "and none of x, t, L, T, N, pi, alpha, dt and the functions that expressions know"
    ),
}
"""What names may be, by the pattern that they match."""

_PLAIN, _OF_SCENE, _OF_FILE, _OF_PARAMETER = NAMES
Name = Annotated[str, Field(pattern=_PLAIN, description=NAMES[_PLAIN])]
SceneName = Annotated[str, Field(pattern=_OF_SCENE, description=NAMES[_OF_SCENE])]
ParameterName = Annotated[str, Field(pattern=_OF_PARAMETER, description=NAMES[_OF_PARAMETER])]
FigureName = Annotated[str, Field(pattern=_OF_FILE, description=NAMES[_OF_FILE])]

SamplingName = Annotated[str, Field(description="name of a sampling")]
ModeCount = Annotated[int, Field(ge=1, description="mode count")]
Count = Annotated[int, Field(ge=1)]
Expression = float | str
"""A number, or an expression as text."""
