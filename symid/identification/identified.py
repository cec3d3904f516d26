"""From parameters to a robot with these values, and back to the parameters that are known of one.

    estimate (rigid or elastic)             -> `Identified`, and the robot with its values
    estimate, or robot with values (CAD)    -> its links seen from the frames of the robot that is identified
                                            -> base parameters that are known, rotors of elastic joints

Supported, of a robot with values: joints, axes and drives are the same, however its link frames stand.
Not supported: a part of a robot; other units; friction and springs of elastic joints.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from symid import dynamics
from symid.arrays import FloatArray
from symid.codegen import Library, build_model_card
from symid.errors import EstimateError, Notice
from symid.identification.elastic import ElasticEstimate, build_rigid_estimate, build_rigid_variant
from symid.identification.estimators import (
    Estimate,
    ParameterEstimate,
    check_bodies,
    check_model,
    describe_other_bodies,
)
from symid.identification.judge import POLICY, numerics
from symid.identification.options import Described
from symid.identification.rigid import restore_robot
from symid.identification.stored import GivenResult, read_fit, read_rigid, take_given
from symid.joint_models import Elasticity
from symid.robot import Joint, Placement, Robot, load_robot, move_parameters


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Identified:
    """Identified values of a robot, rotors of elastic joints, springs one a joint, None for rigid ones.

    `robot` is the robot as it was identified, `base` its base parameters; `missing` names what has no value;
    `changes` how bodies on fixed joints differ from those in the robot file of the fit, in words;
    `covariance` is that of `values`, empty where the method gives none. `motion` has states of the logs, and
    `held_out` what is left of held-out torque in percent, by joint; empty where the fit has none.
    """

    robot: Robot
    base: dynamics.BaseParameters
    sources: tuple[str, ...]
    values: tuple[ParameterEstimate, ...]
    rotors: Mapping[str, float] = field(default_factory=dict)
    springs: tuple[Elasticity | None, ...] = ()
    missing: tuple[str, ...] = ()
    notices: tuple[Notice, ...] = ()
    changes: str = ""
    covariance: tuple[tuple[float, ...], ...] = ()
    motion: tuple[tuple[float, ...], ...] = ()
    held_out: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class JointCost:
    """What bodies cost of one joint: rms of their torque less the fit's, over the latter, and what it may be.

    `percent` and `limit` in percent, `torque` the rms of the fit's torque in N m or N.
    """

    joint: str
    percent: float
    limit: float
    torque: float


def build_identified(robot: Robot, estimate: Estimate | ElasticEstimate, source: Path) -> Identified:
    """Return the values of an estimate, rigid or elastic, of a robot as its file states it, or EstimateError.

    Friction and settings of the estimate are restored; `source` is where it is from, for messages.
    """
    described = restore_robot(robot, estimate)
    if isinstance(estimate, ElasticEstimate):
        base = dynamics.derive_base_parameters(described)
        card = build_model_card(described, base, ())
        check_model(estimate, card, str(source))
        refused = {entry for entry, _ in estimate.refused}
        known = [entry for entry in estimate.parameters if entry.name not in refused]
        names = {entry.name for entry in (*base.parameters, *base.friction)}
        values = tuple(entry for entry in known if entry.name in names)
        rotors = tuple(entry.name for entry in estimate.parameters if entry.name not in names)
        stated = {joint.name: joint.elasticity for joint in described.axes}
        told = {entry.joint: entry.elasticity for entry in estimate.springs if entry.identifiable}
        springs = tuple(told.get(name, spring) for name, spring in stated.items()) if estimate.springs else ()
        lacking = [name for name, spring in stated.items() if spring is not None and name not in told]
        # What was taken off before the fit, for which robots have no place.
        named = ", ".join(
            effect.kind if effect.joint < 0 else f"{effect.kind} of {estimate.residual[effect.joint].joint!r}"
            for effect in estimate.effects
        )
        # The robot file's own springs are written in place of those that are refused.
        lost = [
            ("export.spring", f"the stated spring of {entry.joint!r} is kept; load it more: {entry.reason}")
            for entry in estimate.springs
            if not entry.identifiable
        ]
        text = f"torques of the robot lack what was subtracted before the fit, so add it to them: {named}"
        lost += [("export.effects", text)] if named else []
        places = [k for k, entry in enumerate(estimate.parameters) if entry in values]
        table = estimate.covariance
        return Identified(
            robot=described,
            base=base,
            sources=estimate.sources,
            values=values,
            rotors={entry.name: entry.value for entry in known if entry.name not in names},
            springs=springs,
            missing=(
                *_list_missing(base, values),
                *(entry for entry in rotors if entry in refused),
                *(f"the spring of {joint!r}" for joint in lacking),
            ),
            notices=tuple(Notice(code=code, text=text, file=str(source)) for code, text in lost),
            changes=describe_other_bodies(estimate, described, card),
            covariance=tuple(tuple(table[i][j] for j in places) for i in places if table),
        )
    found, notices = build_rigid_estimate(estimate, described), tuple[Notice, ...]()
    robot = build_rigid_variant(described)
    base = dynamics.derive_base_parameters(robot)
    card = build_model_card(robot, base, ())
    check_model(found, card, str(source))
    if any(described.elastic):
        text = "the joints were identified as rigid, and are written so: rotors turn with their links, "
        text += "without springs, with which these values do not hold; identify the elastic robot to have "
        text += "them"
        notices = (Notice(code="export.rigid-variant", text=text, file=str(source)),)
    # Shape values, gravity and zeros are part of the robot, as lengths are.
    kept = [k for k, entry in enumerate(found.parameters) if entry.name not in found.besides]
    covariance = tuple(tuple(found.covariance[k][j] for j in kept) for k in kept) if found.covariance else ()
    values = tuple(found.parameters[k] for k in kept)
    return Identified(
        robot=robot,
        base=base,
        sources=found.sources,
        values=values,
        missing=_list_missing(base, values),
        notices=notices,
        changes=describe_other_bodies(found, robot, card),
        covariance=covariance,
        motion=found.motion,
        held_out={} if found.evidence is None else {e.joint: e.held_out for e in found.evidence.joints},
    )


def _list_missing(base: dynamics.BaseParameters, values: Sequence[ParameterEstimate]) -> tuple[str, ...]:
    known = {entry.name for entry in values}
    return tuple(entry.name for entry in (*base.parameters, *base.friction) if entry.name not in known)


def build_robot(found: Identified, *, grouped: bool = True) -> dynamics.IdentifiedRobot:
    """Return the robot with the estimate's values, in bodies that exist.

    `grouped`: whether rotors within groups have inertias of their own, see `compute_standard_set`.
    """
    # Deviations of some values alone do not say how to weigh the others. What was known before moves least.
    covariance, deviations = None, np.array([entry.std for entry in found.values])
    if np.all(np.isfinite(deviations)) and np.any(deviations > 0.0):
        covariance = np.array(found.covariance) if found.covariance else np.diag(deviations**2)
        least = POLICY.relevance * float(deviations[deviations > 0.0].min())
        covariance = np.asarray(covariance + np.diag(np.where(deviations > 0.0, 0.0, least**2)))
    return dynamics.build_identified_robot(
        found.robot,
        found.base,
        {entry.name: entry.value for entry in found.values},
        covariance=covariance,
        rotors=found.rotors,
        elasticity=found.springs,
        grouped=grouped,
    )


def build_bodies(
    found: Identified, library: Library, limit: float | None = None, *, grouped: bool = True
) -> tuple[dynamics.IdentifiedRobot, tuple[JointCost, ...]]:
    """Return the robot in bodies that exist, and what they cost where none have the identified values.

    See `build_robot` and `measure_costs`.
    """
    built = build_robot(found, grouped=grouped)
    return built, measure_costs(built.standard, found, library, limit) if built.standard.reason else ()


def measure_costs(
    standard: dynamics.StandardSet, found: Identified, library: Library, limit: float | None = None
) -> tuple[JointCost, ...]:
    """Return what bodies cost joint by joint in the states of the logs; nothing where there are none.

    `library` has the functions of `found.robot`; `limit` in percent, the same for all joints, if given. By
    default it is what does no harm: to the torque, or to the squares that the fit leaves of it held out.
    """
    if not found.motion:
        return ()
    states = np.array(found.motion).reshape(len(found.motion), 3, -1)
    card, least = library.card, 100.0 * POLICY.relevance
    names = [entry.name for entry in (*card.beta, *card.friction)]
    changes = dict(zip(standard.names, standard.residual.tolist(), strict=True))
    known = {entry.name: entry.value for entry in found.values}
    values = np.array([[table.get(name, 0.0) for table in (changes, known)] for name in names])
    (columns,) = library.evaluate("torque_regressor", *states.transpose(1, 0, 2))
    if card.friction and not {"load", "temperature"} & set(card.friction_inputs):
        inputs = card.gather_friction_inputs(states[:, 1], q=states[:, 0])
        (more,) = library.evaluate("friction_regressor", *inputs)
        columns = np.concatenate([columns, more], axis=2)
    change, torque = np.sqrt(np.mean((columns @ values[: columns.shape[2]]) ** 2, axis=0)).T
    costs = []
    for joint, off, whole in zip(card.joints, change.tolist(), torque.tolist(), strict=True):
        harmless = max(least, math.sqrt(POLICY.relevance) * found.held_out.get(joint.name, 0.0))
        percent, most = 100.0 * off / whole if whole else 0.0, harmless if limit is None else limit
        costs.append(JointCost(joint=joint.name, percent=percent, limit=most, torque=whole))
    return tuple(costs)


def list_warnings(
    identified: dynamics.IdentifiedRobot, found: Identified, source: Path
) -> tuple[Notice, ...]:
    """Return the notices on the robot built from the estimate of `source`."""
    standard, notices = identified.standard, [*found.robot.notices, *found.notices]
    if standard.reason:
        known = {entry.name: entry.std for entry in found.values if 0.0 < entry.std < math.inf}
        pairs = zip(standard.names, standard.residual.tolist(), strict=True)
        moved = [(abs(change) / known[name], name) for name, change in pairs if name in known]
        far = ", at most {:.2g} standard deviations away ({})".format(*max(moved)) if moved else ""
        text = f"no physical bodies have exactly the identified values; the nearest were written{far}: "
        text += f"{standard.reason}. Identify by --estimator consistent for values that bodies have"
        notices.append(Notice(code="export.inconsistent", text=text, file=str(source)))
    if found.missing:
        names = ", ".join(found.missing)
        text = f"from the robot file or the nearest bodies, not measured: {names}; load and move them"
        notices.append(Notice(code="export.not-identified", text=text, file=str(source)))
    return tuple(notices)


_ROBOT_FILES = frozenset({".toml", ".urdf", ".xml", ".mjcf"})


def name_known_dynamics(
    given: GivenResult | Robot | Described | Mapping[str, float], robot: Robot, library: Library
) -> dict[str, float]:
    """Return dynamic parameters of elastic joints by name: of links, and of rotors where they are stated.

    `given` is a fit or its file, a robot with values or its file, or parameters by name in SI units; an
    EstimateError tells that it is of another model than `robot` with its `library`, or lacks values.
    """
    if isinstance(given, Mapping):
        return dict(given)
    known = take_given(given)
    pairs = zip(library.card.joints, library.card.yielding, strict=True)
    numbers = [joint.number for joint, gives in pairs if gives]
    if isinstance(known, Path) and known.suffix.lower() in _ROBOT_FILES:
        known = dynamics.choose_reading(partial(load_robot, str(known)))
    if isinstance(known, Robot):
        # Rotors of rigid joints are parts of the base parameters.
        stated = {number: known.joints[number - 1].drive.rotor_inertia for number in numbers if known.joints}
        values = _compute_known_values(known, robot, partly=True)
        return values | {f"IA{number}": value for number, value in stated.items() if value is not None}
    file = str(known) if isinstance(known, Path) else str(getattr(given, "file", None) or "")
    found = read_fit(known) if isinstance(known, Path) else known
    if not isinstance(found, ElasticEstimate):
        text = "known dynamics of elastic joints: expected a fit of elastic joints, or a robot with values"
        raise EstimateError(Notice(code="estimate.kind", text=text, file=file))
    check_model(found, library.card, file)
    check_bodies(found, robot, library.card, file)
    wanted = {entry.name for entry in library.card.beta} | {f"IA{number}" for number in numbers}
    wanted -= {name for name, _ in found.refused}
    known_well = (entry for entry in found.parameters if np.isfinite(entry.std))
    return {entry.name: entry.value for entry in known_well if entry.name in wanted}


def read_known_values(
    given: GivenResult | Robot | Described, robot: Robot, library: Library
) -> tuple[FloatArray, str]:
    """Return the base parameters (p,) that are known, of a fit or a robot, and where they are from."""
    known = take_given(given)
    name = str(known) if isinstance(known, Path) else "an estimate in memory"
    if isinstance(known, Path) and known.suffix.lower() in _ROBOT_FILES:
        known = dynamics.choose_reading(partial(load_robot, str(known)))
    names = [entry.name for entry in library.card.beta]
    if not isinstance(known, Robot):
        found = read_rigid(known, library.card)
        check_bodies(found, robot, library.card, name)
        return found.assemble(names), name
    values = _compute_known_values(known, robot)
    return np.array([values[entry] for entry in names]), known.path or f"robot {known.name!r} in memory"


def _compute_known_values(known: Robot, robot: Robot, *, partly: bool = False) -> dict[str, float]:
    """Return base parameters of `robot` as `known` has them, `partly` without those that have no value."""
    # Gravity and names of robots may differ, and with `partly` one may have rotors that the other has not.
    mistakes = list_frame_differences(known, robot)
    if [joint.name for joint in known.joints] == [joint.name for joint in robot.joints]:
        for other, joint in zip(known.joints, robot.joints, strict=True):
            head = f"joint {joint.name!r}"
            if not partly and other.drive.has_rotor != joint.drive.has_rotor:
                has, lacks = ("the file", "the robot") if other.drive.has_rotor else ("the robot", "the file")
                mistakes.append(f"{head} has a rotor in {has} and none in {lacks}; declare it in both")
            if (other.spring is None) != (joint.spring is None):
                mistakes.append(f"{head} has a spring in only one of the two")
        theirs, ours = (
            [(one.name, one.terms, one.has_rotor) for one in entry.couplings] for entry in (known, robot)
        )
        mistakes += ["its coupled drives are others"] * (theirs != ours)
    remedy = "give a file with the joints of the robot that is identified, or an estimate of it"
    if not mistakes:
        trios = zip(robot.joints, known.joints, list_turns(known, robot), strict=True)
        joints = tuple(
            replace(
                joint,
                inertial=move_link(other, turn),
                drive=replace(joint.drive, rotor_inertia=other.drive.rotor_inertia),
                spring=other.spring,
            )
            for joint, other, turn in trios
        )
        drives = zip(robot.couplings, known.couplings, strict=True)
        couplings = tuple(replace(one, rotor_inertia=other.rotor_inertia) for one, other in drives)
        base = dynamics.derive_base_parameters(robot)
        values = dynamics.compute_parameter_values(replace(robot, joints=joints, couplings=couplings), base)
        lost = [entry.name for entry in base.parameters if entry.name not in values]
        if not lost or (partly and values):
            return values
        links = [joint.name for joint in known.joints if joint.inertial is None]
        rotors = [one.name for one in known.joints if one.drive.has_rotor and one.drive.rotor_inertia is None]
        rotors += [one.name for one in known.couplings if one.has_rotor and one.rotor_inertia is None]
        held = [(joint.name, joint.spring) for joint in known.joints if joint.spring is not None]
        springs = [name for name, spring in held if None in (spring.stiffness, spring.rest)]
        parts = (("link values", links), ("rotor inertia", rotors), ("stiffness or rest", springs))
        mistakes = [f"it states no {what} of {', '.join(names)}" for what, names in parts if names]
        mistakes.append(f"so {len(lost)} of {len(base.parameters)} base parameters have no value")
        remedy = "state them, or give an estimate of base parameters"
    texts = [f"--known: {text}" for text in mistakes]
    texts[-1] += f"; {remedy}"
    file = known.path
    raise EstimateError(*(Notice(code="estimate.known-robot", text=text, file=file) for text in texts))


def move_link(joint: Joint, turn: FloatArray) -> tuple[float, ...] | None:
    """Return a link's parameters seen from its frame turned by (4, 4); None where it has none."""
    if joint.inertial is None:
        return None
    rotation = turn[:3, :3].T
    return move_parameters(joint.inertial, rotation, -rotation @ turn[:3, 3])


