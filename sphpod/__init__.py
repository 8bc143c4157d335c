"""Proper orthogonal decomposition of smoothed particle hydrodynamics of a mass-spring chain.

The public names are those of `__all__`; `docs/quickstart.md` goes through them. They are imported
when they are first used, so that ``import sphpod`` costs nothing.
"""

__version__ = "0.2.0"

# Modules are named by text: what is imported here counts as code of all that imports the package.
_HOMES = {
    "Scene": "scene.scene",
    "Breakdown": "scene.breakdown",
    "ConfigError": "config.config",
    "load_scene": "config.configured",
    "load_samplings": "config.configured",
    "make_scene": "config.configured",
    "load_survey": "surveys.loaded",
    "solve_sph": "api",
    "solve_lifted": "api",
    "solve_reference": "api",
    "take_snapshots": "api",
    "decompose": "api",
    "decompose_lifted": "api",
    "solve_reduced": "api",
    "sweep": "api",
    "compare": "api",
    "relative_error": "api",
    "plot_profile": "api",
    "plot_modes": "api",
    "plot_errors": "api",
}
"""Module of each public name."""

__all__ = ["__version__", *_HOMES]


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'sphpod' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"sphpod.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
