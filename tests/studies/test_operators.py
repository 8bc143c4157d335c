"""Spectra of reduced operators on POD modes and on random ones."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import VARIED, scene

from sphpod.full import sph
from sphpod.reduced import lifted_rom, pod
from sphpod.reduced.rom import ReducedModel
from sphpod.studies import operators
from sphpod.studies.operators import conditioned_rate, growth_rate, rounding_bound

GRADED = {key: VARIED[key] for key in ("initial_density", "youngs_modulus")}


def rows(rng, count, size):
    """Random orthonormal rows."""
    return np.linalg.qr(rng.standard_normal((size, count)))[0].T


def sampled(case):
    """Modes of both kinds, and the density snapshots that they are of."""
    full = sph.solve(case, case.error_steps[::5])
    snapshots = {f"{name}_snapshots": full[name] for name in ("velocity", "density")}
    modes = pod.decompose({"x": case.positions} | snapshots)
    return modes, lifted_rom.decompose(case, snapshots), full["density"]


@st.composite
def scenes(draw):
    """Scenes of any material and damping, of even or jittered particles."""
    return scene(
        particle_count=draw(st.integers(7, 30)),
        smoothing_ratio=draw(st.floats(0.8, 2.9)),
        initial_density=f"1 + {draw(st.floats(0, 0.9))}*sin(2*pi*x/L)",
        youngs_modulus=f"0.1 + {draw(st.floats(0, 0.09))}*cos(4*pi*x/L)",
        damping=f"{draw(st.floats(0, 20))}*(1 + sin(2*pi*x/L))",
        positions={"jitter": draw(st.sampled_from([0.0, 0.2])), "seed": draw(st.integers(0, 9))},
    )


@settings(deadline=None, max_examples=25)
@given(scenes(), st.integers(0, 99))
def test_no_random_basis_lets_a_lifted_model_grow(case, seed):
    found = operators.of_random_bases(case, 20, seed)
    bound = rounding_bound(found["basis_mode_count"], found["random_operator_size"])
    assert (found["random_energy_growth_rate"] <= bound).all()


def test_random_bases_are_reproducible_and_of_many_sizes():
    first, again, other = (operators.of_random_bases(scene(), 50, seed) for seed in (1, 1, 2))
    for name, values in first.items():
        np.testing.assert_array_equal(values, again[name])
        assert not np.array_equal(values, other[name])
    assert {np.ptp(first[name]) > 0 for name in first} == {True}
    assert first["basis_mode_count"].max() <= 2 * operators.RANDOM_MODES


@pytest.mark.parametrize(
    ("changes", "grows"),
    [
        ({}, False),
        ({"smoothing_ratio": 2.3}, False),
        ({"initial_density": GRADED["initial_density"]}, True),
        ({"youngs_modulus": GRADED["youngs_modulus"]}, True),
    ],
    ids=["uniform", "wide", "graded density", "graded modulus"],
)
def test_plain_projections_grow_where_the_material_varies(changes, grows):
    found = operators.of_random_bases(scene(**changes), 100, 0)
    (row,) = operators.random_rows({"scene": "test", "sampling": "random"}, found)
    assert row["bases"] == 100
    assert (row["euclidean_growing"] > 10) == grows
    assert (row["euclidean_growing"] == 0) != grows
    assert row["energy_growing"] == 0
    assert row["euclidean_growth_rate"] == found["random_euclidean_growth_rate"].max()


@pytest.mark.parametrize("changes", [{}, VARIED, GRADED], ids=["plain", "varied", "graded"])
def test_samplings(changes):
    case = scene(**changes)
    modes, energy_modes, densities = sampled(case)
    counts = [2, 5, 8]
    found = operators.of_samplings(
        case, counts, modes, energy_modes, {"density_snapshots": densities}
    )
    assert found["mode_count"].tolist() == counts
    for n, count in enumerate(counts):
        vm, rm = modes["velocity_modes"][:count], modes["density_modes"][:count]
        rates = [growth_rate(ReducedModel(case, m, vm, rm).operator()) for m in
                 ("original", "linearized", "frozen10")]  # fmt: skip
        assert found["euclidean_growth_rate"][n] == pytest.approx(max(rates), abs=1e-9)
        strained = [
            growth_rate(ReducedModel(case, "frozen10", vm, rm).operator(rho)) for rho in densities
        ]
        assert found["frozen_growth_rate"][n] == pytest.approx(max(strained), abs=1e-9)
        operator = lifted_rom.build(case, energy_modes, count).operator
        assert found["operator_size"][n] == pytest.approx(np.linalg.norm(operator, 2))
        bound = rounding_bound(np.array(len(operator)), found["operator_size"][n])
        assert found["energy_growth_rate"][n] <= bound
    table = list(operators.rows({"scene": "test", "sampling": "all"}, found))
    assert [row["modes"] for row in table] == counts
    assert table[1]["frozen_growth_rate"] == found["frozen_growth_rate"][1]


def test_rounding_is_reported_from_growth():
    # A double zero that has one eigenvector: rounding splits it by the root of its size.
    for angle in np.linspace(0.1, 1.5, 20):
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        rate, rounding = conditioned_rate(turn @ np.array([[0, 30.0], [0, 0]]) @ turn.T)
        assert 1e-8 < rounding < 1e-5
        assert abs(rate) < 10 * rounding
    wave = np.array([[1e-6, 3.0], [-3.0, 1e-6]])
    rate, rounding = conditioned_rate(wave)
    assert rate == pytest.approx(1e-6, rel=1e-8)
    assert rounding < 1e-14


def test_a_run_of_the_example_grows_as_its_operator_tells():
    # So small that it is as good as linear until the end.
    case = scene(**(GRADED | {"initial_velocity": "1e-7*sin(2*pi*x/L)"}))
    found = operators.example(case, 0)
    t, paper, lifted_energy = (found[name] for name in ("t", "paper_energy", "lifted_energy"))
    assert paper[0] == pytest.approx(lifted_energy[0], rel=1e-12)
    late = t > 0.6 * t[-1]
    rate = np.polyfit(t[late], np.log(paper[late]) / 2, 1)[0]
    assert rate == pytest.approx(found["example_growth_rate"], rel=0.1)
    assert paper[-1] / paper[0] > 100
    assert abs(lifted_energy / lifted_energy[0] - 1).max() < 0.2


def test_the_example_tells_where_it_broke_down():
    found = operators.example(scene(**(GRADED | {"initial_velocity": "0.05*sin(2*pi*x/L)"})), 0)
    broken = np.isnan(found["paper_energy"])
    assert broken[-1]
    assert (np.diff(broken.astype(int)) >= 0).all()
    assert np.isfinite(found["lifted_energy"]).all()


def test_a_density_that_modes_do_not_hold_drives_the_papers_model_alone():
    case = scene(initial_velocity="1e-3*sum(sin(2*pi*l*x/L + l) for l in range(1, 4))")
    modes, energy_modes, _ = sampled(case)
    for step in (1e-3, 5e-4):
        finer = replace(case, time_step=step)
        found = operators.long_run(finer, 2, modes, energy_modes, 20)
        assert found["t"][-1] == pytest.approx(20)
        paper, energetic = (found[f"{name}_energy"] for name in ("paper", "lifted"))
        # A drift, not the steps' own growth: shorter steps do not lessen it.
        assert paper[-1] / paper[0] > 5
        assert energetic[-1] / energetic[0] < 1 + 600 * step
    enough = operators.long_run(case, 7, modes, energy_modes, 20)
    np.testing.assert_allclose(enough["paper_energy"], enough["lifted_energy"], rtol=1e-2)
