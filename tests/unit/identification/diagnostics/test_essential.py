"""Essential parameters, block bootstrap, correlations, drift: against closed forms and counts."""

from dataclasses import replace

import numpy as np
import pytest

from symid.identification.diagnostics.uncertainty import (
    compute_bootstrap,
    compute_ellipse,
    cut_blocks,
    list_correlated,
    measure_drift,
    select_essential,
)
from symid.identification.estimators.least_squares import fit_ols, fit_wls
from symid.identification.judge import POLICY
from symid.identification.regression.equations import stack_rows
from symid.identification.regression.identifiability import analyse_identifiability
from tests.unit.identification.row_tables import make_rows

NAMES = tuple("abcdefgh")
TRUTH = np.array([3.0, -2.0, 1.0, 0.5, 0.0, 0.0, 0.0, 0.0])


def build_rows(truth=TRUTH, *, seed=0, noise=1.0, samples=1000, groups=2):
    rng = np.random.default_rng(seed)
    count = groups * samples
    matrix = rng.normal(size=(count, len(truth)))
    scatter = np.repeat(1.0 + 4.0 * np.arange(groups), samples)
    values = matrix @ truth + noise * scatter * rng.normal(size=count)
    time = np.tile(np.arange(samples) * 1e-2, groups)
    return make_rows(matrix, values, np.repeat(np.arange(groups), samples), time=time)


def fit(rows, estimator=fit_wls):
    seen = analyse_identifiability(rows)
    return estimator(rows, seen), seen


def test_what_is_zero_goes_and_what_is_not_stays():
    for seed in range(5):
        rows = build_rows(seed=seed)
        found = select_essential(rows, *fit(rows))
        assert set("abcd") <= set(found.kept)
        assert len(found.kept) <= 6
        assert {entry.name for entry in found.dropped} | set(found.kept) == set(NAMES)
    rows = build_rows(np.zeros(3))
    assert len(select_essential(rows, *fit(rows), level=50.0).kept) == 0


def test_deviations_follow_the_rule_for_the_noise_of_the_fit():
    rows = replace(build_rows(noise=3.0), independent=0.25)
    seen, count = analyse_identifiability(rows), len(rows.values)
    fits = {freedom: fit_ols(rows, seen, freedom) for freedom in ("band", "one")}
    band, one = (
        select_essential(rows, replace(fit, covariance=fits["one"].covariance), seen, freedom=freedom)
        .dropped[0]
        .ratio
        for freedom, fit in fits.items()
    )
    assert band / one == pytest.approx(np.sqrt((0.25 * count - len(TRUTH)) / (count - 1.0)), rel=1e-9)


def test_the_rest_is_a_least_squares_fit_without_the_dropped_columns():
    rows = build_rows()
    fitted, seen = fit(rows)
    found = select_essential(rows, fitted, seen)
    kept = [NAMES.index(name) for name in found.kept]
    w = fitted.weights
    expected = np.linalg.lstsq(rows.matrix[:, kept] * w[:, None], rows.values * w, rcond=None)[0]
    assert found.values[kept] == pytest.approx(expected, rel=1e-9)
    assert not np.delete(found.values, kept).any()
    own = np.linalg.norm((rows.values - rows.matrix @ found.values) * w)
    share = own / np.linalg.norm(fitted.residuals * w)
    assert found.price_percent == pytest.approx(100.0 * (share - 1.0), abs=1e-9)
    assert found.dropped[-1].price_percent == pytest.approx(found.price_percent)
    assert all(entry.ratio < POLICY.printed for entry in found.dropped)


def test_parameters_that_cannot_be_told_are_not_dropped():
    rows = build_rows(TRUTH[:5])
    matrix = rows.matrix.copy()
    matrix[:, 4] = 2.0 * matrix[:, 3]
    rows = replace(rows, matrix=matrix)
    fitted, seen = fit(rows)
    found = select_essential(rows, fitted, seen)
    assert found.kept == ("a", "b", "c")
    assert rows.matrix @ found.values == pytest.approx(rows.matrix @ fitted.values, abs=1e-9)


