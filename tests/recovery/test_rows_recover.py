"""Parameters come back from data made with them: exactly without noise, within their std with it."""

import numpy as np
import pytest

from symid.identification.estimators.least_squares import fit_ols, fit_wls
from symid.identification.regression.equations import ROW_KINDS, build_rows
from symid.identification.regression.identifiability import analyse_identifiability
from symid.robot.description import Decimation, Processing
from tests.recovery.closed_form import (
    ONE_AXIS_TRUTH,
    TWO_LINK_TRUTH,
    build_one_axis,
    build_signals,
    build_two_link,
)

ROBOTS = {"one_axis": (build_one_axis, ONE_AXIS_TRUTH), "two_link": (build_two_link, TWO_LINK_TRUTH)}
PLAIN = Processing()


def fit(rows, estimator=fit_ols):
    return estimator(rows, analyse_identifiability(rows))


@pytest.mark.parametrize("estimator", [fit_ols, fit_wls])
@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("kind", ROW_KINDS)
def test_exact_states_give_the_true_parameters(kind, robot, estimator):
    build, truth = ROBOTS[robot]
    library = build()
    signals = build_signals(library, truth, samples=20001)
    found = fit(build_rows(kind, library, signals, PLAIN), estimator).values
    np.testing.assert_allclose(found, truth, rtol=1e-9, atol=1e-9)


def test_parallel_decimation_does_not_bias():
    library = build_two_link()
    signals = build_signals(library, TWO_LINK_TRUTH, samples=20001)
    processing = Processing(decimation=Decimation(factor=10))
    rows = build_rows("torque", library, signals, processing)
    assert len(rows.values) == pytest.approx(2 * 2000, abs=4)
    # Not exact to the last bit: the filter of order 8, in the form of a transfer function,
    # rounds at 1e-9 of the largest column.
    np.testing.assert_allclose(fit(rows).values, TWO_LINK_TRUTH, rtol=1e-7, atol=1e-7)


def test_decimated_noise_still_has_an_honest_standard_deviation():
    library = build_one_axis()
    processing = Processing(decimation=Decimation(factor=10))
    scores = []
    for seed in range(60):
        signals = build_signals(library, ONE_AXIS_TRUTH, samples=10001, seed=seed, noise=(5.0,))
        result = fit(build_rows("torque", library, signals, processing))
        scores.append((result.values - ONE_AXIS_TRUTH) / np.sqrt(np.diag(result.covariance)))
    assert 0.8 < np.std(scores) < 1.25


def test_wls_beats_ols_where_joints_are_not_equally_noisy():
    library = build_two_link()
    errors = {fit_ols: [], fit_wls: []}
    for seed in range(30):
        signals = build_signals(library, TWO_LINK_TRUTH, period=5e-3, seed=seed, noise=(3.0, 0.03))
        rows = build_rows("torque", library, signals, PLAIN)
        for estimator, found in errors.items():
            found.append(fit(rows, estimator).values - TWO_LINK_TRUTH)
    spread = {estimator: np.std(found, axis=0) for estimator, found in errors.items()}
    second_link = slice(3, 6)
    assert np.all(spread[fit_wls][second_link] < 0.2 * spread[fit_ols][second_link])
