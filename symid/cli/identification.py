"""The verbs that identify: `symid identify`, `symid payload`, `symid hysteresis`, `symid fleet`."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Literal

import click

import symid
from symid import Fit, RobotModel
from symid.api import pair_parts
from symid.cli import options as cli
from symid.cli.call import Answer, Console, answer_saved, make_answer
from symid.environment import show_path
from symid.errors import Notice, UsageError
from symid.options import FleetOptions, HysteresisOptions, LogOptions, PayloadOptions, list_options


@cli.verb("identify")
@cli.robot_argument(computes=True)
@click.argument("logs", nargs=-1, required=True, metavar="LOG...", type=cli.FILE)
@cli.INPUT(
    "--train",
    "Part of each log to fit, in seconds or per cent of its duration, such as 2.5:30 or 0:60%; give it once, "
    "or once for each log.",
    metavar="START:END",
    multiple=True,
)
@cli.INPUT(
    "--test",
    "Part of each log to predict with the fit, such as 60%:, without overlap with --train; likewise.",
    metavar="START:END",
    multiple=True,
)
@cli.record_options(symid.IdentifyOptions)
@cli.settings_options
@cli.friction_option
@cli.record_options(symid.LawOptions, beside=symid.IdentifyOptions)
@cli.output_option("Write the result as JSON, for `validate`, `report` and `export`.")
@cli.page_option
@cli.accept_option
def identify_command(
    console: Console,
    *,
    robot: cli.NamedRobot,
    logs: tuple[Path, ...],
    rows: str | None,
    method: str | None,
    known: Path | None,
    train: tuple[str, ...],
    test: tuple[str, ...],
    settings: dict[str, str],
    output: Path | None,
    page: Path | None,
    force: bool,
    **further: cli.Given,
) -> Answer:
    """Identify base parameters and friction from logs; for elastic joints also springs.

    Columns, units, filter and decimation are those of the robot file; options override them.
    Parameters that are not identifiable are listed with the reason. With --rows friction a friction law
    and its parameters are identified for every joint that moves. The verdict comes first; exit code 1 if
    it is wrong.
    """
    # Options for friction laws do not go with other rows, nor other options with friction laws.
    asked, options = rows == "friction", {**further, "method": method}
    laws, others = (list_options(kind).keys() for kind in (symid.LawOptions, symid.IdentifyOptions))
    strange = others - laws if asked else laws - others
    given = _list_given({name: value for name, value in options.items() if name in strange})
    if given:
        what = "" if asked else f"--rows {rows or 'torque'}; they belong to "
        them = "them" if given[1:] else "it"
        text = f"{', '.join(given)} cannot be used with {what}--rows friction; leave {them} out"
        raise UsageError(Notice(code="usage.mixed-options", text=text))
    # Wrong settings are refused before anything else.
    model = robot.load(console, settings=settings)
    cli.check_output(output, page, force=force, inputs=(model.path, *logs))
    parts, tests = pair_parts(train, test, logs)
    before: Path | RobotModel | None = known
    if known is not None and known.suffix.lower() in (".urdf", ".xml", ".mjcf"):
        # Cut at the same links as ROBOT, where that is a URDF or MJCF.
        before = replace(robot, source=str(known)).load(console)
    if rows == "friction":
        law = cli.take_record(symid.LawOptions, {**further, "known": before})
        friction = model.identify_friction(logs, train=parts, settings=settings, options=law)
        return _add_tests(answer_saved(friction, output, "result"), friction, tests, page)
    if method == "stiffness":
        taken = ("cutoff", "decimate", "drop_first", "drop_last", "friction")
        cuts = {name: further.pop(name) for name in taken}
        rest = _list_given({"rows": rows, "known": known, "test": test, **further})
        if rest:
            them = "them" if rest[1:] else "it"
            text = f"{', '.join(rest)} cannot be used with --method stiffness; leave {them} out"
            raise UsageError(Notice(code="usage.mixed-options", text=text))
        keyed = {"filter_cutoff": cuts.pop("cutoff"), "decimation.factor": cuts.pop("decimate")}
        settings |= {f"processing.{name}": value for name, value in keyed.items() if value is not None}
        found = model.identify_stiffness(logs, train=parts, settings=settings, **cuts)
        return cli.add_page(answer_saved(found, output, "result"), found, page)
    if further["prior"] not in (None, "robot"):
        # The deviation is a factor on those of an estimate.
        further |= {"prior_percent": None, "prior_factor": further["prior_percent"]}
    order = cli.take_record(
        symid.IdentifyOptions, {**further, "rows": rows, "method": method, "known": before}
    )
    fit = model.identify(logs, train=parts, settings=settings, options=order)
    return _add_tests(answer_saved(fit, output, "estimate"), fit, tests, page)


def _add_tests(answer: Answer, fit: Fit, tests: Sequence[tuple[Path, str]], page: Path | None) -> Answer:
    """Return the answer with what the fit predicts of parts of the logs, new notices, and the page."""
    if not tests:
        return cli.add_page(answer, fit, page)
    found = [entry for log, part in tests for entry in cli.try_log(fit, log, test=part)]
    answer = cli.add_trials(answer, found)
    logs, parts = zip(*tests, strict=True)
    return cli.add_page(answer, fit, page, validation=logs, test=parts)


_KNOWN = {**list_options(symid.LawOptions), **list_options(symid.IdentifyOptions)}


def _list_given(options: Mapping[str, object]) -> list[str]:
    """Return the given options as on the command line, in the order of their records."""
    given = {name for name, value in options.items() if value not in (None, (), False)}
    return [
        _KNOWN[name].name_flag(name) if name in _KNOWN else f"--{name}" for name in options if name in given
    ]


@cli.verb("payload")
@cli.robot_argument(computes=True)
@click.argument("loaded", nargs=-1, required=True, metavar="LOADED...", type=cli.FILE)
@cli.INPUT(
    "--empty",
    "Estimate or log without the payload; repeat the option for several logs.",
    cli.FILE,
    "EMPTY",
    multiple=True,
    required=True,
)
@cli.record_options(LogOptions)
@cli.record_options(PayloadOptions)
@cli.OUTPUT(
    "--for controller",
    "Print the payload as this controller takes it: Universal Robots or Franka.",
    click.Choice(("ur", "franka")),
)
@cli.OUTPUT(
    "--frame",
    "With --for: the flange, a link of the URDF, or x,y,z,roll,pitch,yaw in the link frame (m, rad).  "
    "[default: the link frame]",
    metavar="LINK",
)
@cli.output_option("Write the result as JSON.")
@cli.page_option
def payload_command(
    console: Console,
    *,
    robot: cli.NamedRobot,
    loaded: tuple[Path, ...],
    empty: tuple[Path, ...],
    controller: str | None,
    frame: str | None,
    sample_rate: float | None,
    output: Path | None,
    page: Path | None,
    force: bool,
    **options: cli.Given,
) -> Answer:
    """Identify mass, centre of mass and inertia of a payload: in LOADED, but not in EMPTY.

    LOADED and EMPTY are estimates, as `identify` writes them, or logs. The result is a physically
    consistent body; quantities that are not identifiable are listed with the reason.
    """
    if frame is not None and controller is None:
        text = "--frame is the flange of a controller; name that by --for, or leave --frame out"
        raise UsageError(Notice(code="usage.payload-frame", text=text))
    settings = None if sample_rate is None else {"log.sample_rate": repr(sample_rate)}
    model = robot.load(console, settings=settings)
    cli.check_output(output, page, force=force, inputs=(model.path, *loaded, *empty))
    found = model.payload(loaded, empty, **options)
    if controller is None:
        return cli.add_page(answer_saved(found, output, "payload"), found, page)
    command = found.for_controller(controller, frame)
    added = {"notices": command.notices, "controller": asdict(command)}
    return cli.add_page(answer_saved(found, output, "payload", command.text, **added), found, page)


@cli.verb("hysteresis")
@click.argument("file", metavar="FILE", type=cli.FILE)
@cli.INPUT(
    "--input", "Column of the input, such as a torsion; data[1] is the second column of data.", metavar="NAME"
)
@cli.INPUT("--output", "Column of the output, such as a torque.", metavar="NAME")
@cli.INPUT("--time", "Column of the time, s; without it no model depends on the speed.", metavar="NAME")
@cli.INPUT("--units", "Units of input and output, such as deg,N m.  [default: those of FILE]", metavar="X,Y")
@cli.INPUT("--train", "Part of FILE to fit, in seconds or per cent, such as 0:60%.", metavar="START:END")
@cli.INPUT(
    "--test", "Part of FILE to predict, such as 60%:, without overlap with --train.", metavar="START:END"
)
@cli.INPUT("--validate", "Recording to predict, with the same columns.", cli.FILE, "FILE")
@cli.record_options(HysteresisOptions)
@cli.OUTPUT("-o --save", "Write the fit as JSON, which is a FILE for this verb, too.", cli.FILE, "FILE")
@cli.page_option
@cli.OUTPUT("--into", "Robot file that gets the element as the spring of --joint.", cli.FILE, "ROBOT.toml")
@cli.OUTPUT("--joint", "Joint of --into.", metavar="NAME")
@cli.OUTPUT("--code", "Write the element and its inverse as code.", cli.FILE, "FOLDER")
@cli.OUTPUT("--target", "Of --code.", click.Choice(("c", "python", "casadi")), default="c")
@cli.OUTPUT("--precision", "Of --code in C.", click.Choice(("double", "float")), default="double")
@cli.force_option
@cli.accept_option
def hysteresis_command(
    console: Console,
    *,
    file: Path,
    validate: Path | None,
    units: str | None,
    train: str | None,
    test: str | None,
    model: str | None,
    passive: bool,
    save: Path | None,
    force: bool,
    page: Path | None,
    into: Path | None,
    joint: str | None,
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
    mistakes = []
    if saved and (model or passive or train or test):
        text = "--model, --passive, --train and --test: this file is a fit; give the recording"
        mistakes.append(f"{text} to fit another model")
    if (into is None) is not (joint is None):
        mistakes.append("--into and --joint: give both, the robot file and the joint that gets the element")
    own = tuple(part.strip() for part in units.split(",")) if units else None
    if own is not None and len(own) != 2:
        mistakes.append(f"--units {units!r}: state two, of input and output, such as deg,N m")
    if mistakes:
        raise UsageError(*(Notice(code="usage.columns", text=text) for text in mistakes))
    if test and validate is None:
        # A unit that one states is that of both.
        parts, pairs = pair_parts([train] if train else [], [test], [file])
        train, test = parts[0] if parts else None, pairs[0][1]
    cli.check_output(save, page, force=force, inputs=(file, validate, into))
    pair = None if own is None else (own[0], own[1])
    tried, title, notices, known = None, validate, tuple[Notice, ...](), ""
    if saved:
        fit = symid.hysteresis.load(file)
        known = f"{file}: {fit.summarise()}" if validate else ""
    else:
        columns = _read_columns(file, names)
        notices = columns.notices
        console.progress("fitting elements")
        fit = symid.hysteresis.fit(
            *columns,
            model=model or "auto",
            passive=passive or None,
            train=train,
            names=columns.names,
            units=pair or columns.units,
            source=file.name,
        )
        if test is not None and validate is None:
            tried, title = fit.validate(*columns, test=test), file
    if validate is not None:
        other = _read_columns(validate, names)
        tried, notices = fit.validate(*other, test=test), (*notices, *other.notices)
    lines = [] if tried is None else [f"{title}:\n{tried.to_text()}"]
    lines += [] if save is None else [f"fit: {show_path(fit.save(save))}"]
    lines += [] if page is None else [f"page: {show_path(fit.report(page))}"]
    added: dict[str, Any] = {} if tried is None else {"validation": tried.to_dict()}
    if into is not None and joint is not None:
        lines.append(f"robot: {show_path(fit.insert(into, joint, units=pair))}, spring of {joint}")
    if code is not None:
        made = fit.write(
            target, code, name=code.name, precision=precision, force=force, progress=console.progress
        )
        lines.append(made.to_text())
        added["code"] = made.to_dict()
    answer = make_answer(fit, *lines, notices=notices, **added).add([] if tried is None else [tried])
    # What a saved fit says was printed when it was made.
    said = (known, *lines)
    return replace(answer, blocks=said, brief=said) if known else answer


def _read_columns(file: Path, names: Mapping[str, str | None]) -> "symid.hysteresis.Columns":
    return symid.hysteresis.read_columns(file, x=names["input"], y=names["output"], t=names["time"])


@cli.verb("fleet")
@click.argument("study", metavar="STUDY.toml", type=cli.FILE)
@cli.record_options(FleetOptions)
@cli.output_option(
    "Folder for results; what is there is not computed again.  [default: the name of STUDY]",
    cli.OUTPUT("--table", "Write all values, .parquet or .csv.", cli.FILE, "FILE"),
    cli.OUTPUT("--page", "Write one HTML page.", cli.FILE, "PAGE"),
    folder=True,
)
def fleet_command(
    console: Console,
    *,
    study: Path,
    output: Path | None,
    table: Path | None,
    page: Path | None,
    force: bool,
    **options: cli.Given,
) -> Answer:
    """Identify many robots or nights, and find the robots that changed.

    STUDY.toml names robot and logs. A fleet that was stopped goes on with the same call. Exit code 1 if a job
    crashed or came to a limit.
    """
    executor, cluster = options.pop("executor"), options.pop("cluster")
    if cluster is not None and executor not in {None, "dask"}:
        text = f"--cluster needs the executor dask, got {executor}; leave one of both out"
        raise UsageError(Notice(code="usage.cluster", text=text))
    cli.check_output(table, page, force=force, inputs=(study,))
    found = symid.fleet.run(
        study,
        output or study.with_suffix(""),
        executor=executor or ("processes" if cluster is None else "dask"),
        cluster=cluster or "local",
        progress=console.progress,
        **options,
    )
    lines = [] if table is None else [f"table: {show_path(found.save(table))}"]
    lines += [] if page is None else [f"page: {show_path(found.report(page))}"]
    return make_answer(found, *lines, file=table, page=page)
