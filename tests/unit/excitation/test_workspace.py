"""Files of spheres and planes: what they say, and what is wrong with them, all at once and where."""

from pathlib import Path

import pytest

from symid.errors import RobotError
from symid.excitation.limits import WorkspacePoint, WorkspaceRegion, read_workspace
from symid.robot.toml_reader import read_robot

ROBOTS = Path(__file__).resolve().parents[3] / "robots"
GOOD = """
[[sphere]]
keep = "in"
centre = [0.1, 0, 0.2]
radius = 0.9
links = ["elbow", "shoulder"]
point = [0.0, 0.1, 0.0]
size = 0.05

[[sphere]]
centre = [1, 1, 1]
radius = 0.5

[[plane]]
normal = [0, 3, 4]
offset = -0.1
"""


@pytest.fixture(scope="module")
def robot():
    return read_robot(ROBOTS / "two_link.toml")


def read(tmp_path, robot, text):
    path = tmp_path / "space.toml"
    path.write_text(text, encoding="utf-8")
    return read_workspace(path, robot)


def test_regions_are_what_the_file_says(tmp_path, robot):
    points = tuple(WorkspacePoint(joint=joint, place=(0.0, 0.1, 0.0), size=0.05) for joint in (1, 0))
    last = (WorkspacePoint(joint=1, place=(0.0, 0.0, 0.0), size=0.0),)
    workspace = read(tmp_path, robot, GOOD)
    assert workspace.regions == (
        WorkspaceRegion(kind="in", anchor=(0.1, 0.0, 0.2), extent=0.9, points=points, label="sphere 1"),
        WorkspaceRegion(kind="out", anchor=(1.0, 1.0, 1.0), extent=0.5, points=last, label="sphere 2"),
        WorkspaceRegion(kind="plane", anchor=(0.0, 0.6, 0.8), extent=-0.1, points=last, label="plane 1"),
    )
    assert workspace.file.endswith("space.toml")


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('"in"', '"inside"', r"3:8: sphere 1: keep: expected one of"),
        ("radius = 0.9", "radius = 0", r"5:10: sphere 1: radius: must be greater than 0"),
        ("radius = 0.5", "", r"sphere 2: radius: missing"),
        ("centre = [1, 1, 1]", "", r"sphere 2: centre: missing"),
        ("centre = [1, 1, 1]", "centre = [1, 1]", r"expected a list of 3 numbers"),
        ('["elbow", "shoulder"]', '["wrist"]', r"there are shoulder, elbow"),
        ('["elbow", "shoulder"]', "[]", r"expected a list of names"),
        ("size = 0.05", "size = -1", r"must be at least 0"),
        ("size = 0.05", "size = 2", r"does not fit within 0.9 m"),
        ("[0.0, 0.1, 0.0]", '["a", 0, 0]', r"expected a number in m"),
        ("[0, 3, 4]", "[0, 0, 0]", r"a normal of length zero"),
        ("offset = -0.1", "", r"plane 1: offset: missing"),
        ("[[plane]]", "[[cube]]", r"no such key here"),
        ("[[plane]]", "[plane]", r"expected tables; write \[\[plane\]\]"),
        ("[[plane]]", "[plane", r"not valid TOML"),
        ("radius = 0.9", "radius = 0.9\ncolour = 1", r"colour: no such key"),
    ],
)
def test_mistakes_are_named_with_their_place(tmp_path, robot, old, new, says):
    with pytest.raises(RobotError, match=says):
        read(tmp_path, robot, GOOD.replace(old, new))


def test_all_mistakes_are_told_at_once(tmp_path, robot):
    with pytest.raises(RobotError) as caught:
        read(tmp_path, robot, GOOD.replace("radius", "radios").replace("normal", "normals"))
    assert len(caught.value.notices) == 6


def test_an_empty_file_is_refused(tmp_path, robot):
    with pytest.raises(RobotError, match="holds no") as caught:
        read(tmp_path, robot, "# nothing\n")
    assert caught.value.notices[0].code == "excitation.workspace"
