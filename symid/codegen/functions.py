"""The functions of a robot: their catalogue, the vector h of the springs, and the model card.

Shapes are those of one sample; in a batch, inputs and outputs that change from sample to sample get a
leading axis. The vector h holds, for every coordinate, k0, the cubic kc where the robot file states one, k
and r of every stop, s and R of every knee in the order of their thresholds. Names end in the number of the
joint: k0_1, k2_1, r2_1, s1_1, R1_1. Damping is not among them.

Supported: rigid robots with friction; robots all of whose joints are elastic; base or standard parameters,
rotor inertias of elastic joints and friction as constants. Units are those of revolute joints; for prismatic
ones read m for rad and N for N m.
Not supported: springs as constants; functions of hysteresis take h. Springs with branches, backlash or an
offset are no part of it: `element_code` writes them, a folder each.
"""

import json
import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from enum import Enum
from fractions import Fraction
from typing import Any, Literal

import numpy as np

from symid import dynamics
from symid.arrays import FloatArray
from symid.errors import Notice, UsageError
from symid.joint_models import NO_FRICTION, Elasticity, FrictionValues, count_states, get_friction_law
from symid.notation import get_unit
from symid.robot import Coupling, Joint, JointKind, Mimic, Robot
from symid.serialization import compute_signature

FRICTION_INPUTS = {"position": "q", "load": "load", "temperature": "temperature"}
"""What laws read besides the velocity, and the input of functions that it is."""
_TURNING = "the rotor turns with the motor, apart from the link"
Constants = Mapping[str, tuple[float, ...]]
"""Values of whole input ports by their name."""
# Laws of the first robot files, and the curved ones among them, as they stand in signatures, which stored
# estimates have: a name, and the class that once had it.
_OLD_KINDS = ("none", "viscous_coulomb", "viscous_coulomb_offset", "asymmetric")
_OLD_CURVES = (
    *("stribeck", "stribeck_offset", "improved_stribeck", "asymmetric_stribeck"),
    *("cubic", "stribeck_cubic", "power_law", "makkar"),
)
_ENUM: Any = Enum
_OLD_NAMES: dict[str, Enum] = {
    entry.value: entry
    for title, names in (("FrictionKind", _OLD_KINDS), ("CurvedFriction", _OLD_CURVES))
    for entry in _ENUM(title, [(name, name) for name in names])
}
_SPRING_REASONS = {
    "k0": "stiffness when all stops slip",
    "kc": "hardening with the third power of the torsion",
    "k": "stiffness of a stop",
    "r": "torsion at which the stop slips",
    "s": "slope added beyond the knee",
    "R": "torque at which the knee begins",
}


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


@dataclass(frozen=True, slots=True)
class ParameterCard:
    """A parameter that can be identified: its name, what it groups, its unit, and why."""

    name: str
    expression: str
    unit: str
    reason: str
    joint: str
    value: float | None = None


@dataclass(frozen=True, slots=True)
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


@dataclass(frozen=True, slots=True)
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
            the robot file where it states all of them; the standard parameters where `vector` is another.
        friction: the friction parameters in the order of the vector f. springs: the same of the vector h.
        elasticity: the spring of every coordinate in the robot file, empty where no joint is elastic.
        rotors: rotor inertias of elastic joints, which move with the motors and so are not in `beta`.
        friction_inputs: what friction depends on besides dq: q, load, temperature.
        searched: what a fit refines besides, with the values it starts from: shape values of friction laws,
            and those of `Library.tangents`, which belong to no joint's law.
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
            text = f"the friction of robot {self.robot!r} depends on the {' and the '.join(missing)} of the "
            text += "joints, which is not known here: give it in the log, or use another friction law"
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
    def count(self) -> int:
        """Return the number of inertial parameters."""
        return len(self.beta)

    @property
    def size(self) -> int:
        """Return the number of coordinates."""
        return len(self.joints)

    @property
    def links(self) -> int:
        """Return the number of moving links, one a joint."""
        return len(self.joints) + len(self.followers)


