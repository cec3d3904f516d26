"""What tests of real recordings share: equal work is done once."""

import pytest

from tests.sharing import share_work


@pytest.fixture(scope="module", autouse=True)
def shared_work():
    """Let calls of one file, and of the files after it, share filters, bases and rows of equations."""
    with share_work():
        yield
