"""CPU time of models, measured so that they can be compared.

All contenders run in one process that has the machine to itself, with one BLAS thread. Each is
compiled and warmed up by a few steps first, then they take turns, so that a drift of the machine's
speed meets all of them alike. The time is the thread's own, of the time loop with its outputs
alone: what precedes it (projection, neighbours, compilation) is not in it, nor that BLAS threads of
what precedes it wait for more.

Where arrays fall in memory changes a time by a tenth, and what a kernel allocates falls in the same
places as long as the process lives. What is compared closely is thus timed in several processes
(`elsewhere`), with arrays in other places (`displaced`).
"""

import io
import os
import pickle
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

SHORTEST = 0.02
"""Seconds that a timed run lasts at least; a shorter one is repeated until it does."""


class Buffers:
    """Arrays that runs of one shape share, written to before any of them runs."""

    def __init__(self) -> None:
        self.arrays: dict[tuple[int, tuple[int, ...]], np.ndarray] = {}

    def shared(self, run: Any) -> Any:
        """The run (`sphpod.scene.run.Run`), in these arrays."""
        for place in enumerate(array.shape for array in run.state):
            if place not in self.arrays:
                self.arrays[place] = np.full(place[1], 0.0)
        run.state = tuple(self.arrays[n, array.shape] for n, array in enumerate(run.state))
        return run


def warm_up(run: Callable[[], object], shortest: float = SHORTEST) -> int:
    """Warm a run, and say how often it is to be run for a time of ``shortest`` seconds."""
    for _ in range(2):
        start = time.thread_time()
        run()
        seconds = time.thread_time() - start
        if seconds > 10 * shortest:
            break
    return 1 + int(shortest / max(seconds, 1e-6))


def measure(
    runs: Sequence[Callable[[], object]], repeats: int, numbers: Sequence[int] = ()
) -> np.ndarray:
    """Thread time [s] of each run, taken in turns; they are to be warm.

    Parameters
    ----------
    runs : callables
    numbers : ints, optional
        How often each is run for one time, of which the mean is taken; once if not given.

    Returns
    -------
    array, shape (runs, repeats)
    """
    seconds = np.empty((len(runs), repeats))
    with threadpool_limits(limits=1):
        for repeat in range(repeats):
            for n, (run, number) in enumerate(zip(runs, numbers or [1] * len(runs), strict=True)):
                start = time.thread_time()
                for _ in range(number):
                    run()
                seconds[n, repeat] = (time.thread_time() - start) / number
    return seconds


def displaced(seed: int) -> list[bytearray]:
    """Blocks of memory: while they are held, other arrays fall into places that the seed decides.

    About as many more have been given back, so that there are gaps of all sizes.
    """
    rng = np.random.default_rng(seed)
    blocks = [bytearray(size) for size in rng.integers(64, 8192, size=600)]
    return [block for block in blocks if rng.random() < 0.5]


def elsewhere(function: Callable[..., Any], calls: Sequence[tuple[Any, ...]]) -> list[Any]:
    """What a function of a module returns for arguments, each called in a process of its own.

    One after another they are copies of a process that has imported what the function needs, and
    done nothing else.

    Raises
    ------
    subprocess.CalledProcessError
        It raised something, which is on the error stream.
    """
    copies = (
        "import os, pickle, sys\n"
        "function, calls = pickle.load(sys.stdin.buffer)\n"
        "for arguments in calls:\n"
        "    if os.fork() == 0:\n"
        "        pickle.dump(function(*arguments), sys.stdout.buffer)\n"
        "        break\n"
        "    if os.wait()[1]:\n"
        "        sys.exit(1)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", copies],
        input=pickle.dumps((function, calls)),
        stdout=subprocess.PIPE,
        # A copy has one thread, whatever BLAS had begun.
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
        },
        check=True,
    )
    returned = io.BytesIO(done.stdout)
    return [pickle.load(returned) for _ in calls]


def machine() -> dict[str, Any]:
    """What the times were measured on: processor, cores, system, and versions of what computes."""
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "numpy": version("numpy"),
        "numba": version("numba"),
        "blas_threads": 1,
    }


def _processor() -> str:
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            names = [line.partition(":")[2].strip() for line in file if "model name" in line]
        return names[0]
    except (OSError, IndexError):
        return platform.processor() or "unknown"
