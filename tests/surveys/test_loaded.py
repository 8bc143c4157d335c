"""Surveys from Python: trained, asked, validated, and every quantity within its interval."""

import numpy as np
import pytest
from survey_cases import SCENE, settings

from sphpod.config.config import load
from sphpod.surveys import answers, sensitivity, tables, training, validation
from sphpod.surveys.loaded import LoadedSurvey

PLACED = {"place": 0.3, "field": "velocity"}
QUANTITIES = {
    "history": {"kind": "history", **PLACED},
    "stress": {"kind": "history", **PLACED, "field": "stress", "width": 0.2},
    "early": {"kind": "value", **PLACED, "field": "strain", "time": 0.5},
    "peak": {"kind": "maximum", **PLACED, "field": "strain"},
    "anywhere": {"kind": "maximum", "field": "strain", "places": "all"},
    "fastest": {"kind": "maximum", "field": "velocity", "places": [0.2, 0.3, 0.75], "width": 0.1},
    "pressed": {"kind": "maximum", "field": "stress", "places": [0.3, 0.0]},
    "energy": {"kind": "energy"},
    "loss": {"kind": "energy_loss", "time": 0.5},
    "passage": {"kind": "passage", **PLACED, "level": 7e-4},
    "never": {"kind": "passage", **PLACED, "level": 1.0},
}


def trained(of_scene=None, **changes):
    resolved = load([], settings(of_scene, quantities=QUANTITIES, **changes))
    physics, survey = resolved["scenes"]["bar"], resolved["surveys"]["graded"]
    runs = [training.run("bar", physics, survey, n) for n in range(survey["training"]["count"])]
    return physics, survey, training.train("bar", physics, survey, runs)


@pytest.fixture(scope="module")
def made():
    return trained()


@pytest.fixture(scope="module")
def survey(made):
    physics, keys, model = made
    return LoadedSurvey({"scene": "bar", "physics": physics, "survey": keys}, model)


@pytest.mark.slow
@pytest.mark.parametrize("count", [2, 4, 8])
def test_full_runs_lie_in_all_intervals(made, count) -> None:
    physics, keys, model = made
    few = {**model, "mode_count": np.array(count)}
    found = validation.validate("bar", physics, {**keys, "validation": 20}, few)
    assert found["inside"].all()
    assert (found["effectivity"] >= 1).all()


def test_values_lie_in_their_intervals(survey) -> None:
    found = survey(stiffness=np.linspace(0.05, 0.2, 5), contrast=0.2)
    for name in QUANTITIES:
        value, low, high = (found[f"{name}{end}"].values for end in ("", "_low", "_high"))
        assert not (low > value).any(), name
        assert not (value > high).any(), name
    assert np.isnan(found["never"].values).all()
    assert (found["certified"].values == 1).all()


def test_a_maximum_over_places_is_the_largest_of_theirs(made) -> None:
    physics, keys, model = made
    each = {f"at{n}": {"kind": "maximum", "field": "strain", "place": n / 30} for n in range(30)}
    some = {"kind": "maximum", "field": "strain", "places": [n / 30 for n in range(0, 30, 3)]}
    asked = {**each, "anywhere": QUANTITIES["anywhere"], "some": some}
    loaded = LoadedSurvey(
        {"scene": "bar", "physics": physics, "survey": {**keys, "quantities": asked}}, model
    )
    found = loaded(stiffness=0.07)
    for end in ("", "_low", "_high"):
        places = np.array([float(found[f"{name}{end}"]) for name in each])
        assert float(found[f"anywhere{end}"]) == pytest.approx(places.max(), rel=1e-12)
        assert float(found[f"some{end}"]) == pytest.approx(places[::3].max(), rel=1e-12)
    assert "at any particle" in found["anywhere"].attrs["long_name"]
    assert "at any of 10 places" in found["some"].attrs["long_name"]


def test_an_answer_does_not_depend_on_the_others(survey, made) -> None:
    physics, keys, model = made
    reduced, asked = answers.of_settings("bar", physics, keys, model)
    points = answers.chunk_points({**keys, "chunk_size": 16}, physics["parameters"], 0)
    whole = answers.answer_all(reduced, asked, points, 1e-2)
    for order in ([3, 0], [5, 3, 2]):
        part = answers.answer_all(reduced, asked, points[order], 1e-2)
        for name in (*QUANTITIES, "relative_bound"):
            assert part[name].tobytes() == whole[name][order].tobytes(), name


def test_numbers_give_a_dataset_without_queries(survey) -> None:
    one = survey(stiffness=0.12, decay=0.3)
    assert "query" not in one.dims
    assert float(one["contrast"]) == 0.3
    assert one["history"].dims == ("t",)
    assert one["energy"].attrs["units"] == "J m-2"


