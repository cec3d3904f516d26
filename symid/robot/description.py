"""The robot: joints in a tree, their links, drives and friction, its controller, and how its logs are read.

Convention: link frame j has the joint's axis as its z axis (modified DH). `placement` is frame j seen from
the parent's frame at q = 0; the joint then turns about z, or moves along it. Other conventions (standard
DH, URDF) are converted exactly by their readers; `Joint.frame` keeps the frame that the file itself gives
to the link.

Controller, on the joint side, v being the joint's velocity as the controller knows it:

    tau = o + tau_ff + Kp (q_ref - q) + Kd (dq_ref - v)    or, with velocity "measured", ... - Kd v

A cascade with position gain kp (1/s) and velocity gain kv (N m s/rad) is this controller with Kp = kp kv
and Kd = kv: its velocity is "measured" where the velocity loop has the position loop's output alone as
reference.

Supported: revolute (continuous too) and prismatic joints, chains and trees, joints that follow another one
(mimic), drives coupled to several joints, springs at joints, a fixed base; joint controllers.
Not supported: closed loops, floating bases; integral parts, coupled control loops.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from enum import Enum
from fractions import Fraction

from symid.errors import Notice, RobotError, UsageError
from symid.joint_models import Elasticity, FrictionValues
from symid.notation import GRAVITY_SYMBOLS
from symid.robot.geometry import IDENTITY, ZERO, Exact, Placement, compose_placements, place_joint
from symid.serialization import compute_signature

UNKNOWN = "unknown"
"""In place of gravity, or of the joints whose zeros are stated: a fit is to find it."""
DEFAULT_GRAVITY = (ZERO, ZERO, Exact.of("-9.81"))
"""Gravity in m/s^2 in the base frame, where nothing else is stated."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LogQuantity:
    """The columns of a quantity in a log, and how their numbers become SI.

    `columns`: one name per joint, or one name of an array with a column per joint. `unit` is that of the raw
    column; `factor` (one per joint or one for all) turns raw SI into the quantity, for example N/V for a
    motor command in volt. `side` is "joint" or "motor", where the quantity, after `factor`, was measured;
    the motor side is converted with the gear ratios, or with the transmission matrix where the map has one.
    `offset` (rad or m, one per joint or one for all) is added to a position last, on the joint side.
    """

    columns: tuple[str, ...]
    unit: str
    factor: tuple[float, ...] = (1.0,)
    side: str = "joint"
    offset: tuple[float, ...] = (0.0,)


@dataclass(frozen=True, slots=True, kw_only=True)
class LogMap:
    """The quantities of a log. One that is None is looked up under its own name.

    `transmission` is the matrix T (n, n) of motors that move more than one joint: angles of the motors =
    T (angles of the joints), torques of the joints = T' (torques of the motors). None: gear ratios.
    `preset` names the program that wrote the log, whose columns stand in for quantities that are None, and
    `topic` which of a bag's topics has them.
    `load` is the torque of sensors behind the gears where `torque` is that of the motors, `temperature` that
    of the joints. `reference`, `reference_velocity` are the controller's setpoints, `feedforward` the torque
    added to its own. `sample_rate` in Hz makes the times of a log without them.
    """

    time: LogQuantity | None = None
    position: LogQuantity | None = None
    velocity: LogQuantity | None = None
    acceleration: LogQuantity | None = None
    torque: LogQuantity | None = None
    motor_position: LogQuantity | None = None
    link_position: LogQuantity | None = None
    load: LogQuantity | None = None
    temperature: LogQuantity | None = None
    reference: LogQuantity | None = None
    reference_velocity: LogQuantity | None = None
    feedforward: LogQuantity | None = None
    transmission: tuple[tuple[float, ...], ...] | None = None
    preset: str | None = None
    topic: str | None = None
    sample_rate: float | None = None


