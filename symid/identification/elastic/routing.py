"""Which model suits robot, logs and options: rigid, motor side alone, or elastic; which settings it uses.

Without the position of the link, q is taken as theta: torsion changes gravity and inertia by its own size
only, 10^-2 and less. The rotor then turns with the link, its inertia a part of the base parameters again.

Supported: the rigid model with rotors merged, by any rows and estimator. Not supported on the motor side:
stiffness, hysteresis, and rotor and link inertia apart; each is refused with its reason.
"""

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from symid.errors import LogError, Notice, UsageError
from symid.identification.estimators import Estimate, Outcome, ParameterEstimate
from symid.logs import Recording, cut_ends
from symid.robot import Processing, Robot

_PREFIX = "processing."
_CUTOFF = "filter_cutoff"
_ENDS = ("drop_first", "drop_last")
_USED = {"elastic": (_CUTOFF, *_ENDS), "stiffness": _ENDS}
_WHY = "elastic joints are identified at the full rate of the log, with filters of their own"
_OPTIONS = {_CUTOFF: " (--cutoff)", "decimation.factor": " (--decimate)"}
_OTHERS = ("filter_order", "filter_torque", "standstill", "noise_freedom", "decimation", _CUTOFF)


def check_settings(settings: Sequence[tuple[str, str]], kind: str) -> None:
    """Raise UsageError for settings of a call that have no meaning for `kind`, "elastic" or "stiffness"."""
    names = dict.fromkeys(key.removeprefix(_PREFIX) for key, _ in settings if key.startswith(_PREFIX))
    useless = [f"{_PREFIX}{name}{_OPTIONS.get(name, '')}" for name in names if name not in _USED[kind]]
    if useless:
        allowed = ", ".join(_PREFIX + name for name in _USED[kind])
        text = f"{', '.join(useless)} cannot be used here: {_WHY}. Allowed are {allowed}"
        raise UsageError(Notice(code="usage.elastic-processing", text=text))


def list_unused_settings(robot: Robot, kind: str) -> tuple[Notice, ...]:
    """Return a notice on the settings of the robot file that `kind`, as above, does not use."""
    stated, standard = robot.processing, replace(Processing(), automatic=robot.processing.automatic)
    names = [name for name in _OTHERS if name not in _USED[kind]]
    unused = ", ".join(name for name in names if getattr(stated, name) != getattr(standard, name))
    text = f"[processing] {unused}: not used here: {_WHY}. Used are {', '.join(_USED[kind])}"
    return (Notice(code="identify.unused-processing", text=text, file=robot.path),) if unused else ()


def get_stated_cutoff(robot: Robot, settings: Sequence[tuple[str, str]]) -> float | None:
    """Return the cut-off in Hz that robot file or call state: 0 for no filter, None to choose one."""
    stated = robot.processing.filter_cutoff
    return 0.0 if stated is None and _PREFIX + _CUTOFF in dict(settings) else stated


def cut_logs(recordings: Sequence[Recording], processing: Processing) -> tuple[Recording, ...]:
    """Return the recordings, their ends cut off; raise LogError with every log of which nothing is left."""
    cut: list[Recording] = []
    notices: list[Notice] = []
    for recording in recordings:
        try:
            cut.append(cut_ends(recording, processing.drop_first, processing.drop_last))
        except LogError as error:
            notices += error.notices
    if notices:
        raise LogError(*notices)
    return tuple(cut)


_STIFFNESS = (
    "not identifiable: the log has one position a joint, so that its torsion is not measured; measure the "
    "link's position, lock the link, or load it statically"
)
_HYSTERESIS = "not identifiable: it is a loop of torque over torsion, and the torsion is not measured"
_SPLIT = (
    "not identifiable: only torsional motion separates rotor from link inertia, and it is not measured; only "
    "their sum is reliable. Take the rotor's from the data sheet, or measure the link's position"
)
_LINK_NAME = re.compile(r"link_position_?\d*")
_ROTOR_NAME = re.compile(r"IA\d+")


def build_rigid_variant(robot: Robot) -> Robot:
    """Return the robot with all joints rigid: rotors turn with their links."""
    return replace(robot, joints=tuple(replace(joint, elasticity=None) for joint in robot.joints))


def build_rigid_estimate(estimate: Estimate, robot: Robot) -> Estimate:
    """Return an estimate of the rigid variant without its refusals of what only `robot` has."""
    elastic = dict(list_unidentifiable(robot))
    return replace(estimate, refused=tuple(entry for entry in estimate.refused if entry[0] not in elastic))


def build_motor_recording(recording: Recording, robot: Robot) -> Recording:
    """Return a recording as the motor side alone has it, for the rigid variant of an elastic robot.

    The position of the motors is right for friction and rotors, and wrong by the torsion for gravity; that of
    the links would be wrong by the speed of the torsion wherever friction changes its sign.
    """
    if not any(robot.elastic) or recording.motor_position is None:
        return recording
    # A rigid joint has one position, whichever encoder it is of; a channel that never moves is no encoder.
    taken = np.array(robot.elastic) & (np.ptp(recording.motor_position, axis=0) > 0.0)
    text = "the log has two positions a joint; that of the motor is used for elastic joints, because "
    text += "friction and rotors turn with it. Gravity is wrong by the torsion"
    notice = Notice(code="log.motor-position", text=text, file=recording.source)
    return replace(
        recording,
        position=np.where(taken, recording.motor_position, recording.position),
        velocity=None,
        acceleration=None,
        motor_position=None,
        notices=(*recording.notices, notice),
    )


