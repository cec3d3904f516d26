"""Values of base parameters from what the robot file states, as numbers and as formulas.

Input: a robot with inertial values, rotor inertias, springs, friction values; its base parameters.
Output: {name: value} for every base parameter all of whose members are known, and the same as formulas in
the symbols of the file, where it writes symbols.

Supported: links, joints and couplings; numbers beside symbols.
Not supported: links that a fixed joint made heavier, in symbols; their numbers stand for them.
"""

from collections.abc import Iterable
from fractions import Fraction
from typing import Any

from sympy import QQ, Expr, Rational, Symbol, sqrt
from sympy.polys.domains.domain import Domain

from symid.algebra.exact import find_number
from symid.joint.friction import FRICTION_MODELS
from symid.notation import INERTIAL
from symid.parameters.base import BaseParameters, Label
from symid.robot.description import FrictionValues, LinkForm, Robot
from symid.robot.geometry import Exact, Placement

__all__ = ["find_parameter_forms", "find_parameter_values"]


def _list_friction(index: int, friction: FrictionValues) -> dict[Label, float]:
    if friction.values is None:
        return {}
    names = FRICTION_MODELS[friction.kind].parameters
    return {(index, name): value for name, value in zip(names, friction.values, strict=True)}


def _list_known(robot: Robot) -> dict[Label, float]:
    """Return every parameter whose value the file states."""
    known: dict[Label, float] = {}
    for index, joint in enumerate(robot.joints):
        if joint.inertial is not None:
            known |= {(index, name): value for name, value in zip(INERTIAL, joint.inertial, strict=True)}
        if joint.drive.rotor_inertia is not None:
            known[index, "IA"] = joint.drive.rotor_inertia
        if joint.spring is not None and joint.spring.stiffness is not None:
            known[index, "KS"] = joint.spring.stiffness
            if joint.spring.rest is not None:
                known[index, "KR"] = -joint.spring.stiffness * joint.spring.rest
        known |= _list_friction(index, joint.friction)
    for number, coupling in enumerate(robot.couplings):
        index = robot.size + number
        if coupling.rotor_inertia is not None:
            known[index, "IA"] = coupling.rotor_inertia
        known |= _list_friction(index, coupling.friction)
    return known


def find_parameter_values(robot: Robot, base: BaseParameters) -> dict[str, float]:
    """Return beta = K pi for every base parameter whose members are all known, in SI units."""
    known = _list_known(robot)
    symbols = {Symbol(name): value for name, value in robot.symbols}
    result: dict[str, float] = {}
    for parameter in (*base.parameters, *base.friction):
        if all(label in known for label, _ in parameter.terms):
            result[parameter.name] = sum(
                float(coefficient.subs(symbols)) * known[label] for label, coefficient in parameter.terms
            )
    return result


def find_parameter_forms(robot: Robot, base: BaseParameters) -> dict[str, Expr]:
    """Return beta = K pi as formulas in the file's symbols, for every base parameter that has one.

    A base parameter has one where all its members are known and a symbol takes part: ZZR1 of the textbook
    arm is I1 + m1*lc1^2 + m2*L1^2. Numbers stand with 15 digits.
    """
    if not robot.symbols:
        return {}
    numbers, field = _find_field(robot)
    known = {label: field.convert(_to_rational(value)) for label, value in _list_known(robot).items()}
    for index, joint in enumerate(robot.joints):
        if joint.form is not None:
            entries = _move_form(joint.form, joint.frame, numbers, field)
            known |= {(index, name): value for name, value in zip(INERTIAL, entries, strict=True)}
    forms: dict[str, Expr] = {}
    for parameter in (*base.parameters, *base.friction):
        if all(label in known for label, _ in parameter.terms):
            terms = (field.from_sympy(factor) * known[label] for label, factor in parameter.terms)
            total = sum(terms, field.zero)
            if not _is_number(total):
                forms[parameter.name] = field.to_sympy(total)
    return forms


def _is_number(value: Any) -> bool:  # noqa: ANN401  an element of a SymPy domain has no type of its own
    return bool(value.numer.is_ground and value.denom.is_ground)


def _to_rational(value: float) -> Rational:
    # Sums and products of the file's decimals, without their rounding.
    exact = Fraction(f"{value:.15g}")
    return QQ(exact.numerator, exact.denominator)


def _find_field(robot: Robot) -> tuple[Domain, Domain]:
    """Return the numbers that the robot's forms need, and the rational functions of its symbols over them."""
    used = [any(surd[k] for value in _list_exact(robot) for _, surd in value.terms) for k in range(4)]
    roots = [sqrt(root) for root, needed in ((2, used[1] or used[3]), (3, used[2] or used[3])) if needed]
    numbers: Domain = QQ.algebraic_field(*roots) if roots else QQ
    return numbers, numbers.frac_field(*(Symbol(name) for name, _ in robot.symbols))


def _list_exact(robot: Robot) -> Iterable[Exact]:
    for joint in robot.joints:
        for placement in (joint.placement, joint.frame):
            yield from placement.translation
            for row in placement.rotation:
                yield from row
        if joint.form is not None:
            yield joint.form.mass
            yield from joint.form.com
            yield from joint.form.inertia


def _move_form(form: LinkForm, frame: Placement, numbers: Domain, field: Domain) -> tuple[Any, ...]:
    """Return the ten standard parameters about the link frame's origin, in the order of the notation.

    With R, p the frame of the form: c = R c' + p, s = m c, I = R I' R^T + m (c.c 1 - c c^T).
    """

    def convert(value: Exact) -> Any:  # noqa: ANN401  an element of `field`
        return find_number(value, numbers, field)

    rotation = [[convert(entry) for entry in row] for row in frame.rotation]
    given = [convert(entry) for entry in form.com]
    xx, xy, xz, yy, yz, zz = (convert(entry) for entry in form.inertia)
    central = ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))
    mass = convert(form.mass)
    axes = range(3)
    com = [sum((rotation[i][k] * given[k] for k in axes), convert(frame.translation[i])) for i in axes]
    square = sum((entry * entry for entry in com), field.zero)

    def find_entry(i: int, j: int) -> Any:  # noqa: ANN401  an element of `field`
        turned = sum(
            (rotation[i][k] * central[k][n] * rotation[j][n] for k in axes for n in axes), field.zero
        )
        return turned + mass * ((square if i == j else field.zero) - com[i] * com[j])

    tensor = [find_entry(i, j) for i in axes for j in axes if i <= j]
    return (*tensor, *(mass * entry for entry in com), mass)
