"""The configuration, and what the rules ask of it."""

import difflib
import os
import re
import sys
from pathlib import Path

import numpy as np

from sphpod.paper import claims, paper
from sphpod.reference import exact
from sphpod.pipeline import provenance
from sphpod.reduced import snapshots
from sphpod.config.config import (
    ConfigError,
    check_modes,
    distinct_names,
    load,
    parse_modes,
    parse_tolerance,
    usual_sweep,
)
from sphpod.scene.kernel import derivative_coefficient
from sphpod.scene.scene import PHYSICS_KEYS, Scene

ROOT = Path(workflow.basedir)

# The package beside this workflow, whose code the digests name, goes before any installed one.
os.environ.update(PYTHONPATH=f"{ROOT}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")


def stop(sentence):
    """End the run before its first job with one sentence, not with a traceback."""
    sys.exit(f"sphpod: {sentence}")


try:
    # A configuration that is asked for replaces the paper's; `configfile:` would merge the two.
    CONFIG = load(
        workflow.overwrite_configfiles or [ROOT / "config/config.yaml"],
        overrides=workflow.config_settings.config,
    )
    CLAIMS = claims.resolve(CONFIG)
except ConfigError as error:
    stop(error)

OUTPUT = Path(CONFIG["output"])
SCENES = CONFIG["scenes"]
FIGURES = {figure["name"]: figure for figure in CONFIG["illustrations"]} | {
    figure["name"]: {"scene": name, "section": scene["section"], **figure}
    for name, scene in SCENES.items()
    for figure in scene["figures"]
}


def by_name(figures, others):
    """Figures, each given with the parts of its name, by names that no other may have."""
    found = {}
    for name, (_, figure) in zip(distinct_names([parts for parts, _ in figures]), figures):
        if name in others:
            both = " and of ".join(
                ", ".join(f"{key} {one[key]}" for key in ("kind", "scene") if key in one)
                for one in (figure, others[name])
            )
            stop(f"figure = {name}: this is the name of {both}; every figure needs its own")
        found[name] = figure
    return found


# What the benchmarks draw is no part of the paper, and not of the default target.
BENCHMARK_FIGURES = [
    (
        ("benchmark", name, sampling),
        {
            "kind": "work_precision",
            "scene": name,
            "sampling": sampling,
            "section": "benchmarks",
            "caption": (
                f"CPU time against error, all methods, mode counts and integrators: {name},"
                f" snapshots {sampling}."
            ),
        },
    )
    for name, scene in SCENES.items()
    for sampling in scene["acceleration"]
]
if "step_scene" in CONFIG["benchmark"]:
    scaling = {
        "kind": "scaling",
        "scene": CONFIG["benchmark"]["step_scene"],
        "section": "benchmarks",
        "caption": "Time and memory of a step against particles and modes, full and reduced models.",
    }
    BENCHMARK_FIGURES.append((("benchmark", "scaling"), scaling))
BENCHMARK_FIGURES = by_name(BENCHMARK_FIGURES, FIGURES)
STABILITY_FIGURES = [
    (("stability", kind), {"kind": kind, "section": "stability", "caption": caption})
    for kind, caption, drawn in (
        (
            "limits",
            "Stable time steps by the spectrum, held against those from which runs grow.",
            True,
        ),
        (
            "growth",
            "Growth of the energy under explicit Euler, predicted and measured; energies kept.",
            any(Scene.from_settings(name, scene).is_conservative for name, scene in SCENES.items()),
        ),
        (
            "operators",
            "Largest real parts of reduced operators, and runs of models that grow.",
            any(scene["samplings"] for scene in SCENES.values()),
        ),
        (
            "smoothing",
            "What the smoothing length changes: consistency, stability and errors.",
            True,
        ),
    )
    if drawn
]
STABILITY_FIGURES += [
    (
        ("stability", study, name, sampling),
        {
            "kind": kind,
            "scene": name,
            "sampling": sampling,
            "section": "stability",
            "caption": f"{caption}: {name}, snapshots {sampling}.",
        },
    )
    for study, kind, caption in (
        (
            "map",
            "stability_map",
            "Growth of full and reduced models, measured, and the predicted boundary",
        ),
        ("amplitude", "amplitude", "Errors of reduced models until the line folds"),
        ("snapshots", "noise", "Errors and their bounds with poor snapshots"),
    )
    for name, sampling in CONFIG["stability"][study].items()
]
STABILITY_FIGURES = by_name(STABILITY_FIGURES, FIGURES | BENCHMARK_FIGURES)
ALL_FIGURES = FIGURES | BENCHMARK_FIGURES | STABILITY_FIGURES


