"""Configurations: what the two of this project say, the defaults, and every refusal."""

import copy
import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from sphpod.config import config, configuration, mode_counts, refusals, stability_section

ROOT = Path(__file__).parents[2]

WAVE: dict[str, Any] = {
    "domain_length": 1,
    "duration": 1,
    "initial_velocity": "1e-3*sin(2*pi*x/L)",
    "initial_density": 1,
    "youngs_modulus": 0.1,
    "particle_count": 20,
    "smoothing_ratio": 1.04,
    "time_step": 0.002,
    "error_interval": 0.01,
    "references": ["fd"],
    "samplings": {
        "uniform10": {"range": [0, 1], "count": 10},
        "few": {"velocity_times": [0, 0.5], "density_times": [0, 0.2, 0.5]},
    },
}
"""A scene in which every refusal below changes one thing."""


@pytest.fixture
def load(tmp_path):
    """Write a text, or settings as YAML, to a file and load it."""

    def load(*contents):
        paths = []
        for number, content in enumerate(contents):
            text = content if isinstance(content, str) else yaml.safe_dump(content, sort_keys=False)
            paths.append(tmp_path / f"{number}.yaml")
            paths[-1].write_text(text)
        return config.load(paths)

    return load


def wave(changes=None, **more):
    """The configuration of one scene, with keys set, or taken away by None.

    A key with dots, such as ``samplings.few.seed``, lies deeper.
    """
    scene: dict[str, Any] = copy.deepcopy(WAVE)
    for key, value in ((changes or {}) | more).items():
        *parents, last = key.split(".")
        block: Any = scene
        for parent in parents:
            block = block.setdefault(parent, {})
        if value is None:
            del block[last]
        else:
            block[last] = value
    return {"scenes": {"wave": scene}}


def refusal(load, *contents):
    with pytest.raises(config.ConfigError) as caught:
        load(*contents)
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 1000
    return message


# ----------------------------------------------------------------- the project's configurations


def test_schema_is_a_schema_that_describes_every_field():
    schema = configuration.schema()
    jsonschema.Draft202012Validator.check_schema(schema)

    def undescribed(block, path):
        for name, field in block.get("properties", {}).items():
            if "description" not in field and "const" not in field:
                yield f"{path}.{name}"

    written = refusals.written_out(schema)
    blocks = {"": schema, **schema["$defs"]}
    blocks |= {name: refusals.written_out({**schema, **block}) for name, block in blocks.items()}
    assert [name for path, block in blocks.items() for name in undescribed(block, path)] == []
    assert all(block["additionalProperties"] is False for block in blocks.values())
    assert written["properties"]["scenes"]["description"] == "what is simulated, by name"


@pytest.mark.parametrize("name", ["config", "small"])
def test_editors_find_nothing_wrong_with_the_project_configurations(name):
    """By the JSON schema, which says no less than the models."""
    settings = config.read_yaml(ROOT / "config" / f"{name}.yaml")
    schema = configuration.schema()
    jsonschema.validate(settings, schema)
    scene = next(iter(settings["scenes"].values()))
    for key, value in (("particle_count", 4), ("references", ["fd", "fd"]), ("extra", 1)):
        changed = settings | {"scenes": {"wave": scene | {key: value}}}
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(changed, schema)


@pytest.mark.parametrize("name", ["config", "small"])
def test_project_configuration_resolves_to_plain_json(name):
    resolved = config.load([ROOT / "config" / f"{name}.yaml"])
    assert json.loads(json.dumps(resolved)) == resolved
    for scene in resolved["scenes"].values():
        for sampling, taken in scene["samplings"].items():
            modes = mode_counts.parse_modes(taken["mode_counts"])
            assert modes[-1] <= mode_counts.mode_limit(scene, sampling)


def test_the_paper():
    resolved = config.load([ROOT / "config" / "config.yaml"])
    scenes = resolved["scenes"]
    assert {name: scene["particle_count"] for name, scene in scenes.items()} == {
        "three_harmonics": 100,
        "ten_harmonics": 400,
        "damped": 100,
        "damped_forced": 100,
        "two_moduli": 100,
        "gaussian_coarse": 100,
        "gaussian": 200,
        "high_frequency": 1000,
        "mildly_damped_forced": 200,
    }
    for scene in scenes.values():
        assert (scene["duration"], scene["error_interval"]) == (10, 0.001)
    figures = [figure for scene in scenes.values() for figure in scene["figures"]]
    figures += resolved["illustrations"]
    assert len(figures) == 38
    assert all(figure["caption"] for figure in figures)
    numbers = {figure["name"].split("_")[0] for figure in figures}
    assert numbers == {"2.1"} | {f"3.{n}" for n in range(1, 29)} | {f"C.{n}" for n in range(1, 10)}
    assert scenes["three_harmonics"]["samplings"]["minimal"]["mode_counts"] == "1-4"
    assert scenes["three_harmonics"]["samplings"]["early5"]["mode_counts"] == "1-5"
    assert scenes["ten_harmonics"]["samplings"]["uniform100"]["mode_counts"] == "1-20"


