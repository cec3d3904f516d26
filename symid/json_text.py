"""Results as JSON text: plain types in, the same text for the same value.

Input: None, booleans, numbers (NumPy's too), strings, paths, mappings, tuples and lists. Output: JSON.

Supported: numbers that are not finite become null, which JSON has; keys become strings.
Not supported: any other object (TypeError).
"""

import json
import math
from collections.abc import Mapping
from pathlib import Path

__all__ = ["write_json"]


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
