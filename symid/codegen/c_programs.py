"""What comes with the functions of a C library: spring state, self-test, and the example of a control loop.

`Material` -> texts and contexts of the templates; the fields of a context equal its template's variables.

The state of the springs is a struct with functions that make it and move it on. The self-test compares
every function with its references, for one sample and for batches, and checks that nothing beside the
outputs is written. The example is a control loop with the robot that it moves; its parameters are tables,
or are read from a file.

Supported: rigid robots; robots all of whose joints are elastic, with stops, whose springs have an inverse
and where torques of the motors follow from the motion of the links; parameters as arguments or baked in.
Not supported: an example for other elastic robots.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from symid.codegen.functions import FunctionSpec, ModelCard, ParameterCard, Port
from symid.codegen.material import BANNER, Material
from symid.codegen.printing import write_literal, write_table_lines
from symid.codegen.programs import Program
from symid.codegen.references import FLOOR, NEGLIGIBLE, PER_UNIT, WEIGHTS, WHOLE, Reference, ReferenceRows
from symid.codegen.source_text import write_template


@dataclass(frozen=True, slots=True, kw_only=True)
class HeaderFunction:
    """One function as the header declares it."""

    name: str
    meaning: str
    parameters: tuple[str, ...]
    operations: str
    declaration: str
    batch_declaration: str


@dataclass(frozen=True, slots=True, kw_only=True)
class HeaderContext:
    """header.h.jinja."""

    banner: str
    prefix: str
    macro: str
    robot: str
    extent: str
    joint_count: int
    link_count: int
    beta_count: int
    beta_macro: str
    beta_title: str
    friction_count: int
    joint_lines: tuple[str, ...]
    beta_lines: tuple[str, ...]
    friction_lines: tuple[str, ...]
    elastic_lines: tuple[str, ...]
    functions: tuple[HeaderFunction, ...]
    state_lines: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class StateHeaderContext:
    """hysteresis.h.jinja."""

    prefix: str
    macro: str
    real: str
    joint_count: int
    stop_count: int
    spring_count: int


@dataclass(frozen=True, slots=True, kw_only=True)
class StateContext:
    """hysteresis.c.jinja."""

    banner: str
    prefix: str
    macro: str
    real: str
    zero: str
    joint_count: int
    spring_count: int


@dataclass(frozen=True, slots=True, kw_only=True)
class StateTestContext:
    """hysteresis_test.c.jinja."""

    prefix: str
    real: str
    zero: str
    joint_count: int
    stop_count: int
    spring_count: int
    path_lines: tuple[str, ...]
    spring_lines: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class FunctionContext:
    """function.c.jinja."""

    banner: str
    prefix: str
    macro: str
    name: str
    includes: tuple[str, ...]
    helpers: tuple[str, ...]
    definition: str
    batch_definition: str
    null_test: str
    statements: tuple[str, ...]
    lane_lines: tuple[str, ...]
    call: str


@dataclass(frozen=True, slots=True, kw_only=True)
class InfoContext:
    """info.c.jinja."""

    banner: str
    prefix: str
    version: str
    signature: str
    digest: str


@dataclass(frozen=True, slots=True, kw_only=True)
class SelfTestArray:
    """A table of numbers of type `kind`."""

    kind: str
    name: str
    size: int
    lines: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class SelfTest:
    """The test of one function."""

    name: str
    call: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    input_count: int
    output_count: int


@dataclass(frozen=True, slots=True, kw_only=True)
class SelfTestContext:
    """selftest.c.jinja."""

    banner: str
    prefix: str
    real: str
    tolerance: str
    negligible: str
    floor: str
    per_unit: str
    untouched: str
    state_count: int
    whole: int
    samples: int
    fence: int
    sum_count: int
    moduli: str
    steps: str
    weights: str
    port_room: int
    input_room: int
    output_room: int
    test_count: int
    arrays: tuple[SelfTestArray, ...]
    tests: tuple[SelfTest, ...]
    state_lines: tuple[str, ...]
    state_tests: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlLoopContext:
    """control_loop.c.jinja."""

    banner: str
    prefix: str
    real: str
    joint_count: int
    usage_lines: tuple[str, ...]
    parameter_lines: tuple[str, ...]
    reading_lines: tuple[str, ...]
    arguments: str
    beta: str
    kp: str
    kd: str
    period: str
    amplitude: str
    frequency: str
    zero: str
    one: str
    sine: str
    cosine: str
    control_declaration: str
    feed_forward: tuple[str, ...]
    plant_friction: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ElasticLoopContext:
    """elastic_loop.c.jinja."""

    banner: str
    prefix: str
    macro: str
    real: str
    joint_count: int
    usage_lines: tuple[str, ...]
    parameter_lines: tuple[str, ...]
    reading_lines: tuple[str, ...]
    arguments: str
    beta: str
    constants: str
    plant_friction: tuple[str, ...]
    kp: str
    kd: str
    period: str
    substep: str
    amplitude: str
    frequency: str
    zero: str
    one: str
    two: str
    four: str
    sine: str
    cosine: str


@dataclass(frozen=True, slots=True, kw_only=True)
class MakefileContext:
    """Makefile.jinja."""

    banner: str
    prefix: str
    headers: str
    objects: str
    example_target: str


@dataclass(frozen=True, slots=True, kw_only=True)
class CMakeContext:
    """CMakeLists.txt.jinja."""

    banner: str
    prefix: str
    headers: str
    cmake_version: str
    sources: tuple[str, ...]
    programs: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class PackageContext:
    """package.pc.in.jinja."""

    prefix: str
    robot: str
    cmake_version: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadmeContext:
    """README.md.jinja."""

    prefix: str
    robot: str
    real: str
    version: str
    tolerance: str
    rows: tuple[str, ...]


_STATE_FUNCTIONS = ("hysteresis_step", "hysteresis_inverse_step")


def count_stops(material: Material) -> int:
    """Return how many plays the state holds, 0 for a library that has no state."""
    specs: dict[str, FunctionSpec] = {spec.name: spec for spec in material.card.functions}
    if any(name not in specs for name in _STATE_FUNCTIONS):
        return 0
    return sum(port.size for port in specs["hysteresis_step"].inputs if port.name == "P")


def write_state_header(material: Material) -> tuple[str, ...]:
    """Return the lines of the header that declare the state."""
    if not count_stops(material):
        return ()
    context = StateHeaderContext(
        prefix=material.prefix,
        macro=material.prefix.upper(),
        real=material.options.precision,
        joint_count=material.card.size,
        stop_count=count_stops(material),
        spring_count=len(material.card.springs),
    )
    return tuple(write_template("c/hysteresis.h.jinja", context).splitlines())


def write_state_source(material: Material) -> list[tuple[str, str]]:
    """Return the source file of the state."""
    if not count_stops(material):
        return []
    context = StateContext(
        banner=BANNER,
        prefix=material.prefix,
        macro=material.prefix.upper(),
        real=material.options.precision,
        zero=write_literal(0.0, material.options.precision),
        joint_count=material.card.size,
        spring_count=len(material.card.springs),
    )
    return [(f"{material.prefix}_hysteresis.c", write_template("c/hysteresis.c.jinja", context))]


def write_state_test(material: Material) -> tuple[str, ...]:
    """Return the lines of the self-test that run the state along the torsions of the step's own test."""
    if not count_stops(material):
        return ()
    real = material.options.precision
    names = [program.spec.name for program in material.programs]
    index = names.index("hysteresis_step")
    ports = [port.name for port in material.programs[index].spec.inputs]
    inputs = dict(zip(ports, material.references[index].inputs, strict=True))
    context = StateTestContext(
        prefix=material.prefix,
        real=real,
        zero=write_literal(0.0, real),
        joint_count=material.card.size,
        stop_count=count_stops(material),
        spring_count=len(material.card.springs),
        path_lines=write_table_lines([value for row in inputs["phi"] for value in row], real),
        spring_lines=write_table_lines(inputs["h"][0], real),
    )
    return tuple(write_template("c/hysteresis_test.c.jinja", context).splitlines())


