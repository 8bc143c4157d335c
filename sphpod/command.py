"""The command ``sphpod``: look through a configuration before anything runs.

sphpod check config/mine.yaml      what is wrong with it, or what it asks for
sphpod schema                      the JSON schema of configurations, for editors
"""

import argparse
import json
import sys
from collections.abc import Sequence
from typing import Any

from sphpod.config import config, sizes
from sphpod.config.configuration import schema
from sphpod.config.reading import ConfigError, counted
from sphpod.paper import claims
from sphpod.scene.scene import Scene
from sphpod.surveys import samples

COLUMNS = "scene", "particles", "time steps", "outputs", "full SPH [s]", "memory [GB]", "disk [MB]"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; 0, or 1 if a configuration is refused.

    Parameters
    ----------
    arguments : words behind ``sphpod``; those of the command line if not given
    """
    parser = argparse.ArgumentParser("sphpod", description="Look at configurations.")
    commands = parser.add_subparsers(dest="command", required=True)
    check = commands.add_parser(
        "check", help="say what is wrong with a configuration, or what it asks for"
    )
    check.add_argument("file", nargs="+", help="YAML; where several set one key, the last wins")
    commands.add_parser("schema", help="write the JSON schema of configurations")
    given = parser.parse_args(arguments)
    if given.command == "schema":
        print(json.dumps(schema(), indent=1))
        return 0
    try:
        settings = config.load(given.file)
        claims.resolve(settings)
    except ConfigError as error:
        print(f"sphpod: {error}", file=sys.stderr)
        return 1
    print("\n".join(report(settings)))
    return 0


def report(settings: dict[str, Any]) -> list[str]:
    """What a resolved configuration asks for, how long full SPH takes, and how large it is.

    Returns
    -------
    list of str
        Lines of a table, and what they are together.
    """
    rows = [COLUMNS]
    total = 0.0
    for name, keys in settings["scenes"].items():
        scene = Scene.from_settings(name, keys)
        disk = sizes.disk(scene, 1 + len(keys["references"]))
        total += disk
        rows.append(
            (
                name,
                str(scene.bar_count),
                str(scene.step_count),
                str(sizes.output_count(scene)),
                f"{sizes.run_time(scene):.2g}",
                f"{max(size.memory for size in sizes.sizes(scene, keys)) / 1e9:.2g}",
                f"{disk / 1e6:.2g}",
            )
        )
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    table = ["  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)) for row in rows]
    scenes = settings["scenes"].values()
    for survey in settings["surveys"].values():
        keys = settings["scenes"][survey["scene"]]
        queries = samples.count(keys["parameters"], survey["queries"])
        outputs = round(keys["duration"] / survey["output_interval"]) + 1
        total += sizes.answers(survey, len(keys["parameters"]), queries, outputs)
    counts = (
        (len(scenes), "scene"),
        (sum(len(scene["samplings"]) for scene in scenes), "sampling"),
        (sum(len(scene["acceleration"]) for scene in scenes), "comparison", " of CPU time"),
        (sum(len(s["figures"]) for s in scenes) + len(settings["illustrations"]), "figure"),
        (len(settings["claims"]), "claim"),
        (len(settings["surveys"]), "survey"),
    )
    asked = ", ".join(counted(count, *what) for count, *what in counts if count)
    where = settings["output"] or "this folder"
    return [
        *(line.rstrip() for line in table),
        f"{asked}; solutions take about {total / 1e6:.2g} MB in {where}; nothing is wrong.",
    ]