pathvars:
    results=str(OUTPUT / "results"),
    figures=str(OUTPUT / "figures"),
    logs=str(OUTPUT / "results/logs"),


wildcard_constraints:
    scene="[^/]+",
    kind="[^/]+",
    sampling="[^/]+",
    method="[^/]+",
    modes="[^/]+",
    tolerance="[^/]+",
    name="[^/]+",


# What results exist --------------------------------------------------------------------------------


def references(scene):
    """References of a scene; errors are quoted against the first."""
    return [f"<results>/{scene}/reference_{kind}.nc" for kind in SCENES[scene]["references"]]


def sweep(scene, sampling):
    """The original reduced model for all mode counts of a sampling."""
    modes = SCENES[scene]["samplings"][sampling]["mode_counts"]
    return f"<results>/{scene}/{sampling}/original/k{modes}.nc"


def sampled_scenes():
    return [name for name, scene in SCENES.items() if scene["samplings"]]


def full_sweeps(*methods):
    """Reduced models of every sampling for all mode counts up to the usual largest."""
    return [
        f"<results>/{scene}/{sampling}/{method}/k{usual_sweep(SCENES[scene], sampling)}.nc"
        for scene in sampled_scenes()
        for sampling in SCENES[scene]["samplings"]
        for method in methods
    ]


def study_sweeps():
    """The same of the linearized and frozen models of every acceleration study."""
    return [
        f"<results>/{name}/{sampling}/{method}/k{usual_sweep(scene, sampling)}.nc"
        for name, scene in SCENES.items()
        for sampling, study in scene["acceleration"].items()
        for method in ["linearized", *(f"frozen{n}" for n in study["n_freeze"])]
    ]


def studies(file):
    """A file of every acceleration study."""
    return [
        f"<results>/{name}/{sampling}/{file}"
        for name, scene in SCENES.items()
        for sampling in scene["acceleration"]
    ]


def of_step_scene(file):
    """A file of the scene whose steps are timed, if there is one."""
    scene = CONFIG["benchmark"].get("step_scene")
    return [f"<results>/{scene}/{file}"] if scene else []


def stability_studies(study, file):
    """A file of every scene and sampling that a study of stability is made of."""
    return [
        f"<results>/{name}/{sampling}/{file}"
        for name, sampling in CONFIG["stability"][study].items()
    ]


def of_scenes(file, wanted=lambda scene: True):
    """A file of every scene that is wanted."""
    return [f"<results>/{name}/{file}" for name in SCENES if wanted(physical(name))]


def of_samplings(file, every=True):
    """A file of every sampling, or of the first of every scene."""
    return [
        f"<results>/{name}/{sampling}/{file}"
        for name in sampled_scenes()
        for sampling in list(SCENES[name]["samplings"])[: None if every else 1]
    ]


def growing_runs():
    """Runs that show a reduced model that grows."""
    stability, runs = CONFIG["stability"], []
    if "random_run" in stability:
        scene = stability["random_run"]["scene"]
        runs.append(f"<results>/{scene}/random_run.nc")
    if "long_run" in stability:
        run = stability["long_run"]
        folder = f"<results>/{run['scene']}/{run['sampling']}/long_run"
        runs.append(f"{folder}/k{run['mode_count']}.nc")
    return runs


def physical(name):
    return Scene.from_settings(name, SCENES[name])


def truth(scene):
    """What the error of full SPH is told against: the exact solution where it is known."""
    kind = "exact" if exact.kind(physical(scene)) else "centred"
    return f"<results>/{scene}/reference_{kind}.nc"


# Datasets of each table of stability.
STABILITY = {
    "stability": of_scenes("time_steps.nc") + of_samplings("time_steps.nc", every=False),
    "growth": of_scenes("growth.nc", lambda scene: scene.is_conservative),
    "operators": of_samplings("operators.nc"),
    "random_bases": of_scenes("random_bases.nc"),
    "smoothing": of_scenes("smoothing.nc"),
    "smoothing_ranking": of_scenes("smoothing.nc"),
    "amplitude": stability_studies("amplitude", "amplitude.nc"),
    "poor_snapshots": stability_studies("snapshots", "poor_snapshots.nc"),
    "machine": list(
        dict.fromkeys(
            path
            for study in ("snapshots", "amplitude", "map")
            for path in stability_studies(study, "machine.nc")
        )
    ),
    "detection": of_scenes("detection.nc", lambda scene: scene.is_even),
    "edge_scenes": [f"<results>/{name}/edge_scene.nc" for name in CONFIG["stability"]["scenes"]],
}


