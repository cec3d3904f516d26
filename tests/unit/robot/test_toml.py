"""Robot files: what is read, and what each mistake is told."""

import re

import pytest

from symid.joint_models import FrictionValues
from symid.robot.description import Drive, JointKind, Limits, LogMap, LogQuantity
from symid.robot.geometry import Exact
from symid.robot.toml_reader import parse_robot, read_robot
from tests.mistakes import refuse, take_mark

MODEL, PARENT, INERTIA = "robot.friction-model", "robot.unknown-parent", "robot.impossible-inertia"
UNIT, FIXED, NEGATIVE = "robot.wrong-unit", "robot.follows-fixed", "robot.negative-friction"
UNKNOWN, RANGE, INVALID = "robot.unknown-key", "robot.out-of-range", "robot.invalid-elasticity"
MIXED, MISSING, ELEMENTS = "robot.elasticity-mixed", "robot.missing-key", "robot.friction-elements"
HEAD = 'convention = "modified"\ngravity = [0, 0, -9.81]\n'
JOINT = '[[joint]]\nname = "shoulder"\nkind = "revolute"\n'
COUPLING = '[[coupling]]\nname = "m"\n'
FOLLOWER = '[[joint]]\nkind = "revolute"\nmimic = { joint = "shoulder", multiplier = '
LAW = "friction = { model = "
LINK = "link = { mass = 1, "
MIMIC = '[[joint]]\nname = "{}"\nkind = "revolute"\nmimic = {}{{ joint = "{}" }}\n'
MOTOR = '[log]\nmotor_position = { columns = ["a"], unit = "rad" }\n'
TORQUE = "[log]\ntorque = { columns = "


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
    lines = [str(notice) for notice in refuse(parse_robot, text, "arm.toml")]
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
        "allowed are name, kind, parent, alpha, a, d, theta, origin, frame, mimic, link, actuated, drive, "
        "friction, spring, elasticity, limits"
    )
    assert lines[4] == (
        "arm.toml:9:19: joint 'shoulder': rotor_inertia: "
        'expected a number in kg*m^2 or "unknown", got "1e-5 kg" (kg is not a unit of inertia)'
    )
    assert lines[5] == (
        "arm.toml:14:10: joint 'elbow': parent: there is no joint \"sholder\"; did you mean shoulder?"
    )
    assert lines[6].startswith("arm.toml:15:5: joint 'elbow': d: the symbol L1 ")
    assert "\n" not in "".join(lines)


