"""The self-test of a C library.

Input: `Material`. Output: the context of its template.
"""

from collections.abc import Sequence

from symid.codegen.c_contexts import SelfTest, SelfTestArray, SelfTestContext
from symid.codegen.c_state import write_state_test
from symid.codegen.c_tables import write_lines
from symid.codegen.describe import BANNER, Material
from symid.codegen.functions import Port
from symid.codegen.instructions import Program
from symid.codegen.reference import FLOOR, NEGLIGIBLE, Reference

__all__ = ["build_self_test"]


def _write_array(name: str, port: Port, rows: Sequence[Sequence[float]], real: str) -> SelfTestArray:
    size = f"{max(port.size, 1)}" if port.shared else f"STATES * {port.size}"
    values = [value for row in rows for value in row]
    return SelfTestArray(name=name, size=size, lines=write_lines(values, real))


def _compare(ports: Sequence[Port], mark: str) -> tuple[str, ...]:
    def compare(port: Port) -> str:
        error = f"find_error({mark}{port.name}, expected_{port.name}, STATES * {port.size})"
        return f"worst = find_larger(worst, {error});"

    return tuple(map(compare, ports))


def _build_test(program: Program, reference: Reference, real: str) -> SelfTest:
    spec = program.spec
    ports = (*spec.inputs, *spec.outputs)
    tables = [
        *((port.name, port, rows) for port, rows in zip(spec.inputs, reference.inputs, strict=True)),
        *((f"expected_{p.name}", p, rows) for p, rows in zip(spec.outputs, reference.outputs, strict=True)),
    ]
    outputs = [f"{mark}{p.name}[STATES * {p.size}]" for p in spec.outputs for mark in ("", "batch_")]
    return SelfTest(
        name=spec.name,
        arrays=tuple(_write_array(name, port, rows, real) for name, port, rows in tables),
        outputs=tuple(outputs),
        call=", ".join(port.name if port.shared else f"{port.name} + {port.size} * k" for port in ports),
        batch_call=", ".join(
            ["STATES", *(p.name for p in spec.inputs), *(f"batch_{p.name}" for p in spec.outputs)]
        ),
        null_call=", ".join(["NULL", *(port.name for port in ports[1:])]),
        compare=_compare(spec.outputs, ""),
        batch_compare=_compare(spec.outputs, "batch_"),
    )


def build_self_test(material: Material, tolerance: str) -> SelfTestContext:
    """Return the self-test of all functions."""
    real = material.options.precision
    pairs = zip(material.programs, material.references, strict=True)
    state_lines = write_state_test(material)
    return SelfTestContext(
        banner=BANNER,
        prefix=material.prefix,
        real=real,
        tolerance=tolerance,
        negligible=repr(NEGLIGIBLE),
        floor=repr(FLOOR),
        state_count=material.options.states,
        test_count=len(material.programs) + bool(state_lines),
        tests=tuple(_build_test(program, reference, real) for program, reference in pairs),
        state_lines=state_lines,
        state_tests=("hysteresis",) if state_lines else (),
    )
