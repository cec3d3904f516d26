"""What the C templates are filled with; the fields of a context equal its template's variables."""

from dataclasses import dataclass

__all__ = [
    "CMakeContext",
    "ControlLoopContext",
    "ElasticLoopContext",
    "FunctionContext",
    "HeaderContext",
    "HeaderFunction",
    "InfoContext",
    "MakefileContext",
    "PackageContext",
    "ReadmeContext",
    "SelfTest",
    "SelfTestArray",
    "SelfTestContext",
    "StateContext",
    "StateHeaderContext",
    "StateTestContext",
]


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
