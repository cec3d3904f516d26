"""A C compiler, if the machine has one, shared libraries made with it, and the sizes of their functions.

Arithmetic stays that of IEEE 754, operation by operation: no fast-math, and no product fused with a sum
(-ffp-contract=off), so that the same input gives the same bytes on all processors; only the C library's sine
and cosine may differ. Fusing, which `allow_fusing` allows, saves 4 to 15 % of a call's time. GCC 12
fuses even so where it vectorises straight-line code, hence -fno-tree-slp-vectorize, which costs nothing.

Supported: cc, gcc and clang, or one given by name; code for the processor at hand, on Linux; sizes from
ELF files of 32 and 64 bits, both byte orders.
Not supported: sizes from Mach-O, COFF or linked files; the stack of the mathematics library.
"""

import contextlib
import os
import re
import shutil
import signal
import struct
import subprocess
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache, lru_cache, partial
from pathlib import Path

from symid.environment import make_scratch_folder
from symid.errors import GenerationError, Notice
from symid.serialization import compute_signature

_ELF_MAGIC = b"\x7fELF"
_ELF_SYMBOL_TABLE = 2
_ELF_FUNCTION = 2
# By the fifth byte of the file, 32 or 64 bits: place and format of the offset of the sections, place of their
# count, formats of a section and of a symbol, places of size, kind and section in a symbol.
_ELF_LAYOUTS = {
    b"\1": (32, "I", 46, "IIIIIIIIII", "IIIBBH", (2, 3, 5)),
    b"\2": (40, "Q", 58, "IIQQQQIIQQ", "IBBHQQ", (5, 1, 3)),
}
STACK_FLAG = "-fstack-usage"
Processes = list["subprocess.Popen[str]"]
# Loops of plants and branches become faster code by -O3.
FLAGS = ("-std=c99", "-O3", "-ffp-contract=off", "-fno-tree-slp-vectorize", "-fPIC")
_NATIVE_FLAG = "-march=native"
_STRAIGHT_FLAGS = ("-O1", "-fexpensive-optimizations", "-fpeephole2")
"""Of GCC, for straight lines: half the time of -O3, as many instructions to 1 %, the same results."""
_EXACT_FLAG, _FUSING_FLAG = "-ffp-contract=off", "-ffp-contract=fast"
CANDIDATES = ("cc", "gcc", "clang")
_WORKERS = 2
_SMALLEST_SOURCE = "#include <math.h>\ndouble smallest(double x) { return sin(x); }\n"
# Seconds that a compiler gets: for an answer, for each kB of source besides, and at most. One that hangs is
# found by the smallest source.
_LEAST_TIME, _TIME_A_KILOBYTE, _MOST_TIME = 30.0, 1.0, 600.0
_PROCESSORS = Path("/proc/cpuinfo")
# Fields of /proc/cpuinfo on different machines: what a processor can do, and which one it is; not what
# changes, such as its clock.
_PROCESSOR_ABILITIES = frozenset({"flags", "Features", "features", "isa", "cpu"})
_PROCESSOR_NAMES = frozenset(
    {
        *("vendor_id", "cpu family", "model", "model name", "stepping", "uarch", "revision"),
        *("CPU implementer", "CPU architecture", "CPU variant", "CPU part", "CPU revision"),
    }
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectFile:
    """Sizes in bytes: of every function by its name, and of all constants."""

    functions: dict[str, int]
    constants: int


def read_object_file(content: bytes) -> ObjectFile | None:
    """Return the sizes in an object file, None for a format that is not ELF or a file that is cut off."""
    if content[:4] != _ELF_MAGIC or content[4:5] not in _ELF_LAYOUTS:
        return None
    start_place, start_format, counts, section_format, symbol_format, places = _ELF_LAYOUTS[content[4:5]]
    order = ">" if content[5:6] == b"\2" else "<"
    functions = {}

    def read_text(begin: int) -> str:
        return content[begin : content.index(b"\0", begin)].decode("utf-8", "replace")

    try:
        (start,) = struct.unpack_from(order + start_format, content, start_place)
        size, count, names = struct.unpack_from(f"{order}HHH", content, counts)
        # Name, kind, flags, address, offset, size, link.
        rows = [struct.unpack_from(order + section_format, content, start + size * k) for k in range(count)]
        base = rows[names][4]
        constants = sum(row[5] for row in rows if read_text(base + row[0]).startswith(".rodata"))
        for _, _, _, _, offset, length, link, *_ in (row for row in rows if row[1] == _ELF_SYMBOL_TABLE):
            for symbol in struct.iter_unpack(order + symbol_format, content[offset : offset + length]):
                code, info, section = (symbol[place] for place in places)
                # Functions of other files have no section here.
                if info % 16 == _ELF_FUNCTION and section != 0:
                    functions[read_text(rows[link][4] + symbol[0])] = code
    except (struct.error, IndexError, ValueError):
        return None
    return ObjectFile(functions=functions, constants=constants)


@dataclass(frozen=True, slots=True, kw_only=True)
class CodeSize:
    """Bytes of a function for one sample, of its batch function with helpers, and of the constants of both.

    `stack` and `batch_stack` are bounds: as no function recurses, the frames of all functions in the file are
    enough. None where the compiler gives no sizes of frames.
    """

    code: int
    batch_code: int
    constants: int
    stack: int | None
    batch_stack: int | None


def measure_code_sizes(folder: Path, prefix: str, names: Sequence[str]) -> dict[str, CodeSize]:
    """Return the sizes of the functions `names` of a library, where the folder's object files have them."""
    sizes = {}
    for name in names:
        symbol = f"{prefix}_{name}"
        try:
            found = read_object_file((folder / f"{symbol}.o").read_bytes())
        except OSError:
            continue
        if found is None or symbol not in found.functions:
            continue
        # Parts of a long function are called one after the other. Of a function that begins with a test, GCC
        # makes that test and "NAME.part.0".
        own = [part for part in found.functions if f"{part}.".startswith((f"{symbol}.", "part_"))]
        code = sum(found.functions[part] for part in own)
        stack = batch_stack = None
        with contextlib.suppress(OSError, ValueError, IndexError):
            # The compiler writes file:line:column:name, size and kind.
            lines = (folder / f"{symbol}.su").read_text(encoding="utf-8").splitlines()
            rows = [line.split("\t") for line in lines]
            # The size of a frame without a bound means nothing.
            if not any("dynamic" in row[2] and "bounded" not in row[2] for row in rows):
                frames = {row[0].rpartition(":")[2]: int(row[1]) for row in rows}
                inside = [frame for part, frame in frames.items() if "part_" in part and symbol not in part]
                batch_stack = sum(frames.values()) - sum(inside) + max(inside, default=0)
                stack = batch_stack - frames.get(f"{symbol}_batch", 0)
        sizes[name] = CodeSize(
            code=code,
            batch_code=sum(found.functions.values()) - code,
            constants=found.constants,
            stack=stack,
            batch_stack=batch_stack,
        )
    return sizes


@dataclass(frozen=True, slots=True, kw_only=True)
class Compiler:
    """A compiler: path, first line of its version, flags; with a `processor`, code is for that alone."""

    path: str
    version: str
    flags: tuple[str, ...] = FLAGS
    processor: str = ""


def allow_fusing(compiler: Compiler) -> Compiler:
    """Return the compiler with leave to make one instruction of a product and a sum, rounded once.

    Last digits then depend on compiler and processor; a processor without such instructions gives the same.
    """
    flags = tuple(_FUSING_FLAG if flag == _EXACT_FLAG else flag for flag in compiler.flags)
    return replace(compiler, flags=flags)


def _kill(process: "subprocess.Popen[str]") -> None:
    """End a compiler with all that it has started."""
    with contextlib.suppress(OSError):
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)


