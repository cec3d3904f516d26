"""MJCF models that are wrong or not supported: each mistake is told with its place, all of a file at once."""

import pytest

import symid
from symid.errors import RobotError
from symid.robot.mjcf_reader import read_xml_robot
from tests.mistakes import refuse, take_mark
from tests.mujocos import parse_mjcf

TWICE = "robot.two-forms"
GEOM = '<geom size="0.1"/>'
INERTIAL = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
ARM = (
    f'<body name="a"><joint name="j"/>{GEOM}'
    f'<body name="b"><joint name="k"/>{GEOM}<body name="c"><joint name="m"/>{GEOM}</body></body></body>'
)


def build(*lines, body=ARM):
    return "\n".join(("<mujoco>", f"<worldbody>{body}</worldbody>", *lines, "</mujoco>"))


def add(inner):
    return f'<body name="x">\n{inner}</body>'


def ask(tag, attributes, pair='joint1="k" joint2="j"'):
    return f"<equality><{tag} {pair} {attributes}/></equality>"


UNSUPPORTED, LOOP = "robot.mjcf-unsupported", "robot.closed-loop"


# "^" marks the place that is told.
IN_MODEL = [
    (LOOP, '<equality>^<connect body1="a" body2="c" anchor="0 0 0"/></equality>', 'write active="false"'),
    (LOOP, '<equality>^<weld body1="a" body2="c"/></equality>', "closes a loop"),
    (LOOP, '<equality>^<flex flex="t"/></equality>', "closes a loop"),
    (UNSUPPORTED, ask("joint", 'polycoef="^0 1 0.5"'), "leave out the terms of higher order"),
    ("robot.unknown-name", '<equality><joint joint1="k" joint2="^jj"/></equality>', 'no joint2 "jj"'),
    ("robot.missing-key", '<equality>^<joint joint2="j"/></equality>', 'write joint1="..."'),
    (TWICE, ask("joint", "") + ask("joint", "", 'joint1="^k" joint2="m"'), "follows another one already"),
    ("robot.out-of-range", '<actuator><motor joint="j" gear="^0"/></actuator>', "gear: must not be 0"),
    (UNSUPPORTED, '<actuator><motor joint="j" armature="^1e-4"/></actuator>', "joint, times gear^2"),
    ("robot.unknown-name", '<actuator><motor joint="^q"/></actuator>', 'no joint "q"'),
    ("robot.unknown-name", '<actuator><motor class="^big" joint="j"/></actuator>', 'no default class "big"'),
    (
        "robot.duplicate-joint",
        '<tendon>^<fixed name="7" armature="1"><joint joint="j" coef="1"/></fixed></tendon>',
        "a name of its own that is no number",
    ),
    (UNSUPPORTED, '<compiler settotalmass="^3"/>', "write the values that it gives into the bodies"),
    (UNSUPPORTED, '<compiler boundmass="^0.1"/>', "boundmass"),
    (UNSUPPORTED, '<compiler coordinate="^global"/>', "write local ones"),
    ("robot.unknown-name", '<compiler angle="^grad"/>', "one of radian, degree"),
    ("robot.unknown-name", '<compiler eulerseq="^xyw"/>', "three of the letters"),
    ("robot.unknown-name", '<compiler autolimits="^auto"/>', "one of true, false"),
    ("robot.duplicate-class", '<default class="^arm"/>', 'write <default class="arm"> into it'),
    ("robot.duplicate-class", "<default>^<default/></default>", "needs a name"),
    ("robot.duplicate-class", '<default><default class="x"/><default class="^x"/></default>', "taken"),
    ("robot.bad-number", '<option gravity="^0 0"/>', "three finite numbers"),
    ("robot.mjcf-include", '<include file="^other.xml"/>', "in the folder of the model"),
    ("robot.mjcf-include", "^<include/>", "needs a file"),
]
IN_BODY = [
    ("robot.joint-type", f'<joint type="^ball"/>{GEOM}', "write it as three hinges"),
    ("robot.joint-type", f"^<freejoint/>{GEOM}", "start after it with --base x"),
    ("robot.joint-type", f'<joint type="^free"/>{GEOM}', "remove it, which fixes the body"),
    ("robot.unknown-name", f'<joint type="^bal"/>{GEOM}', "did you mean ball?"),
    ("robot.duplicate-joint", f'<joint name="^j"/>{GEOM}', "the joint of line 2"),
    ("robot.zero-axis", f'<joint axis="^0 0 0"/>{GEOM}', "has no direction"),
    ("robot.bad-number", f'<joint axis="^0 0"/>{GEOM}', "three finite numbers"),
    ("robot.bad-limits", f'<joint range="^2 1"/>{GEOM}', "must not exceed the second"),
    ("robot.out-of-range", f'<joint armature="^-1"/>{GEOM}', "armature: must be at least 0"),
    (UNSUPPORTED, f'<joint damping="^1 2"/>{GEOM}', "a polynomial is not supported"),
    (UNSUPPORTED, f'<joint springdamper="^1 2"/>{GEOM}', "write the stiffness and damping"),
    (UNSUPPORTED, f'<joint stiffness="1" springyield="^2"/>{GEOM}', "leave it out"),
    (UNSUPPORTED, '<joint/>^<geom type="mesh" mesh="m"/>', "give the body an <inertial>"),
    (UNSUPPORTED, '<joint/>^<geom type="box" mesh="m" size="1 1 1"/>', "that of a mesh"),
    (UNSUPPORTED, '<joint/>^<geom size="1" shellinertia="true"/>', "that of a shell"),
    ("robot.out-of-range", '<joint/><geom type="box" size="^1 1"/>', "a box needs 3 numbers"),
    ("robot.missing-key", '<joint/>^<inertial mass="1"/>', "needs pos"),
    (TWICE, f"<joint/>{INERTIAL}^{INERTIAL}", "a second <inertial>"),
    (
        TWICE,
        '<joint/><inertial pos="0 0 0" mass="1" quat="1 0 0 0" fullinertia="^1 1 1 0 0 0"/>',
        "leave out diaginertia and orientations",
    ),
    ("robot.out-of-range", '<joint/><inertial pos="0 0 0" mass="^-1"/>', "mass: must be at least 0"),
    (UNSUPPORTED, "<joint/>^<composite/>", "save the model from MuJoCo"),
    ("robot.zero-axis", f'<joint/>{GEOM}<body quat="^0 0 0 0"/>', "must not be zero"),
    ("robot.zero-axis", f'<joint/>{GEOM}<body zaxis="^0 0 0"/>', "has no direction"),
    ("robot.zero-axis", f'<joint/>{GEOM}<body xyaxes="^1 0 0 2 0 0"/>', "different directions"),
    (TWICE, f'<joint/>{GEOM}<body quat="1 0 0 0" euler="^1 2 3"/>', "quat and euler mean the same"),
    ("robot.duplicate-link", f'<joint/>{GEOM}<body name="^a"/>', "the body of line 2"),
    ("robot.unknown-name", f'<joint class="^no"/>{GEOM}', 'no default class "no"'),
    ("robot.bad-number", f'<joint pos="^1,2 0 0"/>{GEOM}', "written with a point"),
]
ELSEWHERE = [
    (
        "robot.mimic-ring",
        build(
            ask("joint", "") + ask("joint", "", 'joint1="j" joint2="k"'),
            body=ARM.replace("<joint", "^<joint", 1),
        ),
        "in a ring",
    ),
    (
        UNSUPPORTED,
        build(
            '<compiler balanceinertia="true"/>',
            body=ARM + "^" + add('<joint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 3"/>'),
        ),
        "balanceinertia changes the inertia",
    ),
]


