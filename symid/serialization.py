"""Values as bytes and as JSON: equal input, equal text, on any machine.

Supported: None, booleans, numbers, strings, tuples, lists, mappings with string keys, enumerations,
dataclasses and NumPy arrays; fractions and bytes in signatures, paths in JSON. Not supported: sets.
"""

import hashlib
import json
import math
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, fields, is_dataclass
from enum import Enum
from fractions import Fraction
from functools import cache, partial
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, cast, get_args, get_origin, get_type_hints

from symid.errors import InputError, Notice, SymidError

Record = TypeVar("Record")
Finite = Annotated[float, "finite"]
"""A number that a file must state: null, which means infinity elsewhere, is refused."""
HIDDEN = {"key": ""}
"""Metadata of a field that is stored, but not shown to programs."""
_LARGEST = int(sys.float_info.max)
_DEPTH = 100


def write_canonical(value: object) -> bytes:
    """Return bytes that are the same for the same value, and differ for different ones.

    Types count where they change meaning: 1 and 1.0 differ, as do 0.0 and -0.0, an enumeration and its
    value, an array and the tuple of its parts; a tuple and a list of the same entries do not.

    Raises:
        TypeError: `value` holds an object without a canonical form, such as a set or an array of objects.
    """
    match value:
        case None | bool():
            return f"{value!r};".encode()
        case Enum():
            return b"e" + type(value).__name__.encode() + write_canonical(value.value)
        case int() | Fraction():
            return f"q{value};".encode()
        case float():
            return f"f{value.hex()};".encode()
        case str():
            text = value.encode()
            return b"s%d:%s;" % (len(text), text)
        case bytes():
            return b"b%d:%s;" % (len(value), value)
        case tuple() | list():
            return b"(" + b"".join(map(write_canonical, value)) + b")"
        case Mapping():
            pairs = sorted(value.items())
            return b"{" + b"".join(write_canonical(part) for pair in pairs for part in pair) + b"}"
    if is_dataclass(value) and not isinstance(value, type):
        inner = (getattr(value, field.name) for field in fields(value))
        return type(value).__name__.encode() + write_canonical(tuple(inner))
    if hasattr(value, "tobytes") and hasattr(value, "dtype") and hasattr(value, "shape"):
        if value.dtype.hasobject:
            message = "no canonical form for an array of objects"
            raise TypeError(message)
        return b"a" + write_canonical((str(value.dtype), tuple(value.shape), value.tobytes()))
    message = f"no canonical form for {type(value).__name__}"
    raise TypeError(message)


def compute_signature(*values: object) -> str:
    """Return the SHA-256 of the values' canonical bytes, as 64 hexadecimal digits."""
    return hashlib.sha256(write_canonical(values)).hexdigest()


def compute_file_digest(source: str) -> str:
    """Return the SHA-256 of the file `source`, or of the files of a folder; empty if none can be read."""
    path = Path(source)
    try:
        if path.is_dir():
            inner = [compute_file_digest(str(entry)) for entry in path.iterdir() if entry.is_file()]
            return compute_signature(sorted(inner)) if inner else ""
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except (OSError, ValueError):
        return ""


def write_json(value: object) -> str:
    """Return `value` as JSON text; see `write_plain`."""
    return json.dumps(write_plain(value), indent=2, allow_nan=False, ensure_ascii=False)


def write_plain(value: object) -> object:
    """Return `value` in the types that JSON has.

    Numbers that are not finite become None, keys and paths text, enumerations their names, dataclasses
    dictionaries of their fields, arrays lists.

    Raises:
        TypeError: `value` holds an object that JSON has no word for.
    """
    match value:
        case Enum():
            return value.name
        case float():
            return float(value) if math.isfinite(value) else None
        case None | bool() | int() | str():
            return value
        case Path():
            return str(value)
        case Mapping():
            return {str(key): write_plain(entry) for key, entry in value.items()}
        case tuple() | list():
            return [write_plain(entry) for entry in value]
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: write_plain(getattr(value, field.name)) for field in fields(value)}
    # An array or a number of NumPy, which an option of the Python API may be.
    if hasattr(value, "tolist") and hasattr(value, "shape"):
        return write_plain(value.tolist())
    message = f"no JSON for {type(value).__name__}"
    raise TypeError(message)


