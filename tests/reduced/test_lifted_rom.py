"""Lifted reduced models."""

import numpy as np
import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st
from random_models import random_models, rows
from scenes import VARIED, scene
from scipy import signal

from sphpod.full import lifted, sph
from sphpod.numerics.error import relative_error
from sphpod.reduced import lifted_rom
from sphpod.reduced.lifted_rom import LiftedModel
from sphpod.scene import breakdown
from sphpod.scene.breakdown import Breakdown

THREE_WAVES = "1e-3*sum(l*sin(2*pi*l*x/L) for l in range(1, 4))"
SETTINGS = {
    "plain": {},
    "damped": {"damping": 3},
    "forced": {"force": "1e-3*cos(9*t)"},
    "damped and forced": {"damping": 3, "force": VARIED["force"]},
    "abruptly forced": {"force": {"time": "where(t < 0.4321, 1e-3, -2e-3)", "profile": "x"}},
    "unevenly damped": {"damping": VARIED["damping"]},
    "varied": VARIED,
    "four neighbours": {"smoothing_ratio": 2.3},
}
OWN_MODES = ("as found", "eigenmodes", "one block")
each = pytest.mark.parametrize("changes", SETTINGS.values(), ids=SETTINGS)
each_own = pytest.mark.parametrize("own", OWN_MODES)
each_method = pytest.mark.parametrize("method", lifted_rom.METHODS)
SOLVED: dict[str, dict] = {}
INTEGRATORS = {"lifted_euler": "explicit_euler", "lifted_exact": "exact"}


def exact(case):
    """The lifted full model, solved once for each scene."""
    if repr(case) not in SOLVED:
        SOLVED[repr(case)] = lifted.solve(case, "exact")
    return SOLVED[repr(case)]


def snapshots(case, every=4, last=100):
    full = exact(case)
    return {f"{f}_snapshots": full[f][:last:every] for f in ("velocity", "strain")}


def reduced(case, count=7, own="as found"):
    """A model whose own modes are those it finds, or of another kind."""
    model = lifted_rom.build(case, lifted_rom.decompose(case, snapshots(case)), count)
    if own != "as found":
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(lifted_rom, "ILL_CONDITIONED", {"eigenmodes": 1e12, "one block": 0}[own])
            model.__dict__["own"] = lifted_rom.eigenmodes(model.operator)
    return model


def solve(model, method):
    """Coordinates in the modes of velocity and strain, (times, kv) and (times, ke)."""
    return model.prepare(method).solve().coordinates()


def fields(model, velocity, strain):
    """Velocity and strain of coordinates in the modes."""
    mass, stiffness = lifted.energy_weights(model.scene)
    return velocity @ model.velocity_modes / mass, strain @ model.strain_modes / stiffness


def euler(model):
    """Explicit Euler of the reduced operator, one step at a time."""
    case, kv = model.scene, len(model.velocity_modes)
    mass, _ = lifted.energy_weights(case)
    amplitudes, profiles = case.force_values(np.arange(case.step_count) * case.time_step)
    state = np.zeros(kv + len(model.strain_modes))
    push = np.zeros((max(len(profiles), 1), state.size))
    state[:kv] = model.velocity_modes @ (mass * case.velocity0())
    if profiles.size:
        push[:, :kv] = (mass * profiles) @ model.velocity_modes.T
    else:
        amplitudes = np.zeros((1, case.step_count))
    states = [state]
    for values in amplitudes.T:
        states.append(states[-1] + case.time_step * (model.operator @ states[-1] + values @ push))
    kept = np.array(states)[case.error_steps]
    return kept[:, :kv], kept[:, kv:]


@examples(150)
@given(random_models())
def test_unforced_the_energy_never_grows(model):
    """Whatever the scene, the modes and their number; up to rounding, which own modes magnify."""
    velocity, strain = solve(model, "lifted_exact")
    energy = np.sum(velocity**2, axis=1) + np.sum(strain**2, axis=1)
    rounding = 1e-13 * np.linalg.cond(model.own.to_modes)
    assert np.diff(energy).max() <= rounding * energy[0]
    assert rounding <= 1e-7
    if model.scene.damping_values().size == 0:
        np.testing.assert_allclose(energy, energy[0], rtol=1e-12)


