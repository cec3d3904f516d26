"""Torque rows of measured states, solved with instruments from the simulated robot: IDIM-IV.

Input: a library, recordings, the controllers of each, parameters to begin with. Output: `ControlledFit`.

    simulate    the robot with x_k under its controller: states q_s without noise
    process     filter, differentiate, cut and decimate q_s exactly as the measured q: Z from q_s, Y from q
    solve       x_(k+1) = (Z' W Y)^-1 Z' W tau
    until x changes by less than a part of its standard deviation, or to and fro by less than half of one

The generic instrumental variable approach of Janot, Vandanjon and Gautier (2014, IEEE Transactions on Control
Systems Technology 22(1)). The simulated states know the reference, and nothing of the noise that encoders and
differences put into Y. Whatever x_k is, Z stays free of that noise: a wrong x_k or wrong gains make
deviations larger, not the result wrong, as long as Z resembles Y. Where simulated dry friction changes sign a
sample earlier, other noise counts, and x moves by a part of its deviation. So steps become shorter where
changes do not fall, and the iteration may end in going to and fro between such instruments, each as good as
the other.

Supported: rigid robots, friction that the plant of `simulation` holds; one recording or several, weighed.
Not supported: elastic joints. Noise that does more than add to Y stays: in the sign of a slow velocity, in
squares.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.library import Library
from symid.data.recording import Recording
from symid.data.signals import prepare_signals, settle_processing
from symid.errors import IdentifiabilityError
from symid.estimators.instrumental import fit_instruments
from symid.identification.controlled_runs import (
    ControlledFit,
    ControlledScene,
    Solution,
    find_compared,
    fit_controlled,
    is_settled,
)
from symid.identification.servo import ServoLoop, ServoRun
from symid.robot.log_map import Processing
from symid.rows.identifiability import RankRule, find_resting_joints, settle_joints
from symid.rows.preparation import prepare_rows
from symid.rows.rows import WINDOW, Rows, build_rows, select_rows, stack_rows

__all__ = ["find_start", "fit_instrumental"]

_CHANCE = 0.5
"""Change in standard deviations that is no more than another choice among valid instruments."""
_ROUNDS = 3
_FALLING = 0.5
_STRONG = 10.0
"""F of the first stage that makes references good enough to begin with."""


def fit_instrumental(
    library: Library,
    recordings: Sequence[Recording],
    loops: Sequence[ServoLoop],
    processing: Processing,
    start: Mapping[str, float],
    *,
    rule: RankRule | None = None,
    weights: Sequence[float] | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> ControlledFit:
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
    how = settle_processing(processing, recordings[0].period)
    scene = ControlledScene(
        library=library, recordings=recordings, loops=loops, processing=how, weights=weights
    )
    measured: list[Rows] = []

    def solve(_: FloatArray, runs: Sequence[ServoRun]) -> Solution:
        # Once the scene has been checked; no iteration changes them.
        if not measured:
            measured.extend(_build_measured(scene))
        instruments = [
            _build_instruments(scene, run, recording, rows)
            for run, recording, rows in zip(runs, recordings, measured, strict=True)
        ]
        rows, simulated = stack_rows(measured, weights), stack_rows(instruments, weights)
        found = fit_instruments(rows, simulated, rule, how.noise_freedom)
        return Solution(fit=found.fit, seen=found.seen, rows=rows, simulated=simulated, instrumental=found)

    return fit_controlled(scene, start, solve, tell=tell, enough=_is_enough, pace=_find_pace)


def find_start(
    library: Library, recordings: Sequence[Recording], loops: Sequence[ServoLoop], processing: Processing
) -> dict[str, float] | None:
    """Return parameters that instruments along the references find, None where these are too weak.

    Nothing is simulated, so the fit asks for no robot; of noise in the states it is as free as the last one.

    Args:
        library: the robot's functions.
        recordings: at least one.
        loops: the controller of each, with its reference.
        processing: of measured positions, references and rows.
    """
    how = settle_processing(processing, recordings[0].period)
    scene = ControlledScene(library=library, recordings=recordings, loops=loops, processing=how)
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


def _is_enough(changes: Sequence[float]) -> bool:
    """Return whether nothing but the choice among valid instruments changes any more."""
    last = changes[-_ROUNDS:]
    stands = len(last) == _ROUNDS and max(last) < _CHANCE and last[-1] > _FALLING * last[-2]
    return is_settled(changes) or stands


def _find_pace(changes: Sequence[float]) -> float:
    """Return the part of the last change to be made: less of it each time that changes do not fall."""
    stands = sum(after > _FALLING * before for before, after in pairwise(changes))
    return 1.0 / (1.0 + stands)


def _build_measured(scene: ControlledScene) -> list[Rows]:
    """Return the rows of each recording, after the loop has forgotten how the simulation began."""
    pairs = zip(scene.recordings, scene.loops, strict=True)
    return [
        prepare_rows("torque", scene.library, recording, _cut_start(scene, recording, loop), window=WINDOW)
        for recording, loop in pairs
    ]


def _cut_start(scene: ControlledScene, recording: Recording, loop: ServoLoop) -> Processing:
    kept = find_compared(recording, loop, scene.processing)
    return replace(scene.processing, drop_first=kept.start)


def _build_instruments(scene: ControlledScene, run: ServoRun, recording: Recording, rows: Rows) -> Rows:
    """Return the rows along the simulated states that stand beside the measured ones, one by one."""
    return _build_beside(scene, run.signals.q, run.loop, recording, rows)


def _build_beside(
    scene: ControlledScene, position: FloatArray, loop: ServoLoop, recording: Recording, rows: Rows
) -> Rows:
    """Return the rows along other positions (N, n) that stand beside the measured ones."""
    processing = _cut_start(scene, recording, loop)
    simulated = replace(recording, position=position)
    signals = settle_joints(prepare_signals(simulated, processing), find_resting_joints(recording))
    whole = build_rows("torque", scene.library, signals, processing)
    kept = np.zeros(len(whole.values), dtype=bool)
    for group in range(len(whole.group_names)):
        members = whole.group == group
        kept[members] = np.isin(whole.time[members], rows.time[rows.group == group])
    return select_rows(whole, kept)
