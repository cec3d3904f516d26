"""The functions of a robot, and the model card that comes with generated code.

Shapes are those of one sample; in a batch, inputs and outputs that change from sample to sample get a
leading axis.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

from symid.robot import Coupling, Elasticity, Joint, Robot
from symid.serialization import compute_signature


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
        return math.prod(self.shape)


@dataclass(frozen=True, slots=True, kw_only=True)
class FunctionSpec:
    """A function of the catalogue: inputs, outputs, and its meaning in one sentence."""

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
    """A joint with a coordinate of its own.

    `number` is its place among all joints, from one; its link and its parameters have the same number.
    `smoothing` is the speed (rad/s or m/s) over which dry friction changes its sign, 0 for a jump.
    """

    number: int
    name: str
    kind: str
    friction: str
    smoothing: float = 0.0

    @property
    def torque_unit(self) -> str:
        """Return N m, or N for a prismatic joint."""
        return "N" if self.kind == "prismatic" else "N m"

    @property
    def position_unit(self) -> str:
        """Return rad, or m for a prismatic joint."""
        return "m" if self.kind == "prismatic" else "rad"


@dataclass(frozen=True, slots=True, kw_only=True)
class FollowerCard:
    """A joint that follows another one, `multiplier` times its motion."""

    number: int
    name: str
    kind: str
    master: str
    multiplier: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelCard:
    """The model behind a set of functions.

    Attributes:
        signature: see `compute_model_signature`.
        joints: those with a coordinate, in the order of the coordinates; `followers` are the others.
        beta: the base inertial parameters, drives included, in the order of the vector, with the values of
            the robot file where it states all of them; the standard parameters where `vector` is "pi".
        friction: the friction parameters in the order of the vector f. springs: the same of the vector h.
        elasticity: the spring of every coordinate in the robot file, empty where no joint is elastic.
        rotors: rotor inertias of elastic joints, which move with the motors and so are not in `beta`.
    """

    robot: str
    signature: str
    joints: tuple[JointCard, ...]
    beta: tuple[ParameterCard, ...]
    friction: tuple[ParameterCard, ...]
    functions: tuple[FunctionSpec, ...]
    vector: str = "beta"
    followers: tuple[FollowerCard, ...] = ()
    rotors: tuple[ParameterCard, ...] = ()
    elasticity: tuple[Elasticity | None, ...] = ()
    springs: tuple[ParameterCard, ...] = ()

    @property
    def elastic(self) -> bool:
        """Return whether every coordinate belongs to an elastic joint."""
        return bool(self.elasticity) and None not in self.elasticity

    @property
    def size(self) -> int:
        """Return the number of coordinates."""
        return len(self.joints)

    @property
    def links(self) -> int:
        """Return the number of moving links, one a joint."""
        return len(self.joints) + len(self.followers)


def write_model_card(card: ModelCard) -> str:
    """Return the card as JSON text, the same text for the same card; `read_record` reads it."""
    return json.dumps(asdict(card), indent=1, sort_keys=True) + "\n"


def compute_model_signature(robot: Robot, parameters: Sequence[tuple[str, str]]) -> str:
    """Return the signature of a model: parameter values of two models with the same one mean the same.

    The robot's structure counts, and name and expression of every base and friction parameter, in order.
    """

    def describe(joint: Joint) -> tuple[object, ...]:
        friction, driven = joint.friction, joint.drive.has_rotor
        fixed = (joint.name, joint.kind, joint.parent, joint.placement, driven, friction.kind)
        elastic = (joint.mimic, joint.spring is not None, joint.elasticity is not None)
        return (*fixed, friction.smoothing), elastic

    joints = tuple(map(describe, robot.joints))
    couplings = tuple(
        (entry.name, entry.terms, entry.has_rotor, entry.friction.kind) for entry in robot.couplings
    )
    # Only where there are any, so that models without them keep the signature of old estimates.
    owners: tuple[Joint | Coupling, ...] = (*robot.joints, *robot.couplings)
    curved = tuple(
        (owner.name, owner.friction.shape, owner.friction.smoothing)
        for owner in owners
        if owner.friction.shape
    )
    shapes = (curved,) if curved else ()
    return compute_signature(
        robot.name, joints, couplings, robot.gravity, robot.symbols, tuple(parameters), *shapes
    )