def warn_of_rotors(parameters: Sequence[ParameterEstimate]) -> tuple[Notice, ...]:
    """Return a warning where rotor inertias are negative, which no motor has."""
    names = [entry.name for entry in parameters if _ROTOR_NAME.fullmatch(entry.name) and entry.value < 0.0]
    text = f"negative rotor inertia, which is impossible: {', '.join(names)}. Check whether the position is "
    text += "that of the links, and sign and factor of the torque; if the motions are too slow to separate "
    text += "rotors from links, take the inertia from the data sheet"
    return (Notice(code="elastic.negative-rotor", text=text),) if names else ()


def has_both_encoders(recordings: Sequence[Recording]) -> bool:
    """Return whether every recording has the positions of motors and of links."""
    return all(entry.motor_position is not None or entry.link_position is not None for entry in recordings)


def list_unidentifiable(robot: Robot) -> tuple[tuple[str, str], ...]:
    """Return name and reason of what is not identified of an elastic robot by one position a joint."""
    refused: list[tuple[str, str]] = []
    for number, joint in enumerate(robot.joints, start=1):
        if joint.elasticity is not None:
            refused += [(f"stiffness{number}", _STIFFNESS), (f"hysteresis{number}", _HYSTERESIS)]
            refused += [(f"IA{number} apart from the link", _SPLIT)] * joint.drive.has_rotor
    return tuple(refused)


def refuse_elasticity(estimate: Estimate, robot: Robot, *, both: bool = False) -> Estimate:
    """Return the estimate of the rigid variant, with what is not identifiable of `robot`.

    With `both` the logs have both positions, and coupled drives stand in the way.
    """
    one = "the logs have one position a joint, taken as that of its motor"
    text = f"{'coupled drives turn with elastic joints' if both else one}: the rigid model was identified, "
    text += "with rotor inertias merged into the base parameters; stiffness and hysteresis are not "
    text += "identifiable"
    notice = Notice(code="elastic.motor-side", text=text)
    return replace(
        estimate,
        refused=(*estimate.refused, *list_unidentifiable(robot)),
        outcome=Outcome.SOME_REFUSED,
        notices=(notice, *warn_of_rotors(estimate.parameters), *estimate.notices),
    )


def choose_route(
    robot: Robot,
    recordings: Sequence[Recording],
    *,
    method: str | None,
    elastic: Sequence[str],
    rigid: Sequence[str],
) -> str:
    """Return how robot, logs and options go together: "rigid", "motor-side" or "elastic".

    `elastic` and `rigid` name the options for elastic joints and for rigid robots that were given; `method`
    is that for elastic joints, or None.

    Raises:
        UsageError: options of one kind for a robot, method or log of another.
        LogError: some logs have two encoders and some one; the one position is that of the links.
    """
    without = [entry.source for entry in recordings if not has_both_encoders((entry,))]
    if 0 < len(without) < len(recordings) and any(robot.elastic):
        text = "this log has one position a joint, others have two; give logs of one kind in one call"
        raise LogError(*(Notice(code="log.mixed-encoders", text=text, file=source) for source in without))
    sprung = {index for index, joint in enumerate(robot.joints) if joint.elasticity is not None}
    bound = [drive.name for drive in robot.couplings if sprung & {index for index, _ in drive.terms}]
    if bound and method is not None:
        text = f"--method {method}: the coupled drives {', '.join(bound)} turn with elastic joints, which no "
        text += "method for springs describes; leave it out"
        raise UsageError(Notice(code="usage.method", text=text))
    if any(robot.elastic) and not bound and (not without or method is not None):
        if without:
            text = f"--method {method} needs the positions of motors and links, and the log has one a joint. "
            text += "Name the other in [log.motor_position] or [log.link_position], or leave --method out to "
            text += "identify the motor side alone"
            raise UsageError(Notice(code="usage.one-encoder", text=text))
        _refuse_options(rigid, f"the elastic robot {robot.name!r}")
        return "elastic"
    if method is not None:
        text = f"--method {method}: the robot {robot.name!r} has no elastic joints; leave it out, or use "
        text += "--method stiffness"
        raise UsageError(Notice(code="usage.method", text=text))
    _refuse_options(elastic, f"{robot.name!r}, identified as rigid")
    if not any(robot.elastic):
        return "rigid"
    stated = (robot.log.position, robot.log.link_position)
    columns, known = (() if quantity is None else quantity.columns for quantity in stated)
    if without and columns and all(name in known or _LINK_NAME.fullmatch(name) for name in columns):
        text = f"its one position ({', '.join(columns)}) is that of the links, but friction and rotors turn "
        text += "with the motors: elastic joints cannot be identified from it. Name the columns of the "
        text += "motors in [log.motor_position], or in [log.position] alone"
        raise LogError(*(Notice(code="elastic.link-side", text=text, file=one.source) for one in recordings))
    return "motor-side"


def _refuse_options(given: Sequence[str], what: str) -> None:
    if given:
        text = f"{', '.join(given)} cannot be used with {what}; leave {'them' if given[1:] else 'it'} out"
        raise UsageError(Notice(code="usage.mixed-options", text=text))
