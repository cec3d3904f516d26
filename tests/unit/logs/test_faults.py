"""Faults put into clean recordings are found and repaired; clean ones stay as they are, to the last bit.

Motions are sums of sines, torques are made of them with dry friction and noise of their own, encoders have
ticks, and robots are polled: nothing here is made by a simulator of the package.
"""

import gzip
import re
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st

from symid.codegen.cache import prepare_library
from symid.errors import LogError
from symid.identification.rigid.fit import identify_parameters
from symid.identification.rigid.validation import validate_estimate
from symid.logs.faults import LEVELS, FaultKind, measure_roughness, repair_recording, unwrap
from symid.logs.reader import read_recording
from symid.logs.recording import Recording, cut_recording, spread_bad
from symid.logs.signals import decimate, mask_decimated
from symid.robot import Decimation, Joint, JointKind, Processing
from symid.robot.geometry import IDENTITY
from symid.robot.toml_reader import read_robot

RATE, COUNT = 500.0, 4000
JOINTS = tuple(
    Joint(name=f"joint{k}", kind=JointKind.REVOLUTE, parent=k - 2, placement=IDENTITY) for k in (1, 2)
)


CODES = ["log.repeats", "log.resampled", "log.wraps", "log.spikes", "log.stuck", "log.jumps", "log.clipped"]


class Motion:
    """Two joints that follow sums of three sines each, and what a log says of them."""

    def __init__(self, seed, tick=1e-5, noise=0.05, size=1.0):
        self.rng = np.random.default_rng(seed)
        shape = (2, 3)
        self.pace = 2.0 * np.pi * self.rng.uniform(0.2, 2.0, shape)
        self.size, self.phase = size * self.rng.uniform(0.2, 0.6, shape), self.rng.uniform(0.0, 6.0, shape)
        self.tick, self.noise = tick, noise

    def evaluate(self, time, order=0):
        angle = self.pace * time[:, None, None] + self.phase + 0.5 * np.pi * order
        return np.sum(self.size * self.pace**order * np.sin(angle), axis=2)

    def record(self, taken, time=None, **channels):
        """Return the log of samples `taken` at times, with the stamps `time` where these are others."""
        position, velocity = (self.evaluate(taken, order) for order in (0, 1))
        torque = 2.0 * self.evaluate(taken, 2) + 9.0 * np.sin(position) + 1.5 * np.sign(velocity) + velocity
        torque = torque + self.noise * self.rng.normal(size=torque.shape)
        ticks = self.tick * np.round(position / self.tick) if self.tick else position
        return Recording(
            time=taken if time is None else time, position=ticks, torque=torque, source="made", **channels
        )


TIME = np.arange(COUNT) / RATE


def make_log(seed=0, **settings):
    return Motion(seed, **settings).record(TIME)


def change(log, name, where, values):
    changed = getattr(log, name).copy()
    changed[where] = values
    return replace(log, **{name: changed})


def repair(log):
    """Return what was repaired, which leaves nothing for another repair, with the kinds of the repairs."""
    found = repair_recording(log, JOINTS)
    assert repair_recording(found, JOINTS) is found
    told = [notice for notice in found.notices[len(log.notices) :] if notice.code in CODES]
    assert all(notice.file == "made" for notice in told)
    return mask_none(found), [notice.code.removeprefix("log.") for notice in told]


def mask_none(log):
    """Return a recording with a mask also where nothing is wrong."""
    return log if log.bad is not None else replace(log, bad=np.zeros(log.position.shape, dtype=bool))


def test_kinds_of_faults_are_known():
    assert [f"log.{kind}" for kind in get_args(FaultKind)] == CODES


