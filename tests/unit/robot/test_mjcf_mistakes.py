"""MJCF models that are wrong or not supported: each mistake is told with its place, all of a file at once."""

import pytest

import symid
from symid.errors import RobotError
from symid.robot.mjcf_reader import read_xml_robot
from tests.mujocos import parse_mjcf

GEOM = '<geom size="0.1"/>'
INERTIAL = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
ARM = (
    f'<body name="a"><joint name="j"/>{GEOM}'
    f'<body name="b"><joint name="k"/>{GEOM}<body name="c"><joint name="m"/>{GEOM}</body></body></body>'
)


def build(*lines, body=ARM):
    return "\n".join(("<mujoco>", f"<worldbody>{body}</worldbody>", *lines, "</mujoco>"))


def refuse(text, **options):
    with pytest.raises(RobotError) as caught:
        parse_mjcf(text, "arm.xml", **options)
    return caught.value.notices


def check(text, code, place, words):
    line, before = place
    notice = refuse(text)[0]
    assert (notice.code, notice.file, notice.line) == (code, "arm.xml", line)
    row = text.splitlines()[line - 1]
    assert row[notice.column - 1 :].startswith(before), row[notice.column - 1 :]
    assert words in notice.text


def add(inner, attributes=""):
    return f'<body name="x"{attributes}>\n{inner}</body>'


def ask(tag, attributes, pair='joint1="k" joint2="j"'):
    return f"<equality><{tag} {pair} {attributes}/></equality>"


UNSUPPORTED, LOOP = "robot.mjcf-unsupported", "robot.closed-loop"


@pytest.mark.parametrize(
    ("lines", "code", "place", "words"),
    [
        (
            ask("connect", 'body1="a" body2="c" anchor="0 0 0"', ""),
            LOOP,
            (3, "<connect"),
            'write active="false"',
        ),
        (ask("weld", 'body1="a" body2="c"', ""), LOOP, (3, "<weld"), "closes a loop"),
        (ask("tendon", 'tendon1="t"', ""), LOOP, (3, "<tendon"), "closes a loop"),
        (
            ask("joint", 'polycoef="0 1 0.5"'),
            UNSUPPORTED,
            (3, "0 1 0.5"),
            "leave out the terms of higher order",
        ),
        (ask("joint", "", 'joint1="k" joint2="jj"'), "robot.unknown-name", (3, "jj"), 'no joint2 "jj"'),
        (ask("joint", "", 'joint2="j"'), "robot.missing-key", (3, "<joint"), 'write joint1="..."'),
        (
            ask("joint", "") + ask("joint", "", 'joint1="k" joint2="m"'),
            "robot.two-forms",
            (3, 'k" joint2="m"'),
            "follows another one already",
        ),
        (
            ask("joint", "") + ask("joint", "", 'joint1="j" joint2="k"'),
            "robot.mimic-ring",
            (2, '<joint name="j"'),
            "in a ring",
        ),
        (
            '<actuator><motor joint="j" gear="0"/></actuator>',
            "robot.out-of-range",
            (3, '0"'),
            "gear: must not be 0",
        ),
        (
            '<actuator><motor joint="j" armature="1e-4"/></actuator>',
            UNSUPPORTED,
            (3, '1e-4"'),
            "write it at its joint, times gear^2",
        ),
        ('<actuator><motor joint="q"/></actuator>', "robot.unknown-name", (3, 'q"'), 'no joint "q"'),
        (
            '<actuator><motor class="big" joint="j"/></actuator>',
            "robot.unknown-name",
            (3, 'big"'),
            'no default class "big"',
        ),
        (
            '<tendon><fixed name="7" armature="1"><joint joint="j" coef="1"/></fixed></tendon>',
            "robot.duplicate-joint",
            (3, "<fixed"),
            "a name of its own that is no number",
        ),
        (
            '<compiler settotalmass="3"/>',
            UNSUPPORTED,
            (3, '3"'),
            "write the values that it gives into the bodies",
        ),
        ('<compiler boundmass="0.1"/>', UNSUPPORTED, (3, '0.1"'), "boundmass"),
        ('<compiler coordinate="global"/>', UNSUPPORTED, (3, 'global"'), "write local ones"),
        ('<compiler angle="grad"/>', "robot.unknown-name", (3, 'grad"'), "one of radian, degree"),
        ('<compiler eulerseq="xyw"/>', "robot.unknown-name", (3, 'xyw"'), "three of the letters"),
        ('<compiler autolimits="auto"/>', "robot.unknown-name", (3, 'auto"'), "one of true, false"),
        (
            '<default class="arm"/>',
            "robot.duplicate-class",
            (3, 'arm"'),
            'write <default class="arm"> into it',
        ),
        ("<default><default/></default>", "robot.duplicate-class", (3, "<default/>"), "needs a name"),
        (
            '<default><default class="x"/><default class="x"/></default>',
            "robot.duplicate-class",
            (3, 'x"/></default>'),
            "taken",
        ),
        ('<option gravity="0 0"/>', "robot.bad-number", (3, '0 0"'), "three finite numbers"),
        (
            '<include file="other.xml"/>',
            "robot.mjcf-include",
            (3, 'other.xml"'),
            "in the folder of the model",
        ),
        ("<include/>", "robot.mjcf-include", (3, "<include"), "needs a file"),
    ],
)
def test_a_wrong_section_is_told(lines, code, place, words):
    check(build(lines), code, place, words)


