"""Base parameters as others group them: the exact change from our groups to theirs.

Base parameters, groups written as sums of parameters -> the rows of the matrix T with theirs = T ours,
exact; `OpenReading`, a term that a group may hold without naming it, for which values must decide.

Our groups are in reduced echelon form: what a group of theirs holds of a representative is what it holds of
our group. Of the friction or inertia P of a drive of speed w = sum of c_i dq_i, joint i has c_i P w, whose
part c_i^2 P dq_i has the column of the joint's own P_i: a table may hold P_i + c_i^2 P where it names P_i.

Supported: sums with decimal or fractional factors; names as symid writes them (XX1, MX2, IA3, ZZR1) and the
widespread Ixx1, mx2, m2, Ia3, fv4, fs4, off5, Iam6, fvm6, fsm6; open readings of inertia and viscous friction
of couplings, and of single parameters of the same kind with factor one or minus one.
Not supported: symbolic or rounded factors; open readings of Coulomb friction of a coupling.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from sympy import Expr, Integer, Matrix, Symbol, sympify
from sympy.polys.matrices import DomainMatrix

from symid.arrays import FloatArray
from symid.dynamics.algebra import Label
from symid.dynamics.base_parameters import BaseParameters, build_standard_parameters
from symid.dynamics.explanations import write_combination, write_label
from symid.errors import Notice, UsageError
from symid.robot import Robot

_ALIASES = {
    **{f"I{name.lower()}": name for name in ("XX", "XY", "XZ", "YY", "YZ", "ZZ")},
    "mx": "MX",
    "my": "MY",
    "mz": "MZ",
    "m": "M",
    "Ia": "IA",
    "fv": "Fv",
    "fs": "Fc",
    "fc": "Fc",
    "Fs": "Fc",
    "off": "offset",
}
_TERM = re.compile(
    r"\s*([+-])?\s*(?:(\d+(?:\.\d*)?(?:[eE][+-]?\d{1,3})?(?:/[1-9]\d*)?|\.\d+(?:[eE][+-]?\d{1,3})?)\s*\*\s*)?"
    r"([A-Za-z]\w*)\s*"
)
_HEAD = re.compile(r"([A-Za-z]+?)(m?\d+)R")

_LARGEST = 10**12

_Terms = dict[Label, Expr]
_Row = tuple[Expr, ...]
_LINEAR = ("IA", "Fv")


def read_group(text: str, robot: Robot, base: BaseParameters | None = None) -> _Terms:
    """Return a group such as "Izz1 + Ia1 + 0.07*mz3" as factors of standard parameters of `robot`.

    Base parameters may be named as well where `base` is given. A UsageError for a text that is no such sum,
    or an unknown name.
    """
    # A name of both kinds is a base parameter of one member: both meanings are the same.
    known = {entry.name: entry.terms for entry in (*base.parameters, *base.friction)} if base else {}
    standard = build_standard_parameters(robot).labels
    known |= {write_label(robot, label): ((label, Integer(1)),) for label in standard}
    found: _Terms = {}
    place = 0
    # Printed tables have the minus of typography.
    text = text.replace("\N{MINUS SIGN}", "-")
    while place < len(text) or not text:
        match = _TERM.match(text, place)
        if match is None or (place and match[1] is None):
            raise UsageError(_say_unreadable(text, text[place:]))
        sign, factor, name = match.groups()
        # A name of ours, or a widespread one; longer stems first: "my2" is a moment before it is a mass.
        head = _HEAD.fullmatch(name)
        spellings = (name, f"{head[1]}R{head[2]}") if head else (name,)
        stems = sorted(_ALIASES, key=len, reverse=True)
        ours = [
            option
            for spelling in spellings
            for option in (
                spelling,
                *(f"{_ALIASES[x]}{spelling.removeprefix(x)}" for x in stems if spelling.startswith(x)),
            )
            if option in known
        ]
        if not ours:
            raise UsageError(_say_unreadable(text, name))
        share = Fraction(factor or "1") * (-1 if sign == "-" else 1)
        if share and not 1 / _LARGEST <= abs(share) <= _LARGEST:
            message = f"group {text!r}: factor {factor} of {name}: expected between 1e-12 and 1e12"
            raise UsageError(Notice(code="usage.unreadable-group", text=message))
        for label, value in known[ours[0]]:
            found[label] = found.get(label, Integer(0)) + sympify(share) * value
        place = match.end()
    return found


def _say_unreadable(text: str, part: str) -> Notice:
    message = f"group {text!r}: unknown parameter {part!r}; write a sum such as Izz1 + Ia1 + 0.07*mz3"
    return Notice(code="usage.unreadable-group", text=message)


def express_group(base: BaseParameters, group: Mapping[Label, Expr | Fraction], name: str) -> _Row:
    """Return what a group holds of each of our parameters, exactly; `name` is what messages call it.

    A UsageError where the group is not a combination of ours; the message names the rest.
    """
    ours = (*base.parameters, *base.friction)
    row = [sympify(group.get(entry.label, Integer(0))) for entry in ours]
    left: _Terms = {label: sympify(factor) for label, factor in group.items()}
    for share, entry in zip(row, ours, strict=True):
        for label, factor in entry.terms if share else ():
            left[label] = left.get(label, Integer(0)) - share * factor
    rest = {label: value for label in sorted(left) if (value := left[label].expand()) != 0}
    if not rest:
        return tuple(row)
    # The names of all standard parameters.
    names = {entry.label: entry.name for entry in base.eliminated}
    for entry in ours:
        head = f"{entry.label[1]}R" if len(entry.terms) > 1 else entry.label[1]
        names[entry.label] = f"{entry.label[1]}{entry.name.removeprefix(head)}"
    over = [(names.get(label, f"{label[1]}{label[0] + 1}"), value) for label, value in rest.items()]
    text = f"{name} is not identifiable for {base.robot}: {write_combination(over)} is left over"
    whole = [entry for entry in ours if entry.label in group and len(entry.terms) > 1]
    if whole:
        text += f" when {'; '.join(f'{entry.name} = {entry.expression}' for entry in whole)} is subtracted"
    text += "; write the whole group, with factors that are not rounded"
    raise UsageError(Notice(code="usage.other-groups", text=text))


def check_independent(rows: Sequence[_Row], titles: Sequence[str]) -> None:
    """Refuse groups, rows as of `express_group`, that depend linearly on others, by a UsageError."""
    notices = []
    if rows:
        reduced, pivots = DomainMatrix.from_Matrix(Matrix(rows).T, extension=True).to_field().rref()
        entries = reduced.to_Matrix()
    for number in range(len(rows)):
        if number not in pivots:
            sources = [titles[pivot] for k, pivot in enumerate(pivots) if entries[k, number] != 0]
            text = f"the {len(rows)} groups are linearly dependent: {titles[number]} follows from "
            text += f"{', '.join(sources) or 'nothing'}; leave one of them out"
            notices.append(Notice(code="usage.other-groups", text=text))
    if notices:
        raise UsageError(*notices)


def evaluate_regrouping(rows: Sequence[Sequence[Expr]], robot: Robot) -> FloatArray:
    """Return rows of T as numbers, (m, n), with the robot's values of the symbols it writes."""
    symbols = {Symbol(name): value for name, value in robot.symbols}
    numbers = [[float(value.subs(symbols)) for value in row] for row in rows]
    return np.array(numbers, dtype=np.float64).reshape(len(rows), -1 if rows else 0)


