"""Output error: the controlled robot is simulated, and its torque compared with the measured one.

Input: a library, recordings with the references of their controllers, gains. Output: `OutputErrorFit`.

    simulate   tau = o + Kp (q_ref - q) + Kd (dq_ref - dq), held over each period, on the model with x_k
    regress    [Y | Yf](q_s, dq_s, ddq_s) x = tau measured, at the simulated states: x_(k+1)
    until x changes by less than a part of its standard deviation

(DIDIM: Gautier, Janot and Vandanjon 2013, IEEE Transactions on Control Systems Technology 21(2).) Where a
controller tracks well, the simulated states hardly depend on x, so that a few iterations are enough. No
measured position enters the equations: noise of encoders, filters and differences do no harm.

Supported: rigid robots, friction that the plant of `simulation` holds; one recording or several.
Not supported: controllers of other structure (integral parts, current loops with dynamics); elastic joints.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.codegen.calls import Call
from symid.codegen.functions import ModelCard, ParameterCard
from symid.codegen.library import Library
from symid.data.filters import differentiate
from symid.data.recording import Recording, Signals
from symid.data.signals import settle_processing
from symid.errors import Notice, SolverError, UsageError
from symid.identification.estimators import EstimatorOptions, fit_rows
from symid.identification.identifiability import find_identifiability
from symid.identification.regression import Fit
from symid.identification.rows import build_rows, stack_rows
from symid.robot.log_map import Processing
from symid.simulation.plant import Plant, PlantState

__all__ = ["OutputErrorFit", "ServoLoop", "fit_output_error", "simulate_servo"]

_LIMIT = 15
_SETTLED = 0.05
"""Change of every parameter, in standard deviations, below which the iteration ends."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ServoLoop:
    """The controller of one recording.

    Args:
        reference: (N, n) rad or m, at the times of the recording.
        stiffness: Kp (n,) N m/rad or N/m; damping: Kd (n,) N m s/rad or N s/m, of the joints.
        velocity: (N, n) reference of the velocity; zero where empty.
        offset: o (n,) N m or N, a constant torque, such as the weight at the first pose; zero where empty.
    """

    reference: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    velocity: FloatArray = field(default_factory=lambda: np.empty(0))
    offset: FloatArray = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only; what is empty is zero."""
        reference = freeze(self.reference)
        velocity = self.velocity if self.velocity.size else np.zeros_like(reference)
        offset = self.offset if self.offset.size else np.zeros(reference.shape[1])
        object.__setattr__(self, "reference", reference)
        for name, values in (("velocity", velocity), ("offset", offset)):
            object.__setattr__(self, name, freeze(values))
        for name in ("stiffness", "damping"):
            object.__setattr__(self, name, freeze(getattr(self, name)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OutputErrorFit:
    """The result.

    Args:
        fit: of the last iteration, on simulated states.
        iterations: how many simulations of all recordings it took.
        changes: largest change of a parameter in standard deviations, iteration by iteration.
        tracking: (n,) rad or m, root mean square between simulated and measured positions.
    """

    fit: Fit
    iterations: int
    changes: tuple[float, ...]
    tracking: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _ValuedLibrary:
    """A library whose card states other values."""

    inner: Library
    card: ModelCard

    @property
    def backend(self) -> str:
        return self.inner.backend

    @property
    def notices(self) -> tuple[Notice, ...]:
        return self.inner.notices

    def evaluate(
        self, name: str, *inputs: FloatArray, out: Sequence[FloatArray] | None = None
    ) -> tuple[FloatArray, ...]:
        return self.inner.evaluate(name, *inputs, out=out)

    def bind(self, name: str, *, out: Sequence[FloatArray] | None = None) -> Call:
        return self.inner.bind(name, out=out)


def fit_output_error(
    library: Library,
    recordings: Sequence[Recording],
    loops: Sequence[ServoLoop],
    processing: Processing,
    start: Mapping[str, float],
    *,
    estimator: str = "wls",
    options: EstimatorOptions | None = None,
) -> OutputErrorFit:
    """Return the parameters whose simulated torque is next to the measured one.

    Args:
        library: the robot's functions.
        recordings: at least one.
        loops: the controller of each.
        processing: cut ends and decimation of the rows; positions pass no filter.
        start: parameters to begin with, all of them, such as those of an estimate.
        estimator: one of `ESTIMATORS`, of every iteration.
        options: of the estimator.

    Raises:
        UsageError: a start value is missing, or loops and recordings do not belong together.
        SolverError: the simulated robot ran away, or the iteration does not settle.
        IdentifiabilityError: nothing can be learnt.
    """
    cards = (*library.card.beta, *library.card.friction)
    _check(recordings, loops, start, cards)
    processing = settle_processing(processing, recordings[0].period)
    values = np.array([start[card.name] for card in cards])
    changes: list[float] = []
    while True:
        runs = [
            simulate_servo(library, values, recording, loop)
            for recording, loop in zip(recordings, loops, strict=True)
        ]
        rows = stack_rows([build_rows("torque", library, _cut(run, processing), processing) for run in runs])
        seen = find_identifiability(rows)
        fit = fit_rows(estimator, rows, seen, processing.noise_freedom, options)
        # What the logs cannot tell stays where it was.
        fitted = np.where(seen.learnable, fit.values, values)
        size = np.sqrt(np.maximum(np.diag(fit.covariance), np.finfo(float).tiny))
        changes.append(float(np.abs((fitted - values) / size)[seen.learnable].max()))
        values = fitted
        if changes[-1] < _SETTLED:
            break
        if len(changes) == _LIMIT:
            raise SolverError(_say_unsettled(changes))
    errors = [run.q - recording.position for run, recording in zip(runs, recordings, strict=True)]
    return OutputErrorFit(
        fit=fit,
        iterations=len(changes),
        changes=tuple(changes),
        tracking=np.sqrt(np.mean(np.vstack(errors) ** 2, axis=0)),
    )


def simulate_servo(library: Library, values: FloatArray, recording: Recording, loop: ServoLoop) -> Signals:
    """Return states of the controlled model at the times of a recording, with the torque that was measured.

    It starts at the recording's first position, with the reference's velocity.

    Args:
        library: the robot's functions.
        values: (p,) base parameters and friction.
        recording: whose torque is kept.
        loop: its controller.

    Raises:
        SolverError: the model runs away, or its friction cannot be simulated.
    """
    plant = Plant(_ValuedLibrary(inner=library, card=_state_values(library.card, values)))
    first = loop.velocity[0]
    state = PlantState(
        q=np.array(recording.position[0]),
        dq=np.array(first),
        modes=tuple(int(np.sign(speed)) for speed in first),
    )
    count, reach = len(recording.time), _find_reach(loop)
    q, dq = np.empty((count, plant.size)), np.empty((count, plant.size))
    for k in range(count):
        q[k], dq[k] = state.q, state.dq
        if not np.all(np.abs(state.q - loop.reference[k]) < reach):
            raise SolverError(_say_runaway(recording, k))
        push = loop.stiffness * (loop.reference[k] - state.q) + loop.damping * (loop.velocity[k] - state.dq)
        if k + 1 < count:
            state = plant.advance(state, loop.offset + push, recording.period)
    return Signals(
        time=recording.time,
        q=q,
        dq=dq,
        ddq=differentiate(dq, recording.period),
        tau=recording.torque,
        period=recording.period,
    )


def _state_values(card: ModelCard, values: FloatArray) -> ModelCard:
    split = len(card.beta)
    return replace(
        card,
        beta=tuple(
            replace(entry, value=float(x)) for entry, x in zip(card.beta, values[:split], strict=True)
        ),
        friction=tuple(
            replace(entry, value=float(x)) for entry, x in zip(card.friction, values[split:], strict=True)
        ),
    )


def _cut(signals: Signals, processing: Processing) -> Signals:
    kept = slice(processing.drop_first, len(signals.time) - processing.drop_last)
    names = ("time", "q", "dq", "ddq", "tau")
    return Signals(**{name: getattr(signals, name)[kept] for name in names}, period=signals.period)


def _find_reach(loop: ServoLoop) -> FloatArray:
    """Return the distance (n,) from the reference beyond which a run is lost."""
    reach: FloatArray = 10.0 * np.maximum(np.ptp(loop.reference, axis=0), 1e-3)
    return reach


def _check(
    recordings: Sequence[Recording],
    loops: Sequence[ServoLoop],
    start: Mapping[str, float],
    cards: Sequence[ParameterCard],
) -> None:
    problems = []
    missing = [card.name for card in cards if card.name not in start]
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
        raise UsageError(*(Notice(code="usage.output-error", text=text) for text in problems))


def _say_runaway(recording: Recording, sample: int) -> Notice:
    seconds = recording.time[sample] - recording.time[0]
    text = (
        f"the simulated robot left its reference after {seconds:.3g} s: the "
        "gains are not those of the controller, or the parameters to begin with are far off"
    )
    return Notice(code="solver.output-error", text=text, file=recording.source)


def _say_unsettled(changes: Sequence[float]) -> Notice:
    text = (
        f"after {len(changes)} simulations parameters still change by {changes[-1]:.2g} standard deviations: "
        "the controller of the log is another one, or the log excites them too little"
    )
    return Notice(code="solver.output-error", text=text)
