"""Scenes, and what theory says of them before a run."""

import re
from dataclasses import replace
from decimal import Decimal, localcontext
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import VARIED, scene

from sphpod import lifted, rom, sph, stability
from sphpod import scene as scenes


def test_particles_steps_and_errors():
    case = scene(duration=2, particle_count=50, time_step=4e-3, error_interval=0.02)
    assert case.spacing == 0.02
    assert case.positions[[0, -1]].tolist() == [0, 0.98]
    assert case.step_count == 500
    assert case.error_stride == 5
    np.testing.assert_allclose(case.error_times, np.arange(101) * 0.02)


def test_interface_mean_averages_only_where_the_modulus_jumps():
    jump = {"youngs_modulus": "where(0 < x <= L/2, 0.1, 0.2)"}
    printed, mean = scene(**jump).modulus(), scene(**jump, interface="mean").modulus()
    changed = np.flatnonzero(printed != mean)
    assert changed.tolist() == [0, 20]
    np.testing.assert_allclose(mean[changed], 0.15)


def test_what_a_scene_lacks_is_empty():
    case = scene()
    assert case.damping_values().size == 0
    assert scene(damping=0).damping_values().size == 0
    assert all(part.size == 0 for part in case.force_values(case.error_times))


@pytest.mark.parametrize("changes", [{}, {"smoothing_ratio": 1.7}, VARIED | {"damping": 0}])
def test_fastest_wave_bounds_the_spectrum_closely(changes):
    case = scene(**changes)
    from sphpod.kernel import derivative, stencil_weights

    g = derivative(np.eye(case.particle_count), stencil_weights(case.spacing, case.smoothing_ratio))
    scaled = g * np.sqrt(case.modulus()) / np.sqrt(case.density0())[:, None]
    largest = np.linalg.norm(scaled, 2)
    assert largest * (1 - 1e-9) <= stability.fastest_wave(case) <= 1.35 * largest


def test_growth_factor_is_what_the_fastest_wave_does():
    """The fastest wave of a uniform scene, in a run of full SPH."""
    case = scene(particle_count=40, duration=2, time_step=4e-3, error_interval=0.02)
    angles = np.arange(21) * 2 * np.pi / 40
    from sphpod.kernel import stencil_weights

    weights = stencil_weights(case.spacing, case.smoothing_ratio)
    symbol = 2 * sum(w * np.sin((k + 1) * angles) for k, w in enumerate(weights))
    wave = int(np.argmax(np.abs(symbol)))
    seeded = scene(
        initial_velocity=f"1e-9*cos(2*pi*{wave}*x/L)",
        duration=2,
        time_step=4e-3,
        error_interval=0.02,
    )
    result = sph.solve(seeded, seeded.error_steps)
    strain = 1 / result["density"] - 1
    energy = (result["velocity"] ** 2).sum(axis=1) + 0.1 * (strain**2).sum(axis=1)
    measured = np.sqrt(energy[-1] / energy[0])
    assert stability.growth_factor(case) == pytest.approx(measured, rel=0.02)


def test_largest_time_step_keeps_the_growth():
    case = scene()
    step = stability.largest_time_step(case, 5)
    assert stability.growth_factor(case, step) <= 5 < stability.growth_factor(case, 1.01 * step)


def test_a_scene_that_no_step_can_spoil_may_take_its_duration_in_one():
    case = scene(youngs_modulus=1e-6)
    assert stability.largest_time_step(case, 1e6) == case.duration


def test_damping_beyond_its_limit_grows():
    calm = scene(damping=1900, time_step=1e-3)
    stiff = scene(damping=2100, time_step=1e-3)
    assert stability.growth_factor(calm) == pytest.approx(1)
    assert stability.growth_factor(stiff) > 1e6