@dataclass(frozen=True, slots=True, kw_only=True)
class OpenReading:
    """A term that a group may hold without naming it: `factor` times our parameter number `column`.

    Args:
        group: number of the group. name: that of our parameter.
        coupling: the drive whose parameter it is, where the algebra implies it; else empty.
    """

    group: int
    column: int
    name: str
    factor: Expr
    coupling: str = ""


def list_coupled_readings(
    robot: Robot, base: BaseParameters, rows: Sequence[_Row]
) -> tuple[OpenReading, ...]:
    """Return the readings that coupled drives leave open: a group names the drive, the joint's own does not.

    `rows` hold each group in ours. Factor in a group: what it holds of P_i times c_i^2, summed over the
    joints of the coupling.
    """
    ours = (*base.parameters, *base.friction)
    columns = _list_columns(base)
    readings = []
    for number, coupling in enumerate(robot.couplings):
        for kind in _LINEAR:
            drive = (robot.size + number, kind)
            # A parameter that shows only together with others has no column of its own.
            if drive not in columns or not any(row[columns[drive][0]] for row in rows):
                continue
            column, name = columns[drive]
            squares = {(joint, kind): sympify(factor) ** 2 for joint, factor in coupling.terms}
            shares = [
                sum((squares[label] * value for label, value in entry.terms if label in squares), Integer(0))
                for entry in ours
            ]
            for place, row in enumerate(rows):
                factor = sum((a * b for a, b in zip(row, shares, strict=True) if a and b), Integer(0))
                if factor and not row[column]:
                    found = OpenReading(group=place, column=column, name=name, factor=factor)
                    readings.append(replace(found, coupling=coupling.name))
    return tuple(readings)


def list_kindred_readings(
    base: BaseParameters, rows: Sequence[_Row], numbers: Sequence[int]
) -> tuple[OpenReading, ...]:
    """Return every parameter of the same kind, added and subtracted, for the groups `numbers` of `rows`."""
    ours = (*base.parameters, *base.friction)
    columns = _list_columns(base)
    kinds = {
        number: {entry.label[1] for entry, share in zip(ours, rows[number], strict=True) if share}
        for number in numbers
    }
    return tuple(
        OpenReading(group=number, column=column, name=name, factor=Integer(sign))
        for number in numbers
        for label, (column, name) in columns.items()
        if label[1] in kinds[number] and not rows[number][column]
        for sign in (1, -1)
    )


def _list_columns(base: BaseParameters) -> dict[Label, tuple[int, str]]:
    """Return number and name of every parameter of ours with one member."""
    ours = (*base.parameters, *base.friction)
    return {entry.label: (k, entry.name) for k, entry in enumerate(ours) if len(entry.terms) == 1}
