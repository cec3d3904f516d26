"""Identified friction as a robot file, and on logs that were not fitted, as a user calls them."""

import json

import numpy as np
import pytest

from symid.codegen.cache import prepare_library
from symid.joint_models.friction_catalogue import get_law
from symid.joint_models.friction_law import compute_friction_torque
from symid.robot.loading import load_robot
from symid.robot.toml_reader import read_robot
from tests.calls import ask, call, do, find_codes, find_texts, refuse, say
from tests.cli.test_identify_friction import (
    AXIS_LAW,
    EMPS_LAW,
    LAW,
    PLAIN_PROCESSING,
    arm_logs,
    axis_log,
    save,
    save_axis,
)
from tests.unit.identification.friction.cosine_rigs import record

__all__ = ["arm_logs", "axis_log"]


@pytest.fixture
def identify(axis_log, tmp_path):
    """Return a function that identifies friction of the axis by a law, and where the result is."""

    def run(model, *options):
        path = tmp_path / f"{model}.json"
        do("identify", "emps", axis_log, *AXIS_LAW, "--model", model, *options, "-o", path)
        return path

    return run


@pytest.fixture
def other_log(tmp_path):
    """Return another motion of the axis of `axis_log`."""
    time = np.arange(4000) * 4e-3
    v = 0.09 * np.sin(2.0 * np.pi * 0.35 * time) * np.cos(2.0 * np.pi * 0.03 * time)
    friction = (20.0 + 8.0 * np.exp(-((v / 0.008) ** 2))) * np.sign(v) + 200.0 * v - 3.0
    return save_axis(tmp_path / "other.npz", v, friction)


def change(path, **entries):
    """Write a result with other entries at its first joint's estimate, or in the settings."""
    data = json.loads(path.read_text())
    for name, value in entries.items():
        place = data["settings"] if name in data["settings"] else data["joints"][0]["estimate"]
        place[name] = value
    path.write_text(json.dumps(data))
    return path


def test_the_robot_file_has_the_torque_of_the_law(identify, tmp_path):
    result, file = identify("stribeck+offset", "--smoothing", "0.001"), tmp_path / "robot.toml"
    answer = do("export", "emps", result, "-o", file)
    written = answer["result"]["written"]["axis"]
    assert (written["law"], written["model"]) == ("stribeck+offset", "stribeck+offset")
    assert answer["result"]["kept"] == {}
    robot = read_robot(file)
    friction = robot.joints[0].friction
    assert friction.smoothing == 0.001
    assert robot.source.startswith("Friction identified from axis.npz; before: ")
    estimate = json.loads(result.read_text())["joints"][0]["estimate"]
    values = {entry["name"]: entry["value"] for entry in estimate["parameters"]}
    assert written["values"]["Fe"] == pytest.approx(values["fS"] - values["fC"], abs=1e-12)
    library = prepare_library(robot, backend="python")
    velocity = np.linspace(-0.2, 0.2, 801)
    (columns,) = library.evaluate("friction_regressor", velocity[:, None])
    law = get_law("stribeck+offset", smoothing=0.001)
    expected = compute_friction_torque(law, {"velocity": velocity}, estimate["linear"], estimate["shape"])
    torque = columns[:, 0] @ np.array(friction.values)
    assert np.max(np.abs(torque - expected)) <= 1e-12 * np.max(np.abs(expected))
    code, out, _ = call("export", "emps", result, "-o", file, "--force")
    assert (code, "axis: stribeck+offset" in out) == (0, True)
    do("check", file)


@pytest.mark.parametrize("model", ["coulomb", "tustin", "lorentzian", "cubic+offset", "position-torque-1"])
def test_any_law_becomes_part_of_the_robot_file(identify, tmp_path, model):
    result, file = identify(model), tmp_path / "robot.toml"
    answer = do("export", "emps", result, "-o", file)
    written = answer["result"]["written"]["axis"]
    assert (written["law"], written["model"], answer["result"]["kept"]) == (model, model, {})
    assert "export.friction-kept" not in find_codes(answer)
    estimate = json.loads(result.read_text())["joints"][0]["estimate"]
    friction = read_robot(file).joints[0].friction
    assert friction.law == model
    assert list(friction.values) == list(written["values"].values()) == estimate["linear"]
    assert list(friction.shape) == list(written["shape"].values()) == estimate["shape"]
    do("check", file)


