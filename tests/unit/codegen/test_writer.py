"""Sources reach a folder file by file, each whole, and never over somebody else's files."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from symid.codegen.source_folder import (
    MANIFEST,
    SourceSet,
    compute_digest,
    is_unchanged,
    read_manifest,
    write_sources,
)
from symid.errors import OutputError
from tests.refusals import raises


def build_set(files):
    """Return a set of sources from {path: text}."""
    digests = {path: compute_digest(text.encode()) for path, text in files.items()}
    return SourceSet(files=tuple(files.items()), manifest=json.dumps({"symid": "0", "files": digests}))


def sources(**files):
    return build_set({f"{name}.c": text for name, text in files.items()})


def nest(*paths):
    return build_set(dict.fromkeys(paths, "text"))


def names(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("kind", ["new", "empty", "current"])
def test_a_folder_holds_all_files_and_nothing_else_is_left(tmp_path, monkeypatch, kind):
    out = tmp_path / "out"
    if kind != "new":
        out.mkdir(mode=0o750)
        before = out.stat()
    if kind == "current":
        monkeypatch.chdir(out)
    paths = write_sources(sources(a="1", b="2"), Path() if kind == "current" else out)
    assert [path.name for path in paths] == names(out) == ["a.c", "b.c", MANIFEST]
    assert names(tmp_path) == ["out"]
    if kind != "new":
        after = out.stat()
        assert (after.st_ino, after.st_mode) == (before.st_ino, before.st_mode)


def test_stale_files_go_if_unchanged_and_a_users_files_stay(tmp_path):
    write_sources(sources(a="1", b="2", c="3"), tmp_path)
    (tmp_path / "mine.c").write_text("mine")
    (tmp_path / "c.c").write_text("edited")
    write_sources(sources(a="new"), tmp_path)
    assert names(tmp_path) == ["a.c", "c.c", MANIFEST, "mine.c"]
    assert (tmp_path / "a.c").read_text() == "new"
    assert (tmp_path / "mine.c").read_text() == "mine"


def test_subfolders_that_a_run_leaves_empty_go_and_others_stay(tmp_path):
    write_sources(nest("a.c", "old/deep/b.c", "kept/c.c"), tmp_path)
    (tmp_path / "kept" / "mine.c").write_text("mine")
    (tmp_path / "empty").mkdir()
    write_sources(nest("a.c"), tmp_path)
    assert names(tmp_path) == ["a.c", "empty", "kept", MANIFEST]
    assert names(tmp_path / "kept") == ["mine.c"]


FORCED = pytest.mark.parametrize("force", [False, True])


@FORCED
def test_nothing_is_written_or_removed_through_a_link(tmp_path, force):
    folder, foreign = tmp_path / "out", tmp_path / "foreign"
    write_sources(nest("a.c", "src/b.c"), folder)
    (folder / "src").rename(foreign)
    (folder / "src").symlink_to(foreign)
    with raises(OutputError, "output.linked-folder", match="src"):
        write_sources(nest("a.c", "src/b.c", "src/deep/c.c"), folder, force=force)
    write_sources(nest("a.c"), folder, force=force)
    assert names(foreign) == ["b.c"]
    assert (folder / "src").is_symlink()


@FORCED
@pytest.mark.parametrize("name", ["thesis.tex", "a.c", ".git", MANIFEST])
def test_a_foreign_folder_is_refused(tmp_path, name, force):
    (tmp_path / name).write_text("{}")
    with raises(OutputError, "output.foreign-folder"):
        write_sources(sources(a="1"), tmp_path, force=force)
    assert names(tmp_path) == [name]
    assert (tmp_path / name).read_text() == "{}"


@FORCED
def test_a_foreign_file_in_the_way_is_never_overwritten(tmp_path, force):
    write_sources(sources(a="1"), tmp_path)
    (tmp_path / "b.c").write_text("mine")
    with raises(OutputError, "output.foreign-file"):
        write_sources(sources(a="2", b="2"), tmp_path, force=force)
    assert [(tmp_path / name).read_text() for name in ("a.c", "b.c")] == ["1", "mine"]


def test_an_edited_file_wants_force(tmp_path):
    write_sources(sources(a="1"), tmp_path)
    (tmp_path / "a.c").write_text("edited")
    with raises(OutputError, "output.edited-file"):
        write_sources(sources(a="2"), tmp_path)
    (tmp_path / "b.c").write_text("mine")
    write_sources(sources(a="2"), tmp_path, force=True)
    assert [(tmp_path / name).read_text() for name in ("a.c", "b.c")] == ["2", "mine"]


def test_a_file_instead_of_a_folder_is_refused(tmp_path):
    (tmp_path / "out").write_text("x")
    with raises(OutputError, "output.not-a-folder"):
        write_sources(sources(a="1"), tmp_path / "out")


def test_an_interrupted_first_write_leaves_nothing(tmp_path, monkeypatch):
    def fail(self, target):
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "rename", fail)
    with pytest.raises(KeyboardInterrupt):
        write_sources(sources(a="1"), tmp_path / "out")
    assert names(tmp_path) == []


def test_an_interrupted_second_write_can_be_repeated(tmp_path, monkeypatch):
    """What is edited meanwhile is told as ever."""

    def fail(*_):
        raise OSError(28, "No space left on device")

    out = tmp_path / "out"
    write_sources(sources(a="1", b="1"), out)
    with monkeypatch.context() as patch:
        patch.setattr("symid.codegen.source_folder._remove_stale_files", fail)
        with raises(OutputError, "output.cannot-write", match="No space left"):
            write_sources(sources(a="2", b="2"), out)
    assert names(tmp_path) == ["out"]
    (out / "b.c").write_text("edited")
    with raises(OutputError, "output.edited-file"):
        write_sources(sources(a="3", b="3"), out)
    (out / "b.c").write_text("2")
    write_sources(sources(a="3", b="3"), out)
    assert [(out / name).read_text() for name in ("a.c", "b.c")] == ["3", "3"]


KILLED = """
import json, os, signal, sys
from pathlib import Path
from symid.codegen.source_folder import SourceSet, compute_digest, write_sources

