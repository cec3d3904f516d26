"""`symid identify ROBOT LOG...`: parameters with their uncertainty, from logs."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from symid.cli.elastic_settings import check_settings, cut_logs, find_asked_cutoff, list_unused_settings
from symid.cli.estimator_options import (
    ESTIMATOR_OPTIONS,
    SIMULATING,
    check_estimator_options,
    estimator_options,
    split_estimator_options,
)
from symid.cli.identify_elastic import (
    Route,
    answer_elastic,
    answer_stiffness,
    choose_route,
    elastic_options,
)
from symid.cli.identify_friction import (
    answer_friction,
    check_friction_options,
    friction_options,
    split_friction_options,
)
from symid.cli.identify_rigid import check_simulated, fit_rigid, show_tracking
from symid.cli.inputs import (
    check_output,
    load_robot,
    load_robot_library,
    read_fit_logs,
    show_path,
)
from symid.cli.options import (
    force_option,
    friction_option,
    output_option,
    processing_options,
    rows_options,
    set_option,
    split_settings,
    verb,
)
from symid.cli.output import Answer, Console
from symid.cli.tables import describe_estimate, show_parameters, show_residual
from symid.errors import Notice

if TYPE_CHECKING:  # these load numpy
    from symid.data.recording import Recording
    from symid.estimators.estimate import Estimate
    from symid.robot.description import Robot

__all__ = ["command"]


@click.command("identify")
@click.argument("robot")
@click.argument("logs", nargs=-1, required=True, metavar="LOG...", type=click.Path(path_type=Path))
@rows_options
@estimator_options
@friction_options
@elastic_options
@friction_option
@processing_options
@set_option
@output_option("Write the result as JSON, for `validate`, `report` and `export`.")
@force_option
@verb
def command(
    console: Console,
    *,
    robot: str,
    logs: tuple[Path, ...],
    rows: str,
    estimator: str | None,
    method: str | None,
    friction: str | None,
    cutoff: float | None,
    decimate: int | None,
    drop_first: int | None,
    drop_last: int | None,
    settings: tuple[str, ...],
    output: Path | None,
    force: bool,
    **further: float | None,
) -> Answer:
    """Identify a robot's base parameters and friction from one log or several.

    Columns, units, filter and decimation are those of the robot file; options override them.
    Parameters that the logs cannot tell are refused by name, with the reason. With --rows friction a
    law of friction is found for every joint that moves: which one, and its parameters.
    """
    of_rows, of_law, elastic = _split_options(further)
    check_friction_options(rows, of_law, {"method": method, **elastic, **of_rows}, estimator)
    pairs = split_settings(
        settings,
        filter_cutoff=cutoff,
        decimation__factor=decimate,
        drop_first=drop_first,
        drop_last=drop_last,
    )
    described = load_robot(robot, pairs, friction)
    check_output(output, force=force, inputs=(described.path, *logs))
    recordings = read_fit_logs(logs, described)
    _refuse_loads(recordings, described, rows, estimator)
    if rows == "friction":
        of_law["friction"] = friction
        answer = answer_friction(
            console, described, recordings, estimator=estimator, options=of_law, output=output
        )
        return replace(answer, warnings=(*_list_warnings(described, recordings), *answer.warnings))
    route = choose_route(described, recordings, method=method, elastic=elastic, rigid=_list_given())
    if route.kind in {"stiffness", "elastic"}:
        return _answer_springs(
            console, described, recordings, route, pairs=pairs, elastic=elastic, output=output
        )
    return _answer_rigid(
        console,
        described,
        recordings,
        rows=rows,
        estimator=estimator or "ols",
        options=of_rows | {"period": of_law["period"], "window": elastic["window"]},
        output=output,
        motor_side=route.kind == "motor-side",
        warnings=_list_warnings(described, recordings),
    )


def _refuse_loads(
    recordings: Sequence["Recording"], robot: "Robot", rows: str, estimator: str | None
) -> None:
    """Refuse known payloads for what has no rows of a rigid robot with base parameters."""
    from symid.data.runs import refuse_loads

    if rows == "friction":
        refuse_loads(recordings, "--rows friction")
    elif any(robot.elastic):
        refuse_loads(recordings, "a robot with elastic joints")
    elif estimator in SIMULATING:
        refuse_loads(recordings, f"--estimator {estimator}")


def _answer_springs(
    console: Console,
    described: "Robot",
    recordings: Sequence["Recording"],
    route: Route,
    *,
    pairs: Sequence[tuple[str, str]],
    elastic: Mapping[str, object],
    output: Path | None,
) -> Answer:
    """Return what the logs say of springs: stiffness alone, or all of an elastic robot."""
    check_settings(pairs, route.kind)
    recordings = cut_logs(recordings, described.processing)
    warnings = _list_warnings(described, recordings)
    if route.kind == "stiffness":
        answer = answer_stiffness(console, described, recordings, output)
    else:
        given = {**elastic, "cutoff": find_asked_cutoff(described, pairs)}
        answer = answer_elastic(
            console, described, recordings, method=route.method, options=given, output=output
        )
    told = list_unused_settings(described, route.kind)
    return replace(answer, warnings=(*told, *warnings, *answer.warnings))


def _list_given() -> tuple[str, ...]:
    """Return the options of rigid robots that the command line gives, whatever their values."""
    context = click.get_current_context()
    default = click.core.ParameterSource.DEFAULT
    return tuple(
        f"--{name.replace('_', '-')}"
        for name in ("rows", "estimator", "period", *ESTIMATOR_OPTIONS)
        if context.get_parameter_source(name) is not default
    )


def _find_notes(recordings: Sequence["Recording"], code: str) -> tuple[Notice, ...]:
    return tuple(note for entry in recordings for note in entry.notices if note.code == code)


def _split_options(further: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
    """Return options of rows and estimators, of friction laws, and of elastic joints."""
    of_rows, others = split_estimator_options(further)
    return of_rows, *split_friction_options(others)


def _list_warnings(robot: "Robot", recordings: Sequence["Recording"]) -> tuple[Notice, ...]:
    from symid.data.checks import check_recording

    found: tuple[Notice, ...] = robot.notices
    for recording in recordings:
        found += (*recording.notices, *check_recording(recording, robot))
    return found


def _answer_rigid(
    console: Console,
    described: "Robot",
    recordings: Sequence["Recording"],
    *,
    rows: str,
    estimator: str,
    options: Mapping[str, Any],
    output: Path | None,
    motor_side: bool,
    warnings: tuple[Notice, ...],
) -> Answer:
    from symid.data.checks import find_second_encoder
    from symid.elastic.motor_side import (
        build_motor_recording,
        build_rigid_variant,
        has_both_encoders,
        refuse_elasticity,
    )

    check_estimator_options(rows, estimator, options)
    both = has_both_encoders(recordings)
    recordings = [build_motor_recording(recording, described) for recording in recordings]
    rigid = build_rigid_variant(described) if motor_side else described
    check_simulated(described, recordings, estimator)
    library = load_robot_library(rigid, console)
    console.progress(f"identifying {described.name} from {len(recordings)} log{'s'[: len(recordings) > 1]}")
    from symid.identification.storage import write_estimate

    estimate = fit_rigid(rigid, library, recordings, console, rows=rows, estimator=estimator, options=options)
    if not motor_side and any(find_second_encoder(recording) for recording in recordings):
        unused = (
            "the log has a second encoder, which a rigid model has no use for: its position is that of "
            "[log.position]; --method stiffness looks at both"
        )
        warnings += (Notice(code="identify.second-encoder", text=unused),)
    if motor_side:
        estimate = refuse_elasticity(estimate, described, both=both)
        warnings += _find_notes(recordings, "log.motor-position")
    text = _write_summary(estimate)
    if output is not None:
        text.append(f"estimate: {show_path(write_estimate(estimate, output))}")
    result = {**describe_estimate(estimate), "file": output, "backend": library.backend}
    told = (*warnings, *library.notices, *estimate.notices)
    return Answer(text="\n\n".join(text), result=result, warnings=told)


def _write_summary(estimate: "Estimate") -> list[str]:
    """Return the parts of the answer: a headline, the tables, what was refused."""
    headline = (
        f"{estimate.robot}: {estimate.rows} rows, {estimate.estimator}, {estimate.samples} equations, "
        f"condition {estimate.condition:.3g}: {estimate.outcome.value}"
    )
    text = [headline, show_parameters(estimate), show_residual(estimate.residual), *show_tracking(estimate)]
    if estimate.refused:
        text.append("\n".join(f"refused: {name}: {reason}" for name, reason in estimate.refused))
    return text
