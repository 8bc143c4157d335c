"""Oscillators of symmetric matrices, of which a few vectors alone are asked."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from sphpod.numerics import oscillators

INTERVAL = 0.3


def symmetric(values, seed=0):
    """A matrix of given eigenvalues, and its eigenvectors as columns."""
    vectors = np.linalg.qr(np.random.default_rng(seed).standard_normal((len(values),) * 2))[0]
    return (vectors * values) @ vectors.T, vectors


def diagonalised(matrix, vectors):
    values, beside, own = np.empty(len(matrix)), np.empty(len(matrix)), vectors.copy()
    oscillators.reflect(matrix.copy(), values, beside, own)
    oscillators.rotate(values, beside, own)
    return values, own


MATRICES = {
    "random": symmetric(np.random.default_rng(1).uniform(0, 1e4, 40))[0],
    "graded": symmetric(10.0 ** np.linspace(-8, 4, 25))[0],
    "repeated": symmetric(np.repeat([0.0, 1.0, 1.0, 3.0], 5))[0],
    "rank_one": np.ones((9, 9)),
    "diagonal": np.diag([3.0, 0.0, 1.0, 1.0]),
    "tridiagonal": np.diag([2.0] * 30) - np.diag([1.0] * 29, 1) - np.diag([1.0] * 29, -1),
    "zero": np.zeros((5, 5)),
    "split": np.kron(np.eye(2), [[2.0, 1.0], [1.0, 2.0]]),
    "single": np.array([[4.0]]),
}


@pytest.mark.parametrize("name", sorted(MATRICES))
def test_eigenvalues_are_those_of_lapack_and_vectors_give_functions_of_the_matrix(name) -> None:
    matrix = MATRICES[name]
    vectors = np.random.default_rng(2).standard_normal((3, len(matrix)))
    values, own = diagonalised(matrix, vectors)
    size = max(np.abs(matrix).max(), 1e-300)
    accuracy = 1e-14 * len(matrix)
    np.testing.assert_allclose(np.sort(values), np.linalg.eigvalsh(matrix), atol=accuracy * size)
    scaled = matrix / size
    power = np.eye(len(matrix))
    for n in range(4):
        expected = vectors @ power @ vectors.T
        found = (own * (values / size) ** n) @ own.T
        np.testing.assert_allclose(found, expected, atol=accuracy * np.abs(expected).max())
        power = power @ scaled


def test_what_is_no_number_ends_too() -> None:
    values, _ = diagonalised(np.full((4, 4), np.nan), np.ones((1, 4)))
    assert np.isnan(values).any()


def solved(terms, factors, decays, starts, sensors, is_velocity, outputs=30):
    """Histories (queries, sensors, outputs) and energies (queries, outputs)."""
    found = np.empty((len(decays), 1 + len(is_velocity), outputs))
    vectors = np.concatenate([np.asarray(starts)[:, None], sensors], axis=1)
    given = (np.array(each, float) for each in (terms, factors, decays, vectors))
    oscillators.solve_each(*given, np.array(is_velocity), INTERVAL, found)
    return found[:, 1:], found[:, 0]


def case(seed, count=12, queries=5):
    rng = np.random.default_rng(seed)
    terms = [symmetric(rng.uniform(0, 900, count), seed + n)[0] for n in range(2)]
    factors, decays = rng.uniform(0.5, 2, (queries, 2)), rng.uniform(0, 70, queries)
    decays[0] = 0
    starts, sensors = (rng.standard_normal((queries, *more, count)) for more in ((), (3,)))
    return terms, factors, decays, starts, sensors, [True, False, False]


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**16))
def test_histories_and_energies_are_those_of_the_exponential(seed) -> None:
    terms, factors, decays, starts, sensors, is_velocity = case(seed)
    histories, energies = solved(terms, factors, decays, starts, sensors, is_velocity)
    count = starts.shape[1]
    for n, decay in enumerate(decays):
        stiffness = np.tensordot(factors[n], terms, 1)
        eye, none = np.eye(count), np.zeros((count, count))
        jump = expm(INTERVAL * np.block([[-decay * eye, -stiffness], [eye, none]]))
        state = [np.concatenate([starts[n], np.zeros(count)])]
        for _ in range(energies.shape[1] - 1):
            state.append(jump @ state[-1])
        velocity, place = np.array(state)[:, :count], np.array(state)[:, count:]
        squares = (velocity**2).sum(axis=1) + ((place @ stiffness) * place).sum(axis=1)
        np.testing.assert_allclose(energies[n], squares / 2, atol=1e-11 * squares[0])
        for m, of_velocity in enumerate(is_velocity):
            expected = (velocity if of_velocity else place) @ sensors[n, m]
            size = float(np.linalg.norm(starts[n]) * np.linalg.norm(sensors[n, m]))
            np.testing.assert_allclose(histories[n, m], expected, atol=1e-11 * size)


def test_a_query_does_not_depend_on_those_beside_it() -> None:
    given = case(3)
    whole = solved(*given)
    terms, factors, decays, starts, sensors, is_velocity = given
    for order in ([4], [3, 0], [2, 2, 1]):
        each = factors[order], decays[order], starts[order], sensors[order]
        part = solved(terms, *each, is_velocity)
        for some, every in zip(part, whole, strict=True):
            assert some.tobytes() == every[order].tobytes()


@pytest.mark.parametrize("stiffness", [0.0, 1e-20, 1.0, 4.0, 4.0 * (1 + 1e-15), 9.0, 1e6])
@pytest.mark.parametrize("decay", [0.0, 4.0, 50.0])
def test_a_jump_is_the_exponential_where_it_oscillates_creeps_or_does_neither(
    stiffness, decay
) -> None:
    jump = np.reshape(oscillators.jump(stiffness, decay, 0.01), (2, 2))
    expected = expm(0.01 * np.array([[-decay, -stiffness], [1.0, 0.0]]))
    scale = np.diag([1, np.sqrt(max(stiffness, 1))])
    np.testing.assert_allclose(
        scale @ jump @ np.linalg.inv(scale), scale @ expected @ np.linalg.inv(scale), atol=1e-12
    )


def test_without_damping_energy_stays() -> None:
    terms, factors, _, starts, sensors, is_velocity = case(5)
    _, energies = solved(terms, factors, np.zeros(5), starts, sensors, is_velocity, outputs=1001)
    np.testing.assert_allclose(energies, np.tile(energies[:, :1], 1001), rtol=1e-11)
