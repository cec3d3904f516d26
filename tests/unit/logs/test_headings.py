"""Headings of real programs: which are known without a [log] table, and which are refused."""

import re
from dataclasses import dataclass, replace

import numpy as np
import pytest

from symid.errors import LogError
from symid.logs.columns import Findings, extract_quantity, extract_time
from symid.logs.files import RawLog, split_heading
from symid.logs.reader import assign_columns, read_recording
from symid.robot.description import Drive, Joint, JointKind, Robot
from symid.robot.geometry import IDENTITY

N = 400
PLAIN, ARMS, UR = "joint1, joint2, joint3", "j1, j2, j3", "shoulder_pan, shoulder_lift, elbow"
PANDA, IIWA = "panda_joint1, panda_joint2, panda_joint3", "joint_a1, joint_a2, joint_a3"


@dataclass(frozen=True, kw_only=True)
class Case:
    """A heading: `#` stands for numbers from `first` on, `@` for names of joints, or `own` in their place.

    Args:
        result: what the page says; it begins with "read" or "refused".
        read: patterns of the columns of position and torque; code: of the refusal.
        step: of time, in its unit; constant: N m/A of each motor.
    """

    program: str
    columns: str
    joints: str = PLAIN
    result: str
    read: tuple[str, str] = ("", "")
    code: str = ""
    first: int = 0
    count: int = 3
    own: str = ""
    step: float = 0.01
    constant: float | None = None

    def spread(self, pattern):
        """Return the columns of a pattern."""
        if "@" in pattern:
            return [pattern.replace("@", name) for name in (self.own or self.joints).split(", ")]
        if "#" in pattern:
            return [pattern.replace("#", str(self.first + k)) for k in range(self.count)]
        return [pattern]


