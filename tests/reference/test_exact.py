"""Exact solutions: that they solve the equations, keep energy and momentum, and agree in limits."""

import re
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import scene as small_scene

from sphpod.reference import exact
from sphpod.scene.breakdown import Breakdown
from sphpod.scene.kernel import derivative_coefficient
from sphpod.scene.scene import Scene

WAVY = "1e-3*(sin(2*pi*x/L) + 0.5*cos(4*pi*x/L + 1) + 0.3)"
BUMP = "1e-3*where(abs(x - 0.25) < 0.2, cos(pi*(x - 0.25)/0.4), 0)**6"
KINKED = "1e-3*x*(L - x)"
TWO_LAYERS = {
    "initial_velocity": BUMP,
    "initial_density": "where(abs(x - 0.251) < 0.25, 1, 3)",
    "youngs_modulus": "where(abs(x - 0.251) < 0.25, 0.1, 0.2)",
}


def make_scene(interval=0.02, **changes):
    plain = {
        "domain_length": 1.0,
        "duration": 2.0,
        "initial_velocity": WAVY,
        "initial_density": 2,
        "youngs_modulus": 0.3,
        "particle_count": 32,
        "smoothing_ratio": 1.2,
    }
    return Scene.from_settings(
        "chain", {**plain, "time_step": interval, "error_interval": interval, **changes}
    )


def fields(scene):
    """Velocity and strain (times, N)."""
    solution = exact.solve(scene)
    assert solution["velocity"].shape == (scene.error_times.size, scene.particle_count)
    return solution["velocity"], scene.density0() / solution["density"] - 1


def each_kind(test):
    return pytest.mark.parametrize(
        "changes",
        [
            {},
            {"force": "1e-3*cos(3*t)"},
            {"damping": 1.5},
            {"damping": 12, "force": "1e-3*cos(3*t)"},
            {"force": {"time": "1e-3*cos(3*t)", "profile": "sin(2*pi*x/L) + 0.2"}},
            {"damping": 3, "force": {"time": "1e-3*cos(3*t)", "profile": "exp(cos(2*pi*x/L))"}},
            TWO_LAYERS,
            {**TWO_LAYERS, "force": "1e-3*cos(3*t)"},
        ],
        ids=[
            "waves",
            "waves-forced",
            "damped",
            "overdamped-forced",
            "unevenly-forced",
            "damped-unevenly-forced",
            "layers",
            "layers-forced",
        ],
    )(test)


# --- Kinds ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, "dalembert"),
        ({"damping": 0}, "dalembert"),
        ({"force": "sin(t)"}, "dalembert"),
        ({"force": {"time": "sin(t)", "profile": 2}}, "dalembert"),
        ({"youngs_modulus": "where(x == 0.5, 7, 0.3)"}, "dalembert"),
        ({"damping": 0.1}, "fourier"),
        ({"damping": 0.1, "force": {"time": "sin(t)", "profile": "x"}}, "fourier"),
        ({"force": {"time": "sin(t)", "profile": "x"}}, "fourier"),
        ({"youngs_modulus": "where(0 < x/L <= 1/2, 0.1, 0.2)"}, "two_layer"),
        ({"youngs_modulus": "where(abs(x - 0.4) < 0.1, 0.1, 0.2)"}, "two_layer"),
        ({"initial_density": "where(x < 0.3, 1, 2)", "force": "sin(t)"}, "two_layer"),
        (TWO_LAYERS, "two_layer"),
        ({**TWO_LAYERS, "damping": 0.1}, None),
        ({**TWO_LAYERS, "force": {"time": "sin(t)", "profile": "x"}}, None),
        ({**TWO_LAYERS, "initial_density": "where(x < 0.4, 1, 2)"}, None),
        ({"youngs_modulus": "where(x < 0.3, 0.1, where(x < 0.6, 0.2, 0.3))"}, None),
        ({"youngs_modulus": "where((4*x) % 1 < 0.5, 0.1, 0.2)"}, None),
        ({"youngs_modulus": "where(x < 0.5, 0.1 + x, 0.2)"}, None),
        ({"youngs_modulus": "0.1 + 0.01*sin(2*pi*x)"}, None),
        ({"initial_density": "1 + x*(L - x)"}, None),
        ({"damping": "x"}, None),
    ],
)
def test_kind(changes, expected):
    assert exact.kind(make_scene(**changes)) == expected


