"""The configuration, and what the rules ask of it."""

import functools
import hashlib
import operator
import os
import re
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

from snakemake.io import strip_wildcard_constraints

from sphpod.paper import claims, paper, summary
from sphpod.reference import exact
from sphpod.pipeline import provenance, targets
from sphpod.reduced import snapshots
from sphpod.config.config import ConfigError, check_modes, distinct_names, known_references, load
from sphpod.config.mode_counts import parse_modes, parse_pair, parse_tolerance, usual_sweep
from sphpod.config.reading import typed
from sphpod.scene.kernel import derivative_coefficient
from sphpod.scene.scene import Scene, physical_settings
from sphpod.studies.study import figure_parts, studies as declared_studies
from sphpod.surveys import jobs as survey_jobs, samples

# That of this file, which may be a module of another workflow.
ROOT = Path(workflow.current_basedir).parents[1]

# The package beside this workflow, whose code the digests name, goes before any installed one.
os.environ.update(PYTHONPATH=f"{ROOT}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")


def stop(sentence):
    """End the run before its first job with one sentence, not with a traceback."""
    sys.exit(f"sphpod: {sentence}")


try:
    if config and Path(workflow.basedir) != ROOT:
        # What the workflow gives that uses this one as a module.
        CONFIG = load([], overrides=typed(config))
    else:
        # A configuration that is asked for replaces the paper's; `configfile:` would merge the two.
        CONFIG = load(
            workflow.overwrite_configfiles or [ROOT / "config/config.yaml"],
            overrides=typed(workflow.config_settings.config),
        )
    CLAIMS = claims.resolve(CONFIG)
except ConfigError as error:
    stop(error)

OUTPUT = Path(CONFIG["output"])
if len(sys.executable.split()) > 1:
    stop(f"{sys.executable} has a space in its path, which scripts of Snakemake cannot be run with")
SCENES = CONFIG["scenes"]
SURVEYS = CONFIG["surveys"]
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
                ", ".join(f"{key} {one[key]}" for key in ("kind", "study", "scene") if key in one)
                for one in (figure, others[name])
            )
            stop(f"figure = {name}: this is the name of {both}; every figure needs its own")
        found[name] = figure
    return found


def path_of(name, place, root="<results>", form="nc"):
    """File of a dataset of a study, or its log; a number of modes, the last of a place, names it."""
    scene, *sampling = place
    if len(sampling) > 1:
        name = os.path.join(name, f"k{sampling.pop()}")
    return os.path.join(root, scene, *sampling, f"{name}.{form}")


def paths_of(study, names):
    """Files that a study asks for, of its datasets of these names."""
    return [path_of(name, place) for name in names for place in study.datasets[name].places(CONFIG)]


STUDIES = declared_studies()
STUDIES_OF_MODES = [
    name for study in STUDIES.values() for name, data in study.datasets.items() if data.of_modes
]


def study_figures(target, others):
    """Figures of the studies of a target, which are no part of the paper."""
    figures = []
    for word, study in STUDIES.items():
        if study.drawing is None or study.target != target:
            continue
        name = figure_parts(word, study)
        drawing = {"study": word, "draw": study.drawing.draw, "section": target}
        if study.drawing.places is not None:
            for scene, sampling in study.drawing.places(CONFIG):
                place = {"scene": scene, "sampling": sampling}
                caption = study.drawing.caption.format(**place)
                figure = {**drawing, **place, "caption": caption}
                figures.append(((*name, scene, sampling), figure))
        elif paths_of(study, next(iter(study.drawing.reads.values()))):
            figure = {**drawing, "caption": study.drawing.caption}
            figures.append((name, figure))
    return by_name(figures, others)


BENCHMARK_FIGURES = study_figures("benchmarks", FIGURES)
STABILITY_FIGURES = study_figures("stability", FIGURES | BENCHMARK_FIGURES)
ALL_FIGURES = FIGURES | BENCHMARK_FIGURES | STABILITY_FIGURES
TARGETS = ["all", "lifted", "benchmarks", "stability", "surveys"]


