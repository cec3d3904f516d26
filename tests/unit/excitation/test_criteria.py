"""Criteria: the numbers that linear algebra has for them, and slopes that finite differences find."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from symid.excitation.problem import Criterion, compute_condition, compute_criterion, compute_information


def make_matrix(seed, rows=40, columns=7):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(rows, columns)) * 10.0 ** rng.uniform(-2, 2, size=columns)


@given(seed=st.integers(0, 200))
def test_the_condition_number_is_that_of_the_scaled_columns(seed):
    matrix = make_matrix(seed)
    wanted = np.linalg.cond(matrix / np.linalg.norm(matrix, axis=0))
    np.testing.assert_allclose(compute_condition(matrix.T @ matrix), wanted, rtol=1e-8)


def test_information_rank_and_weight_are_those_of_the_matrix():
    matrix = make_matrix(3)
    wanted = np.log(np.linalg.svd(matrix, compute_uv=False)).mean()
    np.testing.assert_allclose(compute_information(matrix.T @ matrix), wanted, rtol=1e-10)
    np.testing.assert_allclose(
        compute_criterion(matrix.T @ matrix, Criterion(name="d-optimal"))[0], -wanted, rtol=1e-10
    )
    gram = make_matrix(7).T @ make_matrix(7)
    plain, more = (compute_criterion(gram, Criterion(power=4.0, weight=w))[0] for w in (0.0, 0.5))
    np.testing.assert_allclose(plain - more, 0.5 * compute_information(gram), rtol=1e-10)
    matrix = make_matrix(4)
    matrix[:, 2] = 3.0 * matrix[:, 5]
    assert compute_condition(matrix.T @ matrix) == np.inf
    assert compute_information(np.zeros((3, 3))) == -np.inf
    # The search may still go on from there.
    assert np.isfinite(compute_criterion(matrix.T @ matrix, Criterion())[0])
    value, slope = compute_criterion(make_matrix(8).T @ make_matrix(8), Criterion(power=400.0))
    assert np.isfinite(value)
    assert np.all(np.isfinite(slope))


@given(seed=st.integers(0, 100), power=st.sampled_from([2.0, 8.0, 40.0]))
def test_the_stand_in_is_above_the_condition_number_and_near_it(seed, power):
    matrix = make_matrix(seed)
    gram = matrix.T @ matrix
    gap = compute_criterion(gram, Criterion(power=power))[0] - np.log(compute_condition(gram))
    assert -1e-9 <= gap <= np.log(7) / power + 1e-9


@pytest.mark.parametrize("name", ["condition", "d-optimal"])
@pytest.mark.parametrize("weight", [0.0, 0.3])
def test_slopes_are_those_of_finite_differences(name, weight):
    matrix = make_matrix(5)
    ahead = np.random.default_rng(6).normal(size=matrix.shape) * np.linalg.norm(matrix, axis=0)
    criterion = Criterion(name=name, power=6.0, weight=weight)

    def compute_value(share):
        moved = matrix + share * ahead
        return compute_criterion(moved.T @ moved, criterion)[0]

    slope = compute_criterion(matrix.T @ matrix, criterion)[1]
    np.testing.assert_allclose(slope, slope.T, atol=1e-12 * np.abs(slope).max())
    h = 1e-5
    found = float(np.sum(2.0 * (matrix @ slope) * ahead))
    np.testing.assert_allclose(found, (compute_value(h) - compute_value(-h)) / (2 * h), rtol=1e-6)
