"""EMPS, the published identification of a real servo axis, digit by digit.

Numbers: Janot, Gautier, Brunot, Data set and reference models of EMPS, 2019.
"""

import pytest

from symid.codegen.cache import prepare_library
from symid.identification.rigid.fit import identify_parameters
from symid.identification.rigid.validation import validate_estimate
from symid.logs.reader import read_recording
from symid.robot.loading import override_robot
from symid.robot.toml_reader import read_robot

SYMMETRIC = {"M": "95.1089", "Fv": "203.5034", "Fc": "20.3935", "offset": "-3.1648"}
DEVIATIONS = {"M": "0.1085", "Fv": "1.1460", "Fc": "0.1012", "offset": "0.0444"}
ASYMMETRIC = {"M": "95.1540", "Fvp": "166.7061", "Fcp": "20.1440", "Fvn": "240.4236", "Fcn": "20.6277"}


@pytest.fixture(scope="module")
def identify(shared_data, robots_folder):
    def run(friction=None):
        stated = read_robot(robots_folder / "emps.toml")
        robot = override_robot(stated, [("settings", "published")], friction)
        library = prepare_library(robot)
        fitted = read_recording(shared_data / "emps" / "DATA_EMPS.mat", robot)
        unseen = read_recording(shared_data / "emps" / "DATA_EMPS_PULSES.mat", robot)
        estimate = identify_parameters(library, [fitted], robot.processing)
        return estimate, validate_estimate(estimate, library, unseen, robot.processing)

    return run


def write(values):
    return {name.rstrip("0123456789").replace("R", ""): f"{value:.4f}" for name, value in values}


def test_symmetric_friction_meets_every_published_digit(identify):
    estimate, validation = identify()
    assert write((p.name, p.value) for p in estimate.parameters) == SYMMETRIC
    assert write((p.name, p.std) for p in estimate.parameters) == DEVIATIONS
    assert f"{estimate.residual[0].norm:.4f}" == "108.7569"
    assert f"{estimate.mean_relative_percent:.4f}" == "4.0834"
    assert estimate.samples == 2480
    assert f"{validation.residual[0].norm:.4f}" == "169.4876"
    assert f"{validation.mean_relative_percent:.4f}" == "5.9824"


def test_asymmetric_friction_meets_every_published_digit(identify):
    estimate, validation = identify("asymmetric")
    assert write((p.name, p.value) for p in estimate.parameters) == ASYMMETRIC
    assert f"{estimate.mean_relative_percent:.4f}" == "3.1117"
    assert f"{validation.residual[0].norm:.4f}" == "151.9933"
    assert f"{validation.mean_relative_percent:.4f}" == "5.3649"
