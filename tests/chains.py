"""Robots for tests: chains and trees from a few numbers, and Pinocchio's model of any robot."""

import dataclasses
import re
from collections.abc import Sequence
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import strategies as st
from sympy import QQ

from symid.codegen.equation_routes import build_workspace
from symid.codegen.routes import list_routes
from symid.joint_models import FrictionValues
from symid.notation import INERTIAL
from symid.robot.description import Coupling, Drive, Joint, JointKind, Limits, Mimic, Robot, Spring
from symid.robot.geometry import IDENTITY, Angle, Exact, Placement, build_exact_angle, place_modified_dh


def import_pinocchio():
    """Return the library, or skip the test that wants it."""
    return pytest.importorskip("pinocchio", reason="wants the package pin")


# Pinocchio orders m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz; ours is XX XY XZ YY YZ ZZ MX MY MZ M.
FROM_PINOCCHIO = [4, 5, 7, 6, 8, 9, 1, 2, 3, 0]
PLAIN_LAWS = ("none", "coulomb-viscous", "coulomb-viscous-offset", "asymmetric")
"""Friction that is a sum of v, |v|, sign(v) and one."""


def build_joint(index: int, row: Sequence[object], *, parent: int | None = None, **fields) -> Joint:
    """Return the joint of a modified DH row (alpha, a, d, theta) whose variable is written `q`."""
    alpha, a, d, theta = row
    revolute = theta == "q"

    def length(value: object) -> Exact:
        if value == "q":
            return Exact()
        return Exact.symbol(value) if isinstance(value, str) else Exact.of(value)

    placement = place_modified_dh(
        build_exact_angle(alpha), length(a), length(d), build_exact_angle(0.0 if revolute else theta)
    )
    kind = JointKind.REVOLUTE if revolute else JointKind.PRISMATIC
    before = index - 1 if parent is None else parent
    return Joint(name=f"joint{index + 1}", kind=kind, parent=before, placement=placement, **fields)


def build_chain(
    rows: Sequence[Sequence[object]],
    *,
    gravity: tuple[str, str, str] = ("0", "0", "-9.81"),
    rotors: bool = False,
    friction: str = "none",
    name: str = "chain",
) -> Robot:
    """Return a chain of modified DH rows."""
    fields = {"drive": Drive(has_rotor=rotors), "friction": FrictionValues(law=friction)}
    joints = tuple(build_joint(index, row, **fields) for index, row in enumerate(rows))
    return Robot(name=name, joints=joints, gravity=tuple(Exact.of(value) for value in gravity))


def build_limited(limits: Sequence[Limits]) -> Robot:
    """Return a slide and revolute joints behind it, with these limits."""
    joints = tuple(
        Joint(
            name=f"j{i}",
            kind=JointKind.REVOLUTE if i else JointKind.PRISMATIC,
            parent=i - 1,
            placement=IDENTITY,
            limits=entry,
        )
        for i, entry in enumerate(limits)
    )
    return Robot(name="robot", joints=joints)


def cut(robot: Robot, size: int) -> Robot:
    """Return the robot with its first `size` joints only."""
    return dataclasses.replace(robot, joints=robot.joints[:size])


def to_se3(placement: Placement, symbols: dict[str, float]):
    rotation = np.array([[value.to_float(symbols) for value in row] for row in placement.rotation])
    return import_pinocchio().SE3(
        rotation, np.array([value.to_float(symbols) for value in placement.translation])
    )


def build_pinocchio(robot: Robot, parameters: np.ndarray | None = None):
    """Return Pinocchio's model of `robot`; `parameters` (n, 10) in our order, zero masses if None."""
    pin = import_pinocchio()
    model = pin.Model()
    symbols = dict(robot.symbols)
    for index, joint in enumerate(robot.joints):
        kind = pin.JointModelRZ() if joint.kind is JointKind.REVOLUTE else pin.JointModelPZ()
        added = model.addJoint(joint.parent + 1, kind, to_se3(joint.placement, symbols), joint.name)
        if parameters is not None:
            dynamic = np.empty(10)
            dynamic[FROM_PINOCCHIO] = parameters[index]
            model.appendBodyToJoint(added, pin.Inertia.FromDynamicParameters(dynamic), pin.SE3.Identity())
    model.gravity.linear = np.array([value.to_float(symbols) for value in robot.gravity])
    return model


