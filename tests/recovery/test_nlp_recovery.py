"""Dynamics, friction and hysteresis of a simulated arm in one problem: recovered, with proof."""

import re
from dataclasses import replace

import numpy as np
import pytest

from symid.codegen.cache import prepare_library
from symid.errors import UsageError
from symid.excitation.trajectories import build_tc
from symid.identification.elastic.elimination import fit_elimination
from symid.identification.elastic.methods import AUTOMATIC_METHODS
from symid.identification.elastic.nlp import (
    compute_certificate,
    compute_place_slopes,
    compute_scales,
    fit_nlp,
    list_places,
    optimise_nlp,
    prepare_setting,
)
from symid.identification.elastic.options import ElasticOptions, NlpOptions
from symid.identification.elastic.regression import build_elastic_problem
from symid.identification.elastic.together import fit_two_step
from symid.ipopt import Ending
from symid.joint_models.prandtl_ishlinskii import compute_hysteresis_torque, compute_spring_work
from symid.robot.toml_reader import read_robot
from symid.study.elastic_methods import get_true_parameters
from tests.recovery.elastic_runs import KNEES, STOPS, build, find_error, find_truth, identify_elastic, run_arm
from tests.refusals import raises

TRUE_PLACES = {"thresholds": STOPS, "knee_torques": KNEES}


@pytest.fixture(scope="module")
def clean(arm):
    run = run_arm(*arm, build_tc(), duration=6.0, period=5e-4)
    return build(arm[1], [run.recording], ElasticOptions(**TRUE_PLACES))


@pytest.fixture(scope="module")
def noisy_recording(arm):
    return run_arm(*arm, build_tc(), noisy=True, duration=None).recording


@pytest.fixture(scope="module")
def noisy(arm, noisy_recording):
    return build(arm[1], [noisy_recording], ElasticOptions())


@pytest.fixture(scope="module")
def noisy_fit(noisy):
    return fit_nlp(noisy)


@pytest.fixture(scope="module")
def grid_problem(noisy):
    """Return the noisy problem with stops and knees that stay on their grids."""
    return replace(noisy, options=replace(noisy.options, refine=False))


@pytest.fixture(scope="module")
def grid_fit(grid_problem):
    return fit_nlp(grid_problem)


def find_errors(arm, problem, fit):
    """Return the largest relative error of the dynamic parameters, and that of each joint's torque.

    The springs are compared on the torsion of the recording.
    """
    springs = []
    for joint, pair in enumerate(zip(arm[1].card.elasticity, fit.elasticity, strict=True)):
        true, found = (compute_hysteresis_torque(spring, problem.signals[0].phi[:, joint]) for spring in pair)
        springs.append(np.linalg.norm(found - true) / np.linalg.norm(true))
    return find_error(fit.chi, find_truth(arm[1])), np.array(springs)


def draw_start(layout, x, generator):
    """Return random unknowns (x,) between their bounds, around the size of the given ones but not close.

    Dynamic parameters between half and twice the given ones, springs likewise with random shares of their
    stops, slopes between 0.4 and 2.5, Stribeck velocities over their range.
    """
    start, draw = np.array(x), generator.uniform
    start[layout.dynamics] *= 2.0 ** draw(-1.0, 1.0, size=layout.dynamics.stop)
    for spring in layout.springs:
        shares = generator.dirichlet(np.ones(len(spring.thresholds) + 1))
        start[spring.weights] = shares * np.sum(x[spring.weights]) * 2.0 ** draw(-1.0, 1.0)
        start[spring.slopes] = 2.5 ** draw(-1.0, 1.0, size=len(spring.offset))
    start[layout.speed] = np.exp(draw(np.log(layout.lower[layout.speed]), np.log(layout.upper[layout.speed])))
    largest = float(np.max(np.abs(x[layout.dynamics]), initial=0.0))
    start[layout.excess] = draw(0.0, largest, size=layout.excess.stop - layout.excess.start)
    return np.clip(start, layout.lower, layout.upper)


def optimise_from_many(fit, count, seed, options=None):
    """Return `count` random feasible starts of the last problem of `fit`, and the runs from there."""
    generator = np.random.default_rng(seed)
    starts = [draw_start(fit.cost.layout, fit.run.x, generator) for _ in range(count)]
    scales = compute_scales(fit.cost, fit.run.x)
    return [(start, optimise_nlp(fit.cost, start, scales, options or NlpOptions())) for start in starts]