def test_refuses_a_scene_without_exact_solution():
    with pytest.raises(ValueError, match="scene chain: no exact solution"):
        exact.solve(make_scene(damping="x"))


@pytest.mark.parametrize("changes", [{"damping": 1}, TWO_LAYERS])
def test_modified_reference_is_for_travelling_waves(changes):
    with pytest.raises(ValueError, match="scene chain: the modified reference"):
        exact.solve_modified(make_scene(**changes))


@pytest.mark.parametrize("changes", [{}, {"damping": 0.1}, TWO_LAYERS])
def test_stops_where_the_line_folds_over_itself(changes):
    scene = make_scene(**{**changes, "initial_velocity": "sin(2*pi*x)"})
    with pytest.raises(Breakdown, match="scene chain: the exact solution"):
        exact.solve(scene)


# --- The equations ------------------------------------------------------------------------------


@each_kind
def test_initial_state(changes):
    scene = make_scene(**changes)
    velocity, strain = fields(scene)
    np.testing.assert_allclose(velocity[0], scene.velocity0(), rtol=0, atol=1e-15)
    np.testing.assert_allclose(strain[0], 0, atol=1e-14)


def residuals(scene):
    """Largest residuals of ∂e/∂t = ∂v/∂x and ρ0 ∂v/∂t = ∂(ce)/∂x - ρ0 d v + ρ0 f.

    Central differences; stencils across an interface are left out.
    """
    velocity, strain = fields(scene)
    density = scene.density0()
    modulus = scene.modulus()
    interval, spacing = scene.error_interval, scene.spacing

    def in_time(field):
        return (field[2:] - field[:-2]) / (2 * interval)

    def in_space(field):
        field = field[1:-1]
        return (np.roll(field, -1, axis=1) - np.roll(field, 1, axis=1)) / (2 * spacing)

    rate = in_space(modulus * strain) / density
    damping = scene.damping_values()
    if damping.size:
        rate -= damping * velocity[1:-1]
    amplitudes, profiles = scene.force_values(scene.error_times[1:-1])
    if amplitudes.size:
        rate += amplitudes.T @ profiles
    same = (np.roll(modulus, 1) == modulus) & (np.roll(modulus, -1) == modulus)
    return (
        np.abs(in_time(strain) - in_space(velocity))[:, same].max(),
        np.abs(in_time(velocity) - rate)[:, same].max(),
    )


@each_kind
def test_solves_the_equations(changes):
    coarse, fine = (
        residuals(make_scene(1 / n, **{**changes, "particle_count": n, "duration": 1}))
        for n in (256, 512)
    )
    for first, second in zip(coarse, fine, strict=True):
        assert np.log2(first / second) == pytest.approx(2, abs=0.1)


@each_kind
def test_turns_with_the_line(changes):
    """Moving everything by a few particles moves the solution by as many."""

    def moved(text):
        return re.sub(r"\bx\b", "((x - 9/32) % L)", str(text))

    turned = dict(changes)
    for key, plain in (("initial_velocity", WAVY), ("initial_density", 2), ("youngs_modulus", 0.3)):
        turned[key] = moved(changes.get(key, plain))
    if isinstance(changes.get("force"), dict):
        force = changes["force"]
        turned["force"] = {**force, "profile": moved(force["profile"])}
    here, there = fields(make_scene(**changes)), fields(make_scene(**turned))
    for field, other in zip(here, there, strict=True):
        np.testing.assert_allclose(other, np.roll(field, 9, axis=1), rtol=0, atol=1e-11)


def energy(scene):
    """Kinetic and elastic energy (times,); the trapezoidal rule is exact for few harmonics."""
    velocity, strain = fields(scene)
    return (scene.density0() * velocity**2 + scene.modulus() * strain**2).mean(axis=1) / 2