def order_regressor(regressor: np.ndarray) -> np.ndarray:
    """Return a Pinocchio regressor (rows, 10 n) with its columns in our order."""
    links = regressor.shape[-1] // 10
    return np.concatenate([regressor[..., 10 * k + np.array(FROM_PINOCCHIO)] for k in range(links)], axis=-1)


def draw_parameters(rng: np.random.Generator, links: int) -> np.ndarray:
    """Return physically consistent parameters (links, 10) in our order, from random point masses."""
    result = []
    for _ in range(links):
        points, masses = rng.uniform(-0.3, 0.3, (6, 3)), rng.uniform(0.1, 1.0, 6)
        first = masses @ points
        tensor = sum(m * (p @ p * np.eye(3) - np.outer(p, p)) for m, p in zip(masses, points, strict=True))
        result.append([*tensor[0], *tensor[1, 1:], tensor[2, 2], *first, masses.sum()])
    return np.array(result)


def name_parameters(parameters: np.ndarray) -> dict[tuple[int, str], float]:
    """Return parameters (links, 10) by link and name."""
    return {(link, name): row[k] for link, row in enumerate(parameters) for k, name in enumerate(INERTIAL)}


def compute_beta(base, parameters: np.ndarray) -> np.ndarray:
    """Return base parameters from those of the links (links, 10)."""
    known = name_parameters(parameters)
    return np.array([sum(float(c) * known[key] for key, c in entry.terms) for entry in base.parameters])


def assert_close(found: object, expected: object, tolerance: float = 1e-12) -> None:
    """Compare relative to the largest entry expected, or one."""
    scale = max(1.0, float(np.abs(expected).max(initial=0.0)))
    np.testing.assert_allclose(np.asarray(found, dtype=float), expected, rtol=0, atol=tolerance * scale)


def change_joints(robot: Robot, **fields: object) -> Robot:
    """Return the robot with the same fields of every joint."""
    joints = tuple(dataclasses.replace(joint, **fields) for joint in robot.joints)
    return dataclasses.replace(robot, joints=joints)


def follow(
    robot: Robot, index: int, master: int, multiplier: str | Fraction = "-1", **fields: object
) -> Robot:
    """Return the robot with a joint that follows another, with other fields of it."""
    joints = list(robot.joints)
    mimic = Mimic(master=master, multiplier=Fraction(multiplier))
    joints[index] = dataclasses.replace(joints[index], mimic=mimic, **fields)
    return dataclasses.replace(robot, joints=tuple(joints))


def set_inertia(robot: Robot, values: np.ndarray) -> Robot:
    """Return the robot with parameters (links, 10) in place of its own."""
    joints = [
        dataclasses.replace(joint, inertial=tuple(map(float, entry)))
        for joint, entry in zip(robot.joints, values, strict=True)
    ]
    return dataclasses.replace(robot, joints=tuple(joints))


def fill(robot: Robot, seed: int = 1) -> Robot:
    """Return the robot with bodies of random point masses."""
    return set_inertia(robot, draw_parameters(np.random.default_rng(seed), robot.size))


def find_pinocchio_torques(robot: Robot, state: np.ndarray) -> np.ndarray:
    """Return Pinocchio's torques (n,) of the robot's bodies in a state (3, n) of all joints."""
    model = build_pinocchio(robot, np.array([joint.inertial for joint in robot.joints]))
    return import_pinocchio().rnea(model, model.createData(), *state)


def list_values(robot: Robot) -> dict[tuple[int, str], float]:
    """Return all values of a robot by their labels."""
    values: dict[tuple[int, str], float] = {}
    for index, joint in enumerate(robot.joints):
        values |= {(index, name): value for name, value in zip(INERTIAL, joint.inertial, strict=True)}
        if joint.drive.has_rotor:
            values[index, "IA"] = joint.drive.rotor_inertia
        if joint.spring is not None:
            values[index, "KS"] = joint.spring.stiffness
            values[index, "KR"] = -joint.spring.stiffness * joint.spring.rest
        values |= dict(zip([(index, "Fv"), (index, "Fc")], joint.friction.values or (), strict=False))
    for number, coupling in enumerate(robot.couplings, start=robot.size):
        if coupling.has_rotor:
            values[number, "IA"] = coupling.rotor_inertia
        values |= dict(zip([(number, "Fv"), (number, "Fc")], coupling.friction.values or (), strict=False))
    return values


