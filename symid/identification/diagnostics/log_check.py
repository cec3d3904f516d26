"""Check of logs before an identification: as they are, with the robot's dynamics, and their excitation.

Robot, logs, even with uneven time stamps -> `LogsCheck`; quick fits of the logs -> `LogExcitation`.

    expected deviation   s sqrt(diag (A'A)^-1),  A and s of rows weighted by the scatter of their joint

Of elastic joints only the quantities are checked. Not supported: bias by a term that the model lacks.
"""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.errors import IdentifiabilityError, LogError, Notice, UsageError
from symid.identification.diagnostics.log_channels import LogCheck, QuickFit, build_quick_fit, check_channels
from symid.identification.regression import WHOLE_MODEL, RankRule, compute_spectrum, solve_scaled
from symid.logs import (
    JointSummary,
    LogTiming,
    Recording,
    check_recording,
    describe_timing,
    measure_timing,
    read_raw,
    read_recordings,
    resample_if_uneven,
    resample_log,
    summarise_joints,
    write_raw_log,
)
from symid.robot import Robot
from symid.serialization import name_key

IDENTIFIABLE, POORLY, NOT_IDENTIFIABLE = "identifiable", "poorly identifiable", "not identifiable"
_WELL, _POOR = 10.0, 100.0
_LARGE_CONDITION = 1e3
_SHOWN = 8
_SMALL = 1e-7


@dataclass(frozen=True, slots=True, kw_only=True)
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
        return self.empty or kept < WHOLE_MODEL * len(self.parameters)


def analyse_excitation(fits: Sequence[QuickFit], joints: Sequence[str]) -> LogExcitation:
    """Return which parameters the logs behind `fits` excite, `joints` the names of the robot's joints."""
    rule = RankRule()
    matrix, values = _stack(fits)
    spectrum = compute_spectrum(matrix, rule.zero)
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
        verdicts.append(
            ParameterVerdict(name=name, verdict=verdict, relative_std_percent=percent, reason=reason)
        )
    largest = spectrum.singular[0] or 1.0
    return LogExcitation(
        parameters=tuple(verdicts),
        singular=tuple(float(value) for value in spectrum.singular / largest),
        rank=rank,
        condition=float(largest / spectrum.singular[rank - 1]) if rank else float("inf"),
    )


