"""Base parameters in words: groupings as text, and the reason for each of them.

Input: what the exact reduction found. Output: sentences and expressions, ASCII.
"""

from collections.abc import Iterator, Sequence

from sympy import Expr, Rational

from symid.dynamics.labels import Label, write_label
from symid.robot.description import JointKind, Robot

__all__ = ["explain_elimination", "explain_grouping", "write_combination", "write_number"]

_LONGEST = 24
_INERTIA = ("XX", "XY", "XZ", "YY", "YZ", "ZZ")
_FRICTION = ("Fv", "Fc", "Fvp", "Fcp", "Fvn", "Fcn", "offset")
_SPRING = ("KS", "KR")
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


def _describe_motion(robot: Robot, index: int, angular: Sequence[tuple[int, ...]]) -> str:
    """Return how a link can turn, from the angular parts of its attainable velocities."""
    if index >= robot.size:
        joints = ", ".join(str(joint + 1) for joint, _ in robot.couplings[index - robot.size].terms)
        return f"drive {robot.couplings[index - robot.size].name} turns with joints {joints}"
    turning = [row for row in angular if row]
    link = f"link {index + 1}"
    if not turning:
        return f"{link} never turns"
    if len(turning) == 1:
        where = "its z axis" if turning[0] == (2,) else "one axis"
        return f"{link} turns about {where} only"
    return f"{link} can turn about {'any axis' if len(turning) > 2 else 'two axes'} of its frame"


def _describe_drive(robot: Robot, label: Label) -> str:
    """Return what a friction or spring parameter is."""
    index, name = label
    kind = "spring" if name in _SPRING else "friction"
    if index >= robot.size:
        return f"{kind} of drive {robot.couplings[index - robot.size].name}, felt at all of its joints"
    if robot.joints[index].mimic is not None:
        return f"{kind} of joint {index + 1}, felt at the joint that it follows"
    return f"{kind} of joint {index + 1}, felt at this joint alone"


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
    own = label[1] in _FRICTION or label[1] in _SPRING
    motion = _describe_drive(robot, label) if own else _describe_motion(robot, label[0], angular)
    if not members:
        return motion if own else f"{motion}; no other parameter has the same effect"
    others = ", ".join(write_label(robot, member) for member in members)
    if len(members) == 1:
        return f"{motion}; felt only together with {others}: {_explain_transfer(robot, members[0])}"
    return f"{motion}; felt only together with {others}. {'; '.join(_explain_members(robot, members))}"


def _explain_members(robot: Robot, members: Sequence[Label]) -> Iterator[str]:
    """Return why parameters join a group: a sentence for the first of each kind, the others behind it."""
    kinds: dict[str, list[Label]] = {}
    for label in members:
        kinds.setdefault(label[1], []).append(label)
    for first, *rest in kinds.values():
        alike = ", ".join(write_label(robot, label) for label in rest)
        others = f" ({alike}: by their own joints)" if rest else ""
        yield f"{write_label(robot, first)}: {_explain_transfer(robot, first)}{others}"


def explain_elimination(
    robot: Robot,
    label: Label,
    groups: Sequence[tuple[str, Expr]],
    angular: Sequence[tuple[int, ...]],
    form: str = "torque",
) -> str:
    """Return what became of a parameter that is not its own representative.

    Args:
        robot: the robot.
        label: the parameter.
        groups: the base parameters it was grouped into, with its coefficient in each.
        angular: angular components of each attainable velocity of the link.
        form: what is looked at, as in `find_base_parameters`.
    """
    if not groups:
        motion = _describe_motion(robot, label[0], angular)
        return f"no effect: {motion}, and {_SHOWN[form]} shows it"
    into = ", ".join(group for group, _ in groups)
    return f"grouped into {into}: {_explain_transfer(robot, label)}"


def _explain_transfer(robot: Robot, label: Label) -> str:
    index, name = label
    if name == "IA":
        rates = "dq" + str(index + 1) if index < robot.size else "the speed of its drive"
        return f"the rotor's energy is a multiple of {rates}^2, which parameters of the links make as well"
    if index >= robot.size or name in _FRICTION or name in _SPRING:
        return _explain_torque(robot, label)
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


def _explain_torque(robot: Robot, label: Label) -> str:
    """Return why a friction or spring parameter has the effect of another."""
    index, name = label
    number = index + 1
    if name in ("offset", "Fcn", "KR") and index < robot.size:
        return f"it holds a constant force at joint {number}, as a weight along its axis makes one"
    if name in ("offset", "Fcn"):
        return "it holds a constant torque, as other parameters at the same joints do"
    return "it acts on the same coordinate, in proportion to the same function"
