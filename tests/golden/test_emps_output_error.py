"""EMPS by output error: its controller simulated, its real log, beside the published least squares.

Numbers of least squares: Janot, Gautier, Brunot, Data set and reference models of EMPS, 2019. Its rows take a
command, which holds from its sample to the next, for the force at its sample. A simulation that logs forces
so ("average") meets the published values; one that logs commands, as this log does, is half a period away.
"""

from dataclasses import replace

import numpy as np
import pytest

from symid.codegen.cache import prepare_library
from symid.codegen.library import Library
from symid.identification.rigid.closed_loop import (
    build_closed_loop,
    compute_demand,
    identify_closed_loop,
    set_card_values,
)
from symid.identification.rigid.fit import identify_parameters
from symid.identification.rigid.validation import validate_estimate
from symid.logs.reader import read_recording
from symid.logs.recording import cut_recording
from symid.robot.loading import override_robot
from symid.robot.toml_reader import read_robot
from symid.simulation.rigid_plant import RigidPlant, RigidPlantState

PUBLISHED = np.array([95.1089, 203.5034, 20.3935, -3.1648])
NAMES = ("M1", "Fv1", "Fc1", "offset1")
GIVEN = 20
"""First samples from which a forecast takes position and speed."""


@pytest.fixture(scope="module")
def robot(robots_folder):
    return override_robot(read_robot(robots_folder / "emps.toml"), [("settings", "published")])


@pytest.fixture(scope="module")
def library(robot):
    return prepare_library(robot)


@pytest.fixture(scope="module")
def recordings(shared_data, robot):
    folder = shared_data / "emps"
    return tuple(read_recording(folder / name, robot) for name in ("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat"))


@pytest.fixture(scope="module")
def estimate(robot, library, recordings):
    return identify_closed_loop("output-error", robot, library, recordings[:1])


def forecast(library, values, recording):
    """Return the root mean square error in m of positions that follow from the logged forces alone."""
    plant = RigidPlant(Library(set_card_values(library.card, values), library.engine))
    speed = np.polyfit(recording.time[:GIVEN], recording.position[:GIVEN, 0], 1)[0]
    state = RigidPlantState(
        q=recording.position[0].copy(), dq=np.array([speed]), modes=(int(np.sign(speed)),)
    )
    errors = []
    for measured, force in zip(recording.position[:, 0], recording.torque, strict=True):
        errors.append(float(state.q[0]) - measured)
        state = plant.advance(state, force, recording.period)
    return float(np.sqrt(np.mean(np.square(errors))))


def test_the_stated_controller_gives_the_logged_commands(robot, recordings):
    fitted, unseen = recordings
    loop = build_closed_loop(fitted, robot.controller, np.array([np.inf]))
    assert abs(loop.offset[0]) < 0.01
    gap = fitted.torque - compute_demand(loop, fitted)
    assert np.linalg.norm(gap) < 0.005 * np.linalg.norm(fitted.torque)
    # To the commands of the second log pulses were added, within the loop.
    loop = build_closed_loop(unseen, replace(robot.controller, offset=(0.0,)), np.array([np.inf]))
    gap = (unseen.torque - compute_demand(loop, unseen))[:, 0]
    pulses = unseen.extras["pulses_N"].ravel()
    factor = pulses @ gap / (pulses @ pulses)
    assert factor == pytest.approx(35.15065188, rel=0.02)
    assert np.linalg.norm(gap - factor * pulses) < 0.005 * np.linalg.norm(unseen.torque)


def test_what_a_log_of_forces_gives_is_what_was_published(robot, library, recordings):
    forces = replace(robot, controller=replace(robot.controller, torque="average"))
    found = identify_closed_loop("output-error", forces, library, recordings[:1])
    deviations = np.array([entry.std for entry in found.parameters])
    values = found.assemble(NAMES)
    assert np.all(np.abs(values - PUBLISHED) < 3.0 * deviations)
    assert np.all(np.abs(values / PUBLISHED - 1.0) < 0.02)


def test_a_log_of_commands_is_half_a_period_away(estimate, robot, library, recordings):
    values = estimate.assemble(NAMES)
    assert [f"{value:.2f}" for value in values] == ["94.90", "207.69", "20.10", "-3.17"]
    assert np.all(np.abs(values / PUBLISHED - 1.0) < 0.025)
    # Least squares say the same of the force that acted around each sample: that of both periods beside it.
    held = recordings[0].torque
    around = np.vstack([held[:1], 0.5 * (held[1:] + held[:-1])])
    usual = identify_parameters(library, [replace(recordings[0], torque=around)], robot.processing)
    deviations = np.array([entry.std for entry in usual.parameters])
    assert np.all(np.abs(values - usual.assemble(NAMES)) < deviations)


def test_pulses_that_no_one_told_of_are_noticed_and_told_ones_are_not(robot, library, recordings):
    # A third of the log: eight seconds.
    unseen = cut_recording(recordings[1], slice(8280))
    pulses = 35.15065188 * unseen.extras["pulses_N"].reshape(-1, 1)
    silent = identify_closed_loop("output-error", robot, library, [unseen])
    told = identify_closed_loop("output-error", robot, library, [replace(unseen, feedforward=pulses)])
    assert any(notice.code == "identify.tracking" for notice in silent.notices)
    assert not any(notice.code == "identify.tracking" for notice in told.notices)
    assert silent.mean_relative_percent > 30.0
    assert told.mean_relative_percent < 7.0


def test_the_simulated_axis_tracks_as_the_real_one(estimate):
    told = estimate.settings["fit"]
    assert told["iterations"] <= 4
    (entry,) = told["tracking"]
    assert entry["reference_from_measured"] > 5e-4
    assert entry["simulated_from_measured"] < 5e-6
    assert f"{estimate.mean_relative_percent:.1f}" == "4.5"
    assert not any(notice.code == "identify.tracking" for notice in estimate.notices)


def test_the_unseen_log_is_foretold_better_than_by_least_squares(estimate, robot, library, recordings):
    fitted, unseen = recordings
    usual = identify_parameters(library, [fitted], robot.processing)
    errors, residuals = [], []
    for found in (usual, estimate):
        errors.append(forecast(library, found.assemble(NAMES), unseen))
        residuals.append(validate_estimate(found, library, unseen, robot.processing).mean_relative_percent)
    assert errors[0] == pytest.approx(8.82e-3, rel=0.02)
    assert errors[1] < 0.97 * errors[0]
    assert residuals[1] < 0.995 * residuals[0]
