"""The program of the page for users of the C library is built as the page says, and gives what is right."""

import re
import shlex
import shutil
import subprocess

import numpy as np
import pytest

from symid.codegen.c_library import generate_c_library
from symid.codegen.casadi_functions import build_functions
from symid.codegen.source_folder import write_sources
from symid.joint_models import get_law
from symid.robot.toml_reader import parse_robot, read_robot
from tests.architecture.source import PROJECT
from tests.state_laws import ARM, STATES, write_table

PAGE = PROJECT / "docs" / "c_library.md"


@pytest.fixture(scope="module")
def blocks():
    text = PAGE.read_text(encoding="utf-8")
    found = {}
    for kind, block in re.findall(r"^```(c|cmake|sh)\n(.*?)^```$", text, re.DOTALL | re.MULTILINE):
        name = "bristles" if kind == "c" and "bristles" in block else kind
        assert found.setdefault(name, block) == block
    return found


@pytest.fixture(scope="module")
def functions(project):
    names = ("forward_kinematics", "gravity", "inverse_dynamics")
    return build_functions(read_robot(project / "robots" / "panda.toml"), names=names)


@pytest.fixture(scope="module")
def folder(blocks, functions, tmp_path_factory):
    root = tmp_path_factory.mktemp("page")
    write_sources(generate_c_library(functions), root / "panda_c")
    (root / "main.c").write_text(blocks["c"])
    (root / "CMakeLists.txt").write_text(blocks["cmake"])
    return root


def check_output(folder, functions, program):
    done = subprocess.run([program], cwd=folder, capture_output=True, text=True, check=True)
    q = [0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8]
    k = [program.spec.name for program in functions.programs].index("forward_kinematics")
    place = np.asarray(functions.functions[k](q)[1].full()).ravel()[18:21]
    assert done.stdout == "0: the last link is at {:.4f} {:.4f} {:.4f} m\n".format(*place)


def test_the_program_is_ten_lines(blocks):
    lines = [line for line in blocks["c"].splitlines() if line.strip()]
    assert len(lines) <= 10


BRISTLES = """
#include "symid_arm.h"
#include <stdio.h>
int main(void)
{{
    const double dq[SYMID_ARM_JOINTS] = {{0.4}}, f[] = {{{values}}};
    double tau_f[SYMID_ARM_JOINTS];
    int status = 0;
{block}
    printf("%.17g\\n", tau_f[0]);
    return status;
}}
"""


def test_the_lines_of_friction_with_a_state(blocks, c_compiler, tmp_path):
    """One step of 1 ms from straight bristles: z = v h up to its square, in closed form."""
    robot = parse_robot(ARM.format(friction=write_table("dahl")))
    joint = robot.joints[0].friction
    write_sources(generate_c_library(build_functions(robot)), tmp_path)
    values = ", ".join(f"{value!r}" for value in joint.values)
    lines = re.sub(
        r"^(?=symid_arm_friction_state_\w+\()", "status += ", blocks["bristles"], flags=re.MULTILINE
    )
    (tmp_path / "main.c").write_text(BRISTLES.format(values=values, block=lines))
    sources = [path.name for path in tmp_path.glob("symid_arm*.c") if "test" not in path.name]
    flags = ("-std=c99", "-Wall", "-Wextra", "-Werror")
    command = [c_compiler, *flags, "main.c", *sources, "-lm", "-o", "robot"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    said = subprocess.run([tmp_path / "robot"], capture_output=True, text=True, check=True).stdout
    named = dict(zip((entry.name for entry in get_law("dahl").linear), joint.values, strict=True))
    level, stiffness = named["Fc"], STATES["dahl"]["sigma0"]
    expected = level * (1.0 - np.exp(-stiffness * 0.4 * 0.001 / level)) + named.get("Fv", 0.0) * 0.4
    assert float(said) == pytest.approx(expected, rel=1e-12)


def test_by_a_compiler_alone(blocks, folder, functions, c_compiler):
    (command,) = blocks["sh"].splitlines()
    assert shlex.split(command)[0] == "cc"
    strict = "-Wall -Wextra -Wpedantic -Wconversion -Wdouble-promotion -Wshadow -Werror"
    command = command.replace("cc ", f"{shlex.quote(c_compiler)} {strict} ", 1)
    done = subprocess.run(["sh", "-c", command], cwd=folder, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    check_output(folder, functions, "./robot")


@pytest.mark.parametrize(
    ("given", "optimised"),
    [("", ["-O2"]), (" -DCMAKE_C_FLAGS=-O1", ["-O1"]), (" -DCMAKE_BUILD_TYPE=Debug", []), ("page", ["-O3"])],
)
def test_by_cmake(folder, functions, c_compiler, given, optimised):
    """Without a build type the library is optimised; a build type, or a flag of one's own, stays."""
    if shutil.which("cmake") is None:
        pytest.skip("wants cmake: install it to build the program of the page as it says")
    page = PAGE.read_text(encoding="utf-8")
    line = re.search("cmake -B build -D.* && cmake --build build", page)[0]
    first, build = (line if given == "page" else f"cmake -B build{given} && cmake --build build").split("&&")
    shutil.rmtree(folder / "build", ignore_errors=True)
    for command in (f"{first} -DCMAKE_C_COMPILER={c_compiler}", f"{build} -j2 -- VERBOSE=1"):
        words = shlex.split(command)
        done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
    (compiled,) = (
        text for text in done.stdout.splitlines() if "-c " in text and "symid_panda_gravity.c" in text
    )
    assert re.findall(r" (-O\w)", compiled) == optimised
    check_output(folder, functions, "build/robot")
