"""A C99 library that stands alone: header, a file a function, self-test, example, build files; friction laws.

A private header has numbers side by side (SIMD), and sine and cosine of several angles at once:

    x -> n = round(2 x / pi), r = x - n pi/2;  sin r = r + r^3 S(r^2);  cos r = 1 - r^2/2 + r^4 C(r^2).

S and C are minimax polynomials on |r| <= pi/4 (Remez 1934) for the relative error of sin r and cos r, found
in 60 digits, each coefficient rounded before the others were fitted again; in exact arithmetic they err by
less than 2^-57 (double) and 2^-27 (float). The example is a control loop with the robot that it moves.

Friction laws stand alone too, a header and a source. Static ones have a function each,
    double symid_friction_stribeck(double velocity, const double p[4]);
where p holds the physical parameters in the order of the law; `DynamicLaw` is a struct for the deflection of
the bristles of one joint, with functions to initialise and to advance it.

Supported: double and float; one sample and batches; compilers with vector types of GCC, and C99 without;
parameters as arguments or constants; all friction laws of the joint models.
Not supported: an example for elastic robots, but for those with stops and a function of the motor torques;
compilers without C99 arrays of stated size (use clang-cl in place of Microsoft's); calls from Python without
ctypes (see `library`), for float.
"""

import math
import re
from collections.abc import Mapping, Sequence
from itertools import chain

from symid import __version__, joint_models
from symid.codegen import printing, references
from symid.codegen.casadi_functions import Fields, Functions, Material, prepare_material, write_operations
from symid.codegen.functions import FunctionSpec, ModelCard, ParameterCard, Port
from symid.codegen.programs import ExpressionTable, Program
from symid.codegen.source_folder import SourceSet
from symid.codegen.source_text import BANNER, clean_text, write_template
from symid.options import GenerateOptions

_INPUT_UNITS = {"velocity": "rad/s or m/s", "load": "N m or N", "position": "rad or m", "temperature": "degC"}


def build_law_program(law: joint_models.FrictionLaw) -> Program:
    """Return the torque of a law as a program of its inputs, a port each, and its physical parameters p."""
    table = ExpressionTable()
    inputs = {name: table.input(port, 0) for port, name in enumerate(law.inputs)}
    values = [table.input(len(law.inputs), k) for k in range(len(law.physical))]
    own = []
    for row in law.unmixing:
        shares = (pair for pair in zip(row, values, strict=True) if pair[0])
        own.append(table.sum_values(table.scale(float(factor), value) for factor, value in shares))
    count = len(law.linear)
    pairs = zip(own[:count], law.columns(table, inputs, own[count:]), strict=True)
    torque = table.sum_values(table.mul(factor, column) for factor, column in pairs)
    sizes = {**dict.fromkeys(law.inputs, 1), "p": len(values)}
    return table.build_vector_program(_build_law_name(law), sizes, {"tau": [torque]})


def _build_law_name(law: joint_models.FrictionLaw) -> str:
    name = re.sub(r"[^a-z0-9]+", "_", law.name)
    if not law.smoothing:
        return name
    return f"{name}_smooth_{re.sub(r'[^a-z0-9]+', '_', f'{law.smoothing:g}')}"


