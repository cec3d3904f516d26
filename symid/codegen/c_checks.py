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
from symid.codegen.printing import find_literal
from symid.codegen.reference import FLOOR, NEGLIGIBLE, WEIGHTS, WHOLE, Reference, Rows
from symid.codegen.sample_states import PER_UNIT

__all__ = ["TOLERANCES", "build_self_test"]

TOLERANCES = {"double": "1e-12", "float": "2e-5"}
"""Sound code errs by a few units of the last place, 1e-16 or 6e-8, times the condition of what it solves, up
to 100 here; a wrong sign or place, or a wrong digit in a constant, errs by much more."""

# No multiple of the samples that vectors hold: each batch has some left over.
_SAMPLES = 13
_FENCE = 8
_UNTOUCHED = 12345.5
_PER_LINE = 16


def _flatten(rows: Rows) -> list[float]:
    return [value for row in rows for value in row]


def _write_thousandths(rows: Rows) -> tuple[str, ...]:
    whole = [str(round(value * PER_UNIT)) for value in _flatten(rows)] or ["0"]
    starts = range(0, len(whole), _PER_LINE)
    return tuple(", ".join(whole[k : k + _PER_LINE]) + "," for k in starts)


def _name_array(port: Port, table: str) -> str:
    return f"{'shared' if port.shared else 'state'}_{table}"


def _write_input(port: Port, name: str, rows: Rows, real: str) -> SelfTestArray:
    size = max(len(_flatten(rows)), 1)
    if port.shared:
        return SelfTestArray(kind=real, name=name, size=size, lines=write_lines(_flatten(rows), real))
    return SelfTestArray(kind="int32_t", name=name, size=size, lines=_write_thousandths(rows))


def _write_output(name: str, rows: Rows) -> SelfTestArray:
    values = _flatten(rows)
    return SelfTestArray(
        kind="double", name=name, size=max(len(values), 1), lines=write_lines(values, "double")
    )


def _write_arrays(material: Material) -> tuple[SelfTestArray, ...]:
    real = material.options.precision
    arrays: dict[str, SelfTestArray] = {}
    for program, reference in zip(material.programs, material.references, strict=True):
        spec = program.spec
        for port, table, rows in zip(spec.inputs, reference.tables, reference.inputs, strict=True):
            name = _name_array(port, table)
            if name not in arrays:
                arrays[name] = _write_input(port, name, rows, real)
        for port, whole, sums in zip(spec.outputs, reference.whole, reference.sums, strict=True):
            for kind, rows in (("whole", whole), ("sums", sums)):
                name = f"{kind}_{spec.name}_{port.name}"
                arrays[name] = _write_output(name, rows)
    return tuple(arrays.values())


def _describe_input(port: Port, table: str) -> str:
    name = _name_array(port, table)
    places = f"NULL, {name}" if port.shared else f"{name}, NULL"
    return f"{{ {places}, {port.size} }}"


def _build_test(program: Program, reference: Reference) -> SelfTest:
    spec = program.spec
    given = [f"in[{k}]" for k in range(len(spec.inputs))] + [f"out[{k}]" for k in range(len(spec.outputs))]
    outputs = (
        f"{{ whole_{spec.name}_{port.name}, sums_{spec.name}_{port.name}, {scale!r}, {port.size} }}"
        for port, scale in zip(spec.outputs, reference.scales, strict=True)
    )
    return SelfTest(
        name=spec.name,
        call=", ".join(given),
        inputs=tuple(map(_describe_input, spec.inputs, reference.tables)),
        outputs=tuple(outputs),
        input_count=len(spec.inputs),
        output_count=len(spec.outputs),
    )


def _find_room(programs: Sequence[Program]) -> tuple[int, int, int]:
    """Return the most ports of one kind, and the elements that inputs and outputs of a batch take."""
    specs = [program.spec for program in programs]
    ports = max(max(len(spec.inputs), len(spec.outputs)) for spec in specs)
    inputs = max(sum(port.size for port in spec.inputs if not port.shared) for spec in specs)
    outputs = max(sum(port.size * _SAMPLES + _FENCE for port in spec.outputs) for spec in specs)
    return ports, max(inputs * _SAMPLES, 1), outputs


def build_self_test(material: Material, tolerance: str) -> SelfTestContext:
    """Return the self-test of all functions."""
    real, states = material.options.precision, material.options.states
    pairs = zip(material.programs, material.references, strict=True)
    state_lines = write_state_test(material)
    ports, inputs, outputs = _find_room(material.programs)
    return SelfTestContext(
        banner=BANNER,
        prefix=material.prefix,
        real=real,
        tolerance=tolerance,
        negligible=repr(NEGLIGIBLE),
        floor=repr(FLOOR),
        per_unit=repr(float(PER_UNIT)),
        untouched=find_literal(_UNTOUCHED, real),
        state_count=states,
        whole=min(WHOLE, states),
        samples=_SAMPLES,
        fence=_FENCE,
        sum_count=len(WEIGHTS),
        moduli=", ".join(str(modulus) for modulus, _ in WEIGHTS),
        steps=", ".join(str(step) for _, step in WEIGHTS),
        weights=" and ".join(f"m = {modulus}, s = {step}" for modulus, step in WEIGHTS),
        port_room=ports,
        input_room=inputs,
        output_room=outputs,
        test_count=len(material.programs) + bool(state_lines),
        arrays=_write_arrays(material),
        tests=tuple(_build_test(program, reference) for program, reference in pairs),
        state_lines=state_lines,
        state_tests=("hysteresis",) if state_lines else (),
    )
