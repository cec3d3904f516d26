"""The functions of a robot as programs and CasADi SX functions, and what all targets are printed from.

Robot -> BaseParameters -> card;  Robot -> routes -> the program with the fewest operations -> SX function;
these -> `Material`: reference values, the model as lines of text, the manifest.

An SX operation costs the same Python time for one number as for many: instructions that do not need one
another are written together, as one operation on columns.

Supported: rigid robots, symbolic lengths with a value; all operations of `Op`.
Not supported: symbolic lengths without a value (RobotError).
"""

import itertools
import operator
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import casadi as ca

from symid import __version__
from symid.codegen.equation_routes import check_symbols
from symid.codegen.functions import (
    ModelCard,
    ParameterCard,
    Port,
    Standard,
    build_model_card,
    compute_build_digest,
    get_constants,
    list_robot_specs,
)
from symid.codegen.printing import write_literal
from symid.codegen.programs import ARITHMETIC, Op, Operations, Program, count_operations
from symid.codegen.references import PER_UNIT, WHOLE, Reference, build_references
from symid.codegen.routes import choose_route
from symid.codegen.source_folder import SourceSet, compute_digest, list_sources
from symid.codegen.source_text import BANNER, build_library_prefix, clean_text, write_template
from symid.dynamics import build_standard_parameters, derive_base_parameters
from symid.options import GenerateOptions
from symid.robot import Robot

_SX_RULES: Mapping[Op, Callable[..., ca.SX]] = {
    **ARITHMETIC,
    **{op: getattr(ca, op.value) for op in (Op.SIN, Op.COS, Op.EXP, Op.TANH, Op.POWER, Op.SIGN)},
    Op.ABS: ca.fabs,
    Op.LESS: operator.lt,
    Op.LESS_EQUAL: operator.le,
    Op.MAXIMUM: ca.fmax,
    Op.MINIMUM: ca.fmin,
}
Fields = dict[str, object]
"""One entry of a list in a template."""


def get_matrix_shape(port: Port) -> tuple[int, int]:
    """Return the rows and columns of the matrix that stands for a port."""
    rows = port.shape[0] if port.shape else 1
    return rows, port.size // rows if rows else 1


def build_sx_function(program: Program) -> ca.Function:
    """Return the SX function of `program`; a port of shape (n, k, m) is a matrix of n rows, k m columns."""
    spec = program.spec
    inputs = [ca.SX.sym(port.name, *get_matrix_shape(port)) for port in spec.inputs]
    # A column of all values so far, and the place of each reference in it.
    column, places = ca.SX.zeros(len(program.instructions)), dict[int, int]()
    numbered = list(enumerate(program.instructions, start=1))

    def append(numbers: Collection[int], values: ca.SX) -> None:
        start = len(places)
        places.update((number, start + k) for k, number in enumerate(numbers))
        column[start : start + len(numbers)] = values

    def read(refs: Sequence[int]) -> ca.SX:
        # A pool of one value would give a row.
        values = ca.vec(column[[places[abs(ref)] for ref in refs]])
        return values * ca.DM([1.0 if ref > 0 else -1.0 for ref in refs]) if min(refs) < 0 else values

    if given := {k: one for k, one in numbered if one.op is Op.INPUT}:
        rows = [ca.vec(value.T) for value in inputs]
        starts = [0, *itertools.accumulate(value.numel() for value in rows)]
        append(given, ca.vertcat(*rows)[[starts[one.args[0]] + one.args[1] for one in given.values()]])
    if known := {k: one.constant for k, one in numbered if one.op is Op.CONSTANT}:
        append(known, ca.SX(ca.DM(list(known.values()))))
    # Groups of one operation; a group needs only earlier ones.
    levels = [0]
    groups: dict[tuple[int, str], list[int]] = {}
    for number, one in numbered:
        source = one.op in (Op.INPUT, Op.CONSTANT)
        levels.append(0 if source else 1 + max(levels[abs(ref)] for ref in one.args))
        if not source:
            groups.setdefault((levels[-1], one.op.value), []).append(number)
    for (_, op), numbers in sorted(groups.items(), key=lambda item: item[0][0]):
        operands = zip(*(program.instructions[number - 1].args for number in numbers), strict=True)
        append(numbers, _SX_RULES[Op(op)](*map(read, operands)))
    outputs = []
    for port, refs in zip(spec.outputs, program.outputs, strict=True):
        values = read(refs) if refs else ca.SX(0, 1)
        outputs.append(ca.densify(ca.reshape(values, *reversed(get_matrix_shape(port))).T))
    names = ([port.name for port in spec.inputs], [port.name for port in spec.outputs])
    return ca.Function(spec.name, inputs, outputs, *names)


