"""`symid study NAME`: comparisons of methods on simulated robots."""

from pathlib import Path
from typing import Any

import click

import symid
from symid.cli.call import Answer, Console, answer_saved, make_answer
from symid.cli.options import (
    NamedRobot,
    check_output,
    output_option,
    robot_argument,
    robot_option,
    settings_options,
)
from symid.cli.verbs import COUNT, FILE, METHOD, OUTPUT, POSITIVE, WHOLE, Decorator, Group, Verb, add_options
from symid.errors import Notice, UsageError

_FLAGS = frozenset({"--json", "--quiet", "--verbose"})
_ELASTIC = "Robot with elastic joints and all values stated."


class _Studies(Verb, click.Group):
    """A verb with several parts; common flags may stand before or after a part."""

    command_class = Verb
    flags = Group("")

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options, then the parts."""
        super().format_options(ctx, formatter)
        self.format_commands(ctx, formatter)

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Pass the common flags to the part."""
        count = next((k for k, text in enumerate(args) if not _is_flag(text)), len(args))
        flags, rest = args[:count], args[count:]
        if flags and not rest:
            ctx.fail(f"Missing part: one of {', '.join(self.commands)}.")
        return super().parse_args(ctx, [*rest[:1], *flags, *rest[1:]])


def _is_flag(text: str) -> bool:
    return text in _FLAGS or (text[:1] == "-" and len(text) > 1 and set(text[1:]) <= {"q", "v"})


def _runs_options(seeds: int, seed: int = 1, *, jobs: bool = True) -> Decorator:
    """Return the options for the runs of a study."""
    text = "Number of noise draws, starting with --seed."
    cores = "Number of processes.  [default: one for each core]"
    options = (
        METHOD.option("--seeds", text, COUNT, "N", default=seeds),
        METHOD.option("--seed", "First random seed.", WHOLE, "N", default=seed),
        METHOD.option("--jobs", cores, COUNT, "N"),
    )
    return add_options(*options if jobs else options[:2])


_times_option = OUTPUT.option(
    "--times", "Show how long each method took, which differs from run to run.", is_flag=True
)


@click.group("study", cls=_Studies, subcommand_metavar="NAME [ARGS]...")
def study_command(**_: object) -> None:
    """Compare methods on simulated robots with known parameters.

    Each study repeats identification with many noise draws, and prints tables.
    """


@study_command.command("elastic")
@robot_option(_ELASTIC, "two_link_elastic")
@_runs_options(100)
@_times_option
def _elastic(console: Console, *, robot: NamedRobot, times: bool, **runs: Any) -> Answer:  # noqa: ANN401
    """Errors of every method for elastic joints on four sets of logs, clean and noisy."""
    return make_answer(robot.load(console).study_elastic(timed=times, **runs))


@study_command.command("tracking")
@robot_option(_ELASTIC, "two_link_elastic")
@_runs_options(20)
def _tracking(console: Console, *, robot: NamedRobot, seeds: int, seed: int, jobs: int | None) -> Answer:
    """Tracking errors of links with feed-forward of the identified model, another one, or none."""
    return make_answer(robot.load(console).study_tracking(seeds=seeds, seed=seed, jobs=jobs))


@study_command.command("six-joints")
@robot_option(_ELASTIC, "puma560_elastic")
@_runs_options(1, jobs=False)
def _six_joints(console: Console, *, robot: NamedRobot, seeds: int, seed: int) -> Answer:
    """Dynamics of an elastic six-axis arm, validated on a held-out motion."""
    return make_answer(robot.load(console).study_six_joints(seeds=seeds, seed=seed))


@study_command.command("foreign")
@METHOD.option("--arm", "2r, planar, or 3r, spatial.", click.Choice(("2r", "3r")), default="2r")
@METHOD.option("--truths", "Hidden models, separated by commas.  [default: all]", metavar="NAME,...")
@METHOD.option("--sizes", "Factors of what is foreign.", metavar="X,...", default="1")
@METHOD.option("--share", "Part of the full length of the logs.", POSITIVE, "X", default=1.0)
@_runs_options(3)
def _foreign(console: Console, *, truths: str | None, sizes: str, **runs: Any) -> Answer:  # noqa: ANN401
    """Errors of every method for elastic joints on hidden models that are not those of symid."""
    try:
        factors = tuple(float(part) for part in sizes.split(","))
    except ValueError as error:
        text = f"--sizes {sizes}: expected numbers with commas between them"
        raise UsageError(Notice(code="usage.foreign-study", text=text)) from error
    names = tuple(truths.split(",")) if truths else ()
    return make_answer(symid.study_foreign(truths=names, sizes=factors, progress=console.progress, **runs))


@study_command.command("friction-tables")
@_runs_options(1000, 0)
@_times_option
@output_option("Page with all tables and figures to write, .html.")
def _friction_tables(
    console: Console,
    *,
    times: bool,
    output: Path | None,
    force: bool,
    **runs: Any,  # noqa: ANN401
) -> Answer:
    """Tables of Zhang, Hu and Zou (2021) on joint friction, with our results beside theirs."""
    # Refuse an output that cannot be written before minutes of work.
    check_output(output, force=force)
    found = symid.study_friction_tables(timed=times, progress=console.progress, **runs)
    return answer_saved(found, output, "report")


@study_command.command("precision")
@robot_argument(computes=True)
@_runs_options(400)
def _precision(console: Console, *, robot: NamedRobot, seeds: int, seed: int, jobs: int | None) -> Answer:
    """Errors of identification against the Cramer-Rao bound, on five random excitations."""
    return make_answer(robot.load(console).study_precision(seeds=seeds, seed=seed, jobs=jobs))


@study_command.command("cutoff")
@robot_argument(computes=True)
@click.argument("log", type=FILE)
@settings_options
def _cutoff(console: Console, *, robot: NamedRobot, log: Path, settings: dict[str, str]) -> Answer:
    """Prediction error of a fit for several cut-offs of the position filter."""
    return make_answer(robot.load(console, settings=settings).study_cutoff(log))
