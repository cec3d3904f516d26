"""The verbs on a robot's dynamics and on simulated experiments.

`symid derive`, `symid base`, `symid generate`; `symid excite`, `symid simulate`, `symid study NAME`.
"""

import re
from pathlib import Path

import click

import symid
from symid.api import BaseForm
from symid.cli import options as cli
from symid.cli.call import Answer, Console, answer_saved, make_answer
from symid.environment import check_suffix, show_path
from symid.errors import Notice, UsageError
from symid.options import GenerateOptions


@cli.verb("derive")
@cli.robot_argument()
@cli.OUTPUT("--latex", "Print formulas in LaTeX.", is_flag=True)
@cli.OUTPUT("--html", "Write the lesson as one page, with the arm to move.", cli.FILE, "FILE")
@cli.OUTPUT("--tex", "Write the lesson as a document for pdflatex.", cli.FILE, "FILE")
@cli.OUTPUT("--ipynb", "Write the lesson as a notebook with SymPy objects, executed.", cli.FILE, "FILE")
@cli.MODEL(
    "--notation",
    "Letters of the page: those of symid or of a textbook.",
    click.Choice(("symid", "siciliano", "craig", "khalil")),
    default="symid",
)
@cli.MODEL(
    "--parameters",
    "Parameters of the page: base, the file's symbols, or masses, centres of mass and inertias (bodies).",
    click.Choice(("base", "symbols", "bodies")),
)
@cli.MODEL("--angle", "Letter of angles in the page.", click.Choice(("q", "theta")))
@cli.MODEL("--long-sines", "Write cos(q1 + q2) in place of c12 in the page.", is_flag=True)
@cli.OUTPUT("--lang", "Language of the page, or of the marks.", click.Choice(("en", "de")), default="en")
@cli.OUTPUT("--title", "Title of the page.  [default: robot]", default="", show_default=False, metavar="TEXT")
@cli.OUTPUT("--author", "Author, below the title.", default="", show_default=False, metavar="TEXT")
@cli.OUTPUT(
    "--exercises",
    "Exercises at the end of the page or document, with a file of answers.",
    click.IntRange(0, 50),
    default=0,
)
@cli.OUTPUT("--seed", "Of the exercises.", click.IntRange(0), default=0)
@cli.OUTPUT("--only-exercises", "Leave the derivation out of the page or document.", is_flag=True)
@cli.INPUT("--log", "Log whose motion the page offers beside drawn ones.", cli.FILE, "FILE")
@cli.INPUT("--check", "Mark the answers in a sheet of exercises.", cli.FILE, "FILE")
@cli.force_option
def derive_command(
    console: Console, *, robot: cli.NamedRobot, latex: bool, force: bool, **options: cli.Given
) -> Answer:
    """Derive the dynamics step by step, from the frames to the torques, with operation counts.

    With --html the derivation is a page for a lecture: M, C and g as formulas with their numbers, checks,
    the arm to move; one file that needs no network.

    Each step has a sentence, its formulas and a check. Then follow the operations of the generated
    functions; --json lists those of all routes, not only the chosen ones.

    With --check, answers that were typed into the sheet of --exercises are marked; any form of the right
    formula is right. The exit code is 1 if one is not right.
    """
    files: dict[str, Path | None] = {name: options.pop(name) for name in ("html", "tex", "ipynb", "check")}
    given = {f"--{name}": path for name, path in files.items() if path is not None}
    if len(given) > 1:
        text = f"{' and '.join(given)}: one at a time"
        raise UsageError(Notice(code="usage.lesson-files", text=text))
    check = given.pop("--check", None)
    if given:
        (page,) = given.values()
        model = robot.load(console)
        cli.check_output(page, force=force, inputs=(model.path, options["log"]))
        return make_answer(model.write_lesson(page, force=force, **options))
    lang = None if options["lang"] == "en" else options["lang"]
    options |= {"lang": None} if check else {}
    unused = [name for name, value in options.items() if value not in (None, False, "symid", "en", 0, "")]
    if unused:
        what = "the sheet says how it was drawn" if check else "only for a page; add --html FILE"
        text = f"--{unused[0].replace('_', '-')}: {what}"
        raise UsageError(Notice(code="usage.lesson-option", text=text))
    if check is not None:
        return make_answer(robot.load(console).check_answers(check, lang=lang))
    return make_answer(robot.load(console).derivation(latex=latex))


