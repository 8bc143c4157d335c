"""Code digests: complete, and blind to what computes nothing."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from sphpod.pipeline import provenance
from sphpod.studies.study import studies

ROOT = Path(__file__).parents[2]
FUNCTIONS = {
    "sph": "full.sph.solve",
    "pod": "reduced.pod.decompose",
    "figure": "figures.plotting.profile",
}


def digest(name):
    return digest_of(FUNCTIONS[name])


def digest_of(*roots):
    for cached in (
        provenance.digest,
        provenance._libraries,
        provenance._module,
        provenance._uses,
        provenance._structure_of,
    ):
        cached.cache_clear()
    return provenance.digest(*roots)


RUNS = {
    "full.sph.solve": "sph.solve(scene(), steps)",
    "full.lifted.solve": "[lifted.solve(scene(**v), 'exact') for v in ({}, VARIED)]",
    "reference.reference.solve_paper": "reference.solve_paper(scene(**VARIED))",
    "reduced.lifted_rom.decompose": "lifted_rom.decompose(scene(**VARIED), snapshots)",
    "studies.growth.measure": "growth.measure(scene(), [1.0, 2.0], 10.0)",
}
"""Functions that rules name, and calls of them."""


@pytest.mark.slow
@pytest.mark.parametrize("root", RUNS)
def test_all_that_runs_is_in_the_closure(root):
    """Every function of the package that a call enters is one that the digest depends on."""
    program = f"""
import sys
import numpy as np
from scenes import VARIED, scene
from sphpod.full import lifted, sph
from sphpod.reduced import lifted_rom
from sphpod.reference import reference
from sphpod.studies import growth

steps = np.arange(0, 11, 5)
full = sph.solve(scene(), np.arange(0, 101, 5))
snapshots = {{f"{{field}}_snapshots": full[field] for field in ("velocity", "density")}}
entered = set()

def enter(frame, event, _):
    module, name = frame.f_globals.get("__name__") or "", frame.f_code.co_qualname.split(".")[0]
    if event == "call" and module.startswith("sphpod.") and name[:2] not in ("__", "<m"):
        entered.add(module.removeprefix("sphpod.") + "." + name)

sys.setprofile(enter)
{RUNS[root]}
sys.setprofile(None)
print(*entered)
"""
    run = subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests")])},
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stderr
    entered = set(run.stdout.split())
    assert root in entered
    assert entered <= set(provenance.closure(root))


@pytest.mark.parametrize(
    "root",
    [
        *RUNS,
        "reference.exact.solve",
        "reduced.rounding.sampled",
        "reduced.rom.sweep",
        "reduced.certificate.certify",
        *(data.compute for study in studies().values() for data in study.datasets.values()),
    ],
)
def test_what_computes_depends_neither_on_figures_nor_on_reading_the_configuration(root):
    closure = provenance.closure(root)
    assert root in closure
    assert not [name for name in closure if name.startswith(("figures", "config", "paper"))]
    assert not [name for name in closure if name.endswith((".STUDY", "dataset.VARIABLES"))]


def test_imports_of_every_form_are_found(package, tmp_path):
    for name, text in {
        "a": "from sphpod import b\ndef anything():\n    b.thing()\ndef other():\n    b.other()",
        "b": "from sphpod.c import something as thing\nother = 1",
        "c": "def something():\n    import sphpod.d\n    return sphpod.d",
        "d": "from sphpod.e import value as e, unused\nall_of_it = e",
        "e": "value = [0]\nvalue[0] = seen = 1\nunused = 2\nif seen:\n    late = 3",
    }.items():
        (package / f"{name}.py").write_text(text)
    script = tmp_path / "script.py"
    script.write_text("from sphpod.a import anything\nanything()")
    expected = ("a.anything", "c.something", "d.all_of_it", "e.late", "e.seen", "e.value")
    assert provenance.closure(script) == ("__init__.__version__", *expected)
    assert provenance.closure("a.anything") == provenance.closure(script)
    other = tmp_path / "other.py"
    other.write_text("import numpy")
    assert provenance.closure(other) == ("__init__.__version__",)


def test_unknown_functions_are_refused():
    for root in ("full.sph.solves", "full.spf.solve", "solve", "full.sph"):
        with pytest.raises(ValueError, match=f"^{root}: sphpod has no such function$"):
            provenance.digest(root)


@pytest.mark.slow
def test_comments_docstrings_and_layout_do_not_count(package):
    before = digest("sph")
    sph = package / "full" / "sph.py"
    text = sph.read_text()
    assert text.startswith('"""')
    sph.write_text(text.replace('"""', '"""Another beginning. ', 1) + "\n\n\n# And an end.\n")
    assert digest("sph") == before
    kernel = package / "scene" / "kernel.py"
    kernel.write_text(kernel.read_text() + '\n\ndef more():\n    """Nobody calls it."""\n')
    assert digest("sph") == before
    scene = package / "scene" / "scene.py"
    told = '"""Stands for a damping that a scene does not have."""'
    assert told in scene.read_text()
    scene.write_text(scene.read_text().replace(told, '"""What a value behind it is told as."""'))
    assert digest("sph") == before


def test_code_counts_where_it_is_used(package):
    scripts = ("sph", "pod", "figure")
    before = [digest(script) for script in scripts]
    pod = package / "reduced" / "pod.py"
    text = pod.read_text()
    assert "def modes(" in text
    pod.write_text(text.replace("def modes(", "def modes(more=1, *, "))
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


@pytest.mark.slow
def test_the_script_counts_but_neither_its_place_nor_its_words_nor_its_date(tmp_path):
    scripts = ROOT / "workflow" / "scripts"
    script = tmp_path / "sph.py"
    text = (scripts / "sph.py").read_text()
    script.write_text(text)
    before = digest_of(script)
    assert digest_of(scripts / "sph.py") == before
    os.utime(script, (0, 0))
    assert digest_of(script) == before
    script.write_text(text.replace('"""', '"""Told otherwise. ', 1) + "# And an end.\n")
    assert digest_of(script) == before
    script.write_text(text.replace("Full SPH of", "The full SPH of"))
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