def name_key(key: str) -> dict[str, str]:
    """Return the metadata of a field that programs know by another name."""
    return {"key": key}


def keep_name(name: str) -> dict[str, str]:
    """Return the metadata of a field that files of earlier versions call `name`."""
    return {"was": name}


def write_as(write: Callable[[Any], object]) -> dict[str, Callable[[Any], object]]:
    """Return the metadata of a field that programs read as `write` returns it."""
    return {"write": write}


def describe_record(record: Any) -> dict[str, Any]:  # noqa: ANN401  any dataclass
    """Return a record, and those in it, as programs read it: its fields by name, or as their metadata say.

    Arrays and tuples become lists; numbers that are not finite and enumerations stay what they are.
    """
    found = {}
    for entry in fields(record):
        key, write = entry.metadata.get("key", entry.name), entry.metadata.get("write", _describe)
        if key:
            found[key] = write(getattr(record, entry.name))
    return found


def _describe(value: Any) -> Any:  # noqa: ANN401  any value
    if is_dataclass(value):
        return describe_record(value)
    if isinstance(value, tuple | list):
        return [_describe(entry) for entry in value]
    return value.tolist() if hasattr(value, "tolist") else value


def read_record(kind: type[Record], value: object, where: str = "", *, complete: bool = False) -> Record:
    """Return the dataclass `kind` whose fields `write_plain` wrote as the dictionary `value`.

    Fields may be text, one of given words, numbers (null is read as infinite, and refused for `Finite`; a
    number that floats do not hold is refused), booleans, enumerations, dataclasses or one of several, tuples,
    float64 or boolean vectors, `FloatMatrix`, mappings (as they are), and each of these or None; those with a
    default may be missing.

    Args:
        kind: its annotations are read where it was defined.
        value: as `json.loads` returns it.
        where: it stands, for messages, such as "joints".
        complete: whether every field must be there, as `write_plain` writes them, here and further in.

    Raises:
        InputError: with all that is wrong: the first problem of every field, fields that are missing or
            unknown, or what the record itself refuses.
    """
    known = {entry.name: entry for entry in fields(cast("Any", kind))}
    earlier = {entry.metadata["was"]: name for name, entry in known.items() if "was" in entry.metadata}
    stated = _expect(value, (dict,), where)
    renamed = {name: now for name, now in earlier.items() if now not in stated}
    table = {renamed.get(name, name): entry for name, entry in stated.items()}
    hints = _get_hints(cast("Any", kind))
    problems = [
        _place(where, f"{name} is missing")
        for name, entry in sorted(known.items())
        if name not in table and (complete or (entry.default is MISSING and entry.default_factory is MISSING))
    ]
    found: dict[str, Any] = {}
    for name, entry in table.items():
        if name not in known:
            problems.append(_place(where, f"{name} is unknown"))
            continue
        try:
            found[name] = _read(hints[name], entry, f"{where}.{name}".lstrip("."), complete=complete)
        except InputError as error:
            problems += [notice.text for notice in error.notices]
    if problems:
        raise _refuse(*problems)
    try:
        return kind(**found)
    except SymidError as error:
        raise _refuse(*(_place(where, notice.text) for notice in error.notices)) from error


_get_hints = cache(partial(get_type_hints, include_extras=True))


def list_unusable(value: object, where: str = "", depth: int = 0) -> Iterator[str]:
    """Yield what no file of symid holds, of any type: text that is no Unicode, numbers beyond floats, depth.

    Args:
        value: as `json.loads` returns it.
        where: it stands, for messages, such as "joints".
        depth: of tables and lists around it.
    """
    match value:
        case str() if not _is_unicode(value):
            yield _place(where, "holds text that is no Unicode")
        case float() if not math.isfinite(value):
            yield _place(where, f"expected a number, got {value!r}")
        case dict() | list() if depth >= _DEPTH:
            yield _place(where[:60], f"nested deeper than {_DEPTH} tables and lists")
        case dict():
            for name, entry in value.items():
                if not _is_unicode(name):
                    yield _place(where, f"the name {name!r:.60} is no Unicode")
                else:
                    yield from list_unusable(entry, f"{where}.{name}".lstrip("."), depth + 1)
        case list():
            for k, entry in enumerate(value):
                yield from list_unusable(entry, f"{where}[{k}]", depth + 1)