_WORDS = ("transmission", "preset", "topic", "sample_rate")
QUANTITIES = tuple(entry.name for entry in fields(LogMap) if entry.name not in _WORDS)
"""Fields of a LogMap that are quantities."""


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

    `filter_cutoff` in Hz, None for no filter; `filter_torque` whether the torque is filtered too;
    `drop_first`, `drop_last` samples cut off after differentiation; `standstill` the speed (rad/s or m/s,
    one for all joints or one a joint, None for none) below which a joint's rows are left out, because dry
    friction there is not a function of velocity; `instrument_cutoff` in Hz of the positions along which
    instruments are computed; `states` up to which columns of the log the states are used, "position",
    "velocity" or "acceleration": the others are differences, "central" or "fourth-order" ones, which are
    right within 1 % up to a tenth of the sample rate. `noise_freedom` says how deviations follow
    from the residuals of m rows and k parameters: "band" from their spectrum, with m b - k degrees of
    freedom, b the part of the band that decimation lets pass, "parameters" as of white noise with m - k,
    "one" with m - 1, as some publications do. `automatic` that what is not stated is chosen from the logs.
    """

    filter_order: int = 4
    filter_cutoff: float | None = None
    filter_torque: bool = False
    drop_first: int = 0
    drop_last: int = 0
    standstill: float | tuple[float, ...] | None = None
    instrument_cutoff: float | None = None
    states: str = "position"
    differences: str = "central"
    noise_freedom: str = "band"
    automatic: bool = False
    decimation: Decimation = field(default_factory=Decimation)

    @property
    def left_open(self) -> tuple[str, ...]:
        """Return the settings that follow from the logs."""
        free = {
            "filter_cutoff": self.filter_cutoff is None,
            "decimation.factor": self.decimation.factor == 1,
            "standstill": self.standstill is None,
        }
        return tuple(name for name, is_free in free.items() if self.automatic and is_free)

    def get_standstill(self, joint: int) -> float:
        """Return the speed in rad/s or m/s below which rows of a joint, counted from zero, are left out."""
        if isinstance(self.standstill, tuple):
            return self.standstill[joint]
        return self.standstill or 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Controller:
    """Gains and structure of the joint controllers, on the joint side.

    Args:
        stiffness: Kp (n,) N m/rad or N/m. damping: Kd (n,) N m s/rad or N s/m.
        velocity: what the damping acts on, "error" (dq_ref - v) or "measured" (-v).
        velocity_source: of v, "difference" (backward differences of the position) or "sensor" (dq itself).
        velocity_filter: cut-off in Hz of the low-pass of first order that v passes; None for no filter.
        offset: o (n,) N m or N, a constant torque; None where it is taken from the log.
        torque: of the log, the "command" that holds from its sample to the next, or the "average" of the
            periods before and after its sample, as of a sensor.
    """

    stiffness: tuple[float, ...]
    damping: tuple[float, ...]
    velocity: str = "error"
    velocity_source: str = "difference"
    velocity_filter: float | None = None
    offset: tuple[float, ...] | None = None
    torque: str = "command"


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedSettings:
    """Settings that a call can name: tables in place of the robot file's; one that is None stays as it is."""

    name: str
    log: LogMap | None = None
    processing: Processing | None = None
    controller: Controller | None = None


class JointKind(Enum):
    """How a joint moves along or about its z axis."""

    REVOLUTE = "revolute"
    PRISMATIC = "prismatic"


@dataclass(frozen=True, slots=True, kw_only=True)
class Drive:
    """A drive: `gear` motor turns per joint turn, `rotor_inertia` on the *joint* side (kg m^2).

    The reader multiplies a motor-side inertia by gear^2. `torque_constant` is in N m/A on the motor side. A
    joint with a rotor, of known inertia or not, has a parameter IA. `direct` says that a gear of 1 is stated,
    which currents need to become torques; it does not count otherwise.
    """

    gear: float = 1.0
    has_rotor: bool = False
    rotor_inertia: float | None = None
    torque_constant: float | None = None
    direct: bool = False

    @property
    def gear_stated(self) -> bool:
        """Return whether the gear is stated, not taken as 1 for want of a statement."""
        return self.direct or self.gear != 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """What the joint may do, in SI units; None where the file says nothing."""

    position: tuple[float, float] | None = None
    velocity: float | None = None
    torque: float | None = None
    acceleration: float | None = None
    jerk: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Mimic:
    """A joint that follows another one: q = multiplier * q of joint `master` (an index).

    A constant offset belongs into the joint's placement; the master follows no other joint.
    """

    master: int
    multiplier: Fraction


