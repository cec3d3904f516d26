"""The robot: joints in a tree, their links, drives, friction, and how its logs read.

Input: numbers and names, checked by the readers. Output: `Robot`, the product that
every later stage starts from.

Convention: link frame j has the joint's axis as its z axis (modified DH). `placement` is
frame j seen from the parent's frame at q = 0; the joint then turns about z, or moves along it.
Standard DH rows are converted, exactly, by the reader.

Supported: revolute and prismatic joints, chains and trees, a fixed base.
Not supported: closed loops, floating bases.
"""

import re
from dataclasses import dataclass, field
from enum import Enum

from symid.errors import Notice, RobotError
from symid.robot.geometry import IDENTITY, ZERO, Exact, Placement

__all__ = [
    "Decimation",
    "Drive",
    "FrictionKind",
    "FrictionValues",
    "Joint",
    "JointKind",
    "Limits",
    "LogMap",
    "LogQuantity",
    "Processing",
    "Robot",
]


_COORDINATE = re.compile(r"(s|c|q|dq|ddq)\d+")


class JointKind(Enum):
    """How a joint moves along or about its z axis."""

    REVOLUTE = "revolute"
    PRISMATIC = "prismatic"


class FrictionKind(Enum):
    """Joint friction that is linear in its parameters; the value names it in robot files."""

    NONE = "none"
    VISCOUS_COULOMB = "viscous_coulomb"
    VISCOUS_COULOMB_OFFSET = "viscous_coulomb_offset"
    ASYMMETRIC = "asymmetric"


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionValues:
    """The friction model of a joint and, where known, its values in the model's own order."""

    kind: FrictionKind = FrictionKind.NONE
    values: tuple[float, ...] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Drive:
    """A drive: `gear` motor turns per joint turn, `rotor_inertia` on the *joint* side (kg m^2).

    The reader multiplies a motor-side inertia by gear^2. `torque_constant` is in N m/A on the
    motor side. A joint with `rotor_inertia` set, even to None-valued unknown, has a parameter IA.
    """

    gear: float = 1.0
    has_rotor: bool = False
    rotor_inertia: float | None = None
    torque_constant: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """What the joint may do, in SI units; None where the file says nothing."""

    position: tuple[float, float] | None = None
    velocity: float | None = None
    torque: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Joint:
    """A joint with the link that it moves.

    `parent` is the index of the joint before it, -1 for the base, always less than its own index.
    `inertial` holds XX XY XZ YY YZ ZZ MX MY MZ M about the link frame's origin, where known.
    """

    name: str
    kind: JointKind
    parent: int
    placement: Placement
    inertial: tuple[float, ...] | None = None
    drive: Drive = field(default_factory=Drive)
    friction: FrictionValues = field(default_factory=FrictionValues)
    limits: Limits = field(default_factory=Limits)


@dataclass(frozen=True, slots=True, kw_only=True)
class LogQuantity:
    """Where a quantity stands in a log.

    `columns`: one name per joint, or one name of an array with a column per joint.
    `unit`: of the logged numbers *after* multiplication by `factor` is not applied: the unit is
    that of the raw column; `factor` (one per joint or one for all) turns raw SI into the quantity,
    for example N/V for a motor command in volt. `side` is "joint" or "motor": where the quantity,
    after `factor`, was measured; what is meant on the motor side is converted with the gear ratio.
    """

    columns: tuple[str, ...]
    unit: str
    factor: tuple[float, ...] = (1.0,)
    side: str = "joint"


@dataclass(frozen=True, slots=True, kw_only=True)
class LogMap:
    """Which column of a log is what. A quantity that is None is looked up under its own name."""

    time: LogQuantity | None = None
    position: LogQuantity | None = None
    velocity: LogQuantity | None = None
    torque: LogQuantity | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Decimation:
    """Zero-phase Chebyshev I low-pass and one sample in `factor`, applied alike to all columns.

    `band` is the pass band's edge as a fraction of the new Nyquist frequency.
    """

    factor: int = 1
    order: int = 8
    ripple_db: float = 0.05
    band: float = 0.8


@dataclass(frozen=True, slots=True, kw_only=True)
class Processing:
    """From a recording to states: zero-phase Butterworth, central differences, cut ends, decimation.

    `filter_cutoff` in Hz, None for no filter; `filter_torque` whether the torque passes it too;
    `drop_first`, `drop_last` samples cut off after differentiation; `standstill` the speed (rad/s or
    m/s) below which a joint's rows are left out, because dry friction there is not a function of
    velocity; `noise_freedom` what |e|^2 of m rows is divided by to get the variance of the noise, k
    parameters fitted: "band" m b - k, b the part of the band that decimation lets pass (rows behind a
    filter are not independent), "parameters" m - k, "one" m - 1, as some publications do;
    `automatic` that a cut-off and a decimation that are not stated follow from the sample rate.
    """

    filter_order: int = 4
    filter_cutoff: float | None = None
    filter_torque: bool = False
    drop_first: int = 0
    drop_last: int = 0
    standstill: float = 0.0
    noise_freedom: str = "band"
    automatic: bool = False
    decimation: Decimation = field(default_factory=Decimation)


@dataclass(frozen=True, slots=True, kw_only=True)
class Robot:
    """A robot description: everything later stages need, nothing derived.

    `gravity` is the gravity vector in the base frame (m/s^2), `symbols` the values of
    symbolic lengths (name, m), `convention` what the file stated, `path` where it was read.
    `tip` is the frame at the end of the last link seen from the last link frame (what is left of
    the last standard DH row), `notices` what a reader of the file should know and is no mistake.
    """

    name: str
    joints: tuple[Joint, ...]
    gravity: tuple[Exact, Exact, Exact] = (ZERO, ZERO, Exact.of("-9.81"))
    symbols: tuple[tuple[str, float], ...] = ()
    convention: str = "modified"
    description: str = ""
    source: str = ""
    log: LogMap = field(default_factory=LogMap)
    processing: Processing = field(default_factory=Processing)
    path: str = ""
    tip: Placement = IDENTITY
    notices: tuple[Notice, ...] = ()

    def __post_init__(self) -> None:
        """Check what every later stage relies on.

        Raises:
            RobotError: no joints, a parent that does not come before its joint, a name given twice, or a
                symbol that reads as a coordinate.
        """
        names = [joint.name for joint in self.joints]
        mistakes = [] if names else ["a robot needs at least one joint"]
        mistakes += [
            f"two joints are called {name!r}" for name in dict.fromkeys(names) if names.count(name) > 1
        ]
        for index, joint in enumerate(self.joints):
            if not -1 <= joint.parent < index:
                mistakes.append(f"joint {joint.name!r}: its parent must be the base (-1) or an earlier joint")
        for name in _list_symbols(self):
            if _COORDINATE.fullmatch(name):
                mistakes.append(f"symbolic length {name!r} reads as a coordinate; call it L1, A2 or D3")
        if mistakes:
            raise RobotError(*(Notice(code="robot.invalid", text=text, file=self.path) for text in mistakes))

    @property
    def size(self) -> int:
        """Return the number of joints."""
        return len(self.joints)


def _list_symbols(robot: Robot) -> tuple[str, ...]:
    lengths = [value for joint in robot.joints for value in joint.placement.translation]
    return tuple(sorted({name for value in (*lengths, *robot.gravity) for name in value.symbols}))
