"""The direction of gravity in logs whose torques are Pinocchio's, or written out by hand."""

from dataclasses import replace

import numpy as np
import pytest

from symid.codegen.cache import prepare_library
from symid.identification.diagnostics.causes import (
    FollowedLogs,
    estimate_gravity,
    evaluate_motion,
    find_causes,
    fit_motion,
    list_mistakes,
    suspect_gravity,
)
from symid.identification.diagnostics.gravity import find_gravity
from symid.identification.regression import ThinMotion
from symid.robot.geometry import ZERO
from tests.chains import build_chain
from tests.recovery.closed_form import L, find_friction
from tests.unit.identification.diagnostics.thin_logs import thin
from tests.unit.identification.pinocchio_arm import ARM, draw_motion, record_arm
from tests.unit.identification.rigid.two_link_logs import LIBRARY, record

DOWN = np.array([0.0, 0.0, -1.0])


@pytest.fixture(scope="module")
def library():
    return prepare_library(ARM)


def sample(library, seed, gravity, **options):
    """Return the thinned motion of a log of the arm under gravity (3,), in m/s^2, and folds of its blocks."""
    logs = thin(library, record_arm(seed, gravity=gravity, **options))
    return logs.motion, logs.fold


def find(library, motion, fold, robot=ARM):
    return estimate_gravity(FollowedLogs.follow(library, motion, fold), robot)


def measure_angle(first, second):
    return np.arctan2(np.linalg.norm(np.cross(first, second)), first @ second)


@pytest.mark.parametrize(
    "direction", [DOWN, (1.0, 0.0, 0.0), -DOWN, (-0.6, 0.64, -0.48), (0.0, -0.17364818, -0.98480775)]
)
def test_the_direction_is_found_within_its_deviation(library, direction):
    truth = 9.81 * np.array(direction)
    ratios = []
    for seed in range(6):
        found = find(library, *sample(library, seed, truth))
        assert np.linalg.norm(found.direction) == pytest.approx(9.81)
        assert found.turn == pytest.approx(measure_angle(found.direction, DOWN), abs=1e-12)
        assert found.deviation < np.radians(2.0)
        ratios.append(measure_angle(found.direction, truth) / found.deviation)
    # Two components, each with a deviation of its own.
    assert 0.3 < np.sqrt(np.mean(np.square(ratios))) < 1.8


def test_torques_become_those_under_the_gravity_of_the_file(library):
    turned, fold = sample(library, 1, (9.81, 0.0, 0.0))
    upright, _ = sample(library, 1, 9.81 * DOWN)
    found, columns = find(library, turned, fold), evaluate_motion(library, turned)
    inner, size = turned.kept.all(axis=1), np.linalg.norm(upright.tau, axis=0)
    # Pinocchio's torques of the same motion.
    assert np.all(np.linalg.norm((found.tau - upright.tau)[inner], axis=0) < 0.03 * size)
    fit, after, wanted = (
        fit_motion(columns, replace(turned, tau=tau), fold) for tau in (turned.tau, found.tau, upright.tau)
    )
    assert np.sqrt(fit.losses.sum(axis=0)).mean() > 0.3
    assert np.sqrt(after.losses.sum(axis=0)).mean() < 0.05
    inertial = slice(0, len(library.card.beta))
    away = np.abs(after.fit.values - wanted.fit.values)[inertial]
    deviations = np.sqrt(np.sum(after.fit.changes**2 + wanted.fit.changes**2, axis=0))[inertial]
    assert np.all(away < 4.0 * deviations)
    assert np.all(away < 0.1)
    # What is left of all samples: as much as of a log that the file is right for, and as by its library.
    for left, one, motion in ((found.left, wanted, upright), (found.left_before, fit, turned)):
        whole = np.sum(np.where(motion.kept, motion.tau, 0.0) ** 2, axis=0)
        np.testing.assert_allclose(np.sqrt(left), np.sqrt(one.squares * whole), rtol=0.15)


