"""The formats of `symid export`: a robot with values becomes the text of a file.

Input: `Export`, the end of the file's name. Output: texts.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from symid.cli.output import write_json

if TYPE_CHECKING:  # these load numpy and sympy
    from symid.estimators.estimate import ParameterEstimate
    from symid.formats.value_vectors import RobotValues
    from symid.parameters.base import BaseParameters
    from symid.robot.description import Robot

__all__ = ["KINDS", "Export", "list_omissions", "write_export"]

KINDS = {
    ".toml": "robot file",
    ".urdf": "URDF",
    ".xml": "MJCF model",
    ".mjcf": "MJCF model",
    ".h": "C header",
    ".json": "values as JSON",
}
"""What files are, by the end of their name."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Export:
    """What is written: a robot with values, its base parameters, where the values are from.

    `outcome` is how bodies were found, "stated" where the robot file's own were taken; `found` are the
    identified values themselves.
    """

    robot: "Robot"
    base: "BaseParameters"
    outcome: str
    sources: tuple[str, ...] = ()
    found: tuple["ParameterEstimate", ...] = ()
    precision: str = "double"

    @property
    def comment(self) -> str:
        """Return the first line of the file."""
        if not self.sources:
            return f"{self.robot.name} with the values of its robot file."
        return f"{self.robot.name} with values identified from {', '.join(self.sources)}."


def _write_toml(exported: Export) -> str:
    from symid.formats.writer import write_robot

    return write_robot(exported.robot, comment=exported.comment)


def _write_urdf(exported: Export) -> str:
    """Return the robot's own file with other values where it is a URDF, else a new one."""
    from symid.formats.locate import is_urdf
    from symid.formats.text_file import read_text_file
    from symid.formats.urdf_rewriter import rewrite_urdf
    from symid.formats.urdf_writer import write_urdf

    path = Path(exported.robot.path)
    if exported.robot.path and is_urdf(path):
        return rewrite_urdf(read_text_file(path), exported.robot, comments=(exported.comment,))
    return write_urdf(exported.robot, comments=(exported.comment,))


def _write_mjcf(exported: Export) -> str:
    from symid.formats.mjcf_writer import write_mjcf

    return write_mjcf(exported.robot, comments=(exported.comment,))


def _write_header(exported: Export) -> str:
    from symid.codegen.names import clean_text
    from symid.formats.c_values import write_c_values

    comments = (clean_text(exported.comment),)
    return write_c_values(_build_values(exported), comments=comments, precision=exported.precision)


def _write_values(exported: Export) -> str:
    from symid.formats.json_values import build_json_values

    found = build_json_values(
        exported.robot, _build_values(exported), outcome=exported.outcome, sources=exported.sources
    )
    return write_json(found) + "\n"


_WRITERS: dict[str, Callable[[Export], str]] = {
    ".toml": _write_toml,
    ".urdf": _write_urdf,
    ".xml": _write_mjcf,
    ".mjcf": _write_mjcf,
    ".h": _write_header,
    ".json": _write_values,
}


def write_export(exported: Export, suffix: str) -> str:
    """Return the text of a file whose name ends in `suffix`."""
    return _WRITERS[suffix](exported)


def _build_values(exported: Export) -> "RobotValues":
    """Return the robot's values as the vectors of its generated functions."""
    from symid.codegen.model_card import build_model_card
    from symid.codegen.names import clean_text, find_prefix
    from symid.formats.value_vectors import RobotValues, ValueRow, ValueVector

    card = build_model_card(exported.robot, exported.base, ())
    known = {entry.name: entry for entry in exported.found}
    titles = {
        "beta": ("Base parameters of links and drives", card.beta),
        "f": ("Friction parameters", card.friction),
        "IA": ("Rotor inertias of elastic joints, on the joints' side", card.rotors),
        "h": ("Parameters of the springs of elastic joints", card.springs),
    }
    vectors = []
    for name, (title, cards) in titles.items():
        rows = []
        for entry in cards:
            found = known.get(entry.name)
            # A joint whose friction is known in part has none in robot files; here it has that part.
            value = found.value if entry.value is None and found is not None else entry.value
            rows.append(
                ValueRow(
                    name=clean_text(entry.name),
                    value=value,
                    unit=entry.unit,
                    expression=clean_text(entry.expression),
                    identified=found.value if found is not None else None,
                    std=_find_std(found),
                )
            )
        vectors.append(ValueVector(name=name, title=title, rows=tuple(rows)))
    prefix = find_prefix(card.robot)
    return RobotValues(robot=card.robot, prefix=prefix, signature=card.signature, vectors=tuple(vectors))


def _find_std(found: "ParameterEstimate | None") -> float | None:
    """Return the deviation of an identified value, where the method gives one."""
    return found.std if found is not None and 0.0 < found.std < math.inf else None


def list_omissions(robot: "Robot", suffix: str) -> tuple[str, ...]:
    """Return what the format has no words for."""
    if suffix == ".urdf":
        from symid.formats.urdf_writer import list_urdf_omissions

        return list_urdf_omissions(robot)
    if KINDS[suffix] == "MJCF model":
        from symid.formats.mjcf_writer import list_mjcf_omissions

        return list_mjcf_omissions(robot)
    return ()
