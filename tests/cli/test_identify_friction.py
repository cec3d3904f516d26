"""`symid identify --rows friction` and the report of its result, as a user calls them."""

import json

import numpy as np
import pytest

from tests.calls import ask, call, do, find_codes, hear, refuse
from tests.unit.identification.friction.cosine_rigs import PLAIN, STRIBECK, record

LAW = ("--rows", "friction")
EMPS_LAW = (*LAW, "--settings", "published")
# Logs of the axis are at 250 Hz; the published decimation is for 1 kHz.
AXIS_LAW = (*EMPS_LAW, "--decimate", "1")
PLAIN_PROCESSING = (
    *("--set", "processing.filter_cutoff=none", "--decimate", "1"),
    *("--set", "processing.standstill=0", "--drop-first", "20", "--drop-last", "20"),
)


def save(path, recording):
    np.savez(path, t=recording.time, q=recording.position, tau=recording.torque)
    return path


def save_axis(path, velocity, friction, rate=250.0):
    """Write a log of the EMPS with this velocity and friction, mass 95 kg."""
    rng = np.random.default_rng(0)
    q = (np.cumsum(velocity) - 0.5 * velocity) / rate
    force = 95.0 * np.gradient(velocity) * rate + friction + 0.5 * rng.normal(size=len(q))
    np.savez(path, t=np.arange(len(q)) / rate, qm=q, vir=force / 35.15065188)
    return path


def fit_axis(log, model, *options):
    """Return the answer for a law of the axis, and its joint."""
    answer = do("identify", "emps", log, *AXIS_LAW, "--model", model, *options)
    (joint,) = answer["result"]["joints"]
    return answer, joint


@pytest.fixture
def axis_log(tmp_path):
    """Return a log of slow and fast sines of an axis with a break-away bump."""
    time = np.arange(5000) * 4e-3
    v = np.where(time < 10.0, 0.02, 0.12) * np.sin(2.0 * np.pi * 0.5 * time)
    friction = (20.0 + 8.0 * np.exp(-((v / 0.008) ** 2))) * np.sign(v) + 200.0 * v - 3.0
    return save_axis(tmp_path / "axis.npz", v, friction)


@pytest.fixture
def arm_logs(tmp_path):
    """Return a slow and a fast cosine of a two-link arm's first joint, at one pose, and one at another."""
    recordings = (record(0.15), record(1.0, seed=1), record(1.0, pose=(0.3, 1.2), seed=2))
    return [save(tmp_path / f"log{k}.npz", entry) for k, entry in enumerate(recordings)]


def test_a_law_is_chosen_and_its_parameters_told(axis_log, tmp_path):
    output, page = tmp_path / "friction.json", tmp_path / "friction.html"
    code, out, err = call("identify", "emps", axis_log, *AXIS_LAW, "-o", output)
    assert code == 0
    assert "chosen" in out
    assert "held-out" in out.replace("\n", " ")
    whole = call("identify", "emps", axis_log, *AXIS_LAW, "-v")[1]
    assert "held out/%" in whole
    assert "the rigid part J ddq was fitted jointly" in whole
    assert "Traceback" not in err
    data = json.loads(output.read_text())
    assert (data["format"], data["kind"]) == ("symid fit", "friction")
    assert do("report", output, "-o", page)["result"]["robot"] == "emps"
    text = page.read_text()
    assert "emps: identified friction" in text
    assert "velocity (m/s)" in text
    assert "friction (N)" in text
    assert all(trial["law"] in text for trial in data["joints"][0]["selection"]["trials"])
    time = np.arange(2500) * 4e-3
    v = 0.06 * np.sin(2.0 * np.pi * 0.4 * time)
    friction = (20.0 + 8.0 * np.exp(-((v / 0.008) ** 2))) * np.sign(v) + 200.0 * v - 3.0
    other = save_axis(tmp_path / "other.npz", v, friction)
    code, answer = ask("validate", "emps", output, other, "--test", "20%:")
    left = answer["result"]["mean_relative_percent"]
    held_out = ("--force", "--validation", other, "--test", "20%:")
    assert do("report", output, "-o", page, *held_out)["result"]["validations"] == [str(other)]
    text = page.read_text()
    assert f"<dt>residual of the torque on a held-out log</dt><dd>{left:.2g} %</dd>" in text
    assert f"On a held-out log the model has a residual of {left:.2g} % of the torque" in text
    assert "Measured and predicted force of" in text
    code, answer = ask("report", output, "-o", page, "--force", "--validation", axis_log)
    assert "A log given for validation is one of the fit" in str(answer["result"]["verdict"]["details"])


