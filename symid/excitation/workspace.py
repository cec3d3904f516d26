"""Where links may be: balls that they stay out of or within, planes that they stay on one side of.

Input: a TOML file. Output: `Workspace`, `Region`s with the points of links that they hold for.

    [[sphere]]
    keep = "out"                # or "in"
    centre = [0.5, 0.0, 0.2]    # m, base frame
    radius = 0.3                # m
    links = ["joint7"]          # joints whose link frames carry the point; the last one where left out
    point = [0.0, 0.0, 0.1]     # m, in the link frame; its origin where left out
    size = 0.05                 # m, radius of a ball about the point; 0 where left out

    [[plane]]
    normal = [0.0, 0.0, 1.0]    # of any length
    offset = 0.05               # m: normal . p >= offset along the unit normal
    links = ["joint4", "joint7"]

Supported: any number of regions, each for any number of links.
Not supported: contact between links (give balls about their own places), moving obstacles.
"""

import math
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

from symid.errors import Notice, RobotError
from symid.formats.positions import find_places
from symid.formats.section import (
    NOT_NEGATIVE,
    POSITIVE,
    Report,
    Section,
    read_choice,
    read_number,
    read_numbers,
    refuse_unknown_keys,
)
from symid.formats.text_file import read_text_file
from symid.robot.description import Robot

__all__ = ["Point", "Region", "Workspace", "read_workspace"]

_COMMON = ("links", "point", "size")
_KEYS = {"sphere": ("keep", "centre", "radius", *_COMMON), "plane": ("normal", "offset", *_COMMON)}

Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """A ball of radius `size` (m) about `place` (m) in the frame of the link of joint `joint` (an index)."""

    joint: int
    place: Vector
    size: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Region:
    """One demand on some points.

    Args:
        kind: "out" or "in" of a sphere, or "plane".
        anchor: centre of the sphere in m, or unit normal of the plane.
        extent: radius of the sphere, or offset of the plane, m.
        points: what is kept there.
        label: how messages call it.
    """

    kind: str
    anchor: Vector
    extent: float
    points: tuple[Point, ...]
    label: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Workspace:
    """All demands, and the file that they come from."""

    regions: tuple[Region, ...] = ()
    file: str = ""


def read_workspace(path: Path, robot: Robot) -> Workspace:
    """Return the workspace that the file at `path` describes.

    Raises:
        RobotError: with a notice for each mistake in the file.
    """
    text = read_text_file(path).replace("\r\n", "\n")
    try:
        values = tomllib.loads(text, parse_float=Decimal)
    except tomllib.TOMLDecodeError as error:
        notice = Notice(code="excitation.workspace", text=f"not valid TOML: {error}", file=str(path))
        raise RobotError(notice) from error
    report = Report(find_places(text, str(path)))
    root = Section(values=values, path=(), report=report)
    refuse_unknown_keys(root, tuple(_KEYS))
    regions = tuple(
        _read_region(section, kind, robot) for kind in _KEYS for section in _list_tables(root, kind)
    )
    if not regions and not report.errors:
        text = "holds no [[sphere]] and no [[plane]]; write one, or leave the option out"
        raise RobotError(Notice(code="excitation.workspace", text=text, file=str(path)))
    if report.errors:
        raise RobotError(*report.notices())
    return Workspace(regions=tuple(region for region in regions if region), file=str(path))


def _list_tables(root: Section, kind: str) -> Iterator[Section]:
    tables = root.values.get(kind, [])
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        root.refuse("robot.wrong-type", kind, f"expected tables; write [[{kind}]] for each")
        return
    for index, table in enumerate(tables):
        section = Section(values=table, path=(kind, index), report=root.report, label=f"{kind} {index + 1}")
        refuse_unknown_keys(section, _KEYS[kind])
        yield section


def _read_region(section: Section, kind: str, robot: Robot) -> Region | None:
    points = _read_points(section, robot)
    if kind == "plane":
        anchor, extent = _read_vector(section, "normal"), _read_size(section, "offset")
        length = math.hypot(*anchor) if anchor else 1.0
        if not length:
            section.refuse("robot.out-of-range", "normal", "a normal of length zero has no direction")
        if anchor is None or extent is None or not length:
            return None
        x, y, z = (part / length for part in anchor)
        return Region(kind="plane", anchor=(x, y, z), extent=extent, points=points, label=section.label)
    keep = read_choice(section, "keep", ("out", "in")) or "out"
    centre, radius = _read_vector(section, "centre"), _read_size(section, "radius", positive=True)
    if centre is None or radius is None:
        return None
    if keep == "in" and any(point.size >= radius for point in points):
        section.refuse("robot.out-of-range", "size", f"a ball of this size does not fit within {radius:g} m")
    return Region(kind=keep, anchor=centre, extent=radius, points=points, label=section.label)


def _read_points(section: Section, robot: Robot) -> tuple[Point, ...]:
    names = [joint.name for joint in robot.joints]
    wanted: object = section.values.get("links", names[-1:])
    if not isinstance(wanted, list) or not wanted or any(name not in names for name in wanted):
        allowed = ", ".join(names)
        text = f"expected a list of names of joints, got {section.show('links')}; there are {allowed}"
        section.refuse("robot.bad-choice", "links", text)
        return ()
    place = _read_vector(section, "point") if "point" in section.values else (0.0, 0.0, 0.0)
    size = read_number(section, "size", "m", NOT_NEGATIVE)
    if place is None:
        return ()
    return tuple(
        Point(joint=names.index(name), place=place, size=0.0 if size is None else float(size))
        for name in dict.fromkeys(wanted)
    )


def _read_vector(section: Section, key: str) -> Vector | None:
    if key not in section.values:
        section.refuse_key("robot.missing-key", key, "missing; three numbers are needed")
        return None
    found: Sequence[Decimal] | None = read_numbers(section, key, "m", 3)
    return (float(found[0]), float(found[1]), float(found[2])) if found else None


def _read_size(section: Section, key: str, *, positive: bool = False) -> float | None:
    if key not in section.values:
        section.refuse_key("robot.missing-key", key, "missing; a number in m is needed")
        return None
    found = read_number(section, key, "m", POSITIVE) if positive else read_number(section, key, "m")
    return None if found is None else float(found)
