"""`symid export` to URDF, MJCF, C and JSON: other programs compute with it what was identified.

The truth is a robot with random bodies, whose torques come from Pinocchio and plain formulas. Its base values
are all that an estimate knows; the files hold other bodies with the same base values.
"""

import json
import subprocess

import numpy as np
import pytest

from symid.dynamics.base_parameters import compute_parameter_values, derive_base_parameters
from symid.notation import INERTIAL
from symid.robot.mjcf_reader import parse_xml_robot as parse_urdf
from symid.robot.simulator_writers import write_urdf
from symid.robot.toml_reader import read_robot
from tests.calls import ask, do, fail, list_codes
from tests.chains import build_pinocchio, build_transmission, regress
from tests.estimates import STD, fill_robot, store_estimate
from tests.mujocos import find_mujoco_torques
from tests.urdfs import find_torques

mujoco = pytest.importorskip("mujoco", reason="wants the package mujoco")
pin = pytest.importorskip("pinocchio", reason="wants the package pin")

pytestmark = pytest.mark.usefixtures("shared_work")

FLAGS = [
    "-std=c99",
    "-O1",
    "-Wall",
    "-Wextra",
    "-pedantic",
    "-Wconversion",
    "-Wshadow",
    "-Wdouble-promotion",
    "-Werror",
]
CLOSE = 1e-9


@pytest.fixture(scope="module")
def wrist(tmp_path_factory, robots_folder):
    """Return the true robot with a coupled wrist, and the folder of its estimate."""
    folder = tmp_path_factory.mktemp("wrist")
    robot = fill_robot(read_robot(robots_folder / "tx40.toml"))
    store_estimate(robot, folder / "estimate.json")
    return robot, folder


def find_truth(robot, state, *, without=()):
    """Return the torques of the true robot, without those of some parameters."""
    values = {}
    for index, joint in enumerate(robot.joints):
        values |= {(index, name): value for name, value in zip(INERTIAL, joint.inertial, strict=True)}
        values[index, "IA"] = joint.drive.rotor_inertia
        values |= dict(
            zip([(index, name) for name in ("Fv", "Fc", "offset")], joint.friction.values, strict=True)
        )
    for number, coupling in enumerate(robot.couplings, start=robot.size):
        values[number, "IA"] = coupling.rotor_inertia
        names = [(number, name) for name in ("Fv", "Fc", "offset")]
        values |= dict(zip(names, coupling.friction.values, strict=False))
    columns = regress(robot, *state)
    return sum(values[label] * column for label, column in columns.items() if label[1] not in without)


def draw_states(robot, count):
    """Return states whose joints and coupled drives all move: dry friction is fully there."""
    rng, states = np.random.default_rng(7), []
    while len(states) < count:
        state = rng.uniform(-1, 1, (3, robot.size))
        state[1] = rng.choice([-1, 1], robot.size) * rng.uniform(1.5, 4, robot.size)
        if np.abs(build_transmission(robot) @ state[1]).min() > 1:
            states.append(state)
    return states


def assert_close(found, expected):
    assert np.abs(found - expected).max() <= CLOSE * np.abs(expected).max()


@pytest.mark.parametrize("suffix", ["xml", "mjcf"])
def test_mujoco_has_the_identified_torques(wrist, tmp_path, suffix):
    robot, folder = wrist
    file = tmp_path / f"tx40.{suffix}"
    answer = do("export", "tx40", folder / "estimate.json", "-o", file)
    assert (answer["result"]["format"], answer["result"]["outcome"]) == ("MJCF model", "consistent")
    # The constant torques are all that an MJCF model cannot have.
    assert "export.left-out" in list_codes(answer)
    assert len(answer["result"]["left_out"]) == sum(
        joint.friction.law == "coulomb-viscous-offset" for joint in (*robot.joints, *robot.couplings)
    )
    text = file.read_text(encoding="utf-8")
    assert "values identified from log.npz" in text
    model = mujoco.MjModel.from_xml_string(text)
    for state in draw_states(robot, 5):
        found = find_mujoco_torques(model, [joint.name for joint in robot.joints], state, dry=True)
        assert_close(found, find_truth(robot, state, without=("offset",)))


