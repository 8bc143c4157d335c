"""What must hold of any scene."""

from dataclasses import replace

import numpy as np
import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st
from scenes import VARIED, scene

from sphpod.full import energy, lifted
from sphpod.scene import breakdown, waves
from sphpod.scene.waves import GROWTH_LIMIT
from sphpod.studies import edge_scenes

# Where nothing is strained, the relative error of the strain has no value.
pytestmark = pytest.mark.filterwarnings("ignore:invalid value encountered in scalar divide")

STEP_BY_STEP = {"duration": 0.2, "error_interval": 1e-3}
JITTERED = {"positions": {"jitter": 0.3, "seed": 1}}
SETTINGS: dict[str, dict] = {
    "plain": {},
    "modulus jump": {"youngs_modulus": "where(x < L/2, 0.1, 1e3)"},
    "density jump": {"initial_density": "where(x < L/2, 1, 1e3)"},
    "damping near the limit": {"damping": 1990, "initial_velocity": "1e-3*(1 + sin(2*pi*x/L))"},
    "damping beyond the limit": {"damping": 5000},
    "graded damping": {"damping": "2000*(1 + sin(2*pi*x/L))"},
    "forced at the snapshots' times": {"force": {"time": "cos(40*pi*t)", "profile": "x*(L - x)"}},
    "uniformly forced": {"force": "1e-3", "initial_velocity": 0},
    "five particles": {"particle_count": 5},
    "four neighbours": {"smoothing_ratio": 2.3},
    "varied": VARIED,
    "jittered": JITTERED,
    "jittered and varied": VARIED | JITTERED,
    "at rest": {"initial_velocity": 0},
}
each = pytest.mark.parametrize("changes", SETTINGS.values(), ids=SETTINGS)
each_stepped = pytest.mark.parametrize("integrator", ["leapfrog", "symplectic_euler"])


def verdicts(case):
    """What is found of a scene, by check and model."""
    found = edge_scenes.rows({"scene": case.name}, edge_scenes.study(case))
    return {(row["check"], row["model"]): row for row in found}


@each
def test_every_check_holds(changes):
    for key, row in verdicts(scene(**changes)).items():
        assert row["verdict"] in ("holds", "reported"), key
        assert (row["verdict"] == "reported") == (row["limit"] == np.inf), key


@st.composite
def random_scenes(draw):
    """Scenes of any material, damping and force, up to stiff ones."""

    def profile(size):
        depth = draw(st.floats(0, 0.95))
        return f"{size!r}*(1 + {depth!r}*sin(2*pi*{draw(st.integers(1, 3))}*x/L))"

    powers = st.floats(-2, 2).map(lambda power: 10.0**power)
    found = {
        "particle_count": draw(st.integers(7, 40)),
        "smoothing_ratio": draw(st.sampled_from([0.9, 1.04, 1.4])),
        "initial_density": profile(draw(powers)),
        "youngs_modulus": profile(draw(powers)),
        "initial_velocity": profile(1e-5),
        "damping": draw(st.sampled_from(["0", profile(draw(powers)), profile(1e3)])),
    }
    if draw(st.booleans()):
        found["force"] = {"time": f"1e-4*cos({draw(powers)!r}*t)", "profile": profile(1.0)}
    if draw(st.booleans()):
        found["positions"] = {"jitter": draw(st.floats(0, 0.49)), "seed": draw(st.integers(0, 99))}
    return scene(**found)


@examples(40)
@given(random_scenes())
def test_every_check_holds_of_any_scene(case):
    for key, row in verdicts(case).items():
        assert row["verdict"] != "fails", (key, row)


@pytest.mark.parametrize("name", ["plain", "damping near the limit", "varied", "jittered"])
def test_checks_are_those_that_a_scene_allows(name):
    changes = SETTINGS[name]
    found = verdicts(scene(**changes))
    checks = {check for check, _ in found}
    energies = {"energy's drift", "energy's growth from output to output"}
    energies.add("energy's root, of what the force can reach")
    expected = {
        "plain": "energy's drift",
        "jittered": "energy's drift",
        "damping near the limit": "energy's growth from output to output",
        "varied": "energy's root, of what the force can reach",
    }[name]
    assert checks & energies == {expected}
    for model in ("exact", "leapfrog", "symplectic_euler"):
        assert (expected, f"lifted full, {model}") in found
        assert ("largest squeezing 1 - J", f"lifted full, {model}") in found
        kept = ("momentum's change, of Σ m |v0|", f"lifted full, {model}")
        assert (kept in found) == (name != "varied")
    translation = found["strain by translation, of that by the longest wave", "particles"]
    assert (translation["verdict"] == "reported") == (name == "jittered")
    assert (translation["value"] > 0.1) == (name == "jittered")


def fields(solution):
    return {name: solution[name] for name in ("velocity", "strain")}


