"""Generated folders, one a robot, a precision and a choice of trigonometry."""

from collections.abc import Sequence
from dataclasses import dataclass, field
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


@dataclass
class Sources:
    """Folders that are generated when first asked for."""

    project: Path
    root: Path
    derived: dict[str, Functions] = field(default_factory=dict)
    made: dict[tuple[str, str, str], Folder] = field(default_factory=dict)

    def get(self, robot: str, precision: str, trigonometry: str = "library") -> Folder:
        """Return the folder of a robot of `robots/`; two_link_elastic has the friction laws besides."""
        key = (robot, precision, trigonometry)
        if key not in self.made:
            path = self.root / "_".join(key)
            functions = self._derive(robot)
            laws = robot == "two_link_elastic"
            options = GenerateOptions(precision=precision, trigonometry=trigonometry, friction_laws=laws)
            write_sources(generate_c_library(functions, options), path)
            self.made[key] = Folder(
                path=path, robot=robot, precision=precision, trigonometry=trigonometry, functions=functions
            )
        return self.made[key]

    def _derive(self, robot: str) -> Functions:
        if robot not in self.derived:
            described = read_robot(self.project / "robots" / f"{robot}.toml")
            described = give_values(described) if robot == "panda" else described
            self.derived[robot] = build_functions(described)
        return self.derived[robot]
