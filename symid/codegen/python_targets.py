"""What interpreters load: modules of NumPy and JavaScript, CasADi functions with their loader or compiled.

The NumPy module needs NumPy alone: one sample, or any number of leading axes. The
JavaScript module runs in browsers and Node: one sample, arrays row by row. The CasADi target holds all
functions as .casadi files and in CasADi's own C, a module that loads either, and Jacobians in C of the
functions that equations of motion are made of.

A compiled CasADi function is the generated C of one function, with a Jacobian that calls the generated C of
its derivatives: `casadi.external` finds NAME and jac_NAME in one shared library. Derivatives by parameters
are regressors: dtau/dbeta = Y, dddq/dbeta = -M^-1 Y.

Not supported: float; Jacobians in C of regressors, of the Coriolis matrix and of derivatives, which would
be most of the code; .casadi files have them.
"""

import json
import logging
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path

import casadi as ca

from symid.codegen.c_library import generate_c_library
from symid.codegen.cache import CacheEntry, compute_library_key, obtain_entry
from symid.codegen.casadi_functions import Functions, build_functions, get_matrix_shape
from symid.codegen.compiler import compile_sources, locate_compiler
from symid.codegen.functions import FunctionSpec, Port
from symid.codegen.material import BANNER, Fields, Material, prepare_material, write_operations
from symid.codegen.printing import print_javascript, print_python
from symid.codegen.programs import Operations, Program
from symid.codegen.references import PER_UNIT, TOLERANCES, WEIGHTS, ReferenceRows
from symid.codegen.source_folder import SourceSet, write_sources
from symid.codegen.source_text import build_library_prefix, write_template
from symid.errors import GenerationError, Notice, UsageError
from symid.options import GenerateOptions
from symid.robot import Robot
from symid.serialization import compute_signature

_LOG = logging.getLogger(__name__)


def _write_module(material: Material, template: str, **values: object) -> str:
    """Return a template of a Python module, with the tables of its self-test."""

    def write(rows: ReferenceRows) -> str:
        return f"np.array({[list(row) for row in rows]!r})"

    # Every input that a function is given, once; functions use it by its name and size.
    states: dict[str, Fields] = {}
    tests = []
    for program, reference in zip(material.programs, material.references, strict=True):
        for port, name, rows in zip(program.spec.inputs, reference.tables, reference.inputs, strict=True):
            lines = [repr(list(rows[0]))]
            if not port.shared:
                whole = ([round(value * PER_UNIT) for value in row] for row in rows)
                lines = ["[", *(f"    {row!r}," for row in whole), "]"]
            states.setdefault(name, {"name": name, "shared": port.shared, "lines": lines})
        tables = zip(reference.whole, reference.sums, reference.scales, strict=True)
        outputs = [f"({write(first)}, {write(sums)}, {scale!r})" for first, sums, scale in tables]
        tests.append({"name": program.spec.name, "inputs": repr(reference.tables), "outputs": outputs})
    return material.write(
        template,
        tolerance=TOLERANCES["double"],
        weights=repr(WEIGHTS),
        elastic_lines=[line.replace("  ", "    ", 1) for line in material.elastic_lines],
        states=list(states.values()),
        tests=tests,
        **values,
    )


def _describe_array_port(port: Port) -> str:
    inner = ", ".join(map(str, port.shape))
    shape = f"({inner},)" if port.shared and len(port.shape) == 1 else f"(..., {inner})"
    return f"{port.name}: {shape} {port.meaning}, {port.unit}"


def _describe_function(program: Program, count: Operations) -> Fields:
    spec = program.spec
    prepared = [f'{port.name} = _prepare("{port.name}", {port.name}, {port.shape!r})' for port in spec.inputs]
    samples = [f"{port.name}.shape[:-{len(port.shape)}]" for port in spec.inputs if not port.shared]
    allocated = [
        f"{port.name} = np.zeros((*samples, {', '.join(map(str, port.shape))}))" for port in spec.outputs
    ]
    shapes = f"samples = np.broadcast_shapes({', '.join(samples)})"
    return {
        "name": spec.name,
        "meaning": spec.meaning,
        "arguments": ", ".join(port.name for port in spec.inputs),
        "inputs": list(map(_describe_array_port, spec.inputs)),
        "outputs": list(map(_describe_array_port, spec.outputs)),
        "operations": write_operations(count),
        "statements": [*prepared, shapes, *allocated, *print_python(program)],
        "returns": ", ".join(port.name for port in spec.outputs),
    }


