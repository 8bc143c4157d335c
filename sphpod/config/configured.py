"""Scenes from keywords or from a configuration file, checked as the workflow checks them."""

import difflib
from pathlib import Path
from typing import Any

from sphpod.config import config
from sphpod.scene.scene import PHYSICS_KEYS, Scene

WITHOUT_LIMIT = 1e300
"""Memory [GB] that nothing exceeds: what a program of one's own keeps is for it to say."""


def make_scene(name: str = "scene", **settings: Any) -> Scene:
    """A scene (section 2.1) from the keys that a configuration has for it.

    Parameters
    ----------
    name : str
        How messages name it: lower-case letters, digits and underscores.
    **settings
        domain_length [m], duration [s], initial_velocity [m/s] or start, initial_density [kg/m³],
        youngs_modulus [Pa], particle_count, smoothing_ratio and time_step [s]; and, where the scene
        has them, boundary, damping [1/s], force [m/s²], interface, positions and error_interval
        [s]. Profiles are numbers or expressions as text, in x, and those of youngs_modulus, damping
        and force in x and t; docs/adding-a-scene.md has all.

    Raises
    ------
    ConfigError
        One sentence that names scene, key, value and what is allowed.
    """
    for key, value in settings.items():
        if key not in PHYSICS_KEYS:
            near = difflib.get_close_matches(key, PHYSICS_KEYS, n=1, cutoff=0.8)
            raise config.ConfigError(
                f"scene {name}: {key} = {value}: unknown key"
                f"{f', did you mean {near[0]}?' if near else ';'} "
                f"allowed are {', '.join(PHYSICS_KEYS)}"
            )
    resolved = config.load([], overrides={"memory": WITHOUT_LIMIT, "scenes": {name: settings}})
    return Scene.from_settings(name, resolved["scenes"][name])


def load_scene(path: str | Path, name: str | None = None) -> Scene:
    """A scene of a configuration file, such as ``config/config.yaml``.

    Parameters
    ----------
    path : str or Path
    name : str, optional
        Which scene; not needed where the file has one.

    Raises
    ------
    ConfigError
        The file cannot be read, says something that is not allowed, or has no such scene.
    """
    return Scene.from_settings(*_block(path, name))


def load_samplings(path: str | Path, name: str | None = None) -> dict[str, dict[str, Any]]:
    """The samplings of a scene of a configuration file.

    Parameters
    ----------
    path, name
        As in `load_scene`.

    Returns
    -------
    dict
        Keywords of `take_snapshots`, by name of the sampling.

    Raises
    ------
    ConfigError
        As `load_scene`.
    """
    return {
        sampling: {key: value for key, value in keys.items() if key != "mode_counts"}
        for sampling, keys in _block(path, name)[1]["samplings"].items()
    }


def _block(path, name):
    """Name and resolved settings of a scene of a file."""
    scenes = config.load([path])["scenes"]
    if name is None and len(scenes) == 1:
        (name,) = scenes
    if name not in scenes:
        what = "name = None: one of several must be named" if name is None else "no such scene"
        raise config.ConfigError(
            f"{path}: {f'scene {name}: ' if name else ''}{what}; allowed are {', '.join(scenes)}"
        )
    return name, scenes[name]
