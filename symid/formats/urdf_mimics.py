"""Who follows whom: the `<mimic>` elements of a URDF, followed to the joint that follows no other.

Input: the joints of the file and those that belong to the robot. Output: a `Follower` for each joint that
follows another one.

A joint that follows a fixed joint, one before the base, or with the factor 0, stands still at its offset. One
whose master was cut off keeps a coordinate of its own.

Supported: chains of followers, in any order in the file.
Not supported: rings of followers.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from symid.formats.urdf_elements import Element
from symid.formats.urdf_joints import UrdfJoint
from symid.formats.urdf_values import Reading, find_only, read_decimal, read_name

__all__ = ["Follower", "read_followers"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Follower:
    """q = multiplier * (q of `master`) + offset; the offset alone where there is no master."""

    master: str | None
    multiplier: Fraction
    offset: Fraction


@dataclass(frozen=True, slots=True, kw_only=True)
class _Parts:
    """The names of the joints that belong to the robot, and of those that stand still before its base."""

    inside: frozenset[str]
    standing: frozenset[str]


def read_followers(
    reading: Reading, joints: Sequence[UrdfJoint], kept: Sequence[UrdfJoint], before: Sequence[UrdfJoint] = ()
) -> dict[str, Follower]:
    """Return the followers among `kept` and `before` by name, each with a master that follows no other joint.

    Args:
        reading: where mistakes go.
        joints: all joints of the file.
        kept: the joints that belong to the robot.
        before: the joints before its base, which stand still at zero, their followers at their offset.
    """
    by_name = {joint.name: joint for joint in joints}
    direct = {joint.name: step for joint in joints if (step := _read_mimic(reading, joint, by_name))}
    parts = _Parts(
        inside=frozenset(joint.name for joint in kept), standing=frozenset(joint.name for joint in before)
    )
    found: dict[str, Follower] = {}
    for joint in (*before, *kept):
        if joint.name in direct:
            follower = _follow(reading, joint, direct, by_name, parts)
            if follower is not None:
                found[joint.name] = follower
    return found


def _read_mimic(reading: Reading, joint: UrdfJoint, known: Mapping[str, UrdfJoint]) -> Follower | None:
    owner = f"joint '{joint.name}'"
    element = find_only(reading, owner, joint.element, "mimic")
    if element is None:
        return None
    if not joint.moves:
        reading.skip(f"<mimic> of a {joint.type} joint", element)
        return None
    reading.skip_others(element, (), ("joint", "multiplier", "offset"))
    master = read_name(reading, owner, element, "joint", known)
    multiplier = read_decimal(reading, owner, element, "multiplier")
    offset = read_decimal(reading, owner, element, "offset")
    if master is None:
        return None
    return Follower(
        master=master,
        multiplier=Fraction(1 if multiplier is None else multiplier),
        offset=Fraction(offset or 0),
    )


def _follow(
    reading: Reading,
    joint: UrdfJoint,
    direct: Mapping[str, Follower],
    joints: Mapping[str, UrdfJoint],
    parts: _Parts,
) -> Follower | None:
    """Return `joint` as a follower of the last joint in its row of masters."""
    multiplier, offset = Fraction(1), Fraction(0)
    name, seen = joint.name, [joint.name]
    element = _find_mimic(joint)
    still = name in parts.standing
    while name in direct:
        step = direct[name]
        offset += multiplier * step.offset
        multiplier *= step.multiplier
        name = step.master or ""
        if not multiplier:
            text = "joints {}: follow with the factor 0, and stand still at their offset"
            reading.remark("robot.follower-still", text, f"'{joint.name}'", element)
            return Follower(master=None, multiplier=multiplier, offset=offset)
        if name in seen:
            ring = " -> ".join((*seen[seen.index(name) :], name))
            text = f"joint '{joint.name}': joints follow each other in a ring: {ring}"
            reading.refuse("robot.mimic-ring", text, element)
            return None
        still = still or name in parts.standing
        if name not in parts.inside and not still:
            text = "joints {}: the joint that they follow was cut off; they have a coordinate of their own"
            reading.remark("robot.follower-free", text, f"'{joint.name}'", element)
            return None
        seen.append(name)
    if still:
        if joint.name in parts.inside:
            text = "joints {}: follow a joint before the base, and stand still at their offset"
            reading.remark("robot.follower-still", text, f"'{joint.name}'", element)
        return Follower(master=None, multiplier=Fraction(0), offset=offset)
    if joints[name].type == "fixed":
        text = "joints {}: follow a fixed joint, and stand still at their offset"
        reading.remark("robot.follower-still", text, f"'{joint.name}'", element)
        return Follower(master=None, multiplier=Fraction(0), offset=offset)
    return Follower(master=name, multiplier=multiplier, offset=offset)


def _find_mimic(joint: UrdfJoint) -> Element:
    return joint.element.find("mimic") or joint.element
