"""`symid payload`: what a robot carries, from two estimates and from logs."""

import dataclasses
import json

import numpy as np
import pytest

import symid
from symid.dynamics.base_parameters import derive_base_parameters
from symid.errors import EstimateError, UsageError
from symid.identification.elastic.routing import build_rigid_variant
from symid.identification.stored import write_fit
from symid.joint_models import FrictionValues
from symid.robot.toml_reader import read_robot
from symid.robot.toml_writer import write_robot
from tests.calls import do, fail, hear, list_codes, say
from tests.chains import PUMA560, regress
from tests.estimates import add_payload, build_estimate, build_springless_estimate, fill_robot, store_estimate

pytestmark = pytest.mark.usefixtures("shared_work")

BODY = MASS, CENTRE, INERTIA = 1.5, (0.03, -0.02, 0.09), (0.004, 0.0003, -0.0002, 0.005, 0.0001, 0.003)


def find_covariance(robot, scale):
    """Return the covariance of an estimate from torques at random states."""
    estimate = build_estimate(robot)
    labels = {f"{name}{joint + 1}": (joint, name) for joint in range(robot.size) for name in ("Fv", "Fc")}
    labels |= {entry.name: entry.label for entry in derive_base_parameters(robot).parameters}
    rng = np.random.default_rng(1)
    rows = np.vstack(
        [
            np.column_stack([columns[labels[entry.name]] for entry in estimate.parameters])
            for columns in (regress(robot, *rng.uniform(-2, 2, (3, robot.freedom))) for _ in range(80))
        ]
    )
    return scale**2 * np.linalg.inv(rows.T @ rows)


def order(folder, loaded="loaded.json", empty="empty.json"):
    """Return the call for two estimates of a folder; what has a folder of its own stands as it is."""
    return ("payload", folder / "arm.toml", folder / loaded, "--empty", folder / empty)


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    """Return a folder with a robot file and estimates of it, loaded and empty, and the robot."""
    folder = tmp_path_factory.mktemp("payload")
    joints = tuple(
        dataclasses.replace(joint, friction=FrictionValues(law="coulomb-viscous")) for joint in PUMA560.joints
    )
    robot = fill_robot(dataclasses.replace(PUMA560, joints=joints))
    (folder / "arm.toml").write_text(write_robot(robot), encoding="utf-8")
    robot = read_robot(folder / "arm.toml")
    covariance = find_covariance(robot, 0.02)
    store_estimate(robot, folder / "empty.json", covariance=covariance)
    store_estimate(add_payload(robot, *BODY), folder / "loaded.json", covariance=covariance)
    return folder, robot


def test_two_estimates_give_the_payload(arm, tmp_path):
    folder, _ = arm
    answer = do(*order(folder), "-o", tmp_path / "payload.json")
    result = answer["result"]
    assert result["mass"] == pytest.approx(MASS, rel=1e-6)
    np.testing.assert_allclose(result["com"], CENTRE, atol=1e-7)
    assert list(result["inertia"]) == ["xx", "xy", "xz", "yy", "yz", "zz"]
    np.testing.assert_allclose(list(result["inertia"].values()), INERTIA, atol=1e-7)
    assert (result["joint"], result["moved"], result["friction"]) == ("joint6", 0.0, [])
    assert all(0 < entry["std"] < 0.1 for entry in result["quantities"])
    stored = json.loads((tmp_path / "payload.json").read_text(encoding="utf-8"))
    said = {key: value for key, value in result.items() if key != "file"}
    # The file has its format and the record that it is read back from besides.
    assert set(stored) - set(said) == {"format", "version", "record"}
    assert {key: stored[key] for key in said} == said
    assert answer["warnings"] == []


def test_what_noise_hides_is_refused_with_warnings(arm, tmp_path):
    folder, robot = arm
    covariance = find_covariance(robot, 1.0)
    store_estimate(robot, tmp_path / "empty.json", covariance=covariance)
    loaded = store_estimate(add_payload(robot, *BODY), tmp_path / "loaded.json", covariance=covariance)
    stored = json.loads(loaded.read_text(encoding="utf-8"))
    changes = {"Fc1": 100.0, "ZZR1": 100.0}
    for entry in stored["parameters"]:
        entry["value"] += changes.get(entry["name"], 0.0)
    loaded.write_text(json.dumps(stored), encoding="utf-8")
    call = (*order(folder, loaded, tmp_path / "empty.json"), "--mass", MASS)
    answer = do(*call)
    assert answer["result"]["inertia"]["xx"] is None
    assert {"payload.refused", "payload.other-changes", "payload.friction-changed"} <= set(list_codes(answer))
    assert answer["result"]["friction"][0]["name"] == "Fc1"
    assert answer["result"]["unexplained"][0]["name"] == "ZZR1"
    out = say(*call)
    assert "refused: Jxx: " in out
    assert f" {answer['result']['scale']:.3g}, " in out


