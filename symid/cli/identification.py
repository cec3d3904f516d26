"""The verbs that identify: `symid identify`, `symid payload`, `symid hysteresis`, `symid fleet`."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Literal

import click

import symid
from symid.api import HYSTERESIS_MODELS, METHODS, Fit, RobotModel, pair_parts
from symid.cli.call import Answer, Console, answer_saved, make_answer
from symid.cli.options import (
    NamedRobot,
    accept_option,
    add_page,
    check_output,
    force_option,
    friction_option,
    output_option,
    page_option,
    robot_argument,
    settings_options,
)
from symid.cli.verbs import (
    COUNT,
    FILE,
    INPUT,
    METHOD,
    MODEL,
    OUTPUT,
    POSITIVE,
    PROCESSING,
    WHOLE,
    Finite,
    verb,
)
from symid.environment import show_path
from symid.errors import Notice, UsageError

RIGID = ("overlap", "prior", "prior_deviation", "prior_weight", "start", "partial")
ELASTIC = ("tolerance", "thresholds", "knees", "window", "rate")
FRICTION = ("model", "smoothing", "seed")
"""Names of the options of each kind."""


@verb("identify")
@robot_argument(computes=True)
@click.argument("logs", nargs=-1, required=True, metavar="LOG...", type=FILE)
@INPUT.option(
    "--train",
    "Part of each log to fit, in seconds or per cent of its duration, such as 2.5:30 or 0:60%; give it once, "
    "or once for each log.",
    metavar="START:END",
    multiple=True,
)
@INPUT.option(
    "--test",
    "Part of each log to predict with the fit, such as 60%:, without overlap with --train; likewise.",
    metavar="START:END",
    multiple=True,
)
@PROCESSING.option("--cutoff", "Cut-off frequency of the low-pass filter.", POSITIVE, "HZ")
@PROCESSING.option("--decimate", "Keep one sample in N.", COUNT, "N")
@PROCESSING.option("--drop-first", "Number of samples cut off at the start.", WHOLE, "N")
@PROCESSING.option("--drop-last", "Number of samples cut off at the end.", WHOLE, "N")
@settings_options
@friction_option
@METHOD.option(
    "--rows",
    "Equations built from measurements; friction: a friction law for every joint that moves.  "
    "[default: torque]",
    click.Choice(("torque", "momentum", "filtered", "power", "energy", "friction")),
)
@METHOD.option(
    "--estimator",
    "Estimator of the parameters: ols, wls, filtered-instrumental, gls, huber, ridge, consistent, "
    "sequential, output-error or instrumental; with --rows friction varpro, root-finding, nlp, genetic, "
    "annealing or differential-evolution.  [default: chosen from the logs, varpro]",
    metavar="NAME",
)
@METHOD.option(
    "--partial",
    "Fit the identifiable parameters, even if they are less than three quarters of all.",
    is_flag=True,
)
@METHOD.option(
    "--overlap",
    "Momentum and energy rows: part of a window shared with the next one.  [default: 0]",
    Finite(min=0.0, max=0.95),
    "PART",
)
@METHOD.option(
    "--prior",
    "Ridge: an earlier estimate as prior, or robot for the robot file's values.  [default: robot]",
    metavar="ESTIMATE",
)
@METHOD.option(
    "--prior-deviation",
    "Ridge: standard deviation of the prior, in percent of the robot file's values, or as a factor "
    "on an estimate's deviations.  [default: 20 %; 1]",
    POSITIVE,
    "X",
)
@METHOD.option(
    "--prior-weight",
    "Ridge: 1 to use the prior's deviations as stated, 0 for no prior.  [default: cross-validated]",
    Finite(min=0.0),
    "W",
)
@METHOD.option(
    "--start",
    "Output error and instrumental: an estimate of the same model as initial values.  [default: a "
    "fit of the same logs]",
    metavar="ESTIMATE",
)
@PROCESSING.option(
    "--period",
    "Period of a repeated motion (s), one for all logs or one for each: average over the periods "
    "(--rows friction), or use their differences as noise (--estimator gls).",
    POSITIVE,
    "S",
    multiple=True,
)
@METHOD.option(
    "--method",
    "Elastic joints: the method; stiffness works for any robot.  [default: automatic]",
    click.Choice((*METHODS, "stiffness")),
)
@METHOD.option("--window", "Length of a momentum, filtered or energy row (s).", POSITIVE, "S")
@METHOD.option("--tolerance", "Elastic joints: relative change at which an iteration stops.", POSITIVE)
@METHOD.option(
    "--lambda rate", "Elastic joints: corner frequency of the first-order filter.", POSITIVE, "RAD/S"
)
@MODEL.option("--thresholds", "Elastic joints: number of stops of each joint's hysteresis.", WHOLE, "N")
@MODEL.option("--knees", "Elastic joints: number of knees on each side of a spring.", WHOLE, "N")
@MODEL.option(
    "--model",
    "With --rows friction: a law, such as stribeck+offset, or auto, chosen on held-out data; or laws of "
    "single joints, as elbow=stribeck,wrist=cubic, with auto for the others.  "
    "[default: auto]",
    metavar="NAME",
)
@MODEL.option(
    "--known",
    "With --rows friction or elastic joints: base parameters that are not identified, of an estimate or of a "
    "robot file with values.  [default: they are fitted too]",
    FILE,
    "FILE",
)
@MODEL.option(
    "--smoothing",
    "With --rows friction: speed over which dry friction changes its sign.  [default: 0]",
    Finite(min=0.0),
    "V",
)
@METHOD.option("--seed", "With --rows friction: random seed of a stochastic estimator.", WHOLE, "N")
@output_option("Write the result as JSON, for `validate`, `report` and `export`.")
@page_option
@accept_option
def identify_command(
    console: Console,
    *,
    robot: NamedRobot,
    logs: tuple[Path, ...],
    rows: str | None,
    estimator: str | None,
    method: str | None,
    known: Path | None,
    period: tuple[float, ...],
    train: tuple[str, ...],
    test: tuple[str, ...],
    settings: dict[str, str],
    output: Path | None,
    page: Path | None,
    force: bool,
    **further: Any,  # noqa: ANN401  as the options say
) -> Answer:
    """Identify base parameters and friction from logs; for elastic joints also springs.

    Columns, units, filter and decimation are those of the robot file; options override them.
    Parameters that are not identifiable are listed with the reason. With --rows friction a friction law
    and its parameters are identified for every joint that moves. The verdict comes first; exit code 1 if
    it is wrong.
    """
    rigid, elastic, law = ({name: further[name] for name in names} for names in (RIGID, ELASTIC, FRICTION))
    _check_mixed(rows, {"method": method, **elastic, **rigid}, law)
    shared = {key: value for key, value in further.items() if key not in (*RIGID, *ELASTIC, *FRICTION)}
    shared["settings"] = settings
    # Wrong settings are refused before anything else.
    model = robot.load(console, settings=shared["settings"])
    for written in (output, page):
        check_output(written, force=force, inputs=(model.path, *logs))
    shared["train"], tests = pair_parts(train, test, logs)
    before: Path | RobotModel | None = known
    if known is not None and known.suffix.lower() in (".urdf", ".xml", ".mjcf"):
        # Cut at the same links as ROBOT, where that is a URDF or MJCF.
        before = replace(robot, name=str(known)).load(console)
    if rows == "friction":
        laws = model.identify_friction(
            logs, estimator=estimator, period=period, known=before, **law, **shared
        )
        return _add_tests(answer_saved(laws, output, "result"), laws, tests, page)
    if method == "stiffness":
        others = {"rows": rows, "estimator": estimator, "known": known, "period": period, "test": test}
        rest = _list_given({**others, **rigid, **elastic})
        if rest:
            them = "them" if rest[1:] else "it"
            text = f"{', '.join(rest)} cannot be used with --method stiffness; leave {them} out"
            raise UsageError(Notice(code="usage.mixed-options", text=text))
        for key, name in (("cutoff", "filter_cutoff"), ("decimate", "decimation.factor")):
            value = shared.pop(key)
            if value is not None:
                shared["settings"][f"processing.{name}"] = value
        found = model.identify_stiffness(logs, **shared)
        return add_page(answer_saved(found, output, "result"), found, page)
    shared |= {"known": before}
    fit = model.identify(
        logs, rows=rows, estimator=estimator, method=method, period=period, **rigid, **elastic, **shared
    )
    return _add_tests(answer_saved(fit, output, "estimate"), fit, tests, page)


def _add_tests(answer: Answer, fit: Fit, tests: Sequence[tuple[Path, str]], page: Path | None) -> Answer:
    """Return the answer with what the fit predicts of parts of the logs, new notices, and the page."""
    if not tests:
        return add_page(answer, fit, page)
    found = [fit.validate(log, test=part) for log, part in tests]
    texts, errors = [entry.to_text() for entry in found], [error for entry in found for error in entry.errors]
    known = {(notice.code, notice.text) for notice in answer.warnings}
    notices = [notice for entry in found for notice in entry.notices]
    new = [notice for notice in notices if (notice.code, notice.text) not in known]
    answer = replace(
        answer,
        text="\n\n".join((answer.text, *texts)),
        result={**answer.result, "validations": [entry.to_dict() for entry in found]},
        warnings=(*answer.warnings, *new),
        errors=(*answer.errors, *errors),
        exit_code=answer.exit_code or (1 if errors else 0),
    )
    logs, parts = zip(*tests, strict=True)
    return add_page(answer, fit, page, validation=logs, test=parts)


def _list_given(options: Mapping[str, object]) -> list[str]:
    """Return the given options as on the command line."""
    names = [name for name, value in options.items() if value not in (None, (), False)]
    return [f"--{'lambda' if name == 'rate' else name.replace('_', '-')}" for name in names]


def _check_mixed(rows: str | None, others: Mapping[str, object], law: Mapping[str, object]) -> None:
    """Refuse options for friction laws with other rows, and other options with friction laws."""
    asked = rows == "friction"
    given = _list_given(others if asked else law)
    if given:
        kind = rows or "torque"
        what = "--rows friction" if asked else f"--rows {kind}; they belong to --rows friction"
        text = f"{', '.join(given)} cannot be used with {what}; leave {'them' if given[1:] else 'it'} out"
        raise UsageError(Notice(code="usage.mixed-options", text=text))


@verb("payload")
@robot_argument(computes=True)
@click.argument("loaded", nargs=-1, required=True, metavar="LOADED...", type=FILE)
@INPUT.option(
    "--empty",
    "Estimate or log without the payload; repeat the option for several logs.",
    FILE,
    "EMPTY",
    multiple=True,
    required=True,
)
@MODEL.option("--joint", "Joint of the link with the payload.  [default: the last joint]", metavar="NAME")
@MODEL.option(
    "--mass", "Known mass, for example from a balance; it reduces the other uncertainties.", POSITIVE, "KG"
)
@METHOD.option(
    "--rows",
    "Equations built from logs: torques, or momentum over windows.",
    click.Choice(("torque", "momentum")),
    default="torque",
)
@METHOD.option(
    "--estimator",
    "Least squares for logs: ordinary, or weighted by the noise of each joint.",
    click.Choice(("ols", "wls")),
    default="wls",
)
@OUTPUT.option(
    "--for controller",
    "Print the payload as this controller takes it: Universal Robots or Franka.",
    click.Choice(("ur", "franka")),
)
@OUTPUT.option(
    "--frame",
    "With --for: the flange, a link of the URDF, or x,y,z,roll,pitch,yaw in the link frame (m, rad).  "
    "[default: the link frame]",
    metavar="LINK",
)
@output_option("Write the result as JSON.")
@page_option
def payload_command(
    console: Console,
    *,
    robot: NamedRobot,
    loaded: tuple[Path, ...],
    empty: tuple[Path, ...],
    controller: str | None,
    frame: str | None,
    output: Path | None,
    page: Path | None,
    force: bool,
    **options: Any,  # noqa: ANN401  typed in `RobotModel.payload`
) -> Answer:
    """Identify mass, centre of mass and inertia of a payload: in LOADED, but not in EMPTY.

    LOADED and EMPTY are estimates, as `identify` writes them, or logs. The result is a physically
    consistent body; quantities that are not identifiable are listed with the reason.
    """
    if frame is not None and controller is None:
        text = "--frame is the flange of a controller; name that by --for, or leave --frame out"
        raise UsageError(Notice(code="usage.payload-frame", text=text))
    model = robot.load(console)
    for written in (output, page):
        check_output(written, force=force, inputs=(model.path, *loaded, *empty))
    found = model.payload(loaded, empty, **options)
    if controller is None:
        return add_page(answer_saved(found, output, "payload"), found, page)
    command = found.for_controller(controller, frame)
    lines = [] if output is None else [f"payload: {show_path(found.save(output))}"]
    answer = make_answer(
        found, command.text, *lines, notices=command.notices, file=output, controller=asdict(command)
    )
    return add_page(answer, found, page)


@verb("hysteresis")
@click.argument("file", metavar="FILE", type=FILE)
@INPUT.option(
    "--input", "Column of the input, such as a torsion; data[1] is the second column of data.", metavar="NAME"
)
@INPUT.option("--output", "Column of the output, such as a torque.", metavar="NAME")
@INPUT.option("--time", "Column of the time, s; without it no model depends on the speed.", metavar="NAME")
@INPUT.option("--validate", "Recording to predict, with the same columns.", FILE, "FILE")
@METHOD.option(
    "--model", "Model of the element.  [default: auto]", click.Choice(("auto", *HYSTERESIS_MODELS))
)
@METHOD.option("--passive", "Only elements from which no motion gets work.", is_flag=True)
@OUTPUT.option("-o --save", "Write the fit as JSON, which is a FILE for this verb, too.", FILE, "FILE")
@page_option
@OUTPUT.option("--code", "Write the element and its inverse as code.", FILE, "FOLDER")
@OUTPUT.option("--target", "Of --code.", click.Choice(("c", "python", "casadi")), default="c")
@OUTPUT.option("--precision", "Of --code in C.", click.Choice(("double", "float")), default="double")
@force_option
@accept_option
def hysteresis_command(
    console: Console,
    *,
    file: Path,
    validate: Path | None,
    model: str | None,
    passive: bool,
    save: Path | None,
    force: bool,
    page: Path | None,
    code: Path | None,
    target: Literal["c", "python", "casadi"],
    precision: str,
    **names: str | None,
) -> Answer:
    """Fit an element with hysteresis to its input and output, no robot needed.

    Prandtl-Ishlinskii and modified Prandtl-Ishlinskii, nonlinear stops with backlash, relays, Bouc-Wen, Dahl,
    LuGre and Maxwell-slip are tried; the one that predicts samples best that were left out is taken. Units
    are those of the file. FILE is a recording, or a fit that was written with -o.
    """
    saved = symid.hysteresis.is_saved(file)
    _check_columns(names, saved=saved, chosen=bool(model or passive), validate=validate)
    for written in (save, page):
        check_output(written, force=force, inputs=(file, *(() if validate is None else (validate,))))
    if saved:
        fit = symid.hysteresis.load(file)
    else:
        columns = _read_columns(file, names)
        console.progress("fitting elements")
        kind = model or "auto"
        fit = symid.hysteresis.fit(*columns, model=kind, passive=passive or None, source=file.name)
    tried = None if validate is None else fit.validate(*_read_columns(validate, names))
    lines = [] if tried is None else [f"{validate}:\n{tried.to_text()}"]
    lines += [] if save is None else [f"fit: {show_path(fit.save(save))}"]
    lines += [] if page is None else [f"page: {show_path(fit.report(page))}"]
    added: dict[str, Any] = {} if tried is None else {"validation": tried.to_dict()}
    if code is not None:
        made = fit.write(
            target, code, name=code.name, precision=precision, force=force, progress=console.progress
        )
        lines.append(made.to_text())
        added["code"] = made.to_dict()
    answer = make_answer(fit, *lines, **added)
    if tried is None:
        return answer
    notices, errors = (*answer.warnings, *tried.notices), (*answer.errors, *tried.errors)
    return replace(answer, warnings=notices, errors=errors, exit_code=1 if errors else 0)


def _check_columns(
    names: Mapping[str, str | None], *, saved: bool, chosen: bool, validate: Path | None
) -> None:
    """Raise a UsageError for columns that are missing, or options that a fit that is there cannot take."""
    mistakes = []
    needed = not saved or validate is not None
    if needed and not (names["input"] and names["output"]):
        mistakes.append("--input and --output: name the columns of the recording")
    if saved and chosen:
        mistakes.append("--model and --passive: this file is a fit; give the recording to fit another model")
    if mistakes:
        raise UsageError(*(Notice(code="usage.columns", text=text) for text in mistakes))


def _read_columns(file: Path, names: Mapping[str, str | None]) -> "symid.hysteresis.Columns":
    x, y = names["input"] or "", names["output"] or ""
    return symid.hysteresis.read_columns(file, x=x, y=y, t=names["time"])


@verb("fleet")
@click.argument("study", metavar="STUDY.toml", type=FILE)
@METHOD.option(
    "--executor",
    "Where jobs run: in this process, in processes, or on Dask's workers.  [default: processes, or dask with "
    "--cluster]",
    click.Choice(("serial", "processes", "dask")),
)
@METHOD.option("--workers", "Number of processes.  [default: one for each core]", COUNT, "N")
@METHOD.option("--cluster", "Address of Dask's scheduler; local starts one.", metavar="ADDRESS")
@METHOD.option("--time-limit", "Seconds that a job may take.", POSITIVE, "S")
@METHOD.option("--memory-limit", "Memory for the data of one job.", COUNT, "MB")
@METHOD.option("--again", "Run jobs again that crashed, or came to a limit.", is_flag=True)
@METHOD.option("--level", "Share of false alarms among the alarms.", Finite(0.0, 1.0), "X", default=0.05)
@METHOD.option(
    "--control",
    "How many comparisons are accounted for; holm: any false alarm is as rare as --level.",
    click.Choice(("benjamini-hochberg", "holm")),
    default="benjamini-hochberg",
)
@output_option(
    "Folder for results; what is there is not computed again.  [default: the name of STUDY]",
    OUTPUT.option("--table", "Write all values, .parquet or .csv.", FILE, "FILE"),
    OUTPUT.option("--page", "Write one HTML page.", FILE, "PAGE"),
    folder=True,
)
def fleet_command(
    console: Console,
    *,
    study: Path,
    executor: Literal["serial", "processes", "dask"] | None,
    cluster: str | None,
    time_limit: float | None,
    memory_limit: int | None,
    output: Path | None,
    table: Path | None,
    page: Path | None,
    force: bool,
    **options: Any,  # noqa: ANN401  typed in `symid.fleet.run`
) -> Answer:
    """Identify many robots or nights, and find the robots that changed.

    STUDY.toml names robot and logs. A fleet that was stopped goes on with the same call. Exit code 1 if a job
    crashed or came to a limit.
    """
    if cluster is not None and executor not in {None, "dask"}:
        text = f"--cluster needs the executor dask, got {executor}; leave one of both out"
        raise UsageError(Notice(code="usage.cluster", text=text))
    for written in (table, page):
        check_output(written, force=force, inputs=(study,))
    found = symid.fleet.run(
        study,
        output or study.with_suffix(""),
        executor=executor or ("processes" if cluster is None else "dask"),
        cluster=cluster or "local",
        seconds=time_limit,
        megabytes=memory_limit,
        progress=console.progress,
        **options,
    )
    lines = [] if table is None else [f"table: {show_path(found.save(table))}"]
    lines += [] if page is None else [f"page: {show_path(found.report(page))}"]
    return make_answer(found, *lines, file=table, page=page)
