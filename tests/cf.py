"""Files against the CF conventions, by a checker in an environment of its own, .venv-cf."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

CHECKER = shutil.which(
    "compliance-checker", path=f"{Path(__file__).parents[1] / '.venv-cf/bin'}:{os.environ['PATH']}"
)
needed = pytest.mark.skipif(not CHECKER, reason="there is no compliance-checker: make cf")


def one_of_every_kind(folder):
    """Files of a build, by kind: their name, or that of their folder where they are numbered."""
    found = {}
    for path in sorted(folder.rglob("*.nc")):
        numbered = re.fullmatch(r"k?\d+([-+]\d+)?", path.stem)
        found[f"{path.parent.name}/" if numbered else path.name] = path
    return found


def check(folder):
    kinds = one_of_every_kind(folder)
    assert CHECKER
    program = [CHECKER, "--test=cf:1.11", "--criteria=strict"]
    run = subprocess.run([*program, *kinds.values()], capture_output=True, text=True, check=False)
    assert run.stdout.count("All tests passed!") == len(kinds), run.stdout + run.stderr
    return set(kinds)
