"""URDFs on the command line: read by their suffix, cut between links."""

import json

import numpy as np
import pytest

from symid.cli.main import run
from symid.robot.simulator_writers import write_urdf
from tests.chains import PANDA, draw_parameters, set_inertia


def call_json(capsys, *arguments):
    """Run a verb with --json; return its exit code and the object."""
    code = run([*map(str, arguments), "--json"])
    return code, json.loads(capsys.readouterr().out)


@pytest.fixture
def urdf(tmp_path):
    """Return the path of a URDF of the Panda."""
    path = tmp_path / "panda.urdf"
    path.write_text(
        write_urdf(set_inertia(PANDA, draw_parameters(np.random.default_rng(1), 7))), encoding="utf-8"
    )
    return path


def test_check_reads_a_urdf(capsys, urdf):
    code, answer = call_json(capsys, "check", urdf)
    assert code == 0
    assert answer["result"]["convention"] == "urdf"
    assert len(answer["result"]["joints"]) == 7
    assert "robot.assumed-gravity" in {warning["code"] for warning in answer["warnings"]}
    assert run(["check", str(urdf), "-q"]) == 0
    assert "panda, 7 joints, URDF: no mistakes" in capsys.readouterr().out


def test_base_of_a_urdf_and_of_a_part_of_it(capsys, urdf):
    _, whole = call_json(capsys, "base", urdf)
    assert whole["result"]["count"] == 43
    _, dh = call_json(capsys, "base", "panda")
    names = [[entry["name"] for entry in answer["result"]["parameters"]] for answer in (whole, dh)]
    assert names[0] == names[1]
    code, part = call_json(capsys, "base", urdf, "--base", "joint1_link", "--tip", "joint3_link")
    assert code == 0
    assert {entry["joint"] for entry in part["result"]["parameters"]} == {"joint2", "joint3"}
    assert "robot.cut-off" in {warning["code"] for warning in part["warnings"]}


def test_derive_and_check_cut_too(capsys, urdf):
    code, answer = call_json(capsys, "check", urdf, "--tip", "joint2_link")
    assert code == 0
    assert [entry["name"] for entry in answer["result"]["joints"]] == ["joint1", "joint2"]
    code, answer = call_json(capsys, "derive", urdf, "--tip", "joint1_link")
    assert code == 0
    assert answer["result"]["robot"] == "panda"


def test_generate_cuts_too(capsys, urdf, tmp_path):
    arguments = ("--tip", "joint2_link", "--target", "python", "-o", tmp_path / "code")
    code, answer = call_json(capsys, "generate", urdf, *arguments, "--function", "inverse_dynamics")
    assert code == 0
    assert answer["result"]["selftest"] == "passed"


@pytest.mark.parametrize("verb", ["check", "base", "derive"])
@pytest.mark.parametrize("option", ["--base", "--tip"])
def test_only_a_urdf_is_cut(capsys, verb, option):
    code, answer = call_json(capsys, verb, "two_link", option, "link1")
    assert code == 2
    (error,) = answer["errors"]
    assert error["code"] == "usage.no-urdf"
    assert error["text"].startswith(f"{option} link1: only a URDF or MJCF is cut")


def test_a_link_that_does_not_exist(capsys, urdf):
    code, answer = call_json(capsys, "base", urdf, "--tip", "joint9_link")
    assert code == 3
    assert answer["errors"][0]["code"] == "robot.bad-cut"


def test_mistakes_have_their_place(capsys, urdf):
    urdf.write_text(urdf.read_text(encoding="utf-8").replace('axis xyz="0 0 1"', 'axis xyz="0 0 0"', 1))
    code, answer = call_json(capsys, "check", urdf)
    assert code == 3
    (error,) = answer["errors"]
    assert (error["code"], error["file"]) == ("robot.zero-axis", str(urdf))
    assert error["line"] > 1
    assert error["column"] > 1


def test_xacro_that_cannot_be_expanded_is_refused(capsys, tmp_path):
    path = tmp_path / "arm.urdf.xacro"
    path.write_text('<robot xmlns:xacro="x"><xacro:arm/></robot>', encoding="utf-8")
    code, answer = call_json(capsys, "check", path)
    assert code == 3
    assert "unknown macro name: xacro:arm" in answer["errors"][0]["text"]


def test_a_missing_urdf_gets_the_nearest_name(capsys, urdf):
    code, answer = call_json(capsys, "check", urdf.with_name("pandas.urdf"))
    assert code == 2
    assert "panda.urdf?" in answer["errors"][0]["text"]


@pytest.mark.parametrize("name", ["arm", "arm.txt"])
def test_a_urdf_is_known_by_what_it_holds(capsys, urdf, name):
    path = urdf.with_name(name)
    path.write_text("\ufeff \n" + urdf.read_text(encoding="utf-8").partition("?>")[2], encoding="utf-8")
    code, answer = call_json(capsys, "check", path)
    assert (code, answer["result"]["convention"]) == (0, "urdf")


def test_check_counts_one_joint_and_names_origins(capsys, urdf, robots_folder):
    assert run(["check", str(urdf), "-q", "--tip", "joint1_link"]) == 0
    assert "panda, 1 joint, URDF: no mistakes" in capsys.readouterr().out
    assert run(["check", str(robots_folder / "quadruped.toml"), "-q"]) == 0
    assert "DH" not in capsys.readouterr().out


def test_rounding_of_angles_can_be_turned_off(capsys, tmp_path):
    path = tmp_path / "wrist.urdf"
    links = "".join(f'<link name="{name}"/>' for name in "abc")
    path.write_text(
        f'<robot name="wrist">{links}'
        '<joint name="j1" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint>'
        '<joint name="j2" type="continuous"><parent link="b"/><child link="c"/><axis xyz="0 0 1"/>'
        '<origin rpy="1.5708 0 0"/></joint></robot>',
        encoding="utf-8",
    )
    _, rounded = call_json(capsys, "base", path)
    assert rounded["result"]["parameters"][0]["expression"] == "ZZ1 + YY2"
    assert "robot.angle-snapped" in {warning["code"] for warning in rounded["warnings"]}
    _, exact = call_json(capsys, "base", path, "--snap", "0")
    assert "MZ2" not in rounded["result"]["parameters"][0]["expression"]
    assert exact["result"]["parameters"][0]["expression"].startswith("ZZ1 + ~0.99999999998")
    code, answer = call_json(capsys, "base", "panda", "--snap", "0")
    assert (code, answer["errors"][0]["code"]) == (2, "usage.no-urdf")
