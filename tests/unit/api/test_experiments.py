"""Trajectories, simulated logs and studies from Python: as from the command line, and on their own."""

import numpy as np
import pytest

import symid
from symid import SimulateOptions
from symid.cli.main import run
from symid.errors import OutputError, UsageError
from symid.excitation.trajectories import build_motion, read_trajectory
from tests.calls import do, say
from tests.refusals import raises


@pytest.fixture(scope="module")
def found(robot):
    return robot.excite(harmonics=2, period=2, candidates=20, starts=1, seed=3)


def test_python_and_the_command_line_write_the_same_bytes(robot, found, tmp_path):
    excite = ("--harmonics", "2", "--period", "2", "--candidates", "20", "--starts", "1", "--seed", "3")
    motion, log = tmp_path / "motion.csv", tmp_path / "log.npz"
    printed = say("excite", "two_link", *excite, "--rate", "50", "-o", motion)
    printed += say("simulate", "two_link", "--duration", "1", "--seed", "5", "-o", log)
    assert found.save(tmp_path / "own.csv", rate=50) == tmp_path / "own.csv"
    assert (tmp_path / "own.csv").read_bytes() == motion.read_bytes()
    simulated = robot.simulate(duration=1, seed=5)
    assert simulated.save(tmp_path / "own.npz").read_bytes() == log.read_bytes()
    assert found.to_text() in printed
    assert simulated.summarise() in printed


def simulate(robot, **options):
    return robot.simulate(options=SimulateOptions(**options))


def test_a_file_repeats_the_states_of_the_trajectory(robot, found, tmp_path):
    path = tmp_path / "motion.csv"
    motion = read_trajectory(found.save(path, rate=100, periods=2), robot.description)
    assert len(motion.position) == found.count_samples(rate=100, periods=2) == 401
    q, dq, ddq = found.trajectory.evaluate(np.arange(200) / 100)
    for states, expected in ((motion.position, q), (motion.velocity, dq), (motion.acceleration, ddq)):
        np.testing.assert_array_equal(states[:200], expected)
        np.testing.assert_array_equal(states[200:400], expected)


def test_a_trajectory_that_was_found_is_followed(robot, found):
    plain = robot.simulate(found, clean=True)
    assert plain.duration == 2.0
    # A PD controller of 12 Hz lags, but not by much.
    error = np.abs(plain.q - found.trajectory.evaluate(plain.time)[0]).max()
    assert error < 0.1 * np.ptp(plain.q)
    assert plain.log.q is plain.q
    assert plain.theta is None
    again = robot.simulate(found.trajectory, clean=True)
    np.testing.assert_array_equal(again.tau, plain.tau)


def test_a_motion_is_scaled_about_its_centre_and_cut(robot, found):
    rng = np.random.default_rng(0)
    part = build_motion(robot.description, found.trajectory, rng, duration=0.5, scale=0.5)
    assert part.duration == 0.5
    times = np.linspace(0, 0.5, 7)
    centre = found.coefficients[:, 0]
    wide, narrow = (motion.evaluate(times) for motion in (found.trajectory, part))
    np.testing.assert_allclose(narrow[0] - centre, 0.5 * (wide[0] - centre), atol=1e-12)
    np.testing.assert_allclose(narrow[2], 0.5 * wide[2], atol=1e-12)


@pytest.mark.parametrize(
    ("call", "code"),
    [
        (lambda robot: robot.simulate("nowhere.csv"), "usage.trajectory"),
        (lambda robot: simulate(robot, delay=0.01), "usage.rigid-sensors"),
        (lambda robot: robot.simulate(bandwidth=0.0), "usage.range"),
        (lambda robot: simulate(robot, control_period=-1e-3), "usage.range"),
        (lambda robot: simulate(robot, stiffness=[100.0, 10.0]), "usage.gains"),
        (lambda robot: simulate(robot, stiffness=[9.0, 1.0], damping=[-1.0, 1.0]), "usage.gains"),
        (lambda robot: simulate(robot, bandwidth=5, stiffness=[9, 9], damping=[1, 1]), "usage.gains"),
        (lambda robot: simulate(robot, stiffness=[9.0], damping=[1.0]), "usage.experiment"),
        (lambda robot: simulate(robot, stiffness=["a", "b"], damping=[1.0, 1.0]), "usage.range"),
        (lambda robot: simulate(robot, stiffness=9.0, damping=1.0), "usage.range"),
        (lambda robot: robot.excite(start=[0.0]), "usage.excitation"),
        (lambda robot: robot.excite(options=symid.ExciteOptions(stiffness=[1.0, 1.0])), "usage.excitation"),
    ],
)
def test_what_does_not_fit_is_refused(robot, call, code):
    with pytest.raises(UsageError) as caught:
        call(robot)
    assert {notice.code for notice in caught.value.notices} == {code}


