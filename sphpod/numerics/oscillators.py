"""Damped oscillators of many symmetric matrices, each seen by a few vectors alone.

For each query, with K = Σ θ_i K_i symmetric and not negative,

    v' = -K q - d v,    q' = v,    q(0) = 0,

is solved exactly at even outputs. What is asked of it are inner products with a few vectors and
the energy ½ (|v|² + qᵀK q), which need no eigenvectors: Householder reflections make K tridiagonal,
and implicit QL rotations diagonal (Golub & Van Loan, Matrix Computations, 8.3); both are applied to
these vectors alone. So a query takes about k³ multiply-adds and k² rotations, whatever the duration
is, half as long as eigenvectors would; and its result does not depend on the queries beside it.
"""

import math

import numpy as np

from sphpod.numerics.compiled import compiled_sums

SWEEPS = 30
"""QL sweeps an eigenvalue, at most; two are common."""

SMALL = 2.0**-53
"""Part of the neighbours on the diagonal that an entry beside it may be, and counts as none."""


@compiled_sums
def reflect(matrix, diagonal, beside, vectors):
    """Make a symmetric matrix tridiagonal, from its last row on.

    Each reflection 1 - u uᵀ/h changes the matrix by -u pᵀ - p uᵀ. That change is made while the
    matrix is multiplied by the vector of the next reflection, which needs one row alone.

    Parameters
    ----------
    matrix : array, shape (k, k)
        Lost.
    diagonal, beside : arrays, shape (k,)
        Become the diagonal, and the entries (i, i + 1) beside it.
    vectors : array, shape (n, k)
        Become their coordinates in the new basis.
    """
    count = diagonal.size
    u, p, new = np.zeros(count), np.zeros(count), np.empty(count)
    beside[count - 1] = 0
    for i in range(count - 1, 0, -1):
        square = 0.0
        for j in range(i):
            new[j] = matrix[i, j] - u[i] * p[j] - p[i] * u[j]
            square += new[j] * new[j]
        diagonal[i] = matrix[i, i] - 2 * u[i] * p[i]
        beside[i - 1] = -math.copysign(math.sqrt(square), new[i - 1])
        half = square - beside[i - 1] * new[i - 1]
        new[i - 1] -= beside[i - 1]
        share = 1 / half if half > 0 else 0.0
        inner = 0.0
        for a in range(i):
            u_a, p_a, product = u[a], p[a], 0.0
            for b in range(i):
                matrix[a, b] -= u_a * p[b] + p_a * u[b]
                product += matrix[a, b] * new[b]
            diagonal[a] = product * share
            inner += diagonal[a] * new[a]
        inner *= share / 2
        for a in range(i):
            u[a] = new[a]
            p[a] = diagonal[a] - inner * new[a]
        for vector in vectors:
            inner = 0.0
            for a in range(i):
                inner += vector[a] * u[a]
            inner *= share
            for a in range(i):
                vector[a] -= inner * u[a]
    diagonal[0] = matrix[0, 0] - 2 * u[0] * p[0]