TOLERANCES = {"double": "1e-12", "float": "2e-5"}
"""Sound code errs by a few units of the last place, 1e-16 or 6e-8, times the condition of what it solves, up
to 100 here; a wrong sign or place, or a wrong digit in a constant, errs by much more."""

# No multiple of the samples that vectors hold: each batch has some left over.
_BATCH_SAMPLES = 13
_FENCE = 8
_UNTOUCHED = 12345.5
_INTEGERS_PER_LINE = 16


def _flatten(rows: ReferenceRows) -> list[float]:
    return [value for row in rows for value in row]


def _write_thousandths(rows: ReferenceRows) -> tuple[str, ...]:
    whole = [str(round(value * PER_UNIT)) for value in _flatten(rows)] or ["0"]
    starts = range(0, len(whole), _INTEGERS_PER_LINE)
    return tuple(", ".join(whole[k : k + _INTEGERS_PER_LINE]) + "," for k in starts)


def _name_array(port: Port, table: str) -> str:
    return f"{'shared' if port.shared else 'state'}_{table}"


def _write_input(port: Port, name: str, rows: ReferenceRows, real: str) -> SelfTestArray:
    size = max(len(_flatten(rows)), 1)
    if port.shared:
        return SelfTestArray(kind=real, name=name, size=size, lines=write_table_lines(_flatten(rows), real))
    return SelfTestArray(kind="int32_t", name=name, size=size, lines=_write_thousandths(rows))


