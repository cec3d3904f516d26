"""Output error and instruments: from a simulated log to an estimate that goes on, and what is refused."""

import json

import numpy as np
import pytest

from tests.calls import ask, change_log, do, fail, find_codes, find_texts, hear, refuse, say

pytestmark = pytest.mark.usefixtures("shared_work")

CONTROLLER = """
[controller]
stiffness = [{stiffness}, 60]      # N m/rad
damping = [25, 3]                  # N m s/rad
velocity_filter = 150              # Hz
torque = "average"
"""
LENGTHS = {"output-error": 5, "instrumental": 10}
OUTPUT, INSTRUMENTS = (("--estimator", name) for name in LENGTHS)
HIGH = ("--set", "processing.filter_cutoff=60", "--set", "processing.decimation.factor=5")
GAINS = ("--set", "controller.stiffness=[400, 60]", "--set", "controller.damping=[25, 3]")
both = pytest.mark.parametrize("estimator", LENGTHS)


@pytest.fixture(scope="module")
def folder(tmp_path_factory, robots_folder):
    """Return a folder with robot files that have a controller, the right one and a soft one, and logs."""
    path = tmp_path_factory.mktemp("controlled")
    text = (robots_folder / "two_link.toml").read_text()
    (path / "arm.toml").write_text(text + CONTROLLER.format(stiffness=400))
    (path / "soft.toml").write_text(text + CONTROLLER.format(stiffness=280))
    for name, length in LENGTHS.items():
        for seed in (1, 2):
            order = ("--duration", length, "--seed", seed, "-o", path / f"{name}{seed}.npz")
            do("simulate", path / "arm.toml", *order)
    do("simulate", path / "arm.toml", "--duration", 1, "-o", path / "short.npz")
    return path


@pytest.fixture(scope="module")
def logs(folder):
    """Return the two logs for each estimator."""
    return {name: [folder / f"{name}{seed}.npz" for seed in (1, 2)] for name in LENGTHS}


@pytest.fixture(scope="module")
def estimates(folder, logs):
    """Return the estimate of the first log by each estimator."""
    for name in LENGTHS:
        order = ("identify", folder / "arm.toml", logs[name][0], "--estimator", name)
        do(*order, "-o", folder / f"{name}.json")
    return {name: folder / f"{name}.json" for name in LENGTHS}


def assert_true(result, plain, rubbing):
    """The parameters are those of the robot file: to parts of their size, friction to others."""
    for entry in result["parameters"]:
        bound = rubbing if entry["name"][0] == "F" or entry["name"].startswith("offset") else plain
        assert abs(entry["value"] - entry["truth"]) < bound * max(abs(entry["truth"]), 0.05)
        assert entry["std"] > 0.0


def test_a_simulated_log_holds_the_reference(folder, logs):
    with np.load(logs["output-error"][0]) as log:
        assert {"q_ref", "dq_ref"} <= set(log)
        assert log["q_ref"].shape == log["q"].shape
    answer = do("simulate", folder / "arm.toml", "--duration", "1", "-o", folder / "again.npz")
    assert answer["result"]["controller"]["stiffness"] == [400.0, 60.0]
    assert answer["result"]["controller"]["torque"] == "average"


def test_output_error_gives_the_truth_back(folder, logs):
    answer = do("identify", folder / "arm.toml", *logs["output-error"], *OUTPUT)
    result = answer["result"]
    assert result["estimator"] == "output-error"
    assert not find_codes(answer) & {"identify.tracking"}
    assert_true(result, 0.01, 0.03)
    told = result["settings"]["fit"]
    assert told["start"] == "torque equations by wls"
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


def test_instruments_give_the_truth_and_clear_wls(folder, logs):
    answer = do("identify", folder / "arm.toml", *logs["instrumental"], *INSTRUMENTS)
    result = answer["result"]
    assert (result["estimator"], result["rows"]) == ("instrumental", "torque")
    assert not find_codes(answer) & {"identify.tracking", "identify.biased-wls", "identify.weak-instruments"}
    assert_true(result, 0.02, 0.05)
    told = result["settings"]["fit"]
    assert told["start"] == "instruments along the references"
    assert told["iterations"] == len(told["changes"]) <= 8
    assert told["instruments"]["correlation"] > 0.99
    assert told["wls"]["biased"] is False
    assert told["wls"]["freedom"][0] > 0
    assert set(told["wls"]["shifts"]) == {entry["name"] for entry in result["parameters"]}
    assert told["controller"]["stiffness"] == [400.0, 60.0]


