"""Bars with ends: symmetries, standing waves, refusals."""

import pickle

import numpy as np
import pytest
import scenes

from sphpod.config.config import ConfigError
from sphpod.config.configured import make_scene
from sphpod.full import lifted, sph
from sphpod.reduced import lifted_rom, rom, snapshots
from sphpod.reduced.pod import decompose
from sphpod.reference import chain, exact, reference
from sphpod.scene import resolution
from sphpod.scene.breakdown import Breakdown
from sphpod.scene.ends import KINDS, MATERIAL, STRAIN, VELOCITY, Ends
from sphpod.scene.kernel import stencil_weights
from sphpod.scene.run import Run

PAIRS = [[left, right] for left in KINDS for right in KINDS]

WAVES = {
    "fixed fixed": "sin(2*pi*x)",
    "free free": "cos(2*pi*x)",
    "fixed free": "sin(3*pi*x/2)",
    "free fixed": "cos(3*pi*x/2)",
}
"""A standing wave of a bar of length 1, of each pair of ends."""

WAVE_NUMBERS = {"fixed fixed": 2, "free free": 2, "fixed free": 1.5, "free fixed": 1.5}
"""Its wave number, of pi/m."""

VARIED = {
    "initial_density": "1 + 0.3*cos(pi*x)",
    "youngs_modulus": "0.1 + 0.05*cos(2*pi*x)",
    "damping": "1 + cos(pi*x)",
}
"""Material that is even about both ends of a bar of length 1 as it stands."""

FULL = {
    "sph": lambda scene: sph.solve(scene, scene.error_steps),
    "sph_lists": lambda scene: sph.solve(scene, scene.error_steps, "lists"),
    "leapfrog": lambda scene: lifted.solve(scene, "leapfrog"),
    "exact_in_time": lambda scene: lifted.solve(scene, "exact"),
    "centred": reference.solve_centred,
    "fd": reference.solve_paper,
    "chain": chain.solve,
}


def bar(boundary, **changes):
    """A bar of length 1 with a standing wave, of 41 particles."""
    wave = WAVES[" ".join(boundary)]
    usual = {"boundary": boundary, "particle_count": 41, "initial_velocity": f"1e-3*{wave}"}
    return scenes.scene(**usual | changes)


def line(boundary, **changes):
    """What it is a part of, as a scene without ends: its formulas have the symmetry themselves."""
    copies = 2 if boundary[0] == boundary[1] else 4
    wave = WAVES[" ".join(boundary)]
    usual = {
        "domain_length": copies,
        "particle_count": 40 * copies,
        "initial_velocity": f"1e-3*{wave}",
    }
    return scenes.scene(**usual | changes)


def differ(one, other):
    """Largest difference of two solutions, of the largest value of each field."""
    fields = [name for name in ("velocity", "strain") if name in one]
    found = [np.abs(one[name] - other[name]).max() / np.abs(other[name]).max() for name in fields]
    if "density" in one:
        changes = [fields["density"] - fields["density"][0] for fields in (one, other)]
        found.append(np.abs(changes[0] - changes[1]).max() / np.abs(changes[1]).max())
    return max(found)


def asymmetry(scene, fields, odd):
    """Largest difference of a field from what its values in the bar make of it, of the largest."""
    sources, signs = scene.ends.images(scene.particle_count, odd)
    return np.abs(fields[..., sources] * signs - fields).max() / np.abs(fields).max()


# --- The bar and its images -----------------------------------------------------------------------


@pytest.mark.parametrize("boundary", PAIRS)
@pytest.mark.parametrize("odd", [VELOCITY, STRAIN, MATERIAL])
def test_signs_turn_about_each_end_of_the_kind(boundary, odd):
    ends = Ends(boundary[0], boundary[1], 1.0)
    for place, end in enumerate(boundary):
        x = np.array([0.1, 0.25, 0.4])
        there, back = (
            signs * np.cos(places)
            for places, signs in (
                ends.folded((place + way * x) % ends.copies, 0.05, odd) for way in (1, -1)
            )
        )
        np.testing.assert_allclose(there, -back if end == odd else back)


