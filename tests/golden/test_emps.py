"""EMPS, a real servo axis: its published identification digit by digit, output error, and instruments.

Numbers: Janot, Gautier, Brunot, Data set and reference models of EMPS, 2019. The published standard
deviations take std(residual), which divides by rows - 1, as the noise of one row.

The published rows, and instruments, take a command, which holds from its sample to the next, for the force at
its sample. A simulation that logs forces so ("average") meets the published values; one that logs commands,
as this log does, is half a period away.
"""

from dataclasses import replace

import numpy as np
import pytest

from symid.codegen.cache import prepare_library
from symid.codegen.library import Library
from symid.identification.rigid import closed_loop
from symid.identification.rigid.fit import identify_parameters
from symid.identification.rigid.validation import validate_estimate
from symid.logs.recording import cut_recording
from symid.robot.description import Decimation
from symid.robot.loading import override_robot
from symid.simulation.rigid_plant import RigidPlant, RigidPlantState

NAMES = ("M1", "Fv1", "Fc1", "offset1")
PUBLISHED = np.array([95.1089, 203.5034, 20.3935, -3.1648])
SYMMETRIC = {"M": "95.1089", "Fv": "203.5034", "Fc": "20.3935", "offset": "-3.1648"}
DEVIATIONS = {"M": "0.1085", "Fv": "1.1460", "Fc": "0.1012", "offset": "0.0444"}
ASYMMETRIC = {"M": "95.1540", "Fvp": "166.7061", "Fcp": "20.1440", "Fvn": "240.4236", "Fcn": "20.6277"}
# Values, then norm and percentage of what is left of the log that is fitted, and of the one that is not.
DIGITS = {
    "symmetric": (SYMMETRIC, ["108.7569", "4.0834"], ["169.4876", "5.9824"]),
    "asymmetric": (ASYMMETRIC, ["82.8778", "3.1117"], ["151.9933", "5.3649"]),
}
GIVEN = 20
"""First samples from which a forecast takes position and speed."""


def write(values):
    return {name.rstrip("0123456789").replace("R", ""): f"{value:.4f}" for name, value in values}


@pytest.mark.parametrize("friction", DIGITS)
def test_an_identification_meets_every_published_digit(emps, emps_logs, friction):
    robot = emps if friction == "symmetric" else override_robot(emps, [], friction)
    library = prepare_library(robot)
    estimate = identify_parameters(library, emps_logs[:1], robot.processing)
    validation = validate_estimate(estimate, library, emps_logs[1], robot.processing)
    values, *residuals = DIGITS[friction]
    assert write((p.name, p.value) for p in estimate.parameters) == values
    for found, digits in zip((estimate, validation), residuals, strict=True):
        assert [f"{found.residual[0].norm:.4f}", f"{found.mean_relative_percent:.4f}"] == digits
    assert estimate.samples == 2480
    if friction == "symmetric":
        assert write((p.name, p.std) for p in estimate.parameters) == DEVIATIONS


@pytest.fixture(scope="module")
def estimate(emps, emps_library, emps_logs):
    return closed_loop.identify_closed_loop("output-error", emps, emps_library, emps_logs[:1])


def list_stds(estimate):
    return np.array([entry.std for entry in estimate.parameters])


def forecast(library, values, recording):
    """Return the root mean square error in m of positions that follow from the logged forces alone."""
    plant = RigidPlant(Library(closed_loop.set_card_values(library.card, values), library.engine))
    speed = np.polyfit(recording.time[:GIVEN], recording.position[:GIVEN, 0], 1)[0]
    state = RigidPlantState(
        q=recording.position[0].copy(), dq=np.array([speed]), modes=(int(np.sign(speed)),)
    )
    errors = []
    for measured, force in zip(recording.position[:, 0], recording.torque, strict=True):
        errors.append(float(state.q[0]) - measured)
        state = plant.advance(state, force, recording.period)
    return float(np.sqrt(np.mean(np.square(errors))))


def test_the_stated_controller_gives_the_logged_commands(emps, emps_logs):
    fitted, unseen = emps_logs
    loop = closed_loop.build_closed_loop(fitted, emps.controller, np.array([np.inf]))
    assert abs(loop.offset[0]) < 0.01
    gap = fitted.torque - closed_loop.compute_demand(loop, fitted)
    assert np.linalg.norm(gap) < 0.005 * np.linalg.norm(fitted.torque)
    # To the commands of the second log pulses were added, within the loop.
    loop = closed_loop.build_closed_loop(unseen, replace(emps.controller, offset=(0.0,)), np.array([np.inf]))
    gap = (unseen.torque - closed_loop.compute_demand(loop, unseen))[:, 0]
    pulses = unseen.extras["pulses_N"].ravel()
    factor = pulses @ gap / (pulses @ pulses)
    assert factor == pytest.approx(35.15065188, rel=0.02)
    assert np.linalg.norm(gap - factor * pulses) < 0.005 * np.linalg.norm(unseen.torque)