def test_a_parameter_may_have_the_name_that_methods_give_their_object() -> None:
    ranges = SCENE["parameters"] | {"self": {"nominal": 1, "range": [0.5, 2]}}
    of_scene = {"parameters": ranges, "initial_density": "self"}
    physics, keys, model = trained(of_scene, training={"count": 2})
    asked = LoadedSurvey({"scene": "bar", "physics": physics, "survey": keys}, model)
    assert float(asked(self=1.5)["self"]) == 1.5


def test_what_is_outside_is_answered_on_request_alone(survey) -> None:
    with pytest.raises(ValueError, match=r"stiffness = 0.3 is outside its range 0.05 to 0.2"):
        survey(stiffness=0.3)
    assert float(survey(stiffness=0.3, extrapolate=True)["relative_bound"]) > 0
    with pytest.raises(ValueError, match="no such parameter; allowed are stiffness"):
        survey(stiff=0.1)


def test_a_query_that_fails_is_a_row_with_its_reason(survey) -> None:
    found = survey(contrast=[0.3, 1.5], extrapolate=True)
    assert found["reason"].values[0] == ""
    assert "must be positive everywhere" in found["reason"].values[1]
    assert np.isnan(found["peak"].values[1])
    assert found["certified"].values.tolist() == [1, 0]


@pytest.mark.parametrize("bounds", [True, False])
@pytest.mark.parametrize(
    ("changed", "value", "told"),
    [
        ({"force": "1e-3*cos(4*t + pull)"}, np.nan, "pull = nan is not finite"),
        ({"initial_velocity": "1e-3*sin(2*pi*x/L)*pull"}, np.inf, "pull = inf is not finite"),
        ({"initial_velocity": "1e-3*sin(2*pi*x/L)*sqrt(pull)"}, -1.0, "the solution is not finite"),
        ({"force": "1e-3*sqrt(pull - t)"}, 0.5, "the solution is not finite"),
    ],
)
def test_what_is_not_finite_is_a_reason(changed, value, told, bounds) -> None:
    ranges = SCENE["parameters"] | {"pull": {"nominal": 1, "range": [1, 2]}}
    physics, keys, model = trained({"parameters": ranges, **changed}, training={"count": 2})
    asked = LoadedSurvey({"scene": "bar", "physics": physics, "survey": keys}, model)
    found = asked(pull=[1.0, value], bounds=bounds, extrapolate=True)
    assert found["reason"].values[0] == ""
    assert told in found["reason"].values[1]


def test_a_line_that_may_fold_is_a_row_with_its_reason() -> None:
    physics, keys, model = trained()
    physics = {**physics, "initial_velocity": "10*sin(2*pi*x/L)"}
    fast = LoadedSurvey({"scene": "bar", "physics": physics, "survey": keys}, model)
    assert "the line may fold" in str(fast(stiffness=0.1)["reason"].values)


@pytest.mark.slow
def test_modes_are_as_few_as_meet_the_tolerance() -> None:
    counts = []
    for tolerance in (1e-1, 1e-4):
        physics, keys, _ = trained(tolerance=tolerance)
        del keys["mode_count"]
        runs = [training.run("bar", physics, keys, n) for n in range(4)]
        model = training.train("bar", physics, keys, runs)
        counts.append(int(model["mode_count"]))
        reduced, _ = answers.of_settings("bar", physics, keys, model)
        for run in runs:
            values = dict(zip(physics["parameters"], map(float, run["point"]), strict=True))
            assert reduced.answer(values).relative_bound <= tolerance
    assert counts[0] < counts[1]


@pytest.mark.slow
def test_greedy_training_ends_where_the_bound_meets_the_tolerance() -> None:
    resolved = load([], settings(training={"count": 12, "method": "greedy"}, tolerance=1e-4))
    physics, survey = resolved["scenes"]["bar"], resolved["surveys"]["graded"]
    model = training.train_greedily("bar", physics, survey)
    assert 1 < len(model["training_points"]) < 12
    found = validation.validate("bar", physics, {**survey, "validation": 10}, model)
    assert found["relative_bound"].max() <= 2e-4
    few = load([], settings(training={"count": 2, "method": "greedy"}, tolerance=1e-9))
    model = training.train_greedily("bar", physics, few["surveys"]["graded"])
    assert len(model["training_points"]) == 2


def test_indices_of_a_quantity_that_one_parameter_makes(made) -> None:
    physics, keys, model = made
    kept = {**keys, "quantities": {"energy": QUANTITIES["energy"]}, "sobol_samples": 64}
    found = sensitivity.share_out("bar", physics, kept, model)
    first = dict(zip(found["parameter"], found["first_index"][0], strict=True))
    # Damping takes the energy.
    assert first["decay"] > 0.8
    assert first["stiffness"] < 0.2
    rows = tables.indices(found)
    assert len(rows["parameter"]) == 3
    again = sensitivity.share_out("bar", physics, kept, model)
    assert all(np.array_equal(found[name], again[name]) for name in found)


