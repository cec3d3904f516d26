"""A robot as a URDF, new or with the robot's own file kept, or as an MJCF model, the format of MuJoCo.

Each joint moves the link or body `<joint>_link`, whose frame is the link frame used here: the axis is z. In a
URDF the base is the link `base`, a link of unknown values has no <inertial>, an unknown limit is 0. In MJCF
a rotor is `armature` (on the joint's side), a coupled drive a fixed tendon, followers are held by equality
constraints, and each joint with a coordinate has a motor: its control is a torque on the motor's side.

In MJCF friction that bends bristles, Dahl and LuGre with gamma 2, is a `dcmotor` without input, damping a
polynomial for the law `cubic`; both are tested with MuJoCo 4.0, and older ones may not read them.

Supported: placements, inertial values, limits, damping and dry friction (the mean of both directions),
followers, gears and rotors; in MJCF also gravity, springs, couplings.
Not supported, and written in a comment: symbols (their values are written), other friction, elastic joints;
in URDF gravity other than (0, 0, -9.81), springs, coupled drives, and rotor inertia, which simulators do not
read. Left out of MJCF: limits of velocity. MuJoCo needs masses.
"""

import math
import re
from collections.abc import Iterator, Sequence
from xml.sax.saxutils import escape, quoteattr

from symid.joint_models import (
    NO_FRICTION,
    FrictionValues,
    get_friction_law,
    list_shape_names,
    list_value_names,
    name_bristles,
    name_values,
)
from symid.robot.description import (
    Coupling,
    Joint,
    JointKind,
    Robot,
)
from symid.robot.geometry import Placement, compute_quaternion, to_floats
from symid.robot.inertia import split_body
from symid.robot.toml_values import BASE

_UNFIT = re.compile(r"[\x00-\x1f\ufffe\uffff]")
TENSOR = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
"""Attributes of <inertia>, in the order of the entries of a tensor."""


def _write_quoted(name: str) -> str:
    """Return a name as the value of an attribute, in quotes."""
    return quoteattr(_UNFIT.sub(" ", name))


def _write_comments(texts: Sequence[str]) -> list[str]:
    """Return comments, one a text."""
    return [f"  <!-- {escape(_UNFIT.sub(' ', text)).replace('--', '- -')} -->" for text in texts]


def write_decimal(value: float) -> str:
    """Return a number with all digits of a double."""
    return repr(float(value) + 0.0)


def write_decimals(values: Sequence[float]) -> str:
    """Return numbers with blanks between them."""
    return " ".join(write_decimal(value) for value in values)


def _write_head(robot: Robot, comments: Sequence[str], omissions: Iterator[str]) -> list[str]:
    """Return comments for the head of a file: those given, values of symbols, and what is left out."""
    symbols = (f"{name} = {write_decimal(value)} m" for name, value in robot.symbols)
    return _write_comments([*comments, *symbols, *omissions])


def get_plain_friction(friction: FrictionValues) -> tuple[float, float] | None:
    """Return damping (N m s/rad or N s/m) and dry friction (N m or N) of a model; None where unknown or none.

    Of a model that tells directions apart it is their mean. What noise made negative is zero: simulators gain
    energy from negative damping, or refuse it.
    """
    if friction.law == NO_FRICTION or friction.values is None:
        return None
    named = name_values(friction)
    groups = (("Fv", "Fvp", "Fvn"), ("Fc", "Fcp", "Fcn"))
    damping, dry = ([named[name] for name in names if name in named] or [0.0] for names in groups)
    return max(0.0, sum(damping) / len(damping)), max(0.0, sum(dry) / len(dry))