def test_small_configuration_has_every_kind_of_figure_and_its_own_folder():
    resolved = config.load([ROOT / "config" / "small.yaml"])
    kinds = {figure["kind"] for s in resolved["scenes"].values() for figure in s["figures"]}
    assert kinds == set(config.FIGURES)
    assert resolved["output"] == "small"


# --------------------------------------------------------------------- defaults and forms


def test_defaults(load):
    resolved = load(wave({"error_interval": None, "time_step": 1e-4, "references": None}))
    scene = resolved["scenes"]["wave"]
    assert scene["error_interval"] == 1e-4
    assert scene["references"] == ["exact"]
    assert scene["samplings"]["few"]["mode_counts"] == "1-3"
    assert scene["acceleration"] == {}
    assert "damping" not in scene
    assert "force" not in scene
    assert [figure["name"] for figure in scene["figures"]] == [
        "wave_profile",
        "wave_uniform10_modes",
        "wave_uniform10_error",
        "wave_few_modes",
        "wave_few_error",
    ]
    assert scene["figures"][0]["fields"] == ["initial_velocity", "velocity"]


def test_errors_may_be_summed_over_the_end_alone(load):
    resolved = load(wave(error_interval=1, samplings={}))
    assert resolved["scenes"]["wave"]["figures"][0]["kind"] == "profile"


@pytest.mark.parametrize(
    ("duration", "time_step", "intervals"),
    [(10, 1e-3, 10000), (8, 5e-4, 8000), (1, 2e-3, 500), (6, 5e-4, 6000), (10, 3.2e-4, 6250)],
)
def test_errors_are_by_default_summed_over_about_10000_times(load, duration, time_step, intervals):
    times = {"duration": duration, "time_step": time_step, "youngs_modulus": 0.01}
    resolved = load(wave(error_interval=None, references=None, **times))
    assert resolved["scenes"]["wave"]["error_interval"] == duration / intervals
    assert (resolved["output"], resolved["claims"], resolved["illustrations"]) == ("", [], [])


def test_reference_without_an_exact_solution_is_the_centred_one(load):
    resolved = load(wave(references=None, initial_density="1 + 0.1*sin(2*pi*x/L)"))
    assert resolved["scenes"]["wave"]["references"] == ["centred"]


def test_modes_are_bounded_by_particles_too(load):
    resolved = load(wave({"particle_count": 9}))
    assert resolved["scenes"]["wave"]["samplings"]["uniform10"]["mode_counts"] == "1-9"


def test_figure_of_an_acceleration_by_default(load):
    resolved = load(wave({"acceleration.few": {"mode_counts": [3], "n_freeze": [1, 2]}}))
    names = [figure["name"] for figure in resolved["scenes"]["wave"]["figures"]]
    assert names[-1] == "wave_few_acceleration"


def test_later_files_win(load):
    resolved = load(wave(), {"output": "private", "scenes": {"wave": {"youngs_modulus": 0.2}}})
    assert resolved["output"] == "private"
    assert load(wave(), {"output": "/scratch/private"})["output"] == "/scratch/private"
    assert resolved["scenes"]["wave"]["youngs_modulus"] == 0.2
    assert resolved["scenes"]["wave"]["particle_count"] == 20


def test_times_touched_by_rounding_lie_within_the_duration(load):
    late = 0.1 + 0.2
    times = {"velocity_times": [0, late], "density_times": [late]}
    samplings: dict[str, Any] = {"ends": {"range": [0, late], "count": 150}, "last": times}
    for duration in (0.3, late):
        scene = load(wave({"duration": duration, "samplings": samplings}))["scenes"]["wave"]
        assert scene["samplings"]["ends"]["count"] == 150
    samplings["last"]["velocity_times"] = [0.3001]
    message = refusal(load, wave({"duration": 0.3, "samplings": samplings}))
    assert "velocity_times = 0.3001: it must lie within" in message


@pytest.mark.parametrize("name", ["logs", "figures", "surveys"])
def test_scenes_whose_results_would_lie_among_the_logs_are_refused(load, name):
    message = refusal(load, {"scenes": {name: WAVE}})
    assert message.startswith(f"scenes.name = {name}: allowed are lower-case letters")
    assert "but not logs, figures or surveys" in message


def test_overrides_win_over_files(tmp_path):
    path = tmp_path / "wave.yaml"
    path.write_text(yaml.safe_dump(wave() | {"output": "a"}))
    assert config.load([path], {"output": "b"})["output"] == "b"


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2e-4", 2e-4),
        ("1E5", 1e5),
        ("-1.5e+3", -1500.0),
        (".5", 0.5),
        ("5.", 5.0),
        ("0.1", 0.1),
        ("10", 10),
        ("010", 10.0),
        ("true", True),
        ("null", None),
        ("", None),
        ("1-20", "1-20"),
        ("1:30", "1:30"),
        ("2024-01-01", "2024-01-01"),
        ("yes", "yes"),
        ("on", "on"),
        (".inf", ".inf"),
        ("1_000", "1_000"),
        ("'2e-4'", "2e-4"),
        ("1e-3*x", "1e-3*x"),
    ],
)
def test_yaml_scalars(tmp_path, text, value):
    path = tmp_path / "value.yaml"
    path.write_text(f"key: {text}\n")
    read = config.read_yaml(path)["key"]
    assert read == value
    assert isinstance(read, type(value))


