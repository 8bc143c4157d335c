"""Where the machine code of kernels is kept, so that it is that of their source on this processor.

numba's own cache compares nothing but the file that a kernel stands in. It would go on with the old
code of a kernel that another file holds, with old options of the compiler and old constants; and
processors of two types that compile at once could each be given the other's code. So there is a
folder for each state of the modules with kernels, each numba and each processor. In it, a file is
named after what numba freezes into its kernel.
"""

import hashlib
import importlib.util
import logging
import os
import re
import shutil
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import llvmlite
import numba
import numpy as np
from llvmlite import binding
from numba.core.caching import _CacheLocator
from numba.core.codegen import get_host_cpu_features
from numba.core.dispatcher import Dispatcher

PACKAGE = Path(__file__).parents[1]

UNUSED = 24 * 3600
"""Seconds after the last start of a process with it from which on a folder of other code is old."""

SETTINGS = ("OPT", "LOOP_VECTORIZE", "SLP_VECTORIZE", "BOUNDSCHECK", "USING_SVML")
"""Settings of numba, beside those of the processor, that machine code depends on."""

_lock = threading.Lock()


@contextmanager
def kept(function: Callable[..., Any]) -> Iterator[bool]:
    """Have numba keep the machine code of kernels that are decorated meanwhile in the folder.

    Yields
    ------
    bool
        Whether it can be kept: there is a folder, and its name depends on the module of the kernel.
    """
    path = Path(function.__code__.co_filename)
    with _lock:
        before = numba.config.CACHE_LOCATOR_CLASSES
        numba.config.CACHE_LOCATOR_CLASSES = f"{__name__}.{Locator.__name__}"
        try:
            yield FOLDER is not None and _name(path) in SOURCES
        finally:
            numba.config.CACHE_LOCATOR_CLASSES = before


class Locator(_CacheLocator):
    """Tells numba the folder, and names the files of a kernel after what is frozen into it."""

    def __init__(self, function: Callable[..., Any], path: str) -> None:
        self._py_file = path
        self._digest = _digest(frozen(function))

    @classmethod
    def from_function(cls, function: Callable[..., Any], path: str) -> "Locator":
        return cls(function, path)

    def get_cache_path(self) -> str:
        return str(FOLDER)

    def get_source_stamp(self) -> str:
        return self._digest

    def get_disambiguator(self) -> str:
        return self._digest


def frozen(function: Callable[..., Any]) -> tuple:
    """What numba compiles into a kernel: its code, and constants and kernels that it names.

    Taken from what Python runs, which is not what its files say if they are edited meanwhile.
    ``fastmath``, an attribute of the function, are the liberties that the compiler may take.
    """
    code, known = function.__code__, function.__globals__
    liberties = sorted(getattr(function, "fastmath", ()))
    values = [(name, known[name]) for name in code.co_names if name in known]
    values += [
        (name, getattr(module, name))
        for _, module in list(values)
        if isinstance(module, ModuleType)
        for name in code.co_names
        if hasattr(module, name)
    ]
    return liberties, _code(code), [(name, _value(value)) for name, value in values]


def _code(code: CodeType) -> tuple:
    constants = (_code(item) if isinstance(item, CodeType) else item for item in code.co_consts)
    return code.co_code, tuple(constants), code.co_names, code.co_varnames


def _value(value: object) -> object:
    """What of a global variable ends up in machine code, the same in every process."""
    if isinstance(value, Dispatcher):
        return frozen(value.py_func)
    if isinstance(value, tuple):
        return tuple(map(_value, value))
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, int | float | complex | str | bytes | np.generic):
        return value
    return getattr(value, "__module__", None), getattr(value, "__name__", None)


def _sources() -> dict[str, str]:
    """Digests of modules that hold kernels, and of the one that says how they are compiled."""
    contents = {_name(path): path.read_bytes() for path in sorted(PACKAGE.rglob("*.py"))}
    return {
        name: hashlib.sha256(content).hexdigest()
        for name, content in contents.items()
        if name == "numerics/compiled.py" or b"\n@compiled" in content
    }


def _name(path: Path) -> str:
    """A module as its path in the package; as its whole path, if it is not in it."""
    return (path.relative_to(PACKAGE) if path.is_relative_to(PACKAGE) else path).as_posix()


def _processor() -> tuple:
    """Name and features of the processor that numba compiles for, as far as it is known."""
    name, features = numba.config.CPU_NAME, numba.config.CPU_FEATURES
    return (
        binding.get_host_cpu_name() if name is None else name,
        get_host_cpu_features() if features is None else features,
    )


def _digest(value: object) -> str:
    return hashlib.sha256(repr(value).encode()).hexdigest()[:16]


def _roots() -> Iterator[Path]:
    """Folders that machine code may be kept under, the first that can be written to is taken."""
    if numba.config.CACHE_DIR:
        yield Path(numba.config.CACHE_DIR).absolute()
    yield Path(importlib.util.cache_from_source(str(PACKAGE / "__init__.py"))).parent
    try:
        yield Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache").absolute()
    except RuntimeError:
        # A user without a home.
        return


def _folder() -> Path | None:
    """The folder of this code and this processor, made if needed; none if none can be written."""
    code = _digest((SOURCES, numba.__version__, llvmlite.__version__, np.__version__))
    settings = tuple(getattr(numba.config, name) for name in SETTINGS)
    name = f"{code}-{_digest((_processor(), settings))}"
    roots = list(_roots())
    for root in roots:
        folder = root / PACKAGE.name / name
        is_new = not folder.exists()
        try:
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
            os.utime(folder)
        except OSError:
            continue
        if is_new:
            _compare_contents()
            _remove_old(folder)
        return folder
    logging.getLogger(__name__).warning(
        "every process compiles its kernels anew, as no folder for machine code can be written: %s",
        ", ".join(map(str, roots)),
    )
    return None


def _compare_contents() -> None:
    """Have Python compare modules with its byte code by content, as date and size may stay."""
    if not sys.dont_write_bytecode:
        import compileall
        from py_compile import PycInvalidationMode

        compileall.compile_dir(
            PACKAGE, force=True, quiet=2, invalidation_mode=PycInvalidationMode.CHECKED_HASH
        )


def _remove_old(folder: Path) -> None:
    """Remove the folders beside this one that hold other code and are used no more."""
    code = folder.name.partition("-")[0]
    now = folder.stat().st_mtime
    for other in folder.parent.iterdir():
        if not re.fullmatch("[0-9a-f]{16}-[0-9a-f]{16}", other.name) or other.name.startswith(code):
            continue
        try:
            is_old = now - other.stat().st_mtime > UNUSED
        except OSError:
            # Another process has just removed it.
            continue
        if is_old:
            shutil.rmtree(other, ignore_errors=True)


SOURCES = _sources()
FOLDER = _folder()