@pytest.mark.parametrize("boundary", PAIRS)
def test_images_of_particles_are_at_the_very_places(boundary):
    scene = bar(boundary, domain_length=0.7, particle_count=38)
    for odd in (VELOCITY, STRAIN, MATERIAL):
        places, signs = scene.ends.folded(scene.positions, scene.spacing, odd)
        sources, same = scene.ends.images(scene.particle_count, odd)
        assert np.array_equal(places, scene.positions[sources])
        assert np.array_equal(signs, same)


def test_a_jump_at_a_particle_is_the_same_at_its_image():
    scene = bar(
        ["fixed", "fixed"],
        domain_length=0.3,
        particle_count=8,
        initial_velocity=0,
        youngs_modulus=f"where(x < {3 * (0.3 / 7)!r}, 1, 2)",
    )
    assert asymmetry(scene, scene.modulus(), MATERIAL) == 0
    assert scene.modulus()[:8].tolist() == [1, 1, 1, 2, 2, 2, 2, 2]


@pytest.mark.parametrize("boundary", PAIRS)
def test_a_mirrored_expression_survives_pickling_and_rewriting(boundary):
    scene = bar(boundary)
    x = np.linspace(0, scene.domain_length, 17)
    values = scene.initial_velocity(x=x)
    assert np.array_equal(pickle.loads(pickle.dumps(scene.initial_velocity))(x=x), values)
    twice = scene.initial_velocity.rewritten(f"2*({scene.initial_velocity.text})")
    np.testing.assert_allclose(twice(x=x), 2 * values)


@pytest.mark.parametrize("boundary", PAIRS)
def test_the_bar_is_the_first_of_the_line(boundary):
    scene = bar(boundary)
    assert scene.bar_count == 41
    assert scene.bar_length == 1
    np.testing.assert_allclose(scene.positions[:41], np.linspace(0, 1, 41), atol=1e-15)
    assert scene.line_count(41) == scene.particle_count
    walls = scene.velocity0()[[0, 40]] == 0
    assert walls.tolist() == [end == "fixed" for end in boundary]


def test_what_pushes_all_of_a_bar_alike_does_not_push_its_fixed_ends():
    scene = bar(["fixed", "free"], force="1e-3*cos(t)")
    _, (profile,) = scene.force_values(np.zeros(1))
    assert profile[:41].tolist() == [0.0] + [1.0] * 40
    assert asymmetry(scene, profile, VELOCITY) == 0
    full = sph.solve(scene, scene.error_steps)
    assert not full["velocity"][:, 0].any()
    assert full["velocity"][-1, 40] > 0


@pytest.mark.parametrize("boundary", PAIRS)
def test_what_is_fixed_is_not_translated(boundary):
    assert bar(boundary, force="1e-3*cos(t)").translates == (boundary == ["free", "free"])


# --- Models of a bar are those of the line --------------------------------------------------------


@pytest.mark.parametrize("model", FULL)
@pytest.mark.parametrize("boundary", PAIRS)
def test_it_is_a_part_of_the_line_to_rounding(boundary, model):
    if model.startswith("sph") and "free" in boundary:
        pytest.skip("a step in density breaks the symmetry on the line")
    wave = WAVES[" ".join(boundary)]
    changes = VARIED | {"force": {"time": "1e-3*cos(20*t)", "profile": wave}}
    solutions = FULL[model](bar(boundary, **changes)), FULL[model](line(boundary, **changes))
    assert differ(*solutions) < 1e-11


