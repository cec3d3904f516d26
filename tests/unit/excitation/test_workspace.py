"""Files of spheres and planes: what they say, and what is wrong with them, all at once and where."""

import pytest

from symid.errors import RobotError
from symid.excitation.limits import WorkspaceRegion, read_workspace
from tests.refusals import raises

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


def read(tmp_path, robot, text):
    path = tmp_path / "space.toml"
    path.write_text(text, encoding="utf-8")
    return read_workspace(path, robot)


def test_regions_are_what_the_file_says(tmp_path, robot):
    both = {"joints": (1, 0), "place": (0.0, 0.1, 0.0), "size": 0.05}
    last = {"joints": (1,), "place": (0.0, 0.0, 0.0), "size": 0.0}
    workspace = read(tmp_path, robot, GOOD)
    assert workspace == (
        WorkspaceRegion(kind="in", anchor=(0.1, 0.0, 0.2), extent=0.9, label="sphere 1", **both),
        WorkspaceRegion(kind="out", anchor=(1.0, 1.0, 1.0), extent=0.5, label="sphere 2", **last),
        WorkspaceRegion(kind="plane", anchor=(0.0, 0.6, 0.8), extent=-0.1, label="plane 1", **last),
    )


@pytest.mark.parametrize(
    ("change", "code", "says"),
    [
        (('"in"', '"inside"'), "robot.bad-choice", "3:8: sphere 1: keep: "),
        (("radius = 0.9", "radius = 0"), "robot.out-of-range", "5:10: sphere 1: radius: .* 0 m"),
        (("radius = 0.5", ""), "robot.missing-key", "sphere 2: radius: "),
        (("centre = [1, 1, 1]", ""), "robot.missing-key", "sphere 2: centre: "),
        (("centre = [1, 1, 1]", "centre = [1, 1]"), "robot.wrong-type", r"11:10: sphere 2: centre: "),
        (('["elbow", "shoulder"]', '["wrist"]'), "robot.bad-choice", "wrist.*shoulder, elbow"),
        (('["elbow", "shoulder"]', "[]"), "robot.bad-choice", r"sphere 1: links: .*got \[\]"),
        (("size = 0.05", "size = -1"), "robot.out-of-range", "sphere 1: size: .* 0 m"),
        (("size = 0.05", "size = 2"), "robot.out-of-range", "sphere 1: size: .* 0.9 m"),
        (("[0.0, 0.1, 0.0]", '["a", 0, 0]'), "robot.wrong-type", 'sphere 1: point: .* m, got "a"'),
        (("[0, 3, 4]", "[0, 0, 0]"), "robot.out-of-range", "plane 1: normal: "),
        (("offset = -0.1", ""), "robot.missing-key", "plane 1: offset: "),
        (("[[plane]]", "[[cube]]"), "robot.unknown-key", "cube: "),
        (("[[plane]]", "[plane]"), "robot.wrong-type", r"plane: .*\[\[plane\]\]"),
        (("[[plane]]", "[plane"), "excitation.workspace", "TOML"),
        (("radius = 0.9", "radius = 0.9\ncolour = 1"), "robot.unknown-key", "6:1: sphere 1: colour: "),
    ],
)
def test_mistakes_are_named_with_their_place(tmp_path, robot, change, code, says):
    with raises(RobotError, code, match=says):
        read(tmp_path, robot, GOOD.replace(*change))


def test_all_mistakes_are_told_at_once_and_an_empty_file_is_refused(tmp_path, robot):
    with pytest.raises(RobotError) as caught:
        read(tmp_path, robot, GOOD.replace("radius", "radios").replace("normal", "normals"))
    assert len(caught.value.notices) == 6
    with raises(RobotError, "excitation.workspace", match=r"space.toml"):
        read(tmp_path, robot, "# nothing\n")
