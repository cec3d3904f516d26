"""A joint that moves slowly and turns back often: by default its friction gets a memory.

The plant is that of `benchmarks/presliding.py`, with an integrator of its own.
"""

from functools import cache

import numpy as np
import pytest

import symid
from benchmarks import presliding
from symid.errors import UsageError
from tests.refusals import raises


@cache
def observe(kind):
    """Return the joint, its robot, and logs of its first fourteen seconds and of the rest."""
    joint, position, torque = presliding.observe(kind, 1, 0)
    robot, time = presliding.load_robot(), presliding.PERIOD * np.arange(len(torque))
    halves = slice(0, 14000), slice(14000, None)
    logs = [symid.build_log(robot, time=time[part], q=position[part], tau=torque[part]) for part in halves]
    return joint, robot, logs


@pytest.mark.parametrize("kind", presliding.KINDS)
def test_a_law_with_a_state_is_chosen_and_leaves_what_the_true_one_leaves(kind, tmp_path):
    joint, robot, (log, later) = observe(kind)
    fit = robot.identify_friction([log])
    (found,) = fit.estimate.joints
    assert found.estimate.law == f"{kind}+offset"
    assert found.motion.whole <= 1.1 * presliding.measure_truth(joint, robot, log)
    assert found.motion.left_out == 0
    assert "On all samples" in found.selection.verdict
    named = {entry.name: entry for entry in found.estimate.parameters}
    for name, truth in (("fC", joint.coulomb), ("fS", joint.static), ("fV", joint.viscous)):
        assert abs(named[name].value - truth) <= max(4.0 * named[name].std, 0.05 * truth), name
    # Another log is foretold at all rows, too.
    (residual,) = fit.validate(later).residual
    assert residual.relative_percent < 3.0
    # Stored and read it is the same; in a robot file it has its state.
    fit.save(tmp_path / "fit.json")
    (stored,) = symid.load_fit(tmp_path / "fit.json").estimate.joints
    assert stored.estimate == found.estimate
    fit.export(tmp_path / "arm.toml")
    friction = symid.load(tmp_path / "arm.toml").description.joints[0].friction
    assert friction.law == found.estimate.law
    assert friction.bristles == pytest.approx(found.estimate.bristles)


def test_a_law_with_a_state_by_name_takes_no_other_estimator():
    _, robot, (log, _) = observe("lugre")
    (found,) = robot.identify_friction([log], model="dahl").estimate.joints
    assert [entry.name for entry in found.estimate.parameters] == ["fC", "fV", "sigma0"]
    for wrong in ({"estimator": "nlp"}, {"smoothing": 0.01}):
        with raises(UsageError, "usage.friction-state", match="has a state"):
            robot.identify_friction([log], model="dahl", **wrong)


def test_small_motions_about_one_pose_have_no_offset_beside_gravity(tmp_path):
    time, rng = 1e-3 * np.arange(8000), np.random.default_rng(1)
    sizes = ((1e-3, 0.7), (4e-4, 2.3), (2e-3, 0.11))
    q = 0.3 + sum(size * np.sin(2.0 * np.pi * rate * time) for size, rate in sizes)
    bent, friction = 0.0, np.empty(len(q))
    for k, way in enumerate(np.diff(q, prepend=q[0])):
        bent = float(np.clip(bent + way, -5e-4, 5e-4))
        friction[k] = 2000.0 * bent
    tau = friction + 1.2 * np.sin(q) + 0.3 * np.gradient(q, 1e-3) + 0.01 * rng.standard_normal(len(q))
    robot = presliding.load_robot()
    log = symid.build_log(robot, time=time, q=q[:, None], tau=tau[:, None])
    fit = robot.identify_friction([log])
    (found,) = fit.estimate.joints
    assert found.estimate.law == "maxwell-slip"
    # Most of it is of the first rows: the bristles were half bent where the filter's end begins.
    assert found.residual.relative_percent < 2.0
    assert fit["joint.stiffness1"].value == pytest.approx(2000.0, rel=0.02)
    assert fit["joint.fC"].value == pytest.approx(1.0, rel=0.02)
    (residual,) = fit.validate(log).residual
    assert residual.relative_percent < 0.5
    # Numbers that nothing determines are in no file.
    named = robot.identify_friction([log], model="dahl+offset")
    assert "joint.offset" in named.refused
    assert "friction.refused" in {notice.code for notice in named.estimate.joints[0].estimate.notices}
    named.save(tmp_path / "fit.json")
    assert symid.load_fit(tmp_path / "fit.json").refused == named.refused
