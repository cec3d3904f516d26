"""The two statistics that decide: `compare` (predicts better) and `agree` (says the same).

    compare   parts of held-out stretches with losses l_A, l_B of every joint, relative to its torque
              d = ln((l_A + f) / (l_B + f)),  f = 2 % of the mean loss;  t = mean d / (std d / sqrt(parts))
    agree     two estimates with difference D and its jackknife replicates r_s (a block left out of both):
              V = (S - 1)/S sum (r_s - mean)(r_s - mean)',  W_j = D'G_j D,  G_j = (L Y_j)'(L Y_j)
              W_j / tr(G_j V) ~ F(nu, nu S),  nu = tr(G_j V)^2 / tr((G_j V)^2)

The jackknife of the difference (Quenouille 1956) needs neither white noise nor that one of the estimates is
efficient, as the test of Hausman (1978, Econometrica 46) does. The distribution is that of a quadratic form
(Satterthwaite 1946); tr((GV)^2) is estimated without the bias of few blocks (Bai and Saranadasa 1996). Of
several hypotheses the probabilities are those of Holm (1979); of candidates that are much alike, those of
White (2000, `measure_inferiority`).

Supported: any number of joints, parts without motion (they say nothing); jackknives of several independent
groups of blocks, such as two logs.
Not supported: parts that depend on each other; fewer than two blocks.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
import scipy

from symid.arrays import FloatArray, FrozenArrays
from symid.identification.judge import numerics
from symid.identification.judge.policy import POLICY


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Gain(FrozenArrays):
    """Whether one candidate predicts better than another.

    Args:
        fall: (n,) squares of each joint before over those after, infinite where none are left; 1 at rest.
        p: (n,) probability of so clear a fall of each joint by chance, one-sided.
        fall_of_all, p_of_all: the same of the sum of relative squares over joints.
    """

    fall: FloatArray
    p: FloatArray
    fall_of_all: float
    p_of_all: float


def compare(before: FloatArray, after: FloatArray) -> Gain:
    """Return how much better `after` predicts than `before`: losses (parts, n) relative to each torque.

    A part in which a joint rests has the loss NaN, or zero in both.
    """
    table = np.stack([before, after])
    table = np.where(np.isfinite(table), np.maximum(table, 0.0), 0.0)
    whole = np.concatenate([table, table.sum(axis=2, keepdims=True)], axis=2)
    floor = POLICY.relevance * whole.mean(axis=(0, 1))
    there = whole.max(axis=0) > 0.0
    ratios = (whole[0] + floor) / np.where(there, whole[1] + floor, 1.0)
    before, after = whole.sum(axis=1)
    none = np.where(before > 0.0, np.inf, 1.0)
    falls = np.divide(before, after, out=none, where=after > 0.0)
    chances = np.array([compute_chance(np.log(ratios[there[:, k], k])) for k in range(len(falls))])
    return Gain(fall=falls[:-1], p=chances[:-1], fall_of_all=float(falls[-1]), p_of_all=float(chances[-1]))


def compute_chance(values: FloatArray) -> float:
    """Return the probability of a mean of `values` (k,) as large as theirs if it is zero: Student's t."""
    count = len(values)
    if count < 2:
        return 1.0
    mean, error = float(values.mean()), float(values.std(ddof=1)) / math.sqrt(count)
    if error <= 0.0:
        return 0.0 if mean > 0.0 else 1.0
    return float(scipy.special.stdtr(count - 1, -mean / error))


def adjust_chances(chances: Sequence[float]) -> list[float]:
    """Return the probabilities of a family of tests as Holm (1979, Scand. J. Statist. 6) adjusts them."""
    order = sorted(range(len(chances)), key=lambda place: chances[place])
    found, largest = [1.0] * len(chances), 0.0
    for rank, place in enumerate(order):
        largest = max(largest, min(1.0, (len(chances) - rank) * chances[place]))
        found[place] = largest
    return found


def measure_inferiority(losses: FloatArray) -> FloatArray:
    """Return the chances (k,) that no other candidate predicts better than each, of `losses` (k, parts).

    The largest t of the log ratios to all others, against the same with signs of the parts exchanged at
    random for all candidates together: what agrees counts once (White 2000, Econometrica 68; Hansen 2005,
    J. Bus. Econ. Stat. 23).
    """
    losses = losses[:, losses.max(axis=0) > 0.0]
    count, parts = losses.shape
    if parts < 2:
        return np.ones(count)
    logs = np.log(losses + POLICY.relevance * losses.mean())
    signs = np.random.default_rng(0).choice((-1.0, 1.0), (numerics.EXCHANGES, parts))
    signs[0] = 1.0
    found = np.ones(count)
    for place in range(count):
        apart = np.delete(logs[place] - logs, place, axis=0)
        means, squares = signs @ apart.T / parts, np.mean(apart**2, axis=1)
        errors = np.sqrt(np.maximum(squares - means**2, numerics.CONVERGED * squares) / (parts - 1))
        largest = np.max(means / np.where(errors > 0.0, errors, np.inf), axis=1, initial=-np.inf)
        found[place] = np.mean(largest >= largest[0])
    return found


