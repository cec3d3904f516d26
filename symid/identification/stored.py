"""Fits as files: JSON, written at once or not at all, read back without loss.

FitRecord of any kind <-> file;  a fit or its file -> FitRecord, and where it is from.

Supported: format "symid fit", version 6, SI units; a number that is not finite is null. Version 1, which had
a format for each kind, is still read, with defaults for fields that it did not have.
"""

import json
import re
from collections.abc import Callable, Mapping, Sequence
from itertools import islice
from os import PathLike
from pathlib import Path
from typing import Any, Protocol, TypeVar

from symid.codegen import ModelCard
from symid.environment import read_file, write_file
from symid.errors import EstimateError, Notice, SymidError
from symid.identification.elastic import ElasticEstimate, StiffnessEstimate
from symid.identification.estimators import Estimate, FitRecord, check_model
from symid.identification.friction import FrictionIdentification
from symid.identification.hysteresis import HysteresisRecord
from symid.identification.judge import numerics
from symid.joint_models import NO_FRICTION, get_law
from symid.serialization import list_unusable, read_record, write_json, write_plain

Record = TypeVar("Record")
StoredResult = Estimate | ElasticEstimate | FrictionIdentification
_FORMAT = "symid fit"
_OLDEST, _VERSION = 2, 6
"""The first version that is read, and the one that is written: 2 has no friction laws of its own, 3 no
evidence and no deviations of springs, 4 no motion, 5 did not say which robot file and whether its logs were
simulated."""
_ABOUT = frozenset({"format", "version", "kind", "verdict"})
"""Entries of a file that are not fields of the record."""
_KINDS: Mapping[str, type[StoredResult]] = {
    kind.kind: kind for kind in (Estimate, ElasticEstimate, FrictionIdentification)
}
_BEFORE = {
    "symid estimate": "rigid",
    "symid elastic estimate": "elastic",
    "symid friction result": "friction",
}
"""Kinds of the formats of version 1."""


class Fitted(Protocol):
    """A result of the API: what was identified, and its file where it has one."""

    @property
    def product(self) -> object:
        """Return what was identified."""

    @property
    def file(self) -> Path | None:
        """Return the file that it was read from."""


GivenResult = StoredResult | Fitted | str | PathLike[str]
"""What was identified: itself, as a result of the API, or its file."""


def write_fit(
    record: FitRecord | HysteresisRecord, path: Path, *, verdict: Mapping[str, object] | None = None
) -> Path:
    """Write the record, of a robot or of an element, to `path` as JSON and return the path, or OutputError.

    `verdict` is written for readers of the file, and left out when it is read: it follows from the rest.
    """
    body: Any = write_plain(record)
    head: dict[str, object] = {"format": "symid element", "version": 1}
    if isinstance(record, FitRecord):
        head = {"format": _FORMAT, "version": _VERSION, "kind": record.kind}
    head |= {} if verdict is None else {"verdict": write_plain(verdict)}
    return write_file(path, json.dumps(head | body, indent=1, allow_nan=False, ensure_ascii=False) + "\n")


def write_result(what: str, found: object, path: Path, described: Mapping[str, object]) -> Path:
    """Write what was found, a "stiffness" or a "payload", to `path` as JSON and return it, or OutputError.

    `described` is written for readers of the file, beside the record that is read.
    """
    data = {"format": f"symid {what}", "version": 1, **described, "record": found}
    return write_file(path, write_json(data) + "\n")


def read_fit(path: Path) -> StoredResult:
    """Return the record of any kind that a file holds, of any version, or an EstimateError."""
    data = _read_json(path)
    name = data.get("format") if isinstance(data, dict) else None
    if not isinstance(data, dict) or not _is_format(name):
        saw = "" if name is None else f": its format is {name!r:.60}"
        raise _refuse(path, f"this is JSON, but not an estimate written by symid{saw}")
    # Its fields by their names of today.
    body = {key: value for key, value in data.items() if key not in _ABOUT}
    version, kind = data.get("version"), str(data.get("kind")) if name == _FORMAT else _BEFORE[str(name)]
    known = range(_OLDEST, _VERSION + 1) if name == _FORMAT else (1,)
    if type(version) is not int or version not in known:
        read = ", ".join(map(str, known))
        raise _refuse(path, f"version {version!r} of the format; this symid reads {read}")
    if kind not in _KINDS:
        raise _refuse(path, f"kind: expected one of {', '.join(_KINDS)}, got {kind!r}")
    if version == 1 and kind == "elastic":
        # The friction models of the joints follow from names of parameters.
        given = body.get("parameters")
        entries = given if isinstance(given, list) else []
        names = [str(entry.get("name")) for entry in entries if isinstance(entry, dict)]
        body["friction"] = list(name_friction(names))
    whole = version == _VERSION
    return _build_record(_KINDS[kind], path, body, lambda record: record.list_mistakes(), complete=whole)


