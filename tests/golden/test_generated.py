"""The committed samples are what the generator gives now, byte for byte, and nothing else.

After a change on purpose: `python generated/regenerate.py`, and read the difference.
"""

import pytest

from symid.codegen.c_library import generate_c_library
from symid.codegen.casadi_functions import build_functions
from symid.codegen.python_targets import generate_python_module
from symid.codegen.source_folder import MANIFEST
from symid.robot.toml_reader import read_robot

GENERATORS = {"c": generate_c_library, "python": generate_python_module}
# What building inside the folder leaves behind is not compared.
BUILT = (".o", ".a", ".so", ".pyc")


@pytest.mark.parametrize("target", sorted(GENERATORS))
def test_committed_sample_equals_what_is_generated(project, target):
    functions = build_functions(read_robot(project / "robots" / "two_link.toml"))
    sources = GENERATORS[target](functions)
    folder = project / "generated" / "two_link" / target
    wanted = {path: text.encode() for path, text in (*sources.files, (MANIFEST, sources.manifest))}
    found = {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and path.suffix not in BUILT and path.name not in {"selftest", "control_loop"}
    }
    assert sorted(wanted.keys() - found.keys()) == [], "missing; run generated/regenerate.py"
    assert sorted(found.keys() - wanted.keys()) == [], "extra; run generated/regenerate.py"
    different = sorted(path for path, content in wanted.items() if found[path] != content)
    assert different == [], "run generated/regenerate.py and read the difference"
