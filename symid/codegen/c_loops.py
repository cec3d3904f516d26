"""The example that comes with a C library: a control loop and the robot that it moves.

Input: `Material`. Output: the text of the program.

Supported: rigid robots; robots all of whose joints are elastic, with stops, where torques of the motors can
be found from the motion of the links.
Not supported: other elastic robots; their libraries come without an example.
"""

from symid.codegen.c_contexts import ControlLoopContext, ElasticLoopContext
from symid.codegen.c_parameters import build_example_parameters, list_arguments
from symid.codegen.c_state import find_stop_count
from symid.codegen.describe import BANNER, Material
from symid.codegen.functions import ModelCard, ParameterCard
from symid.codegen.printing import find_literal
from symid.codegen.templates import write_template

__all__ = ["write_control_loop"]

_NUMBERS = {
    "kp": 2500.0,
    "kd": 70.0,
    "period": 0.001,
    "substep": 0.000025,
    "amplitude": 0.1,
    "frequency": 2.0,
    "one": 1.0,
    "two": 2.0,
    "four": 4.0,
}


def _write_friction(material: Material) -> tuple[tuple[str, ...], tuple[str, ...]]:
    if not material.card.friction:
        return (), ()
    given = "f, " if "f" in list_arguments(material.card) else ""
    call = f"{material.prefix}_friction({{}}, {given}friction)"
    start = f"{material.options.precision} friction[JOINTS];"

    def apply(velocity: str, target: str) -> tuple[str, ...]:
        test = f"if ({call.format(velocity)} != 0) {{"
        loop = "for (size_t j = 0; j < JOINTS; ++j) {"
        return (start, test, "    return 1;", "}", loop, f"    {target};", "}")

    return apply("dqd", "tau[j] += friction[j]"), apply("dq", "rigid[j] -= friction[j]")


def write_control_loop(material: Material) -> str | None:
    """Return the text of the example, None if the library lacks a function that it calls."""
    if material.card.springs:
        elastic = _build_elastic_loop(material)
        return None if elastic is None else write_template("c/elastic_loop.c.jinja", elastic)
    rigid = _build_rigid_loop(material)
    return None if rigid is None else write_template("c/control_loop.c.jinja", rigid)


def _list_vectors(card: ModelCard) -> dict[str, tuple[ParameterCard, ...]]:
    """Return the parameters that the library's functions take, by their names in the program."""
    vectors = (
        ("beta", card.vector, card.beta),
        ("rotor", "IA", card.rotors),
        ("f", "f", card.friction),
        ("h", "h", card.springs),
    )
    taken = list_arguments(card)
    return {name: entries for name, port, entries in vectors if port in taken}


def _write_rotors(card: ModelCard, real: str) -> tuple[str, ...]:
    values = ", ".join(find_literal(rotor.value or 0.0, real) for rotor in card.rotors)
    return (
        "/* Rotor inertias: the motors' controllers want them too. */",
        f"static const {real} rotor[JOINTS] = {{{values}}};",
        "",
    )


def _build_rigid_loop(material: Material) -> ControlLoopContext | None:
    card, real = material.card, material.options.precision
    wanted = {"inverse_dynamics", "forward_dynamics", *(["friction"] if card.friction else [])}
    if not wanted <= {spec.name for spec in card.functions}:
        return None
    vectors = {name: entries for name, entries in _list_vectors(card).items() if name in ("beta", "f")}
    parameters = build_example_parameters(material, vectors)
    suffix = "f" if real == "float" else ""
    arrays = ("q", "dq", "qd", "dqd", "ddqd")
    feed_forward, plant_friction = _write_friction(material)
    return ControlLoopContext(
        banner=BANNER,
        prefix=material.prefix,
        real=real,
        joint_count=card.size,
        usage_lines=parameters.usage_lines,
        parameter_lines=parameters.lines,
        reading_lines=parameters.reading_lines,
        arguments=parameters.arguments,
        beta="beta, " if "beta" in vectors else "",
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


def _build_elastic_loop(material: Material) -> ElasticLoopContext | None:
    card, real = material.card, material.options.precision
    wanted = {"elastic_inverse_dynamics", "forward_dynamics", *(["friction"] if card.friction else [])}
    if not wanted <= {spec.name for spec in card.functions} or not find_stop_count(material):
        return None
    vectors = _list_vectors(card)
    parameters = build_example_parameters(material, vectors)
    rotors = () if "rotor" in vectors else _write_rotors(card, real)
    suffix = "f" if real == "float" else ""
    numbers = {name: find_literal(value, real) for name, value in _NUMBERS.items()}
    given = "f, " if "f" in vectors else ""
    felt = f"status += {material.prefix}_friction(robot->dtheta, {given}friction);"
    return ElasticLoopContext(
        banner=BANNER,
        prefix=material.prefix,
        macro=material.prefix.upper(),
        real=real,
        joint_count=card.size,
        usage_lines=parameters.usage_lines,
        parameter_lines=(*parameters.lines, *rotors),
        reading_lines=parameters.reading_lines,
        arguments=parameters.arguments,
        beta="beta, " if "beta" in vectors else "",
        constants="".join(f"{name}, " for name in vectors if name != "h"),
        plant_friction=(felt,) if card.friction else (),
        zero=f"{{{find_literal(0.0, real)}}}",
        sine=f"sin{suffix}",
        cosine=f"cos{suffix}",
        **numbers,
    )
