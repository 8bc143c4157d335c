"""Claims: every criterion can hold and fail, and what cannot be decided is refused beforehand."""

import copy
import inspect
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sphpod.config import config, configuration
from sphpod.paper import claims, criteria

ROOT = Path(__file__).parents[2]

PAPER = config.load([ROOT / "config" / "config.yaml"])
SMALL = config.load([ROOT / "config" / "small.yaml"])

ERRORS = {
    "solution": np.array(["sph", "fd"]),
    "reference": np.array(["fd", "exact"]),
    "velocity_error": np.array([[0.10, 0.20], [np.nan, 0.01]]),
    "density_error": np.array([[0.01, 0.02], [np.nan, 0.001]]),
}


def sweep(velocity, density=None):
    """A sweep from k = 1 on; density errors are a tenth of the velocity errors unless given."""
    velocity = np.array(velocity, dtype=float)
    return {
        "mode_count": np.arange(1, velocity.size + 1),
        "velocity_error_sph": velocity,
        "density_error_sph": velocity / 10 if density is None else np.array(density, dtype=float),
    }


def place(**datasets):
    return {"errors": ERRORS, **datasets}


def decide(kind, *places, paper="yes", tolerance=0, **thresholds):
    claim = {"paper": paper, "tolerance": tolerance}
    return criteria.CRITERIA[kind].decide(list(places), claim, **thresholds)


# Criteria -----------------------------------------------------------------------------------------


@given(st.floats(1e-6, 1e6), st.floats(-0.1, 0.1), st.floats(0, 0.1).filter(lambda t: t != 0))
def test_a_number_agrees_when_its_relative_difference_is_within_the_tolerance(
    paper, difference, tolerance
):
    finding = criteria.compared(paper * (1 + difference), {"paper": paper, "tolerance": tolerance})
    assert finding.difference == pytest.approx(difference, abs=1e-12)
    if abs(abs(difference) - tolerance) > 1e-12:
        assert finding.holds == (abs(difference) < tolerance)


def test_what_claims_need_is_known_without_what_decides_on_them():
    code = "import sys, sphpod.paper.claims; assert 'scipy.interpolate' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)


def test_sph_error_reads_the_named_reference():
    assert decide("sph_error", place(), paper=0.1, field="velocity", reference="fd").holds
    assert decide("sph_error", place(), paper=0.02, field="density", reference="exact").holds
    wrong = decide("sph_error", place(), paper=0.1, field="velocity", reference="exact")
    assert not wrong.holds
    assert wrong.difference == pytest.approx(1)


@pytest.mark.parametrize(
    ("kind", "ratio", "paper"),
    [
        ("derivative_coefficient", 1.2, 8 / 1.2**2 - 12 / 1.2**3 + 5 / 1.2**4),
        ("dispersion_coefficient", 1.04, 16 / 3 / 1.04**2 - 10 / 1.04**3 + 29 / 6 / 1.04**4),
    ],
)
def test_coefficients_are_those_of_appendix_b(kind, ratio, paper):
    assert decide(kind, paper=paper, tolerance=1e-12, smoothing_ratio=ratio).holds
    assert not decide(kind, paper=paper, tolerance=1e-3, smoothing_ratio=ratio - 0.15).holds


def test_mixing_matrix_comes_from_the_exact_velocity():
    t, x = np.linspace(0, 1, 11), np.arange(20) * 0.1
    waves = np.sin(np.pi * np.outer([1, 2], x))  # L = 2
    coefficients = np.array([np.cos(3 * t), 2 * np.cos(6 * t)])
    data = {
        "exact": {"x": x, "t": t, "velocity": coefficients.T @ waves},
        "snapshots": {"velocity_time": np.array([0, 0.4, 0.7])},
    }
    expected = np.linalg.svd(coefficients[:, [0, 4, 7]])[0]
    for signs in ([1, 1], [-1, 1], [-1, -1]):
        paper = (expected * signs).tolist()
        assert decide("mixing_matrix", data, paper=paper, tolerance=1e-9, harmonics=2).holds
    wrong = expected[:, ::-1].tolist()
    assert not decide("mixing_matrix", data, paper=wrong, tolerance=1e-2, harmonics=2).holds


