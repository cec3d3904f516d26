"""The verbs on an estimate: `symid validate`, `symid compare`, `symid report`, `symid export`.

validate ROBOT ESTIMATE LOG: what an estimate explains of a log it was not fitted to.
compare ROBOT ESTIMATE OTHER...: identified values beside those of others, group by group.
report ESTIMATE -o report.html: what was found, on one page.
export ROBOT [ESTIMATE] -o FILE: identified values, or a robot file's own, for other programs.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import click

import symid
from symid.api import ElasticFit, Fit, LogValidation, Precision, RigidFit, compare_fit, export_fit
from symid.cli.call import Answer, Console, make_answer
from symid.cli.options import (
    FILE,
    INPUT,
    METHOD,
    OUTPUT,
    POSITIVE,
    PROCESSING,
    WHOLE,
    NamedRobot,
    Verb,
    check_output,
    force_option,
    option,
    output_option,
    robot_argument,
    robot_option,
    set_option,
    split_settings,
    verb,
)
from symid.errors import Notice, UsageError


@click.command("validate", cls=Verb)
@robot_argument(computes=True)
@click.argument("estimate", type=FILE)
@click.argument("log", type=FILE)
@option(
    "--gate",
    OUTPUT,
    "Largest acceptable mean of the joints' relative residuals; of elastic joints, in each table.",
    type=POSITIVE,
    metavar="PERCENT",
)
@option(
    "--band",
    PROCESSING,
    "Compare torques at the full sample rate, both low-passed alike at HZ, without half a second "
    "at either end; the gate is of that figure.",
    type=POSITIVE,
    metavar="HZ",
)
@option(
    "--tracking",
    METHOD,
    "Elastic joints: simulate how links follow another motion with feed-forward of ESTIMATE; the "
    "robot file must state the true values.",
    is_flag=True,
)
@option(
    "--against",
    METHOD,
    "With --tracking: a second estimate to compare with.",
    type=FILE,
    metavar="ESTIMATE",
)
@option(
    "--seed",
    METHOD,
    "With --tracking: follow a random motion of this seed.  [default: tc for two joints, else 1]",
    type=WHOLE,
    metavar="N",
)
@set_option
@verb
def validate_command(
    console: Console,
    *,
    robot: NamedRobot,
    estimate: Path,
    log: Path,
    gate: float | None,
    band: float | None,
    tracking: bool,
    against: Path | None,
    seed: int | None,
    settings: tuple[str, ...],
) -> Answer:
    """Predict the torques of LOG with the parameters in ESTIMATE; nothing is fitted.

    Filter and friction are those of the identification; a result of --rows friction is tried as
    well, with the rigid part beside it. Exit code 1 when the gate is missed.
    """
    pairs = split_settings(settings)
    given = [name for name, value in (("--against", against), ("--seed", seed)) if value is not None]
    if given and not tracking:
        text = f"{', '.join(given)} is of the motion that --tracking simulates; give --tracking too"
        raise UsageError(Notice(code="usage.no-tracking", text=text))
    fit = symid.load_fit(estimate, robot.load(console))
    if isinstance(fit, ElasticFit) and tracking:
        _refuse_band(fit, band)
        others = [] if against is None else [_load_elastic(against)]
        return make_answer(fit.track(log, against=others, seed=seed, gate=gate, settings=pairs))
    if tracking:
        text = "--tracking needs an estimate of elastic joints with their springs; leave it out"
        raise UsageError(Notice(code="usage.rigid-tracking", text=text, file=str(estimate)))
    return make_answer(_validate(fit, log, gate=gate, band=band, settings=pairs))


def _validate(
    fit: Fit, log: Path, *, gate: float | None, band: float | None, settings: dict[str, str]
) -> LogValidation:
    if isinstance(fit, RigidFit):
        return fit.validate(log, gate=gate, band=band, settings=settings)
    _refuse_band(fit, band)
    return fit.validate(log, gate=gate, settings=settings)


def _refuse_band(fit: Fit, band: float | None) -> None:
    if band is not None:
        kind = "elastic joints" if isinstance(fit, ElasticFit) else "a law of friction"
        text = f"--band needs an estimate of base parameters, and this one is of {kind}; leave it out"
        raise UsageError(Notice(code="usage.no-band", text=text, file=str(fit.file)))


def _load_elastic(path: Path) -> ElasticFit:
    fit = symid.load_fit(path)
    if not isinstance(fit, ElasticFit):
        text = "--against compares with another estimate of elastic joints, and this is none"
        raise UsageError(Notice(code="usage.rigid-tracking", text=text, file=str(path)))
    return fit


@click.command("compare", cls=Verb)
@robot_argument()
@click.argument("estimate", type=FILE)
@click.argument("others", nargs=-1, required=True, metavar="OTHER...", type=FILE)
@option("--name", INPUT, "Table column of names or groups.", metavar="COLUMN")
@option("--value", INPUT, "Table column of values.", metavar="COLUMN")
@option("--deviation", INPUT, "Table column of standard deviations.", metavar="COLUMN")
@option(
    "--deviation-unit",
    INPUT,
    "Unit of the table's standard deviations.  [default: by the name of their column]",
    type=click.Choice(("absolute", "percent")),
)
@option(
    "--read-as",
    INPUT,
    'Read a group of a table as another sum, such as "fv5 = fv5 + fvm6".',
    multiple=True,
    metavar="GROUP=SUM",
)
@option(
    "--gate",
    METHOD,
    "Largest acceptable difference, in standard deviations.",
    type=POSITIVE,
    metavar="SIGMA",
)
@verb
def compare_command(
    console: Console,
    *,
    robot: NamedRobot,
    estimate: Path,
    others: tuple[Path, ...],
    name: str | None,
    value: str | None,
    deviation: str | None,
    deviation_unit: Literal["absolute", "percent"] | None,
    read_as: tuple[str, ...],
    gate: float | None,
) -> Answer:
    """Show how far the values in ESTIMATE are from those of every OTHER.

    OTHER is another estimate of the same robot, or a table (CSV) of values that somebody else found, in
    groups of their own: ours are brought to them exactly. Differences are in standard deviations of both
    sides together. Exit code 1 when the gate is missed.
    """
    found = compare_fit(
        robot.load(console).description,
        estimate,
        others,
        name=name,
        value=value,
        deviation=deviation,
        deviation_unit=deviation_unit,
        read_as=_split_readings(read_as),
        gate=gate,
        progress=console.progress,
    )
    return make_answer(found)


def _split_readings(texts: Sequence[str]) -> dict[str, str]:
    """Return what groups are to be read as, by their text without blanks.

    Raises:
        UsageError: a text has no equals sign, or a group is given twice.
    """
    readings: dict[str, str] = {}
    for text in texts:
        group, sign, other = text.partition("=")
        key = "".join(group.split())
        if not sign or not key or not other.strip():
            message = f'--read-as {text!r}: expected GROUP = SUM, such as "fv5 = fv5 + fvm6"'
            raise UsageError(Notice(code="usage.read-as", text=message))
        if key in readings:
            message = f"--read-as {text!r}: the group is read as {readings[key]!r} already; give it once"
            raise UsageError(Notice(code="usage.read-as", text=message))
        readings[key] = other.strip()
    return readings


@click.command("report", cls=Verb)
@click.argument("estimate", type=FILE)
@option(
    "--validation logs",
    INPUT,
    "Held-out log to predict; may be repeated.",
    multiple=True,
    metavar="LOG",
    type=FILE,
)
@option(
    "--diagnose",
    METHOD,
    "Read the logs of the fit again: identifiability, essential parameters, bootstrap, drift, and "
    "which term the residual misses.",
    is_flag=True,
)
@robot_option("Robot of the logs.  [default: the name in ESTIMATE]")
@set_option
@output_option("Page to write.", required=True)
@force_option
@verb
def report_command(
    console: Console,
    *,
    estimate: Path,
    logs: tuple[Path, ...],
    diagnose: bool,
    robot: NamedRobot | None,
    settings: tuple[str, ...],
    output: Path,
    force: bool,
) -> Answer:
    """Write one self-contained HTML page: verdict, parameters, measured and predicted torques.

    For elastic joints also springs, hysteresis loops, and the methods that were compared; for friction
    its curves, and the laws that were compared.
    """
    pairs = split_settings(settings)
    # A diagnosis reads the logs of the fit as the fit did.
    given = [name for name, value in (("--robot", robot and not diagnose), ("--set", settings)) if value]
    if given and not logs:
        text = (
            f"{', '.join(given)} is of the logs that --validation names, and there is none; "
            f"give --validation LOG, or leave {'them' if given[1:] else 'it'} out"
        )
        raise UsageError(Notice(code="usage.no-validation", text=text))
    check_output(output, force=force, inputs=(estimate, *logs))
    fit = symid.load_fit(estimate, None if robot is None else robot.load(console), progress=console.progress)
    if logs or diagnose:
        check_output(output, force=True, inputs=(fit.robot.path,))
    return make_answer(fit.report(output, validation=logs, settings=pairs, diagnose=diagnose))


@click.command("export", cls=Verb)
@robot_argument()
@click.argument("estimate", required=False, type=FILE)
@output_option("File to write: .toml, .urdf, .xml or .mjcf (MuJoCo), .h (C), .json.", required=True)
@option(
    "--precision",
    OUTPUT,
    "Type of the numbers in a C header: that of the generated library.",
    type=click.Choice(("double", "float")),
    default="double",
)
@force_option
@verb
def export_command(
    console: Console,
    *,
    robot: NamedRobot,
    estimate: Path | None,
    output: Path,
    precision: Precision,
    force: bool,
) -> Answer:
    """Write ROBOT with the values in ESTIMATE, in the format that the name of FILE ends in.

    Logs show combinations of masses and inertias; of all bodies that have them the nearest to
    those of the robot file are taken, and only bodies that can exist. Springs are written as found.
    A result of --rows friction gives its laws to the joints, where robot files have a model of them.
    Without ESTIMATE the robot file's own values are written.
    """
    model = robot.load(console)
    check_output(output, force=force, inputs=(model.path, *([estimate] if estimate else [])))
    if estimate is None:
        return make_answer(model.export(output, precision=precision))
    found = export_fit(model.description, estimate, output, precision=precision, progress=console.progress)
    return make_answer(found)
