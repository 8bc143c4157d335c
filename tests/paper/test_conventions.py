"""Conventions: other time steppings are what they are called, and every erratum has a number."""

import copy
from pathlib import Path

import numpy as np
import pytest
import scenes

from sphpod.config import config, mode_counts
from sphpod.full import sph
from sphpod.numerics import error
from sphpod.paper import conventions, paper
from sphpod.reduced import pod, rom, snapshots
from sphpod.reference import exact, reference
from sphpod.scene import kernel
from sphpod.scene.scene import Scene

ROOT = Path(__file__).parents[2]
PAPER = config.load([ROOT / "config" / "config.yaml"])
SMALL = config.load([ROOT / "config" / "small.yaml"])

VARIED = {key: value for key, value in scenes.VARIED.items() if key != "force"}


# Other time steppings -----------------------------------------------------------------------------


def distance(a, b):
    return max(error.relative_error(a[field], b[field]) for field in ("velocity", "density"))


@pytest.mark.slow
@pytest.mark.parametrize("changes", [{}, VARIED, {"smoothing_ratio": 1.7}])
def test_euler_is_the_time_stepping_of_full_sph(changes):
    scene = scenes.scene(**changes)
    solution = conventions.solve_otherwise(scene, conventions.EULER)
    assert distance(solution, sph.solve(scene, scene.error_steps)) < 1e-12


@pytest.mark.parametrize(
    ("stepping", "order"),
    [
        (conventions.EULER, 1),
        (conventions.VELOCITY_FIRST, 1),
        (conventions.DENSITY_FIRST, 1),
        (conventions.IMPLICIT_DAMPING, 1),
        (conventions.HEUN, 2),
    ],
)
def test_time_steppings_converge_to_one_solution(stepping, order):
    fine = conventions.solve_otherwise(scenes.scene(**VARIED, time_step=1e-5), conventions.HEUN)
    coarse, halved = (
        distance(conventions.solve_otherwise(scenes.scene(**VARIED, time_step=dt), stepping), fine)
        for dt in (2e-3, 1e-3)
    )
    assert np.log2(coarse / halved) == pytest.approx(order, abs=0.15)


def test_linear_density_is_another_equation():
    scene = scenes.scene(initial_velocity="0.05*sin(2*pi*x/L)")
    usual, linear = (
        conventions.solve_otherwise(scene, stepping)
        for stepping in (conventions.EULER, conventions.LINEAR_DENSITY)
    )
    assert distance(usual, linear) > 1e-2
    # ∂ρ/∂t = -ρ0 ∂v/∂x: the mean of the density stays
    assert linear["density"].mean(axis=1) == pytest.approx(1, abs=1e-13)
    assert np.abs(usual["density"].mean(axis=1) - 1).max() > 1e-3


def test_implicit_damping_divides_where_explicit_damping_subtracts():
    scene = scenes.scene(initial_velocity=1, damping=3)
    steps = scene.error_steps
    for stepping, factor in (
        (conventions.IMPLICIT_DAMPING, 1 / (1 + 3 * scene.time_step)),
        (conventions.EULER, 1 - 3 * scene.time_step),
    ):
        velocity = conventions.solve_otherwise(scene, stepping)["velocity"]
        assert velocity == pytest.approx(np.outer(factor**steps, np.ones(40)), rel=1e-12)


def test_a_field_is_shifted_by_a_fraction_of_a_cell():
    x = np.arange(20) / 20

    def field(x):
        return np.array([2 + np.sin(2 * np.pi * x), np.cos(6 * np.pi * x)])

    shifted = conventions._shifted(field(x), -1 / 4)
    assert shifted == pytest.approx(field(x + 1 / 80), abs=1e-13)


def test_between_1_and_three_halves_dispersion_grows_and_beta_is_1_at_two_ratios():
    ratios = np.linspace(1.001, 1.499, 499)
    dispersion = [kernel.dispersion_coefficient(ratio) for ratio in ratios]
    beta = np.array([kernel.derivative_coefficient(ratio) for ratio in ratios])
    assert np.all(np.diff(dispersion) > 0)
    assert ratios[np.abs(beta - 1).argmax()] == pytest.approx(1.25, abs=1e-3)
    assert np.count_nonzero(np.diff(np.sign(beta - 1))) == 1
    for ratio in (1, np.sqrt(6) - 1):
        assert kernel.derivative_coefficient(ratio) == pytest.approx(1, abs=1e-14)


# The paper's study, cut down to a moment ----------------------------------------------------------


def cut_down():
    """The paper's configuration with fewer particles, steps and seconds."""
    study = copy.deepcopy(PAPER)
    for settings in study["scenes"].values():
        settings |= {"duration": 4, "particle_count": 40, "time_step": 2e-3, "error_interval": 0.02}
    return study


