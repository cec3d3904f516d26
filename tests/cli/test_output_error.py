"""Output error on the command line: from a simulated log to an estimate that goes on, and what is refused."""

import json

import numpy as np
import pytest

from symid.cli.main import run
from tests.calls import ask, do, fail, find_codes, find_texts, refuse, say

pytestmark = pytest.mark.usefixtures("shared_work")

CONTROLLER = """
[controller]
stiffness = [{stiffness}, 60]      # N m/rad
damping = [25, 3]                  # N m s/rad
velocity_filter = 150              # Hz
torque = "average"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory, robots_folder):
    """Return a folder with robot files that have a controller, the right one and a soft one, and logs."""
    path = tmp_path_factory.mktemp("output-error")
    text = (robots_folder / "two_link.toml").read_text()
    (path / "arm.toml").write_text(text + CONTROLLER.format(stiffness=400))
    (path / "soft.toml").write_text(text + CONTROLLER.format(stiffness=280))
    for seed in (1, 2):
        order = ["simulate", path / "arm.toml", "--duration", 5, "--seed", seed]
        do(*order, "-o", path / f"log{seed}.npz")
    order = ["simulate", path / "arm.toml", "--duration", 1, "-o", path / "short.npz", "-q"]
    assert run(list(map(str, order))) == 0
    return path


@pytest.fixture(scope="module")
def estimate(folder):
    order = ["identify", folder / "arm.toml", folder / "log1.npz", "--estimator", "output-error"]
    do(*order, "-o", folder / "estimate.json")
    return folder / "estimate.json"


def test_a_simulated_log_holds_the_reference(folder):
    with np.load(folder / "log1.npz") as log:
        assert {"q_ref", "dq_ref"} <= set(log)
        assert log["q_ref"].shape == log["q"].shape
    out = folder / "again.npz"
    _, answer = ask("simulate", folder / "arm.toml", "--duration", "1", "-o", out)
    assert answer["result"]["controller"]["stiffness"] == [400.0, 60.0]
    assert answer["result"]["controller"]["torque"] == "average"


def test_simulate_and_identify_give_the_truth_back(folder):
    logs = (folder / "log1.npz", folder / "log2.npz")
    answer = do("identify", folder / "arm.toml", *logs, "--estimator", "output-error")
    result = answer["result"]
    assert result["estimator"] == "output-error"
    assert not find_codes(answer) & {"identify.tracking"}
    for entry in result["parameters"]:
        bound = 0.03 if entry["name"][0] == "F" or entry["name"].startswith("offset") else 0.01
        assert abs(entry["value"] - entry["truth"]) < bound * max(abs(entry["truth"]), 0.05)
        assert entry["std"] > 0.0
    told = result["settings"]["fit"]
    assert told["start"] == "torque rows by wls"
    assert told["iterations"] == len(told["changes"]) <= 6
    assert told["changes"][-1] < 0.05
    assert told["controller"]["stiffness"] == [400.0, 60.0]
    assert told["controller"]["reference_velocity"] == "logged"
    assert told["controller"]["offset_from"] == "log"
    assert [entry["joint"] for entry in told["tracking"]] == [entry["joint"] for entry in result["residual"]]
    assert all(
        entry["simulated_from_measured"] < 0.01 * entry["reference_from_measured"]
        for entry in told["tracking"]
    )
    assert max(told["controller_residual_percent"]) < 2.0


def test_the_estimate_goes_on_to_validation_report_and_export(folder, estimate):
    arm, unseen = folder / "arm.toml", folder / "log2.npz"
    assert do("validate", arm, estimate, unseen)["result"]["mean_relative_percent"] < 5.0
    order = ("report", estimate, "--robot", arm, "--validation", unseen, "--diagnose")
    code, _ = ask(*order, "-o", folder / "report.html")
    assert code == 0
    assert "output-error" in (folder / "report.html").read_text()
    code, _ = ask("export", arm, estimate, "-o", folder / "found.urdf", "--force")
    assert code == 0
    assert "<robot" in (folder / "found.urdf").read_text()


def test_an_estimate_is_a_start(capsys, folder, estimate):
    arm, log = folder / "arm.toml", folder / "log1.npz"
    order = ("identify", arm, log, "--estimator", "output-error", "--start", estimate)
    answer = do(*order)
    assert answer["result"]["settings"]["fit"]["start"].endswith("estimate.json")
    assert answer["result"]["settings"]["fit"]["iterations"] <= 2
    capsys.readouterr()
    out = say(*order)
    assert " simulations of " in out or " 1 simulation of " in out
    assert out.count(" rad") >= 2


def test_gains_from_the_command_line_are_those_of_the_file(folder, estimate):
    order = ["identify", "two_link", folder / "log1.npz", "--estimator", "output-error"]
    keys = {"stiffness": "[400, 60]", "damping": "[25, 3]", "velocity_filter": "150", "torque": "average"}
    order += [part for key, value in keys.items() for part in ("--set", f"controller.{key}={value}")]
    answer = do(*order)
    stored = {entry["name"]: entry["value"] for entry in json.loads(estimate.read_text())["parameters"]}
    assert {entry["name"]: entry["value"] for entry in answer["result"]["parameters"]} == stored


def test_wrong_gains_are_noticed(folder):
    order = ("identify", folder / "soft.toml", folder / "log1.npz", "--estimator", "output-error")
    answer = do(*order)
    assert "identify.tracking" in find_codes(answer)
    assert "'shoulder' " in find_texts(answer)
    assert " of the torque " in find_texts(answer)


def test_what_is_missing_is_told_at_once(folder, tmp_path):
    with np.load(folder / "log1.npz") as log:
        np.savez(tmp_path / "bare.npz", t=log["t"], q=log["q"], tau=log["tau"])
    code, answer = ask("identify", "two_link", tmp_path / "bare.npz", "--estimator", "output-error")
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
    order = ("identify", "two_link_elastic", tmp_path / "one.npz", "--estimator", "output-error", *gains)
    code, answer = ask(*order)
    assert code == 2
    assert "rigid robots" in find_texts(answer)


def test_an_unstable_loop_is_told_in_words(folder):
    gains = ("--set", "controller.stiffness=[4e7, 6e6]")
    order = ("identify", folder / "arm.toml", folder / "short.npz", "--estimator", "output-error", *gains)
    code, answer = ask(*order)
    assert code not in (0, 1)
    assert find_codes(answer) & {"solver.start", "solver.runaway", "simulate.chatter"}


def test_friction_that_no_plant_holds_is_refused(folder, tmp_path):
    coupled = """
