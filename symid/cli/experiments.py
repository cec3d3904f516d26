"""The verbs on experiments: `symid excite`, `symid simulate`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from symid.cli.call import Answer, Console, make_answer
from symid.cli.options import NamedRobot, check_output, friction_option, output_option, robot_argument
from symid.cli.verbs import COUNT, INPUT, METHOD, MODEL, OUTPUT, POSITIVE, WHOLE, Finite, verb
from symid.environment import check_suffix, show_path
from symid.errors import Notice, UsageError

_seed_option = METHOD.option("--seed", "Random seed.", WHOLE, "N", default=1)
_UNSTATED = "where the robot file states none"


_LISTS = ("start", "stiffness", "deviations")


@verb("excite")
@robot_argument()
@METHOD.option("--harmonics", "Number of harmonics of each joint.", COUNT, "N", default=5)
@METHOD.option("--period", "Length of the trajectory, s.", POSITIVE, "S", default=10.0)
@METHOD.option(
    "--criterion",
    "Minimise the condition number of the column-scaled regressor, or maximise the information.",
    click.Choice(("condition", "d-optimal")),
    default="condition",
)
@METHOD.option(
    "--weight",
    "Weight of the information; the condition number alone favours tiny motions.",
    Finite(min=0.0),
    default=0.1,
)
@METHOD.option("--moving", "Let it start and end in motion instead of at rest.", is_flag=True)
@METHOD.option("--start", "Pose at the start and at the end, rad or m.", metavar="Q1,Q2,...")
@MODEL.option(
    "--share",
    "Part of every limit that may be used.",
    Finite(min=0.0, max=1.0, min_open=True),
    default=0.95,
)
@MODEL.option(
    "--sweep", f"Position limit on either side of zero {_UNSTATED}, rad or m.", POSITIVE, default=1.0
)
@MODEL.option("--velocity", f"Velocity limit {_UNSTATED}, rad/s or m/s.", POSITIVE, default=2.0)
@MODEL.option("--acceleration", f"Acceleration limit {_UNSTATED}, rad/s^2 or m/s^2.", POSITIVE, default=10.0)
@MODEL.option("--jerk", f"Jerk limit {_UNSTATED}, rad/s^3 or m/s^3.  [default: none]", POSITIVE)
@INPUT.option(
    "--workspace",
    "File (.toml) of spheres and planes that bound the links.",
    click.Path(path_type=Path, exists=True, dir_okay=False),
    "FILE",
)
@MODEL.option("--torsion", "Largest torsion of elastic joints, rad or m.", POSITIVE, "RAD")
@MODEL.option(
    "--stiffness",
    "Stiffness of all joints for --torsion; replaces that of the robot file, N m/rad or N/m.",
    metavar="K1,K2,...",
)
@METHOD.option(
    "--deviations",
    "Standard deviations of the torque noise, one a joint, N m or N.  [default: all equal]",
    metavar="S1,S2,...",
)
@METHOD.option(
    "--candidates",
    "Number of random feasible trajectories to start from and to compare with.",
    COUNT,
    "N",
    default=1000,
)
@METHOD.option("--starts", "Number of candidates that are optimised.", COUNT, "N", default=10)
@OUTPUT.option("--rate", "Sample rate of the file.", POSITIVE, "HZ", default=1000.0)
@OUTPUT.option("--periods", "Number of periods in the file.", COUNT, "N", default=1)
@friction_option
@_seed_option
@output_option("Trajectory to write, .csv.")
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


@verb("simulate")
@robot_argument(computes=True)
@METHOD.option(
    "--trajectory",
    "fourier (a random Fourier series), ta or tb (published), tc (for validation), or a file (.csv) "
    "of symid excite.",
    metavar="NAME|FILE",
    default="fourier",
)
@METHOD.option("--scale", "Factor on the trajectory's amplitudes.", POSITIVE, "FACTOR", default=1.0)
@METHOD.option("--joint", "Number of the joint that tb moves, without mimic joints.", COUNT, default=1)
@METHOD.option("--duration", "Length of the experiment, s.  [default: that of the trajectory]", POSITIVE, "S")
@MODEL.option(
    "--noise",
    "Standard deviation of the torque sensors, N m or N.  [default: 0.05; of an elastic robot 2 % "
    "of each joint's RMS torque]",
    Finite(min=0.0),
    "N",
)
@MODEL.option("--clean", "Simulate perfect sensors: no noise, no encoder steps.", is_flag=True)
@MODEL.option(
    "--delay",
    "Elastic robots only: delay of the link encoders relative to the motor encoders, s.",
    Finite(),
    "S",
    default=0.0,
    show_default=False,
)
@MODEL.option(
    "--offset",
    "Elastic robots only: reading of the link encoders at zero, rad or m.",
    Finite(),
    "RAD",
    default=0.0,
    show_default=False,
)
@METHOD.option(
    "--bandwidth",
    "Bandwidth of the gains, Hz.  [default: 12, or less where the loops would not be stable; the gains of "
    "the robot file]",
    POSITIVE,
    "HZ",
)
@METHOD.option(
    "--period",
    "Period of control and log, s.  [default: 0.001; of an elastic robot with --clean 0.0002]",
    POSITIVE,
    "S",
)
@METHOD.option("--stiffness", "Own position gains, N m/rad or N/m; with --damping.", metavar="K1,K2,...")
@METHOD.option("--damping", "Own velocity gains, N m s/rad or N s/m.", metavar="D1,D2,...")
@friction_option
@_seed_option
@output_option("Log to write, .npz or .csv.", required=True)
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
    gains = ("stiffness", "damping")
    settings |= {name: _split_numbers(name, settings[name], len(model.joints)) for name in gains}
    run = model.simulate(trajectory, **settings)
    written = run.save(output)
    return Answer(
        text=f"{show_path(written)}: {run.summarise()}",
        result={"robot": model.name, "file": written, **run.to_dict()},
        warnings=run.notices,
    )
