"""Values as bytes and as JSON: equal input, equal text, on any machine.

Canonical bytes and signatures (SHA-256) of None, booleans, integers, floats, fractions, strings, bytes,
tuples, lists, mappings with string keys, enumerations, frozen dataclasses and NumPy arrays (dtype, shape,
bytes); digests of files. JSON text of plain types, NumPy numbers and paths: numbers that are not finite
become null, keys become strings.

Not supported: sets (they have no order) and any other object (TypeError).
"""

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from fractions import Fraction
from pathlib import Path


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
    """Return the SHA-256 of the file `source`, empty where there is no such file to read."""
    try:
        return hashlib.sha256(Path(source).read_bytes()).hexdigest()
    except (OSError, ValueError):
        return ""


def write_json(value: object) -> str:
    """Return `value` as JSON text.

    Raises:
        TypeError: `value` holds an object that JSON has no word for.
    """
    return json.dumps(_simplify(value), indent=2, allow_nan=False, ensure_ascii=False)


def _simplify(value: object) -> object:
    """Return `value` in the types that JSON has."""
    match value:
        case float():
            return value if math.isfinite(value) else None
        case None | bool() | int() | str():
            return value
        case Path():
            return str(value)
        case Mapping():
            return {str(key): _simplify(entry) for key, entry in value.items()}
        case tuple() | list():
            return [_simplify(entry) for entry in value]
    # A number of NumPy, which an option of the Python API may be.
    if hasattr(value, "tolist") and getattr(value, "shape", None) == ():
        return _simplify(value.tolist())
    message = f"no JSON for {type(value).__name__}"
    raise TypeError(message)
