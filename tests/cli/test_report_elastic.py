"""`symid report` for estimates of elastic joints."""

from dataclasses import replace

import numpy as np
import pytest

from symid.cli.main import run
from symid.codegen.cache import prepare_library
from symid.identification.elastic.estimate import SpringEstimate
from symid.identification.stored import write_fit
from symid.robot.loading import load_robot
from symid.robot.toml_settings import describe_settings
from tests.calls import ask, do, find_codes
from tests.estimates import build_springless_estimate

ROBOT = "two_link_elastic"


@pytest.fixture(scope="module")
def estimate():
    """Return an estimate that says the truth of the robot file."""
    robot = load_robot(ROBOT)
    card = prepare_library(robot).card
    springs = tuple(
        SpringEstimate(
            joint=joint.name,
            torque_unit=joint.torque_unit,
            position_unit=joint.position_unit,
            elasticity=spring,
            torsion=0.03,
            excited=0.016,
            torque=15.0,
            truth=spring,
        )
        for joint, spring in zip(card.joints, card.elasticity, strict=True)
    )
    settings = {**describe_settings(robot), "stops": 8, "rate": 60.0, "cutoff": None}
    plain = build_springless_estimate(robot, sources=("training.npz",))
    parameters = tuple(replace(entry, std=0.01, truth=entry.value) for entry in plain.parameters)
    return replace(plain, parameters=parameters, springs=springs, settings=settings, covariance=())


@pytest.fixture
def found(estimate, tmp_path):
    return write_fit(estimate, tmp_path / "estimate.json")


@pytest.fixture
def log(tmp_path):
    """Return a log of both encoders; its torques are no more than plausible."""
    time = np.arange(8000) * 1e-3
    ramp = np.minimum(time / 2.0, 1.0) ** 3
    q = ramp[:, None] * np.column_stack([0.6 * np.sin(2.0 * time), 0.5 * np.sin(3.1 * time + 1.0)])
    tau = np.array([9.0, 2.4]) * np.sin(q)
    path = tmp_path / "held_out.npz"
    np.savez(path, t=time, q=q, theta=q + tau / np.array([500.0, 130.0]), tau=tau)
    return path


def test_a_page_without_logs_needs_no_robot(found, tmp_path):
    page = tmp_path / "page.html"
    answer = do("report", found, "-o", page)
    assert answer["result"]["robot"] == ROBOT
    assert answer["result"]["validations"] == []
    assert "--validation" in page.read_text(encoding="utf-8")


def test_a_page_with_a_log_has_its_loops(found, log, tmp_path):
    page = tmp_path / "page.html"
    # The log's torques are no arm's: the page says so, and is written.
    answer = do("report", found, "--validation", log, "-o", page, "--accept")
    assert answer["warnings"][0]["code"] == "identify.wrong"
    assert answer["result"]["validations"] == [str(log)]
    text = page.read_text(encoding="utf-8")
    assert "Hysteresis loops: " in text
    assert text.count("joint torque (N m)") >= 1
    assert text.count("<title>The loops of shoulder less ") == 1
    assert "7.999 s at 1000 Hz" in text


def test_an_estimate_of_another_model_is_refused(estimate, log, tmp_path):
    other = write_fit(replace(estimate, signature="0" * 64), tmp_path / "other.json")
    code, answer = ask("report", other, "--validation", log, "-o", tmp_path / "a.html")
    assert code != 0
    assert answer["errors"][0]["code"] == "estimate.signature"
    assert not (tmp_path / "a.html").exists()


def test_an_unknown_robot_is_named_with_its_option(estimate, log, tmp_path):
    other = write_fit(replace(estimate, robot="nobody"), tmp_path / "other.json")
    code, answer = ask("report", other, "--validation", log, "-o", tmp_path / "a.html")
    assert code != 0
    assert "--robot FILE.toml" in answer["errors"][0]["text"]


def test_a_log_of_one_encoder_is_refused(found, log, tmp_path):
    with np.load(log) as columns:
        kept = {name: columns[name] for name in ("t", "q", "tau")}
    one = tmp_path / "one.npz"
    np.savez(one, **kept)
    code, answer = ask("report", found, "--validation", one, "-o", tmp_path / "a.html")
    assert code != 0
    assert answer["errors"][0]["code"] == "log.one-encoder"
    assert not (tmp_path / "a.html").exists()


def test_the_log_is_read_as_the_logs_of_the_fit_were(estimate, log, tmp_path):
    settings = {**estimate.settings, "log": {"torque": {"columns": ["tau"], "unit": "mN m"}}}
    other = write_fit(replace(estimate, settings=settings), tmp_path / "other.json")
    page = tmp_path / "a.html"
    answer = do("report", other, "--validation", log, "-o", page, "--accept")
    assert "was multiplied by 0.001" in page.read_text(encoding="utf-8")
    assert "estimate.settings-differ" in find_codes(answer)


def test_what_the_motor_side_told_is_tried_as_rigid(log, tmp_path):
    with np.load(log) as columns:
        kept = {"t": columns["t"], "q": columns["theta"], "tau": columns["tau"]}
    training, held_out, found = (tmp_path / name for name in ("one.npz", "two.npz", "found.json"))
    np.savez(training, **kept)
    np.savez(held_out, **{**kept, "t": kept["t"] + 1.0})
    # A torque without inertia is no arm's: symid says so, and goes on where it is told to.
    assert run(["identify", ROBOT, str(training), "-o", str(found), "-q"]) == 1
    page = tmp_path / "a.html"
    answer = do("report", found, "--validation", held_out, "-o", page, "--accept")
    assert answer["result"]["validations"] == [str(held_out)]
    assert "stiffness1" in (tmp_path / "a.html").read_text(encoding="utf-8")
