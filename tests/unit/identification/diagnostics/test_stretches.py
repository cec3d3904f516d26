"""Fits without each stretch, gains of columns, the scoring band, choices by losses: against explicit ones."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import ttest_rel

from symid.identification.diagnostics import choose_held_out, measure_behind
from symid.identification.diagnostics.stretches import (
    compute_jackknife,
    cut_stretches,
    fit_stretches,
    measure_gain,
    measure_scoring_band,
)
from symid.logs.recording import Recording
from tests.unit.identification.row_tables import make_rows

COUNT = 240
TRUTH = np.array([2.0, -1.0, 0.5, 3.0])
WEIGHTS = np.array([1.0, 0.3])
RATE = 200.0


def draw_rows(seed, logs=1):
    """Return rows of two joints and of one log or several, and instruments that resemble them."""
    rng = np.random.default_rng(seed)
    size = 2 * COUNT * logs
    smooth = rng.normal(size=(size, 4)) * np.array([1.0, 10.0, 0.1, 1.0])
    matrix = smooth + 0.2 * rng.normal(size=smooth.shape) * np.array([1.0, 10.0, 0.1, 1.0])
    rows = make_rows(
        matrix,
        matrix @ TRUTH + rng.normal(size=size),
        np.tile(np.repeat([0, 1], COUNT), logs),
        time=np.tile(np.arange(COUNT) / RATE, 2 * logs) + 3.0,
        velocity=rng.normal(size=size),
        run=np.repeat(np.arange(logs), 2 * COUNT),
        weight=np.repeat(1.0 + np.arange(logs), 2 * COUNT),
    )
    return rows, replace(rows, matrix=smooth), rng.random(size) > 0.2


def solve(rows, left, chosen):
    """Return the parameters that solve Z'W A x = Z'W y of the chosen rows."""
    w = (WEIGHTS[rows.group] * rows.weight)[chosen]
    if left is rows.matrix:
        root = np.sqrt(w)
        return np.linalg.lstsq(rows.matrix[chosen] * root[:, None], rows.values[chosen] * root)[0]
    z = left[chosen] * w[:, None]
    return np.linalg.solve(z.T @ rows.matrix[chosen], z.T @ rows.values[chosen])


@pytest.mark.parametrize("with_instruments", [False, True])
@pytest.mark.parametrize("logs", [1, 3])
def test_each_stretch_is_predicted_by_the_others(logs, with_instruments):
    rows, instruments, kept = draw_rows(logs, logs)
    left = instruments.matrix if with_instruments else rows.matrix
    found = fit_stretches(rows, instruments if with_instruments else None, kept, WEIGHTS)
    assert len(found.folds) == 6
    assert found.logs.tolist() == ([0] * 6 if logs == 1 else [0, 0, 1, 1, 2, 2])
    for stretch, values in enumerate(found.folds):
        np.testing.assert_allclose(values, solve(rows, left, kept & (found.stretch != stretch)), rtol=1e-8)
    assert len(found.logwise) == (0 if logs == 1 else 3)
    for log, values in enumerate(found.logwise):
        np.testing.assert_allclose(values, solve(rows, left, kept & (rows.run != log)), rtol=1e-8)
    # Of several logs a row is predicted by the other logs, also where the fit left it out.
    expected = np.empty(len(rows.values))
    for place, fold in enumerate(found.stretch):
        values = found.folds[fold] if logs == 1 else found.logwise[rows.run[place]]
        expected[place] = rows.matrix[place] @ values
    np.testing.assert_allclose(found.predict(rows), expected, rtol=1e-12)


@pytest.mark.parametrize(("size", "logs"), [(0.0, 0), (1e-4, 0), (0.05, 3)])
def test_logs_are_held_out_only_where_the_others_move_what_they_move(size, logs):
    # Parameter c acts in the first log, and so much in the others.
    rows, _, kept = draw_rows(7, 3)
    matrix = rows.matrix.copy()
    matrix[rows.run > 0, 2] *= size
    rows = replace(rows, matrix=matrix, values=matrix @ TRUTH)
    found = fit_stretches(rows, None, kept, WEIGHTS)
    assert len(found.logwise) == logs
    np.testing.assert_allclose(found.predict(rows), rows.values, rtol=1e-6, atol=1e-5)


def test_stretches_are_equal_parts_of_the_time_of_each_log():
    rows, *_ = draw_rows(0, 2)
    stretch, logs = cut_stretches(rows)
    assert logs.tolist() == [0, 0, 0, 1, 1, 1]
    for fold, log in enumerate(logs):
        own = stretch == fold
        assert set(rows.run[own]) == {log}
        assert np.bincount(rows.group[own]).tolist() == [COUNT // 3] * 2
        assert np.ptp(rows.time[own]) == pytest.approx((COUNT / 3 - 1) / RATE)


def test_parameters_without_effect_stay_zero():
    rows, _, kept = draw_rows(1)
    matrix = rows.matrix.copy()
    matrix[:, 2] = 0.0
    found = fit_stretches(replace(rows, matrix=matrix), None, kept, WEIGHTS)
    assert np.all(found.folds[:, 2] == 0.0)
    others = replace(rows, matrix=matrix[:, [0, 1, 3]], names=rows.names[:3], units=rows.units[:3])
    np.testing.assert_allclose(
        found.folds[:, [0, 1, 3]], fit_stretches(others, None, kept, WEIGHTS).folds, rtol=1e-8
    )


@pytest.mark.parametrize("strength", [0.0, 0.8])
def test_the_gain_is_that_of_a_refit_with_all_parameters(strength):
    """The oracle: the columns appended, zero for the other joint, fitted without each stretch."""
    rows, _, kept = draw_rows(5)
    rng = np.random.default_rng(6)
    own = np.flatnonzero(rows.group == 1)
    right = rng.normal(size=(len(own), 2)) + 0.3 * rows.matrix[own, :2]
    values = rows.values.copy()
    values[own] += strength * right[:, 0]
    rows = replace(rows, values=values)
    stretches = fit_stretches(rows, None, kept, WEIGHTS)
    gain, errors = measure_gain(stretches, rows, own, right)

    wide = np.zeros((len(values), 6))
    wide[:, :4], wide[own, 4:] = rows.matrix, right
    larger = replace(rows, matrix=wide, names=tuple("abcdef"), units=("1",) * 6)
    before, after = [], []
    for stretch in range(6):
        fitted, held = kept & (stretches.stretch != stretch), own[stretches.stretch[own] == stretch]
        for some, squares in ((rows, before), (larger, after)):
            squares.append(np.sum((rows.values - some.matrix @ solve(some, some.matrix, fitted))[held] ** 2))
    gains = np.array(before) - np.array(after)
    assert gain == pytest.approx(gains.sum() / sum(before), rel=1e-6)
    ratios = np.log(np.array(before) / np.array(after))
    assert errors == pytest.approx(ratios.mean() / ratios.std(ddof=1) * np.sqrt(6), rel=1e-6)
    # A term that is there is seen, one that is not costs a little.
    assert gain > 0.2 if strength else -0.05 < gain < 0.01
    assert errors > 4.0 if strength else errors < 1.0


def test_the_jackknife_is_that_of_quenouille():
    folds = np.random.default_rng(2).normal(size=(6, 3))
    expected = 5 / 6 * sum((fold - sum(folds) / 6) ** 2 for fold in folds)
    np.testing.assert_allclose(compute_jackknife(folds), expected, rtol=1e-12)
    # Of a mean of s values it is the usual variance, s^2 / n.
    sample = np.random.default_rng(3).normal(size=40)
    without = (sample.sum() - sample[:, None]) / 39
    assert compute_jackknife(without)[0] == pytest.approx(sample.var(ddof=1) / 40, rel=1e-9)


def make_log(*joints, noise=1e-5, seconds=20.0, seed=0):
    """Return a log of joints that move by the sum of sines (amplitude in rad, frequency in Hz)."""
    time = np.arange(round(seconds * RATE)) / RATE
    columns = [
        sum((size * np.sin(2.0 * np.pi * f * time + f) for size, f in sines), np.zeros(len(time)))
        for sines in joints
    ]
    position = np.column_stack(columns)
    position = position + noise * np.random.default_rng(seed).normal(size=position.shape)
    return Recording(time=time, position=position, torque=np.zeros_like(position), source="made")


SLOW = [(1.0, 1.5)]


@pytest.mark.parametrize(
    ("joints", "expected"),
    [
        ([SLOW], 3.0),
        # The second sine has 36 percent of the power of the velocity, or 0.2.
        ([[(1.0, 1.5), (0.15, 6.0)]], 12.0),
        ([[(1.0, 1.5), (0.01, 6.0)]], 3.0),
        # The median joint counts, one at rest does not.
        ([SLOW, SLOW, [(1.0, 9.0)]], 3.0),
        ([SLOW, [], [(1.0, 9.0)]], 10.5),
        ([[(1.0, 0.3)]], 2.5),
        ([[], []], 2.5),
    ],
)
def test_the_scoring_band_holds_the_power_of_the_velocities(joints, expected):
    # Frequencies are a quarter of a hertz apart, and a sine spreads to the next one.
    assert measure_scoring_band([make_log(*joints)]) == pytest.approx(expected, abs=0.8)


def test_the_scoring_band_of_noisy_logs_and_of_several():
    clean, noisy = (measure_scoring_band([make_log([(1.0, 3.0)], noise=size)]) for size in (1e-6, 1e-2))
    assert clean == noisy == pytest.approx(6.0, abs=0.8)
    # Of several logs the median is taken.
    logs = [make_log([(1.0, f)], seed=place) for place, f in enumerate((2.0, 3.0, 8.0))]
    assert measure_scoring_band(logs) == measure_scoring_band(logs[1:2])


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
