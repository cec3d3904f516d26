"""A controlled robot, simulated at the times of a recording.

Library, parameters, recording with the reference of its controller -> `ClosedLoop`, the controller of one
recording, and the `Signals` of the simulated robot.

    tau[k] = o + tau_ff[k] + Kp (q_ref[k] - q[k]) + Kd (dq_ref[k] - v[k])      within +- limit, held to k + 1
    v[k]   = v[k-1] + b ((q[k] - q[k-1]) / T - v[k-1]),   b = 1 - exp(-2 pi f T)     velocity from differences

v = dq[k] from a sensor, through the same low-pass; b = 1 without a filter. An unknown constant torque o is
estimated from the recording, as the mean of its torque less the other terms at the measured positions. The
simulation starts at the first measured position, with the velocity of the reference.

Supported: what `symid.robot.Controller` states; torque limits of the joints; base parameters and friction.
Not supported: controllers that run at another period than the log.
"""

from dataclasses import dataclass, replace

import numpy as np

from symid.arrays import FloatArray, FrozenArrays
from symid.codegen import Library, ModelCard, RigidExperiment
from symid.errors import Notice, SolverError, UsageError
from symid.identification.regression import list_resting_joints
from symid.logs import Recording, Signals, differentiate
from symid.robot import Controller
from symid.simulation import RigidPlant, simulate_rigid_plant


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
"""Times Kd / Kp after which the initial state of a simulation has no effect."""
_AT_REST = 1e-9
"""Velocities of the reference below this, rad/s or m/s, are zero."""
_STRANGE = 1.8
"""Deviation of reference less position, beside that of the position, above which they are of two motions."""
_LOST = 10.0
"""A run is lost this many times the reference's range away from it, and at least so many rad or m."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClosedLoop(FrozenArrays):
    """The controller of one recording.

    Args:
        controller: gains and structure.
        reference: (N, n) rad or m, at the times of the recording; velocity: (N, n) rad/s or m/s of it.
        feedforward: (N, n) N m or N; offset: o (n,) N m or N.
        limit: (n,) N m or N of the torque, infinite where there is none.
    """

    controller: Controller
    reference: FloatArray
    velocity: FloatArray
    feedforward: FloatArray
    offset: FloatArray
    limit: FloatArray

    @property
    def settling(self) -> float:
        """Return the time in s after which the initial state of a simulation has no effect."""
        return _compute_settling(self.controller)

    def compute_blend(self, period: float) -> float:
        """Return b of the velocity's low-pass at a period in s."""
        cutoff = self.controller.velocity_filter
        return 1.0 if cutoff is None else 1.0 - float(np.exp(-2.0 * np.pi * cutoff * period))


