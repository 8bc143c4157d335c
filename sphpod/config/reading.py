"""Strict YAML, and the one sentence of a refusal."""

import math
import re
from collections.abc import Mapping, Sequence
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
import yaml

try:
    from yaml import CSafeLoader as SafeLoader  # ten times as fast
except ImportError:
    from yaml import SafeLoader  # type: ignore[assignment]


LARGEST_FILE = 1_000_000
"""Bytes of a file that is read."""

DEEPEST = 50
"""How deep a file may be nested."""

MOST_ENTRIES = 200_000
"""Keys and values of a file, its aliases written out."""


MARKS = {"UTF-32": (b"\xff\xfe\0\0", b"\0\0\xfe\xff"), "UTF-16": (b"\xff\xfe", b"\xfe\xff")}
"""What files in other encodings begin with."""


class ConfigError(ValueError):
    """A configuration, or a target asked for, that is not allowed; the message is one sentence."""


def refusal(scene: str | None, key: str, value: Any, allowed: str) -> ConfigError:
    """The error that names scene (if it lies in one), key, value and what is allowed."""
    where = f"scene {shown(scene)}: " if scene else ""
    return ConfigError(f"{where}{shown(key)} = {shown(value)}: {allowed}")


def shown(value: Any) -> str:
    """A value as in YAML, on one line and not too long."""
    if value is None:
        return "(empty)"
    if isinstance(value, str):
        text = " ".join(value.split()) or repr(value)
    else:
        try:
            text = yaml.safe_dump(value, default_flow_style=True, width=math.inf, sort_keys=False)
        except yaml.YAMLError:  # a value that Python has and YAML has not
            text = repr(value)
        text = text.removesuffix("\n").removesuffix("\n...").strip()
    return text if len(text) <= 100 else text[:97] + "..."


def counted(count: int, noun: str, rest: str = "") -> str:
    """So many of something, in words."""
    return f"{count} {noun}{'s' * (count != 1)}{rest}"


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
    ("int", r"[-+]?(0|[1-9][0-9]*)", list("-+0123456789")),
    ("float", r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?", list("-+.0123456789")),
    ("merge", r"<<", ["<"]),
):
    _StrictLoader.add_implicit_resolver(
        f"tag:yaml.org,2002:{_tag}", re.compile(rf"(?:{_pattern})\Z"), _first
    )


def read_yaml(path: Path | str) -> dict[str, Any]:
    """Read a YAML file that holds a mapping, in which no key stands twice.

    Raises
    ------
    ConfigError
        The file cannot be read, is not YAML, is too large or nested too deeply, or holds a key
        twice; with the line.
    """
    try:
        if Path(path).is_file() and (size := Path(path).stat().st_size) > LARGEST_FILE:
            raise ConfigError(
                f"{path} holds {size / 1e6:.3g} MB; at most {LARGEST_FILE / 1e6:g} MB are read"
            )
        text = _decoded(Path(path).read_bytes(), path)
        _check_size(text, path)
        loader = _StrictLoader(text)
        try:
            node = loader.get_single_node()
            _check_commas(node, text, path)
            _check_keys(node, str(path))
            content = loader.construct_document(node) if node else {}
        finally:
            loader.dispose()
    except OSError as error:
        raise ConfigError(f"{path} cannot be read ({error.strerror})") from error
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        character = f"a control character, #x{error.character:02x}"
        raise ConfigError(f"{path}, line {line}: this is not YAML ({character})") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        problem = getattr(error, "problem", None) or str(error)
        at = "\n".join(text.split("\n")[mark.line :])[mark.column :] if mark else ""
        if at.startswith("\t"):
            problem = "a tab where only spaces may be"
        raise _not_yaml(path, mark, problem) from error
    if not isinstance(content, dict):
        raise ConfigError(f"{path} holds {shown(content)} where keys and values are needed")
    return content


