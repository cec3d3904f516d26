"""The catalogue of functions, the vector h of the springs, and the model card of a robot.

The vector h holds, for every coordinate, k0, the cubic kc where the robot file states one, k and r of
every stop, s and R of every knee in the order of their thresholds. Names end in the number of the joint:
k0_1, k2_1, r2_1, s1_1, R1_1. Damping is not among them.

Supported: rigid robots with friction; robots all of whose joints are elastic; base or standard parameters,
rotor inertias of elastic joints and friction as constants. Units are those of revolute joints; for prismatic
ones read m for rad and N for N m.
Not supported: springs as constants; functions of hysteresis take h. Springs with branches, backlash or an
offset are no part of it: `element_code` writes them, a folder each.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.functions import (
    FollowerCard,
    FunctionSpec,
    JointCard,
    ModelCard,
    ParameterCard,
    Port,
    compute_model_signature,
)
from symid.errors import Notice, UsageError
from symid.joint_models import NO_FRICTION, Elasticity, count_states, get_friction_law
from symid.notation import get_unit
from symid.robot import (
    JointKind,
    Robot,
)

if TYPE_CHECKING:
    from symid.dynamics import BaseParameters

_SPRING_REASONS = {
    "k0": "stiffness when all stops slip",
    "kc": "hardening with the third power of the torsion",
    "k": "stiffness of a stop",
    "r": "torsion at which the stop slips",
    "s": "slope added beyond the knee",
    "R": "torque at which the knee begins",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class ElasticSizes:
    """Sizes of a robot with elastic joints only: `stops` is the length of P and Q, `springs` that of h.

    `invertible`: the springs have an inverse, as none has a cubic part. `feed`: motor torques follow from the
    motion of the links, as every motor has its own rotor, no spring is damped, nothing is coupled.
    """

    stops: int
    springs: int
    invertible: bool = True
    feed: bool = True


def count_elastic_sizes(robot: Robot) -> ElasticSizes | None:
    """Return the sizes of a robot all of whose joints have springs that h can hold, None of another."""
    found = [joint.elasticity for joint in robot.axes if joint.elasticity is not None]
    if len(found) < robot.freedom or not all(spring.is_plain for spring in found):
        return None
    invertible = not any(spring.cubic for spring in found)
    # What follows is a link without a motor: it must not brake one, nor give.
    alone = not robot.couplings and all(
        joint.elasticity is None and joint.friction.law == NO_FRICTION
        for joint in robot.joints
        if joint.mimic is not None
    )
    driven = all(joint.drive.has_rotor for joint in robot.axes)
    return ElasticSizes(
        stops=sum(len(spring.stops) for spring in found),
        springs=sum(len(_list_spring_entries(spring)) for spring in found),
        invertible=invertible,
        feed=invertible and driven and alone and not any(spring.damping for spring in found),
    )


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
            yield ParameterCard(
                name=name,
                expression=name,
                unit=get_unit(letter, prismatic=prismatic),
                reason=_SPRING_REASONS[letter],
                joint=joint.name,
                value=value,
            )


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
            text = (
                f"joint {joint.name!r}: the library expects {allowed}; this spring has {describe(given)}. "
                "Generate a library for it"
            )
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
# s stops, h parameters of springs, z deflections of bristles), unit, meaning.
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
    "load": ("n", "N m", "torques that the gears carry: those of links and rotors, without friction"),
    "temperature": ("n", "degC", "temperatures of the joints"),
    "way": ("n", "rad", "ways of the joints in the step, without turning back: dq times its period, if held"),
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
_SHARED = ("beta", "pi", "f", "IA", "h")
_OUTPUTS = {
    **_INPUTS,
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
    "hysteresis_step: phi P h -> tau_J P_next": "torque of the springs when the torsion has gone to phi, "
    "without turning back on the way",
    "hysteresis_inverse_step: tau_J Q h -> phi Q_next": "torsion of the springs when their torque has gone "
    "to tau_J, without turning back on the way",
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

LIMITED = frozenset(_FULL)
"""Functions that are not written for every robot, or only where they are named."""


def list_specs(
    joints: int,
    parameters: int,
    friction: int,
    *,
    links: int | None = None,
    vector: str = "beta",
    elastic: ElasticSizes | None = None,
    inputs: Collection[str] = (),
    bristles: int = 0,
) -> tuple[FunctionSpec, ...]:
    """Return the catalogue for numbers of coordinates, of inertial and of friction parameters.

    Functions and vectors that would be empty (no friction, no stops) are left out. `links` are the moving
    ones, by default as many as joints; `vector` is the name of the inertial parameters, beta or pi;
    `inputs` what friction depends on besides the velocity: "q", "load", "temperature"; `bristles` is the
    number of deflections that it remembers.
    """
    sizes = {"n": joints, "l": joints if links is None else links, "b": parameters, "p": friction}
    sizes |= {"s": elastic.stops if elastic else 0, "h": elastic.springs if elastic else 0, "z": bristles}
    offered = {
        **dict.fromkeys(("friction", "friction_regressor"), friction > 0),
        "friction_step": bristles > 0,
        **dict.fromkeys(_FULL, joints <= MOST_FULL),
        "hysteresis_step": elastic is not None,
        "hysteresis_inverse_step": elastic is not None and elastic.invertible,
        "elastic_inverse_dynamics": elastic is not None and elastic.feed,
    }

    def build_ports(names: str, known: Mapping[str, tuple[str, str, str]]) -> tuple[Port, ...]:
        ports = []
        for name in names.split():
            letters, unit, meaning = known[name]
            if letters in ("s", "p") and not sizes[letters]:
                continue
            shape = tuple(sizes[letter] if letter in sizes else int(letter) for letter in letters)
            ports.append(Port(name=name, shape=shape, unit=unit, meaning=meaning, shared=name in _SHARED))
        return tuple(ports)

    specs = []
    for entry, meaning in _ENTRIES.items():
        name, ports = entry.split(": ")
        if offered.get(name, True):
            given, found = ports.replace("beta", vector).split(" -> ")
            given = " ".join(port for port in given.split() if port not in _list_unread(name, inputs))
            ports_in, ports_out = build_ports(given, _INPUTS), build_ports(found, _OUTPUTS)
            specs.append(FunctionSpec(name=name, inputs=ports_in, outputs=ports_out, meaning=meaning))
    return tuple(specs)


def _list_unread(function: str, inputs: Collection[str]) -> set[str]:
    """Return the inputs that a function does not have, as no friction law reads them."""
    unread = {"load", "temperature"} - set(inputs)
    return unread | ({"q"} - set(inputs) if function.startswith("friction") else set())


FRICTION_INPUTS = {"position": "q", "load": "load", "temperature": "temperature"}
"""What laws read besides the velocity, and the input of functions that it is."""


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
    robot: Robot, base: "BaseParameters", names: Collection[str] | None = None
) -> tuple[FunctionSpec, ...]:
    """Return the catalogue for a robot and the base or standard parameters that its functions take.

    `names` are those of the functions wanted, None for all but `ON_REQUEST`; the order is that of the
    catalogue.

    Raises:
        UsageError: a name is not in the catalogue.
    """
    specs = list_specs(
        robot.freedom,
        base.count,
        len(base.friction),
        links=robot.size,
        vector=base.vector,
        elastic=count_elastic_sizes(robot),
        inputs=list_friction_inputs(robot),
        bristles=sum(count for _, count in list_bristles(robot)),
    )
    known = [spec.name for spec in specs]
    for name in names or ():
        if name not in known:
            text = f"function '{name}' is not in the catalogue; there are {', '.join(known)}"
            if name in _FULL:
                text = (
                    f"function '{name}' is written for {MOST_FULL} coordinates at most, the robot has "
                    f"{robot.freedom}: {_FULL[name]}"
                )
            raise UsageError(Notice(code="usage.unknown-function", text=text))
    wanted = [name for name in known if name not in ON_REQUEST] if names is None else names
    return tuple(spec for spec in specs if spec.name in wanted)


def _write_fraction(value: Fraction) -> str:
    # A decimal where a short one is exact, else a quotient.
    text = f"{float(value):g}"
    return text if Fraction(text) == value else str(value)


_TURNING = "the rotor turns with the motor, apart from the link"


def build_model_card(robot: Robot, base: "BaseParameters", specs: tuple[FunctionSpec, ...]) -> ModelCard:
    """Return what users of the functions must know of the model."""
    # Imported here: the rest of this module needs no SymPy.
    from symid.dynamics import compute_parameter_values, get_label_unit, get_owner

    values, numbered = compute_parameter_values(robot, base), list(enumerate(robot.joints, start=1))

    def describe(
        name: str, expression: str, label: tuple[int, str], reason: str, value: float | None
    ) -> ParameterCard:
        unit, joint = get_label_unit(robot, label), get_owner(robot, label)
        return ParameterCard(
            name=name, expression=expression, unit=unit, reason=reason, joint=joint, value=value
        )

    beta, friction = (
        tuple(describe(p.name, p.expression, p.label, p.reason, values.get(p.name)) for p in parameters)
        for parameters in (base.parameters, base.friction)
    )
    grouped = [(entry.name, entry.expression) for entry in (*base.parameters, *base.friction)]
    return ModelCard(
        robot=robot.name,
        signature=compute_model_signature(robot, grouped),
        joints=tuple(
            JointCard(
                number=number,
                name=joint.name,
                kind=joint.kind.value,
                friction=joint.friction.law,
                smoothing=joint.friction.smoothing,
            )
            for number, joint in numbered
            if joint.mimic is None
        ),
        beta=beta,
        friction=friction,
        functions=specs,
        vector=base.vector,
        followers=tuple(
            FollowerCard(
                number=number,
                name=joint.name,
                kind=joint.kind.value,
                master=robot.joints[joint.mimic.master].name,
                multiplier=_write_fraction(joint.mimic.multiplier),
            )
            for number, joint in numbered
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


Constants = Mapping[str, tuple[float, ...]]
"""Values of whole input ports by their name."""


def get_constants(card: ModelCard) -> Constants:
    """Return the values of all parameters that may be constants.

    Raises:
        UsageError: the robot file does not state all of them.
    """
    vectors = {card.vector: card.beta, "IA": card.rotors, "f": card.friction}
    missing = [entry.name for entries in vectors.values() for entry in entries if entry.value is None]
    if missing:
        text = (
            f"constants: the robot file has no value of {', '.join(missing)}. Add the values, or write "
            "identified ones into a robot file with `symid export`"
        )
        raise UsageError(Notice(code="usage.unknown-constants", text=text))
    return {name: tuple(entry.value or 0.0 for entry in entries) for name, entries in vectors.items()}
