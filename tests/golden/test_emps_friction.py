"""Friction of the EMPS axis: the ladder of laws, and the axis simulated from its force alone.

Janot, Gautier, Brunot, "Data set and reference models of EMPS", 2019. Laws and models are chosen by blocks of
DATA_EMPS held back (`benchmarks/emps_friction.py` tries all of them; here those next to the chosen one).
DATA_EMPS_PULSES is only ever foretold.
"""

import numpy as np
import pytest

from benchmarks import axis_simulation
from benchmarks.axis_simulation import compute_relative_residual
from symid.identification.friction.estimators import fit_friction
from symid.identification.friction.searches import FrictionOptions
from symid.identification.friction.selection import select_law
from symid.joint_models.friction_catalogue import get_law


@pytest.fixture(scope="module")
def samples(emps_logs, emps):
    return [axis_simulation.build_axis_samples(recording, emps.processing) for recording in emps_logs]


@pytest.mark.parametrize(
    ("law", "fitted", "unseen"),
    [
        ("coulomb-viscous-offset", "4.0834", "5.9824"),
        ("stribeck+offset", "3.9468", "5.9047"),
        ("asymmetric", "3.1117", "5.3649"),
        # Known as 5.2809, which is what a Stribeck velocity of 0.029 m/s leaves; see the next test.
        ("asymmetric-stribeck", "2.9325", "5.2810"),
    ],
)
def test_the_ladder_of_laws(samples, law, fitted, unseen):
    estimate = fit_friction(samples[0], get_law(law))
    percents = [compute_relative_residual(each, get_law(law), estimate) for each in samples]
    assert [f"{percent:.4f}" for percent in percents] == [fitted, unseen]


def test_the_last_step_of_the_ladder(samples):
    law = get_law("asymmetric-stribeck")
    best = fit_friction(samples[0], law)
    assert best.shape[0] == pytest.approx(0.0288, abs=5e-5)
    # This axis has no break-away bump: static friction lies below Coulomb friction.
    assert best.linear[-1] == pytest.approx(-3.5, abs=0.05)
    assert any(notice.code == "friction.static-below-coulomb" for notice in best.notices)
    rounded = fit_friction(samples[0], law, options=FrictionOptions(bounds=(("vs", (0.029, 0.029)),)))
    percents = [compute_relative_residual(each, law, rounded) for each in samples]
    assert [f"{percent:.4f}" for percent in percents] == ["2.9325", "5.2809"]
    assert best.objective < rounded.objective


def test_blocks_held_back_choose_friction_by_direction(samples):
    selection, _ = select_law(samples[0], ("coulomb-viscous-offset", "stribeck+offset", "asymmetric"))
    assert selection.chosen == "asymmetric"
    held = {trial.law: trial.held_percent for trial in selection.trials}
    assert held["asymmetric"] < 3.2 < held["stribeck+offset"] < held["coulomb-viscous-offset"]


FOUR = axis_simulation.AxisModel(law=get_law("coulomb-viscous-offset"))
CHOSEN = axis_simulation.AxisModel(law=get_law("asymmetric"), terms=("drift",))
# Shorter windows before these and restarts end no lower.
PLANS = {
    FOUR: axis_simulation.SearchPlan(cutoff=100.0, lengths=(6.2,), restarts=0),
    CHOSEN: axis_simulation.SearchPlan(cutoff=100.0, lengths=(3.1, 6.2), restarts=0),
}
PUBLISHED = np.array([95.1089, 203.5034, 20.3935, -3.1648])


def foretell(model, values, recording):
    """Return the error of the position simulated from the force and 20 samples, mm."""
    run = axis_simulation.build_axis_run(recording)
    return 1e3 * axis_simulation.compute_window_rmse(model, np.array(values), run)


@pytest.fixture(scope="module")
def fits(emps_logs):
    run = axis_simulation.build_axis_run(emps_logs[0])
    return {
        model.name: axis_simulation.fit_whole_run(model, run, plan, generator=np.random.default_rng(0))
        for model, plan in PLANS.items()
    }


def test_the_simulated_axis_follows_its_recording_and_another(fits, emps_logs):
    four, chosen = fits[FOUR.name], fits[CHOSEN.name]
    assert 1e3 * four.rmse < 2.9 < foretell(FOUR, PUBLISHED, emps_logs[0])
    assert 1e3 * chosen.rmse < 0.45
    assert len(chosen.values) == 6
    # The offset of the drive drifts by half a newton in a run.
    assert dict(zip(chosen.names, chosen.values, strict=True))["drift"] == pytest.approx(-0.0227, abs=0.001)
    # 4.9 mm, 7.3 mm, 8.4 mm.
    models = ((CHOSEN, chosen.values), (FOUR, four.values), (FOUR, PUBLISHED))
    best, middle, published = (foretell(model, values, emps_logs[1]) for model, values in models)
    assert best < middle < published < 9.0
    assert best < 5.5


@pytest.mark.parametrize(("model", "bar"), [(FOUR, 4.35), (CHOSEN, 2.64)], ids=("four", "network"))
@pytest.mark.xfail(strict=True, reason="not reached: 7.29 mm against 4.35 mm, 4.91 mm against 2.64 mm")
def test_bars_that_are_not_reached(fits, emps_logs, model, bar):
    assert foretell(model, fits[model.name].values, emps_logs[1]) <= bar
