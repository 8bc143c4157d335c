"""Proper orthogonal decomposition."""

import os
import subprocess
import sys

import numpy as np
import pytest
import scenes
from hypothesis import given
from hypothesis import strategies as st

from sphpod.reduced import pod

sizes = st.integers(1, 12)


@given(sizes, sizes, st.integers(0, 2**32 - 1))
def test_modes_are_orthonormal_signed_and_optimal(n, count, seed):
    rng = np.random.default_rng(seed)
    snapshots = rng.standard_normal((n, count)) * 10.0 ** rng.uniform(-6, 6)
    modes, values, *_ = pod.modes(snapshots)
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


def test_the_sign_does_not_depend_on_rounding():
    x = np.arange(40) / 40
    wave = np.sin(2 * np.pi * x)[None, :]
    for noise in (0, 1e-15, -1e-15):
        disturbed = wave.copy()
        disturbed[0, 30] -= noise
        modes = pod.modes(disturbed).modes
        assert modes[0, 10] > 0


@given(st.integers(0, 2**32 - 1), st.integers(-15, -3))
def test_odd_modes_have_one_sign_however_they_are_rounded(seed, noise):
    """Both extremes of an odd mode are equal, and noise alone makes one of them larger."""
    rng = np.random.default_rng(seed)
    x = np.arange(60) / 60
    odd = np.linalg.qr(np.sin(2 * np.pi * np.outer(np.arange(1, 7), x)).T)[0]
    odd = odd @ np.linalg.qr(rng.standard_normal((6, 6)))[0]
    times = np.linalg.qr(rng.standard_normal((20, 6)))[0]
    exact = times * 10.0 ** -np.arange(0, 18, 3) @ odd.T

    def rounded():
        return exact + 10.0**noise * rng.standard_normal(exact.shape) / 60

    first, second = (pod.modes(rounded(), rounded()) for _ in range(2))
    known = np.maximum(first.rounding, second.rounding) <= pod.ROUNDING_LEVEL
    assert known[0]
    alike = np.sum(first.modes * second.modes, axis=1)
    assert np.all(alike[known] > 0.99)


@given(st.integers(1, 5), st.floats(1e-9, 1.5), st.integers(0, 2**32 - 1))
def test_a_mode_turned_by_an_angle_turns_its_own_span_alone(k, angle, seed):
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.standard_normal((30, 30)))[0].T
    times = np.linalg.qr(rng.standard_normal((8, 6)))[0]
    snapshots = times * 2.0 ** -np.arange(6) @ axes[:6]
    turned = axes[:6].copy()
    turned[k - 1] = np.cos(angle) * axes[k - 1] + np.sin(angle) * axes[k]
    turned[k] = np.cos(angle) * axes[k] - np.sin(angle) * axes[k - 1] if k < 6 else 0
    found = pod.modes(snapshots, times * 2.0 ** -np.arange(6) @ turned)
    by_mode, by_span = np.zeros(8), np.zeros(8)
    by_mode[[k - 1, k]] = 2 * np.sin(min(angle, np.pi - angle) / 2)
    by_span[k - 1] = np.sin(angle)
    np.testing.assert_allclose(found.rounding[:6], by_mode[:6], atol=1e-12)
    np.testing.assert_allclose(found.span_rounding[:6], by_span[:6], atol=1e-12)


def test_modes_of_equal_singular_values_rotate_freely_within_their_span():
    axes = np.linalg.qr(np.random.default_rng(0).standard_normal((30, 30)))[0][:3]
    values = np.diag([1, 1 - 1e-10, 1e-3])
    mixing = np.eye(3)
    mixing[:2, :2] = np.array([[1, 1], [-1, 1]]) / np.sqrt(2)
    snapshots, twins = values @ axes, mixing.T @ values @ mixing @ axes
    assert np.abs(snapshots - twins).max() < 1e-10
    found = pod.modes(snapshots, twins)
    np.testing.assert_allclose(found.rounding[:2], 2 * np.sin(np.pi / 8), atol=1e-4)
    assert pod.resolved([0, 1, 2, 3, 4], found.span_rounding).tolist() == [True, False] + [True] * 3


def test_modes_of_small_singular_values_are_turned_by_the_decomposition_alone():
    rng = np.random.default_rng(0)
    times, axes = (np.linalg.qr(rng.standard_normal((40, 40)))[0] for _ in range(2))
    found = pod.modes(times * 10.0 ** -np.arange(40) @ axes)
    assert np.all(found.rounding[:10] < 1e-4)
    assert np.all(found.rounding[17:] > 1e-2)


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


def test_modes_are_of_double_precision_whatever_the_snapshots():
    snapshots = np.random.default_rng(0).standard_normal((5, 30)).astype(np.float32)
    for found, expected in zip(
        pod.modes(snapshots), pod.modes(snapshots.astype(float)), strict=True
    ):
        assert found.dtype == np.float64
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
def test_snapshots_that_are_not_finite_are_refused_by_name(wrong):
    snapshots = np.ones((4, 9))
    snapshots[2, 7] = wrong
    sentence = rf"snapshot 2 is {wrong:g} at particle 7: all values must be finite"
    with pytest.raises(ValueError, match=f"^snapshots: {sentence}$"):
        pod.modes(snapshots)
    fields = {"x": np.arange(9.0), "velocity_snapshots": np.ones((4, 9))}
    with pytest.raises(ValueError, match=f"^density_snapshots: {sentence} and above 0$"):
        pod.decompose(fields | {"density_snapshots": snapshots})
    with pytest.raises(ValueError, match=f"^velocity_snapshots: {sentence}$"):
        pod.decompose(fields | {"velocity_snapshots": snapshots, "density_snapshots": np.ones(9)})


def test_densities_that_are_not_positive_and_no_snapshots_are_refused():
    fields = {"x": np.arange(9.0), "velocity_snapshots": np.ones((4, 9))}
    with pytest.raises(ValueError, match=r"^density_snapshots: snapshot 0 is 0 at particle 0: all"):
        pod.decompose(fields | {"density_snapshots": np.zeros((4, 9))})
    with pytest.raises(ValueError, match=r"^snapshots: there are 0 snapshots: at least 1"):
        pod.modes(np.zeros((0, 9)))


@pytest.mark.workflow
def test_modes_are_the_same_to_the_last_bit_for_any_number_of_threads():
    """Those of small singular values too."""
    program = """if True:
        import numpy as np, sys
        from hashlib import sha256
        from scenes import scene
        from sphpod.reduced import lifted_rom, pod
        case = scene(particle_count=400, force="1e-3*cos(9*t)")
        x, t = case.positions, np.linspace(0, 1, 100)[:, None]
        velocity = 1e-3*sum(np.sin(2*np.pi*n*(x - 0.3*t))/n**4 for n in range(1, 30))
        taken = {"velocity_snapshots": velocity, "density_snapshots": 1/(1 + velocity)}
        modes = lifted_rom.decompose(case, taken)
        for array in (*pod.modes(velocity), *modes.values()):
            print(sha256(array.tobytes()).hexdigest())
    """
    path = os.pathsep.join([os.getcwd(), os.path.dirname(scenes.__file__)])
    printed = {
        subprocess.run(
            [sys.executable, "-c", program],
            env=os.environ | {"OPENBLAS_NUM_THREADS": str(threads), "PYTHONPATH": path},
            capture_output=True, text=True, check=True,
        ).stdout
        for threads in (1, 2)
    }  # fmt: skip
    assert len(printed) == 1