@pytest.mark.parametrize("rows", [("energy",), ("filtered",), ("momentum",), ("energy", "momentum")])
def test_without_noise_all_rows_give_the_truth(arm, clean, rows):
    result = fit_nlp(clean, NlpOptions(rows=rows))
    parameters, springs = find_errors(arm, clean, result.fit)
    assert result.fit.outcome is Ending.CONVERGED
    assert parameters < 2e-4
    assert np.all(springs < 2e-4)
    certificate = result.run.certificate
    assert certificate.kkt < 1e-8
    assert certificate.curvature > 0.0
    assert certificate.active == ()


def test_the_work_of_the_knees_is_that_of_the_exact_formula(arm, clean):
    """Step means stand for the work of the outer function between samples."""
    result, rows = fit_nlp(clean, NlpOptions(rows=("energy",), rounds=0)), clean.energy[0]
    (block,) = result.cost.recordings[0].blocks
    x, layout, exact = np.array(result.run.x), result.cost.layout, np.zeros(len(block.values))
    pairs = zip(arm[1].card.elasticity, layout.springs, clean.signals[0].phi.T, strict=True)
    for spring, place, phi in pairs:
        x[place.weights] = [spring.stiffness, *(stop.stiffness for stop in spring.stops)]
        x[place.slopes] = 1.0 + spring.knees[0].slope
        exact += np.diff(compute_spring_work(spring, phi)[rows.ends])
    expected = block.values - block.matrix @ x[layout.dynamics] - exact
    np.testing.assert_allclose(result.cost.compute_state(x).residuals[0], expected, atol=2e-8)


@pytest.mark.parametrize(("stops", "knees"), [(0, 4), (8, 0), (0, 0)])
def test_no_stops_and_no_knees_are_none(arm, stops, knees):
    log = run_arm(*arm, build_tc(), noisy=True).recording
    problem = build(arm[1], [log], ElasticOptions(stops=stops, knees=knees))
    for fit in (fit_nlp(problem).fit, fit_two_step(problem), fit_elimination(problem)):
        for spring in fit.elasticity:
            assert (not spring.stops or stops) and (not spring.knees or knees)  # noqa: PT018


def test_gradient_and_hessian_are_exact(noisy):
    options = NlpOptions(rows=("energy", "filtered", "momentum"), stribeck=True, smoothing=0.01, rounds=0)
    first = fit_nlp(noisy, replace(options, iterations=1))
    cost, layout = first.cost, first.cost.layout
    x = draw_start(layout, first.run.x, np.random.default_rng(0))
    x[layout.speed], x[layout.excess] = (0.2, 0.4), (0.3, 0.2)
    state = cost.compute_state(x)
    scales = 1.0 / np.sqrt(np.maximum(np.diag(cost.compute_gauss_newton(state)), 1e-12))
    size, square = 1e-4 * np.maximum(1e-2, np.abs(x)), scales * scales[:, None]
    gradient, hessian = cost.compute_gradient(state) * scales, cost.compute_hessian(state, x) * square
    ends = [[cost.compute_state(x + sign * step) for sign in (-1.0, 1.0)] for step in np.diag(size)]
    values, slopes = (
        np.array([compute(after) - compute(before) for before, after in ends])
        for compute in (cost.compute_value, cost.compute_gradient)
    )
    np.testing.assert_allclose(values / (2 * size) * scales, gradient, atol=1e-4 * np.abs(gradient).max())
    difference = slopes / (2 * size)[:, None] * square - hessian
    assert np.abs(difference).max() < 1e-3 * np.abs(hessian).max()
    # The second term matters: without it the same comparison fails.
    bend = hessian - cost.compute_gauss_newton(state) * square
    assert np.abs(bend).max() > 100.0 * np.abs(difference).max()


def test_stops_and_knees_where_the_data_put_them(arm, noisy, noisy_fit):
    result = noisy_fit
    parameters, springs = find_errors(arm, noisy, result.fit)
    assert result.run.outcome.converged
    assert parameters < 0.02
    assert np.all(springs < 0.03)
    assert result.run.certificate.kkt < 1e-8
    # The rounds end where nothing moves any more.
    assert len(result.fit.history) < NlpOptions().rounds + 1
    again = fit_nlp(noisy, start=result.fit).fit
    deviations = np.sqrt(np.diag(result.fit.covariance))
    assert np.all(np.abs(again.chi - result.fit.chi) < 0.05 * deviations)


