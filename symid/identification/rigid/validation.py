"""A stored estimate on logs: what it predicts of another one, and its diagnosis on those of the fit.

Estimate, robot, recording -> `ResolvedProcessing`, `Robot` as it was identified, `Validation`.
Estimate, the library of its model, the recordings of the fit -> `Diagnosis`.

Filter and decimation of a validation are

    stated      a cut-off or a decimation that options or the robot file state
    fit         what is left open, where the log has the sample period of the fit
    log         what is left open otherwise: chosen from the log, by the rule that the fit used

The equations of a diagnosis are those of the fit: its processing, windows, weights of runs, rule for the
noise. Where the estimator needs nothing else, the fit is repeated and compared with the estimate. The price
of decimation: fits to the rows that decimation keeps, and to every sample, predict held-out stretches of the
time, and the residuals of both on the decimated rows are compared.

Supported: estimates of any rows, their windows, weights and runs; torque (the default), momentum and energy
rows for the validation; robots of rigid, elastic and friction results; a diagnosis of estimates from torque
and momentum rows, whatever the estimator, logs of any number and length.
Not supported: fits of logs with different sample periods (the first one's is the period of the fit); a log
with other joints, or a model other than the estimate's; a diagnosis of energy and power rows, which mix the
joints.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from typing import Any, NoReturn, TypeGuard

import numpy as np
from numpy.typing import NDArray

from symid import robot as robots
from symid.arrays import FloatArray
from symid.codegen import Library
from symid.errors import EstimateError, Notice, UsageError, shorten_names
from symid.identification import diagnostics, estimators, regression
from symid.identification.diagnostics import uncertainty
from symid.identification.judge import POLICY, numerics
from symid.identification.regression import Rows, condensing
from symid.identification.rigid.fit import fit_in_memory, is_long
from symid.identification.rigid.plan import FILTERED_INSTRUMENTAL, FitPlan
from symid.identification.rigid.settings_choice import PASSED
from symid.logs import Recording, describe_overlap, has_states, low_pass, mask_states, measure_overlap
from symid.serialization import HIDDEN, name_key

_ORDER = 4


def smooth_rows(rows: Rows, values: FloatArray, band: float) -> FloatArray:
    """Return `values` (m, k) of rows low-passed at `band` in Hz, joint by joint, as they are if short."""
    found = values.copy()
    for run in np.unique(rows.run):
        for group in np.unique(rows.group):
            own = np.flatnonzero((rows.run == run) & (rows.group == group))
            if len(own) <= 3 * _ORDER + 1:
                continue
            period = float(np.median(np.diff(rows.time[own])))
            if band < PASSED / period:
                found[own] = low_pass(values[own], period=period, cutoff=band, order=_ORDER)
    return found


def mask_inner(rows: Rows) -> NDArray[np.bool_]:
    """Return the rows (m,) that are not near an end of their log."""
    inner = np.zeros(len(rows.time), dtype=np.bool_)
    for run in np.unique(rows.run):
        own = rows.run == run
        first, last = float(rows.time[own].min()), float(rows.time[own].max())
        left = min(condensing.ENDS, condensing.PART * (last - first))
        inner |= own & (rows.time >= first + left) & (rows.time <= last - left)
    return inner


def resolve_processing(
    estimate: estimators.Estimate, processing: robots.Processing, recording: Recording
) -> estimators.ResolvedProcessing:
    """Return how `recording` is processed under the settings of `estimate`.

    `processing` is stated now; what it leaves open (`automatic`) is the fit's, or chosen from the log.
    """
    left = processing.left_open
    stated = dict.fromkeys(estimators.OPEN_SETTINGS, "stated")
    told = [name for name in estimators.OPEN_SETTINGS if name in left]
    if not left:
        return estimators.ResolvedProcessing(processing=replace(processing, automatic=False), origin=stated)
    period = estimate.settings.get("sample_period")
    if _is_positive(period) and math.isclose(period, recording.period, rel_tol=POLICY.relevance):
        fitted = read_fit_processing(estimate.settings)
        factor = (fitted if "decimation.factor" in left else processing).decimation.factor
        settled = replace(
            processing,
            filter_cutoff=(fitted if "filter_cutoff" in left else processing).filter_cutoff,
            decimation=replace(processing.decimation, factor=factor),
            drop_first=max(processing.drop_first, fitted.drop_first),
            drop_last=max(processing.drop_last, fitted.drop_last),
            standstill=(fitted if "standstill" in left else processing).standstill,
            instrument_cutoff=processing.instrument_cutoff or fitted.instrument_cutoff,
            states=fitted.states if has_states(recording, fitted.states) else processing.states,
            differences=(fitted if "filter_cutoff" in left else processing).differences,
            automatic=False,
        )
        return estimators.ResolvedProcessing(processing=settled, origin=stated | dict.fromkeys(told, "fit"))
    choice = regression.choose_filters(processing, [recording])
    return estimators.ResolvedProcessing(
        processing=choice.processing,
        origin=stated | dict.fromkeys(told, "log"),
        notices=tuple(replace(notice, file=recording.source) for notice in choice.notices),
    )


def read_fit_processing(settings: Mapping[str, object]) -> robots.Processing:
    """Return how the fit behind an estimate's settings processed its logs, or an EstimateError."""
    stored = settings.get("processing")
    table: dict[str, Any] = dict(stored) if isinstance(stored, Mapping) else {"": stored}
    if isinstance(table.get("standstill"), list):
        table["standstill"] = tuple(table["standstill"])
    try:
        decimation = robots.Decimation(**table.get("decimation", {}))
        found = robots.Processing(**{**table, "decimation": decimation})
    except TypeError:
        _refuse("processing", "a table of the processing", stored)
    if found.filter_cutoff is not None and not _is_positive(found.filter_cutoff):
        _refuse("filter_cutoff", "a positive number or null", found.filter_cutoff)
    if not _is_positive(decimation.factor) or not isinstance(decimation.factor, int):
        _refuse("decimation.factor", "a positive whole number", decimation.factor)
    return found


