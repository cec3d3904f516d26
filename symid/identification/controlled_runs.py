"""Recordings and the simulated robot beside each, under its controller: what both fits of such runs share.

Input: a library, recordings, the controllers of each, parameters to begin with. Output: `ControlledFit`.

    simulate   the robot with x_k under its controller
    solve      equations made of what it did: x_(k+1)
    until x changes by less than a part of its standard deviation

Where the robot with x_(k+1) cannot be simulated, half of the step is taken, and half of that.

Supported: rigid robots, friction that the plant of `simulation` holds; one recording or several, weighed.
Not supported: elastic joints; parameters of the controller (`servo` says which controllers there are).
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.library import Library
from symid.data.recording import Recording
from symid.data.signals import decimate_columns
from symid.errors import Notice, SolverError, SymidError, UsageError
from symid.estimators.instrumental import InstrumentalSolution
from symid.estimators.regression import Fit
from symid.identification.servo import ServoLoop, ServoRun, simulate_servo
from symid.robot.log_map import Processing
from symid.rows.identifiability import Identifiability
from symid.rows.rows import Rows

__all__ = [
    "ControlledFit",
    "ControlledScene",
    "Solution",
    "find_compared",
    "fit_controlled",
    "is_settled",
]

_LIMIT = 15
_SETTLED = 0.05
"""Change of every parameter, in standard deviations, below which the iteration ends."""
_EXACT = 1e-6
"""Change relative to the parameter that ends it too: a log without noise has no deviations."""
_HALVINGS = 6
_OF_VALUES = ("usage.negative-friction", "simulate.chatter")
"""Codes of what keeps a robot from being simulated that other parameters may mend."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ControlledScene:
    """What stays the same from iteration to iteration.

    Args:
        library: the robot's functions.
        recordings: at least one; loops: the controller of each.
        processing: of the rows, nothing left open.
        weights: what the squares of each recording's residuals count for; one if None.
    """

    library: Library
    recordings: Sequence[Recording]
    loops: Sequence[ServoLoop]
    processing: Processing
    weights: Sequence[float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Solution:
    """What one iteration finds: fit, what the runs tell, and the equations with the measured torques.

    `simulated` are the rows along the simulated states; `instrumental` is what instruments found.
    """

    fit: Fit
    seen: Identifiability
    rows: Rows
    simulated: Rows
    instrumental: InstrumentalSolution | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ControlledFit:
    """The result.

    Args:
        solution: of the last iteration; the residuals are measured torques less those of the model.
        changes: largest change of a parameter in standard deviations, iteration by iteration.
        tracking: (n,) rad or m, root mean square between simulated and measured positions, low-passed and
            after the loops settled; lag: (n,) the same between references and measured positions.
    """

    solution: Solution
    changes: tuple[float, ...]
    tracking: FloatArray
    lag: FloatArray

    @property
    def fit(self) -> Fit:
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


Solve = Callable[[FloatArray, Sequence[ServoRun]], Solution]
"""From parameters (p,) and the runs of the robot that has them to the next ones."""


def is_settled(changes: Sequence[float]) -> bool:
    """Return whether the last of the largest changes, in standard deviations, is small enough to end."""
    return changes[-1] < _SETTLED


def fit_controlled(
    scene: ControlledScene,
    start: Mapping[str, float],
    solve: Solve,
    *,
    tell: Callable[[str], None] = lambda _: None,
    enough: Callable[[Sequence[float]], bool] = is_settled,
    pace: Callable[[Sequence[float]], float] = lambda _: 1.0,
) -> ControlledFit:
    """Return where the iteration settles.

    Args:
        scene: robot, recordings, controllers.
        start: parameters to begin with, all of them, such as those of an estimate.
        solve: one iteration.
        tell: called with a line about each iteration.
        enough: from the changes so far to whether the iteration ends.
        pace: from the changes so far to the part of the last one that is made.

    Raises:
        UsageError: a start value is missing, loops and recordings do not belong together, or the friction
            cannot be simulated.
        SolverError: the simulated robot ran away, or the iteration does not settle.
        IdentifiabilityError: nothing can be learnt.
    """
    cards = (*scene.library.card.beta, *scene.library.card.friction)
    _check(scene, start, [card.name for card in cards])
    values = np.array([start[card.name] for card in cards])
    runs = _start(scene, values)
    changes: list[float] = []
    while True:
        found = solve(values, runs)
        # What the logs cannot tell stays where it was.
        target = np.where(found.seen.learnable, found.fit.values, values)
        changes.append(_find_change(target - values, found.fit, found.seen))
        tell(f"simulation {len(changes)}: parameters change by {changes[-1]:.2g} standard deviations")
        if enough(changes):
            break
        if len(changes) == _LIMIT:
            raise SolverError(_say_unsettled(changes))
        values, runs = _advance(scene, values, values + pace(changes) * (target - values))
    tracking, lag = _find_tracking(scene, runs)
    return ControlledFit(solution=found, changes=tuple(changes), tracking=tracking, lag=lag)


def find_compared(recording: Recording, loop: ServoLoop, processing: Processing) -> slice:
    """Return the samples that are compared: not those while the loop forgets how the simulation began."""
    first = max(processing.drop_first, math.ceil(loop.settling / recording.period))
    return slice(first, len(recording.time) - processing.drop_last)


def _start(scene: ControlledScene, values: FloatArray) -> list[ServoRun]:
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


def _simulate(scene: ControlledScene, values: FloatArray) -> list[ServoRun]:
    pairs = zip(scene.recordings, scene.loops, strict=True)
    return [simulate_servo(scene.library, values, recording, loop) for recording, loop in pairs]


def _advance(
    scene: ControlledScene, values: FloatArray, target: FloatArray
) -> tuple[FloatArray, list[ServoRun]]:
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


def _find_change(step: FloatArray, fit: Fit, seen: Identifiability) -> float:
    """Return the largest change of a parameter in standard deviations, zero where it is rounding."""
    deviation = np.sqrt(np.maximum(np.diag(fit.covariance), np.finfo(float).tiny))
    moved = seen.learnable & (np.abs(step) > _EXACT * np.abs(fit.values))
    return float(np.max(np.abs(step[moved]) / deviation[moved], initial=0.0))


def _find_tracking(scene: ControlledScene, runs: Sequence[ServoRun]) -> tuple[FloatArray, FloatArray]:
    """Return root mean squares (n,) of simulated and of reference less measured positions, low-passed."""
    gaps: list[FloatArray] = []
    lags: list[FloatArray] = []
    decimation = scene.processing.decimation
    for recording, run in zip(scene.recordings, runs, strict=True):
        kept = find_compared(recording, run.loop, scene.processing)
        measured = recording.position[kept]
        gaps.append(decimate_columns(run.signals.q[kept] - measured, decimation))
        lags.append(decimate_columns(run.loop.reference[kept] - measured, decimation))
    size = (np.sqrt(np.mean(np.vstack(parts) ** 2, axis=0)) for parts in (gaps, lags))
    tracking, lag = size
    return tracking, lag


def _check(scene: ControlledScene, start: Mapping[str, float], names: Sequence[str]) -> None:
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
