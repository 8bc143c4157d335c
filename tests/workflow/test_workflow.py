"""The whole pipeline on config/small.yaml: complete, remade where it must be, safe when killed."""

import csv
import json
import os
import re
import shutil
import subprocess
import time
from contextlib import ExitStack, contextmanager
from pathlib import Path

import cf
import numpy as np
import pandas as pd
import pytest
import runs
import xarray as xr
import yaml

from sphpod.config.stability_section import STABILITY_STUDIES
from sphpod.paper import errata
from sphpod.pipeline import dataset
from sphpod.pipeline.page import of_table
from sphpod.scene.scene import PHYSICS_KEYS, Scene

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.workflow

SOURCES = ("Snakefile", "config", "profiles", "sphpod", "workflow")
# The rules whose results are measured times, and what is computed from those.
TIMED = re.compile(
    r"/(cpu_time|step_time|benchmark|skipping|scaling|claims|detection|cost)\.|/acceleration\.csv$|/logs/"
    r"|(_acceleration|/benchmark_[^/]+)\.(pdf|png)$"
)
# Rules that are run for the targets `lifted` and `benchmarks` alone.
LIFTED = {"lifted_full", "lifted_pod", "lifted_model", "thresholds", "table", "page"}
MEASURED = {"benchmark", "scaling", "skipping"}


def snakemake(folder, *arguments, **environment):
    """Run Snakemake on config/small.yaml in a copy of the project."""
    return runs.run(folder, "--configfile", "config/small.yaml", *arguments, **environment)


def copy_of_project(folder, original=ROOT):
    """A copy without results, but with the kernels that the original has compiled."""
    for name in SOURCES:
        source = original / name
        (shutil.copytree if source.is_dir() else shutil.copy2)(source, folder / name)
    return folder


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """A copy of the project in which config/small.yaml has been built."""
    folder = copy_of_project(tmp_path_factory.mktemp("built"))
    run = snakemake(folder)
    assert run.returncode == 0, run.stderr
    return folder


@pytest.fixture(scope="module")
def benchmarked(built, tmp_path_factory):
    """A copy of what has been built, to which the lifted models and the benchmarks were added."""
    folder = tmp_path_factory.mktemp("benchmarked") / "project"
    shutil.copytree(built, folder)
    run = snakemake(folder, "--", "lifted", "benchmarks")
    assert run.returncode == 0, run.stderr
    return folder


@pytest.fixture(scope="module")
def stabilised(built, tmp_path_factory):
    """A copy of what has been built, to which the study of stability was added."""
    folder = tmp_path_factory.mktemp("stabilised") / "project"
    shutil.copytree(built, folder)
    run = snakemake(folder, "--", "stability")
    assert run.returncode == 0, run.stderr
    return folder


