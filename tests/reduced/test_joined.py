"""Modes of the snapshots of several samplings together."""

import numpy as np
import pytest
from scenes import scene, settings

from sphpod.full import lifted, sph
from sphpod.reduced import joined, lifted_rom, pod, rounding

SAMPLING = {"range": [0, 1], "count": 8}
SOFT = {"youngs_modulus": 0.07}
UNEVEN = {"initial_density": "1 + 0.2*sin(2*pi*x/L)"}


def sampled(case):
    solution = sph.solve(case, np.arange(case.step_count + 1))
    return rounding.sampled(case, SAMPLING, solution)


def test_one_sampling_joined_with_none_has_its_own_modes():
    case = scene()
    taken = sampled(case)
    for name, array in pod.decompose(taken).items():
        np.testing.assert_array_equal(joined.decompose([taken])[name], array)


def test_joined_modes_represent_the_snapshots_of_each_sampling():
    """Exactly if there are as many modes as snapshots, best on the whole if there are fewer."""
    cases = scene(), scene(**SOFT)
    taken = [sampled(case) for case in cases]
    found = joined.decompose(taken)
    modes = found["velocity_modes"]
    for one in taken:
        rows = one["velocity_snapshots"]
        np.testing.assert_allclose(rows @ modes.T @ modes, rows, atol=1e-13)
    few = modes[:3]
    missed = sum(
        np.sum((one["velocity_snapshots"] @ (np.eye(few.shape[1]) - few.T @ few)) ** 2)
        for one in taken
    )
    values = found["velocity_singular_values"]
    assert missed == pytest.approx(np.sum(values[3:] ** 2), rel=1e-9)


def test_strains_are_those_of_the_scene_that_each_snapshot_is_of():
    """A density that varies at rest is no strain."""
    case, uneven = scene(), scene(**UNEVEN)
    taken = sampled(uneven)
    physics = settings(**UNEVEN)
    found = joined.decompose_lifted(case, [taken], [physics])
    strain = lifted.strain(uneven, taken["density_snapshots"])
    _, stiffness = lifted.energy_weights(case)
    modes = found["scaled_strain_modes"]
    np.testing.assert_allclose(
        (stiffness * strain) @ modes.T @ modes, stiffness * strain, atol=1e-13
    )
    own = lifted_rom.decompose(uneven, taken)
    joined_with_itself = joined.decompose_lifted(uneven, [taken], [physics])
    for name, array in own.items():
        np.testing.assert_allclose(joined_with_itself[name], array, rtol=1e-12, atol=1e-14)