@settings(deadline=None)
@given(st.floats(-1e300, 1e300), st.sampled_from(["r", ".3e", ".17G"]))
def test_yaml_reads_every_number_as_python_does(tmp_path_factory, number, form):
    text = repr(number) if form == "r" else format(number, form)
    path = tmp_path_factory.getbasetemp() / "number.yaml"
    path.write_text(f"key: {text}\n")
    assert config.read_yaml(path)["key"] == float(text)


def test_an_output_that_is_or_passes_through_a_file_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken").touch()
    for output in ("taken", "taken/below", str(tmp_path / "taken"), "/dev/null"):
        with pytest.raises(config.ConfigError, match=r"^output = .* is a file; it must be a fold"):
            config.load([], {"scenes": {"wave": WAVE}, "output": output})
    assert config.load([], {"scenes": {"wave": WAVE}, "output": "free"})["output"] == "free"


def test_number_forms_reach_the_scene(load):
    text = yaml.safe_dump(wave()).replace("time_step: 0.002", "time_step: 2E-3")
    text = text.replace("particle_count: 20", "particle_count: 2e1")
    scene = load(text)["scenes"]["wave"]
    assert scene["time_step"] == 2e-3
    assert isinstance(scene["particle_count"], int)


# ------------------------------------------------------------------------------- refusals

STUDY = {"mode_counts": [3], "n_freeze": [1]}

BOTH = "sum(1e-4*sin(l*x)*cos(l*t) for l in range({}))"

