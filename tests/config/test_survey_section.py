"""Surveys in the configuration: defaults, and one sentence for each fault."""

import copy

import pytest
from survey_cases import SCENE, SURVEY, settings

from sphpod.config import survey_section
from sphpod.config.config import ConfigError, load
from sphpod.scene.scene import Scene, physical_settings
from sphpod.surveys import answers, design, responses, sensitivity, training, validation


def refused(changed):
    with pytest.raises(ConfigError) as caught:
        load([], changed)
    return str(caught.value)


def with_parameter(name, **given):
    parameters = copy.deepcopy(SCENE["parameters"])
    parameters[name] = parameters.get(name, {}) | given
    return settings({"parameters": parameters})


def with_quantity(**given):
    return settings(quantities={"one": given})


def with_design(**given):
    return settings(design={"minimise": "decay"} | given)


def test_defaults_are_filled_in() -> None:
    survey = load([], settings())["surveys"]["graded"]
    assert survey["tolerance"] == 1e-2
    assert survey["training"] == {"count": 8, "method": "sobol", "seed": 0}
    assert survey["queries"] == {"count": 16, "sampling": "sobol", "seed": 0}
    assert survey["quantities"]["sensor"]["field"] == "velocity"


def test_a_design_has_defaults_and_a_survey_without_one_has_none() -> None:
    survey = load([], with_design())["surveys"]["graded"]
    assert survey["design"] == {"minimise": "decay", "where": {}, "given": {}, "rounds": 3}
    assert "design" not in load([], settings())["surveys"]["graded"]


def test_a_configuration_without_surveys_has_none() -> None:
    assert load([], {"scenes": settings()["scenes"]})["surveys"] == {}


def test_a_scene_runs_at_the_nominal_values() -> None:
    resolved = load([], settings())["scenes"]["bar"]
    scene = Scene.from_settings("bar", resolved)
    modulus = "0.1*(1 + 0.3*sin(2*pi*x/L))"
    plain = {key: value for key, value in SCENE.items() if key != "parameters"}
    other = Scene.from_settings("bar", plain | {"youngs_modulus": modulus, "damping": 0.5})
    assert (scene.modulus() == other.modulus()).all()
    assert (scene.damping_values() == 0.5).all()


