"""Random trees written as URDFs and read back; and URDFs with mistakes, which never end in a traceback."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from symid.errors import RobotError
from symid.robot.description import JointKind
from symid.robot.mjcf_reader import parse_xml_robot
from symid.robot.simulator_writers import write_urdf
from tests.chains import draw_parameters, find_pinocchio_torques, set_inertia, spread, trees
from tests.unit.robot.test_urdf import ARM
from tests.urdfs import draw_urdf, find_largest_gap, find_positions, find_torques

pin = pytest.importorskip("pinocchio", reason="wants the package pin")

WORDS = """base|upper|lift|revolute|fixed|floating|nan|1e400|-1e-400|0 0 0|0 0 1 2||<|>|/>|"|&lt;|&x;|\
<!DOCTYPE a>|<mimic joint='lift'/>|<mimic joint='push' multiplier='0'/>|<link name='upper'/>|\
<joint name='lift'/>|<loop_joint/>|xacro:if|${x}|\x00|\ud800|é"""
PIECES = (*WORDS.split("|"), "slide", "tool", "1e-31 1e29 1", "9" * 200, "<a>" * 150)
"""What may stand in a file."""


@settings(max_examples=60)
@given(robot=trees(most=5), seed=st.integers(0, 2**16))
def test_what_is_written_and_read_is_what_pinocchio_reads(robot, seed):
    rng = np.random.default_rng(seed)
    values = draw_parameters(rng, robot.size)
    text = write_urdf(set_inertia(robot, values))
    back = parse_xml_robot(text)
    theirs = pin.buildModelFromXML(text)
    state = rng.uniform(-2, 2, (3, robot.size))
    spread = np.zeros_like(state)
    order = [joint.name for joint in back.joints]
    for k, joint in enumerate(robot.joints):
        spread[:, order.index(joint.name)] = state[:, k]
    found = find_pinocchio_torques(back, spread)
    expected = find_torques(theirs, back, spread)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
    written = replace(set_inertia(robot, values), gravity=back.gravity)
    places = [order.index(joint.name) for joint in robot.joints]
    np.testing.assert_allclose(find_pinocchio_torques(written, state), expected[places], rtol=1e-9, atol=1e-9)
    assert all(np.isfinite(joint.inertial).all() for joint in back.joints)
    assert {joint.kind for joint in back.joints} <= set(JointKind)


@settings(max_examples=80)
@given(seed=st.integers(0, 2**20), size=st.integers(1, 7))
def test_torques_and_frames_are_those_that_pinocchio_reads(seed, size):
    rng = np.random.default_rng(seed)
    text, followers = draw_urdf(rng, size)
    try:
        robot = parse_xml_robot(text)
    except RobotError as error:
        assert {notice.code for notice in error.notices} == {"robot.no-joints"}  # noqa: PT017
        return
    theirs = pin.buildModelFromXML(text)
    for _ in range(3):
        masters = rng.uniform(-2, 2, (3, robot.freedom))
        state = np.array([spread(robot, row) for row in masters])
        own, positions = find_positions(robot, followers, masters[0])
        np.testing.assert_allclose(own, state[0])
        expected = find_torques(theirs, robot, np.array([positions, state[1], state[2]]))
        found = find_pinocchio_torques(robot, state)
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
        assert find_largest_gap(theirs, robot, own, positions) < 1e-10


def read(text):
    """Read a text; what is refused must say why and where."""
    notices = ()
    try:
        assert parse_xml_robot(text, "arm.urdf").joints
    except RobotError as error:
        notices = error.notices or [None]
    for notice in notices:
        assert notice.code.startswith("robot.")
        assert notice.text
        assert notice.file == "arm.urdf"


QUOTES = [place for place, letter in enumerate(ARM) if letter == '"']
SPANS = st.one_of(
    st.tuples(st.integers(0, len(ARM)), st.integers(0, 60)).map(lambda span: (span[0], sum(span))),
    st.sampled_from([(start + 1, end) for start, end in zip(QUOTES[::2], QUOTES[1::2], strict=True)]),
)


@settings(max_examples=700)
@given(span=SPANS, piece=st.sampled_from(PIECES))
def test_a_piece_or_a_value_in_place_of_another_never_ends_in_a_traceback(span, piece):
    read(ARM[: span[0]] + piece + ARM[span[1] :])
