"""URDFs on the command line: read by their suffix, cut between links."""

import numpy as np
import pytest

from symid.robot.simulator_writers import write_urdf
from tests.calls import ask, do, fail, find_codes, hear, say
from tests.chains import PANDA, draw_parameters, set_inertia


@pytest.fixture
def urdf(tmp_path):
    """Return the path of a URDF of the Panda."""
    path = tmp_path / "panda.urdf"
    path.write_text(
        write_urdf(set_inertia(PANDA, draw_parameters(np.random.default_rng(1), 7))), encoding="utf-8"
    )
    return path


def test_check_reads_a_urdf(urdf):
    answer = do("check", urdf)
    assert answer["result"]["convention"] == "urdf"
    assert len(answer["result"]["joints"]) == 7
    assert "robot.assumed-gravity" in find_codes(answer)
    assert "panda, 7 joints, URDF: no mistakes" in say("check", urdf)


def test_base_of_a_urdf_and_of_a_part_of_it(urdf):
    whole = do("base", urdf)
    assert whole["result"]["count"] == 43
    dh = do("base", "panda")
    names = [[entry["name"] for entry in answer["result"]["parameters"]] for answer in (whole, dh)]
    assert names[0] == names[1]
    code, part = ask("base", urdf, "--base", "joint1_link", "--tip", "joint3_link")
    assert code == 0
    assert {entry["joint"] for entry in part["result"]["parameters"]} == {"joint2", "joint3"}
    assert "robot.cut-off" in {warning["code"] for warning in part["warnings"]}


@pytest.mark.parametrize("verb", ["check", "base", "derive"])
@pytest.mark.parametrize("option", ["--base", "--tip"])
def test_only_a_urdf_is_cut(verb, option):
    text = hear(2, "usage.no-urdf", verb, "two_link", option, "link1")
    assert text.startswith(f"{option} link1: only a URDF or MJCF is cut")


@pytest.mark.parametrize("name", ["arm", "arm.txt"])
def test_a_urdf_is_known_by_what_it_holds(urdf, name):
    path = urdf.with_name(name)
    path.write_text("\ufeff \n" + urdf.read_text(encoding="utf-8").partition("?>")[2], encoding="utf-8")
    assert do("check", path)["result"]["convention"] == "urdf"


def test_rounding_of_angles_can_be_turned_off(tmp_path):
    path = tmp_path / "wrist.urdf"
    links = "".join(f'<link name="{name}"/>' for name in "abc")
    path.write_text(
        f'<robot name="wrist">{links}'
        '<joint name="j1" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint>'
        '<joint name="j2" type="continuous"><parent link="b"/><child link="c"/><axis xyz="0 0 1"/>'
        '<origin rpy="1.5708 0 0"/></joint></robot>',
        encoding="utf-8",
    )
    rounded = do("base", path)
    assert rounded["result"]["parameters"][0]["expression"] == "ZZ1 + YY2"
    assert "robot.angle-snapped" in {warning["code"] for warning in rounded["warnings"]}
    exact = do("base", path, "--snap", "0")
    assert "MZ2" not in rounded["result"]["parameters"][0]["expression"]
    assert exact["result"]["parameters"][0]["expression"].startswith("ZZ1 + ~0.99999999998")
    assert fail("base", "panda", "--snap", "0") == (2, "usage.no-urdf")