def test_refused_parameters_keep_the_files_friction(identify, tmp_path):
    result = identify("stribeck+offset", "--set", "processing.standstill=0.05")
    answer = do("export", "emps", result, "-o", tmp_path / "robot.toml")
    reason = answer["result"]["kept"]["axis"]
    assert "fS was refused" in reason
    assert "vs was refused" in reason
    assert answer["result"]["written"] == {}
    assert "'axis'" in find_texts(answer, "export.friction-kept")
    before = load_robot("emps").joints[0].friction
    assert read_robot(tmp_path / "robot.toml").joints[0].friction == before


def test_what_drives_the_joint_is_told_of_the_written_file(identify, tmp_path):
    result = change(identify("coulomb-viscous-offset"), linear=[-5.0, 20.0, 1.0])
    answer = do("export", "emps", result, "-o", tmp_path / "robot.toml")
    assert "robot.negative-friction" in find_codes(answer)
    (warning,) = (entry for entry in answer["warnings"] if entry["code"] == "robot.negative-friction")
    assert warning["file"] == str(tmp_path / "robot.toml")


def test_an_arm_keeps_what_did_not_move(arm_logs, tmp_path):
    result, file = tmp_path / "friction.json", tmp_path / "arm.toml"
    arguments = ("identify", "two_link", *arm_logs[:2], *LAW, "--model", "stribeck+offset")
    ask(*arguments, *PLAIN_PROCESSING, "--friction", "coulomb-viscous", "-o", result)
    answer = do("export", "two_link", result, "-o", file)
    assert list(answer["result"]["written"]) == ["shoulder"]
    assert "'elbow'" in answer["result"]["kept"]["elbow"]
    log = save(tmp_path / "other.npz", record(0.6, seed=8))
    answer = do("validate", "two_link", result, log)
    (residual,) = answer["result"]["residual"]
    assert (residual["joint"], answer["result"]["laws"]) == ("shoulder", {"shoulder": "stribeck+offset"})
    assert residual["std"] == pytest.approx(0.05, rel=0.05)
    assert "validate.friction-pose" in find_codes(answer)


def test_dynamics_and_friction_become_one_file(arm_logs, tmp_path):
    names = ("estimate.json", "friction.json", "dynamics.toml", "identified.toml")
    estimate, result, dynamics, identified = (tmp_path / name for name in names)
    ask("identify", "two_link", *arm_logs, *PLAIN_PROCESSING, "--partial", "-o", estimate)
    ask("identify", "two_link", *arm_logs[:2], *LAW, "--model", "asymmetric", *PLAIN_PROCESSING, "-o", result)
    do("export", "two_link", estimate, "-o", dynamics)
    assert list(do("export", dynamics, result, "-o", identified)["result"]["written"]) == ["shoulder"]
    before, after = read_robot(dynamics), read_robot(identified)
    assert after.joints[0].friction.law == "asymmetric"
    assert after.joints[1] == before.joints[1]
    assert after.joints[0].inertial == before.joints[0].inertial


def test_springs_are_told_to_lose_energy_twice(arm_logs, tmp_path):
    result = tmp_path / "friction.json"
    arguments = ("identify", "two_link_elastic", arm_logs[1], *LAW, "--model", "coulomb-viscous-offset")
    ask(*arguments, "-o", result)
    answer = do("export", "two_link_elastic", result, "-o", tmp_path / "x.toml")
    assert "export.friction-springs" in find_codes(answer)


def test_another_log_is_foretold(identify, axis_log, other_log):
    result = identify("stribeck+offset")
    answer = do("validate", "emps", result, other_log)
    assert answer["result"]["accepted"]
    (residual,) = answer["result"]["residual"]
    assert residual["relative_percent"] == pytest.approx(answer["result"]["mean_relative_percent"])
    assert residual["unit"] == "N"
    out = say("validate", "emps", result, other_log)
    assert f"mean relative residual {residual['relative_percent']:.4f} %" in out
    assert "RMS" in out
    assert "validate.fitted-log" in find_codes(do("validate", "emps", result, axis_log))