REFUSALS = [
    # sizes
    (
        {"youngs_modulus": f"0.1 + {BOTH.format(600)}"},
        ["its sums have 600 terms", "100 are allowed"],
    ),
    ({"force": ["sin(t)*x"] * 101}, ["force = [", "at most 100 entries"]),
    ({"initial_velocity": f"nth(({'1, ' * 10001}), x)"}, ["nth takes 10000 numbers at most"]),
    ({"youngs_modulus": 1e-320}, ["it is 9.99989e-321, and must be from 1e-140 to 1e+140"]),
    ({"initial_density": 1e200}, ["it is 1e+200, and must be from 1e-140 to 1e+140"]),
    ({"damping": "1e-200*x"}, ["and must be 0, or from 1e-140 to 1e+140"]),
    # keys
    ({"particel_count": 3}, ["particel_count = 3", "unknown key", "did you mean particle_count"]),
    ({"samplings.few.cuont": 3}, ["samplings.few.cuont = 3", "unknown key", "count", "range"]),
    ({"figures": [{"kind": "profile", "end_time": 9}]}, ["figures.0.end_time = 9", "to T = 1"]),
    ({"figures": [{"kind": "profile", "end_time": 1e-3}]}, ["end_time = 0.001", "two error inter"]),
    ({"figures": [{"kind": "profile", "size": 3}]}, ["figures.0.size = 3", "unknown key", "kind"]),
    ({"acceleration.few": STUDY | {"k": 1}}, ["acceleration.few.k = 1", "unknown key"]),
    ({"force": {"time": 1, "profile": 1, "mean": 2}}, ["force.mean = 2", "unknown key", "time"]),
    ({"duration": None}, ["duration = (missing)", "simulated time T [s]"]),
    (
        {"samplings.few.density_times": None},
        ["samplings.few =", "velocity_times and density_times"],
    ),
    ({"samplings.uniform10.count": None}, ["samplings.uniform10 =", "given by range and count"]),
    ({"samplings.few.count": 3}, ["samplings.few =", "given by range and count"]),
    ({"samplings.few.seed": 3}, ["samplings.few =", "given by range and count"]),
    ({"acceleration.few": {"n_freeze": [1]}}, ["acceleration.few.mode_counts = (missing)"]),
    ({"figures": [{"name": "wave"}]}, ["figures.0.kind = (missing)", "profile"]),
    ({"force": {"time": 1}}, ["force.profile = (missing)"]),
    # types and ranges
    ({"duration": "ten"}, ["duration = ten", "a number"]),
    ({"duration": True}, ["duration = true", "a number"]),
    ({"initial_density": [1]}, ["initial_density = [1]", "number", "text", "expression in x"]),
    ({"section": 3.1}, ["section = 3.1", "text"]),
    ({"particle_count": 20.5}, ["particle_count = 20.5", "a whole number"]),
    ({"particle_count": 4}, ["particle_count = 4", "at least 5"]),
    ({"particle_count": 10**9}, ["particle_count = 1000000000", "at most 100000"]),
    ({"time_step": 1e-12}, ["time_step = 1.0e-12", "at least T/1e+09"]),
    ({"error_interval": 1e-9}, ["error_interval = 1.0e-09", "at least T/1e+06"]),
    ({"domain_length": 0}, ["domain_length = 0", "above 0"]),
    ({"time_step": 0}, ["time_step = 0", "above 0"]),
    ({"time_step": -0.1}, ["time_step = -0.1", "above 0"]),
    ({"smoothing_ratio": 0}, ["smoothing_ratio = 0", "above 0"]),
    ({"interface": "harmonic"}, ["interface = harmonic", "allowed are mean"]),
    ({"references": []}, ["references = []", "at least 1"]),
    ({"references": ["fd", "fd"]}, ["references = [fd, fd]", "twice"]),
    (
        {"references": ["analytic"]},
        ["references.0 = analytic", "fd, centred, chain, exact, modified"],
    ),
    (
        {"acceleration.few": STUDY | {"n_freeze": [1e18]}},
        ["acceleration.few.n_freeze.0 = 1.0e+18", "at most 999999999999999"],
    ),
    ({"samplings.uniform10.seed": 1e20}, ["samplings.uniform10.seed = 1.0e+20", "at most"]),
    # what the numbers mean together
    ({"duration": 1.001}, ["duration = 1.001", "whole number"]),
    ({"error_interval": 0.003}, ["error_interval = 0.003", "whole number"]),
    (
        {"error_interval": None, "duration": 1.0007, "time_step": 1e-4},
        ["error_interval = 0.00010007", "whole number", "this is the default"],
    ),
    ({"error_interval": 0.3}, ["error_interval = 0.3", "whole number"]),
    ({"smoothing_ratio": 9}, ["smoothing_ratio = 9", "wraps", "at most"]),
    ({"youngs_modulus": 1e5}, ["time_step = 0.002", "grow", "1e+06"]),
    ({"initial_density": "sin(2*pi*x/L)"}, ["initial_density = sin(2*pi*x/L)", "positive"]),
    ({"initial_density": 0}, ["initial_density = 0", "positive"]),
    ({"youngs_modulus": "x - 0.5"}, ["youngs_modulus = x - 0.5", "positive"]),
    ({"damping": "x - 0.5"}, ["damping = x - 0.5", "negative"]),
    ({"initial_velocity": 1e308}, ["initial_velocity = 1e+308", "0 or from 1e-140 to 1e+140"]),
    ({"initial_velocity": 1e-320}, ["initial_velocity = 1e-320", "0 or from 1e-140 to 1e+140"]),
    ({"force": "1e200*sin(t)"}, ["force = 1e200*sin(t)", "0 or from 1e-140 to 1e+140"]),
    ({"force": {"time": 1, "profile": 1e-200}}, ["force.profile = 1e-200", "0 or from 1e-140"]),
    ({"initial_velocity": "1/x"}, ["initial_velocity = 1/x", "finite", "x = 0"]),
    ({"force": "1/t"}, ["force = 1/t", "finite", "t = 0"]),
    # expressions
    ({"initial_velocity": "sin(y)"}, ["initial_velocity", "sin(y)", "'y'", "allowed are"]),
    ({"initial_velocity": "t"}, ["initial_velocity", "'t'", "allowed are"]),
    ({"force": "sin(y)"}, ["force", "'sin(y)'", "'y'", "allowed are"]),
    ({"force": ["sin(x - t)", "1/(x - t)"]}, ["force.1 = 1/(x - t)", "finite", "x = 0, t = 0"]),
    ({"force": []}, ["force"]),
    ({"youngs_modulus": "1 - t"}, ["youngs_modulus = 1 - t", "positive everywhere", "t = "]),
    ({"damping": "t - x"}, ["damping = t - x", "must not be negative", "t = 0"]),
    ({"initial_density": "1 + t"}, ["initial_density", "'t'", "allowed are"]),
    ({"force": {"time": "t", "profile": "t"}}, ["force", "profile", "'t'", "allowed are"]),
    ({"damping": "import os"}, ["damping", "'import os'", "not an expression", "allowed are"]),
    ({"youngs_modulus": "open('x')"}, ["youngs_modulus", "'open'", "allowed are"]),
    # references
    (
        {"references": ["fd", "exact"], "initial_density": "1 + x/9"},
        ["references = exact", "fd, centred"],
    ),
    ({"references": ["exact", "modified"], "damping": 1}, ["references = modified", "exact"]),
    # samplings
    ({"samplings.BAD": {"range": [0, 1], "count": 2}}, ["samplings.name = BAD", "lower-case"]),
    ({"samplings.few": {}}, ["samplings.few = {}", "given by range and count"]),
    ({"samplings.uniform10.range": [0, 2]}, ["samplings.uniform10.range = [0, 2]", "T = 1"]),
    ({"samplings.uniform10.range": [1, 0]}, ["samplings.uniform10.range = [1, 0]", "rise"]),
    ({"samplings.uniform10.range": [-1, 1]}, ["samplings.uniform10.range.0 = -1", "at least 0"]),
    ({"samplings.uniform10.range": [1]}, ["samplings.uniform10.range = [1]", "2 entries"]),
    ({"samplings.uniform10.count": 0}, ["samplings.uniform10.count = 0", "at least 1"]),
    ({"samplings.uniform10.count": 501}, ["samplings.uniform10.count = 501", "at 0.", "0.002"]),
    ({"samplings.uniform10.count": 10**12}, ["count = 1000000000000", "500 time steps of 0.002"]),
    (
        {"samplings.uniform10": {"range": [0, 1], "count": 501, "seed": 1}},
        ["501", "500 time steps"],
    ),
    ({"samplings.few.density_times": [0, 1.1]}, ["density_times = 1.1", "within 0 and T = 1"]),
    ({"samplings.few.density_times": [-0.1]}, ["density_times.0 = -0.1", "at least 0"]),
    ({"samplings.few.velocity_times": []}, ["velocity_times = []", "at least 1"]),
    ({"samplings.few.velocity_times": [0.2, 0.2009]}, ["[0.2, 0.2009]", "step at 0.2", "0.002"]),
    # mode counts
    ({"samplings.few.mode_counts": "1-4"}, ["few.mode_counts = 1-4", "more modes than", "1 to 3"]),
    ({"samplings.few.mode_counts": 4}, ["few.mode_counts = 4", "more modes than", "1 to 3"]),
    ({"samplings.few.mode_counts": 0}, ["few.mode_counts = 0", "rising range"]),
    ({"samplings.few.mode_counts": "5-3"}, ["few.mode_counts = 5-3", "rising range"]),
    ({"samplings.few.mode_counts": "a"}, ["few.mode_counts = a", "rising range"]),
    (
        {"acceleration.few": STUDY | {"mode_counts": [3, 4]}},
        ["acceleration.few.mode_counts = 4", "more modes than", "1 to 3"],
    ),
    ({"acceleration.few": STUDY | {"mode_counts": [0]}}, ["mode_counts.0 = 0", "at least 1"]),
    ({"acceleration.few": STUDY | {"n_freeze": [0]}}, ["n_freeze.0 = 0", "at least 1"]),
    ({"acceleration.many": STUDY}, ["acceleration.many", "no such sampling", "uniform10, few"]),
    # figures
    ({"figures": [{"kind": "movie"}]}, ["figures.0.kind = movie", "profile, modes"]),
    ({"figures": [{"kind": "modes"}]}, ["figures.0.sampling = (missing)", "kind modes"]),
    ({"figures": [{"kind": "phase"}]}, ["figures.0.position = (missing)", "kind phase"]),
    ({"figures": [{"kind": "phase", "position": 1}]}, ["figures.0.position = 1", "below L = 1"]),
    (
        {"damping": 1, "figures": [{"kind": "phase", "position": 0.5}]},
        ["figures.0.kind = phase", "undamped"],
    ),
    (
        {"figures": [{"kind": "profile", "sampling": "few"}]},
        ["figures.0.sampling = few", "kind profile", "fields"],
    ),
    (
        {"figures": [{"kind": "profile", "fields": ["pressure"]}]},
        ["figures.0.fields.0 = pressure", "density_change"],
    ),
    (
        {"figures": [{"kind": "error", "sampling": "many"}]},
        ["figures.0.sampling = many", "no such sampling", "uniform10, few"],
    ),
    (
        {"figures": [{"kind": "acceleration", "sampling": "few"}]},
        ["figures.0.sampling = few", "no such acceleration", "none"],
    ),
    (
        {"figures": [{"kind": "profile"}, {"kind": "profile", "fields": ["velocity"]}]},
        ["figures.1.name = wave_profile", "taken", "figures.0"],
    ),
    ({"figures": [{"kind": "profile", "name": "../x"}]}, ["figures.0.name = ../x", "letters"]),
]