@settings(max_examples=40)
@given(
    seed=st.integers(0, 10**6),
    tick=st.sampled_from([0.0, 1e-6, 1e-4, 2e-3]),
    noise=st.sampled_from([0.0, 0.01, 1.0]),
    size=st.sampled_from([1e-3, 1.0]),
    rate=st.sampled_from([50.0, 1000.0]),
)
def test_clean_logs_stay_as_they_are(seed, tick, noise, size, rate):
    time = np.arange(2000) / rate
    log = Motion(seed, tick, noise, size).record(time)
    found = repair_recording(log, JOINTS)
    assert found is log


def test_what_is_ordinary_is_no_fault():
    """Rest, coarse torques at their peaks, commands that step, stops, noise with tails, short reversals."""
    log, rng = make_log(3), np.random.default_rng(1)
    clock = np.clip((TIME - 2.0) / 4.0, 0.0, 1.0)
    rest = np.column_stack([1e-5 * np.round(1e5 * clock**3 * (10.0 - 15.0 * clock + 6.0 * clock**2))] * 2)
    quiet = np.round(np.sin(3.0 * TIME), 1)
    bang = np.sign(np.sin(4.0 * TIME))
    bounce = np.abs(np.sin(2.0 * TIME))
    brief = np.sin(TIME) + np.where(np.isin(np.arange(COUNT), [700, 701, 2300]), 1.0, -1.0)
    brief[3000:] += 2.0
    # From point to point with rests, without any noise: half of the rows are equal.
    pace = np.clip(np.mod(TIME, 2.0), 0.0, 1.0)
    moves = np.floor(TIME / 2.0) + pace**3 * (10.0 - 15.0 * pace + 6.0 * pace**2)
    thrust = (
        60.0 * pace * (1.0 - pace) * (1.0 - 2.0 * pace) + 2.0 * np.sign(pace * (1.0 - pace)) + np.cos(moves)
    )
    trapezoid = np.cumsum(np.cumsum(np.repeat([0.0, 1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0] * 2, 250))) / RATE**2
    # Equal samples on either side of each turn.
    swing = np.cos(np.pi * (np.arange(COUNT) + 0.5) / 400.0)
    torques = {
        "moves": replace(log, position=np.column_stack([moves] * 2), torque=np.column_stack([thrust] * 2)),
        "constant acceleration": replace(log, position=np.column_stack([trapezoid] * 2)),
        "turns": replace(log, position=np.column_stack([swing] * 2), torque=np.column_stack([-swing] * 2)),
        "rest": replace(log, position=rest, torque=np.where(rest == rest[0], 3.0, log.torque)),
        "held": replace(log, position=rest, torque=np.column_stack([quiet, log.torque[:, 1]])),
        "quantised": change(log, "torque", np.s_[:, 0], quiet),
        "commanded": replace(log, torque=np.column_stack([bang, bang])),
        "tails": replace(log, torque=log.torque + 0.1 * rng.laplace(size=log.torque.shape)),
        "brief": change(log, "torque", np.s_[:, 1], brief),
        "bounces": replace(log, position=np.column_stack([bounce, log.position[:, 1]])),
        "none": replace(log, torque=log.torque * [0.0, 1.0]),
    }
    for name, clean in torques.items():
        found = repair_recording(clean, JOINTS)
        assert found is clean, (name, [notice.text for notice in found.notices])