@each
@each_method
@pytest.mark.parametrize("rotated", [False, True])
def test_with_all_modes_the_model_is_the_lifted_full_model(changes, method, rotated):
    case = scene(**changes)
    count, rng = case.particle_count, np.random.default_rng(0)
    first, second = (rows(rng, count, count) if rotated else np.eye(count) for _ in range(2))
    model = LiftedModel(case, first, second, translation=0)
    full = lifted.solve(case, INTEGRATORS[method])
    found = fields(model, *solve(model, method))
    for values, field in zip(found, ("velocity", "strain"), strict=True):
        assert relative_error(values, full[field]) < 1e-10


@each
@pytest.mark.parametrize(
    ("own", "count"), [("as found", 1), *((own, count) for own in OWN_MODES for count in (2, 7))]
)
def test_jumps_are_explicit_euler_step_by_step(changes, own, count):
    model = reduced(scene(**changes), count, own)
    mass, _ = lifted.energy_weights(model.scene)
    size = float(np.linalg.norm(mass * model.scene.velocity0()))
    for found, expected in zip(solve(model, "lifted_euler"), euler(model), strict=True):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * size)


@each
@each_method
def test_every_kind_of_own_modes_gives_the_same_solution(changes, method):
    case = scene(**changes)
    models = [reduced(case, own=own) for own in OWN_MODES]
    assert not models[1].own.orthogonal
    assert models[2].own.blocks.shape == (1, *models[2].operator.shape)
    solutions = [solve(model, method) for model in models]
    for other in solutions[1:]:
        for found, expected in zip(other, solutions[0], strict=True):
            size = np.abs(expected).max()
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * size)


@each
def test_own_modes_are_those_of_the_operator(changes):
    model = reduced(scene(**changes))
    own, operator = model.own, model.operator
    uneven = changes.get("damping") == VARIED["damping"]
    assert own.orthogonal is own.apart is not uneven
    if not uneven:
        np.testing.assert_allclose(own.to_modes @ own.to_modes.T, np.eye(len(operator)), atol=1e-13)
    blocks = np.linalg.inv(own.to_modes) @ operator @ own.to_modes
    count = len(own.blocks)
    for m, block in enumerate(own.blocks):
        at = [m, count + m] if m < count - own.singles else [m]
        np.testing.assert_allclose(blocks[np.ix_(at, at)], block[: len(at), : len(at)], atol=1e-12)
        blocks[np.ix_(at, at)] = 0
    np.testing.assert_allclose(blocks, 0, atol=1e-12 * np.abs(operator).max())


@pytest.mark.parametrize("field", ["strain", "density"])
@each
def test_modes_are_orthonormal_in_the_energy(changes, field):
    case = scene(**changes)
    taken = snapshots(case)
    if field == "density":
        taken["density_snapshots"] = lifted.density(case, taken.pop("strain_snapshots"))
    modes = lifted_rom.decompose(case, taken)
    mass, stiffness = lifted.energy_weights(case)
    np.testing.assert_array_equal(modes["x"], case.positions)
    for name, weights, squares in (
        ("velocity", mass, case.density0() * case.spacing),
        ("strain", stiffness, case.modulus() * case.spacing),
    ):
        shapes = modes[f"scaled_{name}_modes"] / weights
        np.testing.assert_allclose((shapes * squares) @ shapes.T, np.eye(len(shapes)), atol=1e-12)
        assert len(shapes) == modes[f"scaled_{name}_singular_values"].size
        # They hold every snapshot.
        first = weights * exact(case)[name][:100:4]
        rest = first - first @ modes[f"scaled_{name}_modes"].T @ modes[f"scaled_{name}_modes"]
        np.testing.assert_allclose(rest, 0, atol=1e-12 * np.abs(first).max())


