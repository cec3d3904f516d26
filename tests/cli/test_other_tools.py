"""A fit and a robot file that states other bodies on fixed joints than that of the fit: told, or refused."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

import symid
from symid.cli.main import run
from symid.errors import EstimateError
from symid.identification.stored import write_fit
from symid.robot.mjcf_reader import read_xml_robot
from symid.robot.toml_reader import read_robot
from tests.calls import change_json, do, fail, find_texts, hear, list_codes
from tests.estimates import build_estimate, build_springless_estimate
from tests.refusals import raises

GRIPPER = """
[[joint]]
name = "gripper"
kind = "fixed"
origin = { xyz = [0.35, 0, 0], rpy = [0, 0, "pi/6"] }
link = { mass = 0.8, com = [0.03, 0, 0.01], inertia = { xx = 0.001, yy = 0.002, zz = 0.002 } }
"""
CHANGED = GRIPPER.replace("mass = 0.8", "mass = 0.9")
MOVED = GRIPPER.replace('"fixed"', '"fixed"\nparent = "shoulder"')
OTHER = GRIPPER.replace('"gripper"', '"camera"')
FLANGE = '\n[[joint]]\nname = "flange"\nkind = "fixed"\norigin = { xyz = [0.35, 0, 0] }\n'
BODY = '<link name="{}"><inertial><origin xyz="{} 0 0"/><mass value="{}"/>'
BODY += '<inertia ixx="{j}" ixy="0" ixz="0" iyy="{j}" iyz="0" izz="{j}"/></inertial></link>'
TOOL = BODY.format("tool", 0.1, 0.5, j=0.001)
TOOL += '<joint name="flange" type="fixed"><parent link="arm"/><child link="tool"/>'
TOOL += '<origin xyz="0.4 0 0"/></joint>'
URDF = f"""<robot name="axis"><link name="base"/>{BODY.format("arm", 0.2, 2, j=0.02)}
<joint name="shoulder" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint>
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory, robots_folder):
    """Return a folder of robot files with tools, logs of two of them, and the fits of these."""
    root = tmp_path_factory.mktemp("tools")
    arm = (robots_folder / "two_link.toml").read_text(encoding="utf-8")
    tools = {
        "arm": "",
        "gripper": GRIPPER,
        "changed": CHANGED,
        "moved": MOVED,
        "other": OTHER,
        "flange": FLANGE,
    }
    for name, text in tools.items():
        (root / f"{name}.toml").write_text(arm + text, encoding="utf-8")
    for name in ("arm", "gripper"):
        do("simulate", root / f"{name}.toml", "--duration", "10", "-o", root / f"{name}.npz")
        do("identify", root / f"{name}.toml", root / f"{name}.npz", "-o", root / f"{name}.json")
    return root


@pytest.mark.parametrize(
    ("robot", "fit", "words"),
    [
        ("gripper", "arm", r"'gripper' \(0.8 kg on the link of 'elbow'\) is new;"),
        ("arm", "gripper", r"'gripper' \(0.8 kg on the link of 'elbow'\) is gone;"),
        ("changed", "gripper", r"'gripper' \(0.9 kg on the link of 'elbow'\) is another;"),
        ("moved", "gripper", r"'gripper' \(0.8 kg on the link of 'shoulder'\) is another;"),
    ],
)
def test_a_fit_is_not_exported_for_a_robot_with_another_tool(folder, tmp_path, robot, fit, words):
    header = tmp_path / "values.h"
    call = ("export", folder / f"{robot}.toml", folder / f"{fit}.json", "-o", header)
    assert re.search(words, hear(3, "export.other-bodies", *call))
    # The limit of scales, which allows other torques, does not allow another tool.
    assert fail(*call, "--ratio", "100", "--accept") == (3, "export.other-bodies")
    assert not header.exists()


@pytest.mark.parametrize(
    ("robot", "fit"),
    [
        ("gripper", "gripper"),
        ("other", "gripper"),
        ("flange", "arm"),
        ("lumped", "gripper"),
        ("written", "gripper"),
    ],
)
def test_what_is_written_in_another_way_is_no_other_tool(folder, tmp_path, robot, fit):
    """Not its name, nor a frame without mass, nor the same sum, nor values that are those of the fit."""
    file = folder / f"{robot}.toml"
    if robot == "lumped":
        file = tmp_path / "lumped.toml"
        do("export", folder / "gripper.toml", "-o", file)
        assert not read_robot(file).fixed
    elif robot == "written":
        file = tmp_path / "written.toml"
        do("export", folder / "gripper.toml", folder / "gripper.json", "-o", file)
    answer = do("export", file, folder / f"{fit}.json", "-o", tmp_path / "values.h")
    assert answer["result"]["outcome"] == "consistent"
    answer = do("validate", file, folder / f"{fit}.json", folder / f"{fit}.npz")
    assert "estimate.other-bodies" not in list_codes(answer)


