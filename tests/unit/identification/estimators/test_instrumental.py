"""Instruments against their formula, against least squares, and against Hausman's contrast."""

from dataclasses import replace

import numpy as np
import pytest

from symid.errors import IdentifiabilityError
from symid.identification.estimators.instrumental import assess_exogeneity, fit_instruments
from symid.identification.estimators.least_squares import fit_weighted, fit_wls
from symid.identification.regression.identifiability import RankRule, analyse_identifiability
from tests.refusals import raises
from tests.unit.identification.row_tables import make_rows

TRUTH = np.array([2.0, -1.0, 0.5])
COUNT = 600


def make_pair(rng, states=0.0, torque=0.1, independent=1.0, weight=None):
    """Return measured rows, whose matrix carries noise of a size, and the rows without it."""
    clean = rng.normal(size=(2 * COUNT, 3)) * np.array([1.0, 10.0, 0.1])
    noise = rng.normal(size=clean.shape) * np.array([1.0, 10.0, 0.1]) * states
    scatter = torque * np.repeat([1.0, 5.0], COUNT) * rng.normal(size=2 * COUNT)
    tau = clean @ TRUTH + scatter
    fields = {"time": np.tile(np.arange(COUNT, dtype=float), 2), "independent": independent}
    fields |= {} if weight is None else {"weight": weight}
    return tuple(make_rows(part, tau, np.repeat([0, 1], COUNT), **fields) for part in (clean + noise, clean))


