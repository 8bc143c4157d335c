"""CPU times."""

import numpy as np
import pytest
from scenes import VARIED, scene

from sphpod.full import sph
from sphpod.reduced import pod, snapshots
from sphpod.studies import cpu_time, step_time
from sphpod.studies.cpu_time import BASELINES

PLACE = {"scene": "waves", "sampling": "few"}
SETTINGS = {"particle_count": 40, "machine": {"processor": "one"}}


@pytest.mark.slow
def test_contenders_of_a_study():
    case = scene()
    sampling = {"range": [0, 1], "count": 10}
    full = sph.solve(case, snapshots.output_steps(case, [sampling]))
    modes = pod.decompose(snapshots.extract(case, sampling, full))
    result = cpu_time.compare(case, modes, [2, 4], [1, 10], repeats=2)
    methods = ["original", "linearized", "frozen1", "frozen10"]
    assert result["contender"].tolist() == ["sph_neighbour_lists", "sph_stencil", *methods * 2]
    assert result["contender_mode_count"].tolist() == [0, 0, *[2] * 4, *[4] * 4]
    assert result["n_freeze"].tolist() == [0, 0, *[0, 0, 1, 10] * 2]
    assert result["cpu_seconds"].shape == (10, 2 * cpu_time.PLACES)
    assert np.all(result["cpu_seconds"] > 0)


def test_savings_are_the_part_of_each_baseline_that_is_not_taken():
    measured = {
        "contender": np.array([*BASELINES, "frozen10"]),
        "contender_mode_count": np.array([0, 0, 4]),
        "n_freeze": np.array([0, 0, 10]),
        "cpu_seconds": np.array([[4.0, 4.0, 5.0], [2.0, 1.0, 2.0], [1.0, 3.0, 1.0]]),
    }
    savings = cpu_time.rows(PLACE, measured, SETTINGS)
    np.testing.assert_allclose(savings["saving_against_sph_neighbour_lists"], [0, 0.5, 0.75])
    np.testing.assert_allclose(savings["saving_against_sph_stencil"], [-1, 0, 0.5])
    np.testing.assert_allclose(savings["cpu_seconds_interquartile_range"], [0.5, 0.5, 1])


def test_compiled_steps_are_compared_with_the_sparse_loop():
    measured = step_time.compare(scene(), repeats=3, step_count=100)
    speedups = step_time.rows(PLACE, measured, SETTINGS)
    assert measured["contender"].tolist() == ["sph_sparse_loop", *BASELINES]
    assert speedups["speedup_against_sph_sparse_loop"][0] == 1
    # Far from the ratio that the benchmark reports, so that a busy machine does not fail it.
    assert speedups["speedup_against_sph_sparse_loop"][2] > 3


@pytest.mark.parametrize("changes", [{}, VARIED])
def test_the_sparse_loop_is_the_same_explicit_euler(changes):
    case = scene(**changes)
    velocity, density = step_time.sparse_loop(case, 30)
    result = sph.solve(case, np.array([30]))
    np.testing.assert_allclose(velocity, result["velocity"][0], rtol=1e-10, atol=1e-15)
    np.testing.assert_allclose(density, result["density"][0], rtol=1e-12)
