"""Generated sources, and how they reach a folder.

Input: `SourceSet`. Output: files on disk, all or none, with a manifest that names them.

Supported: new folders, empty ones, and folders that symid wrote before.
Not supported: writing over files that symid did not write, or that were edited since.
"""

import contextlib
import hashlib
import json
import os
import secrets
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from symid.errors import Notice, OutputError

__all__ = ["MANIFEST", "SourceSet", "find_digest", "read_manifest", "write_sources"]

MANIFEST = "manifest.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceSet:
    """Files by their path in the folder, and the text of the manifest that lists them."""

    name: str
    files: tuple[tuple[str, str], ...]
    manifest: str


def find_digest(content: bytes) -> str:
    """Return the SHA-256 of `content` in hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()


def read_manifest(folder: Path) -> Mapping[str, object] | None:
    """Return the manifest in `folder`, or None where there is none that symid wrote."""
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    ours = isinstance(manifest, dict) and "symid" in manifest and isinstance(manifest.get("files"), dict)
    return manifest if ours else None


def _read_listed(folder: Path) -> dict[str, str] | None:
    """Return the digests of the files that the manifest in `folder` lists."""
    manifest = read_manifest(folder)
    files = manifest["files"] if manifest else None
    if not isinstance(files, dict):
        return None
    return {str(path): str(digest) for path, digest in files.items() if _is_inside(str(path))}


def _is_inside(path: str) -> bool:
    return not Path(path).is_absolute() and ".." not in Path(path).parts


def _check_folder(folder: Path, listed: Mapping[str, str] | None, *, force: bool) -> None:
    if folder.exists() and not folder.is_dir():
        text = "is a file, not a folder; give the name of a folder"
        raise OutputError(Notice(code="output.not-a-folder", text=text, file=str(folder)))
    if listed is None and not force and folder.is_dir() and any(folder.iterdir()):
        text = "is not empty and holds no manifest of symid; give an empty folder, or force"
        raise OutputError(Notice(code="output.foreign-folder", text=text, file=str(folder)))


def _check_files(folder: Path, sources: SourceSet, listed: Mapping[str, str], *, force: bool) -> None:
    notices = []
    for path, text in (*sources.files, (MANIFEST, sources.manifest)):
        target = folder / path
        if not os.path.lexists(target) or (path == MANIFEST and listed):
            continue
        found = find_digest(target.read_bytes()) if target.is_file() and not target.is_symlink() else ""
        if found == find_digest(text.encode()):
            continue
        if path not in listed:
            why = "stands in the way and was not written by symid; move it, or give another folder"
            notices.append(Notice(code="output.foreign-file", text=why, file=str(target)))
        elif found != listed[path] and not force:
            why = "was edited since symid wrote it; move it, or force to lose the changes"
            notices.append(Notice(code="output.edited-file", text=why, file=str(target)))
    if notices:
        raise OutputError(*notices)


def _write_new(sources: SourceSet, staging: Path) -> None:
    staging.mkdir(parents=True)
    for path, text in (*sources.files, (MANIFEST, sources.manifest)):
        target = staging / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(text.encode())


def _remove_stale(folder: Path, sources: SourceSet, listed: Mapping[str, str]) -> None:
    kept = {path for path, _ in sources.files}
    for path, digest in sorted(listed.items()):
        target = folder / path
        if path not in kept and target.is_file() and find_digest(target.read_bytes()) == digest:
            target.unlink()


def _move_in(sources: SourceSet, staging: Path, folder: Path, listed: Mapping[str, str]) -> None:
    if not folder.exists() or not any(folder.iterdir()):
        # One rename: the folder is there with all its files, or not at all.
        staging.rename(folder)
        return
    for path, _ in sources.files:
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (staging / path).replace(folder / path)
    _remove_stale(folder, sources, listed)
    # Last: until here the old manifest speaks for the folder.
    (staging / MANIFEST).replace(folder / MANIFEST)


def write_sources(sources: SourceSet, folder: Path, *, force: bool = False) -> tuple[Path, ...]:
    """Write `sources` into `folder` and return the paths of the files, the manifest last.

    Files that the last run wrote and this one does not are removed if nobody changed them. With
    `force`, a folder that is not empty is accepted and edited files are written anew; a file that
    symid did not write is never touched.

    Raises:
        OutputError: the folder or a file in it is not ours, or cannot be written.
    """
    listed = _read_listed(folder)
    _check_folder(folder, listed, force=force)
    _check_files(folder, sources, listed or {}, force=force)
    target = folder.resolve()
    staging = target.parent / f".{target.name}-{secrets.token_hex(6)}"
    try:
        _write_new(sources, staging)
        _move_in(sources, staging, target, listed or {})
    except OSError as error:
        text = f"cannot be written: {error.strerror or error}"
        raise OutputError(Notice(code="output.cannot-write", text=text, file=str(folder))) from error
    finally:
        with contextlib.suppress(FileNotFoundError):
            shutil.rmtree(staging)
    return tuple(folder / path for path, _ in (*sources.files, (MANIFEST, "")))
