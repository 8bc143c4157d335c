"""Scenes in which nothing moves, not yet or not any more: no infinity but that of a breakdown."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from figure_checks import check_layout
from scenes import VARIED, scene

from sphpod.figures import plotting, stability_plots
from sphpod.full import lifted, sph
from sphpod.numerics import error
from sphpod.reduced import certificate, lifted_rom, pod, rom, snapshots
from sphpod.reference import exact, reference
from sphpod.scene import waves
from sphpod.studies import benchmark, comparison, growth, poor_snapshots, stability_map, time_steps

pytestmark = pytest.mark.filterwarnings("error")

SAMPLING = {"range": [0, 0.5], "count": 6}
COUNTS = [1, 2, 6]
STILL: dict[str, dict[str, Any]] = {
    "still": {"initial_velocity": 0},
    "still and damped": {"initial_velocity": 0, "damping": VARIED["damping"]},
    "still and jittered": {"initial_velocity": 0, "positions": {"jitter": 0.2}},
    "force of zero": {"initial_velocity": 0, "force": "0*t"},
}
LATE: dict[str, dict[str, Any]] = {
    "late": {"initial_velocity": 0, "force": "where(t < 0.8, 0, 1e-3)"},
    "late profile": {
        "initial_velocity": 0,
        "force": {"time": "where(t < 0.8, 0, 1e-3)", "profile": "sin(2*pi*x/L)"},
    },
    "late and jittered": {
        "initial_velocity": 0,
        "force": "where(t < 0.8, 0, 1e-3)",
        "positions": {"jitter": 0.2},
    },
}
CONSTANT: dict[str, dict[str, Any]] = {
    "constant": {"initial_velocity": 1e-3},
    "constant and graded": {"initial_velocity": 1e-3, "initial_density": VARIED["initial_density"]},
}
SCENES = STILL | LATE | CONSTANT
every = pytest.mark.parametrize("name", SCENES)


@cache
def solved(name):
    """The scene, full SPH, its snapshots, the lifted full model and a reference."""
    case = scene(name.replace(" ", "_"), particle_count=20, **SCENES[name])
    full = sph.solve(case, snapshots.output_steps(case, [SAMPLING]))
    taken = snapshots.extract(case, SAMPLING, full)
    kept = np.isin(full["t"], case.error_times)
    full = {key: values if key == "x" else values[kept] for key, values in full.items()}
    known = exact.kind(case) is not None
    against = exact.solve(case) if known else reference.solve_centred(case)
    return case, full, taken, lifted.solve(case, "exact"), against


def no_infinity(arrays):
    numbers = {key: values for key, values in arrays.items() if values.dtype.kind == "f"}
    assert not [key for key, values in numbers.items() if np.isinf(values).any()]
    return arrays


@every
@pytest.mark.parametrize("method", ["original", "linearized", "frozen5"])
def test_reduced_models_have_errors_that_are_finite_or_undefined(name, method):
    case, full, taken, _, against = solved(name)
    modes = pod.decompose(taken)
    found = no_infinity(rom.sweep(case, method, COUNTS, modes, full, against))
    assert np.isnan(found["breakdown_time"]).all()
    # The density moves by rounding at most.
    if name not in LATE:
        assert found["density_error_sph"].max() < 1e-12


@every
def test_lifted_models_and_their_bounds(name):
    case, full, taken, lifted_full, against = solved(name)
    modes = lifted_rom.decompose(case, taken)
    no_infinity(lifted_rom.repeat_sph(case, COUNTS, modes, full, against))
    found = no_infinity(certificate.certify(case, COUNTS, modes, lifted_full, against))
    assert (found["energy_error_bound"] >= found["energy_error_lifted"] - 1e-14).all()
    chosen = certificate.choose(case, 1e-2, modes)
    no_infinity(chosen)
    assert chosen["mode_count"] == 1
    # A bound has no size relative to a model that stands still, and then certifies nothing.
    bound = chosen["energy_error_bound"][0]
    assert np.isnan(bound) == (name == "late profile")
    assert chosen["certified"] == (bound <= 1e-2)
    assert chosen["certified"] or name in LATE
    if name in STILL:
        for field in ("velocity", "strain"):
            assert found[f"{field}_error_lifted"].tolist() == [0] * len(COUNTS)
        assert found["energy_error_bound"].tolist() == [0] * len(COUNTS)
    place = {"scene": case.name, "sampling": "early"}
    rows = [*comparison.effectivity(place, found)]
    rows += comparison.certificates(place, found)
    assert not [row for row in rows if np.inf in row.values()]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["still", "late profile", "late and jittered", "constant"])
def test_figures_scale_to_what_moves(name):
    case, full, taken, _, against = solved(name)
    modes = pod.decompose(taken)
    sweep = rom.sweep(case, "original", COUNTS, modes, full, against)
    table = {"solution": np.array(["sph", "exact"]), "reference": np.array(["exact"])}
    table |= {
        f"{field}_error": error.compare({"sph": full[field], "exact": against[field]}, ["exact"])
        for field in error.FIELDS
    }
    assert comparison.threshold(sweep, table) in (None, *COUNTS)
    length = case.domain_length
    figures = [
        plotting.profile(against, ("initial_velocity", "velocity", "density_change"), length),
        plotting.modes(modes, length=length),
        plotting.error(modes, sweep, table, "exact"),
    ]
    for figure in figures:
        check_layout(figure)
    marks = [line for line in figures[2].axes[1].lines if not line.get_clip_on()]
    assert not marks  # of a breakdown, on the top edge
    picture = figures[0].axes[1].images[0]
    largest = float(np.abs(np.asarray(picture.get_array())).max())
    assert picture.norm.vmax == pytest.approx(largest or 1, rel=1e-12)


def test_a_field_that_moves_late_is_scaled_by_when_it_moves():
    solution = solved("late")[-1]
    figure = plotting.profile(solution, ("velocity",))
    # 1e-3 m/s² for 0.2 s, on an even scale.
    assert type(figure.axes[0].images[0].norm).__name__ == "Normalize"


@pytest.mark.parametrize("name", ["still", "constant", "constant and graded"])
def test_the_energy_of_what_stands_still_does_not_grow(name):
    case = solved(name)[0]
    found = growth.measure(case, [1.0, 2.0], 2.0)
    for kind in ("predicted", "measured"):
        np.testing.assert_allclose(found[f"{kind}_energy_growth"], 1, atol=1e-12)
    assert found["energy_drift"].max() < 1e-12
    check_layout(stability_plots.growth({(case.name,): found}))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["still", "late profile"])
def test_poor_snapshots_and_benchmarks_of_still_scenes(name):
    case, full, taken, lifted_full, _ = solved(name)
    poor = poor_snapshots.study(case, taken, lifted_full, [1e-2], 2, seed=0)
    no_infinity(poor)
    check_layout(stability_plots.poor_snapshots(poor))
    study = {"mode_counts": [2], "n_freeze": [1, 5]}
    measured = benchmark.compare(case, SAMPLING, study, taken, full, 1)
    no_infinity(measured)


def test_snapshots_at_rest_of_a_scene_that_moves_are_refused():
    taken = solved("constant")[2]
    at_rest = taken | {"velocity_snapshots": 0 * taken["velocity_snapshots"]}
    waves = scene()
    with pytest.raises(ValueError, match="all values are 0 and no translation takes part"):
        lifted_rom.decompose(waves, {k: np.resize(v, (6, 40)) for k, v in at_rest.items()})


def test_all_modes_are_those_of_the_snapshots_and_one_of_translation():
    """So many as the best model has can be asked for."""
    case = scene(damping="1 + x", initial_velocity="1e-3*exp(-99*(x/L - 1/2)**2)")
    sampling = {"range": [0, 1], "count": 12}
    full = sph.solve(case, snapshots.output_steps(case, [sampling]))
    modes = lifted_rom.decompose(case, snapshots.extract(case, sampling, full))
    assert certificate.choose(case, 0.5, modes)["best_mode_count"] == 13


@pytest.mark.parametrize("name", ["late", "constant"])
def test_models_without_a_wave_have_maps_and_limits(name):
    case, _, taken, *_ = solved(name)
    modes, energy_modes = pod.decompose(taken), lifted_rom.decompose(case, taken)
    mapped = stability_map.of_modes(case, [1, 2], modes, energy_modes, 3)
    # From a hundredth of the period of the scene's fastest wave, as there is none of the model's.
    ends = np.array([0.01, 3]) / waves.fastest_wave(case)
    np.testing.assert_allclose(mapped["map_time_step"][[0, -1]], ends)
    assert not mapped["mode_growth"][1].any()
    check_layout(stability_plots.stability_map(stability_map.of_damping(case, 3), mapped))
    found = time_steps.reduced(case, [2], modes, energy_modes)
    check_layout(stability_plots.time_steps({(case.name, "early"): found}))
