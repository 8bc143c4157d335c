"""What particles cannot resolve: waves they alias, jumps, and material that escapes them."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import VARIED, scene

from sphpod.full import sph
from sphpod.numerics.error import relative_error
from sphpod.reference import exact
from sphpod.scene import resolution
from sphpod.scene.scene import Scene

CONFIG = Path(__file__).parents[2] / "config"


def reported(case, caplog):
    caplog.clear()
    found = resolution.predict(case)
    return found, [record.getMessage() for record in caplog.records]


@settings(deadline=None, max_examples=30)
@given(st.integers(5, 60), st.integers(1, 200), st.floats(1e-3, 10))
def test_the_part_of_aliased_harmonics_is_theirs(count, harmonic, size):
    """Of sin(2 pi x/L) and another harmonic the energies are one and the amplitude squared."""
    part, enough = resolution.unresolved(
        lambda x: np.sin(2 * np.pi * x) + size * np.sin(2 * np.pi * harmonic * x + 1), 1.0, count
    )
    missed = size**2 / (1 + size**2) if 2 * harmonic >= count and harmonic > 1 else 0
    assert part == pytest.approx(missed, abs=1e-9)
    if missed > resolution.REPORTED_ENERGY:
        assert enough == 2 * harmonic + 1
    elif harmonic > 1:
        assert enough == count


@pytest.mark.parametrize(
    ("profile", "particles"),
    [
        ("sin(2*pi*20*x/L)", 41),
        ("sin(2*pi*43*x/L)", 87),
        ("sin(2*pi*x/L) + 0.1*sin(2*pi*25*x/L)", 51),
        ("cos(2*pi*40*x/L)", 81),
        ("sin(2*pi*40000*x/L)", 80001),
        ("sin(2*pi*400000*x/L)", None),
    ],
)
def test_waves_that_cannot_pass_are_reported_with_what_resolves_them(profile, particles, caplog):
    case = scene("fine", initial_velocity=f"1e-3*({profile})")
    found, (sentence,) = reported(case, caplog)
    assert found["unresolved_energy"] > 9e-3
    assert found["velocity_jump"] == 0
    assert sentence.startswith("scene fine: initial_velocity = 1e-3*(")
    needed = f"at least {particles}" if particles else f"more than {resolution.MOST_PARTICLES}"
    assert sentence.endswith(f"which 40 particles take for others: {needed} particles are needed")


@pytest.mark.parametrize(
    ("profile", "place", "jump"),
    [
        ("x/L", "0", -2),
        ("where(x/L < 0.37, 1, 0)", "0", 1),
        ("1 + where(0.4 < x/L < 0.7, x/L - 0.7, 0)", "0.8", -0.3),
        ("exp(-200*(x/L - 0.88)**2)", "0", -np.exp(-200 * 0.12**2)),
        ("sin(2*pi*x/L) + where(x/L < 0.25, 0.03, 0)", "0", 0.03),
    ],
)
def test_jumps_are_reported_with_their_place(profile, place, jump, caplog):
    case = scene("jumping", domain_length=2, initial_velocity=profile)
    found, (sentence,) = reported(case, caplog)
    largest = found["velocity_jump"]
    assert abs(largest) == pytest.approx(abs(jump) / (2 if profile == "x/L" else 1), rel=1e-6)
    assert f"it jumps by {largest:.3g} m/s at x = {place} m" in sentence


def test_jumps_are_found_where_they_are():
    def profile(x):
        return np.sin(2 * np.pi * x / 3) + np.where((x > 0.7) & (x < 1.9), 0.2, 0)

    found = resolution.jumps(profile, 3.0, 1000, 1e-2)
    assert [place for place, _ in found] == pytest.approx([0.7, 1.9], abs=1e-11)
    assert [jump for _, jump in found] == pytest.approx([0.2, -0.2], abs=1e-9)
    assert resolution.jumps(lambda x: np.sin(1000 * np.pi * x), 3.0, 1000, 1e-2) == []


def scenes_of(name):
    """Scenes of a configuration, those at the edge too, as they stand in it."""
    config = yaml.safe_load((CONFIG / name).read_text())
    numbers = "domain_length", "duration", "smoothing_ratio", "time_step", "error_interval"
    for key, settings_of in (config["scenes"] | config["stability"]["edge_scenes"]).items():
        known = {name: float(settings_of[name]) for name in numbers if name in settings_of}
        known.setdefault("error_interval", known["time_step"])
        if settings_of["particle_count"] < 10_000:
            yield Scene.from_settings(key, settings_of | known)


@pytest.mark.parametrize("name", ["config.yaml", "small.yaml"])
def test_nothing_is_reported_of_scenes_that_are_resolved(name, caplog):
    for case in scenes_of(name):
        found, sentences = reported(case, caplog)
        assert sentences == [], case.name
        assert found["unresolved_energy"] < resolution.REPORTED_ENERGY


@pytest.mark.parametrize("velocity", [0, 3, "1e-320", "1e308*sin(2*pi*x/L)", "2 + 1e-17*x"])
def test_what_does_not_vary_or_is_huge_is_resolved(velocity, caplog):
    found, sentences = reported(scene(initial_velocity=velocity), caplog)
    assert found == {"unresolved_energy": 0.0, "velocity_jump": 0.0}
    assert sentences == []


def test_forces_and_material_that_escape_the_particles_are_reported(caplog):
    layered = {"youngs_modulus": "where(x/L < 0.3, 0.1, 0.2)", "damping": "where(x/L < 0.5, 3, 0)"}
    force = {"time": "sin(t)", "profile": "where(x/L < 0.3, 1, 0)"}
    assert reported(scene(**layered, force=force), caplog)[1] == []
    assert reported(scene(**VARIED), caplog)[1] == []
    fine = "1 + 0.5*sin(2*pi*{}*x/L)".format
    case = scene(
        initial_density=fine(40), youngs_modulus=fine(41), damping=fine(42),
        force={"time": "sin(t)", "profile": fine(43)},
    )  # fmt: skip
    sentences = reported(case, caplog)[1]
    keys = "force.profile", "initial_density", "youngs_modulus", "damping"
    for key, harmonic, sentence in zip(keys, (43, 40, 41, 42), sentences, strict=True):
        assert sentence.startswith(f"scene test: {key} = ")
        assert f"at least {2 * harmonic + 1} particles" in sentence


@pytest.mark.parametrize("harmonic", [19, 20, 43])
def test_what_is_reported_is_what_costs_the_solution(harmonic, caplog):
    """With the particles that are reported, or with its own, full SPH starts with the harmonic."""
    case = scene(initial_velocity=f"1e-3*sin(2*pi*{harmonic}*x/L)", time_step=1e-4)
    sentences = reported(case, caplog)[1]
    assert bool(sentences) is (harmonic >= 20)
    if harmonic == 43:
        run, low = (sph.solve(c, c.error_steps) for c in (
            case, scene(initial_velocity="1e-3*sin(6*pi*x/L)", time_step=1e-4)
        ))  # fmt: skip
        assert relative_error(run["velocity"], low["velocity"]) < 1e-9
        assert relative_error(run["velocity"], exact.solve(case)["velocity"]) > 1


@pytest.mark.parametrize(
    ("force", "part"),
    [
        ("where((t > 0.3002) and (t < 0.3006), 1, 0)", "1e+02 %"),
        (
            "where((t > 0.2995) and (t < 0.3005), 1, 0) + where((t > 0.5) and (t < 0.6), 1e-3, 0)",
            "",
        ),
        ("exp(-((t - 0.50041)/2e-4)**2)", "%"),
        ("cos(20*t)", ""),
        ("where(t < 0.3335, 1, 0)", ""),
    ],
)
def test_pulses_between_the_steps_are_reported(force, part, caplog):
    keys = {"force": {"time": force, "profile": "sin(2*pi*x/L)"}, "time_step": 1e-3}
    _, sentences = reported(scene(**keys), caplog)
    assert [part in one for one in sentences if "impulse" in one] == [True] * bool(part)
