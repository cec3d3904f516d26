"""Robot files in and out: a draft to complete by hand, and a robot with its values for other programs.

URDF, table of rows or robot at hand, and a log -> `RobotDraft`; robot whose file states values, or what was
identified of one -> a file, and `ExportedFile`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Literal, final

from symid import report
from symid.api.result import Progress, Result, ignore
from symid.errors import Notice

if TYPE_CHECKING:
    from symid.identification import FileExport, GivenResult
    from symid.logs import Draft
    from symid.report import Block
    from symid.robot import Robot


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
        from symid.environment import check_suffix, write_file

        file = Path(path)
        check_suffix(file, "a robot file", (".toml",))
        write_file(file, self.text)
        return file

    def summarise(self) -> str:
        """Return name and number of joints."""
        return report.summarise_draft(self.robot)

    def blocks(self) -> "tuple[Block, ...]":
        """Return the robot, and the columns and units of its log."""
        return report.show_draft(self.product)

    def to_dict(self) -> dict[str, object]:
        """Return robot, joints and log in plain types."""
        return report.describe_draft(self.product)


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
    from symid.logs import DraftOrder, draft_robot

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


Precision = Literal["double", "float"]


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ExportedFile(Result):
    """A file that was written.

    Attributes:
        product: what was written, with the bodies or the friction that were found.

    Example:
        >>> import symid
        >>> written = symid.load("two_link").export("two_link.xml")
        >>> written.format, written.file.name
        ('MJCF model', 'two_link.xml')
    """

    product: "FileExport"

    @property
    def file(self) -> Path:
        """Return the path of the file."""
        return self.product.file

    @property
    def format(self) -> str:
        """Return what the file is: "robot file", "URDF", "MJCF model", "C header" or "values as JSON"."""
        return self.product.format

    @property
    def left_out(self) -> tuple[str, ...]:
        """Return what the format has no words for; it stands in comments."""
        return self.product.left_out

    @property
    def not_identified(self) -> tuple[str, ...]:
        """Return what has no identified value, so that the robot file's own or the nearest bodies stand."""
        return self.product.missing

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return what a user of the file must know."""
        return self.product.notices

    def summarise(self) -> str:
        """Return what the file is, and where."""
        return f"{self.format}: {self.file}"

    def blocks(self) -> "tuple[Block, ...]":
        """Return what was written and where, and how bodies were found or which laws joints have."""
        return report.show_export(self.product)

    def to_dict(self) -> dict[str, object]:
        """Return the file, how bodies were found, and what was left out, in plain types."""
        return report.describe_export(self.product)


def export_fit(
    robot: "Robot",
    found: "GivenResult",
    path: str | PathLike[str],
    *,
    precision: Precision = "double",
    progress: Progress = ignore,
) -> ExportedFile:
    """Write a robot with what was identified, a fit or its file; see `Fit.export`.

    Springs are written as found. Friction that was identified by itself goes into robot files, where they
    have a model of its law.
    """
    from symid.identification import (
        build_identified,
        check_format,
        read_result,
        write_friction,
        write_identified,
    )
    from symid.identification.friction import FrictionIdentification

    output = Path(path)
    result, source = read_result(found)
    check_format(output, precision, friction=isinstance(result, FrictionIdentification))
    if isinstance(result, FrictionIdentification):
        progress(f"comparing {robot.name} with the model whose friction was identified")
        return ExportedFile(product=write_friction(robot, result, source, output))
    identified = build_identified(robot, result, source)
    progress(f"looking for bodies with the identified values of {robot.name}")
    return ExportedFile(product=write_identified(identified, source, output, precision=precision))
