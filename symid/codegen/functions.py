"""The functions of a robot, and the model card that comes with generated code.

Shapes are those of one sample; in a batch, inputs and outputs that change from sample to sample get a
leading axis.
"""

import json
import math
import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from enum import Enum

from symid.arrays import FloatArray
from symid.errors import Notice, UsageError
from symid.joint_models import Elasticity, FrictionValues
from symid.robot import (
    Coupling,
    Joint,
    Robot,
)
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
        friction_inputs: what friction depends on besides dq: q, load, temperature.
        searched: shape values of friction laws that a fit refines, with the values it starts from.
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
    friction_inputs: tuple[str, ...] = ()
    searched: tuple[ParameterCard, ...] = ()

    @property
    def fitted(self) -> tuple[ParameterCard, ...]:
        """Return the unknowns of equations: base and friction parameters, shape values that are searched."""
        return (*self.beta, *self.friction, *self.searched)

    def gather_friction_inputs(self, dq: FloatArray, **given: FloatArray | None) -> tuple[FloatArray, ...]:
        """Return the motion that friction depends on, in the order of its functions' inputs.

        Velocities, and of what is given - positions q, `load`, `temperature` - what laws read, all of one
        shape. A UsageError where a law reads what is not given.
        """
        missing = [name for name in self.friction_inputs if given.get(name) is None]
        if missing:
            text = (
                f"the friction of robot {self.robot!r} depends on the {' and the '.join(missing)} of the "
                "joints, which is not known here: give it in the log, or use another friction law"
            )
            raise UsageError(Notice(code="friction.input", text=text))
        return (dq, *(value for name in self.friction_inputs if (value := given[name]) is not None))

    @property
    def elastic(self) -> bool:
        """Return whether every coordinate belongs to an elastic joint."""
        return bool(self.elasticity) and None not in self.elasticity

    @property
    def yielding(self) -> tuple[bool, ...]:
        """Return for every coordinate whether it belongs to an elastic joint."""
        return tuple(entry is not None for entry in self.elasticity) or (False,) * self.size

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
        fixed = (
            joint.name,
            joint.kind,
            joint.parent,
            joint.placement,
            driven,
            _name_for_signature(friction)[0],
        )
        elastic = (joint.mimic, joint.spring is not None, joint.elasticity is not None)
        return (*fixed, friction.smoothing), elastic

    joints = tuple(map(describe, robot.joints))
    couplings = tuple(
        (entry.name, entry.terms, entry.has_rotor, _name_for_signature(entry.friction)[0])
        for entry in robot.couplings
    )
    # Only where there are any, so that models without them keep the signature of old estimates.
    owners: tuple[Joint | Coupling, ...] = (*robot.joints, *robot.couplings)
    curved = tuple(
        (owner.name, _name_for_signature(owner.friction)[1], owner.friction.smoothing)
        for owner in owners
        if owner.friction.shape
    )
    shapes = (curved,) if curved else ()
    return compute_signature(
        robot.name, joints, couplings, robot.gravity, robot.symbols, tuple(parameters), *shapes
    )


class FrictionKind(Enum):
    """Laws of the first robot files as they stand in signatures, which stored estimates have."""

    NONE = "none"
    VISCOUS_COULOMB = "viscous_coulomb"
    VISCOUS_COULOMB_OFFSET = "viscous_coulomb_offset"
    ASYMMETRIC = "asymmetric"


class CurvedFriction(Enum):
    """The same of curved laws."""

    STRIBECK = "stribeck"
    STRIBECK_OFFSET = "stribeck_offset"
    IMPROVED_STRIBECK = "improved_stribeck"
    ASYMMETRIC_STRIBECK = "asymmetric_stribeck"
    CUBIC = "cubic"
    STRIBECK_CUBIC = "stribeck_cubic"
    POWER_LAW = "power_law"
    MAKKAR = "makkar"


_OLD_NAMES: dict[str, Enum] = {entry.value: entry for entry in (*FrictionKind, *CurvedFriction)}


def _name_for_signature(friction: FrictionValues) -> tuple[object, tuple[float, ...]]:
    """Return the law and its shape values as signatures have them: an exponent among the values."""
    name = friction.law
    gamma: tuple[float, ...] = (2.0,)
    if "-exponent" in name:
        name, gamma = name.replace("-exponent", ""), ()
    elif "tustin" in name or re.search(r"-1(?=\+|$)", name):
        name, gamma = re.sub(r"-1(?=\+|$)", "", name.replace("tustin", "stribeck")), (1.0,)
    plain = name.replace("coulomb-viscous", "viscous_coulomb").replace("+", "_").replace("-", "_")
    if plain not in _OLD_NAMES:
        return friction.law, friction.shape
    return _OLD_NAMES[plain], (*friction.shape, *gamma) if "stribeck" in plain else friction.shape
