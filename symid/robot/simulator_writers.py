"""A robot in the formats of simulators: as a URDF, as an MJCF model (MuJoCo), as USD text (Isaac Sim).

Each joint moves the link, body or prim `<joint>_link`, whose frame is the link frame used here: the axis is
z. In a URDF the base is the link `base`, a link of unknown values has no <inertial>, an unknown limit is 0.
In MJCF a rotor is `armature` (on the joint's side), a coupled drive a fixed tendon, followers are held by
equality constraints, and the control of a joint's motor is a torque on the motor's side. Friction that bends
bristles, Dahl and LuGre with gamma 2, is a `dcmotor` without input, damping a polynomial for the law `cubic`:
tested with MuJoCo 4.0, older ones may not read them.

USD (.usda) has the schemas of UsdPhysics and PhysX. All links stand side by side below the robot, at their
places with all joints at zero; the base is fixed to the world. Masses, frames and limits are UsdPhysics
(OpenUSD 25.5 and 26.11, physicsSchema). A rotor is `physxJointAxis:<axis>:armature` on the joint's side, and,
for older PhysX, `physxJoint:armature`. Friction is `physxJointAxis:<axis>:` staticFrictionEffort and
dynamicFrictionEffort (N m, N) and viscousFrictionCoefficient, which for turning joints is per degree, as
PhysX multiplies it by 180 / pi (Omni Physics "Physx Joint Schema", ovphysx 0.7.0 "PhysxJointAxisAPI"); PhysX
has them from 5.6 on. Angles of limits, springs and velocities are in degrees. Followers have
`PhysxMimicJointAPI`: q + gearing q_reference + offset = 0 (createMimicJoint of PhysX 5.6); PhysX enforces it
between turning joints with limits (NVIDIA SimReady requirements DJ.004 and DJ.007, 2026). Numbers have all
digits; programs read most of them as single precision.

Supported: placements, inertial values, limits, damping and dry friction (the mean of both directions),
rotors, followers, in USD those that turn; gears in URDF and MJCF; gravity and springs in MJCF and USD;
couplings in MJCF; static friction in USD.
Not supported, and written in a comment: symbols (their values are written), other friction, elastic joints;
in URDF gravity other than (0, 0, -9.81), springs, coupled drives, and rotor inertia, which simulators do not
read; in USD gears, coupled drives, other followers, torque limits of joints with a spring. Left out of MJCF:
limits of velocity. MuJoCo needs masses.
"""

import math
import re
from collections.abc import Iterator, Sequence
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from symid import joint_models
from symid.robot.description import Coupling, Joint, JointKind, Robot
from symid.robot.geometry import IDENTITY, Placement, compose_placements, compute_unit_quaternion, to_floats
from symid.robot.inertia import split_body, to_tensor
from symid.robot.toml_values import BASE
from symid.robot.urdf_xml import TENSOR

_UNFIT = re.compile(r"[\x00-\x1f\ufffe\uffff]")
_TYPES = {JointKind.REVOLUTE: "hinge", JointKind.PRISMATIC: "slide"}
MUJOCO_ORDER = (0, 3, 5, 1, 2, 4)
"""Of xx xy xz yy yz zz, in that of MuJoCo: xx yy zz xy xz yz."""


def _write_quoted(name: str) -> str:
    """Return a name as the value of an attribute, in quotes."""
    return quoteattr(_UNFIT.sub(" ", name))


def write_decimal(value: float) -> str:
    """Return a number with all digits of a double."""
    return repr(float(value) + 0.0)


def write_decimals(values: Sequence[float]) -> str:
    """Return numbers with blanks between them."""
    return " ".join(write_decimal(value) for value in values)


def _write_head(robot: Robot, comments: Sequence[str], omissions: Iterator[str]) -> list[str]:
    """Return comments for the head of a file: those given, values of symbols, and what is left out."""
    symbols = (f"{name} = {write_decimal(value)} m" for name, value in robot.symbols)
    texts = (_UNFIT.sub(" ", text) for text in (*comments, *symbols, *omissions))
    return [f"  <!-- {escape(text).replace('--', '- -')} -->" for text in texts]


