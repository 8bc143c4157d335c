"""What a study declares: its rules, paths, variables, table and figure follow from it.

A module of a study has a `Study` named ``STUDY``. The workflow makes a rule for each of its
datasets, named as the study or as the dataset, one for its tables and one for its figures, and adds
them to a target. Functions are named below the package, such as
"studies.growth.measure", so that a declaration imports nothing; the digest of a result follows the
function that computes it, and no other part of the module.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pkgutil import iter_modules
from typing import Any

import sphpod.studies
from sphpod.pipeline.dataset import Variable
from sphpod.scene.scene import Scene

Place = tuple[Any, ...]
"""A scene, or a scene and a sampling of it, by name, or these and a number of modes."""

Argument = str | Callable[[Scene, Callable[[str], Any]], Any]
"""What a function is given beside its scene and datasets: a setting by its name, or what is made of
the scene and of settings by their names. Names join those of the configuration by dots, such as
"stability.noise_levels"; or are sampling; modes, their number; seed; all_mode_counts, up to the
usual largest; mode_counts and largest_mode_count, of those that are studied; and acceleration, the
paper's study of run time that a scene asks for with a sampling, or a key of it."""

Need = tuple[Callable[[Scene], bool], str]
"""What a scene must be, and that in words."""

UNDAMPED: Need = (
    lambda scene: scene.is_conservative and not scene.start,
    "without damping, force and start",
)
"""A scene of which theory predicts the growth wave by wave."""


def _without_free_ends(scene):
    return scene.ends is None or not scene.ends.is_free


WITHOUT_FREE_ENDS: Need = _without_free_ends, "without free ends"
"""A scene that the paper's models know."""

STEADY: Need = (
    lambda scene: scene.is_steady and _without_free_ends(scene) and not scene.start,
    "without start and free ends, of which neither youngs_modulus nor damping names t",
)

RUN: Need = (
    lambda scene: UNDAMPED[0](scene) and _without_free_ends(scene),
    "without damping, force and start, and without free ends",
)

EVEN: Need = (
    lambda scene: scene.is_even and not scene.start,
    "with evenly spaced particles that start unstrained",
)


@dataclass(frozen=True)
class Dataset:
    """A NetCDF file of each scene, or of each sampling of each scene.

    Attributes
    ----------
    compute : str
        Function of a scene, of what is read and of the arguments; returns arrays by name.
    message : str
        What the job reports, with {scene} and {sampling}.
    of_sampling, of_modes : bool
        Whether there is one for each sampling, and for each number of modes of it.
    reads : dict
        Of each dataset that the function is given, the file: "pod.nc" is the sampling's,
        "../sph.nc" the scene's; "truth" is the exact solution, or else the centred reference.
    arguments : dict
    needs : Need
        Empty if a scene may be any.
    alone : bool
        Whether nothing may run beside it, as it measures times or machines.
    places : callable
        Places that the study asks for, of a resolved configuration; a path may ask for others.
    only_asked : bool
        Whether there is none of other scenes than those of its places.
    own_scenes : str
        Where in the configuration its scenes are, if they are not those of the paper's study.
    """

    compute: str
    message: str
    of_sampling: bool = False
    of_modes: bool = False
    reads: Mapping[str, str] = field(default_factory=dict)
    arguments: Mapping[str, Argument] = field(default_factory=dict)
    needs: Need | tuple[()] = ()
    alone: bool = False
    places: Callable[[Mapping[str, Any]], Iterable[Place]] = lambda config: ()
    only_asked: bool = False
    own_scenes: str = ""


@dataclass(frozen=True)
class Drawing:
    """Figures of a study.

    Attributes
    ----------
    draw : str
        Function that returns a figure.
    caption : str
        With {scene} and {sampling}, if there is one for each place.
    reads : dict
        Of each argument, the datasets of the study that it is given, all by place or one.
    places : callable
        Places that have a figure of their own; None where one figure shows them all.
    """

    draw: str
    caption: str
    reads: Mapping[str, tuple[str, ...]]
    places: Callable[[Mapping[str, Any]], Iterable[Place]] | None = None