@pytest.mark.parametrize(("changes", "parts"), REFUSALS)
def test_refused_with_scene_key_value_and_what_is_allowed(load, changes, parts):
    message = refusal(load, wave(changes))
    assert message.startswith("scene wave: ")
    for part in parts:
        assert part in message


@pytest.mark.parametrize(
    ("content", "parts"),
    [
        (wave() | {"sceens": {}}, ["sceens = {}", "unknown key", "did you mean scenes"]),
        (wave() | {"output": "../elsewhere"}, ["output = ../elsewhere", "a folder"]),
        (wave() | {"output": "/else where"}, ["output = /else where", "a folder of letters"]),
        (
            wave() | {"benchmark": {"step_scene": "none"}},
            ["benchmark.step_scene = none", "allowed are wave"],
        ),
        (wave() | {"output": 3}, ["output = 3", "text"]),
        (wave() | {"benchmark": {"repeats": 0}}, ["benchmark.repeats = 0", "at least 1"]),
        (
            wave() | {"benchmark": {"particle_counts": [12, 100]}},
            ["benchmark.particle_counts.0 = 12", "at least 13"],
        ),
        (
            wave() | {"benchmark": {"particle_counts": [100]}},
            ["benchmark.particle_counts = [100]", "at least 2 entries", "numbers of particles"],
        ),
        (
            wave() | {"benchmark": {"particle_counts": 100}},
            ["benchmark.particle_counts = 100", "a list"],
        ),
        (
            wave() | {"benchmark": {"particle_counts": [20, 20.5]}},
            ["benchmark.particle_counts.1 = 20.5", "a whole number"],
        ),
        (
            wave() | {"benchmark": {"mode_counts": [1, 2]}},
            ["benchmark.mode_counts.0 = 1", "at least 2"],
        ),
        (
            wave() | {"benchmark": {"mode_counts": [4, 4]}},
            ["benchmark.mode_counts = [4, 4]", "twice", "numbers of modes"],
        ),
        (
            wave() | {"benchmark": {"mode_counts": [2, 20], "step_scene": "wave"}},
            ["benchmark.mode_counts = 20", "below the 20 particles of wave"],
        ),
        (
            wave() | {"benchmark": {"step_scene": "wave"}},
            ["benchmark.mode_counts = 32", "below the 20 particles of wave"],
        ),
        (wave() | {"benchmark": {"times": 3}}, ["benchmark.times = 3", "unknown key", "repeats"]),
        (wave() | {"illustrations": [{"kind": "spring"}]}, ["illustrations.0.name = (missing)"]),
        (
            wave() | {"illustrations": [{"kind": "spring", "name": "wave_profile"}]},
            ["scene wave: figures.0.name = wave_profile", "illustrations.0"],
        ),
        ({"scenes": {}}, ["scenes = {}", "at least 1"]),
        ({"scenes": {"Wave": WAVE}}, ["scenes.name = Wave", "lower-case"]),
        ({"scenes": {"wave": 3}}, ["scenes.wave = 3", "keys and values"]),
        ({"scenes": {"wave": None}}, ["scenes.wave = (empty)", "keys and values"]),
        ({}, ["scenes = (missing)"]),
    ],
)
def test_refused_outside_scenes(load, content, parts):
    message = refusal(load, content)
    for part in parts:
        assert part in message


