"""Identification of elastic joints from logs as they are: choice, doubts, refusals, files."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from symid.codegen.cache import prepare_library
from symid.errors import EstimateError, IdentifiabilityError, LogError, UsageError
from symid.excitation.trajectories import (
    FourierOptions,
    build_random_fourier,
    build_ta,
    build_tb,
    scale_trajectory,
)
from symid.identification.elastic.elimination import get_wide_cutoff
from symid.identification.elastic.estimate import compute_elimination_bound
from symid.identification.elastic.identify import warn_of_fit
from symid.identification.elastic.methods import (
    AUTOMATIC_METHODS,
    FOLDS,
    build_candidate,
    build_elastic_equations,
    choose_fit,
    fit_method,
)
from symid.identification.elastic.options import ElasticOptions, NlpOptions
from symid.identification.elastic.regression import prepare_elastic_signals
from symid.identification.elastic.validation import predict_elastic
from symid.identification.stored import is_fit, read_fit, write_fit
from symid.joint_models.hysteresis import Elasticity
from symid.joint_models.prandtl_ishlinskii import compute_hysteresis_torque
from symid.logs.recording import Recording
from symid.robot.toml_reader import read_robot
from symid.simulation.elastic_experiment import (
    build_clean_options,
    build_noisy_options,
    observe,
    simulate_elastic,
)
from tests.elastic_fits import identify_elastic
from tests.recovery.elastic_runs import find_error, find_truth, prepare_arm, run_arm


@pytest.fixture(scope="module")
def arm(robots_folder):
    return prepare_arm(robots_folder)


@pytest.fixture(scope="module")
def run(arm):
    return run_arm(*arm, noisy=True, duration=12.0)


@pytest.fixture(scope="module")
def estimate(arm, run):
    return identify_elastic(arm[1], [run.recording])


def list_codes(caught):
    return [notice.code for notice in caught.value.notices]


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
    for joint, spring in enumerate(estimate.springs):
        found = compute_hysteresis_torque(spring.elasticity, run.phi[:, joint])
        error = np.linalg.norm(found - run.joint_torque[:, joint]) / np.linalg.norm(
            run.joint_torque[:, joint]
        )
        assert error < 0.03
        assert spring.truth == arm[1].card.elasticity[joint]
        assert 0.0 < spring.excited < spring.torsion


def test_deviations_cover_the_truth_and_are_not_below_the_bound(arm, run):
    """The bound is that of methods that know nothing of the springs, as the weighted elimination."""
    estimate = identify_elastic(arm[1], [run.recording], ElasticOptions(method="weighted"))
    truth = find_truth(arm[1])
    deviations = np.array([entry.std for entry in estimate.parameters])
    assert np.all(np.abs(values(estimate) - truth) < 5.0 * deviations)
    exact = replace(run.recording, position=run.q, motor_position=run.theta, torque=run.torque)
    signals = prepare_elastic_signals(exact, ElasticOptions(cutoff=0.0))
    noise = 0.02 * np.sqrt(np.mean(run.torque**2, axis=0))
    bound = np.sqrt(np.diag(compute_elimination_bound(arm[1], [signals], [noise])))
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


def test_the_bound_is_that_of_torque_rows_with_true_accelerations(arm, run):
    library = arm[1]
    exact = replace(run.recording, position=run.q, motor_position=run.theta, torque=run.torque)
    signals = prepare_elastic_signals(exact, ElasticOptions(cutoff=0.0))
    noise = np.array([0.2, 0.1])
    ddq, ddtheta = (np.gradient(part, signals.period, axis=0) for part in (signals.dq, signals.dtheta))
    (link,) = library.evaluate("torque_regressor", signals.q, signals.dq, ddq)
    (friction,) = library.evaluate("friction_regressor", signals.dtheta)
    rows = np.concatenate([link, ddtheta[:, :, None] * np.eye(2), friction], axis=2) / noise[:, None]
    rows = rows.reshape(-1, rows.shape[2])
    expected = np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    found = np.sqrt(np.diag(compute_elimination_bound(library, [signals], [noise])))
    assert np.allclose(found, expected, rtol=1e-3)


def test_an_estimate_is_read_as_it_was_written(tmp_path, arm, estimate):
    path = write_fit(estimate, tmp_path / "estimate.json")
    assert is_fit(path)
    assert read_fit(path, arm[1].card) == estimate
    fit = estimate.build_fit(arm[1].card)
    assert np.array_equal(fit.chi, values(estimate))
    assert len(fit.elasticity) == 2


@pytest.mark.parametrize(
    ("change", "place"),
    [
        (lambda data: data.update(format="something"), "symid"),
        (lambda data: data.update(version=9), r"\b9\b"),
        (lambda data: data.pop("springs"), "springs"),
        (lambda data: data.update(outcome="PERFECT"), "outcome:.* SOLVED, .*'PERFECT'"),
        (lambda data: data["covariance"].pop(), "covariance:.* 12 rows"),
        (lambda data: data["parameters"][0].update(value="1"), r"parameters\[0\].value:.*'1'"),
        (lambda data: data.update(robot=3), "robot:.* 3"),
        (lambda data: data["springs"][0]["elasticity"]["stops"].reverse(), r"springs\[0\].elasticity:"),
    ],
)
def test_files_that_are_no_estimates_are_refused(tmp_path, estimate, change, place):
    path = write_fit(estimate, tmp_path / "estimate.json")
    data = json.loads(path.read_text(encoding="utf-8"))
    change(data)
    path.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(EstimateError, match=place) as caught:
        read_fit(path)
    assert list_codes(caught) == ["estimate.format"]


@pytest.mark.parametrize("text", ["", "[1]", "{", "\x00"])
def test_files_of_something_else_are_refused(tmp_path, text):
    path = tmp_path / "estimate.json"
    path.write_text(text, encoding="utf-8")
    assert not is_fit(path)
    for wrong in (path, tmp_path / "none.json"):
        with pytest.raises(EstimateError) as caught:
            read_fit(wrong)
        assert [(notice.code, notice.file) for notice in caught.value.notices] == [
            ("estimate.format", str(wrong))
        ]


def test_an_estimate_of_another_model_is_refused(tmp_path, arm, estimate):
    path = write_fit(estimate, tmp_path / "estimate.json")
    with pytest.raises(EstimateError) as caught:
        read_fit(path, replace(arm[1].card, signature="0" * 64))
    assert list_codes(caught) == ["estimate.signature"]


@pytest.mark.parametrize("method", ["linear-spring", "two-step", "elimination", "weighted", "independent"])
def test_every_method_can_be_asked_for(arm, run, method):
    found = identify_elastic(arm[1], [run.recording], ElasticOptions(method=method))
    assert found.method == method
    assert [trial.method for trial in found.trials] == [method]
    assert found.trials[0].error is None
    assert len(found.springs) == len(found.residual) == 2
    assert find_error(values(found), find_truth(arm[1])) < 0.2
    assert found.settings["method"] == method


def test_one_cost_can_be_asked_for_and_keeps_to_its_grid(arm):
    clean = run_arm(*arm, duration=8.0)
    options = ElasticOptions(method="two-step", scheme="same-cost", knees=0, stops=4)
    found = identify_elastic(arm[1], [clean.recording], options)
    assert found.method == "same-cost"
    assert len(found.history) > 6
    assert find_error(values(found), find_truth(arm[1])) < 0.1


def test_options_of_the_one_shot_problem_reach_it(tmp_path, arm, run):
    """Rows, Stribeck friction and odd springs can be asked for; the result says so."""
    nlp = NlpOptions(rows=("filtered",), stribeck=True, smoothing=0.01, odd=True, rounds=0)
    found = identify_elastic(arm[1], [run.recording], ElasticOptions(method="nlp", nlp=nlp))
    assert found.settings["nlp"]["rows"] == ["filtered"]
    assert found.settings["nlp"]["stribeck"] is True
    # The arm has none.
    told = [notice.text for notice in found.notices if notice.code == "elastic.stribeck"]
    assert [text.split(":")[0] for text in told] == ["joint 'shoulder'", "joint 'elbow'"]
    for spring in found.springs:
        knees = {knee.threshold: knee.slope for knee in spring.elasticity.knees}
        assert all(knees[-torque] == slope for torque, slope in knees.items() if -torque in knees)
    assert read_fit(write_fit(found, tmp_path / "estimate.json"), arm[1].card) == found
    plain = identify_elastic(arm[1], [run.recording], ElasticOptions(method="weighted"))
    assert "nlp" not in plain.settings


def test_residuals_are_those_of_their_own_joints_where_a_spring_is_refused(arm, run, weighted):
    """The torque that a residual is measured by is the joint's own, whichever joint comes before it."""
    whole, part = (
        predict_elastic(
            arm[1], run.recording, ElasticOptions(), weighted, identifiable=identifiable
        ).residuals[1][1]
        for identifiable in ((True, True), (False, True))
    )
    assert part == whole[1:]


