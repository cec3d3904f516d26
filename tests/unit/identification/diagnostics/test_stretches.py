"""Choices by losses on held-out blocks, against SciPy's paired test."""

import numpy as np
import pytest
from scipy.stats import ttest_rel

from symid.identification.diagnostics import choose_held_out, measure_behind


@pytest.fixture
def losses():
    rng = np.random.default_rng(4)
    shared = rng.chisquare(3.0, size=40)
    return np.stack([shared + shift + 0.1 * rng.normal(size=40) for shift in (0.0, 0.01, 0.5)])


def test_distances_are_the_paired_t_statistics(losses):
    expected = [ttest_rel(loss, losses[0]).statistic for loss in losses[1:]]
    assert measure_behind(losses, 0)[1:] == pytest.approx(np.maximum(expected, 0.0))
    # The best is not behind itself, nor is a better one; one that always errs by the same more is clearly.
    assert measure_behind(losses, 0)[0] == 0.0
    assert measure_behind(losses, 2).tolist() == [0.0, 0.0, 0.0]
    assert measure_behind(np.array([[1.0, 2.0], [2.0, 3.0]]), 0).tolist() == [0.0, np.inf]


def test_the_cheapest_of_those_close_to_the_best_is_taken(losses):
    choice = choose_held_out(losses, [3, 2, 1], margin=2.0)
    assert (choice.best, choice.taken) == (0, 1)
    assert choice.behind[1] <= 2.0 < choice.behind[2]
    assert choose_held_out(losses, [1, 2, 3], margin=2.0).taken == 0
    # Of equal costs the smaller loss decides.
    assert choose_held_out(losses[[1, 0]], [2, 2], margin=2.0).taken == 1
