"""Folders to deposit."""

import hashlib
import json
import subprocess

import pytest

from sphpod.pipeline import deposit


@pytest.fixture
def project(tmp_path):
    root = tmp_path / "project"
    for name in ("results/logs", "figures", "workflow", "sphpod", "profiles", "config"):
        (root / name).mkdir(parents=True)
        (root / name / "one.txt").write_text(name, encoding="utf-8")
    for name in ("Snakefile", "pyproject.toml", "Makefile", "report.html", "environment.txt",
                 *deposit.TEXTS):  # fmt: skip
        (root / name).write_text(name, encoding="utf-8")
    git = ["git", "-C", str(root), "-c", "user.name=a", "-c", "user.email=a@b"]
    for command in (["init", "-q"], ["add", "README.md"], ["commit", "-qm", "one"]):
        subprocess.run([*git, *command], check=True)
    return root


def test_a_deposit_needs_a_finished_run_and_a_new_folder(project, tmp_path):
    (tmp_path / "there").mkdir()
    with pytest.raises(ValueError, match="it is there already"):
        deposit.deposit(project, tmp_path / "there")
    (project / "report.html").unlink()
    with pytest.raises(ValueError, match=r"report.html: there is none; a deposit is made of a"):
        deposit.deposit(project, tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_a_deposit_has_checksums_and_describes_each_file(project, tmp_path):
    pytest.importorskip("rocrate", reason="rocrate has an environment of its own: make deposit")
    folder = tmp_path / "new"
    deposit.deposit(project, folder)
    assert not (folder / "results/logs").exists()
    listed = dict(
        reversed(line.split("  ", 1))
        for line in (folder / deposit.CHECKSUMS).read_text(encoding="utf-8").splitlines()
    )
    files = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert set(listed) == files - {deposit.CHECKSUMS}
    for name, checksum in listed.items():
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == checksum
    metadata = json.loads((folder / "ro-crate-metadata.json").read_text(encoding="utf-8"))
    described = {entity["@id"] for entity in metadata["@graph"]}
    assert files - {deposit.CHECKSUMS, "ro-crate-metadata.json"} <= described
