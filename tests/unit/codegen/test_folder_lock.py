"""One at a time in a folder, and nothing is left of the lock beside it."""

import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from symid.codegen.generation import lock_folder


def test_one_at_a_time_and_nothing_is_left(tmp_path):
    inside, most, entered = [], [], []

    def run(number):
        for _ in range(5):
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
    assert len(entered) == 20
    assert max(most) == 1
    assert list(tmp_path.iterdir()) == []


def test_one_folder_by_two_names_is_one_folder(tmp_path):
    told = []
    (tmp_path / "out").mkdir()
    (tmp_path / "link").symlink_to("out")

    def wait():
        with lock_folder(tmp_path / "link", lambda: told.append(True)):
            told.append("in")

    with lock_folder(tmp_path / "out", lambda: None):
        thread = threading.Thread(target=wait)
        thread.start()
        thread.join(timeout=1.5)
        assert told == [True]
    thread.join()
    assert told == [True, "in"]


def test_it_is_given_back_after_an_error(tmp_path):
    with pytest.raises(ZeroDivisionError), lock_folder(tmp_path / "out", lambda: None):
        _ = 1 / 0
    with lock_folder(tmp_path / "out", lambda: pytest.fail("waited")):
        assert list(tmp_path.iterdir()) == []


def test_other_folders_are_not_locked(tmp_path):
    with (
        lock_folder(tmp_path / "out", lambda: None),
        lock_folder(tmp_path / "other", lambda: pytest.fail("waited")),
    ):
        pass


HOLD = """
import sys, time
from pathlib import Path
from symid.codegen.generation import lock_folder
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
