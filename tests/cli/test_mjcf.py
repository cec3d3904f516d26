"""MJCF models on the command line: read, converted, and written in place with identified values."""

import dataclasses
import re

import numpy as np
import pytest

from symid.robot import read_robot
from symid.robot.mjcf_reader import read_xml_robot
from tests.calls import do, find_codes, refuse, say
from tests.estimates import store_estimate

MODEL = """<mujoco model="arm">
  <!-- two axes -->
  <default><joint damping="0.5" armature="0.1"/></default>
  <worldbody>
    <body name="upper" pos="0 0 0.3">
      <joint name="shoulder" axis="0 1 0" range="-90 90"/>
      <inertial pos="0.2 0 0" quat="1 0.1 0 0" mass="3" diaginertia="0.05 0.06 0.02"/>
      <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.05"/>
      <body name="lower" pos="0.4 0 0">
        <joint name="elbow" axis="0 1 0" frictionloss="0.2"/>
        <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.04"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="shoulder" gear="100"/></actuator>
</mujoco>
"""
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e-?\d+)?")


@pytest.fixture
def model(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.xml").write_text(MODEL, encoding="utf-8")
    return tmp_path / "arm.xml"


def test_models_are_checked_and_cut(model):
    answer = do("check", model)
    assert answer["result"]["convention"] == "mjcf"
    assert find_codes(answer) == {"robot.mjcf-unused"}
    part = do("base", model, "--base", "upper")
    assert {entry["joint"] for entry in part["result"]["parameters"]} == {"elbow"}
    assert "arm, 2 joints, MJCF: no mistakes" in say("check", model)


@pytest.mark.parametrize("option", ["--from-mjcf", "--from-urdf"])
def test_values_go_into_the_model_that_a_robot_file_was_made_from(model, tmp_path, option):
    do("new", "arm.toml", option, "arm.xml")
    robot = read_robot(tmp_path / "arm.toml")
    assert robot.made_from.file == str(model)
    store_estimate(robot, tmp_path / "estimate.json")
    do("export", "arm.toml", "-o", "same.xml")
    assert do("export", "arm.toml", "estimate.json", "-o", "new.xml")["result"]["format"] == "MJCF model"
    do("export", "arm.xml", "estimate.json", "-o", "other.xml")
    assert model.read_text(encoding="utf-8") == MODEL
    do("export", "arm.toml", "estimate.json", "--in-place")
    text = model.read_text(encoding="utf-8")
    assert text == (tmp_path / "new.xml").read_text(encoding="utf-8")
    added = re.compile(r' (?:armature|damping|frictionloss)="[^"]*"|\s*<inertial pos[^>]*fullinertia[^>]*>')
    before, after = (NUMBER.sub("#", added.sub("", entry)) for entry in (MODEL, text))
    assert after == before
    back = read_xml_robot(model)
    for old, new in zip(robot.joints, back.joints, strict=True):
        assert (new.name, new.placement) == (old.name, old.placement)
        assert np.isfinite(new.inertial).all()


def test_a_new_model_is_written_where_the_old_one_has_no_place(model, tmp_path):
    parts = MODEL.replace('model="arm"', "")
    (tmp_path / "parts.xml").write_text(parts, encoding="utf-8")
    model.write_text('<mujoco model="arm"><include file="parts.xml"/></mujoco>', encoding="utf-8")
    robot = read_xml_robot(model)
    joints = tuple(
        dataclasses.replace(joint, inertial=tuple(1.1 * value for value in joint.inertial))
        for joint in robot.joints
    )
    store_estimate(dataclasses.replace(robot, joints=joints), tmp_path / "estimate.json")
    assert "export.new-file" in find_codes(do("export", "arm.xml", "estimate.json", "-o", "new.xml"))
    assert len(read_xml_robot(tmp_path / "new.xml").joints) == 2
    assert refuse("export", "arm.xml", "estimate.json", "--in-place") == (3, ["robot.mjcf-include"] * 3)
    assert (tmp_path / "parts.xml").read_text(encoding="utf-8") == parts
