"""Fixed joints: their links become part of the links that carry them."""

from dataclasses import replace

import numpy as np

from symid.robot.description import SymbolicInertia
from symid.robot.geometry import ONE, ZERO, Exact, compose_placements, to_floats, translate
from symid.robot.inertia import lump_fixed_joints
from tests.chains import build_joint, draw_parameters

ROWS = [(0.3, 0.1, 0.2, "q"), (np.pi / 2, 0.3, -0.1, "q"), (0.5, 0, 0.25, "q"), (-1.0, 0.2, 0.1, "q")]


def build(parents=(-1, 0, 1, 2), values=None):
    joints = [
        build_joint(index, row, parent=parent)
        for index, (row, parent) in enumerate(zip(ROWS, parents, strict=True))
    ]
    if values is None:
        values = draw_parameters(np.random.default_rng(3), len(ROWS))
    return [
        replace(joint, inertial=None if entry is None else tuple(entry))
        for joint, entry in zip(joints, values, strict=True)
    ]


def test_frames_are_seen_from_their_carrier():
    joints = build(parents=(-1, 0, 1, 0))
    lumped = lump_fixed_joints(joints, {1, 2})
    assert [(frame.name, frame.joint) for frame in lumped.frames] == [("joint2", 0), ("joint3", 0)]
    assert lumped.frames[1].placement == compose_placements(joints[1].placement, joints[2].placement)
    assert [joint.parent for joint in lumped.joints] == [-1, 0]
    assert lumped.indices == (0, None, None, 1)


def test_bodies_are_seen_from_their_carrier():
    joints = build(parents=(-1, 0, 1, 0))
    lumped = lump_fixed_joints(joints, {1, 2})
    assert [(body.name, body.carrier) for body in lumped.bodies] == [
        ("joint2", "joint1"),
        ("joint3", "joint1"),
    ]
    whole = np.sum([body.inertial for body in lumped.bodies], axis=0) + joints[0].inertial
    np.testing.assert_allclose(lumped.joints[0].inertial, whole, rtol=1e-14)
    # The moment of the second: its mass times the place of its centre.
    frame = compose_placements(joints[1].placement, joints[2].placement)
    centre = np.array(to_floats(frame)) @ joints[2].inertial[6:9]
    centre += joints[2].inertial[9] * np.array([value.to_float() for value in frame.translation])
    np.testing.assert_allclose(lumped.bodies[1].inertial[6:9], centre, rtol=1e-12)
    assert all(body.own == joints[0].inertial for body in lumped.bodies)
    # What is fixed to the base moves with nothing.
    assert lump_fixed_joints(joints, {0}).bodies == ()


def test_unknown_values():
    values = draw_parameters(np.random.default_rng(3), 4)
    # A frame without mass changes nothing.
    joints = build(values=[values[0], None, values[2], values[3]])
    assert lump_fixed_joints(joints, {1}).joints[0].inertial == joints[0].inertial
    # What is unknown stays unknown, whatever is fixed to it.
    joints = build(values=[None, values[1], values[2], values[3]])
    assert lump_fixed_joints(joints, {1}).joints[0].inertial is None


def test_symbolic_lengths_take_part():
    joints = build()
    joints[1] = replace(joints[1], placement=translate(Exact.symbol("L1"), ZERO, ZERO))
    lumped = lump_fixed_joints(joints, {1}, {"L1": 0.5})
    mass = joints[1].inertial[9]
    assert lumped.joints[0].inertial[9] == joints[0].inertial[9] + mass
    moment = joints[0].inertial[6] + joints[1].inertial[6] + 0.5 * mass
    np.testing.assert_allclose(lumped.joints[0].inertial[6], moment)
    assert (
        lumped.joints[1].placement.translation[0] == Exact.symbol("L1") + joints[2].placement.translation[0]
    )


def test_a_form_in_symbols_stays_only_where_nothing_with_mass_joins():
    form = SymbolicInertia(mass=Exact.symbol("m1"), com=(ZERO, ZERO, ZERO), inertia=(ONE,) * 6)
    joints = build(values=[None, None, None, None])
    joints[0] = replace(joints[0], form=form)
    assert lump_fixed_joints(joints, {1}).joints[0].form == form
    joints[1] = replace(joints[1], inertial=(1.0,) * 10)
    assert lump_fixed_joints(joints, {1}).joints[0].form is None
