"""A Python module that needs NumPy alone, printed from the same programs as the C library.

Input: `Functions`: programs with their model card. Output: `SourceSet` with one module.

Supported: one sample, or any number of leading axes. Not supported: float32.
"""

from dataclasses import dataclass

from symid import __version__
from symid.codegen.casadi_functions import Functions
from symid.codegen.describe import BANNER, Material, prepare_material, write_manifest, write_operations
from symid.codegen.functions import Port
from symid.codegen.instructions import Operations, Program
from symid.codegen.options import GenerateOptions
from symid.codegen.printing import print_python
from symid.codegen.python_checks import ModuleState, ModuleTest, build_module_states, build_module_tests
from symid.codegen.reference import WEIGHTS, WHOLE
from symid.codegen.sample_states import PER_UNIT
from symid.codegen.templates import write_template
from symid.codegen.writer import SourceSet

__all__ = ["ModuleContext", "ModuleFunction", "ModuleReadmeContext", "generate_python_module"]

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


def _describe(port: Port) -> str:
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


def _write_function(program: Program, count: Operations) -> ModuleFunction:
    spec = program.spec
    return ModuleFunction(
        name=spec.name,
        meaning=spec.meaning,
        arguments=", ".join(port.name for port in spec.inputs),
        inputs=tuple(map(_describe, spec.inputs)),
        outputs=tuple(map(_describe, spec.outputs)),
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
        functions=tuple(_write_function(program, count) for program, count in counted),
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
