"""The libraries of two robots in one program: no name of one is a name of the other."""

import re
import shutil

import numpy as np
import pytest

from symid.codegen.casadi_functions import build_functions
from symid.robot import load_robot
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


MAIN = """
#include "symid_two_link.h"
#include "symid_two_link_elastic.h"
#include <stdio.h>
int main(void)
{
    const double beta[SYMID_TWO_LINK_BETA] = {1, 2, 3, 4, 5, 6}, q[2] = {0.1, 0.2};
    const float beta_float[SYMID_TWO_LINK_ELASTIC_BETA] = {1, 2, 3, 4, 5, 6}, q_float[2] = {0.1f, 0.2f};
    double g[2];
    float g_float[2];
    (void)symid_two_link_gravity(q, beta, g);
    (void)symid_two_link_elastic_gravity(q_float, beta_float, g_float);
    printf("%.17g %.17g %.9g %.9g\\n", g[0], g[1], (double)g_float[0], (double)g_float[1]);
    return 0;
}
"""


@pytest.mark.parametrize("order", [list(ROBOTS), list(reversed(ROBOTS))], ids="-".join)
def test_two_libraries_work_in_one_program(folders, order, tmp_path, c_compiler):
    (tmp_path / "main.c").write_text(MAIN)
    archives = [str(folders[name] / f"libsymid_{name}.a") for name in order]
    whole = ("-Wl,--whole-archive", *archives, "-Wl,--no-whole-archive", "-lm")
    include = [f"-I{path}" for path in folders.values()]
    run(tmp_path, c_compiler, "-std=c99", "-Wall", "-Werror", *include, "main.c", "-o", "main", *whole)
    found = [float(text) for text in run(tmp_path, "./main").stdout.split()]
    expected = []
    for name in ROBOTS:
        (gravity,) = build_functions(load_robot(name), names=("gravity",)).functions
        expected += np.array(gravity([0.1, 0.2], [1, 2, 3, 4, 5, 6])).ravel().tolist()
    assert found[:2] == pytest.approx(expected[:2], rel=1e-12)
    assert found[2:] == pytest.approx(expected[2:], rel=1e-5)


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