[[coupling]]
name = "m2"
terms = { shoulder = 1, elbow = 1 }
[coupling.friction]
model = "coulomb-viscous"
Fv = 0.2
Fc = 0.3
"""
    text = (folder / "arm.toml").read_text()
    names = [line.split('"')[1] for line in text.splitlines() if line.startswith("name = ")][1:]
    coupled = coupled.replace("shoulder", names[0]).replace("elbow", names[1])
    (tmp_path / "coupled.toml").write_text(text.replace("\n[controller]", coupled + "\n[controller]"))
    order = ("identify", tmp_path / "coupled.toml", folder / "log1.npz", "--estimator", "output-error")
    assert refuse(*order) == (2, ["usage.shared-friction"])


@pytest.mark.parametrize(
    "options",
    [
        ("--estimator", "wls", "--start", "x.json"),
        ("--estimator", "output-error", "--rows", "momentum"),
        ("--estimator", "output-error", "--prior", "robot"),
    ],
)
def test_options_of_others_are_refused(folder, options):
    assert refuse("identify", folder / "arm.toml", folder / "log1.npz", *options) == (
        2,
        ["usage.mixed-options"],
    )


def test_a_slip_in_the_name_is_met_with_the_name(folder):
    code, answer = ask("identify", folder / "arm.toml", folder / "log1.npz", "--estimator", "output_error")
    assert code == 2
    assert find_codes(answer) == {"usage.unknown-estimator"}
    assert "filtered-instrumental, output-error" in find_texts(answer)


def change_reference(folder, out, change):
    with np.load(folder / "log1.npz") as log:
        columns = {key: log[key] for key in log.files}
    for key in ("q_ref", "dq_ref"):
        columns[key] = change(columns[key])
    np.savez(out, **columns)
    return out


@pytest.mark.parametrize("estimator", ["output-error", "instrumental"])
def test_a_reference_in_degrees_is_refused(folder, tmp_path, estimator):
    log = change_reference(folder, tmp_path / "degrees.npz", np.rad2deg)
    code, answer = ask("identify", folder / "arm.toml", log, "--estimator", estimator)
    assert code == 2
    assert find_codes(answer) == {"usage.controlled-robot"}
    assert "[log.reference]" in find_texts(answer)


def test_a_reference_that_stands_still_is_told_as_the_cause(folder, tmp_path):
    log = change_reference(folder, tmp_path / "flat.npz", lambda column: 0.0 * column)
    assert fail("identify", folder / "arm.toml", log, "--estimator", "output-error") == (
        4,
        "identify.blind-simulation",
    )


@pytest.mark.parametrize("estimator", ["output-error", "instrumental"])
def test_a_loop_slower_than_the_log_is_refused(folder, estimator):
    order = ("identify", folder / "arm.toml", folder / "log1.npz", "--estimator", estimator)
    code, answer = ask(*order, "--set", "controller.stiffness=[400, 1e-9]")
    assert code == 2
    assert find_codes(answer) == {"usage.controlled-robot"}
    assert "[controller]" in find_texts(answer)


@pytest.mark.parametrize("estimator", ["output-error", "instrumental"])
def test_a_start_that_is_no_robot_is_named_as_the_cause(folder, estimate, tmp_path, estimator):
    start = json.loads(estimate.read_text())
    for entry in start["parameters"]:
        entry["value"] *= -1.0 if entry["name"].startswith("ZZ") else 1.0
    (tmp_path / "start.json").write_text(json.dumps(start))
    order = ("identify", folder / "arm.toml", folder / "log1.npz", "--estimator", estimator)
    code, answer = ask(*order, "--start", tmp_path / "start.json")
    assert code == 5
    assert find_codes(answer) == {"solver.start"}
    assert "--start" in find_texts(answer)
