"""Friction laws in robot files: read, refused, written, set; their earlier names."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import pytest

from symid.errors import RobotError, UsageError
from symid.joint_models import FrictionValues, get_law, name_values
from symid.notation import SYMBOLS, get_unit
from symid.robot.loading import override_robot
from symid.robot.simulator_writers import write_mjcf, write_urdf
from symid.robot.toml_reader import parse_robot
from symid.robot.toml_writer import write_robot
from tests.friction_forms import EVERY_LAW, OLD_NAMES, give_shape

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


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
@pytest.mark.parametrize("name", EVERY_LAW)
def test_every_law_is_read_and_written(name, kind):
    law, shape = get_law(name), give_shape(name)
    names, keys = [entry.name for entry in law.linear], [entry.name for entry in law.shape]
    lines = [f'model = "{name}"', *(f"{key} = {k + 1}.5" for k, key in enumerate(names))]
    lines += [f"{key} = {value}" for key, value in zip(keys, shape, strict=True)]
    steps = "makkar" not in name and not name.startswith("improved-stribeck")
    steps = steps or name.startswith(("improved-stribeck-h3", "improved-stribeck-h4"))
    robot = parse("\n".join([*lines, *(["smoothing = 0.01"] if steps else [])]), kind)
    friction = robot.joints[0].friction
    assert friction.law == name
    assert friction.values == tuple(k + 1.5 for k in range(len(names)))
    assert friction.shape == shape
    assert friction.smoothing == (0.01 if steps else 0.0)
    text = write_robot(robot)
    assert f'model = "{name}"' in text
    assert parse_robot(text).joints[0].friction == friction
    unknown = parse("\n".join([lines[0], *lines[1 + len(names) :]]), kind)
    assert unknown.joints[0].friction == replace(friction, values=None, smoothing=0.0)
    assert parse_robot(write_robot(unknown)).joints[0].friction == unknown.joints[0].friction


OLD_TABLES = {
    "viscous_coulomb": ("Fv = 1\nFc = 2", (1.0, 2.0), ()),
    "viscous_coulomb_offset": ("Fv = 1\nFc = 2\noffset = 3", (1.0, 2.0, 3.0), ()),
    "asymmetric": ("Fvp = 1\nFcp = 2\nFvn = 3\nFcn = 4", (1.0, 2.0, 3.0, 4.0), ()),
    "stribeck": ("Fv = 1\nFc = 2\nFe = 3\nvs = 0.1", (1.0, 2.0, 3.0), (0.1,)),
    "stribeck_offset": ("Fv = 1\nFc = 2\nFe = 3\noffset = 4\nvs = 0.1", (1.0, 2.0, 3.0, 4.0), (0.1,)),
    "improved_stribeck": (
        "Fv = 1\nFc = 2\nFe = 3\nFp = 4\nvs = 0.1\ndq0 = 0.02",
        (1.0, 2.0, 3.0, 4.0),
        (0.1, 0.02),
    ),
    "asymmetric_stribeck": (
        "Fvp = 1\nFcp = 2\nFvn = 3\nFcn = 4\nFe = 5\nvs = 0.1",
        (1.0, 2.0, 3.0, 4.0, 5.0),
        (0.1,),
    ),
    "cubic": ("Fv = 1\nFc = 2\nFvq = 3\nFvc = 4", (1.0, 2.0, 3.0, 4.0), ()),
    "stribeck_cubic": (
        "Fv = 1\nFc = 2\nFe = 3\nFvq = 4\nFvc = 5\nvs = 0.1",
        (1.0, 2.0, 3.0, 4.0, 5.0),
        (0.1,),
    ),
    "power_law": ("Fc = 1\nFd = 2\ndelta = 0.5", (1.0, 2.0), (0.5,)),
    "makkar": ("Fm = 1\nFc = 2\nFv = 3\ng2 = 9\ng3 = 2\ng5 = 7", (1.0, 2.0, 3.0), (9.0, 2.0, 7.0)),
}


@pytest.mark.parametrize("name", OLD_NAMES)
def test_files_of_earlier_versions_are_read_and_written_with_the_name_of_the_law(name):
    table, values, shape = OLD_TABLES[name]
    robot = parse(f'model = "{name}"\n{table}')
    assert robot.joints[0].friction == FrictionValues(law=OLD_NAMES[name], values=values, shape=shape)
    text = write_robot(robot)
    assert f'model = "{OLD_NAMES[name]}"' in text
    assert parse_robot(text).joints[0].friction == robot.joints[0].friction


@pytest.mark.parametrize(
    ("name", "gamma", "law", "shape"),
    [
        ("stribeck", None, "stribeck", (0.1,)),
        ("stribeck", "2", "stribeck", (0.1,)),
        ("stribeck", "2.0", "stribeck", (0.1,)),
        ("stribeck", "1.6", "stribeck-exponent", (0.1, 1.6)),
        ("stribeck", "1", "tustin", (0.1,)),
        ("stribeck_offset", "1.6", "stribeck-exponent+offset", (0.1, 1.6)),
        ("stribeck_offset", "1.0", "tustin+offset", (0.1,)),
        ("stribeck_cubic", "1.6", "stribeck-exponent+cubic", (0.1, 1.6)),
        ("stribeck_cubic", "1", "stribeck-1+cubic", (0.1,)),
        ("improved_stribeck", "1.6", "improved-stribeck-exponent", (0.1, 0.02, 1.6)),
        ("improved_stribeck", "1", "improved-stribeck-1", (0.1, 0.02)),
        ("asymmetric_stribeck", "0.7", "asymmetric-stribeck-exponent", (0.1, 0.7)),
        ("asymmetric_stribeck", "1", "asymmetric-stribeck-1", (0.1,)),
        ("stribeck+offset", "1.6", "stribeck-exponent+offset", (0.1, 1.6)),
        ("stribeck-exponent", "1.6", "stribeck-exponent", (0.1, 1.6)),
        ("stribeck-exponent", "1", "stribeck-exponent", (0.1, 1.0)),
        ("stribeck-exponent", None, "stribeck-exponent", (0.1, 2.0)),
        ("load-dependent-stribeck", "1.6", "load-dependent-stribeck-exponent", (0.1, 1.6)),
        ("asymmetric-stribeck-both", "1.6", "asymmetric-stribeck-both-exponent", (0.1, 1.6)),
    ],
)
def test_an_exponent_beside_the_model_is_part_of_the_law(name, gamma, law, shape):
    edge = "dq0 = 0.02\n" if "improved" in name else ""
    stated = "" if gamma is None else f"gamma = {gamma}\n"
    robot = parse(f'model = "{name}"\nvs = 0.1\n{edge}{stated}')
    assert robot.joints[0].friction == FrictionValues(law=law, shape=shape)
    assert parse_robot(write_robot(robot)).joints[0].friction == robot.joints[0].friction


@pytest.mark.parametrize("gamma", ["true", '"two"', "inf", "nan", "[2]", '"unknown"'])
@pytest.mark.parametrize("name", ["stribeck", "stribeck-exponent"])
def test_an_exponent_that_is_no_number_is_refused(name, gamma):
    with pytest.raises(RobotError, match="gamma: expected a number") as caught:
        parse(f'model = "{name}"\nvs = 0.1\ngamma = {gamma}')
    assert [notice.code for notice in caught.value.notices] == ["robot.wrong-type"]


@pytest.mark.parametrize("gamma", ["0", "-1", "10.5"])
@pytest.mark.parametrize("name", ["stribeck", "stribeck_offset", "improved-stribeck-exponent"])
def test_an_exponent_out_of_range_is_refused(name, gamma):
    edge = "dq0 = 0.02\n" if "improved" in name else ""
    with pytest.raises(RobotError, match="gamma: must be greater than 0 and at most 10") as caught:
        parse(f'model = "{name}"\nvs = 0.1\n{edge}gamma = {gamma}')
    assert [notice.code for notice in caught.value.notices] == ["robot.out-of-range"]


@pytest.mark.parametrize("name", ["tustin", "stribeck-1.6", "lorentzian", "cubic"])
def test_a_law_whose_exponent_is_fixed_has_no_gamma(name):
    shape = "" if name == "cubic" else "vs = 0.1\n"
    with pytest.raises(RobotError, match=f'gamma: not a value of the model "{name}"') as caught:
        parse(f'model = "{name}"\n{shape}gamma = 1.6')
    assert [notice.code for notice in caught.value.notices] == ["robot.friction-values"]


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("viscous", "Known laws: coulomb, "),
        ("stribek", "did you mean stribeck"),
        ("stribeck-50", "exponent must be above 0 and at most 10"),
        ("lugr", "did you mean lugre"),
        ("", "unknown friction law ''"),
    ],
)
def test_a_model_that_does_not_exist_is_refused(name, hint):
    with pytest.raises(RobotError, match=hint) as caught:
        parse(f'model = "{name}"\nFv = 1')
    (notice,) = caught.value.notices
    assert (notice.code, notice.line) == ("robot.friction-model", 11)
    assert notice.text.startswith("joint 'a': friction: model: ")


@pytest.mark.parametrize("name", [name for name in EVERY_LAW if get_law(name).inputs != ("velocity",)])
def test_a_drive_of_several_joints_feels_neither_load_nor_position_nor_temperature_of_one(name):
    shape = "".join(
        f"{entry.name} = {value}\n"
        for entry, value in zip(get_law(name).shape, give_shape(name), strict=True)
    )
    table = f'model = "{name}"\n{shape}'
    second = '\n[[joint]]\nname = "b"\nkind = "revolute"\n'
    follower = second + f'mimic = {{ joint = "a" }}\n[joint.friction]\n{table}'
    coupling = f'{second}\n[[coupling]]\nname = "m"\nterms = {{ a = 1, b = 1 }}\n[coupling.friction]\n{table}'
    for text in (follower, coupling):
        with pytest.raises(RobotError, match="acts on several; choose a model of the velocity") as caught:
            parse('model = "none"\n' + text)
        assert [notice.code for notice in caught.value.notices] == ["robot.friction-model"]
    # The joint that is followed has a drive of its own.
    assert parse(table + second + 'mimic = { joint = "a" }').joints[0].friction.law == name


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('model = "cubic"\nFv = 0.6\nFc = 0.2\nFvq = -1\nFvc = 0', "Fvq: -1 drives the joint from about 0.8"),
        (
            'model = "cubic"\nFv = 0.6\nFc = 0.9\nFvq = 0\nFvc = -0.01',
            "Fvc: -0.01 drives the joint from about 8.5 rad/s",
        ),
        ('model = "stribeck"\nFv = 1\nFc = 1\nFe = -3\nvs = 0.1', "Fe: -3 drives the joint as motion begins"),
        (
            'model = "asymmetric_stribeck"\nFvp = 1\nFcp = 1\nFvn = 1\nFcn = 2\nFe = -1.6\nvs = 0.1',
            "Fe: -1.6 drives the joint as motion begins",
        ),
        ('model = "makkar"\nFm = 3\nFc = 0.1\nFv = 0\ng2 = 1\ng3 = 100\ng5 = 10', "outweigh Fm"),
        ('model = "improved_stribeck"\nFv = 1\nFc = 1\nFe = -3\nFp = 1\nvs = 0.1\ndq0 = 0.02', "Fe: -3"),
        ('model = "stribeck"\nFv = 1\nFc = 1\nFe = -3\nvs = 0.1\nsmoothing = 0.01', "Fe: -3 drives"),
        (
            'model = "lorentzian"\nFv = 1\nFc = 1\nFe = -3\nvs = 0.1',
            "Fe: -3 drives the joint as motion begins",
        ),
        ('model = "polynomial-4"\nFv = 1\nFc = 1\nFv4 = -1', "Fv4: -1 drives the joint from about 1.2 rad/s"),
        (
            'model = "asymmetric-stribeck-both"\nvs = 9\nFvp=1\nFvn=1\nFcp=1\nFcn=1\nFep=-3\nFen=0',
            "Fep: -3 drives the joint as motion begins",
        ),
        ('model = "load-dependent"\nFv = 1\nFc = 1\nFl = -0.1', "Fl: -0.1 drives the joint instead"),
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
        'model = "polynomial-4"\nFv = 0.6\nFc = 0.2\nFv4 = -1\n[joint.limits]\nvelocity = 0.9',
        'model = "lorentzian"\nFv = 1\nFc = 1\nFe = -0.9\nvs = 0.1',
        'model = "position-torque"\nFv = 1\nFc = 1\nA1 = -9\nB1 = 9\nA2 = 0\nB2 = 0',
        'model = "temperature"\nFv = 1\nFc = 1\nFvt = -0.1\nFct = -0.1',
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
            "delta: missing; the model needs it as a number",
        ),
        ('model = "stribeck"\nvs = 0', "revolute", "robot.out-of-range", "vs"),
        ('model = "cubic"\nvs = 0.1', "revolute", "robot.friction-values", 'vs: .*"cubic"'),
        (
            'model = "stribeck"\nvs = 0.1\ndq0 = 1',
            "revolute",
            "robot.friction-values",
            "dq0: .*shape values vs, gamma",
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


def test_a_law_can_be_set_where_its_shape_is_known():
    robot = parse('model = "stribeck"\nFv = 1\nFc = 2\nFe = 0.5\nvs = 0.05')
    assert override_robot(robot, (), "stribeck").joints == robot.joints
    assert override_robot(robot, (), "cubic").joints[0].friction.law == "cubic"
    plain = override_robot(robot, (), "coulomb-viscous")
    assert plain.joints[0].friction == FrictionValues(law="coulomb-viscous")
    assert override_robot(robot, (), "none").joints[0].friction == FrictionValues()
    with pytest.raises(UsageError, match=r"needs vs of joint 'a'") as caught:
        override_robot(plain, (), "stribeck")
    assert caught.value.notices[0].code == "usage.friction-shape"
    with pytest.raises(UsageError, match=r"needs vs, gamma of joint 'a'"):
        override_robot(robot, (), "stribeck-exponent")


@pytest.mark.parametrize("name", EVERY_LAW)
def test_any_law_without_shape_values_can_be_set(name):
    robot = parse('model = "coulomb"\nFc = 2')
    if get_law(name).shape:
        with pytest.raises(UsageError, match="which no option gives; write it into the robot file"):
            override_robot(robot, (), name)
    else:
        values = (2.0,) if name == "coulomb" else None
        friction = override_robot(robot, (), name).joints[0].friction
        assert friction == FrictionValues(law=name, values=values)


@pytest.mark.parametrize("name", OLD_NAMES)
def test_a_law_can_be_set_by_the_name_of_earlier_versions(name):
    table, values, shape = OLD_TABLES[name]
    robot = parse(f'model = "{name}"\n{table}')
    # Its values stay, as it is the same law.
    assert override_robot(robot, (), name).joints[0].friction.values == values
    assert override_robot(robot, (), OLD_NAMES[name]).joints == robot.joints
    if not shape:
        bare = override_robot(parse('model = "coulomb"'), (), name)
        assert bare.joints[0].friction == FrictionValues(law=OLD_NAMES[name])


@pytest.mark.parametrize(("kind", "prismatic"), [("revolute", False), ("prismatic", True)])
@pytest.mark.parametrize("name", EVERY_LAW)
def test_units_are_those_of_the_law(name, kind, prismatic):
    law = get_law(name)
    entries = (*law.linear, *law.shape)
    # An exponent that is no number is tested on its own.
    entries = [entry for entry in entries if entry.name != "gamma"]
    wrong = "\n".join(f"{entry.name} = true" for entry in entries)
    with pytest.raises(RobotError) as caught:
        parse(f'model = "{name}"\n{wrong}', kind)
    told = [notice.text for notice in caught.value.notices if notice.code == "robot.wrong-type"]
    assert len(told) == len(entries)
    for entry, text in zip(entries, told, strict=True):
        unit = (entry.unit_prismatic if prismatic else entry.unit).replace(" ", "*")
        assert f" {entry.name}: expected a number" in text
        assert entry.unit == "1" or f" in {unit}," in text


@pytest.mark.parametrize("prismatic", [False, True])
def test_units_of_the_catalogue_are_those_of_the_notation(prismatic):
    known = {symbol.name for symbol in SYMBOLS}
    entries = {entry.name: entry for name in EVERY_LAW for entry in get_law(name).linear}
    assert {"Fv", "Fc", "offset", "Fe", "Fp", "Fvq", "Fvc", "Fd", "Fm"} <= entries.keys() & known
    for name in entries.keys() & known:
        unit = entries[name].unit_prismatic if prismatic else entries[name].unit
        assert get_unit(name, prismatic=prismatic) == unit


def test_a_urdf_says_what_it_leaves_out():
    text = write_urdf(parse('model = "stribeck"\nFv = 1\nFc = 2\nFe = 0.5\nvs = 0.05'))
    assert "friction model stribeck, values 1.0 2.0 0.5, shape 0.05 (Fv, Fc, Fe; vs)" in text


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
    for found in (
        (dynamics.get("damping", 0.0), dynamics.get("friction", 0.0)),
        (constant, joint.get("frictionloss", 0.0)),
    ):
        assert tuple(map(float, found)) == (
            pytest.approx(sum(damping) / len(damping)),
            pytest.approx(sum(dry) / len(dry)),
        )
    told = f"friction model {name}, values {' '.join(map(str, values))}"
    assert (told in urdf) == (name not in {"coulomb", "coulomb-viscous"})
    assert (told in mjcf) == (name not in {"coulomb", "coulomb-viscous", "cubic"})
    assert all(str(value) in urdf for value in shape)