def _write_state_class(material: Material) -> list[str]:
    """Return the class of friction that remembers; nothing without."""
    if not material.bristles:
        return []
    spec = next(spec for spec in material.card.functions if spec.name == "friction_step")
    given = [f", {port.name}" for port in spec.inputs if port.name not in {"dq", "way", "z"}]
    return material.write("python/friction_state.py.jinja", given="".join(given)).splitlines()


def generate_python_module(functions: Functions, options: GenerateOptions | None = None) -> SourceSet:
    """Return a NumPy module that computes `functions`, with its README and manifest.

    Raises:
        GenerationError: a function holds an operation without a NumPy form, or disagrees with itself.
    """
    material = prepare_material(functions, options or GenerateOptions())
    names = [program.spec.name for program in material.programs]
    names += ["FrictionState"] if material.bristles else []
    module = _write_module(
        material,
        "python/module.py.jinja",
        names=", ".join(f'"{name}"' for name in names),
        state_lines=_write_state_class(material),
        functions=list(map(_describe_function, material.programs, material.operations)),
    )
    files = ((f"{material.prefix}.py", module), ("README.md", material.write("python/README.md.jinja")))
    return material.collect("python", files)


def write_javascript_function(program: Program, *, exported: bool = True) -> list[str]:
    """Return a JavaScript function, its comment with shapes and units before it."""
    spec = program.spec
    lines = [f"/** Return the {spec.meaning}.", " *"]
    lines += [f" * @param {port.name} {_describe_flat_port(port)}" for port in spec.inputs]
    lines += [f" * returns {port.name} {_describe_flat_port(port)}" for port in spec.outputs]
    lines.append(" */")
    head = f"function {spec.name}({', '.join(port.name for port in spec.inputs)}) {{"
    lines.append(f"export {head}" if exported else head)
    lines += [f"  const {port.name} = new Float64Array({port.size});" for port in spec.outputs]
    lines += [f"  {line}" for line in print_javascript(program)]
    names = ", ".join(port.name for port in spec.outputs)
    lines.append(f"  return {names if len(spec.outputs) == 1 else f'{{ {names} }}'};")
    return [*lines, "}"]


def _describe_flat_port(port: Port) -> str:
    return f"{' x '.join(map(str, port.shape))}, {port.meaning}, {port.unit}"


def generate_javascript_module(functions: Functions, options: GenerateOptions | None = None) -> SourceSet:
    """Return an ES module that computes `functions`, with its self-test for Node, README and manifest.

    Raises:
        GenerationError: a function disagrees with itself.
    """
    material = prepare_material(functions, options or GenerateOptions())
    inputs: dict[str, Fields] = {}
    tests = []
    for program, reference in zip(material.programs, material.references, strict=True):
        for port, name, rows in zip(program.spec.inputs, reference.tables, reference.inputs, strict=True):
            values = [list(row) for row in rows] if not port.shared else list(rows[0])
            inputs.setdefault(name, {"name": name, "rows": json.dumps(values)})
        tables = zip(reference.whole, reference.sums, reference.scales, strict=True)
        outputs = [
            json.dumps([[list(row) for row in rows] for rows in pair] + [scale]) for *pair, scale in tables
        ]
        names = [port.name for port in program.spec.outputs]
        tests.append(
            {
                "name": program.spec.name,
                "inputs": json.dumps(
                    [
                        [name, port.shared]
                        for name, port in zip(reference.tables, program.spec.inputs, strict=True)
                    ]
                ),
                "outputs": json.dumps(names),
                "references": outputs,
            }
        )
    module = material.write(
        "javascript/module.mjs.jinja",
        functions=["\n".join(write_javascript_function(program)) for program in material.programs],
    )
    selftest = material.write(
        "javascript/selftest.mjs.jinja",
        weights=json.dumps(WEIGHTS),
        tolerance=TOLERANCES["double"],
        inputs=list(inputs.values()),
        tests=tests,
    )
    readme = material.write("javascript/README.md.jinja", example=material.card.functions[0].name)
    files = ((f"{material.prefix}.mjs", module), ("selftest.mjs", selftest), ("README.md", readme))
    return material.collect("js", files)


# Derivatives of the forward dynamics amplify rounding errors by the square of what the dynamics do.
_JACOBIAN_TOLERANCE = "1e-10"
_JACOBIANS = (
    *("forward_kinematics", "jacobian", "mass_matrix", "gravity", "bias", "energy", "friction"),
    *("inverse_dynamics", "forward_dynamics", "hysteresis_step", "hysteresis_inverse_step"),
    "elastic_inverse_dynamics",
)
# What the compiled plants call.
_PLANT_FUNCTIONS = ("forward_dynamics", "mass_matrix", "bias", "friction", "friction_step")


