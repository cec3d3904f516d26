"""Sign, order and delay of the channels of a log, from a quick fit before any identification.

Library, even recording -> `QuickFit` -> `JointSigns`, `Exchange`s, `TorqueDelay`, and notices.

Sign: the torque of each joint is fitted by its own rows. Its inertia must be positive, and its friction must
dissipate. Both as shares of the torque, with the deviation of leaving out one block:

    inertia share   mean(M_jj ddq^2) / (rms(ddq) rms(tau))
    friction share  mean(tau_f dq) / (rms(dq) rms(tau))

Order: pairs of torque columns, of position columns and of both are exchanged; the exchange with the smallest
residual on held-out samples is kept, as long as the residual falls clearly. Delay: a torque channel that lags
by d holds tau(t - d), so with rows A and the fitted torque s = A x, linear in x and d, iterated,

    tau = A x - d ds/dt

Supported: permutations that are products of exchanges, each an improvement; delays of either sign up to 50
ms. Not supported: elastic joints; signs of joints whose torque is nearly all gravity.
"""

from dataclasses import dataclass, replace
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.errors import IdentifiabilityError, Notice
from symid.identification.diagnostics.fit_warnings import evaluate_inertia_columns
from symid.identification.regression import (
    choose_filters,
    compute_payload_torque,
    evaluate_columns,
    hold_resting_joints,
    list_resting_joints,
    solve_scaled,
)
from symid.logs import Recording, decimate, prepare_signals, shift_channel
from symid.robot import JointKind, Processing, Robot

_BLOCKS = 20
_BLOCK = 200
"""Samples of a block: with twenty blocks some thousand samples, enough for a quick fit."""
_SMALL = 1e-7
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
    slow = np.maximum(processing.standstill, _SLOW * np.sqrt(np.mean(dq**2, axis=0)))
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
        rows=evaluate_columns(library, q, dq, ddq),
        keep=np.where(left_out, 0.0, 1.0),
        blocks=blocks,
        names=tuple(entry.name for entry in (*card.beta, *card.friction)),
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

    @property
    def wrong(self) -> bool:
        """Return whether the torque goes against the motion, significantly."""
        shares = ((self.inertia, self.inertia_std), (self.friction, self.friction_std))
        clear = [share for share, std in shares if abs(share) > max(_CLEAR, _SIGN_SURE * std)]
        return bool(clear) and max(clear) < 0.0


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
    solution = solve_scaled(rows, tau, rcond=_SMALL)
    inertia = column[samples] @ solution[: fit.inertial]
    braking = rows[:, fit.inertial :] @ solution[fit.inertial :]
    braking = braking - np.mean(braking)
    size = _compute_rms(tau) or 1.0
    acceleration = float(np.mean(inertia * ddq**2)) / ((_compute_rms(ddq) or 1.0) * size)
    work = float(np.mean(braking * dq)) / ((_compute_rms(dq) or 1.0) * size)
    return acceleration, work, float(np.mean(inertia))


def _compute_rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def describe_signs(signs: tuple[JointSigns, ...], robot: Robot, file: str) -> tuple[Notice, ...]:
    """Return a notice on every joint whose torque goes against its motion."""
    notices = []
    for entry in signs:
        if not entry.wrong:
            continue
        shares = ((entry.inertia, "its inertia is negative"), (entry.friction, "its friction drives it"))
        reason = " and ".join(text for share, text in shares if share < -_CLEAR)
        text = (
            f"the torque of joint {robot.axes[entry.joint].name!r} has the wrong sign: fitted alone, "
            f"{reason}; change the sign of its torque or of its position (a factor of -1 in [log.torque] or "
            "[log.position]), or of its gear"
        )
        notices.append(Notice(code="log.torque-sign", text=text, file=file))
    return tuple(notices)


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


_CLEARLY = 0.75
_ALIKE = 1.3
"""Times the smallest residual: exchanges below cannot be distinguished."""
_SAMPLES = 500
_CLEAN_RESIDUAL = 0.03
"""With a relative residual as small as this the order is right."""

_PIECES = 6
_RIDGE = 1e-4
"""Of the squared length of the columns."""

Order = tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Exchange:
    """Columns `first` and `second` (joints) of `what` exchanged: relative residual `before` and `after`."""

    what: str
    first: int
    second: int
    before: float
    after: float