@settings(deadline=None, max_examples=20)
@given(st.floats(0.1, 3), st.floats(0.01, 10), st.floats(0.1, 10))
def test_waves_keep_their_energy(length, modulus, density):
    values = energy(
        make_scene(
            domain_length=length,
            initial_velocity="1e-4*(sin(2*pi*x/L) + 0.5*cos(4*pi*x/L + 1))",
            youngs_modulus=modulus,
            initial_density=density,
        )
    )
    np.testing.assert_allclose(values, values[0], rtol=1e-10)


def test_layers_keep_their_energy():
    """The interfaces lie between particles, so that the sum misses little of the strain there."""
    values = energy(
        make_scene(
            particle_count=400,
            initial_velocity=BUMP,
            youngs_modulus="where(abs(x - 0.30125) < 0.27, 0.1, 0.5)",
            duration=5,
        )
    )
    np.testing.assert_allclose(values, values[0], rtol=1e-4)


@pytest.mark.parametrize("damping", [0.3, 7.0, 60.0])
def test_damping_takes_the_energy(damping):
    """dE/dt = -∫ρ0 d v² dx, integrated by Simpson's rule."""
    scene = make_scene(1e-3, damping=damping, duration=1)
    velocity, _ = fields(scene)
    values = energy(scene)
    power = damping * (scene.density0() * velocity**2).mean(axis=1)
    work = 1e-3 / 3 * (power[:-2:2] + 4 * power[1:-1:2] + power[2::2])
    np.testing.assert_allclose(values[0] - values[2::2], np.cumsum(work), rtol=1e-5)


@pytest.mark.parametrize("damping", [None, 0.7, 30.0])
@pytest.mark.parametrize("profile", [None, 2.0, "1 + cos(2*pi*x/L)"])
def test_momentum_balance(damping, profile):
    """The mean velocity u obeys u' = -d u + the mean of f, here f = a cos(νt)."""
    nu, push, start = 3.0, 1e-3 * (2.0 if profile == 2.0 else 1.0), 3e-4
    force = "1e-3*cos(3*t)" if profile is None else {"time": "1e-3*cos(3*t)", "profile": profile}
    scene = make_scene(force=force, **({} if damping is None else {"damping": damping}))
    velocity, _ = fields(scene)
    t, d = scene.error_times, damping or 0.0
    steady = (d * np.cos(nu * t) + nu * np.sin(nu * t)) / (d**2 + nu**2)
    fade = np.exp(-d * t)
    expected = start * fade + push * (steady - fade * d / (d**2 + nu**2))
    np.testing.assert_allclose(velocity.mean(axis=1), expected, rtol=0, atol=1e-12)


# --- Travelling waves -----------------------------------------------------------------------------


@settings(deadline=None, max_examples=30)
@given(
    st.integers(5, 60),
    st.floats(0.2, 4),
    st.floats(0.01, 3),
    st.sampled_from([WAVY, KINKED, "1e-3*where(x < 0.37*L, 1, x/L)", "1e-3*sin(60*pi*x/L)"]),
)
def test_waves_are_those_of_the_expression(count, length, modulus, profile):
    """Interpolation between the particles changes nothing, nor do kinks, jumps or fast changes."""
    scene = make_scene(
        particle_count=count,
        domain_length=length,
        youngs_modulus=modulus,
        initial_velocity=profile,
        error_interval=0.5,
    )
    velocity, strain = fields(scene)
    speed = np.sqrt(modulus / 2)
    way = speed * scene.error_times[:, None]
    ahead, behind = (
        scene.initial_velocity(x=(scene.positions + shift) % length) for shift in (way, -way)
    )
    # Where a particle is within rounding of a jump either side is right.
    jumps = np.array([0, 0.37]) * length
    clear = np.ones(velocity.shape, dtype=bool)
    for shift in (way, -way):
        place = (scene.positions + shift)[..., None] - jumps
        clear &= (np.abs(place - length * np.round(place / length)) > 1e-9).all(axis=-1)
    scale = np.abs(scene.initial_velocity(x=np.linspace(0, length, 1000))).max()
    np.testing.assert_allclose(velocity[clear], (ahead + behind)[clear] / 2, atol=2e-12 * scale)
    np.testing.assert_allclose(
        strain[clear], (ahead - behind)[clear] / (2 * speed), atol=2e-12 * scale / speed + 1e-15
    )


