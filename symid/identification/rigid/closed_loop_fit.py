"""Fits with the simulated robot beside each recording: output error and instrumental variables (IDIM-IV).

Library, recordings, the controllers of each, parameters to begin with -> `ClosedLoopFit`.

    simulate   the robot with x_k under its controller: states q_s, torque tau_s
    solve      equations made of what it did: x_(k+1)
    until x changes by less than a part of its standard deviation

Where the robot with x_(k+1) cannot be simulated, half of the step is taken, and half of that.

    output error   W (x_(k+1) - x_k) = tau - tau_s,   W = [Y | Yf](q_s, dq_s, ddq_s),  decimated alike

The direct and inverse dynamic identification of Gautier, Janot and Vandanjon (2013, IEEE Transactions on
Control Systems Technology 21(2)): where a controller tracks well, the simulated states hardly depend on x,
so W is nearly the derivative of the simulated torque, and a few iterations are enough. They compare tau
with W x_(k+1); tau_s in place of W x_k is the same up to what a torque held over a period and a joint that
sticks have of their own, which then stands on both sides. No measured position enters but the first: noise
of encoders, filters and differences do no harm.

    instrumental   x_(k+1) = (Z' W Y)^-1 Z' W tau,   Z from q_s and Y from q, processed exactly alike

The generic instrumental variable approach of Janot, Vandanjon and Gautier (2014, IEEE Transactions on
Control Systems Technology 22(1)). The simulated states know the reference, and nothing of the noise that
encoders and differences put into Y: a wrong x_k or wrong gains make deviations larger, not the result
wrong, as long as Z resembles Y. Where simulated dry friction changes sign a sample earlier, other noise
counts, and x moves by a part of its deviation. So steps become shorter where changes do not fall, and the
iteration may end in going to and fro by less than half a deviation.

Supported: rigid robots, friction that the plant of `simulation` holds; one recording or several, of unequal
weight.
Not supported: elastic joints; parameters of the controller (`closed_loop` says which there are). Of
instruments, noise that does more than add to Y stays: in the sign of a slow velocity, in squares.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.errors import IdentifiabilityError, Notice, SolverError, SymidError, UsageError
from symid.identification.estimators import (
    EstimatorOptions,
    InstrumentalSolution,
    RegressionFit,
    fit_instruments,
    fit_rows,
)
from symid.identification.regression import (
    WINDOW,
    Identifiability,
    RankRule,
    Rows,
    analyse_identifiability,
    build_rows,
    drop_groups,
    hold_resting_joints,
    list_resting_joints,
    prepare_rows,
    select_rows,
    stack_rows,
)
from symid.identification.rigid.closed_loop import ClosedLoop, ClosedLoopRun, simulate_closed_loop
from symid.logs import Recording, Signals, choose_processing, decimate, prepare_signals
from symid.robot import Processing

_LIMIT = 15
_SETTLED = 0.05
"""Change of every parameter, in standard deviations, below which the iteration ends."""
_EXACT = 1e-6
"""Change relative to the parameter that ends it too: a log without noise has no deviations."""
_HALVINGS = 6
_OF_VALUES = ("usage.negative-friction", "simulate.chatter")
"""Codes of what keeps a robot from being simulated that other parameters may mend."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClosedLoopProblem:
    """What stays the same from iteration to iteration.

    Args:
        library: the robot's functions.
        recordings: at least one; loops: the controller of each.
        processing: of the rows, nothing left open.
        weights: what the squares of each recording's residuals count for; one if None.
    """

    library: Library
    recordings: Sequence[Recording]
    loops: Sequence[ClosedLoop]
    processing: Processing
    weights: Sequence[float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClosedLoopStep:
    """What one iteration finds: fit, what the runs tell, and the equations with the measured torques.

    `simulated` are the rows along the simulated states; `instrumental` is what instruments found.
    """

    fit: RegressionFit
    seen: Identifiability
    rows: Rows
    simulated: Rows
    instrumental: InstrumentalSolution | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClosedLoopFit:
    """The result.

    Args:
        solution: of the last iteration; the residuals are measured torques less those of the model.
        changes: largest change of a parameter in standard deviations, iteration by iteration.
        tracking: (n,) rad or m, root mean square between simulated and measured positions, low-passed and
            after the loops settled; lag: (n,) the same between references and measured positions.
    """

    solution: ClosedLoopStep
    changes: tuple[float, ...]
    tracking: FloatArray
    lag: FloatArray

    @property
    def fit(self) -> RegressionFit:
        """Return the last fit."""
        return self.solution.fit

    @property
    def seen(self) -> Identifiability:
        """Return what the last equations tell."""
        return self.solution.seen

    @property
    def rows(self) -> Rows:
        """Return the last equations, with the measured torques."""
        return self.solution.rows

    @property
    def iterations(self) -> int:
        """Return how many simulations of all recordings it took."""
        return len(self.changes)


StepSolver = Callable[[FloatArray, Sequence[ClosedLoopRun]], ClosedLoopStep]
"""From parameters (p,) and the runs of the robot that has them to the next ones."""


def iterate_closed_loop(
    scene: ClosedLoopProblem,
    start: Mapping[str, float],
    solve: StepSolver,
    *,
    tell: Callable[[str], None] = lambda _: None,
    instrumental: bool = False,
) -> ClosedLoopFit:
    """Return where the iteration settles.

    Args:
        scene: robot, recordings, controllers.
        start: parameters to begin with, all of them, such as those of an estimate.
        solve: one iteration.
        tell: called with a line about each iteration.
        instrumental: whether the choice among valid instruments changes the parameters too. Then less of a
            step is made each time that changes do not fall, and changes that stay small end the iteration.

    Raises:
        UsageError: a start value is missing, loops and recordings do not belong together, or the friction
            cannot be simulated.
        SolverError: the simulated robot ran away, or the iteration does not settle.
        IdentifiabilityError: nothing can be learnt.
    """
    cards = (*scene.library.card.beta, *scene.library.card.friction)
    _check_problem(scene, start, [card.name for card in cards])
    values = np.array([start[card.name] for card in cards])
    runs = _simulate_start(scene, values)
    changes: list[float] = []
    while True:
        found = solve(values, runs)
        # What the logs cannot tell stays where it was.
        target = np.where(found.seen.learnable, found.fit.values, values)
        changes.append(_measure_change(target - values, found.fit, found.seen))
        tell(f"simulation {len(changes)}: parameters change by {changes[-1]:.2g} standard deviations")
        if changes[-1] < _SETTLED or (instrumental and _stands(changes)):
            break
        if len(changes) == _LIMIT:
            raise SolverError(_say_unsettled(changes))
        rising = sum(after > _FALLING * before for before, after in pairwise(changes))
        pace = 1.0 / (1.0 + rising) if instrumental else 1.0
        values, runs = _advance(scene, values, values + pace * (target - values))
    tracking, lag = _measure_tracking(scene, runs)
    return ClosedLoopFit(solution=found, changes=tuple(changes), tracking=tracking, lag=lag)


def select_compared(recording: Recording, loop: ClosedLoop, processing: Processing) -> slice:
    """Return the samples that are compared: not those while the loop forgets how the simulation began."""
    first = max(processing.drop_first, math.ceil(loop.settling / recording.period))
    return slice(first, len(recording.time) - processing.drop_last)


def _simulate_start(scene: ClosedLoopProblem, values: FloatArray) -> list[ClosedLoopRun]:
    """Return the first runs; what is wrong with values is told apart from what no value would mend."""
    try:
        return _simulate(scene, values)
    except (UsageError, SolverError) as error:
        notices = [notice for notice in error.notices if notice.code in _OF_VALUES]
        if not notices:
            raise
        text = (
            f"the parameters to begin with cannot be simulated: {notices[0].text}; begin with others "
            "(--start), such as those of --estimator consistent"
        )
        raise SolverError(Notice(code="solver.controlled-robot", text=text)) from error


def _simulate(scene: ClosedLoopProblem, values: FloatArray) -> list[ClosedLoopRun]:
    pairs = zip(scene.recordings, scene.loops, strict=True)
    return [simulate_closed_loop(scene.library, values, recording, loop) for recording, loop in pairs]


def _advance(
    scene: ClosedLoopProblem, values: FloatArray, target: FloatArray
) -> tuple[FloatArray, list[ClosedLoopRun]]:
    """Return the next parameters (p,) and their runs: half the way, and again, where that is no robot."""
    for halving in range(_HALVINGS + 1):
        step = values + 0.5**halving * (target - values)
        try:
            return step, _simulate(scene, step)
        except SymidError as error:
            refused = error
    text = (
        "the parameters that explain the torque are of no robot that can be simulated: "
        f"{refused.notices[0].text}; gains, torque limits or reference are not those of the log, it excites "
        "them too little, or the model misses a term"
    )
    raise SolverError(Notice(code="solver.controlled-robot", text=text)) from refused


def _measure_change(step: FloatArray, fit: RegressionFit, seen: Identifiability) -> float:
    """Return the largest change of a parameter in standard deviations, zero where it is rounding."""
    deviation = np.sqrt(np.maximum(np.diag(fit.covariance), np.finfo(float).tiny))
    moved = seen.learnable & (np.abs(step) > _EXACT * np.abs(fit.values))
    return float(np.max(np.abs(step[moved]) / deviation[moved], initial=0.0))


def _measure_tracking(
    scene: ClosedLoopProblem, runs: Sequence[ClosedLoopRun]
) -> tuple[FloatArray, FloatArray]:
    """Return root mean squares (n,) of simulated and of reference less measured positions, low-passed."""
    gaps: list[FloatArray] = []
    lags: list[FloatArray] = []
    decimation = scene.processing.decimation
    for recording, run in zip(scene.recordings, runs, strict=True):
        kept = select_compared(recording, run.loop, scene.processing)
        measured = recording.position[kept]
        gaps.append(decimate(run.signals.q[kept] - measured, decimation))
        lags.append(decimate(run.loop.reference[kept] - measured, decimation))
    size = (np.sqrt(np.mean(np.vstack(parts) ** 2, axis=0)) for parts in (gaps, lags))
    tracking, lag = size
    return tracking, lag


def _check_problem(scene: ClosedLoopProblem, start: Mapping[str, float], names: Sequence[str]) -> None:
    problems = []
    recordings, loops = scene.recordings, scene.loops
    missing = [name for name in names if name not in start]
    if missing:
        problems.append(f"no value to begin with for {', '.join(missing)}; take those of an estimate")
    if len(recordings) != len(loops) or not recordings:
        problems.append(f"{len(loops)} controllers for {len(recordings)} recordings; give one for each")
    problems += [
        f"the reference is {loop.reference.shape}, the position {recording.position.shape}"
        for recording, loop in zip(recordings, loops, strict=False)
        if loop.reference.shape != recording.position.shape
    ]
    if problems:
        raise UsageError(*(Notice(code="usage.controlled-robot", text=text) for text in problems))


def _say_unsettled(changes: Sequence[float]) -> Notice:
    text = (
        f"after {len(changes)} simulations parameters still change by {changes[-1]:.2g} standard deviations: "
        "the controller of the log is another one, or the log excites them too little"
    )
    return Notice(code="solver.controlled-robot", text=text)


def fit_output_error(
    library: Library,
    recordings: Sequence[Recording],
    loops: Sequence[ClosedLoop],
    processing: Processing,
    start: Mapping[str, float],
    *,
    estimator: str = "wls",
    options: EstimatorOptions | None = None,
    rule: RankRule | None = None,
    weights: Sequence[float] | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> ClosedLoopFit:
    """Return the parameters whose simulated torque is next to the measured one.

    Args:
        library: the robot's functions.
        recordings: at least one.
        loops: the controller of each.
        processing: cut ends and decimation of the rows; positions pass no filter.
        start: parameters to begin with, all of them, such as those of an estimate.
        estimator: one of `ESTIMATORS`, of every iteration.
        options: of the estimator.
        rule: when a parameter counts as not seen.
        weights: what the squares of each recording's residuals count for; one if None.
        tell: called with a line about each iteration.

    Raises:
        UsageError: a start value is missing, loops and recordings do not belong together, or the friction
            cannot be simulated.
        SolverError: the simulated robot ran away, or the iteration does not settle.
        IdentifiabilityError: nothing can be learnt.
    """
    how = choose_processing(processing, recordings[0].period)
    # No filter acts on anything that is compared here.
    how = replace(how, filter_cutoff=None, filter_torque=False)
    scene = ClosedLoopProblem(
        library=library, recordings=recordings, loops=loops, processing=how, weights=weights
    )

    def solve(values: FloatArray, runs: Sequence[ClosedLoopRun]) -> ClosedLoopStep:
        rows, shifted = _build_rows(scene, values, runs)
        seen = _analyse_simulated(shifted, rule)
        fit = fit_rows(estimator, shifted, seen, how.noise_freedom, options)
        return ClosedLoopStep(fit=fit, seen=seen, rows=rows, simulated=rows)

    return iterate_closed_loop(scene, start, solve, tell=tell)


def _analyse_simulated(rows: Rows, rule: RankRule | None) -> Identifiability:
    try:
        return analyse_identifiability(rows, rule)
    except IdentifiabilityError as error:
        text = (
            "the simulated robot does not move enough, whatever the measured one does: the reference of the "
            "log hardly moves, or the simulated robot does not follow it; check q_ref, its unit and "
            "[controller]"
        )
        blind = Notice(code="identify.blind-simulation", text=text)
        raise IdentifiabilityError(blind, *error.notices) from error


def _build_rows(
    scene: ClosedLoopProblem, values: FloatArray, runs: Sequence[ClosedLoopRun]
) -> tuple[Rows, Rows]:
    """Return the equations with the measured torques, and with tau - tau_s + W x in their place."""
    plain, shifted = [], []
    processing, joints = scene.processing, scene.library.card.joints
    for recording, run in zip(scene.recordings, runs, strict=True):
        kept = select_compared(recording, run.loop, processing)
        columns = {name: getattr(run.signals, name)[kept] for name in ("time", "q", "dq", "ddq")}
        signals = Signals(**columns, tau=recording.torque[kept], period=run.signals.period)
        rows = build_rows("torque", scene.library, signals, processing)
        model = _compute_torque(scene.library, values, signals)
        excess = decimate(model - run.signals.tau[kept], processing.decimation)
        moved = replace(rows, values=rows.values + excess.T.ravel())
        # A brake may hold a joint that stands still throughout: its torque says nothing.
        held = tuple(j for j in list_resting_joints(recording) if joints[j].friction != "none")
        plain.append(drop_groups(rows, held))
        shifted.append(drop_groups(moved, held))
    return stack_rows(plain, scene.weights), stack_rows(shifted, scene.weights)


def _compute_torque(library: Library, values: FloatArray, signals: Signals) -> FloatArray:
    """Return W x at every sample, (N, n) N m or N."""
    split = len(library.card.beta)
    (torque,) = library.evaluate("inverse_dynamics", signals.q, signals.dq, signals.ddq, values[:split])
    if not library.card.friction:
        return torque.copy()
    (friction,) = library.evaluate("friction", signals.dq, values[split:])
    total: FloatArray = torque + friction
    return total


_CHANCE = 0.5
"""Change in standard deviations that is no more than another choice among valid instruments."""
_ROUNDS = 3
_FALLING = 0.5
_STRONG = 10.0
"""F of the first stage that makes references good enough to begin with."""


def fit_instrumental(
    library: Library,
    recordings: Sequence[Recording],
    loops: Sequence[ClosedLoop],
    processing: Processing,
    start: Mapping[str, float],
    *,
    rule: RankRule | None = None,
    weights: Sequence[float] | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> ClosedLoopFit:
    """Return the parameters that explain the torque at the measured states, found by instruments.

    Args:
        library: the robot's functions.
        recordings: at least one.
        loops: the controller of each.
        processing: of measured and simulated positions and of the rows.
        start: parameters to begin with, all of them, such as those of an estimate.
        rule: when a parameter counts as not seen.
        weights: what the squares of each recording's residuals count for; one if None.
        tell: called with a line about each iteration.

    Raises:
        UsageError: a start value is missing, loops and recordings do not belong together, or the friction
            cannot be simulated.
        SolverError: the simulated robot ran away, or the iteration does not settle.
        LogError: too few samples for the processing.
        IdentifiabilityError: nothing can be learnt.
    """
    how = choose_processing(processing, recordings[0].period)
    scene = ClosedLoopProblem(
        library=library, recordings=recordings, loops=loops, processing=how, weights=weights
    )
    measured: list[Rows] = []

    def solve(_: FloatArray, runs: Sequence[ClosedLoopRun]) -> ClosedLoopStep:
        # Once the scene has been checked; no iteration changes them.
        if not measured:
            measured.extend(_build_measured(scene))
        instruments = [
            _build_beside(scene, run.signals.q, run.loop, recording, rows)
            for run, recording, rows in zip(runs, recordings, measured, strict=True)
        ]
        rows, simulated = stack_rows(measured, weights), stack_rows(instruments, weights)
        found = fit_instruments(rows, simulated, rule, how.noise_freedom)
        return ClosedLoopStep(
            fit=found.fit, seen=found.seen, rows=rows, simulated=simulated, instrumental=found
        )

    return iterate_closed_loop(scene, start, solve, tell=tell, instrumental=True)


def estimate_start(
    library: Library, recordings: Sequence[Recording], loops: Sequence[ClosedLoop], processing: Processing
) -> dict[str, float] | None:
    """Return parameters that instruments along the references find, None where these are too weak.

    Nothing is simulated, so the fit asks for no robot; of noise in the states it is as free as the last one.

    Args:
        library: the robot's functions.
        recordings: at least one.
        loops: the controller of each, with its reference.
        processing: of measured positions, references and rows.
    """
    how = choose_processing(processing, recordings[0].period)
    scene = ClosedLoopProblem(library=library, recordings=recordings, loops=loops, processing=how)
    measured = _build_measured(scene)
    beside = [
        _build_beside(scene, loop.reference, loop, recording, rows)
        for loop, recording, rows in zip(loops, recordings, measured, strict=True)
    ]
    try:
        found = fit_instruments(stack_rows(measured), stack_rows(beside), freedom=how.noise_freedom)
    except IdentifiabilityError:
        # References that stand still, or move together, tell nothing; the logs may.
        return None
    if found.strength < _STRONG:
        return None
    values = found.fit.values.tolist()
    return {name: values[k] for k, name in enumerate(measured[0].names) if found.seen.learnable[k]}


def _stands(changes: Sequence[float]) -> bool:
    """Return whether nothing but the choice among valid instruments changes any more."""
    last = changes[-_ROUNDS:]
    return len(last) == _ROUNDS and max(last) < _CHANCE and last[-1] > _FALLING * last[-2]


def _build_measured(scene: ClosedLoopProblem) -> list[Rows]:
    """Return the rows of each recording, after the loop has forgotten how the simulation began."""
    pairs = zip(scene.recordings, scene.loops, strict=True)
    return [
        prepare_rows("torque", scene.library, recording, _cut_start(scene, recording, loop), window=WINDOW)
        for recording, loop in pairs
    ]


def _cut_start(scene: ClosedLoopProblem, recording: Recording, loop: ClosedLoop) -> Processing:
    kept = select_compared(recording, loop, scene.processing)
    return replace(scene.processing, drop_first=kept.start)


def _build_beside(
    scene: ClosedLoopProblem, position: FloatArray, loop: ClosedLoop, recording: Recording, rows: Rows
) -> Rows:
    """Return the rows along other positions (N, n) that stand beside the measured ones."""
    processing = _cut_start(scene, recording, loop)
    simulated = replace(recording, position=position)
    signals = hold_resting_joints(prepare_signals(simulated, processing), list_resting_joints(recording))
    whole = build_rows("torque", scene.library, signals, processing)
    kept = np.zeros(len(whole.values), dtype=bool)
    for group in range(len(whole.group_names)):
        members = whole.group == group
        kept[members] = np.isin(whole.time[members], rows.time[rows.group == group])
    return select_rows(whole, kept)