REFUSED = {
    "jitter": (
        {"positions": {"jitter": 0.5}},
        "positions.jitter = 0.5: it must be from 0",
    ),
    "jittered wrap": (
        {"positions": {"jitter": 0.1}, "particle_count": 5, "smoothing_ratio": 1.3},
        "smoothing_ratio = 1.3: of jittered particles .* at most 1.25 is possible",
    ),
    "particle_count": ({"particle_count": 4}, "particle_count = 4: at least 5"),
    "time_step": ({"time_step": 0}, "time_step = 0: it must be a positive"),
    "duration": ({"duration": 1.0005}, "duration = 1.0005: it must be a whole number of time"),
    "interval": ({"error_interval": 0.03}, "error_interval = 0.03: the duration 1 must be"),
    "between": ({"error_interval": 0.0025}, "error_interval = 0.0025: it must be a whole number"),
    "wrap": ({"smoothing_ratio": 11}, "smoothing_ratio = 11: .* at most 10 is possible"),
    "alone": ({"smoothing_ratio": 0.5}, "smoothing_ratio = 0.5: it must be above 0.5"),
    "density": ({"initial_density": "cos(2*pi*x)"}, r"initial_density = cos\(2\*pi\*x\): it is -1"),
    "modulus": ({"youngs_modulus": "x"}, "youngs_modulus = x: it is 0 at x = 0"),
    "damping": ({"damping": "x - 0.5"}, "damping = x - 0.5: it is -0.5 at x = 0"),
    "velocity": ({"initial_velocity": "1/x"}, "initial_velocity = 1/x: it is not finite at x = 0"),
    "force": ({"force": "1/t"}, "force = 1/t: it is not finite at t = 0"),
    "growth": (
        {"time_step": 0.05, "error_interval": 0.05, "youngs_modulus": 10},
        "time_step = 0.05",
    ),
}


@pytest.mark.parametrize(("changes", "message"), REFUSED.values(), ids=REFUSED)
def test_hopeless_scenes_are_refused_in_one_sentence(changes, message):
    with pytest.raises(ValueError, match=f"^scene bad: {message}") as refusal:
        scenes.check(scene("bad", **changes))
    assert "\n" not in str(refusal.value)


def test_a_refused_step_is_told_the_factor_and_the_largest_that_would_do():
    bad = scene("bad", time_step=0.05, error_interval=0.05, youngs_modulus=10)
    with pytest.raises(ValueError, match="grow by") as refusal:
        scenes.check(bad)
    step = float(str(refusal.value).split("which a time step of ")[1].split()[0])
    assert stability.growth_factor(bad, step * 0.99) <= 1e6


def test_sound_scenes_pass():
    for changes in ({}, VARIED, {"smoothing_ratio": 10}, {"particle_count": 5}):
        scenes.check(scene(**changes))


JITTER = {"positions": {"jitter": 0.3, "seed": 5}}


@pytest.mark.parametrize("changes", [JITTER, VARIED | JITTER, {"smoothing_ratio": 1.7} | JITTER])
def test_fastest_wave_bounds_the_spectrum_of_jittered_particles(changes):
    case = scene(**changes)
    largest = np.linalg.norm(lifted.operator(replace(case, damping=None)).toarray(), 2)
    assert largest <= stability.fastest_wave(case) <= 2 * largest


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"initial_velocity": "1e-5*sin(26*pi*x/L)"},
        {"initial_velocity": "1e-5*where(x < 0.3, 1, 0)"},
        {key: VARIED[key] for key in ("initial_density", "youngs_modulus")},
        JITTER,
    ],
    ids=["waves", "fast wave", "jump", "uneven", "jittered"],
)
def test_energy_growth_is_what_full_sph_does(changes):
    """Undamped, without the spectrum, to what the density form differs from the linear one."""
    case = scene(**changes, duration=10, time_step=2e-3, error_interval=10)
    result = sph.solve(case, np.array([0, case.step_count]))
    mass, stiffness = lifted.energy_weights(case)
    strain = lifted.strain(case, result["density"])
    energy = np.sum((mass * result["velocity"]) ** 2 + (stiffness * strain) ** 2, axis=1)
    assert stability.energy_growth(case) == pytest.approx(energy[1] / energy[0], rel=1e-3)


def test_nothing_that_moves_does_not_grow():
    assert stability.energy_growth(scene(initial_velocity=0)) == 1
    # A uniform force moves all particles alike.
    assert stability.energy_growth(scene(initial_velocity=0, force="sin(t)")) == pytest.approx(1)


def test_growth_of_the_solution_is_told_with_what_avoids_it(caplog):
    case = scene("waves", duration=10, time_step=2e-3)
    told = stability.foretell(case)
    assert told["energy_growth"] > 1.01
    assert told["fastest_wave_growth"] == stability.growth_factor(case)
    (record,) = caplog.records
    assert re.fullmatch(
        r"scene waves: time_step = 0.002: .* grow by [\d.]+ % over 10 s, .*leapfrog and .*"
        r" up to ([\d.]+) s",
        record.getMessage(),
    )
    step = float(record.getMessage().split()[-2])
    assert step * stability.fastest_wave(case) <= 2
    caplog.clear()
    stability.foretell(scene(duration=10, time_step=1e-5))
    assert not caplog.records


