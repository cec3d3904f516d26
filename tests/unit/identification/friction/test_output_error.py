"""Output error of one axis: known values are found again, the simpler model is taken where it may be."""

import numpy as np
import pytest

from symid.errors import LogError
from symid.identification.friction.output_error import (
    GIVEN,
    AxisModel,
    AxisRun,
    AxisTrial,
    SearchPlan,
    Window,
    choose_axis_trial,
    compute_output_error,
    compute_window_rmse,
    estimate_axis_start,
    fit_force,
    fit_output_error,
    fit_whole_run,
    simulate_axis,
    split_windows,
    try_axis_model,
)
from symid.joint_models.friction_catalogue import get_law

PERIOD = 2e-3
PLAIN = AxisModel(law=get_law("coulomb-viscous-offset"))
RICH = AxisModel(law=get_law("asymmetric"), terms=("drift",))
TRUTH = {
    PLAIN.name: np.array([95.0, 200.0, 20.0, -3.0]),
    RICH.name: np.array([95.0, 160, 20.0, 240, 21.0, -0.3]),
}


def build_run(model, seconds=8.0):
    """Return a run that begins in steady acceleration, so that the parabola of its start is exact."""
    time = PERIOD * np.arange(round(seconds / PERIOD))
    force = 45.0 * np.sin(1.7 * time + 0.5) + 40.0 * np.sign(np.sin(4.1 * time + 1.0))
    position, _ = simulate_axis(model, TRUTH[model.name], force, PERIOD, (0.02, 0.05, 0.0))
    return AxisRun(position=position, force=force, period=PERIOD)


def whole(run):
    return (Window(first=0, last=len(run.force)),)


@pytest.mark.parametrize("model", [PLAIN, RICH], ids=lambda model: model.name)
def test_known_values_are_found_again(model):
    run = build_run(model)
    plan = SearchPlan(cutoff=60.0, lengths=(0.8,), restarts=0)
    fit = fit_whole_run(model, run, plan, generator=np.random.default_rng(0))
    # The start is read off 20 samples by a parabola: its error is what is left.
    assert np.array(fit.values) == pytest.approx(TRUTH[model.name], rel=2e-2, abs=2e-2)
    assert fit.rmse < 1e-4 < np.ptp(run.position)
    assert fit.converged
    assert fit.names[0] == "M"
    assert fit.evaluations < 40


def test_the_start_of_a_constant_acceleration_is_exact():
    time = PERIOD * np.arange(100)
    run = AxisRun(position=0.1 + 0.2 * time - 0.7 * time**2, force=np.zeros(100), period=PERIOD, begin=3.0)
    position, speed, moment = estimate_axis_start(run, 10)
    last = time[10 + GIVEN - 1]
    assert position == pytest.approx(0.1 + 0.2 * last - 0.7 * last**2, rel=1e-12)
    assert speed == pytest.approx(0.2 - 1.4 * last, rel=1e-9)
    assert moment == pytest.approx(3.0 + last)


def test_the_error_leaves_out_the_given_samples():
    run = build_run(PLAIN)
    windows = split_windows(whole(run), 1000)
    error = compute_output_error(PLAIN, TRUTH[PLAIN.name], run, windows)
    assert len(error) == len(run.force) - GIVEN * len(windows)
    assert compute_window_rmse(PLAIN, TRUTH[PLAIN.name], run, windows) == pytest.approx(
        np.sqrt(np.mean(error**2))
    )


@pytest.mark.parametrize("samples", [10.0, 333.0, 700.0, 5000.0])
def test_windows_cover_each_sample_once(samples):
    given = (Window(first=0, last=1000), Window(first=1500, last=2000))
    windows = split_windows(given, samples)
    covered = [k for window in windows for k in range(window.first, window.last)]
    assert covered == [*range(1000), *range(1500, 2000)]
    assert min(window.last - window.first for window in windows) >= 2 * GIVEN


