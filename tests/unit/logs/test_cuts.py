"""Recordings with samples cut off at either end."""

import numpy as np
import pytest

from symid.errors import LogError
from symid.logs.recording import Recording, cut_ends, cut_recording
from tests.refusals import raises


def make_recording(**more):
    values = np.arange(40.0).reshape(20, 2)
    return Recording(
        time=np.arange(20) * 0.1,
        position=values,
        torque=values + 100.0,
        velocity=values + 200.0,
        extras={"sample": np.arange(20.0), "constant": np.array([7.0])},
        source="run",
        **more,
    )


@pytest.mark.parametrize("second", ["motor_position", "link_position"])
def test_every_channel_is_cut_alike(second):
    whole = make_recording(**{second: np.arange(40.0).reshape(20, 2) + 300.0})
    cut = cut_recording(whole, slice(3, 15))
    for name in ("time", "position", "torque", "velocity", second):
        np.testing.assert_array_equal(getattr(cut, name), getattr(whole, name)[3:15])
    np.testing.assert_array_equal(cut.extras["sample"], np.arange(3.0, 15.0))
    np.testing.assert_array_equal(cut.extras["constant"], [7.0])


def test_ends_are_cut_and_it_is_said_but_not_all():
    whole = make_recording()
    assert cut_ends(whole, 0, 0) is whole
    cut = cut_ends(whole, 4, 1)
    np.testing.assert_array_equal(cut.time, whole.time[4:19])
    (notice,) = cut.notices
    assert notice.code == "log.cut"
    assert "first 4" in notice.text
    assert "last 1 of 20 samples" in notice.text
    assert notice.file == "run"
    assert len(cut_ends(whole, 10, 7).time) == 3
    with raises(LogError, "log.too-short", match=r"of 20 samples leaves 2, .* 3 "):
        cut_ends(make_recording(), 10, 8)