def test_a_named_law_gives_what_the_motion_had(axis_log):
    _, joint = fit_axis(axis_log, "stribeck+offset")
    assert (joint["law"], joint["selection"]) == ("stribeck+offset", None)
    values = {entry["name"]: entry["value"] for entry in joint["parameters"]}
    assert values["fC"] == pytest.approx(20.0, rel=0.02)
    assert values["fV"] == pytest.approx(200.0, rel=0.03)
    assert values["offset"] == pytest.approx(-3.0, rel=0.02)
    # The published filter rounds off what happens at the change of sign.
    assert values["fS"] == pytest.approx(28.0, rel=0.1)
    assert values["vs"] == pytest.approx(0.008, rel=0.2)
    assert joint["rigid"]["parameters"][0]["value"] == pytest.approx(95.0, rel=0.01)
    assert len(joint["map"]["velocity"]) == len(joint["map"]["rows"]) == 40


@pytest.mark.parametrize("estimator", ["varpro", "nlp"])
def test_every_estimator_can_be_named(axis_log, estimator):
    _, joint = fit_axis(axis_log, "stribeck+offset", "--estimator", estimator)
    assert joint["estimator"] == estimator
    # 5.9 to 7.5, by the processor and the estimator: the axis sticks, which amplifies the last bit.
    assert joint["residual"]["relative_percent"] < 8.0


def test_slow_and_fast_logs_and_poses_of_an_arm(arm_logs):
    arguments = ("identify", "two_link", *arm_logs, *LAW, "--model", "stribeck+offset", *PLAIN_PROCESSING)
    answer = do(*arguments)
    (joint,) = answer["result"]["joints"]
    for entry in joint["parameters"]:
        assert abs(entry["value"] - STRIBECK[entry["name"]]) < 5.0 * entry["std"]
    poses = joint["poses"]
    assert not poses["differs"]
    assert [len(pose["sources"]) for pose in poses["poses"]] == [2, 1]
    assert " not " in poses["verdict"]
    assert [entry["joint"] for entry in answer["result"]["refused"]] == ["elbow"]
    assert "friction.joint-refused" in find_codes(answer)
    _, out, _ = call(*arguments)
    assert "pose 2, 95 %" in out
    assert "elbow: joint 'elbow'" in out


def test_known_base_parameters_are_read_from_an_estimate(arm_logs, tmp_path):
    output = tmp_path / "estimate.json"
    arguments = ("identify", "two_link", *arm_logs, *PLAIN_PROCESSING, "--partial", "-o", output)
    assert "friction" in ask(*arguments)[1]["result"]
    arguments = ("identify", "two_link", arm_logs[1], *LAW, "--model", "coulomb-viscous-offset")
    answer = do(*arguments, *PLAIN_PROCESSING, "--known", output)
    (joint,) = answer["result"]["joints"]
    assert "subtracted" in joint["rigid"]["text"]
    assert joint["rigid"]["parameters"] == []
    values = {entry["name"]: entry["value"] for entry in joint["parameters"]}
    assert values["fC"] == pytest.approx(PLAIN["fC"], rel=0.1)


def test_constant_velocity_ends_with_sentences_and_no_number(tmp_path):
    log = save_axis(tmp_path / "constant.npz", np.full(1500, 0.05), 28.0)
    for model in ("coulomb-viscous-offset", "stribeck+offset", "auto"):
        code, answer = ask("identify", "emps", log, *AXIS_LAW, "--model", model)
        assert code == 4
        assert answer["ok"] is False
        assert "result" not in answer
        texts = [entry["text"] for entry in answer["errors"]]
        assert {entry["code"] for entry in answer["errors"]} == {"friction.nothing"}
        assert all("0.05 m/s" in text for text in texts)