def list_casadi_sources(prefix: str) -> tuple[str, str]:
    """Return the C files that a library without Jacobians is made of."""
    return f"{prefix}_casadi.c", f"{prefix}_info.c"


def _write_c(name: str, functions: Sequence[ca.Function]) -> str:
    generator = ca.CodeGenerator(name)
    for function in functions:
        generator.add(function)
    return f"/* {BANNER} */\n{generator.dump()}"


def _write_c_files(material: Material, functions: Sequence[ca.Function]) -> list[tuple[str, str]]:
    plain, info = list_casadi_sources(material.prefix)
    jacobians = f"{material.prefix}_casadi_jacobians.c"
    derived = [function.jacobian() for function in functions if function.name() in _JACOBIANS]
    files = [(plain, _write_c(plain, functions))]
    files += [(jacobians, _write_c(jacobians, derived))] if derived else []
    digest = material.compute_digest("casadi", files)
    # As plain C has them, a pointer for each input and output.
    calls: list[Fields] = []
    for spec in material.card.functions:
        if spec.name in _PLANT_FUNCTIONS:
            inputs, outputs = ([port.name for port in ports] for ports in (spec.inputs, spec.outputs))
            given = [*(f"const double *{name}" for name in inputs), *(f"double *{name}" for name in outputs)]
            texts = {"arguments": given, "inputs": inputs, "outputs": outputs}
            calls.append({"name": spec.name, **{key: ", ".join(names) for key, names in texts.items()}})
    return [*files, (info, material.write("casadi/info.c.jinja", digest=digest, calls=calls))]


def generate_casadi_target(functions: Functions, options: GenerateOptions | None = None) -> SourceSet:
    """Return the files that users of CasADi take: functions, C, loader with self-test, README, manifest.

    The bytes depend on the version of CasADi, which fixes the format of its files.

    Raises:
        GenerationError: a function disagrees with itself.
    """
    material = prepare_material(functions, options or GenerateOptions())
    prefix = material.prefix

    def describe(ports: Sequence[Port]) -> list[str]:
        return [repr((port.name, get_matrix_shape(port), port.unit, port.meaning)) for port in ports]

    sources = _write_c_files(material, functions.functions)
    objects = " ".join(f"{path.removesuffix('.c')}.o" for path, _ in sources)
    version, example = ca.CasadiMeta.version(), material.card.functions[0].name
    readme = material.write("casadi/README.md.jinja", casadi=version, example=example)
    loader = _write_module(
        material,
        "casadi/loader.py.jinja",
        jacobian_tolerance=_JACOBIAN_TOLERANCE,
        functions=[
            {
                "name": spec.name,
                "meaning": spec.meaning,
                "inputs": describe(spec.inputs),
                "outputs": describe(spec.outputs),
                "jacobian": spec.name in _JACOBIANS,
            }
            for spec in material.card.functions
        ],
    )
    serialized = []
    for function in functions.functions:
        # What Function.load reads; Function.serialize leaves out the word that a function follows.
        serializer = ca.StringSerializer()
        serializer.pack(function)
        serialized.append((f"{function.name()}.casadi", f"{serializer.encode()}\n"))
    files = (
        *serialized,
        *sources,
        (f"{prefix}_casadi.py", loader),
        ("Makefile", material.write("casadi/Makefile.jinja", objects=objects)),
        ("README.md", readme),
    )
    return material.collect("casadi", files)


COMPILED = ("inverse_dynamics", "forward_dynamics")
"""Functions that `build_compiled_function` offers: those with a generated derivative."""


