"""A call of `symid`: its verbs, what it prints and where, its exit codes, and what happens when one fails.

Arguments -> exit code; the verb's answer is printed: results on stdout, everything else on stderr, as text
for people, or with --json as one object for programs:

    {"ok": true, "result": {...}, "warnings": [{"code", "file", "line", "column", "text"}]}
    {"ok": false, "errors": [{"code", "file", "line", "column", "text"}]}

An answer that is not acceptable, such as a gate missed or a verdict "wrong", has `ok` false, its errors and
its result. Of warnings the three most important ones are printed, then as many notes, then errors; all in
`LINES` lines, where the longest tables are cut. What the reader of a robot file noted is printed by `check`
and `new`; other verbs count it. -v and --json give all.

Exit codes: 0 ok, 1 result not acceptable, 2 usage, 3 input wrong, 4 nothing identifiable, 5 solver failed or
memory ran out, 70 a bug in symid, 74 the output could not be written, 130 interrupted.
"""

import contextlib
import errno
import importlib
import os
import re
import signal
import sys
import threading
import time
import traceback
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from symid import __version__, report
from symid.environment import find_memory_limit, secure_linear_algebra, show_path
from symid.errors import MOST_WARNINGS, SEVERE, Notice, SymidError, list_notice_lines, sort_notices
from symid.serialization import write_json

if TYPE_CHECKING:
    from symid import Result
    from symid.report import Block


@dataclass(frozen=True, slots=True)
class Answer:
    """The answer of a verb: `blocks` for people, `brief` without --verbose; `result` for programs.

    With `errors` it is not acceptable, and `exit_code` is not zero; `sources` are its logs.
    """

    blocks: "tuple[Block, ...]"
    brief: "tuple[Block, ...]"
    result: Mapping[str, object]
    warnings: tuple[Notice, ...] = ()
    errors: tuple[Notice, ...] = ()
    exit_code: int = 0
    sources: tuple[str, ...] = ()

    def accept(self) -> "Answer":
        """Return the answer with a wrong verdict as a warning; other errors, such as a missed gate, stay."""
        kept = tuple(entry for entry in self.errors if entry.code not in _VERDICTS)
        wrong = tuple(entry for entry in self.errors if entry.code in _VERDICTS)
        code = self.exit_code if kept else 0
        return replace(self, warnings=(*wrong, *self.warnings), errors=kept, exit_code=code)

    def write(self, *lines: "Block", **added: object) -> "Answer":
        """Return the answer with further text and entries of the JSON."""
        result = {**self.result, **added}
        return replace(self, blocks=(*self.blocks, *lines), brief=(*self.brief, *lines), result=result)

    def add(self, results: "Sequence[Result]") -> "Answer":
        """Return the answer with warnings and errors of further results, those that it has not yet."""
        known = {(notice.code, notice.text) for notice in self.warnings}
        notices = (notice for result in results for notice in result.notices)
        warnings = (*self.warnings, *(one for one in notices if (one.code, one.text) not in known))
        errors = (*self.errors, *(error for result in results for error in result.errors))
        return replace(self, warnings=warnings, errors=errors, exit_code=self.exit_code or int(bool(errors)))


_VERDICTS = frozenset({"identify.wrong", "validate.wrong"})


def make_answer(
    result: "Result", *lines: str, exit_code: int = 1, notices: Sequence[Notice] = (), **added: object
) -> Answer:
    """Return the answer for a result of the API, with further text, notices and entries of the JSON."""
    opening = result.opening()
    return Answer(
        blocks=(*opening, *result.blocks(), *lines),
        brief=(*opening, *result.brief(), *lines),
        result={**result.to_dict(), **added},
        warnings=(*result.notices, *notices),
        errors=result.errors,
        exit_code=exit_code if result.errors else 0,
        sources=result.sources,
    )


def answer_saved(result: Any, output: Path | None, what: str, *lines: str, **added: Any) -> Answer:  # noqa: ANN401
    """Return the answer for a result of the API, which is saved if an `output` is given, as `make_answer`."""
    saved = [] if output is None else [f"{what}: {show_path(result.save(output))}"]
    return make_answer(result, *lines, *saved, file=output, **added)


