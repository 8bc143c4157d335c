"""Proper orthogonal decomposition."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from sphpod import pod

sizes = st.integers(1, 12)


@given(sizes, sizes, st.integers(0, 2**32 - 1))
def test_modes_are_orthonormal_signed_and_optimal(n, count, seed):
    rng = np.random.default_rng(seed)
    snapshots = rng.standard_normal((n, count)) * 10.0 ** rng.uniform(-6, 6)
    modes, values = pod.modes(snapshots)
    np.testing.assert_allclose(modes @ modes.T, np.eye(len(modes)), atol=1e-12)
    assert np.all(np.diff(values) <= 0)
    size = np.abs(modes)
    assert np.all(modes.max(axis=1) >= (1 - 1e-7) * size.max(axis=1))
    for k in range(len(values) + 1):
        # Eckart and Young: no space of k modes leaves less than the rest of the singular values.
        left = snapshots - snapshots @ modes[:k].T @ modes[:k]
        np.testing.assert_allclose(
            np.sum(left**2), np.sum(values[k:] ** 2), atol=1e-12 * values[0] ** 2
        )
        other, _ = np.linalg.qr(rng.standard_normal((count, k)))
        rest = snapshots - snapshots @ other @ other.T
        assert np.sum(rest**2) >= np.sum(values[k:] ** 2) * (1 - 1e-9) - 1e-20


def test_the_sign_does_not_hang_on_rounding():
    x = np.arange(40) / 40
    wave = np.sin(2 * np.pi * x)[None, :]
    for noise in (0, 1e-15, -1e-15):
        disturbed = wave.copy()
        disturbed[0, 30] -= noise
        modes, _ = pod.modes(disturbed)
        assert modes[0, 10] > 0


def test_each_field_has_its_own_modes():
    rng = np.random.default_rng(0)
    snapshots = {
        "x": np.arange(9.0),
        "velocity_snapshots": rng.standard_normal((3, 9)),
        "density_snapshots": rng.uniform(1, 2, (4, 9)),
    }
    result = pod.decompose(snapshots)
    assert result["velocity_modes"].shape == (3, 9)
    assert result["density_modes"].shape == (4, 9)
    assert result["density_singular_values"].shape == (4,)
