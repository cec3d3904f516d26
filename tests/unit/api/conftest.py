"""What tests of the API share."""

import pytest

import symid


@pytest.fixture(scope="module")
def robot():
    return symid.load("two_link")