def test_a_robot_without_springs_is_refused(robots_folder, run):
    library = prepare_library(
        read_robot(robots_folder / "two_link.toml"), names=("friction",), backend="python"
    )
    with pytest.raises(UsageError, match="'two_link'") as caught:
        identify_elastic(library, [run.recording])
    assert list_codes(caught) == ["usage.not-elastic"]


def test_no_log_and_logs_of_another_robot_are_refused(arm, run):
    with pytest.raises(UsageError) as caught:
        identify_elastic(arm[1], [])
    assert list_codes(caught) == ["usage.no-log"]
    one = Recording(
        time=run.time,
        position=run.q[:, :1],
        motor_position=run.theta[:, :1],
        torque=run.torque[:, :1],
    )
    with pytest.raises(LogError, match=r" 1 joints.* 2$") as caught:
        identify_elastic(arm[1], [one])
    assert list_codes(caught) == ["log.joints"]


def test_one_encoder_is_refused_with_what_is_missing(arm, run):
    lone = Recording(time=run.time, position=run.q, torque=run.torque)
    with pytest.raises(LogError, match=r"\[log.motor_position\]") as caught:
        identify_elastic(arm[1], [lone])
    assert list_codes(caught) == ["elastic.one-encoder"]


def test_a_short_log_is_refused(arm, run):
    short = Recording(
        time=run.time[:300], position=run.q[:300], motor_position=run.theta[:300], torque=run.torque[:300]
    )
    with pytest.raises(LogError, match=r" 300 .* 657$") as caught:
        identify_elastic(arm[1], [short], ElasticOptions(cutoff=25.0))
    assert list_codes(caught) == ["log.too-short"]


