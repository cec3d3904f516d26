"""Tests for the machines that run the generated code: `make test-embedded` runs them, `make test` does not.

What a test measured is printed at the end of the run: see `figure`.
"""

import os
import shutil
import tempfile
from collections.abc import Callable

import pytest

from tests.embedded.sources import Folder, Sources, make_sources
from tests.embedded.tools import OBJECTS


def pytest_configure(config):
    config.addinivalue_line(
        "markers", "embedded: other compilers and boards; `make test-embedded` runs these"
    )
    if not hasattr(config, "workerinput"):
        os.environ[OBJECTS] = folder = tempfile.mkdtemp(prefix="symid-test-objects-")
        config.add_cleanup(lambda: shutil.rmtree(folder, ignore_errors=True))


def pytest_ignore_collect(config):
    return True if "embedded" not in config.option.markexpr else None


def pytest_terminal_summary(terminalreporter):
    reports = [report for group in ("passed", "failed") for report in terminalreporter.stats.get(group, ())]
    lines = sorted(text for report in reports for name, text in report.user_properties if name == "figure")
    if lines:
        terminalreporter.section("figures")
        for line in lines:
            terminalreporter.write_line(line)


@pytest.fixture
def figure(record_property) -> Callable[[str], None]:
    """Return a function that keeps a line for the end of the run."""
    return lambda text: record_property("figure", text)


@pytest.fixture(scope="session")
def sources(tmp_path_factory, project) -> Sources:
    """Return the generated folders, made on demand."""
    return make_sources(project, tmp_path_factory.mktemp("generated"))


@pytest.fixture
def folder(request, sources) -> Folder:
    """Return the folder of a robot, a precision and a trigonometry that the test is parametrised with."""
    return sources(*request.param)
