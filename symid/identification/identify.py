"""From a robot and its recordings to an estimate: rigid, motor side alone, elastic joints, or friction.

Robot, recordings, options -> `Identification`.

    robot, recordings, options -> route -> library -> estimate, with warnings

Supported: all rows, estimators and methods; runs of unequal weight and with known payloads; a friction law
and its parameters for every joint that moves, of elastic robots on the motor side with a rigid model.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar

from symid import logs as log_files
from symid.codegen import Library
from symid.environment import report_count, show_path
from symid.errors import Notice, UsageError
from symid.identification import (
    elastic as elastics,
    friction as frictions,
    friction_search,
    regression,
    rigid as rigids,
)
from symid.identification.estimators import Estimate, FitRecord, FittedLaw, check_bodies
from symid.identification.judge import POLICY
from symid.identification.mounting import refuse_mounting, search_mounting
from symid.identification.options import IdentifyOptions, LawOptions
from symid.identification.stored import read_rigid
from symid.robot import Robot, describe_settings, name_for_commands
from symid.serialization import write_plain

Fit_co = TypeVar("Fit_co", bound=FitRecord, covariant=True)
Record = TypeVar("Record", bound=FitRecord)
Recordings = Sequence[log_files.Recording]
Pairs = Sequence[tuple[str, str]]
"""Settings of a call: keys and values."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskContext:
    """Shared services: `prepare` returns the compiled functions of a robot, `progress` takes a short text."""

    prepare: Callable[[Robot], Library]
    progress: Callable[[str], None]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Identification(Generic[Fit_co]):
    """A fit, and what came with it: notices, those of the robot and its logs first, and the backend.

    `alignment`: delay and offsets of the link encoders, where they were estimated.
    """

    estimate: Fit_co
    notices: tuple[Notice, ...]
    backend: str
    alignment: log_files.Alignment | None = None


def identify_robot(
    robot: Robot,
    recordings: Recordings,
    options: IdentifyOptions,
    context: TaskContext,
    pairs: Pairs = (),
    *,
    named: bool = False,
) -> Identification[Estimate | elastics.ElasticEstimate]:
    """Return the parameters of a robot, with the settings of the call, that explain its recordings best.

    `pairs` are these settings, which the robot has already; `options.friction` is a law that is to be found,
    None where the robot has its laws, of its file or `named` by the call.
    """
    estimator = options.estimator
    if any(robot.elastic):
        log_files.refuse_known_payloads(recordings, "a robot with elastic joints")
    elif estimator in rigids.SIMULATING:
        log_files.refuse_known_payloads(recordings, f"--estimator {estimator}")
    route = elastics.choose_route(
        robot, recordings, method=options.method, elastic=options.list_elastic(), rigid=options.list_given()
    )
    # Motors of elastic joints have their laws chosen in any case.
    elastic = route == "elastic" and options.friction != frictions.AUTO
    if route == "elastic" and (robot.free_gravity or robot.free_zeros):
        raise refuse_mounting(where="with elastic joints")
    if options.friction is not None and (elastic or estimator in rigids.SIMULATING):
        where = "elastic joints are" if elastic else f"--estimator {estimator} is"
        raise friction_search.refuse_search(options.friction, f"is not done where {where} identified")
    if estimator in rigids.SIMULATING:
        friction_search.refuse_states(robot, f"--estimator {estimator}")
    if route == "elastic":
        by_method = prepare_elastic_methods(robot, recordings, options, context, pairs, named=named)
        return by_method(options.method or "automatic")
    if options.known is not None:
        text = f"--known cannot be used with {robot.name!r}, identified as rigid; leave it out, or use it "
        text += "with --rows friction, or give known values as a prior (--estimator ridge --prior)"
        raise UsageError(Notice(code="usage.mixed-options", text=text))
    return _identify_rigid(robot, recordings, options, context, motor_side=route == "motor-side")


def _list_log_notices(robot: Robot, recordings: Recordings) -> tuple[Notice, ...]:
    found: tuple[Notice, ...] = robot.notices
    for recording in recordings:
        found += (*recording.notices, *log_files.check_recording(recording, robot))
    return found


