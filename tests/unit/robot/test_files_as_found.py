"""Robot files as people have them: faults outside the chain, xacro arguments, matrices, texts."""

import pytest

import symid
from symid.errors import RobotError, UsageError
from symid.identification.export import place_in_source
from symid.robot.mjcf_reader import parse_xml_robot

LIMIT = '<limit lower="-1" upper="1" effort="10" velocity="10"/>'
ARM = (
    '<robot name="arm"><link name="base"/><link name="upper"/><link name="hand"/><link name="wheel"/>'
    '{links}<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>'
    f'<axis xyz="0 0 1"/>{{own}}{LIMIT}</joint><joint name="elbow" type="revolute">'
    f'<parent link="upper"/><child link="hand"/><axis xyz="0 1 0"/>{LIMIT}</joint>{{others}}</robot>'
)


def write_wheel(inside="", parent="base", axis="0 1 0", kind="continuous"):
    return (
        f'<joint name="w" type="{kind}"><parent link="{parent}"/><child link="wheel"/><axis xyz="{axis}"/>'
        f"{inside}</joint>"
    )


HEAVY = '<link name="lid"><inertial><mass value="-1"/></inertial></link>'
OUTSIDE = {
    "second limit": ("", write_wheel(LIMIT + LIMIT)),
    "axis without direction": ("", write_wheel(axis="0 0 0")),
    "unknown type": ("", write_wheel(kind="spherical", parent="hand")),
    "unknown parent": ("", write_wheel(parent="chassis")),
    "no number": (HEAVY.replace("-1", "one"), write_wheel()),
    "negative mass, not connected": (HEAVY, write_wheel()),
    "transmission": (
        "",
        write_wheel() + '<transmission name="t"><joint name="w"/><actuator name="m">'
        "<mechanicalReduction>0</mechanicalReduction></actuator></transmission>",
    ),
    "loop": (
        "",
        write_wheel() + '<loop_joint name="l"><link1 link="wheel"/><link2 link="hand"/></loop_joint>',
    ),
    "two parents": ("", write_wheel() + write_wheel().replace('"w"', '"v"').replace('"base"', '"upper"')),
}


@pytest.mark.parametrize("name", OUTSIDE)
def test_what_is_outside_the_chosen_chain_blocks_nothing(name):
    links, others = OUTSIDE[name]
    text = ARM.format(links=links, own="", others=others)
    robot = parse_xml_robot(text, "arm.urdf", tip="hand")
    assert [joint.name for joint in robot.joints] == ["shoulder", "elbow"]
    with pytest.raises(RobotError):
        parse_xml_robot(text, "arm.urdf")


@pytest.mark.parametrize("own", [LIMIT, '<dynamics damping="a"/>', '<origin xyz="0 0"/>'])
def test_what_is_inside_still_does(own):
    with pytest.raises(RobotError, match="shoulder"):
        parse_xml_robot(
            ARM.format(links="", own=own, others=write_wheel(LIMIT + LIMIT)), "arm.urdf", tip="hand"
        )


def test_the_wheel_of_another_chain(shared_data):
    path = shared_data.parent / "cases" / "robots" / "duplicate_limit.urdf"
    assert [joint.name for joint in symid.load(path, tip="upper").description.joints] == ["shoulder"]


XACRO = (
    (
        '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arg name="prefix" default=""/>'
        '<xacro:arg name="length" default="0.2"/>'
        + ARM.format(links="", own="", others=write_wheel()).removeprefix('<robot name="arm">')
    )
    .replace("shoulder", "$(arg prefix)shoulder")
    .replace("<axis xyz", '<origin xyz="$(arg length) 0 0"/><axis xyz')
)


def test_xacro_arguments(tmp_path):
    pytest.importorskip("xacro", reason="wants the extra xacro")
    path = tmp_path / "arm.xacro"
    path.write_text(XACRO)
    for given in (
        {"prefix": "left_", "length": "0.5"},
        ["prefix:=left_", "length:=0.5"],
        {"length": 0.5},
        [],
    ):
        robot = symid.load(path, tip="hand", xacro=given)
        length = 0.5 if given else 0.2
        assert robot.description.joints[1].placement.translation[0].to_float() == pytest.approx(length)
        assert robot.description.joints[0].name == ("left_shoulder" if "prefix" in str(given) else "shoulder")
        (note,) = [entry.text for entry in robot.notices if entry.code == "robot.xacro-arguments"]
        assert ("arguments at their defaults" in note) == ("prefix" not in str(given))
    for wrong, words in (
        ({"lenght": "1"}, "no such argument; did you mean length"),
        (["length"], "expected NAME:=VALUE"),
        ([":=1"], "expected NAME:=VALUE"),
    ):
        with pytest.raises(UsageError, match=words) as caught:
            symid.load(path, xacro=wrong)
        assert {entry.code for entry in caught.value.notices} == {"usage.xacro"}
    with pytest.raises(UsageError, match="only a xacro file"):
        symid.load("two_link", xacro={"a": "b"})
    plain = tmp_path / "arm.urdf"
    plain.write_text(ARM.format(links="", own="", others=write_wheel()))
    with pytest.raises(UsageError, match="only a xacro file"):
        symid.load(plain, xacro={"a": "b"})


