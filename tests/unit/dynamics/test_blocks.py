"""Joints that must be looked at together."""

from dataclasses import replace
from fractions import Fraction

import pytest

from symid.dynamics.observable_subspace import split_into_blocks
from symid.robot.description import Coupling
from tests.chains import build_chain, build_joint, follow

ROW = (0.3, 0.1, 0.2, "q")
COUPLING = Coupling(name="m3", terms=((1, Fraction(1)), (2, Fraction(1))), has_rotor=True)


def build(size, **parents):
    """Return a chain, some of whose joints (j3 is number 3) hang on another link."""
    chain = build_chain([ROW] * size)
    joints = list(chain.joints)
    for name, parent in parents.items():
        joints[int(name[1:])] = build_joint(int(name[1:]), ROW, parent=parent)
    return replace(chain, joints=tuple(joints))


@pytest.mark.parametrize(
    ("robot", "blocks"),
    [
        (build(3), [(-1, (0,)), (0, (1,)), (1, (2,))]),
        # A follower takes what lies between.
        (follow(build(5), 3, 1), [(-1, (0,)), (0, (1, 2, 3)), (3, (4,))]),
        # Two fingers hang on one hand.
        (follow(build(4, j3=1), 3, 2), [(-1, (0,)), (0, (1,)), (1, (2, 3))]),
        # Blocks that overlap are one.
        (follow(follow(build(6), 2, 0), 4, 1), [(-1, (0, 1, 2, 3, 4)), (4, (5,))]),
        (replace(build(4), couplings=(COUPLING,)), [(-1, (0,)), (0, (1, 2)), (2, (3,))]),
        # Arms that follow each other are one block from the base.
        (follow(build(4, j2=-1), 3, 1), [(-1, (0, 1, 2, 3))]),
    ],
)
def test_blocks_are_joints_that_belong_together(robot, blocks):
    found = split_into_blocks(robot)
    assert [(block.base, block.joints) for block in found] == blocks
    assert sum((block.couplings for block in found), ()) == tuple(range(len(robot.couplings)))
    assert sorted(sum((block.coordinates for block in found), ())) == list(range(robot.freedom))