def find_bristles(friction: FrictionValues) -> tuple[float, ...] | None:
    """Return sigma0, sigma1, fC, fS, vs of friction with a state that MuJoCo has: Dahl, LuGre with gamma 2.

    dz/dt = v - sigma0 |v| / g z, g = fC + (fS - fC) exp(-(v / vs)^2), torque sigma0 z + sigma1 dz/dt
    ("MuJoCo DC Motor Model", MuJoCo 4.0). The damping is that of the joint.
    """
    if friction.law not in ("dahl", "lugre") or friction.values is None:
        return None
    named = name_values(friction)
    shape = dict(zip(list_shape_names(friction), friction.shape, strict=True))
    coulomb = named["Fc"]
    static, gamma = coulomb + named.get("Fe", 0.0), shape.get("gamma", 2.0)
    if gamma != 2.0 or min(coulomb, static) <= 0.0 or named["Fv"] < 0.0:
        return None
    stiffness, damping = (*friction.bristles, 0.0)[:2]
    return stiffness, damping, coulomb, static, shape.get("vs", 1.0)


def _find_curve(friction: FrictionValues) -> tuple[float, ...] | None:
    """Return the damping times 1, |v| and v^2 of a law that has dry friction besides; else None.

    MuJoCo has such polynomials. One that drives at some speed is left out, since simulations blow up there.
    """
    if friction.law != "cubic" or friction.values is None or friction.smoothing:
        return None
    named = name_values(friction)
    least, slope, most = named["Fv"], named["Fvq"], named["Fvc"]
    brakes = min(least, most, named["Fc"]) >= 0.0 and slope >= -2.0 * math.sqrt(least * most)
    return (least, slope, most) if brakes else None


def list_friction_omissions(owner: str, friction: FrictionValues) -> Iterator[str]:
    """Yield what a friction model has beyond damping and dry friction, with all its values."""
    if friction.law != NO_FRICTION and friction.values is None:
        yield f"{owner}: friction of unknown size ({friction.law})"
    elif friction.law in ("coulomb", "coulomb-viscous"):
        named = name_values(friction)
        parts = (f"{name} = {value:.3g}" for name, value in named.items() if value < 0.0)
        if negative := ", ".join(parts):
            yield f"{owner}: negative friction, {negative}; it is written as 0"
    elif friction.law != NO_FRICTION:
        names = [", ".join(list_value_names(friction))]
        values = write_decimals(friction.values or ())
        text = f"{owner}: friction model {friction.law}, values {values}"
        if friction.shape:
            text += f", shape {write_decimals(friction.shape)}"
            names.append(", ".join(list_shape_names(friction)))
        law = get_friction_law(friction)
        if law is not None and law.memory:
            text += f", state {write_decimals(friction.bristles)}"
            names.append(", ".join(name_bristles(law, friction.bristles)))
        text += f" ({'; '.join(names)})"
        yield f"{text}; only its damping and dry friction, alike in both directions, are written"
    if friction.smoothing:
        yield f"{owner}: dry friction changes its sign over {friction.smoothing}"


def list_elastic_omissions(joint: Joint) -> Iterator[str]:
    """Yield the spring between motor and link of an elastic joint."""
    if spring := joint.elasticity:
        parts = [str(spring.stiffness)]
        parts += [f"damping {spring.damping}"] if spring.damping else []
        parts += [f"cubic {spring.cubic}"] if spring.cubic else []
        parts += [f"stop of {stop.stiffness} to {stop.threshold}" for stop in spring.stops]
        parts += [f"knee of {knee.slope} at {knee.threshold}" for knee in spring.knees]
        yield f"joint {joint.name}: elastic, {', '.join(parts)}; it is written as rigid"


def write_urdf(robot: Robot, *, comments: Sequence[str] = ()) -> str:
    """Return the URDF of `robot`, with comments at its head."""
    lines = ['<?xml version="1.0" encoding="utf-8"?>', f"<robot name={_write_quoted(robot.name)}>"]
    lines += [*_write_head(robot, comments, list_urdf_omissions(robot)), f'  <link name="{BASE}"/>']
    for joint in robot.joints:
        lines += _write_joint(robot, joint)
    for joint in robot.joints:
        drive = joint.drive
        if drive.gear == 1.0 and not drive.has_rotor:
            continue
        lines += [
            f"  <transmission name={_write_quoted(f'{joint.name}_transmission')}>",
            "    <type>transmission_interface/SimpleTransmission</type>",
            f"    <joint name={_write_quoted(joint.name)}/>",
            f"    <actuator name={_write_quoted(f'{joint.name}_motor')}>",
            f"      <mechanicalReduction>{write_decimal(drive.gear)}</mechanicalReduction>",
        ]
        if drive.rotor_inertia is not None:
            # On the motor side, as URDFs have it.
            inertia = write_decimal(drive.rotor_inertia / drive.gear**2)
            lines.append(f"      <motorInertia>{inertia}</motorInertia>")
        lines += ["    </actuator>", "  </transmission>"]
    return "\n".join((*lines, "</robot>", ""))


