"""`symid simulate` of elastic robots: both encoders in the log, sensors as told, refusals."""

import re

import numpy as np
import pytest

from symid.logs.reader import read_recording
from symid.robot.toml_reader import read_robot
from tests.calls import do, fail, hear


def simulate(path, *arguments, robot="two_link_elastic"):
    answer = do("simulate", robot, "-o", path, *arguments)
    return answer["result"]


def test_the_log_holds_links_motors_and_torques(tmp_path, robots_folder):
    path = tmp_path / "run.npz"
    result = simulate(path, "--trajectory", "tc", "--duration", "3", "--clean")
    assert result["period"] == pytest.approx(2e-4)
    assert (result["noise"], result["relative_noise"]) == (0.0, 0.0)
    assert result["energy_gap"] < 1e-9
    assert np.all(np.array(result["largest_torsion"]) > 1e-3)
    recording = read_recording(path, read_robot(robots_folder / "two_link_elastic.toml"))
    torsion = np.abs(recording.motor_position - recording.position).max(axis=0)
    np.testing.assert_allclose(torsion, result["largest_torsion"], rtol=1e-12)


def test_scale_delay_offset_and_noise(tmp_path):
    arguments = ("--trajectory", "ta", "--duration", "3")
    plain = simulate(tmp_path / "plain.npz", *arguments, "--clean")
    simulate(tmp_path / "wide.npz", *arguments, "--clean", "--scale", "3")
    simulate(tmp_path / "late.npz", *arguments, "--clean", "--delay", "0.001", "--offset", "0.02")
    loud = simulate(tmp_path / "loud.npz", *arguments, "--noise", "1.5")
    base, wide, late = (np.load(tmp_path / f"{name}.npz") for name in ("plain", "wide", "late"))
    assert np.abs(wide["theta"]).max() == pytest.approx(3.0 * np.abs(base["theta"]).max(), rel=0.05)
    np.testing.assert_allclose(late["q"][5:], base["q"][:-5] + 0.02, atol=1e-12)
    np.testing.assert_array_equal(late["theta"], base["theta"])
    assert (loud["noise"], loud["relative_noise"], loud["period"]) == (1.5, 0.0, pytest.approx(1e-3))
    assert (plain["delay"], plain["offset"]) == (0.0, 0.0)


def test_sensors_of_elastic_joints_are_refused_for_rigid_ones(tmp_path):
    for option in ("--delay", "--offset"):
        assert fail("simulate", "two_link", "-o", tmp_path / "a.npz", option, "0.01") == (
            2,
            "usage.rigid-sensors",
        )
    assert not list(tmp_path.iterdir())


def test_a_spring_without_values_is_refused_first(tmp_path, monkeypatch, robots_folder):
    monkeypatch.setattr("symid.codegen.cache.prepare_library", None)
    text = (robots_folder / "two_link_elastic.toml").read_text(encoding="utf-8")
    robot = tmp_path / "arm.toml"
    empty = re.sub(r"(?m)^stiffness = \d+", 'stiffness = "unknown"', text)
    robot.write_text(empty, encoding="utf-8")
    text = hear(3, "robot.no-values", "simulate", robot, "-o", tmp_path / "a.npz")
    assert "the stiffness of [joint.elasticity]" in text