@pytest.mark.parametrize(
    ("split", "changes"),
    {
        "at rest": (False, {}),
        "uniformly damped": (False, {"damping": 3}),
        "uneven, but at rest": (False, {"initial_density": "1 + 0.3*cos(2*pi*2*x/L)"}),
        "moving": (True, {"initial_velocity": "1e-3*sin(2*pi*x/L) + 1e-9"}),
        "moving by density": (True, {"initial_density": VARIED["initial_density"]}),
        "forced": (True, {"force": "1e-3*cos(9*t)"}),
        "unevenly damped": (True, {"damping": VARIED["damping"]}),
    }.values(),
    ids=lambda value: None,
)
def test_translation_is_split_off_where_it_takes_part(split, changes):
    case = scene(**({"initial_velocity": "1e-3*sin(2*pi*x/L)"} | changes))
    assert case.translates is split
    modes = lifted_rom.decompose(case, snapshots(case))
    assert modes["translation"] == split
    shapes, (mass, _) = modes["scaled_velocity_modes"], lifted.energy_weights(case)
    if split:
        momentum = shapes @ mass / np.linalg.norm(mass)
        np.testing.assert_allclose(momentum, [1] + [0] * (len(shapes) - 1), atol=1e-12)
    model = lifted_rom.build(case, modes, 4)
    assert len(model.velocity_modes) == len(model.strain_modes) + split <= 4
    np.testing.assert_allclose(model.coupling[:split], 0, atol=1e-12)


def test_a_uniform_force_moves_the_translation_alone():
    for changes in ({}, {"initial_density": VARIED["initial_density"]}):
        model = reduced(scene(force="1e-3*cos(9*t)", **changes))
        mass, _ = lifted.energy_weights(model.scene)
        np.testing.assert_array_equal(model.force[1:], 0)
        assert model.force[0] == pytest.approx(np.linalg.norm(mass))


@pytest.mark.parametrize(
    "changes", [SETTINGS[name] for name in ("plain", "damped", "forced", "damped and forced")]
)
def test_the_translation_carries_the_momentum(changes):
    """Which uniform damping and force change, and no wave."""
    case = scene(**changes)
    mass, _ = lifted.energy_weights(case)
    model = reduced(case)
    found, _ = fields(model, *solve(model, "lifted_exact"))
    momentum = exact(case)["velocity"] @ mass**2
    np.testing.assert_allclose(found @ mass**2, momentum, rtol=0, atol=1e-15)


def test_singular_values_of_zero_are_dropped():
    """At t = 0 nothing is strained, so that snapshot carries no mode."""
    case = scene(initial_velocity="1e-3*x*(L - x)*sin(6*pi*x)")
    modes = lifted_rom.decompose(case, snapshots(case, every=10, last=50))
    assert len(modes["scaled_velocity_modes"]) == 5
    assert len(modes["scaled_strain_modes"]) == 4
    model = lifted_rom.build(case, modes, 9)
    assert (len(model.velocity_modes), len(model.strain_modes)) == (5, 4)
    solve(model, "lifted_exact")
    still = scene(initial_velocity=0, force="1e-3*cos(9*t)")
    modes = lifted_rom.decompose(still, snapshots(still))
    assert len(modes["scaled_velocity_modes"]) == 1
    assert modes["scaled_strain_modes"].shape == (0, 40)


@each
@pytest.mark.parametrize("count", [1, 2, 5, 100])
def test_there_are_never_more_strain_modes_than_waves(changes, count):
    case = scene(**changes)
    taken = snapshots(case)
    for fewer in ("velocity_snapshots", "strain_snapshots"):
        modes = lifted_rom.decompose(case, taken | {fewer: taken[fewer][1:5]})
        model = lifted_rom.build(case, modes, count)
        waves = len(model.velocity_modes) - model.translation
        assert len(model.velocity_modes) <= count
        assert len(model.strain_modes) == min(waves, len(modes["scaled_strain_modes"]))
        solve(model, "lifted_exact")


@pytest.mark.parametrize("changes", [{}, {"damping": 1}, {"force": "1e-3*cos(9*t)"}])
def test_three_modes_are_three_waves(changes):
    case = scene(
        **changes, initial_velocity=THREE_WAVES, particle_count=100, smoothing_ratio=1.06,
        duration=10,
    )  # fmt: skip
    full = exact(case)
    modes = lifted_rom.decompose(case, snapshots(case, every=2, last=161))
    model = lifted_rom.build(case, modes, 3 + int(modes["translation"]))
    found = fields(model, *solve(model, "lifted_exact"))
    assert relative_error(found[0], full["velocity"]) < 1e-12
    assert relative_error(found[1], full["strain"]) < 1e-12


