"""Values of a robot's parameters, vector by vector, as JSON and as a C header for its generated library.

JSON is an object of plain types, SI units, format 1, links in the frames of the URDF that symid writes:

    format, version, robot, signature
    vectors: {"beta": [{name, value, unit, expression, identified, std}], "f": ..., "IA": ..., "h": ...}
    gravity: [x, y, z]
    links: [{joint, kind, parent, mass, com, inertia {xx xy xz yy yz zz about com}, standard {XX ... M}}]
    drives: [{name, gear, rotor_inertia, friction {model, values {}, shape {}, smoothing}}], couplings last

The header has an array for each vector, such as `symid_arm_beta`, for each entry its place in it, such as
`SYMID_ARM_BETA_ZZR1`, and the model's signature. An unknown value is null in JSON, and 0 with a comment in C.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass

from symid.joint_models import get_friction_law, list_value_names, name_bristles, name_shape, name_values
from symid.notation import INERTIAL
from symid.robot.description import Coupling, Joint, Robot
from symid.robot.inertia import split_body


@dataclass(frozen=True, slots=True, kw_only=True)
class ValueRow:
    """A parameter: its value in SI units, what it groups, its identified value and standard deviation."""

    name: str
    value: float | None
    unit: str
    expression: str = ""
    identified: float | None = None
    std: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ValueVector:
    """One argument of generated functions: its name there, its meaning, its entries in order."""

    name: str
    title: str
    rows: tuple[ValueRow, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotValues:
    """All vectors of a robot, `signature` that of its model, `prefix` how names of its C library begin."""

    robot: str
    prefix: str
    signature: str
    vectors: tuple[ValueVector, ...]


_TENSOR = ("xx", "xy", "xz", "yy", "yz", "zz")


def build_json_values(
    robot: Robot, values: RobotValues, *, outcome: str, sources: Sequence[str] = ()
) -> dict[str, object]:
    """Return the object of a robot with values of links and drives, which `values` has as vectors.

    `outcome` says in one word how they were estimated, `sources` are the logs they come from.
    """
    symbols = dict(robot.symbols)
    drives = [_describe_drive(joint, {"gear": joint.drive.gear}) for joint in robot.joints]
    for coupling in robot.couplings:
        terms = {robot.joints[index].name: float(factor) for index, factor in coupling.terms}
        drives.append(_describe_drive(coupling, {"turns_with": terms}))
    return {
        "format": "symid values",
        "version": 1,
        "robot": robot.name,
        "signature": values.signature,
        "outcome": outcome,
        "sources": list(sources),
        "gravity": [value.to_float(symbols) for value in robot.gravity],
        "vectors": {
            vector.name: [asdict(row) for row in vector.rows] for vector in values.vectors if vector.rows
        },
        "links": [_describe_link(robot, joint) for joint in robot.joints],
        "drives": drives,
    }


def _describe_link(robot: Robot, joint: Joint) -> dict[str, object]:
    found: dict[str, object] = {
        "joint": joint.name,
        "kind": joint.kind.value,
        "parent": robot.joints[joint.parent].name if joint.parent >= 0 else None,
    }
    if joint.inertial is None:
        return found | dict.fromkeys(("mass", "com", "inertia", "standard"))
    mass, com, central = split_body(joint.inertial)
    inertia = dict(zip(_TENSOR, central, strict=True))
    standard = dict(zip(INERTIAL, joint.inertial, strict=True))
    return found | {"mass": mass, "com": com, "inertia": inertia, "standard": standard}


def _describe_drive(owner: Joint | Coupling, moves: dict[str, object]) -> dict[str, object]:
    friction = owner.friction
    law = get_friction_law(friction)
    bristles = name_bristles(law, friction.bristles) if law is not None and law.memory else {}
    return {
        "name": owner.name,
        **moves,
        "rotor_inertia": (owner.drive if isinstance(owner, Joint) else owner).rotor_inertia,
        "friction": {
            "model": friction.law,
            "values": dict.fromkeys(list_value_names(friction)) | name_values(friction),
            "shape": name_shape(friction),
            "smoothing": friction.smoothing,
            **({"bristles": {name: list(values) for name, values in bristles.items()}} if bristles else {}),
        },
    }


PRECISIONS = ("double", "float")
"""Types of numbers that the generated library may have."""


def write_c_values(values: RobotValues, *, comments: Sequence[str] = (), precision: str = "double") -> str:
    """Return the header, with `comments` fit for C at its head; `precision` is one of `PRECISIONS`."""
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
    ]
    # Where the library's header was included before, the number of parameters is checked.
    names = {"beta": "BETA", "f": "FRICTION"}
    counts = [(names[vector.name], len(vector.rows)) for vector in vectors if vector.name in names]
    if counts:
        terms = " && ".join(f"{macro}_{name} == {count}" for name, count in counts)
        lines += ["", f"#ifdef {macro}_H"]
        lines.append("/* This does not compile where the library has other parameters. */")
        lines += [f"typedef char {prefix}_values_fit[({terms}) ? 1 : -1];", "#endif"]
    for vector in vectors:
        lines += ["", *_write_vector(prefix, vector, precision)]
    return "\n".join((*[line.rstrip() for line in lines], "", "#endif", ""))


def _write_vector(prefix: str, vector: ValueVector, precision: str) -> Iterator[str]:
    vector_name = _to_identifier(vector.name)
    names = [_to_identifier(row.name) for row in vector.rows]
    for index, name in enumerate(names):
        place = name if names.count(name) == 1 else f"{name}_{index}"
        yield f"#define {prefix.upper()}_{vector_name.upper()}_{place} {index}"
    yield from ("", f"/** {vector.title}. */")
    yield f"static const {precision} {prefix}_{vector_name}[{len(vector.rows)}] = {{"
    end = "F" if precision == "float" else ""
    texts = [f"{float(row.value or 0.0) + 0.0!r}{end}," for row in vector.rows]
    width = max(map(len, texts))
    for index, (row, text) in enumerate(zip(vector.rows, texts, strict=True)):
        yield f"    {text:<{width}} /* [{index}] {_describe(row)} */"
    yield "};"


def _to_identifier(name: str) -> str:
    return re.sub(r"\W", "_", name, flags=re.ASCII)


def _describe(row: ValueRow) -> str:
    text = row.name if row.expression in ("", row.name) else f"{row.name} = {row.expression}"
    text += f", {row.unit}"
    if row.value is None:
        return f"{text}; unknown, left at 0"
    if row.identified is not None and abs(row.identified - row.value) > 1e-12 * abs(row.value):
        text += f"; identified as {row.identified:.9g}"
    if row.std is not None:
        percent = f" ({100 * row.std / abs(row.value):.2g} %)" if row.value else ""
        text += f"; std {row.std:.3g}{percent}"
    return text
