"""How every kernel is compiled: cached on disk, multiply-adds fused, no test before a division.

Each kernel is only ever called with one type signature. Two jobs that compile the same kernel at
once then write the same cache file, so the cache cannot mix one signature up with another.
"""

from numba import njit

compiled = njit(cache=True, fastmath={"contract"}, error_model="numpy")

compiled_sums = njit(cache=True, fastmath={"contract", "reassoc", "nsz"}, error_model="numpy")
"""For kernels whose sums over particles may be taken in any order, which lets them use vectors."""
