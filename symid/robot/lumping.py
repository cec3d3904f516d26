"""Fixed joints: their links become part of the links that carry them.

Input: joints in a tree, and which of them do not move. Output: `Lumped`: the moving joints, placed exactly,
their links heavier by what is fixed to them; and where each link without a joint of its own went.

Supported: fixed joints anywhere in the tree, in a row, at the base, at the end; followers of a fixed joint,
which stand still with it; symbolic lengths.
Not supported: the sum of links in symbols (`Joint.form`): where a link with mass joins one, its numbers stay.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from symid.robot.description import Joint, Mimic
from symid.robot.geometry import IDENTITY, Placement, compose_placements
from symid.robot.inertia import move_parameters

__all__ = ["FixedFrame", "Lumped", "lump_fixed"]


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedFrame:
    """A link without a joint of its own: `name` of its fixed joint, and where it is now.

    `carrier` is the index of the moving joint whose link it belongs to, -1 for the base; `placement` the
    file's frame of the link seen from the carrier's link frame (from the base frame for -1). `has_mass` says
    whether the file gives it one.
    """

    name: str
    carrier: int
    placement: Placement
    has_mass: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Lumped:
    """A tree without its fixed joints.

    `joints` are the moving ones in their old order, `indices` the new index of each old joint (None where it
    was fixed), `frames` the links of the fixed joints in their old order.
    """

    joints: tuple[Joint, ...]
    indices: tuple[int | None, ...]
    frames: tuple[FixedFrame, ...]


def lump_fixed(
    joints: Sequence[Joint], fixed: Collection[int], symbols: Mapping[str, float] | None = None
) -> Lumped:
    """Return the tree with the links of fixed joints joined to the links before them.

    A fixed link without inertial values counts as nothing: it is a mere frame. A moving link without values
    stays without (unknown plus known is unknown). What is fixed to the base moves nowhere and is gone; its
    frame is kept in `frames`. A joint that follows a fixed joint is fixed too.

    Args:
        joints: the whole tree, fixed joints included; their kind, drive and friction do not matter. Parents
            and masters are indices into this sequence.
        fixed: indices of the joints that do not move.
        symbols: values of symbolic lengths, m.
    """
    still = set(fixed)
    still |= {index for index, joint in enumerate(joints) if joint.mimic and joint.mimic.master in still}
    moving = [index for index in range(len(joints)) if index not in still]
    positions = {old: new for new, old in enumerate(moving)}
    carriers = _find_carriers(joints, still)
    loads: dict[int, list[int]] = {}
    for index in sorted(still):
        loads.setdefault(carriers[index][0], []).append(index)
    found = []
    for old in moving:
        carrier, placement = _find_parent(joints[old], carriers)
        joint = _load(joints[old], [(joints[k], carriers[k][1]) for k in loads.get(old, [])], symbols or {})
        mimic = joint.mimic and Mimic(master=positions[joint.mimic.master], multiplier=joint.mimic.multiplier)
        parent = positions.get(carrier, -1)
        found.append(replace(joint, parent=parent, placement=placement, mimic=mimic))
    frames = tuple(
        FixedFrame(
            name=joints[index].name,
            carrier=positions.get(carriers[index][0], -1),
            placement=compose_placements(carriers[index][1], joints[index].frame),
            has_mass=_has_mass(joints[index]),
        )
        for index in sorted(still)
    )
    indices = tuple(positions.get(index) for index in range(len(joints)))
    return Lumped(joints=tuple(found), indices=indices, frames=frames)


def _find_carriers(joints: Sequence[Joint], still: Collection[int]) -> dict[int, tuple[int, Placement]]:
    """Return for every joint the moving joint (-1: the base) that its link belongs to, and where on it."""
    carriers: dict[int, tuple[int, Placement]] = {}
    for index, joint in enumerate(joints):
        carriers[index] = _find_parent(joint, carriers) if index in still else (index, IDENTITY)
    return carriers


def _find_parent(joint: Joint, carriers: Mapping[int, tuple[int, Placement]]) -> tuple[int, Placement]:
    """Return the moving joint before `joint`, and the frame of `joint` seen from its link."""
    if joint.parent < 0:
        return -1, joint.placement
    carrier, before = carriers[joint.parent]
    if before == IDENTITY:
        return carrier, joint.placement
    return carrier, compose_placements(before, joint.placement)


def _has_mass(joint: Joint) -> bool:
    return joint.form is not None or (joint.inertial is not None and any(joint.inertial))


def _load(joint: Joint, loads: Sequence[tuple[Joint, Placement]], symbols: Mapping[str, float]) -> Joint:
    """Return `joint` with the inertial values of its loads added to its own."""
    heavy = [(load, placement) for load, placement in loads if _has_mass(load)]
    if not heavy:
        return joint
    total: tuple[float, ...] | None = joint.inertial
    for load, placement in heavy:
        if total is None or load.inertial is None:
            return replace(joint, inertial=None, form=None)
        rotation = np.array([[entry.to_float() for entry in row] for row in placement.rotation])
        translation = np.array([entry.to_float(symbols) for entry in placement.translation])
        moved = move_parameters(load.inertial, rotation, translation)
        total = tuple(own + other for own, other in zip(total, moved, strict=True))
    return replace(joint, inertial=total, form=None)
