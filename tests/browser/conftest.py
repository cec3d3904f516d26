"""Tests of pages in a browser: `make test-browser` runs them, `make test` does not."""

import pytest

from tests.browser.chromium import Browser, find_chromium


def pytest_configure(config):
    config.addinivalue_line("markers", "browser: pages in Chromium; `make test-browser` runs these")


def pytest_ignore_collect(config):
    return True if "browser" not in config.option.markexpr else None


@pytest.fixture(scope="session")
def browser():
    if find_chromium() is None:
        pytest.skip("Chromium is not here: apt-get install chromium")
    one = Browser()
    yield one
    one.close()
