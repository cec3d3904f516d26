"""What the command line says, and where: results on stdout, everything else on stderr.

Input: an `Answer` or an error. Output: text for people, or with --json one object for programs:

    {"ok": true, "result": {...}, "warnings": [{"code", "file", "line", "column", "text"}]}
    {"ok": false, "errors": [{"code", "file", "line", "column", "text"}]}

An answer that is not acceptable, such as a gate missed, has `ok` false, its errors and its result.
Numbers that are not finite become null, which JSON has.
"""

import json
import math
import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import click

from symid.errors import Notice

__all__ = ["Answer", "Console", "format_table", "print_answer", "print_errors", "write_json"]

_NOTES = frozenset(
    {
        "check.elastic",
        "elastic.motor-side",
        "estimate.settings-differ",
        "identify.automatic",
        "identify.second-encoder",
        "identify.slow-rows",
        "identify.unused-processing",
        "log.aligned",
        "log.converted",
        "log.cut",
        "log.folded",
        "log.in-line",
        "log.motor-position",
        "log.offset",
        "log.payload",
        "log.resampled",
        "new.assumed-gear",
        "new.assumed-order",
        "new.assumed-side",
        "new.ends",
        "new.gravity",
        "new.preset",
        "new.standstill",
        "new.unused-columns",
        "robot.assumed-gravity",
        "robot.cut-off",
        "robot.default-axis",
        "robot.elastic-joint",
        "robot.endless-limits",
        "robot.fixed-to-base",
        "robot.follower-still",
        "robot.lumped",
        "robot.renamed",
        "robot.urdf-unused",
    }
)
"""Codes of what is as it was asked for, and only worth knowing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What a verb found out: `text` for people, `result` for programs.

    `errors` make the answer an unacceptable one; `exit_code` is then not zero.
    """

    text: str
    result: Mapping[str, object]
    warnings: tuple[Notice, ...] = ()
    errors: tuple[Notice, ...] = ()
    exit_code: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Console:
    """How much is said on stderr while a verb works."""

    quiet: bool = False
    verbose: bool = False
    start: float = field(default_factory=time.monotonic)

    def progress(self, text: str) -> None:
        """Say what begins now."""
        if not self.quiet:
            passed = f" [{time.monotonic() - self.start:.1f} s]" if self.verbose else ""
            click.echo(f"{text}{passed}", err=True)

    def detail(self, text: str) -> None:
        """Say something that only matters to those who asked for more."""
        if self.verbose:
            click.echo(text, err=True)


def print_answer(answer: Answer, *, as_json: bool, quiet: bool) -> None:
    """Print the answer on stdout, its warnings and errors on stderr or in the object."""
    if as_json:
        click.echo(write_json(_make_envelope(answer)))
        return
    if answer.text:
        click.echo(answer.text)
    if not quiet:
        _print_notices(answer.warnings, "warning", "yellow")
    _print_notices(answer.errors, "error", "red")


def print_errors(notices: Sequence[Notice], *, as_json: bool) -> None:
    """Print errors: on stderr, or as the one object on stdout."""
    if as_json:
        click.echo(write_json({"ok": False, "errors": [asdict(notice) for notice in notices]}))
    else:
        _print_notices(notices, "error", "red")


def write_json(value: object) -> str:
    """Return `value` as JSON text."""
    return json.dumps(_simplify(value), indent=2, allow_nan=False, ensure_ascii=False)


def format_table(header: Sequence[str], rows: Sequence[Sequence[object]], left: Sequence[int] = (0,)) -> str:
    """Return a table for reading; columns whose number is in `left` are flush left."""
    cells = [list(header), *([_show(value) for value in row] for row in rows)]
    widths = [max(len(row[k]) for row in cells) for k in range(len(header))]
    lines = [
        "  ".join(
            text.ljust(width) if k in left else text.rjust(width)
            for k, (text, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in cells
    ]
    rule = "  ".join("-" * width for width in widths)
    return "\n".join((lines[0], rule, *lines[1:]))


def _show(value: object) -> str:
    match value:
        case None:
            return ""
        case bool():
            return "yes" if value else "no"
        case float():
            return f"{value:.5g}" if math.isfinite(value) else "-"
    return str(value)


def _make_envelope(answer: Answer) -> dict[str, object]:
    envelope: dict[str, object] = {"ok": not answer.errors}
    if answer.errors:
        envelope["errors"] = [asdict(notice) for notice in answer.errors]
    envelope["result"] = answer.result
    envelope["warnings"] = [asdict(notice) for notice in answer.warnings]
    return envelope


def _simplify(value: object) -> object:
    """Return `value` in the types that JSON has."""
    match value:
        case float():
            return value if math.isfinite(value) else None
        case None | bool() | int() | str():
            return value
        case Path():
            return str(value)
        case Mapping():
            return {str(key): _simplify(entry) for key, entry in value.items()}
        case tuple() | list():
            return [_simplify(entry) for entry in value]
    message = f"no JSON for {type(value).__name__}"
    raise TypeError(message)


def _print_notices(notices: Sequence[Notice], title: str, colour: str) -> None:
    for notice in notices:
        # https://no-color.org: any value, if it is not empty, means no colour.
        note = notice.code in _NOTES
        word = "note" if note else title
        head = (
            word
            if os.environ.get("NO_COLOR")
            else click.style(word, fg="cyan" if note else colour, bold=True)
        )
        click.echo(f"{head}: {notice}", err=True)
