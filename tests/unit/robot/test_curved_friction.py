"""Friction laws in robot files: read, refused, written, set; their earlier names."""

import re
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest

from symid.errors import UsageError
from symid.joint_models import FrictionValues, get_law, name_values
from symid.robot.loading import override_robot
from symid.robot.simulator_writers import write_mjcf, write_urdf
from symid.robot.toml_reader import parse_robot
from symid.robot.toml_writer import write_robot
from tests.friction_forms import EVERY_LAW, OLD_NAMES, give_shape
from tests.mistakes import refuse

VALUES = "robot.friction-values"
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


def write_shape(name):
    entries = zip(get_law(name).shape, give_shape(name), strict=True)
    return "".join(f"{entry.name} = {value}\n" for entry, value in entries)


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
@pytest.mark.parametrize("name", EVERY_LAW)
def test_every_law_is_read_and_written(name, kind):
    names = [entry.name for entry in get_law(name).linear]
    head, values = f'model = "{name}"\n{write_shape(name)}', [k + 1.5 for k in range(len(names))]
    lines = "".join(f"{key} = {value}\n" for key, value in zip(names, values, strict=True))
    steps = "makkar" not in name and not name.startswith("improved-stribeck")
    steps = steps or name.startswith(("improved-stribeck-h3", "improved-stribeck-h4"))
    robot = parse(head + lines + "smoothing = 0.01" * steps, kind)
    friction = robot.joints[0].friction
    assert friction == FrictionValues(
        law=name, values=tuple(values), shape=give_shape(name), smoothing=0.01 if steps else 0.0
    )
    text = write_robot(robot)
    assert f'model = "{name}"' in text
    assert parse_robot(text).joints[0].friction == friction
    unknown = parse(head, kind)
    assert unknown.joints[0].friction == replace(friction, values=None, smoothing=0.0)
    assert parse_robot(write_robot(unknown)).joints[0].friction == unknown.joints[0].friction


OLD_TABLES = {
    "viscous_coulomb": ("Fv Fc", ""),
    "viscous_coulomb_offset": ("Fv Fc offset", ""),
    "asymmetric": ("Fvp Fcp Fvn Fcn", ""),
    "stribeck": ("Fv Fc Fe", "vs = 0.1"),
    "stribeck_offset": ("Fv Fc Fe offset", "vs = 0.1"),
    "improved_stribeck": ("Fv Fc Fe Fp", "vs = 0.1\ndq0 = 0.02"),
    "asymmetric_stribeck": ("Fvp Fcp Fvn Fcn Fe", "vs = 0.1"),
    "cubic": ("Fv Fc Fvq Fvc", ""),
    "stribeck_cubic": ("Fv Fc Fe Fvq Fvc", "vs = 0.1"),
    "power_law": ("Fc Fd", "delta = 0.5"),
    "makkar": ("Fm Fc Fv", "g2 = 9\ng3 = 2\ng5 = 7"),
}


@pytest.mark.parametrize("name", OLD_NAMES)
def test_files_of_earlier_versions_are_read_and_written_with_the_name_of_the_law(name):
    names, shape = OLD_TABLES[name]
    values = tuple(float(k) for k, _ in enumerate(names.split(), start=1))
    lines = (f"{key} = {value}" for key, value in zip(names.split(), values, strict=True))
    robot = parse("\n".join([f'model = "{name}"', *lines, shape]))
    numbers = tuple(float(line.split(" = ")[1]) for line in shape.split("\n") if line)
    assert robot.joints[0].friction == FrictionValues(law=OLD_NAMES[name], values=values, shape=numbers)
    text = write_robot(robot)
    assert f'model = "{OLD_NAMES[name]}"' in text
    assert parse_robot(text).joints[0].friction == robot.joints[0].friction
    # Set by that name, the law keeps its values.
    assert override_robot(robot, (), name).joints == override_robot(robot, (), OLD_NAMES[name]).joints
    assert override_robot(robot, (), name).joints == robot.joints


@pytest.mark.parametrize(
    ("name", "gamma", "law", "shape"),
    [
        ("stribeck", None, "stribeck", (0.1,)),
        ("stribeck", "2.0", "stribeck", (0.1,)),
        ("stribeck", "1.6", "stribeck-exponent", (0.1, 1.6)),
        ("stribeck", "1", "tustin", (0.1,)),
        ("stribeck_offset", "1.6", "stribeck-exponent+offset", (0.1, 1.6)),
        ("stribeck_cubic", "1.6", "stribeck-exponent+cubic", (0.1, 1.6)),
        ("improved_stribeck", "1.6", "improved-stribeck-exponent", (0.1, 0.02, 1.6)),
        ("asymmetric_stribeck", "0.7", "asymmetric-stribeck-exponent", (0.1, 0.7)),
        ("stribeck-exponent", "1.6", "stribeck-exponent", (0.1, 1.6)),
        ("stribeck-exponent", "1", "stribeck-exponent", (0.1, 1.0)),
        ("stribeck-exponent", None, "stribeck-exponent", (0.1, 2.0)),
        ("asymmetric-stribeck-both", "1.6", "asymmetric-stribeck-both-exponent", (0.1, 1.6)),
    ],
)
def test_an_exponent_beside_the_model_is_part_of_the_law(name, gamma, law, shape):
    edge = "dq0 = 0.02\n" if "improved" in name else ""
    stated = "" if gamma is None else f"gamma = {gamma}\n"
    robot = parse(f'model = "{name}"\nvs = 0.1\n{edge}{stated}')
    assert robot.joints[0].friction == FrictionValues(law=law, shape=shape)
    assert parse_robot(write_robot(robot)).joints[0].friction == robot.joints[0].friction


