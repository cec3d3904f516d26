"""`symid plot` and `--open`: what is drawn, what is refused."""

import webbrowser

import pytest

import symid
from symid.cli.main import run
from tests.calls import do, refuse


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    symid.load("two_link").simulate(duration=4.0, seed=1).save("log.npz")
    return tmp_path


def test_a_robot_and_a_log_are_drawn(here):
    answer = do("plot", "scara", "-o", "scara.svg", "--pose", "0.3,0.5,0.1,0")
    assert "q = (0.3, 0.5, 0.1, 0)" in answer["result"]["figures"][0]
    assert (here / "scara.svg").read_text().startswith("<svg")
    assert len(do("plot", "two_link", "log.npz", "-o", "log.html")["result"]["figures"]) == 2


@pytest.mark.parametrize(("pose", "code"), [("0.3,x,0", "usage.pose"), ("0.3", "usage.pose")])
def test_a_wrong_pose_is_refused(here, pose, code):
    assert refuse("plot", "scara", "-o", "scara.svg", "--pose", pose) == (2, [code])


def test_a_plot_opens_in_the_browser(here, monkeypatch):
    opened = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    assert run(["plot", "two_link", "-o", "arm.html"]) == 0
    assert opened == []
    assert run(["plot", "two_link", "-o", "arm.html", "--force", "--open"]) == 0
    assert opened == [(here / "arm.html").resolve().as_uri()]
