"""One thread for linear algebra: a sum that threads share is another sum on another number of cores.

Input: the environment of this process. Output: the same with one thread asked of every library of its kind.

Supported: OpenBLAS, MKL, BLIS, Accelerate and OpenMP, which read the environment once, when they are loaded.
Not supported: libraries that were loaded before.
"""

import os

__all__ = ["THREAD_VARIABLES", "ask_for_one_thread"]

THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)


def ask_for_one_thread() -> None:
    """Set the variables for this process and those that it starts."""
    os.environ |= dict.fromkeys(THREAD_VARIABLES, "1")
