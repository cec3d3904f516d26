"""What tests of the command line may share."""

import pytest

from tests.calls import do
from tests.sharing import share_work


@pytest.fixture(scope="module")
def shared_work():
    """Let calls of one file share filters, bases and rows of equations."""
    with share_work():
        yield


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """Return a log of two_link with noisy sensors."""
    path = tmp_path_factory.mktemp("log") / "run.npz"
    do("simulate", "two_link", "-o", path, "--noise", "0.5", "--seed", "3")
    return path


@pytest.fixture(scope="module")
def estimate(log):
    """Return the estimate from the log."""
    path = log.parent / "estimate.json"
    do("identify", "two_link", log, "--drop-first", "2000", "-o", path)
    return path
