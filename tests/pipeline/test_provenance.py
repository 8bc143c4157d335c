"""Code digests: complete, and blind to what computes nothing."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from sphpod.pipeline import provenance

ROOT = Path(__file__).parents[2]
SCRIPTS = sorted((ROOT / "workflow" / "scripts").glob("*.py"))


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A copy of the package to edit; its digests are taken afresh every time."""
    copy = tmp_path / "sphpod"
    shutil.copytree(provenance.PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(provenance, "PACKAGE", copy)
    return copy


def digest(script):
    return digest_of(ROOT / "workflow" / "scripts" / f"{script}.py")


def digest_of(path):
    for cached in (
        provenance._tree,
        provenance._imports,
        provenance._fingerprint,
        provenance._versions,
    ):
        cached.cache_clear()
    return provenance.digest(path)


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_closure_is_what_python_imports(script):
    # As a module, not as __main__, a script only imports. Nothing may be imported that the closure
    # lacks; what it holds beyond that is imported later, inside a function.
    program = (
        "import runpy, sys; runpy.run_path(sys.argv[1], run_name='script');"
        "print(*(name for name in sys.modules if name.partition('.')[0] == 'sphpod'))"
    )
    run = subprocess.run(
        [sys.executable, "-c", program, script],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    )
    imported = {name.removeprefix("sphpod.") for name in run.stdout.split()} - {"sphpod"}
    assert imported | {"__init__"} <= set(provenance.closure(script))


@pytest.mark.parametrize("script", ["sph", "reference", "snapshots", "pod", "reduced_model"])
def test_solvers_depend_neither_on_plotting_nor_on_reading_the_configuration(script):
    closure = provenance.closure(ROOT / "workflow" / "scripts" / f"{script}.py")
    assert not [name for name in closure if name.startswith(("figures", "config", "paper"))]


def test_imports_of_every_form_are_found(package, tmp_path):
    for name, text in {
        "a": "from . import b",
        "b": "from .c import something",
        "c": "def late():\n    import sphpod.d",
        "d": "from sphpod import e, __version__",
        "e": "import numpy",
    }.items():
        (package / f"{name}.py").write_text(text)
    script = tmp_path / "script.py"
    script.write_text("from sphpod.a import anything")
    assert provenance.closure(script) == ("__init__", "a", "b", "c", "d", "e")
    other = tmp_path / "other.py"
    other.write_text("import numpy")
    assert provenance.closure(other) == ()


def test_comments_docstrings_and_layout_do_not_count(package):
    before = digest("sph")
    sph = package / "full" / "sph.py"
    text = sph.read_text()
    assert text.startswith('"""')
    sph.write_text(text.replace('"""', '"""Another beginning. ', 1) + "\n\n\n# And an end.\n")
    assert digest("sph") == before
    kernel = package / "scene" / "kernel.py"
    kernel.write_text(kernel.read_text() + '\n\ndef more():\n    """Told at length."""\n')
    changed = digest("sph")
    kernel.write_text(kernel.read_text().replace("Told at length.", "Told in short."))
    assert digest("sph") == changed
    scene = package / "scene" / "scene.py"
    told = '"""Stands for a damping or force that a scene does not have."""'
    assert told in scene.read_text()
    scene.write_text(scene.read_text().replace(told, '"""What a value behind it is told as."""'))
    assert digest("sph") == changed


def test_code_counts_where_it_is_used(package):
    scripts = ("sph", "pod", "figure")
    before = [digest(script) for script in scripts]
    (package / "reduced" / "pod.py").write_text(
        (package / "reduced" / "pod.py").read_text() + "\nMORE = 1\n"
    )
    changed = [digest(script) != old for script, old in zip(scripts, before, strict=True)]
    assert changed == [False, True, False]


def test_version_counts_everywhere(package):
    before = digest("pod")
    init = package / "__init__.py"
    init.write_text(init.read_text().replace("__version__ = ", "__version__ = 'later' + "))
    assert digest("pod") != before


def test_data_files_count_where_they_are_named(package):
    before = digest("figure"), digest("pod")
    style = package / "figures" / "style.mplstyle"
    style.write_text(style.read_text() + "\nlines.linewidth: 3\n")
    after = digest("figure"), digest("pod")
    assert after[0] != before[0]
    assert after[1] == before[1]


def test_the_script_counts_but_neither_its_words_nor_its_date(tmp_path):
    script = tmp_path / "pod.py"
    text = (ROOT / "workflow" / "scripts" / "pod.py").read_text()
    script.write_text(text)
    before = digest_of(script)
    os.utime(script, (0, 0))
    assert digest_of(script) == before
    script.write_text(text.replace('"""', '"""Told otherwise. ', 1) + "# And an end.\n")
    assert digest_of(script) == before
    script.write_text(text.replace("Modes of the", "The modes of the"))
    assert digest_of(script) != before


@pytest.mark.parametrize("library", ["numpy", "scipy", "numba", "matplotlib"])
def test_versions_of_libraries_count_where_they_change_numbers(tmp_path, monkeypatch, library):
    before = digest("pod")
    installed = tmp_path / f"{library}-99.dist-info"
    installed.mkdir()
    (installed / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {library}\nVersion: 99\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert (digest("pod") != before) is (library != "matplotlib")
    monkeypatch.undo()
    assert digest("pod") == before


def test_every_statement_and_expression_counts(package):
    module = package / "reduced" / "pod.py"
    text = module.read_text() + "\nwith open('a') as file, b:\n    c = d if e else f[1:2]\n"
    digests = set()
    for old, new in (
        ("", ""),
        ("open('a')", "open('b')"),
        ("open('a')", "open(b'a')"),
        ("as file, b", "as b, file"),
        ("d if e else f", "f if e else d"),
        ("[1:2]", "[1::2]"),
        ("[1:2]", "[:2]"),
        ("c = d", "c: d = d"),
        ("c = d", "c += d"),
        ("c = d", "c == d"),
    ):
        assert old in text
        module.write_text(text.replace(old, new) if old else text)
        digests.add(digest("pod"))
    assert len(digests) == 10
