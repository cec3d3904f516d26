"""What an object file holds: its functions and their sizes, and the size of its constants.

Input: the bytes of an object file. Output: `ObjectFile`, None where the format is not known.

Supported: ELF of 32 and 64 bits, both orders of bytes, which is what compilers for Linux and for
microcontrollers write. Not supported: Mach-O and COFF; files that were linked.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum

__all__ = ["ObjectFile", "read_object_file"]

_MAGIC = b"\x7fELF"
_SYMBOL_TABLE = 2
_FUNCTION = 2


class _Class(IntEnum):
    """The fifth byte of an ELF file."""

    BITS_32 = 1
    BITS_64 = 2


# Where the header has offset, size, count and name table of the sections; how a section and a symbol read.
_HEADER = {_Class.BITS_32: (32, "I", 46), _Class.BITS_64: (40, "Q", 58)}
_SECTION = {_Class.BITS_32: "IIIIIIIIII", _Class.BITS_64: "IIQQQQIIQQ"}
_SYMBOL = {_Class.BITS_32: "IIIBBH", _Class.BITS_64: "IBBHQQ"}


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectFile:
    """Sizes in bytes: of every function by its name, and of all constants."""

    functions: dict[str, int]
    constants: int


@dataclass(frozen=True, slots=True, kw_only=True)
class _Section:
    name: str
    kind: int
    offset: int
    size: int
    link: int


def _read_text(content: bytes, start: int) -> str:
    return content[start : content.index(b"\0", start)].decode("utf-8", "replace")


def _read_sections(content: bytes, order: str, bits: _Class) -> list[_Section]:
    where, letter, counts = _HEADER[bits]
    (start,) = struct.unpack_from(order + letter, content, where)
    size, count, names = struct.unpack_from(f"{order}HHH", content, counts)
    rows = [struct.unpack_from(order + _SECTION[bits], content, start + size * k) for k in range(count)]
    base = rows[names][4]
    return [
        _Section(
            name=_read_text(content, base + row[0]), kind=row[1], offset=row[4], size=row[5], link=row[6]
        )
        for row in rows
    ]


def _read_functions(
    content: bytes, order: str, bits: _Class, sections: list[_Section]
) -> Iterator[tuple[str, int]]:
    layout = order + _SYMBOL[bits]
    # The places of size, kind and section in a row; the name comes first in both.
    places = (2, 3, 5) if bits is _Class.BITS_32 else (5, 1, 3)
    for table in sections:
        if table.kind != _SYMBOL_TABLE:
            continue
        names = sections[table.link].offset
        for row in struct.iter_unpack(layout, content[table.offset : table.offset + table.size]):
            size, info, section = (row[place] for place in places)
            # Functions of other files have no section here.
            if info % 16 == _FUNCTION and section != 0:
                yield _read_text(content, names + row[0]), size


def read_object_file(content: bytes) -> ObjectFile | None:
    """Return the sizes in an object file, None for a format that is not ELF or a file that is cut off."""
    if content[:4] != _MAGIC or content[4:5] not in {b"\1", b"\2"}:
        return None
    bits, order = _Class(content[4]), ">" if content[5:6] == b"\2" else "<"
    try:
        sections = _read_sections(content, order, bits)
        functions = dict(_read_functions(content, order, bits, sections))
    except (struct.error, IndexError, ValueError):
        return None
    constants = sum(section.size for section in sections if section.name.startswith(".rodata"))
    return ObjectFile(functions=functions, constants=constants)
