"""Generated sources, and how they reach a folder.

Input: `SourceSet`. Output: files on disk with a manifest that names them, at any moment the old ones or the
new ones: a new folder appears by one rename; one that symid wrote before changes places with a new one, in
which the files of others are the same. Where that cannot be, on systems without such a call, for the working
folder and for mounted ones, files are moved in one by one, the manifest last.

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
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from symid.codegen.folder_exchange import copy_owner, exchange_folders, link_missing, write_through
from symid.errors import Notice, OutputError

__all__ = [
    "MANIFEST",
    "SourceSet",
    "find_digest",
    "find_listed",
    "is_unchanged",
    "read_manifest",
    "write_manifest_text",
    "write_sources",
]

MANIFEST = "manifest.json"
_UPDATE = ".symid-update-"
_AT_ONCE = 16

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


def is_unchanged(folder: Path, manifest: Mapping[str, object]) -> bool:
    """Return whether every file that `manifest` lists is as it says, and no update was interrupted."""
    try:
        found = (find_digest((folder / path).read_bytes()) == d for path, d in find_listed(manifest).items())
        return all(found) and not _find_remains(folder)
    except OSError:
        return False


def write_manifest_text(text: str, folder: Path) -> None:
    """Put another manifest into a folder that symid wrote, in one step.

    Raises:
        OutputError: it cannot be written.
    """
    target = folder.resolve()
    staging = target / f"{_UPDATE}{secrets.token_hex(6)}"
    try:
        staging.mkdir()
        (staging / MANIFEST).write_bytes(text.encode())
        write_through(staging / MANIFEST)
        with contextlib.suppress(OSError):
            copy_owner(target / MANIFEST, staging / MANIFEST)
        (staging / MANIFEST).replace(target / MANIFEST)
        write_through(target)
    except OSError as error:
        raise _fail_write(error, folder) from error
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def _fail_write(error: OSError, folder: Path) -> OutputError:
    text = f"cannot be written: {error.strerror or error}"
    return OutputError(Notice(code="output.cannot-write", text=text, file=str(folder)))


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
    # All are written by now: the disk takes them at once, which is faster than one after another.
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        tuple(pool.map(write_through, (*staging.rglob("*"), staging)))


def _give_away(folder: Path, staging: Path) -> None:
    """Let what was made for `folder` belong to whom it belongs."""
    for path in (staging, *sorted(staging.rglob("*"))):
        copy_owner(folder, path)


def _find_stale(folder: Path, sources: SourceSet, listed: Listed) -> list[Path]:
    """Return the files of the last run that this one does not write, if nobody changed them."""
    kept = {path for path, _ in sources.files}
    stale = []
    for path, digests in sorted(listed.items()):
        target = folder / path
        if path not in kept and target.is_file() and find_digest(target.read_bytes()) in digests:
            stale.append(target)
    return stale


def _remove_stale(folder: Path, sources: SourceSet, listed: Listed) -> None:
    for path in _find_stale(folder, sources, listed):
        path.unlink()


def _is_in_use(folder: Path) -> bool:
    """Return whether this process works in `folder`, which must then stay the same one."""
    try:
        return Path.cwd().is_relative_to(folder)
    except OSError:
        return True


def _find_folders(folder: Path) -> list[Path]:
    """Return `folder` and those in it, which name its files."""
    inner = (path for path in sorted(folder.rglob("*")) if path.is_dir() and not path.is_symlink())
    return [folder, *inner]


def _exchange_folder(sources: SourceSet, folder: Path, listed: Listed) -> bool:
    """Write a new folder with the files of others in it, and let it change places with `folder`."""
    if _is_in_use(folder):
        return False
    staging = folder.parent / f".{folder.name}-{secrets.token_hex(6)}"
    dropped = [*_find_stale(folder, sources, listed), *_find_remains(folder)]
    left_out = frozenset(path.relative_to(folder) for path in dropped)
    try:
        _write_new(sources, staging)
        _give_away(folder, staging)
        if not link_missing(folder, staging, left_out):
            return False
        shutil.copystat(folder, staging)
        for place in _find_folders(staging):
            write_through(place)
        if not exchange_folders(folder, staging):
            return False
        with contextlib.suppress(OSError):
            write_through(folder.parent)
        # What somebody put there in the meantime; where that fails, the new folder is whole all the same.
        with contextlib.suppress(OSError):
            link_missing(staging, folder, left_out)
    except OSError:
        return False
    finally:
        shutil.rmtree(staging, ignore_errors=True)
    return True


def _write_folder(sources: SourceSet, folder: Path) -> None:
    """Make `folder` by one rename: it is there with all its files, or not at all."""
    staging = folder.parent / f".{folder.name}-{secrets.token_hex(6)}"
    try:
        _write_new(sources, staging)
        staging.rename(folder)
        with contextlib.suppress(OSError):
            write_through(folder.parent)
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def _update_folder(sources: SourceSet, folder: Path, listed: Listed) -> None:
    """Move the files into `folder` one by one; the folder itself stays what it is."""
    remains = _find_remains(folder)
    staging = folder / f"{_UPDATE}{secrets.token_hex(6)}"
    moved = False
    try:
        _write_new(sources, staging)
        # Who may not give files away leaves them to the user who ran this.
        with contextlib.suppress(OSError):
            _give_away(folder, staging)
        for path, _ in sources.files:
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            moved = True
            (staging / path).replace(folder / path)
        _remove_stale(folder, sources, listed)
        for place in sorted({(folder / path).parent for path, _ in sources.files}):
            write_through(place)
        # Last: until here the old manifest and the one in the staging folder speak for the files.
        (staging / MANIFEST).replace(folder / MANIFEST)
        write_through(folder)
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
        if not target.is_dir():
            _write_folder(sources, target)
        elif listed is None or not _exchange_folder(sources, target, listed):
            _update_folder(sources, target, listed or {})
    except OSError as error:
        raise _fail_write(error, folder) from error
    return tuple(folder / path for path, _ in (*sources.files, (MANIFEST, "")))
