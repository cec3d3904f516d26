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
from symid.robot.toml_reader import read_robot


@pytest.fixture(scope="module")
def blocks(project):
    text = (project / "docs" / "c_library.md").read_text(encoding="utf-8")
    return dict(re.findall(r"^```(c|cmake|sh)\n(.*?)^```$", text, re.DOTALL | re.MULTILINE))


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


def test_by_a_compiler_alone(blocks, folder, functions, c_compiler):
    (command,) = blocks["sh"].splitlines()
    assert shlex.split(command)[0] == "cc"
    strict = "-Wall -Wextra -Wpedantic -Wconversion -Wdouble-promotion -Wshadow -Werror"
    command = command.replace("cc ", f"{shlex.quote(c_compiler)} {strict} ", 1)
    done = subprocess.run(["sh", "-c", command], cwd=folder, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    check_output(folder, functions, "./robot")


def test_by_cmake(folder, functions, c_compiler):
    if shutil.which("cmake") is None:
        pytest.skip("wants cmake: install it to build the program of the page as it says")
    for arguments in (["-B", "build", f"-DCMAKE_C_COMPILER={c_compiler}"], ["--build", "build", "-j2"]):
        done = subprocess.run(["cmake", *arguments], cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
    check_output(folder, functions, "build/robot")
