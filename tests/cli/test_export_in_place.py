"""`symid export` into the URDF that a robot was made from: bytes stay, torques are those identified."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from symid.codegen import prepare_library
from symid.dynamics.base_parameters import compute_parameter_values, derive_base_parameters
from symid.identification.stored import read_fit
from symid.report import judge_fit
from symid.robot.mjcf_reader import read_xml_robot as read_urdf
from symid.robot.toml_reader import read_robot
from tests.calls import ask, do, fail, hear
from tests.estimates import fill_robot, store_estimate

pin = pytest.importorskip("pinocchio", reason="wants the package pin")

pytestmark = pytest.mark.usefixtures("shared_work")

NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?![\w.])")
ARM = Path("docs/own_robot/arm.urdf")


TOOL = """  <mujoco><compiler discardvisual="true"/></mujoco>
  <link name="tool">
    <inertial>
      <origin xyz="0 0 0.05" rpy="0 0 0"/>
      <mass value="0.4"/>
      <inertia ixx="0.0004" ixy="0" ixz="0" iyy="0.0004" iyz="0" izz="0.0002"/>
    </inertial>
  </link>
  <joint name="flange" type="fixed">
    <origin xyz="0.3 0 0" rpy="0 1.2 0"/>
    <parent link="forearm"/>
    <child link="tool"/>
  </joint>
