"""Fits with the simulated robot beside each recording: output error and instrumental variables (IDIM-IV).

`ClosedLoopProblem`, parameters to begin with -> `ClosedLoopFit`.

    simulate   the robot with x_k under its controller: states q_s, torque tau_s
    solve      equations made of what it did: x_(k+1)
    until x changes by less than a part of its standard deviation

Where the robot with x_(k+1) cannot be simulated, half of the step is taken, and half of that.

    output error   W (x_(k+1) - x_k) = tau - tau_s,   W = [Y | Yf](q_s, dq_s, ddq_s),  decimated alike

The direct and inverse dynamic identification of Gautier, Janot and Vandanjon (2013, IEEE Transactions on
Control Systems Technology 21(2)): where a controller tracks well, the simulated states hardly depend on x,
so W is nearly the derivative of the simulated torque. No measured position enters but the first.

    instrumental   x_(k+1) = (Z' W Y)^-1 Z' W tau,   Z from q_s and Y from q, processed exactly alike

The generic instrumental variable approach of Janot, Vandanjon and Gautier (2014, IEEE Transactions on
Control Systems Technology 22(1)). The simulated states are independent of the noise in Y: a wrong x_k or
wrong gains make deviations larger, not the result wrong, as long as Z resembles Y. Simulated dry friction may
change sign a sample earlier, and x by a part of its deviation: steps become shorter where changes do not
fall, and the iteration may end in an oscillation below half a deviation.

Supported: rigid robots, friction that the plant of `simulation` has; several recordings, of unequal weight.
Not supported: elastic joints; parameters of the controller. With instruments, noise that does more than add
to Y stays: in the sign of a slow velocity, in squares.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.errors import IdentifiabilityError, Notice, SolverError, SymidError, UsageError
from symid.identification.estimators import InstrumentalSolution, RegressionFit, fit_instruments, fit_rows
from symid.identification.regression import (
    WINDOW,
    Identifiability,
    RankRule,
    Rows,
    analyse_identifiability,
    build_rows,
    drop_groups,
    evaluate_torques,
    hold_resting_joints,
    list_resting_joints,
    prepare_rows,
    select_rows,
    stack_rows,
)
from symid.identification.rigid.closed_loop import ClosedLoop, simulate_closed_loop
from symid.logs import Recording, Signals, choose_processing, decimate, prepare_signals
from symid.robot import Processing

_LIMIT = 15
_CONVERGED = 0.05
"""Change of every parameter, in standard deviations, below which the iteration ends."""
_EXACT = 1e-6
"""Change relative to the parameter that ends it too: a log without noise has no deviations."""
_HALVINGS = 6
_OF_VALUES = ("usage.negative-friction", "simulate.chatter", "simulate.unsettled")
"""Codes of what keeps a robot from being simulated that other parameters may mend."""
_CHANCE = 0.5
"""Change in standard deviations that is no more than another choice among valid instruments."""
_ROUNDS = 3
_FALLING = 0.5
_STRONG = 10.0
"""F of the first stage that makes references good enough to begin with."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClosedLoopProblem:
    """What stays the same from iteration to iteration.

    Args:
        library: the robot's functions.
        recordings: at least one; loops: the controller of each.
        processing: of the rows.
        weights: of each recording's squared residuals; one if None.
    """

    library: Library
    recordings: Sequence[Recording]
    loops: Sequence[ClosedLoop]
    processing: Processing
    weights: Sequence[float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClosedLoopFit:
    """The fit of the last iteration.

    Args:
        fit: its residuals are measured torques less those of the model.
        rows: the equations with the measured torques; simulated: those along the simulated states.
        instrumental: the solution by instruments, None of output error.
        changes: largest change of a parameter in standard deviations, iteration by iteration.
        tracking: (n,) rad or m, root mean square between simulated and measured positions, low-passed and
            after the loops settled; lag: (n,) the same between references and measured positions.
    """

    fit: RegressionFit
    identifiability: Identifiability
    rows: Rows
    simulated: Rows
    instrumental: InstrumentalSolution | None = None
    changes: tuple[float, ...] = ()
    tracking: FloatArray = field(default_factory=lambda: np.empty(0))
    lag: FloatArray = field(default_factory=lambda: np.empty(0))

    @property
    def iterations(self) -> int:
        """Return the number of simulations of all recordings."""
        return len(self.changes)


def _iterate(
    problem: ClosedLoopProblem,
    start: Mapping[str, float],
    solve: Callable[[FloatArray, Sequence[Signals]], ClosedLoopFit],
    progress: Callable[[str], None],
    *,
    instrumental: bool = False,
) -> ClosedLoopFit:
    """Return the fit at which the iteration converges.

    With instruments the choice among valid ones changes the parameters too: steps become shorter each time
    that changes do not fall, and changes that stay small end the iteration.
    """
    cards = (*problem.library.card.beta, *problem.library.card.friction)
    values = np.array([start[card.name] for card in cards])
    runs = _simulate_start(problem, values)
    changes: list[float] = []
    while True:
        found = solve(values, runs)
        fit, learnable = found.fit, found.identifiability.identifiable
        # What is not identifiable stays where it was.
        step = np.where(learnable, fit.values, values) - values
        deviation = np.sqrt(np.maximum(np.diag(fit.covariance), np.finfo(float).tiny))
        moved = learnable & (np.abs(step) > _EXACT * np.abs(fit.values))
        changes.append(float(np.max(np.abs(step[moved]) / deviation[moved], initial=0.0)))
        progress(f"simulation {len(changes)}: parameters change by {changes[-1]:.2g} standard deviations")
        last = changes[-_ROUNDS:]
        steady = len(last) == _ROUNDS and max(last) < _CHANCE and last[-1] > _FALLING * last[-2]
        if changes[-1] < _CONVERGED or (instrumental and steady):
            break
        if len(changes) == _LIMIT:
            text = (
                f"not converged: after {len(changes)} simulations parameters still change by "
                f"{changes[-1]:.2g} standard deviations. Check the controller, or record more excitation"
            )
            raise SolverError(Notice(code="solver.controlled-robot", text=text))
        rising = sum(after > _FALLING * before for before, after in pairwise(changes))
        values, runs = _advance(problem, values, (1.0 / (1.0 + rising) if instrumental else 1.0) * step)
    tracking, lag = _measure_tracking(problem, runs)
    return replace(found, changes=tuple(changes), tracking=tracking, lag=lag)


def _select_compared(problem: ClosedLoopProblem, recording: Recording, loop: ClosedLoop) -> slice:
    """Return the samples that are compared, after the initial state of the simulation has no effect."""
    first = max(problem.processing.drop_first, math.ceil(loop.settling / recording.period))
    return slice(first, len(recording.time) - problem.processing.drop_last)


def _simulate(problem: ClosedLoopProblem, values: FloatArray) -> list[Signals]:
    pairs = zip(problem.recordings, problem.loops, strict=True)
    return [simulate_closed_loop(problem.library, values, recording, loop) for recording, loop in pairs]


def _simulate_start(problem: ClosedLoopProblem, values: FloatArray) -> list[Signals]:
    """Return the first runs; an error says whether other parameters may mend it."""
    try:
        return _simulate(problem, values)
    except (UsageError, SolverError) as error:
        notices = [notice for notice in error.notices if notice.code in _OF_VALUES]
        if not notices:
            raise
        text = (
            f"the initial parameters cannot be simulated: {notices[0].text}. Begin with others (--start), "
            "such as those of --estimator consistent"
        )
        raise SolverError(Notice(code="solver.start", text=text)) from error


def _advance(
    problem: ClosedLoopProblem, values: FloatArray, step: FloatArray
) -> tuple[FloatArray, list[Signals]]:
    """Return the next parameters (p,) and their runs: half the step, and again, where it is no robot."""
    for halving in range(_HALVINGS + 1):
        moved = values + 0.5**halving * step
        try:
            return moved, _simulate(problem, moved)
        except SymidError as error:
            refused = error
    text = (
        f"the parameters that explain the torque cannot be simulated: {refused.notices[0].text}. Check "
        "gains, torque limits and reference, record more excitation, or add the missing term to the model"
    )
    raise SolverError(Notice(code="solver.controlled-robot", text=text)) from refused


def _measure_tracking(problem: ClosedLoopProblem, runs: Sequence[Signals]) -> tuple[FloatArray, FloatArray]:
    """Return root mean squares (n,) of simulated and of reference less measured positions, low-passed."""
    gaps: list[FloatArray] = []
    lags: list[FloatArray] = []
    decimation = problem.processing.decimation
    for recording, loop, run in zip(problem.recordings, problem.loops, runs, strict=True):
        kept = _select_compared(problem, recording, loop)
        measured = recording.position[kept]
        gaps.append(decimate(run.q[kept] - measured, decimation))
        lags.append(decimate(loop.reference[kept] - measured, decimation))
    tracking, lag = (np.sqrt(np.mean(np.vstack(parts) ** 2, axis=0)) for parts in (gaps, lags))
    return tracking, lag


def fit_output_error(
    problem: ClosedLoopProblem,
    start: Mapping[str, float],
    *,
    rule: RankRule | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> ClosedLoopFit:
    """Return the parameters whose simulated torque is nearest to the measured one; positions pass no filter.

    `start` has all initial parameters, by name; `progress` is called with a line about each iteration.

    Raises:
        UsageError: the friction cannot be simulated.
        SolverError: the simulated robot ran away, or the iteration did not converge.
        IdentifiabilityError: no parameter is identifiable.
    """
    processing = choose_processing(problem.processing, problem.recordings[0].period)
    problem = replace(problem, processing=replace(processing, filter_cutoff=None, filter_torque=False))

    def solve(values: FloatArray, runs: Sequence[Signals]) -> ClosedLoopFit:
        rows, shifted = _build_simulated(problem, values, runs)
        try:
            identifiability = analyse_identifiability(shifted, rule)
        except IdentifiabilityError as error:
            text = (
                "the simulated robot does not move enough: the reference of the log hardly moves, or the "
                "simulated robot does not follow it. Check q_ref, its unit and [controller]"
            )
            blind = Notice(code="identify.blind-simulation", text=text)
            raise IdentifiabilityError(blind, *error.notices) from error
        fit = fit_rows("wls", shifted, identifiability, problem.processing.noise_freedom)
        return ClosedLoopFit(fit=fit, identifiability=identifiability, rows=rows, simulated=rows)

    return _iterate(problem, start, solve, progress)


def _build_simulated(
    problem: ClosedLoopProblem, values: FloatArray, runs: Sequence[Signals]
) -> tuple[Rows, Rows]:
    """Return the equations with the measured torques, and with tau - tau_s + W x in their place."""
    plain, shifted = [], []
    library, processing = problem.library, problem.processing
    for recording, loop, run in zip(problem.recordings, problem.loops, runs, strict=True):
        kept = _select_compared(problem, recording, loop)
        columns = {name: getattr(run, name)[kept] for name in ("time", "q", "dq", "ddq")}
        signals = Signals(**columns, tau=recording.torque[kept], period=run.period)
        rows = build_rows("torque", library, signals, processing)
        excess = decimate(evaluate_torques(library, signals, values) - run.tau[kept], processing.decimation)
        moved = replace(rows, values=rows.values + excess.T.ravel())
        # A brake may hold a joint at rest: its torque contains no information.
        joints = library.card.joints
        held = tuple(j for j in list_resting_joints(recording) if joints[j].friction != "none")
        plain.append(drop_groups(rows, held))
        shifted.append(drop_groups(moved, held))
    return stack_rows(plain, problem.weights), stack_rows(shifted, problem.weights)


def fit_instrumental(
    problem: ClosedLoopProblem,
    start: Mapping[str, float],
    *,
    rule: RankRule | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> ClosedLoopFit:
    """Return the parameters that explain the torque at the measured states, by instruments.

    The processing is of measured and simulated positions alike; arguments and errors as for
    `fit_output_error`.

    Raises:
        LogError: too few samples for the processing.
    """
    processing = choose_processing(problem.processing, problem.recordings[0].period)
    problem = replace(problem, processing=processing)
    measured: list[Rows] = []

    def solve(_: FloatArray, runs: Sequence[Signals]) -> ClosedLoopFit:
        # Once the problem has been checked; no iteration changes them.
        if not measured:
            measured.extend(_build_measured(problem))
        rows = stack_rows(measured, problem.weights)
        simulated = _build_beside(problem, [run.q for run in runs], measured)
        found = fit_instruments(rows, simulated, rule, processing.noise_freedom)
        return ClosedLoopFit(
            fit=found.fit,
            identifiability=found.identifiability,
            rows=rows,
            simulated=simulated,
            instrumental=found,
        )

    return _iterate(problem, start, solve, progress, instrumental=True)


def estimate_start(problem: ClosedLoopProblem) -> dict[str, float] | None:
    """Return parameters by instruments along the references, None where these are too weak.

    Nothing is simulated; noise in the states biases the result as little as that of `fit_instrumental`.
    """
    processing = choose_processing(problem.processing, problem.recordings[0].period)
    problem = replace(problem, processing=processing, weights=None)
    measured = _build_measured(problem)
    beside = _build_beside(problem, [loop.reference for loop in problem.loops], measured)
    try:
        found = fit_instruments(stack_rows(measured), beside, freedom=processing.noise_freedom)
    except IdentifiabilityError:
        # References may stand still, or move together, where the logs do not.
        return None
    if found.strength < _STRONG:
        return None
    values, learnable = found.fit.values.tolist(), found.identifiability.identifiable
    return {name: values[k] for k, name in enumerate(measured[0].names) if learnable[k]}


def _cut_start(problem: ClosedLoopProblem, recording: Recording, loop: ClosedLoop) -> Processing:
    return replace(problem.processing, drop_first=_select_compared(problem, recording, loop).start)


def _build_measured(problem: ClosedLoopProblem) -> list[Rows]:
    """Return the rows of each recording, after the initial state of the simulation has no effect."""
    cut = [_cut_start(problem, *pair) for pair in zip(problem.recordings, problem.loops, strict=True)]
    pairs = zip(problem.recordings, cut, strict=True)
    return [prepare_rows("torque", problem.library, log, rule, window=WINDOW) for log, rule in pairs]


def _build_beside(
    problem: ClosedLoopProblem, positions: Sequence[FloatArray], measured: Sequence[Rows]
) -> Rows:
    """Return the rows along other positions (N, n) of each recording, beside the measured ones."""
    parts = []
    for recording, loop, position, rows in zip(
        problem.recordings, problem.loops, positions, measured, strict=True
    ):
        processing = _cut_start(problem, recording, loop)
        signals = prepare_signals(replace(recording, position=position), processing)
        signals = hold_resting_joints(signals, list_resting_joints(recording))
        whole = build_rows("torque", problem.library, signals, processing)
        kept = np.zeros(len(whole.values), dtype=bool)
        for group in range(len(whole.group_names)):
            members = whole.group == group
            kept[members] = np.isin(whole.time[members], rows.time[rows.group == group])
        parts.append(select_rows(whole, kept))
    return stack_rows(parts, problem.weights)
