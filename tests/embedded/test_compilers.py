"""Generated C under two compilers with every warning an error, under sanitizers, and under cppcheck."""

import re

import pytest

from tests.embedded.sources import ROBOTS, with_folders
from tests.embedded.tools import STRICT, find_tool, run_command

pytestmark = pytest.mark.embedded

COMPILERS = ("gcc", "clang")
SANITIZE = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-fno-omit-frame-pointer")
each_source = with_folders(ROBOTS, ("double", "float"), library=("two_link", "two_link_elastic"))
# A rigid and an elastic robot. What is not optimised is watched as well, in a third of the compilers' time.
each_of_few = with_folders(("panda", "two_link_elastic"), ("double", "float"), library=())
each_compiler = pytest.mark.parametrize("compiler", COMPILERS)
# cppcheck follows every value through every statement: on straight code its time grows with the square.
LONGEST_CHECKED = 60_000


@each_source
@each_compiler
def test_no_compiler_warns(folder, tmp_path, compiler):
    program = find_tool(compiler)
    for source in (*folder.library, *folder.programs):
        printed = run_command(program, *STRICT, "-O2", "-c", source, "-o", tmp_path / "x.o")
        assert printed == "", source.name


@each_of_few
@each_compiler
def test_the_self_test_passes_under_sanitizers(folder, tmp_path, figure, compiler):
    program = find_tool(compiler)
    flags = ("-std=c99", "-g1", "-O0", *SANITIZE, f"-I{folder.path}")
    run_command(
        program, *flags, *folder.library, folder.path / "selftest.c", "-lm", "-o", tmp_path / "selftest"
    )
    printed = run_command(tmp_path / "selftest")
    assert "FAILED" not in printed
    assert "runtime error" not in printed
    last = printed.splitlines()[-1]
    assert re.fullmatch(r"0 of \d+ functions failed", last)
    figure(f"self-test under {compiler} {SANITIZE[0]}, {folder.label}: {last}")


@each_compiler
def test_the_sanitizers_do_stop_a_program(tmp_path, compiler):
    """Guards the tests above: with these flags a wrong index or an overflow ends the program."""
    program = find_tool(compiler)
    (tmp_path / "wrong.c").write_text(
        "int main(int count, char **words)\n"
        "{\n    int a[2] = {1, 2};\n    (void)words;\n    return a[count + 1] == 7;\n}\n"
    )
    run_command(program, *SANITIZE, "wrong.c", "-o", "wrong", folder=tmp_path)
    with pytest.raises(AssertionError, match=r"out of bounds|stack-buffer-overflow"):
        run_command(tmp_path / "wrong")


@each_source
def test_cppcheck_finds_nothing(folder, tmp_path, figure):
    checked = [path for path in (*folder.library, *folder.programs) if path.stat().st_size < LONGEST_CHECKED]
    command = ["--enable=warning,style,performance,portability", "--error-exitcode=1", "--std=c99", "--quiet"]
    printed = run_command(find_tool("cppcheck"), *command, f"-I{folder.path}", *checked)
    assert printed == ""
    left = sorted({*folder.library, *folder.programs} - set(checked))
    names = ", ".join(path.stem.removeprefix(f"{folder.prefix}_") for path in left)
    note = f", not {names}: too long for it" if left else ""
    figure(f"cppcheck, {folder.label}: exit code 0, nothing found in {len(checked)} sources{note}")


def test_cppcheck_does_find_something(tmp_path):
    program = find_tool("cppcheck")
    (tmp_path / "wrong.c").write_text("int f(void)\n{\n    int a[2] = {1, 2};\n    return a[2];\n}\n")
    with pytest.raises(AssertionError, match="arrayIndexOutOfBounds"):
        run_command(program, "--error-exitcode=1", "--quiet", tmp_path / "wrong.c")


@with_folders(("two_link", "two_link_elastic"), ("double",))
@each_compiler
def test_the_example_runs_under_sanitizers(folder, tmp_path, compiler):
    flags = ("-std=c99", "-g1", "-O1", *SANITIZE, f"-I{folder.path}")
    example, target = folder.path / "control_loop.c", tmp_path / "loop"
    run_command(find_tool(compiler), *flags, *folder.library, example, "-lm", "-o", target)
    (error,) = re.findall(r"over 5 s: (\S+) rad", run_command(target))
    assert float(error) < 5e-3