IN_ORDER = "read, in the order of the joints"
BY_NAME = "read, by the names of the joints"
CASES = (
    Case(
        program="symid",
        columns="t [s], q# [rad], tau# [N m]",
        first=1,
        joints="joint1, joint2, jointGripper",
        result="read",
        read=("q#", "tau#"),
    ),
    Case(
        program="symid, no units",
        columns="t, q#, tau#",
        first=1,
        result="read, as SI units",
        read=("q#", "tau#"),
    ),
    Case(
        program="libfranka",
        columns="time, q[#], q_d[#], tau_J[#], dtau_J[#]",
        joints=ARMS,
        step=1.0,
        result="read, time in ms",
        read=("q[#]", "tau_J[#]"),
    ),
    Case(
        program="libfranka",
        columns="time, state.q[#], state.dq[#], state.tau_J[#]",
        joints=PANDA,
        step=1.0,
        result="read, time in ms",
        read=("state.q[#]", "state.tau_J[#]"),
    ),
    Case(
        program="libfranka, flat",
        columns="time, q_#, dq_#, tau_J_#, O_T_EE_#",
        joints=PANDA,
        step=1.0,
        result="read, time in ms",
        read=("q_#", "tau_J_#"),
    ),
    Case(
        program="libfranka, time in s",
        columns="time, q[#], tau_J[#]",
        joints=ARMS,
        step=0.001,
        result="refused: no unit is stated",
        code="new.no-unit",
    ),
    Case(
        program="arrays",
        columns="t [s], q[#] [rad], tau_J[#] [N m]",
        joints=ARMS,
        result=IN_ORDER,
        read=("q[#]", "tau_J[#]"),
    ),
    Case(
        program="arrays of another length",
        columns="t [s], q[#] [rad], tau_J[#] [N m]",
        count=4,
        joints=ARMS,
        result="refused: four columns for three joints",
        code="new.unknown-column",
    ),
    Case(
        program="numbers that begin with 0, one too many",
        columns="t [s], q_# [rad], tau_J_# [N m]",
        count=4,
        joints=ARMS,
        result="refused: `tau_J_1` is the first or the second joint",
        code="new.ambiguous-column",
    ),
    Case(
        program="numbers that begin with 0",
        columns="t [s], q_# [rad], tau_J_# [N m]",
        joints=ARMS,
        result=IN_ORDER,
        read=("q_#", "tau_J_#"),
    ),
    Case(
        program="UR, RTDE",
        columns="timestamp, target_q_#, actual_q_#, actual_qd_#, actual_current_#, target_moment_#",
        joints=UR,
        constant=0.1,
        result="read, currents in A",
        read=("actual_q_#", "actual_current_#"),
    ),
    Case(
        program="UR, RTDE",
        columns="timestamp, actual_q_#, actual_current_#",
        joints=UR,
        result="refused: no torque constants",
        code="new.torque-constant",
    ),
    Case(
        program="UR, RTDE",
        columns="timestamp, actual_q_#, target_moment_#",
        joints=UR,
        result="refused: `target_moment` is a command",
        code="new.unknown-column",
    ),
    Case(
        program="KUKA, trace",
        columns="Time [s], $AXIS_ACT[#] [deg], $TORQUE_AXIS_ACT[#] [Nm]",
        first=1,
        joints=IIWA,
        result=IN_ORDER,
        read=("$AXIS_ACT[#]", "$TORQUE_AXIS_ACT[#]"),
    ),
    Case(
        program="KUKA",
        columns="Time [s], AXIS_ACT# [deg], MeasuredTorque_A# [Nm]",
        first=1,
        joints="A1, A2, A3",
        result=IN_ORDER,
        read=("AXIS_ACT#", "MeasuredTorque_A#"),
    ),
    Case(
        program="KUKA, no units",
        columns="Time, AXIS_ACT#, MeasuredTorque_A#",
        first=1,
        result="refused: no unit is stated",
        code="new.no-unit",
    ),
    Case(
        program="KUKA, FRI",
        columns="time [s], msr_joint_pos[#] [rad], msr_joint_trq[#] [Nm], cmd_joint_pos[#] [rad]",
        joints=IIWA,
        result=IN_ORDER,
        read=("msr_joint_pos[#]", "msr_joint_trq[#]"),
    ),
    Case(
        program="PlotJuggler",
        columns="__time, /joint_states/@/position, /joint_states/@/velocity, /joint_states/@/effort",
        joints=UR,
        result=BY_NAME,
        read=("/joint_states/@/position", "/joint_states/@/effort"),
    ),
    Case(
        program="PlotJuggler, two topics",
        columns="__time, /left/@/position, /left/@/effort, /right/@/position, /right/@/effort",
        joints=UR,
        result="refused: choose one by `topic`",
        code="log.topic",
    ),
    Case(
        program="PlotJuggler, another prefix",
        columns="__time, /joint_states/@/position, /joint_states/@/effort",
        joints=PANDA,
        own="fer_joint1, fer_joint2, fer_joint3",
        result="read, with a warning",
        read=("/joint_states/@/position", "/joint_states/@/effort"),
    ),
    Case(
        program="rosbag to CSV",
        columns="Time, /joint_states/position[#], /joint_states/effort[#]",
        joints=UR,
        result=IN_ORDER,
        read=("/joint_states/position[#]", "/joint_states/effort[#]"),
    ),
    Case(
        program="rosbag to CSV, two topics",
        columns="Time, /left/position[#], /right/effort[#]",
        joints=UR,
        result="refused: no topic has both",
        code="new.no-unit",
    ),
    Case(
        program="rosbag to CSV, commands",
        columns="Time, /target/position[#], /target/effort[#]",
        joints=UR,
        result="refused: they are commands",
        code="new.unknown-column",
    ),
    Case(
        program="rosbag to CSV, arrays of another length",
        columns="Time, /joint_states/position[#], /joint_states/effort[#]",
        count=4,
        joints=UR,
        result="refused: four columns for three joints",
        code="new.unknown-column",
    ),
    Case(
        program="ROS",
        columns="time, position.@, velocity.@, effort.@",
        joints=PLAIN,
        result=BY_NAME,
        read=("position.@", "effort.@"),
    ),
    Case(
        program="ROS",
        columns="time, position.@, velocity.@, effort.@",
        joints=UR,
        result=BY_NAME,
        read=("position.@", "effort.@"),
    ),
    Case(
        program="rostopic echo -p",
        columns="%time, field.position#, field.effort#",
        joints=UR,
        step=1e7,
        result=IN_ORDER,
        read=("field.position#", "field.effort#"),
    ),
    Case(
        program="a table of one's own",
        columns="time [s], @ pos [deg], @ target pos [deg], @ torque [Nm]",
        joints=UR,
        result=BY_NAME,
        read=("@ pos", "@ torque"),
    ),
    Case(
        program="joints out of order",
        columns="time [s], pos# [rad], torque# [Nm]",
        first=1,
        joints="axis_2, axis_1, axis_3",
        result="refused: `pos1` is `axis_1` or the first joint",
        code="new.ambiguous-column",
    ),
    Case(
        program="symid, joints out of order",
        columns="t, q#, tau#",
        first=1,
        joints="joint2, joint1, joint3",
        result=IN_ORDER,
        read=("q#", "tau#"),
    ),
    Case(
        program="symid, some joints with numbers",
        columns="t, q#, tau#",
        first=1,
        joints="elbow, wrist_1_joint, wrist_2_joint",
        result="read, as SI units",
        read=("q#", "tau#"),
    ),
    Case(
        program="symid, some joints with numbers",
        columns="t, q#, tau#",
        first=1,
        joints="base, joint1, joint2",
        result=IN_ORDER,
        read=("q#", "tau#"),
    ),
    Case(
        program="symid, joints from 0 on",
        columns="t, q#, tau#",
        first=1,
        joints="joint0, joint1, joint2",
        result=IN_ORDER,
        read=("q#", "tau#"),
    ),
)


