"""What is asked of stability: its keys, and what they mean for the scenes that there are."""

from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from sphpod.config.boundary import check_ends
from sphpod.config.fields import ModeCount, Name, SamplingName, SceneName, Section, Unique, left_out
from sphpod.config.mode_counts import check_count
from sphpod.config.reading import ConfigError, refusal
from sphpod.config.scene_section import Scene, error_interval, known_names
from sphpod.config.sizes import check_counts, check_sizes, sizes
from sphpod.config.start_section import check_start
from sphpod.reduced.snapshots import is_of_run
from sphpod.scene import checks
from sphpod.scene import scene as scenes
from sphpod.scene.kernel import neighbour_count

STABILITY_STUDIES = ("stability_map", "amplitude", "poor_snapshots")
"""Studies of one sampling of a scene, each for the scenes that it names."""


class RandomRun(Section):
    """A model of random modes that grows."""

    scene: str = Field(description="name of the scene")


class LongRun(Section):
    """A model of POD modes that is run for long."""

    scene: str = Field(description="name of the scene")
    sampling: str = Field(description="name of the sampling")
    mode_count: ModeCount


LONGEST_HORIZON = 1_000_000
"""Durations of a scene over which a run may be followed."""

Horizons = Annotated[list[Annotated[int, Field(ge=1, le=LONGEST_HORIZON)]], Unique()]
ModeCounts = Annotated[list[ModeCount], Unique()]
Sampled = dict[Name, SamplingName]


class Stability(Section):
    """How stability is studied."""

    mode_counts: ModeCounts = Field(
        [4, 8, 12],
        min_length=1,
        description="numbers of modes of reduced models that are stepped, default 4, 8 and 12",
    )
    random_bases: int = Field(
        10_000,
        ge=1,
        le=10_000_000,
        description="number of random bases of every scene, default 10000",
    )
    horizon_factors: Horizons = Field(
        [1, 10],
        min_length=1,
        description="durations over which explicit Euler is followed, in those of a scene",
    )
    energy_horizon_factor: int = Field(
        100,
        ge=1,
        le=LONGEST_HORIZON,
        description="duration over which energies are followed, in that of a scene",
    )
    smoothing_ratios: Annotated[list[Annotated[float, Field(gt=1)]], Unique()] = Field(
        [1.04, 1.06, 1.2],
        min_length=2,
        description="smoothing lengths that are compared, in particle spacings",
    )
    random_run: RandomRun = left_out(
        description="scene of which a model of random modes is run that grows"
    )
    long_run: LongRun = left_out(description="model of POD modes that is run for long")
    amplitude_count: int = Field(
        12,
        ge=3,
        le=1000,
        description="amplitudes of the initial velocity, up to the one at which the scene folds, "
        "default 12",
    )
    noise_levels: Annotated[list[Annotated[float, Field(gt=0)]], Unique()] = Field(
        [1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1],
        min_length=1,
        description="noise of poor snapshots, of what moves (dimensionless)",
    )
    stability_map: Sampled = left_out(
        description="scenes of which stability is mapped, each with the sampling of its modes"
    )
    amplitude: Sampled = left_out(
        description="scenes whose initial velocity is scaled up, each with its sampling"
    )
    poor_snapshots: Sampled = left_out(
        description="scenes of which poor snapshots are taken, each with its sampling"
    )
    edge_scenes: dict[SceneName, Scene] = Field(
        {}, description="scenes at the edge of what can be computed, by name"
    )


WITHOUT_TIMES = "it must be a sampling at times, as snapshots of other runs are taken there too"


STEADY = "it must be a scene without start, of which neither youngs_modulus nor damping names t"