def list_urdf_omissions(robot: Robot, *, gravity: bool = True) -> Iterator[str]:
    """Yield what a URDF cannot hold, or simulators do not read; new files have it in comments.

    Without `gravity` nothing is said of that.
    """
    down = tuple(value.to_float(dict(robot.symbols)) for value in robot.gravity)
    if gravity and down != (0.0, 0.0, -9.81):
        yield f"gravity of the model: {write_decimals(down)} m/s^2 in the frame of the link {BASE}"
    for joint in robot.joints:
        yield from list_friction_omissions(f"joint {joint.name}", joint.friction)
        if joint.drive.rotor_inertia:
            text = f"joint {joint.name}: rotor inertia {joint.drive.rotor_inertia} on the joint's side"
            yield f"{text}, which simulators call armature; they do not read <motorInertia>"
        if joint.spring is not None:
            yield f"joint {joint.name}: a spring, {joint.spring.stiffness} at rest at {joint.spring.rest}"
        yield from list_elastic_omissions(joint)
    yield from list_drive_omissions(robot)


def list_drive_omissions(robot: Robot) -> Iterator[str]:
    """Yield the coupled drives with their values."""
    for coupling in robot.couplings:
        terms = [f"{float(factor):g} {robot.joints[index].name}" for index, factor in coupling.terms]
        text = f"a drive coupled to several joints, {coupling.name}: {', '.join(terms)}"
        if coupling.rotor_inertia is not None:
            text += f", rotor inertia {coupling.rotor_inertia}"
        if coupling.friction.values:
            values = write_decimals(coupling.friction.values)
            text += f", friction {values} ({', '.join(list_value_names(coupling.friction))})"
        yield text


def _compute_rpy(placement: Placement) -> tuple[float, float, float]:
    """Return roll, pitch, yaw with Rot(z, yaw) Rot(y, pitch) Rot(x, roll) = R; roll 0 where it is free."""
    r = to_floats(placement)
    across = math.hypot(r[0][0], r[1][0])
    pitch = math.atan2(-r[2][0], across)
    if not across:
        return (0.0, pitch, math.atan2(-r[0][1], r[1][1]))
    return (math.atan2(r[2][1], r[2][2]), pitch, math.atan2(r[1][0], r[0][0]))


def write_inertial(parameters: Sequence[float]) -> list[str]:
    """Return the lines of <inertial> for ten standard parameters in the frame of the link."""
    mass, com, central = split_body(parameters)
    tensor = " ".join(f'{key}="{write_decimal(value)}"' for key, value in zip(TENSOR, central, strict=True))
    return [
        "<inertial>",
        f'  <origin xyz="{write_decimals(com)}" rpy="0 0 0"/>',
        f'  <mass value="{write_decimal(mass)}"/>',
        f"  <inertia {tensor}/>",
        "</inertial>",
    ]


def _write_dynamics(joint: Joint) -> list[str]:
    friction = get_plain_friction(joint.friction)
    if friction is None:
        return []
    damping, dry = map(write_decimal, friction)
    return [f'<dynamics damping="{damping}" friction="{dry}"/>']