# What a rule passes to its script ------------------------------------------------------------------


def code(script):
    """Digest of the code that a script uses, so that what other code has made is made anew."""
    return provenance.digest(ROOT / "workflow/scripts" / script)


def physics(wildcards):
    """Settings that the solutions of a scene depend on; samplings and figures are not among them."""
    scene = SCENES[wildcards.scene]
    return {key: scene[key] for key in PHYSICS_KEYS if key in scene}


def sampling_settings(wildcards):
    """Settings that the snapshots of a sampling depend on, and all that is made of them.

    All rules are given all settings that their results depend on, those of their inputs too. A file
    that was made of others, and has taken the place of a result, is then known by them.
    """
    sampling = SCENES[wildcards.scene]["samplings"][wildcards.sampling]
    return {key: value for key, value in sampling.items() if key != "mode_counts"}


def study_settings(wildcards):
    return SCENES[wildcards.scene]["acceleration"][wildcards.sampling]


def snapshot_steps(wildcards):
    """Time steps of snapshots beside those of the error integral."""
    scene = Scene.from_settings(wildcards.scene, physics(wildcards))
    steps = snapshots.output_steps(scene, SCENES[wildcards.scene]["samplings"].values())
    return np.setdiff1d(steps, scene.error_steps).tolist()


def seed_of_scene(wildcards):
    """Another one for every scene, so that scenes with one operator are not drawn alike."""
    return list(SCENES).index(wildcards.scene)


def all_modes(wildcards):
    return parse_modes(usual_sweep(SCENES[wildcards.scene], wildcards.sampling))


def stability_modes(wildcards):
    """Mode counts that are studied, those that the sampling gives; the largest if it gives none."""
    most = all_modes(wildcards)[-1]
    return [k for k in CONFIG["stability"]["mode_counts"] if k <= most] or [most]


def paper_study(wildcards):
    """What the conventions are studied on; figures are not among it."""
    scenes = {
        name: {key: value for key, value in scene.items() if key != "figures"}
        for name, scene in SCENES.items()
    }
    return {"scenes": scenes, "claims": CONFIG["claims"]}


def figure_options(wildcards):
    """Arguments of the plotting function of a figure that are not inputs."""
    figure = ALL_FIGURES[wildcards.name]
    options = {key: figure[key] for key in ("fields", "position") if key in figure}
    if figure["kind"] in ("profile", "modes") and "positions" in SCENES[figure["scene"]]:
        options["length"] = SCENES[figure["scene"]]["domain_length"]
    if figure["kind"] in ("error", "acceleration"):
        options["reference"] = SCENES[figure["scene"]]["references"][0]
    if figure["kind"] == "phase":
        options["beta"] = derivative_coefficient(SCENES[figure["scene"]]["smoothing_ratio"])
    return options


# Inputs without a file, which check what a target names before any job starts ----------------------


def known(what, name, names):
    if name not in names:
        near = difflib.get_close_matches(name, names, n=1)
        meant = f"did you mean {near[0]}? " if near else ""
        stop(f"{what} = {name}: {meant}allowed are {', '.join(names)}")
    return []


def known_scene(wildcards):
    return known("scene", wildcards.scene, SCENES)


def known_reference(wildcards):
    known_scene(wildcards)
    exists = exact.kind(Scene.from_settings(wildcards.scene, physics(wildcards)))
    kinds = ["fd", "centred", *(["exact"] if exists else [])]
    kinds += ["modified"] if exists == "dalembert" else []
    return known(f"scene {wildcards.scene}: reference", wildcards.kind, kinds)


def known_sampling(wildcards):
    known_scene(wildcards)
    samplings = SCENES[wildcards.scene]["samplings"]
    return known(f"scene {wildcards.scene}: sampling", wildcards.sampling, samplings)


def known_study(wildcards):
    known_scene(wildcards)
    studies = SCENES[wildcards.scene]["acceleration"]
    return known(f"scene {wildcards.scene}: acceleration", wildcards.sampling, studies)


