"""A C99 library that stands alone: header, one file a function, self-test, example, build files.

Input: `Functions`: programs with their model card. Output: `SourceSet`.

Functions -> programs and reference values -> contexts -> templates -> sources.

Supported: double and float; one sample and batches.
Not supported: compilers without C99 arrays of stated size (of Microsoft's, use clang-cl).
"""

import re

from symid import __version__
from symid.codegen.build_digest import find_build_digest
from symid.codegen.c_checks import TOLERANCES, build_self_test
from symid.codegen.c_contexts import (
    CMakeContext,
    FunctionContext,
    HeaderContext,
    HeaderFunction,
    InfoContext,
    MakefileContext,
    PackageContext,
    ReadmeContext,
)
from symid.codegen.c_helpers import write_helper
from symid.codegen.c_loops import write_control_loop
from symid.codegen.c_state import write_state_header, write_state_source
from symid.codegen.casadi_functions import Functions
from symid.codegen.describe import BANNER, Material, prepare_material, write_manifest, write_operations
from symid.codegen.friction_c import generate_friction_laws
from symid.codegen.functions import FunctionSpec, Port
from symid.codegen.instructions import Operations, Program
from symid.codegen.lanes import write_lanes
from symid.codegen.options import GenerateOptions
from symid.codegen.printing_c import print_c, print_lanes
from symid.codegen.templates import write_template
from symid.codegen.writer import SourceSet, find_digest
from symid.joint.friction_laws import FRICTION_LAWS

__all__ = ["generate_c_library"]

_LANES = "_lanes.h"
"""End of the name of the header that is not installed."""


def _find_macro(material: Material) -> str:
    return material.prefix.upper()


def _declare(spec: FunctionSpec, real: str, *, restrict: bool) -> str:
    mark = "restrict " if restrict else ""
    inputs = [f"const {real} {port.name}[{mark}{max(port.size, 1)}]" for port in spec.inputs]
    return ", ".join(inputs + [f"{real} {port.name}[{mark}{max(port.size, 1)}]" for port in spec.outputs])


def _declare_batch(spec: FunctionSpec, real: str, *, restrict: bool) -> str:
    mark = "restrict " if restrict else ""

    def declare(port: Port) -> str:
        if port.shared:
            return f"const {real} {port.name}[{mark}{max(port.size, 1)}]"
        return f"const {real} *{mark}{port.name}"

    outputs = [f"{real} *{mark}{port.name}" for port in spec.outputs]
    return ", ".join(["size_t n", *map(declare, spec.inputs), *outputs])


def _describe_port(port: Port, direction: str) -> str:
    shape = " x ".join(map(str, port.shape))
    note = "; one vector for all samples" if port.shared else ""
    return f"[{direction}] {port.name} {port.meaning}: {shape}, {port.unit}{note}"


def _describe_function(program: Program, count: Operations, real: str) -> HeaderFunction:
    spec = program.spec
    described = [_describe_port(port, "in") for port in spec.inputs]
    return HeaderFunction(
        name=spec.name,
        meaning=spec.meaning,
        parameters=tuple(described + [_describe_port(port, "out") for port in spec.outputs]),
        operations=write_operations(count),
        declaration=_declare(spec, real, restrict=False),
        batch_declaration=_declare_batch(spec, real, restrict=False),
    )


def _write_header(material: Material) -> str:
    card, real = material.card, material.options.precision
    described = zip(material.programs, material.operations, strict=True)
    context = HeaderContext(
        banner=BANNER,
        prefix=material.prefix,
        macro=_find_macro(material),
        robot=material.robot,
        extent=material.extent,
        joint_count=card.size,
        link_count=card.links,
        beta_count=len(card.beta),
        beta_macro=card.vector.upper(),
        beta_title=material.beta_title,
        friction_count=len(card.friction),
        joint_lines=material.joint_lines,
        beta_lines=material.beta_lines,
        friction_lines=material.friction_lines,
        elastic_lines=tuple(f" {line}".rstrip() for line in material.elastic_lines),
        functions=tuple(_describe_function(program, count, real) for program, count in described),
        state_lines=write_state_header(material),
    )
    return write_template("c/header.h.jinja", context)


def _find_includes(prefix: str, statements: tuple[str, ...], lanes: tuple[str, ...]) -> tuple[str, ...]:
    lines: list[str] = []
    text = "\n".join(statements)
    if lanes or "find_sines(" in text:
        lines.append(f'#include "{prefix}{_LANES}"')
    if re.search(r"\b(sin|cos|tan|sqrt|exp|tanh|pow|fabs)f?\(", text):
        lines += ["", "#include <math.h>"]
    return tuple(lines)