def _run_compiler(
    command: Sequence[str], size: int = 0, running: Processes | None = None, scratch: Path | None = None
) -> str:
    """Return what a compiler says; `size` is that of its sources in bytes, `running` gets its process.

    Its own files between two stages are in the folder `scratch`: who removes that removes them, too.
    """
    limit = min(_LEAST_TIME + _TIME_A_KILOBYTE * size / 1e3, _MOST_TIME)
    try:
        # A group of its own: a compiler starts others, which must end with it.
        process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            # Compilers of other languages write what is no UTF-8.
            encoding="utf-8",
            errors="replace",
            process_group=0,
            # A store of objects that machines share may not know which of them "native" meant.
            env={**os.environ, "CCACHE_DISABLE": "1", **({"TMPDIR": str(scratch)} if scratch else {})},
        )
        if running is not None:
            running.append(process)
        with process:
            try:
                stdout, stderr = process.communicate(timeout=limit)
            except BaseException:
                _kill(process)
                raise
    except (OSError, subprocess.TimeoutExpired) as error:
        text = f"cannot run the compiler: {' '.join(command)}\n{error}"
        raise GenerationError(Notice(code="codegen.compiler-failed", text=text)) from error
    if process.returncode:
        text = f"the compiler failed ({process.returncode}): {' '.join(command)}\n{stderr.strip()}"
        raise GenerationError(Notice(code="codegen.compiler-failed", text=text))
    return stdout


