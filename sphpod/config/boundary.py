"""What ends of a bar allow."""

from collections.abc import Mapping
from typing import Any

from sphpod.config.reading import ConfigError
from sphpod.reduced import rom
from sphpod.scene.scene import Scene


def check_ends(name: str, settings: Mapping[str, Any]) -> None:
    """Refuse to reduce a bar with free ends by the paper's models.

    Parameters
    ----------
    settings : dict
        Block of the scene in the configuration.

    Raises
    ------
    ConfigError
    """
    try:
        rom.check_ends(Scene.from_settings(name, dict(settings)))
    except ValueError as error:
        raise ConfigError(str(error)) from None
