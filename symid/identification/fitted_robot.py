"""A robot as it was when its estimate was made: the estimate's friction, log map and processing.

Input: a robot as it is read now, an estimate, settings of a call. Output: `Robot`.

Supported: estimates of rigid and elastic robots, and results of friction.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from decimal import Decimal
from typing import Protocol

from symid.errors import EstimateError, Notice
from symid.formats.loading import override_settings
from symid.formats.positions import Place, Places
from symid.formats.section import Report, Section
from symid.formats.settings import describe_settings, read_log, read_processing
from symid.robot.description import Robot

__all__ = ["StoredSettings", "restore_robot"]


class StoredSettings(Protocol):
    """What every stored result has."""

    @property
    def settings(self) -> Mapping[str, object]:
        """Return processing, log map and options of the fit."""
        ...


def restore_robot(robot: Robot, estimate: StoredSettings, settings: Sequence[tuple[str, str]] = ()) -> Robot:
    """Return the robot as it was when identified: with the estimate's friction, log map and processing.

    Settings of the call come last, and win. Where the estimate's differ from the robot file's,
    a notice of the robot says so. What the fit chose from its logs is left open again: it holds for logs with
    the sample period of the fit (`settle_as_fitted`).

    Args:
        robot: as its file says, or as it was overridden.
        estimate: of any kind.
        settings: keys and values.

    Raises:
        UsageError: a setting cannot be made here.
        EstimateError: what the estimate says of its log or processing cannot be read.
    """
    # A result of friction does not say friction models; its signature does.
    kinds = tuple(dict.fromkeys(getattr(estimate, "friction", ())))
    # Joints with different models have them from the file: an option sets one for all.
    described = override_settings(robot, (), kinds[0] if len(kinds) == 1 else None)
    restored = _restore_settings(described, estimate.settings)
    notices = _compare_settings(described, restored, {key for key, _ in settings})
    restored = replace(restored, notices=(*restored.notices, *notices))
    return _override_fitted(restored, estimate.settings, settings) if settings else restored


def _override_fitted(
    robot: Robot, fitted: Mapping[str, object], settings: Sequence[tuple[str, str]]
) -> Robot:
    """Return the robot of an estimate with settings of the call.

    No filter and no decimation, where they are set, are no gaps to fill: then all is as in the fit.
    """
    changed = override_settings(robot, settings)
    processing = changed.processing
    empty = {
        "processing.filter_cutoff": processing.filter_cutoff is None,
        "processing.decimation.factor": processing.decimation.factor == 1,
    }
    if not processing.automatic or not any(empty.get(key, False) for key, _ in settings):
        return changed
    return override_settings(_restore_settings(robot, {**fitted, "chosen": []}), settings)


def _restore_settings(robot: Robot, settings: Mapping[str, object]) -> Robot:
    """Return `robot` with the log map and the processing of an estimate, checked like those of a file."""
    if not isinstance(settings.get("processing"), Mapping):
        text = "its settings have no usable 'processing'; identify again"
        raise EstimateError(Notice(code="estimate.settings", text=text))
    values = {key: _make_exact(settings[key]) for key in ("log", "processing") if key in settings}
    values["processing"] = _leave_open(values["processing"], settings.get("chosen", ()))
    report = Report(Places(keys={}, values={}, whole=Place("", 0, 0)))
    root = Section(values=values, path=(), report=report)
    log = read_log(root, robot.joints) if "log" in values else robot.log
    restored = replace(robot, log=log, processing=read_processing(root))
    if report.errors:
        texts = (f"its settings cannot be used: {notice.text}; identify again" for notice in report.errors)
        raise EstimateError(*(Notice(code="estimate.settings", text=text) for text in texts))
    return restored


def _leave_open(processing: object, chosen: object) -> object:
    """Return the processing without what the fit chose from its logs."""
    if not isinstance(processing, Mapping) or not isinstance(chosen, Sequence) or not chosen:
        return processing
    table = {**processing, "automatic": True}
    if "filter_cutoff" in chosen:
        table["filter_cutoff"] = "none"
    if "decimation.factor" in chosen and isinstance(table.get("decimation"), Mapping):
        table["decimation"] = {**table["decimation"], "factor": 1}
    return table


def _make_exact(value: object) -> object:
    """Return `value` as a robot file would give it: numbers as decimals, "none" for null."""
    match value:
        case None:
            return "none"
        case float():
            return Decimal(repr(value))
        case Mapping():
            return {str(key): _make_exact(entry) for key, entry in value.items()}
        case list():
            return [_make_exact(entry) for entry in value]
    return value


def _compare_settings(described: Robot, restored: Robot, overridden: set[str]) -> tuple[Notice, ...]:
    """Return what the estimate and the robot file say differently, but for what is set by hand anyway."""
    of_file, of_estimate = _flatten(describe_settings(described)), _flatten(describe_settings(restored))
    notices = []
    for key in sorted({*of_file, *of_estimate} - overridden):
        mine, other = of_estimate.get(key, "nothing"), of_file.get(key, "nothing")
        if mine != other:
            text = f"{key}: the estimate has {mine}, the robot file {other}; the estimate was followed"
            notices.append(Notice(code="estimate.settings-differ", text=text))
    return tuple(notices)


def _flatten(value: object, prefix: str = "") -> dict[str, object]:
    if not isinstance(value, Mapping):
        return {prefix: value}
    parts = (_flatten(entry, f"{prefix}.{key}" if prefix else str(key)) for key, entry in value.items())
    return {key: entry for part in parts for key, entry in part.items()}
