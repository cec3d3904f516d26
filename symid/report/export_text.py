"""What was written for other programs: lines for people, an object for programs.

Input: `FileExport`. Output: blocks, dictionaries.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from symid.formats.joint_friction import FRICTION_PARAMETERS, FRICTION_SHAPES
from symid.paths import show_path
from symid.report.blocks import Block
from symid.robot.description import FrictionValues

if TYPE_CHECKING:  # this loads SymPy
    from symid.tasks.export import FileExport, WrittenFriction

__all__ = ["describe_export", "show_export"]


def show_export(found: "FileExport") -> tuple[Block, ...]:
    """Return what was written and where, and how bodies were found or which laws joints have."""
    lines = [f"{found.format}: {show_path(found.file)}"]
    if found.standard is not None:
        lines.append(found.standard.outcome.value)
    if found.friction is not None:
        laws = found.friction.laws
        lines += [
            f"{joint}: {laws[joint]} as {entry.kind.value}" for joint, entry in found.friction.values.items()
        ]
    return ("\n".join(lines),)


def describe_export(found: "FileExport") -> dict[str, object]:
    """Return the export as `symid export --json` gives it."""
    if found.friction is not None:
        return {
            "file": str(found.file),
            "robot": found.robot.name,
            "written": _describe_friction(found.friction),
            "kept": dict(found.friction.kept),
        }
    result = {
        "file": str(found.file),
        "format": found.format,
        "robot": found.robot.name,
        "elastic": any(found.robot.elastic),
        "outcome": found.outcome,
    }
    if found.standard is not None:
        result["largest_change"] = max(map(abs, found.standard.residual.tolist()), default=0.0)
        result["blamed"] = found.standard.blamed
        result["not_identified"] = found.missing
    return {**result, "left_out": found.left_out}


def _describe_friction(friction: "WrittenFriction") -> Mapping[str, object]:
    return {
        joint: {"law": friction.laws[joint], **_describe_values(values)}
        for joint, values in friction.values.items()
    }


def _describe_values(values: FrictionValues) -> dict[str, object]:
    names = FRICTION_PARAMETERS[values.kind]
    shapes = [key.name for key in FRICTION_SHAPES.get(values.kind, ())]
    return {
        "model": values.kind.value,
        "values": dict(zip(names, values.values or (), strict=True)),
        "shape": dict(zip(shapes, values.shape, strict=True)),
        "smoothing": values.smoothing,
    }