_LAWS = (
    *("coulomb-viscous", "coulomb-viscous-offset", "asymmetric", "stribeck", "stribeck+offset"),
    *("improved-stribeck", "asymmetric-stribeck", "cubic", "stribeck+cubic", "power-law", "makkar"),
)
"""Of robot files when estimates did not have the names of laws."""


def name_friction(parameters: Sequence[str]) -> tuple[str, ...]:
    """Return the friction models of joints whose parameters have these names; empty if unknown."""
    numbers = [name.removeprefix("IA") for name in parameters if re.fullmatch(r"IA\d+", name)]
    kinds = {tuple(entry.name for entry in get_law(law).linear): law for law in _LAWS} | {(): NO_FRICTION}
    letters = {letter for names in kinds for letter in names}
    found = [
        tuple(name.removesuffix(number) for name in parameters if name in {f"{x}{number}" for x in letters})
        for number in numbers
    ]
    return tuple(kinds[entry] for entry in found) if all(entry in kinds for entry in found) else ()


def _build_record(
    kind: type[Record],
    path: Path,
    body: object,
    list_mistakes: Callable[[Record], list[str]],
    *,
    complete: bool = True,
) -> Record:
    """Return a record of its entries; raise EstimateError with all that is missing, unusable or mistaken."""
    # Of a file that is no data at all, the first entry says so.
    mistakes = list(islice(list_unusable(body), 1))
    if not mistakes:
        try:
            record = read_record(kind, body, complete=complete)
            mistakes = list_mistakes(record)
        except SymidError as error:
            mistakes = [notice.text for notice in error.notices]
    if mistakes:
        raise EstimateError(*(Notice(code="estimate.format", text=text, file=str(path)) for text in mistakes))
    return record


def read_result_file(
    kind: type[Record], what: str, path: Path, list_mistakes: Callable[[Record], list[str]] = lambda _: []
) -> Record:
    """Return the record of a file of one kind: a "stiffness", a "payload" or an "element".

    `list_mistakes` says what is wrong with a record whose entries are right one by one.
    """
    data = _read_json(path)
    if not isinstance(data, dict) or data.get("format") != f"symid {what}" or data.get("version") != 1:
        raise _refuse(path, f"this is JSON, but no {what} written by this symid")
    body = {key: value for key, value in data.items() if key not in _ABOUT}
    return _build_record(kind, path, body if what == "element" else body.get("record"), list_mistakes)


def read_element(path: Path) -> HysteresisRecord:
    """Return the element stored at `path`; errors as for `read_result_file`."""
    return read_result_file(HysteresisRecord, "element", path)


def read_stiffness(path: Path) -> StiffnessEstimate:
    """Return the stiffness of joints stored at `path`; errors as for `read_result_file`."""
    return read_result_file(StiffnessEstimate, "stiffness", path, _list_shape_mistakes)


def _list_shape_mistakes(found: StiffnessEstimate) -> list[str]:
    alignment, runs, joints = found.alignment, len(found.alignment.sources), len(found.joints)
    wanted: dict[str, tuple[int, ...]] = dict.fromkeys(
        ("delays", "delay_stds", "explained", "residual", "present"), (joints,)
    )
    wanted |= dict.fromkeys(("offsets", "offset_stds"), (runs, joints))
    shapes = [(name, getattr(alignment, name).shape, shape) for name, shape in wanted.items()]
    shapes += [
        (entry.joint, part.shape, (runs,)) for entry in found.joints for part in (entry.runs, entry.run_stds)
    ]
    wrong = [f"{name}: expected {shape} numbers, got {got}" for name, got, shape in shapes if got != shape]
    return wrong + [f"{entry.joint}: a stiffness of zero" for entry in found.joints if entry.stiffness == 0.0]