@dataclass(frozen=True, slots=True, kw_only=True)
class MimicStep:
    """A follower as its file writes it: q = multiplier * q of `master` + offset (rad or m).

    `master` is a joint's name; None where the joint is at rest at its offset.
    """

    master: str | None
    multiplier: Fraction
    offset: Exact = ZERO

    def follow(self, steps: Mapping[str, "MimicStep"]) -> Iterator["MimicStep"]:
        """Yield the joint as a follower of its master, of that master's, and so on until a master recurs.

        q = m1 (m2 q'' + o2) + o1; each offset is in the unit of its own joint.
        """
        found, visited = self, set[str]()
        yield found
        while (master := found.master or "") in steps and master not in visited:
            visited.add(master)
            after = steps[master]
            offset = found.offset + Exact.of(found.multiplier) * after.offset
            found = replace(after, multiplier=found.multiplier * after.multiplier, offset=offset)
            yield found


@dataclass(frozen=True, slots=True, kw_only=True)
class Spring:
    """A linear spring at a joint, tau = stiffness * (q - rest): N m/rad and rad, or N/m and m."""

    stiffness: float | None = None
    rest: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class SymbolicInertia:
    """A link whose values are symbols: mass, centre of mass, inertia xx xy xz yy yz zz about the latter.

    Given in the frame that the file gives to the link (`Joint.frame`).
    """

    mass: Exact
    com: tuple[Exact, Exact, Exact]
    inertia: tuple[Exact, Exact, Exact, Exact, Exact, Exact]


