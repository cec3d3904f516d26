"""What comes with the functions of a C library: spring state, self-test, and the example of a control loop.

`Material` -> texts.

The state of the springs is a struct with functions that make it and move it on. The self-test compares
every function with its references, for one sample and for batches, and checks that nothing beside the
outputs is written. The example is a control loop with the robot that it moves; its parameters are tables,
or are read from a file.

Supported: rigid robots; robots all of whose joints are elastic, with stops, whose springs have an inverse
and where torques of the motors follow from the motion of the links; parameters as arguments or baked in.
Not supported: an example for other elastic robots.
"""

from collections.abc import Mapping, Sequence
from itertools import chain

from symid.codegen.functions import ModelCard, ParameterCard, Port
from symid.codegen.material import Material
from symid.codegen.printing import write_literal, write_table_lines
from symid.codegen.programs import Program
from symid.codegen.references import FLOOR, NEGLIGIBLE, PER_UNIT, WEIGHTS, Reference, ReferenceRows

Fields = dict[str, object]
"""One entry of a list in a template."""


def write_state_header(material: Material) -> list[str]:
    """Return the lines of the header that declare the state of the springs, none without one."""
    return material.write("c/hysteresis.h.jinja").splitlines() if material.stops else []


def write_state_source(material: Material) -> list[tuple[str, str]]:
    """Return the source file of the state."""
    path = f"{material.prefix}_hysteresis.c"
    return [(path, material.write("c/hysteresis.c.jinja"))] if material.stops else []


def _write_state_test(material: Material) -> list[str]:
    """Return the lines of the self-test that run the state along the torsions of the step's own test."""
    if not material.stops:
        return []
    real = material.options.precision
    names = [program.spec.name for program in material.programs]
    index = names.index("hysteresis_step")
    ports = [port.name for port in material.programs[index].spec.inputs]
    inputs = dict(zip(ports, material.references[index].inputs, strict=True))
    text = material.write(
        "c/hysteresis_test.c.jinja",
        path_lines=write_table_lines(list(chain(*inputs["phi"])), real),
        spring_lines=write_table_lines(inputs["h"][0], real),
    )
    return text.splitlines()


TOLERANCES = {"double": "1e-12", "float": "2e-5"}
"""Sound code errs by a few units of the last place, 1e-16 or 6e-8, times the condition of what it solves, up
to 100 here; a wrong sign or place, or a wrong digit in a constant, errs by much more."""

# No multiple of the samples that vectors hold: each batch has some left over.
_BATCH_SAMPLES = 13
_FENCE = 8
_UNTOUCHED = 12345.5
_INTEGERS_PER_LINE = 16


def _write_thousandths(values: Sequence[float]) -> list[str]:
    whole = [str(round(value * PER_UNIT)) for value in values] or ["0"]
    starts = range(0, len(whole), _INTEGERS_PER_LINE)
    return [", ".join(whole[k : k + _INTEGERS_PER_LINE]) + "," for k in starts]


def _name_array(port: Port, table: str) -> str:
    return f"{'shared' if port.shared else 'state'}_{table}"


def _describe_array(kind: str, name: str, rows: ReferenceRows) -> Fields:
    """Return a table of numbers: whole ones are thousandths."""
    values = list(chain(*rows))
    lines = _write_thousandths(values) if kind == "int32_t" else write_table_lines(values, kind)
    return {"kind": kind, "name": name, "size": max(len(values), 1), "lines": lines}


def _list_arrays(material: Material) -> list[Fields]:
    real = material.options.precision
    arrays: dict[str, Fields] = {}
    for program, reference in zip(material.programs, material.references, strict=True):
        spec = program.spec
        for port, table, rows in zip(spec.inputs, reference.tables, reference.inputs, strict=True):
            name = _name_array(port, table)
            if name not in arrays:
                arrays[name] = _describe_array(real if port.shared else "int32_t", name, rows)
        for port, whole, sums in zip(spec.outputs, reference.whole, reference.sums, strict=True):
            for kind, rows in (("whole", whole), ("sums", sums)):
                name = f"{kind}_{spec.name}_{port.name}"
                arrays[name] = _describe_array("double", name, rows)
    return list(arrays.values())


