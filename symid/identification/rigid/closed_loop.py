"""Output error and instrumental variables (IDIM-IV): the controlled robot is simulated beside each recording.

Robot whose file states the controller, its library, recordings with references -> `Estimate`.

    tau[k] = o + tau_ff[k] + Kp (q_ref[k] - q[k]) + Kd (dq_ref[k] - v[k])      within +- limit, held to k + 1
    v[k]   = v[k-1] + b ((q[k] - q[k-1]) / T - v[k-1]),   b = 1 - exp(-2 pi f T)     velocity from differences

v = dq[k] from a sensor, through the same low-pass; b = 1 without a filter. An unknown constant torque o is
the mean of the recording's torque less the other terms at the measured positions. A simulation starts at the
first measured position, with the velocity of the reference.

    simulate   the robot with x_k under its controller: states q_s, torque tau_s
    solve      equations made of what it did: x_(k+1), half of the step where that cannot be simulated
    until x changes by a part of its standard deviation that does no harm (`POLICY.relevance`)

    output error   W (x_(k+1) - x_k) = tau - tau_s,   W = [Y | Yf](q_s, dq_s, ddq_s),  decimated alike

(Gautier, Janot and Vandanjon 2013, IEEE Transactions on Control Systems Technology 21(2)). Where a controller
tracks well, simulated states hardly depend on x, so W is nearly the derivative of the simulated torque.

    instrumental   x_(k+1) = (Z' W Y)^-1 Z' W tau,   Z from q_s and Y from q, processed exactly alike

(Janot, Vandanjon and Gautier 2014, IEEE Transactions on Control Systems Technology 22(1)). Simulated states
are independent of the noise in Y: a wrong x_k makes deviations larger, not the result wrong.

Supported: what `symid.robot.Controller` states; torque limits of the joints; friction that the plant of
`simulation` has; several recordings, of unequal weight.
Not supported: elastic joints; parameters of the controller, and which gain is wrong; controllers that run at
another period than the log; noise that does more than add to Y.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import pairwise

import numpy as np

from symid import logs
from symid.arrays import FloatArray, FrozenArrays
from symid.codegen import Library, ModelCard, RigidExperiment
from symid.errors import IdentifiabilityError, Notice, SolverError, SymidError, UsageError
from symid.identification import diagnostics, estimators, regression
from symid.identification.judge import POLICY, numerics
from symid.identification.rigid.fit import build_estimate, identify_parameters
from symid.identification.rigid.plan import INSTRUMENTAL
from symid.logs import Recording, Signals
from symid.robot import Controller, Processing, Robot, list_controller, refuse_passive_joints
from symid.simulation import RigidPlant, simulate_rigid_plant


def set_card_values(card: ModelCard, values: FloatArray) -> ModelCard:
    """Return the card with `values` (p,), base parameters first, then friction, in SI units."""
    pairs = zip((*card.beta, *card.friction), values.tolist(), strict=True)
    valued, split = tuple(replace(entry, value=number) for entry, number in pairs), len(card.beta)
    return replace(card, beta=valued[:split], friction=valued[split:])


_FORGOTTEN = 10.0
"""Times Kd / Kp after which the initial state of a simulation has no effect."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClosedLoop(FrozenArrays):
    """The controller of one recording: its gains and structure, and what it follows.

    `reference` (N, n) rad or m, at the times of the recording, `velocity` (N, n) of it; `feedforward` (N, n)
    and `offset` o (n,) N m or N; `limit` (n,) of the torque, infinite where there is none.
    """

    controller: Controller
    reference: FloatArray
    velocity: FloatArray
    feedforward: FloatArray
    offset: FloatArray
    limit: FloatArray

    def compute_blend(self, period: float) -> float:
        """Return b of the velocity's low-pass at a period in s."""
        cutoff = self.controller.velocity_filter
        return 1.0 if cutoff is None else 1.0 - float(np.exp(-2.0 * np.pi * cutoff * period))


