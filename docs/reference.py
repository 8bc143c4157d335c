"""Write docs/reference.md: what studies declare, and the keys of the configuration.

make reference
"""

from importlib import import_module
from pathlib import Path

import yaml

from sphpod.config.config import SCHEMA, with_studies
from sphpod.studies.study import studies

HEAD = """# Reference

Made by `make reference` from what studies declare (`sphpod/studies/`) and the schema of the
configuration; a test keeps it in step. Files are in `results`. Names and units of other files are
in [notation.md](notation.md), keys of scenes and samplings with examples in
[adding-a-scene.md](adding-a-scene.md).
"""


def table(head, rows):
    cells = [[str(cell).replace("|", "\\|") for cell in row] for row in [head, *rows]]
    lines = [f"| {' | '.join(row)} |" for row in cells]
    return "\n".join([lines[0], "|" + "---|" * len(head), *lines[1:]])


def place(data):
    parts = ["{scene}", *["{sampling}"] * data.of_sampling]
    return "/".join(parts)


def of_study(word, study):
    summary = import_module(f"sphpod.studies.{word}").__doc__.partition("\n")[0]
    files = [
        (
            f"`{place(data)}/{name}{'/k{modes}' if data.of_modes else ''}.nc`",
            data.message.replace("{scene}: ", ""),
            f"`{name}`",
        )
        for name, data in study.datasets.items()
    ]
    files += [(f"`{name}.csv`", "the same in a table", "`table`") for name in study.tables]
    if study.drawing:
        each = "_{scene}_{sampling}" if study.drawing.places else ""
        caption = study.drawing.caption.replace(": {scene}, snapshots {sampling}", "")
        files.append(
            (
                f"`../figures/stability_{word.removeprefix('stability_')}{each}.pdf`",
                caption,
                "`figure`",
            )
        )
    variables = [
        (f"`{name}`", f"({', '.join(meaning.dims)})", meaning.units, meaning.long_name)
        for name, meaning in study.variables.items()
    ]
    parts = [f"### {word}", summary, table(("File", "What it holds", "Rule"), files)]
    if variables:
        parts.append(table(("Variable", "Dimensions", "Unit", "Meaning"), variables))
    return "\n\n".join(parts)


def allowed(schema, definitions):
    """What the value of a key may be, in short."""
    schema = definitions[schema["$ref"].rpartition("/")[2]] | schema if "$ref" in schema else schema
    kinds = schema.get("type", "")
    words = " or ".join([kinds] if isinstance(kinds, str) else kinds)
    if "enum" in schema:
        words = ", ".join(map(str, schema["enum"]))
    for key, sign in (("minimum", "≥"), ("exclusiveMinimum", ">"), ("maximum", "≤")):
        if key in schema:
            words += f" {sign} {schema[key]}"
    return words


def of_section(title, schema, definitions):
    rows = [
        (f"`{key}`", allowed(value, definitions), value.get("description", ""))
        for key, value in schema.get("properties", {}).items()
    ]
    return f"### {title}\n\n{table(('Key', 'Value', 'Meaning'), rows)}"


def reference():
    """The page, as text."""
    schema = with_studies(yaml.safe_load(SCHEMA.read_text(encoding="utf-8")))
    definitions = schema["$defs"]
    keys = schema["properties"]
    sections = [
        ("At the top", schema),
        ("`scenes.{name}`", definitions["scene"]),
        ("`scenes.{name}.samplings.{name}`", definitions["sampling"]),
        ("`scenes.{name}.acceleration.{sampling}`", definitions["acceleration"]),
        ("`scenes.{name}.figures`, each", definitions["figure"]),
        ("`illustrations`, each", definitions["illustration"]),
        ("`benchmark`", keys["benchmark"]),
        ("`stability`", keys["stability"]),
        *((f"`studies.{word}`", study) for word, study in keys["studies"]["properties"].items()),
    ]
    parts = [HEAD.rstrip(), "## Studies"]
    parts += [of_study(word, study) for word, study in studies().items()]
    parts += ["## Keys of the configuration"]
    parts += [of_section(title, section, definitions) for title, section in sections]
    return "\n\n".join(parts) + "\n"


if __name__ == "__main__":
    Path(__file__).with_suffix(".md").write_text(reference(), encoding="utf-8")
