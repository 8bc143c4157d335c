"""What holds for all tests."""

import os

# Matrices of tests are small; more threads than one would only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
