"""Strict YAML, and the one sentence of a refusal."""

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

try:
    from yaml import CSafeLoader as SafeLoader  # ten times as fast
except ImportError:
    from yaml import SafeLoader  # type: ignore[assignment]


class ConfigError(ValueError):
    """A configuration, or a target asked for, that is not allowed; the message is one sentence."""


def refusal(scene: str | None, key: str, value: Any, allowed: str) -> ConfigError:
    """The error that names scene (if it lies in one), key, value and what is allowed."""
    return ConfigError(f"{f'scene {scene}: ' if scene else ''}{key} = {shown(value)}: {allowed}")


def shown(value: Any) -> str:
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


def scene_and_key(path: Sequence[str]) -> tuple[str | None, str]:
    """Split a path in the configuration into the scene, if it lies in one, and the key in it."""
    if len(path) > 2 and path[0] == "scenes":
        return path[1], ".".join(path[2:])
    return None, ".".join(path) or "configuration"


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
        raise ConfigError(f"{path} holds {shown(content)} where keys and values are needed")
    return content


def _check_keys(node: yaml.Node | None, source: str, path: tuple[str, ...] = ()) -> None:
    """Refuse a key that is not text or stands twice, and a number that is not finite."""
    if isinstance(node, yaml.SequenceNode):
        for index, item in enumerate(node.value):
            _check_keys(item, source, (*path, str(index)))
    elif isinstance(node, yaml.ScalarNode):
        if node.tag.endswith((":float", ":int")) and not math.isfinite(float(node.value)):
            raise refusal(*scene_and_key(path), node.value, "the number is too large")
    elif isinstance(node, yaml.MappingNode):
        seen = set()
        for key_node, value in node.value:
            line = key_node.start_mark.line + 1
            if not key_node.tag.endswith(":str"):
                name = shown(key_node.value)
                raise ConfigError(f"{source}, line {line}: the key {name} is not text")
            name = key_node.value
            if name in seen:
                raise refusal(
                    *scene_and_key((*path, name)),
                    value.value if isinstance(value, yaml.ScalarNode) else "...",
                    f"the key stands twice ({source}, line {line}); once is allowed",
                )
            seen.add(name)
            _check_keys(value, source, (*path, name))


def plain(value: Any) -> Any:
    """A copy that shares nothing, with whole numbers as int however they were written."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | range):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, float) and value.is_integer() and abs(value) < 2**53:
        return int(value)
    return value


def merged(old: Any, new: Any) -> Any:
    """Mappings joined key by key; anything else is replaced."""
    if isinstance(old, dict) and isinstance(new, dict):
        return old | {key: merged(old.get(key), item) for key, item in new.items()}
    return new
