"""Identification of elastic joints from logs as they are: choice, doubts, refusals, files."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from symid.codegen.cache import prepare_library
from symid.errors import IdentifiabilityError, LogError, UsageError
from symid.excitation.trajectories import (
    FourierOptions,
    build_random_fourier,
    build_ta,
    build_tb,
    scale_trajectory,
)
from symid.identification.elastic.identify import warn_of_fit
from symid.identification.elastic.methods import (
    AUTOMATIC_METHODS,
    build_candidate,
    build_elastic_equations,
    choose_fit,
    fit_method,
)
from symid.identification.elastic.options import ElasticOptions, NlpOptions
from symid.identification.elastic.regression import prepare_elastic_signals
from symid.identification.elastic.validation import evaluate_elastic
from symid.identification.judge import POLICY
from symid.identification.stored import read_fit, write_fit
from symid.joint_models.prandtl_ishlinskii import compute_hysteresis_torque
from symid.logs.recording import cut_recording
from symid.robot.toml_reader import read_robot
from symid.simulation.experiment import build_noisy_options, observe, simulate_elastic
from symid.study.elastic_methods import compute_elimination_bound
from tests.recovery.elastic_runs import find_error, find_truth, identify_elastic, run_arm
from tests.refusals import raises, tell


@pytest.fixture(scope="module")
def run(arm):
    return run_arm(*arm, noisy=True, duration=12.0)


@pytest.fixture(scope="module")
def exact(run):
    """Return the signals as they were."""
    log = replace(run.recording, position=run.q, motor_position=run.theta, torque=run.torque)
    return prepare_elastic_signals(log, ElasticOptions(cutoff=0.0))


@pytest.fixture(scope="module")
def estimate(arm, run):
    return identify_elastic(arm[1], [run.recording])


@cache
def spoil(run, case):
    """Return the run's log with what hides a joint, or all of it."""
    log, dead, still = run.recording, np.full_like(run.q, 0.1), 1e-6
    rng = np.random.default_rng(0)
    one, other = (still * rng.normal(size=run.q.shape) for _ in range(2))
    hum = 0.5e-3 * np.std(run.phi[:, 1]) * one / still
    left, right, first, second = log.position, log.motor_position, np.array([1.0, 0.0]), np.array([0.0, 1.0])
    turned, rigid = run.theta * first + run.q * second, 1e-3 * run.phi * second
    changes = {
        "one encoder": {"motor_position": None},
        "one joint": {"position": left[:, :1], "motor_position": right[:, :1], "torque": log.torque[:, :1]},
        "standstill": {"position": one, "motor_position": other},
        "no torsion": {"position": run.q, "motor_position": run.q + other},
        "no torque": {"torque": 0.0 * log.torque},
        "constant torque": {"torque": 0.0 * log.torque + 3.0},
        "torque reversed": {"torque": -log.torque},
        "sides swapped": {"position": right, "motor_position": left},
        "dead motor": {"motor_position": dead * first + right * second},
        "dead motors": {"motor_position": dead},
        "dead link": {"position": dead * first + left * second},
        "elbow without torsion": {"motor_position": turned + 2.0 * one},
        # Noise alone spans far more than its standard deviation, and is no torsion for that.
        "elbow as its noise": {"position": left + hum * second, "motor_position": turned + rigid},
        "elbow swapped": {
            "position": left * first + right * second,
            "motor_position": right * first + left * second,
        },
    }
    return cut_recording(log, slice(300)) if case == "short" else replace(log, **changes[case])


@pytest.fixture(scope="module")
def work(arm, run):
    return build_elastic_equations(arm[1], (run.recording,), ElasticOptions())


@pytest.fixture(scope="module")
def weighted(work):
    return fit_method(work, "weighted")


@pytest.fixture(scope="module")
def one_shot(work):
    return fit_method(work, "nlp")


def values(estimate):
    return np.array([entry.value for entry in estimate.parameters])