def _describe_input(port: Port, table: str) -> str:
    name = _name_array(port, table)
    places = f"NULL, {name}" if port.shared else f"{name}, NULL"
    return f"{{ {places}, {port.size} }}"


def _describe_test(program: Program, reference: Reference) -> Fields:
    spec = program.spec
    given = [f"in[{k}]" for k in range(len(spec.inputs))] + [f"out[{k}]" for k in range(len(spec.outputs))]
    return {
        "name": spec.name,
        "call": ", ".join(given),
        "inputs": list(map(_describe_input, spec.inputs, reference.tables)),
        "outputs": [
            f"{{ whole_{spec.name}_{port.name}, sums_{spec.name}_{port.name}, {scale!r}, {port.size} }}"
            for port, scale in zip(spec.outputs, reference.scales, strict=True)
        ],
        "input_count": len(spec.inputs),
        "output_count": len(spec.outputs),
    }


def _count_test_buffers(programs: Sequence[Program]) -> tuple[int, int, int]:
    """Return the most ports of one kind, and the elements that inputs and outputs of a batch take."""
    specs = [program.spec for program in programs]
    ports = max(max(len(spec.inputs), len(spec.outputs)) for spec in specs)
    inputs = max(sum(port.size for port in spec.inputs if not port.shared) for spec in specs)
    outputs = max(sum(port.size * _BATCH_SAMPLES + _FENCE for port in spec.outputs) for spec in specs)
    return ports, max(inputs * _BATCH_SAMPLES, 1), outputs


def write_self_test(material: Material, tolerance: str) -> str:
    """Return the self-test of all functions."""
    state_lines = _write_state_test(material)
    ports, inputs, outputs = _count_test_buffers(material.programs)
    return material.write(
        "c/selftest.c.jinja",
        tolerance=tolerance,
        negligible=repr(NEGLIGIBLE),
        floor=repr(FLOOR),
        untouched=write_literal(_UNTOUCHED, material.options.precision),
        samples=_BATCH_SAMPLES,
        fence=_FENCE,
        sum_count=len(WEIGHTS),
        moduli=", ".join(str(modulus) for modulus, _ in WEIGHTS),
        steps=", ".join(str(step) for _, step in WEIGHTS),
        weights=" and ".join(f"m = {modulus}, s = {step}" for modulus, step in WEIGHTS),
        port_room=ports,
        input_room=inputs,
        output_room=outputs,
        test_count=len(material.programs) + bool(state_lines),
        arrays=_list_arrays(material),
        tests=list(map(_describe_test, material.programs, material.references)),
        state_lines=state_lines,
        state_tests=["hysteresis"] if state_lines else [],
    )


_VECTOR_TITLES = {"rotor": "IA"}


def _list_arguments(card: ModelCard) -> frozenset[str]:
    """Return the names of all inputs of all functions."""
    return frozenset(port.name for spec in card.functions for port in spec.inputs)


def _write_parameters(
    material: Material, vectors: Mapping[str, Sequence[ParameterCard]]
) -> dict[str, str | list[str]]:
    """Return what an example does with vectors, by their names in the program, in the order of a file."""
    real = material.options.precision
    if not vectors:
        text = "Usage: control_loop    All parameters are part of the functions."
        return {"usage_lines": [text], "parameter_lines": [], "reading_lines": [], "arguments": "void"}
    values = [entry.value for entries in vectors.values() for entry in entries]
    known = all(value is not None for value in values)
    names = ", then ".join(_VECTOR_TITLES.get(name, name) for name in vectors)
    pointers, start = [], 0
    for name, entries in vectors.items():
        pointers.append(f"static const {real} *const {name} = parameters + {start};")
        start += len(entries)
    text = material.write(
        "c/parameters.c.jinja",
        scan="%f" if real == "float" else "%lf",
        names=names,
        value_lines=write_table_lines([value or 0.0 for value in values] if known else [0.0], real),
        pointer_lines=pointers,
    )
    defines = [f"#define PARAMETERS {max(len(values), 1)}", f"#define KNOWN {int(known)}", ""]
    without = "the robot file's values are used" if known else "there are none: the robot file lacks values"
    file = f"FILE holds {names}, as numbers between blanks: identified values,"
    return {
        "usage_lines": [
            f"Usage: control_loop [FILE]    {file}",
            f"for example. Without it {without}.",
        ],
        "parameter_lines": [*defines, *text.rstrip("\n").split("\n"), ""],
        "reading_lines": [
            "if (count > 1 ? !read_parameters(arguments[1]) : !KNOWN) {",
            f'    fprintf(stderr, "usage: control_loop FILE    FILE: %d numbers, {names}\\n", PARAMETERS);',
            "    return 2;",
            "}",
        ],
        "arguments": "int count, char **arguments",
    }


