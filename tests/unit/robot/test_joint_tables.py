"""What the tables of a joint mean: kinds, followers, springs, couplings, symbols, general frames."""

import math
from fractions import Fraction

import numpy as np
import pytest

from symid.joint_models.hysteresis import Elasticity, Knee, Stop
from symid.robot.description import LogQuantity, Mimic, SymbolicInertia
from symid.robot.geometry import IDENTITY, Exact, build_exact_angle, compose_placements, rotate_z, translate
from symid.robot.inertia import move_parameters
from symid.robot.toml_reader import parse_robot
from tests.chains import to_matrix
from tests.mistakes import refuse

HEAD = 'convention = "modified"\ngravity = [0, 0, -9.81]\n'


def write_joint(name, kind="revolute", extra=""):
    return f'[[joint]]\nname = "{name}"\nkind = "{kind}"\n{extra}'


def read(*joints, tail=""):
    return parse_robot("".join((HEAD, *joints, tail)))


def read_joint(extra, kind="revolute"):
    (joint,) = read(write_joint("a", kind, extra)).joints
    return joint


def to_floats(placement):
    matrix = to_matrix(placement)
    return matrix[:3, :3], matrix[:3, 3]


LINK = "link = { mass = 2, com = [0.1, 0, 0.05], inertia = { xx = 0.01, yy = 0.02, zz = 0.02 } }\n"


@pytest.mark.parametrize("convention", ["modified", "standard"])
def test_a_fixed_link_makes_its_carrier_heavier(convention):
    row = 'alpha = "pi/2"\na = 0.3\nd = 0.2\ntheta = "pi/6"\n'
    text = f'convention = "{convention}"\ngravity = [0, 0, -9.81]\n'
    text += write_joint("a", extra="a = 0.1\n" + LINK)
    text += write_joint("plate", "fixed", row + LINK) + write_joint("b", extra="d = 0.4\n")
    robot = parse_robot(text)
    moving = parse_robot(text.replace('"fixed"', '"revolute"'))
    first, plate, last = moving.joints
    assert [joint.name for joint in robot.joints] == ["a", "b"]
    moved = move_parameters(plate.inertial, *to_floats(plate.placement))
    np.testing.assert_allclose(robot.joints[0].inertial, np.add(first.inertial, moved), rtol=1e-14)
    assert robot.joints[1].placement == compose_placements(plate.placement, last.placement)
    assert robot.joints[1].parent == 0
    (notice,) = robot.notices
    assert (notice.code, notice.line) == ("robot.lumped", text[: text.index('"fixed"')].count("\n") + 1)


def test_fixed_joints_leave_couplings_and_followers_right():
    robot = read(
        write_joint("foot", "fixed"),
        write_joint("a"),
        write_joint("b", extra='mimic = { joint = "c", multiplier = "-1/3" }\n'),
        write_joint("c"),
        tail='[[coupling]]\nname = "m"\nterms = { c = 2, a = "1/2" }\n',
    )
    assert [joint.name for joint in robot.joints] == ["a", "b", "c"]
    assert robot.joints[1].mimic == Mimic(master=2, multiplier=Fraction(-1, 3))
    assert robot.couplings[0].terms == ((0, Fraction(1, 2)), (2, Fraction(2)))
    assert robot.freedom == 2


def test_the_offset_of_a_follower_is_in_its_placement():
    mimic = 'mimic = { joint = "a", multiplier = 0.5, offset = "pi/3" }\na = 0.2\ntheta = "pi/6"\n'
    plain = 'a = 0.2\ntheta = "pi/2"\n'
    joint, plain = (read(write_joint("a"), write_joint("b", extra=row)).joints[1] for row in (mimic, plain))
    assert joint.placement == plain.placement
    assert joint.mimic == Mimic(master=0, multiplier=Fraction(1, 2))


