"""A controlled robot, simulated at the times of a recording.

Library, parameters, recording with the reference of its controller -> `ClosedLoop`, the controller of one
recording, and `ClosedLoopRun`, what the robot did under it.

    tau[k] = o + tau_ff[k] + Kp (q_ref[k] - q[k]) + Kd (dq_ref[k] - v[k])      within +- limit, held to k + 1
    v[k]   = v[k-1] + b ((q[k] - q[k-1]) / T - v[k-1]),   b = 1 - exp(-2 pi f T)     velocity from differences

v = dq[k] from a sensor, through the same low-pass; b = 1 without a filter. A constant torque o that is not
known is taken from the recording: the mean of what its torque has beyond the other terms, at the measured
positions. The simulation starts at the first measured position, with the velocity of the reference. The
plant takes the parameters from a library whose model card states them.

Supported: what `symid.robot.Controller` states; torque limits of the joints; base parameters and friction.
Not supported: controllers that run at another period than the log.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from symid.arrays import FloatArray, freeze
from symid.codegen import Library, ModelCard
from symid.errors import Notice, SolverError, UsageError
from symid.identification.regression import list_resting_joints
from symid.logs import Recording, Signals, differentiate
from symid.robot import Controller
from symid.simulation import RigidPlant, RigidPlantState


def set_card_values(card: ModelCard, values: FloatArray) -> ModelCard:
    """Return the card with `values` (p,), base parameters first, then friction, in SI units."""
    split = len(card.beta)
    beta = zip(card.beta, values[:split].tolist(), strict=True)
    friction = zip(card.friction, values[split:].tolist(), strict=True)
    return replace(
        card,
        beta=tuple(replace(entry, value=number) for entry, number in beta),
        friction=tuple(replace(entry, value=number) for entry, number in friction),
    )


_FORGOTTEN = 10.0
"""Times Kd / Kp after which the loop has forgotten where the simulation began."""
_AT_REST = 1e-9
"""Velocities of the reference below this, rad/s or m/s, are none."""
_STRANGE = 1.8
"""Deviation of reference less position, beside that of the position, above which they are of two motions."""
_LOST = 10.0
"""A run is lost this many times the reference's range away from it, and at least so many rad or m."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClosedLoop:
    """The controller of one recording.

    Args:
        controller: gains and structure.
        reference: (N, n) rad or m, at the times of the recording.
        velocity: (N, n) rad/s or m/s of the reference; zero where empty.
        feedforward: (N, n) N m or N, zero where empty.
        offset: o (n,) N m or N, zero where empty.
        limit: (n,) N m or N of the torque, infinite where empty.
    """

    controller: Controller
    reference: FloatArray
    velocity: FloatArray = field(default_factory=lambda: np.empty(0))
    feedforward: FloatArray = field(default_factory=lambda: np.empty(0))
    offset: FloatArray = field(default_factory=lambda: np.empty(0))
    limit: FloatArray = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only; fill what is empty."""
        reference = freeze(self.reference)
        size = reference.shape[1]
        object.__setattr__(self, "reference", reference)
        for name, standard in (
            ("velocity", np.zeros_like(reference)),
            ("feedforward", np.zeros_like(reference)),
            ("offset", np.zeros(size)),
            ("limit", np.full(size, np.inf)),
        ):
            values: FloatArray = getattr(self, name)
            object.__setattr__(self, name, freeze(values if values.size else standard))

    @property
    def settling(self) -> float:
        """Return the time in s after which nothing is left of how a simulation began."""
        return _compute_settling(self.controller)

    def find_blend(self, period: float) -> float:
        """Return b of the velocity's low-pass at a period in s."""
        cutoff = self.controller.velocity_filter
        return 1.0 if cutoff is None else 1.0 - float(np.exp(-2.0 * np.pi * cutoff * period))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClosedLoopRun:
    """What a simulated robot did: states at the times of the recording, `signals.tau` as it would log it."""

    signals: Signals
    loop: ClosedLoop


