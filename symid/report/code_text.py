"""A folder of generated code, in text for people and as an object for programs.

Input: a `GeneratedFolder`. Output: blocks, dictionaries.
"""

from dataclasses import asdict
from typing import TYPE_CHECKING

from symid.report.blocks import Block, format_table

if TYPE_CHECKING:  # a page of figures does without
    from symid.codegen.generation import GeneratedFolder

__all__ = ["describe_code", "show_code", "summarise_code"]

_COUNTS = ("mul", "add", "trig")
_SIZES = ("code", "stack")


def summarise_code(made: "GeneratedFolder") -> str:
    """Return the folder, what was done, and how its self-test went."""
    state = "nothing has changed" if made.unchanged else f"{len(made.files)} files"
    head = f"{made.folder}: {state}, self-test {made.record.selftest}"
    if made.record.runner:
        head += f" with {made.record.runner} {made.record.flags}".rstrip()
    return head


def show_code(made: "GeneratedFolder") -> tuple[Block, ...]:
    """Return a headline, and the operations and sizes of every function."""
    sizes = {name: asdict(size) for name, size in made.record.sizes.items()}
    header = ("function", *_COUNTS, *(_SIZES if sizes else ()))
    rows = [
        (
            name,
            *(counts[key] for key in _COUNTS),
            *(sizes[name][key] for key in _SIZES if name in sizes),
        )
        for name, counts in made.operations.items()
    ]
    units = ("code and stack in bytes; batches in manifest.json",) if sizes else ()
    return (summarise_code(made), format_table(header, rows), *units)


def describe_code(robot: str, made: "GeneratedFolder") -> dict[str, object]:
    """Return what was written as `symid generate --json` gives it."""
    record = made.record
    return {
        "robot": robot,
        "target": made.manifest["target"],
        "folder": str(made.folder),
        "files": [str(path) for path in made.files],
        "operations": made.operations,
        "selftest": record.selftest,
        "runner": record.runner,
        "flags": record.flags,
        "sizes": {name: asdict(size) for name, size in record.sizes.items()},
        "unchanged": made.unchanged,
    }