def detect_exchanges(fit: QuickFit, library: Library) -> tuple[Exchange, ...]:
    """Return the exchanges of columns that explain the torque clearly better, in the order found."""
    step = max(1, len(fit.q) // _SAMPLES)
    states = tuple(part[::step] for part in (fit.q, fit.dq, fit.ddq, fit.tau))
    size = fit.q.shape[1]
    positions = torques = tuple(range(size))
    best = _measure_residual(states, library, positions, torques)
    found: list[Exchange] = []
    while best > _CLEAN_RESIDUAL and len(found) < size:
        trials = []
        for pair in combinations(fit.moving, 2):
            moved, turned = _swap(positions, pair), _swap(torques, pair)
            for what, first, second in (
                ("torque", positions, turned),
                ("position", moved, torques),
                ("position and torque", moved, turned),
            ):
                residual = _measure_residual(states, library, first, second)
                trials.append((residual, what, pair, first, second))
        if not trials:
            break
        residual, _, pair, moved, turned = min(trials, key=lambda trial: trial[0])
        if residual > _CLEARLY * best:
            break
        # To exchange torques or to exchange positions may look alike: joints are then only renamed.
        alike = [trial[1] for trial in trials if trial[2] == pair and trial[0] <= _ALIKE * residual]
        what = " or ".join(alike)
        found.append(Exchange(what=what, first=pair[0], second=pair[1], before=best, after=residual))
        best, positions, torques = residual, moved, turned
    return tuple(found)


def _swap(order: Order, pair: tuple[int, int]) -> Order:
    swapped = list(order)
    swapped[pair[0]], swapped[pair[1]] = order[pair[1]], order[pair[0]]
    return tuple(swapped)


def _measure_residual(
    states: tuple[FloatArray, ...], library: Library, positions: Order, torques: Order
) -> float:
    """Return the mean over joints of |e| / |tau| on held-out samples.

    One fit of all joints, each weighted alike, without each of some pieces of the log in turn; a small ridge
    keeps what they do not identify at zero.
    """
    moved = (np.ascontiguousarray(part[:, list(positions)]) for part in states[:3])
    rows = evaluate_columns(library, *moved)
    tau = states[3][:, list(torques)]
    size = np.linalg.norm(tau, axis=0)
    weights = 1.0 / np.where(size > 0.0, size, 1.0)
    matrix, values = rows * weights[:, None], tau * weights
    lengths = np.sqrt(np.sum(matrix**2, axis=(0, 1)))
    matrix = matrix / np.where(lengths > 0.0, lengths, 1.0)
    pieces = np.array_split(np.arange(len(tau)), _PIECES)
    flat = [matrix[piece].reshape(-1, len(lengths)) for piece in pieces]
    grams = [part.T @ part for part in flat]
    sides = [part.T @ values[piece].ravel() for part, piece in zip(flat, pieces, strict=True)]
    gram, side = sum(grams) + _RIDGE * np.eye(len(lengths)), sum(sides)
    squares = np.zeros(len(size))
    for piece, own, right in zip(pieces, grams, sides, strict=True):
        solution = np.linalg.solve(gram - own, side - right)
        squares += np.sum((values[piece] - matrix[piece] @ solution) ** 2, axis=0)
    return float(np.mean(np.sqrt(squares)[size > 0.0])) if size.any() else 0.0


def describe_exchanges(exchanges: tuple[Exchange, ...], robot: Robot, file: str) -> Notice:
    """Return a notice that names the exchanges."""
    names = [repr(joint.name) for joint in robot.axes]
    listed = ", then ".join(
        f"{entry.what} of {names[entry.first]} and {names[entry.second]}" for entry in exchanges
    )
    before, after = 100 * exchanges[0].before, 100 * exchanges[-1].after
    text = (
        f"columns of joints look exchanged: {listed}; exchanging them lowers the residual of a quick fit "
        f"from {before:.3g} % to {after:.3g} %. Check the order of the columns in the log and under [log]"
    )
    return Notice(code="log.swapped-joints", text=text, file=file)


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
    """The check of one log: signs of moving joints, exchanged columns, delay of the torque."""

    source: str
    signs: tuple[JointSigns, ...]
    exchanges: tuple[Exchange, ...]
    delay: TorqueDelay | None
    notices: tuple[Notice, ...]


def check_channels(fit: QuickFit, library: Library, robot: Robot) -> LogCheck:
    """Return what is odd in the channels of the log behind `fit`."""
    file = fit.recording.source
    signs = estimate_signs(fit, library, robot)
    notices = describe_signs(signs, robot, file)
    exchanges: tuple[Exchange, ...] = ()
    delay: TorqueDelay | None = None
    if not notices:
        # With a wrong sign neither order nor delay means anything.
        exchanges = detect_exchanges(fit, library)
        swapped = [describe_exchanges(exchanges, robot, file)] if exchanges else []
        notices = (*swapped, *describe_sizes(signs, robot, file))
    if not notices:
        delay = estimate_torque_delay(fit)
        notices = (describe_delay(delay, file),) if delay.late else ()
    return LogCheck(source=file, signs=signs, exchanges=exchanges, delay=delay, notices=notices)
