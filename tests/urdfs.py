"""URDF texts for tests: robots in the link frames that an author might have chosen; Pinocchio's torques."""

from collections.abc import Sequence
from fractions import Fraction

import numpy as np
import pytest

from symid.robot.description import JointKind, Robot
from symid.robot.urdf_xml import TENSOR
from tests.chains import draw_parameters, spread, to_se3

pin = pytest.importorskip("pinocchio", reason="wants the package pin")

AXES = {
    "0 0 1": (),
    "1 0 0": (("y", 90),),
    "0 1 0": (("x", -90),),
    "0 0 -1": (("x", 180),),
    "0 -1 0": (("x", 90),),
    "1 1 0": (("z", 45), ("y", 90)),
}
"""Axes of a URDF, and the turns (degrees, one after the other) that take z to them."""


def invert(steps: Sequence[tuple[str, int]]) -> tuple[tuple[str, int], ...]:
    return tuple((axis, -degrees) for axis, degrees in reversed(steps))


def write_steps(steps: Sequence[tuple[str, object]], parent: str, joint: str) -> tuple[list[str], str]:
    """Return fixed joints for turns ("x", degrees) and shifts ("shift", (x, y, z)); and the last link."""
    lines = []
    for number, (kind, value) in enumerate(steps):
        link = f"{joint}_step{number}"
        rpy = " ".join(repr(float(np.radians(value))) if kind == axis else "0" for axis in "xyz")
        xyz = " ".join(value) if kind == "shift" else "0 0 0"
        lines += [
            f'<link name="{link}"/>',
            f'<joint name="{link}" type="fixed"><parent link="{parent}"/><child link="{link}"/>',
            f'<origin xyz="{xyz}" rpy="{rpy}"/></joint>',
        ]
        parent = link
    return lines, parent


def write_odd_urdf(
    rows: Sequence[Sequence[object]], turns: Sequence[int], shifts: Sequence[str], axes: Sequence[str]
) -> str:
    """Return the URDF of a chain of modified DH rows (degrees, m, m, degrees) in frames of other choice.

    Link j's frame is its modified one turned about z by `turns[j]` degrees, shifted along z by `shifts[j]` m,
    and turned so that the joint's axis is `axes[j]`. Every step is a fixed joint of its own, so that each
    number is written exactly.
    """
    lines, parent, before = ['<robot name="odd"><link name="base"/>'], "base", []
    for index, (alpha, a, d, theta) in enumerate(rows):
        revolute = theta == "q"
        own = AXES[axes[index]]
        steps = [
            *before,
            ("x", alpha),
            ("shift", (str(a), "0", "0")),
            ("z", 0 if revolute else theta),
            ("shift", ("0", "0", str(d) if revolute else "0")),
            ("z", turns[index]),
            ("shift", ("0", "0", shifts[index])),
            *invert(own),
        ]
        name = f"joint{index + 1}"
        more, parent = write_steps([step for step in steps if step[1]], parent, name)
        link = f"link{index + 1}"
        kind = "continuous" if revolute else "prismatic"
        lines += [
            *more,
            f'<link name="{link}"/><joint name="{name}" type="{kind}"><parent link="{parent}"/>',
            f'<child link="{link}"/><axis xyz="{axes[index]}"/></joint>',
        ]
        parent = link
        back = (
            str(-Fraction(shifts[index])) if "/" in shifts[index] else f"-{shifts[index]}".replace("--", "")
        )
        before = [*own, ("shift", ("0", "0", back)), ("z", -turns[index])]
    return "\n".join((*lines, "</robot>"))


def to_configuration(
    model: pin.Model, names: Sequence[str], values: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return Pinocchio's q, v, a for (3, n) positions, velocities, accelerations of the joints `names`."""
    q, v, a = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
    for k, name in enumerate(names):
        joint = model.joints[model.getJointId(name)]
        angle = values[0, k]
        # A continuous joint has its cosine and sine as coordinates there.
        q[joint.idx_q : joint.idx_q + joint.nq] = (np.cos(angle), np.sin(angle)) if joint.nq == 2 else angle
        v[joint.idx_v], a[joint.idx_v] = values[1, k], values[2, k]
    return q, v, a


def list_rows(model: pin.Model, names: Sequence[str]) -> list[int]:
    """Return where the joints stand in Pinocchio's velocity vector."""
    return [model.joints[model.getJointId(name)].idx_v for name in names]


def find_torques(model: pin.Model, robot: Robot, state: np.ndarray) -> np.ndarray:
    """Return Pinocchio's torques (n,) of the robot's joints in a state (3, n) of the joints."""
    names = [joint.name for joint in robot.joints]
    q, v, a = to_configuration(model, names, state)
    return pin.rnea(model, model.createData(), q, v, a)[list_rows(model, names)]


def find_link_poses(robot: Robot, positions: np.ndarray) -> list[pin.SE3]:
    """Return the file's frame of every link in the base frame, for the positions (n,) of all joints."""
    symbols = dict(robot.symbols)
    poses: list[pin.SE3] = []
    for joint, value in zip(robot.joints, positions, strict=True):
        before = poses[joint.parent] if joint.parent >= 0 else pin.SE3.Identity()
        if joint.kind is JointKind.REVOLUTE:
            move = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, float(value)), np.zeros(3))
        else:
            move = pin.SE3(np.eye(3), np.array([0.0, 0.0, value]))
        poses.append(before * to_se3(joint.placement, symbols) * move)
    return [pose * to_se3(joint.frame, symbols) for pose, joint in zip(poses, robot.joints, strict=True)]


