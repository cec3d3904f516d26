"""The examples of the documentation are robot files and tables that are read, and its numbers are right."""

import re

import pytest

from symid.robot.mjcf_reader import parse_xml_robot
from symid.robot.toml_reader import parse_dh_table, parse_robot, read_robot

BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def find_blocks(project, document, language):
    text = (project / "docs" / document).read_text(encoding="utf-8")
    return [body for name, body in BLOCK.findall(text) if name == language]


def test_every_robot_of_the_documentation_is_read(project):
    blocks = find_blocks(project, "robot_file.md", "toml")
    robots = [parse_robot(block, "example.toml") for block in blocks if "[[joint]]" in block]
    assert [robot.name for robot in robots] == [
        "arm",
        "leg",
        "pendulum",
        "boom",
        "wrist",
        "elastic_arm",
        "slide",
    ]
    codes = {notice.code for robot in robots for notice in robot.notices}
    assert codes == {"robot.lumped", "robot.elastic-joint"}


def test_settings_of_the_documentation_are_read(project, robots_folder):
    emps = (robots_folder / "emps.toml").read_text(encoding="utf-8").partition("[log]")[0]
    parts = find_blocks(project, "robot_file.md", "toml")
    blocks = [b for b in parts if "[[joint]]" not in b and not b.startswith("[joint.")]
    assert len(blocks) == 4
    robot = parse_robot(emps + "".join(blocks))
    assert robot.log.torque.unit == "V"
    assert robot.controller.velocity == "measured"
    assert [entry.name for entry in robot.settings] == ["published", "lab"]


def test_friction_with_a_state_of_the_documentation_is_read(project, robots_folder):
    parts = find_blocks(project, "robot_file.md", "toml")
    (block,) = [b for b in parts if b.startswith("[joint.friction]")]
    joint = (robots_folder / "emps.toml").read_text(encoding="utf-8").partition("[joint.friction]")[0]
    robot = parse_robot(joint + block)
    assert robot.joints[0].friction.law == "lugre"


def test_the_table_of_the_documentation_is_read(project):
    (block,) = [block for block in find_blocks(project, "command_line.md", "text") if "waist" in block]
    robot = parse_dh_table(block, "modified")
    assert [joint.name for joint in robot.joints] == ["waist", "shoulder", "slide"]


def test_the_formula_of_the_documentation_is_found(project):
    pytest.importorskip("sympy")
    from symid.dynamics.base_parameters import derive_base_parameters, derive_parameter_formulas

    (block,) = [b for b in find_blocks(project, "robot_file.md", "toml") if "pendulum" in b]
    robot = parse_robot(block)
    forms = derive_parameter_formulas(robot, derive_base_parameters(robot))
    assert str(forms["ZZ1"]).replace("**", "^") == "I1 + lc1^2*m1"


def test_the_table_of_robots_is_that_of_the_folder(project, robots_folder):
    text = (project / "docs" / "robots.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \|[^|]*\| (\d+) \| ([\d +]+) \|", text, re.MULTILINE)
    assert [row[0] for row in rows] == sorted(path.stem for path in robots_folder.glob("*.toml"))
    from symid.dynamics.base_parameters import derive_base_parameters

    for name, size, counts in rows:
        robot = read_robot(robots_folder / f"{name}.toml")
        base = derive_base_parameters(robot)
        friction = f" + {len(base.friction)}" if base.friction else ""
        assert (name, size, counts) == (name, str(robot.size), f"{base.count}{friction}")


def test_the_example_of_writing_a_urdf_works_in_any_folder(project, tmp_path, monkeypatch):
    (_, block) = find_blocks(project, "urdf.md", "python")
    monkeypatch.chdir(tmp_path)
    found = {}
    exec(block, found)  # noqa: S102
    assert len(parse_xml_robot(found["text"]).joints) == 7


def test_mujoco_writes_the_inertias_of_geoms(project, tmp_path, monkeypatch):
    pytest.importorskip("mujoco", reason="the extra mujoco is not installed")
    (block, _) = find_blocks(project, "urdf.md", "python")
    monkeypatch.chdir(tmp_path)
    geom = '<joint name="j" type="hinge"/><geom type="sphere" size="0.1" density="1000"/>'
    model = f'<mujoco><worldbody><body name="b">{geom}</body></worldbody></mujoco>'
    (tmp_path / "arm.xml").write_text(model, encoding="utf-8")
    exec(block, {})  # noqa: S102
    assert "<inertial" in (tmp_path / "arm_inertial.xml").read_text(encoding="utf-8")


def test_the_way_to_install_is_told(project):
    for name in ("README.md", "docs/quickstart.md"):
        text = (project / name).read_text(encoding="utf-8")
        assert re.search(r"python3 -m venv (\S+)\n\1/bin/pip install \.", text)