@given(st.lists(st.sampled_from([0.05, 0.1, 0.5, np.inf]), min_size=1, max_size=8))
def test_works_from_is_the_smallest_count_behind_which_nothing_fails(errors):
    good = [error < 0.1 for error in errors]
    working = [k for k in range(1, len(errors) + 1) if all(good[k - 1 :])]
    paper = min(working, default=1)
    finding = decide("works_from", place(sweep=sweep(errors)), paper=paper)
    assert finding.holds == bool(working)
    assert finding.measured == (min(working) if working else "none")


def test_works_from_needs_both_fields_and_all_places():
    both = place(sweep=sweep([0.5, 0.05, 0.05]))
    later = place(sweep=sweep([0.5, 0.05, 0.05], [0.5, 0.5, 0.005]))
    never = place(sweep=sweep([0.5, 0.5, 0.5]))
    assert decide("works_from", both, both, paper=2).holds
    assert decide("works_from", later, paper=3).holds
    mixed = decide("works_from", both, later, never, paper=2)
    assert not mixed.holds
    assert mixed.measured == "2, 3, none"


def test_smallest_working_count_needs_one_mode_count_only():
    places = [
        place(sweep=sweep(errors), snapshots={"velocity_time": np.arange(count)})
        for count, errors in (
            (3, [1, 1, 1]),
            (4, [1, 0.05, 1, 1]),
            (5, [1, 0.05, 0.05, 0.05, 0.05]),
        )
    ]
    assert decide("smallest_working_count", *places, paper=4).holds
    assert not decide("smallest_working_count", *places, paper=5).holds
    assert not decide("smallest_working_count", places[0], paper=3).holds


@pytest.mark.parametrize(
    ("velocity", "density", "works"),
    [
        ([0.5, 0.09, 0.5], [0.05, 0.009, 0.05], True),
        ([0.05, 0.5], [0.5, 0.005], False),  # never both at once
        ([np.inf, 0.1], [np.inf, 0.001], False),  # as large is not below
    ],
)
def test_works_for_some_and_for_none_exclude_each_other(velocity, density, works):
    data = place(sweep=sweep(velocity, density))
    assert decide("works_for_some", data).holds is works
    assert decide("works_for_none", data).holds is not works


def test_works_with_all_counts_the_modes_too():
    pod = {"velocity_singular_values": np.ones(3), "density_singular_values": np.ones(4)}
    good = place(sweep=sweep([1, 1, 1, 0.05]), pod=pod)
    bad = place(sweep=sweep([0.05, 0.05, 0.05, 0.2]), pod=pod)
    assert decide("works_with_all", good, velocity_modes=3, density_modes=4).holds
    assert not decide("works_with_all", good, velocity_modes=4, density_modes=4).holds
    assert not decide("works_with_all", bad, velocity_modes=3, density_modes=4).holds


def test_error_drop_holds_for_all_larger_counts():
    drop = {"after": 2, "begin": 3, "factor": 5}
    assert decide("error_drop", place(sweep=sweep([1, 1, 0.1, 0.2])), **drop).holds
    assert not decide("error_drop", place(sweep=sweep([1, 1, 0.1, 0.3])), **drop).holds
    density = [1, 1, 1, 0.1]
    assert not decide("error_drop", place(sweep=sweep([1, 1, 0.1, 0.1], density)), **drop).holds


def test_singular_value_groups():
    limits = {"field": "velocity", "size": 2, "groups": 2, "within": 10, "between": 10}
    for values, holds in (
        ([100, 50, 2, 1, 0.01], True),
        ([100, 5, 0.2, 0.1, 0.001], False),  # falls too far within the first group
        ([100, 50, 20, 10, 0.1], False),  # too little behind it
    ):
        data = {"pod": {"velocity_singular_values": np.array(values)}}
        assert decide("singular_value_groups", data, **limits).holds is holds


def test_uniform_mode():
    limits = {"field": "density", "spread": 0.05, "dominance": 10}
    flat = 1 + 0.02 * np.sin(np.linspace(0, 6, 50))
    for mode, values, holds in (
        (flat, [100, 1], True),
        (-flat, [100, 1], True),
        (flat + np.linspace(0, 0.1, 50), [100, 1], False),
        (flat, [5, 1], False),
    ):
        pod = {"density_modes": np.array([mode]), "density_singular_values": np.array(values)}
        assert decide("uniform_mode", {"pod": pod}, **limits).holds is holds


