"""Read, check and complete a configuration before any job starts.

Every fault ends in a `ConfigError` of one sentence that names scene, key, value and what is
allowed. The checks are those of the schema, of what one key means for another (here), of the
expressions, and of what a scene's numbers mean together (`sphpod.scene.checks.check`).
"""

import difflib
import math
import re
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import yaml

from sphpod.reduced import snapshots
from sphpod.reference import exact
from sphpod.scene import checks
from sphpod.scene import scene as scenes
from sphpod.scene.kernel import neighbour_count
from sphpod.studies.study import studies

try:
    from yaml import CSafeLoader as SafeLoader  # ten times as fast
except ImportError:
    from yaml import SafeLoader  # type: ignore[assignment]

SCHEMA = Path(__file__).with_suffix(".schema.yaml")
"""The JSON schema of a configuration, as YAML."""

DEFAULT_ERROR_SAMPLES = 10000
DEFAULT_LARGEST_SWEEP = 20
DEFAULT_FIELDS = ["initial_velocity", "velocity"]
DEFAULT_BENCHMARK = {
    "repeats": 5,
    "particle_counts": [100, 400, 1000, 4000, 10_000, 40_000, 100_000, 400_000, 1_000_000],
    "mode_counts": [2, 4, 8, 12, 16, 24, 32],
}

DEFAULT_STABILITY = {
    "mode_counts": [4, 8, 12],
    "random_bases": 10_000,
    "horizon_factors": [1, 10],
    "energy_horizon_factor": 100,
    "smoothing_ratios": [1.04, 1.06, 1.2],
    "amplitude_count": 12,
    "noise_levels": [1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1],
    "scenes": {},
}
STABILITY_STUDIES = ("map", "amplitude", "snapshots")
"""Studies of one sampling of a scene, each for the scenes that it names."""

LARGEST_COUNTS = {"time_step": 10**9, "error_interval": 10**6}
"""How often a key may fit in the duration, so that a slip of the pen does not fill the memory."""

FIGURE_KEYS = {
    "profile": ("fields",),
    "modes": ("sampling",),
    "error": ("sampling",),
    "acceleration": ("sampling",),
    "initial_spectrum": (),
    "phase": ("position",),
}
"""The keys that a kind of figure has beyond kind, name and caption."""

FIGURE_CAPTIONS = {
    "profile": "Initial state and reference solution",
    "modes": "Leading POD modes of velocity and density",
    "error": "Singular values, and errors against the number of POD modes",
    "acceleration": "Errors of the reduced models against CPU time",
    "initial_spectrum": "Fourier coefficients of the initial velocity",
    "phase": "Velocity at one position against time",
}


class ConfigError(ValueError):
    """A configuration, or a target asked for, that is not allowed; the message is one sentence."""


