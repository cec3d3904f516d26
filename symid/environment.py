"""One thread for linear algebra, folders of symid, paths as people type them, files, scratch, progress.

A sum that threads share gives other digits on another number of cores, so the command line sets OpenBLAS,
MKL, BLIS, Accelerate and OpenMP to one thread. They read the environment once, when they are loaded.

Not supported: linear algebra that is loaded already; a package imported from inside a zip file.
"""

import contextlib
import errno
import mmap
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import IO

from symid.errors import Notice, OutputError, SymidError


def show_path(path: Path) -> str:
    """Return the path as people type it: relative, where it is below the working folder."""
    try:
        return str(path.resolve().relative_to(Path.cwd()))
    except (ValueError, OSError):
        return str(path)


def read_file(path: Path, most: int) -> bytes:
    """Return the bytes of a file of at most `most` bytes; devices that never end are read no further.

    Raises:
        OSError: it cannot be read, or is larger; ValueError: no file can have the name.
    """
    with path.open("rb") as stream:
        content = stream.read(most + 1)
    if len(content) > most:
        raise OSError(errno.EFBIG, f"larger than {most / 1e6:.0f} MB, the most that is read")
    return content


def is_alive(process: int) -> bool:
    """Return whether a process of this machine runs, by its number."""
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        # It is another user's.
        return True
    return True


def _mark_machine() -> str:
    import hashlib

    name = os.uname().nodename if hasattr(os, "uname") else ""
    return hashlib.sha256(name.encode()).hexdigest()[:8]


def mark_scratch(before: str) -> str:
    """Return how names of scratch files begin: `before`, this machine, this process."""
    return f"{before}{_mark_machine()}-{os.getpid()}-"


def clear_scratch(folder: Path, before: str) -> None:
    """Remove what processes of this machine and user left in `folder` when they were killed.

    Names are those of `mark_scratch`; what others, or living processes, are working with stays.
    """
    begin = f"{before}{_mark_machine()}-"
    with contextlib.suppress(OSError):
        for path in folder.iterdir():
            process = path.name.removeprefix(begin).split("-")[0]
            if not path.name.startswith(begin) or not process.isdecimal() or is_alive(int(process)):
                continue
            with contextlib.suppress(OSError):
                if hasattr(os, "getuid") and path.lstat().st_uid != os.getuid():
                    continue
                if path.is_dir() and not path.is_symlink():
                    shutil.rmtree(path, ignore_errors=True)
                else:
                    path.unlink()


@contextlib.contextmanager
def make_scratch_folder() -> Iterator[Path]:
    """Make a folder among the temporary ones, removed at the end; what is left of killed processes too.

    Raises:
        OSError: there is no place for temporary files.
    """
    before = "symid-"
    clear_scratch(Path(tempfile.gettempdir()), before)
    with tempfile.TemporaryDirectory(prefix=mark_scratch(before)) as folder:
        yield Path(folder)


def check_suffix(path: Path, what: str, known: Iterable[str]) -> str:
    """Return the suffix of an output file in lower case, one of `known`; messages call the file `what`.

    Raises:
        OutputError: it is another one.
    """
    suffix = path.suffix.lower()
    if suffix not in known:
        text = f"{what} is written as {' or '.join(known)}, got {path.suffix or 'no suffix'}"
        raise OutputError(Notice(code="output.unknown-suffix", text=text, file=str(path)))
    return suffix