@pytest.mark.parametrize(
    ("line", "key"),
    [
        ("    duration: 2", "duration = 2"),
        ("    samplings: {few: {range: [0, 1], range: [0, 2]}}", "samplings.few.range"),
        ("    figures: [{kind: profile, kind: modes}]", "figures.0.kind = modes"),
    ],
)
def test_duplicate_key_names_scene_key_and_line(load, line, key):
    block = yaml.safe_dump(WAVE | {"samplings": {}}, sort_keys=False).replace("samplings: {}\n", "")
    text = "scenes:\n  wave:\n" + "".join(f"    {line}\n" for line in block.splitlines()) + line
    message = refusal(load, text)
    assert message.startswith(f"scene wave: {key}")
    assert f"line {text.count(chr(10)) + 1})" in message
    assert "twice" in message


def test_duplicate_scene(load):
    text = yaml.safe_dump(wave())
    message = refusal(load, text + text.split("\n", 1)[1])
    assert "scenes.wave" in message
    assert "twice" in message


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("scenes: [", "this is not YAML"),
        ("a: b: c", "line 1: this is not YAML"),
        ("a: *b", "line 1: this is not YAML"),
        ("a: &b [*b]", "this is not YAML"),
        ("a: !!python/name:os.system", "this is not YAML"),
        ("a: 1\n---\na: 2", "this is not YAML"),
        ("\x07", "this is not YAML"),
        ("- 1", "keys and values"),
        ("5", "keys and values"),
        ("1: 2", "line 1: the key 1 is not text"),
        ("a: 1e999", "a = 1e999: the number is too large"),
        (f"a: {'9' * 5000}", "the number is too large"),
        ("a: [1, -1e999]", "a.1 = -1e999: the number is too large"),
        ("", "scenes = (missing)"),
    ],
)
def test_not_the_yaml_that_is_needed(load, text, part):
    assert part in refusal(load, text)


def test_file_that_cannot_be_read(tmp_path):
    with pytest.raises(config.ConfigError, match=r"missing\.yaml cannot be read"):
        config.load([tmp_path / "missing.yaml"])


PATHS = [
    "particle_count",
    "duration",
    "time_step",
    "error_interval",
    "smoothing_ratio",
    "initial_velocity",
    "youngs_modulus",
    "damping",
    "force",
    "force.time",
    "interface",
    "references",
    "samplings",
    "samplings.few",
    "samplings.few.velocity_times",
    "samplings.uniform10.range",
    "samplings.uniform10.count",
    "samplings.uniform10.seed",
    "samplings.uniform10.mode_counts",
    "acceleration",
    "acceleration.few",
    "figures",
    "unknown",
]
VALUES = st.recursive(
    st.booleans()
    | st.integers()
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.sampled_from(["x", "t", "1-3", "few", "mean", "exact", "", "where(x > 1, 1, 2)"])
    | st.text(max_size=5),
    lambda values: (
        st.lists(values, max_size=3)
        | st.dictionaries(st.sampled_from(["kind", "range", "count", "time", "few"]), values)
    ),
    max_leaves=4,
)


@settings(deadline=None)
@given(st.sampled_from(PATHS), VALUES)
def test_any_value_anywhere_is_accepted_or_refused_in_one_sentence(path, value):
    scene: dict[str, Any] = copy.deepcopy(WAVE) | {"force": {"time": 0, "profile": 1}}
    *parents, last = path.split(".")
    block: Any = scene
    for parent in parents:
        block = block[parent] if parent != "acceleration" else block.setdefault(parent, {})
    block[last] = value
    try:
        resolved = config.load([], {"scenes": {"wave": scene}})
    except config.ConfigError as error:
        message = str(error)
    else:
        assert json.loads(json.dumps(resolved)) == resolved
        return
    assert message.startswith("scene wave: ")
    assert "\n" not in message


# ------------------------------------------------------------------------------ mode counts


