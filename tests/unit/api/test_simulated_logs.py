"""What a log says of where it comes from: only values that it was simulated from are true ones."""

from dataclasses import replace

import pytest

import symid
from symid.logs.reader import read_recording


@pytest.fixture(scope="module")
def robot():
    return symid.load("two_link")


@pytest.mark.parametrize("suffix", ["npz", "csv"])
def test_a_stored_log_says_what_it_was_simulated_from(robot, tmp_path, suffix):
    log = robot.simulate(duration=4.0, seed=1).log
    path = log.save(tmp_path / f"log.{suffix}")
    recording = read_recording(path, robot.description)
    assert recording.simulated == robot.description.values_signature
    assert recording.extras == {}
    assert not any("not used" in notice.text for notice in recording.notices)
    fit = robot.identify(path)
    assert fit.estimate.simulated
    assert "truth" in str(fit)
    assert any("true values" in detail for detail in fit.verdict.details)
    assert symid.load_fit(fit.save(tmp_path / "fit.json")).estimate.simulated


@pytest.mark.parametrize("change", ["mass = 2.9", "gravity = [0.0, -9.7, 0.0]", "Fv = 3.0", "comment = 0"])
def test_values_of_another_file_are_no_truth(robot, tmp_path, change):
    text = robot.path.read_text()
    key = change.partition(" ")[0]
    lines = [change if line.startswith(f"{key} =") else line for line in text.splitlines()]
    changed = tmp_path / "two_link.toml"
    changed.write_text("\n".join(lines if lines != text.splitlines() else ["# the same", *lines]))
    other = symid.load(changed)
    same = other.description.values_signature == robot.description.values_signature
    assert same == (lines == text.splitlines())
    fit = other.identify(robot.simulate(duration=4.0, seed=1).log)
    assert fit.estimate.simulated == same
    page = fit.report(tmp_path / "page.html").file.read_text()
    assert ('<th scope="col">truth</th>' in page) == same
    assert ('<th scope="col">robot file</th>' in page) == (not same)


def test_a_log_of_unknown_origin_and_one_of_several_are_no_simulation(robot, tmp_path):
    log, other = (robot.simulate(duration=4.0, seed=seed).log for seed in (1, 2))
    measured = symid.build_log(robot, time=log.time, q=log.q, tau=log.tau)
    for logs in (measured, [other, measured]):
        fit = robot.identify(logs)
        assert not fit.estimate.simulated
        assert "robot file" in str(fit)
        assert 'class="no"' not in fit.report(tmp_path / "page.html").file.read_text()
    assert robot.identify([log, other]).estimate.simulated
    # A comment or a line of settings changes no value.
    assert replace(robot.description, notices=(), path="x").values_signature == log.recording.simulated


def test_springs_of_a_file_are_true_only_of_its_own_simulation():
    robot = symid.load("two_link_elastic")
    run = robot.simulate(duration=6.0, seed=1)
    assert run.log.recording.simulated == robot.description.values_signature
    own = robot.identify(run.log, method="two-step")
    assert all(spring.truth is not None for spring in own.estimate.springs)
    measured = replace(run.log.recording, simulated="")
    fit = robot.identify(replace(run.log, recording=measured), method="two-step")
    assert [spring.truth for spring in fit.estimate.springs] == [None, None]
    assert "truth" not in str(fit)
