"""Medians, percentiles and paired differences against NumPy and SciPy's own."""

import math

import numpy as np
import pytest
from scipy.stats import ttest_rel

from symid.study.monte_carlo import compute_paired_difference, compute_spread


def test_the_spread_is_that_of_numpy_and_failed_runs_are_the_worst():
    values = np.random.default_rng(3).lognormal(size=37)
    found = compute_spread(values)
    assert found.median == pytest.approx(np.median(values), rel=1e-14)
    assert found.percentile90 == pytest.approx(np.percentile(values, 90), rel=1e-14)
    assert (found.runs, found.failed) == (37, 0)
    found = compute_spread(np.array([1.0, math.nan, 2.0, 3.0, 4.0]))
    assert (found.median, found.failed) == (3.0, 1)
    assert found.percentile90 == math.inf


def test_paired_differences_have_students_interval():
    rng = np.random.default_rng(5)
    first = rng.normal(size=20)
    second = first + 0.3 + 0.1 * rng.normal(size=20)
    found = compute_paired_difference(first, second)
    expected = ttest_rel(first, second).confidence_interval(0.95)
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high), rel=1e-10)
    assert found.verdict == "lower"
    assert compute_paired_difference(second, first).verdict == "higher"
    assert compute_paired_difference(first, first + rng.normal(size=20)).verdict == "no difference"
    found = compute_paired_difference(np.array([1.0]), np.array([0.0]))
    assert (found.low, found.high, found.verdict) == (-math.inf, math.inf, "no difference")
