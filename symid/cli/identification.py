"""The verbs that identify: `symid identify`, `symid payload`."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from symid.api import METHODS
from symid.cli.call import Answer, Console, answer_saved
from symid.cli.options import (
    FILE,
    INPUT,
    METHOD,
    MODEL,
    POSITIVE,
    PROCESSING,
    WHOLE,
    FiniteRange,
    NamedRobot,
    Verb,
    add_options,
    check_output,
    friction_option,
    option,
    output_option,
    processing_options,
    robot_argument,
    set_option,
    split_settings,
    verb,
)
from symid.errors import Notice, UsageError

if TYPE_CHECKING:
    from symid import RobotModel

RIGID = ("overlap", "prior", "prior_deviation", "prior_weight", "start", "partial")
ELASTIC = ("tolerance", "thresholds", "knees", "window", "rate")
FRICTION = ("model", "known", "smoothing", "seed")
"""Names of the options of each kind."""

rows_options = add_options(
    option(
        "--rows",
        METHOD,
        "Equations built from measurements; friction: a friction law for every joint that moves.  "
        "[default: torque]",
        type=click.Choice(("torque", "momentum", "filtered", "power", "energy", "friction")),
    ),
    option(
        "--estimator",
        METHOD,
        "Estimator of the parameters: ols, wls, gls, huber, ridge, consistent, sequential, "
        "output-error or instrumental; with --rows friction varpro, root-finding, nlp, genetic, "
        "annealing or differential-evolution.  [default: ols, varpro]",
        metavar="NAME",
    ),
)
rigid_options = add_options(
    option(
        "--partial",
        METHOD,
        "Fit the identifiable parameters, even if they are less than three quarters of all.",
        is_flag=True,
    ),
    option(
        "--overlap",
        METHOD,
        "Momentum and energy rows: part of a window shared with the next one.  [default: 0]",
        type=FiniteRange(min=0.0, max=0.95),
        metavar="PART",
    ),
    option(
        "--prior",
        METHOD,
        "Ridge: an earlier estimate as prior, or robot for the robot file's values.  [default: robot]",
        metavar="ESTIMATE",
    ),
    option(
        "--prior-deviation",
        METHOD,
        "Ridge: standard deviation of the prior, in percent of the robot file's values, or as a factor "
        "on an estimate's deviations.  [default: 20 %; 1]",
        type=POSITIVE,
        metavar="X",
    ),
    option(
        "--prior-weight",
        METHOD,
        "Ridge: 1 to use the prior's deviations as stated, 0 for no prior.  [default: cross-validated]",
        type=FiniteRange(min=0.0),
        metavar="W",
    ),
    option(
        "--start",
        METHOD,
        "Output error and instrumental: an estimate of the same model as initial values.  [default: a "
        "fit of the same logs]",
        metavar="ESTIMATE",
    ),
    option(
        "--period",
        PROCESSING,
        "Period of a repeated motion (s), one for all logs or one for each: average over the periods "
        "(--rows friction), or use their differences as noise (--estimator gls).",
        type=POSITIVE,
        multiple=True,
        metavar="S",
    ),
)
elastic_options = add_options(
    option(
        "--method",
        METHOD,
        "Elastic joints: the method; stiffness works for any robot.  [default: automatic]",
        type=click.Choice((*METHODS, "stiffness")),
    ),
    option(
        "--window", METHOD, "Length of a momentum, filtered or energy row (s).", type=POSITIVE, metavar="S"
    ),
    option(
        "--tolerance", METHOD, "Elastic joints: relative change at which an iteration stops.", type=POSITIVE
    ),
    option(
        "--lambda rate",
        METHOD,
        "Elastic joints: corner frequency of the first-order filter.",
        type=POSITIVE,
        metavar="RAD/S",
    ),
    option(
        "--thresholds",
        MODEL,
        "Elastic joints: number of stops of each joint's hysteresis.",
        type=WHOLE,
        metavar="N",
    ),
    option(
        "--knees", MODEL, "Elastic joints: number of knees on each side of a spring.", type=WHOLE, metavar="N"
    ),
)
friction_law_options = add_options(
    option(
        "--model",
        MODEL,
        "With --rows friction: a law, such as stribeck+offset, or auto, chosen on held-out data.  "
        "[default: auto]",
        metavar="NAME",
    ),
    option(
        "--known",
        MODEL,
        "With --rows friction: an estimate with base parameters to subtract.  [default: the rigid part "
        "is fitted too]",
        type=FILE,
        metavar="ESTIMATE",
    ),
    option(
        "--smoothing",
        MODEL,
        "With --rows friction: speed over which dry friction changes its sign.  [default: 0]",
        type=FiniteRange(min=0.0),
        metavar="V",
    ),
    option(
        "--seed",
        METHOD,
        "With --rows friction: random seed of a stochastic estimator.",
        type=WHOLE,
        metavar="N",
    ),
)


_STIFFNESS = "stiffness"
_LAWS = "friction"


@click.command("identify", cls=Verb)
@robot_argument(computes=True)
@click.argument("logs", nargs=-1, required=True, metavar="LOG...", type=FILE)
@processing_options
@set_option
@friction_option
@rows_options
@rigid_options
@elastic_options
@friction_law_options
@output_option("Write the result as JSON, for `validate`, `report` and `export`.")
@verb
def identify_command(
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
    """Identify base parameters and friction from logs; for elastic joints also springs.

    Columns, units, filter and decimation are those of the robot file; options override them.
    Parameters that are not identifiable are listed with the reason. With --rows friction a friction law
    and its parameters are identified for every joint that moves.
    """
    rigid, elastic, law = ({name: further[name] for name in names} for names in (RIGID, ELASTIC, FRICTION))
    _check_mixed(rows, {"method": method, **elastic, **rigid}, law)
    shared = {key: value for key, value in further.items() if key not in (*RIGID, *ELASTIC, *FRICTION)}
    shared["settings"] = split_settings(settings)
    # Wrong settings are refused before anything else.
    model = robot.load(console, settings=shared["settings"], friction=shared["friction"])
    check_output(output, force=force, inputs=(model.path, *logs))
    if rows == _LAWS:
        laws = model.identify_friction(logs, estimator=estimator, period=period, **law, **shared)
        return answer_saved(laws, output, "result")
    if method == _STIFFNESS:
        rest = {"rows": rows, "estimator": estimator, "period": period, **rigid, **elastic}
        return _answer_stiffness(model, logs, _list_given(rest), shared, output)
    fit = model.identify(
        logs, rows=rows, estimator=estimator, method=method, period=period, **rigid, **elastic, **shared
    )
    return answer_saved(fit, output, "estimate")


def _answer_stiffness(
    model: "RobotModel",
    logs: tuple[Path, ...],
    given: list[str],
    shared: Mapping[str, Any],
    output: Path | None,
) -> Answer:
    """Return the stiffness of all joints; options of rows and estimators are refused."""
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
    return answer_saved(found, output, "result")


def _list_given(options: Mapping[str, object]) -> list[str]:
    """Return the given options as on the command line."""
    names = [name for name, value in options.items() if value not in (None, (), False)]
    return [f"--{'lambda' if name == 'rate' else name.replace('_', '-')}" for name in names]


def _check_mixed(rows: str | None, others: Mapping[str, object], law: Mapping[str, object]) -> None:
    """Refuse options for friction laws with other rows, and other options with friction laws."""
    asked = rows == _LAWS
    given = _list_given(others if asked else law)
    if given:
        kind = rows or "torque"
        what = "--rows friction" if asked else f"--rows {kind}; they belong to --rows friction"
        text = f"{', '.join(given)} cannot be used with {what}; leave {'them' if given[1:] else 'it'} out"
        raise UsageError(Notice(code="usage.mixed-options", text=text))


@click.command("payload", cls=Verb)
@robot_argument(computes=True)
@click.argument("loaded", nargs=-1, required=True, metavar="LOADED...", type=FILE)
@option(
    "--empty",
    INPUT,
    "Estimate or log without the payload; repeat the option for several logs.",
    multiple=True,
    required=True,
    metavar="EMPTY",
    type=FILE,
)
@option("--joint", MODEL, "Joint of the link with the payload.  [default: the last joint]", metavar="NAME")
@option(
    "--mass",
    MODEL,
    "Known mass, for example from a balance; it reduces the other uncertainties.",
    type=POSITIVE,
    metavar="KG",
)
@option(
    "--rows",
    METHOD,
    "Equations built from logs: torques, or momentum over windows.",
    type=click.Choice(("torque", "momentum")),
    default="torque",
)
@option(
    "--estimator",
    METHOD,
    "Least squares for logs: ordinary, or weighted by the noise of each joint.",
    type=click.Choice(("ols", "wls")),
    default="wls",
)
@output_option("Write the result as JSON.")
@verb
def payload_command(
    console: Console,
    *,
    robot: NamedRobot,
    loaded: tuple[Path, ...],
    empty: tuple[Path, ...],
    output: Path | None,
    force: bool,
    **options: Any,  # noqa: ANN401  typed in `RobotModel.payload`
) -> Answer:
    """Identify mass, centre of mass and inertia of a payload: in LOADED, but not in EMPTY.

    LOADED and EMPTY are estimates, as `identify` writes them, or logs. The result is a physically
    consistent body; quantities that are not identifiable are listed with the reason.
    """
    check_output(output, force=force, inputs=(*loaded, *empty))
    model = robot.load(console)
    check_output(output, force=force, inputs=(model.path,))
    return answer_saved(model.payload(loaded, empty, **options), output, "payload")
