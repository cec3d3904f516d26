"""The targets that Python imports: a NumPy module, and CasADi functions with their loader.

`Functions` -> `SourceSet`.

The NumPy module needs NumPy alone and is printed from the same programs as the C library: one sample, or
any number of leading axes. The CasADi target holds serialised functions, CasADi's own C, and a module that
loads either: all functions of the catalogue as .casadi files and in C, and Jacobians in C of those that
equations of motion are made of, so that an external function has first derivatives.

Not supported: float; Jacobians in C of regressors, of the Coriolis matrix and of derivatives, which would
be most of the code; .casadi files have them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from symid import __version__
from symid.codegen.casadi_functions import Functions, get_matrix_shape
from symid.codegen.functions import FunctionSpec, Port
from symid.codegen.library import compute_build_digest
from symid.codegen.material import (
    BANNER,
    Material,
    ModuleState,
    ModuleTest,
    build_module_states,
    build_module_tests,
    prepare_material,
    write_manifest,
    write_operations,
)
from symid.codegen.printing import print_python
from symid.codegen.programs import Operations, Program
from symid.codegen.references import PER_UNIT, WEIGHTS, WHOLE
from symid.codegen.source_folder import SourceSet, compute_digest
from symid.codegen.source_text import GenerateOptions, write_template

_TOLERANCE = "1e-12"


@dataclass(frozen=True, slots=True, kw_only=True)
class ModuleFunction:
    """One function of the module."""

    name: str
    meaning: str
    arguments: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    operations: str
    statements: tuple[str, ...]
    returns: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ModuleContext:
    """module.py.jinja."""

    banner: str
    robot: str
    version: str
    signature: str
    tolerance: str
    per_unit: str
    whole: int
    weights: str
    state_count: int
    names: str
    extent: str
    joint_count: int
    joint_lines: tuple[str, ...]
    beta_title: str
    beta_lines: tuple[str, ...]
    friction_lines: tuple[str, ...]
    elastic_lines: tuple[str, ...]
    functions: tuple[ModuleFunction, ...]
    states: tuple[ModuleState, ...]
    tests: tuple[ModuleTest, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ModuleReadmeContext:
    """README.md.jinja."""

    prefix: str
    robot: str
    version: str


def _write_shape(port: Port) -> str:
    inner = ", ".join(map(str, port.shape))
    return f"({inner},)" if port.shared and len(port.shape) == 1 else f"(..., {inner})"


def _describe_array_port(port: Port) -> str:
    return f"{port.name}: {_write_shape(port)} {port.meaning}, {port.unit}"


def _write_statements(program: Program) -> tuple[str, ...]:
    spec = program.spec
    samples = [port for port in spec.inputs if not port.shared]
    prepared = [f'{port.name} = _prepare("{port.name}", {port.name}, {port.shape!r})' for port in spec.inputs]
    shapes = ", ".join(f"{port.name}.shape[:-{len(port.shape)}]" for port in samples)
    allocated = [
        f"{port.name} = np.zeros((*samples, {', '.join(map(str, port.shape))}))" for port in spec.outputs
    ]
    return (
        *prepared,
        f"samples = np.broadcast_shapes({shapes})",
        *allocated,
        *print_python(program).statements,
    )


def _write_module_function(program: Program, count: Operations) -> ModuleFunction:
    spec = program.spec
    return ModuleFunction(
        name=spec.name,
        meaning=spec.meaning,
        arguments=", ".join(port.name for port in spec.inputs),
        inputs=tuple(map(_describe_array_port, spec.inputs)),
        outputs=tuple(map(_describe_array_port, spec.outputs)),
        operations=write_operations(count),
        statements=_write_statements(program),
        returns=", ".join(port.name for port in spec.outputs),
    )


def _write_module(material: Material) -> str:
    programs = material.programs
    counted = zip(programs, material.operations, strict=True)
    context = ModuleContext(
        banner=BANNER,
        robot=material.robot,
        version=__version__,
        signature=material.card.signature,
        tolerance=_TOLERANCE,
        per_unit=repr(float(PER_UNIT)),
        whole=min(WHOLE, material.options.states),
        weights=repr(WEIGHTS),
        state_count=material.options.states,
        names=", ".join(f'"{program.spec.name}"' for program in programs),
        extent=material.extent,
        joint_count=material.card.size,
        joint_lines=material.joint_lines,
        beta_title=material.beta_title,
        beta_lines=material.beta_lines,
        friction_lines=material.friction_lines,
        elastic_lines=tuple(line.replace("  ", "    ", 1) for line in material.elastic_lines),
        functions=tuple(_write_module_function(program, count) for program, count in counted),
        states=build_module_states(programs, material.references),
        tests=build_module_tests(programs, material.references),
    )
    return write_template("python/module.py.jinja", context)


def generate_python_module(functions: Functions, options: GenerateOptions | None = None) -> SourceSet:
    """Return a NumPy module that computes `functions`, with its README and manifest.

    Raises:
        GenerationError: a function holds an operation without a NumPy form, or disagrees with itself.
    """
    material = prepare_material(functions, options or GenerateOptions())
    readme = ModuleReadmeContext(prefix=material.prefix, robot=material.robot, version=__version__)
    files = (
        (f"{material.prefix}.py", _write_module(material)),
        ("README.md", write_template("python/README.md.jinja", readme)),
    )
    manifest = write_manifest(material, "python", files)
    return SourceSet(name=material.prefix, files=files, manifest=manifest)


# Derivatives of the forward dynamics amplify rounding by the square of what the dynamics do.
_JACOBIAN_TOLERANCE = "1e-10"
_JACOBIANS = frozenset(
    {
        *("forward_kinematics", "jacobian", "mass_matrix", "gravity", "bias", "energy", "friction"),
        *("inverse_dynamics", "forward_dynamics", "hysteresis_step", "hysteresis_inverse_step"),
        "elastic_inverse_dynamics",
    }
)


@dataclass(frozen=True, slots=True, kw_only=True)
class LoaderFunction:
    """One function as the loader lists it."""

    name: str
    meaning: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    jacobian: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class LoaderContext:
    """loader.py.jinja."""

    banner: str
    prefix: str
    robot: str
    version: str
    signature: str
    tolerance: str
    jacobian_tolerance: str
    per_unit: str
    whole: int
    weights: str
    state_count: int
    extent: str
    joint_lines: tuple[str, ...]
    beta_title: str
    beta_lines: tuple[str, ...]
    friction_lines: tuple[str, ...]
    elastic_lines: tuple[str, ...]
    functions: tuple[LoaderFunction, ...]
    states: tuple[ModuleState, ...]
    tests: tuple[ModuleTest, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class CasadiCall:
    """A function as plain C has it, a pointer for each input and output."""

    name: str
    arguments: str
    inputs: str
    outputs: str


@dataclass(frozen=True, slots=True, kw_only=True)
class CasadiInfoContext:
    """info.c.jinja."""

    banner: str
    prefix: str
    digest: str
    calls: tuple[CasadiCall, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class CasadiMakefileContext:
    """Makefile.jinja."""

    banner: str
    prefix: str
    objects: str


@dataclass(frozen=True, slots=True, kw_only=True)
class CasadiReadmeContext:
    """README.md.jinja."""

    prefix: str
    robot: str
    version: str
    casadi: str
    example: str


# What the compiled plant of elastic robots calls.
_PLANT_FUNCTIONS = ("forward_dynamics", "friction")


def list_casadi_sources(prefix: str) -> tuple[str, str]:
    """Return the C files that a library without Jacobians is made of."""
    return f"{prefix}_casadi.c", f"{prefix}_info.c"


def _serialize(function: ca.Function) -> str:
    # What Function.load reads; Function.serialize leaves out the word that says a function follows.
    serializer = ca.StringSerializer()
    serializer.pack(function)
    return f"{serializer.encode()}\n"


def _write_c(name: str, functions: Sequence[ca.Function]) -> str:
    generator = ca.CodeGenerator(name)
    for function in functions:
        generator.add(function)
    return f"/* {BANNER} */\n{generator.dump()}"


def _write_call(spec: FunctionSpec) -> CasadiCall:
    inputs, outputs = ([port.name for port in ports] for ports in (spec.inputs, spec.outputs))
    arguments = [*(f"const double *{name}" for name in inputs), *(f"double *{name}" for name in outputs)]
    return CasadiCall(
        name=spec.name,
        arguments=", ".join(arguments),
        inputs=", ".join(inputs),
        outputs=", ".join(outputs),
    )


def _write_c_files(material: Material, functions: Sequence[ca.Function]) -> list[tuple[str, str]]:
    plain, info = list_casadi_sources(material.prefix)
    jacobians = f"{material.prefix}_casadi_jacobians.c"
    derived = [function.jacobian() for function in functions if function.name() in _JACOBIANS]
    files = [(plain, _write_c(plain, functions))]
    files += [(jacobians, _write_c(jacobians, derived))] if derived else []
    digest = compute_build_digest(
        material.card,
        prefix=material.prefix,
        precision="double",
        files={path: compute_digest(text.encode()) for path, text in files},
    )
    called = (spec for spec in material.card.functions if spec.name in _PLANT_FUNCTIONS)
    context = CasadiInfoContext(
        banner=BANNER, prefix=material.prefix, digest=digest, calls=tuple(map(_write_call, called))
    )
    return [*files, (info, write_template("casadi/info.c.jinja", context))]


def _describe_matrix_port(port: Port) -> str:
    return repr((port.name, get_matrix_shape(port), port.unit, port.meaning))


def _write_loader(material: Material) -> str:
    context = LoaderContext(
        banner=BANNER,
        prefix=material.prefix,
        robot=material.robot,
        version=__version__,
        signature=material.card.signature,
        tolerance=_TOLERANCE,
        jacobian_tolerance=_JACOBIAN_TOLERANCE,
        per_unit=repr(float(PER_UNIT)),
        whole=min(WHOLE, material.options.states),
        weights=repr(WEIGHTS),
        state_count=material.options.states,
        extent=material.extent,
        joint_lines=material.joint_lines,
        beta_title=material.beta_title,
        beta_lines=material.beta_lines,
        friction_lines=material.friction_lines,
        elastic_lines=tuple(line.replace("  ", "    ", 1) for line in material.elastic_lines),
        functions=tuple(
            LoaderFunction(
                name=spec.name,
                meaning=spec.meaning,
                inputs=tuple(map(_describe_matrix_port, spec.inputs)),
                outputs=tuple(map(_describe_matrix_port, spec.outputs)),
                jacobian=spec.name in _JACOBIANS,
            )
            for spec in material.card.functions
        ),
        states=build_module_states(material.programs, material.references),
        tests=build_module_tests(material.programs, material.references),
    )
    return write_template("casadi/loader.py.jinja", context)


def generate_casadi_target(functions: Functions, options: GenerateOptions | None = None) -> SourceSet:
    """Return the files that users of CasADi take: functions, C, loader with self-test, README, manifest.

    The bytes depend on the version of CasADi, which fixes the format of its files.

    Raises:
        GenerationError: a function disagrees with itself.
    """
    material = prepare_material(functions, options or GenerateOptions())
    prefix = material.prefix
    sources = _write_c_files(material, functions.functions)
    make = CasadiMakefileContext(
        banner=BANNER, prefix=prefix, objects=" ".join(f"{path.removesuffix('.c')}.o" for path, _ in sources)
    )
    readme = CasadiReadmeContext(
        prefix=prefix,
        robot=material.robot,
        version=__version__,
        casadi=ca.CasadiMeta.version(),
        example=material.card.functions[0].name,
    )
    files = (
        *((f"{function.name()}.casadi", _serialize(function)) for function in functions.functions),
        *sources,
        (f"{prefix}_casadi.py", _write_loader(material)),
        ("Makefile", write_template("casadi/Makefile.jinja", make)),
        ("README.md", write_template("casadi/README.md.jinja", readme)),
    )
    return SourceSet(name=prefix, files=files, manifest=write_manifest(material, "casadi", files))