def test_files_under_a_wrong_ending_are_refused(robot, found, tmp_path):
    for write in (found.save, robot.simulate(duration=0.1).save, symid.new_robot(robot="scara").save):
        with raises(OutputError, "output.unknown-suffix"):
            write(tmp_path / "wrong.txt")
    assert not list(tmp_path.iterdir())


def test_a_study_takes_a_log_or_its_file(robot, tmp_path):
    simulated = robot.simulate(duration=6)
    of_log = robot.study_cutoff(simulated.log)
    of_file = robot.study_cutoff(simulated.save(tmp_path / "log.npz"))
    assert of_log.product.lines == of_file.product.lines
    assert of_file.to_dict()["source"] == str(tmp_path / "log.npz")
    assert "cut-off" in str(of_log)
    assert repr(of_log) == "<Study cut-off of two_link>"


def test_a_study_is_of_the_robot_with_its_settings():
    """Workers get the robot itself: settings and friction count, not the file alone."""
    plain = symid.load("two_link", friction="none").study_precision(seeds=2, jobs=1).product
    assert plain.names == tuple(symid.load("two_link").base.names)


def test_the_controller_can_be_set(robot, tmp_path):
    assert simulate(robot, duration=1, control_period=2e-3).recording.period == pytest.approx(2e-3)
    slow = robot.simulate(duration=1, bandwidth=6.0)
    usual = robot.simulate(duration=1).to_dict()["controller"]
    # Kp = w^2 J and Kd = 2 w J.
    np.testing.assert_allclose(slow.to_dict()["controller"]["stiffness"], np.array(usual["stiffness"]) / 4.0)
    np.testing.assert_allclose(slow.to_dict()["controller"]["damping"], np.array(usual["damping"]) / 2.0)
    own = simulate(robot, duration=1, stiffness=[4000.0, 900.0], damping=[90.0, 9.0])
    assert own.to_dict()["controller"]["stiffness"] == (4000.0, 900.0)
    log = tmp_path / "own.npz"
    gains = ("--stiffness", "4000,900", "--damping", "90,9")
    do("simulate", "two_link", "--duration", "1", *gains, "-o", log)
    assert own.save(tmp_path / "same.npz").read_bytes() == log.read_bytes()


def test_a_controller_that_cannot_hold_the_robot_is_an_error(robot, tmp_path, capsys):
    lines = robot.path.read_text(encoding="utf-8").splitlines(keepends=True)
    (tmp_path / "free.toml").write_text("".join(line for line in lines if not line.startswith("torque")))
    call = ["simulate", str(tmp_path / "free.toml"), "--bandwidth", "400", "-o", str(tmp_path / "no.npz")]
    assert run(call) == 5
    assert not (tmp_path / "no.npz").exists()
    text = capsys.readouterr().err
    for part in ("--bandwidth (400 Hz)", "--stiffness", "--period", "'"):
        assert part in text


def test_an_elastic_robot_takes_the_same_options():
    arm = symid.load("two_link_elastic")
    usual, slow = arm.simulate("ta", duration=0.5), arm.simulate("ta", duration=0.5, bandwidth=5.0)
    assert np.abs(slow.tau - usual.tau).max() > 0.1
    own = arm.simulate(
        "ta", duration=0.5, options=SimulateOptions(stiffness=[4000.0, 1500.0], damping=[120.0, 40.0])
    )
    np.testing.assert_array_equal(own.tau, usual.tau)
