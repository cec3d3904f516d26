"""What tests of real recordings share: the EMPS axis as published, and equal work, which is done once."""

import pytest

from symid.codegen.cache import prepare_library
from symid.logs.reader import read_recording
from symid.robot.loading import override_robot
from symid.robot.toml_reader import read_robot
from tests.sharing import share_work


@pytest.fixture(scope="module", autouse=True)
def shared_work():
    """Let calls of one file, and of the files after it, share filters, bases and rows of equations."""
    with share_work():
        yield


@pytest.fixture(scope="session")
def emps(robots_folder):
    return override_robot(read_robot(robots_folder / "emps.toml"), [("settings", "published")])


@pytest.fixture(scope="session")
def emps_library(emps):
    return prepare_library(emps)


@pytest.fixture(scope="session")
def emps_logs(shared_data, emps):
    """Return DATA_EMPS, which is fitted, and DATA_EMPS_PULSES, which is foretold."""
    names = ("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat")
    return [read_recording(shared_data / "emps" / name, emps) for name in names]