def test_what_a_log_of_forces_gives_is_what_was_published(emps, emps_library, emps_logs):
    forces = replace(emps, controller=replace(emps.controller, torque="average"))
    found = closed_loop.identify_closed_loop("output-error", forces, emps_library, emps_logs[:1])
    values = found.assemble(NAMES)
    assert np.all(np.abs(values - PUBLISHED) < 3.0 * list_stds(found))
    assert np.all(np.abs(values / PUBLISHED - 1.0) < 0.02)


def test_a_log_of_commands_is_half_a_period_away(estimate, emps, emps_library, emps_logs):
    values, told = estimate.assemble(NAMES), estimate.settings["fit"]
    # The simulated axis tracks as the real one.
    assert told["tracking"][0]["simulated_from_measured"] < 5e-6
    assert told["tracking"][0]["reference_from_measured"] > 5e-4
    assert not any(notice.code == "identify.tracking" for notice in estimate.notices)
    assert np.all(np.abs(values / PUBLISHED - 1.0) < 0.025)
    # Least squares say the same of the force that acted around each sample: that of both periods beside it.
    held = emps_logs[0].torque
    around = np.vstack([held[:1], 0.5 * (held[1:] + held[:-1])])
    usual = identify_parameters(emps_library, [replace(emps_logs[0], torque=around)], emps.processing)
    assert np.all(np.abs(values - usual.assemble(NAMES)) < list_stds(usual))


def test_pulses_that_no_one_told_of_are_noticed_and_told_ones_are_not(emps, emps_library, emps_logs):
    # A third of the log: eight seconds.
    unseen = cut_recording(emps_logs[1], slice(8280))
    pulses = 35.15065188 * unseen.extras["pulses_N"].reshape(-1, 1)
    for log, least, most in ((unseen, 30.0, np.inf), (replace(unseen, feedforward=pulses), 0.0, 7.0)):
        found = closed_loop.identify_closed_loop("output-error", emps, emps_library, [log])
        assert least < found.mean_relative_percent < most
        assert ("identify.tracking" in {notice.code for notice in found.notices}) is (log is unseen)


def test_the_unseen_log_is_foretold_better_than_by_least_squares(estimate, emps, emps_library, emps_logs):
    fitted, unseen = emps_logs
    usual = identify_parameters(emps_library, [fitted], emps.processing)
    fits = (usual, estimate)
    errors = [forecast(emps_library, found.assemble(NAMES), unseen) for found in fits]
    trials = (validate_estimate(found, emps_library, unseen, emps.processing) for found in fits)
    residuals = [trial.mean_relative_percent for trial in trials]
    assert errors[0] == pytest.approx(8.82e-3, rel=0.02)
    assert errors[1] < 0.97 * errors[0]
    assert residuals[1] < 0.995 * residuals[0]


def test_instruments_give_what_was_published_and_need_no_decimation(emps, emps_library, emps_logs):
    instrumental = closed_loop.identify_closed_loop("instrumental", emps, emps_library, emps_logs[:1])
    values = instrumental.assemble(NAMES)
    assert np.all(np.abs(values - PUBLISHED) < 0.5 * list_stds(instrumental))
    told = instrumental.settings["fit"]
    assert told["instruments"]["correlation"] > 0.999
    assert not told["wls"]["biased"]
    assert max(map(abs, told["wls"]["shifts"].values())) < 0.5
    # Every sample of positions that pass 450 Hz: noise of accelerations draws the mass of wls down.
    raw = replace(emps.processing, filter_cutoff=450.0, decimation=Decimation())
    fast = closed_loop.identify_closed_loop(
        "instrumental", replace(emps, processing=raw), emps_library, emps_logs[:1]
    )
    usual = identify_parameters(emps_library, emps_logs[:1], raw, estimator="wls")
    expected, deviation = instrumental.assemble(("M1",))[0], instrumental.parameters[0].std
    assert abs(fast.assemble(("M1",))[0] - expected) < deviation
    assert usual.assemble(("M1",))[0] < expected - deviation
    assert [f"{value:.2f}" for value in fast.assemble(NAMES)] == ["95.17", "204.63", "20.29", "-3.17"]
    assert [f"{value:.2f}" for value in usual.assemble(NAMES)] == ["94.99", "204.55", "20.29", "-3.17"]
    assert fast.settings["fit"]["wls"]["biased"]
    assert fast.settings["fit"]["wls"]["shifts"]["M1"] < -3.0
    assert "identify.biased-wls" in {notice.code for notice in fast.notices}
