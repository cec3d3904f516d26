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
from tests.refusals import raises, refuse

N = 400
JOINTS = {
    "PLAIN": "joint1, joint2, joint3",
    "ARMS": "j1, j2, j3",
    "UR": "shoulder_pan, shoulder_lift, elbow",
    "PANDA": "panda_joint1, panda_joint2, panda_joint3",
    "IIWA": "joint_a1, joint_a2, joint_a3",
}


@dataclass(frozen=True)
class Case:
    """A heading: `#` stands for numbers from `first` on, `@` for names of joints, or `own` in their place.

    Args:
        columns: `=` marks those of position and torque that are read.
        result: what the page says; it begins with "read" or "refused".
        code: of the refusal; step: of time, in its unit; constant: N m/A of each motor; direct: no gears.
    """

    program: str
    columns: str
    joints: str
    result: str
    code: str = ""
    first: int = 0
    count: int = 3
    own: str = ""
    step: float = 0.01
    constant: float | None = None
    direct: bool = False

    def spread(self, pattern):
        """Return the columns of a pattern."""
        pattern = pattern.removeprefix("=")
        if "@" in pattern:
            return [pattern.replace("@", name) for name in (self.own or self.joints).split(", ")]
        if "#" in pattern:
            return [pattern.replace("#", str(self.first + k)) for k in range(self.count)]
        return [pattern]


# Program, columns, names of joints, the result, and what is not as usual.
TABLE = """
symid | t [s], =q# [rad], =tau# [N m] | joint1, joint2, jointGripper | read | first=1
symid, no units | t, =q#, =tau# | PLAIN | read, as SI units | first=1
libfranka | time, =q[#], q_d[#], =tau_J[#], dtau_J[#] | ARMS | read, time in ms | step=1
libfranka | time, =state.q[#], state.dq[#], =state.tau_J[#] | PANDA | read, time in ms | step=1
libfranka, flat | time, =q_#, dq_#, =tau_J_#, O_T_EE_# | PANDA | read, time in ms | step=1
libfranka, time in s | time, q[#], tau_J[#] | ARMS\
    | refused: no unit is stated | code=new.no-unit | step=0.001
arrays | t [s], =q[#] [rad], =tau_J[#] [N m] | ARMS | read, in the order of the joints
arrays of another length | t [s], q[#] [rad], tau_J[#] [N m] | ARMS\
    | refused: four columns for three joints | code=new.unknown-column | count=4
numbers that begin with 0, one too many | t [s], q_# [rad], tau_J_# [N m] | ARMS\
    | refused: `tau_J_1` is the first or the second joint | code=new.ambiguous-column | count=4
numbers that begin with 0 | t [s], =q_# [rad], =tau_J_# [N m] | ARMS | read, in the order of the joints
UR, RTDE | timestamp, target_q_#, =actual_q_#, actual_qd_#, =actual_current_#, target_moment_# | UR\
    | read, currents in A | constant=0.1 | direct=1
UR, RTDE | timestamp, =actual_q_#, =actual_current_# | UR\
    | refused: no gears | code=new.torque-constant | constant=0.1
UR, RTDE | timestamp, actual_q_#, actual_current_# | UR\
    | refused: no torque constants | code=new.torque-constant
UR, RTDE | timestamp, actual_q_#, target_moment_# | UR\
    | refused: `target_moment` is a command | code=new.unknown-column
KUKA, trace | Time [s], =$AXIS_ACT[#] [deg], =$TORQUE_AXIS_ACT[#] [Nm] | IIWA\
    | read, in the order of the joints | first=1
KUKA | Time [s], =AXIS_ACT# [deg], =MeasuredTorque_A# [Nm] | A1, A2, A3\
    | read, in the order of the joints | first=1
KUKA, no units | Time, AXIS_ACT#, MeasuredTorque_A# | PLAIN\
    | refused: no unit is stated | code=new.no-unit | first=1
KUKA, FRI | time [s], =msr_joint_pos[#] [rad], =msr_joint_trq[#] [Nm], cmd_joint_pos[#] [rad] | IIWA\
    | read, in the order of the joints
PlotJuggler | __time, =/joint_states/@/position, /joint_states/@/velocity, =/joint_states/@/effort | UR\
    | read, by the names of the joints
PlotJuggler, two topics | __time, /left/@/position, /left/@/effort, /right/@/position, /right/@/effort | UR\
    | refused: choose one by `topic` | code=log.topic
PlotJuggler, another prefix | __time, =/joint_states/@/position, =/joint_states/@/effort | PANDA\
    | read, with a warning | own=fer_joint1, fer_joint2, fer_joint3
rosbag to CSV | Time, =/joint_states/position[#], =/joint_states/effort[#] | UR\
    | read, in the order of the joints
rosbag to CSV, two topics | Time, /left/position[#], /right/effort[#] | UR\
    | refused: no topic has both | code=new.no-unit
rosbag to CSV, commands | Time, /target/position[#], /target/effort[#] | UR\
    | refused: they are commands | code=new.unknown-column
rosbag to CSV, arrays of another length | Time, /joint_states/position[#], /joint_states/effort[#] | UR\
    | refused: four columns for three joints | code=new.unknown-column | count=4
ROS | time, =position.@, velocity.@, =effort.@ | PLAIN | read, by the names of the joints
ROS | time, =position.@, velocity.@, =effort.@ | UR | read, by the names of the joints
rostopic echo -p | %time, =field.position#, =field.effort# | UR\
    | read, in the order of the joints | step=1e+07
a table of one's own | time [s], =@ pos [deg], @ target pos [deg], =@ torque [Nm] | UR\
    | read, by the names of the joints
joints out of order | time [s], pos# [rad], torque# [Nm] | axis_2, axis_1, axis_3\
    | refused: `pos1` is `axis_1` or the first joint | code=new.ambiguous-column | first=1
symid, joints out of order | t, =q#, =tau# | joint2, joint1, joint3\
    | read, in the order of the joints | first=1
symid, some joints with numbers | t, =q#, =tau# | elbow, wrist_1_joint, wrist_2_joint\
    | read, as SI units | first=1
symid, some joints with numbers | t, =q#, =tau# | base, joint1, joint2\
    | read, in the order of the joints | first=1
symid, joints from 0 on | t, =q#, =tau# | joint0, joint1, joint2 | read, in the order of the joints | first=1
"""
KINDS = {"first": int, "count": int, "step": float, "constant": float, "direct": bool}