def results(folder):
    """Bytes of every result and figure that is no measured time, by path."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.glob("small/**/*"))
        if path.is_file() and not TIMED.search(str(path))
    }


def planned(folder, *arguments):
    """Rules that would run now."""
    run = snakemake(folder, "--dry-run", *arguments)
    assert run.returncode == 0, run.stderr
    output = run.stdout + run.stderr
    if "Nothing to be done" in output:
        return set()
    table = output.partition("Job stats:")[2].partition("total")[0]
    return set(re.findall(r"^(\w+) +\d+$", table, re.MULTILINE)) - {
        "all",
        "lifted",
        "benchmarks",
        "stability",
    }


def test_everything_is_built(built):
    config = yaml.safe_load((built / "config" / "small.yaml").read_text())
    figures = sum(len(scene.get("figures", [None])) for scene in config["scenes"].values()) + len(
        config["illustrations"]
    )
    assert len(list((built / "small" / "figures").glob("*.pdf"))) == figures
    assert len(list((built / "small" / "figures").glob("*.png"))) == figures
    assert not (built / "results").exists()
    # No file half written; what the pipeline makes is kept out of git.
    assert list(built.glob("small/**/.*")) == [built / "small/.gitignore"]
    datasets = list(built.glob("small/results/**/*.nc"))
    assert len(datasets) > 15
    for path in datasets:
        with xr.open_dataset(path) as file:
            assert file.attrs["title"]
            assert not (path.parent.name == "waves" and np.isnan(file.get("velocity", 0)).any())


def test_nothing_is_done_twice(built):
    assert planned(built) == set()


def test_one_result_needs_only_its_ancestors(built, tmp_path):
    target = "small/results/waves/uniform10/frozen3/k2.nc"
    assert planned(built, target) == {"reduced_model"}
    assert planned(copy_of_project(tmp_path), target) == {
        "sph",
        "reference",
        "snapshots",
        "pod",
        "reduced_model",
    }
    figure = "small/figures/waves_uniform10_modes.pdf"
    assert planned(tmp_path, figure) == {"sph", "snapshots", "pod", "figure"}
    assert planned(built, "--force", figure) == {"figure"}
    assert planned(built, "--forcerun", "pod", "--", figure) == {"pod", "figure"}


def test_modes_that_are_borrowed_are_made_of_the_lenders_and_made_anew_with_them(built, tmp_path):
    scene = yaml.safe_load((built / "config/small.yaml").read_text())["scenes"]["waves"]
    scene |= {"acceleration": {}, "figures": [], "references": ["centred"]}
    scenes = {
        "soft": scene | {"youngs_modulus": 0.08},
        "hard": scene | {"youngs_modulus": 0.12, "initial_density": "1 + 0.1*sin(2*pi*x/L)"},
        "between": scene
        | {"samplings": {"both": {"modes": {"from": ["soft/uniform10", "hard/uniform10"]}}}},
    }
    settings = {"output": "borrowed", "scenes": scenes}
    (tmp_path / "own.yaml").write_text(yaml.safe_dump(settings))
    config = ["--configfile", str(tmp_path / "own.yaml")]
    targets = [
        f"borrowed/results/between/both/{method}/k6.nc" for method in ("original", "lifted_exact")
    ]
    run = runs.run(built, *config, "--", *targets)
    assert run.returncode == 0, run.stderr
    lifted = dataset.read(built / targets[1])
    assert 0 < lifted["energy_error_lifted"] <= lifted["energy_error_bound"] < 0.1
    changed = ["--config", "scenes={hard: {samplings: {uniform10: {count: 9}}}}"]
    run = runs.run(built, "--dry-run", *config, *changed, "--", *targets)
    table = run.stdout.partition("Job stats:")[2].partition("total")[0]
    assert set(re.findall(r"^(\w+) +\d+$", table, re.MULTILINE)) == {
        "sph", "snapshots", "pod", "lifted_pod", "reduced_model", "lifted_model",
    }  # fmt: skip
    run = runs.run(built, "--dry-run", *config, "--", "borrowed/results/between/both/snapshots.nc")
    assert (
        "sampling = both: it has no snapshots of its own; its modes are of those of" in run.stderr
    )
    # Studies leave out what they have no snapshots of.
    settings["stability"] = {"stability_map": {"between": "both"}, "smoothing_ratios": [1.04, 1.2]}
    (tmp_path / "own.yaml").write_text(yaml.safe_dump(settings))
    run = runs.run(built, "--dry-run", *config, "--", "all", "lifted", "stability", "benchmarks")
    said = run.stdout + run.stderr
    assert run.returncode == 0, said
    assert "between/both/mode_map.nc" in said
    assert "between/both/snapshots.nc" not in said


@contextmanager
def edited(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    try:
        yield
    finally:
        path.write_text(text)


@pytest.mark.parametrize(
    ("module", "old", "new"),
    [
        ("full/sph", '"""', '"""Told otherwise. '),
        ("figures/plotting", '"""', '"""Told otherwise. '),
        ("reduced/rom", "\nimport ", "\n# A comment.\nimport "),
    ],
)
def test_words_make_nothing_anew(built, module, old, new):
    with edited(built / "sphpod" / f"{module}.py", old, new):
        assert planned(built) == set()


def test_a_plot_makes_only_figures_anew(built):
    with edited(
        built / "sphpod" / "figures" / "plotting.py", "\nCOLUMN_WIDTH = ", "\nCOLUMN_WIDTH = 0.5 * "
    ):
        assert planned(built) == {"figure"}
    with edited(built / "sphpod/figures/style.mplstyle", "font.size: ", "font.size: 1"):
        assert planned(built) == {"figure"}


def test_code_makes_anew_what_uses_it(built):
    with edited(
        built / "sphpod" / "reduced" / "pod.py", "ROUNDING_LEVEL = ", "ROUNDING_LEVEL = 2 * "
    ):
        rules = planned(built)
    assert {"reduced_model", "acceleration", "figure"} <= rules
    assert not {"sph", "reference", "errors", "snapshots", "pod", "cpu_time"} & rules


def records(folder):
    """What Snakemake keeps of every result that decides whether it is made anew."""
    decisive = "rule", "input", "log", "params", "endtime", "input_checksums"
    return {
        path.name: {key: json.loads(path.read_text())[key] for key in decisive}
        for path in (folder / ".snakemake" / "metadata").rglob("*")
        if path.is_file()
    }


@pytest.fixture(scope="module")
def bare(benchmarked, tmp_path_factory):
    """A copy of the benchmarks without the folder that Snakemake keeps."""
    folder = tmp_path_factory.mktemp("bare") / "project"
    shutil.copytree(benchmarked, folder, ignore=shutil.ignore_patterns(".snakemake"))
    return folder


@pytest.mark.parametrize("target", ["benchmarks", "stability"])
def test_results_hold_what_snakemake_keeps_of_them(bare, stabilised, benchmarked, tmp_path, target):
    if target == "benchmarks":
        original, folder = benchmarked, bare
    else:
        original, folder = stabilised, tmp_path / "stabilised"
        shutil.copytree(stabilised, folder, ignore=shutil.ignore_patterns(".snakemake"))
    assert planned(folder, "--", "all", target) == set()
    found, kept = records(folder), records(original)
    assert found == {name: kept[name] for name in found}
    assert len(found) == sum(path.suffix not in ("", ".log") for path in folder.glob("small/**/*"))


def made_anew(folder, target, **environment):
    """Messages of all jobs that would run for a target, and all that is said of them."""
    run = snakemake(folder, "--dry-run", "--", target, **environment)
    assert run.returncode == 0, run.stderr
    said = run.stdout + run.stderr
    return sorted(re.findall(r"^Job \d+: (.*)$", said, re.M)), said


@pytest.mark.parametrize("change", ["key", "kernel", "library", "code of what is missing"])
def test_the_same_is_made_anew_without_what_snakemake_keeps(benchmarked, bare, tmp_path, change):
    environment = {}
    if change == "library":
        numba = tmp_path / "numba-99.dist-info"
        numba.mkdir()
        (numba / "METADATA").write_text("Metadata-Version: 2.1\nName: numba\nVersion: 99\n")
        environment = {"PYTHONPATH": str(tmp_path)}
    jobs = {}
    # What the dry run before this one has found in the results.
    shutil.rmtree(bare / ".snakemake", ignore_errors=True)
    for folder in (benchmarked, bare):
        with ExitStack() as changes:
            if change == "key":
                changes.enter_context(
                    edited(
                        folder / "config/small.yaml", "smoothing_ratio: 1.3", "smoothing_ratio: 1.4"
                    )
                )
            if change == "kernel":
                kernel = folder / "sphpod/reference/reference.py"
                changes.enter_context(edited(kernel, "= stress[0]\n", "= 1.0 * stress[0]\n"))
            if change == "code of what is missing":
                code = folder / "sphpod/reduced/rom.py"
                start = "    solutions = {\n"
                changes.enter_context(edited(code, start, f"    more = 1\n{start}"))
                for sweep in list(folder.glob("small/results/*/*/original/k*.nc")):
                    aside = sweep.rename(tmp_path / f"{folder.name}-{'-'.join(sweep.parts[-4:])}")
                    changes.callback(aside.rename, sweep)
            jobs[folder], said = made_anew(folder, "lifted", **environment)
        assert "Params have changed since last execution" in said
    assert jobs[benchmarked] == jobs[bare]
    assert "Mode counts from which each reduced model works" in jobs[bare]
    if change == "code of what is missing":
        return
    assert "graded: reference solution, centred" in jobs[bare]
    assert ("graded: full SPH" in jobs[bare]) is (change != "kernel")
    assert ("waves: full SPH" in jobs[bare]) is (change == "library")


def test_what_a_failed_job_leaves_behind_is_out_of_date(built, tmp_path):
    """What was made of its result too, with what Snakemake keeps and without."""
    kept, bare = tmp_path / "kept", tmp_path / "bare"
    shutil.copytree(built, kept)
    code = kept / "sphpod/reduced/pod.py"
    start = "def decompose("
    text = code.read_text()
    assert start in text
    failing = (
        "def decompose(snapshots):\n    'Fails.'\n    raise OSError('this fails')\n\n\ndef unused("
    )
    code.write_text(text.replace(start, failing))
    run = snakemake(kept, "--", "small/results/waves/uniform10/pod.nc")
    assert run.returncode == 1
    assert "this fails" in run.stderr
    assert not (kept / "small/results/waves/uniform10/pod.nc").exists()
    shutil.copytree(kept, bare, ignore=shutil.ignore_patterns(".snakemake"))
    jobs = [made_anew(folder, "all")[0] for folder in (kept, bare)]
    assert jobs[0] == jobs[1]
    sweep = "waves: original reduced model with 1-10 modes of uniform10"
    assert {"waves: modes of the snapshots uniform10", sweep} <= set(jobs[0])


def test_modes_of_another_configuration_are_made_anew(built):
    """Each is where its rule puts it, and none of their own settings tells them apart."""
    path = built / "small/results/waves/uniform10/pod.nc"
    content, stat = path.read_bytes(), path.stat()
    given = dataset.job(path)
    assert given is not None
    given["params"] = [text.replace("1.04", "1.05") for text in given["params"]]
    settings = dataset.settings(path)
    dataset.write(path, dataset.read(path), title="", settings=settings, code="", job=given)
    os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns - 10**9))
    try:
        made, _ = made_anew(built, "small/results/waves/uniform10/pod.nc")
        assert made == ["waves: modes of the snapshots uniform10"]
    finally:
        path.write_bytes(content)
        os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns))


def test_scripts_count_by_what_they_do_and_not_by_their_dates(built):
    scripts = built / "workflow" / "scripts"
    for path in scripts.glob("*.py"):
        os.utime(path)
    with edited(scripts / "sph.py", '"""', '# A comment.\n"""'):
        assert planned(built) == set()
    # What only reads and writes computes nothing.
    with edited(scripts / "dataset.py", "\nif __name__", "\nMORE = 1\n\nif __name__"):
        assert planned(built) == set()
    script = scripts / "sph.py"
    with edited(script, "Full SPH of", "The full SPH of"):
        os.utime(script, (0, 0))
        assert {"sph", "errors", "snapshots", "claims"} <= planned(built)


