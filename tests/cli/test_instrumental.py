"""Instruments on the command line: an estimate that goes on, a verdict on least squares, refusals."""

import json

import numpy as np
import pytest

from tests.calls import ask, do, find_codes, find_texts, refuse, say

pytestmark = pytest.mark.usefixtures("shared_work")

CONTROLLER = """
[controller]
stiffness = [400, 60]              # N m/rad
damping = [25, 3]                  # N m s/rad
velocity_filter = 150              # Hz
torque = "average"
"""
NAME = ("--estimator", "instrumental")
HIGH = ("--set", "processing.filter_cutoff=60", "--set", "processing.decimation.factor=5")


@pytest.fixture(scope="module")
def folder(tmp_path_factory, robots_folder):
    """Return a folder with a robot file that has a controller, two logs, and one with a noisy encoder."""
    path = tmp_path_factory.mktemp("instrumental")
    (path / "arm.toml").write_text((robots_folder / "two_link.toml").read_text() + CONTROLLER)
    for seed in (1, 2):
        order = ["simulate", path / "arm.toml", "--duration", 10, "--seed", seed]
        do(*order, "-o", path / f"log{seed}.npz")
    with np.load(path / "log1.npz") as log:
        content = dict(log)
    rng = np.random.default_rng(0)
    content["q"] = content["q"] + 2e-4 * rng.normal(size=content["q"].shape)
    np.savez(path / "noisy.npz", **content)
    return path


@pytest.fixture(scope="module")
def estimate(folder):
    order = ["identify", folder / "arm.toml", folder / "log1.npz", *NAME]
    do(*order, "-o", folder / "estimate.json")
    return folder / "estimate.json"


def test_a_good_log_gives_the_truth_and_clears_wls(folder):
    logs = (folder / "log1.npz", folder / "log2.npz")
    answer = do("identify", folder / "arm.toml", *logs, *NAME)
    result = answer["result"]
    assert (result["estimator"], result["rows"]) == ("instrumental", "torque")
    assert not find_codes(answer) & {"identify.tracking", "identify.biased-wls", "identify.weak-instruments"}
    for entry in result["parameters"]:
        bound = 0.05 if entry["name"][0] == "F" or entry["name"].startswith("offset") else 0.02
        assert abs(entry["value"] - entry["truth"]) < bound * max(abs(entry["truth"]), 0.05)
        assert entry["std"] > 0.0
    told = result["settings"]["fit"]
    assert told["start"] == "instruments along the references"
    assert told["iterations"] == len(told["changes"]) <= 8
    assert told["instruments"]["correlation"] > 0.99
    assert told["wls"]["biased"] is False
    assert told["wls"]["freedom"][0] > 0
    assert set(told["wls"]["shifts"]) == {entry["name"] for entry in result["parameters"]}
    assert told["controller"]["stiffness"] == [400.0, 60.0]


def test_a_noisy_log_convicts_wls(capsys, folder):
    order = ("identify", folder / "arm.toml", folder / "noisy.npz", *HIGH)
    _, usual = ask(*order, "--estimator", "wls")
    answer = do(*order, *NAME)
    assert "identify.biased-wls" in find_codes(answer)
    assert answer["result"]["settings"]["fit"]["wls"]["biased"] is True
    found, biased = (
        {entry["name"]: entry for entry in result["result"]["parameters"]} for result in (answer, usual)
    )
    for name in ("ZZR1", "ZZ2"):
        truth = found[name]["truth"]
        assert abs(found[name]["value"] - truth) < 3.0 * found[name]["std"]
        assert abs(biased[name]["value"] - truth) > 5.0 * biased[name]["std"]
    capsys.readouterr()
    out = say(*(*order, *NAME))
    assert "instruments along the references" in out
    assert ": ZZ" in out


