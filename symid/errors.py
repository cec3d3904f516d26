"""The errors of symid, one tree, and the notices they are made of.

    SymidError                  70  a bug in symid, unless it is one of the following
    |-- UsageError               2  the call itself is wrong: a name, an option
    |-- InputError               3  a file holds something that cannot be used
    |   |-- RobotError              the robot file, or a robot that is not supported
    |   |-- LogError                the log, its columns, units, times
    |   `-- EstimateError           a file of identified parameters
    |-- OutputError              3  a folder or file that must not be written
    |-- GenerationError         70  generated code that does not compile or disagrees with itself
    |-- IdentifiabilityError     4  nothing is identifiable from this log
    `-- SolverError              5  a solver ended without a usable result

The number is the exit code of the command line. An error carries one notice or many: all mistakes of a file
are reported at once.
"""

from dataclasses import dataclass
from typing import ClassVar

NOTES = frozenset(
    (
        *("check.elastic", "elastic.motor-side", "estimate.settings-differ"),
        *("identify.automatic", "identify.second-encoder", "identify.slow-rows"),
        *("identify.unused-processing",),
        *("log.aligned", "log.converted", "log.cut", "log.folded", "log.in-line", "log.motor-position"),
        *("log.offset", "log.payload", "log.resampled"),
        *("new.assumed-gear", "new.assumed-order", "new.assumed-side", "new.ends", "new.gravity"),
        *("new.preset", "new.standstill", "new.unused-columns"),
        *("robot.assumed-gravity", "robot.cut-off", "robot.default-axis", "robot.elastic-joint"),
        *("robot.endless-limits", "robot.fixed-to-base", "robot.follower-still", "robot.lumped"),
        *("robot.renamed", "robot.urdf-unused"),
    )
)
"""Codes of notes, which report a choice or a fact; all other notices are warnings or errors."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Notice:
    """One message: what was found and where, what is allowed, what to do.

    Attributes:
        code: for programs, stable, as in "robot.unknown-key".
        text: for people.
        file: what it is about; empty where that is no file.
        line: counted from one, zero where there is no such place.
        column: likewise.

    Example:
        >>> import symid
        >>> print(symid.Notice(code="log.time", text="time does not increase", file="log.csv", line=7))
        log.csv:7: time does not increase
    """

    code: str
    text: str
    file: str = ""
    line: int = 0
    column: int = 0

    @property
    def is_note(self) -> bool:
        """Return whether it is a note, neither a warning nor an error."""
        return self.code in NOTES

    def __str__(self) -> str:
        """Return `file:line:column: text` with the parts that are known."""
        place = f"{self.file}:{self.line}" if self.line else self.file
        place += f":{self.column}" if self.line and self.column else ""
        return f"{place}: {self.text}" if place else self.text


class SymidError(Exception):
    """The root of all errors that symid raises on purpose.

    Example:
        >>> import symid
        >>> try:
        ...     symid.load("pand")
        ... except symid.SymidError as error:
        ...     error.notices[0].code
        'usage.unknown-robot'
    """

    exit_code: ClassVar[int] = 70

    def __init__(self, *notices: Notice) -> None:
        """Keep the notices; the text of the exception is theirs, one a line."""
        super().__init__("\n".join(str(notice) for notice in notices))
        self.notices = notices


class UsageError(SymidError):
    """The call is wrong: an unknown name, an option that does not fit."""

    exit_code = 2


class InputError(SymidError):
    """A file holds something that cannot be used."""

    exit_code = 3


class RobotError(InputError):
    """A robot file is wrong, or describes a robot that is not supported."""


class LogError(InputError):
    """A log is wrong, or does not fit the robot."""


class EstimateError(InputError):
    """A file of identified parameters is wrong, or belongs to another robot."""


class OutputError(SymidError):
    """A file or folder must not be written."""

    exit_code = 3


class GenerationError(SymidError):
    """Generated code does not compile, load, or agree with its own reference values."""


class IdentifiabilityError(SymidError):
    """Nothing is identifiable from the measurements."""

    exit_code = 4


class SolverError(SymidError):
    """A solver ended without a usable result."""

    exit_code = 5
