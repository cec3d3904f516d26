"""The robots that come with symid: checked, and their base parameters counted in two ways.

The known counts are ranks of Pinocchio 4.1's torque regressor at 200 random samples; here the rank is found
again for every shipped robot.
"""

import json
from dataclasses import replace

import numpy as np
import pytest

from symid.cli.main import run
from symid.dynamics.base_parameters import derive_base_parameters
from symid.robot.description import Drive
from symid.robot.toml_reader import read_robot
from tests.chains import regress

# Base parameters of links and rotors, and of friction.
COUNTS = {
    "double_pendulum": (7, 4),
    "emps": (1, 3),
    "iiwa14": (43, 0),
    "kr30": (38, 0),
    "kr300": (42, 17),
    "lbr4": (45, 0),
    "lwr4": (43, 0),
    "panda": (43, 0),
    "ppr": (5, 0),
    "puma560": (36, 0),
    "puma560_elastic": (36, 12),
    "quadruped": (68, 0),
    "rrp_twisted": (12, 0),
    "scara": (8, 0),
    "stanford": (33, 0),
    "tx40": (41, 20),
    "two_arms": (43, 0),
    "two_link": (6, 6),
    "two_link_elastic": (6, 4),
    "two_link_harmonic": (6, 4),
    "two_link_symbols": (6, 0),
    "ur10": (36, 0),
    "ur5": (36, 0),
    "wam7": (43, 0),
}
each_robot = pytest.mark.parametrize("name", sorted(COUNTS))


def test_no_shipped_robot_is_forgotten(robots_folder):
    assert sorted(COUNTS) == sorted(path.stem for path in robots_folder.glob("*.toml"))


@each_robot
def test_a_shipped_robot_is_checked_and_has_its_count(robots_folder, capsys, name):
    file = str(robots_folder / f"{name}.toml")
    assert run(["check", file, "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert {entry["code"] for entry in answer["warnings"]} <= {"robot.elastic-joint"}
    base = derive_base_parameters(read_robot(robots_folder / f"{name}.toml"))
    assert (base.count, len(base.friction)) == COUNTS[name]


@each_robot
def test_the_links_count_as_pinocchio_says(robots_folder, name):
    """Rank of Pinocchio's regressor; rotors and springs, which it has not, add columns of their own.

    Those of elastic joints turn apart from the links and add nothing.
    """
    robot = read_robot(robots_folder / f"{name}.toml")
    drives = [joint.drive if joint.elasticity is None else Drive() for joint in robot.joints]
    joints = (replace(joint, drive=drive) for joint, drive in zip(robot.joints, drives, strict=True))
    robot, rng = replace(robot, joints=tuple(joints)), np.random.default_rng(5)
    blocks = []
    for _ in range(200):
        columns = regress(robot, *rng.uniform(-3, 3, (3, robot.freedom)), friction=False)
        blocks.append(np.column_stack(list(columns.values())))
    values = np.linalg.svd(np.vstack(blocks), compute_uv=False)
    count = COUNTS[name][0]
    assert values[count - 1] / values[0] > 1e-7
    assert count == len(values) or values[count] / values[count - 1] < 1e-8
