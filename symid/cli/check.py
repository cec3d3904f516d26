"""`symid check ROBOT [LOG...]`: is the robot file right, and which parameters the logs identify."""

from pathlib import Path

import click

from symid.cli.inputs import NamedRobot, check_output, split_settings
from symid.cli.options import (
    OUTPUT,
    Verb,
    force_option,
    friction_option,
    option,
    robot_argument,
    set_option,
    verb,
)
from symid.cli.output import Answer, Console, make_answer
from symid.errors import Notice, UsageError

__all__ = ["command"]

_POOR = 4


@click.command("check", cls=Verb)
@robot_argument(computes=True)
@click.argument("logs", nargs=-1, metavar="[LOG]...", type=click.Path(path_type=Path))
@friction_option
@set_option
@option(
    "--resample",
    type=click.Path(path_type=Path),
    metavar="FILE",
    group=OUTPUT,
    help="Write an evenly sampled copy of the log (.npz or .csv), with its columns, and say what was done.",
)
@force_option
@verb
def command(
    console: Console,
    *,
    robot: NamedRobot,
    logs: tuple[Path, ...],
    friction: str | None,
    settings: tuple[str, ...],
    resample: Path | None,
    force: bool,
) -> Answer:
    """Check a robot file, and which parameters logs identify.

    All that is wrong is said at once, each with its file, line and column: exit code 3. What is odd in a
    log is a warning that says what to do: time stamps, units, signs, exchanged joints, delays, motion that
    excites too little. Exit code 4 where the logs tell less than three quarters of the parameters.
    """
    if resample is not None and len(logs) != 1:
        text = f"--resample {resample}: takes one log at a time, got {len(logs)}"
        raise UsageError(Notice(code="usage.one-log", text=text))
    model = robot.load(console, settings=split_settings(settings), friction=friction)
    check_output(resample, force=force, inputs=(model.path, *logs))
    return make_answer(model.check(*logs, resample=resample), exit_code=_POOR)
