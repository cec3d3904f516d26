"""Robot files by path, in ./robots, and among those that come with symid."""

import pytest

from symid.errors import UsageError
from symid.robot.loading import is_mjcf, is_xml, list_robots, locate_robot_file


def test_names_are_found_from_any_folder(tmp_path, monkeypatch, robots_folder):
    monkeypatch.chdir(tmp_path)
    assert locate_robot_file("emps").samefile(robots_folder / "emps.toml")
    assert locate_robot_file("emps.toml").samefile(robots_folder / "emps.toml")
    assert {"emps", "two_link", "puma560", "panda"} <= set(list_robots())


def test_the_folder_at_hand_comes_first(tmp_path, monkeypatch):
    (tmp_path / "robots").mkdir()
    for name in ("emps", "mine"):
        (tmp_path / "robots" / f"{name}.toml").touch()
    monkeypatch.chdir(tmp_path)
    assert locate_robot_file("emps").samefile(tmp_path / "robots" / "emps.toml")
    assert "mine" in list_robots()
    assert list(list_robots()) == sorted(set(list_robots()))


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("two_lnk", "did you mean two_link"),
        ("PANDA", "did you mean panda?"),
        ("xyz", "known are double_pendulum, emps, "),
    ],
)
def test_an_unknown_name_gets_the_nearest_names(tmp_path, monkeypatch, name, words):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError) as caught:
        locate_robot_file(name)
    assert caught.value.notices[0].code == "usage.unknown-robot"
    assert words in str(caught.value)


def test_an_unknown_path_or_name_gets_its_neighbours(tmp_path, monkeypatch):
    (tmp_path / "arm.toml").touch()
    with pytest.raises(UsageError, match=r"mean .*arm\.toml\?"):
        locate_robot_file(str(tmp_path / "amr.toml"))
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError, match=r"did you mean arm\.toml\?"):
        locate_robot_file("arm.tom")
    assert not is_xml(tmp_path)
    with pytest.raises(UsageError, match="folder"):
        locate_robot_file(str(tmp_path))


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("arm", b"<robot/>", True),
        ("arm.toml", b"\xef\xbb\xbf\n  <?xml?>", True),
        ("arm.urdf", b"", True),
        ("arm.toml", b"# <robot/>", False),
        ("arm", b"name = 1", False),
    ],
)
def test_a_urdf_is_known_by_its_name_or_its_first_letter(tmp_path, name, content, expected):
    path = tmp_path / name
    path.write_bytes(content)
    assert is_xml(path) == expected


def test_a_model_is_known_by_its_first_tag_behind_comments(tmp_path):
    path = tmp_path / "arm.xml"
    comments = "<?xml version='1.0'?>\n" + "<!-- <mujoco> -- > -->\n" * 500
    for tail, found in (
        ("<mujoco model='arm'/>", True),
        ("<mujocoinclude/>", True),
        ("<robot><mujoco/></robot>", False),
        ("<!DOCTYPE mujoco><mujoco/>", False),
        ("<!-- never closed <mujoco/>", False),
        ("", False),
    ):
        path.write_text(comments + tail, encoding="utf-8")
        assert is_mjcf(path) is found