def test_singular_value_drop_is_the_steepest():
    limits = {"field": "velocity", "after": 3, "similar": 10, "drop": 2, "among": 5}
    for values, holds in (
        ([10, 9, 8, 2, 1, 0.5], True),
        ([100, 9, 8, 2, 1, 0.5], False),  # not similar
        ([10, 9, 8, 5, 4, 3], False),  # no drop
        ([10, 9, 8, 2, 1, 0.01], False),  # a steeper one behind
    ):
        data = {"pod": {"velocity_singular_values": np.array(values)}}
        assert decide("singular_value_drop", data, **limits).holds is holds


def test_calmer_half_looks_at_size_and_frequency():
    x = np.arange(200) / 100  # L = 2
    left = x < 1

    def modes(amplitude, waves):
        rows = [
            np.where(left, np.sin(4 * n * np.pi * x), amplitude * np.sin(4 * waves * n * np.pi * x))
            for n in (1, 2, 3)
        ]
        return {"pod": {"x": x, "velocity_modes": np.array(rows)}}

    limits = {"field": "velocity", "modes": 3, "amplitude": 0.9, "crossings": 0.9}
    halves = {"first": [0, 0.5], "second": [0.5, 1]}
    swapped = {"first": [0.5, 1], "second": [0, 0.5]}
    assert decide("calmer_half", modes(0.5, 0.5), **limits, **halves).holds
    assert not decide("calmer_half", modes(0.5, 0.5), **limits, **swapped).holds
    assert not decide("calmer_half", modes(1, 0.5), **limits, **halves).holds
    assert not decide("calmer_half", modes(0.5, 1), **limits, **halves).holds


FROZEN = ("frozen1", "frozen2", "frozen10")


def study(velocity, density):
    """Errors of the original, linearized and frozen models; k = 4 and 8 are the columns."""
    return {
        "contender": np.array(["original", "linearized", *FROZEN]),
        "n_freeze": np.array([0, 0, 1, 2, 10]),
        "mode_count": np.array([4, 8]),
        "acceleration_velocity_error": np.array(velocity),
        "acceleration_density_error": np.array(density),
    }


RISING = study(
    [[0.05, 0.01], [0.2, 0.02], [0.05, 0.01], [0.06, 0.02], [0.07, 0.03]],
    [[0.005, 0.001], [0.02, 0.002], [0.005, 0.001], [0.005, 0.001], [0.0051, 0.001]],
)


def test_error_below_and_above_are_about_both_fields_and_all_counts():
    data = place(acceleration=RISING)
    assert decide("error_below", data, method="frozen10", mode_counts=[4, 8], factor=1).holds
    assert not decide("error_below", data, method="frozen10", mode_counts=[4, 8], factor=0.6).holds
    assert decide("error_above", data, method="linearized", mode_counts=[4], factor=1).holds
    assert not decide("error_above", data, method="linearized", mode_counts=[4, 8], factor=1).holds
    mixed = study([[0.2, 0.2]] * 5, [[0.001, 0.001]] * 5)
    for kind in ("error_below", "error_above"):
        data = place(acceleration=mixed)
        assert not decide(kind, data, method="original", mode_counts=[4], factor=1).holds


def test_freezing_effect():
    limits = {"mode_counts": [4, 8], "rising": "velocity", "steady": "density"}
    data = {"acceleration": RISING}
    assert decide("freezing_effect", data, **limits, rise=0.1, spread=0.1).holds
    assert not decide("freezing_effect", data, **limits, rise=0.5, spread=0.1).holds
    assert not decide("freezing_effect", data, **limits, rise=0.1, spread=0.01).holds
    dip = copy.deepcopy(RISING)
    dip["acceleration_velocity_error"][3, 1] = 0.009  # not from each model to the next
    assert not decide(
        "freezing_effect", {"acceleration": dip}, **limits, rise=0.1, spread=0.1
    ).holds


