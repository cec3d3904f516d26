"""Covariance of correlated residuals, against the true one and by coverage; noise as periods differ in it."""

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from symid.errors import UsageError
from symid.identification.estimators.least_squares import (
    compute_coloured_covariance,
    estimate_period_noise,
    measure_influence,
)
from symid.logs.recording import Recording
from symid.robot.description import Processing
from tests.refusals import raises
from tests.unit.identification.row_tables import make_rows

COUNT, STEP = 1000, 0.02
TRUTH = np.array([2.0, -1.0, 0.5])
SCATTER = 0.3


def build_columns(count=COUNT):
    """Return two joints' columns (2, count, 3): a slow motion, its rate of change, and a constant."""
    time = STEP * np.arange(count)
    slow = 2.0 * np.pi * np.array([0.31, 0.53])
    first = [np.sin(w * time) + 0.3 * np.cos(2.3 * w * time) for w in slow]
    second = [np.gradient(column, STEP) for column in first]
    return np.stack([np.column_stack([a, b, np.ones(count)]) for a, b in zip(first, second, strict=True)])


def place_rows(columns, kept=None):
    """Return rows of all joints, one after the other, without values; `kept` (joints, count) of them."""
    joints, count, width = columns.shape
    kept = np.ones((joints, count), dtype=bool) if kept is None else kept
    group, place = np.nonzero(kept)
    return columns[kept].reshape(-1, width), group, STEP * place


def fit(rows, weights=None):
    """Return the least-squares values and their covariance for coloured residuals."""
    weights = np.ones(len(rows.values)) if weights is None else weights
    values = np.linalg.lstsq(rows.matrix * weights[:, None], rows.values * weights)[0]
    influence = measure_influence(rows, np.eye(3), weights, rows.values - rows.matrix @ values)
    return values, compute_coloured_covariance(rows, influence)


def fit_many(columns, draw, seeds, kept=None, weights=None):
    """Return values (seeds, 3) and covariances (seeds, 3, 3) of fits to logs that differ in their noise."""
    matrix, group, time = place_rows(columns, kept)
    found = []
    for seed in range(seeds):
        noise = draw(np.random.default_rng(seed))
        noise = noise.ravel() if kept is None else noise[kept]
        found.append(fit(make_rows(matrix, matrix @ TRUTH + noise, group, time=time), weights))
    return tuple(np.array(part) for part in zip(*found, strict=True))


def find_exact(matrix, noise, weights=1.0):
    """Return the covariance of least squares for the covariance `noise` (m, m) of the rows."""
    scaled = matrix * np.reshape(weights, (-1, 1))
    left = np.linalg.solve(scaled.T @ scaled, (scaled * np.reshape(weights, (-1, 1))).T)
    return left @ noise @ left.T


def draw_ar(rng, memory, shape, scatter=SCATTER):
    """Return noise e[k] = memory e[k-1] + w[k] (joints, count), from its stationary distribution."""
    white = scatter * rng.normal(size=shape)
    white[:, 0] /= np.sqrt(1.0 - memory**2)
    return lfilter([1.0], [1.0, -memory], white, axis=1)


def compute_ar(memory, count, scatter=SCATTER):
    return scatter**2 / (1.0 - memory**2) * toeplitz(memory ** np.arange(count))


@pytest.mark.parametrize("memory", [0.8, 0.0, -0.6])
def test_noise_with_a_memory_has_its_own(memory):
    columns = build_columns()
    matrix, *_ = place_rows(columns)
    values, covariances = fit_many(columns, lambda rng: draw_ar(rng, memory, (2, COUNT)), 120)
    exact = np.diag(find_exact(matrix, np.kron(np.eye(2), compute_ar(memory, COUNT))))
    np.testing.assert_allclose(covariances.mean(axis=0).diagonal(), exact, rtol=0.08)
    # As the estimates scatter, which 120 of them show to within an eighth of a variance.
    np.testing.assert_allclose(values.var(axis=0), exact, rtol=0.4)
    usual = SCATTER**2 / (1.0 - memory**2) * np.diag(np.linalg.inv(matrix.T @ matrix))
    # Most power of the columns is at low frequencies.
    ratio = exact / usual
    least, most = {0.8: (3.0, np.inf), 0.0: (1.0 - 1e-9, 1.0 + 1e-9), -0.6: (0.0, 0.4)}[memory]
    assert np.all((ratio > least) & (ratio < most))


def test_noise_that_two_joints_share_counts_across_them():
    columns = build_columns()
    columns[1] = columns[0]
    matrix, *_ = place_rows(columns)
    mixed = np.array([[1.0, 0.9], [0.9, 1.0]])
    for sign in (1.0, -1.0):
        shared = mixed * np.array([[1.0, sign], [sign, 1.0]])
        root = np.linalg.cholesky(shared)
        _, covariances = fit_many(columns, lambda rng, root=root: root @ draw_ar(rng, 0.5, (2, COUNT)), 100)
        exact = np.diag(find_exact(matrix, np.kron(shared, compute_ar(0.5, COUNT))))
        found = covariances.mean(axis=0).diagonal()
        # What the fit takes from the sum of both joints is more than it takes from each of them.
        np.testing.assert_allclose(found, exact, rtol=0.1)
        apart = np.diag(find_exact(matrix, np.kron(np.eye(2), compute_ar(0.5, COUNT))))
        np.testing.assert_allclose(exact / apart, 1.0 + 0.9 * sign, rtol=1e-9)


