"""Sources reach a folder whole or not at all, and never over somebody else's files."""

import json
from pathlib import Path

import pytest

from symid.codegen.writer import MANIFEST, SourceSet, find_digest, write_sources
from symid.errors import OutputError


def sources(**files):
    listed = {f"{name}.c": text for name, text in files.items()}
    manifest = {"symid": "0", "files": {path: find_digest(text.encode()) for path, text in listed.items()}}
    return SourceSet(name="x", files=tuple(listed.items()), manifest=json.dumps(manifest))


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def code(caught):
    return [notice.code for notice in caught.value.notices]


def test_a_new_folder_holds_all_files_and_nothing_else_is_left(tmp_path):
    paths = write_sources(sources(a="1", b="2"), tmp_path / "out")
    assert [path.name for path in paths] == ["a.c", "b.c", MANIFEST]
    assert names(tmp_path / "out") == ["a.c", "b.c", MANIFEST]
    assert names(tmp_path) == ["out"]


def test_stale_files_go_if_unchanged_and_a_users_files_stay(tmp_path):
    write_sources(sources(a="1", b="2", c="3"), tmp_path)
    (tmp_path / "mine.c").write_text("mine")
    (tmp_path / "c.c").write_text("edited")
    write_sources(sources(a="new"), tmp_path)
    assert names(tmp_path) == ["a.c", "c.c", MANIFEST, "mine.c"]
    assert (tmp_path / "a.c").read_text() == "new"
    assert (tmp_path / "mine.c").read_text() == "mine"


def test_a_foreign_folder_is_refused(tmp_path):
    (tmp_path / "thesis.tex").write_text("x")
    with pytest.raises(OutputError, match="not empty") as caught:
        write_sources(sources(a="1"), tmp_path)
    assert code(caught) == ["output.foreign-folder"]
    assert names(tmp_path) == ["thesis.tex"]
    write_sources(sources(a="1"), tmp_path, force=True)
    assert names(tmp_path) == ["a.c", MANIFEST, "thesis.tex"]


@pytest.mark.parametrize("force", [False, True])
def test_a_foreign_file_in_the_way_is_never_overwritten(tmp_path, force):
    write_sources(sources(a="1"), tmp_path)
    (tmp_path / "b.c").write_text("mine")
    with pytest.raises(OutputError, match="stands in the way") as caught:
        write_sources(sources(a="2", b="2"), tmp_path, force=force)
    assert code(caught) == ["output.foreign-file"]
    assert (tmp_path / "a.c").read_text() == "1"
    assert (tmp_path / "b.c").read_text() == "mine"


def test_a_foreign_manifest_is_never_overwritten(tmp_path):
    (tmp_path / MANIFEST).write_text("{}")
    with pytest.raises(OutputError, match="stands in the way"):
        write_sources(sources(a="1"), tmp_path, force=True)
    assert (tmp_path / MANIFEST).read_text() == "{}"


def test_an_edited_file_wants_force(tmp_path):
    write_sources(sources(a="1"), tmp_path)
    (tmp_path / "a.c").write_text("edited")
    with pytest.raises(OutputError, match="was edited") as caught:
        write_sources(sources(a="2"), tmp_path)
    assert code(caught) == ["output.edited-file"]
    write_sources(sources(a="2"), tmp_path, force=True)
    assert (tmp_path / "a.c").read_text() == "2"


def test_a_file_instead_of_a_folder_is_refused(tmp_path):
    (tmp_path / "out").write_text("x")
    with pytest.raises(OutputError, match="is a file") as caught:
        write_sources(sources(a="1"), tmp_path / "out")
    assert code(caught) == ["output.not-a-folder"]


def test_an_interrupted_first_write_leaves_nothing(tmp_path, monkeypatch):
    def fail(self, target):
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "rename", fail)
    with pytest.raises(KeyboardInterrupt):
        write_sources(sources(a="1"), tmp_path / "out")
    assert names(tmp_path) == []


def test_an_interrupted_second_write_can_be_repeated(tmp_path, monkeypatch):
    out = tmp_path / "out"
    write_sources(sources(a="1", b="1"), out)
    replace, calls = Path.replace, []

    def fail_second(self, target):
        calls.append(target)
        if len(calls) == 2:
            raise OSError(28, "No space left on device")
        return replace(self, target)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", fail_second)
        with pytest.raises(OutputError, match="No space left") as caught:
            write_sources(sources(a="2", b="2"), out)
    assert code(caught) == ["output.cannot-write"]
    assert names(tmp_path) == ["out"]
    write_sources(sources(a="2", b="2"), out)
    assert [(out / name).read_text() for name in ("a.c", "b.c")] == ["2", "2"]


def test_an_existing_empty_folder_stays_the_same_folder(tmp_path):
    out = tmp_path / "out"
    out.mkdir(mode=0o750)
    before = out.stat()
    write_sources(sources(a="1"), out)
    after = out.stat()
    assert (after.st_ino, after.st_mode) == (before.st_ino, before.st_mode)
    assert names(out) == ["a.c", MANIFEST]
    assert names(tmp_path) == ["out"]


def test_the_current_folder_can_be_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_sources(sources(a="1"), Path())
    assert sorted(path.name for path in Path().iterdir()) == ["a.c", MANIFEST]


@pytest.mark.parametrize("first", [True, False])
def test_after_an_interrupted_update_another_one_needs_no_force(tmp_path, monkeypatch, first):
    out = tmp_path / "out"
    out.mkdir()
    if not first:
        write_sources(sources(a="1", b="1"), out)
    replace, calls = Path.replace, []

    def fail_third(self, target):
        calls.append(target)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return replace(self, target)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", fail_third)
        with pytest.raises(KeyboardInterrupt):
            write_sources(sources(a="2", b="2", c="2"), out)
    assert (out / "a.c").read_text() == "2"
    write_sources(sources(a="3", c="3"), out)
    assert names(out) == ["a.c", "c.c", MANIFEST]
    assert (out / "a.c").read_text() == "3"


def test_after_an_interrupted_update_an_edited_file_is_still_told(tmp_path, monkeypatch):
    write_sources(sources(a="1", b="1"), tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr("symid.codegen.writer._remove_stale", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            write_sources(sources(a="2", b="2"), tmp_path)
    (tmp_path / "b.c").write_text("edited")
    with pytest.raises(OutputError, match="was edited") as caught:
        write_sources(sources(a="3", b="3"), tmp_path)
    assert code(caught) == ["output.edited-file"]
