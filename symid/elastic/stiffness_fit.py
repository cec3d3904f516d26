"""Compliances of joints by least squares, run by run, and without each block of time.

Input: `RigidRows` of every run. Output: `SpringFits`.

    theta - q = c gravity + b motion + a ddtheta + s tanh(dtheta / v) + d dtheta + offset,    k = 1 / c

All sums over samples are made once a block; leaving a block out subtracts them. The rigid robot is fitted
anew without it, so that the errors of its parameters count as well.

Supported: any number of runs; joints that gravity does not load have a compliance of zero.
Not supported: weights of samples.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.elastic.torsion import RigidRows, find_reversal_widths, find_rigid_grams, fit_rigid

__all__ = ["FLAT", "SpringFits", "fit_springs"]

FLAT = 1e-6
"""Gravity below this part of the whole torque is none."""
_NUISANCES = 4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpringFits:
    """What gravity bends.

    Args:
        compliances: (1 + blocks, runs, n) rad/(N m) or m/N; first with all blocks, then without each.
        explained, left: (n,) root mean square of the torsion that gravity explains and leaves, rad or m.
        loading, steady: (n,) deviation and size of mean of the gravity torque as parts of the whole torque.
    """

    compliances: FloatArray
    explained: FloatArray
    left: FloatArray
    loading: FloatArray
    steady: FloatArray

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        for name in ("compliances", "explained", "left", "loading", "steady"):
            object.__setattr__(self, name, freeze(getattr(self, name)))


def fit_springs(runs: Sequence[RigidRows]) -> SpringFits:
    """Return the compliance of every joint in every run, with and without each block."""
    rigid = np.concatenate([find_rigid_grams(rows) for rows in runs])
    owner = np.repeat(np.arange(len(runs)), [len(rows.blocks) for rows in runs])
    widths = find_reversal_widths(runs)
    torsion = np.concatenate([_find_torsion_grams(rows, widths) for rows in runs])
    whole, norms = fit_rigid(rigid.sum(axis=0))
    count = runs[0].still.shape[2]
    sums = np.array([torsion[owner == run].sum(axis=0) for run in range(len(runs))])
    first = _solve_runs(sums, whole[:count])
    replicates = [first[0]]
    for out, run in enumerate(owner):
        beta = fit_rigid(rigid.sum(axis=0) - rigid[out], norms**-2.0)[0][:count]
        without = sums.copy()
        without[run] -= torsion[out]
        replicates.append(_solve_runs(without, beta)[0])
    samples = sum(part.stop - part.start for rows in runs for part in rows.blocks)
    still = np.concatenate([rows.still @ whole[:count] for rows in runs])
    torque = np.concatenate([rows.torque for rows in runs])
    size = np.maximum(np.sqrt(np.mean(torque**2, axis=0)), 1e-300)
    return SpringFits(
        compliances=np.array(replicates),
        explained=np.sqrt(first[1].sum(axis=0) / samples),
        left=np.sqrt(first[2].sum(axis=0) / samples),
        loading=np.std(still, axis=0) / size,
        steady=np.abs(np.mean(still, axis=0)) / size,
    )


def _find_torsion_grams(rows: RigidRows, widths: FloatArray) -> FloatArray:
    """Return the Gram matrices (blocks, n, 2 p + 5, 2 p + 5) of nuisances, motion, gravity and torsion."""
    gap = rows.encoders.theta - rows.encoders.q
    nuisances = (np.ones_like(gap), rows.speed, np.tanh(rows.speed / widths), rows.acceleration)
    columns = [np.stack(nuisances, axis=2), rows.whole - rows.still, rows.still, gap[:, :, None]]
    design = np.concatenate(columns, axis=2)
    joints = range(gap.shape[1])
    return np.array([[design[part, j].T @ design[part, j] for j in joints] for part in rows.blocks])


def _solve_runs(sums: FloatArray, beta: FloatArray) -> FloatArray:
    """Return compliances, and squares of the torsion explained and left: (3, runs, n)."""
    return np.array([[_solve_spring(gram, beta) for gram in joints] for joints in sums]).transpose(2, 0, 1)


def _solve_spring(gram: FloatArray, beta: FloatArray) -> tuple[float, float, float]:
    """Return compliance, and the squares of the torsion that gravity explains and leaves.

    Gravity and torsion are cleared of nuisances and of the torque of motion first (Frisch and Waugh).
    """
    own, count, size = _NUISANCES, len(beta), len(gram)
    change = np.zeros((size, own + 3))
    change[:own, :own] = np.eye(own)
    change[own : own + count, own] = beta
    change[own + count : size - 1, own + 1] = beta
    change[-1, -1] = 1.0
    small = change.T @ gram @ change
    inner = small[: own + 1, : own + 1]
    lengths = np.sqrt(np.maximum(np.diag(inner), 0.0))
    scales = np.where(lengths > 0.0, lengths, 1.0)
    side = small[: own + 1, own + 1 :] / scales[:, None]
    part = np.linalg.lstsq(inner / np.outer(scales, scales), side, rcond=1e-12)[0]
    cleared = small[own + 1 :, own + 1 :] - side.T @ part
    loading, whole = float(cleared[0, 0]), max(float(cleared[1, 1]), 0.0)
    if loading <= FLAT**2 * float(small[own + 1, own + 1]) or loading <= 0.0:
        return 0.0, 0.0, whole
    compliance = float(cleared[0, 1]) / loading
    explained = min(compliance * float(cleared[0, 1]), whole)
    return compliance, explained, whole - explained