def test_weights_of_joints_act_as_in_weighted_least_squares():
    columns = build_columns()
    matrix, group, _ = place_rows(columns)
    sizes = np.array([[1.0], [5.0]])
    weights = 1.0 / sizes[group, 0]
    _, covariances = fit_many(
        columns, lambda rng: sizes * draw_ar(rng, 0.6, (2, COUNT)), 100, weights=weights
    )
    exact = find_exact(matrix, np.kron(np.diag(sizes[:, 0] ** 2), compute_ar(0.6, COUNT)), weights)
    np.testing.assert_allclose(covariances.mean(axis=0).diagonal(), np.diag(exact), rtol=0.08)


@pytest.mark.parametrize("chance", [False, True])
def test_rows_left_out_leave_holes_in_time_and_nothing_else(chance):
    """Slow rows of either joint are missing, or any: the noise of those that stay remembers as before."""
    columns = build_columns()
    kept = np.abs(columns[:, :, 1]) > 0.3 * np.abs(columns[:, :, 1]).max(axis=1, keepdims=True)
    if chance:
        kept = np.random.default_rng(0).random((2, COUNT)) > 0.3
    assert 0.15 < 1.0 - kept.mean() < 0.5
    matrix, *_ = place_rows(columns, kept)
    places = np.flatnonzero(kept)
    noise = np.kron(np.eye(2), compute_ar(0.8, COUNT))[np.ix_(places, places)]
    _, covariances = fit_many(columns, lambda rng: draw_ar(rng, 0.8, (2, COUNT)), 100, kept)
    exact = np.diag(find_exact(matrix, noise))
    np.testing.assert_allclose(covariances.mean(axis=0).diagonal(), exact, rtol=0.1)


def test_logs_are_independent_of_each_other():
    """Of two logs, each has its own place in time: the covariance is that of the sum of their scores."""
    columns = build_columns(300)
    matrix, group, time = place_rows(columns)
    rng = np.random.default_rng(4)
    tables = [matrix, matrix * np.array([1.3, 0.8, 1.0])]
    noise = [draw_ar(rng, 0.7, (2, 300)).ravel() for _ in tables]
    rows = make_rows(
        np.vstack(tables),
        np.vstack(tables) @ TRUTH + np.concatenate(noise),
        np.tile(group, 2),
        time=np.concatenate([time, time + 77.7]),
        run=np.repeat([0, 1], len(group)),
    )
    values, covariance = fit(rows)
    left = rows.values - rows.matrix @ values
    influence = measure_influence(rows, np.eye(3), np.ones(len(left)), left)
    total = np.zeros((3, 3))
    for run in (0, 1):
        own = rows.run == run
        part = make_rows(rows.matrix[own], rows.values[own], rows.group[own], time=rows.time[own])
        # A left factor of one: the spectrum of this log's scores alone.
        parts = {name: getattr(influence, name)[own] for name in ("scores", "frame", "residuals")}
        alone = type(influence)(left=np.eye(3), **parts)
        total += compute_coloured_covariance(part, alone)
    np.testing.assert_allclose(covariance, influence.left @ total @ influence.left.T, rtol=1e-9)


def test_few_rows_in_bursts_never_have_a_negative_variance():
    columns = build_columns()
    fast = np.abs(columns[:, :, 1])
    kept = fast > 0.9 * fast.max(axis=1, keepdims=True)
    assert kept.mean() < 0.15
    _, covariances = fit_many(columns, lambda rng: draw_ar(rng, -0.8, (2, COUNT)), 20, kept)
    assert np.all(np.linalg.eigvalsh(covariances) > 0.0)


@pytest.mark.parametrize("memory", [0.0, 0.7])
def test_intervals_of_95_percent_hold_the_truth_as_often(memory):
    columns = build_columns()
    values, covariances = fit_many(columns, lambda rng: draw_ar(rng, memory, (2, COUNT)), 200)
    scores = (values - TRUTH) / np.sqrt(covariances.diagonal(axis1=1, axis2=2))
    held = np.abs(scores) <= 1.96
    assert 0.92 < held.mean() < 0.98
    assert np.all((held.mean(axis=0) > 0.9) & (held.mean(axis=0) < 0.99))


SHARED = np.array([[0.04, 0.018], [0.018, 0.01]])
PLAIN = Processing()


def build(period=2.0, count=10, step=1e-3, seed=0):
    time = step * np.arange(round(count * period / step) + 1)
    angle = 2.0 * np.pi * time / period
    motion = np.column_stack([3.0 * np.sin(angle), np.cos(2.0 * angle) + 0.5 * np.sin(3.0 * angle)])
    noise = np.random.default_rng(seed).normal(size=(len(time), 2)) @ np.linalg.cholesky(SHARED).T
    return Recording(time=time, position=motion, torque=motion + noise, source="made")


def test_the_covariance_comes_back():
    found = estimate_period_noise([build(), build(seed=1)], PLAIN, [2.0])
    np.testing.assert_allclose(found, SHARED, rtol=0.05)
    # Each log may have its own period, and periods be no whole number of samples.
    logs = [build(), build(period=1.7321, seed=1)]
    found = estimate_period_noise(logs, PLAIN, [2.0, 1.7321])
    # Interpolation between samples averages noise: at most a half of its variance is lost.
    assert np.all(np.diag(found) < 1.05 * np.diag(SHARED))
    assert np.all(np.diag(found) > 0.6 * np.diag(SHARED))


@pytest.mark.parametrize(
    ("periods", "message"),
    [([15.0], "15 s fit into the"), ([2.0, 2.0], "2 periods for 1 logs"), ([1.31], "does not repeat")],
)
def test_what_tells_no_noise_is_refused(periods, message):
    with raises(UsageError, "usage.period", match=message):
        estimate_period_noise([build()], PLAIN, periods)