def compute_build_digest(card: ModelCard, *, prefix: str, precision: str, files: Mapping[str, str]) -> str:
    """Return the digest of all that fixes the interface of a library and its numbers.

    Of `files`, digests by path, headers and functions count; the file that holds this digest does not.
    """
    names = (path for path in files if path.startswith(f"{prefix}_") and path.endswith((".c", ".h")))
    counted = {f"{prefix}.h", *names} - {f"{prefix}_info.c"}
    compiled = {path: digest for path, digest in files.items() if path in counted}
    text = json.dumps(asdict(card), indent=1, sort_keys=True) + "\n"
    return compute_signature(prefix, precision, text, compiled)


def compute_model_signature(robot: Robot, parameters: Sequence[tuple[str, str]]) -> str:
    """Return the signature of a model: parameter values of two models with the same one mean the same.

    The robot's structure counts, and name and expression of every base and friction parameter, in order.
    """

    def describe(joint: Joint) -> tuple[object, ...]:
        law, _ = _name_for_signature(joint.friction)
        fixed = (joint.name, joint.kind, joint.parent, joint.placement, joint.drive.has_rotor, law)
        elastic = (joint.mimic, joint.spring is not None, joint.elasticity is not None)
        return (*fixed, joint.friction.smoothing), elastic

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
    parts = (joints, couplings, robot.gravity, robot.symbols, tuple(parameters), *shapes)
    return compute_signature(robot.name, *parts)


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


def _list_spring_entries(elasticity: Elasticity) -> list[tuple[str, int, float | None]]:
    """Return letter, place among its like (0 if there is one only) and value of every entry of a spring."""
    entries: list[tuple[str, int, float | None]] = [("k0", 0, elasticity.stiffness)]
    if elasticity.cubic:
        entries.append(("kc", 0, elasticity.cubic))
    for place, stop in enumerate(elasticity.stops, start=1):
        entries += [("k", place, stop.stiffness), ("r", place, stop.threshold)]
    for place, knee in enumerate(elasticity.knees, start=1):
        entries += [("s", place, knee.slope), ("R", place, knee.threshold)]
    return entries


def list_spring_parameters(robot: Robot) -> Iterator[ParameterCard]:
    """Yield the entries of h with the values of the robot file."""
    for number, joint in enumerate(robot.joints, start=1):
        if joint.elasticity is None or joint.mimic is not None or not joint.elasticity.is_plain:
            continue
        prismatic = joint.kind is JointKind.PRISMATIC
        for letter, place, value in _list_spring_entries(joint.elasticity):
            name = f"{letter}{place or ''}_{number}"
            unit, reason = get_unit(letter, prismatic=prismatic), _SPRING_REASONS[letter]
            yield ParameterCard(name, name, unit, reason, joint.name, value)


def build_spring_vector(elasticities: Sequence[Elasticity], card: ModelCard | None = None) -> FloatArray:
    """Return h of springs whose numbers are all known, one a coordinate.

    `card` is that of the library that shall take h, whose springs must be built alike; None: not checked.

    Raises:
        UsageError: a number is unknown, or the springs have other parts than those of `card`.
    """

    def describe(elasticity: Elasticity) -> str:
        """Return what the places of entries in h depend on."""
        below = sum(knee.threshold < 0 for knee in elasticity.knees)
        above, cubic = len(elasticity.knees) - below, int(bool(elasticity.cubic))
        return f"{cubic} cubic parts, {len(elasticity.stops)} stops, {below} knees below and {above} above"

    parts = zip(card.joints, card.elasticity, elasticities, strict=True) if card else ()
    for joint, wanted, given in parts:
        allowed = describe(wanted) if wanted else "no spring"
        if allowed != describe(given):
            text = f"joint {joint.name!r}: the library expects {allowed}; this spring has {describe(given)}. "
            text += "Generate a library for it"
            raise UsageError(Notice(code="usage.spring-layout", text=text))
    if not all(elasticity.is_plain for elasticity in elasticities):
        text = "h holds springs with stops and knees; one has branches, backlash or an offset"
        raise UsageError(Notice(code="usage.spring-layout", text=text))
    entries = [entry for elasticity in elasticities for entry in _list_spring_entries(elasticity)]
    values = [value for _, _, value in entries if value is not None]
    if len(values) < len(entries):
        text = "a stiffness of an elastic joint is unknown; give it, or identify it first"
        raise UsageError(Notice(code="usage.unknown-spring", text=text))
    return np.array(values)