def _write_lane_loop(macro: str, statements: tuple[str, ...]) -> tuple[str, ...]:
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
    lanes = print_lanes(program, real) if own else ()
    ports = (*spec.inputs, *spec.outputs)
    helpers = tuple(write_helper(name, real) for name in body.helpers)
    context = FunctionContext(
        banner=BANNER,
        prefix=material.prefix,
        macro=_find_macro(material),
        name=spec.name,
        includes=_find_includes(material.prefix, body.statements, lanes),
        helpers=helpers,
        definition=_declare(spec, real, restrict=True),
        batch_definition=_declare_batch(spec, real, restrict=True),
        null_test=" || ".join(f"{port.name} == NULL" for port in ports),
        statements=body.statements,
        lane_lines=_write_lane_loop(_find_macro(material), lanes),
        call=", ".join(port.name if port.shared else f"{port.name} + {port.size} * k" for port in ports),
    )
    return write_template("c/function.c.jinja", context)


def _write_sources(material: Material) -> list[tuple[str, str]]:
    prefix = material.prefix
    written = ((program.spec.name, _write_function(material, program)) for program in material.programs)
    functions = [(f"{prefix}_{name}.c", text) for name, text in written]
    functions += write_state_source(material)
    laws = _write_friction_laws(material)
    functions += [(path, text) for path, text in laws if path.endswith(".c")]
    header = (f"{prefix}.h", _write_header(material))
    wanted = any(f'"{prefix}{_LANES}"' in text for _, text in functions)
    lanes = write_lanes(_find_macro(material), material.options.precision) if wanted else ""
    headers = [(path, text) for path, text in laws if path.endswith(".h")]
    headers += [(f"{prefix}{_LANES}", lanes)] if wanted else []
    info = InfoContext(
        banner=BANNER,
        prefix=prefix,
        version=__version__,
        signature=material.card.signature,
        digest=find_build_digest(
            material.card,
            prefix=prefix,
            precision=material.options.precision,
            files={path: find_digest(text.encode()) for path, text in (header, *headers, *functions)},
        ),
    )
    # In the order in which an update moves them in: a folder that holds a new function holds the new digest.
    return [header, *headers, (f"{prefix}_info.c", write_template("c/info.c.jinja", info)), *functions]


def _write_friction_laws(material: Material) -> tuple[tuple[str, str], ...]:
    if not material.options.friction_laws:
        return ()
    laws = tuple(FRICTION_LAWS.values())
    return generate_friction_laws(laws, prefix=material.prefix, precision=material.options.precision)


def _write_build_files(
    material: Material, written: tuple[str, ...], programs: tuple[str, ...]
) -> list[tuple[str, str]]:
    prefix = material.prefix
    sources = tuple(path for path in written if path.endswith(".c"))
    headers = [path for path in written if path.endswith(".h")]
    public = " ".join(path for path in headers if path != f"{prefix}{_LANES}")
    # CMake knows numbers alone: 1.2.3.dev4 is 1.2.3.
    numbers = re.match(r"\d+(\.\d+)*", __version__)
    version = numbers.group() if numbers else "0"
    make = MakefileContext(
        banner=BANNER,
        prefix=prefix,
        objects=" ".join(source.removesuffix(".c") + ".o" for source in sources),
        headers=" ".join(headers),
        example_target="".join(f" {program}" for program in programs[1:]),
    )
    cmake = CMakeContext(
        banner=BANNER,
        prefix=prefix,
        cmake_version=version,
        headers=public,
        sources=sources,
        programs=programs,
    )
    package = PackageContext(prefix=prefix, robot=material.robot, cmake_version=version)
    return [
        ("Makefile", write_template("c/Makefile.jinja", make)),
        ("CMakeLists.txt", write_template("c/CMakeLists.txt.jinja", cmake)),
        (f"{prefix}.pc.in", write_template("c/package.pc.in.jinja", package)),
    ]


def _write_readme(material: Material, tolerance: str) -> str:
    rows = (
        f"{program.spec.name} | {count.mul} | {count.add} | {count.trig}"
        for program, count in zip(material.programs, material.operations, strict=True)
    )
    context = ReadmeContext(
        prefix=material.prefix,
        robot=material.robot,
        real=material.options.precision,
        version=__version__,
        tolerance=tolerance,
        rows=tuple(rows),
    )
    return write_template("c/README.md.jinja", context)


def generate_c_library(functions: Functions, options: GenerateOptions | None = None) -> SourceSet:
    """Return the files of a C library that computes `functions`.

    Raises:
        GenerationError: a function holds an operation without a C form, or disagrees with itself.
    """
    material = prepare_material(functions, options or GenerateOptions())
    tolerance = TOLERANCES[material.options.precision]
    sources = _write_sources(material)
    programs = [("selftest", write_template("c/selftest.c.jinja", build_self_test(material, tolerance)))]
    example = write_control_loop(material)
    if example is not None:
        programs.append(("control_loop", example))
    names = tuple(path for path, _ in sources)
    files = [
        *sources,
        *((f"{name}.c", text) for name, text in programs),
        *_write_build_files(material, names, tuple(name for name, _ in programs)),
        ("README.md", _write_readme(material, tolerance)),
    ]
    manifest = write_manifest(material, "c", files)
    return SourceSet(name=material.prefix, files=tuple(files), manifest=manifest)
