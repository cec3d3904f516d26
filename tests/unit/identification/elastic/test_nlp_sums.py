"""Sums over windows and through the filter: against plain loops, and against their adjoints."""

import numpy as np
import pytest

from symid.identification.elastic.nlp_cost import FilterSums, WindowSums
from symid.identification.elastic.regression import filter_held

RATE, PERIOD, COUNT = 60.0, 1e-3, 997


def build_filter(first=130, length=7):
    count = (COUNT - first) // length + 1
    return FilterSums(
        steps=COUNT, first=first, length=length, count=count, decay=float(np.exp(-RATE * PERIOD))
    )


def build_windows(rng, first=40, length=31):
    count = (COUNT - first) // length
    return WindowSums(first=first, length=length, count=count, weights=rng.normal(size=COUNT))


def test_the_filter_is_that_of_held_signals():
    rng = np.random.default_rng(0)
    steps = rng.normal(size=(COUNT, 3))
    sums = build_filter()
    whole = filter_held(np.vstack([steps, steps[-1:]]), RATE, PERIOD)
    kept = slice(sums.first, None, sums.length)
    np.testing.assert_allclose(sums.add(steps), whole[kept][: sums.count], rtol=1e-12, atol=1e-14)


def test_windows_are_weighted_sums():
    rng = np.random.default_rng(1)
    sums = build_windows(rng)
    steps = rng.normal(size=(COUNT, 2))
    for row in (0, 5, sums.count - 1):
        part = slice(sums.first + row * sums.length, sums.first + (row + 1) * sums.length)
        expected = (sums.weights[part, None] * steps[part]).sum(axis=0)
        np.testing.assert_allclose(sums.add(steps)[row], expected, rtol=1e-12)


@pytest.mark.parametrize("kind", ["filter", "windows"])
def test_spread_is_the_adjoint_of_add(kind):
    rng = np.random.default_rng(2)
    sums = build_filter() if kind == "filter" else build_windows(rng)
    steps, rows = rng.normal(size=COUNT), rng.normal(size=sums.count)
    assert sums.add(steps) @ rows == pytest.approx(steps @ sums.spread(rows), rel=1e-12)
