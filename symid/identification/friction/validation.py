"""What identified friction predicts of a log that it was not fitted to; nothing is fitted.

FrictionIdentification, the library of the same model, a recording -> Validation.

    tau^ = Phi(dq; shape) linear + X other,    relative residual = |R (tau - tau^)| / |R tau|

The rows are those of the fit: filter, decimation, rows below standstill left out, but no mean periods. X are
the columns that were fitted along; known base parameters are subtracted from tau, as in the fit.
Supported: joints that move in the log, and whose rigid part the logs of the fit identified.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from symid.arrays import FloatArray
from symid.codegen import Library, ModelCard
from symid.errors import EstimateError, IdentifiabilityError, LogError, Notice
from symid.identification.diagnostics import build_warning
from symid.identification.estimators import (
    MotionResidual,
    Residual,
    Series,
    Validation,
    check_model,
)
from symid.identification.friction.extraction import Column, JointLogs, list_independent, prepare_joint_logs
from symid.identification.friction.identify import FrictionIdentification, JointFriction
from symid.identification.friction.joint_fit import FrictionSamples
from symid.identification.friction.selection import measure_motion, predict_rows
from symid.identification.regression import Rotor, list_measured_joints
from symid.joint_models import FrictionLaw, get_law
from symid.logs import Recording, describe_overlap, measure_overlap
from symid.robot import Processing

_PHYSICAL = ("J", "a", "b")


def validate_friction(
    found: FrictionIdentification,
    library: Library,
    recording: Recording,
    processing: Processing,
    *,
    rotors: Sequence[Rotor] = (),
) -> Validation:
    """Return residuals and series of `recording` under identified friction, joint by joint.

    `processing` is that of the fit; `rotors` are those of coupled drives.

    Raises:
        EstimateError: the friction belongs to another model.
        LogError: the recording does not fit the robot, or lacks the loads that the fit subtracted.
        IdentifiabilityError: no joint can be validated.
    """
    check_model(found, library.card)
    beta, measured = (
        read_known_parameters(found, library.card),
        _read_measured(found, recording, library.card),
    )
    logs = prepare_joint_logs(library, (recording,), processing, measured=measured, rotors=rotors)
    trials, lost = list[tuple[Residual, MotionResidual, Series, tuple[Notice, ...]]](), list[Notice]()
    for entry in found.joints:
        try:
            trials.append(_validate_joint(entry, logs, beta))
        except IdentifiabilityError as error:
            lost += error.notices
    if not trials:
        raise IdentifiabilityError(*lost)
    residuals, motion, series, notices = zip(*trials, strict=True)
    cut = (processing.drop_first, processing.drop_last)
    overlap = measure_overlap(recording, found.sources, found.settings, cut=cut)
    if overlap:
        part = describe_overlap(overlap, recording, cut)
        warning = build_warning("validate.fitted-log", file=recording.source, what="friction", part=part)
        lost.insert(0, warning)
    return Validation(
        robot=found.robot,
        signature=found.signature,
        source=recording.source,
        rows="friction",
        residual=residuals,
        motion=motion,
        series=series,
        samples=sum(residual.samples for residual in residuals),
        fitted=overlap > 0.0,
        notices=(*lost, *(notice for part in notices for notice in part)),
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


def _read_measured(found: FrictionIdentification, recording: Recording, card: ModelCard) -> tuple[bool, ...]:
    """Return the joints (n,) whose measured loads were subtracted; raise LogError where they are lacking."""
    stored = found.settings.get("measured_loads")
    measured = tuple(map(bool, stored)) if isinstance(stored, Sequence) else ()
    present = list_measured_joints((recording,))
    moves = np.ptp(recording.position, axis=0) > 0.0
    dead = [
        joint.name
        for joint, wanted, known, moved in zip(card.joints, measured, present, moves, strict=False)
        if wanted and moved and not known
    ]
    if dead:
        what = "has none" if recording.load is None else f"has a constant one for {', '.join(dead)}"
        text = (
            f"friction was fitted to torques less the loads of joint-torque sensors, and this log {what}: "
            "name their columns in [log.load], or identify friction again from logs without loads"
        )
        raise LogError(Notice(code="validate.friction-load", text=text, file=recording.source))
    return measured


def _validate_joint(
    entry: JointFriction, logs: JointLogs, beta: FloatArray | None
) -> tuple[Residual, MotionResidual, Series, tuple[Notice, ...]]:
    """Return residuals, series and notices of a joint; raise IdentifiabilityError where there are none."""
    law = get_law(entry.estimate.law, smoothing=entry.smoothing)
    joint = [one.name for one in logs.library.card.joints].index(entry.joint)
    if not logs.list_moving(joint):
        raise _leave_out(entry.joint, "it does not move of its own in this log")
    samples, notices = _build_samples(entry, logs, joint, beta)
    kept, found = _choose_rows(samples, entry, law, logs.processing.get_standstill(joint))
    rows, predicted = samples.build_rows(), predict_rows(samples, law, entry.estimate)
    errors = rows.torque - predicted
    series = Series(
        joint=entry.joint,
        unit=entry.unit,
        velocity_unit=entry.velocity_unit,
        time=rows.time[kept],
        velocity=rows.velocity[kept],
        measured=rows.torque[kept],
        predicted=predicted[kept],
    )
    residual = Residual.measure(entry.joint, errors[kept], rows.torque[kept], entry.unit)
    motion = measure_motion(samples, law, entry.estimate, unit=entry.unit, kept=kept)
    return residual, motion, series, (*notices, *found)


def _build_samples(
    entry: JointFriction, logs: JointLogs, joint: int, beta: FloatArray | None
) -> tuple[FrictionSamples, tuple[Notice, ...]]:
    """Return a joint's samples with the columns of its fit, and where its rigid part holds."""
    card, measured = logs.library.card, logs.is_measured(joint)
    rigid = logs.list_rotor_columns(joint, (0,)) if measured else logs.list_rigid_columns(joint, (0,))
    names = _list_columns(entry, card, [column.name for column in rigid])
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
    samples = replace(samples, load=fitted @ np.array(entry.estimate.other)[inertial])
    return samples, _check_rigid(entry, card, rigid, fitted, [names[k] for k in inertial])


