"""Channels of a log before any identification: joints alone, single mistakes, the delay of the torque.

Library, even recording -> `QuickFit` -> `JointSigns`, `TorqueDelay`, and notices.

The torque of each joint is fitted by its own rows; inertia and friction as shares of the torque, with the
deviation of leaving out one block:

    inertia share   mean(M_jj ddq^2) / (rms(ddq) rms(tau))
    friction share  mean(tau_f dq) / (rms(dq) rms(tau))

Where the whole robot does not fit the log, single mistakes are undone one after the other (`causes`), and one
is named where that helps. Delay: a torque channel that lags by d holds tau(t - d), so with rows A and the
fitted torque s = A x, linear in x and d, iterated,

    tau = A x - d ds/dt

Supported: delays of either sign up to 50 ms. Not supported: elastic joints; two mistakes at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.errors import IdentifiabilityError, Notice
from symid.identification.diagnostics.causes import LikelyCause, find_cause
from symid.identification.diagnostics.fit_warnings import evaluate_inertia_columns
from symid.identification.diagnostics.quick_model import build_quick_logs, fit_quick, mask_impossible
from symid.identification.diagnostics.stretches import measure_scoring_band
from symid.identification.regression import (
    choose_filters,
    compute_payload_torque,
    evaluate_columns,
    hold_resting_joints,
    list_resting_joints,
    solve_scaled,
)
from symid.joint_models import REFERENCE_TEMPERATURE
from symid.logs import Recording, decimate, prepare_signals, shift_channel
from symid.robot import JointKind, Processing, Robot

_BLOCKS = 20
_BLOCK = 200
"""Samples of a block: with twenty blocks some thousand samples, enough for a quick fit."""
_SMALL = 1e-7
_ROUNDING = 1e-13
"""Length of a column relative to the longest, up to which it is zero but for rounding."""
_SLOW = 0.02
"""Of the root mean square of a joint's speed: below, dry friction may hold it."""
_NEAR = 3
"""Samples on either side of a reversal, where decimation has smoothed the friction."""
_MOST = 0.8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class QuickFit:
    """Equations of a log at blocks of consecutive samples.

    Args:
        q, dq, ddq, tau: (N, n) decimated states and torques of the blocks, one after the other.
        rows: (N, n, p) regressor, friction included.
        keep: (N, n) 1, or 0 where a joint with friction hardly moves, whose torque is no function of speed.
        blocks: slices of the N samples, each of consecutive ones; period: of the samples in s.
        names: of the p parameters; `inertial` the number of those that are not friction.
        moving: joints that move in the log.
    """

    q: FloatArray
    dq: FloatArray
    ddq: FloatArray
    tau: FloatArray
    rows: FloatArray
    keep: FloatArray
    blocks: tuple[slice, ...]
    names: tuple[str, ...]
    inertial: int
    moving: tuple[int, ...]
    period: float
    recording: Recording
    processing: Processing

    def stack_rows(
        self, weights: FloatArray, tau: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return matrix, values (of `tau` if given) and `keep` of all moving joints, with weights (k,)."""
        joints = list(self.moving)
        matrix = (self.rows[:, joints] * weights[:, None]).reshape(-1, self.rows.shape[2])
        torque = (self.tau if tau is None else tau)[:, joints]
        return matrix, (torque * weights).ravel(), self.keep[:, joints].ravel()


def build_quick_fit(library: Library, recording: Recording, processing: Processing) -> QuickFit:
    """Return the equations of a recording; cut-off and decimation that are not stated are chosen.

    Raises:
        IdentifiabilityError: no joint moves.
        LogError: the recording is uneven or too short for the settings.
    """
    processing = choose_filters(replace(processing, automatic=True), [recording]).processing
    resting = list_resting_joints(recording)
    moving = tuple(joint for joint in range(library.card.size) if joint not in resting)
    if not moving:
        text = (
            "no joint moves in this log beyond the noise of its encoder: record a log in which every joint "
            "accelerates and turns both ways"
        )
        raise IdentifiabilityError(Notice(code="identify.standstill", text=text, file=recording.source))
    signals = hold_resting_joints(prepare_signals(recording, processing), resting)
    load = compute_payload_torque(library, signals, recording)
    if load is not None:
        torque = recording.torque.copy()
        torque[processing.drop_first : processing.drop_first + len(load)] -= load
        recording, signals = replace(recording, torque=torque), replace(signals, tau=signals.tau - load)
    columns = np.hstack([signals.q, signals.dq, signals.ddq, signals.tau])
    thin, blocks = _sample_blocks(columns, processing)
    q, dq, ddq, tau = (np.ascontiguousarray(part) for part in np.split(thin, 4, axis=1))
    card = library.card
    stated = np.array([processing.get_standstill(joint) for joint in range(card.size)])
    slow = np.maximum(stated, _SLOW * np.sqrt(np.mean(dq**2, axis=0)))
    braked = np.array([joint.friction != "none" for joint in card.joints])
    held = (np.abs(dq) < slow) & braked
    # A change of sign counts even where no sample falls on it.
    held[1:] |= (dq[1:] * dq[:-1] < 0.0) & braked
    near = held.copy()
    for step in range(1, _NEAR + 1):
        near[step:] |= held[:-step]
        near[:-step] |= held[step:]
    # A joint that is slow throughout would not be looked at.
    left_out = near & (np.mean(near, axis=0) < _MOST)
    return QuickFit(
        q=q,
        dq=dq,
        ddq=ddq,
        tau=tau,
        rows=evaluate_columns(library, q, dq, ddq, np.zeros_like(q), np.full_like(q, REFERENCE_TEMPERATURE)),
        keep=np.where(left_out, 0.0, 1.0),
        blocks=blocks,
        names=tuple(entry.name for entry in card.fitted),
        inertial=len(card.beta),
        moving=moving,
        period=signals.period * processing.decimation.factor,
        recording=recording,
        processing=processing,
    )


def _sample_blocks(values: FloatArray, processing: Processing) -> tuple[FloatArray, tuple[slice, ...]]:
    """Return decimated rows of `values` (N, k), all of them or pieces at even distances, and the pieces."""
    thin = decimate(np.column_stack([values, np.ones(len(values))]), processing.decimation)
    # A Chebyshev filter of even order passes a constant with its ripple: harmless where all columns of a
    # model pass it, not where states do.
    thin = thin[:, :-1] / thin[:, -1:]
    edges = np.linspace(0, len(thin), max(2, min(_BLOCKS, len(thin) // 10)) + 1).astype(int).tolist()
    pieces = [thin[low : min(high, low + _BLOCK)] for low, high in pairwise(edges)]
    bounds = np.cumsum([0, *map(len, pieces)]).tolist()
    return np.vstack(pieces), tuple(slice(low, high) for low, high in pairwise(bounds))


_CLEAR = 0.02
"""Of the torque: a share beyond this, and beyond its own deviations, is significant."""
_SIGN_SURE = 3.0
_GROUPS = 8
_HEAVIEST, _LIGHTEST = 2e4, 1e-4
"""kg at half the reach: no arm moves more, or so little."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JointSigns:
    """The fit of joint `joint` alone: shares of inertia and friction, with deviations; `mass`.

    `mass` is the mean inertia M_jj as a mass (kg) at half the robot's reach, or that of a slide itself.
    """

    joint: int
    inertia: float
    inertia_std: float
    friction: float
    friction_std: float
    mass: float


def estimate_signs(fit: QuickFit, library: Library, robot: Robot) -> tuple[JointSigns, ...]:
    """Return shares of inertia and friction of every joint that moves."""
    symbols = dict(robot.symbols)
    lengths = [
        float(np.linalg.norm([value.to_float(symbols) for value in joint.placement.translation]))
        for joint in robot.joints
    ]
    # Half of the distances between joints in m, which are a tenth of one at least.
    reach = 0.5 * max(0.1, sum(lengths))
    columns = list(evaluate_inertia_columns(library, fit.q))
    whole = np.arange(len(fit.q))
    subsets = [whole, *(np.setdiff1d(whole, group) for group in np.array_split(whole, _GROUPS))]
    found = []
    for joint in fit.moving:
        column = columns[joint][:, joint]
        values = np.array([_compute_shares(fit, joint, column, samples) for samples in subsets])
        stds = np.sqrt(_compute_variances(values[1:]))
        size = 1.0 if robot.axes[joint].kind is JointKind.PRISMATIC else reach**2
        found.append(
            JointSigns(
                joint=joint,
                inertia=float(values[0, 0]),
                inertia_std=float(stds[0]),
                friction=float(values[0, 1]),
                friction_std=float(stds[1]),
                mass=float(values[0, 2] / size),
            )
        )
    return tuple(found)


def _compute_shares(
    fit: QuickFit, joint: int, column: FloatArray, samples: NDArray[np.intp]
) -> tuple[float, float, float]:
    """Return the shares of inertia and friction at some samples, and the mean inertia."""
    samples = samples[fit.keep[samples, joint] > 0.0]
    rows, tau = fit.rows[samples, joint], fit.tau[samples, joint]
    dq, ddq = fit.dq[samples, joint], fit.ddq[samples, joint]
    lengths = np.linalg.norm(rows, axis=0)
    # A column of rounding alone would be scaled to the length of the others.
    solution = solve_scaled(np.where(lengths > _ROUNDING * lengths.max(), rows, 0.0), tau, rcond=_SMALL)
    inertia = column[samples] @ solution[: fit.inertial]
    braking = rows[:, fit.inertial :] @ solution[fit.inertial :]
    braking = braking - np.mean(braking)
    size = _compute_rms(tau) or 1.0
    acceleration = float(np.mean(inertia * ddq**2)) / ((_compute_rms(ddq) or 1.0) * size)
    work = float(np.mean(braking * dq)) / ((_compute_rms(dq) or 1.0) * size)
    return acceleration, work, float(np.mean(inertia))


def _compute_rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def describe_sizes(signs: tuple[JointSigns, ...], robot: Robot, file: str) -> tuple[Notice, ...]:
    """Return a notice where the torques correspond to masses that no robot has."""
    clear = [entry for entry in signs if entry.inertia > max(_CLEAR, _SIGN_SURE * entry.inertia_std)]
    odd = [entry for entry in clear if not _LIGHTEST < entry.mass < _HEAVIEST]
    if not odd:
        return ()
    worst = max(odd, key=lambda entry: abs(np.log(entry.mass)))
    guess = (
        "check for milliamperes, N mm or degrees: state the unit in [log.torque] and [log.position]"
        if worst.mass >= _HEAVIEST
        else 'check for the motor side (side = "motor"), and for kN m stated in place of N m'
    )
    text = (
        f"the torque of joint {robot.axes[worst.joint].name!r} corresponds to a moving mass of "
        f"{worst.mass:.2g} kg, which is not plausible; {guess}"
    )
    return (Notice(code="log.torque-size", text=text, file=file),)


_ALIKE = 0.9
"""Correlation from which the torque of a joint is that of the robot file's masses, at some scale."""
_SCALE = 3.0
"""Masses of a drawing are not wrong by this factor."""


def describe_scale(fit: QuickFit, library: Library, robot: Robot) -> tuple[Notice, ...]:
    """Return a notice where torques follow the masses of the robot file, all of them at another scale."""
    values = [entry.value for entry in library.card.beta]
    known = [value for value in values if value is not None]
    if len(known) < len(values) or not any(known):
        return ()
    model = fit.rows[:, :, : fit.inertial] @ np.array(known)
    scales: dict[int, float] = {}
    for joint in fit.moving:
        pair = np.column_stack([model[:, joint], fit.tau[:, joint]])
        braking = np.column_stack([fit.rows[:, joint, fit.inertial :], np.ones(len(pair))])
        # Friction and an offset have no mass.
        mine, torque = (pair - braking @ np.linalg.lstsq(braking, pair, rcond=_SMALL)[0]).T
        sizes = float(np.linalg.norm(mine)), float(np.linalg.norm(torque))
        if sizes[0] > _ROUNDING * np.abs(model).max() and float(mine @ torque) > _ALIKE * sizes[0] * sizes[1]:
            scales[joint] = sizes[1] / sizes[0]
    if not scales or not all(scale > _SCALE or scale < 1.0 / _SCALE for scale in scales.values()):
        return ()
    listed = ", ".join(f"{robot.axes[joint].name!r} {scale:.3g}" for joint, scale in scales.items())
    text = (
        f"the torques are in proportion to those that the masses of the robot file need, but of another size "
        f"({listed} times): they may be motor currents, percent, or of the motor side, or these masses are "
        "wrong; state unit and side in [log.torque], or give `symid new --log` --units torque=A"
    )
    return (Notice(code="log.effort-size", text=text, file=fit.recording.source),)


_ROUNDS = 6
_CONVERGED = 0.01
_LARGEST = 0.05
_DELAY_SURE = 5.0
_SMALLEST = 0.1
"""Of a sample period: a delay as small as this does no harm."""
_RCOND = 1e-10


@dataclass(frozen=True, slots=True, kw_only=True)
class TorqueDelay:
    """Delay of the torque behind the motion in s, its standard deviation; of each moving joint alone."""

    delay: float
    std: float
    joints: tuple[float, ...]
    joint_stds: tuple[float, ...]
    period: float

    @property
    def late(self) -> bool:
        """Return whether there is a significant delay, of a size that matters."""
        return _LARGEST > abs(self.delay) > max(_DELAY_SURE * self.std, _SMALLEST * self.period)


def estimate_torque_delay(fit: QuickFit) -> TorqueDelay:
    """Return the delay of the torques of `fit` behind its motion."""
    joints = list(fit.moving)
    size = np.linalg.norm(fit.tau[:, joints], axis=0)
    weights = 1.0 / np.where(size > 0.0, size, 1.0)
    matrix, values, keep = fit.stack_rows(weights)
    errors = keep * (values - matrix @ _solve_kept(matrix, values, keep))
    scatter = np.linalg.norm(errors.reshape(-1, len(joints)), axis=0) / weights
    weights = 1.0 / np.maximum(scatter, 1e-6 * size + 1e-300)
    delay, tau = 0.0, fit.tau
    for _ in range(_ROUNDS):
        values, replicates = _fit_delays(fit, tau, weights)
        stds = np.sqrt(_compute_variances(replicates))
        shares = 1.0 / np.maximum(stds, 1e-9) ** 2
        shares /= shares.sum()
        step = float(shares @ values)
        delay += step
        if abs(step) < _CONVERGED * fit.recording.period or abs(delay) > _LARGEST:
            break
        moved = shift_channel(fit.recording.time, fit.recording.torque, delay)
        signals = prepare_signals(replace(fit.recording, torque=moved), fit.processing)
        tau, _ = _sample_blocks(signals.tau, fit.processing)
    # Where joints disagree by more than their own deviations, these are too small (Birge 1932).
    excess = float(np.sum(((values - step) / np.maximum(stds, 1e-9)) ** 2)) / max(1, len(values) - 1)
    common = float(np.sqrt(_compute_variances(replicates @ shares[:, None])[0]))
    return TorqueDelay(
        delay=delay,
        std=common * max(1.0, excess) ** 0.5,
        joints=tuple(float(delay - step + value) for value in values),
        joint_stds=tuple(map(float, stds)),
        period=fit.recording.period,
    )


def _solve_kept(matrix: FloatArray, values: FloatArray, keep: FloatArray) -> FloatArray:
    """Return the solution of the rows of joints that move."""
    return solve_scaled(matrix * keep[:, None], values * keep, rcond=_SMALL)


def _fit_delays(fit: QuickFit, tau: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the delay of every moving joint (k,) in s, and those without each block (blocks, k)."""
    matrix, values, keep = fit.stack_rows(weights, tau)
    count = len(fit.moving)
    smooth = (matrix @ _solve_kept(matrix, values, keep)).reshape(-1, count)
    slopes = np.zeros((len(smooth), count, count))
    for block in fit.blocks:
        slope = np.gradient(smooth[block], fit.period, axis=0)
        slopes[block, range(count), range(count)] = -slope
    design = np.column_stack([matrix, slopes.reshape(-1, count), values]) * keep[:, None]
    lengths = np.linalg.norm(design, axis=0)
    scales = np.where(lengths > 0.0, 1.0 / np.where(lengths > 0.0, lengths, 1.0), 0.0)
    design *= scales
    parts = [design[block.start * count : block.stop * count] for block in fit.blocks]
    grams = np.array([part.T @ part for part in parts])
    back = scales[-count - 1 : -1] / scales[-1]
    whole = grams.sum(axis=0)
    replicates = np.array([_solve(whole - gram, count) for gram in grams])
    return _solve(whole, count) * back, replicates * back


def _solve(gram: FloatArray, count: int) -> FloatArray:
    solution = np.linalg.lstsq(gram[:-1, :-1], gram[:-1, -1], rcond=_RCOND)[0]
    return np.asarray(solution[-count:], dtype=np.float64)


def _compute_variances(replicates: FloatArray) -> FloatArray:
    spread = replicates - replicates.mean(axis=0)
    variances: FloatArray = (len(replicates) - 1) / len(replicates) * np.sum(spread**2, axis=0)
    return variances


def describe_delay(found: TorqueDelay, file: str) -> Notice:
    """Return a notice that torque and motion are not simultaneous."""
    side = "after" if found.delay > 0.0 else "before"
    text = (
        f"the torque is logged {1e3 * abs(found.delay):.3g} ms {side} the motion (standard deviation "
        f"{1e3 * found.std:.2g} ms, {abs(found.delay) / found.period:.3g} samples), which biases friction "
        "and inertia; shift one of the channels, or filter far below the inverse of the delay"
    )
    return Notice(code="log.torque-delay", text=text, file=file)


@dataclass(frozen=True, slots=True, kw_only=True)
class LogCheck:
    """The check of one log: signs of moving joints, the likeliest single mistake, delay of the torque."""

    source: str
    signs: tuple[JointSigns, ...]
    mistake: LikelyCause | None
    delay: TorqueDelay | None
    notices: tuple[Notice, ...]


_SUSPICIOUS = 30.0
"""Percent of held-out torque left unexplained, from which causes are looked for."""
_PROPORTIONAL = 1e-6
"""1 - |correlation| of two joints' speeds below which they move in proportion."""


def list_proportions(velocity: FloatArray, moving: Sequence[int]) -> tuple[tuple[int, int], ...]:
    """Return the pairs of `moving` joints whose velocities (T, n) are in proportion."""
    found = []
    turning = [joint for joint in moving if float(np.ptp(velocity[:, joint])) > 0.0]
    for first, second in combinations(turning, 2):
        pair = np.corrcoef(velocity[:, first], velocity[:, second])[0, 1]
        if 1.0 - abs(float(pair)) < _PROPORTIONAL:
            found.append((first, second))
    return tuple(found)


def describe_proportion(first: str, second: str, file: str = "") -> Notice:
    """Return a notice on two joints that move in proportion."""
    text = (
        f"joints {first!r} and {second!r} move in proportion throughout, so that their parameters "
        "cannot be separated: move each joint on its own as well"
    )
    return Notice(code="log.in-proportion", text=text, file=file)


def find_mistake(library: Library, recording: Recording, processing: Processing) -> LikelyCause | None:
    """Return the likeliest single mistake, None for none."""
    usual = choose_filters(replace(processing, automatic=True), [recording]).processing
    logs = build_quick_logs(library, [recording], usual, measure_scoring_band([recording]))
    before = fit_quick(logs)
    if before.percent <= _SUSPICIOUS and not mask_impossible(logs, before).any():
        return None
    # A log that fits badly has negative values by chance, too.
    found = find_cause(logs, before, cures=before.percent <= _SUSPICIOUS)
    return found if np.isfinite(found.percent) else None


def describe_mistake(found: LikelyCause, file: str) -> Notice:
    """Return a notice on a mistake."""
    return Notice(code=found.code, text=f"{found.cause}: undone, {found.effect}; {found.remedy}", file=file)


def check_channels(fit: QuickFit, library: Library, robot: Robot) -> LogCheck:
    """Return what is odd in the channels of the log behind `fit`."""
    file = fit.recording.source
    notices = tuple(
        describe_proportion(robot.axes[first].name, robot.axes[second].name, file)
        for first, second in list_proportions(fit.dq, fit.moving)
    )
    signs = estimate_signs(fit, library, robot)
    mistake = None if notices else find_mistake(library, fit.recording, fit.processing)
    if mistake is not None:
        notices += (describe_mistake(mistake, file),)
    notices += describe_sizes(signs, robot, file) if not notices else ()
    # Also beside others: a URDF without friction, whose efforts are currents.
    if not {"log.torque-size", "log.wrong-unit"} & {notice.code for notice in notices}:
        notices += describe_scale(fit, library, robot)
    delay: TorqueDelay | None = None
    if not notices:
        delay = estimate_torque_delay(fit)
        notices = (describe_delay(delay, file),) if delay.late else ()
    return LogCheck(
        source=file,
        signs=signs,
        mistake=mistake,
        delay=delay,
        notices=notices,
    )
