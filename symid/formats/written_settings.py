"""The `[log]` and `[processing]` tables as a robot file writes them: what says nothing is left out.

Input: a robot. Output: lines that `settings` reads back as the same map and the same processing.
"""

from collections.abc import Iterator
from typing import Any

from symid.formats.settings import list_log, list_processing
from symid.formats.written_values import add_comment, write_value
from symid.robot.description import Robot
from symid.robot.log_map import LogMap, LogQuantity, Processing
from symid.units import find_unit_factor

__all__ = ["write_settings"]

_MEANING = {
    "filter_cutoff": "Hz",
    "automatic": "cut-off and decimation that are not stated follow from the log",
    "drop_first": "samples, after differentiation",
    "drop_last": "likewise",
    "standstill": "rad/s or m/s: slower rows of a joint are left out",
}


def write_settings(robot: Robot) -> Iterator[str]:
    """Yield the lines of both tables; none of a table that says nothing."""
    if robot.log != LogMap():
        yield from ("", "[log]")
        for key, entry in list_log(robot.log).items():
            yield f"{key} = {write_value(_shorten(robot, key, entry))}"
    if robot.processing != Processing(automatic=True):
        yield from ("", "[processing]")
        standard = list_processing(Processing())
        settings = list_processing(robot.processing)
        kept = {key: entry for key, entry in settings.items() if entry != standard[key]}
        # A table without a key would not be there, and all would be automatic.
        for key, entry in (kept or {"automatic": False}).items():
            line = f"{key} = {write_value(entry)}"
            yield add_comment(line, _MEANING[key]) if key in _MEANING else line


def _shorten(robot: Robot, key: str, entry: Any) -> Any:  # noqa: ANN401  whatever TOML has
    """Return a quantity without the factor and side that it has anyway."""
    if not isinstance(entry, dict) or "factor" not in entry:
        return entry
    quantity: LogQuantity = getattr(robot.log, key)
    usual = {"side": quantity.side == "joint", "factor": set(quantity.factor) == {1.0}}
    if _is_converted(robot, quantity):
        usual = {"side": True, "factor": True}
    return {name: value for name, value in entry.items() if not usual.get(name)}


def _is_converted(robot: Robot, quantity: LogQuantity) -> bool:
    """Return whether the factor is what torque constants and gears make of a current, and will again."""
    if find_unit_factor(quantity.unit)[0] != "current":
        return False
    coupled = robot.log.transmission is not None
    drives = [joint.drive for joint in robot.axes]
    made = tuple((1.0 if coupled else drive.gear) * (drive.torque_constant or 0.0) for drive in drives)
    return quantity.factor == made and all(made) and quantity.side == ("motor" if coupled else "joint")
