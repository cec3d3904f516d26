"""Robot files: what is read, and what each mistake is told."""

import re

import pytest

from symid.errors import RobotError
from symid.robot.description import JointKind
from symid.robot.geometry import Exact
from symid.robot.toml_reader import parse_robot, read_robot

HEAD = 'convention = "modified"\ngravity = [0, 0, -9.81]\n'
JOINT = '[[joint]]\nname = "shoulder"\nkind = "revolute"\n'


def test_many_mistakes_are_told_at_once_with_their_places():
    text = """name = "arm"
gravity = [0, 0, "down"]
[[joint]]
name = "shoulder"
kind = "revolut"
alfa = 0
  [joint.drive]
  gear = 50
  rotor_inertia = "1e-5 kg"
  rotor_inertia_side = "motor"
[[joint]]
name = "elbow"
kind = "revolute"
parent = "sholder"
d = "L1"
"""
    with pytest.raises(RobotError) as caught:
        parse_robot(text, "arm.toml")
    lines = [str(notice) for notice in caught.value.notices]
    assert len(lines) == 7
    assert lines[0].startswith("arm.toml:1:1: convention: ")
    assert lines[1] == (
        "arm.toml:2:18: gravity: the symbol down has no value in [symbols]; "
        "write down = 9.81 (its value in m/s^2) there"
    )
    assert lines[2].startswith(
        "arm.toml:5:8: joint 'shoulder': kind: expected one of "
        '"revolute", "continuous", "prismatic", "fixed", got "revolut"'
    )
    assert lines[3] == (
        "arm.toml:6:1: joint 'shoulder': alfa: no such key here; did you mean alpha? "
        "allowed are name, kind, parent, alpha, a, d, theta, origin, frame, mimic, link, drive, friction, "
        "spring, elasticity, limits"
    )
    assert lines[4] == (
        "arm.toml:9:19: joint 'shoulder': rotor_inertia: "
        'expected a number in kg*m^2 or "unknown", got "1e-5 kg" (kg is not a unit of inertia)'
    )
    assert lines[5] == (
        "arm.toml:14:10: joint 'elbow': parent: there is no joint \"sholder\"; did you mean shoulder?"
    )
    assert lines[6].startswith("arm.toml:15:5: joint 'elbow': d: the symbol L1 ")
    assert str(caught.value).count("\n") == 6


