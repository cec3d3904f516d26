"""The catalogue of functions in one table: names, ordered inputs and outputs, shapes, units.

Input: a robot and its base parameters, or sizes alone. Output: `FunctionSpec` records, in the table's order.

Supported: rigid robots with friction; robots all of whose joints are elastic.
Units are written for revolute joints; of a prismatic one read m for
rad and N for N m.
"""

from typing import TYPE_CHECKING, Any

from symid.codegen.functions import FunctionSpec, Port
from symid.codegen.springs import ElasticSizes, find_elastic_sizes
from symid.robot.description import Robot

if TYPE_CHECKING:  # this loads SymPy, and users of a library do without
    from symid.parameters.base import BaseParameters

__all__ = ["find_robot_specs", "find_specs"]

# Name: shape in letters (n coordinates, l links, b inertial and p friction parameters,
# s stops, h parameters of springs), unit, meaning.
_INPUTS = {
    "q": ("n", "rad", "joint coordinates"),
    "dq": ("n", "rad/s", "joint velocities"),
    "ddq": ("n", "rad/s^2", "joint accelerations"),
    "dqr": ("n", "rad/s", "reference velocities"),
    "ddqr": ("n", "rad/s^2", "reference accelerations"),
    "tau": ("n", "N m", "joint torques without friction"),
    "beta": ("b", "mixed", "base inertial parameters"),
    "pi": ("b", "mixed", "standard parameters of links, drives and springs"),
    "f": ("p", "mixed", "friction parameters"),
    "dddq": ("n", "rad/s^3", "third derivatives of the joint coordinates"),
    "ddddq": ("n", "rad/s^4", "fourth derivatives of the joint coordinates"),
    "phi": ("n", "rad", "torsions theta - q"),
    "P": ("s", "rad", "plays of the torsions before the step"),
    "tau_J": ("n", "N m", "torques of the springs"),
    "Q": ("s", "N m", "plays of the inverse before the step"),
    "IA": ("n", "kg m^2", "rotor inertias on the joint side"),
    "h": ("h", "mixed", "parameters of the springs"),
}
_SHARED = ("beta", "pi", "f", "IA", "h")

# Name, inputs, outputs as for the inputs, meaning.
_RIGID = (
    (
        "forward_kinematics",
        "q",
        (("R", "l33", "1", "rotation matrices, one a link"), ("P", "l3", "m", "origins, one a link")),
        "pose of every link frame in the base frame",
    ),
    (
        "jacobian",
        "q",
        (("J", "6n", "m, 1", "Jacobian"),),
        "geometric Jacobian of the last link frame, base axes: linear rows, then angular",
    ),
    (
        "mass_matrix",
        "q beta",
        (("M", "nn", "kg m^2", "mass matrix"),),
        "joint-space mass matrix, rotor inertias included",
    ),
    (
        "coriolis_matrix",
        "q dq beta",
        (("C", "nn", "kg m^2/s", "Coriolis matrix"),),
        "factor C of the Coriolis torque C dq for which dM/dt - 2 C is skew",
    ),
    ("gravity", "q beta", (("g", "n", "N m", "gravity torque"),), "gravity torque"),
    (
        "bias",
        "q dq beta",
        (("c", "n", "N m", "bias torque"),),
        "Coriolis, centrifugal and gravity torque",
    ),
    (
        "inverse_dynamics",
        "q dq ddq beta",
        (("tau", "n", "N m", "joint torques without friction"),),
        "torque that gives the acceleration ddq",
    ),
    (
        "forward_dynamics",
        "q dq tau beta",
        (("ddq", "n", "rad/s^2", "joint accelerations"),),
        "acceleration under the torque tau",
    ),
    (
        "inverse_dynamics_derivatives",
        "q dq ddq beta",
        (
            ("dtau_dq", "nn", "N m/rad", "by position"),
            ("dtau_ddq", "nn", "N m s/rad", "by velocity"),
            ("dtau_dddq", "nn", "kg m^2", "by acceleration: the mass matrix"),
        ),
        "derivatives of the inverse dynamics",
    ),
    (
        "energy",
        "q dq beta",
        (("T", "1", "J", "kinetic energy"), ("V", "1", "J", "potential energy")),
        "kinetic and potential energy, up to the constant that base parameters cannot know",
    ),
    (
        "energy_regressor",
        "q dq",
        (
            ("hT", "b", "mixed", "kinetic energy regressor"),
            ("hV", "b", "mixed", "potential energy regressor"),
        ),
        "kinetic and potential energy per base parameter",
    ),
    (
        "momentum_regressor",
        "q dq",
        (("Yp", "nb", "mixed", "momentum regressor"),),
        "generalised momentum dT/ddq per base parameter",
    ),
    (
        "lagrange_regressor",
        "q dq",
        (("YL", "nb", "mixed", "regressor of dL/dq"),),
        "dL/dq = dT/dq - dV/dq per base parameter",
    ),
    (
        "torque_regressor",
        "q dq ddq",
        (("Y", "nb", "mixed", "torque regressor"),),
        "joint torque per base parameter",
    ),
    (
        "slotine_li_regressor",
        "q dq dqr ddqr",
        (("Yr", "nb", "mixed", "Slotine-Li regressor"),),
        "M ddqr + C dqr + g per base parameter",
    ),
)
_FRICTION = (
    (
        "friction",
        "dq f",
        (("tau_f", "n", "N m", "friction torques"),),
        "friction torque, positive against positive velocity",
    ),
    (
        "friction_regressor",
        "dq",
        (("Yf", "np", "mixed", "friction regressor"),),
        "friction torque per friction parameter",
    ),
)
_STEP = (
    (
        "hysteresis_step",
        "phi P h",
        (
            ("tau_J", "n", "N m", "torques of the springs without damping"),
            ("P_next", "s", "rad", "plays of the torsions after the step"),
        ),
        "torque of the springs when the torsion has gone to phi, without turning back on the way",
    ),
)
_INVERSE = (
    (
        "hysteresis_inverse_step",
        "tau_J Q h",
        (
            ("phi", "n", "rad", "torsions theta - q"),
            ("Q_next", "s", "N m", "plays of the inverse after the step"),
        ),
        "torsion of the springs when their torque has gone to tau_J, without turning back on the way",
    ),
)
_FEED = (
    (
        "elastic_inverse_dynamics",
        "q dq ddq dddq ddddq beta IA f h Q",
        (
            ("tau_m", "n", "N m", "torques of the motors, joint side"),
            ("theta", "n", "rad", "motor coordinates on the joint side"),
            ("dtheta", "n", "rad/s", "motor velocities on the joint side"),
            ("Q_next", "s", "N m", "plays of the inverse after the step"),
        ),
        "torque of the motors under which the links move as wanted, friction included",
    ),
)


