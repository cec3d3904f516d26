"""Payloads as controllers take them, against Pinocchio's frames and inertias."""

import json
import re

import numpy as np
import pytest

from symid.dynamics.payload import PAYLOAD_QUANTITIES, Payload, PayloadQuantity
from symid.errors import EstimateError, IdentifiabilityError, UsageError
from symid.identification.payload import build_payload_command
from symid.robot.inertia import compute_standard_parameters
from symid.robot.mjcf_reader import parse_xml_robot as parse_urdf
from symid.robot.toml_reader import read_robot
from tests.refusals import raises

pin = pytest.importorskip("pinocchio", reason="wants the package pin")

MASS, CENTRE, INERTIA = 1.5, (0.03, -0.02, 0.09), (0.004, 0.0003, -0.0002, 0.005, 0.0001, 0.003)
WRIST = """<robot name="wrist">
  <link name="base_link"/>
  <link name="upper"><inertial><mass value="2"/><origin xyz="0.1 0 0"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="hand"><inertial><mass value="1"/><origin xyz="0 0 0.1"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="plate"/>
  <link name="flange"/>
  <joint name="a" type="continuous"><parent link="base_link"/><child link="upper"/><axis xyz="0 1 0"/></joint>
  <joint name="b" type="continuous"><parent link="upper"/><child link="hand"/>
    <origin xyz="0.3 0 0.1" rpy="0.4 0 0.2"/><axis xyz="1 0 0"/></joint>
  <joint name="c" type="fixed"><parent link="hand"/><child link="plate"/>
    <origin xyz="0.05 -0.02 0.1" rpy="0.3 -0.5 1.1"/></joint>
  <joint name="d" type="fixed"><parent link="plate"/><child link="flange"/>
    <origin xyz="0 0 0.03" rpy="0 1.2 0"/></joint>
</robot>
"""
BODY = pin.Inertia(
    MASS, np.array(CENTRE), np.array([INERTIA[:3], [INERTIA[1], *INERTIA[3:5]], [*INERTIA[2::2], INERTIA[5]]])
)


def carry(joint, refused=(), scale=1.0):
    """Return the payload in the file's frame of a link; `refused` of its quantities are not identified."""
    values = (MASS, *CENTRE, *(scale * entry for entry in INERTIA))
    quantities = tuple(
        PayloadQuantity(name=name, unit="", value=None, std=None, reason="lost in noise")
        if name in refused
        else PayloadQuantity(name=name, unit="", value=value, std=1e-3)
        for name, value in zip(PAYLOAD_QUANTITIES, values, strict=True)
    )
    standard = np.array(compute_standard_parameters(MASS, CENTRE, INERTIA))
    rest = {"chi2": 1.0, "freedom": 1, "scale": 1.0, "moved": 0.0, "unexplained": (), "friction": ()}
    return Payload(joint=joint, quantities=quantities, standard=standard, **rest)


def command_wrist(controller, frame="flange", refused=(), tip=None, **options):
    """Return the command of the wrist's payload, given in the file's frame of its hand."""
    robot = parse_urdf(WRIST, tip=tip)
    return build_payload_command(robot, carry("b", refused, **options), controller, frame)


def find_expected(base, frame):
    """Return the payload, given in the frame `base` of the URDF, as an inertia in `frame`, by Pinocchio."""
    model = pin.buildModelFromXML(WRIST)
    places = [model.frames[model.getFrameId(name, pin.BODY)].placement for name in (base, frame)]
    return (places[0].inverse() * places[1]).actInv(BODY)


def assert_same(command, body):
    assert command.mass == pytest.approx(body.mass, rel=1e-15)
    np.testing.assert_allclose(command.com, body.lever, atol=1e-14)
    np.testing.assert_allclose(command.inertia, body.inertia[np.triu_indices(3)], atol=1e-15)


@pytest.mark.parametrize(
    ("frame", "tip"),
    [("hand", None), ("plate", None), ("flange", None), ("hand", "plate"), ("plate", "plate")],
)
def test_a_link_of_the_urdf_is_the_flange(frame, tip):
    # With a tip its frame is that of the last link, in which payloads are given then.
    assert_same(command_wrist("ur", frame, tip=tip), find_expected(tip or "hand", frame))


def test_the_link_frame_is_the_default_and_said():
    command = command_wrist("franka", None)
    assert_same(command, BODY)
    told = [(notice.code, notice.is_note) for notice in command.notices]
    assert told == [("payload.controller-frame", False), ("payload.controller-scope", True)]
    assert "one of the links hand, plate, flange" in command.notices[0].text
    assert command.frame == "the link frame of joint 'b'"