def test_the_urdf_has_the_identified_torques_in_pinocchio_and_mujoco(wrist, tmp_path):
    robot, folder = wrist
    file = tmp_path / "tx40.urdf"
    answer = do("export", "tx40", folder / "estimate.json", "-o", file)
    text = file.read_text(encoding="utf-8")
    back = parse_urdf(text)
    names = [joint.name for joint in robot.joints]
    pinocchio, other = pin.buildModelFromXML(text), mujoco.MjModel.from_xml_string(text)
    rotors = np.array([joint.drive.rotor_inertia for joint in back.joints])
    friction = np.array([joint.friction.values for joint in back.joints])
    np.testing.assert_array_equal(other.dof_damping, friction[:, 0])
    np.testing.assert_array_equal(other.dof_frictionloss, friction[:, 1])
    assert any("rotor inertia" in entry for entry in answer["result"]["left_out"])
    for state in draw_states(robot, 5):
        # Simulators take rotors by hand; the coupled drive, which no URDF has, is in neither.
        drives = rotors * state[2] + friction[:, 0] * state[1] + friction[:, 1] * np.sign(state[1])
        coupled = build_transmission(robot)[-1]
        damping, dry = robot.couplings[0].friction.values[:2]
        speed, rate = coupled @ state[1], coupled @ state[2]
        wanted = find_truth(robot, state, without=("offset",)) - coupled * (
            robot.couplings[0].rotor_inertia * rate + damping * speed + dry * np.sign(speed)
        )
        assert_close(find_torques(pinocchio, robot, state) + drives, wanted)
        assert_close(find_mujoco_torques(other, names, state, dry=True) + rotors * state[2], wanted)


def test_symid_reads_the_identified_values_in_the_urdf(tmp_path, robots_folder):
    robot = fill_robot(read_robot(robots_folder / "panda.toml"))
    store_estimate(robot, tmp_path / "estimate.json")
    file = tmp_path / "panda.urdf"
    assert do("export", "panda", tmp_path / "estimate.json", "-o", file)["result"]["left_out"] == []
    back = parse_urdf(file.read_text(encoding="utf-8"))
    base = derive_base_parameters(back)
    found, wanted = (
        compute_parameter_values(back, base),
        compute_parameter_values(robot, derive_base_parameters(robot)),
    )
    assert list(found) == list(wanted)
    np.testing.assert_allclose(list(found.values()), list(wanted.values()), rtol=1e-9, atol=1e-9)
    # The bodies are others, of the same torques.
    assert not np.allclose(back.joints[0].inertial, robot.joints[0].inertial)
    state = np.random.default_rng(0).uniform(-2, 2, (3, robot.size))
    truth = build_pinocchio(robot, np.array([joint.inertial for joint in robot.joints]))
    theirs = pin.buildModelFromXML(file.read_text(encoding="utf-8"))
    assert_close(find_torques(theirs, robot, state), pin.rnea(truth, truth.createData(), *state))


PROGRAM = """#include "symid_two_link.h"
#include "symid_two_link_values.h"
#include <stdio.h>
#include <string.h>

int main(void)
{
    const REAL state[3][2] = {STATE};
    REAL rigid[2], dry[2];
    if (strcmp(symid_two_link_signature(), SYMID_TWO_LINK_VALUES_SIGNATURE) != 0) {
        return 3;
    }
    if (symid_two_link_inverse_dynamics(state[0], state[1], state[2], symid_two_link_beta, rigid) != 0) {
        return 4;
    }
    if (symid_two_link_friction(state[1], symid_two_link_f, dry) != 0) {
        return 5;
    }
    printf("%.17g %.17g %.17g\\n", (double)(rigid[0] + dry[0]), (double)(rigid[1] + dry[1]),
           (double)symid_two_link_f[SYMID_TWO_LINK_F_Fc2]);
    return 0;
}
"""


@pytest.fixture
def arm(tmp_path, robots_folder):
    """Return a true arm of two links, and the path of its estimate."""
    robot = fill_robot(read_robot(robots_folder / "two_link.toml"))
    return robot, store_estimate(robot, tmp_path / "estimate.json")


