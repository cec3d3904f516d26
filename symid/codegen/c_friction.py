"""Friction laws as C99 that stands alone, with and without memory: one header and one source.

Static laws -> one function a law,
    double symid_friction_stribeck(double velocity, const double p[4]);
where p holds the physical parameters in the order of the law.
`DynamicLaw` -> a struct for the deflection of the bristles, with functions to initialise and to advance it.

Supported: double and float; all laws of the joint models.
Not supported: several joints in one state; each joint has its own.
"""

import math
import re
from collections.abc import Iterator, Sequence

from symid.codegen.functions import FunctionSpec, Port
from symid.codegen.material import BANNER, Fields
from symid.codegen.printing import print_c, write_c_helper, write_literal
from symid.codegen.programs import ExpressionTable, Program, ValueAlgebra
from symid.codegen.source_text import clean_text, write_template
from symid.joint_models import DynamicLaw, FrictionLaw, compute_bristle_step

_INPUT_UNITS = {"velocity": "rad/s or m/s", "load": "N m or N", "position": "rad or m"}


def build_law_program(law: FrictionLaw) -> Program:
    """Return the torque of a law as a program of its inputs, a port each, and its physical parameters p."""
    table = ExpressionTable()
    algebra = ValueAlgebra(table)
    inputs = {name: table.input(port, 0) for port, name in enumerate(law.inputs)}
    values = [table.input(len(law.inputs), k) for k in range(len(law.physical))]
    own = []
    for row in law.unmixing:
        total = algebra.zero
        for factor, value in zip(row, values, strict=True):
            if factor:
                total = algebra.add(total, algebra.scale(float(factor), value))
        own.append(total)
    count = len(law.linear)
    torque = algebra.zero
    for factor, column in zip(own[:count], law.columns(algebra, inputs, own[count:]), strict=True):
        torque = algebra.add(torque, algebra.mul(factor, column))
    spec = FunctionSpec(
        name=_build_law_name(law),
        inputs=(
            *(Port(name=name, shape=(1,), unit=_INPUT_UNITS[name], meaning=name) for name in law.inputs),
            Port(name="p", shape=(len(values),), unit="mixed", meaning="parameters", shared=True),
        ),
        outputs=(Port(name="tau", shape=(1,), unit="N m", meaning="friction torque"),),
        meaning=law.formula,
    )
    return table.build_program(spec, [[torque]])


def _build_law_name(law: FrictionLaw) -> str:
    name = re.sub(r"[^a-z0-9]+", "_", law.name)
    if not law.smoothing:
        return name
    return f"{name}_smooth_{re.sub(r'[^a-z0-9]+', '_', f'{law.smoothing:g}')}"


def _describe_law(law: FrictionLaw) -> Iterator[str]:
    yield f"@brief {clean_text(law.formula)}"
    yield ""
    yield clean_text(f"Law {law.name}. Source: {law.source}.")
    yield clean_text(f"{law.smoothness} {law.passivity}")
    yield ""
    for name in law.inputs:
        yield f"@param [in] {name} {_INPUT_UNITS[name]}"
    yield f"@param [in] p {len(law.physical)} parameters"
    for k, parameter in enumerate(law.physical):
        other = f" or {parameter.unit_prismatic}" if parameter.unit != parameter.unit_prismatic else ""
        yield "  " + clean_text(f"p[{k}] {parameter.name} ({parameter.unit}{other}): {parameter.meaning}")
    yield "@return friction torque, N m or N, positive against positive velocity"


