"""Which code a result depends on: a digest of the modules that computed it.

A rule of the workflow stores the digest of the modules that its script uses. It changes with their
code and with the code of everything they import from this package, but not with a comment, a
docstring or the layout of a line; so exactly the results that an edit may have changed are redone.
"""

import ast
import functools
import hashlib
from pathlib import Path

PACKAGE = Path(__file__).parent


def digest(*modules: str) -> str:
    """Digest of the code of modules of this package, named without it, and of all they import.

    Raises
    ------
    ValueError
        For a module that the package does not have.
    """
    if unknown := [module for module in modules if not _source(module).is_file()]:
        raise ValueError(f"sphpod has no module named {', '.join(unknown)}")
    names = closure(*modules)
    return hashlib.sha256("\n".join(map(_fingerprint, names)).encode()).hexdigest()[:16]


def closure(*modules: str) -> tuple[str, ...]:
    """Modules of this package that `modules` import, directly or not, themselves among them.

    Imports count wherever they stand, those inside a function too.
    """
    found: set[str] = set()
    pending = {"__init__", *modules}
    while pending:
        module = pending.pop()
        found.add(module)
        pending |= _imports(module) - found
    return tuple(sorted(found))


def _source(module: str) -> Path:
    return PACKAGE / f"{module}.py"


@functools.cache
def _tree(module: str) -> ast.Module:
    return ast.parse(_source(module).read_text(encoding="utf-8"))


@functools.cache
def _imports(module: str) -> frozenset[str]:
    """Modules of this package that a module imports itself."""
    package = PACKAGE.name
    names = set()
    for node in ast.walk(_tree(module)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            parent = node.module or ""
            if node.level:
                parent = f"{package}.{parent}" if parent else package
            names.add(parent)
            # What `from sphpod import name` brings in may be a module or an attribute.
            names |= {f"{parent}.{alias.name}" for alias in node.names}
    inside = {name.removeprefix(f"{package}.") for name in names if name.startswith(f"{package}.")}
    return frozenset(name for name in inside if _source(name).is_file())


@functools.cache
def _fingerprint(module: str) -> str:
    """The code of a module, and the data files beside it that it names, as text."""
    tree = _tree(module)
    texts = {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)}
    data = sorted(p for p in PACKAGE.glob("*.*") if p.suffix != ".py" and p.name in texts)
    contents = (hashlib.sha256(path.read_bytes()).hexdigest() for path in data)
    return "\n".join((module, _structure(tree), *contents))


def _structure(node: object) -> str:
    """The syntax tree as text, without docstrings, positions and what is empty.

    `ast.dump` would do but for the empty fields, which differ between versions of Python.
    """
    if isinstance(node, list):
        return f"[{','.join(map(_structure, node))}]"
    if not isinstance(node, ast.AST):
        return repr(node)
    fields = dict(ast.iter_fields(node))
    if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
        if ast.get_docstring(node, clean=False) is not None:
            fields["body"] = node.body[1:]
    parts = (f"{name}={_structure(value)}" for name, value in fields.items() if value not in (None, []))
    return f"{type(node).__name__}({','.join(parts)})"
