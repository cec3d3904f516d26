"""A pendulum and a vertical two-link arm in NumPy alone, and the shipped elastic arm, compiled."""

from dataclasses import replace
from itertools import islice

import pytest

from symid.codegen.cache import prepare_library
from symid.joint_models import FrictionValues
from symid.notation import INERTIAL
from symid.robot.description import Joint, JointKind, Limits, Robot
from symid.robot.geometry import IDENTITY, ZERO, Exact, translate
from symid.robot.toml_reader import read_robot
from tests.chains import FRICTION_NAMES
from tests.simulations import CALLED, ELASTIC_CALLED

LENGTH, MASS = 0.5, 2.0
ARM = (1.2, 0.3, 0.35, 3.0, 0.7)


class Changed:
    """A library whose card, or one of whose functions, says something else."""

    def __init__(self, library, functions=None, **changes):
        self._library, self._functions, self.card = library, functions or {}, replace(library.card, **changes)

    def __getattr__(self, name):
        return getattr(self._library, name)

    def evaluate(self, name, *inputs):
        return self._functions.get(name, lambda *given: self._library.evaluate(name, *given))(*inputs)


def build_robot(size, limits=()):
    """Return a robot with so many revolute joints, and these limits."""
    joints = (
        Joint(
            name=f"joint{index + 1}",
            kind=JointKind.REVOLUTE,
            parent=index - 1,
            placement=translate(Exact.of(str(LENGTH)), ZERO, ZERO) if index else IDENTITY,
            friction=FrictionValues(law="coulomb-viscous"),
            limits=limits[index] if limits else Limits(),
        )
        for index in range(size)
    )
    return Robot(name="robot", joints=tuple(joints), gravity=(ZERO, Exact.of("-9.81"), ZERO))


def build_library(model, beta, kinds, friction):
    """Return the functions of a pendulum, beta = (ZZ1, MX1), or of an arm.

    The arm has beta = (ZZ1 + l^2 M2, ZZ2, l MX2, MX1 + l M2, MX2).
    """
    if model == "pendulum":
        bodies = [dict(zip(("ZZ", "MX"), beta, strict=True))]
    else:
        a1, a2, _, g1, g2 = beta
        bodies = [{"ZZ": a1 - LENGTH**2 * MASS, "MX": g1 - LENGTH * MASS}, {"ZZ": a2, "MX": g2, "M": MASS}]
    left = iter(friction)
    robot = build_robot(len(bodies))
    joints = [
        replace(
            joint,
            inertial=None if None in body.values() else tuple(body.get(name, 0.0) for name in INERTIAL),
            friction=FrictionValues(law=kind, values=tuple(islice(left, len(FRICTION_NAMES[kind]))) or None),
        )
        for joint, body, kind in zip(robot.joints, bodies, kinds, strict=True)
    ]
    robot = replace(robot, joints=tuple(joints))
    names = CALLED if any(kind != "none" for kind in kinds) else CALLED[2:]
    return prepare_library(robot, names=names, backend="python")


@pytest.fixture
def make_library():
    """Return the builder of libraries without compiled code."""
    return build_library


@pytest.fixture
def make_robot():
    """Return the builder of robots."""
    return build_robot


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
