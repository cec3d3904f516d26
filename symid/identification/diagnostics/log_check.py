"""Check of logs before an identification: as they are, with the robot's dynamics, and what they excite.

Robot, logs -> `LogsCheck`; quick fits of the logs -> `LogExcitation`, a verdict and a reason for each base
parameter.

    time stamps -> even times -> quantities -> signs, order, delay -> excitation

    expected deviation   s sqrt(diag (A'A)^-1),  A and s of rows weighted by the scatter of their joint

Supported: several logs of one robot, with uneven time stamps; rigid joints. Of elastic joints, whose
torsion is no part of the rigid model, only the quantities are looked at.
Not supported: a verdict on bias: a term that the model lacks is not seen here.
"""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen import Library
from symid.errors import IdentifiabilityError, LogError, Notice, UsageError
from symid.identification.diagnostics.log_channels import (
    Exchange,
    JointSigns,
    QuickFit,
    TorqueDelay,
    build_quick_fit,
    describe_delay,
    describe_exchanges,
    describe_signs,
    describe_sizes,
    detect_exchanges,
    estimate_signs,
    estimate_torque_delay,
)
from symid.identification.regression import (
    WHOLE_MODEL,
    RankRule,
    ScaledSpectrum,
    compute_spectrum,
    solve_scaled,
)
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

_WELL, _POOR = 10.0, 100.0
_LARGE_CONDITION = 1e3
_SHOWN = 8
_SMALL = 1e-7


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterVerdict:
    """What logs say of one parameter: "told", "vague", "not told" or "refused", the reason where not told.

    `relative_std_percent` is the deviation that an identification may be expected to have, of the value.
    """

    name: str
    verdict: str
    relative_std_percent: float
    reason: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class LogExcitation:
    """Verdicts on all parameters; singular values (falling, largest 1), rank, condition up to the rank."""

    parameters: tuple[ParameterVerdict, ...]
    singular: tuple[float, ...]
    rank: int
    condition: float

    def list_names(self, *verdicts: str) -> tuple[str, ...]:
        """Return the names of the parameters with one of these verdicts."""
        return tuple(entry.name for entry in self.parameters if entry.verdict in verdicts)

    @property
    def empty(self) -> bool:
        """Return whether the logs tell nothing."""
        return not self.list_names("told", "vague")

    @property
    def poor(self) -> bool:
        """Return whether the logs tell too few parameters for a model of the whole robot."""
        told = len(self.parameters) - len(self.list_names("refused"))
        return self.empty or told < WHOLE_MODEL * len(self.parameters)


def analyse_excitation(
    fits: Sequence[QuickFit], joints: Sequence[str], rule: RankRule | None = None
) -> LogExcitation:
    """Return what the logs behind `fits` tell, `joints` the names of the robot's joints."""
    rule = rule or RankRule()
    matrix, values = _stack(fits)
    spectrum = compute_spectrum(matrix, rule.zero)
    seen, identifiable = spectrum.mask_seen(rule), spectrum.mask_identifiable(rule)
    solution, deviations = _compute_deviations(matrix, values, spectrum, seen)
    names = fits[0].names
    resting = [name for index, name in enumerate(joints) if all(index not in fit.moving for fit in fits)]
    still = f"; at rest: {', '.join(resting)}" if resting else ""
    verdicts = []
    for index, name in enumerate(names):
        if identifiable[index]:
            percent = 100.0 * float(deviations[index]) / max(abs(float(solution[index])), 1e-300)
            verdict = "told" if percent <= _WELL else "vague" if percent <= _POOR else "not told"
            reason = "" if verdict == "told" else "it is small beside the noise, or hardly excited"
        else:
            percent, verdict = float("inf"), "refused"
            if spectrum.lengths[index]:
                others = ", ".join(names[k] for k in spectrum.list_partners(index, rule)[:4])
                reason = f"it acts only together with {others}{still}"
            else:
                reason = f"it acts on no torque of this log{still}"
        verdicts.append(
            ParameterVerdict(name=name, verdict=verdict, relative_std_percent=percent, reason=reason)
        )
    largest = spectrum.singular[0] or 1.0
    rank = int(np.sum(seen))
    return LogExcitation(
        parameters=tuple(verdicts),
        singular=tuple(float(value) for value in spectrum.singular / largest),
        rank=rank,
        condition=float(largest / spectrum.singular[rank - 1]) if rank else float("inf"),
    )


def _stack(fits: Sequence[QuickFit]) -> tuple[FloatArray, FloatArray]:
    """Return the rows of all moving joints of all logs, each weighted by the scatter of its residual."""
    plain = [_list_rows(fit, np.ones(fit.tau.shape[1])) for fit in fits]
    matrix, values = np.vstack([part[0] for part in plain]), np.concatenate([part[1] for part in plain])
    first = solve_scaled(matrix, values, rcond=_SMALL)
    squares = _add([(fit.keep * (fit.tau - fit.rows @ first)) ** 2 for fit in fits])
    sizes, counts = _add([(fit.keep * fit.tau) ** 2 for fit in fits]), _add([fit.keep for fit in fits])
    scatter = np.sqrt(np.maximum(squares, 1e-12 * sizes) / np.maximum(counts, 1.0))
    weights = 1.0 / np.where(scatter > 0.0, scatter, 1.0)
    parts = [_list_rows(fit, weights) for fit in fits]
    return np.vstack([part[0] for part in parts]), np.concatenate([part[1] for part in parts])