def _list_columns(entry: JointFriction, card: ModelCard, rigid: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the columns beside friction; raise EstimateError where values do not fit."""
    estimate = entry.estimate
    own = {parameter.name for parameter in get_law(estimate.law).physical}
    given = {parameter.name for parameter in estimate.extra}
    given |= {name for name, _ in estimate.refused if name not in own}
    order = dict.fromkeys((*_PHYSICAL, *rigid, *(one.name for one in card.friction)))
    names = tuple(name for name in order if name in given)
    if len(names) != len(estimate.other) or len(names) != len(given):
        text = (
            f"joint {entry.joint!r}: beside friction {', '.join(sorted(given)) or 'nothing'} was fitted with "
            f"{len(estimate.other)} values, of which the model has {len(names)}; identify again"
        )
        raise EstimateError(Notice(code="estimate.parameters", text=text))
    return names


def _check_rigid(
    entry: JointFriction, card: ModelCard, rigid: Sequence[Column], fitted: FloatArray, names: Sequence[str]
) -> tuple[Notice, ...]:
    """Return where the rigid part holds; raise IdentifiabilityError where a motion needs more of it."""
    whole = np.column_stack([fitted, *(column.values for column in rigid)])
    if len(list_independent(whole)) != len(list_independent(fitted)):
        reason = (
            "this motion needs more of its rigid part than was fitted, as where a joint moved alone there "
            "and moves with others here. Identify the base parameters, and friction with --known"
        )
        raise _leave_out(entry.joint, reason)
    refused = [name for name, _ in entry.estimate.refused if name in names]
    if refused:
        text = (
            f"joint {entry.joint!r}: {', '.join(refused)} of its rigid part are not identifiable; the "
            "prediction holds only for motions like those that were fitted"
        )
        return (Notice(code="validate.friction-beside", text=text),)
    acting = {column.name for column in rigid if column.values.any()}
    # Base parameters that were fitted one by one hold at every pose.
    if card.size == 1 or not names or acting <= set(names):
        return ()
    which = ", ".join(names) if set(names) <= set(_PHYSICAL) else f"{len(names)} columns"
    text = (
        f"joint {entry.joint!r}: its rigid part ({which}) was fitted along and holds at the poses of the "
        "fitted logs. For others identify the base parameters, and friction with --known"
    )
    return (Notice(code="validate.friction-pose", text=text),)


def _choose_rows(
    samples: FrictionSamples, entry: JointFriction, law: FrictionLaw, standstill: float
) -> tuple[NDArray[np.bool_], tuple[Notice, ...]]:
    """Return which rows are above standstill; of laws with refused parameters, within the speeds fitted."""
    rows = samples.build_rows()
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
    moving = np.abs(rows.velocity) >= standstill
    kept = moving & inside if refused else moving
    joint = f"joint {entry.joint!r}"
    if not kept.any():
        reason = "every row is slower than processing.standstill, or at speeds that were not fitted"
        raise _leave_out(entry.joint, reason)
    notices = []
    outside = int(np.sum(moving & ~inside))
    if refused:
        text = (
            f"{joint}: {', '.join(refused)} are not identifiable, so the law holds only at the speeds that "
            f"were fitted; {outside} of {len(kept)} rows at others were left out"
        )
        notices.append(Notice(code="validate.friction-refused", text=text))
    elif beyond := int(np.sum(moving & far)):
        text = (
            f"{joint}: {beyond} of {len(kept)} rows are faster than those fitted, or in another direction: "
            "the law is extrapolated there"
        )
        notices.append(Notice(code="validate.friction-range", text=text))
    return kept, tuple(notices)


def _leave_out(joint: str, reason: str) -> IdentifiabilityError:
    text = f"joint {joint!r} cannot be validated: {reason}"
    return IdentifiabilityError(Notice(code="validate.friction-joint", text=text))
