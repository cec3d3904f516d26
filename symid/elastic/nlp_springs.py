"""The knees of one joint's spring along a recording: their share of the torque, with exact derivatives.

Input: the stop basis Phi (N, m + 1), the weights k, signed knee torques R_j with slopes s_j.
Output: for every step between two samples the mean of the dead zones, their derivatives, and the curvature.

    v = Phi k,   tau_J = v + sum_j s_j S_j(v),   S_j = max(v - R_j, 0) or, for R_j < 0, min(v - R_j, 0)

Between samples v is a straight line, and the mean over a step is that of the dead zone along it:

    from p < 0 to q > 0 beyond the knee: q w / 2 with w = q / (q - p);  both beyond: (p + q) / 2

so that the mean has continuous derivatives in k, and its second derivative is a term of rank one,
s_j Phi_c Phi_c' / |q - p| at the point c of the crossing. The part without knees is linear in k and is
not found here.

Supported: any signed knee torques; knees of both sides that share a slope.
Not supported: knees at zero torque.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray

__all__ = ["KneePass", "KneeSteps", "find_knee_steps"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KneePass:
    """One knee along a recording.

    Args:
        slot: the slope variable that it belongs to.
        side: 1 for a knee above zero torque, -1 below.
        mean: (N - 1,) mean dead zone over each step, N m or N.
        beyond: (N - 1,) 1 where both ends of a step lie beyond the knee, else 0.
        crossings: (c,) steps that cross it.
        start, end: (c,) derivatives of the mean by v at the step's ends.
        place: (c,) where the step crosses, 0 at its start.
        width: (c,) change of v over the step.
    """

    slot: int
    side: float
    mean: FloatArray
    beyond: FloatArray
    crossings: NDArray[np.intp]
    start: FloatArray
    end: FloatArray
    place: FloatArray
    width: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KneeSteps:
    """All knees of one joint along a recording; basis (N, m + 1), its step means (N - 1, m + 1)."""

    basis: FloatArray
    middle: FloatArray
    passes: tuple[KneePass, ...]
    slots: int

    def find_means(self) -> FloatArray:
        """Return the step means (N - 1, slots) of the dead zones, one column a slope variable."""
        means = np.zeros((len(self.middle), self.slots))
        for knee in self.passes:
            means[:, knee.slot] += knee.mean
        return means

    def find_slopes(self, slopes: FloatArray) -> FloatArray:
        """Return the derivatives (N - 1, m + 1) by the weights of sum_j s_j times the step means."""
        share = np.zeros(len(self.middle))
        for knee in self.passes:
            share += slopes[knee.slot] * knee.beyond
        columns = share[:, None] * self.middle
        for knee in self.passes:
            columns[knee.crossings] += slopes[knee.slot] * self._find_edge(knee)
        return columns

    def find_cross(self, multipliers: FloatArray) -> FloatArray:
        """Return sum_i c_i d mean_i / dk (m + 1, slots) for multipliers c (N - 1,) of the steps."""
        cross = np.zeros((self.basis.shape[1], self.slots))
        for knee in self.passes:
            cross[:, knee.slot] += (multipliers * knee.beyond) @ self.middle
            cross[:, knee.slot] += multipliers[knee.crossings] @ self._find_edge(knee)
        return cross

    def find_curvature(self, multipliers: FloatArray, slopes: FloatArray) -> FloatArray:
        """Return sum_i c_i sum_j s_j d2 mean_ij / dk2 (m + 1, m + 1)."""
        total = np.zeros((self.basis.shape[1],) * 2)
        for knee in self.passes:
            at, place = knee.crossings, knee.place[:, None]
            point = (1.0 - place) * self.basis[at] + place * self.basis[at + 1]
            weight = multipliers[at] * knee.side * slopes[knee.slot] / np.abs(knee.width)
            total += point.T @ (weight[:, None] * point)
        return total

    def _find_edge(self, knee: KneePass) -> FloatArray:
        at = knee.crossings
        edge: FloatArray = knee.start[:, None] * self.basis[at] + knee.end[:, None] * self.basis[at + 1]
        return edge


def find_knee_steps(
    basis: FloatArray, middle: FloatArray, weights: FloatArray, knees: Sequence[tuple[float, int]]
) -> KneeSteps:
    """Return the knees of one joint along a recording.

    Args:
        basis: (N, m + 1) torsion and stops.
        middle: (N - 1, m + 1) means over the steps.
        weights: (m + 1,) k0, k_1 .. k_m.
        knees: signed torques, each with its slope variable.
    """
    torque = basis @ weights
    passes = tuple(_find_pass(torque, knee, slot) for knee, slot in knees)
    slots = 1 + max((slot for _, slot in knees), default=-1)
    return KneeSteps(basis=basis, middle=middle, passes=passes, slots=slots)


def _find_pass(torque: FloatArray, knee: float, slot: int) -> KneePass:
    side = 1.0 if knee > 0 else -1.0
    excess = side * (torque - knee)
    out = excess > 0.0
    beyond = (out[:-1] & out[1:]).astype(np.float64)
    mean = beyond * (excess[:-1] + excess[1:]) / 2.0
    at = np.flatnonzero(out[:-1] != out[1:])
    first, last = excess[at], excess[at + 1]
    width = last - first
    farther = np.maximum(first, last)
    part = farther / np.abs(width)
    mean[at] = farther * part / 2.0
    near, far = part * part / 2.0, part - part * part / 2.0
    rises = last > first
    return KneePass(
        slot=slot,
        side=side,
        mean=side * mean,
        beyond=beyond,
        crossings=at,
        start=np.where(rises, near, far),
        end=np.where(rises, far, near),
        place=-first / width,
        width=width,
    )
