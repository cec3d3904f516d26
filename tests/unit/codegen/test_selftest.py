"""The self-test of a C library notices what it is there for; code that was spoilt on purpose fails it."""

import re
import shutil

import pytest

from symid.codegen.c_library import generate_c_library
from symid.codegen.compiler import measure_code_sizes
from symid.codegen.source_folder import write_sources
from symid.options import GenerateOptions
from tests.builds import build_shipped, list_failed, make, write_c

NAMES = ("jacobian", "gravity", "friction", "inverse_dynamics_derivatives")


@pytest.fixture(scope="module", params=["double", "float"])
def folder(request, tmp_path_factory, c_compiler):
    root = tmp_path_factory.mktemp("selftest") / "code"
    write_c(build_shipped("two_link", *NAMES), root, precision=request.param)
    make(root, c_compiler, "check", flags="-O1 -Wall -Wextra -Werror")
    return root


@pytest.fixture
def copy(folder, tmp_path):
    return shutil.copytree(folder, tmp_path / "code")


def replace(folder, name, pattern, change):
    path = folder / f"symid_two_link_{name}"
    text, changed = re.subn(pattern, change, path.read_text(), count=1 if name.endswith(".c") else 0)
    assert changed, (name, pattern)
    path.write_text(text)


def check_caught(folder, compiler, *names):
    done = make(folder, compiler, "check", flags="-O1", check=False)
    assert done.returncode != 0
    assert sorted(list_failed(done)) == sorted(names), done.stdout + done.stderr


def test_large_functions_pass_it_when_they_are_optimised(optimising_compiler, tmp_path):
    """With the flags of the folder's own Makefile and every warning; other tests compile them quickly."""
    make(write_c(build_shipped("puma560"), tmp_path), optimising_compiler, "check", flags="-O2 -Werror")


SPOILT = {
    "a sign": ("gravity", r"g\[0\] = ", "g[0] = -"),
    "a swap": (
        "gravity",
        r"    return SYMID_TWO_LINK_OK;",
        "    g[0] += g[1];\n    g[1] = g[0] - g[1];\n    g[0] -= g[1];\n    return SYMID_TWO_LINK_OK;",
    ),
    "an element that is not written": ("jacobian", r"    J\[5\] = [^;]*;\n", ""),
    "nothing written": ("friction", r"    tau_f\[1\] = [^;]*;\n", ""),
    "a write past the end": (
        "gravity",
        r"    return SYMID_TWO_LINK_OK;",
        "    (&g[1])[1] = g[0];\n    return SYMID_TWO_LINK_OK;",
    ),
    "NULL let through": (
        "gravity",
        r"    if \(q == NULL",
        "    if (beta == NULL) {\n        return 0;\n    }\n    if (q == NULL",
    ),
    "NULL seen late": (
        "gravity",
        r"    if \((q == NULL[^)]*)\) \{\n        return (\w+);",
        r"    if (\1) {\n        if (g != NULL) { g[0] = 0; }\n        return \2;",
    ),
    "a return code": ("gravity", r"return SYMID_TWO_LINK_OK;", "return 2;"),
    "the last samples of a batch": (
        "gravity",
        r"(?s)first < n; (.*)k < n; \+\+k",
        r"first + SYMID_TWO_LINK_LANES < n; \1k + 1 < n; ++k",
    ),
}


@pytest.mark.parametrize("what", sorted(SPOILT))
def test_it_notices(copy, c_compiler, what):
    name, pattern, change = SPOILT[what]
    replace(copy, f"{name}.c", pattern, change)
    check_caught(copy, c_compiler, name)


def test_it_notices_a_small_error_of_one_element_at_few_states(copy, c_compiler):
    """Past the states that are compared in full, and by little more than the tolerance."""
    size = "1e-4f" if "float" in (copy / "symid_two_link.h").read_text() else "1e-11"
    # The first state's q is negative, so that only the sums can tell.
    rows = re.search(r"state_q_2\[200\] = \{(.*?)\}", (copy / "selftest.c").read_text(), re.DOTALL).group(1)
    first = [int(value) for value in rows.replace("\n", " ").split(",")[:4]]
    limit = max(first[0], first[2], 2000) / 1000 + 0.01
    change = rf"\1;\n    if (q[0] > {limit}f) {{ g[1] += {size}; }}"
    replace(copy, "gravity.c", r"(    g\[1\] = [^;]*);", change)
    replace(copy, "gravity.c", r"g\[1\] \+= ", "g[1] += 30 * ")
    check_caught(copy, c_compiler, "gravity")


@pytest.mark.parametrize("reach", ["fifty", "within", "beyond"])
def test_it_notices_sines_that_are_wrong_far_out(copy, c_compiler, reach):
    limit = 1e4 if "float" in (copy / "symid_two_link.h").read_text() else 1e6
    reaches = {"fifty": (40, 60), "within": (0.5 * limit, limit), "beyond": (limit, 3 * limit)}
    low, high = reaches[reach]
    test = f"q[1] * q[1] > {low * low:.1f}f && q[1] * q[1] < {high * high:.1f}f"
    replace(copy, "gravity.c", r"(    g\[1\] = [^;]*;)", rf"\1\n    if ({test}) {{ g[1] = -g[1]; }}")
    check_caught(copy, c_compiler, "gravity")


def test_it_notices_a_library_of_mathematics_without_sines(copy, c_compiler):
    """Beyond the limit sines are those of the C library: on a target these may be wrong."""
    replace(copy, "lanes.h", r"= sin(f?)\(x\);", r"= sin\1(x) + 1;")
    check_caught(copy, c_compiler, "jacobian", "gravity", "inverse_dynamics_derivatives")


@pytest.mark.parametrize("precision", ["double", "float"])
def test_long_functions_in_parts_pass_it_with_every_warning(monkeypatch, tmp_path, c_compiler, precision):
    """Parts hand on values, read inputs and write outputs of their own, one by one and side by side."""
    functions = build_shipped("puma560", "jacobian", "gravity", "torque_regressor", "forward_dynamics")
    whole = dict(generate_c_library(functions, GenerateOptions(precision=precision)).files)
    monkeypatch.setattr("symid.codegen.printing._LONGEST_BODY", 200)
    monkeypatch.setattr("symid.codegen.printing._PART_LENGTH", 60)
    sources = generate_c_library(functions, GenerateOptions(precision=precision))
    written = dict(sources.files)
    changed = {path for path, text in written.items() if text != whole[path]}
    # The library's digest is in another file.
    assert changed == {f"symid_puma560_{name}.c" for name in ("torque_regressor", "forward_dynamics")} | {
        "symid_puma560_info.c"
    }
    assert written["symid_puma560_torque_regressor.c"].count("PART void part_") > 10
    assert written["symid_puma560_torque_regressor.c"].count("PART void batch_part_") > 10
    write_sources(sources, tmp_path)
    make(tmp_path, c_compiler, "check", flags="-O1 -Wall -Wextra -Werror -fstack-usage")
    sizes = measure_code_sizes(tmp_path, "symid_puma560", ("torque_regressor",))["torque_regressor"]
    frames = [
        int(line.split("\t")[1])
        for line in (tmp_path / "symid_puma560_torque_regressor.su").read_text().splitlines()
    ]
    assert max(sizes.stack, *frames) < sizes.batch_stack <= sum(frames)
