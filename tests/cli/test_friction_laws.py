"""`symid generate --friction-laws`, and verbs on robots with curved friction."""

import json

import pytest

from symid.joint_models.friction_catalogue import FRICTION_LAWS, get_law
from tests.calls import ask, do, fail, hear, list_codes
from tests.friction_forms import OLD_NAMES


def test_friction_laws_are_part_of_the_library(tmp_path):
    folder = tmp_path / "code"
    call = ("generate", "emps", "--function", "friction", "--friction-laws", "-o", folder)
    answer = do(*call)
    result = answer["result"]
    assert result["selftest"] == "passed" or answer["warnings"][-1]["code"] == "generate.selftest-not-run"
    header = (folder / "symid_emps_friction_laws.h").read_text()
    assert header.count("double symid_emps_friction_") == len(FRICTION_LAWS)
    assert "symid_emps_friction_laws.o" in (folder / "Makefile").read_text()
    assert "install(FILES symid_emps.h symid_emps_friction_laws.h" in (folder / "CMakeLists.txt").read_text()
    manifest = json.loads((folder / "manifest.json").read_text())
    assert {"symid_emps_friction_laws.h", "symid_emps_friction_laws.c"} <= set(manifest["files"])


CURVED = """
name = "slide"
convention = "modified"
gravity = [0, 0, -9.81]

[[joint]]
name = "carriage"
kind = "prismatic"
alpha = "pi/2"

[joint.link]
mass = 95.0
com = [0, 0, 0]

[joint.friction]
model = "stribeck"
Fv = 203
Fc = 20
Fe = 8
vs = 0.05

[joint.limits]
position = [-0.3, 0.3]
velocity = 0.5
torque = 500
"""


FURTHER = {
    "stribeck": ("gamma = 1.5\nFe = 8\nvs = 0.05", {"Fv1": 203.0, "Fc1": 20.0, "Fe1": 8.0}),
    "lorentzian": ("Fe = 8\nvs = 0.05", {"Fv1": 203.0, "Fc1": 20.0, "Fe1": 8.0}),
    "load-dependent": ("Fl = 0.05", {"Fv1": 203.0, "Fc1": 20.0, "Fl1": 0.05}),
    "position-dependent-1x40": ("A1 = 5\nB1 = -3", {"Fv1": 203.0, "Fc1": 20.0, "A1_1": 5.0, "B1_1": -3.0}),
    "position-torque-1x40": ("A1 = 5\nB1 = -3", {"Fv1": 203.0, "Fc1": 20.0, "A1_1": 5.0, "B1_1": -3.0}),
}


@pytest.mark.parametrize("model", FURTHER)
def test_a_robot_with_any_law_is_generated_moved_simulated_and_identified(tmp_path, model):
    robot, log = tmp_path / "slide.toml", tmp_path / "log.npz"
    write_slide(robot, model)
    for target in ("c", "python"):
        answer = do("generate", robot, "--target", target, "-o", tmp_path / target)
        assert answer["result"]["selftest"] == "passed" or answer["warnings"]
    options = ("--harmonics", "2", "--candidates", "1", "--starts", "1", "--period", "2")
    do("excite", robot, "-o", tmp_path / "motion.csv", *options)
    do("simulate", robot, "-o", log, "--seed", "1", "--duration", "12")
    answer = do("identify", robot, log, "-o", tmp_path / "estimate.json")
    found = {entry["name"]: entry["value"] for entry in answer["result"]["parameters"]}
    for name, value in FURTHER[model][1].items():
        assert found[name] == pytest.approx(value, rel=0.1)
    # Simulated logs do not have the load of the gears.
    if "load" in get_law(model).inputs:
        return
    # The friction that the robot file states is not taken for what is to be found.
    call = ("identify", robot, log, "--rows", "friction", "--model", "coulomb-viscous")
    answer = do(*call, "-o", tmp_path / "friction.json")
    found = {entry["name"]: entry["value"] for entry in answer["result"]["joints"][0]["parameters"]}
    assert found["fC"] == pytest.approx(20.0, abs=8.0)
    assert found["fV"] == pytest.approx(203.0, rel=0.2)


def write_slide(path, model):
    text = CURVED.replace('"stribeck"', f'"{model}"')
    path.write_text(text.replace("Fe = 8\nvs = 0.05", FURTHER[model][0]))


def test_laws_of_single_joints_are_given_by_name(tmp_path):
    log = tmp_path / "log.npz"
    ask("simulate", "two_link", "-o", log, "--seed", "1", "--duration", "20")
    code, answer = ask("identify", "two_link", log, "--friction", "elbow=stribeck,shoulder=auto")
    assert code == 0, answer
    laws = {entry["joint"]: entry["law"] for entry in answer["result"]["laws"]}
    assert laws["elbow"] == "stribeck"
    assert set(laws) == {"shoulder", "elbow"}
    for options in (("--friction", "elbw=stribek"), ("--rows", "friction", "--model", "elbw=stribek")):
        code, answer = ask("identify", "two_link", log, *options)
        assert code == 2
        assert list_codes(answer, "errors") == ["usage.joint-friction"] * 2
        told = " ".join(entry["text"] for entry in answer["errors"])
        assert "did you mean elbow?" in told
        assert "did you mean stribeck or" in told
    assert fail("base", "two_link", "--friction", "elbow=coulomb") == (2, "usage.friction-auto")


@pytest.mark.parametrize("name", [name for name in OLD_NAMES if not get_law(OLD_NAMES[name]).shape])
def test_what_is_written_has_the_name_of_today(tmp_path, name):
    call = ("new", tmp_path / "arm.toml", "--from-dh", tmp_path / "arm.csv", "--convention", "modified")
    (tmp_path / "arm.csv").write_text("alpha,a,d,theta\n0,0,0,q\n")
    do(*call, "--friction", name)
    assert f'model = "{OLD_NAMES[name]}"' in (tmp_path / "arm.toml").read_text()
    assert do("check", tmp_path / "arm.toml")["result"]["joints"][0]["friction"] == OLD_NAMES[name]


def test_a_law_that_does_not_exist_is_refused_with_the_nearest():
    text = hear(2, "usage.unknown-friction-law", "base", "emps", "--friction", "viscous_coulom")
    assert "did you mean " in text
    assert fail("base", "emps", "--friction", "stribeck") == (2, "usage.friction-shape")
