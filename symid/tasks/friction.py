"""From a robot and its recordings to a law of friction, and its parameters, for every joint that moves.

Input: a robot, recordings, what is asked for. Output: `FrictionOutcome`.

Supported: elastic robots, whose friction is found on the motor side with a rigid model.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from symid.arrays import FloatArray
from symid.codegen.library import Library
from symid.data.logs import find_digests
from symid.data.recording import Recording
from symid.data.runs import refuse_loads
from symid.elastic.motor_side import build_motor_recording, build_rigid_variant
from symid.errors import EstimateError, Notice
from symid.estimators.estimate import Estimate
from symid.formats.settings import describe_settings
from symid.friction.estimators import STOCHASTIC
from symid.friction.identify import AUTO, FrictionTask, identify_friction
from symid.friction.options import FrictionOptions
from symid.friction.results import FrictionIdentification, is_friction_result
from symid.identification.estimator_options import find_estimate
from symid.robot.description import Robot
from symid.tasks.identify import Workshop, list_log_notices

__all__ = ["FrictionOutcome", "FrictionRequest", "identify_robot_friction"]


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionRequest:
    """What is asked for; None where the default holds.

    Args:
        model: a law, or "auto" to choose one by torques held back.
        estimator: how laws are fitted; varpro by default.
        known: base parameters to subtract, an estimate or its file; else the rigid part is fitted along.
        smoothing: rad/s or m/s over which dry friction changes its sign.
        period: s, of the motion, once or once a log, to average over periods.
        seed: of a stochastic estimator.
        friction: the friction model of all joints that was asked for; only to say whether it had a part.
        options: of the estimators; `seed` wins over theirs.
    """

    model: str | None = None
    estimator: str | None = None
    known: Estimate | Path | None = None
    smoothing: float | None = None
    period: tuple[float, ...] = ()
    seed: int | None = None
    friction: str | None = None
    options: FrictionOptions = field(default_factory=FrictionOptions)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrictionOutcome:
    """Friction of all joints that move, what a reader should know, and what computed the functions."""

    result: FrictionIdentification
    notices: tuple[Notice, ...]
    backend: str


def identify_robot_friction(
    robot: Robot, recordings: Sequence[Recording], request: FrictionRequest, workshop: Workshop
) -> FrictionOutcome:
    """Return the friction of every joint that the recordings move.

    Args:
        robot: with the settings of the call.
        recordings: at least one.
        request: what is asked for.
        workshop: library and progress.

    Raises:
        UsageError: no such law or estimator; a smoothing that the law has no use for.
        LogError: a recording does not fit the robot, carries a known payload, or has another period.
        EstimateError: the known parameters are of another model.
        IdentifiabilityError: nothing can be learnt of any joint.
        SolverError: a search ended without usable numbers.
    """
    refuse_loads(recordings, "--rows friction")
    described = build_rigid_variant(robot) if any(robot.elastic) else robot
    measured = [build_motor_recording(recording, robot) for recording in recordings]
    library = workshop.prepare(described)
    model = request.model or AUTO
    what = "choosing and fitting a friction law" if model == AUTO else f"fitting the friction law {model}"
    workshop.progress(f"{what} for {robot.name} from {len(measured)} log{'s'[: len(measured) > 1]}")
    beta = _read_known(request.known, library)
    options = request.options if request.seed is None else replace(request.options, seed=request.seed)
    task = FrictionTask(
        model=model,
        estimator=request.estimator or "varpro",
        options=options,
        beta=beta,
        smoothing=request.smoothing or 0.0,
        periods=request.period,
    )
    found = identify_friction(
        library, measured, described.processing, task, echo=_describe(robot, library, measured, request, beta)
    )
    notices = (
        *list_log_notices(robot, recordings),
        *_warn_of_springs(robot),
        *library.notices,
        *found.notices,
        *_warn_of_unused(found, request, library),
    )
    return FrictionOutcome(result=found, notices=notices, backend=library.backend)


def _describe(
    robot: Robot,
    library: Library,
    recordings: Sequence[Recording],
    request: FrictionRequest,
    beta: FloatArray | None,
) -> Mapping[str, object]:
    known = None
    if request.known is not None:
        known = str(request.known) if isinstance(request.known, Path) else "an estimate in memory"
    return {
        "log": describe_settings(robot)["log"],
        "log_digests": find_digests(recordings),
        "known": known,
        "known_values": None if beta is None else _name_known(beta, library),
        "friction": [joint.friction for joint in library.card.joints],
    }


def _read_known(known: Estimate | Path | None, library: Library) -> FloatArray | None:
    if known is None:
        return None
    if isinstance(known, Path) and is_friction_result(known):
        text = (
            "this is friction found with --rows friction; --known takes the base parameters that "
            "`symid identify ROBOT LOG... -o FILE` finds without --rows friction"
        )
        raise EstimateError(Notice(code="estimate.friction", text=text, file=str(known)))
    estimate = find_estimate(known, library.card)
    return estimate.assemble(tuple(entry.name for entry in library.card.beta))


def _name_known(beta: FloatArray, library: Library) -> dict[str, float]:
    return {entry.name: float(value) for entry, value in zip(library.card.beta, beta, strict=True)}


def _warn_of_unused(
    found: FrictionIdentification, request: FrictionRequest, library: Library
) -> tuple[Notice, ...]:
    """Return a notice for every option that had no part in the result."""
    texts = []
    if request.seed is not None and found.estimator not in STOCHASTIC:
        texts.append(
            f"--seed has no part in this result: {found.estimator} draws nothing at random; "
            f"{', '.join(sorted(STOCHASTIC))} do"
        )
    others = {entry.name for entry in library.card.friction}
    beside = {
        name
        for joint in found.joints
        for name in (
            *(entry.name for entry in joint.estimate.extra),
            *(name for name, _ in joint.estimate.refused),
        )
    }
    if request.friction and not others & beside:
        texts.append(
            "--friction has no part in this result: no joint's friction acts on another here; the law of a "
            "joint's own friction is that of --model"
        )
    return tuple(Notice(code="friction.unused-option", text=text) for text in texts)


def _warn_of_springs(robot: Robot) -> tuple[Notice, ...]:
    if not any(robot.elastic):
        return ()
    text = (
        f"robot {robot.name!r} gives between motor and link: friction was fitted to the motor side with a "
        "rigid model; what springs lose is counted as friction"
    )
    return (Notice(code="friction.elastic", text=text),)
