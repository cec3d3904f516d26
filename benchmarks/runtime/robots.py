"""The same robot for all contenders: bodies, URDF, Pinocchio's model of it, random states.

Input: a name. Output: `Case`, and the files that the programs read.

The robot is written as a URDF by symid and read by Pinocchio, so that both have the same bodies; what
Pinocchio made of it goes as text to the C++ programs. Rotors, springs and friction are left out: none of the
functions measured here has them in Pinocchio.
"""

import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from tools import NotInstalledError

from symid.arrays import FloatArray
from symid.codegen.functions import MOST_FULL
from symid.dynamics.base_parameters import BaseParameters, derive_base_parameters
from symid.notation import INERTIAL
from symid.robot.description import Drive, FrictionValues, Joint, JointKind, Limits, Robot
from symid.robot.loading import locate_robot_file
from symid.robot.mjcf_reader import read_xml_robot as read_urdf
from symid.robot.simulator_writers import write_urdf
from symid.robot.toml_reader import read_robot

sys.path.append(str(Path(__file__).resolve().parents[1]))
from scaling import build_robot  # a script of the folder above

__all__ = [
    "LARGE",
    "ROBOTS",
    "Case",
    "build_case",
    "find_prefix",
    "import_pinocchio",
    "write_model",
    "write_states",
]

LARGE = MOST_FULL + 1
"""Joints from which on only Pinocchio and code as it comes take part: the rest compiles for hours."""
_DRAWN = re.compile(r"(chain|tree)([1-9]\d*)")

# Of example-robot-data: file, base and tip. The last one was drawn at random from its 69 files.
_EXAMPLES = {
    "solo12": ("solo_description/robots/solo12.urdf", None, None),
    "g1_arm": ("g1_description/urdf/g1_29dof_rev_1_0.urdf", "torso_link", "left_wrist_yaw_link"),
    "anymal": ("anymal_c_simple_description/urdf/anymal.urdf", None, None),
}
ROBOTS = ("two_link", "puma560", "ur5", "panda", "quadruped", *_EXAMPLES)
SAMPLES = 1000
# Pinocchio orders m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz.
PINOCCHIO_ORDER = ("M", "MX", "MY", "MZ", "XX", "XY", "YY", "XZ", "YZ", "ZZ")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Case:
    """A robot with its bodies, states to evaluate, and how Pinocchio numbers its joints.

    Args:
        robot: what is generated.
        base: its base parameters.
        parameters: (n, 10) XX XY XZ YY YZ ZZ MX MY MZ M of each link about its frame's origin.
        beta: (b,) values of the base parameters.
        states: (4, SAMPLES, n) q, dq, ddq, tau; tau is the torque of the first three.
        model: Pinocchio's model.
        order: (n,) for each joint of Pinocchio the index of ours.
        columns: (b,) for each base parameter the column of Pinocchio's regressor.
    """

    robot: Robot
    base: BaseParameters
    parameters: FloatArray
    beta: FloatArray
    states: FloatArray
    model: Any
    order: tuple[int, ...]
    columns: tuple[int, ...]


def import_pinocchio() -> Any:
    """Return Pinocchio's Python package.

    Raises:
        NotInstalledError: it is not installed.
    """
    try:
        import pinocchio
    except ImportError as error:
        text = f"pinocchio is not installed ({error}): pip install 'pin>=4'"
        raise NotInstalledError(text) from error
    return pinocchio


def find_prefix() -> Path:
    """Return the folder with the headers and libraries that come with Pinocchio's wheels."""
    return next(path for path in Path(import_pinocchio().__file__).parents if path.name == "cmeel.prefix")


def _read(name: str) -> Robot:
    if drawn := _DRAWN.fullmatch(name):
        return build_robot(drawn[1], int(drawn[2]))
    if name not in _EXAMPLES:
        return read_robot(locate_robot_file(name))
    file, base, tip = _EXAMPLES[name]
    path = find_prefix() / "share/example-robot-data/robots" / file
    if not path.is_file():
        text = "example-robot-data is not installed: pip install example-robot-data"
        raise NotInstalledError(text)
    return read_urdf(path, base=base, tip=tip)


def _strip(joint: Joint) -> Joint:
    # A joint without limits would be read as one that turns for ever, with two coordinates.
    limits = Limits(position=(-10.0, 10.0), velocity=10.0, torque=1000.0)
    friction = FrictionValues()
    return replace(joint, drive=Drive(), friction=friction, spring=None, elasticity=None, limits=limits)


