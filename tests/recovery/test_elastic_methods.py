"""Methods for elastic joints find what a simulated arm was made of."""

from dataclasses import replace

import numpy as np
import pytest

from symid.excitation.trajectories import build_tb
from symid.identification.elastic import together
from symid.identification.elastic.elimination import (
    build_band_rows,
    fit_band,
    fit_elimination,
)
from symid.identification.elastic.options import ElasticOptions
from symid.identification.elastic.together import (
    TwoStepState,
    fit_linear_spring,
    fit_two_step,
    step_two_step,
)
from symid.identification.regression import solve_scaled
from symid.ipopt import Ending
from symid.joint_models.hysteresis import Elasticity
from symid.joint_models.prandtl_ishlinskii import compute_hysteresis_torque
from symid.study.elastic_methods import estimate_virtual_torsion, fit_independent, split_recordings
from tests.recovery.elastic_runs import (
    KNEES,
    PLACED,
    STOPS,
    build,
    find_error,
    find_truth,
    identify_elastic,
    prepare_arm,
    run_arm,
)


@pytest.fixture(scope="module")
def plain(robots_folder):
    """Return an arm whose springs have stops and no knees."""
    return prepare_arm(robots_folder, knees=False)


@pytest.fixture(scope="module")
def run(arm):
    return run_arm(*arm)


@pytest.fixture(scope="module")
def problem(arm, run):
    return build(arm[1], [run.recording], PLACED)


@pytest.fixture(scope="module")
def energy_problem(plain):
    options = ElasticOptions(thresholds=STOPS, knees=0, tolerance=1e-8, iterations=500)
    return build(plain[1], [run_arm(*plain).recording], options)


def torque_error(springs, run):
    """Return the relative RMS error of the joint torques along the true torsion."""
    found = [compute_hysteresis_torque(spring, run.phi[:, joint]) for joint, spring in enumerate(springs)]
    error = np.array(found).T - run.joint_torque
    return np.sqrt(np.mean(error**2, axis=0) / np.mean(run.joint_torque**2, axis=0))


def test_elimination_needs_no_spring_and_agrees_with_the_two_steps(arm, problem):
    truth = find_truth(arm[1])
    eliminated, iterated = fit_elimination(problem), fit_two_step(problem)
    assert find_error(eliminated.chi, truth) < 1e-4
    assert np.allclose(iterated.chi, eliminated.chi, rtol=2e-4, atol=1e-5)
    assert find_error(iterated.chi, truth) < 2e-4
    # The band gives the same dynamics, with a covariance.
    band = fit_band(arm[1].card, build_band_rows(arm[1], problem.signals, 0.0))
    assert find_error(band.chi, truth) < 1e-3
    assert np.all(np.linalg.eigvalsh(band.covariance) > 0.0)
    # Given knees are kept.
    assert [tuple(knee.threshold for knee in spring.knees) for spring in iterated.elasticity] == [*KNEES]


def test_joint_least_squares_on_energy_rows_recovers_all_parameters(plain, energy_problem):
    thresholds = [data.thresholds for data in energy_problem.springs]
    design, work = energy_problem.design, energy_problem.compute_stop_work(thresholds)
    supplied = energy_problem.supplied
    solution = solve_scaled(np.hstack([design, work]), supplied, rcond=1e-9)
    chi, stiffness = np.split(solution, [design.shape[1]])
    # Turns over stiffnesses and dynamics come there at the rate cos^2 of the smallest principal angle between
    # the two column spaces (von Neumann), and the cost falls.
    left, right = (np.linalg.qr(part / np.linalg.norm(part, axis=0))[0] for part in (design, work))
    rate = min(np.linalg.svd(left.T @ right, compute_uv=False)[0], 1.0) ** 2
    rest, errors, costs = supplied, [], []
    whole = supplied - np.hstack([design, work]) @ solution
    for _ in range(40):
        rest = supplied - right @ (right.T @ (supplied - left @ (left.T @ rest)))
        costs.append(float(np.sum((rest - left @ (left.T @ rest)) ** 2)))
        errors.append(np.sqrt(max(costs[-1] - whole @ whole, 0.0)))
    assert np.all(np.diff(costs) <= 1e-12 * costs[0])
    assert 0.1 < rate < 1.0
    assert np.array(errors[-10:]) / errors[-11:-1] == pytest.approx(rate, rel=1e-3)
    assert find_error(chi, find_truth(plain[1])) < 5e-4
    springs = plain[1].card.elasticity
    true = [[spring.stiffness, *(stop.stiffness for stop in spring.stops)] for spring in springs]
    assert stiffness == pytest.approx(np.concatenate(true), rel=5e-4)


@pytest.mark.parametrize("scale", [1.0, 10.0])
def test_two_steps_on_a_grid_find_clean_dynamics_and_springs_in_six_iterations(arm, scale):
    run = run_arm(*arm, scale=scale, duration=12.0)
    fit = fit_two_step(build(arm[1], [run.recording], ElasticOptions(tolerance=1e-6)))
    assert fit.outcome is Ending.CONVERGED
    assert len(fit.history) <= 6
    assert find_error(fit.chi, find_truth(arm[1])) < 5e-3
    assert np.all(torque_error(fit.elasticity, run) < 1.5e-2)


