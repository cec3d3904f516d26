"""The plan of a fit: options of a call checked, and what they leave open settled from the logs.

Options, robot -> checked options, those of the estimator. Library, recordings, options -> `FitPlan`.

    rows        one sample in r = 0.4 rate / band, so that decimation passes what lies within the band
    cut-off     at which noise and blur of the velocities are equal
    ends        two periods of the cut-off; of that of instruments, where a log begins or ends in motion

Supported: any settings stated, the others chosen around them.
Not supported: a choice for power and energy rows, and for logs with fewer rows than parameters
(`choose_filters` takes its place).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from symid.codegen import Library
from symid.errors import Notice, UsageError
from symid.identification import estimators, judge, regression
from symid.identification.rigid.settings_choice import PASSED, SettingsStudy, choose_settings
from symid.joint_models import NO_FRICTION, get_law
from symid.logs import Recording
from symid.options import RigidOptions, list_options
from symid.robot import Processing, Robot, suggest_names

FILTERED_INSTRUMENTAL = "filtered-instrumental"
"""The estimator with instruments along positions that pass a low-pass."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FitPlan:
    """Settings with nothing open, the estimator, the study behind them (None for none), notices on it.

    `scoring` in Hz: slow rows are chosen by positions that pass it, by those of the fit where 0. Rows within
    `margin` s of slow ones are left out with them.
    """

    processing: Processing
    estimator: str
    study: SettingsStudy | None = None
    notices: tuple[Notice, ...] = ()
    scoring: float = 0.0
    margin: float = 0.0


