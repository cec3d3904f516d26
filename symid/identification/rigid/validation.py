"""A stored estimate on a log: settings of the fit restored, model checked, torque predicted.

Estimate, robot, recording -> `ResolvedProcessing`, `Robot` as it was identified, `Validation`.

    stated      a cut-off or a decimation that options or the robot file state
    fit         what is left open, where the log has the sample period of the fit
    log         what is left open otherwise: chosen from the log, by the rule that the fit used

Supported: estimates of any rows, their windows, weights and runs; torque (the default), momentum and energy
rows for the validation; robots of rigid, elastic and friction results.
Not supported: fits of logs with different sample periods (the first one's is the period of the fit); a log
with other joints, or a model other than the estimate's.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from decimal import Decimal
from typing import Any, TypeGuard

import numpy as np

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.errors import EstimateError, Notice
from symid.identification.diagnostics import warn_of_fitted_log
from symid.identification.estimators import (
    OPEN_SETTINGS,
    Estimate,
    FitRecord,
    ResolvedProcessing,
    Series,
    Validation,
    check_model,
    compute_residuals,
)
from symid.identification.regression import (
    SAME_PERIOD,
    WINDOW,
    Rows,
    choose_filters,
    count_pieces,
    prepare_rows,
)
from symid.logs import Recording, is_log_of_fit
from symid.robot import (
    Decimation,
    InputReport,
    Place,
    Places,
    Processing,
    Robot,
    Section,
    describe_settings,
    override_settings,
    read_log,
    read_processing,
)


def resolve_processing(
    estimate: Estimate, processing: Processing, recording: Recording
) -> ResolvedProcessing:
    """Return how `recording` is processed under `estimate`.

    Args:
        estimate: its settings say how the fit processed its logs.
        processing: as stated now; what it leaves open (`automatic`) is the fit's or chosen.
        recording: the log.

    Raises:
        EstimateError: the settings of the estimate cannot be read.
    """
    left = _list_open(processing)
    stated = dict.fromkeys(OPEN_SETTINGS, "stated")
    if not left:
        return ResolvedProcessing(processing=replace(processing, automatic=False), origin=stated)
    if _has_same_period(estimate.settings, recording):
        fitted = read_fit_processing(estimate.settings)
        settled = replace(processing, automatic=False)
        if "filter_cutoff" in left:
            settled = replace(settled, filter_cutoff=fitted.filter_cutoff)
        if "decimation.factor" in left:
            settled = replace(
                settled, decimation=replace(settled.decimation, factor=fitted.decimation.factor)
            )
        return ResolvedProcessing(processing=settled, origin=stated | dict.fromkeys(left, "fit"))
    choice = choose_filters(processing, [recording])
    return ResolvedProcessing(
        processing=choice.processing,
        origin=stated | dict.fromkeys(left, "log"),
        notices=tuple(replace(notice, file=recording.source) for notice in choice.notices),
    )


def _list_open(processing: Processing) -> tuple[str, ...]:
    """Return which entries of `OPEN_SETTINGS` are left open."""
    if not processing.automatic:
        return ()
    left = (processing.filter_cutoff is None, processing.decimation.factor == 1)
    return tuple(name for name, free in zip(OPEN_SETTINGS, left, strict=True) if free)


def describe_processing(
    stated: Processing, used: Processing, recordings: Sequence[Recording]
) -> dict[str, object]:
    """Return for the settings of an estimate what was used, what of it was chosen, and the sample period.

    Args:
        stated: before the choice.
        used: after it.
        recordings: of the fit.
    """
    chosen = list(_list_open(stated))
    return {
        "processing": asdict(used),
        "sample_period": recordings[0].period,
        **({"chosen": chosen} if chosen else {}),
    }


def read_fit_processing(settings: Mapping[str, object]) -> Processing:
    """Return how the fit behind an estimate's settings processed its logs.

    Raises:
        EstimateError: the settings do not say so, or not in a usable way.
    """
    stored = settings.get("processing")
    table: dict[str, Any] = dict(stored) if isinstance(stored, Mapping) else {"": stored}
    try:
        decimation = Decimation(**table.get("decimation", {}))
        found = Processing(**{**table, "decimation": decimation})
    except TypeError:
        problem = _describe_unusable("processing", "a table of the processing", stored)
        raise EstimateError(problem) from None
    if found.filter_cutoff is not None and not _is_positive(found.filter_cutoff):
        raise EstimateError(
            _describe_unusable("filter_cutoff", "a positive number or null", found.filter_cutoff)
        )
    factor = decimation.factor
    if not _is_positive(factor) or not isinstance(factor, int):
        raise EstimateError(_describe_unusable("decimation.factor", "a positive whole number", factor))
    return found


def _has_same_period(settings: Mapping[str, object], recording: Recording) -> bool:
    period = settings.get("sample_period")
    return _is_positive(period) and math.isclose(period, recording.period, rel_tol=SAME_PERIOD)


def get_fit_window(settings: Mapping[str, object]) -> float:
    """Return the length in s of the windows that momentum and energy rows had, the default if none is told.

    Raises:
        EstimateError: it is no positive number.
    """
    window = settings.get("window", WINDOW)
    if not _is_positive(window):
        raise EstimateError(_describe_unusable("window", "a positive number", window))
    return float(window)


def get_usable_window(
    settings: Mapping[str, object], recording: Recording
) -> tuple[float, tuple[Notice, ...]]:
    """Return the windows of the fit in s; where `recording` is too coarse for them longer ones, and a notice.

    Raises:
        EstimateError: windows or overlap in the settings cannot be used.
    """
    window, pieces = get_fit_window(settings), count_pieces(get_fit_overlap(settings))
    # Windows are pieces of at least two sample periods, see `choose_windows`.
    if round(window / pieces / (2.0 * recording.period)) >= 1:
        return window, ()
    longer = 2.0 * recording.period * pieces
    text = (
        f"the windows of the fit, {window:g} s long, are too short for a log sampled every "
        f"{recording.period:g} s: windows of {longer:g} s stand in their place, whose residual is not to be "
        "compared with that of the fit"
    )
    return longer, (Notice(code="validate.longer-windows", text=text, file=recording.source),)


def get_fit_overlap(settings: Mapping[str, object]) -> float:
    """Return the part of a window that the next one shared, none if nothing is told.

    Raises:
        EstimateError: it is no part.
    """
    overlap = settings.get("overlap", 0.0)
    if isinstance(overlap, bool) or not isinstance(overlap, int | float) or not 0.0 <= overlap < 1.0:
        raise EstimateError(_describe_unusable("overlap", "a number from 0 to 1", overlap))
    return float(overlap)


def get_run_weights(settings: Mapping[str, object], count: int) -> tuple[float, ...] | None:
    """Return what the squares of each of `count` logs' residuals counted for in the fit, None if all alike.

    Raises:
        EstimateError: they are no positive numbers, one a log.
    """
    weights = settings.get("weights")
    if weights is None:
        return None
    usable = isinstance(weights, Sequence) and all(_is_positive(entry) for entry in weights)
    if not isinstance(weights, Sequence) or not usable or len(weights) != count:
        raise EstimateError(_describe_unusable("weights", f"{count} positive numbers", weights))
    return tuple(map(float, weights))


def _is_positive(value: object) -> TypeGuard[int | float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0.0 < value < float("inf")


def _describe_unusable(name: str, expected: str, found: object) -> Notice:
    text = f"its settings have no usable {name!r}: expected {expected}, got {found!r}"
    return Notice(code="estimate.settings", text=text)


def restore_robot(robot: Robot, estimate: FitRecord, settings: Sequence[tuple[str, str]] = ()) -> Robot:
    """Return the robot as it was when identified: with the estimate's friction, log map and processing.

    Settings of the call come last, and win. Where the estimate's differ from the robot file's,
    a notice of the robot says so. What the fit chose from its logs is left open again: it holds for logs with
    the sample period of the fit (`resolve_processing`).

    Args:
        robot: as its file says, or as it was overridden.
        estimate: of any kind.
        settings: keys and values.

    Raises:
        UsageError: a setting cannot be made here.
        EstimateError: what the estimate says of its log or processing cannot be read.
    """
    # A result of friction does not say friction models; its signature does.
    kinds = tuple(dict.fromkeys(estimate.friction))
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
    report = InputReport(Places(keys={}, values={}, whole=Place("", 0, 0)))
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


def validate_estimate(
    estimate: Estimate,
    library: Library,
    recording: Recording,
    processing: Processing,
    *,
    rows: str = "torque",
    window: float = WINDOW,
    overlap: float = 0.0,
) -> Validation:
    """Return residuals and series of `recording` under the estimate; nothing is fitted.

    Args:
        estimate: the parameters.
        library: the functions of the same model.
        recording: the log.
        processing: as stated; what it leaves open is as in the fit, see `resolve_processing`.
        rows: one of `ROW_KINDS`.
        window: length of windows in s.
        overlap: part of a window that the next one shares.

    Raises:
        EstimateError: the estimate belongs to another model than the library.
        LogError: the recording does not fit the robot.
        IdentifiabilityError: no joint moves in it.
    """
    check_model(estimate, library.card)
    fitted = is_log_of_fit(recording, estimate.sources, estimate.settings)
    settled = resolve_processing(estimate, processing, recording)
    built = prepare_rows(rows, library, recording, settled.processing, window=window, overlap=overlap)
    predicted = built.matrix @ estimate.assemble(built.names)
    return Validation(
        robot=estimate.robot,
        signature=estimate.signature,
        source=recording.source,
        rows=rows,
        residual=compute_residuals(built, built.values - predicted, 0),
        series=_split_series(built, predicted),
        samples=len(built.values),
        fitted=fitted,
        notices=(
            *settled.notices,
            *built.notices,
            *([warn_of_fitted_log(recording.source)] if fitted else []),
        ),
        processing=settled,
    )


def _split_series(rows: Rows, predicted: FloatArray) -> tuple[Series, ...]:
    masks = [(index, rows.group == index) for index in range(len(rows.group_names))]
    return tuple(
        Series(
            joint=rows.group_names[index],
            unit=rows.group_units[index],
            velocity_unit=rows.velocity_units[index],
            time=rows.time[mask],
            velocity=rows.velocity[mask],
            measured=rows.values[mask],
            predicted=predicted[mask],
        )
        for index, mask in masks
        if np.any(mask)
    )