MISTAKES = [
    ("robot.syntax", "gravity = [0, 0\n", 2, 1, "TOML: "),
    ("robot.syntax", "name = = 1\n", 1, 8, "TOML: "),
    ("robot.missing-key", 'convention = "modified"\n' + JOINT, 1, 1, "gravity = [0, 0, -9.81]"),
    ("robot.missing-key", HEAD, 1, 1, "[[joint]]"),
    ("robot.missing-key", HEAD + '[[joint]]\nname = "a"\n', 3, 1, 'kind = "revolute"'),
    ("robot.out-of-range", HEAD + JOINT + "[processing.decimation]\nfactor = 1001\n", 7, 10, "at most 1000"),
    ("robot.missing-key", HEAD + JOINT + "link = { com = [0, 0, 1] }\n", 6, 8, "mass = 1.5"),
    ("robot.missing-key", HEAD + JOINT + "link = { standard = { XX = 1 } }\n", 6, 21, "M = 1.5"),
    ("robot.missing-key", HEAD + JOINT + "friction = { Fv = 1 }\n", 6, 12, 'model = "coulomb-viscous"'),
    (
        "robot.friction-model",
        HEAD + JOINT + 'friction = { model = "viscous", Fv = 1 }\n',
        6,
        22,
        "unknown friction law 'viscous'; did you mean coulomb-viscous or ",
    ),
    (
        "robot.friction-elements",
        HEAD + JOINT + 'friction = { model = "maxwell-slip", stiffness = [9, 1], share = [1] }\n',
        6,
        66,
        "1 numbers for the 2 of stiffness",
    ),
    ("robot.missing-key", HEAD + JOINT + '[log]\ntime = { unit = "s" }\n', 7, 8, 'column = "t"'),
    ("robot.missing-key", HEAD + JOINT + '[log]\ntorque = { unit = "N m" }\n', 7, 10, "columns ="),
    ("robot.missing-key", HEAD + JOINT + '[log]\ntorque = { columns = ["u"] }\n', 7, 10, 'unit = "N m"'),
    ("robot.unknown-key", HEAD + JOINT + "[procesing]\n", 6, 2, "did you mean processing?"),
    ("robot.unknown-key", HEAD + JOINT + "zzz = 1\n", 6, 1, "allowed are name, kind"),
    ("robot.wrong-type", "name = 3\n" + HEAD + JOINT, 1, 8, 'expected a text in "quotes", got 3'),
    ("robot.wrong-type", HEAD + "[joint]\n", 3, 1, "joint: expected [[joint]]"),
    ("robot.wrong-type", HEAD + JOINT + "link = 3\n", 6, 8, "expected a table, got 3"),
    ("robot.wrong-type", HEAD + JOINT + "[processing]\nfilter_torque = 1\n", 7, 17, "true or false, got 1"),
    ("robot.wrong-type", HEAD + JOINT + "[processing]\ndrop_first = 1.0\n", 7, 14, "whole number, got 1.0"),
    ("robot.wrong-type", HEAD + JOINT + "limits = { position = [0] }\n", 6, 23, "list of 2 numbers in rad"),
    ("robot.wrong-type", HEAD + JOINT + 'limits = { torque = "3 N m" }\n', 6, 21, "alone, in N*m"),
    ("robot.wrong-type", HEAD + JOINT + "limits = { torque = inf }\n", 6, 21, "torque: "),
    ("robot.wrong-type", HEAD + JOINT + "link = { mass = 1e400 }\n", 6, 17, "sensible size and length"),
    ("robot.wrong-type", HEAD + JOINT + '[log]\ntorque = { columns = [1], unit = "N m" }\n', 7, 22, "texts"),
    (
        "robot.wrong-type",
        HEAD + JOINT + '[log]\ntorque = { columns = ["u"], unit = "V", factor = 0 }\n',
        7,
        50,
        "other than 0",
    ),
    (
        "robot.bad-choice",
        'convention = "modifed"\ngravity = [0, 0, 1]\n' + JOINT,
        1,
        14,
        "did you mean modified?",
    ),
    ("robot.bad-name", 'name = "my arm"\n' + HEAD + JOINT, 1, 8, '"my arm"'),
    ("robot.bad-name", HEAD + '[[joint]]\nname = "base"\nkind = "revolute"\n', 4, 8, 'name: "base"'),
    ("robot.bad-name", HEAD + "[symbols]\nq1 = 2\n" + JOINT, 4, 1, "symbols: q1:"),
    ("robot.duplicate-joint", HEAD + JOINT + JOINT, 7, 8, "by joint 1;"),
    ("robot.unknown-parent", HEAD + JOINT + 'parent = "wrist"\n', 6, 10, "allowed are base"),
    (
        "robot.unknown-parent",
        HEAD + JOINT + 'parent = "wrist"\n[[joint]]\nname = "wrist"\nkind = "revolute"\n',
        6,
        10,
        'parent: "wrist" ',
    ),
    ("robot.bad-angle", HEAD + JOINT + 'alpha = "pi half"\n', 6, 9, '"90 deg"; got "pi half"'),
    ("robot.bad-angle", HEAD + JOINT + 'alpha = "pi/0"\n', 6, 9, 'got "pi/0"'),
    ("robot.bad-length", HEAD + JOINT + 'a = "50 mm"\n', 6, 5, "(write the number alone, in m)"),
    ("robot.bad-length", HEAD + JOINT + "a = true\n", 6, 5, "expected a number in m"),
    ("robot.unknown-symbol", HEAD + "[symbols]\nL1 = 2\n" + JOINT + 'a = "L2"\n', 8, 5, "did you mean L1?"),
    ("robot.out-of-range", HEAD + JOINT + "link = { mass = -1 }\n", 6, 17, "greater than 0 kg, got -1"),
    ("robot.out-of-range", HEAD + JOINT + "link = { mass = 0 }\n", 6, 17, "greater than 0 kg, got 0"),
    ("robot.out-of-range", HEAD + JOINT + "link = { standard = { M = -1.0 } }\n", 6, 27, "at least 0 kg"),
    ("robot.out-of-range", HEAD + JOINT + "drive = { gear = 0 }\n", 6, 18, "gear: must"),
    ("robot.out-of-range", HEAD + JOINT + "limits = { position = [1, -1] }\n", 6, 23, "limit 1 "),
    ("robot.out-of-range", HEAD + JOINT + "[processing]\nfilter_cutoff = -5\n", 7, 17, "greater than 0 Hz"),
    (
        "robot.out-of-range",
        HEAD + JOINT + "[processing]\nfilter_order = 40\n",
        7,
        16,
        "at most 16, got 40",
    ),
    ("robot.out-of-range", HEAD + JOINT + "[processing]\ndecimation = { band = 1.5 }\n", 7, 23, "at most 1"),
    (
        "robot.impossible-inertia",
        HEAD + JOINT + "link = { mass = 1, inertia = { xx = 1, yy = 1, zz = 3 } }\n",
        6,
        30,
        "1, 1 and 3 kg*m^2",
    ),
    (
        "robot.impossible-inertia",
        HEAD + JOINT + "link = { mass = 1, inertia = { xx = 0.1, yy = 0.1, xy = 0.5, zz = 0.5 } }\n",
        6,
        30,
        "-0.4, 0.5 and 0.6 kg*m^2",
    ),
    (
        "robot.two-forms",
        HEAD + JOINT + "link = { mass = 1, standard = { M = 1 } }\n",
        6,
        10,
        "mass: ",
    ),
    (
        "robot.rotor-side",
        HEAD + JOINT + "drive = { rotor_inertia = 1e-5 }\n",
        6,
        11,
        'rotor_inertia_side = "motor"',
    ),
    (
        "robot.rotor-side",
        HEAD + JOINT + 'drive = { rotor_inertia_side = "motor" }\n',
        6,
        11,
        "rotor_inertia = 1e-5",
    ),
    (
        "robot.friction-values",
        HEAD + JOINT + 'friction = { model = "coulomb-viscous", Fv = 1 }\n',
        6,
        41,
        "without Fc; give all of Fv, Fc",
    ),
    (
        "robot.friction-values",
        HEAD + JOINT + 'friction = { model = "none", Fv = 1 }\n',
        6,
        30,
        'the model "none"; ',
    ),
    (
        "robot.unknown-unit",
        HEAD + JOINT + '[log]\nposition = { columns = ["q"], unit = "degres" }\n',
        7,
        38,
        "did you mean deg",
    ),
    (
        "robot.wrong-unit",
        HEAD + JOINT + '[log]\ntime = { column = "t", unit = "m" }\n',
        7,
        31,
        "(s, ms, us), got",
    ),
    (
        "robot.wrong-unit",
        HEAD + JOINT + '[log]\nposition = { columns = ["q"], unit = "rad/s" }\n',
        7,
        38,
        "expected a unit of angle",
    ),
    (
        "robot.missing-factor",
        HEAD + JOINT + '[log]\ntorque = { columns = ["u"], unit = "V" }\n',
        7,
        36,
        "needs a factor that turns it into N m",
    ),
    (
        "robot.missing-factor",
        HEAD + JOINT + '[log]\ntorque = { columns = ["u"], unit = "A" }\n',
        7,
        36,
        "torque_constant",
    ),
    (
        "robot.column-count",
        HEAD + JOINT + '[log]\ntorque = { columns = ["a", "b"], unit = "N m" }\n',
        7,
        22,
        "2 columns for 1 joints",
    ),
    (
        "robot.column-count",
        HEAD + JOINT + '[log]\ntorque = { columns = ["a"], unit = "N m", factor = [1, 2] }\n',
        7,
        52,
        "2 factors for 1 joints",
    ),
    (
        "robot.transmission-shape",
        HEAD + JOINT + "[log]\ntransmission = [[1, 2]]\n",
        7,
        16,
        "expected 1 rows of 1 numbers",
    ),
    (
        "robot.transmission-singular",
        HEAD + JOINT + "[log]\ntransmission = [[0]]\n",
        7,
        16,
        "transmission: the matrix",
    ),
    (
        "robot.two-encoders",
        HEAD
        + JOINT
        + '[log]\nmotor_position = { columns = ["a"], unit = "rad" }\n'
        + 'link_position = { columns = ["b"], unit = "rad" }\n',
        8,
        1,
        "link_position",
    ),
    ("robot.missing-key", HEAD + JOINT + "spring = { rest = 0 }\n", 6, 10, "stiffness = 120 (N*m/rad)"),
    ("robot.missing-key", HEAD + JOINT + "spring = { stiffness = 3 }\n", 6, 10, 'rest = "unknown"'),
    ("robot.missing-key", HEAD + JOINT + "elasticity = {}\n", 6, 14, 'stiffness = "unknown"'),
    (
        "robot.out-of-range",
        HEAD + JOINT + "elasticity = { stiffness = 0 }\n",
        6,
        28,
        "greater than 0 N*m/rad",
    ),
    (
        "robot.elasticity-mixed",
        HEAD + JOINT + "elasticity = { stiffness = 1, symmetric = true }\n",
        6,
        31,
        "symmetric: ",
    ),
    (
        "robot.invalid-elasticity",
        HEAD
        + JOINT
        + 'elasticity = { stiffness = 1, model = "bouc-wen", level = 1, length = 1, skew = 1 }\n',
        6,
        39,
        "skew must",
    ),
    ("robot.wrong-type", HEAD + JOINT + 'spring = { stiffness = "unkown", rest = 0 }\n', 6, 24, "N*m/rad"),
    ("robot.missing-key", HEAD + JOINT + "mimic = { multiplier = 2 }\n", 6, 9, 'joint = "joint1"'),
    ("robot.unknown-joint", HEAD + JOINT + 'mimic = { joint = "elbow" }\n', 6, 19, "allowed are shoulder"),
    (
        "robot.unknown-joint",
        HEAD + JOINT + 'mimic = { joint = "sholder" }\n',
        6,
        19,
        "did you mean shoulder?",
    ),
    (
        "robot.mimic-ring",
        HEAD + JOINT + 'mimic = { joint = "shoulder" }\n',
        6,
        9,
        "shoulder follows shoulder",
    ),
    (
        "robot.mimic-ring",
        HEAD + JOINT + 'mimic = { joint = "b" }\n'
        '[[joint]]\nname = "b"\nkind = "revolute"\nmimic = { joint = "c" }\n'
        '[[joint]]\nname = "c"\nkind = "revolute"\nmimic = { joint = "b" }\n',
        10,
        9,
        "b follows c follows b:",
    ),
    (
        "robot.out-of-range",
        HEAD + JOINT + '[[joint]]\nkind = "revolute"\nmimic = { joint = "shoulder", multiplier = 0 }\n',
        8,
        44,
        "multiplier: must",
    ),
    (
        "robot.wrong-type",
        HEAD + JOINT + '[[joint]]\nkind = "revolute"\nmimic = { joint = "shoulder", multiplier = "1/0" }\n',
        8,
        44,
        'a fraction "1/3", got "1/0"',
    ),
    (
        "robot.follows-fixed",
        HEAD + JOINT + '[[joint]]\nkind = "fixed"\nmimic = { joint = "shoulder" }\n',
        8,
        1,
        "mimic: ",
    ),
    (
        "robot.follows-fixed",
        HEAD + JOINT + 'mimic = { joint = "plate" }\n[[joint]]\nname = "plate"\nkind = "fixed"\n',
        6,
        19,
        '"plate" is fixed',
    ),
    ("robot.fixed-joint", HEAD + '[[joint]]\nkind = "fixed"\n', 4, 8, "kind: "),
    (
        "robot.fixed-joint",
        HEAD + JOINT + '[[joint]]\nkind = "fixed"\nfriction = { model = "none" }\n',
        8,
        1,
        "friction: a fixed",
    ),
    (
        "robot.continuous-limits",
        HEAD + '[[joint]]\nkind = "continuous"\nlimits = { position = [-1, 1], velocity = 2 }\n',
        5,
        12,
        'write kind = "revolute"',
    ),
    (
        "robot.mixed-placement",
        HEAD + JOINT + "d = 0.1\norigin = { xyz = [0, 0, 1] }\n",
        6,
        1,
        "together with origin",
    ),
    (
        "robot.mixed-placement",
        'convention = "origin"\ngravity = [0, 0, 1]\n' + JOINT + "alpha = 0\n",
        6,
        1,
        'in convention = "origin"',
    ),
    (
        "robot.wrong-type",
        HEAD + JOINT + "origin = { xyz = [0, 1] }\n",
        6,
        18,
        "3 lengths in m, got a list of 2",
    ),
    ("robot.wrong-type", HEAD + JOINT + 'origin = { rpy = "pi" }\n', 6, 18, '3 angles, got "pi"'),
    ("robot.bad-angle", HEAD + JOINT + 'origin = { rpy = [0, "x", 0] }\n', 6, 22, 'got "x"'),
    (
        "robot.wrong-type",
        HEAD + JOINT + "origin = { quaternion = [1, 0, 0] }\n",
        6,
        25,
        "4 numbers w",
    ),
    (
        "robot.wrong-type",
        HEAD + "[symbols]\nL1 = 1\n" + JOINT + 'a = "L1"\n[[joint]]\nkind = "revolute"\n'
        'origin = { quaternion = [1, "L1", 0, 0] }\n',
        11,
        29,
        '"1+sqrt(2)", got',
    ),
    ("robot.out-of-range", HEAD + JOINT + "origin = { quaternion = [0, 0, 0, 0] }\n", 6, 25, "[1, 0, 0, 0]"),
    (
        "robot.two-forms",
        HEAD + JOINT + "origin = { rpy = [0, 0, 0], quaternion = [1, 0, 0, 0] }\n",
        6,
        29,
        "quaternion: ",
    ),
    ("robot.missing-key", HEAD + JOINT + "[[coupling]]\nterms = { shoulder = 1 }\n", 6, 1, 'name = "m6"'),
    ("robot.missing-key", HEAD + JOINT + '[[coupling]]\nname = "m"\n', 6, 1, "terms = { joint5 = 1"),
    (
        "robot.missing-key",
        HEAD + JOINT + '[[coupling]]\nname = "m"\nterms = {}\n',
        8,
        9,
        "terms: empty",
    ),
    (
        "robot.unknown-joint",
        HEAD + JOINT + '[[coupling]]\nname = "m"\nterms = { sholder = 1 }\n',
        8,
        11,
        "did you mean shoulder?",
    ),
    (
        "robot.follows-fixed",
        HEAD + JOINT + '[[joint]]\nname = "e"\nkind = "fixed"\n[[coupling]]\nname = "m"\nterms = { e = 1 }\n',
        11,
        11,
        "drives nothing",
    ),
    (
        "robot.bad-name",
        HEAD + JOINT + '[[coupling]]\nname = "6"\nterms = { shoulder = 1 }\n',
        7,
        8,
        "name: ",
    ),
    (
        "robot.duplicate-coupling",
        HEAD + JOINT + '[[coupling]]\nname = "m"\nterms = { shoulder = 1 }\n' * 2,
        10,
        8,
        "by coupling 1;",
    ),
    ("robot.wrong-type", HEAD + JOINT + "[coupling]\n", 6, 1, "coupling: expected [[coupling]]"),
    ("robot.bad-name", HEAD + "[symbols]\nZZR1 = 2\n" + JOINT, 4, 1, "symbols: ZZR1:"),
    ("robot.wrong-type", HEAD + '[symbols]\nL1 = "1 m"\n' + JOINT, 4, 6, "symbols: L1: expected"),
    (
        "robot.symbol-unit",
        HEAD + "[symbols]\nm1 = 2\n" + JOINT + 'a = "m1"\nlink = { mass = "m1" }\n',
        9,
        17,
        "(m) before, and as a mass (kg)",
    ),
    (
        "robot.out-of-range",
        HEAD + "[symbols]\nm1 = -2\n" + JOINT + 'link = { mass = "m1" }\n',
        8,
        17,
        'than 0 kg, got "m1", which is -2',
    ),
    (
        "robot.unknown-symbol",
        HEAD + JOINT + 'link = { mass = "m1" }\n',
        6,
        17,
        "write m1 = 2.5 (its value in kg) there",
    ),
    (
        "robot.wrong-type",
        HEAD + JOINT + 'link = { mass = "1 kg" }\n',
        6,
        17,
        "(write the number alone, in kg)",
    ),
    (
        "robot.wrong-type",
        HEAD + JOINT + "link = { mass = 1, com = [0, 1] }\n",
        6,
        26,
        "3 numbers in m,",
    ),
    (
        "robot.wrong-type",
        'convention = "modified"\ngravity = 9.81\n' + JOINT,
        2,
        11,
        "3 numbers in m/s^2",
    ),
    ("robot.bad-length", HEAD + JOINT + 'a = "1/0"\n', 6, 5, "expected a number in m"),
    ("robot.bad-length", HEAD + "[symbols]\nL1 = 1\n" + JOINT + 'a = "L1*L1"\nd = "L1"\n', 8, 5, "a symbol"),
    ("robot.bad-angle", HEAD + JOINT + 'alpha = "2*atan(1/0)"\n', 6, 9, 'got "2*atan(1/0)"'),
]


