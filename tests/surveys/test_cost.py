"""Costs: contenders are as accurate as they say, and break even where they cost alike."""

from typing import Any

import numpy as np
import pytest
from survey_cases import SCENE, settings

from sphpod.config.config import load
from sphpod.full import lifted
from sphpod.surveys import cost, even, jobs, samples, training
from sphpod.surveys.parts import Operators
from sphpod.surveys.query import Survey
from sphpod.surveys.validation import relative_error

EVEN: dict[str, Any] = {
    "youngs_modulus": "stiffness",
    "parameters": {name: SCENE["parameters"][name] for name in ("stiffness", "decay")},
}
FORCE = {"force": {"time": "size*cos(4*t)", "profile": "exp(-20*(x/L - 0.5)**2)"}}
SIZE = {"size": {"nominal": 1e-3, "range": [-1e-3, 2e-3]}}


def made(of_scene=None, **changes):
    asked = {
        "sensor": {"kind": "history", "place": 0.3, "width": 0.1},
        "stress": {"kind": "maximum", "place": 0.3, "field": "stress"},
        "last": {"kind": "energy"},
    }
    keys = {"cost_repeats": 2, "training": {"count": 4}, "mode_count": 4, "quantities": asked}
    resolved = load([], settings(of_scene, **(keys | changes)))
    survey = resolved["surveys"]["graded"]
    physics = samples.survey_settings(resolved["scenes"]["bar"], survey)
    runs = [training.run("bar", physics, survey, n) for n in range(survey["training"]["count"])]
    return physics, survey, training.train("bar", physics, survey, runs)


@pytest.fixture(scope="module")
def graded():
    return cost.measure("bar", *made())


@pytest.fixture(scope="module")
def uniform():
    return cost.measure("bar", *made(EVEN))


def of(found, contender, name="query_error"):
    return found[name][found["contender"] == contender]


@pytest.mark.slow
def test_contenders_are_as_accurate_as_the_reduced_model(graded, uniform) -> None:
    for found in (graded, uniform):
        (target,) = of(found, "reduced")
        assert 0 < target < 1
        assert (of(found, "lifted_full") <= target).all()
        exact = found["query_error"][found["integrator"] == "exact"]
        assert exact[0] < 1e-12
        assert (found["query_seconds"] > 0).all()


@pytest.mark.slow
def test_steps_are_as_long_as_the_error_allows(graded) -> None:
    physics, survey, model = made()
    bounded, asked = cost.of_settings("bar", physics, survey, model)
    points = cost.picked(bounded, asked, survey)
    ranges = physics["parameters"]
    task = cost.Task(
        bounded.operators,
        asked,
        [dict(zip(ranges, map(float, point), strict=True)) for point in points],
    )
    target = cost.coarsest(task, "leapfrog", 1.0).error / 10
    found = cost.coarsest(task, "leapfrog", target)
    interval = task.scenes[0].error_interval
    longer = interval / (round(interval / found.time_step) - 1)
    assert found.error <= target
    errors = [
        relative_error(scene, full, solved["velocity"], solved["strain"])
        for scene, full in zip(task.scenes, task.exact, strict=True)
        for solved in [lifted.solve(scene, "leapfrog", longer)]
    ]
    assert max(errors) > target
    assert cost.coarsest(task, "symplectic_euler", 1e-12) is None


def test_fourier_competes_where_coefficients_are_even_alone(graded, uniform) -> None:
    assert "fourier" not in graded["contender"]
    assert of(uniform, "fourier") < 1e-12


@pytest.mark.parametrize("count", [30, 31])
@pytest.mark.parametrize("forced", [False, True])
def test_fourier_modes_are_the_lifted_model_exact_in_time(count, forced) -> None:
    of_scene = EVEN | {"particle_count": count}
    if forced:
        of_scene |= FORCE | {"parameters": EVEN["parameters"] | SIZE}
    resolved = load([], settings(of_scene))["scenes"]["bar"]
    none = {name: np.zeros((1, count)) for name in ("velocity_modes", "stress_modes")}
    survey = Survey(Operators("bar", resolved, none | {"translation": 0}), 1)
    point = {"stiffness": 0.13, "decay": 0.3} | ({"size": 2e-3} if forced else {})
    scene = samples.scene_at("bar", resolved, point)
    exact = lifted.solve(scene, "exact")
    outputs = np.arange(scene.error_times.size)
    velocity, strain, energy = even.Waves(survey, np.arange(count), outputs).solve(point)
    mass, stiffness = lifted.energy_weights(scene)
    squares = (mass * exact["velocity"]) ** 2 + (stiffness * exact["strain"]) ** 2
    for ours, full in (
        (velocity, exact["velocity"]),
        (strain, exact["strain"]),
        (energy, squares.sum(axis=1) / 2),
    ):
        np.testing.assert_allclose(ours, full, atol=1e-9 * np.abs(full).max())


def test_costs_are_equal_at_break_even(graded) -> None:
    seconds, trained = (
        np.median(graded[name], axis=-1) for name in ("query_seconds", "training_seconds")
    )
    for reduced, name in (("reduced", "break_even_unbounded"), ("reduced_bounded", "break_even")):
        (own,) = seconds[graded["contender"] == reduced]
        for full, queries in zip(seconds, graded[name], strict=True):
            if np.isfinite(queries):
                np.testing.assert_allclose(trained + queries * own, queries * full)
            elif np.isinf(queries):
                assert full <= own
    assert np.isnan(graded["break_even"][-2:]).all()


def test_break_even_is_never_where_a_query_costs_no_less() -> None:
    found = cost.break_even(np.array([1.0, 2.0, 3.0]), 2.0, 5.0)
    assert found.tolist() == [np.inf, np.inf, 5.0]


def test_what_is_timed_gives_what_full_runs_give() -> None:
    physics, survey, model = made()
    bounded, asked = cost.of_settings("bar", physics, survey, model)
    task = cost.Task(bounded.operators, asked, [{"stiffness": 0.1, "contrast": 0.2, "decay": 0.3}])
    full, scene = task.exact[0], task.scenes[0]
    mass, stiffness = lifted.energy_weights(scene)
    squares = (mass * full["velocity"]) ** 2 + (stiffness * full["strain"]) ** 2
    energy = squares.sum(axis=1)[task.outputs] / 2
    found = task.quantities(scene, (full["velocity"], full["strain"]), energy)
    every = [q.of_fields(scene, full, squares.sum(axis=1) / 2) for q in asked.values()]
    for one, other in zip(found, every, strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_survey_without_answers_has_no_cost() -> None:
    physics, survey, model = made()
    fast = {**physics, "initial_velocity": "10*sin(2*pi*x/L)"}
    with pytest.raises(ValueError, match=r"none of the queries .* the line may fold"):
        cost.measure("bar", fast, survey, model)


@pytest.mark.slow
def test_greedy_training_is_timed_too() -> None:
    physics, survey, model = made(training={"count": 1, "method": "greedy"})
    found = cost.measure("bar", physics, {**survey, "cost_repeats": 1}, model)
    assert found["training_seconds"].shape == (1,)
    meanings = jobs.meanings("bar", physics, survey)
    assert set(found) <= set(meanings) | {
        *("contender", "integrator", "contender_mode_count", "contender_time_step")
    }
