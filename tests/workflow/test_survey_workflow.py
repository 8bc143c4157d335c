"""The surveys of config/small.yaml: complete, resumed, and the same bytes for any chunk size."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import cf
import numpy as np
import pytest
import xarray

import sphpod
from sphpod.pipeline import dataset

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.workflow

SOURCES = ("Snakefile", "config", "profiles", "sphpod", "workflow")
SNAKEMAKE = sys.executable, "-m", "snakemake", "--cores", "1", "--configfile", "config/small.yaml"
FOLDER = Path("small/results/surveys/graded_bar")


def snakemake(folder, *arguments):
    return subprocess.run(
        [*SNAKEMAKE, *arguments],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(folder)},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture(scope="module")
def surveyed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("surveyed")
    for name in SOURCES:
        source = ROOT / name
        (shutil.copytree if source.is_dir() else shutil.copy2)(source, folder / name)
    run = snakemake(folder, "--", "surveys")
    assert run.returncode == 0, run.stderr
    return folder


def test_a_survey_gives_answers_tables_and_figures(surveyed) -> None:
    names = {path.name for path in (surveyed / FOLDER).iterdir()}
    names_of = "answers", "quantiles", "indices", "validation", "cost", "design"
    tables = {f"{name}.csv" for name in names_of}
    shown = "responses", "sections", "surfaces", "histograms", "indices", "errors", "cost", "design"
    drawn = {f"{name}.png" for name in shown}
    assert tables | drawn <= names
    answers = dataset.read(surveyed / FOLDER / "answers.nc")
    assert answers["sensor"].shape == (12, 21)
    assert not answers["reason"].astype(bool).any()


@cf.needed
def test_files_of_a_survey_keep_to_the_conventions_of_cf(surveyed) -> None:
    kinds = cf.check(surveyed / FOLDER)
    assert {"training/", "queries/", "model.nc", "answers.nc", "design.nc"} <= kinds


def test_the_report_shows_the_figures_of_a_survey(surveyed) -> None:
    run = snakemake(surveyed, "--report", "report.html", "--", "surveys")
    assert run.returncode == 0, run.stderr
    report = (surveyed / "report.html").read_text()
    for path in (surveyed / FOLDER).glob("*.png"):
        assert f"{FOLDER.name}/{path.name}" in report
    assert "Errors, estimates and bounds of random queries" in report


def test_nothing_of_a_survey_is_done_twice(surveyed) -> None:
    assert "Nothing to be done" in snakemake(surveyed, "--", "surveys").stderr


def test_no_other_target_builds_a_survey(surveyed) -> None:
    planned = snakemake(surveyed, "--dry-run", "--", "all", "stability").stdout
    assert "survey_" not in planned


def test_the_bound_holds_where_queries_are_solved_in_full(surveyed) -> None:
    found = dataset.read(surveyed / FOLDER / "validation.nc")
    assert (found["effectivity"] >= 1).all()
    assert found["inside"].all()


def test_the_full_run_holds_at_the_design(surveyed) -> None:
    found = dataset.read(surveyed / FOLDER / "design.nc")
    assert found["holds"][-1]
    assert found["final_energy_full"][-1] <= 1.6e-7 * (1 + 1e-6)
    assert found["stiffness"][-1] == 0.1


def test_a_survey_without_a_design_has_no_job_for_it(surveyed) -> None:
    plain = (
        "surveys={plain: {scene: graded, training: {count: 1}, mode_count: 4, "
        "output_interval: 0.05, queries: {count: 2}, quantities: {final_energy: {kind: energy}}}}"
    )
    arguments = "--dry-run", "--config", plain, "--"
    planned = snakemake(surveyed, *arguments, "surveys").stdout
    assert "Survey plain: all queries" in planned
    assert "Survey plain: design" not in planned
    assert "plain/design" not in planned
    run = snakemake(surveyed, *arguments, "small/results/surveys/plain/design.csv")
    assert run.returncode != 0
    assert "survey with a design = plain: allowed are graded_bar" in run.stderr


def test_a_lost_chunk_is_made_anew_alone_and_bytes_depend_on_no_chunk_size(surveyed) -> None:
    chunks, whole = surveyed / FOLDER / "queries", surveyed / FOLDER / "answers.nc"
    before = {path: path.read_bytes() for path in (*chunks.iterdir(), whole)}
    values = dataset.read(whole)
    for lost in (chunks / "1.nc", whole, surveyed / FOLDER / "answers.csv"):
        lost.unlink()
    run = snakemake(surveyed, "--", str(FOLDER / "answers.csv"))
    assert "chunk 1" in run.stderr
    assert "chunk 0" not in run.stderr
    assert {path: path.read_bytes() for path in before} == before
    values = dataset.read(whole)
    run = snakemake(
        surveyed,
        "--config",
        "surveys={graded_bar: {chunk_size: 5}}",
        "--",
        str(FOLDER / "answers.csv"),
    )
    assert run.returncode == 0, run.stderr
    assert len(list(chunks.iterdir())) >= 3
    for name, array in dataset.read(whole).items():
        assert array.tobytes() == values[name].tobytes() or array.dtype.kind in "OUT", name


def test_a_killed_survey_goes_on_to_the_same_bytes(surveyed, tmp_path) -> None:
    folder = tmp_path / "killed"
    shutil.copytree(surveyed, folder)
    chunks, joined = folder / FOLDER / "queries", folder / FOLDER / "answers.nc"
    asked = "--config", "surveys={graded_bar: {chunk_size: 3}}", "--", str(FOLDER / "answers.nc")
    shutil.rmtree(chunks)
    joined.unlink()
    with (folder / "log").open("w") as log:
        run = subprocess.Popen(
            [*SNAKEMAKE, *asked],
            cwd=folder,
            env=os.environ | {"PYTHONPATH": str(folder)},
            stdout=log,
            stderr=log,
            start_new_session=True,
        )
        while not any(chunks.glob("[0-9].nc")):
            assert run.poll() is None, (folder / "log").read_text()
            time.sleep(0.02)
        os.killpg(run.pid, signal.SIGKILL)
        run.wait()
    left = {path: path.read_bytes() for path in chunks.glob("[0-9].nc")}
    assert not joined.exists()
    assert snakemake(folder, "--unlock").returncode == 0
    again = snakemake(folder, *asked)
    assert again.returncode == 0, again.stderr
    assert len(list(chunks.glob("[0-9].nc"))) == 4
    assert {path: path.read_bytes() for path in left} == left
    whole = dataset.read(surveyed / FOLDER / "answers.nc")
    for name, array in dataset.read(joined).items():
        assert np.array_equal(array, whole[name]), name


def test_an_edited_table_of_queries_is_answered_anew(surveyed) -> None:
    mine = (
        "{scene: graded, training: {count: 1}, mode_count: 4, output_interval: 0.05, "
        "queries: {from: mine.csv}, quantities: {final_energy: {kind: energy}}}"
    )
    folder = FOLDER.parent / "mine"
    for stiffness in (0.1, 0.15):
        (surveyed / "mine.csv").write_text(f"stiffness,decay\n{stiffness},1\n")
        arguments = "--config", f"surveys={{mine: {mine}}}", "--", str(folder / "answers.csv")
        run = snakemake(surveyed, *arguments)
        assert run.returncode == 0, run.stderr
        answers = dataset.read(surveyed / folder / "answers.nc")
        assert answers["stiffness"].tolist() == [stiffness]


def test_a_trained_survey_is_loaded_and_asked(surveyed) -> None:
    survey = sphpod.load_survey(surveyed / FOLDER / "model.nc")
    one = survey(stiffness=0.12, decay=0.3)
    assert one["sensor"].dims == ("t",)
    many = survey(stiffness=np.array([0.08, 0.12]), decay=0.3)
    assert many["peak"].values[1] == one["peak"].values
    with xarray.open_dataset(surveyed / FOLDER / "model.nc") as model:
        decays = model["training_points"][:, model["parameter"].values.tolist().index("decay")]
        assert model["parameter"].values.tolist() == ["stiffness", "decay"]
    assert decays.max() > 0.2  # the largest stiffness
    path = surveyed / "changed.nc"
    path.write_bytes((surveyed / FOLDER / "model.nc").read_bytes()[:-40] + b"0" * 40)
    with pytest.raises(ValueError, match="is not what its rule wrote"):
        sphpod.load_survey(path)
    for other in ("answers.nc", "training/0.nc"):
        with pytest.raises(ValueError, match="it holds no survey"):
            sphpod.load_survey(surveyed / FOLDER / other)


def test_a_survey_is_asked_as_the_documents_write(surveyed, monkeypatch) -> None:
    document = (ROOT / "docs/parameter-studies.md").read_text(encoding="utf-8")
    (written,) = re.findall(r"```python\n(.*?)```", document, re.S)
    monkeypatch.chdir(surveyed)
    exec(written.replace("studied/", "small/"), {})


def test_an_unknown_survey_is_refused(surveyed) -> None:
    run = snakemake(surveyed, "--", "small/results/surveys/grade_bar/answers.csv")
    assert run.returncode != 0
    assert "did you mean graded_bar?" in run.stderr