def build_closed_loop(recording: Recording, controller: Controller, limit: FloatArray) -> ClosedLoop:
    """Return the controller of a recording with torque limits (n,) in N m or N, or raise `list_unusable`.

    A reference velocity that is not logged is differentiated.
    """
    reference = recording.reference
    unusable = list_unusable(recording, controller)
    if unusable or reference is None:
        raise UsageError(*unusable)
    speeds = np.zeros_like(reference)
    if controller.velocity == "error":
        known = recording.reference_velocity
        speeds = logs.differentiate(reference, recording.period) if known is None else known
    loop = ClosedLoop(
        controller=controller,
        reference=reference,
        velocity=speeds,
        feedforward=np.zeros_like(reference) if recording.feedforward is None else recording.feedforward,
        offset=np.array(controller.offset or (0.0,) * reference.shape[1]),
        limit=limit,
    )
    if controller.offset is not None:
        return loop
    missing = recording.torque - compute_demand(loop, recording)
    settled = round(compute_settling(controller) / recording.period)
    return replace(loop, offset=missing[settled:].mean(axis=0))


def list_unusable(recording: Recording, controller: Controller | None = None) -> tuple[Notice, ...]:
    """Return why a controller, any if none is given, cannot be simulated along a recording."""
    texts = []
    if recording.reference is None:
        text = "this estimator simulates the controller, and the log has no reference position: log it as "
        texts.append(f"{text}q_ref, or name its columns in [log.reference]")
    for name in ("reference", "reference_velocity", "feedforward"):
        values: FloatArray | None = getattr(recording, name)
        if values is not None and not np.all(np.isfinite(values)):
            first = int(np.argwhere(~np.isfinite(values))[0, 0])
            where = f"the first at sample {first} (counted from 0): cut or repair the log there"
            texts.append(f"{name} has values that are not finite, {where}")
    reference, position = recording.reference, recording.position
    if not texts and reference is not None and reference.shape != position.shape:
        texts.append(f"the reference has shape {reference.shape}, the position {position.shape}")
    elif not texts and reference is not None:
        # Without such a reference fewer squares would be left.
        moved, away = np.std(position, axis=0), np.std(reference - position, axis=0)
        resting = regression.list_resting_joints(recording)
        strange = np.setdiff1d(np.flatnonzero(away**2 > POLICY.fall * moved**2), resting).tolist()
        if strange:
            listed = ", ".join(f"{j + 1} ({away[j]:.3g} against {moved[j]:.3g})" for j in strange)
            text = "the difference of reference and measured position varies more than the position itself "
            text += f"(standard deviations in rad or m) at joint {listed}: check unit, factor, sign and side "
            texts.append(f"{text}of [log.reference], and that it belongs to this run")
        length = len(recording.time) * recording.period
        settling = 0.0 if controller is None else compute_settling(controller)
        if controller is not None and settling + 2.0 * recording.period >= length:
            text = f"the log, {length:.3g} s long, is shorter than the settling time of the loop, "
            text += f"{settling:.3g} s ({_FORGOTTEN:g} times damping / stiffness): check the gains of "
            texts.append(f"{text}[controller], or record longer")
    return tuple(Notice(code="usage.controlled-robot", text=text, file=recording.source) for text in texts)


def compute_settling(controller: Controller) -> float:
    """Return the time in s after which the initial state of a simulation has no effect."""
    stiffness, damping = np.array(controller.stiffness), np.array(controller.damping)
    slow = np.divide(damping, stiffness, out=np.zeros_like(damping), where=stiffness > 0.0)
    return _FORGOTTEN * float(slow.max())


def compute_demand(loop: ClosedLoop, recording: Recording) -> FloatArray:
    """Return the torque (N, n) that the controller commands at the measured positions, as logged."""
    position, period, blend = recording.position, recording.period, loop.compute_blend(recording.period)
    if loop.controller.velocity_source == "sensor":
        raw = logs.differentiate(position, period)
    else:
        raw = np.diff(position, axis=0, prepend=2.0 * position[:1] - position[1:2]) / period
    speeds = raw.copy()
    for k in range(1, len(raw)):
        speeds[k] = speeds[k - 1] + blend * (raw[k] - speeds[k - 1])
    gains = loop.controller
    demand = loop.offset + loop.feedforward + np.array(gains.stiffness) * (loop.reference - position)
    demand = demand + np.array(gains.damping) * (loop.velocity - speeds)
    return _log_torque(np.clip(demand, -loop.limit, loop.limit), gains)