def generate_friction_laws(
    laws: Sequence[joint_models.FrictionLaw], *, prefix: str = "symid", precision: str = "double"
) -> tuple[tuple[str, str], ...]:
    """Return path and text of the header and of the source of friction laws, which have different names.

    The files are called `prefix`_friction_laws, and functions begin so; `precision` is "double" or "float".
    """
    helpers: set[str] = set()
    functions: list[Fields] = []
    for law in laws:
        body = printing.print_c(build_law_program(law), precision)
        helpers.update(body.helpers)
        # The program's inputs and output are arrays, those of the function numbers.
        lines = [
            re.sub(r"\b(velocity|load|position|temperature)\[0\]", r"\1", line) for line in body.statements
        ]
        inputs = "".join(f"{precision} {name}, " for name in law.inputs)
        name = f"{prefix}_friction_{_build_law_name(law)}"
        comment = [f"@brief {clean_text(law.formula)}", ""]
        comment += map(
            clean_text, (f"Law {law.name}. Source: {law.source}.", f"{law.smoothness} {law.passivity}")
        )
        comment += ["", *(f"@param [in] {port} {_INPUT_UNITS[port]}" for port in law.inputs)]
        comment.append(f"@param [in] p {len(law.physical)} parameters")
        for k, entry in enumerate(law.physical):
            other = f" or {entry.unit_prismatic}" if entry.unit != entry.unit_prismatic else ""
            comment.append("  " + clean_text(f"p[{k}] {entry.name} ({entry.unit}{other}): {entry.meaning}"))
        comment.append("@return friction torque, N m or N, positive against positive velocity")
        function: Fields = {
            "name": name,
            "lines": [f" {line}".rstrip() for line in comment],
            "declaration": f"{precision} {name}({inputs}const {precision} p[{len(law.physical)}])",
            "statements": (*lines[:-1], "return " + lines[-1].removeprefix("tau[0] = ")),
        }
        functions.append(function)
    file = f"{prefix}_friction_laws"
    facts = {"banner": BANNER, "file": file, "functions": functions}
    return (
        (f"{file}.h", write_template("c/friction.h.jinja", facts, macro=file.upper())),
        (f"{file}.c", write_template("c/friction.c.jinja", facts, helpers=sorted(helpers))),
    )


_LAW_BANNER = "Generated by symid. Do not edit: change the law or the template, and write it again."


def build_step_program(law: joint_models.DynamicLaw) -> Program:
    """Return a step as a program: parameters p, held velocity and period, z -> z after it, torque."""
    table = ExpressionTable()
    values = [table.input(0, k) for k in range(len(law.parameters))]
    held = (table.input(1, 0), table.input(1, 1))
    after, torque = joint_models.compute_bristle_step(table, law, held, table.input(2, 0), values)
    sizes, outputs = {"p": len(values), "held": 2, "z": 1}, {"z_after": [after], "torque": [torque]}
    return table.build_vector_program(f"{law.name}_step", sizes, outputs)


def generate_friction_state(
    law: joint_models.DynamicLaw, *, precision: str = "double"
) -> tuple[tuple[str, str], ...]:
    """Return name and text of the header and the source of a law, for `precision` "double" or "float"."""
    prefix = f"symid_friction_{law.name}"
    body = printing.print_c(build_step_program(law), precision)
    largest = "FLT_MAX" if precision == "float" else "DBL_MAX"
    # Conditions on the parameters; a NaN meets none.
    checks, lines = [], []
    for entry in law.parameters:
        relation = ">=" if entry.lower_is_allowed else ">"
        checks.append(f"p->{entry.name} {relation} {printing.write_literal(entry.lower, precision)}")
        upper = printing.write_literal(entry.upper, precision) if math.isfinite(entry.upper) else largest
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
        zero=printing.write_literal(0.0, precision),
        size="fabsf" if precision == "float" else "fabs",
        largest=largest,
        parameter_count=len(law.parameters),
        parameters=", ".join(f"state->parameters.{name}" for name in law.names),
        helpers=body.helpers,
        checks=checks,
        statements=body.statements,
    )
    return ((f"{prefix}.h", header), (f"{prefix}.c", source))


# Parts that sum up to pi/2, of which all but the last have exact products with n; coefficients of S and of C.
_TRIGONOMETRY = {
    "double": (
        (1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21),
        (
            -0.1666666666666663,
            0.00833333333332184,
            -0.00019841269829358528,
            2.7557313538514234e-06,
            -2.5050734389257543e-08,
            1.5895433289345187e-10,
        ),
        (
            0.041666666666666595,
            -0.0013888888888873338,
            2.480158728899748e-05,
            -2.7557314215299134e-07,
            2.087570511500033e-09,
            -1.135873277660174e-11,
        ),
    ),
    "float": (
        (1.5703125, 0.0004837512969970703, 7.549533620476723e-08, 2.5633440682570896e-12),
        (-0.16666655242443085, 0.008332189172506332, -0.0001951828453456983),
        (0.04166664555668831, -0.0013887309469282627, 2.4432327336398885e-05),
    ),
}


def _write_polynomial(texts: list[str]) -> str:
    """Return a polynomial in z, with w = z z, in pairs, so that few sums wait for others."""
    pairs = [" + z * ".join(texts[k : k + 2]) for k in range(0, len(texts), 2)]
    whole = f"({pairs[-1]})" if len(texts) % 2 == 0 else pairs[-1]
    for pair in reversed(pairs[:-1]):
        whole = f"(({pair}) + w * {whole})"
    return whole


