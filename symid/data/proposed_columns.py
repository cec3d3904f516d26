"""Which columns of a log are which quantity of which joint.

Input: headings, the joints, or names that the user gives. Output: names of columns; mistakes and what was
taken for granted go into the findings.

Supported: one column for each joint, by its name or by numbers in order; one array with all joints.
Not supported: a quantity that one joint has no column of, or two; that is a mistake, never a choice.
"""

import difflib
import re
from collections.abc import Sequence

from symid.data.findings import Findings
from symid.data.headings import Heading
from symid.data.scales import join_names
from symid.robot.description import Joint

__all__ = ["NEEDED", "check_columns", "find_columns"]

NEEDED = ("time", "position", "torque")
"""Quantities that a log must have."""


def find_columns(
    headings: Sequence[Heading], quantity: str, joints: Sequence[Joint], findings: Findings
) -> tuple[str, ...]:
    """Return the columns of a quantity, one for each joint or one array; none where that is not certain.

    Args:
        headings: those of all columns.
        quantity: what is looked for.
        joints: those that have a coordinate of their own.
        findings: take a mistake where a log needs the quantity.
    """
    size = 1 if quantity == "time" else len(joints)
    own = [entry for entry in headings if entry.quantity == quantity and not entry.wanted]
    plain = [entry.column for entry in own if not entry.words and entry.size == size]
    single = [entry for entry in own if entry.size == 1]
    if quantity == "time" or len(plain) == 1:
        hits = [plain]
    elif size == 1:
        hits = [[*plain, *(hit for entry in _sort_by_joint(single, joints, findings) for hit in entry)]]
    else:
        hits = _sort_by_joint(single, joints, findings)
    if all(len(hit) == 1 for hit in hits):
        return tuple(hit[0] for hit in hits)
    if quantity in NEEDED:
        _refuse_columns(headings, quantity, joints, hits, findings)
    return ()


def _sort_by_joint(
    headings: Sequence[Heading], joints: Sequence[Joint], findings: Findings
) -> list[list[str]]:
    """Return for each joint the columns that are its own: by its name, else by numbers in order.

    A column that is one joint's by its name and another's by its number stands at both: nobody can tell.
    """
    named = [[entry.column for entry in headings if entry.names(joint)] for joint in joints]
    counted = _count_columns(headings, len(joints))
    if any(named):
        if all(len(hit) == 1 for hit in (*named, *counted)) and sorted(named) == sorted(counted):
            return _merge(named, counted)
        return named
    if counted and all(len(hit) == 1 for hit in counted):
        numbered = _match_numbers(headings, joints)
        if numbered != counted and all(len(hit) == 1 for hit in numbered):
            return _merge(numbered, counted)
        first = min(entry.number for entry in headings if entry.number is not None)
        pairs = ", ".join(f"{first + index} is {joint.name!r}" for index, joint in enumerate(joints))
        text = f"numbers in the names of columns count the joints in the order of the robot file: {pairs}"
        # Position, velocity and torque are mostly numbered alike: once is enough.
        if text not in {remark.text for remark in findings.remarks}:
            findings.remark("new.assumed-order", text)
    return counted or named


def _merge(first: Sequence[Sequence[str]], second: Sequence[Sequence[str]]) -> list[list[str]]:
    """Return for each joint the columns of both."""
    return [list(dict.fromkeys((*mine, *other))) for mine, other in zip(first, second, strict=True)]


def _match_numbers(headings: Sequence[Heading], joints: Sequence[Joint]) -> list[list[str]]:
    """Return the columns of the last number in each joint's name, such as 3 of wrist_j3; none without one."""
    found = [re.findall(r"\d+", joint.name)[-1:] for joint in joints]
    return [
        [entry.column for entry in headings if number and entry.number == int(number[0])] for number in found
    ]


def _count_columns(headings: Sequence[Heading], size: int) -> list[list[str]]:
    """Return the columns of each number, if all numbers from 0 or 1 on are there; else none."""
    numbers = sorted({entry.number for entry in headings if entry.number is not None})
    first = numbers[0] if numbers else 0
    if first > 1 or numbers != list(range(first, first + size)):
        return []
    return [[entry.column for entry in headings if entry.number == first + index] for index in range(size)]


def check_columns(
    known: Sequence[str], quantity: str, names: tuple[str, ...], joints: Sequence[Joint], findings: Findings
) -> tuple[str, ...]:
    """Return the names that the user gave; none, and mistakes noted, where the log has no such columns.

    Args:
        known: names of all columns.
        quantity: what the names are given for.
        names: one for each joint, or one for all.
        joints: those that have a coordinate of their own.
        findings: take the mistakes.
    """
    missing = [name for name in names if name not in known]
    for name in missing:
        near = difflib.get_close_matches(name, known, n=3, cutoff=0.5)
        hint = f"did you mean {' or '.join(map(repr, near))}? " if near else ""
        text = (
            f"--columns {quantity}: there is no column {name!r}; {hint}the log has {join_names(tuple(known))}"
        )
        findings.refuse("new.no-column", text)
    if len(names) not in ({1} if quantity == "time" else {1, len(joints)}):
        size = (
            "one"
            if quantity == "time"
            else f"one for each of {_list_joints(joints)}, or one array with all of them"
        )
        findings.refuse("new.column-count", f"--columns {quantity}: {len(names)} columns; give {size}")
        return ()
    return () if missing else names


def _list_joints(joints: Sequence[Joint]) -> str:
    return join_names(tuple(joint.name for joint in joints))


def _refuse_columns(
    headings: Sequence[Heading],
    quantity: str,
    joints: Sequence[Joint],
    hits: Sequence[Sequence[str]],
    findings: Findings,
) -> None:
    """Say which joints have no column of a quantity, or more than one, and what to write."""
    alone = len(hits) != len(joints) or quantity == "time"
    owners = [quantity] if alone else [f"{quantity} of joint {joint.name!r}" for joint in joints]
    pairs = list(zip(owners, hits, strict=True))
    double = [f"{owner} could be {' or '.join(map(repr, hit))}" for owner, hit in pairs if len(hit) > 1]
    lacking = [owner for owner, hit in pairs if not hit]
    parts = [*double, *([f"no column was recognised as {' or '.join(lacking)}"] if lacking else [])]
    example = (
        "NAME" if quantity == "time" else ",".join(f"NAME_{number}" for number in range(1, len(joints) + 1))
    )
    order = "" if quantity == "time" else f" (the columns of {_list_joints(joints)})"
    there = join_names(tuple(entry.column for entry in headings))
    text = f"{'; '.join(parts)}: give --columns {quantity}={example}{order}; the log has {there}"
    if lacking and len(lacking) < len(owners):
        text += "; joints at the end of a URDF that the log leaves out are cut by --tip LINK"
    findings.refuse("new.ambiguous-column" if double else "new.unknown-column", text)
