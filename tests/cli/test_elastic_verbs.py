"""An elastic robot by the verbs alone: simulate, identify, validate, export, generate, simulate again."""

import json
import re

import numpy as np
import pytest

from symid.dynamics.base_parameters import compute_parameter_values, derive_base_parameters
from symid.identification.stored import read_fit
from symid.robot.toml_reader import read_robot
from tests.calls import ask, change_json, do, fail, find_codes, find_texts, hear, list_codes, say

ROBOT = "two_link_elastic"
SHORT = ("--duration", "6")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with logs of three motions, and estimates by two methods."""
    folder = tmp_path_factory.mktemp("elastic")
    for name, scale in (("ta", 10), ("tb", 1), ("tc", 1)):
        motion = ("--trajectory", name, "--scale", scale, *SHORT)
        do("simulate", ROBOT, *motion, "-o", folder / f"{name}.npz")
    logs = (folder / "ta.npz", folder / "tb.npz")
    for name, options in (("estimate", ("nlp",)), ("linear", ("two-step", "--thresholds", 0, "--knees", 0))):
        do("identify", ROBOT, *logs, "--method", *options, "-o", folder / f"{name}.json")
    return folder


@pytest.fixture(scope="module")
def estimate(folder):
    return folder / "estimate.json"


@pytest.fixture(scope="module")
def exported(folder, estimate):
    path = folder / "identified.toml"
    do("export", ROBOT, estimate, "-o", path)
    return path


@pytest.fixture(scope="module")
def motor_side(folder):
    """Return an estimate, and a log of another motion, with the positions of the motors alone."""
    for name in ("ta", "tc"):
        with np.load(folder / f"{name}.npz") as log:
            np.savez(folder / f"motor_{name}.npz", t=log["t"], q=log["theta"], tau=log["tau"])
    found = folder / "motor.json"
    do("identify", ROBOT, folder / "motor_ta.npz", "-o", found)
    return found, folder / "motor_tc.npz"


def change(path, target, **changes):
    """Write the estimate at `path` to `target` with other entries, and return that."""
    return change_json(path, lambda data: data.update(changes), target)


def read(path, key):
    """Return an entry of the estimate at `path`."""
    return json.loads(path.read_text(encoding="utf-8"))[key]


def test_validate_predicts_an_unseen_log(folder, estimate):
    answer = do("validate", ROBOT, estimate, folder / "tc.npz", "--gate", "2")
    result = answer["result"]
    assert result["accepted"]
    assert result["mean_relative_percent"] < 2.0
    first = result["residual"]
    assert [entry["joint"] for entry in first] == ["shoulder", "elbow"]
    mean = np.mean([entry["relative_percent"] for entry in first])
    assert result["mean_relative_percent"] == pytest.approx(mean)
    assert len(result["tables"]) == 3
    assert result["tables"][0]["residual"] == first
    assert result["tracking"] is None
    assert "validate.fitted-log" not in find_codes(answer)


def test_the_gate_is_missed_by_wrong_springs_too(folder, estimate, tmp_path):
    springs = read(estimate, "springs")
    for spring in springs:
        spring["elasticity"]["stiffness"] *= 1.3
    wrong = change(estimate, tmp_path / "wrong.json", springs=springs)
    right = do("validate", ROBOT, estimate, folder / "tc.npz", "--gate", "2")
    means = [table["mean_relative_percent"] for table in right["result"]["tables"]]
    assert max(means) < 2.0
    code, answer = ask("validate", ROBOT, wrong, folder / "tc.npz", "--gate", "2")
    assert code == 1
    assert not answer["result"]["accepted"]
    assert answer["result"]["mean_relative_percent"] == pytest.approx(means[0])
    assert list_codes(answer, "errors") == ["validate.gate-missed"] * 2
    caption = answer["result"]["tables"][2]["caption"].split(":")[0]
    assert answer["errors"][1]["text"].startswith(caption)
    assert min(table["mean_relative_percent"] for table in answer["result"]["tables"][1:]) > 5.0


def test_settings_of_signals_are_followed_or_refused(folder, estimate, tmp_path):
    call = ("validate", ROBOT, estimate, folder / "tc.npz")
    plain = do(*call)
    ends = ("--set", "processing.drop_first=1000", "--set", "processing.filter_cutoff=8")
    answer = do(*call, *ends)
    assert answer["result"]["samples"] < plain["result"]["samples"] - 500
    assert "log.cut" in find_codes(answer)
    report = ("report", estimate, "--validation", folder / "tc.npz", "-o", tmp_path / "page.html")
    assert "log.cut" in find_codes(do(*report, *ends))
    for verb in (call, (*report, "--force")):
        assert fail(*verb, "--set", "processing.decimation.factor=2") == (2, "usage.elastic-processing")


def test_a_report_without_logs_refuses_what_is_of_logs(estimate, tmp_path):
    page, options = tmp_path / "page.html", ("--set", "processing.drop_first=3")
    assert options[0] in hear(2, "usage.no-validation", "report", estimate, "-o", page, *options)
    assert not page.exists()


def test_validate_takes_delay_and_offset_out_as_the_identification_does(folder, estimate, tmp_path):
    log = tmp_path / "late.npz"
    motion = ("--trajectory", "tc", "--clean", "--delay", "0.003", "--offset", "0.002")
    do("simulate", ROBOT, *motion, "--duration", "8", "-o", log)
    answer = do("validate", ROBOT, estimate, log)
    assert answer["result"]["alignment"]["delay_ms"] == pytest.approx(3.0, abs=0.3)
    assert answer["result"]["mean_relative_percent"] < 3.0


def test_validate_says_what_is_no_test(folder, estimate, tmp_path):
    assert "validate.fitted-log" in find_codes(ask("validate", ROBOT, estimate, folder / "ta.npz")[1])
    springs = read(estimate, "springs")
    springs = [spring | {"torsion": 1e-3} for spring in springs]
    timid = change(estimate, tmp_path / "timid.json", springs=springs)
    answer = do("validate", ROBOT, timid, folder / "tc.npz")
    told = find_texts(answer, "validate.beyond-torsion")
    assert "shoulder" in told
    assert "0.001 rad" in told


def test_an_estimate_without_springs_says_nothing_of_them(folder, estimate, tmp_path):
    bare = change(estimate, tmp_path / "bare.json", springs=[])
    assert len(do("validate", ROBOT, bare, folder / "tc.npz")["result"]["tables"]) == 1
    assert fail("validate", ROBOT, bare, folder / "tc.npz", "--tracking") == (2, "usage.no-springs")
    answer = do("export", ROBOT, bare, "-o", tmp_path / "bare.toml")
    assert answer["result"]["not_identified"] == ["the spring of 'shoulder'", "the spring of 'elbow'"]


def test_a_spring_that_was_refused_is_not_tried(folder, estimate, tmp_path):
    springs = read(estimate, "springs")
    springs[1] |= {"identifiable": False, "reason": "for the test", "torsion": 1e-4}
    part = change(estimate, tmp_path / "part.json", springs=springs)
    answer = do("validate", ROBOT, part, folder / "tc.npz")
    tables = answer["result"]["tables"]
    assert [len(table["residual"]) for table in tables] == [2, 1, 1]
    assert "validate.beyond-torsion" not in find_codes(answer)
    out = say("validate", ROBOT, part, folder / "tc.npz")
    assert re.search(r"\bno\b.* spring .*\belbow\b", out)
    assert fail("validate", ROBOT, part, folder / "tc.npz", "--tracking") == (2, "usage.no-springs")
    page = tmp_path / "page.html"
    do("report", part, "--validation", folder / "tc.npz", "-o", page)


def test_tracking_with_the_springs_is_better_than_without(folder, estimate):
    other = ("--tracking", "--against", folder / "linear.json")
    tracking = do("validate", ROBOT, estimate, folder / "tc.npz", *other)["result"]["tracking"]
    assert tracking["seed"] is None
    assert tracking["trajectory"].startswith("TC")
    rigid, first, second = tracking["runs"]
    assert first["feed_forward"] == "Case 1: nlp"
    assert second["method"] == "two-step"
    for index, joint in enumerate(("shoulder", "elbow")):
        errors = [entry["joints"][index] for entry in (rigid, first, second)]
        assert [entry["joint"] for entry in errors] == [joint] * 3
        assert all(0.0 < entry["rms"] <= entry["peak"] for entry in errors)
        assert errors[1]["rms"] < 0.1 * errors[0]["rms"]
        assert errors[1]["rms"] < errors[2]["rms"]


def test_tracking_of_a_random_motion_as_a_table(folder, estimate):
    log = str(folder / "tc.npz")
    out = say("validate", ROBOT, estimate, log, "--tracking", "--seed", "3")
    rows = [line.split() for line in out.splitlines() if line.endswith("mrad")]
    assert [row[0] for row in rows] == ["shoulder", "shoulder", "elbow", "elbow"]
    assert [row[1] for row in rows] == ["rigid", "Case"] * 2


@pytest.mark.parametrize(
    ("options", "code"),
    [(("--seed", "2"), "usage.no-tracking"), (("--against", "other.json"), "usage.no-tracking")],
)
def test_options_of_tracking_alone_are_refused(folder, estimate, options, code):
    assert fail("validate", ROBOT, estimate, folder / "tc.npz", *options) == (2, code)


def test_estimates_of_other_models_are_refused(folder, estimate, motor_side, tmp_path):
    parameters = read(estimate, "parameters")
    other = change(estimate, tmp_path / "other.json", signature="0" * 64)
    fewer = change(estimate, tmp_path / "fewer.json", parameters=parameters[1:], covariance=[])
    log = folder / "tc.npz"
    for path, code in ((other, "estimate.signature"), (fewer, "estimate.parameters")):
        for arguments in (
            ("validate", ROBOT, path, log),
            ("validate", ROBOT, estimate, log, "--tracking", "--against", path),
            ("export", ROBOT, path, "-o", tmp_path / "x.toml"),
        ):
            assert fail(*arguments) == (3, code)
    assert not (tmp_path / "x.toml").exists()
    assert fail("validate", ROBOT, estimate, motor_side[1]) == (3, "elastic.one-encoder")


def test_a_friction_of_the_command_line_is_remembered(folder, tmp_path):
    found = tmp_path / "offset.json"
    friction = ("--friction", "coulomb-viscous-offset", "--method", "two-step")
    do("identify", ROBOT, folder / "ta.npz", *friction, "-o", found)
    assert read_fit(found).friction == ("coulomb-viscous-offset",) * 2
    assert do("validate", ROBOT, found, folder / "tc.npz")["result"]["mean_relative_percent"] < 5.0
    assert fail("validate", ROBOT, found, folder / "tc.npz", "--tracking") == (3, "robot.no-values")


def test_the_exported_robot_has_what_was_identified(estimate, exported):
    found = read_fit(estimate)
    robot = read_robot(exported)
    assert [joint.elasticity for joint in robot.joints] == [spring.elasticity for spring in found.springs]
    values = compute_parameter_values(robot, derive_base_parameters(robot))
    values |= {f"IA{number}": joint.drive.rotor_inertia for number, joint in enumerate(robot.joints, start=1)}
    assert len(found.parameters) == 12
    for entry in found.parameters:
        assert values[entry.name] == pytest.approx(entry.value, rel=1e-12, abs=1e-14)
    assert {joint.friction.smoothing for joint in robot.joints} == {0.01}
    assert robot.source.startswith("Values identified from ta.npz, tb.npz")


def test_the_exported_robot_generates_code_and_moves(folder, estimate, exported, tmp_path):
    answer = do("generate", exported, "-o", tmp_path / "code")
    told = find_codes(answer)
    assert answer["result"]["selftest"] == "passed" or "generate.selftest-not-run" in told
    (private,) = (tmp_path / "code").glob("*_lanes.h")
    (header,) = set((tmp_path / "code").glob("*.h")) - {private}
    assert "hysteresis_invert" in header.read_text(encoding="utf-8")
    log = tmp_path / "again.npz"
    motion = ("--trajectory", "tc", "--clean", "--duration", "4")
    assert do("simulate", exported, *motion, "-o", log)["result"]["energy_gap"] < 1e-6
    # The estimate is the truth of that robot: nothing is left but what filters blur.
    answer = do("validate", exported, estimate, log)
    for table in answer["result"]["tables"]:
        assert max(entry["relative_percent"] for entry in table["residual"]) < 0.1


def test_what_an_elastic_estimate_refuses_keeps_the_value_of_the_robot_file(estimate, tmp_path):
    refused = [["IA2", "for the test"], ["MY2", "for the test"]]
    path = change(estimate, tmp_path / "part.json", refused=refused)
    answer = do("export", ROBOT, path, "-o", tmp_path / "part.toml")
    assert answer["result"]["not_identified"] == ["MY2", "IA2"]
    assert "export.not-identified" in find_codes(answer)
    robot = read_robot(tmp_path / "part.toml")
    assert robot.joints[1].drive.rotor_inertia == 0.05


def test_values_that_no_robot_file_can_have_are_refused(estimate, tmp_path):
    parameters = read(estimate, "parameters")
    for entry in parameters:
        if entry["name"] == "IA1":
            entry["value"] = -0.1
    path = change(estimate, tmp_path / "negative.json", parameters=parameters)
    assert fail("export", ROBOT, path, "-o", tmp_path / "x.toml") == (3, "export.impossible")
    assert not (tmp_path / "x.toml").exists()


def test_a_motor_side_estimate_is_tried_and_written_as_rigid(folder, motor_side, tmp_path):
    found, log = motor_side
    answer = do("validate", ROBOT, found, log, "--gate", "20")
    both = do("validate", ROBOT, found, folder / "tc.npz")
    assert both["result"]["residual"] == answer["result"]["residual"]
    assert "log.motor-position" in {entry["code"] for entry in both["warnings"]}
    assert re.search(r"\(.*\brigid\b.*\)", say("validate", ROBOT, found, log))
    assert fail("validate", ROBOT, found, log, "--tracking") == (2, "usage.rigid-tracking")
    path = tmp_path / "rigid.toml"
    answer = do("export", ROBOT, found, "-o", path)
    assert not answer["result"]["elastic"]
    assert "export.rigid-variant" in find_codes(answer)
    robot = read_robot(path)
    assert not any(robot.elastic)
    values = compute_parameter_values(robot, derive_base_parameters(robot))
    for entry in read(found, "parameters"):
        assert values[entry["name"]] == pytest.approx(entry["value"], rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("known", [True, False])
def test_values_of_no_bodies_say_how_far_the_nearest_are(estimate, tmp_path, known):
    parameters = read(estimate, "parameters")
    for entry in parameters:
        entry["std"] = 0.01 if known else 0.0
        if entry["name"] == "ZZ2":
            entry["value"] = -0.02
    path = change(estimate, tmp_path / "broken.json", parameters=parameters, covariance=[])
    answer = do("export", ROBOT, path, "-o", tmp_path / "nearest.toml")
    assert answer["result"]["outcome"] == "nearest"
    assert ("standard deviations" in find_texts(answer, "export.inconsistent")) == known
    robot = read_robot(tmp_path / "nearest.toml")
    assert compute_parameter_values(robot, derive_base_parameters(robot))["ZZ2"] > 0.0
