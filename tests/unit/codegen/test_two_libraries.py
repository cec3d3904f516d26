"""The libraries of two robots in one program: no name of one is a name of the other."""

import re
import shutil

import pytest

from tests.builds import build_shipped, make, run, write_c

ROBOTS = {"two_link": "double", "two_link_elastic": "float"}
STRICT = ("-std=c99", "-O1", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror")
# Both headers in both orders, every law's header too; the batch and the single function of both robots.
MAIN = """
#include "symid_two_link.h"
#include "symid_two_link_elastic.h"
#include "symid_two_link_elastic_friction_laws.h"
#include "symid_two_link_friction_laws.h"
#include <stdio.h>
#include <string.h>
int main(void)
{
    double beta[SYMID_TWO_LINK_BETA];
    float beta_float[SYMID_TWO_LINK_ELASTIC_BETA];
    const double q[4] = {0.1, 0.2, 0.3, 0.4};
    const float q_float[4] = {0.1f, 0.2f, 0.3f, 0.4f};
    double g[4];
    double single[2];
    float g_float[4];
    float single_float[2];
    for (size_t k = 0; k < SYMID_TWO_LINK_BETA; ++k) {
        beta[k] = 1.0 + (double)k;
    }
    for (size_t k = 0; k < SYMID_TWO_LINK_ELASTIC_BETA; ++k) {
        beta_float[k] = 1.0f + (float)k;
    }
    if (symid_two_link_gravity_batch(2, q, beta, g) != SYMID_TWO_LINK_OK ||
        symid_two_link_gravity(q, beta, single) != SYMID_TWO_LINK_OK ||
        symid_two_link_elastic_gravity_batch(2, q_float, beta_float, g_float) != SYMID_TWO_LINK_ELASTIC_OK ||
        symid_two_link_elastic_gravity(q_float, beta_float, single_float) != SYMID_TWO_LINK_ELASTIC_OK) {
        return 1;
    }
    printf("%.17g %.17g %.17g %.17g\\n", g[0], g[1], single[0], single[1]);
    printf("%.9g %.9g %.9g %.9g\\n", (double)g_float[0], (double)g_float[1], (double)single_float[0],
           (double)single_float[1]);
    printf("%d\\n", strcmp(symid_two_link_signature(), symid_two_link_elastic_signature()) != 0);
    return 0;
}
"""


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


@pytest.mark.parametrize("order", [list(ROBOTS), list(reversed(ROBOTS))], ids="-".join)
def test_two_libraries_work_in_one_program(folders, order, tmp_path, c_compiler):
    (tmp_path / "main.c").write_text(MAIN)
    command = [c_compiler, *STRICT, *(f"-I{path}" for path in folders.values()), "main.c", "-o", "main"]
    archives = [str(folders[name] / f"libsymid_{name}.a") for name in order]
    run(tmp_path, *command, *archives, "-lm")
    double, single, differs = run(tmp_path, "./main").stdout.splitlines()
    assert differs == "1"
    for line, tolerance in ((double, 1e-12), (single, 1e-5)):
        first, second, *again = map(float, line.split())
        assert again == pytest.approx([first, second], rel=tolerance)
        assert abs(first) > 0.1
