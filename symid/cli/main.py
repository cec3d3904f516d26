"""The entry of the command `symid`: a worker does what is asked, its parent answers signals and crashes.

Arguments -> exit code; `symid.cli.call` has the codes and their meaning. Linear algebra and solvers in C hear
no signal before they return, and some end the process, or never return, where memory runs out. So the process
that was called waits, light enough to answer from the first moment, and a fork of it works.

Not supported: systems without `sigtimedwait` (macOS, Windows): there one process does both, as far as it can.
"""

import atexit
import contextlib
import math
import os
import signal
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from symid.environment import clear_scratch, limit_to_one_thread

_INTERRUPTED = 130
_GRACE = 1.0
"""Seconds in which a worker that is asked to end removes its scratch and ends its own processes."""
_DIE_WITH_PARENT = 1
"""PR_SET_PDEATHSIG of Linux."""
_LONG = 1e6
"""Seconds between two looks at a worker that says nothing."""


def main() -> NoReturn:
    """Run the command line and exit; linear algebra gets one thread, so that cores do not change results."""
    limit_to_one_thread()
    if hasattr(signal, "sigtimedwait"):
        sys.exit(_work_in_fork(sys.argv[1:]))
    sys.exit(_work(sys.argv[1:]))


def run(arguments: Sequence[str]) -> int:
    """Run the command line with `arguments`, print what it has to say, and return the exit code."""
    # click takes a while to load; an interruption then must not end in a traceback.
    from symid.cli.call import answer_call as answer

    return answer(arguments)


def _work(arguments: Sequence[str]) -> int:
    # Whoever ends this process gets what Ctrl-C gets: scratch files removed, workers ended, one line.
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _interrupt)
    try:
        return run(arguments)
    except SystemExit as ended:
        # What completes words for a shell ends by itself.
        return ended.code if isinstance(ended.code, int) else 0
    except KeyboardInterrupt:
        # It came while modules were loaded, or while the answer was printed.
        os.write(2, b"error: interrupted\n")
        return _INTERRUPTED


def _interrupt(*_: object) -> NoReturn:
    # A second signal, such as the parent's after the terminal's, must not interrupt what cleans up.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise KeyboardInterrupt


def _work_in_fork(arguments: Sequence[str]) -> int:
    """Work in a forked process, pass signals on to it, and return its exit code, or that of its crash."""
    heard = [s for s in (signal.SIGINT, signal.SIGTERM) if signal.getsignal(s) is not signal.SIG_IGN]
    waited = {signal.SIGCHLD, *heard}
    before = signal.pthread_sigmask(signal.SIG_BLOCK, waited)
    parent, (reader, writer) = os.getpid(), os.pipe()
    worker = os.fork()
    if not worker:
        _follow(parent)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        code = _work(arguments)
        # C code may call exit() by itself: only a code that comes this way is an answer.
        os.write(writer, bytes([code]))
        # Whoever called in Python may catch SystemExit, and must not go on twice.
        atexit._run_exitfuncs()  # noqa: SLF001  nothing else ends a fork in order
        for stream in filter(None, (sys.stdout, sys.stderr)):
            with contextlib.suppress(OSError, ValueError):
                stream.flush()
        os._exit(code)
    os.close(writer)
    end, ended = math.inf, 0
    while not ended:
        info = signal.sigtimedwait(waited, min(max(end - time.monotonic(), 0.0), _LONG))
        if info is not None and info.si_signo != signal.SIGCHLD:
            end = min(end, time.monotonic() + _GRACE)
            os.kill(worker, info.si_signo)
        elif time.monotonic() >= end:
            os.kill(worker, signal.SIGKILL)
        ended, status = os.waitpid(worker, os.WNOHANG)
    if answer := os.read(reader, 1):
        return answer[0]
    clear_scratch(Path(tempfile.gettempdir()), "symid-")
    if end < math.inf:
        os.write(2, b"error: interrupted\n")
        return _INTERRUPTED
    from symid.cli.call import explain_crash

    return explain_crash(arguments, os.waitstatus_to_exitcode(status))


def _follow(parent: int) -> None:
    """Have the system end this process with its parent, whoever kills that."""
    import ctypes

    with contextlib.suppress(AttributeError):
        ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(_INTERRUPTED)