@dataclass(frozen=True, slots=True, kw_only=True)
class Functions:
    """A model card, and in its order programs and SX functions; `constant`: values are built in."""

    card: ModelCard
    programs: tuple[Program, ...]
    functions: tuple[ca.Function, ...]
    constant: bool = False


def build_functions(
    robot: Robot,
    *,
    names: tuple[str, ...] | None = None,
    without: Collection[str] = (),
    standard: Standard = False,
    constant: bool = False,
) -> Functions:
    """Return the functions of the catalogue, or those called `names`, in the catalogue's order.

    `without` names those to leave out. `standard`: they take the standard parameters in place of beta, pi
    about the frames of the robot file, with "internal" pi_internal about the frames used here.
    `constant`: the parameter values of the robot file are constants of the functions.

    Raises:
        RobotError: a symbolic length has no value.
        UsageError: a name is not in the catalogue, or the robot file lacks a value that shall be constant.
    """
    check_symbols(robot)
    internal = standard == "internal"
    base = build_standard_parameters(robot, internal=internal) if standard else derive_base_parameters(robot)
    specs = tuple(spec for spec in list_robot_specs(robot, base, names) if spec.name not in without)
    card = build_model_card(robot, base, specs)
    constants = get_constants(card) if constant else {}
    kept = [tuple(port for port in spec.inputs if port.name not in constants) for spec in specs]
    specs = tuple(replace(spec, inputs=ports) for spec, ports in zip(specs, kept, strict=True))
    programs = tuple(choose_route(robot, base, spec, constants).program for spec in specs)
    built = tuple(map(build_sx_function, programs))
    card = replace(card, functions=specs)
    return Functions(card=card, programs=programs, functions=built, constant=constant)


def build_casadi_function(
    robot: Robot, name: str, *, standard: Standard = False, constant: bool = False
) -> ca.Function:
    """Return one function of the catalogue over SX, with derivatives of any order.

    Vectors are columns: `map`, and matrices of samples side by side, work as usual in CasADi. The rotation
    matrices of the forward kinematics, of shape (n, 3, 3), are the rows of an n x 9 matrix. SI units, angles
    in rad. At a kink of friction or of a spring, derivatives are those of one side; friction with a speed to
    a power below one has none at rest. Arguments and errors are those of `build_functions`.
    """
    return build_functions(robot, names=(name,), standard=standard, constant=constant).functions[0]


