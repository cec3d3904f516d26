"""Sums of rows and fits from them: against explicit rows and NumPy, exact weights, true covariances."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import firwin

from symid.identification.regression import (
    BandSums,
    CondensedLogs,
    condensing,
    fit_sums,
    mask_rest,
    mask_trembling,
    measure_scoring_band,
)
from symid.identification.regression.condensing import measure_left, measure_repetition, pick_pieces
from symid.identification.regression.equations import evaluate_columns
from symid.logs.recording import Recording
from symid.robot.description import Processing
from tests.unit.identification.rigid.two_link_logs import LIBRARY, record

RATE = 200.0
FOLD = np.arange(12) // 2


def build_sums(blocks, lives, width, worth=1.0):
    """Return sums of tables (rows, l + 1) of every joint and block, torque last."""
    products = tuple(np.stack([part.T @ part for part in parts])[:, None] for parts in blocks)
    counts = np.array([[len(part) for part in parts] for parts in blocks])[:, :, None]
    return BandSums(
        products=products,
        squares=products,
        counts=counts,
        worth=worth,
        live=tuple(np.array(live) for live in lives),
        width=width,
    )


def draw_blocks(rng, truth, noise, sizes):
    """Return rows [Y y] of blocks."""
    found = []
    for size in sizes:
        columns = rng.normal(size=(size, len(truth)))
        torque = columns @ truth + noise * rng.normal(size=size)
        found.append(np.column_stack([columns, torque]))
    return found


def solve(parts, chosen=slice(None)):
    rows = np.vstack([part for part, kept in zip(parts, chosen, strict=True) if kept])
    return np.linalg.lstsq(rows[:, :-1], rows[:, -1])[0]


def test_joints_with_parameters_of_their_own_get_their_own_variances():
    """Restricted maximum likelihood: |e|^2 over rows less parameters; folds are fits to the others."""
    rng, truths = np.random.default_rng(0), (np.array([1.0, -2.0]), np.array([0.5, 3.0, 1.0]))
    blocks = [
        draw_blocks(rng, truth, noise, [size] * 12)
        for truth, noise, size in zip(truths, (0.3, 4.0), (9, 4), strict=True)
    ]
    found = fit_sums(build_sums(blocks, ([0, 1], [2, 3, 4]), 5), [0, 0], FOLD)
    for joint, (parts, live) in enumerate(zip(blocks, (slice(0, 2), slice(2, 5)), strict=True)):
        rows = np.vstack(parts)
        values = solve(parts, [True] * 12)
        left = np.sum((rows[:, -1] - rows[:, :-1] @ values) ** 2)
        assert found.weights[joint] == pytest.approx((len(rows) - len(values)) / left, rel=1e-6)
        np.testing.assert_allclose(found.values[live], values, rtol=1e-7)
        for fold, held in enumerate(found.folds):
            np.testing.assert_allclose(held[live], solve(parts, fold != FOLD), rtol=1e-6)


@pytest.mark.parametrize(("each", "worth"), [(1, 1.0), (3, 1.0 / 3.0)])
def test_a_joint_with_as_many_rows_as_parameters_does_not_run_away(each, worth):
    """Its parameters explain its rows whatever the shared one is, which then is that of the other joint."""
    rng = np.random.default_rng(1)
    first = draw_blocks(rng, np.array([1.0, -2.0]), 0.3, [40] * 12)
    # Twelve parameters of its own, and the first one of joint 1; far off.
    second = draw_blocks(rng, np.array([-30.0, *np.ones(12)]), 5.0, [each] * 12)
    sums = build_sums([first, second], ([0, 1], [0, *range(2, 14)]), 14, worth)
    found = fit_sums(sums, [0, 0], FOLD)
    assert np.all(np.isfinite(found.weights))
    assert found.weights[1] < found.weights[0]
    np.testing.assert_allclose(found.values[:2], solve(first, [True] * 12), atol=0.01)


def test_stated_weights_and_chosen_blocks_are_used():
    rng, truth = np.random.default_rng(2), np.array([1.0, -2.0])
    blocks = [draw_blocks(rng, truth, noise, [8] * 12) for noise in (0.3, 2.0)]
    weights, chosen = np.array([1.0, 0.04]), FOLD < 3
    found = fit_sums(build_sums(blocks, ([0, 1], [0, 1]), 2), [0, 0], FOLD, chosen, weights)
    scaled = [np.vstack([a, b * 0.2]) for a, b in zip(*blocks, strict=True)]
    np.testing.assert_allclose(found.values, solve(scaled, chosen), rtol=1e-6)


@pytest.mark.parametrize("together", [0.0, 0.5])
def test_changes_are_the_covariance_of_least_squares(together):
    """White noise, and noise that is partly the same throughout a block."""
    rng, draws = np.random.default_rng(3), 400
    columns = rng.normal(size=(12, 25, 3)) + np.array([1.0, 0.0, 0.0])
    whole = np.einsum("bti,btj->ij", columns, columns)
    inner = whole + together**2 * np.einsum("bi,bj->ij", columns.sum(axis=1), columns.sum(axis=1))
    true = np.linalg.inv(whole) @ inner @ np.linalg.inv(whole)
    mean = np.zeros((3, 3))
    for _ in range(draws):
        noise = rng.normal(size=(12, 25)) + together * rng.normal(size=(12, 1))
        blocks = [np.column_stack([part, error]) for part, error in zip(columns, noise, strict=True)]
        changes = fit_sums(build_sums([blocks], ([0, 1, 2],), 3), [0], FOLD).changes
        mean += changes.T @ changes / draws
    scale = np.sqrt(np.outer(np.diag(true), np.diag(true)))
    np.testing.assert_allclose(mean / scale, true / scale, atol=0.1)


def build_logs(*seeds, **options):
    logs = [record(seed, encoder=1e-5, torque=0.5, **options) for seed in seeds]
    return CondensedLogs(LIBRARY, logs, Processing(automatic=True), (1.0, 2.0, 4.0, 8.0), 50.0)


def list_rows(piece, level, joint):
    columns = piece.pick(piece.matrices[level], joint, np.arange(len(LIBRARY.card.fitted)))
    return np.column_stack([columns, piece.torques[level][:, joint]])


@pytest.mark.parametrize("seeds", [(0,), (0, 1, 2)])
@pytest.mark.parametrize(("level", "smooth", "share"), [(3, 3, 0), (2, 2, 1), (3, 2, 1)])
def test_fits_without_a_fold_are_those_of_its_rows(seeds, level, smooth, share):
    """Each row of a piece, its block and its speed, through NumPy alone."""
    logs = build_logs(*seeds)
    sums = logs.sum_products([level], smooth)[0]
    found = fit_sums(sums, [share, share], logs.fold)
    left, right, fold, runs = [], [], [], []
    for piece, block, rest in zip(logs._pieces, logs._blocks, logs._rest, strict=True):
        stride = piece.strides[level]
        for joint in (0, 1):
            speed = np.abs(piece.states[1][::stride, joint])
            kept = (speed >= logs.limits[joint, share]) & ~rest[::stride, joint]
            root = np.sqrt(found.weights[joint])
            rows = list_rows(piece, level, joint)[kept] * root
            smooth_rows = evaluate_columns(LIBRARY, *piece.slow[smooth])[::stride, joint][kept] * root
            left.append(smooth_rows if smooth < level else rows[:, :-1])
            right.append(rows)
            fold.append(logs.fold[block[::stride][kept]])
            runs.append(np.full(kept.sum(), piece.run))
    left, right, fold, runs = map(np.concatenate, (left, right, fold, runs))
    assert len(found.folds) == 6
    if len(seeds) > 1:
        # Two stretches of each log.
        assert all(len(np.unique(runs[fold == place])) == 1 for place in range(6))

    def fit(kept):
        z, rows = left[kept], right[kept]
        return np.linalg.solve(z.T @ rows[:, :-1], z.T @ rows[:, -1])

    np.testing.assert_allclose(found.values, fit(fold >= 0), rtol=1e-5, atol=1e-6)
    for place, values in enumerate(found.folds):
        np.testing.assert_allclose(values, fit(fold != place), rtol=1e-5, atol=1e-6)


def test_losses_are_squares_of_rows_that_were_held_out():
    logs = build_logs(0)
    fit = fit_sums(logs.sum_products([3], 3)[0], [0, 0], logs.fold)
    losses, expected = logs.measure_losses(fit), np.zeros((len(logs.log), 2))
    (piece,), (block,), (rest,) = logs._pieces, logs._blocks, logs._rest
    for level in (1, 2):
        stride = piece.strides[level]
        for joint in (0, 1):
            kept = ~rest[::stride, joint]
            rows, own = list_rows(piece, level, joint)[kept], block[::stride][kept]
            for place, fold in enumerate(logs.fold):
                part = rows[own == place]
                errors = part[:, -1] - part[:, :-1] @ fit.folds[fold]
                expected[place, joint] += errors @ errors / (rows[:, -1] @ rows[:, -1])
    np.testing.assert_allclose(losses, expected, rtol=1e-6)
    whole = np.broadcast_to(fit.values, (len(logs.log), len(fit.values)))
    assert measure_left(logs.scores[1], whole).shape == (2, len(logs.log), 2)


def test_parameters_without_effect_stay_zero():
    rng = np.random.default_rng(4)
    parts = draw_blocks(rng, np.array([1.0, 2.0, 3.0]), 0.1, [20] * 12)
    for part in parts:
        part[:, 1] = 0.0
    found = fit_sums(build_sums([parts], ([0, 1, 2],), 3), [0], FOLD)
    assert np.all(found.folds[:, 1] == 0.0)
    np.testing.assert_allclose(
        found.values[[0, 2]], solve([p[:, [0, 2, 3]] for p in parts], [1] * 12), rtol=1e-6
    )


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
        # Behind two empty octaves nothing counts.
        ([[(1.0, 0.5), (0.004, 90.0)]], 1.0),
        # The median joint counts, one at rest does not.
        ([SLOW, SLOW, [(1.0, 9.0)]], 3.0),
        ([SLOW, [], [(1.0, 9.0)]], 10.5),
    ],
)
def test_the_scoring_band_holds_the_power_of_the_velocities(joints, expected):
    # Frequencies are a quarter of a hertz apart, and a sine spreads to the next one.
    assert measure_scoring_band([make_log(*joints)]) == pytest.approx(expected, abs=0.8)


def test_the_scoring_band_of_noisy_logs_of_several_and_of_velocities():
    clean, noisy = (measure_scoring_band([make_log([(1.0, 3.0)], noise=size)]) for size in (1e-6, 1e-2))
    assert clean == noisy == pytest.approx(6.0, abs=0.8)
    # Of several logs the median is taken.
    logs = [make_log([(1.0, f)], seed=place) for place, f in enumerate((2.0, 3.0, 8.0))]
    assert measure_scoring_band(logs) == measure_scoring_band(logs[1:2])
    # Positions with an error that logged velocities have not.
    log, smooth = make_log([(1.0, 1.5), (0.2, 6.0)]), make_log(SLOW, noise=0.0)
    with_rates = replace(log, velocity=np.gradient(smooth.position, 1.0 / RATE, axis=0))
    assert measure_scoring_band([with_rates]) == pytest.approx(3.0, abs=0.8)
    assert measure_scoring_band([log]) == pytest.approx(12.0, abs=0.8)
    # At rest the whole log is one period.
    assert measure_scoring_band([make_log([], [])]) == pytest.approx(1.0 / 20.0)


FIVE = [(0.6, 0.2), (0.3, 0.6), (0.1, 1.4)]


@pytest.mark.parametrize(
    ("joints", "noise", "expected"),
    [
        ([FIVE], 1e-5, 5.0),
        ([FIVE], 1e-3, 5.0),
        # Joints of different periods repeat together.
        ([[(0.5, 0.4)], [(0.5, 2.0 / 3.0)]], 1e-5, 7.5),
        # A sine with another of the golden ratio never does, and one that ends before it has been twice.
        ([[(0.5, 0.4), (0.3, 0.4 * 1.6180339887)]], 1e-5, 0.0),
        ([[(0.5, 0.4), (0.3, 1.0 / 12.0)]], 1e-5, 0.0),
        ([[]], 1e-5, 0.0),
    ],
)
def test_the_period_of_a_motion_that_repeats(joints, noise, expected):
    log = make_log(*joints, noise=noise)
    assert measure_repetition(log, measure_scoring_band([log])) == pytest.approx(expected, abs=0.05)


def test_rest_is_slow_for_some_time():
    rng = np.random.default_rng(5)
    speed = np.where(np.sin(np.arange(400) / 13.0) > 0.5, 1.0, 0.019) * np.where(
        rng.random(400) > 0.05, 1.0, 0.5
    )
    speed[50:52], speed[60:300] = 0.0, np.where(np.arange(240) < 200, -0.001, -2.0)
    found = mask_rest(speed, 1.0, 10)
    slow = np.abs(speed) <= 0.02
    expected = [
        any(slow[a : a + 10].all() for a in range(max(0, k - 9), min(k, 390) + 1)) and slow[k]
        for k in range(400)
    ]
    assert found.tolist() == expected
    assert 0 < found.sum() < slow.sum()
    assert not mask_rest(np.ones(5), 1.0, 2).any()
    assert mask_rest(np.zeros(5), 0.0, 2).all()
    assert mask_rest(speed, np.inf, 10).all()


def test_a_joint_that_trembles_beside_others_rests():
    time = 1e-2 * np.arange(1000)
    size = np.array([0.4, 0.009, 0.011, 0.001])
    log = Recording(time=time, position=np.sin(time)[:, None] * size, torque=np.ones((1000, 4)), source="log")
    units = ["rad", "rad", "rad", "m"]
    assert mask_trembling([log], units).tolist() == [False, False, False, False]
    faint = replace(log, position=log.position * [1.0, 0.8, 1.0, 1.0])
    assert mask_trembling([faint], units).tolist() == [False, True, False, False]
    # In another log it stands elsewhere; and none trembles where all move as little.
    assert not mask_trembling([faint, replace(log, position=5.0 + log.position)], units).any()
    assert not mask_trembling([replace(log, position=log.position / 40.0)], ["rad"] * 3 + ["m"]).any()


def test_of_long_logs_six_pieces_are_compared():
    time = 1e-2 * np.arange(30001)
    position = np.column_stack([np.sin(time), np.cos(time)])
    long = Recording(time=time, position=position, torque=position, source="long")
    short = replace(long, time=time[:5001], position=position[:5001], torque=position[:5001])
    pieces = pick_pieces([short, long])
    assert [run for run, _ in pieces] == [0, *[1] * 6]
    assert pieces[0][1] is short
    assert [len(piece.time) for _, piece in pieces[1:]] == [2000] * 6
    assert pieces[1][1].time[0] == 0.0
    assert pieces[-1][1].time[-1] == pytest.approx(300.0, abs=0.02)


@pytest.mark.parametrize("step", [1, 3, 10])
@pytest.mark.parametrize("band", [0.004, 0.05, 0.3, 0.46])
def test_rows_are_a_windowed_ideal_low_pass_at_their_places(band, step):
    values = np.random.default_rng(11).normal(size=(2500, 5))
    values[:, [0, 3]] = 0.0
    places = np.arange(200, 2300, step)
    half = round(2.0 / band)
    expected = values
    if band < 0.45:
        taps = firwin(2 * half + 1, 2.0 * band)
        padded = np.pad(values, ((half, half), (0, 0)), mode="reflect", reflect_type="odd")
        expected = np.column_stack([np.convolve(column, taps, mode="valid") for column in padded.T])
    found = condensing._filter_rows(values.__getitem__, len(values), band, places)
    np.testing.assert_allclose(found, expected[places], atol=1e-13)


@pytest.mark.parametrize("step", [1, 4])
@pytest.mark.parametrize("above", [1, 2, 3])
def test_lower_bands_come_from_rows_of_a_higher_one(step, above):
    """A sine is damped by what its own filter damps it, to 0.005 of its amplitude, at every frequency."""
    bands = [0.08 / step * 0.5**k for k in range(above, -1, -1)]
    time, inner = np.arange(6000), np.arange(2000 // step, 4000 // step)
    for frequency in np.array([0.0, 0.3, 0.9, 1.0, 1.1, 1.3, 1.8]) * bands[0]:
        values = np.cos(2.0 * np.pi * frequency * (time - 3000))[:, None]
        kept = [inner] * len(bands)
        found = condensing._filter_bands(values.__getitem__, 6000, bands, step, kept)
        for band, rows in zip(bands, found, strict=True):
            alone = condensing._filter_rows(values.__getitem__, 6000, band, inner * step)
            np.testing.assert_allclose(rows, alone, atol=0.005)


def test_a_band_that_rows_do_not_hold_is_taken_from_all_samples():
    values, places = np.random.default_rng(0).normal(size=(3000, 2)), np.arange(100, 500)
    found = condensing._filter_bands(values.__getitem__, 3000, [0.15, 0.3], 5, [places, places])
    for band, rows in zip((0.15, 0.3), found, strict=True):
        own = condensing._filter_rows(values.__getitem__, 3000, band, 5 * places)
        np.testing.assert_array_equal(rows, own)


def test_released_logs_keep_rows_of_the_scoring_band_alone():
    logs = build_logs(0)
    columns, losses = logs.columns, logs.measure_losses(fit_sums(logs.scores[1], [0, 0], logs.fold))
    logs.release()
    np.testing.assert_array_equal(logs.columns, columns)
    np.testing.assert_array_equal(logs.measure_losses(fit_sums(logs.scores[1], [0, 0], logs.fold)), losses)
    assert logs._pieces[0].matrices[3].size == 0