# What stands behind a good joint; "^" marks the place that is told.
IN_JOINT = [
    ("robot.out-of-range", "[processing.decimation]\nfactor = ^1001", "at most 1000"),
    (MISSING, "link = ^{ com = [0, 0, 1] }", "mass = 1.5"),
    (MISSING, "link = { standard = ^{ XX = 1 } }", "M = 1.5"),
    (MISSING, "friction = ^{ Fv = 1 }", 'model = "coulomb-viscous"'),
    (MODEL, LAW + '^"viscous", Fv = 1 }', "unknown friction law 'viscous'; did you mean coulomb-viscous or "),
    (ELEMENTS, LAW + '"maxwell-slip", stiffness = [9, 1], share = ^[1] }', "1 numbers for the 2 of"),
    (MISSING, '[log]\ntime = ^{ unit = "s" }', 'column = "t"'),
    (MISSING, '[log]\ntorque = ^{ unit = "N m" }', "columns ="),
    (MISSING, '[log]\ntorque = ^{ columns = ["u"] }', 'unit = "N m"'),
    ("robot.unknown-key", "[^procesing]", "did you mean processing?"),
    ("robot.unknown-key", "^zzz = 1", "allowed are name, kind"),
    ("robot.wrong-type", "link = ^3", "expected a table, got 3"),
    ("robot.wrong-type", "[processing]\ndrop_first = ^1.0", "whole number, got 1.0"),
    ("robot.wrong-type", "limits = { position = ^[0] }", "list of 2 numbers in rad"),
    ("robot.wrong-type", 'limits = { torque = ^"3 N m" }', "alone, in N*m"),
    ("robot.wrong-type", "link = { mass = ^1e400 }", "sensible size and length"),
    ("robot.wrong-type", TORQUE + '^[1], unit = "N m" }', "texts"),
    ("robot.wrong-type", TORQUE + '["u"], unit = "V", factor = ^0 }', "other than 0"),
    ("robot.duplicate-joint", '[[joint]]\nname = ^"shoulder"\nkind = "revolute"', "by joint 1;"),
    (PARENT, 'parent = ^"wrist"', "allowed are base"),
    (PARENT, 'parent = ^"wrist"\n[[joint]]\nname = "wrist"\nkind = "revolute"', 'parent: "wrist" '),
    ("robot.bad-angle", 'alpha = ^"pi half"', '"90 deg"; got "pi half"'),
    ("robot.bad-length", 'a = ^"50 mm"', "(write the number alone, in m)"),
    ("robot.bad-length", "a = ^true", "expected a number in m"),
    ("robot.out-of-range", "link = { mass = ^-1 }", "greater than 0 kg, got -1"),
    ("robot.out-of-range", "link = { standard = { M = ^-1.0 } }", "at least 0 kg"),
    ("robot.out-of-range", "drive = { gear = ^0 }", "gear: must"),
    ("robot.out-of-range", "limits = { position = ^[1, -1] }", "limit 1 "),
    ("robot.out-of-range", "[processing]\ndecimation = { band = ^1.5 }", "at most 1"),
    (INERTIA, LINK + "inertia = ^{ xx = 1, yy = 1, zz = 3 } }", "1, 1 and 3 kg*m^2"),
    (INERTIA, LINK + "inertia = ^{ xx = 0.1, yy = 0.1, xy = 0.5, zz = 0.5 } }", "-0.4, 0.5 and 0.6 kg*m^2"),
    ("robot.two-forms", "link = { ^mass = 1, standard = { M = 1 } }", "mass: "),
    (
        "robot.asymmetric-inertia",
        LINK + "inertia = [[1, ^0.5, 0], [0, 1, 0], [0, 0, 1]] }",
        "(1, 2) and (2, 1)",
    ),
    ("robot.rotor-side", "drive = { ^rotor_inertia = 1e-5 }", 'rotor_inertia_side = "motor"'),
    ("robot.rotor-side", 'drive = { ^rotor_inertia_side = "motor" }', "rotor_inertia = 1e-5"),
    ("robot.friction-values", LAW + '"coulomb-viscous", ^Fv = 1 }', "without Fc; give all of Fv, Fc"),
    ("robot.friction-values", LAW + '"none", ^Fv = 1 }', 'the model "none"; '),
    ("robot.unknown-unit", '[log]\nposition = { columns = ["q"], unit = ^"degres" }', "did you mean deg"),
    (UNIT, '[log]\ntime = { column = "t", unit = ^"m" }', "(s, ms, us), got"),
    (UNIT, '[log]\nposition = { columns = ["q"], unit = ^"rad/s" }', "expected a unit of angle"),
    ("robot.missing-factor", TORQUE + '["u"], unit = ^"V" }', "needs a factor that turns it into N m"),
    ("robot.missing-factor", TORQUE + '["u"], unit = ^"A" }', "torque_constant"),
    ("robot.missing-gear", TORQUE + '["u"], unit = ^"A", factor = 2, side = "motor" }', "gear = 1: direct"),
    ("robot.column-count", TORQUE + '^["a", "b"], unit = "N m" }', "2 columns for 1 joints"),
    ("robot.column-count", TORQUE + '["a"], unit = "N m", factor = ^[1, 2] }', "2 factors for 1 joints"),
    ("robot.transmission-shape", "[log]\ntransmission = ^[[1, 2]]", "expected 1 rows of 1 numbers"),
    ("robot.transmission-singular", "[log]\ntransmission = ^[[0]]", "transmission: the matrix"),
    ("robot.two-encoders", MOTOR + '^link_position = { columns = ["b"], unit = "rad" }', "link_position"),
    (MISSING, "spring = ^{ rest = 0 }", "stiffness = 120 (N*m/rad)"),
    (MISSING, "spring = ^{ stiffness = 3 }", 'rest = "unknown"'),
    ("robot.out-of-range", "elasticity = { stiffness = ^0 }", "greater than 0 N*m/rad"),
    ("robot.out-of-range", COUPLING + "terms = { shoulder = ^0 }", "terms: shoulder: "),
    (MISSING, "mimic = ^{ multiplier = 2 }", 'joint = "joint1"'),
    ("robot.unknown-joint", 'mimic = { joint = ^"sholder" }', "did you mean shoulder?"),
    ("robot.mimic-ring", 'mimic = ^{ joint = "shoulder" }', "shoulder follows shoulder"),
    (
        "robot.mimic-ring",
        'mimic = { joint = "b" }\n' + MIMIC.format("b", "^", "c") + MIMIC.format("c", "", "b"),
        "b follows c follows b:",
    ),
    ("robot.out-of-range", FOLLOWER + "^0 }", "multiplier: must"),
    ("robot.wrong-type", FOLLOWER + '^"1/0" }', 'a fraction "1/3", got "1/0"'),
    (FIXED, '[[joint]]\nkind = "fixed"\n^mimic = { joint = "shoulder" }', "mimic: "),
    (FIXED, 'mimic = { joint = ^"plate" }\n[[joint]]\nname = "plate"\nkind = "fixed"', '"plate" is fixed'),
    ("robot.fixed-joint", '[[joint]]\nkind = "fixed"\n^friction = { model = "none" }', "friction: a fixed"),
    ("robot.not-actuated", "elasticity = { stiffness = 9 }\n^actuated = false", "leave this out"),
    ("robot.mixed-placement", "^d = 0.1\norigin = { xyz = [0, 0, 1] }", "together with origin"),
    ("robot.wrong-type", "origin = { xyz = ^[0, 1] }", "3 lengths in m, got a list of 2"),
    ("robot.wrong-type", 'origin = { rpy = ^"pi" }', '3 angles, got "pi"'),
    ("robot.bad-angle", 'origin = { rpy = [0, ^"x", 0] }', 'got "x"'),
    ("robot.wrong-type", "origin = { quaternion = ^[1, 0, 0] }", "4 numbers w"),
    ("robot.out-of-range", "origin = { quaternion = ^[0, 0, 0, 0] }", "[1, 0, 0, 0]"),
    ("robot.two-forms", "origin = { rpy = [0, 0, 0], ^quaternion = [1, 0, 0, 0] }", "quaternion: "),
    (MISSING, "^[[coupling]]\nterms = { shoulder = 1 }", 'name = "m6"'),
    (MISSING, '^[[coupling]]\nname = "m"', "terms = { joint5 = 1"),
    (MISSING, COUPLING + "terms = ^{}", "terms: empty"),
    ("robot.unknown-joint", COUPLING + "terms = { ^sholder = 1 }", "did you mean shoulder?"),
    (FIXED, '[[joint]]\nname = "e"\nkind = "fixed"\n' + COUPLING + "terms = { ^e = 1 }", "drives nothing"),
    ("robot.bad-name", '[[coupling]]\nname = ^"6"\nterms = { shoulder = 1 }', "name: "),
    (
        "robot.duplicate-coupling",
        COUPLING + 'terms = { shoulder = 1 }\n[[coupling]]\nname = ^"m"\nterms = { shoulder = 1 }',
        "by coupling 1;",
    ),
    ("robot.wrong-type", "^[coupling]", "coupling: expected [[coupling]]"),
    ("robot.unknown-symbol", 'link = { mass = ^"m1" }', "write m1 = 2.5 (its value in kg) there"),
    ("robot.wrong-type", 'link = { mass = ^"1 kg" }', "(write the number alone, in kg)"),
    ("robot.bad-length", 'a = ^"1/0"', "expected a number in m"),
    ("robot.bad-angle", 'alpha = ^"2*atan(1/0)"', 'got "2*atan(1/0)"'),
]
TABLE = "[joint.elasticity]\n"
SPRING = TABLE + "stiffness = 380\n"
STOP = "^stops = [{ threshold = 0.5, stiffness = 5 }]\n"
GENERAL = 'model = ^"generalised-maxwell-slip"\nFc = 1\nstiffnesses = [1, 2]\n'
# What stands behind the stiffness; "^" marks the place that is told.
IN_SPRING = [
    ("robot.wrong-type", 'cubic = ^"3 N/m"', "expected a number in N*m/rad^3"),
    ("robot.wrong-type", "stops = ^{ threshold = 1 }", "stops = [{ threshold = 0.002"),
    (MISSING, "stops = [^{ threshold = 1 }]", "stiffness = a number in N*m/rad"),
    (MISSING, "stops = [^{ stiffness = 1 }]", "in rad"),
    (UNKNOWN, "stops = [{ ^treshold = 1, threshold = 2, stiffness = 1 }]", "did you mean threshold?"),
    (RANGE, "stops = [{ threshold = ^0, stiffness = 1 }]", "than 0 rad"),
    (
        RANGE,
        "stops = [\n  { threshold = 1, stiffness = 1 },\n  { threshold = ^1, stiffness = 2 },\n]",
        "elasticity: stops 2: threshold: ",
    ),
    (RANGE, "knees = [{ threshold = ^0, slope = 1 }]", "threshold: must"),
    (RANGE, "symmetric = true\nknees = [{ threshold = ^-1, slope = 1 }]", "than 0 N*m"),
    (MISSING, "knees = [^{ threshold = 2 }]", "write slope = a number"),
    ("robot.wrong-type", "symmetric = ^1\nknees = []", "expected true or false"),
    (MIXED, "^symmetric = true", "symmetric: "),
    (MIXED, "^cubic = 5\nknees = [{ threshold = 2, slope = 1 }]", "cubic: "),
    (INVALID, "knees = ^[{ threshold = 2, slope = -1 }]", "knees: beyond 2 "),
    ("robot.bad-choice", 'model = ^"bouc"', "did you mean bouc-wen?"),
    (UNKNOWN, 'model = "dahl"\nFc = 1\nsigma0 = 2\n^level = 3', "allowed are"),
    (UNKNOWN, "^level = 3", "allowed are"),
    (RANGE, 'model = "bouc-wen"\nlevel = 3\nlength = 1\nloop = ^0.2', "at least 0.5"),
    (INVALID, 'model = ^"bouc-wen"\nlevel = 3\nlength = 1\nskew = 1', "skew must"),
    ("robot.wrong-type", 'model = "maxwell-slip"\nstiffnesses = ^3\nforces = [1]', "a list of numbers"),
    (INVALID, 'model = ^"maxwell-slip"\nstiffnesses = [1, 2]\nforces = [1]', "need as many forces"),
    (INVALID, GENERAL + "shares = [1]", "need as many shares"),
    (MISSING, "^[[joint.elasticity.branch]]\nlevel = 1", "write one of bouc-wen"),
    (MIXED, STOP + 'model = "maxwell-slip"\nstiffnesses = [2]\nforces = [1]', "slips at 0.5"),
]
IN_ELASTIC_JOINT = [
    (MISSING, "^" + SPRING + 'model = "bouc-wen"\nlevel = 3', "a number in rad"),
    (MISSING, "^" + SPRING + 'model = "lugre"\nFc = 1\nsigma0 = 2\nFe = 1', "where Fe is not 0"),
    (MISSING, "^" + TABLE + "damping = 1", 'or stiffness = "unknown"'),
    (
        MIXED,
        TABLE + "^stiffness = 380\ncatalogue = { K1 = 1, K2 = 2, K3 = 3, T1 = 1, T2 = 2 }",
        "stiffness: ",
    ),
    (MISSING, TABLE + "catalogue = ^{ K1 = 1, K2 = 2, K3 = 3, T1 = 1 }", "T2: missing; "),
    (RANGE, TABLE + "catalogue = { K1 = 1, K2 = 2, K3 = 3, T1 = 2, T2 = ^2 }", "T1 = 2"),
    (RANGE, TABLE + "catalogue = { K1 = ^0, K2 = 2, K3 = 3, T1 = 2, T2 = 3 }", "than 0 N*m/rad"),
    (RANGE, '[joint.friction]\nmodel = "coulomb-viscous"\nsmoothing = ^0', "greater than 0 rad/s"),
    ("robot.friction-values", '[joint.friction]\nmodel = "none"\n^smoothing = 0.1', "has no friction"),
]
ELSEWHERE = [
    ("robot.zeros", 'zeros = ^["nobody"]\n' + HEAD + JOINT, 'expected "unknown" or a list of joints'),
    ("robot.syntax", HEAD + JOINT + "d = ^H\n", 'in quotes: "H"'),
    ("robot.bad-length", (HEAD + JOINT + "a = ^true\n").replace("\n", "\r\n"), "expected a number"),
    ("robot.syntax", "gravity = [0, 0\n^", "TOML: "),
    ("robot.syntax", "name = ^= 1\n", "TOML: "),
    (MISSING, '^convention = "modified"\n' + JOINT, "gravity = [0, 0, -9.81]"),
    (MISSING, "^" + HEAD, "[[joint]]"),
    (MISSING, HEAD + '^[[joint]]\nname = "a"\n', 'kind = "revolute"'),
    ("robot.wrong-type", "name = ^3\n" + HEAD + JOINT, 'expected a text in "quotes", got 3'),
    ("robot.wrong-type", HEAD + "^[joint]\n", "joint: expected [[joint]]"),
    ("robot.bad-choice", 'convention = ^"modifed"\ngravity = [0, 0, 1]\n' + JOINT, "did you mean modified?"),
    ("robot.bad-name", 'name = ^"my arm"\n' + HEAD + JOINT, '"my arm"'),
    ("robot.bad-name", HEAD + '[[joint]]\nname = ^"base"\nkind = "revolute"\n', 'name: "base"'),
    ("robot.bad-name", HEAD + "[symbols]\n^q1 = 2\n" + JOINT, "symbols: q1:"),
    ("robot.unknown-symbol", HEAD + "[symbols]\nL1 = 2\n" + JOINT + 'a = ^"L2"\n', "did you mean L1?"),
    ("robot.fixed-joint", HEAD + '[[joint]]\nkind = ^"fixed"\n', "kind: "),
    (
        "robot.continuous-limits",
        HEAD + '[[joint]]\nkind = "continuous"\nlimits = { ^position = [-1, 1], velocity = 2 }\n',
        'write kind = "revolute"',
    ),
    ("robot.mixed-placement", HEAD.replace("modified", "origin") + JOINT + "^alpha = 0\n", '= "origin"'),
    (
        "robot.wrong-type",
        HEAD
        + "[symbols]\nL1 = 1\n"
        + JOINT
        + 'a = "L1"\n[[joint]]\nkind = "revolute"\norigin = { quaternion = [1, ^"L1", 0, 0] }\n',
        '"1+sqrt(2)", got',
    ),
    ("robot.bad-name", HEAD + "[symbols]\n^ZZR1 = 2\n" + JOINT, "symbols: ZZR1:"),
    ("robot.wrong-type", HEAD + '[symbols]\nL1 = ^"1 m"\n' + JOINT, "symbols: L1: expected"),
    (
        "robot.symbol-unit",
        HEAD + "[symbols]\nm1 = 2\n" + JOINT + 'a = "m1"\nlink = { mass = ^"m1" }\n',
        "(m) before, and as a mass (kg)",
    ),
    (
        "robot.out-of-range",
        HEAD + "[symbols]\nm1 = -2\n" + JOINT + 'link = { mass = ^"m1" }\n',
        'than 0 kg, got "m1", which is -2',
    ),
    ("robot.wrong-type", 'convention = "modified"\ngravity = ^9.81\n' + JOINT, "3 numbers in m/s^2"),
    ("robot.bad-length", HEAD + "[symbols]\nL1 = 1\n" + JOINT + 'a = ^"L1*L1"\nd = "L1"\n', "a symbol"),
]