@pytest.mark.parametrize(("code", "text", "line", "column", "words"), MISTAKES)
def test_a_mistake_is_told_once_with_its_place_and_remedy(code, text, line, column, words):
    errors = find_errors(text)
    assert [(found, at, col) for found, at, col, _ in errors] == [(code, line, column)]
    assert words in errors[0][3]


REMARKS = [
    ("robot.angle-snapped", "alpha = 1.5708\n", 6, 9, '-3.67e-06 rad; write it as "pi/2"'),
    ("robot.large-angle", "theta = 90\n", 6, 9, '"90 deg"'),
    ("robot.point-mass", "link = { mass = 1.0 }\n", 6, 8, "link: "),
    ("robot.long-length", "a = 425\n", 6, 5, "a: 425 m"),
    (
        "robot.negative-friction",
        'friction = { model = "coulomb-viscous", Fv = -1, Fc = 1 }\n',
        6,
        46,
        "Fv: -1 drives",
    ),
    (
        "robot.transmission-gear",
        "drive = { gear = 50 }\n[log]\ntransmission = [[40]]\n",
        8,
        18,
        "motor 1 turns 40 ",
    ),
    (
        "robot.elastic-joint",
        "elasticity = { stiffness = 1e4 }\n",
        6,
        14,
        "elasticity: q is",
    ),
    (
        "robot.lumped",
        '[[joint]]\nname = "flange"\nkind = "fixed"\n',
        8,
        8,
        "joint 'flange': kind: fixed; its link belongs to the link of joint 'shoulder', which gets no",
    ),
    (
        "robot.impossible-inertia",
        "link = { standard = { M = 1, MX = 1, XX = 0.1, YY = 0.5, ZZ = 0.5 } }\n",
        6,
        21,
        "-0.5, -0.5 and 0.1 kg*m^2",
    ),
    (
        "robot.inertia-without-mass",
        "link = { standard = { M = 0, XX = 0.1 } }\n",
        6,
        21,
        "(M = 0)",
    ),
    (
        "robot.negative-stiffness",
        "spring = { stiffness = -2, rest = 0 }\n",
        6,
        24,
        "stiffness: -2 ",
    ),
    ("robot.large-angle", "limits = { position = [-180, 180] }\n", 6, 23, "180 rad are 28.6 turns"),
    ("robot.unused-symbol", "[symbols]\nL1 = 0.5\n", 7, 6, "symbols: L1: "),
]


