"""A C99 library that stands alone: header, one file a function, self-test, example, build files.

A private header has numbers side by side (SIMD), and sine and cosine of several angles at once:

    x -> n = round(2 x / pi), r = x - n pi/2;  sin r = r + r^3 S(r^2);  cos r = 1 - r^2/2 + r^4 C(r^2).

S and C are minimax polynomials on |r| <= pi/4 (Remez 1934) for the relative error of sin r and cos r, found
in 60 digits, each coefficient rounded before the others were fitted again; in exact arithmetic they err by
less than 2^-57 (double) and 2^-27 (float). The example is a control loop with the robot that it moves.

Supported: double and float; one sample and batches; compilers with vector types of GCC, and C99 without;
parameters as arguments or constants.
Not supported: an example for elastic robots, but for those with stops and a function of the motor torques;
compilers without C99 arrays of stated size (use clang-cl in place of Microsoft's); calls from Python without
ctypes (see `calls`), for float.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain

from symid import __version__
from symid.codegen.c_friction import generate_friction_laws
from symid.codegen.casadi_functions import Functions
from symid.codegen.functions import FunctionSpec, ModelCard, ParameterCard, Port
from symid.codegen.library import compute_build_digest
from symid.codegen.material import (
    BANNER,
    Fields,
    Material,
    prepare_material,
    write_manifest,
    write_operations,
)
from symid.codegen.printing import (
    join_lines,
    print_c,
    print_simd,
    write_c_helper,
    write_literal,
    write_table_lines,
)
from symid.codegen.programs import Operations, Program
from symid.codegen.references import FLOOR, NEGLIGIBLE, PER_UNIT, WEIGHTS, Reference, ReferenceRows
from symid.codegen.source_folder import SourceSet, compute_digest
from symid.codegen.source_text import GenerateOptions, write_template
from symid.joint_models import FRICTION_LAWS


@dataclass(frozen=True, slots=True, kw_only=True)
class _NumberKind:
    """Numbers of one precision. `parts` sum up to pi/2; products of all but the last with n are exact."""

    bits: int
    limit: float
    shifter: float
    two_over_pi: float
    parts: tuple[float, ...]
    sine: tuple[float, ...]
    cosine: tuple[float, ...]


_NUMBER_KINDS = {
    "double": _NumberKind(
        bits=64,
        limit=1e6,
        shifter=1.5 * 2.0**52,
        two_over_pi=0.6366197723675814,
        parts=(1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21),
        sine=(
            -0.1666666666666663,
            0.00833333333332184,
            -0.00019841269829358528,
            2.7557313538514234e-06,
            -2.5050734389257543e-08,
            1.5895433289345187e-10,
        ),
        cosine=(
            0.041666666666666595,
            -0.0013888888888873338,
            2.480158728899748e-05,
            -2.7557314215299134e-07,
            2.087570511500033e-09,
            -1.135873277660174e-11,
        ),
    ),
    "float": _NumberKind(
        bits=32,
        limit=1e4,
        shifter=1.5 * 2.0**23,
        two_over_pi=0.6366197723675814,
        parts=(1.5703125, 0.0004837512969970703, 7.549533620476723e-08, 2.5633440682570896e-12),
        sine=(-0.16666655242443085, 0.008332189172506332, -0.0001951828453456983),
        cosine=(0.04166664555668831, -0.0013887309469282627, 2.4432327336398885e-05),
    ),
}


def _write_polynomial(texts: list[str]) -> str:
    """Return a polynomial in z, with w = z z, in pairs, so that few sums wait for others."""
    pairs = [" + z * ".join(texts[k : k + 2]) for k in range(0, len(texts), 2)]
    whole = f"({pairs[-1]})" if len(texts) % 2 == 0 else pairs[-1]
    for pair in reversed(pairs[:-1]):
        whole = f"(({pair}) + w * {whole})"
    return whole


def _write_transposition(width: int, first: int) -> list[str]:
    """Return statements that turn `width` lanes, from x[first] on, and store them as `width` rows.

    Elements are exchanged between lanes 1, 2, 4 apart, one bit of their numbers at a time.
    """
    names = [f"x[{first + k}]" for k in range(width)]
    lines, step = [], 1
    while step < width:
        turned = list(names)
        for k in range(width):
            if k & step:
                continue
            low = [width + (i ^ step) if i & step else i for i in range(width)]
            high = [width + i if i & step else i | step for i in range(width)]
            for place, order in ((k, low), (k | step, high)):
                turned[place] = f"y{first + place}_{step}"
                numbers = ", ".join(map(str, order))
                lines.append(
                    f"const lanes {turned[place]} = SHUFFLE({names[k]}, {names[k | step]}, {numbers});"
                )
        names, step = turned, 2 * step
    for k, name in enumerate(names):
        lines.append(f"store_lanes(out + stride * {k} + {first}, {name});")
    return lines


def write_simd_header(macro: str, precision: str) -> str:
    """Return the header for a library whose macros begin with `macro`."""
    kind = _NUMBER_KINDS[precision]
    double = precision == "double"

    def write_all(*values: float) -> list[str]:
        return [f"ALL({write_literal(value, precision)})" for value in values]

    reduced = "x"
    for part in write_all(*kind.parts):
        reduced = f"({reduced} - n * {part})"
    one, half = write_all(1.0, 0.5)
    blocks = {
        f"{name}_lines": [line for first in range(0, 8, width) for line in _write_transposition(width, first)]
        for name, width in (("eight", 8), ("four", 4), ("two", 2))
    }
    return write_template(
        "c/lanes.h.jinja",
        {"banner": BANNER},
        macro=macro,
        real=precision,
        bits=f"uint{kind.bits}_t",
        suffix="" if double else "f",
        limit=f"{kind.limit:g}",
        limit_literal=write_literal(kind.limit, precision),
        avx_lanes=4 if double else 8,
        sse_lanes=2 if double else 4,
        two_over_pi=write_literal(kind.two_over_pi, precision),
        shifter=write_literal(kind.shifter, precision),
        exponent="0x4330000000000000" if double else "0x4b000000",
        reduced=reduced[1:-1],
        polynomial_lines=(
            "const lanes w = z * z;",
            f"const lanes a = r + (r * z) * {_write_polynomial(write_all(*kind.sine))};",
            f"const lanes b = ({one} - {half} * z) + w * {_write_polynomial(write_all(*kind.cosine))};",
        ),
        sign_shift=kind.bits - 2,
        magnitude="0x7fffffffffffffff" if double else "0x7fffffff",
        **blocks,
    )


def _describe_call(spec: FunctionSpec) -> Fields:
    """Return the arguments of a call as elements of an array of pointers, and their shapes."""
    ports = (*spec.inputs, *spec.outputs)
    shapes = [(port, ", ".join(map(str, port.shape)) or 0) for port in ports]
    return {
        "name": spec.name,
        "arguments": ", ".join(f"pointers[{k}]" for k in range(len(ports))),
        "inputs": len(spec.inputs),
        "outputs": len(spec.outputs),
        "ports": ", ".join(f"{{{len(port.shape)}, {{{shape}}}, {port.size}}}" for port, shape in shapes),
    }


def write_python_call(card: ModelCard, prefix: str) -> str:
    """Return the C source of the calls from Python of all functions of the card."""
    ports = [(*spec.inputs, *spec.outputs) for spec in card.functions]
    return write_template(
        "c/python_call.c.jinja",
        {"banner": BANNER, "prefix": prefix},
        most_ports=max(map(len, ports)),
        most_axes=max(1, *(len(port.shape) for several in ports for port in several)),
        functions=list(map(_describe_call, card.functions)),
    )


_SIMD_HEADER = "_lanes.h"
"""End of the name of the header that is not installed."""


def _declare(spec: FunctionSpec, real: str, *, restrict: bool, batch: bool) -> str:
    """Return the parameters of a function in C, of one sample or of a batch."""
    mark = "restrict " if restrict else ""

    def declare(port: Port) -> str:
        if batch and not port.shared:
            return f"{real} *{mark}{port.name}"
        return f"{real} {port.name}[{mark}{max(port.size, 1)}]"

    inputs = [f"const {declare(port)}" for port in spec.inputs]
    return ", ".join([*(["size_t n"] if batch else []), *inputs, *map(declare, spec.outputs)])


def _describe_port(port: Port, direction: str) -> str:
    shape = " x ".join(map(str, port.shape))
    note = "; one vector for all samples" if port.shared else ""
    return f"[{direction}] {port.name} {port.meaning}: {shape}, {port.unit}{note}"


def _describe_function(program: Program, count: Operations, real: str) -> Fields:
    spec = program.spec
    described = [_describe_port(port, "in") for port in spec.inputs]
    return {
        "name": spec.name,
        "meaning": spec.meaning,
        "parameters": described + [_describe_port(port, "out") for port in spec.outputs],
        "operations": write_operations(count),
        "declaration": _declare(spec, real, restrict=False, batch=False),
        "batch_declaration": _declare(spec, real, restrict=False, batch=True),
    }


def _write_header(material: Material) -> str:
    card, real = material.card, material.options.precision
    described = zip(material.programs, material.operations, strict=True)
    return material.write(
        "c/header.h.jinja",
        link_count=card.links,
        beta_count=len(card.beta),
        beta_macro=card.vector.upper(),
        friction_count=len(card.friction),
        elastic_lines=[f" {line}".rstrip() for line in material.elastic_lines],
        functions=[_describe_function(program, count, real) for program, count in described],
        state_lines=material.write("c/hysteresis.h.jinja").splitlines() if material.stops else [],
    )


def _write_function(material: Material, program: Program) -> str:
    real, spec, macro = material.options.precision, program.spec, material.prefix.upper()
    own = material.options.trigonometry == "own"
    body = print_c(program, real, together=own)
    lanes = print_simd(program, real) if own else ()
    text = "\n".join(body.statements)
    includes = []
    if lanes or "find_sines(" in text:
        includes.append(f'#include "{material.prefix}{_SIMD_HEADER}"')
    if re.search(r"\b(sin|cos|tan|sqrt|exp|tanh|pow|fabs)f?\(", text):
        includes += ["", "#include <math.h>"]
    # Where some samples are left over, the last block begins before them.
    loop = (
        f"#if {macro}_LANES > 1",
        f"    if (n >= {macro}_LANES) {{",
        f"        for (size_t first = 0; first < n; first += {macro}_LANES) {{",
        f"            const size_t k = first <= n - {macro}_LANES ? first : n - {macro}_LANES;",
        *(f"            {line}" for line in lanes),
        "        }",
        f"        return {macro}_OK;",
        "    }",
        "#endif",
    )
    ports = (*spec.inputs, *spec.outputs)
    return material.write(
        "c/function.c.jinja",
        name=spec.name,
        includes=includes,
        helpers=[write_c_helper(name, real) for name in body.helpers],
        definition=_declare(spec, real, restrict=True, batch=False),
        batch_definition=_declare(spec, real, restrict=True, batch=True),
        null_test=" || ".join(f"{port.name} == NULL" for port in ports),
        statements=body.statements,
        lane_lines=loop if lanes else (),
        call=", ".join(port.name if port.shared else f"{port.name} + {port.size} * k" for port in ports),
    )


_TOLERANCES = {"double": "1e-12", "float": "2e-5"}
"""Sound code errs by a few units of the last place, 1e-16 or 6e-8, times the condition of what it solves, up
to 100 here; a wrong sign or place, or a wrong digit in a constant, errs by much more."""

# No multiple of the samples that vectors hold: each batch has some left over.
_BATCH_SAMPLES = 13
_FENCE = 8
_UNTOUCHED = 12345.5
_INTEGERS_PER_LINE = 16


def _name_array(port: Port, table: str) -> str:
    return f"{'shared' if port.shared else 'state'}_{table}"


def _describe_array(kind: str, name: str, rows: ReferenceRows) -> Fields:
    """Return a table of numbers: whole ones are thousandths."""
    values = list(chain(*rows))
    if kind == "int32_t":
        whole = [str(round(value * PER_UNIT)) for value in values] or ["0"]
        lines = join_lines(whole, _INTEGERS_PER_LINE)
    else:
        lines = write_table_lines(values, kind)
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


def _describe_test(program: Program, reference: Reference) -> Fields:
    spec = program.spec

    def describe(port: Port, table: str) -> str:
        name = _name_array(port, table)
        places = f"NULL, {name}" if port.shared else f"{name}, NULL"
        return f"{{ {places}, {port.size} }}"

    given = [f"in[{k}]" for k in range(len(spec.inputs))] + [f"out[{k}]" for k in range(len(spec.outputs))]
    return {
        "name": spec.name,
        "call": ", ".join(given),
        "inputs": list(map(describe, spec.inputs, reference.tables)),
        "outputs": [
            f"{{ whole_{spec.name}_{port.name}, sums_{spec.name}_{port.name}, {scale!r}, {port.size} }}"
            for port, scale in zip(spec.outputs, reference.scales, strict=True)
        ],
        "input_count": len(spec.inputs),
        "output_count": len(spec.outputs),
    }


def _write_self_test(material: Material, tolerance: str) -> str:
    """Return the self-test of all functions."""
    real, specs = material.options.precision, [program.spec for program in material.programs]
    state_lines = []
    if material.stops:
        # The state runs along the torsions of the step's own test.
        index = [spec.name for spec in specs].index("hysteresis_step")
        ports = [port.name for port in specs[index].inputs]
        given = dict(zip(ports, material.references[index].inputs, strict=True))
        state_lines = material.write(
            "c/hysteresis_test.c.jinja",
            path_lines=write_table_lines(list(chain(*given["phi"])), real),
            spring_lines=write_table_lines(given["h"][0], real),
        ).splitlines()
    inputs = max(sum(port.size for port in spec.inputs if not port.shared) for spec in specs)
    outputs = max(sum(port.size * _BATCH_SAMPLES + _FENCE for port in spec.outputs) for spec in specs)
    return material.write(
        "c/selftest.c.jinja",
        tolerance=tolerance,
        negligible=repr(NEGLIGIBLE),
        floor=repr(FLOOR),
        untouched=write_literal(_UNTOUCHED, real),
        samples=_BATCH_SAMPLES,
        fence=_FENCE,
        sum_count=len(WEIGHTS),
        moduli=", ".join(str(modulus) for modulus, _ in WEIGHTS),
        steps=", ".join(str(step) for _, step in WEIGHTS),
        weights=" and ".join(f"m = {modulus}, s = {step}" for modulus, step in WEIGHTS),
        port_room=max(max(len(spec.inputs), len(spec.outputs)) for spec in specs),
        input_room=max(inputs * _BATCH_SAMPLES, 1),
        output_room=outputs,
        test_count=len(material.programs) + bool(state_lines),
        arrays=_list_arrays(material),
        tests=list(map(_describe_test, material.programs, material.references)),
        state_lines=state_lines,
        state_tests=["hysteresis"] if state_lines else [],
    )


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
    names = ", then ".join("IA" if name == "rotor" else name for name in vectors)
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
        "usage_lines": [f"Usage: control_loop [FILE]    {file}", f"for example. Without it {without}."],
        "parameter_lines": [*defines, *text.rstrip("\n").split("\n"), ""],
        "reading_lines": [
            "if (count > 1 ? !read_parameters(arguments[1]) : !KNOWN) {",
            f'    fprintf(stderr, "usage: control_loop FILE    FILE: %d numbers, {names}\\n", PARAMETERS);',
            "    return 2;",
            "}",
        ],
        "arguments": "int count, char **arguments",
    }


def _write_control_loop(material: Material) -> str | None:
    """Return the text of the example, None if the library lacks a function that it calls."""
    card = material.card
    torques = "elastic_inverse_dynamics" if card.springs else "inverse_dynamics"
    wanted = {torques, "forward_dynamics", *(["friction"] if card.friction else [])}
    if not wanted <= {spec.name for spec in card.functions} or (card.springs and not material.stops):
        return None
    taken = {port.name for spec in card.functions for port in spec.inputs}
    # Parameters that the functions take, by their names in the program.
    vectors = {"beta": card.beta} if card.vector in taken else {}
    vectors |= {"rotor": card.rotors} if "IA" in taken and card.springs else {}
    vectors |= {"f": card.friction} if "f" in taken else {}
    vectors |= {"h": card.springs} if "h" in taken and card.springs else {}
    return (_write_elastic_loop if card.springs else _write_rigid_loop)(material, vectors)


_Vectors = Mapping[str, tuple[ParameterCard, ...]]


def _write_rigid_loop(material: Material, vectors: _Vectors) -> str:
    real = material.options.precision
    suffix = "f" if real == "float" else ""
    arrays = ("q", "dq", "qd", "dqd", "ddqd")

    def apply_friction(velocity: str, target: str) -> tuple[str, ...]:
        if not material.card.friction:
            return ()
        call = f"{material.prefix}_friction({velocity}, {'f, ' if 'f' in vectors else ''}friction)"
        loop = "for (size_t j = 0; j < JOINTS; ++j) {"
        start = (f"{real} friction[JOINTS];", f"if ({call} != 0) {{", "    return 1;", "}")
        return (*start, loop, f"    {target};", "}")

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
        feed_forward=apply_friction("dqd", "tau[j] += friction[j]"),
        plant_friction=apply_friction("dq", "rigid[j] -= friction[j]"),
    )


def _write_elastic_loop(material: Material, vectors: _Vectors) -> str:
    card, real = material.card, material.options.precision
    numbers = {"kp": 2500.0, "kd": 70.0, "period": 0.001, "substep": 0.000025, "amplitude": 0.1}
    numbers |= {"frequency": 2.0, "one": 1.0, "two": 2.0, "four": 4.0}
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
    friction = f"status += {material.prefix}_friction(robot->dtheta, {given}friction);"
    return material.write(
        "c/elastic_loop.c.jinja",
        **parameters,
        beta="beta, " if "beta" in vectors else "",
        constants="".join(f"{name}, " for name in vectors if name != "h"),
        plant_friction=[friction] if card.friction else [],
        zero=f"{{{write_literal(0.0, real)}}}",
        sine=f"sin{suffix}",
        cosine=f"cos{suffix}",
        **{name: write_literal(value, real) for name, value in numbers.items()},
    )


def _write_sources(material: Material) -> list[tuple[str, str]]:
    prefix, real = material.prefix, material.options.precision
    written = ((program.spec.name, _write_function(material, program)) for program in material.programs)
    functions = [(f"{prefix}_{name}.c", text) for name, text in written]
    if material.stops:
        functions.append((f"{prefix}_hysteresis.c", material.write("c/hysteresis.c.jinja")))
    headers = [(f"{prefix}.h", _write_header(material))]
    if material.options.friction_laws:
        laws = tuple(FRICTION_LAWS.values())
        header, source = generate_friction_laws(laws, prefix=prefix, precision=real)
        headers.append(header)
        functions.append(source)
    if any(f'"{prefix}{_SIMD_HEADER}"' in text for _, text in functions):
        headers.append((f"{prefix}{_SIMD_HEADER}", write_simd_header(prefix.upper(), real)))
    digest = compute_build_digest(
        material.card,
        prefix=prefix,
        precision=real,
        files={path: compute_digest(text.encode()) for path, text in (*headers, *functions)},
    )
    # In this order an update moves them in: a folder with a new function has the new digest.
    return [*headers, (f"{prefix}_info.c", material.write("c/info.c.jinja", digest=digest)), *functions]


def _write_build_files(
    material: Material, written: tuple[str, ...], programs: tuple[str, ...]
) -> list[tuple[str, str]]:
    prefix = material.prefix
    sources = tuple(path for path in written if path.endswith(".c"))
    headers = [path for path in written if path.endswith(".h")]
    public = " ".join(path for path in headers if path != f"{prefix}{_SIMD_HEADER}")
    # CMake knows numbers alone: 1.2.3.dev4 is 1.2.3.
    numbers = re.match(r"\d+(\.\d+)*", __version__)
    version = numbers.group() if numbers else "0"
    make = material.write(
        "c/Makefile.jinja",
        objects=" ".join(source.removesuffix(".c") + ".o" for source in sources),
        headers=" ".join(headers),
        example_target="".join(f" {program}" for program in programs[1:]),
    )
    cmake = material.write(
        "c/CMakeLists.txt.jinja", cmake_version=version, headers=public, sources=sources, programs=programs
    )
    package = material.write("c/package.pc.in.jinja", cmake_version=version)
    return [("Makefile", make), ("CMakeLists.txt", cmake), (f"{prefix}.pc.in", package)]


def generate_c_library(functions: Functions, options: GenerateOptions | None = None) -> SourceSet:
    """Return the files of a C library that computes `functions`.

    Raises:
        GenerationError: a function holds an operation without a C form, or disagrees with itself.
    """
    material = prepare_material(functions, options or GenerateOptions())
    tolerance = _TOLERANCES[material.options.precision]
    sources = _write_sources(material)
    programs = [("selftest", _write_self_test(material, tolerance))]
    example = _write_control_loop(material)
    if example is not None:
        programs.append(("control_loop", example))
    rows = [
        f"{program.spec.name} | {count.mul} | {count.add} | {count.trig}"
        for program, count in zip(material.programs, material.operations, strict=True)
    ]
    names = tuple(path for path, _ in sources)
    files = [
        *sources,
        *((f"{name}.c", text) for name, text in programs),
        *_write_build_files(material, names, tuple(name for name, _ in programs)),
        ("README.md", material.write("c/README.md.jinja", tolerance=tolerance, rows=rows)),
    ]
    manifest = write_manifest(material, "c", files)
    return SourceSet(name=material.prefix, files=tuple(files), manifest=manifest)