IN_SPRING = [(code, SPRING + text, words) for code, text, words in IN_SPRING]
IN_JOINT += [*IN_SPRING, *IN_ELASTIC_JOINT]
MISTAKES = [*((code, HEAD + JOINT + text, words) for code, text, words in IN_JOINT), *ELSEWHERE]


@pytest.mark.parametrize(("code", "text", "words"), MISTAKES)
def test_a_mistake_is_told_once_with_its_place_and_remedy(code, text, words):
    text, place = take_mark(text)
    (notice,) = refuse(parse_robot, text, "arm.toml")
    assert (notice.code, notice.file, (notice.line, notice.column)) == (code, "arm.toml", place)
    assert words in notice.text


REMARKS = [
    ("robot.angle-snapped", "alpha = ^1.5708", '-3.67e-06 rad; write it as "pi/2"'),
    ("robot.large-angle", "theta = ^90", '"90 deg"'),
    ("robot.point-mass", "link = ^{ mass = 1.0 }", "link: "),
    ("robot.long-length", "a = ^425", "a: 425 m"),
    (
        "robot.long-length",
        LINK + "com = [0, ^115, 0], inertia = { xx = 1, yy = 1, zz = 1 } }",
        "com: 115 m is too long",
    ),
    (
        "robot.implausible-body",
        "link = ^{ mass = 2e6, inertia = { xx = 1, yy = 1, zz = 1 } }",
        "write kg, not grams",
    ),
    (NEGATIVE, 'friction = { model = "coulomb-viscous", Fv = ^-1, Fc = 1 }', "Fv: -1 drives"),
    ("robot.transmission-gear", "drive = { gear = 50 }\n[log]\ntransmission = [[^40]]", "motor 1 turns 40 "),
    ("robot.elastic-joint", "elasticity = ^{ stiffness = 1e4 }", "elasticity: q is"),
    (
        "robot.lumped",
        '[[joint]]\nname = "flange"\nkind = ^"fixed"',
        "joint 'flange': kind: fixed; its link belongs to the link of joint 'shoulder', which gets no",
    ),
    (
        "robot.unused-body",
        '[[joint]]\nname = "tool"\nkind = "fixed"\n'
        + LINK.replace("{", "^{")
        + "inertia = { xx = 1, yy = 1, zz = 1 } }",
        "joint 'tool': link: these values count nowhere: the link of joint 'shoulder', which carries them",
    ),
    (INERTIA, "link = { standard = ^{ M = 1, MX = 1, XX = 0.1, YY = 0.5, ZZ = 0.5 } }", "-0.5, -0.5 and 0.1"),
    ("robot.inertia-without-mass", "link = { standard = ^{ M = 0, XX = 0.1 } }", "(M = 0)"),
    ("robot.negative-stiffness", "spring = { stiffness = ^-2, rest = 0 }", "stiffness: -2 "),
    ("robot.large-angle", "limits = { position = ^[-180, 180] }", "180 rad are 28.6 turns"),
    ("robot.unused-symbol", "[symbols]\nL1 = ^0.5", "symbols: L1: "),
]