def test_modified_waves_are_faster_by_beta():
    scene = make_scene()
    beta = derivative_coefficient(scene.smoothing_ratio)
    modified = exact.solve_modified(scene)
    velocity, strain = fields(make_scene(youngs_modulus=0.3 * beta**2))
    np.testing.assert_allclose(modified["velocity"], velocity, rtol=0, atol=1e-15)
    np.testing.assert_allclose(
        scene.density0() / modified["density"] - 1, beta * strain, rtol=0, atol=1e-14
    )


# --- Modes ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("profile", [WAVY, KINKED, "1e-3*where(x < 0.37, 1, 0)"])
def test_little_damping_leaves_travelling_waves(profile):
    free, damped = (
        fields(make_scene(initial_velocity=profile, **damping))
        for damping in ({}, {"damping": 1e-9})
    )
    for field, other in zip(free, damped, strict=True):
        np.testing.assert_allclose(other, field, rtol=0, atol=1e-11)


@pytest.mark.parametrize("ratio", [0.01, 0.3, 1 - 1e-9, 1, 1 + 1e-9, 1.01, 4, 300])
def test_one_mode_is_a_damped_oscillator(ratio):
    """Under-damped, critical and over-damped; the ratio is d over the critical 2ω."""
    k = 2 * np.pi
    omega = k * np.sqrt(0.3 / 2)
    scene = make_scene(initial_velocity="1e-3*sin(2*pi*x)", damping=2 * omega * ratio)
    velocity, strain = fields(scene)
    t = scene.error_times[:, None]
    rate = omega * ratio
    if abs(ratio - 1) < 1e-6:
        displacement, response = t * np.exp(-rate * t), (1 - rate * t) * np.exp(-rate * t)
    else:
        root = np.sqrt(complex(rate**2 - omega**2))
        slow, fast = np.exp((root - rate) * t), np.exp((-root - rate) * t)
        displacement = ((slow - fast) / (2 * root)).real
        response = (((root - rate) * slow + (root + rate) * fast) / (2 * root)).real
    x = scene.positions
    expected = 1e-3 * response * np.sin(k * x)
    np.testing.assert_allclose(velocity, expected, rtol=0, atol=1e-11)
    expected = 1e-3 * displacement * k * np.cos(k * x)
    np.testing.assert_allclose(strain, expected, rtol=0, atol=1e-11)


@pytest.mark.parametrize("damping", [0.5, 8.0])
def test_a_kink_is_resolved(damping):
    """x (L - x) has the amplitudes -1/(2 π² l²), known without sampling, and a kink at x = 0."""
    scene = make_scene(0.25, initial_velocity=KINKED, damping=damping, particle_count=7, duration=3)
    velocity, strain = fields(scene)
    harmonic = np.arange(1, 50001)
    k = 2 * np.pi * harmonic
    amplitude = -2e-3 / (2 * np.pi**2 * harmonic**2)
    t = scene.error_times[:, None]
    root = np.sqrt((k**2 * 0.15 - damping**2 / 4).astype(complex))
    fade = np.exp(-damping / 2 * t)
    displacement = fade * (np.sin(root * t) / root).real
    response = fade * np.cos(root * t).real - damping / 2 * displacement
    phase = k[:, None] * scene.positions
    expected = 1e-3 / 6 * np.exp(-damping * t) + (response * amplitude) @ np.cos(phase)
    np.testing.assert_allclose(velocity, expected, rtol=0, atol=1e-8)
    expected = -(displacement * amplitude * k) @ np.sin(phase)
    # The series of the strain is poor where the strain jumps, at the fronts.
    front = np.abs((np.sqrt(0.15) * t + 0.5) % 1 - 0.5)
    clear = np.abs(front - np.abs((scene.positions + 0.5) % 1 - 0.5)) > 0.01
    assert clear.mean() > 0.8
    np.testing.assert_allclose(strain[clear], expected[clear], rtol=0, atol=1e-8)


