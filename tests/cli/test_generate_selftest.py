"""`symid generate` says that the self-test passed where it ran and passed, whatever stands in its way."""

import os
import shutil
import subprocess
import sys
import threading
from dataclasses import replace

import pytest

from symid.cli.main import run as run_cli
from tests.calls import ask, do, hear, list_codes, refuse

NAMES = ("two_link", "--function", "gravity")


@pytest.fixture(params=["c", "python"])
def target(request):
    if request.param == "c" and shutil.which("make") is None:
        pytest.skip("wants make, and a C compiler, to run the self-test")
    return request.param


@pytest.fixture
def with_make():
    if shutil.which("make") is None:
        pytest.skip("wants make")


def make_compiler(folder, script):
    """Return a compiler of the script's ways, `cc` at the end of it."""
    folder.mkdir(exist_ok=True)
    path = folder / "compiler"
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)
    return path


def use_compiler(monkeypatch, path):
    from symid.codegen.compiler import locate_compiler

    found = locate_compiler(str(path))
    assert found is not None
    monkeypatch.setattr("symid.codegen.generation.locate_compiler", lambda *_: found)


NO_FILES = 'for a in "$@"; do [ "$a" = -c ] && exit 1; done; exec cc "$@"'


@pytest.mark.usefixtures("with_make", "c_compiler")
@pytest.mark.parametrize("name", ["MAKEFLAGS", "GNUMAKEFLAGS"])
@pytest.mark.parametrize("flags", ["n", "i", "k", "q", "t"])
def test_flags_of_an_outer_make_change_nothing(tmp_path, monkeypatch, name, flags):
    monkeypatch.setenv(name, flags)
    monkeypatch.setenv("MAKELEVEL", "1")
    answer = do("generate", *NAMES, "-o", tmp_path / "good")
    assert answer["result"]["selftest"] == "passed"
    assert answer["result"]["sizes"]["gravity"]["code"] > 0
    use_compiler(monkeypatch, make_compiler(tmp_path / "bin", NO_FILES))
    assert refuse("generate", *NAMES, "-o", tmp_path / "bad") == (70, ["generate.selftest-failed"])
    assert not (tmp_path / "bad").exists()


def build_instead(program):
    """Return a compiler that, asked for the self-test, makes another program."""
    text = f'printf "{program}" > selftest; chmod 755 selftest; exit 0'
    return f'for a in "$@"; do [ "$a" = selftest ] && {{ {text}; }}; done; exec cc "$@"'


@pytest.mark.usefixtures("with_make")
@pytest.mark.parametrize(
    "program",
    [
        "#!/bin/sh\\\\n",
        "#!/bin/sh\\\\necho 0 of 0 functions failed\\\\n",
        "#!/bin/sh\\\\necho 1 of 1 functions failed\\\\n",
        "#!/bin/sh\\\\necho 0 of 1 functions failed\\\\nexit 3\\\\n",
        "no program",
    ],
)
def test_only_the_program_itself_can_pass(tmp_path, monkeypatch, c_compiler, program):
    use_compiler(monkeypatch, make_compiler(tmp_path / "bin", build_instead(program)))
    assert refuse("generate", *NAMES, "-o", tmp_path / "code") == (70, ["generate.selftest-failed"])


@pytest.mark.usefixtures("with_make")
def test_a_test_that_does_not_end_is_said(tmp_path, monkeypatch, c_compiler):
    monkeypatch.setattr("symid.codegen.generation._SELFTEST_TIMEOUT", 3.0)
    program = "#!/bin/sh\\\\nexec sleep 60\\\\n"
    use_compiler(monkeypatch, make_compiler(tmp_path / "bin", build_instead(program)))
    code, answer = ask("generate", *NAMES, "-o", tmp_path / "code")
    assert code == 70
    assert list_codes(answer, "errors") == ["generate.selftest-failed"]
    assert "3 s" in answer["errors"][0]["text"]


def test_files_of_the_user_take_no_part(tmp_path, target):
    folder = tmp_path / "code"
    order = (*NAMES, "--target", target, "-o", folder)
    do("generate", *order)
    (folder / "mine.py").write_text("raise SystemExit(1)\n")
    (folder / "selftest").write_text("mine\n")
    (folder / "GNUmakefile").write_text("selftest:\n\tfalse\n")
    (folder / "gone").symlink_to("nowhere")
    os.mkfifo(folder / "pipe")
    (folder / "secret").mkdir(mode=0)
    with (folder / "log").open("wb") as log:
        log.truncate(10**12)
    assert do("generate", *order, "--force")["result"]["selftest"] == "passed"
    assert (folder / "log").stat().st_size == 10**12


@pytest.mark.parametrize("force", [False, True])
def test_code_that_fails_its_test_is_not_written(tmp_path, monkeypatch, target, force):
    """A new folder does not appear, one of an earlier run stays as it was, and both are said."""
    from symid.codegen import generation

    new, old = tmp_path / "new", tmp_path / "old"
    do("generate", *NAMES, "--target", target, "-o", old)
    before = {path.name: path.read_bytes() for path in old.iterdir()}
    write = generation.source_folder.write_sources

    def spoil(sources, place, **options):
        files = tuple((path, text.replace("failed = 0", "failed = 1")) for path, text in sources.files)
        return write(replace(sources, files=files), place, **options)

    monkeypatch.setattr(generation.source_folder, "write_sources", spoil)
    order = ("two_link", "--function", "friction", "--target", target, *(["--force"] if force else []))
    for folder in (new, old):
        assert "nothing was written" in hear(70, "generate.selftest-failed", "generate", *order, "-o", folder)
    assert not new.exists()
    assert {path.name: path.read_bytes() for path in old.iterdir()} == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["old"]


def test_many_at_once_leave_what_the_last_of_them_made(tmp_path, project):
    """Each says of its own code that it passed; what is there is whole, and its record is its own."""
    folder = tmp_path / "code"
    environment = {**os.environ, "PYTHONPATH": str(project)}
    choices = (("base", "double"), ("standard", "double"), ("base", "float"))
    runs = []
    for parameters, precision in choices:
        command = [sys.executable, "-m", "symid", "generate", *NAMES, "-o", str(folder)]
        command += ["--parameters", parameters, "--precision", precision, "--json", "-q"]
        pipe = subprocess.PIPE
        runs.append(subprocess.Popen(command, env=environment, stdout=pipe, stderr=pipe, text=True))
    said = [run.communicate()[0] for run in runs]
    assert [run.returncode for run in runs] == [0, 0, 0], said
    found = []
    for parameters, precision in choices:
        order = (*NAMES, "--parameters", parameters, "--precision", precision)
        before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
        copy = shutil.copytree(folder, tmp_path / f"{parameters}_{precision}")
        answer = do("generate", *order, "-o", copy)
        found.append(answer["result"]["unchanged"])
        assert before == {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    assert sorted(found) == [False, False, True]
    assert sorted(path.name for path in tmp_path.iterdir() if path.name.startswith(".")) == []


def test_a_run_that_waits_says_so(capfd, tmp_path):
    from symid.codegen.generation import lock_folder

    folder = tmp_path / "code"
    done = []
    order = ["generate", *NAMES, "--target", "python", "-o", str(folder)]
    with lock_folder(folder, lambda: None):
        thread = threading.Thread(target=lambda: done.append(run_cli(order)))
        thread.start()
        thread.join(timeout=4)
        assert thread.is_alive()
        assert not folder.exists()
    thread.join()
    assert done == [0]
    assert "waiting for another run" in capfd.readouterr().err
