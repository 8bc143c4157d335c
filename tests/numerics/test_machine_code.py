"""Machine code is that of the source, on this processor."""

import importlib
import os
import pkgutil
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher

import sphpod
from sphpod.numerics import machine_code

pytestmark = pytest.mark.workflow

INNER = """
from sphpod.numerics.compiled import compiled
from sphpod.constants import SHIFT

@compiled
def shift(value):
    return value + SHIFT
"""

OUTER = """
from sphpod.numerics.compiled import compiled
from sphpod.inner import shift

@compiled
def total(values):
    result = 0.0
    for value in values:
        result += shift(value)
    return result
"""

REORDERED = '(_compile, fastmath={"fast"}    )'
"""As long as what it replaces: sums may be taken in another order, as vectors."""

VALUES = np.random.default_rng(0).normal(size=1001)

PROGRAM = """
import numpy as np
from sphpod.outer import total
print(total(np.random.default_rng(0).normal(size=1001)).hex())
print(sum(total.stats.cache_hits.values()))
"""


def summed(shift):
    """What the program has to print, added up one by one."""
    result = 0.0
    for value in VALUES:
        result += float(value) + shift
    return result


@pytest.fixture
def package(tmp_path):
    """A package with kernels in two modules and a constant in a third, compiled as ours are."""
    folder = tmp_path / "code" / "sphpod"
    (folder / "numerics").mkdir(parents=True)
    for name in ("__init__", "numerics/__init__", "numerics/compiled", "numerics/machine_code"):
        shutil.copy(machine_code.PACKAGE / f"{name}.py", folder / f"{name}.py")
    for name, text in {"inner": INNER, "outer": OUTER, "constants": "SHIFT = 0.25\n"}.items():
        (folder / f"{name}.py").write_text(text)
    return folder