def resolved_stability(
    settings: dict[str, Any], known: dict[str, Any], memory: float, share: float
) -> dict[str, Any]:
    """Check what is asked of stability; studies are of the first sampled scene if none is named."""
    steady = {
        name: "start" not in settings and scenes.Scene.from_settings(name, settings).is_steady
        for name, settings in known.items()
    }
    first = {
        name: timed[0]
        for name, s in known.items()
        if steady[name]
        and "free" not in s.get("boundary", ())
        and (timed := [one for one, taken in s["samplings"].items() if is_of_run(taken)])
    }
    moving = {n: s for n, s in first.items() if _strains(scenes.Scene.from_settings(n, known[n]))}
    usual = dict(list(first.items())[:1])
    stability: dict[str, Any] = {
        **Stability.default_keys(),
        **dict.fromkeys(STABILITY_STUDIES, usual),
        "amplitude": dict(list(moving.items())[:1]),
        **settings,
    }
    for study in STABILITY_STUDIES:
        for name, sampling in stability[study].items():
            key = f"stability.{study}"
            if name not in known:
                raise refusal(None, key, name, f"no such scene; allowed are {', '.join(known)}")
            if sampling not in known[name]["samplings"]:
                allowed = known_names("sampling", known[name]["samplings"])
                raise refusal(None, f"{key}.{name}", sampling, allowed)
            if not steady[name]:
                raise refusal(None, key, name, STEADY)
            check_ends(name, known[name])
            taken = known[name]["samplings"][sampling]
            if study != "stability_map" and not is_of_run(taken):
                raise refusal(None, f"{key}.{name}", sampling, WITHOUT_TIMES)
            if study == "amplitude" and not _strains(scenes.Scene.from_settings(name, known[name])):
                allowed = "it must be a scene with an initial velocity that strains it when scaled"
                raise refusal(None, key, name, allowed)
    for ratio in stability["smoothing_ratios"]:
        for name, scene in known.items():
            if 2 * neighbour_count(ratio) + 1 > scene["particle_count"]:
                allowed = (
                    f"the kernel's support of 4h would wrap round the domain of scene {name}, "
                    f"which has {scene['particle_count']} particles"
                )
                raise refusal(None, "stability.smoothing_ratios", ratio, allowed)
    _check_runs(stability, known)
    stability["edge_scenes"] = {
        name: _edge_scene(name, scene, known, memory, share)
        for name, scene in stability["edge_scenes"].items()
    }
    return stability


def _check_runs(stability: Mapping[str, Any], known: Mapping[str, Any]) -> None:
    """Check the runs that show a model that grows."""
    for study in ("random_run", "long_run"):
        if study not in stability:
            continue
        run = stability[study]
        for key, value, names in (
            ("scene", run["scene"], known),
            ("sampling", run.get("sampling"), known.get(run["scene"], {}).get("samplings", {})),
        ):
            if value is not None and value not in names:
                raise refusal(
                    None, f"stability.{study}.{key}", value, f"allowed are {', '.join(names)}"
                )
        scene = scenes.Scene.from_settings(run["scene"], known[run["scene"]])
        check_ends(run["scene"], known[run["scene"]])
        if not scene.is_conservative or scene.start:
            allowed = "it must be a scene without damping, force and start"
            raise refusal(None, f"stability.{study}.scene", run["scene"], allowed)
        if study == "long_run" and not np.any(scene.velocity0()):
            allowed = "it must be a scene with an initial velocity"
            raise refusal(None, f"stability.{study}.scene", run["scene"], allowed)
        if study == "random_run" and not np.ptp(scene.density0()) + np.ptp(scene.modulus()):
            allowed = "its density or modulus must vary, or no model of random modes grows"
            raise refusal(None, f"stability.{study}.scene", run["scene"], allowed)
    if "mode_count" in stability.get("long_run", {}):
        run = stability["long_run"]
        check_count(
            run["scene"],
            run["sampling"],
            known[run["scene"]],
            "stability.long_run.mode_count",
            str(run["mode_count"]),
        )


def _edge_scene(
    name: str, settings: dict[str, Any], others: Mapping[str, Any], memory: float, share: float
) -> dict[str, Any]:
    """A scene at the edge, which explicit Euler need not be able to step."""
    key = f"stability.edge_scenes.{name}"
    if name in others:
        raise refusal(None, key, "...", "this name is taken by a scene; every one needs its own")
    for given, value in settings.items():
        if given not in scenes.PHYSICS_KEYS:
            allowed = ", ".join(scenes.PHYSICS_KEYS)
            raise refusal(None, f"{key}.{given}", value, f"unknown here; allowed are {allowed}")
    if "start" in settings:
        raise refusal(
            None, f"{key}.start", settings["start"], "scenes at the edge start unstrained"
        )
    check_start(name, settings)
    scene = {"error_interval": error_interval(settings), **settings}
    check_counts(name, scene)
    try:
        physics = scenes.Scene.from_settings(name, scene)
        check_sizes(name, sizes(physics, scene), memory)
        checks.check_setting(physics, share)
    except ValueError as error:
        raise ConfigError(str(error)) from error
    for given in ("youngs_modulus", "damping"):
        if physics.varies(given):
            raise refusal(None, f"{key}.{given}", scene[given], "it must not name t here")
    return scene


def _strains(scene: scenes.Scene) -> bool:
    """Whether the initial velocity, scaled by up to 1e12, can fold the line."""
    if scene.start:
        return False
    velocity, damping = scene.velocity0(), scene.damping_values()
    slowed_apart = damping.size and damping.min() < damping.max() and np.any(velocity)
    reach = 1e12 * scene.duration * np.abs(scene.derivative(velocity)).max()
    return bool(slowed_apart or reach > 1)
