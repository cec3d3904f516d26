"""Exports of robots and of fits in memory, read back by symid and by Pinocchio."""

import pytest

import symid
from symid.api.robot_files import export_fit
from symid.dynamics.base_parameters import compute_parameter_values, derive_base_parameters
from symid.identification.stored import write_fit
from tests.estimates import build_estimate, fill_robot

pin = pytest.importorskip("pinocchio", reason="wants the package pin")


def list_values(robot):
    """Return the values of base and friction parameters that a robot file states, by name."""
    return dict(compute_parameter_values(robot, derive_base_parameters(robot)))


def test_a_fit_in_memory_becomes_the_file_that_its_own_file_becomes(tmp_path):
    robot = symid.load("two_link").description
    truth = fill_robot(robot, seed=3)
    estimate = build_estimate(truth)
    found = export_fit(robot, estimate, tmp_path / "arm.toml")
    assert (found.format, found.left_out, found.not_identified) == ("robot file", (), ())
    values = list_values(symid.load(found.file).description)
    assert values == pytest.approx({entry.name: entry.value for entry in estimate.parameters}, abs=1e-9)
    stored = write_fit(estimate, tmp_path / "fit.json")
    again = export_fit(robot, stored, tmp_path / "again.toml")
    assert again.file.read_bytes() == found.file.read_bytes()
    assert str(tmp_path / "arm.toml") in str(found)
    assert found.to_dict()["outcome"] == "consistent"
    assert repr(found) == f"<ExportedFile robot file: {tmp_path / 'arm.toml'}>"


def test_a_urdf_that_was_cut_is_written_whole(tmp_path):
    """Values that did not change stay, those beyond the cut too."""
    whole = symid.load("two_link").export(tmp_path / "whole.urdf")
    model = pin.buildModelFromUrdf(str(whole.file))
    tip = model.frames[model.getFrameId(model.names[1]) + 1].name
    cut = symid.load(whole.file, tip=tip)
    assert "robot.cut-off" in {notice.code for notice in cut.notices}
    written = cut.export(tmp_path / "cut.urdf").file
    assert written.read_bytes() == whole.file.read_bytes()
