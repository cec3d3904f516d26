"""A call of `symid`: its verbs, its exit codes, and what happens when one fails.

Input: the arguments. Output: the exit code; the verb's answer is printed.

Exit codes: 0 ok, 1 result not acceptable, 2 usage, 3 input wrong, 4 nothing identifiable,
5 solver failed, 70 a bug in symid, 74 the output could not be written, 130 interrupted.

A verb's module is imported when the verb is called, and heavy packages inside the verb.
"""

import contextlib
import errno
import importlib
import os
import sys
import traceback
from collections.abc import Sequence

import click

from symid import __version__
from symid.cli.output import Answer, print_answer, print_errors
from symid.errors import Notice, SymidError

__all__ = ["VERBS", "run", "symid"]

VERBS = (
    "new",
    "check",
    "derive",
    "base",
    "generate",
    "excite",
    "simulate",
    "identify",
    "validate",
    "compare",
    "export",
    "payload",
    "report",
    "study",
    "doctor",
    "demo",
)
EXIT_USAGE = 2
EXIT_BUG = 70
EXIT_STREAM = 74
EXIT_INTERRUPTED = 130
_STREAM_ERRORS = frozenset({errno.EPIPE, errno.ENOSPC, errno.EIO, errno.EBADF, errno.EDQUOT})


class _Verbs(click.Group):
    """A group whose commands are modules of this room, imported on demand."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002  click's interface
        """Return the verbs in the order in which they are used."""
        return list(VERBS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """Return the verb, or None."""
        if cmd_name not in VERBS:
            return None
        module = importlib.import_module(f"symid.cli.{cmd_name}")
        command: click.Command = module.command
        return command


@click.group(cls=_Verbs, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="symid")
def symid() -> None:
    """From a robot description to exact dynamics, fast code and identified parameters.

    ROBOT is the path of a robot file, or the name of one in ./robots or of those that come with symid.
    """


def run(arguments: Sequence[str]) -> int:
    """Run the command line with `arguments`, print what it has to say, and return the exit code."""
    if sys.stdout is None:
        return _explain_stream(OSError(errno.EBADF, "standard output is closed"))
    try:
        return _answer(arguments)
    except OSError as error:
        return _explain_stream(error)


def _answer(arguments: Sequence[str]) -> int:
    # Options are read here as well, because a call that cannot be parsed must be answered in kind.
    flags = frozenset(_take_flags(arguments))
    as_json = "--json" in flags
    try:
        answer = symid.main(args=list(arguments), prog_name="symid", standalone_mode=False)
        if not isinstance(answer, Answer):
            # --help and --version print for themselves and return their exit code.
            return int(answer or 0)
        print_answer(answer, as_json=as_json, quiet=bool(flags & {"-q", "--quiet"}))
        sys.stdout.flush()
    except (KeyboardInterrupt, click.Abort):
        notice = Notice(code="symid.interrupted", text="interrupted")
        print_errors([notice], as_json=as_json)
        return EXIT_INTERRUPTED
    except click.ClickException as error:
        return _explain_usage(error, as_json=as_json)
    except SymidError as error:
        print_errors(error.notices, as_json=as_json)
        return error.exit_code
    except Exception as error:  # noqa: BLE001  the last line before the user
        if isinstance(error, OSError) and error.filename is None and error.errno in _STREAM_ERRORS:
            return _explain_stream(error)
        return _explain_bug(error, as_json=as_json, verbose=bool(flags & {"-v", "--verbose"}))
    return answer.exit_code


def _explain_stream(error: OSError) -> int:
    """Say in one line that nobody gets the answer; say nothing to a reader that has gone."""
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


def _explain_usage(error: click.ClickException, *, as_json: bool) -> int:
    context = getattr(error, "ctx", None)
    if isinstance(error, click.exceptions.NoArgsIsHelpError):
        click.echo(error.format_message(), err=True)
        return EXIT_USAGE
    text = error.format_message()
    if context is not None:
        text += f" Try '{context.command_path} --help'."
    print_errors([Notice(code="usage.call", text=text)], as_json=as_json)
    return EXIT_USAGE


def _explain_bug(error: Exception, *, as_json: bool, verbose: bool) -> int:
    if verbose:
        click.echo("".join(traceback.format_exception(error)), err=True, nl=False)
    text = f"this is a bug in symid, not in your files: {type(error).__name__}: {error}"
    if not verbose:
        text += "; call again with -v for the traceback, and report it"
    print_errors([Notice(code="symid.bug", text=text)], as_json=as_json)
    return EXIT_BUG