def test_a_file_without_gravity_gets_one(library):
    found = find(library, *sample(library, 2, 9.81 * DOWN), replace(ARM, gravity=(ZERO, ZERO, ZERO)))
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
    block, run = np.arange(len(q)) * 6 // len(q), np.zeros(len(q), dtype=np.intp)
    kept, states = np.abs(dq) > 0.05, {"q": q[:, :2], "dq": dq, "ddq": ddq[:, :2]}
    motion = ThinMotion(**states, tau=tau, kept=kept, block=block, run=run, period=0.1)
    return motion, block, friction


def build_planar(*gravity):
    rows = [(0.0, 0.0, 0.0, "q"), (0.0, L, 0.0, "q")]
    return build_chain(rows, gravity=gravity)


@pytest.mark.parametrize("tilt", [0.0, 10.0, -70.0, 180.0])
def test_a_planar_arm_is_turned_in_its_plane(tilt):
    turn = np.radians(tilt)
    found = find_gravity(build_planar("0", "-9.81", "0"), *build_two_link_log(turn))
    truth = 9.81 * np.array([np.sin(turn), -np.cos(turn), 0.0])
    assert measure_angle(found.direction, truth) < max(3.0 * found.deviation, 1e-3)
    assert found.deviation < np.radians(3.0)
    assert abs(found.direction[2]) < 1e-6


def test_a_planar_arm_that_leans_shows_how_far():
    found = find_gravity(build_planar("0", "-9.81", "0"), *build_two_link_log(0.0, np.radians(60.0)))
    # Not to which side.
    sides = [9.81 * np.array([0.0, -0.5, side * np.sqrt(0.75)]) for side in (1.0, -1.0)]
    assert min(measure_angle(found.direction, side) for side in sides) < 3.0 * found.deviation


def test_what_a_log_does_not_show_is_not_turned():
    # One link: a turn in its plane is the same as another place of its mass, and so is gravity's sign.
    motion, stretch, friction = build_two_link_log(0.5)
    names = ("q", "dq", "ddq", "kept")
    first = replace(motion, **{name: getattr(motion, name)[:, :1] for name in names})
    tau = 0.5 * first.ddq + 9.81 * 2.0 * np.cos(first.q - 0.5) + 0.3 * first.dq + 0.01 * motion.tau[:, 1:]
    one = build_chain([(0.0, 0.0, 0.0, "q")], gravity=("0", "-9.81", "0"))
    found = find_gravity(one, replace(first, tau=tau), stretch, friction[:, :1, :3])
    assert found.turn < 1e-3
    np.testing.assert_allclose(found.left, found.left_before, rtol=1e-3)
    # And torques that are zero, or a joint that no row is of, show nothing, or what the others show.
    still = replace(motion, tau=np.zeros_like(motion.tau))
    none = find_gravity(build_planar("0", "-9.81", "0"), still, stretch, friction)
    assert (none.turn, none.deviation) == (0.0, 0.0)
    motion.kept[:, 0] = False
    found = find_gravity(build_planar("0", "-9.81", "0"), motion, stretch, friction)
    assert abs(found.turn - 0.5) < 3.0 * found.deviation
    assert found.left[0] == 0.0


def test_a_weight_that_a_log_does_not_have_is_explained_for_nothing():
    """Out of its plane a planar arm has little weight; the file's gravity would add much of it."""
    logs = thin(LIBRARY, replace(record(1, torque=0.1), time=2.5 * record(1).time))
    motion, fold = logs.motion, logs.fold
    followed = FollowedLogs.follow(LIBRARY, motion, fold)
    found = suspect_gravity(estimate_gravity(followed, build_planar("0", "-9.81", "0")), motion)
    measured, added = (np.sum(part.tau**2 * motion.kept, axis=0) for part in (motion, found.motion))
    assert np.all(added > 4.0 * measured)
    causes = find_causes(followed, [found, *list_mistakes(followed)])
    assert {entry.family for entry in causes} == {"times", "gravity"}
