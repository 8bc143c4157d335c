"""How every kernel is compiled: kept on disk, multiply-adds fused, no test before a division.

Each kernel is only ever called with one type signature. Two jobs that compile the same kernel at
once then write the same file, so what is kept cannot mix one signature up with another.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

from numba import njit

from sphpod.numerics.machine_code import kept


def _compile(function: Callable[..., Any], fastmath: set[str]) -> Any:
    vars(function)["fastmath"] = fastmath
    with kept(function) as cache:
        return njit(cache=cache, fastmath=fastmath, error_model="numpy")(function)


compiled = partial(_compile, fastmath={"contract"})

compiled_sums = partial(_compile, fastmath={"contract", "reassoc", "nsz"})
"""For kernels whose sums over particles may be taken in any order, which lets them use vectors."""
