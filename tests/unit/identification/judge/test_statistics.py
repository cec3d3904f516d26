"""The two statistics against SciPy's tests, exact distributions, and draws of linear models."""

import numpy as np
import pytest
from scipy.stats import kstest, ttest_1samp

from symid.identification.judge import (
    POLICY,
    Agreement,
    adjust_chances,
    agree,
    agree_in_value,
    compare,
    compute_chance,
    compute_changes,
    compute_variance,
    measure_inferiority,
)


def draw_losses(seed, better=1.0):
    """Return losses (24, 2) of two candidates, one `better` at joint 2; joint 1 rests in four parts."""
    rng = np.random.default_rng(seed)
    before = 0.01 * rng.chisquare(5.0, size=(24, 2))
    after = before * np.exp(0.3 * rng.normal(size=before.shape)) * [1.0, better]
    before[3:7, 0] = after[3:7, 0] = np.nan
    return before, after


@pytest.mark.parametrize("better", [1.0, 0.8])
def test_a_comparison_is_student_s_test_of_floored_ratios(better):
    before, after = draw_losses(1, better)
    found = compare(before, after)
    tables = [*zip(before.T, after.T, strict=True), (np.nansum(before, axis=1), np.nansum(after, axis=1))]
    chances = [*found.p, found.p_of_all]
    falls = [*found.fall, found.fall_of_all]
    for (one, other), p, fall in zip(tables, chances, falls, strict=True):
        floor = 0.02 * (np.nansum(one) + np.nansum(other)) / 48
        ratios = np.log((one + floor) / (other + floor))
        expected = ttest_1samp(ratios[np.isfinite(ratios)], 0.0, alternative="greater").pvalue
        assert p == pytest.approx(expected, rel=1e-9)
        assert fall == pytest.approx(np.nansum(one) / np.nansum(other))
    assert (found.p[1] < 0.01) == (better < 1.0)


def test_what_rests_says_nothing_and_tiny_losses_do_not_decide():
    before, after = draw_losses(2)
    still = np.full((24, 1), np.nan)
    more = compare(np.hstack([before, still]), np.hstack([after, still]))
    assert (more.fall[2], more.p[2]) == (1.0, 1.0)
    assert more.p_of_all == compare(before, after).p_of_all
    none = compare(np.zeros((24, 1)), np.zeros((24, 1)))
    assert (none.fall_of_all, none.p_of_all) == (1.0, 1.0)
    # Of parts far below the mean, a thousandfold fall is as good as none.
    one = np.where(np.arange(24)[:, None] < 12, 1e-6, 1.0)
    other = np.where(one < 1.0, 1e-9, np.exp(0.3 * (-1.0) ** np.arange(24)[:, None]))
    assert compare(one, other).p_of_all > 0.1
    assert ttest_1samp(np.log(one / other)[:, 0], 0.0, alternative="greater").pvalue < 1e-3
    assert compare(before, 0.0 * before).fall_of_all == np.inf


def test_chances_of_few_and_of_equal_values():
    assert compute_chance(np.array([3.0])) == 1.0
    assert compute_chance(np.full(5, 2.0)) == 0.0
    assert compute_chance(np.full(5, -2.0)) == 1.0
    values = np.random.default_rng(3).normal(0.3, 1.0, size=12)
    expected = ttest_1samp(values, 0.0, alternative="greater").pvalue
    assert compute_chance(values) == pytest.approx(expected, rel=1e-9)


