"""What tests of the command line may share."""

import pytest

from tests.sharing import share_work


@pytest.fixture(scope="module")
def shared_work():
    """Let calls of one file share filters, bases and rows of equations."""
    with share_work():
        yield