@pytest.mark.parametrize(("real", "close"), [("double", 1e-12), ("float", 1e-5)])
def test_the_c_header_drives_the_generated_library(c_compiler, arm, real, close):
    robot, estimate = arm
    folder = estimate.parent / "code"
    called = ("--function", "inverse_dynamics", "--function", "friction")
    do("generate", "two_link", *called, "--precision", real, "-o", folder)
    header = folder / "symid_two_link_values.h"
    assert list_codes(do("export", "two_link", estimate, "--precision", real, "-o", header)) == []
    state = np.random.default_rng(2).uniform(-1, 1, (3, 2)).round(3)
    suffix = "F" if real == "float" else ""
    rows = ", ".join("{" + ", ".join(f"{value}{suffix}" for value in row) + "}" for row in state)
    text = PROGRAM.replace("REAL", real).replace("STATE", rows)
    (folder / "main.c").write_text(text, encoding="utf-8")
    sources = [str(path) for path in sorted(folder.glob("symid_two_link_*.c"))]
    program = str(folder / "program")
    subprocess.run(
        [c_compiler, *FLAGS, "-o", program, str(folder / "main.c"), *sources, "-lm"], check=True, timeout=120
    )
    done = subprocess.run([program], check=True, capture_output=True, text=True, timeout=20)
    found = np.array(done.stdout.split(), dtype=float)
    expected = find_truth(robot, state)
    np.testing.assert_allclose(found[:2], expected, rtol=close)
    np.testing.assert_allclose(found[2], robot.joints[1].friction.values[1], rtol=close)


TOOLS = """#include "symid_ROBOT.h"
#include "first.h"
#include "second.h"
#include "first.h"
#include <stdio.h>

int main(void)
{
    const double state[3][SYMID_UPPER_JOINTS] = {STATE};
    const double *const beta[] = {FIRST_beta, tool_b_beta}, *const f[] = {FIRST_f, tool_b_f};
    for (int tool = 0; tool < 2; tool++) {
        double rigid[SYMID_UPPER_JOINTS], dry[SYMID_UPPER_JOINTS];
        if (symid_ROBOT_inverse_dynamics(state[0], state[1], state[2], beta[tool], rigid) != 0
            || symid_ROBOT_friction(state[1], f[tool], dry) != 0) {
            return 3;
        }
        for (int joint = 0; joint < SYMID_UPPER_JOINTS; joint++) {
            printf("%.17g\\n", rigid[joint] + dry[joint]);
        }
    }
    return 0;
}
"""


@pytest.mark.parametrize("first", ["tool_a", None])
@pytest.mark.parametrize("name", ["two_link", "tx40", "emps"])
def test_two_tools_in_one_program(c_compiler, tmp_path, robots_folder, name, first):
    """Each tool has the torques of its own robot; other values under the same names are refused."""
    true = [fill_robot(read_robot(robots_folder / f"{name}.toml"), seed) for seed in (1, 2)]
    estimates = [store_estimate(robot, tmp_path / f"{k}.json") for k, robot in enumerate(true)]
    do("generate", name, "--function", "inverse_dynamics", "--function", "friction", "-o", tmp_path / "c")
    do("export", name, estimates[0], *(("--name", first) if first else ()), "-o", tmp_path / "first.h")
    do("export", name, estimates[1], "--name", "tool_b", "-o", tmp_path / "second.h")
    state = draw_states(true[0], 1)[0].round(3)
    rows = ", ".join("{" + ", ".join(map(str, row)) + "}" for row in state)
    text = TOOLS.replace("STATE", rows).replace("FIRST", first or f"symid_{name}")
    text = text.replace("UPPER", name.upper()).replace("ROBOT", name)
    (tmp_path / "main.c").write_text(text, encoding="utf-8")
    sources = [str(path) for path in sorted((tmp_path / "c").glob(f"symid_{name}_*.c"))]
    program, main = str(tmp_path / "program"), str(tmp_path / "main.c")
    command = [c_compiler, *FLAGS, f"-I{tmp_path / 'c'}", "-o", program, main, *sources, "-lm"]
    subprocess.run(command, check=True, timeout=120)
    done = subprocess.run([program], check=True, capture_output=True, text=True, timeout=20)
    found = np.array(done.stdout.split(), dtype=float).reshape(2, -1)
    np.testing.assert_allclose(found, [find_truth(robot, state) for robot in true], rtol=1e-9)
    assert np.abs(found[0] - found[1]).max() > 0.1
    again = ("--name", first, "--force") if first else ("--force",)
    do("export", name, estimates[1], *again, "-o", tmp_path / "second.h")
    refused = subprocess.run(command, check=False, capture_output=True, text=True, timeout=120)
    assert refused.returncode != 0
    assert "export one of them with --name" in refused.stderr