pathvars:
    results=str(OUTPUT / "results"),
    figures=str(OUTPUT / "figures"),
    logs=str(OUTPUT / "results/logs"),


wildcard_constraints:
    # What surveys give lies in a folder of their own.
    scene=r"(?!surveys(/|$))[^/]+",
    survey="[^/]+",
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
    """Reduced models of every sampling for all mode counts up to the usual largest.

    The paper's know no free ends.
    """
    return [
        f"<results>/{scene}/{sampling}/{method}/k{usual_sweep(SCENES[scene], sampling)}.nc"
        for scene in sampled_scenes()
        for sampling in SCENES[scene]["samplings"]
        for method in methods
        if method.startswith("lifted") or "free" not in SCENES[scene].get("boundary", "")
    ]


def study_sweeps():
    """The same of the linearized and frozen models of every acceleration study."""
    return [
        f"<results>/{name}/{sampling}/{method}/k{usual_sweep(scene, sampling)}.nc"
        for name, scene in SCENES.items()
        for sampling, study in scene["acceleration"].items()
        for method in ["linearized", *(f"frozen{n}" for n in study["n_freeze"])]
    ]


def physical(name, scenes=SCENES):
    return Scene.from_settings(name, scenes[name])


def truth(scene):
    """What the error of full SPH is taken against: the exact solution where it is known."""
    kind = "exact" if exact.kind(physical(scene)) else "centred"
    return f"<results>/{scene}/reference_{kind}.nc"


# Of each table, the function of its rows and its datasets.
TABLES = {
    table: (f"studies.comparison.{table}", full_sweeps("lifted_exact"))
    for table in ("effectivity", "certificates")
} | {
    table: (rows, paths_of(study, names))
    for study in STUDIES.values()
    for table, (rows, *names) in study.tables.items()
}


# Tables that are pages of the report too.
PAGES = [*TABLES, "claims", "conventions", "errata", "reference_errors", "thresholds"]


def tables(target):
    """Tables of the studies of a target."""
    return [
        f"<results>/{table}.{form}"
        for study in STUDIES.values()
        for table in study.tables
        for form in ("csv", "html")
        if study.target == target and TABLES[table][1]
    ]


# What a rule passes to its script ------------------------------------------------------------------


def code(script):
    """Digest of the code that a script uses, so that what other code has made is made anew.

    It is computed when a job asks for it: a Snakemake that runs one job of a cluster starts sooner.
    """
    return lambda wildcards: provenance.digest(ROOT / "workflow/scripts" / script)


def setting_of(key):
    """A setting of the configuration, by its names joined by dots."""
    return functools.reduce(operator.getitem, key.split("."), CONFIG)


class Place(NamedTuple):
    """A scene and a sampling, as wildcards name them."""

    scene: str
    sampling: str


def physics(wildcards, scenes=SCENES):
    """Settings that the solutions of a scene depend on; samplings and figures are not among them."""
    return physical_settings(scenes[wildcards.scene])


def sampling_settings(wildcards):
    """Settings that the snapshots of a sampling depend on, and all that is made of them.

    All rules are given all settings that their results depend on, those of their inputs too. A file
    that was made of others, and has taken the place of a result, is then known by them.
    """
    sampling = SCENES[wildcards.scene]["samplings"][wildcards.sampling]
    settings = {key: value for key, value in sampling.items() if key != "mode_counts"}
    if "modes" in settings:
        settings["lent"] = [
            {"physics": physics(place), "sampling": sampling_settings(place)}
            for place in (Place(*source) for source in lenders(wildcards))
        ]
    return settings


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


def studied_modes(wildcards):
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
    figure = {"kind": None} | ALL_FIGURES[wildcards.name]
    keys = "fields", "position", "end_time", "last_harmonic", "multiples"
    options = {key: figure[key] for key in keys if key in figure}
    if figure["kind"] in ("profile", "modes"):
        options["layers"] = exact.layers(physical(figure["scene"]))
    uneven = {"positions", "boundary"} & set(SCENES.get(figure.get("scene"), ()))
    if figure["kind"] in ("profile", "modes") and uneven:
        options["length"] = SCENES[figure["scene"]]["domain_length"]
    if figure["kind"] in ("error", "acceleration"):
        options["reference"] = SCENES[figure["scene"]]["references"][0]
    if figure["kind"] == "phase":
        options["beta"] = derivative_coefficient(SCENES[figure["scene"]]["smoothing_ratio"])
    return options