@cli.verb("base")
@cli.robot_argument()
@cli.friction_option
@cli.MODEL(
    "--of form",
    "Base parameters of all torques, the energies, the momentum, or torques at rest (gravity).",
    click.Choice(("torque", "energy", "momentum", "gravity")),
    default="torque",
)
def base_command(console: Console, *, robot: cli.NamedRobot, friction: str | None, form: BaseForm) -> Answer:
    """List the base parameters, the smallest set that describes all motions and torques.

    Each has its grouping and the reason for it; then follow the eliminated parameters. --of selects
    those of the energies, the momentum or a static test.
    """
    model = robot.load(console, friction=friction)
    console.progress(f"deriving the base parameters of {model.name}")
    return make_answer(model.derive_base(form))


@cli.verb("generate")
@cli.robot_argument()
@cli.record_options(GenerateOptions)
@cli.friction_option
@cli.output_option("Folder of the sources.", required=True, folder=True)
def generate_command(
    console: Console, *, robot: cli.NamedRobot, friction: str | None, output: Path, **options: cli.Given
) -> Answer:
    """Write the robot's functions as a C library, as a Python or JavaScript module, or for CasADi.

    The folder does not need symid. Its self-test runs after writing, for C if there is a compiler. A
    folder that is up to date is not changed.
    """
    target, names = options.pop("target"), options.pop("functions") or None
    model = robot.load(console, friction=friction)
    return make_answer(model.write(target, output, functions=names, **options))


@cli.verb("excite")
@cli.robot_argument()
@cli.record_options(symid.ExciteOptions)
@cli.OUTPUT("--rate", "Sample rate of the file.", cli.POSITIVE, "HZ", default=1000.0)
@cli.OUTPUT("--periods", "Number of periods in the file.", cli.COUNT, "N", default=1)
@cli.friction_option
@cli.output_option("Trajectory to write, .csv.")
@cli.page_option
def excite_command(
    console: Console,
    *,
    robot: cli.NamedRobot,
    friction: str | None,
    output: Path | None,
    page: Path | None,
    force: bool,
    rate: float,
    periods: int,
    **search: cli.Given,
) -> Answer:
    """Compute an optimal trajectory for identification.

    It is a finite Fourier series for every joint, within all limits of the robot file at all times;
    `symid simulate --trajectory FILE` follows it.
    """
    model = robot.load(console, friction=friction)
    if output is not None:
        check_suffix(output, "a trajectory", (".csv",))
    workspace = search["workspace"]
    cli.check_output(output, page, force=force, inputs=(model.path, workspace))
    found = model.excite(options=cli.take_record(symid.ExciteOptions, search, len(model.joints)))
    lines, samples = [], 0
    if output is not None:
        found.save(output, rate=rate, periods=periods)
        samples = found.count_samples(rate=rate, periods=periods)
        lines.append(f"{show_path(output)}: {samples} samples of t, q, dq, ddq")
    return cli.add_page(make_answer(found, *lines, file=output, samples=samples, rate=rate), found, page)


@cli.verb("simulate")
@cli.robot_argument(computes=True)
@cli.METHOD(
    "--trajectory",
    "fourier (a random Fourier series), ta or tb (published), tc (for validation), or a file (.csv) "
    "of symid excite.",
    metavar="NAME|FILE",
    default="fourier",
)
@cli.record_options(symid.SimulateOptions)
@cli.friction_option
@cli.output_option("Log to write, .npz or .csv.", required=True)
def simulate_command(
    console: Console,
    *,
    robot: cli.NamedRobot,
    trajectory: str,
    friction: str | None,
    output: Path,
    force: bool,
    **settings: cli.Given,
) -> Answer:
    """Simulate the robot under PD control along a trajectory and write the measured log.

    The robot file must state masses and friction. The log of an elastic robot holds link positions q,
    motor positions theta and motor torques tau.
    """
    model = robot.load(console, friction=friction)
    check_suffix(output, "a log", (".npz", ".csv"))
    cli.check_output(output, force=force, inputs=(model.path, Path(trajectory)))
    options = cli.take_record(symid.SimulateOptions, settings, len(model.joints))
    run = model.simulate(trajectory, options=options)
    written = run.save(output)
    result = {"robot": model.name, "file": written, **run.to_dict()}
    said = (f"{show_path(written)}: {run.summarise()}",)
    return Answer(said, said, result, run.notices)


_FLAGS = frozenset({"--json", "--quiet", "--verbose"})
_ELASTIC = "Robot with elastic joints and all values stated."


class _Studies(cli.Verb, click.Group):
    """A verb with several parts; common flags may stand before or after a part."""

    command_class = cli.Verb
    flags = ""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options, then the parts."""
        super().format_options(ctx, formatter)
        self.format_commands(ctx, formatter)

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Refuse common flags without a part."""
        if args and all(text in _FLAGS or re.fullmatch("-[qv]+", text) for text in args):
            ctx.fail(f"Missing part: one of {', '.join(self.commands)}.")
        return super().parse_args(ctx, args)


