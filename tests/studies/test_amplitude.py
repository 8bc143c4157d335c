"""Models as the initial velocity grows until the particles fold."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st
from scenes import VARIED, scene

from sphpod.full import lifted, sph
from sphpod.numerics.error import relative_error
from sphpod.reduced import lifted_rom
from sphpod.scene.breakdown import Breakdown
from sphpod.studies import amplitude

SAMPLING = {"range": [0, 1.6], "count": 40}
SCENES: dict[str, dict[str, Any]] = {
    "plain": {"duration": 2},
    "damped and forced": {"duration": 2, "damping": 1, "force": "1e-3*cos(9*t)"},
    "varied": {"duration": 2} | VARIED,
}
each = pytest.mark.parametrize("name", SCENES)


@cache
def studied(name):
    return amplitude.study(scene(**SCENES[name]), SAMPLING, mode_count=10, count=6)


def of(arrays, name, contender):
    return arrays[name][arrays["contender"].tolist().index(contender)]


@each
def test_amplitudes_rise_to_the_folding_one_and_beyond(name):
    arrays = studied(name)
    factors = arrays["amplitude"] / arrays["folding_amplitude"]
    assert arrays["amplitude"][0] == 1
    np.testing.assert_allclose(np.diff(np.log(factors[:-1]), 2), 0, atol=1e-9)
    assert factors[-2:] == pytest.approx([amplitude.NEAR, amplitude.BEYOND])
    assert np.all(np.diff(arrays["smallest_jacobian"]) < 0)
    assert 0 < arrays["smallest_jacobian"][-2] < 0.05
    assert arrays["smallest_jacobian"][-1] <= arrays["smallest_jacobian"][-2] / 2


@each
def test_every_model_breaks_down_beyond_the_folding_amplitude_and_full_sph_only_there(name):
    arrays = studied(name)
    times = arrays["scaled_breakdown_time"]
    assert times.shape == (len(amplitude.CONTENDERS), 6)
    assert np.isfinite(times[:, -1]).all()
    assert np.isnan(of(arrays, "scaled_breakdown_time", "sph")[:-1]).all()
    for field in ("velocity", "density"):
        errors = arrays[f"scaled_{field}_error"]
        full, reduced = errors[: len(amplitude.FULL)], errors[len(amplitude.FULL) :]
        assert np.isnan(full).all()
        assert np.isnan(reduced[:, -1]).all()
        # Infinite is the error of a model that broke down alone, and of no other.
        broke = np.isfinite(times[len(amplitude.FULL) :, :-1])
        np.testing.assert_array_equal(np.isinf(reduced[:, :-1]), broke)


def test_the_papers_models_drift_and_the_lifted_one_stays():
    arrays = studied("plain")
    strains = arrays["amplitude"][:-2]
    linearized = of(arrays, "scaled_velocity_error", "linearized")[:-2]
    original = of(arrays, "scaled_velocity_error", "original")[:-2]
    lifted_euler = of(arrays, "scaled_velocity_error", "lifted_euler")[:-2]
    lifted_exact = of(arrays, "scaled_velocity_error", "lifted_exact")[:-1]
    # While strains are small, what linearizing does is of their order, and so is, times the time
    # step, the difference of explicit Euler in density and in strain.
    for errors in (linearized, lifted_euler):
        assert errors[1] / errors[0] == pytest.approx(strains[1], rel=0.1)
        assert np.all(np.diff(errors) > 0)
    assert not original[-1] < 100 * original[0]
    assert np.all(lifted_exact < 1e-2)
    assert np.all(lifted_exact[:-1] < linearized / 100)


@each
@examples(15)
@given(factor=st.floats(0.1, 80))
def test_the_lifted_full_model_is_superposed(name, factor):
    case = scene(**SCENES[name])
    found = amplitude.Superposition.of(case).solution(factor)
    strong = amplitude.scaled(case, factor)
    if np.isfinite(found.breakdown_time):
        with pytest.raises(Breakdown) as broken:
            lifted.solve(strong, "exact")
        assert found.breakdown_time == broken.value.time
        return
    full = lifted.solve(strong, "exact")
    assert relative_error(found.fields["velocity"], full["velocity"]) < 1e-11
    expected = lifted.density(case, full["strain"])
    assert relative_error(found.fields["density"], expected) < 1e-10


@examples(25)
@given(
    st.integers(7, 40),
    st.sampled_from([{}, {"damping": 2}, {"force": "1e-3*cos(9*t)"}, VARIED]),
    st.floats(0, 6),
)
def test_full_sph_folds_at_the_folding_amplitude_and_not_below(count, changes, shift):
    velocity = f"1e-3*sin(2*pi*x/L + {shift})"
    case = scene(**changes, particle_count=count, initial_velocity=velocity)
    steps = case.error_steps
    folding = amplitude.folding_amplitude(case, steps)
    with pytest.raises(Breakdown):
        sph.solve(amplitude.scaled(case, folding), steps)
    sph.solve(amplitude.scaled(case, amplitude.NEAR * folding), steps)


@each
def test_the_lifted_full_model_folds_at_its_own_amplitude(name):
    case, arrays = scene(**SCENES[name]), studied(name)
    folding = float(arrays["lifted_folding_amplitude"])
    lifted.solve(amplitude.scaled(case, folding * (1 - 1e-9)), "exact")
    with pytest.raises(Breakdown):
        lifted.solve(amplitude.scaled(case, folding * (1 + 1e-9)), "exact")
    # Explicit Euler's energy grows, but little in so short a time.
    assert arrays["folding_amplitude"] == pytest.approx(folding, rel=0.05)


@examples(20)
@given(st.floats(1, 60), st.integers(1, 8))
def test_with_its_own_snapshots_the_lifted_error_does_not_depend_on_the_amplitude(factor, count):
    case = scene(initial_velocity="2e-3*x*(L - x)*sin(6*pi*x)", duration=2)

    def error(times):
        strong = amplitude.scaled(case, times)
        full = lifted.solve(strong, "exact")
        taken = {f"{field}_snapshots": full[field][:160:4] for field in ("velocity", "strain")}
        model = lifted_rom.build(strong, lifted_rom.decompose(strong, taken), count)
        found = model.prepare("lifted_exact").run().fields()
        return [relative_error(values, full[name]) for name, values in found.items()]

    assert error(factor) == pytest.approx(error(1), rel=1e-6)


def test_scenes_that_fold_at_once_or_never_are_refused():
    steps = scene().error_steps
    with pytest.raises(Breakdown, match="scene test: full SPH broke down"):
        amplitude.folding_amplitude(scene(initial_velocity="0.9*sin(2*pi*x/L)"), steps)
    with pytest.raises(ValueError, match=r"scene rigid: initial_velocity = 1e-3: .* strains"):
        amplitude.folding_amplitude(scene("rigid", initial_velocity="1e-3"), steps)


def test_rows_hold_a_study():
    arrays = studied("plain")
    table = list(amplitude.rows({"scene": "plain"}, arrays))
    assert len(table) == arrays["scaled_velocity_error"].size
    assert all(next(iter(row)) == "scene" for row in table)
    for name, column in (("velocity_error",) * 2, ("breakdown_time",) * 2):
        np.testing.assert_array_equal(
            [row[column] for row in table], arrays[f"scaled_{name}"].ravel()
        )
    assert [row["amplitude"] for row in table[:6]] == arrays["amplitude"].tolist()