def build_closed_loop(recording: Recording, controller: Controller, limit: FloatArray) -> ClosedLoop:
    """Return the controller of a recording that has its reference.

    Args:
        recording: with `reference`; without `reference_velocity` it is differentiated.
        controller: of the robot file.
        limit: (n,) N m or N, infinite where there is none.

    Raises:
        UsageError: the recording has no reference, or one that is no number throughout or of another motion;
            the loop is too slow for it.
    """
    reference = recording.reference
    unusable = list_unusable(recording, controller)
    if unusable or reference is None:
        raise UsageError(*unusable)
    speeds = np.zeros_like(reference)
    if controller.velocity == "error":
        known = recording.reference_velocity
        speeds = differentiate(reference, recording.period) if known is None else known
    loop = ClosedLoop(
        controller=controller,
        reference=reference,
        velocity=speeds,
        feedforward=np.empty(0) if recording.feedforward is None else recording.feedforward,
        offset=np.array(controller.offset or (0.0,) * reference.shape[1]),
        limit=limit,
    )
    if controller.offset is not None:
        return loop
    missing = recording.torque - compute_demand(loop, recording)
    return replace(loop, offset=missing[round(loop.settling / recording.period) :].mean(axis=0))


def list_unusable(recording: Recording, controller: Controller | None = None) -> tuple[Notice, ...]:
    """Return what keeps a controller, any if none is given, from being simulated along a recording."""
    if recording.reference is None:
        text = (
            "this estimator simulates the controller, and the log has no reference position: log it as "
            "q_ref, or name its columns in [log.reference]"
        )
        return (Notice(code="usage.controlled-robot", text=text, file=recording.source),)
    notices = []
    for name in ("reference", "reference_velocity", "feedforward"):
        values: FloatArray | None = getattr(recording, name)
        if values is not None and not np.all(np.isfinite(values)):
            first = int(np.argwhere(~np.isfinite(values))[0, 0])
            text = (
                f"{name} holds values that are no numbers (NaN, infinite), the first at sample {first}, "
                "counted from 0; cut or repair the log there"
            )
            notices.append(Notice(code="usage.controlled-robot", text=text, file=recording.source))
    if notices:
        return tuple(notices)
    slow = () if controller is None else _refuse_slow(recording, _compute_settling(controller))
    return (*_refuse_strange(recording, recording.reference), *slow)


def _refuse_strange(recording: Recording, reference: FloatArray) -> tuple[Notice, ...]:
    """Return a notice where the reference is so far from a joint that moves that it is of something else."""
    if reference.shape != recording.position.shape:
        return ()
    moved, away = np.std(recording.position, axis=0), np.std(reference - recording.position, axis=0)
    resting = list_resting_joints(recording)
    strange = [j for j in range(len(moved)) if j not in resting and away[j] > _STRANGE * moved[j]]
    if not strange:
        return ()
    told = ", ".join(f"{j + 1} ({away[j]:.3g} from it, which moves {moved[j]:.3g})" for j in strange)
    text = (
        "the reference is not one of the measured position, counted in standard deviations in rad or m, of "
        f"joint {told}: check unit, factor, sign and side (of the gear) of [log.reference], or whose run it "
        "is"
    )
    return (Notice(code="usage.controlled-robot", text=text, file=recording.source),)


def _refuse_slow(recording: Recording, settling: float) -> tuple[Notice, ...]:
    """Return a notice where the loop does not forget within the log where its simulation began."""
    length = len(recording.time) * recording.period
    if settling + 2.0 * recording.period < length:
        return ()
    text = (
        f"the loop forgets where its simulation began after {settling:.3g} s, {_FORGOTTEN:g} times damping "
        f"/ stiffness of its slowest joint, and the log is {length:.3g} s long: check the gains of "
        "[controller], or record longer"
    )
    return (Notice(code="usage.controlled-robot", text=text, file=recording.source),)


def _compute_settling(controller: Controller) -> float:
    stiffness, damping = np.array(controller.stiffness), np.array(controller.damping)
    slow = np.divide(damping, stiffness, out=np.zeros_like(damping), where=stiffness > 0.0)
    return _FORGOTTEN * float(slow.max())