def _runs_options(seeds: int, seed: int = 1, *, jobs: bool = True) -> cli.Decorator:
    """Return the options for the runs of a study."""
    text = "Number of noise draws, starting with --seed."
    cores = "Number of processes.  [default: one for each core]"
    options = (
        cli.METHOD("--seeds", text, cli.COUNT, "N", default=seeds),
        cli.METHOD("--seed", "First random seed.", cli.WHOLE, "N", default=seed),
        cli.METHOD("--jobs", cores, cli.COUNT, "N"),
    )
    return cli.add_options(*options if jobs else options[:2])


_times_option = cli.OUTPUT(
    "--times", "Show how long each method took, which differs from run to run.", is_flag=True
)


@click.group("study", cls=_Studies, subcommand_metavar="NAME [ARGS]...")
def study_command(**_: object) -> None:
    """Compare methods on simulated robots with known parameters.

    Each study repeats identification with many noise draws, and prints tables.
    """


@study_command.command("elastic")
@cli.robot_option(_ELASTIC, "two_link_elastic")
@_runs_options(100)
@_times_option
def _elastic(console: Console, *, robot: cli.NamedRobot, times: bool, **runs: cli.Given) -> Answer:
    """Errors of every method for elastic joints on four sets of logs, clean and noisy."""
    return make_answer(robot.load(console).study_elastic(timed=times, **runs))


@study_command.command("tracking")
@cli.robot_option(_ELASTIC, "two_link_elastic")
@_runs_options(20)
def _tracking(console: Console, *, robot: cli.NamedRobot, **runs: cli.Given) -> Answer:
    """Tracking errors of links with feed-forward of the identified model, another one, or none."""
    return make_answer(robot.load(console).study_tracking(**runs))


@study_command.command("six-joints")
@cli.robot_option(_ELASTIC, "puma560_elastic")
@_runs_options(1, jobs=False)
def _six_joints(console: Console, *, robot: cli.NamedRobot, seeds: int, seed: int) -> Answer:
    """Dynamics of an elastic six-axis arm, validated on a held-out motion."""
    return make_answer(robot.load(console).study_six_joints(seeds=seeds, seed=seed))


@study_command.command("foreign")
@cli.METHOD("--arm", "2r, planar, or 3r, spatial.", click.Choice(("2r", "3r")), default="2r")
@cli.METHOD("--truths", "Hidden models, separated by commas.  [default: all]", metavar="NAME,...")
@cli.METHOD("--sizes", "Factors of what is foreign.", metavar="X,...", default="1")
@cli.METHOD("--share", "Part of the full length of the logs.", cli.POSITIVE, "X", default=1.0)
@_runs_options(3)
def _foreign(console: Console, *, truths: str | None, sizes: str, **runs: cli.Given) -> Answer:
    """Errors of every method for elastic joints on hidden models that are not those of symid."""
    factors = cli.split_numbers("--sizes", sizes, "usage.foreign-study")
    names = tuple(truths.split(",")) if truths else ()
    return make_answer(symid.study_foreign(truths=names, sizes=factors, progress=console.progress, **runs))


@study_command.command("friction-tables")
@_runs_options(1000, 0)
@_times_option
@cli.output_option("Page with all tables and figures to write, .html.")
def _friction_tables(
    console: Console, *, times: bool, output: Path | None, force: bool, **runs: cli.Given
) -> Answer:
    """Tables of Zhang, Hu and Zou (2021) on joint friction, with our results beside theirs."""
    # Refuse an output that cannot be written before minutes of work.
    cli.check_output(output, force=force)
    found = symid.study_friction_tables(timed=times, progress=console.progress, **runs)
    return answer_saved(found, output, "report")


@study_command.command("precision")
@cli.robot_argument(computes=True)
@_runs_options(400)
def _precision(console: Console, *, robot: cli.NamedRobot, seeds: int, seed: int, jobs: int | None) -> Answer:
    """Errors of identification against the Cramer-Rao bound, on five random excitations."""
    return make_answer(robot.load(console).study_precision(seeds=seeds, seed=seed, jobs=jobs))


@study_command.command("cutoff")
@cli.robot_argument(computes=True)
@click.argument("log", type=cli.FILE)
@cli.settings_options
def _cutoff(console: Console, *, robot: cli.NamedRobot, log: Path, settings: dict[str, str]) -> Answer:
    """Prediction error of a fit for several cut-offs of the position filter."""
    return make_answer(robot.load(console, settings=settings).study_cutoff(log))