def test_the_c_header_does_not_fit_another_library(c_compiler, arm, tmp_path):
    _, estimate = arm
    header = tmp_path / "values.h"
    do("export", "two_link", estimate, "-o", header)
    text = "#define SYMID_TWO_LINK_H\n#define SYMID_TWO_LINK_BETA {}\n#define SYMID_TWO_LINK_FRICTION 6\n"
    for count, fits in ((6, True), (7, False)):
        source = tmp_path / f"main{count}.c"
        source.write_text(f'{text.format(count)}#include "{header}"\n', encoding="utf-8")
        done = subprocess.run(
            [c_compiler, "-std=c99", "-fsyntax-only", str(source)],
            check=False,
            capture_output=True,
            timeout=20,
        )
        assert (done.returncode == 0) is fits


def test_the_json_has_values_bodies_and_what_was_identified(wrist, tmp_path):
    robot, folder = wrist
    file = tmp_path / "values.json"
    assert "export.left-out" not in list_codes(do("export", "tx40", folder / "estimate.json", "-o", file))
    found = json.loads(file.read_text(encoding="utf-8"))
    assert (found["format"], found["version"], found["robot"]) == ("symid values", 1, "tx40")
    assert (found["outcome"], found["sources"], found["gravity"]) == (
        "consistent",
        ["log.npz"],
        [0, 0, -9.81],
    )
    wanted = compute_parameter_values(robot, derive_base_parameters(robot))
    rows = [*found["vectors"]["beta"], *found["vectors"]["f"]]
    assert [row["name"] for row in rows] == list(wanted)
    np.testing.assert_allclose([row["value"] for row in rows], list(wanted.values()), rtol=1e-9, atol=1e-10)
    assert [row["identified"] for row in rows] == list(wanted.values())
    assert {row["std"] for row in rows} == {STD}
    assert len(found["links"]) == robot.size
    for link in found["links"]:
        tensor = link["inertia"]
        moments = np.array(
            [
                [tensor["xx"], tensor["xy"], tensor["xz"]],
                [tensor["xy"], tensor["yy"], tensor["yz"]],
                [tensor["xz"], tensor["yz"], tensor["zz"]],
            ]
        )
        eigenvalues = np.linalg.eigvalsh(moments)
        assert eigenvalues[0] > 0
        assert eigenvalues[2] < eigenvalues[0] + eigenvalues[1]
        assert link["standard"]["MX"] == pytest.approx(link["mass"] * link["com"][0])
    assert found["drives"][5]["friction"]["model"] == robot.joints[5].friction.law
    assert found["drives"][6]["turns_with"] == {"joint5": 1.0, "joint6": 1.0}


def test_a_robot_file_is_exported_without_an_estimate(tmp_path):
    for suffix in ("urdf", "xml", "h", "json", "toml"):
        file = tmp_path / f"arm.{suffix}"
        assert do("export", "two_link", "-o", file)["result"]["outcome"] == "stated"
        assert "two_link" in file.read_text(encoding="utf-8")
    values = json.loads((tmp_path / "arm.json").read_text(encoding="utf-8"))
    assert values["sources"] == []
    assert [row["identified"] for row in values["vectors"]["beta"]] == [None] * 6


