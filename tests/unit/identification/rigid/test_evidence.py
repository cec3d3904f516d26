"""What speaks for a fit: explicit fits without each stretch, truths no robot has, logs that contradict."""

from dataclasses import replace

import numpy as np
import pytest

from symid.identification.regression.equations import stack_rows
from symid.identification.regression.preparation import prepare_rows
from symid.identification.rigid.evidence import find_shared
from symid.identification.rigid.fit import identify_parameters
from symid.identification.rigid.plan import plan_fit
from symid.identification.rigid.validation import validate_estimate
from symid.robot.description import Decimation, Processing
from tests.recovery.closed_form import TWO_LINK_TRUTH
from tests.unit.identification.rigid.two_link_logs import LIBRARY, NAMES, record, record_sticking, score

STATED = Processing(filter_cutoff=50.0, drop_first=50, drop_last=50, decimation=Decimation(factor=5))
AUTOMATIC = Processing(automatic=True)


def smooth(values, rows, band):
    """Return values (m,) within a band, joint by joint and log by log, and which are far from ends."""
    found, inner = np.empty(len(values)), np.zeros(len(values), dtype=bool)
    for run in np.unique(rows.run):
        for group in (0, 1):
            own = (rows.run == run) & (rows.group == group)
            found[own], inner[own] = score(values[own], rows.time[own], band)
    return found, inner


@pytest.mark.parametrize("seeds", [(0,), (0, 1, 2)])
@pytest.mark.parametrize("standstill", [None, 0.15])
def test_what_is_held_out_is_that_of_explicit_fits(seeds, standstill):
    """Slow rows that the fit leaves out count where it is judged.

    Rows, fits and a filter of another kind; joint 2 has a spring that the model has not.
    """
    logs = [record(seed, encoder=1e-5, torque=0.5) for seed in seeds]
    logs = [replace(log, torque=log.torque + [0.0, 2.0] * log.position) for log in logs]
    processing = replace(STATED, standstill=standstill)
    evidence = identify_parameters(LIBRARY, logs, processing, estimator="wls").evidence
    rows = stack_rows([prepare_rows("torque", LIBRARY, log, STATED, window=0.1) for log in logs])
    kept = np.abs(rows.velocity) >= (standstill or 0.0)
    held = rows.run
    if not evidence.logs:
        each, span = 6 // len(seeds), rows.time.max() - rows.time.min()
        held = each * held + np.minimum((each * (rows.time - rows.time.min()) / span).astype(int), each - 1)

    def fit(used, weights):
        scale = weights[rows.group[used]]
        return np.linalg.lstsq(rows.matrix[used] * scale[:, None], rows.values[used] * scale)[0]

    weights = np.ones(2)
    for _ in range(20):
        first = rows.values - rows.matrix @ fit(kept, weights)
        weights = 1.0 / np.array([np.std(first[kept & (rows.group == group)]) for group in (0, 1)])
    plain, predicted = fit(kept, weights), np.empty(len(rows.values))
    for fold in np.unique(held):
        predicted[held == fold] = rows.matrix[held == fold] @ fit(kept & (held != fold), weights)
    torque, inner = smooth(rows.values, rows, evidence.scoring)
    errors = [
        smooth(rows.values - part, rows, evidence.scoring)[0] for part in (predicted, rows.matrix @ plain)
    ]
    for group, entry in enumerate(evidence.joints):
        own = inner & (rows.group == group)
        whole = np.linalg.norm(torque[own])
        for found, left in zip((entry.held_out, entry.fitted), errors, strict=True):
            assert found == pytest.approx(100.0 * np.linalg.norm(left[own]) / whole, rel=0.25)
        assert entry.share == pytest.approx(1.0 - kept[rows.group == group].mean(), abs=0.02)
        assert entry.torque == pytest.approx(whole / np.sqrt(own.sum()), rel=0.05)
    # With such a spring no log alone says what another one does.
    assert (evidence.logs, evidence.stretches) == (0, 6)
    assert evidence.held_out == pytest.approx(np.mean([entry.held_out for entry in evidence.joints]))


