"""Generated sources, and how they reach a folder.

Input: `SourceSet`. Output: files on disk with a manifest that names them: a new folder whole or not at
all, an existing one file by file, the manifest last.

Supported: new folders, empty ones, and folders that symid wrote before.
Not supported: writing over files that symid did not write, or that were edited since.
"""

import hashlib
import json
import os
import secrets
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from symid.errors import Notice, OutputError

__all__ = ["MANIFEST", "SourceSet", "find_digest", "find_listed", "read_manifest", "write_sources"]

MANIFEST = "manifest.json"
_UPDATE = ".symid-update-"

# The digests that a file may have to be as symid wrote it, by its path in the folder.
Listed = Mapping[str, tuple[str, ...]]


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


def find_listed(manifest: Mapping[str, object]) -> dict[str, str]:
    """Return the digests of the files that a manifest lists, by their path in the folder."""
    files = manifest.get("files")
    listed = files.items() if isinstance(files, dict) else ()
    return {str(path): str(digest) for path, digest in listed if _is_inside(str(path))}


def _read_listed(folder: Path) -> Listed | None:
    """Return the digests of what symid wrote into `folder`, None if it never did.

    An update that was interrupted leaves the manifest of its files in a folder of its own: until the
    next update succeeds, a file may be as the old manifest or as that one says.
    """
    manifests = [read_manifest(place) for place in (folder, *_find_remains(folder))]
    found = [find_listed(manifest) for manifest in manifests if manifest is not None]
    if not found:
        return None
    paths = sorted({path for files in found for path in files})
    return {path: tuple(files[path] for files in found if path in files) for path in paths}


def _find_remains(folder: Path) -> list[Path]:
    return sorted(folder.glob(f"{_UPDATE}*")) if folder.is_dir() else []


def _is_inside(path: str) -> bool:
    return not Path(path).is_absolute() and ".." not in Path(path).parts


def _check_folder(folder: Path, listed: Listed | None, *, force: bool) -> None:
    if folder.exists() and not folder.is_dir():
        text = "is a file, not a folder; give the name of a folder"
        raise OutputError(Notice(code="output.not-a-folder", text=text, file=str(folder)))
    if listed is not None or force or not folder.is_dir():
        return
    if set(folder.iterdir()) - set(_find_remains(folder)):
        text = "is not empty and holds no manifest of symid; give an empty folder, or force"
        raise OutputError(Notice(code="output.foreign-folder", text=text, file=str(folder)))


def _check_files(folder: Path, sources: SourceSet, listed: Listed, *, force: bool) -> None:
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
        elif found not in listed[path] and not force:
            why = "was edited since symid wrote it; move it, or force to lose the changes"
            notices.append(Notice(code="output.edited-file", text=why, file=str(target)))
    if notices:
        raise OutputError(*notices)


def _write_new(sources: SourceSet, staging: Path) -> None:
    staging.mkdir(parents=True)
    # The manifest first: what is left of an interrupted update says what it was about to write.
    for path, text in ((MANIFEST, sources.manifest), *sources.files):
        target = staging / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(text.encode())


def _remove_stale(folder: Path, sources: SourceSet, listed: Listed) -> None:
    kept = {path for path, _ in sources.files}
    for path, digests in sorted(listed.items()):
        target = folder / path
        if path not in kept and target.is_file() and find_digest(target.read_bytes()) in digests:
            target.unlink()


def _write_folder(sources: SourceSet, folder: Path) -> None:
    """Make `folder` by one rename: it is there with all its files, or not at all."""
    staging = folder.parent / f".{folder.name}-{secrets.token_hex(6)}"
    try:
        _write_new(sources, staging)
        staging.rename(folder)
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def _update_folder(sources: SourceSet, folder: Path, listed: Listed) -> None:
    """Move the files into `folder` one by one; the folder itself stays what it is."""
    remains = _find_remains(folder)
    staging = folder / f"{_UPDATE}{secrets.token_hex(6)}"
    moved = False
    try:
        _write_new(sources, staging)
        for path, _ in sources.files:
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            moved = True
            (staging / path).replace(folder / path)
        _remove_stale(folder, sources, listed)
        # Last: until here the old manifest and the one in the staging folder speak for the files.
        (staging / MANIFEST).replace(folder / MANIFEST)
    except BaseException:
        if not moved:
            shutil.rmtree(staging, ignore_errors=True)
        raise
    for place in (staging, *remains):
        shutil.rmtree(place, ignore_errors=True)


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
    try:
        if target.is_dir():
            _update_folder(sources, target, listed or {})
        else:
            _write_folder(sources, target)
    except OSError as error:
        text = f"cannot be written: {error.strerror or error}"
        raise OutputError(Notice(code="output.cannot-write", text=text, file=str(folder))) from error
    return tuple(folder / path for path, _ in (*sources.files, (MANIFEST, "")))
