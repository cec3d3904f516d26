"""A pendulum and a vertical two-link arm written in closed form: libraries without generated code."""

from dataclasses import dataclass, field
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from symid.codegen.cache import prepare_library
from symid.codegen.functions import JointCard, ModelCard, ParameterCard
from symid.joint_models import FrictionValues
from symid.robot.description import Joint, JointKind, Robot
from symid.robot.geometry import IDENTITY
from symid.robot.toml_reader import read_robot
from tests.chains import FRICTION, FRICTION_NAMES
from tests.simulations import ELASTIC_CALLED

G = 9.81


def find_friction_columns(kinds, dq):
    """Return the friction regressor (N, n, p) of joints with friction of their own."""
    entries = [(joint, name) for joint, kind in enumerate(kinds) for name in FRICTION_NAMES[kind]]
    out = np.zeros((*dq.shape, len(entries)))
    for k, (joint, name) in enumerate(entries):
        out[:, joint, k] = FRICTION[name](dq[:, joint])
    return out


def pendulum_mass(_q, beta):
    return np.array([[beta[0]]])


def pendulum_bias(q, _dq, beta):
    return np.array([beta[1] * G * np.cos(q[0])])


def pendulum_energy(q, dq, beta):
    return 0.5 * beta[0] * dq[0] ** 2, beta[1] * G * np.sin(q[0])


# Two links of lengths (l1, l2) about parallel axes; with a1 = ZZ1 + l1^2 m2, a2 = ZZ2, a3 = l1 mx2,
# g1 = mx1 + l1 m2, g2 = mx2. beta = (a1, a2, a3, g1, g2).
def arm_mass(q, beta):
    a1, a2, a3 = beta[:3]
    c = np.cos(q[1])
    return np.array([[a1 + a2 + 2.0 * a3 * c, a2 + a3 * c], [a2 + a3 * c, a2]])


def arm_bias(q, dq, beta):
    a3, g1, g2 = beta[2:]
    s = np.sin(q[1])
    last = g2 * G * np.cos(q[0] + q[1])
    return np.array(
        [
            -a3 * s * dq[1] * (2.0 * dq[0] + dq[1]) + g1 * G * np.cos(q[0]) + last,
            a3 * s * dq[0] ** 2 + last,
        ]
    )


def arm_energy(q, dq, beta):
    height = beta[3] * np.sin(q[0]) + beta[4] * np.sin(q[0] + q[1])
    return 0.5 * dq @ arm_mass(q, beta) @ dq, G * height


@dataclass
class ClosedForm:
    """The part of a library that simulation uses."""

    card: ModelCard
    mass: object
    bias: object
    energy: object
    friction: object
    backend: str = "closed form"
    notices: tuple = ()
    engine: object = field(default_factory=lambda: SimpleNamespace(addresses=None))

    def bind(self, name):
        return {
            "mass_matrix": lambda q, beta: (self.mass(q, beta),),
            "bias": lambda q, dq, beta: (self.bias(q, dq, beta),),
            "forward_dynamics": lambda q, dq, tau, beta: (
                np.linalg.solve(self.mass(q, beta), tau - self.bias(q, dq, beta)),
            ),
        }[name]

    def evaluate(self, name, *inputs):
        if name == "friction_regressor":
            return (self.friction(*inputs),)
        *samples, beta = inputs
        if name == "mass_matrix":
            return (np.array([self.mass(q, beta) for q in samples[0]]),)
        pairs = [self.energy(q, dq, beta) for q, dq in zip(*samples, strict=True)]
        kinetic, potential = np.array(pairs).T
        return kinetic[:, None], potential[:, None]


def parameter(name, value):
    return ParameterCard(name=name, expression=name, unit="mixed", reason="", joint="", value=value)


def build_library(model, beta, kinds, friction):
    mass, bias, energy = {
        "pendulum": (pendulum_mass, pendulum_bias, pendulum_energy),
        "arm": (arm_mass, arm_bias, arm_energy),
    }[model]
    names = [f"{name}{joint}" for joint, kind in enumerate(kinds, 1) for name in FRICTION_NAMES[kind]]
    card = ModelCard(
        robot=model,
        signature="",
        joints=tuple(
            JointCard(number=number, name=f"joint{number}", kind="revolute", friction=kind)
            for number, kind in enumerate(kinds, 1)
        ),
        beta=tuple(parameter(f"b{index}", value) for index, value in enumerate(beta)),
        friction=tuple(parameter(name, value) for name, value in zip(names, friction, strict=True)),
        functions=(),
    )
    friction_columns = partial(find_friction_columns, kinds)
    return ClosedForm(card=card, mass=mass, bias=bias, energy=energy, friction=friction_columns)


@pytest.fixture
def make_library():
    """Return the builder of closed-form libraries."""
    return build_library


@pytest.fixture
def make_robot():
    """Return a builder of robots with so many revolute joints and these limits."""

    def build(size, limits=()):
        joints = tuple(
            Joint(
                name=f"joint{index + 1}",
                kind=JointKind.REVOLUTE,
                parent=index - 1,
                placement=IDENTITY,
                friction=FrictionValues(law="coulomb-viscous"),
                **({"limits": limits[index]} if limits else {}),
            )
            for index in range(size)
        )
        return Robot(name="robot", joints=joints)

    return build


ARM = (1.2, 0.3, 0.35, 3.0, 0.7)


@pytest.fixture
def arm(make_library):
    """Return the two-link arm with viscous and Coulomb friction."""
    return make_library("arm", ARM, ("coulomb-viscous", "coulomb-viscous-offset"), (0.8, 1.5, 0.4, 0.6, 0.1))


@pytest.fixture(scope="session")
def elastic_robot(robots_folder):
    """Return the vertical arm with two elastic joints, stops, knees and smoothed dry friction."""
    return read_robot(robots_folder / "two_link_elastic.toml")


@pytest.fixture(scope="session")
def elastic_library(elastic_robot, c_compiler):
    """Return its compiled functions."""
    return prepare_library(elastic_robot, names=ELASTIC_CALLED)
