"""Generated sources, and how they reach a folder.

A new folder appears by one rename. In an existing one each file is replaced in one step, the manifest last:
an update that was interrupted leaves a hidden folder with the manifest of its files, by which the next one
knows them as its own.

Supported: new folders, empty ones, and folders that symid wrote before.
Not supported: writing over files that symid did not write, or, unless forced, that were edited since; links
in place of subfolders.
"""

import contextlib
import errno
import hashlib
import json
import os
import secrets
import shutil
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from symid import __version__
from symid.environment import clear_scratch, mark_scratch
from symid.errors import Notice, OutputError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

MANIFEST = "manifest.json"
_UPDATE_PREFIX = ".symid-update-"
_SYNC_WORKERS = 16

# The digests that a file may have to be as symid wrote it, by its path in the folder.
ListedDigests = Mapping[str, tuple[str, ...]]


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceSet:
    """Files by their path in the folder, and the text of the manifest that lists them."""

    files: tuple[tuple[str, str], ...]
    manifest: str


def compute_digest(content: bytes) -> str:
    """Return the SHA-256 of `content` in hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()


def list_sources(
    files: Sequence[tuple[str, str]], operations: Mapping[str, "DataclassInstance"], **facts: object
) -> SourceSet:
    """Return `files` with their manifest: what wrote them, digests, operations by function, other facts."""
    manifest = {
        "symid": __version__,
        "operations": {name: asdict(count) for name, count in operations.items()},
        "files": {path: compute_digest(text.encode()) for path, text in files},
        **facts,
    }
    return SourceSet(files=tuple(files), manifest=json.dumps(manifest, indent=1, sort_keys=True) + "\n")


def read_manifest(folder: Path) -> Mapping[str, object] | None:
    """Return the manifest in `folder`, or None where there is none that symid wrote."""
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    ours = isinstance(manifest, dict) and "symid" in manifest and isinstance(manifest.get("files"), dict)
    return manifest if ours else None


def get_listed_digests(manifest: Mapping[str, object]) -> dict[str, str]:
    """Return the digests of the files that a manifest lists, by their path in the folder."""
    files = manifest.get("files")
    listed = files.items() if isinstance(files, dict) else ()
    digests = {Path(path): str(digest) for path, digest in listed}
    inside = {path: d for path, d in digests.items() if not path.is_absolute() and ".." not in path.parts}
    return {path.as_posix(): digest for path, digest in inside.items()}


def list_interrupted_updates(folder: Path) -> list[Path]:
    """Return what interrupted updates of `folder` left in it."""
    return sorted(folder.glob(f"{_UPDATE_PREFIX}*")) if folder.is_dir() else []


def is_unchanged(folder: Path, manifest: Mapping[str, object]) -> bool:
    """Return whether every file that `manifest` lists has its digest, and no update was interrupted."""
    listed = get_listed_digests(manifest)
    try:
        same = all(compute_digest((folder / path).read_bytes()) == listed[path] for path in listed)
    except OSError:
        return False
    return same and not list_interrupted_updates(folder)


def _sync_to_disk(path: Path) -> None:
    """Wait until a file, or the names in a folder, would outlast a power cut."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:
        # Some file systems have no such thing for folders.
        if error.errno not in {errno.EINVAL, errno.ENOTSUP}:
            raise
    finally:
        os.close(handle)


def _read_listed(folder: Path) -> tuple[ListedDigests, bool]:
    """Return the digests of the files that symid wrote, and whether a manifest of symid is there."""
    # After an interrupted update, a file may be as the old manifest says or as that of the update does.
    manifests = [read_manifest(place) for place in (folder, *list_interrupted_updates(folder))]
    found = [get_listed_digests(manifest) for manifest in manifests if manifest is not None]
    paths = sorted({path for files in found for path in files})
    return {path: tuple(files[path] for files in found if path in files) for path in paths}, bool(found)


def check_folder(folder: Path, sources: SourceSet | None = None, *, force: bool = False) -> None:
    """Raise OutputError where symid did not write the folder, or a file that `sources` would overwrite.

    A folder is ours if it is new, empty, or holds a manifest of symid. `force` gives up changes of files that
    this manifest lists, and nothing else.
    """
    if folder.exists() and not folder.is_dir():
        text = "is a file, not a folder; give the name of a folder"
        raise OutputError(Notice(code="output.not-a-folder", text=text, file=str(folder)))
    known, ours = _read_listed(folder)
    if not ours and folder.is_dir() and set(folder.iterdir()) - set(list_interrupted_updates(folder)):
        text = "is not empty and holds no manifest of symid, so that nothing was written; give another folder"
        raise OutputError(Notice(code="output.foreign-folder", text=text, file=str(folder)))
    notices = []
    for path, text in (*sources.files, (MANIFEST, sources.manifest)) if sources else ():
        target = folder / path
        link = next((place for place in _list_subfolders(folder, path) if place.is_symlink()), None)
        if link is not None:
            why = "is a link to another folder, and nothing is written through it; remove it"
            notices.append(Notice(code="output.linked-folder", text=why, file=str(link)))
            continue
        if not os.path.lexists(target) or (path == MANIFEST and ours):
            continue
        found = compute_digest(target.read_bytes()) if target.is_file() and not target.is_symlink() else ""
        if found == compute_digest(text.encode()):
            continue
        if path not in known:
            why = "is in the way and was not written by symid; move it, or give another folder"
            notices.append(Notice(code="output.foreign-file", text=why, file=str(target)))
        elif found not in known[path] and not force:
            why = "was edited since symid wrote it; move it, or force to lose the changes"
            notices.append(Notice(code="output.edited-file", text=why, file=str(target)))
    if notices:
        raise OutputError(*dict.fromkeys(notices))