# Name: shape in letters (n coordinates, l links, b inertial and p friction parameters,
# s stops, h parameters of springs, z deflections of bristles, a coordinates with a motor, u without one,
# v the same where one of them has friction), unit, meaning.
_INPUTS = {
    "q": ("n", "rad", "joint coordinates"),
    "dq": ("n", "rad/s", "joint velocities"),
    "ddq": ("n", "rad/s^2", "joint accelerations"),
    "dqr": ("n", "rad/s", "reference velocities"),
    "ddqr": ("n", "rad/s^2", "reference accelerations"),
    "tau": ("n", "N m", "joint torques without friction"),
    "ddq_a": ("a", "rad/s^2", "accelerations of the joints with a motor"),
    "tau_a": ("a", "N m", "torques of the joints with a motor, without friction"),
    "tau_p": ("v", "N m", "torques of the joints without a motor: less their friction"),
    "beta": ("b", "mixed", "base inertial parameters"),
    "pi": ("b", "mixed", "standard parameters of links, drives and springs"),
    "pi_internal": ("b", "mixed", "standard parameters of links in internal frames, of drives and springs"),
    "f": ("p", "mixed", "friction parameters"),
    "load": ("n", "N m", "torques that the gears carry: those of links and rotors, without friction"),
    "temperature": ("n", "degC", "temperatures of the joints"),
    "way": (
        "n",
        "rad",
        "displacements of the joints in the step, without reversal: dq times its period",
    ),
    "z": ("z", "rad", "deflections of the bristles before the step"),
    "dddq": ("n", "rad/s^3", "third derivatives of the joint coordinates"),
    "ddddq": ("n", "rad/s^4", "fourth derivatives of the joint coordinates"),
    "phi": ("n", "rad", "torsions theta - q"),
    "P": ("s", "rad", "plays of the torsions before the step"),
    "tau_J": ("n", "N m", "torques of the springs"),
    "Q": ("s", "N m", "plays of the inverse before the step"),
    "IA": ("n", "kg m^2", "rotor inertias on the joint side"),
    "h": ("h", "mixed", "parameters of the springs"),
}
_SHARED = ("beta", "pi", "pi_internal", "f", "IA", "h")
_OUTPUTS = {
    **_INPUTS,
    "ddq_p": ("u", "rad/s^2", "accelerations of the joints without a motor"),
    "R": ("l33", "1", "rotation matrices, one a link"),
    "P": ("l3", "m", "origins, one a link"),
    "J": ("6n", "m, 1", "Jacobian"),
    "M": ("nn", "kg m^2", "mass matrix"),
    "C": ("nn", "kg m^2/s", "Coriolis matrix"),
    "g": ("n", "N m", "gravity torque"),
    "c": ("n", "N m", "bias torque"),
    "dtau_dq": ("nn", "N m/rad", "by position"),
    "dtau_ddq": ("nn", "N m s/rad", "by velocity"),
    "dtau_dddq": ("nn", "kg m^2", "by acceleration: the mass matrix"),
    "dM_dq": ("nnn", "kg m^2/rad", "entry (i, j, k): of M_ij by q_k"),
    "d2tau_dq2": ("nnn", "N m/rad^2", "entry (i, j, k): of tau_i by q_j and q_k"),
    "d2tau_dq_ddq": ("nnn", "N m s/rad^2", "entry (i, j, k): of tau_i by q_j and dq_k"),
    "d2tau_ddq2": ("nnn", "N m s^2/rad^2", "entry (i, j, k): of tau_i by dq_j and dq_k"),
    "dddq_dq": ("nn", "1/s^2", "by position"),
    "dddq_ddq": ("nn", "1/s", "by velocity"),
    "dddq_dtau": ("nn", "1/(kg m^2)", "by torque: the inverse of the mass matrix"),
    "T": ("1", "J", "kinetic energy"),
    "V": ("1", "J", "potential energy"),
    "hT": ("b", "mixed", "kinetic energy regressor"),
    "hV": ("b", "mixed", "potential energy regressor"),
    "Yp": ("nb", "mixed", "momentum regressor"),
    "YL": ("nb", "mixed", "regressor of dL/dq"),
    "Y": ("nb", "mixed", "torque regressor"),
    "dY_dq": ("nbn", "mixed", "entry (i, j, k): of Y_ij by q_k"),
    "dY_ddq": ("nbn", "mixed", "entry (i, j, k): of Y_ij by dq_k"),
    "dY_dddq": ("nbn", "mixed", "entry (i, j, k): of Y_ij by ddq_k; times beta_j, summed over j, M_ik"),
    "Yr": ("nb", "mixed", "Slotine-Li regressor"),
    "tau_f": ("n", "N m", "friction torques"),
    "Yf": ("np", "mixed", "friction regressor"),
    "z_next": ("z", "rad", "deflections of the bristles after the step"),
    "tau_J": ("n", "N m", "torques of the springs without damping"),
    "P_next": ("s", "rad", "plays of the torsions after the step"),
    "Q_next": ("s", "N m", "plays of the inverse after the step"),
    "tau_m": ("n", "N m", "torques of the motors, joint side"),
    "theta": ("n", "rad", "motor coordinates on the joint side"),
    "dtheta": ("n", "rad/s", "motor velocities on the joint side"),
}