def get_fit_window(settings: Mapping[str, object]) -> float:
    """Return the length in s of the windows of the fit; EstimateError if it is no positive number."""
    window = settings.get("window", regression.WINDOW)
    if not _is_positive(window):
        _refuse("window", "a positive number", window)
    return float(window)


def get_usable_window(
    settings: Mapping[str, object], recording: Recording
) -> tuple[float, tuple[Notice, ...]]:
    """Return the windows of the fit in s, longer ones with a notice where `recording` is too coarse."""
    window, pieces = get_fit_window(settings), regression.count_pieces(get_fit_overlap(settings))
    # Windows are pieces of at least two sample periods, see `choose_windows`.
    if round(window / pieces / (2.0 * recording.period)) >= 1:
        return window, ()
    longer = 2.0 * recording.period * pieces
    text = f"the windows of the fit ({window:g} s) are too short for a sample period of {recording.period:g} "
    text += f"s: those of {longer:g} s have another residual than the fit; log as fast as for it"
    return longer, (Notice(code="validate.longer-windows", text=text, file=recording.source),)


def get_fit_overlap(settings: Mapping[str, object]) -> float:
    """Return the part of a window that the next one shared; EstimateError if it is not from 0 to 1."""
    overlap = settings.get("overlap", 0.0)
    if isinstance(overlap, bool) or not isinstance(overlap, int | float) or not 0.0 <= overlap < 1.0:
        _refuse("overlap", "a number from 0 to 1", overlap)
    return float(overlap)


def get_run_weights(settings: Mapping[str, object], count: int) -> tuple[float, ...] | None:
    """Return the weights of each of `count` logs in the fit, None if all alike; EstimateError if unusable."""
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


