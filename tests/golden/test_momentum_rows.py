"""Momentum rows of real logs: no acceleration is computed, and no more is left than by torque rows.

That of the TX40 is in test_tx40.
"""

import numpy as np
import pytest

from symid.codegen.cache import prepare_library
from symid.identification.regression.preparation import choose_filters, choose_window, prepare_rows
from symid.identification.rigid.fit import identify_parameters
from symid.logs.reader import read_recording
from symid.robot.loading import override_robot
from symid.robot.toml_reader import read_robot
from tests.golden.residuals import measure_residuals

AXIS, RUNS = ("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat"), ("run_a.npz", "run_b.npz", "run_c.npz")
CASES = [
    *(("emps", (log,), (log,), estimator) for log in AXIS for estimator in ("ols", "wls")),
    ("emps", AXIS[:1], AXIS[1:], "ols"),
    *(("kr300", (log,), (log,), estimator) for log in RUNS for estimator in ("ols", "wls")),
    ("kr300", RUNS[:2], RUNS, "wls"),
]
BANDS = {"emps": (10.0, 20.0, 50.0), "kr300": (10.0, 20.0)}


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


@pytest.mark.parametrize("case", CASES, ids=str)
def test_they_leave_what_torque_rows_leave(case, shared_data, robots_folder):
    name, fitted, judged, estimator = case
    robot = read_robot(robots_folder / f"{name}.toml")
    published = [("settings", entry.name) for entry in robot.settings if entry.name == "published"]
    robot = override_robot(robot, published)
    library = prepare_library(robot)
    logs = {log: read_recording(shared_data / name / log, robot) for log in (*fitted, *judged)}
    torque, momentum = (
        identify_parameters(
            library, [logs[log] for log in fitted], robot.processing, rows=rows, estimator=estimator
        )
        for rows in ("torque", "momentum")
    )
    for log in judged:
        left, usual = (
            measure_residuals(fit, library, logs[log], robot.processing, BANDS[name])
            for fit in (momentum, torque)
        )
        assert np.all(left < 1.05 * usual), log


def test_they_compute_no_acceleration(shared_data, robots_folder):
    robot = read_robot(robots_folder / "kr300.toml")
    recording = read_recording(shared_data / "kr300" / "run_a.npz", robot)
    library = WithoutAcceleration(prepare_library(robot))
    processing = choose_filters(robot.processing, [recording]).processing
    window = choose_window("momentum", processing, recording.period)
    assert window == pytest.approx(processing.decimation.factor * recording.period)
    rows = prepare_rows("momentum", library, recording, processing, window=window)
    assert len(rows.values) > 1000
    assert "momentum_regressor" in library.asked
