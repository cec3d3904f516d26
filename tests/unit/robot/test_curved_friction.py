"""Curved friction in robot files: read, refused, written, set."""

import pytest

from symid.errors import RobotError, UsageError
from symid.notation import get_unit
from symid.robot.description import CurvedFriction, FrictionKind
from symid.robot.loading import override_robot
from symid.robot.toml_drives import FRICTION_PARAMETERS, FRICTION_SHAPES
from symid.robot.toml_reader import parse_robot
from symid.robot.toml_writer import write_robot
from symid.robot.xml_writers import write_urdf

HEAD = """
name = "one"
convention = "modified"
gravity = [0, 0, -9.81]

[[joint]]
name = "a"
kind = "{kind}"

[joint.friction]
"""


def parse(friction, kind="revolute"):
    return parse_robot(HEAD.format(kind=kind) + friction)


@pytest.mark.parametrize("kind", list(CurvedFriction), ids=lambda kind: kind.value)
def test_every_curved_model_is_read_and_written(kind):
    names = FRICTION_PARAMETERS[kind]
    keys = FRICTION_SHAPES.get(kind, ())
    lines = [f'model = "{kind.value}"', *(f"{name} = {k + 1}.5" for k, name in enumerate(names))]
    lines += [f"{key.name} = 0.{k + 3}" for k, key in enumerate(keys)]
    steps = kind not in {CurvedFriction.IMPROVED_STRIBECK, CurvedFriction.MAKKAR}
    robot = parse("\n".join([*lines, *(["smoothing = 0.01"] if steps else [])]))
    friction = robot.joints[0].friction
    assert friction.kind is kind
    assert friction.values == tuple(k + 1.5 for k in range(len(names)))
    assert friction.shape == tuple(float(f"0.{k + 3}") for k in range(len(keys)))
    assert friction.smoothing == (0.01 if steps else 0.0)
    assert parse_robot(write_robot(robot)).joints[0].friction == friction
    unknown = parse("\n".join([lines[0], *lines[1 + len(names) :]])).joints[0].friction
    assert unknown.values is None
    assert unknown.shape == friction.shape


def test_the_exponent_is_two_where_the_file_is_silent():
    friction = parse('model = "stribeck"\nvs = 0.05').joints[0].friction
    assert friction.shape == (0.05, 2.0)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('model = "cubic"\nFv = 0.6\nFc = 0.2\nFvq = -1\nFvc = 0', "Fvq: -1 drives the joint from about 0.8"),
        (
            'model = "cubic"\nFv = 0.6\nFc = 0.9\nFvq = 0\nFvc = -0.01',
            "Fvc: -0.01 drives the joint from about 8.5 rad/s",
        ),
        (
            'model = "stribeck"\nFv = 1\nFc = 1\nFe = -3\nvs = 0.1',
            "Fe: -3 drives the joint as motion begins",
        ),
        (
            'model = "asymmetric_stribeck"\nFvp = 1\nFcp = 1\nFvn = 1\nFcn = 2\nFe = -1.6\nvs = 0.1',
            "Fe: -1.6 drives the joint as motion begins",
        ),
        (
            'model = "makkar"\nFm = 3\nFc = 0.1\nFv = 0\ng2 = 1\ng3 = 100\ng5 = 10',
            "outweigh Fm",
        ),
        ('model = "improved_stribeck"\nFv = 1\nFc = 1\nFe = -3\nFp = 1\nvs = 0.1\ndq0 = 0.02', "Fe: -3"),
        ('model = "stribeck"\nFv = 1\nFc = 1\nFe = -3\nvs = 0.1\nsmoothing = 0.01', "Fe: -3 drives"),
    ],
    ids=lambda text: text.split("\n")[0] if "model" in text else "",
)
def test_a_curve_that_drives_the_joint_is_remarked_on(text, said):
    robot = parse(text)
    assert [notice.code for notice in robot.notices] == ["robot.negative-friction"]
    assert said in robot.notices[0].text
    assert robot.joints[0].friction.values is not None


