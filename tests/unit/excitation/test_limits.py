"""Limits on a grid hold between its points, and those left out could never be reached."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from symid.errors import RobotError
from symid.excitation.limits import compute_coefficient_scales, get_motion_limits
from symid.excitation.problem import build_limit_rows
from symid.excitation.trajectories import build_basis, build_series_space
from symid.options import ExciteOptions
from symid.robot.description import Limits
from symid.robot.toml_reader import parse_robot, read_robot
from symid.robot.toml_writer import write_robot
from tests.chains import build_limited

LIMITS = (
    Limits(position=(-0.2, 1.0), velocity=0.7, acceleration=3.0, jerk=9.0),
    Limits(position=(-20.0, 20.0), velocity=30.0),
    Limits(),
)


USUAL = ExciteOptions()


def make_space(limits, harmonics=5, period=8.0):
    options = ExciteOptions(harmonics=harmonics, period=period)
    return build_series_space(options, limits.centre, compute_coefficient_scales(limits, harmonics, period))


def test_limits_are_those_of_the_file_and_of_data_sheets(robots_folder):
    limits = get_motion_limits(build_limited(LIMITS), ExciteOptions(sweep=0.5, acceleration=9.0))
    np.testing.assert_allclose(limits.centre, [0.4, 0.0, 0.0])
    np.testing.assert_allclose(limits.half, [0.6, math.pi, 0.5])
    np.testing.assert_allclose(limits.velocity, [0.7, 30.0, 2.0])
    np.testing.assert_allclose(limits.acceleration, [3.0, 9.0, 9.0])
    np.testing.assert_allclose(limits.jerk, [9.0, np.inf, np.inf])
    assert np.all(np.isinf(limits.torque))
    said = "; ".join(limits.assumed)
    assert "position +-pi about the middle of j1" in said
    assert "position +-0.5 of j2" in said
    assert "velocity 2 /s of j2" in said
    assert "acceleration 9 /s^2 of j1, j2" in said
    stated = (LIMITS[0],) * 3
    assert get_motion_limits(build_limited(stated), USUAL).assumed == ()
    limits = get_motion_limits(read_robot(robots_folder / "panda.toml"), USUAL)
    assert limits.assumed == ()
    np.testing.assert_allclose(limits.velocity, [2.175] * 4 + [2.61] * 3)
    np.testing.assert_allclose(limits.acceleration, [15, 7.5, 10, 12.5, 15, 20, 20])
    np.testing.assert_allclose(limits.jerk, [7500, 3750, 5000, 6250, 7500, 10000, 10000])
    np.testing.assert_allclose(limits.torque, [87] * 4 + [12] * 3)


@given(seed=st.integers(0, 200), harmonics=st.integers(2, 7), density=st.integers(3, 20))
def test_rows_at_one_keep_all_limits_at_all_times(seed, harmonics, density):
    limits = get_motion_limits(build_limited(LIMITS), ExciteOptions(share=0.9))
    space = make_space(limits, harmonics)
    rows, constants = build_limit_rows(space, limits, density)
    unknowns = np.random.default_rng(seed).normal(size=space.shape)
    for joint in range(3):
        # All of the joint's series on the border of the rows.
        own = np.zeros(space.shape)
        own[joint] = unknowns[joint]
        part = rows @ own.ravel()
        room = np.where(part > 0, 1 - constants, 1 + constants)
        unknowns[joint] *= np.min(room / np.maximum(np.abs(part), 1e-300))
    states = space.compute_states(unknowns, build_basis(harmonics, 8.0, np.linspace(0, 8, 4001), 4))
    states[0] -= limits.centre
    assert np.all(np.abs(states).max(axis=1) <= 0.9 * limits.bounds * (1 + 1e-9))


def test_rows_allow_nearly_all_of_a_limit_and_leave_out_what_follows():
    limits = get_motion_limits(build_limited(LIMITS), USUAL)
    space = make_space(limits)
    rows, constants = build_limit_rows(space, limits, 20)
    # A still pose at the share of its limit, less what is lost between points.
    coefficients = space.offset.copy()
    coefficients[:, 0] += 0.987 * limits.share * limits.half
    assert np.abs(rows @ space.compute_unknowns(coefficients).ravel() + constants).max() <= 1.0
    wide = (Limits(position=(-1, 1), velocity=9, acceleration=99, jerk=9999),) * 3
    limits = get_motion_limits(build_limited(wide), USUAL)
    space = make_space(limits, harmonics=2, period=10.0)
    rows, _ = build_limit_rows(space, limits, 10)
    # 1 rad at 0.2 Hz at most is 1.3 rad/s, 1.6 rad/s^2 and 2 rad/s^3: the position says it all.
    assert [np.count_nonzero(part.any(axis=1)) for part in np.split(rows, 3, axis=1)] == [20, 20, 20]


def test_scales_are_the_amplitudes_that_one_harmonic_may_have():
    limits = get_motion_limits(build_limited(LIMITS), USUAL)
    scales = compute_coefficient_scales(limits, 3, 8.0)
    w = 2 * np.pi / 8 * np.arange(1, 4)
    wanted = 0.95 * np.min([np.full(3, 0.6), 0.7 / w, 3.0 / w**2, 9.0 / w**3], axis=0)
    np.testing.assert_allclose(scales[0, 1:], np.tile(wanted, 2))
    np.testing.assert_allclose(scales[:, 0], 0.95 * limits.half)


TEXT = """
name = "one"
convention = "modified"
gravity = [0, 0, -9.81]
[[joint]]
kind = "revolute"
[joint.limits]
position = [-1, 1]
acceleration = 7.5
jerk = 3750
"""


def test_a_robot_file_states_acceleration_and_jerk():
    robot = parse_robot(TEXT)
    wanted = Limits(position=(-1.0, 1.0), acceleration=7.5, jerk=3750.0)
    assert robot.joints[0].limits == wanted
    assert parse_robot(write_robot(robot)).joints[0].limits == wanted
    with pytest.raises(RobotError, match=r":9:.*acceleration: .* rad/s\^2"):
        parse_robot(TEXT.replace("7.5", "-7.5"))
    with pytest.raises(RobotError, match=r":10:.*jerk: .* rad/s\^3"):
        parse_robot(TEXT.replace("3750", '"high"'))