def is_kind(path: Path, what: str = "fit") -> bool:
    """Return whether `path` holds a result of a kind that symid wrote, with mistakes or without."""
    try:
        data = json.loads(read_file(path, int(numerics.LARGEST)).decode())
    except (OSError, ValueError, RecursionError):
        return False
    name = data.get("format") if isinstance(data, dict) else None
    return _is_format(name) if what == "fit" else name == f"symid {what}"


def read_result(given: GivenResult) -> tuple[StoredResult, Path]:
    """Return what was identified, of any kind, and where it is from; a TypeError where it is no fit."""
    if isinstance(given, str | PathLike):
        path = Path(given)
        return read_fit(path), path
    found = getattr(given, "product", given)
    if not isinstance(found, StoredResult):
        message = f"expected a fit or its file, got {type(given).__name__}"
        raise TypeError(message)
    # Messages call a result that is no file by the logs it comes from.
    logs = ", ".join(Path(source).name for source in found.sources)
    return found, getattr(given, "file", None) or Path(f"fit of {logs}")


def read_dynamics(given: GivenResult) -> tuple[Estimate | ElasticEstimate, Path]:
    """Return the estimate, rigid or elastic, and where it is from; an EstimateError for friction alone."""
    found, source = read_result(given)
    if isinstance(found, FrictionIdentification):
        raise _refuse(source, "this is a fit of friction alone; identify base parameters with other rows")
    return found, source


def take_given(given: object) -> Any:  # noqa: ANN401  what it holds
    """Return what a result or a robot of the API holds, a path for the name of a file; all else as it is."""
    if isinstance(given, str | PathLike):
        return Path(given)
    return getattr(given, "product", getattr(given, "description", given))


def read_rigid(given: GivenResult, card: ModelCard) -> Estimate:
    """Return an estimate of the rigid model of `card`, read where it is a file, or an EstimateError."""
    held = take_given(given)
    found = read_fit(held) if isinstance(held, Path) else held
    file = str(held) if isinstance(held, Path) else str(getattr(given, "file", None) or "")
    if not isinstance(found, Estimate) and not isinstance(held, Path):
        text = "expected base parameters of a rigid robot, as `robot.identify` returns them"
        raise EstimateError(Notice(code="estimate.kind", text=text, file=file))
    if isinstance(found, FrictionIdentification):
        text = "this is a fit of friction (--rows friction); --known needs base parameters, identified with "
        text += "`symid identify ROBOT LOG... -o FILE`"
        raise EstimateError(Notice(code="estimate.friction", text=text, file=file))
    if not isinstance(found, Estimate):
        text = "this is an estimate of elastic joints; give one of a robot identified as rigid"
        raise EstimateError(Notice(code="estimate.format", text=text, file=file))
    check_model(found, card, file)
    return found


def _refuse(path: Path, text: str, **place: int) -> EstimateError:
    return EstimateError(Notice(code="estimate.format", text=text, file=str(path), **place))


def _read_json(path: Path) -> object:
    try:
        text = read_file(path, int(numerics.LARGEST)).decode()
    except UnicodeDecodeError as error:
        raise _refuse(path, "not a text file, so not an estimate") from error
    except (OSError, ValueError) as error:
        # No file can have a name that holds a null byte or no Unicode.
        raise _refuse(path, f"cannot be read: {getattr(error, 'strerror', error)}") from error

    def refuse(name: str) -> float:
        message = f"{name} is not a number in JSON"
        raise ValueError(message)

    try:
        return json.loads(text, parse_constant=refuse, object_pairs_hook=_build_table)
    except json.JSONDecodeError as error:
        raise _refuse(path, f"not JSON: {error.msg}", line=error.lineno, column=error.colno) from error
    except RecursionError as error:
        raise _refuse(path, "nested too deeply to be an estimate") from error
    except ValueError as error:
        raise _refuse(path, f"not JSON: {error}") from error


def _build_table(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    if len(table) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        message = f"the key {twice!r:.60} is given twice in one table"
        raise ValueError(message)
    return table


def _is_format(name: object) -> bool:
    return isinstance(name, str) and (name == _FORMAT or name in _BEFORE)
