"""The options of `symid excite` that say what is searched for, and within what."""

from pathlib import Path

import click

from symid.cli.options import INPUT, METHOD, MODEL, OUTPUT, FiniteRange, add_options, option

__all__ = ["excite_options"]

_POSITIVE = FiniteRange(min=0.0, min_open=True)
_COUNT = click.IntRange(min=1)
_UNSTATED = "where the robot file states none"

excite_options = add_options(
    option(
        "--harmonics",
        type=_COUNT,
        default=5,
        show_default=True,
        metavar="N",
        group=METHOD,
        help="Number of harmonics of each joint.",
    ),
    option(
        "--period",
        type=_POSITIVE,
        default=10.0,
        show_default=True,
        metavar="S",
        group=METHOD,
        help="Length of the trajectory, s.",
    ),
    option(
        "--criterion",
        type=click.Choice(("condition", "d-optimal")),
        default="condition",
        show_default=True,
        group=METHOD,
        help="Minimise the condition number of the column-scaled regressor, or maximise the information.",
    ),
    option(
        "--weight",
        type=FiniteRange(min=0.0),
        default=0.1,
        show_default=True,
        group=METHOD,
        help="Weight of the information beside the condition number, which alone favours tiny motions.",
    ),
    option("--moving", is_flag=True, group=METHOD, help="Let it start and end in motion instead of at rest."),
    option("--start", metavar="Q1,Q2,...", group=METHOD, help="Pose in which it starts and ends, rad or m."),
    option(
        "--share",
        type=FiniteRange(min=0.0, max=1.0, min_open=True),
        default=0.95,
        show_default=True,
        group=MODEL,
        help="Part of every limit that may be used.",
    ),
    option(
        "--sweep",
        type=_POSITIVE,
        default=1.0,
        show_default=True,
        group=MODEL,
        help=f"Position limit either side of zero {_UNSTATED}, rad or m.",
    ),
    option(
        "--velocity",
        type=_POSITIVE,
        default=2.0,
        show_default=True,
        group=MODEL,
        help=f"Velocity limit {_UNSTATED}, rad/s or m/s.",
    ),
    option(
        "--acceleration",
        type=_POSITIVE,
        default=10.0,
        show_default=True,
        group=MODEL,
        help=f"Acceleration limit {_UNSTATED}, rad/s^2 or m/s^2.",
    ),
    option(
        "--jerk",
        type=_POSITIVE,
        group=MODEL,
        help=f"Jerk limit {_UNSTATED}, rad/s^3 or m/s^3.  [default: none]",
    ),
    option(
        "--workspace",
        type=click.Path(path_type=Path, exists=True, dir_okay=False),
        metavar="FILE",
        group=INPUT,
        help="File of spheres and planes that links keep to, .toml.",
    ),
    option(
        "--torsion",
        type=_POSITIVE,
        metavar="RAD",
        group=MODEL,
        help="Largest torsion of elastic joints, rad or m.",
    ),
    option(
        "--stiffness",
        metavar="K1,K2,...",
        group=MODEL,
        help="Stiffness of all joints for --torsion, in place of the robot file's, N m/rad or N/m.",
    ),
    option(
        "--deviations",
        metavar="S1,S2,...",
        group=METHOD,
        help="Standard deviations of the torque noise, one a joint, N m or N.  [default: all equal]",
    ),
    option(
        "--candidates",
        type=_COUNT,
        default=1000,
        show_default=True,
        metavar="N",
        group=METHOD,
        help="Number of random feasible trajectories to start from, and to beat.",
    ),
    option(
        "--starts",
        type=_COUNT,
        default=10,
        show_default=True,
        metavar="N",
        group=METHOD,
        help="Number of candidates that are optimised.",
    ),
    option(
        "--rate",
        type=_POSITIVE,
        default=1000.0,
        show_default=True,
        metavar="HZ",
        group=OUTPUT,
        help="Sample rate of the file.",
    ),
    option(
        "--periods",
        type=_COUNT,
        default=1,
        show_default=True,
        metavar="N",
        group=OUTPUT,
        help="How often the file runs through the trajectory.",
    ),
)
