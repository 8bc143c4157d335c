"""Which code a result depends on: a digest of functions and of all that they use of this package.

A rule of the workflow keeps the digest of its function as a parameter. It changes with the code of
the function, with that of every function, class and constant of this package that it uses, directly
or not, and with the version of a library that computes numbers. It does not change with what else
stands in their modules, with a comment, a docstring, the layout of a line, the wording of a message
or the date of a file; so exactly the results that an edit may have changed are made anew.
"""

import ast
import functools
import hashlib
import os
from collections import defaultdict
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from typing import NamedTuple

PACKAGE = Path(__file__).parents[1]

LIBRARIES = "numpy", "scipy", "numba"
"""Libraries whose version may change numbers."""

WORDED = "debug", "info", "warning", "error", "critical", "exception", "warn", "refuse"
"""Methods of loggers, and functions that raise, which are given the text of a message."""

ALL = "*"
"""Stands for all names of a module."""


class Module(NamedTuple):
    """A file of code.

    Attributes
    ----------
    statements : list
        Its statements, without docstrings and the words of messages.
    bound : dict
        Of each name, the numbers of the statements that define it or change its value in place.
    always : set
        Numbers of statements that act when the file is imported.
    imports : dict
        Of each name that is imported from this package, wherever in the file, the module and what
        of it, which is `ALL` where the name is that of the module.
    """

    statements: list[ast.stmt]
    bound: dict[str, set[int]]
    always: set[int]
    imports: dict[str, tuple[str, str]]


@functools.cache
def digest(*roots: str | os.PathLike[str]) -> str:
    """Digest of functions, of all that they use of this package, and of `LIBRARIES`.

    Parameters
    ----------
    *roots
        Functions below the package, such as "full.sph.solve", or paths of scripts.

    Raises
    ------
    ValueError
        There is no such function.
    """
    used = _used(roots)
    code = [_structure_of(module, number) for module in sorted(used) for number in used[module]]
    return hashlib.sha256("\n".join((*code, *_libraries())).encode()).hexdigest()[:16]


@functools.cache
def _libraries() -> list[str]:
    return [f"{library} {metadata.version(library)}" for library in LIBRARIES]


def closure(*roots: str | os.PathLike[str]) -> tuple[str, ...]:
    """Names below the package of what functions or scripts use of it, directly or not, in order."""
    return tuple(
        sorted(
            f"{module}.{name}"
            for module, statements in _used(roots).items()
            for name, numbers in _module(module).bound.items()
            if not module.endswith(".py") and numbers.intersection(statements)
        )
    )


def _used(roots: tuple[str | os.PathLike[str], ...]) -> dict[str, list[int]]:
    """Numbers of the statements of each module that roots use, in order."""
    pending = [("__init__", "__version__")]
    for root in map(str, roots):
        module, _, function = root.rpartition(".")
        if function == "py":
            pending.append((root, ALL))
        elif module and _is_module(module) and function in _module(module).bound:
            pending.append((module, function))
        else:
            raise ValueError(f"{root}: {PACKAGE.name} has no such function")
    used: dict[str, set[int]] = defaultdict(set)
    while pending:
        module, wanted = pending.pop()
        code = _module(module)
        numbers = range(len(code.statements)) if wanted == ALL else code.bound[wanted]
        new = (code.always | set(numbers)) - used[module]
        used[module] |= new
        pending.extend(use for number in new for use in _uses(module, number))
    return {module: sorted(numbers) for module, numbers in used.items()}


@functools.cache
def _uses(name: str, number: int) -> frozenset[tuple[str, str]]:
    """Modules, and what of them, that a statement of a module names."""
    module = _module(name)
    nodes = list(ast.walk(module.statements[number]))
    attributes = {id(n.value): n.attr for n in nodes if isinstance(n, ast.Attribute)}
    found = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            found |= {(inside, ALL) for alias in node.names if (inside := _inside(alias.name))}
        if not isinstance(node, ast.Name):
            continue
        if node.id in module.imports:
            source, wanted = module.imports[node.id]
            if wanted == ALL:
                wanted = attributes.get(id(node), ALL)
            # A name that the module has itself imported is the other module's.
            while wanted in (known := _module(source)).imports:
                source, wanted = known.imports[wanted]
            if wanted == ALL or wanted in known.bound:
                found.add((source, wanted))
        elif node.id in module.bound:
            found.add((name, node.id))
        elif node.id == "globals":
            found.add((name, ALL))
    return frozenset(found)


def _source(module: str) -> Path:
    """File of a module below the package, or of a script, which is named by its path."""
    if module.endswith(".py"):
        return Path(module)
    place = PACKAGE.joinpath(*module.split("."))
    return place / "__init__.py" if place.is_dir() else place.with_suffix(".py")


def _is_module(name: str) -> bool:
    return _source(name).is_file()