def _is_unicode(text: str) -> bool:
    """Return whether text can be written: half of a surrogate pair, which JSON can hold, cannot."""
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def _read(kind: Any, value: object, where: str, *, complete: bool = False) -> object:  # noqa: ANN401
    """Return `value`, as JSON has it, as the type `kind`."""
    arguments, origin = get_args(kind), get_origin(kind) or kind
    if origin is Annotated and arguments[0] is float:
        return float(_expect(value, (float, int), where))
    if origin in {Union, UnionType}:
        if NoneType in arguments:
            inner = next(entry for entry in arguments if entry is not NoneType)
            return None if value is None else _read(inner, value, where, complete=complete)
        if not all(map(is_dataclass, arguments)):
            return _expect(value, arguments, where)
        table = _expect(value, (dict,), where)
        names = [[entry.name for entry in fields(choice)] for choice in arguments]
        for choice, known in zip(arguments, names, strict=True):
            if set(table) <= set(known):
                return read_record(choice, table, where, complete=complete)
        listed = "; or ".join(", ".join(known) for known in names)
        raise _refuse(_place(where, f"expected a table of {listed}; got {', '.join(table)}"))
    if origin is Literal:
        if value in arguments:
            return value
        raise _refuse(_place(where, f"expected one of {', '.join(arguments)}, got {value!r:.60}"))
    if is_dataclass(origin):
        return read_record(kind, value, where, complete=complete)
    if origin is tuple:
        entries = _expect(value, (list,), where)
        kinds = arguments[:1] * len(entries) if arguments[-1] is Ellipsis else arguments
        if len(entries) != len(kinds):
            raise _refuse(_place(where, f"expected {len(kinds)} entries, got {len(entries)}"))
        return tuple(
            _read(inner, entry, f"{where}[{k}]", complete=complete)
            for k, (inner, entry) in enumerate(zip(kinds, entries, strict=True))
        )
    if origin is Annotated or origin.__name__ == "ndarray":
        import numpy as np

        rows = _expect(value, (list,), where)
        if len(arguments) > 1 and arguments[1] == "matrix":
            numbers = [[_read(float, entry, where) for entry in _expect(row, (list,), where)] for row in rows]
            if len(set(map(len, numbers))) > 1:
                raise _refuse(_place(where, "rows of different lengths"))
            return np.array(numbers, dtype=np.float64)
        number = bool if get_args(arguments[1])[0] is np.bool_ else float
        return np.array([_read(number, entry, where) for entry in rows], dtype=number)
    if issubclass(origin, Mapping):
        return _expect(value, (dict,), where)
    if issubclass(origin, Enum):
        if not isinstance(value, str) or value not in origin.__members__:
            text = f"expected one of {', '.join(origin.__members__)}, got {value!r:.60}"
            raise _refuse(_place(where, text))
        return origin[value]
    if origin is float:
        return math.inf if value is None else float(_expect(value, (float, int), where))
    return _expect(value, (origin,), where)


_WORDS = {str: "text", int: "a whole number", float: "a number", bool: "true or false", dict: "a table"}


def _expect(value: Any, kinds: tuple[type, ...], where: str) -> Any:  # noqa: ANN401  (from JSON)
    usable = isinstance(value, kinds) and (not isinstance(value, bool) or bool in kinds)
    # A number beyond the range of floats would not become one; as 1e400 it would become infinite.
    is_beyond = float in kinds and isinstance(value, int | float) and not abs(value) <= _LARGEST
    if usable and not is_beyond:
        return value
    names = [_WORDS.get(kind, "a list") for kind in kinds if kind is not int or float not in kinds]
    got = "null" if value is None else f"{value!r:.60}"
    raise _refuse(_place(where, f"expected {' or '.join(names)}, got {got}"))


def _refuse(*problems: str) -> InputError:
    return InputError(*(Notice(code="estimate.format", text=text) for text in problems))


def _place(where: str, text: str) -> str:
    return f"{where}: {text}" if where else text