def _list_rows(fit: QuickFit, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return matrix and values; a joint at rest may be held by dry friction, so its rows stay out."""
    joints = list(fit.moving)
    factor = (fit.keep * weights)[:, joints].ravel()
    kept = factor > 0.0
    matrix = fit.rows[:, joints].reshape(-1, fit.rows.shape[2])[kept]
    return matrix * factor[kept, None], fit.tau[:, joints].ravel()[kept] * factor[kept]


def _add(parts: Sequence[FloatArray]) -> FloatArray:
    """Return the sums (n,) over the samples of all parts (N, n)."""
    total: FloatArray = np.vstack(parts).sum(axis=0)
    return total


def _compute_deviations(
    matrix: FloatArray, values: FloatArray, spectrum: ScaledSpectrum, seen: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray]:
    """Return the fit (p,) over the directions seen, and its standard deviations."""
    basis = spectrum.scales[:, None] * spectrum.directions[seen].T
    inner = basis / spectrum.singular[seen]
    solution: FloatArray = inner @ (inner.T @ (matrix.T @ values))
    errors = values - matrix @ solution
    freedom = max(1, len(values) - int(np.sum(seen)))
    deviations: FloatArray = np.sqrt(float(errors @ errors) / freedom * np.sum(inner**2, axis=1))
    return solution, deviations


def describe_excitation(found: LogExcitation, file: str = "") -> tuple[Notice, ...]:
    """Return notices on what the logs cannot tell, and on a bad condition."""
    notices = []
    refused = [entry for entry in found.parameters if entry.verdict == "refused"]
    if refused:
        listed = "; ".join(f"{entry.name}: {entry.reason}" for entry in refused[:_SHOWN])
        more = f"; and {len(refused) - _SHOWN} more" if len(refused) > _SHOWN else ""
        text = (
            f"{len(refused)} of {len(found.parameters)} parameters cannot be told from these logs "
            f"({listed}{more}); move every joint with accelerations of its own; "
            "`symid excite` makes such motions"
        )
        notices.append(("log.not-excited", text))
    faint = found.list_names("not told")
    if faint:
        text = (
            f"{len(faint)} parameters drown in the noise ({', '.join(faint[:_SHOWN])}"
            f"{', ...' if len(faint) > _SHOWN else ''}): expected deviations are above {_POOR:g} % of "
            "the value; faster or longer motions tell more, or leave them out"
        )
        notices.append(("log.faint-parameters", text))
    if found.condition > _LARGE_CONDITION:
        text = (
            f"the condition number is {found.condition:.3g}: combinations of parameters are hardly "
            "excited, and noise in them is amplified; use a motion made by `symid excite`"
        )
        notices.append(("log.condition", text))
    return tuple(Notice(code=code, text=text, file=file) for code, text in notices)


@dataclass(frozen=True, slots=True, kw_only=True)
class LogCheck:
    """What dynamics says of one log: signs of moving joints, exchanged columns, delay of the torque."""

    source: str
    signs: tuple[JointSigns, ...]
    exchanges: tuple[Exchange, ...]
    delay: TorqueDelay | None
    notices: tuple[Notice, ...]


def check_logs(
    library: Library, recordings: Sequence[Recording], robot: Robot
) -> tuple[tuple[LogCheck, ...], LogExcitation, tuple[Notice, ...]]:
    """Return the check of each log that moves, what all of them excite, and notices on the whole.

    Raises:
        IdentifiabilityError: no log has a joint that moves.
    """
    fits: list[QuickFit] = []
    reasons: list[Notice] = []
    for recording in recordings:
        try:
            fits.append(build_quick_fit(library, recording, robot.processing))
        except (IdentifiabilityError, LogError) as error:
            reasons += error.notices
    if not fits:
        raise IdentifiabilityError(*reasons)
    checks = tuple(_check_log(fit, library, robot) for fit in fits)
    excitation = analyse_excitation(fits, [joint.name for joint in robot.axes])
    return checks, excitation, (*reasons, *describe_excitation(excitation))


def _check_log(fit: QuickFit, library: Library, robot: Robot) -> LogCheck:
    file = fit.recording.source
    signs = estimate_signs(fit, library, robot)
    notices = describe_signs(signs, robot, file)
    exchanges: tuple[Exchange, ...] = ()
    delay: TorqueDelay | None = None
    if not notices:
        # With a wrong sign neither order nor delay means anything.
        exchanges = detect_exchanges(fit, library)
        notices = (*describe_exchanges(exchanges, robot, file), *describe_sizes(signs, robot, file))
    if not notices:
        delay = estimate_torque_delay(fit)
        notices = describe_delay(delay, file)
    return LogCheck(source=file, signs=signs, exchanges=exchanges, delay=delay, notices=notices)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CheckedLog:
    """A log as it is.

    Attributes:
        recording: at even times. timing: how it was sampled before. joints: what every joint does in it.
    """

    recording: Recording
    timing: LogTiming
    joints: tuple[JointSummary, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LogsCheck:
    """What was found in logs.

    Attributes:
        logs: each as it is.
        copy: the file of an evenly sampled copy and what was done for it, where one was asked for.
        dynamics: what the robot's dynamics says of each log that moves; empty for elastic joints.
        excitation: what all logs together say of every parameter; None for elastic joints and logs at rest.
        notices: what is odd, with what to do. errors: why the logs are not enough for a model.
    """

    logs: tuple[CheckedLog, ...] = ()
    copy: tuple[Path, Notice] | None = None
    dynamics: tuple[LogCheck, ...] = ()
    excitation: LogExcitation | None = None
    notices: tuple[Notice, ...] = ()
    errors: tuple[Notice, ...] = ()


def check_robot_logs(
    robot: Robot,
    logs: Sequence[Path | Recording],
    *,
    prepare: Callable[[], Library],
    progress: Callable[[str], None],
    output: Path | None = None,
) -> LogsCheck:
    """Return what is odd in logs, and which parameters are identifiable from all of them together.

    Args:
        robot: the robot.
        logs: files, files of runs, or what was read before.
        prepare: returns the robot's functions, where they are needed.
        progress: told what begins.
        output: of an evenly sampled copy of the first log, a file.

    Raises:
        LogError: with what is wrong with any of the logs.
        OutputError: the copy cannot be written.
    """
    progress(f"reading {len(logs)} log{'s'[: len(logs) > 1]}")
    found: list[CheckedLog] = []
    notices: list[Notice] = []
    for recording in read_recordings(logs, robot, uneven=True):
        even = resample_if_uneven(recording)
        notices += (*recording.notices, *describe_timing(recording.time, recording.source))
        notices += (*even.notices[len(recording.notices) :], *check_recording(even, robot))
        timing, joints = measure_timing(recording.time), summarise_joints(even, robot)
        found.append(CheckedLog(recording=even, timing=timing, joints=joints))
    copy = None if output is None else _write_even(logs[0], robot, output)
    if copy is not None:
        notices.append(copy[1])
    checked = LogsCheck(logs=tuple(found), copy=copy, notices=tuple(notices))
    return _add_dynamics(checked, robot, prepare, progress)


def _write_even(log: Path | Recording, robot: Robot, output: Path) -> tuple[Path, Notice]:
    """Write an evenly sampled copy of a log with its own columns, and say what was done."""
    source = log if isinstance(log, Path) else Path(log.source)
    if isinstance(log, Recording) and not os.path.isfile(source):  # noqa: PTH113  any text may stand there
        text = "an evenly sampled copy is made of a log's file, and this log has none; save it first"
        raise UsageError(Notice(code="usage.no-file", text=text, file=log.source))
    copy, notice = resample_log(read_raw(source), robot, str(source))
    return write_raw_log(copy, output), notice


def _add_dynamics(
    checked: LogsCheck, robot: Robot, prepare: Callable[[], Library], progress: Callable[[str], None]
) -> LogsCheck:
    """Return the same with what the robot's dynamics says of the logs."""
    if any(robot.elastic):
        skipped = "joints give: signs, order and excitation are looked at for rigid joints only"
        note = Notice(code="check.elastic", text=f"{skipped}; `symid identify` says what it cannot tell")
        return replace(checked, notices=(*checked.notices, note))
    library = prepare()
    progress("looking at the motion")
    try:
        checks, excitation, notices = check_logs(library, [entry.recording for entry in checked.logs], robot)
    except IdentifiabilityError as error:
        return replace(checked, errors=error.notices)
    said = (notice for check in checks for notice in check.notices)
    return replace(
        checked,
        dynamics=checks,
        excitation=excitation,
        notices=(*checked.notices, *said, *notices, *library.notices),
        errors=(_say_poor(excitation),) if excitation.poor else (),
    )


def _say_poor(excitation: LogExcitation) -> Notice:
    """Return why the logs are not enough for a model of the robot."""
    if excitation.empty:
        reason = "; ".join(f"{entry.name}: {entry.reason}" for entry in excitation.parameters[:8])
        what = "record one in which every joint accelerates"
        text = f"nothing can be learnt from these logs ({reason}): {what}"
        return Notice(code="check.nothing", text=text)
    count, whole = len(excitation.list_names("refused")), len(excitation.parameters)
    text = (
        f"these logs tell only {whole - count} of {whole} parameters, too few for a model of this robot; the "
        "table says why: record one in which every joint accelerates on its own, or check it together with "
        "further logs; `symid identify --partial` fits what can be told"
    )
    return Notice(code="check.poor", text=text)
