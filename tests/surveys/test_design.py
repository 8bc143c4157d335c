"""Designs: the optimum of the full model, retrained where it must be, or said to be none."""

import json
import subprocess
import sys
from functools import cache

import numpy as np
import pytest
from scipy.optimize import brentq
from survey_cases import SCENE, settings

from sphpod.config.config import load
from sphpod.pipeline import provenance
from sphpod.surveys import jobs, samples, tables, training, validation
from sphpod.surveys.answers import answer_all, of_settings
from sphpod.surveys.goal import Goal, scales

OTHERS = {"stiffness": 0.1, "contrast": 0.3}
LEVEL = 2e-7


@cache
def trained(changes):
    """Model, queries and training runs of a survey with changes, as JSON."""
    resolved = load([], settings(**json.loads(changes)))
    survey = resolved["surveys"]["graded"]
    physics = samples.survey_settings(resolved["scenes"]["bar"], survey)
    runs = [training.run("bar", physics, survey, n) for n in range(survey["training"]["count"])]
    model = training.train("bar", physics, survey, runs)
    return model, jobs.queries("bar", physics, survey, model, 0), runs


def designed(keys, **changes):
    model, answers, runs = trained(json.dumps(changes))
    resolved = load([], settings(design=keys, **changes))
    survey = resolved["surveys"]["graded"]
    physics = samples.survey_settings(resolved["scenes"]["bar"], survey)
    found = jobs.designed("bar", physics, survey, model, answers, runs)
    assert {*found} <= {*jobs.meanings("bar", physics, survey), "t"}
    return found, in_full(physics, survey, model), (physics, survey, model, answers)


def in_full(physics, survey, model):
    """Quantities of full runs."""
    asked = of_settings("bar", physics, survey, model)[1]

    def solved(name, **values):
        scene, fields, norms = validation.in_full("bar", physics, values)
        return float(asked[name].of_fields(scene, fields, norms**2 / 2))

    return solved


def test_the_least_parameter_is_that_of_the_full_model() -> None:
    keys = {"minimise": "decay", "where": {"last": {"at_most": LEVEL}}, "given": OTHERS}
    found, full, _ = designed(keys)
    least = brentq(lambda decay: full("last", decay=decay, **OTHERS) - LEVEL, 0, 1)
    assert found["holds"][-1]
    assert found["decay"][-1] == pytest.approx(least, rel=1e-4)
    assert found["stiffness"][-1] == 0.1
    assert found["last_full"][-1] == pytest.approx(LEVEL, rel=1e-4)
    assert found["last_low"][-1] <= found["last_full"][-1] <= found["last_high"][-1]
    assert found["true_error"][-1] <= found["relative_bound"][-1]


@pytest.mark.slow
def test_no_full_run_on_a_grid_is_better() -> None:
    keys = {
        "minimise": "peak",
        "where": {"last": {"at_least": LEVEL}, "stiffness": {"at_most": 0.15}},
    }
    found, full, (physics, *_) = designed(keys)
    names = physics["parameters"]
    points = samples.points(names, {"grid": dict.fromkeys(names, 4)})
    grid = [dict(zip(names, point, strict=True)) for point in points]
    within = [p for p in grid if p["stiffness"] <= 0.15 and full("last", **p) >= LEVEL]
    assert found["holds"][-1]
    assert 0 < len(within) < len(grid)
    assert found["peak_full"][-1] <= min(full("peak", **p) for p in within)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_no_query_on_a_grid_is_better_than_a_random_design(seed) -> None:
    random = np.random.default_rng(seed)
    _, _, (physics, survey, model, answers) = designed({"minimise": "last"})
    reduced, asked = of_settings("bar", physics, survey, model)
    ranges = physics["parameters"]
    grid = answer_all(reduced, asked, samples.points(ranges, {"grid": dict.fromkeys(ranges, 6)}), 1)
    sought, *others = random.permutation(["peak", "last", *ranges])[:3].tolist()
    sides = random.choice(["at_most", "at_least"], 2).tolist()
    levels = [float(np.quantile(grid[name], random.uniform(0.2, 0.8))) for name in others]
    keys = {
        str(random.choice(["minimise", "maximise"])): sought,
        "where": {
            name: {side: level} for name, side, level in zip(others, sides, levels, strict=True)
        },
    }
    found, _, _ = designed(keys)
    goal = Goal(keys, scales(ranges, answers), 2.0, 1e-2)
    within = goal.excess(grid).max(axis=1) <= 0
    last = {name: found[name][-1:] for name in (*goal.names, "reason")}
    assert found["holds"][-1] == within.any()
    best = goal.objective(grid)[within].min(initial=np.inf)
    assert not within.any() or goal.objective(last)[0] <= best + 1e-3


@pytest.mark.parametrize("goal", ["minimise", "maximise"])
def test_a_goal_within_no_level_is_at_an_end_of_its_range(goal) -> None:
    found, _, _ = designed({goal: "last", "given": OTHERS})
    assert found["decay"][-1] == {"minimise": 1, "maximise": 0}[goal]
    assert found["verdict"].tolist() == ["the full run holds"]


