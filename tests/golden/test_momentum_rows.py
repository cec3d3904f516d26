"""Momentum rows of real logs: no acceleration is computed, and no more is left than by torque rows.

That of the TX40 is in test_tx40.
"""

import numpy as np
import pytest

from symid.codegen.cache import prepare_library
from symid.identification.diagnostics.residual_structure import compute_band_residual, predict_torques
from symid.identification.rigid.fit import identify_parameters
from symid.logs.reader import read_recording
from symid.robot.loading import override_robot
from symid.robot.toml_reader import read_robot

LOGS = {
    "emps": ("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat"),
    "kr300": ("run_a.npz", "run_b.npz", "run_c.npz"),
}


class WithoutAcceleration:
    """A library that refuses every function of accelerations."""

    def __init__(self, inner):
        self.inner, self.asked = inner, set()

    def __getattr__(self, name):
        return getattr(self.inner, name)

    def evaluate(self, name, *inputs, out=None):
        assert "torque" not in name, "momentum rows asked for the torque regressor"
        self.asked.add(name)
        return self.inner.evaluate(name, *inputs, out=out)


@pytest.mark.parametrize("name", LOGS)
def test_they_leave_what_torque_rows_leave(name, shared_data, robots_folder):
    robot = read_robot(robots_folder / f"{name}.toml")
    published = [("settings", entry.name) for entry in robot.settings if entry.name == "published"]
    robot = override_robot(robot, published)
    library = prepare_library(robot)
    names = tuple(entry.name for entry in (*library.card.beta, *library.card.friction))
    for log in LOGS[name]:
        recording = read_recording(shared_data / name / log, robot)
        for estimator in ("ols", "wls"):
            left = {}
            for rows in ("torque", "momentum"):
                estimate = identify_parameters(
                    library, [recording], robot.processing, rows=rows, estimator=estimator
                )
                left[rows] = [
                    compute_band_residual(
                        predict_torques(
                            estimate.assemble(names), library, recording, robot.processing, band=band
                        )
                    ).mean_relative_percent
                    for band in (10.0, 20.0)
                ]
            assert np.all(np.array(left["momentum"]) < 1.05 * np.array(left["torque"])), (
                log,
                estimator,
                left,
            )


def test_they_compute_no_acceleration(shared_data, robots_folder):
    robot = read_robot(robots_folder / "kr300.toml")
    recording = read_recording(shared_data / "kr300" / "run_a.npz", robot)
    library = WithoutAcceleration(prepare_library(robot))
    from symid.identification.regression.preparation import choose_filters, choose_window, prepare_rows

    processing = choose_filters(robot.processing, [recording]).processing
    window = choose_window("momentum", processing, recording.period)
    assert window == pytest.approx(processing.decimation.factor * recording.period)
    rows = prepare_rows("momentum", library, recording, processing, window=window)
    assert len(rows.values) > 1000
    assert "momentum_regressor" in library.asked
