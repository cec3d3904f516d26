"""Check of logs before an identification: as they are, with the robot's dynamics, and their excitation.

Robot, logs, even with uneven time stamps -> `LogsCheck`.

Each log is planned and judged as an identification would (`choose_settings`, `collect_evidence`), and of its
samples within the scoring band are found

    inertia share     mean(M_jj ddq^2) / (rms(ddq) rms(tau)),  mean(M_jj) as a mass
    friction share    mean(tau_f dq) / (rms(dq) rms(tau))
    delay d           tau = A x - d ds/dt,  s = A x,  linear in x and d, iterated
    excitation        singular values, and the deviations to expect, of all logs together

Supported: delays of either sign up to a quarter of the scoring band's period; of elastic joints only the
quantities are checked.
Not supported: two mistakes at once; bias by a term that the model lacks.
"""

import os
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from symid import logs as log_files
from symid.arrays import FloatArray
from symid.codegen import Library
from symid.errors import IdentifiabilityError, LogError, Notice, UsageError, shorten_names
from symid.identification import diagnostics, estimators, judge, regression
from symid.identification.judge import POLICY, Agreement, numerics
from symid.identification.regression import ThinMotion
from symid.identification.rigid.evidence import collect_evidence, compare_fit
from symid.identification.rigid.plan import plan_fit
from symid.identification.rigid.scale import describe_scales
from symid.identification.rigid.settings_choice import SettingsStudy
from symid.robot import JointKind, Processing, Robot
from symid.serialization import HIDDEN, name_key


class StudiedLog(NamedTuple):
    """A log and its settings, its motion and columns (t, n, p) within the scoring band, joints that move."""

    recording: log_files.Recording
    study: SettingsStudy
    motion: ThinMotion
    columns: FloatArray
    moving: tuple[int, ...]

    @property
    def fit(self) -> tuple[FloatArray, FloatArray]:
        """Return the parameters with chosen settings, and their covariance."""
        return self.study.fit.values, self.study.fit.changes.T @ self.study.fit.changes


def study_logs(
    library: Library, recordings: Sequence[log_files.Recording], processing: Processing
) -> SettingsStudy:
    """Return the settings that an identification would choose for logs, or an IdentifiabilityError."""
    settings = replace(processing, automatic=True)
    study = plan_fit(library, recordings, settings, rows="torque", estimator=None).study
    if study is None:
        text = f"the log is too short for {len(library.card.fitted)} parameters: record a longer one"
        raise IdentifiabilityError(Notice(code="identify.too-few-rows", text=text, file=recordings[0].source))
    return study


def study_log(library: Library, recording: log_files.Recording, processing: Processing) -> StudiedLog:
    """Return a log with what an identification would choose for it; raises as `study_logs`."""
    study, resting = study_logs(library, [recording], processing), regression.list_resting_joints(recording)
    moving = tuple(joint for joint in range(library.card.size) if joint not in resting)
    return StudiedLog(recording, study, study.logs.motion, study.logs.columns, moving)


def judge_log(library: Library, log: StudiedLog, robot: Robot) -> estimators.Evidence:
    """Return the evidence of a fit to one log with chosen settings, as an identification has it."""
    turned = log.recording.transmission
    return collect_evidence(library, log.study, *log.fit, robot=robot, transmission=turned)


_HEAVIEST, _LIGHTEST = 2e4, 1e-4
"""kg at half the reach: no arm moves more, or so little."""


@dataclass(frozen=True, slots=True)
class JointSigns:
    """Shares of inertia and friction in the torque of joint `joint`, with deviations; `mass`.

    `mass` is the mean inertia M_jj as a mass (kg) at half the robot's reach, or that of a slide itself.
    """

    joint: int
    inertia: float
    inertia_std: float
    friction: float
    friction_std: float
    mass: float

    @property
    def implausible(self) -> bool:
        """Return whether there surely is an inertia, and one that no robot has."""
        sure = self.inertia > max(POLICY.relevance, POLICY.printed * self.inertia_std)
        return sure and not _LIGHTEST < self.mass < _HEAVIEST


def estimate_signs(log: StudiedLog, library: Library, robot: Robot) -> tuple[JointSigns, ...]:
    """Return shares of inertia and friction of every joint that moves."""
    # Half of the distances between joints in m, which are a tenth of one at least.
    reach = 0.5 * max(0.1, robot.reach)
    shares = diagnostics.measure_shares(library, log.motion, log.columns, log.study.fit)
    stds = np.linalg.norm(shares.changes, axis=0)
    found = []
    for place in log.moving:
        mass = float(shares.inertia[place])
        mass = mass if robot.axes[place].kind is JointKind.PRISMATIC else mass / reach**2
        (inertia, friction), (inertia_std, friction_std) = shares.values[place].tolist(), stds[place].tolist()
        found.append(JointSigns(place, inertia, inertia_std, friction, friction_std, mass))
    return tuple(found)