def test_a_value_is_reached() -> None:
    found, _, _ = designed({"reach": {"last": LEVEL}, "where": {"contrast": {"at_least": 0.5}}})
    assert found["last_full"][-1] == pytest.approx(LEVEL, rel=1e-2)
    assert found["contrast"][-1] >= 0.5 - 1e-6
    beyond, _, _ = designed({"reach": {"last": 1.0}})
    assert "nothing is feasible: last = " in beyond["verdict"][-1]
    assert not beyond["holds"].any()


def test_what_is_feasible_nowhere_is_said() -> None:
    keys = {"minimise": "decay", "where": {"last": {"at_most": 1e-8}}, "given": OTHERS}
    found, full, _ = designed(keys)
    assert len(found["round"]) == 1
    assert not found["holds"][0]
    # The least infeasible is the strongest damping.
    assert found["decay"][0] == 1
    least = full("last", decay=1, **OTHERS)
    assert found["verdict"][0] == f"nothing is feasible: last = {least:.8g}, to be at most 1e-08"


POOR = {"training": {"count": 1}, "mode_count": 3}
PEAK = {"minimise": "decay", "where": {"peak": {"at_most": 9e-4}}, "given": OTHERS}


def test_a_level_broken_in_full_is_trained_for() -> None:
    found, full, (physics, survey, model, answers) = designed(PEAK, **POOR)
    assert len(found["round"]) > 1
    assert found["holds"].tolist() == [0] * (len(found["round"]) - 1) + [1]
    assert "the full run does not hold: peak = " in found["verdict"][0]
    assert found["peak_full"][0] > 9e-4 >= found["peak_full"][-1] * (1 - 1e-6)
    assert found["true_error"][-1] < found["true_error"][0]
    least = brentq(lambda decay: full("peak", decay=decay, **OTHERS) - 9e-4, 0, 1)
    assert found["decay"][-1] == pytest.approx(least, rel=2e-2)
    # The training runs are made again if they are not given.
    again = jobs.designed("bar", physics, survey, model, answers)
    assert np.array_equal(again["decay"], found["decay"])


def test_it_is_trained_at_most_as_often_as_said() -> None:
    found, _, _ = designed(PEAK | {"rounds": 0}, **POOR)
    assert found["round"].tolist() == [0]
    assert not found["holds"][0]


def test_a_passage_that_never_comes_is_later_than_all() -> None:
    quantities = {"passage": {"kind": "passage", "place": 0.3, "level": 9e-4}}
    found, _, _ = designed({"maximise": "passage"}, quantities=quantities)
    assert np.isnan(found["passage"][-1])
    assert np.isnan(found["passage_full"][-1])
    assert np.isfinite(found["evaluation_value"]).all()


def test_a_line_that_may_fold_is_no_optimum() -> None:
    fast = {
        "initial_velocity": "speed*sin(2*pi*x/L)",
        "youngs_modulus": "0.1",
        "parameters": {
            "speed": {"nominal": 0.01, "range": [0.01, 1]},
            "decay": {"nominal": 0.1, "range": [0, 0.2]},
        },
    }
    few = {"training": {"count": 4, "method": "greedy"}}

    def fastest(**keys):
        resolved = load([], settings(fast, design=keys, **few))
        survey = resolved["surveys"]["graded"]
        physics = samples.survey_settings(resolved["scenes"]["bar"], survey)
        model = training.train_greedily("bar", physics, survey)
        answers = jobs.queries("bar", physics, survey, model, 0)
        return jobs.designed("bar", physics, survey, model, answers)

    found = fastest(maximise="speed")
    assert found["reason"][-1] == ""
    assert found["holds"][-1]
    assert 0.1 < found["speed"][-1] < 1
    broken = fastest(minimise="last", given={"speed": 1.0})
    assert not broken["holds"].any()
    assert "nothing is feasible: scene bar: " in broken["verdict"][-1]
    assert np.isnan(broken["last_full"][-1])


def test_all_queries_of_the_search_lie_within_the_ranges() -> None:
    found, _, (physics, *_) = designed({"maximise": "peak", "where": {"last": {"at_most": LEVEL}}})
    low, high = np.array([given["range"] for given in physics["parameters"].values()]).T
    assert (low <= found["evaluation_point"]).all()
    assert (found["evaluation_point"] <= high).all()
    assert found["designed"].tolist() == ["peak", "last"]
    assert found["parameter"].tolist() == list(physics["parameters"])
    rows = tables.design(found | {"parameter": np.full(found["round"].size, "as many", object)})
    assert "parameter" not in rows
    assert {"round", "decay", "peak_full", "holds", "verdict"} <= {*rows}
    assert SCENE["parameters"].keys() <= rows.keys()


@pytest.mark.slow
def test_a_survey_without_a_design_depends_on_nothing_of_it() -> None:
    for job in ("training_run", "model", "queries", "answers", "validated", "shared_out"):
        used = map(str, provenance.closure(f"surveys.jobs.{job}"))
        assert not any("surveys.design" in name or "surveys.goal" in name for name in used), job
    code = "import sys, sphpod.surveys.jobs; assert 'scipy.optimize' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
