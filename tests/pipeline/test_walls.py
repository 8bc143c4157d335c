"""Edits that change no number make nothing anew that computes or measures."""

import shutil

import pytest

from sphpod.pipeline import provenance
from sphpod.studies.study import studies

pytestmark = pytest.mark.slow

COMPUTED = {
    "full.sph.solve",
    "full.lifted.solve",
    "numerics.error.table",
    "reference.reference.solve_paper",
    "reference.reference.solve_centred",
    "reference.exact.solve",
    "reference.exact.solve_modified",
    "reduced.rounding.sampled",
    "reduced.pod.decompose",
    "reduced.lifted_rom.decompose",
    "reduced.rom.sweep",
    "reduced.rom.accelerate",
    "reduced.lifted_rom.repeat_sph",
    "reduced.certificate.certify",
    *(data.compute for study in studies().values() for data in study.datasets.values()),
}
"""Functions of rules that compute or measure."""

EDITS = {
    "a variable of a new study": (
        "pipeline/dataset.py",
        "\nt (t) [s]: time\n",
        "\nt (t) [s]: time\nnew (t) [1]: what a new study computes\n",
    ),
    "the meaning of a variable": ("pipeline/dataset.py", "strain of the particles", "strain"),
    "the meaning of a study's variable": (
        "studies/growth.py",
        "time over which explicit Euler runs",
        "time that explicit Euler runs over",
    ),
    "a warning": (
        "scene/waves.py",
        "explicit Euler lets the energy",
        "Euler's steps let the energy",
    ),
    "a refusal": ("scene/checks.py", "would let waves grow", "lets waves grow"),
    "what is allowed": ("scene/checks.py", "at least 5 particles", "5 or more particles"),
    "a breakdown": ("scene/breakdown.py", "broke down by t =", "has broken down by t ="),
    "a column of a table of times": (
        "studies/cpu_time.py",
        '        "cpu_seconds_median": median,\n        "cpu',
        '        "fastest": lower,\n        "cpu_seconds_median": median,\n        "cpu',
    ),
    "a label of a table": ("studies/time_steps.py", '"growth_rate [1/s]"', '"growth rate [1/s]"'),
    "a caption": ("studies/smoothing.py", "What the smoothing length changes", "Smoothing lengths"),
    "a figure": ("figures/plotting.py", "COLUMN_WIDTH = ", "WIDE = COLUMN_WIDTH = "),
    "a log's words": ("reduced/rom.py", "%d modes asked for", "%d modes are asked for"),
}


def digest():
    """Of all functions together, which holds what that of any of them holds."""
    for cached in (
        provenance.digest,
        provenance._module,
        provenance._uses,
        provenance._structure_of,
    ):
        cached.cache_clear()
    return provenance.digest(*sorted(COMPUTED))


@pytest.fixture(scope="module")
def before():
    return digest()


@pytest.mark.parametrize("edit", EDITS)
def test_it_makes_nothing_anew(before, package, edit):
    place, old, new = EDITS[edit]
    path = package / place
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    assert digest() == before


def test_a_new_study_makes_nothing_anew(before, package):
    shutil.copy(package / "studies/observed_order.py", package / "studies/another_order.py")
    assert digest() == before


def test_what_computes_counts(before, package):
    path = package / "full/lifted.py"
    path.write_text(path.read_text().replace("FIELDS_AT_ONCE = ", "FIELDS_AT_ONCE = 2 * "))
    assert digest() != before