def get_plain_friction(friction: joint_models.FrictionValues) -> tuple[float, float] | None:
    """Return damping (N m s/rad or N s/m) and dry friction (N m or N) of a model; None where unknown or none.

    Of a model that tells directions apart it is their mean. What noise made negative is zero: simulators gain
    energy from negative damping, or refuse it.
    """
    if friction.law == joint_models.NO_FRICTION or friction.values is None:
        return None
    named = joint_models.name_values(friction)
    groups = (("Fv", "Fvp", "Fvn"), ("Fc", "Fcp", "Fcn"))
    damping, dry = ([named[name] for name in names if name in named] or [0.0] for names in groups)
    return max(0.0, sum(damping) / len(damping)), max(0.0, sum(dry) / len(dry))


def find_bristles(friction: joint_models.FrictionValues) -> tuple[float, ...] | None:
    """Return sigma0, sigma1, fC, fS, vs of friction with a state that MuJoCo has: Dahl, LuGre with gamma 2.

    dz/dt = v - sigma0 |v| / g z, g = fC + (fS - fC) exp(-(v / vs)^2), torque sigma0 z + sigma1 dz/dt
    ("MuJoCo DC Motor Model", MuJoCo 4.0). The damping is that of the joint.
    """
    if friction.law not in ("dahl", "lugre") or friction.values is None:
        return None
    named = joint_models.name_values(friction)
    shape = dict(zip(joint_models.list_shape_names(friction), friction.shape, strict=True))
    coulomb = named["Fc"]
    static, gamma = coulomb + named.get("Fe", 0.0), shape.get("gamma", 2.0)
    if gamma != 2.0 or min(coulomb, static) <= 0.0 or named["Fv"] < 0.0:
        return None
    stiffness, damping = (*friction.bristles, 0.0)[:2]
    return stiffness, damping, coulomb, static, shape.get("vs", 1.0)


def _find_curve(friction: joint_models.FrictionValues) -> tuple[float, ...] | None:
    """Return the damping times 1, |v|, v^2 of a law with dry friction besides, if it brakes at any speed."""
    if friction.law != "cubic" or friction.values is None or friction.smoothing:
        return None
    named = joint_models.name_values(friction)
    least, slope, most = named["Fv"], named["Fvq"], named["Fvc"]
    brakes = min(least, most, named["Fc"]) >= 0.0 and slope >= -2.0 * math.sqrt(least * most)
    return (least, slope, most) if brakes else None


