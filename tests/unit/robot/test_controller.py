"""The `[controller]` table: read, refused in words, written back, overridden."""

import pytest

from symid.errors import RobotError, UsageError
from symid.robot.description import Controller
from symid.robot.loading import override_robot
from symid.robot.toml_reader import parse_robot
from symid.robot.toml_writer import write_robot
from tests.mistakes import refuse

HEAD = """
convention = "modified"
gravity = [0, 0, -9.81]
[[joint]]
kind = "revolute"
[[joint]]
kind = "prismatic"
"""


def read(text):
    return parse_robot(f"{HEAD}\n[controller]\n{text}")


def list_refused(text):
    return {notice.code: notice.text for notice in refuse(read, text)}


def test_every_key_comes_back_from_a_written_file():
    robot = read(
        'stiffness = [400, 6000]\ndamping = [25, 300]\nvelocity = "measured"\nvelocity_source = "sensor"\n'
        'velocity_filter = 150\noffset = [3, -1.5]\ntorque = "average"'
    )
    assert robot.controller == Controller(
        stiffness=(400.0, 6000.0),
        damping=(25.0, 300.0),
        velocity="measured",
        velocity_source="sensor",
        velocity_filter=150.0,
        offset=(3.0, -1.5),
        torque="average",
    )
    assert parse_robot(write_robot(robot)).controller == robot.controller


def test_one_number_stands_for_all_joints_of_one_kind():
    text = HEAD.replace("prismatic", "revolute")
    robot = parse_robot(f"{text}\n[controller]\nstiffness = 400\ndamping = [25]\noffset = 'log'")
    assert robot.controller == Controller(stiffness=(400.0, 400.0), damping=(25.0, 25.0))
    assert (
        "controller: stiffness: " in list_refused("stiffness = 400\ndamping = [1, 1]")["robot.column-count"]
    )


@pytest.mark.parametrize(
    ("text", "code", "said"),
    [
        ("damping = [1, 1]", "robot.missing-key", "stiffness"),
        ("stiffness = [1, 1, 1]\ndamping = [1, 1]", "robot.column-count", "3 numbers for 2 joints"),
        ("stiffness = ['a', 1]\ndamping = [1, 1]", "robot.wrong-type", "N*m/rad"),
        ("stiffness = [1, -1]\ndamping = [1, 1]", "robot.out-of-range", "N/m"),
        ("stiffness = [1, 1]\ndamping = [1, 1]\nvelocity = 'ref'", "robot.bad-choice", "error"),
        ("stiffness = [1, 1]\ndamping = [1, 1]\nvelocity_filter = 0", "robot.out-of-range", "Hz"),
        ("stiffness = [1, 1]\ndamping = [1, 1]\noffset = 'weight'", "robot.wrong-type", '"log"'),
        ("stiffness = [1, 1]\ndamping = [1, 1]\nkp = 3", "robot.unknown-key", "kp: "),
    ],
)
def test_mistakes_are_told_in_words(text, code, said):
    assert said in list_refused(text)[code]


def test_gains_of_a_file_whose_joints_are_lost_are_read():
    lost = HEAD.replace("[[joint]]", "[[joints]]")
    notices = refuse(parse_robot, f"{lost}\n[controller]\nstiffness = -1\ndamping = 25")
    assert {"robot.unknown-key", "robot.out-of-range"} <= {notice.code for notice in notices}


def test_the_command_line_states_gains_too():
    robot = parse_robot(HEAD)
    pairs = [("controller.stiffness", "400,6000"), ("controller.damping", "[25, 300]")]
    changed = override_robot(robot, pairs)
    assert changed.controller == Controller(stiffness=(400.0, 6000.0), damping=(25.0, 300.0))
    again = override_robot(changed, [("controller.velocity_filter", "80")])
    assert again.controller.velocity_filter == 80.0
    assert again.controller.stiffness == (400.0, 6000.0)
    with pytest.raises(RobotError, match="damping"):
        override_robot(robot, pairs[:1])
    with pytest.raises(UsageError, match="did you mean controller"):
        override_robot(robot, [("control.stiffness", "400")])
