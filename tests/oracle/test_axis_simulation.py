"""Output error of one axis: known values are found again, the simpler model is taken where it may be."""

import mpmath
import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.integrate import solve_ivp

from benchmarks.axis_simulation import (
    GIVEN,
    AxisModel,
    AxisRun,
    SearchPlan,
    Window,
    build_axis_samples,
    choose_axis_trial,
    compute_force_columns,
    compute_output_error,
    compute_relative_residual,
    compute_window_rmse,
    fit_output_error,
    fit_whole_run,
    simulate_axis,
    split_windows,
    try_axis_model,
)
from symid.identification.friction.estimators import fit_friction
from symid.joint_models.friction_catalogue import get_law
from symid.joint_models.friction_law import compute_friction_torque
from symid.logs.recording import Recording
from symid.robot.description import Decimation, Processing

SAMPLING = 2e-3
PLAIN = AxisModel(law=get_law("coulomb-viscous-offset"))
RICH = AxisModel(law=get_law("asymmetric"), terms=("drift",))
TRUTH = {
    PLAIN.name: np.array([95.0, 200.0, 20.0, -3.0]),
    RICH.name: np.array([95.0, 160, 20.0, 240, 21.0, -0.3]),
}


def build_run(model, seconds=8.0):
    """Return a run that begins in steady acceleration, so that the parabola of its start is exact."""
    time = SAMPLING * np.arange(round(seconds / SAMPLING))
    force = 45.0 * np.sin(1.7 * time + 0.5) + 40.0 * np.sign(np.sin(4.1 * time + 1.0))
    position, _ = simulate_axis(model, TRUTH[model.name], force, SAMPLING, (0.02, 0.05, 0.0))
    return AxisRun(position=position, force=force, period=SAMPLING, begin=0.0)


def whole(run):
    return (Window(first=0, last=len(run.force)),)


def build_plan(*lengths, restarts=0):
    return SearchPlan(cutoff=60.0, lengths=lengths, restarts=restarts)


@pytest.mark.parametrize("model", [PLAIN, RICH], ids=lambda model: model.name)
def test_known_values_are_found_again(model):
    run = build_run(model)
    fit = fit_whole_run(model, run, build_plan(0.8), generator=np.random.default_rng(0))
    # The start is read off 20 samples by a parabola: its error is what is left.
    assert np.array(fit.values) == pytest.approx(TRUTH[model.name], rel=2e-2, abs=2e-2)
    assert fit.rmse < 1e-4 < np.ptp(run.position)
    assert fit.converged
    assert fit.names[0] == "M"
    assert fit.evaluations < 40


def test_the_error_leaves_out_the_given_samples():
    run = build_run(PLAIN)
    windows = split_windows(whole(run), 1000)
    error = compute_output_error(PLAIN, TRUTH[PLAIN.name], run, windows)
    assert len(error) == len(run.force) - GIVEN * len(windows)
    error = compute_output_error(PLAIN, TRUTH[PLAIN.name], run, whole(run))
    rmse = compute_window_rmse(PLAIN, TRUTH[PLAIN.name], run)
    assert rmse == pytest.approx(np.sqrt(np.mean(error**2)))
    # A simulation that leaves all bounds stays a number.
    error = compute_output_error(PLAIN, np.array([1e-3, -1e6, 0.0, 0.0]), run, whole(run))
    assert np.all(np.isfinite(error))


def test_samples_left_out_do_not_count():
    run = build_run(PLAIN, seconds=2.0)
    values, held = TRUTH[PLAIN.name] * 1.1, Window(first=300, last=500)
    both = compute_output_error(PLAIN, values, run, whole(run))
    seen = compute_output_error(PLAIN, values, run, whole(run), left_out=held)
    assert np.array_equal(seen, np.concatenate([both[: 300 - GIVEN], both[500 - GIVEN :]]))
    spoiled = run.position.copy()
    spoiled[300:500] += 1.0
    other = AxisRun(position=spoiled, force=run.force, period=SAMPLING, begin=0.0)
    fits = [fit_output_error(PLAIN, each, whole(run), [values], left_out=held) for each in (run, other)]
    assert fits[0] == fits[1]


def test_blocks_held_back_tell_the_richer_truth():
    run = build_run(RICH)
    plan = build_plan(0.5, 1.0)
    trials = [try_axis_model(model, run, plan, generator=np.random.default_rng(0)) for model in (PLAIN, RICH)]
    # Six blocks, each in four parts.
    assert all(len(trial.held) == 24 for trial in trials)
    assert trials[1].rmse < 1e-4 < trials[0].rmse
    assert choose_axis_trial(trials).model == RICH


PROCESSING = Processing(
    filter_cutoff=100.0,
    filter_torque=False,
    drop_first=50,
    decimation=Decimation(factor=10, order=8, ripple_db=0.05, band=0.8),
)


