"""What all tests share: where things are, which tools are there, a cache of their own.

A test that wants something a machine may not have asks for it through a fixture, and the
fixture skips with the reason.
"""

import os
import shutil
import tempfile
from pathlib import Path

import pytest
from hypothesis import settings

PROJECT = Path(__file__).resolve().parent.parent

# The same examples in every run: a failure here is a failure everywhere.
settings.register_profile("symid", derandomize=True, deadline=None, print_blob=True)
settings.load_profile("symid")


def pytest_configure(config: pytest.Config) -> None:
    """Give the run an empty cache, shared by its workers, so that no old library is found."""
    if not hasattr(config, "workerinput"):
        folder = tempfile.mkdtemp(prefix="symid-test-cache-")
        config.add_cleanup(lambda: shutil.rmtree(folder, ignore_errors=True))
        os.environ["XDG_CACHE_HOME"] = folder


@pytest.fixture(scope="session")
def project() -> Path:
    """Return the root of the source tree."""
    return PROJECT


@pytest.fixture(scope="session")
def robots_folder(project: Path) -> Path:
    """Return the folder of the robot files."""
    return project / "robots"


@pytest.fixture(scope="session")
def shared_data(project: Path) -> Path:
    """Return the folder of the real recordings, or skip: they are not part of the project."""
    folder = project.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("wants the recordings in ../shared/data")
    return folder


@pytest.fixture(scope="session")
def c_compiler() -> str:
    """Return the path of a C compiler, or skip."""
    for name in ("cc", "gcc", "clang"):
        found = shutil.which(name)
        if found:
            return found
    pytest.skip("wants a C compiler (cc, gcc or clang)")
