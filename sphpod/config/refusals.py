"""What the models of the configuration refuse, in one sentence."""

import difflib
import re
from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import ValidationError

from sphpod.config.fields import NAMES
from sphpod.config.reading import ConfigError, refusal, scene_and_key, typed

KINDS = {
    "object": "keys and values",
    "array": "a list",
    "string": "text",
    "number": "a number",
    "integer": "a whole number",
}
"""What values may be, by their type in a JSON schema."""

LIMITS = {
    "greater_than": ("exclusiveMinimum", "be above {}"),
    "greater_than_equal": ("minimum", "be at least {}"),
    "less_than_equal": ("maximum", "be at most {}"),
}
"""Of each fault, the keyword that limits a number, and the words of the limit."""

Node = Mapping[str, Any]
Sentence = tuple[int, list[Any], Any, str]
"""Rank, path, value, and what is allowed."""


def of_models(
    error: ValidationError, settings: Any, schema: Node, within: Sequence[Any] = ()
) -> ConfigError:
    """The sentence about the first fault that validation found.

    Parameters
    ----------
    error : pydantic.ValidationError
    settings : all settings
    schema : their JSON schema
    within : path of what was validated
    """
    faults = error.errors(include_url=False, include_context=False, include_input=False)
    found = [_sentence(schema, settings, [*within, *f["loc"]], f["type"]) for f in faults]
    # A misspelt key is also a missing one: speak of the misspelling.
    _, path, value, allowed = min(found, key=lambda one: (one[0], [str(part) for part in one[1]]))
    return refusal(*scene_and_key([str(part) for part in path]), value, allowed)


def _sentence(schema, settings, place, kind) -> Sentence:
    path, value = _walk(settings, place)
    if place[-1] == "[key]":
        (pattern,) = node_at(schema, path[:-1])["patternProperties"]
        return 0, [*path[:-1], "name"], path[-1], f"allowed are {NAMES[pattern]}"
    node = node_at(schema, path)
    if kind == "extra_forbidden":
        return _unknown(schema, settings, path)
    if kind == "missing":
        return _missing(node, path, place[-1], value)
    if kind.startswith("union_tag") and "discriminator" in node:
        return _untagged(schema, settings, node, path, value)
    if kind == "literal_error":
        if not choices(node):
            return 1, path, value, f"it must be {node['description'].partition(';')[0]}"
        return 1, path, value, f"allowed are {', '.join(choices(node))}"
    if kind == "string_pattern_mismatch":
        return 1, path, value, f"allowed are {NAMES.get(node['pattern'], node['description'])}"
    if kind == "string_too_long":
        return 1, path, value, f"it must have at most {node['maxLength']} letters"
    if kind == "unique_items":
        return 1, path, value, f"no entry may stand twice{_about(node)}"
    allowed = f"it must {_limit(kind, node, value)}{_about(node)}"
    # What is text only because it stands in quotes is shown in them.
    quoted = isinstance(value, str) and not isinstance(typed(value), str)
    return 1, path, f"'{value}'" if quoted else value, allowed


def _walk(settings, place):
    """Path in the settings without the tags of branches that are in the place, and its value."""
    path, value = [], settings
    for part in place:
        if part in value if isinstance(value, dict) else isinstance(part, int):
            path.append(part)
            value = value[part]
    return path, value


def _unknown(schema, settings, path):
    """A key that is not there; or not in this branch, but in another."""
    parent, (_, above) = node_at(schema, path[:-1]), _walk(settings, path[:-1])
    known, key = keys_of(parent), path[-1]
    value = above[key]
    if key not in known:
        near = difflib.get_close_matches(key, known, n=1)
        meant = f", did you mean {near[0]}?" if near else ";"
        return 0, path, value, f"unknown key{meant} allowed are {', '.join(known)}"
    if "discriminator" in parent:
        what = f"a {_kind_of(path)} of kind {above['kind']} has no such key"
        return 1, path, value, f"{what}; allowed are {', '.join(keys_of(parent, above))}"
    return 3, path[:-1], above, f"it must be {parent['description']}"


def _missing(parent, path, key, above):
    if "discriminator" in parent:
        return 2, [*path, key], "(missing)", f"a {_kind_of(path)} of kind {above['kind']} needs it"
    if sum("properties" in branch for branch in branches(parent)) > 1:
        return 3, path, above, f"it must be {parent['description']}"
    return 2, [*path, key], "(missing)", f"it must be given{_about(_below(parent, key))}"


