from dataclasses import replace

import numpy as np
import pytest

from symid.codegen.functions import ParameterCard
from symid.errors import EstimateError, LogError
from symid.identification.elastic.estimate import MethodFit
from symid.identification.elastic.options import ElasticOptions
from symid.identification.elastic.validation import evaluate_elastic, predict_elastic
from symid.joint_models.hysteresis import Elasticity
from symid.logs.recording import Recording
from symid.serialization import compute_file_digest
from tests.estimates import build_elastic_estimate
from tests.recovery.closed_form import build_one_axis
from tests.refusals import raises

MASS, ROTOR, STIFFNESS = 40.0, 6.0, 9000.0
FRICTION = (15.0, 0.0, -3.0)
PERIOD = 1e-3
OMEGAS = 2.0 * np.pi * np.array([0.3, 0.7, 1.1])


def find_motion(time, order):
    """Return the derivative of q of an order: a sum of sines."""
    angle = OMEGAS * time[:, None] + np.array([0.0, 1.0, 2.0]) + order * np.pi / 2.0
    return (0.2 * OMEGAS**order * np.sin(angle)).sum(axis=1)


def build_log(source="log"):
    """Return what a slide driven through a linear spring shows, the torque held between samples."""
    time = PERIOD * np.arange(12_001)

    def find_motor(at, order):
        return find_motion(at, order) + MASS / STIFFNESS * find_motion(at, order + 2)

    middle = time + PERIOD / 2.0
    torque = (
        MASS * find_motion(middle, 2)
        + ROTOR * find_motor(middle, 2)
        + FRICTION[0] * find_motor(middle, 1)
        + FRICTION[2]
    )
    return Recording(
        time=time,
        position=find_motion(time, 0)[:, None],
        motor_position=find_motor(time, 0)[:, None],
        torque=torque[:, None],
        source=source,
    )


@pytest.fixture(scope="module")
def library():
    plain = build_one_axis(np.array([MASS, *FRICTION]))
    rotor = ParameterCard(name="IA1", expression="IA1", unit="kg", reason="turns alone", joint="joint1")
    card = replace(plain.card, rotors=(rotor,), elasticity=(Elasticity(stiffness=STIFFNESS),))
    return replace(plain, card=card)


def predict(library, stiffness=STIFFNESS, log=None, **options):
    """Return what true parameters and a spring predict of the log."""
    fit = MethodFit(
        method="two-step",
        beta=np.array([MASS]),
        rotor=np.array([ROTOR]),
        friction=np.array(FRICTION),
        elasticity=(Elasticity(stiffness=stiffness),) if stiffness else (),
    )
    return predict_elastic(library, log or build_log(), ElasticOptions(cutoff=0.0), fit, **options)


def test_true_parameters_leave_nothing_and_a_wrong_spring_is_seen(library):
    trial = predict(library)
    (joint,) = trial.joints
    assert (joint.joint, joint.unit, joint.torsion_unit) == ("joint1", "N", "m")
    scale = np.abs(joint.motor).max()
    for other in (joint.link, joint.final, STIFFNESS * joint.torsion):
        np.testing.assert_allclose(other, joint.motor, atol=2e-3 * scale)
    assert (joint.initial, joint.truth) == (None, None)
    assert joint.straight == pytest.approx(STIFFNESS, rel=2e-3)
    assert len(trial.residuals) == 3
    assert all(entry.relative_percent < 0.2 for _, lines in trial.residuals for entry in lines)
    assert not trial.fitted
    trial = predict(library, 1.1 * STIFFNESS)
    dynamics, motors, links = (lines[0] for _, lines in trial.residuals)
    assert dynamics.relative_percent < 0.2
    assert motors.norm == pytest.approx(0.1 * np.linalg.norm(trial.joints[0].motor), rel=0.02)
    assert links.relative_percent == pytest.approx(10.0, abs=0.2)


def test_start_and_truth_are_drawn_where_they_are_known(library):
    start = (Elasticity(stiffness=0.5 * STIFFNESS),)
    trial = predict(library, initial=start, truth=(Elasticity(),), fitted=True)
    (joint,) = trial.joints
    np.testing.assert_allclose(joint.initial, 0.5 * joint.final, rtol=1e-12)
    # A robot file may name a spring without its value.
    assert joint.truth is None
    assert trial.fitted
    trial = predict(library, None)
    assert trial.joints[0].final is None
    assert len(trial.residuals) == 1
    with pytest.raises(LogError):
        predict(library, log=replace(build_log(), motor_position=None))


def build_estimate(**settings):
    names, spring = ("M1", "IA1", "Fv1", "Fc1", "offset1"), Elasticity(stiffness=STIFFNESS)
    values = dict(zip(names, (MASS, ROTOR, *FRICTION), strict=True))
    settings = {"stops": 8, "rate": 60.0, "cutoff": 0.0, **settings}
    return build_elastic_estimate(values, spring, unit="N", signature="one_axis-signature", settings=settings)


def test_an_estimate_is_tried_with_its_own_filters_and_knows_its_logs(library, tmp_path):
    trial = evaluate_elastic(build_estimate(), library, build_log("another"))
    (joint,) = trial.joints
    np.testing.assert_array_equal(joint.truth, joint.final)
    assert all(entry.relative_percent < 0.2 for _, lines in trial.residuals for entry in lines)
    fast = build_estimate(rate=120.0)
    other = evaluate_elastic(fast, library, build_log("another")).joints[0]
    lag = np.max(np.abs(other.torsion - joint.torsion))
    assert lag > 0.02 * np.max(np.abs(joint.torsion))
    assert evaluate_elastic(build_estimate(), library, build_log("log")).fitted
    assert not evaluate_elastic(build_estimate(), library, build_log("")).fitted
    copy = tmp_path / "copy.npz"
    copy.write_bytes(b"the same bytes")
    estimate = build_estimate(log_digests=[compute_file_digest(str(copy))])
    assert evaluate_elastic(estimate, library, build_log(str(copy))).fitted


@pytest.mark.parametrize("settings", [{"rate": -1.0}, {"rate": "fast"}, {"cutoff": [1.0]}])
def test_settings_that_cannot_be_used_are_refused(library, settings):
    with raises(EstimateError, "estimate.settings"):
        evaluate_elastic(build_estimate(**settings), library, build_log())
