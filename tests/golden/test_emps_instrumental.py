"""EMPS by instruments: beside the published least squares, and where its filter is left out.

Numbers: Janot, Gautier, Brunot, Data set and reference models of EMPS, 2019. Like these, instruments take the
command for the force at its sample.
"""

from dataclasses import replace

import numpy as np
import pytest

from symid.codegen.cache import prepare_library
from symid.identification.rigid.closed_loop import identify_closed_loop
from symid.identification.rigid.fit import identify_parameters
from symid.logs.reader import read_recording
from symid.robot.description import Decimation
from symid.robot.loading import override_robot
from symid.robot.toml_reader import read_robot

PUBLISHED = np.array([95.1089, 203.5034, 20.3935, -3.1648])
NAMES = ("M1", "Fv1", "Fc1", "offset1")


@pytest.fixture(scope="module")
def robot(robots_folder):
    return override_robot(read_robot(robots_folder / "emps.toml"), [("settings", "published")])


@pytest.fixture(scope="module")
def library(robot):
    return prepare_library(robot)


@pytest.fixture(scope="module")
def recording(shared_data, robot):
    return read_recording(shared_data / "emps" / "DATA_EMPS.mat", robot)


@pytest.fixture(scope="module")
def found(robot, library, recording):
    return identify_closed_loop("instrumental", robot, library, [recording])


def test_values_are_those_that_were_published(found):
    deviations = np.array([entry.std for entry in found.parameters])
    values = found.assemble(NAMES)
    assert np.all(np.abs(values - PUBLISHED) < 0.5 * deviations)
    assert [f"{value:.2f}" for value in values] == ["95.14", "203.56", "20.39", "-3.16"]
    told = found.settings["fit"]
    assert told["instruments"]["correlation"] > 0.999
    assert told["iterations"] <= 4
    assert not told["wls"]["biased"]
    assert max(map(abs, told["wls"]["shifts"].values())) < 0.5
    assert f"{found.mean_relative_percent:.2f}" == "4.08"


def test_without_decimation_wls_loses_mass_and_this_does_not(found, robot, library, recording):
    """Every sample of positions that pass 450 Hz: noise of accelerations draws the mass of wls down."""
    raw = replace(robot.processing, filter_cutoff=450.0, decimation=Decimation())
    fast = identify_closed_loop("instrumental", replace(robot, processing=raw), library, [recording])
    usual = identify_parameters(library, [recording], raw, estimator="wls")
    expected, deviation = found.assemble(("M1",))[0], found.parameters[0].std
    assert abs(fast.assemble(("M1",))[0] - expected) < deviation
    assert usual.assemble(("M1",))[0] < expected - deviation
    assert [f"{value:.2f}" for value in fast.assemble(NAMES)] == ["95.17", "204.63", "20.29", "-3.17"]
    assert [f"{value:.2f}" for value in usual.assemble(NAMES)] == ["94.99", "204.55", "20.29", "-3.17"]
    told = fast.settings["fit"]["wls"]
    assert told["biased"]
    assert told["shifts"]["M1"] < -3.0
    assert "identify.biased-wls" in {notice.code for notice in fast.notices}
