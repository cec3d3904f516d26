"""Whatever a robot file calls its robot and joints, the generated code is that of the model."""

import subprocess
import sys
from dataclasses import replace

import pytest

from symid.codegen.c_library import generate_c_library
from symid.codegen.casadi_functions import build_functions
from symid.codegen.python_targets import generate_python_module
from symid.codegen.source_folder import write_sources
from symid.codegen.source_text import build_library_prefix, clean_text
from symid.robot.toml_reader import read_robot

WORST = 'a*/ int bad; /*"""\\\n#error `b` ??/\x00\u202e$@x@ "'


def test_text_is_cleaned():
    found = clean_text(WORST)
    assert found.isprintable()
    for mark in ("*/", "/*", '"', "\\", "`", "??", "$", "@"):
        assert mark not in found
    assert clean_text("arm Ä-2 (left)") == "arm Ä-2 (left)"
    assert build_library_prefix("Arm 2/x") == "symid_arm_2_x"


@pytest.fixture(scope="module")
def worst(project):
    made = build_functions(read_robot(project / "robots" / "emps.toml"), names=("mass_matrix", "friction"))
    joints = tuple(replace(joint, name=WORST) for joint in made.card.joints)
    return replace(made, card=replace(made.card, robot=WORST, joints=joints))


def test_c_with_the_worst_names_compiles(worst, tmp_path, c_compiler):
    write_sources(generate_c_library(worst), tmp_path / "c")
    command = ["make", "-s", f"CC={c_compiler}", "CFLAGS=-O1 -Werror", "check"]
    done = subprocess.run(command, cwd=tmp_path / "c", capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    for name in ("README.md", f"{build_library_prefix(WORST)}.pc.in"):
        assert "\n#error" not in (tmp_path / "c" / name).read_text()


def test_python_with_the_worst_names_runs(worst, tmp_path):
    write_sources(generate_python_module(worst), tmp_path / "p")
    command = [sys.executable, f"{build_library_prefix(WORST)}.py"]
    done = subprocess.run(command, cwd=tmp_path / "p", capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
