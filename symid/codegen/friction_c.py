"""Static friction laws as C99 that stands alone: one header, one source, one function a law.

Input: laws. Output: texts of both files.

    double symid_friction_stribeck(double velocity, const double p[4]);

p holds the physical parameters in the order of the law. The statements come from the law's own columns.

Supported: double and float; all laws of `symid.joint.friction_laws`.
Not supported: laws with a state (see `friction_state`).
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from symid.codegen.c_helpers import write_helper
from symid.codegen.describe import BANNER
from symid.codegen.functions import FunctionSpec, Port
from symid.codegen.instructions import Program
from symid.codegen.names import clean_text
from symid.codegen.printing import Body
from symid.codegen.printing_c import print_c
from symid.codegen.templates import write_template
from symid.codegen.value_algebra import ValueAlgebra
from symid.codegen.values import ValueTable
from symid.joint.friction_law import FrictionLaw, LawParameter

__all__ = [
    "FrictionContext",
    "FrictionFunction",
    "FrictionHeaderContext",
    "build_law_program",
    "generate_friction_laws",
]

_UNITS = {"velocity": "rad/s or m/s", "load": "N m or N", "position": "rad or m"}


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionFunction:
    """One law in C."""

    name: str
    lines: tuple[str, ...]
    declaration: str
    statements: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionHeaderContext:
    """friction.h.jinja."""

    banner: str
    file: str
    macro: str
    functions: tuple[FrictionFunction, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionContext:
    """friction.c.jinja."""

    banner: str
    file: str
    helpers: tuple[str, ...]
    functions: tuple[FrictionFunction, ...]


def build_law_program(law: FrictionLaw) -> Program:
    """Return the torque of a law as a program of its inputs, a port each, and its physical parameters p."""
    table = ValueTable()
    algebra = ValueAlgebra(table)
    inputs = {name: table.input(port, 0) for port, name in enumerate(law.inputs)}
    values = [table.input(len(law.inputs), k) for k in range(len(law.physical))]
    own = [_combine(algebra, row, values) for row in law.unmixing]
    count = len(law.linear)
    torque = algebra.zero
    for factor, column in zip(own[:count], law.columns(algebra, inputs, own[count:]), strict=True):
        torque = algebra.add(torque, algebra.mul(factor, column))
    instructions, outputs = table.collect([[torque]])
    spec = FunctionSpec(
        name=_find_name(law),
        inputs=(
            *(Port(name=name, shape=(1,), unit=_UNITS[name], meaning=name) for name in law.inputs),
            Port(name="p", shape=(len(values),), unit="mixed", meaning="parameters", shared=True),
        ),
        outputs=(Port(name="tau", shape=(1,), unit="N m", meaning="friction torque"),),
        meaning=law.formula,
    )
    return Program(spec=spec, instructions=instructions, outputs=outputs)


def _combine(algebra: ValueAlgebra, row: Sequence[int], values: Sequence[int]) -> int:
    total = algebra.zero
    for factor, value in zip(row, values, strict=True):
        if factor:
            total = algebra.add(total, algebra.scale(float(factor), value))
    return total


def _find_name(law: FrictionLaw) -> str:
    name = re.sub(r"[^a-z0-9]+", "_", law.name)
    if not law.smoothing:
        return name
    return f"{name}_smooth_{re.sub(r'[^a-z0-9]+', '_', f'{law.smoothing:g}')}"


def _write_return(body: Body) -> tuple[str, ...]:
    """Return the statements of a function of numbers that returns one, from those of arrays."""
    statements = [re.sub(r"\b(velocity|load|position)\[0\]", r"\1", line) for line in body.statements]
    return *statements[:-1], "return " + statements[-1].removeprefix("tau[0] = ")


def _describe_parameter(k: int, parameter: LawParameter) -> str:
    unit = parameter.unit
    if unit != parameter.unit_prismatic:
        unit = f"{unit} or {parameter.unit_prismatic}"
    return clean_text(f"p[{k}] {parameter.name} ({unit}): {parameter.meaning}")


def _describe(law: FrictionLaw) -> Iterator[str]:
    yield f"@brief {clean_text(law.formula)}"
    yield ""
    yield clean_text(f"Law {law.name}. Source: {law.source}.")
    yield clean_text(f"{law.smoothness} {law.passivity}")
    yield ""
    for name in law.inputs:
        yield f"@param [in] {name} {_UNITS[name]}"
    yield f"@param [in] p {len(law.physical)} parameters"
    yield from (f"  {_describe_parameter(k, parameter)}" for k, parameter in enumerate(law.physical))
    yield "@return friction torque, N m or N, positive against positive velocity"


def _write_function(law: FrictionLaw, body: Body, prefix: str, real: str) -> FrictionFunction:
    inputs = "".join(f"{real} {name}, " for name in law.inputs)
    name = f"{prefix}_friction_{_find_name(law)}"
    return FrictionFunction(
        name=name,
        lines=tuple(f" {line}".rstrip() for line in _describe(law)),
        declaration=f"{real} {name}({inputs}const {real} p[{len(law.physical)}])",
        statements=_write_return(body),
    )


def generate_friction_laws(
    laws: Sequence[FrictionLaw], *, prefix: str = "symid", precision: str = "double"
) -> tuple[tuple[str, str], ...]:
    """Return path and text of the header and of the source of friction laws.

    Args:
        laws: each under a name of its own.
        prefix: of the files, which end in _friction_laws, and of the functions.
        precision: "double" or "float".
    """
    bodies = [print_c(build_law_program(law), precision) for law in laws]
    functions = tuple(
        _write_function(law, body, prefix, precision) for law, body in zip(laws, bodies, strict=True)
    )
    helpers = sorted({name for body in bodies for name in body.helpers})
    file = f"{prefix}_friction_laws"
    header = FrictionHeaderContext(banner=BANNER, file=file, macro=file.upper(), functions=functions)
    source = FrictionContext(
        banner=BANNER,
        file=file,
        helpers=tuple(write_helper(name, precision) for name in helpers),
        functions=functions,
    )
    return (
        (f"{file}.h", write_template("c/friction.h.jinja", header)),
        (f"{file}.c", write_template("c/friction.c.jinja", source)),
    )