@pytest.mark.parametrize(("code", "text", "words"), REMARKS)
def test_a_remark_does_not_stop_the_reader(code, text, words):
    text, place = take_mark(HEAD + JOINT + text)
    (notice,) = parse_robot(text, "arm.toml").notices
    assert (notice.code, notice.file, (notice.line, notice.column)) == (code, "arm.toml", place)
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
        notice = refuse(read_robot, tmp_path / name)[0]
        assert notice.code == "robot.unreadable"
        assert words in str(notice)


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
    inertia = pytest.approx(0.025, rel=1e-15)
    assert first.drive == Drive(gear=-50.0, has_rotor=True, rotor_inertia=inertia, torque_constant=0.1)
    assert second.drive == Drive(has_rotor=True)
    assert first.friction == FrictionValues(law="asymmetric", values=(1.0, 2.0, 3.0, 4.0))
    assert first.limits == Limits(position=(-1.0, 2.0), velocity=3.0, torque=4.0)
    assert robot.log == LogMap(
        time=LogQuantity(columns=("t",), unit="ms"),
        position=LogQuantity(columns=("q",), unit="SI"),
        torque=LogQuantity(columns=("u1", "u2"), unit="V", factor=(2.0, 3.5), side="motor"),
    )
    assert robot.notices == ()


