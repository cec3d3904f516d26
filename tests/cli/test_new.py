"""`symid new`: a robot file from a table, a URDF, or a robot at hand."""

import json

import pytest

from symid.cli.main import run
from symid.formats.toml import read_robot

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


def call_json(capsys, *arguments):
    code = run([*map(str, arguments), "--json"])
    return code, json.loads(capsys.readouterr().out)


@pytest.fixture
def table(tmp_path):
    path = tmp_path / "rows.csv"
    path.write_text(TABLE)
    return path


def test_a_table_becomes_a_robot_file(capsys, tmp_path, table):
    path = tmp_path / "arm.toml"
    code, answer = call_json(capsys, "new", path, "--from-dh", table, "--convention", "standard")
    assert code == 0
    assert answer["result"] == {
        "file": str(path),
        "robot": "rows",
        "joints": [{"name": "shoulder", "kind": "revolute"}, {"name": "elbow", "kind": "revolute"}],
        "notices": 1,
    }
    assert [entry["code"] for entry in answer["warnings"]] == ["new.gravity"]
    robot = read_robot(path)
    assert robot.convention == "standard"
    assert "# rotor_inertia = 1e-5" in path.read_text()
    assert run(["check", str(path), "-q"]) == 0


def test_gravity_may_be_given(capsys, tmp_path, table):
    path = tmp_path / "arm.toml"
    options = ("--convention", "modified", "--gravity", "0, -9.81, 0")
    code, answer = call_json(capsys, "new", path, "--from-dh", table, *options)
    assert (code, answer["warnings"]) == (0, [])
    assert [str(entry) for entry in read_robot(path).gravity] == ["0", "-981/100", "0"]


def test_a_urdf_becomes_a_robot_file(capsys, tmp_path):
    source = tmp_path / "arm.urdf"
    source.write_text(URDF)
    path = tmp_path / "arm.toml"
    code, answer = call_json(capsys, "new", path, "--from-urdf", source, "--tip", "lower")
    assert code == 0
    assert [joint["name"] for joint in answer["result"]["joints"]] == ["shoulder", "elbow"]
    robot = read_robot(path)
    assert robot.joints[0].inertial[9] == 2.0
    assert robot.joints[1].limits.position == (-1.0, 1.0)


def test_a_robot_at_hand_is_copied(capsys, tmp_path, robots_folder):
    path = tmp_path / "mine.toml"
    code, answer = call_json(capsys, "new", path, "--from", "scara")
    assert (code, answer["result"]["robot"]) == (0, "scara")
    assert path.read_text() == (robots_folder / "scara.toml").read_text()


def test_a_file_that_exists_is_kept_without_force(capsys, tmp_path, table):
    path = tmp_path / "arm.toml"
    path.write_text("mine")
    arguments = ("new", path, "--from-dh", table, "--convention", "modified")
    code, answer = call_json(capsys, *arguments)
    assert (code, answer["errors"][0]["code"], path.read_text()) == (3, "output.exists", "mine")
    code, _ = call_json(capsys, *arguments, "--force")
    assert code == 0
    assert read_robot(path).size == 2


def test_a_wrong_table_writes_nothing(capsys, tmp_path, table):
    table.write_text("joint,alpha,a,d,theta\none,x y,0,0,q\n")
    path = tmp_path / "arm.toml"
    code, answer = call_json(capsys, "new", path, "--from-dh", table, "--convention", "modified")
    assert (code, answer["errors"][0]["code"]) == (3, "robot.bad-angle")
    assert not path.exists()


@pytest.mark.parametrize(
    "case",
    [
        ((), "usage.call", "give one source"),
        (("--from", "scara", "--from-dh", "x.csv", "--convention", "modified"), "usage.call", "give one"),
        (("--from-dh", "x.csv"), "usage.call", "never guessed"),
        (("--from", "scara", "--tip", "hand"), "usage.call", "--tip belongs to --from-urdf"),
        (("--from", "scara", "--gravity", "0,0,0"), "usage.call", "--gravity belongs to --from-dh"),
        (("--from", "scra"), "usage.unknown-robot", "did you mean scara"),
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
def test_calls_that_do_not_fit_are_refused(capsys, table, monkeypatch, case):
    arguments, code, words = case
    monkeypatch.chdir(table.parent)
    exit_code, answer = call_json(capsys, "new", "arm.toml", *arguments)
    assert exit_code == 2
    assert answer["errors"][0]["code"] == code
    assert words in answer["errors"][0]["text"]
    assert not (table.parent / "arm.toml").exists()


def test_base_gives_formulas_in_the_symbols_of_the_file(capsys):
    _, answer = call_json(capsys, "base", "two_link_symbols")
    found = {entry["name"]: entry["form"] for entry in answer["result"]["parameters"]}
    assert found["ZZR1"] == "I1 + L1^2*m2 + lc1^2*m1"
    assert found["MY1"] is None
    assert run(["base", "two_link_symbols", "-q"]) == 0
    assert "\nMX2 = lc2*m2 = 0.4  [kg m]\n" in capsys.readouterr().out
