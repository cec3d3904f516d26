"""Logs of motors that move more than one joint: what they say of the joints."""

from dataclasses import replace

import numpy as np
import pytest

from symid.logs.reader import read_recording
from symid.robot.toml_reader import read_robot

MATRIX = ((50.0, 0.0), (-20.0, 80.0))


def couple(robot, matrix=MATRIX):
    return replace(robot, log=replace(robot.log, transmission=matrix))


def test_a_matrix_does_the_same_work_on_both_sides_and_may_be_gears(make_robot, columns, write_npz):
    motor = (("q",), "rad", (1.0,), "motor")
    robot = couple(
        make_robot(
            position=motor,
            velocity=(("dq",), "rad/s", (1.0,), "motor"),
            torque=(("tau",), "N m", (1.0,), "motor"),
        )
    )
    dq = np.cos(columns["q"])
    recording = read_recording(write_npz(**columns, dq=dq), robot)
    np.testing.assert_allclose(recording.position @ np.array(MATRIX).T, columns["q"], atol=1e-12)
    np.testing.assert_allclose(
        np.sum(recording.torque * recording.velocity, axis=1), np.sum(columns["tau"] * dq, axis=1), atol=1e-12
    )
    texts = [notice.text for notice in recording.notices]
    assert "'q' in rad was multiplied by 1 and the inverse of the transmission matrix (motor side" in texts[0]
    assert any("the transpose of the transmission matrix" in text for text in texts)
    robot = couple(make_robot(position=(("q",), "rad"), torque=(("tau",), "N m", (1.0,), "motor")))
    recording = read_recording(write_npz(**columns), robot)
    np.testing.assert_array_equal(recording.position, columns["q"])
    np.testing.assert_allclose(recording.torque, columns["tau"] @ np.array(MATRIX))
    log = {"position": (("q",), "deg", (1.0,), "motor"), "torque": (("tau",), "N m", (2.0, 3.0), "motor")}
    path = write_npz(**columns)
    geared = read_recording(path, make_robot(gears=(50.0, -80.0), **log))
    coupled = read_recording(path, couple(make_robot(**log), ((50.0, 0.0), (0.0, -80.0))))
    np.testing.assert_allclose(coupled.position, geared.position, rtol=1e-14)
    np.testing.assert_allclose(coupled.torque, geared.torque, rtol=1e-14)


def test_zeros_are_added_on_the_joint_side(make_robot, columns, write_npz):
    robot = couple(make_robot(position=(("q",), "deg", (1.0,), "motor")))
    offset = (0.5, -np.pi / 2)
    moved = replace(robot, log=replace(robot.log, position=replace(robot.log.position, offset=offset)))
    path = write_npz(**columns)
    before, after = (read_recording(path, entry) for entry in (robot, moved))
    np.testing.assert_allclose(after.position - before.position, np.tile(offset, (50, 1)), atol=1e-14)
    assert "; 0.5, -1.570796 was added" in after.notices[0].text
    robot = make_robot(position=(("q",), "rad"))
    robot = replace(robot, log=replace(robot.log, position=replace(robot.log.position, offset=(0.25,))))
    recording = read_recording(write_npz(**columns), robot)
    np.testing.assert_allclose(recording.position, columns["q"] + 0.25)
    assert "0.25 was added" in recording.notices[0].text


@pytest.mark.parametrize("joint", [4, 5])
def test_the_tx40_log_is_on_the_joint_side(shared_data, robots_folder, joint):
    path = shared_data / "tx40" / "tx40.npz"
    recording = read_recording(path, read_robot(robots_folder / "tx40.toml"))
    with np.load(path) as log:
        q, tau = log["q_motor"], log["tau_motor"]
    # Motor 6 turns with joints 5 and 6 together, so it loads both.
    wanted = {4: 45 * tau[:, 4] + 32 * tau[:, 5], 5: 32 * tau[:, 5]}
    np.testing.assert_allclose(recording.torque[:, joint], wanted[joint], rtol=1e-12, atol=1e-12)
    turned = {4: q[:, 4] / 45, 5: q[:, 5] / 32 - q[:, 4] / 45}
    np.testing.assert_allclose(recording.position[:, joint], turned[joint], atol=1e-12)
    np.testing.assert_allclose(recording.position[:, 1], q[:, 1] / 32 - np.pi / 2, atol=1e-12)
