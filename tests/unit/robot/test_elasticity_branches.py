"""Springs with branches in robot files: read as they are written; what is no spring."""

import re
from dataclasses import replace

import numpy as np
import pytest

from symid.environment import locate_resource_folder
from symid.joint_models import BoucWen, BristleBranch, Elasticity, SlipSpring, Stop, needs_time, run_element
from symid.joint_models.hysteresis import Knee
from symid.robot.toml_reader import parse_robot, read_robot
from symid.robot.toml_writer import write_robot
from tests.elements import ELEMENTS
from tests.mistakes import refuse

HEAD = 'convention = "modified"\ngravity = [0, 0, -9.81]\n[[joint]]\nname = "shoulder"\nkind = "revolute"\n'
SPRING = "[joint.elasticity]\nstiffness = 380\n"


def read_spring(lines, kind="revolute"):
    return parse_robot(HEAD.replace("revolute", kind) + SPRING + lines).joints[0].elasticity


def write_arm(folder, springs):
    """Write the shipped elastic arm with these springs, and return the file."""
    arm = read_robot(locate_resource_folder("robots") / "two_link_elastic.toml")
    joints = tuple(
        replace(joint, elasticity=spring) for joint, spring in zip(arm.joints, springs, strict=True)
    )
    file = folder / "arm.toml"
    file.write_text(write_robot(replace(arm, joints=joints)))
    return file


@pytest.mark.parametrize("kind", sorted(ELEMENTS))
@pytest.mark.parametrize("joint", ["revolute", "prismatic"])
def test_what_is_written_is_read_back(kind, joint):
    spring = ELEMENTS[kind]
    robot = parse_robot(HEAD.replace("revolute", joint) + SPRING)
    text = write_robot(replace(robot, joints=(replace(robot.joints[0], elasticity=spring),)))
    again = parse_robot(text).joints[0].elasticity
    assert text == write_robot(parse_robot(text))
    path = np.random.default_rng(3).uniform(-1.0, 1.0, 300)
    time = np.arange(300) * 1e-2
    before, after = (run_element(entry, path, time).output for entry in (spring, again))
    np.testing.assert_array_equal(after, before)


def test_the_file_says_what_the_record_holds():
    bent = "level = 1.5\nlength = 0.004\nsharpness = 1.4\nloop = 0.8\nskew = 0.2\n"
    branch = BoucWen(level=1.5, length=0.004, sharpness=1.4, loop=0.8, skew=0.2)
    expected = Elasticity(stiffness=380.0, branches=(branch,))
    assert read_spring('model = "bouc_wen"\n' + bent) == expected
    assert read_spring('model = "bouc-wen"\n' + bent) == expected
    assert read_spring('[[joint.elasticity.branch]]\nmodel = "bouc-wen"\n' + bent) == expected
    assert read_spring('model = "prandtl-ishlinskii"\n') == Elasticity(stiffness=380.0)
    plain = read_spring('model = "dahl"\nFc = 2\nsigma0 = 30\nbacklash = 0.01\noffset = -0.5\n')
    bristle = BristleBranch(law="dahl", values=(("Fc", 2.0), ("sigma0", 30.0)))
    assert plain == Elasticity(stiffness=380.0, branches=(bristle,), backlash=0.01, offset=-0.5)


def test_maxwell_slip_is_a_set_of_stops():
    found = read_spring('model = "maxwell_slip"\nstiffnesses = [120, 60]\nforces = [0.24, 0.3]\n')
    stops = (Stop(threshold=0.3 / 60, stiffness=60.0), Stop(threshold=0.24 / 120, stiffness=120.0))
    assert found == Elasticity(stiffness=380.0, stops=tuple(sorted(stops)))
    with_stop = 'stops = [{ threshold = 0.1, stiffness = 5 }]\nmodel = "maxwell-slip"\nstiffnesses = [120]\n'
    both = read_spring(with_stop + "forces = [0.24]\n")
    assert [stop.threshold for stop in both.stops] == [0.002, 0.1]


def test_a_level_that_falls_with_the_speed_is_lugre():
    text = 'model = "lugre"\nFc = 1\nFe = 0.5\nvs = 0.1\nsigma0 = 50\nsigma1 = 0.2\nFv = 0.1\n'
    (branch,) = read_spring(text).branches
    assert branch.law == "lugre"
    assert dict(branch.values)["gamma"] == 2.0
    assert needs_time(read_spring(text))
    elements = 'model = "generalised-maxwell-slip"\nFc = 1\nstiffnesses = [20, 10]\nshares = [0.4, 0.6]\n'
    assert read_spring(elements).branches[0].law == "maxwell-slip"
    assert read_spring(elements + "Fe = 1\nvs = 2\n").branches[0].law == "generalised-maxwell-slip"


def test_several_branches_stand_beside_stops():
    slip = '[[joint.elasticity.branch]]\nmodel = "nonlinear-stops"\n'
    slip += "deflections = [-0.1, 0.1]\nforces = [-2, 1]\n"
    spring = read_spring("stops = [{ threshold = 0.1, stiffness = 5 }]\n" + slip + slip)
    assert spring.branches == (SlipSpring(deflections=(-0.1, 0.1), forces=(-2.0, 1.0)),) * 2
    assert len(spring.stops) == 1


@pytest.mark.parametrize(
    ("stops", "knees", "said"),
    [
        ((0.005, 0.002), (), "of stops"),
        ((0.0,), (), "of stops"),
        ((float("nan"),), (), "of stops"),
        ((), ((0.0, 0.5),), "of knees"),
        ((), ((2.0, 0.5), (1.0, 0.5)), "of knees"),
        ((), ((1.0, -0.5), (2.0, -0.6)), "beyond 2 .* -0.1"),
        ((), ((-2.0, -0.6), (-1.0, -0.5)), "beyond -2 .* -0.1"),
    ],
)
def test_what_is_no_spring_is_refused(stops, knees, said):
    stops = tuple(Stop(threshold=threshold) for threshold in stops)
    knees = tuple(Knee(threshold=threshold, slope=slope) for threshold, slope in knees)
    (notice,) = refuse(Elasticity, stiffness=1.0, stops=stops, knees=knees)
    assert notice.code == "robot.invalid-elasticity"
    assert re.search(said, notice.text)