def find_evidence(*logs):
    return identify_parameters(LIBRARY, logs, AUTOMATIC).evidence


def list_verdicts(evidence, what):
    return {(entry.joint, entry.verdict) for entry in evidence.tests if entry.what == what}


@pytest.mark.parametrize(("seed", "friction"), [(0, 1.0), (1, 1.0), (0, -1e-3)])
def test_a_robot_that_exists_has_nothing_impossible(seed, friction):
    """Small negative friction is no mistake: it is within its deviation, or too small to matter."""
    truth = TWO_LINK_TRUTH.copy()
    truth[[6, 7]] = truth[[6, 7]] if friction > 0.0 else friction
    evidence = find_evidence(record(seed, truth=truth))
    assert (evidence.impossible, evidence.causes, evidence.bounded) == ((), (), 0.0)
    assert evidence.unexplained < 2.0
    assert "different" not in {entry.verdict for entry in evidence.tests}


@pytest.mark.parametrize(
    ("place", "beginning", "end"),
    [
        (7, "Fc1 = ", ": friction drives the joint"),
        (9, "Fv2 = ", ": friction drives the joint"),
        (3, "the mass matrix is not positive definite ", "at 60 of 60 poses of the logs"),
    ],
    ids=["dry friction", "viscous friction", "inertia"],
)
def test_what_no_robot_has_is_impossible(place, beginning, end):
    truth = TWO_LINK_TRUTH.copy()
    truth[place] *= -1.0
    evidence = find_evidence(record(0, truth=truth))
    (said,) = (text for text in evidence.impossible if text.startswith(beginning))
    assert said.endswith(end)
    # No mistake in the log makes such a log: its model is exact.
    assert evidence.unexplained < 2.0
    if place != 3:
        # Friction that drives a joint is most of what bounds leave of it.
        assert evidence.bounded > evidence.unexplained


def test_a_validation_shows_what_joints_leave_when_they_rest():
    """Slow rows count, and what dry friction holds at rest no model predicts."""
    estimate = identify_parameters(LIBRARY, [record_sticking(0)[0]], AUTOMATIC)
    held, resting = record_sticking(1)
    validation = validate_estimate(estimate, LIBRARY, held, replace(STATED, standstill=0.1))
    assert len(validation.motion) == 2
    for entry, part in zip(validation.motion, validation.residual, strict=True):
        motion, _, rest = entry.rms
        assert rest > 5.0 * motion
        assert sum(entry.rows) == part.samples
        assert entry.rows[2] == pytest.approx(resting.mean() * part.samples, rel=0.1)
        assert entry.left_out == 0
        assert entry.whole == pytest.approx(part.norm / np.sqrt(part.samples))


def test_a_joint_that_never_moves_is_left_out_and_what_it_would_add_is_said():
    estimate = identify_parameters(LIBRARY, [record(0)], AUTOMATIC)
    assert identify_parameters(LIBRARY, [record(0)], AUTOMATIC, rows="energy").evidence is None
    held = record(1)
    still = replace(held, position=held.position * [0.0, 1.0] + [0.4, 0.0])
    validation = validate_estimate(estimate, LIBRARY, still, STATED)
    assert [part.joint for part in validation.residual] == ["joint2"]
    first, second = validation.motion
    assert (first.joint, first.left_out, first.rows[:2]) == ("joint1", first.rows[2], (0, 0))
    assert first.rms == (None, None, first.whole)
    assert second.left_out == 0
    rows = prepare_rows("torque", LIBRARY, still, STATED, window=0.1, every=True)
    errors = (rows.values - rows.matrix @ estimate.assemble(rows.names))[rows.group == 0]
    assert first.whole == pytest.approx(np.sqrt(np.mean(errors**2)))
    assert first.left_out == len(errors)


