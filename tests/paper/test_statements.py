"""Criteria on what the paper says beside its numbers: each can hold, and each can fail."""

from typing import Any

import numpy as np
import pytest

from sphpod.paper import claims, criteria, statements

X = np.arange(40) / 40
T = np.linspace(0, 4, 401)


def decide(kind, *places, paper="yes", tolerance=0, **thresholds):
    claim = {"paper": paper, "tolerance": tolerance}
    return criteria.CRITERIA[kind].decide(list(places), claim, **thresholds)


def holds(kind, *places, **thresholds):
    found = decide(kind, *places, **thresholds)
    assert found.measured
    return bool(found.holds)


def errors(velocity, density):
    return {"errors": {"velocity_error": np.array([[velocity]]),
                       "density_error": np.array([[density]])}}  # fmt: skip


def sweep(velocity, density=None, resolved=True):
    velocity = np.array(velocity, float)
    density = velocity / 10 if density is None else np.array(density, float)
    return {
        "sweep": {
            "mode_count": np.arange(1, velocity.size + 1),
            "modes_resolved": np.full(velocity.size, resolved),
            "velocity_error_sph": velocity,
            "density_error_sph": density,
        },
        **errors(0.5, 0.05),
    }


def pod(rows, velocity=(1, 0.5, 0.1, 0.01), density=(9, 1, 0.5, 0.1, 0.01)):
    return {"pod": {"x": X, "velocity_modes": np.array(rows),
                    "velocity_singular_values": np.array(velocity, float),
                    "density_singular_values": np.array(density, float)}}  # fmt: skip


def motion(frequency=2 * np.pi, decay=0.0, waves=(1,)):
    rows = sum(
        np.outer(np.cos(n * frequency * T) * np.exp(-decay * n * T), np.sin(2 * np.pi * n * X))
        for n in waves
    )
    return {"t": T, "x": X, "velocity": rows}


def study(**by_name):
    """Errors of models at 4 and 8 modes, v and ρ alike."""
    frozen = {name: int(name.removeprefix("frozen")) for name in by_name if "frozen" in name}
    values = np.array(list(by_name.values()), float)
    return {
        "acceleration": {
            "contender": np.array(list(by_name)),
            "mode_count": np.array([4, 8]),
            "n_freeze": np.array([frozen.get(name, 0) for name in by_name]),
            "acceleration_velocity_error": values,
            "acceleration_density_error": values,
        }
    }


def times(**by_name):
    return {
        "cpu_time": {
            "contender": np.repeat(list(by_name), 2),
            "contender_mode_count": np.tile([4, 8], len(by_name)),
            "cpu_seconds": np.array(list(by_name.values()), float).reshape(-1, 1),
        }
    }


SINES = statements.sines(X, 5)
MIXED = np.linalg.qr(SINES[:3].T @ [[1, 1, 0], [0.5, -1, 1], [1, 0, 2]])[0].T
VARIANTS = {"variants": {"variant": np.array(["own", "fine", "wide"]),
                         "variant_velocity_error": np.array([0.2, 0.1, 0.4])}}  # fmt: skip

