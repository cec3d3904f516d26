"""From a robot and its recordings to an estimate: rigid, of the motor side alone, or of elastic joints.

Input: a robot, recordings, what is asked for. Output: `Identification`.

    robot, recordings, options -> route -> library -> estimate, with what a reader must know

Supported: all rows, estimators and methods; runs of unequal weight and with known payloads.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from symid.codegen.library import Library
from symid.data.alignment import Alignment
from symid.data.checks import check_recording, find_second_encoder
from symid.data.logs import describe_logs, find_digests
from symid.data.recording import Recording
from symid.data.runs import find_weights, refuse_loads
from symid.elastic.estimate import ElasticEstimate
from symid.elastic.motor_side import (
    build_motor_recording,
    build_rigid_variant,
    has_both_encoders,
    refuse_elasticity,
    warn_of_rotors,
)
from symid.elastic.options import ElasticOptions
from symid.elastic.route import choose_route
from symid.elastic.settings import check_settings, cut_logs, find_asked_cutoff, list_unused_settings
from symid.errors import Notice, UsageError
from symid.estimators.estimate import Estimate
from symid.formats.settings import describe_settings
from symid.identification.estimator_options import (
    OUTPUT_ERROR,
    SIMULATING,
    RigidOptions,
    build_estimator_options,
    check_estimator,
    check_rigid_options,
    find_estimate,
)
from symid.identification.identify import identify_parameters
from symid.paths import show_path
from symid.robot.description import Robot
from symid.rows.identifiability import WHOLE_MODEL, RankRule

if TYPE_CHECKING:  # what only some fits need takes a while to load
    from symid.elastic.stiffness import StiffnessEstimate

__all__ = [
    "Identification",
    "IdentifyTask",
    "Workshop",
    "identify_robot",
    "identify_stiffness",
    "list_log_notices",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Workshop:
    """What long work needs besides its data.

    Args:
        prepare: returns the compiled functions of a robot.
        progress: called with a short text on what begins.
    """

    prepare: Callable[[Robot], Library]
    progress: Callable[[str], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentifyTask:
    """What is asked for.

    Args:
        pairs: settings of the call, keys and values; they are part of the robot already.
        rigid: options of rows and estimators.
        method: of elastic joints, None for the automatic choice.
        elastic: options of elastic joints that were given: tolerance, thresholds, knees, window, rate.
        options: all options of elastic joints, in place of the defaults; `elastic` wins over them.
    """

    pairs: tuple[tuple[str, str], ...] = ()
    rigid: RigidOptions = field(default_factory=RigidOptions)
    method: str | None = None
    elastic: Mapping[str, object] = field(default_factory=dict)
    options: ElasticOptions | None = None

    def __post_init__(self) -> None:
        """Refuse an unknown estimator before a log is read.

        Raises:
            UsageError: there is no such estimator.
        """
        check_estimator(self.rigid.rows or "torque", self.rigid.estimator)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Identification:
    """An estimate, and what came with it.

    Args:
        estimate: of base parameters, or of dynamics and springs.
        notices: what a reader should know, those of the robot and its logs first.
        backend: what computed the robot's functions.
        alignment: delay and offsets of the link encoders, where they were looked for.
    """

    estimate: Estimate | ElasticEstimate
    notices: tuple[Notice, ...]
    backend: str
    alignment: Alignment | None = None


def identify_robot(
    robot: Robot, recordings: Sequence[Recording], task: IdentifyTask, workshop: Workshop
) -> Identification:
    """Return the parameters of a robot that explain its recordings best.

    Args:
        robot: with the settings of the call.
        recordings: at least one.
        task: what is asked for.
        workshop: library and progress.

    Raises:
        UsageError: options that do not go together, or not with this robot and these logs.
        LogError: a recording does not fit the robot, or what is asked for cannot take a known payload.
        EstimateError: a prior or a start is of another model.
        IdentifiabilityError: nothing can be learnt.
        SolverError: a search ended without a usable result.
    """
    estimator = task.rigid.estimator
    if any(robot.elastic):
        refuse_loads(recordings, "a robot with elastic joints")
    elif estimator in SIMULATING:
        refuse_loads(recordings, f"--estimator {estimator}")
    given = task.rigid.list_given()
    route = choose_route(robot, recordings, method=task.method, elastic=task.elastic, rigid=given)
    if route.kind == "elastic":
        return _identify_elastic(robot, recordings, route.method, task, workshop)
    if task.options is not None:
        text = (
            f"elastic: options of elastic joints cannot be used with {robot.name!r}, identified as rigid; "
            "leave them out"
        )
        raise UsageError(Notice(code="usage.mixed-options", text=text))
    window = task.elastic.get("window")
    options = replace(task.rigid, window=window if isinstance(window, int | float) else None)
    return _identify_rigid(robot, recordings, options, workshop, motor_side=route.kind == "motor-side")


def list_log_notices(robot: Robot, recordings: Sequence[Recording]) -> tuple[Notice, ...]:
    """Return what a reader should know of the robot file and of the logs."""
    found: tuple[Notice, ...] = robot.notices
    for recording in recordings:
        found += (*recording.notices, *check_recording(recording, robot))
    return found


def _identify_rigid(
    robot: Robot,
    recordings: Sequence[Recording],
    options: RigidOptions,
    workshop: Workshop,
    *,
    motor_side: bool,
) -> Identification:
    rows, estimator = options.rows or "torque", options.estimator or "ols"
    check_rigid_options(rows, estimator, options)
    warnings = list_log_notices(robot, recordings)
    both = has_both_encoders(recordings)
    recordings = [build_motor_recording(recording, robot) for recording in recordings]
    rigid = build_rigid_variant(robot) if motor_side else robot
    if estimator in SIMULATING:
        from symid.identification.controlled_estimate import check_controlled

        # What cannot be simulated is refused before anything is compiled.
        check_controlled(robot, recordings)
    library = workshop.prepare(rigid)
    count = f"{len(recordings)} log{'s'[: len(recordings) > 1]}"
    workshop.progress(f"identifying {robot.name} from {count}")
    estimate = _fit(rigid, library, recordings, options, workshop.progress)
    if motor_side:
        estimate = refuse_elasticity(estimate, robot, both=both)
        warnings += tuple(
            note for entry in recordings for note in entry.notices if note.code == "log.motor-position"
        )
    elif any(find_second_encoder(recording) for recording in recordings):
        unused = (
            "the log has a second encoder, which a rigid model has no use for: its position is that of "
            "[log.position]; --method stiffness looks at both"
        )
        warnings += (Notice(code="identify.second-encoder", text=unused),)
    notices = (*warnings, *library.notices, *estimate.notices)
    return Identification(estimate=estimate, notices=notices, backend=library.backend)


def _fit(
    robot: Robot,
    library: Library,
    recordings: Sequence[Recording],
    options: RigidOptions,
    progress: Callable[[str], None],
) -> Estimate:
    """Return the estimate that rows and estimator make of the recordings."""
    rows, estimator = options.rows or "torque", options.estimator or "ols"
    rule = RankRule(least=0.0 if options.partial else WHOLE_MODEL)
    weights, echo = find_weights(recordings), describe_logs(robot, recordings)
    if estimator in SIMULATING:
        from symid.identification.instrumental_estimate import identify_instrumental
        from symid.identification.output_error_estimate import identify_output_error

        identify = identify_output_error if estimator == OUTPUT_ERROR else identify_instrumental
        start = options.start
        return identify(
            robot,
            library,
            recordings,
            start=None if start is None else find_estimate(start, library.card),
            start_name=_name_start(start),
            rule=rule,
            weights=weights,
            echo=echo,
            tell=progress,
        )
    return identify_parameters(
        library,
        recordings,
        robot.processing,
        rows=rows,
        estimator=estimator,
        options=build_estimator_options(robot, library, recordings, estimator, options),
        window=options.window,
        overlap=options.overlap or 0.0,
        rule=rule,
        weights=weights,
        echo=echo,
    )


def _name_start(start: Estimate | Path | None) -> str:
    match start:
        case None:
            return ""
        case Path():
            return show_path(start)
    return f"an estimate by {start.estimator}"


def _identify_elastic(
    robot: Robot,
    recordings: Sequence[Recording],
    method: str,
    task: IdentifyTask,
    workshop: Workshop,
) -> Identification:
    """Return dynamics, friction and springs; delay and offsets of the link encoders are taken out first."""
    from symid.elastic.identify import identify_elastic
    from symid.elastic.torsion import prepare_aligned

    check_settings(task.pairs, "elastic")
    recordings = cut_logs(recordings, robot.processing)
    warnings = list_log_notices(robot, recordings)
    options = _build_elastic_options(method, task, find_asked_cutoff(robot, task.pairs))
    library = workshop.prepare(robot)
    moved, alignment, told = prepare_aligned(library, recordings)
    count = f"{len(moved)} log{'s'[: len(moved) > 1]}"
    workshop.progress(f"identifying {robot.name} from {count} by the method {options.method!r}")
    echo = {**describe_settings(robot), "log_digests": find_digests(recordings)}
    found = identify_elastic(library, moved, options, echo=echo)
    estimate = replace(found, notices=(*found.notices, *warn_of_rotors(found.parameters)))
    unused = list_unused_settings(robot, "elastic")
    notices = (*unused, *warnings, *library.notices, *told, *estimate.notices)
    return Identification(estimate=estimate, notices=notices, backend=library.backend, alignment=alignment)


def _build_elastic_options(method: str, task: IdentifyTask, cutoff: float | None) -> ElasticOptions:
    """Return the options, those that are not given left at their defaults."""
    given = {name: value for name, value in task.elastic.items() if value is not None}
    if "thresholds" in given:
        given["stops"] = given.pop("thresholds")
    if cutoff is not None:
        given["cutoff"] = cutoff
    if task.method is not None or task.options is None:
        given["method"] = method
    return replace(task.options or ElasticOptions(), **given)  # type: ignore[arg-type]  # checked by the record


def identify_stiffness(
    robot: Robot,
    recordings: Sequence[Recording],
    pairs: Sequence[tuple[str, str]],
    workshop: Workshop,
) -> "tuple[StiffnessEstimate, tuple[Notice, ...]]":
    """Return the delay between the encoders, their offsets and the stiffness of every joint, with notices.

    Args:
        robot: with the settings of the call.
        recordings: with the positions of motors and links.
        pairs: settings of the call, keys and values.
        workshop: library and progress.

    Raises:
        UsageError: a setting has no meaning for a stiffness.
        LogError: a recording lacks an encoder, or is too short.
    """
    from symid.elastic.stiffness import find_stiffness

    if any(robot.elastic):
        refuse_loads(recordings, "a robot with elastic joints")
    check_settings(pairs, "stiffness")
    recordings = cut_logs(recordings, robot.processing)
    warnings = list_log_notices(robot, recordings)
    library = workshop.prepare(robot)
    workshop.progress(f"finding the stiffness of {robot.name}")
    found = find_stiffness(library, recordings)
    unused = list_unused_settings(robot, "stiffness")
    return found, (*unused, *warnings, *library.notices, *found.notices)