def read_cases():
    for row in TABLE.strip().splitlines():
        program, columns, joints, result, *others = re.split(r"\s+\|\s+", row)
        pairs = (entry.split("=") for entry in others)
        more = {key: KINDS.get(key, str)(value) for key, value in pairs}
        yield Case(program, columns, JOINTS.get(joints, joints), result, **more)


CASES = tuple(read_cases())


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
            drive=Drive(torque_constant=case.constant, direct=case.direct),
        )
        for index, name in enumerate(case.joints.split(", "))
    )
    return RawLog(columns=columns, units=units), Robot(name="robot", joints=joints)


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.program}-{case.columns[:30]}")
def test_which_columns_are_read(case, tmp_path):
    raw, robot = build(case)
    findings = Findings(file="log.csv")
    if case.code:
        assert case.code in refuse(LogError, read_recording, tmp_path / "log.csv", robot, raw=raw)
        assert case.result.startswith("refused")
        return
    found, mapped = assign_columns(raw, robot, findings)
    names = [extract_quantity(found, mapped, key, N, findings)[1] for key in ("position", "torque")]
    read = [heading for heading in case.columns.split(", ") if heading.startswith("=")]
    assert names == [tuple(split_heading(column)[0] for column in case.spread(part)) for part in read]
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


def test_robots_without_a_table_are_told_what_lacks(tmp_path):
    raw, robot = build(CASES[7])
    text = refuse(LogError, read_recording, tmp_path / "log.csv", robot, raw=raw)["log.no-map"]
    assert "--set log.QUANTITY.columns=NAME,NAME" in text
    # A log with columns of symid's own names is told what these lack, not what other programs write.
    raw, robot = build(CASES[1])
    raw = replace(raw, columns={name: values for name, values in raw.columns.items() if name != "t"})
    with raises(LogError, "log.missing-column"):
        read_recording(tmp_path / "log.csv", robot, raw=raw)