def test_one_direction_gets_numbers_for_what_it_shows_alone(tmp_path):
    time = np.arange(3000) * 4e-3
    v = 0.06 + 0.05 * np.sin(2.0 * np.pi * 0.4 * time)
    log = save_axis(tmp_path / "forward.npz", v, 17.0 + 200.0 * v)
    arguments = ("identify", "emps", log, *AXIS_LAW, "--model", "coulomb-viscous-offset")
    code, out, err = call(*arguments)
    assert code == 0
    assert "refused: fC: the joint moved in the positive direction only" in out
    assert "refused: offset" in out
    assert "one direction" in err
    code, answer = ask(*arguments)
    (joint,) = answer["result"]["joints"]
    assert [entry["name"] for entry in joint["parameters"]] == ["fV"]
    assert {entry["name"] for entry in joint["refused"]} == {"fC", "offset"}
    assert "friction.one-direction" in find_codes(answer)


def test_no_low_velocities_get_no_stribeck_velocity(axis_log):
    arguments = ("identify", "emps", axis_log, *AXIS_LAW, "--model", "stribeck+offset")
    answer = do(*arguments, "--set", "processing.standstill=0.05")
    (joint,) = answer["result"]["joints"]
    assert {"vs", "fS"} <= {entry["name"] for entry in joint["refused"]}
    assert {"vs", "fS"}.isdisjoint(entry["name"] for entry in joint["parameters"])
    assert "identify.slow-rows" in find_codes(answer)


@pytest.mark.parametrize(
    ("options", "code", "hint"),
    [
        ((*LAW, "--model", "stribek"), "usage.unknown-friction-law", "did you mean stribeck"),
        ((*LAW, "--estimator", "ols"), "usage.friction-estimator", "choose one of varpro, nlp"),
        ((*LAW, "--method", "nlp"), "usage.mixed-options", "--method"),
        ((*LAW, "--lambda", "3"), "usage.mixed-options", "--lambda"),
        (("--model", "stribeck"), "usage.mixed-options", "--rows friction"),
        (("--estimator", "varpro"), "usage.unknown-estimator", "--rows friction"),
        (("--estimator", "olz"), "usage.unknown-estimator", "ols"),
    ],
)
def test_wrong_options_say_what_is_meant(axis_log, options, code, hint):
    assert hint in hear(2, code, "identify", "emps", axis_log, *options)


def test_options_without_a_part_in_the_result_are_told(axis_log):
    arguments = ("identify", "emps", axis_log, *AXIS_LAW, "--model", "coulomb-viscous-offset")
    answer = do(*arguments, "--friction", "asymmetric")
    texts = [entry["text"] for entry in answer["warnings"] if entry["code"] == "friction.unused-option"]
    assert [text.split()[0] for text in texts] == ["--friction"]
    assert "friction.unused-option" not in find_codes(do(*arguments))
    assert refuse(*arguments[:-1], "makkar", "--smoothing", "0.001") == (2, ["usage.friction-smoothing"])


def test_a_wrong_period_is_refused_and_every_log_may_have_its_own(tmp_path):
    logs = [
        save(tmp_path / f"log{k}.npz", record(peak, law="coulomb-viscous-offset", periods=6.1))
        for k, peak in enumerate((np.pi / 3.0, np.pi / 6.0))
    ]
    arguments = ("identify", "two_link", *logs, *LAW, "--model", "coulomb-viscous-offset")
    assert refuse(*arguments, "--period", "3") == (3, ["log.not-periodic"])
    assert do(*arguments, "--period", "3", "--period", "6")["result"]["settings"]["period"] == [3.0, 6.0]
    assert refuse(*arguments, *("--period", "3") * 3) == (2, ["usage.friction-periods"])


def test_a_pose_without_rows_is_left_out(tmp_path):
    recordings = (record(1.0), record(0.08, pose=(0.3, 1.2), periods=1.0, seed=1))
    logs = [save(tmp_path / f"log{k}.npz", entry) for k, entry in enumerate(recordings)]
    arguments = ("identify", "two_link", *logs, *LAW, "--model", "coulomb-viscous-offset")
    arguments = (*arguments, *PLAIN_PROCESSING, "--set", "processing.standstill=0.1")
    answer = do(*arguments)
    assert "friction.pose-skipped" in find_codes(answer)
    (skipped,) = answer["result"]["joints"][0]["poses"]["skipped"]
    assert "log1.npz" in skipped["sources"]
    _, out, _ = call(*arguments, "-v")
    assert "left out: " in out


def test_elastic_robots_are_told_what_counts_as_friction(arm_logs):
    arguments = ("identify", "two_link_elastic", arm_logs[1], *LAW, "--model", "coulomb-viscous-offset")
    assert "friction.elastic" in find_codes(do(*arguments))
