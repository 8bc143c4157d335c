"""Cubic spline kernel, its gradient, and the weights with which particles see their neighbours."""

import numpy as np


def kernel(x, h):
    """Cubic spline W_h(x) in one dimension (section 2.2), support |x| < 2h.

    Parameters
    ----------
    x : array
        Distance between two particles [m].
    h : float
        Smoothing length [m].

    Returns
    -------
    array
        Kernel values [1/m], shape of ``x``.
    """
    q = np.abs(np.asarray(x, dtype=float)) / h
    inner = 1 - 1.5 * q**2 + 0.75 * q**3
    outer = 0.25 * np.maximum(2 - q, 0) ** 3
    return 2 / (3 * h) * np.where(q <= 1, inner, outer)


def kernel_gradient(x, h):
    """Derivative of the cubic spline W_h with respect to x (section 2.2).

    Parameters
    ----------
    x : array
        Signed distance x_i - x_j [m].
    h : float
        Smoothing length [m].

    Returns
    -------
    array
        Kernel gradient [1/m²], shape of ``x``; odd in ``x``.
    """
    x = np.asarray(x, dtype=float)
    q = np.abs(x) / h
    inner = -3 * q + 2.25 * q**2
    outer = -0.75 * np.maximum(2 - q, 0) ** 2
    return 2 / (3 * h**2) * np.sign(x) * np.where(q <= 1, inner, outer)


def neighbour_count(smoothing_ratio):
    """Number of neighbours on each side of an evenly spaced particle: those closer than 2h."""
    return int(min(np.ceil(2 * smoothing_ratio - 1e-12), 2.0**53)) - 1


def stencil_weights(spacing, smoothing_ratio):
    """Weights w_k of the SPH derivative of evenly spaced particles (appendix B).

    The derivative of f at particle i is ``sum_k w_k (f[i+k] - f[i-k])``.

    Parameters
    ----------
    spacing : float
        Distance Δx between neighbouring particles [m].
    smoothing_ratio : float
        α = h/Δx.

    Returns
    -------
    array, shape (neighbours on one side,)
        w_k = V ∇W(-kΔx) for k = 1, 2, … with the particle volume V = Δx [1/m].
    """
    k = np.arange(1, neighbour_count(smoothing_ratio) + 1)
    return spacing * kernel_gradient(-k * spacing, smoothing_ratio * spacing)


def derivative(field, weights):
    """SPH derivative of fields on evenly spaced particles, along their last axis.

    It is antisymmetric: the sum over particles of ``a * derivative(b)`` is minus that of
    ``b * derivative(a)``.

    Parameters
    ----------
    field : array, shape (..., N)
    weights : array
        From ``stencil_weights`` [1/m].

    Returns
    -------
    array, shape (..., N)
    """
    return sum(
        w * (np.roll(field, -k, axis=-1) - np.roll(field, k, axis=-1))
        for k, w in enumerate(weights, start=1)
    )


def derivative_coefficient(smoothing_ratio):
    """Coefficient β of f' in the SPH derivative of a smooth function (appendix B)."""
    weights = stencil_weights(1.0, smoothing_ratio)
    k = np.arange(1, weights.size + 1)
    return float(2 * np.sum(k * weights))


def dispersion_coefficient(smoothing_ratio):
    """Coefficient of f''' Δx² in the SPH derivative of a smooth function (appendix B)."""
    weights = stencil_weights(1.0, smoothing_ratio)
    k = np.arange(1, weights.size + 1)
    return float(np.sum(k**3 * weights) / 3)


def neighbour_lists(positions, volumes, h, domain_length):
    """Neighbours j ~ i of each particle and the weights V_j ∇W_ij, for any sorted positions.

    Parameters
    ----------
    positions : array, shape (N,)
        Particle positions [m], ascending, in [0, L).
    volumes : array, shape (N,)
        Particle volumes V_j = m_j/ρ_j(0) [m].
    h : float
        Smoothing length [m].
    domain_length : float
        Period L [m].

    Returns
    -------
    first, neighbours, gradients : arrays, shapes (N+1,), (M,), (M,)
        The neighbours of particle i are ``neighbours[first[i]:first[i+1]]`` (uint64), with
        weights ``gradients`` [1/m] at the same places.
    """
    count = positions.size
    images = np.concatenate([positions - domain_length, positions, positions + domain_length])
    lower = np.searchsorted(images, positions - 2 * h, side="right")
    upper = np.searchsorted(images, positions + 2 * h, side="left")
    lengths = upper - lower
    first = np.concatenate([[0], np.cumsum(lengths)])
    image = np.arange(first[-1]) - np.repeat(first[:-1] - lower, lengths)
    particle = np.repeat(np.arange(count), lengths)
    neighbours = image % count
    gradients = volumes[neighbours] * kernel_gradient(positions[particle] - images[image], h)
    keep = neighbours != particle
    first = np.concatenate([[0], np.cumsum(np.bincount(particle[keep], minlength=count))])
    return first.astype(np.uint64), neighbours[keep].astype(np.uint64), gradients[keep]