@pytest.mark.parametrize("interval", [0.01, 0.5, 2.0])
def test_uneven_force_drives_its_mode(interval):
    """f = a cos(νt) sin(kx) drives e = a k cos(kx) (cos νt - cos ωt)/(ω² - ν²) from rest."""
    k, nu = 2 * np.pi, 3.0
    omega = k * np.sqrt(0.15)
    scene = make_scene(
        interval, initial_velocity=0, force={"time": "1e-3*cos(3*t)", "profile": "sin(2*pi*x)"}
    )
    velocity, strain = fields(scene)
    t, x = scene.error_times[:, None], scene.positions
    gap = omega**2 - nu**2
    expected = 1e-3 * k * np.cos(k * x) * (np.cos(nu * t) - np.cos(omega * t)) / gap
    np.testing.assert_allclose(strain, expected, rtol=0, atol=1e-13)
    expected = 1e-3 * np.sin(k * x) * (omega * np.sin(omega * t) - nu * np.sin(nu * t)) / gap
    np.testing.assert_allclose(velocity, expected, rtol=0, atol=1e-13)


# --- Two layers -----------------------------------------------------------------------------------


@pytest.mark.parametrize("profile", [WAVY, KINKED])
@pytest.mark.parametrize(("left", "width"), [(0, 0.5), (0.37, 0.3), (0.9, 0.2)])
def test_equal_layers_are_none(profile, left, width):
    layers = f"where((x - {left}) % L < {width}, 0.3, 0.3*(1 + 1e-10))"
    scene = make_scene(initial_velocity=profile, youngs_modulus=layers)
    assert exact.kind(scene) == "two_layer"
    uniform = fields(make_scene(initial_velocity=profile))
    for field, other in zip(uniform, fields(scene), strict=True):
        np.testing.assert_allclose(other, field, rtol=0, atol=1e-11)


def march_signals(steps, v0, nodes, impedance, modulus):
    """Two layers on a lattice that waves cross by one cell a step; an independent solution.

    ``nodes`` are the positions of either layer's nodes, ends included. The unknown signals behind
    an interface come from the two conditions that velocity and stress are continuous.

    Returns velocity and strain of either layer, (steps + 1, nodes).
    """
    right, left = ([v0(x=x % 1) for x in nodes] for _ in range(2))
    history: list[list[np.ndarray]] = [[], []]
    for step in range(steps + 1):
        if step:
            right = [np.roll(signal, 1) for signal in right]
            left = [np.roll(signal, -1) for signal in left]
        # Layer a ends where layer b begins.
        for a, b in ((0, 1), (1, 0)):
            towards, from_b = right[a][-1], left[b][0]
            conditions = np.array([[1, -1], [impedance[a], impedance[b]]])
            known = np.array([from_b - towards, impedance[a] * towards + impedance[b] * from_b])
            left[a][-1], right[b][0] = np.linalg.solve(conditions, known)
        for j in (0, 1):
            stress = impedance[j] * (left[j] - right[j]) / 2
            history[j].append(np.stack([(right[j] + left[j]) / 2, stress / modulus[j]]))
    return [np.stack(layer, axis=1) for layer in history]


@pytest.mark.parametrize("density", [1.0, 6.0])
@pytest.mark.parametrize(
    "profile", [WAVY, "1e-3*(x - 0.3)*(1 - x)*x", "1e-3*where(abs(x - 0.5) < 0.0875, x, 1)"]
)
def test_layers_against_waves_on_a_lattice(density, profile):
    """The layer [1/4, 3/4] has wave speed 1, the other 2; 40 particles, steps of 1/40."""
    count, duration = 40, 4
    scene = make_scene(
        1 / count,
        particle_count=count,
        duration=duration,
        initial_velocity=profile,
        initial_density=f"where(abs(x - 0.5) < 0.25, 1, {density})",
        youngs_modulus=f"where(abs(x - 0.5) < 0.25, 1, {4 * density})",
    )
    velocity, strain = fields(scene)
    nodes = (0.25 + np.arange(21) / 40, 0.75 + np.arange(11) / 20)
    particles = [np.rint(40 * x).astype(int) % 40 for x in nodes]
    layers = march_signals(
        duration * count, scene.initial_velocity, nodes, (1, 2 * density), (1, 4 * density)
    )
    for index, (v, e) in zip(particles, layers, strict=True):
        np.testing.assert_allclose(velocity[:, index], v, rtol=0, atol=1e-14)
        np.testing.assert_allclose(strain[:, index[1:-1]], e[:, 1:-1], rtol=0, atol=1e-14)
    # A particle on an interface has the mean strain of its two half cells.
    for a, b in ((0, 1), (1, 0)):
        mean = (layers[a][1][:, -1] + layers[b][1][:, 0]) / 2
        np.testing.assert_allclose(strain[:, particles[b][0]], mean, rtol=0, atol=1e-14)


