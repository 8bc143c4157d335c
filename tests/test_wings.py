"""Imports run one way, from a wing of the package to those below it."""

import ast
import re
from pathlib import Path
from typing import Any

import pytest

import sphpod

PACKAGE = Path(sphpod.__file__).parent
WINGS = (
    {"numerics", "pipeline"},
    {"scene", "figures"},
    {"full"},
    {"reference"},
    {"reduced"},
    {"stability", "surveys"},
    {"studies"},
    {"config"},
    {"paper"},
)
"""Wings from the ground up; those beside one another do not import each other."""


def imported(path):
    """Modules of the package that a file imports, wherever in it, as their parts below sphpod."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        for name in names:
            package, *parts = name.split(".")
            if package == "sphpod" and parts:
                yield parts


def modules():
    return sorted(path for path in PACKAGE.glob("*/*.py") if path.stem != "__init__")


def dependencies(path):
    """Modules that a module imports, as wing and name."""
    return {tuple(p[:2]) for p in imported(path) if len(p) > 1}


def test_every_folder_is_a_wing():
    folders = {path.parent.name for path in modules()}
    assert folders == set().union(*WINGS)


@pytest.mark.parametrize("path", modules(), ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_no_import_runs_upward_or_sideways(path):
    level = next(n for n, wings in enumerate(WINGS) if path.parent.name in wings)
    allowed = set().union(*WINGS[:level]) | {path.parent.name, "__version__"}
    assert {parts[0] for parts in imported(path)} <= allowed


def test_no_circle():
    graph = {(path.parent.name, path.stem): dependencies(path) for path in modules()}
    done = set()

    def visit(module, above):
        assert module not in above, " -> ".join("/".join(m) for m in (*above, module))
        if module in graph and module not in done:
            for other in graph[module]:
                visit(other, (*above, module))
            done.add(module)

    for module in graph:
        visit(module, ())


def test_wings_hold_no_code():
    for path in PACKAGE.glob("*/__init__.py"):
        (docstring,) = ast.parse(path.read_text(encoding="utf-8")).body
        assert isinstance(docstring, ast.Expr)


def test_tests_mirror_the_wings():
    tests = Path(__file__).parent
    for path in modules():
        for test in tests.rglob(f"test_{path.stem}.py"):
            assert test.parent.name == path.parent.name


LONGEST_MODULE, LONGEST_FUNCTION, MOST_ARGUMENTS = 500, 60, 7


@pytest.mark.parametrize("path", modules(), ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_what_is_long_says_why(path):
    """In its docstring, in a sentence that begins with Long or Longer."""
    source = path.read_text(encoding="utf-8")
    tree = ast.parse(source)
    long: list[Any] = [tree] if source.count("\n") > LONGEST_MODULE else []
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            documented = isinstance(node.body[0], ast.Expr) and len(node.body) > 1
            first = node.body[1 if documented else 0]
            if (node.end_lineno or 0) - first.lineno >= LONGEST_FUNCTION:
                long.append(node)
            assert len(node.args.posonlyargs + node.args.args) <= MOST_ARGUMENTS, node.name
    for node in long:
        assert re.search(r"\bLong(er)?\b", ast.get_docstring(node) or ""), getattr(node, "name", "")
