"""Run time against error, how costs grow, and what skipping saves."""

from collections.abc import Iterable

import numpy as np
import pytest
from scenes import VARIED, scene

from sphpod.full import lifted, sph
from sphpod.numerics import error, timing
from sphpod.numerics.propagator import Jumps
from sphpod.reduced import certificate, lifted_rom, pod, rom, snapshots
from sphpod.reference import exact, reference
from sphpod.scene.run import Run
from sphpod.studies import benchmark, scaling, skipping
from sphpod.studies.cpu_time import BASELINES

PLACE = {"scene": "waves", "sampling": "few"}
SETTINGS = {"particle_count": 40, "machine": {"processor": "one"}}
SAMPLING = {"range": [0, 1], "count": 9}
STUDY = {"mode_counts": [3], "n_freeze": [1, 10]}
COUNTS = [3, 4, 8]
"""Of the study and the benchmark's own, as far as nine snapshots give them."""

PAPER = ["original", "linearized", "frozen1", "frozen10"]
SPEEDUPS = [f"speedup_against_{name}" for name in (*BASELINES, "fastest_explicit_euler",
            "fastest_full_model")]  # fmt: skip
EULER, FULL = SPEEDUPS[2:]


class Case:
    """A scene, its solutions, and what the benchmark measures of it."""

    def __init__(self, **changes):
        self.scene = scene(**changes)
        steps = snapshots.output_steps(self.scene, [SAMPLING])
        solved = sph.solve(self.scene, steps)
        self.taken = snapshots.extract(self.scene, SAMPLING, solved)
        at_errors = np.isin(steps, self.scene.error_steps)
        self.full = {field: solved[field][at_errors] for field in error.FIELDS}
        self.reference = (
            exact.solve(self.scene)
            if exact.kind(self.scene)
            else reference.solve_centred(self.scene, estimate_error=False)
        )
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(benchmark, "SHORTEST", 1e-4)
            self.measured = benchmark.compare(
                self.scene, SAMPLING, STUDY, self.taken, self.full, repeats=3
            )
        self.table = benchmark.rows(PLACE, self.measured, SETTINGS)

    def rows(self, method, **columns):
        chosen = self.table["method"] == method
        for name, value in columns.items():
            chosen &= self.table[name] == value
        return np.flatnonzero(chosen)


@pytest.fixture(scope="module", params=[{}, VARIED], ids=["plain", "varied"])
def case(request):
    return Case(**request.param)


def test_every_contender_is_there(case):
    table, own = case.table, case.scene
    sizes = {len(values) for values in table.values() if np.ndim(values)}
    assert sizes == {len(table["method"])}
    reduced = table["modes"] > 0
    places = list(zip(table["method"][reduced], table["modes"][reduced], strict=True))
    methods = [*PAPER, *lifted_rom.METHODS]
    assert places == [(method, count) for method in methods for count in COUNTS]
    for method in set(table["method"][~reduced]):
        assert method.startswith(("sph_", "lifted_full_"))
    assert set(table["integrator"][~reduced]) == set(lifted.INTEGRATORS)
    assert [int(n) for n in table["n_freeze"][reduced]] == [
        n for n in (0, 0, 1, 10, 0, 0) for _ in COUNTS
    ]
    # The scene as it is, and other time steps and spacings.
    for method in ("sph_stencil", "lifted_full_stencil"):
        steps = {float(table["time_step"][n]) for n in case.rows(method, particle_count=40)}
        assert {own.time_step, own.time_step / 2, own.time_step / 4} <= steps
        assert {10, 20, 80} <= set(table["particle_count"][case.rows(method)].tolist())
    for integrator, tolerances in benchmark.TOLERANCES.items():
        rows = case.rows("lifted_full_stencil", integrator=integrator)
        np.testing.assert_array_equal(table["tolerance"][rows], tolerances)
        assert np.isnan(table["time_step"][rows]).all()
    assert np.isfinite(table["tolerance"]).sum() == 6
    fields = zip(table["method"], table["integrator"], table["particle_count"], table["time_step"],
                 table["modes"], table["tolerance"], strict=True)  # fmt: skip
    assert len({str(place) for place in fields}) == len(table["method"])


