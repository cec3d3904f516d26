"""What is wrong with an elastic joint is told with its place, what is allowed and what to do."""

import re

import pytest

from symid.joint_models.hysteresis import Elasticity, Knee, Stop
from symid.robot.toml_reader import parse_robot
from tests.mistakes import refuse, take_mark

UNKNOWN, RANGE, INVALID = "robot.unknown-key", "robot.out-of-range", "robot.invalid-elasticity"
MIXED, VALUES = "robot.elasticity-mixed", "robot.friction-values"
HEAD = 'convention = "modified"\ngravity = [0, 0, -9.81]\n[[joint]]\nname = "shoulder"\nkind = "revolute"\n'
TABLE = "[joint.elasticity]\n"
SPRING = TABLE + "stiffness = 380\n"
STOP = "^stops = [{ threshold = 0.5, stiffness = 5 }]\n"
GENERAL = 'model = ^"generalised-maxwell-slip"\nFc = 1\nstiffnesses = [1, 2]\n'
# What stands behind the stiffness; "^" marks the place that is told.
IN_SPRING = [
    (UNKNOWN, "^stop = []", "did you mean stops?"),
    (RANGE, "damping = ^-1", "at least 0 N*m*s/rad"),
    ("robot.wrong-type", 'cubic = ^"3 N/m"', "expected a number in N*m/rad^3"),
    (RANGE, "cubic = ^-2", "at least 0 N*m/rad^3"),
    ("robot.wrong-type", "stops = ^{ threshold = 1 }", "stops = [{ threshold = 0.002"),
    ("robot.wrong-type", "stops = ^[3]", "stops = [{ threshold"),
    ("robot.missing-key", "stops = [^{ threshold = 1 }]", "stiffness = a number in N*m/rad"),
    ("robot.missing-key", "stops = [^{ stiffness = 1 }]", "in rad"),
    (UNKNOWN, "stops = [{ ^treshold = 1, threshold = 2, stiffness = 1 }]", "did you mean threshold?"),
    (RANGE, "stops = [{ threshold = ^0, stiffness = 1 }]", "than 0 rad"),
    (RANGE, "stops = [{ threshold = 1, stiffness = ^-1 }]", "least 0 N*m/rad"),
    (
        RANGE,
        "stops = [\n  { threshold = 1, stiffness = 1 },\n  { threshold = ^1, stiffness = 2 },\n]",
        "elasticity: stops 2: threshold: ",
    ),
    (RANGE, "knees = [{ threshold = ^0, slope = 1 }]", "threshold: must"),
    (RANGE, "symmetric = true\nknees = [{ threshold = ^-1, slope = 1 }]", "than 0 N*m"),
    (RANGE, "knees = [{ threshold = 2, slope = 1 }, { threshold = ^1, slope = 1 }]", "knees 2: threshold: "),
    ("robot.missing-key", "knees = [^{ threshold = 2 }]", "write slope = a number"),
    ("robot.wrong-type", "symmetric = ^1\nknees = []", "expected true or false"),
    (MIXED, "^symmetric = true", "symmetric: "),
    (MIXED, "^cubic = 5\nknees = [{ threshold = 2, slope = 1 }]", "cubic: "),
    (INVALID, "knees = ^[{ threshold = 2, slope = -1 }]", "knees: beyond 2 "),
    ("robot.bad-choice", 'model = ^"bouc"', "did you mean bouc-wen?"),
    ("robot.bad-choice", "model = ^3", "expected one of"),
    (UNKNOWN, 'model = "dahl"\nFc = 1\nsigma0 = 2\n^level = 3', "allowed are"),
    (UNKNOWN, "^level = 3", "allowed are"),
    (RANGE, 'model = "bouc-wen"\nlevel = 3\nlength = 1\nloop = ^0.2', "at least 0.5"),
    (INVALID, 'model = ^"bouc-wen"\nlevel = 3\nlength = 1\nskew = 1', "skew must"),
    ("robot.wrong-type", 'model = "maxwell-slip"\nstiffnesses = ^3\nforces = [1]', "a list of numbers"),
    ("robot.wrong-type", 'model = "maxwell-slip"\nstiffnesses = [^"a"]\nforces = [1]', "a number"),
    (INVALID, 'model = ^"maxwell-slip"\nstiffnesses = [1, 2]\nforces = [1]', "need as many forces"),
    (INVALID, GENERAL + "shares = [1]", "need as many shares"),
    ("robot.missing-key", "^[[joint.elasticity.branch]]\nlevel = 1", "write one of bouc-wen"),
    (MIXED, STOP + 'model = "maxwell-slip"\nstiffnesses = [2]\nforces = [1]', "slips at 0.5"),
    (RANGE, "backlash = ^-1", "at least 0 rad"),
    ("robot.wrong-type", "branch = ^3", "two brackets"),
]
IN_JOINT = [
    ("robot.missing-key", "^" + SPRING + 'model = "bouc-wen"\nlevel = 3', "a number in rad"),
    ("robot.missing-key", "^" + SPRING + 'model = "lugre"\nFc = 1\nsigma0 = 2\nFe = 1', "where Fe is not 0"),
    ("robot.missing-key", "^" + TABLE + "damping = 1", 'or stiffness = "unknown"'),
    (
        MIXED,
        TABLE + "^stiffness = 380\ncatalogue = { K1 = 1, K2 = 2, K3 = 3, T1 = 1, T2 = 2 }",
        "stiffness: ",
    ),
    (
        "robot.missing-key",
        TABLE + "catalogue = ^{ K1 = 1, K2 = 2, K3 = 3, T1 = 1 }",
        "T2: missing; catalogue = { K1 = .., K2 = ..",
    ),
    (RANGE, TABLE + "catalogue = { K1 = 1, K2 = 2, K3 = 3, T1 = 2, T2 = ^2 }", "T1 = 2"),
    (RANGE, TABLE + "catalogue = { K1 = ^0, K2 = 2, K3 = 3, T1 = 2, T2 = 3 }", "than 0 N*m/rad"),
    ("robot.wrong-type", TABLE + "catalogue = ^3", "expected a table"),
    (RANGE, '[joint.friction]\nmodel = "coulomb-viscous"\nsmoothing = ^0', "greater than 0 rad/s"),
    (VALUES, '[joint.friction]\nmodel = "none"\n^smoothing = 0.1', 'the model "none" has no friction'),
]


