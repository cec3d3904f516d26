"""Identification of friction: recordings to a law and its parameters for every joint that moves, and robots.

Library, recordings, processing, FrictionTask -> FrictionIdentification; JointFriction -> FrictionValues, or
why there are none. Robot files name friction relative to its Coulomb level, as the columns of the laws do:
Fe = fS - fC. All laws can be exported, without refused values.

    Recording -> JointLogs -> FrictionSamples -> law (named, or chosen) -> FrictionEstimate -> pose test

Validation is what identified friction predicts of a log that it was not fitted to, on rows as in the fit:

    tau^ = Phi(dq; shape) linear + X other,    relative residual = |R (tau - tau^)| / |R tau|

X are the columns that were fitted along; known base parameters are subtracted from tau, as in the fit.
Laws with a state (`presliding`) are candidates where slow rows carry much of what is left; they fit all rows.
Not supported: elastic joints; joints whose rigid part was left open; poses of laws with a state.
"""

import json
import math
from collections.abc import Callable, Mapping, Sequence, Sized
from dataclasses import dataclass, field, replace
from functools import partial
from typing import ClassVar, final

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen import Library, ModelCard
from symid.errors import EstimateError, IdentifiabilityError, LogError, Notice, UsageError
from symid.identification import estimators, regression
from symid.identification.diagnostics import build_warning
from symid.identification.friction import extraction, joint_fit
from symid.identification.friction.estimators import DEFAULT_ESTIMATOR, check_estimator, fit_friction
from symid.identification.friction.extraction import ExtractedJoint, JointLogs
from symid.identification.friction.joint_fit import FrictionEstimate, FrictionSamples
from symid.identification.friction.poses import PoseTest, compare_poses, warn_of_friction_pattern
from symid.identification.friction.searches import FrictionOptions
from symid.identification.friction.selection import (
    CANDIDATE_LAWS,
    measure_motion,
    predict_rows,
    select_law,
    select_memory,
)
from symid.identification.judge import POLICY
from symid.joint_models import NO_FRICTION, FrictionLaw, FrictionValues, get_law, has_sign, rename_law
from symid.logs import Recording, cut_ends, describe_overlap, measure_overlap
from symid.robot import Processing, Robot, override_robot
from symid.serialization import HIDDEN, name_key, write_json

AUTO = "auto"
"""In place of a law's name: it is chosen on held-out data."""
_NOT_PERIODIC = "log.not-periodic"


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class JointFriction:
    """Friction of one joint.

    Args:
        estimate: the law's parameters and their uncertainty.
        formula: of the law, in words; smoothing: v0 of its sign in rad/s or m/s, 0 for the sign.
        unit: of the torque; rigid: how the rigid part of the torque was treated.
        residual: of the logs it was fitted to; motion: the same in motion, at reversal and at rest, with the
            rows that were left out as slow.
        selection: how the law was chosen; None where it was named.
        poses: whether friction depends on the pose; None where one pose was recorded.
        velocity_map: friction torque against velocity, as measured.
        sources: the logs in which the joint moves.
    """

    estimate: FrictionEstimate = field(metadata=HIDDEN)
    formula: str
    smoothing: float
    unit: str = field(metadata=HIDDEN)
    velocity_unit: str = field(metadata=HIDDEN)
    rigid: str
    residual: estimators.Residual
    selection: estimators.LawSelection | None
    poses: PoseTest | None
    velocity_map: joint_fit.VelocityMap = field(metadata=name_key("map"))
    sources: tuple[str, ...]
    motion: estimators.MotionResidual | None = None

    @property
    def joint(self) -> str:
        """Return the joint's name."""
        return self.estimate.joint

    def __repr__(self) -> str:
        """Return joint, law and parameters in one line."""
        values = ", ".join(map(str, self.estimate.parameters))
        return f"<JointFriction {self.joint}: {self.estimate.law}; {values}>"


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionIdentification(estimators.FitRecord):
    """Friction of the joints that move, `refused` the others; `model` is the law asked for, or "auto"."""

    kind: ClassVar[str] = "friction"
    model: str
    estimator: str
    joints: tuple[JointFriction, ...]

    def list_mistakes(self) -> list[str]:
        """Return arrays of a record that do not fit a law or each other; raise UsageError for no law."""
        mistakes = [text for joint in self.joints for text in _list_mistakes(joint)]
        return mistakes if self.joints else ["joints is empty"]

    def list_strangers(self, card: ModelCard) -> list[str]:
        """Return joints that are not those of the model, or given twice."""
        known, given = [joint.name for joint in card.joints], [entry.joint for entry in self.joints]
        wrong = [name for name in dict.fromkeys(given) if name not in known or given.count(name) > 1]
        names = ", ".join(map(repr, wrong))
        return [f"{names} must be joints of robot {card.robot!r}, each once"] if wrong else []


