"""The verbs on an estimate: `symid validate`, `symid compare`, `symid report`, `symid export`."""

from dataclasses import replace
from pathlib import Path
from time import strftime
from typing import Any

import click

import symid
from symid import ElasticFit
from symid.api import compare_fit, export_fit, load_other
from symid.cli import options as cli
from symid.cli.call import Answer, Console, make_answer
from symid.environment import show_path
from symid.errors import Notice, UsageError
from symid.options import ExportOptions


@cli.verb("validate")
@cli.robot_argument(computes=True)
@click.argument("estimate", type=cli.FILE)
@click.argument("log", type=cli.FILE)
@cli.INPUT(
    "--test",
    "Part of LOG to predict, such as 60%: after `identify --train 0:60%`; a number without a unit has that "
    "of --train, or is in seconds.  [default: all of it]",
    metavar="START:END",
)
@cli.OUTPUT(
    "--gate",
    "Limit of the mean relative residual of the joints; for elastic joints, of each table.",
    cli.POSITIVE,
    "PERCENT",
)
@cli.PROCESSING(
    "--band",
    "Compare torques at the full sample rate, the measured one and the one predicted from the states of "
    "the fit with the same low-pass filter, without half a second at either end; --gate applies to this "
    "value.",
    cli.POSITIVE,
    "HZ",
)
@cli.METHOD(
    "--tracking",
    "Elastic joints: simulate the tracking of another motion with feed-forward of ESTIMATE; the "
    "robot file must state the true values.",
    is_flag=True,
)
@cli.METHOD("--against", "With --tracking: a second estimate to compare with.", cli.FILE, "ESTIMATE")
@cli.METHOD(
    "--seed",
    "With --tracking: follow a random motion of this seed.  [default: tc for two joints, else 1]",
    cli.WHOLE,
    "N",
)
@cli.settings_options
@cli.accept_option
def validate_command(
    console: Console,
    *,
    robot: cli.NamedRobot,
    estimate: Path,
    log: Path,
    tracking: bool,
    against: Path | None,
    seed: int | None,
    **trial: cli.Given,
) -> Answer:
    """Predict the torques of LOG with the parameters in ESTIMATE; nothing is fitted.

    Filter and friction model are those of the identification. Results of --rows friction are accepted
    too. Exit code 1 if the gate is missed, or the verdict is wrong.
    """
    given = [name for name, value in (("--against", against), ("--seed", seed)) if value is not None]
    if given and not tracking:
        text = f"{', '.join(given)} needs --tracking; give it too, or leave the option out"
        raise UsageError(Notice(code="usage.no-tracking", text=text))
    fit = symid.load_fit(estimate, robot.load(console))
    if tracking and not isinstance(fit, ElasticFit):
        text = "--tracking needs an estimate of elastic joints with their springs; leave it out"
        raise UsageError(Notice(code="usage.rigid-tracking", text=text, file=str(estimate)))
    if not isinstance(fit, ElasticFit) or not tracking or trial["band"] is not None:
        first, *others = cli.try_log(fit, log, **trial)
        return cli.add_trials(make_answer(first), others)
    del trial["band"]
    other = None if against is None else symid.load_fit(against)
    if other is not None and not isinstance(other, ElasticFit):
        text = "--against: expected an estimate of elastic joints"
        raise UsageError(Notice(code="usage.rigid-tracking", text=text, file=str(against)))
    others = [] if other is None else [other]
    return make_answer(fit.track(log, against=others, seed=seed, **trial))


@cli.verb("compare")
@cli.robot_argument()
@click.argument("estimate", type=cli.FILE)
@click.argument("others", nargs=-1, required=True, metavar="OTHER...", type=cli.FILE)
@cli.INPUT("--name", "Table column of names or groups.", metavar="COLUMN")
@cli.INPUT("--value", "Table column of values.", metavar="COLUMN")
@cli.INPUT("--deviation", "Table column of standard deviations.", metavar="COLUMN")
@cli.INPUT(
    "--deviation-unit",
    "Unit of the table's standard deviations.  [default: by the name of their column]",
    click.Choice(("absolute", "percent")),
)
@cli.INPUT(
    "--read-as",
    'Read a group of a table as another sum, such as "fv5 = fv5 + fvm6".',
    multiple=True,
    metavar="GROUP=SUM",
)
@cli.METHOD("--gate", "Limit of the largest difference, in standard deviations.", cli.POSITIVE, "SIGMA")
@cli.page_option
@cli.force_option
def compare_command(
    console: Console,
    *,
    robot: cli.NamedRobot,
    estimate: Path,
    others: tuple[Path, ...],
    read_as: tuple[str, ...],
    page: Path | None,
    force: bool,
    **options: cli.Given,
) -> Answer:
    """Compare the values in ESTIMATE with those of every OTHER.

    OTHER is another estimate of the same robot, or a table (CSV) of published values in other groupings;
    ours are regrouped exactly. Differences are in standard deviations of both sides. Exit code 1 if the
    gate is missed.
    """
    model, expected = robot.load(console).description, 'GROUP = SUM, such as "fv5 = fv5 + fvm6"'
    readings = cli.split_pairs("--read-as", read_as, expected, "usage.read-as", once=True)
    cli.check_output(page, force=force, inputs=(estimate, *others))
    found = compare_fit(model, estimate, others, read_as=readings, progress=console.progress, **options)
    return cli.add_page(make_answer(found), found, page)


