"""The catalogue as programs and CasADi SX functions.

Robot -> BaseParameters -> card;  Robot -> routes -> the program with the fewest operations -> SX function.

An SX operation costs the same Python time for one number as for many: instructions that do not need one
another are written together, as one operation on columns.

Supported: rigid robots, symbolic lengths with a value; all operations of `Op`.
Not supported: symbolic lengths without a value (RobotError).
"""

import itertools
import operator
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca

from symid.codegen.catalogue import build_model_card, get_constants, list_robot_specs
from symid.codegen.functions import ModelCard, Port
from symid.codegen.programs import ARITHMETIC, Op, Program
from symid.codegen.routes import choose_route
from symid.codegen.workspace import check_symbols
from symid.dynamics import build_standard_parameters, derive_base_parameters
from symid.robot import Robot

_SX_RULES: Mapping[Op, Callable[..., ca.SX]] = {
    **ARITHMETIC,
    Op.SIN: ca.sin,
    Op.COS: ca.cos,
    Op.TAN: ca.tan,
    Op.SQRT: ca.sqrt,
    Op.EXP: ca.exp,
    Op.TANH: ca.tanh,
    Op.POWER: ca.power,
    Op.ABS: ca.fabs,
    Op.SIGN: ca.sign,
    Op.LESS: operator.lt,
    Op.LESS_EQUAL: operator.le,
    Op.IS_ZERO: ca.logic_not,
    Op.SELECT: lambda a, b: ca.if_else(a, b, ca.SX(0)),
    Op.MAXIMUM: ca.fmax,
    Op.MINIMUM: ca.fmin,
}


def get_matrix_shape(port: Port) -> tuple[int, int]:
    """Return the rows and columns of the matrix that stands for a port."""
    rows = port.shape[0] if port.shape else 1
    return rows, port.size // rows if rows else 1


def _group_instructions(program: Program) -> list[tuple[Op, list[int]]]:
    """Return the instructions' numbers in groups of one operation; a group needs only earlier ones."""
    levels = [0]
    groups: dict[tuple[int, str], list[int]] = {}
    for number, instruction in enumerate(program.instructions, start=1):
        source = instruction.op in (Op.INPUT, Op.CONSTANT)
        level = 0 if source else 1 + max(levels[abs(ref)] for ref in instruction.args)
        levels.append(level)
        if not source:
            groups.setdefault((level, instruction.op.value), []).append(number)
    ordered = sorted(groups.items(), key=lambda item: item[0][0])
    return [(program.instructions[numbers[0] - 1].op, numbers) for _, numbers in ordered]


class _ValuePool:
    """A column of all values so far, and the place of each reference in it."""

    def __init__(self, size: int) -> None:
        self.column = ca.SX.zeros(size)
        self.places: dict[int, int] = {}

    def append(self, numbers: Sequence[int], values: ca.SX) -> None:
        start = len(self.places)
        self.places.update((number, start + k) for k, number in enumerate(numbers))
        self.column[start : start + len(numbers)] = values

    def read(self, refs: Sequence[int]) -> ca.SX:
        # A pool of one value would give a row.
        values = ca.vec(self.column[[self.places[abs(ref)] for ref in refs]])
        if any(ref < 0 for ref in refs):
            values = values * ca.DM([1.0 if ref > 0 else -1.0 for ref in refs])
        return values


def build_sx_function(program: Program) -> ca.Function:
    """Return the SX function of `program`; a port of shape (n, k, m) is a matrix of n rows, k m columns."""
    spec = program.spec
    inputs = [ca.SX.sym(port.name, *get_matrix_shape(port)) for port in spec.inputs]
    pool = _ValuePool(len(program.instructions))
    numbered = list(enumerate(program.instructions, start=1))
    if read := {k: one for k, one in numbered if one.op is Op.INPUT}:
        rows = [ca.vec(value.T) for value in inputs]
        starts = [0, *itertools.accumulate(value.numel() for value in rows)]
        elements = [starts[one.args[0]] + one.args[1] for one in read.values()]
        pool.append(list(read), ca.vertcat(*rows)[elements])
    if known := {k: one.constant for k, one in numbered if one.op is Op.CONSTANT}:
        pool.append(list(known), ca.SX(ca.DM(list(known.values()))))
    for op, numbers in _group_instructions(program):
        instructions = [program.instructions[number - 1] for number in numbers]
        columns = zip(*(instruction.args for instruction in instructions), strict=True)
        pool.append(numbers, _SX_RULES[op](*(pool.read(refs) for refs in columns)))
    outputs = []
    for port, refs in zip(spec.outputs, program.outputs, strict=True):
        values = pool.read(refs) if refs else ca.SX(0, 1)
        outputs.append(ca.densify(ca.reshape(values, *reversed(get_matrix_shape(port))).T))
    names = ([port.name for port in spec.inputs], [port.name for port in spec.outputs])
    return ca.Function(spec.name, inputs, outputs, *names)


@dataclass(frozen=True, slots=True, kw_only=True)
class Functions:
    """A model card, and in its order the chosen programs and the SX functions built from them.

    `constant`: whether the parameter values of the robot file are constants of the functions.
    """

    card: ModelCard
    programs: tuple[Program, ...]
    functions: tuple[ca.Function, ...]
    constant: bool = False


def build_functions(
    robot: Robot,
    *,
    names: tuple[str, ...] | None = None,
    without: Collection[str] = (),
    standard: bool = False,
    constant: bool = False,
) -> Functions:
    """Return the functions of the catalogue, or those called `names`, in the catalogue's order.

    `without` names those to leave out. `standard`: they take the standard parameters pi in place of beta.
    `constant`: the parameter values of the robot file are constants of the functions.

    Raises:
        RobotError: a symbolic length has no value.
        UsageError: a name is not in the catalogue, or the robot file lacks a value that shall be constant.
    """
    check_symbols(robot)
    base = build_standard_parameters(robot) if standard else derive_base_parameters(robot)
    specs = tuple(spec for spec in list_robot_specs(robot, base, names) if spec.name not in without)
    card = build_model_card(robot, base, specs)
    constants = get_constants(card) if constant else {}
    specs = tuple(
        replace(spec, inputs=tuple(port for port in spec.inputs if port.name not in constants))
        for spec in specs
    )
    programs = tuple(choose_route(robot, base, spec, constants).program for spec in specs)
    return Functions(
        card=replace(card, functions=specs),
        programs=programs,
        functions=tuple(map(build_sx_function, programs)),
        constant=constant,
    )


def build_casadi_function(
    robot: Robot, name: str, *, standard: bool = False, constant: bool = False
) -> ca.Function:
    """Return one function of the catalogue over SX, with derivatives of any order.

    Vectors are columns: `map`, and matrices of samples side by side, work as usual in CasADi. The rotation
    matrices of the forward kinematics, of shape (n, 3, 3), are the rows of an n x 9 matrix. SI units, angles
    in rad. At a kink of friction or of a spring, derivatives are those of one side; friction with a speed to
    a power below one has none at rest. Arguments and errors are those of `build_functions`.
    """
    return build_functions(robot, names=(name,), standard=standard, constant=constant).functions[0]