def test_a_result_of_other_settings_is_made_anew(built):
    path = built / "small/results/waves/sph.nc"
    content, stat = path.read_bytes(), path.stat()
    given = dataset.job(path)
    assert given is not None
    given["params"] = [text.replace("1.04", "1.05") for text in given["params"]]
    settings = dataset.settings(path) | {"smoothing_ratio": 1.05}
    dataset.write(path, dataset.read(path), title="", settings=settings, code="", job=given)
    os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns - 10**9))
    try:
        made, said = made_anew(built, "small/results/waves/errors.nc")
        assert made == ["waves: errors of full SPH and of the references", "waves: full SPH"]
        assert "'smoothing_ratio': 1.05" in said.partition(" now: ")[0]
    finally:
        path.write_bytes(content)
        os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns))


def test_results_are_the_same_in_any_folder(built, tmp_path):
    place = "waves/uniform10/snapshots.nc"
    target = tmp_path / "results" / place
    run = snakemake(built, "--config", f"output={tmp_path}", "--", target)
    assert run.returncode == 0, run.stderr
    assert target.read_bytes() == (built / "small/results" / place).read_bytes()


def put_text(path):
    path.write_text("velocity: 1\n")


def put_nothing(path):
    path.write_bytes(b"")


def put_that_of_another_scene(path):
    shutil.copy2(path.parents[1] / "graded" / path.name, path)


def flip_a_byte(path):
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


@pytest.mark.parametrize("spoil", [put_text, put_nothing, put_that_of_another_scene, flip_a_byte])
def test_what_no_rule_wrote_is_refused_and_left_alone(built, spoil):
    path = built / "small/results/waves/sph.nc"
    whole, times = path.read_bytes(), (path.stat().st_atime_ns, path.stat().st_mtime_ns)
    spoil(path)
    spoilt = path.read_bytes()
    sentence = "small/results/waves/sph.nc: is not what its rule wrote; delete it"
    try:
        run = snakemake(built, "--", "small/results/waves/errors.nc")
        assert run.returncode == 1
        assert len(re.findall(f"^(sphpod: )?{sentence}$", run.stderr, re.M)) == 1
        assert "Traceback" not in run.stderr
        assert path.read_bytes() == spoilt
        if spoil is flip_a_byte:
            assert sentence in (built / "small/results/logs/waves/errors.log").read_text()
            path.unlink()
            again = snakemake(built, "--", "small/results/waves/errors.nc")
            assert again.returncode == 0, again.stderr
            assert path.read_bytes() == whole
    finally:
        path.write_bytes(whole)
        os.utime(path, ns=times)


