"""`symid new`: a robot file from a table, a URDF, or a robot at hand."""

import pytest

from symid.robot.toml_reader import read_robot
from tests.calls import ask, do, hear, list_codes

TABLE = "joint,alpha,a,d,theta\nshoulder,0,0,0,q\nelbow,0,0.5,0,q\n"
URDF = """<robot name="arm">
  <link name="base"/>
  <link name="upper">
    <inertial><origin xyz="0.1 0 0"/><mass value="2"/>
      <inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <link name="lower"/>
  <joint name="shoulder" type="revolute">
    <parent link="base"/><child link="upper"/><origin xyz="0 0 0.3" rpy="0 0.3 0"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="10" velocity="2"/>
  </joint>
  <joint name="elbow" type="revolute">
    <parent link="upper"/><child link="lower"/><origin xyz="0.4 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="10" velocity="2"/>
  </joint>
</robot>
"""


@pytest.fixture
def table(tmp_path):
    path = tmp_path / "rows.csv"
    path.write_text(TABLE)
    return path


def test_a_table_becomes_a_robot_file(tmp_path, table):
    path = tmp_path / "arm.toml"
    answer = do("new", path, "--from-dh", table, "--convention", "standard")
    assert answer["result"] == {
        "file": str(path),
        "robot": "rows",
        "joints": [{"name": "shoulder", "kind": "revolute"}, {"name": "elbow", "kind": "revolute"}],
        "notices": 1,
    }
    assert list_codes(answer) == ["new.gravity"]
    robot = read_robot(path)
    assert robot.convention == "standard"
    assert "# rotor_inertia = 1e-5" in path.read_text()
    do("check", path)


def test_a_urdf_becomes_a_robot_file(tmp_path):
    source = tmp_path / "arm.urdf"
    source.write_text(URDF)
    path = tmp_path / "arm.toml"
    answer = do("new", path, "--from-urdf", source, "--tip", "lower")
    assert [joint["name"] for joint in answer["result"]["joints"]] == ["shoulder", "elbow"]
    robot = read_robot(path)
    assert robot.joints[0].inertial[9] == 2.0
    assert robot.joints[1].limits.position == (-1.0, 1.0)


def test_a_robot_at_hand_is_copied(tmp_path, robots_folder):
    path = tmp_path / "mine.toml"
    assert do("new", path, "--from", "scara")["result"]["robot"] == "scara"
    assert path.read_text() == (robots_folder / "scara.toml").read_text()


def test_a_file_that_exists_is_kept_without_force(tmp_path, table):
    path = tmp_path / "arm.toml"
    path.write_text("mine")
    arguments = ("new", path, "--from-dh", table, "--convention", "modified")
    code, answer = ask(*arguments)
    assert (code, answer["errors"][0]["code"], path.read_text()) == (3, "output.exists", "mine")
    do(*arguments, "--force")
    assert read_robot(path).size == 2


@pytest.mark.parametrize(
    "case",
    [
        ((), "usage.call", "give one source"),
        (("--from", "scara", "--from-dh", "x.csv", "--convention", "modified"), "usage.call", "give one"),
        (("--from-dh", "x.csv"), "usage.call", "never guessed"),
        (("--from", "scara", "--tip", "hand"), "usage.call", "--tip belongs to --from-urdf"),
        (("--from", "scara", "--gravity", "0,0,0"), "usage.copied", "--gravity: a robot file is copied"),
        (("--from", "scra"), "usage.unknown-robot", "did you mean scara"),
        (
            ("--from-dh", "rows.csv", "--convention", "modified", "--gravity", "1e300,0,0"),
            "usage.gravity",
            "gravity (--gravity) 1e300,0,0: expected three numbers in m/s^2 of a sensible size",
        ),
        (
            ("--from-dh", "rows.csv", "--convention", "modified", "--gravity", "9.81"),
            "usage.gravity",
            "three",
        ),
        (
            ("--from-dh", "rows.csv", "--convention", "modified", "--gravity", "0,0,x"),
            "usage.gravity",
            "three",
        ),
    ],
)
def test_calls_that_do_not_fit_are_refused(table, monkeypatch, case):
    arguments, code, words = case
    monkeypatch.chdir(table.parent)
    assert words in hear(2, code, "new", "arm.toml", *arguments)
    assert not (table.parent / "arm.toml").exists()


def test_a_urdf_at_hand_is_converted(tmp_path):
    source = tmp_path / "arm"
    source.write_text("\ufeff\n" + URDF, encoding="utf-8")
    path = tmp_path / "arm.toml"
    do("new", path, "--from", source)
    assert [joint.name for joint in read_robot(path).joints] == ["shoulder", "elbow"]


def test_what_no_robot_file_can_say_is_told_of_the_source(tmp_path, monkeypatch):
    source = tmp_path / "arm.urdf"
    source.write_text(URDF)
    monkeypatch.setattr("symid.robot.write_robot", lambda *_, **__: 'name = "arm"\n')
    path = tmp_path / "arm.toml"
    code, answer = ask("new", path, "--from-urdf", source)
    assert code == 3
    assert {(entry["code"], entry["file"]) for entry in answer["errors"]} == {("new.unwritable", str(source))}
    assert not path.exists()


def test_a_robot_file_ends_in_toml(tmp_path):
    path = tmp_path / "mine.urdf"
    assert "such as mine.toml" in hear(2, "usage.suffix", "new", path, "--from", "panda")
    assert not path.exists()


@pytest.mark.parametrize(
    ("law", "code", "values"),
    [
        ("coulomb-viscous-offset", "new.friction-kept", (0.5, 0.25, 0.0)),
        ("coulomb", "new.friction-lost", (0.25,)),
        ("none", "new.friction-lost", None),
        ("coulomb-viscous", "", (0.5, 0.25)),
    ],
)
def test_the_friction_of_a_urdf_goes_into_another_law(tmp_path, law, code, values):
    source = tmp_path / "arm.urdf"
    source.write_text(URDF.replace("</joint>", '<dynamics damping="0.5" friction="0.25"/></joint>', 1))
    path = tmp_path / "arm.toml"
    answer = ask("new", path, "--from-urdf", source, "--friction", law)[1]
    codes = {entry["code"] for entry in (*answer["warnings"], *answer.get("notes", ()))}
    assert {entry for entry in codes if entry.startswith("new.friction-")} == ({code} if code else set())
    assert read_robot(path).joints[0].friction.values == values