def restore_robot(
    robot: robots.Robot, estimate: estimators.FitRecord, settings: Sequence[tuple[str, str]] = ()
) -> robots.Robot:
    """Return the robot as it was when identified: with the estimate's friction, log map and processing.

    Settings of the call, keys and values, come last, and win. Where the estimate's differ from the robot
    file's, a notice says so. What the fit chose from its logs is left open again (`resolve_processing`).
    """
    # A result of friction has no friction models; its signature has. Joints with different models have them
    # from the file: an option sets one for all.
    kinds = tuple(dict.fromkeys(estimate.friction))
    if isinstance(estimate, estimators.DynamicsRecord) and estimate.laws:
        laws = {law.joint: law.friction for law in estimate.laws}
        joints = [replace(joint, friction=laws.get(joint.name, joint.friction)) for joint in robot.joints]
        described = replace(robot, joints=tuple(joints))
    else:
        described = robots.override_settings(robot, (), kinds[0] if len(kinds) == 1 else None)
    mounting: Any = estimate.settings.get("mounting")
    if mounting:
        described = robots.mount_robot(described, mounting["gravity"], mounting["zeros"])
    restored = _restore_settings(described, estimate.settings)
    # The settings that differ between the estimate and the robot file, but for overridden ones. Where the fit
    # has chosen some from its logs, ends that it cut, instruments and velocities are chosen too.
    overridden = {key for key, _ in settings} | (_CHOSEN_TOO if estimate.settings.get("chosen") else set())
    of_file, of_estimate = (_flatten(robots.describe_settings(entry)) for entry in (described, restored))

    def list_differences(settings: dict[str, object]) -> list[str]:
        keys = sorted({*settings, *of_estimate} - overridden)
        pairs = [(key, of_estimate.get(key, "nothing"), settings.get(key, "nothing")) for key in keys]
        return [f"{key}: {mine!s:.40} (file: {other!s:.40})" for key, mine, other in pairs if mine != other]

    texts = list_differences(of_file)
    text = f"settings of the estimate differ from the robot file's, and are used: {shorten_names(texts, 8)}"
    for entry in described.settings if texts else ():
        of_set = robots.describe_settings(robots.override_settings(described, [("settings", entry.name)]))
        if not list_differences(_flatten(of_set)):
            # Those of a named set in the file differ together, and are named once.
            text = f"the estimate has the settings '{entry.name}' of the robot file, and they are used"
            texts = [] if "settings" in overridden else texts
            break
    notices = [Notice(code="estimate.settings-differ", text=text)] * bool(texts)
    restored = replace(restored, notices=(*restored.notices, *notices))
    if not settings:
        return restored
    changed = robots.override_settings(restored, settings)
    processing = changed.processing
    empty = {
        "processing.filter_cutoff": processing.filter_cutoff is None,
        "processing.decimation.factor": processing.decimation.factor == 1,
    }
    if not processing.automatic or not any(empty.get(key, False) for key, _ in settings):
        return changed
    # No filter and no decimation, where they are set, are no open entries: then all is as in the fit.
    return robots.override_settings(
        _restore_settings(restored, {**estimate.settings, "chosen": []}), settings
    )


def _restore_settings(robot: robots.Robot, settings: Mapping[str, object]) -> robots.Robot:
    """Return `robot` with the log map and the processing of an estimate, checked like those of a file."""
    processing, chosen = settings.get("processing"), settings.get("chosen", ())
    if not isinstance(processing, Mapping):
        text = "its settings have no usable 'processing'; identify again"
        raise EstimateError(Notice(code="estimate.settings", text=text))
    if isinstance(chosen, Sequence) and chosen:
        # What the fit chose from its logs is left open.
        processing = {**processing, "automatic": True, "states": "position"}
        processing |= {name: "none" for name in ("filter_cutoff", "standstill") if name in chosen}
        if "decimation.factor" in chosen and isinstance(processing.get("decimation"), Mapping):
            processing["decimation"] = {**processing["decimation"], "factor": 1}
    values = {"processing": _make_exact(processing)}
    if "log" in settings:
        values["log"] = _make_exact(settings["log"])
    root = robots.Section(values=values, places=robots.Places())
    log = robots.read_log(root, robot.joints) if "log" in values else robot.log
    restored = replace(robot, log=log, processing=robots.read_processing(root))
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


_CHOSEN_TOO = {
    f"processing.{name}" for name in ("drop_first", "drop_last", "instrument_cutoff", "states", "differences")
}


def _flatten(value: object, prefix: str = "") -> dict[str, object]:
    if not isinstance(value, Mapping):
        return {prefix: value}
    parts = (_flatten(entry, f"{prefix}.{key}" if prefix else str(key)) for key, entry in value.items())
    return {key: entry for part in parts for key, entry in part.items()}