def _list_mistakes(joint: JointFriction) -> list[str]:
    estimate, curve = joint.estimate, joint.velocity_map
    law = get_law(estimate.law, smoothing=joint.smoothing)
    size = len(law.linear) + len(law.shape) + len(estimate.other)
    # What has entries, and how many it must have.
    lengths: dict[str, tuple[Sized, int]] = {
        "estimate.linear": (estimate.linear, len(law.linear)),
        "estimate.shape": (estimate.shape, len(law.shape)),
        "estimate.covariance": (estimate.covariance, size),
        **{f"estimate.covariance, row {k}": (row, size) for k, row in enumerate(estimate.covariance)},
        "velocity_map.torque": (curve.torque, len(curve.velocity)),
        "velocity_map.spread": (curve.spread, len(curve.velocity)),
        "velocity_map.count": (curve.count, len(curve.velocity)),
        "velocity_map.cloud_torque": (curve.cloud_torque, len(curve.cloud_velocity)),
    }
    for entry in joint.poses.parameters if joint.poses else ():
        given = {"values": entry.values, "stds": entry.stds, "freedom": entry.freedom or entry.values}
        many = len(joint.poses.poses) if joint.poses else 0
        lengths |= {f"poses, {name} of {entry.name}": (numbers, many) for name, numbers in given.items()}
    found = [(name, len(values), wanted) for name, (values, wanted) in lengths.items()]
    mistakes = [
        f"{name} has {length} entries, not {wanted}" for name, length, wanted in found if length != wanted
    ]
    if not len(curve.cloud_velocity):
        mistakes.append("velocity_map.cloud_velocity is empty")
    numbers = (*estimate.linear, *estimate.shape, *curve.cloud_velocity, *curve.cloud_torque)
    if not all(map(math.isfinite, numbers)):
        mistakes.append("values of the law or of samples are not numbers")
    chosen = joint.selection and joint.selection.chosen
    if joint.selection and chosen not in {trial.law for trial in joint.selection.trials}:
        mistakes.append(f"selection.chosen {chosen!r} is not one of the laws tried")
    return [f"joint {joint.joint!r}: {text}" for text in mistakes]


def build_robot_friction(joint: JointFriction) -> FrictionValues | str:
    """Return the friction of a robot file with the identified law, or why no file can have it."""
    estimate = joint.estimate
    law = get_law(estimate.law, smoothing=joint.smoothing)
    physical = {entry.name for entry in law.physical}
    wrong = [f"{name} was refused: {reason}" for name, reason in estimate.refused if name in physical]
    if wrong:
        return "; ".join(wrong)
    # Robot files refuse a smoothing where there is no sign.
    smoothing = joint.smoothing if has_sign(get_law(law.name)) else 0.0
    values, shape, bristles = estimate.linear, estimate.shape, estimate.bristles
    return FrictionValues(law=law.name, values=values, shape=shape, smoothing=smoothing, bristles=bristles)


def set_identified_friction(robot: Robot, found: FrictionIdentification) -> Robot:
    """Return the robot with the friction model that the identification gave to all joints, if any."""
    kinds = found.settings.get("friction")
    asked = {rename_law(kind) for kind in kinds} if isinstance(kinds, Sequence) else set()
    own = {joint.friction.law for joint in robot.axes}
    law = asked.pop() if len(asked) == 1 else NO_FRICTION
    if law == NO_FRICTION or own == {law} or get_law(law).shape:
        return robot
    return override_robot(robot, (), law)


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionTask:
    """What to identify, and how.

    Args:
        model: name of a law, or `AUTO`; candidates: laws to choose from then.
        estimator: of the final fit; options: of all estimators.
        beta: (p,) base parameters that are known, in the order of the model card; None to fit the rigid part.
        smoothing: speed v0 in rad/s or m/s over which all laws change their sign, 0 for a jump.
        periods: s, of cosine motions to average over, one for all logs or one for each; empty for none.
        poses: whether to compare poses where there are several.
        rotors: of coupled drives, beside friction where loads are measured.
    """

    model: str | Mapping[str, str] = AUTO
    candidates: tuple[str, ...] = CANDIDATE_LAWS
    estimator: str = DEFAULT_ESTIMATOR
    options: FrictionOptions = field(default_factory=FrictionOptions)
    beta: FloatArray | None = None
    smoothing: float = FrictionValues().smoothing
    periods: tuple[float, ...] = ()
    poses: bool = True
    rotors: tuple[regression.Rotor, ...] = ()