def test_lifted_models_and_benchmarks_are_targets_of_their_own(built):
    for name in (
        "lifted*",
        *(f"{rule}.*" for rule in MEASURED),
        "benchmark_*",
        "thresholds.*",
        "certificates.*",
    ):
        assert not list(built.glob(f"small/**/{name}"))
    # Scenes of which the default target needs little are solved and reduced for the tables too.
    more = {"sph", "reference", "errors", "snapshots", "pod", "reduced_model"}
    lifted, all_benchmarks = (planned(built, "--", name) for name in ("lifted", "benchmarks"))
    assert LIFTED <= lifted <= LIFTED | more
    assert all_benchmarks == lifted | MEASURED | {"figure"}


def test_lifted_models_and_benchmarks_are_built_after_the_default_target(built, benchmarked):
    before, after = results(built), results(benchmarked)
    assert before == {path: after[path] for path in before}
    added = {path for path in after if path not in before}
    tables = {path for path in added if path.endswith(".csv")}
    assert tables == {
        f"small/results/{name}.csv" for name in ("thresholds", "effectivity", "certificates")
    }
    assert not any("benchmark" in path for path in added)
    figures = {path.name for path in (benchmarked / "small" / "figures").glob("benchmark_*")}
    names = "benchmark_waves_uniform10", "benchmark_scaling"
    assert figures == {f"{name}.{form}" for name in names for form in ("pdf", "png")}
    assert planned(benchmarked, "--", "all", "lifted", "benchmarks") == set()


def test_lifted_models_is_in_tables(benchmarked):
    def table(name):
        return pd.read_csv(benchmarked / "small" / "results" / f"{name}.csv")

    samplings = [("waves", "uniform10"), ("damped_forced", "few"), ("graded", "random12")]
    thresholds, effectivity = table("thresholds"), table("effectivity")
    places = thresholds[["scene", "sampling", "method", "n_freeze"]].itertuples(index=False)
    assert [tuple(place) for place in places] == [
        *((*place, method, 0) for place in samplings for method in ("original", "lifted_euler")),
        *(("waves", "uniform10", *method) for method in (("linearized", 0), ("frozen1", 1),
                                                         ("frozen5", 5))),
    ]  # fmt: skip
    # Two waves are two lifted modes.
    waves = thresholds[thresholds.scene == "waves"].set_index("method").threshold
    assert waves["lifted_euler"] == 2 < waves["original"]
    assert effectivity.groupby("scene").modes.max().to_dict() == {
        "waves": 10,
        "damped_forced": 4,
        "graded": 12,
    }
    assert (effectivity.bound_slack >= -1e-11).all()
    assert (effectivity.residual_bound >= effectivity.energy_error_bound).all()
    certificates = table("certificates")
    assert (certificates.groupby("scene").size() == 5).all()
    words = set(certificates.verdict.str.replace(r"by k = \d+$", "by", regex=True))
    assert words <= {"certified", "not certified", "not met by", "smallest tolerance certified"}


def test_benchmarks_is_in_tables(benchmarked):
    results = benchmarked / "small" / "results"
    times = pd.read_csv(results / "benchmark.csv")
    assert {
        "scene", "sampling", "method", "modes", "n_freeze", "integrator", "time_step",
        "error_velocity", "error_density", "error_velocity_exact", "error_density_exact",
        "cpu_seconds", "cpu_seconds_interquartile_range", "cpu_seconds_with_fields", "repeats",
        "offline_snapshots_seconds", "offline_modes_seconds", "offline_projection_seconds",
        "speedup_against_fastest_explicit_euler", "speedup_against_fastest_full_model", "machine",
    } <= set(times.columns)  # fmt: skip
    assert (times.repeats == 2).all()
    full = times[times.modes == 0]
    assert full.method.str.match("sph_|lifted_full_").all()
    assert full.integrator.notna().all()
    assert {"original", "linearized", "frozen1", "frozen5", "lifted_euler", "lifted_exact"} == set(
        times[times.modes > 0].method
    )
    skipping = pd.read_csv(results / "skipping.csv")
    assert (skipping.skipping_seconds > 0).all()
    assert skipping.skipped.nunique() == 11


def test_only_measurements_whose_code_changed_are_made_anew(benchmarked):
    package = benchmarked / "sphpod"
    with edited(
        package / "figures" / "benchmark_plots.py", "\nAS_ACCURATE = ", "\nAS_ACCURATE = 2 * "
    ):
        assert planned(benchmarked, "--", "benchmarks") == {"figure"}
        assert planned(benchmarked) == set()
    with (
        edited(package / "reduced" / "error_bound.py", "\nEXCESS = ", "\nEXCESS = 2 * "),
        edited(package / "studies" / "skipping.py", "\nMODES = ", "\nMODES = 2 * "),
    ):
        rules = planned(benchmarked, "--", "benchmarks")
    assert rules == {"lifted_model", "skipping", "table", "page"}


def test_stability_is_a_target_of_its_own(built, stabilised):
    assert not list(built.glob("small/**/stability*"))
    before, after = results(built), results(stabilised)
    assert before == {path: after[path] for path in before}
    assert planned(stabilised, "--", "all", "stability") == set()
    figures = {path.name for path in (stabilised / "small" / "figures").glob("stability_*")}
    names = (
        "time_steps", "growth", "operators", "smoothing", "map_damped_forced_few",
        "amplitude_waves_uniform10", "poor_snapshots_waves_uniform10", "observed_order",
    )  # fmt: skip
    assert figures == {f"stability_{name}.{form}" for name in names for form in ("pdf", "png")}