def _write_output(name: str, rows: ReferenceRows) -> SelfTestArray:
    values = _flatten(rows)
    return SelfTestArray(
        kind="double", name=name, size=max(len(values), 1), lines=write_table_lines(values, "double")
    )


def _write_arrays(material: Material) -> tuple[SelfTestArray, ...]:
    real = material.options.precision
    arrays: dict[str, SelfTestArray] = {}
    for program, reference in zip(material.programs, material.references, strict=True):
        spec = program.spec
        for port, table, rows in zip(spec.inputs, reference.tables, reference.inputs, strict=True):
            name = _name_array(port, table)
            if name not in arrays:
                arrays[name] = _write_input(port, name, rows, real)
        for port, whole, sums in zip(spec.outputs, reference.whole, reference.sums, strict=True):
            for kind, rows in (("whole", whole), ("sums", sums)):
                name = f"{kind}_{spec.name}_{port.name}"
                arrays[name] = _write_output(name, rows)
    return tuple(arrays.values())


def _describe_input(port: Port, table: str) -> str:
    name = _name_array(port, table)
    places = f"NULL, {name}" if port.shared else f"{name}, NULL"
    return f"{{ {places}, {port.size} }}"


def _build_function_test(program: Program, reference: Reference) -> SelfTest:
    spec = program.spec
    given = [f"in[{k}]" for k in range(len(spec.inputs))] + [f"out[{k}]" for k in range(len(spec.outputs))]
    outputs = (
        f"{{ whole_{spec.name}_{port.name}, sums_{spec.name}_{port.name}, {scale!r}, {port.size} }}"
        for port, scale in zip(spec.outputs, reference.scales, strict=True)
    )
    return SelfTest(
        name=spec.name,
        call=", ".join(given),
        inputs=tuple(map(_describe_input, spec.inputs, reference.tables)),
        outputs=tuple(outputs),
        input_count=len(spec.inputs),
        output_count=len(spec.outputs),
    )


def _count_test_buffers(programs: Sequence[Program]) -> tuple[int, int, int]:
    """Return the most ports of one kind, and the elements that inputs and outputs of a batch take."""
    specs = [program.spec for program in programs]
    ports = max(max(len(spec.inputs), len(spec.outputs)) for spec in specs)
    inputs = max(sum(port.size for port in spec.inputs if not port.shared) for spec in specs)
    outputs = max(sum(port.size * _BATCH_SAMPLES + _FENCE for port in spec.outputs) for spec in specs)
    return ports, max(inputs * _BATCH_SAMPLES, 1), outputs


def build_self_test(material: Material, tolerance: str) -> SelfTestContext:
    """Return the self-test of all functions."""
    real, states = material.options.precision, material.options.states
    pairs = zip(material.programs, material.references, strict=True)
    state_lines = write_state_test(material)
    ports, inputs, outputs = _count_test_buffers(material.programs)
    return SelfTestContext(
        banner=BANNER,
        prefix=material.prefix,
        real=real,
        tolerance=tolerance,
        negligible=repr(NEGLIGIBLE),
        floor=repr(FLOOR),
        per_unit=repr(float(PER_UNIT)),
        untouched=write_literal(_UNTOUCHED, real),
        state_count=states,
        whole=min(WHOLE, states),
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
        arrays=_write_arrays(material),
        tests=tuple(_build_function_test(program, reference) for program, reference in pairs),
        state_lines=state_lines,
        state_tests=("hysteresis",) if state_lines else (),
    )


_VECTOR_TITLES = {"rotor": "IA"}


@dataclass(frozen=True, slots=True, kw_only=True)
class ParametersContext:
    """parameters.c.jinja."""

    real: str
    scan: str
    names: str
    value_lines: tuple[str, ...]
    pointer_lines: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ExampleParameters:
    """Lines of an example program, and what `main` takes."""

    usage_lines: tuple[str, ...]
    lines: tuple[str, ...]
    reading_lines: tuple[str, ...]
    arguments: str


def list_arguments(card: ModelCard) -> frozenset[str]:
    """Return the names of all inputs of all functions."""
    return frozenset(port.name for spec in card.functions for port in spec.inputs)


def _write_usage(names: str, *, known: bool) -> tuple[str, ...]:
    values = "the robot file's values are used" if known else "there are none: the robot file lacks values"
    return (
        f"Usage: control_loop [FILE]    FILE holds {names}, as numbers between blanks: identified values,",
        f"for example. Without it {values}.",
    )