@pytest.mark.parametrize(
    ("inner", "code", "place", "words"),
    [
        (f'<joint type="ball"/>{GEOM}', "robot.joint-type", (3, 'ball"'), "write it as three hinges"),
        (f"<freejoint/>{GEOM}", "robot.joint-type", (3, "<freejoint"), "start after it with --base x"),
        (f'<joint type="free"/>{GEOM}', "robot.joint-type", (3, 'free"'), "remove it, which fixes the body"),
        (f'<joint type="bal"/>{GEOM}', "robot.unknown-name", (3, 'bal"'), "did you mean ball?"),
        (f'<joint name="j"/>{GEOM}', "robot.duplicate-joint", (3, 'j"'), "the joint of line 2"),
        (f'<joint axis="0 0 0"/>{GEOM}', "robot.zero-axis", (3, '0 0 0"'), "has no direction"),
        (f'<joint axis="0 0"/>{GEOM}', "robot.bad-number", (3, '0 0"'), "three finite numbers"),
        (f'<joint range="2 1"/>{GEOM}', "robot.bad-limits", (3, '2 1"'), "must not exceed the second"),
        (f'<joint armature="-1"/>{GEOM}', "robot.out-of-range", (3, '-1"'), "armature: must be at least 0"),
        (f'<joint damping="1 2"/>{GEOM}', UNSUPPORTED, (3, '1 2"'), "a polynomial is not supported"),
        (f'<joint springdamper="1 2"/>{GEOM}', UNSUPPORTED, (3, '1 2"'), "write the stiffness and damping"),
        (f'<joint stiffness="1" springyield="2"/>{GEOM}', UNSUPPORTED, (3, '2"/>'), "leave it out"),
        ('<joint/><geom type="mesh" mesh="m"/>', UNSUPPORTED, (3, "<geom"), "give the body an <inertial>"),
        ('<joint/><geom type="box" mesh="m" size="1 1 1"/>', UNSUPPORTED, (3, "<geom"), "that of a mesh"),
        ('<joint/><geom size="1" shellinertia="true"/>', UNSUPPORTED, (3, "<geom"), "that of a shell"),
        ('<joint/><geom type="box" size="1 1"/>', "robot.out-of-range", (3, '1 1"'), "a box needs 3 numbers"),
        ('<joint/><inertial mass="1"/>', "robot.missing-key", (3, "<inertial"), "needs pos"),
        (f"<joint/>{INERTIAL}{INERTIAL}", "robot.two-forms", (3, "<inertial"), "a second <inertial>"),
        (
            '<joint/><inertial pos="0 0 0" mass="1" quat="1 0 0 0" fullinertia="1 1 1 0 0 0"/>',
            "robot.two-forms",
            (3, '1 1 1 0 0 0"'),
            "leave out diaginertia and orientations",
        ),
        (
            '<joint/><inertial pos="0 0 0" mass="-1"/>',
            "robot.out-of-range",
            (3, '-1"'),
            "mass: must be at least 0",
        ),
        ("<joint/><composite/>", UNSUPPORTED, (3, "<composite"), "save the model from MuJoCo"),
        (f'<joint/>{GEOM}<body quat="0 0 0 0"/>', "robot.zero-axis", (3, '0 0 0 0"'), "must not be zero"),
        (f'<joint/>{GEOM}<body zaxis="0 0 0"/>', "robot.zero-axis", (3, '0 0 0"'), "has no direction"),
        (
            f'<joint/>{GEOM}<body xyaxes="1 0 0 2 0 0"/>',
            "robot.zero-axis",
            (3, "1 0 0 2"),
            "different directions",
        ),
        (
            f'<joint/>{GEOM}<body quat="1 0 0 0" euler="1 2 3"/>',
            "robot.two-forms",
            (3, '1 2 3"'),
            "quat and euler mean the same",
        ),
        (f'<joint/>{GEOM}<body name="a"/>', "robot.duplicate-link", (3, 'a"'), "the body of line 2"),
        (f'<joint class="no"/>{GEOM}', "robot.unknown-name", (3, 'no"'), 'no default class "no"'),
        (f'<joint pos="1,2 0 0"/>{GEOM}', "robot.bad-number", (3, "1,2"), "written with a point"),
    ],
)
def test_a_wrong_body_is_told(inner, code, place, words):
    check(build(body=ARM + add(inner)), code, place, words)