def test_rounding_has_no_share_of_the_variance() -> None:
    ranges = {word: given for word, given in SCENE["parameters"].items() if word != "decay"}
    physics, keys, model = trained({"parameters": ranges, "damping": 0}, training={"count": 2})
    found = sensitivity.share_out("bar", physics, keys, model)
    unknown = dict(zip(found["quantity"], np.isnan(found["total_index"]).all(axis=1), strict=True))
    assert unknown["energy"]
    assert not unknown["peak"]


def test_quantiles_leave_out_what_has_no_answer() -> None:
    found = {
        "peak": np.array([1.0, 2.0, 3.0, np.nan]),
        "peak_low": np.zeros(4),
        "relative_bound": np.array([0.1, 0.1, 0.1, np.nan]),
    }
    rows = tables.quantiles(found)
    assert rows["answered"] == [3, 3]
    assert rows["50 %"][0] == 2


def test_a_scene_at_rest_stays_there() -> None:
    physics, keys, model = trained({"initial_velocity": "0"})
    assert len(model["velocity_modes"]) == 0
    still = LoadedSurvey({"scene": "bar", "physics": physics, "survey": keys}, model)()
    assert str(still["reason"].values) == ""
    assert not still["history"].values.any()
    assert float(still["energy_high"]) == 0
    assert int(still["certified"]) == 1


FAST = {
    "initial_velocity": "speed*sin(2*pi*x/L)",
    "youngs_modulus": "0.1",
    "damping": "0.1",
    "parameters": {"speed": {"nominal": 0.01, "range": [0.01, 1]}},
}


def test_a_scene_that_only_moves_on_has_no_waves() -> None:
    still = {"initial_velocity": "1e-3*(1 + contrast)", "youngs_modulus": "stiffness"}
    physics, keys, model = trained(still | {"damping": "decay"})
    assert len(model["velocity_modes"]) == 1
    found = validation.validate("bar", physics, keys, model)
    assert found["relative_bound"].max() < 1e-9
    assert found["inside"].all()


def test_a_training_run_that_folds_says_where() -> None:
    with pytest.raises(ValueError, match=r"broke down by t = .*, at speed = 0\.\d+; narrow"):
        trained(FAST)


def test_greedy_training_and_validation_go_on_where_queries_fold() -> None:
    changed = settings(FAST, training={"count": 4, "method": "greedy"}, quantities=QUANTITIES)
    resolved = load([], changed)
    physics, keys = resolved["scenes"]["bar"], resolved["surveys"]["graded"]
    model = training.train_greedily("bar", physics, keys)
    found = validation.validate("bar", physics, {**keys, "validation": 12}, model)
    failed = found["reason"].astype(bool)
    shared = sensitivity.share_out("bar", physics, {**keys, "sobol_samples": 4}, model)
    assert np.isnan(shared["total_index"]).all()
    assert 0 < failed.sum() < 12
    assert np.array_equal(np.isnan(found["true_error"]), failed)
    assert found["inside"][~failed].all()


UNEVEN = {
    "damping": "decay*where(x < 0.3, 0, 1)",
    "force": {"time": "size*cos(4*t)", "profile": "exp(-20*(x/L - 0.5)**2)"},
    "parameters": {
        **SCENE["parameters"],
        "size": {"nominal": 1e-3, "range": [-1e-3, 2e-3]},
    },
}


@pytest.mark.slow
def test_negative_uneven_damping_is_a_reason() -> None:
    physics, keys, model = trained(UNEVEN)
    asked = LoadedSurvey({"scene": "bar", "physics": physics, "survey": keys}, model)
    found = asked(decay=[-1.0, 1.0], extrapolate=True)
    assert "damping: it is -1 somewhere and must not be negative" in found["reason"].values[0]
    assert found["reason"].values[1] == ""


@pytest.mark.slow
def test_a_force_that_parameters_only_scale_has_one_course() -> None:
    physics, keys, model = trained(UNEVEN)
    reduced, _ = answers.of_settings("bar", physics, keys, model)
    points = ({"size": size} | dict.fromkeys(SCENE["parameters"], 0.1) for size in (-1e-3, 2e-3))
    ((one,), small), ((other,), large) = map(reduced.courses, points)
    assert one is other
    assert large == -2 * small
    found = validation.validate("bar", physics, {**keys, "validation": 6}, model)
    assert found["inside"].all()
    assert (found["effectivity"] >= 1).all()