@functools.cache
def _module(name: str) -> Module:
    plain = _Plain()
    tree = plain.visit(ast.parse(_source(name).read_text(encoding="utf-8")))
    own = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    bound: dict[str, set[int]] = defaultdict(set)
    always = set()
    for number, statement in enumerate(tree.body):
        names, acts = _bound(statement)
        for each in names:
            bound[each].add(number)
        # A decorator of the module's own may keep what it decorates where others find it.
        decorators = getattr(statement, "decorator_list", [])
        if acts or own & {n.id for d in decorators for n in ast.walk(d) if isinstance(n, ast.Name)}:
            always.add(number)
    return Module(tree.body, dict(bound), always, plain.imports)


def _bound(statement: ast.stmt) -> tuple[set[str], bool]:
    """Names that a statement defines or changes in place, and whether it may act beyond that."""
    match statement:
        case ast.FunctionDef() | ast.ClassDef():
            return {statement.name}, False
        case ast.ImportFrom():
            return set(), False
        case ast.Import(names=names):
            return set(), any(_inside(alias.name) for alias in names)
        case ast.Assign(targets=targets):
            return {_base(node) for target in targets for node in _single(target)}, False
        case ast.AnnAssign(target=target) | ast.AugAssign(target=target):
            return {_base(target)}, False
    inside = list(ast.walk(statement))
    functions = {node.name for node in inside if isinstance(node, ast.FunctionDef)}
    stored = {n.id for n in inside if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
    return functions | stored, True


def _single(target):
    return target.elts if isinstance(target, ast.Tuple | ast.List) else [target]


def _base(target):
    """The name of which a target is an item or an attribute."""
    while not isinstance(target, ast.Name):
        target = target.value
    return target.id


def _imported(node: ast.ImportFrom) -> Iterator[tuple[str, tuple[str, str]]]:
    """Names that an import binds to something of this package, each with its module and name."""
    for alias in node.names:
        if inside := _inside(f"{node.module}.{alias.name}"):
            parent, _, last = inside.rpartition(".")
            is_module = _is_module(inside)
            yield (
                alias.asname or alias.name,
                (inside, ALL) if is_module else (parent or "__init__", last),
            )


def _inside(name: str) -> str:
    """A full name as one below the package, empty for another's."""
    package = f"{PACKAGE.name}."
    return name.removeprefix(package) if name.startswith(package) else ""


class _Plain(ast.NodeTransformer):
    """Leaves out docstrings, and the text of exceptions, assertions and messages for the log."""

    def __init__(self):
        self.imports = {}

    def generic_visit(self, node):
        # Statements stand in statements alone.
        for name in ("body", "orelse", "finalbody", "handlers", "cases"):
            parts = getattr(node, name, None)
            if isinstance(parts, list):
                setattr(node, name, [new for part in parts if (new := self.visit(part))])
        return node

    def visit_ImportFrom(self, node):
        self.imports |= dict(_imported(node))
        return node

    def visit_Expr(self, node):
        if isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            return None
        called = getattr(node.value, "func", None)
        name = getattr(called, "attr", None) or getattr(called, "id", None)
        of = getattr(getattr(called, "value", None), "id", None)
        if name in WORDED or (of, name) == ("logger", "log"):
            return _Wordless().visit(node)
        return self.generic_visit(node)

    def visit_Raise(self, node):
        return _Wordless().visit(node)

    def visit_Assert(self, node):
        node.msg = None
        return node

    def visit_ClassDef(self, node):
        bases = [getattr(base, "id", "") for base in node.bases]
        is_exception = any(base.endswith(("Error", "Exception", "Warning")) for base in bases)
        return self.generic_visit(_Wordless().visit(node) if is_exception else node)


class _Wordless(ast.NodeTransformer):
    def visit_Constant(self, node):
        return ast.Constant("") if isinstance(node.value, str) else node

    def visit_JoinedStr(self, node):
        return ast.Constant("")


@functools.cache
def _structure_of(module: str, number: int) -> str:
    """A statement as text, and the data files beside its module that it names."""
    structure = _structure(_module(module).statements[number])
    data = sorted(
        path
        for path in _source(module).parent.glob("*.*")
        if path.suffix != ".py" and repr(path.name) in structure
    )
    return "\n".join((structure, *(hashlib.sha256(p.read_bytes()).hexdigest() for p in data)))


def _structure(node: object) -> str:
    """The syntax tree as text, without positions and what is empty.

    Left out too is whether a name is loaded or stored, which follows from where it stands.
    `ast.dump` would do, but what it says of empty fields depends on the version of Python.
    """
    if isinstance(node, list):
        return f"[{','.join(map(_structure, node))}]"
    if not isinstance(node, ast.AST):
        return repr(node)
    filled = [
        f"{name}={_structure(value)}"
        for name in node._fields
        if name != "ctx" and (value := getattr(node, name, None)) is not None and value != []
    ]
    return f"{type(node).__name__}({','.join(filled)})"