def test_stability_is_in_tables(stabilised):
    def table(name):
        return pd.read_csv(stabilised / "small" / "results" / f"{name}.csv")

    limits = table("time_steps")
    assert (limits.relative_difference.abs() < 0.01).all()
    assert set(limits.model) == {
        "sph", "lifted_full", "original", "frozen10", "lifted_euler", "lifted_exact",
    }  # fmt: skip
    assert set(limits[limits.modes > 0].scene) == {"waves", "damped_forced", "graded"}
    growth = table("growth")
    euler = growth[growth.integrator == "explicit_euler"].dropna(subset=["measured_energy_growth"])
    ratio = euler.measured_energy_growth / euler.predicted_energy_growth
    np.testing.assert_allclose(ratio, 1, rtol=1e-3)
    assert set(euler.scene) == {"waves", "two_moduli"}
    assert growth.energy_drift.dropna().max() < 1e-10
    random = table("random_bases")
    assert (random.energy_growing == 0).all()
    assert random.set_index("scene").euclidean_growing["two_moduli"] > 0
    assert list(table("smoothing_ranking").velocity_rank) == [1, 2, 3, 4]
    assert set(table("edge_scenes").verdict) == {"holds", "reported"}
    assert set(table("machine").verdict) == {"independent"}
    outcomes = table("poor_snapshots").outcome.dropna()
    assert not outcomes.str.contains("beyond").any()
    amplitude = table("amplitude").set_index("model")
    assert (amplitude.velocity_error["lifted_exact"].dropna() < 1e-2).all()
    assert table("detection").part_for_watching.notna().all()
    assert not table("operators").empty


def test_what_is_predicted_stands_in_dataset_log_and_terminal(built, tmp_path):
    folder = copy_of_project(tmp_path, built)
    scenes = "waves", "damped_forced"
    run = snakemake(folder, "--", *(f"small/results/{scene}/sph.nc" for scene in scenes))
    assert run.returncode == 0, run.stderr
    told = run.stdout + run.stderr
    sentence = (
        "explicit Euler lets the energy, which the exact solution keeps, grow by 2.7 % over 1 s"
    )
    assert told.count("lets the energy, which the exact solution keeps, grow") == 1
    assert f"scene waves: time_step = 0.002: {sentence}" in told
    for scene, grows in zip(scenes, (True, False), strict=True):
        with xr.open_dataset(folder / f"small/results/{scene}/sph.nc") as file:
            assert file.attrs["wave_growth_bound"] >= 1
            assert ("predicted_energy_growth" in file.attrs) is grows
            assert not grows or file.attrs["predicted_energy_growth"] > 1.01
        log = (folder / f"small/results/logs/{scene}/sph.log").read_text()
        assert (sentence in log) is grows


def test_modes_are_chosen_by_tolerance(benchmarked):
    target = "small/results/waves/uniform10/lifted_exact/tol1e-2.nc"
    run = snakemake(benchmarked, "--", target)
    assert run.returncode == 0, run.stderr
    with xr.open_dataset(benchmarked / target) as file:
        assert file["tolerance"] == 1e-2
        assert file["difference_from_best"] <= 1e-2
        assert file["certified"] == (file["energy_error_bound"] <= 1e-2)
        assert "of the best model; certified: the bound" in file.attrs["title"]
    log = benchmarked / "small/results/logs/waves/uniform10/lifted_exact/tol1e-2.log"
    assert "certified" in log.read_text()


def test_models_of_other_numbers_of_modes_for_velocity_than_for_density_are_targets(built):
    for method in ("linearized", "frozen2"):
        target = f"small/results/waves/uniform10/{method}/k3+5.nc"
        run = snakemake(built, "--", target)
        assert run.returncode == 0, run.stderr
        with xr.open_dataset(built / target) as file:
            assert (file["velocity_mode_count"], file["density_mode_count"]) == (3, 5)
            assert file["velocity_coordinates"].shape[1] == 3
            assert file["density_coordinates"].shape[1] == 5
            assert file["velocity_error_sph"] < 1
        (built / target).unlink()


def test_a_pulse_between_outputs_is_in_every_file(tmp_path):
    """Against the closed form of the one mode that it drives."""
    folder = copy_of_project(tmp_path)
    settings = {
        "domain_length": 1, "duration": 4, "initial_velocity": 0, "initial_density": 1,
        "youngs_modulus": 0.1, "particle_count": 50, "smoothing_ratio": 1.04, "time_step": 5e-4,
        "error_interval": 0.1,
        "force": {"time": "where(0.51 < t < 0.56, 1e-2, 0)", "profile": "sin(2*pi*x/L)"},
        "references": ["exact"], "section": "pulse",
        "samplings": {"uniform40": {"range": [0, 4], "count": 40}},
    }  # fmt: skip
    text = yaml.safe_dump({"output": "small", "scenes": {"pulse": settings}})
    (folder / "config/small.yaml").write_text(text)
    home = "small/results/pulse"
    reduced = f"{home}/uniform40/lifted_exact/k6.nc"
    run = snakemake(folder, "--", f"{home}/lifted_full.nc", f"{home}/reference_exact.nc", reduced)
    assert run.returncode == 0, run.stderr
    case = Scene.from_settings("pulse", settings)
    shape = np.sin(2 * np.pi * case.positions)
    t, begin, end = case.error_times[:, None], 0.51, 0.56
    symbol = case.derivative(np.cos(2 * np.pi * case.positions)) @ shape / (shape @ shape)
    for name, wave in (("lifted_full", abs(symbol)), ("reference_exact", 2 * np.pi)):
        omega = wave * np.sqrt(0.1)
        kicks = np.sin(omega * np.maximum(t - begin, 0)) - np.sin(omega * np.maximum(t - end, 0))
        expected = 1e-2 / omega * kicks * shape
        with xr.open_dataset(folder / f"{home}/{name}.nc") as file:
            np.testing.assert_allclose(file["velocity"], expected, rtol=0, atol=1e-9 * 5e-4)
    with xr.open_dataset(folder / reduced) as file:
        assert file["energy_error_lifted"] < 1e-9
        assert file["energy_error_lifted"] <= file["energy_error_bound"] + 1e-12


