"""What a logged column is multiplied by: unit, factor, gear.

Input: the units that a log and a robot file state. Output: one factor a joint, and its description in
words; mistakes and remarks go into the findings.

Supported: the closed table of units; factors; motor-side logs, by gear ratios or by the matrix of a coupled
transmission; motor currents by their torque constants.
Not supported: a unit for each joint (give factors and the unit "SI").
"""

import numpy as np

from symid.arrays import FloatArray
from symid.data.findings import Findings
from symid.data.table import RawLog
from symid.robot.description import Joint, JointKind
from symid.robot.log_map import LogQuantity
from symid.robot.transmission import Matrix, find_condition
from symid.units import find_unit_factor, nearest_units

__all__ = [
    "choose_unit",
    "describe_scale",
    "find_scale",
    "is_motor_side",
    "is_other_dimension",
    "join_names",
    "look_up_unit",
    "turn_motors",
]

_DIMENSIONS = {
    "position": {JointKind.REVOLUTE: "angle", JointKind.PRISMATIC: "length"},
    "velocity": {JointKind.REVOLUTE: "angular velocity", JointKind.PRISMATIC: "velocity"},
    "torque": {JointKind.REVOLUTE: "torque", JointKind.PRISMATIC: "force"},
}
_DIMENSIONS["motor_position"] = _DIMENSIONS["link_position"] = _DIMENSIONS["position"]
_DIMENSIONS["reference"] = _DIMENSIONS["position"]
_DIMENSIONS["reference_velocity"] = _DIMENSIONS["velocity"]
_DIMENSIONS["feedforward"] = _DIMENSIONS["torque"]
_TORQUES = ("torque", "feedforward")
# A factor may have any of these on the raw side: encoder counts, sensor and command voltages.
_CONVERTIBLE = ("number", "voltage", "current")


def choose_unit(
    raw: RawLog, names: tuple[str, ...], asked: LogQuantity | None, standard: str, findings: Findings
) -> str:
    """Return the unit of the robot file, else that of the log, else SI; say where the two differ."""
    stated = {raw.units[name] for name in names if name in raw.units}
    if asked is None:
        unknown = {unit for unit in stated if not _find_factor_or_zero(unit)}
        if unknown:
            # A unit that does not exist is told as such, not as one that differs from its neighbours'.
            return min(unknown)
        silent = tuple(name for name in names if name not in raw.units)
        if stated and silent:
            neighbours = ", ".join(sorted(stated))
            text = f"no unit is stated for {join_names(silent)}, but for its neighbours ({neighbours})"
            findings.refuse("log.mixed-units", f"{text}; state the unit of every column, or of none (SI)")
        if len(stated) > 1 and standard == "SI":
            # Revolute and prismatic joints side by side; each must then be in SI units.
            stated = stated if any(_find_factor_or_zero(unit) != 1.0 for unit in stated) else set()
        if len(stated) > 1:
            units = ", ".join(sorted(stated))
            findings.refuse(
                "log.mixed-units", f"{join_names(names)} are in different units: {units}; use one for all"
            )
        return min(stated, default=standard)
    for unit in sorted(stated - {asked.unit}):
        _compare_units(unit, asked.unit, names, findings)
    return asked.unit


def _compare_units(unit: str, asked: str, names: tuple[str, ...], findings: Findings) -> None:
    """Say where the unit that the log states is not the one that the robot file asks for."""
    text = f"{join_names(names)}: the log says {unit!r}, the robot file {asked!r}"
    try:
        there, wanted = find_unit_factor(unit), find_unit_factor(asked)
    except KeyError:
        findings.remark("log.unit-differs", f"{text}; the robot file was followed")
        return
    if "SI" in (there[0], wanted[0]) or there == wanted:
        return
    if there[0] != wanted[0]:
        text = f"{text}: {there[0]} is not {wanted[0]}; correct the unit in one of them"
        findings.refuse("log.unit-differs", text)
    else:
        findings.remark("log.unit-differs", f"{text}; the robot file was followed")


def _find_factor_or_zero(unit: str) -> float:
    try:
        return find_unit_factor(unit)[1]
    except KeyError:
        return 0.0


def look_up_unit(unit: str, name: str, findings: Findings) -> tuple[str, float] | None:
    """Return dimension and factor to SI of a unit; None, and a mistake noted, if there is no such unit."""
    try:
        return find_unit_factor(unit)
    except KeyError:
        near = nearest_units(unit)
        hint = (
            f"did you mean {' or '.join(map(repr, near))}?"
            if near
            else "leave it out if the column is in SI units"
        )
        findings.refuse("log.unknown-unit", f"{name}: there is no unit {unit!r}; {hint}")
        return None