def test_a_layer_thinner_than_a_particle():
    """It lies between two particles; long waves feel it by its mean compliance alone."""
    thin = make_scene(youngs_modulus="where(abs(x - 0.515625) < 0.001, 0.1, 0.3)")
    assert exact.kind(thin) == "two_layer"
    velocity, _ = fields(thin)
    uniform, _ = fields(make_scene(youngs_modulus=1 / (0.998 / 0.3 + 0.002 / 0.1)))
    assert np.abs(velocity - uniform).max() < 0.02 * np.abs(uniform).max()


@pytest.mark.parametrize(
    "material", [{}, {"youngs_modulus": "where(x < L/2, 0.1, 0.2)"}], ids=["uniform", "layers"]
)
def test_jittered_particles_see_the_waves_where_they_are(material):
    """Beside those of many even particles, between which the solution is all but linear."""
    jittered = small_scene(**material, positions={"jitter": 0.45, "seed": 1})
    fine = small_scene(**material, particle_count=2000, time_step=1e-3)
    found, truth = exact.solve(jittered), exact.solve(fine)
    for row in (0, 37, 100):
        expected = np.interp(jittered.positions, fine.positions, truth["velocity"][row], period=1)
        np.testing.assert_allclose(found["velocity"][row], expected, atol=1e-4 * 1e-3)
    assert exact.kind(small_scene(damping=1, positions={"jitter": 0.1})) is None


# --- Folding between outputs and particles --------------------------------------------------------

STANDING: dict[str, Any] = {
    "duration": 3.2, "error_interval": 3.2, "time_step": 3.2 / 400, "youngs_modulus": 0.09765625,
}  # fmt: skip
"""Waves of speed 0.3125 that are kept at 0 and T alone, when sin(2 pi x/L) strains nothing."""


def first_fold(case):
    with pytest.raises(Breakdown) as caught:
        exact.solve(case)
    return caught.value


@pytest.mark.parametrize("interval", [3.2, 0.1])
def test_folding_between_outputs_does_not_pass(interval):
    """e = (A/s) sin(2 pi s t) cos(2 pi x) is -1 first where the sine is s/A, at x = 1/2."""
    case = small_scene(
        **(STANDING | {"error_interval": interval, "initial_velocity": "0.45*sin(2*pi*x/L)"})
    )
    found = first_fold(case)
    speed = 0.3125
    expected = np.arcsin(speed / 0.45) / (2 * np.pi * speed)
    assert found.time == pytest.approx(expected, rel=1e-4)
    assert found.particle == 20


@pytest.mark.parametrize(
    ("changes", "solve"),
    [
        ({}, exact.solve),
        ({}, exact.solve_modified),
        ({"youngs_modulus": "0.09765625*where(x < L/2, 1, 1 + 1e-9)"}, exact.solve),
        ({"positions": {"jitter": 0.3, "seed": 2}}, exact.solve),
    ],
    ids=["waves", "modified", "layers", "jittered"],
)
def test_what_hardly_folds_and_what_hardly_does_not(changes, solve):
    for size, folds in ((0.9995, False), (1.0005, True)):
        case = small_scene(
            **(STANDING | changes | {"initial_velocity": f"{size}*0.3125*sin(2*pi*x/L)"})
        )
        if folds:
            with pytest.raises(Breakdown):
                solve(case)
        else:
            solve(case)


