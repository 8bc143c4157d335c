"""Which code a result depends on: a digest of a script and all that it imports from this package.

A rule of the workflow keeps the digest of its script as a parameter. It changes with the code of
the script and of the modules that it imports, directly or not, and with the version of a library
that computes numbers, but not with a comment, a docstring, the layout of a line or the date of a
file; so exactly the results that an edit may have changed are made anew.
"""

import ast
import functools
import hashlib
import os
from collections.abc import Iterator
from importlib import metadata
from itertools import accumulate
from pathlib import Path

PACKAGE = Path(__file__).parents[1]

LIBRARIES = "numpy", "scipy", "numba"
"""Libraries whose version may change numbers."""


def digest(script: str | os.PathLike[str]) -> str:
    """Digest of a script, of all modules of this package that it imports, and of `LIBRARIES`."""
    modules = map(_fingerprint, closure(script))
    code = "\n".join((_structure(_tree(Path(script))), *modules, *_versions()))
    return hashlib.sha256(code.encode()).hexdigest()[:16]


def closure(script: str | os.PathLike[str]) -> tuple[str, ...]:
    """Names of the modules of this package that a script imports, directly or not, in order.

    Imports count wherever they stand, those inside a function too. The package itself, imported
    before any of its modules, is ``__init__``.
    """
    found = set()
    pending = set(_imports(Path(script)))
    while pending:
        found.add(module := pending.pop())
        pending |= _imports(_source(module)) - found
    return tuple(sorted(found))


@functools.cache
def _versions() -> tuple[str, ...]:
    return tuple(f"{library} {metadata.version(library)}" for library in LIBRARIES)


def _source(module: str) -> Path:
    place = PACKAGE.joinpath(*module.split("."))
    return place / "__init__.py" if place.is_dir() else place.with_suffix(".py")


@functools.cache
def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@functools.cache
def _imports(path: Path) -> frozenset[str]:
    """Modules of this package that a file imports itself."""
    package = PACKAGE.name
    names = set()
    for node in _statements(_tree(path).body):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            parent = node.module or ""
            if node.level:
                parent = f"{package}.{parent}".removesuffix(".")
            # What `from sphpod import name` brings in may be a module or an attribute.
            names |= {parent, *(f"{parent}.{alias.name}" for alias in node.names)}
    inside = {
        name.removeprefix(f"{package}.")
        for full in names
        for name in accumulate(full.split("."), "{}.{}".format)
        if name.startswith(f"{package}.")
    }
    modules = {name for name in inside if _source(name).is_file()}
    return frozenset(modules | {"__init__"} if modules or package in names else ())


def _statements(body: list[ast.stmt]) -> Iterator[ast.stmt]:
    """All statements of a body, those inside others too, without a look at expressions."""
    for statement in body:
        yield statement
        for name in ("body", "orelse", "finalbody", "handlers", "cases"):
            yield from _statements(getattr(statement, name, []))


@functools.cache
def _fingerprint(module: str) -> str:
    """The code of a module, and the data files beside it that it names, as text."""
    structure = _structure(_tree(_source(module)))
    data = sorted(
        path
        for path in _source(module).parent.glob("*.*")
        if path.suffix != ".py" and repr(path.name) in structure
    )
    contents = (hashlib.sha256(path.read_bytes()).hexdigest() for path in data)
    return "\n".join((module, structure, *contents))


def _structure(node: object) -> str:
    """The syntax tree as text, without docstrings, positions and what is empty.

    Left out too is whether a name is loaded or stored, which follows from where it stands.
    `ast.dump` would do, but what it says of empty fields depends on the version of Python.
    """
    if isinstance(node, list):
        return f"[{','.join([_structure(item) for item in node if not _is_docstring(item)])}]"
    if not isinstance(node, ast.AST):
        return repr(node)
    filled = [
        f"{name}={_structure(value)}"
        for name in node._fields
        if name != "ctx" and (value := getattr(node, name, None)) is not None and value != []
    ]
    return f"{type(node).__name__}({','.join(filled)})"


def _is_docstring(node: object) -> bool:
    """Whether a statement is text alone, which documents what it stands in or behind."""
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )
