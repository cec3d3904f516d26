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

import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

NOTES = frozenset(
    (
        *("check.elastic", "elastic.known", "elastic.motor-side", "elastic.spring-kind"),
        *("export.source-edited", "estimate.settings-differ", "identify.automatic", "identify.friction-law"),
        *("identify.friction-state", "identify.second-encoder", "identify.slow-rows"),
        *("identify.measured-load", "identify.plain-friction", "identify.bad-rows"),
        *("identify.unused-processing", "lesson.not-executed"),
        *(
            "log.joint-endings",
            "log.aligned",
            "log.converted",
            "log.cut",
            "log.delay-refuted",
            "log.folded",
            "log.in-line",
        ),
        *("log.episodes", "log.layout", "log.missing", "log.sample-rate", "log.time-unit"),
        *("log.motor-position", "log.no-motor", "log.offset", "log.payload", "log.resampled"),
        *("log.topic-read", "log.torque-peaks", "log.transposed", "log.unused-columns", "log.wraps"),
        *("log.incomplete-messages", "identify.mounting", "robot.free-gravity"),
        *("new.assumed-order", "new.assumed-side", "new.gravity"),
        *("new.friction-kept", "new.preset", "new.unused-columns", "payload.controller-scope"),
        *("robot.assumed-gravity", "robot.cut-off", "robot.default-axis", "robot.elastic-joint"),
        *("robot.endless-limits", "robot.fixed-to-base", "robot.follower-still", "robot.lumped"),
        *("robot.mjcf-controller", "robot.mjcf-unused", "robot.angle-rounded", "robot.renamed"),
        *("robot.axis-length", "robot.length-snapped", "robot.notes", "robot.rounding-assumed"),
        *("robot.rounding-price", "robot.uneven-limits", "robot.urdf-unused", "robot.xacro-arguments"),
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


SEVERE = (
    *("identify.wrong", "validate.wrong", "identify.doubtful", "validate.doubtful"),
    *("log.several-causes", "robot.gravity", "robot.no-friction", "robot.unused-body"),
    *("log.swapped-joints", "log.torque-sign", "log.position-sign", "log.looks-like-degrees"),
    *("identify.scale", "log.effort-size"),
    *("log.wrong-unit", "log.time-scale", "log.joint-zero", "log.in-proportion"),
    *("log.torque-size", "log.torque-beyond-limit", "log.beyond-limits", "log.torque-delay"),
    *("log.constant-position", "log.constant-torque", "log.velocity-differs", "log.repeated-samples"),
    *("log.stuck", "log.jumps", "log.repeats", "log.clipped", "log.spikes"),
    *("log.gap", "log.jitter", "validate.fitted-log"),
    *("identify.impossible-mass", "elastic.outcome", "elastic.not-converged", "identify.huber-not-converged"),
    *("identify.no-filter", "identify.low-cutoff", "identify.biased-wls", "identify.moving-ends"),
    *("identify.tracking", "identify.structure", "identify.pattern", "friction.pattern"),
)
"""Codes of warnings, the most important first: what makes values wrong stands before what blurs them."""
MILD = (
    *("elastic.not-identifiable", "log.not-excited", "log.faint-parameters", "identify.poorly-identifiable"),
    *("elastic.poorly-identifiable", "log.standstill", "identify.refused", "friction.refused"),
    *("friction.joint-refused", "log.no-reference", "codegen.cache-rebuilt", "codegen.cache-temporary"),
)
"""Codes of warnings behind all others, the least important last: what tables say too, what is not used."""
MOST_WARNINGS = 3
"""Warnings that are printed below a result; the others are counted."""
_NUMBER = re.compile(r"(?<![\w.'])[+-]?\d+(?:\.\d+)?(?:e[+-]?\d+)?(?![\w'])")
_JOINT = re.compile(r"joint ('[^']*'):")
_NAMED = 3
"""Files of a merged notice that are named."""


_RANKS = {code: place for place, code in enumerate((*SEVERE, "", *MILD))}
"""Places of codes among others, the empty one that of all that are not listed."""


def rank_notice(notice: Notice) -> int:
    """Return the place of a notice among others by its code: severe warnings, others, mild ones, notes."""
    return len(_RANKS) if notice.is_note else _RANKS.get(notice.code, _RANKS[""])


def sort_notices(notices: Iterable[Notice]) -> tuple[Notice, ...]:
    """Return every notice once, the most important warning first and notes last."""
    return tuple(sorted(dict.fromkeys(notices), key=rank_notice))


def list_notice_lines(
    notices: Iterable[Notice], sources: Collection[str], where: str, *, most: int | None = MOST_WARNINGS
) -> Iterator[tuple[str, str]]:
    """Yield kind and text of what is printed: `most` warnings, as many notes, and how many more there are.

    `sources` are all logs, as for `merge_notices`; `where` says how the others are seen.
    """
    merged = merge_notices(notices, sources)
    for kind in ("warning", "note"):
        texts = [str(entry) for entry in merged if entry.is_note is (kind == "note")]
        yield from ((kind, text) for text in texts[:most])
        if more := len(texts) - len(texts[:most]):
            yield kind, f"and {more} more {kind}{'s'[: more > 1]}: {where}"


def shorten_names(words: Iterable[str], most: int = 12) -> str:
    """Return names as a list in a sentence, of which `most` are named and the others counted."""
    names = list(words)
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def merge_notices(notices: Iterable[Notice], sources: Collection[str] = ()) -> tuple[Notice, ...]:
    """Return the notices in their order, those of several logs that differ by numbers at most as one.

    `sources` are all logs, so that what holds for each of them can be said so.
    """
    groups: dict[tuple[str, str, int], list[Notice]] = {}
    for notice in sort_notices(notices):
        template = _NUMBER.sub("#", notice.text)
        # Several notices of one file are several findings: the first ones belong together, the second ones.
        turn = 0
        while any(
            not notice.file or notice.file == other.file
            for other in groups.get((notice.code, template, turn), ())
        ):
            turn += 1
        groups.setdefault((notice.code, template, turn), []).append(notice)
    merged = [_merge(group, sources) for group in groups.values()]
    alike: dict[tuple[str, str, str], list[Notice]] = {}
    for notice in merged:
        # What is about one joint may be reported of each, with other numbers.
        found = _JOINT.match(notice.text)
        template = _NUMBER.sub("#", notice.text[found.end() :]) if found else str(notice)
        alike.setdefault((notice.code, template, notice.file), []).append(notice)
    named = []
    for first, *others in alike.values():
        names = [found[1] for notice in others if (found := _JOINT.match(notice.text))]
        more = f" (likewise, with other numbers: {', '.join(names)})" if names else ""
        named.append(replace(first, text=first.text + more))
    return tuple(named)


def _merge(group: Sequence[Notice], sources: Collection[str]) -> Notice:
    first, count = group[0], len(group)
    if count == 1:
        return first
    files = [notice.file for notice in group]
    if any(notice.text != first.text for notice in group):
        others = f"{count - 1} more file{'s'[: count > 2]}"
        return replace(first, text=f"{first.text} (and with other numbers in {others})")
    named = sources and {*files} == {*sources}
    names = f"all {count} logs" if named else shorten_names(files, _NAMED)
    return replace(first, text=f"{first.text} ({names})", file="", line=0, column=0)


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

    @classmethod
    def refuse(cls, texts: Iterable[str], *, code: str) -> None:
        """Raise this error with a notice for each of the texts, if there are any."""
        if notices := [Notice(code=code, text=text) for text in texts]:
            raise cls(*notices)


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