def _kind_of(path):
    """What has a kind at a path."""
    return "quantity" if "quantities" in path else "figure"


def _untagged(schema, settings, node, path, value):
    """A figure of no kind, or of one that there is not."""
    tag = node["discriminator"]["propertyName"]
    unknown = [key for key in value if key not in keys_of(node)]
    if tag not in value and unknown:
        return _unknown(schema, settings, [*path, unknown[0]])
    kinds = ", ".join(_below(branch, tag)["const"] for branch in branches(node))
    if tag in value:
        return 1, [*path, tag], value[tag], f"allowed are {kinds}"
    brief = _about(_below(node, tag)).partition(":")[0]
    return 2, [*path, tag], "(missing)", f"it must be given{brief}: {kinds})"


def _limit(kind, node, value):
    """What a value must be, after "it must"."""
    limits = {key: limit for branch in branches(node) for key, limit in branch.items()}
    if kind == "int_type" and isinstance(value, float) and value.is_integer():
        # Beyond 2⁵³ a whole number may be written so, and is too large.
        return f"be at most {limits.get('maximum', 2**53)}"
    if kind in LIMITS:
        keyword, words = LIMITS[kind]
        return words.format(limits[keyword])
    if kind in ("too_short", "too_long"):
        bound, words = ("min", "at least") if kind == "too_short" else ("max", "at most")
        of = "Properties" if isinstance(value, dict) else "Items"
        many = limits[bound + of]
        return f"have {words} {many} {'entry' if many == 1 else 'entries'}"
    return f"be {' or '.join(KINDS[one] for one in _kinds(node))}"


# --- The JSON schema, with its references written out ---------------------------------------------


def written_out(schema: Node) -> dict[str, Any]:
    """A JSON schema with what its references refer to in their place."""

    def out(node):
        if isinstance(node, list):
            return [out(item) for item in node]
        if not isinstance(node, dict):
            return node
        own = {key: out(item) for key, item in node.items() if key not in ("$ref", "$defs")}
        if "$ref" in node:
            return out(schema["$defs"][node["$ref"].rpartition("/")[2]]) | own
        return own

    return out(schema)


def branches(node: Node) -> list[Node]:
    """What a value may be one of."""
    inner = [branch for key in ("anyOf", "oneOf") for branch in node.get(key, ())]
    return [leaf for branch in inner for leaf in branches(branch)] or [node]


def keys_of(node: Node, settings: Mapping[str, Any] | None = None) -> dict[str, Node]:
    """Keys of a section: of all kinds of it, what they need first, or of that of some settings."""
    kinds = branches(node)
    if settings is not None and "discriminator" in node:
        tag = node["discriminator"]["propertyName"]
        kinds = [kind for kind in kinds if kind["properties"][tag]["const"] == settings[tag]]
    kinds = [kind for kind in kinds if "properties" in kind]
    needed = [key for kind in kinds[1:] and kinds for key in kind["required"]]
    every = {key: item for kind in kinds for key, item in kind["properties"].items()}
    return {key: every[key] for key in dict.fromkeys([*needed, *every])}


def _below(node, part):
    """What an entry or key may be."""
    for branch in branches(node):
        if isinstance(part, int) and "items" in branch:
            return branch["items"]
        if part in branch.get("properties", ()):
            return branch["properties"][part]
        for inner in (
            *branch.get("patternProperties", {}).values(), branch.get("additionalProperties"),
        ):  # fmt: skip
            if isinstance(inner, dict):
                return inner
    return {}


def node_at(schema: Node, path: Sequence[Any]) -> Node:
    """What the value at a path may be."""
    for part in path:
        schema = _below(schema, part)
    return schema


def choices(node: Node) -> list[Any]:
    """The only values there are, if they are a few."""
    return [node["const"]] if "const" in node else node.get("enum", [])


def _kinds(node) -> list[str]:
    return list(dict.fromkeys(b["type"] for b in branches(node) if "type" in b))


def _about(node: Node) -> str:
    """What a field is, in brackets: its description up to the details, and its choices."""
    brief = re.split("[:;]", node.get("description", ""))[0]
    among = ", ".join(choices(node))
    return f" ({brief}{': ' if brief and among else ''}{among})" if brief or among else ""