class Agreement(Enum):
    """What two estimates say of each other."""

    SAME = "same"
    DIFFERENT = "different"
    OPEN = "inconclusive"


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """The difference of two estimates in one quantity, relative to that quantity.

    `size` is the difference itself, `bound` what it is at most, `p` the probability of one so large by
    chance.
    """

    size: float
    bound: float
    p: float

    @property
    def verdict(self) -> Agreement:
        """Return whether it is shown to be small, shown to be there, or neither."""
        if self.bound < POLICY.relevance:
            return Agreement.SAME
        # What differs by less than matters is no contradiction, however sure it is.
        differs = self.p < POLICY.alarm and self.size > POLICY.relevance
        return Agreement.DIFFERENT if differs else Agreement.OPEN


def compute_changes(replicates: FloatArray) -> FloatArray:
    """Return R (S, ...), whose R'R is the covariance of a quantity, from its values without each block.

    The jackknife of Quenouille (1956): sqrt((S - 1) / S) (r_s - mean).
    """
    count = len(replicates)
    return np.asarray(np.sqrt((count - 1) / count) * (replicates - replicates.mean(axis=0)))


def compute_variance(changes: FloatArray) -> FloatArray:
    """Return variances (p,) from what blocks change (S, p), for normal intervals that hold as they say.

    A variance from few blocks is uncertain: sum c^2 has about 3 (sum c^2)^2 / sum c^4 - 2 degrees of freedom
    (Satterthwaite 1946), S - 1 at most, and is enlarged by the quantile of Student's t over the normal one.
    """
    squares = changes**2
    total, fourth = squares.sum(axis=0), np.sum(squares**2, axis=0)
    freedom = np.divide(3.0 * total**2, fourth, out=np.ones_like(total), where=fourth > 0.0)
    freedom = np.clip(freedom - 2.0, 1.0, max(1, len(changes) - 1))
    inside = 0.5 * (1.0 + POLICY.confidence)
    factor = scipy.special.stdtrit(freedom, inside) / scipy.special.ndtri(inside)
    return np.asarray(total * factor**2)


def agree(
    difference: FloatArray, changes: FloatArray, grams: FloatArray, sizes: FloatArray
) -> list[Difference]:
    """Return how two estimates differ in the torque of every joint.

    Args:
        difference: (p,) of the parameters.
        changes: (S, p) what each block changes the difference by, R'R is its covariance.
        grams: (n, p, p) products of the columns of each joint within the scoring band.
        sizes: (n,) squares of each joint's torque there; 0 for a joint at rest, which differs by nothing.
    """
    found = []
    for gram, size in zip(grams, sizes, strict=True):
        products, along = changes @ gram @ changes.T, changes @ (gram @ difference)
        found.append(_measure(float(size), difference @ gram @ difference, products, along))
    return found


def agree_in_value(difference: float, changes: FloatArray, size: float) -> Difference:
    """Return how two estimates differ in one value of size `size`; `changes` (S,) as for `agree`."""
    return _measure(size**2, difference**2, np.outer(changes, changes), changes * difference)


def _measure(size: float, square: float, products: FloatArray, along: FloatArray) -> Difference:
    """Return the difference of a `square` D'GD; products R G R' (S, S), along R G D (S,)."""
    noise = float(np.trace(products))
    if size <= 0.0 or noise <= numerics.TINY * size:
        differs = size > 0.0 and square > 0.0
        value = math.sqrt(square / size) if differs else 0.0
        return Difference(size=value, bound=value, p=0.0 if differs else 1.0)
    raw, freedom = float(np.sum(products**2)), len(products) - 1
    # Of few blocks the plain sum is too large by noise^2 / freedom.
    spread = (
        freedom**2 / ((freedom - 1.0) * (freedom + 2.0)) * (raw - noise**2 / freedom) if freedom > 1 else raw
    )
    spread = min(max(spread, numerics.CONVERGED * raw), noise**2)
    count = noise**2 / spread
    p = float(scipy.special.fdtrc(count, count * freedom, square / noise))
    excess = max(0.0, square - noise)
    quantile = float(scipy.special.ndtri(POLICY.confidence))
    bound = excess + quantile * math.sqrt(2.0 * spread + 4.0 * float(along @ along))
    return Difference(size=math.sqrt(excess / size), bound=math.sqrt(bound / size), p=p)
