"""`symid simulate ROBOT -o LOG`: an experiment on the computer, logged like a real one."""

from pathlib import Path

import click

from symid.cli.inputs import NamedRobot, check_output, check_suffix, show_path
from symid.cli.options import (
    METHOD,
    MODEL,
    FiniteRange,
    Verb,
    force_option,
    friction_option,
    option,
    output_option,
    robot_argument,
    seed_option,
    verb,
)
from symid.cli.output import Answer, Console

__all__ = ["command"]


@click.command("simulate", cls=Verb)
@robot_argument(computes=True)
@option(
    "--trajectory",
    metavar="NAME|FILE",
    default="fourier",
    show_default=True,
    group=METHOD,
    help="fourier, a random Fourier series; ta or tb, published ones; tc, kept for validation; or a file of "
    "symid excite, .csv.",
)
@option(
    "--scale",
    type=FiniteRange(min=0.0, min_open=True),
    default=1.0,
    show_default=True,
    metavar="FACTOR",
    group=METHOD,
    help="Factor on the trajectory's amplitudes.",
)
@option(
    "--joint",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    group=METHOD,
    help="Number of the joint that tb moves; those that follow another do not count.",
)
@option(
    "--duration",
    type=FiniteRange(min=0.0, min_open=True),
    metavar="S",
    group=METHOD,
    help="Length of the experiment, s.  [default: that of the trajectory]",
)
@option(
    "--noise",
    type=FiniteRange(min=0.0),
    metavar="N",
    group=MODEL,
    help="Standard deviation of the torque sensors, N m or N.  [default: 0.05; of an elastic robot 2 % of "
    "each joint's RMS torque]",
)
@option("--clean", is_flag=True, group=MODEL, help="Simulate perfect sensors: no noise, no encoder steps.")
@option(
    "--delay",
    type=FiniteRange(),
    default=0.0,
    metavar="S",
    group=MODEL,
    help="Elastic robots only: how much later than the motor encoders the link encoders are, s.",
)
@option(
    "--offset",
    type=FiniteRange(),
    default=0.0,
    metavar="RAD",
    group=MODEL,
    help="Elastic robots only: what the link encoders read at zero, rad or m.",
)
@friction_option
@seed_option
@output_option("Log to write, .npz or .csv.", required=True)
@force_option
@verb
def command(
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