def _write_transposition(lanes: int, first: int) -> list[str]:
    """Return statements that turn `lanes` lanes, from x[first] on, and store them as that many rows.

    Elements are exchanged between lanes 1, 2, 4 apart, one bit of their numbers at a time. Sixteen lanes are
    two squares of eight side by side.
    """
    width = min(lanes, 8)
    names = [f"x[{first + k}]" for k in range(width)]
    lines, step = [], 1
    while step < width:
        turned = list(names)
        for k in range(width):
            if k & step:
                continue
            low = [lanes + (i ^ step) if i & step else i for i in range(lanes)]
            high = [lanes + i if i & step else i | step for i in range(lanes)]
            for place, order in ((k, low), (k | step, high)):
                turned[place] = f"y{first + place}_{step}"
                numbers = ", ".join(map(str, order))
                lines.append(
                    f"const lanes {turned[place]} = SHUFFLE({names[k]}, {names[k | step]}, {numbers});"
                )
        names, step = turned, 2 * step
    for k, name in enumerate(names):
        out = f"out + stride * {k} + {first}"
        halves = f"store_halves({out}, {out} + stride * {width}, {name});"
        lines.append(halves if lanes > width else f"store_lanes({out}, {name});")
    return lines


def write_simd_header(macro: str, precision: str) -> str:
    """Return the header for a library whose macros begin with `macro`."""
    parts, sine, cosine = _TRIGONOMETRY[precision]
    double, limit = precision == "double", references.ANGLE_LIMITS[precision]
    bits = 64 if double else 32

    def write_all(*values: float) -> list[str]:
        return [f"ALL({printing.write_literal(value, precision)})" for value in values]

    reduced = "x"
    for part in write_all(*parts):
        reduced = f"({reduced} - n * {part})"
    one, half = write_all(1.0, 0.5)
    blocks = {
        f"{name}_lines": [line for first in range(0, 8, width) for line in _write_transposition(width, first)]
        for name, width in (("sixteen", 16), ("eight", 8), ("four", 4), ("two", 2))
    }
    return write_template(
        "c/lanes.h.jinja",
        {"banner": BANNER},
        macro=macro,
        real=precision,
        bits=f"uint{bits}_t",
        suffix="" if double else "f",
        limit=f"{limit:g}",
        limit_literal=printing.write_literal(limit, precision),
        avx512_lanes=512 // bits,
        avx_lanes=256 // bits,
        sse_lanes=128 // bits,
        two_over_pi=printing.write_literal(2.0 / math.pi, precision),
        shifter=printing.write_literal(1.5 * 2.0 ** (52 if double else 23), precision),
        exponent="0x4330000000000000" if double else "0x4b000000",
        reduced=reduced[1:-1],
        polynomial_lines=(
            "const lanes w = z * z;",
            f"const lanes a = r + (r * z) * {_write_polynomial(write_all(*sine))};",
            f"const lanes b = ({one} - {half} * z) + w * {_write_polynomial(write_all(*cosine))};",
        ),
        sign_shift=bits - 2,
        magnitude="0x7fffffffffffffff" if double else "0x7fffffff",
        **blocks,
    )


def write_python_call(card: ModelCard, prefix: str) -> str:
    """Return the C source of the calls from Python of all functions of the card."""
    functions, most_ports, most_axes = [], 0, 1
    for spec in card.functions:
        ports = (*spec.inputs, *spec.outputs)
        most_ports, most_axes = max(most_ports, len(ports)), max(most_axes, *(len(p.shape) for p in ports))
        shapes = [(port, ", ".join(map(str, port.shape)) or 0) for port in ports]
        functions.append(
            {
                "name": spec.name,
                "arguments": ", ".join(f"pointers[{k}]" for k in range(len(ports))),
                "inputs": len(spec.inputs),
                "outputs": len(spec.outputs),
                "ports": ", ".join(f"{{{len(p.shape)}, {{{shape}}}, {p.size}}}" for p, shape in shapes),
            }
        )
    facts = {"banner": BANNER, "prefix": prefix, "most_ports": most_ports, "most_axes": most_axes}
    return write_template("c/python_call.c.jinja", facts, functions=functions)