class Setting:
    """A key of the configuration.

    Attributes
    ----------
    kind : type
    default : of that type
    about : dict
        Its description, and what else pydantic's ``Field`` takes, such as ``ge``, the least value.
    """

    def __init__(self, kind: Any, default: Any, **about: Any) -> None:
        self.kind, self.default, self.about = kind, default, about


@dataclass(frozen=True)
class Study:
    """All that the workflow needs to know of a study.

    Attributes
    ----------
    datasets : dict
        By name, which is that of the rule and of the file.
    variables : dict
        What the arrays mean that no other study has, by name.
    tables : dict
        Of each table, the function of its rows, and the datasets that it is of. The function is one
        of a place (scene and sampling, first in every row), of the arrays there and, if it takes
        them, of the settings of their dataset; or of the arrays of all places. It gives a dict a
        row, or one of all columns.
    drawing : Drawing or None
    settings : dict
        Its keys in the configuration, ``studies.<name>``.
    target : str
        Target of the workflow that it is part of: all, benchmarks or stability.
    """

    datasets: Mapping[str, Dataset]
    variables: Mapping[str, Variable] = field(default_factory=dict)
    tables: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    drawing: Drawing | None = None
    settings: Mapping[str, Setting] = field(default_factory=dict)
    target: str = "stability"


def figure_parts(word: str, study: Study) -> tuple[str, ...]:
    """What the name of a study's figure is made of: its target, and its own word beside it."""
    prefix = study.target.removesuffix("s")
    own = word.removeprefix(prefix).removeprefix("_")
    return (prefix, own) if own else (prefix,)


def function(name: str) -> Callable[..., Any]:
    """A function by its name below the package, such as "full.sph.solve"."""
    module, _, attribute = name.rpartition(".")
    return getattr(import_module(f"sphpod.{module}"), attribute)


def variables(name: str) -> Mapping[str, Variable]:
    """What names mean in the arrays of a function that only its study has."""
    study = _declared(name.rpartition(".")[0])
    return study.variables if study else {}


def _declared(module):
    """The study that a module below the package declares, if it does."""
    return getattr(import_module(f"sphpod.{module}"), "STUDY", None)


def studies() -> dict[str, Study]:
    """All studies by name, which is that of their module."""
    names = [module.name for module in iter_modules(sphpod.studies.__path__)]
    found = {name: _declared(f"studies.{name}") for name in names}
    return {name: study for name, study in found.items() if study}


def scenes(config: Mapping[str, Any], needs: Need | tuple[()] = ()) -> list[Place]:
    """All scenes, or those that are what a study needs."""
    return [
        (name,)
        for name, settings in config["scenes"].items()
        if not needs or needs[0](Scene.from_settings(name, settings))
    ]


def samplings(config: Mapping[str, Any], first: bool = False) -> list[Place]:
    """All samplings of all scenes that the paper's models know, or the first of each."""
    return [
        (name, sampling)
        for name, scene in config["scenes"].items()
        if "free" not in scene.get("boundary", ())
        for sampling in list(scene["samplings"])[: 1 if first else None]
    ]


def has_snapshots(config: Mapping[str, Any], place: Place) -> bool:
    """Whether a sampling has snapshots of its own, and not the modes of others' alone."""
    scene, sampling = place
    return "modes" not in config["scenes"][scene]["samplings"][sampling]


def sampled(config: Mapping[str, Any]) -> list[Place]:
    """All samplings that have snapshots of their own."""
    return [place for place in samplings(config) if has_snapshots(config, place)]


def accelerated(config: Mapping[str, Any]) -> list[Place]:
    """Samplings of which the paper's study of run time is asked for."""
    return [
        (name, sampling)
        for name, scene in config["scenes"].items()
        for sampling in scene["acceleration"]
    ]


def step_scene(config: Mapping[str, Any]) -> list[Place]:
    """The scene whose steps are timed, if there is one."""
    scene = config["benchmark"].get("step_scene")
    return [(scene,)] if scene else []