# What the one script of datasets is given -----------------------------------------------------------

REFERENCES = {
    "fd": "reference.reference.solve_paper",
    "centred": "reference.reference.solve_centred",
    "chain": "reference.chain.solve",
    "exact": "reference.exact.solve",
    "modified": "reference.exact.solve_modified",
}
LIFTED_METHODS = {
    "lifted_euler": "reduced.lifted_rom.repeat_sph",
    "lifted_exact": "reduced.certificate.certify",
}


# What takes a bar with ends to its images and back.
FOLDS = ["bar.of_bar", "bar.of_line"]


def computed(compute, alone=False, of_sampling=False, all_times=False, scenes=SCENES, **arguments):
    """Parameters of a rule: its function and, beside scene and inputs, what that is given.

    The function and arguments may be of the wildcards, as parameters of Snakemake; one that is
    None is left out.
    """

    def of(value, wildcards):
        return value(wildcards) if callable(value) else value

    return {
        "compute": lambda wildcards: of(compute, wildcards),
        "code": lambda wildcards: provenance.digest(
            of(compute, wildcards), *(FOLDS if "boundary" in scenes[wildcards.scene] else [])
        ),
        "physics": lambda wildcards: physics(wildcards, scenes),
        "sampling": lambda wildcards: sampling_settings(wildcards) if of_sampling else {},
        "arguments": lambda wildcards: {
            name: found
            for name, value in arguments.items()
            if (found := of(value, wildcards)) is not None
        },
        "alone": alone,
        "all_times": all_times,
    }


def lifted_from(scene, method):
    """The full model whose errors a lifted model has: full SPH, or the lifted one exact in time."""
    return f"<results>/{scene}/{'sph' if method == 'lifted_euler' else 'lifted_full'}.nc"


# What a study declares of a dataset, as a rule is given it --------------------------------------------


def wildcards_of(data):
    return ["{scene}", *["{sampling}"] * data.of_sampling, *["{modes}"] * data.of_modes]


def scenes_of(data):
    return setting_of(data.own_scenes) if data.own_scenes else SCENES


def arguments_of(data):
    """What its function is given beside scene and datasets, of wildcards."""

    def setting(key, wildcards):
        of_place = {
            "sampling": sampling_settings,
            "modes": lambda wildcards: int(wildcards.modes),
            "seed": seed_of_scene,
            "all_mode_counts": all_modes,
            "mode_counts": studied_modes,
            "largest_mode_count": lambda wildcards: max(studied_modes(wildcards)),
            "acceleration": study_settings,
            "acceleration.n_freeze": lambda wildcards: study_settings(wildcards)["n_freeze"],
            "acceleration.mode_counts": lambda wildcards: study_settings(wildcards)["mode_counts"],
        }
        return of_place[key](wildcards) if key in of_place else setting_of(key)

    def argument(value):
        if isinstance(value, str):
            return lambda wildcards: setting(value, wildcards)
        return lambda wildcards: value(
            physical(wildcards.scene, scenes_of(data)), lambda key: setting(key, wildcards)
        )

    return {name: argument(value) for name, value in data.arguments.items()}


def inputs_of(data):
    """Datasets that are read, once it is known that there is what a target names."""

    def inputs(wildcards):
        known("scene", wildcards.scene, scenes_of(data))
        if data.only_asked:
            known("scene", wildcards.scene, [place[0] for place in data.places(CONFIG)])
        if data.of_sampling:
            known_sampling(wildcards)
        if data.of_modes:
            known_modes(wildcards)
        if "acceleration" in str(data.arguments.values()):
            known_study(wildcards)
        if data.needs and not data.needs[0](physical(wildcards.scene, scenes_of(data))):
            stop(f"scene = {wildcards.scene}: this needs one {data.needs[1]}")
        folder = f"<results>/{wildcards.scene}"
        return {
            name: (
                truth(wildcards.scene)
                if file == "truth"
                else os.path.normpath(f"{folder}/{wildcards.get('sampling', '')}/{file}")
            )
            for name, file in data.reads.items()
        }

    return inputs