def test_standstill_and_torsion_below_the_noise_are_refused(arm, run):
    rng = np.random.default_rng(0)
    noise = [1e-6 * rng.normal(size=run.q.shape) for _ in range(2)]
    still = Recording(time=run.time, position=noise[0], motor_position=noise[1], torque=run.torque)
    with pytest.raises(IdentifiabilityError) as caught:
        identify_elastic(arm[1], [still])
    assert list_codes(caught) == ["elastic.standstill"]
    rigid = Recording(time=run.time, position=run.q, motor_position=run.q + noise[1], torque=run.torque)
    with pytest.raises(IdentifiabilityError, match="1e-06 rad") as caught:
        identify_elastic(arm[1], [rigid])
    assert list_codes(caught) == ["elastic.no-torsion"] * 2


def test_one_joint_without_visible_torsion_is_said_and_the_others_are_found(arm, run):
    rng = np.random.default_rng(0)
    motor = run.theta.copy()
    motor[:, 1] = run.q[:, 1]
    recording = run.recording
    noisy = motor + 2e-6 * rng.normal(size=motor.shape)
    one = Recording(time=run.time, position=recording.position, motor_position=noisy, torque=recording.torque)
    found = identify_elastic(arm[1], [one], ElasticOptions(method="elimination"))
    told = [notice.text for notice in found.notices if notice.code == "elastic.no-torsion"]
    assert len(told) == 1
    assert "joint 'elbow'" in told[0]
    assert [(spring.identifiable, spring.reason) for spring in found.springs] == [
        (True, ""),
        (False, told[0]),
    ]
    assert ("spring of elbow", told[0]) in found.refused
    assert found.springs[0].elasticity.initial_stiffness == pytest.approx(600.0, rel=0.1)


