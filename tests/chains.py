"""Robots for tests: chains and trees from a few numbers, and Pinocchio's model of any robot."""

import dataclasses
import operator
from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from hypothesis import strategies as st
from sympy import QQ

from symid.codegen.instructions import Op, Program
from symid.codegen.routes import ROUTES
from symid.codegen.workspace import build_workspace
from symid.robot.description import Drive, FrictionKind, FrictionValues, Joint, JointKind, Robot
from symid.robot.geometry import Exact, Placement, find_angle, place_modified_dh

# Pinocchio orders m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz; ours is XX XY XZ YY YZ ZZ MX MY MZ M.
FROM_PINOCCHIO = [4, 5, 7, 6, 8, 9, 1, 2, 3, 0]


def build_joint(index: int, row: Sequence[object], *, parent: int | None = None, **fields) -> Joint:
    """Return the joint of a modified DH row (alpha, a, d, theta) whose variable is written `q`."""
    alpha, a, d, theta = row
    revolute = theta == "q"

    def length(value: object) -> Exact:
        if value == "q":
            return Exact()
        return Exact.symbol(value) if isinstance(value, str) else Exact.of(value)

    placement = place_modified_dh(
        find_angle(alpha), length(a), length(d), find_angle(0.0 if revolute else theta)
    )
    kind = JointKind.REVOLUTE if revolute else JointKind.PRISMATIC
    before = index - 1 if parent is None else parent
    return Joint(name=f"joint{index + 1}", kind=kind, parent=before, placement=placement, **fields)


def build_chain(
    rows: Sequence[Sequence[object]],
    *,
    gravity: tuple[str, str, str] = ("0", "0", "-9.81"),
    rotors: bool = False,
    friction: FrictionKind = FrictionKind.NONE,
    name: str = "chain",
) -> Robot:
    """Return a chain of modified DH rows."""
    fields = {"drive": Drive(has_rotor=rotors), "friction": FrictionValues(kind=friction)}
    joints = tuple(build_joint(index, row, **fields) for index, row in enumerate(rows))
    return Robot(name=name, joints=joints, gravity=tuple(Exact.of(value) for value in gravity))


def cut(robot: Robot, size: int) -> Robot:
    """Return the robot with its first `size` joints only."""
    return dataclasses.replace(robot, joints=robot.joints[:size])


def to_se3(placement: Placement, symbols: dict[str, float]) -> pin.SE3:
    rotation = np.array([[value.to_float(symbols) for value in row] for row in placement.rotation])
    return pin.SE3(rotation, np.array([value.to_float(symbols) for value in placement.translation]))


def build_pinocchio(robot: Robot, parameters: np.ndarray | None = None) -> pin.Model:
    """Return Pinocchio's model of `robot`; `parameters` (n, 10) in our order, zero masses if None."""
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


_ANGLES = st.sampled_from([0.0, np.pi / 2, -np.pi / 2, np.pi / 4, np.pi / 6, np.pi, 0.3])
_GRAVITIES = [
    ("0", "0", "-9.81"),
    ("0", "-9.81", "0"),
    ("9.81", "0", "0"),
    ("0.3", "-0.5", "-9.7"),
    ("0", "0", "0"),
]
_LENGTHS = st.sampled_from([0, 0, 0.3, -0.25, 0.1])


@st.composite
def trees(
    draw,
    *,
    most: int = 4,
    angles=_ANGLES,
    rotors: bool = False,
    friction: bool = False,
    symbols: bool = False,
) -> Robot:
    """Return a random tree of revolute and prismatic joints with a random gravity."""
    size = draw(st.integers(1, most))
    joints = []
    for index in range(size):
        alpha, theta = draw(angles), draw(angles)
        a, d = Exact.of(draw(_LENGTHS)), Exact.of(draw(_LENGTHS))
        if symbols and draw(st.booleans()):
            a, d = Exact.symbol(f"A{index}"), Exact.symbol(f"D{index}")
        placement = place_modified_dh(find_angle(alpha), a, d, find_angle(theta))
        kind = draw(st.sampled_from(FrictionKind)) if friction else FrictionKind.NONE
        joints.append(
            Joint(
                name=f"joint{index + 1}",
                kind=draw(st.sampled_from(JointKind)),
                parent=draw(st.integers(-1, index - 1)),
                placement=placement,
                drive=Drive(has_rotor=rotors and draw(st.booleans())),
                friction=FrictionValues(kind=kind),
            )
        )
    gravity = draw(st.sampled_from(_GRAVITIES))
    return Robot(name="tree", joints=tuple(joints), gravity=tuple(Exact.of(value) for value in gravity))


