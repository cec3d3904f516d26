"""Output error of one axis: known values are found again, the simpler model is taken where it may be."""

import numpy as np
import pytest

from symid.errors import LogError
from symid.identification.friction.estimators import fit_friction
from symid.identification.friction.output_error import (
    GIVEN,
    AxisModel,
    AxisRun,
    AxisTrial,
    SearchPlan,
    Window,
    build_axis_run,
    build_axis_samples,
    choose_axis_trial,
    compute_output_error,
    compute_window_rmse,
    fit_output_error,
    fit_whole_run,
    simulate_axis,
    split_windows,
    try_axis_model,
)
from symid.identification.friction.selection import compute_relative_residual
from symid.joint_models.friction_catalogue import get_law
from symid.logs.recording import Recording
from symid.robot.description import Decimation, Processing
from tests.refusals import raises

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
    rmse = compute_window_rmse(PLAIN, TRUTH[PLAIN.name], run, windows)
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
    other = AxisRun(position=spoiled, force=run.force, period=PERIOD)
    fits = [fit_output_error(PLAIN, each, whole(run), [values], left_out=held) for each in (run, other)]
    assert fits[0] == fits[1]


def test_blocks_held_back_tell_the_richer_truth():
    run = build_run(RICH)
    plan = build_plan(0.5, 1.0)
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


@pytest.mark.parametrize(
    ("position", "force"),
    [(np.zeros(50), np.zeros(49)), (np.zeros(10), np.zeros(10)), (np.full(50, np.nan), np.zeros(50))],
)
def test_runs_that_cannot_be(position, force):
    with raises(LogError, "friction.axis-run"):
        AxisRun(position=position, force=force, period=PERIOD)
    # Windows that are too short.
    with pytest.raises(LogError, match="40 samples"):
        fit_output_error(PLAIN, build_run(PLAIN, 1.0), [Window(first=0, last=30)], [TRUTH[PLAIN.name]])


# The ladder of laws: the law that made the motion leaves least of it.
PROCESSING = Processing(
    filter_order=4,
    filter_cutoff=100.0,
    filter_torque=False,
    drop_first=50,
    decimation=Decimation(factor=10, order=8, ripple_db=0.05, band=0.8),
)


def build_recording(phase, joints=1):
    time = 2.0 + 1e-3 * np.arange(6000)
    model = AxisModel(law=get_law("asymmetric"), terms=("drift",))
    values = np.array([95.0, 160.0, 20.0, 240.0, 21.0, -0.2])
    # Strong enough that the axis hardly rests: at rest the force tells nothing of a law.
    force = 250.0 * np.sin(4.0 * time + phase) + 60.0 * np.sin(1.3 * time)
    position, _ = simulate_axis(model, values, force, 1e-3, (0.0, 0.0, 2.0))
    return Recording(
        time=time,
        position=np.column_stack([position] * joints),
        torque=np.column_stack([force] * joints),
        source="simulated",
    )


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


def test_a_run_is_the_recording_of_one_joint():
    recording = build_recording(0.0)
    run = build_axis_run(recording)
    assert np.array_equal(run.position, recording.position[:, 0])
    assert np.array_equal(run.force, recording.torque[:, 0])
    assert (run.period, run.begin) == (pytest.approx(1e-3), 2.0)
    two = build_recording(0.0, joints=2)
    for build in (build_axis_run, lambda entry: build_axis_samples(entry, PROCESSING)):
        with raises(LogError, "log.joints", match=r"\b2 joints.* 1$"):
            build(two)
