"""The plan of a fit: options of a call checked, and what they leave open settled from the logs.

Options, robot -> checked options, `EstimatorOptions`. Library, recordings, Processing, options -> `FitPlan`.

    rows        one sample in r = 0.4 rate / band, so that decimation passes what lies within the band
    cut-off     min(5 band, 0.4 rate): high enough that it damps nothing that the rows keep
    ends        two periods of the cut-off, where a log begins or ends in motion

Supported: any settings stated, the others chosen around them.
Not supported: a choice for power and energy rows and for short logs (`choose_filters` takes its place).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from symid.codegen import Library
from symid.errors import Notice, UsageError
from symid.identification import estimators
from symid.identification.diagnostics import PART
from symid.identification.regression import (
    SCALAR_KINDS,
    balance_cutoff,
    choose_filters,
    measure_moving_ends,
)
from symid.identification.rigid.friction_tables import limit_cutoff
from symid.identification.rigid.settings_choice import ROW_RATE, choose_settings
from symid.joint_models import NO_FRICTION, get_law
from symid.logs import Recording, choose_cutoff
from symid.options import RigidOptions, list_options
from symid.robot import Processing, Robot, suggest_names

FILTERED_INSTRUMENTAL = "filtered-instrumental"
"""The estimator with instruments along positions that pass a low-pass."""
_PASSED = 0.4
"""Of the rate of rows: what decimation passes."""
_LEAST_FACTOR = 2.5
"""Times the band: cut-off below which a stated one damps the rows."""
_FEWEST = 4
"""Rows a parameter, at least, for held-out stretches to mean something."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FitPlan:
    """Settings with nothing open, the estimator, the choice behind them (None for none), notices on it.

    `laws_chosen`: friction laws were chosen from the same logs, so that no other needs to be tried. Rows
    within `margin` s of slow ones are left out with them.
    """

    processing: Processing
    estimator: str
    choice: estimators.SettingsChoice | None = None
    notices: tuple[Notice, ...] = ()
    laws_chosen: bool = False
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

    `estimator` None is chosen; `long` logs do without instruments.

    Raises:
        UsageError: instruments are wanted, and their cut-off is neither stated nor chosen.
        LogError: the recordings are not sampled alike, or one does not fit the robot.
        IdentifiabilityError: no joint moves in a recording.
    """
    usual = "wls" if library.card.size > 1 else "ols"
    if processing.instrument_cutoff and not long:
        usual = FILTERED_INSTRUMENTAL
    plan: FitPlan | None = None
    if not processing.left_open:
        plan = FitPlan(processing=replace(processing, automatic=False), estimator=estimator or usual)
    else:
        filters = choose_filters(processing, recordings)
        spans = [entry.time[-1] - entry.time[0] for entry in recordings]
        count = library.card.size * sum(span * ROW_RATE for span in spans)
        if rows in SCALAR_KINDS or count < _FEWEST * len(library.card.fitted):
            settled = cut_moving_ends(filters.processing, recordings)
            plan = FitPlan(processing=settled, estimator=estimator or usual, notices=filters.notices)
    if plan is not None:
        if plan.estimator == FILTERED_INSTRUMENTAL and plan.processing.instrument_cutoff is None:
            text = (
                f"--estimator {FILTERED_INSTRUMENTAL} needs the cut-off of its instruments where it is not "
                "chosen from the log; state it in Hz, as --set processing.instrument_cutoff=3"
            )
            raise UsageError(Notice(code="usage.no-instruments", text=text))
        return plan
    rate = 1.0 / recordings[0].period
    bends = any(get_law(joint.friction).own for joint in library.card.joints if joint.friction != NO_FRICTION)
    rests = bends and "standstill" in processing.left_open and _find_rests(recordings)
    # All candidates have instruments where the call wants them, none where none can.
    instruments: tuple[bool, ...] = (False,)
    if estimator == FILTERED_INSTRUMENTAL and processing.instrument_cutoff is None:
        instruments = (True,)
    elif estimator is None and rows == "torque" and not long:
        instruments = (False, True)
    choice = choose_settings(
        library,
        recordings,
        processing,
        band=None if processing.decimation.factor == 1 else _PASSED * rate / processing.decimation.factor,
        widest=None if processing.filter_cutoff is None else processing.filter_cutoff / _LEAST_FACTOR,
        instruments=instruments,
        moving=rests,
    )
    taken, decimation = choice.chosen, processing.decimation
    if decimation.factor == 1:
        decimation = replace(decimation, factor=max(1, math.floor(_PASSED * rate / taken.band + 1e-6)))
    kept = _PASSED * rate / decimation.factor
    standstill = processing.standstill
    if standstill is None:
        standstill = tuple(float(f"{taken.standstill * speed:.3g}") for speed in choice.top)
        standstill = standstill if any(standstill) else None
    settled = cut_moving_ends(
        replace(
            processing,
            filter_cutoff=processing.filter_cutoff or choose_cutoff(kept, rate),
            decimation=decimation,
            standstill=standstill,
            states=taken.states,
            instrument_cutoff=processing.instrument_cutoff or float(f"{taken.instruments:.3g}") or None,
            automatic=False,
        ),
        recordings,
    )
    if estimator is None:
        estimator = FILTERED_INSTRUMENTAL if settled.instrument_cutoff else usual
    widest = max(choice.candidates, key=lambda entry: (-entry.instruments, entry.band, -entry.standstill))
    text = (
        f"chosen from the logs among {len(choice.candidates)} settings: one row in "
        f"{settled.decimation.factor}, positions pass a low-pass at {settled.filter_cutoff:g} Hz, estimator "
        f"{estimator}"
    )
    if taken.instruments:
        text += f" with instruments along positions that pass {settled.instrument_cutoff:g} Hz"
    if taken.states != "position":
        text += f", states with the logged {taken.states}"
    if taken.standstill:
        text += f", rows slower than {100.0 * taken.standstill:g} % of each joint's top speed left out"
    text += (
        f". Fits without a stretch leave {taken.held_out[-1]:.3g} % of its torque below "
        f"{choice.scoring:.3g} Hz unexplained, those with all rows of the widest band and least squares "
        f"{widest.held_out[-1]:.3g} %. To set them, state them under [processing]"
    )
    note = Notice(code="identify.automatic", text=text)
    plan = FitPlan(processing=settled, estimator=estimator, choice=choice, notices=(note,))
    if bends:
        plan = _limit_cutoff(plan, processing, recordings)
    if rests:
        # At rest dry friction is any torque below its level, which a law that bends near standstill would
        # follow. The filters spread it: rows within three periods of what rows pass go with slow ones.
        text = (
            "joints rest in these logs, where friction holds any torque, and with these friction laws only "
            "settings that leave out slow rows were tried"
        )
        note = Notice(code="identify.automatic", text=text)
        margin = 3.0 * plan.processing.decimation.factor * recordings[0].period / _PASSED
        plan = replace(plan, margin=margin, notices=(*plan.notices, note))
    return plan


def _limit_cutoff(plan: FitPlan, processing: Processing, recordings: Sequence[Recording]) -> FitPlan:
    """Return the plan with a cut-off at which noise and blur of the velocity are equal, or a lower one."""
    # Where a friction law bends with the velocity, noise biases it, and no instrument takes that out. Where
    # slow rows are left out, noise well below the slowest does no harm.
    used, rate = plan.processing, 1.0 / recordings[0].period
    if "filter_cutoff" not in processing.left_open:
        return plan
    slowest = [used.get_standstill(joint) for joint in range(recordings[0].position.shape[1])]
    limits = balance_cutoff(recordings), limit_cutoff(recordings, slowest), _LEAST_CUTOFF * rate
    cutoff = max(limits)
    if (used.filter_cutoff or 0.0) <= cutoff:
        return plan
    factor = used.decimation.factor
    if "decimation.factor" in processing.left_open:
        factor = max(factor, math.floor(_PASSED * rate * _LEAST_FACTOR / cutoff + 1e-6))
    settled = replace(
        used, filter_cutoff=float(f"{cutoff:.3g}"), decimation=replace(used.decimation, factor=factor)
    )
    text = (
        f"with these friction laws, positions pass a low-pass at {settled.filter_cutoff:g} Hz instead, and "
        f"one row in {factor} is kept: noise of the velocity would bias what bends with it"
    )
    note = Notice(code="identify.automatic", text=text)
    return replace(plan, processing=settled, notices=(*plan.notices, note))


_LEAST_CUTOFF = 0.02
"""Of the sample rate."""
_RESTING = 0.005
"""Of the samples of a joint."""


def _find_rests(recordings: Sequence[Recording]) -> bool:
    """Return whether a joint that moves in the logs rests in a part of them."""
    run = np.repeat(np.arange(len(recordings)), [len(entry.time) for entry in recordings])
    time = np.concatenate([entry.time for entry in recordings])
    speeds = np.vstack([np.gradient(entry.position, entry.period, axis=0) for entry in recordings])
    return any(
        bool(column.any())
        and np.mean(estimators.find_phases(time, column, run) == estimators.PHASES.index("rest")) >= _RESTING
        for column in speeds.T
    )


def cut_moving_ends(processing: Processing, recordings: Sequence[Recording]) -> Processing:
    """Return the settings with ends cut off where a log moves there, by the lowest cut-off that is used.

    Instruments lose a twentieth of the shortest log at most; what is stated is never cut less.
    """
    cutoff = processing.instrument_cutoff or processing.filter_cutoff
    ends = measure_moving_ends(replace(processing, filter_cutoff=cutoff), recordings)
    if processing.instrument_cutoff:
        most = round(PART * min(len(entry.time) for entry in recordings))
        usual = measure_moving_ends(processing, recordings)
        ends = max(usual[0], min(ends[0], most)), max(usual[1], min(ends[1], most))
    first, last = ends
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
    """Refuse an estimator that no rows of a rigid robot know.

    Raises:
        UsageError: there is no such estimator; those of friction laws are others.
    """
    more = f" with {rows} rows; those of friction laws go with --rows friction"
    allowed = (*estimators.ESTIMATORS, FILTERED_INSTRUMENTAL, *SIMULATING)
    if estimator is not None and (notices := list_unknown("estimator", estimator, allowed, more)):
        raise UsageError(*notices)


def check_rigid_options(rows: str, estimator: str | None, options: RigidOptions) -> None:
    """Refuse options that rows or estimator do not use.

    Raises:
        UsageError: an option belongs to other rows or to another estimator, or is out of range.
    """
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
        text = f"--estimator {estimator} needs torque rows; leave --rows {rows} out"
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
) -> estimators.EstimatorOptions:
    """Return the options of an estimator; `prior` is of the same model, None for values of the robot file.

    Raises:
        UsageError: there is no prior, or the motion does not repeat.
    """
    if estimator == "ridge":
        known = (
            estimators.build_prior_of_card(library.card, (options.prior_percent or _DEVIATION) / 100.0)
            if prior is None
            else estimators.build_prior_of_estimate(prior, options.prior_factor or 1.0)
        )
        return estimators.EstimatorOptions(prior=known, prior_weight=options.prior_weight)
    if estimator == "consistent":
        return estimators.EstimatorOptions(bodies=estimators.build_bodies(robot))
    if estimator == "gls" and options.period:
        return estimators.EstimatorOptions(
            noise=estimators.estimate_period_noise(recordings, robot.processing, options.period)
        )
    return estimators.EstimatorOptions()
