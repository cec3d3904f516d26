"""`symid payload ROBOT LOADED... --empty EMPTY`: what the robot carries, from logs or estimates of both."""

import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from symid.cli.identified import find_identified
from symid.cli.inputs import (
    check_distinct,
    check_output,
    describe_settings,
    load_robot,
    load_robot_library,
    read_logs,
    show_path,
)
from symid.cli.options import FiniteRange, force_option, output_option, verb
from symid.cli.output import Answer, Console, format_table, write_json
from symid.errors import EstimateError, Notice, UsageError

if TYPE_CHECKING:  # these load numpy and sympy
    from symid.estimators.estimate import ParameterEstimate
    from symid.parameters.base import BaseParameters
    from symid.parameters.payload import Payload
    from symid.parameters.payload_changes import Change
    from symid.parameters.payload_equations import BaseValues
    from symid.robot.description import Robot

__all__ = ["command"]

_Side = tuple["Robot", "BaseParameters", "BaseValues", tuple[Notice, ...]]
_FAR = 3.0


@click.command("payload")
@click.argument("robot")
@click.argument("loaded", nargs=-1, required=True, metavar="LOADED...", type=click.Path(path_type=Path))
@click.option(
    "--empty",
    multiple=True,
    required=True,
    metavar="EMPTY",
    type=click.Path(path_type=Path),
    help="Estimate or log without the payload; logs may be several.",
)
@click.option("--joint", metavar="NAME", help="Whose link carries it.  [default: the last joint]")
@click.option(
    "--mass",
    type=FiniteRange(min=0.0, min_open=True),
    metavar="KG",
    help="The mass, where a balance told it: the rest then comes out surer.",
)
@click.option(
    "--rows",
    type=click.Choice(("torque", "momentum")),
    default="torque",
    show_default=True,
    help="Of logs: how measurements become equations.",
)
@click.option(
    "--estimator",
    type=click.Choice(("ols", "wls")),
    default="wls",
    show_default=True,
    help="Of logs: how equations become parameters.",
)
@output_option("Write the result as JSON.")
@force_option
@verb
def command(
    console: Console,
    *,
    robot: str,
    loaded: tuple[Path, ...],
    empty: tuple[Path, ...],
    joint: str | None,
    mass: float | None,
    rows: str,
    estimator: str,
    output: Path | None,
    force: bool,
) -> Answer:
    """Find mass, centre of mass and inertia of what ROBOT carries in LOADED and not in EMPTY.

    LOADED and EMPTY are an estimate each, as `identify` writes them, or logs. The inertia is that of a
    body that can exist. What the robot cannot show, or noise hides, is refused by name.
    """
    check_output(output, force=force, inputs=(*loaded, *empty))
    check_distinct((*loaded, *empty))
    options = {"rows": rows, "estimator": estimator}
    first = _name_side("with the payload", _read_side(console, robot, loaded, **options))
    second = _name_side("without it", _read_side(console, robot, empty, **options))
    described, base = first[0], first[1]
    if first[0].elastic != second[0].elastic:
        differ = (
            "one side takes the joints as elastic and the other as rigid, so that their parameters are not "
            "the same; identify both by the same method"
        )
        raise EstimateError(Notice(code="payload.other-model", text=differ))
    check_output(output, force=force, inputs=(described.path,))
    from symid.parameters.payload import find_payload

    found = find_payload(described, base, first[2], second[2], joint=joint, mass=mass)
    result = _describe(described, found)
    text = [_show(described, found)]
    if output is not None:
        from symid.identification.storage import write_file

        write_file(output, write_json(result) + "\n")
        text.append(f"payload: {show_path(output)}")
    warnings = tuple(dict.fromkeys((*first[3], *second[3], *_warn(found))))
    return Answer(text="\n\n".join(text), result={**result, "file": output}, warnings=warnings)


def _read_side(console: Console, name: str, paths: Sequence[Path], *, rows: str, estimator: str) -> _Side:
    """Return the robot and the base values of an estimate, or of logs.

    Raises:
        UsageError: there are estimates among logs, or several.
        EstimateError: an estimate is of another model.
        LogError: a log cannot be used.
        IdentifiabilityError: nothing can be learnt from the logs.
    """
    estimates = [path for path in paths if _is_estimate(path)]
    if not estimates:
        return _identify(console, name, paths, rows=rows, estimator=estimator)
    if len(paths) > 1:
        text = (
            f"{estimates[0]} is an estimate: give one alone, or logs alone; several logs become one estimate "
            "by `symid identify`"
        )
        raise UsageError(Notice(code="usage.payload-inputs", text=text))
    found = find_identified(name, estimates[0])
    values = _build_values(found.values, found.covariance)
    return found.robot, found.base, values, (*found.robot.notices, *found.notices)