_WIDE, _SILENCE = 79, 2.0
"""Columns of a line of a terminal that is written again, and seconds without a word before it is."""
_CLEAR = f"\r{'':{_WIDE}}\r"


@dataclass(frozen=True, slots=True, kw_only=True)
class Console:
    """Progress messages on stderr."""

    quiet: bool = False
    verbose: bool = False
    start: float = field(default_factory=time.monotonic)
    stages: list[str] = field(default_factory=list)

    def progress(self, text: str) -> None:
        """Print the stage that begins."""
        if not self.quiet:
            passed = f" [{time.monotonic() - self.start:.1f} s]" if self.verbose else ""
            self.stages.append(text)
            click.echo(f"{_CLEAR * sys.stderr.isatty()}{text}{passed}", err=True)

    @contextlib.contextmanager
    def tick(self) -> Iterator[None]:
        """Show in a terminal how long a stage takes, in a line that the next one replaces."""
        if self.quiet or not sys.stderr.isatty():
            yield
            return
        done, shown = threading.Event(), threading.Event()

        def show() -> None:
            while not done.wait(1.0):
                passed = time.monotonic() - self.start
                if passed > _SILENCE:
                    shown.set()
                    stage = self.stages[-1] if self.stages else "working"
                    click.echo(f"{_CLEAR}{f'{stage}: {passed:.0f} s'[:_WIDE]}", err=True, nl=False)

        thread = threading.Thread(target=show, daemon=True)
        thread.start()
        try:
            yield
        finally:
            done.set()
            thread.join()
            if shown.is_set():
                click.echo(_CLEAR, err=True, nl=False)

    def detail(self, text: str) -> None:
        """Print a detail with --verbose."""
        if self.verbose:
            click.echo(text, err=True)


LINES = 40
"""Lines of an answer without --verbose, with its progress and its notices: those of a terminal."""


