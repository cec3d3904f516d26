"""Filters against closed forms: no phase, known gain, the kept samples, exact derivatives."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.signal import butter, cheby1, detrend, sosfilt, sosfiltfilt, welch

from symid.errors import LogError
from symid.logs.recording import Recording
from symid.logs.signals import (
    SignalParts,
    choose_processing,
    choose_thinning,
    compute_least_samples,
    compute_noise_bandwidth,
    decimate,
    decimate_blocks,
    differentiate,
    estimate_density,
    low_pass,
    prepare_signals,
    take_line_off,
)
from symid.robot.description import Decimation, Processing
from tests.refusals import raises

T = 1e-3
TIMES = np.arange(4000) * T


@given(
    order=st.integers(1, 16),
    cutoff=st.floats(1e-3, 0.9),
    level=st.floats(-9.0, 9.0),
    part=st.floats(0.05, 1.2),
)
def test_the_low_pass_keeps_level_and_amplitude_at_any_order_and_cutoff(order, cutoff, level, part):
    """Cut-offs as parts of half the sample rate; the gain at part w of the cut-off is 1/(1 + r^2n)."""
    samples = min(200_000, round(2000 + 400 * order / cutoff))
    middle = slice(2 * samples // 5, 3 * samples // 5)
    constant = low_pass(np.full(samples, level), period=0.5, cutoff=cutoff, order=order)
    np.testing.assert_allclose(constant, level, atol=1e-6)
    omega = np.pi * min(part * cutoff, 0.95)
    ratio = np.tan(omega / 2) / np.tan(np.pi * cutoff / 2)
    wave = np.sin(omega * np.arange(samples))
    smooth = low_pass(wave, period=0.5, cutoff=cutoff, order=order)
    np.testing.assert_allclose(smooth[middle], wave[middle] / (1 + ratio ** (2 * order)), atol=1e-3)


@settings(max_examples=40)
@given(
    order=st.integers(1, 16),
    factor=st.integers(2, 1000),
    band=st.floats(0.1, 0.95),
    ripple=st.floats(0.01, 3),
)
def test_decimation_keeps_slow_signals_within_the_ripple_at_any_order_and_factor(order, factor, band, ripple):
    decimation = Decimation(factor=factor, order=order, band=band, ripple_db=ripple)
    kept = decimate(np.ones(40 * factor + 3 * order), decimation)
    least = 10 ** (-ripple / 10)
    assert least - 1e-6 < kept.min()
    assert kept.max() < 1 + 1e-6
    times = np.arange(min(60 * factor, 60_000) * 5)
    wave = decimate(np.sin(0.5 * np.pi * band / factor * times), decimation)
    middle = np.abs(wave[len(wave) // 3 : 2 * len(wave) // 3])
    # The filter still rings a little from the ends.
    assert middle.max() < 1.05
    noise_band = compute_noise_bandwidth(Processing(decimation=decimation), 1e-3)
    assert 0.0 < noise_band <= 1.0


@settings(max_examples=60)
@given(
    order=st.integers(1, 8),
    edge=st.floats(0.01, 0.95),
    beyond=st.integers(1, 3000),
    shape=st.sampled_from([(), (1,), (7,), (2, 9)]),
    seed=st.integers(0, 1000),
)
def test_the_low_pass_is_that_of_scipy(order, edge, beyond, shape, seed):
    values = np.random.default_rng(seed).normal(size=(3 * order + beyond, *shape)).cumsum(axis=0)
    expected = sosfiltfilt(butter(order, edge, output="sos"), values, axis=0, padtype="odd", padlen=3 * order)
    found = low_pass(values, period=0.5, cutoff=edge, order=order)
    # Rounding of SciPy's recursion grows with the memory of the filter.
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(values).max())


@given(
    samples=st.integers(3, 400),
    length=st.integers(3, 120),
    columns=st.integers(1, 3),
    rate=st.floats(1.0, 1e4),
    seed=st.integers(0, 1000),
)
def test_densities_are_those_of_scipy(samples, length, columns, rate, seed):
    values = np.random.default_rng(seed).normal(size=(samples, columns)).cumsum(axis=0)
    length = min(samples, length)
    found = estimate_density(values, rate, length)
    expected = welch(values, fs=rate, nperseg=length, detrend="linear", axis=0)
    np.testing.assert_allclose(found[0], expected[0], rtol=1e-12)
    np.testing.assert_allclose(found[1], expected[1], atol=1e-10 * np.abs(expected[1]).max() + 1e-25)
    np.testing.assert_allclose(take_line_off(values), detrend(values, axis=0), atol=1e-10)


def decimate_by_scipy(values, decimation):
    """Every sample through SciPy's filter, then one in r, counted from the last one."""
    edge = decimation.band / decimation.factor
    sections = cheby1(decimation.order, decimation.ripple_db, edge, output="sos")
    smooth = sosfiltfilt(sections, values, axis=0, padtype="odd", padlen=3 * decimation.order)
    return smooth[::-1][:: decimation.factor][::-1]