def cpu_time(lists=1.0, stencil=0.5, original=0.8, frozen=(0.3, 0.2, 0.1)):
    """Times of one mode count, with an outlier that a median does not see."""
    seconds = np.array([lists, stencil, original, original, *frozen])
    return {
        "cpu_time": {
            "contender": np.array([*criteria.BASELINES, "original", "linearized", *FROZEN]),
            "contender_mode_count": np.array([0, 0, 4, 4, 4, 4, 4]),
            "n_freeze": np.array([0, 0, 0, 0, 1, 2, 10]),
            "cpu_seconds": np.outer(seconds, [1, 1, 100]),
        }
    }


def test_cpu_time_saved_is_compared_with_the_papers_within_a_part_of_the_full_model():
    """Against neighbour lists it is 90 % here, whatever it is against the stencil."""

    def found(spread, **times):
        options = {"method": "frozen10", "mode_counts": [4], "spread": spread}
        return decide("cpu_time_saved", cpu_time(**times), paper="80%", **options)

    assert found(0.11).holds
    assert not found(0.09).holds
    assert found(0.11, stencil=0.05).holds
    assert found(0.11).difference == pytest.approx(0.9 / 0.8 - 1)


@pytest.mark.parametrize(
    ("seconds", "holds"), [(([4, 4, 4], [3, 3, 3]), True), (([3, 3, 3], [4, 4, 4]), False)]
)
def test_cpu_time_falls_beyond_the_quartiles(seconds, holds):
    times = {
        "contender": np.array(["sph_stencil", "frozen1", "frozen10"]),
        "contender_mode_count": np.array([0, 4, 4]),
        "n_freeze": np.array([0, 1, 10]),
        "cpu_seconds": np.array([[5, 5, 5], *seconds], float),
    }
    assert decide("cpu_time_falls", {"cpu_time": times}, mode_counts=[4]).holds is holds
    # What the repeats do not tell apart is no reason to say no, but the ends must differ.
    tied = times | {"n_freeze": np.array([0, 1, 2]), "contender": np.array(["a", "f1", "f2"])}
    tied["cpu_seconds"] = np.array([[5, 5, 5], [3.1, 3.2, 3.4], [3.0, 3.1, 3.3]])
    assert decide("cpu_time_falls", {"cpu_time": tied}, mode_counts=[4]).holds


def test_cpu_time_alike_means_both_baselines_and_all_places():
    limits = {"methods": ["original", "linearized"], "factor": 2}
    assert decide("cpu_time_alike", cpu_time(), cpu_time(original=1), **limits).holds
    assert not decide("cpu_time_alike", cpu_time(), cpu_time(original=1.1), **limits).holds
    assert not decide("cpu_time_alike", cpu_time(stencil=2), **limits).holds


# Configurations -----------------------------------------------------------------------------------


def test_the_paper_has_99_claims():
    numbers = {"E": 18, "A": 5, "T": 20, "S": 19, "M": 37}
    expected = [
        f"{letter}{n:02d}" for letter, count in numbers.items() for n in range(1, count + 1)
    ]
    resolved = claims.resolve(PAPER)
    assert [claim["id"] for claim in resolved] == expected
    assert json.loads(json.dumps(resolved)) == resolved  # Snakemake keeps plain types only
    for claim in resolved:
        assert claim["section"]
        assert "{" not in claims.statement(claim)


def test_inputs_are_results_of_the_configuration():
    paths = claims.inputs(claims.resolve(PAPER))
    assert len(paths) == len(set(paths))
    assert "two_moduli/errors.nc" in paths
    assert "three_harmonics/random100_3/original/k1-20.nc" in paths
    assert "damped/uniform12/cpu_time.nc" in paths
    assert claims.inputs(claims.resolve({**PAPER, "claims": []})) == []


def test_printed_errors_must_come_out_to_half_their_last_digit():
    printed = [claim for claim in PAPER["claims"] if claim["id"].startswith("E")]
    for claim in printed:
        half = 0.5 * 10.0 ** (np.floor(np.log10(claim["paper"])) - 3)
        assert claim["tolerance"] * claim["paper"] == pytest.approx(half, rel=5e-3)