_SIMD_HEADER = "_lanes.h"
"""End of the name of the header that is not installed."""


def _declare(spec: FunctionSpec, real: str, mark: str = "") -> tuple[str, str]:
    """Return the parameters of a function in C, of one sample and of a batch; `mark` may be "restrict "."""
    one, batch = [], ["size_t n"]
    for place, port in enumerate((*spec.inputs, *spec.outputs)):
        kind = f"const {real}" if place < len(spec.inputs) else real
        one.append(f"{kind} {port.name}[{mark}{max(port.size, 1)}]")
        batch.append(one[-1] if port.shared else f"{kind} *{mark}{port.name}")
    return ", ".join(one), ", ".join(batch)


def _write_header(material: Material) -> str:
    card = material.card

    def describe(port: Port, direction: str) -> str:
        shape = " x ".join(map(str, port.shape))
        note = "; one vector for all samples" if port.shared else ""
        return f"[{direction}] {port.name} {port.meaning}: {shape}, {port.unit}{note}"

    functions = []
    for spec, count in zip(card.functions, material.operations, strict=True):
        declaration, batch_declaration = _declare(spec, material.options.precision)
        ports = [describe(port, "in") for port in spec.inputs]
        functions.append(
            {
                "name": spec.name,
                "meaning": spec.meaning,
                "parameters": ports + [describe(port, "out") for port in spec.outputs],
                "operations": write_operations(count),
                "declaration": declaration,
                "batch_declaration": batch_declaration,
            }
        )
    return material.write(
        "c/header.h.jinja",
        link_count=card.links,
        beta_count=len(card.beta),
        beta_macro=card.vector.upper(),
        friction_count=len(card.friction),
        elastic_lines=[f" {line}".rstrip() for line in material.elastic_lines],
        functions=functions,
        state_lines=[
            *(material.write("c/hysteresis.h.jinja").splitlines() if material.stops else []),
            *_write_friction_state(material, "h").splitlines(),
        ],
    )


def _write_friction_state(material: Material, ending: str) -> str:
    """Return the declarations (h) or the source (c) of the friction that remembers; nothing without."""
    if not material.bristles:
        return ""
    real, ports = material.options.precision, material.list_given_ports()
    given = "".join(f"const {real} {port.name}[{max(port.size, 1)}], " for port in ports)
    if ending == "h":
        lines = [f"@param[in] {port.name} {port.meaning}: {port.size}, {port.unit}" for port in ports]
        return material.write("c/friction_memory.h.jinja", given=given, given_lines=lines)
    return material.write(
        "c/friction_memory.c.jinja",
        given=given,
        names="".join(f"{port.name}, " for port in ports),
        size="fabsf" if real == "float" else "fabs",
        largest="FLT_MAX" if real == "float" else "DBL_MAX",
    )


# No multiple of the samples that vectors hold: each batch has some left over.
_BATCH_SAMPLES = 13
_FENCE = 8
_UNTOUCHED = 12345.5