IN_TIME = {
    "products": {
        "youngs_modulus": "0.1*(1 + 0.2*cos(2*pi*x)*sin(3*t))",
        "damping": "1 + cos(2*pi*x)*cos(t)",
        "force": ["1e-3*{wave}*cos(20*t)", {"time": "1e-3*t", "profile": "{wave}"}],
    },
    "interpolated": {
        "youngs_modulus": "0.1*(1 + 0.2*sqrt(2 + cos(2*pi*x)*sin(3*t)))",
        "damping": "1/(2 + cos(2*pi*x)*cos(t))",
        "force": "1e-3*{wave}*sqrt(2 + cos(2*pi*x)*sin(5*t))",
    },
    "followed everywhere": {
        "youngs_modulus": "where(cos(2*pi*x) > cos(3*t), 0.1, 0.15)",
        "force": "1e-3*{wave}*where(cos(2*pi*x) > sin(5*t), 1, 2)",
    },
}
"""Material and forces that change with time and are even, or as {wave}, about both ends."""


def in_time(kind, boundary):
    def of(value):
        if isinstance(value, str):
            return value.format(wave=WAVES[" ".join(boundary)])
        if isinstance(value, list):
            return [of(one) for one in value]
        return {key: of(one) for key, one in value.items()}

    return of(IN_TIME[kind])


@pytest.mark.slow
@pytest.mark.parametrize("kind", IN_TIME)
@pytest.mark.parametrize("model", ["sph", "leapfrog", "centred", "chain"])
@pytest.mark.parametrize("boundary", [["fixed", "fixed"], ["fixed", "free"]])
def test_what_changes_with_time_is_that_of_the_line(boundary, model, kind):
    if model == "sph" and "free" in boundary:
        pytest.skip("a step in density breaks the symmetry on the line")
    if (model, kind) == ("centred", "followed everywhere"):
        pytest.skip("between particles a front is known to first order, by the places looked at")
    # Of places that a front crosses at an instant, rounding may say on which side of it they are.
    changes = {**in_time(kind, boundary), "particle_count": 40, "error_interval": 0.1}
    copies = 2 if boundary[0] == boundary[1] else 4
    scene = bar(boundary, **changes)
    whole = line(boundary, **changes | {"particle_count": 39 * copies})
    # Where a profile is steep differs between interpolations of the compliance of bar and line.
    allowed = 1e-4 if model == "centred" else 1e-9
    assert differ(FULL[model](scene), FULL[model](whole)) < allowed


@pytest.mark.parametrize("boundary", PAIRS)
def test_full_sph_keeps_the_symmetry_of_a_modulus_that_changes(boundary):
    scene = bar(boundary, **in_time("products", boundary))
    full = sph.solve(scene, scene.error_steps)
    assert asymmetry(scene, full["velocity"], VELOCITY) < 1e-12
    assert asymmetry(scene, lifted.strain(scene, full["density"]), STRAIN) < 1e-12


@pytest.mark.parametrize("boundary", PAIRS)
def test_the_chain_of_a_bar_is_masses_and_springs_between_its_ends(boundary):
    """Without images: half a mass at each end, which stays where it is if the end is fixed."""
    changes = {"initial_density": "1 + x", "youngs_modulus": "0.1 + x**2", "duration": 2}
    scene = bar(boundary, time_step=0.002, **changes)
    found = chain.solve(scene)
    x, spacing = scene.positions[:41], scene.spacing
    masses = scene.density0()[:41] * spacing
    masses[[0, -1]] /= 2
    masses[[place for place, end in ((0, boundary[0]), (-1, boundary[1])) if end == "fixed"]] = (
        np.inf
    )
    stiffness = (0.1 + ((x[1:] + x[:-1]) / 2) ** 2) / spacing
    velocity, displacement = scene.velocity0()[:41], np.zeros(41)

    def pulled():
        tension = np.concatenate([[0], stiffness * np.diff(displacement), [0]])
        return scene.time_step / 2 * np.diff(tension) / masses

    for step in range(scene.step_count):
        velocity = velocity + pulled()
        displacement = displacement + scene.time_step * velocity
        velocity = velocity + pulled()
        if (step + 1) % scene.error_stride == 0:
            row = (step + 1) // scene.error_stride
            assert np.abs(found["velocity"][row, :41] - velocity).max() < 1e-12 * 1e-3