@dataclass(frozen=True, slots=True, kw_only=True)
class TorqueDelay:
    """Delay of the torque behind the motion in s, its standard deviation; of each moving joint alone.

    `late` whether there surely is one, and one that matters; `period` of the log's samples in s.
    """

    delay: float
    std: float
    joints: tuple[float, ...]
    joint_stds: tuple[float, ...]
    period: float
    late: bool


def estimate_torque_delay(log: StudiedLog) -> TorqueDelay:
    """Return the delay of the torques of a log behind its motion."""
    motion, fold, moving = log.motion, log.study.logs.fold, list(log.moving)
    # A radian of the scoring band, of which the thinned motion has four samples a period.
    radian = 2.0 * motion.period / np.pi
    delay, moved = 0.0, motion
    for _ in range(numerics.ROUNDS):
        load = log.columns @ diagnostics.fit_motion(log.columns, moved, fold).fit.values
        slopes = np.zeros((*load.shape, len(moving)))
        for run in np.unique(motion.run):
            own = np.flatnonzero(motion.run == run)
            slope = CubicSpline(np.arange(len(own)) * motion.period, load[own]).derivative()
            slopes[own[:, None], moving, range(len(moving))] = -slope(np.arange(len(own)) * motion.period)[
                :, moving
            ]
        found = diagnostics.fit_motion(np.concatenate([log.columns, slopes], axis=2), moved, fold).fit
        values, changes = found.values[-len(moving) :], found.changes[:, -len(moving) :]
        stds = np.linalg.norm(changes, axis=0)
        shares = np.divide(1.0, stds**2, out=np.zeros(len(moving)), where=stds > 0.0)
        shares /= max(float(shares.sum()), numerics.TINY)
        step = float(shares @ values)
        delay += step
        if abs(step) < numerics.CONVERGED * radian or abs(delay) > motion.period:
            break
        moved = diagnostics.shift_torques(motion, delay)
    # Where joints disagree by more than their own deviations, these are too small (Birge 1932).
    excess = float(np.sum((values - step) ** 2 * shares)) / max(1, len(moving) - 1)
    common = changes @ shares
    excess = max(1.0, np.sqrt(excess / max(float(common @ common), numerics.TINY)))
    told = judge.agree_in_value(delay, excess * common, radian)
    return TorqueDelay(
        delay=delay,
        std=excess * float(np.linalg.norm(common)),
        joints=tuple((delay - step + values).tolist()),
        joint_stds=tuple(stds.tolist()),
        period=log.recording.period,
        # Beyond a quarter of the band's period torques follow the motion otherwise.
        late=abs(delay) < motion.period and told.verdict is Agreement.DIFFERENT,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class LogCheck:
    """The check of one log: signs of moving joints, what explains it better, delay of the torque."""

    source: str
    signs: tuple[JointSigns, ...]
    causes: tuple[estimators.Cause, ...]
    delay: TorqueDelay | None
    notices: tuple[Notice, ...]


def check_channels(log: StudiedLog, library: Library, robot: Robot) -> LogCheck:
    """Return what is odd in the channels of a log."""
    file = log.recording.source
    signs = estimate_signs(log, library, robot)
    evidence = judge_log(library, log, robot)
    found = evidence.causes
    notices = tuple(diagnostics.describe_proportion(*pair, file) for pair in evidence.in_proportion)
    if len(found) == 1:
        (cause,) = found
        text = f"{cause.cause}: corrected, the held-out residual falls from {cause.before:.3g} % to "
        text += f"{cause.after:.3g} %; {cause.remedy}"
        notices += (Notice(code=cause.code, text=text, file=file),)
    elif found:
        text = "; or ".join(entry.cause for entry in found)
        text = f"one of these would explain the residual, and the log does not tell which; check: {text}"
        notices += (Notice(code="log.several-causes", text=text, file=file),)
    odd = [entry for entry in signs if entry.implausible]
    if odd and not notices:
        # Torques that correspond to masses that no robot has.
        worst = max(odd, key=lambda entry: abs(np.log(entry.mass)))
        guess = (
            "check for milliamperes, N mm or degrees: state the unit in [log.torque] and [log.position]"
            if worst.mass >= _HEAVIEST
            else 'check for the motor side (side = "motor"), and for kN m stated in place of N m'
        )
        text = f"the torque of joint {robot.axes[worst.joint].name!r} corresponds to a moving mass of "
        text += f"{worst.mass:.2g} kg, which is not plausible; {guess}"
        notices += (Notice(code="log.torque-size", text=text, file=file),)
    # Also beside others: a URDF without friction, whose efforts are currents.
    if not {"log.torque-size", "log.wrong-unit"} & {notice.code for notice in notices}:
        scales = compare_fit(library, log.study, *log.fit, robot)
        notices += describe_scales(scales, robot, "log.effort-size", file)
    delay: TorqueDelay | None = None
    if not notices:
        delay = estimate_torque_delay(log)
        if delay.late:
            side = "after" if delay.delay > 0.0 else "before"
            text = f"the torque is logged {1e3 * abs(delay.delay):.3g} ms {side} the motion (standard "
            text += f"deviation {1e3 * delay.std:.2g} ms, {abs(delay.delay) / delay.period:.3g} samples), "
            text += "which biases friction and inertia; shift one of the channels, or filter far below the "
            text += "inverse of the delay"
            notices = (Notice(code="log.torque-delay", text=text, file=file),)
    return LogCheck(source=file, signs=signs, causes=found, delay=delay, notices=notices)


IDENTIFIABLE, POORLY, NOT_IDENTIFIABLE = "identifiable", "poorly identifiable", "not identifiable"
_LARGE_CONDITION = 1e3
_SHOWN = 8


@dataclass(frozen=True, slots=True)
class ParameterVerdict:
    """The verdict on one parameter, and the reason where it is not "identifiable".

    "poorly identifiable": expected standard deviation, `relative_std_percent`, above 30 % of the value; "not
    identifiable": it has no value of its own.
    """

    name: str
    verdict: str
    relative_std_percent: float
    reason: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class LogExcitation:
    """Verdicts on all parameters; singular values (falling, largest 1), rank, condition up to the rank.

    `unknown` are names of parameters with a value that a fit would leave open, see `split_uncertain`.
    """

    parameters: tuple[ParameterVerdict, ...]
    singular: tuple[float, ...] = field(metadata=name_key("singular_values"))
    rank: int
    condition: float
    unknown: tuple[str, ...] = field(default=(), metadata=HIDDEN)

    def list_names(self, *verdicts: str) -> tuple[str, ...]:
        """Return the names of the parameters with one of these verdicts."""
        return tuple(entry.name for entry in self.parameters if entry.verdict in verdicts)

    @property
    def empty(self) -> bool:
        """Return whether no parameter is identifiable, or all would be left open."""
        return len(self.list_names(NOT_IDENTIFIABLE)) + len(self.unknown) == len(self.parameters)

    @property
    def poor(self) -> bool:
        """Return whether too few parameters are identifiable, or known, for a model of the whole robot."""
        lost, whole = len(self.list_names(NOT_IDENTIFIABLE)), len(self.parameters)
        return lost > (1.0 - POLICY.whole) * whole or lost + len(self.unknown) > POLICY.whole * whole


def analyse_excitation(library: Library, study: SettingsStudy, moving: Collection[int]) -> LogExcitation:
    """Return which parameters logs excite, and how well their fit would tell them; `moving` are joints."""
    rule, fit = regression.RankRule(), study.fit
    whole = study.sums.join_squares(study.classes, fit.weights)[:-1, :-1]
    lengths = np.sqrt(np.diag(whole))
    squares, directions = np.linalg.eigh(whole / np.outer(*[np.where(lengths > 0.0, lengths, 1.0)] * 2))
    root = np.sqrt(np.maximum(squares, 0.0))[:, None] * directions.T * lengths
    spectrum = regression.compute_spectrum(root, rule.zero)
    found, identifiable = spectrum.mask_directions(rule), spectrum.mask_identifiable(rule)
    deviations, rank = np.linalg.norm(fit.changes, axis=0), int(np.sum(found))
    names, card = [entry.name for entry in library.card.fitted], library.card
    resting = [joint.name for place, joint in enumerate(card.joints) if place not in moving]
    still = f"; at rest: {', '.join(resting)}" if resting else ""
    verdicts = []
    for index, name in enumerate(names):
        percent, verdict = float("inf"), NOT_IDENTIFIABLE
        reason = f"acts on no torque of this log{still}"
        if identifiable[index]:
            percent = 100.0 * float(deviations[index]) / max(abs(float(fit.values[index])), numerics.TINY)
            verdict = IDENTIFIABLE if percent <= POLICY.uncertain else POORLY
            reason = "" if verdict == IDENTIFIABLE else "small beside the noise, or hardly excited"
        elif spectrum.lengths[index]:
            others = ", ".join(names[k] for k in spectrum.list_partners(index, rule)[:4])
            reason = f"acts only together with {others}{still}"
        verdicts.append(ParameterVerdict(name, verdict, percent, reason))
    largest = spectrum.singular[0] or 1.0
    expected = estimators.list_parameters(card.fitted, fit.values, fit.changes.T @ fit.changes)
    unknown, _ = estimators.split_uncertain([e for e, own in zip(expected, identifiable, strict=True) if own])
    return LogExcitation(
        parameters=tuple(verdicts),
        singular=tuple(float(value) for value in spectrum.singular / largest),
        rank=rank,
        condition=float(largest / spectrum.singular[rank - 1]) if rank else float("inf"),
        unknown=tuple(unknown),
    )


def describe_excitation(found: LogExcitation) -> tuple[Notice, ...]:
    """Return notices on parameters that are not identifiable, and on a bad condition."""
    notices = []
    lost = (entry for entry in found.parameters if entry.verdict == NOT_IDENTIFIABLE)
    refused = [f"{entry.name}: {entry.reason}" for entry in lost]
    if refused:
        more = f"; and {len(refused) - _SHOWN} more" if len(refused) > _SHOWN else ""
        text = f"{len(refused)} of {len(found.parameters)} parameters are not identifiable by themselves "
        text += f"from these logs ({'; '.join(refused[:_SHOWN])}{more}). Accelerate every joint on its own; "
        text += "`symid excite` makes such motions"
        notices.append(("log.not-excited", text))
    faint = found.list_names(POORLY)
    if faint:
        # The worst first.
        percents = {entry.name: entry.relative_std_percent for entry in found.parameters}
        faint = tuple(sorted(faint, key=lambda name: -percents[name]))
        text = (
            f"{len(faint)} of {len(found.parameters)} parameters are poorly identifiable, with an expected "
        )
        text += (
            f"standard deviation above {POLICY.uncertain:g} % of the value ({shorten_names(faint, _SHOWN)})"
        )
        text += ". Use faster or longer motions, or leave them out"
        notices.append(("log.faint-parameters", text))
    if found.condition > _LARGE_CONDITION:
        text = f"the condition number is {found.condition:.3g}: noise in hardly excited combinations of "
        text += "parameters is amplified. Use a motion made by `symid excite`"
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
    they are needed; `output` is the file of an evenly sampled copy of the first log.
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
        text = "elastic joints: signs, order and excitation are checked for rigid joints only; `symid "
        text += "identify` lists what is not identifiable"
        return replace(checked, notices=(*notices, Notice(code="check.elastic", text=text)))
    library = prepare()
    progress("analysing the motion")
    studied: list[StudiedLog] = []
    reasons: list[Notice] = []
    for entry in checked.logs:
        try:
            studied.append(study_log(library, entry.recording, robot.processing))
        except (IdentifiabilityError, LogError) as error:
            reasons += error.notices
    if not studied:
        return replace(checked, errors=tuple(reasons))
    errors: tuple[Notice, ...] = ()
    checks = tuple(check_channels(log, library, robot) for log in studied)
    study, moving = studied[0].study, {joint for log in studied for joint in log.moving}
    if len(studied) > 1:
        study = study_logs(library, [log.recording for log in studied], robot.processing)
    excitation = analyse_excitation(library, study, moving)
    if excitation.empty:
        reason = "; ".join(f"{entry.name}: {entry.reason}" for entry in excitation.parameters[:8])
        text = f"no parameter is identifiable from these logs ({reason}): record logs in which joints "
        text += "accelerate"
        errors = (Notice(code="check.nothing", text=text),)
    elif excitation.poor:
        count, whole = len(excitation.list_names(NOT_IDENTIFIABLE)), len(excitation.parameters)
        known = whole - count - len(excitation.unknown)
        text = f"only {whole - count} of {whole} parameters are identifiable from these logs, for the "
        text += "reasons in the table. Record a log in which every joint accelerates on its own, add logs, "
        text += "or fit what is identifiable with `symid identify --partial`"
        if count <= (1.0 - POLICY.whole) * whole:
            text = f"a fit to these logs would know only {known} of {whole} parameters within "
            text += f"{POLICY.uncertain:g} %, or as small: state what the model lacks, such as friction, or "
            text += "record faster or longer motions"
        errors = (Notice(code="check.poor", text=text),)
    notices += (notice for check in checks for notice in check.notices)
    notices += (*reasons, *describe_excitation(excitation), *library.notices)
    return replace(checked, dynamics=checks, excitation=excitation, notices=tuple(notices), errors=errors)
