"""Friction laws with a state in robot files: read, written, refused; what other formats say of them."""

import xml.etree.ElementTree as ET
from itertools import chain

import pytest

from symid.errors import UsageError
from symid.joint_models import STATE_LAWS, get_law
from symid.robot.loading import override_robot
from symid.robot.simulator_writers import write_mjcf, write_urdf
from symid.robot.toml_reader import parse_robot
from symid.robot.toml_writer import write_robot
from tests.mistakes import refuse
from tests.state_laws import LAWS, STATES, give_values, write_table

HEAD = 'name = "one"\nconvention = "modified"\ngravity = [0, 0, -9.81]\n'
JOINT = '[[joint]]\nname = "{name}"\nkind = "{kind}"\n[joint.friction]\n{friction}\n'


def parse(*tables, kind="revolute", tail=""):
    joints = (JOINT.format(name=f"j{k}", kind=kind, friction=table) for k, table in enumerate(tables))
    return parse_robot(HEAD + "".join(joints) + tail)


def list_refused(*tables, **other):
    notices = refuse(parse, *tables, **other)
    return [(notice.code, notice.line, notice.text.split(": ", 1)[1]) for notice in notices]


def test_every_law_with_a_state_is_tried_here():
    assert STATES.keys() == STATE_LAWS.keys()


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
@pytest.mark.parametrize("name", LAWS)
def test_a_law_is_read_and_written_with_all_its_values(name, kind):
    friction = parse(write_table(name), kind=kind).joints[0].friction
    law, values = get_law(name), give_values(name)
    assert friction.law == name
    assert friction.values == tuple(values[entry.name] for entry in law.linear)
    assert friction.shape == tuple(values[entry.name] for entry in law.shape)
    wanted = [values[entry.name] for entry in law.memory]
    assert friction.bristles == tuple(chain.from_iterable(wanted) if law.elements else wanted)
    text = write_robot(parse(write_table(name), kind=kind))
    again = parse_robot(text)
    assert again.joints[0].friction == friction
    assert write_robot(again) == text
    # The state must be known; the values of sliding need not be.
    known = [line for line in write_table(name).split("\n") if not line.startswith(("F", "offset"))]
    unknown = parse("\n".join(known), kind=kind)
    assert unknown.joints[0].friction.values is None
    assert unknown.joints[0].friction.bristles == friction.bristles
    assert parse_robot(write_robot(unknown)).joints[0].friction == unknown.joints[0].friction


def test_a_short_name_and_the_usual_exponent():
    table = write_table("generalised-maxwell-slip").replace("generalised-maxwell-slip", "gms")
    friction = parse(table.replace("gamma = 1.4\n", "")).joints[0].friction
    assert (friction.law, friction.shape) == ("generalised-maxwell-slip", (0.1, 2.0))


def test_all_mistakes_are_told_at_once_with_their_lines():
    found = list_refused(
        'model = "lugre"',
        'model = "dahl"\nsigma0 = -1',
        'model = "maxwell-slip"\nstiffness = [1, 2]\nshare = [0.5, 0.3, 0.2]\nbogus = 1',
        'model = "maxwell-slip"\nstiffness = 3\nshare = []',
        'model = "maxwell-slip"\nstiffness = [1, -1]\nshare = [0.5, "a"]\nsmoothing = 0.1',
        'model = "maxwell-slip"\nstiffness = [1, 1]\nshare = [0.5, 0.6]\nsigma0 = 3',
        'model = "coulomb"\nFc = 1\nsigma0 = 3',
    )
    assert [(code, line) for code, line, _ in found] == [
        *(("robot.missing-key", 7),) * 3,
        ("robot.out-of-range", 14),
        ("robot.friction-elements", 21),
        ("robot.unknown-key", 22),
        ("robot.wrong-type", 28),
        ("robot.wrong-type", 29),
        ("robot.out-of-range", 35),
        ("robot.wrong-type", 36),
        ("robot.friction-values", 37),
        ("robot.friction-elements", 44),
        ("robot.friction-values", 45),
        ("robot.friction-values", 52),
    ]
    texts = [text for _, _, text in found]
    assert "sigma1: missing; the model's state needs it as a number in N*m*s/rad" in texts[2]
    assert "3 numbers for the 2 of stiffness" in texts[4]
    assert "stiffness: expected a list of numbers in N*m/rad, one an element, got 3" in texts[6]
    assert "the shares of all elements must have the sum 1, got 1.1" in texts[11]
    assert 'sigma0: not a value of the model "coulomb"; its values are Fc' in texts[13]


@pytest.mark.parametrize("name", LAWS)
def test_a_drive_of_several_joints_has_no_bristles(name):
    coupling = '[[coupling]]\nname = "m"\nterms = { j0 = 1, j1 = 1 }\n[coupling.friction]\n'
    plain = 'model = "none"'
    ((code, _, text),) = list_refused(plain, plain, tail=coupling + write_table(name))
    assert code == "robot.friction-model"
    assert "depends on the bristles of one joint, and this friction acts on several" in text


@pytest.mark.parametrize("name", LAWS)
def test_an_option_sets_such_a_law_only_where_the_file_has_its_state(name):
    robot = parse(write_table(name))
    assert override_robot(robot, (), name) == robot
    plain = parse('model = "coulomb"\nFc = 1')
    (notice,) = refuse(override_robot, plain, (), name, error=UsageError)
    assert notice.code == "usage.friction-shape"
    law = get_law(name)
    needed = ", ".join(entry.name for entry in (*law.shape, *law.memory))
    assert f"needs {needed} of joint 'j0', which no option gives; write it into the robot file" in notice.text


@pytest.mark.parametrize("name", LAWS)
def test_files_of_other_formats_have_the_plain_part_and_tell_the_rest(name):
    robot = parse(write_table(name))
    urdf, mjcf = write_urdf(robot), write_mjcf(robot)
    (dynamics,) = ET.fromstring(urdf).iter("dynamics")  # noqa: S314  our own text
    (joint,) = ET.fromstring(mjcf).iter("joint")  # noqa: S314  our own text
    assert (float(dynamics.get("damping")), float(dynamics.get("friction"))) == (1.1, 2.0)
    assert float(joint.get("damping")) == 1.1
    # What MuJoCo has bristles for has no dry friction besides, and no comment.
    exact = name == "dahl"
    assert joint.get("frictionloss") == (None if exact else "2.0")
    for text in (urdf,) if exact else (urdf, mjcf):
        assert f"friction model {name}, values 1.1 2.0" in text
        for value in robot.joints[0].friction.bristles:
            assert str(value) in text
        assert ", ".join(entry.name for entry in get_law(name).memory) in text