def list_turns(known: Robot, robot: Robot) -> list[FloatArray]:
    """Return the link frames of `robot`, each (4, 4) seen from that of `known`, of joints with one order.

    Frames that are turned about the joint's axis or shifted along it have the same motion.
    """
    turns: list[FloatArray] = []
    for other, joint in zip(known.joints, robot.joints, strict=True):
        before = turns[joint.parent] if joint.parent >= 0 else np.eye(4)
        stands = before @ build_frame(joint.placement, robot)
        turns.append(np.asarray(np.linalg.solve(build_frame(other.placement, known), stands)))
    return turns


def build_frame(place: Placement, robot: Robot) -> FloatArray:
    """Return a placement in a robot as (4, 4), with its lengths in m."""
    symbols, frame = dict(robot.symbols), np.eye(4)
    frame[:3, :3] = [[entry.to_float(symbols) for entry in row] for row in place.rotation]
    frame[:3, 3] = [entry.to_float(symbols) for entry in place.translation]
    return frame


def list_frame_differences(known: Robot, robot: Robot) -> list[str]:
    """Return where joints of `known` are not those of `robot`, or stand elsewhere."""
    names, wanted = ([joint.name for joint in entry.joints] for entry in (known, robot))
    if names != wanted:
        listed = f"its joints are {', '.join(names)}, those of {robot.name!r} {', '.join(wanted)}"
        return [f"{listed}: names and order must be the same"]
    pairs = list(zip(known.joints, robot.joints, strict=True))
    differences = [
        f"joint {joint.name!r} is of another kind, follows or stands on another one"
        for other, joint in pairs
        if (other.kind, other.parent, other.mimic) != (joint.kind, joint.parent, joint.mimic)
    ]
    # An axis moves all that it carries: the first one that differs tells most.
    for name, turn in zip(names, [] if differences else list_turns(known, robot), strict=False):
        # Its direction z, and where it meets the plane across it.
        apart = float(np.max(np.abs([*(turn[:3, 2] - (0.0, 0.0, 1.0)), *turn[:2, 3]])))
        # Files round angles.
        if apart > numerics.CONVERGED:
            where = f"elsewhere than in {robot.name!r}, by {apart:.3g} m or rad"
            differences.append(f"the axis of joint {name!r} stands {where}")
            break
    return differences
