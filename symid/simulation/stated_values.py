"""What a robot file must state before its robot can be simulated.

Input: a robot. Output: nothing, or an error that names everything that is missing.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from symid.errors import Notice, RobotError

if TYPE_CHECKING:  # this loads numpy
    from symid.robot.description import Coupling, FrictionValues, Joint, Robot

__all__ = ["check_values"]


def _list_friction_gap(friction: "FrictionValues") -> Iterator[str]:
    if friction.kind.value != "none" and friction.values is None:
        yield f"the values of friction {friction.kind.value}"


def _list_joint_gaps(joint: "Joint") -> Iterator[str]:
    if joint.inertial is None:
        yield "[joint.link] mass, com and inertia"
    if joint.drive.has_rotor and joint.drive.rotor_inertia is None:
        yield "the rotor_inertia of [joint.drive]"
    if joint.spring is not None and None in (joint.spring.stiffness, joint.spring.rest):
        yield "stiffness and rest of [joint.spring]"
    if joint.elasticity is not None and joint.elasticity.initial_stiffness is None:
        yield "the stiffness of [joint.elasticity] and of its stops"
    if joint.elasticity is not None and not joint.drive.has_rotor:
        yield "the rotor_inertia of [joint.drive], which an elastic joint needs"
    yield from _list_friction_gap(joint.friction)


def _list_coupling_gaps(coupling: "Coupling") -> Iterator[str]:
    if coupling.has_rotor and coupling.rotor_inertia is None:
        yield "the rotor_inertia"
    yield from _list_friction_gap(coupling.friction)


def check_values(robot: "Robot") -> None:
    """Refuse a robot whose file lacks values, before minutes go into its derivation."""
    lacking = [f"joint '{joint.name}': {gap}" for joint in robot.joints for gap in _list_joint_gaps(joint)]
    lacking += [
        f"coupling '{coupling.name}': {gap}"
        for coupling in robot.couplings
        for gap in _list_coupling_gaps(coupling)
    ]
    if lacking:
        text = f"cannot be simulated, these values are not stated: {'; '.join(lacking)}"
        raise RobotError(Notice(code="robot.no-values", text=text, file=robot.path))