def test_the_mistake_is_in_the_evidence():
    log = record(1)
    evidence = find_evidence(replace(log, torque=log.torque * np.array([1.0, -1.0])))
    (cause,) = (entry for entry in evidence.causes if "torque of joint 'joint2'" in entry.cause)
    assert "-1" in cause.remedy
    assert cause.after < 5.0 < evidence.unexplained
    assert evidence.impossible


def test_logs_and_halves_that_contradict_each_other_differ():
    """Dry friction of joint 2 is three times as large in one of two logs, or in the second half of one."""
    truth = TWO_LINK_TRUTH.copy()
    truth[10] *= 3.0
    same, other = (record(2, truth=entry) for entry in (TWO_LINK_TRUTH, truth))
    assert ("joint2", "different") in list_verdicts(find_evidence(record(1), other), "logs")
    assert "different" not in {
        verdict for _, verdict in list_verdicts(find_evidence(record(1), same), "logs")
    }
    late = same.time > np.mean(same.time)
    half = replace(same, torque=np.where(late[:, None], other.torque, same.torque))
    assert ("joint2", "different") in list_verdicts(find_evidence(half), "halves")


def test_parts_are_compared_in_what_both_determine():
    first, second = record(1), record(2)
    still = replace(second, position=np.column_stack([second.position[:, 0], np.full(len(second.time), 0.3)]))
    dry = [NAMES.index("Fv2"), NAMES.index("Fc2")]
    for other, alike in ((second, True), (still, False)):
        study = plan_fit(LIBRARY, [first, other], AUTOMATIC, rows="torque", estimator=None).study
        shared, complete = find_shared(study, study.logs.log == 0)
        np.testing.assert_allclose(shared @ shared, shared, atol=1e-6)
        assert complete == alike
        # What both determine is the same whichever of them is called the first.
        np.testing.assert_allclose(find_shared(study, study.logs.log == 1)[0], shared, atol=1e-6)
        if alike:
            np.testing.assert_allclose(shared, np.eye(len(shared)), atol=1e-6)
        else:
            # What differs in friction of the joint that rests in one of them counts for nothing.
            assert np.linalg.matrix_rank(shared, tol=1e-6) < len(shared)
            np.testing.assert_allclose(shared[:, dry], 0.0, atol=1e-6)


def test_long_clean_logs_say_the_same():
    evidence = find_evidence(*(record(seed, samples=3 * 5001) for seed in (1, 2)))
    assert list_verdicts(evidence, "logs") == {("joint1", "same"), ("joint2", "same")}


def test_friction_that_rises_at_rest_contradicts_slow_rows():
    """Stribeck's friction, which Coulomb's law has not: rows at speed say something else."""
    log = record(1, samples=15001, friction=lambda dq: 4.0 * np.sign(dq) * np.exp(-np.abs(dq) / 0.1))
    assert ("joint2", "different") in list_verdicts(find_evidence(log), "slow rows")


def test_ranges_periods_and_proportions_are_those_of_the_log():
    evidence, log = find_evidence(record(3)), record(3, encoder=0.0)
    assert (evidence.period, evidence.in_proportion) == (0.0, ())
    rate = np.gradient(log.position, log.period, axis=0)
    for joint, entry in enumerate(evidence.covered):
        inner = log.position[200:-200, joint]
        assert inner.min() - 0.05 < entry.low < inner.min() + 0.05
        assert inner.max() - 0.05 < entry.high < inner.max() + 0.05
        assert entry.speed == pytest.approx(np.abs(rate[200:-200, joint]).max(), rel=0.05)
    # The same six seconds three times.
    part, again = slice(0, 1500), np.arange(4500) % 1500
    repeated = replace(
        log,
        time=log.time[:4500],
        position=np.sin(2.0 * np.pi * log.time[:4500, None] / 6.0 * [1.0, 2.0]),
        torque=log.torque[part][again],
    )
    assert find_evidence(repeated).period == pytest.approx(6.0, abs=0.05)
    tied = replace(log, position=log.position[:, :1] * [1.0, -0.5])
    assert find_evidence(tied).in_proportion == (("joint1", "joint2"),)