def test_the_schema_knows_every_criterion_and_threshold():
    schema = configuration.schema()["$defs"]["Criterion"]["properties"]
    assert schema["kind"]["enum"] == sorted(criteria.CRITERIA)
    thresholds = {
        name
        for kind in criteria.CRITERIA.values()
        for name in list(inspect.signature(kind.decide).parameters)[2:]
    }
    assert set(schema) == thresholds | {"kind", "samplings", "studies", "places"}


def test_every_criterion_tells_its_thresholds():
    for name, kind in criteria.CRITERIA.items():
        for threshold in list(inspect.signature(kind.decide).parameters)[2:]:
            assert f"{{{threshold}}}" in kind.text, (name, threshold)
        if kind.paper in ("a number", "a matrix") and "smallest" not in kind.text:
            assert "{tolerance}" in kind.text, name


def refused(**changes):
    """The sentence on a claim of the small configuration, with some of its entries changed."""
    claim = {
        "id": "T01",
        "scene": "waves",
        "sampling": "uniform10",
        "claim": "",
        "paper": "yes",
        "criterion": {"kind": "works_for_some"},
    } | changes
    with pytest.raises(config.ConfigError) as error:
        claims.resolve({**SMALL, "claims": [claim]})
    assert "\n" not in str(error.value)
    return str(error.value)


def below(**changes):
    return {"kind": "error_below", "method": "frozen5", "mode_counts": [4], "factor": 1} | changes


