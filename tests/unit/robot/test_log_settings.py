"""The `[log]` table: transmission matrices, zeros of positions, and what is said of wrong ones."""

import math

import numpy as np
import pytest

from symid.robot.loading import override_robot
from symid.robot.toml_reader import read_robot
from symid.robot.toml_writer import write_robot
from tests.mistakes import refuse

HEAD = 'name = "arm"\nconvention = "modified"\ngravity = [0, 0, -9.81]\n'
JOINT = '[[joint]]\nkind = "revolute"\n'
POSITION = 'position = { columns = ["q"], unit = "rad", side = "motor"'


@pytest.fixture
def read(tmp_path):
    def build(log, joints=2 * JOINT):
        path = tmp_path / "arm.toml"
        path.write_text(f"{HEAD}{joints}[log]\n{log}\n")
        return read_robot(path)

    return build


def test_entries_are_numbers_or_expressions(read):
    robot = read(f'transmission = [[50, "-1/3"], ["2*pi", "sqrt(2)*pi"]]\n{POSITION} }}')
    np.testing.assert_allclose(robot.log.transmission, [[50, -1 / 3], [math.tau, math.sqrt(2) * math.pi]])
    assert robot.log.position.side == "motor"


def test_zeros_are_one_for_all_or_one_a_joint(read):
    robot = read(POSITION + ', offset = [0, "-pi/2"] }')
    assert robot.log.position.offset == (0.0, -math.pi / 2)
    assert read(POSITION + ', offset = "90 deg" }').log.position.offset == (math.pi / 2,)
    assert read(POSITION + " }").log.position.offset == (0.0,)


def test_matrix_and_zeros_survive_writing_and_overriding(read, tmp_path):
    robot = read(f'transmission = [[50, 0], ["-1/3", 60]]\n{POSITION}, offset = [0.1, "pi"] }}')
    path = tmp_path / "again.toml"
    path.write_text(write_robot(robot))
    assert read_robot(path).log == robot.log
    assert override_robot(robot, [("log.torque.columns", "u"), ("log.torque.unit", "N m")]).log.position == (
        robot.log.position
    )
    other = override_robot(robot, [("log.transmission", "[[1, 0], [1, 1]]"), ("log.position.offset", "0")])
    assert other.log.transmission == ((1.0, 0.0), (1.0, 1.0))
    assert other.log.position.offset == (0.0,)


@pytest.mark.parametrize(
    ("log", "code", "text"),
    [
        ("transmission = 3", "robot.transmission-shape", "2 rows of 2 numbers"),
        ("transmission = [[1, 0]]", "robot.transmission-shape", "got 1 rows (2)"),
        ("transmission = [[1, 0], [0, 1, 2]]", "robot.transmission-shape", "got 2 rows (2, 3)"),
        ("transmission = [[1, 0], 3]", "robot.transmission-shape", "got 2 rows (2, no list)"),
        ('transmission = [[1, 0], [0, "L1"]]', "robot.wrong-type", 'expected a number, such as 0.5, "-pi/2"'),
        ("transmission = [[1, 1], [2, 2]]", "robot.transmission-singular", "transmission: the matrix"),
        ("transmission = [[1, 0], [0, 0]]", "robot.transmission-singular", "transmission: the matrix"),
        ("transmission = [[1, 1], [1, 1.0000001]]", "robot.transmission-singular", "nearly singular"),
        (POSITION + ", offset = [1, 2, 3] }", "robot.column-count", "3 offsets for 2 joints"),
        (POSITION + ', offset = [1, "two"] }', "robot.wrong-type", 'expected rad or m, such as 0.5, "-pi/2"'),
        (POSITION + ", offset = true }", "robot.wrong-type", "got true"),
        ('torque = { columns = ["u"], unit = "N m", offset = 1 }', "robot.unknown-key", "offset: "),
    ],
)
def test_mistakes_have_a_sentence(read, log, code, text):
    assert text in {notice.code: notice.text for notice in refuse(read, log)}[code]


def test_currents_need_no_gear_beside_a_matrix(read):
    drive = "drive = { gear = 50, torque_constant = 0.2 }\n"
    log = 'torque = { columns = ["i"], unit = "A" }'
    robot = read(f"transmission = [[50, 0], [50, 50]]\n{log}", 2 * (JOINT + drive))
    assert (robot.log.torque.factor, robot.log.torque.side) == ((0.2, 0.2), "motor")
    alone = read(log, 2 * (JOINT + drive))
    assert (alone.log.torque.factor, alone.log.torque.side) == ((10.0, 10.0), "joint")


def test_a_matrix_may_turn_angles_into_lengths_and_its_scale_makes_it_no_worse(read):
    slide = '[[joint]]\nkind = "prismatic"\n'
    robot = read(f"transmission = [[50, 0], [0, 1e9]]\n{POSITION} }}", JOINT + slide)
    assert robot.log.position.unit == "rad"