@pytest.mark.parametrize(("code", "line_of_text", "line", "column", "words"), REMARKS)
def test_a_remark_does_not_stop_the_reader(code, line_of_text, line, column, words):
    robot = parse_robot(HEAD + JOINT + line_of_text, "arm.toml")
    (notice,) = robot.notices
    assert (notice.code, notice.file, notice.line, notice.column) == (code, "arm.toml", line, column)
    assert words in notice.text


def test_every_code_of_the_reader_is_raised_in_a_test(project):
    # The readers of other files have tests of their own.
    readers = ("toml_", "exact_values")
    paths = sorted((project / "symid" / "robot").glob("*.py"))
    source = "".join(path.read_text() for path in paths if path.stem.startswith(readers))
    # Tables of rows, in the same file, have theirs in `test_dh_table`.
    codes = set(re.findall(r'"(robot\.[a-z-]+)"', source)) - {"robot.toml"}
    codes -= {"robot.table-header", "robot.table-row"}
    tested = {case[0] for case in MISTAKES} | {case[0] for case in REMARKS} | {"robot.unreadable"}
    assert codes == tested


def test_a_file_that_cannot_be_read_is_told(tmp_path):
    (tmp_path / "latin.toml").write_bytes(b'name = "\xe9"\n')
    for name, words in (("absent.toml", "No such file"), ("latin.toml", "not UTF-8 text (byte 8)")):
        with pytest.raises(RobotError, match=re.escape(words)) as caught:
            read_robot(tmp_path / name)
        assert caught.value.notices[0].code == "robot.unreadable"


