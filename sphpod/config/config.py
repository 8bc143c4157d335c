"""Read, check and complete a configuration before any job starts.

Every fault ends in a `ConfigError` of one sentence that names scene, key, value and what is
allowed. The checks are those of the schema, of what one key means for another (here), of the
expressions, and of what a scene's numbers mean together (`sphpod.scene.checks.check`).
"""

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from sphpod.config import refusals
from sphpod.config.borrowed import borrow
from sphpod.config.boundary import check_ends
from sphpod.config.chain_section import INSTEAD, spread_chain
from sphpod.config.configuration import (
    Benchmark,
    Configuration,
    Illustration,
    configuration,
    schema,
    study_sections,
)
from sphpod.config.fields import SETTINGS, Name
from sphpod.config.mode_counts import check_count, field_limits, parse_pair, usual_sweep
from sphpod.config.parameters import resolved_parameters
from sphpod.config.reading import ConfigError, counted, merged, plain, read_yaml, refusal
from sphpod.config.scene_section import FIGURES, AnySampling, Scene, error_interval, known_names
from sphpod.config.sizes import check_counts, check_sizes, sizes
from sphpod.config.stability_section import WITHOUT_TIMES, resolved_stability
from sphpod.config.start_section import EITHER, check_start
from sphpod.config.survey_section import resolved_surveys
from sphpod.config.varied import check_pairs, check_variants
from sphpod.numerics.error import FIELDS
from sphpod.reduced import snapshots
from sphpod.reference import exact
from sphpod.scene import checks
from sphpod.scene import scene as scenes


