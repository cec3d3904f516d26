"""How a log is processed under an estimate: as the fit was, where nothing else is stated.

Input: an estimate, processing as it is stated now, a recording. Output: `SettledProcessing`.

    stated      a cut-off or a decimation that options or the robot file state
    fit         what is left open, where the log has the sample period of the fit
    log         what is left open otherwise: chosen from the log, by the rule that the fit used (`cutoff`)

Supported: estimates of any rows; what an estimate says of its runs, windows and weights.
Not supported: fits of logs with different sample periods: the first one's is the period of the fit.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any, TypeGuard

from symid.data.recording import Recording
from symid.errors import EstimateError, Notice
from symid.estimators.estimate import CHOSEN, Estimate, SettledProcessing
from symid.robot.log_map import Decimation, Processing
from symid.rows.cutoff import SAME_PERIOD, choose_filters
from symid.rows.rows import WINDOW, find_pieces

__all__ = [
    "describe_processing",
    "find_overlap",
    "find_run_weights",
    "find_usable_window",
    "find_window",
    "read_fit_processing",
    "settle_as_fitted",
]


def settle_as_fitted(estimate: Estimate, processing: Processing, recording: Recording) -> SettledProcessing:
    """Return how `recording` is processed under `estimate`.

    Args:
        estimate: its settings say how the fit processed its logs.
        processing: as stated now; what it leaves open (`automatic`) is the fit's or chosen.
        recording: the log.

    Raises:
        EstimateError: the settings of the estimate cannot be read.
    """
    left = _list_open(processing)
    stated = dict.fromkeys(CHOSEN, "stated")
    if not left:
        return SettledProcessing(processing=replace(processing, automatic=False), origin=stated)
    if _has_same_period(estimate.settings, recording):
        fitted = read_fit_processing(estimate.settings)
        settled = replace(processing, automatic=False)
        if "filter_cutoff" in left:
            settled = replace(settled, filter_cutoff=fitted.filter_cutoff)
        if "decimation.factor" in left:
            settled = replace(
                settled, decimation=replace(settled.decimation, factor=fitted.decimation.factor)
            )
        return SettledProcessing(processing=settled, origin=stated | dict.fromkeys(left, "fit"))
    choice = choose_filters(processing, [recording])
    return SettledProcessing(
        processing=choice.processing,
        origin=stated | dict.fromkeys(left, "log"),
        notices=tuple(replace(notice, file=recording.source) for notice in choice.notices),
    )


def _list_open(processing: Processing) -> tuple[str, ...]:
    """Return which entries of `CHOSEN` are left open."""
    if not processing.automatic:
        return ()
    left = (processing.filter_cutoff is None, processing.decimation.factor == 1)
    return tuple(name for name, free in zip(CHOSEN, left, strict=True) if free)


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
        problem = _describe("processing", "a table of the processing", stored)
        raise EstimateError(problem) from None
    if found.filter_cutoff is not None and not _is_positive(found.filter_cutoff):
        raise EstimateError(_describe("filter_cutoff", "a positive number or null", found.filter_cutoff))
    factor = decimation.factor
    if not _is_positive(factor) or not isinstance(factor, int):
        raise EstimateError(_describe("decimation.factor", "a positive whole number", factor))
    return found


def _has_same_period(settings: Mapping[str, object], recording: Recording) -> bool:
    period = settings.get("sample_period")
    return _is_positive(period) and math.isclose(period, recording.period, rel_tol=SAME_PERIOD)


def find_window(settings: Mapping[str, object]) -> float:
    """Return the length in s of the windows that momentum and energy rows had, the default if none is told.

    Raises:
        EstimateError: it is no positive number.
    """
    window = settings.get("window", WINDOW)
    if not _is_positive(window):
        raise EstimateError(_describe("window", "a positive number", window))
    return float(window)


def find_usable_window(
    settings: Mapping[str, object], recording: Recording
) -> tuple[float, tuple[Notice, ...]]:
    """Return the windows of the fit in s; where `recording` is too coarse for them longer ones, and a notice.

    Raises:
        EstimateError: windows or overlap in the settings cannot be used.
    """
    window, pieces = find_window(settings), find_pieces(find_overlap(settings))
    # Windows are pieces of at least two sample periods, see `find_windows`.
    if round(window / pieces / (2.0 * recording.period)) >= 1:
        return window, ()
    longer = 2.0 * recording.period * pieces
    text = (
        f"the windows of the fit, {window:g} s long, are too short for a log sampled every "
        f"{recording.period:g} s: windows of {longer:g} s stand in their place, whose residual is not to be "
        "compared with that of the fit"
    )
    return longer, (Notice(code="validate.longer-windows", text=text, file=recording.source),)


def find_overlap(settings: Mapping[str, object]) -> float:
    """Return the part of a window that the next one shared, none if nothing is told.

    Raises:
        EstimateError: it is no part.
    """
    overlap = settings.get("overlap", 0.0)
    if isinstance(overlap, bool) or not isinstance(overlap, int | float) or not 0.0 <= overlap < 1.0:
        raise EstimateError(_describe("overlap", "a number from 0 to 1", overlap))
    return float(overlap)


def find_run_weights(settings: Mapping[str, object], count: int) -> tuple[float, ...] | None:
    """Return what the squares of each of `count` logs' residuals counted for in the fit, None if all alike.

    Raises:
        EstimateError: they are no positive numbers, one a log.
    """
    weights = settings.get("weights")
    if weights is None:
        return None
    usable = isinstance(weights, Sequence) and all(_is_positive(entry) for entry in weights)
    if not isinstance(weights, Sequence) or not usable or len(weights) != count:
        raise EstimateError(_describe("weights", f"{count} positive numbers", weights))
    return tuple(map(float, weights))


def _is_positive(value: object) -> TypeGuard[int | float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0.0 < value < float("inf")


def _describe(name: str, expected: str, found: object) -> Notice:
    text = f"its settings have no usable {name!r}: expected {expected}, got {found!r}"
    return Notice(code="estimate.settings", text=text)