def build_recording(phase):
    time = 2.0 + 1e-3 * np.arange(6000)
    # Strong enough that the axis hardly rests: at rest the force tells nothing of a law.
    force = 250.0 * np.sin(4.0 * time + phase) + 60.0 * np.sin(1.3 * time)
    position, _ = simulate_axis(RICH, [95.0, 160.0, 20.0, 240.0, 21.0, -0.2], force, 1e-3, (0.0, 0.0, 2.0))
    return Recording(time=time, position=position[:, None], torque=force[:, None], source="simulated")


def test_the_law_that_made_the_motion_leaves_least():
    fitted, unseen = (
        build_axis_samples(build_recording(phase), PROCESSING, terms=("drift",)) for phase in (1.0, 0.6)
    )
    assert fitted.extra_names == ("M", "drift")
    laws = [get_law(name) for name in ("coulomb-viscous-offset", "asymmetric")]
    estimates = [fit_friction(fitted, law) for law in laws]
    for samples in (fitted, unseen):
        plain, rich = map(compute_relative_residual, (samples, samples), laws, estimates)
        assert rich < 0.5 * plain
    # What is left comes from the filter, which blurs each change of the direction.
    assert estimates[1].other[0] == pytest.approx(95.0, rel=0.01)
    assert estimates[1].other[1] == pytest.approx(-0.2, abs=0.05)


PERIOD = 1e-3
VALUES = np.array([95.0, 200.0, 20.0, -3.0])
APLAIN = AxisModel(law=get_law("asymmetric"))


def move_exactly(axis, force, speed, time):
    """Return displacement and speed after `time` in one direction, in 50 digits; axis: mass, viscous, dry."""
    with mpmath.workdps(50):
        m, f, c, u, v, t = (mpmath.mpf(value) for value in (*axis, force, speed, time))
        final = (u - c) / f
        fall = mpmath.exp(-f * t / m)
        return final * t + (v - final) * m / f * (1 - fall), final + (v - final) * fall


def find_rest_exactly(axis, force, speed):
    with mpmath.workdps(50):
        m, f, c, u, v = (mpmath.mpf(value) for value in (*axis, force, speed))
        final = (u - c) / f
        return m / f * mpmath.log((final - v) / final)


def test_rest_within_a_step_then_motion_the_other_way_is_exact():
    values = np.array([95.0, 160.0, 20.0, 240.0, 21.0])
    force = np.full(601, -80.0)
    rest = find_rest_exactly((95.0, 160.0, 20.0), -80.0, 0.12)
    assert 0.0 < rest / PERIOD % 1 < 1.0
    way_out, stopped = move_exactly((95.0, 160.0, 20.0), -80.0, 0.12, rest)
    assert abs(stopped) < 1e-30
    position, speed = simulate_axis(APLAIN, values, force, PERIOD, (0.0, 0.12, 0.0))
    way_back, final = move_exactly((95.0, 240.0, -21.0), -80.0, 0.0, 600 * mpmath.mpf(PERIOD) - rest)
    assert position[-1] == pytest.approx(float(way_out + way_back), abs=1e-14)
    assert speed[-1] == pytest.approx(float(final), rel=1e-12)


def test_the_axis_comes_to_rest_and_stays():
    position, speed = simulate_axis(PLAIN, VALUES, np.full(3001, 5.0), PERIOD, (0.0, 0.2, 0.0))
    rest = find_rest_exactly((95.0, 200.0, 17.0), 5.0, 0.2)
    way, _ = move_exactly((95.0, 200.0, 17.0), 5.0, 0.2, rest)
    stopped = int(np.ceil(float(rest) / PERIOD))
    assert np.all(speed[stopped:] == 0.0)
    assert np.all(position[stopped:] == position[stopped])
    assert position[-1] == pytest.approx(float(way), rel=1e-13)
    # One sample is the start.
    call = (PLAIN, np.ones(4), np.ones(1), PERIOD, (0.3, 0.2, 0.0))
    assert [part.tolist() for part in simulate_axis(*call)] == [[0.3], [0.2]]
    assert simulate_axis(*call, rates=True)[2:].tolist() == [[0.0]] * 8


@pytest.mark.parametrize(("force", "direction"), [(16.9, 0), (17.1, 1), (-22.9, 0), (-23.1, -1)])
def test_breaking_away_takes_the_force_of_that_side(force, direction):
    _, speed = simulate_axis(PLAIN, VALUES, np.full(11, force), PERIOD, (0.0, 0.0, 0.0))
    assert np.sign(speed[-1]) == direction


