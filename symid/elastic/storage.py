"""Estimates of elastic joints as files: JSON, written at once or not at all, read back without loss.

ElasticEstimate <-> file.

Supported: format 1, SI units. A number that is not finite is written as null.
Not supported: estimates of rigid robots; `identification.storage` has them.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from symid.codegen.functions import ModelCard
from symid.elastic.estimate import ElasticEstimate, MethodTrial, SpringEstimate
from symid.elastic.fit import ElasticOutcome, HistoryEntry
from symid.errors import EstimateError, Notice, RobotError
from symid.estimators.estimate import ParameterEstimate, Residual
from symid.identification.storage import write_file
from symid.robot.elasticity import Elasticity, Knee, Stop

__all__ = ["check_elastic_model", "is_elastic_estimate", "read_elastic_estimate", "write_elastic_estimate"]

_FORMAT = "symid elastic estimate"
_VERSION = 1


def write_elastic_estimate(estimate: ElasticEstimate, path: Path) -> Path:
    """Write the estimate to `path` as JSON and return the path.

    Raises:
        OutputError: the file cannot be written.
    """
    data = _write_plain({"format": _FORMAT, "version": _VERSION, **asdict(estimate)})
    data["outcome"] = estimate.outcome.name
    for trial, entry in zip(estimate.trials, data["trials"], strict=True):
        entry["outcome"] = trial.outcome.name
    return write_file(path, json.dumps(data, indent=1, allow_nan=False, ensure_ascii=False) + "\n")


def read_elastic_estimate(path: Path, card: ModelCard | None = None) -> ElasticEstimate:
    """Return the estimate stored at `path`.

    Args:
        path: a file that `write_elastic_estimate` wrote.
        card: the model that it must belong to, if given.

    Raises:
        EstimateError: there is no such file, it holds something else, or belongs to another model.
    """
    data = _read_json(path)
    if data.get("format") != _FORMAT:
        raise _refuse(path, "this is JSON, but not an estimate of elastic joints written by symid")
    if data.get("version") != _VERSION:
        raise _refuse(path, f"version {data.get('version')!r} of the format; this symid reads {_VERSION}")
    try:
        estimate = _build_estimate(data)
    except RobotError as error:
        raise _refuse(path, f"a spring that cannot be: {error}") from error
    except KeyError as error:
        raise _refuse(path, f"{error} is missing or unknown") from error
    except (TypeError, ValueError, AttributeError, OverflowError) as error:
        raise _refuse(path, str(error)) from error
    if card is not None:
        check_elastic_model(estimate, card, path)
    return estimate


def is_elastic_estimate(path: Path) -> bool:
    """Return whether `path` holds an estimate of elastic joints, whatever else may be wrong with it."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(data, dict) and data.get("format") == _FORMAT


def check_elastic_model(estimate: ElasticEstimate, card: ModelCard, path: Path | str = "") -> None:
    """Refuse an estimate of another model, or one that was changed by hand until it fits no model.

    Raises:
        EstimateError: it is; `path` is named.
    """
    if estimate.signature != card.signature:
        text = (
            f"the estimate is of robot {estimate.robot!r}, and its model is not that of {card.robot!r} as it "
            "is now; use the same robot and options, or identify again"
        )
        raise EstimateError(Notice(code="estimate.signature", text=text, file=str(path)))
    rotors = [f"IA{joint.number}" for joint in card.joints]
    expected = [*(entry.name for entry in card.beta), *rotors, *(entry.name for entry in card.friction)]
    found = [entry.name for entry in estimate.parameters]
    joints = [joint.name for joint in card.joints]
    springs = [entry.joint for entry in estimate.springs]
    if found != expected or springs not in ([], joints) or len(estimate.residual) != len(joints):
        text = (
            f"its parameters, springs and residuals are not those of the model {card.robot!r}: expected "
            f"{', '.join(expected)}, and springs for {', '.join(joints)} or none; identify again"
        )
        raise EstimateError(Notice(code="estimate.parameters", text=text, file=str(path)))


def _refuse(path: Path, text: str) -> EstimateError:
    return EstimateError(Notice(code="estimate.format", text=text, file=str(path)))


def _write_plain(value: Any) -> Any:  # noqa: ANN401 (JSON is what it is)
    """Return `value` with tuples as lists and numbers that are not finite as None."""
    match value:
        case float():
            return value if math.isfinite(value) else None
        case Mapping():
            return {str(key): _write_plain(entry) for key, entry in value.items()}
        case tuple() | list():
            return [_write_plain(entry) for entry in value]
    return value