CASES: dict[str, Any] = {
    "sph_errors_larger": (
        [errors(0.2, 0.02), errors(0.1, 0.01)], [errors(0.2, 0.01), errors(0.1, 0.02)], {},
    ),
    "density_error_smaller": ([errors(0.2, 0.001)], [errors(0.2, 0.003)], {"factor": 100}),
    "variant_errors": (
        [VARIANTS], [VARIANTS], {"field": "velocity", "variants": ["own", "fine"], "factor": 2},
        {"field": "velocity", "variants": ["own", "wide"], "factor": 1},
    ),
    "follows_modified": (
        [{"sph": motion(6.3), "modified": motion(6.3), "exact": motion(5)}],
        [{"sph": motion(5.7), "modified": motion(6.3), "exact": motion(5)}],
        {"periods": 3, "period": 1, "factor": 10},
    ),
    "error_grows": (
        [{"sph": motion(6.3), "modified": motion(6.31)}],
        [{"sph": motion(6.3, 2), "modified": motion(7, 2)}], {"factor": 1.5},
    ),
    "periodic_in_time": (
        [{"exact": motion()}], [{"exact": motion(6)}], {"period": 1, "tolerance": 1e-3},
    ),
    "dominant_harmonics": (
        [{"exact": motion(waves=(1, 2, 3))}], [{"exact": motion(waves=(1, 2))}],
        {"groups": 2, "rise": 0.1},
    ),
    "high_harmonics_decay": (
        [{"exact": motion(decay=1, waves=(1, 2, 3, 4))}],
        [{"exact": motion(decay=-1, waves=(1, 2, 3, 4))}], {"start": 2, "end": 3, "among": 3},
    ),
    "doubled": (
        [{"snapshots": {"velocity_time": np.arange(8) * 0.1}},
         {"snapshots": {"velocity_time": np.arange(4) * 0.1}}],
        [{"snapshots": {"velocity_time": np.arange(8) * 0.1}},
         {"snapshots": {"velocity_time": np.arange(8) * 0.05}}],
        {},
    ),
    "modes_miss_harmonics": ([pod(SINES[1:4])], [pod(MIXED)], {"harmonics": 3, "rise": 0.1}),
    "pure_modes": (
        [pod([*SINES[:2], *MIXED])], [pod([*MIXED, *SINES[3:]])],
        {"modes": 2, "similar": 0.97, "among": 5},
    ),
    "density_groups": (
        [pod(SINES, density=(99, 9, 8, 7, 0.1, 0.09, 0.08, 0.001))],
        [pod(SINES, density=(99, 9, 8, 0.2, 0.1, 0.09, 0.08, 0.001))],
        {"size": 3, "groups": 2, "within": 2, "between": 10},
    ),
    "fails_with": ([sweep([1, 0.6, 0.4])], [sweep([1, 0.6, 0.4])], {"modes": 2}, {"modes": 3}),
    "aligned_only_there": (
        [pod(MIXED), pod(SINES)], [pod(SINES), pod(MIXED)], {"harmonics": 3, "similar": 0.99},
    ),
    "nearly_diagonal": (
        [{"exact": motion(waves=(1, 2)), "snapshots": {"velocity_time": np.arange(50) / 50}}],
        [{"exact": motion(waves=(1, 2)), "snapshots": {"velocity_time": np.arange(5) / 50}}],
        {"harmonics": 2, "spread": 0.1},
    ),
    "decays_faster": (
        [pod(SINES, (1, 0.1, 0.001)) | sweep([0.5, 0.4]), pod(SINES) | sweep([0.1, 0.05])],
        [pod(SINES, (1, 0.1, 0.001)) | sweep([0.1, 0.04]), pod(SINES) | sweep([0.1, 0.05])],
        {"modes": 3, "factor": 10, "mode_counts": [2]},
    ),
    "both_drop": (
        [pod(SINES, (3, 2, 0.1, 0.05), (90, 3, 2, 0.1, 0.05))],
        [pod(SINES, (3, 2, 0.1, 0.05), (90, 3, 0.2, 0.1, 0.05))],
        {"after": 2, "similar": 2, "drop": 10, "among": 3},
    ),
    "errors_fall": ([sweep([3, 2, 2])], [sweep([3, 2, 2.1])], {}),
    "error_step": (
        [sweep([3, 2.9, 0.1, 0.09])], [sweep([3, 2.9, 1.5, 0.09])], {"after": 2, "among": 4},
    ),
    "better_on_average": (
        [sweep([1, 0.5]), sweep([2, 1])], [sweep([1, 0.5]), sweep([3, 3]), sweep([2, 1])],
        {"begin": 1},
    ),
    "alike_at_every_k": (
        [sweep([1, 0.5]), sweep([2, 0.2])], [sweep([1, 0.5]), sweep([2, 0.1])], {"factor": 3},
    ),
    "need_more_modes": (
        [sweep([1, 0.1, 0.1]), sweep([1, 1, 0.1])], [sweep([1, 0.1]), sweep([1, 1])], {},
    ),
    "linearized_improves": (
        [study(original=[1, 1], linearized=[1, 3]), study(original=[1, 1], linearized=[1, 0.9])],
        [study(original=[1, 1], linearized=[1, 2]), study(original=[1, 1], linearized=[1, 3])],
        {"modes": 8},
    ),
    "freezing_negligible": (
        [study(frozen1=[1, 1], frozen2=[1, 1], frozen10=[1.0001, 1])],
        [study(frozen1=[1, 1], frozen2=[1, 1], frozen10=[1.01, 1])], {"spread": 1e-3},
    ),
    "freezing_adds_more": (
        [study(frozen1=[1, 1], frozen2=[1, 1], frozen10=[1, 1.01]), study(frozen1=[1, 1],
         frozen2=[1, 1], frozen10=[1, 1.5])],
        [study(frozen1=[1, 1], frozen2=[1, 1], frozen10=[1, 1.1]), study(frozen1=[1, 1],
         frozen2=[1, 1], frozen10=[1, 1.5])],
        {"modes": 8, "factor": 10},
    ),
    "more_modes_help": ([study(original=[1, 0.5])], [study(original=[1, 0.5], frozen1=[1, 1])], {}),
    "cpu_time_rises_little": (
        [times(original=[2, 2.2])], [times(original=[2, 2.2], frozen1=[1, 2])], {"factor": 1.5},
    ),
    "frozen_is_cheaper": (
        [times(original=[2, 2], frozen1=[1, 2.1])], [times(original=[2, 2], frozen1=[1, 2.1])],
        {"factor": 1.1}, {"factor": 1},
    ),
    "some_variant_better": (
        [VARIANTS],
        [{"variants": {"variant": np.array(["own", "wide"]),
         "variant_velocity_error": np.array([0.2, 0.4])}}],
        {"field": "velocity"},
    ),
}  # fmt: skip
"""Places with which each criterion holds, those with which it fails, and thresholds, of which the
first hold and the last fail."""


