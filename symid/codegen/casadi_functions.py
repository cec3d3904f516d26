"""The catalogue as CasADi functions over SX, in base parameters.

Input: a robot. Output: `Functions`: the model card, one program and one SX function per entry of the
catalogue, with inputs and outputs named, ordered and shaped as its spec says; of shape (n, 3, 3), they are
n x 9 matrices.

Robot -> BaseParameters -> card;  Robot -> routes -> the program with the fewest operations -> SX function.

Supported: rigid robots, symbolic lengths with a value.
Not supported: symbolic lengths without a value (RobotError).
"""

from dataclasses import dataclass, replace

import casadi as ca

from symid.codegen.catalogue import find_robot_specs
from symid.codegen.constants import drop_constants, find_constants
from symid.codegen.functions import ModelCard
from symid.codegen.instructions import Program
from symid.codegen.model_card import build_model_card
from symid.codegen.routes import choose_route
from symid.codegen.sx_functions import build_function
from symid.codegen.workspace import check_symbols
from symid.errors import Notice, UsageError
from symid.parameters.base import build_standard_parameters, find_base_parameters
from symid.robot.description import Robot

__all__ = ["Functions", "build_casadi_function", "build_functions"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Functions:
    """A model card, and in its order the chosen programs and the SX functions built from them.

    Code is printed from the programs; what CasADi makes of them on the way is for its users. `constant` says
    whether the values of the robot file are part of the functions.
    """

    card: ModelCard
    programs: tuple[Program, ...]
    functions: tuple[ca.Function, ...]
    constant: bool = False


def build_functions(
    robot: Robot, *, names: tuple[str, ...] | None = None, standard: bool = False, constant: bool = False
) -> Functions:
    """Return the functions of the catalogue, or those called `names`, in the catalogue's order.

    Args:
        robot: the robot.
        names: of the functions wanted, None for all.
        standard: whether functions take the standard parameters pi in place of beta.
        constant: whether functions hold the values of the robot file, and take no parameters.

    Raises:
        RobotError: a symbolic length has no value.
        UsageError: a name is not in the catalogue, or the robot file lacks a value that shall be constant.
    """
    check_symbols(robot)
    base = build_standard_parameters(robot) if standard else find_base_parameters(robot)
    catalogue = find_robot_specs(robot, base)
    known = [spec.name for spec in catalogue]
    for name in names or ():
        if name not in known:
            text = f"function '{name}' is not in the catalogue; there are {', '.join(known)}"
            raise UsageError(Notice(code="usage.unknown-function", text=text))
    specs = tuple(spec for spec in catalogue if names is None or spec.name in names)
    card = build_model_card(robot, base, specs)
    constants = find_constants(card) if constant else {}
    specs = tuple(drop_constants(spec, constants) for spec in specs)
    programs = tuple(choose_route(robot, base, spec, constants).program for spec in specs)
    return Functions(
        card=replace(card, functions=specs),
        programs=programs,
        functions=tuple(map(build_function, programs)),
        constant=constant,
    )


def build_casadi_function(
    robot: Robot, name: str, *, standard: bool = False, constant: bool = False
) -> ca.Function:
    """Return one function of the catalogue over SX, with derivatives of any order.

    Vectors are columns: `map`, and matrices of samples side by side, work as CasADi has them. The rotation
    matrices of the forward kinematics, of shape (n, 3, 3), stand row by row in n x 9. SI units, angles in
    rad. Where friction or a spring changes its slope at once, derivatives are those of one side; friction
    with a speed to a power below one has none at rest.

    Args:
        robot: the robot.
        name: of the function.
        standard: whether it takes the standard parameters pi in place of beta.
        constant: whether it holds the values of the robot file, and takes no parameters.

    Raises:
        RobotError: a symbolic length has no value.
        UsageError: the name is not in the catalogue, or the robot file lacks a value that shall be constant.
    """
    return build_functions(robot, names=(name,), standard=standard, constant=constant).functions[0]