@pytest.fixture(scope="module")
def results():
    """All that the studies may read, by path, as the workflow would make it."""
    study, found = cut_down(), {}
    solvers = {"fd": reference.solve_paper, "exact": exact.solve, "modified": exact.solve_modified}
    for name, settings in study["scenes"].items():
        scene, kinds = Scene.from_settings(name, settings), settings["references"]
        full = sph.solve(scene, np.arange(scene.step_count + 1))
        samples = {field: full[field][scene.error_steps] for field in paper.FIELDS}
        solved = {kind: solvers[kind](scene) for kind in kinds}
        found[f"{name}/sph.nc"] = samples
        found |= {f"{name}/reference_{kind}.nc": solved[kind] for kind in kinds}
        everything = {"sph": samples, **solved}
        found[f"{name}/errors.nc"] = {
            "solution": np.array(list(everything)),
            "reference": np.array(kinds),
        } | {
            f"{field}_error": np.array(
                [
                    [error.relative_error(a[field], solved[kind][field]) for kind in kinds]
                    for a in everything.values()
                ]
            )
            for field in paper.FIELDS
        }
        for sampling in paper.NEEDED.get(name, ()):
            taken = snapshots.extract(scene, settings["samplings"][sampling], full)
            found[f"{name}/{sampling}/snapshots.nc"] = taken
            modes = pod.decompose(taken)
            counts = settings["samplings"][sampling]["mode_counts"]
            found[f"{name}/{sampling}/original/k{counts}.nc"] = rom.sweep(
                scene, "original", mode_counts.parse_modes(counts), modes, samples, samples
            )
    return study, found


@pytest.fixture(scope="module")
def table(results):
    """Rows of the studies, and the paths that they read."""
    study, found = results
    asked = []

    def read(path, *names):
        asked.append(path)
        return {name: found[path][name] for name in names or found[path]}

    rows = conventions.table(study, read)
    errors = paper.reference_errors(study, read)
    return rows, errors, asked


def test_the_studies_read_their_inputs_and_nothing_else(results, table):
    study, _ = results
    assert sorted(set(table[2])) == sorted(paper.inputs(study))


def test_every_erratum_has_a_number(table):
    rows, _, _ = table
    assert {row.erratum for row in rows if row.erratum} == set(range(1, 14))
    for row in rows:
        assert row.convention
        assert row.variant
        assert row.with_convention is None or np.isfinite(row.with_convention)


def test_a_change_changes_the_number(table):
    for row in table[0]:
        if row.quantity == "smallest number that works":  # a count, here of too few steps
            continue
        if (row.scene, row.quantity) == ("damped_forced", "error of ρ against fd"):
            continue  # a uniform force moves no density
        assert row.with_convention != pytest.approx(row.without_convention, rel=1e-6), row


def test_with_the_convention_stands_what_the_results_hold(results, table):
    study, found = results
    for row in table[0]:
        if row.quantity.startswith("error of v against "):
            errors = found[f"{row.scene}/errors.nc"]
            column = list(errors["reference"]).index(row.quantity.split()[-1])
            assert row.with_convention == errors["velocity_error"][0, column]
            if column == 0 and study["scenes"][row.scene]["references"][0] == "fd":
                assert row.paper is not None


def test_reference_errors_stand_beside_those_of_sph(table):
    _, errors, _ = table
    assert len(errors) == 2 * len(PAPER["scenes"])
    for row in errors:
        if row.reference == "exact":
            assert row.reference_against_exact is None
            assert row.sph_against_exact == row.sph_against_reference
        else:
            triangle = row.sph_against_reference + 1.1 * row.reference_against_exact
            assert row.sph_against_exact < triangle


# Configurations -----------------------------------------------------------------------------------


def test_the_studies_apply_to_the_paper_alone():
    assert paper.applies(PAPER)
    assert not paper.applies(SMALL)
    for scene, key, names in (
        ("damped", "references", ["exact"]),
        ("ten_harmonics", "samplings", {}),
    ):
        changed = copy.deepcopy(PAPER)
        changed["scenes"][scene][key] = names
        assert not paper.applies(changed)


def test_the_paper_prints_what_the_claims_say():
    study = paper.Paper(PAPER, lambda path: {})
    assert study.printed_error("damped", "velocity", "fd") == 6.456e-2
    assert study.printed_error("damped", "velocity", "exact") is None
    assert study.printed("ten_harmonics", kind="smallest_working_count") == 16
    assert study.printed(None, kind="dispersion_coefficient", smoothing_ratio=1.2) == 0.248


def test_a_scene_is_changed_key_by_key():
    study = paper.Paper(PAPER, lambda path: {})
    plain, changed = study.scene("two_moduli"), study.scene("two_moduli", interface=None)
    assert plain.modulus()[0] == pytest.approx(0.15)
    assert changed.modulus()[0] == pytest.approx(0.2)