@pytest.mark.parametrize(
    "text",
    [
        'model = "cubic"\nFv = 0.6\nFc = 0.9\nFvq = -0.05\nFvc = 0.01',
        'model = "cubic"\nFv = 0.6\nFc = 0.2\nFvq = -1\nFvc = 0\n[joint.limits]\nvelocity = 0.8',
        'model = "makkar"\nFm = 1\nFc = 2\nFv = 0\ng2 = 1\ng3 = 3\ng5 = 10',
        'model = "makkar"\nFm = 1\nFc = 0\nFv = 0\ng2 = 9\ng3 = 3\ng5 = 10',
        'model = "improved_stribeck"\nFv = 1\nFc = 1\nFe = -0.5\nFp = 9\nvs = 0.1\ndq0 = 0.02',
        'model = "stribeck_offset"\nFv = 1\nFc = 1\nFe = -1\noffset = 9\nvs = 1e-9\ngamma = 10',
        'model = "stribeck"\nvs = 0.1',
    ],
)
def test_a_curve_that_brakes_within_its_speeds_is_not_remarked_on(text):
    assert not parse(text).notices


def test_signs_that_are_allowed_and_those_that_are_warned_of():
    quiet = parse('model = "stribeck"\nFv = 1\nFc = 2\nFe = -0.5\nvs = 0.05')
    assert not quiet.notices
    loud = parse('model = "power_law"\nFc = 2\nFd = -0.5\ndelta = 0.5')
    assert [notice.code for notice in loud.notices] == ["robot.negative-friction"]


@pytest.mark.parametrize(
    ("friction", "kind", "code", "text"),
    [
        ('model = "stribeck"', "revolute", "robot.missing-key", "needs it as a number in rad/s"),
        ('model = "stribeck"', "prismatic", "robot.missing-key", "needs it as a number in m/s"),
        (
            'model = "power_law"',
            "revolute",
            "robot.missing-key",
            'delta: .*"power_law"',
        ),
        ('model = "stribeck"\nvs = 0', "revolute", "robot.out-of-range", "vs"),
        ('model = "cubic"\nvs = 0.1', "revolute", "robot.friction-values", 'vs: .*"cubic"'),
        (
            'model = "stribeck"\nvs = 0.1\ndq0 = 1',
            "revolute",
            "robot.friction-values",
            "dq0: .*values vs, gamma",
        ),
        ('model = "stribeck"\nvs = 0.1\nFe = 1', "revolute", "robot.friction-values", "without Fv, Fc"),
        (
            'model = "improved_stribeck"\nvs = 0.1\ndq0 = 0.01\nsmoothing = 0.1',
            "revolute",
            "robot.friction-values",
            "has no step at standstill",
        ),
        ('model = "cubic"\nFe = 1', "revolute", "robot.friction-values", "its values are Fv, Fc, Fvq, Fvc"),
    ],
)
def test_what_is_refused(friction, kind, code, text):
    with pytest.raises(RobotError, match=text) as caught:
        parse(friction, kind)
    assert code in [notice.code for notice in caught.value.notices]


def test_a_curved_model_can_be_set_where_its_shape_is_known():
    robot = parse('model = "stribeck"\nFv = 1\nFc = 2\nFe = 0.5\nvs = 0.05')
    assert override_robot(robot, (), "stribeck").joints == robot.joints
    assert override_robot(robot, (), "cubic").joints[0].friction.kind is CurvedFriction.CUBIC
    plain = override_robot(robot, (), "viscous_coulomb")
    assert plain.joints[0].friction.kind is FrictionKind.VISCOUS_COULOMB
    with pytest.raises(UsageError, match=r"needs vs, gamma of joint 'a'") as caught:
        override_robot(plain, (), "stribeck")
    assert caught.value.notices[0].code == "usage.friction-shape"


@pytest.mark.parametrize(("kind", "prismatic"), [("revolute", False), ("prismatic", True)])
def test_units_are_those_of_the_notation(kind, prismatic):
    names = {name for group in FRICTION_PARAMETERS.values() for name in group}
    wrong = "\n".join(f"{name} = true" for name in names)
    text = f'convention = "modified"\ngravity = [0, 0, 0]\n[[joint]]\nkind = "{kind}"\n'
    with pytest.raises(RobotError) as caught:
        parse_robot(f"{text}[joint.friction]\n{wrong}\n")
    told = [notice.text for notice in caught.value.notices if notice.code == "robot.wrong-type"]
    units = {name: get_unit(name, prismatic=prismatic).replace(" ", "*") for name in names}
    assert len(told) == len(names)
    assert all(
        any(f" {name}: " in text and f" in {unit}," in text for text in told) for name, unit in units.items()
    )


def test_a_urdf_says_what_it_leaves_out():
    text = write_urdf(parse('model = "stribeck"\nFv = 1\nFc = 2\nFe = 0.5\nvs = 0.05'))
    assert "friction model stribeck, values 1.0 2.0 0.5, shape 0.05 2.0" in text