def compute_demand(loop: ClosedLoop, recording: Recording) -> FloatArray:
    """Return the torque (N, n) that the controller asks for at the measured positions, as a log states it."""
    position, period, blend = recording.position, recording.period, loop.find_blend(recording.period)
    if loop.controller.velocity_source == "sensor":
        raw = differentiate(position, period)
    else:
        raw = np.diff(position, axis=0, prepend=2.0 * position[:1] - position[1:2]) / period
    speeds = np.empty_like(raw)
    speeds[0] = raw[0]
    for k in range(1, len(raw)):
        speeds[k] = speeds[k - 1] + blend * (raw[k] - speeds[k - 1])
    gains = loop.controller
    demand = (
        loop.offset
        + loop.feedforward
        + np.array(gains.stiffness) * (loop.reference - position)
        + np.array(gains.damping) * (loop.velocity - speeds)
    )
    return _log_torque(np.minimum(np.maximum(demand, -loop.limit), loop.limit), gains)


def simulate_closed_loop(
    library: Library, values: FloatArray, recording: Recording, loop: ClosedLoop
) -> ClosedLoopRun:
    """Return what the controlled model does at the times of a recording.

    Args:
        library: the robot's functions.
        values: (p,) base parameters and friction.
        recording: its times and its first position.
        loop: its controller.

    Raises:
        UsageError: the model has friction that cannot be simulated.
        SolverError: it runs away, or starts and stops without end.
    """
    plant = RigidPlant(Library(set_card_values(library.card, values), library.engine))
    period, blend, gains = recording.period, loop.find_blend(recording.period), loop.controller
    stiffness, damping = np.array(gains.stiffness), np.array(gains.damping)
    sensed = gains.velocity_source == "sensor"
    reach = _LOST * np.maximum(np.ptp(loop.reference, axis=0), 1.0)
    known = recording.reference_velocity
    speed = differentiate(loop.reference, period)[0] if known is None else known[0]
    speed = np.where(np.abs(speed) > _AT_REST, speed, 0.0)
    state = RigidPlantState(
        q=np.array(recording.position[0]), dq=speed, modes=tuple(int(sign) for sign in np.sign(speed))
    )
    count = len(recording.time)
    q, dq, torque = (np.empty((count, plant.size)) for _ in range(3))
    before, velocity = state.q - period * speed, speed
    for k in range(count):
        q[k], dq[k] = state.q, state.dq
        if not np.all(np.abs(state.q - loop.reference[k]) < reach):
            raise SolverError(_say_runaway(recording, k))
        raw = state.dq if sensed else (state.q - before) / period
        velocity, before = velocity + blend * (raw - velocity), state.q
        push = stiffness * (loop.reference[k] - state.q) + damping * (loop.velocity[k] - velocity)
        demand = loop.offset + loop.feedforward[k] + push
        torque[k] = np.minimum(np.maximum(demand, -loop.limit), loop.limit)
        if k + 1 < count:
            # A loop that runs away overflows within a period, which is told at its end.
            with np.errstate(over="ignore", invalid="ignore"):
                state = plant.advance(state, torque[k], period)
    return ClosedLoopRun(
        signals=Signals(
            time=recording.time,
            q=q,
            dq=dq,
            ddq=differentiate(dq, period),
            tau=_log_torque(torque, gains),
            period=period,
        ),
        loop=loop,
    )


def _log_torque(torque: FloatArray, gains: Controller) -> FloatArray:
    """Return held torques (N, n) as the log states them."""
    if gains.torque == "command":
        return torque
    average = torque.copy()
    average[1:] = 0.5 * (torque[1:] + torque[:-1])
    return average


def _say_runaway(recording: Recording, sample: int) -> Notice:
    seconds = recording.time[sample] - recording.time[0]
    text = (
        f"the simulated robot left its reference after {seconds:.3g} s: the "
        "gains are not those of the controller, or the parameters to begin with are far off"
    )
    return Notice(code="solver.controlled-robot", text=text, file=recording.source)