def _list_subfolders(folder: Path, path: str) -> list[Path]:
    """Return the folders between `folder` and the file `path` in it, the innermost first."""
    return [folder / place for place in list(Path(path).parents)[:-1]]


def _write_staging(sources: SourceSet, staging: Path) -> None:
    staging.mkdir(parents=True)
    # The manifest first: it shows what an interrupted update was about to write.
    for path, text in ((MANIFEST, sources.manifest), *sources.files):
        target = staging / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(text.encode())
    # All at once is faster than one after another.
    with ThreadPoolExecutor(_SYNC_WORKERS) as pool:
        tuple(pool.map(_sync_to_disk, (*staging.rglob("*"), staging)))


def _remove_stale_files(folder: Path, sources: SourceSet, listed: ListedDigests) -> None:
    """Remove the files of the last run that this one does not write, if nobody changed them."""
    # Subfolders that this leaves empty go as well; what links to other folders is left alone.
    for path in sorted(listed.keys() - {path for path, _ in sources.files}):
        target, places = folder / path, _list_subfolders(folder, path)
        if any(place.is_symlink() for place in places):
            continue
        if target.is_file() and compute_digest(target.read_bytes()) in listed[path]:
            target.unlink()
        # One that holds anything stays, and so do those around it.
        with contextlib.suppress(OSError):
            for place in places:
                place.rmdir()


def _update_folder(sources: SourceSet, folder: Path, listed: ListedDigests) -> None:
    """Move the files into `folder` one by one; the folder itself stays what it is."""
    remains = list_interrupted_updates(folder)
    staging = folder / f"{_UPDATE_PREFIX}{secrets.token_hex(6)}"
    moved = False
    try:
        _write_staging(sources, staging)
        # The folder's owner has the files too, where the user may give them.
        wanted = folder.stat()
        with contextlib.suppress(OSError):
            for path in (staging, *sorted(staging.rglob("*"))):
                found = path.stat()
                if (wanted.st_uid, wanted.st_gid) != (found.st_uid, found.st_gid):
                    os.chown(path, wanted.st_uid, wanted.st_gid)
        for name, _ in sources.files:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            moved = True
            (staging / name).replace(folder / name)
        _remove_stale_files(folder, sources, listed)
        for place in sorted({(folder / path).parent for path, _ in sources.files}):
            _sync_to_disk(place)
        # Last: until here the old manifest and the one in the staging folder list the files.
        (staging / MANIFEST).replace(folder / MANIFEST)
        _sync_to_disk(folder)
    except BaseException:
        if not moved:
            shutil.rmtree(staging, ignore_errors=True)
        raise
    for place in (staging, *remains):
        shutil.rmtree(place, ignore_errors=True)


def write_sources(sources: SourceSet, folder: Path, *, force: bool = False) -> tuple[Path, ...]:
    """Write `sources` into `folder` and return the paths of the files, the manifest last.

    Files that the last run wrote and this one does not are removed if nobody changed them. With `force`,
    files of symid that were edited since are overwritten; a file that symid did not write is never touched.

    Raises:
        OutputError: symid did not write the folder or a file in it, or they cannot be written.
    """
    check_folder(folder, sources, force=force)
    listed, _ = _read_listed(folder)
    target = folder.resolve()
    before = f".{target.name}-"
    staging = target.parent / f"{mark_scratch(before)}{secrets.token_hex(6)}"
    clear_scratch(target.parent, before)
    try:
        if target.is_dir():
            _update_folder(sources, target, listed)
        else:
            # By one rename: it is there with all its files, or not at all.
            _write_staging(sources, staging)
            staging.rename(target)
            with contextlib.suppress(OSError):
                _sync_to_disk(target.parent)
    except OSError as error:
        text = f"cannot be written: {error.strerror or error}"
        raise OutputError(Notice(code="output.cannot-write", text=text, file=str(folder))) from error
    finally:
        shutil.rmtree(staging, ignore_errors=True)
    return tuple(folder / path for path, _ in (*sources.files, (MANIFEST, "")))
