"""Whatever a robot file calls its robot and joints, the generated code is that of the model."""

import sys
from dataclasses import replace

import pytest

from symid.codegen.source_text import build_library_prefix, clean_text
from tests.builds import build_shipped, make, run, write_c, write_python

WORST = 'a*/ int bad; /*"""\\\n#error `b` ??/\x00\u202e$@x@ "'


def test_text_is_cleaned():
    found = clean_text(WORST)
    assert found.isprintable()
    for mark in ("*/", "/*", '"', "\\", "`", "??", "$", "@"):
        assert mark not in found
    assert clean_text("arm Ä-2 (left)") == "arm Ä-2 (left)"
    assert build_library_prefix("Arm 2/x") == "symid_arm_2_x"


@pytest.fixture(scope="module")
def worst():
    made = build_shipped("emps", "mass_matrix", "friction")
    joints = tuple(replace(joint, name=WORST) for joint in made.card.joints)
    return replace(made, card=replace(made.card, robot=WORST, joints=joints))


def test_code_with_the_worst_names_compiles_and_runs(worst, tmp_path, c_compiler):
    make(write_c(worst, tmp_path / "c"), c_compiler, "check", flags="-O1 -Werror")
    for name in ("README.md", f"{build_library_prefix(WORST)}.pc.in"):
        assert "\n#error" not in (tmp_path / "c" / name).read_text()
    run(write_python(worst, tmp_path / "p"), sys.executable, f"{build_library_prefix(WORST)}.py")