def test_places_move_to_the_best_ones_and_given_ones_stay(arm, noisy, noisy_fit, grid_problem):
    """Steps of Gauss and Newton find the true places again from those that were put aside."""
    aside = tuple(
        replace(
            spring,
            stops=tuple(replace(stop, threshold=0.96 * stop.threshold) for stop in spring.stops),
            knees=tuple(replace(knee, threshold=0.95 * knee.threshold) for knee in spring.knees),
        )
        for spring in arm[1].card.elasticity
    )
    away = replace(noisy_fit.fit, elasticity=aside)
    found = fit_nlp(noisy, NlpOptions(rounds=4), away)
    for spring, true in zip(found.fit.elasticity, arm[1].card.elasticity, strict=True):
        # The largest stop of either joint hardly slips in this recording, or does not.
        mine, theirs = ([part.threshold for part in (*one.stops[:2], *one.knees)] for one in (spring, true))
        assert mine == pytest.approx(theirs, rel=0.02)
    kept = fit_nlp(grid_problem, NlpOptions(rounds=4), away)
    for spring, places in zip(kept.fit.elasticity, aside, strict=True):
        expected = [stop.threshold for stop in places.stops]
        assert [stop.threshold for stop in spring.stops] == expected[: len(spring.stops)]
        assert [entry.threshold for entry in spring.knees] == [entry.threshold for entry in places.knees]
    assert found.run.objective < kept.run.objective
    # Places that the data chose add to the doubt of what they trade with.
    known = found.cost.compute_covariance(found.run.x)
    assert np.all(np.diag(found.fit.covariance) > 0.9 * np.diag(known))
    assert np.max(np.diag(found.fit.covariance) / np.diag(known)) > 2.0
    np.testing.assert_allclose(kept.fit.covariance, kept.cost.compute_covariance(kept.run.x))


def test_slopes_by_places_are_those_of_the_problem(noisy, noisy_fit):
    """Against the same problem with the places moved by hand, ten times as far."""
    result = noisy_fit
    setting = prepare_setting(noisy, NlpOptions(), result.fit)
    cost = replace(result.cost, recordings=setting.recordings, layout=setting.lay_out(()))
    places = list_places(setting, cost, result.run.x)
    springs = result.fit.elasticity
    assert len(places) == sum(len(spring.stops) + len(spring.knees) for spring in springs) >= 6 + 4
    slopes = compute_place_slopes(setting, cost, result.run.x, places)
    before = cost.compute_state(result.run.x).residuals
    for place in (places[0], places[-1]):
        step = 1e-3 * (setting.knees if place.knee else setting.thresholds)[place.joint][place.index]
        moved = setting.shift([place], np.array([step]))
        trial = replace(cost, recordings=moved.recordings, layout=moved.lay_out(()))
        for now, then, slope in zip(
            before, trial.compute_state(result.run.x).residuals, slopes[places.index(place)], strict=True
        ):
            assert np.linalg.norm((then - now) / step - slope) <= 0.02 * np.linalg.norm(slope)


def test_a_file_without_rotor_inertias_is_identified_by_every_method(
    noisy, noisy_recording, noisy_fit, robots_folder, tmp_path
):
    text = (robots_folder / "two_link_elastic.toml").read_text()
    file = tmp_path / "two_link_elastic.toml"
    file.write_text(re.sub(r"(?m)^\[joint.drive\]\n(.*\n){2}", "", text))
    library = prepare_library(read_robot(file))
    assert library.card.rotors == ()
    problem = build_elastic_problem(library, noisy.signals, noisy.options)
    np.testing.assert_allclose(fit_nlp(problem).fit.chi, noisy_fit.fit.chi, rtol=1e-6)
    found = identify_elastic(library, [noisy_recording], ElasticOptions())
    values = {entry.name: entry.value for entry in found.parameters}
    assert [values["IA1"], values["IA2"]] == pytest.approx([0.25, 0.05], rel=0.02)
    assert {trial.method for trial in found.trials} == set(AUTOMATIC_METHODS)
    with raises(UsageError, "usage.study-robot", match="IA1, IA2"):
        get_true_parameters(library.card)


def test_a_grid_over_noisy_data_stays_bounded_and_names_what_holds(arm, noisy, grid_fit):
    result = grid_fit
    parameters, springs = find_errors(arm, noisy, result.fit)
    assert result.run.outcome.converged
    assert parameters < 0.05
    assert np.all(springs < 0.1)
    layout = result.cost.layout
    for spring, place in zip(result.fit.elasticity, layout.springs, strict=True):
        weights = [spring.stiffness, *(stop.stiffness for stop in spring.stops)]
        assert 0.0 < max(weights) < layout.upper[place.weights.start]
    certificate = result.run.certificate
    assert certificate.kkt < 1e-8
    assert certificate.active
    for name, value in certificate.active:
        place = layout.names.index(name)
        assert value in (pytest.approx(layout.lower[place]), pytest.approx(layout.upper[place]))