def test_a_change_that_no_body_makes_is_said(arm, tmp_path):
    folder, robot = arm
    impossible = list(add_payload(robot, *BODY).joints[-1].inertial)
    impossible[0] -= 1.0
    impossible[3] -= 1.0
    last = dataclasses.replace(robot.joints[-1], inertial=tuple(impossible))
    changed = dataclasses.replace(robot, joints=(*robot.joints[:-1], last))
    loaded = store_estimate(changed, tmp_path / "loaded.json", covariance=find_covariance(robot, 0.02))
    answer = do(*order(folder, loaded))
    assert "payload.inconsistent" in list_codes(answer)
    assert answer["result"]["moved"] > 3


def test_the_other_way_round_there_is_no_payload(arm):
    assert fail(*order(arm[0], "empty.json", "loaded.json")) == (4, "payload.none")


@pytest.fixture(scope="module")
def logs(tmp_path_factory, robots_folder):
    """Return a folder with logs of a planar arm, loaded and empty."""
    folder = tmp_path_factory.mktemp("payload-logs")
    robot = read_robot(robots_folder / "two_link.toml")
    (folder / "heavy.toml").write_text(write_robot(add_payload(robot, *BODY)), encoding="utf-8")
    for name, log in (("two_link", "empty"), (str(folder / "heavy.toml"), "loaded")):
        for seed in ("1", "2"):
            path = str(folder / f"{log}{seed}.npz")
            do("simulate", name, "--duration", "8", "--seed", seed, "-o", path)
    return folder


@pytest.mark.parametrize(
    "options", [(), ("--rows", "momentum", "--estimator", "ols")], ids=["torque", "momentum"]
)
def test_logs_give_the_payload(logs, options):
    sides = (logs / "loaded1.npz", logs / "loaded2.npz")
    sides += ("--empty", logs / "empty1.npz", "--empty", logs / "empty2.npz")
    answer = do("payload", "two_link", *sides, *options)
    by_name = {entry["name"]: entry for entry in answer["result"]["quantities"]}
    truth = {"mass": MASS, "cx": CENTRE[0], "cy": CENTRE[1]}
    for name, value in truth.items():
        assert abs(by_name[name]["value"] - value) < 4 * by_name[name]["std"], name
        assert by_name[name]["std"] < 0.02
    assert by_name["cz"]["value"] is None
    assert "payload.refused" in list_codes(answer)


def test_logs_without_times_need_their_sample_rate(logs, tmp_path):
    times = {}
    for name in ("loaded1", "empty1"):
        columns = dict(np.load(logs / f"{name}.npz"))
        time = next(key for key in columns if key.startswith("t") and columns[key].ndim == 1)
        times[name] = columns.pop(time)
        np.savez(tmp_path / f"{name}.npz", **columns)
    rate = round(1.0 / np.diff(times["loaded1"]).mean())
    call = ("payload", "two_link", tmp_path / "loaded1.npz", "--empty", tmp_path / "empty1.npz")
    assert fail(*call)[0] == 3
    answer = do(*call, "--sample-rate", rate)
    with_times = do("payload", "two_link", logs / "loaded1.npz", "--empty", logs / "empty1.npz")
    masses = [found["result"]["quantities"][0]["value"] for found in (answer, with_times)]
    assert masses[0] == pytest.approx(masses[1], rel=1e-6)
    assert "log.sample-rate" in list_codes(answer)