def build_closed_loop(recording: Recording, controller: Controller, limit: FloatArray) -> ClosedLoop:
    """Return the controller of a recording that has its reference, with torque limits (n,) in N m or N.

    A reference velocity that is not logged is differentiated.

    Raises:
        UsageError: the reference is missing, not finite, or of another motion; the loop is too slow for the
            recording.
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
        feedforward=np.zeros_like(reference) if recording.feedforward is None else recording.feedforward,
        offset=np.array(controller.offset or (0.0,) * reference.shape[1]),
        limit=limit,
    )
    if controller.offset is not None:
        return loop
    missing = recording.torque - compute_demand(loop, recording)
    return replace(loop, offset=missing[round(loop.settling / recording.period) :].mean(axis=0))


def list_unusable(recording: Recording, controller: Controller | None = None) -> tuple[Notice, ...]:
    """Return why a controller, any if none is given, cannot be simulated along a recording."""
    texts = []
    if recording.reference is None:
        texts.append(
            "this estimator simulates the controller, and the log has no reference position: log it as "
            "q_ref, or name its columns in [log.reference]"
        )
    for name in ("reference", "reference_velocity", "feedforward"):
        values: FloatArray | None = getattr(recording, name)
        if values is not None and not np.all(np.isfinite(values)):
            first = int(np.argwhere(~np.isfinite(values))[0, 0])
            texts.append(
                f"{name} has values that are not finite, the first at sample {first} (counted from 0): cut "
                "or repair the log there"
            )
    if not texts and recording.reference is not None:
        texts += _list_implausible(recording, recording.reference, controller)
    return tuple(Notice(code="usage.controlled-robot", text=text, file=recording.source) for text in texts)


def _list_implausible(
    recording: Recording, reference: FloatArray, controller: Controller | None
) -> list[str]:
    """Return why the reference belongs to another motion, or the loop is too slow for the log."""
    if reference.shape != recording.position.shape:
        return [f"the reference has shape {reference.shape}, the position {recording.position.shape}"]
    texts = []
    moved, away = np.std(recording.position, axis=0), np.std(reference - recording.position, axis=0)
    resting = list_resting_joints(recording)
    strange = [j for j in range(len(moved)) if j not in resting and away[j] > _STRANGE * moved[j]]
    if strange:
        listed = ", ".join(f"{j + 1} ({away[j]:.3g} against {moved[j]:.3g})" for j in strange)
        texts.append(
            "the difference of reference and measured position varies more than the position itself "
            f"(standard deviations in rad or m) at joint {listed}: check unit, factor, sign and side of "
            "[log.reference], and that it belongs to this run"
        )
    length = len(recording.time) * recording.period
    settling = 0.0 if controller is None else _compute_settling(controller)
    if controller is not None and settling + 2.0 * recording.period >= length:
        texts.append(
            f"the log, {length:.3g} s long, is shorter than the settling time of the loop, {settling:.3g} s "
            f"({_FORGOTTEN:g} times damping / stiffness): check the gains of [controller], or record longer"
        )
    return texts


def _compute_settling(controller: Controller) -> float:
    stiffness, damping = np.array(controller.stiffness), np.array(controller.damping)
    slow = np.divide(damping, stiffness, out=np.zeros_like(damping), where=stiffness > 0.0)
    return _FORGOTTEN * float(slow.max())


def compute_demand(loop: ClosedLoop, recording: Recording) -> FloatArray:
    """Return the torque (N, n) that the controller commands at the measured positions, as logged."""
    position, period, blend = recording.position, recording.period, loop.compute_blend(recording.period)
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
) -> Signals:
    """Return states and logged torque of the controlled model with values (p,) at the times of a recording.

    Raises:
        UsageError: the model has friction that cannot be simulated.
        SolverError: it runs away, or starts and stops without end.
    """
    valued = Library(set_card_values(library.card, values), library.engine)
    plant = RigidPlant(valued)
    period, gains = recording.period, loop.controller
    known = recording.reference_velocity
    speed = differentiate(loop.reference, period)[0] if known is None else known[0]
    speed = np.where(np.abs(speed) > _AT_REST, speed, 0.0)
    order = RigidExperiment(
        position=loop.reference,
        speed=loop.velocity,
        torque=loop.offset + loop.feedforward,
        stiffness=np.array(gains.stiffness),
        damping=np.array(gains.damping),
        limit=loop.limit,
        step=np.zeros(plant.size),
        reach=_LOST * np.maximum(np.ptp(loop.reference, axis=0), 1.0),
        period=period,
        substeps=1,
        blend=loop.compute_blend(period),
        sensed=gains.velocity_source == "sensor",
        q=recording.position[0],
        dq=speed,
        measured=recording.position[0] - period * speed,
        velocity=speed,
    )
    log = simulate_rigid_plant(valued, plant, order).log
    if log.end == "away":
        seconds = recording.time[len(log.q) - 1] - recording.time[0]
        text = (
            f"the simulated robot left its reference after {seconds:.3g} s: the gains are not those of "
            "the controller, or the initial parameters are far off"
        )
        raise SolverError(Notice(code="solver.runaway", text=text, file=recording.source))
    return Signals(
        time=recording.time,
        q=log.q,
        dq=log.dq,
        ddq=differentiate(log.dq, period),
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