def _stack(fits: Sequence[QuickFit]) -> tuple[FloatArray, FloatArray]:
    """Return the rows of all moving joints of all logs, each weighted by the scatter of its residual."""

    def stack(weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        parts = [fit.stack_rows(weights[list(fit.moving)]) for fit in fits]
        # A joint at rest may be held by dry friction, so its rows stay out.
        matrix = np.vstack([rows[keep > 0.0] for rows, _, keep in parts])
        return matrix, np.concatenate([values[keep > 0.0] for _, values, keep in parts])

    def add(parts: Sequence[FloatArray]) -> FloatArray:
        return np.asarray(np.vstack(parts).sum(axis=0))

    matrix, values = stack(np.ones(fits[0].tau.shape[1]))
    first = solve_scaled(matrix, values, rcond=_SMALL)
    squares = add([(fit.keep * (fit.tau - fit.rows @ first)) ** 2 for fit in fits])
    sizes, counts = add([(fit.keep * fit.tau) ** 2 for fit in fits]), add([fit.keep for fit in fits])
    scatter = np.sqrt(np.maximum(squares, 1e-12 * sizes) / np.maximum(counts, 1.0))
    return stack(1.0 / np.where(scatter > 0.0, scatter, 1.0))


def describe_excitation(found: LogExcitation) -> tuple[Notice, ...]:
    """Return notices on parameters that are not identifiable, and on a bad condition."""
    notices = []
    refused = [entry for entry in found.parameters if entry.verdict == "refused"]
    if refused:
        listed = "; ".join(f"{entry.name}: {entry.reason}" for entry in refused[:_SHOWN])
        more = f"; and {len(refused) - _SHOWN} more" if len(refused) > _SHOWN else ""
        text = (
            f"{len(refused)} of {len(found.parameters)} parameters have no value of their own in these logs "
            f"({listed}{more}). Accelerate every joint on its own; `symid excite` makes such motions"
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
    """A log at even times, how it was sampled before, and what every joint does in it."""

    recording: Recording
    timing: LogTiming
    joints: tuple[JointSummary, ...]


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


def summarise_log(recording: Recording, robot: Robot) -> CheckedLog:
    """Return the log at even times, how it was sampled before, and what every joint does in it."""
    even = resample_if_uneven(recording)
    timing, joints = measure_timing(recording.time), summarise_joints(even, robot)
    return CheckedLog(recording=even, timing=timing, joints=joints)


def check_robot_logs(
    robot: Robot,
    logs: Sequence[Path | Recording],
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
    for recording in read_recordings(logs, robot, uneven=True):
        entry = summarise_log(recording, robot)
        notices += (*recording.notices, *describe_timing(recording.time, recording.source))
        notices += entry.recording.notices[len(recording.notices) :]
        notices += check_recording(entry.recording, robot)
        found.append(entry)
    copy = None
    if output is not None:
        log = logs[0]
        source = log if isinstance(log, Path) else Path(log.source)
        if isinstance(log, Recording) and not os.path.isfile(source):  # noqa: PTH113  any text may stand there
            text = "an evenly sampled copy is made of a log's file, and this log has none; save it first"
            raise UsageError(Notice(code="usage.no-file", text=text, file=log.source))
        raw, note = resample_log(read_raw(source), robot, str(source))
        copy = write_raw_log(raw, output), note
        notices.append(note)
    checked = LogsCheck(logs=tuple(found), copy=copy, notices=tuple(notices))
    if any(robot.elastic):
        text = (
            "elastic joints: signs, order and excitation are checked for rigid joints only; `symid identify` "
            "lists what is not identifiable"
        )
        note = Notice(code="check.elastic", text=text)
        return replace(checked, notices=(*checked.notices, note))
    library = prepare()
    progress("analysing the motion")
    return _add_dynamics(checked, library, robot)


def _add_dynamics(checked: LogsCheck, library: Library, robot: Robot) -> LogsCheck:
    """Return the same with the checks by the robot's dynamics."""
    fits: list[QuickFit] = []
    reasons: list[Notice] = []
    for entry in checked.logs:
        try:
            fits.append(build_quick_fit(library, entry.recording, robot.processing))
        except (IdentifiabilityError, LogError) as error:
            reasons += error.notices
    if not fits:
        return replace(checked, errors=tuple(reasons))
    errors: list[Notice] = []
    checks = tuple(check_channels(fit, library, robot) for fit in fits)
    excitation = analyse_excitation(fits, [joint.name for joint in robot.axes])
    if excitation.empty:
        reason = "; ".join(f"{entry.name}: {entry.reason}" for entry in excitation.parameters[:8])
        text = (
            f"no parameter is identifiable from these logs ({reason}): record logs in which joints accelerate"
        )
        errors.append(Notice(code="check.nothing", text=text))
    elif excitation.poor:
        count, whole = len(excitation.list_names("refused")), len(excitation.parameters)
        text = (
            f"only {whole - count} of {whole} parameters are identifiable from these logs, for the reasons "
            "in the table. Record a log in which every joint accelerates on its own, add logs, or fit what "
            "is identifiable with `symid identify --partial`"
        )
        errors.append(Notice(code="check.poor", text=text))
    return replace(
        checked,
        dynamics=checks,
        excitation=excitation,
        notices=(
            *checked.notices,
            *(notice for check in checks for notice in check.notices),
            *reasons,
            *describe_excitation(excitation),
            *library.notices,
        ),
        errors=tuple(errors),
    )
