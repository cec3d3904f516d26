"""Estimates as files: JSON, written at once or not at all, read back without loss.

Estimate <-> file.

Supported: format 1, SI units. A number that is not finite is written as null.
"""

import json
import math
import os
import tempfile
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from symid.codegen import ModelCard
from symid.errors import EstimateError, Notice, OutputError
from symid.identification.estimators import Estimate, Outcome, ParameterEstimate, Residual
from symid.identification.regression import ROW_KINDS
from symid.identification.rigid.validation import check_rigid_model
from symid.robot import CurvedFriction, FrictionKind

_FORMAT = "symid estimate"
_VERSION = 1
_FRICTION = tuple(kind.value for kind in (*FrictionKind, *CurvedFriction))


def write_estimate(estimate: Estimate, path: Path) -> Path:
    """Write the estimate to `path` as JSON and return the path.

    Raises:
        OutputError: the file cannot be written.
    """
    data = {"format": _FORMAT, "version": _VERSION, **asdict(estimate), "outcome": estimate.outcome.name}
    text = json.dumps(_write_finite(data), indent=1, allow_nan=False, ensure_ascii=False)
    return write_file(path, text + "\n")


def read_estimate(path: Path, card: ModelCard | None = None) -> Estimate:
    """Return the estimate stored at `path`.

    Args:
        path: a file that `write_estimate` wrote.
        card: the model that it must belong to, if given.

    Raises:
        EstimateError: there is no such file, it holds something else, or belongs to another model.
    """
    data = _read_json(path)
    if not isinstance(data, Mapping) or data.get("format") != _FORMAT:
        raise _refuse(path, "this is JSON, but not an estimate written by symid")
    if data.get("version") != _VERSION:
        raise _refuse(path, f"version {data.get('version')!r} of the format; this symid reads {_VERSION}")
    estimate = _build_estimate(path, data)
    if card is not None:
        check_rigid_model(estimate, card, str(path))
    return estimate


def write_file(path: Path, text: str) -> Path:
    """Write `text` to `path` at once or not at all, and return the path.

    Raises:
        OutputError: the folder does not exist or must not be written.
    """
    temporary = ""
    try:
        with tempfile.NamedTemporaryFile(
            "w", encoding="utf-8", newline="\n", dir=path.parent, prefix=f".{path.name}.", delete=False
        ) as stream:
            temporary = stream.name
            stream.write(text)
        # Temporary files are private; the result is as readable as any other file.
        mask = os.umask(0)
        os.umask(mask)
        Path(temporary).chmod(0o666 & ~mask)
        Path(temporary).replace(path)
    except OSError as error:
        if temporary:
            Path(temporary).unlink(missing_ok=True)
        reason = f"cannot be written: {error.strerror}; name a file in a folder that exists and is yours"
        raise OutputError(Notice(code="output.write", text=reason, file=str(path))) from error
    return path


def _refuse(path: Path, text: str, line: int = 0, column: int = 0) -> EstimateError:
    notice = Notice(code="estimate.format", text=text, file=str(path), line=line, column=column)
    return EstimateError(notice)


def _write_finite(value: object) -> object:
    """Return `value` with tuples as lists and numbers that are not finite as None."""
    match value:
        case float():
            return value if math.isfinite(value) else None
        case Mapping():
            return {str(key): _write_finite(entry) for key, entry in value.items()}
        case tuple() | list():
            return [_write_finite(entry) for entry in value]
    return value