def test_line_ends_of_other_systems_do_not_move_places():
    text = (HEAD + JOINT + "a = true\n").replace("\n", "\r\n")
    assert find_errors(text)[0][1:3] == (6, 5)


def test_values_of_a_full_file_are_read():
    text = HEAD + (
        'name = "arm"\ndescription = "d"\nsource = "s"\n[symbols]\nL1 = 0.25\n'
        '[[joint]]\nkind = "revolute"\nalpha = "90 deg"\na = "-L1"\nd = 0.1\n'
        'drive = { gear = -50, rotor_inertia = 1e-5, rotor_inertia_side = "motor", torque_constant = 0.1 }\n'
        'friction = { model = "asymmetric", Fvp = 1, Fcp = 2, Fvn = 3, Fcn = 4 }\n'
        "limits = { position = [-1, 2], velocity = 3, torque = 4 }\n"
        '[[joint]]\nkind = "prismatic"\nparent = "base"\ndrive = { rotor_inertia = "unknown" }\n'
        '[log]\ntime = { column = "t", unit = "ms" }\n'
        'position = { columns = ["q"], unit = "SI" }\n'
        'torque = { columns = ["u1", "u2"], unit = "V", factor = [2, 3.5], side = "motor" }\n'
    )
    robot = parse_robot(text, "arm.toml")
    first, second = robot.joints
    assert (robot.name, robot.description, robot.source, robot.path) == ("arm", "d", "s", "arm.toml")
    assert robot.symbols == (("L1", 0.25),)
    assert robot.gravity[2] == Exact.of("-9.81")
    assert (first.name, second.name, first.parent, second.parent) == ("joint1", "joint2", -1, -1)
    assert second.kind is JointKind.PRISMATIC
    assert first.placement.translation == (-Exact.symbol("L1"), Exact.of("-0.1"), Exact())
    assert first.drive.rotor_inertia == pytest.approx(0.025, rel=1e-15)
    assert first.drive.torque_constant == 0.1
    assert (second.drive.has_rotor, second.drive.rotor_inertia) == (True, None)
    assert first.friction.law == "asymmetric"
    assert first.friction.values == (1.0, 2.0, 3.0, 4.0)
    assert (first.limits.position, first.limits.velocity, first.limits.torque) == ((-1.0, 2.0), 3.0, 4.0)
    assert robot.log.time.unit == "ms"
    assert robot.log.torque.columns == ("u1", "u2")
    assert (robot.log.torque.factor, robot.log.torque.side) == ((2.0, 3.5), "motor")
    assert robot.notices == ()