def _write_self_test(material: Material, tolerance: str) -> str:
    """Return the self-test of all functions."""
    real, specs = material.options.precision, [program.spec for program in material.programs]
    # Tables of numbers, each once, and what the functions are given and must return.
    arrays: dict[str, Fields] = {}
    tests: list[Fields] = []

    def add_array(kind: str, name: str, rows: references.ReferenceRows) -> str:
        if name not in arrays:
            # Whole numbers are thousandths.
            values = [value * references.PER_UNIT if kind == "int32_t" else value for value in chain(*rows)]
            lines = printing.write_table_lines(values, kind)
            arrays[name] = {"kind": kind, "name": name, "size": max(len(values), 1), "lines": lines}
        return name

    for spec, reference in zip(specs, material.references, strict=True):
        given, returned = [], []
        for port, table, rows in zip(spec.inputs, reference.tables, reference.inputs, strict=True):
            if port.shared:
                places = f"NULL, {add_array(real, f'shared_{table}', rows)}"
            else:
                places = f"{add_array('int32_t', f'state_{table}', rows)}, NULL"
            given.append(f"{{ {places}, {port.size} }}")
        found = zip(spec.outputs, reference.whole, reference.sums, reference.scales, strict=True)
        for port, whole, sums, scale in found:
            tables = (("whole", whole), ("sums", sums))
            names = [add_array("double", f"{kind}_{spec.name}_{port.name}", rows) for kind, rows in tables]
            returned.append(f"{{ {', '.join(names)}, {scale!r}, {port.size} }}")
        call = [f"in[{k}]" for k in range(len(given))] + [f"out[{k}]" for k in range(len(returned))]
        counts = {"input_count": len(given), "output_count": len(returned)}
        listed = {"inputs": given, "outputs": returned}
        tests.append({"name": spec.name, "call": ", ".join(call), **listed, **counts})
    states = _write_state_tests(material)
    inputs = max(sum(port.size for port in spec.inputs if not port.shared) for spec in specs)
    outputs = max(sum(port.size * _BATCH_SAMPLES + _FENCE for port in spec.outputs) for spec in specs)
    return material.write(
        "c/selftest.c.jinja",
        tolerance=tolerance,
        negligible=repr(references.NEGLIGIBLE),
        floor=repr(references.FLOOR),
        untouched=printing.write_literal(_UNTOUCHED, real),
        samples=_BATCH_SAMPLES,
        fence=_FENCE,
        sum_count=len(references.WEIGHTS),
        moduli=", ".join(str(modulus) for modulus, _ in references.WEIGHTS),
        steps=", ".join(str(step) for _, step in references.WEIGHTS),
        weights=" and ".join(f"m = {modulus}, s = {step}" for modulus, step in references.WEIGHTS),
        port_room=max(max(len(spec.inputs), len(spec.outputs)) for spec in specs),
        input_room=max(inputs * _BATCH_SAMPLES, 1),
        output_room=outputs,
        test_count=len(material.programs) + len(states),
        arrays=list(arrays.values()),
        tests=tests,
        state_lines=list(chain(*states.values())),
        state_tests=list(states),
    )


_TEST_PERIOD = 1e-3


def _write_state_tests(material: Material) -> dict[str, list[str]]:
    """Return the lines of the tests of functions with a state, by name; they run along a step's own test."""
    real, found = material.options.precision, {}
    names = [program.spec.name for program in material.programs]

    def gather(function: str) -> dict[str, tuple[tuple[float, ...], ...]]:
        index = names.index(function)
        ports = [port.name for port in material.programs[index].spec.inputs]
        return dict(zip(ports, material.references[index].inputs, strict=True))

    if material.stops:
        given = gather("hysteresis_step")
        found["hysteresis"] = material.write(
            "c/hysteresis_test.c.jinja",
            path_lines=printing.write_table_lines(list(chain(*given["phi"])), real),
            spring_lines=printing.write_table_lines(given["h"][0], real),
        ).splitlines()
    if material.bristles:
        given, ports = gather("friction_step"), material.list_given_ports()
        tables = [
            {
                "name": port.name,
                "size": max(port.size, 1),
                "lines": printing.write_table_lines(given[port.name][0] or (0.0,), real),
            }
            for port in ports
        ]
        found["friction_state"] = material.write(
            "c/friction_memory_test.c.jinja",
            path_lines=printing.write_table_lines(list(chain(*given["dq"])), real),
            tables=tables,
            given="".join(f"{port.name}, " for port in ports),
            period=printing.write_literal(_TEST_PERIOD, real),
        ).splitlines()
    return found


def _write_parameters(material: Material, vectors: Mapping[str, Sequence[ParameterCard]]) -> Fields:
    """Return what an example does with vectors, by their names in the program, in the order of a file."""
    if not vectors:
        usage = ["Usage: control_loop    All parameters are part of the functions."]
        return {"usage_lines": usage, "parameter_lines": [], "file_names": [], "arguments": "void"}
    real = material.options.precision
    values = [entry.value for entries in vectors.values() for entry in entries]
    known = all(value is not None for value in values)
    names = ", then ".join("IA" if name == "rotor" else name for name in vectors)
    pointers, start = [], 0
    for name, entries in vectors.items():
        pointers.append(f"static const {real} *const {name} = parameters + {start};")
        start += len(entries)
    text = material.write(
        "c/parameters.c.jinja",
        parameter_count=max(len(values), 1),
        known=int(known),
        scan="%f" if real == "float" else "%lf",
        names=names,
        value_lines=printing.write_table_lines([value or 0.0 for value in values] if known else [0.0], real),
        pointer_lines=pointers,
    )
    without = "the robot file's values are used" if known else "there are none: the robot file lacks values"
    file = f"FILE holds {names}, as numbers between blanks: identified values,"
    return {
        "usage_lines": [f"Usage: control_loop [FILE]    {file}", f"for example. Without it {without}."],
        "parameter_lines": text.splitlines(),
        "file_names": [names],
        "arguments": "int count, char **arguments",
    }