def test_what_a_scene_depends_on_holds_no_ranges() -> None:
    physics = physical_settings(load([], settings())["scenes"]["bar"])
    assert physics["parameters"] == {"stiffness": 0.1, "contrast": 0.3, "decay": 0.5}
    Scene.from_settings("bar", physics)


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        (with_parameter("t", nominal=1, range=[0, 2]), "parameters.name = t: allowed are letters"),
        (with_parameter("lambda", nominal=1, range=[0, 2]), "but no word of Python"),
        (with_parameter("extra", nominal=1, range=[0, 2]), "no expression of the scene holds it"),
        (with_parameter("contrast", range=[0, 1.5]), "must be positive everywhere"),
        (with_parameter("contrast", range=[0.6, 0]), "it must rise"),
        (with_parameter("stiffness", range=[0, 0.2]), "positive where the scale is logarithmic"),
        (with_parameter("decay", nominal=3), "it must lie in the range 0 to 1"),
        (settings({"damping": "decai"}), "the name 'decai' is not known"),
        (settings({"damping": "decay*t"}), "damping = decay*t: it must not name t"),
        (
            settings({"youngs_modulus": "stiffness*(1 + contrast*sin(2*pi*x/L) + 0*t)"}),
            "it must not name t in a scene of a survey",
        ),
        (settings({"force": ["sin(t)", "cos(t)"]}), "one time and profile"),
        (settings({"force": "sin(x - t)"}), "force = sin(x - t): in a scene of a survey"),
        (settings({"boundary": ["free", "free"]}), "surveys are of periodic scenes"),
        (settings(scen=1), "unknown key, did you mean scene?"),
        (settings(scene="foo"), "there is no such scene; allowed are bar"),
        (settings(queries={"grid": {"foo": 2}}), "no such parameter; allowed are stiffness"),
        (settings(queries={"from": "no.csv"}), "it cannot be read as a table"),
        (settings(chunk_size=0), "it must be at least 1"),
        (settings(queries={"count": 10**6}), "that makes 125000 jobs of 1000000 queries"),
        (settings(queries={"count": 10**12}), "the answers of 1000000000000 queries take"),
        (settings(queries={"grid": dict.fromkeys(SCENE["parameters"], 10**6)}), "queries take"),
        (settings(training={"count": 10000}, output_interval=0.002), "training runs take 9.62 GB"),
        (settings(sobol_samples=2**20) | {"memory": 1}, "5242880 queries of Sobol indices take"),
        (settings(sobol_samples=1), "it must be a power of two from 2 on, or 0"),
        (settings(sobol_samples=24), "it must be a power of two from 2 on, or 0"),
        (settings(tolerance=2), "it must be at most 1"),
        (settings(mode_count=31), "at most the 30 particles"),
        (settings(output_interval=0.003), "a whole number of time steps"),
        (settings(quantities={"t": {"kind": "energy"}}), "this name is taken in the results"),
        (settings(quantities={"decay": {"kind": "energy"}}), "this name is taken in the results"),
        (
            settings(quantities={"a": {"kind": "energy"}, "a_full": {"kind": "energy"}}),
            "with _low, _high, _full at the end",
        ),
        (settings(design={}), "it needs one of minimise, maximise, reach, and only one"),
        (with_design(maximise="peak"), "it needs one of minimise, maximise, reach, and only one"),
        (with_design(minimize="peak"), "unknown key, did you mean minimise?"),
        (with_design(minimise="peek"), "allowed are peak, last, stiffness, contrast, decay"),
        (with_design(minimise="sensor"), "it is a history, and no single number; allowed are peak"),
        (with_design(where={"peek": {"at_most": 1}}), "design.where = peek: it is neither"),
        (with_design(where={"peak": {}}), "design.where.peak = {}: it needs at_most, at_least"),
        (with_design(where={"peak": {"at_most": 1, "at_least": 2}}), "not be above at_most"),
        (with_design(where={"peak": {"below": 1}}), "unknown key"),
        (with_design(given={"stiff": 1}), "no such parameter; allowed are stiffness"),
        (with_design(given={"stiffness": 1}), "given.stiffness = 1: it must lie in the range 0.05"),
        (with_design(given={"decay": 1}), "it is what the design looks for, and cannot be given"),
        (
            settings(design={"minimise": "peak", "given": dict.fromkeys(SCENE["parameters"], 0.1)}),
            "a parameter must be left to choose",
        ),
        (settings(design={"reach": {"peak": 1, "last": 1}}), "design.reach"),
        (settings(design={"reach": {"peek": 1}}), "design.reach = peek: it is neither a quantity"),
        (with_design(rounds=-1), "it must be at least 0"),
        (settings(quantities={"inside": {"kind": "energy"}}), "this name is taken in the results"),
        (with_quantity(kind="energi"), "allowed are history, value"),
        (with_quantity(kind="energy", place=1), "a quantity of kind energy has no such key"),
        (with_quantity(kind="passage", place=0), "a quantity of kind passage needs it"),
        (with_quantity(kind="value", place=0, field="density"), "velocity, strain, stress"),
        (with_quantity(kind="maximum"), "either a place, or places"),
        (with_quantity(kind="maximum", place=0, places=[0]), "either a place, or places"),
        (with_quantity(kind="maximum", places=[0, 1]), "it must be at least 0 and below L = 1"),
        (with_quantity(kind="maximum", places=[0, 0]), "no entry may stand twice"),
        (with_quantity(kind="maximum", places=[]), "it must have at least 1 entry ("),
        (with_quantity(kind="maximum", places="each"), "it must be"),
        (with_quantity(kind="maximum", places="all", width=0.1), "that of single particles"),
        (with_quantity(kind="history", places=[0.1]), "a quantity of kind history"),
        (with_quantity(kind="value", place=1), "it must be at least 0 and below L = 1"),
        (with_quantity(kind="value", place=0, time=0.005), "a whole number of output intervals"),
    ],
)
def test_a_fault_is_one_sentence(changed, told) -> None:
    sentence = refused(changed)
    assert told in sentence
    assert "\n" not in sentence


NUMBERS: dict[str, dict] = {
    "training": {"count": 8, "seed": 1},
    "queries": {"count": 16, "seed": 2},
    "mode_count": {},
    "tolerance": {},
    "output_interval": {},
    "chunk_size": {},
    "validation": {},
    "sobol_samples": {},
}


