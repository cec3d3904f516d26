"""Parameters in words: labels and units, groupings as text, and the reason for each grouping.

Robot, label (index, name) -> how the parameter is written, what it belongs to, its unit. Indices of
couplings follow those of the joints; a parameter of joint 2 ends in 2, one of a coupling in the coupling's
name.
What the exact reduction found -> expressions and sentences, ASCII.

Supported: link, drive, spring and friction parameters.
"""

from collections.abc import Iterator, Sequence

from sympy import Expr, Rational

from symid.dynamics.algebra import Label
from symid.notation import INERTIAL, get_unit
from symid.robot import JointKind, Robot


def get_owner(robot: Robot, label: Label) -> str:
    """Return the name of the joint or coupling that a parameter belongs to."""
    index = label[0]
    return robot.joints[index].name if index < robot.size else robot.couplings[index - robot.size].name


def write_label(robot: Robot, label: Label, *, grouped: bool = False) -> str:
    """Return the parameter as text, for example ZZ2, ZZR2 for the head of a group, IAm6."""
    index, name = label
    end = str(index + 1) if index < robot.size else robot.couplings[index - robot.size].name
    return f"{name}{'R' if grouped else ''}{end}"


def get_label_unit(robot: Robot, label: Label) -> str:
    """Return the SI unit of a parameter."""
    return get_unit(label[1], prismatic=is_prismatic(robot, label[0]))


def is_prismatic(robot: Robot, index: int) -> bool:
    """Return whether a joint slides, or a coupling turns with slides alone."""
    if index < robot.size:
        return robot.joints[index].kind is JointKind.PRISMATIC
    terms = robot.couplings[index - robot.size].terms
    return all(robot.joints[joint].kind is JointKind.PRISMATIC for joint, _ in terms)


_LONGEST = 24
_INERTIA = ("XX", "XY", "XZ", "YY", "YZ", "ZZ")
_FRICTION = ("Fv", "Fc", "Fvp", "Fcp", "Fvn", "Fcn", "offset")
_SPRING = ("KS", "KR")
_CONSTANT = ("offset", "Fcp", "Fcn", "KR")
_MOVING = ("Fv", "Fc", "Fvp", "Fvn", "KS")
_SHOWN = {
    "torque": "neither motion nor gravity",
    "energy": "neither kinetic nor potential energy",
    "momentum": "no momentum",
    "gravity": "no torque at rest",
}


