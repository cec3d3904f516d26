"""Motions given by samples, and trajectory files: what is written is read, mistakes are named."""

import math
from dataclasses import replace

import numpy as np
import pytest

from symid.errors import LogError, OutputError
from symid.excitation.reference_motion import (
    SampledMotion,
    build_motion,
    read_trajectory,
    write_trajectory,
)
from symid.excitation.trajectories import build_tc
from tests.refusals import raises, tell

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
    found = motion.evaluate_derivatives(t, 6)
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
