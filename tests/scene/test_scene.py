"""Scenes, and what theory says of them before a run."""

import re
from dataclasses import replace
from decimal import Decimal, localcontext
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import VARIED, scene

from sphpod.full import lifted, sph
from sphpod.reduced import rom
from sphpod.scene import checks, waves
from sphpod.scene import scene as scenes


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
    from sphpod.scene.kernel import derivative, stencil_weights

    g = derivative(np.eye(case.particle_count), stencil_weights(case.spacing, case.smoothing_ratio))
    scaled = g * np.sqrt(case.modulus()) / np.sqrt(case.density0())[:, None]
    largest = np.linalg.norm(scaled, 2)
    assert largest * (1 - 1e-9) <= waves.fastest_wave(case) <= 1.35 * largest


def test_growth_factor_is_what_the_fastest_wave_does():
    """The fastest wave of a uniform scene, in a run of full SPH."""
    case = scene(particle_count=40, duration=2, time_step=4e-3, error_interval=0.02)
    angles = np.arange(21) * 2 * np.pi / 40
    from sphpod.scene.kernel import stencil_weights

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
    assert waves.growth_factor(case) == pytest.approx(measured, rel=0.02)


LINE = {"youngs_modulus": 0.4, "particle_count": 60, "time_step": 2e-3, "duration": 16}
"""A line whose fastest wave grows by 10^9.8 where nothing damps it."""


def line(**changes):
    case = scene("line", **LINE | changes)
    return replace(case, error_interval=case.duration)


def powers(case):
    """Growth of the fastest-growing wave over T, and the largest norm of a power of the step."""
    step = np.eye(2 * case.particle_count) + case.time_step * lifted.operator(case).toarray()
    with np.errstate(over="ignore"):
        wave = np.abs(np.linalg.eigvals(step)).max() ** case.step_count
    largest, power = 1.0, np.eye(len(step))
    for digit in f"{case.step_count:b}":
        power = power @ power
        power = power @ step if digit == "1" else power
        largest = max(largest, float(np.linalg.norm(power, 2)))
    return wave, largest


PARTLY = {
    "free tenth": ("where(x/L < 0.1, 0, 8)", 1.18),
    "nearly free": ("where(x/L < 0.1, 0, 1)", 7.16),
    "free fifth": ("where(x/L < 0.2, 0, 8)", 7.64),
    "sine": ("8*(1 + sin(2*pi*x/L))", 6.56),
    "barrier": ("where(x/L < 0.1, 0, 300)", 7.82),
    "stiff place": ("where(x/L < 0.02, 1005, 0)", 29.75),
}
"""Dampings, and the logarithm to base 10 of the largest growth of energy's root over 16 s."""


@pytest.mark.parametrize(("damping", "logarithm"), PARTLY.values(), ids=PARTLY)
def test_damping_of_a_part_bounds_growth_as_far_as_it_does(damping, logarithm):
    case = line(damping=damping)
    _, largest = powers(case)
    assert np.log10(largest) == pytest.approx(logarithm, abs=0.02)
    assert waves.growth_factor(case, limit=1) == pytest.approx(largest, rel=1e-6)
    if largest < 1e6:
        checks.check(case)
        return
    with pytest.raises(
        ValueError, match=r"explicit Euler would let waves grow by up to"
    ) as refusal:
        checks.check(case)
    step = float(str(refusal.value).split("which a time step of ")[1].split()[0])
    kept = [
        powers(line(damping=damping, time_step=16 / np.ceil(16 / h)))[1] for h in (step, step / 2)
    ]
    assert max(kept) <= 1e6
    assert powers(line(damping=damping, time_step=16 / np.floor(16 / (1.06 * step))))[1] > 1e6


@pytest.mark.parametrize("name", ["free tenth", "nearly free", "sine", "barrier"])
@pytest.mark.parametrize("jitter", [0, 0.3])
def test_growth_is_what_full_sph_does_from_the_worst_start(name, jitter):
    case = line(damping=PARTLY[name][0], positions={"jitter": jitter, "seed": 1})
    step = np.eye(2 * case.particle_count) + case.time_step * lifted.operator(case).toarray()
    _, growth, starts = np.linalg.svd(np.linalg.matrix_power(step, case.step_count))
    # So small that it stays linear, however much it grows.
    scaled = 1e-4 / growth[0] * starts[0]
    mass, stiffness = lifted.energy_weights(case)
    velocity, strain = scaled[: mass.size] / mass, scaled[mass.size :] / stiffness
    start = velocity, lifted.density(case, strain)
    result = sph.solve(case, np.array([0, case.step_count]), start=start)
    strain = lifted.strain(case, result["density"])
    energy = np.sum((mass * result["velocity"]) ** 2 + (stiffness * strain) ** 2, axis=1)
    grown = np.sqrt(energy[1] / energy[0])
    # It may grow by a little first where it decays by the end.
    assert waves.growth_factor(case, limit=1) == pytest.approx(max(1, grown), rel=0.02)


