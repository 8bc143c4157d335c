"""The kernel and the SPH derivative made of it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sphpod.scene.kernel import (
    derivative,
    derivative_coefficient,
    dispersion_coefficient,
    kernel,
    kernel_gradient,
    neighbour_count,
    neighbour_lists,
    stencil_weights,
)

smoothing_ratios = st.floats(0.55, 4)


@given(st.floats(1e-3, 1e3))
def test_kernel_integrates_to_one(h):
    x = np.linspace(-2 * h, 2 * h, 4001)
    assert np.trapezoid(kernel(x, h), x) == pytest.approx(1, rel=1e-6)


@pytest.mark.parametrize(("ratio", "off"), [(1.04, 0.012), (1.06, 0.016), (1.2, 0.05), (2, 1e-12)])
def test_sums_of_the_kernel_are_about_one(ratio, off):
    """Σ V_j W_ij of section 2.2 at even particles; one exactly where h is a whole number of Δx."""
    assert abs(np.sum(kernel(np.arange(-9, 10.0), ratio)) - 1) < off


def test_the_sum_over_particles_approximates_a_function_at_second_order():
    """⟦f⟧ = Σ V_j f_j W_ij (2.8) for h = 2 Δx, with f = sin x: its error falls as h²."""
    errors = []
    for count in (40, 80, 160):
        spacing = 2 * np.pi / count
        x = np.arange(count) * spacing
        away = (x[:, None] - x + np.pi) % (2 * np.pi) - np.pi
        approximation = spacing * kernel(away, 2 * spacing) @ np.sin(x)
        errors.append(np.abs(approximation - np.sin(x)).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 2, atol=0.05)


@given(st.floats(0.1, 10), st.floats(-3, 3))
def test_gradient_is_the_kernels_derivative_and_odd(h, q):
    x, step = q * h, 1e-6 * h
    slope = (kernel(x + step, h) - kernel(x - step, h)) / (2 * step)
    assert kernel_gradient(x, h) == pytest.approx(slope, abs=1e-5 / h**2)
    assert kernel_gradient(-x, h) == -kernel_gradient(x, h)


def test_support_has_radius_2h():
    assert kernel(1.99, 1.0) > 0
    assert kernel(2.0, 1.0) == kernel(2.5, 1.0) == 0


@given(smoothing_ratios, st.integers(20, 60))
def test_stencil_and_lists_are_the_same_derivative(smoothing_ratio, count):
    spacing = 1 / count
    positions = np.arange(count) * spacing
    first, neighbours, gradients = neighbour_lists(
        positions, np.full(count, spacing), smoothing_ratio * spacing, 1.0
    )
    matrix = np.zeros((count, count))
    rows = np.repeat(np.arange(count), np.diff(first).astype(int))
    matrix[rows, neighbours] = gradients
    field = np.random.default_rng(0).standard_normal(count)
    by_stencil = derivative(field, stencil_weights(spacing, smoothing_ratio))
    scale = np.abs(matrix).sum(axis=1).max()
    np.testing.assert_allclose(matrix @ field, by_stencil, atol=1e-9 * scale)
    np.testing.assert_allclose(matrix, -matrix.T, atol=1e-9 * scale)


def test_lists_of_uneven_particles_weigh_antisymmetrically():
    rng = np.random.default_rng(1)
    positions = np.sort(rng.uniform(0, 1, 50))
    volumes = rng.uniform(0.5, 2, 50) / 50
    first, neighbours, gradients = neighbour_lists(positions, volumes, 0.03, 1.0)
    matrix = np.zeros((50, 50))
    matrix[np.repeat(np.arange(50), np.diff(first).astype(int)), neighbours] = gradients
    weighted = volumes[:, None] * matrix
    np.testing.assert_allclose(weighted, -weighted.T, atol=1e-12)
    distance = np.abs(positions[:, None] - positions)
    near = np.minimum(distance, 1 - distance) < 0.06
    np.fill_diagonal(near, False)
    assert np.array_equal(matrix != 0, near)


@given(smoothing_ratios)
def test_derivative_of_a_slow_wave_follows_beta_and_dispersion(smoothing_ratio):
    count = 2000
    spacing = 2 * np.pi / count
    x = np.arange(count) * spacing
    slope = derivative(np.sin(x), stencil_weights(spacing, smoothing_ratio))
    expected = derivative_coefficient(smoothing_ratio)
    expected -= dispersion_coefficient(smoothing_ratio) * spacing**2
    np.testing.assert_allclose(slope, expected * np.cos(x), atol=1e-8)


@pytest.mark.parametrize(("smoothing_ratio", "count"), [(1.0, 1), (1.04, 2), (1.5, 2), (1.51, 3)])
def test_neighbours_are_those_closer_than_2h(smoothing_ratio, count):
    assert neighbour_count(smoothing_ratio) == count


def test_coefficients_of_appendix_b():
    for a in (1.04, 1.2, 1.37):
        assert derivative_coefficient(a) == pytest.approx(8 / a**2 - 12 / a**3 + 5 / a**4)
        assert dispersion_coefficient(a) == pytest.approx(16 / 3 / a**2 - 10 / a**3 + 29 / 6 / a**4)
