"""What a robot file could say of a joint and does not, as comments to be filled in.

Input: a joint. Output: lines of comments; without their "# " they are valid, with made-up numbers.
"""

from symid.robot.description import Drive, FrictionKind, Joint, JointKind, Limits

__all__ = ["list_drive_hints", "list_hints", "list_limit_hints"]

_COLUMN = 37


def _comment(text: str, meaning: str = "") -> str:
    line = f"# {text}"
    return f"{line:<{_COLUMN}}{'  ' if len(line) >= _COLUMN else ''}# {meaning}" if meaning else line


def list_drive_hints(joint: Joint) -> list[str]:
    """Return what the joint's drive does not say, to stand right behind what it says; nothing without one."""
    return [] if joint.drive == Drive() else _list_drive_lines(joint.drive)


def list_limit_hints(joint: Joint) -> list[str]:
    """Return the limits that the joint does not state, to stand right behind those that it does."""
    return [] if joint.limits == Limits() else _list_limit_lines(joint)


def _list_drive_lines(drive: Drive) -> list[str]:
    lines = []
    if drive.gear == 1:
        lines += [_comment("gear = 100", "motor turns per turn of the joint (motor rad per m of a slide)")]
    if not drive.has_rotor and drive.rotor_inertia is None:
        lines += [
            _comment("rotor_inertia = 1e-5", 'kg m^2, or "unknown": it is identified'),
            _comment('rotor_inertia_side = "motor"', 'or "joint"'),
        ]
    if drive.torque_constant is None:
        lines += [_comment("torque_constant = 0.1", "N m/A, for logs of motor currents")]
    return lines


def _list_limit_lines(joint: Joint) -> list[str]:
    prismatic = joint.kind is JointKind.PRISMATIC
    unit, torque = ("m", "N") if prismatic else ("rad", "N m")
    known = joint.limits
    lines = [
        (known.position, "position = [-1, 1]", unit),
        (known.velocity, "velocity = 2", f"{unit}/s"),
        (known.acceleration, "acceleration = 10", f"{unit}/s^2, kept by symid excite"),
        (known.jerk, "jerk = 100", f"{unit}/s^3, likewise"),
        (known.torque, "torque = 50", torque),
    ]
    return [_comment(text, meaning) for value, text, meaning in lines if value is None]


def list_hints(joint: Joint) -> list[str]:
    """Return the tables that `joint` does not have, each line a comment with its unit and an example."""
    prismatic = joint.kind is JointKind.PRISMATIC
    unit = "m" if prismatic else "rad"
    torque = "N" if prismatic else "N m"
    lines: list[str] = []
    if joint.inertial is None:
        lines += [
            "",
            _comment("[joint.link]"),
            _comment("mass = 1.5", "kg"),
            _comment("com = [0, 0, 0.1]", "m, in the link's frame"),
            _comment("inertia = { xx = 0.01, yy = 0.01, zz = 0.01 }", "kg m^2, about the centre of mass"),
        ]
    if joint.drive == Drive():
        lines += ["", _comment("[joint.drive]"), *_list_drive_lines(joint.drive)]
    if joint.friction.kind is FrictionKind.NONE:
        lines += [
            "",
            _comment("[joint.friction]"),
            _comment('model = "viscous_coulomb_offset"', "with all of these values, or none: unknown"),
            _comment("Fv = 1.0", f"{torque} s/{unit}"),
            _comment("Fc = 2.0", torque),
            _comment("offset = 0.0", torque),
        ]
    if joint.elasticity is None:
        lines += [
            "",
            _comment("[joint.elasticity]"),
            _comment('stiffness = "unknown"', f"{torque}/{unit}, of the gear between motor and link"),
            _comment("damping = 0.0", f"{torque} s/{unit}"),
            _comment(
                "stops = []", f"{{ threshold = {unit}, stiffness = {torque}/{unit} }}: springs that slip"
            ),
            _comment("knees = []", f"{{ threshold = {torque}, slope = 0.5 }}: where the joint gets harder"),
        ]
    if joint.limits == Limits():
        lines += ["", _comment("[joint.limits]"), *_list_limit_lines(joint)]
    return lines