@settings(max_examples=150)
@given(
    decimation=st.builds(
        Decimation,
        factor=st.integers(2, 30),
        order=st.integers(1, 8),
        band=st.floats(0.3, 0.95),
        ripple_db=st.floats(0.01, 1.0),
    ),
    beyond=st.integers(1, 400),
    shape=st.sampled_from([(), (1,), (3,), (0,), (2, 9)]),
    seed=st.integers(0, 1000),
)
def test_kept_samples_are_those_of_the_filter_at_every_sample(decimation, beyond, shape, seed):
    values = np.random.default_rng(seed).normal(size=(3 * decimation.order + beyond, *shape))
    kept, expected = decimate(values, decimation), decimate_by_scipy(values, decimation)
    assert kept.shape == expected.shape
    # Rounding of SciPy's own recursion; blocks differ from one in extended precision by 1e-14.
    np.testing.assert_allclose(kept, expected, atol=1e-10 * max(1.0, np.abs(values).max(initial=0.0)))


@pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-18, reason="no extended precision here")
def test_decimation_is_closer_to_the_filter_in_extended_precision_than_the_filter_in_doubles():
    values, decimation = np.random.default_rng(3).normal(size=4000), Decimation(factor=40)
    sections = cheby1(8, 0.05, 0.8 / 40, output="sos").astype(np.longdouble)
    # The steady state of a step, section by section.
    rest, level = np.empty((len(sections), 2), dtype=np.longdouble), np.longdouble(1.0)
    for k, (b0, b1, b2, _, a1, a2) in enumerate(sections):
        gain = (b0 + b1 + b2) / (1 + a1 + a2)
        rest[k] = level * np.array([b1 + b2 - (a1 + a2) * gain, b2 - a2 * gain])
        level *= gain
    ends = 2 * values[0] - values[24:0:-1], 2 * values[-1] - values[-2:-26:-1]
    padded = np.concatenate([ends[0], values, ends[1]]).astype(np.longdouble)
    once, _ = sosfilt(sections, padded, zi=rest * padded[0])
    exact = sosfilt(sections, once[::-1], zi=rest * once[-1])[0][24:-24][::40][::-1]
    ours, plain = decimate(values, decimation), decimate_by_scipy(values, decimation)
    assert np.abs(ours - exact).max() < 1e-14 < np.abs(plain - exact).max()


@pytest.mark.parametrize("shape", [(), (1,), (4,), (2, 3)])
def test_blocks_of_a_long_signal_are_those_of_the_whole(shape):
    values = np.random.default_rng(4).normal(size=(100_007, *shape))
    decimation = Decimation(factor=10)
    blocks = list(decimate_blocks(lambda part: values[part], len(values), decimation))
    assert len(blocks) > 2
    assert [places.start for places, _ in blocks[1:]] == [places.stop for places, _ in blocks[:-1]]
    joined = np.concatenate([rows for _, rows in blocks])
    np.testing.assert_allclose(joined, decimate_by_scipy(values, decimation), atol=1e-12)


@pytest.mark.parametrize(("cutoff", "factor", "step"), [(30.0, 8, 4), (3.0, 20, 20)])
def test_thinned_samples_of_smooth_signals_give_the_same_rows(cutoff, factor, step):
    """White noise through a low-pass, squared: what no single sine would show."""
    noise = np.random.default_rng(9).normal(size=(120_000, 2))
    smooth = low_pass(noise, period=T, cutoff=cutoff, order=4)
    values, decimation = np.column_stack([smooth, smooth**2, 0.0 * smooth]), Decimation(factor=factor)
    thin = choose_thinning(Processing(filter_cutoff=cutoff, decimation=decimation), T)
    assert thin == step
    asked = []

    def evaluate(part):
        asked.append(part.step)
        return values[part]

    rows = np.concatenate([part for _, part in decimate_blocks(evaluate, len(values), decimation, thin)])
    assert asked == [1, *[thin] * (len(asked) - 2), 1]
    assert len(asked) > 5
    whole = decimate(values, decimation)
    assert np.abs(rows - whole).max() < 1e-5 * np.abs(whole).max()
    assert np.abs(rows - whole).max() > 0.0
    # What folds is not thinned: the noise itself would be another.
    plain = np.concatenate(
        [part for _, part in decimate_blocks(lambda part: noise[part], len(noise), decimation, thin)]
    )
    assert np.abs(plain - decimate(noise, decimation)).max() > 0.1


