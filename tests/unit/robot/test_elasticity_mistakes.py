"""What is wrong with an elastic joint's table is told with its place, what is allowed and what to do."""

import pytest

from symid.errors import RobotError
from symid.robot.toml_reader import parse_robot

HEAD = 'convention = "modified"\ngravity = [0, 0, -9.81]\n[[joint]]\nname = "shoulder"\nkind = "revolute"\n'
TABLE = "[joint.elasticity]\n"
SPRING = TABLE + "stiffness = 380\n"
MISTAKES = [
    ("robot.unknown-key", SPRING + "stop = []\n", 8, 1, "did you mean stops?"),
    ("robot.out-of-range", SPRING + "damping = -1\n", 8, 11, "at least 0 N*m*s/rad"),
    ("robot.wrong-type", SPRING + 'cubic = "3 N/m"\n', 8, 9, "expected a number in N*m/rad^3"),
    ("robot.out-of-range", SPRING + "cubic = -2\n", 8, 9, "at least 0 N*m/rad^3"),
    ("robot.wrong-type", SPRING + "stops = { threshold = 1 }\n", 8, 9, "stops = [{ threshold = 0.002"),
    ("robot.wrong-type", SPRING + "stops = [3]\n", 8, 9, "stops = [{ threshold"),
    ("robot.missing-key", SPRING + "stops = [{ threshold = 1 }]\n", 8, 10, "stiffness = a number in N*m/rad"),
    ("robot.missing-key", SPRING + "stops = [{ stiffness = 1 }]\n", 8, 10, "in rad"),
    (
        "robot.unknown-key",
        SPRING + "stops = [{ treshold = 1, threshold = 2, stiffness = 1 }]\n",
        8,
        12,
        "did you mean threshold?",
    ),
    (
        "robot.out-of-range",
        SPRING + "stops = [{ threshold = 0, stiffness = 1 }]\n",
        8,
        24,
        "than 0 rad",
    ),
    (
        "robot.out-of-range",
        SPRING + "stops = [{ threshold = 1, stiffness = -1 }]\n",
        8,
        39,
        "least 0 N*m/rad",
    ),
    (
        "robot.out-of-range",
        SPRING + "stops = [\n  { threshold = 1, stiffness = 1 },\n  { threshold = 1, stiffness = 2 },\n]\n",
        10,
        17,
        "elasticity: stops 2: threshold: ",
    ),
    (
        "robot.out-of-range",
        SPRING + "knees = [{ threshold = 0, slope = 1 }]\n",
        8,
        24,
        "threshold: must",
    ),
    (
        "robot.out-of-range",
        SPRING + "symmetric = true\nknees = [{ threshold = -1, slope = 1 }]\n",
        9,
        24,
        "than 0 N*m",
    ),
    (
        "robot.out-of-range",
        SPRING + "knees = [{ threshold = 2, slope = 1 }, { threshold = 1, slope = 1 }]\n",
        8,
        54,
        "knees 2: threshold: ",
    ),
    ("robot.missing-key", SPRING + "knees = [{ threshold = 2 }]\n", 8, 10, "write slope = a number"),
    ("robot.wrong-type", SPRING + "symmetric = 1\nknees = []\n", 8, 13, "expected true or false"),
    ("robot.elasticity-mixed", SPRING + "symmetric = true\n", 8, 1, "symmetric: "),
    (
        "robot.elasticity-mixed",
        SPRING + "cubic = 5\nknees = [{ threshold = 2, slope = 1 }]\n",
        8,
        1,
        "cubic: ",
    ),
    (
        "robot.invalid-elasticity",
        SPRING + "knees = [{ threshold = 2, slope = -1 }]\n",
        8,
        9,
        "knees: beyond 2 ",
    ),
    ("robot.missing-key", TABLE + "damping = 1\n", 6, 1, 'or stiffness = "unknown"'),
    (
        "robot.elasticity-mixed",
        SPRING + "catalogue = { K1 = 1, K2 = 2, K3 = 3, T1 = 1, T2 = 2 }\n",
        7,
        1,
        "stiffness: ",
    ),
    (
        "robot.missing-key",
        TABLE + "catalogue = { K1 = 1, K2 = 2, K3 = 3, T1 = 1 }\n",
        7,
        13,
        "T2: missing; catalogue = { K1 = .., K2 = ..",
    ),
    (
        "robot.out-of-range",
        TABLE + "catalogue = { K1 = 1, K2 = 2, K3 = 3, T1 = 2, T2 = 2 }\n",
        7,
        52,
        "T1 = 2",
    ),
    (
        "robot.out-of-range",
        TABLE + "catalogue = { K1 = 0, K2 = 2, K3 = 3, T1 = 2, T2 = 3 }\n",
        7,
        20,
        "than 0 N*m/rad",
    ),
    ("robot.wrong-type", TABLE + "catalogue = 3\n", 7, 13, "expected a table"),
    (
        "robot.out-of-range",
        '[joint.friction]\nmodel = "coulomb-viscous"\nsmoothing = 0\n',
        8,
        13,
        "greater than 0 rad/s",
    ),
    (
        "robot.friction-values",
        '[joint.friction]\nmodel = "none"\nsmoothing = 0.1\n',
        8,
        1,
        'the model "none" has no friction',
    ),
]


@pytest.mark.parametrize(("code", "text", "line", "column", "words"), MISTAKES)
def test_a_mistake_has_a_place_and_a_remedy(code, text, line, column, words):
    with pytest.raises(RobotError) as caught:
        parse_robot(HEAD + text, "arm.toml")
    (notice,) = caught.value.notices
    assert (notice.code, notice.file, notice.line, notice.column) == (code, "arm.toml", line, column)
    assert words in notice.text
    assert notice.text.startswith("joint 'shoulder': ")


def test_all_mistakes_of_a_table_are_told_at_once():
    text = HEAD + SPRING + "damping = -1\nstops = [{ threshold = 0, stiffness = 1 }, 3]\nsymmetric = true\n"
    with pytest.raises(RobotError) as caught:
        parse_robot(text)
    assert [notice.line for notice in caught.value.notices] == [8, 9, 10]


def test_units_are_those_of_a_slide():
    text = (HEAD + TABLE + "stiffness = -1\nstops = [{ threshold = 0, stiffness = 1 }]\n").replace(
        "revolute", "prismatic"
    )
    with pytest.raises(RobotError) as caught:
        parse_robot(text)
    first, second = caught.value.notices
    assert "greater than 0 N/m" in first.text
    assert "greater than 0 m," in second.text


def test_a_notice_tells_the_two_sides_apart():
    (notice,) = parse_robot(HEAD + SPRING).notices
    assert (notice.code, notice.line) == ("robot.elastic-joint", 6)
    assert "link position" in notice.text
