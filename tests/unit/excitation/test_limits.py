"""Limits on a grid hold between its points, and those left out could never be reached."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from symid.errors import RobotError
from symid.excitation.limits import (
    WorkspaceRegion,
    compute_coefficient_scales,
    get_motion_limits,
    read_workspace,
)
from symid.excitation.problem import build_limit_rows
from symid.excitation.trajectories import build_basis, build_series_space
from symid.options import ExciteOptions
from symid.robot.description import Limits
from symid.robot.toml_reader import read_robot
from tests.chains import build_limited
from tests.refusals import raises

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
    wanted = [[0.6, math.pi, 0.5], [0.7, 30.0, 2.0], [3.0, 9.0, 9.0], [9.0, np.inf, np.inf]]
    np.testing.assert_allclose(limits.bounds, wanted)
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
    np.testing.assert_allclose(limits.bounds[1], [2.175] * 4 + [2.61] * 3)
    np.testing.assert_allclose(limits.bounds[2], [15, 7.5, 10, 12.5, 15, 20, 20])
    np.testing.assert_allclose(limits.bounds[3], [7500, 3750, 5000, 6250, 7500, 10000, 10000])
    np.testing.assert_allclose(limits.torque, [87] * 4 + [12] * 3)


@given(seed=st.integers(0, 200), harmonics=st.integers(2, 7), density=st.integers(3, 20))
def test_rows_at_one_keep_all_limits_at_all_times(seed, harmonics, density):
    limits = get_motion_limits(build_limited(LIMITS), ExciteOptions(share=0.9))
    space = make_space(limits, harmonics)
    rows, constants = build_limit_rows(space, limits, density)
    unknowns = np.random.default_rng(seed).normal(size=space.maps[:, 0].shape)
    for joint in range(3):
        # All of the joint's series on the border of the rows.
        own = np.zeros(unknowns.shape)
        own[joint] = unknowns[joint]
        part = rows @ own.ravel()
        room = np.where(part > 0, 1 - constants, 1 + constants)
        unknowns[joint] *= np.min(room / np.maximum(np.abs(part), 1e-300))
    states = space.compute_states(unknowns, build_basis(harmonics, 8.0, np.linspace(0, 8, 4001), 4))
    states[0] -= limits.centre
    assert np.all(np.abs(states).max(axis=1) <= 0.9 * limits.bounds * (1 + 1e-9))


def test_scales_are_the_amplitudes_that_one_harmonic_may_have():
    limits = get_motion_limits(build_limited(LIMITS), USUAL)
    scales, w = compute_coefficient_scales(limits, 3, 8.0), 2 * np.pi / 8 * np.arange(1, 4)
    wanted = 0.95 * np.min([np.full(3, 0.6), 0.7 / w, 3.0 / w**2, 9.0 / w**3], axis=0)
    np.testing.assert_allclose(scales[0, 1:], np.tile(wanted, 2))
    np.testing.assert_allclose(scales[:, 0], 0.95 * limits.half)


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


GOOD = """
[[sphere]]
keep = "in"
centre = [0.1, 0, 0.2]
radius = 0.9
links = ["elbow", "shoulder"]
point = [0.0, 0.1, 0.0]
size = 0.05

[[sphere]]
centre = [1, 1, 1]
radius = 0.5

[[plane]]
normal = [0, 3, 4]
offset = -0.1
"""


def read(tmp_path, robot, text):
    path = tmp_path / "space.toml"
    path.write_text(text, encoding="utf-8")
    return read_workspace(path, robot)


def test_regions_are_what_the_file_says(tmp_path, robot):
    both = {"joints": (1, 0), "place": (0.0, 0.1, 0.0), "size": 0.05}
    last = {"joints": (1,), "place": (0.0, 0.0, 0.0), "size": 0.0}
    workspace = read(tmp_path, robot, GOOD)
    assert workspace == (
        WorkspaceRegion(kind="in", anchor=(0.1, 0.0, 0.2), extent=0.9, label="sphere 1", **both),
        WorkspaceRegion(kind="out", anchor=(1.0, 1.0, 1.0), extent=0.5, label="sphere 2", **last),
        WorkspaceRegion(kind="plane", anchor=(0.0, 0.6, 0.8), extent=-0.1, label="plane 1", **last),
    )


@pytest.mark.parametrize(
    ("change", "code", "says"),
    [
        (('"in"', '"inside"'), "robot.bad-choice", "3:8: sphere 1: keep: "),
        (("radius = 0.9", "radius = 0"), "robot.out-of-range", "5:10: sphere 1: radius: .* 0 m"),
        (("radius = 0.5", ""), "robot.missing-key", "sphere 2: radius: "),
        (("centre = [1, 1, 1]", ""), "robot.missing-key", "sphere 2: centre: "),
        (("centre = [1, 1, 1]", "centre = [1, 1]"), "robot.wrong-type", r"11:10: sphere 2: centre: "),
        (('["elbow", "shoulder"]', '["wrist"]'), "robot.bad-choice", "wrist.*shoulder, elbow"),
        (('["elbow", "shoulder"]', "[]"), "robot.bad-choice", r"sphere 1: links: .*got \[\]"),
        (("size = 0.05", "size = -1"), "robot.out-of-range", "sphere 1: size: .* 0 m"),
        (("size = 0.05", "size = 2"), "robot.out-of-range", "sphere 1: size: .* 0.9 m"),
        (("[0.0, 0.1, 0.0]", '["a", 0, 0]'), "robot.wrong-type", 'sphere 1: point: .* m, got "a"'),
        (("[0, 3, 4]", "[0, 0, 0]"), "robot.out-of-range", "plane 1: normal: "),
        (("offset = -0.1", ""), "robot.missing-key", "plane 1: offset: "),
        (("[[plane]]", "[[cube]]"), "robot.unknown-key", "cube: "),
        (("[[plane]]", "[plane]"), "robot.wrong-type", r"plane: .*\[\[plane\]\]"),
        (("[[plane]]", "[plane"), "excitation.workspace", "TOML"),
        (("radius = 0.9", "radius = 0.9\ncolour = 1"), "robot.unknown-key", "6:1: sphere 1: colour: "),
    ],
)
def test_mistakes_are_named_with_their_place(tmp_path, robot, change, code, says):
    with raises(RobotError, code, match=says):
        read(tmp_path, robot, GOOD.replace(*change))


def test_all_mistakes_are_told_at_once_and_an_empty_file_is_refused(tmp_path, robot):
    with pytest.raises(RobotError) as caught:
        read(tmp_path, robot, GOOD.replace("radius", "radios").replace("normal", "normals"))
    assert len(caught.value.notices) == 6
    with raises(RobotError, "excitation.workspace", match=r"space.toml"):
        read(tmp_path, robot, "# nothing\n")