def test_errors_of_full_models_are_their_own(case):
    own, table = case.scene, case.table
    solutions = {
        ("sph_neighbour_lists", "explicit_euler"): case.full,
        ("sph_stencil", "explicit_euler"): case.full,
    }
    for integrator in lifted.INTEGRATORS:
        tolerance = benchmark.TOLERANCES.get(integrator, [1e-8])[0]
        found = lifted.solve(own, integrator, tolerance=tolerance)
        found["density"] = lifted.density(own, found["strain"])
        kind = "exact" if integrator == "exact" else "stencil"
        solutions[f"lifted_full_{kind}", integrator] = found
    for (method, integrator), found in solutions.items():
        rows = case.rows(method, integrator=integrator, particle_count=own.particle_count)
        if integrator in lifted.FIXED_STEP:
            rows = rows[table["time_step"][rows] == own.time_step]
        for field in error.FIELDS:
            for name, against in (("", case.full), ("_exact", case.reference)):
                value = error.relative_error(found[field], against[field])
                stored = table[f"error_{field}{name}"][rows[0]]
                assert stored == pytest.approx(value, rel=1e-6, abs=1e-12)
    # Nothing is compared with full SPH of other particles.
    others = table["particle_count"] != own.particle_count
    assert np.isnan(table["error_velocity"][others]).all()
    assert np.isfinite(table["error_velocity"][~others]).all()
    assert np.isfinite(table["error_velocity_exact"]).all()
    assert np.isfinite(table["error_density_exact"]).all()


def test_errors_of_reduced_models_are_those_of_the_sweeps(case):
    modes, energy_modes = pod.decompose(case.taken), lifted_rom.decompose(case.scene, case.taken)
    sweeps = {
        method: rom.sweep(case.scene, method, COUNTS, modes, case.full, case.reference)
        for method in PAPER
    }
    sweeps["lifted_euler"] = lifted_rom.repeat_sph(
        case.scene, COUNTS, energy_modes, case.full, case.reference
    )
    sweeps["lifted_exact"] = certificate.certify(
        case.scene, COUNTS, energy_modes, lifted.solve(case.scene, "exact"), case.reference
    )
    for method, sweep in sweeps.items():
        rows = case.rows(method)
        for field in error.FIELDS:
            for name, against in (("", "sph"), ("_exact", "reference")):
                if (expected := sweep.get(f"{field}_error_{against}")) is not None:
                    found = case.table[f"error_{field}{name}"][rows]
                    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-12)


def test_times_and_speedups_are_what_they_say(case):
    table, measured = case.table, case.measured
    seconds = np.median(measured["cpu_seconds"], axis=1)
    np.testing.assert_array_equal(table["cpu_seconds"], seconds)
    assert np.all(seconds > 0)
    assert table["repeats"] == measured["cpu_seconds"].shape[1] == 3
    assert np.all(table["cpu_seconds_with_fields"] >= seconds.min())
    for name, baseline in zip(SPEEDUPS[:2], BASELINES, strict=True):
        np.testing.assert_allclose(table[name] * seconds, seconds[case.rows(baseline)[0]])
    for name in SPEEDUPS:
        assert np.any(table[name] == 1)
    # What costs nothing online may cost offline: reduced models take snapshots, modes, projection.
    offline = [table[f"offline_{part}_seconds"] for part in ("snapshots", "modes", "projection")]
    reduced = table["modes"] > 0
    assert np.all(np.array(offline)[:, ~reduced] == 0)
    assert np.all(np.array(offline[:2])[:, reduced] > 0)


def test_baselines_are_fast_and_accurate(case):
    table = case.table
    first = case.rows("sph_stencil")[0]
    # The fastest at the scene's own particles and time step, in density or strain.
    own = (
        (table["modes"] == 0)
        & (table["integrator"] == "explicit_euler")
        & (table["particle_count"] == case.scene.particle_count)
        & (table["time_step"] == case.scene.time_step)
    )
    assert set(table["method"][own]) == {
        "sph_neighbour_lists",
        "sph_stencil",
        "lifted_full_stencil",
    }
    assert table["cpu_seconds"][own].min() == pytest.approx(
        (table[EULER] * table["cpu_seconds"])[0]
    )
    # The fastest of all that are as accurate as full SPH.
    accurate = table["modes"] == 0
    for field in error.FIELDS:
        errors = table[f"error_{field}_exact"]
        accurate &= errors <= 1.001 * errors[first]
    assert accurate[first]
    baseline = (table[FULL] * table["cpu_seconds"])[0]
    assert table["cpu_seconds"][accurate].min() == pytest.approx(baseline)
    assert baseline <= table["cpu_seconds"][first]


