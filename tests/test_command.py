"""The command ``sphpod`` says what is wrong with a configuration, or what it asks for."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from sphpod import command
from sphpod.config.configuration import schema

ROOT = Path(__file__).parents[1]


def test_what_is_not_wrong_is_summed_up(capsys):
    assert command.main(["check", str(ROOT / "config/small.yaml")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split("  ")[0] == "scene"
    assert {line.split()[0] for line in lines[1:-1]} == {
        "waves", "damped_forced", "two_moduli", "graded",
    }  # fmt: skip
    assert lines[-1].startswith("4 scenes, 3 samplings, 1 comparison of CPU time, 10 figures")
    assert lines[-1].endswith("in small; nothing is wrong.")


@pytest.mark.parametrize(
    ("content", "answer"),
    [
        ("scenes:\n\twave: 1", "mine.yaml, line 2: this is not YAML (a tab"),
        ("scenes: {wave: {duration: x}}", "scene wave: duration = x: it must be a number"),
        ("", "scenes = (missing): it must be given"),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(tmp_path, capsys, content, answer):
    path = tmp_path / "mine.yaml"
    path.write_text(content)
    assert command.main(["check", str(path)]) == 1
    said = capsys.readouterr()
    assert said.out == ""
    (line,) = said.err.splitlines()
    assert line.startswith("sphpod: ")
    assert answer in line


def test_editors_get_the_schema(capsys):
    assert command.main(["schema"]) == 0
    assert json.loads(capsys.readouterr().out) == schema()


@pytest.mark.slow
def test_it_is_a_command_of_the_package():
    run = subprocess.run(
        [sys.executable, "-m", "sphpod", "check", "config/nothing.yaml"],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert run.returncode == 1
    assert run.stderr == "sphpod: config/nothing.yaml cannot be read (No such file or directory)\n"
