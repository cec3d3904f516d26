"""The exact base parameters: which combinations of parameters a motion can show, and why.

Input: a robot. Output: `BaseParameters`: the grouping beta = K pi, its representatives, and for
every eliminated parameter what became of it.

`visibility` holds the argument; here its rows are put together, reduced and named.

Supported: trees; rotor inertias IA where the robot declares them; friction, whose offsets can
coincide with a weight; symbolic lengths (generic values are assumed: no pivot vanishes).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sympy import Expr
from sympy.polys.domains.domain import Domain

from symid.algebra.elimination import Row, reduce_rows
from symid.algebra.exact import find_domain, find_number
from symid.dynamics.explain import explain_elimination, explain_grouping, write_combination
from symid.dynamics.transport import Transport, apply, find_field, find_transport
from symid.dynamics.visibility import OFFSET, ROTOR, Visible, find_visible, find_visible_rows
from symid.joint.friction import FRICTION_MODELS
from symid.notation import INERTIAL
from symid.robot.description import Robot

__all__ = ["BaseParameter", "BaseParameters", "Eliminated", "Label", "find_base_parameters"]

Label = tuple[int, str]
"""A standard parameter: index of its joint, name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BaseParameter:
    """A base parameter: its representative `label` and its group, `terms`, with exact coefficients."""

    name: str
    label: Label
    terms: tuple[tuple[Label, Expr], ...]
    expression: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Eliminated:
    """A parameter that is not its own representative: no effect, or grouped into others."""

    name: str
    label: Label
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class BaseParameters:
    """The base set of a robot.

    `parameters` are the inertial ones (drives included), `friction` those of the friction models, in the
    order of the vectors beta and f; `labels` the columns of K, all parameters in their canonical order.
    """

    robot: str
    labels: tuple[Label, ...]
    parameters: tuple[BaseParameter, ...]
    friction: tuple[BaseParameter, ...]
    eliminated: tuple[Eliminated, ...]

    @property
    def count(self) -> int:
        """Return the number of base inertial parameters."""
        return len(self.parameters)

    @property
    def keys(self) -> tuple[Label, ...]:
        """Return the representatives of beta, in order."""
        return tuple(parameter.label for parameter in self.parameters)


def _label_parameters(robot: Robot) -> tuple[Label, ...]:
    """Return all parameters in canonical order: links from the base, then friction."""
    labels: list[Label] = []
    for index, joint in enumerate(robot.joints):
        labels += [(index, name) for name in INERTIAL]
        if joint.drive.has_rotor:
            labels.append((index, "IA"))
    for index, joint in enumerate(robot.joints):
        labels += [(index, name) for name in FRICTION_MODELS[joint.friction.kind].parameters]
    return tuple(labels)


def _expand(robot: Robot, transports: Sequence[Transport], joint: int, row: Row) -> dict[Label, Any]:
    """Return a row on the composite of link `joint` as a row on the parameters of all links beyond it."""
    inertial = {column: value for column, value in row.items() if column < len(INERTIAL)}
    result: dict[Label, Any] = {}
    pending = [(joint, inertial)]
    while pending:
        link, part = pending.pop()
        result |= {(link, INERTIAL[column]): value for column, value in part.items()}
        for child, other in enumerate(robot.joints):
            if other.parent == link:
                pending.append((child, apply(part, transports[child].parameters[0])))
    if ROTOR in row:
        result[joint, "IA"] = row[ROTOR]
    if OFFSET in row:
        model = FRICTION_MODELS[robot.joints[joint].friction.kind]
        result |= {(joint, name): row[OFFSET] * sign for name, sign in model.constant}
    return result


