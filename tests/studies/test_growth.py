"""Energies under explicit Euler, and those that other integrators keep."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import VARIED, scene

from sphpod.full import energy, lifted, sph
from sphpod.studies import growth
from sphpod.studies.growth import Waves

GRADED = {key: VARIED[key] for key in ("initial_density", "youngs_modulus")}


@st.composite
def conserving_scenes(draw):
    """Scenes that nothing damps or pushes, of any material."""
    rho, c = draw(st.floats(0.5, 2)), draw(st.floats(0.05, 1))
    depth = draw(st.floats(0, 0.8))
    return scene(
        particle_count=draw(st.integers(7, 41)),
        smoothing_ratio=draw(st.floats(0.8, 2.9)),
        initial_density=f"{rho}*(1 + {depth}*sin(2*pi*x/L))",
        youngs_modulus=f"{c}*(1 + {draw(st.floats(0, 0.9))}*cos(4*pi*x/L))",
        positions={"jitter": draw(st.sampled_from([0.0, 0.2])), "seed": draw(st.integers(0, 9))},
    )


def total(case, solution, row):
    return energy.total(case, solution["velocity"][[row]], solution["strain"][[row]])[0]


@settings(deadline=None, max_examples=25)
@given(conserving_scenes())
def test_explicit_euler_grows_as_its_waves_do(case):
    waves = Waves.of(case)
    run = lifted.solve(case, "explicit_euler")
    assert waves.energy(0) == pytest.approx(total(case, run, 0), rel=1e-12)
    assert waves.energy(case.step_count) == pytest.approx(total(case, run, -1), rel=1e-9)
    smallest = 1 + run["strain"].min(axis=1)
    np.testing.assert_allclose(waves.smallest_jacobian(case.error_steps), smallest, atol=1e-11)


@pytest.mark.parametrize("changes", [{}, GRADED, {"positions": {"jitter": 0.2, "seed": 3}}])
def test_full_sph_grows_as_predicted(changes):
    case = scene(**(changes | {"initial_velocity": "1e-5*sin(2*pi*x/L)", "time_step": 5e-3}))
    found = growth.measure(case, [1, 10], 10)
    assert np.isnan(found["predicted_breakdown_time"]).all()
    assert np.isnan(found["measured_breakdown_time"]).all()
    grown = found["predicted_energy_growth"] - 1
    assert (grown > [0.01, 0.1]).all()
    np.testing.assert_allclose(found["measured_energy_growth"] - 1, grown, rtol=1e-3)


def test_rounding_grows_as_expected():
    # Eight runs whose start holds no fast waves; all that these have comes from rounding.
    case = replace(scene(), time_step=0.02, duration=6.0, error_interval=6.0)
    waves = Waves.of(case)
    fast = waves.frequencies > 0.9 * waves.frequencies[0]
    found = []
    for size in np.linspace(1, 2, 8) * 1e-6:
        velocity = size * np.sin(2 * np.pi * case.positions)
        run = sph.solve(case, np.array([0, case.step_count]), start=(velocity, case.density0()))
        strained = waves.strains * lifted.energy_weights(case)[1] ** 2
        parts = strained[fast] @ lifted.strain(case, run["density"][1])
        found.append(2 * np.sum(parts**2))
    expected = waves.rounding(np.array(case.step_count))[fast].sum()
    assert 1 / 2 < np.mean(found) / expected < 2


@pytest.mark.parametrize(
    "changes",
    [
        {"particle_count": 100, "smoothing_ratio": 1.2, "time_step": 2e-3},
        {"initial_velocity": "0.02*sum(sin(2*pi*l*x/L + l**2) for l in range(5, 11))"},
    ],
    ids=["from rounding", "from the start"],
)
def test_a_breakdown_comes_when_it_is_predicted(changes):
    case = scene(**({"time_step": 5e-3} | changes))
    found = growth.measure(case, [2, 60], 1)
    assert np.isnan(found["measured_energy_growth"]).tolist() == [False, True]
    for name in ("predicted_breakdown_time", "measured_breakdown_time"):
        assert np.isnan(found[name]).tolist() == [True, False]
    delay = np.diff([found[f"{name}_breakdown_time"][1] for name in ("predicted", "measured")])
    rate = Waves.of(case).gain[0] / 2 / case.time_step
    assert abs(delay * rate) < 2


@settings(deadline=None, max_examples=25)
@given(conserving_scenes(), st.sampled_from(growth.CONSERVING[:2]), st.floats(0.1, 0.95))
def test_every_integrator_keeps_its_own_energy(case, integrator, part):
    rng = np.random.default_rng(case.particle_count)
    start = 1e-3 * rng.standard_normal((2, case.particle_count))
    step = part * 2 / Waves.of(case).frequencies[0]
    long = replace(case, duration=100 * step, time_step=step, error_interval=step)
    run = lifted.solve(long, integrator, start=tuple(start))
    fields = run["velocity"], run["strain"]
    kept = energy.kept(long, integrator, step, *fields)
    assert kept.min() > 0
    np.testing.assert_allclose(kept, kept[0], rtol=1e-12)
    for other in growth.CONSERVING:
        if other != integrator:
            changed = energy.kept(long, other, step, *fields)
            assert np.abs(changed / changed[0] - 1).max() > 1e-6


@pytest.mark.parametrize("changes", [{}, GRADED, {"positions": {"jitter": 0.2, "seed": 3}}])
def test_energies_stay_over_a_long_time(changes):
    found = growth.measure(scene(**changes), [1], 100)
    assert found["conserving"].tolist() == list(growth.CONSERVING)
    assert (found["energy_drift"] < 1e-11).all()
    frequency = Waves.of(scene(**changes)).frequencies[0]
    steps = found["energy_time_step"]
    assert np.isnan(steps[2])
    assert (steps[:2] * frequency <= 1).all()
    np.testing.assert_allclose(0.1 / steps[:2] % 1, 0, atol=1e-9)


@pytest.mark.parametrize("change", [{"damping": 1}, {"force": "1e-3*cos(t)"}])
def test_energies_that_are_not_a_scenes_own_are_refused(change):
    with pytest.raises(ValueError, match=r"scene test: .* damped or forced"):
        growth.measure(scene(**change), [1], 1)


def test_rows_tell_each_horizon_and_each_integrator():
    arrays = growth.measure(scene(), [0.5, 1], 1)
    table = list(growth.rows({"scene": "test"}, arrays))
    assert [row["integrator"] for row in table] == ["explicit_euler"] * 2 + list(growth.CONSERVING)
    assert [row["horizon"] for row in table] == [0.5, 1, 1, 1, 1]
    assert table[1]["measured_energy_growth"] == arrays["measured_energy_growth"][1]
    assert table[3]["energy_drift"] == arrays["energy_drift"][1]
