"""Values of a robot's parameters as a C header, for the generated library of the same robot.

Input: `RobotValues`, whose texts are fit for C comments. Output: the text of the header.

For each vector an array, such as `symid_arm_beta`, and for each entry its place in it, such as
`SYMID_ARM_BETA_ZZR1`. Where the library's header is included before, the compiler checks that both have as
many parameters; `SYMID_ARM_VALUES_SIGNATURE` is that of the model, as the library's own function says it.

Supported: double and single precision, C99 and C++. A value that nobody knows is 0, and its comment says so.
"""

import re
from collections.abc import Iterator, Sequence

from symid.formats.value_vectors import RobotValues, ValueRow, ValueVector

__all__ = ["PRECISIONS", "write_c_values"]

PRECISIONS = ("double", "float")
"""Types of numbers that the generated library may have."""

# What the library calls the lengths of vectors.
_LENGTHS = {"beta": "BETA", "f": "FRICTION"}
_SAME = 1e-12


def write_c_values(values: RobotValues, *, comments: Sequence[str] = (), precision: str = "double") -> str:
    """Return the header.

    Args:
        values: the robot's.
        comments: texts for the head of the file, fit for C comments.
        precision: one of `PRECISIONS`.
    """
    prefix, macro = values.prefix, values.prefix.upper()
    vectors = [vector for vector in values.vectors if vector.rows]
    lines = [
        "/**",
        f" * @file {prefix}_values.h",
        f" * @brief Parameters of {values.robot}, SI units, for the library {prefix}.",
        *(f" * {text}" for text in ("", *comments)),
        " */",
        f"#ifndef {macro}_VALUES_H",
        f"#define {macro}_VALUES_H",
        "",
        f"/** The model that these numbers belong to: {prefix}_signature() must be the same. */",
        f'#define {macro}_VALUES_SIGNATURE "{values.signature}"',
        *_write_check(prefix, vectors),
    ]
    for vector in vectors:
        lines += ["", *_write_vector(prefix, vector, precision)]
    return "\n".join((*[line.rstrip() for line in lines], "", "#endif", ""))


def _write_check(prefix: str, vectors: Sequence[ValueVector]) -> Iterator[str]:
    macro = prefix.upper()
    sizes = {name: len(vector.rows) for vector in vectors for name in [_LENGTHS.get(vector.name)] if name}
    if not sizes:
        return
    terms = " && ".join(f"{macro}_{name} == {size}" for name, size in sizes.items())
    yield from (
        "",
        f"#ifdef {macro}_H",
        "/* This does not compile where the library has other parameters. */",
    )
    yield f"typedef char {prefix}_values_fit[({terms}) ? 1 : -1];"
    yield "#endif"


def _write_vector(prefix: str, vector: ValueVector, precision: str) -> Iterator[str]:
    places = _name_places(vector.rows)
    base = f"{prefix.upper()}_{_fit(vector.name).upper()}"
    yield from (f"#define {base}_{place} {index}" for index, place in enumerate(places))
    yield from ("", f"/** {vector.title}. */")
    yield f"static const {precision} {prefix}_{_fit(vector.name)}[{len(vector.rows)}] = {{"
    texts = [_write_number(row.value, precision) for row in vector.rows]
    width = max(map(len, texts)) + 1
    for index, (row, text) in enumerate(zip(vector.rows, texts, strict=True)):
        yield f"    {text + ',':<{width}} /* [{index}] {_describe(row)} */"
    yield "};"


def _fit(name: str) -> str:
    return re.sub(r"\W", "_", name, flags=re.ASCII)


def _name_places(rows: Sequence[ValueRow]) -> list[str]:
    """Return a part of an identifier for each row, with its place where names would be the same."""
    names = [_fit(row.name) for row in rows]
    return [name if names.count(name) == 1 else f"{name}_{index}" for index, name in enumerate(names)]


def _write_number(value: float | None, precision: str) -> str:
    return repr(float(value or 0.0) + 0.0) + ("F" if precision == "float" else "")


def _describe(row: ValueRow) -> str:
    text = row.name if row.expression in ("", row.name) else f"{row.name} = {row.expression}"
    text += f", {row.unit}"
    if row.value is None:
        return f"{text}; unknown, so that it is left at 0"
    if row.identified is not None and abs(row.identified - row.value) > _SAME * abs(row.value):
        text += f"; identified as {row.identified:.9g}"
    if row.std is not None:
        percent = f" ({100 * row.std / abs(row.value):.2g} %)" if row.value else ""
        text += f"; std {row.std:.3g}{percent}"
    return text