@st.composite
def any_scene(draw):
    """Any material, damping and step, so long that undamped waves may grow."""

    def profile(mean):
        depth, shift = draw(st.floats(0, 0.95)), draw(st.floats(0, 6))
        place, other = draw(st.floats(0.05, 0.95)), draw(st.sampled_from([0.03, 0.1, 1, 30]))
        wave = f"{mean!r}*(1 + {depth!r}*sin(2*pi*x/L + {shift!r}))"
        return draw(st.sampled_from([wave, f"where(x/L < {place!r}, {mean!r}, {other * mean!r})"]))

    changes = {
        "particle_count": draw(st.integers(8, 24)),
        "smoothing_ratio": draw(st.sampled_from([0.8, 1.04, 1.7])),
        "initial_density": profile(1.0),
        "youngs_modulus": profile(0.1),
        "positions": {"jitter": draw(st.sampled_from([0, 0.3])), "seed": draw(st.integers(0, 9))},
    }
    fastest = waves.fastest_wave(scene(**changes))
    size = fastest * 10 ** draw(st.floats(-3, 2))
    place = draw(st.floats(0.05, 0.95))
    partly = f"where(x/L < {place!r}, 0, {size!r})"
    damping = draw(st.sampled_from(["0", f"{size!r}", partly, profile(size)]))
    part = 10 ** draw(st.floats(-2, 0.4))
    step, count = part / fastest, round(min(3000, max(3, draw(st.floats(0.5, 30)) / part**2)))
    times = {"time_step": step, "duration": count * step, "error_interval": count * step}
    return scene(**changes, damping=damping, **times)


@pytest.mark.parametrize("modulus", [1e-300, 1e300])
@pytest.mark.parametrize(
    ("size", "damping"), [("1e-320", "where(x < 0.5, 0, 3)"), ("1e300", "0"), ("1e300", "1e200*x")]
)
def test_numbers_at_the_ends_of_floating_point_have_bounds_too(modulus, size, damping):
    case = scene(youngs_modulus=modulus, initial_velocity=f"{size}*sin(2*pi*x/L)", damping=damping)
    with np.errstate(all="raise", under="ignore"):
        growth = waves.growth_factor(case)
        assert growth == (1 if modulus < 1 and "200" not in damping else np.inf)
        energy = waves.energy_growth(case)
        assert energy == 1 or not energy < np.inf
        step = waves.largest_time_step(case, 1e6)
        assert waves.growth_factor(case, step) <= 1e6
        assert step == case.duration or waves.growth_factor(case, 1.01 * step) > 1e5


@settings(deadline=None, max_examples=80)
@given(any_scene())
def test_no_wave_grows_by_more_than_its_bound(case):
    """Neither one alone, nor, by more than twice that, all waves together at any time."""
    with np.errstate(over="ignore", invalid="ignore"):
        wave, largest = powers(case) if waves.growth_factor(case) < 1e30 else (1, 1)
    for limit in (np.inf, 1e6, 1.0):
        bound = waves.growth_factor(case, limit=limit)
        assert bound >= 1
        assert bound >= wave * (1 - 1e-9)
        assert 2 * bound >= largest
    assert waves.growth_factor(case, limit=1.0) <= waves.growth_factor(case, limit=np.inf)
    if not case.damping_values().size and 1.1 < wave < 1e30:
        assert bound == pytest.approx(wave, rel=0.02)


def test_bounds_are_fast_and_close_however_many_particles_there_are():
    case = line(particle_count=20000, time_step=1e-5, duration=0.05)
    soft = replace(
        case, initial_density=scene(initial_density="1 + 0.9*sin(2*pi*x/L)").initial_density
    )
    for known, stiffest in ((case, 1.0), (soft, 1 / np.sqrt(0.1))):
        # Waves are nearly local where there are many particles in the length of a profile.
        grown = np.log1p((1e-5 * waves.fastest_wave(case) * stiffest) ** 2) / 2 * 5e3
        assert np.log(waves.growth_factor(known, limit=1)) == pytest.approx(grown, rel=5e-3)


