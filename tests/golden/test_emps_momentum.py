"""EMPS: momentum rows, which need no acceleration, leave no more of a real log than torque rows do."""

import numpy as np
import pytest

from symid.codegen.cache import prepare_library
from symid.identification.diagnostics.residual_structure import compute_band_residual, predict_torques
from symid.identification.rigid.fit import identify_parameters
from symid.logs.reader import read_recording
from symid.robot.loading import override_robot
from symid.robot.toml_reader import read_robot


@pytest.mark.parametrize("file", ["DATA_EMPS.mat", "DATA_EMPS_PULSES.mat"])
def test_momentum_leaves_no_more(shared_data, robots_folder, file):
    robot = override_robot(read_robot(robots_folder / "emps.toml"), [("settings", "published")])
    library = prepare_library(robot)
    names = tuple(entry.name for entry in (*library.card.beta, *library.card.friction))
    fitted = read_recording(shared_data / "emps" / "DATA_EMPS.mat", robot)
    log = read_recording(shared_data / "emps" / file, robot)

    def measure(rows):
        values = identify_parameters(library, [fitted], robot.processing, rows=rows).assemble(names)
        return np.array(
            [
                compute_band_residual(
                    predict_torques(values, library, log, robot.processing, band=band)
                ).mean_relative_percent
                for band in (10.0, 20.0, 50.0)
            ]
        )

    assert np.all(measure("momentum") < 1.05 * measure("torque"))