def test_chances_of_a_family_are_those_of_holm():
    """Numbers of statsmodels' multipletests, and Holm's rule for equal ones."""
    assert adjust_chances([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert adjust_chances([0.5, 0.5]) == [1.0, 1.0]
    assert adjust_chances([]) == []


def test_candidates_that_predict_alike_count_once_among_rivals():
    """The level holds for any dependence: two candidates have a test of signs, copies of one add nothing."""
    rng = np.random.default_rng(3)
    base = rng.uniform(0.5, 2.0, 24) * np.exp(0.2 * rng.normal(size=(300, 2, 24)))
    pairs = np.array([measure_inferiority(losses) for losses in base])
    # One of the two is ahead: its chance is 1 less that of the other one.
    assert pairs.sum(axis=1) == pytest.approx(1.0, abs=0.01)
    assert kstest(pairs[:, 0], "uniform").pvalue > 0.01
    copied = [measure_inferiority(losses[[0, *[1] * 28]])[0] for losses in base]
    assert copied == pytest.approx(pairs[:, 0].tolist(), abs=0.01)
    # Rivals of their own cost power: with 28 of them none is surpassed more often than the level says.
    many = rng.uniform(0.5, 2.0, 24) * np.exp(0.2 * rng.normal(size=(300, 29, 24)))
    found = np.array([measure_inferiority(losses)[0] for losses in many])
    assert 0.05 < np.mean(found < POLICY.caution) < 0.15
    assert measure_inferiority(np.ones((3, 1))).tolist() == [1.0, 1.0, 1.0]


def test_changes_are_the_jackknife_of_quenouille():
    sample = np.random.default_rng(3).normal(size=(40, 2))
    without = (sample.sum(axis=0) - sample) / 39
    changes = compute_changes(without)
    # Of a mean it is the usual covariance, S / n.
    np.testing.assert_allclose(changes.T @ changes, np.cov(sample.T) / 40, rtol=1e-9)


BLOCKS, EACH = 15, 40


def draw_halves(rng, true):
    """Return difference and changes of two fits of a linear model with three parameters, and X'X of one."""
    values, changes, grams = [], [], []
    for part in (np.zeros(3), true):
        columns = rng.normal(size=(BLOCKS, EACH, 3)) * [1.0, 3.0, 0.2]
        torque = columns @ part + rng.normal(size=(BLOCKS, EACH))
        tables = np.swapaxes(columns, 1, 2) @ columns
        rights = (np.swapaxes(columns, 1, 2) @ torque[..., None])[..., 0]
        values.append(np.linalg.solve(tables.sum(axis=0), rights.sum(axis=0)))
        left = np.linalg.solve(tables.sum(axis=0) - tables, (rights.sum(axis=0) - rights)[..., None])
        changes.append(compute_changes(left[..., 0]))
        grams.append(tables.sum(axis=0))
    return values[1] - values[0], np.vstack([-changes[0], changes[1]]), grams[0]


def compare_halves(seed, true, size=1e3):
    difference, changes, gram = draw_halves(np.random.default_rng(seed), np.array(true))
    (found,) = agree(difference, changes, gram[None], np.array([size]))
    return found, np.sqrt(np.array(true) @ gram @ true / size)


@pytest.mark.parametrize(("blocks", "uneven"), [(6, 0.0), (24, 0.0), (24, 0.5)])
def test_normal_intervals_from_few_blocks_hold_as_they_say(blocks, uneven):
    rng = np.random.default_rng(3)
    sizes = np.exp(uneven * rng.standard_normal((20000, blocks)))
    changes = (sizes * rng.standard_normal((20000, blocks))).T
    variance = compute_variance(changes)
    error = np.sum(sizes * rng.standard_normal((20000, blocks)), axis=1)
    assert np.mean(np.abs(error) < 1.96 * np.sqrt(variance)) == pytest.approx(0.95, abs=0.02)
    assert np.all(variance >= np.sum(changes**2, axis=0))


def test_equal_halves_differ_by_chance_alone():
    chances = [compare_halves(seed, (0.0, 0.0, 0.0))[0].p for seed in range(400)]
    assert kstest(chances, "uniform").pvalue > 0.001
    assert np.mean(np.array(chances) < 0.1) == pytest.approx(0.1, abs=0.05)


def test_what_differs_is_found_and_its_bound_holds():
    # Four deviations of the second parameter.
    true = (0.0, 4.0 * np.sqrt(2.0) / np.sqrt(9.0 * BLOCKS * EACH), 0.0)
    found = [compare_halves(seed, true) for seed in range(200)]
    assert np.mean([entry.p < 0.05 for entry, _ in found]) > 0.85
    assert np.mean([entry.bound > size for entry, size in found]) > 0.9
    assert np.median([entry.size / size for entry, size in found]) == pytest.approx(1.0, abs=0.15)


def test_same_needs_a_small_bound_and_different_a_large_difference():
    # The torque of the third parameter: one percent of it, or twenty; and noise as large as the torque.
    for true, size, verdict in (
        ((0.0, 0.0, 0.0), 1e6, Agreement.SAME),
        ((0.0, 1.0, 0.0), 1e5, Agreement.DIFFERENT),
        ((0.0, 0.0, 0.0), 1e2, Agreement.OPEN),
        # Sure, but too small to matter.
        ((0.0, 1.0, 0.0), 1e9, Agreement.SAME),
    ):
        found, _ = compare_halves(7, true, size)
        assert found.verdict is verdict
        assert found.size <= found.bound
    (still,) = agree(np.ones(3), np.ones((4, 3)), np.eye(3)[None], np.zeros(1))
    assert (still.size, still.bound, still.p) == (0.0, 0.0, 1.0)
    # Without noise what differs is sure.
    (exact,) = agree(np.array([0.3]), np.zeros((4, 1)), np.ones((1, 1, 1)), np.ones(1))
    assert (exact.size, exact.p, exact.verdict) == (pytest.approx(0.3), 0.0, Agreement.DIFFERENT)
    assert POLICY.relevance == 0.02


@pytest.mark.parametrize("shift", [0.0, 0.04, 0.1])
def test_of_one_parameter_and_many_blocks_it_is_the_exact_test(shift):
    sample = np.random.default_rng(5).normal(shift, 1.0, size=2000)
    changes = compute_changes((sample.sum() - sample) / 1999)
    found = agree_in_value(sample.mean(), changes, 1.0)
    assert found.p == pytest.approx(ttest_1samp(sample, 0.0).pvalue, rel=0.02)
    excess = max(0.0, sample.mean() ** 2 - sample.var(ddof=1) / 2000)
    assert found.size == pytest.approx(np.sqrt(excess), rel=1e-9)