def test_the_offset_of_a_sliding_follower_is_a_length():
    mimic = 'mimic = { joint = "a", multiplier = -1, offset = "L1" }\n'
    slides = write_joint("a", "prismatic"), write_joint("b", "prismatic", mimic)
    joint = read("[symbols]\nL1 = 0.3\n", *slides).joints[1]
    assert joint.placement.translation == (Exact(), Exact(), Exact.symbol("L1"))


def test_chains_of_followers_are_resolved():
    joints = read(
        write_joint("a", extra='mimic = { joint = "b", multiplier = 2, offset = 0.25 }\n'),
        write_joint("b", extra='mimic = { joint = "c", multiplier = "1/3", offset = 0.3 }\n'),
        write_joint("c"),
        write_joint("slide", "prismatic", 'mimic = { joint = "b", multiplier = 0.1, offset = 0.01 }\n'),
    ).joints
    # q_a = 2 (q_c / 3 + 0.3) + 0.25; the slide is 0.1 (q_c / 3 + 0.3) + 0.01.
    assert joints[0].mimic == Mimic(master=2, multiplier=Fraction(2, 3))
    assert joints[0].placement == rotate_z(build_exact_angle(0.85))
    assert joints[1].placement == rotate_z(build_exact_angle(0.3))
    assert joints[3].mimic == Mimic(master=2, multiplier=Fraction(1, 30))
    assert joints[3].placement.translation[2].to_float() == pytest.approx(0.04, rel=1e-15)


def test_elasticity_with_hysteresis_is_read():
    knees = "[{ threshold = 3.0, slope = 0.5 }, { threshold = 5, slope = -1.2 }]"
    stops = '[{ threshold = 0.002, stiffness = 120 }, { threshold = 0.005, stiffness = "unknown" }]'
    table = f"stiffness = 380, damping = 0.2, stops = {stops}, symmetric = true, knees = {knees}"
    joint = read_joint(f"elasticity = {{ {table} }}\n")
    above = (Knee(threshold=3.0, slope=0.5), Knee(threshold=5.0, slope=-1.2))
    below = (Knee(threshold=-5.0, slope=-1.2), Knee(threshold=-3.0, slope=0.5))
    assert joint.elasticity == Elasticity(
        stiffness=380.0,
        damping=0.2,
        stops=(Stop(threshold=0.002, stiffness=120.0), Stop(threshold=0.005)),
        knees=(*below, *above),
    )
    knees = "[{ threshold = -2, slope = 1 }, { threshold = 1, slope = 2 }]"
    uneven = f"elasticity = {{ stiffness = 1, knees = {knees} }}\n"
    joint = read_joint(uneven)
    assert joint.elasticity.knees == (Knee(threshold=-2.0, slope=1.0), Knee(threshold=1.0, slope=2.0))
    joint = read_joint("elasticity = { stiffness = 1, cubic = 5 }\n")
    assert joint.elasticity == Elasticity(stiffness=1.0, cubic=5.0)


def test_a_catalogue_is_stiffness_and_knees():
    table = "elasticity = { catalogue = { K1 = 100, K2 = 150, K3 = 300, T1 = 2, T2 = 5 }, damping = 1 }\n"
    joint = read_joint(table)
    above = (Knee(threshold=2.0, slope=0.5), Knee(threshold=4.0, slope=1.5))
    assert (joint.elasticity.stiffness, joint.elasticity.damping) == (100.0, 1.0)
    assert joint.elasticity.knees[2:] == above