def test_jittered_particles_fill_the_domain():
    case = scene(**JITTER)
    gaps = np.diff(case.positions, append=1.0)
    assert case.positions[0] == 0
    assert gaps.min() > 0.4 * case.spacing
    assert np.ptp(gaps) > 0.4 * case.spacing
    assert case.volumes.sum() == pytest.approx(1)
    np.testing.assert_allclose(case.volumes, (gaps + np.roll(gaps, 1)) / 2)
    assert scene(positions={"jitter": 0}).positions.tolist() == scene().positions.tolist()


def test_what_jitter_loses_is_told(caplog):
    shares = []
    for count in (40, 80):
        case = scene(
            "jittered", particle_count=count, time_step=1e-5, error_interval=1e-2, **JITTER
        )
        told = stability.foretell(case)
        (record,) = caplog.records
        assert record.getMessage().startswith(
            "scene jittered: positions.jitter = 0.3: a translation"
        )
        shares.append(told["translation_strain"])
        caplog.clear()
    # More particles do not help.
    assert shares[1] > 1.5 * shares[0] > 0.5
    assert stability.translation_strain(scene()) < 1e-12
    assert "translation_strain" not in stability.foretell(scene(time_step=1e-5))


@given(
    st.decimals("1e-6", "2", places=7) | st.decimals("1e-4", "2", places=17),
    st.lists(st.integers(0, 10**9), min_size=1, max_size=20),
    st.sampled_from([1, 2, 8]),
)
def test_times_are_the_doubles_nearest_to_those_of_the_decimal_step(step, steps, parts):
    with localcontext(prec=60):
        exact = [float(Decimal(repr(float(step))) * n / parts) for n in steps]
    found = scenes.step_times(float(step), np.array(steps), parts)
    np.testing.assert_allclose(found, exact, rtol=2**-51, atol=0)
    if step.as_tuple().exponent >= -7:
        assert found.tolist() == exact


@pytest.mark.parametrize("step", [1 / 3, 0.1 + 0.2, 0.07 / 7, 1 / 300, 5e-324, 1e-300])
def test_times_of_steps_that_rounding_has_touched(step):
    thirds = scenes.step_times(step, np.arange(7))
    simple = Fraction(step).limit_denominator(1000) or Fraction(step)
    assert thirds.tolist() == [float(n * simple) for n in range(7)]


def test_every_decimal_time_is_a_time_of_the_error_integral():
    for dt in (1e-4, 3e-4, 1.5e-3, 1 / 3000):
        case = scene(duration=3, time_step=dt, error_interval=0.003)
        assert case.error_times.tolist() == [float(f"{n * 3}e-3") for n in range(1001)]


def test_a_duration_and_an_interval_touched_by_rounding_are_whole_steps():
    case = scene(duration=0.1 + 0.2, error_interval=0.07 + 0.03 - 0.09, time_step=1e-3)
    scenes.check(case)
    assert (case.duration, case.error_interval) == (0.3, 0.01)
    assert case.error_times[-1] == 0.3
    ends = scene(duration=0.1 + 0.2, force="where(t == T, 1, 0)")
    assert ends.force_values(ends.error_times)[0].tolist() == [0] * 30 + [1]


def test_a_force_is_taken_at_the_decimal_times_of_steps():
    """In the step from 0.3 s on; 3 Δt in double precision is above 0.3."""
    kicked = scene(duration=1, time_step=0.1, error_interval=0.1, youngs_modulus=1e-6,
                   initial_velocity=0, force="where(t == 0.3, 1, 0)")  # fmt: skip
    velocity = sph.solve(kicked, kicked.error_steps)["velocity"]
    np.testing.assert_allclose(velocity[:, 0], [0] * 4 + [0.1] * 7, atol=1e-9)
    reduced = rom.ReducedModel(kicked, "original", np.ones((1, 40)) / 40**0.5,
                               np.ones((1, 40)) / 40**0.5)  # fmt: skip
    np.testing.assert_allclose(reduced.solve(kicked.error_steps)[0][:, 0], velocity[:, 0] * 40**0.5)
    strained = lifted.solve(kicked, "explicit_euler")["velocity"]
    np.testing.assert_allclose(strained, velocity, atol=1e-9)