def _collect_rows(robot: Robot, field: Domain) -> tuple[list[dict[Label, Any]], list[Visible]]:
    """Return the rows of all joints over all parameters, and what is visible at each link."""
    one = field.one
    transports = [find_transport(robot, joint, field) for joint in robot.joints]
    root = Visible(steady=_find_weight(robot, field), varying=(), velocities=())
    visible: list[Visible] = []
    rows: list[dict[Label, Any]] = []
    for index, joint in enumerate(robot.joints):
        parent = visible[joint.parent] if joint.parent >= 0 else root
        echelon = find_visible_rows(joint.kind, parent, transports[index], one, rotor=joint.drive.has_rotor)
        rows += [_expand(robot, transports, index, row) for row in echelon.rows]
        visible.append(find_visible(joint.kind, parent, transports[index], one))
        for combination in FRICTION_MODELS[joint.friction.kind].shows:
            rows.append({(index, name): sign * one for name, sign in combination})
    return rows, visible


def _find_weight(robot: Robot, field: Domain) -> Row:
    """Return the potential of the base's own parameters, -g' MS, as a row."""
    numbers = [find_number(value, find_domain(robot), field) for value in robot.gravity]
    return {INERTIAL.index("MX") + axis: -value for axis, value in enumerate(numbers) if value}


def _name(label: Label, *, grouped: bool) -> str:
    joint, name = label
    return f"{name}{'R' if grouped else ''}{joint + 1}"


def _write_parameters(
    rows: Sequence[Row], labels: Sequence[Label], robot: Robot, visible: Sequence[Visible], field: Domain
) -> Iterator[BaseParameter]:
    for row in rows:
        terms = tuple((labels[column], field.to_sympy(value)) for column, value in sorted(row.items()))
        label = terms[0][0]
        named = [(_name(other, grouped=False), value) for other, value in terms]
        yield BaseParameter(
            name=_name(label, grouped=len(terms) > 1),
            label=label,
            terms=terms,
            expression=write_combination(named),
            reason=explain_grouping(
                robot, label, [other for other, _ in terms[1:]], _angular(visible, label)
            ),
        )


def _angular(visible: Sequence[Visible], label: Label) -> tuple[tuple[int, ...], ...]:
    """Return which components of the angular velocity each attainable velocity of the link holds."""
    rows = visible[label[0]].velocities
    return tuple(tuple(sorted(column for column in row if column < 3)) for row in rows)


def _write_eliminated(
    labels: Sequence[Label],
    parameters: Sequence[BaseParameter],
    robot: Robot,
    visible: Sequence[Visible],
) -> Iterator[Eliminated]:
    kept = {parameter.label for parameter in parameters}
    groups: Mapping[Label, list[tuple[str, Expr]]] = {label: [] for label in labels}
    for parameter in parameters:
        for label, value in parameter.terms:
            groups[label].append((parameter.name, value))
    for label in labels:
        if label not in kept:
            reason = explain_elimination(robot, label, groups[label], _angular(visible, label))
            yield Eliminated(name=_name(label, grouped=False), label=label, reason=reason)


def find_base_parameters(robot: Robot) -> BaseParameters:
    """Return the exact base parameters of `robot`.

    The representatives are the first ones in canonical order, links from the base and XX XY XZ YY YZ
    ZZ MX MY MZ M IA within a link; this reproduces Khalil's convention (YY, MZ and M of a revolute
    link are grouped into it and into the link before).
    """
    field = find_field(robot)
    labels = _label_parameters(robot)
    column = {label: index for index, label in enumerate(labels)}
    rows, visible = _collect_rows(robot, field)
    known = ({column[label]: value for label, value in row.items() if label in column} for row in rows)
    reduced = reduce_rows(known).rows
    written = tuple(_write_parameters(reduced, labels, robot, visible, field))
    return BaseParameters(
        robot=robot.name,
        labels=labels,
        parameters=tuple(p for p in written if p.label[1] in (*INERTIAL, "IA")),
        friction=tuple(p for p in written if p.label[1] not in (*INERTIAL, "IA")),
        eliminated=tuple(_write_eliminated(labels, written, robot, visible)),
    )
