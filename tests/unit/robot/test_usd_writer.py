"""USD text that symid writes, read by OpenUSD: bodies, frames and values are those of independent sums."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from symid.joint_models import FrictionValues
from symid.joint_models.hysteresis import Elasticity
from symid.robot.description import Coupling, Drive, JointKind, Limits, Spring
from symid.robot.geometry import Exact
from symid.robot.inertia import compute_standard_parameters
from symid.robot.simulator_writers import list_usd_omissions, write_usd
from symid.robot.toml_reader import read_robot
from tests.chains import build_chain, build_pinocchio, change_joints, fill, follow

pin = pytest.importorskip("pinocchio", reason="wants the package pin")
Usd = pytest.importorskip("pxr.Usd", reason="wants the package usd-core")
UsdGeom = pytest.importorskip("pxr.UsdGeom", reason="wants the package usd-core")
UsdPhysics = pytest.importorskip("pxr.UsdPhysics", reason="wants the package usd-core")

SHIPPED = ["panda", "kr30", "stanford", "two_arms", "quadruped", "rrp_twisted"]
# USD keeps single precision.
SINGLE = 3e-7
PAIR = (JointKind.REVOLUTE, JointKind.PRISMATIC)


def load(text):
    stage = Usd.Stage.CreateInMemory()
    assert stage.GetRootLayer().ImportFromString(text)
    return stage


def find_joints(stage):
    return {prim.GetName(): prim for prim in stage.Traverse() if prim.IsA(UsdPhysics.Joint)}


def read(prim, name):
    attribute = prim.GetAttribute(name)
    assert attribute.HasAuthoredValue(), name
    return attribute.Get()


def to_place(position, rotation):
    w, (x, y, z) = rotation.GetReal(), rotation.GetImaginary()
    return pin.SE3(pin.Quaternion(w, x, y, z).normalized().matrix(), np.array(position, dtype=float))


def place_joints(stage, robot, q):
    """Return the pose of each joint's link in the base, composed of the frames that USD has."""
    joints, places = find_joints(stage), {}
    for joint, angle in zip(robot.joints, q, strict=True):
        prim = UsdPhysics.Joint(joints[joint.name])
        (before,), (body,) = prim.GetBody0Rel().GetTargets(), prim.GetBody1Rel().GetTargets()
        assert body.name == f"{joint.name}_link"
        assert read(joints[joint.name], "physics:axis") == "Z"
        ends = [
            to_place(
                read(joints[joint.name], f"physics:localPos{k}"),
                read(joints[joint.name], f"physics:localRot{k}"),
            )
            for k in (0, 1)
        ]
        moved = pin.SE3.Identity()
        if joints[joint.name].IsA(UsdPhysics.RevoluteJoint):
            moved.rotation = pin.rpy.rpyToMatrix(0.0, 0.0, angle)
        else:
            assert joints[joint.name].IsA(UsdPhysics.PrismaticJoint)
            moved.translation = np.array([0.0, 0.0, angle])
        places[body.name] = places.get(before.name, pin.SE3.Identity()) * ends[0] * moved * ends[1].inverse()
    return [places[f"{joint.name}_link"] for joint in robot.joints]


@pytest.mark.parametrize("name", SHIPPED)
def test_frames_are_those_of_pinocchio(name, robots_folder):
    robot = fill(read_robot(robots_folder / f"{name}.toml"))
    stage = load(write_usd(robot))
    model = build_pinocchio(robot, np.array([joint.inertial for joint in robot.joints]))
    data = model.createData()
    cache = UsdGeom.XformCache()
    for q in (np.zeros(robot.size), np.random.default_rng(4).uniform(-2, 2, robot.size)):
        pin.forwardKinematics(model, data, q)
        size = max(1.0, *(np.abs(place.translation).max() for place in data.oMi))
        for found, expected in zip(place_joints(stage, robot, q), list(data.oMi)[1:], strict=True):
            np.testing.assert_allclose(found.homogeneous, expected.homogeneous, atol=10 * SINGLE * size)
        if not q.any():
            # The prims stand there, too.
            for joint, expected in zip(robot.joints, list(data.oMi)[1:], strict=True):
                prim = stage.GetPrimAtPath(f"/{robot.name}/{joint.name}_link")
                found = np.array(cache.GetLocalToWorldTransform(prim)).T
                np.testing.assert_allclose(found, expected.homogeneous, atol=1e-12)