def _name_side(side: str, found: _Side) -> _Side:
    """Return a side whose notices of the identification say which it is."""
    robot, base, values, notices = found
    named = (
        replace(note, text=f"{side}: {note.text}") if note.code.startswith("identify") else note
        for note in notices
    )
    return robot, base, values, tuple(named)


def _is_estimate(path: Path) -> bool:
    """Return whether a file is one of the results that symid writes, right or wrong."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(data, dict) and str(data.get("format", "")).startswith("symid")


def _build_values(
    entries: Sequence["ParameterEstimate"], covariance: Sequence[Sequence[float]]
) -> "BaseValues":
    from symid.parameters.payload_equations import build_base_values

    return build_base_values(
        [entry.name for entry in entries],
        [entry.value for entry in entries],
        [entry.std for entry in entries],
        covariance,
    )


def _identify(console: Console, name: str, paths: Sequence[Path], *, rows: str, estimator: str) -> _Side:
    """Return the base values that logs say."""
    robot = load_robot(name)
    if any(robot.elastic):
        text = (
            "the joints of this robot are elastic: identify both sets of logs by `symid identify`, and give "
            "the estimates"
        )
        raise UsageError(Notice(code="usage.payload-elastic", text=text, file=robot.path))
    recordings = read_logs(paths, robot)
    library = load_robot_library(robot, console)
    console.progress(f"identifying {robot.name} from {', '.join(path.name for path in paths)}")
    from symid.identification.identify import identify_parameters
    from symid.parameters.base import find_base_parameters

    estimate = identify_parameters(
        library,
        recordings,
        robot.processing,
        rows=rows,
        estimator=estimator,
        echo={"log": describe_settings(robot)["log"]},
    )
    values = _build_values(estimate.parameters, estimate.covariance)
    said = (note for recording in recordings for note in recording.notices)
    return robot, find_base_parameters(robot), values, (*robot.notices, *said, *estimate.notices)


def _describe(robot: "Robot", found: "Payload") -> dict[str, object]:
    from symid.notation import INERTIAL

    by_name = {entry.name: entry for entry in found.quantities}
    return {
        "robot": robot.name,
        "joint": found.joint,
        "mass": by_name["mass"].value,
        "com": [by_name[name].value for name in ("cx", "cy", "cz")],
        "inertia": {name[1:]: entry.value for name, entry in by_name.items() if name.startswith("J")},
        "quantities": [asdict(entry) for entry in found.quantities],
        "standard": dict(zip(INERTIAL, found.standard.tolist(), strict=True)),
        "chi2": found.chi2,
        "freedom": found.freedom,
        "scale": found.scale,
        "moved": found.moved,
        "unexplained": [asdict(entry) for entry in found.unexplained],
        "friction": [asdict(entry) for entry in found.friction],
    }


def _show(robot: "Robot", found: "Payload") -> str:
    told = [entry for entry in found.quantities if entry.value is not None]
    table = format_table(
        ("quantity", "value", "std", "unit"),
        [[entry.name, entry.value, entry.std, entry.unit] for entry in told],
        left=(0, 3),
    )
    lines = [
        f"{robot.name}: what the link of joint {found.joint!r} carries",
        "in the frame that the robot file gives to the link; inertia about the centre of mass",
        "",
        table,
    ]
    refused = [entry for entry in found.quantities if entry.value is None]
    if refused:
        lines += ["", *(f"refused: {entry.name}: {entry.reason}" for entry in refused)]
    if found.scale > 1.0:
        lines += ["", f"deviations are {found.scale:.3g} times those of the estimates: chi^2 is too large"]
    return "\n".join(lines)


def _list(changes: Sequence["Change"]) -> str:
    return ", ".join(
        f"{entry.name} from {entry.before:.4g} to {entry.after:.4g} ({entry.deviations:+.2g} std)"
        for entry in changes
    )


def _warn(found: "Payload") -> tuple[Notice, ...]:
    """Return what speaks against the result."""
    notices = []
    refused = [entry.name for entry in found.quantities if entry.value is None]
    if refused:
        text = f"not told: {', '.join(refused)}; do not take what a controller asks for from a guess"
        notices.append(Notice(code="payload.refused", text=text))
    if found.unexplained and found.doubtful:
        text = (
            f"base parameters changed as no payload changes them: {_list(found.unexplained)}; something "
            "else changed between the logs, or friction and filters bias one of them: use the same motions"
        )
        notices.append(Notice(code="payload.unexplained", text=text))
    if found.friction:
        text = f"friction changed: {_list(found.friction)}; gears brake more under load and less when warm"
        notices.append(Notice(code="payload.friction-changed", text=text))
    if found.moved > _FAR:
        text = (
            f"the nearest body that can exist is {found.moved:.2g} standard deviations away from the change "
            "of the base parameters: something else changed between the logs"
        )
        notices.append(Notice(code="payload.inconsistent", text=text))
    return tuple(notices)