@pytest.mark.parametrize(
    ("cutoff", "factor", "expected"),
    [(None, 8, 1), (400.0, 8, 1), (258.0, 8, 2), (30.0, 8, 4), (100.0, 5, 1), (3.0, 20, 20), (3.0, 1, 1)],
)
def test_samples_are_thinned_as_far_as_the_low_pass_allows(cutoff, factor, expected):
    """By the gain of SciPy's filter where the edge of the rows folds from: 1e-5 or less."""
    decimation = Decimation(factor=factor)
    thin = choose_thinning(Processing(filter_cutoff=cutoff, decimation=decimation), T)
    assert thin == expected
    for step in (k for k in range(2, factor + 1) if factor % k == 0 and cutoff is not None):
        b, a = butter(4, cutoff, fs=1.0 / T)
        angle = np.exp(-2j * np.pi * (1.0 / step - 0.4 / factor))
        gain = abs(np.polyval(b[::-1], angle) / np.polyval(a[::-1], angle)) ** 2
        assert step > thin or gain < 2e-5


@pytest.mark.parametrize("cutoff", [None, 5.0, 60.0])
@pytest.mark.parametrize("states", ["position", "velocity"])
def test_signals_part_by_part_are_those_of_the_whole(cutoff, states):
    rng, time = np.random.default_rng(3), np.arange(9000) * T
    position = np.column_stack([np.sin(3.0 * time), np.cos(40.0 * time)]) + 1e-5 * rng.normal(size=(9000, 2))
    log = Recording(
        time=time,
        position=position,
        torque=rng.normal(size=position.shape),
        velocity=np.gradient(position, T, axis=0),
        load=rng.normal(size=position.shape),
        temperature=rng.normal(size=position.shape),
        bad=rng.uniform(size=position.shape) < 0.01,
    )
    settings = Processing(filter_cutoff=cutoff, drop_first=7, drop_last=11, filter_torque=True, states=states)
    whole, parts = prepare_signals(log, settings), SignalParts(log, settings)
    np.testing.assert_array_equal(parts.time, whole.time)
    for part in (slice(0, 1), slice(4000, 4100), slice(4010, 4090, 3), slice(8900, len(whole.time))):
        found, expected = parts.cut(part), whole.cut(part)
        for name in ("time", "q", "dq", "ddq", "tau", "load", "temperature"):
            values = getattr(whole, name)
            np.testing.assert_allclose(
                getattr(found, name), getattr(expected, name), rtol=0.0, atol=1e-10 * np.abs(values).max()
            )
    squares = np.mean(whole.ddq**2, axis=0)
    np.testing.assert_allclose(parts.measure_accelerations(), squares, rtol=1e-10)


def test_decimation_by_one_and_with_a_long_memory():
    x = np.arange(5.0)
    kept = decimate(x, Decimation(factor=1))
    np.testing.assert_array_equal(kept, x)
    assert kept is not x
    values, decimation = np.random.default_rng(5).normal(size=20_000), Decimation(factor=1000)
    np.testing.assert_array_equal(decimate(values, decimation), decimate_by_scipy(values, decimation))
    with pytest.raises(LogError, match=r"^24 samples .* order 8 "):
        decimate(np.zeros((24, 1)), Decimation(factor=2))


def test_signals_are_the_derivatives_of_the_position_with_cut_ends():
    slope = differentiate(np.column_stack([TIMES**2, 4.0 * TIMES]), T)
    np.testing.assert_allclose(slope[1:-1, 0], 2.0 * TIMES[1:-1], atol=1e-9)
    np.testing.assert_allclose(slope[:, 1], 4.0, atol=1e-9)
    processing = Processing(filter_cutoff=100.0, drop_first=100, drop_last=150)
    signals = prepare_signals(record(), processing)
    t = TIMES[100:850]
    np.testing.assert_array_equal(signals.time, t)
    np.testing.assert_allclose(signals.q[:, 0], np.sin(t), atol=1e-6)
    np.testing.assert_allclose(signals.dq[:, 0], np.cos(t), atol=1e-4)
    np.testing.assert_array_equal(signals.tau[:, 0], np.cos(t))
    tau = np.random.default_rng(0).normal(size=(1000, 1))
    recording = Recording(time=TIMES[:1000], position=tau, torque=tau)
    signals = prepare_signals(recording, Processing(filter_cutoff=50.0, filter_torque=True))
    np.testing.assert_array_equal(signals.tau, signals.q)


def record(samples=1000):
    t = np.arange(samples) * T
    return Recording(time=t, position=np.sin(t)[:, None], torque=np.cos(t)[:, None], source="run")


