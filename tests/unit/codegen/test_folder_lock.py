"""One at a time in a folder, and nothing is left of the lock."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from symid.codegen.source_folder import lock_folder


def test_one_at_a_time_and_nothing_is_left(tmp_path):
    inside, most, entered = [], [], []

    def run(number):
        for _ in range(20):
            with lock_folder(tmp_path / "deep" / "er" / "out", lambda: None):
                inside.append(number)
                most.append(len(inside))
                time.sleep(0.0005)
                inside.remove(number)
                entered.append(number)

    threads = [threading.Thread(target=run, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(entered) == 80
    assert max(most) == 1
    # A parent that one made and another used may stay, without anything in it.
    assert [path for path in tmp_path.rglob("*") if not path.is_dir()] == []


def test_parents_that_nothing_came_into_go(tmp_path):
    with lock_folder(tmp_path / "deep" / "er" / "out", lambda: None):
        pass
    assert list(tmp_path.iterdir()) == []


def test_parents_stay_where_something_came_into_them(tmp_path):
    out = tmp_path / "deep" / "out"
    with lock_folder(out, lambda: None):
        out.mkdir()
    assert [path.name for path in out.parent.iterdir()] == ["out"]


def test_it_is_given_back_after_an_error(tmp_path):
    with pytest.raises(ZeroDivisionError), lock_folder(tmp_path / "out", lambda: None):
        _ = 1 / 0
    with lock_folder(tmp_path / "out", lambda: pytest.fail("waited")):
        assert [path.name for path in tmp_path.iterdir()] == [".out.symid-lock"]


HOLD = """
import sys, time
from pathlib import Path
from symid.codegen.source_folder import lock_folder
with lock_folder(Path(sys.argv[1]), lambda: None):
    print("locked", flush=True)
    time.sleep(60)
"""


def test_a_killed_process_holds_nothing(tmp_path, project):
    command = [sys.executable, "-c", HOLD, str(tmp_path / "out")]
    environment = {**os.environ, "PYTHONPATH": str(project)}
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "locked\n"
        told = []

        def tell():
            told.append(True)
            process.send_signal(signal.SIGKILL)

        with lock_folder(tmp_path / "out", tell):
            assert told == [True]
    assert list(tmp_path.iterdir()) == []


def test_where_no_file_can_be_made_the_folder_itself_is_locked(tmp_path, monkeypatch):
    out, told = tmp_path / "out", []
    out.mkdir()
    before = os.open

    def refuse(path, flags, *mode, **options):
        if str(path).endswith("-lock"):
            raise PermissionError(13, "Permission denied")
        return before(path, flags, *mode, **options)

    monkeypatch.setattr(os, "open", refuse)

    def wait():
        with lock_folder(out, lambda: told.append(True)):
            told.append("in")

    with lock_folder(out, lambda: None):
        thread = threading.Thread(target=wait)
        thread.start()
        thread.join(timeout=1.5)
        assert told == [True]
    thread.join()
    assert told == [True, "in"]
    assert list(tmp_path.iterdir()) == [out]
    out.rmdir()
    with lock_folder(out, lambda: None):
        assert list(tmp_path.iterdir()) == []


def test_where_there_are_no_locks_nobody_waits(tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError(37, "No locks available")

    monkeypatch.setattr("fcntl.flock", refuse)
    with lock_folder(tmp_path / "out", lambda: None), lock_folder(tmp_path / "out", lambda: None):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_file_in_the_place_of_a_parent_is_left_to_the_writer(tmp_path):
    (tmp_path / "file").write_text("mine")
    for folder in (tmp_path / "file" / "out", tmp_path / "file" / "deep" / "out"):
        with lock_folder(folder, lambda: None):
            assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.skipif(
    not Path("/proc/self").is_dir(), reason="wants a file system in which nothing can be made"
)
def test_where_no_file_can_be_made_nobody_waits():
    with lock_folder(Path("/proc/no-such-folder"), lambda: None):
        pass
