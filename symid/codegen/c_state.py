"""The state of the springs in C: a struct, how it is made and moved on, and its test.

Input: `Material`. Output: texts of the header, the source and the self-test; nothing for robots without.

Supported: robots all of whose joints are elastic, with stops, whose springs have an inverse.
"""

from symid.codegen.c_contexts import StateContext, StateHeaderContext, StateTestContext
from symid.codegen.c_tables import write_lines
from symid.codegen.describe import BANNER, Material
from symid.codegen.functions import FunctionSpec
from symid.codegen.printing import find_literal
from symid.codegen.templates import write_template

__all__ = ["find_stop_count", "write_state_header", "write_state_source", "write_state_test"]

_NEEDED = ("hysteresis_step", "hysteresis_inverse_step")


def find_stop_count(material: Material) -> int:
    """Return how many plays the state holds, 0 for a library that has no state."""
    specs: dict[str, FunctionSpec] = {spec.name: spec for spec in material.card.functions}
    if any(name not in specs for name in _NEEDED):
        return 0
    return sum(port.size for port in specs["hysteresis_step"].inputs if port.name == "P")


def write_state_header(material: Material) -> tuple[str, ...]:
    """Return the lines of the header that declare the state."""
    if not find_stop_count(material):
        return ()
    context = StateHeaderContext(
        prefix=material.prefix,
        macro=material.prefix.upper(),
        real=material.options.precision,
        joint_count=material.card.size,
        stop_count=find_stop_count(material),
        spring_count=len(material.card.springs),
    )
    return tuple(write_template("c/hysteresis.h.jinja", context).splitlines())


def write_state_source(material: Material) -> list[tuple[str, str]]:
    """Return the source file of the state."""
    if not find_stop_count(material):
        return []
    context = StateContext(
        banner=BANNER,
        prefix=material.prefix,
        macro=material.prefix.upper(),
        real=material.options.precision,
        zero=find_literal(0.0, material.options.precision),
        joint_count=material.card.size,
        spring_count=len(material.card.springs),
    )
    return [(f"{material.prefix}_hysteresis.c", write_template("c/hysteresis.c.jinja", context))]


def write_state_test(material: Material) -> tuple[str, ...]:
    """Return the lines of the self-test that run the state along the torsions of the step's own test."""
    if not find_stop_count(material):
        return ()
    real = material.options.precision
    names = [program.spec.name for program in material.programs]
    index = names.index("hysteresis_step")
    ports = [port.name for port in material.programs[index].spec.inputs]
    inputs = dict(zip(ports, material.references[index].inputs, strict=True))
    context = StateTestContext(
        prefix=material.prefix,
        real=real,
        zero=find_literal(0.0, real),
        joint_count=material.card.size,
        stop_count=find_stop_count(material),
        spring_count=len(material.card.springs),
        path_lines=write_lines([value for row in inputs["phi"] for value in row], real),
        spring_lines=write_lines(inputs["h"][0], real),
    )
    return tuple(write_template("c/hysteresis_test.c.jinja", context).splitlines())
