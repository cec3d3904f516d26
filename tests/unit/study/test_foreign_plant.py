"""The plant of foreign truths: dynamics against closed forms and Pinocchio, energy, step halving."""

import numpy as np
import pytest

from symid.study.foreign_plant import _build_links, _compute_links, simulate_plant_runs
from symid.study.foreign_truths import ARMS, TRUTHS, build_motions, build_truth, observe_plant


def draw_states(size):
    rng = np.random.default_rng(3)
    return rng.uniform(-3.0, 3.0, (20, size)), rng.uniform(-2.0, 2.0, (20, size))


def test_the_planar_arm_has_its_closed_form():
    q, dq = draw_states(2)
    mass, bias, potential = _compute_links(_build_links(ARMS["2r"]), q, dq)
    # ZZR1, MXR1, ZZ2, MX2 and the first length.
    first, pull, second, moment, length = 1.16, 3.0, 0.35, 0.8, 0.4
    coupled = length * moment * np.cos(q[:, 1])
    twist = length * moment * np.sin(q[:, 1])
    end = 9.81 * moment * np.sin(q.sum(axis=1))
    assert mass[:, 0, 0] == pytest.approx(first + second + 2.0 * coupled)
    assert mass[:, 0, 1] == pytest.approx(second + coupled)
    assert mass[:, 1, 1] == pytest.approx(second)
    turning = twist * dq[:, 1] * (2.0 * dq[:, 0] + dq[:, 1])
    assert bias[:, 0] == pytest.approx(9.81 * pull * np.sin(q[:, 0]) + end - turning)
    assert bias[:, 1] == pytest.approx(end + twist * dq[:, 0] ** 2)
    level = pull * np.cos(q[:, 0]) + moment * np.cos(q.sum(axis=1))
    assert potential == pytest.approx(-9.81 * level)


@pytest.mark.parametrize("name", ARMS)
def test_both_arms_agree_with_pinocchio(name):
    pinocchio = pytest.importorskip("pinocchio")
    arm = ARMS[name]
    model = pinocchio.Model()
    model.gravity.linear = np.array([arm.gravity, 0.0, 0.0])
    parent = 0
    for k in range(arm.size):
        c, s = np.cos(arm.turn[k]), np.sin(arm.turn[k])
        turn = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
        place = pinocchio.SE3(turn, np.array([arm.shift[k], 0.0, 0.0]))
        parent = model.addJoint(parent, pinocchio.JointModelRZ(), place, f"joint{k}")
        centre = np.array([arm.centre[k], 0.0, 0.0])
        body = pinocchio.Inertia(float(arm.mass[k]), centre, np.diag(arm.inertia[k]))
        model.appendBodyToJoint(parent, body, pinocchio.SE3.Identity())
    data = model.createData()
    q, dq = draw_states(arm.size)
    mass, bias, potential = _compute_links(_build_links(arm), q, dq)
    for k in range(len(q)):
        triangle = np.triu(pinocchio.crba(model, data, q[k]))
        assert np.triu(mass[k]) == pytest.approx(triangle, abs=1e-12)
        assert bias[k] == pytest.approx(pinocchio.nonLinearEffects(model, data, q[k], dq[k]), abs=1e-11)
        assert potential[k] == pytest.approx(pinocchio.computePotentialEnergy(model, data, q[k]), abs=1e-11)


def find_gap(run):
    """Return the largest work that is neither stored nor lost nor moves, over the largest work."""
    energy = run.kinetic + run.potential + run.stored
    return np.abs(run.work - run.loss - (energy - energy[0])).max() / np.abs(run.work).max()


@pytest.fixture(scope="module")
def runs():
    """Return, for every truth, 1.2 s of ten times TA with steps of 0.2 and of 0.1 ms."""
    (motion, *_) = build_motions(2, 0.06)
    hidden = [build_truth(ARMS["2r"], truth) for truth in TRUTHS]
    motions = [motion] * len(hidden)
    coarse, fine = (simulate_plant_runs(ARMS["2r"], hidden, motions, substeps=count) for count in (5, 10))
    return dict(zip(TRUTHS, zip(coarse, fine, strict=True), strict=True))


@pytest.mark.parametrize("truth", TRUTHS)
def test_work_is_stored_moves_or_is_lost_and_half_the_step_changes_little(runs, truth):
    coarse, fine = map(find_gap, runs[truth])
    assert coarse < 2e-5
    assert fine < 0.7 * coarse
    # Nothing gives energy that it did not get.
    assert np.diff(runs[truth][1].loss).min() >= -1e-7 * runs[truth][1].loss[-1]
    coarse, fine = runs[truth]
    # A step of the encoder in the loop may fall to another tick: 6e-6 rad.
    assert np.abs(coarse.q - fine.q).max() < 6e-6
    most = np.abs(fine.joint_torque).max()
    assert np.abs(coarse.joint_torque - fine.joint_torque).max() < 5e-4 * most


def test_the_spatial_arm_keeps_its_energy_and_truths_have_a_size():
    arm, hidden = ARMS["3r"], build_truth(ARMS["3r"], "all-together")
    motions = build_motions(3, 0.03)[:2]
    for run in simulate_plant_runs(arm, [hidden] * 2, motions):
        assert find_gap(run) < 3e-5
        assert np.all(np.abs(run.torsion).max(axis=0) > 3e-4)
    small, large = (build_truth(ARMS["3r"], "all-together", size) for size in (0.5, 2.0))
    for name in ("branch", "ripple", "kinematic", "lag", "eccentricity", "encoder_lag"):
        assert getattr(large, name) == pytest.approx(4.0 * getattr(small, name))
    # Presliding is longer, and the hysteretic part of a spring larger.
    assert np.all(large.bristle < small.bristle)
    assert np.all(large.hysteretic > small.hysteretic)
    assert large.hysteretic + large.linear == pytest.approx(ARMS["3r"].stiffness)


def test_every_truth_is_another_one(runs):
    family = runs["family"][0]
    for truth in TRUTHS.keys() - {"family", "eccentricity"}:
        changed = np.abs(runs[truth][0].torsion - family.torsion).max()
        assert changed > 1e-6, truth
    plain, bent = (build_truth(ARMS["2r"], truth) for truth in ("family", "eccentricity"))
    logs = [observe_plant(family, hidden, np.random.default_rng(1)) for hidden in (plain, bent)]
    assert np.abs(logs[0].position - logs[1].position).max() > 1e-4
    # The noise is that of the seed, and two per cent.
    assert np.array_equal(logs[0].torque, logs[1].torque)
    noise = np.std(logs[0].torque - family.command, axis=0)
    assert noise == pytest.approx(0.02 * np.sqrt(np.mean(family.command**2, axis=0)), rel=0.1)
    again = observe_plant(family, plain, np.random.default_rng(1))
    assert np.array_equal(again.torque, logs[0].torque)