_ELASTIC_LOOP_NUMBERS = {
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
    given = "f, " if "f" in _list_arguments(material.card) else ""
    call = f"{material.prefix}_friction({{}}, {given}friction)"
    start = f"{material.options.precision} friction[JOINTS];"

    def apply(velocity: str, target: str) -> tuple[str, ...]:
        test = f"if ({call.format(velocity)} != 0) {{"
        loop = "for (size_t j = 0; j < JOINTS; ++j) {"
        return (start, test, "    return 1;", "}", loop, f"    {target};", "}")

    return apply("dqd", "tau[j] += friction[j]"), apply("dq", "rigid[j] -= friction[j]")


def write_control_loop(material: Material) -> str | None:
    """Return the text of the example, None if the library lacks a function that it calls."""
    card = material.card
    torques = "elastic_inverse_dynamics" if card.springs else "inverse_dynamics"
    wanted = {torques, "forward_dynamics", *(["friction"] if card.friction else [])}
    if not wanted <= {spec.name for spec in card.functions}:
        return None
    if not card.springs:
        return _write_rigid_loop(material)
    return _write_elastic_loop(material) if material.stops else None


def _list_vectors(card: ModelCard) -> dict[str, tuple[ParameterCard, ...]]:
    """Return the parameters that the library's functions take, by their names in the program."""
    vectors = (
        ("beta", card.vector, card.beta),
        ("rotor", "IA", card.rotors),
        ("f", "f", card.friction),
        ("h", "h", card.springs),
    )
    taken = _list_arguments(card)
    return {name: entries for name, port, entries in vectors if port in taken}


def _write_rigid_loop(material: Material) -> str:
    card, real = material.card, material.options.precision
    vectors = {name: entries for name, entries in _list_vectors(card).items() if name in ("beta", "f")}
    suffix = "f" if real == "float" else ""
    arrays = ("q", "dq", "qd", "dqd", "ddqd")
    feed_forward, plant_friction = _write_friction(material)
    return material.write(
        "c/control_loop.c.jinja",
        **_write_parameters(material, vectors),
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


def _write_elastic_loop(material: Material) -> str:
    card, real = material.card, material.options.precision
    vectors = _list_vectors(card)
    parameters = _write_parameters(material, vectors)
    if "rotor" not in vectors:
        values = ", ".join(write_literal(rotor.value or 0.0, real) for rotor in card.rotors)
        parameters["parameter_lines"] = [
            *parameters["parameter_lines"],
            "/* Rotor inertias: the motors' controllers want them too. */",
            f"static const {real} rotor[JOINTS] = {{{values}}};",
            "",
        ]
    suffix = "f" if real == "float" else ""
    given = "f, " if "f" in vectors else ""
    felt = f"status += {material.prefix}_friction(robot->dtheta, {given}friction);"
    return material.write(
        "c/elastic_loop.c.jinja",
        **parameters,
        beta="beta, " if "beta" in vectors else "",
        constants="".join(f"{name}, " for name in vectors if name != "h"),
        plant_friction=[felt] if card.friction else [],
        zero=f"{{{write_literal(0.0, real)}}}",
        sine=f"sin{suffix}",
        cosine=f"cos{suffix}",
        **{name: write_literal(value, real) for name, value in _ELASTIC_LOOP_NUMBERS.items()},
    )
