"""The payload of a robot, from estimates or logs with the payload and without it.

Robot, for both sides an estimate or logs -> `PayloadFinding`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path

from symid.codegen import Library
from symid.dynamics import (
    BaseParameters,
    BaseValues,
    Payload,
    build_base_values,
    derive_base_parameters,
    estimate_payload,
)
from symid.errors import EstimateError, Notice, UsageError
from symid.identification.estimators import Estimate, ParameterEstimate
from symid.identification.friction_search import identify_loaded
from symid.identification.identified import build_identified
from symid.identification.rigid import identify_parameters
from symid.identification.stored import GivenResult, is_fit, read_dynamics
from symid.logs import Recording, check_distinct, check_distinct_samples, read_recordings
from symid.robot import Robot, describe_settings

GivenSide = Sequence[GivenResult | Recording]
"""One estimate, or logs: each itself, or its file."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PayloadTask:
    """The options, and the services they need.

    Args:
        joint: whose link carries the payload, None for the last one; mass: kg, where it was weighed.
        rows: of logs: how measurements become equations; estimator: how equations become parameters.
        prepare: returns the robot's compiled functions.
        progress: called with a short text on what begins.
    """

    joint: str | None
    mass: float | None
    rows: str
    estimator: str
    prepare: Callable[[], Library]
    progress: Callable[[str], None]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PayloadFinding:
    """The payload, the robot that carries it, and the notices of both sides."""

    robot: Robot
    payload: Payload
    notices: tuple[Notice, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Side:
    robot: Robot
    base: BaseParameters
    values: BaseValues
    notices: tuple[Notice, ...]


def identify_payload(robot: Robot, loaded: GivenSide, empty: GivenSide, task: PayloadTask) -> PayloadFinding:
    """Return what the robot carries in `loaded` and not in `empty`.

    Raises:
        UsageError: a file is given twice, or estimates among logs, or there is no such joint.
        EstimateError: an estimate is of another model, or both sides are not of the same.
        LogError: a log cannot be used.
        IdentifiabilityError: no parameter is identifiable from the logs, or no payload is significant.
    """
    check_distinct([Path(entry) for entry in (*loaded, *empty) if isinstance(entry, str | PathLike)])
    first = _read_side("with the payload", robot, loaded, task)
    second = _read_side("without it", robot, empty, task)
    if first.robot.elastic != second.robot.elastic:
        text = "one side has elastic joints and the other rigid ones; identify both by the same method"
        raise EstimateError(Notice(code="payload.other-model", text=text))
    found = estimate_payload(
        first.robot, first.base, first.values, second.values, joint=task.joint, mass=task.mass
    )
    return PayloadFinding(robot=first.robot, payload=found, notices=(*first.notices, *second.notices))


def _read_side(name: str, robot: Robot, given: GivenSide, task: PayloadTask) -> _Side:
    """Return the base values of an estimate, or of logs; notices of their identification name the side."""
    logs: list[Path | Recording] = []
    estimates: list[GivenResult] = []
    for entry in given:
        if isinstance(entry, Recording):
            logs.append(entry)
        elif isinstance(entry, str | PathLike) and not is_fit(Path(entry)):
            logs.append(Path(entry))
        else:
            estimates.append(entry)
    if not estimates:
        side = _identify(robot, logs, task)
    elif len(given) > 1:
        first = estimates[0] if isinstance(estimates[0], str | PathLike) else "a fit"
        text = (
            f"{first} is an estimate: give one estimate, or logs (`symid identify` makes one of several logs)"
        )
        raise UsageError(Notice(code="usage.payload-inputs", text=text))
    else:
        found = build_identified(robot, *read_dynamics(estimates[0]))
        values = _build_values(found.values, found.covariance)
        notices = (*found.robot.notices, *found.notices)
        side = _Side(robot=found.robot, base=found.base, values=values, notices=notices)
    named = (
        replace(note, text=f"{name}: {note.text}") if note.code.startswith("identify") else note
        for note in side.notices
    )
    return replace(side, notices=tuple(named))


def _identify(robot: Robot, logs: Sequence[Path | Recording], task: PayloadTask) -> _Side:
    """Return the base values identified from logs."""
    if any(robot.elastic):
        text = "the robot has elastic joints: identify both sets of logs first, and give the estimates"
        raise UsageError(Notice(code="usage.payload-elastic", text=text, file=robot.path))
    recordings = read_recordings(logs, robot)
    check_distinct_samples(recordings)
    library = task.prepare()
    names = ", ".join(Path(entry.source).name for entry in recordings)
    task.progress(f"identifying {robot.name} from {names}")

    def fit(logs: Sequence[Recording]) -> Estimate:
        return identify_parameters(
            library,
            logs,
            robot.processing,
            rows=task.rows,
            estimator=task.estimator,
            echo={"log": describe_settings(robot)["log"]},
        )

    # Friction that grows with the load is no payload.
    estimate = identify_loaded(library, recordings, robot.processing, fit)
    said = (note for recording in recordings for note in recording.notices)
    return _Side(
        robot=robot,
        base=derive_base_parameters(robot),
        values=_build_values(estimate.parameters, estimate.covariance),
        notices=(*robot.notices, *said, *estimate.notices),
    )


def _build_values(entries: Sequence[ParameterEstimate], covariance: Sequence[Sequence[float]]) -> BaseValues:
    return build_base_values(
        [entry.name for entry in entries],
        [entry.value for entry in entries],
        [entry.std for entry in entries],
        covariance,
    )