def test_a_compiler_that_changes_inertias_is_refused():
    inertial = '<joint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 3"/>'
    text = build('<compiler balanceinertia="true"/>', body=ARM + add(inertial))
    check(text, "robot.mjcf-unsupported", (2, '<body name="x"'), "balanceinertia changes the inertia")


def test_all_mistakes_are_told_at_once():
    text = build(
        ask("weld", "", ""),
        '<actuator><motor joint="q"/></actuator>',
        body=ARM + add(f'<joint armature="-1" axis="0 0 0"/>{GEOM}'),
    )
    notices = refuse(text, base="nowhere")
    codes = [notice.code for notice in notices]
    assert sorted(codes) == sorted(
        ["robot.bad-cut", "robot.zero-axis", "robot.out-of-range", LOOP, "robot.unknown-name"]
    )
    assert [notice.line for notice in notices] == sorted(notice.line for notice in notices)


def test_a_base_behind_a_free_joint_is_allowed():
    body = f'<body name="torso"><freejoint/>{GEOM}{ARM}</body>'
    notices = refuse(build(body=body))
    assert [notice.code for notice in notices] == ["robot.joint-type"]
    assert len(parse_mjcf(build(body=body), base="torso").joints) == 3


def test_a_mistake_in_an_included_file_has_its_place_there(tmp_path):
    (tmp_path / "arm.xml").write_text('<mujoco>\n<include file="parts.xml"/></mujoco>', encoding="utf-8")
    (tmp_path / "parts.xml").write_text(
        f'<mujocoinclude><worldbody><body>\n  <joint axis="0 0 x"/>{GEOM}</body></worldbody></mujocoinclude>',
        encoding="utf-8",
    )
    with pytest.raises(RobotError) as caught:
        read_xml_robot(tmp_path / "arm.xml")
    (notice,) = caught.value.notices
    assert (notice.file, notice.line, notice.column) == (str(tmp_path / "parts.xml"), 2, 16)
    (tmp_path / "parts.xml").write_text('<mujoco><include file="parts.xml"/></mujoco>', encoding="utf-8")
    with pytest.raises(RobotError, match="a file is included once"):
        symid.load(tmp_path / "arm.xml")
