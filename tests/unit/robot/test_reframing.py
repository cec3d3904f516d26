"""Frames that depend on the robot alone: the same numbers whatever frames an author chose."""

import re
from dataclasses import replace

import numpy as np
import pytest

from symid.dynamics.base_parameters import derive_base_parameters
from symid.robot.canonical_frames import choose_canonical_frames
from symid.robot.geometry import (
    IDENTITY,
    Exact,
    build_exact_angle,
    compose_placements,
    invert_placement,
    place_modified_dh,
    rotate_z,
    translate,
)
from symid.robot.mjcf_reader import parse_xml_robot
from symid.robot.simulator_writers import write_urdf
from tests.chains import build_chain, build_joint
from tests.urdfs import AXES, write_odd_urdf

# Modified rows in degrees and m, as in the robot files; d of a last link is 0, where its frame is free.
TABLES = {
    "puma560": "0 0 0 q, 90 0 0 q, 0 0.4318 0.15005 q, -90 0.0203 0.4318 q, 90 0 0 q, -90 0 0 q",
    "panda": "0 0 0.333 q, -90 0 0 q, 90 0 0.316 q, 90 0.0825 0 q, -90 -0.0825 0.384 q, 90 0 0 q, "
    "90 0.088 0 q",
    "ur5": "0 0 0.0892 q, 90 0 0 q, 0 -0.425 0 q, 0 -0.39225 0.10915 q, 90 0 0.09465 q, -90 0 0 q",
    "stanford": "0 0 0 q, -90 0 0.1524 q, 90 0 q 0, 0 0 0 q, -90 0 0 q, 90 0 0 q",
    "ppr": "0 0 q 0, -90 0 q -90, -90 0 0 q",
    "rrp_twisted": "0 0 0 q, 30 0.2 0.1 q, 60 0.1 q 0",
}
ROWS = {
    name: [tuple(cell if cell == "q" else float(cell) for cell in row.split()) for row in text.split(",")]
    for name, text in TABLES.items()
}
TURNS = (0, 90, 180, -90, 45, -135, 30, 60, -150, 15)
SHIFTS = ("0", "0.1", "-0.25", "0.0001")


def pick(rng, values):
    return values[int(rng.integers(len(values)))]


def build_robot(name):
    rows = [
        (np.radians(alpha), a, d, theta if theta == "q" else np.radians(theta))
        for alpha, a, d, theta in ROWS[name]
    ]
    return build_chain(rows, name=name)


def choose_frames(robot, rng, turns):
    """Return the robot in link frames turned about and shifted along their axes."""
    moves = [
        compose_placements(
            rotate_z(build_exact_angle(np.radians(pick(rng, turns)) if turns else rng.uniform(-3, 3))),
            translate(Exact(), Exact(), Exact.of(pick(rng, SHIFTS))),
        )
        for _ in robot.joints
    ]
    joints = []
    for joint, move in zip(robot.joints, moves, strict=True):
        placement = compose_placements(joint.placement, move)
        if joint.parent >= 0:
            placement = compose_placements(invert_placement(moves[joint.parent]), placement)
        joints.append(replace(joint, placement=placement))
    return replace(robot, joints=tuple(joints))


@pytest.mark.parametrize("name", ROWS)
def test_the_modified_form_stays_as_it_is(name):
    robot = build_robot(name)
    reframed = choose_canonical_frames(robot.joints)
    assert reframed.joints == robot.joints
    assert reframed.moved_by == (0.0,) * robot.size


@pytest.mark.parametrize("name", ROWS)
@pytest.mark.parametrize("seed", range(4))
def test_a_urdf_in_odd_frames_gives_the_modified_form_exactly(name, seed):
    rng = np.random.default_rng(seed)
    choices = [[pick(rng, values) for _ in ROWS[name]] for values in (TURNS, SHIFTS, list(AXES))]
    robot = parse_xml_robot(write_odd_urdf(ROWS[name], *choices))
    assert [joint.placement for joint in robot.joints] == [
        joint.placement for joint in build_robot(name).joints
    ]


@pytest.mark.parametrize("name", ROWS)
@pytest.mark.parametrize("turns", [TURNS, ()], ids=["multiples", "any"])
def test_rounded_numbers_of_odd_frames_give_the_modified_form(name, turns):
    robot = build_robot(name)
    text = write_urdf(choose_frames(robot, np.random.default_rng(len(name)), turns))
    assert [joint.placement for joint in parse_xml_robot(text).joints] == [
        joint.placement for joint in robot.joints
    ]