def generate_friction_laws(
    laws: Sequence[FrictionLaw], *, prefix: str = "symid", precision: str = "double"
) -> tuple[tuple[str, str], ...]:
    """Return path and text of the header and of the source of friction laws, which have different names.

    The files are called `prefix`_friction_laws, and functions begin so; `precision` is "double" or "float".
    """
    helpers: set[str] = set()
    functions: list[Fields] = []
    for law in laws:
        body = print_c(build_law_program(law), precision)
        helpers.update(body.helpers)
        # The program's inputs and output are arrays, those of the function numbers.
        lines = [re.sub(r"\b(velocity|load|position)\[0\]", r"\1", line) for line in body.statements]
        inputs = "".join(f"{precision} {name}, " for name in law.inputs)
        name = f"{prefix}_friction_{_build_law_name(law)}"
        function: Fields = {
            "name": name,
            "lines": [f" {line}".rstrip() for line in _describe_law(law)],
            "declaration": f"{precision} {name}({inputs}const {precision} p[{len(law.physical)}])",
            "statements": (*lines[:-1], "return " + lines[-1].removeprefix("tau[0] = ")),
        }
        functions.append(function)
    file = f"{prefix}_friction_laws"
    facts = {"banner": BANNER, "file": file, "functions": functions}
    helper_texts = [write_c_helper(name, precision) for name in sorted(helpers)]
    return (
        (f"{file}.h", write_template("c/friction.h.jinja", facts, macro=file.upper())),
        (f"{file}.c", write_template("c/friction.c.jinja", facts, helpers=helper_texts)),
    )


_LAW_BANNER = "Generated by symid. Do not edit: change the law or the template, and write it again."


def build_step_program(law: DynamicLaw) -> Program:
    """Return a step as a program: parameters p, held velocity and period, z -> z after it, torque."""
    table = ExpressionTable()
    algebra = ValueAlgebra(table)
    values = [table.input(0, k) for k in range(len(law.parameters))]
    held = (table.input(1, 0), table.input(1, 1))
    step = compute_bristle_step(algebra, law, held, table.input(2, 0), values)
    spec = FunctionSpec(
        name=f"{law.name}_step",
        inputs=(
            Port(name="p", shape=(len(values),), unit="mixed", meaning="parameters", shared=True),
            Port(name="held", shape=(2,), unit="mixed", meaning="velocity and period of the step"),
            Port(name="z", shape=(1,), unit="rad", meaning="deflection of the bristles"),
        ),
        outputs=(
            Port(name="z_after", shape=(1,), unit="rad", meaning="deflection after the step"),
            Port(name="torque", shape=(1,), unit="N m", meaning="friction torque after the step"),
        ),
        meaning=law.formula,
    )
    return table.build_program(spec, [[value] for value in step])


def generate_friction_state(law: DynamicLaw, *, precision: str = "double") -> tuple[tuple[str, str], ...]:
    """Return name and text of the header and the source of a law, for `precision` "double" or "float"."""
    prefix = f"symid_friction_{law.name}"
    body = print_c(build_step_program(law), precision)
    largest = "FLT_MAX" if precision == "float" else "DBL_MAX"
    # Conditions on the parameters; a NaN meets none.
    checks, lines = [], []
    for entry in law.parameters:
        relation = ">=" if entry.lower_is_allowed else ">"
        checks.append(f"p->{entry.name} {relation} {write_literal(entry.lower, precision)}")
        upper = write_literal(entry.upper, precision) if math.isfinite(entry.upper) else largest
        checks.append(f"p->{entry.name} <= {upper}")
        lines.append(f"{entry.name}; /**< {entry.meaning}, {entry.unit} ({entry.unit_prismatic}) */")
    facts = {"banner": _LAW_BANNER, "prefix": prefix, "macro": prefix.upper(), "real": precision}
    header = write_template(
        "c/friction_state.h.jinja",
        facts,
        law=law.name,
        formula=clean_text(law.formula),
        parameter_lines=lines,
    )
    source = write_template(
        "c/friction_state.c.jinja",
        facts,
        zero=write_literal(0.0, precision),
        size="fabsf" if precision == "float" else "fabs",
        largest=largest,
        parameter_count=len(law.parameters),
        parameters=", ".join(f"state->parameters.{name}" for name in law.names),
        helpers=[write_c_helper(name, precision) for name in body.helpers],
        checks=checks,
        statements=body.statements,
    )
    return ((f"{prefix}.h", header), (f"{prefix}.c", source))