# Inputs without a file, which check what a target names before any job starts ----------------------


def known(what, name, names):
    if name not in names:
        stop(targets.choice(what, name, names))
    return []


def written_out(file):
    """Paths below the output of what a rule makes, one for each table or figure that there is."""
    path = Path(strip_wildcard_constraints(file)).relative_to(OUTPUT).as_posix()
    in_survey = path.startswith("results/surveys/")
    for wildcard, names in (
        ("{drawing}", SURVEY_FIGURES),
        ("{table}.csv", SURVEY_TABLES if in_survey else TABLES),
        ("{table}.html", PAGES),
        ("figures/{name}", ALL_FIGURES),
    ):
        if wildcard in path:
            word = wildcard[wildcard.index("{") : wildcard.index("}") + 1]
            return [path.replace(word, name) for name in names]
    return [path]


def names_of(wildcard, place):
    """Names that a wildcard of a path may stand for, beside those of earlier ones."""
    samplings = SCENES.get(place.get("scene"), {}).get("samplings", {})
    return {"scene": SCENES, "sampling": samplings, "survey": SURVEYS}.get(wildcard)


def makers():
    """Rules that make what they are asked for."""
    return [each for each in workflow.rules if each.name != "unknown_target"]


def unknown(wildcards):
    """Input of a target that no rule makes, which says what is made in its place."""
    made = [path for each in makers() for file in each.output for path in written_out(file)]
    target = os.path.relpath(wildcards.target)
    if OUTPUT.is_absolute():
        target = os.path.abspath(target)
    stop(targets.refusal(target, list(dict.fromkeys(made)), str(OUTPUT), TARGETS, names_of))


def made_by_none():
    """Pattern of what no rule makes, below the output, of bare names, and where no folder is.

    In other folders that are there files may be somebody's own.
    """

    def either(paths):
        # Braces would be those of a wildcard.
        return "|".join(re.sub(r"\\?[{}]", ".", re.escape(path)) for path in paths)

    tops = [Path(top) for top in ("results", "figures")]
    own = [*tops, *(OUTPUT / top for top in tops), *((OUTPUT / top).absolute() for top in tops)]
    own += [OUTPUT] if OUTPUT.parts else []
    folders = [name for name in os.listdir() if os.path.isdir(name)]
    made = [file.regex().pattern for each in makers() for file in each.output]
    elsewhere = f"(?![/.~])(?!({either(TARGETS)})$)(?!({either(folders)})/)[^:]+"
    return f"{targets.unlike(made)}((({either(map(str, own))})/.+)|{elsewhere})"


def known_scene(wildcards):
    return known("scene", wildcards.scene, SCENES)


def known_reference(wildcards):
    known_scene(wildcards)
    kinds = known_references(physical(wildcards.scene))
    return known(f"scene {wildcards.scene}: reference", wildcards.kind, kinds)


def known_sampling(wildcards):
    known_scene(wildcards)
    samplings = SCENES[wildcards.scene]["samplings"]
    return known(f"scene {wildcards.scene}: sampling", wildcards.sampling, samplings)


def is_own(wildcards):
    """Whether a sampling is a file of somebody's own, which depends on no solution."""
    return "from" in SCENES[wildcards.scene]["samplings"][wildcards.sampling]


def lenders(wildcards):
    """Samplings whose snapshots give the modes of another, by scene and name; none if its own do."""
    sampling = SCENES[wildcards.scene]["samplings"][wildcards.sampling]
    return [Path(source).parts for source in sampling.get("modes", {}).get("from", [])]


def lending_scenes(wildcards):
    """Settings of the scenes whose snapshots give the modes, of one for each sampling."""
    return [physics(Place(*source)) for source in lenders(wildcards)] or None