@settings(max_examples=25)
@given(
    seed=st.integers(0, 10**6),
    length=st.integers(1, LEVELS.longest),
    name=st.sampled_from(["position", "torque", "velocity"]),
    size=st.sampled_from([0.02, 1.0, 1e6]),
    places=st.lists(st.integers(40, COUNT - 40), min_size=1, max_size=8, unique=True),
)
def test_spikes_are_found_and_bridged(seed, length, name, size, places):
    motion = Motion(seed, noise=0.001)
    log = motion.record(TIME, velocity=motion.evaluate(TIME, 1))
    places = sorted({20 * (place // 20) for place in places})
    where = np.add.outer(places, np.arange(length)).ravel()
    given, steep = getattr(log, name)[where, 0], np.abs(np.diff(getattr(log, name)[:, 0])).max()
    # Where friction turns a torque steps as well.
    height = size if name == "position" else 10.0 * steep * max(size, 1.0)
    found, kinds = repair(change(log, name, (where, 0), given + height))
    assert set(kinds) == {"spikes"}
    expected = np.zeros_like(found.bad)
    expected[where, slice(None) if name != "torque" else 0] = True
    np.testing.assert_array_equal(found.bad, expected)
    error = np.abs(getattr(found, name)[where, 0] - given)
    assert error.max() < (5e-4 if name == "position" else 2.0 * steep)
    assert sum(int(re.search(r"in (\d+) samples", entry.text)[1]) for entry in found.notices) == len(where)
    untouched = np.setdiff1d(np.arange(COUNT), where)
    np.testing.assert_array_equal(getattr(found, name)[untouched], getattr(log, name)[untouched])


def test_spikes_beside_each_other_and_dropouts_of_all_channels():
    log, rng = make_log(5), np.random.default_rng(2)
    places = np.flatnonzero(rng.random(COUNT) < 0.02)
    places = places[(places > 5) & (places < COUNT - 5)]
    high = log.position[places, 1] + rng.choice([-1.0, 1.0], len(places))
    found, kinds = repair(change(log, "position", (places, 1), high))
    assert set(kinds) <= {"spikes", "jumps"}
    assert np.mean(found.bad[places, 0]) > 0.9
    assert np.mean(found.bad) < 1.2 * len(places) / COUNT
    # A row of zeros, as when a packet is lost.
    gone = replace(
        log,
        position=np.where(np.arange(COUNT)[:, None] == 1000, 0.0, log.position + 3.0),
        torque=np.where(np.arange(COUNT)[:, None] == 1000, 0.0, log.torque + 60.0),
    )
    found, kinds = repair(gone)
    assert kinds == ["spikes"] * 4
    assert found.bad[1000].all()
    assert found.bad.sum() == 2
    np.testing.assert_allclose(found.position, log.position + 3.0, atol=1e-4)


@settings(max_examples=25)
@given(
    seed=st.integers(0, 10**6),
    size=st.sampled_from([1.0, 8.0, 20.0]),
    offset=st.floats(-20.0, 20.0),
    tick=st.sampled_from([0.0, 1e-4]),
)
def test_wraps_are_taken_off_exactly(seed, size, offset, tick):
    log = make_log(seed, size=size, tick=tick)
    true = log.position + offset
    wrapped = np.remainder(true + np.pi, 2.0 * np.pi) - np.pi
    reference = wrapped + 0.01
    found, kinds = repair(replace(log, position=wrapped, reference=reference))
    turns = np.round((wrapped - true)[0] / (2.0 * np.pi))
    np.testing.assert_allclose(found.position, true + 2.0 * np.pi * turns, rtol=0.0, atol=1e-12)
    away = found.reference - found.position
    np.testing.assert_allclose(away, 0.01, atol=1e-12)
    steps = np.any(np.abs(np.diff(wrapped, axis=0)) > np.pi, axis=0)
    assert kinds == ["wraps"] * int(steps.sum())
    assert not found.bad.any()


def test_only_whole_turns_of_revolute_joints_are_wraps():
    log = make_log(1)
    far = np.where(TIME[:, None] > 3.0, log.position + 5.0, log.position)
    np.testing.assert_array_equal(unwrap(far[:, 0]), far[:, 0])
    # A wheel that turns by more than half a turn a sample.
    np.testing.assert_array_equal(unwrap(4.0 * np.arange(50.0)), 4.0 * np.arange(50.0))
    slide = replace(JOINTS[0], kind=JointKind.PRISMATIC)
    turned = change(log, "position", np.s_[1500:, 0], log.position[1500:, 0] + 2.0 * np.pi)
    assert {entry.code for entry in repair_recording(turned, (slide, slide)).notices} == {"log.jumps"}
    # Beside a wrap an encoder with noise may go to and fro.
    dither = np.pi + 1e-3 * np.sin(40.0 * TIME) + 1e-4 * np.random.default_rng(0).normal(size=COUNT)
    dithered = np.remainder(dither + np.pi, 2.0 * np.pi) - np.pi
    assert np.ptp(unwrap(dithered)) < 0.01


@settings(max_examples=25)
@given(
    seed=st.integers(0, 10**6),
    length=st.integers(LEVELS.longest + 1, 500),
    start=st.integers(30, COUNT - 600),
    alone=st.booleans(),
)
def test_a_stuck_encoder_is_bridged(seed, length, start, alone):
    log = make_log(seed)
    stuck = slice(start + 1, start + 1 + length)
    # Where it comes back to the same place there is nothing to see.
    moved = np.abs(log.position[stuck.stop, 0] - log.position[start, 0])
    speed = np.abs(np.diff(log.position[stuck.stop : stuck.stop + 2, 0]))[0]
    joints = 0 if alone else slice(None)
    found, kinds = repair(change(log, "position", (stuck, joints), log.position[start, joints]))
    assert set(kinds) <= {"stuck", "jumps"}
    if moved > 20.0 * max(speed, 1e-4):
        assert found.bad[stuck].all()
        assert found.bad.sum() == 2 * length
        # The bridge begins and ends as the motion goes on.
        steps = np.abs(np.diff(found.position[start - 1 : stuck.stop + 2, 0], n=2))
        assert steps.max() < np.abs(np.diff(log.position[:, 0], n=2)).max() + 8.0 * moved / length**2 + 1e-4
    if moved > 100.0 * max(speed, 1e-4):
        assert "stuck" in kinds


def test_an_encoder_that_is_stuck_from_the_start_or_to_the_end():
    log = make_log(2)
    for stuck, value in ((slice(0, 900), log.position[0, 0]), (slice(3001, None), log.position[3000, 0])):
        found, kinds = repair(change(log, "position", (stuck, 0), value))
        assert kinds == ["stuck"]
        assert found.bad[stuck].all()
        assert found.bad.sum() == 2 * len(range(*stuck.indices(COUNT)))
    # A joint whose torque is off as well was switched off.
    off = change(log, "position", (slice(3001, None), 0), log.position[3000, 0])
    off = change(off, "torque", (slice(3000, None), 0), 0.0)
    assert not mask_none(repair_recording(off, JOINTS[:1] * 2)).bad.any()


@pytest.mark.parametrize("size", [0.01, 0.4, 30.0])
def test_a_jump_is_bridged_by_ordinary_accelerations(size):
    log = make_log(4)
    found, kinds = repair(change(log, "position", np.s_[1500:, 1], log.position[1500:, 1] + size))
    assert kinds == ["jumps"]
    assert found.bad[1499:1501].all()
    outside = ~found.bad[:, 1]
    later = np.where(np.arange(COUNT) < 1500, 0.0, size)
    np.testing.assert_array_equal(found.position[outside, 1], (log.position[:, 1] + later)[outside])
    most = np.abs(np.diff(log.position[:, 1], n=2)).max()
    assert np.abs(np.diff(found.position[:, 1], n=2)).max() < 3.0 * most


@settings(max_examples=20)
@given(
    seed=st.integers(0, 10**6),
    share=st.sampled_from([0.6, 0.8, 0.9]),
    noise=st.sampled_from([0.0, 0.3]),
    digits=st.sampled_from([3, 12]),
)
def test_clipped_torques_are_masked(seed, share, noise, digits):
    log = make_log(seed, noise=noise)
    top = share * np.abs(log.torque[:, 0]).max()
    clipped = np.round(np.clip(log.torque[:, 0], -top, top), digits)
    found, kinds = repair(change(log, "torque", np.s_[:, 0], clipped))
    high, low = clipped == clipped.max(), clipped == clipped.min()
    assert not found.bad[:, 1].any()
    assert not found.bad[~(high | low), 0].any()
    np.testing.assert_array_equal(found.torque[:, 0], clipped)
    # A side on which it is cut off for some samples only need not be seen.
    for side in (high, low):
        assert found.bad[side, 0].all() or np.sum(side) < 0.01 * COUNT
    assert set(kinds) <= {"clipped"}


def poll(motion, period, poll, count, *, phase=0.3, drift=0.0, late=0.0):
    """Return the log of a robot that takes samples every `period`, asked every `poll` s for the last one."""
    time = poll * np.arange(count)
    taken = period * (np.arange(-1, int(1.1 * time[-1] / period)) + phase)
    taken = taken + drift * np.sin(0.5 * taken)
    where = np.searchsorted(taken, time, side="right") - 1
    fresh, where = np.unique(where, return_inverse=True)
    log = motion.record(taken[fresh])
    stamps = time + late * motion.rng.uniform(size=count) * poll
    return replace(log, time=stamps, position=log.position[where], torque=log.torque[where]), log


@settings(max_examples=20)
@given(
    seed=st.integers(0, 10**6),
    ratio=st.floats(1.01, 3.5),
    late=st.sampled_from([0.0, 0.4]),
    phase=st.floats(0.0, 0.99),
)
@example(seed=0, ratio=2.0, late=0.0, phase=0.3)
def test_a_robot_that_is_polled_too_fast_gets_its_own_clock(seed, ratio, late, phase):
    period = 1.0 / 338.0
    log, fresh = poll(Motion(seed), period, period / ratio, 3000, phase=phase, late=late)
    found, kinds = repair(log)
    assert kinds == ["repeats"]
    moved = found
    assert len(moved.time) == len(fresh.time)
    np.testing.assert_array_equal(moved.position, fresh.position)
    np.testing.assert_array_equal(moved.torque, fresh.torque)
    assert moved.period == pytest.approx(period, rel=2e-4)
    assert np.ptp(np.diff(moved.time)) < 1e-9
    assert f"{100.0 * (1.0 - len(fresh.time) / len(log.time)):.3g} % of the samples" in found.notices[-1].text
    assert f"every {1e3 * moved.period:.6g} ms" in found.notices[-1].text


@settings(max_examples=10)
@given(seed=st.integers(0, 10**6), drifts=st.booleans())
def test_faults_come_together(seed, drifts):
    """A robot that is polled, whose positions wrap, with a spike and an encoder that hangs."""
    log, fresh = poll(Motion(seed, size=9.0), 0.003, 0.0025, 3000, drift=0.1 * drifts)
    spoilt = fresh.position.copy()
    spoilt[500] += 40.0
    spoilt[1001:1101, 0] = spoilt[1000, 0]
    spoilt = np.remainder(spoilt, 2.0 * np.pi)
    where = np.cumsum(np.append(False, np.any(np.diff(log.torque, axis=0) != 0.0, axis=1)))
    found, kinds = repair(replace(log, position=spoilt[where]))
    assert kinds[: kinds.index("repeats")] == ["wraps"] * kinds.index("repeats")
    assert set(kinds[kinds.index("repeats") + 1 :]) <= {"spikes", "stuck", "jumps"}
    away = found.position - Motion(seed, size=9.0).evaluate(found.time)
    if not drifts:
        # How often a joint turned while its encoder hung is not known.
        step = np.abs(np.diff(fresh.position, axis=0)).max()
        assert np.abs(np.remainder(away + np.pi, 2.0 * np.pi) - np.pi)[~found.bad].max() < 2.0 * step
        assert found.bad[500].all()
        assert found.bad[1001:1101].all()
        assert found.bad.sum() < 2 * 130


def test_a_clock_that_drifts_and_rows_that_come_late_stay_at_their_stamps():
    motion = Motion(7)
    log, fresh = poll(motion, 0.003, 0.0025, 4000, drift=0.1)
    found, kinds = repair(log)
    assert kinds == ["repeats"]
    assert "left at their stamps" in found.notices[-1].text
    assert found.period == pytest.approx(0.0025, rel=1e-6)
    assert len(fresh.time) < len(log.time) == pytest.approx(len(found.time), abs=2)
    # The robot answers in time but for some rows, which hold the answer before.
    log = make_log(8)
    late = np.arange(100, COUNT - 100, 170)
    stale = {name: change(log, name, late, getattr(log, name)[late - 1]) for name in ("position", "torque")}
    found, kinds = repair(replace(log, position=stale["position"].position, torque=stale["torque"].torque))
    assert kinds == ["repeats"]
    np.testing.assert_allclose(found.time, TIME, atol=1e-12)
    np.testing.assert_allclose(found.position, log.position, atol=1e-4)
    assert not found.bad.any()


def test_rows_that_are_equal_by_chance_are_no_repeats():
    """A slow motion, coarse ticks and coarse torques: half of the rows are equal."""
    log = make_log(9, size=0.02)
    coarse = replace(log, position=np.round(log.position, 3), torque=np.round(log.torque))
    equal = np.all(coarse.position[1:] == coarse.position[:-1], axis=1)
    assert np.mean(equal & np.all(coarse.torque[1:] == coarse.torque[:-1], axis=1)) > 0.3
    assert repair_recording(coarse, JOINTS) is coarse


@settings(max_examples=20)
@given(
    seed=st.integers(0, 10**6),
    jitter=st.sampled_from([0.1, 0.3]),
    even=st.booleans(),
    velocity=st.sampled_from(["none", "right", "degrees"]),
)
def test_jitter_of_stamps_or_of_samples(seed, jitter, even, velocity):
    """The same stamps, of samples that were taken at even times, or when the stamps say."""
    motion = Motion(seed)
    stamps = TIME + jitter * motion.rng.uniform(-1.0, 1.0, COUNT) / RATE
    taken = TIME if even else stamps
    rate = motion.evaluate(taken, 1) + 1e-3 * motion.rng.normal(size=(COUNT, 2))
    given = {"none": None, "right": rate, "degrees": np.degrees(rate)}[velocity]
    log = motion.record(taken, stamps, velocity=given)
    found, kinds = repair(log)
    assert kinds == ["resampled"]
    moved = found
    assert np.ptp(np.diff(moved.time)) < 1e-9
    error = np.abs(moved.position - motion.evaluate(moved.time))[5:-5]
    # A stamp that is wrong by a tenth of a period is wrong by that part of a step.
    step = np.abs(np.diff(motion.evaluate(TIME), axis=0)).max()
    assert error.max() < 0.1 * jitter * step + 1e-5
    assert ("positions smoother" in found.notices[-1].text) is even
    if even:
        np.testing.assert_array_equal(moved.torque, log.torque)


def test_roughness_is_that_of_the_wrong_times():
    """A cubic at its own times has none, at others that of the steps."""
    rng = np.random.default_rng(0)
    right = np.cumsum(rng.uniform(0.5, 1.5, 200))
    cubic = np.column_stack([right**3 - 40.0 * right**2, right])
    assert np.all(measure_roughness(right, cubic, None) < 1e-6)
    assert np.all(measure_roughness(np.arange(200.0), cubic, None) > 0.1)
    rate = np.column_stack([3.0 * right**2 - 80.0 * right, np.ones(200)])
    assert measure_roughness(right, cubic, rate)[1] < 1e-9
    assert measure_roughness(np.arange(200.0), cubic, rate)[1] > 0.1


def test_too_few_samples_between_gaps():
    time = np.array([0.0, 1.0, 2.0, 30.0, 31.0, 32.0])
    log = Recording(time=time, position=np.ones((6, 2)), torque=np.ones((6, 2)))
    with pytest.raises(LogError):
        repair_recording(log, JOINTS)


def test_masks_are_carried_along():
    bad = np.zeros((COUNT, 2), dtype=bool)
    bad[1000, 0] = bad[2000:2100, 1] = True
    log = replace(make_log(1), bad=bad)
    assert not log.bad.flags.writeable
    np.testing.assert_array_equal(cut_recording(log, slice(900, 2050)).bad, bad[900:2050])
    # At uneven times: neighbours of a bad sample have a part of it.
    uneven = replace(log, time=TIME + 2e-4 * np.sin(300.0 * TIME))
    moved = repair_recording(uneven, JOINTS)
    assert 1 <= moved.bad[:, 0].sum() <= 3
    assert 98 <= moved.bad[:, 1].sum() <= 103
    wide = spread_bad(bad, 5)
    np.testing.assert_array_equal(np.flatnonzero(wide[:, 0]), np.arange(995, 1006))
    np.testing.assert_array_equal(np.flatnonzero(wide[:, 1]), np.arange(1995, 2105))


@pytest.mark.parametrize("factor", [1, 4, 25])
def test_rows_whose_filter_sees_bad_samples_are_left_out(factor):
    """By the response of the filter to a stretch of ones: small in rows that stay, large in others."""
    decimation = Decimation(factor=factor)
    bad = np.zeros((1003, 1), dtype=bool)
    bad[500:560] = True
    out = mask_decimated(bad, decimation)[:, 0]
    response = np.abs(decimate(bad.astype(float), decimation)[:, 0])
    assert len(out) == len(response)
    assert response[~out].max() < 0.25
    assert response[out].max() > 0.9
    assert out.sum() >= 60 / factor
    single = np.zeros((1003, 1), dtype=bool)
    single[500] = True
    assert mask_decimated(single, decimation).sum() == (factor == 1)


@pytest.fixture(scope="module")
def cases(shared_data, tmp_path_factory):
    """Return the robot of the polled logs, and a reader of one of them as a file of its own."""
    folder = shared_data.parent / "cases"
    if not folder.is_dir():
        pytest.skip(f"no recordings in {folder}")
    robot, scratch = read_robot(folder / "robots" / "polled.toml"), tmp_path_factory.mktemp("polled")

    def read(name):
        path = scratch / f"{name}.csv"
        path.write_bytes(gzip.decompress((folder / "logs" / f"{name}.csv.gz").read_bytes()))
        return repair_recording(read_recording(path, robot), robot.axes)

    return robot, prepare_library(robot), read


def test_a_polled_log_identifies_as_it_should(cases):
    """A planar arm, made by a model of its own; 15 % of the samples repeat."""
    robot, library, read = cases
    estimate = identify_parameters(library, [read("polled_train")], robot.processing)
    found = {entry.name: entry.value for entry in estimate.parameters}
    truth = {"ZZR1": 0.9, "ZZ2": 0.15, "MXR1": 2.0, "MX2": 0.5, "Fv1": 0.8, "Fc1": 1.2, "Fc2": 0.5}
    for name, value in truth.items():
        assert found[name] == pytest.approx(value, rel=0.05), name
    validation = validate_estimate(estimate, library, read("polled_valid"), robot.processing)
    assert np.mean([entry.relative_percent for entry in validation.residual]) < 0.5


def test_a_slow_polled_log_identifies_within_its_deviations(cases):
    """The same arm with friction that is smooth near rest: slow rows are left out."""
    _, library, read = cases
    log = read("polled_slow")
    assert log.period == pytest.approx(0.01, rel=1e-6)
    stated = Processing(
        filter_cutoff=5.0, decimation=Decimation(factor=8), standstill=0.02, drop_first=100, drop_last=100
    )
    estimate = identify_parameters(library, [log], stated, estimator="wls")
    found = {entry.name: entry for entry in estimate.parameters}
    for name, value in {"ZZR1": 0.9, "ZZ2": 0.15, "Fv1": 0.8, "Fc1": 1.2, "Fc2": 0.5}.items():
        assert abs(found[name].value - value) < 2.0 * found[name].std, name