def known_benchmark(wildcards):
    """What a scene may lack is left out of one that lacks it all."""
    scene = known_scene(wildcards) or Scene.from_settings(wildcards.scene, physics(wildcards))
    if exact.kind(scene) != "dalembert" or scene.force_time is not None:
        stop(f"scene = {wildcards.scene}: this needs one without damping, force or layers")
    return []


def known_undamped(wildcards):
    """Of which theory tells the growth wave by wave."""
    scene = known_scene(wildcards) or physical(wildcards.scene)
    if not scene.is_conservative:
        stop(f"scene = {wildcards.scene}: this needs one without damping and force")
    return []


def known_even(wildcards):
    scene = known_scene(wildcards) or physical(wildcards.scene)
    if not scene.is_even:
        stop(f"scene = {wildcards.scene}: this needs one with evenly spaced particles")
    return []


def known_edge_scene(wildcards):
    return known("scene at the edge", wildcards.scene, CONFIG["stability"]["scenes"])


def known_reduced_model(wildcards):
    known_sampling(wildcards)
    if not re.fullmatch(
        r"original|linearized|frozen[1-9]\d{0,14}|lifted_(euler|exact)", wildcards.method
    ):
        allowed = "original, linearized, frozen1, frozen2, …, lifted_euler, lifted_exact"
        stop(f"scene {wildcards.scene}: method = {wildcards.method}: allowed are {allowed}")
    try:
        check_modes(CONFIG, wildcards.scene, wildcards.sampling, wildcards.modes, wildcards.method)
    except ConfigError as error:
        stop(error)
    return []


def known_tolerance(wildcards):
    """A mode count chosen by tolerance needs the error bound, which ``lifted_exact`` alone has."""
    known_sampling(wildcards)
    known(f"scene {wildcards.scene}: method", wildcards.method, ["lifted_exact"])
    try:
        parse_tolerance(wildcards.tolerance)
    except ValueError as error:
        stop(f"scene {wildcards.scene}: tolerance = {wildcards.tolerance}: {error}")
    return []


def paper_inputs(wildcards):
    if not paper.applies(CONFIG):
        needed = ", ".join(paper.NEEDED)
        stop(f"scenes = {', '.join(SCENES)}: the conventions are studied on the paper's, {needed}")
    return [f"<results>/{path}" for path in paper.inputs(CONFIG)]


def figure_inputs(wildcards):
    """What a figure shows, named as the arguments of its plotting function."""
    known("figure", wildcards.name, ALL_FIGURES)
    figure = ALL_FIGURES[wildcards.name]
    scene, sampling = figure.get("scene"), figure.get("sampling")
    of_scene, of_sampling = f"<results>/{scene}", f"<results>/{scene}/{sampling}"
    match figure["kind"]:
        case "profile":
            return {"solution": references(scene)[0]}
        case "initial_spectrum":
            return {"solution": f"{of_scene}/sph.nc"}
        case "phase":
            return {
                "sph": f"{of_scene}/sph.nc",
                "exact": f"{of_scene}/reference_exact.nc",
                "modified": f"{of_scene}/reference_modified.nc",
            }
        case "modes":
            return {"pod": f"{of_sampling}/pod.nc"}
        case "error":
            return {
                "pod": f"{of_sampling}/pod.nc",
                "sweep": sweep(scene, sampling),
                "errors": f"{of_scene}/errors.nc",
            }
        case "acceleration":
            return {
                "acceleration": f"{of_sampling}/acceleration.nc",
                "cpu_time": f"{of_sampling}/cpu_time.nc",
                "errors": f"{of_scene}/errors.nc",
            }
        case "work_precision":
            return {"benchmark": f"{of_sampling}/benchmark.nc"}
        case "scaling":
            return {"scaling": f"{of_scene}/scaling.nc"}
        case "limits":
            return {"tables": STABILITY["stability"]}
        case "growth" | "smoothing":
            return {"scenes": STABILITY[figure["kind"]]}
        case "operators":
            return {
                "samplings": STABILITY["operators"],
                "random": STABILITY["random_bases"],
                "runs": growing_runs(),
            }
        case "stability_map":
            return {
                "damping": f"{of_scene}/stability_map.nc",
                "modes": f"{of_sampling}/stability_map.nc",
            }
        case "amplitude":
            return {"amplitude": f"{of_sampling}/amplitude.nc"}
        case "noise":
            return {"snapshots": f"{of_sampling}/poor_snapshots.nc"}
    return {}


def figure_category(wildcards):
    section = ALL_FIGURES[wildcards.name]["section"]
    return f"Section {section}" if section[:1].isdigit() else section