def list_friction_omissions(owner: str, friction: joint_models.FrictionValues) -> Iterator[str]:
    """Yield what a friction model has beyond damping and dry friction, with all its values."""
    if friction.law != joint_models.NO_FRICTION and friction.values is None:
        yield f"{owner}: friction of unknown size ({friction.law})"
    elif friction.law in ("coulomb", "coulomb-viscous"):
        named = joint_models.name_values(friction)
        parts = (f"{name} = {value:.3g}" for name, value in named.items() if value < 0.0)
        if negative := ", ".join(parts):
            yield f"{owner}: negative friction, {negative}; it is written as 0"
    elif friction.law != joint_models.NO_FRICTION:
        names = [", ".join(joint_models.list_value_names(friction))]
        values = write_decimals(friction.values or ())
        text = f"{owner}: friction model {friction.law}, values {values}"
        if friction.shape:
            text += f", shape {write_decimals(friction.shape)}"
            names.append(", ".join(joint_models.list_shape_names(friction)))
        law = joint_models.get_friction_law(friction)
        if law is not None and law.memory:
            text += f", state {write_decimals(friction.bristles)}"
            names.append(", ".join(joint_models.name_bristles(law, friction.bristles)))
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
    symbols = dict(robot.symbols)
    for joint in robot.joints:
        link = _write_quoted(f"{joint.name}_link")
        parent = _write_quoted(f"{robot.joints[joint.parent].name}_link" if joint.parent >= 0 else BASE)
        xyz = [value.to_float(symbols) for value in joint.placement.translation]
        inertial = () if joint.inertial is None else write_inertial(joint.inertial)
        lines.append(f"  <link name={link}{'' if inertial else '/'}>")
        lines += [f"    {line}" for line in inertial]
        lines += ["  </link>"] if inertial else []
        endless = joint.kind is JointKind.REVOLUTE and joint.limits.position is None
        low, high = map(write_decimal, joint.limits.position or (0.0, 0.0))
        ends = "" if endless else f'lower="{low}" upper="{high}" '
        effort, velocity = map(write_decimal, (joint.limits.torque or 0.0, joint.limits.velocity or 0.0))
        kind = "continuous" if endless else joint.kind.value
        lines.append(f'  <joint name={_write_quoted(joint.name)} type="{kind}">')
        # Rot(z, yaw) Rot(y, pitch) Rot(x, roll) is the rotation; the roll is 0 where it is free.
        r = to_floats(joint.placement)
        across = math.hypot(r[0][0], r[1][0])
        roll, yaw = (r[2][1], r[2][2]), (r[1][0], r[0][0])
        if not across:
            roll, yaw = (0.0, 1.0), (-r[0][1], r[1][1])
        rpy = (math.atan2(*roll), math.atan2(-r[2][0], across), math.atan2(*yaw))
        lines.append(f'    <origin xyz="{write_decimals(xyz)}" rpy="{write_decimals(rpy)}"/>')
        lines.append(f"    <parent link={parent}/>")
        lines.append(f"    <child link={link}/>")
        lines.append('    <axis xyz="0 0 1"/>')
        lines.append(f'    <limit {ends}effort="{effort}" velocity="{velocity}"/>')
        if (friction := get_plain_friction(joint.friction)) is not None:
            damping, dry = map(write_decimal, friction)
            lines.append(f'    <dynamics damping="{damping}" friction="{dry}"/>')
        if joint.mimic is not None:
            master = _write_quoted(robot.joints[joint.mimic.master].name)
            factor = write_decimal(float(joint.mimic.multiplier))
            lines.append(f'    <mimic joint={master} multiplier="{factor}" offset="0.0"/>')
        lines.append("  </joint>")
    for joint in robot.joints:
        drive = joint.drive
        if not drive.gear_stated and not drive.has_rotor:
            continue
        lines += [
            f"  <transmission name={_write_quoted(f'{joint.name}_transmission')}>",
            "    <type>transmission_interface/SimpleTransmission</type>",
            f"    <joint name={_write_quoted(joint.name)}/>",
            f"    <actuator name={_write_quoted(f'{joint.name}_motor')}>",
        ]
        if drive.gear_stated:
            reduction = write_decimal(drive.gear)
            lines.append(f"      <mechanicalReduction>{reduction}</mechanicalReduction>")
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
        if not joint.actuated:
            yield f"joint {joint.name}: it has no motor"
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
            text += f", friction {values} ({', '.join(joint_models.list_value_names(coupling.friction))})"
        yield text


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
        if not joint.actuated:
            continue
        if joint.mimic is None:
            motor, drive, limit = _write_quoted(f"{joint.name}_motor"), joint.drive, ""
            gear = f' gear="{write_decimal(drive.gear)}"' if drive.gear_stated else ""
            if (torque := joint.limits.torque) is not None and find_bristles(joint.friction):
                # A limit of the joint would count its bristles as well, which are an actuator.
                force = torque / abs(drive.gear)
                limit = f' forcerange="{write_decimals((-force, force))}"'
            motors.append(f"    <motor name={motor} joint={name}{gear}{limit}/>")
        else:
            pair = f"joint1={name} joint2={names[joint.mimic.master]}"
            multiple = write_decimal(float(joint.mimic.multiplier))
            followers.append(f'    <joint {pair} polycoef="0 {multiple} 0 0 0"/>')
        if bristles := find_bristles(joint.friction):
            text = f'input="none" motorconst="0" resistance="1" lugre="{write_decimals(bristles)}"'
            motors.append("    <!-- friction with bristles: MuJoCo 4 or later -->")
            motor = _write_quoted(f"{joint.name}_friction")
            motors.append(f"    <dcmotor name={motor} joint={name} {text}/>")
    bodies = list(_write_bodies(robot))
    sections = {"worldbody": bodies, "tendon": tendons, "equality": followers, "actuator": motors}
    for tag, inner in sections.items():
        lines += [f"  <{tag}>", *inner, f"  </{tag}>"] if inner else []
    return "\n".join((*lines, "</mujoco>", ""))