def test_a_tool_is_written_into_the_file_with_identified_values(folder, tmp_path):
    """Its torque, of plain trigonometry, adds to that of the arm as it was identified."""
    file = tmp_path / "identified.toml"
    do("export", folder / "arm.toml", folder / "arm.json", "-o", file)
    bare = symid.load(file)
    tool_file = tmp_path / "tool.toml"
    tool_file.write_text(file.read_text(encoding="utf-8") + GRIPPER, encoding="utf-8")
    do("export", tool_file, "-o", tmp_path / "values.json")
    values = json.loads((tmp_path / "values.json").read_text(encoding="utf-8"))["vectors"]["beta"]
    q = np.array([0.4, -0.9])
    library, fit = bare.compile(), symid.load_fit(folder / "arm.json", bare)
    more = library.gravity(q, [entry["value"] for entry in values]) - library.gravity(q, fit.beta)
    (a,) = [one.placement.translation[0].to_float() for one in bare.description.joints[1:]]
    x, y = 0.35 + 0.03 * np.cos(np.pi / 6), 0.03 * np.sin(np.pi / 6)
    elbow = 0.8 * 9.81 * (x * np.cos(q.sum()) - y * np.sin(q.sum()))
    np.testing.assert_allclose(more, [elbow + 0.8 * 9.81 * a * np.cos(q[0]), elbow], rtol=1e-7)


def test_a_fit_of_another_tool_is_tried_with_a_warning(folder, tmp_path):
    robot, fit, log = folder / "gripper.toml", folder / "arm.json", folder / "gripper.npz"
    answer = do("validate", robot, fit, log)
    assert "'gripper' (0.8 kg on the link of 'elbow') is new" in find_texts(answer, "estimate.other-bodies")
    page = tmp_path / "page.html"
    assert run(
        ["report", str(fit), "--robot", str(robot), "--validation", str(log), "-o", str(page), "-q"]
    ) in {0, 1}
    assert "is new; the fit is of the robot in its own logs" in page.read_text(encoding="utf-8")
    answer = do("compare", robot, fit, folder / "gripper.json")
    assert "is new; compare fits of one" in find_texts(answer, "compare.other-bodies")


def test_a_fit_of_another_tool_is_not_taken_as_true(folder):
    """As a prior, as known dynamics, or as the vector that functions take."""
    fit, call = folder / "arm.json", ("identify", folder / "gripper.toml", folder / "gripper.npz")
    for options in (("--estimator", "ridge", "--prior"), ("--rows", "friction", "--known")):
        assert fail(*call, *options, fit) == (3, "estimate.other-bodies")
    robot = symid.load(folder / "gripper.toml")
    with raises(EstimateError, "estimate.other-bodies", match="is new; the fit is of the robot in its own"):
        symid.load_fit(fit, robot).beta  # noqa: B018
    own = symid.load_fit(folder / "gripper.json", robot)
    assert own.beta == pytest.approx(list(robot.base.values.values())[:6], abs=0.01)


def test_a_fit_of_elastic_joints_too(folder, tmp_path, robots_folder):
    arm = (robots_folder / "two_link_elastic.toml").read_text(encoding="utf-8")
    plain, tool = tmp_path / "plain.toml", tmp_path / "tool.toml"
    plain.write_text(arm, encoding="utf-8")
    tool.write_text(arm + GRIPPER, encoding="utf-8")
    fit = write_fit(build_springless_estimate(read_robot(plain)), tmp_path / "fit.json")
    assert fail("export", tool, fit, "-o", tmp_path / "new.toml") == (3, "export.other-bodies")
    do("simulate", tool, "--duration", "2", "-o", tmp_path / "log.npz")
    call = ("identify", tool, tmp_path / "log.npz", "--method", "two-step", "--known", fit)
    assert fail(*call) == (3, "estimate.other-bodies")


@pytest.mark.parametrize("factor", [1.2, -0.1])
def test_a_urdf_that_an_export_wrote_has_no_other_tool(tmp_path, factor):
    """Nor where no bodies have the fit's values, and the nearest were written; one that was swapped is."""
    file, fit = tmp_path / "axis.urdf", tmp_path / "fit.json"
    file.write_text(f"{URDF}{TOOL}</robot>", encoding="utf-8")
    found = build_estimate(read_xml_robot(file))
    values = tuple(replace(entry, value=factor * entry.value) for entry in found.parameters)
    write_fit(replace(found, parameters=values), fit)
    call = ("export", file, fit, "--ratio", "100", "--accept")
    for _ in range(2):
        do(*call, "--in-place")
    (body,) = read_xml_robot(file).fixed
    assert body.inertial != pytest.approx(found.settings["fixed"][0]["inertial"], rel=0.01)
    for tool in (TOOL.replace('"0.5"', '"0.7"'), ""):
        file.write_text(f"{URDF}{tool}</robot>", encoding="utf-8")
        assert fail(*call, "-o", tmp_path / "values.h") == (3, "export.other-bodies")


def test_bodies_of_a_fit_that_cannot_be_read_are_refused(folder, tmp_path):
    def spoil(data):
        data["settings"]["fixed"] = [{"name": "gripper"}]

    fit = change_json(folder / "gripper.json", spoil, tmp_path / "fit.json")
    assert "fixed: carrier is missing" in hear(
        3, "estimate.format", "export", folder / "gripper.toml", fit, "-o", "a.h"
    )


def test_a_tool_of_an_arm_without_values(tmp_path):
    """It is said when the file is loaded, and a fit of the arm alone is refused for it."""
    do("new", tmp_path / "arm.toml", "--from", "panda")
    tool = tmp_path / "tool.toml"
    tool.write_text((tmp_path / "arm.toml").read_text(encoding="utf-8") + GRIPPER, encoding="utf-8")
    assert "count nowhere" in find_texts(do("check", tool), "robot.unused-body")
    assert list_codes(do("base", tool)) == ["robot.unused-body"]
