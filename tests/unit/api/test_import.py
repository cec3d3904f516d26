"""`import symid` is light, offers what it says, and says what it offers."""

import os
import subprocess
import sys

import pytest

import symid

HEAVY = {"numpy", "scipy", "sympy", "casadi", "click", "jinja2"}


def list_loaded(code):
    """Return the packages that a program loads."""
    command = [sys.executable, "-X", "importtime", "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=os.environ)
    return {line.rsplit("|", 1)[-1].strip().split(".")[0] for line in done.stderr.splitlines()}


def test_the_import_loads_nothing_heavy():
    loaded = list_loaded("import symid")
    assert "symid" in loaded, "the list of imports was not read"
    assert not loaded & HEAVY


def test_heavy_packages_are_seen_where_they_are_loaded():
    assert list_loaded("import symid; symid.load('two_link').base.values") >= {"sympy", "numpy"}


@pytest.mark.parametrize(
    "code", ["symid.load('two_link')", "symid.read_log, symid.load_fit, symid.RobotModel"]
)
def test_robots_and_names_come_without_sympy_and_casadi(code):
    assert not list_loaded(f"import symid; {code}") & {"sympy", "casadi", "click", "jinja2"}


def test_every_name_is_there():
    assert sorted(set(symid.__all__)) == symid.__all__
    assert all(getattr(symid, name) is not None for name in symid.__all__)
    namespace = {}
    exec("from symid import *", namespace)  # noqa: S102
    assert set(namespace) - {"__builtins__"} == set(symid.__all__)


def test_names_come_from_the_api_the_errors_and_the_fleets():
    offered = [getattr(symid, name) for name in symid.__all__]
    homes = {getattr(entry, "__module__", entry.__name__) for entry in offered}
    others = {home for home in homes if not home.startswith("symid.api.")}
    assert others == {"symid.errors", "symid.fleet", "symid.identification.options", "symid.options"}


def test_editors_see_the_names():
    assert set(symid.__all__) <= set(dir(symid))


def test_an_unknown_name_lists_what_is_there():
    with pytest.raises(AttributeError, match=r"no attribute 'Robot'; it offers .*load"):
        _ = symid.Robot