def simulate_closed_loop(
    library: Library, values: FloatArray, recording: Recording, loop: ClosedLoop
) -> Signals:
    """Return states and logged torque of the controlled model with values (p,) at the times of a recording.

    A UsageError tells of friction that cannot be simulated, a SolverError that the model runs away.
    """
    valued = Library(set_card_values(library.card, values), library.engine)
    period, gains, known = recording.period, loop.controller, recording.reference_velocity
    speed = logs.differentiate(loop.reference, period)[0] if known is None else known[0]
    speed = np.where(np.abs(speed) > numerics.RANK * np.abs(loop.reference).max() / period, speed, 0.0)
    order = RigidExperiment(
        position=loop.reference,
        speed=loop.velocity,
        torque=loop.offset + loop.feedforward,
        stiffness=np.array(gains.stiffness),
        damping=np.array(gains.damping),
        limit=loop.limit,
        step=np.zeros(library.card.size),
        # A run is lost where it is farther away than the reference goes, and a rad or m at least.
        reach=np.maximum(np.ptp(loop.reference, axis=0), 1.0),
        period=period,
        substeps=1,
        blend=loop.compute_blend(period),
        sensed=gains.velocity_source == "sensor",
        q=recording.position[0],
        dq=speed,
        measured=recording.position[0] - period * speed,
        velocity=speed,
    )
    log = simulate_rigid_plant(valued, RigidPlant(valued), order)
    if log.end == "away":
        seconds = recording.time[len(log.q) - 1] - recording.time[0]
        text = f"the simulated robot left its reference after {seconds:.3g} s: the gains are not those of "
        text += "the controller, or the initial parameters are far off"
        raise SolverError(Notice(code="solver.runaway", text=text, file=recording.source))
    return Signals(
        time=recording.time,
        q=log.q,
        dq=log.dq,
        ddq=logs.differentiate(log.dq, period),
        tau=_log_torque(log.torque, gains),
        period=period,
    )


def _log_torque(torque: FloatArray, gains: Controller) -> FloatArray:
    """Return held torques (N, n) as logged."""
    if gains.torque == "command":
        return torque
    average = torque.copy()
    average[1:] = 0.5 * (torque[1:] + torque[:-1])
    return average


