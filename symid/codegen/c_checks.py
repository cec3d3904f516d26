"""The programs that come with a C library: its self-test and an example control loop.

Input: `Material`. Output: contexts of their templates.
"""

from collections.abc import Sequence

from symid.codegen.c_contexts import ControlLoopContext, SelfTest, SelfTestArray, SelfTestContext
from symid.codegen.describe import BANNER, Material
from symid.codegen.functions import Port
from symid.codegen.instructions import Program
from symid.codegen.printing import find_literal
from symid.codegen.reference import FLOOR, NEGLIGIBLE, Reference

__all__ = ["build_control_loop", "build_self_test"]

_PER_LINE = 5


def _write_lines(values: Sequence[float], real: str) -> tuple[str, ...]:
    # An empty initialiser is no C.
    literals = [find_literal(value, real) for value in values] or [find_literal(0.0, real)]
    starts = range(0, len(literals), _PER_LINE)
    return tuple(", ".join(literals[k : k + _PER_LINE]) + "," for k in starts)


def _write_array(name: str, port: Port, rows: Sequence[Sequence[float]], real: str) -> SelfTestArray:
    size = f"{max(port.size, 1)}" if port.shared else f"STATES * {port.size}"
    values = [value for row in rows for value in row]
    return SelfTestArray(name=name, size=size, lines=_write_lines(values, real))


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
    return SelfTestContext(
        banner=BANNER,
        prefix=material.prefix,
        real=real,
        tolerance=tolerance,
        negligible=repr(NEGLIGIBLE),
        floor=repr(FLOOR),
        state_count=material.options.states,
        test_count=len(material.programs),
        tests=tuple(_build_test(program, reference, real) for program, reference in pairs),
    )


def _write_friction(material: Material) -> tuple[tuple[str, ...], tuple[str, ...]]:
    if not material.card.friction:
        return (), ()
    call = f"{material.prefix}_friction({{}}, parameters + {len(material.card.beta)}, friction)"
    start = f"{material.options.precision} friction[JOINTS];"

    def apply(velocity: str, target: str) -> tuple[str, ...]:
        test = f"if ({call.format(velocity)} != 0) {{"
        loop = "for (size_t j = 0; j < JOINTS; ++j) {"
        return (start, test, "    return 1;", "}", loop, f"    {target};", "}")

    return apply("dqd", "tau[j] += friction[j]"), apply("dq", "rigid[j] -= friction[j]")


def build_control_loop(material: Material) -> ControlLoopContext | None:
    """Return the example, or None if the library lacks a function that it calls."""
    card, real = material.card, material.options.precision
    wanted = {"inverse_dynamics", "forward_dynamics", *(["friction"] if card.friction else [])}
    if not wanted <= {spec.name for spec in card.functions}:
        return None
    values = [parameter.value for parameter in (*card.beta, *card.friction)]
    known = all(value is not None for value in values)
    suffix = "f" if real == "float" else ""
    arrays = ("q", "dq", "qd", "dqd", "ddqd")
    feed_forward, plant_friction = _write_friction(material)
    return ControlLoopContext(
        banner=BANNER,
        prefix=material.prefix,
        real=real,
        scan="%f" if real == "float" else "%lf",
        joint_count=card.size,
        parameter_count=max(len(values), 1),
        known=int(known),
        parameter_lines=_write_lines([value or 0.0 for value in values] if known else [0.0], real),
        kp=f"400.0{suffix}",
        kd=f"40.0{suffix}",
        period=f"0.001{suffix}",
        amplitude=f"0.2{suffix}",
        frequency=f"3.0{suffix}",
        zero=f"{{0.0{suffix}}}",
        one=f"1.0{suffix}",
        sine=f"sin{suffix}",
        cosine=f"cos{suffix}",
        control_declaration=", ".join(
            [*(f"const {real} {name}[JOINTS]" for name in arrays), f"{real} tau[JOINTS]"]
        ),
        feed_forward=feed_forward,
        plant_friction=plant_friction,
    )
