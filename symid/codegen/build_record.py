"""What `symid generate` found out about the code in a folder: whether it is right, and how large.

Input: a folder that was written, the signature of all that its files were made from, what a compiler made of
them. Output: the entry "build" of its manifest; later, whether that still holds.

The sources and the rest of the manifest are the same on every machine. This entry is not: it says which
compiler, with which flags, passed the self-test, and what it made of every function. So it is written where
the compiler ran, after the files, and no file's digest covers it; a digest of the manifest's other entries is
in it, which tells when somebody edited these.

Supported: all targets. Not supported: folders that were written without `symid generate`; they have none.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from symid.codegen.cache import find_library_key
from symid.codegen.code_size import CodeSize
from symid.codegen.compiler import Compiler
from symid.codegen.writer import SourceSet, is_unchanged, read_manifest, write_manifest_text
from symid.errors import Notice, OutputError
from symid.provenance import find_signature
from symid.robot.description import Robot

__all__ = [
    "BuildRecord",
    "find_inputs_signature",
    "find_operations",
    "read_unchanged",
    "write_build_record",
]

_ENTRY = "build"


@dataclass(frozen=True, slots=True, kw_only=True)
class BuildRecord:
    """Who ran the self-test and how it went, and the sizes of the functions.

    Attributes:
        inputs: see `find_inputs_signature`.
        selftest: "passed" or "not run".
        runner: the compiler, or Python and NumPy; empty if the test was not run.
        flags: of the compiler.
        sizes: by function, where they are known.
    """

    inputs: str
    selftest: str
    runner: str = ""
    flags: str = ""
    sizes: Mapping[str, CodeSize] = field(default_factory=dict)


def find_inputs_signature(
    robot: Robot,
    names: tuple[str, ...] | None,
    choices: object,
    *,
    compiler: Compiler | None,
    runner: str,
) -> str:
    """Return the signature of all that a folder and its record are made from.

    Args:
        robot: all of it but where its file is.
        names: of functions, None for all.
        choices: whatever else fixes the code, as frozen dataclasses of plain values.
        compiler: what compiles the self-test.
        runner: what runs it.
    """
    described = replace(robot, path="", notices=())
    return find_signature(find_library_key(robot, names, compiler), described, choices, runner)


def find_operations(manifest: Mapping[str, object]) -> dict[str, dict[str, int]]:
    """Return the operations of every function of a manifest that symid wrote, in the order of its card."""
    card, operations = manifest.get("card"), manifest.get("operations")
    if not isinstance(card, dict) or not isinstance(operations, dict):
        return {}
    return {entry["name"]: operations[entry["name"]] for entry in card["functions"]}


def _find_seal(manifest: Mapping[str, object]) -> str:
    return find_signature({key: value for key, value in manifest.items() if key != _ENTRY})


def read_unchanged(folder: Path, inputs: str) -> tuple[Mapping[str, object], BuildRecord] | None:
    """Return the manifest and the record of a folder that was made from `inputs` and is as it was then."""
    manifest = read_manifest(folder)
    found = None if manifest is None else manifest.get(_ENTRY)
    if manifest is None or not isinstance(found, dict):
        return None
    entry = dict(found)
    try:
        seal = entry.pop("seal")
        sizes = {name: CodeSize(**size) for name, size in entry.pop("sizes").items()}
        record = BuildRecord(**entry, sizes=sizes)
    except (AttributeError, KeyError, TypeError):
        # Somebody wrote it.
        return None
    same = record.inputs == inputs and seal == _find_seal(manifest) and is_unchanged(folder, manifest)
    return (manifest, record) if same else None


def _fail_changed(folder: Path) -> OutputError:
    text = "was changed by somebody else while its self-test ran; generate it again"
    return OutputError(Notice(code="output.changed-meanwhile", text=text, file=str(folder)))


def write_build_record(folder: Path, record: BuildRecord, sources: SourceSet) -> Mapping[str, object]:
    """Put `record` into the manifest of `folder`, and return that manifest.

    Args:
        folder: to which `sources` were written.
        record: what was found out about them.
        sources: whose manifest must still be the one in the folder, and their files those that it lists.

    Raises:
        OutputError: the folder holds something else by now, or cannot be written.
    """
    manifest = dict(read_manifest(folder) or {})
    if manifest != json.loads(sources.manifest) or not is_unchanged(folder, manifest):
        raise _fail_changed(folder)
    manifest[_ENTRY] = {**asdict(record), "seal": _find_seal(manifest)}
    write_manifest_text(json.dumps(manifest, indent=1, sort_keys=True) + "\n", folder)
    return read_manifest(folder) or {}
