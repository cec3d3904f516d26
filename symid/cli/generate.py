"""`symid generate ROBOT --target c -o FOLDER`: the robot's functions as code that stands alone."""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import click

from symid.cli.inputs import load_robot
from symid.cli.options import cut_options, force_folder_option, friction_option, output_option, verb
from symid.cli.output import Answer, Console, format_table
from symid.errors import GenerationError, Notice, UsageError

if TYPE_CHECKING:  # these load CasADi
    from symid.codegen.casadi_functions import Functions

__all__ = ["command", "run_selftest"]

_TIMEOUT = 600.0


@click.command("generate")
@click.argument("robot")
@click.option(
    "--target", type=click.Choice(("c", "python")), default="c", show_default=True, help="Language."
)
@click.option(
    "--precision",
    type=click.Choice(("double", "float")),
    default="double",
    show_default=True,
    help="Type of all numbers in C.",
)
@click.option(
    "--parameters",
    type=click.Choice(("base", "standard")),
    default="base",
    show_default=True,
    help="What functions take: the base parameters beta, or all standard parameters pi.",
)
@click.option("--function", "names", multiple=True, metavar="NAME", help="This one only; may be repeated.")
@click.option(
    "--friction-laws", is_flag=True, help="Put all static friction laws into the C library besides."
)
@friction_option
@cut_options
@output_option("Folder of the sources.", required=True, folder=True)
@force_folder_option
@verb
def command(
    console: Console,
    *,
    robot: str,
    target: str,
    precision: str,
    parameters: str,
    names: tuple[str, ...],
    friction_laws: bool,
    friction: str | None,
    base_link: str | None,
    tip_link: str | None,
    snap: float | None,
    output: Path,
    force: bool,
) -> Answer:
    """Write the robot's functions as a C library or as a Python module.

    The folder needs neither symid nor CasADi. Its self-test is run where a compiler is.
    """
    if friction_laws and target != "c":
        text = "--friction-laws: these are written in C; leave out --target python"
        raise UsageError(Notice(code="usage.friction-laws", text=text))
    described = load_robot(robot, friction=friction, base=base_link, tip=tip_link, snap=snap)
    console.progress(f"deriving the functions of {described.name}")
    from symid.codegen.casadi_functions import build_functions
    from symid.codegen.options import GenerateOptions
    from symid.codegen.writer import write_sources

    options = GenerateOptions(precision=precision, friction_laws=friction_laws)
    functions = build_functions(described, names=names or None, standard=parameters == "standard")
    console.progress(f"writing {target} code")
    if target == "c":
        from symid.codegen.c_library import generate_c_library

        sources = generate_c_library(functions, options)
    else:
        from symid.codegen.python_module import generate_python_module

        sources = generate_python_module(functions, options)
    files = write_sources(sources, output, force=force)
    operations = _count(functions)
    selftest, warnings = run_selftest(output, target, console)
    rows = [(name, *counts.values()) for name, counts in operations.items()]
    text = "\n\n".join(
        (
            f"{output}: {len(files)} files, self-test {selftest}",
            format_table(("function", "mul", "add", "trig"), rows),
        )
    )
    result = {
        "robot": described.name,
        "target": target,
        "folder": output,
        "files": files,
        "operations": operations,
        "selftest": selftest,
    }
    return Answer(text=text, result=result, warnings=(*described.notices, *warnings))


def _count(functions: "Functions") -> dict[str, dict[str, int]]:
    from dataclasses import asdict

    from symid.codegen.instructions import count_operations

    return {program.spec.name: asdict(count_operations(program)) for program in functions.programs}


def run_selftest(folder: Path, target: str, console: Console) -> tuple[str, tuple[Notice, ...]]:
    """Run the folder's own test in a copy of it and return how it went: "passed" or "not run"."""
    from symid.codegen.compiler import find_compiler

    if target == "python":
        (module,) = folder.glob("*.py")
        arguments = [sys.executable, module.name]
    else:
        compiler = find_compiler()
        if compiler is None or shutil.which("make") is None:
            text = (
                "its self-test was not run: no C compiler or no make; install them, then `make check` there"
            )
            return "not run", (Notice(code="generate.selftest-not-run", text=text, file=str(folder)),)
        arguments = ["make", "check", f"CC={compiler.path}"]
    console.progress("running the self-test of the folder")
    with tempfile.TemporaryDirectory(prefix="symid-") as scratch:
        copy = shutil.copytree(folder, Path(scratch) / "code")
        done = subprocess.run(
            arguments, cwd=copy, capture_output=True, text=True, check=False, timeout=_TIMEOUT
        )
    console.detail(done.stdout)
    if done.returncode:
        text = f"the self-test failed: {' '.join(arguments)}\n{done.stdout}{done.stderr}".rstrip()
        raise GenerationError(Notice(code="generate.selftest-failed", text=text, file=str(folder)))
    return "passed", ()