def build_example_parameters(
    material: Material, vectors: Mapping[str, Sequence[ParameterCard]]
) -> ExampleParameters:
    """Return the lines for vectors by the names that they have in the program, in the order of a file."""
    real = material.options.precision
    if not vectors:
        text = "Usage: control_loop    All parameters are part of the functions."
        return ExampleParameters(usage_lines=(text,), lines=(), reading_lines=(), arguments="void")
    values = [entry.value for entries in vectors.values() for entry in entries]
    known = all(value is not None for value in values)
    names = ", then ".join(_VECTOR_TITLES.get(name, name) for name in vectors)
    pointers, start = [], 0
    for name, entries in vectors.items():
        pointers.append(f"static const {real} *const {name} = parameters + {start};")
        start += len(entries)
    context = ParametersContext(
        real=real,
        scan="%f" if real == "float" else "%lf",
        names=names,
        value_lines=write_table_lines([value or 0.0 for value in values] if known else [0.0], real),
        pointer_lines=tuple(pointers),
    )
    defines = (f"#define PARAMETERS {max(len(values), 1)}", f"#define KNOWN {int(known)}", "")
    text = write_template("c/parameters.c.jinja", context).rstrip("\n")
    return ExampleParameters(
        usage_lines=_write_usage(names, known=known),
        lines=(*defines, *text.split("\n"), ""),
        reading_lines=(
            "if (count > 1 ? !read_parameters(arguments[1]) : !KNOWN) {",
            f'    fprintf(stderr, "usage: control_loop FILE    FILE: %d numbers, {names}\\n", PARAMETERS);',
            "    return 2;",
            "}",
        ),
        arguments="int count, char **arguments",
    )


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
    given = "f, " if "f" in list_arguments(material.card) else ""
    call = f"{material.prefix}_friction({{}}, {given}friction)"
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


def _list_vectors(card: ModelCard) -> dict[str, tuple[ParameterCard, ...]]:
    """Return the parameters that the library's functions take, by their names in the program."""
    vectors = (
        ("beta", card.vector, card.beta),
        ("rotor", "IA", card.rotors),
        ("f", "f", card.friction),
        ("h", "h", card.springs),
    )
    taken = list_arguments(card)
    return {name: entries for name, port, entries in vectors if port in taken}


def _write_rotors(card: ModelCard, real: str) -> tuple[str, ...]:
    values = ", ".join(write_literal(rotor.value or 0.0, real) for rotor in card.rotors)
    return (
        "/* Rotor inertias: the motors' controllers want them too. */",
        f"static const {real} rotor[JOINTS] = {{{values}}};",
        "",
    )


def _build_rigid_loop(material: Material) -> ControlLoopContext | None:
    card, real = material.card, material.options.precision
    wanted = {"inverse_dynamics", "forward_dynamics", *(["friction"] if card.friction else [])}
    if not wanted <= {spec.name for spec in card.functions}:
        return None
    vectors = {name: entries for name, entries in _list_vectors(card).items() if name in ("beta", "f")}
    parameters = build_example_parameters(material, vectors)
    suffix = "f" if real == "float" else ""
    arrays = ("q", "dq", "qd", "dqd", "ddqd")
    feed_forward, plant_friction = _write_friction(material)
    return ControlLoopContext(
        banner=BANNER,
        prefix=material.prefix,
        real=real,
        joint_count=card.size,
        usage_lines=parameters.usage_lines,
        parameter_lines=parameters.lines,
        reading_lines=parameters.reading_lines,
        arguments=parameters.arguments,
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


def _build_elastic_loop(material: Material) -> ElasticLoopContext | None:
    card, real = material.card, material.options.precision
    wanted = {"elastic_inverse_dynamics", "forward_dynamics", *(["friction"] if card.friction else [])}
    if not wanted <= {spec.name for spec in card.functions} or not count_stops(material):
        return None
    vectors = _list_vectors(card)
    parameters = build_example_parameters(material, vectors)
    rotors = () if "rotor" in vectors else _write_rotors(card, real)
    suffix = "f" if real == "float" else ""
    numbers = {name: write_literal(value, real) for name, value in _ELASTIC_LOOP_NUMBERS.items()}
    given = "f, " if "f" in vectors else ""
    felt = f"status += {material.prefix}_friction(robot->dtheta, {given}friction);"
    return ElasticLoopContext(
        banner=BANNER,
        prefix=material.prefix,
        macro=material.prefix.upper(),
        real=real,
        joint_count=card.size,
        usage_lines=parameters.usage_lines,
        parameter_lines=(*parameters.lines, *rotors),
        reading_lines=parameters.reading_lines,
        arguments=parameters.arguments,
        beta="beta, " if "beta" in vectors else "",
        constants="".join(f"{name}, " for name in vectors if name != "h"),
        plant_friction=(felt,) if card.friction else (),
        zero=f"{{{write_literal(0.0, real)}}}",
        sine=f"sin{suffix}",
        cosine=f"cos{suffix}",
        **numbers,
    )