def test_a_motor_current_becomes_a_joint_torque_through_gear_and_constant():
    text = (
        HEAD + JOINT + "drive = { gear = 50, torque_constant = 0.1 }\n"
        '[log]\ntorque = { columns = ["i"], unit = "A", side = "motor" }\n'
    )
    torque = parse_robot(text).log.torque
    assert (torque.unit, torque.factor, torque.side) == ("A", (5.0,), "joint")


@pytest.mark.parametrize(
    ("written", "cosine", "sine"),
    [
        ('"pi"', "-1", "0"),
        ('"pi/2"', "0", "1"),
        ('"-pi/4"', "1/2*sqrt(2)", "-1/2*sqrt(2)"),
        ('"3*pi/4"', "-1/2*sqrt(2)", "1/2*sqrt(2)"),
        ('"30 deg"', "1/2*sqrt(3)", "1/2"),
        ("1.5707963267948966", "0", "1"),
    ],
)
def test_angles_are_exact(written, cosine, sine):
    rotation = parse_robot(HEAD + JOINT + f"theta = {written}\n").joints[0].placement.rotation
    assert (str(rotation[0][0]), str(rotation[1][0])) == (cosine, sine)


def test_decimal_lengths_stay_the_decimals_they_show():
    joint = parse_robot(HEAD + JOINT + "a = 0.15005\nd = 1e-1\n").joints[0]
    assert [str(entry) for entry in joint.placement.translation] == ["3001/20000", "0", "1/10"]


