"""What holds for all tests."""

import os
import shutil

import pytest
from hypothesis import settings

# Matrices of tests are small; more threads than one would only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# The same examples in every run, so that a test that fails here fails everywhere.
settings.register_profile("same", derandomize=True, deadline=None)
settings.load_profile("same")


def pytest_collection_modifyitems(items):
    # What takes longest goes first, so that both processes end together.
    items.sort(key=lambda item: item.get_closest_marker("workflow") is None)


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A copy of the package to edit, of which digests are."""
    from sphpod.pipeline import provenance

    copy = tmp_path / "sphpod"
    shutil.copytree(provenance.PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(provenance, "PACKAGE", copy)
    return copy
