"""The exact base parameters: which combinations of parameters a motion can show, and why.

Input: a robot. Output: `BaseParameters`: the grouping beta = K pi, its representatives, and for
every eliminated parameter what became of it.

`visibility` holds the argument, `base_rows` puts its rows together; here they are reduced and named.

Supported: trees; rotors, coupled drives and springs where the robot declares them; joints that follow others;
friction, whose offsets can coincide with a weight; symbolic lengths (generic values: no pivot vanishes).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from sympy import Expr, Integer

from symid.algebra.elimination import Row, reduce_rows
from symid.dynamics.drives import DRIVE, list_drive_parameters
from symid.dynamics.labels import Label, write_label
from symid.joint.friction import list_friction_parameters
from symid.notation import INERTIAL
from symid.parameters.base_rows import Shown, find_shown_rows
from symid.parameters.explain import explain_elimination, explain_grouping, write_combination
from symid.robot.description import Robot

__all__ = [
    "FORMS",
    "BaseParameter",
    "BaseParameters",
    "Eliminated",
    "Label",
    "build_standard_parameters",
    "find_base_parameters",
]

FORMS = ("torque", "energy", "momentum", "gravity")
_INERTIAL = (*INERTIAL, *DRIVE)


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
    `vector` is the letter of the inertial ones: beta, or pi where every standard parameter stands for itself.
    """

    robot: str
    labels: tuple[Label, ...]
    parameters: tuple[BaseParameter, ...]
    friction: tuple[BaseParameter, ...]
    eliminated: tuple[Eliminated, ...]
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


def _write_parameters(
    rows: Sequence[Row], labels: Sequence[Label], robot: Robot, shown: Shown
) -> Iterator[BaseParameter]:
    for row in rows:
        terms = tuple((labels[column], shown.field.to_sympy(value)) for column, value in sorted(row.items()))
        label = terms[0][0]
        named = [(write_label(robot, other), value) for other, value in terms]
        yield BaseParameter(
            name=write_label(robot, label, grouped=len(terms) > 1),
            label=label,
            terms=terms,
            expression=write_combination(named),
            reason=explain_grouping(robot, label, [other for other, _ in terms[1:]], _angular(shown, label)),
        )


def _angular(shown: Shown, label: Label) -> tuple[tuple[int, ...], ...]:
    """Return which components of the angular velocity each attainable velocity of the link holds."""
    if label[0] >= len(shown.visible):
        return ()
    rows = shown.visible[label[0]].velocities
    return tuple(tuple(sorted(column for column in row if column < 3)) for row in rows)


def _write_eliminated(
    labels: Sequence[Label], parameters: Sequence[BaseParameter], robot: Robot, shown: Shown, form: str
) -> Iterator[Eliminated]:
    kept = {parameter.label for parameter in parameters}
    groups: Mapping[Label, list[tuple[str, Label]]] = {label: [] for label in labels}
    for parameter in parameters:
        for label, _ in parameter.terms:
            groups[label].append((parameter.name, parameter.label))
    for label in labels:
        if label not in kept:
            reason = explain_elimination(robot, label, groups[label], _angular(shown, label), form)
            yield Eliminated(name=write_label(robot, label), label=label, reason=reason)


def build_standard_parameters(robot: Robot) -> BaseParameters:
    """Return all parameters, each for itself: K is the unit matrix, and some of them show nowhere."""
    entries = [
        BaseParameter(
            name=write_label(robot, label),
            label=label,
            terms=((label, Integer(1)),),
            expression=write_label(robot, label),
            reason="standard parameter, on its own",
        )
        for label in _label_parameters(robot)
    ]
    return BaseParameters(
        robot=robot.name,
        labels=_label_parameters(robot),
        parameters=tuple(entry for entry in entries if entry.label[1] in _INERTIAL),
        friction=tuple(entry for entry in entries if entry.label[1] not in _INERTIAL),
        eliminated=(),
        vector="pi",
    )


def find_base_parameters(robot: Robot, *, form: str = "torque") -> BaseParameters:
    """Return the exact base parameters of `robot`.

    The representatives are the first ones in canonical order, links from the base and XX XY XZ YY YZ
    ZZ MX MY MZ M IA KS KR within a link; this reproduces Khalil's convention (YY, MZ and M of a revolute
    link are grouped into it and into the link before).

    Args:
        robot: the robot.
        form: "torque": all that joint torques show; "energy": what kinetic and potential energy show, up to
            a constant (the same without friction); "momentum": what the momentum dT/ddq shows, "gravity" what
            torques at rest show, springs included, friction apart.

    Raises:
        ValueError: there is no such form.
        RobotError: three joints share a coordinate, next to symbolic lengths and angles with roots.
    """
    if form not in FORMS:
        message = f"there is no form {form!r}; allowed are {', '.join(FORMS)}"
        raise ValueError(message)
    friction = form == "torque"
    labels = tuple(label for label in _label_parameters(robot) if friction or label[1] in _INERTIAL)
    column = {label: index for index, label in enumerate(labels)}
    shown = find_shown_rows(robot, form)
    known = ({column[label]: value for label, value in row.items() if label in column} for row in shown.rows)
    reduced = reduce_rows(known).rows
    written = tuple(_write_parameters(reduced, labels, robot, shown))
    return BaseParameters(
        robot=robot.name,
        labels=labels,
        parameters=tuple(p for p in written if p.label[1] in _INERTIAL),
        friction=tuple(p for p in written if p.label[1] not in _INERTIAL),
        eliminated=tuple(_write_eliminated(labels, written, robot, shown, form)),
    )