@pytest.mark.parametrize(
    "changes",
    [{}, {"damping": "where(x/L < 0.4, 0, 20)"}, {"damping": 3}, {"damping": "400*(1 + x/L)"}],
)
@pytest.mark.parametrize("growth", [5, 1e6])
def test_largest_time_step_keeps_the_growth(changes, growth):
    case = scene(youngs_modulus=10, duration=4, error_interval=4, **changes)
    step = waves.largest_time_step(case, growth)
    found = waves.growth_factor(case, step, growth / 1.5)
    assert found <= growth
    wave, _ = powers(
        scene(**changes, youngs_modulus=10, duration=4, time_step=4 / np.ceil(4 / step))
    )
    assert wave <= growth * 1.001
    assert found > 0.66 * growth or waves.growth_factor(case, 1.01 * step, growth) > growth


def test_a_scene_that_no_step_can_spoil_may_take_its_duration_in_one():
    case = scene(youngs_modulus=1e-6)
    assert waves.largest_time_step(case, 1e6) == case.duration


def test_damping_beyond_its_limit_grows():
    calm = scene(damping=1900, time_step=1e-3)
    stiff = scene(damping=2100, time_step=1e-3)
    assert waves.growth_factor(calm) == pytest.approx(1)
    assert waves.growth_factor(stiff) > 1e6