def _identify_rigid(
    robot: Robot, recordings: Recordings, options: IdentifyOptions, context: TaskContext, *, motor_side: bool
) -> Identification[Estimate]:
    rows, estimator, overlap = options.rows or "torque", options.estimator, options.overlap or 0.0
    friction = options.friction
    rigids.check_rigid_options(rows, estimator, options)
    warnings = (*_list_log_notices(robot, recordings), *friction_search.describe_states(robot, friction))
    both = elastics.has_both_encoders(recordings)
    recordings = [elastics.build_motor_recording(recording, robot) for recording in recordings]
    rigid = elastics.build_rigid_variant(robot) if motor_side else robot
    if estimator in rigids.SIMULATING:
        # What cannot be simulated is refused before anything is compiled.
        rigids.check_closed_loop(robot, recordings)
    context.progress(f"identifying {robot.name} from {len(recordings)} log{'s'[: len(recordings) > 1]}")
    rule = regression.RankRule(least=0.0 if options.partial else POLICY.whole)
    shared: Any = {"rule": rule, "weights": log_files.get_run_weights(recordings)}
    common = {**shared, "rows": rows, "estimator": estimator, "window": options.window, "overlap": overlap}
    told: Any = {"progress": context.progress}
    if rigid.free_gravity or rigid.free_zeros or friction is not None:
        told["echo"] = log_files.describe_logs(rigid, recordings)
    if rigid.free_gravity or rigid.free_zeros:
        estimate, library = search_mounting(rigid, recordings, context.prepare, options, **common, **told)
    elif friction is not None:
        if options.prior is not None or estimator == "ridge":
            raise friction_search.refuse_search(friction, "a prior does not know")
        search = friction_search.search_friction
        estimate, library = search(rigid, recordings, friction, context.prepare, **common, **told)
    else:
        library = context.prepare(rigid)
        start, start_name, prior = None, "", None
        if options.start is not None:
            start = read_rigid(options.start, library.card)
            start_name = f"an estimate by {start.estimator}"
            if isinstance(options.start, str | PathLike):
                start_name = show_path(Path(options.start))
        if options.prior not in (None, rigids.PRIOR_OF_ROBOT):
            prior = read_rigid(options.prior, library.card)
            check_bodies(prior, rigid, library.card)

        def fit(logs: Recordings) -> Estimate:
            told["echo"] = log_files.describe_logs(rigid, logs)
            if estimator in rigids.SIMULATING:
                begin = {"start": start, "start_name": start_name, **shared, **told}
                return rigids.identify_closed_loop(estimator, rigid, library, logs, **begin)
            own = rigids.build_estimator_options(rigid, library, logs, estimator, options, prior=prior)
            call = {**common, "options": own, "echo": told["echo"], "robot": rigid}
            return rigids.identify_parameters(library, logs, rigid.processing, **call)

        # Loads that friction reads, and that were not measured, follow from the estimate.
        estimate = friction_search.identify_loaded(library, recordings, rigid.processing, fit)
    motion = regression.outline_motion(library, recordings, rigid.processing)
    estimate = replace(estimate, motion=motion)
    if motor_side:
        estimate = elastics.refuse_elasticity(estimate, robot, both=both)
        notes = (note for entry in recordings for note in entry.notices)
        warnings += tuple(note for note in notes if note.code == "log.motor-position")
    elif any(log_files.get_second_encoder_side(recording) for recording in recordings):
        text = "the second encoder of the log is not used: a rigid model takes the position of "
        text += "[log.position]; --method stiffness uses both"
        warnings += (Notice(code="identify.second-encoder", text=text),)
    scales = _compare_with_file(library, rigid, estimate)
    estimate = _add_origin(estimate, robot, recordings, scales)
    notices = (*warnings, *library.notices, *estimate.notices)
    notices += rigids.describe_scales(scales, rigid, "identify.scale")
    return Identification(estimate=estimate, notices=notices, backend=library.backend)


def _add_origin(
    record: Record, robot: Robot, recordings: Recordings, scales: Sequence[rigids.JointScale] = ()
) -> Record:
    """Return the record with what the robot file says of it: name, true values, fixed bodies, overloads."""
    simulated = all(entry.simulated == robot.values_signature for entry in recordings)
    name = name_for_commands(robot)
    beyond = rigids.keep_overloads(log_files.find_overloads(recordings, robot), scales)
    told = {
        "fixed": [write_plain(body) for body in robot.fixed],
        "beyond_limit": {joint: list(pair) for joint, pair in beyond.items()},
    }
    settings = {**record.settings, **{key: value for key, value in told.items() if value}}
    return replace(record, simulated=simulated, file="" if name == robot.name else name, settings=settings)


