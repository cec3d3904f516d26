"""`symid excite` from the command line: figures of the panda, a file that is followed, refusals."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from symid.cli.main import run
from symid.excitation.limits import read_workspace
from symid.robot.toml_reader import read_robot
from tests.calls import ask, do, fail, list_codes, say

# Franka Emika, data sheet of the Panda: rad, rad/s, rad/s^2, rad/s^3.
LOW = np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973])
HIGH = np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973])
VELOCITY = np.array([2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61])
ACCELERATION = np.array([15, 7.5, 10, 12.5, 15, 20, 20])
JERK = np.array([7500, 3750, 5000, 6250, 7500, 10000, 10000])
QUICK = ("--candidates", "20", "--starts", "1", "--rate", "200")


def read_table(path):
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if line[0] != "#"]
    return lines[0].split(","), np.array([line.split(",") for line in lines[1:]], dtype=float)


def test_the_panda_is_excited_better_than_by_a_thousand_random_trajectories(tmp_path):
    path = tmp_path / "traj.csv"
    answer = do("excite", "panda", "--seed", "0", "--starts", "1", "-o", path)
    result = answer["result"]
    assert result["condition"] < 0.5 * result["random_condition"]
    assert result["factor"] == pytest.approx(result["random_condition"] / result["condition"])
    assert len(result["parameters"]) == 43
    assert list_codes(answer) == ["excitation.no-torque"]
    assert all(entry["share_percent"] <= 95.0001 for entry in result["limits"])
    assert len(result["limits"]) == 28
    # The series itself, between the samples as well, and its third derivative.
    t = np.linspace(0.0, 10.0, 40001)[:, None]
    w = 2 * np.pi / 10 * np.arange(1, 6)
    for place, joint in enumerate(result["joints"]):
        sines, cosines = np.array(joint["sines"]), np.array(joint["cosines"])
        wave = [
            ((1j * w) ** order * (cosines - 1j * sines) * np.exp(1j * w * t)).sum(axis=1).real
            for order in range(4)
        ]
        q = joint["centre"] + wave[0]
        assert LOW[place] < q.min()
        assert q.max() < HIGH[place]
        for values, bound in zip(wave[1:], (VELOCITY, ACCELERATION, JERK), strict=True):
            assert np.abs(values).max() < bound[place]
        assert [abs(wave[1][0]), abs(wave[2][0]), abs(wave[1][-1])] == pytest.approx([0, 0, 0], abs=1e-9)
    headings, table = read_table(path)
    assert headings[:2] == ["t [s]", "q1 [rad]"]
    assert table.shape == (10001, 22) == (result["samples"], 22)
    np.testing.assert_allclose(table[::4, 7], q[::16], atol=1e-12)


@pytest.fixture(scope="module")
def trajectory(tmp_path_factory):
    """Return a file with a trajectory of the arm, and the parameters that it is for."""
    path = tmp_path_factory.mktemp("excite") / "traj.csv"
    return path, do("excite", "two_link", *QUICK, "-o", path)["result"]["parameters"]


def test_excite_simulate_identify(tmp_path, trajectory):
    """The way of an engineer: a trajectory, a log along it, parameters that are those of the robot file."""
    (path, parameters), log = trajectory, tmp_path / "log.csv"
    simulated = do("simulate", "two_link", "--trajectory", path, "-o", log)
    assert simulated["result"]["trajectory"] == "trajectory traj.csv"
    assert simulated["result"]["duration"] == 10.0
    found = do("identify", "two_link", log)
    for entry in found["result"]["parameters"]:
        assert entry["relative_std_percent"] < 2.0
    assert len(found["result"]["parameters"]) == len(parameters)


def test_a_part_of_a_file_is_followed_at_another_scale(tmp_path, trajectory):
    (path, _), log = trajectory, tmp_path / "log.csv"
    motion = ("--trajectory", path, "--scale", "0.5", "--duration", "2", "--clean")
    answer = do("simulate", "two_link", *motion, "-o", log)
    assert answer["result"]["duration"] == 2.0
    assert answer["result"]["trajectory"] == "trajectory traj.csv, amplitudes times 0.5"
    code, answer = ask("simulate", "two_link", "--trajectory", path, "--duration", "11", "-o", log, "--force")
    assert code == 2
    assert "ends after 10 s" in answer["errors"][0]["text"]
    code, answer = ask("simulate", "two_link", "--trajectory", path, "-o", path, "--force")
    assert answer["errors"][0]["code"] == "output.is-input"
    assert fail("simulate", "two_link", "--trajectory", tmp_path / "none", "-o", log, "--force") == (
        2,
        "usage.trajectory",
    )


def test_an_elastic_robot_follows_a_file(tmp_path):
    path, log = tmp_path / "traj.csv", tmp_path / "log.csv"
    answer = do("excite", "two_link_elastic", *QUICK, "--torsion", "0.2", "-o", path)
    assert {"torque", "torsion"} <= {entry["kind"] for entry in answer["result"]["limits"]}
    arguments = ("--trajectory", path, "--duration", "2", "--clean")
    assert max(do("simulate", "two_link_elastic", *arguments, "-o", log)["result"]["largest_torsion"]) < 0.2


def test_the_text_has_shares_and_clearances(tmp_path):
    space = tmp_path / "space.toml"
    space.write_text("[[plane]]\nnormal = [0, 0, 1]\noffset = -1\n", encoding="utf-8")
    text = say("excite", "two_link", *QUICK, "--periods", "2", "--workspace", space)
    assert "times smaller than the best" in text
    assert "least clearance/m" in text
    assert "plane 1, elbow" in text


@pytest.mark.parametrize(
    ("arguments", "code", "error"),
    [
        (("--start", "0"), 2, "usage.excitation"),
        (("--start", "a,b"), 2, "usage.excitation"),
        (("--deviations", "1,-1"), 2, "usage.excitation"),
        (("--stiffness", "1,1"), 2, "usage.excitation"),
        (("--harmonics", "1"), 2, "usage.excitation"),
        (("--criterion", "trace"), 2, "usage.call"),
        (("--torsion", "0.01"), 3, "excitation.stiffness"),
        (("-o", "traj.npz"), 3, "output.unknown-suffix"),
        (("-o", "nowhere/traj.csv"), 3, "output.no-folder"),
    ],
)
def test_calls_that_cannot_be(monkeypatch, tmp_path, *, arguments, code, error):
    monkeypatch.chdir(tmp_path)
    robot = Path(__file__).resolve().parents[2] / "robots" / "two_link.toml"
    assert fail("excite", robot, *QUICK, *arguments) == (code, error)
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope="module")
def page(project):
    text = (project / "docs" / "excite.md").read_text(encoding="utf-8")
    return dict(re.findall(r"^```(sh|toml|python)\n(.*?)^```$", text, re.DOTALL | re.MULTILINE))


def test_the_commands_of_the_page_run(capsys, monkeypatch, tmp_path, page):
    monkeypatch.chdir(tmp_path)
    for line in page["sh"].splitlines():
        words = shlex.split(line)
        assert words[0] == "symid"
        # The page searches as long as the defaults do; what comes out is the same kind of thing.
        quick = QUICK if words[1] == "excite" else ()
        assert run([*words[1:], *quick, "-q"]) == 0, line
    assert "Fc2" in capsys.readouterr().out


def test_the_python_of_the_page_runs(capsys, page):
    exec(compile(page["python"], "excite.md", "exec"), {})  # noqa: S102  the page's own example
    assert capsys.readouterr().out == "True True\n"


def test_the_workspace_of_the_page_is_one(tmp_path, page, robots_folder):
    path = tmp_path / "space.toml"
    path.write_text(page["toml"], encoding="utf-8")
    workspace = read_workspace(path, read_robot(robots_folder / "panda.toml"))
    assert [len(region.joints) for region in workspace] == [2, 1]
