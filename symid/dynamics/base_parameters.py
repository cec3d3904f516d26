"""The exact base parameters: the combinations of parameters that a motion can show, why, and their values.

Robot -> `BaseParameters`: the grouping beta = K pi, its representatives, and for every eliminated parameter
the reason. Robot, base parameters -> {name: value} for every base parameter all of whose members the robot
file states, and the same as formulas in the symbols of the file.

Supported: trees; rotors, coupled drives and springs; joints that follow others; friction, whose offsets can
coincide with a weight; symbolic lengths (generic values: no pivot vanishes); numbers beside symbols.
Not supported: formulas of links that a fixed joint made heavier; their numbers are used.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

import numpy as np
from sympy import QQ, Expr, Integer, Symbol
from sympy.polys.domains.domain import Domain
from sympy.polys.matrices import DomainMatrix

from symid.arrays import FloatArray
from symid.dynamics import exact_algebra
from symid.dynamics.algebra import Label
from symid.dynamics.bodies import DRIVE_PARAMETERS, list_drive_parameters
from symid.dynamics.explanations import explain_elimination, explain_grouping, write_combination, write_label
from symid.dynamics.friction_effects import list_friction_parameters
from symid.dynamics.observable_subspace import derive_observable_subspace
from symid.errors import Notice, RobotError
from symid.joint_models import list_value_names
from symid.notation import INERTIAL
from symid.robot import Coupling, Exact, Joint, Placement, Robot, SymbolicInertia, move_by_placement

BASE_FORMS = ("torque", "energy", "momentum", "gravity")
_INERTIAL = (*INERTIAL, *DRIVE_PARAMETERS)


@dataclass(frozen=True, slots=True)
class BaseParameter:
    """A base parameter: its representative `label` and its group, `terms`, with exact coefficients."""

    name: str
    label: Label
    terms: tuple[tuple[Label, Expr], ...]
    expression: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class EliminatedParameter:
    """A parameter that is not its own representative: no effect, or grouped into others."""

    name: str
    label: Label
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class BaseParameters:
    """The base set of a robot.

    `parameters` are the inertial ones (drives included), `friction` those of the friction models, in the
    order of the vectors beta and f; `labels` the columns of K, all parameters in their canonical order.
    `vector` is the name of the inertial ones: beta, or pi or pi_internal for all standard parameters.
    """

    robot: str
    labels: tuple[Label, ...]
    parameters: tuple[BaseParameter, ...]
    friction: tuple[BaseParameter, ...]
    eliminated: tuple[EliminatedParameter, ...]
    vector: str = "beta"

    @property
    def count(self) -> int:
        """Return the number of base inertial parameters."""
        return len(self.parameters)

    @property
    def null_space(self) -> tuple[tuple[tuple[Label, Expr], ...], ...]:
        """Return the changes of parameters that nothing shows, one for each eliminated parameter.

        A unit of the eliminated parameter, and what the representatives of its groups give up for it.
        """
        heads: dict[Label, list[tuple[Label, Expr]]] = {entry.label: [] for entry in self.eliminated}
        for parameter in (*self.parameters, *self.friction):
            for label, coefficient in parameter.terms[1:]:
                heads[label].append((parameter.label, -coefficient))
        return tuple(((label, Integer(1)), *others) for label, others in heads.items())

    @property
    def keys(self) -> tuple[Label, ...]:
        """Return the representatives of beta, in order."""
        return tuple(parameter.label for parameter in self.parameters)


def _label_parameters(robot: Robot) -> tuple[Label, ...]:
    """Return all parameters in canonical order: links from the base, then couplings, then friction."""
    drives = list_drive_parameters(robot)
    labels: list[Label] = []
    for index in range(robot.size):
        labels += [(index, name) for name in INERTIAL]
        labels += [label for label in drives if label[0] == index]
    labels += [label for label in drives if label[0] >= robot.size]
    return (*labels, *list_friction_parameters(robot))


def build_standard_parameters(robot: Robot, *, internal: bool = False) -> BaseParameters:
    """Return all parameters, each for itself: K is the unit matrix, and some of them show nowhere.

    Those of links are about the frames of the robot file, vector "pi"; `internal`: about the link frames used
    here, whose z is the joint's axis, vector "pi_internal".
    """
    labels, reason = _label_parameters(robot), "standard parameter, on its own"
    named = [(label, write_label(robot, label)) for label in labels]
    entries = [BaseParameter(name, label, ((label, Integer(1)),), name, reason) for label, name in named]
    return BaseParameters(
        robot=robot.name,
        labels=labels,
        parameters=tuple(entry for entry in entries if entry.label[1] in _INERTIAL),
        friction=tuple(entry for entry in entries if entry.label[1] not in _INERTIAL),
        eliminated=(),
        vector="pi_internal" if internal else "pi",
    )


@lru_cache(maxsize=16)
def derive_base_parameters(robot: Robot, *, form: str = "torque") -> BaseParameters:
    """Return the exact base parameters of `robot`.

    The representatives are the first ones in canonical order, links from the base and XX XY XZ YY YZ
    ZZ MX MY MZ M IA KS KR within a link; this reproduces Khalil's convention (YY, MZ and M of a revolute
    link are grouped into it and into the link before).

    The form "torque" takes all that joint torques show, "energy" what kinetic and potential energy show, up
    to a constant (the same without friction), "momentum" what the momentum dT/ddq shows, "gravity" what
    torques at rest show, springs included, friction apart.

    Raises:
        ValueError: there is no such form.
        RobotError: three joints share a coordinate, next to symbolic lengths and angles with roots.
    """
    if form not in BASE_FORMS:
        message = f"there is no form {form!r}; allowed are {', '.join(BASE_FORMS)}"
        raise ValueError(message)
    friction = form == "torque"
    labels = tuple(label for label in _label_parameters(robot) if friction or label[1] in _INERTIAL)
    column = {label: index for index, label in enumerate(labels)}
    field, shown, visible = derive_observable_subspace(robot, form)
    known = ({column[label]: value for label, value in row.items() if label in column} for row in shown)
    written: list[BaseParameter] = []
    groups: dict[Label, list[tuple[str, Label]]] = {label: [] for label in labels}
    for row in exact_algebra.reduce_rows(known):
        terms = tuple((labels[column], field.to_sympy(value)) for column, value in sorted(row.items()))
        label, members = terms[0][0], [other for other, _ in terms[1:]]
        name = write_label(robot, label, grouped=bool(members))
        expression = write_combination([(write_label(robot, other), value) for other, value in terms])
        reason = explain_grouping(robot, label, members)
        written.append(BaseParameter(name, label, terms, expression, reason))
        for other, _ in terms:
            groups[other].append((name, label))
    kept = {parameter.label for parameter in written}
    eliminated = []
    for label in labels:
        if label not in kept:
            # Which components of the angular velocity each attainable velocity of the link holds.
            rows = visible[label[0]].velocities if label[0] < robot.size else ()
            angular = [tuple(sorted(column for column in row if column < 3)) for row in rows]
            reason = explain_elimination(robot, label, groups[label], angular, form)
            name = write_label(robot, label)
            eliminated.append(EliminatedParameter(name=name, label=label, reason=reason))
    return BaseParameters(
        robot=robot.name,
        labels=labels,
        parameters=tuple(p for p in written if p.label[1] in _INERTIAL),
        friction=tuple(p for p in written if p.label[1] not in _INERTIAL),
        eliminated=tuple(eliminated),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Grouping:
    """K in numbers: `matrix` has a row for each of `parameters` and a column for each of `labels`."""

    parameters: tuple[BaseParameter, ...]
    labels: tuple[Label, ...]
    matrix: FloatArray


def build_grouping(robot: Robot, base: BaseParameters, names: Sequence[str] | None = None) -> Grouping:
    """Return the grouping matrix K in numbers, or raise a RobotError for a symbolic length without a value.

    `names`: the base parameters wanted, friction too; all of beta if None.
    """
    missing = [name for name in exact_algebra.list_symbols(robot) if name not in dict(robot.symbols)]
    if missing:
        text = f"symbolic lengths without a value: {', '.join(missing)}; add them under [symbols], in m"
        raise RobotError(Notice(code="robot.symbol-without-value", text=text, file=robot.path))
    symbols = {Symbol(name): value for name, value in robot.symbols}
    wanted = base.parameters
    if names is not None:
        wanted = tuple(p for p in (*base.parameters, *base.friction) if p.name in names)
    column = {label: index for index, label in enumerate(base.labels)}
    matrix = np.zeros((len(wanted), len(base.labels)))
    for row, parameter in enumerate(wanted):
        for label, coefficient in parameter.terms:
            number = coefficient if coefficient.is_number else coefficient.subs(symbols)
            matrix[row, column[label]] = float(number)
    return Grouping(parameters=wanted, labels=base.labels, matrix=matrix)


def list_known_values(robot: Robot) -> dict[Label, float]:
    """Return every parameter whose value the file states."""
    known: dict[Label, float] = {}
    for index, joint in enumerate(robot.joints):
        known |= {(index, name): value for name, value in zip(INERTIAL, joint.inertial or (), strict=False)}
        if joint.spring is not None and joint.spring.stiffness is not None:
            known[index, "KS"] = joint.spring.stiffness
            if joint.spring.rest is not None:
                known[index, "KR"] = -joint.spring.stiffness * joint.spring.rest
    owners: tuple[Joint | Coupling, ...] = (*robot.joints, *robot.couplings)
    for index, owner in enumerate(owners):
        rotor = owner.drive.rotor_inertia if isinstance(owner, Joint) else owner.rotor_inertia
        if rotor is not None:
            known[index, "IA"] = rotor
        names = list_value_names(owner.friction)
        known |= {(index, name): v for name, v in zip(names, owner.friction.values or (), strict=False)}
    return known


def compute_parameter_values(robot: Robot, base: BaseParameters) -> dict[str, float]:
    """Return beta = K pi for every base parameter whose members are all known, in SI units."""
    known = list_known_values(robot)
    for index, joint in enumerate(robot.joints if base.vector == "pi" else ()):
        if joint.inertial is not None:
            place, lengths = robot.get_stated_frame(index), dict(robot.symbols)
            stated = move_by_placement(joint.inertial, place, lengths, inverse=True)
            known |= {(index, name): value for name, value in zip(INERTIAL, stated, strict=True)}
    symbols = {Symbol(name): value for name, value in robot.symbols}
    result: dict[str, float] = {}
    for parameter in (*base.parameters, *base.friction):
        if all(label in known for label, _ in parameter.terms):
            result[parameter.name] = sum(
                float(coefficient.subs(symbols)) * known[label] for label, coefficient in parameter.terms
            )
    return result


def derive_parameter_formulas(robot: Robot, base: BaseParameters) -> dict[str, Expr]:
    """Return beta = K pi as formulas in the file's symbols, for every base parameter that has one.

    A base parameter has one where all its members are known and a symbol takes part: ZZR1 of the textbook
    arm is I1 + m1*lc1^2 + m2*L1^2. Numbers have 15 digits.
    """
    if not robot.symbols:
        return {}
    # The exact numbers that the file's symbolic inertias are transformed with.
    constants = list[Exact]()
    for joint in robot.joints:
        constants += exact_algebra.list_placement_constants(joint.frame)
        constants += [joint.form.mass, *joint.form.com, *joint.form.inertia] if joint.form else []
    numbers = exact_algebra.choose_domain(robot, constants)
    field = numbers.frac_field(*(Symbol(name) for name, _ in robot.symbols))
    known: dict[Label, exact_algebra.Number] = {}
    for label, value in list_known_values(robot).items():
        # Sums and products of the file's decimals, without their rounding.
        exact = Fraction(f"{value:.15g}")
        known[label] = field.convert(QQ(exact.numerator, exact.denominator))
    for index, joint in enumerate(robot.joints):
        if joint.form is not None:
            entries = _transform_form(joint.form, joint.frame, numbers, field)
            known |= {(index, name): value for name, value in zip(INERTIAL, entries, strict=True)}
    forms: dict[str, Expr] = {}
    for parameter in (*base.parameters, *base.friction):
        if all(label in known for label, _ in parameter.terms):
            terms = (field.from_sympy(factor) * known[label] for label, factor in parameter.terms)
            total = sum(terms, field.zero)
            if not (total.numer.is_ground and total.denom.is_ground):
                forms[parameter.name] = field.to_sympy(total)
    return forms


def _transform_form(
    form: SymbolicInertia, frame: Placement, numbers: Domain, field: Domain
) -> tuple[exact_algebra.Number, ...]:
    """Return the ten standard parameters about the link frame's origin, in the order of the notation."""
    # With R, p the frame of the form: c = R c' + p, s = m c, I = R I' R^T + m (c.c 1 - c c^T).

    def convert(value: Exact) -> exact_algebra.Number:
        return exact_algebra.convert_number(value, numbers, field)

    def build(rows: Iterable[Sequence[Exact]]) -> DomainMatrix:
        entries = [[convert(entry) for entry in row] for row in rows]
        return DomainMatrix(entries, (3, len(entries[0])), field)

    rotation, mass = build(frame.rotation), convert(form.mass)
    xx, xy, xz, yy, yz, zz = form.inertia
    central = build(((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)))
    com = rotation * build([entry] for entry in form.com) + build([entry] for entry in frame.translation)
    square = (com.transpose() * com).to_list()[0][0] * DomainMatrix.eye(3, field)
    tensor = (rotation * central * rotation.transpose() + mass * (square - com * com.transpose())).to_list()
    moments = [mass * row[0] for row in com.to_list()]
    return (*(tensor[i][j] for i in range(3) for j in range(i, 3)), *moments, mass)
