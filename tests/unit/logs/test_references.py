"""What a controller was asked to do, from a log: read, cut, resampled, moved, written."""

from dataclasses import replace

import numpy as np
import pytest

from symid.logs.files import write_recording
from symid.logs.reader import read_recording
from symid.logs.recording import Recording
from symid.logs.runs import read_fit_recordings, read_log_runs
from symid.logs.sampling import plan_resampling, resample_recording
from symid.robot.toml_reader import parse_robot

HEAD = """
convention = "modified"
gravity = [0, 0, -9.81]
[[joint]]
kind = "revolute"
[joint.drive]
gear = 50
[[joint]]
kind = "revolute"
[joint.drive]
gear = 50
"""


@pytest.fixture
def robot():
    return parse_robot(HEAD)


@pytest.fixture
def recording():
    time = 0.01 * np.arange(200)
    position = np.stack([np.sin(time), np.cos(3.0 * time)], axis=1)
    return Recording(
        time=time,
        position=position,
        torque=3.0 * position,
        reference=position + 0.01,
        reference_velocity=position - 0.5,
        feedforward=2.0 * position,
    )


def test_gears_and_transmissions_turn_them(tmp_path, robot, recording):
    path = write_recording(recording, tmp_path / "log.npz", robot)
    moved = parse_robot(
        HEAD
        + """
[log]
reference = { columns = ["q_ref"], unit = "rad", side = "motor", offset = 0.25 }
reference_velocity = { columns = ["dq_ref"], unit = "rad/s", side = "motor" }
feedforward = { columns = ["tau_ff"], unit = "N m", side = "motor" }
"""
    )
    found = read_recording(path, moved)
    np.testing.assert_allclose(found.reference, recording.reference / 50.0 + 0.25)
    np.testing.assert_allclose(found.reference_velocity, recording.reference_velocity / 50.0)
    np.testing.assert_allclose(found.feedforward, recording.feedforward * 50.0)
    matrix = np.array([[45.0, 0.0], [32.0, 32.0]])
    coupled = parse_robot(
        HEAD
        + """
[log]
transmission = [[45, 0], [32, 32]]
reference = { columns = ["q_ref"], unit = "rad", side = "motor" }
feedforward = { columns = ["tau_ff"], unit = "N m", side = "motor" }
"""
    )
    found = read_recording(path, coupled)
    np.testing.assert_allclose(found.reference @ matrix.T, recording.reference)
    np.testing.assert_allclose(found.feedforward, recording.feedforward @ matrix)


def test_resampling_and_zeros_keep_samples_together(recording, tmp_path, robot):
    moved = resample_recording(recording, plan_resampling(recording.time))
    assert moved.reference.shape == moved.reference_velocity.shape == moved.position.shape
    np.testing.assert_allclose(moved.reference, moved.position + 0.01, atol=1e-6)
    write_recording(recording, tmp_path / "log.npz", robot)
    runs = tmp_path / "runs.toml"
    runs.write_text('[[run]]\nfile = "log.npz"\noffset = [0.1, -0.2]\n')
    (found,) = read_log_runs(runs, robot)
    np.testing.assert_allclose(found.reference - found.position, 0.01)
    np.testing.assert_allclose(found.position, recording.position + np.array([0.1, -0.2]))


def test_fits_that_simulate_no_controller_do_without_its_channels(tmp_path, robot, recording):
    path = write_recording(recording, tmp_path / "log.npz", robot)
    (whole,), (found,) = (read_fit_recordings([path], robot, control=control) for control in (True, False))
    assert (found.reference, found.reference_velocity, found.feedforward) == (None, None, None)
    assert (found.notices, found.extras) == (whole.notices, {})
    for name in ("time", "position", "torque"):
        np.testing.assert_array_equal(getattr(found, name), getattr(recording, name))
    np.testing.assert_array_equal(whole.reference, recording.reference)
    # A column that the map lacks is noted all the same.
    named = parse_robot(HEAD + '[log]\nreference = { columns = ["soll"], unit = "rad" }\n')
    (found,) = read_fit_recordings([path], named, control=False)
    assert "log.no-reference" in {entry.code for entry in found.notices}


def test_a_gap_in_the_reference_stops_no_one_and_a_named_column_may_be_missing(tmp_path, robot, recording):
    reference = recording.reference.copy()
    reference[3, 1] = np.nan
    path = write_recording(replace(recording, reference=reference), tmp_path / "log.npz", robot)
    assert np.isnan(read_recording(path, robot).reference[3, 1])
    named = parse_robot(HEAD + '[log]\nreference = { columns = ["soll"], unit = "rad" }\n')
    found = read_recording(path, named)
    assert found.reference is None
    (notice,) = (entry for entry in found.notices if entry.code == "log.no-reference")
    assert "there is no column 'soll'" in notice.text
