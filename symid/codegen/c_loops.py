"""The example that comes with a C library: a control loop and the robot that it moves.

Input: `Material`. Output: the text of the program.

Supported: rigid robots; robots all of whose joints are elastic, with stops, where torques of the motors can
be found from the motion of the links.
Not supported: other elastic robots; their libraries come without an example.
"""

from symid.codegen.c_contexts import ControlLoopContext, ElasticLoopContext
from symid.codegen.c_state import find_stop_count
from symid.codegen.c_tables import write_lines
from symid.codegen.describe import BANNER, Material
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
    call = f"{material.prefix}_friction({{}}, parameters + {len(material.card.beta)}, friction)"
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


def _build_rigid_loop(material: Material) -> ControlLoopContext | None:
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
        parameter_lines=write_lines([value or 0.0 for value in values] if known else [0.0], real),
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
    vectors = (card.beta, card.rotors, card.friction, card.springs)
    starts = [sum(map(len, vectors[:k])) for k in range(4)]
    values = [parameter.value for vector in vectors for parameter in vector]
    known = all(value is not None for value in values)
    suffix = "f" if real == "float" else ""
    numbers = {name: find_literal(value, real) for name, value in _NUMBERS.items()}
    felt = f"status += {material.prefix}_friction(robot->dtheta, f, friction);"
    return ElasticLoopContext(
        banner=BANNER,
        prefix=material.prefix,
        macro=material.prefix.upper(),
        real=real,
        scan="%f" if real == "float" else "%lf",
        joint_count=card.size,
        parameter_count=len(values),
        known=int(known),
        parameter_lines=write_lines([value or 0.0 for value in values] if known else [0.0], real),
        rotor_start=starts[1],
        friction_pointer=(
            (f"static const {real} *const f = parameters + {starts[2]};",) if card.friction else ()
        ),
        spring_start=starts[3],
        friction_argument="f, " if card.friction else "",
        plant_friction=(felt,) if card.friction else (),
        zero=f"{{{find_literal(0.0, real)}}}",
        sine=f"sin{suffix}",
        cosine=f"cos{suffix}",
        **numbers,
    )