def _read_json(path: Path) -> object:
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise _refuse(path, f"cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise _refuse(path, "not a text file, so not an estimate") from error
    try:
        return json.loads(text, parse_constant=_refuse_constant)
    except json.JSONDecodeError as error:
        raise _refuse(path, f"not JSON: {error.msg}", error.lineno, error.colno) from error
    except RecursionError as error:
        raise _refuse(path, "nested too deeply to be an estimate") from error
    except ValueError as error:
        raise _refuse(path, f"not JSON: {error}") from error


def _refuse_constant(name: str) -> float:
    message = f"{name} is no number of JSON"
    raise ValueError(message)


def _build_estimate(path: Path, data: Mapping[str, Any]) -> Estimate:
    readers: dict[str, Callable[[Any], object]] = {
        "robot": _expect_text,
        "signature": _expect_text,
        "rows": lambda value: _expect_one_of(value, ROW_KINDS),
        "estimator": _expect_text,
        "friction": lambda value: tuple(_expect_one_of(kind, _FRICTION) for kind in value),
        "parameters": lambda value: tuple(map(_read_parameter, value)),
        "residual": _read_residuals,
        "condition": _expect_number,
        "outcome": lambda value: Outcome[value],
        "samples": _expect_count,
        "sources": lambda value: tuple(map(_expect_text, value)),
        "settings": _expect_table,
        "refused": lambda value: tuple((_expect_text(name), _expect_text(why)) for name, why in value),
        "unresolved": lambda value: tuple((_expect_text(name), _expect_finite(x)) for name, x in value),
        "covariance": lambda value: tuple(tuple(map(_expect_number, row)) for row in value),
        "notices": lambda value: tuple(map(_read_notice, value)),
    }
    problems = [f"{name} is missing" for name in readers if name not in data]
    problems += [f"{name} is unknown" for name in data if name not in {*readers, "format", "version"}]
    fields: dict[str, Any] = {}
    for name, reader in readers.items():
        if name in data:
            try:
                fields[name] = reader(data[name])
            except (TypeError, ValueError, KeyError, AttributeError, OverflowError) as error:
                problems.append(f"{name}: {_explain(error)}")
    if not problems and {len(fields["covariance"]), *map(len, fields["covariance"])} - {0}:
        count = len(fields["parameters"])
        if {len(fields["covariance"]), *map(len, fields["covariance"])} != {count}:
            problems.append(f"covariance: expected {count} rows of {count} numbers, one for each parameter")
    if problems:
        raise EstimateError(
            *(Notice(code="estimate.format", text=problem, file=str(path)) for problem in problems)
        )
    return Estimate(**fields)


def _expect_text(value: object) -> str:
    if not isinstance(value, str):
        message = f"expected text, got {value!r}"
        raise TypeError(message)
    return value


def _explain(error: Exception) -> str:
    return f"{error} is missing" if isinstance(error, KeyError) else str(error)


def _expect_one_of(value: object, allowed: Collection[str]) -> str:
    text = _expect_text(value)
    if text not in allowed:
        message = f"expected one of {', '.join(allowed)}, got {text!r}"
        raise ValueError(message)
    return text


def _expect_table(value: object) -> dict[str, object]:
    if not isinstance(value, dict):
        message = f"expected a table, got {value!r}"
        raise TypeError(message)
    return value


def _expect_count(value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        message = f"expected a count, got {value!r}"
        raise ValueError(message)
    return value


def _expect_finite(value: object) -> float:
    if value is None:
        message = "expected a number, got null"
        raise TypeError(message)
    return _expect_number(value)


def _expect_number(value: object) -> float:
    if value is None:
        return math.inf
    if isinstance(value, bool) or not isinstance(value, int | float):
        message = f"expected a number, got {value!r}"
        raise TypeError(message)
    return float(value)


def _read_parameter(entry: Mapping[str, Any]) -> ParameterEstimate:
    truth = entry["truth"]
    return ParameterEstimate(
        name=_expect_text(entry["name"]),
        value=_expect_finite(entry["value"]),
        std=_expect_number(entry["std"]),
        unit=_expect_text(entry["unit"]),
        expression=_expect_text(entry["expression"]),
        reason=_expect_text(entry["reason"]),
        truth=None if truth is None else _expect_finite(truth),
    )


def _read_notice(entry: Mapping[str, Any]) -> Notice:
    return Notice(
        code=_expect_text(entry["code"]),
        text=_expect_text(entry["text"]),
        file=_expect_text(entry["file"]),
        line=_expect_count(entry["line"]),
        column=_expect_count(entry["column"]),
    )


def _read_residuals(value: Sequence[Any]) -> tuple[Residual, ...]:
    if not value:
        message = "expected one entry for each joint, got none"
        raise ValueError(message)
    return tuple(map(_read_residual, value))


def _read_residual(entry: Mapping[str, Any]) -> Residual:
    return Residual(
        joint=_expect_text(entry["joint"]),
        norm=_expect_finite(entry["norm"]),
        relative_percent=_expect_number(entry["relative_percent"]),
        std=_expect_number(entry["std"]),
        samples=_expect_count(entry["samples"]),
        unit=_expect_text(entry["unit"]),
    )
