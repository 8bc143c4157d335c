"""The whole pipeline on config/small.yaml: complete, remade where it must be, safe when killed."""

import re
import shutil
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
import yaml

ROOT = Path(__file__).parents[1]
SOURCES = ("Snakefile", "config", "profiles", "sphpod", "workflow")
# The rules whose results are measured times, and what is computed from those.
TIMED = re.compile(r"cpu_time\.|step_time\.|claims\.|_acceleration\.(pdf|png)$|/logs/")


def command(*arguments):
    return [sys.executable, "-m", "snakemake", "--cores", "2", *map(str, arguments)]


def snakemake(folder, *arguments):
    """Run Snakemake on config/small.yaml in a copy of the project."""
    return subprocess.run(
        command("--configfile", "config/small.yaml", *arguments),
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )


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
    return set(re.findall(r"^(\w+) +\d+$", table, re.MULTILINE)) - {"all"}


def test_everything_is_built(built):
    config = yaml.safe_load((built / "config" / "small.yaml").read_text())
    figures = sum(len(scene.get("figures", [None])) for scene in config["scenes"].values()) + len(
        config["illustrations"]
    )
    assert len(list((built / "small" / "figures").glob("*.pdf"))) == figures
    assert len(list((built / "small" / "figures").glob("*.png"))) == figures
    assert not (built / "results").exists()
    assert not list(built.glob("small/**/.*"))
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
        ("sph", '"""', '"""Told otherwise. '),
        ("plotting", '"""', '"""Told otherwise. '),
        ("rom", "\nimport ", "\n# A comment.\nimport "),
    ],
)
def test_words_make_nothing_anew(built, module, old, new):
    with edited(built / "sphpod" / f"{module}.py", old, new):
        assert planned(built) == set()


def test_a_plot_makes_only_figures_anew(built):
    with edited(built / "sphpod" / "plotting.py", "\nPAGE_WIDTH = ", "\nPAGE_WIDTH = 0.5 * "):
        assert planned(built) == {"figure"}
    with edited(built / "sphpod" / "style.mplstyle", "font.size: ", "font.size: 1"):
        assert planned(built) == {"figure"}


def test_code_makes_anew_what_uses_it(built):
    with edited(built / "sphpod" / "pod.py", "ROUNDING_LEVEL = ", "ROUNDING_LEVEL = 2 * "):
        rules = planned(built)
    assert {"pod", "reduced_model", "acceleration", "cpu_time", "figure"} <= rules
    assert not {"sph", "reference", "errors", "snapshots"} & rules


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
                command("--configfile", "config/small.yaml", "--", *targets),
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


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--", "small/results/nowhere/sph.nc"], "scene = nowhere: allowed are waves, "),
        (
            ["--", "small/results/waves/nowhen/pod.nc"],
            "scene waves: sampling = nowhen: allowed are un",
        ),
        (["--", "small/results/waves/uniform10/original/k0.nc"], "scene waves: modes = 0: "),
        (["--", "small/results/waves/uniform10/original/k5-3.nc"], "scene waves: modes = 5-3: "),
        (["--", "small/results/waves/uniform10/original/k999.nc"], "scene waves: modes = 999: "),
        (["--", "small/results/waves/uniform10/frozen0/k2.nc"], "scene waves: method = frozen0: "),
        (
            ["--", "small/results/graded/reference_exact.nc"],
            "scene graded: reference = exact: allowed",
        ),
        (
            ["--", "small/results/graded/random12/cpu_time.nc"],
            "scene graded: acceleration = random12: ",
        ),
        (["--", "small/figures/nothing.pdf"], "figure = nothing: allowed are "),
        (["--config", "scenes={waves: {time_step: 0}}"], "scene waves: time_step = 0: "),
        (["--config", "output=/"], "output = /: "),
    ],
    ids=lambda value: value[-1] if isinstance(value, list) else "",
)
def test_bad_input_stops_before_any_job(built, arguments, sentence):
    run = snakemake(built, *arguments)
    assert run.returncode == 1
    assert "Job stats" not in run.stdout + run.stderr
    said = [line for line in run.stderr.splitlines() if line.startswith("sphpod: ")]
    assert len(said) == 1
    assert said[0].removeprefix("sphpod: ").startswith(sentence)
    assert "Traceback" not in run.stderr


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


def test_the_report_shows_every_figure(built):
    run = snakemake(built, "--report", "report.html")
    assert run.returncode == 0, run.stderr
    report = (built / "report.html").read_text()
    for path in (built / "small" / "figures").glob("*.png"):
        assert path.name in report
    assert "Mass points and springs." in report


def test_lint_asks_only_for_containers(built):
    run = snakemake(built, "--lint")
    complaints = set(re.findall(r"^ +\* (.*)", run.stdout + run.stderr, re.MULTILINE))
    assert complaints == {"Specify a conda environment or container for each rule.:"}