def test_symbols_stand_for_any_quantity():
    text = (
        'convention = "modified"\ngravity = [0, "-g", "1/2*g"]\n'
        "[symbols]\ng = 9.81\nm1 = 2.0\nlc1 = -0.25\nI1 = 0.02\nL1 = 0.5\n"
        '[[joint]]\nkind = "revolute"\na = "L1"\nd = "1/2*sqrt(3)*L1 - 0.1"\n'
        'link = { mass = "m1", com = ["-lc1", 0.1, 0], inertia = { xx = "I1", zz = "2*I1", yy = "3*I1" } }\n'
    )
    robot = parse_robot(text)
    (joint,) = robot.joints
    g, half = Exact.symbol("g"), Exact.of(Fraction(1, 2))
    assert robot.gravity == (Exact(), -g, half * g)
    root = Exact.surd(Fraction(0), 0, Fraction(1, 2))
    assert joint.placement.translation[2] == root * Exact.symbol("L1") - Exact.of("0.1")
    zero, inertia = Exact(), Exact.symbol("I1")
    assert joint.form == SymbolicInertia(
        mass=Exact.symbol("m1"),
        com=(-Exact.symbol("lc1"), Exact.of("0.1"), zero),
        inertia=(inertia, zero, zero, Exact.of(3) * inertia, zero, Exact.of(2) * inertia),
    )
    # XX = I1 + m y^2, XY = -m x y, MX = m x.
    assert joint.inertial[0] == pytest.approx(0.02 + 2 * 0.1**2)
    assert joint.inertial[1] == pytest.approx(-2 * 0.25 * 0.1)
    assert joint.inertial[6] == pytest.approx(0.5)
    assert robot.notices == ()


def test_an_origin_is_that_of_urdf():
    """Rz(yaw) Ry(pitch) Rx(roll), by elementary matrices."""
    origin = "origin = { xyz = [1, -0.5, 0.25], rpy = [0.3, -0.4, 1.2] }\n"
    rotation, translation = to_floats(read_joint(origin).placement)
    r, p, y = 0.3, -0.4, 1.2
    turn_x = np.array([[1, 0, 0], [0, math.cos(r), -math.sin(r)], [0, math.sin(r), math.cos(r)]])
    turn_y = np.array([[math.cos(p), 0, math.sin(p)], [0, 1, 0], [-math.sin(p), 0, math.cos(p)]])
    turn_z = np.array([[math.cos(y), -math.sin(y), 0], [math.sin(y), math.cos(y), 0], [0, 0, 1]])
    np.testing.assert_allclose(rotation, turn_z @ turn_y @ turn_x, atol=1e-15)
    assert translation.tolist() == [1.0, -0.5, 0.25]


def test_children_and_links_stand_in_the_frame_of_the_link():
    turned = 'origin = { rpy = [0, "pi/2", 0] }\nframe = { rpy = [0, "-pi/2", 0] }\n'
    text = (
        'convention = "origin"\ngravity = [0, 0, -9.81]\n'
        + write_joint("hip", extra=turned + LINK)
        + write_joint("knee", extra="origin = { xyz = [0.1, 0.2, 0.3] }\n")
    )
    robot = parse_robot(text)
    hip, knee = robot.joints
    assert compose_placements(hip.placement, hip.frame) == IDENTITY
    moved = translate(Exact.of("0.1"), Exact.of("0.2"), Exact.of("0.3"))
    assert compose_placements(hip.placement, knee.placement) == moved
    assert robot.joints[-1].frame == IDENTITY
    plain = read_joint(LINK).inertial
    np.testing.assert_allclose(hip.inertial, move_parameters(plain, *to_floats(hip.frame)), atol=1e-16)


def test_a_follower_has_no_column_in_the_log():
    joints = write_joint("a"), write_joint("b", extra='mimic = { joint = "a" }\n'), write_joint("c")
    log = '[log]\nposition = { columns = ["qa", "qc"], unit = "rad" }\n'
    assert read(*joints, tail=log).log.position == LogQuantity(columns=("qa", "qc"), unit="rad")


@pytest.mark.parametrize("name", ["Fv1", "Fcn2", "offset2", "KR3", "IAm6", "Fvm6"])
def test_symbols_do_not_read_as_parameters(name):
    coupling = '[[coupling]]\nname = "m6"\nterms = { a = 1 }\nrotor_inertia = "unknown"\n'
    joint = write_joint("a", extra=f'd = "{name}"\n')
    (notice,) = refuse(read, joint, coupling, tail=f"[symbols]\n{name} = 1\n")
    assert notice.code == "robot.bad-name"
    assert f"symbols: {name}: " in notice.text