def write_file(
    path: Path,
    content: str | Callable[[IO[bytes]], None],
    *,
    what: str = "",
    with_folder: bool = False,
    clear: bool = True,
) -> Path:
    """Write a file whole or not at all, in place of an older one; return its path.

    Args:
        path: of the file.
        content: its text, written in UTF-8, or what writes its bytes.
        what: the message's name of the content, such as "the log".
        with_folder: whether folders that do not exist are created.
        clear: whether what killed processes left of this file is removed, which looks at the whole folder.

    Raises:
        OutputError: the folder does not exist or must not be written.
    """
    temporary = ""
    try:
        if with_folder:
            path.parent.mkdir(parents=True, exist_ok=True)
        # A link stays a link, and a file keeps its rights.
        target = Path(os.path.realpath(path))
        exists = target.exists()
        if exists and not os.access(target, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        before = f".{target.name}."
        if clear:
            clear_scratch(target.parent, before)
        handle, temporary = tempfile.mkstemp(dir=target.parent, prefix=mark_scratch(before))
        with os.fdopen(handle, "wb") as stream:
            if callable(content):
                content(stream)
            else:
                stream.write(content.encode())
        # Temporary files are private; the result is as readable as any other file. The rights that this
        # process withholds can only be read by setting them.
        mask = os.umask(0o077)
        os.umask(mask)
        Path(temporary).chmod(target.stat().st_mode & 0o777 if exists else 0o666 & ~mask)
        Path(temporary).replace(target)
    except (OSError, ValueError) as error:
        # A name that no file can have, with a null byte or no Unicode, is a ValueError.
        if temporary and isinstance(error, ValueError):
            raise
        text = f"cannot be written: {getattr(error, 'strerror', None) or error}"
        text = f"{what} {text}" if what else f"{text}; name a file in a folder that exists and is yours"
        code = "output.unwritable" if what else "output.write"
        raise OutputError(Notice(code=code, text=text, file=str(path))) from error
    finally:
        if temporary:
            Path(temporary).unlink(missing_ok=True)
    return path


_PACKAGE = Path(__file__).resolve().parent


def locate_resource_folder(name: str) -> Path:
    """Return the folder `name`, "robots" or "templates", that belongs to this installation.

    Raises:
        SymidError: the installation is incomplete; the message names the places searched.
    """
    # The wheel's copy first: beside an installed package stand other people's folders.
    places = (_PACKAGE / "_data" / name, _PACKAGE.parent / name)
    for place in places:
        if place.is_dir():
            return place
    searched = " and ".join(map(str, places))
    text = f"the folder {name!r} of symid is missing, searched {searched}; install symid again"
    raise SymidError(Notice(code="symid.missing-resource", text=text))


THREAD_VARIABLES = (
    *("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"),
    *("BLIS_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"),
)
KEEP_MEMORY = {"MALLOC_MMAP_THRESHOLD_": str(32 << 20), "MALLOC_TRIM_THRESHOLD_": str(256 << 20)}
"""For processes that fit log after log: bytes from which the C library maps an array alone, and that it keeps
when they are free (glibc; others ignore it). Dask's workers have 64 kB: pages that are given back after each
array and asked for again are half of the time of a fit."""


def limit_to_one_thread() -> None:
    """Set the variables for this process and those that it starts."""
    os.environ |= dict.fromkeys(THREAD_VARIABLES, "1")


_ALGEBRA_MEMORY = 80
"""MB of address space: OpenBLAS takes 33 for each of its two copies at its first work."""
_MOST_ARENAS = -8
"""M_ARENA_MAX of the C library."""


def find_memory_limit() -> int | None:
    """Return the limit of this process's address space in MB (`ulimit -v`), None where there is none."""
    try:
        import resource
    except ImportError:
        return None
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    return None if limit == resource.RLIM_INFINITY else limit >> 20


def require_memory(megabytes: int) -> None:
    """Raise MemoryError if so much is not left, before C code that hangs without it."""
    try:
        mmap.mmap(-1, megabytes << 20, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS).close()
    except OSError as error:
        text = f"{megabytes} MB more are needed"
        raise MemoryError(text) from error


def secure_linear_algebra() -> None:
    """Have linear algebra take its memory now, in a process of limited memory.

    Where OpenBLAS finds none later it ends the process, or tries for ever. A thread otherwise reserves
    64 MB of address space for what it allocates.

    Raises:
        MemoryError, ImportError: there is too little of it.
    """
    import ctypes

    with contextlib.suppress(AttributeError):
        ctypes.CDLL(None).mallopt(_MOST_ARENAS, 1)
    import numpy as np

    # SciPy's copy of OpenBLAS takes some when it is loaded, and tries for ever too.
    require_memory(_ALGEBRA_MEMORY)
    from scipy import linalg

    require_memory(_ALGEBRA_MEMORY)
    # Products of small matrices need no buffers.
    unit = np.eye(256)
    _ = unit @ unit, linalg.blas.dgemm(1.0, unit, unit)


_WORTH_SAYING = 2.0
"""Seconds left from which on they are said."""


def report_count(progress: Callable[[str], None], what: str = "") -> Callable[[int, int], None]:
    """Return a callback for (done, count) that reports both, and how long the rest will take.

    `progress` is called with a text such as "3 of 40, 25 s left"; `what` is counted, a word before it.
    """
    start = time.monotonic()

    def report(done: int, count: int) -> None:
        left = (time.monotonic() - start) * (count - done) / done if done else 0.0
        rest = f", {describe_duration(left)} left" if left >= _WORTH_SAYING else ""
        progress(f"{what} {done} of {count}{rest}".strip())

    return report


def describe_duration(seconds: float) -> str:
    """Return seconds as "40 s", "12 min" or "3.5 h"."""
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"