def find_largest_gap(model: pin.Model, robot: Robot, positions: np.ndarray, theirs: np.ndarray) -> float:
    """Return the largest difference of symid's link frames (m, and entries of rotations) to Pinocchio's.

    `positions` (n,) of symid's joints, `theirs` of those in the file, offsets of followers included.
    """
    names = [joint.name for joint in robot.joints]
    q, _, _ = to_configuration(model, names, np.array([theirs, 0 * theirs, 0 * theirs]))
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    pairs = zip(names, find_link_poses(robot, positions), strict=True)
    return max(
        float(np.abs(data.oMi[model.getJointId(name)].homogeneous - pose.homogeneous).max())
        for name, pose in pairs
    )


def draw_urdf(rng: np.random.Generator, size: int) -> tuple[str, dict[str, tuple[str, float, float]]]:
    """Return the URDF of a random tree and, by name, what followers follow: name, factor, offset."""
    angles = ("0", "0", repr(np.pi / 2), repr(-np.pi / 2), repr(np.pi), repr(np.pi / 6), "0.3", "-1.1")
    axes = (*AXES, "0.6 0 0.8", "1 -2 0.5", "-1 0 0")

    def pick(values: Sequence[str]) -> str:
        return values[int(rng.integers(len(values)))]

    def write_vector(values: Sequence[float]) -> str:
        return " ".join(f"{value:.3f}" for value in values)

    def write_link(name: str) -> str:
        body = draw_parameters(rng, 1)[0].tolist()
        entries = " ".join(f'{key}="{value!r}"' for key, value in zip(TENSOR, body, strict=False))
        return (
            f'<link name="{name}"><inertial><origin xyz="{write_vector(rng.uniform(-0.2, 0.2, 3))}" '
            f'rpy="{write_vector(rng.uniform(-3, 3, 3))}"/><mass value="{body[9]:.4f}"/>'
            f"<inertia {entries}/></inertial></link>"
        )

    lines, followers, movers = [write_link("link0")], {}, []
    for index in range(1, size + 1):
        name, kind = f"joint{index}", pick(("revolute", "continuous", "prismatic", "fixed"))
        mimic = ""
        if kind != "fixed":
            if movers and rng.random() < 0.3:
                master, factor, offset = (
                    pick(movers),
                    round(rng.uniform(-2, 2), 2),
                    round(rng.uniform(-1, 1), 2),
                )
                followers[name] = (master, factor, offset)
                mimic = f'<mimic joint="{master}" multiplier="{factor}" offset="{offset}"/>'
            movers.append(name)
        lines.append(
            f'{write_link(f"link{index}")}<joint name="{name}" type="{kind}">'
            f'<parent link="link{rng.integers(index)}"/><child link="link{index}"/>'
            f'<origin xyz="{write_vector(rng.uniform(-0.5, 0.5, 3))}" '
            f'rpy="{pick(angles)} {pick(angles)} {pick(angles)}"/><axis xyz="{pick(axes)}"/>'
            f'<limit lower="-9" upper="9" effort="1" velocity="1"/>{mimic}</joint>'
        )
    return "\n".join(('<robot name="random">', *lines, "</robot>")), followers


def find_positions(
    robot: Robot, followers: dict[str, tuple[str, float, float]], masters: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the positions of symid's joints, and of those in the file, from those of the masters."""
    own = spread(robot, masters)
    names = [joint.name for joint in robot.joints]

    def find(name: str) -> float:
        if name not in followers:
            return float(own[names.index(name)])
        master, factor, offset = followers[name]
        return factor * find(master) + offset

    return own, np.array([find(name) for name in names])
