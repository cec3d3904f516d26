"""Logs of other programs: their columns are found by the preset alone."""

from dataclasses import replace

import numpy as np
import pytest

from symid.errors import LogError
from symid.logs.reader import read_recording
from tests.refusals import refuse, tell

HEADINGS = {
    "franka": "time,rate,state.q[0],state.q[1],state.dq[0],state.dq[1],state.tau_J[0],state.tau_J[1]",
    "ur-rtde": "timestamp,target_q_0,actual_q_0,actual_q_1,actual_qd_0,actual_qd_1,actual_current_0"
    ",actual_current_1",
}


@pytest.fixture
def write(tmp_path, columns):
    """Return a writer of logs of a program: time, a number, q, q, tau under its headings."""

    def build(program):
        path = tmp_path / "log.csv"
        time = columns["t"] * (1e3 if program == "franka" else 1.0)
        values = np.column_stack([time, np.ones(50), columns["q"], columns["q"], columns["tau"]])
        lines = [",".join(repr(value) for value in row) for row in values.tolist()]
        path.write_text("\n".join([HEADINGS[program], *lines]) + "\n")
        return path

    return build


def preset(robot, name):
    return replace(robot, log=replace(robot.log, preset=name))


def test_currents_by_torque_constants(make_robot, columns, write):
    robot = preset(make_robot(gears=(101.0, -50.0), constants=(0.12, 0.1)), "ur-rtde")
    recording = read_recording(write("ur-rtde"), robot)
    np.testing.assert_allclose(recording.torque, columns["tau"] * [12.12, -5.0])
    said = tell(recording.notices)
    assert "torque constant 0.12, 0.1 N m/A times gear 101, -50" in said["log.converted"]
    matrix = ((101.0, 0.0), (20.0, 50.0))
    coupled = replace(robot, log=replace(robot.log, transmission=matrix))
    recording = read_recording(write("ur-rtde"), coupled)
    np.testing.assert_allclose(recording.torque, columns["tau"] * [0.12, 0.1] @ np.array(matrix))
    np.testing.assert_array_equal(recording.position, columns["q"])
    found = refuse(LogError, read_recording, write("ur-rtde"), preset(make_robot(), "ur-rtde"))
    assert "no torque constant is stated of 'joint1', 'joint2'" in found["log.no-torque-constant"]
    found = refuse(
        LogError, read_recording, write("ur-rtde"), preset(make_robot(constants=(1.0, 1.0)), "ur-rtde")
    )
    assert "no gear is stated of 'joint1', 'joint2'" in found["log.no-torque-constant"]


def test_what_the_table_states_comes_first_and_what_lacks_is_said(make_robot, columns, write):
    robot = preset(make_robot(torque=(("state.dq[0]", "state.dq[1]"), "SI")), "franka")
    np.testing.assert_array_equal(read_recording(write("franka"), robot).torque, columns["q"])
    named = {
        key: ((f"{stem}[0]", f"{stem}[1]"), "SI")
        for key, stem in (("position", "state.q"), ("torque", "state.tau_J"))
    }
    robot = preset(make_robot(**named), "franka")
    np.testing.assert_array_equal(read_recording(write("franka"), robot).velocity, columns["q"])
    with pytest.raises(LogError) as caught:
        read_recording(write("franka"), preset(make_robot(), "ros"))
    texts = [notice.text for notice in caught.value.notices if notice.code == "log.preset"]
    assert "position: preset 'ros' needs field.position0, field.position1 or position_0" in texts[0]


def test_columns_of_words_are_passed_over(make_robot, tmp_path):
    path = tmp_path / "log.csv"
    rows = [f"{k},base_link,\"['a','b']\",{k},{k},1,2" for k in range(20)]
    path.write_text("\n".join(["Time,frame_id,name,position_0,position_1,effort_0,effort_1", *rows]))
    recording = read_recording(path, preset(make_robot(), "ros"))
    np.testing.assert_array_equal(recording.position[:, 1], np.arange(20))
    said = tell(recording.notices)
    assert said["log.unused-columns"].endswith(": frame_id, name")


@pytest.mark.parametrize(
    ("heading", "name", "said"),
    [
        ("Time,position_0,position_1,position_2,effort_0,effort_1", "ros", "'position_2' is one column more"),
        ("time,q[0],q[1],tau_J[0],tau_J[1],tau_J[2]", "franka", "'tau_J[2]' is one column more"),
        ("Time,/l/position[0],/l/position[1],/r/effort[0],/r/effort[1]", "ros", "torque: preset 'ros' needs"),
        (
            (
                "Time,/l/position[0],/l/position[1],/l/effort[0],/l/effort[1]"
                ",/r/position[0],/r/position[1],/r/effort[0],/r/effort[1]"
            ),
            "ros",
            "'/l', '/r' have such columns",
        ),
    ],
)
def test_columns_of_other_joints_are_refused(make_robot, tmp_path, heading, name, said):
    """Arrays that are longer than the robot, topics that are mixed, and commands are no measured joints."""
    rows = [",".join([str(k)] * len(heading.split(","))) for k in range(20)]
    (tmp_path / "log.csv").write_text("\n".join([heading, *rows]))
    with pytest.raises(LogError) as caught:
        read_recording(tmp_path / "log.csv", preset(make_robot(), name))
    assert any(said in notice.text for notice in caught.value.notices if notice.code == "log.preset")