# Name: inputs -> outputs, and the meaning.
_ENTRIES = {
    "forward_kinematics: q -> R P": "pose of every link frame in the base frame",
    "jacobian: q -> J": "geometric Jacobian of the last link frame, base axes: linear rows, then angular",
    "mass_matrix: q beta -> M": "joint-space mass matrix, rotor inertias included",
    "coriolis_matrix: q dq beta -> C": "factor C of the Coriolis torque C dq for which dM/dt - 2 C is skew",
    "gravity: q beta -> g": "gravity torque",
    "bias: q dq beta -> c": "Coriolis, centrifugal and gravity torque",
    "inverse_dynamics: q dq ddq beta -> tau": "torque that gives the acceleration ddq",
    "forward_dynamics: q dq tau beta -> ddq": "acceleration under the torque tau",
    "partial_inverse_dynamics: q dq ddq_a tau_p beta -> tau_a ddq_p": "torque of joints with a motor that "
    "gives them the acceleration ddq_a, and how those without one then accelerate",
    "partial_forward_dynamics: q dq tau_a tau_p beta -> ddq": "acceleration of all joints under the "
    "torque of those with a motor",
    "inverse_dynamics_derivatives: q dq ddq beta -> dtau_dq dtau_ddq dtau_dddq": "derivatives of "
    "the inverse dynamics",
    "forward_dynamics_derivatives: q dq tau beta -> ddq dddq_dq dddq_ddq dddq_dtau": "acceleration under "
    "the torque tau, and its derivatives",
    "mass_matrix_derivatives: q beta -> dM_dq": "derivative of the mass matrix by the position; the "
    "Christoffel symbols are c_ijk = (dM_ij/dq_k + dM_ik/dq_j - dM_jk/dq_i) / 2",
    "inverse_dynamics_second_derivatives: q dq ddq beta -> d2tau_dq2 d2tau_dq_ddq d2tau_ddq2 dM_dq": "second "
    "derivatives of the inverse dynamics; those by q and ddq are dM_dq",
    "energy: q dq beta -> T V": "kinetic and potential energy, up to the constant that base "
    "parameters cannot know",
    "energy_regressor: q dq -> hT hV": "kinetic and potential energy per base parameter",
    "momentum_regressor: q dq -> Yp": "generalised momentum dT/ddq per base parameter",
    "lagrange_regressor: q dq -> YL": "dL/dq = dT/dq - dV/dq per base parameter",
    "torque_regressor: q dq ddq -> Y": "joint torque per base parameter",
    "torque_regressor_derivatives: q dq ddq -> dY_dq dY_ddq dY_dddq": "derivatives of the torque regressor",
    "slotine_li_regressor: q dq dqr ddqr -> Yr": "M ddqr + C dqr + g per base parameter",
    "friction: dq q load temperature f -> tau_f": "friction torque, positive against positive velocity",
    "friction_regressor: dq q load temperature -> Yf": "friction torque per friction parameter",
    "friction_step: dq way z q load temperature f -> tau_f z_next": "friction torque after a step, with the "
    "state of bristles; `friction` is that of steady sliding",
    "hysteresis_step: phi P h -> tau_J P_next": "torque of the springs when the torsion has moved to phi, "
    "without reversal",
    "hysteresis_inverse_step: tau_J Q h -> phi Q_next": "torsion of the springs when their torque has gone "
    "to tau_J, without reversal",
    "elastic_inverse_dynamics: q dq ddq dddq ddddq temperature beta IA f h Q "
    "-> tau_m theta dtheta Q_next": "torque of the motors under which the links move as wanted, with "
    "friction",
}


