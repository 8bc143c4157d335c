"""Targets that nothing makes, and studies that do not apply to a scene, are refused by name."""

import re
from pathlib import Path

import pytest
import runs

from sphpod.pipeline import targets

ROOT = Path(__file__).parents[2]

MADE = [
    "results/{scene}/sph.nc",
    "results/{scene}/{sampling}/pod.nc",
    "results/{scene}/{sampling}/{method}/k{modes}.nc",
    "results/claims.csv",
    "results/surveys/{survey}/answers.csv",
    "figures/waves_profile.pdf",
    "figures/waves_profile.png",
    "figures/{scene}/{sampling}/k{modes}.gif",
]
SCENES = {"waves": ["uniform10"], "graded": []}


def names(wildcard, place):
    samplings = SCENES.get(place.get("scene"), [])
    return {"scene": SCENES, "sampling": samplings, "survey": ["bar"]}.get(wildcard)


@pytest.mark.parametrize(
    ("target", "sentence"),
    [
        ("Liftd2", "target = Liftd2: did you mean lifted? allowed are all, lifted"),
        ("README.md", "target = README.md: allowed are all, lifted"),
        ("pod.nc", "target = pod.nc: did you mean small/results/{scene}/{sampling}/pod.nc? allow"),
        ("small/results/Claims.csv", "results: file = Claims.csv: did you mean claims.csv?"),
        ("small/results/wave/b/c/d.nc", "scene = wave: did you mean waves? allowed are waves, "),
        ("small/results/waves/X/c/d.nc", "scene waves: sampling = X: allowed are uniform10"),
        ("small/results/graded/x/y.nc", "scene graded: sampling = x: there is none"),
        ("small/results/waves/pod.nc", "file = results/waves/pod.nc: there is one in each results"),
        ("small/results/waves/uniform10/sph.nc", "results/waves/uniform10: file = sph.nc: did you"),
        ("small/results/waves/uniform10/a/b/c.nc", "results/waves/uniform10/a: folder = b: there"),
        ("small/results/waves/uniform10/original/m2.nc", "results/waves/uniform10/original: file"),
        ("small/results/waves", "file = results/waves: this is a folder, for sph.nc"),
        ("small/results/surveys/unknown/x.csv", "survey = unknown: allowed are bar"),
        ("small/results/surveys/bar/answer.csv", "results/surveys/bar: file = answer.csv: did yo"),
        ("small/figures/sub/X1.png", "figure = sub/X1.png: allowed are waves_profile.png"),
        ("small/figures/sub/waves_profile.png", "figure = sub/waves_profile.png: did you mean wav"),
        ("small/figures/waves/uniform10/m3.gif", "figures/waves/uniform10: file = m3.gif: allow"),
        ("results/waves/sph.nc", "target = results/waves/sph.nc: did you mean small/results/wave"),
        ("surveys/nothing/x.y", "target = surveys/nothing/x.y: files are made in small/results an"),
    ],
)
def test_an_unknown_target_is_refused_with_near_names(target, sentence):
    said = targets.refusal(target, MADE, "small", ["all", "lifted"], names)
    assert said.startswith(sentence)
    assert "\n" not in said


def test_no_pattern_of_the_unknown_is_of_what_is_made():
    made = [r"results/(?P<scene>[^/]+)/sph\.nc$", r"figures/(?P<name>\w+)\.pdf$"]
    unknown = re.compile(targets.unlike(made) + ".+")
    for path in ("results/waves/sph.nc", "figures/one.pdf"):
        assert not unknown.fullmatch(path)
    for path in ("results/waves/sph.ncx", "results/a/b/sph.nc", "figures/one.svg", "Word1"):
        assert unknown.fullmatch(path)


def said_of(folder, config, target):
    """What a dry run says of a target, in one sentence."""
    files = ["--snakefile", ROOT / "Snakefile", "--configfile", ROOT / "config" / config]
    run = runs.run(folder, "--dry-run", *files, "--", target)
    assert run.returncode == 1, run.stdout
    assert "Traceback" not in run.stderr
    (said,) = (line for line in run.stderr.splitlines() if line.startswith("sphpod: "))
    return said.removeprefix("sphpod: ")


@pytest.mark.workflow
@pytest.mark.parametrize(
    ("config", "target", "sentence"),
    [
        ("small.yaml", "Foo3", "target = Foo3: allowed are all, "),
        ("small.yaml", "small/results/a/B2/c/d.nc", "scene = a: allowed are waves, "),
        ("small.yaml", "small/figures/sub/x.png", "figure = sub/x.png: allowed are "),
        ("small.yaml", "small/results/surveys/unknown/x.csv", "survey = unknown: allowed are gra"),
        ("small.yaml", "small/results/waves/variants.nc", "scene = waves: "),
        (
            "small.yaml",
            "small/results/waves/random_run.nc",
            "scene = waves: this needs one without",
        ),
        ("bars.yaml", "bars/results/flying/uniform40/mode_pairs.nc", "scene = flying: this needs"),
        ("bars.yaml", "bars/results/flying/uniform40/original/k3+2.nc", "scene flying: boundary"),
        ("in_time.yaml", "in_time/results/pumped/damping_map.nc", "scene = pumped: this needs"),
    ],
)
def test_a_dry_run_refuses_the_unknown(tmp_path, config, target, sentence):
    assert said_of(tmp_path, config, target).startswith(sentence)
