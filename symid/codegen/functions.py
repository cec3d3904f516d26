"""The catalogue of functions: names, ordered inputs and outputs, shapes, units.

Input: the sizes of a robot. Output: `FunctionSpec` records and the `ModelCard` that travels
with generated code, so that its users need neither the robot file nor SymPy.

Supported: rigid robots. Shapes are those of one sample; in a batch, inputs and outputs
that change from sample to sample get a leading axis.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from symid.provenance import find_signature
from symid.robot.description import Robot

__all__ = [
    "FunctionSpec",
    "JointCard",
    "ModelCard",
    "ParameterCard",
    "Port",
    "find_model_signature",
    "find_specs",
    "read_model_card",
    "write_model_card",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Port:
    """One input or output: `shape` of one sample, row-major; `shared` for parameter vectors."""

    name: str
    shape: tuple[int, ...]
    unit: str
    meaning: str
    shared: bool = False

    @property
    def size(self) -> int:
        """Return the number of scalars in one sample."""
        total = 1
        for extent in self.shape:
            total *= extent
        return total


@dataclass(frozen=True, slots=True, kw_only=True)
class FunctionSpec:
    """A function of the catalogue: what goes in, what comes out, in one sentence what it is."""

    name: str
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    meaning: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterCard:
    """A parameter that can be identified: its name, what it groups, its unit, and why."""

    name: str
    expression: str
    unit: str
    reason: str
    joint: str
    value: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class JointCard:
    """What a user of the functions must know of a joint."""

    name: str
    kind: str
    friction: str

    @property
    def torque_unit(self) -> str:
        """Return N m, or N for a prismatic joint."""
        return "N" if self.kind == "prismatic" else "N m"

    @property
    def position_unit(self) -> str:
        """Return rad, or m for a prismatic joint."""
        return "m" if self.kind == "prismatic" else "rad"


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelCard:
    """The model behind a set of functions; `signature` is that of the robot and the derivation.

    `beta` describes the base inertial parameters (drives included), `friction` the friction
    parameters; both in the order of the vectors of the same names. Values are those of the
    robot file, where it states all of them.
    """

    robot: str
    signature: str
    joints: tuple[JointCard, ...]
    beta: tuple[ParameterCard, ...]
    friction: tuple[ParameterCard, ...]
    functions: tuple[FunctionSpec, ...]

    @property
    def size(self) -> int:
        """Return the number of joints."""
        return len(self.joints)


def find_specs(joints: int, beta: int, friction: int) -> tuple[FunctionSpec, ...]:
    """Return the catalogue for a robot with so many joints, base and friction parameters.

    Units are written for revolute joints; of a prismatic one read m for rad and N for N m.
    """
    n = joints

    def sample(name: str, unit: str, meaning: str, *shape: int) -> Port:
        return Port(name=name, shape=shape or (n,), unit=unit, meaning=meaning)

    q = sample("q", "rad", "joint coordinates")
    dq = sample("dq", "rad/s", "joint velocities")
    ddq = sample("ddq", "rad/s^2", "joint accelerations")
    dqr = sample("dqr", "rad/s", "reference velocities")
    ddqr = sample("ddqr", "rad/s^2", "reference accelerations")
    tau_in = sample("tau", "N m", "joint torques without friction")
    b = Port(name="beta", shape=(beta,), unit="mixed", meaning="base inertial parameters", shared=True)
    f = Port(name="f", shape=(friction,), unit="mixed", meaning="friction parameters", shared=True)

    def spec(name: str, meaning: str, inputs: tuple[Port, ...], *outputs: Port) -> FunctionSpec:
        return FunctionSpec(name=name, inputs=inputs, outputs=outputs, meaning=meaning)

    tau = sample("tau", "N m", "joint torques without friction")
    matrix = sample("M", "kg m^2", "mass matrix", n, n)
    rigid = (
        spec(
            "forward_kinematics",
            "pose of every link frame in the base frame",
            (q,),
            sample("R", "1", "rotation matrices, one a link", n, 3, 3),
            sample("P", "m", "origins, one a link", n, 3),
        ),
        spec(
            "jacobian",
            "geometric Jacobian of the last link frame, base axes: linear rows, then angular",
            (q,),
            sample("J", "m, 1", "Jacobian", 6, n),
        ),
        spec("mass_matrix", "joint-space mass matrix, rotor inertias included", (q, b), matrix),
        spec(
            "coriolis_matrix",
            "factor C of the Coriolis torque C dq for which dM/dt - 2 C is skew",
            (q, dq, b),
            sample("C", "kg m^2/s", "Coriolis matrix", n, n),
        ),
        spec("gravity", "gravity torque", (q, b), sample("g", "N m", "gravity torque")),
        spec(
            "bias", "Coriolis, centrifugal and gravity torque", (q, dq, b), sample("c", "N m", "bias torque")
        ),
        spec("inverse_dynamics", "torque that gives the acceleration ddq", (q, dq, ddq, b), tau),
        spec(
            "forward_dynamics",
            "acceleration under the torque tau",
            (q, dq, tau_in, b),
            sample("ddq", "rad/s^2", "joint accelerations"),
        ),
        spec(
            "inverse_dynamics_derivatives",
            "derivatives of the inverse dynamics",
            (q, dq, ddq, b),
            sample("dtau_dq", "N m/rad", "by position", n, n),
            sample("dtau_ddq", "N m s/rad", "by velocity", n, n),
            sample("dtau_dddq", "kg m^2", "by acceleration: the mass matrix", n, n),
        ),
        spec(
            "energy",
            "kinetic and potential energy, up to the constant that base parameters cannot know",
            (q, dq, b),
            sample("T", "J", "kinetic energy", 1),
            sample("V", "J", "potential energy", 1),
        ),
        spec(
            "energy_regressor",
            "kinetic and potential energy per base parameter",
            (q, dq),
            sample("hT", "mixed", "kinetic energy regressor", beta),
            sample("hV", "mixed", "potential energy regressor", beta),
        ),
        spec(
            "momentum_regressor",
            "generalised momentum dT/ddq per base parameter",
            (q, dq),
            sample("Yp", "mixed", "momentum regressor", n, beta),
        ),
        spec(
            "lagrange_regressor",
            "dL/dq = dT/dq - dV/dq per base parameter",
            (q, dq),
            sample("YL", "mixed", "regressor of dL/dq", n, beta),
        ),
        spec(
            "torque_regressor",
            "joint torque per base parameter",
            (q, dq, ddq),
            sample("Y", "mixed", "torque regressor", n, beta),
        ),
        spec(
            "slotine_li_regressor",
            "M ddqr + C dqr + g per base parameter",
            (q, dq, dqr, ddqr),
            sample("Yr", "mixed", "Slotine-Li regressor", n, beta),
        ),
    )
    joint = (
        spec(
            "friction",
            "friction torque, positive against positive velocity",
            (dq, f),
            sample("tau_f", "N m", "friction torques"),
        ),
        spec(
            "friction_regressor",
            "friction torque per friction parameter",
            (dq,),
            sample("Yf", "mixed", "friction regressor", n, friction),
        ),
    )
    # A function without outputs or without its parameters would be empty code.
    return rigid + joint if friction else rigid


def write_model_card(card: ModelCard) -> str:
    """Return the card as JSON text, the same text for the same card."""
    return json.dumps(asdict(card), indent=1, sort_keys=True) + "\n"


def read_model_card(text: str) -> ModelCard:
    """Return the card that `write_model_card` wrote.

    Raises:
        ValueError: the text is not JSON.
        KeyError, TypeError: it is not a model card.
    """
    data: dict[str, Any] = json.loads(text)

    def port(entry: Mapping[str, Any]) -> Port:
        return Port(**{**entry, "shape": tuple(entry["shape"])})

    def spec(entry: Mapping[str, Any]) -> FunctionSpec:
        return FunctionSpec(
            name=entry["name"],
            meaning=entry["meaning"],
            inputs=tuple(map(port, entry["inputs"])),
            outputs=tuple(map(port, entry["outputs"])),
        )

    return ModelCard(
        robot=data["robot"],
        signature=data["signature"],
        joints=tuple(JointCard(**entry) for entry in data["joints"]),
        beta=tuple(ParameterCard(**entry) for entry in data["beta"]),
        friction=tuple(ParameterCard(**entry) for entry in data["friction"]),
        functions=tuple(map(spec, data["functions"])),
    )


def find_model_signature(robot: Robot) -> str:
    """Return the signature of what the functions of `robot` depend on.

    Names, joints, placements, drives with a rotor, friction models, gravity and lengths; not the values of
    parameters (they are arguments), nor how its logs read.
    """
    joints = tuple(
        (joint.name, joint.kind, joint.parent, joint.placement, joint.drive.has_rotor, joint.friction.kind)
        for joint in robot.joints
    )
    return find_signature(robot.name, joints, robot.gravity, robot.symbols)