@pytest.mark.parametrize(
    ("name", "gamma", "code", "words"),
    [
        *(("stribeck", gamma, "robot.wrong-type", "expected a number") for gamma in ("true", '"two"', "inf")),
        *(("stribeck_offset", gamma, "robot.out-of-range", "must be greater than 0") for gamma in (0, 10.5)),
        # Laws whose exponent is fixed.
        *((name, 1.6, VALUES, f'not a value of the model "{name}"') for name in ("tustin", "lorentzian")),
    ],
)
def test_a_wrong_exponent_is_refused(name, gamma, code, words):
    (notice,) = refuse(parse, f'model = "{name}"\nvs = 0.1\ngamma = {gamma}')
    assert notice.code == code
    assert f"gamma: {words}" in notice.text


@pytest.mark.parametrize("name", [name for name in EVERY_LAW if get_law(name).inputs != ("velocity",)])
def test_a_drive_of_several_joints_feels_neither_load_nor_position_nor_temperature_of_one(name):
    table = f'model = "{name}"\n{write_shape(name)}'
    second = '\n[[joint]]\nname = "b"\nkind = "revolute"\n'
    follower = second + f'mimic = {{ joint = "a" }}\n[joint.friction]\n{table}'
    coupling = f'{second}\n[[coupling]]\nname = "m"\nterms = {{ a = 1, b = 1 }}\n[coupling.friction]\n{table}'
    for text in (follower, coupling):
        (notice,) = refuse(parse, 'model = "none"\n' + text)
        assert notice.code == "robot.friction-model"
        assert "acts on several; choose a model of the velocity" in notice.text
    # The joint that is followed has a drive of its own.
    assert parse(table + second + 'mimic = { joint = "a" }').joints[0].friction.law == name


@pytest.mark.parametrize(
    ("name", "values", "said"),
    [
        ("cubic", "Fv=0.6 Fc=0.2 Fvq=-1 Fvc=0", "Fvq: -1 drives the joint from about 0.8"),
        ("cubic", "Fv=0.6 Fc=0.9 Fvq=0 Fvc=-0.01", "Fvc: -0.01 drives the joint from about 8.5 rad/s"),
        ("stribeck", "Fv=1 Fc=1 Fe=-3 vs=0.1", "Fe: -3 drives the joint as motion begins"),
        ("asymmetric_stribeck", "Fvp=1 Fcp=1 Fvn=1 Fcn=2 Fe=-1.6 vs=0.1", "Fe: -1.6 drives the joint as"),
        ("makkar", "Fm=3 Fc=0.1 Fv=0 g2=1 g3=100 g5=10", "outweigh Fm"),
        ("lorentzian", "Fv=1 Fc=1 Fe=-3 vs=0.1", "Fe: -3 drives the joint as motion begins"),
        ("polynomial-4", "Fv=1 Fc=1 Fv4=-1", "Fv4: -1 drives the joint from about 1.2 rad/s"),
        ("asymmetric-stribeck-both", "vs=9 Fvp=1 Fvn=1 Fcp=1 Fcn=1 Fep=-3 Fen=0", "Fep: -3 drives"),
        ("load-dependent", "Fv=1 Fc=1 Fl=-0.1", "Fl: -0.1 drives the joint instead"),
        ("power_law", "Fc=2 Fd=-0.5 delta=0.5", "Fd: -0.5"),
        # What brakes within its speeds is not remarked on.
        ("cubic", "Fv=0.6 Fc=0.9 Fvq=-0.05 Fvc=0.01", None),
        ("cubic", "Fv=0.6 Fc=0.2 Fvq=-1 Fvc=0 [joint.limits] velocity=0.8", None),
        ("makkar", "Fm=1 Fc=2 Fv=0 g2=1 g3=3 g5=10", None),
        ("stribeck_offset", "Fv=1 Fc=1 Fe=-1 offset=9 vs=1e-9 gamma=10", None),
        ("position-torque", "Fv=1 Fc=1 A1=-9 B1=9 A2=0 B2=0", None),
        ("temperature", "Fv=1 Fc=1 Fvt=-0.1 Fct=-0.1", None),
        ("stribeck", "vs=0.1", None),
    ],
)
def test_a_curve_that_drives_the_joint_is_remarked_on(name, values, said):
    lines = values.replace(" ", "\n")
    robot = parse(f'model = "{name}"\n{lines}')
    if said is None:
        assert not robot.notices
        return
    (notice,) = robot.notices
    assert notice.code == "robot.negative-friction"
    assert said in notice.text
    assert robot.joints[0].friction.values is not None