@pytest.mark.parametrize(
    "given", [{"prefix": "left_", "length": "0.5"}, {"length": "0.75"}, {"prefix": "b_"}]
)
def test_an_export_has_the_arguments_of_the_xacro_file(tmp_path, given):
    pytest.importorskip("xacro", reason="wants the extra xacro")
    path = tmp_path / "arm.xacro"
    path.write_text(XACRO)
    robot = symid.load(path, tip="hand", xacro=given)
    (tmp_path / "kept").mkdir()
    copy = symid.load(robot.export(tmp_path / "kept" / "arm.toml").file)
    assert dict(copy.description.made_from.xacro) == given
    for made in (robot.description.made_from, copy.description.made_from):
        _, back, notices = place_in_source(robot.description, made, in_place=False)
        assert notices == []
        assert [joint.name for joint in back.joints] == [joint.name for joint in robot.description.joints]
        length = float(given.get("length", 0.2))
        assert back.joints[1].placement.translation[0].to_float() == pytest.approx(length)


TOML = """name = "m"
convention = "standard"
gravity = [0, 0, -9.81]
[[joint]]
kind = "revolute"
{row}
[joint.link]
mass = 0.5
com = [0.1, 0, 0]
inertia = {inertia}
"""
TABLE = "{ xx = 2e-2, yy = 3e-2, zz = 2.5e-2, xy = 1e-3, xz = -2e-3, yz = 4e-4 }"
MATRIX = "[[2e-2, 1e-3, -2e-3], [1e-3, 3e-2, 4e-4], [-2e-3, 4e-4, 2.5e-2]]"


def read(tmp_path, row="", inertia=TABLE):
    path = tmp_path / "m.toml"
    path.write_text(TOML.format(row=row, inertia=inertia))
    return symid.load(path).description.joints[0]


@pytest.mark.parametrize(
    "matrix", [MATRIX, MATRIX.replace("[1e-3", "[1.000001e-3"), MATRIX.replace(" 4e-4,", " 4.00001e-4,")]
)
def test_an_inertia_may_be_a_matrix(tmp_path, matrix):
    expected = read(tmp_path).inertial
    assert read(tmp_path, inertia=matrix).inertial == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize(
    ("matrix", "code"),
    [
        (MATRIX.replace("[1e-3", "[-1e-3"), "robot.asymmetric-inertia"),
        ("[[1, 0, 0], [0, 1, 0]]", "robot.wrong-type"),
        ("[1, 1, 1]", "robot.wrong-type"),
        (MATRIX.replace("3e-2", "-3e-2"), "robot.out-of-range"),
        (MATRIX.replace("3e-2", '"heavy"'), "robot.unknown-symbol"),
    ],
)
def test_other_matrices_are_refused_at_their_place(tmp_path, matrix, code):
    with pytest.raises(RobotError) as caught:
        read(tmp_path, inertia=matrix)
    assert [(entry.code, entry.line) for entry in caught.value.notices] == [(code, 10)]


@pytest.mark.parametrize(
    ("text", "angle"),
    [("0", 0.0), ("0.5", 0.5), ("-1.25", -1.25), ("pi/2 - 0.1", 1.4707963267948966), ("1/3", 1 / 3)],
)
def test_an_angle_may_be_a_text(tmp_path, text, angle):
    assert read(tmp_path, row=f'alpha = "{text}"').frame == read(tmp_path, row=f"alpha = {angle!r}").frame


@pytest.mark.parametrize("length", ["1e12", "-2e8", "1e30"])
def test_lengths_beyond_doubles_are_named(tmp_path, length):
    path = tmp_path / "arm.urdf"
    text = ARM.format(links="", own="", others=write_wheel())
    path.write_text(text.replace('<child link="hand"/>', f'<child link="hand"/><origin xyz="0 0 {length}"/>'))
    with pytest.raises(RobotError, match="cannot be computed in doubles") as caught:
        symid.load(path, tip="hand").casadi("gravity")
    assert caught.value.notices[0].code == "robot.beyond-doubles"


MODEL = (
    '<mujoco model="m"><compiler angle="radian"/><default><default class="servo"><position kp="30" kv="3"/>'
    '</default></default><worldbody><body name="a"><joint name="j" type="hinge" axis="0 1 0" damping="0.3"/>'
    '<inertial pos="0.2 0 0" mass="1" diaginertia="0.01 0.01 0.01"/></body></worldbody>'
    "<actuator>{}</actuator></mujoco>"
)


@pytest.mark.parametrize(
    ("actuator", "said"),
    [
        ('<damper name="d" joint="j" kv="4" ctrlrange="0 1"/>', "<damper> kv=4"),
        ('<position joint="j" kp="50" kv="2"/>', "<position> kp=50 kv=2"),
        ('<position joint="j" class="servo"/>', "<position> kp=30 kv=3"),
        ('<velocity joint="j" kv="1"/>', "<velocity> kv=1"),
        ('<general joint="j" biastype="affine" biasprm="0 -20 -2"/>', "<general> biasprm=0 -20 -2"),
        ('<motor joint="j"/>', ""),
        ('<general joint="j"/>', ""),
    ],
)
def test_feedback_of_actuators_is_named(actuator, said):
    robot = parse_xml_robot(MODEL.format(actuator), "m.xml")
    found = [entry for entry in robot.notices if entry.code == "robot.mjcf-controller"]
    assert len(found) == bool(said)
    assert all(said in entry.text and "'j'" in entry.text and entry.is_note for entry in found)
    # Damping of the joint itself is read.
    assert robot.joints[0].friction.values == (0.3, 0.0)
