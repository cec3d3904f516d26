"""Xacro files as robots, against the program xacro and the URDF that it writes."""

import subprocess
import sys
from dataclasses import replace

import pytest

from symid.errors import UsageError
from symid.identification.export import check_format, write_stated
from symid.options import ExportOptions
from symid.robot.loading import load_robot
from symid.robot.mjcf_reader import parse_xml_robot, read_xml_robot
from symid.robot.urdf_xml import read_urdf_text
from tests.mistakes import refuse

pytest.importorskip("xacro", reason="wants the package xacro")

SPACE = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
PARTS = f"""<robot {SPACE}>
  <xacro:macro name="bar" params="name mass length">
    <link name="${{name}}">
      <inertial>
        <origin xyz="${{length / 2}} 0 0"/>
        <mass value="${{mass}}"/>
        <inertia ixx="0.001" iyy="${{mass * length ** 2 / 12}}" izz="0.05" ixy="0" ixz="0" iyz="0"/>
      </inertial>
    </link>
  </xacro:macro>
</robot>
"""
ARM = f"""<robot name="arm" {SPACE}>
  <xacro:arg name="length" default="0.5"/>
  <xacro:include filename="$(find parts)/urdf/parts.xacro"/>
  <link name="base_link"/>
  <xacro:bar name="upper" mass="3" length="$(arg length)"/>
  <xacro:bar name="fore" mass="2" length="0.4"/>
  <joint name="shoulder" type="continuous">
    <parent link="base_link"/><child link="upper"/><axis xyz="0 1 0"/>
  </joint>
  <joint name="elbow" type="continuous">
    <parent link="upper"/><child link="fore"/><origin xyz="$(arg length) 0 0"/><axis xyz="0 1 0"/>
  </joint>
</robot>
"""


@pytest.fixture
def arm(tmp_path):
    """Return a xacro file in a package, which includes one of the package beside it."""
    for package, file, text in (("arm_description", "arm.urdf.xacro", ARM), ("parts", "parts.xacro", PARTS)):
        folder = tmp_path / "src" / package
        (folder / "urdf").mkdir(parents=True)
        (folder / "package.xml").write_text(f"<package><name>{package}</name></package>")
        (folder / "urdf" / file).write_text(text)
    return tmp_path / "src" / "arm_description" / "urdf" / "arm.urdf.xacro"


def find_notice(path):
    (notice,) = refuse(read_xml_robot, path)
    return notice


def write(path, inner):
    path.write_text(f'<robot name="arm" {SPACE}>\n{inner}</robot>\n')
    return path


