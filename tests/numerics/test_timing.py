"""Times are taken in turns and in several places, of a machine that is named."""

import operator
import os
import subprocess

import numpy as np
import pytest

from sphpod.numerics import timing


def test_contenders_take_turns():
    calls = []
    timing.measure([lambda: calls.append("a"), lambda: calls.append("b")], 3)
    assert calls == ["a", "b"] * 3


def test_a_process_of_its_own_gives_back_what_is_returned():
    assert timing.elsewhere(os.getpid) not in (os.getpid(), os.getppid())
    np.testing.assert_array_equal(timing.elsewhere(np.outer, [1, 2], np.ones(2)), [[1, 1], [2, 2]])
    with pytest.raises(subprocess.CalledProcessError):
        timing.elsewhere(operator.truediv, 1, 0)


def test_arrays_fall_into_places_that_the_seed_decides_on():
    lines = set()
    for seed in range(40):
        held = timing.displaced(seed)
        lines.add(np.empty(400).ctypes.data % 64)
        del held
    assert len(lines) > 1


def test_the_machine_is_named():
    described = timing.machine()
    assert described["processor"]
    assert described["blas_threads"] == 1
