"""Base parameters as others group them: the exact change from our groups to theirs.

Input: base parameters, groups written as sums of standard parameters. Output: `Regrouping`, the matrix T
with theirs = T ours, exact.

Our groups are in reduced echelon form: each has a representative that no other group holds. What a group of
theirs holds of a representative is what it holds of our group; if nothing is left then, both say the same.

Supported: sums with decimal or fractional factors; names as symid writes them (XX1, MX2, IA3, Fv4, offset5,
IAm6) and the widespread Ixx1, mx2, m2, Ia3, fv4, fs4, off5, Iam6, fvm6, fsm6.
Not supported: groups whose factors are symbols.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from sympy import Expr, Integer, Matrix, Rational

from symid.dynamics.labels import Label, write_label
from symid.errors import Notice, UsageError
from symid.parameters.base import BaseParameters, build_standard_parameters
from symid.robot.description import Robot

__all__ = ["Regrouping", "find_regrouping", "read_group"]

_ALIASES = {
    **{f"I{name.lower()}": name for name in ("XX", "XY", "XZ", "YY", "YZ", "ZZ")},
    "mx": "MX",
    "my": "MY",
    "mz": "MZ",
    "m": "M",
    "Ia": "IA",
    "fv": "Fv",
    "fs": "Fc",
    "off": "offset",
}
_TERM = re.compile(r"\s*([+-])?\s*(?:(\d+(?:\.\d*)?(?:/\d+)?)\s*\*\s*)?([A-Za-z]+?)(m\d+|\d+)\s*")


@dataclass(frozen=True, slots=True, kw_only=True)
class Regrouping:
    """theirs = T ours: `rows` of T, one a group of theirs, over `names`, our parameters in order.

    `absent` are parameters of ours that take no part in any group of theirs. Both sets span the same space
    if theirs and `absent` together are as many as ours.
    """

    names: tuple[str, ...]
    rows: tuple[tuple[Expr, ...], ...]
    absent: tuple[str, ...]

    @property
    def is_complete(self) -> bool:
        """Return whether theirs and the absent ones together say what ours say."""
        return len(self.rows) + len(self.absent) == len(self.names)


def read_group(text: str, robot: Robot) -> dict[Label, Fraction]:
    """Return a group such as "Izz1 + Ia1 + 0.07*mz3" as factors of standard parameters.

    Raises:
        UsageError: the text is no such sum, or a name is no parameter of the robot.
    """
    known = _list_names(robot)
    found: dict[Label, Fraction] = {}
    place = 0
    while place < len(text):
        match = _TERM.match(text, place)
        if match is None or (place and match[1] is None):
            raise UsageError(_say_unreadable(text, text[place:]))
        sign, factor, stem, end = match.groups()
        name = f"{_ALIASES.get(stem, stem)}{end}"
        if name not in known:
            raise UsageError(_say_unreadable(text, f"{stem}{end}"))
        share = Fraction(factor or "1") * (-1 if sign == "-" else 1)
        found[known[name]] = found.get(known[name], Fraction(0)) + share
        place = match.end()
    return found


def _list_names(robot: Robot) -> dict[str, Label]:
    return {write_label(robot, label): label for label in build_standard_parameters(robot).labels}


def _say_unreadable(text: str, part: str) -> Notice:
    message = (
        f"group {text!r}: {part!r} is no parameter of this robot; write a sum such as Izz1 + Ia1 + 0.07*mz3"
    )
    return Notice(code="usage.unreadable-group", text=message)


def find_regrouping(base: BaseParameters, groups: Sequence[Mapping[Label, Fraction]]) -> Regrouping:
    """Return the exact matrix from our parameters to those of `groups`.

    Raises:
        UsageError: a group holds what no motion shows, or says what others say already.
    """
    ours = (*base.parameters, *base.friction)
    rows = []
    for number, group in enumerate(groups, start=1):
        row = [_find_exact(group.get(entry.label, Fraction(0))) for entry in ours]
        left: dict[Label, Expr] = {label: _find_exact(factor) for label, factor in group.items()}
        for share, entry in zip(row, ours, strict=True):
            for label, factor in entry.terms if share else ():
                left[label] = left.get(label, Integer(0)) - share * factor
        if any(value.expand() != 0 for value in left.values()):
            text = f"group {number} holds a combination of parameters that no motion of {base.robot} shows"
            raise UsageError(Notice(code="usage.other-groups", text=text))
        rows.append(tuple(row))
    if Matrix(rows).rank() != len(rows):
        text = f"the {len(rows)} groups are not independent: one of them follows from the others"
        raise UsageError(Notice(code="usage.other-groups", text=text))
    absent = [entry.name for k, entry in enumerate(ours) if not any(row[k] for row in rows)]
    names = tuple(entry.name for entry in ours)
    return Regrouping(names=names, rows=tuple(rows), absent=tuple(absent))


def _find_exact(value: Fraction) -> Expr:
    return Rational(value.numerator, value.denominator)
