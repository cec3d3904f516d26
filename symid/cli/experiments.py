"""The verbs on experiments: `symid excite`, `symid simulate`.

excite ROBOT -o FILE: a trajectory on which all parameters can be identified.
simulate ROBOT -o LOG: an experiment on the computer, logged like a real one.
"""

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
    force_option,
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
        "Weight of the information beside the condition number, which alone favours tiny motions.",
        type=FiniteRange(min=0.0),
        default=0.1,
    ),
    option("--moving", METHOD, "Let it start and end in motion instead of at rest.", is_flag=True),
    option("--start", METHOD, "Pose in which it starts and ends, rad or m.", metavar="Q1,Q2,..."),
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
        f"Position limit either side of zero {_UNSTATED}, rad or m.",
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
        "File of spheres and planes that links keep to, .toml.",
        type=click.Path(path_type=Path, exists=True, dir_okay=False),
        metavar="FILE",
    ),
    option("--torsion", MODEL, "Largest torsion of elastic joints, rad or m.", type=POSITIVE, metavar="RAD"),
    option(
        "--stiffness",
        MODEL,
        "Stiffness of all joints for --torsion, in place of the robot file's, N m/rad or N/m.",
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
        "Number of random feasible trajectories to start from, and to beat.",
        type=COUNT,
        default=1000,
        metavar="N",
    ),
    option(
        "--starts", METHOD, "Number of candidates that are optimised.", type=COUNT, default=10, metavar="N"
    ),
    option("--rate", OUTPUT, "Sample rate of the file.", type=POSITIVE, default=1000.0, metavar="HZ"),
    option(
        "--periods",
        OUTPUT,
        "How often the file runs through the trajectory.",
        type=COUNT,
        default=1,
        metavar="N",
    ),
)


_LISTS = ("start", "stiffness", "deviations")


@click.command("excite", cls=Verb)
@robot_argument()
@excite_options
@friction_option
@seed_option
@output_option("Trajectory to write, .csv.")
@force_option
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
    """Find the trajectory on which the parameters of a robot can be identified best.

    A finite Fourier series of every joint, within all limits of the robot file at all times. The file is one
    that `symid simulate --trajectory FILE` follows.
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


@click.command("simulate", cls=Verb)
@robot_argument(computes=True)
@option(
    "--trajectory",
    METHOD,
    "fourier, a random Fourier series; ta or tb, published ones; tc, kept for validation; or a "
    "file of symid excite, .csv.",
    metavar="NAME|FILE",
    default="fourier",
)
@option(
    "--scale",
    METHOD,
    "Factor on the trajectory's amplitudes.",
    type=POSITIVE,
    default=1.0,
    metavar="FACTOR",
)
@option(
    "--joint",
    METHOD,
    "Number of the joint that tb moves; those that follow another do not count.",
    type=COUNT,
    default=1,
)
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
    "Elastic robots only: how much later than the motor encoders the link encoders are, s.",
    type=FiniteRange(),
    default=0.0,
    metavar="S",
    show_default=False,
)
@option(
    "--offset",
    MODEL,
    "Elastic robots only: what the link encoders read at zero, rad or m.",
    type=FiniteRange(),
    default=0.0,
    metavar="RAD",
    show_default=False,
)
@friction_option
@seed_option
@output_option("Log to write, .npz or .csv.", required=True)
@force_option
@verb
def simulate_command(
    console: Console,
    *,
    robot: NamedRobot,
    trajectory: str,
    joint: int,
    scale: float,
    duration: float | None,
    noise: float | None,
    clean: bool,
    delay: float,
    offset: float,
    friction: str | None,
    seed: int,
    output: Path,
    force: bool,
) -> Answer:
    """Move the robot under PD control along a trajectory and write what its sensors see.

    The robot file must state masses and friction. Elastic robots are moved by their motors; their log holds
    link positions q, motor positions theta and motor torques tau.
    """
    model = robot.load(console, friction=friction)
    check_suffix(output, "a log", (".npz", ".csv"))
    check_output(output, force=force, inputs=(model.path, Path(trajectory)))
    run = model.simulate(
        trajectory,
        joint=joint,
        scale=scale,
        duration=duration,
        noise=noise,
        clean=clean,
        delay=delay,
        offset=offset,
        seed=seed,
    )
    written = run.save(output)
    return Answer(
        text=f"{show_path(written)}: {run.summarise()}",
        result={"robot": model.name, "file": written, **run.to_dict()},
        warnings=run.notices,
    )
