"""What speaks for a fit: explicit fits without each stretch, truths no robot has, terms the model lacks."""

from dataclasses import replace

import numpy as np
import pytest

from symid.identification.diagnostics import FAMILIES
from symid.identification.diagnostics.stretches import fit_stretches
from symid.identification.regression.equations import stack_rows
from symid.identification.regression.preparation import prepare_rows
from symid.identification.rigid.fit import FittedRows, identify_parameters, list_joint_evidence
from symid.identification.rigid.validation import validate_estimate
from symid.robot.description import Decimation, Processing
from tests.recovery.closed_form import TWO_LINK_TRUTH
from tests.unit.identification.rigid.two_link_logs import LIBRARY, NAMES, record, record_sticking, score

STATED = Processing(filter_cutoff=50.0, drop_first=50, drop_last=50, decimation=Decimation(factor=5))
AUTOMATIC = Processing(automatic=True)
SCORING = 2.5


def smooth(values, rows):
    """Return values (m,) at the scoring band, joint by joint and log by log, and which are far from ends."""
    found, inner = np.empty(len(values)), np.zeros(len(values), dtype=bool)
    for run in np.unique(rows.run):
        for group in (0, 1):
            own = (rows.run == run) & (rows.group == group)
            found[own], inner[own] = score(values[own], rows.time[own], SCORING)
    return found, inner


@pytest.mark.parametrize("seeds", [(0,), (0, 1, 2)])
@pytest.mark.parametrize("standstill", [None, 0.15])
def test_what_is_held_out_is_that_of_explicit_fits(seeds, standstill):
    """Slow rows that the fit leaves out count where it is judged; of several logs whole logs are held out."""
    logs = [record(seed, encoder=1e-5, torque=0.5) for seed in seeds]
    processing = replace(STATED, standstill=standstill)
    estimate = identify_parameters(LIBRARY, logs, processing, estimator="ols")
    rows = stack_rows([prepare_rows("torque", LIBRARY, log, STATED, window=0.1) for log in logs])
    kept = np.abs(rows.velocity) >= (standstill or 0.0)
    held = rows.run
    if len(seeds) == 1:
        span = rows.time.max() - rows.time.min()
        held = np.minimum((6 * (rows.time - rows.time.min()) / span).astype(int), 5)
    predicted = np.empty(len(rows.values))
    for fold in np.unique(held):
        used = kept & (held != fold)
        values = np.linalg.lstsq(rows.matrix[used], rows.values[used])[0]
        predicted[held == fold] = rows.matrix[held == fold] @ values
    plain = np.linalg.lstsq(rows.matrix[kept], rows.values[kept])[0]
    torque, inner = smooth(rows.values, rows)
    left, fitted = (smooth(rows.values - part, rows)[0] for part in (predicted, rows.matrix @ plain))
    for group, entry in enumerate(estimate.evidence.joints):
        own = rows.group == group
        slow = np.abs(rows.velocity) < 0.05 * np.quantile(np.abs(rows.velocity[own]), 0.99)
        some = own & inner
        whole = np.sqrt(np.mean(torque[some] ** 2))
        expected = {
            "held_out": (left, some),
            "moving": (left, some & ~slow),
            "reversing": (left, some & slow),
            "fitted": (fitted, some & kept),
        }
        for name, (part, mask) in expected.items():
            percent = 100.0 * np.sqrt(np.mean(part[mask] ** 2)) / whole
            assert getattr(entry, name) == pytest.approx(percent, rel=1e-6), name
        assert entry.resting == np.inf
        assert entry.share == pytest.approx(1.0 - kept[own].mean())
        assert entry.torque == pytest.approx(whole, rel=1e-6)
    evidence = estimate.evidence
    assert evidence.scoring == pytest.approx(SCORING)
    assert (evidence.logs, evidence.stretches) == (0 if len(seeds) == 1 else 3, 6)
    assert evidence.held_out == pytest.approx(np.mean([entry.held_out for entry in evidence.joints]))


def find_evidence(log):
    return identify_parameters(LIBRARY, [log], AUTOMATIC).evidence


@pytest.mark.parametrize(("seed", "friction"), [(0, 1.0), (1, 1.0), (0, -1e-3)])
def test_a_robot_that_exists_has_nothing_impossible(seed, friction):
    """Small negative friction is no mistake: it is within its deviation, or too small to matter."""
    truth = TWO_LINK_TRUTH.copy()
    truth[[6, 7]] = truth[[6, 7]] if friction > 0.0 else friction
    evidence = find_evidence(record(seed, truth=truth))
    assert (evidence.impossible, evidence.cause) == ((), "")
    assert evidence.unexplained < 2.0


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
    assert len(evidence.impossible) == 1 or place != 3
    # No mistake in the log makes such a log: its model is exact.
    assert evidence.unexplained < 2.0


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