def test_forces_of_exact_states_give_exact_values():
    run = build_run(PLAIN)
    truth = TRUTH[PLAIN.name]
    _, speed = simulate_axis(PLAIN, truth, run.force, PERIOD, (0.02, 0.05, 0.0))
    offset_and_dry = truth[1] * speed + truth[2] * np.sign(speed) + truth[3]
    states = (run.position, speed, (run.force - offset_and_dry) / truth[0])
    assert fit_force(PLAIN, run, states, whole(run)) == pytest.approx(truth, rel=1e-9)


def test_samples_left_out_do_not_count():
    run = build_run(PLAIN, seconds=2.0)
    values, held = TRUTH[PLAIN.name] * 1.1, Window(first=300, last=500)
    both = compute_output_error(PLAIN, values, run, whole(run))
    seen = compute_output_error(PLAIN, values, run, whole(run), left_out=held)
    assert np.array_equal(seen, np.concatenate([both[: 300 - GIVEN], both[500 - GIVEN :]]))
    spoiled = run.position.copy()
    spoiled[300:500] += 1.0
    other = AxisRun(position=spoiled, force=run.force, period=PERIOD)
    fits = [fit_output_error(PLAIN, each, whole(run), [values], left_out=held) for each in (run, other)]
    assert fits[0] == fits[1]


def test_restarts_never_make_a_fit_worse():
    run = build_run(PLAIN, seconds=4.0)
    fits = [
        fit_whole_run(
            PLAIN,
            run,
            SearchPlan(cutoff=60.0, lengths=(0.8,), restarts=restarts),
            generator=np.random.default_rng(0),
        )
        for restarts in (0, 2)
    ]
    assert fits[1].rmse <= fits[0].rmse
    assert fits[1].evaluations > fits[0].evaluations


def test_blocks_held_back_tell_the_richer_truth():
    run = build_run(RICH)
    plan = SearchPlan(cutoff=60.0, lengths=(0.5, 1.0), restarts=0)
    trials = [try_axis_model(model, run, plan, generator=np.random.default_rng(0)) for model in (PLAIN, RICH)]
    assert all(len(trial.held) == 4 for trial in trials)
    assert trials[1].rmse < 1e-4 < trials[0].rmse
    assert choose_axis_trial(trials).model == RICH


def test_the_fewest_values_within_one_standard_error_are_taken():
    def build(model, *held):
        return AxisTrial(model=model, held=held)

    rich, plain = build(RICH, 1.0, 2.0, 3.0), build(PLAIN, 1.5, 2.5, 3.0)
    assert rich.rmse == pytest.approx(np.sqrt(14.0 / 3.0))
    assert rich.deviation == pytest.approx(np.std([1.0, 4.0, 9.0], ddof=1) / np.sqrt(3.0))
    assert choose_axis_trial([rich, plain]) is plain
    assert choose_axis_trial([rich, build(PLAIN, 3.0, 3.0, 4.0)]) is rich
    better = build(PLAIN, 1.4, 2.4, 3.0)
    assert choose_axis_trial([rich, plain, better]) is better


def test_a_simulation_that_leaves_all_bounds_stays_a_number():
    run = build_run(PLAIN, seconds=1.0)
    error = compute_output_error(PLAIN, np.array([1e-3, -1e6, 0.0, 0.0]), run, whole(run))
    assert np.all(np.isfinite(error))


@pytest.mark.parametrize(
    ("position", "force"),
    [(np.zeros(50), np.zeros(49)), (np.zeros(10), np.zeros(10)), (np.full(50, np.nan), np.zeros(50))],
)
def test_runs_that_cannot_be(position, force):
    with pytest.raises(LogError) as caught:
        AxisRun(position=position, force=force, period=PERIOD)
    assert caught.value.notices[0].code == "friction.axis-run"


def test_windows_that_are_too_short():
    run = build_run(PLAIN, seconds=1.0)
    with pytest.raises(LogError, match="40 samples"):
        fit_output_error(PLAIN, run, [Window(first=0, last=30)], [TRUTH[PLAIN.name]])
