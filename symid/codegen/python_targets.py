"""What interpreters load: modules of NumPy and JavaScript, CasADi functions with their loader.

The NumPy module needs NumPy alone: one sample, or any number of leading axes. The
JavaScript module runs in browsers and Node: one sample, arrays row by row. The CasADi target holds all
functions as .casadi files and in CasADi's own C, a module that loads either, and Jacobians in C of the
functions that equations of motion are made of.

Not supported: float; Jacobians in C of regressors, of the Coriolis matrix and of derivatives, which would
be most of the code; .casadi files have them.
"""

import json
from collections.abc import Sequence

import casadi as ca

from symid.codegen.casadi_functions import (
    Fields,
    Functions,
    Material,
    get_matrix_shape,
    prepare_material,
    write_operations,
)
from symid.codegen.functions import Port
from symid.codegen.printing import print_javascript, print_python
from symid.codegen.programs import Operations, Program
from symid.codegen.references import PER_UNIT, TOLERANCES, WEIGHTS, ReferenceRows
from symid.codegen.source_folder import SourceSet
from symid.codegen.source_text import BANNER, write_template
from symid.options import GenerateOptions

# Derivatives of the forward dynamics amplify rounding errors by the square of what the dynamics do.
_JACOBIAN_TOLERANCE = "1e-10"
_JACOBIANS = (
    *("forward_kinematics", "jacobian", "mass_matrix", "gravity", "bias", "energy", "friction"),
    *("inverse_dynamics", "forward_dynamics", "hysteresis_step", "hysteresis_inverse_step"),
    "elastic_inverse_dynamics",
)
# What the compiled plants call.
_PLANT_FUNCTIONS = ("forward_dynamics", "mass_matrix", "bias", "friction", "friction_step")


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
    samples = [f"{port.name}.shape[:-{len(port.shape)}]" for port in spec.inputs if not port.shared]
    return {
        "spec": spec,
        "inputs": list(map(_describe_array_port, spec.inputs)),
        "outputs": list(map(_describe_array_port, spec.outputs)),
        "operations": write_operations(count),
        "samples": ", ".join(samples),
        "statements": print_python(program),
    }


def generate_python_module(functions: Functions, options: GenerateOptions | None = None) -> SourceSet:
    """Return a NumPy module with README and manifest; a GenerationError as of `generate_c_library`."""
    material = prepare_material(functions, options or GenerateOptions())
    names, lines = [program.spec.name for program in material.programs], []
    if material.bristles:
        names.append("FrictionState")
        given = "".join(f", {port.name}" for port in material.list_given_ports())
        lines = material.write("python/friction_state.py.jinja", given=given).splitlines()
    module = _write_module(
        material,
        "python/module.py.jinja",
        names=", ".join(f'"{name}"' for name in names),
        state_lines=lines,
        functions=list(map(_describe_function, material.programs, material.operations)),
    )
    files = ((f"{material.prefix}.py", module), ("README.md", material.write("python/README.md.jinja")))
    return material.collect("python", files)


def write_javascript_function(program: Program, *, exported: bool = True) -> str:
    """Return a JavaScript function, its comment with shapes and units before it."""
    names = ", ".join(port.name for port in program.spec.outputs)
    return write_template(
        "javascript/function.mjs.jinja",
        {"spec": program.spec},
        head="export function" if exported else "function",
        statements=print_javascript(program),
        returned=names if len(program.spec.outputs) == 1 else f"{{ {names} }}",
    )


def generate_javascript_module(functions: Functions, options: GenerateOptions | None = None) -> SourceSet:
    """Return an ES module, self-test, README, manifest; a GenerationError if a function disagrees."""
    material = prepare_material(functions, options or GenerateOptions())
    inputs: dict[str, Fields] = {}
    tests = []
    for program, reference in zip(material.programs, material.references, strict=True):
        for port, name, rows in zip(program.spec.inputs, reference.tables, reference.inputs, strict=True):
            values = [list(row) for row in rows] if not port.shared else list(rows[0])
            inputs.setdefault(name, {"name": name, "rows": json.dumps(values)})
        tables = zip(reference.whole, reference.sums, reference.scales, strict=True)
        outputs = [json.dumps(table) for table in tables]
        named = zip(reference.tables, program.spec.inputs, strict=True)
        given = json.dumps([[name, port.shared] for name, port in named])
        found = json.dumps([port.name for port in program.spec.outputs])
        entry = {"inputs": given, "outputs": found, "references": outputs}
        tests.append({"name": program.spec.name, **entry})
    module = material.write(
        "javascript/module.mjs.jinja",
        functions=list(map(write_javascript_function, material.programs)),
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


def list_casadi_sources(prefix: str) -> tuple[str, str]:
    """Return the C files that a library without Jacobians is made of."""
    return f"{prefix}_casadi.c", f"{prefix}_info.c"


def _write_c(name: str, functions: Sequence[ca.Function]) -> str:
    generator = ca.CodeGenerator(name)
    for function in functions:
        generator.add(function)
    return f"/* {BANNER} */\n{generator.dump()}"


def generate_casadi_target(functions: Functions, options: GenerateOptions | None = None) -> SourceSet:
    """Return the files that users of CasADi take: functions, C, loader with self-test, README, manifest.

    The bytes depend on the version of CasADi, which fixes the format of its files.

    GenerationError where a function disagrees with itself.
    """
    material = prepare_material(functions, options or GenerateOptions())
    prefix = material.prefix

    def describe(ports: Sequence[Port]) -> list[str]:
        return [repr((port.name, get_matrix_shape(port), port.unit, port.meaning)) for port in ports]

    plain, info = list_casadi_sources(material.prefix)
    jacobians = f"{material.prefix}_casadi_jacobians.c"
    derived = [function.jacobian() for function in functions.functions if function.name() in _JACOBIANS]
    sources = [(plain, _write_c(plain, functions.functions))]
    sources += [(jacobians, _write_c(jacobians, derived))] if derived else []
    digest = material.compute_digest("casadi", sources)
    # As plain C has them, a pointer for each input and output.
    calls: list[Fields] = []
    for spec in material.card.functions:
        if spec.name in _PLANT_FUNCTIONS:
            inputs, outputs = ([port.name for port in ports] for ports in (spec.inputs, spec.outputs))
            given = [*(f"const double *{name}" for name in inputs), *(f"double *{name}" for name in outputs)]
            texts = {"arguments": given, "inputs": inputs, "outputs": outputs}
            calls.append({"name": spec.name, **{key: ", ".join(names) for key, names in texts.items()}})
    sources.append((info, material.write("casadi/info.c.jinja", digest=digest, calls=calls)))
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