def _not_yaml(path, mark, problem):
    line = f", line {mark.line + 1}" if mark else ""
    return ConfigError(f"{path}{line}: this is not YAML ({' '.join(problem.split())})")


def _decoded(content, path):
    """The text of a file, without the mark that some editors begin UTF-8 with."""
    for name, marks in MARKS.items():
        if content.startswith(marks):
            raise ConfigError(f"{path}, line 1: this is {name}; UTF-8 is needed")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        byte = content[error.start]
        raise ConfigError(
            f"{path}, line {line}: the byte 0x{byte:02x} is not UTF-8, which is needed"
        ) from None


def _check_size(text, path):
    """Refuse what would grow without end, or be nested without end, before it is built."""
    sizes: dict[str, int] = {}
    within: list[tuple[str | None, int]] = []
    size = 0
    event: Any
    for event in yaml.parse(text, Loader=_StrictLoader):
        mark = event.start_mark
        if getattr(event, "tag", None) and not isinstance(event, yaml.DocumentStartEvent):
            tag = event.tag.replace("tag:yaml.org,2002:", "!!")
            raise _not_yaml(path, mark, f"tags such as {tag} are not known here")
        if isinstance(event, yaml.AliasEvent):
            if any(anchor == event.anchor for anchor, _ in within):
                raise _not_yaml(path, mark, f"*{event.anchor} refers to what it is part of")
            size += sizes.get(str(event.anchor), 1)
        elif isinstance(event, yaml.ScalarEvent):
            size += 1
            if event.anchor:
                sizes[event.anchor] = 1
        elif isinstance(event, yaml.CollectionStartEvent):
            within.append((event.anchor, size))
            size += 1
            if len(within) > DEEPEST:
                raise _not_yaml(path, mark, f"nested more than {DEEPEST} deep")
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = within.pop()
            if anchor:
                sizes[anchor] = size - before
        if size > MOST_ENTRIES:
            raise _not_yaml(path, mark, f"with its aliases it has more than {MOST_ENTRIES} entries")


def _check_commas(node, text, path):
    """Refuse an entry of [a, b] or {a: b} that a comma ends within brackets of its own."""
    if isinstance(node, yaml.ScalarNode) or node is None:
        return
    mapping = isinstance(node, yaml.MappingNode)
    entries = [part for pair in node.value for part in pair] if mapping else node.value
    for number, entry in enumerate(entries):
        if node.flow_style and _left_open(entry) > 0:
            depths = accumulate(map(_left_open, entries[number:]))
            closed = next((n for n, depth in enumerate(depths, number) if depth <= 0), None)
            if closed is not None:
                whole = shown(text[entry.start_mark.index : entries[closed].end_mark.index])
                raise ConfigError(
                    f"{path}, line {entry.start_mark.line + 1}: {shown(entry.value)} ends at a "
                    f"comma within its brackets; in quotes, '{whole}', it is one entry"
                )
        _check_commas(entry, text, path)


def _left_open(node):
    """How many brackets a scalar without quotes leaves open; below zero, closes too many."""
    if not isinstance(node, yaml.ScalarNode) or node.style in ("'", '"'):
        return 0
    return node.value.count("(") - node.value.count(")")


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
            if key_node.tag.endswith(":merge"):
                continue
            if not key_node.tag.endswith(":str"):
                scalar = isinstance(key_node, yaml.ScalarNode)
                name = shown(key_node.value) if scalar else "of several entries"
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


def typed(value: Any) -> Any:
    """Settings of a command line, in which Snakemake takes all that lies deeper for text."""
    if isinstance(value, Mapping):
        return {key: typed(item) for key, item in value.items()}
    if isinstance(value, list):
        return [typed(item) for item in value]
    if isinstance(value, str) and value:
        tag = _StrictLoader("").resolve(yaml.ScalarNode, value, (True, False))
        if tag.endswith((":bool", ":int", ":float")):
            return yaml.load(value, _StrictLoader)
    return value


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
