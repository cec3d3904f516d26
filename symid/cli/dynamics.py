"""The verbs on a robot's dynamics: `symid derive`, `symid base`, `symid generate`."""

from pathlib import Path
from typing import Any, Literal

import click

from symid.api import BaseForm
from symid.cli.call import Answer, Console, make_answer
from symid.cli.options import NamedRobot, friction_option, output_option, robot_argument
from symid.cli.verbs import FILE, MODEL, OUTPUT, verb
from symid.errors import Notice, UsageError


@verb("derive")
@robot_argument()
@OUTPUT.option("--latex", "Print formulas in LaTeX.", is_flag=True)
@OUTPUT.option("--html", "Write the lesson as one page, with the arm to move.", FILE, "FILE")
@OUTPUT.option("--tex", "Write the lesson as a document for pdflatex.", FILE, "FILE")
@MODEL.option(
    "--notation",
    "Letters of the page: those of symid or of a textbook.",
    click.Choice(("symid", "siciliano", "craig", "khalil")),
    default="symid",
)
@MODEL.option(
    "--parameters",
    "Parameters of the page: base, the file's symbols, or masses, centres of mass and inertias (bodies).",
    click.Choice(("base", "symbols", "bodies")),
)
@MODEL.option("--angle", "Letter of angles in the page.", click.Choice(("q", "theta")))
@MODEL.option("--long-sines", "Write cos(q1 + q2) in place of c12 in the page.", is_flag=True)
@OUTPUT.option(
    "--exercises",
    "Exercises at the end of the page, with a file of answers.",
    click.IntRange(0, 50),
    default=0,
)
@OUTPUT.option("--seed", "Of the exercises.", click.IntRange(0), default=0)
def derive_command(
    console: Console,
    *,
    robot: NamedRobot,
    latex: bool,
    html: Path | None,
    tex: Path | None,
    **options: Any,  # noqa: ANN401  of the page, typed in `RobotModel.write_lesson`
) -> Answer:
    """Derive the dynamics step by step, from the frames to the torques, with operation counts.

    With --html the derivation is a page for a lecture: M, C and g as formulas with their numbers, checks,
    the arm to move; one file that needs no network.

    Each step has a sentence, its formulas and a check. Then follow the operations of the generated
    functions; --json lists those of all routes, not only the chosen ones.
    """
    if html is not None and tex is not None:
        raise UsageError(Notice(code="usage.lesson-files", text="--html and --tex: write one at a time"))
    wanted = html or tex
    if wanted is not None:
        return make_answer(robot.load(console).write_lesson(wanted, **options))
    given = [name for name, value in options.items() if value not in (None, False, "symid", 0)]
    if given:
        text = f"--{given[0].replace('_', '-')}: only for a page; add --html FILE"
        raise UsageError(Notice(code="usage.lesson-option", text=text))
    return make_answer(robot.load(console).derivation(latex=latex))


@verb("base")
@robot_argument()
@friction_option
@MODEL.option(
    "--of form",
    "Base parameters of all torques, the energies, the momentum, or torques at rest (gravity).",
    click.Choice(("torque", "energy", "momentum", "gravity")),
    default="torque",
)
def base_command(console: Console, *, robot: NamedRobot, friction: str | None, form: BaseForm) -> Answer:
    """List the base parameters, the smallest set that describes all motions and torques.

    Each has its grouping and the reason for it; then follow the eliminated parameters. --of selects
    those of the energies, the momentum or a static test.
    """
    model = robot.load(console, friction=friction)
    console.progress(f"deriving the base parameters of {model.name}")
    return make_answer(model.derive_base(form))


@verb("generate")
@robot_argument()
@OUTPUT.option(
    "--target",
    "What to write: a C library, a module of NumPy or JavaScript, or CasADi functions, their C and a loader.",
    click.Choice(("c", "python", "casadi", "js")),
    default="c",
)
@OUTPUT.option(
    "--precision", "Type of all numbers in C.", click.Choice(("double", "float")), default="double"
)
@MODEL.option(
    "--parameters",
    "Arguments of the functions: base parameters beta, or all standard parameters pi.",
    click.Choice(("base", "standard")),
    default="base",
)
@MODEL.option("--constant", "Use the robot file's values as constants in the functions.", is_flag=True)
@OUTPUT.option(
    "--trigonometry",
    "Sines in C: own code for all angles at once, or calls of the C library.",
    click.Choice(("own", "library")),
    default="own",
)
@OUTPUT.option(
    "--function names", "Write only this function; may be repeated.", multiple=True, metavar="NAME"
)
@OUTPUT.option("--friction-laws", "Add all static friction laws to the C library.", is_flag=True)
@friction_option
@output_option("Folder of the sources.", required=True, folder=True)
def generate_command(
    console: Console,
    *,
    robot: NamedRobot,
    target: Literal["c", "python", "casadi", "js"],
    names: tuple[str, ...],
    friction_laws: bool,
    friction: str | None,
    output: Path,
    **options: Any,  # noqa: ANN401  of the code, typed in `RobotModel.write`
) -> Answer:
    """Write the robot's functions as a C library, as a Python or JavaScript module, or for CasADi.

    The folder does not need symid. Its self-test runs after writing, for C if there is a compiler. A
    folder that is up to date is not changed.
    """
    if friction_laws and target != "c":
        text = f"--friction-laws: only for C; leave out --target {target}"
        raise UsageError(Notice(code="usage.friction-laws", text=text))
    model = robot.load(console, friction=friction)
    return make_answer(
        model.write(target, output, functions=names or None, friction_laws=friction_laws, **options)
    )
