"""Identification of friction: recordings to a law and its parameters for every joint that moves.

Input: a robot's functions, recordings, processing, options. Output: `FrictionIdentification`.

    Recording -> JointLogs -> FrictionSamples -> law (named, or chosen) -> FrictionEstimate -> pose test

Supported: motions of one joint or of several at once; several recordings, of several speeds or poses; a rigid
part that is fitted along or known; laws with a smoothed sign; mean periods of cosine motions.
Not supported: elastic joints; friction with a state.
"""

import difflib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace

import numpy as np

from symid.arrays import FloatArray
from symid.codegen.library import Library
from symid.data.cuts import cut_ends
from symid.data.recording import Recording
from symid.errors import IdentifiabilityError, Notice, UsageError
from symid.friction.estimate import FrictionEstimate
from symid.friction.estimators import ESTIMATORS, STOCHASTIC, fit_friction
from symid.friction.extraction import ExtractedJoint, JointLogs, extract_joint, prepare_joint_logs
from symid.friction.folding import fold_recording
from symid.friction.map import find_velocity_map
from symid.friction.options import FrictionOptions
from symid.friction.poses import find_pose_test
from symid.friction.reduction import find_rows
from symid.friction.results import FrictionIdentification, JointFriction
from symid.friction.samples import FrictionSamples
from symid.friction.selection import CANDIDATES, LawSelection, predict_rows, select_law
from symid.identification.estimate import Residual
from symid.joint.friction_law import FrictionLaw
from symid.joint.friction_laws import get_law
from symid.robot.log_map import Processing

__all__ = ["AUTO", "FrictionTask", "identify_friction"]

