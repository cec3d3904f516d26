"""`symid report`: whose page it is, and where its robot is found."""

import json
import re
import shlex
import time

import pytest

import symid
from tests.calls import do, fail, hear, say


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with a robot file of its own, called as one that comes with symid, logs and a fit."""
    folder = tmp_path_factory.mktemp("cell")
    text = symid.load("two_link").path.read_text()
    (folder / "my_arm.toml").write_text(text.replace("mass = 1.9", "mass = 2.4"))
    robot = symid.load(folder / "my_arm.toml")
    for seed in (1, 2):
        robot.simulate(duration=4.0, seed=seed).log.save(folder / f"run_{seed}.npz")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        do("identify", "my_arm.toml", "run_1.npz", "-o", "fit.json")
    return folder


def test_the_robot_file_of_a_fit_is_found_again(folder, tmp_path, monkeypatch):
    """Named once for `identify`, it needs no naming for `report`, in its folder and from elsewhere."""
    monkeypatch.chdir(folder)
    say("report", "fit.json", "--validation", "run_2.npz", "-o", tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text()
    assert "robot two_link of my_arm.toml" in text
    assert "Where are the joints of two_link?" in text
    monkeypatch.chdir(tmp_path)
    do("report", folder / "fit.json", "--validation", folder / "run_2.npz", "-o", "other.html")


def test_the_command_on_a_page_names_files_that_are_there(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(folder)
    for logs in ((), ("--validation", "run_2.npz")):
        say("report", "fit.json", *logs, "-o", tmp_path / "page.html", "--force")
        (command,) = re.findall(r'class="next">[^<]*<br><code>([^<]*)', (tmp_path / "page.html").read_text())
        words = shlex.split(command)
        assert words[:2] in (["symid", "validate"], ["symid", "export"])
        assert words[2:4] == ["my_arm.toml", "fit.json"]


def test_the_command_on_a_page_works_where_no_bodies_have_the_values(folder, tmp_path, monkeypatch):
    """An inertia just below zero: held-out torque is predicted, and the plain export is refused."""
    monkeypatch.chdir(folder)
    data = json.loads((folder / "fit.json").read_text())
    for entry in data["parameters"]:
        if entry["name"] == "ZZ2":
            entry["value"] *= -0.05
    (tmp_path / "broken.json").write_text(json.dumps(data))
    assert fail("export", "my_arm.toml", tmp_path / "broken.json", "-o", tmp_path / "x.toml") == (
        3,
        "export.cost",
    )
    page = tmp_path / "page.html"
    say("report", tmp_path / "broken.json", "--validation", "run_2.npz", "-o", page)
    ((why, command),) = re.findall(r'class="next">([^<]*)<br><code>([^<]*)', page.read_text())
    words = shlex.split(command)
    assert words[1] == "export"
    assert "--estimator consistent" in why
    assert float(words[words.index("--limit") + 1]) < 100.0
    say(*words[1:])
    assert (folder / words[5]).exists()


def test_a_robot_that_is_gone_is_asked_for(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fit.json").write_bytes((folder / "fit.json").read_bytes().replace(b"my_arm", b"gone"))
    told = hear(
        2, "usage.unknown-robot", "report", "fit.json", "--validation", folder / "run_2.npz", "-o", "p.html"
    )
    assert "--robot FILE.toml" in told
    # The page of the stored fit alone needs no robot, and draws none.
    say("report", "fit.json", "-o", "page.html")
    assert "Where are the joints" not in (tmp_path / "page.html").read_text()
    say("report", "fit.json", "--robot", folder / "my_arm.toml", "-o", "drawn.html")
    assert "Where are the joints" in (tmp_path / "drawn.html").read_text()


def test_title_author_and_date_are_those_of_the_call(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(folder)
    page = tmp_path / "page.html"
    do("report", "fit.json", "-o", page, "--title", "Cell 3, after service", "--author", "A. Turing")
    text = page.read_text()
    assert "<h1>Cell 3, after service</h1>" in text
    assert f"· A. Turing · {time.strftime('%Y-%m-%d')}</p>" in text
    do("report", "fit.json", "-o", page, "--force", "--date", "2031-01-02")
    assert '<p class="byline">2031-01-02</p>' in page.read_text()
    # Results of other kinds, too; without a call the page has no date, and the same bytes every day.
    fit = symid.load_fit("fit.json")
    fit.report(page)
    assert 'byline">' not in page.read_text()
    symid.load("two_link").check().report(page, title="A file", date="today")
    assert "<h1>A file</h1>" in page.read_text()
