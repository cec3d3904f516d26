"""Trajectories: exact derivatives, rest at the start, the papers' numbers, limits kept."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from symid.errors import LogError, OutputError, UsageError
from symid.excitation.trajectories import (
    FourierOptions,
    SampledMotion,
    build_basis,
    build_fourier,
    build_grid_basis,
    build_motion,
    build_random_fourier,
    build_series_space,
    build_ta,
    build_tb,
    build_tc,
    read_trajectory,
    scale_trajectory,
    write_trajectory,
)
from symid.options import ExciteOptions
from symid.robot.description import Limits
from tests.chains import build_limited
from tests.refusals import raises, tell


def random_series(seed, ramp=2.0):
    rng = np.random.default_rng(seed)
    return build_fourier(rng.normal(size=(3, 9)), 0.2, duration=10.0, ramp=ramp)


def test_fourier_series_is_its_formula():
    rng = np.random.default_rng(3)
    sines, cosines = rng.normal(size=(2, 2, 3))
    series = build_fourier(np.hstack([[[1.0], [-2.0]], sines, cosines]), 0.5, duration=4.0, ramp=0.0)
    t = np.linspace(0, 4, 50)
    angle = np.pi * np.outer(t, [1, 2, 3])
    expected = [1.0, -2.0] + np.sin(angle) @ sines.T + np.cos(angle) @ cosines.T
    np.testing.assert_allclose(series.evaluate(t)[0], expected, atol=1e-12)


def test_ta_has_the_published_ranges_and_speeds():
    t = np.linspace(10.0, 20.0, 200_001)  # one period, after the ramp
    q, dq, ddq = build_ta().evaluate(t)
    np.testing.assert_allclose(np.degrees(q.min(axis=0)), [-6.659, -7.626], atol=5e-4)
    np.testing.assert_allclose(np.degrees(q.max(axis=0)), [8.628, 8.698], atol=5e-4)
    np.testing.assert_allclose(np.abs(dq).max(axis=0), [0.532, 0.552], atol=5e-4)
    np.testing.assert_allclose(np.abs(ddq).max(axis=0), [2.64, 2.61], atol=5e-3)
    reversals = (np.diff(np.sign(dq), axis=0) != 0).sum(axis=0)
    np.testing.assert_array_equal(reversals, [20, 20])


def test_ta_and_tb_without_ramp_start_and_turn_where_the_papers_do():
    q, dq, _ = build_ta(ramp=0.0).evaluate(np.zeros(1))
    np.testing.assert_allclose(q[0], [0.0632, 0.0831], atol=5e-5)
    np.testing.assert_allclose(dq[0], [0.518, 0.332], atol=5e-4)
    q, dq, _ = build_tb(0, ramp=0.0).evaluate(np.zeros(1))
    np.testing.assert_allclose([q[0, 0], dq[0, 0]], [np.pi / 2, -np.pi / 100], atol=1e-12)
    t = np.linspace(0.0, 50.0, 500_001)
    q, dq, ddq = build_tb(1, ramp=0.0).evaluate(t)
    assert not q[:, 0].any()
    turns = np.flatnonzero(np.diff(np.sign(dq[:, 1])) != 0)
    expected = [-81.05, 72.06, -63.07, 54.08, -45.09, 36.11, -27.15, 18.22, -9.42, 1.61]
    np.testing.assert_allclose(np.degrees(q[turns, 1])[:10], expected, atol=6e-3)
    np.testing.assert_allclose([np.abs(dq).max(), np.abs(ddq).max()], [0.940, 0.62], atol=5e-3)
    with raises(UsageError, "usage.unknown-joint", match=r"joint 3; .* 2"):
        build_tb(2)


LIMITS = (Limits(position=(-0.2, 1.0), velocity=0.7), Limits(position=(-20.0, 20.0), velocity=30.0), Limits())


@given(seed=st.integers(0, 500), harmonics=st.integers(1, 8))
def test_random_series_keep_the_limits_and_use_them(seed, harmonics):
    options = FourierOptions(harmonics=harmonics)
    trajectory = build_random_fourier(build_limited(LIMITS), np.random.default_rng(seed), options)
    q, dq, ddq = trajectory.evaluate(np.linspace(0.0, options.duration, 5000))
    share = np.array(
        [
            np.abs(q - [0.4, 0.0, 0.0]).max(axis=0) / [0.6, np.pi, 1.0],
            np.abs(dq).max(axis=0) / [0.7, 30.0, 2.0],
            np.abs(ddq).max(axis=0) / 10.0,
        ]
    )
    assert np.all(share < 0.95)
    # Of the three limits one is used as far as is allowed.
    np.testing.assert_allclose(share.max(axis=0), 0.9, rtol=0.01)


def test_series_repeat_with_their_generator_and_are_scaled_about_their_centre():
    first, second = (build_random_fourier(build_limited(LIMITS), np.random.default_rng(5)) for _ in range(2))
    assert first.amplitude.tobytes() == second.amplitude.tobytes()
    assert replace(first, ramp=0.0).source == second.source
    plain = random_series(5)
    t = np.linspace(0.0, 9.0, 40)
    scaled = scale_trajectory(plain, 10.0)
    gaps = (scaled.evaluate(t)[0] - plain.centre) - 10.0 * (plain.evaluate(t)[0] - plain.centre)
    np.testing.assert_allclose(gaps, 0.0, atol=1e-12)
    assert scaled.source == f"{plain.source}, amplitudes times 10"
    assert scale_trajectory(plain, 1.0) is plain


@pytest.mark.parametrize(
    "trajectory",
    [build_ta(), build_ta(ramp=0.0), build_tb(0), build_tb(1), build_tc()]
    + [random_series(seed, ramp) for seed, ramp in ((3, 0.5), (4, 0.0), (5, 2.0))],
)
def test_higher_derivatives_are_those_of_the_lower_ones(trajectory):
    h = 1e-4
    # Away from the ends of the ramp, where the third derivative jumps.
    times = np.linspace(0.05, trajectory.duration - 0.05, 311)
    times = times[np.abs(times - trajectory.ramp) > 2 * h]
    ahead, behind = (trajectory.evaluate(times + sign * h, 5) for sign in (1, -1))
    found = trajectory.evaluate(times, 6)
    assert len(found) == 7
    q, dq, ddq = (part[0] for part in trajectory.evaluate(np.zeros(1)))
    if trajectory.ramp:
        # It starts at its centre at rest.
        np.testing.assert_array_equal([q, dq, ddq], [trajectory.centre, 0.0 * q, 0.0 * q])
    for order in range(1, 7):
        slope = (ahead[order - 1] - behind[order - 1]) / (2 * h)
        scale = np.abs(found[order]).max()
        np.testing.assert_allclose(found[order], slope, atol=2e-6 * scale + 1e-7, err_msg=str(order))


def test_tc_is_the_sum_that_is_stated():
    t = np.linspace(2.5, 20.0, 50)
    (q,) = build_tc(size=3).evaluate(t, 0)
    for joint in range(3):
        wanted = sum(
            0.4 * a * np.sin(2.0 * np.pi * f * t + phase + joint)
            for a, f, phase in ((1.0, 0.15, 0.0), (0.5, 0.45, 1.0), (0.25, 0.9, 2.0))
        )
        np.testing.assert_allclose(q[:, joint], wanted, atol=1e-14)


CENTRE = np.array([0.3, -1.2])


def make_space(*, moving=False, start=None, harmonics=4, period=7.0):
    options = ExciteOptions(harmonics=harmonics, period=period, moving=moving, start=start)
    scales = np.random.default_rng(1).uniform(0.2, 2.0, size=(2, 2 * harmonics + 1))
    return build_series_space(options, CENTRE, scales)


def draw(space, seed):
    return np.random.default_rng(seed).normal(size=space.maps[:, 0].size)


@given(seed=st.integers(0, 100), harmonics=st.integers(2, 8))
def test_every_series_starts_and_ends_at_rest(seed, harmonics):
    space = make_space(harmonics=harmonics)
    ends = build_basis(harmonics, space.period, np.array([0.0, space.period]), 3)
    q, dq, ddq = space.compute_states(draw(space, seed), ends)
    np.testing.assert_allclose(dq, 0.0, atol=1e-8)
    np.testing.assert_allclose(ddq, 0.0, atol=1e-7)
    np.testing.assert_allclose(q[0], q[1], atol=1e-9)


@pytest.mark.parametrize(
    ("moving", "start", "left"), [(False, None, 7), (True, None, 9), (False, (0.0, 0.0), 6)]
)
def test_demands_take_as_many_unknowns_as_they_are(moving, start, left):
    space = make_space(moving=moving, start=start)
    assert space.maps[:, 0].shape == (2, left)
    for part in space.maps:
        assert np.linalg.matrix_rank(part) == left


def test_unknowns_give_a_trajectory_and_come_back():
    space = make_space()
    unknowns = draw(space, 3)
    np.testing.assert_allclose(
        space.compute_unknowns(space.compute_coefficients(unknowns)), unknowns, atol=1e-10
    )
    space = make_space(moving=True)
    unknowns = draw(space, 4)
    t = np.linspace(0.0, 7.0, 50)
    states = space.compute_states(unknowns, build_basis(4, 7.0, t, 4))
    trajectory = build_fourier(space.compute_coefficients(unknowns), 1.0 / 7.0, duration=7.0, ramp=0.0)
    for state, wanted in zip(states, trajectory.evaluate(t, 3), strict=True):
        np.testing.assert_allclose(state, wanted, atol=1e-10)
    assert (trajectory.duration, trajectory.size) == (7.0, 2)
    space = make_space()
    np.testing.assert_array_equal(
        build_grid_basis(space, 8, 2), build_basis(4, 7.0, np.arange(8) * 7.0 / 8, 2)
    )


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"harmonics": 1}, "harmonics: .* 2 .* got 1"),
        ({"start": (0.0,)}, "1 positions, .* 2 joints"),
        ({"start": (0.0, np.nan)}, "not finite"),
    ],
)
def test_options_that_cannot_be(options, says):
    with raises(UsageError, "usage.excitation", match=says):
        build_series_space(ExciteOptions(**options), CENTRE, np.ones((2, 11)))


TIMES = np.array([0.0, 0.2, 0.5, 0.9, 1.0, 1.6])


def sample(functions, times=TIMES):
    q, dq, ddq = (
        np.column_stack([f.deriv(k)(times) if k else f(times) for f in functions]) for k in range(3)
    )
    return SampledMotion(time=times, position=q, velocity=dq, acceleration=ddq, source="here")


def test_polynomials_and_waves_come_back_between_their_samples():
    rng = np.random.default_rng(1)
    functions = [np.polynomial.Polynomial(rng.normal(size=6)) for _ in range(2)]
    motion = sample(functions)
    t = np.linspace(0.01, 1.59, 77)
    found = motion.evaluate(t, 6)
    for order, values in enumerate(found):
        wanted = np.column_stack([f.deriv(order)(t) if order else f(t) for f in functions])
        np.testing.assert_allclose(values, wanted, atol=1e-8 * 50**order)
    assert (motion.size, motion.duration) == (2, 1.6)
    wave = build_tc(size=3)
    t = np.linspace(0.0, 20.0, 2001)
    q, dq, ddq = wave.evaluate(t)
    motion = SampledMotion(time=t, position=q, velocity=dq, acceleration=ddq, source="tc")
    between = t[:-1] + 0.004
    for found, wanted, near in zip(
        motion.evaluate(between), wave.evaluate(between), (1e-9, 1e-7, 1e-4), strict=True
    ):
        np.testing.assert_allclose(found, wanted, atol=near)


def test_samples_are_exact_held_beyond_still_and_scaled():
    motion = sample([np.polynomial.Polynomial([1.0, 2.0, -3.0, 0.5])])
    given = (motion.position, motion.velocity, motion.acceleration)
    for found, wanted in zip(motion.evaluate(TIMES), given, strict=True):
        np.testing.assert_allclose(found, wanted, atol=1e-12)
    beyond, ends = (motion.evaluate(times)[0] for times in (np.array([-1.0, 9.0]), TIMES[[0, -1]]))
    np.testing.assert_array_equal(beyond, ends)
    still = np.full((6, 2), 1.0 / 3.0)
    rest = replace(motion, position=still, velocity=0 * still, acceleration=0 * still)
    q, dq, ddq = rest.evaluate(np.linspace(0.0, 1.6, 33))
    assert np.all(q == 1.0 / 3.0)
    assert not dq.any()
    assert not ddq.any()
    scaled, t = build_motion(None, motion, None, scale=0.5), np.linspace(0, 1.6, 20)
    np.testing.assert_allclose(scaled.evaluate(t)[0] - 1.0, 0.5 * (motion.evaluate(t)[0] - 1.0), atol=1e-13)
    assert scaled.source == "here, amplitudes times 0.5"
    assert build_motion(None, motion, None) is motion
    # A part ends at the next sample.
    parts = [build_motion(None, motion, None, duration=duration) for duration in (0.5, 0.51, 1.6)]
    assert [len(part.time) for part in parts] == [len(part.position) for part in parts] == [3, 4, 6]


def write(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def make_table(heading, rows=12):
    t = np.arange(rows) * 0.01
    return heading + "\n" + "\n".join(f"{value},{np.sin(value)},{np.cos(value)}" for value in t) + "\n"


def test_what_is_written_is_read(robot, tmp_path):
    path = tmp_path / "a.csv"
    wave = build_tc()
    assert write_trajectory(wave, path, robot, rate=500.0, remarks=("two\nlines", "one")) == 10001
    lines = path.read_text(encoding="utf-8").splitlines()
    assert lines[:3] == [
        "# two lines",
        "# one",
        "t [s],q1 [rad],q2 [rad],dq1 [rad/s],dq2 [rad/s],ddq1 [rad/s^2],ddq2 [rad/s^2]",
    ]
    motion = read_trajectory(path, robot)
    t = np.linspace(0.0, 20.0, 999)
    for found, wanted, near in zip(motion.evaluate(t), wave.evaluate(t), (1e-10, 1e-8, 1e-5), strict=True):
        np.testing.assert_allclose(found, wanted, atol=near)
    assert motion.source == "trajectory a.csv"
    first = path.read_bytes()
    write_trajectory(wave, path, robot, rate=500.0, remarks=("two\nlines", "one"))
    assert path.read_bytes() == first


def test_periods_repeat_bit_by_bit_and_folders_must_be_there(robot, tmp_path):
    path = tmp_path / "a.csv"
    assert write_trajectory(build_tc(), path, robot, rate=10.0, periods=3) == 601
    motion = read_trajectory(path, robot)
    assert motion.duration == 60.0
    np.testing.assert_array_equal(motion.position[:200], motion.position[400:600])
    np.testing.assert_array_equal(motion.position[0], motion.position[600])
    with raises(OutputError, "output.unwritable"):
        write_trajectory(build_tc(), tmp_path / "no" / "a.csv", robot, rate=10.0)


def test_positions_alone_are_enough_in_any_unit_and_order(robot, tmp_path):
    t = np.linspace(3.0, 5.0, 401)
    lines = ["q2 [deg],t [ms],q1"]
    lines += [f"{math.degrees(math.sin(2 * x))!r},{1000 * x!r},{math.cos(x)!r}" for x in t.tolist()]
    motion = read_trajectory(write(tmp_path / "a.csv", "\n".join(lines)), robot)
    assert motion.duration == pytest.approx(2.0)
    s = np.linspace(0.0, 2.0, 77)
    q, dq, ddq = motion.evaluate(s)
    x = s + 3.0
    np.testing.assert_allclose(q, np.column_stack([np.cos(x), np.sin(2 * x)]), atol=1e-9)
    np.testing.assert_allclose(dq, np.column_stack([-np.sin(x), 2 * np.cos(2 * x)]), atol=1e-6)
    np.testing.assert_allclose(ddq, np.column_stack([-np.cos(x), -4 * np.sin(2 * x)]), atol=1e-3)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (make_table("t,q1,x"), "column q2 is missing"),
        (make_table("x,q1,q2"), "column t is missing"),
        (make_table("t,x,y"), "columns q1 to q2"),
        (make_table("t,q1,q3"), "column q3: .* 2 joints"),
        (make_table("t,q1,q2 [N m]"), "column q2: N m .* angle"),
        (make_table("t,q1,q2 [grad]"), "column q2: .*'grad'"),
        (make_table("t,q1,q2", rows=5), "a.csv: 5 samples"),
        (make_table("t,q1,q2").replace("0.05,", "0.03,", 1), "after sample 5"),
        (
            make_table("t,q1,q2").replace("0.05,", "0.05,nan#", 1).replace("nan#" + str(np.sin(0.05)), "nan"),
            "column q1: sample 6",
        ),
    ],
)
def test_mistakes_in_a_file_are_named(robot, tmp_path, text, says):
    with pytest.raises(LogError, match=says) as caught:
        read_trajectory(write(tmp_path / "a.csv", text), robot)
    assert set(tell(caught.value.notices)) == {"excitation.trajectory"}
