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


def test_processes_of_their_own_give_back_what_is_returned():
    processes = {os.getpid(), os.getppid(), *timing.elsewhere(os.getpid, [()] * 3)}
    assert len(processes) == 5
    twice, thrice = timing.elsewhere(np.multiply, [(2, np.arange(2)), (3, np.ones(1))])
    assert twice.tolist() == [0, 2]
    assert thrice.tolist() == [3]


def test_what_fails_in_a_process_of_its_own_fails_here():
    with pytest.raises(subprocess.CalledProcessError):
        timing.elsewhere(operator.truediv, [(1, 0), (1, 1)])


def test_what_a_process_of_its_own_changes_is_not_seen_by_the_next():
    first, second = timing.elsewhere(os.umask, [(0o11,), (0o12,)])
    assert first == second


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
