"""The entry of the command `symid`, light enough that Ctrl-C is answered from the first moment.

Arguments -> exit code; `symid.cli.call` has the codes and their meaning.
"""

import os
import signal
import sys
from collections.abc import Sequence
from typing import NoReturn

from symid.environment import limit_to_one_thread

_INTERRUPTED = 130


def main() -> NoReturn:
    """Run the command line and exit; linear algebra gets one thread, so that cores do not change results."""
    limit_to_one_thread()
    # Whoever ends this process gets what Ctrl-C gets: scratch files removed, workers ended, one line.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        code = run(sys.argv[1:])
    except KeyboardInterrupt:
        # It came while modules were loaded, or while the answer was printed.
        os.write(2, b"error: interrupted\n")
        code = _INTERRUPTED
    sys.exit(code)


def run(arguments: Sequence[str]) -> int:
    """Run the command line with `arguments`, print what it has to say, and return the exit code."""
    # click takes a while to load; an interruption then must not end in a traceback.
    from symid.cli.call import answer_call as answer

    return answer(arguments)