def _compare_with_file(
    library: Library, robot: Robot, estimate: Estimate | elastics.ElasticEstimate
) -> tuple[rigids.JointScale, ...]:
    """Return how many times torques are those of the robot file's values."""
    refused, motion = dict(estimate.refused), estimate.motion if isinstance(estimate, Estimate) else ()
    return rigids.compare_fit_scales(
        library, robot, estimate.parameters, estimate.covariance, motion, refused
    )


def prepare_elastic_methods(
    robot: Robot,
    recordings: Recordings,
    options: IdentifyOptions,
    context: TaskContext,
    pairs: Pairs = (),
    *,
    named: bool = False,
) -> Callable[[str | elastics.Maker], Identification[elastics.ElasticEstimate]]:
    """Return what identifies by a method, as `elastic.fit_method`; equations are built once for all.

    The robot has elastic joints and its logs have both positions; the method of the options does not count.
    `pairs` and errors are those of `identify_robot`.
    """
    ready = _prepare_elastic(robot, recordings, options.build_elastic(), pairs, context)
    elastic = ready.options
    if options.known is not None:
        # Imported here: it needs SymPy.
        from symid.identification.identified import name_known_dynamics

        elastic = replace(elastic, known=name_known_dynamics(options.known, robot, ready.library))
    echo = {**describe_settings(robot), **log_files.describe_runs(ready.cut)}

    def adopt(laws: Sequence[FittedLaw]) -> Library:
        context.progress(
            "taking other friction laws: " + ", ".join(f"{law.joint}: {law.law}" for law in laws)
        )
        return context.prepare(friction_search.set_friction(robot, {law.joint: law.friction for law in laws}))

    # A law that the call names stays.
    friction = {joint.name: joint.friction for joint in robot.axes}
    by_method = elastics.prepare_methods(
        ready.library, ready.moved, elastic, echo=echo, friction=friction, adopt=None if named else adopt
    )

    def identify(method: str | elastics.Maker) -> Identification[elastics.ElasticEstimate]:
        name = method if isinstance(method, str) else method.__name__
        context.progress(f"identifying {robot.name} from {ready.counted} by the method {name!r}")
        found = by_method(method)
        estimate = replace(found, notices=(*found.notices, *elastics.warn_of_rotors(found.parameters)))
        scales = _compare_with_file(ready.library, robot, estimate)
        estimate = _add_origin(estimate, robot, recordings, scales)
        if not estimate.simulated:
            springs = tuple(replace(spring, truth=None) for spring in estimate.springs)
            estimate = replace(estimate, springs=springs)
        return Identification(
            estimate=estimate,
            notices=(
                *(*ready.notices, *estimate.notices),
                *rigids.describe_scales(scales, robot, "identify.scale"),
            ),
            backend=ready.library.backend,
            alignment=ready.alignment,
        )

    return identify


class _ElasticInput(NamedTuple):
    """What elastic joints are identified from: recordings cut, and those with encoders aligned."""

    library: Library
    options: elastics.ElasticOptions
    cut: Recordings
    moved: Recordings
    alignment: log_files.Alignment | None
    notices: tuple[Notice, ...]

    @property
    def counted(self) -> str:
        return f"{len(self.cut)} log{'s'[: len(self.cut) > 1]}"


def _prepare_elastic(
    robot: Robot, recordings: Recordings, options: elastics.ElasticOptions, pairs: Pairs, context: TaskContext
) -> _ElasticInput:
    elastics.check_settings(pairs, "elastic")
    cut = elastics.cut_logs(recordings, robot.processing)
    cutoff = elastics.get_stated_cutoff(robot, pairs)
    if cutoff is not None:
        options = replace(options, cutoff=cutoff)
    library = context.prepare(robot)
    # What a log says of the unused position of a rigid joint is no news.
    warnings = (
        *_list_log_notices(robot, elastics.join_rigid_joints(library.card, cut)[0]),
        *friction_search.describe_states(robot, None),
    )
    moved, alignment, aligned = elastics.prepare_aligned(library, cut)
    unused = elastics.list_unused_settings(robot, "elastic")
    notices = (*unused, *warnings, *library.notices, *aligned)
    return _ElasticInput(library, options, cut, moved, alignment, notices)


