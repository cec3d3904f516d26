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
from dataclasses import replace
from decimal import Decimal
from typing import Any, NoReturn, TypeGuard

import numpy as np

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.errors import EstimateError, Notice
from symid.identification.diagnostics import build_warning, mask_inner, smooth_rows
from symid.identification.estimators import (
    OPEN_SETTINGS,
    Estimate,
    FitRecord,
    MotionResidual,
    Residual,
    ResolvedProcessing,
    Series,
    Validation,
    check_model,
    compute_residuals,
    find_phases,
)
from symid.identification.regression import (
    SAME_PERIOD,
    SCALAR_KINDS,
    WINDOW,
    Rows,
    choose_filters,
    count_pieces,
    leave_out_rows,
    prepare_all_rows,
    select_rows,
)
from symid.joint_models import FrictionValues, rename_law
from symid.logs import Ends, Recording, describe_overlap, has_states, measure_overlap
from symid.robot import (
    Decimation,
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
    """Return how `recording` is processed under the settings of `estimate`.

    `processing` is stated now; what it leaves open (`automatic`) is the fit's, or chosen from the log.

    Raises:
        EstimateError: the settings of the estimate cannot be read.
    """
    left = processing.left_open
    stated = dict.fromkeys(OPEN_SETTINGS, "stated")
    told = [name for name in OPEN_SETTINGS if name in left]
    if not left:
        return ResolvedProcessing(processing=replace(processing, automatic=False), origin=stated)
    period = estimate.settings.get("sample_period")
    if _is_positive(period) and math.isclose(period, recording.period, rel_tol=SAME_PERIOD):
        fitted = read_fit_processing(estimate.settings)
        settled = replace(
            processing,
            drop_first=max(processing.drop_first, fitted.drop_first),
            drop_last=max(processing.drop_last, fitted.drop_last),
            standstill=fitted.standstill if "standstill" in left else processing.standstill,
            instrument_cutoff=processing.instrument_cutoff or fitted.instrument_cutoff,
            states=fitted.states if has_states(recording, fitted.states) else processing.states,
            automatic=False,
        )
        if "filter_cutoff" in left:
            settled = replace(settled, filter_cutoff=fitted.filter_cutoff)
        if "decimation.factor" in left:
            settled = replace(
                settled, decimation=replace(settled.decimation, factor=fitted.decimation.factor)
            )
        return ResolvedProcessing(processing=settled, origin=stated | dict.fromkeys(told, "fit"))
    choice = choose_filters(processing, [recording])
    return ResolvedProcessing(
        processing=choice.processing,
        origin=stated | dict.fromkeys(told, "log"),
        notices=tuple(replace(notice, file=recording.source) for notice in choice.notices),
    )


def read_fit_processing(settings: Mapping[str, object]) -> Processing:
    """Return how the fit behind an estimate's settings processed its logs.

    Raises:
        EstimateError: the settings do not say so, or not in a usable way.
    """
    stored = settings.get("processing")
    table: dict[str, Any] = dict(stored) if isinstance(stored, Mapping) else {"": stored}
    if isinstance(table.get("standstill"), list):
        table["standstill"] = tuple(table["standstill"])
    try:
        decimation = Decimation(**table.get("decimation", {}))
        found = Processing(**{**table, "decimation": decimation})
    except TypeError:
        _refuse("processing", "a table of the processing", stored)
    if found.filter_cutoff is not None and not _is_positive(found.filter_cutoff):
        _refuse("filter_cutoff", "a positive number or null", found.filter_cutoff)
    if not _is_positive(decimation.factor) or not isinstance(decimation.factor, int):
        _refuse("decimation.factor", "a positive whole number", decimation.factor)
    return found


def _get_fit_cut(estimate: Estimate) -> Ends:
    """Return the samples that the processing of a fit cut off at both ends of its logs."""
    stored = estimate.settings.get("processing")
    found = [stored.get(name) for name in ("drop_first", "drop_last")] if isinstance(stored, Mapping) else []
    first, last = (entry if isinstance(entry, int) else 0 for entry in (*found, 0, 0)[:2])
    return first, last


def get_fit_window(settings: Mapping[str, object]) -> float:
    """Return the length in s of the windows of momentum and energy rows in the fit.

    Raises:
        EstimateError: it is no positive number.
    """
    window = settings.get("window", WINDOW)
    if not _is_positive(window):
        _refuse("window", "a positive number", window)
    return float(window)


def get_usable_window(
    settings: Mapping[str, object], recording: Recording
) -> tuple[float, tuple[Notice, ...]]:
    """Return the windows of the fit in s, longer ones with a notice where `recording` is too coarse for them.

    Raises:
        EstimateError: windows or overlap in the settings cannot be used.
    """
    window, pieces = get_fit_window(settings), count_pieces(get_fit_overlap(settings))
    # Windows are pieces of at least two sample periods, see `choose_windows`.
    if round(window / pieces / (2.0 * recording.period)) >= 1:
        return window, ()
    longer = 2.0 * recording.period * pieces
    text = (
        f"the windows of the fit ({window:g} s) are too short for a sample period of {recording.period:g} s: "
        f"windows of {longer:g} s are used, whose residual cannot be compared with that of the fit"
    )
    notice = Notice(code="validate.longer-windows", text=text, file=recording.source)
    return longer, (notice,)


def get_fit_overlap(settings: Mapping[str, object]) -> float:
    """Return the part of a window that the next one shared in the fit.

    Raises:
        EstimateError: it is not between 0 and 1.
    """
    overlap = settings.get("overlap", 0.0)
    if isinstance(overlap, bool) or not isinstance(overlap, int | float) or not 0.0 <= overlap < 1.0:
        _refuse("overlap", "a number from 0 to 1", overlap)
    return float(overlap)


def get_run_weights(settings: Mapping[str, object], count: int) -> tuple[float, ...] | None:
    """Return the weights of the squared residuals of each of `count` logs in the fit, None if all alike.

    Raises:
        EstimateError: they are no positive numbers, one a log.
    """
    weights = settings.get("weights")
    if weights is None:
        return None
    entries = list(weights) if isinstance(weights, Sequence) else []
    if len(entries) != count or not all(map(_is_positive, entries)):
        _refuse("weights", f"{count} positive numbers", weights)
    return tuple(map(float, entries))


def _is_positive(value: object) -> TypeGuard[int | float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0.0 < value < float("inf")


def _refuse(name: str, expected: str, found: object) -> NoReturn:
    text = f"its settings have no usable {name!r}: expected {expected}, got {found!r}"
    raise EstimateError(Notice(code="estimate.settings", text=text))


def restore_robot(robot: Robot, estimate: FitRecord, settings: Sequence[tuple[str, str]] = ()) -> Robot:
    """Return the robot as it was when identified: with the estimate's friction, log map and processing.

    Settings of the call, keys and values, come last, and win. Where the estimate's differ from the robot
    file's, a notice says so. What the fit chose from its logs is left open again (`resolve_processing`).

    Raises:
        UsageError: a setting cannot be made here.
        EstimateError: the log map or the processing of the estimate cannot be read.
    """
    # A result of friction has no friction models; its signature has.
    kinds = tuple(dict.fromkeys(estimate.friction))
    # Joints with different models have them from the file: an option sets one for all.
    described = _restore_laws(robot, estimate)
    if described is robot:
        described = override_settings(robot, (), kinds[0] if len(kinds) == 1 else None)
    restored = _restore_settings(described, estimate.settings)
    notices = _compare_settings(described, restored, settings, estimate.settings.get("chosen"))
    restored = replace(restored, notices=(*restored.notices, *notices))
    if not settings:
        return restored
    changed = override_settings(restored, settings)
    processing = changed.processing
    empty = {
        "processing.filter_cutoff": processing.filter_cutoff is None,
        "processing.decimation.factor": processing.decimation.factor == 1,
    }
    if not processing.automatic or not any(empty.get(key, False) for key, _ in settings):
        return changed
    # No filter and no decimation, where they are set, are no open entries: then all is as in the fit.
    return override_settings(_restore_settings(restored, {**estimate.settings, "chosen": []}), settings)


def _restore_laws(robot: Robot, estimate: FitRecord) -> Robot:
    """Return the robot with the friction laws that an estimate has chosen or fitted."""
    laws = {law.joint: law for law in estimate.laws} if isinstance(estimate, Estimate) else {}
    if not laws:
        return robot
    joints = tuple(
        replace(
            joint,
            friction=FrictionValues(
                law=rename_law(laws[joint.name].law),
                shape=laws[joint.name].shape,
                smoothing=laws[joint.name].smoothing,
            ),
        )
        if joint.name in laws
        else joint
        for joint in robot.joints
    )
    return replace(robot, joints=joints)


def _restore_settings(robot: Robot, settings: Mapping[str, object]) -> Robot:
    """Return `robot` with the log map and the processing of an estimate, checked like those of a file."""
    processing, chosen = settings.get("processing"), settings.get("chosen", ())
    if not isinstance(processing, Mapping):
        text = "its settings have no usable 'processing'; identify again"
        raise EstimateError(Notice(code="estimate.settings", text=text))
    if isinstance(chosen, Sequence) and chosen:
        # What the fit chose from its logs is left open.
        processing = {**processing, "automatic": True, "states": "position"}
        if "filter_cutoff" in chosen:
            processing["filter_cutoff"] = "none"
        if "standstill" in chosen:
            processing["standstill"] = "none"
        if "decimation.factor" in chosen and isinstance(processing.get("decimation"), Mapping):
            processing["decimation"] = {**processing["decimation"], "factor": 1}
    values = {"processing": _make_exact(processing)}
    if "log" in settings:
        values["log"] = _make_exact(settings["log"])
    root = Section(values=values, places=Places())
    log = read_log(root, robot.joints) if "log" in values else robot.log
    restored = replace(robot, log=log, processing=read_processing(root))
    if root.errors:
        texts = (f"its settings cannot be used: {notice.text}; identify again" for notice in root.errors)
        raise EstimateError(*(Notice(code="estimate.settings", text=text) for text in texts))
    return restored


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


_CHOSEN_TOO = tuple(
    f"processing.{name}" for name in ("drop_first", "drop_last", "instrument_cutoff", "states")
)


def _compare_settings(
    described: Robot, restored: Robot, settings: Sequence[tuple[str, str]], chosen: object
) -> tuple[Notice, ...]:
    """Return the settings that differ between the estimate and the robot file, but for overridden ones.

    Those of a named set in the file differ together, and are named once. Where the fit has `chosen` some from
    its logs, ends that it cut, instruments and velocities are chosen too.
    """
    overridden = {key for key, _ in settings} | ({*_CHOSEN_TOO} if chosen else set())
    of_estimate = _flatten(describe_settings(restored))
    for entry in described.settings:
        of_set = _flatten(describe_settings(override_settings(described, [("settings", entry.name)])))
        if of_set == of_estimate and describe_settings(described) != describe_settings(restored):
            text = f"the estimate has the settings '{entry.name}' of the robot file, and they are used"
            named = Notice(code="estimate.settings-differ", text=text)
            return () if "settings" in overridden else (named,)
    of_file = _flatten(describe_settings(described))
    notices = []
    for key in sorted({*of_file, *of_estimate} - overridden):
        mine, other = of_estimate.get(key, "nothing"), of_file.get(key, "nothing")
        if mine != other:
            text = f"{key}: the estimate has {mine}, the robot file {other}; that of the estimate is used"
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

    What `processing` leaves open is as in the fit, see `resolve_processing`. `rows` is one of `ROW_KINDS`,
    `window` the length of windows in s, `overlap` the part of one that the next one shares. Where the fit
    chose its settings and `processing` leaves a filter or a decimation open, residuals of torque, momentum
    and filtered rows count within the band that they were chosen by.

    Raises:
        EstimateError: the estimate belongs to another model than the library.
        LogError: the recording does not fit the robot.
        IdentifiabilityError: no joint moves in it.
    """
    check_model(estimate, library.card)
    settled = resolve_processing(estimate, processing, recording)
    cut, fitted_cut = (settled.processing.drop_first, settled.processing.drop_last), _get_fit_cut(estimate)
    # Slow rows count, as in the residual of the fit.
    counted = replace(settled.processing, standstill=None)
    whole = prepare_all_rows(rows, library, recording, counted, window=window, overlap=overlap)
    built = leave_out_rows(whole, library, recording, counted)
    shared = measure_overlap(recording, estimate.sources, estimate.settings, cut=cut, fitted_cut=fitted_cut)
    predicted = built.matrix @ estimate.assemble(built.names)
    masks = [(index, built.group == index) for index in range(len(built.group_names))]
    series = tuple(
        Series(
            joint=built.group_names[index],
            unit=built.group_units[index],
            velocity_unit=built.velocity_units[index],
            time=built.time[mask],
            velocity=built.velocity[mask],
            measured=built.values[mask],
            predicted=predicted[mask],
        )
        for index, mask in masks
        if np.any(mask)
    )
    warnings = []
    if shared:
        part = describe_overlap(shared, recording, cut)
        warnings = [build_warning("validate.fitted-log", file=recording.source, what="estimate", part=part)]
    residual = compute_residuals(built, built.values - predicted, 0)
    # Who states filter and decimation of the log compares its rows, as publications do.
    choice, scoring = estimate.choice, 0.0
    left_open = {*settled.origin.values()} != {"stated"}
    # Without held-out stretches, as of long logs, the fit has nothing to compare with.
    if choice is not None and estimate.evidence is not None and left_open and rows not in SCALAR_KINDS:
        scoring = choice.scoring
    return Validation(
        robot=estimate.robot,
        signature=estimate.signature,
        source=recording.source,
        rows=rows,
        residual=_score(built, predicted, scoring) if scoring else residual,
        scoring=scoring,
        all_rows=residual if scoring else (),
        motion=_measure_motion(whole, whole.matrix @ estimate.assemble(whole.names), built, scoring),
        series=series,
        samples=len(built.values),
        fitted=shared > 0.0,
        notices=(*settled.notices, *built.notices, *warnings),
        processing=settled,
    )


def _measure_motion(
    whole: Rows, predicted: FloatArray, counted: Rows, scoring: float
) -> tuple[MotionResidual, ...]:
    """Return what is left of `whole` rows beside what is predicted of them (m,), in the phases of motion.

    Within the `scoring` band in Hz if there is one. Joints without `counted` rows are left out of residuals.
    """
    if whole.kind in SCALAR_KINDS:
        return ()
    errors, inner = whole.values - predicted, np.ones(len(whole.values), dtype=np.bool_)
    if scoring:
        errors, inner = smooth_rows(whole, errors[:, None], scoring)[:, 0], mask_inner(whole)
        inner = inner if inner.any() else np.ones_like(inner)
    names = {counted.group_names[group] for group in np.unique(counted.group)}
    found = []
    for group in np.unique(whole.group):
        own, name = inner & (whole.group == group), whole.group_names[group]
        if own.any():
            phases = find_phases(whole.time[own], whole.velocity[own], whole.run[own])
            left_out = 0 if name in names else int(np.sum(own))
            unit = whole.group_units[group]
            found.append(MotionResidual.measure(name, unit, errors[own], phases, left_out))
    return tuple(found)


def _score(rows: Rows, predicted: FloatArray, scoring: float) -> tuple[Residual, ...]:
    """Return the residuals of rows and what is predicted of them (m,), both low-passed at `scoring` Hz."""
    table = smooth_rows(rows, np.column_stack([rows.values, rows.values - predicted]), scoring)
    inner = mask_inner(rows)
    inner = inner if inner.any() else np.ones_like(inner)
    smooth = replace(select_rows(rows, inner), values=table[inner, 0])
    return compute_residuals(smooth, table[inner, 1], 0)