def test_without_noise_of_states_it_is_wls():
    rng = np.random.default_rng(1)
    weight = np.tile(np.repeat([1.0, 9.0], COUNT // 2), 2)
    rows, instruments = make_pair(rng, independent=0.4, weight=weight)
    found = fit_instruments(rows, instruments, freedom="band")
    usual = fit_wls(rows, analyse_identifiability(rows), "band")
    np.testing.assert_allclose(found.fit.values, usual.values, rtol=1e-10)
    np.testing.assert_allclose(found.fit.covariance, usual.covariance, rtol=1e-8, atol=1e-18)
    np.testing.assert_allclose(found.fit.weights, usual.weights, rtol=1e-8)
    assert found.fit.condition == pytest.approx(usual.condition, rel=1e-8)
    assert found.correlation == pytest.approx(1.0, abs=1e-12)
    assert found.strength == np.inf
    assert not found.fit.notices
    verdict = assess_exogeneity(rows, found, "band")
    assert (verdict.statistic, verdict.freedom[0], verdict.probability) == (0.0, 0, 1.0)
    assert not verdict.biased
    assert max(abs(shift) for _, shift in verdict.shifts) < 1e-8


def test_it_is_its_formula():
    rng = np.random.default_rng(2)
    rows, instruments = make_pair(rng, states=0.5, independent=0.5)
    found = fit_instruments(rows, instruments, freedom="band")
    weight = np.diag(found.fit.weights**2)
    y, z, tau = rows.matrix, instruments.matrix, rows.values
    crossed = np.linalg.inv(z.T @ weight @ y)
    values = crossed @ z.T @ weight @ tau
    errors = tau - y @ values
    variance = errors @ weight @ errors / (0.5 * len(tau) - 3)
    covariance = variance * crossed @ (z.T @ weight @ z) @ crossed.T
    np.testing.assert_allclose(found.fit.values, values, rtol=1e-9)
    np.testing.assert_allclose(found.fit.covariance, covariance, rtol=1e-7)
    np.testing.assert_allclose(found.fit.residuals, errors, atol=1e-9)
    # The weights are the inverse scatter of its own residuals, joint by joint, less what parameters take.
    leverage = np.diag(y @ crossed @ z.T @ weight)
    assert leverage.sum() == pytest.approx(3.0)
    for group in (0, 1):
        own = rows.group == group
        scatter = np.linalg.norm(errors[own]) / np.sqrt(own.sum() - leverage[own].sum() / 0.5)
        assert found.fit.weights[own][0] == pytest.approx(1.0 / scatter, rel=1e-5)
    assert fit_instruments(rows, instruments, freedom="one").fit.spent.sum() == pytest.approx(1.0)


def test_the_test_is_the_contrast_of_hausman():
    rng = np.random.default_rng(3)
    rows, instruments = make_pair(rng, states=0.05)
    found = fit_instruments(rows, instruments, freedom="parameters")
    groups = found.fit.weights[[0, COUNT]]
    usual = fit_weighted(rows, found.identifiability, groups, "parameters")
    weight = np.diag(found.fit.weights**2)
    y, z = rows.matrix, instruments.matrix
    crossed = np.linalg.inv(z.T @ weight @ y)
    gap = crossed @ (z.T @ weight @ z) @ crossed.T - np.linalg.inv(y.T @ weight @ y)
    shift = usual.values - found.fit.values
    contrast = shift @ np.linalg.solve(gap, shift)
    squares = usual.residuals @ weight @ usual.residuals
    free = 2 * COUNT - 6
    verdict = assess_exogeneity(rows, found, "parameters")
    assert verdict.freedom == (3, free)
    assert verdict.statistic == pytest.approx(contrast / 3 / ((squares - contrast) / free), rel=1e-6)
    deviations = np.sqrt(np.diag(usual.covariance))
    np.testing.assert_allclose([size for _, size in verdict.shifts], shift / deviations, rtol=1e-9)


def test_noise_of_states_draws_wls_to_zero_and_not_this():
    errors = []
    for seed in range(40):
        rows, instruments = make_pair(np.random.default_rng(seed), states=0.3)
        found = fit_instruments(rows, instruments)
        usual = fit_wls(rows, analyse_identifiability(rows))
        # Noise of 0.3 of a column: what is left is the column's square over that of both.
        assert usual.values[1] / TRUTH[1] == pytest.approx(1.0 / 1.09, rel=0.05)
        errors.append((found.fit.values - TRUTH) / np.sqrt(np.diag(found.fit.covariance)))
        verdict = assess_exogeneity(rows, found)
        assert verdict.significant
        assert {name for name, _ in verdict.biased} & {"b"}
        sizes = [abs(size) for _, size in verdict.biased]
        assert sizes == sorted(sizes, reverse=True)
        assert found.strength > 100.0
    errors = np.array(errors)
    assert np.all(np.abs(errors.mean(axis=0)) < 3.0 / np.sqrt(40))
    assert np.all(np.abs(errors.std(axis=0) - 1.0) < 0.35)


def test_noise_of_torque_alone_is_not_called_bias():
    """The test errs as often as it says: columns whose noise the torque has too leave F its distribution."""
    chances = []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        rows, instruments = make_pair(rng)
        # What distorts Y is in the torque as well: exogenous columns that Z resembles only.
        moved = rows.matrix * (1.0 + 0.2 * rng.normal(size=(2 * COUNT, 1)))
        tau = rows.values + (moved - rows.matrix) @ TRUTH
        measured = replace(rows, matrix=moved, values=tau)
        chances.append(assess_exogeneity(measured, fit_instruments(measured, instruments)).probability)
    chances = np.sort(chances)
    # Kolmogorov and Smirnov against the uniform distribution, at one in a thousand.
    gap = np.max(np.abs(chances - (np.arange(200) + 0.5) / 200))
    assert gap < 1.95 / np.sqrt(200)


def test_what_either_side_cannot_tell_is_refused():
    rng = np.random.default_rng(5)
    rows, instruments = make_pair(rng, states=0.1)
    why = "acts on no measured torque of this log"
    blind, still = instruments.matrix * [1.0, 1.0, 0.0], rows.matrix * [1.0, 0.0, 1.0]
    found = fit_instruments(rows, replace(instruments, matrix=blind))
    assert dict(found.identifiability.refused) == {"c": why}
    assert [notice.code for notice in found.fit.notices] == ["identify.blind-instruments"]
    found = fit_instruments(replace(rows, matrix=still), instruments)
    assert dict(found.identifiability.refused) == {"b": why}
    assert found.fit.values[1] == 0.0
    assert not found.fit.notices
    with pytest.raises(IdentifiabilityError) as caught:
        fit_instruments(replace(rows, matrix=still), instruments, RankRule(least=0.75))
    assert {notice.code for notice in caught.value.notices} == {"identify.poor-log"}


def test_columns_in_proportion_are_refused_together_and_the_noise_of_one_is_no_news():
    rng = np.random.default_rng(7)
    rows, instruments = make_pair(rng)
    bound = instruments.matrix.copy()
    bound[:, 2] = 2.0 * bound[:, 0]
    noisy = bound + 1e-3 * rng.normal(size=bound.shape)
    tau = bound @ TRUTH
    found = fit_instruments(replace(rows, matrix=noisy, values=tau), replace(instruments, matrix=bound))
    assert [name for name, _ in found.identifiability.refused] == ["a", "c"]
    assert [notice.code for notice in found.fit.notices] == ["identify.blind-instruments"]
    assert found.fit.values[1] == pytest.approx(TRUTH[1], rel=1e-3)
    assert found.fit.values[0] + 2.0 * found.fit.values[2] == pytest.approx(3.0, rel=1e-3)
    both = fit_instruments(replace(rows, matrix=bound, values=tau), instruments)
    assert [name for name, _ in both.identifiability.refused] == ["a", "c"]
    assert both.fit.values[1] == pytest.approx(TRUTH[1], rel=1e-9)
    assert not both.fit.notices


def test_instruments_across_the_columns_are_none_and_weak_ones_are_said():
    rng = np.random.default_rng(8)
    rows, instruments = make_pair(rng)
    strange = instruments.matrix.copy()
    for part in (slice(0, COUNT), slice(COUNT, None)):
        y, other = rows.matrix[part], rng.normal(size=COUNT)
        strange[part, 0] = other - y @ np.linalg.lstsq(y, other, rcond=None)[0]
    with raises(IdentifiabilityError, "identify.blind-instruments"):
        fit_instruments(rows, replace(instruments, matrix=strange))
    rng = np.random.default_rng(6)
    rows, instruments = make_pair(rng, states=0.1)
    strange = instruments.matrix.copy()
    strange[:, 0] = rng.normal(size=2 * COUNT)
    found = fit_instruments(rows, replace(instruments, matrix=strange))
    assert [notice.code for notice in found.fit.notices] == ["identify.weak-instruments"]
    assert found.strength < 10.0
    # One column alone: c is the plain correlation without means.
    a, b = rows.matrix[:, 0] * found.fit.weights, strange[:, 0] * found.fit.weights
    assert found.correlation == pytest.approx(abs(a @ b) / np.linalg.norm(a) / np.linalg.norm(b), abs=0.05)