def test_the_robot_is_that_of_the_text_that_xacro_prints(arm, tmp_path):
    # The program finds no packages without ROS: it gets the path of the file that is included.
    whole = tmp_path / "whole.xacro"
    parts = tmp_path / "src" / "parts" / "urdf" / "parts.xacro"
    whole.write_text(ARM.replace("$(find parts)/urdf/parts.xacro", str(parts)))
    printed = subprocess.run(
        [sys.executable, "-c", "import xacro; xacro.main()", str(whole)],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    robot, expected = load_robot(str(arm)), parse_xml_robot(printed)
    for name in ("name", "joints", "gravity"):
        assert getattr(robot, name) == getattr(expected, name)
    assert robot.joints[0].inertial[9] == 3.0
    assert robot.path == str(arm)
    # All lines are those of the program; the third has no folder, so that bytes are the same everywhere.
    ours, theirs = read_urdf_text(whole).text.split("\n"), printed.split("\n")
    assert [*ours[:2], *ours[3:]] == [*theirs[:2], *theirs[3:]]
    assert ours[2] == "<!-- expanded by xacro from whole.xacro -->"
    note, *others = robot.notices
    assert (note.code, note.file, note.is_note) == ("robot.xacro-arguments", str(arm), True)
    assert "length:=0.5" in note.text
    assert [(entry.code, entry.line) for entry in others] == [
        (entry.code, entry.line) for entry in expected.notices
    ]
    assert {entry.file for entry in others} == {f"{arm} (expanded)"}


def test_lines_of_mistakes_are_those_of_the_expanded_text(arm):
    arm.write_text(ARM.replace('<axis xyz="0 1 0"/>', '<axis xyz="0 0 0"/>', 1))
    notice = find_notice(arm)
    assert (notice.code, notice.file) == ("robot.zero-axis", f"{arm} (expanded)")
    lines = read_urdf_text(arm).text.split("\n")
    assert '<axis xyz="0 0 0"/>' in lines[notice.line - 1]


@pytest.mark.parametrize("variable", ["ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"])
def test_a_package_elsewhere_is_found_where_ros_looks(arm, tmp_path, monkeypatch, variable):
    before = read_xml_robot(arm)
    away = tmp_path / "ws" / "deep" / "share"
    away.mkdir(parents=True)
    (tmp_path / "src" / "parts").rename(away / "other_name")
    notice = find_notice(arm)
    assert (notice.code, notice.file) == ("robot.xacro", str(arm))
    assert "$(find parts)" in notice.text
    assert "ROS_PACKAGE_PATH" in notice.text
    folder = tmp_path / "ws" if variable == "ROS_PACKAGE_PATH" else away.parent
    monkeypatch.setenv(variable, f"{tmp_path / 'nothing'}:{folder}")
    assert read_xml_robot(arm) == before


def test_a_package_of_meshes_alone_is_no_obstacle(arm):
    mesh = '<visual><geometry><mesh filename="$(find absent)/a.dae"/></geometry></visual>'
    arm.write_text(ARM.replace('<link name="base_link"/>', f'<link name="base_link">{mesh}</link>'))
    robot = read_xml_robot(arm)
    (warning,) = [entry for entry in robot.notices if entry.code == "robot.xacro-warning"]
    assert "$(find absent): there is no ROS package" in warning.text
    assert 'filename="$(find absent)/a.dae"' in read_urdf_text(arm).text


@pytest.mark.parametrize(
    ("inner", "words"),
    [
        ("  <xacro:arm/>\n", "unknown macro name: xacro:arm"),
        ('  <link name="$(arg side)"/>\n', "side has no default; give it with --xacro side:=VALUE"),
        ('  <link name="${1 / 0}"/>\n', "division by zero"),
        ('  <link name="${nothing}"/>\n', "nothing"),
        ('  <xacro:include filename="absent.xacro"/>\n', "absent.xacro"),
        ('  <xacro:macro name="m"><link name="${x}"/></xacro:macro><xacro:m/>\n', "(in the macro m)"),
        ('  <xacro:macro name="m"><xacro:m/></xacro:macro><xacro:m/>\n', "recursion"),
    ],
)
def test_what_cannot_be_expanded_is_told(tmp_path, inner, words):
    path = write(tmp_path / "a.xacro", inner)
    notice = find_notice(path)
    assert (notice.code, notice.file, notice.line) == ("robot.xacro", str(path), 0)
    assert words in notice.text


def test_broken_xml_is_told_in_the_file_that_has_it(arm, tmp_path):
    parts = tmp_path / "src" / "parts" / "urdf" / "parts.xacro"
    parts.write_text(PARTS.replace("</inertial>", "</inertia>"))
    notice = find_notice(arm)
    assert (notice.file, notice.line) == (str(parts), 8)
    assert "mismatched tag" in notice.text


def test_what_xacro_prints_is_told(arm):
    arm.write_text(ARM.replace("<link name=", "${xacro.warning('mind the gap')}<link name=", 1))
    (warning,) = [entry for entry in read_xml_robot(arm).notices if entry.code == "robot.xacro-warning"]
    assert "mind the gap" in warning.text
    assert not warning.is_note


def test_without_the_package_the_way_out_is_told(arm, monkeypatch):
    monkeypatch.setitem(sys.modules, "xacro", None)
    notice = find_notice(arm)
    assert notice.code == "robot.needs-xacro"
    assert "pip install 'symid[xacro]'" in notice.text
    assert "xacro arm.urdf.xacro > robot.urdf" in notice.text


def test_xacro_in_a_file_of_another_name_and_without_a_manifest_is_expanded(arm, tmp_path):
    named, before = arm.with_name("arm.urdf"), read_xml_robot(arm).joints
    named.write_text(ARM)
    (tmp_path / "src" / "parts" / "package.xml").unlink()
    assert read_xml_robot(named).joints == before


def test_values_go_into_a_urdf_and_not_into_xacro(arm, tmp_path):
    robot = load_robot(str(arm))
    heavy = replace(robot.joints[0], inertial=tuple(2.0 * value for value in robot.joints[0].inertial))
    changed = replace(robot, joints=(heavy, *robot.joints[1:]))
    assert "export a .urdf" in refuse(check_format, arm, ExportOptions(), error=UsageError)[0].text
    target = tmp_path / "arm.urdf"
    written = write_stated(changed, target, ExportOptions())
    assert not [notice.code for notice in written.notices if notice.code.startswith("export.source")]
    text = target.read_text()
    assert "xacro:" not in text
    assert '<link name="fore">' in text
    assert read_xml_robot(target).joints[0].inertial[9] == 6.0
