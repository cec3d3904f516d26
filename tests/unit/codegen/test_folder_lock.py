"""One at a time in a folder, and nothing is left of the lock beside it."""

import os
import signal
import subprocess
import sys
import threading

import pytest

from symid.codegen import cache
from symid.codegen.cache import lock_folder
from symid.errors import OutputError
from tests.refusals import raises


@pytest.mark.parametrize(("name", "other"), [("out", "link"), ("deep/out", "deep/out")])
def test_whoever_wants_the_same_folder_waits(tmp_path, name, other):
    """By another name of it, or while the folders above it are made."""
    told = []
    if other == "link":
        (tmp_path / "out").mkdir()
        (tmp_path / "link").symlink_to("out")

    def wait():
        with lock_folder(tmp_path / other, lambda: told.append("waits")):
            told.append("in")

    with lock_folder(tmp_path / name, lambda: None):
        thread = threading.Thread(target=wait)
        thread.start()
        thread.join(timeout=1.5)
        assert told == ["waits"]
    thread.join()
    assert told == ["waits", "in"]
    if other != "link":
        assert list(tmp_path.rglob("*")) in ([], [tmp_path / "deep"])


@pytest.mark.parametrize("name", ["out", "deep/er/out"])
def test_it_is_given_back_after_an_error(tmp_path, name):
    with pytest.raises(ZeroDivisionError), lock_folder(tmp_path / name, lambda: None):
        _ = 1 / 0
    assert list(tmp_path.iterdir()) == []
    with lock_folder(tmp_path / name, lambda: pytest.fail("waited")):
        pass
    assert list(tmp_path.iterdir()) == []


HOLD = """
import sys, time
from pathlib import Path
from symid.codegen.cache import lock_folder
with lock_folder(Path(sys.argv[1]), lambda: None):
    print("locked", flush=True)
    time.sleep(60)
"""


def test_a_killed_process_with_another_temporary_folder_holds_nothing(tmp_path, tmp_path_factory, project):
    command = [sys.executable, "-c", HOLD, str(tmp_path / "out")]
    environment = {**os.environ, "PYTHONPATH": str(project), "TMPDIR": str(tmp_path_factory.mktemp("other"))}
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "locked\n"
        told = []

        def tell():
            told.append(True)
            process.send_signal(signal.SIGKILL)

        with lock_folder(tmp_path / "out", tell):
            assert told == [True]
    assert list(tmp_path.iterdir()) == []


TAKE = """
import os, sys
from pathlib import Path
from symid.codegen.cache import lock_folder
inside = Path(sys.argv[2])
for _ in range(40):
    with lock_folder(Path(sys.argv[1]), lambda: None):
        os.close(os.open(inside, os.O_CREAT | os.O_EXCL))
        inside.unlink()
"""


def test_processes_with_their_own_temporary_folders_take_turns(tmp_path, tmp_path_factory, project):
    place = tmp_path_factory.mktemp("place")
    running = []
    for number in range(3):
        own = tmp_path / f"{number}"
        own.mkdir()
        environment = {**os.environ, "PYTHONPATH": str(project), "TMPDIR": str(own)}
        command = [sys.executable, "-c", TAKE, str(place / "out"), str(tmp_path / "inside")]
        running.append(subprocess.Popen(command, env=environment))
    assert [process.wait(timeout=100) for process in running] == [0, 0, 0]
    assert list(place.iterdir()) == []


def test_beside_a_folder_that_cannot_be_written_the_cache_folder_has_the_lock(tmp_path, monkeypatch):
    (tmp_path / "place").mkdir()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(os, "access", lambda *_: False)
    with lock_folder(tmp_path / "place" / "out", lambda: None):
        assert [path.suffix for path in (tmp_path / "cache" / "symid").iterdir()] == [".lock"]
        assert list((tmp_path / "place").iterdir()) == []
    assert list((tmp_path / "cache" / "symid").iterdir()) == []


def test_a_lock_that_cannot_be_written_is_said(tmp_path, monkeypatch):
    (tmp_path / ".out.symid-lock").mkdir()
    with raises(OutputError, "output.cannot-write") as caught, lock_folder(tmp_path / "out", print):
        pass
    assert caught.value.notices[0].file == str(tmp_path / "out")
    monkeypatch.setattr(os, "access", lambda *_: False)
    monkeypatch.setattr(cache, "locate_user_folder", lambda: None)
    with pytest.raises(OutputError, match="Permission denied"), lock_folder(tmp_path / "other", print):
        pass