def sizes(**changes):
    common = {"kind": "singular_value_drop", "field": "velocity", "similar": 1, "drop": 1}
    return common | {"after": 2, "among": 4} | changes


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"scene": "wave"}, ["claim T01", "scene = wave", "allowed are waves, damped_forced"]),
        ({"sampling": "uniform11"}, ["sampling = uniform11", "of scene waves", "uniform10"]),
        ({"sampling": None}, ["sampling = (missing)", "uniform10"]),
        (
            {"criterion": {"kind": "sph_error", "field": "velocity", "reference": "x"}, "paper": 1},
            ["reference = x", "fd, exact, modified"],
        ),
        (
            {"scene": "graded", "sampling": "random12", "criterion": {"kind": "mixing_matrix",
             "harmonics": 1}, "paper": [[1]]},
            ["reference = exact", "of scene graded", "centred"],
        ),
        ({"criterion": below(method="frozen2")}, ["method = frozen2", "frozen1, frozen5"]),
        ({"criterion": below(mode_counts=[4, 5])}, ["mode_counts = 5", "allowed are 4"]),
        (
            {"scene": "graded", "sampling": "random12", "criterion": below()},
            ["sampling = random12", "acceleration study", "none"],
        ),
        (
            {"criterion": {"kind": "error_drop", "after": 11, "begin": 2, "factor": 2}},
            ["after = 11", "allowed are 1, 2, 3"],
        ),
        ({"criterion": {"kind": "works_for_some", "factor": 2}}, ["criterion.factor = 2"]),
        ({"criterion": {"kind": "error_drop", "after": 1, "begin": 2}}, ["factor", "(missing)"]),
        (
            {"criterion": {"kind": "derivative_coefficient", "smoothing_ratio": 1.2, "samplings":
             ["x"]}, "paper": 1},
            ["criterion.samplings", "no such key"],
        ),
        ({"criterion": sizes(among=10)}, ["among = 10", "11 modes", "uniform10 gives 10"]),
        ({"criterion": {"kind": "works_from"}}, ["paper = yes", "a number"]),
        (
            {"criterion": {"kind": "sph_errors_larger", "places": ["waves"]}},
            ["criterion.places", "sph_errors_larger looks at 2 of them, not 1"],
        ),
        ({"paper": 7}, ["paper = 7", "it must be yes"]),
        ({"criterion": {"kind": "works_from"}, "paper": 0}, ["paper = 0"]),
        (
            {"criterion": {"kind": "mixing_matrix", "harmonics": 2}, "paper": [[1, 2], [3]]},
            ["a matrix of 2 by 2 numbers"],
        ),
        (
            {"criterion": {"kind": "cpu_time_saved", "method": "frozen5", "mode_counts": [4],
                           "spread": 0.2}, "paper": "half"},
            ["paper = half", "a percentage"],
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_decided_is_refused_in_one_sentence(changes, words):
    sentence = refused(**changes)
    for word in words:
        assert word in sentence


def test_two_claims_of_one_id_are_refused():
    twice = {**SMALL, "claims": [SMALL["claims"][0]] * 2}
    with pytest.raises(config.ConfigError, match="E01: this id stands twice"):
        claims.resolve(twice)


def test_the_page_on_the_paper_has_all_claims_as_configured():
    page = (ROOT / "docs" / "reproducing-the-paper.md").read_text(encoding="utf-8")
    lines = {line.split(" | ")[0].strip("| "): line for line in page.splitlines()}
    for claim in claims.resolve(PAPER):
        cells = [cell.strip() for cell in lines[claim["id"]].strip("|").split(" | ")]
        assert cells[1].startswith(claim["claim"])
        assert cells[2] == claims.statement(claim)
        erratum = f" with erratum {claim['erratum']}" if "erratum" in claim else ""
        assert cells[-1] in (f"reproduced{erratum}", "**deviates**")


@pytest.mark.parametrize("claim", [claim for claim in PAPER["claims"] if "erratum" in claim])
def test_without_its_erratum_a_number_fails(claim):
    """As the page shows, one row a convention: scene, number, paper, with, without, variant."""
    page = (ROOT / "docs" / "reproducing-the-paper.md").read_text(encoding="utf-8")
    rows = [line.strip("| ").split(" | ") for line in page.splitlines() if line.startswith("| ")]
    without = [
        float(numbers[1])
        for row in rows
        if len(row) == 7 and row[1] == f"`{claim['scene']}`"
        for numbers in zip(row[3].split(" / "), row[5].split(" / "), strict=False)
        if numbers[0] == f"{claim['paper']:.3e}"
    ]
    assert without
    assert all(abs(n / claim["paper"] - 1) > claim["tolerance"] for n in without)


# Tables -------------------------------------------------------------------------------------------

TABLE = [
    {"id": "E01", "section": "3.1", "scene": "waves", "claim": "v", "paper": 0.1, "tolerance": 1e-3,
     "criterion": {"kind": "sph_error", "field": "velocity", "reference": "fd"}},
    {"id": "T01", "scene": "waves", "sampling": "uniform10", "claim": "words", "paper": "yes",
     "criterion": [{"kind": "works_for_some"}, {"kind": "works_for_none"}]},
    {"id": "A01", "claim": "a | b", "paper": 1.003, "tolerance": 1e-6,
     "criterion": {"kind": "derivative_coefficient", "smoothing_ratio": 1.04}},
]  # fmt: skip


def read(path):
    found = sweep([1, 0.05]) | {"modes_resolved": np.array([1, 0], np.int8)}
    return ERRORS if path == "waves/errors.nc" else found


def test_a_row_holds_what_the_paper_says_and_what_was_found():
    resolved = claims.resolve({**SMALL, "claims": TABLE})
    error, words, coefficient = claims.table(resolved, read)
    for row in (error, words, coefficient):
        assert tuple(row) == claims.COLUMNS
    assert error["reproduced"] == error["paper"] == 0.1
    assert error["relative_difference"] == 0
    assert error["sampling"] == ""
    assert error["verdict"] == "reproduced"
    assert words["reproduced"].startswith("no: ")  # one of two criteria fails
    assert words["relative_difference"] is None
    assert words["tolerance"] is None
    assert words["verdict"] == coefficient["verdict"] == "deviates"
    assert coefficient["scene"] == coefficient["section"] == ""
    assert [row["near_rounding"] for row in (error, words, coefficient)] == ["", "2", ""]


def test_the_table_for_reading_has_a_line_a_claim():
    resolved = claims.resolve({**SMALL, "claims": TABLE})
    lines = claims.markdown(claims.table(resolved, read)).splitlines()
    assert len(lines) == 2 + len(TABLE)
    assert lines[2].startswith(
        "| E01 | v (waves) | relative L2 error of full SPH in velocity against fd"
    )
    assert lines[3].endswith("| **deviates** |")
    assert "a \\| b" in lines[4]