_RIGID_NUMBERS = {"kp": 400.0, "kd": 40.0, "period": 0.001, "amplitude": 0.2, "frequency": 3.0, "one": 1.0}
_ELASTIC_NUMBERS = {"kp": 2500.0, "kd": 70.0, "period": 0.001, "substep": 0.000025, "amplitude": 0.1}
_BRISTLE_STEPS = 40
"""In which the example moves a robot with bristles, which are quick, within a period."""
_ELASTIC_NUMBERS |= {"frequency": 2.0, "one": 1.0, "two": 2.0, "four": 4.0}


def _write_control_loop(material: Material) -> str | None:
    """Return the text of the example, None if the library lacks a function that it calls."""
    card, real = material.card, material.options.precision
    torques = "elastic_inverse_dynamics" if any(card.elasticity) else "inverse_dynamics"
    wanted = {torques, "forward_dynamics", *(["friction"] if card.friction else [])}
    if not wanted <= {spec.name for spec in card.functions} or (card.springs and not material.stops):
        return None
    taken = {port.name for spec in card.functions for port in spec.inputs}
    # Parameters that the functions take, by their names in the program.
    vectors = {"beta": card.beta} if card.vector in taken else {}
    vectors |= {"rotor": card.rotors} if "IA" in taken and card.springs else {}
    vectors |= {"f": card.friction} if "f" in taken else {}
    vectors |= {"h": card.springs} if "h" in taken and card.springs else {}
    template, numbers = "c/control_loop.c.jinja", _RIGID_NUMBERS
    own: Fields = {"reads_load": "load" in card.friction_inputs}
    own |= {"step": "substep" if material.bristles else "period", "substeps": _BRISTLE_STEPS}
    own["substep"] = printing.write_literal(numbers["period"] / _BRISTLE_STEPS, real)
    if card.springs:
        template, numbers = "c/elastic_loop.c.jinja", _ELASTIC_NUMBERS
        rotors = ", ".join(printing.write_literal(rotor.value or 0.0, real) for rotor in card.rotors)
        own = {
            "constants": "".join(f"{name}, " for name in vectors if name != "h"),
            "rotor_values": [] if "rotor" in vectors else [f"{{{rotors}}}"],
        }
    # How the example calls friction up to its result: input by input, then the parameters.
    places = {
        "wanted": ("dqd", "qd, ", "tau, ", "&feed, dqd, period"),
        "moving": ("dq", "q, ", "load, ", "&bristles, dq, substep"),
        "motor": ("robot->dtheta", "robot->theta, ", "spring, ", "&robot->bristles, robot->dtheta, substep"),
    }
    calls = {}
    for key, (velocity, position, load, step) in places.items():
        texts = {"q": position, "load": load, "temperature": "temperature, "}
        call = f"friction_state_step({step}, " if material.bristles else f"friction({velocity}, "
        values = "f, " if "f" in vectors else ""
        calls[key] = call + "".join(texts[name] for name in card.friction_inputs) + values
    suffix = "f" if real == "float" else ""
    warm = printing.write_literal(joint_models.REFERENCE_TEMPERATURE, real)
    return material.write(
        template,
        beta="beta, " if "beta" in vectors else "",
        friction_arguments=[calls] if card.friction else [],
        remembers=material.bristles > 0,
        warm_values=[f"{{{', '.join([warm] * card.size)}}}"] if "temperature" in card.friction_inputs else [],
        zero=f"{{{printing.write_literal(0.0, real)}}}",
        sine=f"sin{suffix}",
        cosine=f"cos{suffix}",
        **{name: printing.write_literal(value, real) for name, value in numbers.items()},
        **_write_parameters(material, vectors),
        **own,
    )