def validate_estimate(
    estimate: estimators.Estimate,
    library: Library,
    recording: Recording,
    processing: robots.Processing,
    *,
    rows: str = "torque",
    **windows: float,
) -> estimators.Validation:
    """Return residuals and series of `recording` under the estimate; nothing is fitted.

    What `processing` leaves open is as in the fit, see `resolve_processing`. `rows` is one of `ROW_KINDS`,
    `windows` are `window` and `overlap` of `build_rows`. Where the fit chose its settings and `processing`
    leaves a filter or a decimation open, residuals of torque, momentum and filtered rows count within the
    band that they were chosen by.
    """
    estimators.check_model(estimate, library.card)
    settled = resolve_processing(estimate, processing, recording)
    stored: Any = estimate.settings.get("processing")
    known = (stored.get(name) for name in ("drop_first", "drop_last")) if isinstance(stored, Mapping) else ()
    first, last = (entry if isinstance(entry, int) else 0 for entry in known or (0, 0))
    cut, fitted_cut = (settled.processing.drop_first, settled.processing.drop_last), (first, last)
    # Slow rows count, as in the residual of the fit.
    counted = replace(settled.processing, standstill=None)
    recording = replace(recording, bad=mask_states(recording, counted))
    whole = regression.prepare_rows(rows, library, recording, counted, every=True, **windows)
    built = regression.leave_out_rows(whole, library, recording, counted)
    shared = measure_overlap(recording, estimate.sources, estimate.settings, cut=cut, fitted_cut=fitted_cut)
    # Who states filter and decimation of the log compares its rows, as publications do. Without held-out
    # stretches, as of long logs, the fit has nothing to compare with.
    scoring, values, scalar = 0.0, estimate.assemble(built.names), rows in regression.SCALAR_KINDS
    left_open = {*settled.origin.values()} != {"stated"}
    if estimate.choice is not None and estimate.evidence is not None and left_open and not scalar:
        scoring = estimate.choice.scoring

    def score(part: regression.Rows) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return rows and what is left of them (m, 2), both within the band, and which of them count."""
        table = np.column_stack([part.values, part.values - part.matrix @ values])
        inner = np.ones(len(part.time), dtype=np.bool_)
        if scoring:
            table, within = smooth_rows(part, table, scoring), mask_inner(part)
            inner = within if within.any() else inner
        return table, inner

    predicted = built.matrix @ values
    own = [(index, np.flatnonzero(built.group == index)) for index in np.unique(built.group)]
    series = tuple(
        estimators.Series(
            joint=built.group_names[index],
            unit=built.group_units[index],
            velocity_unit=built.velocity_units[index],
            time=built.time[places],
            velocity=built.velocity[places],
            measured=built.values[places],
            predicted=predicted[places],
        )
        for index, places in own
    )
    warnings = []
    if shared:
        told = {"what": "estimate", "part": describe_overlap(shared, recording, cut)}
        warnings = [diagnostics.build_warning("validate.fitted-log", file=recording.source, **told)]
    residual, (table, inner) = estimators.compute_residuals(built, built.values - predicted, 0), score(built)
    smooth = replace(regression.select_rows(built, inner), values=table[inner, 0])
    motion = []
    if not scalar:
        # What is left of all rows in the phases of motion; joints without rows that count are left out of
        # residuals.
        (left, counts), names = score(whole), {series.joint for series in series}
        for group in np.unique(whole.group):
            part, name = counts & (whole.group == group), whole.group_names[group]
            if part.any():
                phases = estimators.find_phases(whole.time[part], whole.velocity[part], whole.run[part])
                left_out, unit = 0 if name in names else int(np.sum(part)), whole.group_units[group]
                found = estimators.MotionResidual.measure(name, unit, left[part, 1], phases, left_out)
                motion.append(found)
    return estimators.Validation(
        robot=estimate.robot,
        signature=estimate.signature,
        source=recording.source,
        rows=rows,
        residual=estimators.compute_residuals(smooth, table[inner, 1], 0),
        scoring=scoring,
        all_rows=residual if scoring else (),
        motion=tuple(motion),
        series=series,
        samples=len(built.values),
        fitted=shared > 0.0,
        notices=(*settled.notices, *built.notices, *warnings),
        processing=settled,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Price:
    """The price of a choice: `what` in words, `percent` more of `of`."""

    what: str
    of: str
    percent: float


def measure_decimation_price(
    builder: regression.RowBuilder,
    recordings: Sequence[Recording],
    identifiability: regression.Identifiability,
    groups: FloatArray,
    weights: Sequence[float] | None = None,
) -> tuple[Price, ...]:
    """Return the prices of decimation against every sample; none without it, or with too few rows.

    `groups` are the weights (g,) of the joints, `weights` those of each recording's squared residuals.
    """
    if builder.kind != "torque" or builder.processing.decimation.factor == 1:
        return ()
    every = builder._replace(processing=replace(builder.processing, decimation=robots.Decimation()))
    found: list[tuple[FloatArray, NDArray[np.intp], FloatArray]] = []
    for entry in (builder, every):
        long = regression.condense_recordings(entry, recordings, weights)
        if long is None:
            return ()
        condensed, sketch = long.condense(), long.sketch()
        basis = regression.analyse_condensed(condensed, long.rows.kind, long.rows.names).basis
        own = estimators.fit_condensed(condensed, basis, groups, builder.processing.noise_freedom)
        # Weighted rows [A B, y] with the squares of all equations, and the stretch of time of each.
        table = np.column_stack([sketch.matrix @ identifiability.basis, sketch.values])
        counts = [int(np.sum(sketch.group == group)) for group in np.unique(sketch.group)]
        fold = np.concatenate([np.arange(count) * POLICY.folds // count for count in counts])
        deviations = np.sqrt(np.maximum(np.diag(own.covariance), 0.0))
        found.append((table * groups[sketch.group][:, None], fold, deviations))
    (judged, number, ours), (others, place, theirs) = found
    both = (ours > 0.0) & (theirs > 0.0)
    if not both.any():
        return ()
    left = np.zeros(2)
    for part in range(POLICY.folds):
        held = judged[number == part]
        for index, table in enumerate((judged[number != part], others[place != part])):
            values = np.linalg.lstsq(table[:, :-1], table[:, -1], rcond=numerics.RANK)[0]
            left[index] += float(np.sum((held[:, -1] - held[:, :-1] @ values) ** 2))
    held_out = 100.0 * (float(np.sqrt(left[0] / left[1])) - 1.0) if left[1] else 0.0
    what = f"decimation by {builder.processing.decimation.factor}"
    wider = 100.0 * (float(np.median(ours[both] / theirs[both])) - 1.0)
    return (
        Price(what=what, of="held-out residual", percent=held_out),
        Price(what=what, of="median stated standard deviation (for white noise)", percent=wider),
    )


_KINDS = ("torque", "momentum")
_ALONE = ("ols", "wls", "huber", "sequential", FILTERED_INSTRUMENTAL)
"""Estimators that need nothing but rows."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Diagnosis:
    """All that follows from a fit and its logs beyond the parameters.

    `singular` values are of the weighted matrix with columns of length one; `correlated` (name, name,
    correlation), the closest first, with the `ellipse` of that pair; `structure` functions that explain the
    residual of each joint, `profiles` the residual against states; `prices` of the estimator against plain
    least squares of the same weights, and of decimation; `refit` largest difference, in stated deviations,
    between the estimate and the fit made again, None where the estimator needs more than the logs.
    """

    singular: tuple[float, ...] = field(metadata=name_key("singular_values"))
    rank: int
    correlated: tuple[tuple[str, str, float], ...]
    ellipse: uncertainty.Ellipse | None = field(metadata=HIDDEN)
    essential: uncertainty.Essential
    bootstrap: uncertainty.Bootstrap
    drift: uncertainty.Drift
    structure: tuple[diagnostics.ResidualFinding, ...]
    profiles: tuple[diagnostics.JointProfiles, ...] = field(metadata=HIDDEN)
    prices: tuple[Price, ...]
    refit: float | None = None
    notices: tuple[Notice, ...] = field(default=(), metadata=HIDDEN)