@pytest.mark.parametrize("key", NUMBERS)
@pytest.mark.parametrize("value", ["many", [1], None, True, -1, float("nan"), float("inf"), 10**30])
def test_no_number_of_a_survey_may_be_anything(key, value) -> None:
    for inner in NUMBERS[key]:
        assert f"{key}.{inner}" in refused(settings(**{key: NUMBERS[key] | {inner: value}}))
    assert f"surveys.graded.{key} = " in refused(settings(**{key: value}))


def test_a_scene_without_parameters_has_no_surveys() -> None:
    other = {key: value for key, value in SCENE.items() if key != "parameters"}
    plain = {"other": other | {"youngs_modulus": 1e-1, "damping": 0}}
    changed = {
        "scenes": settings()["scenes"] | plain,
        "surveys": {"s": SURVEY | {"scene": "other"}},
    }
    assert "it has no parameters; those that have are bar" in refused(changed)


def test_a_table_of_ones_own_needs_a_column_for_each_parameter(tmp_path) -> None:
    path = tmp_path / "mine.csv"
    path.write_text("stiffness,contrast\n0.1,0.2\n")
    assert "it has no column decay" in refused(settings(queries={"from": str(path)}))
    path.write_text("decay,stiffness,decay,contrast\n0.5,0.1,0.6,0.2\n")
    assert "two of its columns are named decay" in refused(settings(queries={"from": str(path)}))
    missing = refused(settings(queries={"from": str(tmp_path)}))
    assert "there is no such file" in missing
    assert missing.count(str(tmp_path)) == 1
    for text in (
        "decay,stiffness,contrast\n0.5,0.1,0.2\n",
        "decay, stiffness, contrast\n.5, .1, .2",
    ):
        path.write_text(text)
        load([], settings(queries={"from": str(path)}))


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        ("", "it has no rows"),
        ("0.5,0.1,0.2,7\n", "its rows have more entries than there are names of columns"),
        ("0.5,0.1,0.2\n0.5,0.1,\n", "row 2: contrast = nan is outside its range 0 to 0.6"),
        ("0.5,inf,0.2\n", "row 1: stiffness = inf is outside its range"),
        (f"{'9' * 400},0.1,0.2\n", "its columns must hold numbers only"),
        ("0.5,0.1,0.2\n0.5,9,0.2\n", "row 2: stiffness = 9 is outside its range 0.05 to 0.2"),
    ],
)
def test_a_table_of_ones_own_has_values_within_the_ranges(tmp_path, rows, told) -> None:
    path = tmp_path / "mine.csv"
    path.write_text("decay,stiffness,contrast\n" + rows)
    assert told in refused(settings(queries={"from": str(path)}))


@pytest.mark.parametrize("name", ["true_error", "certified", "point", "strain", "extrapolate"])
def test_no_parameter_has_a_name_of_the_results(name) -> None:
    parameters = {**SCENE["parameters"], name: {"nominal": 0, "range": [0, 1]}}
    changed = settings({"parameters": parameters, "force": name})
    assert "this name is taken in the results of surveys.graded" in refused(changed)


def test_all_names_of_the_results_are_taken() -> None:
    written = {**training.MODEL_VARIABLES, **validation.VARIABLES, **sensitivity.VARIABLES,
               **responses.VARIABLES}  # fmt: skip
    written |= design.VARIABLES
    assert {*written, *answers.OF_QUERY} <= {*survey_section.TAKEN}
    assert {*training.RUN_VARIABLES} <= {*survey_section.TAKEN_FROM_PARAMETERS}


def test_answers_beyond_the_memory_are_refused_before_any_is_sought() -> None:
    keys = {"output_interval": 2e-3, "chunk_size": 10**6}
    many = settings({"error_interval": 2e-3}, queries={"count": 10**7}, **keys)
    assert refused(many).startswith(
        "surveys.graded.queries = {sampling: sobol, seed: 0, count: 100"
    )
    assert "the answers of 10000000 queries" in refused(many)
    assert load([], many | {"memory": 1e6})["surveys"]["graded"]["queries"]["count"] == 10**7
    grid = settings(queries={"grid": {"stiffness": 1000, "contrast": 1000, "decay": 10}})
    assert "the answers of 10000000 queries" in refused(grid)