@pytest.mark.parametrize("boundary", PAIRS)
def test_exact_solutions_are_those_of_the_line(boundary):
    for changes in ({}, {"damping": 0.3}, {"force": {"time": "t", "profile": "cos(2*pi*x)"}}):
        if changes.get("force") and "fixed" in boundary:
            continue
        assert exact.kind(bar(boundary, **changes)) == exact.kind(line(boundary, **changes))
        solutions = (exact.solve(of(boundary, **changes)) for of in (bar, line))
        assert differ(*solutions) < 1e-11


@pytest.mark.parametrize("method", ["original", "linearized", "frozen3", "lifted_exact"])
def test_reduced_models_of_fixed_ends_are_those_of_the_line(method):
    # With a damping that varies translation would take part in the line's model, not in the bar's.
    wave = "1e-3*(sin(pi*x) + sin(3*pi*x))"
    changes = {**VARIED, "damping": 0.5, "initial_velocity": wave}
    fields = []
    for of in (bar, line):
        scene = of(["fixed", "fixed"], **changes)
        sampling = {"range": [0, 1], "count": 4}
        taken = snapshots.extract(scene, sampling, sph.solve(scene, scene.error_steps))
        run: Run
        if method == "lifted_exact":
            model = lifted_rom.build(scene, lifted_rom.decompose(scene, taken), 4)
            run = model.prepare(method)
        else:
            run = rom.model(scene, method, decompose(taken), 4).prepare(scene.error_steps)
        fields.append(run.solve().fields()["velocity"])
    assert np.abs(fields[0] - fields[1]).max() < 1e-9 * np.abs(fields[1]).max()


@pytest.mark.parametrize("boundary", PAIRS)
@pytest.mark.parametrize("neighbours", ["stencil", "lists"])
def test_full_sph_keeps_the_symmetry_of_large_strains(boundary, neighbours):
    wave = WAVES[" ".join(boundary)]
    scene = bar(boundary, initial_velocity=f"2e-2*{wave}", **VARIED)
    full = sph.solve(scene, scene.error_steps, neighbours)
    strain = lifted.strain(scene, full["density"])
    assert np.abs(strain).max() > 0.05
    assert asymmetry(scene, full["velocity"], VELOCITY) < 1e-12
    assert asymmetry(scene, strain, STRAIN) < 1e-12
    walls = [place for place, end in ((0, boundary[0]), (40, boundary[1])) if end == "free"]
    assert np.abs(strain[:, walls]).max(initial=0) < 1e-14


@pytest.mark.parametrize("boundary", [pair for pair in PAIRS if "free" in pair])
def test_full_sph_of_free_ends_comes_to_the_lifted_model_with_the_step(boundary):
    """Explicit Euler in density and in strain differ by the step times the square of the strain."""
    wave = WAVES[" ".join(boundary)]
    errors = []
    for step in (1e-3, 5e-4):
        scene = bar(boundary, initial_velocity=f"2e-2*{wave}", time_step=step)
        euler = lifted.solve(scene, "explicit_euler")
        full = sph.solve(scene, scene.error_steps)
        errors.append(np.abs(full["velocity"] - euler["velocity"]).max())
    assert 1.8 < errors[0] / errors[1] < 2.2


def test_a_breakdown_is_at_a_particle_of_the_bar():
    scene = bar(["free", "free"], initial_velocity="2*cos(pi*x)", youngs_modulus=1e-3)
    with pytest.raises(Breakdown) as broken:
        sph.solve(scene, scene.error_steps)
    assert 0 <= broken.value.particle <= 40


# --- Standing waves -------------------------------------------------------------------------------


def standing(boundary, frequency, scene):
    """Velocity of the standing wave at a frequency [1/s], at all times and places of the bar."""
    shape = np.cos(frequency * scene.error_times)
    return shape[:, None] * scene.velocity0()[: scene.bar_count]