PI = np.pi
PUMA560 = build_chain(
    [
        (0.0, 0, 0, "q"),
        (PI / 2, 0, 0, "q"),
        (0.0, 0.4318, 0.15005, "q"),
        (-PI / 2, 0.0203, 0.4318, "q"),
        (PI / 2, 0, 0, "q"),
        (-PI / 2, 0, 0, "q"),
    ],
    name="puma560",
)
PANDA = build_chain(
    [
        (0.0, 0, 0.333, "q"),
        (-PI / 2, 0, 0, "q"),
        (PI / 2, 0, 0.316, "q"),
        (PI / 2, 0.0825, 0, "q"),
        (-PI / 2, -0.0825, 0.384, "q"),
        (PI / 2, 0, 0, "q"),
        (PI / 2, 0.088, 0, "q"),
    ],
    name="panda",
)
STANFORD = build_chain(
    [
        (0.0, 0, 0, "q"),
        (-PI / 2, 0, 0.1524, "q"),
        (PI / 2, 0, "q", 0.0),
        (0.0, 0, 0, "q"),
        (-PI / 2, 0, 0, "q"),
        (PI / 2, 0, 0, "q"),
    ],
    name="stanford",
)
TWO_LINK = build_chain([(0.0, 0, 0, "q"), (0.0, 0.5, 0, "q")], gravity=("0", "-9.81", "0"), name="two_link")

KR30 = build_chain(
    [
        (0.0, 0, 0.815, "q"),
        (PI / 2, 0.35, 0, "q"),
        (0.0, 0.85, 0, "q"),
        (PI / 2, 0.145, 0.82, "q"),
        (PI / 2, 0, 0, "q"),
        (PI / 2, 0, -0.17, "q"),
    ],
    gravity=("0.3", "-0.5", "-9.7"),
    name="kr30",
)
LWR4 = build_chain(
    [
        (0.0, 0, 0, "q"),
        (PI / 2, 0, 0, "q"),
        (-PI / 2, 0, 0.4, "q"),
        (-PI / 2, 0, 0, "q"),
        (PI / 2, 0, 0.39, "q"),
        (PI / 2, 0, 0, "q"),
        (-PI / 2, 0, 0, "q"),
    ],
    name="lwr4",
)
UR5 = build_chain(
    [
        (0.0, 0, 0.0892, "q"),
        (PI / 2, 0, 0, "q"),
        (0.0, -0.425, 0, "q"),
        (0.0, -0.39225, 0.10915, "q"),
        (PI / 2, 0, 0.09465, "q"),
        (-PI / 2, 0, 0.0823, "q"),
    ],
    name="ur5",
)

_NUMERIC = {
    Op.ADD: operator.add,
    Op.SUB: operator.sub,
    Op.MUL: operator.mul,
    Op.DIV: operator.truediv,
    Op.SIN: np.sin,
    Op.COS: np.cos,
    Op.ABS: np.abs,
    Op.SIGN: np.sign,
}


def run_program(program, inputs):
    """Return the outputs of a program as arrays of the ports' shapes, computed in double precision."""
    values = [0.0]

    def read(ref):
        return values[ref] if ref > 0 else -values[-ref]

    for instruction in program.instructions:
        if instruction.op is Op.INPUT:
            port, element = instruction.args
            values.append(float(np.ravel(inputs[program.spec.inputs[port].name])[element]))
        elif instruction.op is Op.CONSTANT:
            values.append(instruction.constant)
        else:
            values.append(float(_NUMERIC[instruction.op](*map(read, instruction.args))))
    ports = zip(program.spec.outputs, program.outputs, strict=True)
    return [np.array([read(ref) for ref in refs], dtype=float).reshape(port.shape) for port, refs in ports]


def build_route_programs(robot, base, spec):
    """Return the program of every route to one function of the catalogue, by the route's name."""
    workspace = build_workspace(robot, base, spec)
    programs = {}
    for name, build in ROUTES[spec.name].items():
        instructions, outputs = workspace.table.collect(workspace.recall(build))
        programs[name] = Program(spec=spec, instructions=instructions, outputs=outputs)
    return programs
