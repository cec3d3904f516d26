"""The robot files that come with symid, and the reference robots of the tests."""

import pytest

from symid.robot.description import Decimation, JointKind, NamedSettings, Processing
from symid.robot.toml_reader import read_robot

SIZES = """
double_pendulum 2, emps 1, iiwa14 7, kr30 6, kr300 6, lbr4 7, lwr4 7, panda 7, ppr 3, puma560 6,
puma560_elastic 6, quadruped 12, rrp_twisted 3, scara 4, stanford 6, two_arms 7, two_link 2,
two_link_elastic 2, two_link_harmonic 2, two_link_symbols 2, tx40 6, ur10 6, ur5 6, wam7 7
"""
SHIPPED = [(name, int(size)) for name, size in map(str.split, SIZES.split(","))]


def test_every_shipped_file_is_listed(robots_folder):
    assert [name for name, _ in SHIPPED] == sorted(path.stem for path in robots_folder.glob("*.toml"))


@pytest.mark.parametrize(("name", "size"), SHIPPED)
def test_shipped_files_are_read_without_mistakes(robots_folder, name, size):
    robot = read_robot(robots_folder / f"{name}.toml")
    assert (robot.name, robot.size) == (name, size)
    assert robot.source
    assert robot.description
    # Joints that give are said at every reading; there is nothing else to say.
    elastic = [joint.name for joint in robot.joints if joint.elasticity]
    assert [notice.code for notice in robot.notices] == ["robot.elastic-joint"] * len(elastic)


def test_a_reference_file_is_read_without_remarks(project):
    robot = read_robot(project / "tests" / "data" / "robots" / "puma560_std.toml")
    assert (robot.name, robot.notices) == ("puma560_std", ())


def test_emps_states_the_published_processing(robots_folder):
    emps = read_robot(robots_folder / "emps.toml")
    assert emps.joints[0].kind is JointKind.PRISMATIC
    # The axis is the frame's z axis, which gravity must not see.
    axis = [row[2].to_float() for row in emps.joints[0].placement.rotation]
    assert sum(a * g.to_float() for a, g in zip(axis, emps.gravity, strict=True)) == 0
    assert emps.joints[0].friction.law == "coulomb-viscous-offset"
    assert emps.log.torque.factor == (35.15065188,)
    decimation = Decimation(factor=10, order=8, ripple_db=0.05, band=0.8)
    stated = {"filter_cutoff": 100.0, "drop_first": 49, "standstill": 0.0, "noise_freedom": "one"}
    found = Processing(**stated, decimation=decimation)
    assert emps.settings == (NamedSettings(name="published", processing=found),)


@pytest.mark.parametrize("name", ["emps", "tx40", "kr300", "double_pendulum", "panda", "ur10"])
def test_no_robot_with_real_logs_is_tuned_to_them(robots_folder, name):
    robot = read_robot(robots_folder / f"{name}.toml")
    assert robot.processing == Processing(automatic=True)
    linear = ("none", "coulomb-viscous", "coulomb-viscous-offset")
    assert {joint.friction.law for joint in robot.joints} <= {*linear}
    assert all(joint.friction.values is None for joint in robot.joints)