def list_mjcf_omissions(robot: Robot, *, rewritten: bool = False) -> Iterator[str]:
    """Yield what an MJCF model cannot hold, which comments of new files say, or `rewrite_mjcf` leaves out."""
    for joint in robot.joints:
        owner = f"joint {joint.name}"
        if rewritten or (find_bristles(joint.friction) is None and _find_curve(joint.friction) is None):
            yield from list_friction_omissions(owner, joint.friction)
        if joint.spring is not None and joint.spring.stiffness is None:
            yield f"{owner}: a spring of unknown stiffness"
        yield from list_elastic_omissions(joint)
    for coupling in robot.couplings:
        if rewritten or _find_curve(coupling.friction) is None:
            yield from list_friction_omissions(f"coupled drive {coupling.name}", coupling.friction)


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
        turned = write_decimals(compute_unit_quaternion(joint.placement.rotation))
        yield f'{space}<body name={_write_quoted(f"{joint.name}_link")} pos="{position}" quat="{turned}">'
        if joint.inertial is not None and joint.inertial[9]:
            mass, com, central = split_body(joint.inertial)
            place = f'pos="{write_decimals(com)}" mass="{write_decimal(mass)}"'
            tensor = write_decimals([central[k] for k in MUJOCO_ORDER])
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


def write_usd(robot: Robot, *, comments: Sequence[str] = ()) -> str:
    """Return the USD text of `robot`, with comments at its head."""
    names = _choose_names(robot)
    symbols = dict(robot.symbols)
    gravity = [value.to_float(symbols) for value in robot.gravity]
    size = math.hypot(*gravity)
    root = names[-1]
    symbol_values = (f"{name} = {value!r} m" for name, value in robot.symbols)
    head = (*comments, *symbol_values, *list_usd_omissions(robot))
    lines = [
        "#usda 1.0",
        *(f"# {re.sub(r'[^ -~]', ' ', text)}" for text in head),
        f'(\n    defaultPrim = "{root}"',
        '    kilogramsPerUnit = 1\n    metersPerUnit = 1\n    upAxis = "Z"\n)',
        'def PhysicsScene "physicsScene"\n{',
        f"    vector3f physics:gravityDirection = {_write([g / (size or 1.0) for g in gravity])}",
        f"    float physics:gravityMagnitude = {_write(size)}\n}}",
        f'def Xform "{root}" (\n    prepend apiSchemas = ["PhysicsArticulationRootAPI"]\n)\n{{',
    ]
    # The base is fixed, so that its body counts nowhere; without one, programs would make one up.
    lines += _write_body(BASE, IDENTITY, (1.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), symbols)
    places: list[Placement] = []
    for joint in robot.joints:
        before = places[joint.parent] if joint.parent >= 0 else IDENTITY
        places.append(compose_placements(before, joint.placement))
    for name, joint, place in zip(names, robot.joints, places, strict=False):
        lines += _write_body(f"{name}_link", place, joint.inertial, symbols)
    lines.append(f'    def PhysicsFixedJoint "{BASE}_joint"\n    {{')
    lines.append(f"        rel physics:body1 = </{root}/{BASE}>\n    }}")
    for name, joint in zip(names, robot.joints, strict=False):
        bodies = (f"{names[joint.parent]}_link" if joint.parent >= 0 else BASE, f"{name}_link")
        follow = joint.mimic if joint.mimic and _is_held(robot, joint) else None
        # q + gearing times that of the reference joint is zero.
        mimic = list[str]()
        if follow is not None:
            mimic.append(f"float physxMimicJoint:rotZ:gearing = {_write(-float(follow.multiplier))}")
            mimic.append("float physxMimicJoint:rotZ:offset = 0.0")
            mimic.append(f"rel physxMimicJoint:rotZ:referenceJoint = </{root}/{names[follow.master]}>")
        lines += _write_usd_joint(name, joint, [f"</{root}/{body}>" for body in bodies], symbols, mimic)
    return "\n".join((*lines, "}", ""))


