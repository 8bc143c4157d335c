"""Lifted models whose snapshots are poor."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st
from random_models import random_models
from scenes import VARIED, scene

from sphpod.full import lifted, sph
from sphpod.reduced import certificate, lifted_rom, snapshots
from sphpod.studies import poor_snapshots

SCENES: dict[str, dict[str, Any]] = {
    "at rest on average": {"initial_velocity": "2e-3*x*(L - x)*sin(6*pi*x)"},
    "moving and varied": VARIED,
}
LEVELS = [1e-8, 1e-4, 1e-1]
REFUSED = {
    "not a number": "velocity_snapshots: snapshot 12 is nan at particle 20",
    "infinite": "velocity_snapshots: snapshot 12 is inf at particle 20",
    "density not positive": "density_snapshots: snapshot 12 is -",
    "all zero": "density_snapshots: snapshot 0 is 0 at particle 0",
    "all at rest": "velocity_snapshots: all values are 0",
    "no snapshots": "velocity_snapshots: there are 0 snapshots: at least 1",
}
each = pytest.mark.parametrize("name", SCENES)


@cache
def studied(name):
    case = scene(name, **SCENES[name], duration=2)
    sampling = {"range": [0, 2], "count": 24}
    full = sph.solve(case, snapshots.output_steps(case, [sampling]))
    taken = snapshots.extract(case, sampling, full)
    exact = lifted.solve(case, "exact")
    return poor_snapshots.study(case, taken, exact, LEVELS, mode_count=8, seed=0)


@pytest.mark.slow
@each
def test_every_defect_gives_an_error_within_its_bound_or_a_refusal(name):
    arrays = studied(name)
    refused = dict(REFUSED)
    if name == "moving and varied":
        # Translation is a mode whatever the snapshots.
        del refused["all at rest"]
    outcomes = dict(zip(arrays["defect"].tolist(), arrays["defect_outcome"].tolist(), strict=True))
    assert {d for d, outcome in outcomes.items() if outcome != "within its bound"} == set(refused)
    for defect, sentence in refused.items():
        assert outcomes[defect].startswith(f"scene {name}: {sentence}")
    told = np.isin(arrays["defect"], list(refused))
    for column in ("defect_error", "defect_bound"):
        np.testing.assert_array_equal(np.isnan(arrays[column]), told)
    np.testing.assert_array_equal(arrays["defect_rank"] == 0, told)
    assert np.all(arrays["defect_error"][~told] <= arrays["defect_bound"][~told] + 1e-11)


@each
def test_defects_cost_what_they_take_from_the_snapshots(name):
    arrays = studied(name)
    defects = arrays["defect"].tolist()
    errors = dict(zip(defects, arrays["defect_error"], strict=True))
    ranks = dict(zip(defects, arrays["defect_rank"], strict=True))
    rigid = name == "moving and varied"
    assert errors["duplicated"] == pytest.approx(errors["none"], rel=1e-6)
    assert errors["single precision"] == pytest.approx(errors["none"], rel=1e-2)
    assert min(errors["too few"], errors["too early"]) > 2 * errors["none"]
    assert ranks["too few"] == 2 + rigid
    assert ranks["rank-deficient"] == poor_snapshots.RANK + rigid
    # More modes than there are give the model with all of them.
    assert errors["more modes than particles"] < errors["none"]


@each
def test_little_noise_changes_little_and_the_bound_holds(name):
    arrays = studied(name)
    np.testing.assert_array_equal(arrays["noise"], LEVELS)
    clean = arrays["defect_error"][0]
    assert arrays["defect"][0] == "none"
    assert arrays["noise_error"][0] == pytest.approx(clean, rel=1e-4)
    assert arrays["noise_error"][-1] > clean
    assert np.all(arrays["noise_error"] <= arrays["noise_bound"] + 1e-11)
    assert np.all(arrays["noise_original_error"] > 0)


@examples(60)
@given(
    random_models(),
    st.integers(1, 12),
    st.sampled_from([0, *10.0 ** np.arange(-8, 0)]),
    st.booleans(),
    st.integers(0, 2**32 - 1),
)
def test_the_bound_holds_whatever_the_snapshots(model, count, noise, twice, seed):
    """Any scene, any few of its states in any order, noisy and repeated, and any k."""
    case, rng = model.scene, np.random.default_rng(seed)
    full = lifted.solve(case, "exact")
    at = rng.choice(101, rng.integers(1, 12), replace=twice)
    taken = {"velocity_snapshots": full["velocity"][at], "strain_snapshots": full["strain"][at]}
    for name, field in taken.items():
        size = noise * np.sqrt(np.mean(field**2))
        taken[name] = field + size * rng.standard_normal(field.shape)
    rank, error, bound, outcome = poor_snapshots.judge(case, taken, full, count)
    modes = lifted_rom.decompose(case, taken)
    assert rank == len(modes["scaled_velocity_modes"])
    run = lifted_rom.build(case, modes, count).prepare("lifted_exact").solve()
    velocity, strain = run.fields().values()
    mass, stiffness = lifted.energy_weights(case)
    differences = mass * (velocity - full["velocity"]), stiffness * (strain - full["strain"])
    errors = np.sqrt(sum(np.sum(part**2, axis=1) for part in differences))
    initial = np.linalg.norm(mass * case.velocity0())
    bounds, _ = certificate.error_bounds(run)
    assert np.all(bounds >= errors - 1e-11 * initial)
    assert outcome == "within its bound"
    # Unforced, no energy is larger than the first.
    assert error == pytest.approx(errors.max() / initial, rel=1e-9, abs=1e-12)
    assert bound == pytest.approx(bounds.max() / initial, rel=1e-9)


def test_rows_hold_defects_and_noise():
    arrays = studied("moving and varied")
    table = list(poor_snapshots.rows({"scene": "varied"}, arrays))
    assert [row["defect"] for row in table] == arrays["defect"].tolist() + ["noisy"] * len(LEVELS)
    errors = np.concatenate([arrays["defect_error"], arrays["noise_error"]])
    np.testing.assert_array_equal([row["error"] for row in table], errors)
    assert [row["noise"] for row in table[-len(LEVELS) :]] == LEVELS
