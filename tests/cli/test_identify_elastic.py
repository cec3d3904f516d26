"""`symid identify` for springs, second encoders and elastic robots, on real recordings too where they are."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import symid
from symid.cli.main import run
from symid.robot.loading import locate_robot_file
from symid.serialization import write_json
from tests.calls import ask, do, find_codes, find_texts, hear, refuse

KR300 = Path(__file__).parents[3] / "shared" / "data" / "kr300"
MISSING = pytest.mark.skipif(not KR300.exists(), reason=f"the KR300's recordings are not at {KR300}")


@pytest.fixture
def one_sided(tmp_path):
    """Return a log of two joints with one position each."""
    time = np.arange(6000) * 1e-3
    w = 2.0 * np.pi * np.array([[0.3, 0.7], [0.45, 1.1]])
    angle = w * time[:, None, None] + np.array([[0.0, 1.0], [2.0, 0.5]])
    q = 0.4 * np.sin(angle).sum(axis=2)
    ddq = -0.4 * (w**2 * np.sin(angle)).sum(axis=2)
    path = tmp_path / "run.npz"
    np.savez(path, t=time, q=q, tau=9.0 * np.sin(q) + ddq)
    return path


@pytest.fixture
def two_sided(one_sided):
    """Return a log of two joints with both positions."""
    with np.load(one_sided) as log:
        columns = dict(log)
    path = one_sided.parent / "both.npz"
    # The same samples in another file would be one log given twice.
    columns = {**columns, "t": columns["t"] + 10.0, "tau": 1.1 * columns["tau"]}
    np.savez(path, **columns, theta=columns["q"] + columns["tau"] / 500.0)
    return path


@MISSING
def test_kr300_delay_offsets_and_the_one_spring_that_can_be_told(tmp_path):
    logs = [KR300 / f"run_{name}.npz" for name in "abc"]
    output = tmp_path / "springs.json"
    answer = do("identify", "kr300", *logs, "--method", "stiffness", "-o", output)
    result = answer["result"]
    assert result["delay_ms"] == pytest.approx(3.0, abs=0.1)
    assert 0.0 < result["delay_std_ms"] < 0.1
    offsets = np.array([[entry["offsets"][f"joint{j}"] for j in (1, 2, 3)] for entry in result["offsets"]])
    assert np.ptp(offsets, axis=0).max() == pytest.approx(2.5e-3, abs=0.2e-3)
    assert all(entry["offsets"]["joint4"] is None for entry in result["offsets"])
    verdicts = [entry["verdict"] for entry in result["joints"]]
    assert verdicts == ["no_gravity", "below_noise", "identified", *["no_encoder"] * 3]
    third = result["joints"][2]
    assert third["stiffness"] == pytest.approx(2.7e6, rel=0.2)
    assert third["interval"][0] < 2.7e6 < third["interval"][1]
    assert third["unit"] == "N m/rad"
    for entry in (*result["joints"][:2], *result["joints"][3:]):
        assert entry["stiffness"] is None
        assert entry["interval"] is None
        assert entry["reason"]
    assert result["hysteresis"] is None
    codes = find_codes(answer)
    assert {"log.no-second-encoder", "log.aligned"} <= codes
    written = json.loads(output.read_text())
    assert {name: written[name] for name in result} == result
    read = json.loads(write_json(symid.load_stiffness(output).to_dict()))
    assert {name: written[name] for name in read} == read


@MISSING
def test_kr300_is_still_identified_as_rigid():
    answer = do("identify", "kr300", KR300 / "run_a.npz")
    assert len(answer["result"]["parameters"]) > 50
    assert "identify.second-encoder" in find_codes(answer)


@MISSING
def test_check_tells_the_second_encoder():
    answer = do("check", "kr300", KR300 / "run_a.npz")
    assert answer["result"]["logs"][0]["second_encoder"] == "link"
    assert "'joint4', 'joint5', 'joint6'" in find_texts(answer, "log.no-second-encoder")


def test_the_motor_side_alone(one_sided):
    answer = do("identify", "two_link_elastic", one_sided)
    names = [entry["name"] for entry in answer["result"]["refused"]]
    assert {"stiffness1", "hysteresis1", "stiffness2", "hysteresis2"} <= set(names)
    assert "elastic.motor-side" in find_codes(answer)


@pytest.mark.parametrize(
    ("robot", "options", "code"),
    [
        ("two_link", "one --method two-step", "usage.method"),
        ("two_link_elastic", "two --method weighted", "usage.call"),
        ("two_link", "one --tolerance 1e-5", "usage.mixed-options"),
        ("two_link", "one --method stiffness --rows torque", "usage.mixed-options"),
        ("two_link", "one --method stiffness --lambda 30", "usage.mixed-options"),
        ("two_link", "one --method stiffness", "log.one-encoder"),
        ("two_link_elastic", "one --method nlp", "usage.one-encoder"),
        ("two_link_elastic", "one --thresholds 4", "usage.mixed-options"),
        ("two_link_elastic", "two --estimator wls", "usage.mixed-options"),
        ("two_link_elastic", "one two", "log.mixed-encoders"),
    ],
)
def test_options_that_do_not_fit_are_refused(one_sided, two_sided, robot, options, code):
    logs = {"one": one_sided, "two": two_sided}
    words = [logs.get(word, word) for word in options.split()]
    assert refuse("identify", robot, *words) == (2 if code.startswith("usage") else 3, [code])


@pytest.fixture(scope="module")
def experiment(tmp_path_factory):
    """Return a log of the elastic arm whose link encoders are late and have zeros of their own."""
    path = tmp_path_factory.mktemp("elastic") / "run.npz"
    call = ["simulate", "two_link_elastic", "--trajectory", "ta", "--scale", "10", "--duration", "20"]
    do(*call, "--delay", "0.0023", "--offset", "0.002", "-o", path)
    return path


@pytest.fixture(scope="module")
def identified(experiment):
    """Return the estimate's file and the answer's result for the experiment."""
    path = experiment.parent / "estimate.json"
    return path, do("identify", "two_link_elastic", experiment, "-o", path, "--thresholds", "6")


def test_an_elastic_robot_with_both_encoders(identified):
    path, answer = identified
    result = answer["result"]
    assert result["alignment"]["delay_ms"] == pytest.approx(2.3, abs=0.15)
    offsets = result["alignment"]["offsets"][0]["offsets"]
    assert all(abs(value + 2e-3) < 4e-4 for value in offsets.values())
    assert "log.aligned" in find_codes(answer)
    known = [entry for entry in result["parameters"] if entry["truth"]]
    assert len(known) == 10
    worst = max(abs(entry["value"] / entry["truth"] - 1.0) for entry in known)
    assert worst < 0.3
    assert result["settings"]["stops"] == 6
    assert {trial["method"] for trial in result["trials"]} >= {"linear-spring", "two-step", "elimination"}
    assert len(result["springs"]) == 2
    assert path.exists()


def test_stiffness_of_an_elastic_arm(experiment, tmp_path):
    file, first, second = (tmp_path / name for name in ("stiff.json", "first.html", "second.html"))
    call = ("identify", "two_link_elastic", experiment, "--method", "stiffness", "-o", file, "--page", first)
    answer = do(*call)
    again, reported = ask("report", file, "-o", second)
    assert (again, reported["result"]["joints"]) == (0, answer["result"]["joints"])
    assert reported["result"]["offsets"] == answer["result"]["offsets"]
    head = second.read_text().split('<nav aria-label="Contents">')[0]
    assert head == first.read_text().split('<nav aria-label="Contents">')[0]
    refused, reported = ask("report", file, "-o", second, "--force", "--diagnose")
    assert (refused, reported["errors"][0]["code"]) == (2, "usage.no-validation")
    file.write_text(file.read_text().replace('"delays": [', '"delays": [1.0, '))
    refused, reported = ask("report", file, "-o", second, "--force")
    assert (refused, "delays" in reported["errors"][0]["text"]) == (3, True)
    assert answer["result"]["delay_ms"] == pytest.approx(2.3, abs=0.15)
    for entry, (low, high) in zip(answer["result"]["joints"], ((380, 600), (90, 150)), strict=True):
        assert entry["verdict"] == "identified"
        assert low < entry["stiffness"] < high


def test_a_log_too_short_for_a_delay_is_taken_as_it_is(tmp_path):
    path = tmp_path / "run.npz"
    call = ["simulate", "two_link_elastic", "--trajectory", "ta", "--scale", "10", "--duration", "4"]
    do(*call, "-o", path)
    answer = do("identify", "two_link_elastic", path, "--method", "two-step")
    assert "log.short-alignment" in find_codes(answer)
    assert answer["result"]["alignment"] is None


def test_the_cutoff_and_the_ends_of_elastic_joints_are_those_asked_for(experiment):
    call = ("identify", "two_link_elastic", experiment, "--method", "two-step")
    plain = do(*call)
    assert plain["result"]["settings"]["cutoff"] is None
    answer = do(*call, "--cutoff", "15", "--drop-first", "3000", "--drop-last", "2000")
    settings = answer["result"]["settings"]
    assert settings["cutoff"] == 15.0
    assert settings["cutoffs"] == [15.0]
    assert re.findall(r"\d+", find_texts(answer, "log.cut")) == ["3000", "2000", "20001"]
    counts = [entry["result"]["residual"][0]["samples"] for entry in (plain, answer)]
    assert counts[1] < counts[0] - 1000
    # The same by the names of the settings; no filter is a setting too.
    assert do(*call, "--set", "processing.filter_cutoff=none")["result"]["settings"]["cutoffs"] == [0.0]


@pytest.mark.parametrize(
    ("method", "options", "name"),
    [
        ("two-step", ["--decimate", "3"], "decimation.factor (--decimate)"),
        ("two-step", ["--set", "processing.standstill=1"], "standstill"),
        ("two-step", ["--set", "processing.noise_freedom=one"], "noise_freedom"),
        ("stiffness", ["--cutoff", "30"], "filter_cutoff (--cutoff)"),
    ],
)
def test_settings_without_a_meaning_for_elastic_joints_are_refused(two_sided, method, options, name):
    text = hear(
        2, "usage.elastic-processing", "identify", "two_link_elastic", two_sided, "--method", method, *options
    )
    assert text.startswith(f"processing.{name} ")


def test_cutting_off_all_of_an_elastic_log_is_refused(two_sided):
    call = ("identify", "two_link_elastic", two_sided, "--method", "two-step")
    assert refuse(*call, "--drop-first", "5990", "--drop-last", "8") == (3, ["log.too-short"])


@pytest.fixture
def strict_arm(tmp_path):
    """Return the elastic arm with settings of rigid robots in its file."""
    text = locate_robot_file("two_link_elastic").read_text(encoding="utf-8")
    path = tmp_path / "strict.toml"
    settings = (
        "[processing]\nfilter_cutoff = 22\ndrop_first = 100\nstandstill = 0.1\ndecimation = { factor = 4 }\n"
    )
    path.write_text(f"{text}\n{settings}", encoding="utf-8")
    return path


def test_settings_of_the_robot_file_are_used_or_told(strict_arm, experiment):
    answer = do("identify", strict_arm, experiment, "--method", "two-step")
    assert answer["result"]["settings"]["cutoffs"] == [22.0]
    assert find_texts(answer, "identify.unused-processing").startswith("[processing] standstill, decimation:")
    assert "log.cut" in find_codes(answer)
    answer = do("identify", strict_arm, experiment, "--method", "stiffness")
    notice = find_texts(answer, "identify.unused-processing")
    assert notice.startswith("[processing] standstill, decimation, filter_cutoff:")


def make_late(path, target, delay, rate=1000):
    """Write the log at `path` with the links later by `delay` s, or earlier, to `target`."""
    with np.load(path) as log:
        columns = {name: log[name] for name in ("t", "q", "theta", "tau")}
    lag = round(abs(delay) * rate)
    early, late = slice(None, -lag), slice(lag, None)
    link, others = (early, late) if delay > 0.0 else (late, early)
    columns = {name: values[link if name == "q" else others] for name, values in columns.items()}
    np.savez(target, **columns)
    return target


def test_a_delay_beyond_the_search_is_refused(experiment, tmp_path):
    late = make_late(experiment, tmp_path / "late.npz", 0.15)
    for method in ("two-step", "stiffness"):
        assert refuse("identify", "two_link_elastic", late, "--method", method) == (3, ["log.delay-beyond"])


def test_links_ahead_of_their_motors_are_called_so(capsys, experiment, tmp_path):
    early = make_late(experiment, tmp_path / "early.npz", -0.012)
    call = ["identify", "two_link_elastic", str(early), "--method", "stiffness"]
    assert run(call) == 0
    captured = capsys.readouterr()
    assert re.search(r"\b9\.69\d* ms", captured.out)
    assert re.search(r"\b9\.69\d* ms.* earlier .* beginning", " ".join(captured.err.split()))


def test_without_a_delay_none_is_told(capsys, tmp_path):
    path = tmp_path / "run.npz"
    call = ["simulate", "two_link_elastic", "--trajectory", "ta", "--scale", "10", "--duration", "12"]
    do(*call, "--offset", "0.5", "-o", path)
    assert run(["identify", "two_link_elastic", str(path), "--method", "stiffness"]) == 0
    captured = capsys.readouterr()
    assert re.search(r"offsets .* 0\.5\b", " ".join(captured.err.split()))
    assert " 0 ms" not in captured.err
    answer = do("identify", "two_link_elastic", path, "--method", "two-step")
    offsets = answer["result"]["alignment"]["offsets"][0]["offsets"]
    assert all(value == pytest.approx(-0.5, abs=3e-4) for value in offsets.values())
    worst = max(
        abs(entry["value"] / entry["truth"] - 1.0)
        for entry in answer["result"]["parameters"]
        if entry["truth"]
    )
    assert worst < 0.05


@pytest.fixture
def link_side(experiment, tmp_path):
    """Return the experiment's log with the positions of the links alone, as positions of anything."""
    with np.load(experiment) as log:
        columns = {name: log[name] for name in ("t", "q", "tau")}
    np.savez(tmp_path / "links.npz", **columns)
    np.savez(tmp_path / "named.npz", t=columns["t"], link_position=columns["q"], tau=columns["tau"])
    return tmp_path / "links.npz", tmp_path / "named.npz"


