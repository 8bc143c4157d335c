"""What a configuration may start scenes from."""

import pytest
import scenes
import yaml

from sphpod import make_scene, solve_sph
from sphpod.config import config
from sphpod.config.reading import ConfigError


@pytest.fixture
def path(tmp_path):
    solve_sph(make_scene("whole", **scenes.settings())).to_netcdf(tmp_path / "kept.nc")
    return str(tmp_path / "kept.nc")


def loaded(start, **more):
    scene = {**scenes.settings(), "samplings": {"few": {"range": [0, 1], "count": 5}}}
    del scene["initial_velocity"]
    return config.load([], {"scenes": {"rest": scene | {"start": start}}} | more)


def test_a_started_scene_has_a_reference_and_a_checksum(path):
    scene = loaded({"from": path, "t": 0.5})["scenes"]["rest"]
    assert scene["references"] == ["centred"]
    assert set(scene["start"]) == {"from", "t", "checksum"}


def test_what_a_scene_says_itself_replaces_the_other_way_of_the_defaults(path, tmp_path):
    shared = {key: value for key, value in scenes.settings().items() if key != "initial_velocity"}
    start = {"from": path, "t": 0.5}
    for default, own in (
        ({"initial_velocity": 0}, {"start": start}), ({"start": start}, {"initial_velocity": 0}),
    ):  # fmt: skip
        text = yaml.safe_dump({"defaults": shared | default, "scenes": {"rest": own}})
        (tmp_path / "c.yaml").write_text(text)
        scene = config.load([tmp_path / "c.yaml"])["scenes"]["rest"]
        assert set(own) == {"initial_velocity", "start"} & set(scene)


@pytest.mark.parametrize(
    ("more", "parts"),
    [
        ({"acceleration.few": {"mode_counts": [3], "n_freeze": [1]}}, ["that start unstrained"]),
        ({"references": ["chain"]}, ["references = chain", "allowed are fd, centred"]),
        ({"start.t": -1}, ["start.t = -1", "at least 0"]),
        ({"start.time": 1}, ["start.time = 1", "unknown key"]),
        ({"stability": {"amplitude": {"rest": "few"}}}, ["stability.amplitude = rest", "start"]),
        ({"stability": {"stability_map": {"rest": "few"}}}, ["rest", "without start"]),
        ({"stability": {"random_run": {"scene": "rest"}}}, ["random_run.scene", "and start"]),
        ({"benchmark": {"step_scene": "rest"}}, ["benchmark.step_scene = rest", "without start"]),
        (
            {"stability": {"edge_scenes": {"edge": {"start": {"from": "a", "t": 0}}}}},
            ["edge_scenes.edge.start", "start unstrained"],
        ),
        (
            {
                "youngs_modulus": "a",
                "parameters": {"a": {"nominal": 0.1, "range": [0.1, 0.2]}},
                "surveys": {
                    "some": {
                        "scene": "rest",
                        "quantities": {"e": {"kind": "energy"}},
                        "queries": {"count": 3},
                    }
                },
            },
            ["scene rest: start", "initial_velocity"],
        ),
    ],
)
def test_what_does_not_go_with_a_start_is_refused(path, more, parts):
    start = {"from": path, "t": 0.5}
    scene = {**scenes.settings(), "samplings": {"few": {"range": [0, 1], "count": 5}}}
    del scene["initial_velocity"]
    settings = {"scenes": {"rest": scene | {"start": start}}}
    for key, value in more.items():
        first, _, second = key.partition(".")
        if key in ("stability", "benchmark", "surveys"):
            settings[key] = value
            for edge in value.get("edge_scenes", {}).values():
                edge |= {k: v for k, v in scenes.settings().items() if k != "initial_velocity"}
        elif second:
            settings["scenes"]["rest"].setdefault(first, {})[second] = value
        else:
            settings["scenes"]["rest"][key] = value
    with pytest.raises(ConfigError) as caught:
        config.load([], settings)
    assert all(part in str(caught.value) for part in parts), caught.value