def plan_fit(
    library: Library,
    recordings: Sequence[Recording],
    processing: Processing,
    *,
    rows: str,
    estimator: str | None,
    long: bool = False,
) -> FitPlan:
    """Return settings and estimator with nothing left open.

    `estimator` None is chosen; `long` logs do without instruments. A UsageError where instruments are wanted,
    and their cut-off is neither stated nor chosen.
    """
    usual = "wls" if library.card.size > 1 else "ols"
    if processing.instrument_cutoff and not long:
        usual = FILTERED_INSTRUMENTAL
    wanted = estimator or usual
    if not processing.left_open and wanted == FILTERED_INSTRUMENTAL and processing.instrument_cutoff is None:
        text = f"--estimator {FILTERED_INSTRUMENTAL} needs the cut-off of its instruments where it is not "
        text += "chosen from the log; state it in Hz, as --set processing.instrument_cutoff=3"
        raise UsageError(Notice(code="usage.no-instruments", text=text))
    spans = [entry.time[-1] - entry.time[0] for entry in recordings]
    count = 2.0 * judge.POLICY.row_band / recordings[0].period * library.card.size * sum(spans)
    if rows in regression.SCALAR_KINDS or count < len(library.card.fitted):
        filters = regression.choose_filters(processing, recordings)
        settled = cut_moving_ends(filters.processing, recordings) if processing.left_open else processing
        settled = replace(settled, automatic=False)
        return FitPlan(processing=settled, estimator=wanted, notices=filters.notices)
    rate = 1.0 / recordings[0].period
    bends = any(get_law(joint.friction).own for joint in library.card.joints if joint.friction != NO_FRICTION)
    rests = bends and "standstill" in processing.left_open and _find_rests(recordings)
    # All candidates have instruments where the call wants them, none where none can.
    instruments: tuple[bool, ...] = (False,)
    if estimator == FILTERED_INSTRUMENTAL and processing.instrument_cutoff is None:
        instruments = (True,)
    elif estimator is None and rows == "torque" and not long and processing.left_open:
        instruments = (False, True)
    study = choose_settings(library, recordings, processing, instruments=instruments, moving=rests)
    if not processing.left_open:
        return FitPlan(processing=replace(processing, automatic=False), estimator=wanted, study=study)
    taken, decimation = study.choice.chosen, processing.decimation
    if "decimation.factor" in processing.left_open:
        decimation = replace(decimation, factor=max(1, math.floor(PASSED * rate / taken.band + 1e-6)))
    standstill = processing.standstill
    if "standstill" in processing.left_open:
        standstill = tuple(float(f"{speed:.3g}") for speed in study.choice.standstill)
        standstill = standstill if any(standstill) else None
    cutoff = processing.filter_cutoff
    if "filter_cutoff" in processing.left_open:
        cutoff = float(f"{study.cutoff:.3g}") if study.cutoff else None
    settled = cut_moving_ends(
        replace(
            processing,
            filter_cutoff=cutoff,
            decimation=decimation,
            standstill=standstill,
            states=taken.states,
            differences=study.differences,
            instrument_cutoff=processing.instrument_cutoff or float(f"{taken.instruments:.3g}") or None,
            automatic=False,
        ),
        recordings,
    )
    if estimator is None:
        estimator = FILTERED_INSTRUMENTAL if settled.instrument_cutoff else usual
    text = f"chosen from the logs among {len(study.choice.candidates)} settings: one sample in "
    text += f"{settled.decimation.factor}, positions pass a low-pass at {settled.filter_cutoff:g} Hz, "
    text += f"estimator {estimator}"
    if taken.instruments:
        text += f" with instruments along positions that pass {settled.instrument_cutoff:g} Hz"
    if taken.states != "position":
        text += f", states with the logged {taken.states}"
    slow = [
        f"{joint.name} {speed:.3g}"
        for joint, speed in zip(library.card.joints, study.choice.standstill, strict=True)
        if speed
    ]
    if slow and "standstill" in processing.left_open:
        text += f", samples slower than these speeds left out: {', '.join(slow)}"
    text += ". To set them, state them under [processing]"
    note = Notice(code="identify.automatic", text=text)
    plan = FitPlan(
        processing=settled, estimator=estimator, study=study, scoring=study.choice.scoring, notices=(note,)
    )
    if rests:
        # At rest dry friction is any torque below its level, which a law that bends near standstill would
        # follow. The filters spread it: rows within three periods of what rows pass go with slow ones.
        text = "joints rest in these logs, where stiction holds any torque, and with these friction laws "
        text += "only settings that leave out slow samples were tried"
        note = Notice(code="identify.automatic", text=text)
        margin = 3.0 * plan.processing.decimation.factor * recordings[0].period / PASSED
        plan = replace(plan, margin=margin, notices=(*plan.notices, note))
    return plan


def _find_rests(recordings: Sequence[Recording]) -> bool:
    """Return whether a joint that moves in the logs rests in a part of them; one joint is in memory."""
    run = np.repeat(np.arange(len(recordings)), [len(entry.time) for entry in recordings])
    time = np.concatenate([entry.time for entry in recordings])
    speeds = (
        np.concatenate([np.gradient(entry.position[:, k], entry.period) for entry in recordings])
        for k in range(recordings[0].position.shape[1])
    )
    return any(
        bool(column.any())
        and np.mean(estimators.find_phases(time, column, run) == estimators.PHASES.index("rest"))
        > judge.POLICY.relevance
        for column in speeds
    )


def cut_moving_ends(processing: Processing, recordings: Sequence[Recording]) -> Processing:
    """Return the settings with ends cut off where filters extrapolate.

    Of instruments only where a log moves there: they lose a twentieth of the shortest log at most. What is
    stated is never cut less.
    """
    cutoff = processing.instrument_cutoff or processing.filter_cutoff
    ends = regression.measure_moving_ends(replace(processing, filter_cutoff=cutoff), recordings)
    most = round(regression.condensing.PART * min(len(entry.time) for entry in recordings))
    spoilt = max(regression.count_spoilt(processing.filter_cutoff, entry.period) for entry in recordings)
    first, last = (max(spoilt, min(end, most)) for end in ends)
    return replace(
        processing,
        drop_first=max(first, processing.drop_first or 0),
        drop_last=max(last, processing.drop_last or 0),
    )