_PARAMETERS = {
    "beta": ("Base parameters beta", ""),
    "pi": (
        "Standard parameters pi",
        "of each link about its frame of the robot file (standard rows: at the end; URDF, MJCF: the link's)",
    ),
    "pi_internal": (
        "Standard parameters pi_internal",
        "of each link about symid's internal frame (modified Denavit-Hartenberg: z along the joint's axis)",
    ),
}
"""What a vector of inertial parameters is called, and the frames that it is about."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Material:
    """What the printers of all targets start from.

    `stops` is the number of plays in the state of the springs, `bristles` that of deflections in the state of
    friction, 0 where the functions have no such state.
    `facts` are what any template may ask for: names, and the model as lines of text.
    """

    card: ModelCard
    prefix: str
    options: GenerateOptions
    programs: tuple[Program, ...]
    references: tuple[Reference, ...]
    operations: tuple[Operations, ...]
    elastic_lines: tuple[str, ...]
    stops: int
    bristles: int
    facts: Mapping[str, object]

    def write(self, template: str, /, **values: object) -> str:
        """Return a template filled with `values` and with facts of the model."""
        return write_template(template, self.facts, **values)

    def list_given_ports(self) -> list[Port]:
        """Return what friction that remembers takes besides the motion and its state."""
        spec = next(spec for spec in self.card.functions if spec.name == "friction_step")
        return [port for port in spec.inputs if port.name not in {"dq", "way", "z"}]

    def compute_digest(self, target: str, files: Iterable[tuple[str, str]]) -> str:
        """Return the digest that a library of the C files among `files` holds; see `compute_build_digest`."""
        precision = self.options.precision if target == "c" else "double"
        digests = {path: compute_digest(text.encode()) for path, text in files}
        return compute_build_digest(self.card, prefix=self.prefix, precision=precision, files=digests)

    def collect(self, target: str, files: Sequence[tuple[str, str]]) -> SourceSet:
        """Return `files` with their manifest: what wrote them, the model, digests, operation counts."""
        names = (program.spec.name for program in self.programs)
        return list_sources(
            files,
            dict(zip(names, self.operations, strict=True)),
            target=target,
            prefix=self.prefix,
            precision=self.options.precision if target == "c" else "double",
            card=asdict(self.card),
        )


def _describe_parameters(
    vector: str, parameters: Sequence[ParameterCard], *, constant: bool = False
) -> tuple[str, ...]:
    lines = []
    for k, parameter in enumerate(parameters):
        grouped = f" = {parameter.expression}" if parameter.expression not in {"", parameter.name} else ""
        grouped += f" = {parameter.value:.6g}" if constant else ""
        lines.append(clean_text(f"{vector}[{k}] {parameter.name}{grouped} ({parameter.unit})"))
    return tuple(lines) or ("none",)


def prepare_material(functions: Functions, options: GenerateOptions) -> Material:
    """Return what all targets are printed from; a GenerationError as of `build_references`."""
    card, programs, constant = functions.card, functions.programs, functions.constant
    prefix, real = build_library_prefix(card.robot), options.precision
    sizes = {(spec.name, port.name): port.size for spec in card.functions for port in spec.inputs}
    bristles = sizes.get(("friction_step", "z"), 0)
    stops = sizes.get(("hysteresis_step", "P"), 0) if ("hysteresis_inverse_step", "tau_J") in sizes else 0
    # A line a joint; with followers in the robot, coordinates and joints are numbered apart.
    lines = []
    for k, moving in enumerate(card.joints):
        label = f"q[{k}]: joint {moving.number}," if card.followers else f"{moving.number}"
        words = f"position in {moving.position_unit}, torque in {moving.torque_unit}"
        if moving.smoothing:
            words += f"; dry friction with tanh(v / {moving.smoothing:g}) in place of sign(v)"
        lines.append(clean_text(f"{label} {moving.name}: {moving.kind}, {words}"))
    for joint in card.followers:
        times = {"1": "", "-1": "-"}.get(joint.multiplier, f"{joint.multiplier} ")
        follows = f"follows {times}{joint.master}, link {joint.number}"
        lines.append(clean_text(f"joint {joint.number}, {joint.name}: {joint.kind}, {follows}"))
    # What a user must know of the springs of a robot whose joints are all elastic.
    elastic = (
        "",
        "Elastic joints: the motor's angle theta is q + phi. The functions of q are those of the links, the",
        "friction is that of the motors, at their velocity dtheta, and the rotors turn with the motors.",
        "Spring: tau_J = v + sum of s_j max(v - R_j, 0) where R_j > 0, s_j min(v - R_j, 0) where R_j < 0,",
        "v = k0 phi + kc phi^3 + sum of k_i (phi - P_i), plays P_i = max(phi - r_i, min(phi + r_i, P_i)).",
        *(f"  {line}" for line in _describe_parameters("IA", card.rotors, constant=constant)),
        *(f"  {line}" for line in _describe_parameters("h", card.springs)),
    )
    moving_alone = f", {card.size} of them with a coordinate" if card.followers else ""
    title, frames = _PARAMETERS[card.vector]
    note = " (constants of the functions, as those of friction and rotors; no arguments)"
    facts = {
        "banner": BANNER,
        "version": __version__,
        "prefix": prefix,
        "macro": prefix.upper(),
        "robot": clean_text(card.robot),
        "signature": card.signature,
        "real": real,
        "zero": write_literal(0.0, real),
        "joint_count": card.size,
        "spring_count": len(card.springs),
        "stop_count": stops,
        "bristle_count": bristles,
        "extent": f"{card.links} joints{moving_alone}",
        "joint_lines": tuple(lines),
        "beta_title": f"{title}{frames and ', '}{frames}{note if constant else ''}",
        "frame_lines": (f"\n{title} are those {frames}.",) if frames else (),
        "beta_lines": _describe_parameters(card.vector, card.beta, constant=constant),
        "friction_lines": _describe_parameters("f", card.friction, constant=constant),
        "state_count": options.states,
        "whole": min(WHOLE, options.states),
        "per_unit": repr(float(PER_UNIT)),
    }
    return Material(
        card=card,
        prefix=prefix,
        options=options,
        programs=programs,
        references=build_references(card, functions.functions, programs, options),
        operations=tuple(map(count_operations, programs)),
        elastic_lines=elastic if card.springs else (),
        stops=stops,
        bristles=bristles,
        facts=facts,
    )


def write_operations(operations: Operations) -> str:
    """Return the counts in words."""
    return f"{operations.mul} products, {operations.add} sums, {operations.trig} elementary functions"
