"""A second `symid generate`: nothing to do, or the folder made anew; the user's files stay."""

import json
import os
import shutil
import subprocess
import sys

import pytest

from tests.calls import ask, do, fail, say

ROBOT = "emps"


@pytest.fixture(params=["c", "python"], scope="module")
def target(request):
    if request.param == "c" and shutil.which("make") is None:
        pytest.skip("wants make, and a C compiler, to run the self-test")
    return request.param


@pytest.fixture(scope="module")
def first(target, tmp_path_factory):
    """Make a folder once for all tests of a target; return it and the answer."""
    folder = tmp_path_factory.mktemp(target) / "code"
    result = do("generate", ROBOT, "--target", target, "-o", folder)["result"]
    assert not result["unchanged"]
    return folder, result


@pytest.fixture
def made(first, tmp_path, target):
    """Return a copy of the folder, the call that made it, and what it answers of the copy."""
    source, result = first
    folder = tmp_path / "code"
    shutil.copytree(source, folder)
    moved = json.loads(json.dumps(result).replace(str(source), str(folder)))
    return folder, (ROBOT, "--target", target, "-o", folder), moved


def read_files(folder):
    return {
        path.relative_to(folder): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()
    }


def test_nothing_is_done_where_nothing_has_changed(made):
    folder, order, first = made
    before = read_files(folder)
    assert do("generate", *order)["result"] == {**first, "unchanged": True}
    assert read_files(folder) == before
    assert f"{folder}: nothing has changed, self-test passed with " in say("generate", *order)


def test_nothing_that_derives_is_loaded_then(made, project):
    _, order, _ = made
    script = (
        "import sys\n"
        "from symid.cli.main import run\n"
        "assert run(sys.argv[1:]) == 0\n"
        "print(sorted({'sympy', 'casadi', 'scipy', 'jinja2', 'mpmath'} & sys.modules.keys()))\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(project)}
    command = [sys.executable, "-c", script, "generate", *map(str, order), "-q"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert "nothing has changed" in done.stdout
    assert done.stdout.splitlines()[-1] == "[]"


@pytest.mark.parametrize("what", ["a file is gone", "the manifest", "force", "an option", "the record"])
def test_it_is_made_anew_where_something_has_changed(made, target, what):
    folder, order, _ = made
    manifest = json.loads((folder / "manifest.json").read_text())
    if what == "a file is gone":
        (folder / "README.md").unlink()
    elif what == "the manifest":
        manifest["operations"]["gravity"]["mul"] = 77
    elif what == "the record":
        del manifest["build"]["sizes"]
    elif what == "force":
        order = (*order, "--force")
    else:
        order = (*order, "--parameters", "standard")
    if what in {"the manifest", "the record"}:
        (folder / "manifest.json").write_text(json.dumps(manifest))
    assert do("generate", *order)["result"]["unchanged"] is False
    assert do("generate", *(entry for entry in order if entry != "--force"))["result"]["unchanged"] is True
    assert (folder / "README.md").is_file()


def test_an_edited_file_is_told_and_not_taken_for_unchanged(made):
    folder, order, _ = made
    (folder / "README.md").write_text("mine")
    assert fail("generate", *order) == (3, "output.edited-file")
    assert (folder / "README.md").read_text() == "mine"


def test_another_compiler_runs_the_self_test_again(made, target, monkeypatch):
    _, order, _ = made
    if target == "python":
        monkeypatch.setattr("platform.python_version", lambda: "3.99.0")
    else:
        from symid.codegen.compiler import locate_compiler

        other = next((name for name in ("clang", "gcc") if shutil.which(name)), None)
        if other is None:
            pytest.skip("wants gcc or clang besides cc")
        monkeypatch.setattr("symid.codegen.generation.locate_compiler", lambda *_: locate_compiler(other))
    assert not do("generate", *order)["result"]["unchanged"]


def test_a_users_own_files_survive(made):
    folder, order, _ = made
    own = {folder / "main.c": "int main(void) { return 0; }\n", folder / "own" / "notes.txt": "mine\n"}
    (folder / "own").mkdir()
    for path, text in own.items():
        path.write_text(text)
    assert ask("generate", *order)[1]["result"]["unchanged"] is True
    assert ask("generate", *order, "--parameters", "standard")[1]["result"]["unchanged"] is False
    assert {path: path.read_text() for path in own} == own


def test_the_manifest_says_who_ran_the_self_test_and_how_large_functions_are(made, target):
    folder, _, result = made
    build = json.loads((folder / "manifest.json").read_text())["build"]
    assert build["selftest"] == "passed"
    assert build["runner"] == result["runner"] != ""
    assert build["sizes"] == result["sizes"]
    if target == "python":
        assert "NumPy" in build["runner"]
        return
    assert build["flags"] == "-O1"
    assert build["sizes"].keys() == result["operations"].keys()
    for size in build["sizes"].values():
        assert size.keys() == {"code", "batch_code", "constants", "stack", "batch_stack"}
        assert 0 < size["code"] < 10_000


def test_the_same_compiler_gives_the_same_bytes_under_any_hash_seed(tmp_path, target, project):
    found = []
    for seed in ("1", "977"):
        folder = tmp_path / seed / "code"
        folder.parent.mkdir()
        environment = {**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": str(project)}
        command = [sys.executable, "-m", "symid", "generate", ROBOT, "--target", target, "-o", str(folder)]
        subprocess.run(command, env=environment, capture_output=True, check=True)
        found.append(read_files(folder))
    assert found[0] == found[1]
