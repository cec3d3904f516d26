"""How much memory a compiled function takes: code, constants, stack.

Input: a folder in which a library was compiled with `STACK_FLAG`. Output: `CodeSize` by function.

Code and constants are read from the object file of each function, stack from what the compiler wrote beside
it. No function recurses: the stack of one is at most its own frame and those of all that it may call in its
file. What the functions of the mathematics library take comes on top.

Supported: gcc and clang where object files are ELF. Not supported: others; they give no sizes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from symid.codegen.object_file import read_object_file

__all__ = ["STACK_FLAG", "CodeSize", "find_code_sizes"]

STACK_FLAG = "-fstack-usage"


@dataclass(frozen=True, slots=True, kw_only=True)
class CodeSize:
    """Bytes of a function for one sample, and of its batch with all that only that needs.

    `constants` are those of both. `stack` and `batch_stack` are bounds; None where the compiler says none.
    """

    code: int
    batch_code: int
    constants: int
    stack: int | None
    batch_stack: int | None


def _read_frames(path: Path) -> dict[str, int] | None:
    """Return bytes of stack by function; the compiler writes file:line:column:name, size and kind."""
    try:
        rows = [line.split("\t") for line in path.read_text(encoding="utf-8").splitlines()]
        # A frame without a bound has a size that is none.
        if any("dynamic" in row[2] and "bounded" not in row[2] for row in rows):
            return None
        return {row[0].rpartition(":")[2]: int(row[1]) for row in rows}
    except (OSError, ValueError, IndexError):
        return None


def _find_size(folder: Path, symbol: str) -> CodeSize | None:
    try:
        found = read_object_file((folder / f"{symbol}.o").read_bytes())
    except OSError:
        return None
    if found is None or symbol not in found.functions:
        return None
    code = found.functions[symbol]
    frames = _read_frames(folder / f"{symbol}.su")
    batch = f"{symbol}_batch"
    return CodeSize(
        code=code,
        batch_code=sum(found.functions.values()) - code,
        constants=found.constants,
        stack=None if frames is None else sum(frames.values()) - frames.get(batch, 0),
        batch_stack=None if frames is None else sum(frames.values()),
    )


def find_code_sizes(folder: Path, prefix: str, names: Sequence[str]) -> dict[str, CodeSize]:
    """Return the sizes of the functions `names`, without those of which nothing is known.

    Args:
        folder: of sources and object files.
        prefix: of the library.
        names: of functions without the prefix.
    """
    sizes = {name: _find_size(folder, f"{prefix}_{name}") for name in names}
    return {name: size for name, size in sizes.items() if size is not None}
