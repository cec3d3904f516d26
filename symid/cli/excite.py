"""`symid excite ROBOT -o FILE`: a trajectory on which all parameters can be identified."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from symid.cli.excite_options import excite_options
from symid.cli.inputs import NamedRobot, check_output, check_suffix, show_path
from symid.cli.options import (
    Verb,
    force_option,
    friction_option,
    output_option,
    robot_argument,
    seed_option,
    verb,
)
from symid.cli.output import Answer, Console, make_answer
from symid.errors import Notice, UsageError

__all__ = ["command"]

_LISTS = ("start", "stiffness", "deviations")


@click.command("excite", cls=Verb)
@robot_argument()
@excite_options
@friction_option
@seed_option
@output_option("Trajectory to write, .csv.")
@force_option
@verb
def command(
    console: Console,
    *,
    robot: NamedRobot,
    friction: str | None,
    output: Path | None,
    force: bool,
    rate: float,
    periods: int,
    workspace: Path | None,
    **search: Any,  # noqa: ANN401  the options of the search, typed in `RobotModel.excite`
) -> Answer:
    """Find the trajectory on which the parameters of a robot can be identified best.

    A finite Fourier series of every joint, within all limits of the robot file at all times. The file is one
    that `symid simulate --trajectory FILE` follows.
    """
    model = robot.load(console, friction=friction)
    if output is not None:
        check_suffix(output, "a trajectory", (".csv",))
    check_output(output, force=force, inputs=(model.path, *([workspace] if workspace else [])))
    search |= {name: _split(name, search[name], len(model.joints)) for name in _LISTS}
    found = model.excite(workspace=workspace, **search)
    if output is None:
        return make_answer(found, file=None, samples=0, rate=rate)
    found.save(output, rate=rate, periods=periods)
    samples = found.count_samples(rate=rate, periods=periods)
    line = f"{show_path(output)}: {samples} samples of t, q, dq, ddq"
    return make_answer(found, line, file=output, samples=samples, rate=rate)


def _split(name: str, text: str | None, joints: int) -> Sequence[float] | None:
    """Return the numbers of a list such as 1,2,3.

    Raises:
        UsageError: it is no list of one number a joint.
    """
    if text is None:
        return None
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError as error:
        message = f"--{name} {text}: expected {joints} numbers with commas between them"
        raise UsageError(Notice(code="usage.excitation", text=message)) from error
    if len(numbers) != joints:
        message = f"--{name}: {len(numbers)} numbers for {joints} joints; give one for each"
        raise UsageError(Notice(code="usage.excitation", text=message))
    return numbers
