"""Reduced models."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import VARIED, scene

from sphpod.full import sph
from sphpod.numerics import error
from sphpod.reduced import pod, rom, snapshots
from sphpod.reduced.rom import ReducedModel
from sphpod.scene import breakdown
from sphpod.scene.breakdown import Breakdown
from sphpod.scene.kernel import derivative, stencil_weights

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
    run = ReducedModel(case, "original", every, every).prepare(case.error_steps)
    velocity, density = run.solve().state
    np.testing.assert_allclose(velocity, full["velocity"], rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(density, full["density"], rtol=1e-11)
    rotation = np.linalg.qr(np.random.default_rng(0).standard_normal(every.shape))[0]
    run = ReducedModel(case, "original", rotation, rotation.T).prepare(case.error_steps)
    fields = run.solve().fields()
    np.testing.assert_allclose(fields["velocity"], full["velocity"], rtol=1e-7, atol=1e-13)
    np.testing.assert_allclose(fields["density"], full["density"], rtol=1e-10)


@pytest.mark.parametrize("changes", SETTINGS.values(), ids=SETTINGS)
@pytest.mark.parametrize("count", [3, 8])
def test_frozen_for_one_step_is_linearized(changes, count):
    case = scene(**changes)
    modes = snapshot_modes(case)
    chosen = modes["velocity_modes"][:count], modes["density_modes"][: count + 1]
    linearized, frozen = (
        ReducedModel(case, method, *chosen).prepare(case.error_steps).run().state
        for method in ("linearized", "frozen1")
    )
    for a, b in zip(linearized, frozen, strict=True):
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
    amplitudes, profiles = case.force_values(np.arange(40) * dt)
    expected = []
    for step in range(41):
        if step in steps:
            expected.append((a, b))
        if step == 40:
            break
        if step % n_freeze == 0:
            c_matrix = ((ur @ b) ** 2 / density0)[:, None] * g
            force = uv.T @ (amplitudes[:, step] @ profiles) if amplitudes.size else 0.0
        pull = uv.T @ (a_matrix @ (ur @ b) - b_matrix.sum(axis=1))
        a, b = (
            a + dt * (force - pull - uv.T @ d @ uv @ a),
            b - dt * ur.T @ c_matrix @ uv @ a,
        )
    for cheaper in (True, False):
        monkeypatch.setattr(rom, "tensor_is_cheaper", lambda *_, cheaper=cheaper: cheaper)
        run = ReducedModel(case, f"frozen{n_freeze}", uv.T, ur.T).prepare(steps).run()
        for found, want in zip(run.state, zip(*expected, strict=True), strict=True):
            np.testing.assert_allclose(found, want, rtol=1e-9, atol=1e-12)


def test_the_form_with_fewer_operations_is_chosen():
    assert rom.tensor_is_cheaper(12, 12, 400, 10)
    assert not rom.tensor_is_cheaper(20, 20, 100, 1)


def test_errors_fall_to_rounding_of_the_model_and_equal_those_of_the_fields():
    case = scene()
    modes = snapshot_modes(case)
    full = sph.solve(case, case.error_steps)
    result = rom.sweep(case, "original", [2, 4, 8, 12], modes, full, full)
    assert result["mode_count"].tolist() == [2, 4, 8, 12]
    for field in ("velocity", "density"):
        errors = result[f"{field}_error_sph"]
        assert np.all(np.diff(errors) < 0)
        single = rom.sweep(case, "original", [4], modes, full, full)
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
    together = list(rom.prepare_each(models, case.error_steps))
    assert len(together) == len(models)
    for model, run in zip(models, together, strict=True):
        velocity, density = run.run().state
        alone = model.prepare(case.error_steps).run().state
        np.testing.assert_allclose(velocity, alone[0], rtol=1e-9, atol=1e-14)
        np.testing.assert_allclose(density, alone[1], rtol=1e-9, atol=1e-12)


def test_a_model_that_breaks_down_is_reported_of_and_does_not_stop_a_sweep():
    case = scene("crash", duration=4)
    modes = snapshot_modes(case)
    # Density modes that cannot hold the strain, on a scene many times as strong.
    strong = scene("crash", duration=4, initial_velocity="3*cos(2*pi*x/L)")
    full = sph.solve(scene("crash", duration=4), case.error_steps)
    result = rom.sweep(strong, "original", [2, 4], modes, full, full)
    broken = np.isfinite(result["breakdown_time"])
    assert broken.any()
    assert np.isinf(result["velocity_error_sph"][broken]).all()
    count = int(result["mode_count"][broken][0])
    with pytest.raises(Breakdown, match=r"scene crash: the original model with \d+ modes broke"):
        rom.sweep(strong, "original", [count], modes, full, full)


def test_coefficients_frozen_for_longer_than_the_run_are_those_of_its_start():
    case = scene()
    modes = snapshot_modes(case)
    full = sph.solve(case, case.error_steps)
    longest = [case.step_count, 10**11, 999_999_999_999_999]
    found = rom.accelerate(case, longest, [4], modes, full)
    assert found["n_freeze"].tolist() == [0, 0, *longest]
    for field in ("velocity", "density"):
        errors = found[f"acceleration_{field}_error"][2:, 0]
        assert np.isfinite(errors).all()
        assert np.ptp(errors) == 0


@pytest.mark.parametrize("method", ["frozen0", "frozen", "lifted", "frozen-1", "frozen" + 16 * "9"])
def test_unknown_methods_are_refused(method):
    with pytest.raises(ValueError, match="allowed are original, linearized and frozen1"):
        rom.freeze_steps(method)


def orthonormal(rng, count, size):
    """Random orthonormal rows, of which the first is nearly the initial density of a scene."""
    rows = rng.standard_normal((count, size))
    rows[0] = 1 + 0.05 * rows[0]
    return np.linalg.qr(rows.T)[0].T


@settings(deadline=None, max_examples=150)
@given(
    st.sampled_from(["original", "linearized", "frozen3"]),
    st.sampled_from([{}, VARIED]),
    st.integers(1, 12),
    st.floats(-3, 2),
    st.sampled_from([None, np.nan, np.inf, 1e308]),
    st.integers(0, 2**32 - 1),
)
def test_breakdown_is_where_j_is_first_not_positive(method, changes, count, size, wrong, seed):
    """By J of all particles at every output of any reduced solution; and the test is sufficient."""
    case, rng = scene("crash", **changes), np.random.default_rng(seed)
    modes = orthonormal(rng, count, 40)
    model = ReducedModel(case, method, modes, modes)
    moved = np.cumsum(rng.standard_normal((1500, count)), axis=0) / np.sqrt(1500 * count)
    start = modes @ case.density0()
    # From a start whose density may itself not be positive, if a few modes cannot hold it.
    solution = start + 10**size * np.linalg.norm(start) * moved * (rng.random() < 0.9)
    solution[0] = start
    velocity = rng.standard_normal((1500, count))
    if wrong is not None:
        (velocity if wrong == np.inf else solution)[rng.integers(1500)] = wrong
    suspected = []

    def watched(limit, coordinates, shapes, rows):
        suspected.extend(rows)
        return breakdown.first_broken(limit, coordinates, shapes, rows)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rom, "first_broken", watched)
        run = model.prepare(2 * np.arange(1500))
        run.state = velocity, solution
        found = run.breakdown()
    with np.errstate(all="ignore"):
        density = solution @ modes
        jacobian = case.density0() / density
    sound = np.isfinite(velocity).all(axis=1, keepdims=True) & np.isfinite(density) & (jacobian > 0)
    broken = ~np.all(sound, axis=1)
    if not broken.any():
        assert found is None
    else:
        row = int(broken.argmax())
        assert found is not None
        assert found.time == pytest.approx(2 * row * case.time_step)
        assert not sound[row, found.particle]
        assert str(found).startswith(f"scene crash: the {method} model with {count} modes broke")
    passed = np.setdiff1d(np.arange(1500), suspected)
    whole = broken.argmax() if broken.any() else 1500
    assert not broken[passed[passed < whole]].any()
    # And the start passes.
    if size < -2.5 and not broken[0]:
        assert 0 in passed


def test_a_density_that_starts_without_being_positive_broke_down_at_once():
    """Noisy modes cannot hold the initial density, and nothing moves that a test could see."""
    case = scene("crash")
    modes = np.zeros((1, 40))
    modes[0, :2] = np.sqrt(0.8), -np.sqrt(0.2)
    still = np.tile(modes @ case.density0(), (3, 1))
    run = ReducedModel(case, "original", modes, modes).prepare(np.arange(3))
    run.state = still, still
    found = run.breakdown()
    assert found is not None
    assert (found.time, found.particle) == (0, 1)


@pytest.mark.parametrize("method", ["original", "linearized", "frozen10"])
def test_nothing_is_reconstructed_where_the_test_passes(method, monkeypatch):
    case = scene()
    modes = snapshot_modes(case)
    counts = []

    def count(limit, coordinates, shapes, rows):
        counts.append(rows.size)
        return breakdown.first_broken(limit, None, None, rows)

    monkeypatch.setattr(rom, "first_broken", count)
    rom.galerkin(case, method, modes, 5).prepare(case.error_steps).solve()
    assert counts == [0]


def test_more_modes_than_there_are_is_reported_of(caplog):
    case = scene()
    modes = {field: rows[:6] for field, rows in snapshot_modes(case).items()}
    modes["density_modes"] = modes["density_modes"][:5]
    full = sph.solve(case, case.error_steps)
    rom.sweep(case, "original", [5], modes, full, full)
    rom.sweep(case, "original", [5, 9], modes, full, full)
    assert not caplog.messages
    rom.sweep(case, "original", [9], modes, full, full)
    assert caplog.messages == [
        "scene test: 9 modes asked for, the snapshots hold 6 of velocity and 5 of density"
    ]


@pytest.mark.parametrize("method", ["original", "linearized", "frozen3"])
@pytest.mark.parametrize("changes", [{}, VARIED], ids=["plain", "varied"])
def test_the_stored_system_is_the_model_linearized_at_rest(method, changes):
    """What it leaves out of the rates is of second order in the amplitude."""
    missing = []
    for amplitude in (1e-3, 5e-4):
        forced = {"force": f"{amplitude}*cos(9*t)"} if changes else {}
        case = scene(
            initial_velocity=f"{amplitude}*sin(2*pi*x/L)", duration=0.4, time_step=1e-3,
            error_interval=1e-3, **(changes | forced),
        )  # fmt: skip
        modes = snapshot_modes(case)
        model = rom.model(case, method, modes, 3)
        system = model.system()
        coordinates = model.prepare(case.error_steps).run().state
        states = np.concatenate(coordinates, axis=1)
        every = max(rom.freeze_steps(method), 1)
        refreshed = np.arange(states.shape[0] - 1) // every * every
        courses, _ = case.force_values(case.error_times[refreshed])
        rates = states[:-1] @ system["reduced_operator"].T + system["reduced_constant"]
        if courses.size:
            rates = rates + courses.T @ system["reduced_force"].T
        missing.append(np.abs(np.diff(states, axis=0) / case.time_step - rates).max())
        velocity = states @ system["velocity_output"]
        np.testing.assert_allclose(velocity, coordinates[0] @ model.velocity_modes, atol=1e-15)
    assert missing[0] < 1e-3
    assert missing[0] / missing[1] == pytest.approx(4, rel=0.2)


class HeldForce(ReducedModel):
    """A model whose force alone is refreshed every ten steps."""

    def _project_forces(self, dt, step_count):
        decay, damping, amplitudes, push = super()._project_forces(dt, step_count)
        held = np.arange(amplitudes.shape[1]) // 10 * 10
        return decay, damping, amplitudes[:, held].copy(), push


def test_what_freezing_adds_under_a_force_comes_from_the_force():
    """Frozen for ten steps a model moves as one that holds only its force for so long."""
    case = scene(force="1e-2*cos(30*t)", damping=5, duration=1, time_step=1e-3)
    modes = snapshot_modes(case)
    bases = modes["velocity_modes"][:3], modes["density_modes"][:3]
    shortest, longest, held = (
        model(case, method, *bases).prepare(case.error_steps).run().state[0]
        for model, method in (
            (ReducedModel, "frozen1"), (ReducedModel, "frozen10"), (HeldForce, "frozen1"),
        )
    )  # fmt: skip
    assert error.relative_error(longest, held) < 0.01 * error.relative_error(longest, shortest)
