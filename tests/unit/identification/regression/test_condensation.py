"""Triangles stand for all rows: the same sums of squares, the same fits, however the rows come."""

import gc
from dataclasses import replace

import numpy as np
import pytest

from symid.identification.estimators.least_squares import fit_condensed, fit_ols, fit_wls
from symid.identification.regression import identifiability as condensation
from symid.identification.regression.equations import build_rows, select_rows
from symid.identification.regression.identifiability import (
    analyse_identifiability,
    compute_square_sums,
    condense_rows,
    condense_weighted,
)
from symid.robot.description import Processing
from tests.recovery.closed_form import TWO_LINK_TRUTH, build_signals, build_two_link

PLAIN = Processing()


@pytest.fixture(scope="module")
def library():
    return build_two_link()


@pytest.fixture(scope="module")
def signals(library):
    return build_signals(library, TWO_LINK_TRUTH, samples=9001, noise=(0.5, 0.2))


@pytest.fixture(scope="module")
def rows(library, signals):
    return build_rows("torque", library, signals, PLAIN)


def test_square_sums_are_those_of_the_rows(rows):
    condensed = condense_rows(rows)
    for values in (TWO_LINK_TRUTH, np.zeros(12), np.arange(12.0)):
        errors = rows.values - rows.matrix @ values
        expected = [np.sum(errors[rows.group == joint] ** 2) for joint in (0, 1)]
        np.testing.assert_allclose(compute_square_sums(condensed, values), expected, rtol=1e-10)
    np.testing.assert_array_equal(condensed.counts, [9001, 9001])
    assert not np.tril(condensed.factors, -1).any()


def test_rows_in_any_order_condense_to_the_same_once(rows, library, signals):
    order = np.random.default_rng(0).permutation(len(rows.values))
    names = ("matrix", "values", "group", "time", "velocity", "run", "weight")
    shuffled = replace(rows, **{name: getattr(rows, name)[order] for name in names})
    products = [f.transpose(0, 2, 1) @ f for f in (condense_rows(r).factors for r in (rows, shuffled))]
    np.testing.assert_allclose(products[0], products[1], rtol=1e-9, atol=1e-6)
    # Rows are factorised once and forgotten with them.
    fresh = build_rows("torque", library, signals, PLAIN)
    assert condense_rows(fresh) is condense_rows(fresh)
    known = len(condensation._KNOWN)
    del fresh
    gc.collect()
    assert len(condensation._KNOWN) < known


def test_a_weight_of_zero_is_a_row_left_out(rows):
    keep = rows.time < 4.0
    cut = condense_rows(select_rows(rows, keep))
    zero = condense_weighted(rows, keep * 1.0)
    np.testing.assert_allclose(
        compute_square_sums(zero, TWO_LINK_TRUTH), compute_square_sums(cut, TWO_LINK_TRUTH), rtol=1e-10
    )
    np.testing.assert_array_equal(zero.counts, cut.counts)


@pytest.mark.parametrize("freedom", ["band", "one"])
def test_condensed_fits_are_those_of_the_rows(rows, freedom):
    seen = analyse_identifiability(rows)
    for fit, weights in ((fit_ols, np.ones(2)), (fit_wls, None)):
        expected = fit(rows, seen, freedom)
        found = fit_condensed(condense_rows(rows), seen.basis, weights, freedom)
        np.testing.assert_allclose(found.values, expected.values, rtol=1e-9)
        np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-7, atol=1e-18)
        assert found.condition == pytest.approx(expected.condition)
