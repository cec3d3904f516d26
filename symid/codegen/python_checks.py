"""The self-test of a NumPy module.

Input: programs and their reference values. Output: the tables of the module's template, as Python text.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from symid.codegen.functions import Port
from symid.codegen.instructions import Program
from symid.codegen.reference import Reference, Rows
from symid.codegen.sample_states import PER_UNIT

__all__ = ["ModuleState", "ModuleTest", "build_module_states", "build_module_tests"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ModuleState:
    """An input at all states, or one that they share; functions use it by its name and size."""

    name: str
    shared: bool
    lines: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ModuleTest:
    """Inputs of one function by name, and its reference outputs."""

    name: str
    inputs: str
    outputs: tuple[str, ...]


def _write_rows(rows: Rows) -> tuple[str, ...]:
    return ("[", *(f"    {list(row)!r}," for row in rows), "]")


def _write_state(port: Port, table: str, rows: Rows) -> ModuleState:
    if port.shared:
        return ModuleState(name=table, shared=True, lines=(repr(list(rows[0])),))
    thousandths = [[round(value * PER_UNIT) for value in row] for row in rows]
    return ModuleState(name=table, shared=False, lines=_write_rows(thousandths))


def build_module_states(
    programs: Sequence[Program], references: Sequence[Reference]
) -> tuple[ModuleState, ...]:
    """Return every input that a function is given, once."""
    found: dict[str, ModuleState] = {}
    for program, reference in zip(programs, references, strict=True):
        inputs = zip(program.spec.inputs, reference.tables, reference.inputs, strict=True)
        for port, table, rows in inputs:
            if table not in found:
                found[table] = _write_state(port, table, rows)
    return tuple(found.values())


def _build_test(program: Program, reference: Reference) -> ModuleTest:
    def write(rows: Rows) -> str:
        return f"np.array({[list(row) for row in rows]!r})"

    tables = zip(reference.whole, reference.sums, reference.scales, strict=True)
    return ModuleTest(
        name=program.spec.name,
        inputs=repr(reference.tables),
        outputs=tuple(f"({write(whole)}, {write(sums)}, {scale!r})" for whole, sums, scale in tables),
    )


def build_module_tests(
    programs: Sequence[Program], references: Sequence[Reference]
) -> tuple[ModuleTest, ...]:
    """Return the tables of every function."""
    pairs = zip(programs, references, strict=True)
    return tuple(_build_test(program, reference) for program, reference in pairs)
