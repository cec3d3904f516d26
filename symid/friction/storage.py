"""Fits of friction as files: JSON, written at once or not at all, read back without loss.

Input: `FrictionEstimate`s, one a joint or law. Output: a file, and the estimates again.

Supported: format 1, SI units. A number that is not finite is written as null and read as infinite.
"""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from symid.errors import EstimateError, Notice
from symid.friction.estimate import FrictionEstimate, FrictionOutcome
from symid.identification.estimate import ParameterEstimate
from symid.identification.storage import write_file

__all__ = ["build_document", "read_friction", "write_friction"]

_FORMAT = "symid friction"
_VERSION = 1


def build_document(estimates: Sequence[FrictionEstimate]) -> dict[str, object]:
    """Return the estimates as what JSON knows: tables, lists, numbers, text, null."""
    entries = [{**asdict(entry), "outcome": entry.outcome.name} for entry in estimates]
    return {"format": _FORMAT, "version": _VERSION, "estimates": _write_finite(entries)}


def write_friction(estimates: Sequence[FrictionEstimate], path: Path) -> Path:
    """Write the estimates to `path` as JSON and return the path.

    Raises:
        OutputError: the file cannot be written.
    """
    text = json.dumps(build_document(estimates), indent=1, allow_nan=False, ensure_ascii=False)
    return write_file(path, text + "\n")


def read_friction(path: Path) -> tuple[FrictionEstimate, ...]:
    """Return the estimates stored at `path`.

    Raises:
        EstimateError: there is no such file, or it holds something else.
    """
    data = _read_json(path)
    if not isinstance(data, Mapping) or data.get("format") != _FORMAT:
        raise _refuse(path, "this is JSON, but no fit of friction written by symid")
    if data.get("version") != _VERSION:
        raise _refuse(path, f"version {data.get('version')!r} of the format; this symid reads {_VERSION}")
    if not isinstance(data.get("estimates"), list):
        raise _refuse(path, "estimates: expected a list")
    return tuple(_read_entry(path, place, entry) for place, entry in enumerate(data["estimates"], start=1))


def _refuse(path: Path, *texts: str) -> EstimateError:
    return EstimateError(*(Notice(code="friction.format", text=text, file=str(path)) for text in texts))


def _read_json(path: Path) -> object:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise _refuse(path, f"cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise _refuse(path, "not a text file, so no fit of friction") from error
    except (ValueError, RecursionError) as error:
        raise _refuse(path, f"not JSON: {error}") from error


def _write_finite(value: object) -> object:
    match value:
        case float():
            return value if math.isfinite(value) else None
        case Mapping():
            return {str(key): _write_finite(entry) for key, entry in value.items()}
        case tuple() | list():
            return [_write_finite(entry) for entry in value]
    return value


def _read_entry(path: Path, place: int, data: object) -> FrictionEstimate:
    where = f"estimate {place}"
    if not isinstance(data, Mapping):
        raise _refuse(path, f"{where}: expected a table, got {data!r}")
    problems = [f"{where}: {name} is missing" for name in _READERS if name not in data]
    problems += [f"{where}: {name} is unknown" for name in data if name not in _READERS]
    values: dict[str, Any] = {}
    for name, reader in _READERS.items():
        if name in data:
            try:
                values[name] = reader(data[name])
            except (TypeError, ValueError, KeyError, AttributeError, OverflowError) as error:
                problems.append(f"{where}: {name}: {error}")
    if problems:
        raise _refuse(path, *problems)
    return FrictionEstimate(**values)


def _read_text(value: object) -> str:
    if not isinstance(value, str):
        message = f"expected text, got {value!r}"
        raise TypeError(message)
    return value


def _read_number(value: object) -> float:
    if value is None:
        return math.inf
    if isinstance(value, bool) or not isinstance(value, int | float):
        message = f"expected a number, got {value!r}"
        raise TypeError(message)
    return float(value)


def _read_count(value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        message = f"expected a count, got {value!r}"
        raise ValueError(message)
    return value


def _read_numbers(value: Sequence[object]) -> tuple[float, ...]:
    return tuple(map(_read_number, value))


def _read_parameters(value: Sequence[Mapping[str, Any]]) -> tuple[ParameterEstimate, ...]:
    names = {entry.name for entry in fields(ParameterEstimate)}
    result = []
    for entry in value:
        if set(entry) != names:
            message = f"expected {', '.join(sorted(names))}, got {', '.join(sorted(entry))}"
            raise ValueError(message)
        result.append(
            ParameterEstimate(
                name=_read_text(entry["name"]),
                value=_read_number(entry["value"]),
                std=_read_number(entry["std"]),
                unit=_read_text(entry["unit"]),
                expression=_read_text(entry["expression"]),
                reason=_read_text(entry["reason"]),
                truth=None if entry["truth"] is None else _read_number(entry["truth"]),
            )
        )
    return tuple(result)


def _read_notices(value: Sequence[Mapping[str, Any]]) -> tuple[Notice, ...]:
    return tuple(
        Notice(
            code=_read_text(entry["code"]),
            text=_read_text(entry["text"]),
            file=_read_text(entry["file"]),
            line=_read_count(entry["line"]),
            column=_read_count(entry["column"]),
        )
        for entry in value
    )


def _read_setting(value: object) -> float | int | str:
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        message = f"expected a number or text, got {value!r}"
        raise TypeError(message)
    return value


_READERS: dict[str, Callable[[Any], object]] = {
    **dict.fromkeys(("joint", "law", "estimator", "ended"), _read_text),
    **dict.fromkeys(("parameters", "extra"), _read_parameters),
    "refused": lambda value: tuple((_read_text(name), _read_text(why)) for name, why in value),
    **dict.fromkeys(("linear", "shape", "other", "history"), _read_numbers),
    "covariance": lambda value: tuple(map(_read_numbers, value)),
    **dict.fromkeys(("objective", "sigma", "aicc", "bic", "condition"), _read_number),
    **dict.fromkeys(("samples", "evaluations", "solves", "iterations"), _read_count),
    "outcome": lambda value: FrictionOutcome[_read_text(value)],
    "settings": lambda value: tuple((_read_text(name), _read_setting(entry)) for name, entry in value),
    "notices": _read_notices,
}