_OF_VALUES = ("usage.negative-friction", "simulate.chatter", "simulate.not-converged")
"""Codes of what keeps a robot from being simulated that other parameters may mend."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClosedLoopProblem:
    """What stays the same from iteration to iteration.

    `loops` are the controllers of the recordings, `weights` of each one's squared residuals, one if None;
    `processing` of the rows has nothing left open; `progress` is called with a line about each iteration.
    """

    library: Library
    recordings: Sequence[Recording]
    loops: Sequence[ClosedLoop]
    processing: Processing
    weights: Sequence[float] | None = None
    rule: regression.RankRule | None = None
    progress: Callable[[str], None] = lambda _: None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClosedLoopFit:
    """The fit of the last iteration; its residuals are measured torques less those of the model.

    `rows` with the measured torques, `simulated` those along the simulated states; `instrumental` the
    solution by instruments, None of output error; `changes` largest change of a parameter in standard
    deviations, a simulation of all recordings each; `tracking` (n,) rad or m, root mean square between
    simulated and measured positions, low-passed and after the loops settled; `lag` (n,) the same between
    references and measured ones.
    """

    fit: estimators.RegressionFit
    identifiability: regression.Identifiability
    rows: regression.Rows
    simulated: regression.Rows
    instrumental: estimators.InstrumentalSolution | None = None
    changes: tuple[float, ...] = ()
    tracking: FloatArray = field(default_factory=lambda: np.empty(0))
    lag: FloatArray = field(default_factory=lambda: np.empty(0))


Solve = Callable[[FloatArray, Sequence[Signals]], ClosedLoopFit]


def _iterate(problem: ClosedLoopProblem, start: Mapping[str, float], solve: Solve) -> ClosedLoopFit:
    """Return the fit at which the iteration converges."""
    card = problem.library.card
    values = np.array([start[entry.name] for entry in (*card.beta, *card.friction)])
    try:
        runs = _simulate(problem, values)
    except (UsageError, SolverError) as error:
        # Whether other parameters may mend it.
        notices = [notice for notice in error.notices if notice.code in _OF_VALUES]
        if not notices:
            raise
        text = f"the initial parameters cannot be simulated: {notices[0].text}. Begin with others (--start), "
        text += "such as those of --estimator consistent"
        raise SolverError(Notice(code="solver.start", text=text)) from error
    changes: list[float] = []
    while True:
        found = solve(values, runs)
        fit, learnable = found.fit, found.identifiability.identifiable
        # What is not identifiable stays where it was.
        step = np.where(learnable, fit.values, values) - values
        deviation = np.sqrt(np.maximum(np.diag(fit.covariance), np.finfo(float).tiny))
        # A log without noise has no deviations.
        moved = learnable & (np.abs(step) > numerics.CONVERGED * np.abs(fit.values))
        changes.append(float(np.max(np.abs(step[moved]) / deviation[moved], initial=0.0)))
        told = f"parameters change by {changes[-1]:.2g} standard deviations"
        problem.progress(f"simulation {len(changes)}: {told}")
        # The choice among valid instruments changes the parameters too: steps become shorter each time that
        # changes are not halved.
        rising = sum(after > 0.5 * before for before, after in pairwise(changes))
        share = 1.0 if found.instrumental is None else 1.0 / (1.0 + rising)
        if share * changes[-1] < POLICY.relevance:
            break
        if len(changes) == numerics.ROUNDS:
            text = f"not converged: after {len(changes)} simulations parameters still change by "
            text += f"{changes[-1]:.2g} standard deviations. Check the controller, or record more excitation"
            raise SolverError(Notice(code="solver.controlled-robot", text=text))
        # Half of the step, and again, where it leads to no robot.
        while True:
            try:
                runs = _simulate(problem, values + share * step)
                break
            except SymidError as error:
                share *= 0.5
                if share * changes[-1] >= POLICY.relevance:
                    continue
                text = "the parameters that explain the torque cannot be simulated: "
                text += f"{error.notices[0].text}. Check gains, torque limits and reference, record more "
                text += "excitation, or add the missing term to the model"
                raise SolverError(Notice(code="solver.controlled-robot", text=text)) from error
        values = values + share * step
    apart: list[FloatArray] = []
    for (recording, loop, kept), run in zip(_list_cases(problem), runs, strict=True):
        measured = recording.position[kept]
        pair = np.hstack([run.q[kept] - measured, loop.reference[kept] - measured])
        apart.append(logs.decimate(pair, problem.processing.decimation))
    tracking, lag = np.split(np.sqrt(np.mean(np.vstack(apart) ** 2, axis=0)), 2)
    return replace(found, changes=tuple(changes), tracking=tracking, lag=lag)


def _list_cases(problem: ClosedLoopProblem) -> list[tuple[Recording, ClosedLoop, slice]]:
    """Return recordings, loops, and the samples on which the initial state of a simulation has no effect."""
    found = []
    for recording, loop in zip(problem.recordings, problem.loops, strict=True):
        settled = math.ceil(compute_settling(loop.controller) / recording.period)
        first = max(problem.processing.drop_first, settled)
        found.append((recording, loop, slice(first, len(recording.time) - problem.processing.drop_last)))
    return found


def _simulate(problem: ClosedLoopProblem, values: FloatArray) -> list[Signals]:
    pairs = zip(problem.recordings, problem.loops, strict=True)
    return [simulate_closed_loop(problem.library, values, recording, loop) for recording, loop in pairs]


def fit_output_error(problem: ClosedLoopProblem, start: Mapping[str, float]) -> ClosedLoopFit:
    """Return the parameters whose simulated torque is nearest to the measured one; positions pass no filter.

    `start` has all initial parameters, by name.
    """
    processing = replace(problem.processing, filter_cutoff=None, filter_torque=False)
    library, problem = problem.library, replace(problem, processing=processing)

    def solve(values: FloatArray, runs: Sequence[Signals]) -> ClosedLoopFit:
        pairs: list[tuple[regression.Rows, regression.Rows]] = []
        for (recording, _, kept), run in zip(_list_cases(problem), runs, strict=True):
            columns = {name: getattr(run, name)[kept] for name in ("time", "q", "dq", "ddq")}
            bad = None if recording.bad is None else recording.bad[kept]
            signals = Signals(**columns, tau=recording.torque[kept], period=run.period, bad=bad)
            built = regression.build_rows("torque", library, signals, processing)
            beyond = regression.evaluate_torques(library, signals, values) - run.tau[kept]
            excess = logs.decimate(beyond, processing.decimation)
            wrong = np.zeros(beyond.shape, bool) if bad is None else bad
            good = ~logs.mask_decimated(wrong, processing.decimation)
            # A brake may hold a joint at rest: its torque contains no information.
            joints = library.card.joints
            held = [j for j in regression.list_resting_joints(recording) if joints[j].friction != "none"]
            away, free = replace(built, values=built.values + excess.T[good.T]), ~np.isin(built.group, held)
            pairs.append((regression.select_rows(built, free), regression.select_rows(away, free)))
        # With the measured torques, and with tau - tau_s + W x in their place.
        rows, shifted = (regression.stack_rows(parts, problem.weights) for parts in zip(*pairs, strict=True))
        try:
            identifiability = regression.analyse_identifiability(shifted, problem.rule)
        except IdentifiabilityError as error:
            text = "the simulated robot does not move enough: the reference of the log hardly moves, or the "
            text += "simulated robot does not follow it. Check q_ref, its unit and [controller]"
            blind = Notice(code="identify.blind-simulation", text=text)
            raise IdentifiabilityError(blind, *error.notices) from error
        fit = estimators.fit_wls(shifted, identifiability, processing.noise_freedom)
        return ClosedLoopFit(fit=fit, identifiability=identifiability, rows=rows, simulated=rows)

    return _iterate(problem, start, solve)


def fit_instrumental(problem: ClosedLoopProblem, start: Mapping[str, float]) -> ClosedLoopFit:
    """Return the parameters that explain the torque at the measured states, by instruments.

    The processing is of measured and simulated positions alike; arguments as for `fit_output_error`.
    """
    freedom = problem.processing.noise_freedom
    # Once the problem has been checked; no iteration changes them.
    build = cache(lambda: _build_measured(problem))

    def solve(_: FloatArray, runs: Sequence[Signals]) -> ClosedLoopFit:
        measured = build()
        rows = regression.stack_rows(measured, problem.weights)
        simulated = _build_beside(problem, [run.q for run in runs], measured)
        found = estimators.fit_instruments(rows, simulated, problem.rule, freedom)
        return ClosedLoopFit(
            fit=found.fit,
            identifiability=found.identifiability,
            rows=rows,
            simulated=simulated,
            instrumental=found,
        )

    return _iterate(problem, start, solve)


def estimate_start(problem: ClosedLoopProblem) -> dict[str, float] | None:
    """Return parameters by instruments along the references, None where these determine too little.

    Nothing is simulated.
    """
    problem, freedom = replace(problem, weights=None), problem.processing.noise_freedom
    measured = _build_measured(problem)
    beside = _build_beside(problem, [loop.reference for loop in problem.loops], measured)
    rows = regression.stack_rows(measured)
    try:
        found = estimators.fit_instruments(rows, beside, freedom=freedom)
    except IdentifiabilityError:
        # References may are at rest, or move together, where the logs do not.
        return None
    values, learnable = found.fit.values.tolist(), found.identifiability.identifiable
    return {name: values[k] for k, name in enumerate(measured[0].names) if learnable[k]}


def _build_measured(problem: ClosedLoopProblem) -> list[regression.Rows]:
    cases = [
        (log, replace(problem.processing, drop_first=kept.start)) for log, _, kept in _list_cases(problem)
    ]
    return [regression.prepare_rows("torque", problem.library, *case) for case in cases]


def _build_beside(
    problem: ClosedLoopProblem, positions: Sequence[FloatArray], measured: Sequence[regression.Rows]
) -> regression.Rows:
    """Return the rows along other positions (N, n) of each recording, beside the measured ones."""
    parts = []
    for (recording, _, span), position, rows in zip(_list_cases(problem), positions, measured, strict=True):
        processing = replace(problem.processing, drop_first=span.start)
        signals = logs.prepare_signals(replace(recording, position=position), processing)
        signals = regression.hold_resting_joints(signals, regression.list_resting_joints(recording))
        whole = regression.build_rows("torque", problem.library, signals, processing)
        kept = np.zeros(len(whole.values), dtype=bool)
        for group in range(len(whole.group_names)):
            members = whole.group == group
            kept[members] = np.isin(whole.time[members], rows.time[rows.group == group])
        parts.append(regression.select_rows(whole, kept))
    return regression.stack_rows(parts, problem.weights)


def identify_closed_loop(
    estimator: str,
    robot: Robot,
    library: Library,
    recordings: Sequence[Recording],
    *,
    start: estimators.Estimate | None = None,
    start_name: str = "",
    rule: regression.RankRule | None = None,
    weights: Sequence[float] | None = None,
    echo: Mapping[str, object] | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> estimators.Estimate:
    """Return the parameters that an estimator, one of `SIMULATING`, finds with the simulated robot.

    `start` is an estimate of the same model to begin with, None for a fit to the same recordings, and
    `start_name` its name in the result; the others are as for `identify_parameters`.
    """
    controller = check_closed_loop(robot, recordings)
    limits = np.array([np.inf if axis.limits.torque is None else axis.limits.torque for axis in robot.axes])
    filters = regression.choose_filters(robot.processing, recordings)
    first = identify_parameters(
        library, recordings, filters.processing, estimator="wls", rule=rule, weights=weights, echo=echo
    )
    problem = ClosedLoopProblem(
        library=library,
        recordings=recordings,
        loops=[build_closed_loop(recording, controller, limits) for recording in recordings],
        processing=filters.processing,
        weights=weights,
        rule=rule,
        progress=progress,
    )
    given, cards = start or first, (*library.card.beta, *library.card.friction)
    # What an estimate refuses is taken from the robot file, or is zero.
    begun = {card.name: card.value or 0.0 for card in cards} | dict(given.unresolved)
    begun |= {entry.name: entry.value for entry in given.parameters}
    begun_with, instrumental = start_name or "torque equations by wls", estimator == INSTRUMENTAL
    if instrumental and start is None and (own := estimate_start(problem)) is not None:
        begun, begun_with = {**begun, **own}, "instruments along the references"
    found = (fit_instrumental if instrumental else fit_output_error)(problem, begun)
    verdict, warnings = _assess_instruments(found, problem)
    # Percent of the logged torque that the controller does not explain.
    thin, pairs = problem.processing.decimation, list(zip(problem.loops, recordings, strict=True))
    missing = np.vstack([logs.decimate(log.torque - compute_demand(loop, log), thin) for loop, log in pairs])
    size = np.linalg.norm(np.vstack([logs.decimate(log.torque, thin) for log in recordings]), axis=0)
    share = 100.0 * np.linalg.norm(missing, axis=0) / np.where(size > 0.0, size, 1.0)
    joints = zip(library.card.joints, found.tracking.tolist(), found.lag.tolist(), strict=True)
    keys = ("joint", "unit", "simulated_from_measured", "reference_from_measured")
    stated = list_controller(controller)
    logged = all(recording.reference_velocity is not None for recording in problem.recordings)
    velocity = "logged" if logged else "differentiated"
    report = {
        "start": begun_with,
        "iterations": len(found.changes),
        "changes": list(found.changes),
        "tracking": [
            dict(zip(keys, (joint.name, joint.position_unit, *sizes), strict=True))
            for joint, *sizes in joints
        ],
        **verdict,
        "controller": {
            **stated,
            **{key: list(map(float, stated[key])) for key in ("stiffness", "damping")},
            "velocity_filter": controller.velocity_filter,
            "offset": [loop.offset.tolist() for loop in problem.loops],
            "offset_from": "log" if controller.offset is None else "robot file",
            "reference_velocity": "none" if controller.velocity == "measured" else velocity,
            "torque_limit": [limit if np.isfinite(limit) else None for limit in limits.tolist()],
        },
        "controller_residual_percent": share.tolist(),
    }
    # Where simulated and measured robot do not follow the reference alike.
    apart = np.flatnonzero(100.0 * found.tracking > POLICY.good * found.lag).tolist()
    if apart:
        listed = ", ".join(
            f"{found.rows.group_names[index]!r} {found.tracking[index]:.2g} "
            f"{found.rows.velocity_units[index].removesuffix('/s')} ({found.lag[index]:.2g})"
            for index in apart
        )
        effect = "the standard deviations are larger" if instrumental else "the parameters are biased"
        missed = ", ".join(f"{share[index]:.3g} %" for index in apart)
        told = diagnostics.build_warning(
            "identify.tracking", joints=listed, limit=POLICY.good, effect=effect, missed=missed
        )
        warnings = (told, *warnings)
    left = robot.processing.left_open
    estimate = build_estimate(
        library.card,
        found.rows,
        found.identifiability,
        found.fit,
        estimator=estimator,
        recordings=recordings,
        settings={**first.settings, **({"chosen": list(left)} if left else {}), "fit": report},
    )
    notices = (
        *(filters.notices if instrumental else ()),
        *(notice for notice in first.notices if notice.code == regression.JOINT_AT_REST),
        *found.rows.notices,
        *found.identifiability.notices,
        *found.fit.notices,
        *diagnostics.warn_of_correlated_residuals(found.simulated, found.fit, found.identifiability),
        *warnings,
        *diagnostics.warn_of_poorly_identifiable(estimate.parameters),
    )
    return replace(estimate, notices=tuple(dict.fromkeys(notices)))


def check_closed_loop(robot: Robot, recordings: Sequence[Recording]) -> Controller:
    """Return the controller of a robot; a UsageError says why it cannot be simulated along recordings."""
    problems = [notice for recording in recordings for notice in list_unusable(recording, robot.controller)]
    texts = []
    if any(robot.elastic):
        names = ", ".join(joint.name for joint, gives in zip(robot.axes, robot.elastic, strict=True) if gives)
        text = f"this estimator simulates rigid robots, and {robot.name!r} has elastic joints ({names})"
        texts.append(f"{text}: use another estimator")
    refuse_passive_joints(robot, "this estimator simulates a controller of all joints: use another estimator")
    if robot.controller is None:
        text = f"this estimator simulates the controller, and the file of {robot.name!r} states none: add "
        text += "[controller] with stiffness = [...] (N m/rad) and damping = [...] (N m s/rad), on the joint "
        texts.append(f"{text}side, or --set controller.stiffness=... --set controller.damping=...")
    problems += [Notice(code="usage.controlled-robot", text=text, file=robot.path) for text in texts]
    if problems or robot.controller is None:
        raise UsageError(*problems)
    return robot.controller


def _assess_instruments(
    found: ClosedLoopFit, problem: ClosedLoopProblem
) -> tuple[Mapping[str, object], tuple[Notice, ...]]:
    """Return the quality of instruments and the test of least squares, with warnings; nothing without any."""
    solution, processing = found.instrumental, problem.processing
    if solution is None:
        return {}, ()
    test = estimators.assess_exogeneity(found.rows, solution, processing.noise_freedom)
    rounding = np.finfo(float).eps
    chance = f"= {test.probability:.2g}" if test.probability > rounding else f"< {rounding:.2g}"
    verdict = "not biased by noise in the states"
    if test.biased:
        names = ", ".join(f"{name} {shift:+.2g}" for name, shift in test.biased)
        verdict = f"biased by noise in the states, in its standard deviations: {names}"
    elif test.significant:
        verdict = f"significantly different, by at most {POLICY.printed:g} standard deviations"
    verdict = f"wls of these rows is {verdict} (p {chance})"
    report = {
        "instruments": {
            "correlation": solution.correlation,
            "strength": solution.strength if solution.strength < float("inf") else None,
        },
        "wls": {
            "biased": bool(test.biased),
            "statistic": test.statistic,
            "freedom": list(test.freedom),
            "probability": test.probability,
            "shifts": dict(test.shifts),
            "verdict": verdict,
        },
    }
    # Instruments allow raw differences, but not a filter that damps the motion.
    warnings = diagnostics.warn_of_processing(processing, problem.recordings)
    damping = [notice for notice in warnings if notice.code == "identify.low-cutoff"]
    biased = [diagnostics.build_warning("identify.biased-wls", verdict=verdict)] if test.biased else []
    return report, (*biased, *damping)