@pytest.mark.parametrize("name", SHIPPED)
def test_bodies_are_those_of_the_robot(name, robots_folder):
    robot = fill(read_robot(robots_folder / f"{name}.toml"), seed=7)
    stage = load(write_usd(robot))
    for joint in robot.joints:
        prim = stage.GetPrimAtPath(f"/{robot.name}/{joint.name}_link")
        assert prim.HasAPI(UsdPhysics.RigidBodyAPI)
        assert prim.HasAPI(UsdPhysics.MassAPI)
        axes = to_place((0, 0, 0), read(prim, "physics:principalAxes")).rotation
        tensor = axes @ np.diag(np.array(read(prim, "physics:diagonalInertia"), dtype=float)) @ axes.T
        com = np.array(read(prim, "physics:centerOfMass"), dtype=float)
        found = compute_standard_parameters(read(prim, "physics:mass"), com, tensor[np.triu_indices(3)])
        sizes = np.abs(joint.inertial).max()
        np.testing.assert_allclose(found, joint.inertial, atol=20 * SINGLE * sizes)


def test_principal_axes_of_alike_and_extreme_moments():
    rng = np.random.default_rng(3)
    for moments in ((1.0, 1.0, 1.0), (1.0, 1.0, 2.0), (1e-6, 1e-6, 2e-6), (0.1, 2.0, 2.05), (3e-9, 1.0, 1.0)):
        turned = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        for axes in (np.eye(3), turned, turned * [1, 1, -1], np.eye(3)[[1, 2, 0]]):
            tensor = axes @ np.diag(moments) @ axes.T
            body = compute_standard_parameters(2.0, (0.1, 0.2, 0.3), tensor[np.triu_indices(3)])
            stage = load(write_usd(change_joints(build_chain([(0.0, 0, 0, "q")]), inertial=body)))
            prim = stage.GetPrimAtPath("/chain/joint1_link")
            back = to_place((0, 0, 0), read(prim, "physics:principalAxes")).rotation
            found = back @ np.diag(np.array(read(prim, "physics:diagonalInertia"), dtype=float)) @ back.T
            assert np.linalg.det(back) == pytest.approx(1.0)
            np.testing.assert_allclose(found, tensor, atol=10 * SINGLE * max(moments))


@pytest.fixture
def robot():
    """Return a turning and a sliding joint with rotors, friction, limits; the latter has a spring."""
    rows = [(0.0, 0, 0.3, "q"), (np.pi / 2, 0.2, "q", 0.3)]
    made = fill(build_chain(rows, gravity=("0.3", "-0.5", "-9.7")))
    joints = [
        replace(
            joint,
            drive=Drive(gear=1.0, has_rotor=True, rotor_inertia=0.2 + index),
            friction=FrictionValues(law="stribeck", values=(0.4 + index, 0.7, 0.25), shape=(0.1,)),
            limits=Limits(position=(-1.5, 0.5), velocity=3.0, torque=80.0),
        )
        for index, joint in enumerate(made.joints)
    ]
    joints[1] = replace(joints[1], spring=Spring(stiffness=6.0, rest=0.25), limits=Limits(velocity=2.0))
    assert tuple(joint.kind for joint in joints) == PAIR
    return replace(made, joints=tuple(joints))