def _find_entries(friction: int, elastic: ElasticSizes | None) -> tuple[tuple[Any, ...], ...]:
    entries: tuple[tuple[Any, ...], ...] = (*_RIGID, *_FRICTION) if friction else _RIGID
    if elastic is None:
        return entries
    inverse = _INVERSE if elastic.invertible else ()
    return (*entries, *_STEP, *inverse, *(_FEED if elastic.feed else ()))


def find_specs(
    joints: int,
    parameters: int,
    friction: int,
    *,
    links: int | None = None,
    vector: str = "beta",
    elastic: ElasticSizes | None = None,
) -> tuple[FunctionSpec, ...]:
    """Return the catalogue for so many coordinates, inertial and friction parameters.

    Without friction parameters the friction functions are left out: they would be empty code.

    Args:
        joints: joints with a coordinate of their own.
        parameters: inertial parameters, drives included.
        friction: friction parameters.
        links: moving links; as many as joints by default.
        vector: the name of the inertial parameters, beta or pi.
        elastic: of a robot all of whose joints are elastic; None for others. Vectors that would be empty
            (no stops, no friction) are left out of the functions of elastic joints.
    """
    sizes = {"n": joints, "l": joints if links is None else links, "b": parameters, "p": friction}
    sizes |= {"s": elastic.stops if elastic else 0, "h": elastic.springs if elastic else 0}

    def find_port(name: str, letters: str, unit: str, meaning: str, *, shared: bool = False) -> Port:
        shape = tuple(sizes[letter] if letter in sizes else int(letter) for letter in letters)
        return Port(name=name, shape=shape, unit=unit, meaning=meaning, shared=shared)

    def is_there(letters: str) -> bool:
        return letters not in ("s", "p") or sizes[letters] > 0

    return tuple(
        FunctionSpec(
            name=name,
            inputs=tuple(
                find_port(key, *_INPUTS[key], shared=key in _SHARED)
                for key in inputs.replace("beta", vector).split()
                if is_there(_INPUTS[key][0])
            ),
            outputs=tuple(find_port(*output) for output in outputs if is_there(output[1])),
            meaning=meaning,
        )
        for name, inputs, outputs, meaning in _find_entries(friction, elastic)
    )


def find_robot_specs(robot: Robot, base: "BaseParameters") -> tuple[FunctionSpec, ...]:
    """Return the catalogue for a robot and the parameters that its functions take."""
    return find_specs(
        robot.freedom,
        base.count,
        len(base.friction),
        links=robot.size,
        vector=base.vector,
        elastic=find_elastic_sizes(robot),
    )
