"""Independence of the machine, and values that are not finite."""

import os

import numpy as np
import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st
from scenes import VARIED, scene

from sphpod.full import lifted, sph
from sphpod.scene.breakdown import Breakdown
from sphpod.studies import machine

CASES: dict[str, dict] = {
    "plain": {},
    "varied": VARIED,
    "jittered": VARIED | {"positions": {"jitter": 0.3, "seed": 1}},
}
BAD = (np.nan, np.inf, -np.inf)
BAD_TEXTS = ("0/0", "1/0", "-1/0")
STRIDE = 10

cases = st.sampled_from(list(CASES))
particles = st.integers(0, 39)


def snapshots(case, count):
    """Of standing waves over a short time, whose singular values fall steeply."""
    times, x = np.linspace(0, 0.1, count), case.positions
    waves = [(np.cos(2 * np.pi * 0.3 * n * times), np.sin(2 * np.pi * n * x)) for n in range(1, 11)]
    velocity = sum(np.outer(time, shape) for time, shape in waves)
    return {
        "x": x,
        "velocity_snapshots": velocity,
        "density_snapshots": case.density0() * (1 + 1e-3 * velocity),
    }


@pytest.mark.workflow
def test_full_models_and_modes_do_not_depend_on_threads_or_cores():
    """With snapshots so large that BLAS would share them among threads."""
    case = scene(particle_count=1000, duration=0.02, time_step=1e-3, damping=1)
    arrays = machine.compare(case, snapshots(case, 300))
    assert list(arrays["quantity"]) == [
        "full SPH, stencil",
        "full SPH, lists",
        *(f"lifted full, {integrator}" for integrator in lifted.INTEGRATORS),
        "velocity modes",
        "density modes",
        "scaled velocity modes",
        "scaled strain modes",
    ]
    for row in machine.rows({"scene": "test"}, arrays):
        assert row["thread_difference"] <= row["limit"], row
        assert row["core_difference"] <= row["limit"] or not machine.available_cores(), row
        assert row["verdict"] == "independent"


def test_what_is_computed_moves_and_jittered_particles_have_no_stencil():
    case = scene(positions={"jitter": 0.3, "seed": 1})
    results = machine.compute(case, snapshots(case, 20))
    assert "full SPH, stencil" not in results
    for name, arrays in results.items():
        assert all(np.isfinite(values).all() for values in arrays), name
        if "full" in name:
            assert all(len(values) == 11 and np.ptp(values[-1]) > 0 for values in arrays), name
    shapes = results["velocity modes"][0]
    assert 1 < len(shapes) < 20


def test_processes_have_their_own_threads_and_cores(monkeypatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "7")
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    cores = machine.available_cores()
    for name in machine.THREAD_SETTINGS:
        assert machine.run_on(3, [], os.getenv, name) == "3"
    assert os.environ["OPENBLAS_NUM_THREADS"] == "7"
    assert "OMP_NUM_THREADS" not in os.environ
    if cores:
        assert machine.run_on(1, cores[-1:], os.sched_getaffinity, 0) == {cores[-1]}
    assert machine.available_cores() == cores


def test_settings_are_restored_after_a_failure(monkeypatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "7")
    cores = machine.available_cores()
    with pytest.raises(TypeError):
        machine.run_on(2, cores[:1], os.getenv)
    assert os.environ["OPENBLAS_NUM_THREADS"] == "7"
    assert machine.available_cores() == cores


def test_differences_are_reported(monkeypatch):
    def run_on(threads, cores, function, *given):
        shape = 2 if len(cores) > 1 else 3
        return {
            "steady": [np.array([3.0, 4.0])],
            "threads": [np.zeros(2), np.array([8.0, -4.0 * threads])],
            "rank": [np.ones(shape)],
        }

    monkeypatch.setattr(machine, "run_on", run_on)
    monkeypatch.setattr(machine, "available_cores", lambda: [0, 1])
    arrays = machine.compare(scene(), {})
    np.testing.assert_array_equal(arrays["thread_difference"], [0, 0.5, 0])
    np.testing.assert_array_equal(arrays["core_difference"], [0, 0, np.inf])
    verdicts = [row["verdict"] for row in machine.rows({}, arrays)]
    assert verdicts == ["independent", "depends on the machine", "depends on the machine"]
    monkeypatch.setattr(machine, "available_cores", list)
    assert np.isnan(machine.compare(scene(), {})["core_difference"]).all()


