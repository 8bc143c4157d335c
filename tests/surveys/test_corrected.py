"""Corrected modes: their systems solved, and a bound that holds whatever they are."""

import numpy as np
import pytest
from scipy.sparse import csr_array
from test_query import made, point_of, scaled

from sphpod.surveys import corrected, samples
from sphpod.surveys.parts import Operators
from sphpod.surveys.query import Survey


@pytest.mark.parametrize(("count", "reach"), [(24, 2), (25, 3), (9, 4)])
def test_shifted_systems_are_solved(count, reach) -> None:
    """The last ring has as many neighbours as there are."""
    drawn = np.random.default_rng(2)
    away = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    dense = drawn.standard_normal((count, count)) * (np.minimum(away, count - away) <= reach)
    shifts = -((drawn.uniform(1, 30, (5, 1)) + 0.3j) ** 2) + 0.1j * drawn.uniform(0, 1, count)
    right = drawn.standard_normal((5, count)) + 1j * drawn.standard_normal((5, count))
    solved = right.copy()
    corrected.solve_shifted(*corrected.folded(csr_array(dense @ dense.T)), shifts, solved)
    for shift, one, given in zip(shifts, solved, right, strict=True):
        exact = np.linalg.solve(dense @ dense.T + np.diag(shift), given)
        np.testing.assert_allclose(one, exact, atol=1e-9 * np.abs(exact).max())


@pytest.fixture(scope="module")
def surveys():
    return {case: made(case) for case in ("uniform_damping", "uneven_damping", "forced")}


@pytest.mark.slow
@pytest.mark.parametrize("case", ["uniform_damping", "uneven_damping", "forced"])
@pytest.mark.parametrize("shift", [0.01, *corrected.SHIFTS, 1e3])
@pytest.mark.parametrize("shared", [False, True])
def test_the_bound_holds_whatever_the_shift_is(surveys, case, shift, shared, monkeypatch) -> None:
    monkeypatch.setattr("sphpod.surveys.query.SHIFTS", (shift,))
    resolved, survey = surveys[case]
    operators = survey.operators
    modes = {"velocity_modes": operators.velocity_modes, "translation": operators.rigid}
    if not shared:
        survey = Survey(Operators("bar", resolved, modes), survey.count)
    for point in samples.points(resolved["parameters"], {"count": 4, "sampling": "uniform"}):
        values = point_of(resolved, point)
        answer = survey.answer(values)
        ours, full = scaled(survey, answer, samples.scene_at("bar", resolved, values))
        error = np.linalg.norm(ours - full, axis=1)
        assert np.all(error <= answer.bound + 1e-11 * answer.largest_norm)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("damping", "most"),
    [("decay", 3), ("decay*(1 + 0.9*sin(2*pi*x/L))", 4), ("where(x < L/4, 3*decay, 0)", 12)],
)
def test_the_bound_is_a_few_times_the_error(damping, most) -> None:
    waves = "4e-3*x*(1 - x)*sum(sin(2*pi*n*x + n**2) for n in range(1, 6))"
    changes = {
        "duration": 10,
        "initial_velocity": waves,
        "initial_density": 1,
        "youngs_modulus": "stiffness*(1 + contrast*sin(2*pi*x/L))",
        "damping": damping,
        "error_interval": 0.1,
    }
    resolved, survey = made(changes, count=24, training=8, particles=100)
    for point in samples.points(resolved["parameters"], {"count": 2, "sampling": "uniform"}):
        values = point_of(resolved, point)
        answer = survey.answer(values)
        ours, full = scaled(survey, answer, samples.scene_at("bar", resolved, values))
        error = np.linalg.norm(ours - full, axis=1).max()
        assert error <= answer.bound.max() <= most * error
