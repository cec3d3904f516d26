"""A C99 library that stands alone: header, one file a function, self-test, example, build files.

Functions -> programs and reference values -> templates -> `SourceSet`.

A private header has numbers side by side (SIMD), and sine and cosine of several angles at once:

    x -> n = round(2 x / pi), r = x - n pi/2;  sin r = r + r^3 S(r^2);  cos r = 1 - r^2/2 + r^4 C(r^2).

S and C are minimax polynomials on |r| <= pi/4 (Remez 1934), found in 60 digits with the relative error of
sin r and cos r as weight, and rounded one coefficient after another, the others fitted again each time. In
exact arithmetic they err by less than 2^-57 (double) and 2^-27 (float).

Supported: double and float; one sample and batches; compilers with vector types of GCC, and C99 without.
Not supported: compilers without C99 arrays of stated size (of Microsoft's, use clang-cl); the extension
module by which Python calls the library (see `calls`), for float.
"""

import re
from dataclasses import dataclass

from symid import __version__
from symid.codegen.c_friction import generate_friction_laws
from symid.codegen.c_programs import (
    TOLERANCES,
    write_control_loop,
    write_self_test,
    write_state_header,
    write_state_source,
)
from symid.codegen.casadi_functions import Functions
from symid.codegen.functions import FunctionSpec, ModelCard, Port
from symid.codegen.library import compute_build_digest
from symid.codegen.material import BANNER, Material, prepare_material, write_manifest, write_operations
from symid.codegen.printing import print_c, print_simd, write_c_helper, write_literal
from symid.codegen.programs import Operations, Program
from symid.codegen.source_folder import SourceSet, compute_digest
from symid.codegen.source_text import GenerateOptions, write_template
from symid.joint_models import FRICTION_LAWS

Fields = dict[str, object]
"""One entry of a list in a template."""


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


def _write_polynomial(coefficients: tuple[float, ...], precision: str) -> str:
    """Return the text of the polynomial in z, w = z z: pairs, so that few sums wait for each other."""
    texts = [f"ALL({write_literal(value, precision)})" for value in coefficients]
    pairs = [
        f"({texts[k]} + z * {texts[k + 1]})" if k + 1 < len(texts) else texts[k]
        for k in range(0, len(texts), 2)
    ]
    whole = pairs.pop()
    for pair in reversed(pairs):
        whole = f"({pair} + w * {whole})"
    return whole


def _write_reduction(kind: _NumberKind, precision: str) -> str:
    text = "x"
    for part in kind.parts:
        text = f"({text} - n * ALL({write_literal(part, precision)}))"
    return text[1:-1]


def _write_polynomials(kind: _NumberKind, precision: str) -> tuple[str, ...]:
    one, half = (f"ALL({write_literal(value, precision)})" for value in (1.0, 0.5))
    return (
        "const lanes w = z * z;",
        f"const lanes a = r + (r * z) * {_write_polynomial(kind.sine, precision)};",
        f"const lanes b = ({one} - {half} * z) + w * {_write_polynomial(kind.cosine, precision)};",
    )


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


def _write_block_store(width: int) -> tuple[str, ...]:
    return tuple(line for first in range(0, 8, width) for line in _write_transposition(width, first))


def write_simd_header(macro: str, precision: str) -> str:
    """Return the header for a library whose macros begin with `macro`."""
    kind = _NUMBER_KINDS[precision]
    double = precision == "double"
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
        reduced=_write_reduction(kind, precision),
        polynomial_lines=_write_polynomials(kind, precision),
        sign_shift=kind.bits - 2,
        magnitude="0x7fffffffffffffff" if double else "0x7fffffff",
        eight_lines=_write_block_store(8),
        four_lines=_write_block_store(4),
        two_lines=_write_block_store(2),
    )


def _describe_call(spec: FunctionSpec) -> Fields:
    """Return the arguments out of one array of pointers, and what stands behind these."""
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
        state_lines=write_state_header(material),
    )


def _list_includes(prefix: str, statements: tuple[str, ...], lanes: tuple[str, ...]) -> tuple[str, ...]:
    lines: list[str] = []
    text = "\n".join(statements)
    if lanes or "find_sines(" in text:
        lines.append(f'#include "{prefix}{_SIMD_HEADER}"')
    if re.search(r"\b(sin|cos|tan|sqrt|exp|tanh|pow|fabs)f?\(", text):
        lines += ["", "#include <math.h>"]
    return tuple(lines)


def _write_simd_loop(macro: str, statements: tuple[str, ...]) -> tuple[str, ...]:
    """Return the loop over blocks of samples; where some are left over, the last block begins before them."""
    if not statements:
        return ()
    return (
        f"#if {macro}_LANES > 1",
        f"    if (n >= {macro}_LANES) {{",
        f"        for (size_t first = 0; first < n; first += {macro}_LANES) {{",
        f"            const size_t k = first <= n - {macro}_LANES ? first : n - {macro}_LANES;",
        *(f"            {line}" for line in statements),
        "        }",
        f"        return {macro}_OK;",
        "    }",
        "#endif",
    )


def _write_function(material: Material, program: Program) -> str:
    real, spec = material.options.precision, program.spec
    own = material.options.trigonometry == "own"
    body = print_c(program, real, together=own)
    lanes = print_simd(program, real) if own else ()
    ports = (*spec.inputs, *spec.outputs)
    return material.write(
        "c/function.c.jinja",
        name=spec.name,
        includes=_list_includes(material.prefix, body.statements, lanes),
        helpers=[write_c_helper(name, real) for name in body.helpers],
        definition=_declare(spec, real, restrict=True, batch=False),
        batch_definition=_declare(spec, real, restrict=True, batch=True),
        null_test=" || ".join(f"{port.name} == NULL" for port in ports),
        statements=body.statements,
        lane_lines=_write_simd_loop(material.prefix.upper(), lanes),
        call=", ".join(port.name if port.shared else f"{port.name} + {port.size} * k" for port in ports),
    )


def _write_sources(material: Material) -> list[tuple[str, str]]:
    prefix, real = material.prefix, material.options.precision
    written = ((program.spec.name, _write_function(material, program)) for program in material.programs)
    functions = [(f"{prefix}_{name}.c", text) for name, text in written]
    functions += write_state_source(material)
    laws: tuple[tuple[str, str], ...] = ()
    if material.options.friction_laws:
        laws = generate_friction_laws(tuple(FRICTION_LAWS.values()), prefix=prefix, precision=real)
    functions += [(path, text) for path, text in laws if path.endswith(".c")]
    headers = [(f"{prefix}.h", _write_header(material))]
    headers += [(path, text) for path, text in laws if path.endswith(".h")]
    if any(f'"{prefix}{_SIMD_HEADER}"' in text for _, text in functions):
        headers.append((f"{prefix}{_SIMD_HEADER}", write_simd_header(prefix.upper(), real)))
    digest = compute_build_digest(
        material.card,
        prefix=prefix,
        precision=real,
        files={path: compute_digest(text.encode()) for path, text in (*headers, *functions)},
    )
    # In the order in which an update moves them in: a folder that holds a new function holds the new digest.
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
    tolerance = TOLERANCES[material.options.precision]
    sources = _write_sources(material)
    programs = [("selftest", write_self_test(material, tolerance))]
    example = write_control_loop(material)
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