def test_springs_and_rotors_are_vectors_of_their_own(tmp_path):
    file = tmp_path / "elastic.h"
    do("export", "two_link_elastic", "-o", file)
    text = file.read_text(encoding="utf-8")
    assert "symid_two_link_elastic_IA[2]" in text
    assert "#define SYMID_TWO_LINK_ELASTIC_H_k0_1 0" in text


def test_what_cannot_be_exported_is_refused(wrist, tmp_path):
    _, folder = wrist
    file = tmp_path / "x.urdf"
    assert fail("export", "tx40", "-o", file) == (3, "export.no-values")
    assert fail("export", "tx40", folder / "estimate.json", "-o", file, "--precision", "float") == (
        2,
        "usage.export-precision",
    )
    named = ("--name", "tool_a")
    assert fail("export", "two_link", "-o", file, *named) == (2, "usage.export-name")
    for name in ("2a", "tool-a", "", "wörk"):
        assert fail("export", "two_link", "-o", tmp_path / "x.h", "--name", name) == (2, "usage.export-name")
    assert fail("export", "two_link", "-o", tmp_path / "x.yaml") == (2, "usage.suffix")
    assert list(tmp_path.iterdir()) == []


def test_a_value_that_nobody_knows_is_said(wrist, tmp_path):
    _, folder = wrist
    estimate = json.loads((folder / "estimate.json").read_text(encoding="utf-8"))
    estimate["parameters"] = [entry for entry in estimate["parameters"] if entry["name"] != "Fv2"]
    estimate |= {"refused": [["Fv2", "for the test"]], "covariance": [], "outcome": "SOME_REFUSED"}
    (tmp_path / "some.json").write_text(json.dumps(estimate), encoding="utf-8")
    answer = do("export", "tx40", tmp_path / "some.json", "-o", tmp_path / "some.h")
    assert "export.not-identified" in list_codes(answer)
    lines = (tmp_path / "some.h").read_text(encoding="utf-8").splitlines()
    (unknown,) = (line for line in lines if "] Fv2" in line)
    (known,) = (line for line in lines if "] Fc2" in line)
    assert "unknown, left at 0" in unknown
    assert unknown.split()[0] == "0.0,"
    identified = {entry["name"]: entry["value"] for entry in estimate["parameters"]}
    assert float(known.split(",")[0]) == identified["Fc2"]


def test_values_that_were_moved_say_what_was_identified(arm, tmp_path):
    _, path = arm
    estimate = json.loads(path.read_text(encoding="utf-8"))
    for entry in estimate["parameters"]:
        if entry["name"] == "ZZ2":
            entry["value"] = -entry["value"]
    path.write_text(json.dumps(estimate), encoding="utf-8")
    answer = do("export", "two_link", path, "-o", tmp_path / "moved.h")
    assert answer["result"]["outcome"] == "nearest"
    assert "export.inconsistent" in list_codes(answer)
    (line,) = (
        line for line in (tmp_path / "moved.h").read_text(encoding="utf-8").splitlines() if "] ZZ2" in line
    )
    assert float(line.split(",")[0]) > 0
    assert "identified as -" in line


@pytest.mark.parametrize("suffix", ["xml", "usda"])
def test_bodies_that_cannot_exist_are_not_written_for_simulators(tmp_path, suffix):
    text = write_urdf(fill_robot(parse_urdf(PENDULUM)))
    wrong = text.replace('izz="', 'izz="9')
    (tmp_path / "arm.urdf").write_text(wrong, encoding="utf-8")
    file = tmp_path / f"arm.{suffix}"
    code, answer = ask("export", tmp_path / "arm.urdf", "-o", file)
    assert (code, answer["errors"][0]["code"]) == (3, "export.impossible-body")
    assert "the link of j" in answer["errors"][0]["text"]
    assert not file.exists()
    code, _ = ask("export", tmp_path / "arm.urdf", "-o", tmp_path / "new.urdf")
    assert (code, (tmp_path / "new.urdf").read_text(encoding="utf-8")) == (0, wrong)


PENDULUM = """<robot name="r"><link name="w"/><link name="a"><inertial><mass value="1"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link><joint name="j" type="continuous">
<parent link="w"/><child link="a"/><axis xyz="1 0 0"/></joint></robot>"""
