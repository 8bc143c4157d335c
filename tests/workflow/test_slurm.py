"""The workflow on a real SLURM of one node: the same bytes as here, and failures that are seen."""

import importlib.util
import os
import re
import subprocess
import sys
from contextlib import ExitStack

import pytest
import slurm_node
from test_workflow import copy_of_project, results

pytestmark = [pytest.mark.slurm, pytest.mark.workflow]


@pytest.fixture(scope="module", autouse=True)
def node(tmp_path_factory):
    if reason := slurm_node.impossible():
        pytest.skip(reason)
    assert importlib.util.find_spec("snakemake_executor_plugin_cluster_generic"), "make cluster"
    with ExitStack() as stack:
        try:
            stack.enter_context(slurm_node.node(tmp_path_factory.mktemp("slurm")))
        except slurm_node.Unavailable as error:
            pytest.skip(str(error))
        yield


def snakemake(folder, *arguments):
    # Jobs find the interpreter that runs the tests.
    path = f"{os.path.dirname(sys.executable)}:{os.environ['PATH']}"
    return subprocess.run(
        [sys.executable, "-m", "snakemake", "--configfile", "config/small.yaml", *arguments],
        cwd=folder, env=os.environ | {"PATH": path}, capture_output=True, text=True, check=False,
    )  # fmt: skip


@pytest.fixture(scope="module")
def local(tmp_path_factory):
    folder = copy_of_project(tmp_path_factory.mktemp("local"))
    run = snakemake(folder, "--cores", "2")
    assert run.returncode == 0, run.stderr
    return folder


def test_grouped_jobs_make_the_bytes_of_a_local_run(local, tmp_path):
    folder = copy_of_project(tmp_path)
    run = snakemake(folder, "--workflow-profile", "profiles/slurm")
    assert run.returncode == 0, run.stderr
    jobs = {path.name.rpartition("-")[2] for path in (folder / ".snakemake/slurm").iterdir()}
    (done,) = re.findall(r"(\d+) of \1 steps", run.stdout + run.stderr)
    assert 1 < len(jobs) < int(done) / 2
    assert results(folder) == results(local)


def test_one_job_makes_the_bytes_of_a_local_run(local, tmp_path):
    folder = copy_of_project(tmp_path)
    (folder / ".venv/bin").mkdir(parents=True)
    starter = folder / ".venv/bin/snakemake"
    starter.write_text(f'#!/bin/sh\nexec {sys.executable} -m snakemake "$@"\n')
    starter.chmod(0o755)
    subprocess.run(
        ["sbatch", "--wait", "profiles/slurm-one-node.sh", "--configfile", "config/small.yaml"],
        cwd=folder, check=True, capture_output=True,
    )  # fmt: skip
    assert results(folder) == results(local)


def test_a_survey_in_chunks_makes_the_bytes_of_a_local_run(tmp_path):
    folders = tmp_path / "local", tmp_path / "queued"
    ways = ["--cores", "2"], ["--workflow-profile", "profiles/slurm"]
    for folder in folders:
        folder.mkdir()
        copy_of_project(folder)
    for folder, way in zip(folders, ways, strict=True):
        run = snakemake(folder, *way, "--", "surveys")
        assert run.returncode == 0, run.stderr
    chunks = list(folders[1].glob("small/results/surveys/*/queries/*.nc"))
    assert len(chunks) >= 3
    assert results(folders[1]) == results(folders[0])


def test_a_job_out_of_memory_is_reported_and_leaves_no_file(tmp_path):
    folder = copy_of_project(tmp_path)
    run = snakemake(
        folder, "--workflow-profile", "profiles/slurm", "--retries", "0",
        "--set-resources", "sph:mem_mb=20", "--", "small/results/waves/sph.nc",
    )  # fmt: skip
    assert run.returncode == 1
    assert "Error in group" in run.stderr + run.stdout
    assert not list(folder.glob("small/results/waves/*"))