@pytest.mark.parametrize("kind", CASES)
def test_a_criterion_holds_and_fails(kind):
    good, bad, *thresholds = CASES[kind]
    assert holds(kind, *good, **thresholds[0])
    assert not holds(kind, *bad, **thresholds[-1])


def test_all_criteria_of_the_module_are_tried():
    here = {name for name in criteria.CRITERIA if hasattr(statements, name)} & set(vars(statements))
    own = {name for name in here if getattr(statements, name).__module__ == statements.__name__}
    assert own == {*CASES, "modes_are_mixed"}


def test_the_matrix_of_the_modes_has_the_signs_of_the_papers():
    mixing = SINES[:3] @ MIXED.T
    flipped = MIXED * [[-1], [1], [-1]]
    found = decide("modes_are_mixed", pod(flipped), paper=mixing.tolist(), tolerance=1e-9,
                   harmonics=3)  # fmt: skip
    assert found.holds
    assert not decide("modes_are_mixed", pod(SINES[:3]), paper=mixing.tolist(), tolerance=1e-2,
                      harmonics=3).holds  # fmt: skip


def test_two_scenes_lend_a_variant_each():
    other = {"variants": {"variant": np.array(["own"]),
                          "variant_velocity_error": np.array([0.05])}}  # fmt: skip
    options = {"field": "velocity", "variants": ["fine", "own"], "factor": 2}
    assert holds("variant_errors", VARIANTS, other, **options)


def test_errors_near_rounding_may_rise():
    assert holds("errors_fall", sweep([1, 2, 3], resolved=False))


def test_a_verdict_names_the_erratum_it_depends_on():
    assert claims._verdict({"erratum": 3}, True) == "reproduced with erratum 3"
    assert claims._verdict({"erratum": 3}, False) == "deviates"
    assert claims._verdict({}, True) == "reproduced"