def load(paths: Sequence[Path | str], overrides: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Read and check a configuration, and fill in its defaults.

    Parameters
    ----------
    paths : YAML files; where several set one key, the last wins
    overrides : settings that win over the files

    Returns
    -------
    The resolved settings, of plain JSON types: ``output`` ("" if there is none), ``memory``,
    ``scenes`` (``defaults`` are in them), ``illustrations``, ``claims``, ``benchmark``,
    ``stability``, ``studies``, ``surveys``. Every scene has
    ``section``, ``error_interval``, ``references``, ``samplings`` (each with ``mode_counts`` as
    text), ``acceleration`` and ``figures`` (each with ``name`` and ``caption``); damping, force and
    interface stay away where a scene has none.

    Raises
    ------
    ConfigError
        A file cannot be read, or says something that is not allowed.
    """
    settings: dict[str, Any] = {}
    for source in [*map(read_yaml, paths), overrides or {}]:
        settings = merged(settings, plain(source))
    _spread_defaults(settings)
    try:
        configuration().model_validate(settings)
    except ValidationError as error:
        raise refusals.of_models(error, settings, refusals.written_out(schema())) from None
    settings.pop("defaults", None)
    _check_output(settings.get("output", ""))
    memory = settings.get("memory", Configuration.default_keys()["memory"])
    of_studies = settings.get("studies", {})
    share = 1 / _checked(settings)
    resolved = {
        **Configuration.default_keys(),
        **settings,
        "scenes": {
            name: _resolved_scene(name, scene, memory, share)
            for name, scene in settings["scenes"].items()
        },
        "illustrations": [
            Illustration.default_keys() | figure for figure in settings.get("illustrations", [])
        ],
        "benchmark": Benchmark.default_keys() | settings.get("benchmark", {}),
        "studies": {
            word: section.default_keys() | of_studies.get(word, {})
            for word, section in study_sections().items()
        },
    }
    for name in resolved["scenes"]:
        borrow(name, resolved["scenes"])
    resolved["surveys"] = resolved_surveys(settings.get("surveys", {}), resolved["scenes"], memory)
    resolved["stability"] = resolved_stability(
        settings.get("stability", {}), resolved["scenes"], memory, share
    )
    _name_figures(resolved)
    _check_benchmark(resolved)
    check_variants(resolved, share)
    check_pairs(resolved)
    return resolved


def _check_output(output):
    """Refuse a folder that is a file, or could only be made in one."""
    for folder in (Path(output, part) for part in ("results/logs", "figures")):
        for above in (folder, *folder.parents):
            if above.exists() and not above.is_dir():
                allowed = f"{above} is a file; it must be a folder, or nothing yet"
                raise refusal(None, "output", output, allowed)


def _spread_defaults(settings):
    """Give scenes the keys of ``defaults`` that they do not have, and chains their material."""
    defaults, known = settings.get("defaults"), settings.get("scenes")
    if isinstance(known, dict):
        for name, scene in known.items():
            if isinstance(scene, dict):
                given = plain(defaults) | scene if isinstance(defaults, dict) else scene
                known[name] = spread_chain(str(name), _own_way(scene, given))


def _own_way(scene, given):
    """Keys given to a scene by defaults too, without those that one of its own stands for."""
    both = [*INSTEAD.items(), EITHER]
    others = [*both, *(pair[::-1] for pair in both)]
    said = {other for own, other in others if own in scene and other not in scene}
    return {key: value for key, value in given.items() if key not in said}


def check_modes(
    config: Mapping[str, Any], scene: str, sampling: str, modes: str, method: str = ""
) -> None:
    """Check mode counts that are asked for of a method, such as ``12`` or ``1-20``.

    Raises
    ------
    ConfigError
        There is no such scene or sampling, these are no mode counts, or more than it can give.
    """
    if scene not in config["scenes"]:
        known = ", ".join(config["scenes"])
        raise ConfigError(f"scene {scene}: there is no such scene; allowed are {known}")
    settings = config["scenes"][scene]
    if sampling not in settings["samplings"]:
        raise refusal(scene, "sampling", sampling, known_names("sampling", settings["samplings"]))
    if method and not method.startswith("lifted"):
        check_ends(scene, settings)
    if pair := parse_pair(modes):
        _check_pair(scene, sampling, settings, modes, pair, method)
        return
    split = method.startswith("lifted") and scenes.Scene.from_settings(scene, settings).translates
    check_count(scene, sampling, settings, "modes", modes, int(split))


def _check_pair(scene, sampling, settings, modes, pair, method) -> None:
    """Check numbers of modes that differ between velocity and density."""
    if method.startswith("lifted"):
        alike = "lifted models have one number of modes, as stress does work on velocity"
        raise refusal(scene, "modes", modes, alike)
    for field, count, limit in zip(FIELDS, pair, field_limits(settings, sampling), strict=True):
        if count > limit:
            allowed = f"sampling {sampling} gives {limit} {field} modes"
            raise refusal(scene, "modes", modes, f"more {field} modes than there are; {allowed}")


def check_sampling(scene: scenes.Scene, name: str, sampling: Mapping[str, Any]) -> dict[str, Any]:
    """Check a sampling of a scene that is at hand, as `load` checks those of a configuration.

    Returns
    -------
    dict
        The sampling in plain JSON types, with ``mode_counts`` as text.

    Raises
    ------
    ConfigError
        The sampling says something that is not allowed.
    """
    samplings = {name: plain(sampling)}
    settings: dict[str, Any] = {"samplings": samplings}
    try:
        TypeAdapter(dict[Name, AnySampling], config=SETTINGS).validate_python(samplings)
    except ValidationError as error:
        within = "scenes", scene.name, "samplings"
        every = {"scenes": {scene.name: settings}}
        raise refusals.of_models(error, every, refusals.written_out(schema()), within) from None
    if not snapshots.is_of_run(sampling):
        key = "from" if "from" in sampling else "modes"
        allowed = "snapshots of other runs are arrays, which decompositions take as they are"
        raise refusal(scene.name, f"samplings.{name}.{key}", sampling[key], allowed)
    settings["particle_count"] = scene.particle_count
    return _resolved_sampling(scene.name, name, settings, scene)


# --------------------------------------------------------------------- meaning and defaults


def _checked(settings: Mapping[str, Any]) -> int:
    """How many scenes are checked, with those of studies."""
    edges = settings.get("stability", {}).get("edge_scenes", {})
    runs = settings.get("studies", {}).get("variants", {}).get("runs", {})
    return len(settings["scenes"]) + len(edges) + sum(map(len, runs.values()))


def _resolved_scene(
    name: str, settings: dict[str, Any], memory: float, share: float
) -> dict[str, Any]:
    """Check one scene, of which some are checked alike, and fill in its defaults."""
    scene = {
        **Scene.default_keys(),
        **settings,
        "error_interval": settings.get("error_interval", error_interval(settings)),
    }
    if scene.get("boundary") == "periodic":
        del scene["boundary"]
    check_start(name, scene)
    check_counts(name, scene)
    if "parameters" in scene:
        scene["parameters"] = resolved_parameters(name, scene)
    try:
        physics = scenes.Scene.from_settings(name, scene)
        check_sizes(name, sizes(physics, scene), memory)
        checks.check(physics, share)
    except ValueError as error:
        by_default = "error_interval" not in settings and "error_interval =" in str(error)
        hint = " (this is the default; another can be set)" if by_default else ""
        raise ConfigError(f"{error}{hint}") from error
    if physics.start:
        scene["start"] = {**scene["start"], "checksum": physics.start.checksum}
    scene["references"] = _references(name, scene, physics)
    scene["samplings"] = {
        sampling: _resolved_sampling(name, sampling, scene, physics)
        for sampling in scene["samplings"]
    }
    for sampling, study in scene["acceleration"].items():
        key = f"acceleration.{sampling}"
        if not physics.is_even or physics.start:
            alike = "evenly spaced particles that start unstrained"
            raise refusal(name, key, study, f"CPU times are compared for {alike} only")
        if sampling not in scene["samplings"]:
            raise refusal(name, key, study, known_names("sampling", scene["samplings"]))
        if not snapshots.is_of_run(scene["samplings"][sampling]):
            raise refusal(name, key, study, WITHOUT_TIMES)
        check_ends(name, scene)
        for count in study["mode_counts"]:
            check_count(name, sampling, scene, f"{key}.mode_counts", str(count))
    drawn = _default_figures(scene, physics)
    figures = scene["figures"] if "figures" in scene else list(drawn)
    scene["figures"] = [
        _resolved_figure(name, scene, f"figures.{index}", figure, physics)
        for index, figure in enumerate(figures)
    ]
    return scene


def known_references(physics: scenes.Scene) -> list[str]:
    """Kinds of references that there are of a scene."""
    kind = exact.kind(physics)
    return [
        "fd",
        "centred",
        *["chain"] * (physics.is_even and not physics.start),
        *["exact"] * (kind is not None),
        *["modified"] * (kind == "dalembert"),
    ]


def _references(name: str, settings: dict[str, Any], physics: scenes.Scene) -> list[str]:
    asked = settings.get("references")
    if asked is not None and not {"chain", "exact", "modified"} & set(asked):
        return asked
    possible = known_references(physics)
    if asked is None:
        return ["exact" if "exact" in possible else "centred"]
    for reference in asked:
        if reference not in possible:
            allowed = f"no such solution of this scene is known; allowed are {', '.join(possible)}"
            raise refusal(name, "references", reference, allowed)
    return asked


def _resolved_sampling(
    name: str, sampling: str, scene: dict[str, Any], physics: scenes.Scene
) -> dict[str, Any]:
    settings = scene["samplings"][sampling]
    key = f"samplings.{sampling}"
    if "from" in settings:
        try:
            settings |= snapshots.described(physics, settings["from"])
        except ValueError as error:
            raise refusal(name, f"{key}.from", settings["from"], str(error)) from None
        modes = str(settings.get("mode_counts", usual_sweep(scene, sampling)))
        check_count(name, sampling, scene, f"{key}.mode_counts", modes)
        return {**settings, "mode_counts": modes}
    if "modes" in settings:
        return settings  # Completed when all scenes are known.
    step, duration = physics.time_step, physics.duration
    latest = duration * (1 + 1e-9)  # for times that are the last one but for rounding
    if "range" in settings:
        start, end = settings["range"]
        if not start < end <= latest:
            allowed = f"it must rise and end within T = {checks.number(duration)}"
            raise refusal(name, f"{key}.range", [start, end], allowed)
        first, last = (scenes.whole_steps(time, step) for time in (start, end))
        available = max(math.floor(last) - math.ceil(first), 0)
        # Evenly spaced times may also round to the range's end, random ones never do.
        if settings["count"] > available + ("seed" not in settings):
            held = counted(available, "time step")
            allowed = f"the range holds {held} of {step:g}, each for one snapshot"
            raise refusal(name, f"{key}.count", settings["count"], allowed)
    else:
        for which in ("velocity_times", "density_times"):
            last = max(settings[which])
            if last > latest:
                allowed = f"it must lie within 0 and T = {checks.number(duration)}"
                raise refusal(name, f"{key}.{which}", last, allowed)
    taken = snapshots.sampling_steps(physics, settings)
    for which, steps in zip(("velocity_times", "density_times"), taken, strict=True):
        twice = steps[1:][np.diff(steps) == 0]
        if twice.size:
            source = "count" if "count" in settings else which
            allowed = (
                f"two snapshots fall on the time step at {twice[0] * step:g}; they must lie at "
                f"least one step of {step:g} apart"
            )
            raise refusal(name, f"{key}.{source}", settings[source], allowed)
    modes = str(settings.get("mode_counts", usual_sweep(scene, sampling)))
    check_count(name, sampling, scene, f"{key}.mode_counts", modes)
    return {**settings, "mode_counts": modes}


def _default_figures(scene: dict[str, Any], physics: scenes.Scene) -> Iterator[dict[str, Any]]:
    yield {"kind": "profile"}
    for sampling in scene["samplings"]:
        yield {"kind": "modes", "sampling": sampling}
        if not (physics.ends and physics.ends.is_free):
            yield {"kind": "error", "sampling": sampling}
        if sampling in scene["acceleration"]:
            yield {"kind": "acceleration", "sampling": sampling}


def _resolved_figure(
    name: str, scene: dict[str, Any], key: str, figure: Any, physics: scenes.Scene
) -> dict[str, Any]:
    kind = figure["kind"]
    sampling = figure.get("sampling")
    if sampling is not None:
        what = "acceleration" if kind == "acceleration" else "sampling"
        known = scene["acceleration" if kind == "acceleration" else "samplings"]
        if sampling not in known:
            raise refusal(name, f"{key}.sampling", sampling, known_names(what, known))
    if kind == "phase" and exact.kind(physics) != "dalembert":
        allowed = (
            "it shows the exact and the modified solution, known for uniform undamped scenes only"
        )
        raise refusal(name, f"{key}.kind", kind, allowed)
    if kind == "phase" and figure["position"] >= scene["domain_length"]:
        allowed = f"it must be at least 0 and below L = {scene['domain_length']}"
        raise refusal(name, f"{key}.position", figure["position"], allowed)
    interval = scene["error_interval"]
    if "end_time" in figure and not 2 * interval <= figure["end_time"] <= scene["duration"]:
        allowed = (
            f"it must be from two error intervals, {checks.number(2 * interval)}, to "
            f"T = {checks.number(scene['duration'])}"
        )
        raise refusal(name, f"{key}.end_time", figure["end_time"], allowed)
    if kind == "initial_spectrum" and (physics.ends or not physics.is_even):
        what = "a periodic line" if physics.ends else "evenly spaced particles"
        raise refusal(name, f"{key}.kind", kind, f"a spectrum is drawn of {what} only")
    if kind == "error":
        check_ends(name, scene)
    of_what = name if sampling is None else f"{name}, snapshots {sampling}"
    drawn = FIGURES[kind]
    return {"caption": f"{drawn.shows}: {of_what}."} | drawn.default_keys() | figure


def _check_benchmark(config: dict[str, Any]) -> None:
    benchmark, scenes = config["benchmark"], config["scenes"]
    step_scene = benchmark.get("step_scene")
    if step_scene is None:
        return
    if step_scene not in scenes:
        known = ", ".join(scenes)
        raise refusal(
            None, "benchmark.step_scene", step_scene, f"no such scene; allowed are {known}"
        )
    if "start" in scenes[step_scene]:
        allowed = "it must be a scene without start, as its particles are varied"
        raise refusal(None, "benchmark.step_scene", step_scene, allowed)
    particles, most = scenes[step_scene]["particle_count"], max(benchmark["mode_counts"])
    if most >= particles:
        allowed = f"it must be below the {particles} particles of {step_scene}"
        raise refusal(None, "benchmark.mode_counts", most, allowed)


def distinct_names(parts: Sequence[Sequence[str]]) -> list[str]:
    """A name for each sequence of names: joined by underscores, unless that is another's too.

    Names of scenes and samplings hold no hyphen, so that joined by hyphens no two are the same.
    """
    joined = Counter("_".join(names) for names in set(map(tuple, parts)))
    return [("_" if joined["_".join(names)] == 1 else "-").join(names) for names in parts]


def _name_figures(config: dict[str, Any]) -> None:
    """Give each figure that has no name one of its own, and refuse names that stand twice.

    Upper and lower case count as the same letter, as they do in the file names of some systems.
    """
    drawn: list[tuple[str | None, str, dict[str, Any]]] = [
        (None, f"illustrations.{i}", f) for i, f in enumerate(config["illustrations"])
    ]
    drawn += [
        (scene, f"figures.{i}", f)
        for scene, settings in config["scenes"].items()
        for i, f in enumerate(settings["figures"])
    ]
    nameless = [(scene, figure) for scene, _, figure in drawn if scene and "name" not in figure]
    parts = [[s, *([f["sampling"]] if "sampling" in f else []), f["kind"]] for s, f in nameless]
    for (_, figure), name in zip(nameless, distinct_names(parts), strict=True):
        figure["name"] = name
    seen: dict[str, str] = {}
    for scene, key, figure in drawn:
        name = figure["name"]
        if name.lower() in seen:
            allowed = f"this name is taken by {seen[name.lower()]}; every figure needs its own"
            raise refusal(scene, f"{key}.name", name, allowed)
        seen[name.lower()] = f"scene {scene}, {key}" if scene else key
