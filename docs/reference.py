"""Write docs/reference.md: what studies declare, and the keys of the configuration.

make reference
"""

from importlib import import_module
from pathlib import Path

from sphpod.config import refusals
from sphpod.config.configuration import schema, study_sections
from sphpod.studies.study import figure_parts, studies

HEAD = """# Reference

Made by `make reference` from what studies declare (`sphpod/studies/`) and the models of the
configuration (`sphpod/config/`); a test keeps it in step. Files are in `results`. Names and units
of other files are in [notation.md](notation.md), keys of scenes and samplings with examples in
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
            (f"`../figures/{'_'.join(figure_parts(word, study))}{each}.pdf`", caption, "`figure`")
        )
    variables = [
        (f"`{name}`", f"({', '.join(meaning.dims)})", meaning.units, meaning.long_name)
        for name, meaning in study.variables.items()
    ]
    parts = [
        f"### {word}",
        f"{summary} Target `{study.target}`.",
        table(("File", "What it holds", "Rule"), files),
    ]
    if variables:
        parts.append(table(("Variable", "Dimensions", "Unit", "Meaning"), variables))
    return "\n\n".join(parts)


def allowed(key):
    """What the value of a key may be, in short."""
    kinds = [one["type"] for one in refusals.branches(key) if "type" in one]
    words = " or ".join(dict.fromkeys(kinds))
    if choices := refusals.choices(key):
        words = ", ".join(map(str, choices))
    for limit, sign in (("minimum", "≥"), ("exclusiveMinimum", ">"), ("maximum", "≤")):
        if limit in key:
            words += f" {sign} {key[limit]}"
    return words


def of_section(title, section):
    rows = []
    for key, value in refusals.keys_of(section).items():
        default = "" if value.get("default", "") in ("", [], {}) else f"`{value['default']}`"
        rows.append((f"`{key}`", allowed(value), value.get("description", ""), default))
    return f"### {title}\n\n{table(('Key', 'Value', 'Meaning', 'Default'), rows)}"


def reference():
    """The page, as text."""
    keys = refusals.written_out(schema())
    places = [
        ("At the top", ()),
        ("`scenes.{name}`", ("scenes", "")),
        ("`scenes.{name}.force`", ("scenes", "", "force")),
        ("`scenes.{name}.positions`", ("scenes", "", "positions")),
        ("`scenes.{name}.samplings.{name}`", ("scenes", "", "samplings", "")),
        ("`scenes.{name}.acceleration.{sampling}`", ("scenes", "", "acceleration", "")),
        ("`scenes.{name}.figures`, each", ("scenes", "", "figures", 0)),
        ("`illustrations`, each", ("illustrations", 0)),
        ("`benchmark`", ("benchmark",)),
        ("`stability`", ("stability",)),
        ("`claims`, each", ("claims", 0)),
        *((f"`studies.{word}`", ("studies", word)) for word in study_sections()),
    ]
    parts = [HEAD.rstrip(), "## Studies"]
    parts += [of_study(word, study) for word, study in studies().items()]
    parts += ["## Keys of the configuration"]
    parts += [of_section(title, refusals.node_at(keys, path)) for title, path in places]
    return "\n\n".join(parts) + "\n"


if __name__ == "__main__":
    Path(__file__).with_suffix(".md").write_text(reference(), encoding="utf-8")