@pytest.mark.parametrize("given", ["0.1,-0.2,0.3,0.4,-0.5,2.6", (0.1, -0.2, 0.3, 0.4, -0.5, 2.6)])
def test_numbers_are_a_frame(given, robots_folder):
    robot = read_robot(robots_folder / "two_link.toml")
    command = build_payload_command(robot, carry("elbow"), "ur", given)
    place = pin.SE3(pin.rpy.rpyToMatrix(0.4, -0.5, 2.6), np.array([0.1, -0.2, 0.3]))
    assert_same(command, place.actInv(BODY))
    assert [notice.code for notice in command.notices] == ["payload.controller-scope"]


def read_lists(text):
    return [
        [float(part) for part in entry.split(",")] for entry in re.findall(r"[\[{]([-\d., ]+)[\]}]", text)
    ]


def test_universal_robots_get_a_line_of_urscript():
    command = command_wrist("ur")
    text = command.texts["URScript"]
    assert re.fullmatch(r"set_target_payload\(1\.5, \[[^]]+\], \[[^]]+\]\)", text)
    assert "e" not in text.replace("set_target_payload", "")
    com, inertia = read_lists(text)
    np.testing.assert_allclose(com, command.com, rtol=1e-8)
    np.testing.assert_allclose(inertia, np.array(command.inertia)[[0, 3, 5, 1, 2, 4]], rtol=1e-8)
    assert command.texts["URScript, older"] == text.split("], [")[0].replace("set_target", "set") + "])"
    assert "5.10" in command.notices[-1].text
    assert command.text.startswith("for ur, in the frame of the link 'flange':\nURScript: set_target")


def test_franka_gets_columns():
    command, body = command_wrist("franka"), find_expected("hand", "flange")
    columns, call = body.inertia.T.ravel(), command.texts["libfranka"]
    assert call.startswith("robot.setLoad(1.5, {{")
    com, inertia = read_lists(call)
    np.testing.assert_allclose(com, body.lever, rtol=1e-8)
    np.testing.assert_allclose(inertia, columns, rtol=1e-8)
    desk = json.loads(command.texts["endeffector-config.json"])
    assert list(desk) == ["mass", "centerOfMass", "inertia"]
    np.testing.assert_allclose(desk["inertia"], columns, rtol=1e-8)
    assert read_lists(command.texts["franka_msgs/SetLoad"]) == [com, inertia]


@pytest.mark.parametrize(("controller", "left"), [("ur", "left out"), ("franka", "written as zero")])
def test_an_inertia_that_is_not_identified_is_left_out(controller, left):
    command = command_wrist(controller, refused=("Jxy", "Jzz"))
    assert command.inertia is None
    (notice, _) = command.notices
    assert notice.code == "payload.controller-inertia"
    assert left in notice.text
    assert "Jxy, Jzz not identified" in notice.text
    lists = [read_lists(text) for text in command.texts.values()]
    if controller == "ur":
        assert [len(entry) for entry in lists] == [1, 1]
    else:
        assert [entry[1] for entry in lists] == [[0.0] * 9] * 3


@pytest.mark.parametrize("name", ["cx", "cy", "cz"])
def test_a_centre_that_is_not_identified_is_refused(name):
    with raises(IdentifiabilityError, "payload.controller-centre", match=f"{name}: lost in noise"):
        command_wrist("ur", refused=(name,))


def test_limits_of_the_controller_are_checked():
    with raises(EstimateError, "payload.controller-limit", match=r"at most 133 kg m\^2"):
        command_wrist("ur", scale=5e4)
    assert command_wrist("franka", scale=5e4).inertia


FRAME = "usage.payload-frame"


@pytest.mark.parametrize(
    ("controller", "frame", "code", "words"),
    [
        ("kuka", None, "usage.controller", "known are ur, franka"),
        ("ur", "flnage", FRAME, "there is no link 'flnage', did you mean "),
        ("ur", "upper", FRAME, r"is moved by joint 'a'; --frame takes a link on joint 'b' \(hand,"),
        ("ur", "1,2,3", FRAME, "expected the name of a link, or six numbers"),
        ("ur", (1, 2, 3, 4, 5, float("nan")), FRAME, "six numbers"),
    ],
)
def test_wrong_calls_are_told(controller, frame, code, words):
    with raises(UsageError, code, match=words):
        command_wrist(controller, frame)
    # A link that was cut off is no flange.
    with raises(UsageError, FRAME):
        command_wrist("ur", tip="plate")