def test_a_killed_run_goes_on_to_the_same_bytes(built, tmp_path):
    folder = copy_of_project(tmp_path, built)
    log = folder / "log"
    targets = [
        "small/figures/waves_uniform10_error.pdf",
        "small/figures/waves_profile.pdf",
        "small/results/graded/errors.nc",
    ]
    for finished_jobs in (1, 4):
        with log.open("w") as output:
            run = subprocess.Popen(
                runs.command("--configfile", "config/small.yaml", "--", *targets),
                cwd=folder,
                stdout=output,
                stderr=output,
            )
            while log.read_text().count("Finished jobid") < finished_jobs:
                assert run.poll() is None, log.read_text()
                time.sleep(0.02)
            # Snakemake alone: the jobs it has started live on, as after a kill by the system.
            run.kill()
            run.wait()
        assert snakemake(folder, "--unlock").returncode == 0
    again = snakemake(folder, "--", *targets)
    assert again.returncode == 0, again.stderr
    assert planned(folder, "--", *targets) == set()
    remade, undisturbed = results(folder), results(built)
    assert set(targets) <= set(remade)
    assert remade == {path: undisturbed[path] for path in remade}


REFUSED_PATHS = {
    "results/nowhere/sph.nc": "scene = nowhere: allowed are waves, ",
    "results/waves/nowhen/pod.nc": "scene waves: sampling = nowhen: allowed are un",
    "results/waves/uniform10/original/k0.nc": "scene waves: modes = 0: ",
    "results/waves/uniform10/original/k5-3.nc": "scene waves: modes = 5-3: ",
    "results/waves/uniform10/original/k999.nc": "scene waves: modes = 999: ",
    "results/waves/uniform10/frozen0/k2.nc": "scene waves: method = frozen0: ",
    "results/waves/uniform10/lifted_exact/k3+5.nc": (
        "scene waves: modes = 3+5: lifted models have one number of modes"
    ),
    "results/waves/uniform10/original/k11+5.nc": (
        "scene waves: modes = 11+5: more velocity modes than there are"
    ),
    "results/waves/uniform10/frozen2/k3+11.nc": (
        "scene waves: modes = 3+11: more density modes than there are"
    ),
    "results/graded/reference_exact.nc": "scene graded: reference = exact: allowed",
    "results/graded/random12/cpu_time.nc": "scene graded: acceleration = random12: ",
    "results/waves/uniform10/lifted_fast/k2.nc": (
        "scene waves: method = lifted_fast: allowed are original, linearized, frozen1"
    ),
    "results/waves/uniform10/lifted_exact/tolx.nc": (
        "scene waves: tolerance = x: it must be a number above 0 and below 1, such as 1e-2"
    ),
    "results/waves/uniform10/lifted_exact/tol2.nc": (
        "scene waves: tolerance = 2: it must be a number above 0 and below 1"
    ),
    "results/waves/uniform10/lifted_euler/tol1e-2.nc": (
        "scene waves: method = lifted_euler: did you mean lifted_exact? allowed are lifted_"
    ),
    "results/graded/random12/benchmark.nc": "scene graded: acceleration = random12: ",
    "results/graded/scaling.nc": "scene = graded: this needs one without damping, force or layers",
    "figures/nothing.pdf": "figure = nothing: allowed are ",
    "results/damped_forced/growth.nc": (
        "scene = damped_forced: this needs one without damping, force and start"
    ),
    "results/waves/uniform10/long_run/k11.nc": (
        "scene waves: modes = 11: more modes than the larger snapshot set of sampling"
    ),
    "results/two_moduli/few/pod.nc": "scene two_moduli: sampling = few: there",
    "results/damped_forced/few/lifted_exact/k6.nc": (
        "scene damped_forced: modes = 6: more modes than the larger snapshot set of sampling "
        "few holds; allowed are 1 to 5"
    ),
    "results/waves/uniform10/frozen9999999999999999/k2.nc": (
        "scene waves: method = frozen9999999999999999: allowed are original"
    ),
    "results/claim.csv": "results: file = claim.csv: did you mean claims.csv?",
    "results/waves/errorss.nc": "results/waves: file = errorss.nc: did you mean errors.nc?",
    "results/waves/pod.nc": (
        "file = results/waves/pod.nc: there is one in each results/waves/{sampling}"
    ),
    "results/waves/uniform10/podd.nc": (
        "results/waves/uniform10: file = podd.nc: did you mean pod.nc?"
    ),
    "results/waves/uniform10/original/m2.nc": (
        "results/waves/uniform10/original: file = m2.nc: allowed are k{modes}.nc, tol"
    ),
    "figures/waves_profile.svg": "figure = waves_profile.svg: did you mean waves_profile.pdf?",
}

REFUSED_SETTINGS = {
    "scenes={waves: {time_step: 0}}": "scene waves: time_step = 0: ",
    "output=/": "output = /: ",
    "output=Snakefile": "output = Snakefile: Snakefile is a file; it must be",
    "output=Snakefile/x": "output = Snakefile/x: Snakefile is a file",
    "output=/dev/null": "output = /dev/null: /dev/null is a file; it must be",
    "benchmark={repeats: 0}": "benchmark.repeats = 0: it must be at least 1",
    "memory=1e-4": "scene waves: error_interval = 0.01: 101 outputs of 40",
    "illustrations=[{kind: spring, name: stability_time_steps}]": (
        "figure = stability_time_steps: this is the name of study time_steps and of kind"
    ),
    "illustrations=[{kind: spring, name: benchmark_scaling}]": (
        "figure = benchmark_scaling: this is the name of study scaling and of kind"
    ),
}


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        *((["--", f"small/{path}"], sentence) for path, sentence in REFUSED_PATHS.items()),
        (["--", "liftd"], "target = liftd: did you mean lifted?"),
        *((["--config", text], sentence) for text, sentence in REFUSED_SETTINGS.items()),
    ],
    ids=[*REFUSED_PATHS, "liftd", *REFUSED_SETTINGS],
)
def test_bad_input_stops_before_any_job(built, arguments, sentence):
    run = snakemake(built, *arguments)
    assert run.returncode == 1
    assert "Job stats" not in run.stdout + run.stderr
    said = [line for line in run.stderr.splitlines() if line.startswith("sphpod: ")]
    assert len(said) == 1
    assert said[0].removeprefix("sphpod: ").startswith(sentence)
    assert "Traceback" not in run.stderr


