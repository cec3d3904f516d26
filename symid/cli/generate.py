"""`symid generate ROBOT --target c -o FOLDER`: the robot's functions as code that stands alone."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from symid.cli.inputs import load_robot
from symid.cli.options import cut_options, force_folder_option, friction_option, output_option, verb
from symid.cli.output import Answer, Console, format_table
from symid.cli.selftest import find_runner, find_warnings, run_selftest
from symid.errors import Notice, UsageError

if TYPE_CHECKING:  # these load NumPy, which --help must not wait for
    from symid.codegen.build_record import BuildRecord
    from symid.codegen.casadi_functions import Functions
    from symid.codegen.options import GenerateOptions
    from symid.codegen.writer import SourceSet
    from symid.robot.description import Robot

__all__ = ["command", "run_selftest"]

_COUNTS = ("mul", "add", "trig")
_SIZES = ("code", "stack")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Choices:
    """All that fixes the code besides the robot; a second run compares it with that of the first."""

    names: tuple[str, ...] | None
    target: str
    standard: bool
    constant: bool
    options: "GenerateOptions"


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
@click.option(
    "--constant", is_flag=True, help="Bake the robot file's values into the functions, which then take none."
)
@click.option(
    "--trigonometry",
    type=click.Choice(("own", "library")),
    default="own",
    show_default=True,
    help="Sines in C: of all angles at once, in the code itself, or calls of the C library.",
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
    constant: bool,
    trigonometry: str,
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

    The folder needs neither symid nor CasADi. Its self-test is run where a compiler is. Where neither the
    robot nor anything else has changed since the last time, nothing is done.
    """
    if friction_laws and target != "c":
        text = "--friction-laws: these are written in C; leave out --target python"
        raise UsageError(Notice(code="usage.friction-laws", text=text))
    described = load_robot(robot, friction=friction, base=base_link, tip=tip_link, snap=snap)
    from symid.codegen.build_record import find_inputs_signature, read_unchanged
    from symid.codegen.folder_lock import lock_folder
    from symid.codegen.options import GenerateOptions

    choices = _Choices(
        names=names or None,
        target=target,
        standard=parameters == "standard",
        constant=constant,
        options=GenerateOptions(precision=precision, trigonometry=trigonometry, friction_laws=friction_laws),
    )
    compiler, runner = find_runner(target)
    inputs = find_inputs_signature(described, choices.names, choices, compiler=compiler, runner=runner)
    with lock_folder(output, lambda: console.progress(f"{output}: waiting for another run that writes it")):
        made = None if force else read_unchanged(output, inputs)
        manifest, record = made or _make(described, choices, output, inputs, console, force=force)
    return _answer(
        output,
        manifest,
        record,
        robot=described.name,
        unchanged=made is not None,
        warnings=(*described.notices, *find_warnings(output, record.selftest)),
    )


def _make(
    robot: "Robot", choices: _Choices, folder: Path, inputs: str, console: Console, *, force: bool
) -> tuple[Mapping[str, object], "BuildRecord"]:
    """Derive, write and test; return the manifest, and what is remembered of the test."""
    from symid.codegen.build_record import BuildRecord, write_build_record
    from symid.codegen.casadi_functions import build_functions
    from symid.codegen.writer import write_sources

    console.progress(f"deriving the functions of {robot.name}")
    functions = build_functions(
        robot, names=choices.names, standard=choices.standard, constant=choices.constant
    )
    console.progress(f"writing {choices.target} code")
    sources = _generate(functions, choices)
    write_sources(sources, folder, force=force)
    run = run_selftest(folder, choices.target, console)
    record = BuildRecord(
        inputs=inputs, selftest=run.selftest, runner=run.runner, flags=run.flags, sizes=run.sizes
    )
    return write_build_record(folder, record, sources), record


def _generate(functions: "Functions", choices: _Choices) -> "SourceSet":
    if choices.target == "c":
        from symid.codegen.c_library import generate_c_library

        return generate_c_library(functions, choices.options)
    from symid.codegen.python_module import generate_python_module

    return generate_python_module(functions, choices.options)


def _answer(
    folder: Path,
    manifest: Mapping[str, object],
    record: "BuildRecord",
    *,
    robot: str,
    unchanged: bool,
    warnings: tuple[Notice, ...],
) -> Answer:
    from symid.codegen.build_record import find_operations
    from symid.codegen.writer import MANIFEST, find_listed

    files = [folder / path for path in (*find_listed(manifest), MANIFEST)]
    operations = find_operations(manifest)
    sizes = {name: asdict(size) for name, size in record.sizes.items()}
    header = ("function", *_COUNTS, *(_SIZES if sizes else ()))
    rows = [
        (
            name,
            *(counts[key] for key in _COUNTS),
            *(sizes[name][key] for key in _SIZES if name in sizes),
        )
        for name, counts in operations.items()
    ]
    state = "nothing has changed" if unchanged else f"{len(files)} files"
    head = f"{folder}: {state}, self-test {record.selftest}"
    if record.runner:
        head += f" with {record.runner} {record.flags}".rstrip()
    text = f"{head}\n\n{format_table(header, rows)}"
    if sizes:
        text += "\n\ncode and stack in bytes; batches in manifest.json"
    result = {
        "robot": robot,
        "target": manifest["target"],
        "folder": folder,
        "files": files,
        "operations": operations,
        "selftest": record.selftest,
        "runner": record.runner,
        "flags": record.flags,
        "sizes": sizes,
        "unchanged": unchanged,
    }
    return Answer(text=text, result=result, warnings=warnings)