def test_twenty_random_starts_end_at_one_optimum(noisy_fit, grid_fit):
    result, least = noisy_fit, noisy_fit.run.objective
    for start, run in optimise_from_many(result, 20, 5):
        assert run.outcome.converged
        assert run.objective == pytest.approx(least, rel=1e-6)
        assert result.cost.compute_value(result.cost.compute_state(start)) > 2.0 * run.objective
        assert run.certificate.kkt < 1e-6
    # On a grid every start is accounted for.
    assert all(run.reason for _, run in optimise_from_many(grid_fit, 4, 5))


def test_the_gauss_newton_hessian_ends_at_the_same_optimum(noisy_fit):
    exact = noisy_fit
    start, scales = exact.run.x * 1.05, compute_scales(exact.cost, exact.run.x)
    other = optimise_nlp(exact.cost, start, scales, NlpOptions(hessian="gauss-newton"))
    assert other.outcome.converged
    assert other.objective == pytest.approx(exact.run.objective, rel=1e-6)
    # A point off the optimum has no certificate.
    x = np.array(exact.run.x)
    x[0] *= 1.01
    assert compute_certificate(exact.cost, x, scales).kkt > 1e-3


def test_a_run_that_does_not_converge_says_so(noisy):
    # Later rounds about other places begin where the one before ended, and may converge.
    once = replace(noisy, options=replace(noisy.options, refine=False))
    result = fit_nlp(once, NlpOptions(iterations=2))
    assert result.fit.outcome is Ending.LIMIT
    assert not result.run.outcome.converged
    assert "Maximum_Iterations_Exceeded" in result.run.reason
    assert "elastic.nlp-not-converged" in {notice.code for notice in result.fit.notices}
    ((_, run),) = optimise_from_many(result, 1, 1, NlpOptions(iterations=1))
    assert not run.outcome.converged


def test_knees_and_stops_that_are_not_reached_are_named(noisy):
    options = replace(noisy.options, refine=False, knee_torques=((-40.0, 3.0), (-1.2, 1.2)))
    grids = np.array([0.002, 0.5]), np.array([0.003])
    springs = tuple(data.rebuild(grid) for data, grid in zip(noisy.springs, grids, strict=True))
    problem = replace(noisy, options=options, springs=springs)
    result = fit_nlp(problem, NlpOptions(rows=("momentum",)))
    (text,) = (one.text for one in result.fit.notices if one.code == "elastic.nlp-undetermined")
    assert all(name in text for name in ("slope beyond -40 of joint 1", "k2 of joint 1"))
    assert [stop.threshold for stop in result.fit.elasticity[0].stops] == [0.002]
    assert all(knee.threshold > -40.0 for knee in result.fit.elasticity[0].knees)
    # A limit that holds a weight is said.
    held = fit_nlp(noisy, NlpOptions(rows=("momentum",), slopes=(0.99, 1.01)))
    assert "elastic.nlp-limit" in {notice.code for notice in held.fit.notices}


def test_odd_springs_and_their_own_start(grid_problem):
    first = fit_nlp(grid_problem, NlpOptions(odd=True))
    for spring in first.fit.elasticity:
        rising = [(knee.threshold, knee.slope) for knee in spring.knees if knee.threshold > 0]
        falling = [(-knee.threshold, knee.slope) for knee in reversed(spring.knees) if knee.threshold < 0]
        np.testing.assert_allclose(rising, falling, rtol=1e-12)
    # From its own result the same optimum is found, with the stops that were left.
    again = fit_nlp(grid_problem, NlpOptions(odd=True), first.fit)
    assert again.run.outcome.converged
    np.testing.assert_allclose(again.fit.chi, first.fit.chi, rtol=0.02, atol=0.01)


def test_stribeck_friction_is_found_where_there_is_some(arm, clean):
    """The motors' torque with Gaussian friction added gives its parameters back."""
    signals = clean.signals[0]
    excess, speed = np.array([0.7, 0.3]), np.array([0.15, 0.25])
    added = excess * np.exp(-((signals.dtheta / speed) ** 2)) * np.tanh(signals.dtheta / 0.01)
    held = np.vstack([(added[1:] + added[:-1]) / 2.0, added[-1:]])
    problem = build_elastic_problem(arm[1], [replace(signals, tau=signals.tau + held)], clean.options)
    options = NlpOptions(rows=("momentum",), stribeck=True, smoothing=0.01, speeds=(0.01, 2.0))
    result = fit_nlp(problem, options)
    layout, x = result.cost.layout, result.run.x
    assert result.run.outcome.converged
    np.testing.assert_allclose(x[layout.excess], excess, rtol=5e-3)
    np.testing.assert_allclose(x[layout.speed], speed, rtol=5e-3)
    assert find_errors(arm, clean, result.fit)[0] < 1e-3
