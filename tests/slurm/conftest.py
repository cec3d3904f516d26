"""Tests of fleets on SLURM: `make test-slurm` runs them, `make test` does not."""

import pytest

from tests.slurm.node import SlurmNode


def pytest_configure(config):
    config.addinivalue_line("markers", "slurm: fleets on one node of SLURM; `make test-slurm` runs these")


def pytest_ignore_collect(config):
    return True if "slurm" not in config.option.markexpr else None


@pytest.fixture(scope="session")
def node():
    with SlurmNode() as one:
        yield one