@pytest.mark.parametrize(
    ("text", "modes"), [("12", [12]), ("1-3", [1, 2, 3]), ("9-10", [9, 10]), ("1", [1])]
)
def test_mode_counts(text, modes):
    assert mode_counts.parse_modes(text) == modes


@pytest.mark.parametrize(
    "text", ["0", "5-3", "5-5", "a", "", "1-", "-3", "1-2-3", "01", "0-3", "1.5", " 1", "1-999999"]
)
def test_mode_counts_refused(text):
    with pytest.raises(ValueError, match="rising range such as 1-20"):
        mode_counts.parse_modes(text)


@pytest.mark.parametrize(
    ("scene", "sampling", "modes", "parts"),
    [
        ("wave", "few", "4", ["modes = 4", "more modes than", "sampling few", "1 to 3"]),
        ("wave", "few", "5-3", ["modes = 5-3", "rising range"]),
        ("wave", "many", "3", ["sampling = many", "uniform10, few"]),
        ("wove", "few", "3", ["no such scene", "wave"]),
    ],
)
def test_modes_asked_for_are_checked(load, scene, sampling, modes, parts):
    resolved = load(wave())
    config.check_modes(resolved, "wave", "few", "1-3")
    with pytest.raises(config.ConfigError, match=f"^scene {scene}: ") as caught:
        config.check_modes(resolved, scene, sampling, modes)
    for part in parts:
        assert part in str(caught.value)


# ------------------------------------------------------------------------------- tolerances


@pytest.mark.parametrize(
    ("text", "tolerance"),
    [("1e-2", 1e-2), ("5e-3", 5e-3), ("2.5e-4", 2.5e-4), ("0.05", 0.05), ("1e-14", 1e-14)],
)
def test_tolerances(text, tolerance):
    assert mode_counts.parse_tolerance(text) == tolerance


@pytest.mark.parametrize(
    "text",
    [
        *("", "x", "0", "1", "2", "0.0", "0e-2", "1e2", "-1e-2", ".1", "1.5", "1e-2 ", "0.1\n"),
        *("nan", "inf", "1E-2", "10e-3", "1e-0", "5e-0", "9e-00", "1e-999", f"0.{'9' * 20}"),
    ],
)
def test_tolerances_refused(text):
    with pytest.raises(ValueError, match="above 0 and below 1, such as 1e-2"):
        mode_counts.parse_tolerance(text)


@settings(deadline=None)
@given(st.from_regex(r"[0-9.e+-]{1,8}", fullmatch=True))
def test_any_tolerance_is_between_zero_and_one(text):
    try:
        tolerance = mode_counts.parse_tolerance(text)
    except ValueError:
        return
    assert 0 < tolerance < 1
    assert tolerance == float(text)


def test_usual_sweeps(load):
    scenes = load(wave({"samplings.many": {"range": [0, 1], "count": 50}, "particle_count": 100}))[
        "scenes"
    ]
    found = {
        name: mode_counts.usual_sweep(scenes["wave"], name) for name in ("few", "uniform10", "many")
    }
    assert found == {"few": "1-3", "uniform10": "1-10", "many": "1-20"}
    few = load(wave({"samplings.uniform10.mode_counts": 2, "particle_count": 9}))["scenes"]["wave"]
    # What a sampling asks for is no matter, what it can give is.
    assert mode_counts.usual_sweep(few, "uniform10") == "1-9"


def test_lifted_models_may_have_a_mode_of_translation_more(load):
    resolved = load(
        {
            "scenes": {
                "wave": WAVE,
                "forced": WAVE | {"force": "sin(t)"},
                "few": WAVE | {"force": "sin(t)", "particle_count": 10},
            }
        }
    )
    for scene, method, most in (
        ("wave", "lifted_exact", 10),
        ("forced", "lifted_exact", 11),
        ("forced", "lifted_euler", 11),
        ("forced", "original", 10),
        ("few", "lifted_exact", 10),
    ):
        config.check_modes(resolved, scene, "uniform10", f"1-{most}", method)
        with pytest.raises(config.ConfigError, match=f"allowed are 1 to {most}"):
            config.check_modes(resolved, scene, "uniform10", str(most + 1), method)


def test_one_mode_is_no_range(load):
    one = {"samplings.one": {"range": [0, 1], "count": 1}}
    scene = load(wave(one))["scenes"]["wave"]
    assert mode_counts.usual_sweep(scene, "one") == "1"
    assert scene["samplings"]["one"]["mode_counts"] == "1"


def test_sizes_of_the_benchmark_by_default(load):
    benchmark = load(wave())["benchmark"]
    assert benchmark == configuration.Benchmark.default_keys()
    given = load(wave() | {"benchmark": {"particle_counts": [13, 1e2]}})["benchmark"]
    assert given == benchmark | {"particle_counts": [13, 100]}


# -------------------------------------------------------------------------------- variants