def find_scale(
    name: str,
    unit: str,
    asked: LogQuantity | None,
    joints: tuple[Joint, ...],
    findings: Findings,
    *,
    coupled: bool = False,
) -> FloatArray | None:
    """Return what each joint's column is multiplied by, (n,).

    Gear ratios of a motor-side quantity are in it unless it is `coupled`: a transmission matrix then
    follows, whose entries may turn the angles of motors into lengths.
    """
    found = look_up_unit(unit, name, findings)
    if found is None:
        return None
    dimension, to_si = found
    factor = asked.factor if asked else (1.0,)
    wanted = _DIMENSIONS[name]
    for joint in joints:
        if dimension in ("SI", wanted[joint.kind]) or any(value != 1.0 for value in factor):
            continue
        if coupled and dimension in wanted.values():
            continue
        # A robot file that names such a unit was asked for its factor, which may well be 1.
        if asked is None or dimension not in _CONVERTIBLE:
            needs = ", for which a factor is needed" if dimension in _CONVERTIBLE else ""
            text = f"{name} is in {unit!r}, a unit of {dimension}{needs}"
            findings.refuse("log.wrong-unit", f"{text}; joint {joint.name!r} needs {wanted[joint.kind]}")
            return None
    if len(factor) not in (1, len(joints)):
        findings.refuse("log.factor-count", f"{name}: {len(factor)} factors for {len(joints)} joints")
        return None
    geared = is_motor_side(asked) and not coupled
    gear = np.array([joint.drive.gear for joint in joints]) if geared else np.ones(len(joints))
    turned = gear if name in _TORQUES else 1.0 / gear
    return np.broadcast_to(np.array(factor), (len(joints),)) * to_si * turned


def is_motor_side(asked: LogQuantity | None) -> bool:
    """Return whether the robot file says that the quantity is logged at the motor."""
    return asked is not None and asked.side == "motor"


def is_other_dimension(name: str, unit: str, joints: tuple[Joint, ...]) -> bool:
    """Return whether `unit` is none of the quantity, as a voltage is none of torque."""
    wanted = {_DIMENSIONS[name][joint.kind] for joint in joints}
    return find_unit_factor(unit)[0] not in {"SI", *wanted}


def turn_motors(name: str, values: FloatArray, matrix: Matrix) -> FloatArray:
    """Return what the motors do (N, n) as what the joints do: T^-1 for motions, T' for torques."""
    rows = np.array(matrix)
    turned: FloatArray = values @ rows if name in _TORQUES else np.linalg.solve(rows, values.T).T
    return np.ascontiguousarray(turned)


def describe_scale(
    name: str,
    unit: str,
    scale: FloatArray,
    asked: LogQuantity | None,
    joints: tuple[Joint, ...],
    *,
    matrix: Matrix | None = None,
) -> str:
    """Return in words what was done to the columns, and where that comes from."""
    text = f"in {unit} was multiplied by {_list_values(scale)}"
    if matrix is not None:
        what = "the transpose" if name in _TORQUES else "the inverse"
        condition = find_condition(matrix) or np.inf
        text += f" and {what} of the transmission matrix (motor side; its condition is {condition:.3g})"
    elif is_motor_side(asked):
        text += f" (motor side, gear included: {_list_gears(joints)})"
    else:
        text += _explain_currents(name, unit, scale, joints)
    offset = np.array(asked.offset if asked else (0.0,))
    return f"{text}; {_list_values(offset)} was added" if offset.any() else text


def _explain_currents(name: str, unit: str, scale: FloatArray, joints: tuple[Joint, ...]) -> str:
    constants = np.array([joint.drive.torque_constant or 0.0 for joint in joints])
    gears = np.array([joint.drive.gear for joint in joints])
    dimension, to_si = find_unit_factor(unit)
    known = name in _TORQUES and dimension == "current"
    if not known or not np.allclose(scale, to_si * gears * constants, 1e-12, 0):
        return ""
    return f" (torque constant {_list_values(constants)} N m/A times gear {_list_gears(joints)})"


def _list_gears(joints: tuple[Joint, ...]) -> str:
    return _list_values(np.array([joint.drive.gear for joint in joints]))


def _list_values(values: FloatArray) -> str:
    """Return the values, or the one value that all joints share."""
    shown = values if np.any(values != values[0]) else values[:1]
    return ", ".join(f"{value:.10g}" for value in shown)


def join_names(names: tuple[str, ...]) -> str:
    """Return the names in quotes, with commas between."""
    return ", ".join(map(repr, names))
