"""Output error: the controlled robot is simulated, and its torque compared with the measured one.

Input: a library, recordings, the controllers of each, parameters to begin with. Output: `ControlledFit`.

    simulate   the robot with x_k under its controller: states q_s, torque tau_s
    regress    W (x_(k+1) - x_k) = tau - tau_s,   W = [Y | Yf](q_s, dq_s, ddq_s),  both sides decimated alike
    until x changes by less than a part of its standard deviation

The direct and inverse dynamic identification of Gautier, Janot and Vandanjon (2013, IEEE Transactions on
Control Systems Technology 21(2)): where a controller tracks well, the simulated states hardly depend on x, so
W is nearly the derivative of the simulated torque, and a few iterations are enough. They compare tau with
W x_(k+1); tau_s in place of W x_k is the same up to what a torque held over a period and a joint that sticks
have of their own, which then stands on both sides. No measured position enters but the first: noise of
encoders, filters and differences do no harm.

Supported: rigid robots, friction that the plant of `simulation` holds; one recording or several, weighed.
Not supported: elastic joints; parameters of the controller (`servo` says which controllers there are).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from symid.arrays import FloatArray
from symid.codegen.library import Library
from symid.data.recording import Recording, Signals
from symid.data.signals import decimate_columns, settle_processing
from symid.errors import IdentifiabilityError, Notice
from symid.estimators.estimators import EstimatorOptions, fit_rows
from symid.identification.controlled_runs import (
    ControlledFit,
    ControlledScene,
    Solution,
    find_compared,
    fit_controlled,
)
from symid.identification.servo import ServoLoop, ServoRun
from symid.robot.log_map import Processing
from symid.rows.identifiability import (
    Identifiability,
    RankRule,
    find_identifiability,
    find_resting_joints,
)
from symid.rows.rows import Rows, build_rows, drop_groups, stack_rows

__all__ = ["fit_output_error"]


def fit_output_error(
    library: Library,
    recordings: Sequence[Recording],
    loops: Sequence[ServoLoop],
    processing: Processing,
    start: Mapping[str, float],
    *,
    estimator: str = "wls",
    options: EstimatorOptions | None = None,
    rule: RankRule | None = None,
    weights: Sequence[float] | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> ControlledFit:
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
    how = settle_processing(processing, recordings[0].period)
    # No filter acts on anything that is compared here.
    how = replace(how, filter_cutoff=None, filter_torque=False)
    scene = ControlledScene(
        library=library, recordings=recordings, loops=loops, processing=how, weights=weights
    )

    def solve(values: FloatArray, runs: Sequence[ServoRun]) -> Solution:
        rows, shifted = _build_rows(scene, values, runs)
        seen = _see(shifted, rule)
        fit = fit_rows(estimator, shifted, seen, how.noise_freedom, options)
        return Solution(fit=fit, seen=seen, rows=rows, simulated=rows)

    return fit_controlled(scene, start, solve, tell=tell)


def _see(rows: Rows, rule: RankRule | None) -> Identifiability:
    try:
        return find_identifiability(rows, rule)
    except IdentifiabilityError as error:
        text = (
            "the simulated robot does not move enough, whatever the measured one does: the reference of the "
            "log hardly moves, or the simulated robot does not follow it; check q_ref, its unit and "
            "[controller]"
        )
        blind = Notice(code="identify.blind-simulation", text=text)
        raise IdentifiabilityError(blind, *error.notices) from error


def _build_rows(scene: ControlledScene, values: FloatArray, runs: Sequence[ServoRun]) -> tuple[Rows, Rows]:
    """Return the equations with the measured torques, and with tau - tau_s + W x in their place."""
    plain, shifted = [], []
    processing, joints = scene.processing, scene.library.card.joints
    for recording, run in zip(scene.recordings, runs, strict=True):
        kept = find_compared(recording, run.loop, processing)
        signals = replace(_cut(run.signals, kept), tau=recording.torque[kept])
        rows = build_rows("torque", scene.library, signals, processing)
        model = _find_torque(scene.library, values, signals)
        excess = decimate_columns(model - run.signals.tau[kept], processing.decimation)
        moved = replace(rows, values=rows.values + excess.T.ravel())
        # A brake may hold a joint that stands still throughout: its torque says nothing.
        held = tuple(j for j in find_resting_joints(recording) if joints[j].friction != "none")
        plain.append(drop_groups(rows, held))
        shifted.append(drop_groups(moved, held))
    return stack_rows(plain, scene.weights), stack_rows(shifted, scene.weights)


def _cut(signals: Signals, kept: slice) -> Signals:
    return Signals(
        time=signals.time[kept],
        q=signals.q[kept],
        dq=signals.dq[kept],
        ddq=signals.ddq[kept],
        tau=signals.tau[kept],
        period=signals.period,
    )


def _find_torque(library: Library, values: FloatArray, signals: Signals) -> FloatArray:
    """Return W x at every sample, (N, n) N m or N."""
    split = len(library.card.beta)
    (torque,) = library.evaluate("inverse_dynamics", signals.q, signals.dq, signals.ddq, values[:split])
    if not library.card.friction:
        return torque.copy()
    (friction,) = library.evaluate("friction", signals.dq, values[split:])
    total: FloatArray = torque + friction
    return total