def test_the_choice_from_noisy_data_alone_is_good(arm, run, estimate):
    truth = find_truth(arm[1])
    assert {trial.method for trial in estimate.trials} == set(AUTOMATIC_METHODS)
    errors = {trial.method: find_error(np.array(trial.values), truth) for trial in estimate.trials}
    assert find_error(values(estimate), truth) == errors[estimate.method]
    assert errors[estimate.method] < 0.02
    assert errors[estimate.method] < min(errors["linear-spring"], errors["two-step"])
    chosen = next(trial for trial in estimate.trials if trial.method == estimate.method)
    assert chosen.error < 1.01 * min(trial.error for trial in estimate.trials)
    assert estimate.method in estimate.reason
    # Parameters that are zero are known to be so.
    assert estimate.refused == ()
    assert "elastic.not-identifiable" not in {notice.code for notice in estimate.notices}
    for joint, spring in enumerate(estimate.springs):
        assert spring.identifiable
        found = compute_hysteresis_torque(spring.elasticity, run.phi[:, joint])
        true = run.joint_torque[:, joint]
        assert np.linalg.norm(found - true) < 0.03 * np.linalg.norm(true)
        assert spring.truth == arm[1].card.elasticity[joint]
        assert 0.0 < spring.excited < spring.torsion


def test_deviations_cover_the_truth_and_are_not_below_the_bound(arm, run, exact):
    """The bound is that of methods that know nothing of the springs, as the weighted elimination."""
    estimate = identify_elastic(arm[1], [run.recording], method="weighted")
    truth = find_truth(arm[1])
    deviations = np.array([entry.std for entry in estimate.parameters])
    assert np.all(np.abs(values(estimate) - truth) < 5.0 * deviations)
    noise = 0.02 * np.sqrt(np.mean(run.torque**2, axis=0))
    bound = np.sqrt(np.diag(compute_elimination_bound(arm[1], [exact], [noise])))
    assert np.all(deviations > 0.9 * bound)
    assert np.all(deviations < 10.0 * bound)


def test_a_one_shot_fit_that_contradicts_the_motions_is_not_taken(work, one_shot):
    fits = [fit_method(work, "elimination"), one_shot]
    agreed = choose_fit(work, fits)
    assert agreed.notices == ()
    assert agreed.fit.method == "nlp"
    wrong = replace(fits[1], rotor=fits[1].rotor * 1.05)
    found = choose_fit(work, [fits[0], wrong])
    assert found.fit.method == "elimination"
    assert [notice.code for notice in found.notices] == ["elastic.contradiction"]
    # With nothing else at hand it is taken all the same.
    assert choose_fit(work, [wrong]).fit is wrong
    # It is moved by the rows that it has to predict; those of the first stretch it was not fitted to.
    candidate = build_candidate(work, one_shot)
    for fold in range(1, POLICY.folds):
        moved = np.abs(candidate.refit(fold) - one_shot.chi) / np.sqrt(np.diag(one_shot.covariance))
        assert 0.1 < np.max(moved) < 5.0


def test_the_deviations_of_the_one_shot_problem_are_those_of_repeated_runs(arm, run):
    """Scores of a few noise realisations: of the order of one, which a wrong covariance would not give."""
    truth = find_truth(arm[1])
    known = np.abs(truth) > 1e-9
    scores = []
    for seed in range(4):
        sensors = build_noisy_options().sensors
        log = observe(run, sensors, np.random.default_rng(seed))
        fit = fit_method(build_elastic_equations(arm[1], (log,), ElasticOptions()), "nlp")
        scores.append((fit.chi - truth)[known] / np.sqrt(np.diag(fit.covariance))[known])
    assert 0.3 < np.sqrt(np.mean(np.square(scores))) < 2.5


def test_the_bound_is_that_of_torque_rows_with_true_accelerations(arm, exact):
    library, noise = arm[1], np.array([0.2, 0.1])
    ddq, ddtheta = (np.gradient(part, exact.period, axis=0) for part in (exact.dq, exact.dtheta))
    (link,) = library.evaluate("torque_regressor", exact.q, exact.dq, ddq)
    (friction,) = library.evaluate("friction_regressor", exact.dtheta)
    rows = np.concatenate([link, ddtheta[:, :, None] * np.eye(2), friction], axis=2) / noise[:, None]
    rows = rows.reshape(-1, rows.shape[2])
    found = compute_elimination_bound(library, [exact], [noise])
    expected = np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    assert np.allclose(np.sqrt(np.diag(found)), expected, rtol=1e-3)


def test_no_stops_and_no_knees_are_a_linear_spring(arm, run):
    found = identify_elastic(arm[1], [run.recording], ElasticOptions(stops=0, knees=0), method="weighted")
    for spring in (entry.elasticity for entry in found.springs):
        assert (spring.stops, spring.knees, spring.branches, spring.cubic) == ((), (), (), 0.0)