@pytest.mark.parametrize(
    ("code", "text", "words"), [*((code, SPRING + text, words) for code, text, words in IN_SPRING), *IN_JOINT]
)
def test_a_mistake_has_a_place_and_a_remedy(code, text, words):
    text, place = take_mark(HEAD + text)
    (notice,) = refuse(parse_robot, text, "arm.toml")
    assert (notice.code, notice.file, (notice.line, notice.column)) == (code, "arm.toml", place)
    assert words in notice.text
    assert notice.text.startswith(("joint 'shoulder': ", "branch 1: "))


def test_all_mistakes_of_a_table_are_told_at_once():
    text = HEAD + SPRING + "damping = -1\nstops = [{ threshold = 0, stiffness = 1 }, 3]\nsymmetric = true\n"
    assert [notice.line for notice in refuse(parse_robot, text)] == [8, 9, 10]


def test_units_are_those_of_a_slide():
    text = HEAD + TABLE + "stiffness = -1\nstops = [{ threshold = 0, stiffness = 1 }]\n"
    first, second = refuse(parse_robot, text.replace("revolute", "prismatic"))
    assert "greater than 0 N/m" in first.text
    assert "greater than 0 m," in second.text


def test_a_notice_tells_the_two_sides_apart():
    (notice,) = parse_robot(HEAD + SPRING).notices
    assert (notice.code, notice.line) == ("robot.elastic-joint", 6)
    assert "link position" in notice.text


def test_the_initial_stiffness_adds_all_stops():
    stops = (Stop(threshold=0.002, stiffness=120.0), Stop(threshold=0.005, stiffness=60.0))
    assert Elasticity(stiffness=380.0, stops=stops).initial_stiffness == 560.0
    assert Elasticity(stops=stops).initial_stiffness is None


@pytest.mark.parametrize(
    ("stops", "knees", "said"),
    [
        ((0.005, 0.002), (), "of stops"),
        ((0.0,), (), "of stops"),
        ((float("nan"),), (), "of stops"),
        ((), ((0.0, 0.5),), "of knees"),
        ((), ((2.0, 0.5), (1.0, 0.5)), "of knees"),
        ((), ((1.0, -0.5), (2.0, -0.6)), "beyond 2 .* -0.1"),
        ((), ((-2.0, -0.6), (-1.0, -0.5)), "beyond -2 .* -0.1"),
    ],
)
def test_what_is_no_spring_is_refused(stops, knees, said):
    stops = tuple(Stop(threshold=threshold) for threshold in stops)
    knees = tuple(Knee(threshold=threshold, slope=slope) for threshold, slope in knees)
    (notice,) = refuse(Elasticity, stiffness=1.0, stops=stops, knees=knees)
    assert notice.code == "robot.invalid-elasticity"
    assert re.search(said, notice.text)
