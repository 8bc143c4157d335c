"""YAML is read strictly: every fault ends, soon, in a sentence with file and line."""

import numpy as np
import pytest
import xarray as xr

from sphpod.config import config
from sphpod.config.reading import LARGEST_FILE, ConfigError, read_yaml, typed

NESTED_ALIASES = "\n".join(
    ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    + [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 9)]
)


@pytest.fixture
def read(tmp_path):
    def read(content):
        path = tmp_path / "mine.yaml"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return read_yaml(path)

    return read


@pytest.mark.parametrize(
    ("content", "answer"),
    [
        ("scenes:\n\ta: 1", "line 2: this is not YAML (a tab where only spaces may be)"),
        ("scenes: [", "line 2: this is not YAML"),
        ("a: 1\nb: *c", "line 2: this is not YAML (found undefined alias)"),
        ("a: 1\nb: !foo 1", "line 2: this is not YAML (tags such as !foo are not known here)"),
        ("a: !!float abc", "line 1: this is not YAML (tags such as !!float are not known here)"),
        ("a: !!int 0x20", "line 1: this is not YAML (tags such as !!int are not known here)"),
        ("a: 1\n---\nb: 2", "line 2: this is not YAML (but found another document)"),
        ("a: 1\nb: \0", "line 2: this is not YAML (a control character, #x00)"),
        ("5", "holds 5 where keys and values are needed"),
        ("a: 1".encode("utf-32"), "line 1: this is UTF-32; UTF-8 is needed"),
        ("a: 1".encode("utf-16"), "line 1: this is UTF-16; UTF-8 is needed"),
        ("a: 1\nb: é".encode("latin-1"), "line 2: the byte 0xe9 is not UTF-8, which is needed"),
        ("a: [1, f(x, 2), 3]", "line 1: f(x ends at a comma within its bracket"),
        ("a: 1\nb: {c: f((1, 2), t), d: 3}", "line 2: f((1 ends at a comma within its brack"),
        ("a: [b, {c: [f(1,g(2)), 0]}]", "line 1: f(1 ends at a comma within its bracket"),
        ("a: &a [*a]", "line 1: this is not YAML (*a refers to what it is part of)"),
        ("a: " + "[" * 500 + "]" * 500, "line 1: this is not YAML (nested more than 50 deep)"),
        ("a: " + "[" * 5000, "line 1: this is not YAML (nested more than 50 deep)"),
        (NESTED_ALIASES, "line 6: this is not YAML (with its aliases it has more than 200000"),
        (f"# {'x' * 10_000_000}", "holds 10 MB; at most 1 MB are read"),
        ("b: 1\nc: {<<: 3}", "line 2: this is not YAML (expected a mapping or list of mappings"),
        ("? [a]\n: 3", "line 1: the key of several entries is not text"),
    ],
    ids=lambda value: None if isinstance(value, str) and len(value) < 40 else "long",
)
def test_faults_of_a_file_are_reported_with_its_line(read, content, answer):
    with pytest.raises(ConfigError) as caught:
        read(content)
    message = str(caught.value)
    assert message.partition("mine.yaml")[2].lstrip(", ").startswith(answer)
    assert "\n" not in message


def test_what_is_not_wrong_is_read(read):
    assert read("") == {}
    assert read("\ufeffa: 1") == {"a": 1}
    assert read(f"# {'x' * (LARGEST_FILE - 10)}\na: 1") == {"a": 1}
    assert read("a: [b (c, d]\ne: ['f(x', 2)]") == {"a": ["b (c", "d"], "e": ["f(x", "2)"]}
    assert read("a: １２") == {"a": "１２"}  # no digits of YAML


def test_a_variant_of_a_scene_names_only_what_differs(read):
    merged = read("base: &base {x: 1, y: 2}\nother: {<<: *base, y: 3}")
    assert merged == {"base": {"x": 1, "y": 2}, "other": {"x": 1, "y": 3}}