MOST_FULL = 16
"""Most coordinates for functions of full matrices or tensors: n^3 entries, or 2 n^3 products."""
ON_REQUEST = frozenset({"inverse_dynamics_second_derivatives", "torque_regressor_derivatives"})
"""Functions that are as long as all others together: they are written where they are named."""
FOR_CONTROLLERS = frozenset(
    {
        "coriolis_matrix",
        "slotine_li_regressor",
        "mass_matrix_derivatives",
        "inverse_dynamics_derivatives",
        "forward_dynamics_derivatives",
    }
)
"""Functions that symid's own methods do not call, more than half of what a C compiler has to do."""
_FULL = {
    "forward_dynamics_derivatives": "solve M x = r with the blocks of inverse_dynamics_derivatives",
    "inverse_dynamics_second_derivatives": "differentiate inverse_dynamics_derivatives in CasADi",
    "torque_regressor_derivatives": "differentiate torque_regressor in CasADi",
    "mass_matrix_derivatives": "the Coriolis matrix at unit velocities has the same symbols",
}


def find_parameter_axis(output: str) -> int | None:
    """Return which axis of an output counts inertial parameters, None without one."""
    letters = _OUTPUTS[output][0]
    return letters.index("b") if "b" in letters else None


Standard = bool | Literal["internal"]
"""Whether functions take standard parameters, and of links in internal frames in place of the file's."""

PARTIAL = ("partial_inverse_dynamics", "partial_forward_dynamics")
"""Functions of robots some of whose joints have no motor."""
LIMITED = frozenset((*_FULL, *PARTIAL))
"""Functions that are not written for every robot, or only where they are named."""