def test_logs_that_are_too_short_or_uneven_are_refused():
    processing = Processing(filter_cutoff=100.0, drop_first=5, decimation=Decimation(factor=4))
    least = compute_least_samples(processing)
    signals = prepare_signals(record(least), processing)
    decimate(signals.q, processing.decimation)
    with pytest.raises(LogError, match=f"{least - 1} samples; .* {least}$"):
        prepare_signals(record(least - 1), processing)
    t = np.where(TIMES[:1000] > 0.4, TIMES[:1000] + 0.5, TIMES[:1000])
    recording = Recording(time=t, position=np.sin(t)[:, None], torque=np.cos(t)[:, None], source="run.csv")
    with raises(LogError, "log.gap", match=r"run.csv: .*: 1 steps .* after sample 400") as caught:
        prepare_signals(recording, Processing())
    assert "from 0.4 s to 0.901 s" in str(caught.value)
    t = TIMES[:1000] + T * 0.05 * np.random.default_rng(2).uniform(-1, 1, 1000)
    assert prepare_signals(replace(recording, time=t), Processing()).period == pytest.approx(T, rel=1e-3)
    t = np.cumsum(1.0 + 0.3 * (np.arange(1000) % 3 - 1.0)) * T
    with raises(LogError, "log.jitter", match="limit 20 %.*; 666 steps "):
        prepare_signals(replace(recording, time=t), Processing())


@pytest.mark.parametrize("cutoff", [500.0, 900.0])
def test_a_cutoff_above_half_the_sample_rate_is_refused(cutoff):
    with raises(LogError, "log.filter-cutoff", match=f"500 Hz.* got {cutoff:g} Hz") as caught:
        prepare_signals(record(), Processing(filter_cutoff=cutoff))
    assert caught.value.notices[0].file == "run"


@pytest.mark.parametrize(
    ("factor", "cutoff", "filter_torque"),
    [(10, None, False), (4, None, False), (1, 40.0, True), (5, 60.0, True)],
)
def test_the_noise_band_is_that_of_filtered_noise(factor, cutoff, filter_torque):
    """Slow means of filtered noise scatter as the band says: var(mean) m b = var(sample)."""
    rng = np.random.default_rng(factor)
    processing = Processing(
        filter_cutoff=cutoff, filter_torque=filter_torque, decimation=Decimation(factor=factor)
    )
    white = rng.normal(size=(4000, 400))
    if filter_torque:
        white = low_pass(white, period=1e-3, cutoff=cutoff, order=processing.filter_order)
    noise = decimate(white, processing.decimation)
    band = compute_noise_bandwidth(processing, 1e-3)
    slow = np.cos(np.linspace(0, 9, len(noise)))[:, None]
    weight = slow / np.linalg.norm(slow)
    ratio = np.var(noise) / np.var(np.sum(weight * noise, axis=0))
    assert band < 1.0
    # The variance of 400 draws is known to about 7 %.
    assert ratio == pytest.approx(band, rel=0.25)


@pytest.mark.parametrize(
    ("rate", "factor", "cutoff"),
    [(1000.0, 10, 200.0), (5000.0, 50, 200.0), (250.0, 3, 100.0), (100.0, 1, 40.0)],
)
def test_open_settings_follow_from_the_sample_rate(rate, factor, cutoff):
    settled = choose_processing(Processing(automatic=True), 1.0 / rate)
    assert (settled.decimation.factor, settled.filter_cutoff) == (factor, cutoff)
    assert not settled.automatic


def test_what_is_stated_stays_and_without_filters_all_rows_are_independent():
    stated = Processing(filter_cutoff=33.0, decimation=Decimation(factor=4))
    assert choose_processing(stated, 1e-3) == stated
    assert choose_processing(replace(stated, automatic=True), 1e-3) == stated
    assert choose_processing(Processing(), 1e-3).filter_cutoff is None
    assert compute_noise_bandwidth(Processing(filter_cutoff=40.0), 1e-3) == 1.0


def test_a_joint_that_stands_has_no_sign():
    """What rounding leaves of a still encoder would decide dry friction."""
    position = np.sin(3.0 * TIMES)[:, None] * [1.0, 0.3]
    position[2000:] = position[2000] + 1e-13 * np.random.default_rng(4).normal(size=(2000, 2))
    found = prepare_signals(
        replace(record(), position=position, time=TIMES, torque=np.zeros((4000, 2)), velocity=None),
        Processing(filter_cutoff=50.0),
    )
    assert not found.dq[3000:].any()
    assert np.all(found.dq[:900] != 0.0)
    # The acceleration is that of the motion as it was.
    np.testing.assert_array_equal(found.ddq[:900], differentiate(differentiate(found.q, T), T)[:900])
