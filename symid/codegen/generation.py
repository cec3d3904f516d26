"""A folder of generated code: written and tested where something has changed, else left as it is.

Input: a robot, what is wanted of its code, a folder. Output: `GeneratedFolder`.

Robot -> Functions -> SourceSet -> files -> self-test -> record

One run at a time writes a folder; another waits. Supported: the targets of `TARGETS`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from symid.codegen.build_record import (
    BuildRecord,
    find_inputs_signature,
    find_operations,
    read_unchanged,
    write_build_record,
)
from symid.codegen.folder_lock import lock_folder
from symid.codegen.options import GenerateOptions
from symid.codegen.selftest import find_runner, find_warnings, run_selftest
from symid.codegen.writer import MANIFEST, SourceSet, find_listed, write_sources
from symid.errors import Notice, UsageError
from symid.robot.description import Robot

if TYPE_CHECKING:  # a folder that is up to date needs neither CasADi nor SymPy
    from symid.codegen.casadi_functions import Functions

__all__ = ["PARAMETERS", "TARGETS", "CodeOrder", "GeneratedFolder", "generate_folder"]

TARGETS = ("c", "python", "casadi")
PARAMETERS = ("base", "standard")


@dataclass(frozen=True, slots=True, kw_only=True)
class CodeOrder:
    """All that fixes the code besides the robot; a second run compares it with that of the first.

    Args:
        names: of the functions, None for all.
        target: of `TARGETS`.
        parameters: "base" for functions of beta, "standard" for functions of all standard parameters pi.
        constant: whether the values of the robot file are part of the functions, which then take none.
        options: of the sources.

    Raises:
        UsageError: a value that is not offered, or that the target does not have.
    """

    names: tuple[str, ...] | None = None
    target: str = "c"
    parameters: str = "base"
    constant: bool = False
    options: GenerateOptions = field(default_factory=GenerateOptions)

    def __post_init__(self) -> None:
        """Check the values."""
        if self.names == ():
            text = "functions: none was named; name at least one, or leave them out for all"
            raise UsageError(Notice(code="usage.functions", text=text))
        for key, value, allowed in (
            ("target", self.target, TARGETS),
            ("parameters", self.parameters, PARAMETERS),
        ):
            if value not in allowed:
                text = f"{key}: expected one of {', '.join(allowed)}, got {value!r}"
                raise UsageError(Notice(code=f"usage.{key}", text=text))
        if self.options.friction_laws and self.target != "c":
            text = f"friction laws are written in C only; leave them out for target {self.target!r}"
            raise UsageError(Notice(code="usage.friction-laws", text=text))
        plain = GenerateOptions()
        given = [
            key for key in ("precision", "trigonometry") if getattr(self.options, key) != getattr(plain, key)
        ]
        if given and self.target != "c":
            text = f"{', '.join(given)}: only C has the choice; leave it out for target {self.target!r}"
            raise UsageError(Notice(code="usage.precision", text=text))


@dataclass(frozen=True, slots=True, kw_only=True)
class GeneratedFolder:
    """What is in a folder, and what its self-test said.

    Attributes:
        folder: with the files. manifest: as it stands there. record: of its self-test.
        unchanged: whether it was up to date, and nothing was done.
        notices: what a user should know, such as a self-test that could not be run.
    """

    folder: Path
    manifest: Mapping[str, object]
    record: BuildRecord
    unchanged: bool
    notices: tuple[Notice, ...]

    @property
    def files(self) -> tuple[Path, ...]:
        """Return all files that symid wrote there."""
        return tuple(self.folder / path for path in (*find_listed(self.manifest), MANIFEST))

    @property
    def operations(self) -> dict[str, dict[str, int]]:
        """Return products, sums and sines by function."""
        return find_operations(self.manifest)


def generate_folder(
    robot: Robot, order: CodeOrder, folder: Path, *, progress: Callable[[str], None], force: bool = False
) -> GeneratedFolder:
    """Write the code of `robot` to `folder` and test it; nothing is done where nothing has changed.

    Args:
        robot: the robot.
        order: what is wanted.
        folder: new, or one that symid wrote; files of others in it stay as they are.
        progress: told what begins.
        force: whether to write in any case, over files too that were edited since.

    Raises:
        RobotError: a symbolic length has no value.
        UsageError: the robot has no such function, or its file lacks a value that shall be constant.
        OutputError: the folder cannot be written, or holds what symid did not write.
        GenerationError: the code fails its self-test.
    """
    compiler, runner = find_runner(order.target)
    inputs = find_inputs_signature(robot, order.names, order, compiler=compiler, runner=runner)
    with lock_folder(folder, lambda: progress(f"{folder}: waiting for another run that writes it")):
        found = None if force else read_unchanged(folder, inputs)
        manifest, record = found or _make(robot, order, folder, inputs, progress, force=force)
    return GeneratedFolder(
        folder=folder,
        manifest=manifest,
        record=record,
        unchanged=found is not None,
        notices=find_warnings(folder, record.selftest),
    )


def _make(
    robot: Robot,
    order: CodeOrder,
    folder: Path,
    inputs: str,
    progress: Callable[[str], None],
    *,
    force: bool,
) -> tuple[Mapping[str, object], BuildRecord]:
    """Derive, write and test; return the manifest, and what is remembered of the test."""
    from symid.codegen.casadi_functions import build_functions

    progress(f"deriving the functions of {robot.name}")
    functions = build_functions(
        robot, names=order.names, standard=order.parameters == "standard", constant=order.constant
    )
    progress(f"writing {order.target} code")
    sources = _generate(functions, order)
    write_sources(sources, folder, force=force)
    run = run_selftest(folder, order.target, progress)
    record = BuildRecord(
        inputs=inputs, selftest=run.selftest, runner=run.runner, flags=run.flags, sizes=run.sizes
    )
    return write_build_record(folder, record, sources), record


def _generate(functions: "Functions", order: CodeOrder) -> SourceSet:
    match order.target:
        case "c":
            from symid.codegen.c_library import generate_c_library

            return generate_c_library(functions, order.options)
        case "python":
            from symid.codegen.python_module import generate_python_module

            return generate_python_module(functions, order.options)
    from symid.codegen.casadi_target import generate_casadi

    return generate_casadi(functions, order.options)