def test_a_torsion_of_the_size_of_the_noise_tells_no_spring(arm, run):
    """Noise alone spans far more than its standard deviation, and is no torsion for that."""
    rng = np.random.default_rng(0)
    motor = run.theta.copy()
    motor[:, 1] = run.q[:, 1] + 1e-3 * run.phi[:, 1]
    noise = 0.5e-3 * np.std(run.phi[:, 1])
    one = Recording(
        time=run.time,
        position=run.recording.position + noise * rng.normal(size=motor.shape) * [0.0, 1.0],
        motor_position=motor,
        torque=run.recording.torque,
    )
    found = identify_elastic(arm[1], [one], ElasticOptions(method="weighted"))
    assert [spring.identifiable for spring in found.springs] == [True, False]


@pytest.mark.parametrize("noise", [0.0, 1e-6])
def test_what_a_joint_at_rest_hides_is_refused_by_name(tmp_path, arm, run, noise):
    rng = np.random.default_rng(0)
    still = [0.3 + noise * rng.normal(size=len(run.time)) for _ in range(2)]
    recording = Recording(
        time=run.time,
        position=np.column_stack([run.q[:, 0], still[0]]),
        motor_position=np.column_stack([run.theta[:, 0], still[1]]),
        torque=run.torque,
    )
    method = "automatic" if noise == 0.0 else "weighted"
    found = identify_elastic(arm[1], [recording], ElasticOptions(method=method))
    assert [name for name, _ in found.refused] == ["IA2", "Fv2", "Fc2", "spring of elbow"]
    stds = {entry.name: entry.std for entry in found.parameters}
    assert {name for name, std in stds.items() if not np.isfinite(std)} == {"IA2", "Fv2", "Fc2"}
    assert np.all(np.isfinite(values(found)))
    assert [spring.identifiable for spring in found.springs] == [True, False]
    path = write_fit(found, tmp_path / "estimate.json")
    assert read_fit(path, arm[1].card) == found


def test_an_encoder_that_never_changes_tells_no_torsion(arm, run):
    stuck = run.recording.position.copy()
    stuck[:, 0] = 0.1
    dead = replace(run.recording, position=stuck)
    found = identify_elastic(arm[1], [dead], ElasticOptions(method="weighted"))
    assert [spring.identifiable for spring in found.springs] == [False, True]
    told = [notice.text for notice in found.notices if notice.code == "elastic.dead-encoder"]
    assert len(told) == 1
    assert re.search("'shoulder'.* link encoder", told[0])
    # Nothing that rests on the shoulder's motor can be right, the elbow's spring included.
    stuck = run.recording.motor_position.copy()
    stuck[:, 0] = 0.1
    dead = replace(run.recording, motor_position=stuck)
    with pytest.raises(IdentifiabilityError, match=r"'shoulder'.* motor encoder") as caught:
        identify_elastic(arm[1], [dead], ElasticOptions(method="weighted"))
    assert list_codes(caught) == ["elastic.dead-encoder"]
    # With both motors dead the links move all the same: it is no standstill.
    dead = replace(run.recording, motor_position=np.full_like(stuck, 0.1))
    with pytest.raises(IdentifiabilityError) as caught:
        identify_elastic(arm[1], [dead], ElasticOptions(method="weighted"))
    assert list_codes(caught) == ["elastic.dead-encoder"] * 2


