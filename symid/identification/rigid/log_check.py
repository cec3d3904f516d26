"""Check of logs before an identification: as they are, with the robot's dynamics, and their excitation.

Robot, logs, even with uneven time stamps -> `LogsCheck`.

The torque of each joint is fitted by its own rows; inertia and friction as shares of the torque, with the
deviation of leaving out one block:

    inertia share        mean(M_jj ddq^2) / (rms(ddq) rms(tau))
    friction share       mean(tau_f dq) / (rms(dq) rms(tau))
    expected deviation   s sqrt(diag (A'A)^-1),  A and s of rows weighted by the scatter of their joint

Where the whole robot does not fit the log, single mistakes are undone one after the other (`causes`), and one
is named where that helps. Delay: a torque channel that lags by d holds tau(t - d), so with rows A and the
fitted torque s = A x, linear in x and d, iterated,

    tau = A x - d ds/dt

Supported: delays of either sign up to 50 ms; of elastic joints only the quantities are checked.
Not supported: two mistakes at once; bias by a term that the model lacks.
"""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from symid import logs as log_files
from symid.arrays import FloatArray
from symid.codegen import Library
from symid.errors import IdentifiabilityError, LogError, Notice, UsageError
from symid.identification import diagnostics, estimators, judge, regression
from symid.identification.diagnostics import evaluate_inertia_columns
from symid.identification.rigid.evidence import collect_evidence
from symid.identification.rigid.plan import plan_fit
from symid.joint_models import REFERENCE_TEMPERATURE
from symid.robot import JointKind, Processing, Robot
from symid.serialization import name_key

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
    recording: log_files.Recording
    processing: Processing

    def stack_rows(self, weights: FloatArray, tau: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return matrix, values of `tau` (N, n) and `keep` of all moving joints, with weights (k,)."""
        joints = list(self.moving)
        matrix = (self.rows[:, joints] * weights[:, None]).reshape(-1, self.rows.shape[2])
        return matrix, (tau[:, joints] * weights).ravel(), self.keep[:, joints].ravel()


def build_quick_fit(library: Library, recording: log_files.Recording, processing: Processing) -> QuickFit:
    """Return the equations of a recording; cut-off and decimation that are not stated are chosen.

    Raises:
        IdentifiabilityError: no joint moves.
        LogError: the recording is uneven or too short for the settings.
    """
    processing = regression.choose_filters(replace(processing, automatic=True), [recording]).processing
    signals = regression.prepare_states(library, recording, processing)
    resting = regression.list_resting_joints(recording)
    load = regression.compute_payload_torque(library, signals, recording)
    if load is not None:
        torque, first = recording.torque.copy(), processing.drop_first
        torque[first : first + len(load)] -= load
        recording = replace(recording, torque=torque)
    columns = np.hstack([signals.q, signals.dq, signals.ddq, signals.tau])
    thin, blocks, places = _sample_blocks(columns, processing)
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
    if signals.bad is not None:
        left_out |= log_files.mask_decimated(signals.bad, processing.decimation)[places]
    return QuickFit(
        q=q,
        dq=dq,
        ddq=ddq,
        tau=tau,
        rows=regression.evaluate_columns(
            library, q, dq, ddq, np.zeros_like(q), np.full_like(q, REFERENCE_TEMPERATURE)
        ),
        keep=np.where(left_out, 0.0, 1.0),
        blocks=blocks,
        names=tuple(entry.name for entry in card.fitted),
        inertial=len(card.beta),
        moving=tuple(joint for joint in range(card.size) if joint not in resting),
        period=signals.period * processing.decimation.factor,
        recording=recording,
        processing=processing,
    )


def _sample_blocks(
    values: FloatArray, processing: Processing
) -> tuple[FloatArray, tuple[slice, ...], NDArray[np.intp]]:
    """Return decimated rows of `values` (N, k), all or pieces at even distances; pieces, and places."""
    thin = log_files.decimate(np.column_stack([values, np.ones(len(values))]), processing.decimation)
    # A Chebyshev filter of even order passes a constant with its ripple: harmless where all columns of a
    # model pass it, not where states do.
    thin = thin[:, :-1] / thin[:, -1:]
    edges = np.linspace(0, len(thin), max(2, min(_BLOCKS, len(thin) // 10)) + 1).astype(int).tolist()
    pieces = [np.arange(low, min(high, low + _BLOCK)) for low, high in pairwise(edges)]
    bounds, places = np.cumsum([0, *map(len, pieces)]).tolist(), np.concatenate(pieces)
    return thin[places], tuple(slice(low, high) for low, high in pairwise(bounds)), places


_CLEAR = 0.02
"""Of the torque: a share beyond this, and beyond its own deviations, is significant."""
_SIGN_SURE = 3.0
_GROUPS = 8
_HEAVIEST, _LIGHTEST = 2e4, 1e-4
"""kg at half the reach: no arm moves more, or so little."""


@dataclass(frozen=True, slots=True)
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

    def compute_shares(joint: int, samples: NDArray[np.intp]) -> tuple[float, float, float]:
        samples = samples[fit.keep[samples, joint] > 0.0]
        rows, tau = fit.rows[samples, joint], fit.tau[samples, joint]
        dq, ddq = fit.dq[samples, joint], fit.ddq[samples, joint]
        lengths = np.linalg.norm(rows, axis=0)
        # A column of rounding alone would be scaled to the length of the others.
        solution = regression.solve_scaled(
            np.where(lengths > _ROUNDING * lengths.max(), rows, 0.0), tau, rcond=_SMALL
        )
        inertia = columns[joint][samples, joint] @ solution[: fit.inertial]
        braking = rows[:, fit.inertial :] @ solution[fit.inertial :]
        braking = braking - np.mean(braking)
        torque, rate, speed = (float(np.sqrt(np.mean(part**2))) or 1.0 for part in (tau, ddq, dq))
        acceleration = float(np.mean(inertia * ddq**2)) / (rate * torque)
        return acceleration, float(np.mean(braking * dq)) / (speed * torque), float(np.mean(inertia))

    found = []
    for joint in fit.moving:
        values = np.array([compute_shares(joint, samples) for samples in subsets])
        stds = np.sqrt(np.sum(judge.compute_changes(values[1:]) ** 2, axis=0)).tolist()
        inertia, friction, mean = values[0].tolist()
        mass = mean if robot.axes[joint].kind is JointKind.PRISMATIC else mean / reach**2
        found.append(JointSigns(joint, inertia, stds[0], friction, stds[1], mass))
    return tuple(found)


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
        """Return whether there is a significant delay."""
        return _LARGEST > abs(self.delay) > max(_DELAY_SURE * self.std, _SMALLEST * self.period)


def estimate_torque_delay(fit: QuickFit) -> TorqueDelay:
    """Return the delay of the torques of `fit` behind its motion."""
    joints, count = list(fit.moving), len(fit.moving)
    size = np.linalg.norm(fit.tau[:, joints], axis=0)
    weights = 1.0 / np.where(size > 0.0, size, 1.0)

    def predict(tau: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        matrix, values, keep = fit.stack_rows(weights, tau)
        kept = regression.solve_scaled(matrix * keep[:, None], values * keep, rcond=_SMALL)
        return matrix, values, keep, matrix @ kept

    def solve(gram: FloatArray) -> FloatArray:
        return np.asarray(np.linalg.lstsq(gram[:-1, :-1], gram[:-1, -1], rcond=_RCOND)[0][-count:])

    _, values, keep, predicted = predict(fit.tau)
    errors = keep * (values - predicted)
    scatter = np.linalg.norm(errors.reshape(-1, count), axis=0) / weights
    weights = 1.0 / np.maximum(scatter, 1e-6 * size + 1e-300)
    delay, tau = 0.0, fit.tau
    for _ in range(_ROUNDS):
        matrix, values, keep, predicted = predict(tau)
        smooth = predicted.reshape(-1, count)
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
        replicates = np.array([solve(whole - gram) for gram in grams]) * back
        values = solve(whole) * back
        stds = np.sqrt(np.sum(judge.compute_changes(replicates) ** 2, axis=0))
        shares = 1.0 / np.maximum(stds, 1e-9) ** 2
        shares /= shares.sum()
        step = float(shares @ values)
        delay += step
        if abs(step) < _CONVERGED * fit.recording.period or abs(delay) > _LARGEST:
            break
        moved = log_files.shift_channel(fit.recording.time, fit.recording.torque, delay)
        signals = log_files.prepare_signals(replace(fit.recording, torque=moved), fit.processing)
        tau, *_ = _sample_blocks(signals.tau, fit.processing)
    # Where joints disagree by more than their own deviations, these are too small (Birge 1932).
    excess = float(np.sum(((values - step) / np.maximum(stds, 1e-9)) ** 2)) / max(1, len(values) - 1)
    common = float(np.linalg.norm(judge.compute_changes(replicates @ shares)))
    return TorqueDelay(
        delay=delay,
        std=common * max(1.0, excess) ** 0.5,
        joints=tuple(float(delay - step + value) for value in values),
        joint_stds=tuple(map(float, stds)),
        period=fit.recording.period,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class LogCheck:
    """The check of one log: signs of moving joints, what explains it better, delay of the torque."""

    source: str
    signs: tuple[JointSigns, ...]
    causes: tuple[estimators.Cause, ...]
    delay: TorqueDelay | None
    notices: tuple[Notice, ...]


def judge_log(library: Library, recording: log_files.Recording, robot: Robot) -> estimators.Evidence | None:
    """Return the evidence of a fit to one log with chosen settings, as an identification has it."""
    settings = replace(robot.processing, automatic=True)
    study = plan_fit(library, [recording], settings, rows="torque", estimator=None).study
    if study is None:
        return None
    fit = estimators.RegressionFit(
        values=study.fit.values,
        covariance=study.fit.changes.T @ study.fit.changes,
        residuals=np.empty(0),
        spent=np.zeros(len(study.fit.weights)),
        condition=0.0,
        weights=study.fit.weights,
    )
    return collect_evidence(library, study, fit, robot=robot, transmission=recording.transmission)


def check_channels(fit: QuickFit, library: Library, robot: Robot) -> LogCheck:
    """Return what is odd in the channels of the log behind `fit`."""
    file = fit.recording.source
    signs = estimate_signs(fit, library, robot)
    evidence = judge_log(library, fit.recording, robot)
    notices: tuple[Notice, ...] = ()
    found: tuple[estimators.Cause, ...] = ()
    if evidence is not None:
        pairs, found = evidence.in_proportion, evidence.causes
        notices = tuple(diagnostics.describe_proportion(*pair, file) for pair in pairs)
    if len(found) == 1:
        (cause,) = found
        text = (
            f"{cause.cause}: undone, {cause.after:.3g} % is left of held-out torque, not "
            f"{cause.before:.3g} %; "
            f"{cause.remedy}"
        )
        notices += (Notice(code=cause.code, text=text, file=file),)
    elif found:
        text = f"one of these would explain what is left: {'; or '.join(entry.cause for entry in found)}"
        notices += (Notice(code="log.several-causes", text=text, file=file),)
    odd = [
        entry
        for entry in signs
        if entry.inertia > max(_CLEAR, _SIGN_SURE * entry.inertia_std)
        and not _LIGHTEST < entry.mass < _HEAVIEST
    ]
    if odd and not notices:
        # Torques that correspond to masses that no robot has.
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
        notices += (Notice(code="log.torque-size", text=text, file=file),)
    # Also beside others: a URDF without friction, whose efforts are currents.
    if not {"log.torque-size", "log.wrong-unit"} & {notice.code for notice in notices}:
        notices += describe_scale(fit, library, robot)
    delay: TorqueDelay | None = None
    if not notices:
        delay = estimate_torque_delay(fit)
        if delay.late:
            side = "after" if delay.delay > 0.0 else "before"
            text = (
                f"the torque is logged {1e3 * abs(delay.delay):.3g} ms {side} the motion (standard deviation "
                f"{1e3 * delay.std:.2g} ms, {abs(delay.delay) / delay.period:.3g} samples), which biases "
                "friction and inertia; shift one of the channels, or filter far below the inverse of the "
                "delay"
            )
            notices = (Notice(code="log.torque-delay", text=text, file=file),)
    return LogCheck(source=file, signs=signs, causes=found, delay=delay, notices=notices)


IDENTIFIABLE, POORLY, NOT_IDENTIFIABLE = "identifiable", "poorly identifiable", "not identifiable"
_WELL, _POOR = 10.0, 100.0
_LARGE_CONDITION = 1e3
_SHOWN = 8


@dataclass(frozen=True, slots=True)
class ParameterVerdict:
    """The verdict on one parameter, and the reason where it is not "identifiable".

    "poorly identifiable": expected standard deviation, `relative_std_percent`, above 10 % of the value; "not
    identifiable": above 100 %; "refused": it has no value of its own.
    """

    name: str
    verdict: str
    relative_std_percent: float
    reason: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class LogExcitation:
    """Verdicts on all parameters; singular values (falling, largest 1), rank, condition up to the rank."""

    parameters: tuple[ParameterVerdict, ...]
    singular: tuple[float, ...] = field(metadata=name_key("singular_values"))
    rank: int
    condition: float

    def list_names(self, *verdicts: str) -> tuple[str, ...]:
        """Return the names of the parameters with one of these verdicts."""
        return tuple(entry.name for entry in self.parameters if entry.verdict in verdicts)

    @property
    def empty(self) -> bool:
        """Return whether no parameter is identifiable."""
        return not self.list_names(IDENTIFIABLE, POORLY)

    @property
    def poor(self) -> bool:
        """Return whether too few parameters are identifiable for a model of the whole robot."""
        kept = len(self.parameters) - len(self.list_names("refused"))
        return self.empty or kept < regression.WHOLE_MODEL * len(self.parameters)


def analyse_excitation(fits: Sequence[QuickFit], joints: Sequence[str]) -> LogExcitation:
    """Return which parameters the logs behind `fits` excite, `joints` the names of the robot's joints."""
    rule = regression.RankRule()

    def stack(weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        parts = [fit.stack_rows(weights[list(fit.moving)], fit.tau) for fit in fits]
        # A joint at rest may be held by dry friction, so its rows stay out.
        matrix = np.vstack([rows[keep > 0.0] for rows, _, keep in parts])
        return matrix, np.concatenate([values[keep > 0.0] for _, values, keep in parts])

    matrix, values = stack(np.ones(fits[0].tau.shape[1]))
    first = regression.solve_scaled(matrix, values, rcond=_SMALL)
    keep, tau = (np.vstack([getattr(fit, name) for fit in fits]) for name in ("keep", "tau"))
    left = tau - np.vstack([fit.rows @ first for fit in fits])
    squares, sizes, counts = (np.sum(part, axis=0) for part in ((keep * left) ** 2, (keep * tau) ** 2, keep))
    scatter = np.sqrt(np.maximum(squares, 1e-12 * sizes) / np.maximum(counts, 1.0))
    matrix, values = stack(1.0 / np.where(scatter > 0.0, scatter, 1.0))
    spectrum = regression.compute_spectrum(matrix, rule.zero)
    kept, identifiable = spectrum.mask_directions(rule), spectrum.mask_identifiable(rule)
    inner = spectrum.scales[:, None] * spectrum.directions[kept].T / spectrum.singular[kept]
    solution: FloatArray = inner @ (inner.T @ (matrix.T @ values))
    errors, rank = values - matrix @ solution, int(np.sum(kept))
    variance = float(errors @ errors) / max(1, len(values) - rank)
    deviations: FloatArray = np.sqrt(variance * np.sum(inner**2, axis=1))
    names = fits[0].names
    resting = [name for index, name in enumerate(joints) if all(index not in fit.moving for fit in fits)]
    still = f"; at rest: {', '.join(resting)}" if resting else ""
    verdicts = []
    for index, name in enumerate(names):
        percent, verdict = float("inf"), "refused"
        reason = f"it acts on no torque of this log{still}"
        if identifiable[index]:
            percent = 100.0 * float(deviations[index]) / max(abs(float(solution[index])), 1e-300)
            verdict = IDENTIFIABLE if percent <= _WELL else POORLY if percent <= _POOR else NOT_IDENTIFIABLE
            reason = "" if verdict == IDENTIFIABLE else "it is small beside the noise, or hardly excited"
        elif spectrum.lengths[index]:
            others = ", ".join(names[k] for k in spectrum.list_partners(index, rule)[:4])
            reason = f"it acts only together with {others}{still}"
        verdicts.append(ParameterVerdict(name, verdict, percent, reason))
    largest = spectrum.singular[0] or 1.0
    return LogExcitation(
        parameters=tuple(verdicts),
        singular=tuple(float(value) for value in spectrum.singular / largest),
        rank=rank,
        condition=float(largest / spectrum.singular[rank - 1]) if rank else float("inf"),
    )


def describe_excitation(found: LogExcitation) -> tuple[Notice, ...]:
    """Return notices on parameters that are not identifiable, and on a bad condition."""
    notices = []
    refused = [f"{entry.name}: {entry.reason}" for entry in found.parameters if entry.verdict == "refused"]
    if refused:
        more = f"; and {len(refused) - _SHOWN} more" if len(refused) > _SHOWN else ""
        text = (
            f"{len(refused)} of {len(found.parameters)} parameters have no value of their own in these logs "
            f"({'; '.join(refused[:_SHOWN])}{more}). Accelerate every joint on its own; `symid excite` makes "
            "such motions"
        )
        notices.append(("log.not-excited", text))
    faint = found.list_names(NOT_IDENTIFIABLE)
    if faint:
        listed = ", ".join(faint[:_SHOWN]) + (", ..." if len(faint) > _SHOWN else "")
        text = (
            f"{len(faint)} parameters are not identifiable, with an expected standard deviation above "
            f"{_POOR:g} % of the value ({listed}). Use faster or longer motions, or leave them out"
        )
        notices.append(("log.faint-parameters", text))
    if found.condition > _LARGE_CONDITION:
        text = (
            f"the condition number is {found.condition:.3g}: noise in hardly excited combinations of "
            "parameters is amplified. Use a motion made by `symid excite`"
        )
        notices.append(("log.condition", text))
    return tuple(Notice(code=code, text=text) for code, text in notices)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CheckedLog:
    """A log without its faults, how it was sampled before, and what every joint does in it."""

    recording: log_files.Recording
    timing: log_files.LogTiming
    joints: tuple[log_files.JointSummary, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LogsCheck:
    """The check of all logs.

    `copy` is the file of an evenly sampled copy and what was done for it, where one was asked for; `dynamics`
    the check of each log that moves, `excitation` that of all parameters: none for elastic joints and logs at
    rest; `notices` say what is odd, with what to do, `errors` why the logs are not enough for a model.
    """

    logs: tuple[CheckedLog, ...] = ()
    copy: tuple[Path, Notice] | None = None
    dynamics: tuple[LogCheck, ...] = ()
    excitation: LogExcitation | None = None
    notices: tuple[Notice, ...] = ()
    errors: tuple[Notice, ...] = ()


def summarise_log(recording: log_files.Recording, robot: Robot) -> CheckedLog:
    """Return the log without its faults, how it was sampled before, and what every joint does in it."""
    even = log_files.repair_recording(recording, robot.axes)
    timing, joints = log_files.measure_timing(recording.time), log_files.summarise_joints(even, robot)
    return CheckedLog(recording=even, timing=timing, joints=joints)


def check_robot_logs(
    robot: Robot,
    logs: Sequence[Path | log_files.Recording],
    *,
    prepare: Callable[[], Library],
    progress: Callable[[str], None],
    output: Path | None = None,
) -> LogsCheck:
    """Return what is odd in logs, and which parameters are identifiable from all of them together.

    `logs` are files, files of runs, or what was read before. `prepare` returns the robot's functions, where
    they are needed; `progress` is called with a short text on what begins; `output` is the file of an evenly
    sampled copy of the first log.

    Raises:
        LogError: with what is wrong with any of the logs.
        OutputError: the copy cannot be written.
    """
    progress(f"reading {len(logs)} log{'s'[: len(logs) > 1]}")
    found: list[CheckedLog] = []
    notices: list[Notice] = []
    read = log_files.read_recordings(logs, robot, uneven=True)
    for recording in read:
        found.append(summarise_log(recording, robot))
        even, told = found[-1].recording, recording.notices
        notices += (
            *told,
            *log_files.describe_timing(recording.time, recording.source),
            *even.notices[len(told) :],
        )
        notices += log_files.check_recording(even, robot)
    copy = None
    if output is not None:
        log = logs[0]
        source = log if isinstance(log, Path) else Path(log.source)
        if isinstance(log, log_files.Recording) and not os.path.isfile(source):  # noqa: PTH113  any text may stand there
            text = "an evenly sampled copy is made of a log's file, and this log has none; save it first"
            raise UsageError(Notice(code="usage.no-file", text=text, file=log.source))
        plan = log_files.choose_times(read[0])
        raw, note = log_files.resample_log(log_files.read_raw(source), robot, str(source), plan)
        copy = log_files.write_raw_log(raw, output), note
        notices.append(note)
    checked = LogsCheck(logs=tuple(found), copy=copy, notices=tuple(notices))
    if any(robot.elastic):
        text = (
            "elastic joints: signs, order and excitation are checked for rigid joints only; `symid identify` "
            "lists what is not identifiable"
        )
        return replace(checked, notices=(*notices, Notice(code="check.elastic", text=text)))
    library = prepare()
    progress("analysing the motion")
    fits: list[QuickFit] = []
    reasons: list[Notice] = []
    for entry in checked.logs:
        try:
            fits.append(build_quick_fit(library, entry.recording, robot.processing))
        except (IdentifiabilityError, LogError) as error:
            reasons += error.notices
    if not fits:
        return replace(checked, errors=tuple(reasons))
    errors: tuple[Notice, ...] = ()
    checks = tuple(check_channels(fit, library, robot) for fit in fits)
    excitation = analyse_excitation(fits, [joint.name for joint in robot.axes])
    if excitation.empty:
        reason = "; ".join(f"{entry.name}: {entry.reason}" for entry in excitation.parameters[:8])
        text = (
            f"no parameter is identifiable from these logs ({reason}): record logs in which joints accelerate"
        )
        errors = (Notice(code="check.nothing", text=text),)
    elif excitation.poor:
        count, whole = len(excitation.list_names("refused")), len(excitation.parameters)
        text = (
            f"only {whole - count} of {whole} parameters are identifiable from these logs, for the reasons "
            "in the table. Record a log in which every joint accelerates on its own, add logs, or fit what "
            "is identifiable with `symid identify --partial`"
        )
        errors = (Notice(code="check.poor", text=text),)
    notices += (notice for check in checks for notice in check.notices)
    notices += (*reasons, *describe_excitation(excitation), *library.notices)
    return replace(checked, dynamics=checks, excitation=excitation, notices=tuple(notices), errors=errors)