def _draw_body(rng: np.random.Generator) -> tuple[float, ...]:
    """Return what six random point masses make: a body that can exist."""
    points, masses = rng.uniform(-0.2, 0.2, (6, 3)), rng.uniform(0.1, 1.0, 6)
    first = masses @ points
    tensor = sum(m * (p @ p * np.eye(3) - np.outer(p, p)) for m, p in zip(masses, points, strict=True))
    values = (*tensor[0], *tensor[1, 1:], tensor[2, 2], *first, masses.sum())
    return tuple(float(value) for value in values)


def _find_order(model: Any, robot: Robot) -> tuple[int, ...]:
    names = [joint.name for joint in robot.joints]
    return tuple(names.index(name) for name in list(model.names)[1:])


def _find_beta(base: BaseParameters, parameters: FloatArray) -> FloatArray:
    flat = {(k, name): body[i] for k, body in enumerate(parameters) for i, name in enumerate(INERTIAL)}
    return np.array([sum(float(c) * flat[key] for key, c in entry.terms) for entry in base.parameters])


def build_case(name: str) -> Case:
    """Return the robot called `name` with its states; the torques are Pinocchio's.

    Raises:
        NotInstalledError: Pinocchio, or the package that holds the robot, is not installed.
    """
    pin = import_pinocchio()
    rng = np.random.default_rng(1)
    robot = _read(name)
    robot = replace(robot, name=name, joints=tuple(map(_strip, robot.joints)), couplings=())
    bodies = [joint.inertial or _draw_body(rng) for joint in robot.joints]
    pairs = zip(robot.joints, bodies, strict=True)
    robot = replace(robot, joints=tuple(replace(joint, inertial=body) for joint, body in pairs))
    model = pin.buildModelFromXML(write_urdf(robot))
    model.gravity.linear = np.array([value.to_float(dict(robot.symbols)) for value in robot.gravity])
    order = _find_order(model, robot)
    base = derive_base_parameters(robot)
    parameters = np.array(bodies)
    place = {ours: theirs for theirs, ours in enumerate(order)}
    columns = tuple(10 * place[k] + PINOCCHIO_ORDER.index(part) for k, part in base.keys)
    q, dq, ddq = rng.uniform(-1.5, 1.5, (3, SAMPLES, robot.size))
    data, tau = model.createData(), np.empty((SAMPLES, robot.size))
    for k in range(SAMPLES):
        tau[k, order] = pin.rnea(model, data, q[k, order], dq[k, order], ddq[k, order])
    return Case(
        robot=robot,
        base=base,
        parameters=parameters,
        beta=_find_beta(base, parameters),
        states=np.stack((q, dq, ddq, tau)),
        model=model,
        order=order,
        columns=columns,
    )


def _number(values: Sequence[float] | FloatArray) -> str:
    return " ".join(repr(float(value)) for value in np.ravel(values))


def write_model(case: Case, path: Path) -> None:
    """Write Pinocchio's model as text, joint by joint."""
    model = case.model
    lines = [f"{case.robot.size} {_number(model.gravity.linear)}"]
    for k in range(1, model.njoints):
        kind = "R" if case.robot.joints[case.order[k - 1]].kind is JointKind.REVOLUTE else "P"
        placement, body = model.jointPlacements[k], model.inertias[k]
        lines += [f"{kind} {model.parents[k]}", _number(placement.rotation), _number(placement.translation)]
        lines += [f"{_number([body.mass])} {_number(body.lever)}", _number(body.inertia)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _list_body(body: Any) -> list[float]:
    """Return mass, centre of mass, and xx xy yy xz yz zz about it."""
    inertia = body.inertia
    return [
        body.mass,
        *body.lever,
        *inertia[0, :2],
        inertia[1, 1],
        inertia[0, 2],
        inertia[1, 2],
        inertia[2, 2],
    ]


def write_states(case: Case, path: Path, *, theirs: bool = False) -> None:
    """Write the states, beta and the bodies for a program; with `theirs` in Pinocchio's order of joints."""
    order = list(case.order) if theirs else list(range(case.robot.size))
    pi = [_list_body(body) for body in list(case.model.inertias)[1:]]
    parts = (
        [case.robot.size, SAMPLES, case.beta.size, 10 * case.robot.size],
        case.states[:, :, order].ravel(),
        case.beta,
        np.ravel(pi),
    )
    np.concatenate([np.asarray(part, dtype=float) for part in parts]).tofile(path)