@pytest.mark.parametrize("text", ["true", "2e-4", "-7", "x", "010", "yes", "1-20", "1e-3*x"])
def test_a_text_of_a_command_line_is_what_it_is_in_a_file(read, text):
    in_file = read(f"key: {text}")["key"]
    assert typed(text) == in_file
    assert type(typed(text)) is type(in_file)


def test_settings_of_a_command_line_are_what_they_are_in_a_file():
    """Snakemake takes what lies below the first level for text."""
    given = {"benchmark": {"repeats": "3", "counts": ["1e3", "1-20"]}, "output": "mine"}
    assert typed(given) == {"benchmark": {"repeats": 3, "counts": [1e3, "1-20"]}, "output": "mine"}


SCENE = {
    "domain_length": 1, "duration": 1, "initial_velocity": "1e-3*sin(2*pi*x/L)",
    "initial_density": 1, "youngs_modulus": 0.1, "particle_count": 20, "smoothing_ratio": 1.04,
    "time_step": 0.002, "error_interval": 0.01,
}  # fmt: skip


def test_scenes_have_the_keys_of_defaults_that_they_do_not_say():
    changed = {"damped": {"damping": 2}, "fine": {"particle_count": 40}}
    scenes = config.load([], {"defaults": SCENE, "scenes": changed})["scenes"]
    spelt = config.load([], {"scenes": {name: SCENE | own for name, own in changed.items()}})
    assert scenes == spelt["scenes"]


@pytest.mark.parametrize(
    ("defaults", "answer"),
    [
        ({"particle_count": 3}, "defaults.particle_count = 3: it must be at least 5"),
        ({"particel_count": 30}, "defaults.particel_count = 30: unknown key, did you mean"),
        (
            {"force": [[1]]},
            "defaults.force.0 = [1]: it must be a number or text or keys and values",
        ),
    ],
)
def test_faults_of_defaults_are_named_once(defaults, answer):
    with pytest.raises(ConfigError) as caught:
        config.load([], {"defaults": SCENE | defaults, "scenes": {"a": {}, "b": {}}})
    assert str(caught.value).startswith(answer)


@pytest.mark.parametrize(
    ("changes", "answer"),
    [
        ({"time_step": "5"}, "time_step = '5': it must be a number"),
        ({"error_interval": 0.0100000001}, "error_interval = 0.0100000001: it must be a whole"),
        ({"error_interval": 1e308}, "error_interval = 1.0e+308: it must be at most the duration"),
        ({"duration": 1e308}, "duration = 1.0e+308: it must be a positive number from 1e-100"),
        ({"duration": 1e-320}, "duration = 1.0e-320: it must be a positive number from 1e-100"),
        ({"domain_length": 1e200}, "domain_length = 1e+200: it must be a positive"),
        ({"domain_length": 1e-200}, "domain_length = 1e-200: it must be a positive"),
        ({"smoothing_ratio": 1e308}, "smoothing_ratio = 1e+308: the kernel's support of 4h wraps"),
        ({"smoothing_ratio": 0.501}, "smoothing_ratio = 0.501: particles would hardly see each"),
        ({"initial_velocity": "x\0"}, "initial_velocity: 'x\\x00' is refused because it holds"),
        ({"particle_count": "１２"}, "particle_count = １２: it must be a whole number"),
        ({"samplings": {"a": {"range": [0.0005, 0.001], "count": 2}}}, "samplings.a.count = 2: the "
         "range holds 0 time steps"),
    ],
)  # fmt: skip
def test_numbers_at_the_edge_are_named_as_they_are(changes, answer):
    with pytest.raises(ConfigError) as caught:
        config.load([], {"scenes": {"wave": SCENE | changes}})
    assert str(caught.value).startswith(f"scene wave: {answer}")


MANY = {"particle_count": 100_000, "time_step": 1e-6, "error_interval": 0.1, "youngs_modulus": 1e-5}