def start(package, program=PROGRAM, **environment):
    """A process that runs a program with the package; variables that are None are unset."""
    changed = {"PYTHONPATH": package.parent, "PYTHONDONTWRITEBYTECODE": None} | environment
    kept = {name: value for name, value in os.environ.items() if name not in changed}
    given = {name: str(value) for name, value in changed.items() if value is not None}
    return subprocess.Popen(
        [sys.executable, "-c", program],
        cwd=package.parent,
        env=kept | given,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(process):
    """What a process printed, and its warnings."""
    output, warnings = process.communicate()
    assert process.returncode == 0, warnings
    return output, warnings


def numbers(process):
    """The number that a process printed, and how often it was spared compiling."""
    number, spared = finish(process)[0].split()
    return float.fromhex(number), int(spared)


def folder_of(package, **environment):
    """Where a process keeps machine code."""
    program = "from sphpod.numerics import machine_code; print(machine_code.FOLDER)"
    return Path(finish(start(package, program, **environment))[0].strip())


def rewrite(path, old, new):
    """An edit that neither the size nor the time of the file shows; back again if undone."""
    before, text = path.stat(), path.read_text()
    assert text.count(old) == 1
    path.write_text(text.replace(old, new))

    def undo():
        path.write_text(text)
        keep_time()

    def keep_time():
        os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
        assert path.stat().st_size == before.st_size

    keep_time()
    return undo


def test_an_edit_is_seen_at_once_and_undone_at_once(package):
    assert numbers(start(package)) == (summed(0.25), 0)
    for module, old, new in (
        ("inner", "value + SHIFT", "value - SHIFT"),
        ("constants", "0.25", "-.25"),
    ):
        undo = rewrite(package / f"{module}.py", old, new)
        assert numbers(start(package)) == (summed(-0.25), 0)
        undo()
    undo = rewrite(
        package / "numerics" / "compiled.py", '(_compile, fastmath={"contract"})', REORDERED
    )
    number, spared = numbers(start(package))
    assert spared == 0
    assert number != summed(0.25)
    assert number == pytest.approx(summed(0.25), rel=1e-12)
    undo()
    assert numbers(start(package)) == (summed(0.25), 1)


def test_an_edit_while_a_process_runs_spoils_nothing(package):
    # The process has chosen its folder when the edit comes, and then compiles the edited code.
    path = package / "inner.py"
    program = f"""
from pathlib import Path
import sphpod.numerics.compiled
path = Path({str(path)!r})
path.write_text(path.read_text().replace("value + SHIFT", "value - SHIFT"))
{PROGRAM}
"""
    assert numbers(start(package, program)) == (summed(-0.25), 0)
    rewrite(path, "value - SHIFT", "value + SHIFT")
    assert numbers(start(package)) == (summed(0.25), 0)


def test_wrapping_is_compiled_into_lifted_models_as_its_source_says(tmp_path):
    package = tmp_path / "code" / "sphpod"
    shutil.copytree(
        machine_code.PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__", "*.mplstyle")
    )
    # Only the velocity of the first particle is not zero. The strain of the last one grows by it,
    # unless the ghost behind the seam is another particle.
    program = """
import numpy as np
from sphpod.full.lifted import rates_of
state, rates, none = np.zeros(10), np.empty(10), np.empty(0)
state[0] = 1
rates_of(state, np.zeros((2, 7)), np.ones(1), (np.ones(5),) * 2, (none, none), rates)
print(rates[-1].hex(), sum(rates_of.stats.cache_hits.values()))
"""
    assert numbers(start(package, program)) == (1, 0)
    rewrite(package / "full" / "sph.py", "k] = field[width + k]", "k] = field[count + k]")
    assert numbers(start(package, program)) == (0, 0)


def test_processor_types_compile_at_once_each_in_a_folder_of_its_own(package):
    generic = {"NUMBA_CPU_NAME": "generic"}
    processes = [start(package, **environment) for environment in ({}, generic, {}, generic)]
    for process in processes:
        assert numbers(process)[0] == summed(0.25)
    for environment in ({}, generic):
        assert numbers(start(package, **environment)) == (summed(0.25), 1)
    assert len(list((package / "__pycache__" / "sphpod").iterdir())) == 2


def test_a_setting_of_the_compiler_has_a_folder_of_its_own(package):
    folder = folder_of(package)
    assert folder_of(package, NUMBA_OPT=1) != folder
    assert folder_of(package, NUMBA_NUM_THREADS=1) == folder


def test_what_cannot_be_written_is_kept_with_the_user_under_the_same_name(package, tmp_path):
    inside = folder_of(package)
    assert inside.parent == package / "__pycache__" / "sphpod"
    shutil.rmtree(package / "__pycache__")
    # Not even root can write below a file.
    (package / "__pycache__").touch()
    none = {"XDG_CACHE_HOME": None}
    for environment, root in (
        ({"XDG_CACHE_HOME": tmp_path / "cache"}, "cache"),
        (none | {"HOME": tmp_path / "home"}, "home/.cache"),
        (none | {"NUMBA_CACHE_DIR": tmp_path / "asked"}, "asked"),
    ):
        assert folder_of(package, **environment) == tmp_path / root / "sphpod" / inside.name
    assert numbers(start(package, XDG_CACHE_HOME=tmp_path / "cache")) == (summed(0.25), 0)
    kept = {path.name.partition("-")[0] for path in (tmp_path / "cache").rglob("*.nbc")}
    assert kept == {"inner.shift", "outer.total"}


def test_without_any_folder_each_process_compiles_and_says_so(package, tmp_path):
    (package / "__pycache__").touch()
    (tmp_path / "file").touch()
    program = (
        f"from sphpod.numerics import machine_code\nassert machine_code.FOLDER is None\n{PROGRAM}"
    )
    output, warnings = finish(start(package, program, XDG_CACHE_HOME=tmp_path / "file"))
    assert output.split() == [summed(0.25).hex(), "0"]
    assert "every process compiles its kernels anew" in warnings
    assert str(tmp_path / "file") in warnings


def test_folders_of_other_code_are_removed_when_no_process_uses_them(package):
    yesterday = time.time() - machine_code.UNUSED - 60
    used, unused = folder_of(package), folder_of(package, NUMBA_CPU_NAME="generic")
    other = used.parent / "of another kind"
    other.mkdir()
    for folder in (unused, other):
        os.utime(folder, (yesterday, yesterday))
    rewrite(package / "inner.py", "value + SHIFT", "value - SHIFT")
    current = folder_of(package)
    assert not unused.exists()
    assert set(used.parent.iterdir()) == {used, other, current}
    # The same code on another processor is not old however long it is not used.
    os.utime(current, (yesterday, yesterday))
    folder_of(package, NUMBA_CPU_NAME="generic")
    assert current.exists()


def test_a_process_whose_folder_is_removed_goes_on(package):
    program = f"""
import shutil
from sphpod.numerics import machine_code
from sphpod import outer
shutil.rmtree(machine_code.FOLDER)
{PROGRAM}
"""
    assert numbers(start(package, program)) == (summed(0.25), 0)
    assert numbers(start(package)) == (summed(0.25), 1)


def test_a_kernel_of_other_code_is_compiled_but_not_kept(package):
    # No digest is taken of the file that it stands in.
    program = """
from numba import config
from sphpod.numerics import machine_code
from sphpod.numerics.compiled import compiled
@compiled
def double(value):
    return 2 * value
print(double(1.0).hex(), len(list(machine_code.FOLDER.iterdir())))
assert config.CACHE_LOCATOR_CLASSES == ""
"""
    assert numbers(start(package, program)) == (2, 0)


def test_every_module_with_kernels_is_known():
    for info in pkgutil.walk_packages(sphpod.__path__, "sphpod."):
        module = importlib.import_module(info.name)
        for kernel in vars(module).values():
            if isinstance(kernel, Dispatcher):
                path = Path(kernel.py_func.__code__.co_filename).relative_to(machine_code.PACKAGE)
                assert path.as_posix() in machine_code.SOURCES
