"""Written logs: read again without a map, whole or not at all, the same bytes each time."""

import os

import numpy as np
import pytest

from symid.errors import OutputError
from symid.logs.files import write_recording
from symid.logs.reader import read_recording
from symid.logs.recording import CONTROL_CHANNELS, OPTIONAL_CHANNELS, Recording
from symid.robot.description import JointKind
from tests.refusals import raises


def record(*channels):
    rng, names = np.random.default_rng(2), ("position", "torque", *channels)
    return Recording(time=np.arange(30) * 0.001, **{name: rng.normal(size=(30, 2)) for name in names})


STATES = ("velocity", "acceleration", "load", "temperature", "motor_position")


@pytest.mark.parametrize("suffix", [".npz", ".csv"])
@pytest.mark.parametrize("kind", JointKind)
@pytest.mark.parametrize("channels", [(), STATES, ("link_position", *CONTROL_CHANNELS)])
def test_what_is_written_is_read_again_to_the_last_bit(make_robot, tmp_path, suffix, kind, channels):
    robot, recording = make_robot((JointKind.REVOLUTE, kind)), record(*channels)
    path = write_recording(recording, tmp_path / "deep" / f"log{suffix}", robot)
    again = read_recording(path, robot)
    for name in ("time", "position", "torque", *OPTIONAL_CHANNELS):
        np.testing.assert_array_equal(getattr(again, name), getattr(recording, name))
    assert [notice.code for notice in again.notices] == ["log.unused-columns"] * ("velocity" in channels)


@pytest.mark.parametrize("suffix", [".npz", ".csv"])
def test_the_same_recording_gives_the_same_bytes_and_no_leftovers(make_robot, tmp_path, suffix):
    paths = [write_recording(record(), tmp_path / f"{name}{suffix}", make_robot()) for name in "ab"]
    assert paths[0].read_bytes() == paths[1].read_bytes()
    assert sorted(tmp_path.iterdir()) == paths


def test_headings_name_units_and_an_older_file_is_replaced(make_robot, tmp_path):
    robot = make_robot((JointKind.REVOLUTE, JointKind.PRISMATIC))
    path = write_recording(record(), tmp_path / "log.csv", robot)
    assert path.read_text().splitlines()[0] == "t [s],q1 [rad],q2 [m],tau1 [N m],tau2 [N]"
    path = tmp_path / "log.npz"
    path.write_text("old")
    write_recording(record(), path, make_robot())
    assert len(read_recording(path, make_robot()).time) == 30


def test_unknown_suffixes_and_places_that_cannot_be_written(make_robot, tmp_path):
    with raises(OutputError, "output.unknown-suffix", match=r"\.npz or \.csv, got \.mat"):
        write_recording(record(), tmp_path / "log.mat", make_robot())
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "file").write_text("")
    with raises(OutputError, "output.unwritable", match=r"log\.npz"):
        write_recording(record(), tmp_path / "file" / "log.npz", make_robot())


def test_a_writer_that_fails_leaves_nothing(make_robot, tmp_path, monkeypatch):
    path = tmp_path / "log.csv"
    path.write_text("old")
    monkeypatch.setattr("symid.logs.files.get_unit", lambda *_, **__: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        write_recording(record(), path, make_robot())
    assert [entry.name for entry in tmp_path.iterdir()] == ["log.csv"]
    assert path.read_text() == "old"


def test_a_log_has_the_rights_that_the_umask_leaves(make_robot, tmp_path):
    before = os.umask(0o027)
    try:
        path = write_recording(record(), tmp_path / "log.npz", make_robot())
    finally:
        os.umask(before)
    assert path.stat().st_mode & 0o777 == 0o640