@each
@each_stepped
def test_energies_change_by_damping_and_force_as_stated(changes, integrator):
    """H' - H = -Σ tanh(x) w (u' + u)² + Δt f (u' + u)·√m in every step."""
    case = scene(**changes | STEP_BY_STEP)
    dt = edge_scenes.stable_step(case)
    case = replace(case, duration=200 * dt, error_interval=dt, time_step=dt)
    solution = lifted.solve(case, integrator)
    # Twice the energy, as stated.
    doubled = 2 * energy.kept(case, integrator, dt, **fields(solution))
    mass, _ = lifted.energy_weights(case)
    both = mass * (solution["velocity"][1:] + solution["velocity"][:-1])
    x = case.damping_values() * dt / 2 if case.damping_values().size else np.zeros(mass.size)
    # x tanh(x)/tanh(x), which is 0 where there is no damping.
    change = -(both**2 @ x)
    shift = 0.5 if integrator == "leapfrog" else 0.0
    amplitudes, profiles = case.force_values((np.arange(200) + shift) * dt)
    if profiles.size:
        change += dt * np.sum(amplitudes.T * (both @ (mass * profiles).T), axis=1)
    size = max(np.abs(doubled).max(), 1e-30)
    np.testing.assert_allclose(np.diff(doubled), change, rtol=0, atol=1e-13 * size)


@each
def test_energies_are_norms_that_tend_to_the_energy(changes):
    case = scene(**changes)
    rng = np.random.default_rng(0)
    velocity, strain = rng.standard_normal((2, 3, case.particle_count))
    total = energy.total(case, velocity, strain)
    mass, stiffness = lifted.energy_weights(case)
    expected = (mass * velocity) ** 2 + (stiffness * strain) ** 2
    np.testing.assert_allclose(total, expected.sum(axis=1) / 2, rtol=1e-13)
    limit = 2 / waves.fastest_wave(case)
    for integrator in ("leapfrog", "symplectic_euler"):
        assert energy.kept(case, integrator, 0.999 * limit, velocity, strain).min() > 0
        small = energy.kept(case, integrator, 1e-9 * limit, velocity, strain)
        np.testing.assert_allclose(small, total, rtol=1e-6)


@each
def test_steps_are_stable_and_divide_the_outputs(changes):
    case = scene(**changes)
    dt = edge_scenes.stable_step(case)
    assert 0 < dt <= 0.9 * 2 / waves.fastest_wave(case)
    assert case.error_interval / dt == pytest.approx(round(case.error_interval / dt), rel=1e-12)


def test_a_uniform_force_reaches_all_that_it_can():
    """Nothing but translation moves, so that √H is the work's bound."""
    case = scene(initial_velocity=0, force="1e-3*(1 + t)")
    row = verdicts(case)["energy's root, of what the force can reach", "lifted full, exact"]
    assert 0.99 < row["value"] <= 1


def test_an_integrator_that_gains_energy_fails(monkeypatch):
    solve = lifted.solve

    def unstable(case, integrator, *arguments):
        return solve(case, "explicit_euler" if integrator == "leapfrog" else integrator, *arguments)

    monkeypatch.setattr(lifted, "solve", unstable)
    for changes, check in (
        ({}, "energy's drift"),
        ({"damping": 1e-3}, "energy's growth from output to output"),
        ({"force": "1e-6*cos(9*t)"}, "energy's root, of what the force can reach"),
    ):
        found = verdicts(scene(**changes, duration=5))
        assert found[check, "lifted full, leapfrog"]["verdict"] == "fails"
        assert found[check, "lifted full, symplectic_euler"]["verdict"] == "holds"


def test_a_breakdown_is_reported_with_time_and_particle():
    case = scene(initial_velocity="0.4*sin(2*pi*x/L)")
    for integrator in edge_scenes.INTEGRATORS:
        with pytest.raises(breakdown.Breakdown) as caught:
            lifted.solve(case, integrator, edge_scenes.stable_step(case))
        what = (
            "largest squeezing 1 - J, or not finite: broke down by "
            f"t = {caught.value.time:.6g} s at particle {caught.value.particle}"
        )
        row = verdicts(case)[what, f"lifted full, {integrator}"]
        assert row["verdict"] == "fails"
        assert row["value"] == np.inf


@pytest.mark.slow
@pytest.mark.parametrize(
    "changes",
    [
        {"youngs_modulus": "where(x < L/2, 0.1, 1e3)", "duration": 10},
        {"damping": 2010, "duration": 10},
        {"damping": "2000*(1 + sin(2*pi*x/L))", "duration": 10},
    ],
)
def test_explicit_euler_is_refused_where_waves_would_grow_too_much(changes):
    case = scene("stiff", **changes)
    (row,) = (
        row for (what, _), row in verdicts(case).items() if what.startswith("refused: scene stiff")
    )
    assert "time_step = 0.001: explicit Euler would let waves grow by" in row["check"]
    assert row["value"] == GROWTH_LIMIT / waves.growth_factor(case) < 1
    assert row["verdict"] == "holds"


def test_a_scene_that_cannot_be_simulated_is_refused():
    with pytest.raises(ValueError, match="scene test: initial_density = x: it is 0 at x = 0"):
        edge_scenes.study(scene(initial_density="x"))


def test_outputs_are_fewer_where_particles_are_many(monkeypatch):
    monkeypatch.setattr(edge_scenes, "VALUES", 1000)
    shown = []
    solve = lifted.solve

    def watched(case, *arguments):
        shown.append(case.error_times.size)
        return solve(case, *arguments)

    monkeypatch.setattr(lifted, "solve", watched)
    found = verdicts(scene())
    assert shown[1:] == [26] * 3
    assert all(row["verdict"] == "holds" for row in found.values())