def list_specs(
    sizes: Mapping[str, int],
    *,
    vector: str = "beta",
    inputs: Collection[str] = (),
    without: Collection[str] = (),
) -> tuple[FunctionSpec, ...]:
    """Return the catalogue for `sizes` by the letters of shapes, zero where there is none.

    Functions and vectors that would be empty (no friction, no stops), and those called `without`, are left
    out. `vector` is the name of the inertial parameters, beta, pi or pi_internal; `inputs` what friction
    depends on besides the velocity: "q", "load", "temperature".
    """
    sizes = {**dict.fromkeys("nlbpshzauv", 0), **sizes}
    # What functions need to be there.
    springs = ("hysteresis_step", "hysteresis_inverse_step", "elastic_inverse_dynamics")
    offered = {
        **dict.fromkeys(("friction", "friction_regressor"), sizes["p"] > 0),
        **dict.fromkeys(_FULL, sizes["n"] <= MOST_FULL),
        **dict.fromkeys(springs, sizes["h"] > 0),
        "friction_step": sizes["z"] > 0,
        **dict.fromkeys(PARTIAL, sizes["a"] * sizes["u"] > 0),
        **dict.fromkeys(without, False),
    }

    def build_ports(names: Sequence[str], known: Mapping[str, tuple[str, str, str]]) -> tuple[Port, ...]:
        ports = []
        for name in names:
            letters, unit, meaning = known[name]
            if letters in ("s", "p", "v") and not sizes[letters]:
                continue
            shape = tuple(sizes[letter] if letter in sizes else int(letter) for letter in letters)
            ports.append(Port(name=name, shape=shape, unit=unit, meaning=meaning, shared=name in _SHARED))
        return tuple(ports)

    specs = []
    for entry, meaning in _ENTRIES.items():
        name, ports = entry.split(": ")
        if offered.get(name, True):
            given, found = ports.replace("beta", vector).split(" -> ")
            # Inputs that no friction law reads are left out.
            doubtful = {"load", "temperature", *(["q"] if name.startswith("friction") else [])}
            kept = [port for port in given.split() if port not in doubtful or port in inputs]
            taken, outputs = build_ports(kept, _INPUTS), build_ports(found.split(), _OUTPUTS)
            specs.append(FunctionSpec(name=name, inputs=taken, outputs=outputs, meaning=meaning))
    return tuple(specs)


def list_friction_inputs(robot: Robot) -> tuple[str, ...]:
    """Return the inputs of the functions of friction besides dq, in their order."""
    laws = [law for joint in robot.joints if (law := get_friction_law(joint.friction)) is not None]
    return tuple(port for name, port in FRICTION_INPUTS.items() if any(name in law.inputs for law in laws))


def list_bristles(robot: Robot) -> tuple[tuple[int, int], ...]:
    """Return the number of each joint with a coordinate (from 0), and how many deflections it has, if any."""
    joints = ((index, robot.joints[index].friction) for index in robot.coordinates)
    counts = ((index, count_states(get_friction_law(friction), friction)) for index, friction in joints)
    return tuple((index, count) for index, count in counts if count)


def list_robot_specs(
    robot: Robot, base: "dynamics.BaseParameters | ModelCard", names: Collection[str] | None = None
) -> tuple[FunctionSpec, ...]:
    """Return the catalogue for a robot and the base or standard parameters that its functions take.

    `names` are those of the functions wanted, None for all but `ON_REQUEST`; the order is that of the
    catalogue.

    Raises:
        UsageError: a name is not in the catalogue.
    """
    springs = [joint.elasticity for joint in robot.axes if joint.elasticity is not None]
    if len(springs) < robot.freedom or not all(spring.is_plain for spring in springs):
        # None that h can hold.
        springs = []
    # Motor torques follow from the motion of links where every motor has its own rotor, no spring is damped
    # and nothing is coupled; a link without a motor, which follows, must not brake one, nor give.
    alone = not robot.couplings and all(
        joint.elasticity is None and joint.friction.law == NO_FRICTION
        for joint in robot.joints
        if joint.mimic is not None
    )
    driven = alone and all(joint.drive.has_rotor for joint in robot.axes)
    without = [] if driven and not any(spring.damping for spring in springs) else ["elastic_inverse_dynamics"]
    if any(spring.cubic for spring in springs):
        # Such a spring has no inverse.
        without += ["hysteresis_inverse_step", "elastic_inverse_dynamics"]
    braked = any(robot.axes[position].friction.law != NO_FRICTION for position in robot.passive)
    specs = list_specs(
        {
            "n": robot.freedom,
            "l": robot.size,
            "b": base.count,
            "p": len(base.friction),
            "s": sum(len(spring.stops) for spring in springs),
            "h": sum(len(_list_spring_entries(spring)) for spring in springs),
            "z": sum(count for _, count in list_bristles(robot)),
            "a": len(robot.driven),
            "u": len(robot.passive),
            "v": len(robot.passive) if braked else 0,
        },
        vector=base.vector,
        inputs=list_friction_inputs(robot),
        without=without,
    )
    known = [spec.name for spec in specs]
    for name in names or ():
        if name not in known:
            text = f"function '{name}' is not in the catalogue; there are {', '.join(known)}"
            if name in _FULL:
                text = f"function '{name}' is written for {MOST_FULL} coordinates at most, the robot has "
                text += f"{robot.freedom}: {_FULL[name]}"
            raise UsageError(Notice(code="usage.unknown-function", text=text))
    wanted = [name for name in known if name not in ON_REQUEST] if names is None else names
    return tuple(spec for spec in specs if spec.name in wanted)


