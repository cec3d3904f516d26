"""Names for arrays, and how products keep them: float64, row-major, read-only copies."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def freeze(values: object) -> FloatArray:
    """Return a read-only float64 copy of `values`, row-major."""
    array = np.array(values, dtype=np.float64, order="C")
    array.setflags(write=False)
    return array
