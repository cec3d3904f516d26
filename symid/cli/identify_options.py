"""The options of `symid identify` that say how measurements become parameters."""

from pathlib import Path

import click

from symid.api.arguments import METHODS
from symid.cli.options import METHOD, MODEL, PROCESSING, FiniteRange, add_options, option

__all__ = [
    "ELASTIC",
    "FRICTION",
    "RIGID",
    "elastic_options",
    "friction_law_options",
    "rigid_options",
    "rows_options",
]

RIGID = ("overlap", "prior", "prior_deviation", "prior_weight", "start", "partial")
ELASTIC = ("tolerance", "thresholds", "knees", "window", "rate")
FRICTION = ("model", "known", "smoothing", "seed")
"""Names of the options of each kind."""
_POSITIVE = FiniteRange(min=0.0, min_open=True)
_COUNT = click.IntRange(min=0)

rows_options = add_options(
    option(
        "--rows",
        type=click.Choice(("torque", "momentum", "filtered", "power", "energy", "friction")),
        group=METHOD,
        help="Equations that measurements become; friction: a friction law for every joint that moves.  "
        "[default: torque]",
    ),
    option(
        "--estimator",
        metavar="NAME",
        group=METHOD,
        help="How equations become parameters: ols, wls, gls, huber, ridge, consistent, sequential, "
        "output-error or instrumental; with --rows friction varpro, root-finding, nlp, genetic, annealing "
        "or differential-evolution.  [default: ols, varpro]",
    ),
)
rigid_options = add_options(
    option(
        "--partial",
        is_flag=True,
        group=METHOD,
        help="Fit what can be identified, even where that is less than three quarters of the parameters.",
    ),
    option(
        "--overlap",
        type=FiniteRange(min=0.0, max=0.95),
        metavar="PART",
        group=METHOD,
        help="Momentum and energy rows: part of a window that the next one shares.  [default: 0]",
    ),
    option(
        "--prior",
        metavar="ESTIMATE",
        group=METHOD,
        help="Ridge: an earlier estimate to stay near to, or robot for the robot file's values.  "
        "[default: robot]",
    ),
    option(
        "--prior-deviation",
        type=_POSITIVE,
        metavar="X",
        group=METHOD,
        help="Ridge: how well the prior is known, in percent of the robot file's values, or as a factor on "
        "an estimate's deviations.  [default: 20 %; 1]",
    ),
    option(
        "--prior-weight",
        type=FiniteRange(min=0.0),
        metavar="W",
        group=METHOD,
        help="Ridge: 1 to believe the deviations stated, 0 for no prior.  [default: by cross validation]",
    ),
    option(
        "--start",
        metavar="ESTIMATE",
        group=METHOD,
        help="Output error and instrumental: an estimate of the same model to begin with.  "
        "[default: a fit of the same logs]",
    ),
    option(
        "--period",
        type=_POSITIVE,
        multiple=True,
        metavar="S",
        group=PROCESSING,
        help="Period of a repeated motion (s), once or once for each log: average over all periods (--rows "
        "friction), or take what differs between them as noise (--estimator gls).",
    ),
)
elastic_options = add_options(
    option(
        "--method",
        type=click.Choice((*METHODS, "stiffness")),
        group=METHOD,
        help="Elastic joints: the method; stiffness alone is for any robot.  [default: automatic]",
    ),
    option(
        "--window",
        type=_POSITIVE,
        metavar="S",
        group=METHOD,
        help="Length of a momentum, filtered or energy row (s).",
    ),
    option(
        "--tolerance",
        type=_POSITIVE,
        group=METHOD,
        help="Elastic joints: relative change at which an iteration stops.",
    ),
    option(
        "--lambda",
        "rate",
        type=_POSITIVE,
        metavar="RAD/S",
        group=METHOD,
        help="Elastic joints: corner frequency of the first-order filter.",
    ),
    option(
        "--thresholds",
        type=_COUNT,
        metavar="N",
        group=MODEL,
        help="Elastic joints: number of stops of each joint's hysteresis.",
    ),
    option(
        "--knees",
        type=_COUNT,
        metavar="N",
        group=MODEL,
        help="Elastic joints: number of knees on each side of a spring.",
    ),
)
friction_law_options = add_options(
    option(
        "--model",
        metavar="NAME",
        group=MODEL,
        help="With --rows friction: a law, such as stribeck+offset, or auto, which chooses one by torques "
        "held back.  [default: auto]",
    ),
    option(
        "--known",
        type=click.Path(path_type=Path),
        metavar="ESTIMATE",
        group=MODEL,
        help="With --rows friction: base parameters to subtract, an estimate of other rows.  [default: the "
        "rigid part is fitted along]",
    ),
    option(
        "--smoothing",
        type=FiniteRange(min=0.0),
        metavar="V",
        group=MODEL,
        help="With --rows friction: speed over which dry friction changes its sign.  [default: 0]",
    ),
    option(
        "--seed",
        type=_COUNT,
        metavar="N",
        group=METHOD,
        help="With --rows friction: random seed of a stochastic estimator.",
    ),
)
