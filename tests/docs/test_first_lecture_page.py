"""The page for lecturers: its commands run from its files, and print what it says."""

import shutil

import pytest

from tests.transcripts import compare, list_steps, run_step


@pytest.fixture(scope="module")
def page(project):
    return (project / "docs" / "first_lecture.md").read_text(encoding="utf-8")


def test_the_page_shows_what_is_printed(project, page, tmp_path):
    folder = tmp_path / "work"
    shutil.copytree(project / "docs" / "first_lecture", folder)
    steps = list_steps(page)
    assert len(steps) == 5
    for command, answer in steps:
        code, found = run_step(command, folder, tmp_path / "cache")
        # One answer of the student is wrong.
        assert code == int("--check" in command), found
        assert not compare(answer, found), found
    made = {path.name for path in folder.iterdir()}
    assert {"lesson.html", "lesson.exercises.txt", "lesson.answers.txt", "three_link.html"} <= made
    sheet = (folder / "lesson.exercises.txt").read_text(encoding="utf-8")
    filled = (folder / "student.txt").read_text(encoding="utf-8")
    assert [line.partition(" =")[0] for line in filled.splitlines()] == [
        line.partition(" =")[0] for line in sheet.splitlines()
    ]


def test_the_robot_of_the_page_is_its_file(project, page):
    file = (project / "docs" / "first_lecture" / "three_link.toml").read_text(encoding="utf-8")
    assert f"```toml\n{file}```" in page