@pytest.mark.parametrize(
    ("study", "target", "start"),
    [("stability_map", "stability", "stability-map"), ("acceleration", "benchmarks", "benchmark")],
)
def test_figures_of_scenes_and_samplings_whose_joined_names_are_one_have_two(
    built, tmp_path, study, target, start
):
    """Not drawn over each other; nothing but figures has a joined name."""
    scene = yaml.safe_load((built / "config/small.yaml").read_text())["scenes"]["waves"]
    models = {"mode_counts": [2], "n_freeze": [1]}
    pairs = {"a_b": "c", "a": "b_c", "random": "a"}
    scenes = {
        one: scene
        | {"samplings": {sampling: {"range": [0, 1], "count": 5}}, "figures": []}
        | {"acceleration": {sampling: models} if study == "acceleration" else {}}
        for one, sampling in pairs.items()
    }
    stability: dict[str, dict[str, str]] = {name: {} for name in STABILITY_STUDIES}
    if study in stability:
        stability[study] = pairs
    settings = {"output": "own", "scenes": scenes, "stability": stability}
    (tmp_path / "own.yaml").write_text(yaml.safe_dump(settings, sort_keys=False))
    config = ["--dry-run", "--configfile", str(tmp_path / "own.yaml"), "--", target]
    run = runs.run(built, *config)
    said = run.stdout + run.stderr
    assert run.returncode == 0, said
    figures = set(re.findall(r"own/figures/([\w-]+)\.pdf", said))
    assert {f"{start}-a_b-c", f"{start}-a-b_c"} <= figures
    assert f"{start.replace('-', '_')}_random_a" in figures


def test_a_failing_job_says_why_in_one_sentence(built):
    # A cheap scene whose density falls below zero: the sentence is on the terminal, the rest in
    # the log.
    broken = "scenes={waves: {initial_velocity: 5*sin(2*pi*x/L)}}"
    run = snakemake(built, "--config", broken, "output=broken", "--", "broken/results/waves/sph.nc")
    assert run.returncode == 1
    assert re.search(
        r"^scene waves: full SPH broke down by t = .* at particle \d+", run.stderr, re.M
    )
    assert "Traceback" not in run.stderr
    assert "Traceback" in (built / "broken/results/logs/waves/sph.log").read_text()
    assert not (built / "broken/results/waves/sph.nc").exists()


def test_captions_and_sections_of_a_report_are_text(built, tmp_path):
    """In reStructuredText, the first would show a file, and the second run a script."""
    settings = yaml.safe_load((built / "config/small.yaml").read_text())
    scene = settings["scenes"]["waves"]
    words = ".. include:: /etc/passwd\n\n.. raw:: html\n\n   <script>alert(1)</script> {y} **a**"
    figure = {"kind": "initial_spectrum", "caption": words}
    kept = {key: scene[key] for key in PHYSICS_KEYS if key in scene}
    own = {"waves": kept | {"section": "{x} 3", "figures": [figure]}}
    folder = tmp_path / "text.yaml"
    folder.write_text(yaml.safe_dump({"output": "text", "scenes": own}))
    for more in ([], ["--report", "text.html"]):
        run = runs.run(built, "--configfile", str(folder), *more)
        assert run.returncode == 0, run.stderr
    report = (built / "text.html").read_text()
    assert ".. include:: /etc/passwd .. raw:: html &lt;script&gt;alert(1)" in report
    assert "<script>alert" not in report
    assert "root:x:0" not in report
    assert (built / "text/.gitignore").read_text() == "*\n"


def test_another_workflow_may_use_this_one_as_a_module(built, tmp_path):
    settings = yaml.safe_load((built / "config/small.yaml").read_text())
    del settings["claims"]  # which YAML 1.1, as Snakemake reads it, takes for other values
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(settings))
    document = (ROOT / "docs/adding-a-scene.md").read_text(encoding="utf-8")
    (written,) = re.findall(r"```snakemake\n(.*?)```", document, re.S)
    own = """
rule mine:
    default_target: True
    input: "small/results/waves/errors.nc"
    output: "mine.txt"
    shell: "echo {input} > {output}"
"""
    (tmp_path / "Snakefile").write_text(written + own)
    (tmp_path / "sphpod").symlink_to(built)
    run = runs.run(tmp_path)
    assert run.returncode == 0, run.stderr
    theirs, ours = (
        dataset.read(root / "small/results/waves/errors.nc") for root in (tmp_path, built)
    )
    np.testing.assert_array_equal(theirs["velocity_error"], ours["velocity_error"])


@cf.needed
def test_files_of_every_kind_keep_to_the_conventions_of_cf(benchmarked, stabilised):
    kinds = cf.check(benchmarked / "small/results") | cf.check(stabilised / "small/results")
    assert {"sph.nc", "pod.nc", "original/", "lifted_full.nc", "benchmark.nc", "growth.nc"} <= kinds


def test_the_report_shows_every_figure(built):
    run = snakemake(built, "--report", "report.html")
    assert run.returncode == 0, run.stderr
    report = (built / "report.html").read_text()
    for path in (built / "small" / "figures").glob("*.png"):
        assert path.name in report
    assert "Mass points and springs." in report
    assert re.search(r"Of \d+ claims that are checked, \d+ are reproduced", report)


