"""Followers of MJCF equalities, of joints and of tendons, against MuJoCo; included files; rounded angles."""

import itertools

import numpy as np
import pytest

import symid
from symid.errors import RobotError
from symid.robot.mjcf_reader import parse_xml_robot, read_model
from symid.robot.urdf_xml import parse_document

MODEL = """<mujoco><compiler angle="radian"/><worldbody>
<body><joint name="i" axis="0 0 1"/><inertial pos=".1 0 0" mass="1" diaginertia=".1 .1 .1"/>
<body pos=".3 0 0"><joint name="j" type="slide" axis="0 1 0" ref=".2"/>
<inertial pos="0 .1 0" mass="2" diaginertia=".1 .1 .1"/>
<body pos="0 .3 0"><joint name="k" axis="1 0 0" ref="-.1"/>
<inertial pos="0 0 .1" mass="3" diaginertia=".1 .1 .1"/></body></body></body></worldbody>
<tendon><fixed name="j"><joint joint="j" coef="2"/></fixed>
<fixed name="k"><joint joint="k" coef="-4"/></fixed>
<fixed name="jk"><joint joint="j" coef=".5"/><joint joint="k" coef=".25"/></fixed>
<fixed name="ij"><joint joint="i" coef="1"/><joint joint="j" coef="3"/></fixed></tendon>
<equality>{}</equality></mujoco>"""
EQUALITIES = {
    "two tendons of a joint each": '<tendon tendon1="k" tendon2="j" polycoef=".3 .7"/>',
    "the usual factor": '<tendon tendon1="j" tendon2="k"/>',
    "one tendon of two joints": '<tendon tendon1="jk" polycoef=".05"/>',
    "one joint held": '<tendon tendon1="k" polycoef=".4"/>',
    "a joint that cancels": '<tendon tendon1="ij" tendon2="j" polycoef="0 1.5"/>',
    "two joints": '<joint joint1="k" joint2="j" polycoef=".1 -2"/>',
    "a second one of joints that one follows": '<joint joint1="k" joint2="j"/><tendon tendon1="ij"/>',
}
REFUSED = {
    '<tendon tendon1="jk" tendon2="ij"/>': "robot.closed-loop",
    '<tendon tendon1="k" tendon2="none"/>': "robot.unknown-name",
    '<joint joint1="k" joint2="i"/><joint joint1="k" joint2="j"/>': "robot.two-forms",
    '<tendon tendon1="k" tendon2="j" polycoef="0 1 2"/>': "robot.mjcf-unsupported",
}


@pytest.mark.parametrize("equality", EQUALITIES.values(), ids=EQUALITIES)
def test_followers_keep_the_equality_of_mujoco(equality):
    mujoco = pytest.importorskip("mujoco", reason="wants MuJoCo")
    text = MODEL.format(equality)
    robot, steps = parse_xml_robot(text), read_model(parse_document(text, "model.xml")).steps
    count = equality.count("/>")
    assert (len(steps), len(robot.axes)) == (count, 3 - count)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    for values in np.random.default_rng(1).uniform(-1.0, 1.0, (5, 3)):
        found = dict(zip("ijk", values, strict=True))
        # A chain of followers ends after as many rounds as it has.
        for _, (name, step) in itertools.product(range(count), steps.items()):
            found[name] = step.offset.to_float() + float(step.multiplier) * found.get(step.master, 0.0)
        for name, value in found.items():
            data.joint(name).qpos = value
        mujoco.mj_forward(model, data)
        assert data.nefc == count
        np.testing.assert_allclose(data.efc_pos, 0.0, atol=1e-12)


@pytest.mark.parametrize(("equality", "code"), REFUSED.items())
def test_what_is_no_follower_is_refused(tmp_path, equality, code):
    path = tmp_path / "model.xml"
    path.write_text(MODEL.format(equality), encoding="utf-8")
    with pytest.raises(RobotError) as caught:
        symid.load(path)
    assert code in {notice.code for notice in caught.value.notices}


@pytest.mark.parametrize("name", ["../parts.xml", "{}/parts.xml", "link.xml", "deeper/../../parts.xml"])
def test_files_of_other_folders_are_included_on_request(tmp_path, name):
    whole = MODEL.format("")
    head, body = whole.split("<worldbody>")
    inner, tail = body.split("</worldbody>")
    (tmp_path / "parts.xml").write_text(f"<mujoco><worldbody>{inner}</worldbody></mujoco>", encoding="utf-8")
    (tmp_path / "model" / "deeper").mkdir(parents=True)
    (tmp_path / "model" / "link.xml").symlink_to(tmp_path / "parts.xml")
    path = tmp_path / "model" / "model.xml"
    path.write_text(f'{head}<include file="{name.format(tmp_path)}"/>{tail}', encoding="utf-8")
    with pytest.raises(RobotError, match="not in the folder of the model") as caught:
        symid.load(path)
    assert {notice.code for notice in caught.value.notices} == {"robot.mjcf-include"}
    robot = symid.load(path, include_outside=True)
    assert [joint.name for joint in robot.description.joints] == ["i", "j", "k"]
    (tmp_path / "model" / "parts.xml").write_text((tmp_path / "parts.xml").read_text(), encoding="utf-8")
    path.write_text(path.read_text().replace(name.format(tmp_path), "parts.xml"), encoding="utf-8")
    assert len(symid.load(path).joints) == 3


@pytest.mark.parametrize(
    ("turn", "rounded"),
    [
        ('euler="1.57 0 0"', True),
        ('axisangle="0 1 0 3.141"', True),
        ('quat="0.7071 0.707 0 0"', True),
        ('quat="0.707 0.707 0 0"', False),
        ('euler="1.5707963267949 0 0"', False),
        ('euler="1.55 0 0"', False),
    ],
)
def test_rounded_quarter_turns_are_named(tmp_path, turn, rounded):
    path = tmp_path / "model.xml"
    text = MODEL.format("").replace('<body pos=".3 0 0">', f'<body pos=".3 0 0" {turn}>')
    path.write_text(text, encoding="utf-8")
    notices = symid.load(path, snap=0.0).notices
    assert any(notice.code == "robot.angle-rounded" for notice in notices) is rounded