def test_baselines_are_chosen_from_a_table():
    rows = [
        # method, integrator, N, step, modes, v error, density error, seconds
        ("sph_neighbour_lists", "explicit_euler", 40, 1e-3, 0, 0.1, 0.01, 8.0),
        ("sph_stencil", "explicit_euler", 40, 1e-3, 0, 0.1, 0.01, 4.0),
        ("lifted_full_stencil", "explicit_euler", 40, 1e-3, 0, 0.1, 0.01, 2.0),
        ("lifted_full_stencil", "explicit_euler", 40, 2e-3, 0, 0.2, 0.02, 1.0),  # not accurate
        ("lifted_full_stencil", "leapfrog", 20, 2e-3, 0, 0.05, 0.02, 0.2),  # in one field alone
        ("lifted_full_stencil", "leapfrog", 40, 1e-2, 0, 0.09, 0.009, 0.5),
        ("lifted_exact", "exact", 40, np.nan, 4, 0.01, 0.001, 0.1),  # no full model
    ]
    method, integrator, count, step, modes, velocity, density, seconds = zip(*rows, strict=True)
    measured = {
        "contender": np.array(method),
        "integrator": np.array(integrator),
        "contender_particle_count": np.array(count),
        "contender_time_step": np.array(step),
        "contender_mode_count": np.array(modes),
        "contender_modes_resolved": np.array(modes) == 0,
        "contender_tolerance": np.full(7, np.nan),
        "n_freeze": np.zeros(7, int),
        "velocity_error_exact": np.array(velocity),
        "density_error_exact": np.array(density),
        "velocity_error_full": np.array(velocity),
        "density_error_full": np.array(density),
        "cpu_seconds": np.outer(seconds, [0.5, 1, 1, 3]),
        "reconstruction_seconds": np.outer(seconds, [1, 1, 1, 1]),
        "offline_seconds": np.arange(21.0).reshape(7, 3),
    }
    table = benchmark.rows(PLACE, measured, SETTINGS)
    np.testing.assert_allclose(table["cpu_seconds"], seconds)
    np.testing.assert_allclose(table["cpu_seconds_with_fields"], 2 * np.array(seconds))
    np.testing.assert_allclose(table["cpu_seconds_interquartile_range"], 0.625 * np.array(seconds))
    found = [table[name][-1] for name in SPEEDUPS]
    np.testing.assert_allclose(found, [80, 40, 20, 5])
    np.testing.assert_allclose(table["offline_projection_seconds"], np.arange(2.0, 21, 3))


# --- What skipping saves --------------------------------------------------------------------------


def results_of_pairs(case):
    """What each side of each pair fills or gives, whichever model it is of."""
    for pair in skipping._pairs(case):
        sides = []
        for timed in (pair.without, pair.general):
            found = timed()
            fields: Iterable[np.ndarray]
            if isinstance(found, Run):
                fields = found.state
            elif isinstance(found, tuple):
                fields = found[0].stiffness, found[0].force, found[0].start
            else:
                fields = [found[field] for field in error.FIELDS]
            sides.append([field.copy() for field in fields])
        yield pair.skipped, pair.model, *sides