@pytest.mark.parametrize("torque", [0.0, 3.0])
def test_a_log_without_torque_is_refused(arm, run, torque):
    dead = replace(run.recording, torque=np.full_like(run.torque, torque))
    with pytest.raises(IdentifiabilityError) as caught:
        identify_elastic(arm[1], [dead])
    assert list_codes(caught) == ["elastic.no-torque"]


@pytest.mark.parametrize("method", ["elimination", "weighted", "two-step"])
@pytest.mark.parametrize("mistake", ["torque", "sides"])
def test_springs_that_explain_nothing_are_refused(arm, run, method, mistake):
    good = run.recording
    wrong = {
        "torque": replace(good, torque=-good.torque),
        "sides": replace(good, position=good.motor_position, motor_position=good.position),
    }
    with pytest.raises(IdentifiabilityError) as caught:
        identify_elastic(arm[1], [wrong[mistake]], ElasticOptions(method=method))
    assert list_codes(caught) == ["elastic.no-spring"] * 2


def test_one_joint_with_its_sides_swapped_has_no_spring(arm, run):
    position, motor = run.recording.position.copy(), run.recording.motor_position.copy()
    position[:, 1], motor[:, 1] = run.recording.motor_position[:, 1], run.recording.position[:, 1]
    wrong = replace(run.recording, position=position, motor_position=motor)
    found = identify_elastic(arm[1], [wrong], ElasticOptions(method="weighted"))
    assert [spring.identifiable for spring in found.springs] == [True, False]
    assert "elastic.no-spring" in {notice.code for notice in found.notices}
    assert "spring of elbow" in dict(found.refused)


@pytest.mark.parametrize(("joint", "hidden"), [(0, {"Fv2", "Fc2"}), (1, {"Fv1", "Fc1"})])
def test_what_the_motion_of_one_joint_does_not_tell_is_refused(arm, joint, hidden):
    options = replace(build_noisy_options(), duration=20.0)
    slow = simulate_elastic(*arm, build_tb(joint), options, np.random.default_rng(1))
    found = identify_elastic(arm[1], [slow.recording], ElasticOptions(method="weighted"))
    assert {name for name, _ in found.refused} == hidden
    stated = {entry.name: (f"{entry.std:.3g}", f"{entry.value:.3g}") for entry in found.parameters}
    assert all(number in reason for name, reason in found.refused for number in stated[name])
    assert "elastic.not-identifiable" in {notice.code for notice in found.notices}
    wrong = np.abs(values(found) - find_truth(arm[1]))
    names = [entry.name for entry in found.parameters]
    # What is kept is right; what is refused need not be.
    kept = [index for index, name in enumerate(names) if name not in hidden]
    stds = np.array([entry.std for entry in found.parameters])
    assert np.all(wrong[kept] < 6.0 * stds[kept])


def test_all_is_told_by_a_motion_of_all_joints(estimate):
    """Parameters that are zero are known to be so."""
    assert estimate.refused == ()
    assert all(spring.identifiable for spring in estimate.springs)
    assert "elastic.not-identifiable" not in {notice.code for notice in estimate.notices}


def test_energy_rows_of_many_joints_are_warned_of(robots_folder):
    robot = read_robot(robots_folder / "puma560_elastic.toml")
    library = prepare_library(robot)
    rng = np.random.default_rng(3)
    motion = build_random_fourier(robot, rng, FourierOptions(duration=6.0, base_frequency=1.0 / 6.0))
    log = simulate_elastic(robot, library, motion, build_noisy_options(), rng).recording
    codes = {}
    for method in ("linear-spring", "two-step", "weighted"):
        options = ElasticOptions(method=method, iterations=2, refine=False)
        try:
            notices = identify_elastic(library, [log], options).notices
        except IdentifiabilityError as error:
            # All springs may be refused then, and the reason is said all the same.
            notices = error.notices
        codes[method] = {notice.code for notice in notices}
    for method in ("linear-spring", "two-step"):
        assert {"identify.energy-rank", "elastic.condition"} <= codes[method]
    assert not {"identify.energy-rank", "elastic.condition"} & codes["weighted"]