def mode_inputs(wildcards):
    """Snapshots that modes are made of."""
    known_sampling(wildcards)
    files = [f"<results>/{scene}/{name}/snapshots.nc" for scene, name in lenders(wildcards)]
    own = f"<results>/{wildcards.scene}/{wildcards.sampling}/snapshots.nc"
    return {"snapshots": files or own}


def snapshot_inputs(wildcards):
    known_sampling(wildcards)
    if lent := lenders(wildcards):
        names = ", ".join(str(Path(*source)) for source in lent)
        stop(
            f"scene {wildcards.scene}: sampling = {wildcards.sampling}: it has no snapshots of its "
            f"own; its modes are of those of {names}"
        )
    return {} if is_own(wildcards) else {"solution": f"<results>/{wildcards.scene}/sph.nc"}


def known_study(wildcards):
    known_scene(wildcards)
    studies = SCENES[wildcards.scene]["acceleration"]
    return known(f"scene {wildcards.scene}: acceleration", wildcards.sampling, studies)


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


def known_modes(wildcards):
    try:
        check_modes(CONFIG, wildcards.scene, wildcards.sampling, wildcards.modes)
    except ConfigError as error:
        stop(error)


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


def no_inputs_of_errata(wildcards):
    """None, once it is known that the paper is what is configured."""
    paper_inputs(wildcards)
    return []


def errata_text():
    """Digest of the page that lists the errata: where it changes, so does the table."""
    page = ROOT / "docs" / "reproducing-the-paper.md"
    return hashlib.sha256(page.read_bytes()).hexdigest()[:16]


def figure_inputs(wildcards):
    """What a figure shows, named as the arguments of its plotting function."""
    known("figure", wildcards.name, ALL_FIGURES)
    figure = ALL_FIGURES[wildcards.name]
    scene, sampling = figure.get("scene"), figure.get("sampling")
    if "study" in figure:
        return study_inputs(STUDIES[figure["study"]], scene, sampling)
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
    return {}


def study_inputs(study, scene, sampling):
    """What the figure of a study shows, of a place or of all."""
    reads = study.drawing.reads.items()
    if scene is None:
        return {argument: paths_of(study, names) for argument, names in reads}
    places = {True: (scene, sampling), False: (scene,)}
    return {
        argument: path_of(name, places[study.datasets[name].of_sampling])
        for argument, (name,) in reads
    }


def drawing_function(wildcards):
    """Name of the function that draws a figure."""
    figure = ALL_FIGURES[wildcards.name]
    return figure.get("draw") or f"figures.plotting.{figure['kind']}"


def figure_category(wildcards):
    """Part of the report: in the paper's order as these names sort, its appendices after sections."""
    section = ALL_FIGURES[wildcards.name]["section"]
    shown = {"benchmarks": "Run time", "stability": "Stability", "": "Scenes"}.get(section, section)
    if section[:1].isdigit():
        shown = f"Paper {section}"
    elif re.fullmatch(r"[A-Z](\.\d+)*", section):
        shown = f"Paper, appendix {section}"
    # Snakemake would take {x} for a wildcard; a space of no width behind the bracket stops it.
    return shown.replace("{", "{\u200b")


def figure_labels(wildcards):
    """What tells a figure from the others of its part of the report."""
    figure = ALL_FIGURES[wildcards.name]
    kind = figure.get("kind") or figure["study"]
    return {
        "figure": wildcards.name.partition("_")[0] if wildcards.name in FIGURES else wildcards.name,
        "scene": figure.get("scene", ""),
        "sampling": figure.get("sampling", ""),
        "kind": kind.replace("_", " "),
    }


def page_category(wildcards):
    """Claims come first, and tables of studies beside their figures."""
    if wildcards.table in ("claims", "conventions", "errata", "reference_errors"):
        return "Claims"
    timed = {
        "benchmark",
        "skipping",
        "cpu_time",
        "step_time",
        *("thresholds", "effectivity", "certificates"),
    }
    return "Run time" if wildcards.table in timed else "Stability"


def figure_caption(wildcards):
    """The caption as text: in a report, reStructuredText would act on what it says."""
    words = " ".join(ALL_FIGURES[wildcards.name]["caption"].split())
    return re.sub(r"([^\w\s])", r"\\\1", words)