def _write_sources(material: Material) -> list[tuple[str, str]]:
    prefix, real = material.prefix, material.options.precision
    own, functions = material.options.trigonometry == "own", []
    for program in material.programs:
        spec, body = program.spec, printing.print_c(program, real, together=own)
        lanes = printing.print_simd(program, real) if own else printing.FunctionBody(statements=())
        text = "\n".join(chain(body.statements, *(part.statements for part in body.parts)))
        includes = []
        if lanes.statements or "find_sines(" in text:
            includes.append(f'#include "{prefix}{_SIMD_HEADER}"')
        if re.search(r"\b(sin|cos|exp|tanh|pow|fabs)f?\(", text):
            includes += ["", "#include <math.h>"]
        ports = (*spec.inputs, *spec.outputs)
        definition, batch_definition = _declare(spec, real, "restrict ")
        text = material.write(
            "c/function.c.jinja",
            name=spec.name,
            includes=includes,
            helpers=body.helpers,
            definition=definition,
            batch_definition=batch_definition,
            null_test=" || ".join(f"{port.name} == NULL" for port in ports),
            parts=body.parts,
            lane_parts=lanes.parts,
            statements=body.statements,
            lane_bodies=[lanes.statements] if lanes.statements else [],
            real=real,
            streamed=[{"name": port.name, "size": port.size} for port in printing.list_streamed(spec)],
            call=", ".join(port.name if port.shared else f"{port.name} + {port.size} * k" for port in ports),
        )
        functions.append((f"{prefix}_{spec.name}.c", text))
    if material.stops:
        functions.append((f"{prefix}_hysteresis.c", material.write("c/hysteresis.c.jinja")))
    if material.bristles:
        functions.append((f"{prefix}_friction_state.c", _write_friction_state(material, "c")))
    headers = [(f"{prefix}.h", _write_header(material))]
    if material.options.friction_laws:
        laws = tuple(joint_models.FRICTION_LAWS.values())
        header, source = generate_friction_laws(laws, prefix=prefix, precision=real)
        headers.append(header)
        functions.append(source)
    if any(f'"{prefix}{_SIMD_HEADER}"' in text for _, text in functions):
        headers.append((f"{prefix}{_SIMD_HEADER}", write_simd_header(prefix.upper(), real)))
    digest = material.compute_digest("c", (*headers, *functions))
    # In this order an update moves them in: a folder with a new function has the new digest.
    return [*headers, (f"{prefix}_info.c", material.write("c/info.c.jinja", digest=digest)), *functions]


def generate_c_library(functions: Functions, options: GenerateOptions | None = None) -> SourceSet:
    """Return the files of a C library that computes `functions`.

    Raises:
        GenerationError: a function holds an operation without a C form, or disagrees with itself.
    """
    material = prepare_material(functions, options or GenerateOptions())
    prefix, tolerance = material.prefix, references.TOLERANCES[material.options.precision]
    files = _write_sources(material)
    paths = [path for path, _ in files]
    sources, headers = ([path for path in paths if path.endswith(end)] for end in (".c", ".h"))
    example = _write_control_loop(material)
    texts = {"selftest": _write_self_test(material, tolerance)}
    texts |= {"control_loop": example} if example is not None else {}
    programs = tuple(texts)
    make = material.write(
        "c/Makefile.jinja",
        objects=" ".join(source.removesuffix(".c") + ".o" for source in sources),
        headers=" ".join(headers),
        example_target="".join(f" {program}" for program in programs[1:]),
    )
    # CMake knows numbers alone: 1.2.3.dev4 is 1.2.3.
    version = numbers.group() if (numbers := re.match(r"\d+(\.\d+)*", __version__)) else "0"
    public = " ".join(path for path in headers if path != f"{prefix}{_SIMD_HEADER}")
    cmake = material.write(
        "c/CMakeLists.txt.jinja", cmake_version=version, headers=public, sources=sources, programs=programs
    )
    rows = [
        f"{program.spec.name} | {count.mul} | {count.add} | {count.trig}"
        for program, count in zip(material.programs, material.operations, strict=True)
    ]
    files += [(f"{name}.c", text) for name, text in texts.items()]
    files += [("Makefile", make), ("CMakeLists.txt", cmake)]
    files += [(f"{prefix}.pc.in", material.write("c/package.pc.in.jinja", cmake_version=version))]
    files += [("README.md", material.write("c/README.md.jinja", tolerance=tolerance, rows=rows))]
    return material.collect("c", files)
