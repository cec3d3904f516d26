"""The direction of gravity in logs whose torques are Pinocchio's, or written out by hand."""

from dataclasses import replace

import numpy as np
import pytest

from symid.codegen.cache import prepare_library
from symid.identification.diagnostics.causes import build_quick_logs, fit_quick
from symid.identification.diagnostics.gravity import find_gravity
from symid.identification.diagnostics.stretches import measure_scoring_band
from symid.identification.regression.equations import evaluate_columns
from symid.identification.rigid.plan import cut_moving_ends
from symid.robot.description import Processing
from symid.robot.geometry import ZERO
from tests.chains import build_chain
from tests.recovery.closed_form import L, find_friction
from tests.unit.identification.pinocchio_arm import ARM, draw_motion, record_arm

STATES = ("q", "dq", "ddq", "tau", "kept", "stretch")
DOWN = np.array([0.0, 0.0, -1.0])


@pytest.fixture(scope="module")
def library():
    return prepare_library(ARM)


def sample(library, seed, gravity, **options):
    """Return the quick samples of a log of the arm under gravity (3,), in m/s^2."""
    log = record_arm(seed, gravity=gravity, **options)
    scoring = measure_scoring_band([log])
    settings = cut_moving_ends(Processing(filter_cutoff=scoring), [log])
    return build_quick_logs(library, [log], settings, scoring)


def find(library, logs, robot=ARM):
    columns = evaluate_columns(library, logs.q, logs.dq, logs.ddq)[:, :, len(library.card.beta) :]
    return find_gravity(robot, **{name: getattr(logs, name) for name in STATES}, friction=columns)


def measure_angle(first, second):
    return np.arctan2(np.linalg.norm(np.cross(first, second)), first @ second)


@pytest.mark.parametrize(
    "direction", [DOWN, (1.0, 0.0, 0.0), -DOWN, (-0.6, 0.64, -0.48), (0.0, -0.17364818, -0.98480775)]
)
def test_the_direction_is_found_within_its_deviation(library, direction):
    truth = 9.81 * np.array(direction)
    ratios = []
    for seed in range(6):
        logs = sample(library, seed, truth)
        found = find(library, logs)
        assert np.linalg.norm(found.direction) == pytest.approx(9.81)
        assert found.turn == pytest.approx(measure_angle(found.direction, DOWN), abs=1e-12)
        assert found.deviation < np.radians(2.0)
        ratios.append(measure_angle(found.direction, truth) / found.deviation)
    # Two components, each with a deviation of its own.
    assert 0.3 < np.sqrt(np.mean(np.square(ratios))) < 1.8


def test_torques_become_those_under_the_gravity_of_the_file(library):
    turned = sample(library, 1, (9.81, 0.0, 0.0))
    found, fit = find(library, turned), fit_quick(turned)
    upright = sample(library, 1, 9.81 * DOWN)
    inner, size = turned.kept.all(axis=1), np.linalg.norm(upright.tau, axis=0)
    # Pinocchio's torques of the same motion.
    assert np.all(np.linalg.norm((found.tau - upright.tau)[inner], axis=0) < 0.03 * size)
    after, wanted = fit_quick(replace(turned, tau=found.tau)), fit_quick(upright)
    assert fit.percent > 30.0
    assert after.percent < 5.0
    inertial = slice(0, len(library.card.beta))
    np.testing.assert_allclose(after.values[inertial], wanted.values[inertial], atol=0.05)
    # What is left of all samples: as much as of a log that the file is right for, and as by its library.
    for left, quick, logs in ((found.left, wanted, upright), (found.left_before, fit, turned)):
        size = np.linalg.norm(np.where(logs.kept, logs.tau, 0.0), axis=0)
        np.testing.assert_allclose(np.sqrt(left), 0.01 * quick.fitted * size, rtol=0.15)


def test_a_file_without_gravity_gets_one(library):
    found = find(library, sample(library, 2, 9.81 * DOWN), replace(ARM, gravity=(ZERO, ZERO, ZERO)))
    assert measure_angle(found.direction, DOWN) < 3.0 * found.deviation
    assert found.turn == 0.0
    # The first axis is upright.
    assert np.all(found.left[1:] < 0.05 * found.left_before[1:])