@cli.verb("report")
@click.argument("estimate", type=cli.FILE)
@cli.INPUT("--validation logs", "Held-out log to predict; may be repeated.", cli.FILE, "LOG", multiple=True)
@cli.INPUT(
    "--test",
    "Part of the logs of --validation to predict, as in `validate`; give it once, or once for each log.",
    metavar="START:END",
    multiple=True,
)
@cli.METHOD(
    "--diagnose",
    "Read the logs of the fit again: identifiability, essential parameters, bootstrap, drift, and "
    "which term the residual misses.",
    is_flag=True,
)
@cli.robot_option("Robot of the logs.  [default: the name or file in ESTIMATE]")
@cli.settings_options
@cli.output_option(
    "Page to write.",
    *(
        cli.OUTPUT(name, text, default="", show_default=False, metavar="TEXT")
        for name, text in (
            ("--title", "Title of the page.  [default: robot and subject]"),
            ("--author", "Author, below the title."),
            ("--date", "Date, below the title.  [default: today, where an author is given]"),
        )
    ),
    required=True,
)
@cli.open_option
@cli.accept_option
def report_command(
    console: Console,
    *,
    estimate: Path,
    logs: tuple[Path, ...],
    test: tuple[str, ...],
    diagnose: bool,
    robot: cli.NamedRobot | None,
    settings: dict[str, str],
    output: Path,
    force: bool,
    **heading: str,
) -> Answer:
    """Write one self-contained HTML page: verdict, parameters, measured and predicted torques.

    For elastic joints also springs, hysteresis loops and the compared methods; for friction the curves
    and the compared laws. ESTIMATE may also be of `identify --method stiffness`, `payload` or `hysteresis`.
    Exit code 1 if the verdict is wrong; the page is written all the same.
    """
    # A diagnosis reads the logs of the fit as the fit did.
    named, single = "settings" in settings, settings.keys() - {"settings"}
    asked = {"--settings": named, "--set": single, "--test": test}
    given = [name for name, value in asked.items() if value]
    if given and not logs:
        text = f"{', '.join(given)} is of the logs that --validation names, and there is none; "
        text += f"give --validation LOG, or leave {'them' if given[1:] else 'it'} out"
        raise UsageError(Notice(code="usage.no-validation", text=text))
    cli.check_output(output, force=force, inputs=(estimate, *logs))
    # The same call gives the same page on another day, but for one that somebody signs.
    heading["date"] = heading["date"] or strftime("%Y-%m-%d") * bool(heading["author"])
    other = load_other(estimate)
    if other is not None:
        given = ["--validation"] * bool(logs) + ["--diagnose"] * diagnose
        if given:
            text = f"{', '.join(given)} needs an estimate of dynamics or friction; leave it out"
            raise UsageError(Notice(code="usage.no-validation", text=text, file=str(estimate)))
        written = cli.add_page(make_answer(other), other, output, **heading)
        said = (f"report: {show_path(output)}",)
        return replace(written, blocks=said, brief=said).write(file=output)
    fit = symid.load_fit(estimate, None if robot is None else robot.load(console), progress=console.progress)
    if logs or diagnose:
        cli.check_output(output, force=True, inputs=(fit.robot.path,))
    given_logs: dict[str, Any] = {"validation": logs, "test": test or None, "settings": settings}
    page = fit.report(output, diagnose=diagnose, **given_logs, **heading)
    return make_answer(page)


@cli.verb("export")
@cli.robot_argument()
@click.argument("estimate", required=False, type=cli.FILE)
@cli.output_option(
    "File to write: .toml, .urdf, .xml or .mjcf (MuJoCo), .usda, .h (C), .json.",
    cli.record_options(ExportOptions, "precision", "name"),
    cli.OUTPUT("--in-place", "Write the URDF or MJCF that ROBOT was made from, not -o.", is_flag=True),
    cli.record_options(ExportOptions, "accept", "limit", "ratio"),
)
def export_command(
    console: Console,
    *,
    robot: cli.NamedRobot,
    estimate: Path | None,
    output: Path | None,
    in_place: bool,
    force: bool,
    **values: cli.Given,
) -> Answer:
    """Write ROBOT with the values in ESTIMATE; the suffix of FILE selects the format.

    Among all physically consistent bodies with the identified combinations of masses and inertias,
    those nearest to the robot file are written; where no bodies have them, those nearest to ESTIMATE. If
    ROBOT was made from a URDF or MJCF, a .urdf or .xml is that file with other numbers, all else as it
    was. Results of --rows friction give the joints their laws, if robot files have a model for them.
    Without ESTIMATE the values of the robot file are written. An ESTIMATE whose verdict is wrong is
    refused.
    """
    if (output is None) != in_place:
        text = "give the file to write (-o FILE), or --in-place for the file that ROBOT was made from; not "
        text += "both"
        raise UsageError(Notice(code="usage.export-file", text=text))
    options = cli.take_record(ExportOptions, values)
    model = robot.load(console)
    cli.check_output(output, force=force, inputs=(model.path, estimate))
    if estimate is None:
        if output is None:
            text = "--in-place writes the values of ESTIMATE; give one"
            raise UsageError(Notice(code="usage.export-file", text=text))
        return make_answer(model.export(output, precision=options.precision, name=options.name))
    return make_answer(export_fit(model.description, estimate, output, options, console.progress))