@pytest.mark.parametrize("estimator", ["instrumental", "output-error"])
def test_parameters_that_are_hardly_known_are_said_so(folder, tmp_path, estimator):
    with np.load(folder / "log1.npz") as log:
        content = dict(log)
    content["tau"] = content["tau"] + 3.0 * np.random.default_rng(1).normal(size=content["tau"].shape)
    np.savez(tmp_path / "loud.npz", **content)
    order = ("identify", folder / "arm.toml", tmp_path / "loud.npz", "--estimator", estimator)
    answer = do(*order, "--drop-first", "6000")
    vague = [
        entry["name"] for entry in answer["result"]["parameters"] if entry["std"] > 0.3 * abs(entry["value"])
    ]
    (told,) = (
        entry["text"] for entry in answer["warnings"] if entry["code"] == "identify.poorly-identifiable"
    )
    assert vague
    assert f" 30 %): {', '.join(vague)}." in told


def test_the_estimate_goes_on_to_validation_report_and_export(folder, estimate):
    arm, unseen = folder / "arm.toml", folder / "log2.npz"
    assert do("validate", arm, estimate, unseen)["result"]["mean_relative_percent"] < 5.0
    order = ("report", estimate, "--robot", arm, "--validation", unseen, "--diagnose")
    code, _ = ask(*order, "-o", folder / "report.html")
    assert code == 0
    assert "instrumental" in (folder / "report.html").read_text()
    code, _ = ask("export", arm, estimate, "-o", folder / "found.urdf", "--force")
    assert code == 0
    assert "<robot" in (folder / "found.urdf").read_text()


def test_an_estimate_is_a_start(folder, estimate):
    order = ("identify", folder / "arm.toml", folder / "log1.npz", *NAME, "--start", estimate)
    answer = do(*order)
    assert answer["result"]["settings"]["fit"]["start"].endswith("estimate.json")
    stored = {entry["name"]: entry for entry in json.loads(estimate.read_text())["parameters"]}
    for entry in answer["result"]["parameters"]:
        assert abs(entry["value"] - stored[entry["name"]]["value"]) < entry["std"]


def test_references_that_hardly_move_are_told_to_be_the_reason(folder, tmp_path):
    """The log moves, and the simulated robot, which follows its reference, does not."""
    with np.load(folder / "log1.npz") as log:
        content = dict(log)
    content["q_ref"] = content["q_ref"] * 1e-3
    content["dq_ref"] = content["dq_ref"] * 1e-3
    np.savez(tmp_path / "still.npz", **content)
    code, answer = ask("identify", folder / "arm.toml", tmp_path / "still.npz", *NAME)
    assert code not in (0, 1)
    assert find_codes(answer) == {"identify.blind-instruments", "identify.poor-log"}
    assert "q_ref" in answer["errors"][0]["text"]


def test_what_is_missing_is_told_at_once(folder, tmp_path):
    with np.load(folder / "log1.npz") as log:
        np.savez(tmp_path / "bare.npz", t=log["t"], q=log["q"], tau=log["tau"])
    code, answer = ask("identify", "two_link", tmp_path / "bare.npz", *NAME)
    assert code == 2
    assert find_codes(answer) == {"usage.controlled-robot"}
    assert "no reference position" in find_texts(answer)
    assert "[controller]" in find_texts(answer)


def test_a_robot_with_springs_is_refused(tmp_path):
    log = tmp_path / "log.npz"
    do("simulate", "two_link_elastic", "--duration", "2", "-o", log)
    with np.load(log) as made:
        np.savez(tmp_path / "one.npz", t=made["t"], q=made["theta"], tau=made["tau"], q_ref=made["theta"])
    gains = ("--set", "controller.stiffness=[400, 60]", "--set", "controller.damping=[25, 3]")
    code, answer = ask("identify", "two_link_elastic", tmp_path / "one.npz", *NAME, *gains)
    assert code == 2
    assert "rigid robots" in find_texts(answer)


@pytest.mark.parametrize("options", [(*NAME, "--rows", "momentum"), (*NAME, "--prior", "robot")])
def test_options_of_others_are_refused(folder, options):
    assert refuse("identify", folder / "arm.toml", folder / "log1.npz", *options) == (
        2,
        ["usage.mixed-options"],
    )
