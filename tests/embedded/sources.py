"""Generated folders, one a robot, a precision and a choice of trigonometry."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product
from pathlib import Path

import pytest

from symid.codegen.c_library import generate_c_library
from symid.codegen.casadi_functions import Functions, build_functions
from symid.codegen.source_folder import write_sources
from symid.options import GenerateOptions
from symid.robot.toml_reader import read_robot
from tests.embedded.panda import give_values

ROBOTS = ("panda", "two_link", "two_link_elastic", "two_arms")


@dataclass(frozen=True, slots=True, kw_only=True)
class Folder:
    """A generated folder and what it was generated from."""

    path: Path
    robot: str
    precision: str
    trigonometry: str
    functions: Functions

    @property
    def prefix(self) -> str:
        """Return what all names begin with."""
        return f"symid_{self.robot}"

    @property
    def label(self) -> str:
        """Return what a figure calls the folder."""
        return f"{self.robot} {self.precision} {self.trigonometry} sin/cos"

    @property
    def library(self) -> tuple[Path, ...]:
        """Return the sources of the library, without programs."""
        return tuple(sorted(self.path.glob(f"{self.prefix}*.c")))

    @property
    def programs(self) -> tuple[Path, ...]:
        """Return the sources that hold a `main`."""
        return tuple(sorted(set(self.path.glob("*.c")) - set(self.library)))


def with_folders(
    robots: Sequence[str], precisions: Sequence[str], library: Sequence[str] | None = None
) -> pytest.MarkDecorator:
    """Return the mark that runs a test with the fixture `folder` for each of these.

    `library` are the robots whose sines are those of the C library besides, None for all.
    """
    cases = list(product(robots, precisions, ("own",)))
    cases += product(robots if library is None else library, precisions, ("library",))
    return pytest.mark.parametrize("folder", cases, indirect=True, ids=map("-".join, cases))


Sources = Callable[..., Folder]
"""The folder of a robot, a precision and a trigonometry, generated when first asked for."""


def make_sources(project: Path, root: Path) -> Sources:
    """Return the call that generates folders of robots of `robots/`; elastic ones have friction laws too."""

    @cache
    def derive(robot: str) -> Functions:
        described = read_robot(project / "robots" / f"{robot}.toml")
        return build_functions(give_values(described) if robot == "panda" else described)

    @cache
    def get(robot: str, precision: str, trigonometry: str) -> Folder:
        path, functions, laws = (
            root / f"{robot}_{precision}_{trigonometry}",
            derive(robot),
            "elastic" in robot,
        )
        options = GenerateOptions(precision=precision, trigonometry=trigonometry, friction_laws=laws)
        write_sources(generate_c_library(functions, options), path)
        named = {"robot": robot, "precision": precision, "trigonometry": trigonometry}
        return Folder(path=path, functions=functions, **named)

    return get
