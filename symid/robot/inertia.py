"""Inertial parameters of links: in any frame, whether a body can have them, and links on fixed joints.

Mass, centre of mass, inertia -> XX XY XZ YY YZ ZZ MX MY MZ M about the origin of a frame, where XY, XZ, YZ
are entries of the inertia tensor (XY = - integral of x y dm). Joints in a tree and which of them are fixed
-> `Lumped`: the moving joints, their links heavier by what is fixed to them.

Supported: any frame on the link; fixed joints anywhere in the tree; followers of a fixed joint, which stand
still with it; symbolic lengths.
Not supported: masses that are not positive; the sum of links in symbols (`Joint.form`): where a link with
mass joins one, its numbers stay.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray
from symid.robot.description import FixedBody, Joint, LinkPlace
from symid.robot.geometry import IDENTITY, Placement, compose_placements, to_floats

TENSOR = ("xx", "xy", "xz", "yy", "yz", "zz")
"""The entries of an inertia tensor, in their order."""

Parameters = tuple[float, ...]
"""XX XY XZ YY YZ ZZ MX MY MZ M of a link."""
# Of ten parameters, in units of the link's own size: what rounding leaves.
_SAME = 1e-9
# A flat or thin link sits on the edge of what is possible; rounding of its decimals may cross it.
_TOLERANCE = 1e-6


def to_tensor(entries: Sequence[float]) -> FloatArray:
    """Return the matrix (3, 3) of xx xy xz yy yz zz."""
    xx, xy, xz, yy, yz, zz = entries
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=np.float64)


def move_parameters(old: Sequence[float], rotation: FloatArray, translation: FloatArray) -> Parameters:
    """Return the ten parameters seen from another frame (theorem of Huygens and Steiner).

    I' = R I R^T + 2 (p.s) 1 - p s^T - s p^T + M (p.p 1 - p p^T),  s = R l,  l' = s + M p.

    Args:
        old: (10,) about the old frame's origin, in its axes.
        rotation: (3, 3) R, the old frame's axes in the new frame.
        translation: (3,) p, the old frame's origin in the new frame, m.
    """
    mass = float(old[9])
    p = np.asarray(translation, dtype=np.float64)
    s = rotation @ np.asarray(old[6:9], dtype=np.float64)
    tensor = rotation @ to_tensor(old[:6]) @ rotation.T
    tensor = tensor + 2 * (p @ s) * np.eye(3) - np.outer(p, s) - np.outer(s, p)
    tensor = tensor + mass * ((p @ p) * np.eye(3) - np.outer(p, p))
    entries = (*tensor[np.triu_indices(3)], *(s + mass * p), mass)
    return tuple(float(entry) + 0.0 for entry in entries)


def to_matrix(placement: Placement, values: Mapping[str, float] | None = None) -> FloatArray:
    """Return a placement as a matrix (4, 4), lengths in m, symbols by `values`."""
    shift = [[entry.to_float(values)] for entry in placement.translation]
    return np.block([[np.array(to_floats(placement)), np.array(shift)], [np.eye(4)[3:]]])


def move_by_placement(
    parameters: Sequence[float],
    placement: Placement,
    symbols: Mapping[str, float] | None = None,
    *,
    inverse: bool = False,
) -> Parameters:
    """Return ten parameters of the frame `placement` as seen from outside; `inverse`: the other way round."""
    rotation = np.array(to_floats(placement))
    translation = np.array([entry.to_float(symbols) for entry in placement.translation])
    if inverse:
        rotation, translation = rotation.T, -rotation.T @ translation
    return move_parameters(parameters, rotation, translation)


def split_body(parameters: Sequence[float]) -> tuple[float, list[float], tuple[float, ...]]:
    """Return mass (kg), centre of mass (m, zero without mass), inertia about it (6,) of ten parameters."""
    mass = float(parameters[9])
    com = [float(value) / mass for value in parameters[6:9]] if mass else [0.0, 0.0, 0.0]
    return mass, com, move_parameters(parameters, np.eye(3), -np.array(com))[:6]


def is_same_body(new: Sequence[float] | None, old: Sequence[float] | None) -> bool:
    """Return whether ten parameters, None where unknown, differ by no more than rounding.

    Inertias may differ by 1e-9 of the link's largest entry J, its mass M by 1e-9 of itself, first moments by
    1e-9 of their largest or of sqrt(J M): those of a link that is balanced at its joint are rounding only.
    """
    if new is None or old is None:
        return new is old
    one, two = np.asarray(new, dtype=np.float64), np.asarray(old, dtype=np.float64)
    both = np.maximum(np.abs(one), np.abs(two))
    inertia, mass = both[:6].max(), both[9]
    sizes = np.repeat([inertia, max(both[6:9].max(), np.sqrt(inertia * mass)), mass], (6, 3, 1))
    return bool(np.all(np.abs(one - two) <= _SAME * sizes))


def compute_standard_parameters(mass: float, com: Sequence[float], inertia: Sequence[float]) -> Parameters:
    """Return the ten parameters of a link: mass (kg), centre of mass (3,) in m, and inertia about it.

    The latter (6,) is xx xy xz yy yz zz along the frame's axes, in kg m^2.
    """
    return move_parameters((*inertia, 0.0, 0.0, 0.0, mass), np.eye(3), np.asarray(com, dtype=np.float64))


def build_pseudo_inertias(parameters: FloatArray) -> FloatArray:
    """Return the pseudo-inertias (n, 4, 4) of standard parameters (n, 10)."""
    xx, xy, xz, yy, yz, zz, mx, my, mz, mass = np.asarray(parameters, dtype=np.float64).T
    half = 0.5 * (xx + yy + zz)
    rows = [[half - xx, -xy, -xz, mx], [-xy, half - yy, -yz, my], [-xz, -yz, half - zz, mz]]
    return np.array([*rows, [mx, my, mz, mass]], dtype=np.float64).transpose(2, 0, 1)


def explain_impossible_inertia(parameters: Sequence[float]) -> str:
    """Return what keeps the ten parameters from belonging to a body of positive mass, or nothing.

    The principal moments J about the centre of mass must be positive, or zero, and none may exceed the
    sum of the others; equivalently the second moments are a positive semi-definite matrix
    (Wensing, Kim and Slotine 2018, IEEE Robotics and Automation Letters 3(1)).
    """
    low, middle, high = (float(J) for J in np.linalg.eigvalsh(to_tensor(split_body(parameters)[2])))
    allowed = _TOLERANCE * max(float(np.abs(parameters[:6]).max()), 1e-300)
    shown = [f"{J if abs(J) > allowed else 0.0:.6g}" for J in (low, middle, high)]
    listed = f"{shown[0]}, {shown[1]} and {shown[2]} kg*m^2"
    if low < -allowed:
        return f"the principal moments about the centre of mass are {listed}, and none can be negative"
    if high > low + middle + allowed:
        rule = "none can exceed the sum of the others"
        return f"the principal moments about the centre of mass are {listed}, and {rule}"
    return ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Lumped:
    """The moving joints of a tree, the new index of each old joint (None: fixed), links of fixed joints.

    A link on a fixed joint has the name of that joint in `frames`; `bodies` are those with mass that move.
    """

    joints: tuple[Joint, ...]
    indices: tuple[int | None, ...]
    frames: tuple[LinkPlace, ...]
    bodies: tuple[FixedBody, ...]


def lump_fixed_joints(
    joints: Sequence[Joint], fixed: Collection[int], symbols: Mapping[str, float] | None = None
) -> Lumped:
    """Return the tree with the links of fixed joints joined to the links before them.

    A fixed link without inertial values is a mere frame. A moving link without values stays without (unknown
    plus known is unknown). What is fixed to the base is in `frames` only. A joint that follows a fixed joint
    is fixed too. `joints` is the whole tree, `fixed` has indices into it; symbols have values in m.
    """
    still = set(fixed)
    still |= {index for index, joint in enumerate(joints) if joint.mimic and joint.mimic.master in still}
    moving = [index for index in range(len(joints)) if index not in still]
    positions = {old: new for new, old in enumerate(moving)}
    # For every joint the moving joint (-1: the base) that its link belongs to, and where on it.
    carriers: dict[int, tuple[int, Placement]] = {-1: (-1, IDENTITY)}
    for index, joint in enumerate(joints):
        carriers[index] = _locate_parent(joint, carriers) if index in still else (index, IDENTITY)
    loads: dict[int, list[int]] = {}
    for index in sorted(still):
        loads.setdefault(carriers[index][0], []).append(index)
    found, bodies = [], []
    for old in moving:
        carrier, placement = _locate_parent(joints[old], carriers)
        joint = joints[old]
        for k in loads.get(old, []):
            if has_mass(joints[k]):
                whole, added = joint.inertial, joints[k].inertial
                moved = None if added is None else move_by_placement(added, carriers[k][1], symbols)
                own = joints[old].inertial
                bodies.append(FixedBody(name=joints[k].name, carrier=joint.name, inertial=moved, own=own))
                total = None
                if whole is not None and moved is not None:
                    total = tuple(a + b for a, b in zip(whole, moved, strict=True))
                joint = replace(joint, inertial=total, form=None)
        mimic = joint.mimic and replace(joint.mimic, master=positions[joint.mimic.master])
        found.append(replace(joint, parent=positions.get(carrier, -1), placement=placement, mimic=mimic))
    frames = tuple(
        LinkPlace(
            name=joints[index].name,
            joint=positions.get(carriers[index][0], -1),
            placement=compose_placements(carriers[index][1], joints[index].frame),
        )
        for index in sorted(still)
    )
    indices = tuple(positions.get(index) for index in range(len(joints)))
    return Lumped(joints=tuple(found), indices=indices, frames=frames, bodies=tuple(bodies))


def _locate_parent(joint: Joint, carriers: Mapping[int, tuple[int, Placement]]) -> tuple[int, Placement]:
    """Return the moving joint before `joint`, and the frame of `joint` seen from its link."""
    carrier, before = carriers[joint.parent]
    return carrier, compose_placements(before, joint.placement)


def has_mass(joint: Joint) -> bool:
    """Return whether the file states a link that is more than a frame."""
    return joint.form is not None or (joint.inertial is not None and any(joint.inertial))