def test_processing_of_the_fit_is_followed_and_may_be_set(identify, other_log):
    result = identify("coulomb-viscous-offset")
    answer = do("validate", "emps", result, other_log)
    # The identification was in the published band, without its decimation; the robot file states neither.
    assert "estimate.settings-differ" in find_codes(answer)
    samples = answer["result"]["samples"]
    arguments = ("validate", "emps", result, other_log, "--set", "processing.decimation.factor=10")
    assert samples == pytest.approx(10 * ask(*arguments)[1]["result"]["samples"], abs=20)


def test_mean_periods_are_not_asked_of_another_log(other_log, tmp_path):
    time = np.arange(5000) * 4e-3
    v = 0.1 * np.sin(2.0 * np.pi * 0.5 * time)
    log, result = tmp_path / "cosine.npz", tmp_path / "friction.json"
    save_axis(log, v, 20.0 * np.sign(v) + 200.0 * v - 3.0)
    arguments = ("identify", "emps", log, *AXIS_LAW, "--model", "coulomb-viscous-offset", "--period", "2")
    do(*arguments, "-o", result)
    answer = do("validate", "emps", result, other_log)
    assert "validate.not-folded" in find_codes(answer)
    # 49 samples are cut off at the start, as published, and none at the end.
    assert answer["result"]["samples"] >= 4000 - 49 - 10


def test_known_base_parameters_are_kept_with_the_friction(arm_logs, tmp_path):
    estimate, result = tmp_path / "estimate.json", tmp_path / "friction.json"
    ask("identify", "two_link", *arm_logs, *PLAIN_PROCESSING, "--partial", "-o", estimate)
    arguments = ("identify", "two_link", *arm_logs[:2], *LAW, "--model", "stribeck+offset")
    ask(*arguments, *PLAIN_PROCESSING, "--known", estimate, "-o", result)
    estimate.unlink()
    log = save(tmp_path / "other.npz", record(0.6, seed=8))
    answer = do("validate", "two_link", result, log)
    assert answer["result"]["residual"][0]["std"] == pytest.approx(0.05, rel=0.1)
    assert refuse("validate", "two_link", change(result, known_values={"ZZR1": 1.0}), log) == (
        3,
        ["estimate.settings"],
    )


def test_files_of_another_kind_say_what_they_are(identify, axis_log, tmp_path):
    result = identify("coulomb-viscous-offset")
    code, answer = ask("identify", "emps", axis_log, *AXIS_LAW, "--known", result)
    (error,) = answer["errors"]
    assert (code, error["code"]) == (3, "estimate.friction")
    log = save(tmp_path / "arm.npz", record(1.0))
    for arguments in (
        ("export", "two_link", result, "-o", tmp_path / "x.toml"),
        ("validate", "two_link", result, log),
    ):
        code, answer = ask(*arguments)
        (error,) = answer["errors"]
        assert (code, error["code"]) == (3, "estimate.signature")
        assert error["text"].index("'emps'") < error["text"].index("'two_link'")
        assert error["file"] == str(result)
    assert refuse("validate", "emps", result, axis_log, "--tracking") == (2, ["usage.rigid-tracking"])
    assert refuse("export", "emps", result, "-o", tmp_path / "x.json") == (2, ["usage.suffix"])
    assert json.loads(result.read_text())["kind"] == "friction"


@pytest.mark.parametrize(("model", "percent"), [("asymmetric", 5.3649), ("coulomb-viscous-offset", 5.9824)])
def test_emps_foretells_its_pulses(shared_data, tmp_path, model, percent):
    folder, result = shared_data / "emps", tmp_path / "friction.json"
    log = folder / "DATA_EMPS.mat"
    ask("identify", "emps", log, *EMPS_LAW, "--model", model, "-o", result)
    pulses = folder / "DATA_EMPS_PULSES.mat"
    code, out, _ = call("validate", "emps", result, pulses, "--gate", "5.5")
    assert f"mean relative residual {percent:.4f} %" in out
    assert code == (0 if percent < 5.5 else 1)
    answer = do("validate", "emps", result, pulses)
    assert answer["result"]["mean_relative_percent"] == pytest.approx(percent, abs=5.1e-5)