def _write_jacobian(
    prefix: str, spec: FunctionSpec, known: Mapping[str, FunctionSpec]
) -> tuple[list[str], int]:
    """Return the statements that fill the blocks of the Jacobian, one an input, and the numbers they need."""
    n, count = spec.outputs[0].size, len(spec.inputs)
    blocks = known[f"{spec.name}_derivatives"].outputs
    forward = len(blocks) > 3
    places, work = [], 0
    for port in blocks:
        places.append(f"w + {work}")
        work += port.size
    given = [f"take(arg[{k}])" for k in range(count)]
    matrices = places[1:] if forward else places
    lines = [
        f"if ({prefix}_{spec.name}_derivatives({', '.join((*given, *places))}) != 0) {{",
        "    return 1;",
        "}",
    ]
    lines += [f"give(res[{k}], {place}, {n}, {n}, 1.0);" for k, place in enumerate(matrices)]
    if count > 3:
        # By the parameters: the regressor, of forward dynamics at the acceleration that was found.
        columns, regressor = spec.inputs[3].size, f"w + {work}"
        motion = [*given[:2], places[0] if forward else given[2]]
        work += n * columns
        lines += ["if (res[3] != NULL) {"]
        lines += [
            f"    if ({prefix}_torque_regressor({', '.join((*motion, regressor))}) != 0) {{",
            "        return 1;",
            "    }",
        ]
        target = regressor
        if forward:
            target, inverse = f"w + {work}", places[3]
            work += n * columns
            lines += [
                f"    for (int i = 0; i < {n}; ++i) {{",
                f"        for (int j = 0; j < {columns}; ++j) {{",
                "            double sum = 0.0;",
                f"            for (int k = 0; k < {n}; ++k) {{",
                f"                sum -= ({inverse})[{n} * i + k] * ({regressor})[{columns} * k + j];",
                "            }",
                f"            ({target})[{columns} * i + j] = sum;",
                "        }",
                "    }",
            ]
        lines += [f"    give(res[3], {target}, {n}, {columns}, 1.0);", "}"]
    return lines, work


def write_external(functions: Functions, name: str) -> str:
    """Return the C file that makes the generated C of `name` an external function of CasADi.

    `functions` holds it, its derivatives and, where parameters are arguments, the torque regressor.
    """
    known = {spec.name: spec for spec in functions.card.functions}
    spec, prefix = known[name], build_library_prefix(functions.card.robot)
    lines, work = _write_jacobian(prefix, spec, known)
    (output,) = spec.outputs

    def describe(label: str, rows: int, columns: int) -> Fields:
        return {"name": f'"{label}"', "pattern": f"{{ {rows}, {columns}, 1 }}"}

    inputs = [describe(port.name, port.size, 1) for port in spec.inputs]
    outputs = [describe(f"jac_{output.name}_{port.name}", output.size, port.size) for port in spec.inputs]
    value = describe(output.name, output.size, 1)
    also = describe(f"out_{output.name}", output.size, 1)
    return write_template(
        "casadi/external.c.jinja",
        {"banner": BANNER, "prefix": prefix},
        name=name,
        functions=[
            {"name": name, "inputs": inputs, "outputs": [value]},
            {"name": f"jac_{name}", "inputs": [*inputs, also], "outputs": outputs},
        ],
        inputs=", ".join(f"take(arg[{k}])" for k in range(len(inputs))),
        size=output.size,
        lines=lines,
        longest=max(port.size for port in spec.inputs),
        work=max(work, output.size),
    )


def build_compiled_function(
    robot: Robot, name: str, *, standard: bool = False, constant: bool = False, cache: Path | None = None
) -> ca.Function:
    """Return a function of `COMPILED` as an external one of CasADi that calls the generated C.

    Its first derivatives are the generated C of the derivatives; it has no second ones. The library is taken
    from the cache, or made now; what was wrong with the cache is logged. Other arguments and errors are those
    of `build_functions`.

    Raises:
        GenerationError: there is no C compiler, or it fails.
        OutputError: the folder `cache` cannot be written.
        UsageError: the function has no generated derivative.
    """
    if name not in COMPILED:
        text = f"compiled: function {name!r} has no generated derivative; there are {', '.join(COMPILED)}"
        raise UsageError(Notice(code="usage.not-compiled", text=text))
    compiler = locate_compiler(native=True)
    if compiler is None:
        text = "compiled: no C compiler answers (cc, gcc, clang); without one, take the function as it is"
        raise GenerationError(Notice(code="codegen.no-compiler", text=text))
    names = (name, f"{name}_derivatives", *(() if constant else ("torque_regressor",)))
    options = (standard, constant)

    def make(folder: Path) -> None:
        functions = build_functions(robot, names=names, standard=standard, constant=constant)
        prefix = build_library_prefix(functions.card.robot)
        paths = write_sources(generate_c_library(functions), folder)
        glue = folder / f"{prefix}_external.c"
        glue.write_text(write_external(functions, name), encoding="utf-8")
        sources = [path for path in paths if path.suffix == ".c" and path.name.startswith(f"{prefix}_")]
        compile_sources(compiler, [*sources, glue], folder / f"{name}.so")

    entry = CacheEntry(
        name=f"external-{name}",
        key=compute_signature(compute_library_key(robot, names, compiler), options, platform.machine()),
        make=make,
        load=lambda folder: ca.external(name, str(folder / f"{name}.so")),
    )
    found, notices = obtain_entry(entry, cache)
    for notice in notices:
        _LOG.warning("%s", notice)
    return found
