"""The libraries of two robots in one program: no name of one is a name of the other."""

import re
import shutil

import pytest

from tests.builds import build_shipped, make, run, write_c

ROBOTS = {"two_link": "double", "two_link_elastic": "float"}


@pytest.fixture(scope="module")
def folders(tmp_path_factory, c_compiler):
    """Return the folders of both robots, with the friction laws, compiled."""
    root = tmp_path_factory.mktemp("two")
    for name, precision in ROBOTS.items():
        write_c(build_shipped(name), root / name, precision=precision, friction_laws=True)
        make(root / name, c_compiler, f"libsymid_{name}.a")
    return {name: root / name for name in ROBOTS}


def find_symbols(archive):
    nm = shutil.which("nm")
    if nm is None:
        pytest.skip("wants nm: apt-get install binutils")
    lines = run(archive.parent, nm, "-g", "--defined-only", archive).stdout.splitlines()
    return [line.split()[2] for line in lines if re.fullmatch(r"\S+ \S \S+", line)]


def test_every_global_name_begins_with_the_prefix_and_is_there_once(folders):
    names = {name: find_symbols(path / f"libsymid_{name}.a") for name, path in folders.items()}
    for name, symbols in names.items():
        assert len(symbols) == len(set(symbols)) > 30
        assert [symbol for symbol in symbols if not symbol.startswith(f"symid_{name}_")] == []
    first, second = names.values()
    assert set(first) & set(second) == set()


def test_no_macro_of_the_headers_is_defined_twice(folders):
    """A macro of one header must not change what the other says: not even the same text twice."""
    macros = {}
    for name, path in folders.items():
        for header in sorted(path.glob("*.h")):
            for macro in re.findall(r"^#\s*define (\w+)", header.read_text(), re.MULTILINE):
                macros.setdefault(macro, set()).add(name)
    public = {macro: robots for macro, robots in macros.items() if macro.startswith("SYMID_")}
    assert len(public) > 10
    assert [macro for macro, robots in public.items() if len(robots) > 1] == []