def test_the_children_of_a_standard_tree_stand_at_the_far_end_of_their_parent():
    text = (
        'convention = "standard"\ngravity = [0, 0, -9.81]\n'
        '[[joint]]\nname = "trunk"\nkind = "revolute"\na = 0.5\nalpha = "pi/2"\n'
        '[[joint]]\nkind = "revolute"\na = 0.25\n[[joint]]\nparent = "trunk"\nkind = "revolute"\nd = 0.1\n'
    )
    robot = parse_robot(text)
    assert [joint.parent for joint in robot.joints] == [-1, 0, 0]
    assert [str(entry) for entry in robot.joints[1].placement.translation] == ["1/2", "0", "0"]
    assert [str(entry) for entry in robot.joints[2].placement.translation] == ["1/2", "-1/10", "0"]


def find_texts(text):
    with pytest.raises(RobotError) as caught:
        parse_robot(text)
    return [notice.text for notice in caught.value.notices]


def test_an_empty_list_of_joints_is_refused():
    assert "joint: empty" in "\n".join(find_texts(HEAD + "joint = []\n"))


def test_one_joint_that_is_no_table_does_not_hide_the_mistakes_of_the_others():
    texts = find_texts(HEAD + 'joint = [1, { kind = "revolut" }, { kind = "revolute", alpha = "x y" }]\n')
    assert any("got 1 as joint 1" in text for text in texts)
    assert any("joint 2: kind" in text for text in texts)
    assert any("joint 3: alpha" in text for text in texts)