def in_browser(path, width=1200):
    """What a page is once its scripts have run, and what they complained of."""
    browser = shutil.which("chromium") or shutil.which("chromium-browser")
    if browser is None:
        pytest.skip("there is no Chromium here: apt-get install chromium")
    run = subprocess.run(
        [browser, "--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr",
         "--v=0", f"--window-size={width},900", "--virtual-time-budget=10000",
         "--host-resolver-rules=MAP * ~NOTFOUND", "--dump-dom", path.as_uri()],
        capture_output=True, text=True, timeout=120, check=True,
    )  # fmt: skip
    complaints = [line for line in run.stderr.splitlines() if "CONSOLE" in line]
    return run.stdout, complaints


def test_a_browser_opens_the_report_without_a_network(built):
    run = snakemake(built, "--report", "report.html")
    assert run.returncode == 0, run.stderr
    page, complaints = in_browser(built / "report.html")
    errors = [line for line in complaints if re.search("error|Uncaught", line, re.IGNORECASE)]
    assert not errors
    for words in ("Claims", "undamped", "claims that are checked"):
        assert words in page
    # The layout of narrow windows outlasts the opening text, with which it comes.
    assert page.index("@media (max-width: 640px)") < page.index("</head>")


def test_a_browser_shows_the_claims_as_a_table(built):
    page, complaints = in_browser(built / "small/results/claims.html", width=400)
    assert not complaints
    with open(built / "small/results/claims.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert page.count("<tr") == len(rows) + 1
    assert all(f"<td>{row['id']}</td>" in page for row in rows)


def test_a_browser_shows_the_errata_and_sorts_them(tmp_path):
    found = errata.rows((ROOT / "docs/reproducing-the-paper.md").read_text(encoding="utf-8"))
    clicks = "<script>heads[0].click(); heads[0].click()</script>"
    path = tmp_path / "errata.html"
    path.write_text(of_table("errata", found) + clicks, encoding="utf-8")
    shown, complaints = in_browser(path, width=400)
    assert not complaints
    rows = re.findall(r"<tr><td[^>]*>(\d+)</td><td[^>]*>([^<]+)</td>", shown)
    assert rows == [(row["erratum"], row["place"]) for row in reversed(found)]


def test_an_output_that_cannot_be_made_is_refused_before_any_job(built):
    settings = yaml.safe_load((built / "config/small.yaml").read_text()) | {"output": "/proc/x"}
    path = built / "nowhere.yaml"
    path.write_text(yaml.safe_dump({key: settings[key] for key in ("output", "scenes")}))
    run = runs.run(built, "--configfile", str(path), "--", "/proc/x/results/waves/sph.nc")
    assert "sphpod: output = /proc/x: this folder cannot be made (" in run.stderr
    assert "Traceback" not in run.stderr


def test_no_group_of_a_cluster_is_left_and_entered_again(built):
    """Snakemake would find that at the first job, and stop."""
    targets = "all", "lifted", "benchmarks", "stability", "surveys"
    graph = snakemake(built, "--forceall", "--rulegraph", "dot", "--", *targets).stdout
    names = dict(re.findall(r'(\d+)\[label = "([^"\\]+)', graph))
    after: dict[str, set[str]] = {name: set() for name in names.values()}
    for first, then in re.findall(r"(\d+) -> (\d+)", graph):
        after[names[first]].add(names[then])
    groups = yaml.safe_load((ROOT / "profiles/slurm/config.yaml").read_text())["groups"]
    assert groups.keys() & after.keys() > {"survey_model", "survey_answers", "page"}
    for group in set(groups.values()):
        within = {rule for rule in groups if groups[rule] == group}
        left = {then for rule in within & after.keys() for then in after[rule]} - within
        while left:
            rule = left.pop()
            assert not after[rule] & within, (group, rule, after[rule] & within)
            left |= after[rule]


def test_lint_asks_only_for_containers(built):
    run = snakemake(built, "--lint")
    complaints = set(re.findall(r"^ +\* (.*)", run.stdout + run.stderr, re.MULTILINE))
    assert complaints == {"Specify a conda environment or container for each rule.:"}


@pytest.mark.parametrize("scenes", ["damped_forced", "two_moduli", "jittered"])
def test_stability_is_studied_of_scenes_of_ones_own(built, tmp_path, scenes):
    """Without a conservative scene, without any sampling, and of jittered particles."""
    folder = copy_of_project(tmp_path, built)
    scene = yaml.safe_load((folder / "config/small.yaml").read_text())["scenes"]
    own = {key: value for key, value in scene["waves"].items() if key not in ("acceleration",)}
    own |= {"positions": {"jitter": 0.2, "seed": 1}, "references": ["exact"]}
    own["figures"] = [{"kind": "profile"}, {"kind": "modes", "sampling": "uniform10"}]
    settings = {"output": "own", "scenes": {scenes: own if scenes == "jittered" else scene[scenes]}}
    settings["stability"] = {"random_bases": 5, "smoothing_ratios": [1.04, 1.2]}
    (folder / "config/small.yaml").write_text(yaml.safe_dump(settings))
    run = snakemake(folder, "--", "stability", *(["all"] if scenes == "jittered" else []))
    assert run.returncode == 0, run.stderr
    drawn = {path.stem for path in (folder / "own/figures").glob("stability_*.png")}
    assert {"stability_time_steps", "stability_smoothing"} <= drawn
    assert ("stability_growth" in drawn) is (scenes != "damped_forced")
    assert ("stability_operators" in drawn) is (scenes != "two_moduli")
    with xr.open_dataset(folder / f"own/results/{scenes}/sph.nc") as file:
        assert ("translation_strain" in file.attrs) is (scenes == "jittered")
