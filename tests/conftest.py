"""What holds for all tests."""

import os

from hypothesis import settings

# Matrices of tests are small; more threads than one would only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# The same examples in every run, so that a test that fails here fails everywhere.
settings.register_profile("same", derandomize=True, deadline=None)
settings.load_profile("same")


def pytest_collection_modifyitems(items):
    # What takes longest goes first, so that both processes end together.
    items.sort(key=lambda item: item.get_closest_marker("workflow") is None)