calls, last = 0, 10**9

def count(event, arguments):
    # Everything that touches files, one after another: the process dies before the one of this number.
    global calls
    if event != "os.kill" and event.startswith(("open", "os.", "shutil.", "ctypes.")):
        calls += 1
        if calls > last:
            os.kill(os.getpid(), signal.SIGKILL)

files = tuple((name, "2") for name in ("a.c", "b.c", "deep/c.c", "new.c"))
digests = {path: compute_digest(text.encode()) for path, text in files}
sources = SourceSet(files=files, manifest=json.dumps({"symid": "0", "files": digests}))
sys.addaudithook(count)
# A process for each line, which need not start an interpreter.
for line in sys.stdin:
    number, folder = line.rstrip("\\n").split(" ", 1)
    child = os.fork()
    if child == 0:
        calls, last = 0, int(number)
        write_sources(sources, Path(folder))
        last = 10**9
        os._exit(0)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


@pytest.fixture(scope="module")
def run_killed(project):
    """Return a call that writes into a folder, killed before a step; whether it got through."""
    environment = {**os.environ, "PYTHONPATH": str(project)}
    command = [sys.executable, "-c", KILLED]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, env=environment, stdin=pipe, stdout=pipe, text=True) as server:

        def run(folder, number):
            server.stdin.write(f"{number} {folder}\n")
            server.stdin.flush()
            code = int(server.stdout.readline())
            assert code in {0, -signal.SIGKILL}
            return code == 0

        yield run
        server.stdin.close()


def read_texts(folder):
    files = (path for path in sorted(folder.rglob("*")) if path.is_file() and path.name != MANIFEST)
    return {path.relative_to(folder).as_posix(): path.read_text() for path in files}


OLD = {"a.c": "1", "b.c": "1", "stale.c": "1"}
NEW = {"a.c": "2", "b.c": "2", "deep/c.c": "2", "new.c": "2"}
OWN = {"mine.c": "mine", "own/notes.txt": "mine"}


def prepare_old(folder):
    folder.mkdir()
    write_sources(build_set(OLD), folder)
    (folder / "own").mkdir()
    for path, text in OWN.items():
        (folder / path).write_text(text)