def test_calls_that_cannot_be_answered(arm, logs, tmp_path):
    folder, _ = arm
    robot, loaded, empty = folder / "arm.toml", folder / "loaded.json", folder / "empty.json"
    log, other = logs / "loaded1.npz", logs / "empty1.npz"
    for exit_code, code, *call in (
        (2, "usage.payload-inputs", robot, loaded, log, "--empty", empty),
        (2, "usage.same-log", robot, loaded, "--empty", loaded),
        (2, "usage.payload-joint", robot, loaded, "--empty", empty, "--joint", "hand"),
        (3, "estimate.signature", "two_link", loaded, "--empty", empty),
        (2, "usage.payload-elastic", "two_link_elastic", log, "--empty", other),
        (3, "output.is-input", robot, loaded, "--empty", empty, "-o", loaded, "--force"),
    ):
        assert fail("payload", *call) == (exit_code, code)
    unsure = json.loads(empty.read_text(encoding="utf-8"))
    for entry in unsure["parameters"]:
        entry["std"] = None
    (tmp_path / "unsure.json").write_text(json.dumps(unsure | {"covariance": []}), encoding="utf-8")
    assert fail("payload", robot, loaded, "--empty", tmp_path / "unsure.json") == (3, "payload.no-deviations")


def test_estimates_of_elastic_joints_give_the_payload(tmp_path, robots_folder):
    robot = read_robot(robots_folder / "two_link_elastic.toml")
    empty = write_fit(build_springless_estimate(robot), tmp_path / "empty.json")
    loaded = write_fit(build_springless_estimate(add_payload(robot, *BODY)), tmp_path / "loaded.json")
    answer = do("payload", "two_link_elastic", loaded, "--empty", empty)
    assert answer["result"]["mass"] == pytest.approx(MASS, rel=1e-6)
    np.testing.assert_allclose(answer["result"]["com"][:2], CENTRE[:2], atol=1e-7)
    rigid = store_estimate(build_rigid_variant(robot), tmp_path / "rigid.json")
    assert fail("payload", "two_link_elastic", loaded, "--empty", rigid) == (3, "payload.other-model")


def test_a_controller_gets_what_it_takes(arm, tmp_path):
    folder, _ = arm
    place = "0,0,0.1,0,0,1.5707963267948966"
    answer = do(
        *order(folder), "--for", "ur", f"--frame={place}", "-o", tmp_path / "payload.json", "--mass", MASS
    )
    command = answer["result"]["controller"]
    np.testing.assert_allclose(command["com"], [CENTRE[1], -CENTRE[0], CENTRE[2] - 0.1], atol=1e-6)
    assert command["texts"]["URScript"].startswith("set_target_payload(1.5, [-0.02")
    assert list_codes(answer) == ["payload.controller-scope"]
    assert (tmp_path / "payload.json").exists()
    assert "libfranka: robot.setLoad(1." in say(*order(folder), "--for", "franka")
    assert fail(*order(folder), "--frame", "flange") == (2, "usage.payload-frame")


def test_a_stored_payload_is_reported_as_it_was_found(arm, tmp_path):
    folder, _ = arm
    stored, first, second = (tmp_path / name for name in ("payload.json", "first.html", "second.html"))
    answer = do(*order(folder), "-o", stored, "--page", first)
    again = do("report", stored, "-o", second)
    assert second.read_bytes() == first.read_bytes()
    assert list_codes(again) == list_codes(answer)
    here = {"file": None, "page": None}
    assert again["result"] | here == answer["result"] | here
    found = symid.load_payload(stored, symid.load(folder / "arm.toml"))
    assert found.to_text() == symid.load_payload(stored).to_text()
    assert found.for_controller("franka").texts["libfranka"].startswith("robot.setLoad(1.")
    with pytest.raises(UsageError, match="not known here"):
        symid.load_payload(stored).for_controller("ur", "flange")
    with pytest.raises(EstimateError, match="not of 'two_link'"):
        symid.load_payload(stored, symid.load("two_link"))
    assert fail("report", stored, "--diagnose", "-o", tmp_path / "third.html") == (2, "usage.no-validation")


def test_a_stored_payload_with_mistakes_is_refused(arm, tmp_path):
    folder, _ = arm
    stored = tmp_path / "payload.json"
    do(*order(folder), "-o", stored)
    text = stored.read_text(encoding="utf-8")
    for place, value, said in (
        (("standard",), [1.0], "(10,) numbers"),
        (("quantities", 0, "std"), None, "mass: a value needs a deviation"),
        (("quantities", 0, "name"), "weight", "expected mass"),
        (("joint",), 3, "joint"),
    ):
        data = json.loads(text)
        entry = data["record"]["payload"]
        for key in place[:-1]:
            entry = entry[key]
        entry[place[-1]] = value
        stored.write_text(json.dumps(data), encoding="utf-8")
        assert said in hear(3, "estimate.format", "report", stored, "-o", tmp_path / "page.html")
