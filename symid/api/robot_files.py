"""Robot files: a draft to complete by hand, and export with values to other formats.

URDF, table of rows or existing robot, and a log -> `RobotDraft`; robot with values, or a fit -> a file, and
`ExportedFile`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from os import PathLike, fspath
from pathlib import Path
from typing import Literal, final

from symid import identification, joint_models, logs as log_files, report, robot as robots
from symid.api.result import Progress, Result, ignore
from symid.environment import check_suffix, show_path, write_file
from symid.errors import EstimateError, Notice
from symid.identification import friction as friction_fits
from symid.options import DraftOptions, ExportOptions, Numbers, merge


@final
class RobotDraft(Result):
    """A new robot file, not yet written.

    Attributes:
        product: the robot, the text, and the columns of the log.

    Example:
        >>> import symid
        >>> draft = symid.new_robot(robot="scara")
        >>> len(symid.load(draft.save("mine.toml")).joints)
        4
    """

    product: "log_files.Draft"

    @property
    def robot(self) -> "robots.Robot":
        """Return the robot."""
        return self.product.robot

    @property
    def source(self) -> Path:
        """Return the source file."""
        return self.product.source

    @property
    def text(self) -> str:
        """Return the text of the file (TOML), with comments for unknown values."""
        return self.product.text

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return assumptions, and warnings on source and log."""
        return self.product.notices

    def save(self, path: str | PathLike[str]) -> Path:
        """Write the file to `path`, and return the path; an existing file is overwritten.

        Raises:
            OutputError: the suffix is not .toml, or the file cannot be written.
        """
        file = Path(path)
        check_suffix(file, "a robot file", (".toml",))
        write_file(file, robots.move_source(self.text, self.robot, file.parent))
        return file

    def summarise(self) -> str:
        """Return the name and the number of joints."""
        return f"{self.robot.name}, {len(self.robot.joints)} joint{'s'[: len(self.robot.joints) != 1]}"

    def blocks(self) -> "tuple[report.Block, ...]":
        """Return the robot, and the columns and units of its log."""
        part = self.product.log
        if part is None:
            return (self.summarise(),)
        preset = "" if part.robot.log.preset is None else f" (columns of {part.robot.log.preset})"
        read = part.read.items()
        rows = [(name, ", ".join(entry.columns), ", ".join(part.units[name])) for name, entry in read]
        title = f"log: {part.file}{preset}"
        return (self.summarise(), report.Table(("quantity", "columns", "unit"), rows, (0, 1, 2), title))

    def _describe(self) -> dict[str, object]:
        joints = [{"name": joint.name, "kind": joint.kind.value} for joint in self.robot.joints]
        part = self.product.log
        log = part and {
            "file": part.file,
            "preset": part.robot.log.preset,
            "columns": {name: list(entry.columns) for name, entry in part.read.items()},
            "units": {name: ", ".join(part.units[name]) for name in part.read},
            "unused": list(part.unused),
        }
        given = {"log": log} if log else {}
        return {"robot": self.robot.name, "joints": joints, **given, "notices": len(self.notices)}


def new_robot(
    *,
    urdf: str | PathLike[str] | None = None,
    table: str | PathLike[str] | None = None,
    robot: str | PathLike[str] | None = None,
    log: str | PathLike[str] | None = None,
    columns: Mapping[str, str | Sequence[str]] | None = None,
    units: Mapping[str, str | Sequence[str]] | None = None,
    convention: Literal["modified", "standard"] | None = None,
    friction: str | None = None,
    rotors: bool | None = None,
    torque_constant: Numbers | None = None,
    options: DraftOptions | None = None,
    progress: Progress = ignore,
) -> RobotDraft:
    """Return a robot file to complete by hand, from one of `urdf`, `table` and `robot`.

    Args:
        urdf: a URDF or an MJCF model (MuJoCo); the content says which.
        table: a CSV table of Denavit-Hartenberg rows.
        robot: an existing robot: a robot file is copied, a URDF or MJCF is converted.
        log: a log of the robot: its columns and their units become the `[log]` table.
        columns: columns of the log by quantity (time, position, torque, velocity), or the topic of a bag
            ("topic"); recognised by their names by default.
        units: units of the columns by quantity, one for each or one for all, if the log states none.
        convention: for the table: "modified" or "standard"; it is never guessed.
        friction: the friction model of all joints.
        rotors: give every drive a rotor with unknown inertia.
        torque_constant: N m/A at the motor, one for each joint or one for all.
        options: all options, such as `symid.DraftOptions(gear=80.0)`; the arguments above take precedence.
        progress: called with a short text at each stage.

    Raises:
        UsageError: the arguments do not go together.
        RobotError: the source has mistakes.
        LogError: the log cannot be read, or its columns are not recognised.

    Example:
        >>> import symid
        >>> draft = symid.new_robot(robot="scara")
        >>> draft.text.count("[[joint]]")
        4
    """
    source = urdf or table or robot
    if source is not None:
        progress(f"reading {fspath(source)}")
    given = merge(
        options, DraftOptions(), convention=convention, rotors=rotors, torque_constant=torque_constant
    )
    product = log_files.draft_robot(
        given,
        urdf=None if urdf is None else Path(urdf),
        table=None if table is None else Path(table),
        name=None if robot is None else fspath(robot),
        log=None if log is None else Path(log),
        columns=dict(columns or {}),
        units=dict(units or {}),
        friction=friction,
    )
    return RobotDraft(product=product)


