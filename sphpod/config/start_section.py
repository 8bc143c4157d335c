"""What a scene starts from, where it is not an initial velocity."""

from collections.abc import Mapping
from typing import Any

from pydantic import Field

from sphpod.config.fields import Section
from sphpod.config.reading import refusal

EITHER = "initial_velocity", "start"
"""Keys of which a scene has one."""


class Start(Section):
    """A state that a file of a run holds."""

    from_: str = Field(
        alias="from",
        description="NetCDF file of velocity, and of density or strain, at t and x, of the scene's "
        "particles",
    )
    t: float = Field(ge=0, description="time [s] in the file, which is t = 0 of the scene")


def check_start(name: str, settings: Mapping[str, Any]) -> None:
    """Refuse a scene that does not say what it starts from, or says it twice.

    Raises
    ------
    ConfigError
    """
    velocity, start = EITHER
    if velocity in settings and start in settings:
        allowed = f"it stands in the place of {velocity}; one of both is allowed"
        raise refusal(name, start, settings[start], allowed)
    if velocity not in settings and start not in settings:
        allowed = "it must be given (v0(x) [m/s], a number or an expression in x, L and T)"
        raise refusal(name, velocity, "(missing)", allowed)