def list_usd_omissions(robot: Robot) -> Iterator[str]:
    """Yield what a USD cannot hold, or PhysX does not read; the file has it in comments."""
    for name, joint in zip(_choose_names(robot), robot.joints, strict=False):
        owner = f"joint {joint.name}"
        if name != joint.name:
            text = "since names of USD have letters, digits and _ only, and no two prims the same"
            yield f"{owner}: is called {name}, {text}"
        yield from list_friction_omissions(owner, joint.friction)
        if joint.drive.gear != 1.0:
            yield f"{owner}: gear {joint.drive.gear}; torques are those on the joint's side"
        if joint.mimic is not None and not _is_held(robot, joint):
            master = robot.joints[joint.mimic.master].name
            text = f"{owner}: follows {float(joint.mimic.multiplier):g} times joint {master}, and moves"
            yield f"{text} freely; PhysX holds only turning joints that follow turning ones, both with limits"
        if joint.spring is not None and joint.spring.stiffness is None:
            yield f"{owner}: a spring of unknown stiffness"
        elif joint.spring is not None and joint.limits.torque is not None:
            yield f"{owner}: a torque limit of {joint.limits.torque}, which would limit the spring as well"
        if joint.inertial is not None and not min(joint.inertial[9], *_split_moments(joint.inertial)[0]):
            yield f"{owner}: its link has no mass or no inertia; programs put values of their own there"
        yield from list_elastic_omissions(joint)
    frictions = [(joint.name, get_plain_friction(joint.friction)) for joint in robot.joints]
    if braked := [name for name, plain in frictions if plain is not None and max(plain) > 0]:
        yield f"friction of {', '.join(braked)}: read by PhysX 5.6 or later only, and by no other program"
    yield from list_drive_omissions(robot)


def _is_held(robot: Robot, joint: Joint) -> bool:
    """Return whether PhysX holds a follower: both joints turn, and have limits."""
    pair = (joint, robot.joints[joint.mimic.master if joint.mimic else 0])
    return all(one.kind is JointKind.REVOLUTE and one.limits.position is not None for one in pair)


def _choose_names(robot: Robot) -> list[str]:
    """Return names of prims for the joints, and last that of the robot; `<joint>_link` is free as well."""
    names, taken = list[str](), {BASE, f"{BASE}_joint", "physicsScene"}
    for text in (*(joint.name for joint in robot.joints), robot.name):
        name = re.sub(r"[^A-Za-z0-9_]", "_", text)
        name = name if re.match(r"[A-Za-z_]", name) else f"_{name}"
        while not taken.isdisjoint((name, f"{name}_link")):
            name += "_"
        names.append(name)
        taken |= {name, f"{name}_link"}
    return names


def _write(values: float | Sequence[float]) -> str:
    """Return a number, or several in parentheses, with all digits."""
    if isinstance(values, Sequence):
        return f"({', '.join(map(write_decimal, values))})"
    return write_decimal(values)


def _split_moments(parameters: Sequence[float]) -> tuple[list[float], list[float]]:
    """Return the principal moments about the centre of mass, and their axes as w, x, y, z."""
    xx, xy, xz, yy, yz, zz = split_body(parameters)[2]
    if not (xy or xz or yz):
        return [xx, yy, zz], [1.0, 0.0, 0.0, 0.0]
    moments, axes = np.linalg.eigh(to_tensor((xx, xy, xz, yy, yz, zz)))
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    # The eigenvector of K at its largest eigenvalue is the quaternion (Bar-Itzhack, JGCD 23 (2000) 1085).
    (a, b, c), (d, e, f), (g, h, i) = axes
    K = [[a - e - i, d + b, g + c, h - f], [0, e - a - i, h + f, c - g], [0, 0, i - a - e, d - b]]
    K.append([0, 0, 0, a + e + i])
    x, y, z, w = np.linalg.eigh(np.array(K), UPLO="U")[1][:, 3].tolist()
    return moments.tolist(), [w, x, y, z] if w >= 0 else [-w, -x, -y, -z]