@pytest.mark.parametrize(
    "changes",
    [
        {"damping": 0.3},
        {"damping": 0.3, "force": "cos(t)"},
        {"initial_velocity": 0, "force": {"time": "2*sin(2*pi*t/3.2)", "profile": "sin(2*pi*x)"}},
        {"youngs_modulus": "0.09765625*where(x < 0.37, 1, 2)"},
        {"initial_density": "where(x < 0.37, 1, 3)"},
    ],
    ids=["damped", "damped-forced", "forced", "moduli", "densities"],
)
def test_folding_is_found_when_a_smaller_motion_shows_it(changes):
    """Strains are linear in v0 and force: a twentieth of both shows when the line would fold."""
    case = STANDING | {"initial_velocity": "0.45*sin(2*pi*x/L)"} | changes
    found = first_fold(small_scene(**case))
    small = case | {"initial_velocity": f"0.05*({case['initial_velocity']})"}
    if isinstance(case.get("force"), dict):
        small["force"] = case["force"] | {"profile": f"0.05*({case['force']['profile']})"}
    elif "force" in case:
        small["force"] = f"0.05*({case['force']})"
    interval = 3.2 / 1600
    many = small_scene(
        **(small | {"particle_count": 800, "error_interval": interval, "time_step": interval})
    )
    strain = 20 * fields_of(exact.solve(many), many)[1]
    row = int(np.argmax(strain.min(axis=1) <= -1))
    assert row > 0
    assert many.error_times[row - 1] - 0.004 <= found.time <= many.error_times[row] + 0.004


def test_strong_damping_keeps_the_line_from_folding():
    """The bound by the signals does not exclude it; looking at them does."""
    case = small_scene(**STANDING, initial_velocity="0.45*sin(2*pi*x/L)", damping=6)
    assert np.ptp(case.velocity0()) > 2 * 0.3125
    velocity, strain = fields_of(exact.solve(case), case)
    assert np.isfinite(velocity).all()
    assert strain.min() > -1


def fields_of(solution, case):
    return solution["velocity"], case.density0() / solution["density"] - 1


@pytest.mark.parametrize(
    "changes",
    [
        {"youngs_modulus": 1e-300},
        {"initial_density": 1e150},
        {"youngs_modulus": 1e-300, "initial_density": 1e300},
        {"youngs_modulus": 1e-12},
        {"youngs_modulus": 1e-22},
        {"youngs_modulus": 1e-300, "positions": {"jitter": 0.3, "seed": 2}},
    ],
)
def test_waves_that_hardly_travel_strain_by_the_slope_of_the_start(changes):
    """As s tends to 0, e = t v0'(x), with no rounding error that 1/2s would magnify."""
    case = small_scene(**changes)
    velocity, strain = fields_of(exact.solve(case), case)
    x, t = case.positions, case.error_times[:, None]
    start = 1e-3 * np.sin(2 * np.pi * x) + 5e-4 * np.cos(4 * np.pi * x)
    slope = 2e-3 * np.pi * (np.cos(2 * np.pi * x) - np.sin(4 * np.pi * x))
    np.testing.assert_allclose(velocity, start + 0 * t, rtol=0, atol=1e-9)
    np.testing.assert_allclose(strain, t * slope, rtol=0, atol=1e-9)


def test_waves_that_hardly_travel_fold_when_the_slope_says_so():
    case = small_scene(youngs_modulus=1e-300, initial_velocity="0.5*sin(2*pi*x/L)")
    assert first_fold(case).time == pytest.approx(1 / np.pi, rel=1e-4)
    jumping = small_scene(youngs_modulus=1e-300, initial_velocity="1e-3*where(x < L/2, 1, 0)")
    assert first_fold(jumping).time == 0


def test_layers_whose_waves_hardly_travel_are_not_called_exact():
    layers = "where(x < L/2, {}, {})".format
    assert exact.kind(small_scene(youngs_modulus=layers(1e-12, 2e-12))) == "two_layer"
    assert exact.kind(small_scene(youngs_modulus=layers(1e-300, 2e-300))) is None
