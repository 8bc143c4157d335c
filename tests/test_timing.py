"""CPU times."""

import numpy as np
from scenes import scene

from sphpod import pod, snapshots, sph, timing


def test_contenders_of_a_study():
    case = scene()
    sampling = {"range": [0, 1], "count": 10}
    full = sph.solve(case, snapshots.output_steps(case, [sampling]))
    modes = pod.decompose(snapshots.extract(case, sampling, full))
    result = timing.compare(case, modes, [2, 4], [1, 10], repeats=3)
    methods = ["original", "linearized", "frozen1", "frozen10"]
    assert result["contender"].tolist() == ["sph_neighbour_lists", "sph_stencil", *methods * 2]
    assert result["contender_mode_count"].tolist() == [0, 0, *[2] * 4, *[4] * 4]
    assert result["n_freeze"].tolist() == [0, 0, *[0, 0, 1, 10] * 2]
    assert result["cpu_seconds"].shape == (10, 3)
    assert np.all(result["cpu_seconds"] > 0)


def test_the_sparse_loop_is_the_same_explicit_euler():
    case = scene()
    velocity, density = timing.sparse_loop(case, 30)
    result = sph.solve(case, np.array([30]))
    np.testing.assert_allclose(velocity, result["velocity"][0], rtol=1e-10, atol=1e-15)
    np.testing.assert_allclose(density, result["density"][0], rtol=1e-12)


def test_contenders_take_turns_after_a_warm_up():
    calls = []
    timing.measure([lambda: calls.append("a"), lambda: calls.append("b")], 3)
    assert calls == ["a", "b"] * 4


def test_the_machine_is_named():
    described = timing.machine()
    assert described["processor"]
    assert described["blas_threads"] == 1
