"""Robots that recovery tests share."""

import pytest

import symid
from symid.codegen.cache import prepare_library
from symid.robot.toml_reader import read_robot
from tests.recovery import written_out_arm
from tests.recovery.elastic_runs import prepare_arm


@pytest.fixture(scope="session")
def arm(robots_folder):
    """Return the arm with two elastic joints, and its library."""
    return prepare_arm(robots_folder)


@pytest.fixture(scope="session")
def two_link(robots_folder):
    return read_robot(robots_folder / "two_link.toml")


@pytest.fixture(scope="session")
def two_link_library(two_link):
    return prepare_library(two_link)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder that the tests of a file share."""
    return tmp_path_factory.mktemp("files")


@pytest.fixture(scope="session")
def load_text(tmp_path_factory):
    """Return a function that loads a robot from the text of its file."""

    def read(text, name):
        path = tmp_path_factory.mktemp(name) / f"{name}.toml"
        path.write_text(text)
        return symid.load(path)

    return read


@pytest.fixture(scope="session")
def mixed(load_text):
    """Return the arm with an elastic and a rigid joint whose equations are written out."""
    return load_text(written_out_arm.ROBOT, "mixed")