@each
@each_own
@each_method
def test_reconstructed_fields_are_coordinates_times_modes(changes, own, method):
    model = reduced(scene(**changes), own=own)
    run = model.prepare(method).run()
    coordinates = run.coordinates()
    for a, b in zip(coordinates, solve(model, method), strict=True):
        np.testing.assert_array_equal(a, b)
    expected = fields(model, *coordinates)
    for first, count in ((0, 101), (0, 1), (17, 30), (100, 1)):
        found = run.fields(slice(first, first + count))
        assert list(found) == ["velocity", "strain"]
        for a, b in zip(found.values(), expected, strict=True):
            want = b[first : first + count]
            np.testing.assert_allclose(a, want, rtol=0, atol=1e-13 * np.abs(b).max())


@each_method
@pytest.mark.parametrize("changes", [{}, VARIED], ids=["plain", "varied"])
def test_breakdown_names_scene_time_and_particle(changes, method):
    case = scene("crash", **(changes | {"initial_velocity": "0.9*sin(2*pi*x/L)"}))
    every = np.eye(case.particle_count)
    message = r"^scene crash: the lifted model with 40 modes broke down by t = 0\.\d+ s"
    with pytest.raises(Breakdown, match=message) as caught:
        LiftedModel(case, every, every, 0).prepare(method).solve()
    with pytest.raises(Breakdown) as full:
        lifted.solve(case, INTEGRATORS[method])
    assert caught.value.time == full.value.time
    # A reduced model is checked from the lengths of its coordinates first.
    few = reduced(scene(**(changes | {"initial_velocity": "0.1*sin(2*pi*x/L)"})), 5)
    run = LiftedModel(case, few.velocity_modes, few.strain_modes, 0).prepare(method)
    with pytest.raises(Breakdown, match=f"with {len(few.velocity_modes)} modes") as caught:
        run.solve()
    _, strain = fields(run.reduced, *run.run().coordinates())
    row = np.flatnonzero(strain.min(axis=1) <= -1)[0]
    assert caught.value.time == case.error_times[row]
    assert caught.value.particle == strain[row].argmin()


@examples(100)
@given(
    random_models(),
    st.floats(-3, 2),
    st.sampled_from([None, np.nan, np.inf]),
    st.integers(0, 2**32 - 1),
)
def test_breakdown_is_where_j_is_first_not_positive(model, size, wrong, seed):
    """By J of all particles at every output of any reduced solution; and the test is sufficient."""
    rng, case = np.random.default_rng(seed), model.scene
    model = LiftedModel(case, model.velocity_modes, model.strain_modes, 0)
    count = len(model.own.to_modes)
    times = case.error_times.size
    state = 10**size * rng.standard_normal((count, times)) * np.linspace(0, 1, times)
    if wrong is not None:
        state[rng.integers(count), rng.integers(times) :] = wrong
    suspected = []

    def watched(limit, coordinates, shapes, rows):
        suspected.extend(rows)
        return breakdown.first_broken(limit, coordinates, shapes, rows)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lifted_rom, "first_broken", watched)
        run = model.prepare("lifted_exact")
        run.state = (state,)
        found = run.breakdown_at_outputs()
    with np.errstate(all="ignore"):
        velocity, strain = fields(model, *run.coordinates())
    sound = np.isfinite(velocity) & np.isfinite(strain) & (1 + strain > 0)
    broken = ~sound.all(axis=1)
    if not broken.any():
        assert found is None
    else:
        assert found is not None
        row = int(broken.argmax())
        assert found.time == case.error_times[row]
        assert not sound[row, found.particle]
    passed = np.setdiff1d(np.arange(times), suspected)
    whole = broken.argmax() if broken.any() else times
    assert not broken[passed[passed < whole]].any()
    assert 0 in passed


def test_nothing_is_reconstructed_where_the_test_passes(monkeypatch):
    counts = []

    def count(limit, coordinates, shapes, rows):
        counts.append(rows.size)
        return breakdown.first_broken(limit, None, None, rows)

    monkeypatch.setattr(lifted_rom, "first_broken", count)
    solve(reduced(scene()), "lifted_exact")
    assert counts == [0]