def diagnose_estimate(
    estimate: estimators.Estimate,
    library: Library,
    recordings: Sequence[Recording],
    processing: robots.Processing,
) -> Diagnosis:
    """Return the diagnosis of `estimate` on the recordings that it was fitted to, as their runs are set.

    What `processing` leaves open is taken from the estimate.
    """
    estimators.check_model(estimate, library.card)
    if estimate.rows not in _KINDS:
        text = f"{estimate.rows} equations sum over the joints, which a diagnosis separates; use torque ones"
        raise UsageError(Notice(code="usage.mixed-rows", text=text))
    settled = resolve_processing(estimate, processing, recordings[0])
    processing, weights = settled.processing, get_run_weights(estimate.settings, len(recordings))
    window, overlap = get_fit_window(estimate.settings), get_fit_overlap(estimate.settings)
    builder = regression.RowBuilder(estimate.rows, library, processing, window, overlap)
    alone = estimate.estimator in _ALONE
    # The choice says by which speed a row is slow, but not to fits of logs that are too long for memory.
    long = is_long(builder, recordings, estimate.estimator, numerics.LARGEST)
    plan = FitPlan(
        processing=processing,
        estimator=estimate.estimator if alone else "wls",
        scoring=0.0 if long or estimate.choice is None else estimate.choice.scoring,
    )
    fitted = fit_in_memory(builder, recordings, plan, rule=regression.RankRule(), weights=weights)
    rows, identifiability = fitted.rows, fitted.identifiability
    values = estimate.assemble(rows.names)
    names, stated = [entry.name for entry in estimate.parameters], np.array(estimate.covariance)
    covariance = np.zeros((len(rows.names), len(rows.names)))
    places = [(k, names.index(name)) for k, name in enumerate(rows.names) if name in names]
    if places:
        ours, theirs = (list(index) for index in zip(*places, strict=True))
        covariance[np.ix_(ours, ours)] = stated[np.ix_(theirs, theirs)]
    groups = np.ones(len(rows.group_names))
    if estimate.estimator != "ols":
        groups = estimators.estimate_group_weights(rows, identifiability, processing.noise_freedom)
    least = estimators.fit_weighted(rows, identifiability, groups, processing.noise_freedom)
    residuals = rows.values - rows.matrix @ values
    fit = replace(least, values=values, covariance=covariance, residuals=residuals)
    correlated, ellipse = uncertainty.list_correlated(stated, names), None
    if correlated:
        pair = [names.index(name) for name in correlated[0][:2]]
        chosen = [estimate.parameters[k].value for k in pair]
        ellipse = uncertainty.compute_ellipse(chosen, stated[np.ix_(pair, pair)])
    refit: float | None = None
    if alone:
        # The largest difference between the estimate and the same fit made again, in its deviations.
        again = dict(zip(rows.names, fitted.fit.values.tolist(), strict=True))
        away = [
            abs(again[entry.name] - entry.value) / max(entry.std, np.finfo(float).eps * abs(entry.value))
            for entry in estimate.parameters
            if entry.std or entry.value
        ]
        refit = max(away, default=0.0)
    # By how much the residual is larger than that of plain least squares of the same weights.
    own, best = (float(np.linalg.norm(entry.residuals * fit.weights)) for entry in (fit, least))
    percent = 100.0 * (own / best - 1.0) if best else 0.0
    what = f"estimator {estimate.estimator} instead of least squares"
    price = (Price(what=what, of="residual", percent=percent),) if percent >= numerics.CONVERGED else ()
    changed = refit is not None and refit > numerics.CONVERGED
    warnings = (diagnostics.build_warning("diagnosis.other-values", refit=refit),) if changed else ()
    call = values, library, recordings, processing
    structure, profiles = diagnostics.analyse_residuals(*call, weights=weights)
    return Diagnosis(
        singular=tuple(map(float, regression.compute_spectrum(rows.matrix * fit.weights[:, None]).singular)),
        rank=int(identifiability.basis.shape[1]),
        correlated=correlated,
        ellipse=ellipse,
        essential=uncertainty.select_essential(rows, fit, identifiability, freedom=processing.noise_freedom),
        bootstrap=uncertainty.compute_bootstrap(rows, fit, identifiability, np.random.default_rng(0)),
        drift=uncertainty.measure_drift(rows, fit, processing.noise_freedom),
        structure=structure,
        profiles=profiles,
        prices=(*price, *measure_decimation_price(builder, recordings, identifiability, groups, weights)),
        refit=refit,
        notices=(*settled.notices, *warnings),
    )
