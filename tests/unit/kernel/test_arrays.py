"""Triangles of matrices, against their squares and NumPy's."""

import numpy as np
import pytest

from symid.arrays import compute_triangle

SHAPES = [(0, 3), (3, 0), (1, 1), (3, 7), (50, 4), (16001, 5), (40000, 12)]


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("order", ["C", "F"])
def test_a_triangle_has_the_squares_of_its_matrix(shape, order):
    matrix = np.array(np.random.default_rng(1).normal(size=shape), order=order)
    before = matrix.copy()
    triangle = compute_triangle(matrix)
    np.testing.assert_array_equal(matrix, before)
    expected = np.linalg.qr(matrix, mode="r")
    assert triangle.shape == expected.shape
    np.testing.assert_array_equal(triangle, np.triu(triangle))
    np.testing.assert_allclose(np.abs(triangle), np.abs(expected), rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(triangle.T @ triangle, matrix.T @ matrix, rtol=1e-11, atol=1e-10)


def test_zero_columns_stay_zero_and_no_number_is_hidden():
    matrix = np.zeros((20000, 3))
    matrix[:, 1] = 2.0
    np.testing.assert_allclose(
        np.linalg.svd(compute_triangle(matrix))[1], [2.0 * 20000**0.5, 0.0, 0.0], atol=1e-9
    )
    matrix = np.ones((10, 2))
    matrix[3, 1] = np.nan
    assert np.isnan(compute_triangle(matrix)[:, 1]).any()