def build_elastic_graph(
    robot: Robot, recordings: Recordings, options: IdentifyOptions, pairs: Pairs, context: TaskContext
) -> "tuple[elastics.nlp.NlpGraph, tuple[Notice, ...]]":
    """Return the one-shot problem of elastic joints as expressions, with notices; see `identify_robot`."""
    log_files.refuse_known_payloads(recordings, "a robot with elastic joints")
    elastics.choose_route(robot, recordings, method="nlp", elastic=(), rigid=options.list_given())
    ready = _prepare_elastic(robot, recordings, options.build_elastic(), pairs, context)
    context.progress(f"identifying {robot.name} from {ready.counted} by the method 'nlp'")
    return elastics.build_one_shot(ready.library, ready.moved, ready.options), ready.notices


def identify_stiffness(
    robot: Robot, recordings: Recordings, pairs: Pairs, context: TaskContext
) -> "tuple[elastics.StiffnessEstimate, tuple[Notice, ...]]":
    """Return the delay between the encoders, their offsets and the stiffness of every joint, with notices."""
    if any(robot.elastic):
        log_files.refuse_known_payloads(recordings, "a robot with elastic joints")
    elastics.check_settings(pairs, "stiffness")
    recordings = elastics.cut_logs(recordings, robot.processing)
    warnings = _list_log_notices(robot, recordings)
    library = context.prepare(robot)
    context.progress(f"estimating the stiffness of {robot.name}")
    found = elastics.estimate_stiffness(library, recordings)
    unused = elastics.list_unused_settings(robot, "stiffness")
    return found, (*unused, *warnings, *library.notices, *found.notices)


def identify_robot_friction(
    robot: Robot, recordings: Recordings, options: LawOptions, context: TaskContext
) -> Identification[frictions.FrictionIdentification]:
    """Return the friction of every joint that the recordings move, of a robot with the call's settings."""
    model = friction_search.read_joint_laws(options.model, robot, (frictions.AUTO,)) or frictions.AUTO
    if not all(regression.list_measured_joints(recordings)) or options.known is not None:
        log_files.refuse_known_payloads(recordings, "--rows friction")
    described = elastics.build_rigid_variant(robot) if any(robot.elastic) else robot
    measured = [elastics.build_motor_recording(recording, robot) for recording in recordings]
    library = context.prepare(described)
    what = "choosing and fitting friction laws"
    if isinstance(model, str) and model != frictions.AUTO:
        what = f"fitting the friction law {model}"
    context.progress(f"{what} for {robot.name} from {len(measured)} log{'s'[: len(measured) > 1]}")
    beta, known = None, None
    if options.known is not None:
        from symid.identification.identified import read_known_values

        beta, known = read_known_values(options.known, described, library)
    task = frictions.FrictionTask(
        model=model,
        estimator=options.estimator or "varpro",
        options=options.search or frictions.FrictionOptions(),
        beta=beta,
        smoothing=options.smoothing or 0.0,
        periods=options.period,
        rotors=regression.list_coupled_rotors(described),
    )
    names = [entry.name for entry in library.card.beta]
    echo = {
        **log_files.describe_logs(robot, measured),
        "known": known,
        "known_values": None if beta is None else dict(zip(names, beta.tolist(), strict=True)),
        "friction": [joint.friction for joint in library.card.joints],
    }
    counted = report_count(context.progress, "joint")
    found = frictions.identify_friction(
        library, measured, described.processing, task, echo=echo, progress=counted
    )
    unused = []
    estimates = [joint.estimate for joint in found.joints]
    beside = {entry.name for estimate in estimates for entry in estimate.extra}
    beside |= {name for estimate in estimates for name, _ in estimate.refused}
    if options.friction and not beside & {entry.name for entry in library.card.friction}:
        text = "--friction is not used: no joint's friction acts on another here; choose the law of a "
        text += "joint's own friction by --model"
        unused.append(Notice(code="friction.unused-option", text=text))
    if options.known is not None and any(regression.list_measured_joints(measured)):
        text = "the loads that joint-torque sensors measured are not used, because base parameters were "
        text += "given; leave --known out to subtract the loads, for which no model of the links is needed"
        unused.append(Notice(code="friction.load-unused", text=text))
    text = f"elastic robot {robot.name!r}: friction was fitted on the motor side with a rigid model, so it "
    text += "includes the losses of springs; identify the whole robot to separate them"
    springs = () if described is robot else (Notice(code="friction.elastic", text=text),)
    found = _add_origin(found, robot, recordings)
    notices = (*_list_log_notices(robot, recordings), *springs, *library.notices, *found.notices, *unused)
    return Identification(estimate=found, notices=notices, backend=library.backend)