@pytest.mark.parametrize("boundary", PAIRS)
def test_waves_stand_at_the_frequency_of_sph(boundary):
    scene = bar(boundary, duration=10)
    weights = stencil_weights(scene.spacing, scene.smoothing_ratio)
    number = np.pi * WAVE_NUMBERS[" ".join(boundary)]
    each = np.arange(1, weights.size + 1) * number * scene.spacing
    frequency = np.sqrt(0.1) * abs(2 * weights @ np.sin(each))
    full = lifted.solve(scene, "exact")
    expected = standing(boundary, frequency, scene)
    assert np.abs(full["velocity"][:, :41] - expected).max() < 1e-10 * 1e-3
    taken = {f"{name}_snapshots": full[name][:100:25] for name in ("velocity", "strain")}
    model = lifted_rom.build(scene, lifted_rom.decompose(scene, taken), 1 + scene.translates)
    velocity = model.prepare("lifted_exact").solve().fields()["velocity"]
    assert np.abs(velocity[:, :41] - expected).max() < 1e-10 * 1e-3


@pytest.mark.parametrize("boundary", PAIRS)
@pytest.mark.parametrize("model", ["exact_in_time", "chain", "centred"])
def test_waves_come_to_those_of_the_continuum_at_second_order(boundary, model):
    """With a smoothing ratio of one, whose derivative coefficient is one."""
    errors = []
    for intervals in (20, 40, 80):
        scene = bar(
            boundary,
            particle_count=intervals + 1,
            time_step=0.04 / intervals,
            smoothing_ratio=1,
            duration=2,
            error_interval=0.1,
        )
        number = np.pi * WAVE_NUMBERS[" ".join(boundary)]
        expected = standing(boundary, np.sqrt(0.1) * number, scene)
        velocity = FULL[model](scene)["velocity"][:, : scene.bar_count]
        errors.append(np.linalg.norm(velocity - expected) / np.linalg.norm(expected))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (np.abs(orders - 2) < 0.15).all(), (errors, orders)


@pytest.mark.parametrize("boundary", PAIRS)
def test_the_exact_solution_is_the_standing_wave(boundary):
    scene = bar(boundary, duration=2)
    frequency = np.sqrt(0.1) * np.pi * WAVE_NUMBERS[" ".join(boundary)]
    expected = standing(boundary, frequency, scene)
    found = exact.solve(scene)["velocity"][:, :41]
    assert np.abs(found - expected).max() < 1e-12 * 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("boundary", [["fixed", "fixed"], ["fixed", "free"]])
@pytest.mark.parametrize("damping", [0, 0.2])
def test_a_bar_that_is_pushed_all_alike_moves_as_its_modes_do(boundary, damping):
    """Each mode sin(kx) is an oscillator that its share of the force drives."""
    scene = bar(
        boundary, initial_velocity=0, damping=damping, force="1e-3*sin(2*t)", duration=4,
        error_interval=0.5, particle_count=101,
    )  # fmt: skip
    halves = 2 * np.arange(10_000) + 1
    number = np.pi * (halves if boundary[1] == "fixed" else halves / 2)
    share = (4 if boundary[1] == "fixed" else 2) / number
    # y'' + d y' + ω² y = A sin(2t) from rest: what the force keeps up, and two decaying terms.
    steady = 1e-3 / (0.1 * number**2 - 4 + 2j * damping)
    root = np.sqrt(damping**2 / 4 - 0.1 * number**2 + 0j)
    rates = np.stack([-damping / 2 + root, -damping / 2 - root])
    first = (-(2j * steady).imag + rates[1] * steady.imag) / (rates[0] - rates[1])
    parts = np.stack([first, -steady.imag - first])
    expected = []
    for t in scene.error_times:
        velocity = (2j * steady * np.exp(2j * t)).imag
        velocity = velocity + (rates * parts * np.exp(rates * t)).sum(axis=0).real
        expected.append(share * velocity @ np.sin(np.outer(number, scene.positions[:101])))
    for solve, allowed in ((exact.solve, 1e-6), (reference.solve_centred, 1e-3)):
        found = solve(scene)["velocity"][:, :101]
        assert np.abs(found - expected).max() < allowed * np.abs(expected).max()