def write_number(expression: Expr) -> str:
    """Return a coefficient as text: a decimal where it is one, else a fraction or an expression.

    Fractions longer than 24 characters are shown with 15 digits, marked by a tilde.
    """
    if not isinstance(expression, Rational):
        text = str(expression).replace("**", "^")
        return f"({text})" if " " in text else text
    denominator, places = expression.q, 0
    for prime in (2, 5):
        count = 0
        while denominator % prime == 0:
            denominator //= prime
            count += 1
        places = max(places, count)
    if denominator == 1:
        digits = str(abs(expression.p) * 10**places // expression.q).rjust(places + 1, "0")
        text = f"{digits[:-places]}.{digits[-places:]}" if places else digits
        text = f"-{text}" if expression.p < 0 else text
    else:
        text = str(expression)
    return text if len(text) <= _LONGEST else f"~{float(expression):.15g}"


def write_combination(terms: Sequence[tuple[str, Expr]]) -> str:
    """Return a sum such as `ZZ1 + YY2 - 0.25*M2`."""
    text = ""
    for name, value in terms:
        number = write_number(value)
        negative = number.startswith(("-", "~-"))
        number = number.replace("-", "", 1) if negative else number
        term = name if number == "1" else f"{number}*{name}"
        if not text:
            text = f"-{term}" if negative else term
        else:
            text += f" - {term}" if negative else f" + {term}"
    return text


def _describe_motion(index: int, angular: Sequence[tuple[int, ...]]) -> str:
    """Return how a link can turn, from the angular parts of its attainable velocities."""
    turning = [row for row in angular if row]
    link = f"link {index + 1}"
    if not turning:
        return f"{link} never turns"
    if len(turning) == 1:
        where = "its z axis" if turning[0] == (2,) else "one axis"
        return f"{link} turns about {where} only"
    return f"{link} can turn about {'any axis' if len(turning) > 2 else 'two axes'} of its frame"


def _describe(robot: Robot, label: Label, angular: Sequence[tuple[int, ...]]) -> str:
    """Return what a parameter belongs to: a link and how it turns, or a rotor, a spring, friction."""
    index, name = label
    if name in INERTIAL:
        return _describe_motion(index, angular)
    kind = "rotor" if name == "IA" else "spring" if name in _SPRING else "friction"
    if index < robot.size:
        return f"{kind} of joint {index + 1}"
    drive = robot.couplings[index - robot.size]
    if not robot.transmission[index]:
        return f"{kind} of drive {drive.name}, which stands still: its factors cancel"
    joints = ", ".join(str(joint + 1) for joint, _ in drive.terms)
    return f"{kind} of drive {drive.name}, which turns with joints {joints}"


def _describe_place(robot: Robot, label: Label) -> str:
    """Return where a parameter without others in its group is felt."""
    index, name = label
    if name in (*INERTIAL, "IA"):
        return "no other parameter has the same effect"
    if index >= robot.size:
        return "felt at all of them"
    if robot.joints[index].mimic is not None:
        return "felt at the joint that it follows"
    return "felt at this joint alone"


def explain_grouping(
    robot: Robot, label: Label, members: Sequence[Label], angular: Sequence[tuple[int, ...]]
) -> str:
    """Return why a representative stands for its group.

    Args:
        robot: the robot.
        label: the representative.
        members: the other members of its group.
        angular: angular components of each attainable velocity of the link.
    """
    what = _describe(robot, label, angular)
    if not members:
        mark = ", " if label[1] in (*_FRICTION, *_SPRING) else "; "
        return f"{what}{mark}{_describe_place(robot, label)}"
    others = ", ".join(write_label(robot, member) for member in members)
    if len(members) == 1:
        return f"{what}; felt only together with {others}: {_explain_transfer(robot, members[0], [label])}"
    return f"{what}; felt only together with {others}. {'; '.join(_explain_members(robot, label, members))}"


def _explain_members(robot: Robot, head: Label, members: Sequence[Label]) -> Iterator[str]:
    """Return why parameters join a group: a sentence for the first of each kind, the others behind it."""
    kinds: dict[str, list[Label]] = {}
    for label in members:
        kinds.setdefault(label[1], []).append(label)
    for first, *rest in kinds.values():
        alike = ", ".join(write_label(robot, label) for label in rest)
        others = f" ({alike}: likewise)" if rest else ""
        yield f"{write_label(robot, first)}: {_explain_transfer(robot, first, [head])}{others}"


def explain_elimination(
    robot: Robot,
    label: Label,
    groups: Sequence[tuple[str, Label]],
    angular: Sequence[tuple[int, ...]],
    form: str = "torque",
) -> str:
    """Return what became of a parameter that is not its own representative.

    Args:
        robot: the robot.
        label: the parameter.
        groups: the base parameters it was grouped into, and their representatives.
        angular: angular components of each attainable velocity of the link.
        form: what is looked at, as in `derive_base_parameters`.
    """
    if not groups:
        return f"no effect: {_describe(robot, label, angular)}, and {_SHOWN[form]} shows it"
    into = ", ".join(name for name, _ in groups)
    heads = [head for _, head in groups]
    return f"grouped into {into}: {_explain_transfer(robot, label, heads)}"


def _explain_transfer(robot: Robot, label: Label, heads: Sequence[Label]) -> str:
    """Return why a parameter has the effect of those that stand for its groups."""
    index, name = label
    if name == "IA":
        rate = f"dq{index + 1}" if index < robot.size else "its speed"
        return f"the rotor's energy goes with the square of {rate}, as that of other parameters does"
    if name not in INERTIAL:
        return _explain_torque(robot, label, heads)
    parent = robot.joints[index].parent
    carrier = f"link {parent + 1}" if parent >= 0 else "the base"
    number = index + 1
    if robot.joints[index].mimic is not None:
        return f"joint {number} moves only together with the joint that it follows, and so do their effects"
    if robot.joints[index].kind is JointKind.PRISMATIC:
        if name in _INERTIA:
            return f"link {number} does not turn against {carrier}, so its inertia adds to that link's"
        return f"where joint {number} slides, this moment does the same work as {carrier}'s own"
    if name in ("M", "MZ"):
        return (
            f"mass on the axis of joint {number} stays put when the joint turns, so it moves with {carrier}"
        )
    if name == "YY":
        own = f"XX{number} {{}} YY{number}"
        return (
            f"{own.format('+')} is the same however joint {number} turns: only {own.format('-')} shows there"
        )
    return f"at joint {number} its effect equals that of parameters of {carrier} or before"


def _explain_torque(robot: Robot, label: Label, heads: Sequence[Label]) -> str:
    """Return why a friction or spring parameter has the effect of another."""
    index, name = label
    steps = [head for head in heads if head[1] in ("Fcp", "Fcn")]
    # Both steps together can make a constant; one of them alone is a function of the speed's sign.
    alone = name in ("Fcp", "Fcn") and len(steps) == 1
    if name not in _CONSTANT or alone or any(head[1] in _MOVING for head in heads):
        return "it acts on the same coordinate, in proportion to the same function"
    sliding = is_prismatic(robot, index)
    force = "force" if sliding else "torque"
    place = f" at joint {index + 1}" if index < robot.size else ""
    if any(head[1] in INERTIAL for head in heads):
        return f"it holds a constant {force}{place}, as a weight along its axis makes one"
    alike = ", ".join(write_label(robot, head) for head in heads if head[1] in _CONSTANT)
    return f"it holds a constant {force}{place}, as {f'{alike} does' if alike else 'others of the group do'}"
