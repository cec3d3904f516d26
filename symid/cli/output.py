"""What the command line says, and where: results on stdout, everything else on stderr.

Input: an `Answer` or an error. Output: text for people, or with --json one object for programs:

    {"ok": true, "result": {...}, "warnings": [{"code", "file", "line", "column", "text"}]}
    {"ok": false, "errors": [{"code", "file", "line", "column", "text"}]}

An answer that is not acceptable, such as a gate missed, has `ok` false, its errors and its result.
Numbers that are not finite become null, which JSON has.
"""

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING

import click

from symid.errors import Notice
from symid.json_text import write_json

if TYPE_CHECKING:
    from symid.api.result import Result

__all__ = ["Answer", "Console", "make_answer", "print_answer", "print_errors"]


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


def make_answer(
    result: "Result", *lines: str, exit_code: int = 1, notices: Sequence[Notice] = (), **added: object
) -> Answer:
    """Return the answer that a result of the API gives.

    Args:
        result: what the API returned.
        lines: what the verb says besides, such as the file that it wrote.
        exit_code: where the result is not acceptable.
        notices: what the verb has to tell besides.
        added: entries of the object for programs.
    """
    return Answer(
        text="\n\n".join((result.tell(), *lines)),
        result={**result.to_dict(), **added},
        warnings=(*result.notices, *notices),
        errors=result.errors,
        exit_code=exit_code if result.errors else 0,
    )


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


def _make_envelope(answer: Answer) -> dict[str, object]:
    envelope: dict[str, object] = {"ok": not answer.errors}
    if answer.errors:
        envelope["errors"] = [asdict(notice) for notice in answer.errors]
    envelope["result"] = answer.result
    envelope["warnings"] = [asdict(notice) for notice in answer.warnings]
    return envelope


def _print_notices(notices: Sequence[Notice], title: str, colour: str) -> None:
    for notice in notices:
        # https://no-color.org: any value, if it is not empty, means no colour.
        note = notice.is_note
        word = "note" if note else title
        head = (
            word
            if os.environ.get("NO_COLOR")
            else click.style(word, fg="cyan" if note else colour, bold=True)
        )
        click.echo(f"{head}: {notice}", err=True)