def _write_joint(robot: Robot, joint: Joint) -> Iterator[str]:
    symbols = dict(robot.symbols)
    link = _write_quoted(f"{joint.name}_link")
    parent = _write_quoted(f"{robot.joints[joint.parent].name}_link" if joint.parent >= 0 else BASE)
    xyz = [value.to_float(symbols) for value in joint.placement.translation]
    inertial = () if joint.inertial is None else write_inertial(joint.inertial)
    yield f"  <link name={link}{'' if inertial else '/'}>"
    yield from (f"    {line}" for line in inertial)
    yield from ("  </link>",) if inertial else ()
    endless = joint.kind is JointKind.REVOLUTE and joint.limits.position is None
    low, high = map(write_decimal, joint.limits.position or (0.0, 0.0))
    ends = "" if endless else f'lower="{low}" upper="{high}" '
    effort, velocity = map(write_decimal, (joint.limits.torque or 0.0, joint.limits.velocity or 0.0))
    yield f'  <joint name={_write_quoted(joint.name)} type="{"continuous" if endless else joint.kind.value}">'
    yield f'    <origin xyz="{write_decimals(xyz)}" rpy="{write_decimals(_compute_rpy(joint.placement))}"/>'
    yield f"    <parent link={parent}/>"
    yield f"    <child link={link}/>"
    yield '    <axis xyz="0 0 1"/>'
    yield f'    <limit {ends}effort="{effort}" velocity="{velocity}"/>'
    yield from (f"    {line}" for line in _write_dynamics(joint))
    if joint.mimic is not None:
        master = _write_quoted(robot.joints[joint.mimic.master].name)
        factor = write_decimal(float(joint.mimic.multiplier))
        yield f'    <mimic joint={master} multiplier="{factor}" offset="0.0"/>'
    yield "  </joint>"


_TYPES = {JointKind.REVOLUTE: "hinge", JointKind.PRISMATIC: "slide"}
# The order of MuJoCo: xx yy zz xy xz yz.
_ORDER = (0, 3, 5, 1, 2, 4)


def write_mjcf(robot: Robot, *, comments: Sequence[str] = ()) -> str:
    """Return the MJCF model of `robot`, with comments at its head."""
    symbols = dict(robot.symbols)
    gravity = write_decimals([value.to_float(symbols) for value in robot.gravity])
    lines = [
        '<?xml version="1.0" encoding="utf-8"?>',
        f"<mujoco model={_write_quoted(robot.name)}>",
        *_write_head(robot, comments, list_mjcf_omissions(robot)),
        '  <compiler angle="radian" autolimits="true"/>',
        f'  <option gravity="{gravity}"/>',
    ]
    names = [_write_quoted(joint.name) for joint in robot.joints]
    tendons, followers, motors = [], [], []
    for coupling in robot.couplings:
        attributes = (f"name={_write_quoted(coupling.name)}", *_list_drive(coupling))
        tendons.append(f"    <fixed {' '.join(attributes)}>")
        for index, factor in coupling.terms:
            tendons.append(f'      <joint joint={names[index]} coef="{write_decimal(float(factor))}"/>')
        tendons.append("    </fixed>")
    for name, joint in zip(names, robot.joints, strict=True):
        if joint.mimic is None:
            motor, gear = _write_quoted(f"{joint.name}_motor"), write_decimal(joint.drive.gear)
            limit = ""
            if (torque := joint.limits.torque) is not None and find_bristles(joint.friction):
                # A limit of the joint would count its bristles as well, which are an actuator.
                force = torque / abs(joint.drive.gear)
                limit = f' forcerange="{write_decimals((-force, force))}"'
            motors.append(f'    <motor name={motor} joint={name} gear="{gear}"{limit}/>')
        else:
            pair = f"joint1={name} joint2={names[joint.mimic.master]}"
            multiple = write_decimal(float(joint.mimic.multiplier))
            followers.append(f'    <joint {pair} polycoef="0 {multiple} 0 0 0"/>')
        if bristles := find_bristles(joint.friction):
            text = f'input="none" motorconst="0" resistance="1" lugre="{write_decimals(bristles)}"'
            motors.append("    <!-- friction with bristles: MuJoCo 4 or later -->")
            motors.append(
                f"    <dcmotor name={_write_quoted(f'{joint.name}_friction')} joint={name} {text}/>"
            )
    bodies = list(_write_bodies(robot))
    sections = {"worldbody": bodies, "tendon": tendons, "equality": followers, "actuator": motors}
    for tag, inner in sections.items():
        lines += [f"  <{tag}>", *inner, f"  </{tag}>"] if inner else []
    return "\n".join((*lines, "</mujoco>", ""))