@compiled_sums
def rotate(diagonal, beside, vectors):
    """Make a tridiagonal matrix diagonal, by implicit QL sweeps with Wilkinson's shift.

    Parameters
    ----------
    diagonal, beside : arrays, shape (k,)
        As from `reflect`. The first becomes the eigenvalues, the second is lost.
    vectors : array, shape (n, k)
        Become their coordinates in the eigenvectors.
    """
    count = diagonal.size
    cosines, sines = np.empty(count), np.empty(count)
    first = 0
    for _ in range(SWEEPS * count):
        last = first
        while last < count - 1:
            size = abs(diagonal[last]) + abs(diagonal[last + 1])
            if abs(beside[last]) <= SMALL * size:
                break
            last += 1
        if last == first:
            first += 1
            if first == count:
                break
            continue
        ratio = (diagonal[first + 1] - diagonal[first]) / (2 * beside[first])
        root = math.copysign(math.sqrt(ratio * ratio + 1), ratio)
        bulge = diagonal[last] - diagonal[first] + beside[first] / (ratio + root)
        sine, cosine, shift = 1.0, 1.0, 0.0
        for i in range(last - 1, first - 1, -1):
            out, along = sine * beside[i], cosine * beside[i]
            beside[i + 1] = math.sqrt(out * out + bulge * bulge)
            if beside[i + 1] > 0:
                inverse = 1 / beside[i + 1]
                sine, cosine = out * inverse, bulge * inverse
            else:
                sine, cosine = 0.0, 1.0
            bulge = diagonal[i + 1] - shift
            turned = (diagonal[i] - bulge) * sine + 2 * cosine * along
            shift = sine * turned
            diagonal[i + 1] = bulge + shift
            bulge = cosine * turned - along
            cosines[i], sines[i] = cosine, sine
        diagonal[first] -= shift
        beside[first], beside[last] = bulge, 0.0
        for vector in vectors:
            carried = vector[last]
            for i in range(last - 1, first - 1, -1):
                vector[i + 1] = sines[i] * vector[i] + cosines[i] * carried
                carried = cosines[i] * vector[i] - sines[i] * carried
            vector[first] = carried


@compiled_sums
def jump(stiffness, decay, interval):
    """From output to output: of v by v and by q, and of q by v and by q."""
    rate = decay / 2
    square = stiffness - rate * rate
    root = math.sqrt(abs(square))
    if square > 0:
        size = math.exp(-rate * interval)
        even, odd = size * math.cos(root * interval), size * math.sin(root * interval) / root
    else:
        size, fall = math.exp((root - rate) * interval), math.expm1(-2 * root * interval)
        even, odd = size * (1 + fall / 2), size * (-fall / (2 * root) if root > 0 else interval)
    return even - rate * odd, -stiffness * odd, odd, even + rate * odd


@compiled_sums
def solve_each(terms, factors, decays, vectors, is_velocity, interval, found):
    """Solve queries one by one.

    Parameters
    ----------
    terms : array, shape (terms, k, k)
        K_i [1/s²].
    factors : array, shape (queries, terms)
        θ_i.
    decays : array, shape (queries,)
        d [1/s].
    vectors : array, shape (queries, 1 + sensors, k)
        v at t = 0, and vectors that v or q is multiplied by.
    is_velocity : bool array, shape (sensors,)
        Whether v is.
    interval : float
        Time from output to output [s].
    found : array, shape (queries, 1 + sensors, outputs)
        Filled with the energy and those products, from t = 0 on.
    """
    count = terms.shape[1]
    matrix, own = np.empty((count, count)), np.empty(vectors.shape[1:])
    values, beside = np.empty(count), np.empty(count)
    jumps, velocity, place = np.empty((4, count)), np.empty(count), np.empty(count)
    for query in range(len(decays)):
        matrix[:] = 0
        for term in range(len(terms)):
            for i in range(count):
                for j in range(count):
                    matrix[i, j] += factors[query, term] * terms[term, i, j]
        own[:] = vectors[query]
        reflect(matrix, values, beside, own)
        rotate(values, beside, own)
        for j in range(count):
            values[j] = max(values[j], 0.0)  # rounding may make it negative
            velocity[j], place[j] = own[0, j], 0.0
            one, two, three, four = jump(values[j], decays[query], interval)
            jumps[0, j], jumps[1, j], jumps[2, j], jumps[3, j] = one, two, three, four
        for output in range(found.shape[2]):
            energy = 0.0
            for j in range(count):
                energy += velocity[j] * velocity[j] + values[j] * place[j] * place[j]
            found[query, 0, output] = energy / 2
            for sensor in range(len(is_velocity)):
                sensed = 0.0
                if is_velocity[sensor]:
                    for j in range(count):
                        sensed += own[1 + sensor, j] * velocity[j]
                else:
                    for j in range(count):
                        sensed += own[1 + sensor, j] * place[j]
                found[query, 1 + sensor, output] = sensed
            for j in range(count):
                now = velocity[j]
                velocity[j] = jumps[0, j] * now + jumps[1, j] * place[j]
                place[j] = jumps[2, j] * now + jumps[3, j] * place[j]
