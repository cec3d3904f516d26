"""How figures scatter over many runs: median, percentile, paired differences with their interval.

Input: one number a run. Output: `Spread`, `PairedDifference`.

Supported: runs without a result (nan) count as worse than all others.
Not supported: runs of unequal weight.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from symid.arrays import FloatArray

__all__ = ["PairedDifference", "Spread", "find_paired_difference", "find_spread"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Spread:
    """Median and 90th percentile of `runs` runs, `failed` of them without a result."""

    median: float
    percentile90: float
    runs: int
    failed: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class PairedDifference:
    """The mean of differences between two figures of the same runs, with its 95 % interval (Student)."""

    mean: float
    low: float
    high: float
    runs: int

    @property
    def verdict(self) -> str:
        """Return what the interval says: below, above or not different from zero."""
        if self.high < 0.0:
            return "lower"
        return "higher" if self.low > 0.0 else "no difference"


def find_spread(values: FloatArray) -> Spread:
    """Return median and 90th percentile of `values` (runs,); nan counts as infinite."""
    array = np.asarray(values, dtype=np.float64)
    failed = int(np.isnan(array).sum())
    ordered = np.sort(np.where(np.isnan(array), math.inf, array))
    return Spread(
        median=_pick(ordered, 0.5), percentile90=_pick(ordered, 0.9), runs=len(array), failed=failed
    )


def _pick(ordered: FloatArray, share: float) -> float:
    """Return a percentile by linear interpolation, infinite where one of its neighbours is."""
    place = share * (len(ordered) - 1)
    low, high = ordered[math.floor(place)], ordered[math.ceil(place)]
    part = place - math.floor(place)
    return float(low if not part or low == high else (1.0 - part) * low + part * high)


def find_paired_difference(
    first: FloatArray, second: FloatArray, confidence: float = 0.95
) -> PairedDifference:
    """Return the mean of first - second (runs,) each, with Student's interval."""
    difference = np.asarray(first, dtype=np.float64) - np.asarray(second, dtype=np.float64)
    runs = len(difference)
    mean = float(difference.mean())
    if runs < 2:
        return PairedDifference(mean=mean, low=-math.inf, high=math.inf, runs=runs)
    half = float(stdtrit(runs - 1, 0.5 + confidence / 2.0) * difference.std(ddof=1) / math.sqrt(runs))
    return PairedDifference(mean=mean, low=mean - half, high=mean + half, runs=runs)
