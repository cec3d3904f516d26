"""`symid identify ROBOT LOG...`: parameters with their uncertainty, from logs."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from symid.cli.identify_options import (
    ELASTIC,
    FRICTION,
    RIGID,
    elastic_options,
    friction_law_options,
    rigid_options,
    rows_options,
)
from symid.cli.inputs import NamedRobot, check_output, show_path, split_settings
from symid.cli.options import (
    Verb,
    force_option,
    friction_option,
    output_option,
    processing_options,
    robot_argument,
    set_option,
    verb,
)
from symid.cli.output import Answer, Console, make_answer
from symid.errors import Notice, UsageError

if TYPE_CHECKING:
    from symid import RobotModel

__all__ = ["command"]

_STIFFNESS = "stiffness"
_LAWS = "friction"


@click.command("identify", cls=Verb)
@robot_argument(computes=True)
@click.argument("logs", nargs=-1, required=True, metavar="LOG...", type=click.Path(path_type=Path))
@processing_options
@set_option
@friction_option
@rows_options
@rigid_options
@elastic_options
@friction_law_options
@output_option("Write the result as JSON, for `validate`, `report` and `export`.")
@force_option
@verb
def command(
    console: Console,
    *,
    robot: NamedRobot,
    logs: tuple[Path, ...],
    rows: str | None,
    estimator: str | None,
    method: str | None,
    period: tuple[float, ...],
    settings: tuple[str, ...],
    output: Path | None,
    force: bool,
    **further: Any,  # noqa: ANN401  as the options say
) -> Answer:
    """Identify a robot's base parameters and friction from one log or several.

    Columns, units, filter and decimation are those of the robot file; options override them.
    Parameters that the logs cannot identify are refused by name, with the reason. With --rows friction a
    law of friction is found for every joint that moves: which one, and its parameters.
    """
    rigid, elastic, law = (_pick(further, names) for names in (RIGID, ELASTIC, FRICTION))
    _check_mixed(rows, {"method": method, **elastic, **rigid}, law)
    shared = {key: value for key, value in further.items() if key not in (*RIGID, *ELASTIC, *FRICTION)}
    shared["settings"] = split_settings(settings)
    # A setting that cannot be made is refused before anything else.
    model = robot.load(console, settings=shared["settings"], friction=shared["friction"])
    check_output(output, force=force, inputs=(model.path, *logs))
    if rows == _LAWS:
        laws = model.identify_friction(logs, estimator=estimator, period=period, **law, **shared)
        return _answer(laws, output, "result")
    if method == _STIFFNESS:
        return _answer_stiffness(
            model, logs, _list_given(rows, estimator, period, rigid, elastic), shared, output
        )
    fit = model.identify(
        logs, rows=rows, estimator=estimator, method=method, period=period, **rigid, **elastic, **shared
    )
    return _answer(fit, output, "estimate")


def _answer(fit: Any, output: Path | None, what: str) -> Answer:  # noqa: ANN401  fits and stiffness alike
    lines = [] if output is None else [f"{what}: {show_path(fit.save(output))}"]
    return make_answer(fit, *lines, file=output)


def _answer_stiffness(
    model: "RobotModel",
    logs: tuple[Path, ...],
    given: tuple[str, ...],
    shared: Mapping[str, Any],
    output: Path | None,
) -> Answer:
    """Return the stiffness of all joints, for which options of rows and estimators have no meaning."""
    if given:
        them = "them" if given[1:] else "it"
        text = f"{', '.join(given)} cannot be used with --method stiffness; leave {them} out"
        raise UsageError(Notice(code="usage.mixed-options", text=text))
    settings = dict(shared["settings"])
    for key, name in (("cutoff", "filter_cutoff"), ("decimate", "decimation.factor")):
        if shared[key] is not None:
            settings[f"processing.{name}"] = shared[key]
    found = model.identify_stiffness(
        logs,
        friction=shared["friction"],
        settings=settings,
        drop_first=shared["drop_first"],
        drop_last=shared["drop_last"],
    )
    return _answer(found, output, "result")


def _pick(options: Mapping[str, Any], names: tuple[str, ...]) -> dict[str, Any]:
    return {name: options[name] for name in names}


def _list_given(
    rows: str | None,
    estimator: str | None,
    period: tuple[float, ...],
    rigid: Mapping[str, Any],
    elastic: Mapping[str, Any],
) -> tuple[str, ...]:
    """Return the options of rows, estimators and methods that were given."""
    entries = {"rows": rows, "estimator": estimator, "period": period, **rigid, **elastic}
    return tuple(_write_option(name) for name, value in entries.items() if value not in (None, (), False))


def _write_option(name: str) -> str:
    return f"--{'lambda' if name == 'rate' else name.replace('_', '-')}"


def _check_mixed(rows: str | None, others: Mapping[str, object], law: Mapping[str, object]) -> None:
    """Refuse options of friction laws for other rows, and those of rows and methods for friction.

    Raises:
        UsageError: options of one kind with rows of the other.
    """
    asked = rows == _LAWS
    given = [
        _write_option(name)
        for name, value in (others if asked else law).items()
        if value not in (None, (), False)
    ]
    if given:
        kind = rows or "torque"
        what = "--rows friction" if asked else f"--rows {kind}; they belong to --rows friction"
        text = f"{', '.join(given)} cannot be used with {what}; leave {'them' if given[1:] else 'it'} out"
        raise UsageError(Notice(code="usage.mixed-options", text=text))