def test_a_wrong_friction_model_does_not_hide_wrong_values():
    texts = find_texts(HEAD + JOINT + 'friction = { model = "coulom", Fv = "much", Fc = true }\n')
    assert [text.split(":")[2].strip() for text in texts] == ["model", "Fv", "Fc"]


@pytest.mark.parametrize("model", ['model = "coulom", ', 'model = "coulomb", ', ""])
def test_a_wrong_friction_model_does_not_hide_keys_that_do_not_exist(model):
    texts = find_texts(HEAD + JOINT + f"friction = {{ {model}viscosity = 1 }}\n")
    assert any("friction: viscosity: no such key here" in text for text in texts)
    # No key is offered twice.
    (offered,) = [text.split("allowed are ")[1].split(", ") for text in texts if "allowed are" in text]
    assert len(set(offered)) == len(offered)


@pytest.mark.parametrize(
    ("link", "said"),
    [
        ("{ mass = 1.0 }", True),
        ("{ mass = 1.0, inertia = { xx = 0.0, yy = 0.0, zz = 0.0 } }", True),
        ("{ mass = 1.0, inertia = { xx = 0.1, yy = 0.1, zz = 0.1 } }", False),
        ("{ standard = { M = 1.0 } }", False),
    ],
)
def test_a_point_mass_is_said(link, said):
    notices = parse_robot(HEAD + JOINT + f"link = {link}\n").notices
    assert [notice.code for notice in notices] == ["robot.point-mass"] * said
    assert all("joint 'shoulder': link: " in notice.text for notice in notices)


def find_errors(text):
    with pytest.raises(RobotError) as caught:
        parse_robot(text, "arm.toml")
    return [(notice.code, notice.line, notice.column, notice.text) for notice in caught.value.notices]


def test_a_factor_of_one_may_be_stated():
    log = '[log.torque]\ncolumns = ["u"]\nunit = "V"\nfactor = 1\n'
    torque = parse_robot(HEAD + JOINT + log).log.torque
    assert (torque.unit, torque.factor) == ("V", (1.0,))


def test_a_name_without_quotes_is_the_likeliest_mistake():
    text = 'convention = "modified"\ngravity = [0, 0, -9.81]\n[[joint]]\nkind = "revolute"\nd = H\n'
    with pytest.raises(RobotError, match='in quotes: "H"') as caught:
        parse_robot(text, "arm.toml")
    notice = caught.value.notices[0]
    assert (notice.line, notice.column) == (5, 5)