def test_drives_friction_limits_and_springs_are_in_the_units_of_usd(robot):
    stage = load(write_usd(robot))
    turning, sliding = (find_joints(stage)[joint.name] for joint in robot.joints)
    degree = np.pi / 180
    expected = {
        "physics:lowerLimit": -1.5 / degree,
        "physics:upperLimit": 0.5 / degree,
        "drive:angular:physics:maxForce": 80.0,
        "physxJointAxis:angular:armature": 0.2,
        "physxJoint:armature": 0.2,
        "physxJointAxis:angular:maxJointVelocity": 3.0 / degree,
        "physxJointAxis:angular:staticFrictionEffort": 0.95,
        "physxJointAxis:angular:dynamicFrictionEffort": 0.7,
        "physxJointAxis:angular:viscousFrictionCoefficient": 0.4 * degree,
    }
    assert {key: pytest.approx(read(turning, key), rel=SINGLE) for key in expected} == expected
    assert turning.HasAPI(UsdPhysics.DriveAPI, "angular")
    expected = {
        "drive:linear:physics:stiffness": 6.0,
        "drive:linear:physics:targetPosition": 0.25,
        "physxJointAxis:linear:armature": 1.2,
        "physxJointAxis:linear:maxJointVelocity": 2.0,
        "physxJointAxis:linear:viscousFrictionCoefficient": 1.4,
    }
    assert {key: pytest.approx(read(sliding, key), rel=SINGLE) for key in expected} == expected
    assert not sliding.GetAttribute("physics:lowerLimit").HasAuthoredValue()
    apis = turning.GetPrimTypeInfo().GetAppliedAPISchemas()
    assert list(apis) == ["PhysxJointAPI", "PhysxJointAxisAPI:angular", "PhysicsDriveAPI:angular"]
    scene = UsdPhysics.Scene(stage.GetPrimAtPath("/physicsScene"))
    gravity = np.array(scene.GetGravityDirectionAttr().Get()) * scene.GetGravityMagnitudeAttr().Get()
    np.testing.assert_allclose(gravity, [0.3, -0.5, -9.7], rtol=SINGLE)
    assert (UsdGeom.GetStageMetersPerUnit(stage), UsdPhysics.GetStageKilogramsPerUnit(stage)) == (1.0, 1.0)


def test_a_spring_of_a_turning_joint_is_per_degree():
    made = fill(build_chain([(0.0, 0, 0.3, "q")]))
    stage = load(write_usd(change_joints(made, spring=Spring(stiffness=6.0, rest=0.25))))
    drive = UsdPhysics.DriveAPI(find_joints(stage)["joint1"], "angular")
    assert drive.GetStiffnessAttr().Get() == pytest.approx(6.0 * np.pi / 180, rel=SINGLE)
    assert drive.GetTargetPositionAttr().Get() == pytest.approx(0.25 * 180 / np.pi, rel=SINGLE)


def test_the_base_is_fixed_to_the_world_and_the_robot_an_articulation(robot):
    stage = load(write_usd(robot))
    root = stage.GetDefaultPrim()
    assert root.HasAPI(UsdPhysics.ArticulationRootAPI)
    fixed = find_joints(stage)["base_joint"]
    assert fixed.IsA(UsdPhysics.FixedJoint)
    assert not UsdPhysics.Joint(fixed).GetBody0Rel().GetTargets()
    assert [path.name for path in UsdPhysics.Joint(fixed).GetBody1Rel().GetTargets()] == ["base"]


def test_followers_that_turn_are_held():
    robot = fill(follow(build_chain([(np.pi / 2, 0.1, 0.2, "q")] * 3), 2, 0, "-3/2"))
    robot = change_joints(robot, limits=Limits(position=(-1.0, 1.0)))
    stage = load(write_usd(robot))
    prim = find_joints(stage)["joint3"]
    assert "PhysxMimicJointAPI:rotZ" in prim.GetPrimTypeInfo().GetAppliedAPISchemas()
    assert read(prim, "physxMimicJoint:rotZ:gearing") == 1.5
    (target,) = prim.GetRelationship("physxMimicJoint:rotZ:referenceJoint").GetTargets()
    assert target.name == "joint1"
    assert not list(list_usd_omissions(robot))
    free = replace(robot, joints=(*robot.joints[:2], replace(robot.joints[2], limits=Limits())))
    (text,) = list_usd_omissions(free)
    assert text.startswith(
        "joint joint3: follows -1.5 times joint joint1, and moves freely; PhysX holds only"
    )
    assert "Mimic" not in write_usd(free)


