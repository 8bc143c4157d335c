"""What holds for all tests."""

import os
import shutil

import pytest
from hypothesis import settings

# Matrices of tests are small; more threads than one would only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# The same examples in every run, so that a test that fails here fails everywhere.
settings.register_profile("same", derandomize=True, deadline=None)
settings.register_profile("quick", settings.get_profile("same"), max_examples=20)


def is_quick(config):
    """Whether `pytest -m "not workflow"` asks for an answer while someone works."""
    return "not workflow" in config.option.markexpr


def pytest_configure(config):
    settings.load_profile("quick" if is_quick(config) else "same")


def pytest_collection_modifyitems(config, items):
    if is_quick(config):
        slow = [item for item in items if item.get_closest_marker("slow")]
        items[:] = [item for item in items if not item.get_closest_marker("slow")]
        config.hook.pytest_deselected(items=slow)
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
