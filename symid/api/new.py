"""A robot file to be completed by hand: from a URDF, a table of rows, or a robot at hand, and from a log.

Input: a source, and what is known beside it. Output: `RobotDraft`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Literal, final

from symid.api.result import Progress, Result, ignore
from symid.errors import Notice

if TYPE_CHECKING:  # these load NumPy
    from symid.report.blocks import Block
    from symid.robot.description import Robot
    from symid.tasks.draft import Draft

__all__ = ["RobotDraft", "new_robot"]


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class RobotDraft(Result):
    """A robot file that is not written yet.

    Attributes:
        product: the robot, the text, and what the log adds to it.

    Example:
        >>> import symid
        >>> draft = symid.new_robot(robot="scara")
        >>> len(symid.load(draft.save("mine.toml")).joints)
        4
    """

    product: "Draft"

    @property
    def robot(self) -> "Robot":
        """Return the robot that the file describes."""
        return self.product.robot

    @property
    def source(self) -> Path:
        """Return the file that the robot comes from."""
        return self.product.source

    @property
    def text(self) -> str:
        """Return the text of the file, TOML; what is not known stands in comments."""
        return self.product.text

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return what was taken for granted, and what is odd about source and log."""
        return self.product.notices

    def save(self, path: str | PathLike[str]) -> Path:
        """Write the file to `path`, in place of an older one; return the path.

        Raises:
            OutputError: it is no .toml, or cannot be written.
        """
        from symid.identification.storage import write_file
        from symid.paths import check_suffix

        file = Path(path)
        check_suffix(file, "a robot file", (".toml",))
        write_file(file, self.text)
        return file

    def summarise(self) -> str:
        """Return name and number of joints."""
        from symid.report.draft_text import name_robot

        return name_robot(self.robot)

    def blocks(self) -> "tuple[Block, ...]":
        """Return the robot, and the columns and units of its log."""
        from symid.report.draft_text import show_draft

        return show_draft(self.product)

    def to_dict(self) -> dict[str, object]:
        """Return robot, joints and log in plain types."""
        from symid.report.draft_text import describe_draft

        return describe_draft(self.product)


def new_robot(
    *,
    urdf: str | PathLike[str] | None = None,
    table: str | PathLike[str] | None = None,
    robot: str | PathLike[str] | None = None,
    base: str | None = None,
    tip: str | None = None,
    convention: Literal["modified", "standard"] | None = None,
    gravity: str | Sequence[float] | None = None,
    log: str | PathLike[str] | None = None,
    columns: Mapping[str, str | Sequence[str]] | None = None,
    units: Mapping[str, str | Sequence[str]] | None = None,
    friction: str | None = None,
    rotors: bool = False,
    gear: str | float | Sequence[float] | None = None,
    torque_constant: str | float | Sequence[float] | None = None,
    progress: Progress = ignore,
) -> RobotDraft:
    """Return a robot file to be completed by hand; give one of `urdf`, `table` and `robot`.

    Args:
        urdf: a URDF.
        table: a CSV table of Denavit-Hartenberg rows.
        robot: a robot at hand: a file is copied, a URDF converted.
        base: of the URDF: the link to start from; its root by default.
        tip: of the URDF: the link to end at; others are cut off.
        convention: of the table: "modified" or "standard"; it is never guessed.
        gravity: of the table: in its base frame, m/s^2; 0, 0, -9.81 by default.
        log: a log of the robot: its columns and their units become the `[log]` table.
        columns: of the log by quantity (time, position, torque, velocity); by their names where left out.
        units: of the columns by quantity, one for each or one for all, where the log states none.
        friction: the friction model of all joints.
        rotors: whether every drive gets a rotor whose inertia is to be identified.
        gear: motor turns per joint turn, one for each joint or one for all.
        torque_constant: N m/A at the motor, one for each joint or one for all.
        progress: told what begins.

    Raises:
        UsageError: the arguments do not go together.
        RobotError: the source is wrong.
        LogError: the log cannot be read, or its columns cannot be told.

    Example:
        >>> import symid
        >>> draft = symid.new_robot(robot="scara")
        >>> draft.text.count("[[joint]]")
        4
    """
    from symid.tasks.draft import DraftOrder, draft_robot

    source = urdf or table or robot
    if source is not None:
        progress(f"reading {fspath(source)}")
    order = DraftOrder(
        urdf=None if urdf is None else Path(urdf),
        base=base,
        tip=tip,
        table=None if table is None else Path(table),
        convention=convention,
        gravity=gravity,
        name=None if robot is None else fspath(robot),
        log=None if log is None else Path(log),
        columns=dict(columns or {}),
        units=dict(units or {}),
        friction=friction,
        rotors=rotors,
        gear=gear,
        constant=torque_constant,
    )
    return RobotDraft(product=draft_robot(order))