REFUSED = {
    "jitter": ({"positions": {"jitter": 0.5}}, "positions.jitter = 0.5: it must be from 0"),
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
        checks.check(scene("bad", **changes))
    assert "\n" not in str(refusal.value)


def test_a_refused_step_is_reported_the_factor_and_the_largest_that_would_do():
    bad = scene("bad", time_step=0.05, error_interval=0.05, youngs_modulus=10)
    with pytest.raises(ValueError, match="waves grow by") as refusal:
        checks.check(bad)
    step = float(str(refusal.value).split("which a time step of ")[1].split()[0])
    assert waves.growth_factor(bad, step * 0.99) <= 1e6


def test_sound_scenes_pass():
    for changes in ({}, VARIED, {"smoothing_ratio": 10}, {"particle_count": 5}):
        checks.check(scene(**changes))


JITTER = {"positions": {"jitter": 0.3, "seed": 5}}


@pytest.mark.parametrize("changes", [JITTER, VARIED | JITTER, {"smoothing_ratio": 1.7} | JITTER])
def test_fastest_wave_bounds_the_spectrum_of_jittered_particles(changes):
    case = scene(**changes)
    largest = np.linalg.norm(lifted.operator(replace(case, damping=None)).toarray(), 2)
    assert largest <= waves.fastest_wave(case) <= 2 * largest


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
    assert waves.energy_growth(case) == pytest.approx(energy[1] / energy[0], rel=1e-3)


NOT_PREDICTED = {
    "at rest": {"initial_velocity": 0},
    "damped": {"damping": 1},
    "damped in a part": {"damping": "where(x/L < 0.35, 3, 0)"},
    "forced": {"force": "1e-3*sin(t)"},
    "forced from rest": {
        "initial_velocity": 0,
        "force": {"time": "1e-3", "profile": "sin(2*pi*x)"},
    },
    "between the particles": {"initial_velocity": "1e-3*sin(2*pi*20*x/L)"},
    "below rounding": {"initial_velocity": "1e-17*sin(2*pi*x/L)"},
}


@pytest.mark.parametrize("changes", NOT_PREDICTED.values(), ids=NOT_PREDICTED)
def test_energy_is_predicted_only_where_explicit_euler_alone_changes_it(changes, caplog):
    case = scene(**changes, duration=10, time_step=2e-3)
    assert np.isnan(waves.energy_growth(case))
    assert waves.predict(case) == {"wave_growth_bound": waves.growth_factor(case)}
    assert not caplog.records


def test_growth_of_the_energy_is_reported_with_what_avoids_it(caplog):
    case = scene("waves", duration=10, time_step=2e-3)
    predicted = waves.predict(case)
    assert predicted["predicted_energy_growth"] > 1.01
    assert predicted["wave_growth_bound"] == waves.growth_factor(case)
    (record,) = caplog.records
    assert re.fullmatch(
        r"scene waves: time_step = 0.002: .* grow by [\d.]+ % over 10 s, .*leapfrog and .*"
        r" up to ([\d.]+) s",
        record.getMessage(),
    )
    step = float(record.getMessage().split()[-2])
    assert step * waves.fastest_wave(case) <= 2
    caplog.clear()
    waves.predict(scene(duration=10, time_step=1e-5))
    assert not caplog.records


@pytest.mark.parametrize("integrator", ["leapfrog", "symplectic_euler"])
@pytest.mark.parametrize("damping", ["0", "5", "200", "5*(1 + x/L)", "200*(1 + x/L)"])
def test_steps_that_nothing_is_said_of_are_stable(damping, integrator, caplog):
    """And of one that lets a wave grow, something is said."""
    fine = scene(damping=damping, duration=1, initial_velocity="1e-3*where(x < 0.3, 1, 0)")
    waves.warn_of_step(fine, integrator, 100.0)
    (record,) = caplog.records
    limit = float(record.getMessage().split("; up to ")[1].split()[0])
    caplog.clear()
    outcomes = []
    for step in (limit, 1.3 * limit):
        long = {"time_step": step, "error_interval": step, "duration": 4000 * step}
        case = replace(fine, **long)
        with np.errstate(over="ignore", invalid="ignore"):
            velocity, _ = lifted.prepare(case, integrator).run(watch=False).state
        waves.warn_of_step(case, integrator, step)
        outcomes.append((bool(np.abs(velocity[-1]).max() < 0.1), len(caplog.records)))
    assert outcomes == [(True, 0), (False, 1)]


def test_jittered_particles_fill_the_domain():
    case = scene(**JITTER)
    gaps = np.diff(case.positions, append=1.0)
    assert case.positions[0] == 0
    assert gaps.min() > 0.4 * case.spacing
    assert np.ptp(gaps) > 0.4 * case.spacing
    assert case.volumes.sum() == pytest.approx(1)
    np.testing.assert_allclose(case.volumes, (gaps + np.roll(gaps, 1)) / 2)
    assert scene(positions={"jitter": 0}).positions.tolist() == scene().positions.tolist()


def test_what_jitter_loses_is_reported(caplog):
    shares = []
    for count in (40, 80):
        case = scene(
            "jittered", particle_count=count, time_step=1e-5, error_interval=1e-2, **JITTER
        )
        predicted = waves.predict(case)
        (record,) = caplog.records
        assert record.getMessage().startswith(
            "scene jittered: positions.jitter = 0.3: a translation"
        )
        shares.append(predicted["translation_strain"])
        caplog.clear()
    # More particles do not help.
    assert shares[1] > 1.5 * shares[0] > 0.5
    assert waves.translation_strain(scene()) < 1e-12
    assert "translation_strain" not in waves.predict(scene(time_step=1e-5))


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
    checks.check(case)
    assert (case.duration, case.error_interval) == (0.3, 0.01)
    assert case.error_times[-1] == 0.3
    ends = scene(duration=0.1 + 0.2, force="where(t == T, 1, 0)")
    assert ends.force_values(ends.error_times)[0].tolist() == [[0] * 30 + [1]]


def test_a_force_is_taken_at_the_decimal_times_of_steps():
    """In the step from 0.3 s on; 3 Δt in double precision is above 0.3."""
    kicked = scene(duration=1, time_step=0.1, error_interval=0.1, youngs_modulus=1e-6,
                   initial_velocity=0, force="where(t == 0.3, 1, 0)")  # fmt: skip
    velocity = sph.solve(kicked, kicked.error_steps)["velocity"]
    np.testing.assert_allclose(velocity[:, 0], [0] * 4 + [0.1] * 7, atol=1e-9)
    reduced = rom.ReducedModel(kicked, "original", np.ones((1, 40)) / 40**0.5,
                               np.ones((1, 40)) / 40**0.5)  # fmt: skip
    coordinates, _ = reduced.prepare(kicked.error_steps).run().state
    np.testing.assert_allclose(coordinates[:, 0], velocity[:, 0] * 40**0.5)
    strained = lifted.solve(kicked, "explicit_euler")["velocity"]
    np.testing.assert_allclose(strained, velocity, atol=1e-9)