</robot>"""


def find_codes(answer):
    return [notice["code"] for key in ("warnings", "notes") for notice in answer.get(key, ())]


@pytest.fixture
def made(project, tmp_path, monkeypatch):
    """Return the robot with values that was made from a URDF with odd ends of lines, in another folder."""
    text = (project / ARM).read_text(encoding="utf-8").replace("</robot>", TOOL)
    (tmp_path / "cad").mkdir()
    (tmp_path / "cad" / "arm.urdf").write_bytes(b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode())
    monkeypatch.chdir(tmp_path)
    options = ("--from-urdf", "cad/arm.urdf", "--friction", "coulomb-viscous", "--rotors")
    do("new", "arm.toml", *options)
    robot = fill_robot(read_robot(tmp_path / "arm.toml"))
    store_estimate(robot, tmp_path / "estimate.json")
    return robot


def assert_identified(file, robot, alone):
    """The file has the base values of the robot, and friction; Pinocchio finds its torques there.

    What URDFs say of rotors Pinocchio does not read: those of the joints that stand `alone` are added.
    """
    back = read_urdf(file)
    # A rotor that the file does not have.
    joints = (
        dataclasses.replace(
            joint, drive=dataclasses.replace(joint.drive, rotor_inertia=joint.drive.rotor_inertia or 0.0)
        )
        for joint in back.joints
    )
    back = dataclasses.replace(back, joints=tuple(joints))
    base = derive_base_parameters(robot)
    found, truth = (compute_parameter_values(entry, base) for entry in (back, robot))
    for parameter in base.parameters:
        assert found[parameter.name] == pytest.approx(truth[parameter.name], rel=1e-9, abs=1e-9)
    for old, new in zip(robot.joints, back.joints, strict=True):
        assert new.friction.values == pytest.approx(old.friction.values, rel=1e-12)
    theirs = pin.buildModelFromUrdf(str(file))
    assert list(theirs.names[1:]) == [joint.name for joint in robot.joints]
    rotors = np.array([joint.drive.rotor_inertia for joint in back.joints])
    assert np.flatnonzero(rotors).tolist() == alone
    library = prepare_library(robot, backend="python")
    beta = np.array([truth[parameter.name] for parameter in base.parameters])
    for state in np.random.default_rng(5).uniform(-1, 1, (5, 3, robot.size)):
        (expected,) = library.evaluate("inverse_dynamics", *state[:, None], beta)
        torque = pin.rnea(theirs, theirs.createData(), *state) + rotors * state[2]
        # The file's right angles have five digits, and were taken as right angles.
        np.testing.assert_allclose(torque, expected[0], rtol=0, atol=2e-5)


def test_the_urdf_is_changed_in_place(made, tmp_path):
    file = tmp_path / "cad" / "arm.urdf"
    before = file.read_bytes()
    do("export", "arm.toml", "estimate.json", "-o", "new.urdf")
    assert file.read_bytes() == before
    answer = do("export", "arm.toml", "estimate.json", "--in-place")
    assert answer["result"]["file"] == "cad/arm.urdf"
    assert "export.shared-links" in find_codes(answer)
    after = file.read_bytes()
    assert after == (tmp_path / "new.urdf").read_bytes()
    assert after.startswith(b"\xef\xbb\xbf<?xml")
    added = re.compile(
        r'\r\n *(?:<dynamics damping="[^"]*" friction="[^"]*"/>|<motorInertia>[^<]*</motorInertia>)'
    )
    left = added.sub("", after.decode())
    assert len(added.findall(after.decode())) == 4
    assert NUMBER.sub("#", left) == NUMBER.sub("#", before.decode())
    # Grouped rotors are part of the links.
    assert_identified(file, made, [2])
    # Once more: the file has changed since the robot was made from it, its joints have not.
    assert "export.source-edited" in find_codes(do("export", "arm.toml", "estimate.json", "-o", "again.urdf"))
    again = (tmp_path / "again.urdf").read_bytes().decode()
    assert NUMBER.sub("#", again) == NUMBER.sub("#", after.decode())
    pairs = zip(NUMBER.findall(again), NUMBER.findall(after.decode()), strict=True)
    assert all(float(new) == pytest.approx(float(old), rel=1e-9, abs=1e-12) for new, old in pairs)


def test_a_robot_file_in_another_folder_still_names_its_urdf(made, tmp_path):
    (tmp_path / "out").mkdir()
    do("export", "arm.toml", "estimate.json", "-o", "out/identified.toml")
    assert 'file = "../cad/arm.urdf"' in (tmp_path / "out" / "identified.toml").read_text(encoding="utf-8")
    assert "robot.cut-off" not in find_codes(do("export", "out/identified.toml", "-o", "out/identified.urdf"))
    assert_identified(tmp_path / "out" / "identified.urdf", made, [0, 1, 2])


def test_a_urdf_with_other_joints_is_not_touched(made, tmp_path):
    file = tmp_path / "cad" / "arm.urdf"
    file.write_bytes(file.read_bytes().replace(b'"elbow"', b'"knee"'))
    changed = file.read_bytes()
    assert "knee" in hear(3, "export.source-changed", "export", "arm.toml", "estimate.json", "--in-place")
    assert file.read_bytes() == changed
    assert "export.new-file" in find_codes(do("export", "arm.toml", "estimate.json", "-o", "new.urdf"))
    assert b"mesh" not in (tmp_path / "new.urdf").read_bytes()
    file.unlink()
    assert ask("export", "arm.toml", "estimate.json", "--in-place")[0] == 3
    assert not file.exists()


def test_what_cannot_be_done_in_place_is_refused(made):
    assert fail("export", "two_link", "estimate.json", "--in-place") == (2, "usage.no-source")
    for options in ((), ("-o", "new.urdf", "--in-place")):
        assert fail("export", "arm.toml", "estimate.json", *options) == (2, "usage.export-file")
    assert fail("export", "arm.toml", "--in-place") == (2, "usage.export-file")
    assert fail("export", "arm.toml", "estimate.json", "-o", "x.urdf", "--limit", "-1") == (2, "usage.range")


def test_the_table_on_the_source_is_checked(tmp_path, made):
    text = (tmp_path / "arm.toml").read_text(encoding="utf-8")
    assert read_robot(tmp_path / "arm.toml").made_from.file == str(tmp_path / "cad" / "arm.urdf")
    for old, new, word in (
        (r'sha256 = "[0-9a-f]*"', "", "sha256"),
        (r"snap = .*", 'snap = "wide"', "snap"),
        (r"snap = .*", "snap = 1e-5\nroot = 'a'", "root"),
    ):
        (tmp_path / "bad.toml").write_text(re.sub(old, new, text, count=1), encoding="utf-8")
        with pytest.raises(Exception, match=word):
            read_robot(tmp_path / "bad.toml")


def test_values_of_a_drawing_are_no_truth(made, tmp_path):
    """A fit far from the values of the URDF is as good as any other: they are where one starts from."""

    estimate = read_fit(tmp_path / "estimate.json")
    far = tuple(dataclasses.replace(entry, truth=2.0 * entry.value) for entry in estimate.parameters)
    levels = [
        judge_fit(dataclasses.replace(estimate, parameters=far, simulated=simulated)).level
        for simulated in (True, False)
    ]
    assert levels[0] == "doubtful"
    assert levels[1] != "doubtful"


def test_a_file_of_the_same_name_elsewhere_is_not_touched(made, tmp_path, monkeypatch):
    """The URDF is named as seen from the robot file, not from where one happens to stand."""
    (tmp_path / "arm.toml").rename(tmp_path / "cad" / "arm.toml")
    text = (tmp_path / "cad" / "arm.toml").read_text(encoding="utf-8")
    (tmp_path / "cad" / "arm.toml").write_text(text.replace("cad/arm.urdf", "gone.urdf"), encoding="utf-8")
    (tmp_path / "gone.urdf").write_bytes((tmp_path / "cad" / "arm.urdf").read_bytes())
    before = (tmp_path / "gone.urdf").read_bytes()
    assert fail("export", "cad/arm.toml", "estimate.json", "--in-place") == (3, "robot.unreadable")
    assert (tmp_path / "gone.urdf").read_bytes() == before


def test_a_new_robot_file_in_another_folder_names_its_urdf(made, tmp_path):
    (tmp_path / "out").mkdir()
    do("new", "out/arm.toml", "--from-urdf", "cad/arm.urdf")
    assert 'file = "../cad/arm.urdf"' in (tmp_path / "out" / "arm.toml").read_text(encoding="utf-8")
    do("new", "copy.toml", "--from", "out/arm.toml")
    assert 'file = "cad/arm.urdf"' in (tmp_path / "copy.toml").read_text(encoding="utf-8")


def test_links_and_rights_of_the_urdf_stay(made, tmp_path):
    file, real = tmp_path / "cad" / "arm.urdf", tmp_path / "real.urdf"
    file.rename(real)
    file.symlink_to(real)
    real.chmod(0o640)
    code, _ = ask("export", "arm.toml", "estimate.json", "--in-place")
    assert (code, file.is_symlink(), real.stat().st_mode & 0o777) == (0, True, 0o640)
    assert b"<dynamics" in real.read_bytes()


def test_a_robot_below_a_floating_joint_is_written(tmp_path, project, monkeypatch):
    text = (project / ARM).read_text(encoding="utf-8").replace("</robot>", FLOATING)
    monkeypatch.chdir(tmp_path)
    Path("arm.urdf").write_text(text, encoding="utf-8")
    cut = ("--base", "base_link")
    do("new", "arm.toml", "--from-urdf", "arm.urdf", *cut, "--friction", "coulomb-viscous")
    robot = fill_robot(read_robot(tmp_path / "arm.toml"))
    store_estimate(robot, tmp_path / "estimate.json")
    answer = do("export", "arm.toml", "estimate.json", "--in-place")
    assert not any("gravity" in entry for entry in answer["result"]["left_out"])
    back = read_urdf(Path("arm.urdf"), base="base_link")
    base = derive_base_parameters(robot)
    found, truth = (compute_parameter_values(entry, base) for entry in (back, robot))
    for parameter in base.parameters:
        assert found[parameter.name] == pytest.approx(truth[parameter.name], rel=1e-9, abs=1e-9)


FLOATING = """<link name="world"/><joint name="root" type="floating">
<parent link="world"/><child link="base_link"/></joint></robot>"""


def test_xacro_is_not_written_in_place(made, tmp_path, project):
    pytest.importorskip("xacro", reason="the extra xacro is not installed")
    text = (project / ARM).read_text(encoding="utf-8")
    head = (
        '<robot name="arm" xmlns:xacro="http://ros.org/wiki/xacro"><xacro:property name="mass" value="5.40"/>'
    )
    written = text.replace('<robot name="arm">', head).replace('value="5.4"/>\n', 'value="${mass}"/>\n')
    (tmp_path / "cad" / "arm.urdf").write_text(written, encoding="utf-8")
    do("new", "made.toml", "--from-urdf", "cad/arm.urdf", "--friction", "coulomb-viscous")
    store_estimate(fill_robot(read_robot(tmp_path / "made.toml")), tmp_path / "estimate.json")
    assert fail("export", "made.toml", "estimate.json", "--in-place") == (3, "export.xacro")
    assert (tmp_path / "cad" / "arm.urdf").read_text(encoding="utf-8") == written
    # What only a comment shows is no xacro.
    (tmp_path / "cad" / "arm.urdf").write_text(text.replace("</robot>", "<!-- <xacro:x/> --></robot>"))
    assert "robot.xacro-arguments" not in find_codes(do("base", "cad/arm.urdf"))
