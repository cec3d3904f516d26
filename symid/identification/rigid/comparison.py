"""Two sets of values of the same parameters: by how many standard deviations they differ.

Values with covariance, the matrix T from the ones to the others -> `ValueComparison`.

    d = T x - y,  V = T C T' + S,  z_k = d_k / sqrt(V_kk),  chi^2 = d' V^-1 d

with x, C ours and y, S the others': their errors are taken as independent of each other.

Supported: deviations that are unknown on one side (the other's alone count), or on both (no test); terms that
groups may hold without naming them, tried one after the other.
Not supported: errors that both sets share.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from symid.arrays import FloatArray, FrozenArrays, freeze
from symid.serialization import HIDDEN

FAR = 3.0
"""Deviations beyond which a single difference is significant."""

_NORMAL_MEDIAN = 0.6744897501960817
_SINGULAR = 1e-12
_HUGE = 1e100
_LIKELIER = 20.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StatedValues(FrozenArrays):
    """Values in SI units with their covariance.

    Args:
        values: (m,). covariance: (m, m); where a deviation is not known, its row and column are NaN.
    """

    values: FloatArray
    covariance: FloatArray

    @property
    def std(self) -> FloatArray:
        """Return the standard deviations, NaN where they are not known: (m,)."""
        variances = np.diag(self.covariance)
        deviations: FloatArray = np.sqrt(np.where(variances >= 0.0, variances, np.nan))
        return deviations

    def pick(self, places: Sequence[int]) -> "StatedValues":
        """Return the values of some places."""
        kept = list(places)
        return StatedValues(values=self.values[kept], covariance=self.covariance[np.ix_(kept, kept)])


@dataclass(frozen=True, slots=True, kw_only=True)
class ChiSquare:
    """The sum of squares of `freedom` differences in deviations, correlations counted.

    `chance` is the probability of at least `value` where the stated deviations are true; `log_size` is
    log det V.
    """

    value: float
    freedom: int
    chance: float
    log_size: float

    @property
    def stretch(self) -> float:
        """Return the factor on all deviations with which the value is the expected one."""
        return math.sqrt(self.value / self.freedom)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ValueComparison:
    """Two sets of values beside each other, group by group; NaN where something is not known.

    Args:
        ours, theirs: with difference = ours - theirs, and `deviations` z: (m,).
        chi_square: over all groups that have a deviation; None where V is singular, or there are none.
        scale: factor on all deviations with which the median of |z| is that of chance, at least 1.
    """

    ours: StatedValues
    theirs: StatedValues
    difference: FloatArray
    deviations: FloatArray
    chi_square: ChiSquare | None
    scale: float

    @property
    def judged(self) -> int:
        """Return how many groups have a deviation."""
        return int(np.isfinite(self.deviations).sum())

    @property
    def largest(self) -> float:
        """Return the largest |z|, zero where there is none."""
        return float(np.nanmax(np.abs(self.deviations))) if self.judged else 0.0

    def count_within(self, limit: float) -> int:
        """Return how many groups differ by at most `limit` deviations."""
        return int((np.abs(self.deviations) <= limit).sum())

    def list_farthest(self, limit: float = FAR, most: int = 5) -> tuple[int, ...]:
        """Return the numbers of the groups beyond `limit`, the farthest first, at most `most`."""
        order = np.argsort(-np.nan_to_num(np.abs(self.deviations)), kind="stable")
        return tuple(int(k) for k in order if abs(self.deviations[k]) > limit)[:most]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadingTrial:
    """A term to try: `factor` times parameter `column` of ours, in the group number `group`."""

    group: int
    column: int
    factor: float


@dataclass(frozen=True, slots=True, kw_only=True)
class TriedReading:
    """The effect of a term in a group: z `before` and `after`, and by how much chi-square falls.

    `log_ratio` is the logarithm of the likelihood ratio with and without the term. `decisive`: the ratio is
    at least twenty, times the number of terms tried; `rivals` counts other terms in the same group whose
    ratio is less than twenty times smaller.
    """

    before: float
    after: float
    gain: float
    log_ratio: float
    trial: int = field(default=0, metadata=HIDDEN)
    decisive: bool = False
    rivals: int = field(default=0, metadata=HIDDEN)


def build_stated_values(
    values: Sequence[float], deviations: Sequence[float | None], covariance: Sequence[Sequence[float]] = ()
) -> StatedValues:
    """Return values (m,) in SI units with the covariance (m, m) given, else that of independent errors.

    `deviations` (m,) are None, infinite or beyond 1e100 where one is not known.
    """
    known = np.array([entry is not None and entry < _HUGE for entry in deviations], dtype=bool)
    if len(covariance):
        matrix = np.array(covariance, dtype=np.float64).reshape(len(values), len(values))
    else:
        spread = [
            float(entry or 0.0) if there else 0.0 for entry, there in zip(deviations, known, strict=True)
        ]
        matrix = np.diag(np.square(spread))
    known &= np.diag(matrix) < _HUGE**2
    matrix[~known, :] = np.nan
    matrix[:, ~known] = np.nan
    return StatedValues(values=np.array(values, dtype=np.float64), covariance=matrix)


def compute_grouped_values(change: FloatArray, stated: StatedValues) -> StatedValues:
    """Return T x with covariance T C T', T (m, n) `change` and x the n values of `stated`.

    A group that holds a value without a deviation has none.
    """
    unknown = np.isnan(np.diag(stated.covariance))
    covariance = change @ np.where(np.isnan(stated.covariance), 0.0, stated.covariance) @ change.T
    without = (change[:, unknown] != 0.0).any(axis=1)
    covariance[without, :] = np.nan
    covariance[:, without] = np.nan
    return StatedValues(values=change @ stated.values, covariance=covariance)


def compare_values(ours: StatedValues, theirs: StatedValues) -> ValueComparison:
    """Return the differences of two sets of values of the same groups, m each."""
    difference = ours.values - theirs.values
    known = ~(np.isnan(np.diag(ours.covariance)) & np.isnan(np.diag(theirs.covariance)))
    covariance = np.nan_to_num(ours.covariance, nan=0.0) + np.nan_to_num(theirs.covariance, nan=0.0)
    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    # A value without any error on both sides has no statistics.
    known &= spread > 0.0
    deviations = np.full(len(difference), np.nan)
    deviations[known] = difference[known] / spread[known]
    middle = float(np.median(np.abs(deviations[known]))) if known.any() else 0.0
    return ValueComparison(
        ours=ours,
        theirs=theirs,
        difference=freeze(difference),
        deviations=freeze(deviations),
        chi_square=_compute_chi_square(deviations[known], covariance[np.ix_(known, known)]),
        scale=max(1.0, middle / _NORMAL_MEDIAN),
    )


def _compute_chi_square(deviations: FloatArray, covariance: FloatArray) -> ChiSquare | None:
    if not len(deviations):
        return None
    spread = np.sqrt(np.diag(covariance))
    sizes, axes = np.linalg.eigh(covariance / np.outer(spread, spread))
    if sizes[0] < _SINGULAR * sizes[-1]:
        return None
    from scipy.special import chdtrc

    value = float(np.sum((axes.T @ deviations) ** 2 / sizes))
    return ChiSquare(
        value=value,
        freedom=len(deviations),
        chance=float(chdtrc(float(len(deviations)), value)),
        log_size=float(np.sum(np.log(sizes)) + 2.0 * np.sum(np.log(spread))),
    )


def try_readings(
    change: FloatArray, ours: StatedValues, theirs: StatedValues, trials: Sequence[ReadingTrial]
) -> tuple[TriedReading, ...]:
    """Return the effect of each term that a group may hold on the agreement, the most likely one first.

    Of those that bring their group within three deviations (times scale), the likeliest is taken in, then the
    next of another group, as long as it is decisive: for d ~ N(0, scale^2 V)

        log_ratio = (chi^2 without - chi^2 with) / (2 scale^2) - ln(det V with / det V without) / 2 > ln(20 N)

    for N trials; the second part counts against terms that widen V. The others follow, each as it stands
    beside those. `change` is T, (m, n), as the groups name themselves, for n values of ours and m of theirs.
    """
    scale = compare_values(compute_grouped_values(change, ours), theirs).scale
    least = math.log(_LIKELIER * max(1, len(trials)))
    near = math.log(_LIKELIER)
    waiting = list(range(len(trials)))
    found: list[TriedReading] = []
    while waiting:
        now = compare_values(compute_grouped_values(change, ours), theirs)
        tried = []
        for entry in [trials[number] for number in waiting]:
            then = compare_values(compute_grouped_values(add_readings(change, [entry]), ours), theirs)
            gain = log_ratio = -math.inf
            first, second = now.chi_square, then.chi_square
            # Chi-squares over different groups cannot be compared.
            if first is not None and second is not None and first.freedom == second.freedom:
                gain = first.value - second.value
                log_ratio = 0.5 * (gain / scale**2 + first.log_size - second.log_size)
            before, after = (float(side.deviations[entry.group]) for side in (now, then))
            tried.append(TriedReading(before=before, after=after, gain=gain, log_ratio=log_ratio))
        order = sorted(range(len(tried)), key=lambda k: -tried[k].log_ratio)
        given = {trials[reading.trial].group for reading in found}
        explaining = [
            k for k in order if abs(tried[k].after) <= FAR * scale and trials[waiting[k]].group not in given
        ]
        if not explaining or tried[explaining[0]].log_ratio <= least:
            found += [replace(tried[k], trial=waiting[k]) for k in order]
            break
        best, trial = tried[explaining[0]], waiting[explaining[0]]
        group = trials[trial].group
        alike = [
            k
            for k in explaining
            if trials[waiting[k]].group == group and tried[k].log_ratio > best.log_ratio - near
        ]
        found.append(replace(best, trial=trial, decisive=True, rivals=len(alike) - 1))
        waiting.remove(trial)
        change = add_readings(change, [trials[trial]])
    return tuple(found)


def add_readings(change: FloatArray, trials: Sequence[ReadingTrial]) -> FloatArray:
    """Return T, (m, n), with terms added."""
    changed = np.array(change)
    for trial in trials:
        changed[trial.group, trial.column] += trial.factor
    return changed


def list_shared_logs(first: Sequence[tuple[str, str]], second: Sequence[tuple[str, str]]) -> tuple[str, ...]:
    """Return the logs of `first` that are also in `second`, both as (path, digest), empty if not known.

    They are compared by content, or by path where that is not known.
    """
    return tuple(
        path
        for path, digest in first
        if any(
            # Logs of several folders may have one name.
            digest == other if digest and other else Path(path).resolve() == Path(place).resolve()
            for place, other in second
        )
    )