def to_matrix(placement: Placement) -> np.ndarray:
    """Return the homogeneous matrix (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3] = [[value.to_float() for value in row] for row in placement.rotation]
    matrix[:3, 3] = [value.to_float() for value in placement.translation]
    return matrix


def draw_rational_state(robot, seed):
    """Return exact values of the generators with s^2 + c^2 = 1, and the same state as floats (3, n)."""
    rng = np.random.default_rng(seed)
    values, state = {}, np.zeros((3, robot.size))
    for k, joint in enumerate(robot.joints):
        t, position, velocity, acceleration = (QQ(int(v), 50) for v in rng.integers(-99, 100, 4))
        sine, cosine = 2 * t / (1 + t * t), (1 - t * t) / (1 + t * t)
        values |= {f"s{k + 1}": sine, f"c{k + 1}": cosine, f"q{k + 1}": position}
        values |= {f"dq{k + 1}": velocity, f"ddq{k + 1}": acceleration}
        angle = np.arctan2(float(sine), float(cosine))
        state[:, k] = angle if joint.kind is JointKind.REVOLUTE else position, velocity, acceleration
    return values, state


RIGHT_ANGLES = st.sampled_from([0.0, np.pi / 2, -np.pi / 2, np.pi])
"""They keep the field of exact numbers small."""
_ANGLES = st.sampled_from([0.0, np.pi / 2, -np.pi / 2, np.pi / 4, np.pi / 6, np.pi, 0.3])
_GRAVITIES = [
    ("0", "0", "-9.81"),
    ("0", "-9.81", "0"),
    ("9.81", "0", "0"),
    ("0.3", "-0.5", "-9.7"),
    ("0", "0", "0"),
]
_LENGTHS = st.sampled_from([0, 0, 0.3, -0.25, 0.1])


_MULTIPLIERS = st.sampled_from([Fraction(-1), Fraction(2), Fraction(1, 2), Fraction(-3, 4)])
_FACTORS = st.sampled_from([Fraction(1), Fraction(-1), Fraction(5, 2)])


def build_angle(tangent: Fraction, *, opposite: bool = False) -> Angle:
    """Return the angle of a rational half-angle tangent, plus half a turn if `opposite`."""
    sign = -1 if opposite else 1
    cosine, sine = (1 - tangent**2) / (1 + tangent**2), 2 * tangent / (1 + tangent**2)
    return Angle(
        cosine=Exact.of(sign * cosine),
        sine=Exact.of(sign * sine),
        radians=float(2 * np.arctan(float(tangent)) + (np.pi if opposite else 0.0)),
    )


RATIONAL_ANGLES = st.builds(
    build_angle, st.fractions(Fraction(-1), Fraction(1), max_denominator=5), opposite=st.booleans()
)
RATIONAL_LENGTHS = st.integers(-40, 40).map(lambda value: Fraction(value, 100))


def _draw_mimics(draw, size: int) -> list[Mimic | None]:
    """Return who follows whom; at least one joint follows none."""
    free = sorted(draw(st.sets(st.integers(0, size - 1), min_size=1)))
    mimics = []
    for index in range(size):
        mimic = None
        if index not in free:
            mimic = Mimic(master=draw(st.sampled_from(free)), multiplier=draw(_MULTIPLIERS))
        mimics.append(mimic)
    return mimics


def _draw_couplings(draw, size: int, kinds) -> tuple[Coupling, ...]:
    couplings = []
    for number in range(draw(st.integers(0, 2))):
        joints = sorted(draw(st.sets(st.integers(0, size - 1), min_size=1, max_size=2)))
        terms = tuple((index, draw(_FACTORS)) for index in joints)
        couplings.append(
            Coupling(
                name=f"m{number + 1}",
                terms=terms,
                has_rotor=draw(st.booleans()),
                friction=FrictionValues(law=draw(kinds)),
            )
        )
    return tuple(couplings)


@st.composite
def trees(
    draw,
    *,
    most: int = 4,
    angles=_ANGLES,
    lengths=_LENGTHS,
    rotors: bool = False,
    friction: bool = False,
    symbols: bool = False,
    followers: bool = False,
    couplings: bool = False,
    springs: bool = False,
) -> Robot:
    """Return a random tree of revolute and prismatic joints with a random gravity.

    `angles` gives radians or exact angles; followers, couplings and springs only where asked for.
    """
    size = draw(st.integers(1, most))
    joints = []
    kinds = st.sampled_from(PLAIN_LAWS) if friction else st.just("none")
    mimics = _draw_mimics(draw, size) if followers else [None] * size
    for index in range(size):
        alpha, theta = draw(angles), draw(angles)
        a, d = Exact.of(draw(lengths)), Exact.of(draw(lengths))
        if symbols and draw(st.booleans()):
            a, d = Exact.symbol(f"A{index}"), Exact.symbol(f"D{index}")
        exact = (angle if isinstance(angle, Angle) else build_exact_angle(angle) for angle in (alpha, theta))
        alpha, theta = exact
        placement = place_modified_dh(alpha, a, d, theta)
        kind = draw(kinds)
        joints.append(
            Joint(
                name=f"joint{index + 1}",
                kind=draw(st.sampled_from(JointKind)),
                parent=draw(st.integers(-1, index - 1)),
                placement=placement,
                drive=Drive(has_rotor=rotors and draw(st.booleans())),
                friction=FrictionValues(law=kind),
                mimic=mimics[index],
                spring=Spring() if springs and draw(st.booleans()) else None,
            )
        )
    gravity = draw(st.sampled_from(_GRAVITIES))
    return Robot(
        name="tree",
        joints=tuple(joints),
        gravity=tuple(Exact.of(value) for value in gravity),
        couplings=_draw_couplings(draw, size, kinds) if couplings else (),
    )


def build_transmission(robot: Robot) -> np.ndarray:
    """Return G (joints + couplings, coordinates) with the speeds of all of them = G dq."""
    matrix = np.zeros((robot.size + len(robot.couplings), robot.freedom))
    free = [index for index, joint in enumerate(robot.joints) if joint.mimic is None]
    for index, joint in enumerate(robot.joints):
        if joint.mimic is None:
            matrix[index, free.index(index)] = 1.0
        else:
            matrix[index, free.index(joint.mimic.master)] = float(joint.mimic.multiplier)
    for number, coupling in enumerate(robot.couplings):
        for index, factor in coupling.terms:
            matrix[robot.size + number] += float(factor) * matrix[index]
    return matrix


def spread(robot: Robot, array: np.ndarray) -> np.ndarray:
    """Return values of the joints (size, ...) from those of the coordinates (freedom, ...)."""
    return np.tensordot(build_transmission(robot)[: robot.size], array, axes=1)


def fold(robot: Robot, array: np.ndarray) -> np.ndarray:
    """Return what acts on the coordinates (freedom, ...) from what acts on the joints (size, ...)."""
    return np.tensordot(build_transmission(robot)[: robot.size].T, array, axes=1)


FRICTION = {
    "Fv": lambda v: v,
    "Fc": np.sign,
    "offset": np.ones_like,
    "Fvp": lambda v: np.maximum(v, 0.0),
    "Fcp": lambda v: np.where(v > 0.0, 1.0, 0.0),
    "Fvn": lambda v: np.minimum(v, 0.0),
    "Fcn": lambda v: np.where(v < 0.0, -1.0, 0.0),
}
FRICTION_NAMES = {
    "none": (),
    "coulomb-viscous": ("Fv", "Fc"),
    "coulomb-viscous-offset": ("Fv", "Fc", "offset"),
    "asymmetric": ("Fvp", "Fcp", "Fvn", "Fcn"),
}
"""Parameters of plain laws, and the friction of each per unit."""
_WAVES = re.compile(r"position-(?P<kind>dependent|torque)-(?P<orders>[\d,]+)(x(?P<gear>[\d.]+))?")


def regress(robot: Robot, q, dq, ddq, *, friction: bool = True) -> dict[tuple[int, str], np.ndarray]:
    """Return the torques of the coordinates per unit of each parameter, without symid.

    Links from Pinocchio's regressor of the joints, folded; drives, springs and friction by their formulas.

    Args:
        robot: the robot, symbols with values.
        q: (freedom,) coordinates; dq, ddq: their derivatives.
        friction: whether friction counts, as it does not in gravity and momenta.
    """
    matrix = build_transmission(robot)
    model = build_pinocchio(robot, draw_parameters(np.random.default_rng(0), robot.size))
    state = (spread(robot, np.asarray(values)) for values in (q, dq, ddq))
    pin = import_pinocchio()
    raw = pin.computeJointTorqueRegressor(model, model.createData(), *state).reshape(robot.size, -1)
    links = fold(robot, order_regressor(raw))
    columns = {(k // 10, INERTIAL[k % 10]): links[:, k] for k in range(10 * robot.size)}
    positions, speeds, rates = (matrix @ np.asarray(values) for values in (q, dq, ddq))
    for index, joint in enumerate(robot.joints):
        if joint.drive.has_rotor:
            columns[index, "IA"] = matrix[index] * rates[index]
        if joint.spring is not None:
            columns[index, "KS"] = matrix[index] * positions[index]
            columns[index, "KR"] = matrix[index].copy()
    for number, coupling in enumerate(robot.couplings, start=robot.size):
        if coupling.has_rotor:
            columns[number, "IA"] = matrix[number] * rates[number]
    for index, part in enumerate((*robot.joints, *robot.couplings) if friction else ()):
        speed, waves = speeds[index], _WAVES.fullmatch(part.friction.law)
        for name in FRICTION_NAMES["coulomb-viscous" if waves else part.friction.law]:
            columns[index, name] = matrix[index] * FRICTION[name](speed)
        for order in waves["orders"].split(",") if waves else ():
            angle = int(order) * float(waves["gear"] or 1.0) * positions[index]
            side = np.sign(speed) if waves["kind"] == "dependent" else 1.0
            columns[index, f"A{order}"] = matrix[index] * np.cos(angle) * side
            columns[index, f"B{order}"] = matrix[index] * np.sin(angle) * side
    return columns


def each_robot(*robots: Robot) -> pytest.MarkDecorator:
    """Return the mark of a test of several robots, by their names."""
    return pytest.mark.parametrize("robot", robots, ids=lambda robot: robot.name)


PI = np.pi


def _read_chain(name, text, **fields):
    """Return a chain of rows of alpha in quarter turns, a and d in m, and theta."""

    def read(cell):
        return cell if cell == "q" else float(cell)

    rows = [[PI / 2 * float(alpha), *map(read, rest)] for alpha, *rest in map(str.split, text.split(","))]
    return build_chain(rows, name=name, **fields)


PUMA560 = _read_chain(
    "puma560", "0 0 0 q, 1 0 0 q, 0 0.4318 0.15005 q, -1 0.0203 0.4318 q, 1 0 0 q, -1 0 0 q"
)
PANDA = _read_chain(
    "panda", "0 0 0.333 q, -1 0 0 q, 1 0 0.316 q, 1 0.0825 0 q, -1 -0.0825 0.384 q, 1 0 0 q, 1 0.088 0 q"
)
STANFORD = _read_chain("stanford", "0 0 0 q, -1 0 0.1524 q, 1 0 q 0, 0 0 0 q, -1 0 0 q, 1 0 0 q")
TWO_LINK = _read_chain("two_link", "0 0 0 q, 0 0.5 0 q", gravity=("0", "-9.81", "0"))
KR30 = _read_chain(
    "kr30",
    "0 0 0.815 q, 1 0.35 0 q, 0 0.85 0 q, 1 0.145 0.82 q, 1 0 0 q, 1 0 -0.17 q",
    gravity=("0.3", "-0.5", "-9.7"),
)
LWR4 = _read_chain("lwr4", "0 0 0 q, 1 0 0 q, -1 0 0.4 q, -1 0 0 q, 1 0 0.39 q, 1 0 0 q, -1 0 0 q")
UR5 = _read_chain(
    "ur5", "0 0 0.0892 q, 1 0 0 q, 0 -0.425 0 q, 0 -0.39225 0.10915 q, 1 0 0.09465 q, -1 0 0.0823 q"
)


def build_route_programs(robot, base, spec):
    """Return the program of every route to one function of the catalogue, by the route's name."""
    workspace = build_workspace(robot, base, spec)
    programs = {}
    for name, build in list_routes(robot, spec.name).items():
        programs[name] = workspace.algebra.build_program(spec, workspace.recall(build))
    return programs
