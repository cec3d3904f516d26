"""Signs that nature prescribes, kept while fitting: rotor inertias, friction and springs are not negative.

Equations -> parameters. The mass matrix is checked afterwards, over the poses of the recordings.

Supported: lower bounds of zero, active only where the free solution breaks them; equations that do not tell
all parameters, for which the shortest solution is taken.
Not supported: full physical consistency of the links; their mass matrix is checked, not forced.
"""

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen.functions import ModelCard
from symid.rows.identifiability import RankRule

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
    Columns and directions that count as not seen (`RankRule`) get zero.

    Args:
        card: names the parameters of chi; columns beyond it are stiffnesses.
        matrix: (m, p).
        right: (m,).
    """
    count = matrix.shape[1]
    lengths = np.linalg.norm(matrix, axis=0)
    rule = RankRule()
    alive: NDArray[np.bool_] = lengths > rule.zero * max(float(lengths.max(initial=0.0)), 1e-300)
    scales = np.where(alive, lengths, 1.0)
    columns = np.where(alive, matrix, 0.0) / scales
    triangle: FloatArray = np.asarray(np.linalg.qr(np.column_stack([columns, right]), mode="r"))
    answer = np.linalg.lstsq(triangle[:, :count], triangle[:, count], rcond=rule.singular)
    # What is not seen is zero, not what rounding makes of it: its sign would let bounds act.
    solution: FloatArray = np.where(alive, answer[0] / scales, 0.0)
    low = find_lower_bounds(card, count - len(card.beta) - card.size - len(card.friction))
    if np.all(solution >= low):
        return solution
    from scipy.optimize import lsq_linear

    left, values = triangle[:, :count], triangle[:, count]
    if answer[2] < count:
        # Of the many solutions the bounded problem must take a short one too; this hardly weighs elsewhere.
        left = np.vstack([left, rule.singular * answer[3][0] * np.eye(count)])
        values = np.concatenate([values, np.zeros(count)])
    bounded: FloatArray = lsq_linear(left, values, bounds=(low * scales, np.inf), method="bvls").x / scales
    return np.where(alive, bounded, 0.0)