AUTO = "auto"
"""The name under which a law is chosen on what was held back."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionTask:
    """What is asked for.

    Args:
        model: name of a law, or `AUTO`; candidates: laws among which is chosen then.
        estimator: of the final fit, one of `ESTIMATORS`.
        options: of the estimators.
        beta: (p,) base parameters that are known, in the order of the model card; None to fit the rigid part.
        smoothing: speed v0 in rad/s or m/s over which all laws change their sign, 0 for a jump.
        period: of cosine motions in s, to average over their periods; None to leave logs as they are.
        poses: whether poses are compared where there are several.
    """

    model: str = AUTO
    candidates: tuple[str, ...] = CANDIDATES
    estimator: str = "varpro"
    options: FrictionOptions = field(default_factory=FrictionOptions)
    beta: FloatArray | None = None
    smoothing: float = 0.0
    period: float | None = None
    poses: bool = True


def identify_friction(
    library: Library,
    recordings: Sequence[Recording],
    processing: Processing,
    task: FrictionTask | None = None,
    *,
    echo: Mapping[str, object] | None = None,
) -> FrictionIdentification:
    """Return the friction of every joint that the recordings move.

    Args:
        library: the robot's functions.
        recordings: at least one, all of the same robot.
        processing: filter, cut ends and decimation, the same for all of them.
        task: what is asked for.
        echo: further settings to keep with the result.

    Raises:
        UsageError: no such law or estimator, or no recording.
        LogError: a recording does not fit the robot, or cannot be processed.
        IdentifiabilityError: nothing can be learnt of any joint.
        SolverError: a search ended without usable numbers.
    """
    task = task or FrictionTask()
    _check_task(task, recordings)
    notices: tuple[Notice, ...] = ()
    if task.period is not None:
        recordings, processing, notices = _fold(recordings, processing, task.period)
    logs = prepare_joint_logs(library, recordings, processing)
    joints: list[JointFriction] = []
    refused: list[tuple[str, str]] = []
    for joint, card in enumerate(library.card.joints):
        try:
            extracted = extract_joint(library, logs, joint, beta=task.beta)
            found = _identify_joint(library, logs, joint, extracted, task)
        except IdentifiabilityError as error:
            refused.append((card.name, "; ".join(entry.text for entry in error.notices)))
            continue
        joints.append(found)
        notices += (*extracted.notices, *(_name_joint(entry, card.name) for entry in found.estimate.notices))
    _check_told(joints, refused)
    notices += tuple(
        Notice(code="friction.joint-refused", text=f"no friction law: {reason}") for _, reason in refused
    )
    return FrictionIdentification(
        robot=library.card.robot,
        signature=library.card.signature,
        model=task.model,
        estimator=task.estimator,
        joints=tuple(joints),
        refused=tuple(refused),
        sources=tuple(recording.source for recording in recordings),
        settings=_echo(task, logs, echo or {}),
        notices=tuple(dict.fromkeys(notices)),
    )


def _check_task(task: FrictionTask, recordings: Sequence[Recording]) -> None:
    if not recordings:
        raise UsageError(Notice(code="usage.no-log", text="no log was given: name at least one"))
    if task.model != AUTO:
        get_law(task.model)
    if task.estimator not in ESTIMATORS:
        near = difflib.get_close_matches(task.estimator, ESTIMATORS, n=1, cutoff=0.4)
        hint = f"; did you mean {near[0]}?" if near else ";"
        text = (
            f"no estimator of friction is called {task.estimator!r}{hint} there are {', '.join(ESTIMATORS)}"
        )
        raise UsageError(Notice(code="usage.friction-estimator", text=text))


def _fold(
    recordings: Sequence[Recording], processing: Processing, period: float
) -> tuple[tuple[Recording, ...], Processing, tuple[Notice, ...]]:
    """Return mean periods, and the processing that uses the middle one of three copies."""
    cut = [cut_ends(entry, processing.drop_first, processing.drop_last) for entry in recordings]
    folded = [fold_recording(entry, period) for entry in cut]
    samples = min(entry.samples for entry in folded)
    notices = tuple(
        notice
        for entry in folded
        for notice in entry.recording.notices
        if notice.code in {"log.folded", "log.not-periodic"}
    )
    return (
        tuple(entry.recording for entry in folded),
        replace(processing, drop_first=samples, drop_last=samples),
        notices,
    )


def _identify_joint(
    library: Library, logs: JointLogs, joint: int, extracted: ExtractedJoint, task: FrictionTask
) -> JointFriction:
    samples, card = extracted.samples, library.card.joints[joint]
    selection: LawSelection | None = None
    name = task.model
    if name == AUTO:
        selection = select_law(
            samples, task.candidates, smoothing=task.smoothing, options=_keep_bounds(task.options)
        )
        name = selection.chosen
    law = get_law(name, smoothing=task.smoothing)
    generator = np.random.default_rng(task.options.seed) if task.estimator in STOCHASTIC else None
    estimate = fit_friction(samples, law, estimator=task.estimator, options=task.options, generator=generator)
    estimate = _refuse_unseen(samples, law, estimate)
    runs = logs.find_moving(joint)
    return JointFriction(
        estimate=estimate,
        formula=law.formula,
        smoothing=task.smoothing,
        unit=card.torque_unit,
        velocity_unit=f"{card.position_unit}/s",
        rigid=extracted.rigid,
        residual=_find_residual(samples, law, estimate, card.torque_unit),
        selection=selection,
        poses=find_pose_test(library, logs, joint, law, beta=task.beta) if task.poses else None,
        velocity_map=find_velocity_map(samples, estimate.other),
        sources=tuple(logs.sources[run] for run in runs),
    )


def _keep_bounds(options: FrictionOptions) -> FrictionOptions:
    """Return the options for laws of all kinds: bounds by name hold for one law."""
    return replace(options, bounds=())


def _refuse_unseen(
    samples: FrictionSamples, law: FrictionLaw, estimate: FrictionEstimate
) -> FrictionEstimate:
    """Return the estimate without what lies below the slowest row that was kept."""
    slowest = float(np.min(np.abs(find_rows(samples).velocity)))
    shapes = [entry.name for entry in law.shape]
    if "vs" not in shapes or estimate.shape[shapes.index("vs")] >= slowest:
        return estimate
    place = len(law.linear) + shapes.index("vs")
    lost = {place, *(k for k, entry in enumerate(law.linear) if entry.name.startswith("Fs"))}
    hanging = {
        entry.name for entry, row in zip(law.physical, law.mixing, strict=True) if any(row[k] for k in lost)
    }
    gone = [entry.name for entry in estimate.parameters if entry.name in hanging]
    if not gone:
        return estimate
    unit = "m/s" if samples.prismatic else "rad/s"
    reason = f"no row is slower than the Stribeck velocity: the slowest moves at {slowest:.3g} {unit}"
    return replace(
        estimate,
        parameters=tuple(entry for entry in estimate.parameters if entry.name not in hanging),
        refused=(*estimate.refused, *((name, reason) for name in gone)),
        notices=(
            *estimate.notices,
            *(Notice(code="friction.refused", text=f"{name} gets no number: {reason}") for name in gone),
        ),
    )


def _find_residual(
    samples: FrictionSamples, law: FrictionLaw, estimate: FrictionEstimate, unit: str
) -> Residual:
    rows = find_rows(samples)
    norm = float(np.linalg.norm(rows.torque - predict_rows(samples, law, estimate)))
    whole = float(np.linalg.norm(rows.torque))
    return Residual(
        joint=samples.joint,
        norm=norm,
        relative_percent=100.0 * norm / whole if whole else float("inf"),
        std=estimate.sigma,
        samples=len(rows.torque),
        unit=unit,
    )


def _name_joint(notice: Notice, joint: str) -> Notice:
    return replace(notice, text=f"joint {joint!r}: {notice.text}")


def _check_told(joints: Sequence[JointFriction], refused: Sequence[tuple[str, str]]) -> None:
    """Refuse a result without a single number.

    Raises:
        IdentifiabilityError: no parameter of friction of any joint can be learnt.
    """
    if any(entry.estimate.parameters for entry in joints):
        return
    reasons = [reason for _, reason in refused]
    for entry in joints:
        told = "; ".join(f"{name}: {reason}" for name, reason in entry.estimate.refused)
        reasons.append(f"joint {entry.joint!r}, law {entry.estimate.law}: {told}")
    raise IdentifiabilityError(*(Notice(code="friction.nothing", text=text) for text in reasons))


def _echo(task: FrictionTask, logs: JointLogs, echo: Mapping[str, object]) -> Mapping[str, object]:
    """Return the settings as JSON would give them back, so that a stored result equals its origin."""
    settings = {
        **echo,
        "processing": asdict(logs.processing),
        "model": task.model,
        "estimator": task.estimator,
        "smoothing": task.smoothing,
        "period": task.period,
        "rigid": "fitted along" if task.beta is None else "known",
        "seed": task.options.seed,
    }
    plain: dict[str, object] = json.loads(json.dumps(settings))
    return plain