@pytest.mark.parametrize("first", [True, False])
def test_a_killed_write_leaves_whole_files_and_can_be_repeated(tmp_path, run_killed, first):
    """Killed without warning before each of its steps in turn; the last run gets through."""
    seen = set()
    for number in range(400):
        folder = tmp_path / str(number) / "out"
        folder.parent.mkdir()
        if not first:
            prepare_old(folder)
        through = run_killed(folder, number)
        if first:
            assert not folder.exists() or read_texts(folder) == NEW
            seen.add(folder.exists())
        else:
            found = {path: text for path, text in read_texts(folder).items() if not path.startswith(".")}
            assert {path: found.pop(path) for path in OWN} == OWN
            assert all(text in (OLD.get(path), NEW.get(path)) for path, text in found.items())
            manifest = read_manifest(folder)
            # The manifest that is there speaks for the files, or says that it cannot.
            wanted = NEW if "new.c" in manifest["files"] else OLD
            assert not is_unchanged(folder, manifest) or found == wanted
            seen.add(found == NEW)
        if through:
            break
        assert run_killed(folder, 10**6)
        assert read_texts(folder) == (NEW if first else {**NEW, **OWN})
    assert through
    assert seen == {True, False}


def test_an_update_leaves_files_of_others_the_same_ones(tmp_path):
    out = tmp_path / "out"
    prepare_old(out)
    (out / "link").symlink_to("own/notes.txt")
    (out / "own").chmod(0o750)
    out.chmod(0o750)
    os.mkfifo(out / "pipe")
    identity, before = find_identity(out), (out / "mine.c").stat()
    write_sources(sources(a="3"), out)
    assert find_identity(out) == identity
    assert names(out) == ["a.c", "link", MANIFEST, "mine.c", "own", "pipe"]
    assert (out / "link").readlink() == Path("own/notes.txt")
    after = (out / "mine.c").stat()
    assert (after.st_ino, after.st_mtime_ns, after.st_nlink) == (before.st_ino, before.st_mtime_ns, 1)
    assert [path.stat().st_mode & 0o777 for path in (out, out / "own")] == [0o750, 0o750]
    assert names(tmp_path) == ["out"]


def find_identity(path):
    found = path.stat()
    return found.st_dev, found.st_ino


@pytest.fixture
def waited(monkeypatch):
    """What was waited for until the disk had it, in order."""
    found, fsync = [], os.fsync

    def watch(handle):
        state = os.fstat(handle)
        found.append((state.st_dev, state.st_ino))
        fsync(handle)

    monkeypatch.setattr(os, "fsync", watch)
    return found


def test_all_is_on_the_disk_before_a_new_folder_has_its_name(tmp_path, monkeypatch, waited):
    out, seen = tmp_path / "out", []
    rename = Path.rename

    def look(staging, target):
        seen.append({find_identity(path) for path in (staging, *staging.rglob("*"))} - set(waited))
        waited.clear()
        return rename(staging, target)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "rename", look)
        write_sources(nest("a.c", "deep/c.c"), out)
    assert seen == [set()]
    assert find_identity(tmp_path) in waited


def test_each_file_is_on_the_disk_before_the_manifest(tmp_path, monkeypatch, waited):
    out, seen = tmp_path / "out", []
    prepare_old(out)
    replace = Path.replace

    def look(path, target):
        seen.append((target.name, find_identity(path) in waited, find_identity(out) in waited))
        return replace(path, target)

    waited.clear()
    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", look)
        write_sources(sources(a="2", b="2"), out)
    assert seen == [("a.c", True, False), ("b.c", True, False), (MANIFEST, True, True)]


def refuse(*_):
    raise PermissionError(1, "Operation not permitted")


@pytest.mark.skipif(os.geteuid() != 0, reason="wants to be run by the superuser, who may give files away")
def test_a_folder_of_another_user_stays_that_users_and_is_written_where_it_cannot(tmp_path, monkeypatch):
    out = tmp_path / "out"
    prepare_old(out)
    for path in (out, *out.rglob("*")):
        os.chown(path, 12345, 23456)
    write_sources(sources(a="3", new="3"), out)
    owners = {(found.st_uid, found.st_gid) for found in (path.stat() for path in (out, *out.rglob("*")))}
    assert owners == {(12345, 23456)}
    monkeypatch.setattr(os, "chown", refuse)
    write_sources(sources(a="4"), out)
    assert (out / "a.c").read_text() == "4"
    assert names(tmp_path) == ["out"]