def build_model_card(
    robot: Robot, base: "dynamics.BaseParameters", specs: tuple[FunctionSpec, ...]
) -> ModelCard:
    """Return what users of the functions must know of the model."""
    values, numbered = dynamics.compute_parameter_values(robot, base), [*enumerate(robot.joints, start=1)]

    def describe_motion(follow: Mimic) -> tuple[str, str]:
        # The multiplier is a decimal where a short one is exact, else a quotient.
        value, text = follow.multiplier, f"{float(follow.multiplier):g}"
        return robot.joints[follow.master].name, text if Fraction(text) == value else str(value)

    def describe(
        name: str, expression: str, label: tuple[int, str], reason: str, value: float | None
    ) -> ParameterCard:
        unit, joint = dynamics.get_label_unit(robot, label), dynamics.get_owner(robot, label)
        return ParameterCard(name, expression, unit, reason, joint, value)

    beta, friction = (
        tuple(describe(p.name, p.expression, p.label, p.reason, values.get(p.name)) for p in parameters)
        for parameters in (base.parameters, base.friction)
    )
    grouped = [(entry.name, entry.expression) for entry in (*base.parameters, *base.friction)]
    return ModelCard(
        robot=robot.name,
        signature=compute_model_signature(robot, grouped),
        joints=tuple(
            JointCard(n, joint.name, joint.kind.value, joint.friction.law, joint.friction.smoothing)
            for n, joint in numbered
            if joint.mimic is None
        ),
        beta=beta,
        friction=friction,
        functions=specs,
        vector=base.vector,
        followers=tuple(
            FollowerCard(n, joint.name, joint.kind.value, *describe_motion(joint.mimic))
            for n, joint in numbered
            if joint.mimic is not None
        ),
        rotors=tuple(
            describe(f"IA{n}", f"IA{n}", (n - 1, "IA"), _TURNING, joint.drive.rotor_inertia)
            for n, joint in numbered
            if joint.elasticity is not None and joint.drive.has_rotor
        ),
        elasticity=tuple(joint.elasticity for joint in robot.axes) if any(robot.elastic) else (),
        springs=tuple(list_spring_parameters(robot)) if all(robot.elastic) else (),
        friction_inputs=list_friction_inputs(robot),
    )


def get_constants(card: ModelCard) -> Constants:
    """Return the values of all parameters that may be constants; a UsageError where one is unknown."""
    vectors = {card.vector: card.beta, "IA": card.rotors, "f": card.friction}
    missing = [entry.name for entries in vectors.values() for entry in entries if entry.value is None]
    if missing:
        text = f"constants: the robot file has no value of {', '.join(missing)}. Add the values, or write "
        text += "identified ones into a robot file with `symid export`"
        raise UsageError(Notice(code="usage.unknown-constants", text=text))
    return {name: tuple(entry.value or 0.0 for entry in entries) for name, entries in vectors.items()}
