"""Reduced models."""

import numpy as np
import pytest
from scenes import VARIED, scene

from sphpod import error, pod, rom, snapshots, sph
from sphpod.kernel import derivative, stencil_weights
from sphpod.rom import ReducedModel
from sphpod.stability import Breakdown

SETTINGS = {
    "plain": {},
    "damped": {"damping": 3},
    "unevenly damped": {"damping": "3 + sin(2*pi*x/L)"},
    "forced": {"force": "1e-3*cos(9*t)"},
    "varied": VARIED,
    "four neighbours": {"smoothing_ratio": 2.3},
}
SAMPLING = {"range": [0, 1], "count": 25}


def snapshot_modes(case):
    full = sph.solve(case, snapshots.output_steps(case, [SAMPLING]))
    return pod.decompose(snapshots.extract(case, SAMPLING, full))


@pytest.mark.parametrize("changes", SETTINGS.values(), ids=SETTINGS)
def test_with_all_modes_the_original_model_is_full_sph(changes):
    case = scene(**changes)
    every = np.eye(case.particle_count)
    full = sph.solve(case, case.error_steps)
    velocity, density, breakdown = ReducedModel(case, "original", every, every).solve(
        case.error_steps
    )
    assert breakdown is None
    np.testing.assert_allclose(velocity, full["velocity"], rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(density, full["density"], rtol=1e-11)
    rotation = np.linalg.qr(np.random.default_rng(0).standard_normal(every.shape))[0]
    velocity, density, _ = ReducedModel(case, "original", rotation, rotation.T).solve(
        case.error_steps
    )
    np.testing.assert_allclose(velocity @ rotation, full["velocity"], rtol=1e-7, atol=1e-13)
    np.testing.assert_allclose(density @ rotation.T, full["density"], rtol=1e-10)


@pytest.mark.parametrize("changes", SETTINGS.values(), ids=SETTINGS)
@pytest.mark.parametrize("count", [3, 8])
def test_frozen_for_one_step_is_linearized(changes, count):
    case = scene(**changes)
    modes = snapshot_modes(case)
    chosen = modes["velocity_modes"][:count], modes["density_modes"][: count + 1]
    velocity, density, _ = ReducedModel(case, "linearized", *chosen).solve(case.error_steps)
    frozen_velocity, frozen_density, _ = ReducedModel(case, "frozen1", *chosen).solve(
        case.error_steps
    )
    for a, b in ((velocity, frozen_velocity), (density, frozen_density)):
        np.testing.assert_allclose(a, b, rtol=1e-8, atol=1e-11 * np.abs(a).max())


@pytest.mark.parametrize("changes", SETTINGS.values(), ids=SETTINGS)
@pytest.mark.parametrize("n_freeze", [1, 3, 10])
def test_frozen_coefficients_follow_their_definition_in_either_form(changes, n_freeze, monkeypatch):
    """Equations 2.26 to 2.30 with dense matrices, step by step."""
    case = scene(**changes)
    modes = snapshot_modes(case)
    uv, ur = modes["velocity_modes"][:5].T, modes["density_modes"][:6].T
    identity = np.eye(case.particle_count)
    g = derivative(identity, stencil_weights(case.spacing, case.smoothing_ratio)).T
    density0, modulus = case.density0(), case.modulus()
    a_matrix = g * modulus / density0[:, None] / density0
    b_matrix = g * modulus / density0[:, None]
    d = np.diag(case.damping_values()) if case.damping else np.zeros_like(g)
    a, b, dt = uv.T @ case.velocity0(), ur.T @ density0, case.time_step
    steps = np.array([0, 1, 12, 40])
    amplitude, profile = case.force_values(np.arange(40) * dt)
    expected = []
    for step in range(41):
        if step in steps:
            expected.append((a, b))
        if step == 40:
            break
        if step % n_freeze == 0:
            c_matrix = ((ur @ b) ** 2 / density0)[:, None] * g
            force = uv.T @ profile * amplitude[step] if amplitude.size else 0.0
        pull = uv.T @ (a_matrix @ (ur @ b) - b_matrix.sum(axis=1))
        a, b = (
            a + dt * (force - pull - uv.T @ d @ uv @ a),
            b - dt * ur.T @ c_matrix @ uv @ a,
        )
    for cheaper in (True, False):
        monkeypatch.setattr(rom, "tensor_is_cheaper", lambda *_, cheaper=cheaper: cheaper)
        velocity, density, _ = ReducedModel(case, f"frozen{n_freeze}", uv.T, ur.T).solve(steps)
        for found, want in zip((velocity, density), zip(*expected, strict=True), strict=True):
            np.testing.assert_allclose(found, want, rtol=1e-9, atol=1e-12)


def test_the_form_with_fewer_operations_is_chosen():
    assert rom.tensor_is_cheaper(12, 12, 400, 10)
    assert not rom.tensor_is_cheaper(20, 20, 100, 1)


def test_errors_fall_to_rounding_of_the_model_and_equal_those_of_the_fields():
    case = scene()
    modes = snapshot_modes(case)
    full = sph.solve(case, case.error_steps)
    projections = {f: error.project(full[f], modes[f"{f}_modes"]) for f in ("velocity", "density")}
    result = rom.sweep(case, "original", [2, 4, 8, 12], modes, projections, projections)
    assert result["mode_count"].tolist() == [2, 4, 8, 12]
    for field in ("velocity", "density"):
        errors = result[f"{field}_error_sph"]
        assert np.all(np.diff(errors) < 0)
        single = rom.sweep(case, "original", [4], modes, projections, projections)
        lifted = single[f"{field}_coordinates"] @ modes[f"{field}_modes"][:4]
        direct = error.relative_error(lifted, full[field])
        assert single[f"{field}_error_sph"][0] == pytest.approx(errors[1], rel=1e-9)
        assert direct == pytest.approx(errors[1], rel=1e-6)
    assert np.isnan(result["breakdown_time"]).all()
    assert "t" not in result


@pytest.mark.parametrize("changes", SETTINGS.values(), ids=SETTINGS)
@pytest.mark.parametrize("method", ["original", "linearized", "frozen2"])
def test_models_run_together_as_they_run_alone(changes, method):
    case = scene(**changes)
    modes = snapshot_modes(case)
    # The density has one mode more than the velocity, as far as there are that many.
    models = [
        ReducedModel(case, method, modes["velocity_modes"][:k], modes["density_modes"][: k + 1])
        for k in (1, 2, 3, 4, 6, 7, 11, 12, 13, 14, 15, 16)
    ]
    together = list(rom.solve_each(models, case.error_steps))
    assert len(together) == len(models)
    for model, (velocity, density, _) in zip(models, together, strict=True):
        alone = model.solve(case.error_steps)
        np.testing.assert_allclose(velocity, alone[0], rtol=1e-9, atol=1e-14)
        np.testing.assert_allclose(density, alone[1], rtol=1e-9, atol=1e-12)


def test_a_model_that_breaks_down_is_told_of_and_does_not_stop_a_sweep():
    case = scene("crash", duration=4)
    modes = snapshot_modes(case)
    # Density modes that cannot hold the strain, on a scene many times as strong.
    strong = scene("crash", duration=4, initial_velocity="3*cos(2*pi*x/L)")
    full = sph.solve(scene("crash", duration=4), case.error_steps)
    projections = {f: error.project(full[f], modes[f"{f}_modes"]) for f in ("velocity", "density")}
    result = rom.sweep(strong, "original", [2, 4], modes, projections, projections)
    broken = np.isfinite(result["breakdown_time"])
    assert broken.any()
    assert np.isinf(result["velocity_error_sph"][broken]).all()
    count = int(result["mode_count"][broken][0])
    with pytest.raises(Breakdown, match=r"scene crash: the original model with \d+ modes broke"):
        rom.sweep(strong, "original", [count], modes, projections, projections)


@pytest.mark.parametrize("method", ["frozen0", "frozen", "lifted", "frozen-1"])
def test_unknown_methods_are_refused(method):
    with pytest.raises(ValueError, match="allowed are original, linearized and frozen1"):
        rom.freeze_steps(method)
