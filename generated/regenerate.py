"""Write the committed samples anew: `python generated/regenerate.py` accepts what is generated now."""

from pathlib import Path

from symid.codegen.c_library import generate_c_library
from symid.codegen.casadi_functions import build_functions
from symid.codegen.python_targets import generate_python_module
from symid.codegen.source_folder import SourceSet, write_sources
from symid.robot.toml_reader import read_robot

__all__ = ["ROBOTS", "generate_samples"]

ROBOTS = ("two_link",)
FOLDER = Path(__file__).resolve().parent


def generate_samples(robot: str) -> dict[str, SourceSet]:
    """Return the sources of a robot by the name of their folder."""
    functions = build_functions(read_robot(FOLDER.parent / "robots" / f"{robot}.toml"))
    return {"c": generate_c_library(functions), "python": generate_python_module(functions)}


def main() -> None:
    """Write all samples."""
    for robot in ROBOTS:
        for target, sources in generate_samples(robot).items():
            (FOLDER / robot).mkdir(exist_ok=True)
            write_sources(sources, FOLDER / robot / target, force=True)


if __name__ == "__main__":
    main()
