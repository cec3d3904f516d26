"""Where `symid new` takes a robot from: a URDF, a table of rows, a robot at hand.

Input: options of the command line. Output: the robot of a URDF or a table.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import TYPE_CHECKING

from symid.errors import Notice, UsageError

if TYPE_CHECKING:  # these load numpy
    from symid.robot.description import Robot

__all__ = ["Source", "check_source", "read_source"]

_LEVEL = ("0", "0", "-9.81")


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """One of `urdf` (with `base`, `tip`), `table` (with `convention`, `gravity`) and `name`; else None."""

    urdf: Path | None
    base: str | None
    tip: str | None
    table: Path | None
    convention: str | None
    gravity: str | None
    name: str | None


def check_source(source: Source, of_log: Sequence[str]) -> None:
    """Refuse a call without one source, or with options of another one.

    Args:
        source: what was given.
        of_log: options that were given and have no meaning, because no log was.

    Raises:
        UsageError: the options do not go together.
    """
    texts = []
    if sum(entry is not None for entry in (source.urdf, source.table, source.name)) != 1:
        texts.append("give one source: --from-urdf FILE, --from-dh FILE or --from ROBOT")
    owned = (
        ("--from-urdf", source.urdf, {"--base": source.base, "--tip": source.tip}),
        ("--from-dh", source.table, {"--convention": source.convention, "--gravity": source.gravity}),
    )
    for owner, given, options in owned:
        texts += [
            f"{option} belongs to {owner}"
            for option, value in options.items()
            if value is not None and given is None
        ]
    texts += [f"{option} belongs to --log LOG" for option in of_log]
    if source.table is not None and source.convention is None:
        texts.append("--from-dh needs --convention modified or --convention standard; it is never guessed")
    if texts:
        raise UsageError(*(Notice(code="usage.call", text=text) for text in texts))


def read_source(source: Source) -> "Robot":
    """Return the robot of a URDF or of a table of rows.

    Raises:
        UsageError: --gravity is no vector.
        RobotError: the file is wrong.
    """
    if source.urdf is not None:
        from symid.formats.urdf import read_urdf

        return read_urdf(source.urdf, base=source.base, tip=source.tip)
    from symid.formats.dh_table import read_dh_table

    return read_dh_table(source.table or Path(), source.convention or "", _split_gravity(source.gravity))


def _split_gravity(text: str | None) -> tuple[str, str, str]:
    """Return the three components of --gravity.

    Raises:
        UsageError: they are not three finite numbers of a sensible size.
    """
    if text is None:
        return _LEVEL
    from symid.formats.section import to_decimal

    parts = [part.strip() for part in text.split(",")]
    try:
        good = len(parts) == 3 and all(to_decimal(Decimal(part)) is not None for part in parts)
    except InvalidOperation:
        good = False
    if not good:
        expected = "expected three numbers in m/s^2 of a sensible size"
        message = f"--gravity {text}: {expected}, such as --gravity 0,0,-9.81"
        raise UsageError(Notice(code="usage.gravity", text=message))
    return (parts[0], parts[1], parts[2])