@pytest.mark.parametrize(
    ("code", "text", "words"),
    [
        *((code, build(text), words) for code, text, words in IN_MODEL),
        *((code, build(body=ARM + add(text)), words) for code, text, words in IN_BODY),
        *ELSEWHERE,
    ],
)
def test_a_mistake_is_told(code, text, words):
    text, place = take_mark(text)
    notice = refuse(parse_mjcf, text, "arm.xml")[0]
    assert (notice.code, notice.file, (notice.line, notice.column)) == (code, "arm.xml", place)
    assert words in notice.text


def test_all_mistakes_are_told_at_once():
    text = build(
        ask("weld", "", ""),
        '<actuator><motor joint="q"/></actuator>',
        body=ARM + add(f'<joint armature="-1" axis="0 0 0"/>{GEOM}'),
    )
    notices = refuse(parse_mjcf, text, "arm.xml", base="nowhere")
    codes = [notice.code for notice in notices]
    assert sorted(codes) == sorted(
        ["robot.bad-cut", "robot.zero-axis", "robot.out-of-range", LOOP, "robot.unknown-name"]
    )
    assert [notice.line for notice in notices] == sorted(notice.line for notice in notices)


def test_a_base_behind_a_free_joint_is_allowed():
    body = f'<body name="torso"><freejoint/>{GEOM}{ARM}</body>'
    notices = refuse(parse_mjcf, build(body=body))
    assert [notice.code for notice in notices] == ["robot.joint-type"]
    assert len(parse_mjcf(build(body=body), base="torso").joints) == 3


def test_a_mistake_in_an_included_file_has_its_place_there(tmp_path):
    (tmp_path / "arm.xml").write_text('<mujoco>\n<include file="parts.xml"/></mujoco>', encoding="utf-8")
    (tmp_path / "parts.xml").write_text(
        f'<mujocoinclude><worldbody><body>\n  <joint axis="0 0 x"/>{GEOM}</body></worldbody></mujocoinclude>',
        encoding="utf-8",
    )
    (notice,) = refuse(read_xml_robot, tmp_path / "arm.xml")
    assert (notice.file, notice.line, notice.column) == (str(tmp_path / "parts.xml"), 2, 16)
    (tmp_path / "parts.xml").write_text('<mujoco><include file="parts.xml"/></mujoco>', encoding="utf-8")
    with pytest.raises(RobotError, match="a file is included once"):
        symid.load(tmp_path / "arm.xml")
