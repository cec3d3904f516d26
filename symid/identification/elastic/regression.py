"""From recordings of both encoders to equations: filtered states, filtered rows, energy rows, kept signs.

With F(s) = lambda / (s + lambda), x~ = x - x(0), p = Yp beta and dL/dq = YL beta (Slotine and Li 1989):

    link         {lambda (Yp~ - F[Yp~]) - F[YL]} beta = F[tau_J]
    motor        IA lambda (dtheta~ - F[dtheta~]) + F[Yf] f + F[tau_J] = F[tau]
    elimination  their sum: tau_J cancels, whatever the spring is
    energy       sum_i int tau_i dtheta_i - sum_i int tau_Ji dphi_i
                     = Delta h_link beta + sum_i IA_i Delta(dtheta_i^2) / 2 + int dtheta' Yf f dt

Effects of drives and gears (`DriveEffect`) are taken off the signals first. `ElasticProblem` has the
equations of all recordings, built once, and the springs of all joints given joint torques.

Supported: several recordings with sample periods of their own; thresholds and knees on grids, moved to where
they fit best, or given; torques held between samples, sampled smooth signals; joints at rest (put at their
mean position); friction that is linear in its parameters; equations that do not identify all parameters
(shortest solution); friction of the load tau_J, measured behind the gears or computed from the links' motion.
Not supported: one encoder only; delays between the channels (align the recording first); friction on the
link side that is not viscous; full physical consistency of the links.
"""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import scipy
from numpy.typing import NDArray

from symid.arrays import FloatArray, FrozenArrays, compute_triangle, freeze
from symid.codegen import Library, ModelCard, ParameterCard, run_compiled_branch
from symid.errors import LogError, Notice, UsageError
from symid.identification import regression
from symid.identification.elastic.options import RATE, ElasticOptions, check_grids
from symid.identification.hysteresis import (
    SpringData,
    SpringWeights,
    build_elasticity,
    build_knee_grid,
    filter_smooth,
    fit_spring,
    refine_spring,
)
from symid.identification.judge import POLICY, numerics
from symid.joint_models import (
    Elasticity,
    compute_hysteresis_torque,
    compute_spring_work,
    compute_stop_basis,
    compute_work_columns,
    is_braking,
    run_element,
)
from symid.logs import Recording, describe_uneven, differentiate_smooth, low_pass, shift_channel
from symid.robot import Processing, suggest_names

BAND = 20.0
"""Hz, in which arms move, and in which white noise of the torque outweighs that of encoders."""
_ABOVE = 1.25
"""Of the cut-off of the states to that band's edge: what rows tell of must pass nearly unchanged, with most
of the kinks that friction and springs make of it."""
_EDGE = 4.0
"""Periods of the cut-off frequency that the ends of a filtered signal are not trusted for."""
MOVES = 0.1
"""Of the largest speed or range: joints and recordings with less count as held."""
APART = 0.3
"""Of a motor's RMS speed, that of the torsion where motor and link move apart."""
_MEMORY = 5.0
"""Time constants of the filter of rows."""


def pass_band(values: FloatArray, period: float, cutoff: float) -> FloatArray:
    """Return `values` (N, ...) behind the low-pass of all signals, zero-phase; `cutoff` in Hz."""
    return low_pass(values, period=period, cutoff=cutoff, order=Processing().filter_order)


def count_edge(period: float, cutoff: float) -> int:
    """Return how many samples at either end such a filter makes uncertain; one without a filter."""
    return int(np.ceil(_EDGE / (cutoff * period))) if cutoff else 1


def choose_edge(period: float, band: float) -> float:
    """Return the edge in Hz of what rows tell of: above the `band` of the motion, as far as samples reach."""
    return min(max(BAND, band), POLICY.row_band / period)


