"""Blocks: joints that must be looked at together, because they share a coordinate or a drive.

Input: a robot. Output: its joints in blocks, each a connected piece of the tree with one link before it.

A joint on its own is a block. A joint that follows another one, and all joints between the two, are one
block; so are the joints that a coupled drive turns with. What a block shows of parameters does not depend
on how the blocks before and behind it move.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from symid.robot.description import Robot

__all__ = ["Block", "find_blocks"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Block:
    """Joints (indices, ascending), the link before all of them (-1 is the base), and their coordinates.

    `coordinates` are positions among the coordinates of the robot, `couplings` indices of its couplings.
    """

    base: int
    joints: tuple[int, ...]
    coordinates: tuple[int, ...]
    couplings: tuple[int, ...]


def _list_path(robot: Robot, joint: int) -> list[int]:
    """Return the joints from the base to `joint`, itself included."""
    path = []
    while joint >= 0:
        path.append(joint)
        joint = robot.joints[joint].parent
    return path[::-1]


def _span(robot: Robot, joints: frozenset[int]) -> frozenset[int]:
    """Return the joints of the smallest connected piece of the tree that holds `joints`."""
    paths = [_list_path(robot, joint) for joint in sorted(joints)]
    shortest = min(len(path) for path in paths)
    shared = 0
    # The link before the block carries all of them, and is none of them.
    while shared < shortest - 1 and all(path[shared] == paths[0][shared] for path in paths):
        shared += 1
    return frozenset(joint for path in paths for joint in path[shared:])


def _list_ties(robot: Robot) -> Iterator[frozenset[int]]:
    """Return the sets of joints that belong together, single ones first."""
    for index, joint in enumerate(robot.joints):
        yield frozenset((index,) if joint.mimic is None else (index, joint.mimic.master))
    for coupling in robot.couplings:
        yield frozenset(index for index, _ in coupling.terms)


def _merge(robot: Robot, groups: list[frozenset[int]]) -> list[frozenset[int]]:
    merged: list[frozenset[int]] = []
    for group in groups:
        whole = _span(robot, group)
        apart = [other for other in merged if not other & whole]
        for other in merged:
            whole = whole | other if other & whole else whole
        merged = [*apart, whole]
    return merged


def find_blocks(robot: Robot) -> tuple[Block, ...]:
    """Return the blocks of the robot; the block of a link stands before those that hang on it."""
    groups = _merge(robot, list(_list_ties(robot)))
    while len(again := _merge(robot, groups)) < len(groups):
        groups = again
    transmission = robot.transmission
    blocks = []
    for group in sorted(map(sorted, again)):
        coordinates = {position for index in group for position, _ in transmission[index]}
        couplings = [
            k for k, coupling in enumerate(robot.couplings) if {i for i, _ in coupling.terms} & set(group)
        ]
        blocks.append(
            Block(
                base=robot.joints[group[0]].parent,
                joints=tuple(group),
                coordinates=tuple(sorted(coordinates)),
                couplings=tuple(couplings),
            )
        )
    return tuple(blocks)