def test_layers_of_a_bar_are_those_within_it():
    scene = bar(["fixed", "fixed"], youngs_modulus="where(x < 0.3, 0.1, 0.2)")
    (start, first), (jump, second) = exact.layers(scene)
    assert (start, first, second) == (0, "c = 0.1 Pa", "c = 0.2 Pa")
    assert jump == pytest.approx(0.3, abs=1e-9)


def test_a_jump_of_v0_and_the_particles_it_takes_are_told_of_the_bar(caplog):
    scene = bar(["free", "free"], initial_velocity="where(x < 0.3, 1e-3, 0)")
    found = resolution.predict(scene)
    assert found["velocity_jump"] == pytest.approx(-1e-3)
    assert "at x = 0.3 m:" in caplog.text
    resolution.predict(bar(["free", "free"], initial_velocity="1e-3*cos(45*pi*x)"))
    assert "which 41 particles take for others: at least 47 particles are needed" in caplog.text


# --- Refusals -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            {"boundary": "fixed"},
            "boundary = fixed: it must be periodic, or a list of the ends of a bar",
        ),
        ({"boundary": ["fixed"]}, "boundary = [fixed]: it must have at least 2 entries"),
        ({"boundary": ["fixed", "open"]}, "boundary.1 = open: allowed are fixed, free"),
        (
            {"boundary": ["free", "fixed"]},
            "initial_velocity = 1e-3*cos(2*pi*x): it is 0.001 at x = 1, an end that is fixed "
            "(boundary = [free, fixed]); it must be 0 there",
        ),
        (
            {"boundary": ["free", "free"], "positions": {"jitter": 0.2}},
            "boundary = [free, free]: a bar with ends has evenly spaced particles only",
        ),
    ],
)
def test_it_is_refused_in_a_sentence(changes, said):
    with pytest.raises(ConfigError) as refused:
        make_scene("test", **scenes.settings(initial_velocity="1e-3*cos(2*pi*x)", **changes))
    assert said in str(refused.value)


def test_periodic_may_be_said():
    assert make_scene("test", **scenes.settings(boundary="periodic")).ends is None


@pytest.mark.parametrize("method", ["original", "linearized", "frozen3"])
def test_models_in_density_refuse_free_ends(method):
    modes = {f"{field}_modes": np.eye(1, 160) for field in ("velocity", "density")}
    with pytest.raises(ValueError, match=r"boundary = \[fixed, free\]: .* allowed are fixed ends"):
        rom.model(bar(["fixed", "free"]), method, modes, 1)


CHANGING = {
    "youngs_modulus": "0.1*(1 + 0.2*sin(4*t)*cos(pi*x/L))",
    "damping": "where(t < 0.2, 0, 1)*x",
    "force": ["1e-3*x*(L - x)*exp(-((x - t/3 - L/3)/0.2)**2)", "1e-4*sin(3*t)"],
}


@pytest.mark.parametrize("boundary", PAIRS)
def test_what_changes_with_time_is_mirrored_too(boundary):
    """The line keeps the symmetry of its images, to rounding, in every model."""
    scene = bar(boundary, **CHANGING)
    exact, full = lifted.solve(scene, "exact"), sph.solve(scene, scene.error_steps)
    for fields in (
        exact["velocity"],
        full["velocity"],
        lifted.solve(scene, "leapfrog")["velocity"],
    ):
        assert asymmetry(scene, fields[-1], VELOCITY) <= 1e-12 * np.abs(fields).max()
    assert asymmetry(scene, exact["strain"][-1], STRAIN) <= 1e-12 * np.abs(exact["strain"]).max()
    _, profiles = scene.force_values(np.zeros(1))
    assert max(asymmetry(scene, profile, VELOCITY) for profile in profiles) == 0
