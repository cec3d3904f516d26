"""`symid identify --rows friction`: a law of friction, and its parameters, for every joint that moves.

Input: the robot, its recordings, options of the command line. Output: an answer.
"""

import textwrap
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import click

from symid.cli.estimator_options import ESTIMATOR_NAMES
from symid.cli.friction_tables import WIDTH, describe_friction, show_joint
from symid.cli.inputs import describe_settings, load_robot_library, show_path
from symid.cli.options import FiniteRange
from symid.cli.output import Answer, Console
from symid.errors import EstimateError, Notice, UsageError

if TYPE_CHECKING:  # these load numpy
    from symid.arrays import FloatArray
    from symid.codegen.library import Library
    from symid.data.recording import Recording
    from symid.friction.results import FrictionIdentification
    from symid.robot.description import Robot

__all__ = ["answer_friction", "check_friction_options", "friction_options", "split_friction_options"]

P = ParamSpec("P")
R = TypeVar("R")

_NAMES = ("model", "known", "smoothing", "period", "seed")


def friction_options(function: Callable[P, R]) -> Callable[P, R]:
    """Give a verb the options of friction laws."""
    options = (
        click.option(
            "--model",
            metavar="NAME",
            help="Of --rows friction: a law, such as stribeck+offset, or auto, which chooses one by torques "
            "held back.  [default: auto]",
        ),
        click.option(
            "--known",
            type=click.Path(path_type=Path),
            metavar="ESTIMATE",
            help="Of --rows friction: base parameters to subtract, an estimate of other rows; else the rigid "
            "part is fitted along.",
        ),
        click.option(
            "--smoothing",
            type=FiniteRange(min=0.0),
            metavar="V",
            help="Of --rows friction: speed over which dry friction changes its sign.  [default: 0]",
        ),
        click.option(
            "--period",
            type=FiniteRange(min=0.0, min_open=True),
            multiple=True,
            metavar="S",
            help="Of --rows friction and --estimator gls: the motion's period, to average over all of them, "
            "or to tell the noise by what differs; once, or once for each log, in their order.",
        ),
        click.option(
            "--seed", type=click.IntRange(min=0), metavar="N", help="Of a stochastic estimator of friction."
        ),
    )
    for option in reversed(options):
        function = option(function)
    return function