def load(
    paths: Sequence[Path | str],
    schema_path: Path | str = SCHEMA,
    overrides: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Read and check a configuration, and fill in its defaults.

    Parameters
    ----------
    paths : YAML files; where several set one key, the last wins
    schema_path : the JSON schema, as YAML
    overrides : settings that win over the files

    Returns
    -------
    The resolved settings, of plain JSON types: ``output`` ("" if there is none), ``scenes``,
    ``illustrations``, ``claims``, ``benchmark``, ``stability``, ``studies``. Every scene has
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
        settings = _merged(settings, _plain(source))
    _check_schema(settings, with_studies(read_yaml(schema_path)))
    resolved = {
        "output": settings.get("output", ""),
        "scenes": {name: _resolved_scene(name, s) for name, s in settings["scenes"].items()},
        "illustrations": [
            {"section": "", "caption": "", **illustration}
            for illustration in settings.get("illustrations", [])
        ],
        "claims": settings.get("claims", []),
        "benchmark": DEFAULT_BENCHMARK | settings.get("benchmark", {}),
        "studies": {
            word: {key: value["default"] for key, value in study.settings.items()}
            | settings.get("studies", {}).get(word, {})
            for word, study in studies().items()
            if study.settings
        },
    }
    resolved["stability"] = _resolved_stability(settings.get("stability", {}), resolved["scenes"])
    _name_figures(resolved)
    _check_benchmark(resolved)
    return resolved


def with_studies(schema: dict[str, Any]) -> dict[str, Any]:
    """The schema with the keys that studies declare, in ``studies``."""
    declared = {
        word: {
            "description": f"keys of the study {word}",
            "type": "object",
            "additionalProperties": False,
            "properties": dict(study.settings),
        }
        for word, study in studies().items()
        if study.settings
    }
    keys = {
        "description": "keys of studies, by name",
        "type": "object",
        "additionalProperties": False,
        "properties": declared,
    }
    return schema | {"properties": schema["properties"] | {"studies": keys}}


def parse_modes(text: str) -> list[int]:
    """Mode counts of a text such as ``12`` or ``1-20``, both ends included.

    Raises
    ------
    ValueError
        The text is neither a mode count nor a rising range of them.
    """
    match = re.fullmatch(r"([1-9]\d{0,4})(?:-([1-9]\d{0,4}))?", text)
    if match and match[2] is None:
        return [int(match[1])]
    if match and int(match[1]) < int(match[2]):
        return list(range(int(match[1]), int(match[2]) + 1))
    raise ValueError(f"{text!r} is neither a mode count from 1 on, nor a rising range such as 1-20")


def parse_tolerance(text: str) -> float:
    """Relative tolerance of a text such as ``1e-2`` or ``0.05``.

    Raises
    ------
    ValueError
        The text is no number between 0 and 1.
    """
    if re.fullmatch(r"[1-9](\.\d+)?e-\d{1,2}|0\.\d+", text) and 0 < float(text) < 1:
        return float(text)
    raise ValueError("it must be a number above 0 and below 1, such as 1e-2 or 0.05")


def check_modes(
    config: Mapping[str, Any], scene: str, sampling: str, modes: str, method: str = "original"
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
        raise _refusal(scene, "sampling", sampling, _known("sampling", settings["samplings"]))
    split = method.startswith("lifted") and _physics(scene, config["scenes"]).translates
    _check_modes(scene, sampling, settings, "modes", modes, int(split))


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
    schema = read_yaml(SCHEMA)
    del schema["$defs"]["scene"]["required"]
    settings: dict[str, Any] = {"samplings": {name: _plain(sampling)}}
    _check_schema({"scenes": {scene.name: settings}}, schema)
    settings["particle_count"] = scene.particle_count
    return _resolved_sampling(scene.name, name, settings, scene)


def mode_limit(scene: Mapping[str, Any], sampling: str) -> int:
    """The most modes that a sampling gives: the size of the larger of its two snapshot sets, but
    no more than there are particles."""
    times = scene["samplings"][sampling]
    if "count" in times:
        larger = times["count"]
    else:
        larger = max(len(times["velocity_times"]), len(times["density_times"]))
    return min(larger, scene["particle_count"])


def usual_sweep(scene: Mapping[str, Any], sampling: str) -> str:
    """All mode counts of a sampling up to the usual largest, as text such as ``1-20``."""
    limit = min(DEFAULT_LARGEST_SWEEP, mode_limit(scene, sampling))
    return f"1-{limit}" if limit > 1 else "1"


def _refusal(scene: str | None, key: str, value: Any, allowed: str) -> ConfigError:
    return ConfigError(f"{f'scene {scene}: ' if scene else ''}{key} = {_shown(value)}: {allowed}")


def _shown(value: Any) -> str:
    """A value as in YAML, on one line and not too long."""
    if value is None:
        return "(empty)"
    if isinstance(value, str):
        text = " ".join(value.split())
    else:
        try:
            text = yaml.safe_dump(value, default_flow_style=True, width=math.inf, sort_keys=False)
        except yaml.YAMLError:  # a value that Python has and YAML has not
            text = repr(value)
        text = text.removesuffix("\n").removesuffix("\n...").strip()
    return text if len(text) <= 100 else text[:97] + "..."


# ------------------------------------------------------------------------------- reading YAML


class _StrictLoader(SafeLoader):
    """YAML with the scalars of YAML 1.2: ``2e-4`` is a number, ``yes``, 1:30 and dates are text."""

    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}  # noqa: RUF012


for _tag, _pattern, _first in (
    ("null", r"~|null|", ["~", "n", ""]),
    ("bool", r"true|false", list("tf")),
    ("int", r"[-+]?(0|[1-9]\d*)", list("-+0123456789")),
    ("float", r"[-+]?(\.\d+|\d+(\.\d*)?)([eE][-+]?\d+)?", list("-+.0123456789")),
):
    _StrictLoader.add_implicit_resolver(
        f"tag:yaml.org,2002:{_tag}", re.compile(rf"(?:{_pattern})$"), _first
    )


def read_yaml(path: Path | str) -> dict[str, Any]:
    """Read a YAML file that holds a mapping, in which no key stands twice.

    Raises
    ------
    ConfigError
        The file cannot be read, is not YAML, or holds a key twice.
    """
    try:
        loader = _StrictLoader(Path(path).read_bytes())
        try:
            node = loader.get_single_node()
            _check_keys(node, str(path))
            content = loader.construct_document(node) if node else {}
        finally:
            loader.dispose()
    except OSError as error:
        raise ConfigError(f"{path} cannot be read ({error.strerror})") from error
    except (yaml.YAMLError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        line = f", line {mark.line + 1}" if mark else ""
        problem = getattr(error, "problem", None) or str(error)
        raise ConfigError(
            f"{path}{line}: this is not YAML ({' '.join(problem.split())})"
        ) from error
    if not isinstance(content, dict):
        raise ConfigError(f"{path} holds {_shown(content)} where keys and values are needed")
    return content


def _check_keys(node: yaml.Node | None, source: str, path: tuple[str, ...] = ()) -> None:
    """Refuse a key that is not text or stands twice, and a number that is not finite."""
    if isinstance(node, yaml.SequenceNode):
        for index, item in enumerate(node.value):
            _check_keys(item, source, (*path, str(index)))
    elif isinstance(node, yaml.ScalarNode):
        if node.tag.endswith((":float", ":int")) and not math.isfinite(float(node.value)):
            scene, key = _scene_and_key(path)
            raise _refusal(scene, key, node.value, "the number is too large")
    elif isinstance(node, yaml.MappingNode):
        seen = set()
        for key_node, value in node.value:
            line = key_node.start_mark.line + 1
            if not key_node.tag.endswith(":str"):
                name = _shown(key_node.value)
                raise ConfigError(f"{source}, line {line}: the key {name} is not text")
            name = key_node.value
            if name in seen:
                scene, key = _scene_and_key((*path, name))
                shown = value.value if isinstance(value, yaml.ScalarNode) else "..."
                raise _refusal(
                    scene,
                    key,
                    shown,
                    f"the key stands twice ({source}, line {line}); once is allowed",
                )
            seen.add(name)
            _check_keys(value, source, (*path, name))


def _plain(value: Any) -> Any:
    """A copy that shares nothing, with whole numbers as int however they were written."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | range):
        return [_plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, float) and value.is_integer() and abs(value) < 2**53:
        return int(value)
    return value


def _merged(old: Any, new: Any) -> Any:
    if isinstance(old, dict) and isinstance(new, dict):
        return old | {key: _merged(old.get(key), item) for key, item in new.items()}
    return new


# ------------------------------------------------------------------------------- the schema

TYPES = {
    "object": "keys and values",
    "array": "a list",
    "string": "text",
    "number": "a number",
    "integer": "a whole number",
}


def _is_number(_: Any, value: Any) -> bool:
    """Whether a value is a number in double precision; no NaN is."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return is_number and abs(value) <= sys.float_info.max


_Validator = jsonschema.validators.extend(
    jsonschema.Draft202012Validator,
    type_checker=jsonschema.Draft202012Validator.TYPE_CHECKER.redefine("number", _is_number),
)


def _check_schema(settings: dict[str, Any], schema: dict[str, Any]) -> None:
    def weight(error: jsonschema.ValidationError) -> tuple[int, list[str]]:
        # A misspelt key is also a missing one: speak of the misspelling.
        rank = {"additionalProperties": 0, "propertyNames": 0, "required": 2, "oneOf": 3}
        return rank.get(str(error.validator), 1), [str(part) for part in error.absolute_path]

    errors = sorted(_Validator(schema).iter_errors(settings), key=weight)
    if errors:
        raise _schema_refusal(errors[0])


def _schema_refusal(error: jsonschema.ValidationError) -> ConfigError:
    """Put what the schema refuses in one sentence."""
    path = [str(part) for part in error.absolute_path]
    schema: Any = error.schema
    rule: Any = error.validator_value
    value: Any = error.instance
    about = _about(schema)
    match error.validator:
        case "additionalProperties":
            known = list(schema.get("properties", {}))
            unknown = next(key for key in value if key not in known)
            near = difflib.get_close_matches(unknown, known, n=1)
            allowed = f"unknown key{f', did you mean {near[0]}?' if near else ';'} "
            allowed += f"allowed are {', '.join(known)}"
            path, value = [*path, unknown], value[unknown]
        case "required":
            missing = next(key for key in rule if key not in value)
            path, value = [*path, missing], "(missing)"
            allowed = f"it must be given{_about(schema.get('properties', {}).get(missing, {}))}"
        case "type":
            kinds = [rule] if isinstance(rule, str) else rule
            allowed = f"it must be {' or '.join(TYPES[kind] for kind in kinds)}{about}"
        case "enum":
            allowed = f"allowed are {', '.join(rule)}"
        case "minimum":
            allowed = f"it must be at least {rule}{about}"
        case "maximum":
            allowed = f"it must be at most {rule}{about}"
        case "exclusiveMinimum":
            allowed = f"it must be above {rule}{about}"
        case "minItems" | "maxItems":
            bound = "at least" if error.validator == "minItems" else "at most"
            allowed = f"it must have {bound} {rule} entries{about}"
        case "uniqueItems":
            allowed = f"no entry may stand twice{about}"
        case "minProperties":
            allowed = f"it must have at least {rule} entries{about}"
        case "pattern":  # of a value, or of a name (propertyNames), which is then no part of path
            if "propertyNames" in error.absolute_schema_path:
                path = [*path, "name"]
            allowed = f"allowed are {schema.get('description', rule)}"
        case _:
            allowed = f"it must be {schema.get('description', error.message)}"
    scene, key = _scene_and_key(path)
    return _refusal(scene, key, value, allowed)


def _about(schema: dict[str, Any]) -> str:
    """What a field is, in brackets: its description up to the details, and its choices."""
    brief = re.split("[:;]", schema.get("description", ""))[0]
    choices = ", ".join(schema.get("enum", []))
    return f" ({brief}{': ' if brief and choices else ''}{choices})" if brief or choices else ""


def _scene_and_key(path: Sequence[str]) -> tuple[str | None, str]:
    """Split a path in the configuration into the scene, if it lies in one, and the key in it."""
    if len(path) > 2 and path[0] == "scenes":
        return path[1], ".".join(path[2:])
    return None, ".".join(path) or "configuration"


# --------------------------------------------------------------------- meaning and defaults


def _resolved_scene(name: str, settings: dict[str, Any]) -> dict[str, Any]:
    """Check one scene and fill in its defaults."""
    scene = {
        "section": "",
        "samplings": {},
        "acceleration": {},
        **settings,
        "error_interval": settings.get(
            "error_interval", settings["duration"] / DEFAULT_ERROR_SAMPLES
        ),
    }
    for key, largest in LARGEST_COUNTS.items():
        if scene["duration"] / scene[key] > largest:
            least = f"at least T/{largest:g} = {scene['duration'] / largest:g} is needed"
            raise _refusal(name, key, scene[key], least)
    try:
        physics = scenes.Scene.from_settings(name, scene)
        checks.check(physics)
    except ValueError as error:
        by_default = "error_interval" not in settings and "error_interval =" in str(error)
        hint = " (this is the default T/10000; another can be set)" if by_default else ""
        raise ConfigError(f"{error}{hint}") from error
    scene["references"] = _references(name, scene, physics)
    scene["samplings"] = {
        sampling: _resolved_sampling(name, sampling, scene, physics)
        for sampling in scene["samplings"]
    }
    for sampling, study in scene["acceleration"].items():
        key = f"acceleration.{sampling}"
        if not physics.is_even:
            raise _refusal(
                name, key, study, "CPU times are compared for evenly spaced particles only"
            )
        if sampling not in scene["samplings"]:
            raise _refusal(name, key, study, _known("sampling", scene["samplings"]))
        for count in study["mode_counts"]:
            _check_modes(name, sampling, scene, f"{key}.mode_counts", str(count))
    figures = scene["figures"] if "figures" in scene else list(_default_figures(scene))
    scene["figures"] = [
        _resolved_figure(name, scene, f"figures.{index}", figure)
        for index, figure in enumerate(figures)
    ]
    return scene


def _references(name: str, settings: dict[str, Any], physics: scenes.Scene) -> list[str]:
    asked = settings.get("references")
    if asked is not None and not {"exact", "modified"} & set(asked):
        return asked
    kind = exact.kind(physics)
    if asked is None:
        return ["centred" if kind is None else "exact"]
    possible = ["fd", "centred"]
    possible += ["exact"] if kind else []
    possible += ["modified"] if kind == "dalembert" else []
    for reference in asked:
        if reference not in possible:
            raise _refusal(
                name,
                "references",
                reference,
                f"no such solution of this scene is known; allowed are {', '.join(possible)}",
            )
    return asked


def _resolved_sampling(
    name: str, sampling: str, scene: dict[str, Any], physics: scenes.Scene
) -> dict[str, Any]:
    settings = scene["samplings"][sampling]
    key = f"samplings.{sampling}"
    step, duration = physics.time_step, physics.duration
    latest = duration * (1 + 1e-9)  # for times that are the last one but for rounding
    if "range" in settings:
        start, end = settings["range"]
        if not start < end <= latest:
            raise _refusal(
                name, f"{key}.range", [start, end], f"it must rise and end within T = {duration:g}"
            )
        first, last = (scenes.whole_steps(time, step) for time in (start, end))
        available = math.floor(last) - math.ceil(first)
        # Evenly spaced times may also round to the range's end, random ones never do.
        if settings["count"] > available + ("seed" not in settings):
            raise _refusal(
                name,
                f"{key}.count",
                settings["count"],
                f"the range holds {available} time steps of {step:g}, each for one snapshot",
            )
    else:
        for which in ("velocity_times", "density_times"):
            last = max(settings[which])
            if last > latest:
                raise _refusal(
                    name, f"{key}.{which}", last, f"it must lie within 0 and T = {duration:g}"
                )
    taken = snapshots.sampling_steps(physics, settings)
    for which, steps in zip(("velocity_times", "density_times"), taken, strict=True):
        twice = steps[1:][np.diff(steps) == 0]
        if twice.size:
            source = "count" if "count" in settings else which
            raise _refusal(
                name,
                f"{key}.{source}",
                settings[source],
                f"two snapshots fall on the time step at {twice[0] * step:g}; they must lie at "
                f"least one step of {step:g} apart",
            )
    modes = str(settings.get("mode_counts", usual_sweep(scene, sampling)))
    _check_modes(name, sampling, scene, f"{key}.mode_counts", modes)
    return {**settings, "mode_counts": modes}


def _check_modes(
    name: str, sampling: str, scene: Any, key: str, modes: str, translation: int = 0
) -> None:
    """Refuse more modes than there are snapshots, but for one of translation."""
    try:
        most = max(parse_modes(modes))
    except ValueError as error:
        raise _refusal(name, key, modes, f"{error} (sampling {sampling})") from None
    limit = min(mode_limit(scene, sampling) + translation, scene["particle_count"])
    if most > limit:
        raise _refusal(
            name,
            key,
            modes,
            f"more modes than the larger snapshot set of sampling {sampling} holds; "
            f"allowed are 1 to {limit}",
        )


def _default_figures(scene: dict[str, Any]) -> Iterator[dict[str, Any]]:
    yield {"kind": "profile"}
    for sampling in scene["samplings"]:
        yield {"kind": "modes", "sampling": sampling}
        yield {"kind": "error", "sampling": sampling}
        if sampling in scene["acceleration"]:
            yield {"kind": "acceleration", "sampling": sampling}


def _resolved_figure(name: str, scene: dict[str, Any], key: str, figure: Any) -> dict[str, Any]:
    kind = figure["kind"]
    allowed = ("kind", "name", "caption", *FIGURE_KEYS[kind])
    for given, value in figure.items():
        if given not in allowed:
            raise _refusal(
                name,
                f"{key}.{given}",
                value,
                f"a figure of kind {kind} has no such key; allowed are {', '.join(allowed)}",
            )
    for needed in set(FIGURE_KEYS[kind]) - {"fields", *figure}:
        raise _refusal(name, f"{key}.{needed}", "(missing)", f"a figure of kind {kind} needs it")
    sampling = figure.get("sampling")
    if sampling is not None:
        what = "acceleration" if kind == "acceleration" else "sampling"
        known = scene["acceleration" if kind == "acceleration" else "samplings"]
        if sampling not in known:
            raise _refusal(name, f"{key}.sampling", sampling, _known(what, known))
    if kind == "phase" and exact.kind(scenes.Scene.from_settings(name, scene)) != "dalembert":
        raise _refusal(
            name,
            f"{key}.kind",
            kind,
            "it shows the exact and the modified solution, known for uniform undamped scenes only",
        )
    if kind == "phase" and figure["position"] >= scene["domain_length"]:
        raise _refusal(
            name,
            f"{key}.position",
            figure["position"],
            f"it must be at least 0 and below L = {scene['domain_length']}",
        )
    if kind == "initial_spectrum" and not scenes.Scene.from_settings(name, scene).is_even:
        raise _refusal(
            name, f"{key}.kind", kind, "a spectrum is drawn of evenly spaced particles only"
        )
    of_what = name if sampling is None else f"{name}, snapshots {sampling}"
    defaults: dict[str, Any] = {"caption": f"{FIGURE_CAPTIONS[kind]}: {of_what}."}
    if kind == "profile":
        defaults["fields"] = list(DEFAULT_FIELDS)
    return defaults | figure


def _known(what: str, names: Iterable[str]) -> str:
    allowed = ", ".join(names)
    return f"the scene has no such {what}; {f'allowed are {allowed}' if allowed else 'it has none'}"


def _check_benchmark(config: dict[str, Any]) -> None:
    benchmark, scenes = config["benchmark"], config["scenes"]
    step_scene = benchmark.get("step_scene")
    if step_scene is None:
        return
    if step_scene not in scenes:
        known = ", ".join(scenes)
        raise _refusal(
            None, "benchmark.step_scene", step_scene, f"no such scene; allowed are {known}"
        )
    particles, most = scenes[step_scene]["particle_count"], max(benchmark["mode_counts"])
    if most >= particles:
        raise _refusal(
            None,
            "benchmark.mode_counts",
            most,
            f"it must be below the {particles} particles of {step_scene}",
        )


def _resolved_stability(settings: dict[str, Any], known: dict[str, Any]) -> dict[str, Any]:
    """Check what is asked of stability; studies are of the first sampled scene if none is named."""
    first = {name: next(iter(s["samplings"])) for name, s in known.items() if s["samplings"]}
    moving = {n: s for n, s in first.items() if _strains(_physics(n, known))}
    usual = dict(list(first.items())[:1])
    stability: dict[str, Any] = {
        **DEFAULT_STABILITY,
        **dict.fromkeys(STABILITY_STUDIES, usual),
        "amplitude": dict(list(moving.items())[:1]),
        **settings,
    }
    for study in STABILITY_STUDIES:
        for name, sampling in stability[study].items():
            key = f"stability.{study}"
            if name not in known:
                raise _refusal(None, key, name, f"no such scene; allowed are {', '.join(known)}")
            if sampling not in known[name]["samplings"]:
                allowed = _known("sampling", known[name]["samplings"])
                raise _refusal(None, f"{key}.{name}", sampling, allowed)
            if study == "amplitude" and not _strains(_physics(name, known)):
                allowed = "it must be a scene with an initial velocity that strains it when scaled"
                raise _refusal(None, key, name, allowed)
    for ratio in stability["smoothing_ratios"]:
        for name, scene in known.items():
            if 2 * neighbour_count(ratio) + 1 > scene["particle_count"]:
                raise _refusal(
                    None,
                    "stability.smoothing_ratios",
                    ratio,
                    f"the kernel's support of 4h would wrap round the domain of scene {name}, "
                    f"which has {scene['particle_count']} particles",
                )
    _check_runs(stability, known)
    stability["scenes"] = {
        name: _edge_scene(name, scene, known) for name, scene in stability["scenes"].items()
    }
    return stability


def _physics(name: str, known: Mapping[str, Any]) -> scenes.Scene:
    return scenes.Scene.from_settings(name, known[name])


def _strains(scene: scenes.Scene) -> bool:
    """Whether the initial velocity, scaled by up to 1e12, can fold the line."""
    velocity, damping = scene.velocity0(), scene.damping_values()
    slowed_apart = damping.size and damping.min() < damping.max() and np.any(velocity)
    reach = 1e12 * scene.duration * np.abs(scene.derivative(velocity)).max()
    return bool(slowed_apart or reach > 1)


def _check_runs(stability: Mapping[str, Any], known: Mapping[str, Any]) -> None:
    """Check the runs that show a model that grows, and that 1.04 is among the smoothing ratios."""
    for study in ("random_run", "long_run"):
        if study not in stability:
            continue
        run = stability[study]
        for key, value, names in (
            ("scene", run["scene"], known),
            ("sampling", run.get("sampling"), known.get(run["scene"], {}).get("samplings", {})),
        ):
            if value is not None and value not in names:
                raise _refusal(
                    None, f"stability.{study}.{key}", value, f"allowed are {', '.join(names)}"
                )
        scene = _physics(run["scene"], known)
        if not scene.is_conservative:
            allowed = "it must be a scene without damping and force"
            raise _refusal(None, f"stability.{study}.scene", run["scene"], allowed)
        if study == "long_run" and not np.any(scene.velocity0()):
            allowed = "it must be a scene with an initial velocity"
            raise _refusal(None, f"stability.{study}.scene", run["scene"], allowed)
        if study == "random_run" and not np.ptp(scene.density0()) + np.ptp(scene.modulus()):
            allowed = "its density or modulus must vary, or no model of random modes grows"
            raise _refusal(None, f"stability.{study}.scene", run["scene"], allowed)
    if "mode_count" in stability.get("long_run", {}):
        run = stability["long_run"]
        _check_modes(
            run["scene"],
            run["sampling"],
            known[run["scene"]],
            "stability.long_run.mode_count",
            str(run["mode_count"]),
        )
    if 1.04 not in stability["smoothing_ratios"]:
        raise _refusal(
            None,
            "stability.smoothing_ratios",
            stability["smoothing_ratios"],
            "1.04 must be among them, by whose time step those of the others are given",
        )


def _edge_scene(name: str, settings: dict[str, Any], others: Mapping[str, Any]) -> dict[str, Any]:
    """A scene at the edge, which explicit Euler need not be able to step."""
    key = f"stability.scenes.{name}"
    if name in others:
        raise _refusal(None, key, "...", "this name is taken by a scene; every one needs its own")
    for given, value in settings.items():
        if given not in scenes.PHYSICS_KEYS:
            allowed = ", ".join(scenes.PHYSICS_KEYS)
            raise _refusal(None, f"{key}.{given}", value, f"unknown here; allowed are {allowed}")
    scene = {"error_interval": settings["duration"] / DEFAULT_ERROR_SAMPLES, **settings}
    try:
        checks.check_setting(scenes.Scene.from_settings(name, scene))
    except ValueError as error:
        raise ConfigError(str(error)) from error
    return scene


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
            raise _refusal(
                scene,
                f"{key}.name",
                name,
                f"this name is taken by {seen[name.lower()]}; every figure needs its own",
            )
        seen[name.lower()] = f"scene {scene}, {key}" if scene else key