def test_what_has_no_words_is_told():
    friction = (
        FrictionValues(law="coulomb-viscous-offset", values=(1.0, 2.0, 3.0), smoothing=0.01),
        FrictionValues(law="lugre", values=(0.5, 1.5, 0.25), shape=(0.1, 2.0), bristles=(900.0, 3.0)),
        FrictionValues(law="coulomb-viscous", values=(0.1, -0.2)),
        FrictionValues(law="coulomb-viscous"),
    )
    made = fill(build_chain([(0.1, 0.1, 0, "q")] * 4, name='an "odd" <name>\n'))
    limits = Limits(torque=5.0)
    spring = Spring(stiffness=4.0, rest=0.1)
    joints = [
        replace(joint, friction=entry, spring=spring if index == 3 else None, limits=limits)
        for index, (joint, entry) in enumerate(zip(made.joints, friction, strict=True))
    ]
    joints[0] = replace(joints[0], name="1 a-b", drive=Drive(gear=30.0))
    joints[1] = replace(joints[1], inertial=(0.0,) * 10)
    joints[2] = replace(joints[2], elasticity=Elasticity(stiffness=900.0))
    coupling = Coupling(
        name="m", terms=((0, Fraction(1)), (3, Fraction(2))), has_rotor=True, rotor_inertia=0.1
    )
    robot = replace(
        made, joints=tuple(joints), symbols=(("L1", 0.25),), couplings=(coupling,), gravity=(Exact(),) * 3
    )
    text = write_usd(robot, comments=("a comment\nof the caller",))
    stage = load(text)
    assert stage.GetDefaultPrim().GetName() == "an__odd___name__"
    assert "_1_a_b" in find_joints(stage)
    for words in (
        "# a comment of the caller\n",
        "# L1 = 0.25 m\n",
        "joint 1 a-b: is called _1_a_b, since",
        "coulomb-viscous-offset, values 1.0 2.0 3.0 (Fv, Fc, offset)",
        "joint 1 a-b: gear 30.0; torques are those on the joint's side",
        "joint2: friction model lugre",
        "joint2: its link has no mass or no inertia",
        "joint3: negative friction, Fc = -0.2; it is written as 0",
        "joint3: elastic, 900.0;",
        "joint4: friction of unknown size",
        "joint4: a torque limit of 5.0, which would limit the spring",
        "friction of 1 a-b, joint2, joint3: read by PhysX 5.6 or later only",
        "a drive coupled to several joints, m",
    ):
        assert words in text, words
    scene = UsdPhysics.Scene(stage.GetPrimAtPath("/physicsScene"))
    assert scene.GetGravityMagnitudeAttr().Get() == 0.0
    assert not find_joints(stage)["joint3"].GetAttribute("physxJointAxis:angular:dynamicFrictionEffort")
    assert write_usd(robot) == write_usd(robot)


@pytest.mark.parametrize(
    "names", [("j1", "j1_link", "base"), ("j1_link", "j1", "j1_link_link"), ("a-", "a_", "a__link")]
)
def test_every_prim_has_a_name_of_its_own(names):
    made = fill(build_chain([(0.1, 0.1, 0, "q")] * 3, name="physicsScene"))
    joints = tuple(replace(joint, name=name) for joint, name in zip(made.joints, names, strict=True))
    robot = replace(made, joints=joints)
    stage = load(write_usd(robot))
    bodies = [prim for prim in stage.Traverse() if prim.HasAPI(UsdPhysics.RigidBodyAPI)]
    found = find_joints(stage)
    # Base and links, and as many joints; scene and robot above them.
    assert (len(bodies), len(found)) == (4, 4)
    assert len(list(stage.Traverse())) == 10
    for prim in found.values():
        (body,) = UsdPhysics.Joint(prim).GetBody1Rel().GetTargets()
        assert stage.GetPrimAtPath(body).HasAPI(UsdPhysics.RigidBodyAPI)
    told = [text for text in list_usd_omissions(robot) if "is called" in text]
    assert told
    assert all(text.endswith("and no two prims the same") for text in told)
