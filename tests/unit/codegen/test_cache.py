"""The cache: found again, made again when it must be, safe when two want it at once."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from symid.codegen import cache as cache_module
from symid.codegen.cache import find_cache_folder, find_library_key, prepare_library
from symid.codegen.compiler import Compiler, compile_sources, find_compiler
from symid.errors import GenerationError, OutputError
from symid.robot.description import Processing
from symid.robot.toml import read_robot

NAMES = ("mass_matrix", "friction")


@pytest.fixture
def robot(robots_folder):
    return read_robot(robots_folder / "emps.toml")


def prepare(robot, folder, **options):
    said = []
    library = prepare_library(robot, progress=said.append, names=NAMES, cache=folder, **options)
    return library, said


def test_the_second_call_makes_nothing(robot, tmp_path, c_compiler):
    first, said = prepare(robot, tmp_path)
    assert [text.split()[0] for text in said] == ["deriving", "writing", "compiling"]
    second, said = prepare(robot, tmp_path)
    assert (said, second.notices, first.backend) == ([], (), "c")
    assert [spec.name for spec in second.card.functions] == list(NAMES)
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize("victim", ["libsymid_emps.so", "manifest.json", "symid_emps.h", "seal.json"])
def test_a_tampered_entry_is_made_again(robot, tmp_path, c_compiler, victim):
    prepare(robot, tmp_path)
    (entry,) = tmp_path.iterdir()
    # Another file under the same name: this process still has the old library mapped.
    (entry / victim).unlink()
    (entry / victim).write_bytes(b"{}")
    library, said = prepare(robot, tmp_path)
    assert said
    assert [notice.code for notice in library.notices] == ["codegen.cache-rebuilt"]
    np.testing.assert_allclose(library.evaluate("mass_matrix", np.zeros(1), np.array([95.0]))[0], [[95.0]])
    assert prepare(robot, tmp_path)[0].notices == ()


def test_an_entry_with_a_foreign_file_is_made_again(robot, tmp_path, c_compiler):
    prepare(robot, tmp_path)
    (entry,) = tmp_path.iterdir()
    (entry / "extra.so").write_bytes(b"x")
    assert "extra.so" in prepare(robot, tmp_path)[0].notices[0].text


def test_the_key_sees_what_matters_and_nothing_else(robot):
    compiler = Compiler(path="/x/cc", version="cc 1")
    key = find_library_key(robot, None, compiler)
    assert key == find_library_key(replace(robot, processing=Processing(drop_first=7)), None, compiler)
    assert key == find_library_key(replace(robot, path="elsewhere", description="x"), None, compiler)
    others = [
        find_library_key(replace(robot, name="other"), None, compiler),
        find_library_key(robot, NAMES, compiler),
        find_library_key(robot, None, None),
        find_library_key(robot, None, replace(compiler, version="cc 2")),
        find_library_key(robot, None, replace(compiler, flags=("-O3",))),
    ]
    assert len({key, *others}) == 6


def test_without_a_compiler_the_python_module_is_used_and_said(robot, tmp_path):
    library, said = prepare(robot, tmp_path, compiler="no-such-compiler")
    assert library.backend == "python"
    assert [notice.code for notice in library.notices] == ["codegen.no-compiler"]
    assert "NumPy module" in said[-1]
    found = library.evaluate("mass_matrix", np.zeros((3, 1)), np.array([95.0]))[0]
    np.testing.assert_allclose(found, np.full((3, 1, 1), 95.0))
    assert prepare(robot, tmp_path, compiler="no-such-compiler")[1] == []


SCRIPT = """
import sys
from pathlib import Path
from symid.codegen.cache import prepare_library
from symid.robot.toml import read_robot
library = prepare_library(read_robot(Path(sys.argv[1])), names=("mass_matrix",), cache=Path(sys.argv[2]))
print(library.evaluate("mass_matrix", [0.0], [3.0])[0][0, 0])
print(sorted({"sympy", "casadi", "jinja2", "mpmath"} & set(sys.modules)))
"""


def start(robots_folder, folder, project):
    command = [sys.executable, "-c", SCRIPT, str(robots_folder / "emps.toml"), str(folder)]
    environment = {**os.environ, "PYTHONPATH": str(project)}
    return subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def test_two_processes_at_once_and_then_a_hit_without_heavy_imports(robots_folder, tmp_path, project):
    running = [start(robots_folder, tmp_path, project) for _ in range(2)]
    for process in running:
        out, err = process.communicate(timeout=100)
        assert (process.returncode, err) == (0, "")
        assert out.startswith("3.0")
    assert len(list(tmp_path.iterdir())) == 1
    out, err = start(robots_folder, tmp_path, project).communicate(timeout=100)
    assert (out, err) == ("3.0\n[]\n", "")


def test_a_failed_build_leaves_no_entry(robot, tmp_path, monkeypatch, c_compiler):
    broken = Compiler(path=c_compiler, version="x", flags=("--no-such-flag",))
    monkeypatch.setattr(cache_module, "find_compiler", lambda _: broken)
    with pytest.raises(GenerationError, match="--no-such-flag"):
        prepare(robot, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_made_is_said(robot, tmp_path):
    (tmp_path / "file").write_text("x")
    with pytest.raises(OutputError, match="cache folder cannot be written") as caught:
        prepare(robot, tmp_path / "file" / "cache")
    assert caught.value.notices[0].code == "output.cache"


def test_the_folder_follows_the_xdg_specification(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert find_cache_folder() == tmp_path / "symid"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    assert find_cache_folder() == Path.home() / ".cache" / "symid"


def test_the_compilers_message_reaches_the_reader(tmp_path, c_compiler):
    source = tmp_path / "bad.c"
    source.write_text("int f(void) { return missing; }\n")
    compiler = find_compiler(c_compiler)
    with pytest.raises(GenerationError, match="missing") as caught:
        compile_sources(compiler, [source], tmp_path / "x.so")
    assert caught.value.notices[0].code == "codegen.compiler-failed"
    assert f"{c_compiler} -std=c99" in str(caught.value)
    assert not (tmp_path / "x.so").exists()
    assert find_compiler("no-such-compiler") is None