def test_a_noisy_log_convicts_wls(folder, logs, tmp_path):
    rng = np.random.default_rng(0)
    log = change_log(
        logs["instrumental"][0], tmp_path / "noisy.npz", q=lambda q: q + 2e-4 * rng.normal(size=q.shape)
    )
    order = ("identify", folder / "arm.toml", log, *HIGH)
    _, usual = ask(*order, "--estimator", "wls")
    answer = do(*order, *INSTRUMENTS)
    assert "identify.biased-wls" in find_codes(answer)
    assert answer["result"]["settings"]["fit"]["wls"]["biased"] is True
    found, biased = (
        {entry["name"]: entry for entry in result["result"]["parameters"]} for result in (answer, usual)
    )
    for name in ("ZZR1", "ZZ2"):
        truth = found[name]["truth"]
        assert abs(found[name]["value"] - truth) < 3.0 * found[name]["std"]
        assert abs(biased[name]["value"] - truth) > 5.0 * biased[name]["std"]
    out = say(*order, *INSTRUMENTS)
    assert "instruments along the references" in out
    assert ": ZZ" in out


@both
def test_parameters_that_are_hardly_known_are_said_so(folder, logs, tmp_path, estimator):
    rng = np.random.default_rng(1)
    log = change_log(
        logs["instrumental"][0], tmp_path / "loud.npz", tau=lambda tau: tau + 3.0 * rng.normal(size=tau.shape)
    )
    answer = do("identify", folder / "arm.toml", log, "--estimator", estimator, "--drop-first", "6000")
    vague = [
        entry["name"] for entry in answer["result"]["parameters"] if entry["std"] > 0.3 * abs(entry["value"])
    ]
    assert vague
    assert f" 30 %): {', '.join(vague)}." in find_texts(answer, "identify.poorly-identifiable")


@both
def test_the_estimate_goes_on_to_validation_report_and_export(folder, logs, estimates, estimator):
    arm, unseen, found = folder / "arm.toml", logs[estimator][1], estimates[estimator]
    assert do("validate", arm, found, unseen)["result"]["mean_relative_percent"] < 5.0
    order = ("report", found, "--robot", arm, "--validation", unseen, "--diagnose")
    do(*order, "-o", folder / f"{estimator}.html")
    assert estimator in (folder / f"{estimator}.html").read_text()
    do("export", arm, found, "-o", folder / f"{estimator}.urdf")
    assert "<robot" in (folder / f"{estimator}.urdf").read_text()


@both
def test_an_estimate_is_a_start(folder, logs, estimates, estimator):
    found = estimates[estimator]
    order = (
        *("identify", folder / "arm.toml", logs[estimator][0]),
        *("--estimator", estimator, "--start", found),
    )
    result = do(*order)["result"]
    assert result["settings"]["fit"]["start"].endswith(found.name)
    stored = {entry["name"]: entry for entry in json.loads(found.read_text())["parameters"]}
    for entry in result["parameters"]:
        assert abs(entry["value"] - stored[entry["name"]]["value"]) < entry["std"]
    if estimator == "output-error":
        assert result["settings"]["fit"]["iterations"] <= 2
        out = say(*order)
        assert " simulations of " in out or " 1 simulation of " in out
        assert out.count(" rad") >= 2


def test_gains_from_the_command_line_are_those_of_the_file(logs, estimates):
    gains = (
        part for key in ('torque="average"', "velocity_filter=150") for part in ("--set", f"controller.{key}")
    )
    answer = do("identify", "two_link", logs["output-error"][0], *OUTPUT, *GAINS, *gains)
    stored = json.loads(estimates["output-error"].read_text())["parameters"]
    assert [(entry["name"], entry["value"]) for entry in answer["result"]["parameters"]] == [
        (entry["name"], entry["value"]) for entry in stored
    ]


def test_wrong_gains_are_noticed(folder, logs):
    text = find_texts(
        do("identify", folder / "soft.toml", logs["output-error"][0], *OUTPUT), "identify.tracking"
    )
    assert "'shoulder' " in text
    assert " of the torque " in text


@both
def test_what_is_missing_is_told_at_once(logs, tmp_path, estimator):
    log = change_log(logs[estimator][0], tmp_path / "bare.npz", only=("t", "q", "tau"))
    code, answer = ask("identify", "two_link", log, "--estimator", estimator)
    assert (code, find_codes(answer)) == (2, {"usage.controlled-robot"})
    text = find_texts(answer)
    assert "no reference position" in text
    assert "[controller]" in text