def test_positions_of_links_alone_are_no_motor_side(link_side):
    plain, named = link_side
    # A wide band: within a narrow one the rotors are met in spite of it.
    wide = ("--cutoff", 100, "--decimate", 5, "--estimator", "wls")
    # What no robot has limits a fit, which may predict these logs all the same.
    answer = do("identify", "two_link_elastic", plain, *wide)
    assert answer["result"]["verdict"]["level"] in {"usable", "doubtful"}
    assert "not identifiable from these logs" in answer["result"]["verdict"]["headline"]
    assert "IA2" in find_texts(answer, "elastic.negative-rotor")
    answer = do("identify", "two_link_elastic", plain)
    rotor = next(entry for entry in answer["result"]["parameters"] if entry["name"] == "IA2")
    assert rotor["value"] == pytest.approx(0.05, abs=3.0 * rotor["std"])
    code, answer = ask("identify", "two_link_elastic", named)
    assert code == 3
    assert {entry["code"] for entry in answer["errors"]} == {"log.missing-column", "log.one-side"}
    chosen = ("--set", "log.position.columns=link_position", "--set", "log.position.unit=rad")
    assert refuse("identify", "two_link_elastic", named, *chosen) == (3, ["elastic.link-side"])


def test_a_robot_with_a_rigid_joint_has_springs_where_joints_are_elastic(experiment, tmp_path):
    text = locate_robot_file("two_link_elastic").read_text(encoding="utf-8")
    first, last = text.rindex("[joint.elasticity]"), text.rindex("[joint.limits]")
    robot = tmp_path / "mixed.toml"
    robot.write_text(text[:first] + text[last:], encoding="utf-8")
    code, answer = ask("identify", robot, experiment, "--method", "nlp")
    assert code in (0, 1)
    assert [entry["joint"] for entry in answer["result"]["springs"]] == ["shoulder"]
    # Its elbow gives, which the file denies.
    assert "[joint.elasticity]" in find_texts(answer, "log.rigid-joint")
    with np.load(experiment) as log:
        np.savez(tmp_path / "one.npz", t=log["t"], q=log["theta"], tau=log["tau"])
    code, alone = ask("identify", robot, tmp_path / "one.npz")
    assert code == 0
    assert "elastic.motor-side" in {entry["code"] for entry in alone["warnings"]}