@pytest.mark.parametrize(
    ("changes", "answer"),
    [
        (MANY | {"error_interval": 1e-4},
         "error_interval = 0.0001: 10001 outputs of 100000 particles take 40 GB; at most 8 GB"),
        ({"time_step": 1e-9, "force": "sin(t)"},
         "time_step = 1.0e-09: the force in 1000000000 time steps take 192 GB; at most 8 GB"),
        ({"time_step": 1e-7, "force": [{"time": f"sin({n}*t)", "profile": 1} for n in range(9)]},
         "time_step = 1.0e-07: the force, of 9 functions of t, in 10000000 time steps take 11.2"),
        ({"time_step": 1e-7, "youngs_modulus": "0.1 + 0.01*where(cos(2*pi*(x - t)) > 0, 1, 0)"},
         "time_step = 1.0e-07: the modulus, of 20 functions of t, in 10000000 time steps take 2"),
        (MANY | {"samplings": {"a": {"range": [0, 1], "count": 100_000}}},
         "samplings.a = {range: [0, 1], count: 100000}: 100000 snapshots of 100000 particles"),
        (MANY | {"smoothing_ratio": 24_000},
         "smoothing_ratio = 24000: each of 100000 particles would have 47999 neighbours"),
        (MANY | {"smoothing_ratio": 200, "positions": {"jitter": 0.1}},
         "smoothing_ratio = 200: each of 100000 particles would have 399 neighbours"),
        (MANY | {"initial_velocity": "sum(sin(2*pi*l*x/L)/l for l in range(1, 10001))"},
         "initial_velocity = sum(sin(2*pi*l*x/L)/l for l in range(1, 10001)): its sums have 10000 "
         "terms; at 100000 particles, 250 are allowed"),
    ],
    ids=["outputs", "steps", "terms in time", "front", "snapshots", "neighbours", "lists", "terms"],
)  # fmt: skip
def test_what_takes_too_much_is_refused_before_it_is_tried(changes, answer):
    with pytest.raises(ConfigError) as caught:
        config.load([], {"scenes": {"wave": SCENE | changes}})
    assert str(caught.value).startswith(f"scene wave: {answer}")


def test_outputs_that_nobody_asked_for_are_named_as_the_default():
    scene = {key: value for key, value in (SCENE | MANY).items() if key != "error_interval"}
    with pytest.raises(ConfigError, match=r"take 40 GB; .* \(this is the default; another"):
        config.load([], {"scenes": {"wave": scene}})


def test_the_limit_of_memory_can_be_set():
    scene = SCENE | {"duration": 10, "error_interval": 0.002, "particle_count": 100}
    config.load([], {"scenes": {"wave": scene}})
    with pytest.raises(ConfigError, match=r"take 0\.02 GB; at most 0\.01 GB are allowed"):
        config.load([], {"memory": 0.01, "scenes": {"wave": scene}})
    with pytest.raises(ConfigError, match="memory = 0: it must be above 0"):
        config.load([], {"memory": 0, "scenes": {"wave": scene}})


@pytest.mark.parametrize(
    ("content", "answer"),
    [
        ({"stability": {"random_bases": 1e12}}, "stability.random_bases = 1000000000000: it must"),
        ({"stability": {"amplitude_count": 1e9}}, "stability.amplitude_count = 1000000000: it"),
        ({"benchmark": {"repeats": 1e18}}, "benchmark.repeats = 1.0e+18: it must be at most 10000"),
        ({"stability": {"edge_scenes": {"edge": SCENE | MANY | {"error_interval": 1e-6}}}},
         "scene edge: error_interval = 1.0e-06: 1000001 outputs of 100000 particles take 4e+03 GB"),
        ({"output": "a/../b"}, "output = a/../b: allowed are a folder of letters"),
        ({"output": "x" * 300}, f"output = {'x' * 97}...: allowed are a folder of letters"),
    ],
)  # fmt: skip
def test_counts_without_end_are_refused(content, answer):
    with pytest.raises(ConfigError) as caught:
        config.load([], {"scenes": {"wave": SCENE}, **content})
    assert str(caught.value).startswith(answer)


