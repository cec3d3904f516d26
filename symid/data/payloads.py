"""Payloads that are known: what they add to the base parameters of the robot that carries them.

Input: the `payload` of a run, a robot. Output: its name, and what it adds to beta.

    payload = { name = "disc", joint = "elbow", mass = 1.2, com = [0, 0, 0.05], inertia = { xx = 0.01 } }

The body stands in the frame that the robot file gives to the link, as in `[joint.link]`; `joint` is the last
one if it is not named. beta_loaded = beta + K_link pi: the torques of the payload are known, and leave the
equations.

Supported: any link; bodies as mass, centre and inertia, or as standard parameters; a name alone for what is
not known.
Not supported: bodies on several links.
"""

from typing import NamedTuple

import numpy as np

from symid.formats.forms import Symbols
from symid.formats.link import read_body
from symid.formats.section import Section, read_text
from symid.robot.description import Robot

__all__ = ["Load", "read_payload"]

_KEY = "payload"


class Load(NamedTuple):
    """Name of a payload, and what it adds to beta (p,); nothing where it is not known."""

    name: str
    load: tuple[float, ...] = ()


def read_payload(section: Section, robot: Robot) -> Load:
    """Return what a run says of its payload; mistakes go to the report of the section."""
    value = section.values.get(_KEY)
    if not isinstance(value, dict):
        return Load(read_text(section, _KEY) or "")
    names = [joint.name for joint in robot.joints]
    inner = Section(values=value, path=(*section.path, _KEY), report=section.report, label="payload")
    joint = read_text(inner, "joint") or names[-1]
    name = read_text(inner, "name") or _KEY
    if joint not in names:
        inner.refuse(
            "runs.unknown-joint", "joint", f"there is no joint {joint!r}; allowed are {', '.join(names)}"
        )
        return Load(name)
    link = names.index(joint)
    symbols = Symbols(values=dict(robot.symbols))
    body = read_body(section, _KEY, robot.joints[link].frame, symbols, ("name", "joint"))
    if body.parameters is None:
        return Load(name)
    return Load(name, _find_load(robot, link, body.parameters))


def _find_load(robot: Robot, link: int, parameters: tuple[float, ...]) -> tuple[float, ...]:
    """Return K_link pi (p,)."""
    from symid.notation import INERTIAL
    from symid.parameters.base import find_base_parameters
    from symid.parameters.consistency_inputs import build_grouping

    grouping = build_grouping(robot, find_base_parameters(robot))
    columns = [grouping.labels.index((link, name)) for name in INERTIAL]
    return tuple(map(float, grouping.matrix[:, columns] @ np.array(parameters)))