def list_unknown(what: str, name: str, allowed: Sequence[str], more: str = "") -> list[Notice]:
    """Return a notice where `name` is not allowed."""
    if name in allowed:
        return []
    hint = suggest_names(name, allowed)
    text = f"unknown {what} {name!r}: {f'{hint} ' if hint else ''}allowed are {', '.join(allowed)}{more}"
    return [Notice(code=f"usage.unknown-{what}", text=text)]


OUTPUT_ERROR, INSTRUMENTAL = "output-error", "instrumental"
SIMULATING = (OUTPUT_ERROR, INSTRUMENTAL)
"""Estimators that simulate the robot, see `closed_loop_estimate`."""
_WINDOWED = ("momentum", "filtered", "energy")
_OVERLAPPING = ("momentum", "energy")
_DEVIATION = 20.0
PRIOR_OF_ROBOT = "robot"
"""The prior that stands in the robot file."""


def check_estimator(rows: str, estimator: str | None) -> None:
    """Refuse an estimator that no rows of a rigid robot know; those of friction laws are others."""
    more = f" with --rows {rows}; those of friction laws go with --rows friction"
    allowed = (*estimators.ESTIMATORS, FILTERED_INSTRUMENTAL, *SIMULATING)
    if estimator is not None and (notices := list_unknown("estimator", estimator, allowed, more)):
        raise UsageError(*notices)


def check_rigid_options(rows: str, estimator: str | None, options: RigidOptions) -> None:
    """Refuse options that belong to other rows or to another estimator."""
    ridge, flags = (estimator == "ridge", "--estimator ridge"), list_options(RigidOptions)
    wanted = {
        "window": (rows in _WINDOWED, f"--rows {', '.join(_WINDOWED)}"),
        "overlap": (rows in _OVERLAPPING, f"--rows {' and '.join(_OVERLAPPING)}"),
        "period": (estimator == "gls", "--estimator gls and --rows friction"),
        **dict.fromkeys(("prior", "prior_percent", "prior_factor", "prior_weight"), ridge),
        "start": (estimator in SIMULATING, f"--estimator {' and '.join(SIMULATING)}"),
    }
    found = [
        ("mixed-options", f"{flags[name].name_flag(name)} belongs to {owner}; leave it out, or choose these")
        for name, (fits, owner) in wanted.items()
        if getattr(options, name) not in (None, ()) and not fits
    ]
    own = options.prior in (None, PRIOR_OF_ROBOT)
    if (options.prior_factor if own else options.prior_percent) is not None:
        text = "prior_percent is of the robot file's values, prior_factor of an estimate; take the other"
        found.append(("prior", text))
    if estimator in SIMULATING and rows != "torque":
        text = f"--estimator {estimator} needs torque equations; leave --rows {rows} out"
        found.append(("mixed-options", text))
    if found:
        raise UsageError(*(Notice(code=f"usage.{code}", text=text) for code, text in found))


def build_estimator_options(
    robot: Robot,
    library: Library,
    recordings: Sequence[Recording],
    estimator: str | None,
    options: RigidOptions,
    *,
    prior: estimators.Estimate | None = None,
) -> dict[str, Any]:
    """Return the options of an estimator; `prior` is of the same model, None for values of the robot file."""
    if estimator == "ridge":
        known = (
            estimators.build_prior_of_card(library.card, (options.prior_percent or _DEVIATION) / 100.0)
            if prior is None
            else estimators.build_prior_of_estimate(prior, options.prior_factor or 1.0)
        )
        return {"prior": known, "prior_weight": options.prior_weight}
    if estimator == "consistent":
        return {"bodies": estimators.build_bodies(robot)}
    if estimator == "gls" and options.period:
        return {"noise": estimators.estimate_period_noise(recordings, robot.processing, options.period)}
    return {}
