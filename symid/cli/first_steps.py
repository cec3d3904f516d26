"""The first verbs: `symid doctor`, `symid demo`, `symid new`, `symid check`."""

import shlex
import sys
from dataclasses import replace
from pathlib import Path

import click

import symid
from symid.cli import options as cli
from symid.cli.call import Answer, Console, make_answer
from symid.environment import show_path
from symid.errors import Notice, UsageError


@cli.verb("doctor")
def doctor_command(console: Console) -> Answer:
    """Check the installation: Python, packages, compiler, cache and shared files.

    Exit code 1 if a required item is missing.
    """
    console.detail(f"python: {sys.executable}")
    return make_answer(symid.doctor())


@cli.verb("demo")
@cli.backend_option
@cli.METHOD("--seed", "Random seed.", cli.WHOLE, "N", default=0)
@cli.output_option("Folder for code, logs, estimate and report.  [default: demo]", folder=True)
def demo_command(console: Console, *, backend: str, seed: int, output: Path | None, force: bool) -> Answer:
    """Simulate an arm with elastic joints, identify dynamics and hysteresis, validate, report.

    Exit code 1 if the largest parameter error exceeds 2 %, the hysteresis error exceeds 3 %, or the
    identified model does not reduce the tracking errors of a rigid one.
    """
    folder = output or Path("demo")
    return make_answer(symid.demo(folder, seed=seed, backend=backend, force=force, progress=console.progress))


@cli.verb("new")
@click.argument("file", metavar="ROBOT.toml", type=cli.FILE)
@cli.INPUT("--from-urdf --from-mjcf urdf", "Convert a URDF or an MJCF model (MuJoCo).", cli.FILE, "FILE")
@cli.record_options(symid.DraftOptions, "base", "tip")
@cli.INPUT("--from-dh table", "Read a CSV table of Denavit-Hartenberg rows.", cli.FILE, "FILE")
@cli.record_options(symid.DraftOptions, "convention", "gravity")
@cli.INPUT("--from name", "Copy the file of an existing robot, or convert its URDF or MJCF.", metavar="ROBOT")
@cli.INPUT("--log", "Log of the robot: its columns and their units become the [log] table.", cli.FILE, "LOG")
@cli.INPUT(
    "--columns",
    "Columns of a quantity (time, position, torque, velocity), one for each joint; topic=NAME: the topic "
    "of a bag.  [default: recognised by name]",
    multiple=True,
    metavar="QUANTITY=NAME,...",
)
@cli.INPUT(
    "--units",
    "Unit of the columns, one for each or one for all, if the log states none or a wrong one.",
    multiple=True,
    metavar="QUANTITY=UNIT,...",
)
@cli.friction_option
@cli.record_options(symid.DraftOptions, "rotors", "gear", "torque_constant")
@cli.force_option
def new_command(console: Console, *, file: Path, force: bool, **options: cli.Given) -> Answer:
    """Write a commented robot file, to be completed by hand.

    Source is a URDF, an MJCF model, a table of Denavit-Hartenberg rows, or an existing robot. With
    --log the columns of a log are assigned; assumptions are printed, and written to the file.
    """
    if file.suffix.lower() != ".toml":
        text = f"{file}: a robot file needs the suffix .toml, such as {file.stem}.toml"
        raise UsageError(Notice(code="usage.suffix", text=text))
    log = options["log"]
    cli.check_output(file, force=force, inputs=(options["urdf"], options["table"], log))
    code, shape = "usage.quantity", "QUANTITY=..., such as"
    columns, units = options.pop("columns"), options.pop("units")
    draft = symid.new_robot(
        columns=cli.split_pairs(
            "--columns", columns, f"{shape} --columns position=NAME,NAME", code, once=True
        ),
        units=cli.split_pairs("--units", units, f"{shape} --units position=deg", code, once=True),
        options=cli.take_record(symid.DraftOptions, options),
        progress=console.progress,
        robot=options.pop("name"),
        **options,
    )
    cli.check_output(file, force=force, inputs=(draft.source,))
    draft.save(file)
    notices = [
        replace(entry, file=str(file)) if entry.code == "new.gravity" else entry for entry in draft.notices
    ]
    head = f"robot file: {show_path(file)} ({draft.summarise()})"
    shown = [str(block) for block in draft.blocks()[1:]]
    following = f"complete it, then symid check {shlex.quote(str(show_path(file)))}"
    if log is not None:
        following = f"symid check {shlex.join((str(show_path(file)), str(log)))}"
    text = "\n".join((head, *shown, f"next: {following}"))
    return Answer((text,), (text,), {"file": file, **draft.to_dict()}, tuple(notices))


_TOO_LITTLE = 4


@cli.verb("check")
@cli.robot_argument(computes=True)
@click.argument("logs", nargs=-1, metavar="[LOG]...", type=cli.FILE)
@cli.friction_option
@cli.settings_options
@cli.OUTPUT(
    "--resample",
    "Write an evenly sampled copy of the log (.npz or .csv) with all its columns.",
    cli.FILE,
    "FILE",
)
@cli.page_option
@cli.force_option
def check_command(
    console: Console,
    *,
    robot: cli.NamedRobot,
    logs: tuple[Path, ...],
    friction: str | None,
    settings: dict[str, str],
    resample: Path | None,
    page: Path | None,
    force: bool,
) -> Answer:
    """Check a robot file and logs, and list the identifiable parameters.

    All mistakes are listed at once, with file, line and column: exit code 3. Warnings concern time stamps,
    units, signs, exchanged joints, delays and insufficient excitation. Exit code 4 if less than three
    quarters of the parameters are identifiable, or more than three quarters would be uncertain.
    """
    model = robot.load(console, settings=settings, friction=friction)
    cli.check_output(resample, page, force=force, inputs=(model.path, *logs))
    found = model.check(*logs, resample=resample)
    return cli.add_page(make_answer(found, exit_code=_TOO_LITTLE), found, page)


@cli.verb("plot")
@cli.robot_argument()
@click.argument("file", required=False, metavar="[LOG|TRAJECTORY|FIT]", type=cli.FILE)
@cli.INPUT("--pose", "Coordinates at which the robot is drawn, rad or m.  [default: 0]", metavar="Q1,Q2,...")
@cli.output_option("Figures to write, .html or .svg.", required=True)
@cli.open_option
def plot_command(
    console: Console, *, robot: cli.NamedRobot, file: Path | None, pose: str | None, output: Path, force: bool
) -> Answer:
    """Draw the robot, a log, a trajectory or a fit as one self-contained file.

    The robot is a skeleton with the frames of its links; a log has its positions and torques, with what
    `symid check` found in it; a trajectory its motion beside the limits; a fit its parameters or curves.
    """
    model = robot.load(console)
    cli.check_output(output, force=force, inputs=(model.path, file))
    values = None if pose is None else cli.split_numbers("--pose", pose, "usage.pose")
    figures = model.plot(file, pose=values)
    written = figures.save(output)
    captions = [entry.caption for entry in figures.drawings]
    result = {"robot": model.name, "file": written, "figures": captions}
    said = ("\n".join((*captions, f"plot: {show_path(written)}")),)
    return Answer(said, said, result, model.description.notices)