def identify_friction(
    library: Library,
    recordings: Sequence[Recording],
    processing: Processing,
    task: FrictionTask | None = None,
    *,
    echo: Mapping[str, object] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> FrictionIdentification:
    """Return the friction of every joint that the recordings move.

    `recordings` are at least one, all of the same robot; `echo` are further settings to keep with the result;
    `progress` gets the number of finished joints, and of all.

    Raises:
        UsageError: no such law or estimator, or no recording; a smoothing that the law has no use for.
        LogError: a recording does not fit the robot, cannot be processed, or has another period.
        IdentifiabilityError: no parameter of any joint is identifiable.
        SolverError: a search ended without usable numbers.
    """
    task = task or FrictionTask()
    _check_task(task, recordings)
    notices: tuple[Notice, ...] = ()
    if task.periods:
        # Mean periods, repeated on both sides, and the processing that cuts these ends off.
        cut = [cut_ends(entry, processing.drop_first, processing.drop_last) for entry in recordings]
        each = task.periods if len(task.periods) == len(cut) else [task.periods[0]] * len(cut)
        pairs = list(zip(cut, each, strict=True))
        margin = max(round(period / entry.period) for entry, period in pairs)
        recordings = tuple(extraction.fold_recording(entry, period, margin=margin) for entry, period in pairs)
        processing = replace(processing, drop_first=margin, drop_last=margin)
        codes = {"log.folded", _NOT_PERIODIC}
        notices = tuple(one for entry in recordings for one in entry.notices if one.code in codes)
    measured = regression.list_measured_joints(recordings) if task.beta is None else ()
    logs = extraction.prepare_joint_logs(
        library, recordings, processing, measured=measured, rotors=task.rotors
    )
    notices += extraction.describe_cutoffs(logs)
    joints, refused = list[JointFriction](), list[tuple[str, str]]()
    for joint, card in enumerate(library.card.joints):
        if progress and joint:
            progress(joint, library.card.size)
        try:
            found, further = _identify_joint(logs, joint, task)
        except IdentifiabilityError as error:
            refused.append((card.name, "; ".join(entry.text for entry in error.notices)))
            continue
        joints.append(found)
        notices += further
    if not any(entry.estimate.parameters for entry in joints):
        reasons = [reason for _, reason in refused]
        for entry in joints:
            listed = "; ".join(f"{name}: {reason}" for name, reason in entry.estimate.refused)
            reasons.append(f"joint {entry.joint!r}, law {entry.estimate.law}: {listed}")
        periods = (notice for notice in notices if notice.code == _NOT_PERIODIC)
        raise IdentifiabilityError(*(Notice(code="friction.nothing", text=one) for one in reasons), *periods)
    texts = (f"no friction law: {reason}; move it more" for _, reason in refused)
    notices += tuple(Notice(code="friction.joint-refused", text=text) for text in texts)
    settings = {
        **(echo or {}),
        "processing": logs.processing,
        "model": task.model,
        "estimator": task.estimator,
        "smoothing": task.smoothing,
        "period": task.periods or None,
        "rigid": "fitted along" if task.beta is None else "known",
        **({"cutoffs": logs.cutoffs} if logs.cutoffs else {}),
        **({"measured_loads": measured} if any(measured) else {}),
    }
    model = task.model if isinstance(task.model, str) else ", ".join(map("=".join, task.model.items()))
    return FrictionIdentification(
        robot=library.card.robot,
        signature=library.card.signature,
        model=model,
        estimator=task.estimator,
        joints=tuple(joints),
        refused=tuple(refused),
        sources=tuple(recording.source for recording in recordings),
        # As JSON gives them back, so that a stored result equals its origin.
        settings=json.loads(write_json(settings)),
        notices=tuple(dict.fromkeys(notices)),
    )


def _check_task(task: FrictionTask, recordings: Sequence[Recording]) -> None:
    if not recordings:
        raise UsageError(Notice(code="usage.no-log", text="no log was given: name at least one"))
    if not 0.0 <= task.smoothing < math.inf:
        text = f"smoothing {task.smoothing:g}: must be 0 or a positive speed in rad/s or m/s"
        raise UsageError(Notice(code="usage.friction-smoothing", text=text))
    asked = [task.model] if isinstance(task.model, str) else task.model.values()
    for name in (name for name in asked if name != AUTO):
        check_estimator(task.estimator, get_law(name, smoothing=task.smoothing))
        if unused := _warn_of_smoothing(get_law(name, smoothing=task.smoothing)):
            raise UsageError(Notice(code="usage.friction-smoothing", text=f"{unused[0].text}; leave it out"))
    if len(task.periods) not in {0, 1, len(recordings)}:
        text = f"{len(task.periods)} periods for {len(recordings)} logs: give one for all of them, or one "
        text += "for each in their order"
        raise UsageError(Notice(code="usage.friction-periods", text=text))
    check_estimator(task.estimator)


def _identify_joint(
    logs: JointLogs, joint: int, task: FrictionTask
) -> tuple[JointFriction, tuple[Notice, ...]]:
    """Return the friction of a joint, and what concerns the whole identification."""
    extracted = extraction.extract_joint(logs, joint, beta=task.beta)
    samples, card = extracted.samples, logs.library.card.joints[joint]
    name = task.model if isinstance(task.model, str) else task.model.get(card.name, AUTO)
    selection, estimate = None, None
    if name == AUTO:
        # Bounds by name hold for one law.
        options = replace(task.options, bounds=())
        look_up = partial(get_law, smoothing=task.smoothing)
        selection, estimate = select_law(samples, task.candidates, look_up=look_up, options=options)
        name = selection.chosen
        if task.estimator == DEFAULT_ESTIMATOR and _shows_memory(extracted, look_up(name), estimate):
            memory = select_memory(extracted.all_rows, look_up(name), options)
            selection, estimate = memory or (selection, estimate)
            name = selection.chosen
    law = get_law(name, smoothing=task.smoothing)
    check_inputs(samples, law)
    if law.memory:
        # Slow rows count, too.
        notices = tuple(entry for entry in extracted.notices if entry.code != extraction.SLOW)
        extracted = extracted._replace(samples=extracted.all_rows, kept=~extracted.bad, notices=notices)
        samples = extracted.samples
    if estimate is None or task.estimator != estimate.estimator or task.options.bounds:
        estimate = fit_friction(samples, law, estimator=task.estimator, options=task.options)
    torque = samples.rows.torque
    left = torque - predict_rows(samples, law, estimate)
    residual = estimators.Residual.measure(samples.joint, left, torque, card.torque_unit, estimate.sigma)
    warnings = [*warn_of_inertia(estimate)]
    if not law.memory:
        warnings += warn_of_friction_pattern(samples, law, estimate)
    if residual.relative_percent > POLICY.usable:
        text = f"the residual is {residual.relative_percent:.3g} % of the torque. Check units (radians, not "
        text += "degrees; torque of the joint, not of the motor), columns and signs of the log, and whether "
        text += "torque and position were sampled at the same times"
        warnings.append(Notice(code="friction.large-residual", text=text))
    gain, rigid = None, extracted.rigid
    if logs.is_measured(joint) and samples.load is not None:
        # The factor on the measured load that the rows choose beside their law.
        design = joint_fit.compute_sensitivities(samples, law, estimate.linear, estimate.shape)
        table = np.column_stack([design, samples.pass_columns(samples.load[:, None]), left])
        parts = np.array_split(table, POLICY.folds)
        gain = regression.measure_load_gain(np.stack([part.T @ part for part in parts]))
    if gain is not None:
        rigid += f"; a factor on the load would be {gain.value:.4g} +- {gain.deviation:.2g} (1 was taken)"
    warnings += [*_warn_of_smoothing(law), *regression.warn_of_load_gain(gain)]
    estimate = replace(estimate, notices=(*estimate.notices, *warnings))
    poses = compare_poses(logs, joint, law, beta=task.beta) if task.poses and not law.memory else None
    skipped = [
        Notice(code="friction.pose-skipped", text=f"{held}: poses not compared, move longer: {why}")
        for held, why in (poses.skipped if poses else ())
    ]
    named = (replace(entry, text=f"joint {card.name!r}: {entry.text}") for entry in estimate.notices)
    found = JointFriction(
        estimate=estimate,
        formula=law.formula,
        smoothing=task.smoothing,
        unit=card.torque_unit,
        velocity_unit=f"{card.position_unit}/s",
        rigid=rigid,
        residual=residual,
        motion=measure_motion(extracted.whole, law, estimate, unit=card.torque_unit, kept=extracted.kept),
        selection=selection,
        poses=poses,
        velocity_map=joint_fit.compute_velocity_map(samples, estimate.other),
        sources=tuple(logs.sources[run] for run in logs.list_moving(joint)),
    )
    return found, (*skipped, *extracted.notices, *named)


def _shows_memory(extracted: ExtractedJoint, law: FrictionLaw, estimate: FrictionEstimate) -> bool:
    """Return whether slow rows carry squares that no law leaves of rows in motion, enough to matter."""
    samples = extracted.all_rows
    rows, errors = samples.rows, samples.rows.torque - predict_rows(samples, law, estimate)
    slow = estimators.find_phases(rows.time, rows.velocity, rows.run) > 0
    usual = float(np.mean(errors[~slow] ** 2)) if not slow.all() else 0.0
    excess = float(np.sum(errors[slow] ** 2)) - usual * int(slow.sum())
    return excess > POLICY.relevance * float(np.sum(errors**2))


_LACKING = {
    "temperature": "which not all logs have: name its columns in [log.temperature], or name another law",
    "load": (
        "but links and payload take too little of this joint's torque. Move it against gravity or accelerate "
        "more, give base parameters with --known, log the load ([log.load]), or name a law without load"
    ),
}
"""Why an input of a law is not known, and what to do."""


def check_inputs(samples: FrictionSamples, law: FrictionLaw) -> None:
    """Raise IdentifiabilityError for a law of a load or a temperature that is not known."""
    for name, reason in _LACKING.items():
        if name in law.inputs and getattr(samples, name) is None:
            text = f"joint {samples.joint!r}: law {law.name!r} needs the {name}, {reason}"
            raise IdentifiabilityError(Notice(code=f"friction.no-{name}", text=text))


def _warn_of_smoothing(law: FrictionLaw) -> tuple[Notice, ...]:
    """Return a warning where smoothing has no effect on a law."""
    if not law.smoothing or has_sign(get_law(law.name)):
        return ()
    text = f"--smoothing has no effect on law {law.name!r}, which is continuous at zero speed; leave it out"
    return (Notice(code="friction.smoothing-unused", text=text),)


def warn_of_inertia(estimate: FrictionEstimate) -> tuple[Notice, ...]:
    """Return a warning where the rigid part has a negative inertia or mass."""
    wrong = [one for one in estimate.extra if one.name in {"J", extraction.ROTOR} and one.value < 0.0]
    if not wrong:
        return ()
    found = wrong[0]
    size = f"{found.name} = {found.value:.4g} +- {found.std:.2g} {found.unit} is negative"
    reason = "within its uncertainty it is zero: the motion accelerates too little to identify it"
    if found.value < -POLICY.printed * found.std:
        reason = "the torque may have the wrong sign or unit, or the friction law is incomplete. Check the "
        reason += "log's columns (log.torque) and scales"
    return (Notice(code="friction.negative-inertia", text=f"{size}; {reason}"),)


def validate_friction(
    found: FrictionIdentification,
    library: Library,
    recording: Recording,
    processing: Processing,
    *,
    rotors: Sequence[regression.Rotor] = (),
) -> estimators.Validation:
    """Return residuals and series of `recording` under identified friction, joint by joint.

    `processing` is that of the fit; `rotors` are those of coupled drives.

    Raises:
        EstimateError: the friction belongs to another model.
        LogError: the recording does not fit the robot, or lacks the loads that the fit subtracted.
        IdentifiabilityError: no joint can be validated.
    """
    estimators.check_model(found, library.card)
    beta, joints = read_known_parameters(found, library.card), library.card.joints
    # The joints whose measured loads were subtracted.
    stored = found.settings.get("measured_loads")
    measured = tuple(map(bool, stored)) if isinstance(stored, Sequence) else ()
    lacking = np.ptp(recording.position, axis=0) > 0.0
    lacking &= ~np.array(regression.list_measured_joints((recording,)), dtype=np.bool_)
    dead = [joint.name for joint, *both in zip(joints, measured, lacking, strict=False) if all(both)]
    if dead:
        what = "has none" if recording.load is None else f"has a constant one for {', '.join(dead)}"
        text = f"friction was fitted to torques less the loads of joint-torque sensors, and this log {what}: "
        text += "name their columns in [log.load], or identify friction again from logs without loads"
        raise LogError(Notice(code="validate.friction-load", text=text, file=recording.source))
    logs = extraction.prepare_joint_logs(library, (recording,), processing, measured=measured, rotors=rotors)
    residuals, motion = list[estimators.Residual](), list[estimators.MotionResidual]()
    series, lost, notices = list[estimators.Series](), list[Notice](), list[Notice]()
    for entry in found.joints:
        law = get_law(entry.estimate.law, smoothing=entry.smoothing)
        joint = [one.name for one in joints].index(entry.joint)
        try:
            if not logs.list_moving(joint):
                raise _refuse(entry.joint, "it does not move of its own in this log")
            samples, told = _build_samples(entry, logs, joint, beta)
            kept, further = _choose_rows(samples, entry, law, logs.processing.get_standstill(joint))
        except IdentifiabilityError as error:
            lost += error.notices
            continue
        rows, predicted = samples.rows, predict_rows(samples, law, entry.estimate)
        torque = rows.torque[kept]
        left = torque - predicted[kept]
        residuals.append(estimators.Residual.measure(entry.joint, left, torque, entry.unit))
        motion.append(measure_motion(samples, law, entry.estimate, unit=entry.unit, kept=kept))
        columns = rows.time[kept], rows.velocity[kept], torque, predicted[kept]
        series.append(estimators.Series(entry.joint, entry.unit, entry.velocity_unit, *columns))
        notices += (*told, *further)
    if not residuals:
        raise IdentifiabilityError(*lost)
    cut = (processing.drop_first, processing.drop_last)
    overlap = measure_overlap(recording, found.sources, found.settings, cut=cut)
    if overlap:
        part = describe_overlap(overlap, recording, cut)
        warning = build_warning("validate.fitted-log", file=recording.source, what="friction", part=part)
        lost.insert(0, warning)
    return estimators.Validation(
        robot=found.robot,
        signature=found.signature,
        source=recording.source,
        rows="friction",
        residual=tuple(residuals),
        motion=tuple(motion),
        series=tuple(series),
        samples=sum(residual.samples for residual in residuals),
        fitted=overlap > 0.0,
        scoring=0.0,
        notices=(*lost, *notices),
    )


def read_known_parameters(found: FrictionIdentification, card: ModelCard) -> FloatArray | None:
    """Return the base parameters (p,) that were subtracted; None where the rigid part was fitted along."""
    if found.settings.get("rigid") != "known":
        return None
    values, names = found.settings.get("known_values"), [entry.name for entry in card.beta]
    numbers = [values.get(name) for name in names] if isinstance(values, Mapping) else [None]
    plain = [float(value) for value in numbers if isinstance(value, int | float)]
    if len(plain) != len(names):
        text = "its settings have no usable 'known_values' (the base parameters subtracted); identify again"
        raise EstimateError(Notice(code="estimate.settings", text=text))
    return np.array(plain)


def _refuse(joint: str, reason: str) -> IdentifiabilityError:
    text = f"joint {joint!r} cannot be validated: {reason}"
    return IdentifiabilityError(Notice(code="validate.friction-joint", text=text))


def _build_samples(
    entry: JointFriction, logs: JointLogs, joint: int, beta: FloatArray | None
) -> tuple[FrictionSamples, tuple[Notice, ...]]:
    """Return a joint's samples with the columns of its fit; refuse a motion that needs more of them."""
    card, measured = logs.library.card, logs.is_measured(joint)
    rigid = logs.list_rotor_columns(joint, (0,)) if measured else logs.list_rigid_columns(joint, (0,))
    # The names of the columns beside friction, in the order of the fit.
    estimate = entry.estimate
    own = {parameter.name for parameter in get_law(estimate.law).physical}
    given = {parameter.name for parameter in estimate.extra}
    given |= {name for name, _ in estimate.refused if name not in own}
    beside = [*(one.name for one in rigid), *(one.name for one in card.friction)]
    order = dict.fromkeys((*extraction.PHYSICAL, *beside))
    names = [name for name in order if name in given]
    if len(names) != len(estimate.other) or len(names) != len(given):
        text = f"joint {entry.joint!r}: beside friction {', '.join(sorted(given)) or 'nothing'} was fitted "
        text += f"with {len(estimate.other)} values, of which the model has {len(names)}; identify again"
        raise EstimateError(Notice(code="estimate.parameters", text=text))
    known = {column.name: column for column in (*logs.list_physical_columns(joint, (0,)), *rigid)}
    inertial = [k for k, name in enumerate(names) if name in known]
    if len(inertial) < len(names):
        known |= {column.name: column for column in logs.list_friction_columns(joint, (0,))}
    samples = logs.build_samples(joint, (0,), [known[name] for name in names])
    if measured:
        return samples, ()
    if beta is not None:
        load = np.column_stack([column.values for column in rigid]) @ beta
        return replace(samples, torque=samples.torque - load, load=load), ()
    fitted = samples.extra[:, inertial]
    samples = replace(samples, load=fitted @ np.array(estimate.other)[inertial])
    whole = np.column_stack([fitted, *(column.values for column in rigid)])
    if len(extraction.list_independent(whole)) != len(extraction.list_independent(fitted)):
        reason = "this motion needs more of its rigid part than was fitted, as where a joint moved alone "
        reason += "there and moves with others here. Identify the base parameters, and friction with --known"
        raise _refuse(entry.joint, reason)
    names = [names[k] for k in inertial]
    if refused := [name for name, _ in estimate.refused if name in names]:
        text = f"joint {entry.joint!r}: {', '.join(refused)} of its rigid part are not identifiable; the "
        text += "prediction holds only for motions like those that were fitted; fit logs that excite more"
        return samples, (Notice(code="validate.friction-beside", text=text),)
    acting = {column.name for column in rigid if column.values.any()}
    # Base parameters that were fitted one by one hold at every pose.
    if card.size == 1 or not names or acting <= set(names):
        return samples, ()
    which = ", ".join(names) if set(names) <= set(extraction.PHYSICAL) else f"{len(names)} columns"
    text = f"joint {entry.joint!r}: its rigid part ({which}) was fitted jointly and holds at the poses of "
    text += "the fitted logs. For others identify the base parameters, and friction with --known"
    return samples, (Notice(code="validate.friction-pose", text=text),)


def _choose_rows(
    samples: FrictionSamples, entry: JointFriction, law: FrictionLaw, standstill: float
) -> tuple[NDArray[np.bool_], tuple[Notice, ...]]:
    """Return which rows are above standstill; of laws with refused parameters, within the speeds fitted."""
    rows = samples.rows
    own = {parameter.name for parameter in law.physical}
    refused = [name for name, _ in entry.estimate.refused if name in own]
    known = np.concatenate([entry.velocity_map.velocity, entry.velocity_map.cloud_velocity])
    inside, far = np.zeros((2, len(rows.velocity)), dtype=np.bool_)
    for direction in (-1.0, 1.0):
        fitted, speed = direction * known[direction * known > 0.0], direction * rows.velocity
        fastest = np.max(fitted, initial=0.0)
        inside |= (speed >= np.min(fitted, initial=np.inf)) & (speed <= fastest)
        # Five percent faster, a law is extrapolated.
        far |= speed > 1.05 * fastest
    # What has a state holds at rest, too.
    moving = (np.abs(rows.velocity) >= standstill) | bool(law.memory)
    kept = moving & inside if refused else moving
    if not kept.any():
        reason = "every sample is slower than processing.standstill, or at speeds that were not fitted"
        raise _refuse(entry.joint, reason)
    if refused:
        text = f"joint {entry.joint!r}: {', '.join(refused)} are not identifiable, so the law holds only at "
        text += f"the speeds that were fitted; {int(np.sum(moving & ~inside))} of {len(kept)} samples at "
        text += "others were left out; fit logs with these speeds"
        return kept, (Notice(code="validate.friction-refused", text=text),)
    if beyond := int(np.sum(moving & far)):
        text = f"joint {entry.joint!r}: {beyond} of {len(kept)} samples are faster than those fitted, or in "
        text += "another direction: the law is extrapolated there; fit logs with these speeds"
        return kept, (Notice(code="validate.friction-range", text=text),)
    return kept, ()
