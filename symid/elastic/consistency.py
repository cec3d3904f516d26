"""Signs that nature prescribes, kept while fitting: rotor inertias, friction and springs are not negative.

Equations -> parameters. The mass matrix is checked afterwards, over the poses of the recordings.

Supported: lower bounds of zero, active only where the free solution breaks them.
Not supported: full physical consistency of the links; their mass matrix is checked, not forced.
"""

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen.functions import ModelCard

__all__ = ["find_lower_bounds", "solve_consistent"]


def find_lower_bounds(card: ModelCard, extra: int = 0) -> FloatArray:
    """Return the least value (p + n + pf + extra,) of every parameter: zero, or minus infinity.

    Zero bounds rotor inertias, friction other than an offset, and the `extra` stiffnesses at the end.
    """
    free = [-np.inf] * len(card.beta)
    friction = [0.0 if entry.name.startswith(("Fv", "Fc")) else -np.inf for entry in card.friction]
    return np.array(free + [0.0] * card.size + friction + [0.0] * extra)


def solve_consistent(card: ModelCard, matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Return argmin |matrix x - right| (p,), x = [chi; stiffnesses], not below its bounds.

    By QR with columns scaled to length one; the bounded problem is solved only where a bound is broken.

    Args:
        card: names the parameters of chi; columns beyond it are stiffnesses.
        matrix: (m, p).
        right: (m,).
    """
    count = matrix.shape[1]
    lengths = np.linalg.norm(matrix, axis=0)
    alive: NDArray[np.bool_] = lengths > 0.0
    scales = np.where(alive, lengths, 1.0)
    triangle: FloatArray = np.asarray(np.linalg.qr(np.column_stack([matrix / scales, right]), mode="r"))
    solution: FloatArray = np.linalg.lstsq(triangle[:, :count], triangle[:, count], rcond=1e-12)[0] / scales
    low = find_lower_bounds(card, count - len(card.beta) - card.size - len(card.friction))
    if np.all(solution >= low):
        return solution
    from scipy.optimize import lsq_linear

    answer = lsq_linear(triangle[:, :count], triangle[:, count], bounds=(low * scales, np.inf), method="bvls")
    bounded: FloatArray = answer.x / scales
    return bounded