def test_options_of_the_one_shot_problem_reach_it(tmp_path, arm, run):
    """Rows, Stribeck friction and odd springs can be asked for; the result says so."""
    nlp = NlpOptions(rows=("filtered",), stribeck=True, smoothing=0.01, odd=True, rounds=0)
    found = identify_elastic(arm[1], [run.recording], ElasticOptions(nlp=nlp), method="nlp")
    assert (found.settings["nlp"]["rows"], found.settings["nlp"]["stribeck"]) == (["filtered"], True)
    # The arm has none.
    told = [notice.text for notice in found.notices if notice.code == "elastic.stribeck"]
    assert [text.split(":")[0] for text in told] == ["joint 'shoulder'", "joint 'elbow'"]
    for spring in found.springs:
        knees = {knee.threshold: knee.slope for knee in spring.elasticity.knees}
        assert all(knees[-torque] == slope for torque, slope in knees.items() if -torque in knees)
    assert read_fit(write_fit(found, tmp_path / "estimate.json")) == found


def test_residuals_are_those_of_their_own_joints_where_a_spring_is_refused(arm, run, estimate):
    """The torque that a residual is measured by is the joint's own, whichever joint comes before it."""
    first, second = estimate.springs
    refused = replace(estimate, springs=(replace(first, identifiable=False), second))
    whole, part = (evaluate_elastic(one, arm[1], run.recording) for one in (estimate, refused))
    assert part.residuals[1][1] == whole.residuals[1][1][1:]


def test_a_robot_without_springs_and_no_log_are_refused(robots_folder, arm, run):
    library = prepare_library(
        read_robot(robots_folder / "two_link.toml"), names=("friction",), backend="python"
    )
    with raises(UsageError, "usage.not-elastic", match="'two_link'"):
        identify_elastic(library, [run.recording])
    with raises(UsageError, "usage.no-log"):
        identify_elastic(arm[1], [])


@pytest.mark.parametrize(
    ("case", "error", "codes", "match"),
    [
        ("one joint", LogError, ["log.joints"], r" 1 joints.* 2$"),
        ("one encoder", LogError, ["elastic.one-encoder"], r"\[log.motor_position\]"),
        ("short", LogError, ["log.too-short"], r" 300 .* 657$"),
        ("standstill", IdentifiabilityError, ["elastic.standstill"], ""),
        ("no torsion", IdentifiabilityError, ["elastic.no-torsion"] * 2, "1e-06 rad"),
        ("no torque", IdentifiabilityError, ["elastic.no-torque"], ""),
        ("constant torque", IdentifiabilityError, ["elastic.no-torque"], ""),
        # Nothing that rests on the shoulder's motor can be right, the elbow's spring included.
        ("dead motor", IdentifiabilityError, ["elastic.dead-encoder"], r"'shoulder'.* motor encoder"),
        # With both motors dead the links move all the same: it is no standstill.
        ("dead motors", IdentifiabilityError, ["elastic.dead-encoder"] * 2, ""),
    ],
)
def test_logs_that_tell_no_robot_are_refused(arm, run, *, case, error, codes, match):
    options = ElasticOptions(cutoff=25.0 if case == "short" else None)
    with raises(error, *codes, match=match):
        identify_elastic(arm[1], [spoil(run, case)], options)


@pytest.mark.parametrize(
    ("case", "method", "code", "match"),
    [
        ("elbow without torsion", "elimination", "elastic.no-torsion", "joint 'elbow'"),
        ("elbow as its noise", "weighted", "elastic.no-torsion", "joint 'elbow'"),
        ("elbow swapped", "weighted", "elastic.no-spring", "joint 'elbow'"),
        ("dead link", "weighted", "elastic.dead-encoder", "'shoulder'.* link encoder"),
    ],
)
def test_a_joint_without_visible_torsion_is_said_and_the_other_is_found(
    arm, run, *, case, method, code, match
):
    found = identify_elastic(arm[1], [spoil(run, case)], method=method)
    (told,) = (notice.text for notice in found.notices if notice.code == code)
    assert re.search(match, told)
    hidden = int("elbow" in case)
    assert [spring.identifiable for spring in found.springs] == [hidden == 1, hidden == 0]
    assert found.springs[hidden].reason == told
    assert (f"spring of {('shoulder', 'elbow')[hidden]}", told) in found.refused
    if code == "elastic.no-torsion":
        assert found.springs[0].elasticity.initial_stiffness == pytest.approx(600.0, rel=0.1)