def list_mjcf_omissions(robot: Robot) -> Iterator[str]:
    """Yield what an MJCF model cannot hold; the file has it in comments."""
    for joint in robot.joints:
        owner = f"joint {joint.name}"
        if find_bristles(joint.friction) is None:
            yield from _list_mjcf_friction_omissions(owner, joint.friction)
        if joint.spring is not None and joint.spring.stiffness is None:
            yield f"{owner}: a spring of unknown stiffness"
        yield from list_elastic_omissions(joint)
    for coupling in robot.couplings:
        yield from _list_mjcf_friction_omissions(f"coupled drive {coupling.name}", coupling.friction)


def _list_mjcf_friction_omissions(owner: str, friction: FrictionValues) -> Iterator[str]:
    if _find_curve(friction) is None:
        yield from list_friction_omissions(owner, friction)


def _write_bodies(robot: Robot) -> Iterator[str]:
    """Yield the bodies, each with all that hangs on it."""
    symbols = dict(robot.symbols)
    children: dict[int, list[int]] = {}
    for index, joint in enumerate(robot.joints):
        children.setdefault(joint.parent, []).append(index)
    # Chains can be longer than calls can be nested, so open bodies wait in a list; -1 closes one.
    waiting = [(index, "    ") for index in reversed(children.get(-1, []))]
    while waiting:
        index, space = waiting.pop()
        if index < 0:
            yield f"{space}</body>"
            continue
        joint = robot.joints[index]
        position = write_decimals([value.to_float(symbols) for value in joint.placement.translation])
        entries = [entry.to_float() for entry in compute_quaternion(joint.placement.rotation)]
        turned = write_decimals([entry / math.hypot(*entries) for entry in entries])
        yield f'{space}<body name={_write_quoted(f"{joint.name}_link")} pos="{position}" quat="{turned}">'
        if joint.inertial is not None and joint.inertial[9]:
            mass, com, central = split_body(joint.inertial)
            place = f'pos="{write_decimals(com)}" mass="{write_decimal(mass)}"'
            tensor = write_decimals([central[k] for k in _ORDER])
            yield f'{space}  <inertial {place} fullinertia="{tensor}"/>'
        attributes = [f'name={_write_quoted(joint.name)} type="{_TYPES[joint.kind]}" axis="0 0 1"']
        if joint.limits.position is not None:
            attributes.append(f'range="{write_decimals(joint.limits.position)}"')
        if (torque := joint.limits.torque) is not None and not find_bristles(joint.friction):
            attributes.append(f'actuatorfrcrange="{write_decimals((-torque, torque))}"')
        attributes += _list_drive(joint)
        if joint.spring is not None and joint.spring.stiffness is not None:
            attributes.append(f'stiffness="{write_decimal(joint.spring.stiffness)}"')
            attributes.append(f'springref="{write_decimal(joint.spring.rest or 0.0)}"')
        yield f"{space}  <joint {' '.join(attributes)}/>"
        waiting.append((-1, space))
        waiting += [(child, f"{space}  ") for child in reversed(children.get(index, []))]


def _list_drive(owner: Joint | Coupling) -> Iterator[str]:
    """Yield the attributes that joints and tendons have in common."""
    if rotor := (owner.drive if isinstance(owner, Joint) else owner).rotor_inertia:
        yield f'armature="{write_decimal(rotor)}"'
    if plain := get_plain_friction(owner.friction):
        yield f'damping="{write_decimals(_find_curve(owner.friction) or plain[:1])}"'
        if plain[1] > 0 and not (isinstance(owner, Joint) and find_bristles(owner.friction)):
            yield f'frictionloss="{write_decimal(plain[1])}"'