def read_processor() -> str:
    """Return a description that differs from that of other processors, or nothing where there is none."""
    try:
        lines = _PROCESSORS.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return ""
    pairs = (line.partition(":") for line in lines)
    traits = {(name.strip(), value.strip()) for name, _, value in pairs}
    kept = sorted((name, value) for name, value in traits if name in _PROCESSOR_ABILITIES | _PROCESSOR_NAMES)
    # A name alone does not say what a hypervisor or the system has switched off.
    return "\n".join(f"{n}: {v}" for n, v in kept) if any(n in _PROCESSOR_ABILITIES for n, _ in kept) else ""


def locate_compiler(command: str | None = None, *, native: bool = False) -> Compiler | None:
    """Return the compiler called `command`, by default the first of cc, gcc, clang that answers, or None.

    `native`: it shall make code for this machine's processor, where that is known.
    """
    for name in (command,) if command else CANDIDATES:
        path = shutil.which(name)
        if path is None:
            continue
        try:
            version = _read_version(path, Path(path).stat().st_mtime_ns)
        except GenerationError:
            continue
        return Compiler(path=path, version=version, processor=read_processor() if native else "")
    return None


@cache
def _read_version(path: str, _changed: int) -> str:
    """Return the first line of a compiler's answer to --version; `_changed` is the time of its file in ns."""
    return _run_compiler((path, "--version")).partition("\n")[0]


@cache
def _choose_flags(compiler: Compiler, *, straight: bool) -> tuple[str, ...]:
    """Return the flags for the processor at hand, and for straight lines, that are wanted and known."""
    native = (_NATIVE_FLAG,) if compiler.processor else ()
    for flags in ((*native, *_STRAIGHT_FLAGS) if straight else native, native):
        known = replace(compiler, processor="", flags=(*compiler.flags, *flags))
        if flags and not diagnose_compiler(known):
            return flags
    return ()


def diagnose_compiler(compiler: Compiler) -> str:
    """Return why the compiler cannot make a library of the smallest file, or nothing."""
    with make_scratch_folder() as scratch:
        source = scratch / "smallest.c"
        source.write_text(_SMALLEST_SOURCE, encoding="utf-8")
        try:
            compile_sources(compiler, [source], scratch / "smallest.so")
        except GenerationError as error:
            return str(error)
    return ""


_PROTOTYPE = re.compile(r"\bint \w+\([^(){};]*\);")


@lru_cache(maxsize=100)
def _keep_object(_key: str) -> list[bytes]:
    """Return the place of an object file by what it is of: models that differ in friction share most."""
    return []


def compile_sources(
    compiler: Compiler, sources: Sequence[Path], output: Path, *, straight: bool = False
) -> Path:
    """Compile C files one by one into the shared library `output`; a GenerationError says what failed.

    `straight`: they are functions of a robot, nearly without loops, from which less is to be gained.
    """
    flags = (*compiler.flags, *_choose_flags(compiler, straight=straight))
    with make_scratch_folder() as scratch:
        objects = [scratch / f"{source.stem}.o" for source in sources]
        sizes, running = [source.stat().st_size for source in sources], Processes()

        def make(source: Path, target: Path, size: int) -> None:
            run = partial(_run_compiler, size=size, running=running, scratch=scratch)
            command = (compiler.path, *flags, str(source))
            kept = list[bytes]()
            if straight:
                # All that is compiled: names of folders and prototypes of functions make no code.
                text = _PROTOTYPE.sub("", run((*command, "-E", "-P")))
                kept = _keep_object(compute_signature(compiler, flags, text))
            if kept:
                target.write_bytes(kept[0])
                return
            run((*command, "-c", "-o", str(target)))
            # Of a compiler that made nothing, the linker tells.
            kept += [target.read_bytes()] if target.is_file() else []

        with ThreadPoolExecutor(max_workers=_WORKERS) as pool:
            try:
                list(pool.map(make, sources, objects, sizes))
            except BaseException:
                # An interruption, or an error of one of them: nobody waits for the others.
                pool.shutdown(wait=False, cancel_futures=True)
                for process in running:
                    _kill(process)
                raise
        linked = scratch / output.name
        command = (compiler.path, "-shared", *map(str, objects), "-o", str(linked), "-lm")
        _run_compiler(command, sum(sizes), scratch=scratch)
        shutil.copyfile(linked, output)
    return output