def print_answer(answer: Answer, console: Console, *, as_json: bool, verbose: bool, whole: bool) -> None:
    """Print the answer on stdout, its warnings and errors on stderr or in the object.

    `whole` is whether the notes on the robot file are printed one by one.
    """
    if as_json:
        envelope: dict[str, object] = {"ok": not answer.errors}
        if answer.errors:
            envelope["errors"] = [asdict(notice) for notice in answer.errors]
        envelope["result"] = answer.result
        envelope["warnings"] = [asdict(notice) for notice in sort_notices(answer.warnings)]
        click.echo(write_json(envelope))
        return
    most = None if verbose else MOST_WARNINGS
    notices = list(answer.warnings)
    if not (verbose or whole):
        # One of a kind in place of those on a robot file that are not severe.
        mild = [entry for entry in notices if entry.code.startswith("robot.") and entry.code not in SEVERE]
        notices = [entry for entry in notices if entry not in mild]
        counts = Counter((entry.file, entry.is_note) for entry in dict.fromkeys(mild))
        for (file, is_note), count in counts.items():
            code, kind = ("robot.notes", "note") if is_note else ("robot.warnings", "warning")
            said = f"{count} {kind}{'s'[: count > 1]} on the robot file: symid check {file} prints "
            said += "them" if count > 1 else "it"
            notices.append(Notice(code=code, text=said, file=file))
    told = [] if console.quiet else [*list_notice_lines(notices, answer.sources, "-v shows them", most=most)]
    text = report.write_text(answer.blocks)
    # Without -v so many lines, the last of which says where the rest is.
    room = max(LINES - len(console.stages) - len(told) - len(answer.errors), LINES // 2)
    if not verbose and len(text.splitlines()) > room:
        stored = Path(str(answer.result.get("file", "")))
        held = f"; all values are in {show_path(stored)}" if stored.suffix == ".json" else ""
        text = f"{report.shorten_text(answer.brief, room - 2)}\n\nshortened: -v prints all{held}"
    if text:
        click.echo(text)
    for kind, line in told:
        _print_line(kind, line)
    print_errors(answer.errors)


def print_errors(notices: Sequence[Notice], *, as_json: bool = False) -> None:
    """Print errors: on stderr, or as the one object on stdout."""
    if as_json:
        click.echo(write_json({"ok": False, "errors": [asdict(notice) for notice in notices]}))
        return
    for notice in notices:
        _print_line("note" if notice.is_note else "error", str(notice))


_COLOURS = {"error": "red", "warning": "yellow", "note": "cyan"}


def _print_line(kind: str, text: str) -> None:
    # https://no-color.org: any value, if it is not empty, means no colour.
    head = kind if os.environ.get("NO_COLOR") else click.style(kind, fg=_COLOURS[kind], bold=True)
    click.echo(f"{head}: {text}", err=True)


_FILES = {
    verb: file
    for file, verbs in (
        ("first_steps", "new check"),
        ("dynamics", "derive base generate"),
        ("dynamics", "excite simulate"),
        ("identification", "identify"),
        ("results", "validate compare export"),
        ("identification", "payload hysteresis fleet"),
        ("results", "report"),
        ("first_steps", "plot"),
        ("dynamics", "study"),
        ("first_steps", "doctor demo"),
    )
    for verb in verbs.split()
}
"""File of each verb, in the order in which verbs are used; it is imported when one of them is called."""
VERBS = tuple(_FILES)
EXIT_USAGE = 2
EXIT_MEMORY = 5
EXIT_BUG = 70
EXIT_STREAM = 74
EXIT_INTERRUPTED = 130
_STREAM_ERRORS = frozenset({errno.EPIPE, errno.ENOSPC, errno.EIO, errno.EBADF, errno.EDQUOT})


class _Verbs(click.Group):
    """The group of verbs, imported on demand."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002  click's interface
        return list(VERBS)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002  click's interface
        """Write verbs and what they do, from the text of their files: none of them is imported for that."""
        texts = {file: Path(__file__).with_name(f"{file}.py").read_text("utf-8") for file in _FILES.values()}
        lines = []
        for name, file in _FILES.items():
            start = texts[file].index(f"def {name}_command(")
            said = re.compile(r'\) -> \w+:\n    """(.*?)(?:\n\n|""")', re.DOTALL).search(texts[file], start)
            lines.append((name, "" if said is None else " ".join(said[1].split()).removesuffix(".")))
        with formatter.section("Commands"):
            formatter.write_dl(lines)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        if cmd_name not in _FILES:
            return None
        file = importlib.import_module(f"symid.cli.{_FILES[cmd_name]}")
        found: click.Command = getattr(file, f"{cmd_name}_command")
        return found


@click.group(cls=_Verbs, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="symid")
def symid() -> None:
    """From a robot description to exact dynamics, fast code and identified parameters.

    ROBOT is the path of a robot file, or the name of one in ./robots or of those that come with symid.
    """


def answer_call(arguments: Sequence[str]) -> int:
    """Run the command line with `arguments`, print its answer, and return the exit code."""
    if sys.stdout is None:
        return _explain_stream(OSError(errno.EBADF, "standard output is closed"))
    try:
        return _answer(arguments)
    except OSError as error:
        return _explain_stream(error)


def _answer(arguments: Sequence[str]) -> int:
    # Flags are read here, because a call that cannot be parsed must be answered in kind.
    flags = frozenset(_take_flags(arguments))
    as_json, quiet = "--json" in flags, bool(flags & {"-q", "--quiet"})
    verbose = bool(flags & {"-v", "--verbose"})
    console = Console(quiet=quiet, verbose=verbose and not (quiet or as_json))
    try:
        if find_memory_limit() is not None and not {"-h", "--help", "--version"} & {*arguments}:
            secure_linear_algebra()
        with console.tick():
            answer = symid.main(args=list(arguments), prog_name="symid", standalone_mode=False, obj=console)
        if not isinstance(answer, Answer):
            # --help and --version print for themselves and return their exit code.
            return int(answer or 0)
        whole = not {"check", "new"}.isdisjoint(arguments[:1])
        print_answer(answer, console, as_json=as_json, verbose=verbose, whole=whole)
        sys.stdout.flush()
    except (KeyboardInterrupt, click.Abort):
        return _explain_interruption(as_json=as_json)
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message(), err=True)
        return EXIT_USAGE
    except click.ClickException as error:
        context = getattr(error, "ctx", None)
        hint = "" if context is None else f" Try '{context.command_path} --help'."
        print_errors([Notice(code="usage.call", text=error.format_message() + hint)], as_json=as_json)
        return EXIT_USAGE
    except SymidError as error:
        if error.exit_code == EXIT_BUG and find_memory_limit() is not None:
            return _explain_shortage(str(error), as_json=as_json)
        print_errors(error.notices, as_json=as_json)
        return error.exit_code
    except Exception as error:  # noqa: BLE001  the last line before the user
        if isinstance(error, OSError) and error.filename is None and error.errno in _STREAM_ERRORS:
            return _explain_stream(error)
        if verbose:
            click.echo("".join(traceback.format_exception(error)), err=True, nl=False)
        if isinstance(error, MemoryError) or find_memory_limit() is not None:
            sure = isinstance(error, MemoryError)
            return _explain_shortage(f"{type(error).__name__}: {error}", as_json=as_json, sure=sure)
        hint = "" if verbose else "; call again with -v for the traceback, and report it"
        text = f"this is a bug in symid, not in your files: {type(error).__name__}: {error}{hint}"
        print_errors([Notice(code="symid.bug", text=text)], as_json=as_json)
        return EXIT_BUG
    return answer.exit_code


def _explain_interruption(*, as_json: bool) -> int:
    print_errors([Notice(code="symid.interrupted", text="interrupted")], as_json=as_json)
    return EXIT_INTERRUPTED


def _explain_shortage(reason: str, *, as_json: bool, sure: bool = False) -> int:
    """Report in one line that memory ran out, if `sure`, or may have: C code fails in many ways then."""
    # Solvers in C make errors of their own of an interruption, after which both signals are ignored.
    if all(signal.getsignal(one) is signal.SIG_IGN for one in (signal.SIGINT, signal.SIGTERM)):
        return _explain_interruption(as_json=as_json)
    limit = find_memory_limit()
    if limit is None:
        text = f"memory ran out ({reason}); end other programs, or give less data"
    elif sure:
        text = f"too little memory: ulimit -v allows {limit} MB of address space, allow more ({reason})"
    else:
        text = f"probably too little memory: ulimit -v allows {limit} MB of address space ({reason}); allow "
        text += "more. If the same comes without a limit, it is a bug in symid: report it"
    print_errors([Notice(code="symid.memory", text=" ".join(text.split()))], as_json=as_json)
    return EXIT_MEMORY


def explain_crash(arguments: Sequence[str], code: int) -> int:
    """Report in one line how a process that did the work ended without an answer, and return the exit code.

    `code` is its own, or minus the number of the signal that ended it.
    """
    as_json = "--json" in _take_flags(arguments)
    reason = f"ended by {signal.Signals(-code).name}" if code < 0 else f"ended with {code}"
    # The system kills a process by SIGKILL when its memory runs out.
    if code == -signal.SIGKILL or find_memory_limit() is not None:
        return _explain_shortage(reason, as_json=as_json)
    text = f"this is a bug in symid, not in your files: {reason}; report it"
    print_errors([Notice(code="symid.bug", text=text)], as_json=as_json)
    return EXIT_BUG


def _explain_stream(error: OSError) -> int:
    """Report in one line that the answer cannot be written, unless the reader has closed the pipe."""
    if sys.stdout is not None:
        # Python must not complain about it again when it flushes at exit.
        with contextlib.suppress(OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    if error.errno != errno.EPIPE:
        with contextlib.suppress(OSError):
            click.echo(f"error: the answer cannot be written: {error.strerror}", err=True)
    return EXIT_STREAM


def _take_flags(arguments: Sequence[str]) -> list[str]:
    """Return the flags that stand in the arguments, bundled short ones such as -qv apart."""
    flags: list[str] = []
    for argument in arguments:
        if argument == "--":
            break
        if argument.startswith("--"):
            flags.append(argument)
        elif argument[:1] == "-" and set(argument[1:]) <= {"q", "v"}:
            flags += [f"-{letter}" for letter in argument[1:]]
    return flags