def measure_motion_band(recordings: Sequence[Recording]) -> float:
    """Return the band in Hz that motors and links move in: the widest of all recordings and sides.

    Joints and recordings that are held beside the liveliest one do not count.
    """
    sides = [(part, side) for part in recordings for side in get_encoder_positions(part)]
    speeds = [np.sqrt(np.mean(np.diff(side, axis=0) ** 2, axis=0)) / part.period for part, side in sides]
    moves = [speed > MOVES * np.max(speeds) for speed in speeds]
    found = (
        regression.measure_scoring_band(
            [Recording(time=part.time, position=side[:, own], torque=side[:, own])]
        )
        for (part, side), own in zip(sides, moves, strict=True)
        if np.any(own)
    )
    return max(found, default=0.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElasticSignals(FrozenArrays):
    """States and torques at full rate; the end is cut, the beginning is kept for the memory of plays.

    Args:
        time: (N,) s; q, dq, theta, dtheta, tau: (N, n) SI.
        period: s.
        settled: first sample of rows; plays run from sample 0.
        hold: "zero" where tau[k] acts over [t_k, t_k+1], "first" where it is a sampled smooth signal.
        cutoff: of the low-pass in Hz, 0 for none.
        load: (N, n) N m or N that the links take; temperature: (N, n) degC; None where not known.
        drag: (N, n) N m or N, friction of the links' bearings; error: (N, n) rad or m, of the gears; None for
            none.
    """

    time: FloatArray
    q: FloatArray
    dq: FloatArray
    theta: FloatArray
    dtheta: FloatArray
    tau: FloatArray
    period: float
    settled: int
    hold: str
    cutoff: float = 0.0
    load: FloatArray | None = None
    temperature: FloatArray | None = None
    drag: FloatArray | None = None
    error: FloatArray | None = None

    @property
    def phi(self) -> FloatArray:
        """Return the torsions (N, n): theta - q, and what the gear adds."""
        torsion = self.theta - self.q
        return np.asarray(torsion if self.error is None else torsion + self.error)

    @property
    def link_drag(self) -> FloatArray:
        """Return the friction (N, n) of the links' bearings, N m or N."""
        return np.zeros_like(self.dq) if self.drag is None else self.drag

    @property
    def centred_torque(self) -> FloatArray:
        """Return the torque (N, n) about each sample."""
        return center_held(self.tau) if self.hold == "zero" else self.tau

    @property
    def step_torque(self) -> FloatArray:
        """Return the mean torque (N - 1, n) over each step between samples."""
        return self.tau[:-1] if self.hold == "zero" else average_steps(self.tau)


def mark_sliding(signals: ElasticSignals, width: float, limits: FloatArray) -> NDArray[np.bool_]:
    """Return where (N, n) a motor surely slides: faster than `limits` (n,), rad/s or m/s.

    Within `width` s about a sample, such as what a low-pass makes of it.
    """
    # Zero where the motor turns back between two samples.
    speeds = np.abs(signals.dtheta)
    speeds[1:][signals.dtheta[1:] * signals.dtheta[:-1] < 0.0] = 0.0
    count = 1 + 2 * max(1, round(0.5 * width / signals.period))
    return np.asarray(scipy.ndimage.minimum_filter1d(speeds, count, axis=0) > limits)


def average_steps(values: FloatArray) -> FloatArray:
    """Return the means (N - 1, ...) over the steps between samples (N, ...)."""
    return (values[1:] + values[:-1]) / 2.0


def center_held(tau: FloatArray) -> FloatArray:
    """Return the torque (N, n) about each sample of one that is held: the mean of those that meet there."""
    return np.vstack([tau[:1], average_steps(tau)])


WAVES = ("torque-ripple", "kinematic-error", "link-eccentricity")
"""Effects that are waves over a position."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveEffect:
    """One effect.

    Args:
        kind: "torque-lag", "link-friction", "torque-ripple", "kinematic-error", "link-eccentricity" or
            "torsion-offset".
        joint: its place, from 0; -1 for all.
        values: lag in s; or d; or a_N, b_N in N m or N, of an error in rad or m; or the offset in rad or m.
        deviations: of these.
        order: N of a ripple or an error, 1/rad or 1/m.
    """

    kind: str
    joint: int = -1
    values: tuple[float, ...] = ()
    deviations: tuple[float, ...] = ()
    order: float = 0.0


def _add_waves(theta: FloatArray, effects: Sequence[DriveEffect], kind: str) -> FloatArray:
    """Return the sums (N, n) of waves of a kind over positions (N, n)."""
    waves = np.zeros_like(theta)
    for effect in effects:
        if effect.kind == kind:
            angle = effect.order * theta[:, effect.joint]
            waves[:, effect.joint] += effect.values[0] * np.cos(angle) + effect.values[1] * np.sin(angle)
    return waves


def prepare_elastic_signals(
    recording: Recording, options: ElasticOptions, effects: Sequence[DriveEffect] = ()
) -> ElasticSignals:
    """Return states and torques of `recording`, filtered alike, differentiated, the end cut.

    Where velocities from raw differences are exact enough, nothing is filtered and tau[k] is the torque over
    [t_k, t_k+1]. Otherwise all signals pass the same zero-phase low-pass, and tau[k] is the mean of the two
    torques that meet at t_k: a torque that is held acts half a period later than its sample says. `effects`
    are taken off.

    Raises:
        LogError: the recording lacks one of the encoders, is too short or unevenly sampled.
        UsageError: thresholds or knees are given for another number of joints.
    """
    motor, link = get_encoder_positions(recording)
    # Encoders that are not round.
    link = link - _add_waves(link, effects, "link-eccentricity")
    sides = [replace(recording, position=side, motor_position=None) for side in (motor, link)]
    resting = sorted(set.intersection(*(set(regression.list_resting_joints(side)) for side in sides)))
    if resting:
        motor, link = motor.copy(), link.copy()
        for side in (motor, link):
            side[:, resting] = side[:, resting].mean(axis=0)
    check_grids(options, recording.torque.shape[1])
    uneven = describe_uneven(recording.time, file=recording.source)
    if uneven is not None:
        raise LogError(uneven)
    period = recording.period
    cutoff = choose_cutoff(recording) if options.cutoff is None else options.cutoff
    edge = count_edge(period, cutoff)
    least = 4 * edge + 17
    if len(recording.time) < least:
        text = f"the log has {len(recording.time)} samples; the filter and the cut ends need at least {least}"
        raise LogError(Notice(code="log.too-short", text=text, file=recording.source))
    tau, load, warm = recording.torque, recording.load, recording.temperature
    values = {(effect.kind, effect.joint): effect.values[0] for effect in effects}
    if cutoff or effects:
        # As it acts: without a lag that was found it is held from sample to sample.
        lag, time = values.get(("torque-lag", -1)), np.arange(len(tau), dtype=np.float64) * period
        tau = center_held(tau) if lag is None else shift_channel(time, tau, -lag)
        tau = tau - _add_waves(motor, effects, "torque-ripple")
    # What is to be added to theta - q for the torsion of the springs.
    error, joints = _add_waves(motor, effects, "kinematic-error"), range(motor.shape[1])
    for joint in joints:
        # Encoders that were brought into line have no offset left.
        offset, gap = values.get(("torsion-offset", joint)), np.median(motor[:, joint] - link[:, joint])
        error[:, joint] -= offset if offset and gap / offset > 0.5 else 0.0
    if cutoff:
        clean = partial(pass_band, period=period, cutoff=cutoff)
        motor, link, tau, error = map(clean, (motor, link, tau, error))
        load = None if load is None else clean(load)
    kept = slice(0, len(recording.time) - edge)
    # Rows begin where plays are settled and filters have forgotten their start.
    phi, starts = (motor - link + error)[kept], [int(np.ceil(_MEMORY / (options.filter_rate * period)))]
    for joint, torsion in enumerate(phi.T):
        largest = options.stops / (options.stops + 1.0) * float(np.abs(torsion).max())
        if options.thresholds is not None:
            largest = max(options.thresholds[joint], default=0.0)
        starts.append(locate_settled(torsion, largest))
    dq = differentiate_smooth(link, period)[kept]
    return ElasticSignals(
        time=recording.time[kept],
        q=link[kept],
        dq=dq,
        theta=motor[kept],
        dtheta=differentiate_smooth(motor, period)[kept],
        tau=tau[kept],
        period=period,
        # One part of a recording may pass at most.
        settled=max(edge, min(max(starts), max(starts[0], len(phi) // POLICY.parts))),
        hold="first" if cutoff or effects else "zero",
        cutoff=cutoff,
        drag=dq * [values.get(("link-friction", joint), 0.0) for joint in joints] if effects else None,
        error=error[kept] if effects else None,
        load=None if load is None else load[kept],
        temperature=None if warm is None else warm[kept],
    )


def fill_motor_loads(library: Library, logs: Sequence[Recording], beta: FloatArray) -> tuple[Recording, ...]:
    """Return logs with torques tau_J of links (p,), where friction reads them and none were measured."""
    measured = regression.list_measured_joints(logs)
    if "load" not in library.card.friction_inputs or all(measured):
        return tuple(logs)
    found = []
    for recording in logs:
        period = recording.period
        q = pass_band(get_encoder_positions(recording)[1], period, choose_edge(period, 0.0))
        dq = differentiate_smooth(q, period)
        (load,) = library.evaluate("inverse_dynamics", q, dq, differentiate_smooth(dq, period), beta)
        found.append(replace(recording, load=regression.fill_load(recording.load, load, measured)))
    return tuple(found)


def get_encoder_positions(recording: Recording) -> tuple[FloatArray, FloatArray]:
    """Return motor and link positions (N, n); raise LogError where one of them is missing."""
    if recording.motor_position is not None:
        return recording.motor_position, recording.position
    if recording.link_position is not None:
        return recording.position, recording.link_position
    text = "torsion is the difference of motor and link positions, and this log has only one of them; name "
    text += "the other column in [log.motor_position] or [log.link_position], or leave --method out to "
    text += "identify the motor side alone"
    raise LogError(Notice(code="elastic.one-encoder", text=text, file=recording.source))


def join_rigid_joints(
    card: ModelCard, recordings: Sequence[Recording]
) -> tuple[tuple[Recording, ...], tuple[Notice, ...]]:
    """Return recordings in which rigid joints have one position, and notices where they had two.

    It is that of [log.position], or the other one if that never changes in any recording.

    Raises:
        LogError: a recording has one encoder a joint only.
    """
    rigid = ~np.array(card.yielding)
    # A robot without any elastic joint may have encoders on both sides of all.
    if not np.any(rigid) or np.all(rigid):
        return tuple(recordings), ()
    # The position of [log.position], and the other one.
    pairs = [get_encoder_positions(log)[:: -1 if log.motor_position is not None else 1] for log in recordings]
    moves = [np.any([np.ptp(pair[side], axis=0) > 0.0 for pair in pairs], axis=0) for side in (0, 1)]
    joined, notices = [], []
    for recording, (first, second) in zip(recordings, pairs, strict=True):
        gap = first - second
        limit = POLICY.printed * np.hypot(measure_noise(first), measure_noise(second))
        apart, moving = np.abs(np.mean(gap, axis=0)), np.std(gap, axis=0)
        for joint in np.flatnonzero(rigid & moves[0] & moves[1] & (np.hypot(apart, moving) > limit)):
            name, unit = card.joints[joint].name, card.joints[joint].position_unit
            text = f"joint {name!r} is rigid, and its two positions differ, by {apart[joint]:.2g} {unit} in "
            text += f"the mean and by {moving[joint]:.2g} {unit} about it; that of [log.position] was taken. "
            text += "If the zero of the other is right, name that one; if they move apart by torsion, give "
            text += "the joint [joint.elasticity]"
            notices.append(Notice(code="log.rigid-joint", text=text, file=recording.source))
        taken = np.where(moves[0], first, second)
        one, other = (np.where(rigid, taken, side) for side in (first, second))
        lone = recording.motor_position is None
        link, motor = (other, None) if lone else (recording.link_position, other)
        joined.append(replace(recording, position=one, link_position=link, motor_position=motor))
    return tuple(joined), tuple(notices)


def measure_noise(position: FloatArray) -> FloatArray:
    """Return the noise (n,) of encoders from third differences d of (N, n): sigma = |d|_rms / sqrt(20)."""
    return np.asarray(np.sqrt(np.mean(np.diff(position, n=3, axis=0) ** 2, axis=0) / 20.0))


def choose_cutoff(recording: Recording) -> float:
    """Return the cut-off in Hz of the low-pass that the encoders' noise asks for; 0 for none.

    The noise of a velocity by central differences is sigma / (sqrt(2) T): less than `relevance`^2 of the
    speed does no harm. A joint at rest has none to compare with; the fastest joint gives the scale.
    """
    sides = get_encoder_positions(recording)
    speeds = [np.max(np.sqrt(np.mean(np.diff(side, axis=0) ** 2, axis=0))) for side in sides]
    noises = [np.max(measure_noise(side)) / np.sqrt(2.0) for side in sides]
    if np.all(np.array(noises) < POLICY.relevance**2 * np.maximum(speeds, numerics.TINY)):
        return 0.0
    edge = choose_edge(recording.period, measure_motion_band([recording]))
    return min(_ABOVE * edge, POLICY.row_band / recording.period)


def locate_settled(phi: FloatArray, threshold: float) -> int:
    """Return the first sample at which the range of `phi` (N,) so far has reached 2 `threshold`, or its end.

    From there on the state of every play up to that radius is known, whatever it was before.
    """
    span = np.maximum.accumulate(phi) - np.minimum.accumulate(phi)
    goal = min(2.0 * threshold, 0.95 * float(span[-1]))
    return int(np.argmax(span >= goal))


def build_equations(
    library: Library,
    signals: ElasticSignals,
    differentiate_rows: Callable[[FloatArray], FloatArray],
    average_rows: Callable[[FloatArray], FloatArray],
    keep: slice = slice(None),
) -> FloatArray:
    """Return the columns [link beta | rotor | friction] (M, n, p + n + pf) of the sum of both equations.

    `differentiate_rows` makes of momenta and speeds (N, ...) the rows of their derivative, `average_rows` of
    torques (N, ...) their rows, in the same way; those of `keep` (M, ...) are taken.
    """
    (momentum,) = library.evaluate("momentum_regressor", signals.q, signals.dq)
    (lagrange,) = library.evaluate("lagrange_regressor", signals.q, signals.dq)
    columns = [
        differentiate_rows(momentum)[keep] - average_rows(lagrange)[keep],
        differentiate_rows(signals.dtheta)[keep][:, :, None] * np.eye(library.card.size),
    ]
    if library.card.friction:
        (friction,) = evaluate_motor_friction(library, signals)
        columns.append(average_rows(friction)[keep])
    return np.concatenate(columns, axis=2)


ROWS = 8.0
"""Rows a time constant of their filter: many times the band that it passes."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FilteredRows(FrozenArrays):
    """Motor and link equations of one recording, at the samples `keep`.

    Args:
        design: (M, n, p + n + pf), columns [link beta | rotor | friction].
        torque: (M, n), F[tau] in N m or N; drag: (M, n) of the links' bearings.
        keep: the samples of the signals that rows belong to.
        bases: p.
    """

    design: FloatArray
    torque: FloatArray
    drag: FloatArray
    keep: slice
    bases: int

    def compute_motor_side(self, chi: FloatArray) -> FloatArray:
        """Return F[tau_J] (M, n) by the motor equation with the dynamic parameters chi (p + n + pf,)."""
        return self.torque - self.design[:, :, self.bases :] @ chi[self.bases :]

    def compute_link_side(self, chi: FloatArray) -> FloatArray:
        """Return F[tau_J] (M, n) by the link equation."""
        return np.asarray(self.drag + self.design[:, :, : self.bases] @ chi[: self.bases])

    def pass_spring(self, spring: Elasticity, signals: ElasticSignals, joint: int, rate: float) -> FloatArray:
        """Return F[tau_J] (M,) of the spring of a joint."""
        torque = compute_joint_torque(spring, signals, joint)
        return filter_smooth(torque, rate, signals.period)[self.keep]


def filter_derivative(values: FloatArray, rate: float, period: float) -> FloatArray:
    """Return F[d values / dt] (N, ...), straight lines between samples: rate (x~ - F[x~]), x~ = x - x(0)."""
    moved = values - values[0]
    result: FloatArray = rate * (moved - filter_smooth(moved, rate, period))
    return result


def build_filtered_rows(library: Library, signals: ElasticSignals, rate: float) -> FilteredRows:
    """Return the filtered equations of one recording; rate is lambda in rad/s."""
    period = signals.period
    keep = slice(signals.settled, None, max(1, int(1.0 / (ROWS * rate * period) + 1e-9)))
    smooth = partial(filter_smooth, rate=rate, period=period)
    slope = partial(filter_derivative, rate=rate, period=period)
    return FilteredRows(
        design=build_equations(library, signals, slope, smooth, keep),
        torque=smooth(signals.tau, held=signals.hold == "zero")[keep],
        drag=smooth(signals.link_drag)[keep],
        keep=keep,
        bases=len(library.card.beta),
    )


def compute_joint_torque(spring: Elasticity, signals: ElasticSignals, joint: int) -> FloatArray:
    """Return the torque (N,) of a spring along the torsion of a joint, its memory empty at the start."""
    torsion = signals.phi[:, joint]
    if spring.is_plain:
        return compute_hysteresis_torque(spring, torsion, (signals.dtheta - signals.dq)[:, joint])
    rate = differentiate_smooth(torsion, signals.period)
    return run_element(spring, torsion, signals.time, velocity=rate, runner=run_compiled_branch).output


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EnergyWindows(FrozenArrays):
    """Energy equations of one recording, one a window.

    Args:
        supplied: (m,) J, the work of the motors.
        design: (m, p + n + pf), columns [beta | rotor | friction].
        ends: (m + 1,) samples of the signals at which windows begin and end.
    """

    supplied: FloatArray
    design: FloatArray
    ends: slice

    def compute_work(self, elasticity: Sequence[Elasticity], signals: ElasticSignals) -> FloatArray:
        """Return the work int tau_J dphi of all springs in every window (m,), J."""
        total = np.zeros(len(self.supplied))
        for joint, spring in enumerate(elasticity):
            torsion = signals.phi[:, joint]
            if spring.is_plain and not spring.damping:
                work = compute_spring_work(spring, torsion)
            else:
                steps = average_steps(compute_joint_torque(spring, signals, joint)) * np.diff(torsion)
                work = np.concatenate([[0.0], np.cumsum(steps)])
            total += np.diff(work[self.ends])
        return total


def build_energy_windows(library: Library, signals: ElasticSignals, length: float) -> EnergyWindows:
    """Return the energy equations in windows of `length` s; raise UsageError where none fits the log."""
    intervals, steps = round(length / signals.period), len(signals.time) - 1 - signals.settled
    count = steps // intervals if intervals else 0
    if count < 1:
        text = f"window of {length:g} s: must be at least one sample period ({signals.period:g} s) and at "
        text += f"most the part of the recording that equations come from ({steps * signals.period:g} s)"
        raise UsageError(Notice(code="usage.window", text=text))
    ends = slice(signals.settled, signals.settled + count * intervals + 1, intervals)

    def add(steps: FloatArray) -> FloatArray:
        total = np.concatenate([np.zeros((1, *steps.shape[1:])), np.cumsum(steps, axis=0)])
        return np.diff(total[ends], axis=0)

    turn = np.diff(signals.theta, axis=0)
    kinetic, potential = library.evaluate("energy_regressor", signals.q[ends], signals.dq[ends])
    columns = [np.diff(kinetic + potential, axis=0), np.diff(signals.dtheta[ends] ** 2, axis=0) / 2.0]
    if library.card.friction:
        (friction,) = evaluate_motor_friction(library, signals)
        columns.append(add(np.einsum("ij,ijk->ik", turn, average_steps(friction))))
    # The work of a held torque is exact with the torque of the step's start.
    supplied = add(np.sum(signals.step_torque * turn, axis=1))
    if signals.drag is not None:
        supplied -= add(np.sum(average_steps(signals.drag) * np.diff(signals.q, axis=0), axis=1))
    return EnergyWindows(supplied=supplied, design=np.hstack(columns), ends=ends)


def evaluate_motor_friction(library: Library, signals: ElasticSignals) -> tuple[FloatArray, ...]:
    """Return the friction regressor (N, n, pf) at the motors."""
    states = {"q": signals.theta, "load": signals.load, "temperature": signals.temperature}
    given = library.card.gather_friction_inputs(signals.dtheta, **states)
    return library.evaluate("friction_regressor", *given)


def list_parameter_cards(card: ModelCard) -> tuple[ParameterCard, ...]:
    """Return the cards of chi; an elastic joint whose file states no rotor has one nevertheless.

    That of a rigid joint is a part of the base parameters, and its place in chi is known to be zero.
    """
    known, rotors = {entry.name: entry for entry in card.rotors}, []
    for joint, gives in zip(card.joints, card.yielding, strict=True):
        name = f"IA{joint.number}" if gives else f"IA{joint.number} (rigid)"
        unit = "kg" if joint.kind == "prismatic" else "kg m^2"
        plain = ParameterCard(name=name, expression=name, unit=unit, reason="", joint=joint.name)
        rotors.append(known.get(name, plain))
    return (*card.beta, *rotors, *card.friction)


def list_lower_bounds(card: ModelCard) -> FloatArray:
    """Return the least value (p + n + pf,) of every parameter: zero, or minus infinity.

    Zero bounds rotor inertias, and friction other than an offset.
    """
    free = [-np.inf] * len(card.beta)
    friction = [0.0 if is_braking(entry.name) else -np.inf for entry in card.friction]
    return np.array(free + [0.0] * card.size + friction)


def read_known(card: ModelCard, known: Mapping[str, float]) -> FloatArray:
    """Return what is known of chi (p + n + pf,), NaN where nothing is; raise UsageError for other names."""
    names = [entry.name for entry in list_parameter_cards(card)]
    values = np.array([known.get(name, np.nan) for name in names])
    rigid = mark_rigid_rotors(card)
    allowed = list(itertools.compress(names, ~rigid))
    mistakes = [
        f"known {name!r} is no parameter of {card.robot!r}{suggest_names(name, allowed, before='; ')}"
        for name in known
        if name not in allowed
    ]
    below = np.flatnonzero(values < list_lower_bounds(card))
    mistakes += [f"known {names[place]} {values[place]:g}: must not be negative" for place in below]
    UsageError.refuse(mistakes, code="usage.elastic-option")
    return np.where(rigid, 0.0, values)


def mark_rigid_rotors(card: ModelCard) -> NDArray[np.bool_]:
    """Return which of chi (p + n + pf,) are rotors of rigid joints, which turn with their links."""
    return np.pad(~np.array(card.yielding), (len(card.beta), len(card.friction)))


def solve_with_signs(
    card: ModelCard, matrix: FloatArray, right: FloatArray, known: FloatArray | None = None
) -> FloatArray:
    """Return argmin |matrix x - right| (p,), x = [chi; stiffnesses], not below its bounds.

    By QR with columns of the matrix (..., p) scaled to length one; the bounded problem is solved only where a
    bound is broken. Columns and directions without effect (`RankRule`) get zero. Of x, `known` (q,) are the
    first q, NaN where they are to be found.
    """
    count = matrix.shape[-1]
    matrix, right = matrix.reshape(-1, count), right.reshape(-1)
    if known is not None and not np.all(np.isnan(known)):
        given = np.pad(known, (0, count - len(known)), constant_values=np.nan)
        free, values = np.isnan(given), np.nan_to_num(given)
        found = solve_with_signs(card, np.where(free, matrix, 0.0), right - matrix @ values)
        return np.asarray(np.where(free, found, values))
    lengths = np.linalg.norm(matrix, axis=0)
    rule = regression.RankRule()
    alive: NDArray[np.bool_] = lengths > rule.zero * max(float(lengths.max(initial=0.0)), numerics.TINY)
    scales = np.where(alive, lengths, 1.0)
    triangle = compute_triangle(np.column_stack([np.where(alive, matrix, 0.0) / scales, right]))
    left, values = triangle[:, :count], triangle[:, count]
    answer = np.linalg.lstsq(left, values, rcond=rule.singular)
    # What has no effect is zero, not what rounding makes of it: its sign would let bounds act.
    solution: FloatArray = np.where(alive, answer[0] / scales, 0.0)
    least = list_lower_bounds(card)
    low = np.pad(least, (0, count - len(least)))
    if np.all(solution >= low):
        return solution
    if answer[2] < count:
        # Of the many solutions the bounded problem must take a short one too; this hardly weighs elsewhere.
        left = np.vstack([left, rule.singular * answer[3][0] * np.eye(count)])
        values = np.concatenate([values, np.zeros(count)])
    bounded = scipy.optimize.lsq_linear(left, values, bounds=(low * scales, np.inf), method="bvls")
    return np.where(alive, bounded.x / scales, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElasticProblem:
    """The equations of all recordings.

    Args:
        signals, energy, filtered: one entry a recording.
        springs: stop basis of every joint.
        supplied: (m,) J; design: (m, p + n + pf), the energy rows of all recordings.
        limits: (n,) rad/s or m/s, at and below which motors are not trusted to slide; 0 for none.
        known: (p + n + pf,) of the dynamic parameters, NaN where they are to be found.
    """

    library: Library
    options: ElasticOptions
    signals: tuple[ElasticSignals, ...]
    energy: tuple[EnergyWindows, ...]
    filtered: tuple[FilteredRows, ...]
    springs: tuple[SpringData, ...]
    supplied: FloatArray
    design: FloatArray
    limits: FloatArray
    known: FloatArray

    @property
    def sizes(self) -> tuple[int, int]:
        """Return the numbers of base parameters and joints."""
        return len(self.library.card.beta), self.library.card.size

    @property
    def gives(self) -> tuple[bool, ...]:
        """Return which joints are elastic; the others are rigid, and what passes them is eliminated."""
        return self.library.card.yielding

    def stack_filtered(self, numbers: Sequence[int] | None = None) -> tuple[FloatArray, FloatArray]:
        """Return design (M, n, p + n + pf) and torque (M, n) of the given recordings, of all by default.

        They are the sum of motor and link equations, in which the joint torques cancel.
        """
        rows = self.filtered if numbers is None else [self.filtered[number] for number in numbers]
        torque = np.concatenate([part.torque - part.drag for part in rows])
        return np.concatenate([part.design for part in rows]), torque

    def compute_motor_side(self, chi: FloatArray) -> FloatArray:
        """Return F[tau_J] (M, n) by the motor equation with the dynamic parameters chi (p + n + pf,)."""
        return np.concatenate([part.compute_motor_side(chi) for part in self.filtered])

    def compute_link_side(self, chi: FloatArray) -> FloatArray:
        """Return F[tau_J] (M, n) by the link equation."""
        return np.concatenate([part.compute_link_side(chi) for part in self.filtered])

    @property
    def slides(self) -> NDArray[np.bool_]:
        """Return at which filtered rows (M, n) a motor slides, for as long as the filter remembers."""
        if not np.any(self.limits):
            return np.ones((sum(len(rows.torque) for rows in self.filtered), self.sizes[1]), dtype=bool)
        width = 2.0 * _MEMORY / self.options.filter_rate
        pairs = zip(self.signals, self.filtered, strict=True)
        return np.concatenate([mark_sliding(part, width, self.limits)[rows.keep] for part, rows in pairs])

    def compute_work(self, springs: Sequence[Elasticity]) -> FloatArray:
        """Return the work of all springs in the windows of the energy rows (m,), J."""
        pairs = zip(self.signals, self.energy, strict=True)
        return np.concatenate([rows.compute_work(springs, part) for part, rows in pairs])

    def compute_stop_work(self, thresholds: Sequence[FloatArray]) -> FloatArray:
        """Return the work of springs and stops per unit stiffness in every window (m, sum (m_i + 1)), J."""
        columns = []
        for part, rows in zip(self.signals, self.energy, strict=True):
            pairs = zip(part.phi.T, thresholds, strict=True)
            works = [np.diff(compute_work_columns(*pair)[rows.ends], axis=0) for pair in pairs]
            columns.append(np.hstack(works))
        return np.vstack(columns)

    def fit_springs(self, torque: FloatArray) -> tuple[Elasticity, ...]:
        """Return the springs, one a joint, that explain F[tau_J] best: (M, n) in N m at the filtered rows.

        In place of that of a rigid joint, whose torque is that of the link, stands one without stiffness.
        """
        pairs = zip(self.springs, torque.T, self.gives, strict=True)
        return tuple(
            self.fit_spring(joint, data, target) if gives else Elasticity(stiffness=0.0)
            for joint, (data, target, gives) in enumerate(pairs)
        )

    def fit_spring(self, joint: int, data: SpringData, target: FloatArray) -> Elasticity:
        """Return the spring of one joint that explains F[tau_J] (M,) best, along the torsions of `data`."""
        weights = fit_spring(data, target, self.start_spring(joint, data, target))
        moved = refine_spring(data, target, weights) if self.options.moves_stops else weights
        return build_elasticity(moved)

    def start_spring(self, joint: int, data: SpringData, target: FloatArray) -> SpringWeights:
        """Return the best spring without knees for F[tau_J] (M,), with knees that are to be fitted next."""
        weights, given = data.fit_stops(target), self.options.knee_torques
        if given is None:
            knees = build_knee_grid([part @ weights.stiffness for part in data.basis], self.options.knees)
        else:
            order = sorted(given[joint], key=lambda torque: (torque > 0, abs(torque)))
            knees = np.array(order, dtype=np.float64)
        return replace(weights, knees=knees, slopes=np.ones(len(knees)))

    def average_sides(self, chi: FloatArray) -> FloatArray:
        """Return F[tau_J] (M, n), the mean of motor and link side, each weighted by 1 / its variance.

        The variances are those about a spring on the grid, so that a side with more noise counts less; chi
        (p + n + pf,) are the dynamic parameters. A motor near rest tells of friction that is not known.
        """
        joined = self.compute_link_side(chi)
        motor = np.where(self.slides | (self.limits == 0.0), self.compute_motor_side(chi), joined)
        for joint in np.flatnonzero(self.gives).tolist():
            data, sides = self.springs[joint], np.stack([motor[:, joint], joined[:, joint]])
            spring = fit_spring(data, np.mean(sides, axis=0), self.start_spring(joint, data, sides[1]))
            left = np.mean((sides - data.compute_torque(spring)) ** 2, axis=1)
            inverse = 1.0 / np.maximum(left, numerics.TINY)
            joined[:, joint] = inverse @ sides / np.sum(inverse)
        return joined


def build_elastic_problem(
    library: Library,
    signals: Sequence[ElasticSignals],
    options: ElasticOptions,
    limits: FloatArray | None = None,
) -> ElasticProblem:
    """Return energy rows, filtered rows and stop bases; raise UsageError where windows do not fit."""
    energy = tuple(build_energy_windows(library, part, options.window) for part in signals)
    filtered = tuple(build_filtered_rows(library, part, options.filter_rate) for part in signals)
    springs = tuple(
        build_spring_data(options, joint, [part.phi[:, joint] for part in signals], signals, filtered)
        for joint in range(library.card.size)
    )
    return ElasticProblem(
        library=library,
        options=options,
        signals=tuple(signals),
        energy=energy,
        filtered=filtered,
        springs=springs,
        supplied=freeze(np.concatenate([rows.supplied for rows in energy])),
        design=freeze(np.vstack([rows.design for rows in energy])),
        limits=freeze(np.zeros(library.card.size) if limits is None else limits),
        known=freeze(read_known(library.card, options.known)),
    )


def build_spring_data(
    options: ElasticOptions,
    joint: int,
    torsions: Sequence[FloatArray],
    signals: Sequence[ElasticSignals],
    rows: Sequence[FilteredRows],
) -> SpringData:
    """Return the stop basis of a joint along its torsions (N,), one a recording, for the rows of each.

    Thresholds are those given, or r_i = i / (m + 1) max |phi|, i = 1 .. m (Kuhnen 2003).
    """
    if not any(np.any(phi) for phi in torsions):
        # A rigid joint, whatever thresholds it was given.
        grid = freeze(np.zeros(0))
    elif options.thresholds is not None:
        grid = freeze(options.thresholds[joint])
    else:
        largest = max(float(np.abs(phi).max()) for phi in torsions)
        grid = freeze(np.arange(1, options.stops + 1) / (options.stops + 1.0) * largest)
    periods, keeps = tuple(part.period for part in signals), tuple(part.keep for part in rows)
    return SpringData.build(torsions, periods, keeps, options.filter_rate).rebuild(grid)


_MANY = 12
"""Stops, of a spring that is none in particular."""


def build_spring_basis(torsion: FloatArray, kept: slice, period: float | None = None) -> FloatArray:
    """Return columns of a spring of many stops at the samples `kept`, the last two its cube and a constant.

    With a `period` in s, columns as of springs with knees, with two sides and with dampers stand behind them.
    """
    low, high = float(torsion.min()), float(torsion.max())
    grid = 0.5 * (high - low) * np.arange(1, _MANY + 1) / (_MANY + 1)
    # Only plays and the damper need what lies between; columns are stored one after the other.
    stops, own = compute_stop_basis(torsion, grid, kept).T, torsion[kept]
    columns = [stops, own**3, np.ones_like(own)]
    if period is not None:
        part = own / max(-low, high, numerics.TINY)
        size = np.abs(part)
        columns += [stops * size, stops * part**2, part * size, part**5, size]
        columns.append(filter_smooth(torsion, RATE, period)[kept])
    return np.vstack(columns).T