def test_more_modes_than_there_are_is_reported_of(caplog):
    case = scene(initial_velocity="1e-3*x*(L - x)*sin(6*pi*x)")
    modes = lifted_rom.decompose(case, snapshots(case, every=10, last=50))
    lifted_rom.build(case, modes, 4)
    lifted_rom.build(case, modes)
    assert not caplog.messages
    lifted_rom.build(case, modes, 12)
    assert caplog.messages == [
        "scene test: 12 modes asked for, the snapshots hold 5 of velocity and 4 of strain"
    ]


def test_a_model_that_is_not_finite_broke_down():
    model = reduced(scene("crash"))
    run = model.prepare("lifted_euler").solve()
    run.state[0][:, 40:] = np.nan
    found = run.breakdown()
    assert found is not None
    assert found.time == model.scene.error_times[40]


def test_errors_are_those_of_the_fields_and_infinite_where_a_model_broke_down():
    case = scene(**VARIED)
    modes = lifted_rom.decompose(case, snapshots(case))
    full, reference = sph.solve(case, case.error_steps), exact(case)
    reference = reference | {"density": lifted.density(case, reference["strain"])}
    table = lifted_rom.repeat_sph(case, [2, 4, 7], modes, full, reference)
    single = lifted_rom.repeat_sph(case, [4], modes, full, reference)
    assert table["mode_count"].tolist() == [2, 4, 7]
    assert np.isnan(table["breakdown_time"]).all()
    coordinates = (single[f"scaled_{field}_coordinates"] for field in ("velocity", "strain"))
    velocity, strain = fields(lifted_rom.build(case, modes, 4), *coordinates)
    found = {"velocity": velocity, "density": lifted.density(case, strain)}
    for field, values in found.items():
        for name, solution in (("sph", full), ("reference", reference)):
            error = relative_error(values, solution[field])
            assert single[f"{field}_error_{name}"][0] == pytest.approx(error, rel=1e-9)
            assert table[f"{field}_error_{name}"][1] == pytest.approx(error, rel=1e-9)
    strong = scene("crash", **(VARIED | {"initial_velocity": "0.9*sin(2*pi*x/L)"}))
    broken = lifted_rom.repeat_sph(strong, [4, 7], modes, full, reference)
    assert np.isfinite(broken["breakdown_time"]).all()
    assert np.isinf(broken["velocity_error_sph"]).all()
    with pytest.raises(Breakdown, match="scene crash: the lifted model with 4 modes"):
        lifted_rom.repeat_sph(strong, [4], modes, full, reference)


@pytest.mark.parametrize("changes", [{}, {"damping": 3}, VARIED], ids=["plain", "damped", "varied"])
def test_scipy_gets_the_same_of_the_stored_system(changes):
    """The matrices of a file, without anything else of this package."""
    case = scene(duration=1, error_interval=0.02, **changes)
    full = exact(case)
    snapshots = {f"{name}_snapshots": full[name][::5] for name in ("velocity", "strain")}
    (run,) = lifted_rom.prepare_each(case, [4], lifted_rom.decompose(case, snapshots), METHOD)
    kept = run.solve().stored() | run.reduced.system()
    coordinates = ["scaled_velocity_coordinates", "scaled_strain_coordinates"]
    states = np.concatenate([kept[name] for name in coordinates], axis=1)
    count = states.shape[1]
    system = signal.StateSpace(
        kept["reduced_operator"], kept["reduced_force"],
        np.eye(count), np.zeros((count, 1)),
    )  # fmt: skip
    fine = np.linspace(0, kept["t"][-1], 20 * (kept["t"].size - 1) + 1)
    amplitudes, _ = case.force_values(fine)
    course = amplitudes.T if amplitudes.size else np.zeros_like(fine)
    _, found, _ = signal.lsim(system, course, fine, states[0])
    np.testing.assert_allclose(found[::20], states, rtol=0, atol=1e-5 * np.abs(states).max())
    for name, field in run.fields().items():
        np.testing.assert_allclose(
            states @ kept[f"{name}_output"], field, atol=1e-13 * np.abs(field).max()
        )


METHOD = "lifted_exact"
