"""Parameters in words: labels and units, groupings as text, and the reason for each grouping.

Robot, label (index, name) -> how the parameter is written, what it belongs to, its unit, and why it is
grouped or eliminated. Indices of couplings follow those of the joints; names end in the joint's number, or
in the coupling's name.
"""

from collections.abc import Sequence
from decimal import Decimal, localcontext

from sympy import Expr, Rational

from symid.dynamics.algebra import Label
from symid.dynamics.friction_effects import get_friction
from symid.joint_models import get_friction_law
from symid.notation import INERTIAL, get_unit, join_name
from symid.robot import JointKind, Robot

_Angular = Sequence[tuple[int, ...]]
_LONGEST = 24
_DIGITS = 400
_INERTIA = ("XX", "XY", "XZ", "YY", "YZ", "ZZ")
_SPRING = ("KS", "KR")
_CONSTANT = ("offset", "Fcp", "Fcn", "KR")
_MOVING = ("Fv", "Fc", "Fvp", "Fvn", "KS")
_FORMS = {"torque": "joint torques", "gravity": "torques at rest"}
_FORMS |= {form: f"the {form}" for form in ("energy", "momentum")}


def get_owner(robot: Robot, label: Label) -> str:
    """Return the name of the joint or coupling that a parameter belongs to."""
    index = label[0]
    return robot.joints[index].name if index < robot.size else robot.couplings[index - robot.size].name


def write_label(robot: Robot, label: Label, *, grouped: bool = False) -> str:
    """Return the parameter as text, for example ZZ2, ZZR2 for the head of a group, IAm6."""
    index, name = label
    end = str(index + 1) if index < robot.size else robot.couplings[index - robot.size].name
    return join_name(f"{name}{'R' if grouped else ''}", end)


def get_label_unit(robot: Robot, label: Label) -> str:
    """Return the SI unit of a parameter."""
    prismatic, law = is_prismatic(robot, label[0]), get_friction_law(get_friction(robot, label[0]))
    for entry in law.linear if law else ():
        if entry.name == label[1]:
            return entry.unit_prismatic if prismatic else entry.unit
    return get_unit(label[1], prismatic=prismatic)


def is_prismatic(robot: Robot, index: int) -> bool:
    """Return whether a joint slides, or a coupling turns with slides alone."""
    if index < robot.size:
        return robot.joints[index].kind is JointKind.PRISMATIC
    terms = robot.couplings[index - robot.size].terms
    return all(robot.joints[joint].kind is JointKind.PRISMATIC for joint, _ in terms)


def write_number(expression: Expr) -> str:
    """Return a coefficient: a decimal, else a fraction or expression; ~ marks 15 digits of a long one."""
    if not isinstance(expression, Rational):
        text = str(expression).replace("**", "^")
        return f"({text})" if " " in text else text
    denominator = expression.q
    for prime in (2, 5):
        while denominator % prime == 0:
            denominator //= prime
    text = str(expression)
    if denominator == 1:
        with localcontext(prec=_DIGITS):
            text = f"{Decimal(expression.p) / Decimal(expression.q):f}"
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


def _describe(robot: Robot, label: Label, angular: _Angular) -> str:
    """Return what a parameter belongs to: a link and how it turns, or a rotor, a spring, friction."""
    index, name = label
    if name in INERTIAL:
        turning = [row for row in angular if row]
        link = f"link {index + 1}"
        if not turning:
            return f"{link} never turns"
        if len(turning) == 1:
            return f"{link} turns about {'its z axis' if turning[0] == (2,) else 'one axis'} only"
        return f"{link} can turn about {'any axis' if len(turning) > 2 else 'two axes'} of its frame"
    kind = "rotor" if name == "IA" else "spring" if name in _SPRING else "friction"
    if index < robot.size:
        return f"{kind} of joint {index + 1}"
    stands = "" if robot.transmission[index] else ", which never turns"
    return f"{kind} of drive {robot.couplings[index - robot.size].name}{stands}"


def explain_grouping(robot: Robot, label: Label, members: Sequence[Label]) -> str:
    """Return why `members` are in a parameter's group: each rule once, behind the names it is true for."""
    index = label[0]
    if not members:
        if index >= robot.size:
            joints = ", ".join(str(joint + 1) for joint, _ in robot.couplings[index - robot.size].terms)
            return f"identifiable on its own: its drive turns with joints {joints}"
        return "identifiable on its own"
    rules: dict[str, list[str]] = {}
    for member in members:
        rules.setdefault(_explain_transfer(robot, member, [label]), []).append(write_label(robot, member))
    return "; ".join(f"{', '.join(names)}: {rule}" for rule, names in rules.items())


def explain_elimination(
    robot: Robot, label: Label, groups: Sequence[tuple[str, Label]], angular: _Angular, form: str = "torque"
) -> str:
    """Return why a parameter is only in `groups`, (name, representative); `angular`, `form` as elsewhere."""
    if not groups:
        return f"no effect on {_FORMS[form]}: {_describe(robot, label, angular)}"
    into = ", ".join(name for name, _ in groups)
    return f"grouped into {into}: {_explain_transfer(robot, label, [head for _, head in groups])}"


def _explain_transfer(robot: Robot, label: Label, heads: Sequence[Label]) -> str:
    """Return the rule by which a parameter has the effect of the representatives of its groups."""
    index, name = label
    if name == "IA":
        return "a rotor's energy is proportional to the square of its speed"
    if name not in INERTIAL:
        steps = [head for head in heads if head[1] in ("Fcp", "Fcn")]
        # Both steps together can make a constant; one of them alone is a function of the speed's sign.
        alone = name in ("Fcp", "Fcn") and len(steps) == 1
        if name not in _CONSTANT or alone or any(head[1] in _MOVING for head in heads):
            return "the same function of the same coordinate"
        force = "force" if is_prismatic(robot, index) else "torque"
        if any(head[1] in INERTIAL for head in heads):
            return f"a constant {force}, like that of a weight along the joint's axis"
        return f"a constant {force}, like that of an offset or of a preload"
    if robot.joints[index].mimic is not None:
        return "a coupled joint moves only with the joint that it follows"
    if robot.joints[index].kind is JointKind.PRISMATIC:
        if name in _INERTIA:
            return "a sliding link does not turn relative to the link before"
        return "as the joint slides, it acts like this moment of the link before"
    if name in ("M", "MZ"):
        return "mass on the axis of a revolute joint moves with the link before"
    if name == "YY":
        return "XX + YY does not change as the joint turns, only XX - YY does"
    return "the same effect as parameters of the links before"