@both
def test_a_robot_with_springs_is_refused(tmp_path, estimator):
    log = tmp_path / "log.npz"
    do("simulate", "two_link_elastic", "--duration", "2", "-o", log)
    with np.load(log) as made:
        np.savez(tmp_path / "one.npz", t=made["t"], q=made["theta"], tau=made["tau"], q_ref=made["theta"])
    order = ("identify", "two_link_elastic", tmp_path / "one.npz", "--estimator", estimator, *GAINS)
    code, answer = ask(*order)
    assert (code, "rigid robots" in find_texts(answer)) == (2, True)


def test_an_unstable_loop_is_told_in_words(folder):
    gains = ("--set", "controller.stiffness=[4e7, 6e6]")
    code, answer = ask("identify", folder / "arm.toml", folder / "short.npz", *OUTPUT, *gains)
    assert code not in (0, 1)
    assert find_codes(answer) & {"solver.start", "solver.runaway", "simulate.chatter"}


def test_friction_that_no_plant_holds_is_refused(folder, logs, tmp_path):
    coupled = '[[coupling]]\nname = "m2"\nterms = { shoulder = 1, elbow = 1 }\n[coupling.friction]\n'
    coupled += 'model = "coulomb-viscous"\nFv = 0.2\nFc = 0.3\n\n[controller]'
    path = tmp_path / "coupled.toml"
    path.write_text((folder / "arm.toml").read_text().replace("[controller]", coupled))
    assert refuse("identify", path, logs["output-error"][0], *OUTPUT) == (2, ["usage.shared-friction"])


@pytest.mark.parametrize(
    "options",
    [
        ("--estimator", "wls", "--start", "x.json"),
        (*OUTPUT, "--rows", "momentum"),
        (*OUTPUT, "--prior", "robot"),
        (*INSTRUMENTS, "--rows", "momentum"),
        (*INSTRUMENTS, "--prior", "robot"),
    ],
)
def test_options_of_others_are_refused(folder, logs, options):
    order = ("identify", folder / "arm.toml", logs["output-error"][0], *options)
    assert refuse(*order) == (2, ["usage.mixed-options"])


@both
def test_a_reference_in_degrees_is_refused(folder, logs, tmp_path, estimator):
    degrees = {"q_ref": np.rad2deg, "dq_ref": np.rad2deg}
    log = change_log(logs["output-error"][0], tmp_path / "degrees.npz", **degrees)
    order = ("identify", folder / "arm.toml", log, "--estimator", estimator)
    assert "[log.reference]" in hear(2, "usage.controlled-robot", *order)


def test_references_that_hardly_move_are_told_to_be_the_reason(folder, logs, tmp_path):
    """The log moves, and the simulated robot, which follows its reference, does not."""
    still, flat = tmp_path / "still.npz", tmp_path / "flat.npz"
    change_log(logs["instrumental"][0], still, q_ref=lambda q: 1e-3 * q, dq_ref=lambda q: 1e-3 * q)
    code, answer = ask("identify", folder / "arm.toml", still, *INSTRUMENTS)
    assert code not in (0, 1)
    assert find_codes(answer) == {"identify.blind-instruments", "identify.poor-log"}
    assert "q_ref" in answer["errors"][0]["text"]
    change_log(logs["output-error"][0], flat, q_ref=np.zeros_like, dq_ref=np.zeros_like)
    assert fail("identify", folder / "arm.toml", flat, *OUTPUT) == (4, "identify.blind-simulation")


@both
def test_a_loop_slower_than_the_log_is_refused(folder, logs, estimator):
    order = ("identify", folder / "arm.toml", logs["output-error"][0], "--estimator", estimator)
    slow = ("--set", "controller.stiffness=[400, 1e-9]")
    assert "[controller]" in hear(2, "usage.controlled-robot", *order, *slow)


@both
def test_a_start_that_is_no_robot_is_named_as_the_cause(folder, logs, estimates, tmp_path, estimator):
    start = json.loads(estimates["output-error"].read_text())
    for entry in start["parameters"]:
        entry["value"] *= -1.0 if entry["name"].startswith("ZZ") else 1.0
    (tmp_path / "start.json").write_text(json.dumps(start))
    order = ("identify", folder / "arm.toml", logs["output-error"][0], "--estimator", estimator)
    assert "--start" in hear(5, "solver.start", *order, "--start", tmp_path / "start.json")
