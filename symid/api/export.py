"""A robot with its values as a file for other programs.

Input: a robot whose file states values, or what was identified of one. Output: a file, and `ExportedFile`.
"""

from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Literal, final

from symid.api.result import Progress, Result, ignore
from symid.errors import Notice

if TYPE_CHECKING:  # these load NumPy and SymPy
    from symid.report.blocks import Block
    from symid.robot.description import Robot
    from symid.tasks.export import FileExport
    from symid.tasks.identified import GivenResult

__all__ = ["ExportedFile", "Precision", "export_fit", "export_robot"]

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
        from symid.report.export_text import show_export

        return show_export(self.product)

    def to_dict(self) -> dict[str, object]:
        """Return the file, how bodies were found, and what was left out, in plain types."""
        from symid.report.export_text import describe_export

        return describe_export(self.product)


def export_robot(
    robot: "Robot", path: str | PathLike[str], *, precision: Precision = "double", progress: Progress = ignore
) -> ExportedFile:
    """Write the values that the robot file states; see `RobotModel.export`."""
    progress(f"writing {robot.name}")
    from symid.tasks.export import write_stated

    return ExportedFile(product=write_stated(robot, Path(path), precision=precision))


def export_fit(
    robot: "Robot",
    found: "GivenResult",
    path: str | PathLike[str],
    *,
    precision: Precision = "double",
    progress: Progress = ignore,
) -> ExportedFile:
    """Write a robot with identified values, in the format that the name of the file ends in.

    Logs show combinations of masses and inertias; of all bodies that have them the nearest to those of the
    robot file are taken, and only bodies that can exist. Springs are written as found. Friction that was
    identified by itself goes into robot files, where they have a model of its law.

    Args:
        robot: that was identified.
        found: an estimate, rigid or elastic, or a result of friction; itself, or its file.
        path: of the file, which is written over: .toml, .urdf, .xml or .mjcf (MuJoCo), .h (C) or .json.
        precision: of the numbers in a C header: that of the generated library.
        progress: told what begins.

    Raises:
        UsageError: the format is unknown, or cannot hold this result.
        EstimateError: the result is of another model, or none that such a file can have.
        OutputError: the file cannot be written.
    """
    from symid.friction.results import FrictionIdentification
    from symid.tasks.export import check_format, write_identified
    from symid.tasks.friction_export import write_friction
    from symid.tasks.identified import build_identified, find_result, is_friction

    output = Path(path)
    check_format(output, precision, friction=is_friction(found))
    result, source = find_result(found)
    if isinstance(result, FrictionIdentification):
        progress(f"comparing {robot.name} with the model whose friction was identified")
        return ExportedFile(product=write_friction(robot, result, source, output))
    identified = build_identified(robot, result, source)
    progress(f"looking for bodies with the identified values of {robot.name}")
    return ExportedFile(product=write_identified(identified, source, output, precision=precision))