def test_both_sides_of_a_pair_compute_the_same():
    case = scene()
    # The numerical reference is timed with fewer particles.
    coarse = scene(particle_count=case.particle_count // 4)
    estimate = reference.solve_centred(coarse, estimate_error=True)
    places = []
    for skipped, model, without, general in results_of_pairs(case):
        places.append((skipped, model))
        assert len(without) == len(general) > 0
        if skipped == "nonlinearity":
            # Velocity and strain beside velocity and density; Euler steps in these differ by e².
            without[1] = lifted.density(case, without[1])
            tolerance = np.array([3e-4, 3e-6])
        elif skipped == "ends":
            # What is odd about a free end is the strain, of which the density is but for e².
            tolerance = np.array([1e-6, 1e-6])
        elif skipped == "outputs nobody asked for":
            general = [field[[0, -1]] for field in general]
            tolerance = np.zeros(2)
        elif skipped == "numerical reference":
            tolerance = np.array([1.5 * estimate[f"{f}_error_estimate"] for f in error.FIELDS])
            assert tolerance.max() < 2e-2
        else:
            tolerance = np.full(len(without), 1e-11)
        for first, second, most in zip(without, general, tolerance, strict=True):
            assert np.any(first)
            assert error.relative_error(first, second) <= most, skipped
    assert len(set(places)) == len(places)
    assert {skipped for skipped, _ in places} == {
        "force", "damping", "varying modulus", "nonlinearity", "neighbour search",
        "outputs nobody asked for", "numerical reference", "modulus in time", "ends", "a survey",
        "operators of a force that is scaled",
    }  # fmt: skip


@pytest.mark.slow
def test_pairs_are_timed_and_in_a_table():
    measured = skipping.measure(scene(duration=0.1), repeats=2)
    things = len(measured["skipped"])
    assert len(measured["skipping_model"]) == things
    for name in ("skipping_seconds", "general_seconds"):
        assert measured[name].shape == (things, 2 * skipping.TURNS)
        assert np.all(measured[name] > 0)
    table = skipping.rows(
        PLACE,
        {
            "skipped": np.array(["force"]),
            "skipping_model": np.array(["full SPH"]),
            "skipping_seconds": np.array([[1.0, 2.0, 5.0]]),
            "general_seconds": np.array([[4.0, 6.0, 6.0]]),
        },
        SETTINGS,
    )
    assert table["general_over_skipping"] == [3]
    assert table["skipping_seconds_interquartile_range"] == [2]
    assert table["general_seconds_interquartile_range"] == [1]
    assert table["model"] == ["full SPH"]


# --- How costs grow -------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def grown():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scaling, "WORK", 2e4)
        patch.setattr(scaling, "JUMPS", 500)
        # The first measurement holds what is made only once in a process.
        scaling.measure(scene(), [40], [2], 1)
        return scaling.measure(scene(), [40, 160], [2, 4, scaling.MODE_COUNT], 2)


def test_every_size_is_measured(grown):
    names = "contender", "contender_particle_count", "contender_mode_count"
    places = list(zip(*(grown[name].tolist() for name in names), strict=True))
    full = [(name, count, 0) for count in (40, 160) for name in scaling.CONTENDERS]
    reduced = [(name, count, 12) for count in (40, 160) for name in scaling.REDUCED]
    # k = 12 of the scene's own particles is already there.
    fewer = [(name, 40, count) for count in (2, 4) for name in scaling.REDUCED]
    assert places == full + reduced + fewer
    assert grown["step_seconds"].shape == (len(places), 2)
    assert np.all(grown["step_seconds"] > 0)


def memory(grown, name, particles, modes):
    at = (
        (grown["contender"] == name)
        & (grown["contender_particle_count"] == particles)
        & (grown["contender_mode_count"] == modes)
    )
    return int(grown["memory_bytes"][at][0])


def test_nothing_of_the_particles_is_held_by_lifted_jumps(grown):
    """But for a few bytes of Python's own."""
    few, many = (memory(grown, "lifted_exact", count, 12) for count in (40, 160))
    assert many == pytest.approx(few, rel=0.03)
    assert memory(grown, "lifted_exact", 40, 4) < few / 2
    for name in ("sph_stencil", "original"):
        few, many = (memory(grown, name, count, 12 * (name == "original")) for count in (40, 160))
        assert many > 2 * few


@pytest.mark.parametrize("changes", [{}, {"damping": 3}, {"force": "1e-3*cos(9*t)"}])
def test_lifted_jumps_do_not_depend_on_the_particles(changes):
    shapes = []
    for count in (40, 160):
        case = scene(**changes, particle_count=count)
        rows = scaling.waves(count, 7)
        jumps = lifted_rom.LiftedModel(case, rows, rows[1:], 1).prepare("lifted_exact").jumps
        assert isinstance(jumps, Jumps)
        shapes.append([values.shape for values in (jumps.powers, jumps.forced, jumps.nodes,
                                                   jumps.responses)])  # fmt: skip
    assert shapes[0] == shapes[1]


def test_the_time_step_shrinks_with_the_spacing():
    finer = scaling._with_particles(scene(), 160)
    assert (finer.particle_count, finer.time_step) == (160, scene().time_step / 4)
    assert finer.time_step / finer.spacing == pytest.approx(scene().time_step / scene().spacing)


@pytest.mark.parametrize(("particles", "modes"), [(13, 12), (13, 13), (40, 1), (40, 7), (161, 32)])
def test_waves_are_orthonormal_and_begin_with_the_constant(particles, modes):
    rows = scaling.waves(particles, modes)
    assert rows.shape == (modes, particles)
    np.testing.assert_allclose(rows @ rows.T, np.eye(modes), atol=1e-13)
    np.testing.assert_allclose(rows[0], particles**-0.5)
    # Each next pair has one wave more.
    spectrum = np.abs(np.fft.rfft(rows)) ** 2
    assert spectrum.argmax(axis=1).tolist() == [(mode + 1) // 2 for mode in range(modes)]


def test_short_runs_are_repeated_and_their_mean_is_reported():
    calls = []

    def call(name):
        return lambda: calls.append(name)

    seconds = timing.measure([call("a"), call("b")], 2, [3, 1])
    assert calls == [*"aaab"] * 2
    assert seconds.shape == (2, 2)

    def busy():
        np.linalg.svd(np.ones((60, 60)))

    busy()
    once, often = np.median(timing.measure([busy, busy], 9, [1, 20]), axis=1)
    assert often < 10 * once