def split_friction_options(options: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the options of `friction_options` among others, and the others."""
    mine = {name: options[name] for name in _NAMES}
    mine["period"] = mine["period"] or None
    return mine, {name: value for name, value in options.items() if name not in mine}


def check_friction_options(
    rows: str, friction: Mapping[str, object], others: Mapping[str, object], estimator: str | None
) -> None:
    """Refuse options of friction laws for other rows, and those of elastic joints for friction.

    Args:
        rows: of the command line.
        friction: the options of `friction_options`, None where not given.
        others: --method and the options of elastic joints, None where not given.
        estimator: as given, None for the default.

    Raises:
        UsageError: options of one kind with rows of the other.
    """
    asked = rows == "friction"
    if not asked and estimator not in {None, *ESTIMATOR_NAMES}:
        text = (
            f"estimator {estimator!r}: there is no such estimator of {rows} rows; allowed are "
            f"{', '.join(ESTIMATOR_NAMES)}; those of friction laws go with --rows friction"
        )
        raise UsageError(Notice(code="usage.unknown-estimator", text=text))
    # Periods serve other rows too; the estimator that reads them is checked with its own options.
    unfit = others if asked else {name: value for name, value in friction.items() if name != "period"}
    names = {"rate": "lambda"}
    given = [
        f"--{names.get(name, name).replace('_', '-')}" for name, value in unfit.items() if value is not None
    ]
    if given:
        what = "--rows friction" if asked else f"--rows {rows}; they belong to --rows friction"
        text = f"{', '.join(given)} cannot be used with {what}; leave {'them' if given[1:] else 'it'} out"
        raise UsageError(Notice(code="usage.mixed-options", text=text))


def answer_friction(
    console: Console,
    robot: "Robot",
    recordings: Sequence["Recording"],
    *,
    estimator: str | None,
    options: Mapping[str, Any],
    output: Path | None,
) -> Answer:
    """Return friction laws and parameters of all joints that the logs move.

    Args:
        console: for progress.
        robot: as read.
        recordings: the logs.
        estimator: its name, None for the default.
        options: of `friction_options`, and "friction", the model of joints asked for; None where not given.
        output: file for the result, None for none.
    """
    from symid.elastic.motor_side import build_motor_recording, build_rigid_variant
    from symid.friction.identify import AUTO, FrictionTask, identify_friction
    from symid.friction.options import FrictionOptions
    from symid.friction.results import write_friction_result
    from symid.identification.validate import find_digest

    described = build_rigid_variant(robot) if any(robot.elastic) else robot
    measured = [build_motor_recording(recording, robot) for recording in recordings]
    library = load_robot_library(described, console)
    model = options["model"] or AUTO
    what = "choosing and fitting a friction law" if model == AUTO else f"fitting the friction law {model}"
    console.progress(f"{what} for {robot.name} from {len(measured)} log{'s'[: len(measured) > 1]}")
    beta = _read_known(options["known"], library)
    task = FrictionTask(
        model=model,
        estimator=estimator or "varpro",
        options=FrictionOptions(seed=options["seed"] or 0),
        beta=beta,
        smoothing=options["smoothing"] or 0.0,
        periods=tuple(options["period"] or ()),
    )
    echo = {
        "log": describe_settings(robot)["log"],
        "log_digests": [find_digest(recording.source) for recording in recordings],
        "known": None if options["known"] is None else str(options["known"]),
        "known_values": None if beta is None else _name_known(beta, library),
        "friction": [joint.friction for joint in library.card.joints],
    }
    found = identify_friction(library, measured, described.processing, task, echo=echo)
    text = _write_text(found, library.card.size)
    if output is not None:
        text.append(f"result: {show_path(write_friction_result(found, output))}")
    result = {**describe_friction(found), "file": output, "backend": library.backend}
    notices = (
        *_warn_of_springs(robot),
        *library.notices,
        *found.notices,
        *_warn_of_unused(found, options, library),
    )
    return Answer(text="\n\n".join(text), result=result, warnings=notices)


def _write_text(found: "FrictionIdentification", size: int) -> list[str]:
    """Return the paragraphs of the answer for a robot of `size` joints."""
    text = [
        f"{found.robot}: friction of {len(found.joints)} of {size} joint{'s'[: size > 1]}",
        *(show_joint(entry) for entry in found.joints),
    ]
    if found.refused:
        text.append(
            "\n".join(textwrap.fill(f"{name}: {reason}", width=WIDTH) for name, reason in found.refused)
        )
    return text


def _read_known(path: Path | None, library: "Library") -> "FloatArray | None":
    if path is None:
        return None
    from symid.friction.results import is_friction_result
    from symid.identification.storage import read_estimate

    if is_friction_result(path):
        text = (
            "this is friction found with --rows friction; --known takes the base parameters that "
            "`symid identify ROBOT LOG... -o FILE` finds without --rows friction"
        )
        raise EstimateError(Notice(code="estimate.friction", text=text, file=str(path)))
    estimate = read_estimate(path, library.card)
    return estimate.assemble(tuple(entry.name for entry in library.card.beta))


def _name_known(beta: "FloatArray", library: "Library") -> dict[str, float]:
    return {entry.name: float(value) for entry, value in zip(library.card.beta, beta, strict=True)}


def _warn_of_unused(
    found: "FrictionIdentification", options: Mapping[str, Any], library: "Library"
) -> tuple[Notice, ...]:
    """Return a notice for every option that had no part in the result."""
    from symid.friction.estimators import STOCHASTIC

    texts = []
    if options["seed"] is not None and found.estimator not in STOCHASTIC:
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
    if options.get("friction") and not others & beside:
        texts.append(
            "--friction has no part in this result: no joint's friction acts on another here; the law of a "
            "joint's own friction is that of --model"
        )
    return tuple(Notice(code="friction.unused-option", text=text) for text in texts)


def _warn_of_springs(robot: "Robot") -> tuple[Notice, ...]:
    if not any(robot.elastic):
        return ()
    text = (
        f"robot {robot.name!r} gives between motor and link: friction was fitted to the motor side with a "
        "rigid model; what springs lose is counted as friction"
    )
    return (Notice(code="friction.elastic", text=text),)
