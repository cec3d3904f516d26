"""`symid identify --method ...`: which method a robot and its logs get, and what those of elastic joints say.

Input: the robot, its recordings, options of the command line. Output: a route, and answers.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, ParamSpec, TypeVar

import click

from symid.cli.elastic_tables import (
    describe_alignment,
    describe_elastic,
    describe_stiffness,
    show_alignment,
    show_elastic_parameters,
    show_springs,
    show_stiffness,
    show_trials,
)
from symid.cli.inputs import describe_settings, load_robot_library, show_path
from symid.cli.options import FiniteRange
from symid.cli.output import Answer, Console, write_json
from symid.cli.tables import show_residual
from symid.elastic.options import METHODS as ELASTIC_METHODS
from symid.errors import LogError, Notice, UsageError

if TYPE_CHECKING:  # these load numpy
    from symid.data.recording import Recording
    from symid.elastic.options import ElasticOptions
    from symid.robot.description import Robot

__all__ = ["METHODS", "Route", "answer_elastic", "answer_stiffness", "choose_route", "elastic_options"]

P = ParamSpec("P")
R = TypeVar("R")

METHODS = (*ELASTIC_METHODS, "stiffness")


@dataclass(frozen=True, slots=True, kw_only=True)
class Route:
    """What is done: "rigid", "motor-side", "stiffness" or "elastic", the last with a method."""

    kind: str
    method: str = ""


def elastic_options(function: Callable[P, R]) -> Callable[P, R]:
    """Give a verb the options of elastic joints."""
    positive = FiniteRange(min=0.0, min_open=True)
    options = (
        click.option(
            "--method", type=click.Choice(METHODS), help="Of elastic joints; stiffness is for any robot."
        ),
        click.option("--tolerance", type=positive, help="Relative change at which an iteration stops."),
        click.option(
            "--thresholds", type=click.IntRange(min=0), metavar="N", help="Stops of each joint's hysteresis."
        ),
        click.option(
            "--knees", type=click.IntRange(min=0), metavar="N", help="Knees on each side of its spring."
        ),
        click.option(
            "--window", type=positive, metavar="S", help="Length of a momentum, filtered or energy row."
        ),
        click.option("--lambda", "rate", type=positive, metavar="RAD/S", help="Of the first-order filter."),
    )
    for option in reversed(options):
        function = option(function)
    return function


def choose_route(
    robot: "Robot",
    recordings: Sequence["Recording"],
    *,
    method: str | None,
    elastic: Mapping[str, object],
    rigid: Sequence[str],
) -> Route:
    """Return what the robot, its logs and the options together ask for.

    Args:
        robot: as read.
        recordings: the logs.
        method: one of `METHODS`, or None.
        elastic: the options of elastic joints, None where not given.
        rigid: names of the options of rigid robots that were given.

    Raises:
        UsageError: options of one kind for a robot, method or log of another.
        LogError: some logs have two encoders and some one; the one position is that of the links.
    """
    from symid.elastic.motor_side import check_motor_side, has_both_encoders

    if method == "stiffness":
        _refuse_mixed(rigid, elastic, "--method stiffness")
        return Route(kind="stiffness")
    both = [has_both_encoders((recording,)) for recording in recordings]
    whole = all(robot.elastic)
    if any(both) and not all(both) and any(robot.elastic):
        without = [recording.source for recording, has in zip(recordings, both, strict=True) if not has]
        text = "this log has one position a joint, others have two; give logs of one kind in one call"
        raise LogError(*(Notice(code="log.mixed-encoders", text=text, file=source) for source in without))
    if whole and (all(both) or method is not None):
        if not all(both):
            text = (
                f"--method {method} needs the positions of motors and links, and the log has one a joint: "
                "name the other in [log.motor_position] or [log.link_position], or leave --method out to "
                "identify what the motor side alone can tell"
            )
            raise UsageError(Notice(code="usage.one-encoder", text=text))
        _refuse_mixed(rigid, {}, f"the elastic robot {robot.name!r}")
        return Route(kind="elastic", method=method or "automatic")
    if method is not None:
        kind = "has rigid joints besides elastic ones" if any(robot.elastic) else "has no elastic joints"
        text = f"--method {method}: the robot {robot.name!r} {kind}; leave it out, or use --method stiffness"
        raise UsageError(Notice(code="usage.method", text=text))
    others = {name: value for name, value in elastic.items() if name != "window"}
    _refuse_mixed((), others, f"{robot.name!r}, identified as rigid")
    if any(robot.elastic) and not any(both):
        check_motor_side(robot, recordings)
    return Route(kind="motor-side" if any(robot.elastic) else "rigid")


def _refuse_mixed(rigid: Sequence[str], elastic: Mapping[str, object], what: str) -> None:
    names = {"rate": "lambda"}
    given = [
        *rigid,
        *(f"--{names.get(name, name)}" for name, value in elastic.items() if value is not None),
    ]
    if given:
        text = f"{', '.join(given)} cannot be used with {what}; leave {'them' if given[1:] else 'it'} out"
        raise UsageError(Notice(code="usage.mixed-options", text=text))


def answer_stiffness(
    console: Console,
    robot: "Robot",
    recordings: Sequence["Recording"],
    output: Path | None,
) -> Answer:
    """Return the delay between the encoders, their offsets and the stiffness of every joint."""
    from symid.elastic.stiffness import find_stiffness
    from symid.identification.storage import write_file

    library = load_robot_library(robot, console)
    console.progress(f"finding the stiffness of {robot.name}")
    found = find_stiffness(library, recordings)
    told = sum(entry.stiffness is not None for entry in found.joints)
    text = [
        f"{found.robot}: the stiffness of {told} of {len(found.joints)} joints can be told",
        show_alignment(found.alignment, [entry.joint for entry in found.joints]),
        show_stiffness(found),
        "\n".join(f"{entry.joint}: {entry.reason}" for entry in found.joints),
    ]
    result = {
        "robot": found.robot,
        "method": "stiffness",
        **describe_alignment(found.alignment, [entry.joint for entry in found.joints]),
        **describe_stiffness(found),
        "sources": found.alignment.sources,
        "file": output,
    }
    if output is not None:
        text.append(f"result: {show_path(write_file(output, write_json(result)))}")
    return Answer(
        text="\n\n".join(text),
        result=result,
        warnings=(*library.notices, *found.notices),
    )


def answer_elastic(
    console: Console,
    robot: "Robot",
    recordings: Sequence["Recording"],
    *,
    method: str,
    options: Mapping[str, object],
    output: Path | None,
) -> Answer:
    """Return dynamics, friction and springs of an elastic robot whose logs have both encoders.

    Delay and offsets of the link encoders are taken out first, where they are beyond doubt.
    """
    from symid.elastic.identify import identify_elastic
    from symid.elastic.motor_side import warn_of_rotors
    from symid.elastic.storage import write_elastic_estimate
    from symid.elastic.torsion import prepare_aligned

    chosen = _build_options(method, options)
    library = load_robot_library(robot, console)
    moved, alignment, told = prepare_aligned(library, recordings)
    count = f"{len(moved)} log{'s'[: len(moved) > 1]}"
    console.progress(f"identifying {robot.name} from {count} by the method {method!r}")
    joints = [card.name for card in library.card.joints]
    aligned = None if alignment is None else describe_alignment(alignment, joints)
    echo = {**describe_settings(robot), "log_digests": _find_digests(recordings)}
    estimate = identify_elastic(library, moved, chosen, echo=echo)
    estimate = replace(estimate, notices=(*estimate.notices, *warn_of_rotors(estimate.parameters)))
    text = [
        f"{estimate.robot}: {estimate.method}, condition {estimate.condition:.3g}: {estimate.outcome.value}",
        f"{estimate.reason[0].upper()}{estimate.reason[1:]}.",
        show_elastic_parameters(estimate),
        *([show_springs(estimate)] if estimate.springs else []),
        show_residual((*estimate.residual, estimate.energy)),
        *([show_trials(estimate)] if len(estimate.trials) > 1 else []),
        *(f"refused: {name}: {reason}" for name, reason in estimate.refused),
    ]
    if output is not None:
        text.append(f"estimate: {show_path(write_elastic_estimate(estimate, output))}")
    result = {**describe_elastic(estimate), "alignment": aligned, "file": output, "backend": library.backend}
    warnings = (*library.notices, *told, *estimate.notices)
    return Answer(text="\n\n".join(text), result=result, warnings=warnings)


def _build_options(method: str, options: Mapping[str, object]) -> "ElasticOptions":
    """Return the options, those that are not given left at their defaults."""
    from symid.elastic.options import ElasticOptions

    given = {name: value for name, value in options.items() if value is not None}
    if "thresholds" in given:
        given["stops"] = given.pop("thresholds")
    return ElasticOptions(method=method, **given)  # type: ignore[arg-type]


def _find_digests(recordings: Sequence["Recording"]) -> list[str | None]:
    from symid.identification.validate import find_digest

    return [find_digest(recording.source) for recording in recordings]
