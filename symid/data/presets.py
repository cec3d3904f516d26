"""Column names of logs that other programs write, so that no `[log]` table has to list them.

Input: `RawLog`, a robot whose map names a preset. Output: the robot with the columns found put into its map.

    ros      JointState of rostopic echo -p (field.position0), bagpy (position_0), PlotJuggler (T/J/position)
    ur-rtde  record files of ur_rtde (actual_q_0, actual_qd_0, actual_current_0, timestamp)
    franka   logs of libfranka (q[0] or state.q[0], tau_J[0]; time in ms)
    symid    what symid writes (t, q, dq, tau)

Supported: joints in the order of the robot file; PlotJuggler's by name. What `[log]` states comes first.
Not supported: JointState messages whose order of joints changes within a log.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from symid.data.findings import Findings
from symid.data.table import RawLog
from symid.robot.description import Joint, Robot
from symid.robot.log_map import LogQuantity

__all__ = ["apply_preset"]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Layout:
    """Names of the columns of one program: `{k}` counts from 0, `{joint}` is the joint's name."""

    time: tuple[tuple[str, str], ...]
    position: tuple[str, ...]
    velocity: tuple[str, ...]
    torque: tuple[str, ...]
    torque_unit: str = "SI"


_LAYOUTS = {
    "ros": _Layout(
        time=(("%time", "ns"), ("Time", "s"), ("__time", "s"), ("time", "s")),
        position=("field.position{k}", "position_{k}", "*/{joint}/position", "{joint}_position"),
        velocity=("field.velocity{k}", "velocity_{k}", "*/{joint}/velocity", "{joint}_velocity"),
        torque=("field.effort{k}", "effort_{k}", "*/{joint}/effort", "{joint}_effort"),
    ),
    "ur-rtde": _Layout(
        time=(("timestamp", "s"),),
        position=("actual_q_{k}",),
        velocity=("actual_qd_{k}",),
        torque=("actual_current_{k}",),
        torque_unit="A",
    ),
    "franka": _Layout(
        time=(("time", "ms"), ("duration", "ms")),
        position=("state.q[{k}]", "q[{k}]"),
        velocity=("state.dq[{k}]", "dq[{k}]"),
        torque=("state.tau_J[{k}]", "tau_J[{k}]"),
    ),
}


def apply_preset(raw: RawLog, robot: Robot, findings: Findings) -> Robot:
    """Return the robot with the columns of its preset in the `[log]` map; as it is where it has none."""
    layout = _LAYOUTS.get(robot.log.preset or "")
    if layout is None:
        return robot
    log = robot.log
    time = next((entry for entry in layout.time if entry[0] in raw.columns), None)
    if log.time is None and time is not None:
        log = replace(log, time=LogQuantity(columns=(time[0],), unit=time[1]))
    found: dict[str, LogQuantity] = {}
    for name in ("position", "velocity", "torque"):
        patterns: tuple[str, ...] = getattr(layout, name)
        columns = _find_columns(raw, patterns, robot.axes)
        if getattr(log, name) is not None or (columns is None and name == "velocity"):
            continue
        if columns is None:
            wanted = " or ".join(", ".join(_list_names(pattern, robot.axes)[:2]) for pattern in patterns)
            text = f"{name}: preset {log.preset!r} looks for {wanted} ..., which not every joint has"
            findings.refuse("log.preset", f"{text}; name the columns in [log.{name}]")
            continue
        found[name] = LogQuantity(columns=columns, unit="SI")
        if name == "torque" and layout.torque_unit != "SI":
            found[name] = _convert_currents(columns, layout.torque_unit, robot, findings)
    log = replace(
        log,
        position=found.get("position", log.position),
        velocity=found.get("velocity", log.velocity),
        torque=found.get("torque", log.torque),
    )
    return replace(robot, log=log)


def _list_names(pattern: str, joints: Sequence[Joint]) -> tuple[str, ...]:
    return tuple(pattern.format(k=index, joint=joint.name) for index, joint in enumerate(joints))


def _find_columns(raw: RawLog, patterns: tuple[str, ...], joints: Sequence[Joint]) -> tuple[str, ...] | None:
    """Return the columns of the first pattern that has one for every joint; * stands for any topic."""
    for pattern in patterns:
        names = _list_names(pattern, joints)
        if pattern.startswith("*"):
            hits = [[name for name in raw.columns if name.endswith(ending[1:])] for ending in names]
            names = tuple(hit[0] if len(hit) == 1 else "" for hit in hits)
        if all(name in raw.columns for name in names):
            return names
    return None


def _convert_currents(columns: tuple[str, ...], unit: str, robot: Robot, findings: Findings) -> LogQuantity:
    """Return the quantity for motor currents, by the torque constants of the robot file."""
    drives = [joint.drive for joint in robot.axes]
    lacking = [joint.name for joint in robot.axes if joint.drive.torque_constant is None]
    if lacking:
        text = (
            f"torque: {columns[0]!r} ... are motor currents, and joint {lacking[0]!r} has no torque_constant "
            "(N m/A) in its drive, which turns them into torques: add it, and the gear ratio"
        )
        findings.refuse("log.no-torque-constant", text)
    coupled = robot.log.transmission is not None
    factor = tuple((drive.torque_constant or 1.0) * (1.0 if coupled else drive.gear) for drive in drives)
    return LogQuantity(columns=columns, unit=unit, factor=factor, side="motor" if coupled else "joint")
