"""What a design looks for: spreads, levels, and what is better."""

import numpy as np
import pytest

from sphpod.surveys.goal import Goal, scales

RANGES = {"decay": {"range": [0, 2], "scale": "linear"}}


def answers(**quantities):
    reasons = np.full(len(next(iter(quantities.values()))), "", object)
    return {"reason": reasons, **{name: np.array(v, float) for name, v in quantities.items()}}


def goal(late=9.0, tolerance=1e-2, **keys):
    return Goal({"where": {}, **keys}, {"peak": 2.0, "decay": 2.0}, late, tolerance)


def test_what_only_rounding_changes_has_its_size_for_a_spread() -> None:
    found = {name: np.array(values) for name, values in {
        "peak": [1.0, 3.0, np.nan], "steady": [0.7, 0.7, 0.7 + 1e-16], "still": [0.0] * 3,
        "unknown": [np.nan] * 3}.items()}  # fmt: skip
    found |= {f"{name}_low": values for name, values in found.items()}
    spread = scales(RANGES, found)
    assert {name: spread[name] for name in ("decay", "peak", "still", "unknown")} == {
        "decay": 2, "peak": 2, "still": 1, "unknown": 1,
    }  # fmt: skip
    assert spread["steady"] == pytest.approx(0.7)


def test_what_keeps_to_its_levels_goes_before_what_is_better() -> None:
    looked_for = goal(minimise="decay", where={"peak": {"at_most": 1.0}})
    found = answers(decay=[0.1, 1.5, 0.5, 0.2], peak=[3.0, 0.9, 1.0, 1.5])
    excess = looked_for.excess(found)
    assert excess[:, 0].tolist() == [1.0, pytest.approx(-0.05), 0.0, 0.25]
    assert looked_for.order(looked_for.objective(found), excess).tolist() == [2, 1, 3, 0]


def test_a_query_without_an_answer_is_the_worst() -> None:
    looked_for = goal(maximise="decay", where={"peak": {"at_least": 1.0}})
    found = answers(decay=[2.0, 0.0], peak=[np.nan, 0.0])
    found["reason"][0] = "it folds"
    assert looked_for.order(looked_for.objective(found), looked_for.excess(found))[-1] == 0
    assert looked_for.broken(found) == ["it folds"]


def test_a_passage_that_never_comes_is_late() -> None:
    looked_for = goal(maximise="peak")
    assert looked_for.values(answers(peak=[np.nan, 1.0]), "peak").tolist() == [9, 1]


def test_a_level_is_kept_within_the_slack_and_a_value_within_the_tolerance() -> None:
    level = goal(minimise="decay", where={"peak": {"at_least": 1.0}})
    assert level.broken(answers(decay=[0.0], peak=[1 - 1e-6])) == []
    assert level.broken(answers(decay=[0.0], peak=[0.9])) == ["peak = 0.9, to be at least 1"]
    assert level.broken(answers(decay=[0.0], peak=[1.0]), np.array([0.1])) != []
    value = goal(reach={"peak": 1.0})
    assert value.broken(answers(peak=[1.01])) == []
    assert value.broken(answers(peak=[1.1])) == ["peak = 1.1, to be 1"]