@pytest.mark.parametrize(
    ("runs", "answer"),
    [
        ({"waves": {}}, "studies.variants.runs = waves: no such scene; allowed are wave"),
        ({"wave": {"one": {"particle_count": 20.5}}}, "it must be a whole number"),
        ({"wave": {"one": {"particle_count": 4}}}, "runs.wave.one: scene wave: particle_count = 4"),
        ({"wave": {"one": {"time_step": 3e-4}}}, "runs.wave.one: scene wave: duration = 1"),
        ({"wave": {"one": {"damping": 1}}}, "studies.variants.runs.wave.one.damping"),
        (
            {"wave": {"own": {"particle_count": 40}}},
            "runs.wave = own: this is the name of the scene",
        ),
    ],
)
def test_variants_that_cannot_run_are_refused(load, runs, answer):
    with pytest.raises(config.ConfigError) as caught:
        load({"scenes": {"wave": WAVE}, "studies": {"variants": {"runs": runs}}})
    assert answer in str(caught.value)
    assert "\n" not in str(caught.value)


# ------------------------------------------------------------------------------- stability


EDGE = {key: value for key, value in WAVE.items() if key not in ("references", "samplings")}
STABILITY_REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "key": (
        {"stability_mapp": {}},
        "stability.stability_mapp = {}: unknown key, did you mean stability_map?",
    ),
    "scene": (
        {"stability_map": {"waves": "few"}},
        "stability.stability_map = waves: no such scene; allowed are wave",
    ),
    "sampling": (
        {"stability_map": {"wave": "fews"}},
        "stability.stability_map.wave = fews: the scene has no such",
    ),
    "ratio": ({"smoothing_ratios": [0.9, 1.04]}, "it must be above 1"),
    "wide ratio": ({"smoothing_ratios": [1.04, 30]}, "30: the kernel's support of 4h would wrap"),
    "still": (
        {"amplitude": {"still": "few"}},
        "still: it must be a scene with an initial velocity",
    ),
    "translated": (
        {"amplitude": {"constant": "few"}},
        "constant: it must be a scene with an initial velocity that strains it",
    ),
    "alternating": (
        {"amplitude": {"alternating": "few"}},
        "alternating: it must be a scene with an initial velocity that strains it",
    ),
    "run at rest": (
        {"long_run": {"scene": "rest", "sampling": "few", "mode_count": 2}},
        "stability.long_run.scene = rest: it must be a scene with an initial velocity",
    ),
    "edge's folder": (
        {"edge_scenes": {"logs": EDGE}},
        "stability.edge_scenes.name = logs: allowed are",
    ),
    "damped run": (
        {"random_run": {"scene": "damped"}},
        "damped: it must be a scene without damping",
    ),
    "uniform run": ({"random_run": {"scene": "wave"}}, "wave: its density or modulus must vary"),
    "run": ({"random_run": {"scene": "waves"}}, "stability.random_run.scene = waves: allowed are"),
    "run's modes": (
        {"long_run": {"scene": "wave", "sampling": "few", "mode_count": 9}},
        "stability.long_run.mode_count = 9: more modes than",
    ),
    "edge's name": ({"edge_scenes": {"wave": EDGE}}, "this name is taken by a scene"),
    "edge's key": (
        {"edge_scenes": {"edge": EDGE | {"samplings": {}}}},
        "stability.edge_scenes.edge.samplings = {}: unknown here; allowed are domain_length",
    ),
    "edge's modulus": (
        {"edge_scenes": {"edge": EDGE | {"youngs_modulus": -1}}},
        "scene edge: youngs_modulus = -1: it is -1 at x = 0 and must be positive",
    ),
    "jitter": (
        {"edge_scenes": {"edge": EDGE | {"positions": {"jitter": 0.6}}}},
        "scene edge: positions.jitter = 0.6: it must be from 0 to below 0.5",
    ),
}


@pytest.mark.parametrize(("changes", "answer"), STABILITY_REFUSED.values(), ids=STABILITY_REFUSED)
def test_what_stability_cannot_study_is_refused(load, changes, answer):
    scenes = {
        "wave": WAVE,
        "damped": WAVE | {"damping": 1},
        "constant": WAVE | {"initial_velocity": 1e-3},
        "alternating": WAVE | {"initial_velocity": "1e-3*cos(20*pi*x/L)"},
        "rest": WAVE | {"initial_velocity": 0},
        "still": WAVE | {"initial_velocity": 0, "force": "1e-3*sin(t)"},
    }
    with pytest.raises(config.ConfigError) as caught:
        load({"scenes": scenes, "stability": {"smoothing_ratios": [1.04, 1.2], **changes}})
    assert answer in str(caught.value)
    assert "\n" not in str(caught.value)


def test_stability_is_studied_of_the_first_scene_that_can_be(load):
    still = WAVE | {"initial_velocity": 0, "force": "1e-3*sin(t)"}
    unsampled = {key: value for key, value in WAVE.items() if key != "samplings"}
    resolved = load({"scenes": {"unsampled": unsampled, "still": still, "wave": WAVE}})
    found = {study: resolved["stability"][study] for study in stability_section.STABILITY_STUDIES}
    assert found == {
        "stability_map": {"still": "uniform10"},
        "poor_snapshots": {"still": "uniform10"},
        "amplitude": {"wave": "uniform10"},
    }
    alone = load({"scenes": {"unsampled": unsampled}})["stability"]
    assert [alone[study] for study in stability_section.STABILITY_STUDIES] == [{}, {}, {}]
