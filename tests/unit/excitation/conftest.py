"""The robot that most tests of excitation move."""

import pytest

from symid.robot.toml_reader import read_robot


@pytest.fixture(scope="session")
def robot(robots_folder):
    """Return the vertical arm of two links."""
    return read_robot(robots_folder / "two_link.toml")