def build_two_link_log(tilt, lean=0.0):
    """Return samples of two links whose gravity is turned by `tilt` in their plane and `lean` out of it.

    Energies as in `closed_form`, with ZZ1 alone on the shoulder.
    """
    _, q, dq, ddq = (part[::20] for part in draw_motion(3, 40.0))
    (q1, q2), (v1, v2), (a1, a2) = q[:, :2].T, dq[:, :2].T, ddq[:, :2].T
    zz1, zz2, mx1, mx2, my2 = 1.1, 0.35, 2.3, 0.6, -0.1
    along, across = mx2 * np.cos(q2) - my2 * np.sin(q2), mx2 * np.sin(q2) + my2 * np.cos(q2)
    weight, angle = 9.81 * np.cos(lean), q1 - tilt
    outer = weight * (mx2 * np.cos(angle + q2) - my2 * np.sin(angle + q2))
    elbow = zz2 * (a1 + a2) + L * (along * a1 + across * v1**2) + outer
    shoulder = elbow + zz1 * a1 + L * (along * (a1 + a2) - across * (v1 + v2) ** 2)
    shoulder += weight * mx1 * np.cos(angle)
    dq = dq[:, :2]
    (friction,) = find_friction(dq)
    tau = np.column_stack([shoulder, elbow]) + friction @ [0.8, 1.0, 0.2, 0.5, 0.4, -0.1]
    tau += 0.02 * np.random.default_rng(0).normal(size=tau.shape) * tau.std(axis=0)
    return {
        "q": q[:, :2],
        "dq": dq,
        "ddq": ddq[:, :2],
        "tau": tau,
        "kept": np.abs(dq) > 0.05,
        "stretch": np.arange(len(q)) * 6 // len(q),
        "friction": friction,
    }


def build_planar(*gravity):
    rows = [(0.0, 0.0, 0.0, "q"), (0.0, L, 0.0, "q")]
    return build_chain(rows, gravity=gravity)


@pytest.mark.parametrize("tilt", [0.0, 10.0, -70.0, 180.0])
def test_a_planar_arm_is_turned_in_its_plane(tilt):
    turn = np.radians(tilt)
    found = find_gravity(build_planar("0", "-9.81", "0"), **build_two_link_log(turn))
    truth = 9.81 * np.array([np.sin(turn), -np.cos(turn), 0.0])
    assert measure_angle(found.direction, truth) < max(3.0 * found.deviation, 1e-3)
    assert found.deviation < np.radians(3.0)
    assert abs(found.direction[2]) < 1e-6


def test_a_planar_arm_that_leans_shows_how_far():
    found = find_gravity(build_planar("0", "-9.81", "0"), **build_two_link_log(0.0, np.radians(60.0)))
    # Not to which side.
    sides = [9.81 * np.array([0.0, -0.5, side * np.sqrt(0.75)]) for side in (1.0, -1.0)]
    assert min(measure_angle(found.direction, side) for side in sides) < 3.0 * found.deviation


def test_what_a_log_does_not_show_is_not_turned():
    # One link: a turn in its plane is the same as another place of its mass, and so is gravity's sign.
    log = build_two_link_log(0.5)
    (q, dq, ddq), kept = (log[name][:, :1] for name in ("q", "dq", "ddq")), log["kept"][:, :1]
    tau = 0.5 * ddq + 9.81 * 2.0 * np.cos(q - 0.5) + 0.3 * dq + 0.01 * log["tau"][:, 1:]
    one = build_chain([(0.0, 0.0, 0.0, "q")], gravity=("0", "-9.81", "0"))
    friction = log["friction"][:, :1, :3]
    found = find_gravity(
        one, q=q, dq=dq, ddq=ddq, tau=tau, kept=kept, stretch=log["stretch"], friction=friction
    )
    assert found.turn < 1e-3
    np.testing.assert_allclose(found.left, found.left_before, rtol=1e-3)
    # And torques that are zero, or a joint that no row is of, show nothing, or what the others show.
    none = find_gravity(build_planar("0", "-9.81", "0"), **{**log, "tau": np.zeros_like(log["tau"])})
    assert (none.turn, none.deviation) == (0.0, 0.0)
    log["kept"][:, 0] = False
    found = find_gravity(build_planar("0", "-9.81", "0"), **log)
    assert abs(found.turn - 0.5) < 3.0 * found.deviation
    assert found.left[0] == 0.0
