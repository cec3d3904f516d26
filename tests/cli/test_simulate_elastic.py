"""`symid simulate` of elastic robots: sensors as told, refusals."""

import re

import numpy as np
import pytest

from tests.calls import do, hear


def simulate(path, *arguments, robot="two_link_elastic"):
    answer = do("simulate", robot, "-o", path, *arguments)
    return answer["result"]


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


def test_a_spring_without_values_is_refused_first(tmp_path, monkeypatch, robots_folder):
    monkeypatch.setattr("symid.codegen.cache.prepare_library", None)
    text = (robots_folder / "two_link_elastic.toml").read_text(encoding="utf-8")
    robot = tmp_path / "arm.toml"
    empty = re.sub(r"(?m)^stiffness = \d+", 'stiffness = "unknown"', text)
    robot.write_text(empty, encoding="utf-8")
    text = hear(3, "robot.no-values", "simulate", robot, "-o", tmp_path / "a.npz")
    assert "the stiffness of [joint.elasticity]" in text
