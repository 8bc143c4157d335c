"""What runs when: everything by itself, and what is quick without ``workflow``."""

import shutil
from pathlib import Path

import pytest

pytest_plugins = "pytester"
ROOT = Path(__file__).parents[1]
TESTS = """
import pytest
from examples import examples
from hypothesis import given, strategies

drawn = []

def test_plain():
    pass

@examples(100)
@given(strategies.floats())
def test_property(value):
    drawn.append(value)

def test_how_many():
    assert len(drawn) == {count}

@pytest.mark.{mark}
def test_marked():
    pass
"""


@pytest.mark.slow
@pytest.mark.parametrize("mark", ["slow", "workflow"])
@pytest.mark.parametrize(("chosen", "left_out"), [([], 0), (["-m", "not workflow"], 1)])
def test_all_run_but_what_is_left_out_by_name(pytester, mark, chosen, left_out):
    folder = pytester.mkdir("tests")
    for name in ("conftest.py", "examples.py"):
        shutil.copy(ROOT / "tests" / name, folder)
    shutil.copy(ROOT / "pyproject.toml", pytester.path)
    text = TESTS.format(mark=mark, count=20 if left_out else 100)
    (folder / "test_one.py").write_text(text)
    found = pytester.runpytest_subprocess("-n", "0", *chosen)
    found.assert_outcomes(passed=4 - left_out, deselected=left_out)