def _write_body(
    name: str, place: Placement, parameters: Sequence[float] | None, symbols: dict[str, float]
) -> Iterator[str]:
    """Yield a rigid body at its place in the frame of the base."""
    apis = '"PhysicsRigidBodyAPI"' + (', "PhysicsMassAPI"' if parameters is not None else "")
    yield f'    def Xform "{name}" (\n        prepend apiSchemas = [{apis}]\n    )\n    {{'
    yield f"        double3 xformOp:translate = {_write([p.to_float(symbols) for p in place.translation])}"
    yield f"        quatd xformOp:orient = {_write(compute_unit_quaternion(place.rotation))}"
    yield '        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:orient"]'
    if parameters is not None:
        mass, com, _ = split_body(parameters)
        moments, axes = _split_moments(parameters)
        yield f"        float physics:mass = {_write(mass)}"
        yield f"        point3f physics:centerOfMass = {_write(com)}"
        yield f"        float3 physics:diagonalInertia = {_write(moments)}"
        yield f"        quatf physics:principalAxes = {_write(axes)}"
    yield "    }"


def _write_usd_joint(
    name: str, joint: Joint, bodies: Sequence[str], symbols: dict[str, float], mimic: Sequence[str]
) -> Iterator[str]:
    turns = joint.kind is JointKind.REVOLUTE
    axis = "angular" if turns else "linear"
    degrees = 180.0 / math.pi if turns else 1.0
    # A drive is a spring, or a limit of the torque.
    drive, prefix = list[str](), f"drive:{axis}:physics"
    if joint.spring is not None and joint.spring.stiffness is not None:
        drive = [
            f'uniform token {prefix}:type = "force"',
            f"float {prefix}:stiffness = {_write(joint.spring.stiffness / degrees)}",
            f"float {prefix}:targetPosition = {_write((joint.spring.rest or 0.0) * degrees)}",
        ]
    elif joint.limits.torque is not None:
        limit = f"float {prefix}:maxForce = {_write(joint.limits.torque)}"
        drive = [f'uniform token {prefix}:type = "force"', limit]
    apis = ["PhysxJointAPI", f"PhysxJointAxisAPI:{axis}"] + [f"PhysicsDriveAPI:{axis}"] * bool(drive)
    apis += ["PhysxMimicJointAPI:rotZ"] * bool(mimic)
    listed = ", ".join(f'"{api}"' for api in apis)
    kind = "PhysicsRevoluteJoint" if turns else "PhysicsPrismaticJoint"
    yield f'    def {kind} "{name}" (\n        prepend apiSchemas = [{listed}]\n    )\n    {{'
    yield f"        rel physics:body0 = {bodies[0]}\n        rel physics:body1 = {bodies[1]}"
    start = [value.to_float(symbols) for value in joint.placement.translation]
    yield f"        point3f physics:localPos0 = {_write(start)}"
    yield f"        quatf physics:localRot0 = {_write(compute_unit_quaternion(joint.placement.rotation))}"
    yield "        point3f physics:localPos1 = (0.0, 0.0, 0.0)"
    yield "        quatf physics:localRot1 = (1.0, 0.0, 0.0, 0.0)"
    yield '        uniform token physics:axis = "Z"'
    if joint.limits.position is not None:
        for end, value in zip(("lower", "upper"), joint.limits.position, strict=True):
            yield f"        float physics:{end}Limit = {_write(value * degrees)}"
    yield from (f"        {line}" for line in (*drive, *mimic))
    values: dict[str, float] = {}
    if joint.drive.rotor_inertia:
        values["armature"] = joint.drive.rotor_inertia
    if joint.limits.velocity is not None:
        values["maxJointVelocity"] = joint.limits.velocity * degrees
    if (plain := get_plain_friction(joint.friction)) is not None:
        named = joint_models.name_values(joint.friction)
        extra = [named[key] for key in ("Fe", "Fep", "Fen") if key in named]
        damping, dry = plain
        if dry:
            values["staticFrictionEffort"] = dry + max(sum(extra) / max(len(extra), 1), 0.0)
            values["dynamicFrictionEffort"] = dry
        if damping:
            values["viscousFrictionCoefficient"] = damping / degrees
    for key, value in values.items():
        yield f"        float physxJointAxis:{axis}:{key} = {_write(value)}"
    if joint.drive.rotor_inertia:
        yield f"        float physxJoint:armature = {_write(joint.drive.rotor_inertia)}"
    yield "    }"
