"""The functions of a robot as their users see them, and the model card that travels with generated code.

Catalogue specs, names and reasons of the parameters -> `ModelCard`, as an object and as JSON, so that
users of a library need neither the robot file nor SymPy.

Shapes are those of one sample; in a batch, inputs and outputs that change from sample to sample get a
leading axis.
"""

import json
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
    """What a user of the functions must know of a joint with a coordinate of its own.

    `number` is its place among all joints, from one: it is in the names of its parameters, and its link
    is the one of that number. `smoothing` is the speed (rad/s or m/s) over which dry friction changes its
    sign, 0 where it jumps.
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
    """A joint without a coordinate: its place among all joints, and what it follows how many times."""

    number: int
    name: str
    kind: str
    master: str
    multiplier: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelCard:
    """The model behind a set of functions; `signature` is that of `compute_model_signature`.

    `joints` are the joints with a coordinate, in the order of the coordinates; `followers` the others.
    `beta` describes the base inertial parameters (drives included), `friction` the friction
    parameters; both in the order of the vectors of the same names. Values are those of the
    robot file, where it states all of them. `vector` is "beta", or "pi" where functions take all
    standard parameters, which `beta` then lists. `elasticity` holds what the robot file says of every
    coordinate's spring, empty where no joint is elastic; `rotors` are the rotor inertias of elastic joints,
    which move with their motors and so take no part in `beta`; `springs` describes the vector h.
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
    """Return the signature of a model: what two sets of numbers must share to mean the same.

    Args:
        robot: names, joints, placements, drives with a rotor, friction models, which joints are elastic,
            gravity and lengths count; not the values of parameters (they are arguments), nor how logs read.
        parameters: name and expression of every base and friction parameter, in order.
    """
    joints = tuple(
        (
            (
                joint.name,
                joint.kind,
                joint.parent,
                joint.placement,
                joint.drive.has_rotor,
                joint.friction.kind,
                joint.friction.smoothing,
            ),
            (joint.mimic, joint.spring is not None, joint.elasticity is not None),
        )
        for joint in robot.joints
    )
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
