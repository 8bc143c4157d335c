"""What the smoothing length does to full SPH."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import VARIED, scene

from sphpod.full import lifted, sph
from sphpod.numerics.error import relative_error
from sphpod.studies import smoothing

RATIOS = [1.04, 1.25, np.sqrt(6) - 1, 1.8, 2.6]
NAMES = ("velocity", "density")


def reference(case):
    full = lifted.solve(case, "exact")
    return {"velocity": full["velocity"], "density": lifted.density(case, full["strain"])}


@pytest.mark.parametrize("changes", [{}, VARIED], ids=["plain", "varied"])
def test_errors_are_those_of_full_sph_to_a_percent(changes):
    case = scene(**(changes | {"time_step": 5e-4, "error_interval": 5e-4}))
    exact = reference(replace(case, smoothing_ratio=1.5))
    found = smoothing.study(case, RATIOS, exact)
    for n, ratio in enumerate(RATIOS):
        full = sph.solve(replace(case, smoothing_ratio=ratio), case.error_steps)
        for name in NAMES:
            error = relative_error(full[name], exact[name])
            assert found[f"smoothing_{name}_error"][n] == pytest.approx(error, rel=1e-2)
    assert found["neighbour_count"].tolist() == [2, 2, 2, 3, 5]
    assert found["derivative_coefficient"][2] == pytest.approx(1)


@settings(deadline=None, max_examples=20)
@given(
    st.floats(0.8, 3), st.integers(13, 40), st.sampled_from([0.0, 0.3]), st.sampled_from([0.0, 0.2])
)
def test_leapfrog_is_stable_below_its_step_and_not_above(ratio, count, depth, jitter):
    case = scene(
        smoothing_ratio=ratio,
        particle_count=count,
        youngs_modulus=f"0.1*(1 + {depth}*cos(2*pi*x/L))",
        positions={"jitter": jitter, "seed": 0},
    )
    limit = 2 / smoothing.fastest_frequency(case)
    start = 1e-9 * np.random.default_rng(0).standard_normal((2, count))
    grown = []
    for part in (0.99, 1.01):
        step = part * limit
        long = replace(case, time_step=step, error_interval=400 * step, duration=400 * step)
        run = lifted.prepare(long, "leapfrog", start=tuple(start)).run(watch=False)
        grown.append(np.abs([field[1] for field in run.state]).max() / np.abs(start).max())
    assert grown[0] < 100
    assert grown[1] > 1e4


def test_a_run_that_breaks_down_has_no_error():
    case = scene(initial_velocity="0.9*sin(2*pi*x/L)", error_interval=1e-3)
    exact = reference(scene(error_interval=1e-3))
    found = smoothing.study(case, [1.04, 1.8], exact)
    assert np.isnan(found["smoothing_velocity_error"]).all()
    assert np.isnan(found["smoothing_density_error"]).all()
    assert (found["stable_time_step"] > 0).all()


def test_the_smallest_error_ranks_first_and_breakdowns_last():
    errors = np.array([0.3, np.nan, 0.1, 0.2, np.nan, 0.2])
    assert smoothing.ranks(errors).tolist() == [4, 5, 1, 2, 5, 2]


def one(velocity, density):
    count = len(velocity)
    return {
        "smoothing_ratio": 1 + np.arange(count) / 10,
        "derivative_coefficient": np.ones(count),
        "dispersion_coefficient": np.ones(count),
        "neighbour_count": np.full(count, 2),
        "stable_time_step": np.ones(count),
        "smoothing_velocity_error": np.array(velocity),
        "smoothing_density_error": np.array(density),
    }


def test_scenes_count_alike_however_large_their_errors():
    small, large = one([1e-6, 3e-6, 8e-6], [1, 2, 3]), one([0.9, 0.1, 0.5], [3, np.nan, 1])
    table = list(smoothing.rows({"scene": "all"}, smoothing.overall([small, large])))
    assert [row["velocity_rank"] for row in table] == [2, 1, 3]
    assert [row["density_rank"] for row in table] == [1, 3, 1]
    assert table[0]["smoothing_velocity_error"] == pytest.approx(np.sqrt(1e-6 * 0.9))
    assert "stable_time_step" not in table[0]
    ranked = [row["smoothing_ratio"] for row in smoothing.ranking([small, large])]
    assert ranked == [table[n]["smoothing_ratio"] for n in (1, 0, 2)]


def test_rows_tell_each_ratio_and_its_ranks():
    table = list(smoothing.rows({"scene": "test"}, one([3, 1, 2], [1, 2, 3])))
    assert [row["velocity_rank"] for row in table] == [3, 1, 2]
    assert [row["density_rank"] for row in table] == [1, 2, 3]
    assert table[1]["scene"] == "test"
    assert table[1]["smoothing_ratio"] == 1.1
    assert table[1]["neighbour_count"] == 2