def test_rows_that_begin_before_stops_have_settled_are_said(arm):
    """Motion that grows: the largest torsion comes last, long after a quarter of the log."""
    growing = replace(scale_trajectory(build_ta(), 3.0), decay=np.full(2, -0.2))
    options = replace(build_clean_options(), duration=12.0)
    late = simulate_elastic(*arm, growing, options, np.random.default_rng(0))
    found = identify_elastic(arm[1], [late.recording], ElasticOptions(method="weighted"))
    told = [notice.text for notice in found.notices if notice.code == "elastic.not-converged"]
    assert told
    # The stop, when its state is known, and when rows begin.
    assert re.search(r"stop at 0\.\d+ rad .* [0-9.]+ s .* 3 s:", told[0])


def test_a_spring_without_stiffness_beyond_its_stops_is_said(work, weighted):
    codes = {notice.code for notice in warn_of_fit(work, weighted, 10.0)}
    assert "elastic.no-stiffness" not in codes
    first, second = weighted.elasticity
    soft = replace(weighted, elasticity=(replace(first, stiffness=0.0), second))
    texts = [n.text for n in warn_of_fit(work, soft, 10.0) if n.code == "elastic.no-stiffness"]
    assert len(texts) == 1
    assert "'shoulder'" in texts[0]
    assert "elastic.no-stiffness" not in {n.code for n in warn_of_fit(work, soft, 10.0, refused=(0,))}


def test_the_one_shot_fit_is_moved_by_the_rows_that_it_has_to_predict(work, one_shot):
    candidate = build_candidate(work, one_shot)
    deviations = np.sqrt(np.diag(one_shot.covariance))
    for fold in range(FOLDS):
        moved = np.abs(candidate.refit(fold) - one_shot.chi)
        assert np.max(moved / deviations) > 0.1
        assert np.max(moved / deviations) < 5.0


def test_recordings_of_other_sample_rates_have_cutoffs_of_their_own(arm, run):
    whole = run.recording
    slow = Recording(
        time=whole.time[::10],
        position=whole.position[::10],
        motor_position=whole.motor_position[::10],
        torque=whole.torque[::10],
    )
    work = build_elastic_equations(arm[1], (whole, slow), ElasticOptions(cutoff=10.0))
    expected = [get_wide_cutoff(part.period) for part in (whole, slow)]
    assert [part.cutoff for part in work.wide.signals] == expected
    assert expected[0] > expected[1]


def test_a_slow_motion_of_one_joint_leaves_doubts(arm):
    options = replace(build_noisy_options(), duration=12.0)
    slow = simulate_elastic(*arm, build_tb(0), options, np.random.default_rng(1))
    found = identify_elastic(arm[1], [slow.recording], ElasticOptions(method="two-step", iterations=2))
    codes = {notice.code for notice in found.notices}
    assert "elastic.poorly-identifiable" in codes
    assert "elastic.outcome" in codes


def test_rows_that_hardly_tell_inertias_apart_are_said_to_be_so(robots_folder):
    stiff = (Elasticity(stiffness=5e4), Elasticity(stiffness=1.3e4))
    robot, library = prepare_arm(robots_folder, springs=stiff)
    run = run_arm(robot, library, duration=6.0)
    found = identify_elastic(library, [run.recording], ElasticOptions(method="linear-spring"))
    assert "elastic.condition" in {notice.code for notice in found.notices}
    assert found.condition > 300.0


def test_another_seed_gives_another_estimate_within_its_deviations(arm, run, estimate):
    sensors = build_noisy_options().sensors
    other = identify_elastic(
        arm[1],
        [observe(run, sensors, np.random.default_rng(7))],
        ElasticOptions(method=estimate.method),
    )
    deviations = np.array([entry.std for entry in estimate.parameters])
    difference = np.abs(values(other) - values(estimate))
    assert np.any(difference > 0.0)
    assert np.all(difference < 6.0 * deviations)