def test_the_likeliest_mistake_is_in_the_evidence():
    log = record(1)
    evidence = find_evidence(replace(log, torque=log.torque * np.array([1.0, -1.0])))
    assert "joint2' has the wrong sign" in evidence.cause
    assert "-1" in evidence.remedy
    assert evidence.cured < 5.0 < evidence.unexplained
    assert evidence.impossible


def test_noise_of_a_velocity_near_rest_is_no_friction():
    """Slow rows are predicted along the states of the instruments, where the sign is right."""
    log = record(0, torque=0.05)
    rows = prepare_rows("torque", LIBRARY, log, STATED, window=0.1)
    noisy = rows.matrix.copy()
    slow = np.abs(rows.velocity) < 0.1
    turned = np.random.default_rng(0).permutation(np.flatnonzero(slow))[::2]
    dry = [NAMES.index(name) for name in ("Fc1", "Fc2")]
    noisy[np.ix_(turned, dry)] *= -1.0
    kept = ~slow
    as_read, left = replace(rows, matrix=noisy), np.zeros(len(rows.values))
    stretches = fit_stretches(as_read, None, kept, np.ones(2))
    fit = {"rows": as_read, "identifiability": None, "fit": None}
    plain = FittedRows(**fit, whole=as_read, speed=rows.velocity, kept=kept, residuals=left)
    alone = list_joint_evidence(plain, stretches, 20.0)
    beside = list_joint_evidence(replace(plain, smooth=rows), stretches, 20.0)
    for one, other in zip(alone, beside, strict=True):
        assert other.reversing < 0.5 * one.reversing
        assert (other.moving, other.held_out) == (one.moving, one.held_out)


WIDE = Processing(filter_cutoff=80.0, drop_first=50, drop_last=50, decimation=Decimation(factor=3))


def identify(seed, friction=None, processing=AUTOMATIC, estimator=None, encoder=1e-5):
    log = record(seed, encoder=encoder, torque=0.05, friction=friction)
    return identify_parameters(LIBRARY, [log], processing, estimator=estimator)


def rise_at_rest(dq):
    """Return what Stribeck friction has beyond Coulomb's."""
    return 0.8 * np.sign(dq) * np.exp(-((dq / 0.15) ** 2))


def differ_by_direction(dq):
    return 0.4 * np.abs(dq) + 0.15 * (dq > 0.0)


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_a_whole_model_misses_nothing(seed):
    for processing in (AUTOMATIC, WIDE):
        estimate = identify(seed, processing=processing)
        assert estimate.evidence.missing == ()
        assert "identify.structure" not in {notice.code for notice in estimate.notices}


@pytest.mark.parametrize(
    ("term", "friction"), [("slow motion", rise_at_rest), ("velocity", differ_by_direction)]
)
@pytest.mark.parametrize("seed", [1, 3])
@pytest.mark.parametrize(
    ("processing", "estimator"), [(AUTOMATIC, None), (AUTOMATIC, "wls"), (WIDE, "huber")]
)
def test_friction_that_the_model_lacks_is_named(seed, term, friction, processing, estimator):
    estimate = identify(seed, friction, processing, estimator)
    (missing,) = estimate.evidence.missing
    assert (missing.joint, missing.term) == ("joint2", term)
    assert missing.gain > 30.0
    assert missing.errors > 2.5
    (notice,) = (entry for entry in estimate.notices if entry.code == "identify.structure")
    assert term in notice.text
    assert FAMILIES[term].advice[1:] in notice.text


def test_the_gain_is_in_percent_of_the_squares_that_are_left():
    """Asymmetric friction is nearly all that the model does not explain; more noise, and it is less."""
    gains = []
    for noise in (0.05, 1.0):
        log = record(0, encoder=1e-5, torque=noise, friction=differ_by_direction)
        (missing,) = identify_parameters(LIBRARY, [log], WIDE).evidence.missing
        gains.append(missing.gain)
    assert 95.0 < gains[0] <= 100.0
    assert gains[1] < 0.9 * gains[0]


def test_a_term_within_the_noise_is_not_named_and_a_log_that_is_hardly_explained_has_causes():
    assert identify(1, lambda dq: 0.01 * differ_by_direction(dq)).evidence.missing == ()
    log = record(0)
    noise = np.random.default_rng(2).normal(size=log.torque.shape)
    evidence = identify_parameters(LIBRARY, [replace(log, torque=noise)], WIDE).evidence
    assert evidence.missing == ()
    assert "nothing to do with this motion" in evidence.cause