def find_reference(model, values, force, start):
    """Return positions at the samples by an adaptive integrator, restarted at each sample and at rest."""
    law, linear = model.law, len(model.law.linear)
    own, beside = values[1 : 1 + linear], values[1 + linear : 1 + linear + len(model.terms)]
    shape = values[1 + linear + len(model.terms) :]

    def brake(time, place, speed, drive):
        inputs = {"velocity": speed, "position": place, "time": time, "load": drive}
        arrays = {name: np.array([value]) for name, value in inputs.items()}
        total = compute_friction_torque(law, arrays, own, shape)[0]
        return total + beside @ compute_force_columns(model, arrays, shape)[0, linear:]

    place, speed, time = start
    found = [place]
    for k, drive in enumerate(force[:-1]):
        now, end = time + k * PERIOD, time + (k + 1) * PERIOD
        while now < end:
            if speed == 0.0:
                if drive > brake(now, place, 1e-14, drive):
                    side = 1.0
                elif drive < brake(now, place, -1e-14, drive):
                    side = -1.0
                else:
                    break
            else:
                side = np.sign(speed)

            def slope(t, y, drive=drive, side=side):
                near = side * max(side * y[1], 1e-14)
                return [y[1], (drive - brake(t, y[0], near, drive)) / values[0]]

            def crossing(_t, y, side=side):
                return side * y[1]

            crossing.terminal, crossing.direction = True, -1.0
            events = None if speed == 0.0 else crossing
            run = solve_ivp(
                slope, (now, end), [place, speed], method="DOP853", rtol=1e-11, atol=1e-15, events=events
            )
            now, place, speed = run.t[-1], run.y[0, -1], run.y[1, -1]
            if run.status == 1:
                speed = 0.0
        found.append(place)
    return np.array(found)


CASES = {
    "stribeck": ([95.0, 200.0, 20.0, 6.0, -3.0, 0.03], ("offset",)),
    "asymmetric-stribeck": ([95.0, 160.0, 20.0, 230.0, 21.0, -3.5, 0.029], ()),
    "stribeck+cubic": ([95.0, 150.0, 20.0, -3.0, 100.0, 900.0, 0.03], ()),
    "load-dependent": ([95.0, 180.0, 15.0, 0.1, -3.0], ("offset",)),
    "coulomb-viscous": (
        [95.0, 190.0, 20.0, -3.0, -2.0, 60.0, -8.0, 30.0],
        ("offset", "drift", "spring", "slope", "bend"),
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_other_laws_meet_an_adaptive_integrator_and_rates_are_slopes(name):
    numbers, terms = CASES[name]
    model, values = AxisModel(law=get_law(name), terms=terms), np.array(numbers)
    force = 90.0 * np.sin(2.0 * np.pi * 2.5 * PERIOD * np.arange(401) + 0.3)
    start = (0.05, -0.01, 0.7)
    expected = find_reference(model, values, force, start)
    way = np.ptp(expected)
    once, _ = simulate_axis(model, values, force, PERIOD, start)
    fine = simulate_axis(model, values, np.repeat(force, 8), PERIOD / 8, start)[0, ::8]
    assert np.max(np.abs(once - expected)) < 1e-5 * way
    assert np.max(np.abs(fine - expected)) < 2e-7 * way
    states = simulate_axis(model, values, force, PERIOD, start, rates=True)
    assert np.array_equal(states[0], once)
    rates = states[2 : 2 + len(values)].T
    for k, value in enumerate(values):
        move = 1e-5 * abs(value) * np.eye(len(values))[k]
        ends = [simulate_axis(model, values + sign * move, force, PERIOD, start)[0] for sign in (1.0, -1.0)]
        slope = (ends[0] - ends[1]) / (2.0 * move[k])
        assert np.max(np.abs(slope - rates[:, k])) < 1e-6 * np.max(np.abs(slope)), model.parameters[k]


def test_smooth_dry_friction_is_stable_and_tends_to_the_plain_one():
    force = 80.0 * np.sin(6.0 * PERIOD * np.arange(2001))

    def simulate(smoothing, n):
        model = AxisModel(law=get_law("coulomb-viscous", smoothing=smoothing))
        return simulate_axis(model, VALUES[:3], np.repeat(force, n), PERIOD / n, (0.0,) * 3)[0, ::n]

    plain = simulate(0.0, 1)
    errors = [np.max(np.abs(simulate(size, 20) - plain)) for size in (1e-2, 1e-3, 1e-4)]
    # In proportion to the smoothing speed, but for the logarithm of the time that leaving rest takes.
    assert errors[1] < errors[0] / 5.0
    assert errors[2] < errors[1] / 5.0
    assert errors[2] < 3e-3 * np.ptp(plain)


@given(
    speed=st.floats(-0.5, 0.5), numbers=st.tuples(*[st.floats(0.0, 300.0)] * 2, *[st.floats(0.1, 40.0)] * 2)
)
def test_without_force_the_axis_only_slows_down(speed, numbers):
    up, down, dry_up, dry_down = numbers
    values = np.array([50.0, up, dry_up, down, dry_down])
    _, found = simulate_axis(APLAIN, values, np.zeros(200), PERIOD, (0.0, speed, 0.0))
    assert np.all(np.diff(np.abs(found)) <= 0.0)
    assert np.all(found * speed >= 0.0)