def _read_json(path: Path) -> dict[str, Any]:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise _refuse(path, f"cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise _refuse(path, "not a text file, so not an estimate") from error
    except (ValueError, RecursionError) as error:
        raise _refuse(path, f"not JSON: {error}") from error
    if not isinstance(data, dict):
        raise _refuse(path, "this is JSON, but not an estimate of elastic joints written by symid")
    return data


def _build_estimate(data: Mapping[str, Any]) -> ElasticEstimate:
    count = len(data["parameters"])
    covariance = tuple(tuple(_read_number(entry) for entry in row) for row in data["covariance"])
    if {len(covariance), *map(len, covariance)} - {0, count}:
        message = f"covariance: expected {count} rows of {count} numbers, one for each parameter"
        raise ValueError(message)
    return ElasticEstimate(
        robot=_read_text(data["robot"]),
        signature=_read_text(data["signature"]),
        method=_read_text(data["method"]),
        reason=_read_text(data["reason"]),
        parameters=tuple(
            ParameterEstimate(
                **{**entry, "value": _read_finite(entry["value"]), "std": _read_number(entry["std"])}
            )
            for entry in data["parameters"]
        ),
        springs=tuple(map(_read_spring, data["springs"])),
        residual=tuple(map(_read_residual, data["residual"])),
        energy=_read_residual(data["energy"]),
        condition=_read_number(data["condition"]),
        outcome=ElasticOutcome[data["outcome"]],
        history=tuple(
            HistoryEntry(
                merit=_read_number(entry["merit"]),
                change=_read_number(entry["change"]),
                damping=_read_finite(entry["damping"]),
                norms=tuple(map(_read_number, entry["norms"])),
            )
            for entry in data["history"]
        ),
        trials=tuple(map(_read_trial, data["trials"])),
        sources=tuple(map(_read_text, data["sources"])),
        settings=dict(data["settings"]),
        refused=tuple((_read_text(name), _read_text(reason)) for name, reason in data["refused"]),
        covariance=covariance,
        notices=tuple(Notice(**entry) for entry in data["notices"]),
    )


def _read_text(value: object) -> str:
    if not isinstance(value, str):
        message = f"expected text, got {value!r}"
        raise TypeError(message)
    return value


def _read_flag(value: object) -> bool:
    if not isinstance(value, bool):
        message = f"expected true or false, got {value!r}"
        raise TypeError(message)
    return value


def _read_finite(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        message = f"expected a number, got {value!r}"
        raise TypeError(message)
    return float(value)


def _read_number(value: object) -> float:
    return math.inf if value is None else _read_finite(value)


def _read_trial(entry: Mapping[str, Any]) -> MethodTrial:
    error = entry["error"]
    return MethodTrial(
        method=_read_text(entry["method"]),
        outcome=ElasticOutcome[entry["outcome"]],
        error=None if error is None else _read_finite(error),
        values=tuple(map(_read_finite, entry["values"])),
    )


def _read_residual(entry: Mapping[str, Any]) -> Residual:
    return Residual(
        joint=_read_text(entry["joint"]),
        norm=_read_finite(entry["norm"]),
        relative_percent=_read_number(entry["relative_percent"]),
        std=_read_number(entry["std"]),
        samples=int(_read_finite(entry["samples"])),
        unit=_read_text(entry["unit"]),
    )


def _read_spring(entry: Mapping[str, Any]) -> SpringEstimate:
    truth = entry["truth"]
    return SpringEstimate(
        joint=_read_text(entry["joint"]),
        torque_unit=_read_text(entry["torque_unit"]),
        position_unit=_read_text(entry["position_unit"]),
        torsion=_read_finite(entry["torsion"]),
        excited=_read_finite(entry["excited"]),
        torque=_read_finite(entry["torque"]),
        elasticity=_read_elasticity(entry["elasticity"]),
        truth=None if truth is None else _read_elasticity(truth),
        # Estimates of before springs could be refused do not say.
        told=_read_flag(entry.get("told", True)),
        reason=_read_text(entry.get("reason", "")),
    )


def _read_elasticity(entry: Mapping[str, Any]) -> Elasticity:
    return Elasticity(
        stiffness=_read_finite(entry["stiffness"]),
        damping=_read_finite(entry["damping"]),
        cubic=_read_finite(entry["cubic"]),
        stops=tuple(
            Stop(threshold=_read_finite(stop["threshold"]), stiffness=_read_finite(stop["stiffness"]))
            for stop in entry["stops"]
        ),
        knees=tuple(
            Knee(threshold=_read_finite(knee["threshold"]), slope=_read_finite(knee["slope"]))
            for knee in entry["knees"]
        ),
    )