def test_in_a_tree_the_first_child_decides():
    trunk = build_joint(0, (0.0, 0, 0, "q"))
    first = build_joint(1, (np.pi / 2, 0.2, 0, "q"), parent=0)
    placement = compose_placements(
        rotate_z(build_exact_angle(np.pi / 2)),
        place_modified_dh(build_exact_angle(np.pi / 2), *[Exact()] * 2, build_exact_angle(0)),
    )
    second = replace(build_joint(2, (0.0, 0, 0, "q"), parent=0), placement=placement)
    found = choose_canonical_frames((trunk, first, second)).joints
    assert [joint.placement for joint in found[:2]] == [trunk.placement, first.placement]
    swapped = choose_canonical_frames((trunk, second, first)).joints
    assert swapped[0].placement == compose_placements(trunk.placement, rotate_z(build_exact_angle(np.pi / 2)))


def test_a_written_distance_with_an_irrational_length_keeps_its_frame():
    first = build_joint(0, (0.0, 0, 0, "q"))
    second = build_joint(1, (0.0, 0, 0, "q"))
    aside = translate(Exact.of("0.1"), Exact.of("0.2"), Exact())
    second = replace(second, placement=aside)
    assert [joint.placement for joint in choose_canonical_frames((first, second)).joints] == [IDENTITY, aside]


def test_nearly_parallel_axes_become_parallel_and_that_is_said():
    first = build_joint(0, (0.0, 0, 0, "q"))
    tilted = place_modified_dh(
        build_exact_angle(3e-6, snap=0), Exact.of("0.3"), Exact(), build_exact_angle(0.2)
    )
    second = replace(build_joint(1, (0.0, 0, 0, "q")), placement=tilted)
    reframed = choose_canonical_frames((first, second))
    assert [str(value) for value in reframed.joints[1].placement.rotation[2]] == ["0", "0", "1"]
    assert reframed.moved_by[1] == pytest.approx(3e-6, rel=1e-3)
    free = choose_canonical_frames((first, second), snap=0)
    assert free.moved_by[1] < 1e-12
    assert free.joints[1].placement.rotation[2][1].to_float() == pytest.approx(3e-6)


def test_a_common_normal_far_away_leaves_the_origin_at_the_robot():
    first = build_joint(0, (0.0, 0, 0.1, "q"))
    tilted = compose_placements(
        translate(Exact.of("0.3"), Exact.of("0.2"), Exact()),
        place_modified_dh(build_exact_angle(1e-4), Exact(), Exact(), build_exact_angle(0)),
    )
    second = replace(build_joint(1, (0.0, 0, 0, "q")), placement=tilted)
    reframed = choose_canonical_frames((first, second))
    lengths = [value.to_float() for joint in reframed.joints for value in joint.placement.translation]
    assert max(abs(length) for length in lengths) < 1
    assert reframed.tilts == (0.0, pytest.approx(1e-4, rel=1e-6))
    steep = place_modified_dh(build_exact_angle(0.3), Exact.of("0.3"), Exact(), build_exact_angle(0))
    second = replace(second, placement=steep)
    assert choose_canonical_frames((first, second)).tilts == (0.0, 0.0)


def strip_numbers(expression):
    return re.sub(r"~?\d+\.\d+", "#", str(expression))


def write_digits(text, digits):
    """Return a URDF whose decimals have at most so many places."""
    return re.sub(
        r"-?\d+\.\d+(?:e[-+]\d+)?", lambda match: f"{round(float(match[0]), digits):.{digits}f}", text
    )


@pytest.mark.parametrize("digits", [6, 9, 12, 17])
@pytest.mark.parametrize("turns", [TURNS, ()], ids=["multiples", "any"])
def test_the_frame_does_not_depend_on_the_digits_of_the_file(digits, turns):
    robot = build_robot("ur5")
    text = write_urdf(choose_frames(robot, np.random.default_rng(3), turns))
    found = parse_xml_robot(write_digits(text, digits))
    for mine, other in zip(found.joints, robot.joints, strict=True):
        for value, wanted in zip(mine.placement.translation, other.placement.translation, strict=True):
            assert value.is_rational
            assert value.to_float() == pytest.approx(wanted.to_float(), abs=10.0 ** (2 - digits) + 1e-12)
    if digits < 12:
        return
    base, wanted = derive_base_parameters(found), derive_base_parameters(robot)
    assert [entry.name for entry in base.parameters] == [entry.name for entry in wanted.parameters]
    for mine, other in zip(base.parameters, wanted.parameters, strict=True):
        assert strip_numbers(mine.expression) == strip_numbers(other.expression)
