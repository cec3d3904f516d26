"""Logs of one fit: uneven stamps are resampled with a note, copies refused, logged velocities used."""

from dataclasses import replace

import numpy as np
import pytest

from symid.errors import LogError, UsageError
from symid.logs.recording import Recording
from symid.logs.runs import read_fit_recordings
from symid.logs.signals import low_pass, prepare_signals
from symid.robot.description import Processing
from tests.refusals import raises
from tests.unit.identification.pinocchio_arm import ARM, record_arm

PERIOD = 5e-3


@pytest.fixture(scope="module")
def log():
    return record_arm(1, noise=0.02)


def move_stamps(log, share, seed=0):
    """Return the log at times that differ from even ones by a share of the period, interpolated exactly."""
    time = log.time + share * PERIOD * np.random.default_rng(seed).uniform(-1.0, 1.0, len(log.time))
    moved = [
        np.column_stack([np.interp(time, log.time, column) for column in part.T])
        for part in (log.position, log.torque)
    ]
    return replace(log, time=time, position=moved[0], torque=moved[1])


def test_uneven_logs_are_resampled_with_a_note_and_even_ones_stay(log):
    (found,) = read_fit_recordings([log], ARM)
    assert found is log
    assert not found.notices
    uneven = move_stamps(log, 0.4)
    (found,) = read_fit_recordings([uneven], ARM)
    assert [notice.code for notice in found.notices] == ["log.resampled"]
    assert found.notices[0].text.startswith(f"{len(log.time)} samples became {len(found.time)} at every 0.0")
    assert len(found.time) == pytest.approx(len(log.time), rel=0.01)
    assert np.ptp(np.diff(found.time)) < 1e-9
    for joint in range(3):
        exact = np.interp(found.time, log.time, log.position[:, joint])
        assert np.abs(found.position[:, joint] - exact)[10:-10].max() < 1e-3
    kept = np.delete(np.arange(len(log.time)), [500, 501, 502, 2000])
    order = np.insert(kept, 1000, kept[1000])
    broken = replace(log, time=log.time[order], position=log.position[order], torque=log.torque[order])
    (found,) = read_fit_recordings([broken], ARM)
    (notice,) = found.notices
    assert "2 gaps of up to 10 periods were interpolated over" in notice.text
    assert "1 with times that repeat or return were left out" in notice.text
    assert len(found.time) == len(log.time)
    assert np.abs(found.position - log.position).max() < 1e-3


@pytest.mark.parametrize(
    "copy",
    [
        lambda log: replace(log, source="copy"),
        lambda log: replace(log, source="copy", time=log.time + 12.5),
        lambda log: replace(
            log, source="copy", position=np.round(log.position, 5), torque=np.round(log.torque, 3)
        ),
        lambda log: replace(
            log, source="copy", position=log.position.astype(np.float32), torque=log.torque.astype(np.float32)
        ),
    ],
)
def test_copies_of_a_log_are_refused(log, copy):
    with pytest.raises(UsageError) as caught:
        read_fit_recordings([log, copy(log)], ARM)
    (notice,) = caught.value.notices
    assert (notice.code, notice.file) == ("usage.same-log", "copy")
    assert log.source in notice.text


def test_the_same_motion_recorded_again_is_another_log(log):
    again = replace(record_arm(1, noise=0.02), source="again")
    torque = again.torque + 0.1 * np.random.default_rng(5).normal(size=again.torque.shape)
    assert len(read_fit_recordings([log, replace(again, torque=torque)], ARM)) == 2


@pytest.mark.parametrize(("states", "channel"), [("velocity", "dq"), ("acceleration", "ddq")])
def test_logged_states_take_the_place_of_differences(states, channel):
    """The log disagrees with the positions, so that either is seen."""
    time, kept = PERIOD * np.arange(2001), slice(100, -100)
    position = np.column_stack([np.sin(3.0 * time), np.cos(2.0 * time)])
    other = np.column_stack([np.sin(5.0 * time), 0.1 * time**2])
    log = Recording(time=time, position=position, torque=position, source="made", **{states: other})
    stated = Processing(filter_cutoff=20.0, drop_first=100, drop_last=100)
    found, usual = prepare_signals(log, replace(stated, states=states)), prepare_signals(log, stated)
    smooth = low_pass(other, period=PERIOD, cutoff=20.0, order=4)
    np.testing.assert_allclose(getattr(found, channel), smooth[kept], rtol=1e-12)
    np.testing.assert_allclose(usual.dq[:, 0], 3.0 * np.cos(3.0 * time)[kept], atol=2e-3)
    np.testing.assert_allclose(usual.ddq[:, 0], -9.0 * np.sin(3.0 * time)[kept], atol=2e-3)
    np.testing.assert_array_equal(usual.q, found.q)
    if states == "velocity":
        exact = np.column_stack([5.0 * np.cos(5.0 * time), 0.2 * time])[kept]
        np.testing.assert_allclose(found.ddq, exact, atol=2e-3)
    # Without logged states there is nothing but differences.
    bare = prepare_signals(replace(log, **{states: None}), replace(stated, states=states))
    np.testing.assert_array_equal(getattr(bare, channel), getattr(usual, channel))
    holes = other.copy()
    holes[7, 0] = np.nan
    with raises(LogError, "log.not-finite", match=f"{states} has values that are not finite"):
        prepare_signals(replace(log, **{states: holes}), replace(stated, states=states))
    prepare_signals(replace(log, **{states: holes}), stated)
