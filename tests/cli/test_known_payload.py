"""Runs with a payload that is known, and runs without, tell the same robot in one fit."""

import numpy as np
import pytest

from symid.robot.toml_reader import read_robot
from symid.robot.toml_writer import write_robot
from tests.calls import ask, do, hear, list_codes
from tests.estimates import add_payload

pytestmark = pytest.mark.usefixtures("shared_work")

MASS, CENTRE, INERTIA = 0.8, (0.1, 0.02, 0.0), (0.002, 0.0, 0.0, 0.002, 0.0, 0.003)
DISC = (
    f'payload = {{ name = "disc", joint = "elbow", mass = {MASS}, com = [0.1, 0.02, 0], '
    "inertia = { xx = 0.002, yy = 0.002, zz = 0.003 } }\n"
)
ENDS = "drop_first = 300\ndrop_last = 300\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory, robots_folder):
    """Return a folder with logs of the robot without and with the payload, which another robot file has."""
    root = tmp_path_factory.mktemp("loaded")
    robot = read_robot(robots_folder / "two_link.toml")
    loaded = add_payload(robot, MASS, CENTRE, INERTIA)
    (root / "loaded.toml").write_text(write_robot(loaded), encoding="utf-8")
    for name, source, seed in (("empty", "two_link", 1), ("with", root / "loaded.toml", 2)):
        motion = ("--duration", "10", "--seed", str(seed))
        do("simulate", source, *motion, "-o", root / f"{name}.npz")
    runs = f'[[run]]\nfile = "empty.npz"\n{ENDS}[[run]]\nfile = "with.npz"\n{ENDS}'
    (root / "both.toml").write_text(runs + DISC, encoding="utf-8")
    (root / "alone.toml").write_text(f'[[run]]\nfile = "with.npz"\n{ENDS}{DISC}', encoding="utf-8")
    (root / "forgotten.toml").write_text(runs, encoding="utf-8")
    return root


def measure(answer):
    """Return errors in deviations of the parameters that the answer has."""
    return np.array([(e["value"] - e["truth"]) / e["std"] for e in answer["result"]["parameters"]])


@pytest.mark.parametrize("rows", ["torque", "momentum", "energy"])
def test_both_runs_tell_the_robot_without_it(folder, rows):
    arguments = ("identify", "two_link", folder / "both.toml", "--rows", rows)
    answer = do(*arguments, "--estimator", "wls" if rows != "energy" else "ols")
    assert np.abs(measure(answer)).max() < 5.0
    (told,) = [entry for entry in answer["warnings"] if entry["code"] == "log.payload"]
    assert told["file"] == str(folder / "with.npz")
    assert "'disc'" in told["text"]
    forgotten = do("identify", "two_link", folder / "forgotten.toml", "--rows", rows)
    errors = [
        np.abs([e["value"] - e["truth"] for e in found["result"]["parameters"]])
        for found in (answer, forgotten)
    ]
    assert (errors[1] / np.maximum(errors[0], 1e-3)).max() > 10.0


def test_the_run_with_it_alone_and_its_validation(folder, tmp_path):
    estimate = tmp_path / "estimate.json"
    arguments = ("identify", "two_link", folder / "alone.toml", "--estimator", "wls", "-o", estimate)
    assert np.abs(measure(do(*arguments))).max() < 5.0
    code, empty = ask("validate", "two_link", estimate, folder / "empty.npz")
    told = do("validate", "two_link", estimate, folder / "alone.toml")
    untold = do("validate", "two_link", estimate, folder / "with.npz")
    means = [entry["result"]["mean_relative_percent"] for entry in (empty, told, untold)]
    assert code == 0
    assert max(means[:2]) < 0.2 * means[2]
    banded = [
        ask("validate", "two_link", estimate, folder / name, "--band", "10")[1]
        for name in ("alone.toml", "with.npz")
    ]
    left = [entry["result"]["mean_relative_percent"] for entry in banded]
    assert left[0] < 0.2 * left[1]


def test_a_diagnosis_reads_the_runs_as_the_fit_did(folder, tmp_path):
    estimate, page = tmp_path / "estimate.json", tmp_path / "page.html"
    ask("identify", "two_link", folder / "both.toml", "--estimator", "wls", "-o", estimate)
    answer = do("report", estimate, "--diagnose", "-o", page)
    codes = list_codes(answer)
    assert "diagnosis.other-values" not in codes


@pytest.mark.parametrize(
    ("robot", "options", "what"),
    [
        ("two_link", ("--rows", "friction"), "--rows friction"),
        ("two_link", ("--estimator", "output-error"), "--estimator output-error"),
        ("two_link", ("--estimator", "instrumental"), "--estimator instrumental"),
        ("two_link_elastic", (), "a robot with elastic joints"),
    ],
)
def test_what_cannot_take_it_into_account_refuses_it(folder, robot, options, what):
    text = hear(3, "log.known-payload", "identify", robot, folder / "alone.toml", *options)
    assert f"which {what} does not support" in text


@pytest.mark.parametrize(
    ("payload", "code", "said"),
    [
        ('{ joint = "hand", mass = 1 }', "runs.unknown-joint", "shoulder, elbow"),
        ("{ mass = -1 }", "runs.", "mass"),
        ('{ name = "disc" }', "runs.", "mass"),
        ("{ mass = 1, weight = 2 }", "runs.unknown-key", "weight"),
        (
            "{ mass = 1, inertia = { xx = 1, yy = 0.1, zz = 0.1 } }",
            "runs.impossible-inertia",
            "payload: inertia: ",
        ),
    ],
)
def test_mistakes_have_their_place(folder, payload, code, said):
    path = folder / "wrong.toml"
    path.write_text(f'[[run]]\nfile = "with.npz"\npayload = {payload}\n', encoding="utf-8")
    status, answer = ask("identify", "two_link", path)
    error = answer["errors"][0]
    assert (status, error["line"]) == (3, 3)
    assert error["code"].startswith(code)
    assert said in error["text"]


def test_a_study_of_one_log_takes_a_run_and_no_two(folder):
    assert "has 2 logs" in hear(2, "usage.one-log", "study", "cutoff", "two_link", folder / "both.toml")


def test_what_is_assumed_of_a_payload_is_told(folder):
    path = folder / "point.toml"
    path.write_text(f'[[run]]\nfile = "with.npz"\n{ENDS}payload = {{ mass = 0.5 }}\n', encoding="utf-8")
    code, answer = ask("identify", "two_link", path)
    (told,) = [entry for entry in answer["warnings"] if entry["code"] == "runs.point-mass"]
    assert (code, told["line"]) == (0, 5)