def test_bootstrap_of_white_noise_is_what_is_stated():
    rows = build_rows(samples=4000)
    fitted, seen = fit(rows)
    found = compute_bootstrap(rows, fitted, seen, np.random.default_rng(0), replicates=400)
    stated = np.sqrt(np.diag(fitted.covariance))
    # Over logs its mean is the stated one.
    ratios = [found.deviations / stated]
    for seed in range(1, 12):
        other = build_rows(samples=4000, seed=seed)
        again, seen = fit(other)
        drawn = compute_bootstrap(other, again, seen, np.random.default_rng(seed))
        ratios.append(drawn.deviations / np.sqrt(np.diag(again.covariance)))
    assert np.mean(ratios, axis=0) == pytest.approx(np.ones(8), abs=0.15)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.05)
    assert np.all(found.low < fitted.values)
    assert np.all(fitted.values < found.high)
    assert (found.names, found.blocks, found.replicates) == (NAMES, POLICY.folds * POLICY.parts, 400)
    # It repeats itself.
    first, second = (
        compute_bootstrap(rows, fitted, seen, np.random.default_rng(3), replicates=20) for _ in range(2)
    )
    assert first.deviations.tobytes() == second.deviations.tobytes()


def test_bootstrap_sees_a_pattern_that_the_stated_deviation_does_not():
    rows = build_rows(TRUTH[:2], samples=4000, groups=1, noise=0.1)
    time = rows.time
    slow = np.sin(2.0 * np.pi * 0.05 * time)
    values = rows.values + slow * np.cumsum(np.random.default_rng(1).normal(size=4000)) * 0.05
    rows = replace(rows, matrix=np.column_stack([np.ones_like(time), rows.matrix[:, 1]]), values=values)
    fitted, seen = fit(rows, fit_ols)
    found = compute_bootstrap(rows, fitted, seen, np.random.default_rng(0))
    assert found.deviations[0] > 3.0 * np.sqrt(fitted.covariance[0, 0])


def test_blocks_are_stretches_of_time_shared_by_all_joints():
    short, long = build_rows(samples=500), build_rows(samples=1500, seed=1)
    rows = stack_rows([short, long])
    number, count = cut_blocks(rows, 40)
    assert count == 40
    assert len(np.unique(number[rows.run == 0])) == 10
    assert len(np.unique(number[rows.run == 1])) == 30
    for block in range(count):
        members = number == block
        assert set(rows.group[members]) == {0, 1}
        assert np.ptp(rows.time[members]) <= 0.5


def test_correlations_and_their_order():
    covariance = np.array([[4.0, -1.9, 0.0], [-1.9, 1.0, 0.0], [0.0, 0.0, 0.0]])
    assert list_correlated(covariance, "abc") == (("a", "b", pytest.approx(-0.95)),)
    # The variance of one beside the other that is known, by the formula of conditional normal values.
    for r, close in ((0.7, False), (0.71, True)):
        pair = np.array([[4.0, 2.0 * r], [2.0 * r, 1.0]])
        assert (
            bool(list_correlated(pair, "ab"))
            == (1.0 / np.linalg.inv(pair)[0, 0] < 4.0 / POLICY.fall)
            == close
        )
    # The closest pair comes first.
    three = np.array([[1.0, 0.8, 0.75], [0.8, 1.0, 0.9], [0.75, 0.9, 1.0]])
    assert [size for *_, size in list_correlated(three, "abc")] == pytest.approx([0.9, 0.8, 0.75])


def test_the_ellipse_holds_its_share():
    covariance = np.array([[2.0, 0.8], [0.8, 0.5]])
    ellipse = compute_ellipse((1.0, -1.0), covariance, 0.9)
    outline = ellipse.trace() - ellipse.centre
    distance = np.einsum("ij,jk,ik->i", outline, np.linalg.inv(covariance), outline)
    assert distance == pytest.approx(np.full(len(outline), -2.0 * np.log(0.1)))
    drawn = np.random.default_rng(0).multivariate_normal((0.0, 0.0), covariance, 20000)
    inside = np.einsum("ij,jk,ik->i", drawn, np.linalg.inv(covariance), drawn) < distance[0]
    assert inside.mean() == pytest.approx(0.9, abs=0.01)
    assert ellipse.axes[0] >= ellipse.axes[1]


def test_equal_logs_agree_and_a_changed_parameter_is_named():
    rows = build_rows()
    found = measure_drift(rows, fit(rows)[0])
    assert (found.changed, found.compared, found.runs) == ((), 0, (0,))
    false = 0
    for seed in range(20):
        same = stack_rows([build_rows(seed=2 * seed + k) for k in (0, 1)])
        found = measure_drift(same, fit(same)[0])
        assert found.compared == 8
        false += len(found.changed)
    assert false <= 1
    other = TRUTH + np.array([0.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    rows = stack_rows([build_rows(), build_rows(other, seed=1), build_rows(seed=2)])
    (changed,) = measure_drift(rows, fit(rows)[0]).changed
    assert changed.name == "b"
    assert changed.values[1] - changed.values[0] == pytest.approx(0.5, abs=0.2)