def test_torque_times_a_number_scales_every_parameter(arm, run):
    options = replace(PLACED, knees=0, knee_torques=None)
    logs = run.recording, replace(run.recording, torque=2.0 * run.recording.torque)
    plain, scaled = (fit_two_step(build(arm[1], [log], options)) for log in logs)
    np.testing.assert_allclose(scaled.chi, 2.0 * plain.chi, rtol=1e-9, atol=1e-12)
    one, two = (
        [[spring.stiffness, *(stop.stiffness for stop in spring.stops)] for spring in fit.elasticity]
        for fit in (plain, scaled)
    )
    for mine, theirs in zip(two, one, strict=True):
        assert mine == pytest.approx([2.0 * value for value in theirs], rel=1e-7)


def test_a_step_makes_the_merit_less_and_no_numbers_end_the_iteration(arm, run, problem, monkeypatch):
    state = TwoStepState(chi=fit_linear_spring(problem).chi, data=problem.springs)
    after = step_two_step(problem, state)
    assert len(after.history) == 1
    assert after.merit < state.merit
    assert np.isfinite(after.history[0].change)
    # Without refinement thresholds stay on their grid.
    plain = build(arm[1], [run.recording], ElasticOptions(refine=False, stops=4, knees=2, iterations=3))
    fit = fit_two_step(plain)
    assert (fit.outcome, len(fit.history)) == (Ending.LIMIT, 3)
    for spring, data in zip(fit.elasticity, plain.springs, strict=True):
        assert {stop.threshold for stop in spring.stops} <= set(data.thresholds)
    broken = replace(after, chi=np.full_like(after.chi, np.nan))
    monkeypatch.setattr(together, "step_two_step", lambda _problem, _state: broken)
    fit = fit_two_step(problem)
    assert (fit.outcome, len(fit.history)) == (Ending.DIVERGED, 1)


def test_without_hysteresis_the_two_steps_are_the_linear_spring(robots_folder):
    straight = (Elasticity(stiffness=500.0), Elasticity(stiffness=130.0))
    robot, library = prepare_arm(robots_folder, springs=straight)
    run = run_arm(robot, library, duration=6.0)
    problem = build(library, [run.recording], ElasticOptions(refine=False))
    linear, iterated = fit_linear_spring(problem), fit_two_step(problem)
    assert np.allclose(iterated.chi, linear.chi, rtol=1e-3, atol=1e-5)
    assert find_error(linear.chi, find_truth(library)) < 1e-3
    for spring, true in zip(linear.elasticity, straight, strict=True):
        assert spring.stiffness == pytest.approx(true.stiffness, rel=1e-3)
    assert np.all(torque_error(iterated.elasticity, run) < 1e-3)


def test_stiff_springs_leave_rotor_and_link_inertia_apart_no_more(robots_folder):
    stiff = (Elasticity(stiffness=5e4), Elasticity(stiffness=1.3e4))
    robot, library = prepare_arm(robots_folder, springs=stiff)
    run = run_arm(robot, library, duration=6.0)
    problem = build(library, [run.recording], ElasticOptions(stops=0, knees=0))
    design = problem.stack_filtered()[0].reshape(-1, len(find_truth(library)))
    names = [entry.name for entry in library.card.beta]
    link, rotor = design[:, names.index("ZZR1")], design[:, len(names)]
    assert link @ rotor > (1.0 - 1e-5) * np.linalg.norm(link) * np.linalg.norm(rotor)
    # Their sum, what a rigid robot has, is found nevertheless.
    chi, truth = fit_linear_spring(problem).chi, find_truth(library)
    first = names.index("ZZR1")
    assert chi[first] + chi[len(names)] == pytest.approx(truth[first] + truth[len(names)], rel=2e-3)
    # An identification from noisy logs says so.
    noisy = run_arm(robot, library, duration=6.0, noisy=True)
    found = identify_elastic(library, [noisy.recording], method="weighted")
    (told,) = (entry.text for entry in found.notices if entry.code == "elastic.poorly-identifiable")
    assert "ZZR1" in told
    assert "IA1" in told
    assert found.condition > 300.0


@pytest.fixture(scope="module")
def apart(arm, run):
    slow = [run_arm(*arm, build_tb(joint), duration=12.0, period=1e-3) for joint in (0, 1)]
    return build(arm[1], [part.recording for part in (run, *slow)], ElasticOptions()), slow


def test_the_independent_procedures_take_each_kind_of_motion_for_its_part(arm, apart, problem):
    both, slow = apart
    assert split_recordings(both.signals) == ((0,), (1, 2))
    motor, encoder = fit_independent(both), fit_independent(both, encoder=True)
    truth = find_truth(arm[1])
    assert find_error(motor.chi, truth) < 1e-3
    assert np.array_equal(motor.chi, encoder.chi)
    for joint, part in enumerate(slow):
        # Gravity alone tells the torsion roughly: no more than the size is right.
        assert torque_error(motor.elasticity, part)[joint] < 0.5
        assert torque_error(encoder.elasticity, part)[joint] < 0.02
    found, true = estimate_virtual_torsion(both, 1, truth)[:, 0], both.signals[1].phi[:, 0]
    assert np.linalg.norm(found - true) < 0.15 * np.linalg.norm(true)
    # One kind of motion serves both.
    assert fit_independent(problem, encoder=True).recordings == (0,)