@pytest.mark.parametrize(
    ("changes", "answer"),
    [
        ({"duration": 1e308}, "duration = 1.0e+308: it must be a positive number from 1e-100"),
        ({"time_step": 1e-300}, "time_step = 1.0e-300: at least T/1e+09 = 1e-09 is needed"),
        ({"error_interval": 1e-9}, "error_interval = 1.0e-09: at least T/1e+06 = 1e-06 is needed"),
        ({"domain_length": 1e-200}, "domain_length = 1e-200: it must be a positive number from"),
        ({"smoothing_ratio": 1e308}, "smoothing_ratio = 1e+308: the kernel's support of 4h wraps"),
        ({"initial_density": 1e200}, "initial_density = 1e+200: it is 1e+200, and must be from"),
        ({"youngs_modulus": 1e-200}, "youngs_modulus = 1e-200: it is 1e-200, and must be from"),
        ({"initial_velocity": 1e200}, "initial_velocity = 1e+200: its largest size is 1e+200"),
        ({"force": {"time": 1e-200, "profile": "x"}}, "force.time = 1e-200: its largest size is"),
        (MANY | {"error_interval": 1e-4}, "error_interval = 0.0001: 10001 outputs of 100000 part"),
        ({"force": "t", "time_step": 1e-8}, "time_step = 1.0e-08: the force in 100000000 time s"),
        (MANY | {"smoothing_ratio": 2e4}, "smoothing_ratio = 20000: each of 100000 particles wou"),
    ],
)
def test_a_scene_at_the_edge_is_held_to_the_same_sizes(changes, answer):
    edge = {"edge_scenes": {"edge": SCENE | changes}}
    with pytest.raises(ConfigError) as caught:
        config.load([], {"scenes": {"wave": SCENE}, "stability": edge})
    assert str(caught.value).startswith(f"scene edge: {answer}")


def test_a_hidden_folder_is_an_output():
    assert config.load([], {"scenes": {"wave": SCENE}, "output": ".mine/x"})["output"] == ".mine/x"


@pytest.mark.parametrize("name", ["a" * 20, "a" * 61, "ab" * 25, "wave\n", "Wave", "1a", "é", ""])
def test_names_that_snakemake_or_a_disk_cannot_take_are_refused(name):
    with pytest.raises(ConfigError, match=r"scenes\.name = .*: allowed are lower-case letters"):
        config.load([], {"scenes": {name: SCENE}})


def test_a_file_of_snapshots_is_checked_before_any_job(tmp_path):
    few = {"samplings": {"mine": {"from": str(tmp_path / "mine.nc")}}}
    (tmp_path / "mine.nc").write_text("no NetCDF")
    with pytest.raises(ConfigError, match=r"samplings\.mine\.from = .*: there is no NetCDF file"):
        config.load([], {"scenes": {"wave": SCENE | few}})
    arrays = {"t": np.arange(3.0), "velocity": np.ones((3, 20)), "density": np.ones((3, 20))}
    dims = {"t": ("t",), "velocity": ("t", "x"), "density": ("t", "x")}
    data = xr.Dataset({name: (dims[name], values) for name, values in arrays.items()})
    data.to_netcdf(tmp_path / "mine.nc", engine="netcdf4")
    resolved = config.load([], {"scenes": {"wave": SCENE | few}})
    taken = resolved["scenes"]["wave"]["samplings"]["mine"]
    assert (taken["counts"], taken["mode_counts"]) == ([3, 3], "1-3")
    assert resolved["stability"]["amplitude"] == {}
    for more in (
        {"scenes": {"wave": SCENE | few}, "stability": {"amplitude": {"wave": "mine"}}},
        {"scenes": {"wave": SCENE | few | {"acceleration": {"mine": {
            "mode_counts": [2], "n_freeze": [1]}}}}},
    ):  # fmt: skip
        with pytest.raises(ConfigError, match="it must be a sampling at times"):
            config.load([], more)
