"""`symid study NAME`: many identifications of a simulated robot with a known truth, in one table."""

from pathlib import Path

import click

import symid
from symid.cli.call import Answer, Console, make_answer
from symid.cli.options import (
    COUNT,
    DEFAULT_SEED,
    FILE,
    METHOD,
    OUTPUT,
    WHOLE,
    Decorator,
    NamedRobot,
    Verb,
    add_options,
    build_flags,
    check_output,
    force_option,
    option,
    output_option,
    robot_argument,
    robot_option,
    verb,
)
from symid.environment import show_path

_FLAGS = frozenset({"--json", "--quiet", "--verbose"})
_ELASTIC = "Robot with elastic joints and all values stated."


class _Studies(Verb, click.Group):
    """A verb of several parts, whose common flags may stand before a part as well as behind it."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options, then the parts."""
        super().format_options(ctx, formatter)
        self.format_commands(ctx, formatter)

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Hand the common flags to the part, which has the console."""
        count = next((k for k, text in enumerate(args) if not _is_flag(text)), len(args))
        flags, rest = args[:count], args[count:]
        if flags and not rest:
            ctx.fail(f"Missing part: one of {', '.join(self.commands)}.")
        return super().parse_args(ctx, [*rest[:1], *flags, *rest[1:]])


def _is_flag(text: str) -> bool:
    return text in _FLAGS or (text[:1] == "-" and len(text) > 1 and set(text[1:]) <= {"q", "v"})


def _runs_options(seeds: int, seed: int = DEFAULT_SEED, *, jobs: bool = True) -> Decorator:
    """Return the options of a study's runs, with their defaults."""
    options = (
        option(
            "--seeds",
            METHOD,
            "Number of draws of the noise, from --seed on.",
            type=COUNT,
            default=seeds,
            metavar="N",
        ),
        option("--seed", METHOD, "First random seed.", type=WHOLE, default=seed, metavar="N"),
    )
    if not jobs:
        return add_options(*options)
    return add_options(
        *options,
        option(
            "--jobs",
            METHOD,
            "Number of processes.  [default: one a core]",
            type=COUNT,
            metavar="N",
        ),
    )


_times_option = option(
    "--times", OUTPUT, "Show how long each method took, which differs from run to run.", is_flag=True
)


@click.group("study", cls=_Studies, subcommand_metavar="NAME [ARGS]...")
@build_flags("", exposed=False)
def study_command() -> None:
    """Compare methods on simulated robots whose truth is known.

    Each study draws noise many times and shows what comes out in one table.
    """


@study_command.command("elastic", cls=Verb)
@robot_option(_ELASTIC, "two_link_elastic")
@_runs_options(100)
@_times_option
@verb
def _elastic(
    console: Console, *, robot: NamedRobot, seeds: int, seed: int, jobs: int | None, times: bool
) -> Answer:
    """Errors of every method for elastic joints on four sets of logs, clean and noisy."""
    model = robot.load(console)
    return make_answer(model.study_elastic(seeds=seeds, seed=seed, jobs=jobs, timed=times))


@study_command.command("tracking", cls=Verb)
@robot_option(_ELASTIC, "two_link_elastic")
@_runs_options(20)
@verb
def _tracking(console: Console, *, robot: NamedRobot, seeds: int, seed: int, jobs: int | None) -> Answer:
    """How well links follow when the controller knows the identified model, another one, or none."""
    return make_answer(robot.load(console).study_tracking(seeds=seeds, seed=seed, jobs=jobs))


@study_command.command("six-joints", cls=Verb)
@robot_option(_ELASTIC, "puma560_elastic")
@_runs_options(1, jobs=False)
@verb
def _six_joints(console: Console, *, robot: NamedRobot, seeds: int, seed: int) -> Answer:
    """Dynamics of an elastic six-axis arm, judged on a held-out motion."""
    return make_answer(robot.load(console).study_six_joints(seeds=seeds, seed=seed))


@study_command.command("friction-tables", cls=Verb)
@_runs_options(1000, 0)
@_times_option
@output_option("Page with all tables and figures to write, .html.")
@force_option
@verb
def _friction_tables(
    console: Console,
    *,
    seeds: int,
    seed: int,
    jobs: int | None,
    times: bool,
    output: Path | None,
    force: bool,
) -> Answer:
    """Tables of Zhang, Hu and Zou (2021) on joint friction, theirs and ours side by side."""
    # Minutes before it is written: a page that cannot be is refused now.
    check_output(output, force=force)
    found = symid.study_friction_tables(
        seeds=seeds, seed=seed, jobs=jobs, timed=times, progress=console.progress
    )
    if output is None:
        return make_answer(found, file=None)
    return make_answer(found, f"report: {show_path(found.save(output))}", file=output)


@study_command.command("precision", cls=Verb)
@robot_argument(computes=True)
@_runs_options(400)
@verb
def _precision(console: Console, *, robot: NamedRobot, seeds: int, seed: int, jobs: int | None) -> Answer:
    """Errors of identification against the Cramer-Rao bound, on five random excitations."""
    return make_answer(robot.load(console).study_precision(seeds=seeds, seed=seed, jobs=jobs))


@study_command.command("cutoff", cls=Verb)
@robot_argument(computes=True)
@click.argument("log", type=FILE)
@verb
def _cutoff(console: Console, *, robot: NamedRobot, log: Path) -> Answer:
    """What the cut-off of the position filter does to what a fit predicts."""
    return make_answer(robot.load(console).study_cutoff(log))