def build(case):
    """Return the log of a case, and its robot."""
    columns, units = {}, {}
    for heading in case.columns.split(", "):
        for name, unit in map(split_heading, case.spread(heading)):
            k = len(columns)
            columns[name] = np.sin(0.01 * (k + 1) * np.arange(N)) if k else case.step * np.arange(N)
            if unit:
                units[name] = unit
    joints = tuple(
        Joint(
            name=name,
            kind=JointKind.REVOLUTE,
            parent=index - 1,
            placement=IDENTITY,
            drive=Drive(torque_constant=case.constant),
        )
        for index, name in enumerate(case.joints.split(", "))
    )
    return RawLog(columns=columns, units=units), Robot(name="robot", joints=joints)


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.program}-{case.columns[:30]}")
def test_which_columns_are_read(case, tmp_path):
    raw, robot = build(case)
    findings = Findings(file="log.csv")
    if case.code:
        with pytest.raises(LogError) as caught:
            read_recording(tmp_path / "log.csv", robot, raw=raw)
        assert case.code in {notice.code for notice in caught.value.notices}
        assert case.result.startswith("refused")
        return
    found, mapped = assign_columns(raw, robot, findings)
    names = [extract_quantity(found, mapped, key, N, findings)[1] for key in ("position", "torque")]
    assert names == [tuple(case.spread(pattern)) for pattern in case.read]
    time, _ = extract_time(found, mapped, findings)
    # The first column is time, and its unit is known.
    assert np.ptp(time) / (N - 1) == pytest.approx(0.01 if case.step in {0.01, 1e7} else 0.001)
    codes = {notice.code for notice in findings.remarks}
    assert ("new.assumed-order" in codes) == ("in the order" in case.result)
    assert ("log.joint-names" in codes) == ("warning" in case.result)
    assert not findings.mistakes


def list_rows():
    """Yield the rows of the page."""
    for case in CASES:
        # Of each pattern the first column.
        shown = ", ".join(f"`{case.spread(heading)[0]}`" for heading in case.columns.split(", "))
        yield f"| {case.program} | {shown} | {case.joints} | {case.result} |"


def test_the_page_has_the_same_table(project):
    text = (project / "docs" / "logs.md").read_text(encoding="utf-8")
    table = re.search(r"\| program \| columns.*\n\|---.*\n((?:\|.*\n)+)", text)
    assert table is not None
    assert table[1].splitlines() == list(list_rows())


def test_a_robot_without_a_table_says_how_to_get_one(tmp_path):
    raw, robot = build(CASES[7])
    with pytest.raises(LogError) as caught:
        read_recording(tmp_path / "log.csv", robot, raw=raw)
    text = {notice.code: notice.text for notice in caught.value.notices}["log.no-map"]
    assert "--set log.QUANTITY.columns=NAME,NAME" in text


def test_columns_of_symid_keep_their_messages(tmp_path):
    """A log with columns of symid's own names is told what these lack, not what other programs write."""
    raw, robot = build(CASES[1])
    raw = replace(raw, columns={name: values for name, values in raw.columns.items() if name != "t"})
    with pytest.raises(LogError) as caught:
        read_recording(tmp_path / "log.csv", robot, raw=raw)
    assert {notice.code for notice in caught.value.notices} == {"log.missing-column"}
