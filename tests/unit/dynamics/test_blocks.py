"""Joints that must be looked at together."""

from dataclasses import replace
from fractions import Fraction

from symid.dynamics.observable_subspace import split_into_blocks
from symid.robot.description import Coupling
from tests.chains import build_chain, build_joint, follow

ROW = (0.3, 0.1, 0.2, "q")


def list_blocks(robot):
    return [(block.base, block.joints) for block in split_into_blocks(robot)]


def test_every_joint_is_a_block_of_its_own():
    assert list_blocks(build_chain([ROW] * 3)) == [(-1, (0,)), (0, (1,)), (1, (2,))]


def test_a_follower_takes_what_lies_between():
    robot = follow(build_chain([ROW] * 5), 3, 1)
    assert list_blocks(robot) == [(-1, (0,)), (0, (1, 2, 3)), (3, (4,))]
    assert [block.coordinates for block in split_into_blocks(robot)] == [(0,), (1, 2), (3,)]


def test_two_fingers_hang_on_one_hand():
    hand = build_chain([ROW] * 4)
    joints = [*hand.joints[:3], build_joint(3, ROW, parent=1)]
    robot = follow(replace(hand, joints=tuple(joints)), 3, 2)
    assert list_blocks(robot) == [(-1, (0,)), (0, (1,)), (1, (2, 3))]


def test_blocks_that_overlap_are_one():
    robot = follow(follow(build_chain([ROW] * 6), 2, 0), 4, 1)
    assert list_blocks(robot) == [(-1, (0, 1, 2, 3, 4)), (4, (5,))]


def test_a_coupled_drive_joins_its_joints():
    coupling = Coupling(name="m3", terms=((1, Fraction(1)), (2, Fraction(1))), has_rotor=True)
    robot = replace(build_chain([ROW] * 4), couplings=(coupling,))
    assert list_blocks(robot) == [(-1, (0,)), (0, (1, 2)), (2, (3,))]
    assert [block.couplings for block in split_into_blocks(robot)] == [(), (0,), ()]


def test_arms_that_follow_each_other_are_one_block_from_the_base():
    two = build_chain([ROW] * 4)
    joints = (two.joints[0], two.joints[1], build_joint(2, ROW, parent=-1), build_joint(3, ROW, parent=2))
    robot = follow(replace(two, joints=joints), 3, 1)
    assert list_blocks(robot) == [(-1, (0, 1, 2, 3))]
