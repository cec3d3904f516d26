"""Values of a robot's parameters as JSON: vectors of generated functions, and the bodies behind them.

Input: a robot whose values are known, its `RobotValues`. Output: an object of plain types.

    format, version, robot, signature
    vectors: {"beta": [{name, value, unit, expression, identified, std}], "f": ..., "IA": ..., "h": ...}
    gravity: [x, y, z]
    links: [{joint, kind, parent, mass, com, inertia {xx xy xz yy yz zz about com}, standard {XX ... M}}]
    drives: [{name, gear, rotor_inertia, friction {model, values {}, shape {}, smoothing}}], couplings last

Supported: SI units, format 1. What is unknown is null. Links are in the frames of the URDF that symid writes.
"""

from collections.abc import Sequence

import numpy as np

from symid.formats.joint_friction import FRICTION_PARAMETERS, FRICTION_SHAPES
from symid.formats.value_vectors import RobotValues, ValueVector
from symid.notation import INERTIAL
from symid.robot.description import FrictionValues, Joint, Robot
from symid.robot.inertia import move_parameters

__all__ = ["FORMAT", "VERSION", "build_json_values"]

FORMAT = "symid values"
VERSION = 1
_TENSOR = ("xx", "xy", "xz", "yy", "yz", "zz")


def build_json_values(
    robot: Robot, values: RobotValues, *, outcome: str, sources: Sequence[str] = ()
) -> dict[str, object]:
    """Return the object.

    Args:
        robot: with values of links and drives.
        values: the same as vectors.
        outcome: how the values were found, in one word.
        sources: the logs they come from.
    """
    symbols = dict(robot.symbols)
    return {
        "format": FORMAT,
        "version": VERSION,
        "robot": robot.name,
        "signature": values.signature,
        "outcome": outcome,
        "sources": list(sources),
        "gravity": [value.to_float(symbols) for value in robot.gravity],
        "vectors": {vector.name: _list_rows(vector) for vector in values.vectors if vector.rows},
        "links": [_describe_link(robot, joint) for joint in robot.joints],
        "drives": [
            *(
                {
                    "name": joint.name,
                    "gear": joint.drive.gear,
                    "rotor_inertia": joint.drive.rotor_inertia,
                    "friction": _describe_friction(joint.friction),
                }
                for joint in robot.joints
            ),
            *(
                {
                    "name": coupling.name,
                    "turns_with": {
                        robot.joints[index].name: float(factor) for index, factor in coupling.terms
                    },
                    "rotor_inertia": coupling.rotor_inertia,
                    "friction": _describe_friction(coupling.friction),
                }
                for coupling in robot.couplings
            ),
        ],
    }


def _list_rows(vector: ValueVector) -> list[dict[str, object]]:
    return [
        {
            "name": row.name,
            "value": row.value,
            "unit": row.unit,
            "expression": row.expression,
            "identified": row.identified,
            "std": row.std,
        }
        for row in vector.rows
    ]


def _describe_link(robot: Robot, joint: Joint) -> dict[str, object]:
    found: dict[str, object] = {
        "joint": joint.name,
        "kind": joint.kind.value,
        "parent": robot.joints[joint.parent].name if joint.parent >= 0 else None,
    }
    if joint.inertial is None:
        return {**found, "mass": None, "com": None, "inertia": None, "standard": None}
    mass = joint.inertial[9]
    com = [entry / mass for entry in joint.inertial[6:9]] if mass else [0.0, 0.0, 0.0]
    central = move_parameters(joint.inertial, np.eye(3), -np.array(com))[:6]
    return {
        **found,
        "mass": mass,
        "com": com,
        "inertia": dict(zip(_TENSOR, central, strict=True)),
        "standard": dict(zip(INERTIAL, joint.inertial, strict=True)),
    }


def _describe_friction(friction: FrictionValues) -> dict[str, object]:
    names = FRICTION_PARAMETERS[friction.kind]
    shapes = [key.name for key in FRICTION_SHAPES.get(friction.kind, ())]
    return {
        "model": friction.kind.value,
        "values": dict(zip(names, friction.values or (None,) * len(names), strict=True)),
        "shape": dict(zip(shapes, friction.shape, strict=True)),
        "smoothing": friction.smoothing,
    }
