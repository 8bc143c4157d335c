"""Sampling times and snapshots."""

import numpy as np
import pytest
from scenes import scene

from sphpod import snapshots, sph


@pytest.mark.parametrize(
    ("sampling", "dt", "times"),
    [
        ({"range": [0, 1.6], "count": 100}, 2e-4, np.arange(100) * 0.016),
        ({"range": [0, 1.44], "count": 12}, 2e-4, np.arange(12) * 0.12),
        ({"range": [0, 0.1], "count": 5}, 2e-4, [0, 0.02, 0.04, 0.06, 0.08]),
        ({"range": [0, 1.5], "count": 15}, 5e-5, np.arange(15) * 0.1),
        ({"range": [0.2, 0.6], "count": 4}, 1e-3, [0.2, 0.3, 0.4, 0.5]),
    ],
)
def test_uniform_samplings_leave_out_the_right_end(sampling, dt, times):
    case = scene(duration=10, time_step=dt)
    velocity, density = snapshots.sampling_steps(case, sampling)
    np.testing.assert_allclose(velocity * dt, times, atol=1e-12)
    assert np.array_equal(velocity, density)


def test_times_between_steps_go_to_the_nearest():
    case = scene(time_step=1e-3)
    steps, _ = snapshots.sampling_steps(case, {"range": [0, 1], "count": 7})
    assert steps.tolist() == [0, 143, 286, 429, 571, 714, 857]


def test_random_samplings_are_distinct_seeded_and_within_their_range():
    case = scene(time_step=1e-3)
    sampling = {"range": [0.1, 0.3], "count": 150, "seed": 3}
    steps, _ = snapshots.sampling_steps(case, sampling)
    assert len(set(steps.tolist())) == 150
    assert steps.min() >= 100
    assert steps.max() < 300
    assert np.array_equal(steps, snapshots.sampling_steps(case, sampling)[0])
    other, _ = snapshots.sampling_steps(case, sampling | {"seed": 4})
    assert not np.array_equal(steps, other)


def test_snapshots_are_the_solution_at_their_times():
    case = scene()
    sampling = {"velocity_times": [0, 0.123, 0.4], "density_times": [0.007, 0.4]}
    steps = snapshots.output_steps(case, [sampling])
    assert np.isin(case.error_steps, steps).all()
    taken = snapshots.extract(case, sampling, sph.solve(case, steps))
    for field in ("velocity", "density"):
        np.testing.assert_allclose(taken[f"{field}_time"], sampling[f"{field}_times"], atol=1e-15)
        alone = sph.solve(case, np.rint(taken[f"{field}_time"] / 1e-3).astype(np.int64))
        np.testing.assert_array_equal(taken[f"{field}_snapshots"], alone[field])


def test_a_solution_without_a_snapshot_time_is_refused():
    case = scene()
    solution = sph.solve(case, case.error_steps)
    with pytest.raises(ValueError, match="was not kept at every velocity snapshot"):
        snapshots.extract(case, {"range": [0, 1], "count": 7}, solution)
