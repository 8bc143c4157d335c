"""Time steps from which runs grow, beside those that theory predicts."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from examples import examples
from hypothesis import example, given
from hypothesis import strategies as st
from scenes import VARIED, scene

from sphpod.full import lifted, sph
from sphpod.pipeline import dataset
from sphpod.reduced import lifted_rom, rom
from sphpod.reduced.pod import modes as proper_modes
from sphpod.stability.spectrum import FullSpectrum
from sphpod.studies import time_steps

THREE_WAVES = "1e-3*sum(sin(2*pi*l*x/L + l) for l in range(1, 4))"
KINDS: dict[str, dict[str, Any]] = {
    "plain": {},
    "damped": {"damping": 3},
    "stiffly damped": {"damping": 100},
    "damped and forced": {"damping": 3, "force": VARIED["force"]},
    "varied": VARIED,
    "jittered": {"damping": 2, "positions": {"jitter": 0.2, "seed": 1}},
}
each = pytest.mark.parametrize("changes", KINDS.values(), ids=KINDS)
ROWS = {
    "contender", "integrator", "contender_mode_count", "contender_time_step",
    "predicted_time_step", "measured_time_step", "predicted_growth_rate", "measured_growth_rate",
}  # fmt: skip


def decomposed(case):
    """Modes of plain snapshots and of scaled ones, of full SPH."""
    solution = sph.solve(case, case.error_steps[::4])
    snapshots = {f"{name}_snapshots": solution[name] for name in ("velocity", "density")}
    plain = {
        f"{name}_modes": proper_modes(solution[name])[0][:15] for name in ("velocity", "density")
    }
    return plain, lifted_rom.decompose(case, snapshots)


def differences(arrays):
    return [row["relative_difference"] for row in time_steps.rows({}, arrays)]


def fits_dataset(arrays, path, variables=time_steps.STUDY.variables):
    dataset.write(path, arrays, title="test", settings={}, code="none", variables=variables)
    return set(dataset.read(path)) == set(arrays)


@examples(8)
@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(7, 14),
    ratio=st.sampled_from([0.9, 1.04, 1.7]),
    damped=st.sampled_from(["not", "evenly", "unevenly"]),
    jitter=st.sampled_from([0, 0.2]),
)
# Beyond the limit of this one, full SPH saturates before it breaks down.
@example(seed=3, count=8, ratio=0.9, damped="evenly", jitter=0)
def test_full_models_grow_from_the_predicted_step_on(seed, count, ratio, damped, jitter):
    rng = np.random.default_rng(seed)

    def profile(size, depth):
        wave, shift = rng.integers(1, 4), rng.uniform(0, 6)
        return f"{size}*(1 + {rng.uniform(0, depth)}*sin(2*pi*{wave}*x/L + {shift}))"

    size = rng.uniform(0.1, 30)
    case = scene(
        particle_count=count,
        smoothing_ratio=ratio,
        initial_density=profile(rng.uniform(0.5, 2), 0.6),
        youngs_modulus=profile(rng.uniform(0.05, 0.5), 0.6),
        damping={"not": 0, "evenly": size, "unevenly": profile(size, 0.8)}[damped],
        positions={"jitter": jitter, "seed": 1},
    )
    np.testing.assert_allclose(differences(time_steps.full(case)), 0, atol=1e-3)


@pytest.mark.slow
@each
def test_what_is_reported_of_full_models(changes, tmp_path):
    arrays = time_steps.full(scene(particle_count=20, **changes))
    assert set(arrays) == ROWS
    assert fits_dataset(arrays, tmp_path / "limits.nc")
    assert arrays["integrator"].tolist() == ["explicit_euler", *lifted.INTEGRATORS]
    assert arrays["contender"].tolist() == ["sph"] + ["lifted_full"] * len(lifted.INTEGRATORS)
    assert not arrays["contender_mode_count"].any()
    grows = ~np.isnan(arrays["predicted_growth_rate"])
    undamped = "damping" not in changes
    np.testing.assert_array_equal(grows, undamped & (arrays["integrator"] == "explicit_euler"))
    np.testing.assert_array_equal(grows, np.isnan(arrays["predicted_time_step"]))
    np.testing.assert_array_equal(grows, ~np.isnan(arrays["contender_time_step"]))
    np.testing.assert_array_equal(
        arrays["integrator"] == "exact", np.isinf(arrays["measured_time_step"])
    )
    np.testing.assert_allclose(differences(arrays), 0, atol=1e-4)


@pytest.mark.slow
@each
def test_reduced_models_grow_from_the_predicted_step_on(changes, tmp_path):
    case = scene(initial_velocity=THREE_WAVES, **changes)
    arrays = time_steps.reduced(case, [3, 9], *decomposed(case))
    assert set(arrays) == ROWS
    assert fits_dataset(arrays, tmp_path / "limits.nc")
    assert arrays["contender"].tolist() == 2 * ["original", "frozen10", *lifted_rom.METHODS]
    assert arrays["contender_mode_count"].tolist() == 4 * [3] + 4 * [9]
    np.testing.assert_allclose(differences(arrays), 0, atol=1e-2)
    linear = np.char.startswith(arrays["contender"], "lifted")
    np.testing.assert_allclose(np.array(differences(arrays))[linear], 0, atol=1e-4)


def test_the_measurement_knows_no_prediction():
    case = scene(particle_count=20, damping=3)
    block = FullSpectrum(case).critical("leapfrog")
    contender = time_steps.Contender(
        "lifted_full", "leapfrog", 0, time_steps.march_full(case, "leapfrog"), 1000,
        lambda dt: block.fastest_growing("leapfrog", dt), 1.0, 0.0, 10.0,
    )  # fmt: skip
    measured = contender.measure(case)["measured_time_step"]
    assert measured == pytest.approx(FullSpectrum(case).limit("leapfrog"), rel=1e-4)
    other = replace(contender, limit=7.0, fastest=20.0).measure(case)
    assert other["measured_time_step"] == pytest.approx(measured, rel=3e-5)
    assert other["predicted_time_step"] == 7


@examples(50)
@given(st.floats(0.5, 1.5), st.floats(0, 3), st.integers(0, 100))
def test_both_phases_show_growth_without_oscillation(size, angle, seed):
    rng = np.random.default_rng(seed)
    vectors = rng.standard_normal((4, 4)) + 3 * np.eye(4)
    turn = size * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    matrix = vectors @ np.block([[turn, np.zeros((2, 2))], [np.zeros((2, 2)), 0.1 * np.eye(2)]])
    matrix = matrix @ np.linalg.inv(vectors)

    def march(state, time_step, stride, outputs):
        powers = [np.linalg.matrix_power(matrix, stride * n) for n in range(outputs + 1)]
        return np.array([power @ state for power in powers])

    eigenvector = vectors[:, 0] - 1j * vectors[:, 1]
    for steps in (1, 7, 30):
        found = time_steps.growth(march, eigenvector, 1.0, steps)
        assert found == pytest.approx(np.log(size), abs=1e-9)
    states = march(rng.standard_normal(4), 1.0, 5, 100)
    assert time_steps.late_growth(states, 5) == pytest.approx(np.log(size), abs=0.1)


def test_only_what_floating_point_holds_tells_growth():
    states = np.exp(np.arange(700.0))[:, None]
    assert time_steps.late_growth(states, 2) == pytest.approx(0.5)
    states[40:] = np.nan
    assert time_steps.late_growth(states, 2) == pytest.approx(0.5)
    assert time_steps.late_growth(states[39:], 2) == np.inf


def test_runs_that_leave_all_bounds_have_grown():
    def march(state, time_step, stride, outputs):
        return np.array([state, np.full_like(state, np.nan)])

    assert time_steps.growth(march, np.ones(3), 1.0, 5) == np.inf
    assert time_steps.growth(lambda *_: np.zeros((2, 3)), np.ones(3), 1.0, 5) == -np.inf


@each
def test_a_nonlinear_model_runs_as_its_operator_for_small_seeds(changes):
    case = scene(initial_velocity=THREE_WAVES, **changes)
    modes, _ = decomposed(case)
    for method in time_steps.MODELS:
        model = rom.galerkin(case, method, modes, 9)
        march, size = time_steps.march_galerkin(model), 18
        np.testing.assert_array_equal(march(np.zeros(size), 1e-3, 3, 4), 0)
        seed = 1e-7 * np.random.default_rng(0).standard_normal(size)
        step = np.eye(size) + 1e-3 * model.operator()
        expected = np.linalg.matrix_power(step, 50) @ seed
        found = march(seed, 1e-3, 50, 1)[-1]
        np.testing.assert_allclose(found, expected, atol=1e-3 * np.abs(expected).max())
    assert np.isnan(march(1e9 * seed, 1e-3, 50, 1)[-1]).any()


def test_full_sph_runs_as_the_lifted_model_for_small_seeds():
    case = scene(**VARIED)
    seed = 1e-7 * np.random.default_rng(0).standard_normal(2 * case.particle_count)
    one, other = (
        time_steps.march_full(case, "explicit_euler", paper)(seed, 1e-3, 10, 3)
        for paper in (True, False)
    )
    np.testing.assert_allclose(one, other, atol=1e-5 * np.abs(seed).max())


def test_rows_tell_limits_or_rates():
    arrays = {
        "contender": np.array(["sph", "lifted_full"]),
        "integrator": np.array(["explicit_euler", "exact"]),
        "contender_mode_count": np.array([0, 0]),
        "predicted_time_step": np.array([np.nan, np.inf]),
        "measured_time_step": np.array([np.nan, np.inf]),
        "predicted_growth_rate": np.array([0.2, np.nan]),
        "measured_growth_rate": np.array([0.21, np.nan]),
    }
    first, second = time_steps.rows({"scene": "test", "sampling": ""}, arrays)
    assert list(first) == [
        "scene", "sampling", "model", "modes", "integrator", "quantity", "predicted_limit",
        "measured_limit", "relative_difference",
    ]  # fmt: skip
    assert first["quantity"] == "growth_rate [1/s]"
    assert first["relative_difference"] == pytest.approx(0.05)
    assert second["quantity"] == "time_step [s]"
    assert second["relative_difference"] == 0