def models(case):
    """Every full model, run and solved from a state; that of full SPH is (v, ρ)."""
    steps = case.error_steps
    for neighbours in ("stencil", "lists") if case.is_even else ("lists",):
        yield (
            lambda start, n=neighbours: sph.prepare(case, steps, n, start),
            lambda start, n=neighbours: sph.solve(case, steps, n, start),
            case.density0(),
        )
    for integrator in lifted.INTEGRATORS:
        yield (
            lambda start, i=integrator: lifted.prepare(case, i, start=start),
            lambda start, i=integrator: lifted.solve(case, i, start=start),
            np.zeros(case.particle_count),
        )


@examples(40)
@given(cases, particles, st.sampled_from(BAD), st.integers(0, 1))
@pytest.mark.filterwarnings("ignore:(invalid value|overflow):RuntimeWarning")
def test_a_broken_start_is_caught_at_its_particle_and_never_heals(name, particle, bad, field):
    case = scene("crash", **CASES[name], duration=0.05)
    for prepare, solve, second in models(case):
        start = [case.velocity0(), second]
        start[field] = start[field].copy()
        start[field][particle] = bad
        with pytest.raises(Breakdown, match=r"^scene crash: .* broke down by t = 0 s") as caught:
            solve(tuple(start))
        assert caught.value.time == 0
        assert caught.value.particle == particle
        run = prepare(tuple(start)).run(watch=False)
        assert run.failed == -1
        assert (~np.isfinite(run.state)).any(axis=(0, 2)).all()


@examples(40)
@given(cases, st.integers(0, 99), particles, st.sampled_from(BAD), st.integers(0, 1))
def test_full_sph_that_breaks_between_outputs_is_caught_at_the_next(name, step, at, bad, field):
    case = scene("crash", **CASES[name], duration=0.2)
    after = np.arange(step, step + 2)
    output = (step // STRIDE + 1) * STRIDE
    for neighbours in ("stencil", "lists") if case.is_even else ("lists",):
        before = sph.solve(case, np.array([0, step]), neighbours)
        start = before["velocity"][1], before["density"][1]
        start[field][at] = bad
        unseen = sph.prepare(case, np.array([step, output]), neighbours, start).run(watch=False)
        assert unseen.failed == -1
        velocity, density = (field[1] for field in unseen.state)
        with pytest.raises(Breakdown, match=r"^scene crash: full SPH broke down") as caught:
            sph.solve(case, after + output - step, neighbours, (velocity, density))
        assert caught.value.time == pytest.approx(output * case.time_step)
        # What is wrong spreads by as many particles a step as there are neighbours on a side.
        reach = 2 * (output - step) * (2 if case.is_even else 4)
        distance = abs(caught.value.particle - at)
        assert min(distance, case.particle_count - distance) <= reach


@examples(40)
@given(cases, st.integers(0, 199), st.sampled_from(BAD_TEXTS))
@pytest.mark.filterwarnings("ignore:(invalid value|overflow):RuntimeWarning")
def test_a_force_that_is_broken_in_one_step_is_caught_at_the_next_output(name, step, bad):
    """In every model with fixed steps, wherever they look at the force in that step."""
    dt = 1e-3
    pulse = f"where(abs(t - {(step + 0.25) * dt!r}) < {dt / 2!r}, {bad}, 1e-3*cos(20*t))"
    changes = CASES[name] | {"force": pulse, "damping": CASES[name].get("damping", 0)}
    case = scene("crash", **changes, duration=0.2, time_step=dt)
    output = (step // STRIDE + 1) * STRIDE * dt
    runs = [lambda n=n: sph.solve(case, case.error_steps, n) for n in ("lists", None)]
    runs += [lambda i=i: lifted.solve(case, i) for i in lifted.FIXED_STEP]
    for run in runs:
        with pytest.raises(Breakdown, match=r"^scene crash: ") as caught:
            run()
        assert caught.value.time == pytest.approx(output)


@pytest.mark.slow
@pytest.mark.parametrize("changes", CASES.values(), ids=CASES)
@pytest.mark.parametrize("integrator", [*lifted.ADAPTIVE, "exact"])
@pytest.mark.filterwarnings("ignore:(invalid value|overflow):RuntimeWarning")
@pytest.mark.parametrize("bad", BAD_TEXTS)
def test_a_force_that_breaks_is_caught_by_integrators_without_steps(changes, integrator, bad):
    case = scene("crash", **(changes | {"force": f"where(t < 0.0437, 1e-3, {bad})"}), duration=0.2)
    with pytest.raises(Breakdown, match=r"^scene crash: the lifted full model") as caught:
        lifted.solve(case, integrator)
    assert caught.value.time == pytest.approx(0.05)