@final
class ExportedFile(Result):
    """A written file.

    Attributes:
        product: the full result, with the written bodies or friction laws.

    Example:
        >>> import symid
        >>> written = symid.load("two_link").export("two_link.xml")
        >>> written.format, written.file.name
        ('MJCF model', 'two_link.xml')
    """

    product: "identification.FileExport"

    @property
    def file(self) -> Path:
        """Return the path of the file."""
        return self.product.file

    @property
    def format(self) -> str:
        """Return "robot file", "URDF", "MJCF model", "USD stage", "C header" or "values as JSON"."""
        return self.product.format

    @property
    def left_out(self) -> tuple[str, ...]:
        """Return the parts that the format cannot hold; new files have them in comments."""
        return self.product.left_out

    @property
    def not_identified(self) -> tuple[str, ...]:
        """Return the parameters without an identified value; robot file or nearest bodies give one."""
        return self.product.missing

    def summarise(self) -> str:
        """Return the format and the path."""
        return f"{self.format}: {self.file}"

    def blocks(self) -> "tuple[report.Block, ...]":
        """Return the format and the path, and the accuracy of bodies or the laws of joints."""
        found = self.product
        lines = [f"{found.format}: {show_path(found.file)}"]
        lines += [] if found.standard is None else [found.standard.outcome.value]
        lines += [f"all else as in {found.rewritten}"] if found.rewritten else []
        if found.costs:
            parts = (f"{entry.joint} {entry.percent:.2g} %" for entry in found.costs)
            lines.append(f"torque that these bodies add to the residual: {', '.join(parts)}")
        if found.scales:
            parts = (f"{entry.joint} {entry.ratio:.3g}" for entry in found.scales)
            lines.append(f"torque, identified / robot file: {', '.join(parts)}")
        if found.friction is not None:
            laws = found.friction.laws
            pairs = ((joint, laws[joint], entry.law) for joint, entry in found.friction.values.items())
            lines += [f"{joint}: {law}{f' as {written}' * (law != written)}" for joint, law, written in pairs]
        return ("\n".join(lines),)

    def _describe(self) -> dict[str, object]:
        found, file, name = self.product, str(self.file), self.product.robot.name
        if found.friction is not None:
            written = {
                joint: {
                    "law": found.friction.laws[joint],
                    "model": values.law,
                    "values": joint_models.name_values(values),
                    "shape": joint_models.name_shape(values),
                    "smoothing": values.smoothing,
                }
                for joint, values in found.friction.values.items()
            }
            return {"file": file, "robot": name, "written": written, "kept": dict(found.friction.kept)}
        bodies = found.standard and {
            "largest_change": max(map(abs, found.standard.residual.tolist()), default=0.0),
            "blamed": found.standard.blamed,
            "not_identified": found.missing,
            "torque_ratio": {entry.joint: entry.ratio for entry in found.scales},
            "cost_percent": {entry.joint: entry.percent for entry in found.costs},
        }
        how = {"elastic": any(found.robot.elastic), "outcome": found.outcome, **(bodies or {})}
        return {"file": file, "format": found.format, "robot": name, **how, "left_out": found.left_out}


def export_fit(
    robot: "robots.Robot",
    found: "identification.GivenResult",
    path: str | PathLike[str] | None,
    options: ExportOptions | None = None,
    progress: Progress = ignore,
) -> ExportedFile:
    """Write a robot with the values of a fit, or of its file; see `Fit.export`.

    Springs are written as identified. Friction laws are written to robot files if these have a model for
    them.
    """
    options = options or ExportOptions()
    output = identification.locate_source(robot) if path is None else Path(path)
    result, source = identification.read_result(found)
    is_friction = isinstance(result, friction_fits.FrictionIdentification)
    identification.check_format(output, options, friction=is_friction)
    verdict = report.judge_fit(result)
    if verdict.level == "wrong" and not options.accept:
        text = f"the verdict on this fit is wrong: {verdict.headline} {verdict.remedy} Then identify again, "
        text += "or write the file all the same with --accept (accept=True)"
        raise EstimateError(Notice(code="export.wrong", text=text, file=str(source)))
    identification.refuse_overloads(result, robot, source, options.ratio)
    if isinstance(result, friction_fits.FrictionIdentification):
        progress(f"comparing {robot.name} with the model whose friction was identified")
        written = identification.write_friction(robot, result, source, output)
    else:
        identified = identification.build_identified(robot, result, source)
        progress(f"computing consistent bodies with the identified values of {robot.name}")
        written = identification.write_identified(identified, source, output, options)
    notices = (*report.list_verdict_notices(verdict, str(source)), *written.notices)
    return ExportedFile(product=replace(written, notices=notices))