@pytest.mark.parametrize(
    ("friction", "kind", "code", "words"),
    [
        ('"stribeck"', "revolute", "robot.missing-key", "needs it as a number in rad/s"),
        ('"stribeck"', "prismatic", "robot.missing-key", "needs it as a number in m/s"),
        ('"power_law"', "revolute", "robot.missing-key", "delta: missing; the model needs it as a number"),
        ('"stribeck"\nvs = 0', "revolute", "robot.out-of-range", "vs"),
        ('"cubic"\nvs = 0.1', "revolute", VALUES, 'vs: .*"cubic"'),
        ('"stribeck"\nvs = 0.1\ndq0 = 1', "revolute", VALUES, "dq0: .*shape values vs, gamma"),
        ('"stribeck"\nvs = 0.1\nFe = 1', "revolute", VALUES, "without Fv, Fc"),
        ('"improved_stribeck"\nvs = 0.1\ndq0 = 0.01\nsmoothing = 0.1', "revolute", VALUES, "no step"),
        ('"cubic"\nFe = 1', "revolute", VALUES, "its values are Fv, Fc, Fvq, Fvc"),
    ],
)
def test_what_is_refused(friction, kind, code, words):
    notices = refuse(parse, f"model = {friction}", kind)
    assert code in [notice.code for notice in notices]
    assert re.search(words, " ".join(notice.text for notice in notices))


def test_a_law_can_be_set_where_its_shape_is_known():
    robot = parse('model = "stribeck"\nFv = 1\nFc = 2\nFe = 0.5\nvs = 0.05')
    assert override_robot(robot, (), "stribeck").joints == robot.joints
    assert override_robot(robot, (), "cubic").joints[0].friction.law == "cubic"
    plain = override_robot(robot, (), "coulomb-viscous")
    assert plain.joints[0].friction == FrictionValues(law="coulomb-viscous")
    assert override_robot(robot, (), "none").joints[0].friction == FrictionValues()
    notice = refuse(override_robot, plain, (), "stribeck", error=UsageError)[0]
    assert notice.code == "usage.friction-shape"
    assert "needs vs of joint 'a'" in notice.text
    with pytest.raises(UsageError, match=r"needs vs, gamma of joint 'a'"):
        override_robot(robot, (), "stribeck-exponent")


@pytest.mark.parametrize(("kind", "prismatic"), [("revolute", False), ("prismatic", True)])
@pytest.mark.parametrize("name", EVERY_LAW)
def test_units_are_those_of_the_law(name, kind, prismatic):
    law = get_law(name)
    entries = (*law.linear, *law.shape)
    # An exponent that is no number is tested on its own.
    entries = [entry for entry in entries if entry.name != "gamma"]
    wrong = "\n".join(f"{entry.name} = true" for entry in entries)
    notices = refuse(parse, f'model = "{name}"\n{wrong}', kind)
    told = [notice.text for notice in notices if notice.code == "robot.wrong-type"]
    assert len(told) == len(entries)
    for entry, text in zip(entries, told, strict=True):
        unit = (entry.unit_prismatic if prismatic else entry.unit).replace(" ", "*")
        assert f" {entry.name}: expected a number" in text
        assert entry.unit == "1" or f" in {unit}," in text


@pytest.mark.parametrize("name", EVERY_LAW)
def test_files_of_other_formats_have_the_plain_part_and_tell_the_rest(name):
    law, shape = get_law(name), give_shape(name)
    values = tuple(0.5 + k for k in range(len(law.linear)))
    robot = parse('model = "coulomb"\nFc = 1')
    friction = FrictionValues(law=name, values=values, shape=shape)
    robot = replace(robot, joints=(replace(robot.joints[0], friction=friction),))
    named = name_values(friction)
    damping = [named[key] for key in ("Fv", "Fvp", "Fvn") if key in named] or [0.0]
    dry = [named[key] for key in ("Fc", "Fcp", "Fcn") if key in named] or [0.0]
    urdf, mjcf = write_urdf(robot), write_mjcf(robot)
    (dynamics,) = ET.fromstring(urdf).iter("dynamics")  # noqa: S314  our own text
    (joint,) = ET.fromstring(mjcf).iter("joint")  # noqa: S314  our own text
    # MuJoCo has the further coefficients of the law cubic.
    constant = joint.get("damping", "0").split()[0]
    wanted = pytest.approx((np.mean(damping), np.mean(dry)))
    assert (float(dynamics.get("damping", 0.0)), float(dynamics.get("friction", 0.0))) == wanted
    assert (float(constant), float(joint.get("frictionloss", 0.0))) == wanted
    told = f"friction model {name}, values {' '.join(map(str, values))}"
    assert (told in urdf) == (name not in {"coulomb", "coulomb-viscous"})
    assert (told in mjcf) == (name not in {"coulomb", "coulomb-viscous", "cubic"})
    assert all(str(value) in urdf for value in shape)