def test_a_motor_current_becomes_a_joint_torque_through_gear_and_constant():
    text = (
        HEAD + JOINT + "drive = { gear = 50, torque_constant = 0.1 }\n"
        '[log]\ntorque = { columns = ["i"], unit = "A", side = "motor" }\n'
    )
    torque = parse_robot(text).log.torque
    assert (torque.unit, torque.factor, torque.side) == ("A", (5.0,), "joint")
    # A factor of one may be stated.
    torque = parse_robot(HEAD + JOINT + TORQUE + '["u"], unit = "V", factor = 1 }\n').log.torque
    assert (torque.unit, torque.factor) == ("V", (1.0,))


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
    return [notice.text for notice in refuse(parse_robot, text)]


def test_one_joint_that_is_no_table_does_not_hide_the_mistakes_of_the_others():
    assert "joint: empty" in "\n".join(find_texts(HEAD + "joint = []\n"))
    texts = find_texts(HEAD + 'joint = [1, { kind = "revolut" }, { kind = "revolute", alpha = "x y" }]\n')
    assert any("got 1 as joint 1" in text for text in texts)
    assert any("joint 2: kind" in text for text in texts)
    assert any("joint 3: alpha" in text for text in texts)


@pytest.mark.parametrize("model", ['model = "coulom", ', 'model = "coulomb", ', ""])
def test_a_wrong_friction_model_hides_neither_wrong_values_nor_keys_that_do_not_exist(model):
    texts = find_texts(HEAD + JOINT + 'friction = { model = "coulom", Fv = "much", Fc = true }\n')
    assert [text.split(":")[2].strip() for text in texts] == ["model", "Fv", "Fc"]
    texts = find_texts(HEAD + JOINT + f"friction = {{ {model}viscosity = 1 }}\n")
    assert any("friction: viscosity: no such key here" in text for text in texts)
    # No key is offered twice.
    (offered,) = [text.split("allowed are ")[1].split(", ") for text in texts if "allowed are" in text]
    assert len(set(offered)) == len(offered)