@dataclass(frozen=True, slots=True, kw_only=True)
class Joint:
    """A joint with the link that it moves.

    `parent` is the index of the joint before it, -1 for the base, always less than its own index. `inertial`
    holds XX XY XZ YY YZ ZZ MX MY MZ M about the link frame's origin, where known, `form` the link's values in
    symbols. `frame` is the link's frame of the file, seen from the link frame used here. A joint that is not
    `actuated` has no motor: nothing but its friction and spring acts on it.
    """

    name: str
    kind: JointKind
    parent: int
    placement: Placement
    inertial: tuple[float, ...] | None = None
    drive: Drive = field(default_factory=Drive)
    friction: FrictionValues = field(default_factory=FrictionValues)
    limits: Limits = field(default_factory=Limits)
    mimic: Mimic | None = None
    spring: Spring | None = None
    elasticity: Elasticity | None = None
    frame: Placement = IDENTITY
    form: SymbolicInertia | None = None
    actuated: bool = True

    @property
    def prismatic(self) -> bool:
        """Return whether the joint moves along its axis."""
        return self.kind is JointKind.PRISMATIC


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkPlace:
    """A link of a URDF: index of the joint that moves it (-1: none), its frame seen from that link frame."""

    name: str
    joint: int
    placement: Placement


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedBody:
    """A body on the fixed joint `name`, a tool for example, which counts in the link of the joint `carrier`.

    `inertial` are its ten parameters, `own` those of the carrying link without such bodies, None where not
    known; both as the link frame of the carrier sees them.
    """

    name: str
    carrier: str
    inertial: tuple[float, ...] | None
    own: tuple[float, ...] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Coupling:
    """A drive that turns with several joints: its speed is the sum of factor * dq over `terms`.

    `terms` holds (index of a joint, factor); `name` ends the names of its parameters, as in IAm6.
    """

    name: str
    terms: tuple[tuple[int, Fraction], ...]
    has_rotor: bool = False
    rotor_inertia: float | None = None
    friction: FrictionValues = field(default_factory=FrictionValues)


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceFile:
    """The file of another format that a robot was made from.

    Args:
        file: its path; sha256: of its text, in hexadecimal digits.
        base, tip: the links that it was cut at, None for none; snap: as of `read_xml_robot`, rad.
        xacro: arguments that a xacro file was expanded with, name and value.
    """

    file: str
    sha256: str
    base: str | None = None
    tip: str | None = None
    snap: float = 0.0
    xacro: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Robot:
    """A robot description: everything later stages need, nothing derived.

    `gravity` is the gravity vector in the base frame (m/s^2), `symbols` the values of symbols (name, SI),
    `convention` that of the file, `notices` the warnings and notes of its reader. `settings` are sets that
    calls can name; `log`, `processing` and `controller` are those in use; `made_from` is the URDF that it was
    made from. Joints that follow no other, `axes`, have a coordinate each, in the order of the joints. Joints
    and couplings together are numbered through (joints first); the number stands in the labels of their
    parameters. `links` are those of a URDF, with those that became part of others; `fixed` are the bodies on
    fixed joints of any file. What a fit is to find is told by `free_gravity`, whose values are then those of
    symbols, and `free_zeros`, joints by name.
    """

    name: str
    joints: tuple[Joint, ...]
    gravity: tuple[Exact, Exact, Exact] = DEFAULT_GRAVITY
    symbols: tuple[tuple[str, float], ...] = ()
    convention: str = "modified"
    description: str = ""
    source: str = ""
    log: LogMap = field(default_factory=LogMap)
    processing: Processing = field(default_factory=Processing)
    controller: Controller | None = None
    settings: tuple[NamedSettings, ...] = ()
    path: str = ""
    notices: tuple[Notice, ...] = ()
    couplings: tuple[Coupling, ...] = ()
    made_from: SourceFile | None = None
    links: tuple[LinkPlace, ...] = ()
    fixed: tuple[FixedBody, ...] = ()
    free_gravity: bool = False
    free_zeros: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Refuse, by a RobotError, what no later stage can rely on."""
        names, indices = [joint.name for joint in self.joints], range(len(self.joints))
        wrong = [] if names else ["a robot needs at least one joint"]
        wrong += [f"two joints are called {name!r}" for name in dict.fromkeys(names) if names.count(name) > 1]
        for index, joint in enumerate(self.joints):
            owner, follow = f"joint {joint.name!r}", joint.mimic
            if not -1 <= joint.parent < index:
                wrong.append(f"{owner}: its parent must be the base (-1) or an earlier joint")
            if follow and (follow.master not in indices or self.joints[follow.master].mimic is not None):
                wrong.append(f"{owner}: it must follow a joint that follows no other")
            if follow and not follow.multiplier:
                wrong.append(f"{owner}: a multiplier of 0 makes it a fixed joint")
            if not joint.actuated and (follow or joint.elasticity):
                wrong.append(f"{owner}: a joint without a motor follows no other one, and is not elastic")
        names = [coupling.name for coupling in self.couplings]
        for coupling in self.couplings:
            owner, terms = f"coupling {coupling.name!r}", coupling.terms
            if names.count(coupling.name) > 1 or coupling.name.isdigit() or not coupling.name:
                wrong.append(f"{owner}: it needs a name of its own that is no number")
            if not terms or not all(index in indices and factor for index, factor in terms):
                wrong.append(f"{owner}: it must name joints of the robot, with factors that are not 0")
        lengths = [value for joint in self.joints for value in joint.placement.translation]
        for name in sorted({name for value in (*lengths, *self.gravity) for name in value.symbols}):
            if re.fullmatch(r"(s|c|q|dq|ddq)\d+", name):
                wrong.append(f"symbolic length {name!r} reads as a coordinate; call it L1, A2 or D3")
        if wrong:
            raise RobotError(*(Notice(code="robot.invalid", text=text, file=self.path) for text in wrong))

    @property
    def size(self) -> int:
        """Return the number of joints, those that follow another included."""
        return len(self.joints)

    @property
    def coordinates(self) -> tuple[int, ...]:
        """Return the indices of the joints that have a coordinate of their own."""
        return tuple(index for index, joint in enumerate(self.joints) if joint.mimic is None)

    @property
    def freedom(self) -> int:
        """Return the number of coordinates."""
        return len(self.coordinates)

    @property
    def reach(self) -> float:
        """Return the sum of the distances from joint to joint, in m."""
        symbols, steps = dict(self.symbols), (joint.placement.translation for joint in self.joints)
        return sum(math.hypot(*(value.to_float(symbols) for value in step)) for step in steps)

    @property
    def axes(self) -> tuple[Joint, ...]:
        """Return the joints that have a coordinate of their own."""
        return tuple(joint for joint in self.joints if joint.mimic is None)

    def get_stated_frame(self, index: int) -> Placement:
        """Return the frame in which the file states a joint's link, seen from the link frame used here.

        That of the moving link itself: `Joint.frame` is the tip's where a tip is fixed to it.
        """
        return next((link.placement for link in self.links if link.joint == index), self.joints[index].frame)

    @property
    def elastic(self) -> tuple[bool, ...]:
        """Return for each coordinate whether its joint is elastic."""
        return tuple(joint.elasticity is not None for joint in self.axes)

    @property
    def values_signature(self) -> str:
        """Return the signature of all values of the dynamics, which logs simulated from them carry."""
        return compute_signature(self.joints, self.couplings, self.gravity, self.symbols)[:16]

    @property
    def driven(self) -> tuple[int, ...]:
        """Return the positions of the coordinates whose joints have a motor."""
        return tuple(position for position, joint in enumerate(self.axes) if joint.actuated)

    @property
    def passive(self) -> tuple[int, ...]:
        """Return the positions of the coordinates whose joints have no motor."""
        return tuple(position for position, joint in enumerate(self.axes) if not joint.actuated)

    @property
    def transmission(self) -> tuple[tuple[tuple[int, Fraction], ...], ...]:
        """Return, for each joint and then each coupling, its speed as (position of coordinate, factor)."""
        positions = {index: position for position, index in enumerate(self.coordinates)}
        rows: list[tuple[tuple[int, Fraction], ...]] = []
        for index, joint in enumerate(self.joints):
            follow = joint.mimic or Mimic(master=index, multiplier=Fraction(1))
            rows.append(((positions[follow.master], follow.multiplier),))
        for coupling in self.couplings:
            total: dict[int, Fraction] = {}
            for index, factor in coupling.terms:
                position, multiplier = rows[index][0]
                total[position] = total.get(position, Fraction(0)) + factor * multiplier
            rows.append(tuple(sorted((position, factor) for position, factor in total.items() if factor)))
        return tuple(rows)


def refuse_passive_joints(robot: Robot, why: str) -> None:
    """Refuse, by a UsageError that says `why`, a robot some of whose joints have no motor."""
    names = ", ".join(robot.axes[position].name for position in robot.passive)
    if names:
        text = f"robot {robot.name!r} has joints without a motor ({names}, actuated = false): {why}"
        raise UsageError(Notice(code="usage.passive-joint", text=text, file=robot.path))


def free_mounting(robot: Robot, *, gravity: bool = False, zeros: Sequence[str] = ()) -> Robot:
    """Return the robot with gravity, in symbols, or zeros of joints that a fit is to find."""
    zeros = tuple(zeros) or robot.free_zeros
    if not gravity:
        return replace(robot, free_zeros=zeros)
    before = dict(robot.symbols)
    values = zip(GRAVITY_SYMBOLS, (value.to_float(before) for value in robot.gravity), strict=True)
    x, y, z = map(Exact.symbol, GRAVITY_SYMBOLS)
    symbols = before | dict(values)
    told = ", ".join(f"{symbols[name]:g}" for name in GRAVITY_SYMBOLS)
    text = f"gravity is found by identify; all else takes ({told}) m/s^2"
    notices = [notice for notice in robot.notices if notice.code != "robot.assumed-gravity"]
    return replace(
        robot,
        gravity=(x, y, z),
        symbols=tuple(sorted(symbols.items())),
        free_gravity=True,
        free_zeros=zeros,
        notices=(*notices, Notice(code="robot.free-gravity", text=text, file=robot.path)),
    )


def mount_robot(
    robot: Robot, gravity: Sequence[float] = (), zeros: Mapping[str, float] | None = None
) -> Robot:
    """Return the robot under gravity (3,) in m/s^2, with `zeros` (rad or m) added to what joints read.

    Parts of gravity that are not zero are symbols; nothing is left to be found. Followers move with the joint
    that they follow.
    """
    if len(gravity):
        values = dict(zip(GRAVITY_SYMBOLS, map(float, gravity), strict=True))
        x, y, z = (Exact.symbol(name) if value else ZERO for name, value in values.items())
        others = {name: value for name, value in robot.symbols if name not in values}
        symbols = others | {name: value for name, value in values.items() if value}
        robot = replace(robot, gravity=(x, y, z), symbols=tuple(sorted(symbols.items())))
    joints = []
    for joint in robot.joints:
        leader, factor = joint, 1.0
        if joint.mimic is not None:
            leader, factor = robot.joints[joint.mimic.master], float(joint.mimic.multiplier)
        moved = factor * (zeros or {}).get(leader.name, 0.0)
        if moved:
            own = place_joint(Exact.of(repr(moved)), prismatic=joint.prismatic, snap=0.0)
            joint = replace(joint, placement=compose_placements(joint.placement, own))  # noqa: PLW2901
        joints.append(joint)
    return replace(robot, joints=tuple(joints), free_gravity=False, free_zeros=())