@pytest.mark.parametrize("noise", [0.0, 1e-6])
def test_what_a_joint_at_rest_hides_is_refused_by_name(tmp_path, arm, run, noise):
    rng = np.random.default_rng(0)
    still = [0.3 + noise * rng.normal(size=len(run.q)) for _ in range(2)]
    recording = replace(
        run.recording,
        position=np.column_stack([run.q[:, 0], still[0]]),
        motor_position=np.column_stack([run.theta[:, 0], still[1]]),
    )
    method = "automatic" if noise == 0.0 else "weighted"
    found = identify_elastic(arm[1], [recording], method=method)
    assert [name for name, _ in found.refused] == ["IA2", "Fv2", "Fc2", "spring of elbow"]
    stds = {entry.name: entry.std for entry in found.parameters}
    assert {name for name, std in stds.items() if not np.isfinite(std)} == {"IA2", "Fv2", "Fc2"}
    assert np.all(np.isfinite(values(found)))
    assert [spring.identifiable for spring in found.springs] == [True, False]
    path = write_fit(found, tmp_path / "estimate.json")
    assert read_fit(path) == found


@pytest.mark.parametrize("method", ["elimination", "weighted", "two-step"])
@pytest.mark.parametrize("case", ["torque reversed", "sides swapped"])
def test_springs_that_explain_nothing_are_refused(arm, run, method, case):
    with raises(IdentifiabilityError, "elastic.no-spring", "elastic.no-spring"):
        identify_elastic(arm[1], [spoil(run, case)], method=method)


@pytest.mark.parametrize(("joint", "hidden"), [(0, {"Fv2", "Fc2"}), (1, {"Fv1", "Fc1"})])
def test_what_the_motion_of_one_joint_does_not_tell_is_refused(arm, joint, hidden):
    slow = run_arm(*arm, build_tb(joint), noisy=True, duration=20.0, seed=1)
    found = identify_elastic(arm[1], [slow.recording], method="weighted")
    assert {name for name, _ in found.refused} == hidden
    stated = {entry.name: (f"{entry.std:.3g}", f"{entry.value:.3g}") for entry in found.parameters}
    assert all(number in reason for name, reason in found.refused for number in stated[name])
    assert "elastic.not-identifiable" in {notice.code for notice in found.notices}
    doubts = identify_elastic(arm[1], [slow.recording], ElasticOptions(iterations=2), method="two-step")
    expected = {"elastic.outcome", *["elastic.poorly-identifiable"][joint:]}
    assert expected <= {notice.code for notice in doubts.notices}
    # What is kept is right; what is refused need not be.
    for entry, truth in zip(found.parameters, find_truth(arm[1]), strict=True):
        assert entry.name in hidden or abs(entry.value - truth) < 6.0 * entry.std, entry


def test_energy_rows_of_many_joints_are_warned_of(robots_folder):
    robot = read_robot(robots_folder / "puma560_elastic.toml")
    library, rng = prepare_library(robot), np.random.default_rng(3)
    motion = build_random_fourier(robot, rng, FourierOptions(duration=6.0, base_frequency=1.0 / 6.0))
    log = simulate_elastic(robot, library, motion, build_noisy_options(), rng).recording
    for method in ("linear-spring", "two-step", "weighted"):
        options = ElasticOptions(iterations=2, refine=False)
        try:
            notices = identify_elastic(library, [log], options, method=method).notices
        except IdentifiabilityError as error:
            # All springs may be refused then, and the reason is said all the same.
            notices = error.notices
        told = "identify.energy-rank" in {notice.code for notice in notices}
        assert told is (method != "weighted")


def test_rows_that_begin_before_stops_have_settled_are_said(arm):
    """Motion that grows: the largest torsion comes last, long after a quarter of the log."""
    growing = replace(scale_trajectory(build_ta(), 3.0), decay=np.full(2, -0.2))
    late = run_arm(*arm, growing, duration=12.0)
    found = identify_elastic(arm[1], [late.recording], method="weighted")
    # The stop, when its state is known, and when rows begin.
    told = tell(found.notices)["elastic.not-converged"]
    assert re.search(r"stop at 0\.\d+ rad .* [0-9.]+ s .* 3 s:", told)


def test_a_spring_without_stiffness_beyond_its_stops_is_said(work, weighted):
    first, second = weighted.elasticity
    soft = replace(weighted, elasticity=(replace(first, stiffness=0.0), second))
    for fit, refused, said in ((soft, (), True), (soft, (0,), False), (weighted, (), False)):
        texts = tell(warn_of_fit(work, fit, refused))
        assert ("'shoulder'" in texts.get("elastic.no-stiffness", "")) is said
