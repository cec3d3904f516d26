"""The verbs on experiments: `symid excite`, `symid simulate`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from symid.cli.call import Answer, Console, make_answer
from symid.cli.options import (
    COUNT,
    INPUT,
    METHOD,
    MODEL,
    OUTPUT,
    POSITIVE,
    FiniteRange,
    NamedRobot,
    Verb,
    add_options,
    check_output,
    friction_option,
    option,
    output_option,
    robot_argument,
    seed_option,
    verb,
)
from symid.environment import check_suffix, show_path
from symid.errors import Notice, UsageError

_UNSTATED = "where the robot file states none"

excite_options = add_options(
    option("--harmonics", METHOD, "Number of harmonics of each joint.", type=COUNT, default=5, metavar="N"),
    option("--period", METHOD, "Length of the trajectory, s.", type=POSITIVE, default=10.0, metavar="S"),
    option(
        "--criterion",
        METHOD,
        "Minimise the condition number of the column-scaled regressor, or maximise the information.",
        type=click.Choice(("condition", "d-optimal")),
        default="condition",
    ),
    option(
        "--weight",
        METHOD,
        "Weight of the information; the condition number alone favours tiny motions.",
        type=FiniteRange(min=0.0),
        default=0.1,
    ),
    option("--moving", METHOD, "Let it start and end in motion instead of at rest.", is_flag=True),
    option("--start", METHOD, "Pose at the start and at the end, rad or m.", metavar="Q1,Q2,..."),
    option(
        "--share",
        MODEL,
        "Part of every limit that may be used.",
        type=FiniteRange(min=0.0, max=1.0, min_open=True),
        default=0.95,
    ),
    option(
        "--sweep",
        MODEL,
        f"Position limit on either side of zero {_UNSTATED}, rad or m.",
        type=POSITIVE,
        default=1.0,
    ),
    option("--velocity", MODEL, f"Velocity limit {_UNSTATED}, rad/s or m/s.", type=POSITIVE, default=2.0),
    option(
        "--acceleration",
        MODEL,
        f"Acceleration limit {_UNSTATED}, rad/s^2 or m/s^2.",
        type=POSITIVE,
        default=10.0,
    ),
    option("--jerk", MODEL, f"Jerk limit {_UNSTATED}, rad/s^3 or m/s^3.  [default: none]", type=POSITIVE),
    option(
        "--workspace",
        INPUT,
        "File (.toml) of spheres and planes that bound the links.",
        type=click.Path(path_type=Path, exists=True, dir_okay=False),
        metavar="FILE",
    ),
    option("--torsion", MODEL, "Largest torsion of elastic joints, rad or m.", type=POSITIVE, metavar="RAD"),
    option(
        "--stiffness",
        MODEL,
        "Stiffness of all joints for --torsion; replaces that of the robot file, N m/rad or N/m.",
        metavar="K1,K2,...",
    ),
    option(
        "--deviations",
        METHOD,
        "Standard deviations of the torque noise, one a joint, N m or N.  [default: all equal]",
        metavar="S1,S2,...",
    ),
    option(
        "--candidates",
        METHOD,
        "Number of random feasible trajectories to start from and to compare with.",
        type=COUNT,
        default=1000,
        metavar="N",
    ),
    option(
        "--starts", METHOD, "Number of candidates that are optimised.", type=COUNT, default=10, metavar="N"
    ),
    option("--rate", OUTPUT, "Sample rate of the file.", type=POSITIVE, default=1000.0, metavar="HZ"),
    option("--periods", OUTPUT, "Number of periods in the file.", type=COUNT, default=1, metavar="N"),
)


_LISTS = ("start", "stiffness", "deviations")


@click.command("excite", cls=Verb)
@robot_argument()
@excite_options
@friction_option
@seed_option
@output_option("Trajectory to write, .csv.")
@verb
def excite_command(
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
    """Compute an optimal trajectory for identification.

    It is a finite Fourier series for every joint, within all limits of the robot file at all times;
    `symid simulate --trajectory FILE` follows it.
    """
    model = robot.load(console, friction=friction)
    if output is not None:
        check_suffix(output, "a trajectory", (".csv",))
    check_output(output, force=force, inputs=(model.path, *([workspace] if workspace else [])))
    search |= {name: _split_numbers(name, search[name], len(model.joints)) for name in _LISTS}
    found = model.excite(workspace=workspace, **search)
    if output is None:
        return make_answer(found, file=None, samples=0, rate=rate)
    found.save(output, rate=rate, periods=periods)
    samples = found.count_samples(rate=rate, periods=periods)
    line = f"{show_path(output)}: {samples} samples of t, q, dq, ddq"
    return make_answer(found, line, file=output, samples=samples, rate=rate)


def _split_numbers(name: str, text: str | None, joints: int) -> Sequence[float] | None:
    """Return the numbers of a list such as 1,2,3; refuse any but one for each joint."""
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


@click.command("simulate", cls=Verb)
@robot_argument(computes=True)
@option(
    "--trajectory",
    METHOD,
    "fourier (a random Fourier series), ta or tb (published), tc (for validation), or a file (.csv) "
    "of symid excite.",
    metavar="NAME|FILE",
    default="fourier",
)
@option(
    "--scale", METHOD, "Factor on the trajectory's amplitudes.", type=POSITIVE, default=1.0, metavar="FACTOR"
)
@option("--joint", METHOD, "Number of the joint that tb moves, without mimic joints.", type=COUNT, default=1)
@option(
    "--duration",
    METHOD,
    "Length of the experiment, s.  [default: that of the trajectory]",
    type=POSITIVE,
    metavar="S",
)
@option(
    "--noise",
    MODEL,
    "Standard deviation of the torque sensors, N m or N.  [default: 0.05; of an elastic robot 2 % "
    "of each joint's RMS torque]",
    type=FiniteRange(min=0.0),
    metavar="N",
)
@option("--clean", MODEL, "Simulate perfect sensors: no noise, no encoder steps.", is_flag=True)
@option(
    "--delay",
    MODEL,
    "Elastic robots only: delay of the link encoders relative to the motor encoders, s.",
    type=FiniteRange(),
    default=0.0,
    metavar="S",
    show_default=False,
)
@option(
    "--offset",
    MODEL,
    "Elastic robots only: reading of the link encoders at zero, rad or m.",
    type=FiniteRange(),
    default=0.0,
    metavar="RAD",
    show_default=False,
)
@friction_option
@seed_option
@output_option("Log to write, .npz or .csv.", required=True)
@verb
def simulate_command(
    console: Console,
    *,
    robot: NamedRobot,
    trajectory: str,
    friction: str | None,
    output: Path,
    force: bool,
    **settings: Any,  # noqa: ANN401  the options of the experiment, typed in `RobotModel.simulate`
) -> Answer:
    """Simulate the robot under PD control along a trajectory and write the measured log.

    The robot file must state masses and friction. The log of an elastic robot holds link positions q,
    motor positions theta and motor torques tau.
    """
    model = robot.load(console, friction=friction)
    check_suffix(output, "a log", (".npz", ".csv"))
    check_output(output, force=force, inputs=(model.path, Path(trajectory)))
    run = model.simulate(trajectory, **settings)
    written = run.save(output)
    return Answer(
        text=f"{show_path(written)}: {run.summarise()}",
        result={"robot": model.name, "file": written, **run.to_dict()},
        warnings=run.notices,
    )
