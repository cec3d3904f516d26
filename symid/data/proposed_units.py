"""Units of the columns of a quantity, and what that makes of them.

Input: names of columns, the units that headings or the user state. Output: `LogQuantity`; mistakes go into
the findings.

Supported: every unit of the closed table that the quantity can have; units that differ from joint to joint;
currents by torque constants and gears.
Not supported: columns without a unit; none is guessed.
"""

from collections.abc import Mapping, Sequence

from symid.data.findings import Findings
from symid.data.headings import DIMENSIONS
from symid.data.scales import join_names
from symid.robot.description import Joint, JointKind
from symid.robot.log_map import LogQuantity
from symid.units import UNITS, find_unit_factor, nearest_units

__all__ = ["ask_constants", "build_quantity"]

_EXAMPLES = {"time": "s", "position": "deg", "velocity": "deg/s", "torque": "Nm"}
_LIKE = {"reference_velocity": "velocity", "feedforward": "torque"}
_LINEAR = frozenset({"length", "velocity", "force"})
_ANGULAR = frozenset({"angle", "angular velocity", "torque"})


def build_quantity(
    quantity: str,
    names: tuple[str, ...],
    stated: Mapping[str, str],
    joints: Sequence[Joint],
    findings: Findings,
) -> LogQuantity | None:
    """Return the quantity of columns; None, and mistakes noted, where units are missing or do not fit.

    Args:
        quantity: which one.
        names: its columns, one for each joint or one for all.
        stated: units by name of column.
        joints: those that have a coordinate of their own.
        findings: take the mistakes.
    """
    like = quantity if quantity in DIMENSIONS else _LIKE.get(quantity, "position")
    silent = tuple(name for name in names if name not in stated)
    if silent:
        example = _EXAMPLES[like]
        text = f"{quantity}: no unit is stated for {join_names(silent)}, and none is guessed"
        remedy = (
            f"write it into the heading, as in {silent[0]} [{example}], or give --units {quantity}={example}"
        )
        findings.refuse("new.no-unit", f"{text}: {remedy}, whichever it is")
        return None
    units = tuple(stated[name] for name in names)
    if not _check_units(quantity, like, list(zip(names, units, strict=True)), joints, findings):
        return None
    dimensions = {find_unit_factor(unit)[0] for unit in units}
    if "current" in dimensions:
        return _convert_currents(quantity, names, units, joints, findings)
    if len(set(units)) == 1:
        return LogQuantity(columns=names, unit=units[0])
    return LogQuantity(columns=names, unit="SI", factor=tuple(find_unit_factor(unit)[1] for unit in units))


def _list_possible(like: str, kind: JointKind) -> tuple[str, ...]:
    """Return the dimensions that a quantity of such a joint can be logged in."""
    other = _LINEAR if kind is JointKind.REVOLUTE else _ANGULAR
    return tuple(dimension for dimension in DIMENSIONS[like] if dimension not in other)


def _check_units(
    quantity: str, like: str, pairs: Sequence[tuple[str, str]], joints: Sequence[Joint], findings: Findings
) -> bool:
    """Return whether all units are in the table, and of a dimension that the quantity can have."""
    texts, numbers = [], []
    for index, joint in enumerate(joints):
        name, unit = pairs[index if len(pairs) > 1 else 0]
        possible = _list_possible(like, joint.kind)
        known = ", ".join(entry for entry in UNITS if UNITS[entry][0] in possible)
        try:
            dimension = find_unit_factor(unit)[0]
        except KeyError:
            near = nearest_units(unit)
            hint = f"did you mean {' or '.join(near)}?" if near else f"known are {known}"
            texts.append(f"{quantity}: {name!r} is in {unit!r}, which is no unit; {hint}")
            continue
        if dimension == "number":
            numbers.append(name)
        elif dimension not in (*possible, "SI"):
            texts.append(
                f"{quantity}: {name!r} is in {unit!r}, a unit of {dimension}; expected one of {known}"
            )
    remedy = f"give --units {quantity}=UNIT, or --columns {quantity}=NAME,... if it is another column"
    for text in dict.fromkeys(texts):
        findings.refuse("new.wrong-unit", f"{text}; {remedy}")
    if numbers:
        named = tuple(dict.fromkeys(numbers))
        text = (
            f"{quantity}: {join_names(named)}: of what they are parts, or how much one count is, is not known"
        )
        remedy = f"give --units {quantity}=SI, then write factor = [...] behind it in [log] of the robot file"
        findings.refuse("new.wrong-unit", f"{text}; {remedy}")
    return not texts and not numbers


def _convert_currents(
    quantity: str, names: tuple[str, ...], units: tuple[str, ...], joints: Sequence[Joint], findings: Findings
) -> LogQuantity | None:
    """Return currents with the factors that torque constants and gears make of them."""
    lacking = tuple(joint.name for joint in joints if joint.drive.torque_constant is None)
    if len(set(units)) > 1:
        text = f"{quantity}: {join_names(names)} are in different units: {', '.join(units)}"
        findings.refuse("new.mixed-units", f"{text}; log all of them in one, or as torques")
    if lacking:
        text = f"{quantity}: {join_names(names)} are motor currents, and no torque constant is known of"
        findings.refuse("new.torque-constant", f"{text} {join_names(lacking)}: {ask_constants(joints)}")
    if lacking or len(set(units)) > 1:
        return None
    factor = tuple(joint.drive.gear * (joint.drive.torque_constant or 0.0) for joint in joints)
    return LogQuantity(columns=names, unit=units[0], factor=factor)


def ask_constants(joints: Sequence[Joint]) -> str:
    """Return what to give so that currents become torques."""
    listed = ",".join(f"K{number}" for number in range(1, len(joints) + 1))
    names = join_names(tuple(joint.name for joint in joints))
    return (
        f"give --torque-constant {listed} (N m/A at the motor, of {names}), and --gear where there are gears "
        "that the file does not state"
    )
